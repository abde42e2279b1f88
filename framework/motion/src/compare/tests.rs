//! Motions that are known to be apart by so much are found to be.

use nalgebra::{Isometry3, Vector3};

use super::*;
use crate::motion::Sample;
use crate::motion::tests::motion;

/// Points that each move in their own way, from `start_s` on.
fn walk(rate_hz: f64, start_s: f64, duration_s: f64) -> Motion {
    let n_frames = (duration_s * rate_hz).round() as usize + 1;
    let times_s: Vec<f64> = (0..n_frames).map(|it| start_s + it as f64 / rate_hz).collect();
    let place = |t: f64, point: usize| {
        let own = point as f64;
        let wave = (2.0 + 0.3 * own) * t + own;
        Point3::new(
            0.8 * t + 0.2 * wave.sin(),
            0.3 * own + 0.1 * (1.7 * t).cos(),
            0.5 + 0.2 * own + 0.15 * (wave + 0.4 * t * t).cos(),
        )
    };
    let samples = times_s.iter().flat_map(|t| (0..4).map(|it| Some(Sample::at(place(*t, it))))).collect();
    Motion {
        labels: ["a", "b", "c", "d"].map(str::to_owned).to_vec(),
        times_s,
        rate_hz: Some(rate_hz),
        samples,
        ..Motion::default()
    }
}

fn moved(motion: &Motion, by: &Isometry3<f64>) -> Motion {
    let mut moved = motion.clone();
    moved.samples.iter_mut().flatten().for_each(|it| it.position = by * it.position);
    moved
}

/// Points in another order, under names that no other has.
fn anonymous(motion: &Motion, order: [usize; 4]) -> Motion {
    let mut other = motion.clone();
    other.labels = (0..4).map(|it| format!("unlabelled-{it}")).collect();
    for frame in 0..motion.n_frames() {
        for (to, from) in order.into_iter().enumerate() {
            other.samples[frame * 4 + to] = motion.samples[frame * 4 + from].clone();
        }
    }
    other
}

fn by(align: bool, most_shift_s: f64) -> CompareOptions {
    CompareOptions { pairing: None, align, most_shift_s }
}

/// What a file without a start, or that lost it, is held against is said.
#[test]
fn files_without_a_common_clock_are_said() {
    let mut a = motion(3, 60, 50.0);
    a.times_s.iter_mut().for_each(|it| *it += 0.5);
    let remarks = |a: &Motion, b: &Motion| compare(a, b, &CompareOptions::default()).unwrap().remarks;
    assert_eq!(remarks(&a, &a), Vec::<String>::new());
    let mut b = motion(3, 60, 50.0);
    b.lacks_start = true;
    let said = remarks(&a, &b);
    assert!(said[0].contains("A begins at 0.500 s, B at 0.000 s, but B does not say when it begins"), "{said:?}");
    assert!(remarks(&b, &a)[0].contains("but A does not say"));
    // Its start was lost on the way through another form.
    b.lacks_start = false;
    assert!(remarks(&a, &b)[0].contains("both have 60 frames at one rate"));
    let shorter = motion(3, 59, 50.0);
    assert_eq!(remarks(&a, &shorter), Vec::<String>::new());
    let looked_for = CompareOptions { most_shift_s: 1.0, ..CompareOptions::default() };
    assert!(!compare(&a, &b, &looked_for).unwrap().remarks.iter().any(|it| it.contains("begins")));
}

#[test]
fn a_known_offset_is_measured_point_by_point() {
    let a = walk(100.0, 0.0, 2.0);
    let mut b = moved(&a, &Isometry3::translation(0.003, 0.0, 0.004));
    // One point ten times as far off, one missing for a while, one under another name.
    for frame in 0..b.n_frames() {
        b.samples[frame * 4 + 1].as_mut().unwrap().position.y += 0.05;
    }
    (50..70).for_each(|it| b.samples[it * 4 + 2] = None);
    b.labels[3] = "e".to_owned();
    let found = compare(&a, &b, &by(false, 0.0)).unwrap();
    assert_eq!((found.pairing, found.n_frames, found.n_common), (Pairing::Names, 201, 201));
    let rows: Vec<_> =
        found.points.iter().map(|it| (it.name_a.as_str(), it.n, it.n_only, (it.median * 1e4).round())).collect();
    assert_eq!(rows, [("a", 201, [0, 0], 50.0), ("b", 201, [0, 0], 502.0), ("c", 181, [20, 0], 50.0)]);
    assert_eq!(found.only, [vec!["d".to_owned()], vec!["e".to_owned()]]);
    assert!((found.all.max - (0.05_f64.powi(2) + 25e-6).sqrt()).abs() < 1e-9, "{}", found.all.max);
    assert_eq!(found.all.n, 201 + 201 + 181);
}

#[test]
fn other_rates_are_interpolated() {
    for (rate_a, rate_b) in [(100.0, 60.0), (60.0, 100.0), (100.0, 99.0)] {
        let found = compare(&walk(rate_a, 0.0, 3.0), &walk(rate_b, 0.0, 3.0), &by(false, 0.0)).unwrap();
        assert!(found.all.n > 3 * 4 * 59 && found.all.max < 0.1e-3, "{rate_a} {rate_b}: {} m", found.all.max);
    }
}

#[test]
fn a_shift_in_time_is_found_within_a_frame_and_across_rates() {
    for (rate_b, shift_s) in [(100.0, 0.37), (60.0, -0.7231), (100.0, 0.0)] {
        let a = walk(100.0, 0.0, 6.0);
        let mut b = walk(rate_b, 0.0, 6.0);
        move_in_time(&mut b, -shift_s);
        let found = compare(&a, &b, &by(false, 1.0)).unwrap();
        assert!((found.shift_s - shift_s).abs() < 2e-4, "{} s, expected {shift_s}", found.shift_s);
        assert!(found.all.median < 0.5e-3, "{}", found.all.median);
        let unshifted = compare(&a, &b, &by(false, 0.0)).unwrap();
        assert!(shift_s == 0.0 || unshifted.all.median > 0.1, "{}", unshifted.all.median);
    }
    let mut late = walk(100.0, 0.0, 6.0);
    move_in_time(&mut late, 2.0);
    let found = compare(&walk(100.0, 0.0, 6.0), &late, &by(false, 0.5)).unwrap();
    assert!(found.all.median > 0.1, "the true one is not allowed");
}

#[test]
fn a_rigid_transform_is_taken_out_and_told() {
    let a = walk(100.0, 0.0, 3.0);
    let b_from_a = Isometry3::new(Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.3, 0.2, 2.0));
    let b = moved(&a, &b_from_a);
    assert!(compare(&a, &b, &by(false, 0.0)).unwrap().all.median > 1.0);
    let found = compare(&a, &b, &by(true, 0.0)).unwrap();
    assert!(found.all.max < 1e-9, "{}", found.all.max);
    let left = found.a_from_b.unwrap() * b_from_a;
    assert!(left.rotation.angle() < 1e-9 && left.translation.vector.norm() < 1e-9, "{left}");
    // Both at once: speeds know nothing of places.
    let mut late = b.clone();
    move_in_time(&mut late, 0.25);
    let found = compare(&a, &late, &by(true, 0.5)).unwrap();
    assert!((found.shift_s + 0.25).abs() < 1e-4 && found.all.median < 0.2e-3, "{} {}", found.shift_s, found.all.median);
}

#[test]
fn points_without_common_names_are_assigned() {
    let a = walk(100.0, 0.0, 3.0);
    let order = [2, 0, 3, 1];
    let near = Isometry3::new(Vector3::new(0.02, 0.0, -0.01), Vector3::z() * 0.02);
    for (align, bound) in [(false, 0.08), (true, 1e-6)] {
        let found = compare(&a, &anonymous(&moved(&a, &near), order), &by(align, 0.0)).unwrap();
        assert_eq!(found.pairing, Pairing::Nearest);
        let pairs: Vec<_> = found.points.iter().map(|it| (it.name_a.as_str(), it.name_b.as_str())).collect();
        assert_eq!(pairs, [("a", "unlabelled-1"), ("b", "unlabelled-3"), ("c", "unlabelled-0"), ("d", "unlabelled-2")]);
        assert!(found.all.max < bound, "{}", found.all.max);
    }
    let named = CompareOptions { pairing: Some(Pairing::Names), ..by(false, 0.0) };
    let refused = compare(&a, &anonymous(&a, order), &named).unwrap_err();
    assert!(refused.contains("no name in both (A has `a`, `b`, `c`, `d`"), "{refused}");
}

#[test]
fn names_go_together_whatever_their_spelling() {
    let names = |all: [&str; 4]| all.map(str::to_owned).to_vec();
    let pairs = by_names(&names(["Bob:LASI", "R.Knee", "x", "X"]), &names(["r_knee", "LASI", "X", "y"]));
    assert_eq!(pairs, [[0, 1], [1, 0], [3, 2]]);
}

#[test]
fn files_that_disagree_on_what_is_up_are_turned_or_not_whichever_fits() {
    let a = walk(100.0, 0.0, 1.0);
    let mut turned = a.clone();
    turned.turn(Up::Y);
    let wrongly = Motion { up: Up::Y, ..a.clone() };
    for (b, words) in [(turned, "B is turned"), (wrongly, "as they stand")] {
        let found = compare(&a, &b, &by(false, 0.0)).unwrap();
        assert!(found.all.max < 1e-12 && found.remarks[0].contains(words), "{:?}", found.remarks);
    }
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let a = walk(100.0, 0.0, 1.0);
    let refused = |b: &Motion, options: &CompareOptions| compare(&a, b, options).unwrap_err();
    assert!(refused(&Motion::default(), &by(false, 0.0)).contains("no samples in B"));
    assert!(refused(&walk(100.0, 5.0, 1.0), &by(false, 0.0)).contains("no common time"));
    assert!(refused(&walk(100.0, 50.0, 1.0), &by(false, 1.0)).contains("no shift within 1 s"));
    let mut still = a.clone();
    still.samples.iter_mut().flatten().for_each(|it| it.position = Point3::origin());
    assert!(refused(&still, &by(true, 0.0)).contains("cannot be aligned to A"));
    assert!(refused(&still, &by(false, 0.5)).contains("points move"));
}
