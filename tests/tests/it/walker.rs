//! A man on a treadmill, recovered by `graphs/walker.toml` without lights, against the joints that a pose estimator found.
//!
//! `cargo test --release -p foveate-tests --test it walker -- --nocapture` prints the table of docs/results.md. The joints are those
//! of the data set's `openpose_2d` (BODY_25B): of each camera and frame the person of the highest total confidence, joints above
//! 0.3, put into space by the lines of sight of two cameras or more. A reference is the mean of its joints, in frames that have all of them.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;

use foveate::geometry::{Camera, triangulate_rays};
use foveate::scene::calibration::Calibration;
use foveate_engine::{self as engine, Options};
use foveate_rig::{self as rig, Overrides};
use nalgebra::{Point2, Point3, Vector3};
use serde_json::Value;

const FOLDER: &str = "s06_pose2sim_single";
const RATE_HZ: f64 = 60.0;
const N_FRAMES: usize = 100;
const MIN_CONFIDENCE: f64 = 0.3;
const SHOULDERS: [usize; 2] = [5, 6];
const HIPS: [usize; 2] = [11, 12];

/// What one camera saw of the person in one frame: pixel and confidence of each joint.
type Joints = Vec<(Point2<f64>, f64)>;

/// The positions of the one target, by frame. Of several samples of a frame the last counts.
fn recovered(data: &Path) -> BTreeMap<usize, Point3<f64>> {
    let path = foveate_testkit::data::workspace_root().join("graphs/walker.toml");
    let text = fs::read_to_string(&path).unwrap().replace("${FOVEATE_DATA}", data.to_str().unwrap());
    let registry = foveate_cli::registry();
    let graph = rig::load(&text, &path, &registry, &Overrides::default()).unwrap_or_else(|faults| panic!("{faults}"));
    let results = tempfile::tempdir().unwrap();
    let options = Options { out_dir: Some(results.path().to_owned()), ..Options::default() };
    engine::deterministic(Arc::new(graph), &options, &mut |_| ()).unwrap();
    let table = fs::read_to_string(results.path().join("targets.csv")).unwrap();
    let mut names = Vec::new();
    let rows = table.lines().skip(1).map(|row| {
        let cells: Vec<&str> = row.split(',').collect();
        names.push(cells[1].to_owned());
        let [time_s, x, y, z] = [0, 2, 3, 4].map(|it| cells[it].parse::<f64>().unwrap());
        ((time_s * RATE_HZ).round() as usize, Point3::new(x, y, z))
    });
    let positions = rows.collect();
    names.dedup();
    assert_eq!(names.len(), 1, "one man is one target: {names:?}");
    positions
}

/// The joints in a file of the pose estimator; none where it found nobody.
fn joints_of(path: &Path) -> Joints {
    let file: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    let person = |it: &Value| -> Joints {
        let numbers: Vec<f64> =
            it["pose_keypoints_2d"].as_array().unwrap().iter().map(|it| it.as_f64().unwrap()).collect();
        numbers.chunks_exact(3).map(|joint| (Point2::new(joint[0], joint[1]), joint[2])).collect()
    };
    let total = |it: &Joints| it.iter().map(|joint| joint.1).sum::<f64>();
    let people = file["people"].as_array().unwrap().iter().map(person);
    people.max_by(|a, b| total(a).total_cmp(&total(b))).unwrap_or_default()
}

/// By frame, by camera.
fn estimated(folder: &Path) -> Vec<[Joints; 4]> {
    let of = |frame: usize, camera: usize| {
        joints_of(&folder.join(format!("openpose_2d/cam0{camera}_json/cam0{camera}.{frame:04}.json")))
    };
    (0..N_FRAMES).map(|frame| [1, 2, 3, 4].map(|camera| of(frame, camera))).collect()
}

/// Mean of `joints` in space; `None` where one of them is not seen by two cameras.
fn reference(cameras: &[Camera], seen: &[Joints; 4], joints: &[usize]) -> Option<Point3<f64>> {
    let mut sum = Vector3::zeros();
    for &joint in joints {
        let rays = cameras.iter().zip(seen).filter_map(|(camera, seen)| {
            let &(pixel, confidence) = seen.get(joint)?;
            if confidence > MIN_CONFIDENCE { camera.ray(&pixel) } else { None }
        });
        sum += triangulate_rays(&rays.collect::<Vec<_>>())?.coords;
    }
    Some((sum / joints.len() as f64).into())
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[(share * (sorted.len() - 1) as f64).round() as usize]
}

#[test]
fn silhouettes_of_four_cameras_are_where_the_trunk_is() {
    let Some(folder) = foveate_testkit::data_dir_or_skip("walker", FOLDER) else { return };
    let has_ffmpeg = Command::new("ffmpeg").arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    if has_ffmpeg.is_err() {
        return println!("skipped: walker needs ffmpeg on the PATH");
    }
    let calibration = Calibration::load(&folder.join("Calib_qualisys.toml")).unwrap();
    let cameras = ["cam_01", "cam_02", "cam_03", "cam_04"].map(|name| calibration.camera(name).unwrap().clone());
    let (positions, seen) = (recovered(folder.parent().unwrap()), estimated(&folder));
    println!("target in {} of {N_FRAMES} frames", positions.len());
    println!("{:<14} {:>6} {:>8} {:>8} {:>8}  mean offset", "reference", "frames", "median", "p90", "max");
    let trunk = [SHOULDERS, HIPS].concat();
    let mut medians = Vec::new();
    for (name, joints) in [("trunk", &trunk[..]), ("mid-hip", &HIPS), ("mid-shoulder", &SHOULDERS)] {
        let errors = positions.iter().filter_map(|(&frame, position)| {
            let joint = reference(&cameras, seen.get(frame)?, joints)?;
            Some(position - joint)
        });
        let errors: Vec<Vector3<f64>> = errors.collect();
        let mut distances: Vec<f64> = errors.iter().map(Vector3::norm).collect();
        distances.sort_by(f64::total_cmp);
        let [median, p90, max] = [0.5, 0.9, 1.0].map(|share| quantile(&distances, share));
        let mean = errors.iter().sum::<Vector3<f64>>() / errors.len() as f64;
        println!(
            "{name:<14} {:>6} {median:>6.3} m {p90:>6.3} m {max:>6.3} m  ({:.3}, {:.3}, {:.3}) m",
            errors.len(),
            mean.x,
            mean.y,
            mean.z
        );
        medians.push((errors.len(), median));
    }
    assert!(positions.len() >= 90, "{} frames", positions.len());
    let (n, median) = medians[0];
    assert!(n >= 80 && median < 0.08, "{n} frames, {median} m from the trunk");
}
