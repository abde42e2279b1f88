//! Patches on a smooth surface whose gray level is a formula: the truth is known to any fraction of a pixel.

use foveate_estimation::random::Random;

use super::*;
use crate::ImageView;

const WIDTH: usize = 200;
const HEIGHT: usize = 160;

/// Waves of 8 to 60 px.
fn level(x: f64, y: f64) -> f64 {
    let wave = |kx: f64, ky: f64, phase: f64| (kx * x + ky * y + phase).sin();
    128.0
        + 30.0 * wave(0.31, 0.22, 0.0)
        + 25.0 * wave(-0.24, 0.41, 1.0)
        + 20.0 * wave(0.52, -0.33, 2.0)
        + 20.0 * wave(0.07, 0.09, 3.0)
        + 15.0 * wave(-0.11, 0.06, 4.0)
}

/// The surface moved by `shift`, under another light.
fn picture(shift: [f64; 2], gain: f64, offset: f64, noise: f64, random: &mut Random) -> Vec<u8> {
    let at = |i: usize| {
        let level = level((i % WIDTH) as f64 - shift[0], (i / WIDTH) as f64 - shift[1]);
        (gain * level + offset + noise * random.normal()).round().clamp(0.0, 255.0) as u8
    };
    (0..WIDTH * HEIGHT).map(at).collect()
}

fn pyramid(pixels: &[u8]) -> Pyramid {
    let mut pyramid = Pyramid::default();
    pyramid.build(&ImageView::new(pixels, WIDTH, HEIGHT).unwrap(), 4);
    pyramid
}

fn tracker(window_px: usize) -> LucasKanade {
    LucasKanade::new(FlowSettings { window_px, ..FlowSettings::default() }).unwrap()
}

/// Tracks 40 patches and returns (root mean square error along one axis, mean of error² / covariance, least correlation).
#[track_caller]
fn errors(window_px: usize, shift: [f64; 2], gain: f64, offset: f64, noise: f64) -> (f64, f64, f64) {
    let mut random = Random::new(11);
    let first = pyramid(&picture([0.0; 2], 1.0, 0.0, noise, &mut random));
    let second = pyramid(&picture(shift, gain, offset, noise, &mut random));
    let (mut tracker, mut template) = (tracker(window_px), Template::default());
    let (mut squares, mut ratio, mut correlation) = (0.0, 0.0, 1.0f64);
    for _ in 0..40 {
        let point = Point2::new(random.uniform_in(50.0, 150.0), random.uniform_in(50.0, 110.0));
        tracker.learn(&first, point, &mut template).unwrap();
        assert_eq!(template.centre(), point);
        let flow = tracker.find(&template, &second, point).unwrap();
        let error = flow.pixel - point - Vector2::from(shift);
        squares += error.norm_squared();
        ratio += (flow.covariance.try_inverse().unwrap() * error).dot(&error);
        correlation = correlation.min(flow.correlation);
    }
    ((squares / 80.0).sqrt(), ratio / 80.0, correlation)
}

#[test]
fn patches_are_found_to_a_fraction_of_a_pixel_and_as_well_as_they_say() {
    for window_px in [7, 11, 15, 21, 23, 25, 31] {
        for shift in [[0.3, 0.7], [3.1, -1.3], [-12.4, 8.6]] {
            let (rms, ratio, correlation) = errors(window_px, shift, 1.0, 0.0, 2.0);
            let bound = if window_px < 11 { 0.15 } else { 0.04 };
            assert!(rms < bound, "{window_px} px, {shift:?}: {rms} px");
            assert!((0.4..2.0).contains(&ratio), "{window_px} px, {shift:?}: errors are {ratio} of what is said");
            assert!(correlation > 0.9, "{correlation}");
        }
    }
}

#[test]
fn another_light_does_not_move_a_patch() {
    let (rms, _, correlation) = errors(21, [2.3, -1.4], 1.0, -25.0, 1.0);
    assert!(rms < 0.03 && correlation > 0.97, "brightness: {rms} px, {correlation}");
    let (rms, _, correlation) = errors(21, [2.3, -1.4], 0.8, 10.0, 1.0);
    assert!(rms < 0.06 && correlation > 0.97, "contrast: {rms} px, {correlation}");
}

#[test]
fn what_is_not_there_correlates_badly() {
    let mut random = Random::new(2);
    let first = pyramid(&picture([0.0; 2], 1.0, 0.0, 2.0, &mut random));
    let other: Vec<u8> =
        (0..WIDTH * HEIGHT).map(|i| level((i / WIDTH) as f64 * 1.7, (i % WIDTH) as f64) as u8).collect();
    let other = pyramid(&other);
    let (mut tracker, mut template) = (tracker(15), Template::default());
    for _ in 0..40 {
        let point = Point2::new(random.uniform_in(50.0, 150.0), random.uniform_in(50.0, 110.0));
        tracker.learn(&first, point, &mut template).unwrap();
        assert!((tracker.correlation(&template, &first, point) - 1.0).abs() < 1e-4);
        if let Ok(flow) = tracker.find(&template, &other, point) {
            assert!(flow.correlation < 0.9, "{flow:?}");
            assert!((tracker.correlation(&template, &other, flow.pixel) - flow.correlation).abs() < 1e-6);
        }
    }
}

#[test]
fn a_patch_near_the_border_is_found_and_one_beyond_it_is_outside() {
    let mut random = Random::new(2);
    let first = pyramid(&picture([0.0; 2], 1.0, 0.0, 1.0, &mut random));
    let second = pyramid(&picture([1.2, 0.4], 1.0, 0.0, 1.0, &mut random));
    let (mut tracker, mut template) = (tracker(15), Template::default());
    for corner in [[7.0, 7.0], [WIDTH as f64 - 9.0, HEIGHT as f64 - 9.0]] {
        let point = Point2::from(corner);
        tracker.learn(&first, point, &mut template).unwrap();
        let flow = tracker.find(&template, &second, point).unwrap();
        let error = (flow.pixel - point - Vector2::new(1.2, 0.4)).norm();
        assert!(error < 0.3, "{error}");
    }
    for place in [[1.0, 80.0], [-40.0, 80.0], [f64::NAN, 3.0], [1e300, 1.0], [3.0, HEIGHT as f64]] {
        let place = Point2::from(place);
        assert_eq!(tracker.learn(&first, place, &mut template), Err(Lost::Outside), "{place}");
        assert_eq!(tracker.correlation(&template, &first, place), 0.0);
    }
    let point = Point2::new(60.0, 60.0);
    tracker.learn(&first, point, &mut template).unwrap();
    for guess in [[-400.0, 80.0], [f64::INFINITY, 3.0], [1e300, 1.0]] {
        let found = tracker.find(&template, &second, Point2::from(guess));
        assert!(matches!(found, Err(Lost::Outside | Lost::Diverged)), "{guess:?}: {found:?}");
    }
}

#[test]
fn flat_pictures_tiny_ones_and_none_are_no_trouble() {
    let (mut tracker, mut template) = (tracker(15), Template::default());
    let point = Point2::new(60.0, 60.0);
    assert_eq!(tracker.find(&template, &Pyramid::default(), point), Err(Lost::Outside));
    assert_eq!(tracker.learn(&Pyramid::default(), point, &mut template), Err(Lost::Outside));
    let flat = pyramid(&[90; WIDTH * HEIGHT]);
    assert_eq!(tracker.learn(&flat, point, &mut template), Err(Lost::Flat));
    let stripes: Vec<u8> =
        (0..WIDTH * HEIGHT).map(|i| (128.0 + 90.0 * (0.4 * (i % WIDTH) as f64).sin()) as u8).collect();
    assert_eq!(tracker.learn(&pyramid(&stripes), point, &mut template), Err(Lost::Flat), "the aperture problem");
    // A picture smaller than the window, and one that has become flat.
    let mut random = Random::new(2);
    let first = pyramid(&picture([0.0; 2], 1.0, 0.0, 1.0, &mut random));
    tracker.learn(&first, point, &mut template).unwrap();
    let mut small = Pyramid::default();
    small.build(&ImageView::new(&[7; 30], 6, 5).unwrap(), 4);
    assert_eq!(tracker.find(&template, &small, Point2::new(3.0, 3.0)), Err(Lost::Outside));
    small.build(&ImageView::new(&[], 0, 5).unwrap(), 4);
    assert_eq!(tracker.find(&template, &small, Point2::new(0.0, 3.0)), Err(Lost::Outside));
    if let Ok(flow) = tracker.find(&template, &flat, point) {
        assert_eq!(flow.correlation, 0.0);
    }
}

#[test]
fn settings_out_of_range_are_named() {
    let named = |settings| LucasKanade::new(settings).err().map(|it| it.to_string());
    let settings = FlowSettings::default();
    assert_eq!(named(settings), None);
    for (name, settings) in [
        ("window_px", FlowSettings { window_px: 14, ..settings }),
        ("window_px", FlowSettings { window_px: 33, ..settings }),
        ("levels", FlowSettings { levels: 0, ..settings }),
        ("max_steps", FlowSettings { max_steps: 0, ..settings }),
        ("stop_px", FlowSettings { stop_px: f64::NAN, ..settings }),
        ("min_texture", FlowSettings { min_texture: -1.0, ..settings }),
    ] {
        assert!(named(settings).is_some_and(|it| it.contains(name)), "{name}");
    }
}
