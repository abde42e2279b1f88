//! What `wave_calibrator` promises, tried.

use foveate::estimation::Random;
use foveate::geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Isometry3, Point3, Vector2};

use super::*;

const SIZE: [f64; 2] = [2.8, 1.2];
const HOLD_S: f64 = 1.2;
const STEP_S: f64 = 2.2;

fn corners() -> Vec<Point2<f64>> {
    let [width, height] = SIZE;
    [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height], [width / 2.0, 0.0], [width / 2.0, height]]
        .map(Point2::from)
        .into()
}

/// Held at each corner, then waved.
fn place(time_s: f64) -> Point2<f64> {
    let corners = corners();
    let slot = (time_s / STEP_S) as usize;
    let into = time_s - slot as f64 * STEP_S;
    let waved = |time_s: f64| {
        Point2::new(SIZE[0] * (0.5 + 0.5 * (0.83 * time_s).sin()), SIZE[1] * (0.5 + 0.5 * (2.1 * time_s + 1.0).sin()))
    };
    match (corners.get(slot), corners.get(slot + 1)) {
        (Some(here), _) if into < HOLD_S => *here,
        (Some(here), next) => {
            let s = (into - HOLD_S) / (STEP_S - HOLD_S);
            let next = next.copied().unwrap_or_else(|| waved((slot + 1) as f64 * STEP_S));
            here + (next - here) * (s * s * s * (10.0 + s * (6.0 * s - 15.0)))
        }
        _ => waved(time_s),
    }
}

fn cameras() -> Vec<CameraGuess> {
    let camera = |x: f64| Camera {
        image_size: [640, 480],
        intrinsics: Intrinsics { focal: [800.0; 2], principal: [322.0, 238.0], skew: 0.0 },
        distortion: Distortion { k1: -0.05, ..Distortion::default() },
        camera_from_world: Isometry3::translation(-x, -0.6, 2.1),
    };
    let guess = |x: f64| CameraGuess { name: format!("at {x}"), camera: camera(x), free: Default::default() };
    vec![guess(0.65), guess(1.4), guess(2.15)]
}

/// Pictures at 60 Hz, each camera's at its own moments; `spots` may change what a camera sees at a time.
fn recording(spots: impl Fn(usize, f64, Point2<f64>) -> Vec<Point2<f64>>) -> Recording {
    let mut random = Random::new(11);
    let cameras = cameras();
    let mut camera_frames = Vec::new();
    for frame in 0..3000 {
        for (camera, guess) in cameras.iter().enumerate() {
            let time_s = f64::from(frame) / 60.0 + 0.005 * camera as f64;
            let seen = spots(camera, time_s, place(time_s)).into_iter().zip(0..).filter_map(|(point, rank)| {
                let pixel = guess.camera.sees(&Point3::new(point.x, point.y, 0.0))?;
                let pixel = pixel + Vector2::new(random.normal(), random.normal()) * 0.05;
                Some(Spot { pixel, sigma_px: 0.05, peak: 255.0 - f64::from(rank), label: None })
            });
            camera_frames.push(CameraFrame { camera, time_s, spots: seen.collect() });
        }
    }
    Recording { cameras, camera_frames }
}

fn touches() -> Touches {
    Touches { places: corners(), sigma: 1e-4, hold_s: 0.8 }
}

/// The largest error over what each camera sees of the wall [m].
fn worst(found: &Waved) -> f64 {
    let mut worst = 0.0_f64;
    for (guess, map) in cameras().iter().zip(&found.network.maps) {
        let Ok(map) = map else { continue };
        for step in 0..200 {
            let point = Point2::new(0.014 * f64::from(step), SIZE[1] * f64::from(step * 7 % 200) / 200.0);
            let Some(pixel) = guess.camera.sees(&Point3::new(point.x, point.y, 0.0)) else { continue };
            worst = worst.max((map.point(&pixel).unwrap() - point).norm());
        }
    }
    worst
}

#[test]
fn waved_pointer_maps_cameras_that_run_freely() {
    let found = solve(&recording(|_, _, point| vec![point]), &touches()).unwrap();
    assert!(found.network.maps.iter().all(Result::is_ok));
    assert!(found.n_shared > 500 && found.n_wild == 0, "{} {}", found.n_shared, found.n_wild);
    for error in &found.held_out_m {
        assert!(error.unwrap() < 0.5e-3, "{error:?}");
    }
    assert_eq!(found.touched.len(), 6);
    assert_eq!(wrong(&found.touched, default_touch_sigmas()), None, "{:?}", found.touched);
    let worst = worst(&found);
    assert!(worst < 1.6e-3, "{} mm", worst * 1e3);
}

#[test]
fn reflections_are_left_out() {
    let mirrored = |camera: usize, time_s: f64, point: Point2<f64>| {
        let near = (point.x - 1.4).abs() < 0.06 && camera > 0 && time_s > 14.0;
        let mut spots = vec![point];
        // For a while the reflection is the brighter one.
        if near {
            spots.insert(0, Point2::new(2.8 - point.x - 0.01, point.y));
        }
        spots
    };
    let found = solve(&recording(mirrored), &touches()).unwrap();
    let worst = worst(&found);
    assert!(worst < 2.5e-3, "{} mm", worst * 1e3);
}

#[test]
fn a_corner_that_was_touched_elsewhere_is_named() {
    let recording = recording(|_, _, point| vec![point]);
    for (number, by) in [(1, Vector2::new(-0.2, 0.0)), (3, Vector2::new(0.0, 0.05)), (4, Vector2::new(0.03, 0.02))] {
        let mut said = touches();
        said.sigma = 1e-3;
        said.places[number] += by;
        let found = solve(&recording, &said).unwrap();
        let why = wrong(&found.touched, default_touch_sigmas()).unwrap_or_else(|| panic!("{:?}", found.touched));
        assert!(why.contains(&format!("place {} of", number + 1)) && why.contains("held there"), "{why}");
        // Places in a line explain each other's errors, and small errors have several explanations; not all have.
        assert!(why.matches("of `touch_m`").count() <= 4, "{why}");
    }
}

#[test]
fn what_is_wrong_is_said() {
    let why = |spots: &dyn Fn(usize, f64, Point2<f64>) -> Vec<Point2<f64>>, touches: &Touches| {
        solve(&recording(spots), touches).unwrap_err()
    };
    let one = |_: usize, _: f64, point: Point2<f64>| vec![point];
    let mut fewer = touches();
    fewer.places.pop();
    let message = why(&one, &fewer);
    assert!(message.contains("held still 6 times") && message.contains("expected 5"), "{message}");
    let none = why(&|_, _, _| Vec::new(), &touches());
    assert!(none.contains("never"), "{none}");
    // Waved where the first camera alone looks.
    let beside = |_: usize, time_s: f64, point: Point2<f64>| {
        let is_held = time_s < 6.0 * STEP_S && time_s % STEP_S < HOLD_S;
        if is_held || point.x < 0.3 { vec![point] } else { Vec::new() }
    };
    let apart = why(&beside, &touches());
    assert!(apart.contains("no two cameras share"), "{apart}");
    // Without the last camera's cable.
    let found = solve(&recording(|camera, _, point| if camera < 2 { vec![point] } else { Vec::new() }), &touches());
    let message = found.map(|it| it.network.maps[2].clone().unwrap_err().to_string());
    // The right corners are beyond the others' views.
    let message = message.unwrap_or_else(|it| it);
    assert!(message.contains("0 times") || message.contains("held still 4 times"), "{message}");
}

#[test]
fn settings_are_read_and_refused() {
    let good = "size_m = [4.0, 1.5]\npixel_mm = 0.8\nbrightest = 190";
    foveate_testkit::check_node::<WaveCalibrator>(good);
    let mut settings = WaveCalibratorSettings {
        size_m: [4.0, 1.0],
        pixel_mm: 0.8,
        touch_m: vec![[0.0, 0.0]; 3],
        touch_mm: default_touch_mm(),
        touch_sigmas: default_touch_sigmas(),
        hold_s: default_hold_s(),
        limit_px: default_limit_px(),
        brightest: 190.0,
        file: default_file(),
    };
    let refused = |settings: &WaveCalibratorSettings| {
        WaveCalibrator::new(settings.clone(), &Setup::for_tests()).err().and_then(|it| it.setting)
    };
    assert_eq!(refused(&settings).as_deref(), Some("touch_m"));
    settings.touch_m.extend([[4.2, 0.5], [3.0, 1.0]]);
    assert_eq!(refused(&settings).as_deref(), Some("touch_m[3]"), "beyond the wall");
    settings.touch_m.clear();
    assert_eq!(refused(&settings), None);
    settings.hold_s = f64::NAN;
    assert_eq!(refused(&settings).as_deref(), Some("hold_s"));
}
