//! Measured lengths of the wand by frame, by pair of cameras and by place: a calibration can be wrong although pixels fit well, and
//! a wand length that depends on place shows it.

use foveate_estimation::statistics::{SIGMA_PER_MAD, mad, median, percentile};
use foveate_geometry::{CameraStatus, closest_approach};
use nalgebra::{Point3, Vector3};

use crate::solved::{ObservationRole, Solved};

/// Frames with both ends that are needed.
const LEAST_FRAMES: usize = 3;
/// Samples farther off than this many robust standard deviations are left out of mean and spread.
const FAR_OFF: f64 = 5.0;
/// Cells of the map along each axis.
const CELLS: usize = 3;
/// Least samples of a cell that is reported.
const LEAST_IN_CELL: usize = 4;

/// Lengths of the wand in a solved room, in its unit.
#[derive(Debug, Clone, PartialEq)]
pub struct WandLengths {
    /// By frame.
    pub samples: Vec<WandSample>,
    /// Of all samples.
    pub median: f64,
    /// Of all samples but those far off.
    pub mean: f64,
    /// Standard deviation over mean, samples far off left out [–].
    pub spread: f64,
    /// From the median absolute deviation, over the median [–].
    pub robust_spread: f64,
    /// How many samples are far off.
    pub far_off: usize,
    /// Relative standard deviation of the mean; neighbours in space are not counted as independent [–].
    pub sigma: f64,
    /// By pair of cameras that saw enough of it whole: lengths by these two alone.
    pub pairs: Vec<PairLengths>,
    /// By cell of the volume with enough samples.
    pub map: Vec<CellLength>,
}

/// The wand in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WandSample {
    /// Which frame.
    pub frame: usize,
    /// Midway between the ends.
    pub middle: Point3<f64>,
    /// Between the ends.
    pub length: f64,
}

/// Lengths by two cameras alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairLengths {
    /// Which two.
    pub cameras: [usize; 2],
    /// In how many frames.
    pub count: usize,
    /// Median of the lengths over that of all, less 1 [–].
    pub error: f64,
    /// From the median absolute deviation, over the median of all [–].
    pub spread: f64,
}

/// Lengths in a part of the volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellLength {
    /// Mean of its samples' middles.
    pub centre: Point3<f64>,
    /// How many samples.
    pub count: usize,
    /// Mean of the lengths over that of all, less 1 [–].
    pub error: f64,
    /// Standard deviation of `error`, if samples are independent [–].
    pub sigma: f64,
}

/// The wand was found in too few frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("both ends of the wand were found in {frames} frames, expected at least {needed}")]
pub struct TooFewFrames {
    /// Number of frames that was found.
    pub frames: usize,
    /// Number that is needed.
    pub needed: usize,
}

/// Measures the wand whose ends are the lights `ends`.
///
/// # Errors
/// See [`TooFewFrames`].
pub fn lengths(solved: &Solved, ends: [u32; 2]) -> Result<WandLengths, TooFewFrames> {
    let frames = frames(solved, ends);
    let place = |it: usize| solved.points[it].position;
    let samples: Vec<WandSample> = frames
        .iter()
        .map(|&(frame, [a, b])| WandSample {
            frame,
            middle: nalgebra::center(&place(a), &place(b)),
            length: (place(a) - place(b)).norm(),
        })
        .filter(|it| it.length.is_finite())
        .collect();
    if samples.len() < LEAST_FRAMES {
        return Err(TooFewFrames { frames: samples.len(), needed: LEAST_FRAMES });
    }
    let all: Vec<f64> = samples.iter().map(|it| it.length).collect();
    let middle = median(&all).unwrap_or(0.0);
    let robust = SIGMA_PER_MAD * mad(&all).unwrap_or(0.0);
    let near: Vec<&WandSample> =
        samples.iter().filter(|it| (it.length - middle).abs() <= FAR_OFF * robust + 1e-12 * middle).collect();
    let [mean, deviation] = moments(near.iter().map(|it| it.length));
    let map = map(&near, mean);
    let of_cells = moments(map.iter().map(|it| it.error))[1] / (map.len().max(1) as f64).sqrt();
    let of_samples = deviation / mean / (near.len() as f64).sqrt();
    Ok(WandLengths {
        median: middle,
        mean,
        spread: deviation / mean,
        robust_spread: robust / middle,
        far_off: samples.len() - near.len(),
        sigma: if map.len() > 2 { of_samples.max(of_cells) } else { of_samples },
        pairs: pairs(solved, &frames, middle),
        map,
        samples,
    })
}

/// Frames that have both ends, with their places in the list of points.
pub(super) fn frames(solved: &Solved, ends: [u32; 2]) -> Vec<(usize, [usize; 2])> {
    let mut found: Vec<(usize, [Option<usize>; 2])> = Vec::new();
    let mut order: Vec<usize> = (0..solved.points.len()).collect();
    order.sort_by_key(|it| solved.points[*it].frame);
    for index in order {
        let point = &solved.points[index];
        let Some(end) = ends.iter().position(|it| *it == point.label) else { continue };
        if found.last().is_none_or(|it| it.0 != point.frame) {
            found.push((point.frame, [None; 2]));
        }
        if let Some(last) = found.last_mut() {
            last.1[end] = Some(index);
        }
    }
    found.into_iter().filter_map(|(frame, [a, b])| Some((frame, [a?, b?]))).collect()
}

/// Mean and standard deviation.
fn moments(values: impl Iterator<Item = f64> + Clone) -> [f64; 2] {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    let squares: f64 = values.map(|it| (it - mean).powi(2)).sum();
    [mean, (squares / (n - 1.0).max(1.0)).sqrt()]
}

fn map(samples: &[&WandSample], mean: f64) -> Vec<CellLength> {
    let bounds = |axis: usize| {
        let along: Vec<f64> = samples.iter().map(|it| it.middle[axis]).collect();
        [percentile(&along, 2.0).unwrap_or(0.0), percentile(&along, 98.0).unwrap_or(0.0)]
    };
    let bounds = [bounds(0), bounds(1), bounds(2)];
    let cell_of = |it: &WandSample| {
        (0..3).fold(0, |number, axis| {
            let [low, high] = bounds[axis];
            let share = if high > low { (it.middle[axis] - low) / (high - low) } else { 0.0 };
            number * CELLS + ((share * CELLS as f64).clamp(0.0, CELLS as f64 - 1.0) as usize)
        })
    };
    let mut cells: Vec<Vec<&WandSample>> = vec![Vec::new(); CELLS.pow(3)];
    samples.iter().for_each(|it| cells[cell_of(it)].push(it));
    let told = cells.iter().filter(|it| it.len() >= LEAST_IN_CELL);
    told.map(|cell| {
        let [of_cell, deviation] = moments(cell.iter().map(|it| it.length));
        let n = cell.len() as f64;
        CellLength {
            centre: Point3::from(cell.iter().fold(Vector3::zeros(), |sum, it| sum + it.middle.coords / n)),
            count: cell.len(),
            error: of_cell / mean - 1.0,
            sigma: deviation / mean / n.sqrt(),
        }
    })
    .collect()
}

fn pairs(solved: &Solved, frames: &[(usize, [usize; 2])], middle: f64) -> Vec<PairLengths> {
    let mut of_point: Vec<Vec<usize>> = vec![Vec::new(); solved.points.len()];
    for (index, observation) in solved.observations.iter().enumerate() {
        let seen = matches!(observation.role, ObservationRole::Used | ObservationRole::HeldOut);
        let calibrated = solved.cameras.get(observation.camera).is_some_and(|it| it.status == CameraStatus::Calibrated);
        if let Some(list) = observation.point.and_then(|it| of_point.get_mut(it)).filter(|_| seen && calibrated) {
            list.push(index);
        }
    }
    let n = solved.cameras.len();
    let mut lengths: Vec<Vec<f64>> = vec![Vec::new(); n * n];
    for (_, [a, b]) in frames {
        // Rays of the cameras that see both ends.
        let ray = |it: usize| {
            let observation = &solved.observations[it];
            Some((observation.camera, solved.cameras[observation.camera].camera.ray(&observation.pixel)?))
        };
        let whole: Vec<_> = of_point[*a]
            .iter()
            .filter_map(|first| {
                let camera = solved.observations[*first].camera;
                let second = of_point[*b].iter().find(|it| solved.observations[**it].camera == camera)?;
                Some((ray(*first)?, ray(*second)?.1))
            })
            .collect();
        for (index, ((high, high_a), high_b)) in whole.iter().enumerate() {
            for ((low, low_a), low_b) in &whole[..index] {
                let places = closest_approach(low_a, high_a).zip(closest_approach(low_b, high_b));
                let [first, second] = [*low.min(high), *low.max(high)];
                if let Some((a, b)) = places.filter(|_| first != second) {
                    lengths[first * n + second].push((a.midpoint - b.midpoint).norm());
                }
            }
        }
    }
    let enough = lengths.iter().enumerate().filter(|it| it.1.len() >= LEAST_FRAMES);
    enough
        .map(|(index, lengths)| PairLengths {
            cameras: [index / n, index % n],
            count: lengths.len(),
            error: median(lengths).unwrap_or(f64::NAN) / middle - 1.0,
            spread: SIGMA_PER_MAD * mad(lengths).unwrap_or(f64::NAN) / middle,
        })
        .collect()
}
