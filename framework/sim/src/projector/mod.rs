//! A simulated projector: which picture it shows when, and what light that makes.
//!
//! It stands in the calibration like a camera; where it really stands and how its lens really images says the world's truth. What it shows is a pure function
//! of time, so that any camera may ask at any time: sets of pictures one after the other, each picture as long as the projector's period.
//!
//! Light of a pixel: `black + (1 − black) (level / 255)^gamma` of what white has. Light falls off with the square of the distance. A lens of aperture `A` that is focused at
//! `f` images a point at the distance `d` as a disc of `A F |1/d − 1/f|` projector pixels across, `F` its focal length in pixels: similar triangles.

mod beam;
mod profile;

use std::sync::{Arc, OnceLock};

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_imaging::stripes::code::{Group, Inverse};
use foveate_imaging::stripes::{Shown, StripeCode};
use foveate_messages::{CameraId, Interval, Message, Space, Time, Wire};
use foveate_node::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub(crate) use beam::Beam;
pub(crate) use profile::Profile;

use crate::chance::stream;

/// The code of a simulated projector's pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum PatternCode {
    /// Gray code down to single projector pixels, each bit followed by its inverse.
    Gray,
    /// A phase shift on top of a Gray code whose stripes are half a period wide.
    #[default]
    Phase,
    /// A stripe boundary code: its four pictures again and again, without a pause.
    Boundary,
}

/// What a projector shows, and how.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ProjectorSettings {
    /// The code: `gray`, `phase` or `boundary` [–]
    pub code: PatternCode,
    /// Order of the pictures in a set: `columns` (the pictures that encode the column), `rows`, `white`, `black`; of a boundary code, the first of `columns` and `rows` alone [–]
    pub order: String,
    /// Steps of a phase shift [–]
    #[schemars(range(min = 3, max = 32))]
    pub steps: u32,
    /// Its period, a power of two [px]
    #[schemars(range(min = 4, max = 1024))]
    pub period_px: u32,
    /// Width of a stripe of a boundary code [px]
    #[schemars(range(min = 2, max = 1024))]
    pub stripe_px: u32,
    /// The gamma that its driver assumes: sine waves are written for it [–]
    #[schemars(range(min = 0.2, max = 5.0))]
    pub assumed_gamma: f64,
    /// The gamma that it has [–]
    #[schemars(range(min = 0.2, max = 5.0))]
    pub gamma: f64,
    /// Contrast: light of white over that of black [–]
    #[schemars(range(min = 1.5, max = 1e6))]
    pub contrast: f64,
    /// Gray level of a white surface that faces it at 1 m, lit white, gain 1; falls off with the square of the distance [gray level]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub light: f64,
    /// Where its lens is focused [m]
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub focus_m: f64,
    /// Across the aperture of its lens, which sets how fast pictures blur before and behind the focus [mm]
    #[schemars(range(min = 0.0, max = 200.0))]
    pub aperture_mm: f64,
    /// Blur at the focus, standard deviation [px]
    #[schemars(range(min = 0.05, max = 20.0))]
    pub blur_px: f64,
    /// Pictures a second [Hz]
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub rate_hz: f64,
    /// When the first set begins [s]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub start_s: f64,
    /// Between two sets, in which it shows black; a boundary code has no pause [s]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub pause_s: f64,
    /// Latency from the command to show a picture to its light [ms]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub latency_ms: f64,
    /// Share of the pictures that it does not show, the one before staying instead, drawn for each picture [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub dropped: f64,
}

impl Default for ProjectorSettings {
    /// A small projector with an LED lamp.
    fn default() -> Self {
        Self {
            code: PatternCode::default(),
            order: "white black columns rows".to_owned(),
            steps: 4,
            period_px: 16,
            stripe_px: 4,
            assumed_gamma: 2.2,
            gamma: 2.2,
            contrast: 500.0,
            light: 2300.0,
            focus_m: 2.5,
            aperture_mm: 8.0,
            blur_px: 0.4,
            rate_hz: 60.0,
            start_s: 0.0,
            pause_s: 0.2,
            latency_ms: 30.0,
            dropped: 0.0,
        }
    }
}

impl ProjectorSettings {
    /// The code for a projector of this size.
    ///
    /// # Errors
    /// The setting, what was found and what is expected.
    pub fn stripe_code(&self, size: [u32; 2]) -> Result<StripeCode, ConfigError> {
        let order = Group::order(&self.order).map_err(|it| ConfigError::at("order", it))?;
        if self.code == PatternCode::Boundary {
            let code = StripeCode::boundary(size, self.stripe_px, &order);
            code.check().map_err(|fault| ConfigError::at("stripe_px", fault))?;
            return Ok(code);
        }
        let code = match self.code {
            PatternCode::Boundary => unreachable!("it was made above"),
            PatternCode::Gray => StripeCode::gray(size),
            PatternCode::Phase if self.period_px.is_power_of_two() && self.period_px >= 4 => {
                StripeCode::phase(size, self.steps, self.period_px)
            }
            PatternCode::Phase => {
                let message = format!("found {}, expected a power of two, at least 4", self.period_px);
                return Err(ConfigError::at("period_px", message));
            }
        };
        let code = StripeCode { order, inverse: Inverse::After, ..code };
        code.check().map_err(|fault| ConfigError::at("order", fault))?;
        Ok(code)
    }

    /// Refuses numbers out of their ranges.
    ///
    /// # Errors
    /// The first such setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("steps", self.steps, 3..=32)?;
        ConfigError::unless_in("period_px", self.period_px, 4..=1024)?;
        ConfigError::unless_in("stripe_px", self.stripe_px, 2..=1024)?;
        ConfigError::unless_in("assumed_gamma", self.assumed_gamma, 0.2..=5.0)?;
        ConfigError::unless_in("gamma", self.gamma, 0.2..=5.0)?;
        ConfigError::unless_in("contrast", self.contrast, 1.5..=1e6)?;
        ConfigError::unless_in("light", self.light, 0.0..=1e6)?;
        ConfigError::unless_in("focus_m", self.focus_m, 0.1..=1000.0)?;
        ConfigError::unless_in("aperture_mm", self.aperture_mm, 0.0..=200.0)?;
        ConfigError::unless_in("blur_px", self.blur_px, 0.05..=20.0)?;
        ConfigError::unless_in("rate_hz", self.rate_hz, 0.1..=1000.0)?;
        ConfigError::unless_in("start_s", self.start_s, 0.0..=1e6)?;
        ConfigError::unless_in("pause_s", self.pause_s, 0.0..=1e6)?;
        ConfigError::unless_in("latency_ms", self.latency_ms, 0.0..=1000.0)?;
        ConfigError::unless_in("dropped", self.dropped, 0.0..=1.0)
    }

    /// Between two sets; a boundary code goes on without [s].
    fn pause_s(&self) -> f64 {
        if self.code == PatternCode::Boundary { 0.0 } else { self.pause_s }
    }

    /// The text of a `patterns.toml` for a projector of this size.
    pub fn manifest(&self, projector_px: [u32; 2]) -> String {
        let Self { code, ref order, steps, period_px, stripe_px, .. } = *self;
        let code = match code {
            PatternCode::Gray => "gray",
            PatternCode::Phase => "phase",
            PatternCode::Boundary => "boundary",
        };
        let [columns, rows] = projector_px;
        format!(
            "projector_px = [{columns}, {rows}]\ncode = \"{code}\"\norder = \"{order}\"\nsteps = {steps}\nperiod_px = {period_px}\nstripe_px = {stripe_px}\n"
        )
    }
}

/// Picture number `index` of set number `set`, commanded at `from`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureCommand {
    /// Of its set.
    pub set: u64,
    /// In its set.
    pub index: usize,
    /// When the projector is commanded [session clock].
    pub from: Time,
}

#[derive(Debug)]
struct Inner {
    name: String,
    id: CameraId,
    calibrated: Camera,
    settings: ProjectorSettings,
    pictures: Vec<Shown>,
    code: StripeCode,
    /// Of each picture, made on first use.
    profiles: Vec<OnceLock<Profile>>,
    lottery: u64,
}

/// A handle to what a simulated projector shows; cloning it is cheap.
#[derive(Debug, Clone)]
pub struct Projection(Arc<Inner>);

impl Message for Projection {
    const NAME: &'static str = "projection";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::Local;
}

impl Projection {
    /// Of the projector that a calibration calls `name` and says is like `calibrated`.
    ///
    /// # Errors
    /// Settings out of their ranges, or that make no code for its size.
    pub fn new(
        name: &str,
        id: CameraId,
        calibrated: &Camera,
        settings: &ProjectorSettings,
        random: &Random,
    ) -> Result<Projection, ConfigError> {
        settings.check()?;
        let code = settings.stripe_code(calibrated.image_size)?;
        let pictures = code.pictures();
        Ok(Projection(Arc::new(Inner {
            name: name.to_owned(),
            id,
            calibrated: calibrated.clone(),
            settings: settings.clone(),
            profiles: pictures.iter().map(|_| OnceLock::new()).collect(),
            pictures,
            code,
            lottery: random.fork("dropped").next_u64(),
        })))
    }

    /// Its name in the calibration.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Its number there.
    pub fn id(&self) -> CameraId {
        self.0.id
    }

    /// As the calibration has it.
    pub fn calibrated(&self) -> &Camera {
        &self.0.calibrated
    }

    /// Of black, relative to white.
    pub(crate) fn black(&self) -> f32 {
        1.0 / self.0.settings.contrast as f32
    }

    pub(crate) fn settings(&self) -> &ProjectorSettings {
        &self.0.settings
    }

    /// What the pictures of a set show, in order.
    pub fn pictures(&self) -> &[Shown] {
        &self.0.pictures
    }

    /// From one picture to the next.
    pub fn period(&self) -> Interval {
        Interval::from_s(1.0 / self.0.settings.rate_hz)
    }

    /// Picture number `number`, counted over all sets.
    pub fn command(&self, number: u64) -> PictureCommand {
        let n = self.0.pictures.len() as u64;
        let (set, index) = (number / n, number % n);
        let ProjectorSettings { rate_hz, start_s, .. } = self.0.settings;
        let set_s = n as f64 / rate_hz + self.0.settings.pause_s();
        PictureCommand {
            set,
            index: index as usize,
            from: Time::from_s(start_s + set as f64 * set_s + index as f64 / rate_hz),
        }
    }

    /// The picture that gives its light at `time`; `None` between sets, where it is black.
    pub fn shows(&self, time: Time) -> Option<usize> {
        let ProjectorSettings { rate_hz, start_s, latency_ms, dropped, .. } = self.0.settings;
        let n = self.0.pictures.len();
        let since_s = time.as_s() - latency_ms * 1e-3 - start_s;
        if since_s < 0.0 {
            return None;
        }
        let set_s = n as f64 / rate_hz + self.0.settings.pause_s();
        let set = (since_s / set_s).floor();
        // A nanosecond, so that a picture's first moment is its own.
        let mut index = ((since_s - set * set_s + 1e-9) * rate_hz).floor() as usize;
        if index >= n {
            return None;
        }
        let is_dropped = |number: i64| dropped > 0.0 && stream(self.0.lottery, 0, number).uniform() < dropped;
        let mut number = set as i64 * n as i64 + index as i64;
        // Of a code that goes on without a pause the picture before the first is the last.
        let first = if self.0.settings.code == PatternCode::Boundary { 0 } else { number - index as i64 };
        while number > first && is_dropped(number) {
            number -= 1;
            index = (index + n - 1) % n;
        }
        Some(index)
    }

    /// The light of picture `index`, relative to white.
    pub(crate) fn profile(&self, index: usize) -> &Profile {
        let Inner { code, pictures, settings, .. } = &*self.0;
        self.0.profiles[index].get_or_init(|| Profile::new(code, pictures[index], settings))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) fn projector() -> Camera {
        Camera::look_at([0.0, 0.0, 0.0].into(), [0.0, 2.0, 0.0].into(), [64, 48], 100.0)
    }

    fn projection(change: impl Fn(&mut ProjectorSettings)) -> Projection {
        let mut settings = ProjectorSettings { rate_hz: 50.0, start_s: 1.0, ..ProjectorSettings::default() };
        change(&mut settings);
        Projection::new("projector", CameraId(3), &projector(), &settings, &Random::new(4)).unwrap()
    }

    #[test]
    fn each_picture_shines_for_a_period_after_its_latency() {
        let projection = projection(|_| ());
        let n = projection.pictures().len() as u64;
        for number in [0, 1, 7, n - 1, n, 3 * n + 2] {
            let command = projection.command(number);
            let shows = |after_ms: f64| projection.shows(command.from + Interval::from_ms(after_ms));
            assert_eq!(shows(30.0), Some(command.index), "picture {number}");
            assert_eq!(shows(49.99), Some(command.index));
            assert_ne!(shows(29.99), Some(command.index));
        }
        assert_eq!(projection.shows(Time::from_s(1.0)), None);
        assert_eq!(projection.shows(projection.command(n - 1).from + Interval::from_ms(55.0)), None);
    }

    #[test]
    fn a_boundary_code_goes_on_without_a_pause_and_leaves_the_last_picture_where_the_first_is_dropped() {
        let projection = |dropped: f64| projection(|it| (it.code, it.dropped) = (PatternCode::Boundary, dropped));
        let shows = |projection: &Projection, number: u64| {
            projection.shows(projection.command(number).from + Interval::from_ms(31.0))
        };
        let all = projection(0.0);
        assert!(all.pictures().len() == 4 && (0..400).all(|it| shows(&all, it) == Some(it as usize % 4)));
        let some = projection(0.3);
        assert!((1..400).any(|it| it % 4 == 0 && shows(&some, it) == Some(3)));
    }

    #[test]
    fn dropped_pictures_leave_the_one_before() {
        let projection = projection(|it| it.dropped = 0.2);
        let late = |number: u64| {
            let command = projection.command(number);
            projection.shows(command.from + Interval::from_ms(31.0)).is_none_or(|it| it != command.index)
        };
        let share = (0..4000).filter(|it| late(*it)).count() as f64 / 4000.0;
        assert!((0.15..0.23).contains(&share), "{share}");
    }

    #[test]
    fn settings_that_make_no_code_are_refused() {
        let refused = |change: fn(&mut ProjectorSettings)| {
            let mut settings = ProjectorSettings::default();
            change(&mut settings);
            let made = Projection::new("projector", CameraId(3), &projector(), &settings, &Random::new(4));
            made.err().and_then(|it| it.setting)
        };
        assert_eq!(refused(|_| ()), None);
        assert_eq!(refused(|it| it.period_px = 12).as_deref(), Some("period_px"));
        assert_eq!(refused(|it| it.stripe_px = 1).as_deref(), Some("stripe_px"));
        assert_eq!(refused(|it| it.order = "white columms".to_owned()).as_deref(), Some("order"));
        assert_eq!(refused(|it| it.gamma = f64::NAN).as_deref(), Some("gamma"));
        assert_eq!(refused(|it| it.contrast = 1.0).as_deref(), Some("contrast"));
    }
}
