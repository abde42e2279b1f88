//! Process noise adapted to the innovations.
//!
//! Where a filter's noise is too low, its normalised squared innovations are larger than their number of degrees of freedom,
//! and the other way round (the tests of Y. Bar-Shalom, X. Li, T. Kirubarajan, *Estimation with Applications to Tracking and
//! Navigation*, 2001, §5.4, and noise adjustment of §11.5). The scale s of the process noise follows the ratio r of the two,
//! both forgotten with the time constant τ, by d ln s / dt = k/τ · ln r: fast upwards, so that a sudden turn loses
//! nothing, slowly downwards. Within one standard deviation of what chance does to r nothing moves.

/// Rates k of the scale.
const UP: f64 = 4.0;
const DOWN: f64 = 0.2;
/// What is taken to have been seen, just as expected, before the first observation [degrees of freedom].
const PRIOR_DEGREES: f64 = 4.0;
/// No observation counts for more than this much per degree of freedom: a wrong one is no manoeuvre.
const SQUARED_MAX: f64 = 16.0;

/// A factor for the process noise of one filter, for [`Filter::predict_scaled`](super::Filter::predict_scaled).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdaptiveNoise {
    time_constant_s: f64,
    log_bounds: (f64, f64),
    squared: f64,
    degrees: f64,
    log_scale: f64,
}

impl AdaptiveNoise {
    /// A factor with the time constant `time_constant_s` [s], above 0, kept within 1/16 to 64.
    pub fn new(time_constant_s: f64) -> Self {
        Self::bounded(time_constant_s, 1.0 / 16.0, 64.0)
    }

    /// As [`Self::new`], kept within `lowest` and `highest`, `lowest` ≤ 1 ≤ `highest`.
    pub fn bounded(time_constant_s: f64, lowest: f64, highest: f64) -> Self {
        let log_bounds = (lowest.ln().min(0.0), highest.ln().max(0.0));
        Self { time_constant_s, log_bounds, squared: 0.0, degrees: 0.0, log_scale: 0.0 }
    }

    /// Takes in the normalised squared innovation of an update, of `degrees` degrees of freedom (2 for a pixel),
    /// `dt_s` after the one before. Values that are negative or not finite are ignored.
    #[inline]
    pub fn observe(&mut self, normalised_squared: f64, degrees: usize, dt_s: f64) {
        let usable = |value: f64| value >= 0.0 && value.is_finite();
        if !(usable(normalised_squared) && usable(dt_s)) || degrees == 0 {
            return;
        }
        let passed = dt_s / self.time_constant_s;
        let (kept, degrees) = ((-passed).exp(), degrees as f64);
        self.squared = self.squared * kept + normalised_squared.min(SQUARED_MAX * degrees);
        self.degrees = self.degrees * kept + degrees;
        let total = self.degrees + PRIOR_DEGREES;
        let ratio = (self.squared + PRIOR_DEGREES) / total;
        let chance = (2.0 / total).sqrt(); // below 1: total is at least the prior and one
        let step = passed.min(1.0);
        if ratio > 1.0 + chance {
            self.log_scale += UP * step * (ratio / (1.0 + chance)).ln();
        } else if ratio < 1.0 - chance {
            self.log_scale += DOWN * step * (ratio / (1.0 - chance)).ln();
        }
        self.log_scale = self.log_scale.max(self.log_bounds.0).min(self.log_bounds.1);
    }

    /// The present factor on the process noise.
    #[inline]
    pub fn scale(&self) -> f64 {
        self.log_scale.exp()
    }
}
