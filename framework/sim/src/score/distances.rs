//! Percentiles of many distances in little memory: a histogram with bins of 0.01 mm.

const BIN: f64 = 1e-5;

/// Distances between 0 and a limit [m].
pub(super) struct Distances {
    bins: Vec<u64>,
    count: u64,
    squares: f64,
}

impl Distances {
    pub fn new(limit: f64) -> Self {
        Self { bins: vec![0; (limit / BIN) as usize + 2], count: 0, squares: 0.0 }
    }

    pub fn add(&mut self, distance: f64) {
        let last = self.bins.len() - 1;
        self.bins[((distance / BIN) as usize).min(last)] += 1;
        self.count += 1;
        self.squares += distance * distance;
    }

    /// Within 0.01 mm; NaN when there is none.
    pub fn percentile(&self, percent: f64) -> f64 {
        let rank = (self.count as f64 * percent / 100.0).ceil().max(1.0) as u64;
        let mut below = 0;
        let place = self.bins.iter().position(|count| {
            below += count;
            below >= rank
        });
        place.map_or(f64::NAN, |bin| (bin as f64 + 0.5) * BIN)
    }

    /// Root of the mean square; NaN when there is none.
    pub fn rms(&self) -> f64 {
        (self.squares / self.count as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_values() {
        let mut distances = Distances::new(0.1);
        assert!(distances.percentile(50.0).is_nan() && distances.rms().is_nan());
        (1..=1000).for_each(|i| distances.add(f64::from(i) * 1e-4));
        assert!((distances.percentile(50.0) - 0.05).abs() < 1.1e-5);
        assert!((distances.percentile(95.0) - 0.095).abs() < 1.1e-5);
        assert!((distances.rms() - 0.057_778_3).abs() < 1e-6, "{}", distances.rms());
    }
}
