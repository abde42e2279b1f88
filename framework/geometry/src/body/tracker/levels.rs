//! Levels of limbs [Mikić 2001 §6]: limbs are searched, split, joined, removed, and searched elsewhere.

use nalgebra::Vector3;

use super::super::acquire::turn_of;
use super::super::field::VoxelField;
use super::super::filter::BodyFilter;
use super::super::fit::Labelled;
use super::super::layout::{Layout, Presence};
use super::super::limbs::{LimbFound, Taken, find_limb, limb_templates};
use super::super::model::Body;
use super::super::parts::{Joint, Limb, Part};
use super::super::proportions::{Proportions, share};
use super::{BodyTracker, LOOK_EVERY, LimbLevel, LimbTrack};

/// Knees that have passed each other by so much are crossed [m]: as much as a knee is thick.
const CROSSED: f64 = 0.06;

/// A template whose parts are turned by less lies where the limb is already [rad].
const ELSEWHERE: f64 = 0.4;

/// A limb goes elsewhere where that is so much better: an odds ratio of 150 [–].
pub(super) const BETTER: f64 = 5.0;

/// Templates of an arm that lies in a thing: so many, their ends so far apart [–, m].
const OTHER_TEMPLATES: (usize, f64) = (4, 0.10);

/// Sizes that are less likely belong to no person: 3 standard deviations in each of two numbers of both parts would be 18 [–].
const UNUSUAL: f64 = 6.0;
/// A limb whose sizes are less likely lies in another body or in a chair too [–]. In hulls of two views limbs of people have 12.
const NOBODYS: f64 = 20.0;

impl BodyTracker {
    fn presence_with(&self, changed: Limb, level: LimbLevel) -> Layout {
        let before = *self.filter.layout();
        let [upper, lower] = changed.parts();
        Layout::of(|part| match level {
            LimbLevel::Absent if part == upper || part == lower => Presence::Absent,
            LimbLevel::Straight if part == lower => Presence::Tied,
            _ if part == upper || part == lower => Presence::Own,
            _ => before.presence(part),
        })
    }

    pub(super) fn set_level(&mut self, limb: Limb, level: LimbLevel, body: &Body) {
        let layout = self.presence_with(limb, level);
        self.filter.set_parts(layout, body, &self.options.beginning);
        self.limbs[limb.index()] = LimbTrack { level, weak_s: 0.0, straight_s: 0.0 };
    }

    /// How long limbs were without support, or straight.
    pub(super) fn judge_limbs(&mut self, dt_s: f64) {
        for limb in Limb::ALL {
            let [upper, lower] = limb.parts();
            let track = &self.limbs[limb.index()];
            if track.level == LimbLevel::Absent {
                continue;
            }
            let is_weak = !(self.is_supported(upper) && self.is_supported(lower));
            let bend = self.bend(limb);
            let mut track = track.clone();
            track.weak_s = if is_weak { track.weak_s + dt_s } else { 0.0 };
            track.straight_s =
                if bend < self.options.acquisition.limbs.straight / 2.0 { track.straight_s + dt_s } else { 0.0 };
            let is_gone = track.weak_s > self.options.levels.lost_s;
            let joins = track.level == LimbLevel::Bent && track.straight_s > self.options.levels.join_s;
            self.limbs[limb.index()] = track;
            let body = self.filter.body.clone();
            if is_gone {
                // Who was lost with odd sizes had grown into something else.
                if self.unusual(limb) > UNUSUAL {
                    self.forget_sizes(limb);
                }
                self.set_level(limb, LimbLevel::Absent, &body);
            } else if joins {
                self.set_level(limb, LimbLevel::Straight, &body);
            }
        }
    }

    pub(super) fn bend(&self, limb: Limb) -> f64 {
        let [upper, lower] = limb.parts().map(|it| self.filter.body.turn(it) * Vector3::z());
        upper.angle(&lower)
    }

    /// Voxels that all parts except `limbs` have taken.
    pub(super) fn taken_without(&self, field: &VoxelField, limbs: &[Limb]) -> Taken {
        let layout = self.filter.layout();
        let is_taken = |part: Part| layout.has(part) && !limbs.iter().any(|limb| limb.parts().contains(&part));
        Taken::by(field, &self.filter.body, is_taken, 0.25 * field.size())
    }

    pub(super) fn put(&mut self, found: &LimbFound) {
        let mut body = self.filter.body.clone();
        for (part, turn) in found.limb.parts().into_iter().zip(found.turns) {
            body.turns[part.index()] = turn;
        }
        let is_straight = found.bend < self.options.acquisition.limbs.straight;
        let level = if is_straight { LimbLevel::Straight } else { LimbLevel::Bent };
        self.set_level(found.limb, LimbLevel::Absent, &body);
        self.set_level(found.limb, level, &body);
    }

    /// Looks for limbs that are not in the model, the surest first; whether any was found.
    pub(super) fn search_absent(&mut self, field: &VoxelField) -> bool {
        let mut any = false;
        let mut tried: Vec<Limb> = Vec::new();
        loop {
            let absent: Vec<Limb> =
                Limb::ALL.into_iter().filter(|it| self.limbs[it.index()].level == LimbLevel::Absent).collect();
            let taken = self.taken_without(field, &absent);
            // A limb that is there takes up a litre or more.
            if (taken.n_free(field) as f64) * field.size().powi(3) < 5e-4 {
                return any;
            }
            let options = &self.options.acquisition.limbs;
            // Legs first: a hand that hangs reaches down to a thigh, and would take it for a forearm.
            let legs_first = absent.iter().any(|it| it.is_leg() && !tried.contains(it));
            let found = absent
                .iter()
                .filter(|it| it.is_leg() == legs_first && !tried.contains(it))
                .filter_map(|limb| find_limb(field, &self.filter.body, *limb, &taken, options, None))
                .max_by(|a, b| a.score.total_cmp(&b.score));
            match found {
                Some(found) => {
                    self.put(&found);
                    any = true;
                }
                None => tried.extend(absent.iter().filter(|it| it.is_leg() == legs_first)),
            }
            if absent.iter().all(|it| tried.contains(it)) {
                return any;
            }
        }
    }

    /// Legs whose knees have passed each other sideways were taken for each other, as a rule: they are exchanged where that explains the voxels as well.
    pub(super) fn uncross(&mut self, field: &VoxelField, labelled: &[Labelled]) {
        let has = |part: Part| self.filter.layout().has(part);
        if !(has(Part::LeftCalf) && has(Part::RightCalf)) {
            return;
        }
        let left = self.filter.body.turn(Part::Torso) * Vector3::y();
        let apart = |it: &BodyFilter| (it.body.joint(Joint::LeftKnee) - it.body.joint(Joint::RightKnee)).dot(&left);
        if apart(&self.filter) > -CROSSED {
            return;
        }
        let mut trial = self.clone();
        let mut body = self.filter.body.clone();
        for (hip, knee, ankle, [thigh, calf]) in [
            (Joint::LeftHip, Joint::RightKnee, Joint::RightAnkle, Limb::LeftLeg.parts()),
            (Joint::RightHip, Joint::LeftKnee, Joint::LeftAnkle, Limb::RightLeg.parts()),
        ] {
            let [hip, knee, ankle] = [hip, knee, ankle].map(|it| self.filter.body.joint(it));
            body.turns[thigh.index()] = turn_of(&(hip - knee).normalize(), &left);
            body.turns[calf.index()] = turn_of(&(knee - ankle).normalize(), &left);
        }
        for leg in [Limb::LeftLeg, Limb::RightLeg] {
            trial.set_level(leg, LimbLevel::Absent, &body);
            trial.set_level(leg, LimbLevel::Bent, &body);
        }
        trial.update(field, labelled, self.options.fit.iterations + 2);
        let is_as_good = trial.support.unexplained <= self.support.unexplained + 0.02
            && trial.support.rms <= self.support.rms * 1.15;
        if is_as_good && apart(&trial.filter) > 0.0 {
            *self = trial;
        }
    }

    /// Searches again for limbs that voxels do not support, and for the weakest where many voxels belong to no part.
    pub(super) fn search_weak(&mut self, field: &VoxelField, labelled: &[Labelled]) {
        let is_there = |it: &Limb| self.limbs[it.index()].level != LimbLevel::Absent;
        let mut wanted: Vec<Limb> =
            Limb::ALL.into_iter().filter(|it| is_there(it) && self.limbs[it.index()].weak_s > 0.0).collect();
        if wanted.is_empty() && self.support.unexplained > 0.06 && self.frame.is_multiple_of(LOOK_EVERY) {
            let covered = |it: &Limb| it.parts().map(|part| self.support.covered[part.index()]).iter().sum::<f64>();
            wanted.extend(Limb::ALL.into_iter().filter(is_there).min_by(|a, b| covered(a).total_cmp(&covered(b))));
        }
        let mut any = false;
        for limb in wanted {
            let taken = self.taken_without(field, &[limb]);
            let now = limb.parts().map(|it| -(self.filter.body.turn(it) * Vector3::z()));
            let options = &self.options.acquisition.limbs;
            let Some(found) = find_limb(field, &self.filter.body, limb, &taken, options, Some(&now)) else { continue };
            let ways = found.turns.map(|it| -(it * Vector3::z()));
            // Not for a template that lies where the limb is already.
            if ways.iter().zip(&now).any(|(a, b)| a.angle(b) > ELSEWHERE) {
                self.put(&found);
                any = true;
            }
        }
        if any {
            self.update(field, labelled, self.options.fit.iterations);
        }
    }

    /// Sizes of a limb's parts as this body's trunk lets expect them, and their standard deviations [m].
    fn expected(&self, limb: Limb) -> [(Part, Vector3<f64>, Vector3<f64>); 2] {
        let stature = self.filter.body.size(Part::Torso).z / share(Part::Torso).z;
        let Proportions { radius_spread, length_spread, .. } = self.options.proportions;
        limb.parts().map(|part| {
            let expected = share(part) * stature;
            (part, expected, expected.component_mul(&Vector3::new(radius_spread, radius_spread, length_spread)))
        })
    }

    /// How unusual a limb's sizes are: the negative logarithm of their likelihood [–].
    pub(super) fn unusual(&self, limb: Limb) -> f64 {
        let of_part = |(part, expected, sigmas): (Part, Vector3<f64>, Vector3<f64>)| {
            let away = (self.filter.body.size(part) - expected).component_div(&sigmas);
            // Both radii are one number.
            (away.x.powi(2) + away.z.powi(2)) / 2.0
        };
        self.expected(limb).into_iter().map(of_part).sum()
    }

    /// Whether a limb has implausible sizes.
    pub(super) fn is_nobodys(&self, limb: Limb) -> bool {
        self.unusual(limb) > NOBODYS
    }

    pub(super) fn forget_sizes(&mut self, limb: Limb) {
        for (part, expected, sigmas) in self.expected(limb) {
            self.filter.forget_sizes(part, &expected, &sigmas);
        }
    }

    /// Looks whether a limb explains the voxels better somewhere else, with the sizes that are expected: an arm that was folded up beside the trunk, and grew longer to fit, supports itself. One limb at a time.
    pub(super) fn reconsider(&mut self, field: &VoxelField, labelled: &[Labelled]) {
        let limb = Limb::ALL[(self.frame / LOOK_EVERY) as usize % Limb::ALL.len()];
        if self.limbs[limb.index()].level == LimbLevel::Absent {
            return;
        }
        let unusual = self.unusual(limb);
        let mut start = self.clone();
        start.forget_sizes(limb);
        let taken = self.taken_without(field, &[limb]);
        let options = &self.options.acquisition.limbs;
        let body = &start.filter.body;
        let mut templates: Vec<LimbFound> = find_limb(field, body, limb, &taken, options, None).into_iter().collect();
        if self.is_in_thing(limb) {
            // Of an arm in a chair's back the best one is there too.
            templates.extend(limb_templates(field, body, limb, &taken, options, OTHER_TEMPLATES));
        }
        let now = limb.parts().map(|it| self.filter.body.turn(it) * Vector3::z());
        for found in templates {
            if found.turns.iter().zip(&now).all(|(a, b)| (a * Vector3::z()).angle(b) < ELSEWHERE) {
                continue;
            }
            let mut trial = start.clone();
            trial.put(&found);
            trial.share = 1.0;
            trial.update(field, labelled, self.options.fit.iterations + 2);
            trial.share = self.share;
            let cost = trial.support.cost + trial.in_things([limb]);
            if cost + BETTER < self.support.cost + self.in_things([limb]) + unusual {
                *self = trial;
                return;
            }
        }
    }

    /// Splits straight limbs that bend, as an update of them split says.
    pub(super) fn split(&mut self, field: &VoxelField, labelled: &[Labelled]) {
        let straight: Vec<Limb> =
            Limb::ALL.into_iter().filter(|it| self.limbs[it.index()].level == LimbLevel::Straight).collect();
        if straight.is_empty() {
            return;
        }
        let mut trial = self.clone();
        let body = self.filter.body.clone();
        // Both parts begin again: the upper one lies where a straight limb had to.
        for limb in &straight {
            trial.set_level(*limb, LimbLevel::Absent, &body);
            trial.set_level(*limb, LimbLevel::Bent, &body);
        }
        trial.update(field, labelled, self.options.fit.iterations);
        for limb in straight {
            let [_, lower] = limb.parts();
            let sigma = (trial.filter.part_covariance(lower).fixed_view::<2, 2>(3, 3).trace() / 2.0).sqrt();
            let bend = trial.bend(limb);
            if bend > self.options.acquisition.limbs.straight && bend > self.options.levels.split_sigmas * sigma {
                let bent = trial.filter.body.clone();
                self.set_level(limb, LimbLevel::Absent, &bent);
                self.set_level(limb, LimbLevel::Bent, &bent);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, UnitQuaternion};

    use super::*;
    use crate::body::{TrackerOptions, drawn};

    fn somebody() -> VoxelField {
        drawn::field(&drawn::somebody())
    }

    /// Bends a limb about the axis across by so much [rad].
    fn fold(tracker: &mut BodyTracker, limb: Limb, by: f64) {
        let [upper, lower] = limb.parts();
        let mut body = tracker.filter.body.clone();
        let about = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), by);
        body.turns[lower.index()] = body.turns[upper.index()] * about;
        tracker.set_level(limb, LimbLevel::Absent, &body);
        tracker.set_level(limb, LimbLevel::Bent, &body);
    }

    #[test]
    fn an_arm_that_was_folded_up_beside_the_trunk_is_unfolded() {
        let field = somebody();
        let mut tracker = BodyTracker::acquire(&field, &TrackerOptions::default()).unwrap();
        let limb = Limb::LeftArm;
        let elbow = |it: &BodyTracker| {
            it.filter.body.joint(if it.facing.log_odds() < 0.0 { Joint::RightElbow } else { Joint::LeftElbow })
        };
        // The forearm up along an upper arm that has grown.
        fold(&mut tracker, limb, 2.6);
        let [upper, _] = limb.parts();
        tracker.filter.forget_sizes(upper, &Vector3::new(0.045, 0.045, 0.21), &Vector3::repeat(1e-3));
        assert!(tracker.unusual(limb) > 4.0, "{}", tracker.unusual(limb));
        let before = tracker.bend(limb);
        let place = Point3::new(0.0, 0.27, 1.14);
        for _ in 0..40 {
            tracker.step(&field, 1.0 / 30.0, &[]);
        }
        let off = (elbow(&tracker) - place).norm();
        assert!(before > 2.4 && tracker.bend(limb) < 0.9, "{before} {}", tracker.bend(limb));
        assert!(off < 0.06, "the elbow is {:.0} mm off", off * 1e3);
    }

    #[test]
    fn a_calf_that_was_folded_up_before_its_thigh_comes_down_within_three_frames() {
        let field = somebody();
        let mut tracker = BodyTracker::acquire(&field, &TrackerOptions::default()).unwrap();
        let limb = Limb::RightLeg;
        fold(&mut tracker, limb, 2.9);
        let before = tracker.bend(limb);
        for _ in 0..3 {
            tracker.step(&field, 1.0 / 30.0, &[]);
        }
        let ankle = tracker.filter.body.joint(Joint::RightAnkle);
        assert!(before > 2.5 && tracker.bend(limb) < 0.9, "{before} {}", tracker.bend(limb));
        assert!((ankle - Point3::new(0.0, -0.18, 0.06)).norm() < 0.08, "{ankle}");
    }

    #[test]
    fn a_straight_leg_that_bends_gets_a_knee() {
        let field = somebody();
        let mut tracker = BodyTracker::acquire(&field, &TrackerOptions::default()).unwrap();
        let limb = Limb::RightLeg;
        let body = tracker.filter.body.clone();
        tracker.set_level(limb, LimbLevel::Absent, &body);
        tracker.set_level(limb, LimbLevel::Straight, &body);
        for _ in 0..6 {
            tracker.step(&field, 1.0 / 30.0, &[]);
        }
        assert_eq!(tracker.level(limb), LimbLevel::Bent);
        let knee = tracker.filter.body.joint(Joint::RightKnee);
        assert!((knee - Point3::new(0.10, -0.16, 0.50)).norm() < 0.05, "{knee}");
    }
}
