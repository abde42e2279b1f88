//! Orients cameras by lights that look alike, and measures how well both matchings of a frame fit the epipolar lines.

use foveate_estimation::Random;
use foveate_geometry::epipolar::{EpipolarOptions, relative_pose};
use nalgebra::{Isometry3, Matrix3, Point2};

use super::{LabelError, Wand};
use crate::recording::{Recording, Spot};

/// Frames of a pair of cameras that are used to orient it.
const MOST_FRAMES: usize = 150;
/// Partners with which a camera is oriented.
const PARTNERS: usize = 5;
/// Part of all readings that must be right: half are if all labels are, and three of ten spots may be wrong.
const LEAST_RIGHT: f64 = 0.2;
/// A spot at the same place in this part of the camera frames is a lamp.
const LAMP_SHARE: f64 = 0.5;
/// Pictures from which on lamps are recognised.
const LAMP_LOOKS: usize = 20;
/// Lamps stay within this [px].
pub(super) const LAMP_PX: f64 = 3.0;

/// Two cameras whose pose to each other is known.
pub(super) struct Oriented {
    pub cameras: [usize; 2],
    essential: Matrix3<f64>,
    focal: f64,
    pub frames: usize,
    pub right: usize,
}

impl Wand<'_> {
    /// Orients each camera with those with which it shares most frames.
    pub(super) fn orient(&mut self) -> Result<(), LabelError> {
        let n = self.recording.cameras.len();
        let shared = |a: usize, b: usize| -> Vec<usize> {
            let both = |it: &usize| self.both(*it, a).is_some() && self.both(*it, b).is_some();
            (0..self.frames.len()).filter(both).collect()
        };
        let mut common: Vec<([usize; 2], Vec<usize>)> = Vec::new();
        for a in 0..n {
            common.extend((a + 1..n).map(|b| ([a, b], shared(a, b))));
        }
        common.sort_by_key(|it| std::cmp::Reverse(it.1.len()));
        let mut partners = vec![0; n];
        let mut oriented = Vec::new();
        for (cameras, frames) in &common {
            let wanted = cameras.iter().any(|it| partners[*it] < PARTNERS);
            if wanted
                && frames.len() >= self.options.min_frames.max(3)
                && let Some(found) = self.orient_pair(*cameras, frames)
            {
                cameras.iter().for_each(|it| partners[*it] += 1);
                oriented.push(found);
            }
        }
        if oriented.is_empty() {
            let (best, frames) = common.first().map_or(([0, 0], 0), |it| (it.0, it.1.len()));
            return Err(LabelError::NothingOriented { best, frames, needed: self.options.min_frames });
        }
        self.oriented = oriented;
        Ok(())
    }

    fn orient_pair(&self, cameras: [usize; 2], frames: &[usize]) -> Option<Oriented> {
        let every = frames.len().div_ceil(MOST_FRAMES);
        let mut pixels: [Vec<Point2<f64>>; 2] = Default::default();
        for frame in frames.iter().step_by(every) {
            let (a, b) = (self.both(*frame, cameras[0])?, self.both(*frame, cameras[1])?);
            for (of_a, of_b) in [(0, 0), (1, 1), (0, 1), (1, 0)] {
                pixels[0].push(a[of_a]);
                pixels[1].push(b[of_b]);
            }
        }
        let n = pixels[0].len();
        let EpipolarOptions { min_right, .. } = EpipolarOptions::default();
        let epipolar = EpipolarOptions {
            sigma_px: self.options.sigma_px,
            inlier_px: self.options.inlier_px,
            min_right: min_right.max((LEAST_RIGHT * n as f64) as usize),
            trials: 2000,
        };
        let [a, b] = cameras.map(|it| &self.recording.cameras[it].camera);
        let mut random = Random::new(self.options.seed).fork(&format!("wand {cameras:?}"));
        let found = relative_pose([a, b], [&pixels[0], &pixels[1]], &epipolar, &mut random).ok()?;
        let Isometry3 { rotation, translation } = found.b_from_a;
        let essential = translation.vector.cross_matrix() * rotation.to_rotation_matrix().into_inner();
        let focal = 0.5 * (a.intrinsics.focal[0] + b.intrinsics.focal[0]);
        let mut oriented = Oriented { cameras, essential, focal, frames: frames.len(), right: 0 };
        let limit = 2.0 * (self.options.inlier_px / self.options.sigma_px).powi(2);
        let fits = |it: &&usize| self.readings(&oriented, **it).is_some_and(|it| it[0].min(it[1]) < limit);
        oriented.right = frames.iter().filter(fits).count();
        Some(oriented)
    }

    /// Squared distance of two pixels from each other's epipolar lines (Sampson's), in standard deviations.
    pub(super) fn cost(&self, pair: &Oriented, [a, b]: [Point2<f64>; 2]) -> Option<f64> {
        let of = |camera: usize, it: &Point2<f64>| {
            self.recording.cameras[camera].camera.normalise(it).map(|it| it.push(1.0))
        };
        let (in_a, in_b) = (of(pair.cameras[0], &a)?, of(pair.cameras[1], &b)?);
        let (line_b, line_a) = (pair.essential * in_a, pair.essential.tr_mul(&in_b));
        let slope = line_b.xy().norm_squared() + line_a.xy().norm_squared();
        let distance = in_b.dot(&line_b) / slope.sqrt() * pair.focal / self.options.sigma_px;
        // What is far off is off, however far.
        let most = 2.0 * self.options.inlier_px / self.options.sigma_px;
        Some((distance * distance).min(most * most))
    }

    /// Costs of reading a frame as it is, and with the ends of the second camera exchanged.
    pub(super) fn readings(&self, pair: &Oriented, frame: usize) -> Option<[f64; 2]> {
        let [a, b] = pair.cameras.map(|it| self.both(frame, it));
        let (a, b) = (a?, b?);
        let cost = |of_a: usize, of_b: usize| self.cost(pair, [a[of_a], b[of_b]]);
        Some([cost(0, 0)? + cost(1, 1)?, cost(0, 1)? + cost(1, 0)?])
    }
}

/// By node: the least member of its group, and whether it is exchanged against that one. Edges with the clearest gain are joined first;
/// a negative gain says that one of the two is exchanged.
pub(super) fn joined(n: usize, mut edges: Vec<([usize; 2], f64)>) -> (Vec<usize>, Vec<bool>) {
    edges.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let (mut group, mut exchanged): (Vec<usize>, Vec<bool>) = ((0..n).collect(), vec![false; n]);
    for ([a, b], gain) in edges {
        let [into, from] = [group[a].min(group[b]), group[a].max(group[b])];
        if into == from {
            continue;
        }
        let flip = exchanged[a] ^ exchanged[b] ^ (gain < 0.0);
        for node in 0..n {
            if group[node] == from {
                group[node] = into;
                exchanged[node] ^= flip;
            }
        }
    }
    (group, exchanged)
}

/// Places in the pictures of a camera that nearly always have a spot.
pub(super) fn lamps(recording: &Recording, camera: usize) -> Vec<Point2<f64>> {
    let camera_frames: Vec<&[Spot]> =
        recording.camera_frames.iter().filter(|it| it.camera == camera).map(|it| it.spots.as_slice()).collect();
    if camera_frames.len() < LAMP_LOOKS {
        return Vec::new();
    }
    let every = camera_frames.len().div_ceil(200);
    let sample: Vec<&&[Spot]> = camera_frames.iter().step_by(every).collect();
    let mut found: Vec<Point2<f64>> = Vec::new();
    for spot in sample.iter().take(sample.len() / 2 + 1).flat_map(|it| it.iter()) {
        let near = |it: &Spot| (it.pixel - spot.pixel).norm() <= LAMP_PX;
        let known = found.iter().any(|it| (it - spot.pixel).norm() <= LAMP_PX);
        if !known && sample.iter().filter(|it| it.iter().any(near)).count() as f64 > LAMP_SHARE * sample.len() as f64 {
            found.push(spot.pixel);
        }
    }
    found
}
