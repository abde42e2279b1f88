//! A real camera, opened, configured and read through the crate `v4l`.

use std::fmt::Write;
use std::io::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use foveate::prelude::ConfigError;
use v4l::capability::Flags;
use v4l::format::Quantization;
use v4l::frameinterval::FrameIntervalEnum;
use v4l::framesize::FrameSizeEnum;
use v4l::video::Capture;
use v4l::video::capture::Parameters;
use v4l::{Format, FourCC, Fraction};

use super::device::{Device, DeviceClock, Filled, FourCc, Layout, Trouble};
use super::ioctls::{self, Buffers};
use super::offer::{self, Offer, Rates, Sizes, Wanted, is_same_rate};
use super::pixels::{in_letters, readable};
use super::settings::V4lSettings;
use super::{controls, offer::choose};

/// Where devices are, and where the links with lasting names to them are.
const DEVICES: &str = "/dev";
const LINKS: [&str; 2] = ["/dev/v4l/by-id", "/dev/v4l/by-path"];

/// A camera and its settings in the rig.
pub(crate) struct Camera {
    path: PathBuf,
    settings: V4lSettings,
    /// Columns, rows that the calibration says [px].
    calibrated: Option<[u32; 2]>,
    // Dropped in this order: the stream ends before the device is closed.
    buffers: Option<Buffers>,
    device: Option<v4l::Device>,
}

impl Camera {
    pub(crate) fn new(path: PathBuf, settings: V4lSettings, calibrated: Option<[u32; 2]>) -> Self {
        Self { path, settings, calibrated, buffers: None, device: None }
    }

    fn open_and_set(&self) -> Result<(v4l::Device, Layout), ConfigError> {
        let device = open(&self.path).map_err(|fault| {
            let others = devices().into_iter().map(|it| format!("`{}`", it.display())).collect::<Vec<_>>();
            let there = if others.is_empty() { "no video device".to_owned() } else { others.join(", ") };
            ConfigError::at("device", format_args!("`{}` {fault}; found {there}", self.path.display()))
        })?;
        let layout = self.set_format(&device)?;
        self.set_controls(&device)?;
        Ok((device, layout))
    }

    fn set_format(&self, device: &v4l::Device) -> Result<Layout, ConfigError> {
        let refused = |setting: &str, what: &str, error: String| {
            ConfigError::at(setting, format_args!("`{}`: {what}: {error}", self.path.display()))
        };
        let present = careful(|| device.format()).map_err(|it| refused("device", "its format cannot be read", it))?;
        let size = [
            self.settings.width.or(self.calibrated.map(|it| it[0])).unwrap_or(present.width),
            self.settings.height.or(self.calibrated.map(|it| it[1])).unwrap_or(present.height),
        ];
        let layouts = self.settings.fourcc()?.map_or_else(|| readable(self.settings.format), |it| vec![it]);
        let offers = offers(device, size);
        let wanted = Wanted { layouts, size, rate_hz: self.settings.rate_hz };
        let (fourcc, interval) = choose(&offers, &wanted)?;
        // A line length of before would be kept: 0 lets the driver compute it.
        let asked = Format { stride: 0, size: 0, ..Format::new(size[0], size[1], FourCC::new(&fourcc)) };
        let given = careful(|| device.set_format(&asked)).map_err(|it| refused("device_format", "not taken", it))?;
        if given.fourcc.repr != fourcc || [given.width, given.height] != size {
            let (found, letters) = (in_letters(given.fourcc.repr), in_letters(fourcc));
            let message = format!(
                "requested `{letters}` {} x {} px, the device set `{found}` {} x {} px",
                size[0], size[1], given.width, given.height
            );
            return Err(ConfigError::at("width", message));
        }
        let full_range = matches!(given.quantization, Quantization::FullRange);
        let period = self.set_rate(device, interval)?;
        Ok(Layout { fourcc, size, stride: given.stride, full_range, period })
    }

    /// Sets the rate; the time between two frames [ns] where the driver says.
    fn set_rate(&self, device: &v4l::Device, interval: Option<[u32; 2]>) -> Result<Option<i64>, ConfigError> {
        let given = match interval {
            Some([numerator, denominator]) => {
                let asked = Parameters::new(Fraction::new(numerator, denominator));
                careful(|| device.set_params(&asked))
            }
            None => careful(|| device.params()),
        };
        let seconds =
            given.as_ref().map_or(0.0, |it| f64::from(it.interval.numerator) / f64::from(it.interval.denominator));
        let is_known = seconds.is_finite() && seconds > 0.0;
        if let Some(asked_hz) = self.settings.rate_hz {
            let found = match &given {
                Err(error) => Some(format!("the device accepts no rate: {error}")),
                Ok(_) if !is_known => Some("the device does not report its rate".to_owned()),
                Ok(_) if is_same_rate(asked_hz, 1.0 / seconds) => None,
                Ok(_) => Some(format!("requested {asked_hz} Hz, the device set {:.3} Hz", 1.0 / seconds)),
            };
            if let Some(found) = found {
                return Err(ConfigError::at("rate_hz", found));
            }
        }
        Ok(is_known.then_some((seconds * 1e9) as i64))
    }

    fn set_controls(&self, device: &v4l::Device) -> Result<(), ConfigError> {
        let handle = device.handle();
        // A device without controls is one that nothing can be set of.
        let known = ioctls::controls(&handle).unwrap_or_default();
        for (id, value) in controls::plan(&self.settings, &known)? {
            ioctls::set_control(&handle, id, value).map_err(|error| {
                let name = known.iter().find(|it| it.id == id).map_or("", |it| it.name.as_str());
                ConfigError::at("controls", format_args!("`{name}` cannot be set to {value}: {error}"))
            })?;
        }
        Ok(())
    }
}

impl Device for Camera {
    fn open(&mut self) -> Result<Layout, ConfigError> {
        self.close();
        let (device, layout) = self.open_and_set()?;
        self.device = Some(device);
        Ok(layout)
    }

    fn change(&mut self, settings: &V4lSettings) -> Result<(), ConfigError> {
        let before = std::mem::replace(&mut self.settings, settings.clone());
        let Some(device) = &self.device else { return Ok(()) };
        self.set_controls(device).inspect_err(|_| self.settings = before)
    }

    fn start(&mut self) -> Result<(), Trouble> {
        self.stop();
        let Some(device) = &self.device else { return Err(Trouble::Gone("the device is closed".to_owned())) };
        let buffers = Buffers::start(device.handle(), self.settings.buffers);
        self.buffers = Some(buffers.map_err(|(step, error)| trouble(step, &error))?);
        Ok(())
    }

    fn next(&mut self, wait: Duration, read: &mut dyn FnMut(&Filled, &[u8])) -> Result<bool, Trouble> {
        match &mut self.buffers {
            Some(buffers) => buffers.next(wait, read).map_err(|error| trouble("waiting for a picture", &error)),
            None => Err(Trouble::Interrupted("the stream has not been started".to_owned())),
        }
    }

    fn stop(&mut self) {
        self.buffers = None;
    }

    fn close(&mut self) {
        self.stop();
        self.device = None;
    }

    fn clock(&self) -> DeviceClock {
        Arc::new(ioctls::monotonic_ns)
    }
}

fn trouble(step: &str, error: &std::io::Error) -> Trouble {
    if matches!(error.raw_os_error(), Some(libc::ENODEV | libc::ENXIO)) {
        Trouble::Gone(format!("the camera is gone: {error}"))
    } else {
        Trouble::Interrupted(format!("{step}, the driver reports: {error}"))
    }
}

/// A call into the crate `v4l`, which panics where a driver answers with an unknown value.
fn careful<T>(call: impl FnOnce() -> std::io::Result<T>) -> Result<T, String> {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(result) => result.map_err(|error| error.to_string()),
        Err(_) => Err("the driver's answer cannot be read by the crate `v4l`".to_owned()),
    }
}

/// Opens a device that gives pictures.
fn open(path: &Path) -> Result<v4l::Device, String> {
    let device = v4l::Device::with_path(path).map_err(|error| match error.kind() {
        ErrorKind::NotFound => "is not there".to_owned(),
        ErrorKind::PermissionDenied => "may not be opened: add yourself to the group `video`".to_owned(),
        _ => format!("cannot be opened: {error}"),
    })?;
    let able = careful(|| device.query_caps()).map_err(|error| format!("is no video device: {error}"))?.capabilities;
    if !able.contains(Flags::VIDEO_CAPTURE | Flags::STREAMING) {
        let why = if able.contains(Flags::VIDEO_CAPTURE_MPLANE) { " (its pictures come in planes)" } else { "" };
        return Err(format!("gives no pictures{why}"));
    }
    Ok(device)
}

/// What a camera offers; where it takes any size, its rates are those of `size`.
fn offers(device: &v4l::Device, size: [u32; 2]) -> Vec<Offer> {
    let formats = careful(|| device.enum_formats()).unwrap_or_default();
    let offer = |format: v4l::format::Description| Offer {
        fourcc: format.fourcc.repr,
        description: format.description,
        sizes: sizes(device, format.fourcc, size),
    };
    formats.into_iter().map(offer).collect()
}

fn sizes(device: &v4l::Device, fourcc: FourCC, wanted: [u32; 2]) -> Vec<Sizes> {
    let found = careful(|| device.enum_framesizes(fourcc)).unwrap_or_default();
    if found.is_empty() {
        // A driver without a list: whatever it is asked for may do, and what it made of it is looked at.
        return vec![Sizes {
            min: [1, 1],
            max: [65_535, 65_535],
            step: [1, 1],
            rates: rates(device, fourcc.repr, wanted),
        }];
    }
    let described = found.into_iter().map(|it| {
        let (min, max, step) = match it.size {
            FrameSizeEnum::Discrete(it) => ([it.width, it.height], [it.width, it.height], [1, 1]),
            FrameSizeEnum::Stepwise(it) => {
                ([it.min_width, it.min_height], [it.max_width, it.max_height], [it.step_width, it.step_height])
            }
        };
        let sizes = Sizes { min, max, step, rates: Rates::Unknown };
        let size = if sizes.holds(wanted) { wanted } else { max };
        Sizes { rates: rates(device, fourcc.repr, size), ..sizes }
    });
    described.collect()
}

fn rates(device: &v4l::Device, fourcc: FourCc, size: [u32; 2]) -> Rates {
    let pair = |it: &Fraction| [it.numerator, it.denominator];
    let intervals = careful(|| device.enum_frameintervals(FourCC::new(&fourcc), size[0], size[1])).unwrap_or_default();
    let mut only = Vec::new();
    for it in &intervals {
        match &it.interval {
            FrameIntervalEnum::Discrete(interval) => only.push(pair(interval)),
            FrameIntervalEnum::Stepwise(range) => return Rates::Between(pair(&range.min), pair(&range.max)),
        }
    }
    if only.is_empty() { Rates::Unknown } else { Rates::Only(only) }
}

/// The video devices, by number.
fn devices() -> Vec<PathBuf> {
    let names =
        std::fs::read_dir(DEVICES).into_iter().flatten().flatten().filter_map(|it| it.file_name().into_string().ok());
    let mut numbers: Vec<u32> = names.filter_map(|it| it.strip_prefix("video")?.parse().ok()).collect();
    numbers.sort_unstable();
    numbers.into_iter().map(|it| Path::new(DEVICES).join(format!("video{it}"))).collect()
}

/// The lasting names of a device.
fn links(device: &Path) -> Vec<PathBuf> {
    let entries = LINKS.iter().flat_map(|it| std::fs::read_dir(it).into_iter().flatten().flatten());
    let mut links: Vec<PathBuf> =
        entries.map(|it| it.path()).filter(|it| it.canonicalize().is_ok_and(|target| target == device)).collect();
    links.sort();
    links
}

/// All cameras with what they offer, for people.
pub(crate) fn describe_all() -> String {
    let mut text = String::new();
    let mut others = Vec::new();
    for path in devices() {
        match open(&path) {
            Ok(device) => describe(&path, &device, &mut text),
            Err(fault) => others.push(format!("{} {fault}", path.display())),
        }
    }
    if text.is_empty() {
        text += "No camera.\n";
    }
    for it in others {
        let _ = writeln!(text, "{it}");
    }
    text
}

fn describe(path: &Path, device: &v4l::Device, text: &mut String) {
    let card = careful(|| device.query_caps())
        .map_or_else(|fault| fault, |it| format!("{} ({}, {})", it.card, it.driver, it.bus));
    let _ = writeln!(text, "{}  {card}", path.display());
    for it in links(path) {
        let _ = writeln!(text, "  also {}", it.display());
    }
    let present = careful(|| device.format());
    let size = present.as_ref().map_or([640, 480], |it| [it.width, it.height]);
    if let Ok(it) = &present {
        let rate = careful(|| device.params()).ok().filter(|it| it.interval.numerator > 0);
        let rate = rate.map_or(String::new(), |it| {
            format!(" at {:.3} Hz", f64::from(it.interval.denominator) / f64::from(it.interval.numerator))
        });
        let _ = writeln!(text, "  set to `{}` {} x {} px{rate}", in_letters(it.fourcc.repr), it.width, it.height);
    }
    *text += "  Layouts, sizes, rates\n";
    *text += &offer::in_lines(&offers(device, size), "    ");
    let known = ioctls::controls(&device.handle()).unwrap_or_default();
    if !known.is_empty() {
        *text += "  Controls\n";
        *text += &controls::in_lines(&known, "    ");
    }
}
