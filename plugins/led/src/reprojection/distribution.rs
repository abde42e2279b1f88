//! The distribution of residuals, in bounded memory.

/// Bins for each factor of e: neighbouring bins differ by 0.2 %.
const BINS_PER_E: f64 = 500.0;
/// Smaller values count as this [px].
const SMALLEST: f64 = 1e-4;
/// Up to e²¹ times the smallest: 1.3e5 px.
const N_BINS: usize = 10_500;

/// Counts of positive values on a logarithmic scale; quantiles come out to 0.1 % of themselves.
#[derive(Debug, Clone)]
pub struct Distribution {
    bins: Vec<u64>,
    count: u64,
    largest: f64,
}

impl Default for Distribution {
    fn default() -> Self {
        Self { bins: vec![0; N_BINS], count: 0, largest: f64::NAN }
    }
}

impl Distribution {
    /// Adds a value; what is not a number is left out.
    pub fn add(&mut self, value: f64) {
        if value.is_nan() {
            return;
        }
        let bin = ((value / SMALLEST).ln() * BINS_PER_E).max(0.0) as usize;
        self.bins[bin.min(N_BINS - 1)] += 1;
        self.count += 1;
        self.largest = self.largest.max(value);
    }

    /// How many values there are.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The largest value; NaN without any.
    pub fn max(&self) -> f64 {
        self.largest
    }

    /// The value below which the part `share` of all lies; NaN without any.
    pub fn quantile(&self, share: f64) -> f64 {
        let rank = share.clamp(0.0, 1.0) * self.count.saturating_sub(1) as f64;
        let mut below = 0;
        for (bin, &count) in self.bins.iter().enumerate() {
            below += count;
            if below as f64 > rank {
                return (SMALLEST * ((bin as f64 + 0.5) / BINS_PER_E).exp()).min(self.largest);
            }
        }
        f64::NAN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_sorted_list() {
        let mut distribution = Distribution::default();
        (1..=1001).for_each(|it| distribution.add(f64::from(it) * 0.01));
        for (share, truth) in [(0.0, 0.01), (0.5, 5.01), (0.9, 9.01), (1.0, 10.01)] {
            let found = distribution.quantile(share);
            assert!((found / truth - 1.0).abs() < 2e-3, "{share}: {found} instead of {truth}");
        }
        assert_eq!((distribution.max(), distribution.count()), (10.01, 1001));
    }

    #[test]
    fn nothing_zero_infinite_and_nan() {
        let mut distribution = Distribution::default();
        assert!(distribution.quantile(0.5).is_nan() && distribution.max().is_nan());
        distribution.add(f64::NAN);
        assert_eq!(distribution.count(), 0);
        distribution.add(0.0);
        assert!(distribution.quantile(0.5) < 2.0 * SMALLEST);
        distribution.add(f64::INFINITY);
        assert_eq!(distribution.max(), f64::INFINITY);
    }
}
