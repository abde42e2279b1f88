//! Tracking of a body from message to message: start, priors from the posture before, estimation of the shape.

mod middle_line;
pub(super) mod start;

use std::collections::BTreeMap;

use foveate::geometry::metaball::{
    Body, BodyFit, BodyFitOptions, BodyObservation, Doubt, Free, Priors, RootPrior, State, anthropometric, fit_body,
};
use foveate::prelude::*;
use nalgebra::{Point3, Vector3};

use self::start::Refused;
use super::message::{Before, skeleton_of};
use super::outline::Outline;

/// A lever with which turns become shifts of the root [m].
const LEVER_M: f64 = 0.3;
/// Where more of the points lie off a body, it lies elsewhere: of right fits of simulated arms it is 3 % at most and of wrong ones 15 to 33 %, of right fits of simulated people, whose clothes hang off, 11 to 14 % and of wrong ones 23 % and more [–].
const MOST_OFF_ARM: f64 = 0.1;
const MOST_OFF_PERSON: f64 = 0.18;
/// Fewer points are no body [–].
const LEAST_POINTS: usize = 20;
/// How well a person's height is known that was said "about", beside people's spread of 4 % about their mean [–].
const STATURE_SIGMA: f64 = 0.08;
/// Prior of a person's girth and clothing, stature included: common standard deviation of the thicknesses of all limbs [–].
const GIRTH_SIGMA: f64 = 0.15;
/// How far lengths of limbs are from what goes with the stature: the spread of 6 % of all people less that of their stature, 4 % [–].
const LENGTH_SIGMA: f64 = 0.045;
/// The same of upper arms: how far below the acromion the joint of the shoulder lies no surface shows, and studies differ by 7 % either way (see `foveate::geometry::metaball::person`).
const UPPER_ARM_SIGMA: f64 = 0.07;
/// Lengths of people farther from what goes with their stature are no people's: three standard deviations of all people, 6 % [σ of [`LENGTH_SIGMA`]].
const MOST_LENGTH_SIGMAS: f64 = 4.0;
/// A body of more lengths is no arm.
const ARM_SCALES: usize = 3;
/// Lines of sight that pass farther from all points of an arm are of the rest of the person [m].
const OUTLINE_REACH_M: f64 = 0.25;
/// How far hands and feet of people who do something else with their limbs are bent from where they rest: standard deviation of each angle [rad].
const EXTREMITY_SIGMA: f64 = 0.35;

/// How a body is tracked.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rules {
    pub clicked_m: f64,
    pub points: usize,
    pub slide_m: f64,
    pub turn_rad_s: f64,
    pub silhouette_px: f64,
    pub shape_frames: u32,
    pub options: BodyFitOptions,
}

/// Why there is no body: a key and a text.
pub(super) type Refusal = (&'static str, String);

/// Result for a message.
pub(super) enum Outcome {
    Followed(Box<Frame>),
    Refused { kind: &'static str, reason: String },
}

/// A body at one time.
pub(super) struct Frame {
    pub fit: BodyFit,
    pub skeleton: Skeleton,
    /// Segments without supporting points.
    pub unsupported: Vec<usize>,
    pub n_points: usize,
    /// Lengths and radii were sought, too.
    pub is_shaping: bool,
}

/// The message before.
struct Last {
    time: Time,
    state: State,
    joints: Before,
    /// Segments that points said nothing of.
    unsupported: Vec<usize>,
}

/// The body so far.
pub(super) struct BodyTracker {
    body: Body,
    template: State,
    rules: Rules,
    /// Logarithms of scales and radii, summed, and over how many messages.
    shape: (Vec<f64>, u32),
    last: Option<Last>,
    /// Places of tracked points on their segments, of the template's length [m].
    places: BTreeMap<u32, (usize, Vector3<f64>)>,
    /// The last clicks that no body was begun from.
    refused: Option<Refused>,
}

impl BodyTracker {
    pub fn new(body: Body, template: State, rules: Rules) -> Self {
        Self { body, template, rules, shape: (Vec::new(), 0), last: None, places: BTreeMap::new(), refused: None }
    }

    pub fn body(&self) -> &Body {
        &self.body
    }

    /// Thickness over that of the template, once it is known [–].
    pub fn girth(&self) -> Option<f64> {
        let state = self.shaped(&self.template)?;
        let ratio = |(now, before): (&Vector3<f64>, &Vector3<f64>)| now.component_div(before).xy().map(f64::ln).mean();
        let sum: f64 = state.radii.iter().zip(&self.template.radii).map(ratio).sum();
        Some((sum / state.radii.len() as f64).exp())
    }

    /// A state with the mean shape so far.
    fn shaped(&self, posture: &State) -> Option<State> {
        let (sums, n) = (&self.shape.0, self.shape.1);
        if n == 0 {
            return None;
        }
        let mean = |place: usize| (sums[place] / f64::from(n)).exp();
        let n_scales = posture.scales.len();
        Some(State {
            scales: (0..n_scales).map(mean).collect(),
            radii: (0..posture.radii.len())
                .map(|ball| Vector3::from_fn(|axis, _| mean(n_scales + 3 * ball + axis)))
                .collect(),
            ..posture.clone()
        })
    }

    fn learn(&mut self, state: &State) {
        let values: Vec<f64> =
            state.scales.iter().copied().chain(state.radii.iter().flat_map(|it| it.iter().copied())).collect();
        self.shape.0.resize(values.len(), 0.0);
        self.shape.0.iter_mut().zip(values).for_each(|(sum, value)| *sum += value.ln());
        self.shape.1 += 1;
    }

    /// The body in a message, with the borders of silhouettes of its moment; `clicks` by their places in [`BODY_JOINTS`], for a start.
    pub fn track(
        &mut self,
        surface: &TrackedSurface,
        clicks: &BTreeMap<usize, Point3<f64>>,
        outlines: &[&Outline],
    ) -> Outcome {
        let points: Vec<&TrackedPoint> =
            surface.list.iter().filter(|it| it.position.iter().all(|it| it.is_finite())).collect();
        if points.len() < LEAST_POINTS {
            self.forget();
            let reason = format!("{} points, expected {LEAST_POINTS} at least", points.len());
            return Outcome::Refused { kind: "few_points", reason };
        }
        let stride = points.len().div_ceil(self.rules.points);
        // By identity, not by place in the message: the same points from message to message.
        let chosen: Vec<&TrackedPoint> =
            points.iter().copied().filter(|it| stride == 1 || (it.id as usize).is_multiple_of(stride)).collect();
        let chosen = if chosen.len() < LEAST_POINTS { points } else { chosen };
        let rays = self.rays(&chosen, outlines);
        let found = match &self.last {
            Some(last) if surface.time > last.time => {
                let since_s = (surface.time - last.time).as_s();
                match self.near(&chosen, &rays, last, since_s) {
                    Ok(fit) if rejection(&fit).is_none() => Ok(fit),
                    _ => self.restart(&chosen, &rays, clicks),
                }
            }
            _ => self.restart(&chosen, &rays, clicks),
        };
        let fit = match found {
            Ok(fit) => fit,
            Err((kind, reason)) => {
                self.forget();
                return Outcome::Refused { kind, reason };
            }
        };
        if let Some((kind, reason)) = rejection(&fit) {
            self.forget();
            return Outcome::Refused { kind, reason };
        }
        Outcome::Followed(Box::new(self.accept(surface.time, &chosen, fit)))
    }

    /// After a message without a body nothing of its posture is known any more; its shape is.
    fn forget(&mut self) {
        self.last = None;
        self.places.clear();
    }

    fn accept(&mut self, time: Time, chosen: &[&TrackedPoint], fit: BodyFit) -> Frame {
        let is_shaping = self.shape.1 < self.rules.shape_frames;
        if is_shaping {
            self.learn(&fit.state);
        }
        let posed = self.body.skeleton.pose(&fit.state);
        for (index, point) in chosen.iter().enumerate() {
            // Points come first among the observations.
            let is_on_it =
                fit.distances_m[index].abs() < self.rules.options.outlier_sigmas * self.rules.options.model_sigma_m;
            if let Some(segment) = fit.segments[index].filter(|_| is_on_it) {
                let local = posed.world_from_segment[segment].inverse_transform_point(&point.position).coords;
                let scale = fit.state.scales[self.body.skeleton.segments()[segment].scale];
                self.places.entry(point.id).or_insert((segment, local / scale));
            }
        }
        let cameras = chosen.iter().flat_map(|it| it.cameras.iter()).collect();
        let unsupported: Vec<usize> = (0..self.body.skeleton.segments().len())
            .filter(|it| {
                let name = &self.body.skeleton.segments()[*it].name;
                fit.doubts.iter().any(|doubt| matches!(doubt, Doubt::Unsupported { segment, .. } if segment == name))
            })
            .collect();
        let before = self.last.take();
        let before = before.as_ref().map(|it| ((time - it.time).as_s(), &it.joints));
        let (skeleton, now) = skeleton_of(&self.body, &fit, &unsupported, before, cameras);
        self.last = Some(Last { time, state: fit.state.clone(), joints: now, unsupported: unsupported.clone() });
        Frame { fit, skeleton, unsupported, n_points: chosen.len(), is_shaping }
    }

    /// Observations of the surface, points first.
    fn observed(&self, chosen: &[&TrackedPoint]) -> Vec<BodyObservation> {
        let sigma = |it: &TrackedPoint| (it.covariance.trace() / 3.0).max(0.0).sqrt().clamp(1e-5, 0.1);
        chosen.iter().map(|it| BodyObservation::Point { at: it.position, sigma_m: sigma(it), segment: None }).collect()
    }

    /// Lines of sight that touch the body. All of them for a person; for an arm only those that pass near its points.
    fn rays(&self, chosen: &[&TrackedPoint], outlines: &[&Outline]) -> Vec<BodyObservation> {
        let n = chosen.len().max(1) as f64;
        let centroid = chosen.iter().fold(Vector3::zeros(), |sum, it| sum + it.position.coords) / n;
        let near = (self.body.skeleton.n_scales() <= ARM_SCALES).then_some((chosen, OUTLINE_REACH_M));
        outlines.iter().flat_map(|it| it.observed(&centroid, self.rules.silhouette_px, near)).collect()
    }

    /// From the posture before.
    fn near(
        &self,
        chosen: &[&TrackedPoint],
        rays: &[BodyObservation],
        last: &Last,
        since_s: f64,
    ) -> Result<BodyFit, Refusal> {
        let mut all = self.observed(chosen);
        all.extend_from_slice(rays);
        if self.rules.slide_m > 0.0 {
            all.extend(chosen.iter().filter_map(|it| {
                let (segment, place) = *self.places.get(&it.id)?;
                Some(BodyObservation::Anchored { segment, place, at: it.position, sigma_m: self.rules.slide_m })
            }));
        }
        let turn = (self.rules.turn_rad_s * since_s).max(1e-3);
        let start = self.known(&last.state);
        let root = RootPrior { world_from_root: start.world_from_root, turn_sigma: turn, shift_sigma: turn * LEVER_M };
        let mut angles: Vec<(f64, f64)> = start.angles.iter().map(|it| (*it, turn)).collect();
        self.rest(&mut angles, |segment| last.unsupported.contains(&segment));
        let priors = Priors { root: Some(root), angles, ..self.usual() };
        let options = BodyFitOptions { free: self.free(), rough: false, ..self.rules.options.clone() };
        fit_body(&self.body, &all, &start, &priors, &options).map_err(|it| ("no_start", it.to_string()))
    }

    /// Hands and feet, of those that `are_meant`, are known to go with forearm and shank: without points they would hang as they happened to be.
    fn rest(&self, angles: &mut [(f64, f64)], are_meant: impl Fn(usize) -> bool) {
        let bones = &self.body.skeleton;
        for (segment, it) in bones.segments().iter().enumerate() {
            if is_extremity(&it.name) && are_meant(segment) {
                bones.angles_of(segment).for_each(|it| angles[it] = (self.template.angles[it], EXTREMITY_SIGMA));
            }
        }
    }

    /// What is known of sizes. A whole person says its stature and girth by itself; of an arm too little is seen.
    fn usual(&self) -> Priors {
        let mut priors = anthropometric(&self.template);
        if self.body.skeleton.n_scales() > ARM_SCALES {
            priors.stature = STATURE_SIGMA;
            priors.scales.iter_mut().for_each(|it| it.1 = LENGTH_SIGMA);
            let bones = self.body.skeleton.segments();
            for it in bones.iter().filter(|it| it.name.starts_with("upper_arm")) {
                priors.scales[it.scale].1 = UPPER_ARM_SIGMA;
            }
            priors.radii.iter_mut().for_each(|it| it.girth = GIRTH_SIGMA);
        }
        priors
    }

    /// With the shape that is kept, once there is one.
    fn known(&self, state: &State) -> State {
        if self.shape.1 < self.rules.shape_frames {
            state.clone()
        } else {
            self.shaped(state).unwrap_or_else(|| state.clone())
        }
    }

    fn free(&self) -> Free {
        if self.shape.1 < self.rules.shape_frames { Free::ALL } else { Free::POSTURE }
    }
}

fn is_extremity(segment: &str) -> bool {
    segment.starts_with("hand") || segment.starts_with("foot")
}

/// Whether a segment may grow over a hand or foot: as long as that is, it is not believed to be.
fn is_before_extremity(segment: &str) -> bool {
    segment.starts_with("forearm") || segment.starts_with("shank")
}

/// Why a fit is rejected: a key and a text. A fit with a limb or two without points is accepted, if the others have some.
pub(super) fn rejection(fit: &BodyFit) -> Option<Refusal> {
    let is_person = fit.state.scales.len() > ARM_SCALES;
    let most_off = if is_person { MOST_OFF_PERSON } else { MOST_OFF_ARM };
    if fit.off_share > most_off {
        let reason = format!(
            "{:.0} % of the points are off the body, expected {:.0} % at most: a limb is misplaced, many points belong to something else, or clothes stand off by more than `model_mm`",
            1e2 * fit.off_share,
            1e2 * most_off
        );
        return Some(("elsewhere", reason));
    }
    let supported = fit.support.iter().filter(|it| **it > 0.0).count();
    let unsupported = fit.doubts.iter().filter(|it| matches!(it, Doubt::Unsupported { .. })).count();
    for doubt in &fit.doubts {
        match doubt {
            // Where the trunk ends and the pelvis begins no surface shows: one is long, or thick, where the other is not.
            Doubt::Misshapen { segment, .. } if segment == "pelvis" || is_extremity(segment) => (),
            Doubt::Misshapen { segment, what, sigmas, most } => {
                let is_of_a_person = is_person && *what == "length" && !is_before_extremity(segment);
                let most = if is_of_a_person { MOST_LENGTH_SIGMAS } else { *most };
                if sigmas.abs() > most {
                    let doubt = Doubt::Misshapen { segment: segment.clone(), what, sigmas: *sigmas, most };
                    return Some(("misshapen", doubt.to_string()));
                }
            }
            Doubt::Unsupported { .. } if unsupported > supported => {
                return Some(("few_limbs", doubt.to_string()));
            }
            _ => (),
        }
    }
    // Nothing but hands, feet or a single limb.
    (supported < 2).then(|| ("few_limbs", format!("found points on {supported} of its segments, expected 2 at least")))
}
