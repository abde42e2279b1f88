//! A small lab with known truth: cameras under the ceiling, lights on a walking person, noise, clutter, occlusion.
#![allow(dead_code, reason = "each test and bench uses a part of it")]

use std::f64::consts::{PI, TAU};

use foveate::estimation::random::Random;
use foveate::geometry::Camera;
use foveate::messages::{CameraId, Feature, Features, How, TargetId, Targets, Time};
use foveate_led::tracker::{Entry, Tracker};
use nalgebra::{Matrix2, Matrix3, Point2, Point3, Vector3};

/// `n` cameras at 2.7 m around a room of 3.5 m × 5 m, looking at its middle; fields of 640 × 240 px.
pub fn cameras(n: usize) -> Vec<Camera> {
    (0..n)
        .map(|i| {
            let angle = TAU * i as f64 / n as f64;
            // On the walls of the room, not on a circle.
            let (s, c) = angle.sin_cos();
            let reach = (1.75 / c.abs().max(1e-9)).min(2.5 / s.abs().max(1e-9));
            let centre = Point3::new(c * reach, s * reach, 2.7);
            let mut camera = Camera::look_at(centre, Point3::new(0.0, 0.0, 1.1), [640, 240], 420.0);
            camera.intrinsics.focal = [420.0, 210.0];
            camera
        })
        .collect()
}

/// The lights of a walking person: head, shoulders, elbows, wrists, waist [m].
pub fn person(t: f64) -> [(Point3<f64>, Vector3<f64>); 8] {
    let pace = 0.9; // around an ellipse of 1.0 m × 1.5 m: about 1 m/s
    let (a, b) = (0.9, 1.4);
    let phase = pace * t;
    let centre = Point3::new(a * phase.cos(), b * phase.sin(), 0.0);
    let heading = Vector3::new(-a * phase.sin(), b * phase.cos(), 0.0).normalize();
    let left = Vector3::z().cross(&heading);
    let step = TAU * 0.9 * t;
    let bob = 0.02 * (2.0 * step).sin();
    let swing = |side: f64, length: f64| heading * (0.35 * length * (step + side * PI / 2.0).sin());
    let mut lights = [(Point3::origin(), Vector3::zeros()); 8];
    let mut put = |k: usize, forward: f64, aside: f64, up: f64, moved: Vector3<f64>, normal: Vector3<f64>| {
        lights[k] = (centre + heading * forward + left * aside + Vector3::z() * (up + bob) + moved, normal);
    };
    put(0, 0.0, 0.0, 1.75, Vector3::zeros(), Vector3::z());
    put(1, 0.0, 0.20, 1.45, Vector3::zeros(), left + Vector3::z());
    put(2, 0.0, -0.20, 1.45, Vector3::zeros(), -left + Vector3::z());
    put(3, -0.03, 0.28, 1.15, swing(1.0, 0.4), left - heading * 0.5);
    put(4, -0.03, -0.28, 1.15, swing(-1.0, 0.4), -left - heading * 0.5);
    put(5, 0.03, 0.30, 0.90, swing(1.0, 1.0), left + heading * 0.5);
    put(6, 0.03, -0.30, 0.90, swing(-1.0, 1.0), -left + heading * 0.5);
    put(7, 0.12, 0.0, 1.0, Vector3::zeros(), heading);
    lights
}

/// What the lab is like.
#[derive(Debug, Clone)]
pub struct Lab {
    pub cameras: Vec<Camera>,
    /// Standard deviation of a pixel, each axis [px].
    pub noise: f64,
    /// False features a frame, on average.
    pub clutter: f64,
    /// Part of the time that a light is hidden from a camera besides by the body.
    pub hidden: f64,
    /// Whether lights shine to one side only.
    pub directional: bool,
    /// Frames a second of each camera [Hz].
    pub rate: f64,
    /// Whether all cameras expose at once.
    pub synchronous: bool,
    pub seed: u64,
}

impl Lab {
    pub fn new(n_cameras: usize) -> Self {
        Self {
            cameras: cameras(n_cameras),
            noise: 0.3,
            clutter: 0.0,
            hidden: 0.0,
            directional: false,
            rate: 60.0,
            synchronous: false,
            seed: 1,
        }
    }

    /// All frames of `duration` seconds in the order of capture, of the lights that `scene` gives for a time.
    pub fn frames<const N: usize>(
        &self,
        duration: f64,
        scene: impl Fn(f64) -> [(Point3<f64>, Vector3<f64>); N],
    ) -> Vec<(Time, Features)> {
        let root = Random::new(self.seed);
        let mut frames = Vec::new();
        for (c, camera) in self.cameras.iter().enumerate() {
            let mut random = root.fork(&format!("camera {c}"));
            let offset = if self.synchronous { 0.0 } else { random.uniform() / self.rate };
            let mut hidden = [false; N];
            for k in 0..(duration * self.rate) as usize {
                let t = offset + k as f64 / self.rate;
                let mut list = Vec::new();
                for (it, (place, normal)) in scene(t).iter().enumerate() {
                    // Hidden for 0.2 s on average, as often as it takes.
                    let leave = 1.0 / (0.2 * self.rate);
                    let enter = leave * self.hidden / (1.0 - self.hidden);
                    let change = random.uniform() < if hidden[it] { leave } else { enter };
                    hidden[it] ^= change;
                    let towards = (camera.centre() - place).normalize();
                    let turned_away = self.directional && towards.dot(&normal.normalize()) < -0.1;
                    let noise = Point2::new(random.normal(), random.normal()) * self.noise;
                    if let Some(pixel) = camera.sees(place).filter(|_| !hidden[it] && !turned_away) {
                        list.push(feature(pixel + noise.coords, self.noise));
                    }
                }
                let mut expected = self.clutter;
                while random.uniform() < expected {
                    let [width, height] = camera.image_size.map(f64::from);
                    let place = Point2::new(random.uniform_in(0.0, width), random.uniform_in(0.0, height));
                    list.push(feature(place, self.noise));
                    expected -= 1.0;
                }
                list.sort_by(|a, b| a.centre.y.total_cmp(&b.centre.y));
                frames.push((Time::from_s(t), Features { camera: CameraId(c as u16), list }));
            }
        }
        frames.sort_by_key(|(time, features)| (*time, features.camera));
        frames
    }
}

pub fn feature(centre: Point2<f64>, sigma: f64) -> Feature {
    Feature { centre, covariance: Matrix2::identity() * (sigma * sigma).max(1e-4), area: 9, peak: 200 }
}

/// How a tracker did against the truth.
#[derive(Debug, Default)]
pub struct Score {
    /// Root of the mean squared error of matched samples after settling [m].
    pub rms: f64,
    pub worst: f64,
    /// Identities that followed each light for at least one sample after settling.
    pub identities: Vec<Vec<TargetId>>,
    /// Samples after settling that were near no light.
    pub ghosts: usize,
    /// Samples of lights after settling that no target was near.
    pub missed: usize,
    pub samples: usize,
    /// Mean of eᵀP⁻¹e over the measured samples, e the error of the position; 3 if the covariance P is right.
    pub consistency: f64,
    pub first_birth: Option<Time>,
}

impl Score {
    pub fn n_identities(&self) -> usize {
        let mut all: Vec<_> = self.identities.iter().flatten().collect();
        all.sort();
        all.dedup();
        all.len()
    }
}

/// Runs all frames through `tracker` and compares after each; the first `settle` seconds count for nothing.
pub fn score<const N: usize>(
    tracker: &mut Tracker,
    frames: &[(Time, Features)],
    settle: f64,
    scene: impl Fn(f64) -> [(Point3<f64>, Vector3<f64>); N],
) -> Score {
    let mut score = Score { identities: vec![Vec::new(); N], ..Score::default() };
    let (mut targets, mut squares, mut n) = (Targets::default(), 0.0, 0);
    let mut consistency = 0.0;
    for (time, features) in frames {
        if tracker.observe(*time, features) != Entry::Applied {
            continue;
        }
        tracker.write(&mut targets);
        if !targets.list.is_empty() && score.first_birth.is_none() {
            score.first_birth = Some(targets.time);
        }
        if targets.time.as_s() < settle {
            continue;
        }
        let truth = scene(targets.time.as_s());
        let mut found = [false; N];
        for target in &targets.list {
            let distance = |k: &usize| (truth[*k].0 - target.position).norm();
            let nearest = (0..N).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
            let error = distance(&nearest);
            if error > 0.1 {
                score.ghosts += 1;
                continue;
            }
            found[nearest] = true;
            if !score.identities[nearest].contains(&target.id) {
                score.identities[nearest].push(target.id);
            }
            if target.how == How::Measured {
                squares += error * error;
                n += 1;
                let e = truth[nearest].0 - target.position;
                let covariance: Matrix3<f64> = target.covariance.fixed_view::<3, 3>(0, 0).into_owned();
                consistency += covariance.try_inverse().map_or(f64::NAN, |it| e.dot(&(it * e)));
                score.worst = score.worst.max(error);
            }
        }
        score.samples += N;
        score.missed += found.iter().filter(|it| !**it).count();
    }
    score.consistency = consistency / f64::from(n.max(1));
    score.rms = (squares / f64::from(n.max(1))).sqrt();
    score
}
