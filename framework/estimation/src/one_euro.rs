//! The 1€ filter: a low-pass filter whose cutoff rises with speed, so that a value at rest does not jitter and a moving one hardly lags.
//!
//! Source: G. Casiez, N. Roussel, D. Vogel, "1€ filter: a simple speed-based low-pass filter for noisy input in interactive systems", CHI 2012.
//!
//! | here              | paper   | meaning                                             | unit |
//! |-------------------|---------|-----------------------------------------------------|------|
//! | `min_cutoff_hz`   | fcmin   | cutoff at rest                                      | Hz   |
//! | `beta`            | β       | by how much the cutoff rises with speed             | 1/unit |
//! | `speed_cutoff_hz` | dcutoff | cutoff of the low-pass filter of the speed          | Hz   |
//! | `smoothing(f, t)` | α       | 1 / (1 + τ/t) with τ = 1/(2πf)                      | –    |
//! | `value`           | X̂ᵢ      | α Xᵢ + (1 − α) X̂ᵢ₋₁                                 | unit |
//!
//! The paper filters each axis by itself; here the speed is that of all axes together, so that the filter has no
//! preferred direction. The derivative is that of the measured value against the filtered one, as in the authors'
//! code.

use std::f64::consts::TAU;

use nalgebra::SVector;

/// Settings of the filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OneEuroOptions {
    /// Cutoff at rest, above 0 [Hz].
    pub min_cutoff_hz: f64,
    /// Rise of the cutoff with the speed [Hz per unit/s].
    pub beta: f64,
    /// Cutoff of the low-pass on the speed, above 0 [Hz]. The paper uses 1 Hz.
    pub speed_cutoff_hz: f64,
}

/// Filters a value of N numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct OneEuro<const N: usize> {
    options: OneEuroOptions,
    /// Filtered.
    value: SVector<f64, N>,
    /// Filtered derivative [unit/s].
    speed: SVector<f64, N>,
}

impl<const N: usize> OneEuro<N> {
    /// Starts the filter at `value`, with zero speed.
    pub fn new(options: OneEuroOptions, value: SVector<f64, N>) -> Self {
        Self { options, value, speed: SVector::zeros() }
    }

    /// The filtered value.
    pub fn value(&self) -> SVector<f64, N> {
        self.value
    }

    /// The filtered derivative [unit/s]; it lags by about 1/(2π `speed_cutoff_hz`).
    pub fn speed(&self) -> SVector<f64, N> {
        self.speed
    }

    /// Takes in a value measured `dt_s` after the last one. Returns `false`, and keeps the state, where `dt_s` is not
    /// above 0 or a number is not finite.
    pub fn update(&mut self, measured: SVector<f64, N>, dt_s: f64) -> bool {
        let is_usable = dt_s > 0.0 && dt_s.is_finite() && measured.iter().all(|it| it.is_finite());
        if !is_usable {
            return false;
        }
        let speed = (measured - self.value) / dt_s;
        self.speed += (speed - self.speed) * smoothing(self.options.speed_cutoff_hz, dt_s);
        let cutoff = self.options.min_cutoff_hz + self.options.beta * self.speed.norm();
        self.value += (measured - self.value) * smoothing(cutoff, dt_s);
        true
    }
}

/// The weight α of a new value `dt_s` after the last one, in a low-pass filter of this cutoff.
fn smoothing(cutoff_hz: f64, dt_s: f64) -> f64 {
    1.0 / (1.0 + 1.0 / (TAU * cutoff_hz * dt_s))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Vector1, Vector2};

    use super::*;
    use crate::random::Random;

    const OPTIONS: OneEuroOptions = OneEuroOptions { min_cutoff_hz: 1.0, beta: 0.5, speed_cutoff_hz: 1.0 };
    const DT: f64 = 1.0 / 60.0;

    #[test]
    fn first_steps_are_those_of_the_paper() {
        // By hand: α(1 Hz) at 60 Hz is 1/(1 + 60/2π) = 0.094793; speed (1 − 0)/dt α = 5.68758; cutoff 1 + 0.5·5.68758 = 3.84379; α = 0.286998.
        let mut filter = OneEuro::new(OPTIONS, Vector1::new(0.0));
        assert!(filter.update(Vector1::new(1.0), DT));
        assert!((filter.speed()[0] - 5.68758).abs() < 1e-4, "{}", filter.speed());
        assert!((filter.value()[0] - 0.286998).abs() < 1e-5, "{}", filter.value());
    }

    #[test]
    fn rest_is_calm_and_motion_does_not_lag() {
        let mut random = Random::new(5);
        let run = |speed: f64, options: OneEuroOptions, random: &mut Random| {
            let mut filter = OneEuro::new(options, Vector2::zeros());
            let mut worst = 0.0_f64;
            let (mut sum, mut n) = (0.0, 0.0);
            for step in 1..2000 {
                let truth = Vector2::new(speed * DT * f64::from(step), 0.0);
                let noise = Vector2::new(random.normal(), random.normal()) * 0.01;
                filter.update(truth + noise, DT);
                if step > 300 {
                    let error = (filter.value() - truth).norm();
                    (worst, sum, n) = (worst.max(error), sum + error * error, n + 1.0);
                }
            }
            (sum / n).sqrt()
        };
        let raw = 0.01 * 2.0_f64.sqrt();
        let at_rest = run(0.0, OPTIONS, &mut random);
        assert!(at_rest < 0.35 * raw, "{at_rest}");
        let adaptive = run(10.0, OneEuroOptions { beta: 2.0, ..OPTIONS }, &mut random);
        let fixed = run(10.0, OneEuroOptions { beta: 0.0, ..OPTIONS }, &mut random);
        // A fixed low-pass lags by v/(2π f): 1.6; the cutoff of the other is 21 Hz at this speed.
        assert!((fixed - 1.59).abs() < 0.1, "{fixed}");
        assert!(adaptive < 0.1, "{adaptive}");
    }

    #[test]
    fn directions_are_alike() {
        let mut straight = OneEuro::new(OPTIONS, Vector2::zeros());
        let mut slanted = OneEuro::new(OPTIONS, Vector2::zeros());
        let turn = nalgebra::Rotation2::new(0.7);
        for step in 1..50 {
            let measured = Vector2::new((0.3 * f64::from(step)).sin(), 0.1 * f64::from(step));
            straight.update(measured, DT);
            slanted.update(turn * measured, DT);
        }
        assert!((turn * straight.value() - slanted.value()).norm() < 1e-12);
    }

    #[test]
    fn what_is_no_measurement_changes_nothing() {
        let mut filter = OneEuro::new(OPTIONS, Vector1::new(2.0));
        let before = filter.clone();
        for (value, dt) in [(f64::NAN, DT), (1.0, 0.0), (1.0, -DT), (1.0, f64::NAN), (f64::INFINITY, DT)] {
            assert!(!filter.update(Vector1::new(value), dt));
        }
        assert_eq!(filter, before);
    }
}
