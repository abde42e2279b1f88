//! Dots rendered by area, with noise, light and neighbours.

use foveate_estimation::random::Random;
use nalgebra::Rotation2;

use super::*;

/// A surface of 160 gray levels that gets darker to the right, with elliptic dots that leave `paint` of the light.
struct Scene {
    dots: Vec<Point2<f64>>,
    radius: [f64; 2],
    turned: f64,
    paint: f64,
    slope: f64,
    noise: f64,
}

impl Default for Scene {
    fn default() -> Self {
        Self { dots: Vec::new(), radius: [2.0; 2], turned: 0.0, paint: 0.35, slope: 0.0, noise: 0.0 }
    }
}

const SIDE: usize = 64;

impl Scene {
    fn render(&self, random: &mut Random) -> Vec<u8> {
        let mut pixels = Vec::new();
        for i in 0..SIDE * SIDE {
            let (x, y) = ((i % SIDE) as f64, (i / SIDE) as f64);
            let mut sum = 0.0;
            for k in 0..25 {
                let place = Point2::new(x + ((k % 5) as f64 - 2.0) / 5.0, y + ((k / 5) as f64 - 2.0) / 5.0);
                let covered = self.dots.iter().any(|it| {
                    let offset = Rotation2::new(-self.turned) * (place - it);
                    (offset.x / self.radius[0]).hypot(offset.y / self.radius[1]) <= 1.0
                });
                sum += (160.0 - self.slope * place.x) * if covered { self.paint } else { 1.0 };
            }
            pixels.push((sum / 25.0 + self.noise * random.normal()).round().clamp(0.0, 255.0) as u8);
        }
        pixels
    }
}

fn found(pixels: &[u8]) -> Vec<Dot> {
    let mut dots = vec![];
    let mut finder = DotFinder::new(DotLimits::default()).unwrap();
    finder.find(&ImageView::new(pixels, SIDE, SIDE).unwrap(), &mut dots);
    dots
}

/// Finds one dot in each of 120 pictures; the root mean square error along one axis, and the mean of error² / covariance along both.
#[track_caller]
fn errors(scene: impl Fn(Point2<f64>) -> Scene) -> (f64, f64) {
    let mut random = Random::new(5);
    let (mut squares, mut ratio) = (0.0, 0.0);
    for _ in 0..120 {
        let truth = Point2::new(random.uniform_in(25.0, 40.0), random.uniform_in(25.0, 40.0));
        let dots = found(&scene(truth).render(&mut random));
        let near: Vec<&Dot> = dots.iter().filter(|it| (it.centre - truth).norm() < 4.0).collect();
        assert_eq!(near.len(), 1, "{truth}: {dots:?}");
        let error = near[0].centre - truth;
        squares += error.norm_squared();
        ratio += (near[0].covariance.try_inverse().unwrap() * error).dot(&error);
    }
    ((squares / 240.0).sqrt(), ratio / 240.0)
}

#[test]
fn a_dot_is_found_where_it_is_and_as_well_as_it_says() {
    let (rms, ratio) = errors(|it| Scene { dots: vec![it], noise: 2.0, ..Scene::default() });
    assert!(rms < 0.05, "{rms} px");
    assert!((0.3..3.0).contains(&ratio), "covariance: errors are {ratio} of what it says");
}

#[test]
fn neither_light_from_one_side_nor_a_slanted_view_nor_neighbours_pull_it_away() {
    let (rms, _) = errors(|it| Scene { dots: vec![it], slope: 1.2, noise: 1.0, ..Scene::default() });
    assert!(rms < 0.06, "slope: {rms} px");
    let (rms, _) =
        errors(|it| Scene { dots: vec![it], radius: [2.2, 1.2], turned: 0.6, noise: 1.0, ..Scene::default() });
    assert!(rms < 0.06, "ellipse: {rms} px");
    let near = |it: Point2<f64>| vec![it, it + Vector2::new(8.0, 3.0), it - Vector2::new(1.0, 9.0)];
    let (rms, _) = errors(|it| Scene { dots: near(it), noise: 1.0, ..Scene::default() });
    assert!(rms < 0.08, "neighbours: {rms} px");
}

#[test]
fn dots_of_half_to_twice_the_radius_are_found() {
    for radius in [1.1, 1.5, 2.5, 3.2] {
        let (rms, _) = errors(|it| Scene { dots: vec![it], radius: [radius; 2], noise: 1.0, ..Scene::default() });
        assert!(rms < 0.08, "{radius} px: {rms} px");
    }
}

#[test]
fn edges_lines_large_discs_and_noise_are_no_dots() {
    let mut random = Random::new(3);
    let edge: Vec<u8> = (0..SIDE * SIDE).map(|i| if i % SIDE > 30 { 160 } else { 60 }).collect();
    let line: Vec<u8> = (0..SIDE * SIDE).map(|i| if (29..32).contains(&(i % SIDE)) { 60 } else { 160 }).collect();
    let corner: Vec<u8> = (0..SIDE * SIDE).map(|i| if i % SIDE > 30 && i / SIDE > 30 { 60 } else { 160 }).collect();
    let noise: Vec<u8> = (0..SIDE * SIDE).map(|_| (160.0 + 4.0 * random.normal()) as u8).collect();
    let disc = Scene { dots: vec![Point2::new(32.0, 32.0)], radius: [9.0; 2], ..Scene::default() }.render(&mut random);
    for (name, pixels) in [("edge", edge), ("line", line), ("corner", corner), ("noise", noise), ("disc", disc)] {
        assert_eq!(found(&pixels), [], "{name}");
    }
}

#[test]
fn pictures_without_room_and_places_outside_have_no_dots() {
    let finder = DotFinder::new(DotLimits::default()).unwrap();
    let mut random = Random::new(3);
    let pixels = Scene { dots: vec![Point2::new(2.0, 30.0)], ..Scene::default() }.render(&mut random);
    let view = ImageView::new(&pixels, SIDE, SIDE).unwrap();
    for place in [[2.0, 30.0], [-5.0, 3.0], [f64::NAN, 3.0], [1e300, 9.0]] {
        assert_eq!(finder.measure(&view, Point2::from(place), 3.0), None, "{place:?}");
    }
    let mut dots = vec![];
    for (width, height) in [(0, 0), (0, 9), (3, 3), (12, 12), (64, 5)] {
        let pixels = vec![0; width * height];
        finder.clone().find(&ImageView::new(&pixels, width, height).unwrap(), &mut dots);
        assert_eq!(dots, []);
    }
    assert_eq!(found(&[0; SIDE * SIDE]), [], "black");
    assert_eq!(found(&[255; SIDE * SIDE]), [], "white");
}

#[test]
fn limits_out_of_range_are_named() {
    let named = |limits| DotFinder::new(limits).err().map(|it| it.to_string());
    let limits = DotLimits::default();
    assert_eq!(named(limits), None);
    for (name, limits) in [
        ("radius_px", DotLimits { radius_px: f64::NAN, ..limits }),
        ("min_contrast", DotLimits { min_contrast: 0.0, ..limits }),
        ("min_depth", DotLimits { min_depth: 300.0, ..limits }),
        ("max_elongation", DotLimits { max_elongation: 0.5, ..limits }),
    ] {
        assert!(named(limits).is_some_and(|it| it.contains(name)), "{name}");
    }
}

#[test]
fn the_nearest_pixel_is_that_of_round() {
    for half in 0..3000 {
        let exact = f64::from(half) / 2.0;
        for x in [exact, exact.next_up(), exact.next_down().max(0.0), exact + 0.3] {
            assert_eq!(nearest(x), x.round() as usize, "{x}");
        }
    }
}
