//! Errors of the observations and their derivatives by pose, axes, units and the corrections of settings.
//!
//! | place | step | unit |
//! |---|---|---|
//! | 0–5 | turn and shift of the camera at rest in its own space: exp(δ) T | rad, m |
//! | 6–9, 10–13 | [`super::super::Axis::moved`] of pan and tilt | rad, m |
//! | 14, 15 | logarithm of the angle of a unit, of pan and tilt | – |
//! | 16 | logarithm of the focal lengths | – |
//! | 17 + 2 k, 18 + 2 k | correction of pan and tilt of setting k | rad |
//!
//! With z = x − a, a turn R about an axis (a, u) takes x to a + R z. When the axis turns by ω and moves by β, that moves by
//! −[R z]× ω + R [z]× ω + (1 − R) β, and when the angle grows, by u × R z.

use foveate_estimation::Loss;
use foveate_estimation::least_squares::{self, Equations, Options, Problem, Solution};
use nalgebra::{
    DVector, Isometry3, Matrix2, Matrix2x3, Matrix3, Point2, Point3, SMatrix, Translation3, UnitQuaternion, Vector2,
    Vector3,
};

use super::{AxesRule, OpticsRule, Prepared, UnitsRule};
use crate::camera::{Camera, Intrinsics};
use crate::pan_tilt::axis::Axis;
use crate::pan_tilt::head::{PanTiltHead, Setting};

/// Unknowns of the head: without its camera's optics and corrections of settings.
pub(super) const SHARED: usize = 16;
/// Place of the focal lengths among the unknowns.
pub(super) const FOCAL: usize = SHARED;
/// Unknowns without corrections of settings.
const COMMON: usize = SHARED + 1;
/// Standard deviations that are more times too large than this are those of a search that is far off.
const COARSE: f64 = 4.0;
/// Error of what is not in front of the camera, in standard deviations.
const UNSEEN: f64 = 1e3;

/// An observation's setting.
#[derive(Debug, Clone, Copy)]
pub(super) struct Used {
    /// The device's numbers less those at rest.
    pub units: [f64; 2],
    /// Which setting.
    pub setting: usize,
}

/// What is estimated.
#[derive(Debug, Clone)]
pub(super) struct Parameters {
    pub head: PanTiltHead,
    pub rad_per_unit: [f64; 2],
    /// Focal lengths over those that were given.
    pub focal: f64,
    /// By setting, none at first [rad].
    pub corrections: Vec<[f64; 2]>,
}

impl Parameters {
    pub fn angles(&self, used: &Used) -> [f64; 2] {
        let correction = self.corrections.get(used.setting).copied().unwrap_or_default();
        [0, 1].map(|axis| used.units[axis] * self.rad_per_unit[axis] + correction[axis])
    }
}

/// A pixel, with its derivatives by the shared unknowns and by the angles.
pub(super) struct Linear {
    pub pixel: Point2<f64>,
    pub by_shared: SMatrix<f64, 2, SHARED>,
    /// By the logarithm of the focal lengths.
    pub by_focal: Vector2<f64>,
    pub by_angles: Matrix2<f64>,
    pub by_point: Matrix2x3<f64>,
}

/// Projects a point with the derivatives above. `optics` stands at the origin. `None` where the camera sees nothing.
pub(super) fn linear(
    optics: &Camera,
    head: &PanTiltHead,
    scaled_units: [f64; 2],
    angles: [f64; 2],
    point: &Point3<f64>,
) -> Option<Linear> {
    let rest = head.at_rest.camera_from_world;
    let at_rest = rest * point;
    let [(outer, by_outer), (inner, by_inner)] = head.by_carrier(angles);
    let (turn_outer, turn_inner) = (outer.turn(-by_outer), inner.turn(-by_inner));
    let on_outer = turn_outer * at_rest;
    let in_camera = turn_inner * on_outer;
    let (pixel, by_camera) = optics.project_with_jacobian(&in_camera)?;
    let rotations = [turn_outer, turn_inner].map(|it| *it.rotation.to_rotation_matrix().matrix());
    let by_on_outer = by_camera * rotations[1];
    let by_rest = by_on_outer * rotations[0];
    let mut by_shared = SMatrix::<f64, 2, SHARED>::zeros();
    by_shared.fixed_columns_mut::<3>(0).copy_from(&(by_rest * -at_rest.coords.cross_matrix()));
    by_shared.fixed_columns_mut::<3>(3).copy_from(&by_rest);
    let of_outer = by_axis(outer, &rotations[0], &at_rest, &on_outer, &by_on_outer);
    let of_inner = by_axis(inner, &rotations[1], &on_outer, &in_camera, &by_camera);
    let [(_, of_pan), (_, of_tilt)] = head.by_carrier([of_outer, of_inner]);
    by_shared.fixed_columns_mut::<4>(6).copy_from(&of_pan.0);
    by_shared.fixed_columns_mut::<4>(10).copy_from(&of_tilt.0);
    by_shared.set_column(14, &(of_pan.1 * scaled_units[0]));
    by_shared.set_column(15, &(of_tilt.1 * scaled_units[1]));
    let by_angles = Matrix2::from_columns(&[of_pan.1, of_tilt.1]);
    let by_point = by_rest * rest.rotation.to_rotation_matrix().matrix();
    let Intrinsics { focal, principal, skew } = optics.intrinsics;
    let down = pixel.y - principal[1];
    // The skew does not grow with the focal lengths.
    let by_focal = Vector2::new(pixel.x - principal[0] - skew * down / focal[1], down);
    Some(Linear { pixel, by_shared, by_focal, by_angles, by_point })
}

/// Derivatives by the four numbers of an axis that turned `before` into `after`, and by its angle, of what depends on `after` by `by_after`.
fn by_axis(
    axis: &Axis,
    rotation: &Matrix3<f64>,
    before: &Point3<f64>,
    after: &Point3<f64>,
    by_after: &Matrix2x3<f64>,
) -> (SMatrix<f64, 2, 4>, Vector2<f64>) {
    let (z, turned) = (before - axis.point, after - axis.point);
    let by_turn = by_after * (rotation * z.cross_matrix() - turned.cross_matrix());
    let by_shift = by_after * (Matrix3::identity() - rotation);
    let [first, second] = axis.across();
    let by_four =
        SMatrix::<f64, 2, 4>::from_columns(&[by_turn * first, by_turn * second, by_shift * first, by_shift * second]);
    (by_four, -(by_after * axis.direction.cross(&turned)))
}

/// A search over some of the observations, with standard deviations that stay as they are meanwhile.
pub(super) struct Fit<'a> {
    prepared: &'a Prepared<'a>,
    chosen: &'a [usize],
    /// By observation: takes an error to units of its standard deviation.
    whiten: Vec<Matrix2<f64>>,
    /// By setting: where its corrections stand among the unknowns.
    corrected: Vec<Option<usize>>,
    n_corrected: usize,
    factor: f64,
}

impl<'a> Fit<'a> {
    /// Standard deviations are `factor` times those at `at`.
    pub fn new(prepared: &'a Prepared<'a>, chosen: &'a [usize], at: &Parameters, factor: f64) -> Fit<'a> {
        let sigma = prepared.options.setting_sigma;
        let mut counts = vec![0; prepared.n_settings];
        chosen.iter().for_each(|it| counts[prepared.used[*it].setting] += 1);
        let (mut corrected, mut n_corrected) = (vec![None; prepared.n_settings], 0);
        if sigma > 0.0 {
            // A setting with one observation alone: its correction is noise of that pixel, and need not be an unknown.
            for (setting, _) in counts.iter().enumerate().filter(|it| *it.1 > 1) {
                corrected[setting] = Some(COMMON + 2 * n_corrected);
                n_corrected += 1;
            }
        }
        let mut whiten = vec![Matrix2::identity(); prepared.used.len()];
        for (index, whiten) in whiten.iter_mut().enumerate() {
            let it = &prepared.observations[index];
            let mut covariance = Matrix2::identity() * it.sigma_px.powi(2);
            if let Some(linear) = prepared.linear(at, index) {
                covariance += linear.by_point * it.point_covariance * linear.by_point.transpose();
                if corrected[prepared.used[index].setting].is_none() {
                    covariance += linear.by_angles * linear.by_angles.transpose() * sigma.powi(2);
                }
            }
            covariance *= factor * factor;
            let inverse = covariance.cholesky().and_then(|it| it.l().try_inverse());
            *whiten = inverse.unwrap_or_else(|| Matrix2::identity() / (factor * it.sigma_px));
        }
        Fit { prepared, chosen, whiten, corrected, n_corrected, factor }
    }

    /// `None` when the search cannot begin.
    pub fn solve(&self, mut start: Parameters, loss: Loss) -> Option<Solution<Parameters>> {
        start.corrections.resize(self.prepared.n_settings, [0.0; 2]);
        for (correction, _) in start.corrections.iter_mut().zip(&self.corrected).filter(|it| it.1.is_none()) {
            *correction = [0.0; 2];
        }
        let held = self.prepared.held(self.factor);
        let options = Options { loss, held, max_iterations: 100, relative_gain: 1e-10 };
        least_squares::solve(self, start, &options).ok()
    }

    /// Standard deviation of an error where it is largest [px].
    pub fn sigma_px(&self, index: usize) -> f64 {
        1.0 / self.whiten[index].singular_values().min()
    }

    /// Length of an error in its standard deviations.
    pub fn relative_length(&self, at: &Parameters, index: usize) -> Option<f64> {
        Some((self.whiten[index] * self.prepared.error(at, index)?).norm())
    }
}

impl Problem for Fit<'_> {
    type Parameters = Parameters;

    fn dimension(&self) -> usize {
        COMMON + 2 * self.n_corrected
    }

    fn moved(&self, from: &Parameters, step: &DVector<f64>) -> Parameters {
        let mut moved = from.clone();
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
        let shift = Translation3::new(step[3], step[4], step[5]);
        let rest = Isometry3::from_parts(shift, turn) * from.head.at_rest.camera_from_world;
        moved.head.at_rest.camera_from_world =
            Isometry3::from_parts(rest.translation, UnitQuaternion::new_normalize(rest.rotation.into_inner()));
        let origin = Point3::origin();
        moved.head.pan = from.head.pan.moved(&step.fixed_rows::<4>(6).into_owned()).footed_at(&origin);
        moved.head.tilt = from.head.tilt.moved(&step.fixed_rows::<4>(10).into_owned()).footed_at(&origin);
        for axis in 0..2 {
            moved.rad_per_unit[axis] *= step[14 + axis].exp();
        }
        moved.focal *= step[FOCAL].exp();
        for (correction, place) in moved.corrections.iter_mut().zip(&self.corrected) {
            if let Some(place) = place {
                correction[0] += step[*place];
                correction[1] += step[place + 1];
            }
        }
        moved
    }

    fn linearise(&self, at: &Parameters, equations: &mut Equations) -> Option<()> {
        let common: [usize; COMMON] = std::array::from_fn(|it| it);
        for &index in self.chosen {
            let setting = self.prepared.used[index].setting;
            let Some(linear) = self.prepared.linear(at, index) else {
                let error = Vector2::new(UNSEEN / self.factor, 0.0);
                equations.add(&[0], &error, &SMatrix::<f64, 2, 1>::zeros());
                continue;
            };
            let whiten = self.whiten[index];
            let error = whiten * (linear.pixel - self.prepared.observations[index].pixel);
            let mut by_common = SMatrix::<f64, 2, COMMON>::zeros();
            by_common.fixed_columns_mut::<SHARED>(0).copy_from(&(whiten * linear.by_shared));
            by_common.set_column(FOCAL, &(whiten * linear.by_focal));
            match self.corrected[setting] {
                None => equations.add(&common, &error, &by_common),
                Some(place) => {
                    let mut columns = [0; COMMON + 2];
                    columns[..COMMON].copy_from_slice(&common);
                    (columns[COMMON], columns[COMMON + 1]) = (place, place + 1);
                    let mut jacobian = SMatrix::<f64, 2, { COMMON + 2 }>::zeros();
                    jacobian.fixed_columns_mut::<COMMON>(0).copy_from(&by_common);
                    jacobian.fixed_columns_mut::<2>(COMMON).copy_from(&(whiten * linear.by_angles));
                    equations.add(&columns, &error, &jacobian);
                }
            }
        }
        for (correction, place) in at.corrections.iter().zip(&self.corrected) {
            if let Some(place) = *place {
                let per_sigma = 1.0 / (self.factor * self.prepared.options.setting_sigma);
                let error = Vector2::from(*correction) * per_sigma;
                equations.add(&[place, place + 1], &error, &(Matrix2::identity() * per_sigma));
            }
        }
        Some(())
    }
}

impl Prepared<'_> {
    pub(super) fn linear(&self, at: &Parameters, index: usize) -> Option<Linear> {
        let used = &self.used[index];
        let scaled = [0, 1].map(|axis| used.units[axis] * at.rad_per_unit[axis]);
        linear(&self.optics_at(at), &at.head, scaled, at.angles(used), &self.observations[index].point_in_world)
    }

    /// Seen − measured [px].
    pub(super) fn error(&self, at: &Parameters, index: usize) -> Option<Vector2<f64>> {
        let [pan, tilt] = at.angles(&self.used[index]);
        let at_rest = at.head.at_rest.camera_from_world * self.observations[index].point_in_world;
        let seen = self.optics_at(at).project(&(at.head.camera_from_rest(&Setting::new(pan, tilt)) * at_rest))?;
        Some(seen - self.observations[index].pixel)
    }

    /// The camera at the origin, with the focal lengths that are tried.
    pub(super) fn optics_at(&self, at: &Parameters) -> Camera {
        let mut optics = self.optics.clone();
        optics.intrinsics.focal = optics.intrinsics.focal.map(|it| it * at.focal);
        optics
    }

    /// Unknowns that stay, by the rules; while standard deviations are many times too large, also those of which something is known: far from the answer they
    /// would make good what the pose is off.
    fn held(&self, factor: f64) -> Vec<usize> {
        let is_coarse = factor > COARSE;
        let mut held = if self.options.axes == AxesRule::Aligned { (6..14).collect() } else { Vec::new() };
        for (axis, units) in self.options.units.iter().enumerate() {
            if matches!(units, UnitsRule::Known(_)) || (is_coarse && matches!(units, UnitsRule::Near(_))) {
                held.push(14 + axis);
            }
        }
        if is_coarse || self.options.optics == OpticsRule::Known {
            held.push(FOCAL);
        }
        held
    }
}
