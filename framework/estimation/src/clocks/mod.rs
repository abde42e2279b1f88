//! Clock offsets and drifts of unsynchronised cameras, estimated while targets are tracked.
//!
//! A camera stamps what it sees at time t with s = t + δ: a clock that is ahead has a positive offset δ. Where a target moves
//! in the image by u = J v [px/s], the pixel seen at t = s − δ lies −u δ from where the target is at the stamp. A filter that uses
//! the stamp, minus the known part of the offset (δ₀, zero without correction), as the time therefore finds the innovation
//!
//! ν = −u (δ − δ₀ − τ) + noise of covariance S,
//!
//! with τ the delay of the track itself, which follows all cameras. Each camera has a Kalman filter of two numbers, δ and
//! its drift d = dδ/dt; along u, one innovation measures δ − τ as δ₀ − uᵀS⁻¹ν / (uᵀS⁻¹u) with the variance 1 / (uᵀS⁻¹u).
//! Targets at rest give no information, fast ones much.
//!
//! **Gauge.** A delay common to all cameras is unobservable. The mean offset of the cameras, each weighted by how much
//! its prior variance has shrunk, is zero; or that of a named camera is.
//!
//! **Correct while tracking.** As long as offsets are not corrected (open loop), τ differs from camera to camera: it
//! depends on the cameras that came last, and its share of the error does not average out. Corrected stamps (closed
//! loop) agree, τ settles, and the estimates converge to the true values. In both cases the caller states what it
//! subtracted, and the same numbers are estimated. The tracker should do two things, the first of which matters most:
//! add u uᵀ times [`ClockEstimate::mean_squared_error`] to the covariance of a pixel (an uncertain time is an
//! uncertain place along the motion), in its update and in `innovation_covariance`; and take frames in the order of
//! their (corrected) times, or compare a late frame with where the target was then.
//!
//! The velocity is an estimate, so u has noise too, which biases an offset towards zero. In a closed loop, where the
//! remainder is measured again and again, this only costs time.

use nalgebra::{Matrix2, Vector2};

#[cfg(test)]
mod tests;

/// How many observations of one camera their mean normalised square covers; where it lies above [`MISFIT`] (2 is expected), each
/// of them raises the variance of the offset by [`FADING`]. None counts for more than [`MISFIT_SQUARED_MAX`] in it, so that one wrong
/// association in ten is none too many.
const MISFIT_MEMORY: f64 = 32.0;
const MISFIT: f64 = 4.0;
const MISFIT_SQUARED_MAX: f64 = 20.0;
const FADING: f64 = 1.1;

/// What is known of the clocks in advance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockSettings {
    /// Prior standard deviation of an offset, above 0 [s].
    pub offset_sigma_s: f64,
    /// Prior standard deviation of a drift, 0 or more [s/s].
    pub drift_sigma: f64,
    /// Random walk of an offset in a second beside its drift, standard deviation, 0 or more [s].
    pub offset_walk_s: f64,
    /// Random walk of a drift in a second, standard deviation, 0 or more [s/s].
    pub drift_walk: f64,
    /// Factor on the covariance of innovations, 1 or more [–]: innovations of neighbouring instants share the error of
    /// the track and carry less information than independent ones.
    pub correlation: f64,
    /// Innovations beyond this many standard deviations get less weight (Huber): a wrong association, a turn [–].
    pub robust_sigma: f64,
    /// The camera whose offset is zero; `None`: the mean offset is.
    pub reference: Option<usize>,
}

impl Default for ClockSettings {
    fn default() -> Self {
        Self {
            offset_sigma_s: 0.02,
            drift_sigma: 50e-6, // crystals: 20 to 100 ppm
            offset_walk_s: 20e-6,
            drift_walk: 1e-6,
            correlation: 4.0,
            robust_sigma: 2.0,
            reference: None,
        }
    }
}

/// One observation of a moving target, as information on the clock of the camera that made it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockObservation {
    /// The stamp as the camera gave it [s].
    pub stamp_s: f64,
    /// What was subtracted from the stamp before the target was predicted to it: the estimate, or 0 without correction [s].
    pub applied_offset_s: f64,
    /// Measured minus projected pixel [px].
    pub innovation: Vector2<f64>,
    /// Covariance of the innovation before the update, including the part of an uncertain time [px²].
    pub innovation_covariance: Matrix2<f64>,
    /// Velocity of the target in the image: Jacobian of the pixel by the position, times the velocity [px/s].
    pub image_velocity: Vector2<f64>,
}

/// Estimated offset and drift of one camera's clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockEstimate {
    /// How far the camera's stamps are ahead, to be subtracted from them [s].
    pub offset_s: f64,
    /// Standard deviation of the offset [s].
    pub offset_sigma_s: f64,
    /// Change of the offset in a second [s/s].
    pub drift: f64,
    /// Standard deviation of the drift [s/s].
    pub drift_sigma: f64,
    /// Number of observations taken in.
    pub n_observations: u64,
}

impl ClockEstimate {
    /// Mean squared error of a time from which `applied_offset_s` was subtracted as the offset [s²].
    pub fn mean_squared_error(&self, applied_offset_s: f64) -> f64 {
        (self.offset_s - applied_offset_s).powi(2) + self.offset_sigma_s * self.offset_sigma_s
    }
}

/// The filter of one clock; before the first observation all zero.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Clock {
    stamp_s: f64,
    offset_s: f64,
    drift: f64,
    /// Of (offset, drift).
    covariance: Matrix2<f64>,
    /// In the mean that is zero: the part of the prior variance that is gone.
    weight: f64,
    /// Running mean of the normalised squared innovations.
    misfit: f64,
    n_observations: u64,
}

/// Weighted sums over all clocks: of the weights, of the offsets carried to the epoch, of the drifts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Sums {
    weight: f64,
    offset: f64,
    drift: f64,
}

/// Estimates offset and drift of the clocks of several cameras.
///
/// The time for one observation or estimate does not depend on the number of cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct ClockEstimator {
    settings: ClockSettings,
    clocks: Vec<Clock>,
    sums: Sums,
    /// The first stamp: offsets are summed as they were then.
    epoch_s: f64,
}

impl ClockEstimator {
    /// An estimator for `n_cameras` clocks without observations.
    pub fn new(n_cameras: usize, settings: ClockSettings) -> Self {
        Self { settings, clocks: vec![Clock::default(); n_cameras], sums: Sums::default(), epoch_s: f64::NAN }
    }

    /// Takes in an observation. Returns `false`, and changes nothing, when there is no such camera, a number is not
    /// finite, or the covariance is not positive definite.
    ///
    /// A stamp before the camera's last one is used as if it were equal to that one.
    pub fn observe(&mut self, camera: usize, seen: &ClockObservation) -> bool {
        let numbers = [seen.stamp_s, seen.applied_offset_s, seen.innovation.sum(), seen.image_velocity.sum()];
        let Some(factor) = (seen.innovation_covariance * self.settings.correlation).cholesky() else { return false };
        let precise_velocity = factor.solve(&seen.image_velocity); // S⁻¹u
        let information = seen.image_velocity.dot(&precise_velocity); // uᵀS⁻¹u [1/s²]
        if camera >= self.clocks.len() || !(numbers.iter().sum::<f64>() + information).is_finite() {
            return false;
        }
        if self.epoch_s.is_nan() {
            self.epoch_s = seen.stamp_s;
        }
        let mut clock = self.clocks[camera];
        if clock.n_observations == 0 {
            let (offset_s, drift) = self.gauge(seen.stamp_s);
            let variances = Vector2::new(self.settings.offset_sigma_s, self.settings.drift_sigma).map(|it| it * it);
            let covariance = Matrix2::from_diagonal(&variances);
            clock = Clock { stamp_s: seen.stamp_s, misfit: 2.0, offset_s, drift, covariance, ..clock };
        } else if seen.stamp_s > clock.stamp_s {
            clock = clock.carried_to(seen.stamp_s, &self.settings);
        }
        let variance = clock.covariance[(0, 0)];
        let error = seen.innovation + seen.image_velocity * (clock.offset_s - seen.applied_offset_s);
        let along = precise_velocity.dot(&error);
        // νᵀ(S + u P uᵀ)⁻¹ν by Sherman and Morrison
        let squared = error.dot(&factor.solve(&error)) - along * along * variance / (1.0 + information * variance);
        let doubt = (squared.max(0.0).sqrt() / self.settings.robust_sigma).max(1.0);
        // With K = P H / (P + 1/information): written without the division by it, which may be zero.
        let column = clock.covariance.column(0).into_owned();
        let scale = 1.0 / (doubt + information * variance);
        let correction = column * (-along * scale);
        let covariance = clock.covariance - column * column.transpose() * (information * scale);
        if !(correction.sum() + covariance.sum() + squared).is_finite() {
            return false;
        }
        // Certain of a wrong offset, the filter would keep it: as long as its innovations do not fit, its certainty fades.
        clock.misfit += (squared.clamp(0.0, MISFIT_SQUARED_MAX) - clock.misfit) / MISFIT_MEMORY;
        let prior = self.settings.offset_sigma_s * self.settings.offset_sigma_s;
        let mut covariance = covariance;
        if clock.misfit > MISFIT {
            covariance[(0, 0)] = (covariance[(0, 0)] * FADING).min(prior).max(covariance[(0, 0)]);
        }
        clock.offset_s += correction.x;
        clock.drift += correction.y;
        clock.covariance = covariance;
        clock.n_observations += 1;
        clock.weight = (1.0 - clock.covariance[(0, 0)] / prior).max(0.0);
        self.count(camera, -1.0);
        self.clocks[camera] = clock;
        self.count(camera, 1.0);
        true
    }

    /// Offset and drift of `camera` at its stamp `stamp_s`; `None` when there is no such camera.
    ///
    /// A camera without observations has the offset 0 and the standard deviation of the settings.
    pub fn estimate(&self, camera: usize, stamp_s: f64) -> Option<ClockEstimate> {
        let clock = self.clocks.get(camera)?;
        if clock.n_observations == 0 {
            let ClockSettings { offset_sigma_s, drift_sigma, .. } = self.settings;
            return Some(ClockEstimate { offset_s: 0.0, offset_sigma_s, drift: 0.0, drift_sigma, n_observations: 0 });
        }
        let (common, common_drift) = self.gauge(stamp_s);
        let carried = clock.carried_to(stamp_s.max(clock.stamp_s), &self.settings);
        let mut covariance = carried.covariance;
        match self.settings.reference {
            Some(reference) if reference == camera => covariance = Matrix2::zeros(),
            Some(reference) => {
                if let Some(other) = self.clocks.get(reference).filter(|it| it.n_observations > 0) {
                    covariance += other.carried_to(stamp_s.max(other.stamp_s), &self.settings).covariance;
                }
            }
            None => {}
        }
        Some(ClockEstimate {
            offset_s: clock.offset_s + clock.drift * (stamp_s - clock.stamp_s) - common,
            offset_sigma_s: covariance[(0, 0)].max(0.0).sqrt(),
            drift: clock.drift - common_drift,
            drift_sigma: covariance[(1, 1)].max(0.0).sqrt(),
            n_observations: clock.n_observations,
        })
    }

    /// Offset and drift that count as zero, at a stamp.
    fn gauge(&self, stamp_s: f64) -> (f64, f64) {
        if let Some(clock) = self.settings.reference.and_then(|it| self.clocks.get(it)) {
            return (clock.offset_s + clock.drift * (stamp_s - clock.stamp_s), clock.drift);
        }
        if self.sums.weight <= 0.0 {
            return (0.0, 0.0);
        }
        let drift = self.sums.drift / self.sums.weight;
        (self.sums.offset / self.sums.weight + drift * (stamp_s - self.epoch_s), drift)
    }

    /// Adds a clock to the sums, or takes it out with a `sign` of −1.
    fn count(&mut self, camera: usize, sign: f64) {
        let clock = &self.clocks[camera];
        let weight = sign * clock.weight;
        self.sums.weight += weight;
        self.sums.offset += weight * (clock.offset_s - clock.drift * (clock.stamp_s - self.epoch_s));
        self.sums.drift += weight * clock.drift;
    }
}

impl Clock {
    /// The same at a later stamp.
    fn carried_to(&self, stamp_s: f64, settings: &ClockSettings) -> Clock {
        let t = stamp_s - self.stamp_s;
        let forward = Matrix2::new(1.0, t, 0.0, 1.0);
        let (walk, drift_walk) = (settings.offset_walk_s.powi(2), settings.drift_walk.powi(2));
        let noise = Matrix2::new(
            walk * t + drift_walk * t.powi(3) / 3.0,
            drift_walk * t * t / 2.0,
            drift_walk * t * t / 2.0,
            drift_walk * t,
        );
        Clock {
            stamp_s,
            offset_s: self.offset_s + self.drift * t,
            covariance: forward * self.covariance * forward.transpose() + noise,
            ..*self
        }
    }
}
