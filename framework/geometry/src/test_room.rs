//! A room with cameras around it and one light waved in it, for tests: 3.5 × 5 × 2.5 m, seen at 640 × 480.

use foveate_estimation::Random;
use nalgebra::{Point2, Point3, Vector2};

use crate::bundle::Observation;
use crate::camera::{Camera, Distortion};

/// `n` cameras under the ceiling, aimed across the room.
pub(crate) fn cameras(n: usize, seed: u64) -> Vec<Camera> {
    let mut random = Random::new(seed).fork("cameras");
    (0..n)
        .map(|index| {
            let angle = std::f64::consts::TAU * index as f64 / n as f64;
            let centre = Point3::new(2.6 * angle.cos(), 3.4 * angle.sin(), 2.7 + 0.2 * random.normal());
            let mut across = || angle + std::f64::consts::PI * random.uniform_in(0.6, 1.4);
            let target = Point3::new(0.9 * across().cos(), 1.3 * across().sin(), 1.0);
            Camera::look_at(centre, target, [640, 480], 420.0)
        })
        .collect()
}

pub(crate) fn lens() -> Distortion {
    Distortion { k1: -0.2, k2: 0.05, p1: 0.001, p2: -0.002, k3: 0.0 }
}

/// Where the light is at `n` times.
pub(crate) fn path(n: usize) -> Vec<Point3<f64>> {
    (0..n)
        .map(|index| {
            let phase = std::f64::consts::TAU * index as f64 / n as f64;
            Point3::new(1.6 * (5.0 * phase + 0.3).sin(), 2.2 * (3.3 * phase).sin(), 1.2 + 0.7 * (7.1 * phase).sin())
        })
        .collect()
}

/// What at most `views` cameras, drawn for each point, see of it, with noise of `sigma` [px].
pub(crate) fn observations(
    cameras: &[Camera],
    points: &[Point3<f64>],
    views: usize,
    sigma: f64,
    random: &mut Random,
) -> Vec<Observation> {
    let mut all = Vec::new();
    for (point, place) in points.iter().enumerate() {
        let mut seen: Vec<(usize, Point2<f64>)> =
            cameras.iter().enumerate().filter_map(|(index, it)| Some((index, it.sees(place)?))).collect();
        for at in (1..seen.len()).rev() {
            seen.swap(at, random.below(at as u32 + 1) as usize);
        }
        for (camera, pixel) in seen.into_iter().take(views) {
            let noise = Vector2::new(random.normal(), random.normal()) * sigma;
            all.push(Observation { camera, point, pixel: pixel + noise, sigma_px: sigma.max(1e-3) });
        }
    }
    all
}
