//! What an ideal detector is like.

use foveate_node::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bump::BumpSettings;
use crate::timing::TimingSettings;

/// Timing and accuracy of an observer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ObserverSettings {
    /// Capture times, clock and delivery of its features.
    #[serde(flatten)]
    pub timing: TimingSettings,
    /// Standard deviation of a feature along a row; along a column it is that divided by the pixels' aspect. Stated as it is
    /// with each feature [px].
    #[schemars(range(min = 0.001, max = 20.0))]
    pub noise_px: f64,
    /// Share of the lights in view that are not found, drawn for each light and field [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub missed: f64,
    /// Features that are no light, anywhere in the picture: mean number in a field [–].
    #[schemars(range(min = 0.0, max = 200.0))]
    pub clutter: f64,
    /// Whether lights shine to one side and bodies hide them; otherwise bodies are of glass and lights shine all around [–].
    pub bodies: bool,
    /// Mean time between two moments from which on one light is hidden from one camera, by something that is not in the scene;
    /// 0: there are none [s].
    #[schemars(range(min = 0.0, max = 1e9))]
    pub hidden_every_s: f64,
    /// How long it then is hidden; less than `hidden_every_s` [s].
    #[schemars(range(min = 0.0, max = 1e9))]
    pub hidden_lasts_s: f64,
    /// Lights closer to each other than this along a row, or this divided by the pixels' aspect along a column, are found as one
    /// feature in their middle, whose stated covariance spans them [px].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub spot_width_px: f64,
    /// A camera that is knocked at some time and stays turned. Left out: none is [–].
    pub bump: Option<BumpSettings>,
}

impl Default for ObserverSettings {
    fn default() -> Self {
        Self {
            timing: TimingSettings::default(),
            noise_px: 0.1,
            missed: 0.01,
            clutter: 0.2,
            bodies: true,
            hidden_every_s: 0.0,
            hidden_lasts_s: 0.5,
            spot_width_px: 5.0,
            bump: None,
        }
    }
}

impl ObserverSettings {
    /// Refuses what is out of range or contradicts itself.
    ///
    /// # Errors
    /// The first such setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        self.timing.check()?;
        ConfigError::unless_in("noise_px", self.noise_px, 0.001..=20.0)?;
        ConfigError::unless_in("missed", self.missed, 0.0..=1.0)?;
        ConfigError::unless_in("clutter", self.clutter, 0.0..=200.0)?;
        ConfigError::unless_in("hidden_every_s", self.hidden_every_s, 0.0..=1e9)?;
        ConfigError::unless_in("hidden_lasts_s", self.hidden_lasts_s, 0.0..=1e9)?;
        ConfigError::unless_in("spot_width_px", self.spot_width_px, 0.0..=100.0)?;
        if self.hidden_every_s > 0.0 && self.hidden_lasts_s >= self.hidden_every_s {
            let (lasts, every) = (self.hidden_lasts_s, self.hidden_every_s);
            let message = format!("found {lasts}, expected less than the {every} s of `hidden_every_s`");
            return Err(ConfigError::at("hidden_lasts_s", message));
        }
        Ok(())
    }
}
