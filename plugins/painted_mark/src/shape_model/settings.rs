//! Settings of the model of shape, with the reasons for their defaults.

use foveate::geometry::{AcquisitionOptions, ShapeKind};
use foveate::prelude::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which bases a shape is put together from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The most extreme of the captured shapes, with weights in 0..=1, as [Davis 2002 §5.4].
    Faces,
    /// Principal components, with how much each was seen to vary.
    #[default]
    Components,
}

/// Settings of [`Shape`](super::Shape).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ShapeSettings {
    /// A model that was acquired before, as written by `write`; a relative path starts at the rig's folder; empty: there is none [–]
    pub model: String,
    /// Without `model`: a model is acquired from the frames of this session from this time on … [s]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub acquire_from_s: f64,
    /// … until this time, while somebody shows all that the face or knee can do; 0: no model, the surface is taken to be rigid [s]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub acquire_until_s: f64,
    /// File of the results folder for the acquired model; empty: it is not written [–]
    pub write: String,
    /// Which bases a shape is put together from [–]
    pub kind: Kind,
    /// Bases at most [–]
    #[schemars(range(min = 1, max = 1000))]
    pub bases: u32,
    /// Frames at most that a model is made from, evenly spread over those captured: time and memory grow with them [–]
    #[schemars(range(min = 2, max = 10000))]
    pub frames: u32,
    /// A frame counts while acquiring when it has at least this share of the marks, a mark when half of the frames have it [–]
    #[schemars(range(min = 0.3, max = 1.0))]
    pub complete: f64,
    /// Noise of a captured mark, one axis, at least: what the marks' own covariances leave out [mm]
    #[schemars(range(min = 0.001, max = 100.0))]
    pub noise_mm: f64,
    /// For components: how much of its movement a mark may make in ways that were not captured, together with its neighbours [–]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub unseen: f64,
    /// Marks this far apart still move together in such ways [mm]
    #[schemars(range(min = 0.1, max = 10000.0))]
    pub reach_mm: f64,
    /// A mark farther than this from where all others have it is not that mark; it is filled in its place [standard deviations]
    #[schemars(range(min = 3.0, max = 1000.0))]
    pub gate_sigmas: f64,
    /// A hidden mark of which more than this is stated, standard deviation of one axis, is left out rather than filled; 0: all are filled [mm]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub most_sigma_mm: f64,
    /// With fewer marks of the model measured there is no fit [–]
    #[schemars(range(min = 3, max = 1000))]
    pub min_marks: u32,
}

impl Default for ShapeSettings {
    /// For a face of 40 to 80 marks, seen with a few tenths of a millimetre.
    fn default() -> Self {
        Self {
            model: String::new(),
            acquire_from_s: 0.0,
            acquire_until_s: 0.0,
            write: String::new(),
            kind: Kind::Components,
            bases: 80,
            frames: 300,
            complete: 0.8,
            noise_mm: 0.2,
            unseen: 0.1,
            reach_mm: 20.0,
            gate_sigmas: 6.0,
            most_sigma_mm: 0.0,
            min_marks: 8,
        }
    }
}

impl ShapeSettings {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("acquire_from_s", self.acquire_from_s, 0.0..=1e6)?;
        ConfigError::unless_in("acquire_until_s", self.acquire_until_s, 0.0..=1e6)?;
        ConfigError::unless_in("bases", self.bases, 1..=1000)?;
        ConfigError::unless_in("frames", self.frames, 2..=10_000)?;
        ConfigError::unless_in("complete", self.complete, 0.3..=1.0)?;
        ConfigError::unless_in("noise_mm", self.noise_mm, 0.001..=100.0)?;
        ConfigError::unless_in("unseen", self.unseen, 0.0..=10.0)?;
        ConfigError::unless_in("reach_mm", self.reach_mm, 0.1..=10_000.0)?;
        ConfigError::unless_in("gate_sigmas", self.gate_sigmas, 3.0..=1000.0)?;
        ConfigError::unless_in("most_sigma_mm", self.most_sigma_mm, 0.0..=1000.0)?;
        ConfigError::unless_in("min_marks", self.min_marks, 3..=1000)?;
        let acquires = self.acquire_until_s > 0.0;
        if acquires && self.acquire_until_s <= self.acquire_from_s {
            let message =
                format!("{} s, expected later than acquire_from_s = {} s", self.acquire_until_s, self.acquire_from_s);
            return Err(ConfigError::at("acquire_until_s", message));
        }
        if acquires && !self.model.is_empty() {
            let message = format!("`{}` and acquire_until_s, expected one of the two", self.model);
            return Err(ConfigError::at("model", message));
        }
        if !acquires && !self.write.is_empty() {
            let message = format!("`{}`, expected acquire_until_s with it: no model is acquired", self.write);
            return Err(ConfigError::at("write", message));
        }
        Ok(())
    }

    /// How a model is made of marks that are known to `sigma` [m].
    pub(super) fn options(&self, sigma: f64) -> AcquisitionOptions {
        AcquisitionOptions {
            kind: match self.kind {
                Kind::Faces => ShapeKind::Faces,
                Kind::Components => ShapeKind::Components,
            },
            n_bases: self.bases as usize,
            noise: sigma.max(self.noise_mm * 1e-3),
            unseen: self.unseen,
            reach: self.reach_mm * 1e-3,
            ..AcquisitionOptions::default()
        }
    }
}
