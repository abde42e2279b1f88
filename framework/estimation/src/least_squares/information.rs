//! Information matrices with parameters of any units: solving, inverting, and finding unobservable parameters.

use nalgebra::{DMatrix, DVector};

/// Parameters that the data do not determine.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{} of {of} parameters are unobservable, given the parameters before them: {parameters:?}", parameters.len())]
pub struct Unobservable {
    /// The unobservable parameters, by their index in the step: each is undetermined given the parameters before it.
    pub parameters: Vec<usize>,
    /// Number of free parameters.
    pub of: usize,
}

/// A parameter of which those before it leave less than this part of its information is open.
const OPEN: f64 = 1e-12;

/// Solves positive definite equations (the lower triangle is read); `None` where they are singular or the solution is not finite.
pub fn solve_positive(matrix: DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    if matrix.is_empty() {
        return Some(DVector::zeros(0));
    }
    let solved = matrix.cholesky()?.solve(right);
    solved.iter().all(|it| it.is_finite()).then_some(solved)
}

/// Inverse of the information of the `free` parameters, spread into rows and columns of all.
pub(super) fn covariance(information: &DMatrix<f64>, free: &[usize]) -> Result<DMatrix<f64>, Unobservable> {
    let inverse = invert_information(&information.select_rows(free).select_columns(free));
    let inverse = inverse
        .map_err(|open| Unobservable { parameters: open.iter().map(|it| free[*it]).collect(), of: free.len() })?;
    let mut whole = DMatrix::zeros(information.nrows(), information.nrows());
    for (row, &to_row) in free.iter().enumerate() {
        for (column, &to_column) in free.iter().enumerate() {
            whole[(to_row, to_column)] = inverse[(row, column)];
        }
    }
    Ok(whole)
}

/// The inverse of a symmetric information matrix, whatever the units of its parameters.
///
/// # Errors
/// The unobservable parameters, each given those before it.
pub fn invert_information(information: &DMatrix<f64>) -> Result<DMatrix<f64>, Vec<usize>> {
    let n = information.nrows();
    let scale = DVector::from_fn(n, |row, _| 1.0 / information[(row, row)].sqrt());
    let mut factor = DMatrix::from_fn(n, n, |row, column| information[(row, column)] * scale[row] * scale[column]);
    // Cholesky on the unit diagonal: a pivot is the part of its parameter that those before it do not explain.
    let mut open = Vec::new();
    for column in 0..n {
        let pivot = factor[(column, column)];
        if !scale[column].is_finite() || pivot.is_nan() || pivot <= OPEN {
            open.push(column);
            factor.column_mut(column).fill(0.0);
            continue;
        }
        let root = pivot.sqrt();
        factor.column_mut(column).rows_mut(column, n - column).unscale_mut(root);
        let (done, mut rest) = factor.columns_range_pair_mut(column, column + 1..);
        for later in column + 1..n {
            let share = -done[later];
            rest.column_mut(later - column - 1).rows_mut(later, n - later).axpy(
                share,
                &done.rows(later, n - later),
                1.0,
            );
        }
    }
    if !open.is_empty() {
        return Err(open);
    }
    factor.fill_upper_triangle(0.0, 1);
    let mut inverse = DMatrix::identity(n, n);
    if !factor.solve_lower_triangular_mut(&mut inverse) {
        return Err((0..n).collect());
    }
    let mut inverse = inverse.tr_mul(&inverse);
    for column in 0..n {
        for row in 0..n {
            inverse[(row, column)] *= scale[row] * scale[column];
        }
    }
    Ok(inverse)
}
