//! Where the light has been and where it is wanted, on the terminal while it is waved.

use std::io::{IsTerminal, Write};
use std::sync::PoisonError;
use std::time::{Duration, Instant};

use foveate_dataflow::graph::Graph;
use foveate_dataflow::run::Progress;

use super::recorder::Shared;
use crate::output::wants_color;

/// Judging what is missing takes long enough not to do it at each progress.
const PERIOD: Duration = Duration::from_millis(500);
/// Where nobody watches a terminal, one line in so long.
const PLAIN_PERIOD: Duration = Duration::from_secs(5);
/// Columns of a terminal that does not say.
const WIDTH: usize = 100;

/// Draws over what it drew before, on standard error.
pub struct Guide {
    duration_s: Option<f64>,
    is_live: bool,
    is_terminal: bool,
    last: Option<Instant>,
    /// Lines of the last drawing.
    lines: usize,
    enough: bool,
    last_judged: Option<Instant>,
}

impl Guide {
    /// For a run of `graph`.
    pub fn new(graph: &Graph, is_live: bool) -> Guide {
        let duration_s = graph.duration.map(|it| it.as_s());
        let is_terminal = std::io::stderr().is_terminal();
        Guide { duration_s, is_live, is_terminal, last: None, lines: 0, enough: false, last_judged: None }
    }

    /// Draws, if it is time to.
    pub fn show(&mut self, progress: &Progress, shared: &Shared) {
        let period = if self.is_terminal { PERIOD } else { PLAIN_PERIOD };
        if self.last.is_some_and(|it| it.elapsed() < period) {
            return;
        }
        self.last = Some(Instant::now());
        let coverage = shared.lock().unwrap_or_else(PoisonError::into_inner).coverage.clone();
        let now = progress.now.as_s();
        let whole = self.duration_s.map_or(String::new(), |it| format!(" of {it:.0}"));
        let mut err = std::io::stderr().lock();
        if !self.is_terminal {
            let frames: u32 = (0..coverage.n_cameras()).map(|it| coverage.frames(it)).min().unwrap_or(0);
            let state = coverage.state();
            let advice = state.missing.first().map_or_else(|| "enough".to_owned(), |it| it.to_string());
            drop(writeln!(err, "{now:7.1}{whole} s   each camera saw it in {frames} frames or more   {advice}"));
            return;
        }
        let mut text = coverage.render(width(), wants_color());
        text += &format!("{now:.1}{whole} s");
        text += if self.is_live { "   Ctrl-C ends the capture and calibrates\n" } else { "\n" };
        let up = if self.lines > 0 { format!("\x1b[{}A\x1b[J", self.lines) } else { String::new() };
        self.lines = text.lines().count();
        drop(err.write_all(format!("{up}{text}").as_bytes()).and_then(|()| err.flush()));
    }

    /// Whether what was seen is enough.
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
        self.lines = 0;
    }
}

fn width() -> usize {
    std::env::var("COLUMNS").ok().and_then(|it| it.parse().ok()).unwrap_or(WIDTH)
}
