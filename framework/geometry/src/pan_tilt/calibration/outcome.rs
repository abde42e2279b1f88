//! The result of head calibration: inliers, covariance and cross-validation.

use foveate_estimation::{Loss, statistics};
use nalgebra::{DMatrix, Matrix2, Matrix3, Matrix4, Matrix6, Point3, SMatrix, Vector2};

use super::equations::{FOCAL, Fit, Parameters, SHARED, linear};
use super::{GATE, HeadCalibrationError, LEAST_OBSERVATIONS, PARALLEL, Prepared};
use crate::camera::Camera;
use crate::pan_tilt::head::{AxisUnits, PanTiltHead};

/// A calibrated head with residuals and covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadCalibration {
    /// The head, with the limits of the options, and its camera, with the focal lengths found if they were free.
    pub head: PanTiltHead,
    /// Units of the device's pan and tilt.
    pub units: [AxisUnits; 2],
    /// Covariance of the head.
    pub covariance: HeadCovariance,
    /// Relative standard deviation of the focal lengths; 0 where they were given [–].
    pub focal_sigma: f64,
    /// By observation: residual seen − measured, with corrections of settings if there are any; `None` where the camera does not see the target [px].
    pub residuals: Vec<Option<Vector2<f64>>>,
    /// By observation: whether it is an inlier.
    pub right: Vec<bool>,
    /// Root mean square length of the inliers' residuals [px].
    pub rms_px: f64,
    /// Median length of all residuals [px].
    pub median_px: f64,
    /// Ratio of the inliers' errors to their standard deviations; near 1 when these are right [–].
    pub noise_factor: f64,
    /// Cross-validation; `None` when it is not requested or there are too few settings.
    pub holdout: Option<Holdout>,
    /// Ranges of pan and tilt over the inliers [rad].
    pub ranges: [f64; 2],
    /// Whether the search converged.
    pub converged: bool,
}

/// Cross-validation errors of inliers, predicted from the settings of the other parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Holdout {
    /// Number of different settings.
    pub settings: usize,
    /// Number of parts that they were divided into.
    pub parts: usize,
    /// Number of predicted observations.
    pub observations: usize,
    /// Median length of their errors [px].
    pub median_px: f64,
    /// Root mean square length of their errors [px].
    pub rms_px: f64,
}

/// Standard deviations of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisSigma {
    /// Largest standard deviation of its direction [rad].
    pub direction: f64,
    /// Largest standard deviation of its position across it, at the point next to the lens [m].
    pub place: f64,
}

/// Covariance of a head; 0 for held parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadCovariance {
    /// Order: pose of the camera at rest (6: update and order of `docs/notation.md`), pan axis and tilt axis (4 each:
    /// the step of [`super::super::Axis::moved`] at the point next to the lens), logarithms of the angle of a unit of
    /// pan and tilt (2). Standard deviations that are smaller than the errors are widened by
    /// [`HeadCalibration::noise_factor`].
    pub whole: SMatrix<f64, SHARED, SHARED>,
}

impl HeadCovariance {
    /// Covariance of the pose of the camera at rest, by `docs/notation.md`.
    pub fn pose(&self) -> Matrix6<f64> {
        self.whole.fixed_view::<6, 6>(0, 0).into_owned()
    }

    /// Covariance of the centre of projection at rest in the world [m²].
    pub fn centre(&self, head: &PanTiltHead) -> Matrix3<f64> {
        let centre = head.at_rest.centre().coords;
        let mut by_pose = SMatrix::<f64, 3, 6>::zeros();
        by_pose.fixed_columns_mut::<3>(0).copy_from(&centre.cross_matrix());
        by_pose.fixed_columns_mut::<3>(3).copy_from(&-Matrix3::identity());
        by_pose * self.pose() * by_pose.transpose()
    }

    /// Standard deviations of the pan axis.
    pub fn pan(&self) -> AxisSigma {
        axis_sigma(&self.whole.fixed_view::<4, 4>(6, 6).into_owned())
    }

    /// Standard deviations of the tilt axis.
    pub fn tilt(&self) -> AxisSigma {
        axis_sigma(&self.whole.fixed_view::<4, 4>(10, 10).into_owned())
    }

    /// Relative standard deviations of the angle of a unit of pan and tilt [–].
    pub fn units(&self) -> [f64; 2] {
        [14, 15].map(|it| self.whole[(it, it)].max(0.0).sqrt())
    }
}

impl HeadCalibration {
    /// The predicted pixel of a target at the device's numbers `pan` and `tilt`, with its covariance from the
    /// calibration alone [px²]. `None` where the camera does not see the target.
    pub fn predict(
        &self,
        pan: f64,
        tilt: f64,
        point_in_world: &Point3<f64>,
    ) -> Option<(nalgebra::Point2<f64>, Matrix2<f64>)> {
        let optics = Camera { camera_from_world: nalgebra::Isometry3::identity(), ..self.head.at_rest.clone() };
        let angles = [self.units[0].angle(pan), self.units[1].angle(tilt)];
        let seen = linear(&optics, &self.head, angles, angles, point_in_world)?;
        let by_unknowns = seen.by_shared * to_own_space(&self.head).try_inverse()?;
        Some((seen.pixel, by_unknowns * self.covariance.whole * by_unknowns.transpose()))
    }
}

/// Root of the larger eigenvalue of directions and of places.
fn axis_sigma(covariance: &Matrix4<f64>) -> AxisSigma {
    let worst = |at: usize| covariance.fixed_view::<2, 2>(at, at).symmetric_eigenvalues().max().max(0.0).sqrt();
    AxisSigma { direction: worst(0), place: worst(2) }
}

/// Takes steps exp(δ) T of the search to steps T exp(δ) of `docs/notation.md`; leaves other unknowns as they are.
fn to_own_space(head: &PanTiltHead) -> SMatrix<f64, SHARED, SHARED> {
    let world_from_camera = head.at_rest.camera_from_world.inverse();
    let rotation = *world_from_camera.rotation.to_rotation_matrix().matrix();
    let mut adjoint = SMatrix::<f64, SHARED, SHARED>::identity();
    adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    let shift = world_from_camera.translation.vector.cross_matrix() * rotation;
    adjoint.fixed_view_mut::<3, 3>(3, 0).copy_from(&shift);
    adjoint
}

const NAMES: [&str; SHARED + 1] = [
    "the turn of the camera about its x",
    "the turn of the camera about its y",
    "the turn of the camera about its z",
    "the place of the camera along its x",
    "the place of the camera along its y",
    "the place of the camera along its z",
    "the direction of the pan axis",
    "the direction of the pan axis",
    "the place of the pan axis",
    "the place of the pan axis",
    "the direction of the tilt axis",
    "the direction of the tilt axis",
    "the place of the tilt axis",
    "the place of the tilt axis",
    "the unit of pan",
    "the unit of tilt",
    "the focal length",
];

impl Prepared<'_> {
    /// Least squares on what is right at `found`, and all that is stated about it.
    pub(super) fn finish(&self, found: Parameters) -> Result<HeadCalibration, HeadCalibrationError> {
        let mut here = found;
        let mut right: Vec<bool> = vec![true; self.used.len()];
        let mut solution = None;
        // What is right may change a little with the answer.
        for _ in 0..3 {
            let before = right.clone();
            right = self.right(&here);
            let chosen: Vec<usize> = (0..right.len()).filter(|it| right[*it]).collect();
            if chosen.len() < LEAST_OBSERVATIONS {
                let (count, expected) = (chosen.len(), LEAST_OBSERVATIONS);
                return Err(HeadCalibrationError::TooFew { count, kind: "right", expected });
            }
            let fault = HeadCalibrationError::BadStart { seen: self.seen_by(&here), count: self.used.len() };
            let solved = Fit::new(self, &chosen, &here, 1.0).solve(here, Loss::Squared).ok_or(fault)?;
            here = solved.parameters.clone();
            let done = solution.is_some() && before == right;
            solution = Some(solved);
            if done {
                break;
            }
        }
        let Some(solution) = solution else { unreachable!("the loop ran") };
        let ranges = self.check_ranges(&here, &right)?;
        let widened = solution.variance_factor.max(1.0);
        let (whole, focal_sigma) = match &solution.covariance {
            Ok(covariance) => {
                (shared_part(covariance) * widened, (covariance[(FOCAL, FOCAL)] * widened).max(0.0).sqrt())
            }
            Err(open) => {
                let mut parameters: Vec<&str> =
                    open.parameters.iter().filter_map(|it| NAMES.get(*it).copied()).collect();
                parameters.dedup();
                return Err(HeadCalibrationError::Open { parameters });
            }
        };
        let to_own = to_own_space(&here.head);
        let covariance = HeadCovariance { whole: to_own * whole * to_own.transpose() };
        self.check_hold(&here, &covariance, &right, ranges)?;
        let residuals: Vec<Option<Vector2<f64>>> = (0..self.used.len()).map(|it| self.error(&here, it)).collect();
        let lengths: Vec<f64> = residuals.iter().map(|it| it.map_or(f64::INFINITY, |it| it.norm())).collect();
        let squares: Vec<f64> = lengths.iter().zip(&right).filter(|it| *it.1).map(|it| it.0.powi(2)).collect();
        Ok(HeadCalibration {
            units: [0, 1].map(|axis| AxisUnits { rad_per_unit: here.rad_per_unit[axis], at_rest: self.at_rest[axis] }),
            covariance,
            focal_sigma,
            rms_px: (squares.iter().sum::<f64>() / squares.len() as f64).sqrt(),
            median_px: statistics::median(&lengths).unwrap_or(f64::INFINITY),
            noise_factor: solution.variance_factor.max(0.0).sqrt(),
            holdout: self.holdout(&here, &right),
            ranges,
            converged: solution.converged(),
            residuals,
            right,
            head: self.with_optics(here),
        })
    }

    fn with_optics(&self, found: Parameters) -> PanTiltHead {
        let Camera { intrinsics, .. } = self.optics_at(&found);
        let at_rest = Camera { intrinsics, ..found.head.at_rest };
        PanTiltHead { at_rest, ..found.head }
    }

    /// By observation: whether its error is one that right observations have; all are right under the plain square. A target right before the lens may
    /// err so far in the image that any pixel would do: that is none.
    fn right(&self, at: &Parameters) -> Vec<bool> {
        let all: Vec<usize> = (0..self.used.len()).collect();
        let limit = GATE * self.noise_factor(at, true);
        let fit = Fit::new(self, &all, at, 1.0);
        let [columns, rows] = self.optics.image_size.map(f64::from);
        let most_px = 0.5 * columns.hypot(rows);
        let within = |it: &usize| {
            let is_near = fit.relative_length(at, *it).is_some_and(|length| length <= limit);
            is_near && limit * fit.sigma_px(*it) <= most_px
        };
        all.iter().map(|it| self.options.loss == Loss::Squared || within(it)).collect()
    }

    fn check_ranges(&self, at: &Parameters, right: &[bool]) -> Result<[f64; 2], HeadCalibrationError> {
        let units = self.ranges(|it| right[it]);
        let ranges = [0, 1].map(|axis| units[axis] * at.rad_per_unit[axis].abs());
        for (axis, name) in ["pan", "tilt"].into_iter().enumerate() {
            let expected = self.options.least_range[axis];
            if ranges[axis] < expected {
                return Err(HeadCalibrationError::RangeTooSmall { axis: name, range: ranges[axis], expected });
            }
        }
        let angle = at.head.pan.angle_to(&at.head.tilt);
        if angle < PARALLEL { Err(HeadCalibrationError::ParallelAxes { angle }) } else { Ok(ranges) }
    }

    fn check_hold(
        &self,
        at: &Parameters,
        covariance: &HeadCovariance,
        right: &[bool],
        ranges: [f64; 2],
    ) -> Result<(), HeadCalibrationError> {
        let (pan, tilt) = (covariance.pan(), covariance.tilt());
        let centre = covariance.centre(&at.head).symmetric_eigenvalues().max().max(0.0).sqrt();
        let (direction, place) = (self.options.most_direction_sigma, self.options.most_place_sigma);
        let named = [
            ("the place of the camera", centre, place, 1e3, "mm"),
            ("the direction of the pan axis", pan.direction, direction, 1f64.to_degrees(), "°"),
            ("the direction of the tilt axis", tilt.direction, direction, 1f64.to_degrees(), "°"),
            ("the place of the pan axis", pan.place, place, 1e3, "mm"),
            ("the place of the tilt axis", tilt.place, place, 1e3, "mm"),
        ];
        let Some((what, sigma, expected, to_unit, unit)) =
            named.into_iter().find(|(_, sigma, expected, ..)| sigma.is_nan() || sigma > expected)
        else {
            return Ok(());
        };
        let centre = at.head.at_rest.centre();
        let mut distances = [f64::INFINITY, 0.0];
        for (it, _) in self.observations.iter().zip(right).filter(|it| *it.1) {
            let distance = (it.point_in_world - centre).norm();
            distances = [distances[0].min(distance), distances[1].max(distance)];
        }
        let (sigma, expected) = (sigma * to_unit, expected * to_unit);
        Err(HeadCalibrationError::Loose { what, sigma, expected, unit, distances, ranges })
    }

    /// Errors of each part of the settings under least squares on the others, from the answer for all.
    fn holdout(&self, found: &Parameters, right: &[bool]) -> Option<Holdout> {
        let parts = self.options.holdout_parts.min(self.n_settings);
        if parts < 2 || self.n_settings < 6 {
            return None;
        }
        let mut lengths = Vec::new();
        for part in 0..parts {
            let is_out = |it: &usize| self.used[*it].setting % parts == part;
            let (out, rest): (Vec<usize>, Vec<usize>) = (0..right.len()).filter(|it| right[*it]).partition(is_out);
            if rest.len() < LEAST_OBSERVATIONS {
                return None;
            }
            let mut predicted = Fit::new(self, &rest, found, 1.0).solve(found.clone(), Loss::Squared)?.parameters;
            predicted.corrections.clear();
            lengths.extend(out.iter().map(|it| self.error(&predicted, *it).map_or(f64::INFINITY, |it| it.norm())));
        }
        let mean_square = lengths.iter().map(|it| it * it).sum::<f64>() / lengths.len() as f64;
        Some(Holdout {
            settings: self.n_settings,
            parts,
            observations: lengths.len(),
            median_px: statistics::median(&lengths)?,
            rms_px: mean_square.sqrt(),
        })
    }
}

fn shared_part(covariance: &DMatrix<f64>) -> SMatrix<f64, SHARED, SHARED> {
    covariance.fixed_view::<SHARED, SHARED>(0, 0).into_owned()
}
