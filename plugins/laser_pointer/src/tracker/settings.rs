//! Settings of the tracker.

use std::collections::BTreeSet;

use foveate::prelude::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of [`Tracker`](super::Tracker).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrackerSettings {
    /// The file with the maps of the cameras, written by `laser_pointer.calibrator`. `${NAME}` is an environment variable; a relative path starts at the
    /// rig's folder [–]
    pub map: String,
    /// Smallest ratio of a pointer's brightness to the largest brightness of the wall itself; saturated pixels count as bright enough [–]
    #[schemars(range(min = 0.0, max = 100.0))]
    #[serde(default = "default_brighter")]
    pub brighter: f64,
    /// Largest spot, as the square root of its area on the wall; fast pointers are smeared [mm]
    #[schemars(range(min = 1.0, max = 1000.0))]
    #[serde(default = "default_largest_mm")]
    pub largest_mm: f64,
    /// White-noise acceleration of a pointer, spectral density [m²/s³]
    #[schemars(range(min = 1e-6, max = 1e6))]
    #[serde(default = "default_acceleration_density")]
    pub acceleration_density: f64,
    /// Standard deviation of a new pointer's speed along each axis [m/s]
    #[schemars(range(min = 0.01, max = 100.0))]
    #[serde(default = "default_speed")]
    pub speed: f64,
    /// Gate: an observation belongs to a pointer when it is at most this many standard deviations from the predicted place [σ]
    #[schemars(range(min = 1.0, max = 20.0))]
    #[serde(default = "default_gate_sigmas")]
    pub gate_sigmas: f64,
    /// A pointer ends when no camera has seen it for this long [ms]
    #[schemars(range(min = 1.0, max = 10000.0))]
    #[serde(default = "default_lost_ms")]
    pub lost_ms: f64,
    /// Spots of two pointers closer to each other than this are one in the pictures [mm]
    #[schemars(range(min = 0.0, max = 1000.0))]
    #[serde(default = "default_merge_mm")]
    pub merge_mm: f64,
    /// A new spot this near to a larger one, and horizontally or vertically aligned with it, may be its reflection in a bezel: it must leave that line before it is a pointer [mm]
    #[schemars(range(min = 0.0, max = 10000.0))]
    #[serde(default = "default_reflection_mm")]
    pub reflection_mm: f64,
    /// Frames in which a new pointer must be seen where only one camera sees the place [frames]
    #[schemars(range(min = 1, max = 100))]
    #[serde(default = "default_alone_frames")]
    pub alone_frames: u32,
    /// A camera certainly sees a place that is at least this far inside its picture [px]
    #[schemars(range(min = 0.0, max = 1000.0))]
    #[serde(default = "default_margin_px")]
    pub margin_px: f64,
    /// Error of the cameras' maps in addition to that stated in the calibration, standard deviation along each axis [mm]
    #[schemars(range(min = 0.0, max = 100.0))]
    #[serde(default = "default_map_mm")]
    pub map_mm: f64,
    /// Users whose pointers have a colour of their own, or blink in a period of their own, at least 5 % apart from each other. Left out: users are not distinguished [–]
    #[serde(default)]
    pub users: Vec<UserCode>,
    /// Dark time of such a pointer: more than a frame and an exposure of the cameras; `lost_ms` must bridge it and two frames [ms]
    #[schemars(range(min = 1.0, max = 1000.0))]
    #[serde(default = "default_dark_ms")]
    pub dark_ms: f64,
    /// Probability from which a pointer's user counts as decided; at 1 it never does [–]
    #[schemars(range(min = 0.5, max = 1.0))]
    #[serde(default = "default_sure")]
    pub sure: f64,
}

/// What distinguishes a user's pointer: a colour, a blink code, or both.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct UserCode {
    /// The user's number in outputs [–]
    pub user: u32,
    /// Period of the blink code; twice `dark_ms` or more. Left out: the light is steady [ms]
    #[schemars(range(min = 35.0, max = 300.0))]
    #[serde(default)]
    pub period_ms: Option<f64>,
    /// The label that `led.detector` gives spots of the pointer's colour. Left out: no colour [–]
    #[serde(default)]
    pub colour: Option<u32>,
}

/// Smallest relative difference of periods that can be distinguished within a stroke [–].
const LEAST_APART: f64 = 0.05;
/// Longest period of a code: a longer one takes several seconds to decode [ms].
const MOST_PERIOD_MS: f64 = 300.0;

fn default_brighter() -> f64 {
    1.2
}

fn default_largest_mm() -> f64 {
    40.0
}

fn default_acceleration_density() -> f64 {
    10.0
}

fn default_speed() -> f64 {
    2.0
}

fn default_gate_sigmas() -> f64 {
    4.0
}

fn default_lost_ms() -> f64 {
    50.0
}

fn default_merge_mm() -> f64 {
    14.0
}

fn default_reflection_mm() -> f64 {
    150.0
}

fn default_alone_frames() -> u32 {
    3
}

fn default_margin_px() -> f64 {
    6.0
}

fn default_map_mm() -> f64 {
    0.3
}

fn default_dark_ms() -> f64 {
    20.0
}

fn default_sure() -> f64 {
    0.995
}

impl Default for TrackerSettings {
    fn default() -> Self {
        Self {
            map: String::new(),
            brighter: default_brighter(),
            largest_mm: default_largest_mm(),
            acceleration_density: default_acceleration_density(),
            speed: default_speed(),
            gate_sigmas: default_gate_sigmas(),
            lost_ms: default_lost_ms(),
            merge_mm: default_merge_mm(),
            reflection_mm: default_reflection_mm(),
            alone_frames: default_alone_frames(),
            margin_px: default_margin_px(),
            map_mm: default_map_mm(),
            users: Vec::new(),
            dark_ms: default_dark_ms(),
            sure: default_sure(),
        }
    }
}

impl TrackerSettings {
    /// Checks the range of each setting.
    ///
    /// # Errors
    /// The first setting out of its range, what was found, and the range.
    pub fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("brighter", self.brighter, 0.0..=100.0)?;
        ConfigError::unless_in("largest_mm", self.largest_mm, 1.0..=1000.0)?;
        ConfigError::unless_in("acceleration_density", self.acceleration_density, 1e-6..=1e6)?;
        ConfigError::unless_in("speed", self.speed, 0.01..=100.0)?;
        ConfigError::unless_in("gate_sigmas", self.gate_sigmas, 1.0..=20.0)?;
        ConfigError::unless_in("lost_ms", self.lost_ms, 1.0..=10_000.0)?;
        ConfigError::unless_in("merge_mm", self.merge_mm, 0.0..=1000.0)?;
        ConfigError::unless_in("reflection_mm", self.reflection_mm, 0.0..=10_000.0)?;
        ConfigError::unless_in("alone_frames", self.alone_frames, 1..=100)?;
        ConfigError::unless_in("margin_px", self.margin_px, 0.0..=1000.0)?;
        ConfigError::unless_in("map_mm", self.map_mm, 0.0..=100.0)?;
        ConfigError::unless_in("dark_ms", self.dark_ms, 1.0..=1000.0)?;
        ConfigError::unless_in("sure", self.sure, 0.5..=1.0)?;
        self.check_users()
    }

    fn check_users(&self) -> Result<(), ConfigError> {
        let blinks = self.users.iter().any(|it| it.period_ms.is_some());
        if blinks && self.lost_ms <= self.dark_ms {
            let message = format!(
                "found {} ms, expected more than the {} ms of `dark_ms` and two frames: pointers that go dark are lost each time",
                self.lost_ms, self.dark_ms
            );
            return Err(ConfigError::at("lost_ms", message));
        }
        if blinks && 2.0 * self.dark_ms > MOST_PERIOD_MS {
            let message = format!(
                "found {} ms, expected at most {} ms, half of the longest `period_ms`",
                self.dark_ms,
                MOST_PERIOD_MS / 2.0
            );
            return Err(ConfigError::at("dark_ms", message));
        }
        let mut numbers = BTreeSet::new();
        for (place, it) in self.users.iter().enumerate() {
            let setting = format!("users[{place}]");
            let least = (2.0 * self.dark_ms).max(35.0);
            if let Some(period_ms) = it.period_ms {
                ConfigError::unless_in(&format!("{setting}.period_ms"), period_ms, least..=MOST_PERIOD_MS)?;
            }
            if it.period_ms.is_none() && it.colour.is_none() {
                let message =
                    format!("found user {} with neither, expected a `colour`, a `period_ms`, or both", it.user);
                return Err(ConfigError::at(&setting, message));
            }
            if !numbers.insert(it.user) {
                let message = format!("found user {} twice, expected each user once", it.user);
                return Err(ConfigError::at(&setting, message));
            }
            self.check_apart(place, &setting)?;
        }
        Ok(())
    }

    /// Whether this user can be distinguished from those before it in the list.
    fn check_apart(&self, place: usize, setting: &str) -> Result<(), ConfigError> {
        let it = &self.users[place];
        for other in &self.users[..place] {
            if let (Some(one), Some(two)) = (other.period_ms, it.period_ms)
                && (two / one).ln().abs() < LEAST_APART.ln_1p()
            {
                let message = format!("found periods of {one} ms and {two} ms, expected them to be 5 % apart or more");
                return Err(ConfigError::at(setting, message));
            }
            let is_alike = it.colour.is_some() && it.colour == other.colour;
            if is_alike && (it.period_ms.is_none() || other.period_ms.is_none()) {
                let message = format!(
                    "found the colour of user {} again, expected another one, or a `period_ms` for both",
                    other.user
                );
                return Err(ConfigError::at(setting, message));
            }
        }
        Ok(())
    }
}
