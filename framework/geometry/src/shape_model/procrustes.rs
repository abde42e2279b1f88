//! Generalised Procrustes analysis: frames of marks aligned in one space that moves with the head, by the marks that keep their distances.
//!
//! J. C. Gower, "Generalized Procrustes analysis", Psychometrika 40, 1975, with each mark weighted by how little it
//! moves in the space found so far: forehead and nose dominate, the lips do not.

use nalgebra::{Isometry3, Point3, Translation3, Vector3};

use crate::alignment::weighted;
use foveate_estimation::statistics::median;

const ROUNDS: usize = 40;
/// The rounds end when no mean place has moved by this part of the size of the shape.
const SETTLED: f64 = 1e-9;
/// No mark is taken to move less than this part of the median over the marks: else a few neighbours alone would decide.
const STIFFEST: f64 = 0.5;

/// Frames in one space.
pub(super) struct Aligned {
    /// The usable ones, each mark that was seen.
    pub(super) frames: Vec<Vec<Option<Point3<f64>>>>,
    pub(super) mean: Vec<Point3<f64>>,
    /// Standard deviation about the mean, one axis [m].
    pub(super) spreads: Vec<f64>,
}

/// Aligns `frames` of as many marks each; the axes are those of the most complete frame, the origin is in the middle of the mean places. `None` when no frame
/// fixes a pose, or a mark is in none that does.
pub(super) fn align_frames(frames: &[Vec<Option<Point3<f64>>>], noise: f64) -> Option<Aligned> {
    let n_seen = |frame: &[Option<Point3<f64>>]| frame.iter().flatten().count();
    let start = (0..frames.len()).rev().max_by_key(|&it| n_seen(&frames[it]))?;
    let n = frames[start].len();
    let mut mean = frames[start].clone();
    let mut spreads = vec![1.0; n];
    let mut poses: Vec<Option<Isometry3<f64>>> = vec![None; frames.len()];
    for _ in 0..ROUNDS {
        for (pose, frame) in poses.iter_mut().zip(frames) {
            *pose = pose_of(frame, &mean, &spreads);
        }
        let mut next: Vec<Option<Point3<f64>>> = vec![None; n];
        let mut moved = 0.0_f64;
        for mark in 0..n {
            let seen = || {
                poses
                    .iter()
                    .zip(frames)
                    .filter_map(|(pose, frame)| Some((pose.as_ref()? * frame[mark].as_ref()?).coords))
            };
            let count = seen().count();
            if count == 0 {
                continue;
            }
            let middle: Vector3<f64> = seen().sum::<Vector3<f64>>() / count as f64;
            let squares: f64 = seen().map(|it| (it - middle).norm_squared()).sum();
            spreads[mark] = (squares / (3.0 * count as f64)).sqrt();
            moved = mean[mark].map_or(f64::INFINITY, |before| (before.coords - middle).norm()).max(moved);
            next[mark] = Some(Point3::from(middle));
        }
        let least = (STIFFEST * median(&spreads)?).max(noise).max(f64::MIN_POSITIVE);
        spreads.iter_mut().for_each(|it| *it = it.max(least));
        mean = next;
        let size = mean.iter().flatten().map(|it| it.coords.norm()).fold(0.0, f64::max);
        if moved <= SETTLED * size {
            break;
        }
    }
    let mean: Vec<Point3<f64>> = mean.into_iter().collect::<Option<_>>()?;
    // Back to the axes of the frame begun with.
    let middle: Vector3<f64> = mean.iter().map(|it| it.coords).sum::<Vector3<f64>>() / n as f64;
    let turned = Isometry3::from_parts(Translation3::identity(), poses[start]?.rotation.inverse())
        * Isometry3::translation(-middle.x, -middle.y, -middle.z);
    let placed = |(pose, frame): (&Option<Isometry3<f64>>, &Vec<Option<Point3<f64>>>)| {
        let pose = turned * (*pose)?;
        Some(frame.iter().map(|it| it.map(|it| pose * it)).collect())
    };
    Some(Aligned {
        frames: poses.iter().zip(frames).filter_map(placed).collect(),
        mean: mean.iter().map(|it| turned * it).collect(),
        spreads,
    })
}

/// Takes the frame to the mean, by the marks that both have.
fn pose_of(frame: &[Option<Point3<f64>>], mean: &[Option<Point3<f64>>], spreads: &[f64]) -> Option<Isometry3<f64>> {
    let (mut from, mut to, mut weights) = (Vec::new(), Vec::new(), Vec::new());
    for ((mark, place), spread) in frame.iter().zip(mean).zip(spreads) {
        if let (Some(mark), Some(place)) = (mark, place) {
            from.push(*mark);
            to.push(*place);
            weights.push(1.0 / (spread * spread));
        }
    }
    if from.len() < 3 {
        return None;
    }
    Some(weighted(&from, &to, &weights, false).ok()?.isometry)
}
