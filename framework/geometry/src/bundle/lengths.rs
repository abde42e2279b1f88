//! Known lengths between two points, such as a wand's: they fix the scale, and couple the two points when these are eliminated.

use foveate_estimation::Loss;
use nalgebra::{Matrix3, Matrix6, Point3, Vector3};

/// A length in the units of the search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Length {
    pub points: [usize; 2],
    pub length: f64,
    pub sigma: f64,
}

impl Length {
    /// Adds its part of the normal equations and gives its cost; `coupling` becomes the block of the first point and the second.
    /// `None` where the points are in one place.
    pub(super) fn add(
        &self,
        points: &[Point3<f64>],
        loss: &Loss,
        of_point: &mut [Matrix3<f64>],
        gradient_of_point: &mut [Vector3<f64>],
        coupling: &mut Matrix3<f64>,
    ) -> Option<f64> {
        let [a, b] = self.points;
        let apart = points[a] - points[b];
        let distance = apart.norm();
        let along = apart / distance;
        let residual = (distance - self.length) / self.sigma;
        let (cost, weight) = loss.at(residual * residual);
        let block = along * along.transpose() * (weight / (self.sigma * self.sigma));
        let gradient = along * (weight * residual / self.sigma);
        of_point[a] += block;
        of_point[b] += block;
        gradient_of_point[a] += gradient;
        gradient_of_point[b] -= gradient;
        *coupling = -block;
        (distance > 0.0).then_some(0.5 * cost)
    }
}

/// The inverse of the 6 × 6 block of two coupled points.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Coupled {
    inverse: Matrix6<f64>,
}

impl Coupled {
    /// With the diagonal raised by the part `damping`; 0 if singular: such points do not move and tell nothing.
    pub(super) fn inverse_of([a, b]: [Matrix3<f64>; 2], coupling: &Matrix3<f64>, damping: f64) -> Coupled {
        let mut whole = Matrix6::zeros();
        whole.fixed_view_mut::<3, 3>(0, 0).copy_from(&a);
        whole.fixed_view_mut::<3, 3>(3, 3).copy_from(&b);
        whole.fixed_view_mut::<3, 3>(0, 3).copy_from(coupling);
        whole.fixed_view_mut::<3, 3>(3, 0).copy_from(&coupling.transpose());
        (0..6).for_each(|it| whole[(it, it)] *= 1.0 + damping);
        Coupled { inverse: whole.cholesky().map_or_else(Matrix6::zeros, |it| it.inverse()) }
    }

    /// Of both points, one after the other.
    pub(super) fn inverse(&self) -> &Matrix6<f64> {
        &self.inverse
    }

    /// The block that leads from the gradient of point `from` to the step of point `to`.
    pub(super) fn block(&self, to: usize, from: usize) -> Matrix3<f64> {
        self.inverse.fixed_view::<3, 3>(3 * to, 3 * from).into_owned()
    }
}
