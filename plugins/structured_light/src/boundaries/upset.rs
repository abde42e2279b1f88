//! Recordings that go wrong in the middle: their maps are right, or there are none.

use foveate::scene::{Calibration, LengthUnit, NamedCamera};

use super::stage::{Stage, Way};
use super::*;
use crate::triangulator::{Triangulator, TriangulatorSettings};

/// Pictures of a recording, and from which on it goes wrong.
const PICTURES: usize = 28;
const UPSET: usize = 13;
/// A point is wrong that is farther off, along its line of sight, from all that is seen beside it [m].
const WRONG: f64 = 0.01;

/// What a picture shows: which pattern, and the moment that it was taken at, in pictures from the start.
type Shown = (usize, f64);

/// A cloud: the picture that it is of, its points, and how many of them are wrong.
#[derive(Debug)]
struct Judged {
    picture: usize,
    points: usize,
    wrong: usize,
}

fn time(number: usize) -> Time {
    Time::from_s(0.02 * number as f64)
}

/// The clouds of a recording of a stage, and what is said of it.
fn run(stage: &Stage, shown: impl Fn(usize) -> Shown, distance_m: [f64; 2]) -> (Vec<Judged>, Vec<String>) {
    let named = |name: &str, camera: &Camera| NamedCamera { name: name.to_owned(), camera: camera.clone() };
    let cameras = vec![named("camera", &stage.camera), named("projector", &stage.projector)];
    let calibration = Arc::new(Calibration::new(cameras, LengthUnit::Metre, String::new()).unwrap());
    let setup = |connected: &str| Setup {
        camera: Some(CameraId(0)),
        calibration: Arc::clone(&calibration),
        connected: vec![connected.to_owned()],
        ..Setup::for_tests()
    };
    let settings =
        BoundariesSettings { stripe_px: Some(stage.stripe), distance_m, black: 5.0, ..BoundariesSettings::default() };
    let mut boundaries = NodeBench::<Boundaries>::with_setup(settings, &setup("image")).unwrap();
    let settings = TriangulatorSettings::default();
    let mut triangulator = NodeBench::<Triangulator>::with_setup(settings, &setup("map")).unwrap();
    for number in 0..PICTURES {
        let (pattern, when) = shown(number);
        boundaries.feed(&IMAGE, time(number), stage.seen(when, number, pattern % FRAMES)).unwrap();
    }
    let mut judged = Vec::new();
    for map in boundaries.outputs(&MAP) {
        let picture = (0..PICTURES).find(|it| time(*it) == map.time()).unwrap();
        triangulator.feed(&In::<ProjectorMap>::each(0, "map"), map.time(), map.value).unwrap();
        for cloud in triangulator.outputs(&Out::<PointCloud>::new(0, "cloud")) {
            let is_wrong = |point: &CloudPoint| {
                let far = (point.position.cast::<f64>() - stage.camera.centre()).norm();
                let [x, y] = point.pixel.map(usize::from);
                // At rims a pixel sees either side.
                let beside = (0..9).map(|it| ((x + it % 3).saturating_sub(1), (y + it / 3).saturating_sub(1)));
                let seen = beside.filter_map(|(x, y)| stage.depth(x, y, shown(picture).1));
                seen.map(|it| (far - it).abs()).fold(f64::INFINITY, f64::min) > WRONG
            };
            let wrong = cloud.value.iter().filter(is_wrong).count();
            judged.push(Judged { picture, points: cloud.value.len(), wrong });
        }
    }
    (judged, boundaries.finish().unwrap().remarks)
}

/// No cloud of such a recording has many wrong points, and `words` are said of one of them at least.
#[track_caller]
fn check(way: Way, upset: fn(usize) -> Shown, words: &str) -> Vec<Judged> {
    let (mut all, mut said) = (Vec::new(), Vec::new());
    for (seed, stripe, wall) in [(1, 6, None), (16, 10, Some(1.75))] {
        let stage = Stage::new(stripe, way, wall, seed);
        let shown = |it: usize| if it < UPSET { (it, it as f64) } else { upset(it) };
        let (judged, remarks) = run(&stage, shown, [1.1, 1.9]);
        for it in &judged {
            assert!(it.wrong * 20 <= it.points, "seed {seed}: {it:?}, {remarks:?}");
        }
        all.extend(judged);
        said.extend(remarks);
    }
    assert!(words.is_empty() || said.iter().any(|it| it.contains(words)), "{said:?}");
    all
}

fn slow(picture: f64) -> [f64; 3] {
    [0.0016 * (picture - 10.0), 0.0003 * picture, -0.0004 * picture]
}

fn fast(picture: f64) -> [f64; 3] {
    [0.0046 * (picture - 10.0), 0.0, 0.001 * picture]
}

#[test]
fn a_recording_that_is_played_back_in_the_middle_gives_no_wrong_cloud() {
    for way in [slow as Way, fast] {
        let found = check(way, |it| (64 + 2 * UPSET - it, (2 * UPSET) as f64 - it as f64), "");
        assert!(found.iter().any(|it| it.picture > UPSET + 9), "{found:?}");
    }
}

#[test]
fn a_cut_to_elsewhere_is_told_and_what_comes_after_it_is_right() {
    let found = check(fast, |it| (it + 2, it as f64 + 24.0), "fit the best of the four patterns");
    assert!(found.iter().any(|it| it.picture == PICTURES - 2), "{found:?}");
}

#[test]
fn patterns_that_are_not_seen_any_more_are_told_and_nothing_is_given_without_them() {
    for upset in [|it: usize| (UPSET, it as f64), |it: usize| (2 * it - UPSET, 2.0 * it as f64 - UPSET as f64)] {
        let found = check(slow, upset, "has not been seen for");
        assert!(found.iter().all(|it| it.picture <= UPSET + 2 * FRAMES), "{found:?}");
    }
}
