//! Linear prediction (Prony): a combination of recent displacements, fitted to what followed them, which continues swings, bobs and circles.
//!
//! Any sum of oscillations about a middle obeys a linear recurrence (R. de Prony, 1795), and so does uniform motion:
//!
//! x(t + L) − x(t) = Σₖ wₖ dₖ(t)
//!
//! | here | meaning |
//! |---|---|
//! | `horizon`, L | how far ahead |
//! | `displacements`, d | v(t) Δ, then x(t − (k−1)Δ) − x(t − kΔ): a shift of the origin changes nothing |
//! | `weights`, w | the same for all axes of a part, so that a turn of the axes changes nothing either |
//!
//! w is the mean of a Bayesian linear regression: before anything is known, w = (τ (1 − exp(−L/τ))/Δ, 0, …, 0), a velocity that fades; rows of the last seconds
//! count less the older they are. A point that has hardly moved adds no information, and its prediction stays that.
//!
//! Rows of a few seconds can be fitted by chance with weights that predict nothing: people who turn abruptly are
//! overshot by a third more than with a fading velocity. So there are two predictions, one with free weights and one
//! with weights held near their prior; their errors decide between them. The free weights are the same for all parts
//! of a motion, since they need many rows; the cautious ones are fitted to level and upright motion separately
//! ([`Parts`]).
//!
//! Neither predicts farther than the point ever moved over the horizon, or than its velocity takes it; otherwise a
//! single jump leads to predictions metres away.

use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};

use super::history::History;
use super::parts::{PARTS, Parts};
use super::{SLOWS_S, faded_s};

type Weights = SVector<f64, TAPS>;

/// How many displacements.
const TAPS: usize = 5;
/// Time of each, Δ [s].
const TAP_S: f64 = 0.2;
/// Between two rows of the regression [s].
const ROW_S: f64 = 1.0 / 30.0;
/// Rows so close share their errors: as many count as one.
const ROWS_ALIKE: f64 = 6.0;
/// How much the weights of the free answer may differ from what they are beforehand, relative to L/Δ, standard deviation [–].
const FREE: f64 = 1.0;
/// The same of the cautious one [–].
const CAUTIOUS: f64 = 0.15;
/// With fewer rows nothing is fitted [–].
const LEAST_ROWS: f64 = 1.5;
/// For how long rows count, as a time constant: two turns of what people swing to and fro [s].
const MEMORY_S: f64 = 5.0;
/// What a row misses at the least, standard deviation of each axis [m].
const LEAST_MISS_M: f64 = 0.004;

/// Where the point will be, by weights that are free and by weights that hardly are; there is a newest sample.
pub(super) fn predict(history: &History, horizon_s: f64, eye: Option<&Point3<f64>>) -> [Point3<f64>; 2] {
    let Some(last) = history.last() else { return [Point3::origin(); 2] };
    let Some(now) = displacements(history, last.time_s) else {
        return [last.position + last.velocity * faded_s(SLOWS_S, horizon_s); 2];
    };
    let parts = Parts::new(eye, &last.position);
    let prior = Weights::from_fn(|row, _| if row == 0 { faded_s(SLOWS_S, horizon_s) / TAP_S } else { 0.0 });
    let seen = Seen::gather(history, last.time_s, horizon_s, &parts, &prior);
    let free = seen.all().fit(FREE, horizon_s);
    let cautious = seen.parts.each_ref().map(|it| it.fit(CAUTIOUS, horizon_s));
    let farthest = seen.farthest.max(last.velocity.norm() * horizon_s);
    let ways = [now * (prior + free), parts.join(cautious.map(|change| now * (prior + change)))];
    ways.map(|way| last.position + way * (farthest / way.norm().max(1e-12)).min(1.0))
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

/// The rows of the regression.
struct Seen {
    parts: [Rows; PARTS],
    /// The farthest that the point went over the horizon [m].
    farthest: f64,
}

/// Normal equations, of what the weights differ by from what they are beforehand.
#[derive(Clone, Copy)]
struct Rows {
    gram: SMatrix<f64, TAPS, TAPS>,
    moment: Weights,
    square: f64,
    /// How many rows they are, of how many axes each [–].
    count: f64,
    axes: f64,
}

impl Seen {
    fn gather(history: &History, now_s: f64, horizon_s: f64, parts: &Parts, prior: &Weights) -> Seen {
        let views = parts.seen();
        let mut seen = Seen { parts: views.map(|view| Rows::none(view.trace())), farthest: 0.0 };
        let oldest = history.first_s().unwrap_or(now_s).max(now_s - horizon_s - 3.0 * MEMORY_S);
        let mut time_s = now_s - horizon_s;
        while time_s > oldest {
            let (Some(x), Some(y), Some(d)) =
                (history.at(time_s), history.at(time_s + horizon_s), displacements(history, time_s))
            else {
                break;
            };
            let weight = ((time_s - now_s + horizon_s) / MEMORY_S).exp();
            let missed = (y - x) - d * prior;
            seen.farthest = seen.farthest.max((y - x).norm());
            for (rows, view) in seen.parts.iter_mut().zip(&views) {
                rows.add(view, &d, &missed, weight);
            }
            time_s -= ROW_S;
        }
        seen
    }

    /// Of all that is seen.
    fn all(&self) -> Rows {
        let [level, upright] = &self.parts;
        Rows {
            gram: level.gram + upright.gram,
            moment: level.moment + upright.moment,
            square: level.square + upright.square,
            count: level.count,
            axes: level.axes + upright.axes,
        }
    }
}

impl Rows {
    fn none(axes: f64) -> Rows {
        Rows { gram: SMatrix::zeros(), moment: Weights::zeros(), square: 0.0, count: 0.0, axes }
    }

    fn add(&mut self, view: &Matrix3<f64>, d: &SMatrix<f64, 3, TAPS>, missed: &Vector3<f64>, weight: f64) {
        let (d, missed) = (view * d, view * missed);
        self.gram += d.transpose() * d * weight;
        self.moment += d.transpose() * missed * weight;
        self.square += missed.norm_squared() * weight;
        self.count += weight;
    }

    /// By how much the weights differ from what they are beforehand.
    fn fit(&self, freedom: f64, horizon_s: f64) -> Weights {
        let mut change = Weights::zeros();
        if self.count < LEAST_ROWS {
            return change;
        }
        let freedom = (freedom * horizon_s / TAP_S).powi(2);
        let mut variance = LEAST_MISS_M.powi(2);
        // The noise of a row depends on the weights, which depend on it: two rounds are enough.
        for _ in 0..2 {
            let ridge = SMatrix::<f64, TAPS, TAPS>::identity() * (variance * ROWS_ALIKE / freedom);
            let Some(factor) = (self.gram + ridge).cholesky() else { return Weights::zeros() };
            change = factor.solve(&self.moment);
            let missed = self.square - 2.0 * self.moment.dot(&change) + change.dot(&(self.gram * change));
            variance = (missed / (self.count * self.axes)).max(LEAST_MISS_M.powi(2));
        }
        change
    }
}
