//! `led.reprojection`: reprojection errors of recovered targets, in pixels.

mod comparison;
mod distribution;

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use comparison::{Comparison, ComparisonOptions};
pub use distribution::Distribution;

ports! {
    FEATURES: In<Features> = each("features").many();
    TARGETS: In<Targets> = each("targets");
}

figures! {
    "reprojection_px.{median,p90,max}": px, low, "Distance of a feature from the projection of its target, over frames that min_cameras agree on; features farther than gate_px are left out" => "re-projection error";
        "reprojection_px.count": count, neither, "Features included in these distances";
    "reprojection_px.median.*": px, low, "Median of that distance over the features of one camera";
    "frames_recovered": count, high, "Capture times with a measured target that min_cameras agree with" => "frames recovered";
    "frames_seen": count, neither, "Capture times with any feature at all";
    "outliers_rejected": count, low, "Features of recovered frames that agree with no recovered target";
    "reprojection.messages_late": count, low, "Messages that came after their frame was settled; not used";
}

/// Settings of [`Reprojection`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReprojectionSettings {
    /// Cameras that must agree with a target at one capture time for the frame to count as recovered. With cameras that are
    /// not synchronised no two share a capture time: 1 then measures each camera's residuals alone [–].
    #[schemars(range(min = 1, max = 1000))]
    pub min_cameras: u32,
    /// Largest distance between a feature and a target's projection for agreement [px].
    #[schemars(range(min = 0.01, max = 10000.0))]
    pub gate_px: f64,
    /// Time after capture when a frame is settled: later messages about it are counted and not used [ms].
    #[schemars(range(min = 0.0, max = 600000.0))]
    pub settle_after_ms: f64,
}

impl Default for ReprojectionSettings {
    fn default() -> Self {
        Self { min_cameras: 3, gate_px: 8.0, settle_after_ms: 1000.0 }
    }
}

/// Figures of the distance between each recovered target's projection and the feature nearest to it.
///
/// The residual is that of the position as sent, not of a new fit. Targets that are not `measured` are left out,
/// and so are those that fewer than `min_cameras` cameras agree with.
pub struct Reprojection {
    comparison: Comparison,
    camera_names: Vec<String>,
}

impl Node for Reprojection {
    const TYPE: &'static str = "led.reprojection";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Compares recovered targets with the features of the cameras, in pixels";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ReprojectionSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ReprojectionSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("min_cameras", settings.min_cameras, 1..=1000)?;
        ConfigError::unless_in("gate_px", settings.gate_px, 0.01..=1e4)?;
        ConfigError::unless_in("settle_after_ms", settings.settle_after_ms, 0.0..=6e5)?;
        let cameras = &setup.calibration.cameras;
        if cameras.is_empty() {
            return Err(ConfigError::node("found no camera in the calibration, expected at least 1"));
        }
        let options = ComparisonOptions {
            min_cameras: settings.min_cameras as usize,
            gate: settings.gate_px,
            settle_after: Interval::from_ms(settings.settle_after_ms),
        };
        let models = cameras.iter().map(|it| it.camera.clone()).collect();
        let camera_names = cameras.iter().map(|it| it.name.clone()).collect();
        Ok(Self { comparison: Comparison::new(options, models), camera_names })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(features) = io.take(&FEATURES) {
            self.comparison.add_features(features.time(), &features.value);
        } else if let Some(targets) = io.take(&TARGETS) {
            self.comparison.add_targets(&targets.value);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.comparison.finish();
        let all = &self.comparison.all;
        report.figure("reprojection_px.median", all.quantile(0.5));
        report.figure("reprojection_px.p90", all.quantile(0.9));
        report.figure("reprojection_px.max", all.max());
        report.figure("reprojection_px.count", all.count() as f64);
        for (own, name) in self.comparison.by_camera.iter().zip(&self.camera_names) {
            report.figure(format!("reprojection_px.median.{name}"), own.quantile(0.5));
        }
        report.figure("frames_recovered", self.comparison.frames_recovered as f64);
        report.figure("frames_seen", self.comparison.frames_seen as f64);
        report.figure("outliers_rejected", self.comparison.outliers_rejected as f64);
        report.figure("reprojection.messages_late", self.comparison.late as f64);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        check_node::<Reprojection>("");
        check_node::<Reprojection>("gate_px = 3.5\nmin_cameras = 4");
    }
}
