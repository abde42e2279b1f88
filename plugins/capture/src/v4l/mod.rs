//! `capture.v4l`: a camera on this machine, through Video4Linux.
//!
//! A thread waits for the driver and puts pictures into a bounded box; the node takes them out of it. Each picture is
//! stamped with the driver's own time, converted to the session clock (`v4l/clock.rs`); what is lost, damaged or late is a gap
//! with its reason, and a camera that disappears is opened again once it is back (`v4l/stream.rs`). Talking to the
//! driver needs the feature `hardware`; everything else is built and tested without.

#[cfg(all(feature = "hardware", target_os = "linux"))]
mod camera;
mod clock;
mod controls;
mod device;
#[cfg(test)]
mod fake;
mod huffman;
#[cfg(all(feature = "hardware", target_os = "linux"))]
mod ioctls;
mod offer;
mod pixels;
mod reader;
mod settings;
mod stream;

use std::path::PathBuf;
use std::time::Duration;

use foveate::prelude::*;

pub use self::settings::{ControlValue, V4lSettings};

use self::clock::{SessionClock, Statistics};
use self::device::{Device, Layout};
use self::reader::Reader;
use self::stream::{Counts, Stream, Turn, What};
use crate::settings::camera_of;

ports! {
    IMAGE: Out<Image> = "image";
}

figures! {
        "v4l.frames.*": count, neither, "Pictures of the camera delivered";
        "v4l.gaps.*": count, low, "Missing frames, for any reason";
        "v4l.lost_by_driver.*": count, low, "Frames that the driver counted and did not deliver";
    "v4l.unusable.*": count, low, "Pictures that were damaged, short or could not be decoded";
    "v4l.restarts.*": count, low, "Starts of the stream after the first";
    "v4l.reopenings.*": count, low, "Openings of the camera after the first";
        "v4l.rate_hz.*": Hz, neither, "Frame rate between the first and the last picture, by their stamps";
        "v4l.latency_ms.{mean,max}.*": ms, low, "From the stamp of a picture to its arrival, over pictures delivered";
        "v4l.drift_ppm.*": ppm, neither, "Trend of the latency: how much slower the clock of the stamps runs than this machine's";
}

/// Message of a program that was built without cameras.
#[cfg(not(all(feature = "hardware", target_os = "linux")))]
const NOT_BUILT_IN: &str = "this program is built without cameras; on Linux, with libclang installed, \
                            `cargo build --release --features hardware` builds it with them";

/// Pictures of a camera on this machine.
pub struct V4l {
    settings: V4lSettings,
    camera: CameraId,
    /// Name in the figures.
    name: String,
    instance: String,
    source: Source,
    clock: SessionClock,
    pending: Option<Turn>,
    statistics: Statistics,
    /// Session time of the last picture or gap.
    last: Time,
    n_lost: u64,
}

enum Source {
    /// The node is being checked, not run.
    None,
    Open(Box<dyn Device>, Layout),
    Reading(Reader),
    /// The thread has died.
    Dead,
}

/// All cameras of this machine with what they offer, for people.
///
/// # Errors
/// The program is built without cameras: how to build it with them.
pub fn describe_devices() -> Result<String, String> {
    #[cfg(all(feature = "hardware", target_os = "linux"))]
    return Ok(camera::describe_all());
    #[cfg(not(all(feature = "hardware", target_os = "linux")))]
    return Err(NOT_BUILT_IN.to_owned());
}

fn device(path: PathBuf, settings: &V4lSettings, size: Option<[u32; 2]>) -> Result<Box<dyn Device>, ConfigError> {
    #[cfg(all(feature = "hardware", target_os = "linux"))]
    return Ok(Box::new(camera::Camera::new(path, settings.clone(), size)));
    #[cfg(not(all(feature = "hardware", target_os = "linux")))]
    {
        let _ = (path, settings, size);
        Err(ConfigError::node(NOT_BUILT_IN))
    }
}

impl V4l {
    fn with_device(settings: V4lSettings, setup: &Setup, mut device: Box<dyn Device>) -> Result<Self, ConfigError> {
        let camera = camera_of(setup, Self::TYPE)?;
        let source = match setup.purpose {
            Purpose::Check => Source::None,
            Purpose::Run => {
                let layout = device.open()?;
                Source::Open(device, layout)
            }
        };
        Ok(Self {
            settings,
            camera,
            name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            instance: setup.instance.clone(),
            source,
            clock: SessionClock::default(),
            pending: None,
            statistics: Statistics::default(),
            last: Time::ZERO,
            n_lost: 0,
        })
    }

    fn start_reading(&mut self) -> Result<(), NodeError> {
        let Source::Open(device, layout) = std::mem::replace(&mut self.source, Source::Dead) else { return Ok(()) };
        let timeout = Duration::from_secs_f64(self.settings.timeout_ms * 1e-3);
        let stream = Stream::new(device, layout, self.camera, self.settings.format, timeout);
        let reader = Reader::start(stream, &self.instance)
            .map_err(|error| NodeError::program(format_args!("no thread to read the camera on: {error}")))?;
        self.source = Source::Reading(reader);
        Ok(())
    }

    /// Delivers a turn: first the gaps since the last one, spread over the time between, then its picture.
    fn give_out(&mut self, turn: Turn, io: &mut Io<'_>) {
        let Turn { stamp, arrival, what, lost } = turn;
        let seen = self.clock.session(stamp) - Interval::from_ms(self.settings.stamp_delay_ms);
        if seen < Time::ZERO {
            // Seen while the rig was being made ready. A camera that did not get ready is news all the same.
            if let What::Gap(reason) = what {
                io.gap(&IMAGE, Time::ZERO, reason);
            }
            return;
        }
        let n_lost: u64 = lost.iter().map(|it| it.count).sum();
        let step = (seen - self.last).0 / (n_lost as i64 + 1);
        let mut time = self.last;
        for reason in lost.iter().flat_map(|it| std::iter::repeat_n(&it.reason, it.count as usize)) {
            time = time + Interval(step);
            io.gap(&IMAGE, time, reason);
        }
        self.n_lost += n_lost;
        self.last = seen;
        match what {
            What::Picture(image) => {
                self.statistics.add(stamp, arrival);
                io.emit_at(&IMAGE, seen, image);
            }
            What::Gap(reason) => {
                self.n_lost += 1;
                io.gap(&IMAGE, seen, reason);
            }
        }
    }

    fn report(&self, counts: &Counts, report: &mut Report) {
        let (latency_ms, worst_ms) = self.statistics.latency_ms();
        let figures = [
            ("frames", self.statistics.count() as f64),
            ("gaps", self.n_lost as f64),
            ("lost_by_driver", counts.lost_by_driver as f64),
            ("unusable", counts.unusable as f64),
            ("restarts", counts.restarts as f64),
            ("reopenings", counts.reopenings as f64),
            ("rate_hz", self.statistics.rate_hz()),
            ("latency_ms.mean", latency_ms),
            ("latency_ms.max", worst_ms),
            ("drift_ppm", self.statistics.drift_ppm()),
        ];
        figures.iter().for_each(|(figure, value)| report.figure(format!("v4l.{figure}.{}", self.name), *value));
        if counts.unstamped > 0 {
            report.remark(format!(
                "{}: {} pictures have no time stamp of the monotonic clock; the time of their arrival is used",
                self.instance, counts.unstamped
            ));
        } else if self.statistics.count() > 0 {
            let what = if counts.at_start { "start of the exposure" } else { "end of the frame" };
            report.remark(format!("{}: the driver stamps the {what}", self.instance));
        }
    }
}

impl Node for V4l {
    const TYPE: &'static str = "capture.v4l";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Reads a camera of this machine (Video4Linux, Linux only)";
    const LIVE: bool = true;
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = V4lSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: V4lSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        camera_of(setup, Self::TYPE)?;
        let calibrated = setup.camera_model().map(|it| it.image_size);
        if let Some([columns, rows]) = calibrated {
            for (name, asked, known) in [("width", settings.width, columns), ("height", settings.height, rows)] {
                if let Some(asked) = asked.filter(|it| *it != known) {
                    let message = format!("found {asked}, expected {known} as in the calibration of this camera [px]");
                    return Err(ConfigError::at(name, message));
                }
            }
        }
        let path = setup.path("device", &settings.device)?;
        let device = device(path, &settings, calibrated)?;
        Self::with_device(settings, setup, device)
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Source::Open(..) = self.source {
            return self.start_reading();
        }
        let Source::Reading(reader) = &self.source else { return Ok(()) };
        let Some(turn) = self.pending.take() else {
            if reader.is_dead() {
                self.source = Source::Dead;
                return Err(NodeError::program("the thread that reads the camera has died"));
            }
            return Ok(());
        };
        self.clock.fix(io.now(), reader.device_now());
        self.give_out(turn, io);
        Ok(())
    }

    fn change(&mut self, settings: V4lSettings) -> Result<(), ConfigError> {
        settings.check()?;
        match &mut self.source {
            Source::Open(device, _) => device.change(&settings)?,
            Source::Reading(reader) => reader.change(&settings)?,
            Source::None | Source::Dead => {}
        }
        self.settings = settings;
        Ok(())
    }

    fn due(&mut self) -> Due {
        let reader = match &self.source {
            Source::None | Source::Dead => return Due::Never,
            // Before the clock of the session runs.
            Source::Open(..) => return Due::At(Time::ZERO),
            Source::Reading(reader) => reader,
        };
        if self.pending.is_none() {
            self.pending = reader.take();
        }
        match &self.pending {
            Some(turn) if self.clock.is_fixed() => Due::At(self.clock.session(turn.arrival).max(Time::ZERO)),
            Some(_) => Due::At(Time::ZERO),
            None if reader.is_dead() => Due::At(self.last),
            None => Due::Waiting,
        }
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Source::Reading(reader) = &mut self.source else { return Ok(()) };
        let counts = reader.end().unwrap_or_default();
        self.report(&counts, report);
        Ok(())
    }

    fn plan(settings: &V4lSettings) -> Plan {
        Plan { rate_hz: settings.rate_hz, ..Plan::default() }
    }
}

#[cfg(test)]
mod tests;
