//! Segmentation against what was drawn.

use super::*;
use crate::Verdict;

const SIZE: (usize, usize) = (160, 120);

struct Noise(u64);

impl Noise {
    /// Uniform, standard deviation 1.
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 40) as f32 / (1u64 << 24) as f32 - 0.5) * 12f32.sqrt()
    }
}

/// A wall with a coarse texture, bluish on the left, reddish on the right.
fn wall(x: usize, y: usize) -> [f32; 3] {
    let texture = 1.0 + 0.5 * ((x / 7 * 31 + y / 9 * 17) % 5) as f32 / 5.0;
    let t = x as f32 / SIZE.0 as f32;
    [90.0 + 50.0 * t, 110.0, 140.0 - 60.0 * t].map(|it| it * texture)
}

fn picture(noise: &mut Noise, of: impl Fn(usize, usize, [f32; 3]) -> [f32; 3]) -> Vec<u8> {
    let pixels = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y)));
    pixels
        .flat_map(|(x, y)| of(x, y, wall(x, y)).map(|it| (it + 2.0 * noise.next()).round().clamp(0.0, 255.0) as u8))
        .collect()
}

fn learnt(config: SegmenterConfig, noise: &mut Noise) -> Segmenter {
    let mut segmenter = Segmenter::new(config, SIZE.0, SIZE.1).unwrap();
    for _ in 0..12 {
        assert_eq!(segmenter.update(&picture(noise, |_, _, it| it)), Ok(Verdict::Learning));
    }
    segmenter
}

fn config() -> SegmenterConfig {
    SegmenterConfig { learn_frames: 12, ..SegmenterConfig::default() }
}

fn is_body(x: usize, y: usize) -> bool {
    (60..90).contains(&x) && (20..110).contains(&y)
}

/// Intersection over union with what was drawn.
fn overlap(segmenter: &Segmenter) -> f64 {
    let (mut both, mut any) = (0, 0);
    for (i, it) in segmenter.confidence().iter().enumerate() {
        let truth = is_body(i % SIZE.0, i / SIZE.0);
        both += u32::from(truth && *it >= BODY);
        any += u32::from(truth || *it >= BODY);
    }
    f64::from(both) / f64::from(any.max(1))
}

fn n_body(segmenter: &Segmenter) -> usize {
    segmenter.confidence().iter().filter(|it| **it >= BODY).count()
}

/// A green shirt in any light.
fn shirt(light: f32) -> [f32; 3] {
    [40.0, 120.0, 60.0].map(|it| it * light)
}

#[test]
fn a_body_is_found_and_its_shadow_and_a_highlight_are_not() {
    [false, true].into_iter().for_each(|by_texture| find_without_shadow(&SegmenterConfig { by_texture, ..config() }));
}

fn find_without_shadow(config: &SegmenterConfig) {
    let noise = &mut Noise(1);
    let mut segmenter = learnt(config.clone(), noise);
    let shadowed = picture(noise, |x, y, wall| match (x, y) {
        _ if is_body(x, y) => shirt(1.0),
        (90..130, 70..110) => wall.map(|it| it * 0.6),
        (10..40, 10..60) => wall.map(|it| it * 1.3),
        _ => wall,
    });
    assert_eq!(segmenter.update(&shadowed), Ok(Verdict::Trusted));
    assert!(overlap(&segmenter) > 0.97, "{}", overlap(&segmenter));
    // The same without the body: nothing at all.
    let empty =
        picture(noise, |x, y, wall| if (90..130).contains(&x) && y > 70 { wall.map(|it| it * 0.6) } else { wall });
    segmenter.update(&empty).unwrap();
    assert!(n_body(&segmenter) < 8, "{}", n_body(&segmenter));
    // And where neither may be: both.
    let strict = SegmenterConfig { shadow_ratio: 1.0, highlight_ratio: 1.0, ..config.clone() };
    let mut segmenter = learnt(strict, noise);
    segmenter.update(&shadowed).unwrap();
    assert!(n_body(&segmenter) > 2700 + 1500 + 1400, "{}", n_body(&segmenter));
}

#[test]
fn clothes_as_dark_as_a_shadow_are_body_where_their_texture_is_not_that_of_the_floor() {
    let noise = &mut Noise(11);
    let by_texture = SegmenterConfig { by_texture: true, ..config() };
    // Gray cloth before a gray floor with a grain, striped cloth before a plain one: the light of each pixel is what a shadow would leave.
    fn grain(x: usize, y: usize) -> f32 {
        if (x / 3 + y / 3).is_multiple_of(2) { 1.0 } else { 1.25 }
    }
    type Seen = dyn Fn(usize, usize) -> [f32; 3];
    let cases: [(&Seen, &Seen); 2] = [
        (&|x, y| [100.0 * grain(x, y); 3], &|_, _| [80.0; 3]),
        (&|_, _| [110.0; 3], &|x, _| [if x / 3 % 2 == 0 { 70.0 } else { 95.0 }; 3]),
    ];
    for (at, (floor, cloth)) in cases.into_iter().enumerate() {
        let mut found = [&by_texture, &config()].map(|config| {
            let mut segmenter = Segmenter::new(config.clone(), SIZE.0, SIZE.1).unwrap();
            for _ in 0..12 {
                segmenter.teach(&picture(noise, |x, y, _| floor(x, y))).unwrap();
            }
            let seen = picture(noise, |x, y, _| match (x, y) {
                _ if is_body(x, y) => cloth(x, y),
                (90..130, 70..110) => floor(x, y).map(|it| it * 0.7),
                _ => floor(x, y),
            });
            segmenter.update(&seen).unwrap();
            overlap(&segmenter)
        });
        found.reverse();
        let [by_pixels, by_texture] = found;
        assert!(by_texture > 0.9, "{at}: {by_texture}, by pixels {by_pixels}");
        assert!(by_pixels < 0.7, "{at}: {by_pixels}");
    }
}

#[test]
fn a_lamp_that_flickers_while_learning_is_no_noise() {
    let noise = &mut Noise(13);
    let limits_and_spread = |flicker: f32, noise: &mut Noise| {
        let mut segmenter = Segmenter::new(config(), SIZE.0, SIZE.1).unwrap();
        for k in 0..12 {
            let light = 1.0 + flicker * ((k * 5 % 12) as f32 / 5.5 - 1.0);
            segmenter.teach(&picture(noise, |_, _, wall| wall.map(|it| it * light))).unwrap();
        }
        // Cloth a little darker than a shadow may be, in each light.
        let mut shares = Vec::new();
        for light in [0.9, 1.1] {
            let mut segmenter = segmenter.clone();
            let seen = picture(noise, |x, y, wall| wall.map(|it| it * light * if is_body(x, y) { 0.4 } else { 1.0 }));
            segmenter.update(&seen).unwrap();
            shares.push(overlap(&segmenter));
        }
        (segmenter.limits(), shares)
    };
    let (steady, _) = limits_and_spread(0.0, noise);
    let (flickering, shares) = limits_and_spread(0.1, noise);
    assert!(flickering[1] < 1.3 * steady[1], "{flickering:?} {steady:?}");
    assert!(shares.iter().all(|it| *it > 0.95), "{shares:?}");
}

#[test]
fn limits_come_from_the_pictures_and_not_from_who_passes() {
    let noise = &mut Noise(2);
    let segmenter = learnt(config(), noise);
    let [chroma, bright] = segmenter.limits();
    let mut passed = Segmenter::new(config(), SIZE.0, SIZE.1).unwrap();
    for k in 0..12 {
        let walker = picture(noise, |x, y, wall| if x / 13 == k && y > 40 { shirt(1.0) } else { wall });
        passed.teach(&walker).unwrap();
    }
    let [a, b] = passed.limits();
    let kept = |it: f32| (0.75..2.1).contains(&it);
    assert!(kept(a / chroma) && kept(b / bright), "{a} {b}, alone {chroma} {bright}");
    let mut test = passed.clone();
    test.update(&picture(noise, |_, _, it| it)).unwrap();
    assert!(n_body(&test) < 8, "{}", n_body(&test));
}

#[test]
fn other_light_is_no_body() {
    let noise = &mut Noise(3);
    let segmenter = learnt(config(), noise);
    // The whole gets redder and darker, then much brighter, then the lamp of the right half goes out, which is darker than a shadow may be.
    let lights: [&dyn Fn(usize) -> [f32; 3]; 3] =
        [&|_| [0.7, 0.55, 0.5], &|_| [1.6; 3], &|x| if x > 100 { [0.43, 0.42, 0.41] } else { [1.0; 3] }];
    for (at, light) in lights.iter().enumerate() {
        let mut segmenter = segmenter.clone();
        let lit = picture(noise, |x, y, wall| {
            let (colour, light) = (if is_body(x, y) { shirt(1.0) } else { wall }, light(x));
            std::array::from_fn(|c| colour[c] * light[c])
        });
        assert_eq!(segmenter.update(&lit), Ok(Verdict::Trusted), "light {at}");
        assert!(overlap(&segmenter) > 0.9, "light {at}: {}", overlap(&segmenter));
    }
}

#[test]
fn a_body_as_bright_as_its_background_is_no_light_of_another_colour() {
    let noise = &mut Noise(12);
    let segmenter = learnt(config(), noise);
    // Each pixel of it has the brightness of what it hides, in another colour; it covers a seventh, and two fifths, of the picture.
    for width in [30, 90] {
        let is_body = |x: usize, y: usize| (40..40 + width).contains(&x) && (20..110).contains(&y);
        let mut segmenter = segmenter.clone();
        let seen = picture(noise, |x, y, wall| {
            let brightness = wall.iter().sum::<f32>();
            if is_body(x, y) { [0.15, 0.6, 0.25].map(|it| it * brightness) } else { wall }
        });
        segmenter.update(&seen).unwrap();
        let n = n_body(&segmenter);
        assert!((90 * width - 12..=90 * width + 12).contains(&n), "{n} of {}", 90 * width);
    }
}

#[test]
fn what_brightens_a_part_of_a_tile_is_no_lamp() {
    let noise = &mut Noise(9);
    // A floor of dark and light squares, and before it a limb that is lighter than both by as much: its tile looks as the floor does.
    let floor = |x: usize, y: usize| if (x / 8 + y / 8).is_multiple_of(2) { 0.4 } else { 1.4 };
    let mut segmenter = Segmenter::new(SegmenterConfig { highlight_ratio: 1.1, ..config() }, SIZE.0, SIZE.1).unwrap();
    for _ in 0..12 {
        segmenter.update(&picture(noise, |x, y, wall| wall.map(|it| 0.7 * it * floor(x, y)))).unwrap();
    }
    let limb =
        picture(noise, |x, y, wall| wall.map(|it| 0.7 * it * floor(x, y) * if is_body(x, y) { 1.35 } else { 1.0 }));
    assert_eq!(segmenter.update(&limb), Ok(Verdict::Trusted));
    assert_eq!(segmenter.n_regional(), 0);
    assert!(overlap(&segmenter) > 0.9, "{}", overlap(&segmenter));
}

#[test]
fn somebody_who_stands_still_stays_and_a_slow_change_of_light_is_followed() {
    let noise = &mut Noise(4);
    let mut segmenter = learnt(SegmenterConfig { adapt_frames: 40.0, ..config() }, noise);
    for k in 0..150 {
        // One wall slowly turns warmer: not all of the picture, so that no gain explains it.
        let turn = 1.0 + 0.1 * k as f32 / 150.0;
        let warmer = picture(noise, |x, y, wall| match x {
            _ if is_body(x, y) => shirt(1.0),
            0..40 => [wall[0] * turn, wall[1], wall[2]],
            _ => wall,
        });
        segmenter.update(&warmer).unwrap();
    }
    assert!(overlap(&segmenter) > 0.95, "{}", overlap(&segmenter));
}

#[test]
fn what_stands_is_absorbed_on_demand_but_not_where_somebody_is_held() {
    let noise = &mut Noise(5);
    let absorbing = SegmenterConfig { absorb_frames: 48, ..config() };
    for (held, expected) in [(false, 0..8), (true, 2500..2800)] {
        let mut segmenter = learnt(absorbing.clone(), noise);
        for _ in 0..100 {
            segmenter.hold(held.then_some([50, 10, 100, 119]));
            let standing = picture(noise, |x, y, wall| if is_body(x, y) { shirt(1.0) } else { wall });
            segmenter.update(&standing).unwrap();
        }
        assert!(expected.contains(&n_body(&segmenter)), "held: {held}, {} px", n_body(&segmenter));
    }
}

#[test]
fn a_camera_that_was_moved_has_all_its_edges_elsewhere() {
    let noise = &mut Noise(6);
    let mut segmenter = learnt(config(), noise);
    let body = picture(noise, |x, y, wall| if is_body(x, y) { shirt(1.0) } else { wall });
    segmenter.update(&body).unwrap();
    assert!(segmenter.edges_off() < 0.3, "{}", segmenter.edges_off());
    let moved = picture(noise, |x, y, _| wall(x + 3, y + 4));
    segmenter.update(&moved).unwrap();
    assert!(segmenter.edges_off() > 0.3, "{}", segmenter.edges_off());
    let trembles = picture(noise, |x, y, wall_here| {
        let beside = wall(x + 1, y);
        std::array::from_fn(|c| 0.8 * wall_here[c] + 0.2 * beside[c])
    });
    segmenter.update(&trembles).unwrap();
    assert!(n_body(&segmenter) < 20, "{}", n_body(&segmenter));
}

#[test]
fn one_picture_of_the_empty_scene_is_enough_to_begin() {
    let noise = &mut Noise(7);
    let mut segmenter = Segmenter::new(config(), SIZE.0, SIZE.1).unwrap();
    segmenter.set_background(&picture(noise, |_, _, it| it)).unwrap();
    assert!(segmenter.has_learnt());
    segmenter.update(&picture(noise, |x, y, wall| if is_body(x, y) { shirt(0.5) } else { wall })).unwrap();
    assert!(overlap(&segmenter) > 0.95, "{}", overlap(&segmenter));
}

#[test]
fn black_and_saturated_pixels_are_no_body_of_themselves() {
    let noise = &mut Noise(8);
    let scene = |x: usize, _: usize, wall: [f32; 3]| match x {
        0..30 => [3.0, 1.0, 2.0],
        30..55 => [400.0, 380.0, 390.0],
        _ => wall,
    };
    let mut segmenter = Segmenter::new(config(), SIZE.0, SIZE.1).unwrap();
    for _ in 0..12 {
        segmenter.update(&picture(noise, scene)).unwrap();
    }
    let dimmer = picture(noise, |x, y, wall| scene(x, y, wall).map(|it| it * 0.9));
    segmenter.update(&dimmer).unwrap();
    assert!(n_body(&segmenter) < 8, "{}", n_body(&segmenter));
    // Something that is neither black nor white is one, before both.
    let before = picture(noise, |x, y, wall| if is_body(x + 40, y) { shirt(1.0) } else { scene(x, y, wall) });
    segmenter.update(&before).unwrap();
    assert!((2600..2800).contains(&n_body(&segmenter)), "{}", n_body(&segmenter));
}

#[test]
fn a_flooded_picture_is_no_silhouette_and_after_a_while_the_background_is_learnt_again() {
    let noise = &mut Noise(9);
    let mut segmenter = learnt(config(), noise);
    let other = |noise: &mut Noise| picture(noise, |x, y, _| wall(x * 3 % 101, y * 5 % 97).map(|it| 255.0 - it));
    for _ in 0..12 {
        assert_eq!(segmenter.update(&other(noise)), Ok(Verdict::Flooded));
    }
    for _ in 0..12 {
        assert_eq!(segmenter.update(&other(noise)), Ok(Verdict::Learning));
    }
    assert_eq!(segmenter.update(&other(noise)), Ok(Verdict::Trusted));
    assert!(n_body(&segmenter) < 8);
    assert!(segmenter.update(&[0; 5]).is_err() && segmenter.set_mask(&[true]).is_err());
}

#[test]
fn settings_out_of_range_are_named() {
    let named = |change: fn(&mut SegmenterConfig)| {
        let mut config = config();
        change(&mut config);
        Segmenter::new(config, 4, 4).err().map(|it| it.to_string())
    };
    assert_eq!(named(|_| ()), None);
    assert_eq!(named(|it| it.detection_rate = 1.0).unwrap(), "detection_rate is 1; expected 0.5 to 0.999999");
    assert!(named(|it| it.noise_floor = f32::NAN).unwrap().starts_with("noise_floor"));
    assert!(named(|it| it.highlight_ratio = 0.9).unwrap().starts_with("highlight_ratio"));
}

/// Which part of the body is found on a floor with a fine grain, and how many pixels are body where no person is; `off_px` is how far edges of the background lie beside where they were in each picture, and in the last one.
fn on_other_views(grain: f32, off_px: f32, is_rehearsed: bool) -> (f64, usize) {
    let noise = &mut Noise(29);
    let config = SegmenterConfig { by_texture: true, jitter_px: 0.1, ..config() };
    let floor = |x: f32, y: f32, off: f32| {
        let edge = |at: f32| (at - off + 0.5).clamp(0.0, 1.0);
        let frame = 60.0 * (edge(x - 10.0) - edge(x - 40.0)) * (edge(y - 20.0) - edge(y - 80.0));
        [100.0 + grain * (1.3 * x).sin() * (1.1 * y).cos() + frame; 3]
    };
    let mut shown = |off: f32, seen: &dyn Fn(usize, usize, [f32; 3]) -> [f32; 3]| -> Vec<u8> {
        let pixels = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y)));
        pixels
            .flat_map(|(x, y)| seen(x, y, floor(x as f32, y as f32, off)))
            .map(|it| (it + 0.8 * noise.next()).round() as u8)
            .collect()
    };
    let mut segmenter = Segmenter::new(config, SIZE.0, SIZE.1).unwrap();
    for at in 0..10 {
        segmenter.set_background(&shown(0.0, &|_, _, it| it)).unwrap();
        let empty = shown(if at % 2 == 0 { off_px } else { -off_px }, &|_, _, it| it);
        if is_rehearsed {
            segmenter.rehearse(&empty).unwrap();
        }
    }
    segmenter.set_background(&shown(0.0, &|_, _, it| it)).unwrap();
    segmenter.update(&shown(off_px, &|x, y, it| if is_body(x, y) { [75.0; 3] } else { it })).unwrap();
    let beside = segmenter.confidence().iter().enumerate().filter(|it| *it.1 >= BODY && it.0 % SIZE.0 < 50).count();
    (overlap(&segmenter), beside)
}

#[test]
fn after_rehearsals_gray_cloth_on_a_fine_grain_is_body_and_edges_that_are_elsewhere_are_none() {
    let found = [true, false].map(|it| on_other_views(14.0, 0.0, it).0);
    assert!(found[0] > 0.85 && found[1] < 0.5, "{found:?}");
    let found = [true, false].map(|it| on_other_views(0.0, 0.8, it).1);
    assert!(found[0] < 10 && found[1] > 60, "{found:?}");
}
