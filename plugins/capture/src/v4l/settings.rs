//! Settings of `capture.v4l`.

use std::collections::BTreeMap;

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::device::FourCc;
use crate::settings::Format;

/// Settings of [`V4l`](super::V4l).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct V4lSettings {
    /// The device: `/dev/video0`, or a name that stays when cables are moved, as `/dev/v4l/by-id/…`; `{camera}` is the camera's name,
    /// `${NAME}` an environment variable [–]
    pub device: String,
    /// Columns of a picture; left out: as the calibration says, or without one as the device is set [px]
    #[serde(default)]
    #[schemars(range(min = 1, max = 65535))]
    pub width: Option<u32>,
    /// Rows of a picture; left out: as the calibration says, or without one as the device is set [px]
    #[serde(default)]
    #[schemars(range(min = 1, max = 65535))]
    pub height: Option<u32>,
    /// Requested pixel layout of the device, by its four letters: `GREY`, `YUYV`, `UYVY`, `MJPG`, `RGB3`, `BGR3`,
    /// `Y10`, `Y12`, `Y16`; `auto`: the cheapest to decode among those with the size and the rate [–]
    #[serde(default = "default_device_format")]
    pub device_format: String,
    /// Format that pictures are converted to [–]
    #[serde(default)]
    pub format: Format,
    /// Frame rate; left out: as the device is set [Hz]
    #[serde(default)]
    #[schemars(range(min = 0.01, max = 100000.0))]
    pub rate_hz: Option<f64>,
    /// Exposure of each picture; 0: automatic exposure; left out: as the device is set [us]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 100000000.0), extend("live" = true))]
    pub exposure_us: Option<f64>,
    /// Amplification, in the device's own steps; left out: as the device is set [–]
    #[serde(default)]
    #[schemars(extend("live" = true))]
    pub gain: Option<i32>,
    /// Other controls of the device, by the names that `foveate devices` shows: a number, true or false, or an item of a menu by its name [–]
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(extend("default" = {}, "live" = true))]
    pub controls: BTreeMap<String, ControlValue>,
    /// Buffers that the driver fills in turn: more of them let a slow reader lose fewer pictures [–]
    #[serde(default = "default_buffers")]
    #[schemars(range(min = 2, max = 32))]
    pub buffers: u32,
    /// Time without a picture after which the stream is started again [ms]
    #[serde(default = "default_timeout_ms")]
    #[schemars(range(min = 20.0, max = 600000.0))]
    pub timeout_ms: f64,
    /// Delay of the driver's time stamp after the middle of the exposure; subtracted [ms]
    #[serde(default)]
    #[schemars(range(min = -1000.0, max = 1000.0))]
    pub stamp_delay_ms: f64,
}

/// Value of a control.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum ControlValue {
    /// A switch.
    Switch(bool),
    /// A number, or the number of a menu's item.
    Number(i32),
    /// An item of a menu, by its name.
    Item(String),
}

fn default_device_format() -> String {
    "auto".to_owned()
}

fn default_buffers() -> u32 {
    4
}

fn default_timeout_ms() -> f64 {
    1000.0
}

impl V4lSettings {
    /// Checks what can be checked without the device.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        for (name, side) in [("width", self.width), ("height", self.height)] {
            ConfigError::unless_in(name, side.unwrap_or(1), 1..=65_535)?;
        }
        self.fourcc()?;
        ConfigError::unless_in("rate_hz", self.rate_hz.unwrap_or(1.0), 0.01..=100_000.0)?;
        ConfigError::unless_in("exposure_us", self.exposure_us.unwrap_or(0.0), 0.0..=1e8)?;
        ConfigError::unless_in("buffers", self.buffers, 2..=32)?;
        ConfigError::unless_in("timeout_ms", self.timeout_ms, 20.0..=600_000.0)?;
        ConfigError::unless_in("stamp_delay_ms", self.stamp_delay_ms, -1000.0..=1000.0)
    }

    /// The requested layout; `None`: any.
    pub(crate) fn fourcc(&self) -> Result<Option<FourCc>, ConfigError> {
        let name = self.device_format.as_str();
        if name == "auto" {
            return Ok(None);
        }
        let padded = format!("{name:4}").to_ascii_uppercase();
        let readable = super::pixels::readable(self.format);
        match readable.iter().find(|it| it.as_slice() == padded.as_bytes()) {
            Some(&fourcc) => Ok(Some(fourcc)),
            None => {
                let known: Vec<String> =
                    readable.iter().map(|it| format!("`{}`", super::pixels::in_letters(*it).trim_end())).collect();
                let message = format!("found `{name}`, expected `auto` or one of {}", known.join(", "));
                Err(ConfigError::at("device_format", message))
            }
        }
    }
}
