//! The bodies of people: the built-in one, or those of recordings, each with its part of the area.

use std::sync::Arc;

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SceneSettings;
use crate::person::{RecordedBody, WholeBody};

/// Between the parts of the area that belong to people who go where a recording goes [m].
const APART_M: f64 = 0.5;

/// Source of a body's motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BodySource {
    /// Those of the file where it is, those that are built in otherwise: the report says which.
    #[default]
    Auto,
    /// A walk that is built in.
    BuiltIn,
    /// Those of the file, and no run without it.
    Bvh,
}

/// What of a recording moves a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BodyMotion {
    /// The directions of the limbs, on the built-in body and the way of `walk`.
    #[default]
    Limbs,
    /// All of it: bones of the recorded length, jumps, turns, and the way gone.
    Whole,
}

/// What bends the bodies of the people.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BodySettings {
    /// A BVH recording that is repeated without a jump. `${NAME}` is an environment variable; a relative path starts at the rig's folder [–]
    pub file: String,
    /// In place of `file`: several, one for each of the people in turn [–]
    pub files: Vec<String>,
    /// `limbs`: only the directions of the limbs are taken, of a recording with y up that lasts two seconds and two thirds or more; size, place and heading stay those of
    /// the built-in walk. `whole`: the person as recorded, of that size, with that way, in a part of `walk_area_m`; any axis may be up, half a second is enough, and where end
    /// and beginning are not alike it goes to and fro [–]
    pub motion: BodyMotion,
    /// With `motion = "whole"`: metres that one unit of length of the files is; the person may become 0.5 to 2.6 m tall. 0: inferred among the units in use from how tall the person is, 1.4 to 2.1 m before others [m].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub unit_m: f64,
    /// With `motion = "whole"`: which axis of the files points up; `auto`: found [–]
    pub up: UpAxis,
    /// `auto`: the file where it is, the built-in walk otherwise; `built_in`; `bvh`: the file, and no run without it [–]
    pub source: BodySource,
}

/// Which axis of a recording points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum UpAxis {
    /// Found.
    #[default]
    Auto,
    /// x.
    X,
    /// y.
    Y,
    /// z.
    Z,
}

impl UpAxis {
    /// 0, 1, 2 for x, y, z; `None`: found.
    pub(crate) fn axis(self) -> Option<usize> {
        match self {
            UpAxis::Auto => None,
            UpAxis::X => Some(0),
            UpAxis::Y => Some(1),
            UpAxis::Z => Some(2),
        }
    }
}

/// What a recording makes of a person.
#[derive(Debug, Clone)]
pub enum Body {
    /// A person on the path of `walk` whose limbs move as recorded.
    Limbs(Arc<RecordedBody>),
    /// A person as recorded.
    Whole(Arc<WholeBody>),
}

impl SceneSettings {
    /// The part of `walk_area_m` that each of the people has who go where a recording goes: side by side along the longer side [m].
    pub(crate) fn part_of_area_m(&self) -> [f64; 2] {
        let mut part = self.walk_area_m;
        let longer = usize::from(part[1] > part[0]);
        let n = self.people.max(1) as f64;
        part[longer] = (part[longer] / n - if self.people > 1 { APART_M } else { 0.0 }).max(0.0);
        part
    }

    /// The middle of that part [m].
    pub(super) fn place_of(&self, index: usize) -> Vector2<f64> {
        let longer = usize::from(self.walk_area_m[1] > self.walk_area_m[0]);
        let mut place = Vector2::zeros();
        place[longer] = self.walk_area_m[longer] * ((index as f64 + 0.5) / self.people.max(1) as f64 - 0.5);
        place
    }
}
