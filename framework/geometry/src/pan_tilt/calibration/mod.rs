//! Calibration of a pan-tilt head: its axes and its camera at rest from targets seen at many settings [Davis 2002 (4)].
//!
//! [`calibrate_head`] finds a start by itself, [`refine_head`] begins at a given one. Both minimise ½ Σ ρ(|seen −
//! measured|²) in units of the pixel's standard deviation, to which the target's own covariance is added as projected.
//! A robust loss separates inliers from outliers; the result is the least-squares solution on the inliers, so that its
//! covariance applies to it. With [`Loss::Squared`] all observations count, as in the paper.
//!
//! Free are the pose of the camera at rest (6), each axis (4), and, by option, the angle of a device unit (1 each) and
//! the focal lengths (1). Not free are the device's zero, since another zero is another pose at rest, and the position
//! of an axis' point along it. Stacking is not estimated but given ([`HeadOptions::stacking`]): settings that change
//! one angle at a time fit either.

mod equations;
mod error;
mod options;
mod outcome;
mod start;

#[cfg(test)]
mod refusals;
#[cfg(test)]
mod tests;

use std::collections::HashMap;

use foveate_estimation::{Loss, Random};
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Vector3};

use self::equations::{Fit, Parameters, Used};
pub use self::error::HeadCalibrationError;
pub use self::options::{AxesRule, HeadOptions, OpticsRule, UnitsRule};
pub use self::outcome::{AxisSigma, HeadCalibration, HeadCovariance, Holdout};
use super::head::{AxisUnits, PanTiltHead};
use crate::camera::Camera;

/// An observation of a target at a setting of the head.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadObservation {
    /// Pan as the device reports it, in its units.
    pub pan: f64,
    /// Tilt as the device reports it, in its units.
    pub tilt: f64,
    /// Position of the target, from the tracking system [m].
    pub point_in_world: Point3<f64>,
    /// Covariance of that position [m²]; zero for exact.
    pub point_covariance: Matrix3<f64>,
    /// Measured pixel, raw [px].
    pub pixel: Point2<f64>,
    /// Standard deviation of either coordinate of the pixel [px].
    pub sigma_px: f64,
}

/// Fewer right observations than this leave no surplus worth the name: up to 17 unknowns, two numbers each.
const LEAST_OBSERVATIONS: usize = 12;
/// Across over along the line, at least.
const ON_A_LINE: f64 = 0.01;
/// Axes closer than this are taken for one [rad].
const PARALLEL: f64 = 0.1;
/// Units stay within this factor of those at the start.
const UNIT_RATIO: f64 = 1.5;
/// A right observation is at most this many standard deviations off: one right one in a thousand is further.
const GATE: f64 = 3.717;
/// Median length of a pair of standard normal numbers.
const MEDIAN_OF_TWO: f64 = 1.177_410_022_515_474_7;
/// A start may be this far off [rad]: standard deviations are taken so much too large at first that this is no wrong observation.
const START_OFF: f64 = 0.03;
/// Then, in turn, so many times less.
const STAGE: f64 = 4.0;

/// Calibrates a head without a start. `optics` has the camera's intrinsics, distortion and image size; its pose is not used.
///
/// Starts: poses of the camera at settings with six targets or more ([`crate::resect`]) give axes and units; and all
/// observations together, turned back by the angles of an aligned head, in any of the eight ways to mount a camera
/// upright, sideways or upside down, give a pose by three targets. The start with the best fit after refinement is
/// taken.
///
/// # Errors
/// See [`HeadCalibrationError`].
pub fn calibrate_head(
    optics: &Camera,
    observations: &[HeadObservation],
    options: &HeadOptions,
) -> Result<HeadCalibration, HeadCalibrationError> {
    let prepared = Prepared::new(optics, observations, options)?;
    let mut random = Random::new(options.seed);
    let (starts, posed) = start::find(&prepared, &mut random);
    let mut best: Option<(f64, Parameters)> = None;
    for start in starts {
        let units = start.rad_per_unit;
        let Some((cost, found)) = prepared.robust(start) else { continue };
        if lost_unit(units, &found).is_none() && best.as_ref().is_none_or(|it| cost < it.0) {
            best = Some((cost, found));
        }
    }
    let fault = HeadCalibrationError::NoStart { settings: prepared.n_settings, posed };
    prepared.finish(best.ok_or(fault)?.1)
}

/// Refines a head that is nearly right. `units` are the start of pan and tilt; [`HeadOptions::units`] says which of
/// them are free, and its numbers are not used.
///
/// # Errors
/// See [`HeadCalibrationError`].
pub fn refine_head(
    start: &PanTiltHead,
    units: [AxisUnits; 2],
    observations: &[HeadObservation],
    options: &HeadOptions,
) -> Result<HeadCalibration, HeadCalibrationError> {
    let mut prepared = Prepared::new(&start.at_rest, observations, options)?;
    prepared.set_at_rest(units.map(|it| it.at_rest));
    let head = PanTiltHead { stacking: options.stacking, limits: options.limits, zoom: None, ..start.clone() };
    let rad_per_unit = units.map(|it| it.rad_per_unit);
    let start = prepared.parameters(head, rad_per_unit);
    let seen = prepared.seen_by(&start);
    let (_, found) =
        prepared.robust(start).ok_or(HeadCalibrationError::BadStart { seen, count: observations.len() })?;
    match lost_unit(rad_per_unit, &found) {
        Some(fault) => Err(fault),
        None => prepared.finish(found),
    }
}

/// Settings in equal steps fit as well when each step is a whole turn more, or the axis points the other way and each step is a whole turn less one:
/// a search that ends with another unit than the one it began with found such a copy.
fn lost_unit(start: [f64; 2], found: &Parameters) -> Option<HeadCalibrationError> {
    let names = ["pan", "tilt"].into_iter().enumerate();
    let mut lost = names.map(|(axis, name)| (name, start[axis], found.rad_per_unit[axis]));
    let (axis, start, found) = lost.find(|(_, start, found)| (found / start).ln().abs() >= UNIT_RATIO.ln())?;
    Some(HeadCalibrationError::UnitLost { axis, start, found })
}

/// The observations in the form that the search wants.
pub(super) struct Prepared<'a> {
    optics: Camera,
    options: &'a HeadOptions,
    observations: &'a [HeadObservation],
    used: Vec<Used>,
    /// By observation: the direction of its pixel in the camera, where the lens has one.
    directions: Vec<Option<Vector3<f64>>>,
    /// The device's numbers at angle zero.
    at_rest: [f64; 2],
    n_settings: usize,
}

impl<'a> Prepared<'a> {
    fn new(
        optics: &Camera,
        observations: &'a [HeadObservation],
        options: &'a HeadOptions,
    ) -> Result<Self, HeadCalibrationError> {
        optics.check().map_err(HeadCalibrationError::BadOptics)?;
        options.check()?;
        observations.iter().enumerate().try_for_each(|(index, it)| it.check(index))?;
        if observations.len() < LEAST_OBSERVATIONS {
            return Err(HeadCalibrationError::TooFew {
                count: observations.len(),
                kind: "usable",
                expected: LEAST_OBSERVATIONS,
            });
        }
        let at_rest = options.units.map(|it| match it {
            UnitsRule::Known(units) | UnitsRule::Near(units) => units.at_rest,
            UnitsRule::Unknown { at_rest } => at_rest,
        });
        let mut settings: HashMap<[u64; 2], usize> = HashMap::new();
        let used = observations
            .iter()
            .map(|it| {
                let n = settings.len();
                let setting = *settings.entry([it.pan, it.tilt].map(f64::to_bits)).or_insert(n);
                Used { units: [it.pan - at_rest[0], it.tilt - at_rest[1]], setting }
            })
            .collect();
        let optics = Camera { camera_from_world: Isometry3::identity(), ..optics.clone() };
        let directions =
            observations.iter().map(|it| Some(optics.normalise(&it.pixel)?.push(1.0).normalize())).collect();
        let prepared =
            Prepared { optics, options, observations, used, directions, at_rest, n_settings: settings.len() };
        prepared.check_range(options.units.map(|it| match it {
            UnitsRule::Known(units) | UnitsRule::Near(units) => Some(units.rad_per_unit),
            UnitsRule::Unknown { .. } => None,
        }))?;
        prepared.check_spread()?;
        Ok(prepared)
    }

    fn set_at_rest(&mut self, at_rest: [f64; 2]) {
        self.at_rest = at_rest;
        for (used, it) in self.used.iter_mut().zip(self.observations) {
            used.units = [it.pan - at_rest[0], it.tilt - at_rest[1]];
        }
    }

    fn parameters(&self, head: PanTiltHead, rad_per_unit: [f64; 2]) -> Parameters {
        Parameters { head, rad_per_unit, focal: 1.0, corrections: Vec::new() }
    }

    /// Between the smallest and the largest number of each axis, in the device's units.
    fn ranges(&self, of: impl Fn(usize) -> bool) -> [f64; 2] {
        [0, 1].map(|axis| {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for (index, used) in self.used.iter().enumerate().filter(|(index, _)| of(*index)) {
                debug_assert!(index < self.used.len());
                low = low.min(used.units[axis]);
                high = high.max(used.units[axis]);
            }
            (high - low).max(0.0)
        })
    }

    /// Without the angle of a unit, any range will do for now.
    fn check_range(&self, rad_per_unit: [Option<f64>; 2]) -> Result<(), HeadCalibrationError> {
        let ranges = self.ranges(|_| true);
        for (axis, name) in ["pan", "tilt"].into_iter().enumerate() {
            let expected = self.options.least_range[axis];
            let range = rad_per_unit[axis].map_or(ranges[axis], |unit| ranges[axis] * unit.abs());
            if range == 0.0 || (rad_per_unit[axis].is_some() && range < expected) {
                return Err(HeadCalibrationError::RangeTooSmall { axis: name, range, expected });
            }
        }
        Ok(())
    }

    fn check_spread(&self) -> Result<(), HeadCalibrationError> {
        let n = self.observations.len() as f64;
        let centroid = self.observations.iter().fold(Vector3::zeros(), |sum, it| sum + it.point_in_world.coords) / n;
        let scatter = self.observations.iter().fold(Matrix3::zeros(), |sum, it| {
            let offset = it.point_in_world.coords - centroid;
            sum + offset * offset.transpose() / n
        });
        let mut spreads: [f64; 3] = scatter.symmetric_eigenvalues().map(|it| it.max(0.0).sqrt()).into();
        spreads.sort_by(f64::total_cmp);
        let [_, across, along] = spreads;
        if across.is_nan() || across <= ON_A_LINE * along {
            return Err(HeadCalibrationError::OnALine { along, across });
        }
        Ok(())
    }

    fn seen_by(&self, at: &Parameters) -> usize {
        (0..self.used.len()).filter(|it| self.error(at, *it).is_some()).count()
    }

    /// Minimises the robust cost from `start`, with standard deviations that are too large at first; gives the cost at the end.
    fn robust(&self, start: Parameters) -> Option<(f64, Parameters)> {
        let all: Vec<usize> = (0..self.used.len()).collect();
        let mut here = start;
        if self.options.loss == Loss::Squared {
            let fit = Fit::new(self, &all, &here, 1.0);
            let found = fit.solve(here, Loss::Squared)?;
            return Some((*found.costs.last()?, found.parameters));
        }
        let mut cost = f64::INFINITY;
        for factor in self.stages() {
            let factor = factor * self.noise_factor(&here, factor == 1.0);
            let found = Fit::new(self, &all, &here, factor).solve(here, self.options.loss)?;
            cost = found.costs.last()? * factor * factor;
            here = found.parameters;
        }
        Some((cost, here))
    }

    /// How many times too large standard deviations are taken, in turn: a narrow view makes many pixels of what the start is off.
    fn stages(&self) -> Vec<f64> {
        let sigmas: Vec<f64> = self.observations.iter().map(|it| it.sigma_px).collect();
        let sigma_px = foveate_estimation::statistics::median(&sigmas).unwrap_or(1.0);
        let most = (START_OFF * self.optics.intrinsics.focal[0] / sigma_px).max(1.0);
        let n = most.log(STAGE).ceil().min(12.0) as i32;
        (0..=n).rev().map(|it| STAGE.powi(it)).collect()
    }

    /// By how much the errors exceed their standard deviations, from their median; at least 1, and 1 unless `wanted`.
    fn noise_factor(&self, at: &Parameters, wanted: bool) -> f64 {
        if !wanted {
            return 1.0;
        }
        let all: Vec<usize> = (0..self.used.len()).collect();
        let fit = Fit::new(self, &all, at, 1.0);
        let lengths: Vec<f64> = all.iter().filter_map(|it| fit.relative_length(at, *it)).collect();
        let median = foveate_estimation::statistics::median(&lengths).unwrap_or(1.0);
        (median / MEDIAN_OF_TWO).max(1.0)
    }
}

impl HeadObservation {
    /// Finds what cannot be used in it, the observation of that number.
    fn check(&self, observation: usize) -> Result<(), HeadCalibrationError> {
        let finite = "a finite number";
        let covariance = &self.point_covariance;
        let fault =
            |field, found, expected| Err(HeadCalibrationError::BadObservation { observation, field, found, expected });
        let named = [
            ("pan", self.pan),
            ("tilt", self.tilt),
            ("the point", self.point_in_world.coords.sum()),
            ("the point's covariance", covariance.sum()),
            ("the pixel", self.pixel.coords.sum()),
        ];
        if let Some(&(field, found)) = named.iter().find(|it| !it.1.is_finite()) {
            return fault(field, found, finite);
        }
        if !(self.sigma_px.is_finite() && self.sigma_px > 0.0) {
            return fault("sigma_px", self.sigma_px, "a finite number above 0");
        }
        let least = covariance.symmetric_eigenvalues().min();
        if least < -1e-9 * covariance.norm() || (covariance - covariance.transpose()).norm() > 1e-9 * covariance.norm()
        {
            return fault("the least eigenvalue of the point's covariance", least, "0 or more, and a symmetric matrix");
        }
        Ok(())
    }
}
