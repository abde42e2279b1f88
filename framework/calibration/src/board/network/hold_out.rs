//! Held-out observations that test the solution, and how well they are predicted.

use std::collections::{BTreeMap, BTreeSet};

use foveate_estimation::Loss;
use foveate_estimation::statistics::median;
use foveate_geometry::bundle::Freedom;
use nalgebra::{Isometry3, Vector2};

use super::super::groups::turned_place;
use super::super::rigid::{self, RigidOptions};
use super::super::types::HoldOut;
use super::Room;
use crate::solved::ObservationRole;

impl Room<'_> {
    /// Marks what is held out: frames that two cameras saw, or marks where there are too few of these.
    pub(super) fn keep_back(&mut self) {
        let every = self.options.hold_out_every;
        if every < 2 {
            return;
        }
        let shared: Vec<usize> =
            self.boards.keys().copied().filter(|it| *it != self.origin && self.seeing(*it) > 1).collect();
        let kept: Vec<usize> = shared.iter().copied().skip(every / 2).step_by(every).collect();
        let by_frames = shared.len() >= 10;
        for (camera_frame, roles) in self.camera_frames.iter().zip(&mut self.roles) {
            for (mark, role) in roles.iter_mut().enumerate().filter(|it| *it.1 == ObservationRole::Used) {
                let back = if by_frames {
                    kept.contains(&camera_frame.frame)
                } else {
                    camera_frame.ids.len() >= 8 && mark % every == every / 2
                };
                if back {
                    *role = ObservationRole::HeldOut;
                }
            }
        }
        self.hold_out = Some(HoldOut { median_px: f64::NAN, rms_px: f64::NAN, marks: 0, frames: by_frames });
    }

    /// Predicts what was held out: a frame's marks in one camera from the board as placed by the others, or marks from their neighbours.
    pub(super) fn test(&mut self) {
        let Some(HoldOut { frames, .. }) = self.hold_out else { return };
        let mut foretold: Vec<(usize, usize, Option<Vector2<f64>>)> = Vec::new();
        for at in 0..self.camera_frames.len() {
            let camera_frame = &self.camera_frames[at];
            let back: Vec<usize> =
                (0..camera_frame.ids.len()).filter(|it| self.roles[at][*it] == ObservationRole::HeldOut).collect();
            if back.is_empty() {
                continue;
            }
            let Some(world_from_board) =
                (if frames { self.of_others(at) } else { self.boards.get(&camera_frame.frame).copied() })
            else {
                continue;
            };
            let camera = &self.cameras[camera_frame.camera];
            let off = |mark: usize| {
                Some(
                    camera.project(&(world_from_board * turned_place(self.board, camera_frame, mark)))?
                        - camera_frame.pixels[mark],
                )
            };
            foretold.extend(back.into_iter().map(|mark| (at, mark, off(mark))));
        }
        if frames {
            self.place_held_out();
        }
        let mut lengths = Vec::new();
        for (at, mark, residual) in foretold {
            self.residuals[at][mark] = residual;
            lengths.extend(residual.map(|it| it.norm()));
        }
        let Some(median_px) = median(&lengths) else {
            self.hold_out = None;
            return;
        };
        let rms_px = (lengths.iter().map(|it| it * it).sum::<f64>() / lengths.len() as f64).sqrt();
        self.hold_out = Some(HoldOut { median_px, rms_px, marks: lengths.len(), frames });
    }

    /// The boards of the frames that were held out, from all that saw them.
    fn place_held_out(&mut self) {
        let back = |at: usize| self.roles[at].contains(&ObservationRole::HeldOut);
        let frames: BTreeSet<usize> =
            (0..self.camera_frames.len()).filter(|it| back(*it)).map(|it| self.camera_frames[it].frame).collect();
        let placed: Vec<_> =
            frames.into_iter().filter_map(|frame| Some((frame, self.board_of(frame, None)?))).collect();
        self.boards.extend(placed);
    }

    /// The board of a camera frame's frame, as all other cameras saw it.
    fn of_others(&self, at: usize) -> Option<Isometry3<f64>> {
        self.board_of(self.camera_frames[at].frame, Some(at))
    }

    /// The board of a frame, as the cameras are, without one of the camera frames.
    fn board_of(&self, frame: usize, without: Option<usize>) -> Option<Isometry3<f64>> {
        let start = *self.boards.get(&frame)?;
        let (seen, _) = self.seen(&BTreeMap::from([(frame, 0)]), |other, _| {
            Some(other) != without && self.placed[self.camera_frames[other].camera]
        });
        let how = RigidOptions { loss: Loss::CAUCHY, ..RigidOptions::default() };
        let found = rigid::adjust(&self.cameras, &vec![Freedom::NONE; self.cameras.len()], &[start], &seen, &how)?;
        found.world_from_board.first().copied()
    }
}
