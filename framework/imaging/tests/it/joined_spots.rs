//! Lights that touch another light or a lit patch: parted, and where they then are. Lights by themselves: never parted.

use foveate_estimation::random::Random;
use foveate_imaging::{ImageView, Measure, Spot, SpotFinder, SpotLimits, ThresholdMap};
use nalgebra::Point2;

use crate::scene::{Look, places};

const SIZE: [usize; 2] = [320, 240];
/// 4 times the noise of 3 and an offset of 20 over the background of 20.
const THRESHOLD: u8 = 52;

fn find(pixels: &[u8], part: bool) -> Vec<Spot> {
    let mut finder = SpotFinder::new(Measure::default()).unwrap();
    let view = ImageView::new(pixels, SIZE[0], SIZE[1]).unwrap();
    let thresholds = ThresholdMap::uniform(THRESHOLD, SIZE[0], SIZE[1]);
    let mut spots = Vec::new();
    finder.find_full(&view, &thresholds, &SpotLimits { part, ..SpotLimits::default() }, &mut spots).unwrap();
    spots
}

/// How far the nearest spot is from `truth` [px].
fn off(spots: &[Spot], truth: &Point2<f64>) -> f64 {
    spots.iter().map(|it| (it.centre - truth).norm()).fold(f64::INFINITY, f64::min)
}

/// Median and 95th percentile.
fn quantiles(mut errors: Vec<f64>) -> [f64; 2] {
    errors.sort_by(f64::total_cmp);
    [errors[errors.len() / 2], errors[errors.len() * 95 / 100]]
}

#[test]
fn a_light_by_itself_is_one_spot_as_it_was() {
    let mut random = Random::new(1);
    for sigma_px in [0.7, 1.0, 1.6, 3.0] {
        for amplitude in [80.0, 200.0, 600.0] {
            for noise in [1.0, 3.0] {
                let look = Look { amplitude, sigma_px, noise, ..Look::LED };
                let centres = places(40, SIZE[0], SIZE[1], &mut random);
                let pixels = look.render(SIZE[0], SIZE[1], &centres, &mut random);
                assert_eq!(find(&pixels, true), find(&pixels, false), "{sigma_px} px, {amplitude}, noise {noise}");
            }
        }
    }
}

#[test]
fn two_lights_that_touch_are_two() {
    let mut random = Random::new(2);
    for (apart, second, at_most) in [(4.0, 1.0, 0.2), (5.0, 1.0, 0.1), (5.0, 0.5, 0.2)] {
        let (mut parted, mut errors, mut joined) = (0, Vec::new(), Vec::new());
        for _ in 0..10 {
            let firsts = places(20, SIZE[0], SIZE[1], &mut random);
            let mut brighter = firsts.clone();
            let seconds: Vec<Point2<f64>> = firsts
                .iter()
                .map(|it| {
                    let (sin, cos) = (std::f64::consts::TAU * random.uniform()).sin_cos();
                    it + apart * nalgebra::Vector2::new(cos, sin)
                })
                .collect();
            let look = Look { sigma_px: 1.2, ..Look::LED };
            brighter.extend(seconds.iter().filter(|_| second == 1.0));
            let mut pixels = look.render(SIZE[0], SIZE[1], &brighter, &mut random);
            if second < 1.0 {
                let dim = Look { amplitude: look.amplitude * second, noise: 0.0, background: 0.0, ..look };
                let dim = dim.render(SIZE[0], SIZE[1], &seconds, &mut random);
                pixels.iter_mut().zip(dim).for_each(|(pixel, more)| *pixel = pixel.saturating_add(more));
            }
            let (as_one, spots) = (find(&pixels, false), find(&pixels, true));
            for pair in firsts.iter().zip(&seconds) {
                let both = [off(&spots, pair.0), off(&spots, pair.1)];
                parted += usize::from(both.iter().all(|it| *it < 1.0));
                errors.extend(both);
                joined.extend([off(&as_one, pair.0), off(&as_one, pair.1)]);
            }
        }
        let ([median, p95], [of_one, _]) = (quantiles(errors), quantiles(joined));
        println!(
            "{apart} px, second {second}: parted {parted} of 200, {median:.2} / {p95:.2} px, as one {of_one:.2} px"
        );
        assert!(parted >= 180, "{apart} px apart, second {second}: {parted} of 200 are parted");
        assert!(median < at_most && of_one > 1.0, "{apart} px apart: {median} px off, as one {of_one} px");
    }
}

#[test]
fn a_light_at_the_side_of_a_lit_patch_is_where_it_is() {
    let mut random = Random::new(3);
    for (patch, sigma_px) in [(40.0, 1.0), (50.0, 1.0), (50.0, 1.6), (70.0, 1.2)] {
        let look = Look { sigma_px, ..Look::LED };
        let centres = places(30, SIZE[0], SIZE[1], &mut random);
        let mut pixels = look.render(SIZE[0], SIZE[1], &centres, &mut random);
        // 12 × 12 px to the lower right of each light, whose middle is just outside.
        for centre in &centres {
            let (left, top) = (centre.x.ceil() as usize, centre.y.ceil() as usize);
            for y in top..(top + 12).min(SIZE[1]) {
                for x in left..(left + 12).min(SIZE[0]) {
                    let pixel = &mut pixels[y * SIZE[0] + x];
                    *pixel = pixel.saturating_add(patch as u8);
                }
            }
        }
        let errors = |part: bool| {
            let spots = find(&pixels, part);
            quantiles(centres.iter().map(|it| off(&spots, it)).collect())
        };
        let ([median, p95], [as_one, _]) = (errors(true), errors(false));
        println!("patch {patch}, {sigma_px} px: {median:.2} / {p95:.2} px, as one {as_one:.2} px");
        assert!(median < 0.5 && p95 < 0.6, "patch of {patch}: {median} / {p95} px off");
        assert!(as_one > 0.9, "patch of {patch}: as one {as_one} px off");
    }
}

#[test]
fn a_smear_whose_bright_end_is_too_small_for_a_light_stays_one() {
    // 24 px of a smear that grows dim, one row high at its end.
    let mut pixels = vec![20_u8; SIZE[0] * SIZE[1]];
    for x in 0..24 {
        for y in 0..3 {
            pixels[(100 + y) * SIZE[0] + 100 + x] = if x < 3 && y == 1 { 250 } else { 120 - 2 * x as u8 };
        }
    }
    let limits =
        |part: bool| SpotLimits { part, min_area: 10, max_elongation: 10.0, min_fill: 0.3, ..SpotLimits::default() };
    let found = |part: bool| {
        let mut finder = SpotFinder::new(Measure::default()).unwrap();
        let view = ImageView::new(&pixels, SIZE[0], SIZE[1]).unwrap();
        let thresholds = ThresholdMap::uniform(THRESHOLD, SIZE[0], SIZE[1]);
        let mut spots = Vec::new();
        finder.find_full(&view, &thresholds, &limits(part), &mut spots).unwrap();
        spots
    };
    assert_eq!(found(false).len(), 1);
    assert_eq!(found(true), found(false));
}
