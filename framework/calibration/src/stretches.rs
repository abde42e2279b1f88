//! A recording cut into stretches of time, each long enough to err by itself.

/// More tell little more; each should outlast what neighbouring pictures have in common, which is some tenths of a second.
const MOST: usize = 24;
/// Frames of a stretch at least.
const LEAST_FRAMES: usize = 2;

/// By point: its stretch, counted from 0. `frames`: by point, the number of its frame, which grows with time.
pub(crate) fn stretches(frames: &[usize]) -> Vec<usize> {
    let mut distinct = frames.to_vec();
    distinct.sort_unstable();
    distinct.dedup();
    let n = (distinct.len() / LEAST_FRAMES).clamp(1, MOST);
    let stretch = |frame: &usize| distinct.partition_point(|it| it < frame) * n / distinct.len().max(1);
    frames.iter().map(stretch).collect()
}

/// Blocks of time by which gains are compared, and numbers in each at least [–].
const BLOCKS: usize = 10;
const LEAST_OF_BLOCK: usize = 8;

/// By how many standard errors the mean of `gains`, which are in the order of time, is above 0, if those of one block of time err together; 0 for too
/// few of them. What is so all the time gains all the time; what happens to gain does so here and there.
pub(crate) fn steadiness(gains: &[f64]) -> f64 {
    let n = (gains.len() / LEAST_OF_BLOCK).min(BLOCKS);
    if n < 3 {
        return 0.0;
    }
    let mean = |block: usize| {
        let part = &gains[block * gains.len() / n..(block + 1) * gains.len() / n];
        part.iter().sum::<f64>() / part.len() as f64
    };
    let means: Vec<f64> = (0..n).map(mean).collect();
    let all = means.iter().sum::<f64>() / n as f64;
    let variance = means.iter().map(|it| (it - all).powi(2)).sum::<f64>() / (n - 1) as f64;
    let error = (variance / n as f64).sqrt();
    if error > 0.0 { all / error } else { all.signum() * 1e6 * all.abs().min(1.0) }
}

/// Standard errors that a gain over so many numbers must be above 0, beside 1.5 at the least: a short recording needs more evidence.
pub(crate) fn steady_enough(n: usize) -> f64 {
    (4.0 * (100.0 / n.max(1) as f64).sqrt()).clamp(1.5, 4.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_of_all_times_are_steady_and_those_of_one_moment_are_not() {
        let noise = |it: usize| 0.3 * (it as f64 * 12.9898).sin();
        let steady: Vec<f64> = (0..200).map(|it| 1.0 + noise(it)).collect();
        let once: Vec<f64> = (0..200).map(|it| if (90..105).contains(&it) { 40.0 } else { noise(it) }).collect();
        assert!(steadiness(&steady) > 10.0 && steadiness(&once) < 2.0, "{} {}", steadiness(&steady), steadiness(&once));
        assert_eq!(steadiness(&steady[..20]), 0.0);
        assert_eq!(steadiness(&[0.0; 100]), 0.0);
    }

    #[test]
    fn stretches_are_alike_in_frames_and_keep_the_ends_of_a_wand_together() {
        let frames: Vec<usize> = (0..200).map(|it| 7 * (it / 2)).collect();
        let found = stretches(&frames);
        assert_eq!((found[0], found[199]), (0, MOST - 1));
        assert!(found.chunks(2).all(|it| it[0] == it[1]) && found.windows(2).all(|it| it[0] <= it[1]));
        let counts: Vec<usize> = (0..MOST).map(|it| found.iter().filter(|other| **other == it).count()).collect();
        assert!(counts.iter().all(|it| (8..=10).contains(it)), "{counts:?}");
        assert_eq!(stretches(&[3, 3, 5]), [0, 0, 0]);
        assert_eq!(stretches(&[]), [0; 0]);
    }
}
