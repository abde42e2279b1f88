//! Mean and variance of each pixel from a few pictures, some of which may show a person passing.
//!
//! Up to fifteen pictures are kept, evenly spread over those that are learnt from. The median of a pixel's samples holds as
//! long as less than half of them are disturbed; mean and variance are taken of the samples within three (robust) standard
//! deviations of it. So few samples know a variance to some 20 % only, so it is drawn towards that of the whole picture.

use super::light::Light;

const SAMPLES: u32 = 15;
/// Pixels that the light of a sample is taken from, about.
const LEVELLED: usize = 4096;
/// Closer to 1 than half a gray level in 255 is no change of light.
const SAME: f32 = 0.004;
/// How many samples' weight the variance of the whole picture has.
const PRIOR: f32 = 5.0;

#[derive(Debug, Clone)]
pub(crate) struct Learning {
    n_frames: u32,
    seen: u32,
    samples: Vec<Vec<u8>>,
}

impl Learning {
    /// About to learn from `n_frames` pictures of `n_pixels`.
    pub fn new(n_frames: u32, n_pixels: usize) -> Self {
        let n = n_frames.min(SAMPLES) as usize;
        Self { n_frames, seen: 0, samples: (0..n).map(|_| Vec::with_capacity(n_pixels)).collect() }
    }

    /// Takes note of a picture; `true`: it was the last.
    pub fn add(&mut self, pixels: &[u8]) -> bool {
        let n = self.samples.len() as u64;
        let place = |seen: u32| (u64::from(seen) * n / u64::from(self.n_frames)) as usize;
        let (before, after) = (place(self.seen), place(self.seen + 1));
        if after > before {
            self.samples[before].clear();
            self.samples[before].extend_from_slice(pixels);
        }
        self.seen += 1;
        self.seen >= self.n_frames
    }

    /// There will be no more pictures; `false`: there was none.
    pub fn end(&mut self) -> bool {
        self.samples.retain(|it| !it.is_empty());
        !self.samples.is_empty()
    }

    /// Brings all samples to the light of their median, channel by channel (`channels` bytes a pixel): a lamp that flickers is no noise of the pixels. Saturated bytes stay so.
    pub fn level(&mut self, channels: usize) {
        let n_pixels = self.samples.first().map_or(0, Vec::len) / channels;
        let step = (n_pixels / LEVELLED) | 1;
        let mut finder = Light::default();
        for channel in 0..channels {
            let places = || (0..n_pixels).step_by(step).map(|it| it * channels + channel);
            let median = |at: usize| {
                let mut column: Vec<u8> = self.samples.iter().map(|it| it[at]).collect();
                column.sort_unstable();
                f32::from(column[column.len() / 2])
            };
            let medians: Vec<f32> = places().map(median).collect();
            for sample in &mut self.samples {
                let pairs = places().zip(&medians).map(|(at, median)| (f32::from(sample[at]), *median));
                let Some(gain) = finder.ratio(pairs).filter(|it| (it - 1.0).abs() >= SAME) else { continue };
                let level = |value: usize| if value == 255 { 255 } else { (value as f32 / gain).round() as u8 };
                let levels: [u8; 256] = std::array::from_fn(level);
                sample.iter_mut().skip(channel).step_by(channels).for_each(|it| *it = levels[usize::from(*it)]);
            }
        }
    }

    /// The pictures that it is learnt from.
    pub fn samples(&self) -> &[Vec<u8>] {
        &self.samples
    }

    /// Fills in what has been learnt.
    pub fn finish(&self, noise_floor: f32, means: &mut [f32], variances: &mut [f32]) {
        let n = self.samples.len();
        let mut column = [0u8; SAMPLES as usize];
        let mut counts = vec![0u8; means.len()];
        let (mut pooled, mut n_pooled) = (0.0f64, 0u64);
        for i in 0..means.len() {
            let column = &mut column[..n];
            for (value, sample) in column.iter_mut().zip(&self.samples) {
                *value = sample[i];
            }
            column.sort_unstable();
            let median = column[n / 2];
            let mut gaps = [0u8; SAMPLES as usize];
            for (gap, &value) in gaps.iter_mut().zip(&*column) {
                *gap = value.abs_diff(median);
            }
            gaps[..n].sort_unstable();
            // 1.4826 makes the median deviation of Gaussian noise its σ; half a level for the rounding.
            let reach = (3.0 * 1.4826 * (f32::from(gaps[n / 2]) + 0.5)).max(3.0 * noise_floor);
            let (mut count, mut sum, mut square) = (0u8, 0.0, 0.0);
            for &value in &*column {
                let d = f32::from(value) - f32::from(median);
                if d.abs() <= reach {
                    count += 1;
                    sum += d;
                    square += d * d;
                }
            }
            let off = sum / f32::from(count);
            means[i] = f32::from(median) + off;
            variances[i] = (square - off * sum).max(0.0); // the sum of squares, for now
            counts[i] = count;
            pooled += f64::from(variances[i]);
            n_pooled += u64::from(count - 1);
        }
        let pooled = if n_pooled > 0 { (pooled / n_pooled as f64) as f32 } else { 9.0 * noise_floor * noise_floor };
        for (variance, &count) in variances.iter_mut().zip(&counts) {
            let free = f32::from(count) - 1.0;
            *variance = ((*variance + PRIOR * pooled) / (free + PRIOR)).max(noise_floor * noise_floor);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn somebody_who_passes_leaves_no_trace() {
        let mut learning = Learning::new(30, 4);
        for k in 0..30u32 {
            let noise = [0, 2, 1, 3, 2, 0][k as usize % 6];
            let passer = if (6..16).contains(&k) { 200 } else { 50 + noise };
            assert_eq!(learning.add(&[50 + noise, passer, 0, 255]), k == 29);
        }
        let (mut mean, mut variance) = ([0.0; 4], [0.0; 4]);
        learning.finish(0.5, &mut mean, &mut variance);
        assert!((mean[0] - 51.3).abs() < 0.6 && (mean[1] - 51.3).abs() < 0.8, "{mean:?}");
        assert_eq!(mean[2..], [0.0, 255.0]);
        assert!(variance.iter().all(|it| (0.25..3.0).contains(it)), "{variance:?}");
    }

    #[test]
    fn one_picture_is_enough() {
        let mut learning = Learning::new(1, 2);
        assert!(learning.add(&[7, 9]));
        let (mut mean, mut variance) = ([0.0; 2], [0.0; 2]);
        learning.finish(2.0, &mut mean, &mut variance);
        assert_eq!((mean, variance), ([7.0, 9.0], [36.0, 36.0]));
    }
}
