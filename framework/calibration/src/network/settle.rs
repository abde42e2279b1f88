//! Refines a network whose cameras are nearly right, in rounds: spots chosen, points intersected, everything adjusted, outliers determined.

use foveate_estimation::{Loss, Random};
use foveate_geometry::bundle::{self, CameraCovariance, Freedom, OpticsPrior, OpticsSigma};
use foveate_geometry::self_calibration::Link;
use foveate_geometry::{
    BundleOptions, Camera, CameraStatus, LightObservation, Observation, adjust_knowing, agreeing_point,
};
use nalgebra::{Point2, Point3};

use super::NetworkOptions;
use super::moments::{Moment, View};
use crate::pose_change::{Member, Observed, PoseChange, Witness, pose_change};
use crate::recording::Recording;
use crate::solved::{FixedFreedoms, ObservationRole, Solved, SolvedCamera, SolvedObservation, SolvedPoint, Step};
use crate::stretches::stretches;

/// No detector is better than that, standard deviation [px].
const LEAST_SIGMA_PX: f64 = 0.005;

/// Cameras are compared with others when their rotation is known to so much, the root of the sum over the axes [rad], and whose focal length to such a part [–].
const HELD_TURN: f64 = 0.03;
const HELD_FOCAL: f64 = 0.03;

/// A moved camera is searched in a network that is this many times less well known [–].
const LOOSE: f64 = 4.0;

/// What is known of a [`Moment`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Known {
    /// Where the light was.
    pub point: Option<Point3<f64>>,
    /// Not to be used to find cameras.
    pub held_out: bool,
}

/// A room under way.
#[derive(Debug, Clone)]
pub(super) struct Room<'a> {
    options: &'a NetworkOptions,
    pub moments: Vec<Moment>,
    /// By moment.
    pub known: Vec<Known>,
    /// Those that are known.
    pub cameras: Vec<Option<Camera>>,
    /// By camera: what is adjusted.
    pub freed: Vec<Freedom>,
    pub steps: Vec<Step>,
    priors: Vec<OpticsPrior>,
    /// Of either coordinate of a right pixel, standard deviation [px].
    sigma_px: f64,
    covariance: Vec<Option<CameraCovariance>>,
}

impl<'a> Room<'a> {
    /// No camera is known yet.
    pub fn new(recording: &Recording, moments: Vec<Moment>, options: &'a NetworkOptions) -> Room<'a> {
        // Drawn, for moments at equal steps may be those of the same cameras each time.
        let mut draws = Random::new(options.seed).fork("hold-out");
        let every = u32::try_from(options.hold_out_every).unwrap_or(u32::MAX);
        let mut last = (None, false);
        let mut known = Vec::with_capacity(moments.len());
        for moment in &moments {
            // All lights of a frame are held out together.
            if last.0 != Some(moment.frame) {
                last = (Some(moment.frame), every >= 2 && draws.below(every) == 0);
            }
            known.push(Known { point: None, held_out: last.1 && moment.views.len() >= 2 });
        }
        let n = recording.cameras.len();
        let freed = recording.cameras.iter().map(|it| Freedom { pose: true, ..it.free }).collect();
        let priors = recording.cameras.iter().map(|it| OpticsPrior::of_guess(&it.camera)).collect();
        Room {
            options,
            moments,
            known,
            cameras: vec![None; n],
            freed,
            steps: Vec::new(),
            priors,
            sigma_px: options.sigma_px,
            covariance: vec![None; n],
        }
    }

    /// The observations of which there is no doubt which spot is meant, those held out left out.
    pub fn certain(&self) -> Vec<LightObservation> {
        let mut list = Vec::new();
        for (frame, (moment, _)) in self.moments.iter().zip(&self.known).enumerate().filter(|it| !it.1.1.held_out) {
            for view in &moment.views {
                let pixel = view.chosen.map(|it| view.spots[it]);
                list.extend(pixel.map(|pixel| LightObservation { camera: view.camera, frame, pixel }));
            }
        }
        list
    }

    /// An observation is right when at most this far from where its point is seen [px].
    pub fn inlier_px(&self) -> f64 {
        self.options.inlier_px
    }

    /// How well the optics of a camera are known, as it was adjusted last.
    pub fn optics_sigma(&self, camera: usize) -> Option<OpticsSigma> {
        self.covariance[camera].as_ref().map(|it| it.optics)
    }

    /// Whether all cameras are known well enough to be compared with others: how they are turned, and their focal lengths.
    pub fn is_held(&self) -> bool {
        self.is_known_to(HELD_TURN, HELD_FOCAL)
    }

    fn is_known_to(&self, most_turn: f64, most_focal: f64) -> bool {
        let known = (0..self.cameras.len()).filter(|it| self.cameras[*it].is_some());
        known.into_iter().all(|camera| {
            self.covariance[camera].as_ref().is_some_and(|it| {
                let turn = it.pose.fixed_view::<3, 3>(0, 0).trace().max(0.0).sqrt();
                turn < most_turn && (!self.freed[camera].focal || it.optics.focal < most_focal)
            })
        })
    }

    /// By moment, in the order of time: the sum over the observations of known cameras of what [`Self::cost`] is the mean of [px²].
    pub fn costs(&self) -> Vec<f64> {
        let limit = self.options.inlier_px.powi(2);
        let of = |(moment, known): (&Moment, &Known)| {
            let views = moment.views.iter().filter_map(|it| {
                let (camera, chosen) = (self.cameras[it.camera].as_ref()?, it.chosen?);
                let seen = known.point.and_then(|it| camera.project(&it));
                Some(seen.map_or(limit, |seen| (seen - it.spots[chosen]).norm_squared()).min(limit))
            });
            views.sum()
        };
        self.moments.iter().zip(&self.known).map(of).collect()
    }

    /// Takes where the principal point is stated to be for nothing.
    pub fn know_nothing_of_principal(&mut self, camera: usize) {
        self.priors[camera].sigma.principal = [f64::INFINITY; 2];
    }

    /// The camera that was moved during the recording, if one was.
    pub fn pose_change(&self) -> Option<PoseChange> {
        // A camera that was moved spoils what is known of all; of a room of which hardly anything is known it cannot be told.
        if !self.is_known_to(LOOSE * HELD_TURN, LOOSE * HELD_FOCAL) {
            return None;
        }
        let known = self.cameras.iter().zip(&self.freed).zip(&self.priors);
        let members: Vec<Member> =
            known.map(|((camera, freed), prior)| Some((camera.clone()?, *freed, prior.clone()))).collect();
        let witnesses = self.moments.iter().zip(&self.known).filter_map(|(moment, known)| {
            let observed = |it: &View| Some(Observed { camera: it.camera, pixel: it.spots[it.chosen?] });
            let observed = moment.views.iter().filter_map(observed).collect();
            Some(Witness { time_s: moment.time_s, point: known.point?, observed })
        });
        pose_change(&members, &witnesses.collect::<Vec<_>>(), self.options.inlier_px)
    }

    /// Of the random draws.
    pub fn seed(&self) -> u64 {
        self.options.seed
    }

    /// By camera: the share of its observations that fit, of the moments that three known cameras see, or two where only two are known; `None` where
    /// there are none.
    pub fn shares(&self) -> Vec<Option<f64>> {
        let n_known = self.cameras.iter().flatten().count();
        let mut counts = vec![(0_usize, 0_usize); self.cameras.len()];
        for moment in &self.moments {
            let known = moment.views.iter().filter(|it| it.chosen.is_some() && self.cameras[it.camera].is_some());
            if known.clone().count() < n_known.min(3) {
                continue;
            }
            for view in known {
                counts[view.camera].0 += usize::from(view.right);
                counts[view.camera].1 += 1;
            }
        }
        counts.into_iter().map(|(right, all)| (all > 0).then(|| right as f64 / all as f64)).collect()
    }

    /// Takes the stated shape of a camera's pixels for a guess to a third.
    pub fn know_nothing_of_shape(&mut self, camera: usize) {
        self.priors[camera].sigma.aspect = 0.3;
    }

    /// Mean over all observations of known cameras of the squared distance from where the point is seen, at most that of an observation that is just
    /// right no more [px²].
    pub fn cost(&self) -> f64 {
        let limit = self.options.inlier_px.powi(2);
        let (mut n, mut sum) = (0_usize, 0.0);
        for (moment, known) in self.moments.iter().zip(&self.known) {
            for view in &moment.views {
                let (Some(camera), Some(chosen)) = (&self.cameras[view.camera], view.chosen) else { continue };
                let seen = known.point.and_then(|it| camera.project(&it));
                sum += seen.map_or(limit, |it| (it - view.spots[chosen]).norm_squared()).min(limit);
                n += 1;
            }
        }
        sum / n.max(1) as f64
    }

    /// Adjusts in rounds that allow ever less, given in the rules' `inlier_px`; the last takes pixels for as good as the residuals before
    /// it say, and gives covariances.
    pub fn settle(&mut self, rounds: &[f64]) {
        for (round, limit) in rounds.iter().enumerate() {
            self.intersect(limit * self.options.inlier_px);
            let last = round + 1 == rounds.len();
            if last {
                self.sigma_px = self.pixel_sigma().unwrap_or(self.sigma_px);
            }
            self.adjust(if last { Loss::HUBER } else { Loss::CAUCHY }, last);
        }
        self.intersect(self.options.inlier_px);
    }

    /// For each moment the point on which most of its observations agree within `limit_px`, and which they are. An observation with several spots
    /// takes the one nearest to where the others have the light.
    pub fn intersect(&mut self, limit_px: f64) {
        let cameras = &self.cameras;
        for (moment, now) in self.moments.iter_mut().zip(&mut self.known) {
            now.point = None;
            moment.views.iter_mut().for_each(|it| it.right = false);
            let known = |it: &View| Some((cameras[it.camera].as_ref()?, it.spots[it.chosen?]));
            let views: Vec<(usize, (&Camera, Point2<f64>))> =
                moment.views.iter().enumerate().filter_map(|(index, it)| Some((index, known(it)?))).collect();
            let pairs: Vec<(&Camera, Point2<f64>)> = views.iter().map(|it| it.1).collect();
            let Some(found) = agreeing_point(&pairs, limit_px) else { continue };
            for ((index, _), agrees) in views.iter().zip(&found.agreeing) {
                moment.views[*index].right = *agrees;
            }
            now.point = Some(found.point);
            for view in moment.views.iter_mut().filter(|it| it.spots.len() > 1 && !it.right) {
                let seen = cameras[view.camera].as_ref().and_then(|it| it.project(&found.point));
                let Some(seen) = seen else { continue };
                let distance = |it: &Point2<f64>| (it - seen).norm();
                let nearest = (0..view.spots.len())
                    .min_by(|a, b| distance(&view.spots[*a]).total_cmp(&distance(&view.spots[*b])));
                if let Some(nearest) = nearest.filter(|it| distance(&view.spots[*it]) <= limit_px) {
                    (view.chosen, view.right) = (Some(nearest), true);
                }
            }
        }
    }

    /// Adjusts all known cameras and the points of moments that are not held out to the right observations.
    pub fn adjust(&mut self, loss: Loss, last: bool) {
        let members: Vec<usize> = (0..self.cameras.len()).filter(|it| self.cameras[*it].is_some()).collect();
        let mut slots = vec![usize::MAX; self.cameras.len()];
        members.iter().enumerate().for_each(|(slot, camera)| slots[*camera] = slot);
        let (mut used, mut points, mut observations) = (Vec::new(), Vec::new(), Vec::new());
        for (index, moment) in self.moments.iter().enumerate().filter(|it| !self.known[it.0].held_out) {
            let Some(point) = self.known[index].point else { continue };
            for view in moment.views.iter().filter(|it| it.right) {
                let Some(pixel) = view.chosen.map(|it| view.spots[it]) else { continue };
                let camera = slots[view.camera];
                observations.push(Observation { camera, point: points.len(), pixel, sigma_px: self.sigma_px });
            }
            points.push(point);
            used.push(index);
        }
        let cameras: Vec<Camera> = members.iter().filter_map(|it| self.cameras[*it].clone()).collect();
        let freed: Vec<Freedom> = members.iter().map(|it| self.freed[*it]).collect();
        let options = BundleOptions { loss, covariance: last, ..BundleOptions::default() };
        // What was intersected is seen by two cameras each; with nothing intersected all stays as it is.
        let optics: Vec<OpticsPrior> = members.iter().map(|it| self.priors[*it].clone()).collect();
        let stretches = stretches(&used.iter().map(|it| self.moments[*it].frame).collect::<Vec<_>>());
        let known = bundle::Known { optics: &optics, stretches: &stretches, ..bundle::Known::default() };
        let Ok(found) = adjust_knowing(&cameras, &freed, &points, &observations, &known, &options) else { return };
        for (slot, camera) in members.iter().enumerate() {
            self.cameras[*camera] = Some(found.cameras[slot].clone());
        }
        for (place, index) in used.iter().enumerate() {
            self.known[*index].point = Some(found.points[place]);
        }
        let (stage, used) = (if last { "adjusted" } else { "adjusted, doubting" }, observations.len());
        self.steps.push(Step { stage, rms_px: found.rms_px, used });
        if let Some(Ok(covariance)) = found.covariance {
            for (camera, covariance) in members.iter().zip(covariance) {
                self.covariance[*camera] = Some(covariance);
            }
        }
    }

    /// Standard deviation of either coordinate of a right pixel, from the residuals that the cameras were found from, corrected for what was
    /// adjusted to them; `None` without any to spare [px].
    pub fn pixel_sigma(&self) -> Option<f64> {
        let (mut n, mut squares, mut n_points) = (0_usize, 0.0, 0_usize);
        let mut seeing = vec![false; self.cameras.len()];
        for (moment, known) in self.moments.iter().zip(&self.known).filter(|it| !it.1.held_out) {
            let Some(point) = known.point else { continue };
            n_points += 1;
            for view in moment.views.iter().filter(|it| it.right) {
                let camera = self.cameras[view.camera].as_ref();
                let Some(seen) = camera.and_then(|it| it.project(&point)) else { continue };
                let Some(pixel) = view.chosen.map(|it| view.spots[it]) else { continue };
                seeing[view.camera] = true;
                n += 2;
                squares += (seen - pixel).norm_squared();
            }
        }
        let adjusted: usize = (0..seeing.len()).filter(|it| seeing[*it]).map(|it| self.freed[it].n_parameters()).sum();
        // Seven directions are the gauge's.
        let free = (n + 7).checked_sub(adjusted + 3 * n_points).filter(|it| *it > 0)?;
        Some((squares / free as f64).sqrt().max(LEAST_SIGMA_PX))
    }

    /// All that is known, and the standard deviation of either coordinate of a right pixel [px].
    pub fn into_solved(self, recording: &Recording, status: &[CameraStatus], links: Vec<Link>) -> (Solved, f64) {
        let sigma_px = self.pixel_sigma().unwrap_or(self.sigma_px);
        let (mut points, mut observations) = (Vec::new(), Vec::new());
        for (moment, known) in self.moments.iter().zip(&self.known) {
            let (frame, label) = (moment.frame, moment.label);
            let point = known.point.map(|position| {
                points.push(SolvedPoint { frame, time_s: moment.time_s, label, position });
                points.len() - 1
            });
            for view in &moment.views {
                let camera = self.cameras[view.camera].as_ref();
                // An observation whose spot nobody could choose shows its first, as one of those that say nothing.
                let pixel = view.spots[view.chosen.unwrap_or(0)];
                let seen = known.point.and_then(|point| camera?.project(&point)).filter(|_| view.chosen.is_some());
                let residual = seen.map(|it| it - pixel);
                let role = match (residual, view.right) {
                    (None, _) => ObservationRole::Unsolved,
                    (Some(_), false) => ObservationRole::Rejected,
                    (Some(_), true) if known.held_out => ObservationRole::HeldOut,
                    (Some(_), true) => ObservationRole::Used,
                };
                observations.push(SolvedObservation { camera: view.camera, frame, point, pixel, residual, role });
            }
        }
        let cameras = recording.cameras.iter().zip(self.cameras).zip(self.freed).zip(self.covariance).zip(status);
        let cameras = cameras.map(|((((guess, camera), freed), covariance), status)| SolvedCamera {
            name: guess.name.clone(),
            freed: if camera.is_some() { freed } else { Freedom::NONE },
            camera: camera.unwrap_or_else(|| guess.camera.clone()),
            status: status.clone(),
            prior: Some(OpticsPrior::of_guess(&guess.camera)),
            covariance,
            clock: None,
        });
        let cameras = cameras.collect();
        let fixed = FixedFreedoms::default();
        let asked = recording.cameras.iter().map(|it| it.free).collect();
        let solved =
            Solved { cameras, points, observations, steps: self.steps, links, fixed, asked, camera_faults: Vec::new() };
        (solved, sigma_px)
    }
}
