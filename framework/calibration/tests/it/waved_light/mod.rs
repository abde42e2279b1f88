//! One light waved in a room of cameras whose clocks nobody synchronised.

use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use foveate_estimation::Random;
use foveate_geometry::Camera;
use foveate_geometry::bundle::Freedom;
use nalgebra::{Point2, Point3, Vector2};

/// A light in a room of 3.5 × 5 × 2.5 m and cameras around it.
pub struct Scene {
    pub path: fn(f64) -> Point3<f64>,
    /// By camera: own time = room time − offset.
    pub offsets_s: Vec<f64>,
    pub length_s: f64,
    /// Pictures a second, camera by camera and then from the first again; one in four of the usual ones stamps unevenly.
    pub rates_hz: &'static [f64],
    /// Stamps are rounded to whole steps of so much [s]; 0: not at all.
    pub rounded_s: f64,
    /// Part of the pictures that are missing.
    pub dropped: f64,
    pub sigma_px: f64,
    /// Part of the pictures that show something else.
    pub wrong: f64,
    /// By camera: the part of the time in which it sees the light, in stretches of some seconds.
    pub duty: Vec<f64>,
    pub seed: u64,
}

/// Waved about at walking height, about a metre a second, never twice the same.
pub fn waved(time: f64) -> Point3<f64> {
    let s = |rate: f64, phase: f64| (rate * time + phase).sin();
    let (x, y) = (0.9 * s(1.3, 0.2) + 0.5 * s(2.9, 1.0), 1.3 * s(0.9, 2.0) + 0.6 * s(2.3, 0.4));
    Point3::new(x, y, 1.2 + 0.4 * s(1.7, 0.9) + 0.25 * s(3.7, 2.2))
}

/// Rates of cameras that nobody chose.
const USUAL_HZ: [f64; 4] = [30.0, 60.0, 50.0, 29.97];

impl Scene {
    /// In which all goes well.
    pub fn new(offsets_s: &[f64]) -> Scene {
        let duty = vec![1.0; offsets_s.len()];
        Scene {
            path: waved,
            offsets_s: offsets_s.to_vec(),
            length_s: 30.0,
            rates_hz: &USUAL_HZ,
            rounded_s: 0.0,
            dropped: 0.0,
            sigma_px: 0.5,
            wrong: 0.0,
            duty,
            seed: 1,
        }
    }

    /// The truth.
    pub fn cameras(&self) -> Vec<Camera> {
        let n = self.offsets_s.len();
        let camera = |index: usize| {
            let angle = std::f64::consts::TAU * index as f64 / n as f64 + 0.2;
            let centre = Point3::new(2.8 * angle.cos(), 3.6 * angle.sin(), 2.4 + 0.3 * (index % 3) as f64);
            Camera::look_at(centre, Point3::new(0.1, -0.1, 1.1), [640, 480], 420.0)
        };
        (0..n).map(camera).collect()
    }

    /// Cameras of 30 to 60 Hz; one in four stamps unevenly, by a fifth of its period.
    pub fn recording(&self, free: Freedom) -> Recording {
        let random = Random::new(self.seed);
        let mut camera_frames = Vec::new();
        let cameras = self.cameras();
        for (index, camera) in cameras.iter().enumerate() {
            let mut draws = random.fork(&format!("camera {index}"));
            let rate = self.rates_hz[index % self.rates_hz.len()];
            let uneven = if self.rates_hz == USUAL_HZ && index % 4 == 3 { 0.2 / rate } else { 0.0 };
            let mut missing = random.fork(&format!("missing {index}"));
            let start = draws.uniform_in(0.0, 1.0 / rate);
            for picture in 0..(self.length_s * rate) as usize {
                let room_s = start + picture as f64 / rate + draws.uniform_in(-uneven, uneven);
                let (stretch, noise) = (room_s / 4.0, Vector2::new(draws.normal(), draws.normal()) * self.sigma_px);
                let seen = camera.sees(&(self.path)(room_s)).filter(|_| stretch.fract() < self.duty[index]);
                let wrong = draws.uniform() < self.wrong;
                let anywhere = Point2::new(draws.uniform_in(0.0, 639.0), draws.uniform_in(0.0, 479.0));
                let pixel = if wrong { Some(anywhere) } else { seen.map(|it| it + noise) };
                let spot = |pixel| Spot { pixel, sigma_px: self.sigma_px, peak: 200.0, label: None };
                let mut time_s = room_s - self.offsets_s[index];
                if self.rounded_s > 0.0 {
                    time_s = (time_s / self.rounded_s).round() * self.rounded_s;
                }
                if missing.uniform() < self.dropped {
                    continue;
                }
                camera_frames.push(CameraFrame { camera: index, time_s, spots: pixel.map(spot).into_iter().collect() });
            }
        }
        camera_frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let guess = |(index, camera): (usize, &Camera)| {
            let mut camera = camera.clone();
            camera.camera_from_world = nalgebra::Isometry3::identity();
            if free.focal {
                camera.intrinsics.focal = camera.intrinsics.focal.map(|it| 1.1 * it);
            }
            CameraGuess { name: format!("cam{index}"), camera, free }
        };
        Recording { cameras: cameras.iter().enumerate().map(guess).collect(), camera_frames }
    }
}
