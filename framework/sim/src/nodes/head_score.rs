//! How well heads keep a target centred, and how accurate their stated poses are: against the truth.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use foveate_diagnostics::fields::number;
use foveate_estimation::statistics;
use foveate_geometry::Camera;
use foveate_messages::{CameraId, Features, HeadPose, TargetId};
use foveate_node::{
    ConfigError, Figures, Io, Node, NodeError, Ports, Purpose, Report, Role, Setup, Time, figures, ports,
};
use foveate_scene::calibration::Calibration;
use foveate_scene::selection::matches;
use nalgebra::{Point2, Point3, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::table::save_table;
use crate::head::HeadMotion;
use crate::score::follow_picture::{self, Track};
use crate::score::warmup::Warmup;
use crate::truth::TrueCamera;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    MOTION: In<HeadMotion> = latest("motion").many();
    FEATURES: In<Features> = each("features").many();
    POSE: In<HeadPose> = each("pose").many().optional();
}

figures! {
    "off_centre_px.{mean,median,p95}([*])": px, low, "Distance of the true target from the middle of the image, over the pictures of the cameras `of`; with [CAMERA] of that one" => "target off the middle of the picture";
    "in_view([*])": share, high, "Those of these pictures that have the target within their borders" => "pictures with the target in view";
    "pictures([*])": count, neither, "Pictures that were scored, since start_s";
    "head_pose_px.{median,p95}([*])": px, low, "Distance of where the stated pose sees the target from where it truly is, in pictures that have it";
    "head_pose_deg.rms([*])": deg, low, "Angle between the stated and the true line of sight, over all stated poses";
    "head_pose_sigmas.rms([*])": sigmas, neither, "Error of pan and tilt in their stated standard deviations; 1: as large as stated";
}

const TRACK_FILE: &str = "heads.csv";
const PICTURE_FILE: &str = "heads.svg";

/// Settings of [`HeadScore`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct HeadScoreSettings {
    /// The true target that the heads should have in the middle, by its number [–].
    pub target: u32,
    /// The cameras whose figures are those of the run, by name, `*` for any characters; the others are compared with [–].
    pub of: String,
    /// Session time at which scoring begins [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub start_s: f64,
    /// Whether each picture's figures are saved as `heads.csv`, and a picture of them as `heads.svg` [–].
    pub write: bool,
}

impl Default for HeadScoreSettings {
    fn default() -> Self {
        Self { target: 0, of: "*".to_owned(), start_s: 0.0, write: true }
    }
}

/// For each picture of a camera on a simulated head: how far the target truly is from its middle, and by how much the pose that was stated for it
/// is off.
///
/// What it reports: the figures declared for `sim.head_score`.
pub struct HeadScore {
    settings: HeadScoreSettings,
    calibration: Arc<Calibration>,
    folder: Option<PathBuf>,
    tracks: BTreeMap<CameraId, Track>,
    warmup: Warmup,
}

impl Node for HeadScore {
    const TYPE: &'static str = "sim.head_score";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str =
        "Measures how far targets are from the centres of head pictures, and errors of head poses";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = HeadScoreSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: HeadScoreSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("start_s", settings.start_s, 0.0..=1e6)?;
        if settings.write {
            setup.claim_file(Some("write"), TRACK_FILE)?;
            setup.claim_file(Some("write"), PICTURE_FILE)?;
        }
        let folder = setup.out_dir.clone().filter(|_| settings.write && setup.purpose == Purpose::Run);
        Ok(Self {
            settings,
            calibration: Arc::clone(&setup.calibration),
            folder,
            tracks: BTreeMap::new(),
            warmup: Warmup::default(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(pose) = io.take(&POSE) {
            return self.compare(&pose.value, io);
        }
        let Some(features) = io.take(&FEATURES) else { return Ok(()) };
        let (camera, time) = (features.value.camera, features.stamp.time);
        if !self.warmup.is_scored(time, self.settings.start_s) {
            return Ok(());
        }
        let Some((target, seen_by)) = self.truth(io, camera, time) else { return Ok(()) };
        let track = self.tracks.entry(camera).or_default();
        track.pictures.push((time, off_centre(&seen_by, &target), seen_by.sees(&target).is_some()));
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let name = |id: &CameraId| self.calibration.cameras.get(usize::from(id.0)).map_or("", |it| it.name.as_str());
        let mut all = Track::default();
        for (id, track) in &self.tracks {
            figures(track, &format!("[{}]", name(id)), report);
            if matches(&self.settings.of, name(id)) {
                all.pictures.extend(&track.pictures);
                all.poses.extend(track.poses.iter().cloned());
            }
        }
        if let Some(sentence) = self.warmup.remark(self.settings.start_s) {
            report.remark(format!("heads: {sentence}"));
        } else if all.pictures.is_empty() {
            let names: Vec<&str> = self.tracks.keys().map(name).collect();
            report.remark(format!(
                "No picture of the cameras `{}` was scored; pictures came from: {}.",
                self.settings.of,
                if names.is_empty() { "none".to_owned() } else { names.join(", ") }
            ));
        }
        figures(&all, "", report);
        let Some(folder) = &self.folder else { return Ok(()) };
        let named: Vec<(&str, &Track)> = self.tracks.iter().map(|(id, track)| (name(id), track)).collect();
        save_table(folder, TRACK_FILE, "camera,time_s,off_x_px,off_y_px,in_view", &rows(&named), report)?;
        report.save(folder, PICTURE_FILE, follow_picture::draw(&named))
    }
}

impl HeadScore {
    /// Where the target truly is at `time`, and the camera as it truly stands; `None` before the start, or where one of the two is not there.
    fn truth(&self, io: &Io<'_>, camera: CameraId, time: Time) -> Option<(Point3<f64>, TrueCamera)> {
        if time.as_s() < self.settings.start_s {
            return None;
        }
        let target = TargetId(self.settings.target);
        let truth = io.latest(&WORLD)?.value.truth(time);
        let position = truth.list.iter().find(|it| it.id == target)?.position;
        let calibrated = self.calibration.cameras.get(usize::from(camera.0))?;
        let at_rest = io.latest(&WORLD)?.value.camera(Some(&calibrated.name), &calibrated.camera);
        let mut motions = io.latest_of_each(&MOTION).map(|it| it.value);
        Some((position, motions.find(|it| it.camera() == camera)?.camera_at(&at_rest, time)))
    }

    /// The camera with the optics that the rig takes it to have.
    fn optics(&self, stated: &HeadPose) -> Option<Camera> {
        let named = self.calibration.cameras.get(usize::from(stated.camera.0))?;
        let mut camera = named.camera.clone();
        if let (Some(zoom), Some(head)) = (stated.zoom, self.calibration.head(&named.name))
            && let Some(table) = &head.model.zoom
        {
            (camera.intrinsics, camera.distortion) = table.optics_at(zoom);
        }
        Some(camera)
    }

    fn compare(&mut self, stated: &HeadPose, io: &Io<'_>) -> Result<(), NodeError> {
        let Some((target, truth)) = self.truth(io, stated.camera, stated.time) else { return Ok(()) };
        let Some(mut seen_by) = self.optics(stated) else { return Ok(()) };
        seen_by.camera_from_world = stated.camera_from_world;
        let forward = |camera: &Camera| camera.camera_from_world.inverse() * nalgebra::Vector3::z();
        let pixels = truth.sees(&target).and_then(|it| Some((seen_by.project(&target)? - it).norm()));
        let angles = io
            .latest_of_each(&MOTION)
            .find(|it| it.value.camera() == stated.camera)
            .map_or(stated.angles, |it| it.value.angles_at(stated.time));
        let error = Vector2::from(angles) - Vector2::from(stated.angles);
        let sigmas =
            stated.angles_covariance.try_inverse().map_or(f64::NAN, |it| (error.dot(&(it * error)) / 2.0).sqrt());
        let angle = forward(&truth).angle(&forward(&seen_by));
        self.tracks.entry(stated.camera).or_default().poses.push(follow_picture::PoseError {
            time: stated.time,
            pixels,
            angle,
            sigmas,
        });
        Ok(())
    }
}

/// Distance from the middle of the image; where the lens model has no answer, by the angle from the axis [px].
fn off_centre(camera: &TrueCamera, target: &Point3<f64>) -> Vector2<f64> {
    let [width, height] = camera.image_size.map(f64::from);
    let middle = Point2::new(0.5 * (width - 1.0), 0.5 * (height - 1.0));
    if let Some(pixel) = camera.project(target) {
        return pixel - middle;
    }
    let seen = camera.camera_from_world * target;
    let across = Vector2::new(seen.x, seen.y);
    let angle = across.norm().atan2(seen.z);
    let direction = if across.norm() > 0.0 { across.normalize() } else { Vector2::x() };
    direction * angle * camera.intrinsics.focal[0]
}

fn figures(track: &Track, suffix: &str, report: &mut Report) {
    let mut spread = |name: &str, values: &[f64], with_mean: bool| {
        if with_mean {
            report.figure(format!("{name}.mean{suffix}"), values.iter().sum::<f64>() / values.len() as f64);
        }
        report.figure(format!("{name}.median{suffix}"), statistics::median(values).unwrap_or(f64::NAN));
        report.figure(format!("{name}.p95{suffix}"), statistics::percentile(values, 95.0).unwrap_or(f64::NAN));
    };
    let off: Vec<f64> = track.pictures.iter().map(|it| it.1.norm()).collect();
    spread("off_centre_px", &off, true);
    let pixels: Vec<f64> = track.poses.iter().filter_map(|it| it.pixels).collect();
    if !track.poses.is_empty() {
        spread("head_pose_px", &pixels, false);
        let rms = |of: fn(&follow_picture::PoseError) -> f64| {
            (track.poses.iter().map(|it| of(it).powi(2)).sum::<f64>() / track.poses.len() as f64).sqrt()
        };
        report.figure(format!("head_pose_deg.rms{suffix}"), rms(|it| it.angle).to_degrees());
        report.figure(format!("head_pose_sigmas.rms{suffix}"), rms(|it| it.sigmas));
    }
    let seen = track.pictures.iter().filter(|it| it.2).count();
    report.figure(format!("in_view{suffix}"), seen as f64 / track.pictures.len() as f64);
    report.figure(format!("pictures{suffix}"), track.pictures.len() as f64);
}

fn rows(tracks: &[(&str, &Track)]) -> Vec<String> {
    let of = |name: &str, track: &Track| {
        let row = |(time, off, seen): &(Time, Vector2<f64>, bool)| {
            let [x, y] = [off.x, off.y].map(|it| number(it, 3));
            format!("{name},{:.6},{x},{y},{}", time.as_s(), u8::from(*seen))
        };
        track.pictures.iter().map(row).collect::<Vec<_>>()
    };
    tracks.iter().flat_map(|(name, track)| of(name, track)).collect()
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_the_law() {
        check_node::<HeadScore>("");
        check_node::<HeadScore>("target = 3\nof = \"ptz-1\"\nstart_s = 4\nwrite = false");
    }

    #[test]
    fn off_centre_is_in_pixels_and_grows_behind_the_camera() {
        let camera = Camera::look_at(Point3::origin(), Point3::new(0.0, 5.0, 0.0), [640, 480], 700.0);
        let off = |x: f64, y: f64| off_centre(&TrueCamera::from(&camera), &Point3::new(x, y, 0.0));
        assert!(off(0.0, 3.0).norm() < 1e-9);
        assert!((off(0.3, 3.0).x - 70.0).abs() < 1e-9);
        assert!(off(0.1, -3.0).norm() > 2000.0);
    }
}
