//! Tracks a moving light with a Kalman filter, one pixel at a time: `cargo run -p foveate-geometry --example track_light`.

use foveate_estimation::{ConstantVelocity, Random};
use foveate_geometry::Camera;
use nalgebra::{Matrix2, Matrix3, Point3, Vector2};

fn main() {
    let target = Point3::new(0.0, 0.0, 1.0);
    let cameras = [[-1.5, -2.6, 1.8], [1.5, -2.6, 1.8], [0.0, 3.0, 1.8]]
        .map(|centre| Camera::look_at(Point3::from(centre), target, [1280, 720], 1000.0));
    // The light circles once in three seconds; pixels are good to half a pixel.
    let truth = |time_s: f64| Point3::new(0.5 * (2.1 * time_s).cos(), 0.5 * (2.1 * time_s).sin(), 1.0);
    let (mut random, noise) = (Random::new(1), Matrix2::identity() * 0.25);

    // A rough first position (20 cm) and an unknown velocity (2 m/s).
    let mut track = ConstantVelocity::new(Point3::new(0.4, 0.1, 1.1), Matrix3::identity() * 0.04, 2.0);
    for frame in 1..=300 {
        let time_s = 0.01 * f64::from(frame);
        track.predict(0.01, 5.0);
        for camera in &cameras {
            let pixel = camera.project(&truth(time_s)).unwrap() + Vector2::from_fn(|_, _| 0.5 * random.normal());
            let (expected, jacobian) = camera.project_with_jacobian(&track.position).unwrap();
            track.update_pixel(pixel - expected, &jacobian, &noise);
        }
        if frame % 50 == 0 {
            let error_mm = 1e3 * (track.position - truth(time_s)).norm();
            println!("{time_s:.2} s: error {error_mm:.2} mm, speed {:.2} m/s", track.velocity.norm());
        }
    }
}
