//! Whether a board has the stated proportions: printers stretch paper in one direction.
//!
//! A board that is larger than stated makes the whole room larger. One that is longer one way alone fits no pose where it is turned in the picture; where it is always held the same way, pixels that are not
//! square explain it as well. So all is adjusted once more with pixels of the shape that was given and rows that are longer by a factor: that of the least cost is the board's, if it
//! explains what was seen clearly better than rows as they are said to be, and no worse than pixels of any shape.

use std::collections::BTreeMap;

use foveate_estimation::Loss;
use foveate_geometry::Camera;
use foveate_geometry::bundle::Freedom;
use nalgebra::{Isometry3, Point3};

use super::super::rigid::{self, Rigid, RigidOptions, Seen};
use super::super::types::Stretch;
use super::Room;
use crate::solved::ObservationRole;

/// Frames that tell it: more of the same hardly tell more.
const FRAMES: usize = 60;
/// Steps from which the least cost is estimated [–].
const STEP: f64 = 0.004;
/// Re-estimation rounds, each from the last estimate, and how far from there at most [–].
const ROUNDS: usize = 6;
const FARTHEST: f64 = 0.01;
/// What is less is no matter: paper swells by as much [–].
const LEAST: f64 = 0.003;
/// It is certain by so many standard deviations.
const SIGMAS: f64 = 5.0;
/// With it the marks lie at most so many times as far off as without, pixels having the shape that was given: what errs alike over a whole board, as lenses do, makes smaller differences certain …
const BETTER: f64 = 0.95;
/// … and as with pixels of any shape that the options request.
const NO_WORSE: f64 = 1.03;

impl Room<'_> {
    /// How much longer rows of the board are than they are said to be beside its columns, where that is so; `guesses` have the pixels' shapes.
    pub(super) fn stretch(&self, guesses: &[&Camera]) -> Option<Stretch> {
        let n = self.boards.len().div_ceil(FRAMES).max(1);
        // That which holds the world stays.
        let is_taken = |(at, frame): &(usize, &usize)| at.is_multiple_of(n) || **frame == self.origin;
        let frames: Vec<usize> = self.boards.keys().enumerate().filter(is_taken).map(|it| *it.1).collect();
        let order: BTreeMap<usize, usize> = frames.iter().enumerate().map(|(at, frame)| (*frame, at)).collect();
        let boards: Vec<Isometry3<f64>> = frames.iter().map(|it| self.boards[it]).collect();
        let (seen, _) = self.seen(&order, |at, mark| self.roles[at][mark] == ObservationRole::Used);
        let options =
            RigidOptions { loss: Loss::HUBER, held_board: order.get(&self.origin).copied(), ..RigidOptions::default() };
        let before = rigid::adjust(&self.cameras, &self.freedoms, &boards, &seen, &options)?;
        let square = |it: (&Camera, &&Camera)| {
            let (mut camera, [x, y]) = (it.0.clone(), it.1.intrinsics.focal);
            let focal = &mut camera.intrinsics.focal;
            focal[1] = focal[0] * y / x;
            camera
        };
        let cameras: Vec<Camera> = self.cameras.iter().zip(guesses).map(square).collect();
        let freedoms: Vec<Freedom> = self.freedoms.iter().map(|it| Freedom { aspect: false, ..*it }).collect();
        let adjusted = |by: f64| {
            let longer = |it: &Point3<f64>| Point3::new(it.x * (1.0 + by), it.y, it.z);
            let seen: Vec<Seen> = seen.iter().map(|it| Seen { place: longer(&it.place), ..*it }).collect();
            rigid::adjust(&cameras, &freedoms, &boards, &seen, &options)
        };
        let (mut by, mut sigma) = (0.0, f64::INFINITY);
        for _ in 0..ROUNDS {
            let [less, here, more] = [by - STEP, by, by + STEP].map(|it| adjusted(it).map(|it| it.cost));
            let (less, here, more) = (less?, here?, more?);
            let curvature = (more + less - 2.0 * here) / STEP.powi(2);
            let slope = (more - less) / (2.0 * STEP);
            // Far from it what contradicts counts less, and the cost is no parabola.
            let step = if curvature > 0.0 { -slope / curvature } else { -slope.signum() * FARTHEST };
            by += step.clamp(-FARTHEST, FARTHEST);
            sigma = curvature.max(0.0).sqrt().recip();
            if step.abs() < LEAST / 3.0 {
                break;
            }
        }
        if by.abs() < LEAST.max(SIGMAS * sigma) {
            return None;
        }
        let rms_px = [rms(&adjusted(0.0)?), rms(&adjusted(by)?)];
        let is_better = rms_px[1] <= BETTER * rms_px[0] && rms_px[1] <= NO_WORSE * rms(&before);
        is_better.then_some(Stretch { by, rms_px })
    }
}

/// Root mean square distance of marks from where they were seen [px].
fn rms(of: &Rigid) -> f64 {
    let (squares, n) =
        of.residuals.iter().flatten().fold((0.0, 0.0), |(sum, n), it| (sum + it.norm_squared(), n + 1.0));
    (squares / f64::max(n, 1.0)).sqrt()
}
