//! By how much the light of a picture differs from that in which the background was learnt.

/// Ratios are counted in steps of 1/64, up to 4.
const STEPS: usize = 64;
/// Pixels darker than this say nothing about the light [gray level].
const FLOOR: f32 = 16.0;
/// Part of the samples that must agree on a ratio.
const CONSENSUS: f32 = 0.3;

/// Finds the ratio on which most samples agree; keeps its memory.
#[derive(Debug, Clone, Default)]
pub(crate) struct Light {
    counts: Vec<u32>,
    /// Ratio, gray level, learnt one.
    samples: Vec<[f32; 3]>,
}

impl Light {
    /// Of pairs (gray level, learnt one): the median of the ratios, sharpened by least squares around it. `None` where less than a third
    /// of them agree on one. Dark and saturated ones are left out.
    pub fn ratio(&mut self, samples: impl Iterator<Item = (f32, f32)>) -> Option<f32> {
        let samples = samples.filter(|&(pixel, mean)| mean > FLOOR && pixel < 255.0);
        self.samples.clear();
        self.samples.extend(samples.map(|(pixel, mean)| [pixel / mean, pixel, mean]));
        self.counts.clear();
        self.counts.resize(4 * STEPS, 0);
        for [ratio, ..] in &self.samples {
            let bin = (ratio * STEPS as f32) as usize;
            self.counts[bin.min(4 * STEPS - 1)] += 1;
        }
        let n = self.samples.len() as u32;
        let mut below = 0;
        let median = self.counts.iter().position(|&it| {
            below += it;
            2 * below > n
        })?;
        let middle = (median as f32 + 0.5) / STEPS as f32;
        let (mut n_near, mut product, mut square) = (0u32, 0.0, 0.0);
        for [ratio, pixel, mean] in &self.samples {
            if (ratio - middle).abs() < 0.1 * middle {
                n_near += 1;
                product += pixel * mean;
                square += mean * mean;
            }
        }
        (n_near as f32 >= CONSENSUS * n as f32 && product > 0.0).then(|| product / square)
    }
}
