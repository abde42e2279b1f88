//! Checks of held-out observations and of known lengths.

use std::collections::BTreeMap;

use foveate_estimation::statistics::{SIGMA_PER_MAD, Summary, mad, median};
use foveate_geometry::self_calibration::CameraStatus;
use nalgebra::Point3;

use super::network::{MEDIAN_CHI2, Room};
use super::{CheckOptions, Judgement, Level};
use crate::solved::ObservationRole;
use crate::words::signed;

/// How well observations fit, those in use and those held out.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Level and sentence.
    pub judgement: Judgement,
    /// Residuals of the observations in use [px]; `None` without any.
    pub training: Option<Summary>,
    /// Residuals of those held out [px]; `None` if none were.
    pub held_out: Option<Summary>,
    /// Median of the latter over that of the former [–].
    pub ratio: Option<f64>,
    /// Median distance of those held out over what pixel noise and the other cameras' geometry leave to be expected; near 1 when all is
    /// well, however few cameras see a point. `None` where two other cameras see none of these points [–].
    pub excess: Option<f64>,
    /// Share of the observations that contradict the rest [–].
    pub rejected: f64,
    /// Share of common observations of two or more calibrated cameras that intersect nowhere [–].
    pub unsolved: f64,
    /// By camera: median of the observations in use and of those held out [px].
    pub by_camera: Vec<[Option<f64>; 2]>,
}

pub(super) fn fit(network: &Room<'_>) -> Fit {
    let residuals = |camera: Option<usize>, role: ObservationRole| -> Vec<f64> {
        let wanted = network
            .solved
            .observations
            .iter()
            .filter(|it| it.role == role && camera.is_none_or(|own| own == it.camera));
        wanted.filter_map(|it| Some(it.residual?.norm())).collect()
    };
    let training = Summary::of(&residuals(None, ObservationRole::Used));
    let held_out = Summary::of(&residuals(None, ObservationRole::HeldOut));
    let ratio = training.zip(held_out).map(|(training, held)| held.median / training.median);
    let by_camera = (0..network.solved.cameras.len())
        .map(|it| [ObservationRole::Used, ObservationRole::HeldOut].map(|role| median(&residuals(Some(it), role))))
        .collect();
    let count = |role: ObservationRole| network.solved.observations.iter().filter(|it| it.role == role).count() as f64;
    let rejected_count = count(ObservationRole::Rejected);
    let judged = rejected_count + count(ObservationRole::Used) + count(ObservationRole::HeldOut);
    let rejected = if judged > 0.0 { rejected_count / judged } else { 0.0 };
    let excess = excess(network);
    let unsolved = unsolved(network);
    let judgement = judge(network.options, training, held_out, excess, [rejected, unsolved]);
    Fit { judgement, training, held_out, ratio, excess, rejected, unsolved, by_camera }
}

/// Which part of what two calibrated cameras saw together has no place. Of a frame the camera that saw the second most of it has seen no more than that together with another.
fn unsolved(network: &Room<'_>) -> f64 {
    let mut counts: BTreeMap<usize, BTreeMap<usize, usize>> = BTreeMap::new();
    let is_calibrated: Vec<bool> =
        network.solved.cameras.iter().map(|it| it.status == CameraStatus::Calibrated).collect();
    for it in network.solved.observations.iter().filter(|it| it.point.is_none() && is_calibrated[it.camera]) {
        *counts.entry(it.frame).or_default().entry(it.camera).or_default() += 1;
    }
    let together = |of_frame: &BTreeMap<usize, usize>| {
        let mut all: Vec<usize> = of_frame.values().copied().collect();
        all.sort_unstable();
        all.iter().rev().nth(1).copied().unwrap_or(0)
    };
    let without = counts.values().map(together).sum::<usize>() as f64;
    let all = without + network.solved.points.len() as f64;
    if all > 0.0 { without / all } else { 0.0 }
}

/// Squared distances of observations held out in units of their covariance, as a standard deviation.
fn excess(network: &Room<'_>) -> Option<f64> {
    let (cameras, points) = (network.cameras(), network.positions());
    let mut squares = Vec::new();
    for camera in network.calibrated() {
        let held = network.witnessed(camera, &[], &cameras, &points, |role| role == ObservationRole::HeldOut);
        squares.extend(held.iter().filter_map(|it| {
            let error = cameras[camera].project(&it.point)? - it.pixel;
            let weight = it.spread(&cameras[camera], network.sigma_px)?.try_inverse()?;
            Some(error.dot(&(weight * error)))
        }));
    }
    Some((median(&squares)? / MEDIAN_CHI2).sqrt())
}

fn judge(
    options: &CheckOptions,
    training: Option<Summary>,
    held_out: Option<Summary>,
    excess: Option<f64>,
    [rejected, unsolved]: [f64; 2],
) -> Judgement {
    let Some(training) = training else {
        return Judgement::new(Level::Redo, "No observation is in use: nothing was calibrated; record again.");
    };
    let told = held_out.unwrap_or(training);
    let by_px = CheckOptions::level(told.median, options.hold_out_px);
    let excess_counts = told.median > options.trifle_px;
    let by_excess =
        excess.filter(|_| excess_counts).map_or(Level::Good, |it| CheckOptions::level(it, options.hold_out_excess));
    let by_share = CheckOptions::level(rejected, options.rejected_share);
    let by_unsolved = CheckOptions::level(unsolved, options.unsolved_share);
    let level = by_px.max(by_excess).max(by_share).max(by_unsolved);
    let kept = if held_out.is_some() { "held out" } else { "in use (none were held out)" };
    let figures = format!("Observations {kept} are {:.2} px off in the median, {:.2} px at p90", told.median, told.p90);
    let sentence = if level == Level::Good {
        format!("{figures}.")
    } else if by_share == level {
        format!(
            "{:.0} % of the observations contradict the rest: darken the room or mask lamps and mirrors.",
            100.0 * rejected
        )
    } else if by_unsolved == level {
        format!(
            "{:.0} % of common observations of two cameras intersect nowhere: wrong optics (focal length, principal point, lens), or pictures that do not belong together.",
            100.0 * unsolved
        )
    } else if by_excess == level {
        let times = excess.unwrap_or(f64::NAN);
        format!(
            "{figures}, {times:.1} times what noise explains: the camera models do not hold; check the cameras named here."
        )
    } else {
        format!("{figures}: check focus, exposure and the size of the light in the pictures.")
    };
    Judgement::new(level, sentence)
}

/// The error of a known length at one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LengthSample {
    /// Middle of the length, in the world [m].
    pub at: Point3<f64>,
    /// Length found less length known, over the latter [–].
    pub relative_error: f64,
}

impl LengthSample {
    /// The error of a length measured as `found` where it is `known`, in any unit.
    pub fn new(at: Point3<f64>, found: f64, known: f64) -> Self {
        Self { at, relative_error: found / known - 1.0 }
    }
}

/// Errors of a known length over the room.
#[derive(Debug, Clone, PartialEq)]
pub struct Lengths {
    /// Level and sentence.
    pub judgement: Judgement,
    /// Samples [–].
    pub count: usize,
    /// Median error, relative [–].
    pub bias: f64,
    /// Standard deviation of the errors about it, robust, relative [–].
    pub spread: f64,
    /// How the error grows along the steepest horizontal or vertical axis, relative, over the extent of the samples [–]; 0 in a world
    /// that is nowhere stretched.
    pub slope: f64,
    /// The axis of that: 0 = X, 1 = Y, 2 = Z.
    pub slope_axis: usize,
}

/// `None` without a finite sample.
pub(super) fn lengths(samples: &[LengthSample], options: &CheckOptions) -> Option<Lengths> {
    let finite = |it: &&LengthSample| it.relative_error.is_finite() && it.at.coords.norm().is_finite();
    let samples: Vec<&LengthSample> = samples.iter().filter(finite).collect();
    let errors: Vec<f64> = samples.iter().map(|it| it.relative_error).collect();
    let bias = median(&errors)?;
    let spread = mad(&errors)? * SIGMA_PER_MAD;
    let along = |axis: usize| -> f64 {
        let mut order: Vec<&&LengthSample> = samples.iter().collect();
        order.sort_by(|a, b| a.at[axis].total_cmp(&b.at[axis]));
        let third = order.len() / 3;
        let middle = |part: &[&&LengthSample]| median(&part.iter().map(|it| it.relative_error).collect::<Vec<_>>());
        let ends = middle(&order[..third]).zip(middle(&order[order.len() - third..]));
        ends.map_or(0.0, |(low, high)| (high - low) * 1.5) // the middles of outer thirds are two thirds of the extent apart
    };
    let slopes = [0, 1, 2].map(along);
    let slope_axis = (0..3).max_by(|a, b| slopes[*a].abs().total_cmp(&slopes[*b].abs())).unwrap_or(0);
    let slope = slopes[slope_axis];
    let level = CheckOptions::level(spread.max(bias.abs()).max(slope.abs() / 3.0), options.length_spread);
    let figures = format!(
        "The known length is reproduced with a spread of {:.2} % and a bias of {} %",
        100.0 * spread,
        signed(100.0 * bias, 2)
    );
    let sentence = if level == Level::Good {
        format!("{figures}.")
    } else {
        let axis = ["X", "Y", "Z"][slope_axis];
        format!(
            "{figures}, changing by {} % along {axis}: wave the wand through the whole volume, in all orientations.",
            signed(100.0 * slope, 2)
        )
    };
    Some(Lengths { judgement: Judgement::new(level, sentence), count: samples.len(), bias, spread, slope, slope_axis })
}
