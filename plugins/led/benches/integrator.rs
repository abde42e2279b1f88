//! Observations a second through the tracker, association and output included: unsynchronised cameras at 60 Hz, 0.5 px noise.

use std::f64::consts::TAU;
use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use foveate::messages::{Interval, Targets};
use foveate_led::tracker::{IntegratorSettings, Tracker};
use foveate_testkit::lab::{Lab, Light};
use nalgebra::Point3;

/// After this time the scene repeats itself [s].
const PERIOD: f64 = 8.0;

/// `N` lights on three rings around the room.
fn rings<const N: usize>(t: f64) -> [Light; N] {
    std::array::from_fn(|k| {
        let ring = (k % 3) as f64;
        let angle = TAU * (t / PERIOD + k as f64 / N as f64);
        let (s, c) = angle.sin_cos();
        let (a, b) = (0.5 + 0.35 * ring, 0.8 + 0.45 * ring);
        Light::at(Point3::new(a * c, b * s, 0.6 + 0.45 * ring + 0.15 * (3.0 * angle).sin()))
    })
}

fn bench_with<const N: usize>(criterion: &mut Criterion, n_cameras: usize, rate: f64) {
    let lab = Lab { noise: 0.5, rate, ..Lab::new(n_cameras) };
    let frames = lab.frames(PERIOD, &rings::<N>);
    let n_observations: usize = frames.iter().map(|(_, it)| it.list.len()).sum();
    let mut tracker = Tracker::new(IntegratorSettings::default(), lab.cameras.clone(), None);
    let mut targets = Targets::default();
    let mut rounds = 0.0;
    let mut group = criterion.benchmark_group("integrator");
    group.throughput(Throughput::Elements(n_observations as u64)).sample_size(20);
    group.bench_function(BenchmarkId::from_parameter(format!("{n_cameras}x{N}")), |bencher| {
        bencher.iter(|| {
            for (time, features) in &frames {
                tracker.observe(*time + Interval::from_s(rounds * PERIOD), features);
                tracker.write(&mut targets);
                black_box(&targets);
            }
            rounds += 1.0;
        });
    });
    group.finish();
    assert_eq!(tracker.n_targets(), N, "{:?}", tracker.tally());
}

fn integrator(criterion: &mut Criterion) {
    bench_with::<8>(criterion, 6, 60.0);
    bench_with::<8>(criterion, 18, 60.0);
    bench_with::<64>(criterion, 32, 60.0);
    bench_with::<8>(criterion, 1000, 5.0); // fewer frames a camera, so that the recording fits into memory
}

criterion_group!(benches, integrator);
criterion_main!(benches);
