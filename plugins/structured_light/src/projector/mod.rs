//! `structured_light.projector`: shows the patterns of `foveate patterns` full screen on a page of the program's web server, and reports when each was shown.
//!
//! A projector is a second screen: a person opens the page there. The page shows each picture pixel for pixel, in a frame of that screen, and reports the frame's time on
//! the server's clock, with what that may be off (half a round trip between page and program). It was certainly shown from then, and that much later, until the next one was drawn, and
//! that much earlier; where the frame after it came late, the screen may have been late by as much. A [`PatternShown`] is the time that is left.
//!
//! The next picture comes after a time (`advance = "rate"`), at a key on the page (`"key"`), or when a picture of the camera came in whose exposure began after this one's light
//! (`"image"`); its light comes `latency_ms` after the frame. With `"image"` that picture is the last one in the reported time.
//!
//! One window shows the patterns; others wait until it is closed. Where it is closed or changed in the middle of a set, that set is given up, and the next one begins.

mod stage;
mod words;

use std::sync::Arc;

use foveate::imaging::stripes::pattern::picture;
use foveate::node::page::{Page, PageEvent, PageFile, PageLink};
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::stage::{Stage, Step};
use self::words::ToPage;
use crate::pattern::{PatternSettings, calibrated_size, default_projector};

ports! {
    IMAGE: In<Image> = latest("image").optional();
    SHOWN: Out<PatternShown> = "shown";
}

figures! {
    "projector.sets.*": count, high, "Sets that the projector's page showed to the end";
    "projector.pictures.*": count, neither, "Pictures that the page reported as shown, over all sets";
    "projector.sets_broken.*": count, low, "Sets given up in the middle: the page was closed, hidden or changed in size";
    "projector.frames_dropped.*": count, low, "Pictures after which the page's next frame came late, so that they may have been shown late";
    "projector.clock_ms.max.*": ms, low, "Largest uncertainty of the time at which a picture was shown, from round trips between page and program";
}

/// The page.
const HTML: &str = include_str!("page.html");
/// Pause between two looks for a picture of the camera; far below the period of a camera.
const LOOK_AGAIN: Interval = Interval(2_000_000);

/// When the next picture is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Advance {
    /// After a time.
    #[default]
    Rate,
    /// When the camera's picture of this one has come in at `image`.
    Image,
    /// When a person presses space, Enter, → or page down on the page.
    Key,
}

/// Settings of [`Projector`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ProjectorSettings {
    /// Its name in the calibration, where it stands like a camera; without it `pattern.projector_px` says its size [–]
    pub projector: String,
    /// The patterns [–]
    pub pattern: PatternSettings,
    /// The projector's gamma, so that sine waves are sine waves in light; stripes are either lit or not [–]
    #[schemars(range(min = 0.2, max = 5.0))]
    pub gamma: f64,
    /// The next picture comes at a `rate`, when the camera's `image` of this one has come in, or at a `key` on the page [–]
    pub advance: Advance,
    /// With `advance = "rate"`: pictures a second, rounded to whole frames of the screen [Hz]
    #[schemars(range(min = 0.05, max = 240.0))]
    pub rate_hz: f64,
    /// Sets to show; 0: without end [–]
    #[schemars(range(max = 1_000_000))]
    pub sets: u64,
    /// Between two sets, in which the page shows black [s]
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub pause_s: f64,
    /// With `advance = "image"`, from the frame of the page to the projector's light, as `latency_ms` of `structured_light.collector`; too long costs time, too short spoils sets [ms]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub latency_ms: f64,
    /// With `advance = "image"`, the camera's exposure, as there [ms]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub exposure_ms: f64,
}

impl Default for ProjectorSettings {
    fn default() -> Self {
        Self {
            projector: default_projector(),
            pattern: PatternSettings::default(),
            gamma: 1.0,
            advance: Advance::default(),
            rate_hz: 5.0,
            sets: 0,
            pause_s: 0.0,
            latency_ms: 100.0,
            exposure_ms: 10.0,
        }
    }
}

impl ProjectorSettings {
    fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("gamma", self.gamma, 0.2..=5.0)?;
        ConfigError::unless_in("rate_hz", self.rate_hz, 0.05..=240.0)?;
        ConfigError::unless_in("sets", self.sets, 0..=1_000_000)?;
        ConfigError::unless_in("pause_s", self.pause_s, 0.0..=3600.0)?;
        ConfigError::unless_in("latency_ms", self.latency_ms, 0.0..=1000.0)?;
        ConfigError::unless_in("exposure_ms", self.exposure_ms, 0.0..=100.0)
    }
}

/// A projector as a second screen.
pub struct Projector {
    name: String,
    /// None where the node is only being checked, or the run serves no pages.
    link: Option<Box<dyn PageLink>>,
    stage: Stage,
    /// Session time less the server's clock [ns]: the largest seen, since a session time is read a little before it is compared.
    session_from_host: Option<i64>,
    pending: Option<PageEvent>,
    now: Time,
}

impl Node for Projector {
    const TYPE: &'static str = "structured_light.projector";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Shows striped patterns full screen in a browser, and reports when each was shown";
    const LIVE: bool = true;
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ProjectorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ProjectorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        if (settings.advance == Advance::Image) != setup.is_connected(&IMAGE) {
            let message = match settings.advance {
                Advance::Image => {
                    "found `image` and no connection at the port `image`, expected the camera's pictures there"
                }
                _ => "found a connection at the port `image`, expected `advance = \"image\"` with it, or none",
            };
            return Err(ConfigError::at("advance", message));
        }
        let calibrated = calibrated_size(setup, &settings.projector);
        let of_pattern = |fault: ConfigError| {
            let setting = fault.setting.map(|it| format!("pattern.{it}"));
            ConfigError { setting, ..fault }
        };
        let code = settings.pattern.stripe_code(calibrated).map_err(of_pattern)?;
        if let Some(size) = calibrated.filter(|it| *it != code.projector) {
            let message = format!("found {:?}, the calibration of this projector is for {size:?} [px]", code.projector);
            return Err(ConfigError::at("pattern.projector_px", message));
        }
        let manifest = PatternSettings { projector_px: code.projector, ..settings.pattern.clone() };
        let manifest = toml::to_string(&manifest).map_err(ConfigError::node)?;
        let pictures = code.pictures();
        let names = pictures.iter().map(ToString::to_string).collect();
        let size = code.projector;
        let mut link = None;
        if setup.purpose == Purpose::Run {
            let gamma = settings.gamma;
            let files = move |name: &str| {
                let shown = pictures.get(name.parse::<usize>().ok()?)?;
                Some(PageFile { content_type: "application/octet-stream", bytes: picture(&code, *shown, gamma) })
            };
            let page = Page { html: HTML, files: Arc::new(files) };
            link = setup.pages.open(&setup.instance, page).map_err(ConfigError::node)?;
        }
        let name = settings.projector.clone();
        let id = setup.calibration.index_of(&name).map_or(CameraId::default(), |it| CameraId(it as u16));
        let stage = Stage::new(settings, id, names, manifest);
        if let Some(link) = &mut link {
            link.greet(&ToPage::Projector { size, count: stage.count() }.text());
        }
        Ok(Self { name, link, stage, session_from_host: None, pending: None, now: Time::ZERO })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        self.now = io.now();
        let Some(link) = &mut self.link else { return Ok(()) };
        let measured = io.now().0 - link.now();
        let offset = *self.session_from_host.insert(self.session_from_host.map_or(measured, |it| it.max(measured)));
        let mut steps = Vec::new();
        while let Some(event) = self.pending.take().or_else(|| link.take()) {
            self.stage.hear(io.now(), offset, event, &mut steps);
        }
        let seen = io.latest(&IMAGE).map(|it| it.stamp.time);
        self.stage.go_on(io.now(), seen, &mut steps);
        for step in steps {
            match step {
                Step::Say(client, message) => {
                    // A window that is gone, or reads no more, is told as closed.
                    link.send(client, &message.text());
                }
                Step::Tell(shown) => io.emit_at(&SHOWN, shown.from, shown),
                Step::Gap(time, why) => io.gap(&SHOWN, time, why),
            }
        }
        Ok(())
    }

    fn due(&mut self) -> Due {
        let Some(link) = &mut self.link else { return Due::Never };
        if self.stage.is_done() {
            return Due::Never;
        }
        if self.pending.is_none() {
            self.pending = link.take();
        }
        if self.pending.is_some() {
            return Due::At(self.now);
        }
        self.stage.looks_again(self.now, LOOK_AGAIN).map_or(Due::Waiting, Due::At)
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        if let Some(link) = &mut self.link {
            let over = ToPage::Over("The run is over.".to_owned()).text();
            link.greet(&over);
            for client in self.stage.clients() {
                link.send(client, &over);
            }
        }
        let address = self.link.as_ref().map(|it| it.address());
        self.stage.report(&self.name, address.as_deref(), report);
        Ok(())
    }

    fn plan(settings: &ProjectorSettings) -> Plan {
        let rate_hz = (settings.advance == Advance::Rate).then_some(settings.rate_hz);
        Plan { rate_hz, ..Plan::default() }
    }
}

#[cfg(test)]
mod tests;
