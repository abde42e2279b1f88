//! Bounded least squares: the weights that minimise |A w − b|, each within bounds of its own.
//!
//! AᵀA is formed once and then updated where rows enter or leave: one row costs n² / 2 multiplications, a change of b
//! none. An active set ([`ActiveSet`]) that starts where the last solution ended finds the weights at bounds in one or
//! two rounds. What AᵀA has lost to rounding is recovered at the end: the gradient is taken from A itself, the free
//! weights are corrected by it until nothing changes, and the Karush–Kuhn–Tucker conditions are checked with it. Where
//! columns are nearly dependent, to a few millionths of their length, a slope remains; the result states it.
//!
//! Source: C. L. Lawson and R. J. Hanson, "Solving Least Squares Problems", 1974, and P. B. Stark and R. L. Parker,
//! "Bounded-variable least-squares: an algorithm and applications", Computational Statistics 10, 1995; here several
//! weights at a time change sides.
//!
//! ```
//! use foveate_estimation::BoundedLeastSquares;
//! use nalgebra::DMatrix;
//!
//! // A line w₀ + w₁ x through four values whose slope is 2, where only slopes up to 1 are allowed.
//! let matrix = DMatrix::from_row_slice(4, 2, &[1.0, 0.0, 1.0, 1.0, 1.0, 2.0, 1.0, 3.0]);
//! let mut fit = BoundedLeastSquares::new(matrix, &[f64::NEG_INFINITY, 0.0], &[f64::INFINITY, 1.0])?;
//! let found = fit.solve(&[0.0, 2.0, 4.0, 6.0], &[true; 4])?;
//! // The slope stops at its bound; the offset is then the mean of y − x.
//! assert!((found.weights[0] - 1.5).abs() < 1e-12);
//! assert_eq!(found.weights[1], 1.0);
//!
//! // Without the last two rows: the next solution starts at this one.
//! let found = fit.solve(&[0.0, 2.0, 4.0, 6.0], &[true, true, false, false])?;
//! assert!((found.weights[0] - 0.5).abs() < 1e-12);
//! # Ok::<(), foveate_estimation::BoundedError>(())
//! ```

mod active_set;
#[cfg(test)]
mod tests;

use nalgebra::DMatrix;

pub use active_set::{ActiveSet, Side};

/// How often the free weights are corrected by the exact gradient.
const CORRECTIONS: usize = 6;
/// Rows by which the normal matrix is updated before it is formed again, so that rounding cannot pile up.
const MENDED_AT_MOST: usize = 4096;
/// A gradient is zero below this part of |column| · (|A w − b| + [`ROUNDING`] |b|).
const FLAT: f64 = 1e-9;
const ROUNDING: f64 = 1e-6;

/// Why there is no solution.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BoundedError {
    /// Lists whose lengths do not match.
    #[error("{what}: found {found}, expected {expected}")]
    Lengths {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length that was expected.
        expected: usize,
    },
    /// A number that is NaN or infinite.
    #[error("{what} {index} is not a finite number")]
    NotFinite {
        /// Which list.
        what: &'static str,
        /// Index of the number in it.
        index: usize,
    },
    /// A lower bound above the upper one.
    #[error("weight {index} may be {lower} at least and {upper} at most: no weight is both")]
    Crossed {
        /// Index of the weight.
        index: usize,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
    },
    /// Every row is marked as not to count.
    #[error("none of {rows} rows is in use, expected at least one")]
    NoRows {
        /// Number of rows of the matrix.
        rows: usize,
    },
    /// The numbers span more orders of magnitude than double precision holds.
    #[error("no solution after {rounds} rounds: the numbers differ too much in size")]
    Lost {
        /// Rounds of the search.
        rounds: usize,
    },
}

/// The solution of [`BoundedLeastSquares::solve`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Bounded {
    /// The weights, each within its bounds.
    pub weights: Vec<f64>,
    /// |A w − b|², over the rows in use.
    pub cost: f64,
    /// How far the Karush–Kuhn–Tucker conditions are from being met: the largest slope by which |A w − b| could still
    /// be lowered, as the cosine between a column and A w − b.
    pub slope: f64,
    /// Number of weights between their bounds.
    pub n_free: usize,
    /// Number of weights that the rows do not determine, since their columns depend on others; they keep their value.
    pub n_undetermined: usize,
    /// Number of systems of equations solved.
    pub n_solved: usize,
}

/// A matrix and bounds, to be solved for many right sides, each near the one before.
#[derive(Debug, Clone)]
pub struct BoundedLeastSquares {
    matrix: DMatrix<f64>,
    /// Column by column: rows of the matrix.
    transposed: DMatrix<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    /// Of the rows that count.
    gram: DMatrix<f64>,
    counts: Vec<bool>,
    n_mended: usize,
    set: ActiveSet,
    right: Vec<f64>,
    residuals: Vec<f64>,
    gradient: Vec<f64>,
    norms: Vec<f64>,
}

impl BoundedLeastSquares {
    /// A solver for `matrix` (rows × weights) and the bounds of each weight; a bound may be infinite.
    ///
    /// # Errors
    /// [`BoundedError::Lengths`], [`BoundedError::NotFinite`] (also for a NaN bound), [`BoundedError::Crossed`].
    pub fn new(matrix: DMatrix<f64>, lower: &[f64], upper: &[f64]) -> Result<Self, BoundedError> {
        let n = matrix.ncols();
        check_bounds(n, lower, upper)?;
        let transposed = matrix.transpose();
        if let Some(index) = transposed.iter().position(|it| !it.is_finite()) {
            return Err(BoundedError::NotFinite { what: "matrix element (row by row)", index });
        }
        let rows = matrix.nrows();
        let norms = matrix.column_iter().map(|it| it.norm()).collect();
        let gram = &transposed * &matrix;
        Ok(Self {
            transposed,
            lower: lower.to_vec(),
            upper: upper.to_vec(),
            gram,
            counts: vec![true; rows],
            n_mended: 0,
            set: ActiveSet::new(lower, upper),
            right: vec![0.0; n],
            residuals: vec![0.0; rows],
            gradient: vec![0.0; n],
            norms,
            matrix,
        })
    }

    /// Discards the last solution: the next search starts at the weights nearest to zero.
    pub fn forget(&mut self) {
        self.set = ActiveSet::new(&self.lower, &self.upper);
    }

    /// The weights for the right side `values`, from the rows marked in `counts`. Values of other rows are not read.
    ///
    /// # Errors
    /// [`BoundedError::Lengths`], [`BoundedError::NotFinite`], [`BoundedError::NoRows`]. After an error the next call is as good as without it.
    pub fn solve(&mut self, values: &[f64], counts: &[bool]) -> Result<Bounded, BoundedError> {
        let rows = self.matrix.nrows();
        for (what, found) in [("values", values.len()), ("marks of rows in use", counts.len())] {
            if found != rows {
                return Err(BoundedError::Lengths { what, found, expected: rows });
            }
        }
        if let Some(index) = (0..rows).find(|&it| counts[it] && !values[it].is_finite()) {
            return Err(BoundedError::NotFinite { what: "value", index });
        }
        if !counts.contains(&true) {
            return Err(BoundedError::NoRows { rows });
        }
        self.count_rows(counts);
        self.right.fill(0.0);
        for row in (0..rows).filter(|&it| counts[it]) {
            add_scaled(&mut self.right, values[row], self.transposed.column(row).as_slice());
        }
        let mut n_solved = self.set.minimise(&self.gram, &self.right, &self.lower, &self.upper)?;
        let squares = values.iter().zip(counts).filter(|it| *it.1).map(|it| it.0 * it.0).sum::<f64>();
        let mut answer = Bounded::default();
        for round in 0..CORRECTIONS {
            let cost = self.look(values, counts);
            let slope = self.slope(cost, squares);
            if round > 0 && (slope >= answer.slope || cost > answer.cost * (1.0 + 1e-12)) {
                self.set.set_weights(&answer.weights);
                break;
            }
            answer = Bounded { weights: self.set.weights().to_vec(), cost, slope, ..answer };
            if slope <= FLAT {
                break;
            }
            // The right side for which the exact gradient is that of the normal equations here.
            for (right, (along, slope)) in
                self.right.iter_mut().zip(self.set.product(&self.gram).iter().zip(&self.gradient))
            {
                *right = along + slope;
            }
            n_solved += self.set.minimise(&self.gram, &self.right, &self.lower, &self.upper)?;
        }
        (answer.n_free, answer.n_undetermined) = (self.set.n_free(), self.set.n_undetermined());
        answer.n_solved = n_solved;
        Ok(answer)
    }

    /// Mends the normal matrix where rows have come or gone.
    fn count_rows(&mut self, counts: &[bool]) {
        let n_changed = self.counts.iter().zip(counts).filter(|(a, b)| a != b).count();
        if n_changed == 0 {
            return;
        }
        let n_counting = counts.iter().filter(|it| **it).count();
        self.n_mended += n_changed;
        if n_changed >= n_counting || self.n_mended > MENDED_AT_MOST {
            self.n_mended = 0;
            self.gram.fill(0.0);
            self.counts.fill(false);
        }
        let mut changed: Vec<(f64, usize)> = Vec::with_capacity(n_changed);
        for (row, &now) in counts.iter().enumerate().filter(|(row, now)| self.counts[*row] != **now) {
            changed.push((if now { 1.0 } else { -1.0 }, row));
        }
        self.mend(&changed);
        self.counts.copy_from_slice(counts);
    }

    /// Adds rows to the normal matrix, each with its sign. Four at a time, below the diagonal: most of the time goes into reading and writing the matrix.
    fn mend(&mut self, changed: &[(f64, usize)]) {
        let n = self.matrix.ncols();
        let Self { gram, transposed, .. } = self;
        let gram = gram.as_mut_slice();
        let line = |row: usize| &transposed.as_slice()[row * n..][..n];
        let mut fours = changed.chunks_exact(4);
        for four in &mut fours {
            let [a, b, c, d] = [0, 1, 2, 3].map(|it| line(four[it].1));
            for column in 0..n {
                let factors = [(a, 0), (b, 1), (c, 2), (d, 3)].map(|(line, it)| four[it].0 * line[column]);
                let sums = &mut gram[column * n + column..(column + 1) * n];
                let lines = a[column..].iter().zip(&b[column..]).zip(c[column..].iter().zip(&d[column..]));
                for (sum, ((a, b), (c, d))) in sums.iter_mut().zip(lines) {
                    *sum += (factors[0] * a + factors[1] * b) + (factors[2] * c + factors[3] * d);
                }
            }
        }
        for &(sign, row) in fours.remainder() {
            let line = line(row);
            for column in 0..n {
                add_scaled(&mut gram[column * n + column..(column + 1) * n], sign * line[column], &line[column..]);
            }
        }
        for column in 0..n {
            for row in 0..column {
                gram[column * n + row] = gram[row * n + column];
            }
        }
    }

    /// Residuals b − A w and their gradient Aᵀ (b − A w), from A itself; gives |A w − b|².
    fn look(&mut self, values: &[f64], counts: &[bool]) -> f64 {
        let weights = self.set.weights();
        self.gradient.fill(0.0);
        let mut cost = 0.0;
        for row in 0..values.len() {
            if !counts[row] {
                self.residuals[row] = 0.0;
                continue;
            }
            let line = self.transposed.column(row);
            let residual = values[row] - dot(line.as_slice(), weights);
            self.residuals[row] = residual;
            cost += residual * residual;
            add_scaled(&mut self.gradient, residual, line.as_slice());
        }
        cost
    }

    /// See [`Bounded::slope`].
    fn slope(&self, cost: f64, squares: f64) -> f64 {
        let size = cost.sqrt() + ROUNDING * squares.sqrt();
        let weights = self.set.weights();
        let at = |index: usize| {
            let gradient = self.gradient[index];
            let free = match gradient > 0.0 {
                true => weights[index] < self.upper[index],
                false => weights[index] > self.lower[index],
            };
            if free { gradient.abs() / (self.norms[index] * size).max(f64::MIN_POSITIVE) } else { 0.0 }
        };
        (0..weights.len()).map(at).fold(0.0, f64::max)
    }
}

/// Whether bounds are as many as weights, numbers, and not crossed.
pub(crate) fn check_bounds(n: usize, lower: &[f64], upper: &[f64]) -> Result<(), BoundedError> {
    for (what, bounds) in [("lower bounds", lower), ("upper bounds", upper)] {
        if bounds.len() != n {
            return Err(BoundedError::Lengths { what, found: bounds.len(), expected: n });
        }
        if let Some(index) = bounds.iter().position(|it| it.is_nan()) {
            return Err(BoundedError::NotFinite { what, index });
        }
    }
    let crossed =
        |it: &usize| lower[*it] > upper[*it] || lower[*it] == f64::INFINITY || upper[*it] == f64::NEG_INFINITY;
    match (0..n).find(crossed) {
        Some(index) => Err(BoundedError::Crossed { index, lower: lower[index], upper: upper[index] }),
        None => Ok(()),
    }
}

/// Σ aᵢ bᵢ in four sums at a time, which the compiler can do side by side.
#[inline]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().min(b.len());
    let (a, b) = (&a[..n], &b[..n]);
    let mut sums = [0.0; 8];
    let (a_eights, b_eights) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a_eights.remainder().iter().zip(b_eights.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_eights.zip(b_eights) {
        for lane in 0..8 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// `sum` += `factor` · `values`.
#[inline]
pub(crate) fn add_scaled(sum: &mut [f64], factor: f64, values: &[f64]) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum += factor * value;
    }
}
