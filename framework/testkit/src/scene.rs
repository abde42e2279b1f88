//! Cameras, points and pictures whose truth is known.

use std::f64::consts::TAU;

use foveate_estimation::random::Random;
use foveate_geometry::{Camera, Distortion};
use foveate_messages::{CameraId, Image, PixelFormat};
use foveate_scene::calibration::{Calibration, LengthUnit, NamedCamera};
use nalgebra::Point3;

/// `n` cameras of 640 × 480 px on a circle of 3 m radius, 2.5 m above the floor, all aimed at (0, 0, 1) m: evenly spaced
/// from +x, with a focal length of 400 px and mild distortion. The cube of 2 m around (0, 0, 1) is seen whole by each.
pub fn camera_ring(n: usize) -> Vec<Camera> {
    (0..n)
        .map(|i| {
            let (sine, cosine) = (TAU * i as f64 / n as f64).sin_cos();
            let centre = Point3::new(3.0 * cosine, 3.0 * sine, 2.5);
            let mut camera = Camera::look_at(centre, Point3::new(0.0, 0.0, 1.0), [640, 480], 400.0);
            camera.distortion = Distortion { k1: -0.08, k2: 0.01, ..Distortion::default() };
            camera
        })
        .collect()
}

/// A calibration whose cameras are [`camera_ring`], named `ring-1` and on.
///
/// # Panics
/// When `n` is 0: a calibration has cameras.
#[track_caller]
pub fn ring_calibration(n: usize) -> Calibration {
    let named = camera_ring(n).into_iter().enumerate();
    let cameras = named.map(|(i, camera)| NamedCamera { name: format!("ring-{}", i + 1), camera }).collect();
    let made = Calibration::new(cameras, LengthUnit::Metre, "a ring of cameras for tests".to_owned());
    made.unwrap_or_else(|error| panic!("{error}"))
}

/// `n` points of the cube of 2 m around (0, 0, 1) m, evenly distributed; the same for the same `seed`.
pub fn point_cloud(n: usize, seed: u64) -> Vec<Point3<f64>> {
    let mut random = Random::new(seed).fork("point_cloud");
    let mut coordinate = |middle: f64| random.uniform_in(middle - 1.0, middle + 1.0);
    (0..n).map(|_| Point3::new(coordinate(0.0), coordinate(0.0), coordinate(1.0))).collect()
}

/// A black gray picture of `size` (columns, rows) [px] with one round spot: a Gaussian of width `sigma` [px] around `centre`
/// [px], integrated over each pixel by 5 × 5 samples, that would reach `peak` [gray level] at its middle.
pub fn render_spot(size: [u32; 2], centre: [f64; 2], sigma: f64, peak: f64) -> Image {
    let [width, height] = size;
    let mut image = Image {
        camera: CameraId::default(),
        width,
        height,
        format: PixelFormat::Gray8,
        pixels: vec![0; width as usize * height as usize],
        ..Image::default()
    };
    add_spot(&mut image, centre, sigma, peak);
    image
}

/// Adds a spot as of [`render_spot`] to a gray picture; what exceeds 255 saturates.
pub fn add_spot(image: &mut Image, centre: [f64; 2], sigma: f64, peak: f64) {
    add_oval_spot(image, centre, [sigma; 2], peak);
}

/// The same with a width of its own along rows and along columns: a round spot where pixels are not square.
pub fn add_oval_spot(image: &mut Image, centre: [f64; 2], sigmas: [f64; 2], peak: f64) {
    let across = axis_weights(image.width, centre[0], sigmas[0]);
    let down = axis_weights(image.height, centre[1], sigmas[1]);
    for (row, vertical) in image.pixels.chunks_exact_mut(image.width as usize).zip(down) {
        for (pixel, horizontal) in row.iter_mut().zip(&across) {
            *pixel = (f64::from(*pixel) + peak * vertical * horizontal).round().clamp(0.0, 255.0) as u8;
        }
    }
}

/// For each pixel of one axis, the mean of exp(−d²/2σ²) over it.
fn axis_weights(length: u32, centre: f64, sigma: f64) -> Vec<f64> {
    const SAMPLES: [f64; 5] = [-0.4, -0.2, 0.0, 0.2, 0.4];
    let weight = |distance: f64| (-0.5 * (distance / sigma).powi(2)).exp();
    (0..length).map(|i| SAMPLES.iter().map(|shift| weight(f64::from(i) + shift - centre)).sum::<f64>() / 5.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_camera_of_the_ring_sees_the_whole_cube() {
        let points = point_cloud(500, 1);
        for camera in camera_ring(7) {
            assert!(points.iter().all(|point| camera.sees(point).is_some()), "{:?}", camera.centre());
        }
    }

    #[test]
    fn centre_of_mass_of_a_spot_is_its_centre() {
        let image = render_spot([41, 31], [20.3, 14.8], 2.0, 200.0);
        let (mut sum, mut moment) = (0.0, [0.0; 2]);
        for (i, &pixel) in image.pixels.iter().enumerate() {
            let weight = f64::from(pixel);
            sum += weight;
            moment[0] += weight * (i % 41) as f64;
            moment[1] += weight * (i / 41) as f64;
        }
        assert!((moment[0] / sum - 20.3).abs() < 0.01 && (moment[1] / sum - 14.8).abs() < 0.01, "{moment:?} {sum}");
    }

    #[test]
    fn ring_keeps_its_order_as_a_calibration() {
        let cameras: Vec<Camera> = ring_calibration(12).cameras.into_iter().map(|it| it.camera).collect();
        assert_eq!(cameras, camera_ring(12));
    }
}
