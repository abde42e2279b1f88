//! Order statistics of a list of numbers.
//!
//! Values that are not finite (NaN, ±∞) are left out everywhere here; [`Summary`] counts them. The input is not
//! reordered; each call copies and sorts it.

/// Multiplies a median absolute deviation to give the standard deviation of Gaussian data: 1/Φ⁻¹(¾).
pub const SIGMA_PER_MAD: f64 = 1.482_602_218_505_602;

/// Summary statistics of a list of numbers, in the unit of the values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Number of finite values; at least 1.
    pub count: usize,
    /// Number of values left out as not finite.
    pub left_out: usize,
    /// Mean.
    pub mean: f64,
    /// Median: half of the values are smaller.
    pub median: f64,
    /// 90th percentile.
    pub p90: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Largest value.
    pub max: f64,
}

impl Summary {
    /// Summary of the finite values; `None` when there is none.
    pub fn of(values: &[f64]) -> Option<Summary> {
        let sorted = finite_sorted(values);
        let count = sorted.len();
        Some(Summary {
            count,
            left_out: values.len() - count,
            mean: sorted.iter().map(|it| it / count as f64).sum(),
            median: percentile_of_sorted(&sorted, 50.0)?,
            p90: percentile_of_sorted(&sorted, 90.0)?,
            p95: percentile_of_sorted(&sorted, 95.0)?,
            max: *sorted.last()?,
        })
    }
}

/// Median of the finite values, midway between the two middle ones for an even count; `None` without a finite value.
pub fn median(values: &[f64]) -> Option<f64> {
    percentile(values, 50.0)
}

/// The value that `percent` [0..=100] of the values do not exceed, `None` without a finite value.
///
/// Interpolates linearly between the values at ranks 0 (0 %) to n − 1 (100 %): type 7 of R. Hyndman and Y. Fan,
/// "Sample quantiles in statistical packages", 1996, which is what NumPy does. `percent` outside its range is taken
/// to the nearer end; NaN gives `None`.
pub fn percentile(values: &[f64], percent: f64) -> Option<f64> {
    percentile_of_sorted(&finite_sorted(values), percent)
}

/// Median absolute deviation; times [`SIGMA_PER_MAD`] it is an estimate of the standard deviation that tolerates
/// nearly one half of outliers. `None` without a finite value.
pub fn mad(values: &[f64]) -> Option<f64> {
    let mut distances = finite_sorted(values);
    let centre = percentile_of_sorted(&distances, 50.0)?;
    distances.iter_mut().for_each(|it| *it = (*it - centre).abs());
    median(&distances)
}

fn finite_sorted(values: &[f64]) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|it| it.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted
}

fn percentile_of_sorted(sorted: &[f64], percent: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1).filter(|_| !percent.is_nan())?;
    let rank = percent.clamp(0.0, 100.0) / 100.0 * last as f64;
    let below = sorted[rank as usize];
    let above = sorted[(rank as usize + 1).min(last)];
    let share = rank.fract();
    // Written so that the difference of two huge values of opposite sign does not overflow.
    Some(below * (1.0 - share) + above * share)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn values_are_those_of_numpy() {
        let values = [7.0, 1.0, 4.0, 2.0, 10.0];
        assert_eq!(median(&values), Some(4.0));
        assert_eq!(median(&values[..4]), Some(3.0));
        assert!((percentile(&values, 90.0).unwrap() - 8.8).abs() < 1e-12);
        assert!((percentile(&values, 10.0).unwrap() - 1.4).abs() < 1e-12);
        assert_eq!([percentile(&values, 0.0), percentile(&values, 100.0)], [Some(1.0), Some(10.0)]);
        assert_eq!([percentile(&values, -5.0), percentile(&values, 200.0)], [Some(1.0), Some(10.0)]);
        assert_eq!(mad(&values), Some(3.0)); // distances 3, 3, 0, 2, 6
    }

    #[test]
    fn what_is_not_finite_is_left_out_and_counted() {
        let summary = Summary::of(&[f64::NAN, 3.0, f64::INFINITY, 1.0, f64::NEG_INFINITY]).unwrap();
        assert_eq!((summary.count, summary.left_out), (2, 3));
        assert_eq!((summary.mean, summary.median, summary.max), (2.0, 2.0, 3.0));
        assert!((summary.p90 - 2.8).abs() < 1e-12 && (summary.p95 - 2.9).abs() < 1e-12);
    }

    #[test]
    fn without_a_finite_value_there_is_no_answer() {
        for values in [&[][..], &[f64::NAN], &[f64::INFINITY, f64::NEG_INFINITY]] {
            assert_eq!((median(values), mad(values), Summary::of(values)), (None, None, None));
        }
        assert_eq!(percentile(&[1.0], f64::NAN), None);
    }

    #[test]
    fn huge_values_do_not_overflow() {
        let summary = Summary::of(&[f64::MAX, -f64::MAX, f64::MAX, f64::MAX]).unwrap();
        assert!(summary.mean.is_finite() && summary.median.is_finite());
        assert_eq!(median(&[f64::MAX, -f64::MAX]), Some(0.0));
    }

    proptest! {
        #[test]
        fn percentiles_rise_and_shift_with_the_values(
            values in prop::collection::vec(-1e3..1e3, 1..40), low in 0.0..100.0_f64, high in 0.0..100.0_f64, shift in -10.0..10.0_f64,
        ) {
            let (low, high) = (low.min(high), low.max(high));
            let [at_low, at_high] = [low, high].map(|it| percentile(&values, it).unwrap());
            prop_assert!(at_low <= at_high + 1e-9);
            let shifted: Vec<f64> = values.iter().map(|it| it + shift).collect();
            prop_assert!((percentile(&shifted, low).unwrap() - at_low - shift).abs() < 1e-9);
            prop_assert!((mad(&shifted).unwrap() - mad(&values).unwrap()).abs() < 1e-9);
        }
    }
}
