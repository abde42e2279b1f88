//! What the tracker has seen and done so far.

use foveate::estimation::consistency::Consistency;

use super::track::Death;

/// Counts since the start.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tally {
    /// Targets that began.
    pub initiations: u64,
    /// Those among them that took up the identity of a lost one again.
    pub regained: u64,
    /// Targets lost since no camera saw them.
    pub deaths_unseen: u64,
    /// Targets lost since one camera only saw them.
    pub deaths_single_view: u64,
    /// Targets lost since they left the working volume.
    pub deaths_outside: u64,
    /// Targets taken back since too few cameras saw them after their initiation.
    pub deaths_unconfirmed: u64,
    /// Targets taken back since they followed the light of an older one.
    pub deaths_duplicate: u64,
    /// Times that one frame could not tell which feature belonged to which target, and several answers were kept.
    pub ambiguities: u64,
    /// Features that belonged to a target.
    pub used: u64,
    /// Features that were taken for two targets at once.
    pub shared: u64,
    /// Features that belonged to none when they came; those of an initiation are among them.
    pub unmatched: u64,
    /// Features without finite numbers, or with a covariance that is none.
    pub unusable: u64,
    /// Features in late or repeated frames that were discarded.
    pub late: u64,
    /// Normalised squared innovations of all observations.
    pub consistency: Consistency,
    /// By camera.
    pub cameras: Vec<CameraTally>,
}

/// What became of one camera's frames.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraTally {
    /// Applied, late ones among them.
    pub applied: u64,
    /// Captured before the filter's time and applied nevertheless.
    pub applied_late: u64,
    /// Discarded since captured too long before the filter's time.
    pub late: u64,
    /// Discarded since not newer than the one before.
    pub repeated: u64,
    /// Normalised squared innovations.
    pub consistency: Consistency,
}

impl Tally {
    /// Frames that were applied.
    pub fn frames(&self) -> u64 {
        self.cameras.iter().map(|it| it.applied).sum()
    }

    pub(super) fn count(&mut self, death: Death) {
        *match death {
            Death::Unseen => &mut self.deaths_unseen,
            Death::SingleView => &mut self.deaths_single_view,
            Death::Outside => &mut self.deaths_outside,
            Death::Unconfirmed => &mut self.deaths_unconfirmed,
            Death::Duplicate => &mut self.deaths_duplicate,
        } += 1;
    }
}
