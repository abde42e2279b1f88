//! The learned background: what it takes in, what it refuses to take in, and how it recovers.

use foveate_imaging::{
    Background, BackgroundConfig, Found, ImageView, Measure, Sampling, Spot, SpotFinder, SpotLimits, Statistic,
    Verdict, fill_polygon,
};
use nalgebra::Point2;
use proptest::prelude::*;

const WIDTH: usize = 70;
const HEIGHT: usize = 44;
const N: usize = WIDTH * HEIGHT;

/// A camera with its background and finder.
struct Camera {
    background: Background,
    finder: SpotFinder,
    sequence: u64,
}

impl Camera {
    fn new(config: BackgroundConfig) -> Camera {
        let finder = SpotFinder::new(Measure::default()).unwrap();
        Camera { background: Background::new(config, WIDTH, HEIGHT).unwrap(), finder, sequence: 0 }
    }

    /// One frame through search and background.
    #[track_caller]
    fn see(&mut self, pixels: &[u8]) -> (Verdict, Vec<Spot>) {
        let view = ImageView::new(pixels, WIDTH, HEIGHT).unwrap();
        let (mut spots, limits) = (Vec::new(), SpotLimits { min_area: 1, ..Default::default() });
        self.sequence += 1;
        let sampling = Sampling::of_frame(self.sequence, 2);
        let found = self
            .background
            .thresholds()
            .map(|thresholds| self.finder.find_sampled(&view, thresholds, sampling, &[], &limits, &mut spots).unwrap());
        (self.background.update(&view, found.as_ref()).unwrap(), spots)
    }

    #[track_caller]
    fn learn(config: BackgroundConfig, pixels: &[u8]) -> Camera {
        let mut camera = Camera::new(config);
        for _ in 0..camera.background.config().learn_frames {
            assert_eq!(camera.see(pixels), (Verdict::Learning, vec![]));
        }
        camera
    }

    fn threshold(&self, x: usize, y: usize) -> u8 {
        self.background.thresholds().unwrap().thresholds()[y * WIDTH + x]
    }
}

fn config() -> BackgroundConfig {
    BackgroundConfig { learn_frames: 10, ..Default::default() }
}

/// `level` everywhere, and a light of 4 × 4 px whose upper left pixel is (x, y).
fn scene(level: u8, light: Option<(usize, usize)>) -> Vec<u8> {
    let mut pixels = vec![level; N];
    for (x, y) in light.iter().flat_map(|&(x, y)| (0..16).map(move |i| (x + i % 4, y + i / 4))) {
        pixels[y * WIDTH + x] = 220;
    }
    pixels
}

proptest! {
    #[test]
    fn threshold_is_the_papers_formula(level in any::<u8>(), offset in any::<u8>(), min_threshold in any::<u8>()) {
        let camera = Camera::learn(BackgroundConfig { offset, min_threshold, ..config() }, &scene(level, None));
        let expected = (u32::from(level) + u32::from(offset)).min(255).max(min_threshold.into());
        prop_assert_eq!(u32::from(camera.threshold(3, 3)), expected);
    }

    /// Against sorting: the background is the (n + 1)-th brightest of the frames.
    #[test]
    fn leaving_out_the_highest_is_a_rank(levels in prop::collection::vec(any::<u8>(), 10), n in 0u8..8) {
        let mut camera = Camera::new(BackgroundConfig { statistic: Statistic::WithoutHighest(n), ..config() });
        levels.iter().for_each(|&it| { camera.see(&scene(it, None)); });
        let mut sorted = levels;
        sorted.sort_unstable_by_key(|&it| std::cmp::Reverse(it));
        prop_assert_eq!(camera.background.levels()[0], sorted[n as usize]);
    }
}

#[test]
fn nothing_is_said_before_the_first_learning_has_ended() {
    let mut camera = Camera::new(config());
    for k in 0..10 {
        assert_eq!(camera.background.progress(), Some((k, 10)));
        assert!(camera.background.thresholds().is_none());
        camera.see(&scene(20, None));
    }
    assert_eq!(camera.background.progress(), None);
    let (verdict, spots) = camera.see(&scene(20, Some((30, 20))));
    assert_eq!((verdict, spots.len()), (Verdict::Trusted, 1));
}

#[test]
fn a_light_that_passes_while_learning_burns_its_path_into_the_maximum_only() {
    for (statistic, blind_path) in [(Statistic::Maximum, true), (Statistic::WithoutHighest(2), false)] {
        let mut camera = Camera::new(BackgroundConfig { statistic, ..config() });
        for k in 0..10 {
            camera.see(&scene(20, Some((5 + 3 * k, 20)))); // 4 px wide, 3 px a frame: two frames on a pixel at most
        }
        let (_, spots) = camera.see(&scene(20, Some((15, 20))));
        assert_eq!(spots.is_empty(), blind_path, "{statistic:?}");
    }
}

#[test]
fn the_trace_of_a_light_that_stood_still_sinks_after_it_has_gone() {
    let mut camera = Camera::learn(BackgroundConfig { sink: 20, ..config() }, &scene(20, Some((15, 20))));
    assert_eq!(camera.threshold(16, 21), 240);
    let n_bands = HEIGHT.div_ceil(8);
    for _ in 0..11 * n_bands {
        assert_eq!(camera.see(&scene(20, None)).0, Verdict::Trusted);
    }
    assert_eq!(camera.threshold(16, 21), 40);
    assert_eq!(camera.see(&scene(20, Some((15, 20)))).1.len(), 1);
    // A light that is lit now does not burn in, however long it stands.
    for _ in 0..11 * n_bands {
        assert_eq!(camera.see(&scene(20, Some((15, 20)))).1.len(), 1);
    }
}

#[test]
fn sinking_follows_a_darker_room_and_comes_back_no_higher_than_learned() {
    let mut camera = Camera::learn(BackgroundConfig { sink: 5, min_threshold: 0, ..config() }, &scene(60, None));
    for _ in 0..100 {
        camera.see(&scene(10, None));
    }
    assert_eq!(camera.threshold(60, 40), 30);
    for level in 10..=75 {
        (0..6).for_each(|_| assert_eq!(camera.see(&scene(level, None)).0, Verdict::Trusted));
    }
    assert_eq!(camera.threshold(60, 40), 80);
}

#[test]
fn a_lamp_switched_on_is_learned_and_nothing_is_trusted_meanwhile() {
    let mut camera = Camera::learn(config(), &scene(20, None));
    let mut lit_room = scene(20, None);
    lit_room[..N / 10].fill(150);
    for _ in 0..10 {
        assert_eq!(camera.see(&lit_room).0, Verdict::Flooded);
    }
    assert_eq!(camera.see(&lit_room), (Verdict::Trusted, vec![]));
    assert_eq!((camera.threshold(0, 0), camera.threshold(0, HEIGHT - 1)), (170, 40));
}

#[test]
fn a_flash_leaves_the_background_as_it_was() {
    let mut camera = Camera::learn(config(), &scene(20, None));
    assert_eq!(camera.see(&scene(250, None)).0, Verdict::Flooded);
    for _ in 0..20 {
        let (verdict, spots) = camera.see(&scene(20, Some((40, 10))));
        assert_eq!((verdict, spots.len()), (Verdict::Trusted, 1));
    }
    assert_eq!((camera.threshold(0, 0), camera.background.progress()), (40, None));
}

#[test]
fn a_flicker_in_every_third_frame_is_learned() {
    let mut camera = Camera::learn(BackgroundConfig { learn_frames: 30, ..config() }, &scene(20, None));
    let mut n_flooded = 0;
    for k in 0..90 {
        n_flooded += u32::from(camera.see(&scene(if k % 3 == 0 { 120 } else { 20 }, None)).0 == Verdict::Flooded);
    }
    assert_eq!((n_flooded, camera.threshold(0, 0)), (10, 140));
}

#[test]
fn a_room_learned_while_glaring_is_learned_again_once_the_glare_has_gone() {
    let mut camera = Camera::learn(config(), &scene(250, None));
    assert_eq!(camera.background.blind_fraction(), 1.0);
    for _ in 0..25 {
        camera.see(&scene(250, None));
    }
    for _ in 0..20 {
        camera.see(&scene(20, None));
    }
    assert_eq!((camera.threshold(0, 0), camera.background.blind_fraction()), (40, 0.0));
    assert_eq!(camera.see(&scene(20, Some((40, 10)))).1.len(), 1);
}

#[test]
fn masked_pixels_are_never_lit_and_do_not_count() {
    let mut camera = Camera::learn(config(), &scene(20, None));
    let corners = [(-5.0, -5.0), (34.5, -5.0), (34.5, 90.0), (-5.0, 90.0)].map(|(x, y)| Point2::new(x, y));
    let mut mask = vec![false; N];
    fill_polygon(&mut mask, WIDTH, HEIGHT, &corners).unwrap();
    camera.background.set_mask(mask).unwrap();
    let mut monitor = scene(20, Some((50, 20)));
    monitor.chunks_mut(WIDTH).for_each(|row| row[..35].fill(255));
    let (verdict, spots) = camera.see(&monitor);
    assert_eq!((verdict, spots.len(), camera.background.blind_fraction()), (Verdict::Trusted, 1, 0.0));
    // 16 lit pixels of 35 × 44 that are not masked: above 1 %, though below 1 % of the whole picture.
    let found = Found { examined: 35 * 44, lit: 16, ..Default::default() };
    let mut strict = Camera::learn(BackgroundConfig { relearn_fraction: 0.01, ..config() }, &scene(20, None));
    let view = ImageView::new(&monitor, WIDTH, HEIGHT).unwrap();
    assert_eq!(strict.background.update(&view, Some(&found)), Ok(Verdict::Flooded));
    // Masked while learning, unmasked later: the background beneath was learned all the same.
    camera.background.set_mask(vec![false; N]).unwrap();
    assert_eq!(camera.threshold(3, 3), 40);
    assert!(camera.background.set_mask(vec![false; N - 1]).is_err());
}

#[test]
fn everything_masked_is_quiet() {
    let mut camera = Camera::learn(config(), &scene(20, None));
    camera.background.set_mask(vec![true; N]).unwrap();
    assert_eq!(camera.see(&scene(250, None)), (Verdict::Trusted, vec![]));
    assert_eq!(camera.background.blind_fraction(), 0.0);
}

#[test]
fn levels_can_be_turned_while_running() {
    let mut camera = Camera::learn(config(), &scene(20, None));
    camera.background.set_levels(50, 0);
    assert_eq!(camera.threshold(0, 0), 70);
    camera.background.set_levels(5, 90);
    assert_eq!(camera.threshold(0, 0), 90);
    camera.background.relearn();
    (0..10).for_each(|_| assert_eq!(camera.see(&scene(88, None)).0, Verdict::Trusted));
    assert_eq!(camera.threshold(0, 0), 93);
}

#[test]
fn wrong_sizes_and_settings_are_refused() {
    let mut background = Background::new(config(), 4, 4).unwrap();
    assert!(background.update(&ImageView::new(&[0; 20], 5, 4).unwrap(), None).is_err());
    assert_eq!(background.progress(), Some((0, 10)));
    for bad in [
        BackgroundConfig { learn_frames: 0, ..config() },
        BackgroundConfig { relearn_fraction: f64::NAN, ..config() },
        BackgroundConfig { relearn_fraction: 1.5, ..config() },
        BackgroundConfig { statistic: Statistic::WithoutHighest(16), learn_frames: 90, ..config() },
        BackgroundConfig { statistic: Statistic::WithoutHighest(3), learn_frames: 3, ..config() },
    ] {
        assert!(Background::new(bad.clone(), 4, 4).is_err(), "{bad:?}");
    }
    let mut empty = Background::new(BackgroundConfig { learn_frames: 1, sink: 1, ..config() }, 0, 3).unwrap();
    for _ in 0..3 {
        assert!(empty.update(&ImageView::new(&[], 0, 3).unwrap(), None).is_ok());
    }
}
