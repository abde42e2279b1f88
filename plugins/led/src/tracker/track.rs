//! One target as the tracker keeps it: filter, identity, and who saw it when.

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
    /// What its innovations say about the noise of its model; `None` where that is as set.
    pub noise: Option<AdaptiveNoise>,
    /// When any camera saw it last.
    pub seen_at: Time,
    /// Which camera that was.
    last_camera: CameraId,
    /// When a camera other than the last one saw it last.
    other_at: Time,
    /// The cameras that saw it at `seen_at`.
    pub cameras: CameraSet,
    /// An older target that has been as close as one light is to itself, and since when.
    pub beside: Option<(TargetId, Time)>,
    /// It has been there for too long: it follows the light of the older one.
    pub is_twin: bool,
    /// While it is on confirmation.
    confirmation: Option<Confirmation>,
    /// Not shown yet: few of the cameras that look on agreed at its initiation.
    pub is_tentative: bool,
    /// Frames that showed its place without it, since the last one that saw it.
    misses: u32,
    /// Part of the frames that show its place that see it: usually, and of late [–].
    share: f64,
    share_of_late: f64,
    /// What the filter took in lately; empty unless late observations are put in their place.
    pub history: History,
    /// How far the others around it are.
    pub neighbours: Neighbours,
    /// How far it goes astray from where it is headed.
    pub wander: Wander,
    /// The lost target that it was taken for, until its confirmation is over.
    pub regained: Option<Box<Lost>>,
}

/// What the cameras make of a new target.
#[derive(Debug, Clone, Copy)]
struct Confirmation {
    ends: Time,
    /// Frames in whose field of view it lay.
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

/// Observations after which a target that is tentative may be shown.
const HITS_TO_SHOW: u32 = 3;

/// A target that was seen in the newest frame takes a feature if its gate holds fewer false ones than this, on average.
const MOST_CLUTTER: f64 = 0.3;

/// And one that is missed, if it holds fewer than this.
const LEAST_CLUTTER: f64 = 0.0005;

/// A target that no camera has seen for this long may be elsewhere.
const UNSEEN: Interval = Interval(50_000_000);

/// What the newest frame counts in the part of the frames that see a target, usually and of late.
const USUAL_WEIGHT: f64 = 0.02;
const LATE_WEIGHT: f64 = 0.15;
/// No light is taken to be seen by more of the frames than this.
const MOST_SHARE: f64 = 0.95;
/// A target that of late was seen by less than this part of the frames that usually see it is astray, as far as it is not hidden.
const ASTRAY: f64 = 0.6;
/// So many frames in a row that miss it are as unlikely as 1 in 100: −ln of the probability.
const SURPRISING: f64 = 4.6;
/// The noise of a motion model is multiplied with no more than this because of frames that miss a target.
const MOST_FOR_MISSES: f64 = 100.0;

/// Why a target is gone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Death {
    /// No camera saw it for too long.
    Unseen,
    /// One camera only saw it for too long.
    SingleView,
    /// It has left the working volume, or its filter has left the numbers.
    Outside,
    /// Too few of the cameras that should have seen it did so after its initiation: lines had met by accident.
    Unconfirmed,
    /// It followed the light of an older target.
    Duplicate,
}

impl Track {
    /// A target first seen at `time`, by several cameras, that has to prove itself for as long as `confirmation`.
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

    /// What the noise of its motion model is to be multiplied with. A light that turns harder than its filter expects leaves the gate in all cameras at once, and what
    /// then would tell of the turn is not taken: the frames that miss it, more of them in a row than chance explains, tell in its place.
    pub fn noise_scale(&self) -> f64 {
        let adapted = self.noise.as_ref().map_or(1.0, AdaptiveNoise::scale);
        let surprise = -f64::from(self.misses) * (1.0 - self.share.min(MOST_SHARE)).ln();
        let beyond = (surprise / SURPRISING).max(1.0);
        adapted * (beyond * beyond).min(MOST_FOR_MISSES)
    }

    /// How it is seen through `filter`, which is its own or was; it has the number `track`.
    pub fn view<'f>(&self, track: usize, filter: &'f Filter) -> View<'f> {
        let shares = self.is_established().then_some(self.share_of_late);
        View { track, filter, most_clutter: self.most_clutter(), shares }
    }

    /// Whether most cameras that usually see it have lost it of late: it is hidden, or it is not where its filter says.
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

    /// Goes on with `filter`, where several cameras, `camera` the last of them, have found it again at `time`.
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

    /// Notes a frame in whose field of view it lies, and whether that frame saw it. A target that is tentative is shown from the
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

    /// Whether it is known well enough to judge others by, such as a camera's clock.
    pub fn is_established(&self) -> bool {
        self.confirmation.is_none()
    }

    /// How many false features its gate may hold in one frame, on average: the longer it has been missed, the likelier is it hidden, and
    /// what lies there someone else's. Beyond that it takes none, and waits until several cameras agree on where it is.
    pub fn most_clutter(&self) -> f64 {
        let missed = f64::from(self.misses.min(1000) + 1);
        if self.is_established() { (MOST_CLUTTER / (missed * missed)).max(LEAST_CLUTTER) } else { f64::INFINITY }
    }

    /// Whether it has lived long enough, and nobody has seen it for some frames: where it is, is a guess.
    pub fn is_coasting(&self, now: Time) -> bool {
        self.is_established() && now - self.seen_at > UNSEEN
    }

    /// Whether it is lost at `now`, by the two rules of [Davis 2002 §3.6].
    pub fn lost(&self, now: Time, unseen: Interval, single_view: Interval) -> Option<Death> {
        if now - self.seen_at > unseen {
            Some(Death::Unseen)
        } else if self.seen_at - self.other_at > single_view {
            Some(Death::SingleView)
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
