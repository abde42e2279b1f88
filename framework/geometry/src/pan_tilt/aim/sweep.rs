//! All settings with a target in the middle of the image, by the angle of the fixed axis.
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `outer`, `inner` | the fixed axis, and the one that it carries | – |
//! | `d` | direction in the camera of the middle of the image | – |
//! | `x` | the target in the space of the camera at rest | m |
//! | `y(θ)` | `x` turned back by the outer angle θ | m |
//! | `λ` | distance from the lens to the target | m |
//!
//! The camera sees the target in the middle when some turn about the inner axis (through b, along w) takes λ d to
//! y(θ). Such a turn exists exactly when both are equally far from b and equally far along w:
//!
//! (a) |λ d − b| = |y(θ) − b|,  (b) w·(λ d − b) = w·(y(θ) − b).
//!
//! (a) gives λ for any θ. By (b), A + B cos θ + C sin θ = λ w·d, where the right side is nearly constant: w·d is zero for a tilt axis across
//! the line of sight, and λ varies only by as much as the axes miss one another. So θ comes from an arc cosine with two values, iterated until it
//! converges ([`Sweep::follow`]): the upright and the overturned solution. Where that fails, as with very unusual axes, (b) is sampled
//! over the whole turn ([`Sweep::scan`]); it has at most four solutions.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::{Obstacle, Search, Setting, Solution, VANISHING, nearest_turn};
use crate::pan_tilt::axis::Axis;

const MAX_ITERATIONS: u32 = 50;
/// Samples over the whole turn.
const SAMPLES: u32 = 128;
/// Of a sample's width this many halvings leave 1e-15 rad.
const HALVINGS: u32 = 45;
/// (b) holds when missed by no more than this part of λ.
const MISSED: f64 = 1e-7;

/// Equation (b) of one target, as a function of the outer angle.
pub(super) struct Sweep<'a> {
    search: &'a Search<'a>,
    outer: &'a Axis,
    outer_now: f64,
    inner: Axis,
    inner_now: f64,
    /// y(θ) − b = `fixed` + `across` cos θ + `turned` sin θ.
    fixed: Vector3<f64>,
    across: Vector3<f64>,
    turned: Vector3<f64>,
    /// A, B, C.
    along: [f64; 3],
    /// |y(θ) − b|² in the same form.
    squared: [f64; 3],
    b_squared: f64,
    /// d·b and d·w.
    d_along: [f64; 2],
}

/// An outer angle that solves (b), and after how many steps.
#[derive(Clone, Copy)]
pub(super) struct Outer {
    angle: f64,
    iterations: u32,
}

impl<'a> Sweep<'a> {
    pub fn new(search: &'a Search<'a>) -> Sweep<'a> {
        let [(outer, outer_now), (inner, inner_now)] = search.head.by_carrier([search.from.pan, search.from.tilt]);
        let inner = inner.footed_at(&nalgebra::Point3::origin());
        let (u, w, b) = (outer.direction.into_inner(), inner.direction.into_inner(), inner.point.coords);
        // y(θ) − a = R(−θ) q: along u, and across it with cos θ and −sin θ.
        let q = search.x - outer.point;
        let (across, turned) = (q - u * u.dot(&q), -u.cross(&q));
        let fixed = outer.point.coords + u * u.dot(&q) - b;
        // across² + turned² is the same at any θ.
        let squared =
            [fixed.norm_squared() + across.norm_squared(), 2.0 * fixed.dot(&across), 2.0 * fixed.dot(&turned)];
        Sweep {
            search,
            outer,
            outer_now,
            inner,
            inner_now,
            fixed,
            across,
            turned,
            along: [&fixed, &across, &turned].map(|it| w.dot(it)),
            squared,
            b_squared: b.norm_squared(),
            d_along: [&b, &w].map(|it| search.d.dot(it)),
        }
    }

    /// λ at an outer angle; `None` where the target is nearer to the inner axis than the lens.
    fn lambda(&self, angle: f64) -> Option<f64> {
        let root = self.d_along[0].powi(2) - self.b_squared + wave(&self.squared, angle);
        let found = self.d_along[0] + root.max(0.0).sqrt();
        (root > 0.0 && found > 0.0).then_some(found)
    }

    /// By how much (b) is missed, in terms of λ.
    fn missed(&self, angle: f64) -> Option<f64> {
        let lambda = self.lambda(angle)?;
        Some((lambda * self.d_along[1] - wave(&self.along, angle)) / lambda)
    }

    /// From the present angle, always to the arc cosine of that sign; `None` where this does not come to stand still at a solution.
    pub fn follow(&self, sign: f64) -> Option<Outer> {
        let (swing, phase) = (self.along[1].hypot(self.along[2]), self.along[2].atan2(self.along[1]));
        let mut angle = self.outer_now;
        let mut iterations = 0;
        if swing > VANISHING * self.lambda(angle)? {
            while iterations < MAX_ITERATIONS {
                let ratio = (self.lambda(angle)? * self.d_along[1] - self.along[0]) / swing;
                let next = nearest_turn(phase + sign * ratio.clamp(-1.0, 1.0).acos(), self.outer_now);
                let moved = (next - angle).abs();
                angle = next;
                iterations += 1;
                if moved < 1e-12 || (ratio.abs() > 1.0 + 1e-9 && iterations > 5) {
                    break;
                }
            }
        }
        (self.missed(angle)?.abs() <= MISSED).then_some(Outer { angle, iterations })
    }

    /// All solutions, by sampling the whole turn: where (b) changes its sign, and where it touches zero.
    pub fn scan(&self) -> [Option<Outer>; 4] {
        let step = TAU / f64::from(SAMPLES);
        let at = |it: u32| self.outer_now + step * (f64::from(it) - 0.5 * f64::from(SAMPLES));
        let mut found = [None; 4];
        let mut n = 0;
        let mut keep = |angle: f64| {
            if n < found.len() && self.missed(angle).is_some_and(|it| it.abs() <= MISSED) {
                let angle = nearest_turn(angle, self.outer_now);
                found[n] = Some(Outer { angle, iterations: SAMPLES + HALVINGS });
                n += 1;
            }
        };
        let mut window = [None, self.missed(at(0)), self.missed(at(1))];
        for it in 0..SAMPLES {
            window = [window[1], window[2], self.missed(at(it + 2))];
            let (Some(here), Some(next)) = (window[0], window[1]) else { continue };
            if (here > 0.0) != (next > 0.0) {
                keep(self.crossing(at(it), at(it + 1), here > 0.0));
                continue;
            }
            // Nearer to zero than both its neighbours: two solutions may hide about it, or one.
            let Some(after) = window[2] else { continue };
            if next.abs() <= here.abs() && next.abs() < after.abs() && (next > 0.0) == (after > 0.0) {
                let sign = if next > 0.0 { 1.0 } else { -1.0 };
                let turn = self.turning_point(at(it), at(it + 2), sign);
                match self.missed(turn) {
                    Some(beyond) if (beyond > 0.0) != (next > 0.0) => {
                        keep(self.crossing(at(it), turn, next > 0.0));
                        keep(self.crossing(turn, at(it + 2), next <= 0.0));
                    }
                    _ => keep(turn),
                }
            }
        }
        found
    }

    /// Where the sign changes between two angles.
    fn crossing(&self, mut low: f64, mut high: f64, is_positive_at_low: bool) -> f64 {
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.missed(middle).is_some_and(|it| (it > 0.0) == is_positive_at_low) {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }

    /// Where `sign` times what is missed is least between two angles.
    fn turning_point(&self, mut low: f64, mut high: f64, sign: f64) -> f64 {
        let cost = |angle: f64| self.missed(angle).map_or(f64::INFINITY, |it| sign * it);
        for _ in 0..2 * HALVINGS {
            let third = (high - low) / 3.0;
            if cost(low + third) <= cost(high - third) {
                high -= third;
            } else {
                low += third;
            }
        }
        0.5 * (low + high)
    }

    /// The inner angle that goes with an outer one.
    pub fn solution(&self, Outer { angle, iterations }: Outer) -> Option<Solution> {
        let distance = self.lambda(angle)?;
        let (sin, cos) = angle.sin_cos();
        let w = self.inner.direction.into_inner();
        let lens = self.search.d * distance - self.inner.point.coords;
        let target = self.fixed + self.across * cos + self.turned * sin;
        let [seen, wanted] = [lens, target].map(|it| it - w * w.dot(&it));
        let is_on_axis = seen.norm().min(wanted.norm()) < VANISHING * distance;
        let turn = w.dot(&seen.cross(&wanted)).atan2(seen.dot(&wanted));
        let inner_angle = if is_on_axis { self.inner_now } else { nearest_turn(turn, self.inner_now) };
        let [(_, pan), (_, tilt)] = self.search.head.by_carrier([angle, inner_angle]);
        Some(Solution { setting: Setting { pan, tilt, zoom: self.search.from.zoom }, distance, iterations })
    }

    /// Why there is no solution at all.
    pub fn obstacle(&self) -> Obstacle {
        let angle = self.outer.angle_to(&self.inner);
        if self.lambda(self.outer_now).is_none() {
            Obstacle::TooNear { distance: wave(&self.squared, self.outer_now).max(0.0).sqrt() }
        } else if angle < 1e-6 {
            Obstacle::ParallelAxes { angle }
        } else {
            Obstacle::NearAxis { distance: self.across.norm() }
        }
    }
}

/// A + B cos θ + C sin θ.
#[inline]
fn wave(of: &[f64; 3], angle: f64) -> f64 {
    let (sin, cos) = angle.sin_cos();
    of[0] + of[1] * cos + of[2] * sin
}
