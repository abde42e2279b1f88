//! Simulated rooms whose errors are known: white noise, and what a lens, a light and a hand do beside it.

use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use foveate_estimation::Random;
use foveate_geometry::bundle::Freedom;
use foveate_geometry::{Camera, Distortion};
use foveate_scene::draft::middle;
use nalgebra::{Isometry3, Point2, Point3, Vector2, Vector3};

/// What is wrong beside noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Error {
    /// Nothing: each pixel errs by itself.
    White,
    /// Pixels err alike for some tenths of a second.
    InTime,
    /// Lenses have terms that the model does not have.
    Lens,
    /// The light is some millimetres wide and turned about by the hand: each camera sees another point of it.
    Shape,
}

pub const ERRORS: [Error; 4] = [Error::White, Error::InTime, Error::Lens, Error::Shape];
const N_CAMERAS: usize = 6;
pub const RATE_HZ: f64 = 25.0;

impl Error {
    pub fn name(self) -> &'static str {
        match self {
            Error::White => "white noise",
            Error::InTime => "noise that lasts 0.3 s",
            Error::Lens => "lenses richer than theirs",
            Error::Shape => "a light of some mm",
        }
    }
}

/// A recording and the cameras as they are.
pub fn simulated(error: Error, seed: u64, free: Freedom) -> (Recording, Vec<Camera>) {
    let mut random = Random::new(seed).fork("room");
    let camera = |index: usize| {
        let angle = std::f64::consts::TAU * (index as f64 + 0.3 * random.normal()) / N_CAMERAS as f64;
        let centre = Point3::new(2.8 * angle.cos(), 3.4 * angle.sin(), 2.4 + 0.3 * random.normal());
        let target = Point3::new(0.3 * random.normal(), 0.3 * random.normal(), 1.0);
        let mut camera = Camera::look_at(centre, target, [640, 480], 430.0 + 20.0 * random.normal());
        camera.distortion = Distortion { k1: -0.2, k2: 0.05, ..Distortion::default() };
        if error == Error::Lens {
            camera.distortion.k3 = -0.01 + 0.01 * random.normal();
            camera.distortion.p1 = 1e-3 * random.normal();
            camera.distortion.p2 = 1e-3 * random.normal();
        }
        camera
    };
    let cameras: Vec<Camera> = (0..N_CAMERAS).map(camera).collect();
    let phases: [f64; 8] = std::array::from_fn(|_| random.uniform_in(0.0, 6.3));
    let path = |time_s: f64| {
        let s = |rate: f64, phase: usize| (rate * time_s + phases[phase]).sin();
        let (x, y) = (0.8 * s(1.1, 0) + 0.5 * s(2.9, 1), 1.2 * s(0.9, 2) + 0.5 * s(2.3, 3));
        Point3::new(x, y, 1.1 + 0.5 * s(1.7, 4) + 0.25 * s(3.7, 5))
    };
    let mut camera_frames = Vec::new();
    for (index, camera) in cameras.iter().enumerate() {
        let mut draws = random.fork(&format!("camera {index}"));
        let mut lasting = Vector2::zeros();
        for frame in 0..(30.0 * RATE_HZ) as usize {
            let time_s = frame as f64 / RATE_HZ;
            let mut place = path(time_s);
            if error == Error::Shape {
                let facing = Vector3::new((0.7 * time_s).cos(), (0.7 * time_s).sin(), 0.4 * (1.3 * time_s).sin());
                place += 0.004 * facing.normalize();
                let towards = (camera.centre() - place).normalize();
                place += 0.004 * facing.normalize() * facing.normalize().dot(&towards).max(0.0);
            }
            let noise = Vector2::new(draws.normal(), draws.normal());
            let held = (-1.0 / (0.3 * RATE_HZ)).exp();
            lasting = lasting * held + noise * (1.0 - held * held).sqrt();
            let error = if error == Error::InTime { lasting } else { noise } * 0.3;
            let seen = camera.sees(&place).map(|it| it + error).filter(|it| camera.has_pixel(it));
            let spot = |pixel: Point2<f64>| Spot { pixel, sigma_px: 0.3, peak: 1.0, label: None };
            camera_frames.push(CameraFrame { camera: index, time_s, spots: seen.map(spot).into_iter().collect() });
        }
    }
    camera_frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let guess = |(index, camera): (usize, &Camera)| {
        let mut guess = camera.clone();
        guess.camera_from_world = Isometry3::identity();
        guess.intrinsics.focal = [480.0; 2];
        guess.intrinsics.principal = middle(guess.image_size);
        guess.distortion = Distortion::default();
        CameraGuess { name: format!("cam{index}"), camera: guess, free }
    };
    let guesses = cameras.iter().enumerate().map(guess).collect();
    (Recording { cameras: guesses, camera_frames }, cameras)
}
