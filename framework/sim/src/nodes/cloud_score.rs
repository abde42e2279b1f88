//! How well the shape of a surface is recovered: against the truth of the simulated world.

use std::path::PathBuf;
use std::sync::Arc;

use foveate_diagnostics::fields::number;
use foveate_estimation::statistics::percentile;
use foveate_messages::{CameraId, Interval, PointCloud, Time};
use foveate_node::{ConfigError, Figures, Io, Node, NodeError, Ports, Purpose, Report, Role, Setup, figures, ports};
use foveate_scene::calibration::Calibration;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::table::save_table;
use crate::head::HeadMotion;
use crate::painted::Skin;
use crate::projector::{Beam, Projection};
use crate::score::cloud::{CloudTrack, Counts};
use crate::truth::TrueCamera;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    LIGHT: In<Projection> = latest("light");
    MOTION: In<HeadMotion> = latest("motion").many().optional();
    CLOUD: In<PointCloud> = each("cloud").many();
}

figures! {
    "depth_mm.{median,p95}": mm, low, "Distance of points from the true surface along the true line of sight of their pixel at the time of their cloud, over all clouds; where that just misses the surface, against the triangle that a neighbouring pixel sees; points that are wrong count, points of pixels that see no surface are left out" => "depth error";
    "depth_bias_mm": mm, neither, "Median of the same with its sign: above 0, points lie behind the surface";
    "coverage": share, high, "Pixels that see a part of the surface which the projector lights, within near_px of a point in the projector's picture, over all such pixels and clouds" => "part covered of what could be seen";
    "wrong_per_10000": ratio, low, "Points farther than wrong_mm from the true surface, or of pixels that do not see it and have no neighbour that does, for 10000 points" => "wrong points in 10,000";
    "clouds": count, high, "Clouds that were compared";
    "cloud_points": count, neither, "Points of these";
    "pixel_mm": mm, neither, "Distance between neighbouring pixels' lines of sight on the surface, median";
    "surface_speed.{median,max}": m_per_s, neither, "How fast the true surface moved, the median of its vertices, at the times of the clouds";
}

const TABLE_FILE: &str = "clouds.csv";
/// Over how long the speed of the surface is taken [s].
const SPEED_S: f64 = 2e-3;

/// Settings of [`CloudScore`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CloudScoreSettings {
    /// A point farther than this from the surface is wrong [mm]
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub wrong_mm: f64,
    /// The surface is covered where a point is at most this far away in the projector's picture [px]
    #[schemars(range(min = 0.1, max = 100.0))]
    pub near_px: f64,
    /// Clouds of earlier times are not scored [s]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub start_s: f64,
    /// Whether the figures of each cloud are saved as `clouds.csv` [–]
    pub write: bool,
}

impl Default for CloudScoreSettings {
    fn default() -> Self {
        Self { wrong_mm: 5.0, near_px: 2.0, start_s: 0.0, write: true }
    }
}

/// Compares point clouds with the true surface of a bust or of an actor's face.
pub struct CloudScore {
    settings: CloudScoreSettings,
    calibration: Arc<Calibration>,
    folder: Option<PathBuf>,
    beam: Option<Beam>,
    track: CloudTrack,
    /// Of each cloud [m/s].
    speeds: Vec<f64>,
    rows: Vec<String>,
}

impl Node for CloudScore {
    const TYPE: &'static str = "sim.cloud_score";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Compares point clouds with the true surface: depth, coverage, wrong points";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CloudScoreSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CloudScoreSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("wrong_mm", settings.wrong_mm, 1e-3..=1e3)?;
        ConfigError::unless_in("near_px", settings.near_px, 0.1..=100.0)?;
        ConfigError::unless_in("start_s", settings.start_s, 0.0..=1e6)?;
        if settings.write {
            setup.claim_file(Some("write"), TABLE_FILE)?;
        }
        Ok(Self {
            folder: setup.out_dir.clone().filter(|_| settings.write && setup.purpose == Purpose::Run),
            settings,
            calibration: Arc::clone(&setup.calibration),
            beam: None,
            track: CloudTrack::default(),
            speeds: Vec::new(),
            rows: Vec::new(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(cloud) = io.take(&CLOUD) {
            let time = cloud.value.time;
            let Some(world) = io.latest(&WORLD).map(|it| it.value.clone()) else { continue };
            let motions = io.latest_of_each(&MOTION).map(|it| it.value);
            let Some(camera) = true_camera(&self.calibration, &world, motions, cloud.value.camera, time) else {
                continue;
            };
            if self.beam.is_none() {
                self.beam = io.latest(&LIGHT).map(|it| Beam::new(it.value, &world));
            }
            if time.as_s() >= self.settings.start_s
                && let (Some(beam), Some((triangles, skin))) = (&mut self.beam, world.shape(time))
            {
                let before = self.track.counts();
                self.track.add(&cloud.value, &camera, (triangles, &skin), beam, self.settings.near_px);
                let speed = speed(&world, &skin, time);
                self.speeds.push(speed);
                self.rows.push(self.row(&cloud.value, before, speed));
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let track = &self.track;
        report.figure("clouds", track.n_clouds as f64);
        report.figure("cloud_points", track.n_points() as f64);
        if track.n_clouds == 0 {
            report.remark("No point cloud was recovered: no depth was scored.");
            return Ok(());
        }
        let off_mm: Vec<f64> = track.errors.iter().map(|it| it.abs() * 1e3).collect();
        let signed_mm: Vec<f64> = track.errors.iter().map(|it| it * 1e3).collect();
        let of = |list: &[f64], percent: f64| percentile(list, percent).unwrap_or(f64::NAN);
        report.figure("depth_mm.median", of(&off_mm, 50.0));
        report.figure("depth_mm.p95", of(&off_mm, 95.0));
        report.figure("depth_bias_mm", of(&signed_mm, 50.0));
        report.figure("coverage", track.n_covered as f64 / track.n_visible as f64);
        let wrong = track.n_wrong(self.settings.wrong_mm * 1e-3) as f64;
        report.figure("wrong_per_10000", wrong * 1e4 / track.n_points() as f64);
        report.figure("pixel_mm", of(&track.pixels_m, 50.0) * 1e3);
        report.figure("surface_speed.median", of(&self.speeds, 50.0));
        report.figure("surface_speed.max", of(&self.speeds, 100.0));
        match &self.folder {
            Some(folder) => save_table(folder, TABLE_FILE, HEADING, &self.rows, report),
            None => Ok(()),
        }
    }
}

const HEADING: &str = "time_s,camera,points,depth_mm_median,depth_mm_p95,coverage,wrong,surface_m_s";

impl CloudScore {
    /// What came with the last cloud, when `before` stood there before it.
    fn row(&self, cloud: &PointCloud, before: Counts, speed: f64) -> String {
        let now = self.track.counts();
        let off_mm: Vec<f64> = self.track.errors[before.n_errors..].iter().map(|it| it.abs() * 1e3).collect();
        let n_wrong = off_mm.iter().filter(|it| it.is_nan() || **it > self.settings.wrong_mm).count();
        let n_wrong = n_wrong + now.n_beside - before.n_beside;
        let of = |percent: f64| number(percentile(&off_mm, percent).unwrap_or(f64::NAN), 4);
        let covered = (now.n_covered - before.n_covered) as f64 / (now.n_visible - before.n_visible) as f64;
        let camera = self.calibration.cameras.get(usize::from(cloud.camera.0)).map_or("", |it| &it.name);
        format!(
            "{:.6},{camera},{},{},{},{},{n_wrong},{}",
            cloud.time.as_s(),
            cloud.len(),
            of(50.0),
            of(95.0),
            number(covered, 4),
            number(speed, 4)
        )
    }
}

/// How fast a surface moves in the median of its vertices [m/s].
fn speed(world: &World, skin: &Skin, time: Time) -> f64 {
    let Some((_, later)) = world.shape(time + Interval::from_s(SPEED_S)) else { return f64::NAN };
    let speeds: Vec<f64> =
        skin.vertices.iter().zip(&later.vertices).map(|(now, later)| (later - now).norm() / SPEED_S).collect();
    percentile(&speeds, 50.0).unwrap_or(f64::NAN)
}

/// The camera `id` as it truly stood at `time`, on a head where `motions` has one.
pub(super) fn true_camera<'a>(
    calibration: &Calibration,
    world: &World,
    mut motions: impl Iterator<Item = &'a HeadMotion>,
    id: CameraId,
    time: Time,
) -> Option<TrueCamera> {
    let calibrated = calibration.cameras.get(usize::from(id.0))?;
    let at_rest = world.camera(Some(&calibrated.name), &calibrated.camera);
    let motion = motions.find(|it| it.camera() == id);
    Some(motion.map_or(at_rest.clone(), |it| it.camera_at(&at_rest, time)))
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_the_law() {
        check_node::<CloudScore>("");
        check_node::<CloudScore>("wrong_mm = 2\nstart_s = 1.5");
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let refused = |settings| CloudScore::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting);
        let wrong = CloudScoreSettings { wrong_mm: f64::NAN, ..CloudScoreSettings::default() };
        assert_eq!(refused(wrong).as_deref(), Some("wrong_mm"));
        let near = CloudScoreSettings { near_px: 0.0, ..CloudScoreSettings::default() };
        assert_eq!(refused(near).as_deref(), Some("near_px"));
    }
}
