//! Times projection, its Jacobian, rays, triangulation and the refinement of a pose; the best of several rounds, in ns a call.

use std::hint::black_box;
use std::time::Instant;

use foveate_geometry::{
    Camera, Distortion, PixelNoise, Ray, ResectionOptions, closest_approach, refine, refine_pose, triangulate_rays,
};
use nalgebra::{Point3, Translation3};

const ROUNDS: usize = 50;

fn time<T>(name: &str, calls: usize, mut call: impl FnMut(usize) -> T) {
    let round = |call: &mut dyn FnMut(usize) -> T| {
        let start = Instant::now();
        (0..calls).for_each(|index| drop(black_box(call(index))));
        start.elapsed().as_nanos() as f64 / calls as f64
    };
    let best = (0..ROUNDS).map(|_| round(&mut call)).fold(f64::INFINITY, f64::min);
    println!("{name:<34} {best:8.1} ns");
}

fn main() {
    let cameras: Vec<Camera> = (0..6)
        .map(|index| {
            let angle = f64::from(index);
            let centre = Point3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 1.0);
            let mut camera = Camera::look_at(centre, Point3::origin(), [640, 480], 500.0);
            camera.distortion = Distortion { k1: -0.2, k2: 0.05, p1: 0.001, p2: -0.002, k3: 0.0 };
            camera
        })
        .collect();
    let points: Vec<Point3<f64>> = (0..64)
        .map(|it| Point3::new(f64::from(it % 4) * 0.2, f64::from(it / 4 % 4) * 0.2, f64::from(it / 16) * 0.2))
        .collect();
    let camera = |index: usize| &cameras[index % 6];
    time("project", 20_000, |it| camera(it).project(&points[it % 64]));
    time("project_with_jacobian", 20_000, |it| camera(it).project_with_jacobian(&points[it % 64]));
    let pixels: Vec<_> = (0..384).filter_map(|it| camera(it).project(&points[it % 64])).collect();
    time("ray", 20_000, |it| camera(it % 384).ray(&pixels[it % 384]));
    let rays: Vec<Ray> = cameras.iter().filter_map(|it| it.ray(&it.project(&points[5])?)).collect();
    time("closest_approach", 20_000, |it| closest_approach(&rays[it % 3], &rays[3 + it % 3]));
    time("triangulate_rays, 6 rays", 5_000, |_| triangulate_rays(&rays));
    let list: Vec<&Camera> = cameras.iter().collect();
    let seen: Vec<_> = cameras.iter().filter_map(|it| it.project(&points[5])).collect();
    time("refine, 6 cameras, 1 cm off", 1_000, |_| {
        refine(&list, &seen, PixelNoise::Sigma(0.1), points[5] + nalgebra::Vector3::new(0.01, 0.0, 0.0))
    });
    let own = &cameras[0];
    let (near, at): (Vec<_>, Vec<_>) = points.iter().filter_map(|it| Some((*it, own.project(it)?))).unzip();
    let mut moved = own.clone();
    moved.camera_from_world *= Translation3::new(0.01, -0.02, 0.01);
    time("refine_pose, 64 points, 2 cm off", 1_000, |_| refine_pose(&moved, &near, &at, &ResectionOptions::default()));
}
