//! Spots against a plain reference, and the pictures that a careless search would stumble over.

use std::collections::BTreeSet;

use foveate_estimation::random::Random;
use foveate_imaging::{
    Centroid, Found, ImageView, ImagingError, Measure, Sampling, Spot, SpotFinder, SpotLimits, ThresholdMap, Window,
};
use nalgebra::{Point2, Vector2};
use proptest::prelude::*;

use crate::scene::{Look, places};

/// Keeps everything.
const ANY: SpotLimits = SpotLimits {
    min_area: 1,
    max_area: u32::MAX,
    max_elongation: f64::INFINITY,
    min_fill: 0.0,
    part: false,
    max_spots: usize::MAX,
    max_components: usize::MAX,
};
const ALL_ROWS: Sampling = Sampling { every_rows: 1, first_row: 0 };

/// A picture and its thresholds.
#[derive(Debug, Clone)]
struct Case {
    width: usize,
    pixels: Vec<u8>,
    thresholds: Vec<u8>,
}

impl Case {
    fn even(width: usize, pixels: Vec<u8>, threshold: u8) -> Case {
        Case { width, thresholds: vec![threshold; pixels.len()], pixels }
    }

    fn height(&self) -> usize {
        self.pixels.len() / self.width
    }

    #[track_caller]
    fn find(&self, limits: &SpotLimits, sampling: Sampling, windows: &[Window]) -> (Vec<Spot>, Found) {
        let mut finder = SpotFinder::new(Measure::default()).unwrap();
        let view = ImageView::new(&self.pixels, self.width, self.height()).unwrap();
        let map = ThresholdMap::new(self.thresholds.clone(), self.width, self.height()).unwrap();
        // A second search with the same buffers has to say the same.
        let (mut first, mut second) = (Vec::new(), Vec::new());
        let found = finder.find_sampled(&view, &map, sampling, windows, limits, &mut first).unwrap();
        let again = finder.find_sampled(&view, &map, sampling, windows, limits, &mut second).unwrap();
        assert_eq!((&first, found), (&second, again));
        (first, found)
    }

    fn all(&self) -> Vec<Spot> {
        self.find(&ANY, ALL_ROWS, &[]).0
    }

    fn lit(&self, x: usize, y: usize) -> bool {
        self.pixels[y * self.width + x] > self.thresholds[y * self.width + x]
    }

    /// Pixels (row, column) within one step of (x, y), itself included.
    fn near(&self, x: usize, y: usize) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (width, height) = (self.width, self.height());
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        rows.flat_map(move |y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| (y, x)))
    }

    /// Connected lit pixels, one step at a time, in scan order.
    fn groups(&self) -> Vec<BTreeSet<(usize, usize)>> {
        let mut groups: Vec<BTreeSet<(usize, usize)>> = Vec::new();
        for y in 0..self.height() {
            for x in 0..self.width {
                if self.lit(x, y) && groups.iter().all(|it| !it.contains(&(y, x))) {
                    let (mut group, mut open) = (BTreeSet::new(), vec![(y, x)]);
                    while let Some((y, x)) = open.pop() {
                        if self.lit(x, y) && group.insert((y, x)) {
                            open.extend(self.near(x, y));
                        }
                    }
                    groups.push(group);
                }
            }
        }
        groups
    }

    /// The weighted mean over a group and its neighbours, straight from its definition.
    fn centre(&self, group: &BTreeSet<(usize, usize)>) -> Point2<f64> {
        let region: BTreeSet<_> = group.iter().flat_map(|&(y, x)| self.near(x, y)).collect();
        let (mut sum, mut moment) = (0.0, Vector2::zeros());
        for (y, x) in region {
            let (pixel, threshold) = (self.pixels[y * self.width + x], self.thresholds[y * self.width + x]);
            let start = f64::from(threshold) - f64::from(Measure::default().foot);
            if threshold < 255 {
                let weight = (f64::from(pixel) - start.max(0.0)).max(0.0);
                sum += weight;
                moment += weight * Vector2::new(x as f64, y as f64);
            }
        }
        Point2::from(moment / sum)
    }

    #[track_caller]
    fn assert_found(&self, spots: &[Spot], groups: &[BTreeSet<(usize, usize)>]) {
        assert_eq!(spots.len(), groups.len());
        for (spot, group) in spots.iter().zip(groups) {
            let (xs, ys) = (group.iter().map(|it| it.1 as u32), group.iter().map(|it| it.0 as u32));
            let bounds = [xs.clone().min(), ys.clone().min(), xs.max(), ys.max()].map(Option::unwrap);
            assert_eq!((spot.area as usize, spot.bounds), (group.len(), bounds));
            assert_eq!(Some(spot.peak), group.iter().map(|&(y, x)| self.pixels[y * self.width + x]).max());
            assert!((spot.centre - self.centre(group)).norm() < 1e-9, "{} {}", spot.centre, self.centre(group));
            let edge = |&(y, x): &(usize, usize)| x == 0 || y == 0 || x + 1 == self.width || y + 1 == self.height();
            assert_eq!(spot.touches_border, group.iter().any(edge));
            assert!(spot.covariance.cholesky().is_some(), "{}", spot.covariance);
            assert!(spot.elongation >= 1.0 && spot.fill() > 0.0 && spot.fill() <= 1.0);
        }
    }
}

/// Pictures up to several tiles wide, with cut tiles, few to many lit pixels, and thresholds of 0 and 255.
fn case() -> impl Strategy<Value = Case> {
    let size = prop_oneof![(1usize..150, 1usize..20), (1usize..200, Just(1)), (Just(1), 1usize..100)];
    (size, 1u32..60, any::<u64>()).prop_map(|((width, height), percent, seed)| {
        let mut random = Random::new(seed);
        let pixels = (0..width * height)
            .map(|_| if random.below(100) < percent { random.below(256) as u8 } else { random.below(40) as u8 })
            .collect();
        let thresholds =
            (0..width * height).map(|_| [30, 40, 60, 200, 255, 0][(random.below(60) / 10) as usize]).collect();
        Case { width, pixels, thresholds }
    })
}

proptest! {
    #[test]
    fn all_groups_of_lit_pixels_are_found_once_and_in_order(case in case()) {
        let (spots, found) = case.find(&ANY, ALL_ROWS, &[]);
        case.assert_found(&spots, &case.groups());
        let n_lit: usize = case.groups().iter().map(BTreeSet::len).sum();
        let usable = case.thresholds.iter().filter(|&&it| it < 255).count();
        let expected = Found { examined: usable as u64, lit: n_lit as u64, refused: 0, truncated: false };
        prop_assert_eq!(found, expected);
    }

    #[test]
    fn sampling_finds_what_meets_a_row_or_a_window(
        case in case(), every_rows in 1usize..8, first_row in 0usize..9,
        corners in prop::collection::vec((-30i32..160, -30i32..40, 0u32..60, 0u32..30), 0..4),
    ) {
        let windows: Vec<_> = corners.iter().map(|&(x, y, width, height)| Window { x, y, width, height }).collect();
        let (spots, found) = case.find(&ANY, Sampling { every_rows, first_row }, &windows);
        let sampled = |y: usize| y % every_rows == first_row % every_rows;
        let met = |&(y, x): &(usize, usize)| {
            let (x, y) = (x as i64, y as i64);
            let inside = |it: &Window| {
                (i64::from(it.x)..i64::from(it.x) + i64::from(it.width)).contains(&x)
                    && (i64::from(it.y)..i64::from(it.y) + i64::from(it.height)).contains(&y)
            };
            sampled(y as usize) || windows.iter().any(inside)
        };
        let mut groups = case.groups();
        let n_lit = groups.iter().flatten().filter(|it| sampled(it.0)).count();
        prop_assert_eq!(found.lit, n_lit as u64);
        groups.retain(|it| it.iter().any(met));
        case.assert_found(&spots, &groups);
    }

    #[test]
    fn any_window_is_safe(x in any::<i32>(), y in any::<i32>(), width in any::<u32>(), height in any::<u32>()) {
        let case = Case::even(70, vec![0; 70 * 9], 10);
        case.find(&ANY, Sampling { every_rows: usize::MAX, first_row: usize::MAX }, &[Window { x, y, width, height }]);
    }
}

/// A picture with one spot of `look` at `centre`.
fn one_spot(look: Look, size: (usize, usize), centre: Point2<f64>, seed: u64) -> Case {
    Case::even(size.0, look.render(size.0, size.1, &[centre], &mut Random::new(seed)), 57)
}

/// Mean squared error in units of the covariance, over 2,000 seeded spots at places drawn from `x` and `y`.
fn nees(how: Measure, look: Look, size: (usize, usize), x: (f64, f64), y: (f64, f64)) -> f64 {
    let (mut random, mut sum, mut n) = (Random::new(7), 0.0, 0.0);
    let mut finder = SpotFinder::new(how).unwrap();
    let (map, mut spots) = (ThresholdMap::uniform(57, size.0, size.1), Vec::new());
    for _ in 0..2000 {
        let centre = Point2::new(random.uniform_in(x.0, x.1), random.uniform_in(y.0, y.1));
        let pixels = look.render(size.0, size.1, &[centre], &mut random);
        let view = ImageView::new(&pixels, size.0, size.1).unwrap();
        finder.find_full(&view, &map, &SpotLimits::default(), &mut spots).unwrap();
        if let [spot] = &spots[..] {
            let error = spot.centre - centre;
            sum += (error.transpose() * spot.covariance.try_inverse().unwrap() * error).x;
            n += 1.0;
        }
    }
    assert!(n > 1500.0, "{n} of 2000 found");
    sum / n
}

#[test]
fn covariance_has_the_right_size() {
    let inside = (10.0, 22.0);
    for (centroid, noise) in [(Centroid::Weighted, 3.0), (Centroid::Weighted, 6.0), (Centroid::Integer, 3.0)] {
        let how = Measure { centroid, foot: 25, pixel_sigma: noise, ..Default::default() };
        let nees = nees(how, Look { noise, ..Look::LED }, (32, 32), inside, inside);
        assert!((1.4..2.6).contains(&nees), "{centroid:?}, noise {noise}: {nees}");
    }
}

#[test]
fn covariance_of_a_spot_cut_by_the_border_allows_for_the_missing_part() {
    let how = Measure { foot: 25, ..Default::default() };
    let nees = nees(how, Look::LED, (32, 32), (-1.0, 4.0), (10.0, 22.0));
    assert!((0.05..2.0).contains(&nees), "{nees}");
    let spot = &one_spot(Look::LED, (32, 32), Point2::new(0.5, 16.0), 3).all()[0];
    assert!(spot.touches_border && spot.covariance[(0, 0)] > 1.0 && spot.covariance[(1, 1)] < 0.01);
}

#[test]
fn weighted_centres_beat_the_peer_and_integer_ones_are_whole() {
    let mut random = Random::new(5);
    let (mut error, size) = (0.0, (320, 240));
    for _ in 0..40 {
        let centres = places(8, size.0, size.1, &mut random);
        let case = Case::even(size.0, Look::LED.render(size.0, size.1, &centres, &mut random), 57);
        let mut finder = SpotFinder::new(Measure { foot: 25, ..Default::default() }).unwrap();
        let view = ImageView::new(&case.pixels, size.0, size.1).unwrap();
        let (map, mut spots) = (ThresholdMap::uniform(57, size.0, size.1), Vec::new());
        finder.find_full(&view, &map, &SpotLimits::default(), &mut spots).unwrap();
        assert_eq!(spots.len(), 8);
        let nearest = |it: &Point2<f64>| spots.iter().map(|s| (s.centre - it).norm()).fold(f64::INFINITY, f64::min);
        error += centres.iter().map(nearest).sum::<f64>() / 320.0;
    }
    // 0.034 px: weights above the background, lit pixels only. 0.020: with their neighbours.
    assert!(error < 0.024, "{error}");

    let mut finder = SpotFinder::new(Measure { centroid: Centroid::Integer, ..Default::default() }).unwrap();
    let case = one_spot(Look::LED, (40, 40), Point2::new(20.3, 14.8), 1);
    let mut spots = Vec::new();
    let map = ThresholdMap::uniform(57, 40, 40);
    finder.find_full(&ImageView::new(&case.pixels, 40, 40).unwrap(), &map, &ANY, &mut spots).unwrap();
    assert_eq!(spots[0].centre, Point2::new(20.0, 15.0));
}

#[test]
fn a_saturated_plateau_has_its_centre_in_the_middle() {
    let look = Look { amplitude: 5000.0, sigma_px: 3.0, noise: 0.0, ..Look::LED };
    let spots = one_spot(look, (64, 64), Point2::new(31.4, 30.7), 1).all();
    assert_eq!((spots.len(), spots[0].peak), (1, 255));
    assert!((spots[0].centre - Point2::new(31.4, 30.7)).norm() < 0.03, "{}", spots[0].centre);
    // Nothing but plateau, so that no pixel has noise: still a covariance that can be inverted.
    let case = Case::even(
        9,
        (0..81).map(|i| if (3..6).contains(&(i % 9)) && (27..54).contains(&i) { 255 } else { 0 }).collect(),
        57,
    );
    let spot = &case.all()[0];
    assert_eq!(spot.centre, Point2::new(4.0, 4.0));
    assert!(spot.covariance.try_inverse().is_some());
}

#[test]
fn an_all_white_picture_is_one_group_and_too_large() {
    let case = Case::even(640, vec![255; 640 * 480], 60);
    let (spots, found) = case.find(&SpotLimits::default(), ALL_ROWS, &[]);
    assert!(spots.is_empty());
    assert_eq!(found, Found { examined: 640 * 480, lit: 640 * 480, refused: 1, truncated: false });
    assert_eq!(found.lit_fraction(), 1.0);
    assert_eq!(case.all()[0].centre, Point2::new(319.5, 239.5));
}

#[test]
fn thousands_of_single_pixels_are_cut_off_and_counted() {
    let pixels: Vec<u8> =
        (0..640 * 480).map(|i| if (i % 640) % 2 == 0 && (i / 640) % 2 == 0 { 200 } else { 0 }).collect();
    let case = Case::even(640, pixels, 60);
    let (spots, found) = case.find(&SpotLimits::default(), ALL_ROWS, &[]);
    assert!(spots.is_empty());
    assert_eq!(found, Found { examined: 640 * 480, lit: 320 * 240, refused: 4096, truncated: true });
    let limits = SpotLimits { min_area: 1, max_spots: 10, ..Default::default() };
    let window = Window { x: 600, y: 400, width: 4, height: 4 };
    let (spots, found) = case.find(&limits, ALL_ROWS, &[window]);
    assert!(found.truncated && found.lit == 320 * 240);
    assert_eq!(spots.len(), 10);
    assert_eq!(
        spots[6].centre,
        Point2::new(600.0, 400.0),
        "windows are served first, the order stays that of the scan"
    );
    let exact = SpotLimits { max_spots: 320 * 240, max_components: 320 * 240, min_area: 1, ..Default::default() };
    assert!(!case.find(&exact, ALL_ROWS, &[]).1.truncated);
}

#[test]
fn limits_refuse_what_has_not_the_shape_of_a_spot() {
    let draw = |lit: &dyn Fn(usize, usize) -> bool| {
        Case::even(40, (0..40 * 40).map(|i| if lit(i % 40, i / 40) { 200 } else { 0 }).collect(), 57)
    };
    let kept = |case: &Case, limits: SpotLimits| case.find(&limits, ALL_ROWS, &[]).0.len();
    let disc = draw(&|x, y| (x as i64 - 20).pow(2) + (y as i64 - 20).pow(2) < 40);
    let line = draw(&|x, y| y == 20 && (5..25).contains(&x));
    let slope = draw(&|x, y| (5..25).contains(&x) && x == y);
    let ring = draw(&|x, y| (200..260).contains(&((x as i64 - 20).pow(2) + (y as i64 - 20).pow(2))));
    let point = draw(&|x, y| (x, y) == (9, 9));
    let default = SpotLimits::default();
    assert_eq!([&disc, &line, &slope, &ring, &point].map(|it| kept(it, default.clone())), [1, 0, 0, 0, 0]);
    assert_eq!(kept(&line, SpotLimits { max_elongation: 20.1, ..ANY }), 1);
    assert_eq!(kept(&line, SpotLimits { max_elongation: 19.9, ..ANY }), 0);
    assert!((line.all()[0].elongation - 20.0).abs() < 1e-9, "a line of 20 px by 1 px");
    assert!((disc.all()[0].elongation - 1.0).abs() < 1e-9);
    assert_eq!(kept(&ring, SpotLimits { min_fill: 0.3, ..ANY }), 0);
    assert_eq!(kept(&ring, ANY), 1);
    assert_eq!(kept(&point, ANY), 1);
    assert_eq!(kept(&disc, SpotLimits { max_area: disc.all()[0].area - 1, ..ANY }), 0);
}

#[test]
fn wrong_sizes_and_settings_are_refused_and_leave_no_spots() {
    let mut finder = SpotFinder::new(Measure::default()).unwrap();
    let mut spots = one_spot(Look::LED, (40, 40), Point2::new(20.0, 20.0), 1).all();
    let view = ImageView::new(&[0; 12], 4, 3).unwrap();
    let refused = finder.find_full(&view, &ThresholdMap::uniform(9, 3, 4), &ANY, &mut spots);
    assert_eq!(refused, Err(ImagingError::WrongSize { what: "threshold table", expected: (4, 3), found: (3, 4) }));
    assert!(spots.is_empty());
    let limits = SpotLimits { min_area: 0, ..ANY };
    assert!(finder.find_full(&view, &ThresholdMap::uniform(9, 4, 3), &limits, &mut spots).is_err());
    assert!(SpotFinder::new(Measure { floor_px: f64::NAN, ..Default::default() }).is_err());
    for (width, height) in [(0, 0), (0, 5), (5, 0)] {
        let map = ThresholdMap::uniform(9, width, height);
        let window = Window { x: 0, y: 0, width: 40, height: 40 };
        let view = ImageView::new(&[], width, height).unwrap();
        let found = finder.find_sampled(&view, &map, ALL_ROWS, &[window], &ANY, &mut spots).unwrap();
        assert_eq!((found.lit_fraction(), spots.len()), (0.0, 0));
    }
}

#[test]
fn one_finder_serves_pictures_of_changing_size() {
    let mut finder = SpotFinder::new(Measure::default()).unwrap();
    let mut spots = Vec::new();
    for (k, size) in [(64, 64), (200, 30), (64, 64), (30, 200), (3, 3), (640, 480)].into_iter().enumerate() {
        let centre = Point2::new(size.0 as f64 / 2.0, size.1 as f64 / 2.0);
        let case = one_spot(Look::LED, size, centre, k as u64);
        let view = ImageView::new(&case.pixels, size.0, size.1).unwrap();
        let map = ThresholdMap::uniform(57, size.0, size.1);
        finder.find_full(&view, &map, &ANY, &mut spots).unwrap();
        assert_eq!(spots, case.all());
    }
}

#[test]
fn a_window_sees_a_dim_spot_below_and_beside_bright_surroundings() {
    // High thresholds but for one tile, so that what is known of its neighbours must not stand for it.
    let (width, height) = (200, 40);
    let dim = |x: usize, y: usize| (64..128).contains(&x) && (16..24).contains(&y);
    let spot = |x: usize, y: usize| (66..69).contains(&x) && (18..21).contains(&y);
    let of = |f: &dyn Fn(usize, usize) -> u8| (0..width * height).map(|i| f(i % width, i / width)).collect();
    let thresholds = of(&|x, y| if dim(x, y) { 40 } else { 200 });
    let case = Case { width, pixels: of(&|x, y| if spot(x, y) { 90 } else { 20 }), thresholds };
    let no_rows = Sampling { every_rows: usize::MAX, first_row: 1 };
    for window in [
        Window { x: 47, y: 2, width: 40, height: 36 },
        Window { x: 60, y: 19, width: 7, height: 1 },
        Window { x: 66, y: 17, width: 90, height: 2 },
    ] {
        assert_eq!(case.find(&ANY, no_rows, &[window]).0.len(), 1, "{window:?}");
    }
}

#[test]
fn a_small_spot_that_stands_still_is_found_within_grid_frames() {
    for y in 0..20 {
        let mut pixels = vec![0; 64 * 20];
        pixels[y * 64 + 33] = 200;
        let case = Case::even(64, pixels, 57);
        for start in [0, 3, 1_000_000] {
            let found = (start..start + 5).filter(|&k| !case.find(&ANY, Sampling::of_frame(k, 5), &[]).0.is_empty());
            assert_eq!(found.count(), 1);
        }
    }
}
