//! Covariance of cameras from correlated residuals: observations with errors in common, beside white noise.
//!
//! Neighbouring pictures have errors in common (stamps, the shape of the light, reflections, the lens where the light
//! is at the time), and so has each place of a picture (lens errors that the model does not describe). Two terms
//! replace the inverse information C:
//!
//! 1. *Stretches of time*: sᵦ is the gradient of stretch b with the points eliminated, and with the leverage that b
//!    has on the solution removed, so that white noise
//!    gives Σ E sᵦ sᵦᵀ = A = C⁻¹. Source: R. Bell, D. McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage
//!    samples", Survey Methodology 28(2), 2002 (its CR2); f(Aᵦ C) sᵦ with f(x) = (1 − x)^−½ by Lanczos' method in the inner product of C. There are
//!    fewer stretches than unknowns: κ = tr(C Σ sᵦ sᵦᵀ) over the number of unknowns multiplies the covariance as a whole, except for priors of the
//!    optics; single directions in which Σ sᵦ sᵦᵀ exceeds chance (κ (1 + √(unknowns / stretches))², the edge of V. Marčenko and
//!    L. Pastur) are taken as found.
//! 2. *Fields over the picture*: each camera's pixels may be displaced by a smooth field, a sum of Legendre polynomials whose coefficients have one
//!    variance τ². It is estimated from the residuals in the part of the field that cameras and points cannot absorb, and applied to the part
//!    that they do absorb, where it moves them unnoticed: τ² C b bᵀ C for each coefficient, b the gradient that it causes.

use nalgebra::{DMatrix, DVector, Matrix6, Point2, SMatrix, SVector, Vector2, Vector6};

/// Fewer stretches than this tell no variance.
const LEAST_STRETCHES: usize = 4;
/// Steps of Lanczos' method.
const LANCZOS: usize = 16;
/// Leverage is taken for no more than this: what hangs on one stretch alone has no second opinion.
const MOST_LEVERAGE: f64 = 0.95;
/// Highest degree of the fields, and the most coefficients of all cameras together: degrees are left out beyond.
const DEGREE: usize = 4;
const MOST_FIELDS: usize = 2000;

/// An observation, linearised at the solution.
#[derive(Debug, Clone)]
pub struct Linear<const C: usize> {
    /// Index of the camera.
    pub camera: usize,
    /// Weight of the squared error: one over the variance, less for outliers [1/px²].
    pub weight: f64,
    /// Derivative of the pixel with respect to the camera's free parameters.
    pub by_camera: SMatrix<f64, 2, C>,
    /// Derivative of the pixel with respect to the unknowns of its group.
    pub by_unknown: SMatrix<f64, 2, 6>,
    /// Residual: seen − measured [px].
    pub error: Vector2<f64>,
    /// Position in the picture, from its middle, relative to half the longer side [–].
    pub place: [f64; 2],
}

/// Observations whose places in space are eliminated together: of one point, of two points a known length apart, or of a rigid board.
#[derive(Debug, Clone)]
pub struct Group<const C: usize> {
    /// Index of the stretch of time.
    pub stretch: usize,
    /// Observations of the group.
    pub seen: Vec<Linear<C>>,
    /// Inverse information of the unknowns; 0 for those that the group does not have.
    pub inverse: Matrix6<f64>,
    /// Gradient of the cost with respect to the unknowns.
    pub gradient: Vector6<f64>,
}

/// All observations of a solution, and its free parameters.
#[derive(Debug, Clone)]
pub struct Correlated<const C: usize> {
    /// Groups of observations.
    pub groups: Vec<Group<C>>,
    /// By camera and column of its block: the row among all free parameters.
    pub rows: Vec<[Option<usize>; C]>,
    /// Number of rows.
    pub dimension: usize,
    /// Rows with a prior, and its standard deviation.
    pub known: Vec<(usize, f64)>,
}

/// Position of a pixel in the picture, as in [`Linear::place`].
pub fn place(pixel: &Point2<f64>, image_size: [u32; 2]) -> [f64; 2] {
    let [columns, rows] = image_size.map(f64::from);
    let half = 0.5 * columns.max(rows).max(1.0);
    let along = |it: f64, size: f64| ((it - 0.5 * (size - 1.0)) / half).clamp(-1.0, 1.0);
    [along(pixel.x, columns), along(pixel.y, rows)]
}

impl<const C: usize> Correlated<C> {
    /// The covariance that replaces `inverse`, the inverse information at right angles to so many `directions` of the gauge.
    pub fn covariance(&self, inverse: &DMatrix<f64>, directions: usize) -> DMatrix<f64> {
        let covariance = self.of_stretches(inverse, directions) + self.of_fields(inverse);
        0.5 * (&covariance + covariance.transpose())
    }

    fn add(&self, camera: usize, block: &SVector<f64, C>, to: &mut DVector<f64>) {
        for (row, value) in self.rows[camera].iter().zip(block.iter()) {
            if let Some(row) = *row {
                to[row] += value;
            }
        }
    }

    fn block(&self, camera: usize, of: &DVector<f64>) -> SVector<f64, C> {
        SVector::from_fn(|column, _| self.rows[camera][column].map_or(0.0, |row| of[row]))
    }

    fn of_stretches(&self, inverse: &DMatrix<f64>, directions: usize) -> DMatrix<f64> {
        let n = self.groups.iter().map(|it| it.stretch + 1).max().unwrap_or(0);
        let mut members: Vec<Vec<&Group<C>>> = vec![Vec::new(); n];
        self.groups.iter().for_each(|it| members[it.stretch].push(it));
        members.retain(|it| !it.is_empty());
        // C P C and the part of the unknowns that is known beforehand.
        let mut of_known = DMatrix::<f64>::zeros(self.dimension, self.dimension);
        let mut n_known = 0.0;
        for &(row, sigma) in &self.known {
            let column = inverse.column(row) / sigma;
            n_known += column[row] / sigma;
            of_known += &column * column.transpose();
        }
        let unknowns = self.dimension as f64 - directions as f64 - n_known;
        if members.len() < LEAST_STRETCHES || unknowns < 1.0 {
            return inverse.clone();
        }
        let mut scores = DMatrix::zeros(self.dimension, members.len());
        for (column, members) in members.iter().enumerate() {
            scores.set_column(column, &self.without_leverage(inverse, members, self.gradient(members)));
        }
        let moved = inverse * &scores;
        let eigen = scores.tr_mul(&moved).symmetric_eigen();
        // Errors that are new in each pixel give 1.
        let factor = (eigen.eigenvalues.sum() / unknowns).max(1.0);
        let mut covariance = inverse * factor - of_known * (factor - 1.0);
        let edge = factor * (1.0 + (unknowns / members.len() as f64).sqrt()).powi(2);
        for (value, direction) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > edge {
                let step = &moved * direction;
                covariance += &step * step.transpose() * (1.0 - factor / value);
            }
        }
        covariance
    }

    /// Of some groups, when their unknowns follow.
    fn gradient(&self, members: &[&Group<C>]) -> DVector<f64> {
        let mut sum = DVector::zeros(self.dimension);
        for group in members {
            let back = group.inverse * group.gradient;
            for it in &group.seen {
                let pull = (it.error - it.by_unknown * back) * it.weight;
                self.add(it.camera, &it.by_camera.tr_mul(&pull), &mut sum);
            }
        }
        sum
    }

    /// The information of some groups, times `of`.
    fn information(&self, members: &[&Group<C>], of: &DVector<f64>) -> DVector<f64> {
        let mut sum = DVector::zeros(self.dimension);
        for group in members {
            let shifts: Vec<Vector2<f64>> =
                group.seen.iter().map(|it| it.by_camera * self.block(it.camera, of)).collect();
            let mut at_unknowns = Vector6::zeros();
            for (it, shift) in group.seen.iter().zip(&shifts) {
                at_unknowns += it.by_unknown.tr_mul(&(shift * it.weight));
            }
            let back = group.inverse * at_unknowns;
            for (it, shift) in group.seen.iter().zip(&shifts) {
                let pull = (shift - it.by_unknown * back) * it.weight;
                self.add(it.camera, &it.by_camera.tr_mul(&pull), &mut sum);
            }
        }
        sum
    }

    /// (1 − A C)^−½ `score`, A the information of `members`.
    fn without_leverage(&self, inverse: &DMatrix<f64>, members: &[&Group<C>], score: DVector<f64>) -> DVector<f64> {
        let length = |of: &DVector<f64>, by_inverse: &DVector<f64>| of.dot(by_inverse).max(0.0).sqrt();
        let first = length(&score, &(inverse * &score));
        if !(first > 0.0 && first.is_finite()) {
            return score;
        }
        let (mut basis, mut diagonal, mut beside) = (vec![&score / first], Vec::new(), Vec::new());
        while let Some(last) = basis.last() {
            let by_last = inverse * last;
            let mut next = self.information(members, &by_last);
            diagonal.push(next.dot(&by_last));
            // Against all that came before: few steps, and rounding takes the short recurrence apart.
            for _ in 0..2 {
                let by_next = inverse * &next;
                let parts: Vec<f64> = basis.iter().map(|it| it.dot(&by_next)).collect();
                basis.iter().zip(parts).for_each(|(it, part)| next.axpy(-part, it, 1.0));
            }
            let norm = length(&next, &(inverse * &next));
            if norm < 1e-9 || basis.len() == LANCZOS {
                break;
            }
            beside.push(norm);
            basis.push(next / norm);
        }
        let n = diagonal.len();
        let small = DMatrix::from_fn(n, n, |row, column| match row.abs_diff(column) {
            0 => diagonal[row],
            1 => beside[row.min(column)],
            _ => 0.0,
        });
        let eigen = small.symmetric_eigen();
        let mut result = DVector::zeros(score.len());
        for (index, direction) in basis.iter().enumerate() {
            let factor = (0..n).map(|it| {
                let leverage = eigen.eigenvalues[it].clamp(0.0, MOST_LEVERAGE);
                eigen.eigenvectors[(index, it)] * eigen.eigenvectors[(0, it)] / (1.0 - leverage).sqrt()
            });
            result.axpy(first * factor.sum::<f64>(), direction, 1.0);
        }
        result
    }

    /// Σ τ² C b bᵀ C over the coefficients of all cameras.
    fn of_fields(&self, inverse: &DMatrix<f64>) -> DMatrix<f64> {
        let (n_of, n_cameras) = (|degree: usize| (degree + 1) * (degree + 2) - 6, self.rows.len());
        let Some(degree) = (2..=DEGREE).rev().find(|it| n_of(*it) * n_cameras <= MOST_FIELDS) else {
            return DMatrix::zeros(self.dimension, self.dimension);
        };
        let per_camera = n_of(degree);
        let n = per_camera * n_cameras;
        let mut causes = DMatrix::<f64>::zeros(self.dimension, n);
        let mut information = DMatrix::<f64>::zeros(n, n);
        let mut seen = DVector::<f64>::zeros(n);
        for group in &self.groups {
            let fields: Vec<Vec<f64>> = group.seen.iter().map(|it| legendre(it.place, degree)).collect();
            let at_gradient = group.inverse * group.gradient;
            for (index, (it, own)) in group.seen.iter().zip(&fields).enumerate() {
                let start = it.camera * per_camera;
                let residual = (it.error - it.by_unknown * at_gradient) * it.weight;
                for axis in 0..2 {
                    let back = group.inverse * (it.by_unknown.row(axis).transpose() * it.weight);
                    // How all pixels of the group then miss, by their weights.
                    let mut cause = DVector::<f64>::zeros(self.dimension);
                    for (at, (other, others)) in group.seen.iter().zip(&fields).enumerate() {
                        let mut pull = -(other.by_unknown * back) * other.weight;
                        if at == index {
                            pull[axis] += it.weight;
                        }
                        self.add(other.camera, &other.by_camera.tr_mul(&pull), &mut cause);
                        let other_start = other.camera * per_camera;
                        for (mode, field) in own.iter().enumerate() {
                            let mut column = information.column_mut(start + 2 * mode + axis);
                            for (other_mode, other_field) in others.iter().enumerate() {
                                let product = field * other_field;
                                column[other_start + 2 * other_mode] += product * pull.x;
                                column[other_start + 2 * other_mode + 1] += product * pull.y;
                            }
                        }
                    }
                    for (mode, field) in own.iter().enumerate() {
                        let column = start + 2 * mode + axis;
                        seen[column] += field * residual[axis];
                        causes.column_mut(column).axpy(*field, &cause, 1.0);
                    }
                }
            }
        }
        let moved = inverse * &causes;
        information -= causes.tr_mul(&moved);
        let all: Vec<&Group<C>> = self.groups.iter().collect();
        seen -= moved.tr_mul(&self.gradient(&all));
        let variances = variances(&information, &seen, per_camera);
        let mut scaled = moved;
        for (camera, variance) in variances.into_iter().enumerate() {
            scaled.columns_mut(camera * per_camera, per_camera).scale_mut(variance.sqrt());
        }
        &scaled * scaled.transpose()
    }
}

/// Products of Legendre polynomials from degree 2 up to another, each of mean square 1 over the square. What is constant or linear in the picture is the
/// camera's own: turn, principal point, focal length and the shape of its pixels, free or known.
fn legendre([x, y]: [f64; 2], degree: usize) -> Vec<f64> {
    let along = |t: f64| {
        let mut values = vec![1.0, t];
        for n in 1..degree {
            let [before, last] = [values[n - 1], values[n]];
            let n = n as f64;
            values.push(((2.0 * n + 1.0) * t * last - n * before) / (n + 1.0));
        }
        for (n, value) in values.iter_mut().enumerate() {
            *value *= (2.0 * n as f64 + 1.0).sqrt();
        }
        values
    };
    let (of_x, of_y) = (along(x), along(y));
    (2..=degree).flat_map(|sum| (0..=sum).map(move |a| (a, sum - a))).map(|(a, b)| of_x[a] * of_y[b]).collect()
}

/// By camera: τ², such that Σ g² over its coefficients is what is to be expected, E gₘ² = Iₘₘ + Σₖ Iₘₖ² τₖ².
fn variances(information: &DMatrix<f64>, seen: &DVector<f64>, per_camera: usize) -> Vec<f64> {
    let n = information.ncols() / per_camera;
    let range = |camera: usize| camera * per_camera..(camera + 1) * per_camera;
    let excess: Vec<f64> =
        (0..n).map(|camera| range(camera).map(|it| seen[it].powi(2) - information[(it, it)]).sum()).collect();
    let shares = DMatrix::<f64>::from_fn(n, n, |a, b| {
        information.view((a * per_camera, b * per_camera), (per_camera, per_camera)).norm_squared()
    });
    // A camera's own share is by far the largest: Gauss and Seidel, with none below 0.
    let mut variances = vec![0.0; n];
    for _ in 0..100 {
        for camera in 0..n {
            let others: f64 = (0..n).filter(|it| *it != camera).map(|it| shares[(camera, it)] * variances[it]).sum();
            let own: f64 = shares[(camera, camera)];
            let rest: f64 = excess[camera] - others;
            variances[camera] = if own > 0.0 { (rest / own).max(0.0) } else { 0.0 };
        }
    }
    variances
}

#[cfg(test)]
mod tests;
