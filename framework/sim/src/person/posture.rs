//! The posture of a body at one time, from the built-in gait or a recording.

use nalgebra::Vector3;

use super::gait::Joints;

/// Directions of the limbs and what else [`body::pose`](super::body) asks for. Axes of a frame: x forward, y left, z up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Posture {
    /// Body above its mean height [m].
    pub rise: f64,
    /// Body to the left of its mean place [m].
    pub sway: f64,
    /// Shoulders, counter-clockwise from above [rad].
    pub twist: f64,
    /// Head, counter-clockwise from above [rad].
    pub look: f64,
    /// Head, forward and down [rad].
    pub nod: f64,
    /// Head, to the right shoulder [rad].
    pub tilt: f64,
    /// Upper arms and forearms, left and right, in the frame of the chest, of length 1.
    pub arms: [[Vector3<f64>; 2]; 2],
    /// Thighs and shanks, left and right, in the frame of the body, of length 1.
    pub legs: [[Vector3<f64>; 2]; 2],
}

/// Hanging down, swung forward by `angle` and out to the side `out` (+1 left, −1 right) by `spread` [rad].
fn limb(angle: f64, out: f64, spread: f64) -> Vector3<f64> {
    let (sine, cosine) = angle.sin_cos();
    let (spread_sine, spread_cosine) = spread.sin_cos();
    Vector3::new(sine * spread_cosine, out * spread_sine, -cosine * spread_cosine)
}

impl From<Joints> for Posture {
    fn from(joints: Joints) -> Self {
        let sides = [(0, 1.0), (1, -1.0)];
        let arm = |(side, out): (usize, f64)| {
            let (arm, spread) = (joints.arms[side], joints.spread[side]);
            [limb(arm, out, spread), limb(arm + joints.elbows[side], out, spread * 0.4)]
        };
        let leg = |(side, out): (usize, f64)| {
            let thigh = joints.thighs[side];
            [limb(thigh, out, 0.03), limb(thigh - joints.knees[side], out, 0.0)]
        };
        let Joints { rise, sway, twist, look, nod, tilt, .. } = joints;
        Self { rise, sway, twist, look, nod, tilt, arms: sides.map(arm), legs: sides.map(leg) }
    }
}

impl Posture {
    /// This one (share 0) or the body of another (1) or between, the head as it is.
    pub fn towards(mut self, other: &Posture, share: f64) -> Posture {
        let mix = |from: f64, to: f64| from + (to - from) * share;
        self.rise = mix(self.rise, other.rise);
        self.sway = mix(self.sway, other.sway);
        self.twist = mix(self.twist, other.twist);
        let limbs = self.arms.iter_mut().chain(&mut self.legs).flatten();
        for (it, other) in limbs.zip(other.arms.iter().chain(&other.legs).flatten()) {
            // Between opposite directions there is no way; hanging down then.
            *it = it.lerp(other, share).try_normalize(1e-9).unwrap_or(-Vector3::z());
        }
        self
    }
}
