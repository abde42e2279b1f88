//! Principal components: the directions in which samples vary most, with their variances.
//!
//! Computed from whichever is smaller for n samples of d numbers each: the d × d covariance, or the n × n inner
//! products of samples, which have the same eigenvalues. Variances are sums of squares divided by n − 1. The sign of a
//! direction is arbitrary; here its largest number is positive.

use nalgebra::{DMatrix, DVector};

/// A direction is kept down to this part of the largest variance; below it is rounding.
const ROUNDING: f64 = 1e-13;
/// A variance is rounding, too, below the square of this part of the largest number.
const ROUNDING_OF_NUMBERS: f64 = 1e-14;

/// Mean, principal directions and variances of samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Principal {
    /// Mean of the samples.
    pub mean: DVector<f64>,
    /// Principal directions: orthonormal columns (d × k), by falling variance; as many as the samples span.
    pub directions: DMatrix<f64>,
    /// Variance along each direction, above zero.
    pub variances: Vec<f64>,
}

/// Why there are no principal components.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PrincipalError {
    /// No sample, or samples without numbers.
    #[error("{samples} samples of {numbers} numbers have no mean")]
    Empty {
        /// Number of samples.
        samples: usize,
        /// Numbers in each sample.
        numbers: usize,
    },
    /// A number that is NaN or infinite.
    #[error("sample {sample}, number {number} is not finite")]
    NotFinite {
        /// Index of the sample.
        sample: usize,
        /// Index of the number in it.
        number: usize,
    },
    /// A covariance that is not square, or does not match the mean.
    #[error("the covariance is {rows} × {columns}, expected {numbers} × {numbers} as the mean has {numbers} numbers")]
    Shape {
        /// Rows of the covariance.
        rows: usize,
        /// Columns of it.
        columns: usize,
        /// Numbers of the mean.
        numbers: usize,
    },
}

/// Principal components of `samples`, one a column (d × n). A single sample, or equal ones, have a mean and no direction.
///
/// # Errors
/// [`PrincipalError::Empty`], [`PrincipalError::NotFinite`].
pub fn principal(samples: &DMatrix<f64>) -> Result<Principal, PrincipalError> {
    let (d, n) = samples.shape();
    if d == 0 || n == 0 {
        return Err(PrincipalError::Empty { samples: n, numbers: d });
    }
    if let Some(place) = samples.iter().position(|it| !it.is_finite()) {
        return Err(PrincipalError::NotFinite { sample: place / d, number: place % d });
    }
    let mean = samples.column_mean();
    let least = (ROUNDING_OF_NUMBERS * samples.amax()).powi(2);
    let mut centred = samples.clone();
    centred.column_iter_mut().for_each(|mut it| it -= &mean);
    let transposed = centred.transpose();
    let degrees = (n.max(2) - 1) as f64;
    if d <= n {
        return Ok(of_covariance(mean, &centred * &transposed / degrees, least));
    }
    let among_samples = of_covariance(DVector::zeros(n), &transposed * &centred / degrees, least);
    let mut directions = centred * among_samples.directions;
    directions.column_iter_mut().for_each(|mut it| {
        it.normalize_mut();
        sign(it.as_mut_slice());
    });
    // The smallest ones have lost their right angles to rounding: they are put right against those before them.
    for column in 1..directions.ncols() {
        let mut line = directions.column(column).into_owned();
        let before = directions.columns(0, column);
        line -= before * (before.transpose() * &line);
        line.normalize_mut();
        directions.set_column(column, &line);
    }
    Ok(Principal { mean, directions, variances: among_samples.variances })
}

/// Principal components of a distribution with this mean and (symmetric) covariance.
///
/// # Errors
/// [`PrincipalError::Shape`], [`PrincipalError::Empty`], [`PrincipalError::NotFinite`].
pub fn principal_of(mean: DVector<f64>, covariance: DMatrix<f64>) -> Result<Principal, PrincipalError> {
    let ((rows, columns), numbers) = (covariance.shape(), mean.len());
    if rows != numbers || columns != numbers {
        return Err(PrincipalError::Shape { rows, columns, numbers });
    }
    if numbers == 0 {
        return Err(PrincipalError::Empty { samples: 0, numbers });
    }
    if let Some(place) = covariance.iter().position(|it| !it.is_finite()) {
        return Err(PrincipalError::NotFinite { sample: place / numbers, number: place % numbers });
    }
    if let Some(number) = mean.iter().position(|it| !it.is_finite()) {
        return Err(PrincipalError::NotFinite { sample: 0, number });
    }
    Ok(of_covariance(mean, covariance, 0.0))
}

fn of_covariance(mean: DVector<f64>, covariance: DMatrix<f64>, least: f64) -> Principal {
    let eigen = covariance.symmetric_eigen();
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let least = least.max(ROUNDING * order.first().map_or(0.0, |it| eigen.eigenvalues[*it]));
    order.retain(|it| eigen.eigenvalues[*it] > least);
    let mut directions = eigen.eigenvectors.select_columns(&order);
    directions.column_iter_mut().for_each(|mut it| sign(it.as_mut_slice()));
    Principal { mean, directions, variances: order.iter().map(|it| eigen.eigenvalues[*it]).collect() }
}

/// Turns a direction so that the largest of its numbers is positive.
fn sign(direction: &mut [f64]) {
    let largest = direction.iter().copied().fold(0.0, |most: f64, it| if it.abs() > most.abs() { it } else { most });
    if largest < 0.0 {
        direction.iter_mut().for_each(|it| *it = -*it);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// `n` samples of `d` numbers around 5 that vary in three directions by 3, 2 and 1.
    fn samples(d: usize, n: usize) -> (DMatrix<f64>, DMatrix<f64>) {
        let mut random = Random::new(3);
        let axes = DMatrix::from_fn(d, 3, |_, _| random.normal()).qr().q();
        let ways = DMatrix::from_fn(3, n, |row, _| random.normal() * (3.0 - row as f64));
        ((&axes * ways).add_scalar(5.0), axes)
    }

    #[test]
    fn directions_and_variances_are_found_whichever_is_more() {
        for (d, n) in [(20, 4000), (4000, 200)] {
            let (samples, axes) = samples(d, n);
            let found = principal(&samples).unwrap();
            assert_eq!(found.directions.shape(), (d, 3), "{:?}", found.variances);
            for axis in 0..3 {
                let (along, variance) = (found.directions.column(axis).dot(&axes.column(axis)), found.variances[axis]);
                assert!(along.abs() > 0.95, "{d} × {n}, {axis}: {along}");
                assert!((variance.sqrt() / (3.0 - axis as f64) - 1.0).abs() < 0.15, "{axis}: {variance}");
            }
            let product = found.directions.transpose() * &found.directions;
            assert!((product - DMatrix::identity(3, 3)).norm() < 1e-12);
            // Nothing is lost: every sample is its mean and what lies along the directions.
            let off = samples.column(7) - &found.mean;
            let left = &off - &found.directions * (found.directions.transpose() * &off);
            assert!(left.norm() < 1e-9 * off.norm(), "{}", left.norm());
        }
    }

    #[test]
    fn both_ways_agree_and_sum_to_the_whole_variance() {
        let mut random = Random::new(4);
        let square = DMatrix::from_fn(12, 12, |_, _| random.normal());
        let by_numbers = principal(&square).unwrap();
        let by_samples = principal(&square.clone().insert_rows(12, 1, 0.0)).unwrap();
        assert_eq!(by_numbers.variances.len(), 11);
        for (a, b) in by_numbers.variances.iter().zip(&by_samples.variances) {
            assert!((a - b).abs() < 1e-10 * a, "{a} {b}");
        }
        let whole: f64 = square.row_iter().map(|it| it.variance() * 12.0 / 11.0).sum();
        assert!((by_numbers.variances.iter().sum::<f64>() - whole).abs() < 1e-9 * whole);
    }

    #[test]
    fn samples_that_do_not_vary_have_no_direction() {
        for n in [1, 2, 9] {
            let found = principal(&DMatrix::from_element(4, n, 2.5)).unwrap();
            assert_eq!((found.directions.shape(), found.variances.len()), ((4, 0), 0));
            assert!((found.mean[2] - 2.5).abs() < 1e-12);
        }
    }

    #[test]
    fn what_has_no_mean_is_refused() {
        assert_eq!(principal(&DMatrix::zeros(3, 0)).unwrap_err(), PrincipalError::Empty { samples: 0, numbers: 3 });
        let mut broken = DMatrix::zeros(3, 4);
        broken[(1, 2)] = f64::NAN;
        assert_eq!(principal(&broken).unwrap_err(), PrincipalError::NotFinite { sample: 2, number: 1 });
        let of = |n: usize, rows: usize, columns: usize| principal_of(DVector::zeros(n), DMatrix::zeros(rows, columns));
        assert_eq!(of(2, 2, 3).unwrap_err(), PrincipalError::Shape { rows: 2, columns: 3, numbers: 2 });
        assert_eq!(of(2, 2, 2).unwrap().variances, Vec::<f64>::new());
        assert!(matches!(of(0, 0, 0), Err(PrincipalError::Empty { .. })));
    }
}
