//! The rotations of one camera over time, and whether the last ones differ from those before.
//!
//! A rotation ω of a camera's view moves points p (in the camera) by ω × p. The rotation of a bin is the robust least-squares one (Cauchy's
//! loss, scale from the median), so that a minority of wrong observations does little. Errors of one light in one bin are not independent
//! (half of it is hidden, something shines beside it): n observations of it are known to no better than σ²/n + `CORRELATED_PX`². The last few turns are compared with the mean of
//! all before them since the last bump: d = recent − before, reported when dᵀ (C_recent + C_before)⁻¹ d exceeds a square and |d| a least rotation. The
//! covariances are widened where the camera's history scatters more than they state. Without a history the calibration is trusted
//! as stated.

use std::collections::BTreeMap;

use foveate::messages::{Interval, TargetId, Time};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

/// See [`super::CameraWatchSettings`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurnOptions {
    /// Length of a bin.
    pub bin: Interval,
    /// Number of rotations that are compared with those before.
    pub bins: usize,
    /// Fewest observations of a bin.
    pub min_observations: usize,
    /// Smallest reported rotation [rad].
    pub least: f64,
    /// Smallest reported shift of lights in the picture, root mean square [px].
    pub least_px: f64,
    /// Standard deviation of the calibrated orientation [rad].
    pub calibration: f64,
    /// Smallest reported rotation in standard deviations.
    pub sigmas: f64,
}

/// Pixel of a light minus its prediction from the other cameras.
#[derive(Debug, Clone, Copy)]
pub struct Residual {
    /// [px]
    pub error: Vector2<f64>,
    /// The light.
    pub target: TargetId,
    /// Covariance of `error`, as if it were independent of all others [px²].
    pub covariance: Matrix2<f64>,
    /// Its derivative by a rotation of the camera, in the camera's axes [px/rad].
    pub by_turn: Matrix2x3<f64>,
}

/// The rotation of a camera in one bin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// Start of the bin.
    pub at: Time,
    /// About the camera's x (down or up: tilt), y (pan) and z (roll) [rad].
    pub turn: Vector3<f64>,
    /// Inverse covariance of `turn` [rad⁻²].
    pub information: Matrix3<f64>,
    /// Number of observations.
    pub observations: usize,
    /// Length in the picture of a turn by 1 rad about each axis, root mean square, as Σ JᵀJ / n [px²/rad²].
    pub squared_px: Matrix3<f64>,
}

/// The last rotations compared with those before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Start of the first bin after it.
    pub at: Time,
    /// Rotation of the world in the camera's view [rad].
    pub turn: Vector3<f64>,
    /// Rotation before that [rad].
    pub before: Vector3<f64>,
    /// The difference in standard deviations.
    pub sigmas: f64,
    /// Number of bins that show it.
    pub bins: usize,
    /// Root mean square shift in the picture [px].
    pub shift_px: f64,
}

/// Rotations kept for comparison: two minutes of half seconds.
const LONGEST_HISTORY: usize = 240;
/// With fewer rotations before, the calibration is used instead.
const LEAST_HISTORY: usize = 4;
/// Median of χ² with three degrees of freedom.
const MEDIAN_CHI2: f64 = 2.365_974;
/// Largest plausible rotation of a camera; bounds the estimate where a bin does not constrain it [rad].
const WIDEST: f64 = 0.2;
const ROUNDS: usize = 12;
/// Errors that observations of one light in one bin have in common [px].
const CORRELATED_PX: f64 = 0.15;
/// A rotation seen on fewer lights is motion of a light rather than of a camera.
const LEAST_TARGETS: usize = 3;

/// The rotations of one camera.
#[derive(Debug, Clone, Default)]
pub struct Turns {
    gathered: Vec<Residual>,
    /// Inverse covariances of those [px⁻²].
    weights: Vec<Matrix2<f64>>,
    history: Vec<Turn>,
    scratch: Vec<f64>,
}

impl Turns {
    /// Takes in an observation of the bin that is open.
    pub fn add(&mut self, residual: Residual) {
        self.gathered.push(residual);
    }

    /// Ends the bin that began at `at`. `None` when too little was seen; the bin is discarded then.
    pub fn close(&mut self, at: Time, options: &TurnOptions) -> Option<Turn> {
        let targets = self.weigh();
        let is_enough = self.gathered.len() >= options.min_observations && targets >= LEAST_TARGETS;
        let turn = is_enough.then(|| self.solve(at)).flatten();
        self.gathered.clear();
        self.history.extend(turn);
        if self.history.len() > LONGEST_HISTORY {
            self.history.remove(0);
        }
        turn
    }

    /// Forgets everything.
    pub fn forget(&mut self) {
        self.gathered.clear();
        self.history.clear();
    }

    /// Forgets everything before `time`: the camera has another orientation since then.
    pub fn forget_before(&mut self, time: Time) {
        self.history.retain(|it| it.at >= time);
    }

    /// The last rotations compared with those before; `None` while there are too few, or when the last of them is not of the bin that began at `now`.
    /// `is_void`: the camera was or may have been bumped before, so that its calibrated orientation is invalid.
    pub fn change(&self, now: Time, is_void: bool, options: &TurnOptions) -> Option<Change> {
        let n = self.history.len();
        let (before, recent) = self.history.split_at(n.checked_sub(options.bins)?);
        let is_now = recent.last().is_some_and(|it| it.at == now);
        let known = before.len() >= LEAST_HISTORY;
        if !is_now || (is_void && !known) {
            return None;
        }
        let (mean, covariance) =
            if known { mean(before)? } else { (Vector3::zeros(), Matrix3::identity() * options.calibration.powi(2)) };
        let widened = if known { scatter(before, &mean) } else { 1.0 };
        let (last, last_covariance) = self::mean(recent)?;
        // History shares its own scatter; one without history has what the calibration says instead.
        let spread = if known { (covariance + last_covariance) * widened } else { covariance + last_covariance };
        let turn = last - mean;
        let squared = turn.dot(&(spread.try_inverse()? * turn));
        let sigmas = squared.max(0.0).sqrt();
        // Nearer to where it is now than to where it was, as far as the bin itself can tell.
        let from = |it: &Turn, to: &Vector3<f64>| (it.turn - to).dot(&(it.information * (it.turn - to)));
        let along = |it: &&Turn| from(it, &last) < from(it, &mean);
        let showing = || self.history.iter().rev().take_while(|it| along(it));
        let at = showing().last().map_or(now, |it| it.at);
        let bins = showing().count();
        // Recent turns may reach back before it.
        let (turn, shift_px) = self.turned_since(at, &mean).unwrap_or((turn, f64::NAN));
        Some(Change { at, turn, before: mean, sigmas, bins, shift_px })
    }

    /// Number of rotations of bins that began after `time`.
    pub fn count_after(&self, time: Time) -> usize {
        self.history.iter().filter(|it| it.at > time).count()
    }

    /// Rotation of the camera relative to `before`, and its root mean square shift of lights in the picture, from the bins
    /// after the one that began at `time`, or from that one while there is no other.
    pub fn turned_since(&self, time: Time, before: &Vector3<f64>) -> Option<(Vector3<f64>, f64)> {
        let first = self.history.iter().position(|it| it.at >= time)?;
        let since = &self.history[first..];
        let since = if since.len() > 1 { &since[1..] } else { since };
        let turn = mean(since)?.0 - before;
        let squared_px = since.last()?.squared_px;
        Some((turn, turn.dot(&(squared_px * turn)).max(0.0).sqrt()))
    }

    /// Computes the weights; returns the number of lights.
    fn weigh(&mut self) -> usize {
        let mut counts: BTreeMap<TargetId, f64> = BTreeMap::new();
        for it in &self.gathered {
            *counts.entry(it.target).or_default() += 1.0;
        }
        let weight = |it: &Residual| {
            let common = Matrix2::identity() * counts[&it.target] * CORRELATED_PX * CORRELATED_PX;
            (it.covariance + common).try_inverse().unwrap_or_default()
        };
        self.weights.clear();
        self.weights.extend(self.gathered.iter().map(weight));
        counts.len()
    }

    /// Iteratively reweighted least squares; the scale is that of the median residual, at least 1.
    fn solve(&mut self, at: Time) -> Option<Turn> {
        let mut turn = Vector3::zeros();
        let mut information = Matrix3::zeros();
        for _ in 0..ROUNDS {
            let squared = |(it, weight): (&Residual, &Matrix2<f64>)| {
                let left = it.error - it.by_turn * turn;
                left.dot(&(weight * left))
            };
            let weighed = || self.gathered.iter().zip(&self.weights);
            self.scratch.clear();
            self.scratch.extend(weighed().map(squared));
            let middle = self.scratch.len() / 2;
            let (_, median, _) = self.scratch.select_nth_unstable_by(middle, f64::total_cmp);
            let scale2 = (*median / std::f64::consts::LN_2 / 2.0).max(1.0);
            information = Matrix3::identity() / (WIDEST * WIDEST);
            let mut gradient = Vector3::zeros();
            for (residual, weight) in weighed() {
                let loss = scale2 * (1.0 + squared((residual, weight)) / (2.385_f64.powi(2) * scale2));
                let weight = weight / loss;
                information += residual.by_turn.transpose() * weight * residual.by_turn;
                gradient += residual.by_turn.transpose() * weight * residual.error;
            }
            let next = information.cholesky()?.solve(&gradient);
            let step = (next - turn).norm();
            turn = next;
            if step < 1e-7 {
                break;
            }
        }
        let n = self.gathered.len() as f64;
        let squared_px =
            self.gathered.iter().fold(Matrix3::zeros(), |sum, it| sum + it.by_turn.transpose() * it.by_turn / n);
        turn.iter().all(|it| it.is_finite()).then_some(Turn {
            at,
            turn,
            information,
            observations: self.gathered.len(),
            squared_px,
        })
    }
}

/// The mean of rotations by their information, with its covariance.
fn mean(turns: &[Turn]) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let (mut information, mut sum) = (Matrix3::zeros(), Vector3::zeros());
    for it in turns {
        information += it.information;
        sum += it.information * it.turn;
    }
    let covariance = information.try_inverse()?;
    Some((covariance * sum, covariance))
}

/// Factor of the variance by which rotations scatter about their mean more than their covariances state, at least 1.
fn scatter(turns: &[Turn], mean: &Vector3<f64>) -> f64 {
    let square = |it: &Turn| (it.turn - mean).dot(&(it.information * (it.turn - mean)));
    let mut squares: Vec<f64> = turns.iter().map(square).collect();
    squares.sort_unstable_by(f64::total_cmp);
    (squares[squares.len() / 2] / MEDIAN_CHI2).max(1.0)
}
