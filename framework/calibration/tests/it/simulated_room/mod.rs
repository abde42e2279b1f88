//! A room with a light waved in it, and faults on purpose: what a calibration would make of it.

use foveate_calibration::solved::{
    FixedFreedoms, ObservationRole, Solved, SolvedCamera, SolvedObservation, SolvedPoint,
};
use foveate_estimation::{Loss, Random};
use foveate_geometry::bundle::{BundleOptions, Observation, adjust};
use foveate_geometry::{Camera, CameraStatus, Freedom, Pose};
use foveate_scene::uncertainty::Fixed;
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};

pub const N_CAMERAS: usize = 8;
/// Of either coordinate of a pixel, if nothing else is asked for.
const SIGMA_PX: f64 = 0.3;
const FRAMES: usize = 600;
const RATE_HZ: f64 = 30.0;
/// The camera at fault.
pub const BAD: usize = 3;
/// The one that it is swapped with.
pub const OTHER: usize = 6;
pub const MOVED_AT_S: f64 = 10.0;

/// What is wrong with the recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    Nothing,
    /// A path in a plane, seen from afar, solved in the reversed world.
    Flipped,
    /// The same path from afar; camera [`BAD`] alone is in its reversed pose.
    FlippedCamera,
    /// A path in a plane, seen from near, and solved as it was: nothing is wrong, but the path.
    Flat,
    /// Camera [`BAD`] turns by so much at [`MOVED_AT_S`] [mrad].
    Moved(f64),
    /// The focal length of camera [`BAD`] is believed to be this part of what it is [–].
    Focal(f64),
    /// The lens of camera [`BAD`] has this k1, and is believed to have none [–].
    Distortion(f64),
    /// The observations of [`BAD`] and [`OTHER`] are exchanged, and the room is calibrated from where cameras are known to stand.
    Swapped,
    /// The clock of camera [`BAD`] is behind by so much [ms].
    Clock(f64),
    /// Camera [`BAD`] has but a tenth of its observations.
    Few,
    /// This part of the observations of camera [`BAD`] are anywhere in its picture [–].
    Wrong(f64),
}

pub const FAULTS: [Fault; 11] = [
    Fault::Flipped,
    Fault::FlippedCamera,
    Fault::Flat,
    Fault::Moved(10.0),
    Fault::Focal(1.05),
    Fault::Distortion(-0.15),
    Fault::Swapped,
    Fault::Clock(20.0),
    Fault::Few,
    Fault::Wrong(0.3),
    Fault::Nothing,
];

/// Where the light is [m].
fn path(time_s: f64, phase: f64) -> Point3<f64> {
    let turn = std::f64::consts::TAU * time_s;
    Point3::new(
        1.5 * (0.13 * turn + phase).sin(),
        2.0 * (0.09 * turn).sin(),
        1.2 + 0.7 * (0.31 * turn + 2.0 * phase).sin(),
    )
}

/// Under the ceiling, aimed across the room.
fn cameras(random: &mut Random, is_far: bool) -> Vec<Camera> {
    let far = if is_far { 4.0 } else { 1.0 };
    let camera = |index: usize| {
        let angle = std::f64::consts::TAU * index as f64 / N_CAMERAS as f64;
        let centre = Point3::new(2.6 * far * angle.cos(), 3.4 * far * angle.sin(), 2.7 * far + 0.2 * random.normal());
        let mut across = || angle + std::f64::consts::PI * random.uniform_in(0.7, 1.3);
        let spread = if is_far { 0.2 } else { 1.0 };
        let target = Point3::new(0.6 * spread * across().cos(), 0.9 * spread * across().sin(), 1.0);
        Camera::look_at(centre, target, [640, 480], 420.0 * if is_far { 3.6 } else { 1.0 })
    };
    (0..N_CAMERAS).map(camera).collect()
}

struct Seen {
    camera: usize,
    frame: usize,
    pixel: Point2<f64>,
    held_out: bool,
}

/// What a calibration makes of a room with `fault`.
pub fn solved(fault: Fault, seed: u64) -> Solved {
    solved_at(fault, seed, SIGMA_PX)
}

/// The same with pixels that are known to `sigma_px`.
pub fn solved_at(fault: Fault, seed: u64, sigma_px: f64) -> Solved {
    let mut random = Random::new(seed).fork("room");
    let far = matches!(fault, Fault::Flipped | Fault::FlippedCamera);
    let flat = far || fault == Fault::Flat;
    let believed = cameras(&mut random, far);
    let mut real = believed.clone();
    match fault {
        Fault::Focal(factor) => real[BAD].intrinsics.focal = real[BAD].intrinsics.focal.map(|it| it / factor),
        Fault::Distortion(k1) => real[BAD].distortion.k1 = k1,
        _ => {}
    }
    let phase = random.uniform_in(0.0, 6.0);
    let place = |time_s: f64| {
        let place = path(time_s, phase);
        if flat { Point3::new(place.x, place.y, 1.0 + 0.02 * (place.z - 1.2)) } else { place }
    };
    let time = |frame: usize| frame as f64 / RATE_HZ;
    let points: Vec<Point3<f64>> = (0..FRAMES).map(|it| place(time(it))).collect();
    let mut seen = Vec::new();
    for (camera, model) in real.iter().enumerate() {
        for frame in 0..FRAMES {
            let late_s = if let (BAD, Fault::Clock(ms)) = (camera, fault) { 1e-3 * ms } else { 0.0 };
            let mut model = model.clone();
            if let (BAD, Fault::Moved(mrad), true) = (camera, fault, time(frame) > MOVED_AT_S) {
                let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 1.0, 0.1).normalize() * 1e-3 * mrad);
                model.camera_from_world =
                    Isometry3::from_parts(Translation3::identity(), turn) * model.camera_from_world;
            }
            let Some(pixel) = model.sees(&place(time(frame) + late_s)) else { continue };
            let missed = random.uniform() < 0.3 || (camera == BAD && fault == Fault::Few && random.uniform() < 0.9);
            let wrong = matches!((camera, fault), (BAD, Fault::Wrong(share)) if random.uniform() < share);
            let anywhere = Point2::new(random.uniform_in(0.0, 639.0), random.uniform_in(0.0, 479.0));
            let noisy = pixel + Vector2::new(random.normal(), random.normal()) * sigma_px;
            let held_out = random.uniform() < 0.05;
            if !missed {
                seen.push(Seen { camera, frame, pixel: if wrong { anywhere } else { noisy }, held_out });
            }
        }
    }
    if fault == Fault::Swapped {
        for it in &mut seen {
            it.camera = match it.camera {
                BAD => OTHER,
                OTHER => BAD,
                other => other,
            };
        }
    }
    let (start, points) = match fault {
        Fault::Flipped => reversed(&believed, &points),
        Fault::FlippedCamera => {
            let mut start = believed.clone();
            start[BAD] = reversed(&believed, &points).0[BAD].clone();
            (start, points)
        }
        _ => (believed, points),
    };
    calibrated(start, points, seen, sigma_px)
}

/// Adjusts robustly, rejects what is far off, and adjusts what is left, twice: from poses that are near, so that this takes no search.
fn calibrated(mut cameras: Vec<Camera>, mut points: Vec<Point3<f64>>, seen: Vec<Seen>, sigma_px: f64) -> Solved {
    let residual = |cameras: &[Camera], points: &[Point3<f64>], it: &Seen| {
        Some(cameras[it.camera].project(&points[it.frame])? - it.pixel)
    };
    let n = cameras.len();
    let mut covariance = None;
    let mut used = vec![false; seen.len()];
    for (gate_px, loss) in [(30.0, Loss::CAUCHY), (6.0, Loss::CAUCHY), (4.0, Loss::HUBER), (2.0, Loss::Squared)] {
        for (used, it) in used.iter_mut().zip(&seen) {
            *used = !it.held_out && residual(&cameras, &points, it).is_some_and(|it| it.norm() < gate_px);
        }
        let count = |camera: usize| seen.iter().zip(&used).filter(|it| *it.1 && it.0.camera == camera).count();
        let counts: Vec<usize> = (0..n).map(count).collect();
        for (used, it) in used.iter_mut().zip(&seen) {
            *used &= counts[it.camera] >= 30;
        }
        let to_observation = |it: &Seen| Observation { camera: it.camera, point: it.frame, pixel: it.pixel, sigma_px };
        let observations: Vec<Observation> =
            seen.iter().zip(&used).filter(|it| *it.1).map(|it| to_observation(it.0)).collect();
        let freedoms: Vec<Freedom> =
            counts.iter().map(|it| if *it >= 30 { Freedom::POSE } else { Freedom::NONE }).collect();
        let options = BundleOptions { loss, covariance: true, ..BundleOptions::default() };
        let adjusted = adjust(&cameras, &freedoms, &points, &observations, &options).unwrap();
        (cameras, points) = (adjusted.cameras, adjusted.points);
        covariance = adjusted.covariance.and_then(Result::ok);
    }
    let found = |camera: usize| seen.iter().zip(&used).any(|it| *it.1 && it.0.camera == camera);
    let observations = seen.iter().zip(&used).map(|(it, used)| {
        let residual = residual(&cameras, &points, it).filter(|_| found(it.camera));
        let role = match (used, it.held_out) {
            (true, _) => ObservationRole::Used,
            (false, true) if residual.is_some_and(|it| it.norm() < 4.0) => ObservationRole::HeldOut,
            _ if found(it.camera) => ObservationRole::Rejected,
            _ => ObservationRole::Unsolved,
        };
        SolvedObservation { camera: it.camera, frame: it.frame, point: Some(it.frame), pixel: it.pixel, residual, role }
    });
    let observations = observations.collect();
    let status = |camera: usize| match found(camera) {
        true => CameraStatus::Calibrated,
        false => match seen.iter().filter(|it| it.camera == camera).count() {
            frames @ 0..60 => CameraStatus::TooFewObservations { frames, needed: 60 },
            _ => CameraStatus::Inconsistent { best: 0, common: 100, right: 3 },
        },
    };
    let solved_camera = |(index, camera): (usize, &Camera)| SolvedCamera {
        name: format!("wide-{}", index + 1),
        camera: camera.clone(),
        status: status(index),
        freed: Freedom::POSE,
        prior: None,
        covariance: covariance.as_ref().map(|it| it[index].clone()).filter(|_| found(index)),
        clock: None,
    };
    let point = |(frame, position): (usize, &Point3<f64>)| SolvedPoint {
        frame,
        time_s: frame as f64 / RATE_HZ,
        label: 0,
        position: *position,
    };
    let fixed = || Some(Fixed { by: "the simulation".to_owned(), sigma: None });
    Solved {
        cameras: cameras.iter().enumerate().map(solved_camera).collect(),
        points: points.iter().enumerate().map(point).collect(),
        observations,
        fixed: FixedFreedoms { scale: fixed(), gravity: None, origin: None },
        ..Solved::default()
    }
}

/// The reversed world: points reflected in the horizontal plane of the path, cameras to match.
fn reversed(cameras: &[Camera], points: &[Point3<f64>]) -> (Vec<Camera>, Vec<Point3<f64>>) {
    let centre = Point3::from(points.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords) / points.len() as f64);
    let reflection = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    let reversed = |camera: &Camera| {
        let pose: &Pose = &camera.camera_from_world;
        let turned = reflection * pose.rotation.to_rotation_matrix().matrix() * reflection;
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turned));
        let shift = Translation3::from((pose * centre).coords - turn * centre.coords);
        Camera { camera_from_world: Isometry3::from_parts(shift, turn), ..camera.clone() }
    };
    let reflected = |it: &Point3<f64>| centre + reflection * (it - centre);
    (cameras.iter().map(reversed).collect(), points.iter().map(reflected).collect())
}

/// The fault as it should be named: of which camera, and whether `cause` is right for it.
pub fn is_named(fault: Fault, checks: &foveate_calibration::checks::Checks) -> bool {
    use foveate_calibration::checks::{Cause, Level};
    let of = |wanted: usize, right: fn(&Cause, Fault) -> bool| {
        checks.candidates.iter().any(|it| it.camera == wanted && right(&it.cause, fault))
    };
    match fault {
        Fault::Nothing => checks.candidates.is_empty() && checks.verdict.level == Level::Good,
        Fault::Flipped => checks.handedness.judgement.level == Level::Redo,
        Fault::FlippedCamera => {
            let closest = checks.handedness.closest_camera;
            checks.handedness.judgement.level == Level::Redo && closest.is_some_and(|it| it.0 == BAD && it.1 < 1.0)
        }
        Fault::Flat => checks.candidates.is_empty() && checks.verdict.level == Level::Usable,
        Fault::Moved(_) => {
            of(BAD, |it, _| matches!(it, Cause::Moved { at_s: Some(at_s), .. } if (at_s - MOVED_AT_S).abs() < 0.5))
        }
        Fault::Focal(_) => of(
            BAD,
            |it, fault| matches!((it, fault), (Cause::Focal { factor }, Fault::Focal(by)) if (factor * by - 1.0).abs() < 0.015),
        ),
        Fault::Distortion(_) => of(
            BAD,
            |it, fault| matches!((it, fault), (Cause::Distortion { k1 }, Fault::Distortion(real)) if (k1 - real).abs() < 0.04),
        ),
        Fault::Swapped => {
            of(BAD, |it, _| *it == Cause::Swapped { with: OTHER, since_s: None })
                && of(OTHER, |it, _| *it == Cause::Swapped { with: BAD, since_s: None })
        }
        Fault::Clock(_) => of(
            BAD,
            |it, fault| matches!((it, fault), (Cause::Clock { offset_s, .. }, Fault::Clock(ms)) if (1e3 * offset_s - ms).abs() < 2.0),
        ),
        Fault::Few => {
            let uncalibrated = &checks.cameras[BAD].judgement.sentence;
            of(BAD, |it, _| matches!(it, Cause::FewObservations { .. })) || uncalibrated.contains("saw the light in")
        }
        Fault::Wrong(_) => of(
            BAD,
            |it, fault| matches!((it, fault), (Cause::FalseObservations { share }, Fault::Wrong(real)) if (share - real).abs() < 0.08),
        ),
    }
}

/// Cameras that are called candidates without being at fault.
pub fn innocent_candidates(fault: Fault, checks: &foveate_calibration::checks::Checks) -> usize {
    let guilty = |camera: usize| match fault {
        Fault::Nothing | Fault::Flipped | Fault::Flat => false,
        Fault::Swapped => camera == BAD || camera == OTHER,
        _ => camera == BAD,
    };
    let mut accused: Vec<usize> = checks.candidates.iter().map(|it| it.camera).filter(|it| !guilty(*it)).collect();
    accused.sort_unstable();
    accused.dedup();
    accused.len()
}
