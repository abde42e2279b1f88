//! A patch prepared for matching: its gray levels, their derivatives by the unknowns, the normal equations.

use nalgebra::{Matrix2, SMatrix, SVector};

use super::spline::SplineImage;
use super::{MAX_REACH, MatchOptions, Refused, lanes};

/// Geometric unknowns: shift right and down; then what the shift right gains over half a patch to the right and down, and the shift down likewise.
pub(super) const N: usize = 6;
pub(super) type Unknowns = SVector<f64, N>;
pub(super) type Information = SMatrix<f64, N, N>;
/// Reciprocal condition below which the six unknowns cannot be separated: single precision has seven digits.
const SINGULAR: f64 = 1e-6;

/// A template of (2 `reach` + 1)² pixels for matching; its memory is reused by each [`Template::take`].
#[derive(Debug, Clone, Default)]
pub struct Template {
    /// Half a side, without the centre [px].
    pub(super) reach: usize,
    centre: [f64; 2],
    /// Gray levels less their mean.
    pub(super) values: Vec<f32>,
    pub(super) mean: f32,
    /// Σ values².
    pub(super) energy: f64,
    /// One derivative after the other, each orthogonal to a constant and to `values`.
    columns: Vec<f32>,
    /// Cᵀ C of the columns.
    pub(super) information: Information,
    /// Its inverse.
    pub(super) inverse: Information,
}

impl Template {
    /// Takes the patch around `at` (column, row) of `picture`, which need not be a whole pixel.
    ///
    /// # Errors
    /// [`Refused::Outside`], or [`Refused::NoTexture`] where the six unknowns are not fixed.
    ///
    /// # Panics
    /// When `reach` is 0 or more than [`MAX_REACH`].
    pub fn take(
        &mut self,
        picture: &SplineImage,
        at: [f64; 2],
        reach: usize,
        options: &MatchOptions,
    ) -> Result<(), Refused> {
        assert!((1..=MAX_REACH).contains(&reach), "a patch reaches 1 to {MAX_REACH} px, found {reach}");
        let side = 2 * reach + 1;
        let n = side * side;
        (self.reach, self.centre) = (reach, at);
        self.values.resize(n, 0.0);
        self.columns.resize(N * n, 0.0);
        let (shifts, rest) = self.columns.split_at_mut(2 * n);
        let (right, down) = shifts.split_at_mut(n);
        if !picture.sample_with_gradient(at, reach, &mut self.values, right, down) {
            return Err(Refused::Outside);
        }
        self.mean = lanes::sum(&self.values) / n as f32;
        self.values.iter_mut().for_each(|it| *it -= self.mean);
        self.energy = f64::from(lanes::dot(&self.values, &self.values));
        if self.energy < options.min_contrast * options.min_contrast * n as f64 || self.energy <= 0.0 {
            return Err(Refused::NoTexture);
        }
        let (of_right, of_down) = rest.split_at_mut(2 * n);
        let (right_u, right_v) = of_right.split_at_mut(n);
        let (down_u, down_v) = of_down.split_at_mut(n);
        let scale = 1.0 / reach as f32;
        for j in 0..side {
            let v = (j as f32 - reach as f32) * scale;
            let row = j * side..(j + 1) * side;
            let (right, down) = (&right[row.clone()], &down[row.clone()]);
            let (right_u, right_v) = (&mut right_u[row.clone()], &mut right_v[row.clone()]);
            let (down_u, down_v) = (&mut down_u[row.clone()], &mut down_v[row]);
            for i in 0..side {
                let u = (i as f32 - reach as f32) * scale;
                (right_u[i], right_v[i]) = (right[i] * u, right[i] * v);
                (down_u[i], down_v[i]) = (down[i] * u, down[i] * v);
            }
        }
        for column in self.columns.chunks_exact_mut(n) {
            let mean = lanes::sum(column) / n as f32;
            let along = lanes::dot(column, &self.values) / self.energy as f32;
            for (it, value) in column.iter_mut().zip(&self.values) {
                *it -= mean + along * value;
            }
        }
        for i in 0..N {
            for j in 0..=i {
                let both = f64::from(lanes::dot(self.column(i), self.column(j)));
                (self.information[(i, j)], self.information[(j, i)]) = (both, both);
            }
        }
        self.inverse = invert(&self.information).ok_or(Refused::NoTexture)?;
        Ok(())
    }

    /// Half a side of the patch, without its centre [px].
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// Where its centre lies: column, row [px].
    pub fn centre(&self) -> [f64; 2] {
        self.centre
    }

    /// Pixels in the patch.
    pub(super) fn n(&self) -> usize {
        self.values.len()
    }

    pub(super) fn column(&self, index: usize) -> &[f32] {
        let n = self.n();
        &self.columns[index * n..(index + 1) * n]
    }

    /// Covariance of the shift for noise of one gray level in the difference of the two patches [px²]: the Cramér–Rao bound.
    pub fn bound(&self) -> Matrix2<f64> {
        self.inverse.fixed_view::<2, 2>(0, 0).into_owned()
    }
}

/// The inverse, unless some unknown is not fixed beside the others.
fn invert(information: &Information) -> Option<Information> {
    let scales = information.diagonal().map(f64::sqrt);
    if scales.min() <= 0.0 {
        return None;
    }
    let scaled = Information::from_fn(|i, j| information[(i, j)] / (scales[i] * scales[j]));
    let inverse = scaled.cholesky()?.inverse();
    // Of a matrix with ones on its diagonal the largest entry of the inverse is within a factor of 6 of the condition.
    let sound = inverse.diagonal().max() < 1.0 / SINGULAR;
    sound.then(|| Information::from_fn(|i, j| inverse[(i, j)] / (scales[i] * scales[j])))
}
