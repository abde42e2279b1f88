//! How well people are segmented from the background: silhouettes against the truth of the simulated studio.

use std::collections::BTreeMap;
use std::sync::Arc;

use foveate_estimation::statistics::percentile;
use foveate_messages::{CameraId, Silhouette};
use foveate_node::{ConfigError, Figures, Io, Node, NodeError, Ports, Report, Role, Setup, figures, ports};
use foveate_scene::calibration::Calibration;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::cloud_score::true_camera;
use crate::camera::PeopleView;
use crate::head::HeadMotion;
use crate::score::silhouette::Overlap;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    MOTION: In<HeadMotion> = latest("motion").many().optional();
    SILHOUETTE: In<Silhouette> = each("silhouette").many();
}

figures! {
    "silhouette.iou.{median,worst}": share, high, "Pixels that are body both truly and in the silhouette, over pixels that are in either, one value a silhouette of at least least_px true pixels; those that are marked as not to be used are left out" => "silhouettes: intersection over union with the truth";
    "silhouette.missed": share, low, "Body's true pixels that the silhouettes lack, over all true ones of the same silhouettes";
    "silhouette.extra": share, low, "Pixels of these silhouettes that are not body, over all true ones";
    "silhouette.shadow": share, low, "Those of them where people block a tenth of the light or more: shadows taken for body, over all true pixels";
    "silhouette.holes": share, low, "True pixels with true ones 3 px to all four sides that the silhouettes lack, over all such pixels";
    "silhouette.nobody_px": px, low, "Median of the pixels of silhouettes without a true person";
    "silhouette.pictures": count, neither, "Silhouettes that were compared";
    "silhouette.unusable": count, low, "Silhouettes that are marked as not to be used: left out of all of these";
}

/// Settings of [`SilhouetteScore`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SilhouetteScoreSettings {
    /// Silhouettes with fewer true pixels count only in `silhouette.nobody_px`, where there are none [px]
    pub least_px: usize,
    /// Silhouettes of earlier times are not scored [s]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub start_s: f64,
}

impl Default for SilhouetteScoreSettings {
    fn default() -> Self {
        Self { least_px: 200, start_s: 0.0 }
    }
}

/// Compares silhouettes with what the centre of each pixel truly sees at their time.
pub struct SilhouetteScore {
    settings: SilhouetteScoreSettings,
    calibration: Arc<Calibration>,
    views: BTreeMap<CameraId, PeopleView>,
    overlaps: Vec<Overlap>,
    /// Pixels of silhouettes without a person.
    of_nobody: Vec<f64>,
    n_unusable: usize,
}

impl Node for SilhouetteScore {
    const TYPE: &'static str = "sim.silhouette_score";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Compares silhouettes with the true ones: overlap, shadows taken for body, holes";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = SilhouetteScoreSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: SilhouetteScoreSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("start_s", settings.start_s, 0.0..=1e6)?;
        Ok(Self {
            settings,
            calibration: Arc::clone(&setup.calibration),
            views: BTreeMap::new(),
            overlaps: Vec::new(),
            of_nobody: Vec::new(),
            n_unusable: 0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(silhouette) = io.take(&SILHOUETTE) {
            let time = silhouette.stamp.time;
            let Some(world) = io.latest(&WORLD).map(|it| it.value.clone()) else { continue };
            let Some(studio) = world.studio() else { continue };
            if time.as_s() < self.settings.start_s {
                continue;
            }
            if !silhouette.value.status.is_usable() {
                self.n_unusable += 1;
                continue;
            }
            let motions = io.latest_of_each(&MOTION).map(|it| it.value);
            let id = silhouette.value.camera;
            let Some(camera) = true_camera(&self.calibration, &world, motions, id, time) else { continue };
            let view = self.views.entry(id).or_default();
            view.look(&world, &camera, time);
            let Some(overlap) = Overlap::of(&silhouette.value, camera.image_size, view, studio) else {
                let [width, height] = camera.image_size;
                let message = format!(
                    "found a silhouette of {} x {} px, expected one of the camera's whole picture of {width} x {height} px or of a part of it",
                    silhouette.value.width, silhouette.value.height
                );
                return Err(NodeError::input(message));
            };
            if overlap.n_true >= self.settings.least_px.max(1) {
                self.overlaps.push(overlap);
            } else if overlap.n_true == 0 {
                self.of_nobody.push(overlap.n_found as f64);
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("silhouette.pictures", self.overlaps.len() as f64);
        report.figure("silhouette.unusable", self.n_unusable as f64);
        if let Some(pixels) = percentile(&self.of_nobody, 50.0) {
            report.figure("silhouette.nobody_px", pixels);
        }
        if self.overlaps.is_empty() {
            report.remark("No silhouette of a person was compared.");
            return Ok(());
        }
        let ratios: Vec<f64> = self.overlaps.iter().map(Overlap::intersection_over_union).collect();
        let of = |percent: f64| percentile(&ratios, percent).unwrap_or(f64::NAN);
        report.figure("silhouette.iou.median", of(50.0));
        report.figure("silhouette.iou.worst", of(0.0));
        let sum = |count: fn(&Overlap) -> usize| self.overlaps.iter().map(count).sum::<usize>() as f64;
        let n_true = sum(|it| it.n_true);
        report.figure("silhouette.missed", sum(|it| it.n_true - it.n_both) / n_true);
        report.figure("silhouette.extra", sum(|it| it.n_found - it.n_both) / n_true);
        report.figure("silhouette.shadow", sum(|it| it.n_shadow) / n_true);
        report.figure("silhouette.holes", sum(|it| it.n_holes) / sum(|it| it.n_inside).max(1.0));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_the_law() {
        check_node::<SilhouetteScore>("");
        check_node::<SilhouetteScore>("least_px = 50\nstart_s = 1.5");
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let early = SilhouetteScoreSettings { start_s: -1.0, ..SilhouetteScoreSettings::default() };
        let refused = SilhouetteScore::new(early, &Setup::for_tests()).err().and_then(|it| it.setting);
        assert_eq!(refused.as_deref(), Some("start_s"));
    }
}
