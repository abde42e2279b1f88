//! What `calibrator` promises, tried.

use foveate::estimation::Random;
use foveate::geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Isometry3, Point3, Vector2};

use super::*;

const SIZE: [u32; 2] = [640, 480];

fn wall() -> WallSize {
    WallSize { size_m: [2.4, 1.2], pixel_m: 8e-4, tiles: [2, 1] }
}

fn cameras() -> Vec<Camera> {
    let camera = |x: f64| Camera {
        image_size: SIZE,
        intrinsics: Intrinsics { focal: [880.0; 2], principal: [324.0, 237.0], skew: 0.0 },
        distortion: Distortion { k1: -0.05, ..Distortion::default() },
        camera_from_world: Isometry3::translation(-x, -0.6, 2.2),
    };
    vec![camera(0.64), camera(1.76)]
}

/// Dots, a tenth of a second each; frames at 60 Hz in which `sees` says whether a camera sees a dot.
fn scene(sees: impl Fn(usize, &Point2<f64>) -> bool) -> (Vec<ShownDot>, Vec<Vec<Frame>>) {
    let places = (0..10).flat_map(|row| (0..20).map(move |column| (row, column)));
    let dots: Vec<ShownDot> = places
        .zip(0..)
        .map(|((row, column), number)| ShownDot {
            number,
            point: Point2::new(0.05 + 0.12 * f64::from(column), 0.05 + 0.12 * f64::from(row)),
            from: Time::from_s(0.1 * f64::from(number)),
            until: Time::from_s(0.1 * f64::from(number) + 0.083),
        })
        .collect();
    let mut random = Random::new(7);
    let cameras = cameras();
    let frames = cameras.iter().enumerate().map(|(number, camera)| {
        let frames = (0..1200).map(|frame| {
            let time_s = 0.003 + f64::from(frame) / 60.0;
            // Shown 30 ms late.
            let dot = dots.get(((time_s - 0.03) * 10.0).floor().max(0.0) as usize);
            let pixel = dot
                .filter(|it| sees(number, &it.point))
                .and_then(|it| camera.sees(&Point3::new(it.point.x, it.point.y, 0.0)));
            let spots = pixel.map(|it| (it + Vector2::new(random.normal(), random.normal()) * 0.03, 9e-4, 150));
            Frame { time: Time::from_s(time_s), spots: spots.into_iter().collect() }
        });
        frames.collect()
    });
    let frames = frames.collect();
    (dots, frames)
}

fn calibrated(sees: impl Fn(usize, &Point2<f64>) -> bool) -> DotCalibration {
    let (dots, frames) = scene(sees);
    calibrate(&wall(), &[SIZE; 2], &dots, &frames, Interval::from_ms(50.0), 1.0)
}

#[test]
fn dots_map_cameras_to_a_tenth_of_a_wall_pixel_and_say_so() {
    let found = calibrated(|_, _| true);
    assert_eq!((found.dark, found.hidden), (vec![], vec![0, 0]));
    for (camera, result) in cameras().iter().zip(&found.cameras) {
        let map = result.map.as_ref().unwrap();
        assert!(result.n_dots > 100 && map.brightest == 150.0 && map.held_out_px < 0.15, "{result:?}");
        for step in 0..60 {
            let point = Point2::new(0.02 + 0.04 * f64::from(step), 0.2 + 0.015 * f64::from(step));
            let Some(pixel) = camera.sees(&Point3::new(point.x, point.y, 0.0)) else { continue };
            let off = (map.map.point(&pixel).unwrap() - point).norm() / 8e-4;
            assert!(off < 0.15, "{off} px of the wall at {pixel}");
        }
    }
}

#[test]
fn settling_too_short_puts_dots_in_doubt_and_none_in_the_wrong_place() {
    let (dots, frames) = scene(|_, _| true);
    let found = calibrate(&wall(), &[SIZE; 2], &dots, &frames, Interval::from_ms(0.0), 1.0);
    assert!(found.cameras[0].n_doubtful > 50 || found.cameras[0].map.is_err(), "{:?}", found.cameras[0]);
}

#[test]
fn camera_that_sees_no_dots_and_one_that_sees_a_line_are_named() {
    let found = calibrated(|camera, point| camera == 1 && (point.y - 0.53).abs() < 0.01);
    let why = |camera: usize| found.cameras[camera].map.as_ref().err().unwrap().clone();
    assert!(why(0).contains("saw 0 dots"), "{}", why(0));
    assert!(why(1).contains("on one line"), "{}", why(1));
}

#[test]
fn display_that_is_off_is_named_and_the_cameras_are_mapped_by_the_rest() {
    let found = calibrated(|_, point| point.x < 1.2);
    assert_eq!(found.dark, [([1, 0], 100)]);
    assert!(found.cameras[0].map.is_ok());
}

#[test]
fn camera_with_something_in_its_way_is_named() {
    let found = calibrated(|camera, point| camera == 1 || !((1.1..1.4).contains(&point.x) && point.y > 0.5));
    assert!(found.hidden[0] > 5 && found.hidden[1] == 0, "{:?}", found.hidden);
}

#[test]
fn wall_that_is_not_flat_has_an_error_that_is_told() {
    let (mut dots, frames) = scene(|_, _| true);
    for dot in &mut dots {
        // As measured by somebody who took no account of the bezel.
        dot.point.x -= if dot.point.x > 0.6 { 0.012 } else { 0.0 };
    }
    let found = calibrate(&wall(), &[SIZE; 2], &dots, &frames, Interval::from_ms(50.0), 1.0);
    let why = found.cameras[0].map.as_ref().err().unwrap();
    assert!(why.contains("held out") && why.contains("flat"), "{why}");
}

#[test]
fn settings_are_read_and_written() {
    foveate_testkit::check_node::<Calibrator>("size_m = [4.0, 1.5]\npixel_mm = 0.8");
    let refused = |size_m| {
        let settings = CalibratorSettings {
            size_m,
            pixel_mm: 0.8,
            tiles: default_tiles(),
            settle_ms: default_settle_ms(),
            limit_px: default_limit_px(),
            file: default_file(),
        };
        Calibrator::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting)
    };
    assert_eq!(refused([0.0, 1.0]).as_deref(), Some("size_m"));
    assert_eq!(refused([4.0, 1.0]), None);
}
