//! Counts of the tracker so far.

use foveate::estimation::consistency::Consistency;

use super::track::Termination;

/// Counts since the start.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tally {
    /// Targets initiated.
    pub initiations: u64,
    /// Those of them that got the identity of a lost one.
    pub regained: u64,
    /// Targets terminated because no camera saw them.
    pub terminated_unseen: u64,
    /// Targets terminated because only one camera saw them.
    pub terminated_single_view: u64,
    /// Targets terminated because they left the working volume.
    pub terminated_outside: u64,
    /// Targets terminated because too few cameras saw them after their initiation.
    pub terminated_unconfirmed: u64,
    /// Targets terminated because they tracked the light of an older one.
    pub terminated_duplicate: u64,
    /// Ambiguous frames for which several hypotheses were kept.
    pub ambiguities: u64,
    /// Features associated with a target.
    pub used: u64,
    /// Features associated with two targets at once.
    pub shared: u64,
    /// Features without a target when they came, including those of an initiation.
    pub unmatched: u64,
    /// Features without finite numbers, or with an invalid covariance.
    pub unusable: u64,
    /// Features in late or repeated frames that were discarded.
    pub late: u64,
    /// Normalised squared innovations of all observations.
    pub consistency: Consistency,
    /// By camera.
    pub cameras: Vec<CameraTally>,
}

/// Counts of one camera's frames.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraTally {
    /// Applied, late ones among them.
    pub applied: u64,
    /// Captured before the filter's time and applied nevertheless.
    pub applied_late: u64,
    /// Discarded because captured too long before the filter's time.
    pub late: u64,
    /// Discarded because not newer than the one before.
    pub repeated: u64,
    /// Normalised squared innovations.
    pub consistency: Consistency,
}

impl Tally {
    /// Frames that were applied.
    pub fn frames(&self) -> u64 {
        self.cameras.iter().map(|it| it.applied).sum()
    }

    pub(super) fn count(&mut self, reason: Termination) {
        *match reason {
            Termination::Unseen => &mut self.terminated_unseen,
            Termination::SingleView => &mut self.terminated_single_view,
            Termination::Outside => &mut self.terminated_outside,
            Termination::Unconfirmed => &mut self.terminated_unconfirmed,
            Termination::Duplicate => &mut self.terminated_duplicate,
        } += 1;
    }
}
