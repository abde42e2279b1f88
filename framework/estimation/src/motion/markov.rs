//! The modes of an interacting model, and how a point changes between them: a Markov chain in continuous time.
//!
//! Observations come at any interval, so the chain is given by rates Q, qᵢⱼ [1/s] from mode i to mode j, and the
//! probabilities of a change within t are exp(Q t).

use nalgebra::Matrix3;

use super::Mode;
use super::interacting::MODES_MAX;

/// A motion model that switches between two or three modes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interacting {
    modes: [Mode; MODES_MAX],
    n_modes: usize,
    rates_per_s: Matrix3<f64>,
    start: [f64; MODES_MAX],
}

/// Why the parameters make no [`Interacting`] model.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum BadModel {
    /// The number of modes is not two or three.
    #[error("found {0} modes, expected 2 or {MODES_MAX}")]
    Count(usize),
    /// A density or standard deviation is negative or not finite.
    #[error("mode {mode} has {value} as a density or standard deviation; expected a finite number, 0 or more")]
    Noise {
        /// Index of the mode.
        mode: usize,
        /// Value that was found.
        value: f64,
    },
    /// A mean stay is not above 0, or a rate is negative or not finite.
    #[error("the change from mode {mode} has the rate {rate_per_s} per second; expected a finite number, 0 or more")]
    Rate {
        /// Index of the mode.
        mode: usize,
        /// Rate that was found [1/s].
        rate_per_s: f64,
    },
}

impl Interacting {
    /// A model from modes and the mean time that a point stays in each [s], above 0 (infinite: for ever). All other modes are equally likely next.
    ///
    /// # Errors
    /// Not two or three modes, or a number out of range.
    pub fn new(modes_and_stays_s: &[(Mode, f64)]) -> Result<Interacting, BadModel> {
        let n_modes = modes_and_stays_s.len();
        let mut modes = Vec::with_capacity(n_modes);
        let mut rates_per_s = Matrix3::zeros();
        for (from, &(mode, stay_s)) in modes_and_stays_s.iter().enumerate().take(MODES_MAX) {
            modes.push(mode);
            for to in (0..n_modes.min(MODES_MAX)).filter(|to| *to != from) {
                rates_per_s[(from, to)] = 1.0 / stay_s / (n_modes - 1) as f64;
            }
        }
        if n_modes > MODES_MAX {
            return Err(BadModel::Count(n_modes));
        }
        Interacting::with_rates(&modes, &rates_per_s)
    }

    /// A model from modes and the rate [1/s] at which a point in mode i changes to mode j ≠ i, at (i, j). The
    /// diagonal, and entries beyond the modes, are not read.
    ///
    /// # Errors
    /// Not two or three modes, or a number out of range.
    pub fn with_rates(modes: &[Mode], rates_per_s: &Matrix3<f64>) -> Result<Interacting, BadModel> {
        let n_modes = modes.len();
        if !(2..=MODES_MAX).contains(&n_modes) {
            return Err(BadModel::Count(n_modes));
        }
        let usable = |value: f64| value >= 0.0 && value.is_finite();
        let mut chain = Matrix3::zeros();
        for (i, mode) in modes.iter().enumerate() {
            let noises = match *mode {
                Mode::ConstantVelocity { acceleration_density } => [acceleration_density; 2],
                Mode::ConstantAcceleration { jerk_density, acceleration_sigma } => [jerk_density, acceleration_sigma],
            };
            if let Some(&value) = noises.iter().find(|it| !usable(**it)) {
                return Err(BadModel::Noise { mode: i, value });
            }
            for j in (0..n_modes).filter(|j| *j != i) {
                let rate_per_s = rates_per_s[(i, j)];
                if !usable(rate_per_s) {
                    return Err(BadModel::Rate { mode: i, rate_per_s });
                }
                chain[(i, j)] = rate_per_s;
                chain[(i, i)] -= rate_per_s;
            }
        }
        let all = [modes[0], modes[1], *modes.last().unwrap_or(&modes[0])];
        let mut model = Interacting { modes: all, n_modes, rates_per_s: chain, start: [0.0; MODES_MAX] };
        // Where nothing is known, a point is in each mode as often as it is in the long run, from whichever mode it came.
        let slowest = chain.iter().filter(|it| **it > 0.0).fold(f64::INFINITY, |least, it| least.min(*it));
        let settled = model.transition(if slowest.is_finite() { 100.0 / slowest } else { 0.0 });
        for j in 0..n_modes {
            model.start[j] = (0..n_modes).map(|i| settled[(i, j)]).sum::<f64>() / n_modes as f64;
        }
        Ok(model)
    }

    /// The modes, two or three.
    pub fn modes(&self) -> &[Mode] {
        &self.modes[..self.n_modes]
    }

    /// Prior probabilities of the modes: those of the long run.
    pub fn start(&self) -> &[f64] {
        &self.start[..self.n_modes]
    }

    /// Probability, at (i, j), that a point in mode i is in mode j after `dt_s`: exp(Q t). Zero where there is no such mode.
    ///
    /// `dt_s` is finite and 0 or more; anything else counts as 0.
    pub fn transition(&self, dt_s: f64) -> Matrix3<f64> {
        let t = if dt_s > 0.0 && dt_s.is_finite() { dt_s } else { 0.0 };
        if self.n_modes == 2 {
            let (out, back) = (self.rates_per_s[(0, 1)], self.rates_per_s[(1, 0)]);
            let total = out + back;
            let changed = if total > 0.0 { -(-total * t).exp_m1() / total } else { 0.0 };
            let (out, back) = (out * changed, back * changed);
            return Matrix3::new(1.0 - out, out, 0.0, back, 1.0 - back, 0.0, 0.0, 0.0, 0.0);
        }
        // Uniformisation: with λ ≥ |qᵢᵢ|, exp(Q t) = Σ Pois(k; λt) (I + Q/λ)ᵏ has no negative term, so nothing cancels.
        // Halved until λt < 1/2, then squared as often.
        let fastest = self.rates_per_s.diagonal().amax();
        if fastest * t <= 0.0 {
            return Matrix3::identity();
        }
        let jumps = (fastest * t).min(1e300);
        let halvings = (2.0 * jumps).log2().ceil().max(0.0) as i32;
        let steps = jumps * 0.5f64.powi(halvings);
        let jump = Matrix3::identity() + self.rates_per_s / fastest;
        let mut term = Matrix3::identity() * (-steps).exp();
        let mut sum = term;
        for k in 1..=14 {
            term = term * jump * (steps / f64::from(k));
            sum += term;
        }
        for _ in 0..halvings {
            sum *= sum;
            for mut row in sum.row_iter_mut() {
                let total = row.sum();
                row /= total;
            }
        }
        sum
    }
}
