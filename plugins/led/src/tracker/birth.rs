//! What no target explains, kept for a while, and the targets that are born of it [Davis 2002 §3.6].

use foveate::estimation::kalman::ConstantVelocity;
use foveate::geometry::{Camera, PixelNoise, refine};
use foveate::messages::{CameraId, Feature, Interval, Time};
use nalgebra::{Matrix2, Matrix3, Point2, Point3};
use smallvec::SmallVec;

use super::association::widened;
use crate::consensus::{Consensus, Meeting, Rules, Sighting};

/// The unmatched features of each camera's newest frame.
#[derive(Debug, Default)]
pub(super) struct Nursery {
    by_camera: Vec<Recent>,
    consensus: Consensus,
    fresh: Vec<Sighting>,
    meetings: Vec<Meeting>,
}

#[derive(Debug, Clone, Default)]
struct Recent {
    /// Of the newest frame.
    time: Option<Time>,
    sightings: Vec<Sighting>,
}

/// What a birth needs, besides lines that meet.
pub(super) struct Conditions<'a> {
    pub cameras: &'a [Camera],
    pub rules: Rules,
    /// Part of the onlooking cameras that must agree [–].
    pub share: f64,
    pub stale_after: Interval,
    /// Each axis of the velocity, standard deviation [m/s].
    pub speed: f64,
    /// Added to each axis of each feature [px²].
    pub camera_variance: f64,
}

impl Nursery {
    pub fn new(n_cameras: usize) -> Self {
        Self { by_camera: vec![Recent::default(); n_cameras], ..Self::default() }
    }

    /// Replaces what `camera` left unmatched by what its newest frame, of `time`, leaves.
    pub fn record(
        &mut self,
        camera: CameraId,
        model: &Camera,
        time: Time,
        features: &[Feature],
        unmatched: impl Iterator<Item = usize>,
    ) {
        let Some(recent) = self.by_camera.get_mut(usize::from(camera.0)) else { return };
        recent.time = Some(time);
        recent.sightings.clear();
        recent.sightings.extend(unmatched.filter_map(|feature| {
            let Feature { centre: pixel, covariance, .. } = features[feature];
            Some(Sighting { camera, time, ray: model.ray(&pixel)?, pixel, covariance, feature })
        }));
    }

    /// How many features of `camera`'s newest frame are still unexplained.
    pub fn n_unmatched(&self, camera: CameraId) -> usize {
        self.by_camera.get(usize::from(camera.0)).map_or(0, |recent| recent.sightings.len())
    }

    /// Forgets the features of a camera whose frame is not to be trusted.
    pub fn forget(&mut self, camera: CameraId) {
        if let Some(recent) = self.by_camera.get_mut(usize::from(camera.0)) {
            recent.sightings.clear();
        }
    }

    /// The points where a line of `camera`'s newest frame meets those of others, all of which are allowed; best first.
    pub fn meetings(
        &mut self,
        camera: CameraId,
        now: Time,
        conditions: &Conditions<'_>,
        allowed: impl Fn(&Point3<f64>) -> bool,
    ) -> &[Meeting] {
        let fresh = |time: Time| now - time <= conditions.stale_after;
        self.fresh.clear();
        for recent in &self.by_camera {
            if recent.time.is_some_and(fresh) {
                self.fresh.extend_from_slice(&recent.sightings);
            }
        }
        let by_camera = &self.by_camera;
        let accept = |point: &Point3<f64>, n_cameras: usize| {
            allowed(point) && n_cameras as f64 >= conditions.share * onlookers(by_camera, point, now, conditions) as f64
        };
        self.consensus.find(&self.fresh, Some(camera), &conditions.rules, accept, &mut self.meetings);
        &self.meetings
    }

    /// Meeting number `index` of the last search.
    pub fn meeting(&self, index: usize) -> Option<&Meeting> {
        self.meetings.get(index)
    }

    /// Part of the cameras that look on that agree with `meeting`.
    pub fn share(&self, meeting: &Meeting, now: Time, conditions: &Conditions<'_>) -> f64 {
        meeting.members.len() as f64 / onlookers(&self.by_camera, &meeting.position, now, conditions).max(1) as f64
    }

    /// The cameras of a meeting, with the time at which each saw it.
    pub fn witnesses<'a>(&'a self, meeting: &'a Meeting) -> impl Iterator<Item = (CameraId, Time)> + 'a {
        meeting.members.iter().map(|&member| (self.fresh[member].camera, self.fresh[member].time))
    }

    /// The filter of a target born at `meeting`, at time `now`: the maximum-likelihood point of its pixels, less certain
    /// by what it may have moved since the oldest of them. `None` when the cameras' lines fix no point.
    pub fn filter(&self, meeting: &Meeting, now: Time, conditions: &Conditions<'_>) -> Option<ConstantVelocity> {
        let mut cameras: SmallVec<[&Camera; 20]> = SmallVec::new();
        let mut pixels: SmallVec<[Point2<f64>; 20]> = SmallVec::new();
        let mut noise: SmallVec<[Matrix2<f64>; 20]> = SmallVec::new();
        let mut oldest = now;
        for &member in &meeting.members {
            let sighting = &self.fresh[member];
            cameras.push(conditions.cameras.get(usize::from(sighting.camera.0))?);
            pixels.push(sighting.pixel);
            noise.push(widened(&sighting.covariance, conditions.camera_variance));
            oldest = oldest.min(sighting.time);
        }
        let found = refine(&cameras, &pixels, PixelNoise::Covariances(&noise), meeting.position).ok()?;
        let moved = conditions.speed * (now - oldest).as_s();
        let covariance = found.covariance + Matrix3::identity() * (moved * moved);
        Some(ConstantVelocity::new(found.position, covariance, conditions.speed))
    }

    /// Uses up all lines that pass within `distance` of `point` [m]: the light there has its target now.
    pub fn consume(&mut self, point: &Point3<f64>, distance: f64) {
        for recent in &mut self.by_camera {
            recent.sightings.retain(|sighting| sighting.ray.distance_to(point) > distance);
        }
    }
}

/// How many cameras with a fresh frame have `point` in their field of view.
fn onlookers(by_camera: &[Recent], point: &Point3<f64>, now: Time, conditions: &Conditions<'_>) -> usize {
    let fresh = |recent: &Recent| recent.time.is_some_and(|time| now - time <= conditions.stale_after);
    let onlooking = by_camera.iter().zip(conditions.cameras).filter(|(recent, _)| fresh(recent));
    onlooking.filter(|(_, camera)| camera.sees(point).is_some()).count()
}
