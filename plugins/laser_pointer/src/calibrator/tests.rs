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
fn scene(sees: impl Fn(usize, &Point2<f64>) -> bool) -> (Vec<Shown>, Vec<Vec<Frame>>) {
    scene_on(|it| Point3::new(it.x, it.y, 0.0), sees)
}

/// The same on a wall whose points are where `in_space` says.
fn scene_on(
    in_space: impl Fn(&Point2<f64>) -> Point3<f64>,
    sees: impl Fn(usize, &Point2<f64>) -> bool,
) -> (Vec<Shown>, Vec<Vec<Frame>>) {
    let places = (0..10).flat_map(|row| (0..20).map(move |column| (row, column)));
    let dots: Vec<Shown> = places
        .zip(0..)
        .map(|((row, column), number)| Shown {
            points: vec![Point2::new(0.05 + 0.12 * f64::from(column), 0.05 + 0.12 * f64::from(row))],
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
            let pixel =
                dot.map(|it| it.points[0]).filter(|it| sees(number, it)).and_then(|it| camera.sees(&in_space(&it)));
            let spots = pixel.map(|it| Spot {
                pixel: it + Vector2::new(random.normal(), random.normal()) * 0.03,
                variance: 9e-4,
                peak: 150,
                label: None,
            });
            Frame { time: Time::from_s(time_s), spots: spots.into_iter().collect() }
        });
        frames.collect()
    });
    let frames = frames.collect();
    (dots, frames)
}

fn options(settle_ms: f64) -> ShownOptions {
    ShownOptions { board: None, settle: Interval::from_ms(settle_ms), surface: Surface::Flat, limit_px: 1.0 }
}

fn calibrated(sees: impl Fn(usize, &Point2<f64>) -> bool) -> ShownCalibration {
    let (dots, frames) = scene(sees);
    calibrate(&wall(), &[SIZE; 2], &dots, &frames, &options(50.0))
}

#[test]
fn dots_map_cameras_to_a_tenth_of_a_wall_pixel_and_say_so() {
    let found = calibrated(|_, _| true);
    assert_eq!((found.dark, found.hidden), (vec![], vec![0, 0]));
    for (camera, result) in cameras().iter().zip(&found.cameras) {
        let map = result.map.as_ref().unwrap();
        assert!(result.n_seen > 100 && map.brightest == 150.0 && map.held_out_px < 0.15, "{result:?}");
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
    let found = calibrate(&wall(), &[SIZE; 2], &dots, &frames, &options(0.0));
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
fn error_of_a_curved_wall_is_reported() {
    let (mut dots, frames) = scene(|_, _| true);
    for dot in &mut dots {
        // As measured by somebody who took no account of the bezel.
        dot.points[0].x -= if dot.points[0].x > 0.6 { 0.012 } else { 0.0 };
    }
    let found = calibrate(&wall(), &[SIZE; 2], &dots, &frames, &options(50.0));
    let why = found.cameras[0].map.as_ref().err().unwrap();
    assert!(why.contains("held-out") && why.contains("flat"), "{why}");
}

/// Along an arc of three metres about the wall's middle, its ends nearer to the cameras.
fn bent(point: &Point2<f64>) -> Point3<f64> {
    let angle = (point.x - 1.2) / 3.0;
    Point3::new(1.2 + 3.0 * angle.sin(), point.y, -3.0 * (1.0 - angle.cos()))
}

#[test]
fn wall_that_bends_is_told_by_the_setting_to_add_and_mapped_with_it() {
    let (dots, frames) = scene_on(bent, |_, _| true);
    let of = |surface| {
        let options = ShownOptions { surface, ..options(50.0) };
        calibrate(&wall(), &[SIZE; 2], &dots, &frames, &options)
    };
    let flat = of(Surface::Flat);
    let why = flat.cameras[0].map.as_ref().err().unwrap();
    assert!(why.contains("with `surface = \"curved\"` it is off by 0."), "{why}");
    let curved = of(Surface::Curved);
    for (camera, result) in cameras().iter().zip(&curved.cameras) {
        let map = result.map.as_ref().unwrap();
        assert!(map.held_out_px < 0.6, "{}", map.held_out_px);
        for step in 0..60 {
            let point = Point2::new(0.06 + 0.038 * f64::from(step), 0.2 + 0.013 * f64::from(step));
            let Some(pixel) = camera.sees(&bent(&point)) else { continue };
            let off = (map.map.point(&pixel).unwrap() - point).norm() / 8e-4;
            assert!(off < 1.0, "{off} px of the wall at {pixel}");
        }
    }
}

#[test]
fn wall_that_bends_is_refused_where_its_dots_are_few() {
    let (dots, frames) = scene_on(bent, |_, point| (point.x - 0.6).abs() < 0.3 && (point.y - 0.5).abs() < 0.2);
    let options = ShownOptions { surface: Surface::Curved, ..options(50.0) };
    let found = calibrate(&wall(), &[SIZE; 2], &dots, &frames, &options);
    let why = found.cameras[0].map.as_ref().err().unwrap();
    assert!(why.contains("expected at least 24"), "{why}");
}

#[test]
fn settings_are_read_and_written() {
    foveate_testkit::check_node::<Calibrator>("size_m = [4.0, 1.5]\npixel_mm = 0.8");
    let refused = |size_m| {
        let settings = CalibratorSettings {
            size_m,
            pixel_mm: 0.8,
            tiles: default_tiles(),
            surface: Surface::Flat,
            settle_ms: default_settle_ms(),
            limit_px: default_limit_px(),
            board: None,
            held: Vec::new(),
            brightest: None,
            file: default_file(),
        };
        Calibrator::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting)
    };
    assert_eq!(refused([0.0, 1.0]).as_deref(), Some("size_m"));
    assert_eq!(refused([4.0, 1.0]), None);
    let settings = serde_json::json!({"size_m": [4.0, 1.5], "pixel_mm": 0.8, "surface": "curved", "board": [7, 4]});
    let why = Calibrator::new(serde_json::from_value(settings).unwrap(), &Setup::for_tests()).err().unwrap();
    assert_eq!((why.setting.as_deref(), why.message.contains("expected dots")), (Some("surface"), true), "{why}");
}

/// A board of 7 x 4 inner corners at places in three rows, in the pictures of the first camera before a wall that is mirrored about (0.64, 0.6) where a sign is −1;
/// corners as the detector numbers them: the upper left of the picture first, rows clockwise from columns.
fn boards(sign: [f64; 2]) -> (Vec<Shown>, Vec<Frame>) {
    let mut random = Random::new(3);
    let camera = &cameras()[0];
    let (mut shown, mut frames) = (Vec::new(), Vec::new());
    for number in 0..12 {
        let corner = Point2::new(0.1 + 0.25 * f64::from(number % 4), 0.15 + 0.3 * f64::from(number / 4));
        let points: Vec<Point2<f64>> =
            (0..28).map(|it| corner + Vector2::new(0.05 * f64::from(it % 7), 0.05 * f64::from(it / 7))).collect();
        let pixels: Option<Vec<Point2<f64>>> = points.iter().map(|it| camera.sees(&turned(*it, sign))).collect();
        let from = Time::from_s(0.3 * f64::from(number));
        shown.push(Shown { points, from, until: from + Interval::from_ms(250.0) });
        let Some(pixels) = pixels else { continue };
        let found: Vec<Point2<f64>> = (0..28)
            .map(|it| {
                let (column, row) = (it % 7, it / 7);
                let column = if sign[0] < 0.0 { 6 - column } else { column };
                pixels[if sign[1] < 0.0 { 3 - row } else { row } * 7 + column]
            })
            .collect();
        for picture in 1..5 {
            let spots = found.iter().zip(0..).map(|(it, label)| Spot {
                pixel: it + Vector2::new(random.normal(), random.normal()) * 0.05,
                variance: 0.0025,
                peak: 140,
                label: Some(label),
            });
            frames.push(Frame { time: from + Interval::from_ms(50.0 * f64::from(picture)), spots: spots.collect() });
        }
    }
    (shown, frames)
}

/// A point of the wall in space.
fn turned(point: Point2<f64>, sign: [f64; 2]) -> Point3<f64> {
    let middle = Point2::new(0.64, 0.6);
    let at = middle + (point - middle).component_mul(&Vector2::from(sign));
    Point3::new(at.x, at.y, 0.0)
}

fn calibrated_by_boards(shown: &[Shown], frames: Vec<Frame>) -> CameraResult {
    let options = ShownOptions { board: Some([7, 4]), ..options(50.0) };
    calibrate(&wall(), &[SIZE], shown, &[frames], &options).cameras.remove(0)
}

#[test]
fn boards_map_a_camera_that_sees_the_wall_upright_upside_down_or_mirrored() {
    for (sign, stance) in [
        ([1.0, 1.0], None),
        ([-1.0, -1.0], Some("upside down")),
        ([-1.0, 1.0], Some("mirrored: it stands behind it")),
        ([1.0, -1.0], Some("mirrored and upside down: it stands behind it")),
    ] {
        let (shown, frames) = boards(sign);
        let result = calibrated_by_boards(&shown, frames);
        assert_eq!((result.stance, result.n_elsewhere), (stance, 0), "{:?}", result.map);
        let map = result.map.unwrap();
        assert!(map.held_out_px < 0.3 && map.brightest == 140.0, "{}", map.held_out_px);
        let point = Point2::new(0.71, 0.66);
        let pixel = cameras()[0].sees(&turned(point, sign)).unwrap();
        let off = (map.map.point(&pixel).unwrap() - point).norm() / 8e-4;
        assert!(off < 0.15, "{sign:?}: {off} px of the wall");
    }
}

#[test]
fn boards_that_cannot_tell_and_boards_that_are_elsewhere_are_named() {
    let (shown, frames) = boards([1.0, 1.0]);
    let part = |keep: &dyn Fn(&Frame) -> bool| frames.iter().filter(|it| keep(it)).cloned().collect::<Vec<_>>();
    let why = |frames: Vec<Frame>| calibrated_by_boards(&shown, frames).map.unwrap_err();
    let one = why(part(&|it| it.time < Time::from_s(0.3)));
    assert!(one.contains("at 1 places") && one.contains("ambiguous"), "{one}");
    let row = why(part(&|it| it.time < Time::from_s(1.2)));
    assert!(row.contains("in one line") && row.contains("mirrored"), "{row}");
    // The sixth was stated to be twenty centimetres from where it was.
    let mut stated = shown.clone();
    stated[5].points.iter_mut().for_each(|it| it.x += 0.2);
    let result = calibrated_by_boards(&stated, frames.clone());
    assert!(result.n_elsewhere == 1 && result.map.is_ok(), "{result:?}");
    // A detector that looks for another board.
    let mut fewer = frames;
    fewer.iter_mut().for_each(|it| it.spots.truncate(20));
    let result = calibrated_by_boards(&shown, fewer);
    assert!(result.other_corners == Some(20) && result.map.is_err(), "{result:?}");
}

#[test]
fn board_held_on_the_wall_is_where_it_was_stated() {
    let held = HeldBoard { from_s: 1.0, until_s: 2.0, corner_m: [1.0, 0.5], square_mm: 50.0, turned_deg: 90.0 };
    let shown = held.shown([7, 4]).unwrap();
    // Rows run down, columns to the left.
    assert!((shown.points[6] - Point2::new(1.0, 0.8)).norm() < 1e-12, "{}", shown.points[6]);
    assert!((shown.points[7] - Point2::new(0.95, 0.5)).norm() < 1e-12, "{}", shown.points[7]);
    let refused = HeldBoard { until_s: 0.5, ..held }.shown([7, 4]).unwrap_err();
    assert_eq!(refused.setting.as_deref(), Some("held.until_s"));
}
