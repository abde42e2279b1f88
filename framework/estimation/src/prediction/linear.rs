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
//! w is the mean of a Bayesian linear regression: before anything is known, w = (τ (1 − exp(−L/τ))/Δ, 0, …, 0), a velocity that fades; rows of the last seconds
//! count less the older they are. A point that has hardly moved teaches nothing, and its prediction stays that.
//!
//! Rows of a few seconds can be met by chance by weights that foretell nothing: people who turn abruptly are overshot by a third more than at a velocity that fades. So
//! there are two answers, of weights that are free and of weights that hardly leave what they are beforehand; which of the two holds, their misses say.

use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};

use super::history::History;
use super::{FADES_S, across, faded_s};

type Weights = SVector<f64, TAPS>;

/// How many displacements.
const TAPS: usize = 5;
/// Time of each, Δ [s].
const TAP_S: f64 = 0.2;
/// Between two rows of the regression [s].
const ROW_S: f64 = 1.0 / 30.0;
/// Rows so close share their errors: as many count as one.
const ROWS_ALIKE: f64 = 6.0;
/// How much the weights may differ from what they are beforehand, relative to L/Δ, standard deviation: of either answer [–].
const FREEDOMS: [f64; 2] = [1.0, 0.15];
/// For how long rows count, as a time constant: two turns of what people swing to and fro [s].
const MEMORY_S: f64 = 5.0;
/// What a row misses at the least, standard deviation of each axis [m].
const LEAST_MISS_M: f64 = 0.004;

/// Where the point will be, by weights that are free and by weights that hardly are; there is a newest sample.
pub(super) fn predict(history: &History, horizon_s: f64, eye: Option<&Point3<f64>>) -> [Point3<f64>; 2] {
    let Some(last) = history.last() else { return [Point3::origin(); 2] };
    let Some(now) = displacements(history, last.time_s) else {
        return [last.position + last.velocity * faded_s(FADES_S, horizon_s); 2];
    };
    let across = across(eye, &last.position);
    fit(history, last.time_s, horizon_s, &across).map(|weights| last.position + now * weights)
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

fn fit(history: &History, now_s: f64, horizon_s: f64, across: &Matrix3<f64>) -> [Weights; 2] {
    let prior = Weights::from_fn(|row, _| if row == 0 { faded_s(FADES_S, horizon_s) / TAP_S } else { 0.0 });
    let (mut gram, mut moment, mut square) = (SMatrix::<f64, TAPS, TAPS>::zeros(), Weights::zeros(), 0.0);
    let mut rows = 0.0;
    let oldest = history.first_s().unwrap_or(now_s).max(now_s - horizon_s - 3.0 * MEMORY_S);
    let mut time_s = now_s - horizon_s;
    while time_s > oldest {
        let (Some(x), Some(y), Some(d)) =
            (history.at(time_s), history.at(time_s + horizon_s), displacements(history, time_s))
        else {
            break;
        };
        let weight = ((time_s - now_s + horizon_s) / MEMORY_S).exp();
        // What is known beforehand is taken off: what is fitted is by how much the weights differ from it.
        let missed = across * ((y - x) - d * prior);
        let d = across * d;
        gram += d.transpose() * d * weight;
        moment += d.transpose() * missed * weight;
        square += missed.norm_squared() * weight;
        rows += across.trace() * weight;
        time_s -= ROW_S;
    }
    if rows < 3.0 {
        return [prior; 2];
    }
    FREEDOMS.map(|freedom| {
        let freedom = (freedom * horizon_s / TAP_S).powi(2);
        let mut variance = LEAST_MISS_M.powi(2);
        let mut change = Weights::zeros();
        // The noise of a row depends on the weights, which depend on it: two rounds are enough.
        for _ in 0..2 {
            let ridge = SMatrix::<f64, TAPS, TAPS>::identity() * (variance * ROWS_ALIKE / freedom);
            let Some(factor) = (gram + ridge).cholesky() else { return prior };
            change = factor.solve(&moment);
            let missed = square - 2.0 * moment.dot(&change) + change.dot(&(gram * change));
            variance = (missed / rows).max(LEAST_MISS_M.powi(2));
        }
        prior + change
    })
}
