//! Free fall in the path of a light: which way is down, and how long a metre is.
//!
//! Within the given span, the stretch is searched whose samples determine a constant acceleration best: quadratics are
//! fitted to all stretches (Cauchy's loss), those that miss the samples by more than these scatter are passed over, and the
//! one with the largest acceleration in its standard deviations is taken. It must make up most of the span, and its acceleration must
//! not change along it: a hand that waves the light changes it all the time.

use foveate_estimation::statistics::median;
use nalgebra::{DMatrix, Point3, Vector3};

/// Samples of a fall, at least.
pub(super) const LEAST_SAMPLES: usize = 8;
/// Of the span, a fall makes up at least this part.
const LEAST_SHARE: f64 = 0.5;
/// A fall of a larger relative standard deviation tells nothing.
const LARGEST_SIGMA: f64 = 0.05;
/// The acceleration may change by this part from the first to the last sample (drag), or by four standard deviations.
const LARGEST_CHANGE: f64 = 0.1;
/// A quadratic fits when its residuals are at most this many times the scatter.
const FITS: f64 = 1.3;
/// No path is known better than to this part of its length.
const LEAST_SCATTER: f64 = 1e-5;
/// Longer spans are thinned out to this many samples.
const MOST_SAMPLES: usize = 100;

/// A free fall found in the path of a light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fall {
    /// The stretch that was used [s].
    pub span_s: [f64; 2],
    /// How many samples it has.
    pub count: usize,
    /// Acceleration, in units of the solution [/s²].
    pub acceleration: Vector3<f64>,
    /// Standard deviation of each of its coordinates.
    pub sigma: f64,
    /// Root of the mean squared residual of a coordinate, in units of the solution.
    pub rms: f64,
}

/// Why no free fall was found.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FallError {
    /// All samples are of the same moment.
    #[error("all samples have the same time; a fall needs the times of the pictures")]
    NoTimes,
    /// The light rests, or the fall is too short.
    #[error(
        "its acceleration is known only to {:.0} %, expected {:.0} %: the light is at rest or falls too short a distance; let it fall a metre or more",
        100.0 * sigma, 100.0 * LARGEST_SIGMA
    )]
    TooShort {
        /// Relative standard deviation [–].
        sigma: f64,
    },
    /// Only a part of the span fits.
    #[error(
        "only {fitting_s:.2} s of the {asked_s:.2} s move with a constant acceleration, expected at least half; the light was held, \
         or touched something: give the span from letting go to landing"
    )]
    NotConstant {
        /// The best stretch [s].
        fitting_s: f64,
        /// The span [s].
        asked_s: f64,
    },
    /// The acceleration changes.
    #[error(
        "its acceleration changes by {:.0} % from the first to the last sample, expected at most {:.0} %: the light was held, or is \
         too light for the air; let something heavy fall",
        100.0 * change, 100.0 * LARGEST_CHANGE
    )]
    Changing {
        /// Relative change [–].
        change: f64,
    },
}

/// A polynomial fitted to samples.
struct Fit {
    /// Acceleration in the middle.
    acceleration: Vector3<f64>,
    /// Standard deviation of its coordinates for samples of standard deviation 1.
    unit_sigma: f64,
    /// Its change from the first to the last sample, and the standard deviation of that likewise; 0 for quadratics.
    change: Vector3<f64>,
    change_unit_sigma: f64,
    rms: f64,
}

/// Finds the fall in `samples`, which are in the order of time, at least [`LEAST_SAMPLES`].
pub(super) fn find(samples: &[(f64, Point3<f64>)]) -> Result<Fall, FallError> {
    let every = samples.len().div_ceil(MOST_SAMPLES);
    let samples: Vec<(f64, Point3<f64>)> = samples.iter().copied().step_by(every).collect();
    let asked_s = samples[samples.len() - 1].0 - samples[0].0;
    if samples.windows(2).any(|it| it[1].0 <= it[0].0) {
        return Err(FallError::NoTimes);
    }
    // Six samples in a row, less the three numbers of a quadratic: what they scatter by, however the light moves.
    let local: Vec<f64> = samples.windows(6).filter_map(|it| Some(fit(it, 3, f64::INFINITY)?.rms)).collect();
    let length: f64 = samples.windows(2).map(|it| (it[1].1 - it[0].1).norm()).sum();
    // Of nine surplus numbers, the median is 0.963 of the standard deviation.
    let scatter = (median(&local).unwrap_or(0.0) / 0.963).max(LEAST_SCATTER * length);
    if scatter <= 0.0 {
        return Err(FallError::TooShort { sigma: f64::INFINITY });
    }
    let mut best: Option<(f64, usize, usize, Fit)> = None;
    for first in 0..=samples.len() - LEAST_SAMPLES {
        for end in (first + LEAST_SAMPLES..=samples.len()).rev() {
            let Some(fit) = fit(&samples[first..end], 3, scatter) else { continue };
            let sigmas = fit.acceleration.norm() / (fit.unit_sigma * scatter);
            if fit.rms <= FITS * scatter && best.as_ref().is_none_or(|it| sigmas > it.0) {
                best = Some((sigmas, first, end, fit));
            }
        }
    }
    let Some((_, first, end, quadratic)) = best else {
        return Err(FallError::NotConstant { fitting_s: 0.0, asked_s });
    };
    let stretch = &samples[first..end];
    let noise = quadratic.rms.max(scatter);
    let (strength, sigma) = (quadratic.acceleration.norm(), quadratic.unit_sigma * noise);
    if sigma.is_nan() || sigma > LARGEST_SIGMA * strength {
        return Err(FallError::TooShort { sigma: sigma / strength });
    }
    let span_s = [stretch[0].0, stretch[stretch.len() - 1].0];
    if span_s[1] - span_s[0] < LEAST_SHARE * asked_s {
        return Err(FallError::NotConstant { fitting_s: span_s[1] - span_s[0], asked_s });
    }
    if let Some(cubic) = fit(stretch, 4, scatter) {
        let change = cubic.change.norm();
        if change > LARGEST_CHANGE * strength && change > 4.0 * cubic.change_unit_sigma * noise {
            return Err(FallError::Changing { change: change / strength });
        }
    }
    Ok(Fall { span_s, count: stretch.len(), acceleration: quadratic.acceleration, sigma, rms: quadratic.rms })
}

/// A polynomial of `terms` coefficients in time, by weighted least squares under Cauchy's loss of samples that scatter by `scatter`.
fn fit(samples: &[(f64, Point3<f64>)], terms: usize, scatter: f64) -> Option<Fit> {
    let (start, end) = (samples.first()?.0, samples.last()?.0);
    let (middle, half) = (0.5 * (start + end), 0.5 * (end - start));
    // Powers of time in −1 … 1, so that the second coefficient is half the acceleration times half².
    let basis =
        DMatrix::from_fn(samples.len(), terms, |row, power| ((samples[row].0 - middle) / half).powi(power as i32));
    let places = DMatrix::from_fn(samples.len(), 3, |row, axis| samples[row].1[axis]);
    let mut weights = vec![1.0; samples.len()];
    let rounds = if scatter.is_finite() { 4 } else { 1 };
    let mut found = None;
    for _ in 0..rounds {
        let mut weighted = basis.transpose();
        weighted.column_iter_mut().zip(&weights).for_each(|(mut column, weight)| column *= *weight);
        let covariance = (&weighted * &basis).try_inverse()?;
        let coefficients = &covariance * (&weighted * &places);
        let residuals = &places - &basis * &coefficients;
        let squares: f64 = residuals.row_iter().zip(&weights).map(|(it, weight)| weight * it.norm_squared()).sum();
        let surplus = 3.0 * (weights.iter().sum::<f64>() - terms as f64).max(0.5);
        let at = |power: usize, factor: f64| {
            let row = coefficients.row(power);
            (Vector3::new(row[0], row[1], row[2]) * factor, covariance[(power, power)].sqrt() * factor)
        };
        let (acceleration, unit_sigma) = at(2, 2.0 / (half * half));
        // The third derivative is 6 c/half³, along 2 half.
        let (change, change_unit_sigma) = if terms > 3 { at(3, 12.0 / (half * half)) } else { (Vector3::zeros(), 0.0) };
        let rms = (squares / surplus).sqrt();
        found = Some(Fit { acceleration, unit_sigma, change, change_unit_sigma, rms });
        for (weight, residual) in weights.iter_mut().zip(residuals.row_iter()) {
            *weight = 1.0 / (1.0 + residual.norm_squared() / (3.0 * scatter * scatter * 2.385 * 2.385));
        }
    }
    found
}
