//! Settings of the shape model, with the reasons for their defaults.

use foveate::geometry::{AcquisitionOptions, ShapeKind};
use foveate::prelude::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Bases of a shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The most extreme of the captured shapes, with weights in 0..=1, as in [Davis 2002 §5.4].
    Faces,
    /// Principal components with their variances.
    #[default]
    Components,
}

/// Settings of [`Shape`](super::Shape).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ShapeSettings {
    /// An earlier model, written by `write`; a relative path starts at the rig's folder; empty: none [–]
    pub model: String,
    /// Without `model`: start of the interval of this session from which a model is acquired [s]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub acquire_from_s: f64,
    /// End of that interval, in which the person shows all movements of the face or knee; 0: no model, the surface is assumed to be rigid [s]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub acquire_until_s: f64,
    /// File of the results folder for the acquired model; empty: it is not written [–]
    pub write: String,
    /// Bases of a shape [–]
    pub kind: Kind,
    /// Most bases [–]
    #[schemars(range(min = 1, max = 1000))]
    pub bases: u32,
    /// Most frames for a model, evenly spread over those captured: time and memory grow with them [–]
    #[schemars(range(min = 2, max = 10000))]
    pub frames: u32,
    /// A frame is used for a model when it has at least this share of the marks; a mark is used when half of the frames have it [–]
    #[schemars(range(min = 0.3, max = 1.0))]
    pub complete: f64,
    /// Additional noise of a captured mark, one axis, beyond the marks' own covariances [mm]
    #[schemars(range(min = 0.001, max = 100.0))]
    pub noise_mm: f64,
    /// For components: allowed movement beyond the captured ones, correlated between neighbours, relative to a mark's captured movement [–]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub unseen: f64,
    /// Correlation length of such movement [mm]
    #[schemars(range(min = 0.1, max = 10000.0))]
    pub reach_mm: f64,
    /// A mark farther than this from its position by all others is wrong; it is filled instead [standard deviations]
    #[schemars(range(min = 3.0, max = 1000.0))]
    pub gate_sigmas: f64,
    /// A hidden mark with a larger standard deviation of one axis is left out rather than filled; 0: all are filled [mm]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub most_sigma_mm: f64,
    /// Fewest measured marks of the model for a fit [–]
    #[schemars(range(min = 3, max = 1000))]
    pub min_marks: u32,
}

impl Default for ShapeSettings {
    /// For a face of 40 to 80 marks, measured to a few tenths of a millimetre.
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

    /// Options for a model from marks with the standard deviation `sigma` [m].
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
