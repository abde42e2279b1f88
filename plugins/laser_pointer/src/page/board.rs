//! Contents of the page: ink in drawing order, and events.

use std::collections::{BTreeMap, VecDeque};

use foveate::prelude::*;
use nalgebra::Point2;
use serde::Serialize;

use crate::wall::Wall;

/// Events kept for windows that were disconnected.
const MOST_EVENTS: usize = 512;
/// Pointers whose user is kept for windows that were disconnected or open late.
const MOST_OWNERS: usize = 4096;

/// A point of a stroke: number of the stroke, pointer, place from the wall's top left corner [m].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Ink(pub(super) u64, pub(super) u32, pub(super) f64, pub(super) f64);

/// User of a pointer: the pointer, the user.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Owner(pub(super) u32, pub(super) u32);

/// An event of a pointer, for other programs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Told {
    id: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    user: Option<u32>,
    what: &'static str,
    /// Session time [s].
    time: f64,
    latency_ms: f64,
    x: f64,
    y: f64,
}

/// The newest items of a stream, each with its number.
#[derive(Debug)]
pub(super) struct Log<T> {
    kept: VecDeque<T>,
    /// Number of the first kept item.
    first: u64,
    most: usize,
}

impl<T> Log<T> {
    fn new(most: usize) -> Log<T> {
        Log { kept: VecDeque::new(), first: 0, most }
    }

    fn push(&mut self, it: T) {
        self.kept.push_back(it);
        if self.kept.len() > self.most {
            self.kept.pop_front();
            self.first += 1;
        }
    }

    fn clear(&mut self) {
        self.first += self.kept.len() as u64;
        self.kept.clear();
    }

    /// The kept items from number `from` on, `most` at most, and the number after them.
    pub(super) fn since(&self, from: u64, most: usize) -> (impl Iterator<Item = &T>, u64) {
        let skipped = from.saturating_sub(self.first) as usize;
        let n = self.kept.len().saturating_sub(skipped).min(most);
        let after = self.first + (skipped.min(self.kept.len()) + n) as u64;
        (self.kept.iter().skip(skipped).take(n), after)
    }
}

/// Contents of the page.
pub(super) struct Board {
    pub(super) ink: Log<Ink>,
    pub(super) events: Log<Told>,
    /// Users of pointers, in the order in which they became known.
    pub(super) owners: Log<Owner>,
    /// Users of the present pointers.
    known: BTreeMap<TargetId, u32>,
    /// Raised when the page is cleared.
    pub(super) epoch: u64,
    step: f64,
    /// By pointer that is held down: its stroke, and the last point of it.
    open: BTreeMap<TargetId, (u64, Point2<f64>)>,
    n_strokes: u64,
    /// Lines so far: a stroke that turns out to be another pointer's continues as another line.
    n_lines: u64,
}

impl Board {
    /// Keeps at most this many points, with `step` metres between the points of a stroke.
    pub(super) fn new(most_points: usize, step: f64) -> Board {
        let (ink, events) = (Log::new(most_points), Log::new(MOST_EVENTS));
        Board {
            ink,
            events,
            owners: Log::new(MOST_OWNERS),
            known: BTreeMap::new(),
            epoch: 0,
            step,
            open: BTreeMap::new(),
            n_strokes: 0,
            n_lines: 0,
        }
    }

    /// Number of strokes begun.
    pub(super) fn n_strokes(&self) -> u64 {
        self.n_strokes
    }

    /// Takes in the pointers' state and events.
    pub(super) fn take(&mut self, wall: &Wall, pointers: &Pointers) {
        for it in &pointers.list {
            let Some(user) = it.user else { continue };
            if self.known.insert(it.id, user) != Some(user) {
                self.owners.push(Owner(it.id.0, user));
            }
        }
        self.known.retain(|id, _| pointers.list.iter().any(|it| it.id == *id));
        for id in pointers.exchanged.iter().flat_map(|it| it.ids) {
            let Some(it) = pointers.list.iter().find(|it| it.id == id) else { continue };
            if let Some(open) = self.open.get_mut(&id) {
                self.n_lines += 1;
                *open = (self.n_lines, it.position);
                self.draw(wall, self.n_lines, id, it.position);
            }
        }
        for it in &pointers.events {
            match it.what {
                PointerChange::Press => {
                    (self.n_strokes, self.n_lines) = (self.n_strokes + 1, self.n_lines + 1);
                    self.open.insert(it.id, (self.n_lines, it.position));
                    self.draw(wall, self.n_lines, it.id, it.position);
                }
                PointerChange::Release => {
                    // The last bit, shorter than a step.
                    if let Some((stroke, _)) = self.open.remove(&it.id).filter(|open| open.1 != it.position) {
                        self.draw(wall, stroke, it.id, it.position);
                    }
                }
                _ => {}
            }
            if !matches!(it.what, PointerChange::Move | PointerChange::Stroke) {
                let [x, y] = on_page(wall, it.position);
                let (time, latency_ms) = (it.time.as_s(), tenth(it.latency.as_ms()));
                self.events.push(Told { id: it.id.0, user: it.user, what: it.what.name(), time, latency_ms, x, y });
            }
        }
        for it in pointers.list.iter().filter(|it| it.is_pressed && it.is_seen) {
            let Some((stroke, last)) = self.open.get_mut(&it.id) else { continue };
            if (it.position - *last).norm() >= self.step {
                *last = it.position;
                let stroke = *stroke;
                self.draw(wall, stroke, it.id, it.position);
            }
        }
    }

    fn draw(&mut self, wall: &Wall, stroke: u64, id: TargetId, at: Point2<f64>) {
        let [x, y] = on_page(wall, at);
        self.ink.push(Ink(stroke, id.0, x, y));
    }

    /// Removes all ink from the page.
    pub(super) fn clear(&mut self) {
        self.ink.clear();
        self.epoch += 1;
    }
}

/// From the wall's top left corner, to a tenth of a millimetre [m].
pub(super) fn on_page(wall: &Wall, at: Point2<f64>) -> [f64; 2] {
    let from_corner = at - wall.corner;
    [from_corner.x, from_corner.y].map(|it| (it * 1e4).round() / 1e4)
}

/// Rounded to a tenth, for people.
pub(super) fn tenth(value: f64) -> f64 {
    (value * 10.0).round() / 10.0
}

/// The first message to a window; with a `board`, the run is over and it is the only one.
pub(super) fn greeting(wall: &Wall, board: Option<&Board>) -> String {
    let mut text = serde_json::json!({ "wall": { "width": wall.size.x, "height": wall.size.y } });
    if let Some(board) = board {
        let (ink, _) = board.ink.since(0, usize::MAX);
        text["ink"] = serde_json::json!(ink.collect::<Vec<_>>());
        let (owners, _) = board.owners.since(0, usize::MAX);
        text["users"] = serde_json::json!(owners.collect::<Vec<_>>());
        text["over"] = serde_json::json!("The run is over.");
    }
    text.to_string()
}
