//! A solved room, sorted by camera and by point, with the noise of its pixels.

use std::collections::BTreeSet;

use foveate_estimation::statistics::median;
use foveate_geometry::self_calibration::CameraStatus;
use foveate_geometry::triangulate::{PixelNoise, refine};
use foveate_geometry::{Camera, Freedom};
use nalgebra::{Point3, Vector3};

use super::CheckOptions;
use super::models::Witnessed;
use crate::pose_change::{Member, Observed, PoseChange, Witness, pose_change};
use crate::solved::{ObservationRole, Solved, SolvedCamera};

/// Median of χ² with two degrees of freedom: of the squared length of a pixel's error in standard deviations.
pub(super) const MEDIAN_CHI2: f64 = 1.386_294;
/// No detector is better; keeps perfect data from being divided by nothing [px].
const LEAST_SIGMA_PX: f64 = 0.02;
/// Points whose own observations disagree by more than this many standard deviations are not used for checks.
const DISAGREEMENT: f64 = 4.0;
/// Neighbours on the path further away than this give no velocity [s].
const LONGEST_GAP_S: f64 = 0.25;

#[derive(Clone)]
pub(super) struct Room<'a> {
    pub solved: &'a Solved,
    pub options: &'a CheckOptions,
    /// Of either coordinate of a pixel.
    pub sigma_px: f64,
    /// By camera: its observations of points that were found.
    pub of_camera: Vec<Vec<usize>>,
    /// By point: the observations in use.
    pub of_point: Vec<Vec<usize>>,
    /// By point: the light's velocity, where its neighbours in time are near.
    pub velocities: Vec<Option<Vector3<f64>>>,
}

impl<'a> Room<'a> {
    pub(super) fn new(solved: &'a Solved, options: &'a CheckOptions) -> Self {
        let n = solved.points.len();
        let (mut of_camera, mut of_point) = (vec![Vec::new(); solved.cameras.len()], vec![Vec::new(); n]);
        for (index, observation) in solved.observations.iter().enumerate() {
            let finite = observation.pixel.coords.norm().is_finite();
            let Some(point) = observation.point.filter(|it| *it < n && finite) else { continue };
            let Some(own) = of_camera.get_mut(observation.camera) else { continue };
            own.push(index);
            if observation.role == ObservationRole::Used && is_calibrated(&solved.cameras[observation.camera]) {
                of_point[point].push(index);
            }
        }
        for own in &mut of_camera {
            own.sort_by(|a, b| {
                let time = |it: &usize| solved.observations[*it].point.map_or(0.0, |point| solved.points[point].time_s);
                time(a).total_cmp(&time(b)).then(a.cmp(b))
            });
        }
        let velocities = velocities(solved);
        let mut network = Self { solved, options, sigma_px: LEAST_SIGMA_PX, of_camera, of_point, velocities };
        network.sigma_px = network.noise();
        network
    }

    /// The unit of lengths.
    pub(super) fn unit(&self) -> &'static str {
        if self.solved.fixed.scale.is_some() { "m" } else { "units" }
    }

    pub(super) fn name(&self, camera: usize) -> &str {
        &self.solved.cameras[camera].name
    }

    pub(super) fn calibrated(&self) -> impl Iterator<Item = usize> {
        (0..self.solved.cameras.len()).filter(|it| is_calibrated(&self.solved.cameras[*it]))
    }

    pub(super) fn cameras(&self) -> Vec<Camera> {
        self.solved.cameras.iter().map(|it| it.camera.clone()).collect()
    }

    pub(super) fn positions(&self) -> Vec<Point3<f64>> {
        self.solved.points.iter().map(|it| it.position).collect()
    }

    /// The camera that was moved during the recording, if one was.
    pub(super) fn pose_change(&self) -> Option<PoseChange> {
        let member = |it: &SolvedCamera| Some((it.camera.clone(), it.freed, it.known_optics()));
        let members: Vec<Member> =
            self.solved.cameras.iter().map(|it| if is_calibrated(it) { member(it) } else { None }).collect();
        let mut witnesses: Vec<Witness> = self.solved.points.iter().map(Witness::of).collect();
        for it in &self.solved.observations {
            let finite = it.pixel.coords.norm().is_finite();
            if let Some(witness) = it.point.filter(|_| finite).and_then(|point| witnesses.get_mut(point)) {
                witness.observed.push(Observed { camera: it.camera, pixel: it.pixel });
            }
        }
        pose_change(&members, &witnesses, self.options.far_px)
    }

    /// The positions of points that a camera's observations in use show.
    pub(super) fn points_of(&self, camera: usize) -> Vec<Point3<f64>> {
        let used = self.of_camera[camera].iter().map(|it| &self.solved.observations[*it]);
        let used = used.filter(|it| it.role == ObservationRole::Used);
        used.filter_map(|it| Some(self.solved.points[it.point?].position)).collect()
    }

    /// From the median of the residuals, which the cameras and points were fitted to: hence the degrees of freedom.
    fn noise(&self) -> f64 {
        let in_use = || self.of_point.iter().flatten().map(|it| &self.solved.observations[*it]);
        let squares: Vec<f64> = in_use().filter_map(|it| Some(it.residual?.norm_squared())).collect();
        let points = self.of_point.iter().filter(|it| it.len() > 1).count();
        let cameras: usize = self.calibrated().map(|it| n_free(&self.solved.cameras[it].freed)).sum();
        let numbers = 2.0 * squares.len() as f64;
        let freedom = (numbers - (3 * points + cameras) as f64).max(0.1 * numbers);
        let variance = median(&squares).unwrap_or(0.0) / MEDIAN_CHI2 * numbers / freedom.max(1.0);
        variance.sqrt().max(LEAST_SIGMA_PX)
    }

    /// The cameras that see the light together with `camera` often enough, whether its place was found or not; those of most frames
    /// first.
    pub(super) fn partners(&self, camera: usize) -> Vec<usize> {
        let own: BTreeSet<usize> =
            self.solved.observations.iter().filter(|it| it.camera == camera).map(|it| it.frame).collect();
        let mut frames = vec![BTreeSet::new(); self.solved.cameras.len()];
        for it in self.solved.observations.iter().filter(|it| it.camera != camera && own.contains(&it.frame)) {
            frames[it.camera].insert(it.frame);
        }
        let mut partners: Vec<usize> =
            (0..frames.len()).filter(|it| frames[*it].len() >= self.options.min_common).collect();
        partners.sort_by_key(|it| std::cmp::Reverse(frames[*it].len()));
        partners
    }

    /// All observations of `camera`, used or rejected, each with its point as triangulated by the other cameras except
    /// those in `out`. `cameras` and `points` replace those of the room.
    pub(super) fn witnessed(
        &self,
        camera: usize,
        out: &[usize],
        cameras: &[Camera],
        points: &[Point3<f64>],
        wanted: impl Fn(ObservationRole) -> bool,
    ) -> Vec<Witnessed> {
        let own: Vec<usize> =
            self.of_camera[camera].iter().copied().filter(|it| wanted(self.solved.observations[*it].role)).collect();
        let every = own.len().div_ceil(self.options.max_observations).max(1);
        let mut found = Vec::with_capacity(own.len() / every);
        let (mut models, mut pixels) = (Vec::new(), Vec::new());
        for &observation in own.iter().step_by(every) {
            let Some(point) = self.solved.observations[observation].point else { continue };
            models.clear();
            pixels.clear();
            for it in self.of_point[point].iter().map(|it| &self.solved.observations[*it]) {
                if it.camera != camera && !out.contains(&it.camera) {
                    models.push(&cameras[it.camera]);
                    pixels.push(it.pixel);
                }
            }
            let Ok(made) = refine(&models, &pixels, PixelNoise::Sigma(self.sigma_px), points[point]) else { continue };
            if made.residuals_rms_px > DISAGREEMENT * self.sigma_px {
                continue;
            }
            found.push(Witnessed {
                time_s: self.solved.points[point].time_s,
                pixel: self.solved.observations[observation].pixel,
                point: made.position,
                covariance: made.covariance,
                velocity: self.velocities[point],
            });
        }
        found
    }
}

pub(super) fn is_calibrated(camera: &SolvedCamera) -> bool {
    camera.status == CameraStatus::Calibrated
}

/// Numbers that were found of a camera.
fn n_free(freed: &Freedom) -> usize {
    let Freedom { pose: _, focal, aspect, principal, k1, k2, k3, decentering } = *freed;
    let count = |it: bool, of: usize| if it { of } else { 0 };
    let singles = [focal, aspect, k1, k2, k3].iter().filter(|it| **it).count();
    6 + singles + count(principal, 2) + count(decentering, 2)
}

/// Central differences along the path of each light.
fn velocities(solved: &Solved) -> Vec<Option<Vector3<f64>>> {
    let mut order: Vec<usize> = (0..solved.points.len()).collect();
    let key = |it: &usize| (solved.points[*it].label, solved.points[*it].time_s);
    order.sort_by(|a, b| key(a).0.cmp(&key(b).0).then(key(a).1.total_cmp(&key(b).1)));
    let mut velocities = vec![None; solved.points.len()];
    for three in order.windows(3) {
        let [before, here, after] = [three[0], three[1], three[2]].map(|it| &solved.points[it]);
        let gap_s = after.time_s - before.time_s;
        if before.label == after.label && gap_s > 0.0 && gap_s <= LONGEST_GAP_S && here.label == before.label {
            velocities[three[1]] = Some((after.position - before.position) / gap_s);
        }
    }
    velocities
}
