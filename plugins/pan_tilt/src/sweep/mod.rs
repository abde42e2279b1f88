//! `pan_tilt.sweep`: drives a head through settings while a person waves a light, for `pan_tilt.calibrator` [Davis 2002 §4.2].
//!
//! At each setting it waits until the head has arrived and settled, and until the light was seen often enough and all over the picture, or a time limit
//! is reached: see [`Sweep`].

mod settings;
#[cfg(test)]
mod tests;

use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::PathBuf;

use foveate::prelude::*;
use foveate_calibration::head::{Sweep, SweepOptions, SweepOrder};

pub use settings::SweepSettings;

ports! {
    FEATURES: In<Features> = each("features");
    REPORT: In<HeadReport> = latest("report").optional();
    COMMANDS: Out<HeadCommand> = "commands";
}

figures! {
        "sweep.*.settings": count, neither, "Settings to be visited by that head, without those beyond its limits";
        "sweep.*.visited": count, high, "Settings visited so far";
        "sweep.*.reached": count, high, "Settings that the head reported to have reached";
    "sweep.*.filled": count, high, "Settings with enough observations of the light";
    "sweep.*.observations": count, high, "Observations of the light, over all settings";
}

/// A head on its way through settings; each picture of its camera is an activation.
pub struct SweepNode {
    sweep: Sweep,
    camera: CameraId,
    name: String,
    speed: f64,
    /// Last reported angles of the head.
    angles: Option<[f64; 2]>,
    next_event: u64,
    is_done: bool,
    left_out: usize,
    out: Option<PathBuf>,
    file: String,
    advice: Advice,
}

/// Advice to the person with the light.
struct Advice {
    path: Option<PathBuf>,
    name: String,
    advice: String,
    next: Time,
}

/// Smallest interval between advice that a person can follow.
const ADVICE_EVERY: Interval = Interval(1_000_000_000);

impl Node for SweepNode {
    const TYPE: &'static str = "pan_tilt.sweep";
    const ROLE: Role = Role::Selector;
    const SUMMARY: &'static str =
        "Drives a head through the settings of its calibration, and says where to hold the light";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = SweepSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: SweepSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let (Some(camera), Some(model)) = (setup.camera, setup.camera_model()) else {
            return Err(ConfigError::node(
                "found no camera, expected `each` or `camera` to name the cameras of the calibration that are on heads",
            ));
        };
        let name = setup.camera_name().unwrap_or_default().to_owned();
        let all = settings.places();
        let limits = setup.head_model().map(|it| it.model.limits);
        let within = |it: &[f64; 2]| {
            limits.is_none_or(|limits| limits.contain(&foveate::geometry::pan_tilt::Setting::new(it[0], it[1])))
        };
        let (places, beyond): (Vec<[f64; 2]>, Vec<[f64; 2]>) = all.into_iter().partition(within);
        if places.is_empty() {
            let message = format!("found no setting within the limits of the head of {name}, expected one at least");
            return Err(ConfigError::at("pan_deg", message));
        }
        let file = settings.file.replace("{camera}", &name);
        setup.claim_named_file("file", &file)?;
        let advice = settings.advice.replace("{camera}", &name);
        setup.claim_named_file("advice", &advice)?;
        let options = SweepOptions {
            settings: places,
            tolerance: settings.tolerance_deg.to_radians(),
            settle_s: 1e-3 * settings.settle_ms,
            step_px: settings.step_px,
            observations: settings.observations,
            cells: settings.cells,
            longest_s: settings.longest_s,
            image_size: model.image_size,
        };
        Ok(Self {
            sweep: Sweep::new(options),
            camera,
            name,
            speed: settings.speed_deg_per_s.to_radians(),
            angles: None,
            next_event: 0,
            is_done: false,
            left_out: beyond.len(),
            out: setup.out_dir.clone(),
            file,
            advice: Advice {
                path: setup.out_dir.as_ref().map(|it| it.join(&advice)),
                name: advice,
                advice: String::new(),
                next: Time::ZERO,
            },
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(features) = io.take(&FEATURES) else { return Ok(()) };
        self.advice.tell(io.now(), &self.sweep)?;
        if let Some(report) = io.latest(&REPORT) {
            for (_, event) in report.value.since(&mut self.next_event) {
                match event {
                    HeadEvent::Position(position) => self.angles = Some(position.angles),
                    HeadEvent::Link(HeadLink::Away) => self.angles = None,
                    _ => {}
                }
            }
        }
        let now_s = io.now().as_s();
        let angles = match self.sweep.step(now_s, self.angles) {
            SweepOrder::Go(angles) => angles,
            // Home, once.
            SweepOrder::Done if !std::mem::replace(&mut self.is_done, true) => [0.0; 2],
            SweepOrder::Stay | SweepOrder::Done => {
                if let [one] = features.value.list[..] {
                    self.sweep.add_observation(features.time().as_s(), one.centre);
                }
                return Ok(());
            }
        };
        let order = HeadOrder::Go { angles, speeds: [self.speed; 2] };
        io.emit_at(&COMMANDS, io.now(), HeadCommand { camera: self.camera, order, zoom: None });
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let name = &self.name;
        let [visited, settings] = self.sweep.progress();
        let seen: Vec<_> = self.sweep.seen().collect();
        let figures = [
            ("settings", settings),
            ("visited", visited),
            ("reached", seen.iter().filter(|it| it.1.reached).count()),
            ("filled", self.sweep.filled()),
            ("observations", seen.iter().map(|it| it.1.observations as usize).sum()),
        ];
        figures.into_iter().for_each(|(figure, n)| report.figure(format!("sweep.{name}.{figure}"), n as f64));
        report.remark(format!("{name}: {}", self.sweep));
        if self.left_out > 0 {
            report.remark(format!(
                "{name}: {} settings are beyond the limits of the head and were left out",
                self.left_out
            ));
        }
        if let Some(folder) = &self.out {
            std::fs::write(folder.join(&self.file), self.table())
                .map_err(|error| NodeError::input(format_args!("`{}` cannot be written: {error}", self.file)))?;
            report.file(&self.file);
            report.file(&self.advice.name);
        }
        Ok(())
    }
}

impl Advice {
    fn tell(&mut self, now: Time, sweep: &Sweep) -> Result<(), NodeError> {
        let Some(path) = self.path.as_ref().filter(|_| now >= self.next) else { return Ok(()) };
        self.next = now + ADVICE_EVERY;
        let sentence = sweep.to_string();
        if sentence == self.advice {
            return Ok(());
        }
        let begins = self.advice.is_empty();
        let open = OpenOptions::new().create(true).write(true).append(!begins).truncate(begins).open(path);
        open.and_then(|mut file| writeln!(file, "{:7.1} s  {sentence}", now.as_s()))
            .map_err(|error| NodeError::input(format_args!("`{}` cannot be written: {error}", self.name)))?;
        self.advice = sentence;
        Ok(())
    }
}

impl SweepNode {
    /// One row for each setting; `cells` are the ninths of the picture, row by row.
    fn table(&self) -> String {
        let mut text = "pan_deg,tilt_deg,reached,observations,cells\n".to_owned();
        for ([pan, tilt], seen) in self.sweep.seen() {
            let cells: Vec<String> = seen.cells.iter().map(u32::to_string).collect();
            let (pan, tilt) = (pan.to_degrees(), tilt.to_degrees());
            // Writing to a String cannot fail.
            let _ = writeln!(
                text,
                "{pan:.3},{tilt:.3},{},{},{}",
                u8::from(seen.reached),
                seen.observations,
                cells.join(" ")
            );
        }
        text
    }
}
