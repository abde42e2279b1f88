//! An actor on a stage: comes in from the back, stands there facing +Y, then walks to and fro across it.
//!
//! Across: x = A asin(k sin φ) / asin k, a wave between straight lines and a sine, so that the pace is even but for the turns, with a
//! phase φ that starts smoothly. The body turns towards where it goes, the head less than half as far, so that a face is seen from +Y
//! nearly always.

use std::f64::consts::TAU;

use foveate_estimation::random::Random;
use nalgebra::{Point2, Vector2};

use super::gait::{Gait, Joints};
use super::walk::Place;

/// From the first moment until the actor stands [s].
pub const COME_S: f64 = 2.5;
/// From how far back [m].
const COME_M: f64 = 1.6;
/// k above: 0 is a sine, 1 has corners.
const SHARPNESS: f64 = 0.85;
/// Towards the front and back while walking [m].
const DEPTH_M: f64 = 0.15;
/// Until the pace is reached [s].
const START_S: f64 = 1.2;
/// How far the body turns to where it goes [rad].
const TURN: f64 = 0.87;
/// How much of that the head joins in.
const HEAD_SHARE: f64 = 0.35;
/// From bending a knee once to bending it again, for who shows it [s].
const KNEE_S: f64 = 2.4;
/// Width and height of the sway of who stands [m].
const SWAY_M: [f64; 2] = [0.012, 0.008];

/// Where an actor is, and how.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stage {
    enter_s: f64,
    stand_s: f64,
    /// A above [m].
    half_m: f64,
    /// dφ/dt at full pace [rad/s].
    omega: f64,
    /// To the actor's left first, or right.
    sign: f64,
    shows_knee: bool,
    phases: [f64; 8],
}

impl Stage {
    /// Comes in at `enter_s`, stays still during `stand_s`, then walks over `width_m` at `speed` on average [m/s].
    pub fn new(enter_s: f64, stand_s: f64, width_m: f64, speed: f64, shows_knee: bool, random: &mut Random) -> Self {
        let half_m = width_m / 2.0;
        let sign = if random.below(2) == 0 { 1.0 } else { -1.0 };
        let omega = TAU * speed / (4.0 * half_m);
        let phases = [(); 8].map(|()| random.uniform_in(0.0, TAU));
        Self { enter_s, stand_s, half_m, omega, sign, shows_knee, phases }
    }

    /// Place, joints and how much the actor walks (0: stands, 1: walks) at `time_s`; before the first moment those of the first moment.
    pub fn at(&self, gait: &Gait, time_s: f64) -> (Place, Joints, f64) {
        let since = (time_s - self.enter_s).max(0.0);
        let walked = (since - COME_S - self.stand_s).max(0.0);
        let phase = self.omega * eased(walked);
        let (sine, cosine) = phase.sin_cos();
        let across = (SHARPNESS * sine).asin() / SHARPNESS.asin();
        // dx/dt over its highest value.
        let pace = self.sign * cosine / (1.0 - (SHARPNESS * sine).powi(2)).sqrt();
        let walks = smooth(walked / START_S);
        let comes = 1.0 - smooth((since - COME_S + 0.9) / 0.9);
        let turn = -TURN * pace * walks;

        let sway = |rate: f64, place: usize| (rate * time_s + self.phases[place]).sin();
        let back = COME_M * (1.0 - smoother(since / COME_S));
        let position = Point2::new(
            self.sign * self.half_m * across + SWAY_M[0] * sway(0.9, 0),
            DEPTH_M * (0.73 * phase).sin() - back + SWAY_M[1] * sway(0.71, 1),
        );
        // Steps go on through the turns, shorter.
        let way = self.half_m * (4.0 / TAU) * phase - back;
        let vigour = (comes + walks * (0.35 + 0.65 * pace * pace)).min(1.0);

        let looks = 0.06 + 0.94 * walks;
        let look = looks * (0.30 * sway(0.83, 2) + 0.13 * sway(2.1, 3)) + 0.04 * sway(0.5, 4);
        let mut joints = gait.joints(way, time_s).calmed(vigour);
        joints.look = look - (1.0 - HEAD_SHARE) * turn;
        joints.nod = looks * (0.12 * sway(1.07, 5) + 0.07 * sway(2.9, 6)) + 0.03 * sway(0.62, 3);
        joints.tilt = looks * 0.06 * sway(0.77, 7) + 0.02 * sway(0.43, 2);
        if self.shows_knee {
            let stood = (since - COME_S).max(0.0);
            let shows = smooth(stood) * smooth(self.stand_s - stood);
            let bend = shows * (0.5 - 0.5 * (TAU * stood / KNEE_S).cos());
            joints.thighs[1] += 0.55 * bend;
            joints.knees[1] += 0.95 * bend;
        }
        let (turned, ahead) = turn.sin_cos();
        (Place { position, forward: Vector2::new(-turned, ahead), way }, joints, vigour)
    }
}

/// From 0 to 1 where `x` does, with slopes 0 at both ends.
fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// As [`smooth`], with curvatures 0 too.
fn smoother(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (10.0 + x * (6.0 * x - 15.0))
}

/// ∫ of a speed that rises smoothly to 1 over [`START_S`] [s].
fn eased(walked_s: f64) -> f64 {
    let x = walked_s / START_S;
    if x < 1.0 { START_S * (x * x * x - x * x * x * x / 2.0) } else { walked_s - START_S / 2.0 }
}
