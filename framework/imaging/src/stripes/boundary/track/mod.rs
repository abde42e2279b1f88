//! Edges tracked from picture to picture, row by row, until four pictures say which boundary each is.
//!
//! 1. A track is predicted from its last column, the caller's prediction, and its own velocity on top of that.
//! 2. Tracks and edges of a row stand in the same order, so they are matched in order: the matching of least cost is found by dynamic programming (`in_order`). A track may be a ghost where
//!    its code says that it does not show, or may not.
//! 3. A track keeps the set of boundaries that it may be. What is seen of it, rising or falling, or dark or lit on both sides where it is a ghost, takes away those that look
//!    otherwise. One that is left, after four pictures that all fit, is what it is; a track of which nothing is left ends.
//! 4. A boundary that should show and is not found is carried on for one picture, once all pictures of the code have fitted twice. One that is not found in the same picture of the code twice ends: where
//!    a whole picture went to the neighbours, numbers fit three pictures of four.
//! 5. Where known tracks around a new one leave it one number, and what is seen of it fits, it has that number (`adopt`).
//! 6. A surface that goes through the stripes makes boundaries faster and slower; known tracks say how, before the next picture (`sliding`).
//! 7. What errors of a head's pose move in common is taken off before tracks are matched ([`Tracker::align`]).
//!
//! The projector may show another picture than the requested one: known tracks identify it ([`Agreement`](super::Agreement)).

mod in_order;

use std::collections::VecDeque;

use self::in_order::Matcher;
use super::adopt::adopt;
use super::common::common_shift;
use super::design::{FRAMES, Look};
use super::detect::{Edge, Edges};
use super::sliding::{Profile, Sliding, is_in_profile, left_of, profile, wide_beside};
use crate::ImagingError;

/// How edges are tracked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackOptions {
    /// From one stripe to the next in the camera's picture, on what faces it, about [px].
    pub pitch: f32,
    /// How far a new track may be from its predicted place, in widths of known stripes beside it [–].
    pub new_reach: f32,
    /// The same for one that was seen twice: what moves does so evenly [–].
    pub known_reach: f32,
    /// Threads.
    pub threads: usize,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self { pitch: 8.0, new_reach: 0.5, known_reach: 0.2, threads: 1 }
    }
}

/// Where a track was in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Column; that of a ghost as predicted [px].
    pub x: f32,
    /// Standard deviation of a column that was measured [px].
    pub sigma: f32,
    /// Whether it was seen rather than predicted.
    pub is_seen: bool,
    /// How far the caller predicted it to move from the picture before [px].
    pub shift: f32,
}

/// An edge from picture to picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// In the newest picture.
    pub now: Place,
    /// In the one before it; none where the track is new.
    pub before: Option<Place>,
    /// In the one before that.
    pub earlier: Option<Place>,
    /// On top of the caller's prediction [px a picture].
    velocity: f32,
    /// Boundaries that it may be, as bits.
    possible: u128,
    /// Pictures that fitted, one after the other.
    run: u32,
    /// Pictures in which it was seen.
    seen: u32,
    /// Pictures since it was seen.
    unseen: u32,
    /// Pictures in which it should have been seen and was not, one after the other.
    missed: u32,
    /// Pictures of the code in which it should have been seen and was not when they were shown last, as bits.
    owed: u8,
    /// Pictures since light was seen on its left, and on its right.
    since_lit: [u8; 2],
}

impl Track {
    /// The number of its boundary in the code, where four pictures say it.
    pub fn number(&self) -> Option<usize> {
        (self.run >= FRAMES as u32 && self.possible.count_ones() == 1).then(|| self.possible.trailing_zeros() as usize)
    }

    /// Whether it is known and each picture of the code has fitted twice.
    pub fn is_proven(&self) -> bool {
        self.run >= PROVEN && self.owed == 0 && self.number().is_some()
    }

    /// Whether it is known well enough to say what is beside it: borne out by a picture more than its number needs, or where surfaces are `fast` seen twice.
    pub(super) fn vouches(&self, fast: bool) -> bool {
        (self.run > FRAMES as u32 || fast && self.seen > 1) && self.owed == 0 && self.number().is_some()
    }

    /// Whether it is seen, and no picture so far speaks against any of the boundaries that it may be, several as yet.
    pub(super) fn is_open(&self) -> bool {
        self.number().is_none() && self.now.is_seen && self.owed == 0
    }

    /// Whether two looks speak for what it is.
    pub(super) fn is_seen_twice(&self) -> bool {
        self.seen > 1
    }

    /// Takes it for boundary `number`, if what was seen of it allows that: as if four pictures had said so, and one more where it was seen twice and that is certain.
    pub(super) fn take_for(&mut self, number: usize, is_certain: bool) {
        if self.possible >> number & 1 == 1 {
            self.possible = 1 << number;
            self.run = self.run.max(FRAMES as u32 + u32::from(is_certain && self.seen > 1));
        }
    }

    /// Whether each picture of the code fitted when it was shown last.
    pub fn fits_all(&self) -> bool {
        self.owed == 0
    }

    /// Whether light was seen on its left, and on its right, while each picture of the code was shown last. On the other side of an edge where light ends there is none in any of them.
    pub fn is_lit(&self) -> [bool; 2] {
        self.since_lit.map(|it| usize::from(it) < FRAMES)
    }

    /// Takes down on which sides there is light in a picture.
    fn light(&mut self, is_lit: [bool; 2]) {
        for (since, is_lit) in self.since_lit.iter_mut().zip(is_lit) {
            *since = if is_lit { 0 } else { since.saturating_add(1) };
        }
    }

    /// Pictures that fitted.
    pub fn run(&self) -> u32 {
        self.run
    }
}

/// Tracks of all rows.
#[derive(Debug, Clone)]
pub struct Tracker {
    options: TrackOptions,
    rows: VecDeque<Vec<Track>>,
    down: i32,
    /// How the surface went through the stripes up to the newest picture.
    sliding: Sliding,
}

/// The caller's prediction: how far the point at (x, y) moves from the picture before to this one, in columns and rows [px].
pub type Shift<'a> = &'a (dyn Fn(f32, f32) -> [f32; 2] + Sync);

/// Numbers are given outwards from what is known so many boundaries a picture: a surface may go on by two.
const ADOPTIONS: usize = 3;
/// From so many stripes a picture on a surface brings in new boundaries faster than they are borne out one by one: those that were seen twice say what is beside them [stripes].
const FAST: f32 = 0.5;
/// Stripes are taken for no wider than so many that face the camera.
const WIDEST: f32 = 2.0;
/// Pictures that must fit before a track is carried on without being seen: each of the code twice.
const PROVEN: u32 = 2 * FRAMES as u32;
/// Rows above and below that say how fast a new track is.
const BESIDE: usize = 3;

impl Tracker {
    /// Without tracks, for pictures of `height` rows.
    ///
    /// # Errors
    /// Options out of their ranges.
    pub fn new(height: usize, options: TrackOptions) -> Result<Tracker, ImagingError> {
        let pitch = f64::from(options.pitch);
        ImagingError::unless((2.0..=1000.0).contains(&pitch), "pitch", "2 to 1000", pitch)?;
        for (name, reach) in [("new_reach", options.new_reach), ("known_reach", options.known_reach)] {
            ImagingError::unless((0.05..=2.0).contains(&reach), name, "0.05 to 2", f64::from(reach))?;
        }
        Ok(Tracker { options, rows: (0..height).map(|_| Vec::new()).collect(), down: 0, sliding: Sliding::default() })
    }

    /// By row: its tracks, ascending by column.
    pub fn rows(&self) -> &VecDeque<Vec<Track>> {
        &self.rows
    }

    /// By how many rows tracks have moved down from the picture before to the newest [px].
    pub fn down(&self) -> i32 {
        self.down
    }

    /// How edges are tracked.
    pub fn options(&self) -> &TrackOptions {
        &self.options
    }

    /// From one stripe to the next from now on, about [px].
    pub fn set_pitch(&mut self, pitch: f32) {
        if (2.0..=1000.0).contains(&pitch) {
            self.options.pitch = pitch;
        }
    }

    /// How far the surface goes through the stripes from picture to picture, one at most [stripes].
    fn lively(&self) -> f32 {
        self.sliding.stripes.abs().min(1.0)
    }

    /// Whether the surface goes through the stripes so fast that boundaries are given numbers sooner than they are borne out one by one.
    pub(super) fn is_fast(&self) -> bool {
        self.lively() >= FAST
    }

    /// How the surface went through the stripes up to the newest picture, as it was found when the next one was predicted.
    #[cfg(test)]
    pub(super) fn sliding(&self) -> Sliding {
        self.sliding
    }

    /// Forgets all tracks.
    pub fn reset(&mut self) {
        self.rows.iter_mut().for_each(Vec::clear);
        self.sliding = Sliding::default();
    }

    /// Predicts where all tracks are in the next picture, `pictures` after the last one, 1 unless some are missing.
    pub fn predict(&mut self, pictures: u32, shift: Shift<'_>) {
        let height = self.rows.len();
        self.slide(pictures);
        self.down = 0;
        let Some(middle) = self.rows.get(height / 2) else { return };
        let centre = middle.get(middle.len() / 2).map_or(0.0, |it| it.now.x);
        let down = shift(centre, height as f32 / 2.0)[1].round();
        if down.abs() < height as f32 {
            self.down = down as i32;
            for _ in 0..down.abs() as usize {
                let lost = if down > 0.0 { self.rows.pop_back() } else { self.rows.pop_front() };
                let empty = lost.map(|mut it| {
                    it.clear();
                    it
                });
                let empty = empty.unwrap_or_default();
                if down > 0.0 { self.rows.push_front(empty) } else { self.rows.push_back(empty) }
            }
        }
        for (y, row) in self.rows.iter_mut().enumerate() {
            for track in row.iter_mut() {
                let by = shift(track.now.x, y as f32)[0];
                track.earlier = track.before.filter(|_| pictures == 1);
                track.before = Some(track.now).filter(|_| pictures == 1);
                let x = track.now.x + by + track.velocity * pictures as f32;
                track.now = Place { x, sigma: f32::NAN, is_seen: false, shift: by };
            }
            row.sort_by(|a, b| a.now.x.total_cmp(&b.now.x));
        }
    }

    /// Velocities that tracks have next on a surface that goes through the stripes as it did.
    fn slide(&mut self, pictures: u32) {
        let rows = self.rows.make_contiguous();
        self.sliding = Sliding::of(rows, self.sliding);
        if pictures != 1 || self.sliding.stripes == 0.0 {
            return;
        }
        for row in rows.iter_mut() {
            let (profile, mut near) = (profile(row), 0);
            let is_seen = row.iter().filter(|it| is_in_profile(it)).map(|it| it.now.is_seen);
            let seen: Profile = profile.iter().zip(is_seen).filter(|it| it.1).map(|it| *it.0).collect();
            let mut places = profile.iter();
            for track in row.iter_mut() {
                near = left_of(&profile, near, track.now.x);
                let place = if is_in_profile(track) { places.next().map(|it| it.0) } else { None };
                // Where a ghost is, those around it that were seen say better than it was foretold.
                let next = place.filter(|_| !track.now.is_seen).and_then(|it| self.sliding.column(&seen, it));
                if let Some(next) = next {
                    track.velocity = next - track.now.x;
                } else if track.seen == 1 {
                    track.velocity = self.sliding.velocity(&profile, near, track.now.x).unwrap_or(track.velocity);
                } else if track.now.is_seen {
                    let most = self.options.known_reach * self.options.pitch;
                    let faster = self.sliding.faster(&profile, near, track.now.x).unwrap_or(0.0);
                    track.velocity += faster.clamp(-most, most);
                }
            }
        }
    }

    /// Moves all tracks by what they are off in common; between [`Self::predict`] and [`Self::agreement`]. Returns how far, in columns [px]; 0 where they do not say. How, tells `common`.
    pub fn align(&mut self, edges: &Edges, frame: usize) -> f32 {
        let rows = self.rows.iter().zip(&edges.rows).map(|(tracks, edges)| (tracks.as_slice(), edges.as_slice()));
        let Some(by) = common_shift(rows, frame, self.options.pitch) else { return 0.0 };
        for track in self.rows.iter_mut().flatten() {
            track.now.x += by;
            track.now.shift += by;
        }
        by
    }

    /// Takes up the edges of a picture that shows picture `frame` of the code.
    pub fn update(&mut self, edges: &Edges, frame: usize) {
        let options = self.options;
        let (lively, fast) = (self.lively(), self.is_fast());
        let per_thread = self.rows.len().div_ceil(options.threads.max(1)).max(1);
        let rows = self.rows.make_contiguous();
        std::thread::scope(|scope| {
            let mut parts = rows.chunks_mut(per_thread).zip(edges.rows.chunks(per_thread));
            let own = parts.next();
            let run = move |(rows, edges): (&mut [Vec<Track>], &[Vec<Edge>])| {
                let mut matcher = Matcher::new(lively);
                for (tracks, edges) in rows.iter_mut().zip(edges) {
                    matcher.row(tracks, edges, frame, &options);
                }
            };
            for part in parts {
                scope.spawn(move || run(part));
            }
            own.into_iter().for_each(run);
        });
        self.spread_velocities();
        for _ in 0..ADOPTIONS {
            adopt(self.rows.make_contiguous(), self.options.pitch, frame, fast);
        }
    }

    /// New tracks move as known ones of the rows beside do.
    fn spread_velocities(&mut self) {
        let reach = self.options.new_reach * self.options.pitch;
        let mut spread: Vec<(usize, f32)> = Vec::new();
        for y in 0..self.rows.len() {
            spread.clear();
            for (at, track) in self.rows[y].iter().enumerate().filter(|it| it.1.seen == 1) {
                let rows = (y.saturating_sub(BESIDE)..(y + BESIDE + 1).min(self.rows.len())).filter(|it| *it != y);
                let near = rows.filter_map(|it| nearest_known(&self.rows[it], track.now.x, reach));
                if let Some((_, velocity)) = near.min_by(|a, b| a.0.total_cmp(&b.0)) {
                    spread.push((at, velocity));
                }
            }
            for (at, velocity) in &spread {
                self.rows[y][*at].velocity = *velocity;
            }
        }
    }
}

/// How far the nearest track is whose boundary is known, and its velocity, within `reach` [px, px a picture].
fn nearest_known(tracks: &[Track], x: f32, reach: f32) -> Option<(f32, f32)> {
    let after = tracks.partition_point(|it| it.now.x < x);
    let near = tracks[after.saturating_sub(2)..(after + 2).min(tracks.len())].iter();
    let known = near.filter(|it| it.number().is_some() && it.now.is_seen);
    known.map(|it| ((it.now.x - x).abs(), it.velocity)).filter(|it| it.0 <= reach).min_by(|a, b| a.0.total_cmp(&b.0))
}

pub(super) fn look_of(edge: &Edge) -> Look {
    if edge.is_rising { Look::Rising } else { Look::Falling }
}

/// How wide stripes are about a column that is `near` in the profile of its row [px].
fn wide_here(profile: &Profile, near: usize, x: f32, pitch: f32) -> f32 {
    wide_beside(profile, near, x).map_or(pitch, |it| it.clamp(pitch, WIDEST * pitch))
}

/// How wide stripes are about each track of a row [px].
pub(super) fn widths(row: &[Track], pitch: f32) -> Vec<f32> {
    let (profile, mut near) = (profile(row), 0);
    let of = |it: &Track| {
        near = left_of(&profile, near, it.now.x);
        wide_here(&profile, near, it.now.x, pitch)
    };
    row.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::super::design::BoundaryCode;
    use super::in_order::{begin, see};
    use super::*;

    #[test]
    fn numbers_go_on_across_a_boundary_that_does_not_show() {
        let code = BoundaryCode::get();
        let seen_at = |x: f32, number: usize| {
            let is_rising = code.look(number, 0) == Look::Rising;
            Track { seen: 2, ..begin(&Edge { x, is_rising, sigma: 0.1 }, 0.0, 0) }
        };
        // One that shows, one that does not, and one that shows again.
        let shows = |it: usize| code.look(it, 0).shows();
        let first = (0..code.len() - 2).find(|it| shows(*it) && !shows(it + 1) && shows(it + 2)).unwrap_or(0);
        for (away, found) in [(16.0, Some(first + 2)), (40.0, None)] {
            let known = Track { run: PROVEN, possible: 1 << first, ..seen_at(50.0, first) };
            let mut rows = vec![vec![known, seen_at(50.0 + away, first + 2)]; 3];
            adopt(&mut rows, 8.0, 0, false);
            assert_eq!(rows[1][1].number(), found, "{away} px away");
        }
    }

    #[test]
    fn sides_on_which_light_was_seen_are_known_for_four_pictures() {
        let edge = |is_rising: bool| Edge { x: 50.0, is_rising, sigma: 0.1 };
        let mut track = begin(&edge(false), 0.0, 0);
        for frame in 1..9 {
            see(&mut track, &edge(false), frame);
            assert_eq!(track.is_lit(), [true, false], "light ends there");
        }
        see(&mut track, &edge(true), 9);
        assert_eq!(track.is_lit(), [true, true]);
        for frame in 10..13 {
            see(&mut track, &edge(true), frame);
        }
        assert_eq!(track.is_lit(), [false, true], "as long as the code is since it was lit on its left");
        // A ghost between lit stripes: light on both sides, unless light ends right there.
        let lit = |at: usize| BoundaryCode::get().look(at, 13) == Look::Lit;
        let number = (0..BoundaryCode::get().len()).find(|it| lit(*it)).unwrap_or(0);
        for (ends_there, is_lit) in [(false, [true, true]), (true, [false, true])] {
            let mut tracks = vec![Track { possible: 1 << number, run: PROVEN, now: track.now, ..track.clone() }];
            tracks[0].now.x = 50.0;
            let around = [(30.0, true), (70.0, false)].map(|(x, is_rising)| Edge { x, is_rising, sigma: 0.1 });
            let mut edges = around.to_vec();
            if ends_there {
                edges.splice(1..1, [edge(false)]);
            }
            Matcher::default().row(&mut tracks, &edges, 13, &TrackOptions::default());
            let ghost = tracks.iter().find(|it| it.number() == Some(number));
            assert_eq!(ghost.map(Track::is_lit), Some(is_lit), "{ends_there}");
        }
    }
}
