//! Simulated people as a ring of cameras sees them, and the voxels that their silhouettes leave.

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_geometry::voxels::{CarveOptions, Carver, SilhouetteView, VoxelGrid};
use foveate_sim::person::Pose;
use nalgebra::{Point3, Vector3};

const BODY: u8 = 255;

/// Cameras around the room, alternately high and low.
pub fn ring(n: usize, size: [u32; 2]) -> Vec<Camera> {
    let focal = f64::from(size[0]) * 0.85;
    (0..n)
        .map(|i| {
            let angle = (i as f64 + 0.3) / n as f64 * std::f64::consts::TAU;
            let height = if i % 2 == 0 { 2.5 } else { 1.5 };
            let centre = Point3::new(3.6 * angle.cos(), 3.6 * angle.sin(), height);
            Camera::look_at(centre, Point3::new(0.0, 0.0, 0.95), size, focal)
        })
        .collect()
}

/// Balls along tapered limbs: a shape that shares nothing with the model that is fitted.
pub fn balls(pose: &Pose, girth: f64) -> Vec<(Point3<f64>, f64)> {
    let mut balls = Vec::new();
    let mut cone = |a: Point3<f64>, b: Point3<f64>, from: f64, to: f64, bulge: f64| {
        let n = ((b - a).norm() / 0.02).ceil().max(1.0) as usize;
        for i in 0..=n {
            let t = i as f64 / n as f64;
            let radius = from + (to - from) * t + bulge * (std::f64::consts::PI * (1.4 * t).min(1.0)).sin();
            balls.push((a + (b - a) * t, radius));
        }
    };
    for (number, part) in pose.parts.iter().enumerate() {
        let ([a, b], r) = (part.ends, part.radius);
        match number {
            3 => cone(a, b, r * 0.95, r, 0.0),
            4 => cone(a, b, r, r, 0.0),
            7 | 8 => cone(a, b, r * 1.1 * girth, r * 0.85 * girth, 0.0),
            9 | 10 => {
                let wrist = a + (b - a) * 0.72;
                cone(a, wrist, r * 1.05 * girth, r * 0.75 * girth, 0.006);
                cone(wrist, b, r * 0.8, r * 0.9, 0.008);
            }
            11 | 12 => cone(a, b, r * 1.15 * girth, r * 0.75 * girth, 0.0),
            13 | 14 => {
                cone(a, b, r * 1.05 * girth, r * 0.72 * girth, 0.012);
                let toes = b + pose.forward * 0.16 - Vector3::z() * 0.02;
                cone(b - pose.forward * 0.04, toes, r * 0.75, r * 0.6, 0.0);
            }
            _ => cone(a, b, r * girth.sqrt(), r * girth.sqrt(), 0.0),
        }
    }
    balls
}

pub fn mask(camera: &Camera, balls: &[(Point3<f64>, f64)]) -> Vec<u8> {
    let [width, height] = camera.image_size.map(|it| it as i32);
    let mut mask = vec![0; (width * height) as usize];
    for (centre, radius) in balls {
        let Some(pixel) = camera.project(centre) else { continue };
        let depth = (camera.camera_from_world * centre).z;
        disc(&mut mask, [width, height], [pixel.x, pixel.y], camera.intrinsics.focal[0] * radius / depth, BODY);
    }
    mask
}

fn disc(mask: &mut [u8], [width, height]: [i32; 2], [x, y]: [f64; 2], radius: f64, value: u8) {
    for row in ((y - radius).ceil() as i32).max(0)..=((y + radius).floor() as i32).min(height - 1) {
        let half = (radius.powi(2) - (f64::from(row) - y).powi(2)).max(0.0).sqrt();
        for column in ((x - half).ceil() as i32).max(0)..=((x + half).floor() as i32).min(width - 1) {
            mask[(row * width + column) as usize] = value;
        }
    }
}

/// What silhouettes have that are not the body's.
#[derive(Clone, Copy)]
pub enum Faults<'a> {
    None,
    /// Holes, shadows at the feet, views that are missing.
    Specks,
    /// Of each view what it lacks: number of a ball in thousandths of all, and a radius [m].
    Pieces(&'a [Option<(u32, f64)>]),
}

/// Up to half of the views lack a piece of the body as large as a head or half a trunk.
pub fn lost_pieces(cameras: &[Camera], random: &mut Random) -> Vec<Option<(u32, f64)>> {
    let one = |_: &Camera| (random.uniform() < 0.5).then(|| (random.below(1000), random.uniform_in(0.1, 0.35)));
    cameras.iter().map(one).collect()
}

/// Voxels whose centres lie in all silhouettes of one person.
pub fn carve(
    pose: &Pose,
    girth: f64,
    cameras: &[Camera],
    size: f64,
    faults: Faults,
    random: &mut Random,
) -> (Point3<f64>, Vec<[u16; 3]>) {
    let balls = balls(pose, girth);
    let mut masks: Vec<(&Camera, Vec<u8>)> = cameras.iter().map(|it| (it, mask(it, &balls))).collect();
    if let Faults::Pieces(pieces) = faults {
        for ((camera, mask), piece) in masks.iter_mut().zip(pieces) {
            let Some((number, radius)) = piece else { continue };
            let (centre, _) = balls[*number as usize * balls.len() / 1000];
            if let Some(pixel) = camera.project(&centre) {
                let depth = (camera.camera_from_world * centre).z;
                let size = camera.image_size.map(|it| it as i32);
                disc(mask, size, [pixel.x, pixel.y], camera.intrinsics.focal[0] * radius / depth, 0);
            }
        }
    }
    if let Faults::Specks = faults {
        if random.uniform() < 0.05 {
            masks.remove(random.below(cameras.len() as u32) as usize);
        }
        for (camera, mask) in &mut masks {
            let [width, height] = camera.image_size.map(|it| it as i32);
            let scale = f64::from(width) / 320.0;
            // Holes where clothes look like the background, shadows by the feet.
            for _ in 0..random.below(3) {
                let (centre, _) = balls[random.below(balls.len() as u32) as usize];
                if let Some(pixel) = camera.project(&centre) {
                    let radius = random.uniform_in(1.0, 3.0) * scale;
                    let at = [pixel.x + random.normal() * 4.0 * scale, pixel.y + random.normal() * 4.0 * scale];
                    disc(mask, [width, height], at, radius, 0);
                }
            }
            for _ in 0..random.below(3) {
                let ankle = pose.parts[13 + random.below(2) as usize].ends[1];
                let on_floor = Point3::new(ankle.x + 0.15 * random.normal(), ankle.y + 0.15 * random.normal(), 0.0);
                if let Some(pixel) = camera.project(&on_floor) {
                    disc(mask, [width, height], [pixel.x, pixel.y], random.uniform_in(2.0, 7.0) * scale, BODY);
                }
            }
        }
    }
    let grid = grid_around(&balls, size);
    let hull = hull(&mut Carver::default(), &grid, &masks);
    (grid.origin, hull)
}

/// A volume somewhat larger than the people, on one lattice, from the floor on.
pub fn grid_around(balls: &[(Point3<f64>, f64)], size: f64) -> VoxelGrid {
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for (centre, radius) in balls {
        low = low.inf(&(centre.coords.add_scalar(-radius)));
        high = high.sup(&(centre.coords.add_scalar(*radius)));
    }
    let mut first = (low.add_scalar(-0.25) / size).map(f64::floor);
    first.z = first.z.max(0.0);
    let n = ((high.add_scalar(0.25) / size).map(f64::ceil) - first).map(|it| it as u32);
    VoxelGrid { origin: Point3::from(first * size), size, cells: n.into() }
}

/// Voxels whose centres lie in all silhouettes.
pub fn hull(carver: &mut Carver, grid: &VoxelGrid, masks: &[(&Camera, Vec<u8>)]) -> Vec<[u16; 3]> {
    let views: Vec<SilhouetteView> = masks
        .iter()
        .map(|(camera, confidence)| {
            let [width, height] = camera.image_size;
            SilhouetteView { camera, left: 0, top: 0, shrink: 1, width, height, confidence }
        })
        .collect();
    let hull = carver.carve(grid, &views, &CarveOptions { may_err: 0, min_views: 0 }).expect("views of their sizes");
    hull.iter().map(|it| it.map(|it| it as u16)).collect()
}
