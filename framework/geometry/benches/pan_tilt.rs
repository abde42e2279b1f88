//! Times aiming a pan-tilt head and its projection, and counts the steps that aiming takes.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use foveate_estimation::Random;
use foveate_geometry::pan_tilt::{Limits, PanTiltHead, Setting, aim};
use foveate_geometry::{Camera, Distortion};
use nalgebra::{Point2, Point3, Vector4};

const TARGETS: usize = 4096;

/// A head at the wall whose axes miss the lens by centimetres and lie degrees from where they should.
fn head() -> PanTiltHead {
    let mut camera = Camera::look_at(Point3::new(-3.0, 0.5, 2.4), Point3::new(0.0, 0.2, 1.4), [640, 480], 700.0);
    camera.distortion = Distortion { k1: -0.12, k2: 0.03, p1: 0.001, p2: -0.002, k3: 0.0 };
    let mut head = PanTiltHead::aligned(camera, Limits::symmetric(100f64.to_radians(), 25f64.to_radians()));
    head.pan = head.pan.moved(&Vector4::new(0.03, -0.05, 0.02, -0.04));
    head.tilt = head.tilt.moved(&Vector4::new(-0.04, 0.06, 0.03, -0.05));
    head
}

/// Targets that the head can have in the middle, the settings that do, and present settings `apart` from these [rad].
fn targets(head: &PanTiltHead, apart: f64) -> Vec<(Point3<f64>, Setting)> {
    let mut random = Random::new(7);
    let mut targets = Vec::with_capacity(TARGETS);
    for _ in 0..TARGETS {
        let wanted = Setting::new(random.uniform_in(-1.7, 1.7), random.uniform_in(-0.42, 0.42));
        let ray = head.camera_at(&wanted).ray(&Point2::new(319.5, 239.5));
        let mut off = || random.uniform_in(-apart, apart);
        let from = Setting::new(wanted.pan + off(), wanted.tilt + off());
        targets.extend(ray.map(|it| (it.at(random.uniform_in(1.0, 6.0)), head.limits.clamp(&from))));
    }
    targets
}

fn pan_tilt(criterion: &mut Criterion) {
    let head = head();
    let mut group = criterion.benchmark_group("pan_tilt");
    for (name, apart) in [("aim, the next frame", 0.01), ("aim, from anywhere", 1.7)] {
        let targets = targets(&head, apart);
        let mut iterations: Vec<u32> = Vec::new();
        let mut worst_px = 0.0_f64;
        for found in targets.iter().filter_map(|(target, from)| aim(&head, target, from).ok()) {
            iterations.push(found.iterations);
            worst_px = worst_px.max(found.off_centre_px);
        }
        iterations.sort_unstable();
        println!(
            "{name}: {} of {} aimed, {} steps (median), {} (most), {worst_px:.1e} px off at most",
            iterations.len(),
            targets.len(),
            iterations[iterations.len() / 2],
            iterations[iterations.len() - 1],
        );
        let mut next = 0;
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                next = (next + 1) % targets.len();
                aim(black_box(&head), &targets[next].0, &targets[next].1)
            })
        });
    }
    let beyond = head.camera_at(&Setting::new(2.1, 0.7)).ray(&Point2::new(319.5, 239.5)).map(|it| it.at(3.0));
    let beyond = beyond.unwrap_or_else(Point3::origin);
    group.bench_function("aim, beyond two limits", |bencher| {
        bencher.iter(|| aim(black_box(&head), &beyond, &Setting::new(1.5, 0.3)))
    });
    let (target, from) = targets(&head, 0.1)[0];
    group.bench_function("camera_at", |bencher| bencher.iter(|| black_box(&head).camera_at(&from)));
    group.bench_function("project_with_jacobian", |bencher| {
        bencher.iter(|| black_box(&head).project_with_jacobian(&target, &from))
    });
    group.finish();
}

criterion_group!(benches, pan_tilt);
criterion_main!(benches);
