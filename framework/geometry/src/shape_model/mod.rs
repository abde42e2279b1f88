//! Deformable shape models: learnt from frames with all marks, fitted to frames in which some are hidden [Davis 2002 §5.4].
//!
//! A shape is a sum of bases, x(w) = o + B w, here with three numbers for each mark, in a space that moves with the
//! head. There are two kinds of bases:
//!
//! | | bases | weights | o |
//! |---|---|---|---|
//! | [`Bases::Faces`] | captured shapes, the most extreme ones along the principal components | each in 0..=1, the paper's way | 0 |
//! | [`Bases::Components`] | principal components | of known variance: the prior | the mean shape |
//!
//! Components are those of the captured covariance plus a little, [`AcquisitionOptions::unseen`]: neighbouring marks may also move together
//! in directions that were not captured, in proportion to their captured movement.
//!
//! The fit ([`ShapeFitter`]) estimates weights and pose together by Gauss–Newton, each mark weighted by its own
//! covariance. The covariance of a filled-in mark has two parts: the uncertainty of weights and pose from the visible
//! marks, and what no weights explain. The second is learnt when the model is acquired: models are learnt without one
//! stretch of the frames each, marks of that stretch are hidden, and their errors are kept.
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `label` | label of a mark, as its features are labelled | – |
//! | `measured_from_shape` | maps points of the model's space to that of the observed marks | –, m |
//! | δ | (rotation, translation) of `measured_from_shape` ∘ exp(δ) | rad, m |

mod acquire;
mod bases;
mod fit;
mod judge;
mod procrustes;
mod solve;
#[cfg(test)]
mod tests;

pub use acquire::{AcquisitionError, AcquisitionOptions, acquire};
pub use fit::{FitOptions, FittedMark, FittedShape, MarkObservation, ShapeError, ShapeFitter};

use nalgebra::{DMatrix, Matrix3, Point3};

/// Kind of bases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ShapeKind {
    /// Captured shapes with weights between bounds.
    Faces,
    /// Principal components with their variances.
    #[default]
    Components,
}

/// Constraints of the weights.
#[derive(Debug, Clone, PartialEq)]
pub enum Bases {
    /// The bases are shapes; each weight lies within these bounds, which may be infinite.
    Faces {
        /// Lower bound of the weights [–].
        lowest: f64,
        /// Upper bound of the weights [–].
        highest: f64,
    },
    /// The bases are offsets from the mean shape, with these prior variances; infinite: no prior [m²].
    Components {
        /// Variance of each base, above zero [m²].
        variances: Vec<f64>,
    },
}

/// 99th percentiles of a fit's figures for held-out shapes of the captured kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Usual {
    /// Root mean square residual at visible marks, over what noise and omitted components explain [–].
    pub misfit: f64,
    /// Root mean square of the weights over their standard deviations; 0 for faces, whose weights have none [–].
    pub strain: f64,
}

/// A deformable shape model.
#[derive(Debug, Clone, PartialEq)]
pub struct ShapeModel {
    /// Labels of the marks, ascending.
    pub labels: Vec<u32>,
    /// By mark: mean position, in the model's space [m].
    pub mean: Vec<Point3<f64>>,
    /// By mark: standard deviation of its movement about the mean, each axis [m].
    pub spreads: Vec<f64>,
    /// Bases: three rows for each mark, a column for each base [m].
    pub shapes: DMatrix<f64>,
    /// Constraints of the weights.
    pub bases: Bases,
    /// By mark: variance of each axis that the bases do not explain [m²].
    pub unexplained: Vec<f64>,
    /// By mark: covariance, where it is hidden, beyond the uncertainty of weights and pose [m²].
    pub hidden: Vec<Matrix3<f64>>,
    /// Reference figures for the out-of-distribution score.
    pub usual: Usual,
}

impl ShapeModel {
    /// Index of the mark with this label.
    pub fn index_of(&self, label: u32) -> Option<usize> {
        self.labels.binary_search(&label).ok()
    }

    /// Number of bases.
    pub fn n_bases(&self) -> usize {
        self.shapes.ncols()
    }

    /// The first inconsistency of the model, if any: what was found and expected. For models that do not come from [`acquire`].
    pub fn fault(&self) -> Option<String> {
        let n = self.labels.len();
        if n < 3 {
            return Some(format!("{n} marks; expected 3 or more"));
        }
        if let Some(at) = self.labels.windows(2).find(|it| it[0] >= it[1]) {
            return Some(format!("label {} after {}; expected ascending labels", at[1], at[0]));
        }
        let lists = [
            ("mean places", self.mean.len()),
            ("spreads", self.spreads.len()),
            ("unexplained variances", self.unexplained.len()),
            ("covariances of hidden marks", self.hidden.len()),
            ("rows of the bases, in threes,", self.shapes.nrows() / 3),
        ];
        if let Some((what, found)) = lists.into_iter().find(|it| it.1 != n) {
            return Some(format!("{found} {what} for {n} marks; expected as many"));
        }
        let sound = |it: &f64| it.is_finite() && *it >= 0.0;
        let numbers = [
            self.mean.iter().all(|it| it.coords.sum().is_finite()),
            self.shapes.iter().all(|it| it.is_finite()),
            self.spreads.iter().chain(&self.unexplained).all(sound),
            self.hidden.iter().all(|it| it.iter().all(|it| it.is_finite()) && it.diagonal().iter().all(sound)),
            [self.usual.misfit, self.usual.strain].iter().all(sound),
        ];
        if let Some(list) = numbers.iter().position(|it| !it) {
            let what =
                ["mean", "bases", "spreads and unexplained variances", "hidden marks", "usual misfit and strain"];
            return Some(format!("{}: expected finite numbers, variances not below 0", what[list]));
        }
        match &self.bases {
            Bases::Faces { lowest, highest } if !(lowest <= highest && *lowest < f64::INFINITY) => {
                Some(format!("weights of {lowest} at least and {highest} at most; expected the least first"))
            }
            Bases::Components { variances } if variances.len() != self.n_bases() => {
                Some(format!("{} variances for {} components; expected as many", variances.len(), self.n_bases()))
            }
            Bases::Components { variances } if !variances.iter().all(|it| *it > 0.0) => {
                Some("a variance of a component that is not above 0".to_owned())
            }
            _ => None,
        }
    }
}
