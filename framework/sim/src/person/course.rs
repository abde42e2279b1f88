//! Which part of a recording is repeated, and where on the floor, so that nothing jumps and the body stays within an area.
//!
//! **Laps.** The longest stretch of a recording is taken whose end is like its beginning; its last quarter of a second is blended into what led up to the beginning, steps and turns
//! included. One lap then moves the body by a motion L of the floor. If L turns by 2π j/K, the K-th lap ends where the first began, and no sooner: so the turn that L lacks is added evenly
//! over the lap, for the K that needs least of it and keeps within the area. With K = 1 the shift that is left over is taken back evenly.
//!
//! **To and fro.** Where no stretch does, the longest that keeps within the area is gone through forwards and backwards. In the last w seconds before an end time slows down,
//! |t| ↦ w (3/8 + 3/4 (t/w)² − 1/8 (t/w)⁴), so that position, velocity and acceleration go on.
//!
//! Between the frames stands a uniform cubic B-spline that passes through them (M. Unser, A. Aldroubi, M. Eden, "B-spline signal processing", 1993; its coefficients by iteration).

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry2, Translation2, UnitComplex, Vector2};

use super::joints::N_JOINTS;
use super::whole::{Channels, Moment, moved};

/// The shortest lap [s], and what part of the recording it must be at least.
const SHORTEST_LAP_S: f64 = 1.0;
const LEAST_PART: f64 = 0.4;
/// How long the end is blended into the beginning [s].
const BLEND_S: f64 = 0.25;
/// Joints of both may differ by this, root of the mean square [m].
const ALIKE_M: f64 = 0.08;
/// A body is turned by no more than this to come back [rad/s], and shifted by no more [m/s].
const MOST_TURN: f64 = 0.8;
const MOST_SHIFT: f64 = 0.2;
/// Laps until the body is where it was, at most.
const MOST_LAPS: i32 = 12;
/// So many stretches are tried, the longest first.
const MOST_TRIED: usize = 400;
/// w above [s].
const SLOW_DOWN_S: f64 = 0.3;
/// Headings that are tried in the area.
const N_HEADINGS: usize = 24;
/// How often the coefficients are corrected: each time two thirds of their error are left at most.
const N_CORRECTIONS: usize = 40;

/// A way to go on for ever.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Course {
    rate_hz: f64,
    /// Of the spline, seen from the middle of the way.
    coefficients: Vec<Channels>,
    kind: Kind,
    /// Headings under which there is room [rad], and the shift that makes it.
    headings: Vec<(f64, Vector2<f64>)>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// Each lap is turned by `turn` [rad] about the origin against the one before; so many bring it back.
    Laps { turn: f64, count: i32 },
    /// Slowing down for so long at either end [s].
    ToAndFro { slow_s: f64 },
}

impl Course {
    /// Of a recording `rate_hz` times a second, for an area of `area_m`.
    ///
    /// # Errors
    /// A sentence where there is no room for it.
    pub fn new(moments: &[Moment], rate_hz: f64, area_m: [f64; 2]) -> Result<Self, String> {
        Self::laps(moments, rate_hz, area_m).or_else(|| Self::to_and_fro(moments, rate_hz, area_m)).ok_or_else(|| {
            let [x, y] = area_m;
            format!(
                "found a body that leaves an area of {x:.2} m × {y:.2} m (half a metre kept clear around each person) before it can turn, expected a larger \
                 `walk_area_m`, or a file whose unit of length and frame time, in seconds, are right"
            )
        })
    }

    /// From one time to the next that everything is as it was [s].
    pub fn period_s(&self) -> f64 {
        let length_s = self.coefficients.len() as f64 / self.rate_hz;
        match self.kind {
            Kind::Laps { count, .. } => length_s * f64::from(count),
            Kind::ToAndFro { .. } => 2.0 * self.open_s(),
        }
    }

    /// From the first moment to the last [s].
    fn open_s(&self) -> f64 {
        (self.coefficients.len() - 1) as f64 / self.rate_hz
    }

    /// All that moves at `time_s`, seen from the world's origin.
    pub fn at(&self, time_s: f64, [begins, faces]: [f64; 2], centre: Vector2<f64>) -> Channels {
        let time_s = (time_s + begins * self.period_s()).rem_euclid(self.period_s());
        let at = self.rate_hz
            * match self.kind {
                Kind::Laps { .. } => time_s,
                Kind::ToAndFro { slow_s } => {
                    let end_s = self.open_s();
                    // From the beginning, and mirrored from the end.
                    let from = |turn_s: f64| softened(time_s - turn_s, slow_s);
                    if time_s < end_s / 2.0 {
                        from(0.0)
                    } else if time_s < 1.5 * end_s {
                        end_s - from(end_s)
                    } else {
                        from(2.0 * end_s)
                    }
                }
            };
        let (index, u) = (at.floor() as i64, at - at.floor());
        let v = 1.0 - u;
        // The blending functions of the uniform cubic B-spline.
        let weights = [v * v * v, 3.0 * u * u * u - 6.0 * u * u + 4.0, 3.0 * v * v * v - 6.0 * v * v + 4.0, u * u * u];
        let mut channels = Channels::zeros();
        for (k, weight) in (-1..).zip(weights) {
            channels += self.coefficient(index + k) * (weight / 6.0);
        }
        let place = ((faces * self.headings.len() as f64) as usize).min(self.headings.len() - 1);
        let (heading, shift) = self.headings[place];
        moved(&channels, &Isometry2::from_parts(Translation2::from(shift + centre), UnitComplex::new(heading)))
    }

    fn coefficient(&self, index: i64) -> Channels {
        coefficient(&self.coefficients, self.kind, index)
    }

    fn laps(moments: &[Moment], rate_hz: f64, area_m: [f64; 2]) -> Option<Self> {
        let blend = (BLEND_S * rate_hz).ceil() as usize;
        let shortest =
            ((SHORTEST_LAP_S * rate_hz) as usize).max((moments.len() as f64 * LEAST_PART) as usize).max(blend);
        let last = moments.len().checked_sub(1)?;
        let difference = |a: usize, b: usize| {
            let joints = |at: usize| moments[at].channels.fixed_rows::<{ 3 * N_JOINTS }>(0);
            let behind = [0, blend / 2, blend];
            let squares = behind.map(|it| (joints(a - it) - joints(b - it)).norm_squared() / N_JOINTS as f64);
            squares.iter().sum::<f64>() / 3.0
        };
        // Every other frame of a long recording: there are as many pairs as frames squared.
        let stride = 1 + moments.len() / 600;
        let starts = (blend..last).step_by(stride);
        let pairs = starts.flat_map(|from| (from + shortest..=last).step_by(stride).map(move |to| [from, to]));
        let mut alike: Vec<[usize; 2]> =
            pairs.filter(|[from, to]| difference(*from, *to) < ALIKE_M * ALIKE_M).collect();
        alike.sort_by_key(|[from, to]| (std::cmp::Reverse(to - from), *from));
        alike.into_iter().take(MOST_TRIED).find_map(|[from, to]| Self::lap(moments, [from, to], blend, rate_hz, area_m))
    }

    /// The lap from one moment to another, if it can be closed within the area.
    fn lap(moments: &[Moment], [from, to]: [usize; 2], blend: usize, rate_hz: f64, area_m: [f64; 2]) -> Option<Self> {
        let n = to - from;
        let step = |at: usize| moments[at].place.inv_mul(&moments[at + 1].place);
        let share = |k: usize| {
            (k + blend).checked_sub(n).map(|j| (from - blend + j, smooth((j + 1) as f64 / (blend + 1) as f64)))
        };
        let mut steps: Vec<(Vector2<f64>, f64)> = Vec::with_capacity(n);
        let mut bodies = Vec::with_capacity(n);
        for k in 0..n {
            let (own, body) = (step(from + k), moments[from + k].channels);
            let (mut shift, mut turn) = (own.translation.vector, own.rotation.angle());
            bodies.push(match share(k) {
                None => body,
                Some((before, share)) => {
                    let other = step(before);
                    shift = shift.lerp(&other.translation.vector, share);
                    turn += (other.rotation.angle() - turn) * share;
                    body.lerp(&moments[before].channels, share)
                }
            });
            steps.push((shift, turn));
        }
        let turned: f64 = steps.iter().map(|it| it.1).sum();
        let length_s = n as f64 / rate_hz;
        let mut ways: Vec<(f64, i32, f64)> = (1..=MOST_LAPS)
            .flat_map(|count| (0..count).filter(move |&j| common(j, count) == 1).map(move |j| (j, count)))
            .map(|(j, count)| {
                let turn = TAU * f64::from(j) / f64::from(count);
                (turn, count, (turn - turned + PI).rem_euclid(TAU) - PI)
            })
            .filter(|it| it.2.abs() <= MOST_TURN * length_s)
            .collect();
        ways.sort_by(|a, b| a.2.abs().total_cmp(&b.2.abs()));
        ways.into_iter().find_map(|(turn, count, lacks)| {
            let mut places = Vec::with_capacity(n);
            let mut place = Isometry2::identity();
            for (shift, own) in &steps {
                places.push(place);
                let turn = own + lacks / n as f64;
                // Half of the turn on either side of the step: an arc's chord.
                place *= Isometry2::new(Vector2::zeros(), lacks / n as f64 / 2.0)
                    * Isometry2::new(*shift, turn - lacks / n as f64 / 2.0);
            }
            let left_over = place.translation.vector;
            let centre = if count == 1 {
                if left_over.norm() > MOST_SHIFT * length_s {
                    return None;
                }
                for (k, it) in places.iter_mut().enumerate() {
                    it.translation.vector -= left_over * (k as f64 / n as f64);
                }
                Vector2::zeros()
            } else {
                // c = L c.
                let rotation = UnitComplex::new(turn).to_rotation_matrix().into_inner();
                (nalgebra::Matrix2::identity() - rotation).try_inverse()? * left_over
            };
            places.iter_mut().for_each(|it| it.translation.vector -= centre);
            let laps = (0..count).flat_map(|lap| {
                let turned = UnitComplex::new(turn * f64::from(lap));
                places.iter().map(move |it| turned * it.translation.vector)
            });
            let headings = headings(&laps.collect::<Vec<_>>(), area_m);
            if headings.is_empty() {
                return None;
            }
            let samples: Vec<Channels> = bodies.iter().zip(&places).map(|(body, place)| moved(body, place)).collect();
            let kind = Kind::Laps { turn, count };
            Some(Self { rate_hz, coefficients: coefficients(&samples, kind), kind, headings })
        })
    }

    /// There and back over the longest stretch that keeps within the area.
    fn to_and_fro(moments: &[Moment], rate_hz: f64, area_m: [f64; 2]) -> Option<Self> {
        let places: Vec<Vector2<f64>> = moments.iter().map(|it| it.place.translation.vector).collect();
        let shortest = ((SHORTEST_LAP_S * rate_hz / 2.0) as usize).min(moments.len());
        let fitting = |from: usize, to: usize| headings(&places[from..to], area_m);
        // What fits from one start on grows with neither end alone: the end never has to go back when the start goes on.
        let (mut longest, mut end) = ([0, 0], 0);
        for from in 0..places.len() {
            end = end.max(from);
            while end < places.len() && !fitting(from, end + 1).is_empty() {
                end += 1;
            }
            if end - from > longest[1] - longest[0] {
                longest = [from, end];
            }
        }
        let [from, to] = longest;
        if to - from < shortest.max(4) {
            return None;
        }
        let headings = fitting(from, to);
        let samples: Vec<Channels> = moments[from..to].iter().map(|it| moved(&it.channels, &it.place)).collect();
        let open_s = (samples.len() - 1) as f64 / rate_hz;
        let kind = Kind::ToAndFro { slow_s: SLOW_DOWN_S.min(open_s / 2.0) };
        Some(Self { rate_hz, coefficients: coefficients(&samples, kind), kind, headings })
    }

    /// Times at which laps begin, or the direction of time reverses [s], for a person who starts at the beginning.
    #[cfg(test)]
    pub fn seams_s(&self) -> Vec<f64> {
        match self.kind {
            Kind::Laps { count, .. } => {
                (0..=count).map(|lap| self.period_s() * f64::from(lap) / f64::from(count)).collect()
            }
            Kind::ToAndFro { .. } => vec![0.0, self.open_s(), 2.0 * self.open_s()],
        }
    }
}

fn coefficient(all: &[Channels], kind: Kind, index: i64) -> Channels {
    let n = all.len() as i64;
    match kind {
        Kind::Laps { turn, .. } => {
            let (lap, place) = (index.div_euclid(n), index.rem_euclid(n) as usize);
            if lap == 0 {
                return all[place];
            }
            moved(&all[place], &Isometry2::new(Vector2::zeros(), turn * lap as f64))
        }
        Kind::ToAndFro { .. } => all[index.clamp(0, n - 1) as usize],
    }
}

/// Of the spline that passes through `samples`.
fn coefficients(samples: &[Channels], kind: Kind) -> Vec<Channels> {
    let mut found = samples.to_vec();
    for _ in 0..N_CORRECTIONS {
        let smoothed = (0..samples.len() as i64).map(|index| {
            let [before, here, behind] = [-1, 0, 1].map(|it| coefficient(&found, kind, index + it));
            (before + here * 4.0 + behind) / 6.0
        });
        let corrected = found.iter().zip(samples).zip(smoothed).map(|((it, sample), smoothed)| it + sample - smoothed);
        found = corrected.collect();
    }
    found
}

/// Headings under which `places` keep within an area of `area_m` around the origin, and the shifts that make them.
fn headings(places: &[Vector2<f64>], area_m: [f64; 2]) -> Vec<(f64, Vector2<f64>)> {
    let fits = |number: usize| {
        let heading = TAU * number as f64 / N_HEADINGS as f64;
        let turn = UnitComplex::new(heading);
        let mut corners = [Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY)];
        for place in places {
            let turned = turn * place;
            corners = [corners[0].inf(&turned), corners[1].sup(&turned)];
        }
        let extent = corners[1] - corners[0];
        (extent.x <= area_m[0] && extent.y <= area_m[1]).then(|| (heading, -(corners[0] + corners[1]) / 2.0))
    };
    (0..N_HEADINGS).filter_map(fits).collect()
}

/// |t|, rounded off within `slow` of 0.
fn softened(t: f64, slow: f64) -> f64 {
    let x = t.abs() / slow;
    if x < 1.0 { slow * (0.375 + 0.75 * x * x - 0.125 * x * x * x * x) } else { t.abs() }
}

/// The largest number that divides both; for 0 and 1 it is 1.
fn common(a: i32, b: i32) -> i32 {
    if b == 0 { a } else { common(b, a % b) }
}

/// From 0 to 1 where `x` does, with slopes 0 at both ends.
fn smooth(x: f64) -> f64 {
    x * x * (3.0 - 2.0 * x)
}
