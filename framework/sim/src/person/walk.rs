//! The path on the floor: closed, smooth, with turns to both sides.
//!
//! p(θ) = (a ρ cos θ, b ρ sin θ) with ρ = 1 + e cos(3θ + φ): three lobes, e large enough for the path to turn both ways.
//! θ = ω t runs evenly, so the person slows down where the path bends. The way walked,
//! s(θ) = ∫ |dp/dθ| dθ = s₀ θ + Σₖ (cₖ sin kθ + dₖ (1 − cos kθ)), is kept as a Fourier series; it drives the steps.

use std::f64::consts::TAU;

use foveate_estimation::random::Random;
use nalgebra::{Point2, Vector2};

/// Half the extent of the path across and along the room, before lobes [m].
const HALF_AXES: [f64; 2] = [1.0, 1.55];
/// e above.
const LOBES: f64 = 0.2;
/// Harmonics kept of the way walked; the next one is below a millimetre.
const N_HARMONICS: usize = 16;

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Walk {
    /// θ at time 0 [rad].
    start: f64,
    /// dθ/dt [rad/s].
    omega: f64,
    /// φ [rad].
    lobe_phase: f64,
    /// s₀ [m/rad].
    mean_stretch: f64,
    /// cₖ and dₖ for k = 1, 2, … [m].
    harmonics: [[f64; 2]; N_HARMONICS],
}

/// Where the person is on the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// [m]
    pub position: Point2<f64>,
    /// Direction of walking, of length 1.
    pub forward: Vector2<f64>,
    /// Way walked since θ = 0 [m].
    pub way: f64,
}

impl Walk {
    /// Starts at `share` of the round (0 to 1), at `speed` on average [m/s].
    pub fn new(share: f64, speed: f64, random: &mut Random) -> Self {
        let mut walk = Self {
            start: random.uniform_in(0.0, TAU) + share * TAU,
            omega: 0.0,
            lobe_phase: random.uniform_in(0.0, TAU),
            mean_stretch: 0.0,
            harmonics: [[0.0; 2]; N_HARMONICS],
        };
        const N: usize = 512;
        for i in 0..N {
            let theta = TAU * i as f64 / N as f64;
            let stretch = walk.on_path(theta).1.norm();
            walk.mean_stretch += stretch / N as f64;
            for (k, [sine, cosine]) in walk.harmonics.iter_mut().enumerate() {
                let order = (k + 1) as f64;
                *sine += 2.0 / N as f64 / order * stretch * (order * theta).cos();
                *cosine += 2.0 / N as f64 / order * stretch * (order * theta).sin();
            }
        }
        walk.omega = speed / walk.mean_stretch;
        walk
    }

    pub fn at(&self, time_s: f64) -> Place {
        let theta = self.start + self.omega * time_s;
        let (position, tangent) = self.on_path(theta);
        let (sine_1, cosine_1) = theta.sin_cos();
        let (mut sine, mut cosine) = (0.0, 1.0);
        let mut way = self.mean_stretch * theta;
        for [c, d] in self.harmonics {
            (sine, cosine) = (sine * cosine_1 + cosine * sine_1, cosine * cosine_1 - sine * sine_1);
            way += c * sine + d * (1.0 - cosine);
        }
        Place { position, forward: tangent.normalize(), way }
    }

    /// p and dp/dθ.
    fn on_path(&self, theta: f64) -> (Point2<f64>, Vector2<f64>) {
        let [a, b] = HALF_AXES;
        let (sine, cosine) = theta.sin_cos();
        let (lobe_sine, lobe_cosine) = (3.0 * theta + self.lobe_phase).sin_cos();
        let radius = 1.0 + LOBES * lobe_cosine;
        let slope = -3.0 * LOBES * lobe_sine;
        let position = Point2::new(a * radius * cosine, b * radius * sine);
        (position, Vector2::new(a * (slope * cosine - radius * sine), b * (slope * sine + radius * cosine)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn way_grows_as_fast_as_the_position_moves() {
        let walk = Walk::new(0.3, 1.0, &mut Random::new(9));
        for step in 0..500 {
            let time = f64::from(step) * 0.05;
            let (before, after) = (walk.at(time - 1e-4), walk.at(time + 1e-4));
            let moved = (after.position - before.position).norm();
            assert!((after.way - before.way - moved).abs() < 0.01 * moved, "at {time} s");
            assert!((after.position - before.position).normalize().dot(&walk.at(time).forward) > 0.999_999);
        }
    }
}
