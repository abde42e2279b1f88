//! How a person swings, bends and gestures while walking.
//!
//! All angles are sums of sines of the step phase (two steps: 2π) and of slow times of the person's own, so that every
//! coordinate is smooth. Angles of arms and legs are forward of hanging straight down.

use std::f64::consts::TAU;

use foveate_estimation::random::Random;

/// Length of two steps at 1 m/s [m]; people lengthen their steps with the root of their speed.
const STRIDE_AT_1_M_S: f64 = 1.3;

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Gait {
    /// Length of two steps [m].
    stride: f64,
    /// Swing of arms and legs relative to that at 1 m/s.
    vigour: f64,
    /// Of gestures and looks [rad].
    phases: [f64; 4],
    /// How fast gestures come [rad/s].
    gesture_rates: [f64; 2],
    /// How far arms are raised in gestures, relative to fully.
    gestures: f64,
}

/// Joint angles at one time [rad] unless noted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Joints {
    /// Body above its mean height [m].
    pub rise: f64,
    /// Body to the left of its mean place [m].
    pub sway: f64,
    /// Shoulders, counter-clockwise from above.
    pub twist: f64,
    /// Head, counter-clockwise from above.
    pub look: f64,
    /// Head, forward and down.
    pub nod: f64,
    /// Head, to the right shoulder.
    pub tilt: f64,
    /// Upper arms, left and right.
    pub arms: [f64; 2],
    /// Elbows, 0 straight.
    pub elbows: [f64; 2],
    /// Upper arms away from the body.
    pub spread: [f64; 2],
    /// Thighs.
    pub thighs: [f64; 2],
    /// Knees, 0 straight.
    pub knees: [f64; 2],
}

impl Gait {
    pub fn new(speed: f64, random: &mut Random) -> Self {
        let vigour = speed.sqrt();
        Self {
            stride: STRIDE_AT_1_M_S * vigour * random.uniform_in(0.92, 1.08),
            vigour: vigour.min(1.2) * random.uniform_in(0.9, 1.1),
            phases: [(); 4].map(|()| random.uniform_in(0.0, TAU)),
            gesture_rates: [(); 2].map(|()| random.uniform_in(0.35, 0.55)),
            gestures: 1.0,
        }
    }

    /// As [`Self::new`], arms never raised before the face.
    pub fn without_gestures(speed: f64, random: &mut Random) -> Self {
        Self { gestures: 0.0, ..Self::new(speed, random) }
    }

    /// After `way` metres, at `time_s` seconds.
    pub fn joints(&self, way: f64, time_s: f64) -> Joints {
        let phase = TAU * way / self.stride;
        let (sine, cosine) = phase.sin_cos();
        let swing = 0.42 * self.vigour;
        let gestures = [0, 1].map(|side| self.gestures * bump(self.gesture_rates[side] * time_s + self.phases[side]));
        let wave = (4.5 * time_s + self.phases[2]).sin();
        let side = |side: usize, sine: f64| {
            let lifted = gestures[side];
            let calm = 1.0 - lifted;
            let arm = calm * (0.05 - swing * sine) + lifted * (1.25 + 0.1 * wave);
            let elbow = calm * (0.42 - 0.22 * self.vigour * sine) + lifted * (0.75 + 0.3 * wave);
            (arm, elbow, 0.16 + 0.2 * lifted)
        };
        let (left, right) = (side(0, sine), side(1, -sine));
        let thigh = 0.4 * self.vigour;
        let knee = |cosine: f64| 0.3 + 0.28 * self.vigour * cosine;
        Joints {
            rise: 0.018 * self.vigour * (2.0 * phase).cos(),
            sway: 0.02 * sine,
            twist: 0.12 * self.vigour * sine,
            look: 0.35 * (0.43 * time_s + self.phases[3]).sin() + 0.15 * (1.1 * time_s + self.phases[2]).sin(),
            nod: 0.0,
            tilt: 0.0,
            arms: [left.0, right.0],
            elbows: [left.1, right.1],
            spread: [left.2, right.2],
            thighs: [thigh * sine, -thigh * sine],
            knees: [knee(cosine), knee(-cosine)],
        }
    }
}

impl Joints {
    /// Between standing at ease (0) and walking as it is (1).
    pub fn calmed(mut self, vigour: f64) -> Joints {
        let towards = |rest: f64, it: f64| rest + (it - rest) * vigour;
        (self.rise, self.sway, self.twist) = (self.rise * vigour, self.sway * vigour, self.twist * vigour);
        self.arms = self.arms.map(|it| towards(0.05, it));
        self.elbows = self.elbows.map(|it| towards(0.25, it));
        self.thighs = self.thighs.map(|it| towards(0.0, it));
        self.knees = self.knees.map(|it| towards(0.03, it));
        self
    }
}

/// Smooth and 2π-periodic, from 0 to 1; near 0 most of the time.
fn bump(phase: f64) -> f64 {
    (0.5 + 0.5 * phase.sin()).powi(8)
}
