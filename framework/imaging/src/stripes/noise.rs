//! How noisy a picture is, from the picture alone.
//!
//! A mask that leaves out whatever is a plane, and edges along rows and columns, sees little but noise [Immerkær 1996]: with noise of σ on each pixel its answer has 6 σ. The
//! median of what it answers is not moved by edges that fill less than half of the picture.
//!
//! Source: J. Immerkær, "Fast noise variance estimation", CVIU 64(2), 1996; the median in place of his mean.

use crate::ImageView;

/// Pixels that are looked at.
const SAMPLES: usize = 40_000;
/// Median of |x| over standard deviation for normal x.
const MEDIAN: f64 = 0.6745;
/// Gray levels beyond which a pixel may be cut off.
const RANGE: std::ops::RangeInclusive<u8> = 2..=252;

/// Standard deviation of a pixel's noise, at least what rounding makes of none [gray levels]; pixels that are saturated or black do not count, and a picture of
/// such alone has noise of rounding only.
pub fn noise(picture: &ImageView<'_>) -> f64 {
    let (width, height) = picture.size();
    let pixels = picture.pixels();
    let rounding = (1.0_f64 / 12.0).sqrt();
    if width < 3 || height < 3 {
        return rounding;
    }
    let step = ((width - 2) * (height - 2)).div_ceil(SAMPLES).max(1);
    let mut answers = vec![0_usize; 2041];
    let mut n = 0;
    for index in (0..(width - 2) * (height - 2)).step_by(step) {
        let corner = index / (width - 2) * width + index % (width - 2);
        let rows = [0, 1, 2].map(|it| &pixels[corner + it * width..][..3]);
        if !rows.iter().all(|row| row.iter().all(|it| RANGE.contains(it))) {
            continue;
        }
        let row = |it: usize| i32::from(rows[it][0]) - 2 * i32::from(rows[it][1]) + i32::from(rows[it][2]);
        let answer = row(0) - 2 * row(1) + row(2);
        answers[answer.unsigned_abs() as usize] += 1;
        n += 1;
    }
    let mut below = 0;
    let median = answers.iter().position(|it| {
        below += it;
        2 * below >= n
    });
    // Whole numbers: half of those that are the median lie below it.
    let middle = median.unwrap_or(0) as f64;
    if n == 0 { rounding } else { (middle / (6.0 * MEDIAN)).max(rounding) }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    #[test]
    fn noise_is_found_under_stripes_and_shades() {
        for sigma in [1.0, 3.0, 8.0] {
            for period in [7, 16, 80] {
                let mut chance = Random::new(period);
                let pixel = |at: usize| {
                    let (x, y) = (at % 200, at / 200);
                    let stripe = if (x / period as usize).is_multiple_of(2) { 60.0 } else { 150.0 };
                    stripe + 0.2 * y as f64 + sigma * chance.normal()
                };
                let pixels: Vec<u8> = (0..200 * 150).map(pixel).map(|it| it.round().clamp(0.0, 255.0) as u8).collect();
                let found = noise(&ImageView::new(&pixels, 200, 150).unwrap());
                assert!((found / sigma - 1.0).abs() < 0.15, "{found} for {sigma}, period {period}");
            }
        }
        assert!(noise(&ImageView::new(&[255; 100], 10, 10).unwrap()) < 0.3);
    }
}
