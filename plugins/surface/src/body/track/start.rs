//! Start of a body: from clicked joints, or from the points alone.

use std::collections::BTreeMap;

use foveate::geometry::metaball::{
    BodyFit, BodyFitOptions, BodyObservation, Doubt, Free, Priors, RootPrior, State, anthropometric, fit_body,
};
use foveate::prelude::*;
use nalgebra::{Point3, Vector3};

use super::middle_line::MiddleLine;
use super::{ARM_SCALES, BodyTracker, Refusal, STATURE_SIGMA, rejection};
use crate::body::clicks;
use crate::body::message::{joint_place, place};

/// An arm that was found without clicks and is farther from what people have may lie back to front: of the simulated arm that is 22 to 23 (`graphs/surface_body.toml` without `joints`, seeds 2 to 5) [–].
const MOST_OFF: f64 = 15.0;
/// How many clicked joints start a body.
const LEAST_CLICKS: usize = 3;
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
/// A click that is farther off says no more than that it is wrong: three standard deviations [squared σ].
const MOST_OF_A_CLICK: f64 = 9.0;
/// Two orientations of an arm are distinguished where the total misfit of one is lower by this: of the simulated arm without a click (`graphs/surface_body.toml` without `joints`, seeds 1 to 8) that is
/// 3 to 8 in the right one, and by 10 at least more in the next; of the arm of tubes in the tests 4.7 and 8.2; and other ways they are where a joint is so far off [squared σ, m].
const CLEARLY_LESS: f64 = 3.0;
const APART_M: f64 = 0.08;
/// Relative statures that are tried, to detect a wrong `height_m` [–].
const OTHER_HEIGHTS: [f64; 2] = [0.8, 1.25];
/// Joints of an arm are tried so far apart along the points' middle line, and the first up to so far before it: a fit comes in from about 8 cm [m].
const SLID_M: f64 = 0.06;
const SLACK_M: f64 = 0.06;
/// Places of an arm along the points at most [–].
const MOST_SLID: usize = 6;

impl BodyTracker {
    /// From clicked joints, or from the points alone.
    pub(super) fn restart(
        &mut self,
        chosen: &[&TrackedPoint],
        rays: &[BodyObservation],
        clicks: &BTreeMap<usize, Point3<f64>>,
    ) -> Result<BodyFit, Refusal> {
        let clicks: Vec<(usize, Point3<f64>)> =
            clicks.iter().map(|it| (*it.0, *it.1)).filter(|it| joint_place(&self.body, it.0).is_some()).collect();
        let n = chosen.len() as f64;
        let mut start = self.known(&self.template);
        start.world_from_root.translation.vector =
            chosen.iter().fold(Vector3::zeros(), |sum, it| sum + it.position.coords) / n;
        let beginning = Beginning {
            tracker: self,
            chosen,
            points: [&self.observed(chosen)[..], rays].concat(),
            is_doubted: self.refused.as_ref().filter(|it| it.clicks == clicks).is_none_or(|it| it.n.is_power_of_two()),
            clicks,
            start,
            options: BodyFitOptions { free: self.free(), ..self.rules.options.clone() },
        };
        if beginning.clicks.len() < LEAST_CLICKS {
            return beginning.unclicked();
        }
        let (misfit, found) = beginning.clicked();
        let again = self.refused.as_ref().filter(|it| it.clicks == beginning.clicks);
        let found = no_worse(found, misfit, again);
        let is_of_clicks = |why: &Refusal| ["no_start", "elsewhere"].contains(&why.0);
        self.refused = match &found {
            Err(why) if is_of_clicks(why) => {
                let misfit = again.map_or(misfit, |it| it.misfit.min(misfit));
                let n = again.map_or(0, |it| it.n) + 1;
                Some(Refused { clicks: beginning.clicks, n, misfit, why: why.clone() })
            }
            _ => None,
        };
        found
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
        let is_better = |it: &BodyFit| rejection(it).is_none() && !has_odd_length(it) && it.rms_m < most_m;
        fit.filter(is_better).unwrap_or(found)
    }
}

/// A start from clicks that were refused before: what they were refused for has not gone where as much does not fit, it has only passed its limit by chance.
fn no_worse<T>(found: Result<T, Refusal>, misfit: f64, before: Option<&Refused>) -> Result<T, Refusal> {
    match before {
        Some(before) if misfit + CLEARLY > before.misfit => found.and(Err(before.why.clone())),
        _ => found,
    }
}

/// Clicks from which no body was started.
#[derive(Debug, Clone)]
pub(super) struct Refused {
    clicks: Vec<(usize, Point3<f64>)>,
    /// How often.
    n: u32,
    /// All that did not fit of what came of them, the clicks left out.
    misfit: f64,
    why: Refusal,
}

/// Data of a start.
struct Beginning<'a> {
    tracker: &'a BodyTracker,
    chosen: &'a [&'a TrackedPoint],
    /// Points of the surface, then lines of sight.
    points: Vec<BodyObservation>,
    clicks: Vec<(usize, Point3<f64>)>,
    /// Whether other starts are tried where what comes of the clicks does not fit: of a person they take seconds, and of clicks that were refused again and again they are tried ever more seldom.
    is_doubted: bool,
    /// The template amid the points.
    start: State,
    options: BodyFitOptions,
}

impl Beginning<'_> {
    fn is_person(&self) -> bool {
        self.tracker.body.skeleton.n_scales() > ARM_SCALES
    }

    fn anchors(&self, clicks: &[(usize, Point3<f64>)]) -> Vec<BodyObservation> {
        clicks::anchors(&self.tracker.body, clicks, self.tracker.rules.clicked_m)
    }

    /// From a state, with joints that were clicked or are tried.
    fn fit(&self, start: &State, anchors: &[BodyObservation], options: &BodyFitOptions) -> Result<BodyFit, Refusal> {
        self.fit_of(self.tracker.usual(), start, anchors, options)
    }

    /// The same with size priors `usual`.
    fn fit_of(
        &self,
        usual: Priors,
        start: &State,
        anchors: &[BodyObservation],
        options: &BodyFitOptions,
    ) -> Result<BodyFit, Refusal> {
        let tracker = self.tracker;
        let mut priors =
            Priors { radii: usual.radii, scales: usual.scales, stature: usual.stature, ..anthropometric(&self.start) };
        tracker.rest(&mut priors.angles, |_| true);
        // Nothing says which way it faces, nor more than roughly where it is.
        let world_from_root = self.start.world_from_root;
        priors.root = Some(RootPrior { world_from_root, turn_sigma: 2.0, shift_sigma: 0.3 });
        let all = [&self.points[..], anchors].concat();
        fit_body(&tracker.body, &all, start, &priors, options).map_err(|it| ("no_start", it.to_string()))
    }

    /// The same from joints, which say roughly how it stands.
    fn fit_from(&self, clicks: &[(usize, Point3<f64>)]) -> Result<BodyFit, Refusal> {
        let anchors = self.anchors(clicks);
        let found = self.fit(&self.start, &anchors, &self.options)?;
        Ok(self.tracker.in_proportion(found, &[&self.points[..], &anchors].concat(), &self.options))
    }

    /// All that does not fit: squared standard deviations of points in the mean, of clicks, each `most_of_a_click` at most, of lengths and thicknesses, and the points that are off it.
    fn misfit(&self, fit: &BodyFit, clicks: &[(usize, Point3<f64>)], most_of_a_click: f64) -> f64 {
        let clicked_m = self.tracker.rules.clicked_m;
        let posed = self.tracker.body.skeleton.pose(&fit.state);
        let off = |(joint, at): &(usize, Point3<f64>)| {
            let anchor = joint_place(&self.tracker.body, *joint)?;
            let found = place(&self.tracker.body, &posed, &fit.state, anchor);
            Some(((found - at).norm() / clicked_m).powi(2).min(most_of_a_click))
        };
        self.misfit_of_points(fit)
            + off_people(&fit.state, &self.tracker.template)
            + clicks.iter().filter_map(off).sum::<f64>()
    }

    /// What of that is of the points.
    fn misfit_of_points(&self, fit: &BodyFit) -> f64 {
        (fit.rms_m / self.tracker.rules.options.model_sigma_m).powi(2) + OFF_WEIGHT * fit.off_share
    }

    /// Why a fit is rejected as a start.
    fn doubt(&self, fit: &BodyFit) -> Option<Refusal> {
        let elsewhere = || self.is_person().then(|| stray(self.chosen, fit)).flatten().map(|it| ("elsewhere", it));
        let off = off_people(&fit.state, &self.tracker.template);
        let few_people = || {
            (!self.is_person() && off > MOST_OFF).then(|| {
                let reason = format!(
                    "lengths and thicknesses of the arm are unusual ({off:.0} in squared standard deviations, expected {MOST_OFF} at most): a wrong `height_m`, another limb, or one with \
                     its ends exchanged"
                );
                ("misshapen", reason)
            })
        };
        rejection(fit).or_else(elsewhere).or_else(few_people)
    }

    /// From three clicked joints or more, with what does not fit of what comes of them, the clicks left out.
    fn clicked(&self) -> (f64, Result<BodyFit, Refusal>) {
        let BodyTracker { body, template, rules, .. } = self.tracker;
        if let Some(reason) = clicks::too_far_apart(body, template, &self.clicks, rules.clicked_m) {
            return (f64::INFINITY, Err(("no_start", reason)));
        }
        let first = match self.fit_from(&self.clicks) {
            Ok(first) => first,
            Err(why) => return (f64::INFINITY, Err(why)),
        };
        // Where what comes of them does not fit, they are doubted.
        let (taken, most_of_a_click) = match self.doubt(&first) {
            None => (Ok(first.clone()), f64::INFINITY),
            Some(_) if !self.is_doubted => (Ok(first.clone()), MOST_OF_A_CLICK),
            Some(_) => {
                let others = if self.is_person() { self.without_limbs() } else { self.along_the_limb() };
                (self.best([vec![first.clone()], others].concat()), MOST_OF_A_CLICK)
            }
        };
        let found = taken.as_ref().unwrap_or(&first);
        let misfit = self.misfit(found, &[], most_of_a_click);
        let why = self.exchanged(found, most_of_a_click).map(|it| ("no_start", it));
        let why = why.or_else(|| taken.as_ref().err().cloned()).or_else(|| self.doubt(found));
        (misfit, why.or_else(|| self.other_height(found)).map_or(taken, Err))
    }

    /// Message about an arm that a person of very different stature fits much better: where shoulder and hand are not seen, an arm that is too long fits by extending at both ends.
    fn other_height(&self, found: &BodyFit) -> Option<Refusal> {
        if self.is_person() || !self.options.free.scales {
            return None;
        }
        let template = &self.tracker.template;
        let own = self.misfit(found, &self.clicks, MOST_OF_A_CLICK);
        OTHER_HEIGHTS.iter().find_map(|factor| {
            let scaled = State {
                scales: template.scales.iter().map(|it| it * factor).collect(),
                radii: template.radii.iter().map(|it| it * *factor).collect(),
                ..template.clone()
            };
            // As it was found, and, where that may be wrong for the height, from the clicks.
            let is_clicked = self.clicks.len() >= LEAST_CLICKS;
            let starts = [(found.state.clone(), false), (self.start.clone(), true)];
            let misfit = starts.into_iter().filter(|it| is_clicked || !it.1).filter_map(|(posture, rough)| {
                let start = State { scales: scaled.scales.clone(), radii: scaled.radii.clone(), ..posture };
                let options = BodyFitOptions { rough, ..self.options.clone() };
                let fit = self.fit_of(anthropometric(&scaled), &start, &self.anchors(&self.clicks), &options).ok()?;
                let misfit = self.misfit(&fit, &self.clicks, MOST_OF_A_CLICK);
                Some(misfit - off_people(&fit.state, template) + off_people(&fit.state, &scaled))
            });
            let misfit = misfit.fold(f64::INFINITY, f64::min);
            (MUCH_BETTER * misfit < own && misfit + CLEARLY < own).then(|| {
                let reason = format!(
                    "{factor} times the set `height_m` fits much better: {misfit:.1} squared standard deviations of points, clicks, lengths and thicknesses instead of {own:.1}; expected an \
                     approximately right `height_m`"
                );
                ("misshapen", reason)
            })
        })
    }

    /// Message about clicks that fit much better under other names.
    fn exchanged(&self, found: &BodyFit, most_of_a_click: f64) -> Option<String> {
        let BodyTracker { body, template, rules, .. } = self.tracker;
        let own = self.misfit(found, &self.clicks, most_of_a_click);
        for other in clicks::other_readings(body, template, &self.clicks, rules.clicked_m, self.is_person()) {
            let Ok(turned) = self.fit(&self.start, &self.anchors(&other.clicks), &self.options) else { continue };
            let misfit = self.misfit(&turned, &other.clicks, most_of_a_click);
            let is_better = MUCH_BETTER * misfit < own && misfit + CLEARLY < own;
            // An arm alone is nearly as right the other way round: there how long and thick it is decides.
            let [size, turned_size] = [found, &turned].map(|it| off_people(&it.state, template));
            let is_like_people = !self.is_person()
                && turned.rms_m < found.rms_m.max(rules.options.model_sigma_m)
                && MUCH_BETTER * turned_size < size
                && turned_size + CLEARLY_IN_SIZE < size;
            // Where neither fits, neither is right.
            let is_right = self.doubt(found).is_none() || self.doubt(&turned).is_none();
            if is_right && (is_better || is_like_people) {
                return Some(format!(
                    "{} look exchanged: points, clicks, lengths and thicknesses are {own:.1} squared standard deviations off a person's, but {misfit:.1} when exchanged",
                    other.what
                ));
            }
        }
        None
    }

    /// A person from clicks without those of each limb.
    fn without_limbs(&self) -> Vec<BodyFit> {
        let without = |limb: &[usize]| {
            let left: Vec<_> = self.clicks.iter().filter(|it| !limb.contains(&it.0)).copied().collect();
            (left.len() < self.clicks.len() && left.len() >= LEAST_CLICKS).then(|| self.fit_from(&left).ok()).flatten()
        };
        clicks::LIMBS.iter().filter_map(|it| without(it)).collect()
    }

    /// An arm whose joints are slid along the middle line of the points, either way.
    fn along_the_limb(&self) -> Vec<BodyFit> {
        let bones = &self.tracker.body.skeleton;
        let points: Vec<Point3<f64>> = self.chosen.iter().map(|it| it.position).collect();
        let Some(line) = MiddleLine::of(&points) else { return Vec::new() };
        let length = |it: usize| bones.segments()[it].length * self.start.scales[bones.segments()[it].scale];
        let [upper, fore] = [0, 1].map(length);
        let last = (line.length() - upper - fore + SLACK_M).max(-SLACK_M);
        let n = (((last + SLACK_M) / SLID_M).ceil() as usize).clamp(1, MOST_SLID);
        let options = BodyFitOptions { rough: false, ..self.options.clone() };
        let mut found = Vec::new();
        for line in [&line, &line.reversed()] {
            for number in 0..=n {
                let shoulder = -SLACK_M + (last + SLACK_M) * number as f64 / n as f64;
                let places = [shoulder, shoulder + upper, shoulder + upper + fore].map(|it| line.at(it));
                let joint = |(segment, at): (usize, &Point3<f64>)| BodyObservation::Anchored {
                    segment,
                    place: Vector3::zeros(),
                    at: *at,
                    sigma_m: SLACK_M,
                };
                let tried: Vec<BodyObservation> = places.iter().enumerate().map(joint).collect();
                let fit = self.fit(&self.start, &tried, &self.options);
                let fit = fit.and_then(|it| self.fit(&it.state, &self.anchors(&self.clicks), &options));
                found.extend(fit);
            }
        }
        found
    }

    /// The best fit; for an arm none where another one, with different joints, is nearly as good.
    fn best(&self, fits: Vec<BodyFit>) -> Result<BodyFit, Refusal> {
        let bones = &self.tracker.body.skeleton;
        let joints = |it: &BodyFit| {
            let posed = bones.pose(&it.state);
            (0..bones.segments().len()).map(|it| bones.joint(&posed, it)).collect::<Vec<_>>()
        };
        let misfit = |it: BodyFit| (self.misfit(&it, &self.clicks, MOST_OF_A_CLICK), it);
        let mut all: Vec<(f64, BodyFit)> = fits.into_iter().map(misfit).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut all = all.into_iter();
        let (least, best) = all.next().ok_or(("no_start", "no way to lie in the points".to_owned()))?;
        let places = joints(&best);
        let apart_m = |it: &BodyFit| joints(it).iter().zip(&places).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        let other =
            all.find(|(misfit, it)| *misfit < least + CLEARLY_LESS && apart_m(it) > APART_M && rejection(it).is_none());
        if let Some((other, _)) = other.filter(|_| !self.is_person()) {
            let reason = format!(
                "the arm's orientation is ambiguous: for two candidates, points, clicks, lengths and thicknesses are {least:.1} and {other:.1} squared standard deviations off a person's, expected \
                 a difference of {CLEARLY_LESS} at least; give three joints at `clicked` or `joints`, or a better `height_m`"
            );
            return Err(("no_start", reason));
        }
        Ok(best)
    }

    /// An arm from the points and a click or two.
    fn unclicked(&self) -> Result<BodyFit, Refusal> {
        if self.is_person() {
            let reason = format!("{} clicked joints of the model, expected {LEAST_CLICKS} at least", self.clicks.len());
            return Err(("no_start", reason));
        }
        let found = self.best(self.along_the_limb());
        found.and_then(|it| self.doubt(&it).or_else(|| self.other_height(&it)).map_or(Ok(it), Err))
    }
}

/// Whether a segment is longer or shorter than in most people.
fn has_odd_length(fit: &BodyFit) -> bool {
    fit.doubts.iter().any(|it| matches!(it, Doubt::Misshapen { what: "length", .. }))
}

/// Message about a cluster of points off the body, such as a shank with a wrongly bent knee. They are too few to reject the whole body.
pub(in crate::body) fn stray(chosen: &[&TrackedPoint], fit: &BodyFit) -> Option<String> {
    let is_far = |it: &f64| it.is_nan() || it.abs() > STRAY_M;
    let far: Vec<Point3<f64>> =
        chosen.iter().zip(&fit.distances_m).filter(|it| is_far(it.1)).map(|it| it.0.position).collect();
    let beside = |at: &Point3<f64>| far.iter().filter(|it| (*it - at).norm() < STRAY_REACH_M).count();
    let (most, at) = far.iter().map(|it| (beside(it), it)).max_by_key(|it| it.0)?;
    let share = most as f64 / chosen.len() as f64;
    (share > MOST_STRAY).then(|| {
        let [x, y, z]: [f64; 3] = at.coords.into();
        format!(
            "{most} of {} points, together about ({x:.2}, {y:.2}, {z:.2}) m, are more than {:.0} mm off the body, expected {:.0} at most: a limb of the body is misplaced; give more accurate clicked \
             joints",
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clicks_that_were_refused_are_taken_only_where_clearly_more_fits() {
        let why = ("elsewhere", "a limb of the body is misplaced".to_owned());
        let before = Refused { clicks: Vec::new(), n: 1, misfit: 24.0, why: why.clone() };
        assert_eq!(no_worse(Ok(7), 23.5, Some(&before)), Err(why.clone()));
        assert_eq!(no_worse(Ok(7), 12.0, Some(&before)), Ok(7));
        assert_eq!(no_worse(Ok(7), 23.5, None), Ok(7));
        // What is refused for another reason says its own.
        let other: Result<i32, Refusal> = Err(("few_limbs", "points on one segment".to_owned()));
        assert_eq!(no_worse(other.clone(), 23.5, Some(&before)), other);
    }
}
