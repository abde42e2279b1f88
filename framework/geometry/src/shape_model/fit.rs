//! Fits a model to the visible marks: pose, weights, and the positions of hidden marks.

use foveate_estimation::bounded::ActiveSet;
use foveate_estimation::statistics::median;
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3};

use super::solve::{Solved, Sought, judge_marks};
use super::{Bases, ShapeModel};
use crate::alignment::weighted;

/// The median of the square of three normal numbers' length.
const MEDIAN_OF_CHI_SQUARED_3: f64 = 2.366;
/// Rounds of doubt in the first alignment, in which marks do not weigh that lie far off.
const ALIGNMENT_ROUNDS: usize = 8;

/// An observed mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkObservation {
    /// Label of the mark.
    pub label: u32,
    /// Measured position [m].
    pub position: Point3<f64>,
    /// Covariance of the position, in the same axes [m²].
    pub covariance: Matrix3<f64>,
}

impl MarkObservation {
    /// A mark with its position and covariance.
    pub fn new(label: u32, position: Point3<f64>, covariance: Matrix3<f64>) -> Self {
        Self { label, position, covariance }
    }
}

/// Options of [`ShapeFitter::fit`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitOptions {
    /// Outlier gate: distance of a mark from its position as predicted by the others [σ]; infinite: no outliers [–].
    pub gate_sigmas: f64,
    /// Largest share of outliers among the visible marks; with more, the shape is taken as unknown and no mark is left out [–].
    pub wrong_at_most: f64,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { gate_sigmas: 6.0, wrong_at_most: 0.2 }
    }
}

/// A mark of the model after a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedMark {
    /// Fitted position, in the model's space [m].
    pub position: Point3<f64>,
    /// Covariance of a hidden mark about this position, in the model's axes: from the uncertainty of weights *and
    /// pose*, and what no weights explain [m²].
    pub covariance: Matrix3<f64>,
}

/// A fitted shape.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedShape {
    /// Maps points of the model's space to that of the observations.
    pub measured_from_shape: Isometry3<f64>,
    /// Covariance of δ, (rotation, translation) [rad², rad m, m²].
    pub covariance: Matrix6<f64>,
    /// Weight of each base [–, or m for components].
    pub weights: Vec<f64>,
    /// Each mark of the model, visible or not.
    pub marks: Vec<FittedMark>,
    /// Root mean square distance between the used marks and the model's [m].
    pub rms: f64,
    /// Out-of-distribution score: 0 within the captured shapes, 1 where the fit cannot be trusted.
    pub out_of_distribution: f64,
    /// Root mean square residual over what noise and omitted components explain [–].
    pub misfit: f64,
    /// Root mean square of the weights over their standard deviations [–].
    pub strain: f64,
    /// Labels of outliers.
    pub wrong: Vec<u32>,
}

/// Why there is no fit.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ShapeError {
    /// Too few marks of the model are visible.
    #[error("{found} marks of the model are visible, expected at least 3")]
    TooFew {
        /// Number of visible marks.
        found: usize,
    },
    /// The visible marks lie in one place or on a line.
    #[error("the {found} visible marks of the model lie on a line: they do not determine a pose")]
    Collinear {
        /// Number of visible marks.
        found: usize,
    },
    /// A position or covariance that is not finite.
    #[error("mark {label}: its position or covariance is not finite")]
    NotFinite {
        /// Label of the mark.
        label: u32,
    },
    /// A covariance with a negative variance, or numbers that differ too much in size.
    #[error("the marks do not match the model: the equations have no solution")]
    Unsolvable,
}

impl FittedShape {
    /// What is open of a mark's place, where the model knows nothing of hidden marks yet but `unexplained` variance.
    pub(super) fn covariance_of_open(&self, mark: usize, unexplained: f64) -> Matrix3<f64> {
        self.marks[mark].covariance - Matrix3::from_diagonal_element(unexplained)
    }
}

/// Fits a model frame by frame; the search for weights at bounds starts where the last one ended.
#[derive(Debug, Clone)]
pub struct ShapeFitter {
    model: ShapeModel,
    pub(super) set: Option<ActiveSet>,
}

impl ShapeFitter {
    /// A fitter for `model`, which must be without [`ShapeModel::fault`].
    pub fn new(model: ShapeModel) -> Self {
        Self { model, set: None }
    }

    /// The model in use.
    pub fn model(&self) -> &ShapeModel {
        &self.model
    }

    /// Pose and shape that fit `observations` best. Marks unknown to the model, and repeated labels, are ignored.
    ///
    /// # Errors
    /// See [`ShapeError`].
    pub fn fit(&mut self, observations: &[MarkObservation], options: &FitOptions) -> Result<FittedShape, ShapeError> {
        let sound = |it: &MarkObservation| it.position.coords.sum().is_finite() && it.covariance.sum().is_finite();
        if let Some(broken) = observations.iter().find(|it| !sound(it)) {
            return Err(ShapeError::NotFinite { label: broken.label });
        }
        let mut seen: Vec<(usize, MarkObservation)> =
            observations.iter().filter_map(|it| Some((self.model.index_of(it.label)?, *it))).collect();
        seen.sort_by_key(|it| it.0);
        seen.dedup_by_key(|it| it.0);
        if seen.len() < 3 {
            return Err(ShapeError::TooFew { found: seen.len() });
        }
        let start = self.first_pose(&seen)?;
        let all = self.solve(&seen, start)?;
        let most_wrong = (options.wrong_at_most * seen.len() as f64) as usize;
        let (mut kept, mut solved, mut wrong) = (seen.clone(), all.clone(), Vec::new());
        while let Some(place) = worst(&self.model, &kept, &solved, options.gate_sigmas) {
            if wrong.len() >= most_wrong || kept.len() <= 4 {
                // So many cannot be wrong: it is a shape that the model does not know.
                (kept, solved) = (seen, all);
                wrong.clear();
                break;
            }
            wrong.push(kept.remove(place).1.label);
            solved = self.solve(&kept, solved.pose)?;
        }
        wrong.sort_unstable();
        Ok(self.describe(&kept, solved, wrong))
    }

    fn solve(&mut self, seen: &[(usize, MarkObservation)], start: Isometry3<f64>) -> Result<Solved, ShapeError> {
        Sought { model: &self.model, seen }.find(start, &mut self.set)
    }

    fn describe(&self, kept: &[(usize, MarkObservation)], solved: Solved, wrong: Vec<u32>) -> FittedShape {
        let model = &self.model;
        let usual = model.usual;
        let strain = match &model.bases {
            Bases::Faces { .. } => 0.0,
            Bases::Components { variances } => {
                let squares: f64 = solved.weights.iter().zip(variances).map(|(it, variance)| it * it / variance).sum();
                (squares / variances.len().max(1) as f64).sqrt()
            }
        };
        // Below what is usual where it is known; a model of rigid or few frames knows nothing usual below 1.
        let over = (solved.misfit / usual.misfit.max(1.0)).max(strain / usual.strain.max(1.0));
        let inflation = over.max(1.0).powi(2);
        let shape = |mark: usize| solved.place(model, mark);
        let squares: f64 = kept
            .iter()
            .map(|(mark, it)| (solved.pose.inverse_transform_point(&it.position) - shape(*mark)).norm_squared())
            .sum();
        let fitted = |mark: usize| FittedMark {
            position: shape(mark),
            covariance: (solved.open[mark] + model.hidden[mark]) * inflation,
        };
        FittedShape {
            measured_from_shape: solved.pose,
            covariance: solved.pose_covariance * inflation,
            marks: (0..model.labels.len()).map(fitted).collect(),
            rms: (squares / kept.len() as f64).sqrt(),
            out_of_distribution: (over - 1.0).clamp(0.0, 1.0),
            misfit: solved.misfit,
            strain,
            wrong,
            weights: solved.weights,
        }
    }

    /// From the mean shape, by marks as they are known to move; those far off weigh little.
    fn first_pose(&self, seen: &[(usize, MarkObservation)]) -> Result<Isometry3<f64>, ShapeError> {
        let model = &self.model;
        let places: Vec<Point3<f64>> = seen.iter().map(|it| model.mean[it.0]).collect();
        let marks: Vec<Point3<f64>> = seen.iter().map(|it| it.1.position).collect();
        let least = model.unexplained.iter().copied().fold(f64::INFINITY, f64::min).max(f64::MIN_POSITIVE);
        let variances: Vec<f64> = seen
            .iter()
            .map(|(mark, it)| model.spreads[*mark].powi(2) + it.covariance.trace().max(0.0) / 3.0 + least)
            .collect();
        let mut weights: Vec<f64> = variances.iter().map(|it| 1.0 / it).collect();
        let collinear = ShapeError::Collinear { found: seen.len() };
        let mut pose = weighted(&places, &marks, &weights, false).map_err(|_| collinear)?.isometry;
        for _ in 0..ALIGNMENT_ROUNDS {
            let off: Vec<f64> = places
                .iter()
                .zip(&marks)
                .zip(&variances)
                .map(|((place, mark), variance)| (pose * place - mark).norm() / variance.sqrt())
                .collect();
            let scale = 2.385 * median(&off).unwrap_or(0.0).max(1.0);
            weights = off
                .iter()
                .zip(&variances)
                .map(|(it, variance)| 1.0 / (variance * (1.0 + (it / scale).powi(2))))
                .collect();
            pose = weighted(&places, &marks, &weights, false).map_err(|_| collinear)?.isometry;
        }
        Ok(pose)
    }
}

/// The mark furthest from where the others have it, if it is too far.
fn worst(model: &ShapeModel, kept: &[(usize, MarkObservation)], solved: &Solved, gate_sigmas: f64) -> Option<usize> {
    if gate_sigmas == f64::INFINITY {
        return None;
    }
    let squares = judge_marks(model, kept, solved);
    let usual = (median(&squares)? / MEDIAN_OF_CHI_SQUARED_3).max(1.0);
    let (place, square) = squares.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    (*square > gate_sigmas.powi(2) * usual).then_some(place)
}
