//! Lights in pictures of which the truth is known.

use foveate_testkit::render_spot;
use foveate_testkit::scene::add_spot;

use super::*;

const SIZE: [u32; 2] = [160, 120];

/// Everything searched, nothing learnt, unless a test says otherwise.
fn plain() -> DetectorSettings {
    DetectorSettings { learn_frames: 0, left_out_frames: 0, search: Search::Full, ..DetectorSettings::default() }
}

fn dark() -> Image {
    render_spot(SIZE, [0.0, 0.0], 1.0, 0.0)
}

fn with_spots(centres: &[[f64; 2]]) -> Image {
    let mut image = dark();
    centres.iter().for_each(|centre| add_spot(&mut image, *centre, 1.5, 220.0));
    image
}

fn led_detector(settings: DetectorSettings) -> LedDetector {
    LedDetector::new(settings, None, 0).unwrap()
}

#[track_caller]
fn find(led_detector: &mut LedDetector, image: &Image) -> Vec<Point2<f64>> {
    find_near(led_detector, image, &[])
}

#[track_caller]
fn find_near(led_detector: &mut LedDetector, image: &Image, predicted: &[Point2<f64>]) -> Vec<Point2<f64>> {
    let mut features = Features::default();
    led_detector.find(image, predicted.iter().copied(), &mut features).unwrap();
    features.list.iter().map(|it| it.centre).collect()
}

#[test]
fn spots_are_found_within_a_twentieth_of_a_pixel_in_scan_order() {
    let centres = [[100.3, 20.7], [30.2, 60.4], [140.8, 99.1]];
    let found = find(&mut led_detector(plain()), &with_spots(&centres));
    assert_eq!(found.len(), 3);
    for (found, truth) in found.iter().zip(centres) {
        assert!((found - Point2::from(truth)).norm() < 0.05, "{found} for {truth:?}");
    }
}

#[test]
fn the_papers_centroid_is_a_whole_pixel() {
    let settings = DetectorSettings { centroid: CentroidKind::Integer, ..plain() };
    assert_eq!(find(&mut led_detector(settings), &with_spots(&[[30.3, 60.8]])), [Point2::new(30.0, 61.0)]);
}

#[test]
fn colour_pictures_are_searched_in_the_plane_that_the_rig_names() {
    let gray = with_spots(&[[50.0, 40.0]]);
    let red = gray.pixels.iter().flat_map(|&it| [it, 0, 0]).collect();
    let image = Image { format: PixelFormat::Rgb8, pixels: red, ..gray };
    for (channel, n) in [(ColourPlane::Red, 1), (ColourPlane::Max, 1), (ColourPlane::Green, 0), (ColourPlane::Blue, 0)]
    {
        let found = find(&mut led_detector(DetectorSettings { channel, ..plain() }), &image);
        assert_eq!(found.len(), n, "{channel:?}");
    }
}

#[test]
fn colour_is_not_looked_for_in_gray_pictures() {
    let mut led_detector = led_detector(DetectorSettings { channel: ColourPlane::Green, ..plain() });
    let mut features = Features::default();
    let refused = led_detector.find(&with_spots(&[[50.0, 40.0]]), std::iter::empty(), &mut features);
    assert_eq!(refused, Err(Refusal::NoColour));
    assert!(Refusal::NoColour.to_string().contains("rgb"));
}

#[test]
fn what_is_masked_is_not_found() {
    let masks = vec![vec![[40.0, 30.0], [60.0, 30.0], [60.0, 50.0], [40.0, 50.0]]];
    for learn_frames in [0, 1] {
        let mut led_detector = led_detector(DetectorSettings { masks: masks.clone(), learn_frames, ..plain() });
        find(&mut led_detector, &dark());
        let found = find(&mut led_detector, &with_spots(&[[50.0, 40.0], [100.0, 80.0]]));
        assert_eq!(found.len(), 1);
        assert!(found[0].x > 90.0);
    }
}

#[test]
fn a_lamp_is_learnt_and_a_light_beside_it_is_found() {
    let mut led_detector = led_detector(DetectorSettings { learn_frames: 3, ..plain() });
    let lamp = with_spots(&[[50.0, 40.0]]);
    let mut features = Features::default();
    for _ in 0..3 {
        assert_eq!(led_detector.find(&lamp, std::iter::empty(), &mut features), Ok(Outcome::Learning));
        assert!(features.list.is_empty());
    }
    assert_eq!(find(&mut led_detector, &lamp), []);
    assert_eq!(find(&mut led_detector, &with_spots(&[[50.0, 40.0], [90.0, 40.0]])).len(), 1);
}

#[test]
fn while_learning_the_lowest_threshold_may_serve() {
    let settings = DetectorSettings { learn_frames: 3, while_learning: WhileLearning::Search, ..plain() };
    let mut led_detector = led_detector(settings);
    let lamp = with_spots(&[[50.0, 40.0]]);
    assert_eq!([(); 4].map(|()| find(&mut led_detector, &lamp).len()), [1, 1, 1, 0]);
}

#[test]
fn a_light_that_moves_on_while_learning_leaves_no_trace_if_its_frames_are_left_out() {
    for (left_out_frames, found) in [(0, 0), (2, 1)] {
        let mut led_detector = led_detector(DetectorSettings { learn_frames: 8, left_out_frames, ..plain() });
        (0..8).for_each(|k| _ = find(&mut led_detector, &with_spots(&[[20.0 + 15.0 * f64::from(k), 40.0]])));
        let again = find(&mut led_detector, &with_spots(&[[50.0, 40.0]]));
        assert_eq!(again.len(), found, "{left_out_frames} frames left out");
    }
}

#[test]
fn a_room_that_gets_bright_is_not_believed_and_then_learnt() {
    let mut led_detector = led_detector(DetectorSettings { learn_frames: 4, ..plain() });
    (0..4).for_each(|_| _ = find(&mut led_detector, &dark()));
    let mut bright = with_spots(&[[50.0, 40.0]]);
    bright.pixels.iter_mut().for_each(|it| *it = it.saturating_add(100));
    let mut features = Features::default();
    for _ in 0..4 {
        assert_eq!(led_detector.find(&bright, std::iter::empty(), &mut features), Ok(Outcome::Flooded));
        assert!(features.list.is_empty());
    }
    bright = with_spots(&[[90.0, 40.0]]);
    bright.pixels.iter_mut().for_each(|it| *it = it.saturating_add(100));
    assert_eq!(find(&mut led_detector, &bright).len(), 1);
}

#[test]
fn a_sampled_search_finds_small_lights_in_some_frame_and_keeps_them_in_every() {
    let settings = DetectorSettings { search: Search::Sampled, grid_px: 20, min_area_px: 1, ..plain() };
    let mut led_detector = led_detector(settings);
    let image = with_spots(&[[80.0, 67.0]]);
    let counts: Vec<usize> = (0..40).map(|_| find(&mut led_detector, &image).len()).collect();
    let first = counts.iter().position(|&it| it == 1).unwrap();
    assert!(first < 20, "{counts:?}");
    assert!(counts[first..].iter().all(|&it| it == 1), "the window at the last position loses it: {counts:?}");
}

#[test]
fn windows_follow_the_speed_in_the_image_and_the_predictions() {
    // 30 px a frame with windows of 40 px: where it was does not reach where it is.
    let settings = DetectorSettings { search: Search::Sampled, grid_px: 1000, window_px: 40, ..plain() };
    let at = |k: f64| with_spots(&[[15.0 + 30.0 * k, 61.0]]);
    let mut blind = led_detector(settings.clone());
    assert_eq!([0.0, 1.0].map(|k| find(&mut blind, &at(k)).len()), [0, 0]);
    let mut led = led_detector(settings);
    let near = |k: f64| [Point2::new(20.0 + 30.0 * k, 58.0)];
    assert_eq!([0.0, 1.0].map(|k| find_near(&mut led, &at(k), &near(k)).len()), [1, 1]);
    assert_eq!([2.0, 3.0].map(|k| find(&mut led, &at(k)).len()), [1, 1], "its speed is known by now");
}

#[test]
fn wrong_sizes_and_broken_pictures_are_refused_and_the_next_one_is_searched() {
    let mut features = Features::default();
    let mut led_detector = LedDetector::new(plain(), Some(SIZE), 0).unwrap();
    let other = render_spot([80, 60], [20.0, 20.0], 1.5, 220.0);
    let refused = led_detector.find(&other, std::iter::empty(), &mut features).unwrap_err();
    assert_eq!(refused.to_string(), "the picture is 80 x 60 px, the camera's are 160 x 120 px");
    let mut broken = with_spots(&[[50.0, 40.0]]);
    broken.pixels.pop();
    assert!(matches!(led_detector.find(&broken, std::iter::empty(), &mut features), Err(Refusal::Broken(_))));
    broken.format = PixelFormat::Rgb8;
    assert!(led_detector.find(&broken, std::iter::empty(), &mut features).is_err());
    let none = Image { width: 0, height: 0, pixels: Vec::new(), ..dark() };
    assert!(led_detector.find(&none, std::iter::empty(), &mut features).is_err());
    assert_eq!(find(&mut led_detector, &with_spots(&[[50.0, 40.0]])).len(), 1);
}

/// The part of `image` from (`left`, `top`) on, of this size.
fn part_of(image: &Image, [left, top]: [u32; 2], [width, height]: [u32; 2]) -> Image {
    let rows = (top..top + height).map(|row| (row * image.width + left) as usize);
    let pixels = rows.flat_map(|start| image.pixels[start..start + width as usize].iter().copied()).collect();
    Image { width, height, pixels, window: messages::Window { left, top, shrink: 1 }, ..Image::default() }
}

#[test]
fn lights_in_a_part_that_moves_lie_where_they_lie_in_the_whole_picture() {
    let image = with_spots(&[[50.3, 40.6], [70.1, 61.4], [140.0, 20.0]]);
    let masks = vec![vec![[60.0, 55.0], [80.0, 55.0], [80.0, 70.0], [60.0, 70.0]]];
    for (masks, search, n) in [(vec![], Search::Full, 2), (vec![], Search::Sampled, 2), (masks, Search::Full, 1)] {
        let settings = DetectorSettings { masks, search, grid_px: 1, ..plain() };
        let whole = find(&mut led_detector(settings.clone()), &image);
        let mut moving = LedDetector::new(settings, Some(SIZE), 0).unwrap();
        for corner in [[30, 20], [31, 25], [40, 30], [40, 30]] {
            let found = find(&mut moving, &part_of(&image, corner, [64, 48]));
            assert_eq!(found.len(), n, "{search:?} at {corner:?}");
            for centre in found {
                let nearest = whole.iter().map(|it| (it - centre).norm()).fold(f64::INFINITY, f64::min);
                assert!(nearest < 1e-9, "{centre} at {corner:?}: off by {nearest}");
            }
        }
    }
}

#[test]
fn lights_in_a_picture_made_smaller_lie_where_they_lie_in_the_whole_one() {
    let truth = Point2::new(50.3, 40.6);
    let large = render_spot(SIZE, [truth.x, truth.y], 4.0, 220.0);
    let mean = |x: usize, y: usize| {
        let sum: u32 = (0..16).map(|it| u32::from(large.pixels[(4 * y + it / 4) * 160 + 4 * x + it % 4])).sum();
        (sum / 16) as u8
    };
    let pixels = (0..30).flat_map(|y| (0..40).map(move |x| (x, y))).map(|(x, y)| mean(x, y)).collect();
    let window = messages::Window { left: 0, top: 0, shrink: 4 };
    let small = Image { width: 40, height: 30, pixels, window, ..Image::default() };
    let features = |image: &Image| {
        let mut features = Features::default();
        // It stays where it is, so that a background may be learnt.
        let mut led_detector = LedDetector::new(plain(), Some(SIZE), 0).unwrap();
        led_detector.find(image, std::iter::empty(), &mut features).unwrap();
        assert_eq!(features.list.len(), 1);
        features.list[0]
    };
    let (fine, coarse) = (features(&large), features(&small));
    assert!((coarse.centre - truth).norm() < 0.2, "{}", coarse.centre);
    assert!(coarse.covariance.trace() > 3.0 * fine.covariance.trace(), "{} {}", coarse.covariance, fine.covariance);
    assert!((f64::from(coarse.area) / f64::from(fine.area) - 1.0).abs() < 0.3, "{} {}", coarse.area, fine.area);
}

#[test]
fn a_background_is_learnt_for_one_part_and_no_part_reaches_beyond_the_picture() {
    let image = with_spots(&[[50.0, 40.0]]);
    let mut features = Features::default();
    let mut learning = LedDetector::new(DetectorSettings { learn_frames: 2, ..plain() }, Some(SIZE), 0).unwrap();
    let empty = part_of(&dark(), [30, 20], [64, 48]);
    (0..2).for_each(|_| assert!(find(&mut learning, &empty).is_empty()));
    assert_eq!(find(&mut learning, &part_of(&image, [30, 20], [64, 48])).len(), 1);
    for other in [part_of(&image, [31, 20], [64, 48]), image.clone()] {
        let refused = learning.find(&other, std::iter::empty(), &mut features).unwrap_err();
        assert!(refused.to_string().contains("set `learn_frames = 0`"), "{refused}");
    }
    assert_eq!(find(&mut learning, &part_of(&image, [30, 20], [64, 48])).len(), 1, "what was learnt stays");
    let mut plain = LedDetector::new(plain(), Some(SIZE), 0).unwrap();
    let beyond = Image { window: messages::Window { left: 97, top: 0, shrink: 1 }, ..empty };
    let refused = plain.find(&beyond, std::iter::empty(), &mut features).unwrap_err();
    assert!(refused.to_string().contains("are no part of the camera's 160 x 120 px"), "{refused}");
    assert_eq!(find(&mut plain, &image).len(), 1);
}

#[test]
fn without_a_calibration_a_lasting_change_of_size_is_believed() {
    let mut led_detector = led_detector(plain());
    let mut features = Features::default();
    let first = render_spot([80, 60], [20.0, 20.0], 1.5, 220.0);
    assert_eq!(find(&mut led_detector, &first).len(), 1);
    let results: Vec<bool> = (0..12)
        .map(|_| led_detector.find(&with_spots(&[[50.0, 40.0]]), std::iter::empty(), &mut features).is_ok())
        .collect();
    assert_eq!(results.iter().filter(|&&it| it).count(), 3, "{results:?}");
    assert!(led_detector.find(&first, std::iter::empty(), &mut features).is_err());
}

#[test]
fn predictions_that_are_no_numbers_or_far_outside_do_no_harm() {
    let settings = DetectorSettings { search: Search::Sampled, grid_px: 1, ..plain() };
    let places = [Point2::new(f64::NAN, 1.0), Point2::new(1e300, -1e300), Point2::new(-500.0, 40.0)];
    assert_eq!(find_near(&mut led_detector(settings), &with_spots(&[[50.0, 40.0]]), &places).len(), 1);
}

/// Spots that are white in their middles and coloured at their flanks, in the order of their rows.
#[test]
fn lights_get_the_labels_of_their_colours() {
    let lights = [
        ([1.0, 0.08, 0.03], [30.2, 20.4]),
        ([0.18, 1.0, 0.2], [80.7, 50.1]),
        ([1.0; 3], [60.0, 80.0]),
        ([0.6, 0.1, 1.0], [120.3, 100.2]),
    ];
    let (width, height) = (160, 120);
    let mut pixels = Vec::new();
    for row in 0..height {
        for column in 0..width {
            let light = |plane: usize| -> f64 {
                let of = |(colour, [x, y]): &([f64; 3], [f64; 2])| {
                    let square = (f64::from(column) - x).powi(2) + (f64::from(row) - y).powi(2);
                    2000.0 * colour[plane] * (-square / 2.5).exp()
                };
                lights.iter().map(of).sum()
            };
            pixels.extend([0, 1, 2].map(|plane| (light(plane) + 10.0).min(255.0) as u8));
        }
    }
    let image = Image { width, height, format: PixelFormat::Rgb8, pixels, ..Image::default() };
    let colours = [(7, 358.0), (8, 120.0), (9, 240.0)].map(|(label, hue_deg)| LightColour { label, hue_deg });
    let settings = DetectorSettings { channel: ColourPlane::Max, colours: colours.into(), ..plain() };
    let mut features = Features::default();
    led_detector(settings.clone()).find(&image, std::iter::empty(), &mut features).unwrap();
    let labels: Vec<Option<u32>> = features.list.iter().map(|it| it.label).collect();
    // White has no colour, and violet is as far from red as it is from blue, or farther than the tolerance.
    assert_eq!(labels, [Some(7), Some(8), None, None]);
    let gray = with_spots(&[[50.0, 40.0]]);
    let refused = led_detector(settings).find(&gray, std::iter::empty(), &mut features);
    assert_eq!(refused, Err(Refusal::NoColour));
}
