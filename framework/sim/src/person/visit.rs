//! Coming in from outside and leaving again: smooth tracks between the surroundings and a tip of the path.
//!
//! A track is a polynomial of fifth degree in each coordinate that meets the path with its place, velocity and acceleration.

use nalgebra::{Point2, Vector2};

use super::braid::{Braid, PathPoint};

/// How far outside the path's border a track begins or ends [m].
const OUTSIDE_M: f64 = 1.4;

/// When a person walks on a path and when not. Visits begin and end at tips of the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Visits {
    /// When the path is joined for the first time [s].
    join_s: f64,
    /// θ at that time [rad].
    join_theta: f64,
    /// From joining to leaving the path [s]; infinite: for good.
    stay_s: f64,
    /// From one joining to the next [s]; infinite: there is none.
    cycle_s: f64,
    /// How long a track takes [s].
    track_s: f64,
}

/// What a person does at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Doing {
    /// Is on the path.
    Walks,
    /// Walks a track: seconds since its start, and θ of the tip.
    Comes(f64, f64),
    /// As before, away from the tip.
    Goes(f64, f64),
}

impl Visits {
    /// For the place at `start` [rad] at time 0 that moves with `omega` [rad/s], walking at `speed` [m/s]: joins at the first tip
    /// at which a track that begins at `enter_s` or later can end. `stay_s` and `away_s` are least times; 0: for good, and never again.
    pub fn new(braid: &Braid, start: f64, omega: f64, speed: f64, enter_s: f64, [stay_s, away_s]: [f64; 2]) -> Self {
        let between_tips = std::f64::consts::TAU / braid.n_tips() as f64;
        let track_s = OUTSIDE_M * 1.35 / speed;
        let tip = ((start + omega * (enter_s + track_s)) / between_tips).ceil();
        let a_tip_s = between_tips / omega;
        let tips = |least_s: f64| (least_s / a_tip_s).ceil().max(1.0) * a_tip_s;
        let stay_s = if stay_s > 0.0 { tips(stay_s) } else { f64::INFINITY };
        let cycle_s = if away_s > 0.0 { stay_s + tips(away_s.max(2.5 * track_s)) } else { f64::INFINITY };
        let join_theta = tip * between_tips;
        Self { join_s: (join_theta - start) / omega, join_theta, stay_s, cycle_s, track_s }
    }

    /// Which visit it is at `time_s`, counted from 0, and what is done; `None` while away. `omega` as for [`Self::new`].
    pub fn at(&self, time_s: f64, omega: f64) -> Option<(u32, Doing)> {
        let visit = ((time_s - self.join_s + self.track_s) / self.cycle_s).floor().max(0.0);
        let begun_s = if visit > 0.0 { visit * self.cycle_s } else { 0.0 };
        let since_join = time_s - self.join_s - begun_s;
        let theta = |since_first: f64| self.join_theta + omega * since_first;
        let doing = if since_join < -self.track_s {
            return None;
        } else if since_join < 0.0 {
            Doing::Comes(since_join + self.track_s, theta(begun_s))
        } else if since_join < self.stay_s {
            Doing::Walks
        } else if since_join < self.stay_s + self.track_s {
            Doing::Goes(since_join - self.stay_s, theta(begun_s + self.stay_s))
        } else {
            return None;
        };
        Some((visit as u32, doing))
    }

    /// The track that is walked while `doing`, how long it has been walked [s], and θ of its tip [rad]; `None` on the path.
    pub fn track(&self, braid: &Braid, doing: Doing, omega: f64) -> Option<(Track, f64, f64)> {
        let (since, theta, comes) = match doing {
            Doing::Walks => return None,
            Doing::Comes(since, theta) => (since, theta, true),
            Doing::Goes(since, theta) => (since, theta, false),
        };
        Some((Track::new(&braid.at(theta), omega, self.track_s, comes), since, theta))
    }
}

/// One track: coefficients of 1, t, …, t⁵.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Track {
    coefficients: [Vector2<f64>; 6],
    duration_s: f64,
    comes: bool,
}

impl Track {
    fn new(tip: &PathPoint, omega: f64, duration_s: f64, comes: bool) -> Self {
        let (velocity, acceleration) = (tip.tangent * omega, tip.bend * omega * omega);
        let along = tip.tangent.normalize();
        let aside = Vector2::new(-along.y, along.x);
        let outward = if aside.dot(&tip.position.coords) > 0.0 { aside } else { -aside };
        // From half behind the tip and outside; or to half before it. Time runs from the outer end for who comes.
        let sign = if comes { 1.0 } else { -1.0 };
        let outer = tip.position.coords + (outward - along * (0.8 * sign)) * OUTSIDE_M;
        let outer_velocity = (along - outward * sign).normalize() * velocity.norm();
        let at_tip = [tip.position.coords, velocity, acceleration];
        let at_outer = [outer, outer_velocity, Vector2::zeros()];
        let coefficients =
            if comes { quintic(at_outer, at_tip, duration_s) } else { quintic(at_tip, at_outer, duration_s) };
        Self { coefficients, duration_s, comes }
    }

    /// Place and velocity `t` seconds after the start [m, m/s].
    pub fn at(&self, t: f64) -> (Point2<f64>, Vector2<f64>) {
        let [mut position, mut velocity] = [Vector2::zeros(); 2];
        for coefficient in self.coefficients.iter().rev() {
            velocity = velocity * t + position;
            position = position * t + coefficient;
        }
        (position.into(), velocity)
    }

    /// Way walked between `t` and the tip [m], less than 0 before it is reached; by Simpson's rule.
    pub fn way_from_tip(&self, t: f64) -> f64 {
        const N: usize = 8;
        let from = if self.comes { self.duration_s } else { 0.0 };
        let step = (t - from) / N as f64;
        let weight = |i: usize| match i {
            0 | N => 1.0,
            odd if odd % 2 == 1 => 4.0,
            _ => 2.0,
        };
        (0..=N).map(|i| weight(i) * self.at(from + step * i as f64).1.norm()).sum::<f64>() * step / 3.0
    }
}

/// The polynomial with place, velocity and acceleration `from` at 0 and `to` at `duration`.
fn quintic(from: [Vector2<f64>; 3], to: [Vector2<f64>; 3], duration: f64) -> [Vector2<f64>; 6] {
    let [p, v, a] = from;
    let t = duration;
    // What is left to reach at the end beyond what the start alone leads to.
    let position = to[0] - (p + v * t + a * (t * t / 2.0));
    let velocity = (to[1] - (v + a * t)) * t;
    let acceleration = (to[2] - a) * (t * t);
    let c3 = (position * 10.0 - velocity * 4.0 + acceleration * 0.5) / t.powi(3);
    let c4 = (position * -15.0 + velocity * 7.0 - acceleration) / t.powi(4);
    let c5 = (position * 6.0 - velocity * 3.0 + acceleration * 0.5) / t.powi(5);
    [p, v, a / 2.0, c3, c4, c5]
}
