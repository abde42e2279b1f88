//! Calibrates four cameras from points that all of them see (bundle adjustment):
//! `cargo run -p foveate-geometry --example adjust_cameras`.

use foveate_estimation::Random;
use foveate_geometry::{AlignmentOptions, BundleOptions, Camera, Freedom, Observation, adjust, camera_errors};
use nalgebra::{Point3, Vector3};

fn main() {
    // A scene with known truth: four cameras around 60 points, pixels up to half a pixel off.
    let mut random = Random::new(1);
    let mut draw = |size: f64| Vector3::from_fn(|_, _| random.uniform_in(-size, size));
    let centre = Point3::new(0.0, 0.0, 1.0);
    let truth = [[3.0, 0.0, 2.0], [0.0, 3.0, 2.5], [-3.0, 0.0, 1.5], [0.0, -3.0, 2.0]]
        .map(|it| Camera::look_at(Point3::from(it), centre, [1280, 720], 1000.0));
    let points: Vec<_> = (0..60).map(|_| centre + draw(0.8)).collect();
    let mut observations = Vec::new();
    for (camera, it) in truth.iter().enumerate() {
        for (point, position) in points.iter().enumerate() {
            let pixel = it.project(position).unwrap() + draw(0.5).xy();
            observations.push(Observation { camera, point, pixel, sigma_px: 0.3 });
        }
    }

    // A start with all cameras and points up to ten centimetres off, and wrong focal lengths.
    let start = truth.clone().map(|mut it| {
        it.camera_from_world.translation.vector += draw(0.1);
        it.intrinsics.focal = [1030.0; 2];
        it
    });
    let start_points: Vec<_> = points.iter().map(|it| it + draw(0.1)).collect();
    let freedom = Freedom { focal: true, ..Freedom::POSE };
    let found = adjust(&start, &[freedom; 4], &start_points, &observations, &BundleOptions::default())
        .expect("every point is seen by two cameras");

    println!("rms {:.2} px after {} iterations", found.rms_px, found.iterations);
    // Pixels leave place, rotation and scale of the whole open: compare after the best similarity.
    let errors = camera_errors(&found.cameras, &truth, AlignmentOptions { scale: true, robust: false }).unwrap();
    for (camera, it) in found.cameras.iter().enumerate() {
        let (centre_mm, focal) = (1e3 * errors.centres[camera], it.intrinsics.focal[0]);
        println!("camera {camera}: centre {centre_mm:.1} mm off, focal length {focal:.1} px (truth 1000)");
    }
}
