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

#[cfg(test)]
mod tests {
    use super::*;

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
