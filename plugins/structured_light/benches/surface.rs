//! Clouds joined into a surface: how many a second, few big ones and many thin ones along stripes.
//!
//! `cargo bench -p foveate-structured-light --bench surface`.

use std::hint::black_box;
use std::time::Instant;

use foveate::estimation::random::Random;
use foveate::geometry::surface::{MeshOptions, RegistrationOptions, SurfacePoint};
use foveate_structured_light::surface::{Model, ModelOptions, Piece};
use nalgebra::{Matrix3, Matrix6, Point3, Vector3};

/// Half the width of the surface [m].
const HALF: f64 = 0.12;
const SIGMA: f64 = 1e-4;

fn height(x: f64, y: f64) -> f64 {
    let nose = 0.025 * (-(x * x + y * y) / 3e-4).exp();
    -3.0 * x * x - 2.0 * y * y + nose + 0.004 * (60.0 * x).sin() * (45.0 * y).cos()
}

fn point(x: f64, y: f64, has_normal: bool, random: &mut Random) -> (SurfacePoint, [u8; 3]) {
    let slope = |dx: f64, dy: f64| (height(x + dx, y + dy) - height(x - dx, y - dy)) / 2e-6;
    let normal = Vector3::new(-slope(1e-6, 0.0), -slope(0.0, 1e-6), 1.0).normalize();
    let point = SurfacePoint {
        position: Point3::new(x, y, height(x, y) + SIGMA * random.normal()),
        covariance: Matrix3::from_diagonal(&Vector3::new(1e-10, 1e-10, SIGMA * SIGMA)),
        normal: if has_normal { normal } else { Vector3::zeros() },
    };
    (point, [128; 3])
}

fn model() -> Model {
    Model::new(ModelOptions {
        voxel_m: 0.001,
        truncation: 4.0,
        start_sigmas: [0.01, 0.07],
        max_pose_sigma_m: 0.0,
        keep_s: 0.0,
        registration: Some(RegistrationOptions::default()),
        max_bytes: 1_000_000_000,
    })
}

fn main() {
    let mut random = Random::new(1);
    let viewpoint = Point3::new(0.0, 0.0, 4.0);
    let mut full = |spacing: f64| {
        let n = (2.0 * HALF / spacing) as i32;
        let at = |it: i32| -HALF + spacing * f64::from(it);
        Piece {
            time_s: 0.0,
            points: (0..n * n).map(|it| point(at(it % n), at(it / n), true, &mut random)).collect(),
            viewpoint,
        }
    };
    let (big, start) = (full(0.0006), full(0.001));
    let mut joined = model();
    joined.join(big.clone(), &Matrix6::zeros()).expect("the first cloud has nothing to fit to");
    let n_points = big.points.len();
    let time = median(|| {
        black_box(joined.join(big.clone(), &Matrix6::zeros())).expect("it is the same surface");
    });
    println!("a cloud of {n_points} points: {time:.1} ms, {:.2} M points/s", 1e-3 * n_points as f64 / time);
    println!(
        "the surface of these: {:.1} ms",
        median(|| {
            black_box(joined.mesh(&MeshOptions { min_points: 0.5, min_triangles: 200 }));
        })
    );
    for lines in [2, 20] {
        let mut joined = model();
        joined.join(start.clone(), &Matrix6::zeros()).expect("the first cloud has nothing to fit to");
        let mut phase = 0.0;
        let mut thin = || {
            phase = (phase + 0.37) % 1.0;
            let apart = 2.0 * HALF / f64::from(lines);
            let places = (0..lines).flat_map(|line| {
                (0..150).map(move |it| (-HALF + apart * (f64::from(line) + phase), -HALF + 0.0016 * f64::from(it)))
            });
            Piece { time_s: 0.0, points: places.map(|(x, y)| point(x, y, true, &mut random)).collect(), viewpoint }
        };
        let clouds: Vec<Piece> = (0..40).map(|_| thin()).collect();
        let mut next = clouds.iter().cycle();
        let time = median(|| {
            black_box(joined.join(next.next().cloned().unwrap_or_default(), &Matrix6::zeros())).ok();
        });
        println!("a cloud of {} points along {lines} stripes: {time:.2} ms, {:.0} clouds/s", 150 * lines, 1e3 / time);
    }
}

/// Median of 21 runs after two [ms].
fn median(mut run: impl FnMut()) -> f64 {
    (0..2).for_each(|_| run());
    let mut times: Vec<f64> = (0..21)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
