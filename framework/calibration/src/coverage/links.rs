//! Which cameras saw the light together, in how many frames, and whether what they saw lies in a plane.

use foveate_estimation::Random;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::camera::CameraCoverage;

/// Pairs of pixels that are kept of two cameras, drawn from all with equal chance.
const KEPT: usize = 48;
/// Planes that are tried on them.
const TRIALS: u32 = 60;

/// Pixels of one moment in two cameras, without the lens.
type Sample = [[f32; 2]; 2];

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Links {
    /// Pair (a, b), a < b, is at b (b − 1)/2 + a.
    pairs: Vec<Pair>,
    draws: Random,
}

#[derive(Debug, Clone, PartialEq, Default)]
struct Pair {
    common: u32,
    /// Numbers of the last frames of either camera that were seen together.
    met: [u32; 2],
    samples: Vec<Sample>,
    offered: u32,
}

impl Links {
    pub(super) fn new(n_cameras: usize) -> Self {
        let n_pairs = n_cameras * n_cameras.saturating_sub(1) / 2;
        Self { pairs: vec![Pair::default(); n_pairs], draws: Random::new(1).fork("coverage") }
    }

    /// Counts the frame that `camera` just saw for all others that saw the same moment.
    pub(super) fn meet(&mut self, camera: usize, cameras: &[CameraCoverage], tolerance_s: f64) {
        let seen = &cameras[camera].last;
        for (other, theirs) in cameras.iter().map(|it| &it.last).enumerate() {
            let together = other != camera && theirs.number > 0 && (theirs.time_s - seen.time_s).abs() <= tolerance_s;
            if !together {
                continue;
            }
            let (a, b) = (camera.min(other), camera.max(other));
            let [in_a, in_b] = if a == camera { [seen, theirs] } else { [theirs, seen] };
            let pair = &mut self.pairs[place(a, b)];
            // Each frame meets one frame of the other camera at most.
            if pair.met[0] == in_a.number || pair.met[1] == in_b.number || !(in_a.moved || in_b.moved) {
                continue;
            }
            pair.met = [in_a.number, in_b.number];
            pair.common += 1;
            let Some(sample) = in_a.ideal.zip(in_b.ideal).map(|(a, b)| [a, b]) else { continue };
            pair.offered += 1;
            if pair.samples.len() < KEPT {
                pair.samples.reserve_exact(KEPT - pair.samples.len());
                pair.samples.push(sample);
            } else if let Some(kept) = pair.samples.get_mut(self.draws.below(pair.offered) as usize) {
                *kept = sample;
            }
        }
    }

    pub(super) fn common(&self, a: usize, b: usize) -> u32 {
        let pair = if a == b { None } else { self.pairs.get(place(a.min(b), a.max(b))) };
        pair.map_or(0, |it| it.common)
    }

    /// Part of the kept pairs of pixels that the best of some planes explains within `limit_px`; those that fix a plane not
    /// counted. 1 when there are too few to tell.
    pub(super) fn planar_share(&self, a: usize, b: usize, limit_px: f64) -> f64 {
        let samples = &self.pairs[place(a.min(b), a.max(b))].samples;
        let n = samples.len() as u32;
        if n < 8 {
            return 1.0;
        }
        let mut draws = Random::new(u64::from(n)).fork("planes");
        let mut most = 0;
        for _ in 0..TRIALS {
            let mut chosen = [0_usize; 4];
            for at in 0..4 {
                chosen[at] = loop {
                    let index = draws.below(n) as usize;
                    if !chosen[..at].contains(&index) {
                        break index;
                    }
                };
            }
            let near = |plane: &Matrix3<f64>| samples.iter().filter(|it| explains(plane, it, limit_px)).count();
            most = most.max(homography(chosen.map(|it| &samples[it])).map_or(0, |it| near(&it)));
        }
        most.saturating_sub(4) as f64 / f64::from(n - 4)
    }
}

fn place(a: usize, b: usize) -> usize {
    b * (b - 1) / 2 + a
}

/// Takes pixels of camera a to those of camera b (direct linear transform of four, the last element 1).
fn homography(samples: [&Sample; 4]) -> Option<Matrix3<f64>> {
    let mut rows = SMatrix::<f64, 8, 8>::zeros();
    let mut right = SVector::<f64, 8>::zeros();
    for (index, &[a, b]) in samples.into_iter().enumerate() {
        let [x, y] = a.map(f64::from);
        for (axis, seen) in b.map(f64::from).into_iter().enumerate() {
            let row = 2 * index + axis;
            for (column, value) in
                [(3 * axis, x), (3 * axis + 1, y), (3 * axis + 2, 1.0), (6, -x * seen), (7, -y * seen)]
            {
                rows[(row, column)] = value;
            }
            right[row] = seen;
        }
    }
    let solution = rows.lu().solve(&right)?;
    Some(Matrix3::from_row_slice(solution.push(1.0).as_slice()))
}

fn explains(plane: &Matrix3<f64>, [a, b]: &Sample, limit_px: f64) -> bool {
    let there = plane * Vector3::new(f64::from(a[0]), f64::from(a[1]), 1.0);
    let error = (there.x / there.z - f64::from(b[0])).hypot(there.y / there.z - f64::from(b[1]));
    error <= limit_px // false for NaN
}
