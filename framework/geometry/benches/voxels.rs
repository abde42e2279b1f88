//! Time of carving: 2 m at 10 mm from four views with lenses, and how it grows with views and with the size of a voxel.
//!
//! A body of capsules, seated, about as large in four pictures of 644 × 486 px as the person of the recording that `docs/results.md` compares peers on. Each time holds
//! all that a new set of silhouettes costs: tables of sums, octree, bits. Nothing is kept from one to the next but memory.
//! `cargo bench -p foveate-geometry --bench voxels`; median and least of 40, one thread.

use std::time::Instant;

use foveate_geometry::voxels::{CarveOptions, Carver, Parts, SilhouetteView, VoxelGrid, colours, keeps};
use foveate_geometry::{Camera, Distortion};
use nalgebra::{Point2, Point3};

const SIZE: [u32; 2] = [644, 486];
/// Ends [m] and radius [m].
const BODY: [([f64; 3], [f64; 3], f64); 9] = [
    ([0.0, 0.0, 0.5], [0.0, 0.0, 0.95], 0.17),
    ([0.02, 0.0, 1.2], [0.0, 0.0, 1.28], 0.11),
    ([-0.1, 0.0, 0.48], [-0.12, 0.45, 0.5], 0.09),
    ([0.1, 0.0, 0.48], [0.12, 0.45, 0.5], 0.09),
    ([-0.12, 0.45, 0.5], [-0.14, 0.48, 0.05], 0.06),
    ([0.12, 0.45, 0.5], [0.14, 0.48, 0.05], 0.06),
    ([-0.22, 0.0, 1.0], [-0.25, 0.12, 0.7], 0.05),
    ([0.22, 0.0, 1.0], [0.25, 0.12, 0.7], 0.05),
    ([-0.2, -0.2, 0.0], [0.2, -0.2, 0.9], 0.03),
];

fn cameras(n: usize) -> Vec<Camera> {
    let camera = |at: usize| {
        let angle = (at as f64 + 0.2) * std::f64::consts::TAU / n as f64;
        let eye = Point3::new(3.4 * angle.cos(), 3.4 * angle.sin(), 1.4);
        let distortion = Distortion { k1: -0.3, k2: 0.12, p1: 0.001, p2: -0.001, k3: 0.0 };
        Camera { distortion, ..Camera::look_at(eye, Point3::new(0.0, 0.0, 0.7), SIZE, 490.0) }
    };
    (0..n).map(camera).collect()
}

fn silhouette(camera: &Camera) -> Vec<u8> {
    let is_body = |pixel: Point2<f64>| {
        let Some(ray) = camera.ray(&pixel) else { return 0 };
        let hits = BODY.iter().any(|(from, to, radius)| {
            let (from, to) = (Point3::from(*from), Point3::from(*to));
            (0..=8).any(|it| ray.distance_to(&(from + (to - from) * (f64::from(it) / 8.0))) < *radius)
        });
        if hits { 255 } else { 0 }
    };
    let pixels = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| Point2::new(f64::from(x), f64::from(y))));
    pixels.map(is_body).collect()
}

/// Median and least [ms].
fn time(mut work: impl FnMut()) -> [f64; 2] {
    let mut times: Vec<f64> = (0..40)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    [times[20], times[0]]
}

fn main() {
    let grid_of = |size: f64| {
        VoxelGrid::covering(Point3::new(-1.0, -1.0, 0.0), Point3::new(1.0, 1.0, 2.0), size).expect("a volume")
    };
    println!(
        "| views | voxel [mm] | may err | hull [l] | carving, median [ms] | least [ms] |\n|---|---|---|---|---|---|"
    );
    let mut carver = Carver::default();
    for (n, size, may_err) in [
        (4, 0.01, 0),
        (4, 0.05, 0),
        (4, 0.02, 0),
        (4, 0.005, 0),
        (2, 0.01, 0),
        (8, 0.01, 0),
        (16, 0.01, 0),
        (20, 0.01, 0),
        (4, 0.01, 1),
        (8, 0.01, 1),
        (20, 0.01, 2),
    ] {
        let cameras = cameras(n);
        let masks: Vec<Vec<u8>> = cameras.iter().map(silhouette).collect();
        let views: Vec<SilhouetteView> = cameras
            .iter()
            .zip(&masks)
            .map(|(camera, confidence)| SilhouetteView {
                camera,
                left: 0,
                top: 0,
                shrink: 1,
                width: SIZE[0],
                height: SIZE[1],
                confidence,
            })
            .collect();
        let (grid, options) = (grid_of(size), CarveOptions { may_err, min_views: 0 });
        let mut n_voxels = 0;
        let [median, least] = time(|| n_voxels = carver.carve(&grid, &views, &options).expect("sizes agree").count());
        let litres = n_voxels as f64 * size.powi(3) * 1e3;
        println!("| {n} | {} | {may_err} | {litres:.1} | {median:.2} | {least:.2} |", size * 1e3);
        if (n, may_err) == (4, 0) && size == 0.01 {
            let hull = carver.hull().clone();
            let [surface, _] = time(|| drop(std::hint::black_box(hull.surface())));
            let [parts, _] = time(|| drop(std::hint::black_box(Parts::of(&hull))));
            let [colour, _] = time(|| drop(std::hint::black_box(colours(&grid, &hull, &hull.surface(), &[]))));
            let start = Instant::now();
            let n_kept = (0..grid.cells[2])
                .flat_map(|z| (0..grid.cells[1]).flat_map(move |y| (0..grid.cells[0]).map(move |x| [x, y, z])))
                .filter(|it| keeps(&grid.centre(*it), &views, &options).is_some())
                .count();
            let every = start.elapsed().as_secs_f64() * 1e3;
            println!("every voxel by the definition: {every:.0} ms, {n_kept} voxels where the octree has {n_voxels}");
            println!("surface {surface:.2} ms, parts {parts:.2} ms, normals of the surface {colour:.2} ms");
        }
    }
}
