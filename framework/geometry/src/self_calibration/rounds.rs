//! From a first guess to the adjusted room: intersect, adjust, tighten the limits; then resect the missing cameras.

use foveate_estimation::{Loss, Random};
use nalgebra::Point3;

use super::centres::Start;
use super::links::Tracks;
use super::{CameraStatus, OpticHeld, SelfCalibration, SelfCalibrationOptions, flatness, normalise, optics};
use crate::agreement::agreeing_point;
use crate::bundle::{
    Adjusted, BundleOptions, CameraCovariance, Freedom, Known, Observation, OpticsPrior, UnobservableParameters,
    adjust_knowing,
};
use crate::camera::Camera;
use crate::resection::{ResectionOptions, resect};

/// How far off a right observation may be in each round, in `inlier_px`.
const ROUNDS: [f64; 5] = [12.0, 6.0, 3.0, 1.5, 1.0];
/// Further rounds for each camera that resection adds.
pub(super) const LATE_ROUNDS: [f64; 2] = [1.5, 1.0];

/// Cameras under way.
#[derive(Clone)]
pub(super) struct Room<'a> {
    pub tracks: &'a Tracks<'a>,
    pub options: &'a SelfCalibrationOptions,
    pub cameras: Vec<Option<Camera>>,
    pub points: Vec<Option<Point3<f64>>>,
    pub right: Vec<bool>,
    /// By camera: what the adjustments may move.
    pub freed: Vec<Freedom>,
}

/// Adjusts the `start`; cameras that come to stand on too few right observations lose their pose, and their status says why.
pub(super) fn run(
    tracks: &Tracks<'_>,
    start: Start,
    status: &mut [CameraStatus],
    options: &SelfCalibrationOptions,
    random: &Random,
) -> Option<SelfCalibration> {
    let right = vec![false; tracks.observations.len()];
    let points = vec![None; tracks.of_frame.len()];
    let freed = tracks.free.iter().map(optics::from_the_start).collect();
    let mut room = Room { tracks, options, cameras: start.cameras, points, right, freed };
    room.adjust_in_rounds(&ROUNDS)?;
    for (camera, status) in status.iter().enumerate() {
        // From far enough away, anything looks like a light that stays in place.
        let hopeless = matches!(status, CameraStatus::LightStill { .. } | CameraStatus::TooFewObservations { .. });
        if room.cameras[camera].is_none() && !hopeless && room.resect(camera, random) {
            room.adjust_in_rounds(&LATE_ROUNDS)?;
        }
    }
    room.drop_ill_held(status);
    normalise(&mut room.cameras, &mut room.points);
    let held = optics::free_what_holds(&mut room)?;
    let last = room.adjust(Loss::HUBER, true)?;
    for (camera, status) in status.iter_mut().enumerate() {
        if room.cameras[camera].is_some() {
            *status = CameraStatus::Calibrated;
        }
    }
    Some(room.finish(last, status, held))
}

/// Whether there is a lens of such a focal length; one that diverged means that the observations do not determine the room.
fn is_lens(camera: &Camera) -> bool {
    let longer = f64::from(camera.image_size[0].max(camera.image_size[1]));
    (0.1..50.0).contains(&(camera.intrinsics.focal[0] / longer))
}

impl Room<'_> {
    /// Cameras that have a pose.
    pub(super) fn members(&self) -> Vec<usize> {
        (0..self.cameras.len()).filter(|it| self.cameras[*it].is_some()).collect()
    }

    pub(super) fn adjust_in_rounds(&mut self, rounds: &[f64]) -> Option<()> {
        for limit in rounds {
            self.intersect(limit * self.options.inlier_px);
            self.adjust(Loss::CAUCHY, false)?;
        }
        self.intersect(self.options.inlier_px);
        Some(())
    }

    /// For each frame the point on which more than half of its observations, at least two, agree within `limit_px`.
    fn intersect(&mut self, limit_px: f64) {
        self.right.fill(false);
        for (frame, observations) in self.tracks.of_frame.iter().enumerate() {
            let seen = |it: &usize| {
                let observation = &self.tracks.observations[*it];
                Some((*it, (self.cameras[observation.camera].as_ref()?, observation.pixel)))
            };
            let (indices, bearings): (Vec<usize>, Vec<_>) = observations.iter().filter_map(seen).unzip();
            let found = agreeing_point(&bearings, limit_px);
            self.points[frame] = found.as_ref().map(|it| it.point);
            let agreeing = found.iter().flat_map(|it| &it.agreeing);
            indices.iter().zip(agreeing).for_each(|(index, agrees)| self.right[*index] = *agrees);
        }
    }

    /// Adjusts all cameras that have a pose to the right observations.
    pub(super) fn adjust(&mut self, loss: Loss, covariance: bool) -> Option<Adjusted> {
        let members = self.members();
        let mut slots = vec![0; self.cameras.len()];
        members.iter().enumerate().for_each(|(slot, camera)| slots[*camera] = slot);
        let frames: Vec<usize> = (0..self.points.len()).filter(|it| self.points[*it].is_some()).collect();
        let mut observations = Vec::new();
        for (point, frame) in frames.iter().enumerate() {
            for &index in self.tracks.of_frame[*frame].iter().filter(|it| self.right[**it]) {
                let observation = &self.tracks.observations[index];
                let (camera, pixel) = (slots[observation.camera], observation.pixel);
                observations.push(Observation { camera, point, pixel, sigma_px: self.options.sigma_px });
            }
        }
        let cameras: Vec<Camera> = members.iter().filter_map(|it| self.cameras[*it].clone()).collect();
        let points: Vec<Point3<f64>> = frames.iter().filter_map(|it| self.points[*it]).collect();
        let options = BundleOptions { loss, covariance, max_iterations: 60, ..BundleOptions::default() };
        let freedoms: Vec<Freedom> = members.iter().map(|it| self.freed[*it]).collect();
        let optics: Vec<OpticsPrior> = members.iter().map(|it| self.tracks.priors[*it].clone()).collect();
        let known = Known { optics: &optics, ..Known::default() };
        let found = adjust_knowing(&cameras, &freedoms, &points, &observations, &known, &options).ok()?;
        for (slot, camera) in members.iter().enumerate() {
            self.cameras[*camera] = Some(found.cameras[slot].clone());
        }
        for (point, frame) in frames.iter().enumerate() {
            self.points[*frame] = Some(found.points[point]);
        }
        Some(found)
    }

    /// Tries to place a camera by the points of the others.
    fn resect(&mut self, camera: usize, random: &Random) -> bool {
        let known =
            |it: &usize| Some((self.points[self.tracks.observations[*it].frame]?, self.tracks.observations[*it].pixel));
        let (points, pixels): (Vec<_>, Vec<_>) = self.tracks.of_camera[camera].iter().filter_map(known).unzip();
        let options = ResectionOptions {
            sigma_px: self.options.sigma_px,
            inlier_px: 2.0 * self.options.inlier_px,
            ..ResectionOptions::default()
        };
        let mut draws = random.fork(&format!("resection of {camera}"));
        let given = &self.tracks.cameras[camera];
        let Ok(found) = resect(given, &points, &pixels, &options, |n| draws.below(n)) else { return false };
        let n_right = found.right.iter().filter(|it| **it).count();
        if n_right < self.options.min_common.max(6) || 3 * n_right < points.len() {
            return false;
        }
        self.cameras[camera] = Some(Camera { camera_from_world: found.camera_from_world, ..given.clone() });
        true
    }

    /// Takes the pose from cameras that too few of their own observations support.
    fn drop_ill_held(&mut self, status: &mut [CameraStatus]) {
        let needed = self.options.min_common.max(6);
        for (camera, status) in status.iter_mut().enumerate() {
            let own = &self.tracks.of_camera[camera];
            let shared = own.iter().filter(|it| self.points[self.tracks.observations[**it].frame].is_some()).count();
            let right = own.iter().filter(|it| self.right[**it]).count();
            if self.cameras[camera].is_some() && (right < needed || 3 * right < shared) {
                self.cameras[camera] = None;
                let best = (0..self.cameras.len()).find(|it| self.cameras[*it].is_some()).unwrap_or(camera);
                *status = CameraStatus::Inconsistent { best, common: shared, right };
            }
        }
        self.intersect(self.options.inlier_px);
    }

    fn finish(mut self, last: Adjusted, status: &mut [CameraStatus], mut held: Vec<Vec<OpticHeld>>) -> SelfCalibration {
        let members = self.members();
        let mut covariance: Vec<Option<CameraCovariance>> = vec![None; self.cameras.len()];
        match last.covariance {
            Some(Ok(each)) => members.iter().zip(each).for_each(|(camera, it)| covariance[*camera] = Some(it)),
            Some(Err(UnobservableParameters { parameters })) => {
                for (slot, _) in parameters.iter().filter(|it| self.freed[members[it.0]].focal) {
                    status[members[*slot]] = CameraStatus::FocalOpen { sigma: f64::INFINITY };
                }
            }
            None => {}
        }
        for camera in &members {
            let sigma = covariance[*camera].as_ref().map_or(0.0, |it| it.optics.focal);
            let is_lens = self.cameras[*camera].as_ref().is_none_or(is_lens) || !self.freed[*camera].focal;
            let sigma = if is_lens { sigma } else { f64::INFINITY };
            if sigma > self.options.max_focal_sigma {
                status[*camera] = CameraStatus::FocalOpen { sigma };
            }
        }
        // One camera alone has no pose: what was open of its partners is open of it.
        if let [alone] = (0..status.len()).filter(|it| status[*it] == CameraStatus::Calibrated).collect::<Vec<_>>()[..]
        {
            let sigma =
                |it: &CameraStatus| if let CameraStatus::FocalOpen { sigma } = it { Some(*sigma) } else { None };
            let least = status.iter().filter_map(sigma).fold(f64::INFINITY, f64::min);
            status[alone] = match self.freed[alone].focal {
                true => CameraStatus::FocalOpen { sigma: least },
                false => CameraStatus::NoPartner { best: None, common: 0, needed: self.options.min_common },
            };
        }
        let mut cameras: Vec<Camera> = self.tracks.given.to_vec();
        for (camera, found) in cameras.iter_mut().zip(self.cameras) {
            *camera = found.unwrap_or_else(|| camera.clone());
        }
        let calibrated = |it: usize| status[it] == CameraStatus::Calibrated;
        let residual = |index: usize| {
            let observation = &self.tracks.observations[index];
            let point = self.points[observation.frame].filter(|_| calibrated(observation.camera))?;
            Some(cameras[observation.camera].project(&point)? - observation.pixel)
        };
        let residuals: Vec<_> = (0..self.right.len()).map(residual).collect();
        for (right, residual) in self.right.iter_mut().zip(&residuals) {
            *right &= residual.is_some();
        }
        let of_right = residuals.iter().zip(&self.right).filter(|(_, right)| **right).filter_map(|(it, _)| *it);
        let squares: Vec<f64> = of_right.map(|it| it.norm_squared()).collect();
        for camera in (0..cameras.len()).filter(|it| !calibrated(*it)) {
            cameras[camera].clone_from(&self.tracks.given[camera]);
            self.freed[camera] = Freedom::NONE;
            held[camera].clear();
        }
        SelfCalibration {
            rms_px: (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt(),
            cameras,
            status: status.to_vec(),
            residuals,
            right: self.right,
            covariance,
            freed: self.freed,
            held,
            links: Vec::new(),
            flatness: flatness(&self.points),
            points: self.points,
        }
    }
}
