//! Initiation of targets from unassociated features [Davis 2002 §3.6].
//!
//! Lines of sight of different times meet only for slow lights, which is the paper's rule. A feature that a camera has
//! seen twice has a velocity in the picture; extrapolated to one time, the lines of a fast light meet as well. Both
//! are tried, the paper's rule first.

use foveate::geometry::{Camera, PixelNoise, refine};
use foveate::messages::{CameraId, Feature, Interval, Time};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Point2, Point3, Vector2, Vector3};
use smallvec::SmallVec;

use super::association::widened;
use super::partners::Partners;
use crate::consensus::{Consensus, ConsensusOptions, Meeting, RayObservation};

/// Motions in pictures agree on a velocity when their mean square deviation from it is within this many standard deviations.
const MOTION_GATE: f64 = 2.0;

/// The unmatched features of each camera's newest frame.
#[derive(Debug)]
pub(super) struct TrackInitiation {
    by_camera: Vec<Recent>,
    partners: Partners,
    consensus: Consensus,
    fresh: Vec<RayObservation>,
    /// By fresh observation: its motion in the picture.
    motions: Vec<Option<Motion>>,
    meetings: Vec<Meeting>,
    before: Vec<Loose>,
}

#[derive(Debug, Clone, Default)]
struct Recent {
    /// Of the newest frame.
    time: Option<Time>,
    loose: Vec<Loose>,
}

/// An unassociated feature.
#[derive(Debug, Clone, Copy)]
struct Loose {
    observation: RayObservation,
    motion: Option<Motion>,
}

/// Motion of a feature in its picture.
#[derive(Debug, Clone, Copy)]
struct Motion {
    /// [px/s]
    velocity: Vector2<f64>,
    /// Of the velocity, each axis [px²/s²].
    variance: f64,
}

/// Conditions of an initiation, besides lines that meet.
pub(super) struct Conditions<'a> {
    pub cameras: &'a [Camera],
    pub options: ConsensusOptions,
    /// Part of the cameras in view that must agree [–].
    pub share: f64,
    pub stale_after: Interval,
    /// Each axis of the velocity, standard deviation [m/s].
    pub speed: f64,
    /// Added to each axis of each feature [px²].
    pub camera_variance: f64,
}

/// Initial state of a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Start {
    /// [m]
    pub position: Point3<f64>,
    /// Of the position [m²].
    pub covariance: Matrix3<f64>,
    /// [m/s]
    pub velocity: Vector3<f64>,
    /// Of each axis of the velocity [m/s].
    pub velocity_sigma: f64,
}

impl TrackInitiation {
    pub fn new(cameras: &[Camera]) -> Self {
        Self {
            by_camera: vec![Recent::default(); cameras.len()],
            partners: Partners::new(cameras),
            consensus: Consensus::default(),
            fresh: Vec::new(),
            motions: Vec::new(),
            meetings: Vec::new(),
            before: Vec::new(),
        }
    }

    /// Replaces the unmatched features of `camera` by those of its newest frame, of `time`. A feature less than `reach` [px] from the prediction
    /// of one of the frame before is assumed to be the same.
    pub fn record(
        &mut self,
        camera: CameraId,
        model: &Camera,
        time: Time,
        features: &[Feature],
        unmatched: impl Iterator<Item = usize>,
        reach: f64,
    ) {
        let Some(recent) = self.by_camera.get_mut(usize::from(camera.0)) else { return };
        let elapsed_s = recent.time.map_or(0.0, |before| (time - before).as_s());
        recent.time = Some(time);
        std::mem::swap(&mut self.before, &mut recent.loose);
        recent.loose.clear();
        recent.loose.extend(unmatched.filter_map(|feature| {
            let Feature { centre: pixel, covariance, .. } = features[feature];
            let observation = RayObservation { camera, time, ray: model.ray(&pixel)?, pixel, covariance, feature };
            let motion = follow(&observation, &self.before, elapsed_s, reach);
            Some(Loose { observation, motion })
        }));
    }

    /// Number of unmatched features in `camera`'s newest frame.
    pub fn n_unmatched(&self, camera: CameraId) -> usize {
        self.by_camera.get(usize::from(camera.0)).map_or(0, |recent| recent.loose.len())
    }

    /// Drops the features of a camera whose frame is unreliable.
    pub fn forget(&mut self, camera: CameraId) {
        if let Some(recent) = self.by_camera.get_mut(usize::from(camera.0)) {
            recent.loose.clear();
        }
    }

    /// The points where a line of `camera`'s newest frame meets those of others, all of which are allowed; best first. With `moving`,
    /// every line is extrapolated to `now` by its motion, and those without a motion are left out.
    pub fn meetings(
        &mut self,
        camera: CameraId,
        now: Time,
        moving: bool,
        conditions: &Conditions<'_>,
        allowed: impl Fn(&Point3<f64>) -> bool,
    ) -> &[Meeting] {
        self.fresh.clear();
        self.motions.clear();
        self.partners.look_up(camera, conditions.cameras);
        for &partner in self.partners.of(camera) {
            let recent = &self.by_camera[partner];
            if recent.time.is_none_or(|time| now - time > conditions.stale_after) {
                continue;
            }
            for loose in &recent.loose {
                let observation = if moving {
                    let carried =
                        loose.motion.and_then(|it| carry(&loose.observation, &it, now, &conditions.cameras[partner]));
                    let Some(observation) = carried else { continue };
                    observation
                } else {
                    loose.observation
                };
                self.fresh.push(observation);
                self.motions.push(loose.motion);
            }
        }
        let onlookers = Onlookers { by_camera: &self.by_camera, partners: self.partners.of(camera), now, conditions };
        let accept = |point: &Point3<f64>, n_cameras: usize| {
            allowed(point) && n_cameras as f64 >= conditions.share * onlookers.count(point) as f64
        };
        self.consensus.find(&self.fresh, Some(camera), &conditions.options, accept, &mut self.meetings);
        &self.meetings
    }

    /// Meeting number `index` of the last search.
    pub fn meeting(&self, index: usize) -> Option<&Meeting> {
        self.meetings.get(index)
    }

    /// Part of the cameras in view that agree with `meeting`, which a line of `camera` proposed.
    pub fn share(&self, camera: CameraId, meeting: &Meeting, now: Time, conditions: &Conditions<'_>) -> f64 {
        let onlookers = Onlookers { by_camera: &self.by_camera, partners: self.partners.of(camera), now, conditions };
        meeting.members.len() as f64 / onlookers.count(&meeting.position).max(1) as f64
    }

    /// The cameras of a meeting whose newest frame is of `time`.
    pub fn witnesses<'a>(&'a self, meeting: &'a Meeting, time: Time) -> impl Iterator<Item = CameraId> + 'a {
        let cameras = meeting.members.iter().map(|&member| self.fresh[member].camera);
        cameras.filter(move |camera| self.by_camera[usize::from(camera.0)].time == Some(time))
    }

    /// The start of a target initiated at `meeting`, at time `now`: the maximum-likelihood point of its pixels, with added uncertainty for its possible
    /// motion since the oldest of them, and the velocity from its motions in the pictures, if they agree on one.
    /// `None` when the cameras' lines do not determine a point, or `moving` ones no motion.
    pub fn start(&self, meeting: &Meeting, now: Time, moving: bool, conditions: &Conditions<'_>) -> Option<Start> {
        let mut cameras: SmallVec<[&Camera; 20]> = SmallVec::new();
        let mut pixels: SmallVec<[Point2<f64>; 20]> = SmallVec::new();
        let mut noise: SmallVec<[Matrix2<f64>; 20]> = SmallVec::new();
        let mut oldest = now;
        for &member in &meeting.members {
            let observation = &self.fresh[member];
            cameras.push(conditions.cameras.get(usize::from(observation.camera.0))?);
            pixels.push(observation.pixel);
            noise.push(widened(&observation.covariance, conditions.camera_variance));
            oldest = oldest.min(observation.time);
        }
        let found = refine(&cameras, &pixels, PixelNoise::Covariances(&noise), meeting.position).ok()?;
        let motion = self.motion_of(meeting, &cameras, &found.position, conditions.speed);
        if moving && motion.is_none() {
            return None;
        }
        let at_rest = (Vector3::zeros(), Matrix3::identity() * (conditions.speed * conditions.speed));
        let (velocity, velocity_covariance) = motion.unwrap_or(at_rest);
        let velocity_sigma = (velocity_covariance.trace() / 3.0).sqrt();
        let moved = velocity_sigma * (now - oldest).as_s();
        Some(Start {
            position: found.position,
            covariance: found.covariance + Matrix3::identity() * (moved * moved),
            velocity,
            velocity_sigma,
        })
    }

    /// The velocity at `place` that fits the motions of a meeting's features in their pictures, with its covariance, if one does.
    fn motion_of(
        &self,
        meeting: &Meeting,
        cameras: &[&Camera],
        place: &Point3<f64>,
        speed: f64,
    ) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        // Σ Jᵀ(u − J v)/σ² = v/speed²: the motions in the pictures, and that most lights are slow.
        let mut precision = Matrix3::identity() / (speed * speed);
        let mut pull = Vector3::zeros();
        let seen = meeting.members.iter().zip(cameras).filter_map(|(&member, camera)| {
            let (_, jacobian) = camera.project_with_jacobian(place)?;
            Some((self.motions[member]?, jacobian))
        });
        let seen: SmallVec<[(Motion, Matrix2x3<f64>); 20]> = seen.collect();
        for (motion, jacobian) in &seen {
            precision += jacobian.transpose() * jacobian / motion.variance;
            pull += jacobian.transpose() * motion.velocity / motion.variance;
        }
        let covariance = precision.try_inverse()?;
        let velocity = covariance * pull;
        let off = seen.iter().map(|(it, jacobian)| (it.velocity - jacobian * velocity).norm_squared() / it.variance);
        let squared = off.sum::<f64>() + velocity.norm_squared() / (speed * speed);
        let fits = squared <= MOTION_GATE * MOTION_GATE * (2 * seen.len() + 3) as f64;
        (fits && seen.len() >= 2).then_some((velocity, covariance))
    }

    /// Removes all lines that pass within `distance` of `point` [m]: the light there has its target now.
    pub fn consume(&mut self, camera: CameraId, point: &Point3<f64>, distance: f64) {
        for &partner in self.partners.of(camera) {
            let recent = &mut self.by_camera[partner];
            recent.loose.retain(|loose| loose.observation.ray.distance_to(point) > distance);
        }
    }

    /// Removes the lines of `meeting` themselves.
    pub fn consume_members(&mut self, index: usize) {
        let Some(meeting) = self.meetings.get(index) else { return };
        for &member in &meeting.members {
            let RayObservation { camera, feature, .. } = self.fresh[member];
            self.by_camera[usize::from(camera.0)].loose.retain(|it| it.observation.feature != feature);
        }
    }
}

/// The motion of `observation`, if the frame before, `elapsed_s` earlier, has a matching feature.
fn follow(observation: &RayObservation, before: &[Loose], elapsed_s: f64, reach: f64) -> Option<Motion> {
    if elapsed_s <= 0.0 {
        return None;
    }
    let nearest = before.iter().filter_map(|it| {
        let expected = it.observation.pixel + it.motion.map_or(Vector2::zeros(), |motion| motion.velocity * elapsed_s);
        let distance = (observation.pixel - expected).norm();
        (distance <= reach).then_some((distance, it))
    });
    let (_, before) = nearest.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let variance = (observation.covariance.trace() + before.observation.covariance.trace()) / 2.0;
    let velocity = (observation.pixel - before.observation.pixel) / elapsed_s;
    Some(Motion { velocity, variance: variance.max(1e-6) / (elapsed_s * elapsed_s) })
}

/// `observation` extrapolated to `now`.
fn carry(observation: &RayObservation, motion: &Motion, now: Time, camera: &Camera) -> Option<RayObservation> {
    let elapsed_s = (now - observation.time).as_s();
    let pixel = observation.pixel + motion.velocity * elapsed_s;
    let covariance = observation.covariance + Matrix2::identity() * (motion.variance * elapsed_s * elapsed_s);
    Some(RayObservation { time: now, ray: camera.ray(&pixel)?, pixel, covariance, ..*observation })
}

/// Cameras that have a point in view.
struct Onlookers<'a> {
    by_camera: &'a [Recent],
    partners: &'a [usize],
    now: Time,
    conditions: &'a Conditions<'a>,
}

impl Onlookers<'_> {
    /// Number of cameras with a fresh frame and `point` in their field of view.
    fn count(&self, point: &Point3<f64>) -> usize {
        let fresh = |recent: &Recent| recent.time.is_some_and(|time| self.now - time <= self.conditions.stale_after);
        let onlooking = self.partners.iter().filter(|&&it| fresh(&self.by_camera[it]));
        onlooking.filter(|&&it| self.conditions.cameras[it].sees(point).is_some()).count()
    }
}
