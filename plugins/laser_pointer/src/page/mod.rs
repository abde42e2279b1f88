//! `laser_pointer.page`: a page that people draw on: live strokes, predicted pointers, a colour for each, and their latency.
//!
//! The page is served by the program, works without any other network, and may be open in many windows. The same link serves other programs: what is sent is JSON
//! over a WebSocket (`ws://ADDRESS/socket`, docs/laser-pointers.md).
//!
//! A window gets at most `rate_hz` messages a second, each with the newest state and all ink since the last one. A window that confirms what it has shown is never more
//! than six messages behind: while it stalls nothing is sent, and afterwards it gets everything missed at once. What people do on the page (clear it)
//! stays on the page: nothing of it enters the run, so this node works in repeatable runs, too.

mod board;
mod windows;

use std::sync::Arc;

use foveate::node::page::{Page, PageLink, PageNews};
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::board::Board;
use self::windows::Windows;
use crate::wall::Wall;

ports! {
    POINTERS: In<Pointers> = each("pointers");
}

figures! {
    "page.strokes": count, neither, "Strokes begun on the page";
    "page.windows": count, neither, "Windows in which the page was opened; missing without any window, as are the figures below";
        "page.sent": count, neither, "Messages sent to all windows";
        "page.held_back": count, low, "Messages not sent because a window had not shown those before, over all windows";
        "page.refused": count, low, "Messages of windows that are not of this page";
    "page.drawn_ms.{p50,p99}": ms, low, "From an event of the run to the frame of the window that shows it, as windows report by the server's clock";
}

/// The page.
const HTML: &str = include_str!("page.html");
/// Messages that a window may not have confirmed when the next one is sent: a tenth of a second at 60 Hz, as much as a wireless link may delay.
const MOST_UNSEEN: u64 = 6;

/// Settings of [`DrawingPage`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PageSettings {
    /// Most messages per window and second of wall-clock time [Hz]
    #[schemars(range(min = 1.0, max = 240.0))]
    pub rate_hz: f64,
    /// Points of strokes that stay on the page; beyond that the oldest are removed [–]
    #[schemars(range(min = 100, max = 100000))]
    pub most_points: usize,
    /// Shortest distance between two points of a stroke [mm]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub step_mm: f64,
}

impl Default for PageSettings {
    fn default() -> Self {
        Self { rate_hz: 60.0, most_points: 20_000, step_mm: 2.0 }
    }
}

/// A page that people draw on.
pub struct DrawingPage {
    /// None while the node is only checked, or where the run serves no pages.
    link: Option<Box<dyn PageLink>>,
    wall: Wall,
    board: Board,
    windows: Windows,
}

impl Node for DrawingPage {
    const TYPE: &'static str = "laser_pointer.page";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Shows strokes in browsers, and sends them to programs as JSON over a WebSocket";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = PageSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: PageSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("rate_hz", settings.rate_hz, 1.0..=240.0)?;
        ConfigError::unless_in("most_points", settings.most_points, 100..=100_000)?;
        ConfigError::unless_in("step_mm", settings.step_mm, 0.0..=1000.0)?;
        let wall = Wall::of(setup)?;
        let mut link = None;
        if setup.purpose == Purpose::Run {
            let page = Page { html: HTML, files: Arc::new(|_| None) };
            link = setup.pages.open(&setup.instance, page).map_err(ConfigError::node)?;
        }
        if let Some(link) = &mut link {
            link.greet(&board::greeting(&wall, None));
        }
        let board = Board::new(settings.most_points, settings.step_mm * 1e-3);
        Ok(Self { link, wall, board, windows: Windows::new(settings.rate_hz) })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(Stamped { value: pointers, .. }) = io.take(&POINTERS) else { return Ok(()) };
        if let Some(link) = &mut self.link {
            receive(&mut **link, &mut self.windows, &mut self.board);
        }
        self.board.take(&self.wall, &pointers);
        if let Some(link) = &mut self.link {
            let latency_ms = (io.now() - pointers.time).as_ms();
            self.windows.send(&mut **link, &self.board, &pointers, &self.wall, latency_ms);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        if let Some(link) = &mut self.link {
            link.greet(&board::greeting(&self.wall, Some(&self.board)));
            self.windows.farewell(&mut **link, &self.board);
        }
        report.figure("page.strokes", self.board.n_strokes() as f64);
        self.windows.report(report);
        Ok(())
    }
}

/// Takes in the windows' messages since the last time.
fn receive(link: &mut dyn PageLink, windows: &mut Windows, board: &mut Board) {
    while let Some(event) = link.take() {
        match event.what {
            PageNews::Opened => windows.opened(event.client),
            PageNews::Closed(_) => windows.closed(event.client),
            PageNews::Text(text) => {
                if windows.receive(event.client, &text) {
                    board.clear();
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
