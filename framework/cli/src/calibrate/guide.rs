//! Shows on the terminal, while the light is waved, where it has been and where it is needed.

use std::io::{IsTerminal, Write};
use std::sync::PoisonError;
use std::time::{Duration, Instant};

use foveate_engine::Progress;
use foveate_rig::graph::Graph;

use super::boards::of_board;
use super::recorder::Shared;
use crate::output::wants_color;
use crate::terminal::{self, Drawing};

/// Judging what is missing takes long enough not to do it at each progress.
const PERIOD: Duration = Duration::from_millis(500);
/// Without a terminal, one line after this time.
const PLAIN_PERIOD: Duration = Duration::from_secs(5);

/// Draws over what it drew before, on standard error.
pub struct Guide {
    duration_s: Option<f64>,
    is_live: bool,
    is_terminal: bool,
    /// Whether what is seen is a board rather than a light.
    is_board: bool,
    last: Option<Instant>,
    drawing: Drawing,
    enough: bool,
    last_judged: Option<Instant>,
}

impl Guide {
    /// For a run of `graph`.
    pub fn new(graph: &Graph, is_live: bool, is_board: bool) -> Guide {
        let duration_s = graph.duration.map(|it| it.as_s());
        let is_terminal = std::io::stderr().is_terminal();
        Guide {
            duration_s,
            is_live,
            is_terminal,
            is_board,
            last: None,
            drawing: Drawing::default(),
            enough: false,
            last_judged: None,
        }
    }

    /// Draws, if it is time to.
    pub fn show(&mut self, progress: &Progress, shared: &Shared) {
        let period = if self.is_terminal { PERIOD } else { PLAIN_PERIOD };
        if progress.now.as_s() <= 0.0 {
            return;
        }
        if self.last.is_some_and(|it| it.elapsed() < period) {
            return;
        }
        self.last = Some(Instant::now());
        let coverage = shared.lock().unwrap_or_else(PoisonError::into_inner).coverage.clone();
        let now = progress.now.as_s();
        let whole = self.duration_s.map_or(String::new(), |it| format!(" of {it}"));
        let mut err = std::io::stderr().lock();
        // A board that was recorded has the views that it has: the verdict says what they lack.
        let is_recorded_board = self.is_board && !self.is_live;
        if !self.is_terminal || is_recorded_board {
            let frames: u32 = (0..coverage.n_cameras()).map(|it| coverage.frames(it)).min().unwrap_or(0);
            if is_recorded_board {
                drop(writeln!(err, "{now:7.1}{whole} s   each camera saw the board in {frames} views or more"));
                return;
            }
            let state = coverage.state();
            let advice = state.missing.first().map_or_else(|| "enough".to_owned(), |it| it.to_string());
            let advice = if self.is_board { of_board(&advice) } else { advice };
            drop(writeln!(err, "{now:7.1}{whole} s   each camera saw it in {frames} frames or more   {advice}"));
            return;
        }
        let size = terminal::size();
        let mut text = coverage.render(size[0], wants_color());
        if self.is_board {
            text = of_board(&text);
        }
        text += &format!("{now:.1}{whole} s");
        text += if self.is_live { "   Ctrl-C ends the capture and calibrates\n" } else { "\n" };
        drop(err.write_all(self.drawing.over(&text, size).as_bytes()).and_then(|()| err.flush()));
    }

    /// Whether coverage suffices.
    pub fn is_enough(&mut self, shared: &Shared) -> bool {
        if self.last_judged.is_none_or(|it| it.elapsed() >= PERIOD) {
            self.last_judged = Some(Instant::now());
            let coverage = shared.lock().unwrap_or_else(PoisonError::into_inner).coverage.clone();
            self.enough = coverage.state().enough;
        }
        self.enough
    }

    /// Leaves the last drawing where it is.
    pub fn end(&mut self) {
        self.drawing = Drawing::default();
    }
}
