//! Weights and pose together: Gauss–Newton over the pose, and for each pose the weights within their bounds.
//!
//! With p = R⁻¹ (y − t) an observed mark in the model's space and δ a step of the pose, p + [p]ₓ δθ − δt = o + B w is
//! linear in (δ, w). Its normal equations
//!
//! | H_δδ H_δw | δ |   | b_δ |
//! | H_wδ G    | w | = | b_w |
//!
//! weigh each mark by the inverse of its covariance with what the bases leave unexplained; G holds the prior of the weights, too.

use foveate_estimation::bounded::ActiveSet;
use nalgebra::{
    Cholesky, DMatrix, DVector, Dyn, Isometry3, Matrix3, Matrix3x6, Matrix6, Point3, Translation3, UnitQuaternion,
    Vector3, Vector6,
};

use super::acquire::place_in;
use super::fit::{MarkObservation, ShapeError};
use super::{Bases, ShapeModel};

const STEPS: usize = 25;
/// Steps below this end the search [rad; m].
const SETTLED: [f64; 2] = [1e-7, 1e-8];
/// Where weights lie between bounds, their standard deviation beforehand: for the covariance alone.
const BOUNDED_SIGMA: f64 = 1.0;

/// The marks that are to be fitted, with their places in the model.
pub(super) struct Sought<'a> {
    pub(super) model: &'a ShapeModel,
    pub(super) seen: &'a [(usize, MarkObservation)],
}

/// A fit.
#[derive(Debug, Clone)]
pub(super) struct Solved {
    pub(super) pose: Isometry3<f64>,
    pub(super) pose_covariance: Matrix6<f64>,
    pub(super) weights: Vec<f64>,
    /// B w + o.
    places: DVector<f64>,
    /// By mark of the model: what weights and pose leave open of its place, in the model's axes [m²].
    pub(super) open: Vec<Matrix3<f64>>,
    pub(super) misfit: f64,
    /// By seen mark: inverse of the covariance with which it was weighed, in the model's axes.
    information: Vec<Matrix3<f64>>,
}

impl Solved {
    pub(super) fn place(&self, _model: &ShapeModel, mark: usize) -> Point3<f64> {
        place_in(self.places.as_slice(), mark)
    }
}

/// ∂(p + δθ × p + δt) / ∂δ.
fn by_pose(point: &Point3<f64>) -> Matrix3x6<f64> {
    let mut by = Matrix3x6::zeros();
    by.fixed_view_mut::<3, 3>(0, 0).copy_from(&-point.coords.cross_matrix());
    by.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
    by
}

/// What stays the same while the pose is sought.
struct Normal {
    /// Whitened rows of the bases at the seen marks.
    rows: DMatrix<f64>,
    /// U of Uᵀ U = information, by seen mark.
    roots: Vec<Matrix3<f64>>,
    /// With the prior.
    gram: DMatrix<f64>,
}

impl Sought<'_> {
    /// Searches from the pose `start`; `set` is where the last search for weights at bounds ended.
    pub(super) fn find(&self, start: Isometry3<f64>, set: &mut Option<ActiveSet>) -> Result<Solved, ShapeError> {
        let model = self.model;
        let k = model.n_bases();
        let (information, normal) = self.weigh(&start)?;
        let bounds = match &model.bases {
            Bases::Faces { lowest, highest } => Some((vec![*lowest; k], vec![*highest; k])),
            Bases::Components { .. } => None,
        };
        let factor = match bounds {
            None => Some(Cholesky::new(normal.gram.clone()).ok_or(ShapeError::Unsolvable)?),
            Some(_) => None,
        };
        let mut pose = start;
        let mut weights = DVector::zeros(k);
        for _ in 0..STEPS {
            let linear = self.linear(&pose, &normal);
            let step = match (&factor, &bounds) {
                (Some(factor), _) => {
                    let by_weights = factor.solve(&linear.cross);
                    let free = factor.solve(&linear.of_weights);
                    let left = linear.pose - linear.cross.tr_mul(&by_weights).fixed_view::<6, 6>(0, 0);
                    let right = linear.of_pose - linear.cross.tr_mul(&free).fixed_rows::<6>(0);
                    let step =
                        Cholesky::new(left).ok_or(ShapeError::Collinear { found: self.seen.len() })?.solve(&right);
                    weights = free - by_weights * step;
                    step
                }
                (None, Some((lower, upper))) => {
                    let pose_factor =
                        Cholesky::new(linear.pose).ok_or(ShapeError::Collinear { found: self.seen.len() })?;
                    let root = pose_factor
                        .l()
                        .solve_lower_triangular(&linear.cross_transposed())
                        .ok_or(ShapeError::Unsolvable)?;
                    let gram = &normal.gram - root.tr_mul(&root);
                    let right = &linear.of_weights - &linear.cross * pose_factor.solve(&linear.of_pose);
                    let set = set.get_or_insert_with(|| ActiveSet::new(lower, upper));
                    set.minimise(&gram, right.as_slice(), lower, upper).map_err(|_| ShapeError::Unsolvable)?;
                    weights.copy_from_slice(set.weights());
                    pose_factor.solve(&(linear.of_pose - linear.cross.tr_mul(&weights).fixed_rows::<6>(0)))
                }
                (None, None) => unreachable!("bases are bounded or factored"),
            };
            let turn: Vector3<f64> = step.fixed_rows::<3>(0).into_owned();
            let shift: Vector3<f64> = step.fixed_rows::<3>(3).into_owned();
            if !step.iter().all(|it| it.is_finite()) {
                return Err(ShapeError::Unsolvable);
            }
            pose *= Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_scaled_axis(turn));
            if turn.norm() < SETTLED[0] && shift.norm() < SETTLED[1] {
                break;
            }
        }
        self.conclude(pose, weights, information, normal, set.as_ref().filter(|_| bounds.is_some()))
    }

    /// Informations of the seen marks, in the model's axes, and the rows of the bases by them.
    fn weigh(&self, pose: &Isometry3<f64>) -> Result<(Vec<Matrix3<f64>>, Normal), ShapeError> {
        let model = self.model;
        let k = model.n_bases();
        let turn = pose.rotation.to_rotation_matrix();
        let mut rows = DMatrix::zeros(3 * self.seen.len(), k);
        let (mut informations, mut roots) = (Vec::new(), Vec::new());
        for (place, (mark, observation)) in self.seen.iter().enumerate() {
            let covariance = turn.transpose() * observation.covariance * turn.matrix()
                + Matrix3::from_diagonal_element(model.unexplained[*mark]);
            let information = (covariance + covariance.transpose()).try_inverse().ok_or(ShapeError::Unsolvable)? * 2.0;
            let root = Cholesky::new(information).ok_or(ShapeError::Unsolvable)?.l().transpose();
            rows.rows_mut(3 * place, 3).copy_from(&(root * model.shapes.fixed_rows::<3>(3 * mark)));
            informations.push(information);
            roots.push(root);
        }
        let mut gram = rows.transpose() * &rows;
        if let Bases::Components { variances } = &model.bases {
            variances.iter().enumerate().for_each(|(index, it)| gram[(index, index)] += 1.0 / it);
        }
        Ok((informations, Normal { rows, roots, gram }))
    }

    fn linear(&self, pose: &Isometry3<f64>, normal: &Normal) -> Linear {
        let model = self.model;
        let n = 3 * self.seen.len();
        let mut pose_rows = DMatrix::<f64>::zeros(n, 6);
        let mut right = DVector::<f64>::zeros(n);
        for (place, ((mark, observation), root)) in self.seen.iter().zip(&normal.roots).enumerate() {
            let point = pose.inverse_transform_point(&observation.position);
            pose_rows.rows_mut(3 * place, 3).copy_from(&(root * by_pose(&point)));
            let off = match model.bases {
                Bases::Faces { .. } => point.coords,
                Bases::Components { .. } => point - model.mean[*mark],
            };
            right.rows_mut(3 * place, 3).copy_from(&(root * off));
        }
        Linear {
            pose: pose_rows.tr_mul(&pose_rows).fixed_view::<6, 6>(0, 0).into_owned(),
            of_pose: pose_rows.tr_mul(&right).fixed_rows::<6>(0).into_owned(),
            cross: normal.rows.tr_mul(&pose_rows),
            of_weights: normal.rows.tr_mul(&right),
        }
    }

    fn conclude(
        &self,
        pose: Isometry3<f64>,
        weights: DVector<f64>,
        information: Vec<Matrix3<f64>>,
        normal: Normal,
        set: Option<&ActiveSet>,
    ) -> Result<Solved, ShapeError> {
        let model = self.model;
        let n = model.labels.len();
        let mut places = &model.shapes * &weights;
        if let Bases::Components { .. } = model.bases {
            model.mean.iter().enumerate().for_each(|(mark, it)| {
                let mut place = places.fixed_rows_mut::<3>(3 * mark);
                place += it.coords;
            });
        }
        // Weights at bounds are taken to be known.
        let free: Vec<usize> = match set {
            Some(set) => (0..weights.len()).filter(|it| set.is_free(*it)).collect(),
            None => (0..weights.len()).collect(),
        };
        let linear = self.linear(&pose, &normal);
        let (mut gram, cross, shapes) = match set {
            None => (normal.gram, linear.cross, None),
            Some(_) => (
                normal.gram.select_rows(&free).select_columns(&free),
                linear.cross.select_rows(&free),
                Some(model.shapes.select_columns(&free)),
            ),
        };
        if set.is_some() {
            (0..free.len()).for_each(|it| gram[(it, it)] += BOUNDED_SIGMA.powi(-2));
        }
        let factor: Cholesky<f64, Dyn> = Cholesky::new(gram).ok_or(ShapeError::Unsolvable)?;
        let by_pose_step = factor.solve(&cross);
        let left = linear.pose - cross.tr_mul(&by_pose_step).fixed_view::<6, 6>(0, 0);
        let pose_covariance = Cholesky::new(left).ok_or(ShapeError::Collinear { found: self.seen.len() })?.inverse();
        let shapes = shapes.as_ref().unwrap_or(&model.shapes);
        let halves = factor.l().solve_lower_triangular(&shapes.transpose()).ok_or(ShapeError::Unsolvable)?;
        let mut open = Vec::with_capacity(n);
        for mark in 0..n {
            let half = halves.columns(3 * mark, 3);
            let by_weights = half.tr_mul(&half);
            let bases = shapes.fixed_rows::<3>(3 * mark);
            let step = by_pose(&place_in(places.as_slice(), mark)) - bases * &by_pose_step;
            open.push(step * pose_covariance * step.transpose() + by_weights.fixed_view::<3, 3>(0, 0));
        }
        let mut solved =
            Solved { pose, pose_covariance, weights: weights.data.into(), places, open, misfit: 0.0, information };
        let (mut squares, mut left) = (0.0, 0.0);
        for ((mark, observation), information) in self.seen.iter().zip(&solved.information) {
            let off = pose.inverse_transform_point(&observation.position) - solved.place(model, *mark);
            squares += off.dot(&(information * off));
            left += 3.0 - (information * solved.open[*mark]).trace();
        }
        solved.misfit = (squares / left.max(1.0)).sqrt();
        Ok(solved)
    }
}

/// The parts of the normal equations at a pose that move with it.
struct Linear {
    pose: Matrix6<f64>,
    of_pose: Vector6<f64>,
    /// H_wδ.
    cross: DMatrix<f64>,
    of_weights: DVector<f64>,
}

impl Linear {
    fn cross_transposed(&self) -> DMatrix<f64> {
        self.cross.transpose()
    }
}

/// By seen mark: the square of its distance from where all others have it, over its covariance; as large as three squared normal numbers where all is well.
///
/// That place need not be computed: with R the covariance by which the mark was weighed, V what the fit leaves open of it and r what is left, the
/// others have it at a distance of R (R − V)⁻¹ r, known to R (R − V)⁻¹ R − R.
pub(super) fn judge_marks(model: &ShapeModel, kept: &[(usize, MarkObservation)], solved: &Solved) -> Vec<f64> {
    let square = |(mark, observation): &(usize, MarkObservation), information: &Matrix3<f64>| {
        let weighed = information.try_inverse()?;
        let left = solved.pose.inverse_transform_point(&observation.position) - solved.place(model, *mark);
        let gain = weighed * (weighed - solved.open[*mark]).try_inverse()?;
        let apart = gain * left;
        let known = gain * weighed;
        // Beyond what the fit weighed by, what hidden marks are known to be off.
        let beyond = model.hidden[*mark] - Matrix3::from_diagonal_element(model.unexplained[*mark]);
        let mut covariance = (known + known.transpose()) / 2.0;
        for axis in 0..3 {
            covariance[(axis, axis)] += beyond[(axis, axis)].max(0.0);
        }
        Some(apart.dot(&(covariance.try_inverse()? * apart)).max(0.0))
    };
    kept.iter().zip(&solved.information).map(|(it, information)| square(it, information).unwrap_or(0.0)).collect()
}
