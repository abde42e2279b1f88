//! What the score counts, tried.

use foveate_messages::{Provenance, Target, Time};
use nalgebra::{Matrix6, Vector3};

use super::*;

fn target(id: u32, position: Point3<f64>, velocity: Vector3<f64>) -> Target {
    let covariance = Matrix6::zeros();
    Target {
        id: TargetId(id),
        position,
        velocity,
        covariance,
        cameras: Default::default(),
        provenance: Provenance::Measured,
    }
}

fn targets(time_s: f64, list: Vec<Target>) -> Arc<Targets> {
    Arc::new(Targets { time: Time::from_s(time_s), list })
}

/// Two targets on circles of 0.5 m radius, 1 m/s, 2 m apart.
fn truth_at(time_s: f64) -> [(Point3<f64>, Vector3<f64>); 2] {
    let (sine, cosine) = (2.0 * time_s).sin_cos();
    let around = |x: f64| (Point3::new(x + 0.5 * cosine, 0.5 * sine, 1.0), Vector3::new(-sine, cosine, 0.0));
    [around(0.0), around(2.0)]
}

/// Truth at 60 Hz for 2 s; every 7 ms whatever `recover` makes of the true positions.
fn figures(recover: impl Fn(f64, [Point3<f64>; 2]) -> Vec<Target>) -> BTreeMap<String, f64> {
    let mut scorer = Scorer::new(0.1, 0.0, None);
    let mut recovered = (0..286).map(|i| f64::from(i) * 0.007 + 0.0005).peekable();
    for step in 0..=120 {
        let time = f64::from(step) / 60.0;
        // Recovered samples come before the truth that follows them.
        while let Some(time) = recovered.next_if(|it| *it < time) {
            scorer.recovered(targets(time, recover(time, truth_at(time).map(|it| it.0))));
        }
        let list = (0..).zip(truth_at(time)).map(|(id, (position, velocity))| target(id, position, velocity));
        scorer.truth(targets(time, list.collect()));
    }
    let mut report = Report::default();
    scorer.finish(&mut report);
    report.figures
}

fn at(id: u32, position: Point3<f64>) -> Target {
    target(id, position, Vector3::zeros())
}

#[test]
fn perfect_recovery_scores_perfectly() {
    let found = figures(|_, [a, b]| vec![at(7, a), at(9, b)]);
    for (name, value) in [
        ("targets_true", 2.0),
        ("identities", 2.0),
        ("identities_per_target", 1.0),
        ("id_switches", 0.0),
        ("reinitialisations", 0.0),
        ("false_targets", 0.0),
        ("duplicates", 0.0),
        ("missed", 0.0),
        ("completeness", 1.0),
        ("targets_unborn", 0.0),
        ("scored_messages", 286.0),
        ("unscored_messages", 0.0),
        ("mota", 1.0),
        ("idf1", 1.0),
        ("hota", 1.0),
    ] {
        assert_eq!(found[name], value, "{name}");
    }
    // What is left is the error of the interpolation and the width of a bin.
    assert!(found["gospa_mm.mean"] < 2e-3, "{found:?}");
    assert!(found["error_mm.p95"] < 0.02 && found["error_mm.rms"] < 1e-3, "{found:?}");
    assert!((found["time_to_initiation_ms.median"] - 0.5).abs() < 1e-6, "{found:?}");
}

#[test]
fn errors_are_distances_in_millimetres() {
    let found = figures(|_, [a, b]| vec![at(1, a + Vector3::z() * 0.03), at(2, b + Vector3::x() * 0.01)]);
    assert!((found["error_mm.median"] - 10.0).abs() < 0.02, "{found:?}");
    assert!((found["error_mm.p95"] - 30.0).abs() < 0.02, "{found:?}");
    assert!((found["error_mm.rms"] - 500.0_f64.sqrt()).abs() < 0.01, "{found:?}");
    assert!((found["gospa_mm.mean"] - 1000.0_f64.sqrt()).abs() < 0.01, "{found:?}");
}

#[test]
fn what_is_false_missing_or_double_is_told_apart() {
    let found = figures(|time, [a, _]| {
        let seen = if time < 1.0 { vec![] } else { vec![at(1, a), at(2, a + Vector3::z() * 0.05)] };
        [seen, vec![at(3, Point3::new(9.0, 9.0, 9.0))]].concat()
    });
    assert_eq!(found["false_targets"], 1.0);
    assert!((found["duplicates"] - 0.5).abs() < 0.01, "{found:?}");
    assert!((found["missed"] - 0.75).abs() < 0.01, "{found:?}");
    assert!((found["completeness"] - 0.25).abs() < 0.01, "{found:?}");
    assert_eq!((found["identities"], found["targets_unborn"]), (1.0, 1.0));
    assert!((found["time_to_initiation_ms.median"] - 1000.0).abs() < 8.0, "{found:?}");
}

#[test]
fn swapped_and_new_identities_are_counted_once_each() {
    let found = figures(|time, [a, b]| if time < 1.0 { vec![at(1, a), at(2, b)] } else { vec![at(2, a), at(1, b)] });
    assert_eq!((found["id_switches"], found["reinitialisations"], found["identities"]), (2.0, 0.0, 2.0));
    let found = figures(|time, [a, b]| vec![at(if time < 1.0 { 1 } else { 3 }, a), at(2, b)]);
    assert_eq!((found["id_switches"], found["reinitialisations"], found["identities"]), (0.0, 1.0, 3.0));
    assert_eq!(found["identities_per_target"], 1.5);
    // 286 messages, 572 true places, one new identity; one identity of the two of the first light serves for half of its places.
    assert!((found["mota"] - (1.0 - 1.0 / 572.0)).abs() < 1e-12, "{found:?}");
    assert!((found["idf1"] - 0.75).abs() < 2e-3, "{found:?}");
}

#[test]
fn identities_that_are_exchanged_half_way_are_right_half_of_the_time() {
    let found = figures(|time, [a, b]| if time < 1.0 { vec![at(1, a), at(2, b)] } else { vec![at(2, a), at(1, b)] });
    assert!((found["mota"] - (1.0 - 2.0 / 572.0)).abs() < 1e-12, "{found:?}");
    assert!((found["idf1"] - 0.5).abs() < 2e-3, "{found:?}");
    // All are found; each match is with an identity that shares half of its own and of the light's messages: 143 / (286 + 286 - 143) = 1/3.
    assert!((found["hota"] - (1.0_f64 / 3.0).sqrt()).abs() < 2e-3, "{found:?}");
}

#[test]
fn half_of_the_truth_found_and_one_false_target_each_time_is_no_accuracy_at_all() {
    let found = figures(|_, [a, _]| vec![at(1, a), at(2, Point3::new(9.0, 9.0, 9.0))]);
    assert!(found["mota"].abs() < 1e-12, "{found:?}");
    assert!((found["idf1"] - 0.5).abs() < 1e-12, "{found:?}");
    // A third of all that is true or found is a match; what matches lasts.
    assert!((found["hota"] - (1.0_f64 / 3.0).sqrt()).abs() < 1e-9, "{found:?}");
}

#[test]
fn a_match_counts_at_the_levels_that_its_distance_reaches() {
    // 40 mm of a gate of 100 mm: a similarity of 0.6, which reaches 12 of 19 levels.
    let found = figures(|_, [a, b]| vec![at(1, a + Vector3::z() * 0.04), at(2, b + Vector3::z() * 0.04)]);
    assert!((found["hota"] - 12.0 / 19.0).abs() < 1e-9, "{found:?}");
}

#[test]
fn missed_and_false_cost_half_a_squared_gate_each() {
    // One missed, one false, one 60 mm off.
    let found = figures(|_, [a, _]| vec![at(1, a + Vector3::z() * 0.06), at(2, Point3::new(9.0, 9.0, 9.0))]);
    let expected = (60.0_f64.powi(2) + 100.0_f64.powi(2)).sqrt();
    assert!((found["gospa_mm.mean"] - expected).abs() < 0.01, "{found:?}");
}

#[test]
fn identity_that_went_over_to_another_target_is_not_shared() {
    // Two targets 50 mm apart, both within the gate of the one that is recovered: first the one's, then the other's.
    let mut scorer = Scorer::new(0.1, 0.0, None);
    for i in 0..20 {
        let (time, x) = (f64::from(i) * 0.05, if i < 10 { 0.0 } else { 0.15 });
        let list = vec![at(0, Point3::new(0.0, 0.0, 0.0)), at(1, Point3::new(0.15, 0.0, 0.0))];
        scorer.truth(targets(time, list));
        let back = if i < 15 { x } else { 0.075 };
        scorer.recovered(targets(time, vec![at(5, Point3::new(back, 0.0, 0.0))]));
    }
    let mut report = Report::default();
    scorer.finish(&mut report);
    let found = &report.figures;
    assert_eq!((found["missed"], found["id_switches"], found["duplicates"]), (0.5, 1.0, 0.0), "{found:?}");
}

#[test]
fn what_is_outside_the_volume_need_not_be_found_and_may_be() {
    let score = |recover: bool| {
        let mut scorer = Scorer::new(0.1, 0.0, Some([[-1.0; 3], [1.0; 3]]));
        for i in 0..40 {
            let time = f64::from(i) * 0.05;
            // Walks in over the border at 1 s; another one stays outside.
            let place = Point3::new(2.0 - time, 0.0, 0.0);
            let (far, speed) = (Point3::new(0.0, 5.0, 0.0), Vector3::new(-1.0, 0.0, 0.0));
            scorer.truth(targets(time, vec![target(0, place, speed), at(1, far)]));
            let mut list = vec![at(9, far)];
            list.extend((recover || place.x <= 1.0).then(|| at(7, place)));
            scorer.recovered(targets(time, list));
        }
        let mut report = Report::default();
        scorer.finish(&mut report);
        report.figures
    };
    for found in [score(true), score(false)] {
        assert_eq!((found["targets_true"], found["missed"], found["completeness"]), (1.0, 0.0, 1.0), "{found:?}");
        assert_eq!((found["false_targets"], found["duplicates"], found["gospa_mm.mean"]), (0.0, 0.0, 0.0));
        assert!(found["time_to_initiation_ms.median"] < 1.0, "{found:?}");
    }
}

#[test]
fn two_hundred_and_fifty_targets_are_scored_in_a_moment() {
    let mut scorer = Scorer::new(0.1, 0.0, None);
    let start = std::time::Instant::now();
    for i in 0..100 {
        let time = f64::from(i) * 0.01;
        let place = |k: u32| Point3::new(f64::from(k % 16) * 0.15, f64::from(k / 16) * 0.15, time);
        let list: Vec<Target> = (0..250).map(|k| at(k, place(k))).collect();
        scorer.truth(targets(time, list.clone()));
        // Everyone is near several others, and everyone's identity is new each time.
        let moved = list.into_iter().map(|it| at(it.id.0 + 1000 * i, it.position + Vector3::x() * 0.07));
        scorer.recovered(targets(time, moved.collect()));
    }
    let mut report = Report::default();
    scorer.finish(&mut report);
    assert!(report.figures["missed"] < 0.1, "{:?}", report.figures);
    assert!(start.elapsed().as_secs_f64() < 20.0, "{:?}", start.elapsed());
}

#[test]
fn nothing_recovered_is_nothing_complete() {
    let mut scorer = Scorer::new(0.1, 0.0, None);
    (0..10).for_each(|i| {
        let [a, _] = truth_at(0.0);
        scorer.truth(targets(f64::from(i) * 0.01, vec![target(0, a.0, a.1)]));
    });
    let mut report = Report::default();
    scorer.finish(&mut report);
    assert_eq!((report.figures["completeness"], report.figures["targets_unborn"]), (0.0, 1.0));
    assert!(report.figures["error_mm.median"].is_nan() && report.figures["missed"] == 1.0, "{report:?}");
    // What was never matched was never exchanged either, and no bound on that holds.
    let of_matched =
        ["id_switches", "reinitialisations", "identities_per_target"].map(|it| report.figures[it].is_nan());
    assert_eq!(of_matched, [true; 3]);
}

#[test]
fn what_the_truth_does_not_cover_is_not_scored() {
    let mut scorer = Scorer::new(0.1, 1.0, None);
    for time in [0.5, 1.2, 1.6] {
        scorer.truth(targets(time, vec![at(0, Point3::origin())]));
        scorer.recovered(targets(time, vec![at(5, Point3::origin())]));
    }
    scorer.recovered(targets(1.1, vec![]));
    scorer.recovered(targets(1.7, vec![]));
    let mut report = Report::default();
    scorer.finish(&mut report);
    assert_eq!((report.figures["scored_messages"], report.figures["unscored_messages"]), (2.0, 2.0));
}

#[test]
fn lights_are_missed_while_no_targets_come() {
    let score = |until_s: f64| {
        let mut scorer = Scorer::new(0.1, 0.0, None);
        for step in 0..=120 {
            let time = f64::from(step) / 60.0;
            let list = (0..).zip(truth_at(time)).map(|(id, (position, velocity))| target(id, position, velocity));
            scorer.truth(targets(time, list.collect()));
            if time < until_s {
                scorer.recovered(targets(time, (5..).zip(truth_at(time)).map(|(id, it)| at(id, it.0)).collect()));
            }
        }
        let mut report = Report::default();
        scorer.finish(&mut report);
        report
    };
    let whole = score(3.0);
    assert!(whole.figures["missed"] == 0.0 && whole.remarks.is_empty(), "{whole:?}");
    let half = score(1.0);
    for (name, expected) in [("missed", 0.5), ("mota", 0.5), ("hota", 0.5), ("idf1", 2.0 / 3.0)] {
        assert!((half.figures[name] - expected).abs() < 0.01, "{name}: {half:?}");
    }
    assert!((half.figures["gospa_mm.mean"] - 50.0).abs() < 1.0, "{half:?}");
    assert!(half.remarks.len() == 1 && half.remarks[0].contains("for 1.0"), "{half:?}");
}

#[test]
fn stated_covariances_are_held_against_the_errors() {
    // 30 mm off along z, stated as 15, 30 and 60 mm there: two, one, and half as many standard deviations on one axis of three.
    for (sigma, expected) in [(0.015, 2.0), (0.03, 1.0), (0.06, 0.5)] {
        let found = figures(|_, [a, b]| {
            let stated = |id: u32, position: Point3<f64>| {
                let mut target = at(id, position + Vector3::z() * 0.03);
                target.covariance.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(sigma * sigma);
                target
            };
            vec![stated(1, a), stated(2, b)]
        });
        assert!((found["error_sigmas.rms"] - expected / 3.0_f64.sqrt()).abs() < 1e-3, "{found:?}");
    }
    assert!(figures(|_, [a, b]| vec![at(1, a), at(2, b)])["error_sigmas.rms"].is_nan(), "none stated");
}
