//! A wall that comes nearer under a boundary code, and everything that can go wrong with it.

use std::fs;

use foveate::imaging::stripes::code::Group;
use foveate::imaging::stripes::pattern::picture;
use foveate::scene::{Calibration, LengthUnit, NamedCamera};
use foveate_testkit::check_node;
use nalgebra::{Matrix2, Matrix6, Point2};

use super::*;
use crate::pair::tests::rig;

const STRIPE: u32 = 16;

/// What is done with a picture.
#[derive(Clone, Copy, PartialEq)]
enum Condition {
    Fine,
    Lost,
    /// The projector shows the picture before once more.
    Dropped,
    Dark,
    Bright,
    /// It comes with the time of the first.
    Late,
}

struct Outcome {
    maps: Vec<(Time, Arc<ProjectorMap>)>,
    gaps: Vec<String>,
    report: Report,
}

fn distance(number: usize) -> f64 {
    1.5 - 0.002 * number as f64
}

fn time(number: usize) -> Time {
    Time::from_s(0.02 * number as f64) + Interval::from_ms(40.0)
}

fn setup(connected: &[&str]) -> Setup {
    let (camera, projector) = rig();
    let named = |name: &str, camera: Camera| NamedCamera { name: name.to_owned(), camera };
    let cameras = vec![named("camera", camera), named("projector", projector)];
    let calibration = Calibration::new(cameras, LengthUnit::Metre, String::new()).unwrap();
    let connected = connected.iter().map(ToString::to_string).collect();
    Setup { camera: Some(CameraId(0)), calibration: Arc::new(calibration), connected, ..Setup::for_tests() }
}

/// Where the wall is lit from at each pixel.
fn columns(number: usize) -> Vec<f64> {
    let (camera, projector) = rig();
    let of = |at: usize| {
        let ray = camera.ray(&Point2::new((at % 640) as f64, (at / 640) as f64)).unwrap();
        let depth = distance(number) / ray.direction.z;
        projector.project(&ray.at(depth)).map_or(f64::NAN, |it| it.x)
    };
    (0..640 * 480).map(of).collect()
}

/// Each pixel is the mean of what a pixel's width of the wall shows, under a blur of half a projector pixel.
fn seen(number: usize, frame: usize, gain: f64, code: &StripeCode) -> Image {
    let shown = picture(code, code.pictures()[frame], 1.0);
    let lit = |column: f64| -> f64 {
        let at = (column + 0.5).floor();
        if (0.0..1024.0).contains(&at) { f64::from(shown[at as usize]) / 255.0 } else { 0.0 }
    };
    let mut random = foveate::estimation::random::Random::new(number as u64 + 1);
    let pixels = columns(number).into_iter().map(|column| {
        let light = (0..8).map(|it| lit(column + (f64::from(it) - 3.5) * 0.4)).sum::<f64>() / 8.0;
        (8.0 * gain.min(1.0) + 130.0 * gain * light + random.normal()).round().clamp(0.0, 255.0) as u8
    });
    Image { width: 640, height: 480, pixels: pixels.collect(), ..Image::default() }
}

fn run(settings: BoundariesSettings, stripe: u32, n: usize, condition: impl Fn(usize) -> Condition) -> Outcome {
    run_on_head(settings, stripe, n, condition, None)
}

/// Of a camera on a head that stands, where `pose_px` is given: what its angles are known to [px].
fn run_on_head(
    settings: BoundariesSettings,
    stripe: u32,
    n: usize,
    condition: impl Fn(usize) -> Condition,
    pose_px: Option<&dyn Fn(usize) -> f64>,
) -> Outcome {
    let pattern = PatternSettings {
        projector_px: [1024, 768],
        code: crate::pattern::Code::Boundary,
        stripe_px: stripe,
        ..PatternSettings::default()
    };
    let (manifest, code) = (toml::to_string(&pattern).unwrap(), pattern.stripe_code(None).unwrap());
    let connected: &[&str] = if pose_px.is_some() { &["image", "shown", "pose"] } else { &["image", "shown"] };
    let mut bench = NodeBench::<Boundaries>::with_setup(settings, &setup(connected)).unwrap();
    for number in 0..n {
        let from = Time::from_s(0.02 * number as f64);
        let shown = PatternShown {
            set: (number / 4) as u64,
            index: (number % 4) as u32,
            count: 4,
            from,
            lasts: Interval::from_ms(20.0),
            manifest: manifest.clone(),
            ..PatternShown::default()
        };
        bench.feed(&SHOWN, from, shown).unwrap();
    }
    for number in 0..n {
        let what = condition(number);
        let gain = match what {
            Condition::Dark => 0.02,
            Condition::Bright => 3.0,
            _ => 1.0,
        };
        let frame = if what == Condition::Dropped { (number + 3) % 4 } else { number % 4 };
        let image = seen(number, frame, gain, &code);
        if let Some(px) = pose_px {
            bench.feed(&POSE, time(number), pose(time(number), px(number))).unwrap();
        }
        match what {
            Condition::Lost => {}
            Condition::Late => bench.feed(&IMAGE, time(0), image).unwrap(),
            _ => bench.feed(&IMAGE, time(number), image).unwrap(),
        }
    }
    let gaps = bench.gaps(&MAP).into_iter().map(|it| it.reason).collect();
    let maps = bench.outputs(&MAP).into_iter().map(|it| (it.time(), it.value)).collect();
    Outcome { maps, gaps, report: bench.finish().unwrap() }
}

/// Of a head that stands, known to `px` in the picture.
fn pose(time: Time, px: f64) -> HeadPose {
    let camera = rig().0;
    HeadPose {
        camera: CameraId(0),
        time,
        angles: [0.0; 2],
        angles_covariance: Matrix2::identity() * (px / camera.intrinsics.focal[0]).powi(2),
        rates: [0.0; 2],
        zoom: None,
        camera_from_world: camera.camera_from_world,
        covariance: Matrix6::identity() * 1e-12,
        age: Interval(0),
    }
}

fn near() -> BoundariesSettings {
    BoundariesSettings { distance_m: [1.3, 1.7], ..BoundariesSettings::default() }
}

/// Pixels of a map, how many of them are off by more than a projector pixel, and the root mean square of the others in their standard deviations.
fn judge(map: &ProjectorMap, number: usize) -> (usize, usize, f64) {
    let truth = columns(number);
    let (mut n, mut wrong, mut squares) = (0, 0, 0.0);
    for (at, truth) in truth.iter().enumerate() {
        let sample = map.get(at % 640, at / 640);
        if sample.coordinate[0].is_finite() {
            let off = f64::from(sample.coordinate[0]) - truth;
            n += 1;
            if off.abs() > 1.0 { wrong += 1 } else { squares += (off / f64::from(sample.sigma[0])).powi(2) }
        }
    }
    (n, wrong, (squares / (n - wrong).max(1) as f64).sqrt())
}

#[test]
fn node_keeps_the_law() {
    check_node::<Boundaries>("");
    check_node::<Boundaries>("latency_ms = 16\ndistance_m = [1, 2]");
}

#[test]
fn each_picture_has_a_map_of_its_own_time_one_picture_late() {
    let found = run(near(), STRIPE, 12, |_| Condition::Fine);
    assert!(found.maps.len() >= 5, "{} {:?}", found.maps.len(), found.gaps);
    for (at, map) in &found.maps {
        let number = (2..12).find(|it| time(*it) == *at).unwrap();
        let (n, wrong, sigmas) = judge(map, number);
        // Tracks that began with a ghost are known later.
        let least = if number < 7 { 5_000 } else { 25_000 };
        assert!(n > least && wrong == 0, "picture {number}: {n} pixels, {wrong} wrong");
        assert!((0.1..1.5).contains(&sigmas), "picture {number}: {sigmas}");
    }
    let figure = |name: &str| found.report.figures[&format!("boundaries.{name}.camera")];
    assert!(figure("ghosts") > 0.15 && figure("ghosts") < 0.35, "{}", figure("ghosts"));
    assert!(figure("frames") == found.maps.len() as f64 && figure("unknown_period") == 0.0);
}

#[test]
fn a_picture_of_a_head_that_moves_is_tracked_and_gives_no_map() {
    let px = |number: usize| if (8..10).contains(&number) { 2.5 } else { 0.2 };
    let found = run_on_head(near(), STRIPE, 14, |_| Condition::Fine, Some(&px));
    let times: Vec<Time> = found.maps.iter().map(|it| it.0).collect();
    assert!([7, 10, 11, 12].iter().all(|it| times.contains(&time(*it))), "{times:?}");
    assert!(!times.contains(&time(8)) && !times.contains(&time(9)), "{times:?}");
    assert_eq!(found.report.figures["boundaries.frames_moving.camera"], 2.0);
    assert!(found.gaps.iter().any(|it| it.contains("the head moves")), "{:?}", found.gaps);
}

#[test]
fn the_distance_says_which_repetition_of_the_code_it_is() {
    // 86 stripes of 6 px are half of the projector; the picture sees more.
    let found = run(near(), 6, 8, |_| Condition::Fine);
    let (_, last) = found.maps.last().unwrap();
    let (n, wrong, _) = judge(last, 6);
    assert!(n > 50_000 && wrong == 0, "{n} {wrong}");
    let wide = BoundariesSettings { distance_m: [0.4, 20.0], ..near() };
    let found = run(wide, 6, 8, |_| Condition::Fine);
    assert!(found.maps.is_empty(), "{}", found.maps.len());
    assert!(found.report.remarks.iter().any(|it| it.contains("the code repeats")), "{:?}", found.report.remarks);
}

#[test]
fn a_camera_that_is_slower_than_the_projector_is_told() {
    let every = |n: usize| run(near(), STRIPE, 18, |it| if it % n > 0 { Condition::Lost } else { Condition::Fine });
    for (n, n_pictures) in [(2, 9), (3, 6)] {
        let found = every(n);
        let figure = |name: &str| found.report.figures[&format!("boundaries.{name}.camera")];
        assert!(found.maps.is_empty() && figure("frames") == 0.0, "{:?}", found.report.figures);
        assert_eq!(figure("frames_empty"), f64::from(n_pictures - 1));
        let told: Vec<&String> =
            found.report.remarks.iter().filter(|it| it.contains("slower than the projector")).collect();
        assert!(
            told.len() == 1 && !found.report.remarks.iter().any(|it| it.contains("is missing")),
            "{:?}",
            found.report.remarks
        );
    }
}

#[test]
fn what_goes_wrong_is_named_and_got_over() {
    let cases = [
        (Condition::Lost, "a picture of the camera is missing"),
        (Condition::Dropped, "the projector shows picture 3 of the code, expected picture 0"),
        (Condition::Dark, "too dark"),
        (Condition::Bright, "too bright"),
        (Condition::Late, "expected pictures in the order of time"),
    ];
    for (what, words) in cases {
        let found = run(near(), STRIPE, 18, |it| if it == 8 { what } else { Condition::Fine });
        let remarks = &found.report.remarks;
        assert_eq!(remarks.iter().filter(|it| it.contains(words)).count(), 1, "{words}: {remarks:?}");
        for (at, map) in &found.maps {
            let number = (0..18).find(|it| time(*it) == *at).unwrap();
            let (n, wrong, _) = judge(map, number);
            assert!(wrong * 1000 <= n, "{words}, picture {number}: {n} pixels, {wrong} wrong");
        }
        let (at, last) = found.maps.last().unwrap();
        assert!(*at == time(16) && last.n_known > 25_000, "{words}: {} at {} s", last.n_known, at.as_s());
    }
}

#[test]
fn without_a_projector_in_sight_or_in_step_there_is_no_map() {
    let found = run(near(), STRIPE, 10, |_| Condition::Dark);
    assert!(
        found.maps.is_empty()
            && found.report.remarks.iter().any(|it| it.contains("too dark") && it.contains("10 times"))
    );
    let late = BoundariesSettings { latency_ms: 22.0, exposure_ms: 8.0, ..near() };
    let found = run(late, STRIPE, 10, |_| Condition::Fine);
    assert!(found.maps.is_empty() && found.gaps[0].contains("are camera and projector in step?"), "{:?}", found.gaps);
}

#[test]
fn a_projector_that_shows_all_pictures_too_late_is_told_and_its_pictures_taken_for_what_they_are() {
    let found = run(near(), STRIPE, 20, |_| Condition::Dropped);
    assert!(found.maps.len() > 10, "{} {:?}", found.maps.len(), found.gaps);
    for (at, map) in &found.maps {
        let number = (0..20).find(|it| time(*it) == *at).unwrap();
        let (n, wrong, _) = judge(map, number);
        assert!(wrong * 1000 <= n, "picture {number}: {n} pixels, {wrong} wrong");
    }
    let words = "found pictures that show pattern 3 of the code, expected pattern 0 ";
    let late = |pattern: usize| words.replace('3', &((pattern + 3) % 4).to_string()).replace('0', &pattern.to_string());
    let remarks = &found.report.remarks;
    assert!((0..4).any(|it| remarks.iter().any(|remark| remark.contains(&late(it)))), "{remarks:?}");
    assert!(remarks.iter().all(|it| !it.contains("dropped a frame")), "{remarks:?}");
}

/// What comes of a recording whose first picture shows pattern 2, from its picture `from` on; picture `lost` of it does not get there, unnoticed.
fn read(first_shows: Option<u32>, from: usize, lost: Option<usize>) -> (Vec<(Time, Arc<ProjectorMap>)>, Report) {
    let code = StripeCode::boundary([1024, 768], STRIPE, &[Group::Stripes(Axis::Columns)]);
    let settings = BoundariesSettings { stripe_px: Some(STRIPE), first_shows, ..near() };
    let mut bench = NodeBench::<Boundaries>::with_setup(settings, &setup(&["image"])).unwrap();
    for number in (from..18).filter(|it| Some(*it) != lost) {
        bench.feed(&IMAGE, time(number), seen(number, (number + 2) % 4, 1.0, &code)).unwrap();
    }
    let maps = bench.outputs(&MAP).into_iter().map(|it| (it.time(), it.value)).collect();
    (maps, bench.finish().unwrap())
}

#[test]
fn a_recording_is_read_whichever_pattern_its_first_picture_shows() {
    for (first_shows, from, lost) in [(Some(2), 0, None), (None, 1, None), (None, 3, None), (None, 0, Some(8))] {
        let (maps, report) = read(first_shows, from, lost);
        for (at, map) in &maps {
            let number = (0..18).find(|it| time(*it) == *at).unwrap();
            let (n, wrong, _) = judge(map, number);
            assert!(wrong * 1000 <= n, "{from}, {lost:?}, picture {number}: {n} pixels, {wrong} wrong");
        }
        assert!(maps.len() >= 10, "{from}, {lost:?}: {} maps", maps.len());
        let (at, last) = maps.last().unwrap();
        assert!(*at == time(16) && last.n_known > 25_000, "{from}, {lost:?}: {} at {} s", last.n_known, at.as_s());
        let remarks = &report.remarks;
        assert_eq!(remarks.iter().any(|it| it.contains("missing in the recording")), lost.is_some(), "{remarks:?}");
        assert!(lost.is_some() || remarks.is_empty(), "{from}: {remarks:?}");
    }
}

#[test]
fn a_recording_is_read_by_the_file_that_was_written_with_its_patterns() {
    let folder = tempfile::tempdir().unwrap();
    let pattern = PatternSettings {
        projector_px: [1024, 768],
        code: crate::pattern::Code::Boundary,
        stripe_px: STRIPE,
        ..PatternSettings::default()
    };
    let written = |pattern: &PatternSettings| {
        fs::write(folder.path().join("patterns.toml"), toml::to_string(pattern).unwrap()).unwrap();
    };
    let of = |settings: BoundariesSettings| {
        let patterns = Some(folder.path().display().to_string());
        NodeBench::<Boundaries>::with_setup(BoundariesSettings { patterns, ..settings }, &setup(&["image"]))
    };
    written(&pattern);
    let code = pattern.stripe_code(None).unwrap();
    let mut bench = of(near()).unwrap();
    for number in 0..10 {
        bench.feed(&IMAGE, time(number), seen(number, number % 4, 1.0, &code)).unwrap();
    }
    for map in bench.outputs(&MAP) {
        let (n, wrong, _) = judge(&map.value, (0..10).find(|it| time(*it) == map.time()).unwrap());
        assert!(n > 5_000 && wrong * 1000 <= n, "{n} pixels, {wrong} wrong");
    }
    assert!(bench.finish().unwrap().remarks.is_empty());
    let refused =
        |settings: BoundariesSettings| of(settings).err().map(|it| (it.setting.unwrap_or_default(), it.message));
    for (settings, setting, words) in [
        (BoundariesSettings { stripe_px: Some(8), ..near() }, "stripe_px", "found 8, expected 16 as `"),
        (BoundariesSettings { stripes: Some("rows".into()), ..near() }, "stripes", "found rows, expected columns as `"),
    ] {
        let (found, said) = refused(settings).unwrap();
        assert!(found == setting && said.contains(words), "{found}: {said}");
    }
    for (pattern, words) in [
        (PatternSettings { code: crate::pattern::Code::Gray, ..pattern.clone() }, "is of a static code"),
        (PatternSettings { projector_px: [800, 600], ..pattern }, "found 800 x 600 px, expected 1024 x 768 px"),
    ] {
        written(&pattern);
        let (found, said) = refused(near()).unwrap();
        assert!(found == "patterns" && said.contains(words), "{found}: {said}");
    }
    fs::remove_file(folder.path().join("patterns.toml")).unwrap();
    assert!(refused(near()).unwrap().1.contains("cannot be read"));
}

#[test]
fn a_wrong_first_picture_of_a_recording_is_refused_with_the_right_one() {
    for wrong in [0, 1, 3] {
        let (maps, report) = read(Some(wrong), 0, None);
        assert!(maps.is_empty(), "{wrong}: {} maps", maps.len());
        let words = ["pattern 2 of", &format!("pattern {wrong} as"), "`first_shows = 2`"];
        assert!(report.remarks.iter().any(|it| words.iter().all(|words| it.contains(words))), "{:?}", report.remarks);
    }
}

#[test]
fn a_recording_whose_pictures_run_backwards_gives_nothing() {
    let code = StripeCode::boundary([1024, 768], STRIPE, &[Group::Stripes(Axis::Columns)]);
    let settings = BoundariesSettings { stripe_px: Some(STRIPE), ..near() };
    let mut bench = NodeBench::<Boundaries>::with_setup(settings, &setup(&["image"])).unwrap();
    for number in 0..16 {
        bench.feed(&IMAGE, time(number), seen(number, (32 - number) % 4, 1.0, &code)).unwrap();
    }
    assert!(bench.outputs(&MAP).is_empty());
    let remarks = bench.finish().unwrap().remarks;
    assert!(remarks.iter().any(|it| it.contains("too few boundaries follow one another")), "{remarks:?}");
}

#[test]
fn settings_out_of_range_are_refused() {
    let refused = |settings| Boundaries::new(settings, &setup(&[])).err().and_then(|it| it.setting);
    assert_eq!(refused(BoundariesSettings { distance_m: [2.0, 1.0], ..near() }).as_deref(), Some("distance_m"));
    assert_eq!(refused(BoundariesSettings { beside_px: 0.0, ..near() }).as_deref(), Some("beside_px"));
    assert_eq!(refused(BoundariesSettings { threads: 0, ..near() }).as_deref(), Some("threads"));
    assert_eq!(refused(BoundariesSettings { first_shows: Some(4), ..near() }).as_deref(), Some("first_shows"));
    assert_eq!(refused(BoundariesSettings { stripe_px: Some(1), ..near() }).as_deref(), Some("stripe_px"));
    assert_eq!(refused(BoundariesSettings { stripes: Some("both".into()), ..near() }).as_deref(), Some("stripes"));
    assert_eq!(refused(near()).as_deref(), Some("stripe_px"), "a recording, whose width nobody says");
}

#[test]
fn pictures_before_the_projector_s_light_are_no_fault_and_a_projector_that_never_comes_is_named() {
    let dark = || Image { width: 640, height: 480, pixels: vec![9; 640 * 480], ..Image::default() };
    for n_patterns in [0, 1] {
        let mut bench = NodeBench::<Boundaries>::with_setup(near(), &setup(&["image", "shown"])).unwrap();
        for number in 0..3 {
            bench.feed(&IMAGE, Time::from_s(0.02 * f64::from(number)), dark()).unwrap();
        }
        for _ in 0..n_patterns {
            let shown =
                PatternShown { from: Time::from_s(1.0), lasts: Interval::from_ms(20.0), ..PatternShown::default() };
            bench.feed(&SHOWN, Time::from_s(1.0), shown).unwrap();
        }
        // After the light of the first pattern has come and gone, a picture of which nobody knows what it shows is a gap.
        bench.feed(&IMAGE, Time::from_s(2.0), dark()).unwrap();
        assert_eq!(bench.gaps(&MAP).len(), n_patterns, "{n_patterns} patterns");
        let remarks = bench.finish().unwrap().remarks.join("; ");
        assert_eq!(remarks.contains("found 4 pictures and no pattern"), n_patterns == 0, "{remarks}");
        assert_eq!(
            remarks.contains("pattern shown during all of the exposure is unknown"),
            n_patterns == 1,
            "{remarks}"
        );
    }
}
