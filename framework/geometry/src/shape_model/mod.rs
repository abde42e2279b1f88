//! Shapes that deform: learnt from frames in which all marks are seen, fitted to frames in which some are hidden [Davis 2002 §5.4].
//!
//! A shape is a sum of bases, x(w) = o + B w, here with three numbers for each mark, in a space that moves with the head. Two kinds of bases:
//!
//! | | bases | weights | o |
//! |---|---|---|---|
//! | [`Bases::Faces`] | captured shapes, the most extreme ones along the principal components | each in 0..=1, the paper's way | 0 |
//! | [`Bases::Components`] | principal components | of known variance: the prior | the mean shape |
//!
//! Components are those of the captured covariance and of a little more, [`AcquisitionOptions::unseen`]: neighbouring marks also move together
//! in ways that were not captured, each as much in proportion as it was seen to move.
//!
//! The fit ([`ShapeFitter`]) finds weights and pose at once, by Gauss and Newton, each mark counting by its own covariance. The uncertainty of a filled mark has two parts: what
//! the seen marks leave open of weights and pose, and what no weights could explain. The second is learnt when the model is acquired: models are made without a
//! stretch of the frames each, marks of that stretch are hidden, and the errors at them are kept.
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `label` | which mark, as its features are labelled | – |
//! | `measured_from_shape` | takes points of the model's space to that of the sighted marks | –, m |
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

/// Which bases to take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ShapeKind {
    /// Captured shapes with weights between bounds.
    Faces,
    /// Principal components with their variances.
    #[default]
    Components,
}

/// What the weights of bases may be.
#[derive(Debug, Clone, PartialEq)]
pub enum Bases {
    /// The bases are shapes; each weight lies within these bounds, which may be infinite.
    Faces {
        /// Least weight [–].
        lowest: f64,
        /// Largest weight [–].
        highest: f64,
    },
    /// The bases are directions off the mean shape, of this variance each; infinite: nothing is known beforehand [m²].
    Components {
        /// One for each base, above zero.
        variances: Vec<f64>,
    },
}

/// What shapes of the kind that was captured do to the fit, though they themselves were not captured: 99 in 100 stay below.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Usual {
    /// Root mean square of what is left at seen marks, over what noise and left-out components explain [–].
    pub misfit: f64,
    /// Root mean square of the weights over their standard deviations; 0 for faces, whose weights have none [–].
    pub strain: f64,
}

/// A shape that deforms.
#[derive(Debug, Clone, PartialEq)]
pub struct ShapeModel {
    /// Which marks, ascending.
    pub labels: Vec<u32>,
    /// By mark: its mean place, in the model's space [m].
    pub mean: Vec<Point3<f64>>,
    /// By mark: how far it moves about its mean, standard deviation of one axis [m].
    pub spreads: Vec<f64>,
    /// Three rows for each mark, a column for each base [m].
    pub shapes: DMatrix<f64>,
    /// What the weights may be.
    pub bases: Bases,
    /// By mark: variance of one axis that the bases leave unexplained [m²].
    pub unexplained: Vec<f64>,
    /// By mark: error beyond what weights and pose leave open, where it is hidden [m²].
    pub hidden: Vec<Matrix3<f64>>,
    /// Against which a fit is held.
    pub usual: Usual,
}

impl ShapeModel {
    /// The place of the mark of this label among the marks.
    pub fn index_of(&self, label: u32) -> Option<usize> {
        self.labels.binary_search(&label).ok()
    }

    /// Number of bases.
    pub fn n_bases(&self) -> usize {
        self.shapes.ncols()
    }

    /// The first thing about the model that does not go together, if there is any: what, and what is expected. For models that come from elsewhere than
    /// [`acquire`].
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
