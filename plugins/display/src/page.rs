//! `display.page`: a page for one tile, which draws a box behind the display in the perspective of the viewer's eye.
//!
//! Each page gets the matrices of its tile with the moment at which they are to be seen, on the server's clock, and shows in each frame those that are nearest to the
//! moment of that frame: pages on several computers show the same moment. A window is never more than twelve messages behind; while it stalls, nothing is sent.
//! Nothing that a page sends enters the run.

use std::collections::BTreeMap;
use std::sync::Arc;

use foveate::node::page::{Client, Page, PageLink, PageNews};
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

ports! {
    VIEWS: In<Views> = each("views");
}

figures! {
    "tile.windows.*": count, neither, "Windows in which the tile's page was opened; missing without any window, as are the figures below";
        "tile.sent.*": count, neither, "Messages sent to all windows";
        "tile.held_back.*": count, low, "Messages not sent because the window had not shown those before";
        "tile.refused.*": count, low, "Messages of windows that are not of this page";
}

/// The page.
const HTML: &str = include_str!("page/page.html");
/// Messages that a window may not have seen yet when the next one is sent: a tenth of a second at 120 Hz.
const MOST_UNSEEN: u64 = 12;

/// Settings of [`TilePage`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TilePageSettings {
    /// Name of the tile among those of the viewer [–]
    pub tile: String,
    /// Most messages per window and second of wall-clock time [Hz]
    #[schemars(range(min = 1.0, max = 240.0))]
    pub rate_hz: f64,
    /// Depth of the box behind the display [m]
    #[schemars(range(min = 0.05, max = 100.0))]
    pub depth_m: f64,
}

impl Default for TilePageSettings {
    fn default() -> Self {
        Self { tile: String::new(), rate_hz: 120.0, depth_m: 1.0 }
    }
}

/// A page for one tile.
pub struct TilePage {
    settings: TilePageSettings,
    link: Option<Box<dyn PageLink>>,
    windows: BTreeMap<Client, Window>,
    /// Names of tiles that came, where this one's was not among them.
    others: Option<String>,
    n_opened: u64,
    n_sent: u64,
    n_held_back: u64,
    n_refused: u64,
}

#[derive(Default)]
struct Window {
    sent: u64,
    /// None until the window has sent what it has seen; a program that only listens never does.
    seen: Option<u64>,
    last: Option<i64>,
}

/// Messages of a window.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Said {
    seen: u64,
}

impl Node for TilePage {
    const TYPE: &'static str = "display.page";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str =
        "Serves the page of one display tile, which draws a box behind it for the viewer's eye";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = TilePageSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: TilePageSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("rate_hz", settings.rate_hz, 1.0..=240.0)?;
        ConfigError::unless_in("depth_m", settings.depth_m, 0.05..=100.0)?;
        if settings.tile.is_empty() {
            return Err(ConfigError::at("tile", "found no name, expected the name of a tile of the viewer"));
        }
        setup.refer("tile", "tile", &settings.tile);
        let mut link = None;
        if setup.purpose == Purpose::Run {
            let page = Page { html: HTML, files: Arc::new(|_| None) };
            link = setup.pages.open(&setup.instance, page).map_err(ConfigError::node)?;
        }
        if let Some(link) = &mut link {
            link.greet(&json!({ "tile": settings.tile, "depth": settings.depth_m }).to_string());
        }
        let (windows, others) = (BTreeMap::new(), None);
        Ok(Self { settings, link, windows, others, n_opened: 0, n_sent: 0, n_held_back: 0, n_refused: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(Stamped { value: views, .. }) = io.take(&VIEWS) else { return Ok(()) };
        let Some(tile) = views.tiles.iter().find(|it| it.name == self.settings.tile) else {
            let names: Vec<&str> = views.tiles.iter().map(|it| it.name.as_str()).collect();
            self.others.get_or_insert_with(|| names.join(", "));
            return Ok(());
        };
        self.receive();
        let now = io.now();
        if let Some(mut link) = self.link.take() {
            self.send(&mut *link, now, &views, tile);
            self.link = Some(link);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let tile = &self.settings.tile;
        if let Some(link) = &mut self.link {
            let over = json!({ "tile": tile, "depth": self.settings.depth_m, "over": "The run is over." }).to_string();
            link.greet(&over);
            for client in self.windows.keys() {
                // A window that is gone is not told.
                link.send(*client, &over);
            }
        }
        if let Some(others) = &self.others {
            report.remark(format!("found no tile `{tile}` among those of the viewer: {others}"));
        }
        // A run that nobody watched has no figures of windows.
        if self.n_opened > 0 {
            let figures = [
                ("windows", self.n_opened),
                ("sent", self.n_sent),
                ("held_back", self.n_held_back),
                ("refused", self.n_refused),
            ];
            figures.iter().for_each(|(name, n)| report.figure(format!("tile.{name}.{tile}"), *n as f64));
        }
        Ok(())
    }
}

impl TilePage {
    /// Takes in the windows' messages since the last time.
    fn receive(&mut self) {
        let Some(link) = &mut self.link else { return };
        while let Some(event) = link.take() {
            match event.what {
                PageNews::Opened => {
                    self.n_opened += 1;
                    self.windows.insert(event.client, Window::default());
                }
                PageNews::Closed(_) => {
                    self.windows.remove(&event.client);
                }
                PageNews::Text(text) => {
                    let Some(window) = self.windows.get_mut(&event.client) else { continue };
                    match serde_json::from_str::<Said>(&text) {
                        Ok(said) if said.seen <= window.sent => window.seen = window.seen.max(Some(said.seen)),
                        _ => self.n_refused += 1,
                    }
                }
            }
        }
    }

    fn send(&mut self, link: &mut dyn PageLink, now: Time, views: &Views, tile: &TileView) {
        let host = link.now();
        let period = Interval::from_s(1.0 / self.settings.rate_hz).0;
        let numbers = |it: &EyeView| json!({ "eye": it.eye.coords.as_slice(), "clip": it.clip_from_space.as_slice() });
        let eyes: Vec<_> = tile.eyes.iter().map(|it| it.as_ref().map(numbers)).collect();
        let corners: Vec<_> = views.tiles.iter().map(|it| it.corners.map(|at| [at.x, at.y, at.z])).collect();
        // On the server's clock: as far from now as the moment is from now in the session.
        let shown = (host + (views.shown_at - now).0) as f64 * 1e-6;
        for (client, window) in &mut self.windows {
            if window.last.is_some_and(|it| host - it < period) {
                continue;
            }
            let is_behind = window.seen.is_some_and(|it| window.sent - it >= MOST_UNSEEN);
            let message = json!({
                "seq": window.sent + 1, "shown": shown, "sent": host as f64 * 1e-6, "size": tile.size_px, "eyes": eyes, "tiles": corners,
                "latency_ms": (now - views.time).as_ms(),
            });
            if is_behind || !link.send(*client, &message.to_string()) {
                self.n_held_back += 1;
                continue;
            }
            (window.sent, window.last) = (window.sent + 1, Some(host));
            self.n_sent += 1;
        }
    }
}
