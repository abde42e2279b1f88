//! A painted surface that moves, turns and deforms before a dull background, with the truth about every dot, and the score of who follows them.

#![allow(dead_code, reason = "each test and bench uses a part")]

use foveate::estimation::random::Random;
use foveate::messages::{CameraId, Features, GuidedMark, Image, PixelFormat, SourceId, Stamp, Time};
use foveate_painted_mark::tracker::{Correction, MarkTracker, TrackerSettings};
use nalgebra::{Matrix2, Point2, Vector2};

pub const WIDTH: usize = 400;
pub const HEIGHT: usize = 300;
const FACE_PX: [f64; 2] = [85.0, 105.0];
const TEXTURE: usize = 256;

/// What happens in a sequence.
#[derive(Clone)]
pub struct Play {
    /// How far the whole moves from one picture to the next, at most [px].
    pub speed_px: f64,
    /// The surface turns to and fro by this [rad].
    pub turn: f64,
    /// It deforms by this, to and fro [px].
    pub wave_px: f64,
    /// Every so many pictures, two are blurred by their motion; 0: none.
    pub blur_every: u64,
    /// Something passes before the surface.
    pub passer: bool,
    /// Noise [gray level].
    pub noise: f64,
    /// How far dots lie apart, at least [px].
    pub apart_px: f64,
}

impl Default for Play {
    fn default() -> Self {
        Self { speed_px: 3.0, turn: 0.3, wave_px: 3.0, blur_every: 0, passer: false, noise: 2.0, apart_px: 12.0 }
    }
}

/// A sequence of pictures with known truth.
pub struct Sequence {
    play: Play,
    dots: Vec<Point2<f64>>,
    /// Gray levels of the surface over its mean, 256 × 256 px about its middle.
    texture: Vec<f32>,
    path: Vec<Point2<f64>>,
    random: Random,
}

impl Sequence {
    pub fn new(play: Play, n_pictures: usize, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let mut dots: Vec<Point2<f64>> = Vec::new();
        for _ in 0..4000 {
            let place = Point2::new(random.uniform_in(-80.0, 80.0), random.uniform_in(-100.0, 100.0));
            let is_inside = (place.x / (FACE_PX[0] - 10.0)).hypot(place.y / (FACE_PX[1] - 10.0)) < 1.0;
            if is_inside && dots.len() < 69 && dots.iter().all(|it| (it - place).norm() >= play.apart_px) {
                dots.push(place);
            }
        }
        let waves: Vec<[f64; 4]> = (0..12)
            .map(|_| {
                let direction = random.uniform_in(0.0, std::f64::consts::TAU);
                let (phase, k) = (random.uniform_in(0.0, 6.0), std::f64::consts::TAU / random.uniform_in(9.0, 60.0));
                [k * direction.cos(), k * direction.sin(), phase, random.uniform_in(1.0, 4.0)]
            })
            .collect();
        let level = |i: usize| {
            let (x, y) = ((i % TEXTURE) as f64, (i / TEXTURE) as f64);
            waves.iter().map(|[a, b, c, d]| d * (a * x + b * y + c).sin()).sum::<f64>() as f32
        };
        let texture = (0..TEXTURE * TEXTURE).map(level).collect();
        // From place to place at the speed, and on from there.
        let room = [WIDTH as f64 / 2.0 - 95.0, HEIGHT as f64 / 2.0 - 112.0];
        let middle = Point2::new(WIDTH as f64 / 2.0, HEIGHT as f64 / 2.0);
        let (mut path, mut at, mut goal) = (Vec::new(), middle, middle);
        while path.len() < n_pictures {
            let way: Vector2<f64> = goal - at;
            if way.norm() < play.speed_px {
                at = goal;
                goal = middle
                    + Vector2::new(random.uniform_in(-1.0, 1.0) * room[0], random.uniform_in(-1.0, 1.0) * room[1]);
            } else {
                at += way.normalize() * play.speed_px;
            }
            path.push(at);
        }
        Self { play, dots, texture, path, random: random.fork("noise") }
    }

    pub fn n_marks(&self) -> usize {
        self.dots.len()
    }

    pub fn len(&self) -> usize {
        self.path.len()
    }

    /// Where a place of the surface is in picture `t` (fractions are between pictures).
    fn forth(&self, place: &Point2<f64>, t: f64) -> Point2<f64> {
        let wave = self.wave(place, t);
        let (i, part) = (t.floor().max(0.0) as usize, t - t.floor());
        let last = self.path.len() - 1;
        let centre = self.path[i.min(last)] + (self.path[(i + 1).min(last)] - self.path[i.min(last)]) * part;
        let turn = self.play.turn * (t * 0.11).sin();
        let s = place + wave;
        // A cylinder that turns about its upright axis.
        let angle = s.x / 110.0 + turn;
        Point2::new(centre.x + 110.0 * angle.sin() - 55.0 * turn.sin(), centre.y + s.y)
    }

    fn wave(&self, place: &Point2<f64>, t: f64) -> Vector2<f64> {
        let size = self.play.wave_px;
        let phase = t * 0.35;
        Vector2::new(size * (place.y / 35.0 + phase).sin(), size * (place.x / 30.0 - 0.8 * phase).sin())
    }

    /// The place of the surface at a pixel. `None`: the background.
    fn back(&self, pixel: &Point2<f64>, t: f64, centre: &Point2<f64>, turn: f64) -> Option<Point2<f64>> {
        let sine = (pixel.x - centre.x + 55.0 * turn.sin()) / 110.0;
        if sine.abs() >= 0.98 {
            return None;
        }
        let s = Point2::new(110.0 * (sine.asin() - turn), pixel.y - centre.y);
        let mut place = s;
        for _ in 0..3 {
            place = s - self.wave(&place, t);
        }
        ((place.x / FACE_PX[0]).hypot(place.y / FACE_PX[1]) < 1.0).then_some(place)
    }

    fn texture(&self, place: &Point2<f64>) -> f64 {
        let (x, y) = (place.x + TEXTURE as f64 / 2.0, place.y + TEXTURE as f64 / 2.0);
        let (i, j) = (x as usize, y as usize);
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let at = |i: usize, j: usize| f64::from(self.texture[j * TEXTURE + i]);
        let row = |j: usize| at(i, j) * (1.0 - fx) + at(i + 1, j) * fx;
        row(j) * (1.0 - fy) + row(j + 1) * fy
    }

    fn passer_edge(&self, t: f64) -> f64 {
        if !self.play.passer {
            return -1e9;
        }
        // In from the left, across a half of the surface, and out again.
        80.0 + 130.0 * (t * 0.05).sin()
    }

    /// Whether something hides the pixel, with so much to spare.
    fn is_hidden(&self, pixel: &Point2<f64>, t: f64, spare: f64) -> bool {
        pixel.x < self.passer_edge(t) - spare
    }

    /// Where each mark is, and whether it can be seen well; in the picture `t`.
    pub fn truth(&self, t: usize) -> Vec<(Point2<f64>, bool)> {
        let t = t as f64;
        self.dots
            .iter()
            .map(|it| {
                let pixel = self.forth(it, t);
                (pixel, !self.is_hidden(&pixel, t, -6.0))
            })
            .collect()
    }

    pub fn is_blurred(&self, t: usize) -> bool {
        let every = self.play.blur_every;
        every > 0 && t as u64 % every >= every - 2
    }

    fn levels(&self, t: f64) -> Vec<f32> {
        let (i, part) = (t.floor() as usize, t - t.floor());
        let last = self.path.len() - 1;
        let centre = self.path[i.min(last)] + (self.path[(i + 1).min(last)] - self.path[i.min(last)]) * part;
        let turn = self.play.turn * (t * 0.11).sin();
        let edge = self.passer_edge(t);
        let near: Vec<(Point2<f64>, f64)> = {
            // Dots as they look in the picture: their place, and how much narrower than high.
            let narrow = |it: &Point2<f64>| {
                let beside =
                    self.forth(&(it + Vector2::new(0.5, 0.0)), t) - self.forth(&(it - Vector2::new(0.5, 0.0)), t);
                beside.x.abs().max(0.3)
            };
            self.dots.iter().map(|it| (self.forth(it, t), narrow(it))).collect()
        };
        let mut levels = Vec::with_capacity(WIDTH * HEIGHT);
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let pixel = Point2::new(x as f64, y as f64);
                let level = if pixel.x < edge {
                    95.0 + 4.0 * (pixel.y * 0.3).sin()
                } else if let Some(place) = self.back(&pixel, t, &centre, turn) {
                    let texture = self.texture(&place);
                    150.0 - 0.25 * (pixel.x - centre.x) + texture
                } else {
                    70.0 + 3.0 * (pixel.x * 0.05).sin()
                };
                levels.push(level as f32);
            }
        }
        for (dot, narrow) in near {
            for y in (dot.y - 4.0).ceil().max(0.0) as usize..=(dot.y + 4.0).min(HEIGHT as f64 - 1.0).max(0.0) as usize {
                for x in
                    (dot.x - 4.0).ceil().max(0.0) as usize..=(dot.x + 4.0).min(WIDTH as f64 - 1.0).max(0.0) as usize
                {
                    if (x as f64) < edge {
                        continue;
                    }
                    let mut covered = 0.0;
                    for k in 0..16 {
                        let (u, v) = ((k % 4) as f64 / 4.0 - 0.375, (k / 4) as f64 / 4.0 - 0.375);
                        let offset = [(x as f64 + u - dot.x) / narrow, y as f64 + v - dot.y];
                        covered += if offset[0].hypot(offset[1]) <= 2.0 { 1.0 / 16.0 } else { 0.0 };
                    }
                    levels[y * WIDTH + x] *= 1.0 - 0.65 * covered as f32;
                }
            }
        }
        levels
    }

    pub fn picture(&mut self, t: usize) -> Image {
        let mut sum = self.levels(t as f64);
        if self.is_blurred(t) {
            // The shutter is open for a whole period.
            for k in 1..6 {
                let later = self.levels(t as f64 + f64::from(k) / 6.0);
                sum.iter_mut().zip(later).for_each(|(sum, it)| *sum += it);
            }
            sum.iter_mut().for_each(|it| *it /= 6.0);
        }
        let noise = self.play.noise;
        let mut byte = |it: f32| (f64::from(it) + noise * self.random.normal()).round().clamp(0.0, 255.0) as u8;
        let pixels = sum.into_iter().map(&mut byte).collect();
        Image {
            camera: CameraId(0),
            width: WIDTH as u32,
            height: HEIGHT as u32,
            format: PixelFormat::Gray8,
            pixels,
            ..Image::default()
        }
    }

    pub fn stamp(t: usize) -> Stamp {
        Stamp { time: Time::from_s(t as f64 / 30.0), source: SourceId(0), sequence: t as u64 }
    }

    /// The marks of the first picture chosen by hand: to the pixel.
    pub fn by_hand(&self) -> Vec<Correction> {
        let row = |(mark, (pixel, _)): (usize, (Point2<f64>, bool))| Correction {
            frame: 0,
            mark: mark as u32,
            pixel: Some(Point2::new(pixel.x.round(), pixel.y.round())),
        };
        self.truth(0).into_iter().enumerate().map(row).collect()
    }
}

/// Who makes the names.
#[derive(Clone, Copy, PartialEq)]
pub enum Names {
    /// Chosen in the first picture.
    ByHand,
    /// A guide of one picture ago, with errors of 0.5 px and all marks in it, hidden or not.
    ByGuide,
}

/// What came out.
#[derive(Debug, Default)]
pub struct Score {
    /// Named features, of these further than 2 px from the truth, and of these on another mark.
    pub named: usize,
    pub wrong: usize,
    pub swapped: usize,
    /// Marks that could be seen well, in pictures without blur.
    pub visible: usize,
    pub seen: usize,
    /// Root mean square error along one axis, and mean of error² / covariance.
    pub rms_px: f64,
    pub consistency: f64,
    /// Pictures until a mark is first wrong or gone for more than five, or the end.
    pub lengths: Vec<usize>,
    pub unnamed: usize,
}

impl Score {
    pub fn median_length(&self) -> usize {
        let mut lengths = self.lengths.clone();
        lengths.sort_unstable();
        lengths.get(lengths.len() / 2).copied().unwrap_or(0)
    }
}

pub fn run(sequence: &mut Sequence, settings: TrackerSettings, names: Names) -> Score {
    let corrections = if names == Names::ByHand { sequence.by_hand() } else { Vec::new() };
    let mut mark_tracker = MarkTracker::new(settings, corrections, None).expect("settings in range");
    let mut random = Random::new(99);
    let (mut features, mut score) = (Features::default(), Score::default());
    let n = sequence.n_marks();
    let (mut absent, mut length) = (vec![0; n], vec![None; n]);
    for t in 0..sequence.len() {
        let image = sequence.picture(t);
        let guide: Vec<GuidedMark> = if names == Names::ByGuide && t > 0 {
            let mut guided = |(label, (pixel, _)): (usize, (Point2<f64>, bool))| GuidedMark {
                label: label as u32,
                pixel: pixel + Vector2::new(random.normal(), random.normal()) * 0.5,
                covariance: Matrix2::identity() * 0.25,
                disputed: false,
            };
            sequence.truth(t - 1).into_iter().enumerate().map(&mut guided).collect()
        } else {
            Vec::new()
        };
        let stamp = Sequence::stamp(t);
        let guide = (names == Names::ByGuide && t > 0).then(|| (Sequence::stamp(t - 1).time, guide.as_slice()));
        mark_tracker.see(&image, stamp, guide, &mut features).expect("a whole picture");
        let truth = sequence.truth(t);
        let blurred = sequence.is_blurred(t);
        let mut is_right = vec![false; n];
        for feature in &features.list {
            let Some(label) = feature.label else {
                score.unnamed += 1;
                continue;
            };
            score.named += 1;
            let mark = label as usize;
            let (mut place, is_visible) = truth[mark];
            if blurred {
                // The middle of the exposure.
                place += (sequence.truth((t + 1).min(sequence.len() - 1))[mark].0 - place) * (5.0 / 12.0);
            }
            let error = feature.centre - place;
            let is_hidden = sequence.is_hidden(&place, t as f64, 2.0);
            if error.norm() > 2.0 || is_hidden {
                score.wrong += 1;
                length[mark].get_or_insert(t);
                if truth.iter().enumerate().any(|(k, it)| k != mark && (it.0 - feature.centre).norm() < 2.0) {
                    score.swapped += 1;
                }
                continue;
            }
            is_right[mark] = true;
            if is_visible && !blurred {
                score.seen += 1;
                score.rms_px += error.norm_squared();
                score.consistency += feature.covariance.try_inverse().map_or(0.0, |it| (it * error).dot(&error));
            }
        }
        score.visible += if blurred { 0 } else { truth.iter().filter(|it| it.1).count() };
        for mark in 0..n {
            absent[mark] = if is_right[mark] { 0 } else { absent[mark] + 1 };
            if absent[mark] > 5 {
                length[mark].get_or_insert(t - 5);
            }
        }
    }
    score.rms_px = (score.rms_px / (2 * score.seen.max(1)) as f64).sqrt();
    score.consistency /= (2 * score.seen.max(1)) as f64;
    score.lengths = length.into_iter().map(|it| it.unwrap_or(sequence.len())).collect();
    score
}
