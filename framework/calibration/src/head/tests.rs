//! A head that is swept before a waved light, from what is heard of it to a calibration.

use std::path::Path;

use foveate_estimation::Random;
use foveate_geometry::Camera;
use foveate_geometry::pan_tilt::{
    Axis, AxisUnits, HeadCalibrationError, HeadOptions, Limits, PanTiltHead, Setting, UnitsRule,
};
use foveate_scene::{Calibration, LengthUnit, NamedCamera};
use nalgebra::{Isometry3, Matrix6, Point2, Point3, Vector2, Vector3, Vector4};

use super::rest::rest_period_at;
use super::*;

/// A head at the wall, its axes a degree and centimetres from where they should be.
fn crooked() -> PanTiltHead {
    let mut camera = Camera::look_at(Point3::new(-2.6, 0.3, 2.2), Point3::new(0.0, 0.0, 1.2), [640, 480], 700.0);
    camera.distortion.k1 = -0.15;
    let mut head = PanTiltHead::aligned(camera, Limits::symmetric(1.75, 0.43));
    head.pan = head.pan.moved(&Vector4::new(0.02, -0.03, 0.01, -0.035));
    head.tilt = head.tilt.moved(&Vector4::new(-0.012, 0.026, 0.015, -0.02));
    head
}

fn optics(head: &PanTiltHead) -> Camera {
    Camera { camera_from_world: Isometry3::identity(), ..head.at_rest.clone() }
}

/// Waved before the camera, wherever that looks, so that it is all over the picture.
fn light(camera: &Camera, time_s: f64) -> Point3<f64> {
    let pixel = Point2::new(320.0 + 270.0 * (1.9 * time_s).sin(), 240.0 + 200.0 * (2.7 * time_s + 0.4).sin());
    camera.ray(&pixel).unwrap().at(2.4 + 1.2 * (1.1 * time_s).sin())
}

fn settings() -> Vec<[f64; 2]> {
    let radians = |pan: i32, tilt: i32| [pan, tilt].map(|it| f64::from(it).to_radians());
    let mut all: Vec<[f64; 2]> = (-5..=5).map(|it| radians(10 * it, 0)).collect();
    all.extend((-4..=3).filter(|it| *it != 0).map(|it| radians(0, 5 * it)));
    all.extend([radians(-40, -15), radians(-30, 15), radians(30, -15), radians(40, 15)]);
    all
}

const OPTIONS: GatherOptions =
    GatherOptions { tolerance: 1.5e-3, settle_s: 0.4, most_apart_s: 0.05, step_px: 12.0, most_a_setting: 15 };
const AT_EACH_S: f64 = 4.0;
const WAY_S: f64 = 1.0;

/// Four seconds at each setting and one between them, in which the head turns evenly; `units` of what it says are those of what it does.
fn recorded(head: &PanTiltHead, units: [f64; 2], seed: u64) -> HeadRecording {
    let mut random = Random::new(seed);
    let settings = settings();
    let of_time = |time_s: f64| {
        let at = (time_s / (AT_EACH_S + WAY_S)) as usize;
        let into_s = time_s - at as f64 * (AT_EACH_S + WAY_S);
        let [from, to] = [at, at + 1].map(|it| settings[it.min(settings.len() - 1)]);
        let part = ((into_s - AT_EACH_S) / WAY_S).max(0.0);
        [0, 1].map(|axis| from[axis] + part * (to[axis] - from[axis]))
    };
    let mut recording = HeadRecording::default();
    let lasts_s = settings.len() as f64 * (AT_EACH_S + WAY_S) - WAY_S;
    for step in 0..(lasts_s * 10.0) as u32 {
        let time_s = 0.1 * f64::from(step);
        let angles = of_time(time_s);
        let said = [angles[0] / units[0], angles[1] / units[1]];
        recording.positions.push(PositionReport { earliest_s: time_s - 0.02, latest_s: time_s + 0.02, angles: said });
    }
    let camera_of = |time_s: f64| {
        let [pan, tilt] = of_time(time_s);
        head.camera_at(&Setting::new(pan, tilt))
    };
    for step in 0..(lasts_s * 60.0) as u32 {
        let time_s = (f64::from(step) + 0.3) / 60.0;
        // While the head turns it sees the light where that was.
        let at = (time_s / (AT_EACH_S + WAY_S)) as usize;
        let waved_before = camera_of(at as f64 * (AT_EACH_S + WAY_S) + 0.1);
        let place = |time_s: f64| light(&waved_before, time_s);
        let mut normal = || random.normal();
        let noise = Vector3::new(normal(), normal(), normal()) * 1e-3;
        recording.light.push(LightSample {
            time_s: time_s - 0.004,
            track: at as u32,
            position: place(time_s - 0.004) + noise,
            velocity: (place(time_s - 0.003) - place(time_s - 0.005)) / 0.002,
            covariance: Matrix6::identity() * 1e-6,
        });
        let noise = Vector2::new(normal(), normal()) * 0.3;
        if let Some(seen) = camera_of(time_s).sees(&place(time_s)) {
            recording.camera_frames.push(LitFrame { time_s, pixel: seen + noise, sigma_px: 0.3 });
        }
    }
    recording
}

/// Degrees and millimetres between two axes.
fn apart(found: &Axis, truth: &Axis) -> [f64; 2] {
    let step = found.step_to(truth).unwrap();
    [step.fixed_rows::<2>(0).norm().to_degrees(), 1e3 * step.fixed_rows::<2>(2).norm()]
}

#[test]
fn a_swept_head_is_found_from_what_is_heard_of_it() {
    let truth = crooked();
    let gathered = recorded(&truth, [1.0; 2], 1).gather(&OPTIONS);
    assert_eq!(gathered.settings, 22);
    assert!(gathered.observations.len() == 22 * 15, "{}", gathered.observations.len());
    assert!(gathered.moving > 22 * 60 && gathered.without_light < gathered.camera_frames / 10, "{gathered:?}");
    let found = compare(&optics(&truth), None, &gathered.observations, &HeadOptions::default()).unwrap();
    for (found, truth) in [(found.free.head.pan, truth.pan), (found.free.head.tilt, truth.tilt)] {
        let [degrees, mm] = apart(&found, &truth);
        assert!(degrees < 0.1 && mm < 3.0, "{degrees}° {mm} mm");
    }
    let centre_mm = 1e3 * (found.free.head.at_rest.centre() - truth.at_rest.centre()).norm();
    assert!(centre_mm < 2.0 && (0.8..1.3).contains(&found.calibration.noise_factor), "{centre_mm}");
    // Each model explains more than the one before.
    let rms = found.models().map(|it| it.1.unwrap().rms_px);
    assert!(rms[0] > 1.2 * rms[1] && rms[1] > 5.0 * rms[2] && found.free.median_px < 0.8, "{rms:?}");
}

#[test]
fn units_that_are_a_little_wrong_are_put_right_in_the_file() {
    let truth = crooked();
    let gathered = recorded(&truth, [1.04, 0.97], 2).gather(&OPTIONS);
    let options = HeadOptions { units: [UnitsRule::Near(AxisUnits::RADIANS); 2], ..HeadOptions::default() };
    let found = compare(&optics(&truth), None, &gathered.observations, &options).unwrap();
    let named = |name: &str| NamedCamera { name: name.into(), camera: optics(&truth) };
    let cameras = vec![named("ptz-1"), named("wide-1")];
    let mut calibration = Calibration::new(cameras, LengthUnit::Metre, "a test".into()).unwrap();
    let device = [AxisUnits { rad_per_unit: 0.002, at_rest: 7.0 }, AxisUnits { rad_per_unit: -0.001, at_rest: 0.0 }];
    calibrated_head(&mut calibration, "ptz-1", &found.calibration, device).unwrap();
    assert_eq!(calibrated_head(&mut calibration, "ptz-2", &found.calibration, device), None);
    let read = Calibration::from_toml(&calibration.to_toml(), Path::new("lab.toml")).unwrap();
    let head = read.head("ptz-1").unwrap();
    assert!((head.units[0].rad_per_unit / (0.002 * 1.04) - 1.0).abs() < 1e-3 && head.units[0].at_rest == 7.0);
    assert!((head.units[1].rad_per_unit / (-0.001 * 0.97) - 1.0).abs() < 2e-3, "{:?}", head.units);
    // Where the device counts 100 over its rest, the camera is where the true one is.
    let angles = [head.units[0].angle(107.0), head.units[1].angle(-100.0)];
    let [here, there] = [(&head.model, angles), (&truth, [0.002 * 1.04 * 100.0, 0.001 * 0.97 * 100.0])]
        .map(|(head, [pan, tilt])| head.camera_at(&Setting::new(pan, tilt)).camera_from_world);
    let off = here.inverse() * there;
    assert!(off.translation.vector.norm() < 5e-3 && off.rotation.angle() < 1e-3, "{off}");
    assert!(head.covariance.unwrap().units()[0] < 1e-3);
    assert!(read.uncertainties["ptz-1"].pose_covariance.is_some());
    assert_eq!(read.camera("wide-1"), Some(&optics(&truth)));
}

#[test]
fn where_too_little_was_seen_to_start_the_head_that_is_stated_is_where_the_search_begins() {
    let truth = crooked();
    let mut gathered = recorded(&truth, [1.0; 2], 1).gather(&OPTIONS);
    // Five targets at a setting give no pose of the camera there.
    let mut at = (0, [f64::NAN; 2]);
    gathered.observations.retain(|it| {
        at = if [it.pan, it.tilt] == at.1 { (at.0 + 1, at.1) } else { (0, [it.pan, it.tilt]) };
        at.0 < 5
    });
    let options = HeadOptions { units: [UnitsRule::Unknown { at_rest: 0.0 }; 2], ..HeadOptions::default() };
    let found = |stated: Option<&PanTiltHead>| {
        let stated = stated.map(|it| (it, [AxisUnits::RADIANS; 2]));
        compare(&optics(&truth), stated, &gathered.observations, &options)
    };
    assert!(matches!(found(None), Err(HeadCalibrationError::NoStart { .. })));
    let off = |metres: f64, radians: f64| {
        let mut head = truth.clone();
        let moved = Isometry3::new(Vector3::new(metres, -metres, 0.0), Vector3::new(0.0, radians, radians));
        head.at_rest.camera_from_world = moved * head.at_rest.camera_from_world;
        head
    };
    let head = found(Some(&off(0.02, 0.01))).unwrap().free.head;
    let [degrees, mm] = apart(&head.tilt, &truth.tilt);
    assert!(degrees < 0.2 && mm < 8.0, "{degrees}° {mm} mm");
    assert!((head.at_rest.centre() - truth.at_rest.centre()).norm() < 5e-3);
    // One that looks elsewhere may be no place to begin, but leads nowhere wrong.
    if let Ok(found) = found(Some(&off(0.5, 1.0))) {
        let [degrees, mm] = apart(&found.free.head.tilt, &truth.tilt);
        assert!(degrees < 0.2 && mm < 8.0, "{degrees}° {mm} mm");
    }
}

#[test]
fn a_head_that_hardly_moved_is_refused() {
    let truth = crooked();
    let mut recording = recorded(&truth, [1.0; 2], 1);
    let until_s = 3.0 * (AT_EACH_S + WAY_S) - WAY_S;
    recording.camera_frames.retain(|it| it.time_s < until_s);
    let gathered = recording.gather(&OPTIONS);
    let refused = compare(&optics(&truth), None, &gathered.observations, &HeadOptions::default()).unwrap_err();
    assert_eq!(
        refused,
        HeadCalibrationError::RangeTooSmall {
            axis: "tilt",
            range: 0.0,
            expected: HeadOptions::default().least_range[1]
        }
    );
}

#[test]
fn no_picture_counts_in_which_head_or_light_is_not_known() {
    let truth = crooked();
    let full = recorded(&truth, [1.0; 2], 1);
    let options = OPTIONS;
    let silent = HeadRecording { positions: Vec::new(), ..full.clone() }.gather(&options);
    assert_eq!((silent.moving, silent.observations.len()), (silent.camera_frames, 0));
    let dark = HeadRecording { light: Vec::new(), ..full.clone() }.gather(&options);
    assert_eq!((dark.moving + dark.without_light, dark.observations.len()), (dark.camera_frames, 0));
    // Two tracks in turn: between them nothing is interpolated.
    let mut torn = full.clone();
    torn.light.iter_mut().enumerate().for_each(|(index, it)| it.track = index as u32);
    assert_eq!(torn.gather(&options).observations.len(), 0);
    assert!(full.gather(&GatherOptions { most_a_setting: 5, ..options }).observations.len() == 22 * 5);
}

#[test]
fn a_head_stands_between_two_reports_of_one_place() {
    let report =
        |time_s: f64, pan: f64| PositionReport { earliest_s: time_s, latest_s: time_s + 0.03, angles: [pan, 0.2] };
    let reports = [
        report(0.0, 0.1),
        report(0.1, 0.1),
        report(1.0, 0.1),
        report(1.1, 0.3),
        report(1.2, 0.5),
        report(1.3, 0.5),
        report(2.0, 0.5),
        report(5.0, 0.5), // too long a silence
        report(5.5, 0.5),
    ];
    let found = rest_periods(&reports, 1e-3, 0.25);
    let spans: Vec<[f64; 2]> = found.iter().map(|it| [it.from_s, it.until_s]).collect();
    assert_eq!(spans.len(), 3, "{spans:?}");
    for (found, expected) in spans.iter().zip([[0.28, 1.0], [1.48, 2.0], [5.28, 5.5]]) {
        assert!((found[0] - expected[0]).abs() < 1e-12 && found[1] == expected[1], "{spans:?}");
    }
    assert_eq!(rest_period_at(&found, 0.5).map(|it| it.angles), Some([0.1, 0.2]));
    assert_eq!([0.2, 1.05, 1.3, 3.0, 6.0].map(|it| rest_period_at(&found, it)), [None; 5]);
}

#[test]
fn the_picture_shows_three_models_and_is_the_same_each_time() {
    let truth = crooked();
    let gathered = recorded(&truth, [1.0; 2], 1).gather(&OPTIONS);
    let found = compare(&optics(&truth), None, &gathered.observations, &HeadOptions::default()).unwrap();
    let drawn = picture(&found, "ptz-1 <at the wall>");
    assert_eq!(drawn, picture(&found, "ptz-1 <at the wall>"));
    assert!(drawn.contains("ptz-1 &lt;at the wall&gt;") && drawn.matches("observations").count() >= 6);
    assert!(drawn.contains("free axes (2): median 0.") && !drawn.contains("NaN") && !drawn.contains("inf"));
    let without = Comparison { home: None, aligned: None, ..found };
    assert_eq!(picture(&without, "one").matches("too little was seen").count(), 2);
}

fn sweep() -> Sweep {
    Sweep::new(SweepOptions {
        settings: vec![[0.0, 0.0], [0.5, 0.0], [0.0, 0.3]],
        tolerance: 0.01,
        settle_s: 0.5,
        step_px: 10.0,
        observations: 4,
        cells: 3,
        longest_s: 5.0,
        image_size: [640, 480],
    })
}

#[test]
fn a_sweep_goes_on_when_enough_was_seen_and_says_where_the_light_is_wanted() {
    let mut sweep = sweep();
    assert_eq!(sweep.step(0.0, None), SweepOrder::Go([0.0, 0.0]));
    assert_eq!(sweep.step(0.1, Some([0.2, 0.0])), SweepOrder::Stay);
    assert!(sweep.to_string().starts_with("setting 1 of 3 (pan +0°, tilt +0°): "), "{sweep}");
    assert_eq!(sweep.step(1.0, Some([0.005, 0.0])), SweepOrder::Stay);
    assert_eq!(sweep.seen().next().unwrap().1.observations, 0);
    sweep.add_observation(1.2, Point2::new(30.0, 30.0)); // the camera still swings
    sweep.add_observation(1.6, Point2::new(30.0, 30.0));
    sweep.add_observation(1.7, Point2::new(33.0, 34.0)); // the light stood still
    sweep.add_observation(1.8, Point2::new(320.0, 30.0));
    assert!(["2 of 4", "right", "top"].iter().all(|it| sweep.to_string().contains(it)), "{sweep}");
    for y in [40.0, 50.0, 60.0] {
        sweep.add_observation(2.0, Point2::new(320.0, y));
    }
    assert_eq!(sweep.step(2.1, Some([0.0, 0.0])), SweepOrder::Stay, "three ninths are asked for");
    sweep.add_observation(2.2, Point2::new(639.4, 479.4));
    assert_eq!(sweep.step(2.3, Some([0.0, 0.0])), SweepOrder::Go([0.5, 0.0]));
    assert_eq!((sweep.progress(), sweep.filled()), ([1, 3], 1));
    assert_eq!(sweep.seen().next().unwrap().1.cells, [1, 4, 0, 0, 0, 0, 0, 0, 1]);
}

#[test]
fn a_sweep_does_not_wait_for_ever() {
    let mut sweep = sweep();
    sweep.step(0.0, None);
    // No light comes.
    sweep.step(1.0, Some([0.0, 0.0]));
    assert_eq!(sweep.step(6.0, Some([0.0, 0.0])), SweepOrder::Stay);
    assert_eq!(sweep.step(6.6, Some([0.0, 0.0])), SweepOrder::Go([0.5, 0.0]));
    // The order did not get through; then the head never arrives.
    assert_eq!(sweep.step(9.0, Some([0.0, 0.0])), SweepOrder::Stay);
    assert_eq!(sweep.step(9.7, Some([0.0, 0.0])), SweepOrder::Go([0.5, 0.0]));
    assert_eq!(sweep.step(27.0, Some([0.0, 0.0])), SweepOrder::Go([0.0, 0.3]));
    sweep.step(28.0, Some([0.0, 0.3]));
    assert_eq!(sweep.step(34.0, Some([0.0, 0.3])), SweepOrder::Done);
    assert_eq!(sweep.step(35.0, None), SweepOrder::Done);
    assert_eq!((sweep.progress(), sweep.filled()), ([3, 3], 0));
    assert_eq!(sweep.seen().map(|it| it.1.reached).collect::<Vec<bool>>(), [true, false, true]);
}
