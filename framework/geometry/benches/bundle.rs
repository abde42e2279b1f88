//! Times bundle adjustment in a room of 18 cameras, and with `--large` on 200 cameras and 20,000 points. With `--write DIR` it leaves
//! the problems there, which is how `tests/benches/peers/calibration.py` sets Ceres, SciPy and aniposelib beside it.

use std::fmt::Write as _;
use std::time::Instant;

use foveate_estimation::Random;
use foveate_geometry::{AlignmentOptions, BundleOptions, Camera, Freedom, Observation, adjust, align, camera_errors};
use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector2, Vector3};

const ROUNDS: usize = 50;
const SIGMA_PX: f64 = 0.5;

struct Room {
    truth: Vec<Camera>,
    true_points: Vec<Point3<f64>>,
    cameras: Vec<Camera>,
    points: Vec<Point3<f64>>,
    observations: Vec<Observation>,
}

/// Cameras all around a room, a light on a winding path, `views` pixels a point with noise; the start is 3°, 8 cm and 10 cm off.
fn room(n_cameras: usize, n_points: usize, views: usize, focal_free: bool) -> Room {
    let mut random = Random::new(30);
    let truth: Vec<Camera> = (0..n_cameras)
        .map(|index| {
            let angle = std::f64::consts::TAU * index as f64 / n_cameras as f64;
            let centre = Point3::new(2.6 * angle.cos(), 3.4 * angle.sin(), 2.7 + 0.2 * random.normal());
            let mut across = || angle + std::f64::consts::PI * random.uniform_in(0.6, 1.4);
            let target = Point3::new(0.9 * across().cos(), 1.3 * across().sin(), 1.0);
            Camera::look_at(centre, target, [640, 480], 420.0)
        })
        .collect();
    let place = |index: usize| {
        let phase = std::f64::consts::TAU * index as f64 / n_points as f64;
        Point3::new(1.6 * (5.0 * phase + 0.3).sin(), 2.2 * (3.3 * phase).sin(), 1.2 + 0.7 * (7.1 * phase).sin())
    };
    let true_points: Vec<Point3<f64>> = (0..n_points).map(place).collect();
    let mut observations = Vec::new();
    for (point, place) in true_points.iter().enumerate() {
        let mut seen: Vec<(usize, Point2<f64>)> =
            truth.iter().enumerate().filter_map(|(camera, it)| Some((camera, it.sees(place)?))).collect();
        for at in (1..seen.len()).rev() {
            seen.swap(at, random.below(at as u32 + 1) as usize);
        }
        for (camera, pixel) in seen.into_iter().take(views) {
            let pixel = pixel + Vector2::new(random.normal(), random.normal()) * SIGMA_PX;
            observations.push(Observation { camera, point, pixel, sigma_px: SIGMA_PX });
        }
    }
    let cameras = truth
        .iter()
        .map(|camera| {
            let mut draw = |size: f64| Vector3::new(random.normal(), random.normal(), random.normal()) * size;
            let turn = UnitQuaternion::from_scaled_axis(draw(3.0_f64.to_radians()));
            let pose = camera.camera_from_world;
            let translation = pose.translation.vector + draw(0.08);
            let mut moved = camera.clone();
            moved.camera_from_world = Isometry3::from_parts(translation.into(), turn * pose.rotation);
            if focal_free {
                moved.intrinsics.focal = [420.0 * (1.0 + 0.05 * random.normal()); 2];
            }
            moved
        })
        .collect();
    let points = true_points
        .iter()
        .map(|it| it + Vector3::new(random.normal(), random.normal(), random.normal()) * 0.1)
        .collect();
    Room { truth, true_points, cameras, points, observations }
}

fn report(name: &str, room: &Room, freedom: Freedom, rounds: usize) {
    let freedoms = vec![freedom; room.cameras.len()];
    let options = BundleOptions::default();
    let mut best = f64::INFINITY;
    let mut found = None;
    for _ in 0..rounds {
        let start = Instant::now();
        found = adjust(&room.cameras, &freedoms, &room.points, &room.observations, &options).ok();
        best = best.min(start.elapsed().as_secs_f64() * 1e3);
    }
    let Some(found) = found else { return println!("{name}: no answer") };
    let options = AlignmentOptions { scale: true, robust: false };
    let rms = |list: &[f64]| (list.iter().map(|it| it * it).sum::<f64>() / list.len() as f64).sqrt() * 1e3;
    let centres = camera_errors(&found.cameras, &room.truth, options).map_or(f64::NAN, |it| rms(&it.centres));
    let points = align(&found.points, &room.true_points, options).map_or(f64::NAN, |it| rms(&it.distances));
    println!(
        "{name:<34} {best:9.2} ms {:3} steps, {} observations, {:.4} px, centres {centres:.2} mm, points {points:.2} mm",
        found.iterations,
        room.observations.len(),
        found.rms_px,
    );
}

/// One file for the peers: a line for each camera (focal, quaternion w x y z, translation; truth, then start), point and observation.
fn write(room: &Room, path: &std::path::Path) -> std::io::Result<()> {
    let mut text = String::new();
    for (kind, cameras, points) in [("t", &room.truth, &room.true_points), ("s", &room.cameras, &room.points)] {
        for camera in cameras {
            let (q, t) = (camera.camera_from_world.rotation, camera.camera_from_world.translation.vector);
            let focal = camera.intrinsics.focal[0];
            let _ = writeln!(text, "c{kind} {focal} {} {} {} {} {} {} {}", q.w, q.i, q.j, q.k, t.x, t.y, t.z);
        }
        for point in points {
            let _ = writeln!(text, "p{kind} {} {} {}", point.x, point.y, point.z);
        }
    }
    for Observation { camera, point, pixel, .. } in &room.observations {
        let _ = writeln!(text, "o {camera} {point} {} {}", pixel.x, pixel.y);
    }
    std::fs::write(path, text)
}

/// What this process has held at most [MiB], where the system tells.
fn peak_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|it| it.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}

fn main() -> std::io::Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let folder = arguments.iter().position(|it| it == "--write").and_then(|it| arguments.get(it + 1));
    let leave = |room: &Room, name: &str| match folder {
        Some(folder) => write(room, &std::path::Path::new(folder).join(format!("room_{name}.txt"))),
        None => Ok(()),
    };
    let focal = Freedom { focal: true, ..Freedom::POSE };
    for (name, freedom) in [("known", Freedom::POSE), ("focal", focal)] {
        let room = room(18, 600, 6, freedom.focal);
        report(&format!("18 cameras x 600 points, {name}"), &room, freedom, ROUNDS);
        leave(&room, name)?;
    }
    if arguments.iter().any(|it| it == "--large") {
        let room = room(200, 20_000, 6, false);
        report("200 cameras x 20,000 points, known", &room, Freedom::POSE, 3);
        if let Some(mib) = peak_mib() {
            println!("the process held {mib:.0} MiB at most");
        }
        leave(&room, "large")?;
    }
    Ok(())
}
