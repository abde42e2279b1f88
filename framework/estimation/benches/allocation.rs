//! Heads for targets in a hall: what the search loses against the optimum, and how long both take.

use std::hint::black_box;
use std::time::Instant;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use foveate_estimation::allocation::{Problem, Worth, optimal, search};
use foveate_estimation::{Random, Summary};
use nalgebra::Point3;

const CASES: usize = 300;

/// Heads on the walls of a hall of 12 × 9 m, targets in it that count 0.5 to 1; each pair costs up to 0.15, one in five cannot be.
fn hall(heads: usize, targets: usize, most: usize, random: &mut Random) -> Problem {
    let mut place = |x: f64, y: f64, z: f64| {
        Point3::new(random.uniform_in(-x, x), random.uniform_in(-y, y), random.uniform_in(0.0, z))
    };
    let on_wall = |head: usize, it: Point3<f64>| {
        if head.is_multiple_of(2) {
            Point3::new(it.x, 4.5_f64.copysign(it.y), it.z)
        } else {
            Point3::new(6.0_f64.copysign(it.x), it.y, it.z)
        }
    };
    let centres: Vec<Point3<f64>> = (0..heads).map(|head| on_wall(head, place(6.0, 4.5, 3.0))).collect();
    let places: Vec<Point3<f64>> = (0..targets).map(|_| place(4.5, 3.0, 2.0)).collect();
    let weights: Vec<f64> = (0..targets).map(|_| random.uniform_in(0.5, 1.0)).collect();
    let cost = |random: &mut Random| {
        if random.uniform() < 0.2 { f64::INFINITY } else { random.uniform_in(0.0, 0.15) }
    };
    let costs: Vec<f64> = (0..heads * targets).map(|_| cost(random)).collect();
    let towards: Vec<_> = centres.iter().flat_map(|centre| places.iter().map(move |it| centre - it)).collect();
    Problem::new(Worth::default(), most, &weights, &costs, &towards)
}

fn allocation(criterion: &mut Criterion) {
    println!("targets x heads, heads a target | loss mean, p95, worst | optimum found | ms: optimum, search (medians)");
    for (targets, heads, most) in [(8, 12, 2), (8, 12, 3), (8, 12, 4), (4, 12, 4), (5, 14, 3), (8, 14, 3)] {
        let mut random = Random::new(1).fork(&format!("{targets} {heads} {most}"));
        let (mut losses, mut exact_ms, mut search_ms) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..CASES {
            let problem = hall(heads, targets, most, &mut random);
            let start = Instant::now();
            let best = optimal(&problem);
            exact_ms.push(start.elapsed().as_secs_f64() * 1e3);
            let start = Instant::now();
            let found = search(&problem, &[]);
            search_ms.push(start.elapsed().as_secs_f64() * 1e3);
            losses.push((1.0 - found.total / best.total).max(0.0));
        }
        let found = losses.iter().filter(|it| **it < 1e-9).count();
        let of = |list: &[f64]| Summary::of(list).expect("there are cases");
        let (loss, exact, search) = (of(&losses), of(&exact_ms), of(&search_ms));
        println!(
            "{targets} x {heads}, {most} | {:.3} %, {:.2} %, {:.2} % | {found} of {CASES} | {:.2}, {:.2}",
            100.0 * loss.mean,
            100.0 * loss.p95,
            100.0 * loss.max,
            exact.median,
            search.median
        );
    }
    let mut group = criterion.benchmark_group("allocation");
    for (targets, heads, most) in [(8, 12, 2), (8, 12, 3), (8, 12, 4)] {
        let problem = hall(heads, targets, most, &mut Random::new(2));
        let name = format!("{targets}x{heads}, {most} a target");
        group.bench_function(BenchmarkId::new("optimal", name), |it| it.iter(|| optimal(black_box(&problem))));
    }
    for (targets, heads) in [(8, 12), (8, 24), (16, 40)] {
        let problem = hall(heads, targets, 3, &mut Random::new(2));
        let name = format!("{targets}x{heads}, 3 a target");
        group.bench_function(BenchmarkId::new("search", name), |it| it.iter(|| search(black_box(&problem), &[])));
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).without_plots();
    targets = allocation
}
criterion_main!(benches);
