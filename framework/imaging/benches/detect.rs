//! Time and error of spot detection, on the scene that `benches/peer_detect.py` gives to OpenCV.
//!
//! Eight Gaussian spots (σ 1.6 px, 200 gray levels over 20), noise of 3 gray levels, background table of 32 + 25 for
//! each pixel. `cargo bench -p foveate-imaging`.

#[path = "../tests/it/scene.rs"]
mod scene;

use std::hint::black_box;
use std::time::Instant;

use criterion::{BenchmarkId, Criterion};
use foveate_estimation::random::Random;
use foveate_imaging::{Centroid, ImageView, Measure, Sampling, Spot, SpotFinder, SpotLimits, ThresholdMap, Window};
use nalgebra::Point2;

use crate::scene::{Look, places};

const N_PICTURES: usize = 30;
const OFFSET: u8 = 25;
const WINDOW_PX: u32 = 40;
const GRID_PX: usize = 5;

struct Scene {
    width: usize,
    height: usize,
    pictures: Vec<(Vec<u8>, Vec<Point2<f64>>)>,
    thresholds: ThresholdMap,
}

impl Scene {
    fn new(width: usize, height: usize) -> Self {
        let mut random = Random::new(20020601);
        let picture = |_| {
            let centres = places(8, width, height, &mut random);
            (Look::LED.render(width, height, &centres, &mut random), centres)
        };
        let pictures = (0..N_PICTURES).map(picture).collect();
        Self { width, height, pictures, thresholds: ThresholdMap::uniform(32 + OFFSET, width, height) }
    }

    fn view(&self, i: usize) -> ImageView<'_> {
        ImageView::new(&self.pictures[i % N_PICTURES].0, self.width, self.height).expect("rendered at this size")
    }

    /// Where the spots of picture `i` are expected: off by up to 5 px.
    fn windows(&self, i: usize) -> Vec<Window> {
        let off = |k: usize| nalgebra::Vector2::new((k * 7 % 11) as f64 - 5.0, (k * 5 % 11) as f64 - 5.0);
        let centres = &self.pictures[i % N_PICTURES].1;
        centres.iter().enumerate().map(|(k, it)| Window::around(it + off(k), WINDOW_PX)).collect()
    }
}

fn finder(centroid: Centroid) -> SpotFinder {
    SpotFinder::new(Measure { centroid, foot: OFFSET, ..Default::default() }).expect("settings in range")
}

/// Time a picture: the whole frame, and a grid with windows.
///
/// "in turn": the 30 pictures one after the other, so that each comes from behind the second cache, as it is for the
/// peer. "again": the same picture, as when the program that decoded it has just left it in the second cache.
fn time(criterion: &mut Criterion) {
    let limits = SpotLimits::default();
    for (width, height) in [(640, 480), (640, 240), (1280, 1024)] {
        let scene = Scene::new(width, height);
        let windows: Vec<_> = (0..N_PICTURES).map(|i| scene.windows(i)).collect();
        let mut group = criterion.benchmark_group(format!("{width}x{height}"));
        for (order, step) in [("in turn", 1), ("again", 0)] {
            let (mut finder, mut spots, mut i, mut sequence) = (finder(Centroid::Weighted), Vec::<Spot>::new(), 0, 0);
            group.bench_function(BenchmarkId::new("read only", order), |b| {
                b.iter(|| {
                    i += step;
                    scene.view(black_box(i)).pixels().iter().fold(0u8, |top, &it| top.max(it))
                })
            });
            group.bench_function(BenchmarkId::new("full frame", order), |b| {
                b.iter(|| {
                    i += step;
                    let found = finder.find_full(&scene.view(i), &scene.thresholds, &limits, &mut spots);
                    assert_eq!(spots.len(), 8);
                    found
                })
            });
            group.bench_function(BenchmarkId::new("grid 5 px and 8 windows of 40 px", order), |b| {
                b.iter(|| {
                    i += step;
                    sequence += 1;
                    let (sampling, windows) = (Sampling::of_frame(sequence, GRID_PX), &windows[i % N_PICTURES]);
                    let (view, table) = (scene.view(i), &scene.thresholds);
                    let found = finder.find_sampled(&view, table, sampling, windows, &limits, &mut spots);
                    assert_eq!(spots.len(), 8);
                    found
                })
            });
        }
        group.finish();
    }
}

/// Time of the pictures that take longest: all lit, and lit in single pixels.
fn worst(criterion: &mut Criterion) {
    let (width, height) = (640, 480);
    let single = |i: usize| if (i % width).is_multiple_of(2) && (i / width).is_multiple_of(2) { 200 } else { 0 };
    let table = ThresholdMap::uniform(57, width, height);
    let (mut finder, mut spots) = (finder(Centroid::Weighted), Vec::<Spot>::new());
    let mut group = criterion.benchmark_group(format!("{width}x{height} worst"));
    let unlimited = SpotLimits { max_components: usize::MAX, ..Default::default() };
    for (name, pixels, limits) in [
        ("all white", vec![255; width * height], SpotLimits::default()),
        ("76,800 single pixels", (0..width * height).map(single).collect(), SpotLimits::default()),
        ("76,800 single pixels, no limit", (0..width * height).map(single).collect(), unlimited),
    ] {
        let view = ImageView::new(&pixels, width, height).expect("made at this size");
        group.bench_function(name, |b| b.iter(|| finder.find_full(&view, &table, &limits, &mut spots)));
    }
    group.finish();
}

/// Median and least of 200 rounds over the 30 pictures: the least is what the work takes when no other program has the
/// machine's attention, which criterion's mean does not show. The peer's script prints the same two.
fn rounds() {
    let limits = SpotLimits::default();
    for (width, height) in [(640, 480), (640, 240), (1280, 1024)] {
        let scene = Scene::new(width, height);
        let windows: Vec<_> = (0..N_PICTURES).map(|i| scene.windows(i)).collect();
        let (mut finder, mut spots) = (finder(Centroid::Weighted), Vec::<Spot>::new());
        let print = |name: &str, work: &mut dyn FnMut(usize)| {
            let mut times: Vec<f64> = (0..200)
                .map(|_| {
                    let start = Instant::now();
                    (0..N_PICTURES).for_each(&mut *work);
                    start.elapsed().as_secs_f64() * 1e3 / N_PICTURES as f64
                })
                .collect();
            times.sort_by(f64::total_cmp);
            println!("{width}x{height} {name}: median {:.4} ms, least {:.4} ms", times[100], times[0]);
        };
        print("read only", &mut |i| {
            black_box(scene.view(i).pixels().iter().fold(0u8, |top, &it| top.max(it)));
        });
        print("full frame", &mut |i| {
            black_box(finder.find_full(&scene.view(i), &scene.thresholds, &limits, &mut spots)).expect("sizes agree");
        });
        for (name, step) in [("in turn", 1), ("again", 0)] {
            print(&format!("grid 5 px and 8 windows of 40 px, {name}"), &mut |i| {
                let (view, windows) = (scene.view(i * step), &windows[i * step]);
                let sampling = Sampling::of_frame(i as u64, GRID_PX);
                let found = finder.find_sampled(&view, &scene.thresholds, sampling, windows, &limits, &mut spots);
                black_box(found).expect("sizes agree");
            });
        }
    }
}

/// Distance from each true centre to the nearest spot.
fn accuracy() {
    for (width, height) in [(640, 480), (640, 240), (1280, 1024)] {
        let scene = Scene::new(width, height);
        for centroid in [Centroid::Weighted, Centroid::Integer] {
            let (mut finder, mut spots, mut errors) = (finder(centroid), Vec::new(), Vec::new());
            for (i, (_, centres)) in scene.pictures.iter().enumerate() {
                let limits = SpotLimits::default();
                finder.find_full(&scene.view(i), &scene.thresholds, &limits, &mut spots).expect("sizes agree");
                for centre in centres {
                    let nearest = spots.iter().map(|it| (it.centre - centre).norm()).fold(f64::INFINITY, f64::min);
                    errors.push(nearest);
                }
            }
            errors.sort_by(f64::total_cmp);
            let (n, mean) = (errors.len(), errors.iter().sum::<f64>() / errors.len() as f64);
            println!(
                "{width}x{height} {centroid:?}: error of {n} spots: mean {mean:.4} px, p95 {:.4} px",
                errors[n * 95 / 100]
            );
        }
    }
}

fn main() {
    accuracy();
    rounds();
    let mut criterion = Criterion::default().configure_from_args();
    time(&mut criterion);
    worst(&mut criterion);
    criterion.final_summary();
}
