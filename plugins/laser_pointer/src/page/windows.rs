//! The windows in which the page is open, with what each has received and shown.

use std::collections::BTreeMap;

use foveate::estimation::statistics::percentile;
use foveate::node::page::{Client, PageLink};
use foveate::prelude::*;
use serde::{Deserialize, Serialize};

use super::MOST_UNSEEN;
use super::board::{Board, Ink, Owner, Told, on_page, tenth};
use crate::wall::Wall;

/// Most points in one message: a window that opens late gets the ink in several.
const MOST_INK: usize = 2000;
/// Most events in one message.
const MOST_EVENTS: usize = 64;
/// Kept display latencies of windows.
const MOST_DRAWN: usize = 1 << 14;

/// A message to a window.
#[derive(Serialize)]
struct Message<'a> {
    /// Number of the message to this window.
    seq: u64,
    /// Changes when everything drawn before is removed.
    epoch: u64,
    /// Session time of the state [s].
    time: f64,
    /// The server's clock [ms].
    sent: f64,
    /// From capture to this message [ms].
    latency_ms: f64,
    pointers: &'a [Shown],
    ink: Vec<&'a Ink>,
    /// Users of pointers that became known since the last message.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    users: Vec<&'a Owner>,
    events: Vec<&'a Told>,
}

/// A pointer on the page.
#[derive(Serialize)]
struct Shown {
    id: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    user: Option<u32>,
    /// Predicted place when people see it, from the wall's top left corner [m].
    x: f64,
    y: f64,
    pressed: bool,
    resting: bool,
    /// Standard deviation of its position [mm].
    sigma_mm: f64,
}

/// Messages of a window.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "lowercase")]
enum Said {
    /// It has drawn the message of that number, with the delay after sending where known [ms].
    Seen(u64, Option<f64>),
    /// A request to clear the page in all windows.
    Clear(bool),
}

/// One window.
#[derive(Default)]
struct Window {
    sent: u64,
    /// None until the window has sent what it has seen; a program that only listens never does.
    seen: Option<u64>,
    next_ink: u64,
    next_event: u64,
    next_owner: u64,
    last: Option<i64>,
}

/// All windows.
pub(super) struct Windows {
    open: BTreeMap<Client, Window>,
    period_ns: i64,
    n_opened: u64,
    n_sent: u64,
    n_held_back: u64,
    n_refused: u64,
    drawn_ms: Vec<f64>,
    fault: Option<String>,
}

impl Windows {
    /// Windows that get at most `rate_hz` messages a second each.
    pub(super) fn new(rate_hz: f64) -> Windows {
        let period_ns = Interval::from_s(1.0 / rate_hz).0;
        Windows {
            open: BTreeMap::new(),
            period_ns,
            n_opened: 0,
            n_sent: 0,
            n_held_back: 0,
            n_refused: 0,
            drawn_ms: Vec::new(),
            fault: None,
        }
    }

    pub(super) fn opened(&mut self, client: Client) {
        self.n_opened += 1;
        self.open.insert(client, Window::default());
    }

    pub(super) fn closed(&mut self, client: Client) {
        self.open.remove(&client);
    }

    /// Takes in a window's message; returns whether the page is to be cleared.
    pub(super) fn receive(&mut self, client: Client, text: &str) -> bool {
        let Some(window) = self.open.get_mut(&client) else { return false };
        match serde_json::from_str(text) {
            // Nobody has seen what was not sent.
            Ok(Said::Seen(number, drawn_ms)) if number <= window.sent => {
                window.seen = window.seen.max(Some(number));
                let is_time = |it: &f64| it.is_finite() && (0.0..60_000.0).contains(it);
                if self.drawn_ms.len() < MOST_DRAWN {
                    self.drawn_ms.extend(drawn_ms.filter(is_time));
                }
                false
            }
            Ok(Said::Clear(is_wanted)) => is_wanted,
            found => {
                self.n_refused += 1;
                let why = found.err().map_or("it confirms a message that was not sent".to_owned(), |it| it.to_string());
                let start: String = text.chars().take(60).collect();
                self.fault.get_or_insert_with(|| format!("a window sent `{start}`: {why}"));
                false
            }
        }
    }

    /// Sends the newest state to each window that is due.
    pub(super) fn send(
        &mut self,
        link: &mut dyn PageLink,
        board: &Board,
        pointers: &Pointers,
        wall: &Wall,
        latency_ms: f64,
    ) {
        let now = link.now();
        let shown: Vec<Shown> = pointers.list.iter().map(|it| shown(wall, it)).collect();
        for (client, window) in &mut self.open {
            if window.last.is_some_and(|it| now - it < self.period_ns) {
                continue;
            }
            if window.seen.is_some_and(|it| window.sent - it >= MOST_UNSEEN) {
                self.n_held_back += 1;
                continue;
            }
            let (ink, next_ink) = board.ink.since(window.next_ink, MOST_INK);
            let (events, next_event) = board.events.since(window.next_event, MOST_EVENTS);
            let (users, next_owner) = board.owners.since(window.next_owner, usize::MAX);
            let message = Message {
                seq: window.sent + 1,
                epoch: board.epoch,
                time: pointers.time.as_s(),
                sent: now as f64 * 1e-6,
                latency_ms: tenth(latency_ms),
                pointers: &shown,
                ink: ink.collect(),
                users: users.collect(),
                events: events.collect(),
            };
            window.last = Some(now);
            let Ok(text) = serde_json::to_string(&message) else { continue };
            if link.send(*client, &text) {
                window.sent += 1;
                (window.next_ink, window.next_event, window.next_owner) = (next_ink, next_event, next_owner);
                self.n_sent += 1;
            } else {
                self.n_held_back += 1;
            }
        }
    }

    /// Sends the last ink to every window at the end of the run.
    pub(super) fn farewell(&mut self, link: &mut dyn PageLink, board: &Board) {
        for (client, window) in &mut self.open {
            let (ink, _) = board.ink.since(window.next_ink, usize::MAX);
            let ink: Vec<&Ink> = ink.collect();
            let text = serde_json::json!({ "epoch": board.epoch, "ink": ink, "over": "The run is over." });
            link.send(*client, &text.to_string());
        }
    }

    /// Reports the windows; a run without any window has no such figures.
    pub(super) fn report(&self, report: &mut Report) {
        if self.n_opened == 0 {
            return;
        }
        report.figure("page.windows", self.n_opened as f64);
        report.figure("page.sent", self.n_sent as f64);
        report.figure("page.held_back", self.n_held_back as f64);
        report.figure("page.refused", self.n_refused as f64);
        for (name, percent) in [("p50", 50.0), ("p99", 99.0)] {
            report.figure(format!("page.drawn_ms.{name}"), percentile(&self.drawn_ms, percent).unwrap_or(f64::NAN));
        }
        if let Some(fault) = &self.fault {
            report.remark(format!("{} messages of windows were invalid; the first: {fault}", self.n_refused));
        }
    }
}

fn shown(wall: &Wall, pointer: &Pointer) -> Shown {
    let [x, y] = on_page(wall, pointer.predicted);
    let (pressed, resting) = (pointer.is_pressed, pointer.is_resting);
    Shown { id: pointer.id.0, user: pointer.user, x, y, pressed, resting, sigma_mm: tenth(pointer.sigma * 1e3) }
}
