//! A recording of unsynchronised cameras, resampled to one clock.

use foveate_geometry::CameraStatus;

use super::unsynchronised::why_left_out;
use super::{SolvedNetwork, SynchronisedNetwork};
use crate::clocks::{ClockError, ClockStatus};
use crate::recording::Recording;
use crate::solved::ClockFit;

/// A recording resampled to common moments, and the clocks used for it.
#[derive(Debug, Clone, PartialEq)]
pub struct OneClock {
    /// In the room's time; cameras without a clock show nothing.
    pub recording: Recording,
    /// By camera: its clock relative to the reference; `None` where it is not determined.
    pub clocks: Vec<Option<ClockFit>>,
    /// By camera: the status of its clock.
    pub status: Vec<ClockStatus>,
    /// The camera whose clock is the room's.
    pub reference: usize,
}

impl OneClock {
    /// Adds the clocks to the network that was solved from [`OneClock::recording`]; cameras without a clock get the reason as status.
    pub fn of_room(&self, mut network: SolvedNetwork) -> SynchronisedNetwork {
        for (camera, (clock, status)) in network.solved.cameras.iter_mut().zip(self.clocks.iter().zip(&self.status)) {
            camera.clock = *clock;
            if clock.is_none() && camera.status != CameraStatus::Calibrated {
                camera.status = why_left_out(status);
            }
        }
        SynchronisedNetwork { network, clocks: self.status.clone(), reference: self.reference }
    }

    /// Itself, if two clocks are known, without which there is no room.
    pub(crate) fn if_several(self) -> Result<OneClock, ClockError> {
        if self.n_clocks() < 2 { Err(ClockError::NothingFound { status: self.status }) } else { Ok(self) }
    }

    /// How many clocks are known.
    pub(super) fn n_clocks(&self) -> usize {
        self.clocks.iter().flatten().count()
    }
}
