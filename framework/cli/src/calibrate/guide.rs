//! Shows on the terminal, while the light is waved, where it has been and where it is needed.

use std::io::{IsTerminal, Write};
use std::sync::PoisonError;
use std::time::{Duration, Instant};

use foveate_engine::Progress;
use foveate_rig::graph::Graph;

use super::boards::of_board;
use super::recorder::Shared;
use crate::output::wants_color;

/// Judging what is missing takes long enough not to do it at each progress.
const PERIOD: Duration = Duration::from_millis(500);
/// Without a terminal, one line after this time.
const PLAIN_PERIOD: Duration = Duration::from_secs(5);
/// Columns and rows of a terminal that does not say.
const SIZE: [usize; 2] = [100, 24];
/// In place of what does not fit, in one row.
const MORE: &str = "… more in a larger terminal";

/// Draws over what it drew before, on standard error.
pub struct Guide {
    duration_s: Option<f64>,
    is_live: bool,
    is_terminal: bool,
    /// Whether what is seen is a board rather than a light.
    is_board: bool,
    last: Option<Instant>,
    /// Lines of the last drawing.
    lines: usize,
    enough: bool,
    last_judged: Option<Instant>,
}

impl Guide {
    /// For a run of `graph`.
    pub fn new(graph: &Graph, is_live: bool, is_board: bool) -> Guide {
        let duration_s = graph.duration.map(|it| it.as_s());
        let is_terminal = std::io::stderr().is_terminal();
        Guide { duration_s, is_live, is_terminal, is_board, last: None, lines: 0, enough: false, last_judged: None }
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
        let size = terminal_size();
        let mut text = coverage.render(size[0], wants_color());
        if self.is_board {
            text = of_board(&text);
        }
        text += &format!("{now:.1}{whole} s");
        text += if self.is_live { "   Ctrl-C ends the capture and calibrates\n" } else { "\n" };
        // A terminal that was made smaller since has lost the rest.
        let drawn = self.lines.min(size[1].saturating_sub(1));
        let up = if drawn > 0 { format!("\x1b[{drawn}A\x1b[J") } else { String::new() };
        (text, self.lines) = fitting(&text, size);
        drop(err.write_all(format!("{up}{text}").as_bytes()).and_then(|()| err.flush()));
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
        self.lines = 0;
    }
}

/// As much of the end of `text`, where the advice stands, as can be drawn over again, and its rows: what has left a terminal at its top
/// stays there.
fn fitting(text: &str, [columns, rows]: [usize; 2]) -> (String, usize) {
    let rows_of = |line: &str| visible(line).div_ceil(columns.max(1)).max(1);
    // The cursor comes to stand on a row of its own.
    let network = rows.saturating_sub(1).max(1);
    let all: usize = text.lines().map(rows_of).sum();
    if all <= network {
        return (text.to_owned(), all);
    }
    let mut used = 1;
    let fits = |line: &&str| {
        used += rows_of(line);
        used <= network
    };
    let mut kept: Vec<&str> = text.lines().rev().take_while(fits).collect();
    kept.push(if visible(MORE) <= columns { MORE } else { "…" });
    kept.reverse();
    let n_rows = kept.iter().map(|it| rows_of(it)).sum();
    (kept.iter().map(|it| format!("{it}\n")).collect(), n_rows)
}

/// Characters of `line` without its colours.
fn visible(line: &str) -> usize {
    let mut parts = line.split('\x1b');
    let first = parts.next().map_or(0, |it| it.chars().count());
    first + parts.map(|it| it.split_once('m').map_or(0, |it| it.1.chars().count())).sum::<usize>()
}

/// Columns and rows of the terminal on standard error.
fn terminal_size() -> [usize; 2] {
    let said = |name: &str| std::env::var(name).ok().and_then(|it| it.parse().ok()).unwrap_or(0);
    let (found, said) = (asked_size(), [said("COLUMNS"), said("LINES")]);
    [0, 1].map(|it| [found[it], said[it], SIZE[it]].into_iter().find(|n| *n > 0).unwrap_or(1))
}

/// As the terminal says, zeros where it does not.
#[cfg(unix)]
fn asked_size() -> [usize; 2] {
    let size = rustix::termios::tcgetwinsize(std::io::stderr());
    size.map_or([0; 2], |it| [it.ws_col, it.ws_row].map(usize::from))
}

/// Zeros: it cannot be asked here.
#[cfg(not(unix))]
fn asked_size() -> [usize; 2] {
    [0; 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_more_is_drawn_than_fits() {
        let text = "one\ntwo\n\x1b[31mthree\x1b[0m, \x1b[1mfour\x1b[0m\nfive\n";
        assert_eq!(visible("\x1b[31mthree\x1b[0m, \x1b[1mfour\x1b[0m"), 11);
        assert_eq!(fitting(text, [80, 5]), (text.to_owned(), 4));
        assert_eq!(fitting(text, [11, 5]).1, 4);
        let (drawn, rows) = fitting(text, [80, 4]);
        assert_eq!((drawn.lines().count(), rows), (3, 3));
        assert!(drawn.ends_with("four\x1b[0m\nfive\n") && !drawn.contains("two"), "{drawn}");
        // Lines that are wider than the terminal take several of its rows.
        let (drawn, rows) = fitting(text, [10, 5]);
        assert!(drawn.ends_with("\nfive\n") && rows <= 4, "{drawn}");
        assert_eq!(fitting("", [80, 24]), (String::new(), 0));
    }
}
