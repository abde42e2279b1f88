//! Lights that touch something else that is lit: another light, or skin that is brighter than what was learnt behind it.
//!
//! With its threshold raised by a part of its own brightness, a group of lit pixels falls into what is bright in it. Two lights are separated by the dip between
//! them. A light on lit skin is recognised by its centre: that of a light by itself hardly moves as the threshold rises, that of a light with a patch at its side does.

use super::component::{Component, Frame, Run, Shape};
use super::{Measure, Spot};

/// Eighths of the brightest excess by which thresholds are raised; of those that show as many lights the first counts.
const EIGHTHS: [u32; 4] = [4, 2, 6, 1];
/// The level at which a light by itself is compared with all that is lit about it.
const HALF: u32 = 4;
/// A light stands out of what connects it with others by this [gray level].
const LEAST_DIP: u8 = 20;
/// Fewer lit pixels are no two things [px²].
const LEAST_AREA: u64 = 8;
/// A light's upper half lies no farther than this from the centre of the whole: comatic and smeared ones by up to 0.3 px along a row [px].
const STAYS_PX: f64 = 0.5;
/// Error of a light that was parted from something, one axis, standard deviation: what it touches shines into it. Rendered pairs and lights on patches
/// are 0.05 to 0.3 px off (`tests/joined_spots.rs`) [px].
const PARTED_PX: f64 = 0.2;

/// Parts one group after the other; keeps its buffers.
#[derive(Default)]
pub(crate) struct Parts {
    upper: Component,
    /// What is bright at one level, and at the best one so far.
    level: Vec<(Shape, Spot)>,
    best: Vec<(Shape, Spot)>,
}

impl Parts {
    /// The lights in the group of pixels `runs`, whose shape is `whole` and which as one is `spot`; empty where it is one light by itself.
    pub fn of(&mut self, frame: &Frame, runs: &[Run], whole: &Shape, spot: &Spot, how: &Measure) -> &[(Shape, Spot)] {
        self.best.clear();
        let excess = brightest(frame, runs);
        if whole.area < LEAST_AREA || excess < 2 * LEAST_DIP {
            return &self.best;
        }
        for eighths in EIGHTHS {
            let raised = (u32::from(excess) * eighths / 8) as u8;
            self.find(&Frame { raised, ..*frame }, runs, how);
            let is_apart = |it: &(Shape, Spot)| (it.1.centre - spot.centre).norm() > STAYS_PX;
            let counts = self.level.len() > 1 || eighths == HALF && self.level.iter().any(is_apart);
            if counts && self.level.len() > self.best.len() {
                std::mem::swap(&mut self.level, &mut self.best);
            }
        }
        &self.best
    }

    /// Fills `level` with what is bright in `runs` by the raised thresholds of `frame`.
    fn find(&mut self, frame: &Frame, runs: &[Run], how: &Measure) {
        self.level.clear();
        self.upper.begin(frame.pixels.len(), frame.width);
        for run in runs {
            for x in run.x0..run.x1 {
                let index = run.y * frame.width + x;
                if !frame.lit(index) || self.upper.taken(index) {
                    continue;
                }
                let shape = self.upper.take(frame, x, run.y);
                if brightest(frame, self.upper.last_runs()) < LEAST_DIP {
                    continue;
                }
                let mut spot = self.upper.measure(frame, &shape, how);
                for axis in 0..2 {
                    spot.covariance[(axis, axis)] += PARTED_PX * PARTED_PX;
                }
                self.level.push((shape, spot));
            }
        }
    }
}

/// By how much the brightest pixel of `runs` exceeds its threshold [gray level].
fn brightest(frame: &Frame, runs: &[Run]) -> u8 {
    let pixels = runs.iter().flat_map(|run| run.y * frame.width + run.x0..run.y * frame.width + run.x1);
    pixels.map(|it| frame.excess(it)).max().unwrap_or(0)
}
