//! Clocks of drawn cameras that watch a drawn flight, against the truth; and flights that tell nothing.

use foveate::estimation::Random;
use foveate::geometry::Camera;
use foveate_testkit::check_node;
use nalgebra::{Point3, Vector3};

use super::bearings::{Bearing, Bearings};
use super::joint::{Link, Solution, solve};
use super::search::{PairClock, SearchError, SearchOptions, search};
use super::*;

/// Offset [s] and rate of each camera's clock against the first one's.
const CLOCKS: [(f64, f64); 4] = [(0.0, 1.0), (17.3, 1.002), (-9.45, 0.9995), (41.0, 1.0)];

const OPTIONS: SearchOptions = SearchOptions {
    max_offset_s: 60.0,
    max_rate: 0.004,
    step_s: 0.1,
    tolerance_rad: 0.02,
    min_overlap_s: 20.0,
    min_distinction: 1.5,
};

fn cameras() -> Vec<Camera> {
    [(-50.0, -20.0), (45.0, -35.0), (30.0, 50.0), (-35.0, 45.0)]
        .map(|(x, y)| Camera::look_at(Point3::new(x, y, 1.5), Point3::new(0.0, 0.0, 15.0), [1920, 1080], 1500.0))
        .to_vec()
}

/// A flight with turns that do not repeat within the recording.
fn flight(t: f64) -> Point3<f64> {
    let wave = |period: f64, phase: f64| (std::f64::consts::TAU * t / period + phase).sin();
    Point3::new(
        12.0 * wave(37.0, 0.3) + 6.0 * wave(13.1, 1.0),
        11.0 * wave(29.0, 1.7) + 5.0 * wave(17.3, 0.0),
        15.0 + 5.0 * wave(23.0, 0.5) + 2.0 * wave(7.9, 2.0),
    )
}

/// What the cameras see of `path` for 200 s of the session: 25 to 30 pictures a second, `noise` [rad], a part `wrong` of the bearings
/// anywhere, and each camera blind for a quarter of the time, in stretches of its own.
fn seen(path: impl Fn(f64) -> Point3<f64>, noise: f64, wrong: f64) -> Vec<Bearings> {
    let mut random = Random::new(3).fork("clocks");
    let seen_by = |(index, camera): (usize, &Camera)| {
        let (offset, rate) = CLOCKS[index];
        let mut bearings = Bearings::new(camera.centre(), 0.3, 1.0);
        let interval = [0.04, 0.0333, 0.04, 0.0367][index];
        for picture in 0..(200.0 / interval) as usize {
            let session = picture as f64 * interval + 0.007 * index as f64;
            if (session / 13.0 + index as f64 * 0.3).fract() < 0.25 {
                continue;
            }
            let mut direction = (path(session) - camera.centre()).normalize();
            let error = if random.uniform() < wrong { 0.3 } else { noise };
            direction += Vector3::new(random.normal(), random.normal(), random.normal()) * error;
            bearings.push(Bearing { time_s: offset + rate * session, direction: direction.normalize() });
        }
        bearings
    };
    cameras().iter().enumerate().map(seen_by).collect()
}

fn links(bearings: &[Bearings]) -> Vec<Link> {
    let pairs = (0..bearings.len()).flat_map(|a| (a + 1..bearings.len()).map(move |b| (a, b)));
    pairs.filter_map(|(a, b)| Some(Link { a, b, clock: search(&bearings[a], &bearings[b], &OPTIONS).ok()? })).collect()
}

/// Largest error of a clock over the recording [s].
#[track_caller]
fn worst(solution: &Solution) -> f64 {
    let errors = solution.clocks.iter().zip(CLOCKS).flat_map(|(found, (offset, rate))| {
        let found = found.expect("every clock is found");
        [0.0, 200.0].map(|t| (found.offset_s + found.rate * t - offset - rate * t).abs())
    });
    errors.fold(0.0, f64::max)
}

#[test]
fn clocks_tens_of_seconds_apart_are_found_to_milliseconds() {
    let bearings = seen(flight, 0.001, 0.0);
    let found = links(&bearings);
    assert_eq!(found.len(), 6, "{found:?}");
    let solution = solve(&bearings, &found, 0);
    assert!(worst(&solution) < 0.01, "{} s, {solution:?}", worst(&solution));
    assert!(solution.miss_rad < 0.002 && solution.contradicting.is_empty());
    for (found, (offset, rate)) in solution.clocks.iter().zip(CLOCKS).skip(1) {
        let found = found.unwrap();
        let error = (found.offset_s + found.rate * 100.0 - offset - rate * 100.0).abs();
        assert!(error < 5.0 * found.sigma_s && found.sigma_s < 0.01, "{error} {found:?}");
    }
}

#[test]
fn wrong_sights_and_a_wrong_pair_do_no_harm() {
    let bearings = seen(flight, 0.002, 0.3);
    let mut found = links(&bearings);
    let wrong = PairClock { offset_s: found[5].clock.offset_s + 20.0, gain: 0.3, chance: 0.1, ..found[5].clock };
    found[5].clock = wrong;
    let solution = solve(&bearings, &found, 0);
    assert_eq!(solution.contradicting, [5]);
    // Better than the step of the search; 0.4 s where bearings beside a wrong one are interpolated all the same.
    assert!(worst(&solution) < 0.1, "{} s", worst(&solution));
}

#[test]
fn a_target_that_hovers_tells_no_offset_and_that_is_said() {
    let bearings = seen(|_| Point3::new(3.0, 2.0, 14.0), 0.002, 0.0);
    let fault = search(&bearings[0], &bearings[1], &OPTIONS).unwrap_err();
    assert!(matches!(fault, SearchError::Flat { .. }), "{fault}");
    let solution = solve(&bearings, &[], 0);
    assert!(solution.clocks[0].is_some() && solution.clocks[1..].iter().all(Option::is_none));
}

#[test]
fn a_flight_in_circles_has_several_offsets_and_that_is_said() {
    let circle = |t: f64| Point3::new(12.0 * (t * 0.5).cos(), 12.0 * (t * 0.5).sin(), 15.0 + 3.0 * (t * 0.5).sin());
    let bearings = seen(circle, 0.001, 0.0);
    let fault = search(&bearings[0], &bearings[1], &OPTIONS).unwrap_err();
    assert!(matches!(fault, SearchError::Ambiguous { .. }), "{fault}");
}

#[test]
fn cameras_without_a_common_view_or_a_baseline_are_refused() {
    let bearings = seen(flight, 0.001, 0.0);
    let nothing = Bearings::new(Point3::new(9.0, 0.0, 0.0), 0.3, 1.0);
    assert_eq!(search(&bearings[0], &nothing, &OPTIONS), Err(SearchError::NoBaseline));
    assert_eq!(search(&bearings[0], &bearings[0], &OPTIONS), Err(SearchError::NoBaseline));
    let options = SearchOptions { min_overlap_s: 1000.0, ..OPTIONS };
    assert!(matches!(search(&bearings[0], &bearings[1], &options), Err(SearchError::TooShort { .. })));
}

#[test]
fn node_keeps_its_promises() {
    check_node::<ClocksNode>("");
    check_node::<ClocksNode>("max_offset_s = 30.0\nfile = \"mine.toml\"");
    let refused = |settings: ClocksSettings| {
        let calibration = std::sync::Arc::new(foveate_testkit::scene::ring_calibration(3));
        ClocksNode::new(settings, &Setup { calibration, ..Setup::for_tests() }).err().and_then(|it| it.setting)
    };
    let base = ClocksSettings::default;
    assert_eq!(refused(ClocksSettings { reference: "absent".into(), ..base() }).as_deref(), Some("reference"));
    assert_eq!(refused(ClocksSettings { truth: "/no/such.toml".into(), ..base() }).as_deref(), Some("truth"));
    assert_eq!(refused(ClocksSettings { file: "../x.toml".into(), ..base() }).as_deref(), Some("file"));
}
