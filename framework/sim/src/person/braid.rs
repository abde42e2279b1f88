//! A closed path with crossings that many people walk at once, each in a place of its own, without ever meeting: the strands of a
//! braid.
//!
//! p(θ) = (W/2 (cos aθ + h cos bθ), D/2 (sin aθ + h sin bθ)) / (1 + h), with whole a and b: |a − b| tips touch the border of the
//! ellipse in the area W × D, and the lobes between them cross. Of `slots` people at even distances in θ the nearest two
//! come as near as [`Braid::nearest_m`], found by trying; [`Braid::new`] takes the braid in which that is just above what was asked
//! for, so that people pass each other closely and do not stand in one another.

use std::f64::consts::TAU;

use nalgebra::{Point2, Vector2};

/// a and b of the paths that are tried: all cross themselves.
const ORDERS: [[f64; 2]; 14] = [
    [2.0, -1.0],
    [1.0, -2.0],
    [3.0, -1.0],
    [3.0, -2.0],
    [2.0, -3.0],
    [1.0, 3.0],
    [1.0, 4.0],
    [4.0, -1.0],
    [3.0, -4.0],
    [4.0, -3.0],
    [2.0, 3.0],
    [2.0, 5.0],
    [5.0, -2.0],
    [5.0, -3.0],
];
/// h of the paths that are tried.
const SHARES: [f64; 4] = [0.3, 0.45, 0.6, 0.8];
/// Places beyond the number of people that a braid may have: some numbers of strands fit a path better than others.
const MOST_SPARE: usize = 4;
/// Points of a path that are looked at, at least: on the whole of it, and between one place and the next.
const SAMPLES: usize = 960;
const SAMPLES_A_SLOT: usize = 24;
/// Least speed of a person, as a share of the mean speed.
const SLOWEST: f64 = 0.3;
/// Largest turn of a person in a metre [rad/m].
const SHARPEST: f64 = 3.5;

/// A path and how many places it has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Braid {
    orders: [f64; 2],
    share: f64,
    half_axes: [f64; 2],
    /// Places at even distances in θ.
    pub slots: usize,
    /// How near two people come to each other, middle to middle [m].
    pub nearest_m: f64,
}

/// p, dp/dθ and d²p/dθ² at one θ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PathPoint {
    pub position: Point2<f64>,
    pub tangent: Vector2<f64>,
    pub bend: Vector2<f64>,
}

impl Braid {
    /// For `n_people` in an area of `area_m`, who come at least `closest_m` near to each other, but hardly nearer.
    ///
    /// # Errors
    /// How near they would come at best, where that is less than `closest_m` [m].
    pub fn new(n_people: usize, area_m: [f64; 2], closest_m: f64) -> Result<Braid, f64> {
        let mut tightest: Option<Braid> = None;
        let mut widest = 0.0_f64;
        for slots in n_people.max(1)..n_people.max(1) + MOST_SPARE {
            for (orders, share) in ORDERS.into_iter().flat_map(|orders| SHARES.map(|share| (orders, share))) {
                let mut braid =
                    Braid { orders, share, half_axes: area_m.map(|it| it / 2.0), slots, nearest_m: f64::INFINITY };
                if !braid.can_be_walked() {
                    continue;
                }
                braid.nearest_m = braid.nearest();
                widest = widest.max(braid.nearest_m);
                let fits = braid.nearest_m >= closest_m;
                if fits && tightest.is_none_or(|it| braid.nearest_m < it.nearest_m) {
                    tightest = Some(braid);
                }
            }
        }
        tightest.ok_or(widest)
    }

    /// How many tips touch the border.
    pub fn n_tips(&self) -> usize {
        (self.orders[0] - self.orders[1]).abs() as usize
    }

    pub(super) fn at(&self, theta: f64) -> PathPoint {
        let [[s_a, c_a], [s_b, c_b]] = self.orders.map(|order| {
            let (sine, cosine) = (order * theta).sin_cos();
            [sine, cosine]
        });
        let ([a, b], h) = (self.orders, self.share);
        let [x, y] = self.half_axes.map(|it| it / (1.0 + h));
        PathPoint {
            position: Point2::new(x * (c_a + h * c_b), y * (s_a + h * s_b)),
            tangent: Vector2::new(-x * (a * s_a + h * b * s_b), y * (a * c_a + h * b * c_b)),
            bend: Vector2::new(-x * (a * a * c_a + h * b * b * c_b), -y * (a * a * s_a + h * b * b * s_b)),
        }
    }

    fn can_be_walked(&self) -> bool {
        let points: Vec<PathPoint> = (0..360).map(|i| self.at(TAU * f64::from(i) / 360.0)).collect();
        let mean = points.iter().map(|it| it.tangent.norm()).sum::<f64>() / 360.0;
        points.iter().all(|PathPoint { tangent, bend, .. }| {
            let speed = tangent.norm();
            speed > SLOWEST * mean && tangent.perp(bend).abs() < SHARPEST * speed.powi(3)
        })
    }

    fn nearest(&self) -> f64 {
        let a_slot = SAMPLES.div_ceil(self.slots).max(SAMPLES_A_SLOT);
        let n = self.slots * a_slot;
        let points: Vec<Point2<f64>> = (0..n).map(|i| self.at(TAU * i as f64 / n as f64).position).collect();
        let mut nearest = f64::INFINITY;
        for apart in 1..=self.slots / 2 {
            let shift = apart * a_slot;
            for i in 0..n {
                nearest = nearest.min((points[i] - points[(i + shift) % n]).norm_squared());
            }
        }
        nearest.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_come_as_near_as_asked_and_no_nearer() {
        for (n, area) in [(2, [2.5, 4.0]), (4, [2.5, 4.0]), (8, [2.5, 4.0]), (32, [8.0, 10.0])] {
            let braid = Braid::new(n, area, 0.6).unwrap();
            let mut nearest = f64::INFINITY;
            for step in 0..5000 {
                let theta = TAU * f64::from(step) / 5000.0;
                let place = |slot: usize| braid.at(theta + TAU * slot as f64 / braid.slots as f64).position;
                (1..braid.slots).for_each(|slot| nearest = nearest.min((place(slot) - place(0)).norm()));
            }
            assert!((0.59..0.95).contains(&nearest), "{n} people come as near as {nearest} m: {braid:?}");
            assert!((nearest - braid.nearest_m).abs() < 0.01, "{nearest} {braid:?}");
        }
    }

    #[test]
    fn too_many_for_the_area_are_told_how_near_they_would_come() {
        let best = Braid::new(32, [2.5, 4.0], 0.6).unwrap_err();
        assert!((0.1..0.6).contains(&best), "{best}");
    }

    #[test]
    fn tips_lie_on_the_border_and_derivatives_are_right() {
        let braid = Braid::new(8, [5.0, 7.0], 0.6).unwrap();
        for tip in 0..braid.n_tips() {
            let point = braid.at(TAU * tip as f64 / braid.n_tips() as f64).position;
            assert!(((point.x / 2.5).powi(2) + (point.y / 3.5).powi(2) - 1.0).abs() < 1e-12, "{point}");
        }
        let step = 1e-5;
        for i in 0..100 {
            let theta = f64::from(i) * 0.07;
            let [before, here, after] = [-step, 0.0, step].map(|it| braid.at(theta + it));
            let tangent = (after.position - before.position) / (2.0 * step);
            let bend = (after.tangent - before.tangent) / (2.0 * step);
            assert!((tangent - here.tangent).norm() < 1e-6 && (bend - here.bend).norm() < 1e-6);
        }
    }
}
