//! Calibrates a room of 18 cameras from one waved light, from nothing, in 20 seeds: errors, successes and seconds.
//!
//! The floor is the error of the centres when the same right pixels are adjusted from the truth. The bound is that of Cramér and Rao: the
//! standard deviation that the covariance of the right pixels' noise, led to the centres, leaves after a similarity. No unbiased method that knows
//! no more than the pixels comes below it. `known` are given optics, `focal` guesses it 15 % too long, `lens` knows nothing: 10 % too long,
//! principal point 7 px off, k1 = −0.2, k2 = 0.05 and decentering taken for 0.

use std::time::Instant;

use foveate_estimation::{Random, statistics};
use foveate_geometry::{
    AlignmentOptions, BundleOptions, Camera, CameraStatus, Distortion, Freedom, Gauge, LightObservation, Observation,
    SelfCalibrationOptions, adjust, align, camera_errors, self_calibrate,
};
use nalgebra::{Point2, Point3, Vector2};

const SEEDS: u64 = 20;
const FRAMES: usize = 600;
const SIGMA_PX: f64 = 0.5;

struct Room {
    truth: Vec<Camera>,
    path: Vec<Point3<f64>>,
    observations: Vec<LightObservation>,
    right: Vec<Observation>,
}

fn room(views: usize, wrong: f64, lens: &Distortion, seed: u64) -> Room {
    let mut random = Random::new(seed);
    let truth: Vec<Camera> = (0..18)
        .map(|index| {
            let angle = std::f64::consts::TAU * f64::from(index) / 18.0;
            let centre = Point3::new(2.6 * angle.cos(), 3.4 * angle.sin(), 2.7 + 0.2 * random.normal());
            let mut across = || angle + std::f64::consts::PI * random.uniform_in(0.6, 1.4);
            let target = Point3::new(0.9 * across().cos(), 1.3 * across().sin(), 1.0);
            Camera { distortion: *lens, ..Camera::look_at(centre, target, [640, 480], 420.0) }
        })
        .collect();
    let place = |index: usize| {
        let phase = std::f64::consts::TAU * index as f64 / FRAMES as f64;
        Point3::new(1.6 * (5.0 * phase + 0.3).sin(), 2.2 * (3.3 * phase).sin(), 1.2 + 0.7 * (7.1 * phase).sin())
    };
    let path: Vec<Point3<f64>> = (0..FRAMES).map(place).collect();
    let (mut observations, mut right) = (Vec::new(), Vec::new());
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
            observations.push(LightObservation { camera, frame, pixel });
        }
    }
    Room { truth, path, observations, right }
}

fn rms_mm(errors: &[f64]) -> f64 {
    1e3 * (errors.iter().map(|it| it * it).sum::<f64>() / errors.len() as f64).sqrt()
}

/// Root mean square errors of centres and points [mm], of focal lengths [%]; `None` unless all cameras were calibrated.
fn errors(room: &Room, given: &[Camera], freedom: Freedom) -> Option<[f64; 3]> {
    let found =
        self_calibrate(given, &vec![freedom; given.len()], &room.observations, &SelfCalibrationOptions::default())
            .ok()?;
    if !found.status.iter().all(|it| *it == CameraStatus::Calibrated) {
        return None;
    }
    let similarity = AlignmentOptions { scale: true, robust: false };
    let centres = camera_errors(&found.cameras, &room.truth, similarity).ok()?.centres;
    let (points, truth): (Vec<_>, Vec<_>) =
        found.points.iter().zip(&room.path).filter_map(|(a, b)| Some(((*a)?, *b))).unzip();
    let points = align(&points, &truth, AlignmentOptions { scale: true, robust: true }).ok()?.distances;
    let focal = found.cameras.iter().zip(&room.truth);
    let focal: Vec<f64> = focal.map(|(a, b)| a.intrinsics.focal[0] / b.intrinsics.focal[0] - 1.0).collect();
    Some([rms_mm(&centres), rms_mm(&points), 0.1 * rms_mm(&focal)])
}

/// Error of the centres after an adjustment from the truth, and the bound for it [mm].
fn floor(room: &Room, freedom: Freedom) -> Option<[f64; 2]> {
    let freedoms = vec![freedom; room.truth.len()];
    let options = BundleOptions { gauge: Gauge::Centres, covariance: true, ..BundleOptions::default() };
    let found = adjust(&room.truth, &freedoms, &room.path, &room.right, &options).ok()?;
    let similarity = AlignmentOptions { scale: true, robust: false };
    let errors = camera_errors(&found.cameras, &room.truth, similarity).ok()?.centres;
    let stated: Vec<f64> = found.covariance?.ok()?.iter().map(|it| it.centre.trace().sqrt()).collect();
    Some([rms_mm(&errors), rms_mm(&stated)])
}

/// What is known of the optics.
#[derive(Clone, Copy, PartialEq)]
enum Optics {
    Known,
    Focal,
    Lens,
}

impl Optics {
    fn name(self) -> &'static str {
        match self {
            Optics::Known => "known",
            Optics::Focal => "focal",
            Optics::Lens => "lens",
        }
    }

    fn freedom(self) -> Freedom {
        let focal = Freedom { focal: true, ..Freedom::POSE };
        match self {
            Optics::Known => Freedom::POSE,
            Optics::Focal => focal,
            Optics::Lens => Freedom { principal: true, k1: true, k2: true, decentering: true, ..focal },
        }
    }

    fn truth(self) -> Distortion {
        match self {
            Optics::Lens => Distortion { k1: -0.2, k2: 0.05, p1: 0.001, p2: -0.002, k3: 0.0 },
            _ => Distortion::default(),
        }
    }

    fn guess(self, truth: &Camera) -> Camera {
        let mut guess = truth.clone();
        match self {
            Optics::Known => {}
            Optics::Focal => guess.intrinsics.focal = [1.15 * 420.0; 2],
            Optics::Lens => {
                guess.intrinsics.focal = [1.1 * 420.0; 2];
                guess.intrinsics.principal = [326.5, 232.5];
                guess.distortion = Distortion::default();
            }
        }
        guess
    }
}

const CASES: [(usize, f64, Optics); 16] = [
    (13, 0.0, Optics::Known),
    (8, 0.0, Optics::Known),
    (6, 0.0, Optics::Known),
    (4, 0.0, Optics::Known),
    (3, 0.0, Optics::Known),
    (8, 0.3, Optics::Known),
    (4, 0.1, Optics::Known),
    (4, 0.3, Optics::Known),
    (13, 0.0, Optics::Focal),
    (8, 0.0, Optics::Focal),
    (6, 0.0, Optics::Focal),
    (4, 0.0, Optics::Focal),
    (13, 0.0, Optics::Lens),
    (8, 0.0, Optics::Lens),
    (6, 0.0, Optics::Lens),
    (4, 0.0, Optics::Lens),
];

fn main() {
    println!(
        "views  wrong  optics  found  centres, mm: median, worst, floor, bound  points, mm  focal, %  seconds: median, worst"
    );
    for (views, wrong, optics) in CASES {
        let freedom = optics.freedom();
        let (mut seconds, mut all, mut floors) = (Vec::new(), Vec::new(), Vec::new());
        for seed in 0..SEEDS {
            let room = room(views, wrong, &optics.truth(), seed);
            let given: Vec<Camera> = room.truth.iter().map(|it| optics.guess(it)).collect();
            let start = Instant::now();
            let found = errors(&room, &given, freedom);
            seconds.push(start.elapsed().as_secs_f64());
            all.extend(found);
            floors.extend(floor(&room, freedom));
        }
        let column = |which: usize| all.iter().map(|it| it[which]).collect::<Vec<f64>>();
        let median = |list: &[f64]| statistics::median(list).unwrap_or(f64::NAN);
        let worst = |list: &[f64]| list.iter().copied().fold(f64::NAN, f64::max);
        let of_floor = |which: usize| median(&floors.iter().map(|it| it[which]).collect::<Vec<f64>>());
        println!(
            "{views:5}  {:4.0}%  {:<6}  {:2}/{SEEDS}  {:10.2} {:8.2} {:8.2} {:8.2}  {:17.2}  {:8.3}  {:10.3} {:8.3}",
            100.0 * wrong,
            optics.name(),
            all.len(),
            median(&column(0)),
            worst(&column(0)),
            of_floor(0),
            of_floor(1),
            median(&column(1)),
            median(&column(2)),
            median(&seconds),
            worst(&seconds),
        );
    }
}
