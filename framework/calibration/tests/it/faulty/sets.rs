//! Recordings of waved lights as a calibration gets them: one that is simulated.

use foveate_calibration::network::{CalibrationTarget, NetworkOptions};
use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use foveate_estimation::Random;
use foveate_geometry::bundle::Freedom;
use foveate_geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Isometry3, Point2, Point3};

/// A recording and what is said of it on the command line.
#[derive(Debug, Clone)]
pub struct Set {
    /// What the cameras saw.
    pub recording: Recording,
    /// What was waved.
    pub sought: CalibrationTarget<'static>,
    /// How to calibrate it.
    pub options: NetworkOptions,
}

/// Focal length and two terms of radial distortion.
pub const LENS: Freedom = Freedom { focal: true, k1: true, k2: true, ..Freedom::POSE };

/// A camera of which the size is known.
pub fn guess(name: String, image_size: [u32; 2], focal: Option<f64>, free: Freedom) -> CameraGuess {
    let middle = image_size.map(|it| 0.5 * (f64::from(it) - 1.0));
    let focal = focal.unwrap_or(0.9 * f64::from(image_size[0].max(image_size[1])));
    let intrinsics = Intrinsics { focal: [focal; 2], principal: middle, skew: 0.0 };
    let camera =
        Camera { intrinsics, distortion: Distortion::default(), image_size, camera_from_world: Isometry3::identity() };
    CameraGuess { name, camera, free }
}

/// A light at a place in a picture.
pub fn spot(x: f64, y: f64, label: Option<u32>) -> Spot {
    Spot { pixel: Point2::new(x, y), sigma_px: 0.5, peak: 200.0, label }
}

/// A room whose lenses have more terms than are found, and a light whose centre a detector finds with a bias by its direction of motion.
pub fn simulated(n_cameras: usize, seed: u64) -> Set {
    let mut random = Random::new(seed).fork("simulated set");
    let mut cameras = Vec::new();
    for index in 0..n_cameras {
        let angle = std::f64::consts::TAU * (index as f64 + 0.3 * random.normal().clamp(-1.0, 1.0)) / n_cameras as f64;
        let centre = Point3::new(3.2 * angle.cos(), 3.6 * angle.sin(), 2.4 + 0.3 * random.normal());
        let target = Point3::new(0.3 * random.normal(), 0.3 * random.normal(), 1.1);
        let mut camera = Camera::look_at(centre, target, [640, 480], 470.0 + 25.0 * random.normal());
        camera.intrinsics.principal = [319.5 + 6.0 * random.normal(), 239.5 + 6.0 * random.normal()];
        let Distortion { k1, k2, k3, p1, p2, .. } = &mut camera.distortion;
        (*k1, *k2, *k3) = (-0.12 + 0.02 * random.normal(), 0.06, -0.01);
        (*p1, *p2) = (3e-4 * random.normal(), 3e-4 * random.normal());
        cameras.push(camera);
    }
    let at = |time_s: f64| {
        let turn = |hz: f64, phase: f64| (std::f64::consts::TAU * hz * time_s + phase).sin();
        Point3::new(
            1.1 * turn(0.11, 0.2) + 0.5 * turn(0.31, 1.0),
            1.2 * turn(0.07, 2.0) + 0.5 * turn(0.27, 0.3),
            1.2 + 0.5 * turn(0.17, 0.9) + 0.3 * turn(0.41, 0.0),
        )
    };
    let mut camera_frames = Vec::new();
    for frame in 0..700 {
        let time_s = frame as f64 / 30.0;
        for (index, camera) in cameras.iter().enumerate() {
            let hidden = random.uniform_in(0.0, 1.0) < 0.2;
            let seen = camera.sees(&at(time_s)).filter(|_| !hidden);
            let before = camera.project(&at(time_s - 0.01));
            let spots = seen.zip(before).map(|(seen, before)| {
                // Exposure smears the light along its way; the detector's threshold takes more of one end.
                let bias = 0.05 * (seen - before);
                spot(seen.x + bias.x + 0.2 * random.normal(), seen.y + bias.y + 0.2 * random.normal(), None)
            });
            camera_frames.push(CameraFrame { camera: index, time_s, spots: spots.into_iter().collect() });
        }
    }
    let guesses = (0..n_cameras).map(|index| guess(format!("cam{index}"), [640, 480], None, LENS));
    let recording = Recording { cameras: guesses.collect(), camera_frames };
    let options = NetworkOptions { focal_unknown: true, ..NetworkOptions::default() };
    Set { recording, sought: CalibrationTarget::Light, options }
}
