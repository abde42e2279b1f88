//! Clocks that were moved and are found again, derivatives against differences, and what must be refused.

use foveate_estimation::{Loss, Random};

use super::super::{Gauge, Stop};
use super::*;
use crate::test_room;

/// A room whose cameras look at the light too late by `offset + drift · time`, in a minute around time 0.
struct Room {
    cameras: Vec<Camera>,
    points: Vec<Point3<f64>>,
    observations: Vec<Observation>,
    velocities: Vec<Vector2<f64>>,
    times_s: Vec<f64>,
}

fn room(clocks: &[[f64; 2]], n_points: usize, sigma: f64, seed: u64) -> Room {
    let mut random = Random::new(seed);
    let cameras = test_room::cameras(clocks.len(), 4);
    let points = test_room::path(n_points);
    let mut observations = test_room::observations(&cameras, &points, 5, sigma, &mut random);
    let time = |point: usize| 60.0 * (point as f64 / n_points as f64 - 0.5);
    let (mut velocities, mut times_s) = (Vec::new(), Vec::new());
    for it in &mut observations {
        // Directions that differ between cameras, as they do where a light moves in space.
        let phase = 0.37 * it.point as f64 + 1.3 * it.camera as f64;
        let velocity = Vector2::new(phase.cos(), (1.7 * phase).sin()) * 300.0;
        let [offset, drift] = clocks[it.camera];
        it.pixel -= velocity * (offset + drift * time(it.point));
        velocities.push(velocity);
        times_s.push(time(it.point));
    }
    Room { cameras, points, observations, velocities, times_s }
}

#[track_caller]
fn adjusted(room: &Room, free: &[ClockFreedom], gauge: ClockGauge, freedom: Freedom) -> AdjustedWithClocks {
    let timing = Timing { velocities: &room.velocities, times_s: &room.times_s, free, gauge };
    let options = BundleOptions { covariance: true, relative_gain: 1e-12, ..BundleOptions::default() };
    let freedoms = vec![freedom; room.cameras.len()];
    adjust_with_clocks(&room.cameras, &freedoms, &room.points, &room.observations, &timing, &[], &options).unwrap()
}

fn free_but(reference: usize, n: usize, freedom: ClockFreedom) -> Vec<ClockFreedom> {
    (0..n).map(|it| if it == reference { ClockFreedom::NONE } else { freedom }).collect()
}

#[test]
fn clocks_that_were_moved_are_found_again() {
    let clocks = [[0.0, 0.0], [0.03, 2e-4], [-0.05, 0.0], [0.011, -5e-4], [0.0, 1e-4], [-0.02, 0.0]];
    let room = room(&clocks, 300, 0.0, 1);
    let free = free_but(0, 6, ClockFreedom::BOTH);
    for freedom in [
        Freedom::POSE,
        Freedom { focal: true, ..Freedom::POSE },
        Freedom { focal: true, k1: true, k2: true, ..Freedom::POSE },
    ] {
        let found = adjusted(&room, &free, ClockGauge::Camera(0), freedom);
        assert!(found.adjusted.rms_px < 1e-6, "{freedom:?} {}", found.adjusted.rms_px);
        for (found, [offset, drift]) in found.clocks.iter().zip(clocks) {
            assert!((found.offset_s - offset).abs() < 1e-8 && (found.drift - drift).abs() < 1e-9, "{found:?}");
        }
        assert_eq!(found.clocks[0], ClockShift::default());
        assert!(found.clocks[1].offset_sigma_s > 0.0 && found.clocks[1].drift_sigma > 0.0);
    }
    let held = adjusted(&room, &[ClockFreedom::NONE; 6], ClockGauge::Mean, Freedom::POSE);
    assert!(held.adjusted.rms_px > 1.0, "{}", held.adjusted.rms_px);
}

#[test]
fn against_the_mean_the_shifts_add_up_to_nothing() {
    let clocks = [[0.004, 0.0], [0.03, 0.0], [-0.05, 0.0], [0.011, 0.0]];
    let room = room(&clocks, 200, 0.3, 2);
    let mean = adjusted(&room, &[ClockFreedom::OFFSET; 4], ClockGauge::Mean, Freedom::POSE);
    let one = adjusted(&room, &free_but(0, 4, ClockFreedom::OFFSET), ClockGauge::Camera(0), Freedom::POSE);
    let sum: f64 = mean.clocks.iter().map(|it| it.offset_s).sum();
    assert!(sum.abs() < 1e-12, "{sum}");
    for camera in 1..4 {
        let difference = mean.clocks[camera].offset_s - mean.clocks[0].offset_s;
        assert!((difference - one.clocks[camera].offset_s).abs() < 1e-9, "{difference}");
    }
    // No choice of one camera knows all clocks better than that of the mean.
    let squares = |it: &AdjustedWithClocks| it.clocks.iter().map(|it| it.offset_sigma_s.powi(2)).sum::<f64>();
    assert!(squares(&mean) < squares(&one) && mean.clocks.iter().all(|it| it.offset_sigma_s > 0.0));
}

#[test]
fn errors_of_clocks_are_as_large_as_their_sigma() {
    let runs = 120;
    let (mut offsets, mut drifts) = (0.0, 0.0);
    for seed in 0..runs {
        let clocks = [[0.0, 0.0], [0.01, 1e-4], [-0.02, 0.0], [0.0, -1e-4], [0.005, 0.0]];
        let room = room(&clocks, 80, 0.5, 100 + seed);
        let found = adjusted(&room, &free_but(0, 5, ClockFreedom::BOTH), ClockGauge::Camera(0), Freedom::POSE);
        let (it, [offset, drift]) = (&found.clocks[3], clocks[3]);
        offsets += ((it.offset_s - offset) / it.offset_sigma_s).powi(2) / runs as f64;
        drifts += ((it.drift - drift) / it.drift_sigma).powi(2) / runs as f64;
    }
    // χ² with one degree of freedom: 1 ± 4 standard errors of √(2/120).
    assert!((0.48..1.52).contains(&offsets) && (0.48..1.52).contains(&drifts), "{offsets} {drifts}");
}

#[test]
fn gradients_are_those_of_the_cost() {
    use super::super::columns;
    use super::super::equations::{Equations, Layout};
    let room = room(&[[0.01, 1e-4], [0.02, 0.0], [0.0, 0.0]], 12, 0.4, 7);
    let n = room.cameras.len();
    let mut order: Vec<usize> = (0..room.observations.len()).collect();
    order.sort_by_key(|it| (room.observations[*it].point, room.observations[*it].camera));
    let mut of_point = vec![0..0; room.points.len()];
    for (point, range) in of_point.iter_mut().enumerate() {
        let of = |below: usize| order.iter().filter(|it| room.observations[**it].point < below).count();
        *range = of(point)..of(point + 1);
    }
    let layout = Layout {
        observations: order.iter().map(|it| room.observations[*it]).collect(),
        motions: order.iter().map(|it| (room.velocities[*it], room.times_s[*it])).collect(),
        of_point,
        rows: vec![[None; columns::N_NAMES]; n],
        names: Vec::new(),
        slots: (0..n).map(Some).collect(),
        lengths: Vec::new(),
        known_optics: Vec::new(),
        coupled: vec![false; room.points.len()],
        anchors: Vec::new(),
        dimension: 0,
    };
    let cost = |cameras: &[Camera], clocks: &[[f64; 2]], points: &[Point3<f64>]| {
        let mut equations = Equations::<17, true>::new(&layout, points.len());
        equations.fill(&layout, cameras, clocks, points, &Loss::HUBER).unwrap();
        equations
    };
    let clocks = vec![[0.003, 2e-5], [-0.004, 1e-5], [0.002, 0.0]];
    let here = cost(&room.cameras, &clocks, &room.points);
    for camera in 0..n {
        for column in 0..17_usize {
            let step = 1e-6;
            let at = |size: f64| {
                let (mut cameras, mut clocks) = (room.cameras.clone(), clocks.clone());
                let mut block = [0.0; 15];
                match column.checked_sub(15) {
                    Some(kind) => clocks[camera][kind] += size,
                    None => {
                        block[column] = size;
                        cameras[camera] = columns::moved(&cameras[camera], &block);
                    }
                }
                cost(&cameras, &clocks, &room.points).cost
            };
            let slope = (at(step) - at(-step)) / (2.0 * step);
            let stated = here.gradient_of_camera[camera][column];
            assert!((slope - stated).abs() < 1e-4 * (1.0 + stated.abs()), "{camera} {column}: {slope} {stated}");
        }
    }
}

#[test]
fn clocks_that_nothing_holds_are_named() {
    let mut room = room(&[[0.0; 2]; 4], 60, 0.5, 9);
    // Pixels that do not move say nothing about time.
    for (velocity, it) in room.velocities.iter_mut().zip(&room.observations) {
        if it.camera == 2 {
            *velocity = Vector2::zeros();
        }
    }
    let found = adjusted(&room, &free_but(0, 4, ClockFreedom::OFFSET), ClockGauge::Camera(0), Freedom::POSE);
    let open = found.adjusted.covariance.unwrap().unwrap_err();
    assert_eq!(open.parameters, [(2, "clock offset")]);
    assert!(found.adjusted.stop != Stop::IterationLimit && found.clocks[2].offset_sigma_s == f64::INFINITY);
    assert_eq!(found.clocks[0].offset_sigma_s, 0.0);
}

#[test]
fn bad_timing_is_refused_by_place() {
    let room = room(&[[0.0; 2]; 3], 30, 0.5, 10);
    let free = free_but(1, 3, ClockFreedom::OFFSET);
    let good =
        Timing { velocities: &room.velocities, times_s: &room.times_s, free: &free, gauge: ClockGauge::Camera(1) };
    let fault = |timing: Timing<'_>| {
        let options = BundleOptions { gauge: Gauge::Inner, ..BundleOptions::default() };
        let freedoms = [Freedom::POSE; 3];
        adjust_with_clocks(&room.cameras, &freedoms, &room.points, &room.observations, &timing, &[], &options)
            .unwrap_err()
            .to_string()
    };
    assert!(fault(Timing { velocities: &room.velocities[1..], ..good }).contains("velocities"));
    assert!(fault(Timing { free: &free[1..], ..good }).contains("2 freedoms of 3 cameras"));
    assert!(fault(Timing { gauge: ClockGauge::Camera(0), ..good }).contains("reference camera 0"));
    assert!(fault(Timing { gauge: ClockGauge::Camera(7), ..good }).contains("reference camera 7"));
    let mut broken = room.times_s.clone();
    broken[4] = f64::NAN;
    assert!(fault(Timing { times_s: &broken, ..good }).contains("observation 4"));
}
