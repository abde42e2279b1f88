//! Calibrates a room of 18 cameras from one waved light, from nothing, in 20 seeds: errors, successes and seconds. The floor is the error
//! of the centres when the same right pixels are adjusted from the truth: less no method can reach.

use std::time::Instant;

use foveate_estimation::{Random, statistics};
use foveate_geometry::{
    AlignmentRules, BundleRules, Camera, CameraStatus, Freedom, Observation, SelfCalibrationRules, Sighting, adjust,
    align, camera_errors, self_calibrate,
};
use nalgebra::{Point2, Point3, Vector2};

const SEEDS: u64 = 20;
const FRAMES: usize = 600;
const SIGMA_PX: f64 = 0.5;

struct Room {
    truth: Vec<Camera>,
    path: Vec<Point3<f64>>,
    sightings: Vec<Sighting>,
    right: Vec<Observation>,
}

fn room(views: usize, wrong: f64, seed: u64) -> Room {
    let mut random = Random::new(seed);
    let truth: Vec<Camera> = (0..18)
        .map(|index| {
            let angle = std::f64::consts::TAU * f64::from(index) / 18.0;
            let centre = Point3::new(2.6 * angle.cos(), 3.4 * angle.sin(), 2.7 + 0.2 * random.normal());
            let mut across = || angle + std::f64::consts::PI * random.uniform_in(0.6, 1.4);
            let target = Point3::new(0.9 * across().cos(), 1.3 * across().sin(), 1.0);
            Camera::look_at(centre, target, [640, 480], 420.0)
        })
        .collect();
    let place = |index: usize| {
        let phase = std::f64::consts::TAU * index as f64 / FRAMES as f64;
        Point3::new(1.6 * (5.0 * phase + 0.3).sin(), 2.2 * (3.3 * phase).sin(), 1.2 + 0.7 * (7.1 * phase).sin())
    };
    let path: Vec<Point3<f64>> = (0..FRAMES).map(place).collect();
    let (mut sightings, mut right) = (Vec::new(), Vec::new());
    for (frame, place) in path.iter().enumerate() {
        let mut seen: Vec<(usize, Point2<f64>)> =
            truth.iter().enumerate().filter_map(|(camera, it)| Some((camera, it.sees(place)?))).collect();
        for at in (1..seen.len()).rev() {
            seen.swap(at, random.below(at as u32 + 1) as usize);
        }
        for (camera, pixel) in seen.into_iter().take(views) {
            let mut pixel = pixel + Vector2::new(random.normal(), random.normal()) * SIGMA_PX;
            if random.uniform() < wrong {
                pixel = Point2::new(random.uniform_in(0.0, 639.0), random.uniform_in(0.0, 479.0));
            } else {
                right.push(Observation { camera, point: frame, pixel, sigma_px: SIGMA_PX });
            }
            sightings.push(Sighting { camera, frame, pixel });
        }
    }
    Room { truth, path, sightings, right }
}

fn rms_mm(errors: &[f64]) -> f64 {
    1e3 * (errors.iter().map(|it| it * it).sum::<f64>() / errors.len() as f64).sqrt()
}

/// Root mean square errors of centres and points [mm], of focal lengths [%]; `None` unless all cameras were calibrated.
fn errors(room: &Room, given: &[Camera], rules: &SelfCalibrationRules) -> Option<[f64; 3]> {
    let found = self_calibrate(given, &room.sightings, rules).ok()?;
    if !found.status.iter().all(|it| *it == CameraStatus::Calibrated) {
        return None;
    }
    let similarity = AlignmentRules { scale: true, robust: false };
    let centres = camera_errors(&found.cameras, &room.truth, similarity).ok()?.centres;
    let (points, truth): (Vec<_>, Vec<_>) =
        found.points.iter().zip(&room.path).filter_map(|(a, b)| Some(((*a)?, *b))).unzip();
    let points = align(&points, &truth, AlignmentRules { scale: true, robust: true }).ok()?.distances;
    let focal = found.cameras.iter().zip(&room.truth);
    let focal: Vec<f64> = focal.map(|(a, b)| a.intrinsics.focal[0] / b.intrinsics.focal[0] - 1.0).collect();
    Some([rms_mm(&centres), rms_mm(&points), 0.1 * rms_mm(&focal)])
}

/// Error of the centres after an adjustment from the truth [mm].
fn floor(room: &Room, focal_free: bool) -> Option<f64> {
    let freedoms = vec![Freedom { focal: focal_free, ..Freedom::POSE }; room.truth.len()];
    let found = adjust(&room.truth, &freedoms, &room.path, &room.right, &BundleRules::default()).ok()?;
    let similarity = AlignmentRules { scale: true, robust: false };
    Some(rms_mm(&camera_errors(&found.cameras, &room.truth, similarity).ok()?.centres))
}

fn main() {
    println!(
        "views  wrong  focal     found  centres, mm: median, worst, floor  points, mm  focal, %  seconds: median, worst"
    );
    for (views, wrong, guess) in [
        (13, 0.0, 1.0),
        (8, 0.0, 1.0),
        (6, 0.0, 1.0),
        (4, 0.0, 1.0),
        (3, 0.0, 1.0),
        (8, 0.3, 1.0),
        (4, 0.1, 1.0),
        (8, 0.0, 1.15),
        (6, 0.0, 1.15),
        (4, 0.0, 1.15),
    ] {
        let rules = SelfCalibrationRules { focal_free: guess != 1.0, ..SelfCalibrationRules::default() };
        let (mut seconds, mut all, mut floors) = (Vec::new(), Vec::new(), Vec::new());
        for seed in 0..SEEDS {
            let room = room(views, wrong, seed);
            let mut given = room.truth.clone();
            given.iter_mut().for_each(|it| it.intrinsics.focal = [420.0 * guess; 2]);
            let start = Instant::now();
            let found = errors(&room, &given, &rules);
            seconds.push(start.elapsed().as_secs_f64());
            all.extend(found);
            floors.extend(floor(&room, rules.focal_free));
        }
        let column = |which: usize| all.iter().map(|it| it[which]).collect::<Vec<f64>>();
        let median = |list: &[f64]| statistics::median(list).unwrap_or(f64::NAN);
        let worst = |list: &[f64]| list.iter().copied().fold(f64::NAN, f64::max);
        println!(
            "{views:5}  {:4.0}%  {:<8}  {:2}/{SEEDS}  {:10.2} {:10.2} {:10.2}  {:14.2}  {:8.3}  {:10.3} {:8.3}",
            100.0 * wrong,
            if rules.focal_free { "guessed" } else { "known" },
            all.len(),
            median(&column(0)),
            worst(&column(0)),
            median(&floors),
            median(&column(1)),
            median(&column(2)),
            median(&seconds),
            worst(&seconds),
        );
    }
}
