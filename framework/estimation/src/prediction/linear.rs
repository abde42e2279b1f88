//! A combination of recent displacements, fitted to what followed them: a point that swings, bobs or runs in circles goes on as it did.
//!
//! Any sum of oscillations about a middle obeys a linear recurrence (R. de Prony, 1795), and so does uniform motion:
//!
//! x(t + L) − x(t) = Σₖ wₖ dₖ(t)
//!
//! | here | meaning |
//! |---|---|
//! | `horizon`, L | how far ahead |
//! | `displacements`, d | v(t) Δ, then x(t − (k−1)Δ) − x(t − kΔ): a shift of the origin changes nothing |
//! | `weights`, w | the same for all axes, so that a turn of the axes changes nothing either |
//!
//! w is the mean of a Bayesian linear regression: before anything is known, the paper's w = (L/Δ, 0, …, 0); rows of the last seconds count less
//! the older they are. A point that has hardly moved teaches nothing, and its prediction stays the paper's.

use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};

use super::across;
use super::history::History;

type Weights = SVector<f64, TAPS>;

/// How many displacements.
const TAPS: usize = 5;
/// Time of each, Δ [s].
const TAP_S: f64 = 0.2;
/// Between two rows of the regression [s].
const ROW_S: f64 = 1.0 / 30.0;
/// Rows so close share their errors: as many count as one.
const ROWS_ALIKE: f64 = 6.0;
/// How much the weights may differ from the paper's, relative to L/Δ, standard deviation [–].
const FREEDOM: f64 = 1.0;
/// What a row misses at the least, standard deviation of each axis [m].
const LEAST_MISS_M: f64 = 0.004;

/// Where the point will be; there is a newest sample.
pub(super) fn predict(history: &History, horizon_s: f64, memory_s: f64, eye: Option<&Point3<f64>>) -> Point3<f64> {
    let Some(last) = history.last() else { return Point3::origin() };
    let Some(now) = displacements(history, last.time_s) else { return last.position + last.velocity * horizon_s };
    let prior = Weights::from_fn(|row, _| if row == 0 { horizon_s / TAP_S } else { 0.0 });
    let across = across(eye, &last.position);
    let weights = fit(history, last.time_s, [horizon_s, memory_s], &prior, &across);
    last.position + now * weights
}

/// d(t), an axis a row; `None` where the history does not reach back far enough.
fn displacements(history: &History, time_s: f64) -> Option<SMatrix<f64, 3, TAPS>> {
    let mut columns = [Vector3::zeros(); TAPS];
    columns[0] = history.velocity_at(time_s)? * TAP_S;
    let mut here = history.at(time_s)?;
    for (index, column) in columns.iter_mut().enumerate().skip(1) {
        let before = history.at(time_s - index as f64 * TAP_S)?;
        *column = here - before;
        here = before;
    }
    Some(SMatrix::from_columns(&columns))
}

fn fit(
    history: &History,
    now_s: f64,
    [horizon_s, memory_s]: [f64; 2],
    prior: &Weights,
    across: &Matrix3<f64>,
) -> Weights {
    let (mut gram, mut moment, mut square) = (SMatrix::<f64, TAPS, TAPS>::zeros(), Weights::zeros(), 0.0);
    let mut rows = 0.0;
    let oldest = history.first_s().unwrap_or(now_s).max(now_s - horizon_s - 3.0 * memory_s);
    let mut time_s = now_s - horizon_s;
    while time_s > oldest {
        let (Some(x), Some(y), Some(d)) =
            (history.at(time_s), history.at(time_s + horizon_s), displacements(history, time_s))
        else {
            break;
        };
        let weight = ((time_s - now_s + horizon_s) / memory_s).exp();
        // The paper's prediction is taken off: what is fitted is by how much the weights differ from it.
        let missed = across * ((y - x) - d * prior);
        let d = across * d;
        gram += d.transpose() * d * weight;
        moment += d.transpose() * missed * weight;
        square += missed.norm_squared() * weight;
        rows += across.trace() * weight;
        time_s -= ROW_S;
    }
    if rows < 3.0 {
        return *prior;
    }
    let freedom = (FREEDOM * horizon_s / TAP_S).powi(2);
    let mut variance = LEAST_MISS_M.powi(2);
    let mut change = Weights::zeros();
    // The noise of a row depends on the weights, which depend on it: two rounds are enough.
    for _ in 0..2 {
        let ridge = SMatrix::<f64, TAPS, TAPS>::identity() * (variance * ROWS_ALIKE / freedom);
        let Some(factor) = (gram + ridge).cholesky() else { return *prior };
        change = factor.solve(&moment);
        let missed = square - 2.0 * moment.dot(&change) + change.dot(&(gram * change));
        variance = (missed / rows).max(LEAST_MISS_M.powi(2));
    }
    prior + change
}
