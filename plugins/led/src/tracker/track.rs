//! One target as the tracker keeps it: filter, identity, and who saw it when.

use foveate::estimation::kalman::ConstantVelocity;
use foveate::messages::{CameraId, CameraSet, How, Interval, Target, TargetId, Time};

/// One live target.
#[derive(Debug, Clone)]
pub(super) struct Track {
    pub id: TargetId,
    pub filter: ConstantVelocity,
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
    /// While it is on probation.
    probation: Option<Probation>,
    /// Not shown yet: few of the cameras that look on agreed at its birth.
    pub withheld: bool,
}

/// What the cameras make of a newborn target.
#[derive(Debug, Clone, Copy)]
struct Probation {
    ends: Time,
    /// Frames in whose field of view it lay.
    looks: u32,
    /// Those among them that saw it.
    hits: u32,
}

impl Probation {
    /// Part of the frames that saw it; all of none.
    fn share(&self) -> f64 {
        if self.looks == 0 { 1.0 } else { f64::from(self.hits) / f64::from(self.looks) }
    }
}

/// Sightings after which a target that is withheld may be shown.
const HITS_TO_SHOW: u32 = 3;

/// Why a target is gone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Death {
    /// No camera saw it for too long.
    Unseen,
    /// One camera only saw it for too long.
    SingleView,
    /// It has left the working volume, or its filter has left the numbers.
    Outside,
    /// Too few of the cameras that should have seen it did so after its birth: lines had met by accident.
    Unconfirmed,
    /// It followed the light of an older target.
    Duplicate,
}

impl Track {
    /// A target first seen at `time`, by several cameras, that has to prove itself for as long as `probation`.
    pub fn new(id: TargetId, filter: ConstantVelocity, time: Time, camera: CameraId, probation: Interval) -> Self {
        let probation = Some(Probation { ends: time + probation, looks: 0, hits: 0 });
        let cameras = std::iter::once(camera).collect();
        Self {
            id,
            filter,
            seen_at: time,
            last_camera: camera,
            other_at: time,
            cameras,
            beside: None,
            probation,
            withheld: false,
        }
    }

    /// Notes that `camera` saw it at `time`, which is never before `seen_at`.
    pub fn note(&mut self, camera: CameraId, time: Time) {
        if camera != self.last_camera {
            self.other_at = self.seen_at; // the sighting before this one was another camera's
            self.last_camera = camera;
        }
        if time != self.seen_at {
            self.cameras.clear();
            self.seen_at = time;
        }
        self.cameras.insert(camera);
    }

    /// Notes a frame in whose field of view it lies, and whether that frame saw it. A target that is withheld is shown from the
    /// third sighting on, if the part `share` of the frames saw it.
    pub fn judge(&mut self, seen: bool, share: f64) {
        if let Some(probation) = &mut self.probation {
            probation.looks += 1;
            probation.hits += u32::from(seen);
            self.withheld &= probation.hits < HITS_TO_SHOW || probation.share() < share;
        }
    }

    /// Ends the probation when it is over by `now`; whether less than the part `share` of the frames saw it.
    pub fn refuted(&mut self, now: Time, share: f64) -> bool {
        let Some(over) = self.probation.filter(|it| now > it.ends) else { return false };
        self.probation = None;
        self.withheld = false;
        over.share() < share
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
        target.position = self.filter.position;
        target.velocity = self.filter.velocity;
        target.covariance = self.filter.covariance;
        target.cameras.clear();
        target.how = How::Predicted;
        if self.seen_at == now {
            self.cameras.iter().for_each(|camera| target.cameras.insert(camera));
            target.how = How::Measured;
        }
    }
}
