//! What changes while a run goes on: time, edges, faults.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use foveate_engine::{EdgeView, Progress};
use foveate_messages::Time;
use serde_json::{Value, json};

/// Faults that a page shows.
const SHOWN_FAULTS: usize = 100;
/// The speed is that of so long.
const SPEED_SPAN: Duration = Duration::from_secs(2);

/// The state of a run as its program knows it.
#[derive(Default)]
pub(crate) struct State {
    pub progress: Option<Progress>,
    pub is_finished: bool,
    /// What else the program shows, by name, with the number of its last change.
    pub sheets: BTreeMap<String, (u64, String)>,
    faults: VecDeque<Value>,
    n_faults: u64,
    /// Wall time and session time [s] of recent progress.
    recent: VecDeque<(Duration, f64)>,
}

/// What the console adds to the state.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct About {
    /// People let it wait.
    pub is_held: bool,
    /// Windows that are open.
    pub viewers: usize,
    /// Settings that the rig file does not have yet.
    pub unsaved: Vec<String>,
    /// The file that is being recorded.
    pub recording: Option<String>,
    /// Of a session: first and last moment, the part that is repeated, and the speed.
    pub playing: Option<([Time; 2], Option<[Time; 2]>, f64)>,
}

impl State {
    /// The run has come so far.
    pub(crate) fn advance(&mut self, progress: &Progress) {
        self.recent.push_back((progress.wall, progress.now.as_s()));
        while self.recent.len() > 2 && progress.wall.saturating_sub(self.recent[0].0) > SPEED_SPAN {
            self.recent.pop_front();
        }
        self.progress = Some(progress.clone());
    }

    /// Shows `value` under `name` from now on.
    pub(crate) fn show(&mut self, name: &str, value: &Value) {
        let message = json!({ "say": "sheet", "name": name, "value": value }).to_string();
        let sheet = self.sheets.entry(name.to_owned()).or_default();
        *sheet = (sheet.0 + 1, message);
    }

    /// Something failed at a node.
    pub(crate) fn fail(&mut self, who: &str, what: &str) {
        self.n_faults += 1;
        if self.faults.len() == SHOWN_FAULTS {
            self.faults.pop_front();
        }
        let at_s = self.progress.as_ref().map(|it| it.now.as_s());
        self.faults.push_back(json!({ "who": who, "what": what, "at_s": at_s }));
    }

    /// Session seconds in a second on the wall.
    fn speed(&self) -> Option<f64> {
        let (first, last) = (self.recent.front()?, self.recent.back()?);
        let wall = (last.0 - first.0).as_secs_f64();
        (wall > 0.0).then(|| (last.1 - first.1) / wall)
    }

    /// The message for pages.
    pub(crate) fn message(&self, about: &About) -> String {
        let phase = match &self.progress {
            _ if self.is_finished => "finished",
            None => "starting",
            Some(_) if about.is_held => "paused",
            Some(_) => "running",
        };
        let (now_s, wall_s) = match &self.progress {
            Some(it) => (Some(it.now.as_s()), Some(rounded(it.wall.as_secs_f64(), 3))),
            None => (None, None),
        };
        let of_edge = if about.playing.is_some() { recorded_edge } else { edge };
        let edges: Vec<Value> = self.progress.iter().flat_map(|it| &it.edges).map(of_edge).collect();
        let in_s = |it: [Time; 2]| it.map(Time::as_s);
        let recording = about.recording.as_ref().map(|it| json!({ "path": it }));
        let speed = about.playing.map(|it| it.2).or_else(|| self.speed());
        json!({
            "say": "state", "phase": phase, "now_s": now_s, "wall_s": wall_s, "speed": speed.map(|it| rounded(it, 3)), "viewers": about.viewers,
            "edges": edges, "faults": self.faults, "n_faults": self.n_faults, "recording": recording, "unsaved": about.unsaved,
            "span_s": about.playing.map(|it| in_s(it.0)), "loop": about.playing.and_then(|it| it.1).map(in_s),
        })
        .to_string()
    }
}

/// Of a recording: how many and how often; the rest was not written down.
fn recorded_edge(it: &EdgeView) -> Value {
    json!([it.delivered, it.rate_hz.map(|it| rounded(it, 2)), null, 0, null, null, null, null, null, null])
}

/// Locks what the program and the console's thread share.
pub(crate) fn lock<T>(it: &Mutex<T>) -> MutexGuard<'_, T> {
    it.lock().unwrap_or_else(PoisonError::into_inner)
}

fn edge(it: &EdgeView) -> Value {
    let age = |place: usize| it.age_s.map(|it| rounded(it[place] * 1e3, 3));
    json!([
        it.delivered,
        it.rate_hz.map(|it| rounded(it, 2)),
        it.count,
        u8::from(it.unmet),
        it.gaps,
        it.dropped,
        it.late,
        age(0),
        age(1),
        age(2)
    ])
}

fn rounded(it: f64, digits: i32) -> f64 {
    let unit = 10_f64.powi(digits);
    (it * unit).round() / unit
}

#[cfg(test)]
mod tests {
    use super::*;

    fn progress(wall_ms: u64, now_ms: i64) -> Progress {
        let edge = EdgeView { delivered: 7, age_s: Some([0.001, 0.0025, 1.0]), unmet: true, ..EdgeView::default() };
        Progress { now: Time(now_ms * 1_000_000), wall: Duration::from_millis(wall_ms), edges: vec![edge] }
    }

    #[test]
    fn the_speed_is_that_of_the_last_seconds() {
        let mut state = State::default();
        for (wall, now) in [(0, 0), (1000, 100), (2000, 200), (3000, 1200), (4000, 2200), (5000, 3200)] {
            state.advance(&progress(wall, now));
        }
        let message: Value = serde_json::from_str(&state.message(&About::default())).unwrap();
        assert_eq!((message["speed"].as_f64(), message["phase"].as_str()), (Some(1.0), Some("running")));
        assert_eq!(message["edges"], json!([[7, null, null, 1, 0, 0, 0, 1.0, 2.5, 1000.0]]));
    }

    #[test]
    fn faults_are_counted_and_the_last_ones_shown() {
        let mut state = State::default();
        let about = About { is_held: true, unsaved: vec!["room.leds.offset".to_owned()], ..About::default() };
        (0..SHOWN_FAULTS + 5).for_each(|it| state.fail("room.leds", &it.to_string()));
        let message: Value = serde_json::from_str(&state.message(&about)).unwrap();
        assert_eq!(message["phase"], "starting");
        assert_eq!((message["n_faults"].as_u64(), message["faults"].as_array().unwrap().len()), (Some(105), 100));
        assert_eq!(message["faults"][99]["what"], "104");
        assert_eq!(message["unsaved"], json!(["room.leds.offset"]));
    }
}
