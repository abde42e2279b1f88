//! Cameras that contradict the rest, and what is wrong with them.
//!
//! A camera is judged by its own observations against points intersected from the other cameras alone, with a pose fitted to these: so it
//! cannot pull the points towards itself. Of the cameras that fit badly, the one without which the rest agrees best is the candidate;
//! the room is adjusted without it and the search goes on. The cause is the one that lowers the candidate's robust cost most.

use foveate_estimation::Loss;
use foveate_estimation::statistics::median;
use foveate_geometry::bundle::{BundleOptions, Observation, adjust};
use foveate_geometry::{Camera, CameraStatus, Freedom};
use nalgebra::Point3;

use super::camera::{self, ALMOST_ALL, empty_ninths};
use super::gross_error::{candidate, culprit, harmless};
use super::models::{Extra, Fitted, Samples};
use super::network::{MEDIAN_CHI2, Room, is_calibrated};
use super::{Judgement, Level};
use crate::cause::Cause;
use crate::solved::ObservationRole;
use crate::stretches::{steadiness, steady_enough};

/// A camera that contradicts the rest, with the most likely cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Level and sentence.
    pub judgement: Judgement,
    /// Index of the camera.
    pub camera: usize,
    /// The cause that explains most.
    pub cause: Cause,
    /// Robust cost of its observations beside the others' points, over that of the median camera; infinite where no pose was found [–].
    pub misfit: f64,
    /// Part of the excess of that cost which the cause explains [–].
    pub explained: f64,
}

/// Fewer observations that others witness say nothing about a camera.
const LEAST_SAMPLES: usize = 20;
/// Standard deviations beyond which an observation is far from where the others have the light.
const FAR: f64 = 5.0;
/// With a larger share of such observations, poses are searched for, not only refined.
const SEARCH_SHARE: f64 = 0.1;
/// A cause must explain this part of the excess.
const EXPLAINS: f64 = 0.35;
/// Of the candidates of one round, as many are tried for being the one without which the rest agrees best.
const TRIED: usize = 3;
/// Points that are enough to adjust a room.
const ENOUGH_POINTS: usize = 1500;
/// Observations fit another camera when within this many standard deviations in the median, and fit their own this many times worse.
const SWAPPED_SIGMA: f64 = 6.0;
const SWAPPED_RATIO: f64 = 3.0;
/// Mean cost of an observation that is off by noise alone, with as large a σ as is believed: the mean of Cauchy's loss over χ² with two
/// degrees of freedom.
const NOISE_COST: f64 = 1.55;
/// With a larger share of observations far off, no pose has to do with what a camera saw.
const NO_POSE: f64 = 0.8;
/// A picture is mirrored that has, in a mirror, less than this part of its observations that are far off.
const LESS_FAR: f64 = 0.5;
/// Focal lengths are off by no larger a factor, nor by its inverse.
const FOCAL_FACTOR: f64 = 2.0;
/// A smaller share of harmless wrong observations is what lamps and mirrors leave in any room, and is not reported.
const FEW_WRONG: f64 = 0.2;
/// A camera with more wrong observations than right ones was calibrated by luck.
const MOST_WRONG: f64 = 0.5;

/// The room without the candidates so far.
#[derive(Clone)]
struct Rest<'a> {
    network: Room<'a>,
    out: Vec<usize>,
    cameras: Vec<Camera>,
    points: Vec<Point3<f64>>,
    rms_px: f64,
}

/// A camera with a pose fitted to the others' points.
struct Examined {
    camera: usize,
    samples: Samples,
    /// Whatever its pose was, it was found by search.
    fitted: Fitted,
    /// Σ ρ over the number of samples.
    mean_cost: f64,
    /// Share of observations that are far off.
    far: f64,
}

/// In a mirrored world all cameras contradict each other: there only cameras that saw too little are reported.
pub(super) fn candidates(network: &Room<'_>, is_mirrored: bool) -> Vec<Candidate> {
    let known = &network.solved.camera_faults;
    let mut found: Vec<Candidate> = known.iter().map(|it| culprit(network, it)).collect();
    // Cameras that are hardly known are not compared with each other.
    let is_held = network.calibrated().all(|it| camera::camera(network, it).judgement.level < Level::Redo);
    if !is_mirrored && is_held {
        let is_known = |camera: usize| known.iter().any(|it| it.camera == camera);
        let moved = network.pose_change().filter(|it| !is_known(it.camera));
        found.extend(moved.iter().map(|it| culprit(network, &it.culprit())));
        let told: Vec<usize> = found.iter().map(|it| it.camera).collect();
        found.extend(contradicting(network).into_iter().filter(|it| !told.contains(&it.camera)));
    }
    for (camera, it) in network.solved.cameras.iter().enumerate() {
        let count = match it.status {
            CameraStatus::TooFewObservations { frames, .. } => frames,
            CameraStatus::NoPartner { common, .. } => common,
            CameraStatus::Inconsistent { common, .. } if common > 0 && common < network.options.min_common => common,
            _ => continue,
        };
        if found.iter().all(|it| it.camera != camera) {
            let judgement = camera::camera(network, camera).judgement;
            found.push(Candidate { judgement, camera, cause: Cause::FewCommon { count }, misfit: 1.0, explained: 1.0 });
        }
    }
    let counts: Vec<f64> = network.of_camera.iter().map(|it| it.len() as f64).collect();
    let usual_count = median(&counts).unwrap_or(0.0);
    for camera in network.calibrated() {
        let count = network.of_camera[camera].len();
        if (count as f64) < network.options.few_observations * usual_count {
            let cause = Cause::FewObservations { count, median: usual_count as usize };
            found.push(candidate(network, camera, cause, 1.0, 1.0));
        }
    }
    found
}

fn contradicting(network: &Room<'_>) -> Vec<Candidate> {
    // Nobody is accused of trifles, for which all is compared as if there were as much noise as that.
    let sigma_px = network.sigma_px.max(network.options.trifle_px);
    let mut rest = Rest {
        network: Room { sigma_px, ..network.clone() },
        out: Vec::new(),
        cameras: network.cameras(),
        points: network.positions(),
        rms_px: f64::INFINITY,
    };
    let mut found = Vec::new();
    let mut cleared: Vec<usize> = Vec::new();
    while found.len() < network.options.max_candidates {
        let (examined, usual, usual_far) = rest.examine_all();
        let mut bad: Vec<&Examined> = examined.iter().filter(|it| !cleared.contains(&it.camera)).collect();
        bad.retain(|it| rest.is_candidate(it, usual, usual_far));
        bad.sort_by(|a, b| b.mean_cost.total_cmp(&a.mean_cost));
        let tried = bad.iter().take(TRIED).filter_map(|it| rest.without(it.camera).map(|rest| (it.camera, rest)));
        let Some((camera, without)) = tried.min_by(|a, b| a.1.rms_px.total_cmp(&b.1.rms_px)) else { break };
        // Seen from a room that it did not pull at, it may be innocent.
        let (_, usual, usual_far) = without.examine_all();
        let Some(examined) = without.examine(camera) else { break };
        match without.accuse(&examined, usual, usual_far) {
            Some(candidate) => {
                found.push(candidate);
                rest = without;
            }
            None => cleared.push(camera),
        }
    }
    let (_, usual, usual_far) = rest.examine_all();
    for camera in (0..network.solved.cameras.len()).filter(|it| !is_calibrated(&network.solved.cameras[*it])) {
        let examined = rest.examine(camera);
        let far = examined.as_ref().map_or(1.0, |it| it.far);
        if far > network.options.wrong_share && rest.mirrored_far(camera).is_some_and(|it| it < LESS_FAR * far) {
            found.push(candidate(network, camera, Cause::Mirrored, f64::INFINITY, 1.0));
        } else if far <= NO_POSE {
            // With more its status says already that no pose fits.
            found.extend(examined.and_then(|it| rest.accuse(&it, usual, usual_far)));
        }
    }
    rest.find_exchanges(&mut found);
    found
}

impl Examined {
    /// By sample: squared distance in standard deviations under the fitted pose.
    fn squares(&self) -> Vec<f64> {
        self.samples.squares(&self.fitted.camera)
    }
}

impl<'a> Rest<'a> {
    fn of_the_rest(&self) -> impl Iterator<Item = usize> {
        self.network.calibrated().filter(|it| !self.out.contains(it))
    }

    /// Those of the rest; the median of their mean costs, and of their shares of far observations.
    fn examine_all(&self) -> (Vec<Examined>, f64, f64) {
        let examined: Vec<Examined> = self.of_the_rest().filter_map(|it| self.examine(it)).collect();
        let of = |value: fn(&Examined) -> f64| median(&examined.iter().map(value).collect::<Vec<_>>());
        let (usual, far) = (of(|it| it.mean_cost).unwrap_or(1.0), of(|it| it.far).unwrap_or(0.0));
        let trifle = NOISE_COST * (self.network.options.trifle_px / self.network.sigma_px).powi(2);
        (examined, usual.max(trifle).max(0.1), far)
    }

    /// `None` when too few of its observations are witnessed by two others, or no pose fits.
    fn examine(&self, camera: usize) -> Option<Examined> {
        let witnessed = self.network.witnessed(camera, &self.out, &self.cameras, &self.points, |_| true);
        if witnessed.len() < LEAST_SAMPLES {
            return None;
        }
        let start = &self.cameras[camera];
        let samples = Samples::new(&witnessed, start, self.network.sigma_px);
        let share = |camera: &Camera| self.far_share(&samples, camera);
        let known = is_calibrated(&self.network.solved.cameras[camera]);
        let mut fitted = if known { samples.fit(start, &[]) } else { None };
        if fitted.as_ref().is_none_or(|it| share(&it.camera) > SEARCH_SHARE) {
            let searched = samples.search(start, self.network.options.seed);
            let better = |it: &Fitted| fitted.as_ref().is_none_or(|other| it.cost < other.cost);
            if let Some(it) = searched.filter(better) {
                fitted = Some(it);
            }
        }
        let fitted = fitted?;
        let far = share(&fitted.camera);
        let mean_cost = fitted.cost / samples.len() as f64;
        Some(Examined { camera, samples, fitted, mean_cost, far })
    }

    /// Share of `samples` that are far from where `camera` sees them.
    fn far_share(&self, samples: &Samples, camera: &Camera) -> f64 {
        let far = samples.far(camera, FAR, self.network.options.far_px);
        far.iter().filter(|it| **it).count() as f64 / far.len().max(1) as f64
    }

    fn is_candidate(&self, examined: &Examined, usual: f64, usual_far: f64) -> bool {
        let options = self.network.options;
        let worse = examined.mean_cost / usual;
        worse > options.misfit
            || examined.far > usual_far + options.wrong_share
            || (worse > 1.0 + options.min_gain_share && self.best_cause(examined, usual).is_some())
    }

    /// Adjusted without `camera` as well; `None` when fewer than two would be left.
    fn without(&self, camera: usize) -> Option<Rest<'a>> {
        let mut rest = self.clone();
        rest.out.push(camera);
        let network = &rest.network;
        let staying: Vec<usize> = rest.of_the_rest().collect();
        let seen_by_rest = |point: &usize| {
            let by = network.of_point[*point]
                .iter()
                .filter(|it| staying.contains(&network.solved.observations[**it].camera));
            by.count() > 1
        };
        let shared: Vec<usize> = (0..network.of_point.len()).filter(seen_by_rest).collect();
        let every = shared.len().div_ceil(ENOUGH_POINTS).max(1);
        let mut observations = Vec::new();
        for &point in shared.iter().step_by(every) {
            let of_rest = network.of_point[point].iter().map(|it| &network.solved.observations[*it]);
            observations.extend(of_rest.filter(|it| staying.contains(&it.camera)).map(|it| Observation {
                camera: it.camera,
                point,
                pixel: it.pixel,
                sigma_px: network.sigma_px,
            }));
        }
        let mut freedoms = vec![Freedom::NONE; self.cameras.len()];
        // Optics that were found with this camera stay: without it the rest may know them too little to be compared with.
        for &it in &staying {
            freedoms[it] = Freedom::POSE;
        }
        let options = BundleOptions { loss: Loss::HUBER, max_iterations: 30, ..BundleOptions::default() };
        let adjusted = adjust(&self.cameras, &freedoms, &self.points, &observations, &options).ok()?;
        let squares: Vec<f64> = adjusted.residuals.iter().flatten().map(|it| it.norm_squared()).collect();
        let n = squares.len() as f64;
        let unknowns = 3.0 * shared.len().div_ceil(every) as f64 + 6.0 * staying.len() as f64;
        let freedom = (2.0 * n - unknowns).max(0.2 * n);
        let sigma = (median(&squares)? / MEDIAN_CHI2 * 2.0 * n / freedom).sqrt();
        let least = self.network.options.trifle_px.max(0.1 * self.network.sigma_px).min(self.network.sigma_px);
        rest.network.sigma_px = sigma.clamp(least, self.network.sigma_px);
        rest.rms_px = (squares.iter().map(|it| it.min(100.0 * self.network.sigma_px.powi(2))).sum::<f64>() / n).sqrt();
        (rest.cameras, rest.points) = (adjusted.cameras, adjusted.points);
        Some(rest)
    }

    fn accuse(&self, examined: &Examined, usual: f64, usual_far: f64) -> Option<Candidate> {
        let options = self.network.options;
        let misfit = examined.mean_cost / usual;
        let excess = examined.fitted.cost - usual * examined.samples.len() as f64;
        if let Some((cause, gain)) = self.best_cause(examined, usual) {
            return Some(candidate(&self.network, examined.camera, cause, misfit, (gain / excess.max(gain)).min(1.0)));
        }
        if examined.far > usual_far + options.wrong_share {
            let cause = Cause::FalseObservations { share: examined.far };
            let mut told = candidate(&self.network, examined.camera, cause, misfit, 1.0);
            if self.are_harmless(examined, usual, usual_far) {
                if examined.far < FEW_WRONG {
                    return None;
                }
                told.judgement = harmless(&self.network, examined.camera, examined.far);
            }
            return Some(told);
        }
        // The few that are far off are somebody else's light.
        let far = examined.samples.far(&examined.fitted.camera, FAR, options.far_px);
        let near: Vec<f64> = examined.squares().into_iter().zip(far).filter(|it| !it.1).map(|it| it.0).collect();
        let cost: f64 = near.iter().map(|it| Loss::CAUCHY.at(*it).0).sum();
        let misfit = cost / near.len().max(1) as f64 / usual;
        // Cameras differ in focus and lens; one that fits to a pixel is no culprit.
        let is_much = examined.samples.median_px(&examined.fitted.camera) > options.hold_out_px[0];
        (misfit > options.misfit && is_much)
            .then(|| candidate(&self.network, examined.camera, Cause::Unknown { size: misfit }, misfit, 0.0))
    }

    /// Share of its observations that are far off once its picture is turned left to right; `None` where no pose fits then.
    fn mirrored_far(&self, camera: usize) -> Option<f64> {
        let witnessed = self.network.witnessed(camera, &self.out, &self.cameras, &self.points, |_| true);
        if witnessed.len() < LEAST_SAMPLES {
            return None;
        }
        let start = &self.cameras[camera];
        let mirrored = Samples::new(&witnessed, start, self.network.sigma_px).mirrored(start.image_size[0]);
        let found = mirrored.search(start, self.network.options.seed)?;
        Some(self.far_share(&mirrored, &found.camera))
    }

    /// Whether the wrong observations of a camera were left out, and the rest suffice and fit as well as those of the
    /// other cameras.
    fn are_harmless(&self, examined: &Examined, usual: f64, usual_far: f64) -> bool {
        let (network, camera) = (&self.network, examined.camera);
        if !is_calibrated(&network.solved.cameras[camera]) || examined.far > MOST_WRONG {
            return false;
        }
        let is_used = |it: ObservationRole| it == ObservationRole::Used;
        let used = |it: usize| {
            network.of_camera[it].iter().filter(|index| is_used(network.solved.observations[**index].role)).count()
                as f64
        };
        let usual_count = median(&network.calibrated().map(used).collect::<Vec<_>>()).unwrap_or(0.0);
        if used(camera) < network.options.few_observations * usual_count
            || empty_ninths(network, camera).len() >= ALMOST_ALL
        {
            return false;
        }
        let witnessed = network.witnessed(camera, &self.out, &self.cameras, &self.points, is_used);
        let samples = Samples::new(&witnessed, &examined.fitted.camera, network.sigma_px);
        let squares = samples.squares(&examined.fitted.camera);
        let n = squares.len() as f64;
        let cost: f64 = squares.iter().map(|it| Loss::CAUCHY.at(*it).0).sum();
        let far = n * self.far_share(&samples, &examined.fitted.camera);
        squares.len() >= LEAST_SAMPLES
            && (cost <= network.options.misfit * usual * n
                || samples.median_px(&examined.fitted.camera) < network.options.hold_out_px[0])
            && far <= (usual_far + network.options.wrong_share) * n
    }

    /// The cause that lowers the cost most, and by how much; `None` if none does by enough.
    fn best_cause(&self, examined: &Examined, usual: f64) -> Option<(Cause, f64)> {
        let Examined { samples, fitted, .. } = examined;
        let mut causes: Vec<(Cause, f64)> = Vec::new();
        let freed = self.network.solved.cameras[examined.camera].freed;
        // What was to be found and was held says that the observations do not tell.
        let asked = self.network.solved.asked.get(examined.camera).copied().unwrap_or(freed);
        let before = samples.costs(fitted);
        for extra in [Extra::Focal, Extra::Distortion, Extra::Aspect, Extra::Delay] {
            // An optic that was found with the others is where they want it; without this camera they know it less, not better.
            let says_nothing = match extra {
                Extra::Focal => freed.focal || asked.focal,
                Extra::Distortion => freed.k1 || asked.k1,
                Extra::Delay => samples.moving_share() < 0.5,
                Extra::Aspect => freed.aspect || asked.aspect,
                Extra::Principal | Extra::Distortion2 => true,
            };
            if says_nothing {
                continue;
            }
            let Some(found) = samples.fit(&fitted.camera, &[extra]) else { continue };
            let cause = match extra {
                Extra::Focal => {
                    Cause::Focal { factor: found.camera.intrinsics.focal[0] / fitted.camera.intrinsics.focal[0] }
                }
                Extra::Distortion => Cause::Distortion { k1: found.camera.distortion.k1 - fitted.camera.distortion.k1 },
                Extra::Aspect => {
                    let ratio = |it: &Camera| it.intrinsics.focal[1] / it.intrinsics.focal[0];
                    Cause::PixelShape { factor: ratio(&found.camera) / ratio(&fitted.camera) }
                }
                _ => Cause::Clock { offset_s: found.delay_s, sigma_s: found.delay_sigma_s },
            };
            let far_fetched =
                matches!(cause, Cause::Focal { factor } if !(1.0 / FOCAL_FACTOR..FOCAL_FACTOR).contains(&factor));
            let gains = before.iter().zip(samples.costs(&found)).map(|(before, after)| before - after);
            let is_steady = steadiness(&gains.collect::<Vec<_>>()) > steady_enough(samples.len());
            if !far_fetched && is_steady && samples.apart_px(fitted, &found) > self.network.options.least_effect_px {
                causes.push((cause, fitted.cost - found.cost));
            }
        }
        let (cause, gain) = causes.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let excess = fitted.cost - usual * samples.len() as f64;
        let options = self.network.options;
        let trifle = samples.len() as f64 * (options.trifle_px / self.network.sigma_px).powi(2);
        let needed = (options.min_gain_share * fitted.cost).max(EXPLAINS * excess).max(options.min_gain).max(trifle);
        (gain > needed).then_some((cause, gain))
    }

    /// Names cameras whose observations fit another camera of the room, and the other way round, better than their own: candidates, and such
    /// as could not be calibrated.
    fn find_exchanges(&self, found: &mut Vec<Candidate>) {
        let median_off = |observations_of: usize, seen_by: usize| -> Option<f64> {
            let witnessed = self.network.witnessed(observations_of, &self.out, &self.cameras, &self.points, |_| true);
            if witnessed.len() < LEAST_SAMPLES {
                return None;
            }
            let camera = &self.network.solved.cameras[seen_by].camera;
            let samples = Samples::new(&witnessed, camera, self.network.sigma_px);
            Some(median(&samples.squares(camera))?.sqrt())
        };
        let is_open = |it: &usize| {
            found.iter().any(|candidate| candidate.camera == *it) || !is_calibrated(&self.network.solved.cameras[*it])
        };
        let open: Vec<usize> = (0..self.cameras.len()).filter(is_open).collect();
        for &own in &open {
            let Some(at_home) = median_off(own, own) else { continue };
            let others = open.iter().copied().filter(|it| *it != own);
            let fits = others.filter_map(|it| Some((it, median_off(own, it)?, median_off(it, own)?)));
            let swapped = fits.filter(|(_, there, back)| *there < SWAPPED_SIGMA && *back < SWAPPED_SIGMA);
            let best = swapped.min_by(|a, b| (a.1 + a.2).total_cmp(&(b.1 + b.2)));
            if let Some((with, ..)) = best.filter(|it| at_home > SWAPPED_RATIO * it.1) {
                let swap = candidate(&self.network, own, Cause::Swapped { with, since_s: None }, f64::INFINITY, 1.0);
                match found.iter_mut().find(|it| it.camera == own) {
                    Some(known) => *known = swap,
                    None => found.push(swap),
                }
            }
        }
    }
}
