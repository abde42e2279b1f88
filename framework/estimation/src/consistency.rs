//! Filter consistency: compares the mean normalised squared innovation with χ².
//!
//! If model and noise are right, νᵀ S⁻¹ ν of a measurement of d numbers is χ² with d degrees of freedom, and the innovations
//! are independent, so their sum is χ² with as many as all measurements together (Y. Bar-Shalom, X. Li, T. Kirubarajan,
//! *Estimation with Applications to Tracking and Navigation*, 2001, §5.4). Quantiles are those of E. Wilson, M. Hilferty, "The
//! distribution of chi-square", PNAS 17, 1931: χ²ₚ(k) ≈ k (1 − 2/(9k) + zₚ √(2/(9k)))³, good to 1 % from
//! k = 3 in the upper tail.

/// Result of the test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Errors are as large as stated, within the test's limits.
    Consistent,
    /// Errors are larger than stated: process or measurement noise too low, a wrong model, or wrong associations.
    Overconfident,
    /// Errors are smaller than stated: noise too high.
    Underconfident,
}

/// Running mean of normalised squared innovations (NIS), and the χ² test on it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Consistency {
    squared: f64,
    degrees: f64,
    count: u64,
}

impl Consistency {
    /// Takes in the normalised squared innovation of a measurement of `degrees` numbers (2 for a pixel). Values that
    /// are negative or not finite are ignored.
    #[inline]
    pub fn observe(&mut self, normalised_squared: f64, degrees: usize) {
        if normalised_squared >= 0.0 && normalised_squared.is_finite() {
            self.squared += normalised_squared;
            self.degrees += degrees as f64;
            self.count += 1;
        }
    }

    /// Adds the observations of `other`.
    pub fn merge(&mut self, other: &Consistency) {
        self.squared += other.squared;
        self.degrees += other.degrees;
        self.count += other.count;
    }

    /// Number of observations taken in.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Mean over all degrees of freedom: 1 for a consistent filter. `None` before the first observation.
    ///
    /// Behind a gate of three or four standard deviations it is a few percent lower.
    pub fn mean(&self) -> Option<f64> {
        (self.degrees > 0.0).then(|| self.squared / self.degrees)
    }

    /// Bounds of the mean of a consistent filter, with the probability that a normal number lies within `sigmas`
    /// standard deviations (2.58: 99 %). From 0 to infinity before the first observation.
    pub fn bounds(&self, sigmas: f64) -> (f64, f64) {
        if self.degrees == 0.0 {
            return (0.0, f64::INFINITY);
        }
        let at = |sigmas: f64| chi_squared_quantile(self.degrees, sigmas) / self.degrees;
        (at(-sigmas), at(sigmas))
    }

    /// The test at `sigmas` standard deviations. Many observations reveal even a negligible fault; `tolerance` is the
    /// part by which the mean may lie beyond its bounds all the same (0: the test alone).
    pub fn verdict(&self, sigmas: f64, tolerance: f64) -> Verdict {
        let (low, high) = self.bounds(sigmas);
        match self.mean() {
            Some(mean) if mean > high * (1.0 + tolerance) => Verdict::Overconfident,
            Some(mean) if mean < low / (1.0 + tolerance) => Verdict::Underconfident,
            _ => Verdict::Consistent,
        }
    }
}

/// Quantile of χ² with `degrees` degrees of freedom, at the probability that a normal number lies below `sigmas`.
pub fn chi_squared_quantile(degrees: f64, sigmas: f64) -> f64 {
    let ninth = 2.0 / (9.0 * degrees);
    degrees * (1.0 - ninth + sigmas * ninth.sqrt()).max(0.0).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (degrees, sigmas, expected) in [
            (2.0, 1.959964, 7.3778),
            (2.0, 2.326348, 9.2103),
            (3.0, 1.644854, 7.8147),
            (20.0, -1.959964, 9.5908),
            (10.0, 1.959964, 20.4832),
            (100.0, -1.959964, 74.2219),
            (100.0, 2.575829, 140.169),
        ] {
            let found = chi_squared_quantile(degrees, sigmas);
            assert!((found / expected - 1.0).abs() < 0.011, "{degrees} {sigmas}: {found}, {expected}");
        }
        assert_eq!(chi_squared_quantile(1.0, -5.0), 0.0);
    }

    /// Verdicts over many runs in which true errors are `ratio` times as large as stated.
    fn verdicts(ratio: f64, observations: usize) -> [usize; 3] {
        let mut counts = [0; 3];
        for seed in 0..500 {
            let (mut random, mut consistency) = (Random::new(seed), Consistency::default());
            for step in 0..observations {
                let degrees = 2 + step % 2; // pixels and positions mixed
                let squared = (0..degrees).map(|_| (ratio * random.normal()).powi(2)).sum();
                consistency.observe(squared, degrees);
            }
            assert_eq!(consistency.count(), observations as u64);
            counts[match consistency.verdict(2.575829, 0.0) {
                Verdict::Consistent => 0,
                Verdict::Overconfident => 1,
                Verdict::Underconfident => 2,
            }] += 1;
        }
        counts
    }

    #[test]
    fn a_right_filter_passes_as_often_as_the_test_says_and_a_wrong_one_does_not() {
        for observations in [1, 10, 1000] {
            let [consistent, over, timid] = verdicts(1.0, observations);
            // 1 % of 500 on both sides together, four standard errors
            assert!(consistent >= 486 && over <= 12 && timid <= 12, "{consistent} {over} {timid}");
        }
        assert!(verdicts(1.3, 200)[1] > 490 && verdicts(0.75, 200)[2] > 490);
    }

    #[test]
    fn small_faults_may_be_tolerated_and_nonsense_is_passed_over() {
        let mut consistency = Consistency::default();
        assert_eq!((consistency.mean(), consistency.bounds(3.0)), (None, (0.0, f64::INFINITY)));
        assert_eq!(consistency.verdict(3.0, 0.0), Verdict::Consistent);
        for nonsense in [f64::NAN, f64::INFINITY, -1.0] {
            consistency.observe(nonsense, 2);
        }
        assert_eq!(consistency, Consistency::default());
        let mut half = Consistency::default();
        (0..50_000).for_each(|_| half.observe(2.1, 2));
        consistency.merge(&half);
        consistency.merge(&half);
        assert_eq!(consistency.count(), 100_000);
        assert!((consistency.mean().unwrap() - 1.05).abs() < 1e-9);
        assert_eq!(consistency.verdict(3.0, 0.0), Verdict::Overconfident);
        assert_eq!(consistency.verdict(3.0, 0.1), Verdict::Consistent);
    }
}
