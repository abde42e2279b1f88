//! How well a surface is joined from clouds: against the truth of the simulated world, in the space of the thing itself.

use std::sync::Arc;

use foveate_estimation::statistics::percentile;
use foveate_messages::{Mesh, ScaleCloud};
use foveate_node::{ConfigError, Figures, Io, Node, NodeError, Ports, Report, Role, Setup, figures, ports};
use foveate_scene::calibration::Calibration;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::cloud_score::true_camera;
use crate::head::HeadMotion;
use crate::projector::{Beam, Projection};
use crate::score::surface::SurfaceTrack;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    LIGHT: In<Projection> = latest("light");
    MOTION: In<HeadMotion> = latest("motion").many().optional();
    JOINED: In<ScaleCloud> = each("joined");
    SURFACE: In<Mesh> = each("surface");
}

figures! {
    "surface.depth_mm.{median,p95}": mm, low, "Distance of the last surface's vertices from the nearest point of the true surface, as it lay at the surface's time; vertices that are wrong are left out" => "surface off the truth";
    "surface.depth_bias_mm": mm, neither, "Median of the same with its sign: above 0, vertices lie outside";
    "surface.normalised": ratio, neither, "Median distance over 0.6745 of each vertex's stated sigma: 1 is consistent; the sigmas do not include errors common to all clouds";
    "surface.complete": share, high, "Places of the true surface (one a cubic millimetre) that the camera of any joined cloud saw lit, within near_mm of a vertex, over all such places" => "part of the true surface that is covered";
    "surface.wrong_per_10000": ratio, low, "Vertices farther than wrong_mm from the true surface, for 10000";
    "surface.drift_mm.{median,max}": mm, low, "How far the middle of a joined cloud lies from where the first one would have it on the thing, by the poses that registration gave and the true ones";
    "surface.pose_normalised": ratio, neither, "Mean squared error of these poses over their covariances, per degree of freedom: 1 is consistent; errors of the first cloud's own camera pose come on top";
}

/// Settings of [`SurfaceScore`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SurfaceScoreSettings {
    /// A vertex farther than this from the surface is wrong [mm]
    #[schemars(range(min = 0.1, max = 100.0))]
    pub wrong_mm: f64,
    /// A place of the surface is covered where a vertex is at most this far away [mm]
    #[schemars(range(min = 0.1, max = 100.0))]
    pub near_mm: f64,
}

impl Default for SurfaceScoreSettings {
    fn default() -> Self {
        Self { wrong_mm: 5.0, near_mm: 2.0 }
    }
}

/// Compares a joined surface and the poses of its clouds with a bust or an actor's face.
pub struct SurfaceScore {
    settings: SurfaceScoreSettings,
    calibration: Arc<Calibration>,
    beam: Option<Beam>,
    track: SurfaceTrack,
    world: Option<World>,
    last: Option<Arc<Mesh>>,
}

impl Node for SurfaceScore {
    const TYPE: &'static str = "sim.surface_score";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Compares a fused surface with the true one: depth, completeness, drift";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = SurfaceScoreSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: SurfaceScoreSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("wrong_mm", settings.wrong_mm, 0.1..=100.0)?;
        ConfigError::unless_in("near_mm", settings.near_mm, 0.1..=100.0)?;
        let (calibration, track) = (Arc::clone(&setup.calibration), SurfaceTrack::default());
        Ok(Self { settings, calibration, beam: None, track, world: None, last: None })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(world) = io.latest(&WORLD) {
            self.world = Some(world.value.clone());
        }
        while let Some(cloud) = io.take(&JOINED) {
            let time = cloud.value.cloud.time;
            let Some(world) = self.world.clone() else { continue };
            let motions = io.latest_of_each(&MOTION).map(|it| it.value);
            let id = cloud.value.cloud.camera;
            let Some(camera) = true_camera(&self.calibration, &world, motions, id, time) else { continue };
            if self.beam.is_none() {
                self.beam = io.latest(&LIGHT).map(|it| Beam::new(it.value, &world));
            }
            if let (Some(beam), Some((triangles, skin))) = (&mut self.beam, world.shape(time)) {
                self.track.add(&cloud.value, &camera, (triangles, &skin), beam);
            }
        }
        while let Some(mesh) = io.take(&SURFACE) {
            self.last = Some(mesh.value);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let of = |list: &[f64], percent: f64| percentile(list, percent).unwrap_or(f64::NAN);
        let drifts = self.track.drifts();
        if !drifts.is_empty() {
            let mm: Vec<f64> = drifts.iter().map(|it| it.0 * 1e3).collect();
            report.figure("surface.drift_mm.median", of(&mm, 50.0));
            report.figure("surface.drift_mm.max", of(&mm, 100.0));
            let normalised = drifts.iter().map(|it| it.1).sum::<f64>() / drifts.len() as f64;
            report.figure("surface.pose_normalised", normalised);
            let off = normalised.sqrt();
            if off > SURE {
                report.remark(format!(
                    "The poses of joined clouds are off by {off:.0} times what their covariances state (root of the mean square; {:.2} mm in the median): do not weigh them by it.",
                    of(&mm, 50.0)
                ));
            }
        }
        let Some((mesh, world)) = self.last.take().zip(self.world.take()) else {
            report.remark("No surface was joined: none was scored.");
            return Ok(());
        };
        let Some((triangles, skin)) = world.shape(mesh.time) else { return Ok(()) };
        let SurfaceScoreSettings { wrong_mm, near_mm } = self.settings;
        let found = self.track.compare(&mesh, (triangles, &skin), 1e-3 * wrong_mm, 1e-3 * near_mm);
        let off_mm: Vec<f64> = found.errors.iter().map(|it| it.abs() * 1e3).collect();
        let signed_mm: Vec<f64> = found.errors.iter().map(|it| it * 1e3).collect();
        let normalised: Vec<f64> = found.normalised.iter().map(|it| it.abs() / 0.6745).collect();
        report.figure("surface.depth_mm.median", of(&off_mm, 50.0));
        report.figure("surface.depth_mm.p95", of(&off_mm, 95.0));
        report.figure("surface.depth_bias_mm", of(&signed_mm, 50.0));
        report.figure("surface.normalised", of(&normalised, 50.0));
        report.figure("surface.complete", found.n_complete as f64 / found.n_seen as f64);
        let n_vertices = (found.errors.len() + found.n_wrong) as f64;
        report.figure("surface.wrong_per_10000", 1e4 * found.n_wrong as f64 / n_vertices);
        let stated_mm: Vec<f64> = mesh.vertices().map(|it| 1e3 * f64::from(it.sigma)).collect();
        if let Some(remark) = about_sigma(of(&normalised, 50.0), of(&stated_mm, 50.0)) {
            report.remark(remark);
        }
        Ok(())
    }
}

/// Poses that are off by more than so many times what they state are remarked upon [–].
const SURE: f64 = 5.0;
/// A sigma that is right within this factor is not remarked upon [–].
const HONEST: f64 = 2.0;

/// Says so where vertices are off by clearly more or less than they state.
fn about_sigma(normalised: f64, stated_mm: f64) -> Option<String> {
    let is_honest = (1.0 / HONEST..=HONEST).contains(&normalised);
    (normalised.is_finite() && !is_honest).then(|| {
        format!(
            "The joined surface is off by {normalised:.2} times the sigma that its vertices state (median {stated_mm:.2e} mm), expected {:.1} to {HONEST:.1} times: do not weigh vertices by it.",
            1.0 / HONEST
        )
    })
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_the_law() {
        check_node::<SurfaceScore>("");
        check_node::<SurfaceScore>("wrong_mm = 2\nnear_mm = 1.5");
    }

    #[test]
    fn a_sigma_that_is_wrong_by_more_than_a_factor_of_two_is_remarked_upon() {
        assert_eq!(about_sigma(1.4, 0.05), None);
        assert_eq!(about_sigma(0.6, 0.05), None);
        assert_eq!(about_sigma(f64::NAN, 0.05), None);
        assert!(about_sigma(41.5, 0.002).unwrap().contains("off by 41.50 times"));
        assert!(about_sigma(0.3, 0.5).unwrap().contains("off by 0.30 times"));
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let near = SurfaceScoreSettings { near_mm: f64::NAN, ..SurfaceScoreSettings::default() };
        let refused = SurfaceScore::new(near, &Setup::for_tests()).err().and_then(|it| it.setting);
        assert_eq!(refused.as_deref(), Some("near_mm"));
    }
}
