//! A body from message to message: starts, priors from the posture before, the shape that is learnt and kept.

use std::collections::BTreeMap;

use foveate::geometry::metaball::{
    Body, BodyFit, BodyFitOptions, BodyObservation, Doubt, Free, Priors, RootPrior, State, anthropometric, fit_body,
};
use foveate::prelude::*;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::clicks;
use super::message::{Before, joint_place, skeleton_of};
use super::outline::Outline;

/// An arm that was found without clicks and is farther from what people have may lie back to front: of the simulated arm that is 22 to 23 (`graphs/surface_body.toml` without `joints`, seeds 2 to 5) [–].
const MOST_OFF: f64 = 15.0;
/// A lever with which turns become shifts of the root [m].
const LEVER_M: f64 = 0.3;
/// Fewer points are no body [–].
const LEAST_POINTS: usize = 20;
/// How many clicked joints start a body.
const LEAST_CLICKS: usize = 3;
/// How well a person's height is known that was said "about", beside people's spread of 4 % about their mean [–].
const STATURE_SIGMA: f64 = 0.08;
/// How well it is known how stout and how thickly dressed somebody is, stature included: standard deviation of what the thicknesses of all limbs have in common [–].
const GIRTH_SIGMA: f64 = 0.15;
/// How far lengths of limbs are from what goes with the stature: the spread of 6 % of all people less that of their stature, 4 % [–].
const LENGTH_SIGMA: f64 = 0.045;
/// The same of upper arms: how far below the acromion the joint of the shoulder lies no surface shows, and studies differ by 7 % either way (see `foveate::geometry::metaball::person`).
const UPPER_ARM_SIGMA: f64 = 0.07;
/// Lengths of people farther from what goes with their stature are no people's: three standard deviations of all people, 6 % [σ of [`LENGTH_SIGMA`]].
const MOST_LENGTH_SIGMAS: f64 = 4.0;
/// Clicked joints under other names are right where all that does not fit is less by this factor and by so much: of simulated arms and people in right order it is a half of that in any other at most, and mostly a fifth [–].
const MUCH_BETTER: f64 = 2.0;
const CLEARLY: f64 = 4.0;
const CLEARLY_IN_SIZE: f64 = 2.0;
/// What points off the body count beside squared standard deviations, all of them: as much as lengths and clicks that are far off [–].
const OFF_WEIGHT: f64 = 50.0;
/// Points may be farther by so much from a body whose lengths are people's than from one whose lengths are not [–].
const AS_NEAR: f64 = 1.1;
/// A point is of no part of the body as it lies when it is farther from its surface: cloth hangs off by less [m].
const STRAY_M: f64 = 0.05;
/// Within this of each other such points are of one limb: about half of a shank [m].
const STRAY_REACH_M: f64 = 0.15;
/// Of all points, so many that lie together and off are no accident: of 120 right fits of simulated people 1.1 % at most, and a shank has 6 % [–].
const MOST_STRAY: f64 = 0.02;
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

/// What became of a message.
pub(super) enum Outcome {
    Followed(Box<Frame>),
    Refused { kind: &'static str, reason: String },
}

/// A body at one time.
pub(super) struct Frame {
    pub fit: BodyFit,
    pub skeleton: Skeleton,
    /// Segments that points say nothing of.
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
}

impl BodyTracker {
    pub fn new(body: Body, template: State, rules: Rules) -> Self {
        Self { body, template, rules, shape: (Vec::new(), 0), last: None, places: BTreeMap::new() }
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
                    Ok(fit) if blame(&fit).is_none() => Ok(fit),
                    _ => self.anew(&chosen, &rays, clicks),
                }
            }
            _ => self.anew(&chosen, &rays, clicks),
        };
        let fit = match found {
            Ok(fit) => fit,
            Err((kind, reason)) => {
                self.forget();
                return Outcome::Refused { kind, reason };
            }
        };
        if let Some((kind, reason)) = blame(&fit) {
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

    /// Lines of sight that touch the body. Of a person all do; those of an arm are told from the rest of the person by the points that they pass.
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
    ) -> Result<BodyFit, (&'static str, String)> {
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

    /// A forearm may grow over a hand, and its sleeve over both: a minimum of its own, whose lengths few people have. There the posture is sought once more with lengths that go with the
    /// stature, and from it all; what comes of that is taken where it is like people and points are as near to it.
    fn in_proportion(&self, found: BodyFit, observations: &[BodyObservation], options: &BodyFitOptions) -> BodyFit {
        if self.body.skeleton.n_scales() <= ARM_SCALES || !options.free.scales || !has_odd_length(&found) {
            return found;
        }
        let log: f64 =
            found.state.scales.iter().zip(&self.template.scales).map(|(now, usual)| (now / usual).ln()).sum();
        let stature = (log / found.state.scales.len() as f64).clamp(-STATURE_SIGMA, STATURE_SIGMA).exp();
        let start =
            State { scales: self.template.scales.iter().map(|it| it * stature).collect(), ..found.state.clone() };
        let usual = self.usual();
        let mut priors =
            Priors { radii: usual.radii, scales: usual.scales, stature: usual.stature, ..anthropometric(&start) };
        self.rest(&mut priors.angles, |_| true);
        let search = |start: &State, free: Free, rough: bool| {
            let options = BodyFitOptions { free, rough, ..options.clone() };
            fit_body(&self.body, observations, start, &priors, &options).ok()
        };
        let fit = search(&start, Free::POSTURE, true).and_then(|it| search(&it.state, options.free, false));
        let most_m = AS_NEAR * found.rms_m;
        let is_better = |it: &BodyFit| blame(it).is_none() && !has_odd_length(it) && it.rms_m < most_m;
        fit.filter(is_better).unwrap_or(found)
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

    /// All that does not fit of a body that was begun from clicks, the last `n_clicks` of its observations: squared standard deviations of points in the mean, of clicks, lengths and thicknesses, and the points that are off it.
    fn misfit(&self, fit: &BodyFit, n_clicks: usize) -> f64 {
        let clicks = &fit.distances_m[fit.distances_m.len() - n_clicks..];
        let off_clicks: f64 = clicks.iter().map(|it| (it / self.rules.clicked_m).powi(2)).sum();
        let share = fit.outliers as f64 / (fit.distances_m.len() - n_clicks).max(1) as f64;
        let of_points = (fit.rms_m / self.rules.options.model_sigma_m).powi(2);
        of_points + off_clicks + off_people(&fit.state, &self.template) + OFF_WEIGHT * share
    }

    /// From clicked joints, or from the points alone.
    fn anew(
        &self,
        chosen: &[&TrackedPoint],
        rays: &[BodyObservation],
        clicks: &BTreeMap<usize, Point3<f64>>,
    ) -> Result<BodyFit, (&'static str, String)> {
        let mut start = self.known(&self.template);
        let points = [&self.observed(chosen)[..], rays].concat();
        let clicks: Vec<(usize, Point3<f64>)> =
            clicks.iter().map(|it| (*it.0, *it.1)).filter(|it| joint_place(&self.body, it.0).is_some()).collect();
        let clicked_m = self.rules.clicked_m;
        let anchors = clicks::anchors(&self.body, &clicks, clicked_m);
        let options = BodyFitOptions { free: self.free(), ..self.rules.options.clone() };
        let n = chosen.len() as f64;
        let centroid = chosen.iter().fold(Vector3::zeros(), |sum, it| sum + it.position.coords) / n;
        let is_clicked = anchors.len() >= LEAST_CLICKS;
        let fit = |start: &State, observations: &[BodyObservation], options: &BodyFitOptions| {
            let usual = self.usual();
            let mut priors =
                Priors { radii: usual.radii, scales: usual.scales, stature: usual.stature, ..anthropometric(start) };
            if is_clicked {
                self.rest(&mut priors.angles, |_| true);
            }
            // Nothing says which way it faces, nor more than roughly where it is.
            priors.root = Some(RootPrior { world_from_root: start.world_from_root, turn_sigma: 2.0, shift_sigma: 0.3 });
            fit_body(&self.body, observations, start, &priors, options).map_err(|it| ("no_start", it.to_string()))
        };
        if is_clicked {
            if let Some(reason) = clicks::too_far_apart(&self.body, &self.template, &clicks, clicked_m) {
                return Err(("no_start", reason));
            }
            start.world_from_root.translation.vector = centroid;
            let clicked = [&points[..], &anchors].concat();
            let found = self.in_proportion(fit(&start, &clicked, &options)?, &clicked, &options);
            let is_person = self.body.skeleton.n_scales() > ARM_SCALES;
            let n_clicks = anchors.len();
            let own = self.misfit(&found, n_clicks);
            for other in clicks::other_readings(&self.body, &self.template, &clicks, clicked_m, is_person) {
                let anchors = clicks::anchors(&self.body, &other.clicks, clicked_m);
                let Ok(turned) = fit(&start, &[&points[..], &anchors].concat(), &options) else { continue };
                let misfit = self.misfit(&turned, n_clicks);
                let is_better = MUCH_BETTER * misfit < own && misfit + CLEARLY < own;
                // An arm alone is nearly as right the other way round: there how long and thick it is decides.
                let [size, turned_size] = [&found, &turned].map(|it| off_people(&it.state, &self.template));
                let is_like_people = !is_person
                    && turned.rms_m < found.rms_m.max(self.rules.options.model_sigma_m)
                    && MUCH_BETTER * turned_size < size
                    && turned_size + CLEARLY_IN_SIZE < size;
                if is_better || is_like_people {
                    let reason = format!(
                        "{} look exchanged: as they are, points, clicks, lengths and thicknesses are {own:.1} squared standard deviations off a person's, exchanged {misfit:.1}",
                        other.what
                    );
                    return Err(("no_start", reason));
                }
            }
            if self.body.skeleton.n_scales() > ARM_SCALES
                && let Some(reason) = stray(chosen, &found)
            {
                return Err(("elsewhere", reason));
            }
            return Ok(found);
        }
        if self.body.skeleton.n_scales() > ARM_SCALES {
            let reason = format!("{} clicked joints of the model, expected {LEAST_CLICKS} at least", anchors.len());
            return Err(("no_start", reason));
        }
        // An arm by itself: tried along the points' longest axis, either way, in four turns about it.
        let longest = longest_axis(chosen, &centroid);
        let mut best: Option<(f64, BodyFit)> = None;
        // Which way it lies is told by its joints more than by anything: they count in full.
        let options = BodyFitOptions { joint_sigma_m: 0.0, ..options };
        for way in [longest, -longest] {
            let along = UnitQuaternion::rotation_between(&Vector3::z(), &way)
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
            for quarter in 0..4 {
                let about = std::f64::consts::FRAC_PI_2 * f64::from(quarter);
                let rotation = along * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), about);
                let reach: f64 = self.body.skeleton.segments().iter().map(|it| it.length).sum();
                let shoulder = centroid - way * (0.5 * reach);
                let mut state = start.clone();
                state.world_from_root = Isometry3::from_parts(shoulder.into(), rotation);
                state.angles[0] = 0.5;
                // One or two joints that were clicked say which way it lies.
                let found = fit(&state, &[&points[..], &anchors].concat(), &options)?;
                let off = found.distances_m[points.len()..].iter().map(|it| (it / self.rules.clicked_m).powi(2));
                let clicks = 1.0 + off.sum::<f64>();
                let cost = clicks * found.rms_m * (1.0 + found.outliers as f64 / n) + found.doubts.len() as f64;
                if best.as_ref().is_none_or(|it| cost < it.0) {
                    best = Some((cost, found));
                }
            }
        }
        let (_, found) = best.ok_or(("no_start", "no way to lie in the points".to_owned()))?;
        let off = off_people(&found.state, &self.template);
        if off > MOST_OFF {
            let reason = format!(
                "without {LEAST_CLICKS} clicked joints it is not clear which way the arm lies: the best one has lengths and thicknesses that few people have ({off:.0} in squared standard deviations, \
                 expected {MOST_OFF} at most); expected `clicked` or `joints`"
            );
            return Err(("no_start", reason));
        }
        Ok(found)
    }
}

/// Whether a segment is longer or shorter than in most people.
fn has_odd_length(fit: &BodyFit) -> bool {
    fit.doubts.iter().any(|it| matches!(it, Doubt::Misshapen { what: "length", .. }))
}

/// What is said of points that lie together and off the body: as a shank does whose knee is bent the wrong way. They are fewer than what tells that the whole body lies elsewhere.
pub(super) fn stray(chosen: &[&TrackedPoint], fit: &BodyFit) -> Option<String> {
    let is_far = |it: &f64| it.is_nan() || it.abs() > STRAY_M;
    let far: Vec<Point3<f64>> =
        chosen.iter().zip(&fit.distances_m).filter(|it| is_far(it.1)).map(|it| it.0.position).collect();
    let beside = |at: &Point3<f64>| far.iter().filter(|it| (*it - at).norm() < STRAY_REACH_M).count();
    let (most, at) = far.iter().map(|it| (beside(it), it)).max_by_key(|it| it.0)?;
    let share = most as f64 / chosen.len() as f64;
    (share > MOST_STRAY).then(|| {
        let [x, y, z]: [f64; 3] = at.coords.into();
        format!(
            "{most} of {} points, together about ({x:.2}, {y:.2}, {z:.2}) m, lie more than {:.0} mm off the body, expected {:.0} at most: a limb lies elsewhere than the body has it; expected clicked joints \
             nearer to where they are",
            chosen.len(),
            1e3 * STRAY_M,
            MOST_STRAY * chosen.len() as f64
        )
    })
}

/// How far lengths and thicknesses are from what people have: the sum of squares, in standard deviations.
fn off_people(state: &State, template: &State) -> f64 {
    let usual = anthropometric(template);
    let lengths = state.scales.iter().zip(&usual.scales).map(|(it, (mean, sigma))| ((it / mean).ln() / sigma).powi(2));
    let sigma = usual.radii.as_ref().map_or(1.0, |it| it.thickness);
    let thick =
        |(now, usual): (&Vector3<f64>, &Vector3<f64>)| now.component_div(usual).xy().map(f64::ln).mean() / sigma;
    lengths.sum::<f64>() + state.radii.iter().zip(&template.radii).map(|it| thick(it).powi(2)).sum::<f64>()
}

/// The direction in which points spread most, of length 1.
fn longest_axis(points: &[&TrackedPoint], centroid: &Vector3<f64>) -> Vector3<f64> {
    let spread = points.iter().fold(nalgebra::Matrix3::zeros(), |sum, it| {
        let off = it.position.coords - centroid;
        sum + off * off.transpose()
    });
    let eigen = spread.symmetric_eigen();
    eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned()
}

fn is_extremity(segment: &str) -> bool {
    segment.starts_with("hand") || segment.starts_with("foot")
}

/// Whether a segment may grow over a hand or foot: as long as that is, it is not believed to be.
fn is_before_extremity(segment: &str) -> bool {
    segment.starts_with("forearm") || segment.starts_with("shank")
}

/// Why a fit is not believed: in short, and in words. One without points on a limb or two is, if the others have some.
pub(super) fn blame(fit: &BodyFit) -> Option<(&'static str, String)> {
    let is_person = fit.state.scales.len() > ARM_SCALES;
    let supported = fit.support.iter().filter(|it| **it > 0.0).count();
    let unsupported = fit.doubts.iter().filter(|it| matches!(it, Doubt::Unsupported { .. })).count();
    for doubt in &fit.doubts {
        match doubt {
            Doubt::Elsewhere { .. } => return Some(("elsewhere", doubt.to_string())),
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
    (supported < 2).then(|| ("few_limbs", format!("points on {supported} of its segments, expected 2 at least")))
}
