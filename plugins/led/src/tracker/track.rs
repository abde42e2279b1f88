//! One target in the tracker: filter, identity, and observations by cameras.

use foveate::estimation::motion::{AdaptiveNoise, Filter};
use foveate::messages::{CameraId, CameraSet, Interval, Provenance, Target, TargetId, Time};

use super::association::View;
use super::history::History;
use super::memory::{Lost, Neighbours, Wander};

/// One live target.
#[derive(Debug, Clone)]
pub(super) struct Track {
    pub id: TargetId,
    pub filter: Filter,
    /// Adaptation of its model's noise; `None` where that is fixed.
    pub noise: Option<AdaptiveNoise>,
    /// Time of its last observation by any camera.
    pub seen_at: Time,
    /// The camera of that observation.
    last_camera: CameraId,
    /// Time of its last observation by another camera.
    other_at: Time,
    /// The cameras that saw it at `seen_at`.
    pub cameras: CameraSet,
    /// An older target at the same place, and since when.
    pub beside: Option<(TargetId, Time)>,
    /// It has been at the same place for too long: it tracks the light of the older one.
    pub is_twin: bool,
    /// While it is being confirmed.
    confirmation: Option<Confirmation>,
    /// Not sent yet: few of the cameras with its place in view agreed at its initiation.
    pub is_tentative: bool,
    /// Consecutive frames with its place in view that did not see it.
    misses: u32,
    /// Part of the frames with its place in view that see it: usual and recent [–].
    share: f64,
    share_of_late: f64,
    /// Recent updates of the filter; empty without out-of-sequence updates.
    pub history: History,
    /// Distances to its neighbours.
    pub neighbours: Neighbours,
    /// Its deviation from constant velocity.
    pub wander: Wander,
    /// The lost target whose identity it got, until its confirmation is over.
    pub regained: Option<Box<Lost>>,
}

/// Confirmation of a new target by the cameras.
#[derive(Debug, Clone, Copy)]
struct Confirmation {
    ends: Time,
    /// Frames with its place in view.
    looks: u32,
    /// Those among them that saw it.
    hits: u32,
}

impl Confirmation {
    /// Part of the frames that saw it; all of none.
    fn share(&self) -> f64 {
        if self.looks == 0 { 1.0 } else { f64::from(self.hits) / f64::from(self.looks) }
    }
}

/// Observations after which a tentative target may be sent.
const HITS_TO_SHOW: u32 = 3;

/// A target that was seen in the newest frame takes a feature if its gate holds fewer false ones than this, on average.
const MOST_CLUTTER: f64 = 0.3;

/// Limit for a target that was missed for long.
const LEAST_CLUTTER: f64 = 0.0005;

/// A target unseen for this long may be elsewhere.
const UNSEEN: Interval = Interval(50_000_000);

/// Weight of the newest frame in the usual and the recent detection rate.
const USUAL_WEIGHT: f64 = 0.02;
const LATE_WEIGHT: f64 = 0.15;
/// Largest assumed detection rate.
const MOST_SHARE: f64 = 0.95;
/// A target whose recent detection rate is below this part of its usual rate is off its predicted place, unless it is occluded.
const ASTRAY: f64 = 0.6;
/// Number of consecutive misses whose probability is 1 in 100: −ln of the probability.
const SURPRISING: f64 = 4.6;
/// Largest factor on the noise of a motion model due to misses.
const MOST_FOR_MISSES: f64 = 100.0;

/// Why a target was terminated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Termination {
    /// No camera saw it for too long.
    Unseen,
    /// Only one camera saw it for too long.
    SingleView,
    /// It has left the working volume, or its filter has diverged.
    Outside,
    /// Too few of the cameras with its place in view saw it after its initiation: lines had met by accident.
    Unconfirmed,
    /// It tracked the light of an older target.
    Duplicate,
}

impl Track {
    /// A target first seen at `time`, by several cameras, which is confirmed over `confirmation`.
    pub fn new(id: TargetId, filter: Filter, time: Time, camera: CameraId, confirmation: Interval) -> Self {
        let confirmation = Some(Confirmation { ends: time + confirmation, looks: 0, hits: 0 });
        let cameras = std::iter::once(camera).collect();
        Self {
            id,
            filter,
            noise: None,
            seen_at: time,
            last_camera: camera,
            other_at: time,
            cameras,
            beside: None,
            is_twin: false,
            confirmation,
            is_tentative: false,
            misses: 0,
            share: 0.5,
            share_of_late: 0.5,
            history: History::default(),
            neighbours: Neighbours::new(),
            wander: Wander::default(),
            regained: None,
        }
    }

    /// Factor on the noise of its motion model. A light that turns harder than its filter expects leaves the gate in all cameras at once, and the
    /// features that would show the turn are not associated: consecutive misses beyond chance are used instead.
    pub fn noise_scale(&self) -> f64 {
        let adapted = self.noise.as_ref().map_or(1.0, AdaptiveNoise::scale);
        let surprise = -f64::from(self.misses) * (1.0 - self.share.min(MOST_SHARE)).ln();
        let beyond = (surprise / SURPRISING).max(1.0);
        adapted * (beyond * beyond).min(MOST_FOR_MISSES)
    }

    /// Its view through `filter`, which is or was its own; it has the index `track`.
    pub fn view<'f>(&self, track: usize, filter: &'f Filter) -> View<'f> {
        let shares = self.is_established().then_some(self.share_of_late);
        View { track, filter, most_clutter: self.most_clutter(), shares }
    }

    /// Whether most cameras that usually see it have lost it recently: it is occluded, or off its predicted place.
    pub fn is_astray(&self) -> bool {
        self.is_established() && self.share_of_late < ASTRAY * self.share
    }

    /// Notes that `camera` saw it at `time`, which is never before `seen_at`.
    pub fn note(&mut self, camera: CameraId, time: Time) {
        if camera != self.last_camera {
            self.other_at = self.seen_at; // the observation before this one was another camera's
            self.last_camera = camera;
        }
        if time != self.seen_at {
            self.cameras.clear();
            self.seen_at = time;
        }
        self.cameras.insert(camera);
    }

    /// Restarts with `filter`, as several cameras, `camera` the last of them, have found it again at `time`.
    pub fn restart(&mut self, filter: Filter, camera: CameraId, time: Time) {
        self.filter = filter;
        self.history.clear();
        self.misses = 0;
        self.share_of_late = self.share;
        self.seen_at = time;
        self.last_camera = camera;
        self.other_at = time;
        self.beside = None;
        self.cameras.clear();
        self.cameras.insert(camera);
    }

    /// Notes that `camera` saw it at `time`, which was before the time of the filter.
    pub fn note_late(&mut self, camera: CameraId, time: Time) {
        if time > self.seen_at {
            self.note(camera, time);
        } else if time == self.seen_at {
            self.cameras.insert(camera);
        }
        if camera != self.last_camera {
            self.other_at = self.other_at.max(time);
        }
    }

    /// Notes a frame in whose field of view it lies, and whether that frame saw it. A target that is tentative is sent from the
    /// third observation on, if the part `share` of the frames saw it.
    pub fn judge(&mut self, seen: bool, share: f64) {
        self.misses = if seen { 0 } else { self.misses.saturating_add(1) };
        let seen_now = f64::from(u8::from(seen));
        self.share += USUAL_WEIGHT * (seen_now - self.share);
        self.share_of_late += LATE_WEIGHT * (seen_now - self.share_of_late);
        if let Some(confirmation) = &mut self.confirmation {
            confirmation.looks += 1;
            confirmation.hits += u32::from(seen);
            self.is_tentative &= confirmation.hits < HITS_TO_SHOW || confirmation.share() < share;
        }
    }

    /// Ends the confirmation when it is over by `now`; whether less than the part `share` of the frames saw it.
    pub fn refuted(&mut self, now: Time, share: f64) -> bool {
        let Some(over) = self.confirmation.filter(|it| now > it.ends) else { return false };
        self.confirmation = None;
        self.is_tentative = false;
        let refuted = over.share() < share;
        if !refuted {
            self.regained = None;
        }
        refuted
    }

    /// Whether it is certain enough to be a reference, such as for a camera's clock.
    pub fn is_established(&self) -> bool {
        self.confirmation.is_none()
    }

    /// How many false features its gate may hold in one frame, on average: the longer it has been missed, the likelier it is occluded, and
    /// a feature there another light's. Beyond that it takes none, and waits until several cameras agree on its place.
    pub fn most_clutter(&self) -> f64 {
        let missed = f64::from(self.misses.min(1000) + 1);
        if self.is_established() { (MOST_CLUTTER / (missed * missed)).max(LEAST_CLUTTER) } else { f64::INFINITY }
    }

    /// Whether it has lived long enough and been missed for some frames: its position is extrapolated.
    pub fn is_coasting(&self, now: Time) -> bool {
        self.is_established() && now - self.seen_at > UNSEEN
    }

    /// Whether it is lost at `now`, by the two rules of [Davis 2002 §3.6].
    pub fn lost(&self, now: Time, unseen: Interval, single_view: Interval) -> Option<Termination> {
        if now - self.seen_at > unseen {
            Some(Termination::Unseen)
        } else if self.seen_at - self.other_at > single_view {
            Some(Termination::SingleView)
        } else {
            None
        }
    }

    /// Overwrites `target` with this target as of `now`; its memory is reused.
    pub fn write(&self, now: Time, target: &mut Target) {
        target.id = self.id;
        target.position = self.filter.position();
        target.velocity = self.filter.velocity();
        target.covariance = self.filter.covariance();
        target.cameras.clear();
        target.provenance = Provenance::Predicted;
        if self.seen_at == now {
            self.cameras.iter().for_each(|camera| target.cameras.insert(camera));
            target.provenance = Provenance::Measured;
        }
    }
}
