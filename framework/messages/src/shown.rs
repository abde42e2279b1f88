//! What a projector shows, picture by picture.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::wire::portable;
use crate::{CameraId, Interval, Message, Quality, Space, Time, Wire};

/// One picture that a projector was commanded to show.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct PatternShown {
    /// The projector, which stands in the calibration like a camera.
    pub projector: CameraId,
    /// Number of the set that it belongs to, counted from 0.
    pub set: u64,
    /// Its place in that set.
    pub index: u32,
    /// How many pictures the set has.
    pub count: u32,
    /// What it shows, for people.
    pub name: String,
    /// When it was commanded; the light comes later by the projector's latency.
    pub from: Time,
    /// How long it is shown.
    pub lasts: Interval,
    /// The text of a `patterns.toml` that says which code the set carries.
    pub manifest: String,
}

impl Message for PatternShown {
    const NAME: &'static str = "pattern_shown";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = portable!(PatternShown);

    fn quality(&self) -> Quality {
        Quality { count: Some(self.count), sigma: None }
    }
}
