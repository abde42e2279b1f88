//! Triangulates a point from the pixels of two cameras: `cargo run -p foveate-geometry --example triangulate`.

use foveate_geometry::{Camera, PixelNoise, refine, triangulate_rays};
use nalgebra::{Point2, Point3};

fn main() {
    // Two calibrated cameras, 3 m from the middle of a room: centre, target [m], image size [px], focal length [px].
    let target = Point3::new(0.0, 0.0, 1.0);
    let left = Camera::look_at(Point3::new(-1.5, -2.6, 1.8), target, [1280, 720], 1000.0);
    let right = Camera::look_at(Point3::new(1.5, -2.6, 1.8), target, [1280, 720], 1000.0);

    // Pixels of a light at (0.15, 0.20, 1.05), measured to half a pixel.
    let pixels = [Point2::new(648.8, 325.5), Point2::new(711.3, 336.8)];

    let rays = [left.ray(&pixels[0]).unwrap(), right.ray(&pixels[1]).unwrap()];
    let start = triangulate_rays(&rays).expect("the rays are not parallel");
    let found = refine(&[&left, &right], &pixels, PixelNoise::Sigma(0.5), start).expect("both cameras see the start");

    let sigma = found.covariance.diagonal().map(|it| 1e3 * it.sqrt());
    println!("position [m]:        {:.3}, {:.3}, {:.3}", found.position.x, found.position.y, found.position.z);
    println!("standard deviation:  {:.1}, {:.1}, {:.1} mm", sigma.x, sigma.y, sigma.z);
    println!("reprojection error:  {:.2} px", found.residuals_rms_px);
}
