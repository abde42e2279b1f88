//! Foreground and blobs on rendered scenes whose truth is known: a textured room with noise, and an ellipse that moves.

use foveate_estimation::random::Random;
use foveate_imaging::{Blob, BlobFinder, BlobLimits, Foreground, ForegroundConfig, ImageView, Verdict};
use nalgebra::{Point2, Vector2};

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

/// Gray levels of an empty room: patches of random brightness, 70 to 130, and finer texture on them.
fn room(random: &mut Random) -> Vec<f64> {
    let patches: Vec<f64> = (0..20 * 15).map(|_| random.uniform_in(70.0, 130.0)).collect();
    let fine = |i: usize| patches[i / WIDTH / 8 * 20 + i % WIDTH / 8];
    (0..WIDTH * HEIGHT).map(|i| fine(i) + random.uniform_in(-8.0, 8.0)).collect()
}

/// What stands in the room.
#[derive(Clone, Copy)]
struct Body {
    centre: Point2<f64>,
    radii: [f64; 2],
    /// Gray level, with a texture of ± 15 on it.
    level: f64,
}

impl Body {
    const PERSON: Body = Body { centre: Point2::new(80.0, 60.0), radii: [9.0, 20.0], level: 200.0 };

    fn at(x: f64, y: f64) -> Self {
        Body { centre: Point2::new(x, y), ..Body::PERSON }
    }

    /// Part of a pixel that it covers.
    fn cover(&self, i: usize) -> f64 {
        let inside = |k: usize| {
            let x = (i % WIDTH) as f64 + (k % 4) as f64 / 4.0 - 0.375 - self.centre.x;
            let y = (i / WIDTH) as f64 + (k / 4) as f64 / 4.0 - 0.375 - self.centre.y;
            (x / self.radii[0]).powi(2) + (y / self.radii[1]).powi(2) <= 1.0
        };
        (0..16).filter(|&k| inside(k)).count() as f64 / 16.0
    }
}

struct Scene {
    room: Vec<f64>,
    random: Random,
    noise: f64,
    /// Factor of the light, everywhere.
    light: f64,
    /// Part of the light that is left in columns 20..60, rows 80..110.
    shadow: f64,
}

impl Scene {
    fn new(seed: u64) -> Self {
        let mut random = Random::new(seed).fork("blobs");
        Scene { room: room(&mut random), random, noise: 3.0, light: 1.0, shadow: 1.0 }
    }

    fn picture(&mut self, bodies: &[Body]) -> Vec<u8> {
        let mut pixels = Vec::with_capacity(WIDTH * HEIGHT);
        for i in 0..WIDTH * HEIGHT {
            let mut level = self.room[i];
            if (20..60).contains(&(i % WIDTH)) && (80..110).contains(&(i / WIDTH)) {
                level *= self.shadow;
            }
            for body in bodies {
                let texture = 15.0 * ((i % WIDTH) as f64 * 0.9).sin() * ((i / WIDTH) as f64 * 0.7).cos();
                let cover = body.cover(i);
                level += cover * (body.level + texture - level);
            }
            let noise = self.noise * self.random.normal();
            pixels.push((level * self.light + noise).round().clamp(0.0, 255.0) as u8);
        }
        pixels
    }
}

struct BlobDetector {
    scene: Scene,
    foreground: Foreground,
    finder: BlobFinder,
    blobs: Vec<Blob>,
    limits: BlobLimits,
}

impl BlobDetector {
    /// Has learnt the empty room.
    fn new(seed: u64, config: ForegroundConfig) -> Self {
        let mut this = Self {
            scene: Scene::new(seed),
            foreground: Foreground::new(config, WIDTH, HEIGHT).unwrap(),
            finder: BlobFinder::default(),
            blobs: Vec::new(),
            limits: BlobLimits::default(),
        };
        for _ in 0..ForegroundConfig::default().learn_frames {
            assert_eq!(this.see(&[]), Verdict::Learning);
        }
        this
    }

    fn see(&mut self, bodies: &[Body]) -> Verdict {
        let pixels = self.scene.picture(bodies);
        let view = ImageView::new(&pixels, WIDTH, HEIGHT).unwrap();
        let verdict = self.foreground.update(&view).unwrap();
        self.finder.find(&self.foreground, &self.limits, &[], &mut self.blobs).unwrap();
        verdict
    }

    /// Part of the picture that is foreground.
    fn lit(&self) -> f64 {
        self.foreground.mask().iter().filter(|&&it| it > 0).count() as f64 / (WIDTH * HEIGHT) as f64
    }
}

/// Mean error [px] and mean normalised squared error (2 is right) of the centroid, over 100 places of 4 rooms.
fn centroid_errors(level: f64, noise: f64) -> (f64, f64, usize) {
    let (mut errors, mut squares, mut n) = (0.0, 0.0, 0);
    for seed in 0..4 {
        let mut blob_detector = BlobDetector::new(seed, ForegroundConfig::default());
        blob_detector.scene.noise = noise;
        for _ in 0..30 {
            blob_detector.see(&[]);
        }
        for k in 0..25 {
            let body = Body { level, ..Body::at(25.0 + 4.3 * k as f64, 50.0 + 0.77 * k as f64) };
            blob_detector.see(&[body]);
            let [blob] = &blob_detector.blobs[..] else {
                panic!("{} blobs at {}", blob_detector.blobs.len(), body.centre)
            };
            let off = blob.centroid - body.centre;
            errors += off.norm();
            squares += (off.transpose() * blob.covariance.try_inverse().unwrap() * off).x;
            n += 1;
        }
    }
    (errors / n as f64, squares / n as f64, n)
}

/// The covariance is honest: normalised squared errors of two coordinates have a mean of 2.
#[test]
fn centroid_is_as_good_as_its_covariance_says() {
    for (level, noise) in [(200.0, 1.0), (200.0, 3.0), (20.0, 3.0), (200.0, 6.0), (170.0, 3.0)] {
        let (error, square, n) = centroid_errors(level, noise);
        println!("level {level}, noise {noise}: {n} blobs, error {error:.3} px, normalised squared error {square:.2}");
        assert!(error < 0.3, "{error} px");
        assert!((1.0..3.6).contains(&square), "normalised squared error {square}");
    }
}

#[test]
fn an_empty_room_stays_empty() {
    let mut blob_detector = BlobDetector::new(1, ForegroundConfig::default());
    for _ in 0..50 {
        assert_eq!(blob_detector.see(&[]), Verdict::Trusted);
        assert_eq!(blob_detector.blobs, []);
    }
    assert!(blob_detector.lit() < 1e-3, "{}", blob_detector.lit());
}

#[test]
fn somebody_in_view_while_learning_leaves_no_ghost() {
    let config = ForegroundConfig::default();
    let mut blob_detector = BlobDetector {
        scene: Scene::new(2),
        foreground: Foreground::new(config.clone(), WIDTH, HEIGHT).unwrap(),
        finder: BlobFinder::default(),
        blobs: Vec::new(),
        limits: BlobLimits::default(),
    };
    for k in 0..config.learn_frames {
        blob_detector.see(&[Body::at(10.0 + 4.5 * f64::from(k), 60.0)]);
    }
    blob_detector.see(&[]);
    assert_eq!(blob_detector.blobs, []);
    blob_detector.see(&[Body::at(70.0, 60.0)]);
    assert_eq!(blob_detector.blobs.len(), 1);
}

#[test]
fn light_that_changes_everywhere_is_no_foreground() {
    let mut blob_detector = BlobDetector::new(3, ForegroundConfig::default());
    for light in [1.0, 0.6, 0.8, 1.4, 1.0, 0.5] {
        blob_detector.scene.light = light;
        assert_eq!(blob_detector.see(&[]), Verdict::Trusted);
        assert!(blob_detector.lit() < 2e-3, "light {light}: {} of the picture", blob_detector.lit());
        assert!(
            (f64::from(blob_detector.foreground.gain()) - light).abs() < 0.02,
            "{}",
            blob_detector.foreground.gain()
        );
        blob_detector.see(&[Body { level: 160.0, ..Body::at(90.0, 50.0) }]);
        assert_eq!(blob_detector.blobs.len(), 1, "light {light}");
    }
}

#[test]
fn a_light_that_drifts_in_one_corner_is_followed() {
    let mut blob_detector =
        BlobDetector::new(4, ForegroundConfig { adapt_frames: 50.0, ..ForegroundConfig::default() });
    for k in 0..400 {
        blob_detector.scene.shadow = 1.0 + 0.3 * f64::from(k) / 400.0;
        blob_detector.see(&[]);
        assert_eq!(blob_detector.blobs, [], "picture {k}");
    }
    // A drift of 0.075 % a picture is followed 50 pictures late; a variance that grew instead would hide that it is not.
    let inside = (0..WIDTH * HEIGHT).filter(|i| (25..55).contains(&(i % WIDTH)) && (85..105).contains(&(i / WIDTH)));
    let (mut lag, mut sigma, gain) = (0.0, 0.0, f64::from(blob_detector.foreground.gain()));
    for i in inside {
        let (mean, deviation) = blob_detector.foreground.pixel(i);
        lag += (blob_detector.scene.room[i] * 1.3 - gain * f64::from(mean)) / blob_detector.scene.room[i] / 600.0;
        sigma += f64::from(deviation) / 600.0;
    }
    assert!((lag - 0.0375).abs() < 0.01, "lag {lag}, gain {gain}, σ {sigma}");
    assert!(sigma < 6.0, "σ {sigma} where the noise is 3 and the lag some 4");
}

#[test]
fn a_shadow_is_no_foreground_unless_it_is_asked_for() {
    for (shadow_ratio, expected) in [(0.6, 0), (1.0, 1)] {
        let mut blob_detector = BlobDetector::new(5, ForegroundConfig { shadow_ratio, ..ForegroundConfig::default() });
        blob_detector.scene.shadow = 0.75;
        blob_detector.see(&[]);
        assert_eq!(blob_detector.blobs.len(), expected, "shadow_ratio {shadow_ratio}");
    }
    // As dark as that is no shadow.
    let mut blob_detector = BlobDetector::new(5, ForegroundConfig::default());
    blob_detector.scene.shadow = 0.4;
    blob_detector.see(&[]);
    assert_eq!(blob_detector.blobs.len(), 1);
}

#[test]
fn who_stops_is_seen_until_absorbed_and_no_longer() {
    let config = ForegroundConfig { absorb_frames: 60, ..ForegroundConfig::default() };
    let mut blob_detector = BlobDetector::new(6, config);
    let still = Body::at(80.0, 60.0);
    for k in 0..59 {
        blob_detector.see(&[still]);
        assert_eq!(blob_detector.blobs.len(), 1, "picture {k}");
        let off = blob_detector.blobs[0].centroid - still.centre;
        assert!(off.norm() < 0.5, "picture {k}: off by {off}");
    }
    for _ in 0..30 {
        blob_detector.see(&[still]);
    }
    assert_eq!(blob_detector.blobs, []);

    let mut blob_detector = BlobDetector::new(6, ForegroundConfig { absorb_frames: 0, ..ForegroundConfig::default() });
    for _ in 0..300 {
        blob_detector.see(&[still]);
    }
    assert_eq!(blob_detector.blobs.len(), 1);
}

#[test]
fn who_moves_is_not_absorbed() {
    let mut blob_detector = BlobDetector::new(7, ForegroundConfig { absorb_frames: 30, ..ForegroundConfig::default() });
    for k in 0..100 {
        let body = Body::at(80.0 + 40.0 * (0.1 * f64::from(k)).sin(), 60.0);
        blob_detector.see(&[body]);
        assert_eq!(blob_detector.blobs.len(), 1, "picture {k}");
        assert!((blob_detector.blobs[0].centroid - body.centre).norm() < 1.0, "picture {k}");
    }
}

#[test]
fn pieces_are_one_blob_when_they_are_close() {
    let mut blob_detector = BlobDetector::new(8, ForegroundConfig::default());
    let halves = [[9.0, 9.0]; 2].map(|radii| Body { radii, ..Body::PERSON });
    let bodies =
        [Body { centre: Point2::new(60.0, 40.0), ..halves[0] }, Body { centre: Point2::new(60.0, 64.0), ..halves[1] }];
    blob_detector.limits.merge_px = 10;
    blob_detector.see(&bodies);
    let [blob] = &blob_detector.blobs[..] else { panic!("{:?}", blob_detector.blobs) };
    assert!((blob.centroid - Point2::new(60.0, 52.0)).norm() < 0.5, "{}", blob.centroid);
    // Two discs of radius 9, 12 px off the middle: 9²/4 and 9²/4 + 12².
    assert!((blob.moment[(0, 0)] - 20.25).abs() < 2.0 && (blob.moment[(1, 1)] - 164.25).abs() < 8.0, "{}", blob.moment);
    let (top, covariance) = blob_detector.finder.end(blob, Vector2::new(0.0, -1.0)).unwrap();
    assert!((top - Point2::new(60.0, 31.7)).norm() < 1.5, "{top}");
    assert!(covariance.symmetric_eigenvalues().min() > 0.0);
    blob_detector.limits.merge_px = 2;
    blob_detector.see(&bodies);
    assert_eq!(blob_detector.blobs.len(), 2);
    blob_detector.limits.min_area = 300;
    blob_detector.see(&bodies);
    assert_eq!(blob_detector.blobs, []);
}

#[test]
fn what_is_expected_needs_no_sure_pixel() {
    let mut blob_detector =
        BlobDetector::new(9, ForegroundConfig { sure_sigma: 1000.0, ..ForegroundConfig::default() });
    blob_detector.see(&[Body::PERSON]);
    assert_eq!(blob_detector.blobs, []);
    let mut find = |expected: &[Point2<f64>]| {
        let BlobDetector { finder, foreground, limits, blobs, .. } = &mut blob_detector;
        finder.find(foreground, limits, expected, blobs).unwrap();
        blobs.len()
    };
    assert_eq!(
        [find(&[Point2::new(83.0, 50.0)]), find(&[Point2::new(20.0, 50.0)]), find(&[Point2::new(f64::NAN, 0.0)])],
        [1, 0, 0]
    );
}

#[test]
fn a_blob_at_the_edge_does_not_claim_to_be_whole() {
    let mut blob_detector = BlobDetector::new(10, ForegroundConfig::default());
    blob_detector.see(&[Body::at(1.0, 60.0)]);
    let [blob] = &blob_detector.blobs[..] else { panic!("{:?}", blob_detector.blobs) };
    assert!(blob.touches_border);
    assert!(blob.covariance[(0, 0)] > 9.0 && blob.covariance[(1, 1)] < 1.0, "{}", blob.covariance);
}

#[test]
fn a_flooded_room_is_learnt_again() {
    let mut blob_detector = BlobDetector::new(11, ForegroundConfig::default());
    blob_detector.scene.room = room(&mut Random::new(99));
    for level in &mut blob_detector.scene.room {
        *level = 220.0 - *level; // no one gain explains it
    }
    let verdicts: Vec<_> = (0..61).map(|_| blob_detector.see(&[])).collect();
    assert_eq!(verdicts[..30], [Verdict::Flooded; 30]);
    assert_eq!(verdicts[30..60], [Verdict::Learning; 30]);
    assert_eq!(verdicts[60], Verdict::Trusted);
    assert_eq!(blob_detector.blobs, []);
}

#[test]
fn a_picture_of_the_empty_room_replaces_learning() {
    let mut scene = Scene::new(12);
    let empty = scene.picture(&[]);
    let mut foreground = Foreground::new(ForegroundConfig::default(), WIDTH, HEIGHT).unwrap();
    foreground.set_background(&ImageView::new(&empty, WIDTH, HEIGHT).unwrap()).unwrap();
    let (mut finder, mut blobs) = (BlobFinder::default(), Vec::new());
    scene.light = 0.8;
    let pixels = scene.picture(&[Body::PERSON]);
    assert_eq!(foreground.update(&ImageView::new(&pixels, WIDTH, HEIGHT).unwrap()), Ok(Verdict::Trusted));
    finder.find(&foreground, &BlobLimits::default(), &[], &mut blobs).unwrap();
    assert_eq!(blobs.len(), 1);
    assert!((blobs[0].centroid - Body::PERSON.centre).norm() < 0.5);
}

#[test]
fn masked_pixels_are_never_foreground() {
    let mut blob_detector = BlobDetector::new(13, ForegroundConfig::default());
    let masked: Vec<bool> = (0..WIDTH * HEIGHT).map(|i| i % WIDTH >= 80).collect();
    blob_detector.foreground.set_mask(&masked).unwrap();
    blob_detector.see(&[Body::PERSON]);
    assert!(blob_detector.foreground.mask().iter().zip(&masked).all(|(&it, &masked)| it == 0 || !masked));
    assert_eq!(blob_detector.blobs[0].bounds[2], 79);
    assert!(blob_detector.foreground.set_mask(&[true]).is_err());
}

#[test]
fn degenerate_pictures() {
    for (width, height) in [(1, 1), (0, 0), (0, 5), (1, 7), (300, 1)] {
        let config = ForegroundConfig { learn_frames: 2, ..ForegroundConfig::default() };
        let mut foreground = Foreground::new(config, width, height).unwrap();
        let (mut finder, mut blobs) = (BlobFinder::default(), Vec::new());
        for level in [9, 9, 9, 200, 9, 0, 255, 255] {
            let pixels = vec![level; width * height];
            foreground.update(&ImageView::new(&pixels, width, height).unwrap()).unwrap();
            let limits = BlobLimits { min_area: 1, ..BlobLimits::default() };
            finder.find(&foreground, &limits, &[], &mut blobs).unwrap();
            for blob in &blobs {
                assert!(blob.covariance.symmetric_eigenvalues().min() > 0.0, "{blob:?}");
                assert!(finder.end(blob, Vector2::new(0.0, -1.0)).is_some());
                assert!(finder.end(blob, Vector2::zeros()).is_none());
            }
        }
    }
    let mut foreground = Foreground::new(ForegroundConfig::default(), 4, 4).unwrap();
    assert!(foreground.update(&ImageView::new(&[0; 4], 2, 2).unwrap()).is_err());
}

#[test]
fn constant_pictures_have_a_floor_of_noise() {
    let config = ForegroundConfig { learn_frames: 3, ..ForegroundConfig::default() };
    let mut foreground = Foreground::new(config, 40, 30).unwrap();
    let mut see = |pixels: &[u8]| foreground.update(&ImageView::new(pixels, 40, 30).unwrap()).unwrap();
    for _ in 0..3 {
        see(&[100; 1200]);
    }
    assert_eq!(see(&[100; 1200]), Verdict::Trusted);
    let mut one_more = [100; 1200];
    one_more[400..440].fill(103);
    assert_eq!(see(&one_more), Verdict::Trusted);
    assert!(foreground.mask().iter().all(|&it| it == 0));
    assert_eq!(foreground.pixel(7).1, 2.0);
}

#[test]
fn settings_out_of_range_are_named() {
    let name = |change: fn(&mut ForegroundConfig)| {
        let mut config = ForegroundConfig::default();
        change(&mut config);
        config.check().map_err(|it| it.to_string().split(' ').next().unwrap_or_default().to_owned()).err()
    };
    assert_eq!(name(|_| ()), None);
    assert_eq!(name(|it| it.learn_frames = 0).as_deref(), Some("learn_frames"));
    assert_eq!(name(|it| it.threshold_sigma = f32::NAN).as_deref(), Some("threshold_sigma"));
    assert_eq!(name(|it| it.sure_sigma = 1.0).as_deref(), Some("sure_sigma"));
    assert_eq!(name(|it| it.noise_floor = 0.0).as_deref(), Some("noise_floor"));
    assert_eq!(name(|it| it.adapt_frames = 0.5).as_deref(), Some("adapt_frames"));
    assert_eq!(name(|it| it.shadow_ratio = 1.5).as_deref(), Some("shadow_ratio"));
    assert_eq!(name(|it| it.relearn_fraction = -0.1).as_deref(), Some("relearn_fraction"));
    assert!(BlobLimits { min_area: 0, ..BlobLimits::default() }.check().is_err());
    assert!(BlobLimits { min_area: 9, max_area: 8, ..BlobLimits::default() }.check().is_err());
}
