//! Recovered skeletons against the joints of the people of the simulated world.
//!
//! Skeletons and people are paired by the mean distance of head and trunk; a pair farther apart than half a metre is none. The joints compared are those of the ten-part model
//! [Mikić 2001]: head, neck, shoulders, elbows, hips, knees. The true neck is where head and torso of the simulated body meet: the lower pole of its head. Wrists and ankles, which lie
//! within the model's last parts, are compared apart.

use std::collections::{BTreeMap, BTreeSet};

use foveate_messages::{BODY_JOINTS, Skeleton, Skeletons, Time};
use foveate_node::Report;
use nalgebra::{Matrix3, Point3};

use super::distances::Distances;
use crate::person::Joints;

/// How bodies are compared.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyRules {
    /// A head so near is right [m].
    pub head_right: f64,
    /// A joint farther off …
    pub lost: f64,
    /// … for so long is lost [s].
    pub lost_s: f64,
    /// Wrists faster than this are fast [m/s].
    pub fast: f64,
    /// Nothing before this is compared [s].
    pub start_s: f64,
}

/// Farther apart than this, a skeleton and a person are no pair [m].
const PAIR_M: f64 = 0.5;
/// Errors are counted up to here [m].
const MOST_M: f64 = 2.0;
/// Joints that the ten-part model has between its parts, and the middle of the head.
const MODEL_JOINTS: [&str; 10] = [
    "head",
    "neck",
    "left-shoulder",
    "right-shoulder",
    "left-elbow",
    "right-elbow",
    "left-hip",
    "right-hip",
    "left-knee",
    "right-knee",
];

/// Below the middle of the head, where its radius meets the neck, times the body's size [m].
const CHIN_M: f64 = 0.105;

/// True joints in the order of [`BODY_JOINTS`].
pub fn true_joints(it: &Joints) -> [Point3<f64>; BODY_JOINTS.len()] {
    let neck = it.head * Point3::new(0.0, 0.0, -CHIN_M * it.size);
    let [[ls, rs], [le, re], [lw, rw]] = [it.shoulders, it.elbows, it.wrists];
    let [[lh, rh], [lk, rk], [la, ra]] = [it.hips, it.knees, it.ankles];
    [Point3::from(it.head.translation.vector), neck, ls, rs, le, re, lw, rw, lh, rh, lk, rk, la, ra]
}

#[derive(Default)]
struct Person {
    since: Option<Time>,
    complete: Option<Time>,
    /// Since when each joint is off.
    off_since: BTreeMap<usize, Time>,
    counted: BTreeSet<usize>,
    wrists: Option<(Time, [Point3<f64>; 2])>,
}

/// Gathers the comparison.
pub struct BodyScorer {
    rules: BodyRules,
    joints: Distances,
    ends: Distances,
    by_joint: Vec<Distances>,
    people: Vec<Person>,
    n_people: u64,
    n_heads: u64,
    n_heads_right: u64,
    n_heads_wrong: u64,
    n_missing: u64,
    n_swapped: u64,
    n_pairs: u64,
    n_false: u64,
    n_lost: u64,
    n_lost_fast: u64,
    fastest: f64,
    normalised: f64,
    n_normalised: u64,
}

impl BodyScorer {
    /// Nothing compared yet.
    pub fn new(rules: BodyRules) -> Self {
        Self {
            rules,
            joints: Distances::new(MOST_M),
            ends: Distances::new(MOST_M),
            by_joint: BODY_JOINTS.iter().map(|_| Distances::new(MOST_M)).collect(),
            people: Vec::new(),
            n_people: 0,
            n_heads: 0,
            n_heads_right: 0,
            n_heads_wrong: 0,
            n_missing: 0,
            n_swapped: 0,
            n_pairs: 0,
            n_false: 0,
            n_lost: 0,
            n_lost_fast: 0,
            fastest: 0.0,
            normalised: 0.0,
            n_normalised: 0,
        }
    }

    /// Skeletons and all people at their time, with their numbers. `is_there`: whether a place is in the volume; who is not wholly in it need not be found.
    pub fn add(&mut self, found: &Skeletons, people: &[(usize, Joints)], is_there: impl Fn(&Point3<f64>) -> bool) {
        if found.time.as_s() < self.rules.start_s {
            return;
        }
        let truths: Vec<[Point3<f64>; BODY_JOINTS.len()]> = people.iter().map(|it| true_joints(&it.1)).collect();
        let n_people = people.iter().map(|it| it.0 + 1).max().unwrap_or(0);
        self.people.resize_with(self.people.len().max(n_people), Person::default);
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (body, skeleton) in found.list.iter().enumerate() {
            for (person, truth) in truths.iter().enumerate() {
                let distance = apart(skeleton, truth);
                if distance < PAIR_M {
                    pairs.push((distance, body, person));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut of_person, mut of_body) = (vec![None; truths.len()], vec![None; found.list.len()]);
        for (_, body, person) in pairs {
            if of_person[person].is_none() && of_body[body].is_none() {
                (of_person[person], of_body[body]) = (Some(body), Some(person));
            }
        }
        self.n_false += of_body.iter().filter(|it| it.is_none()).count() as u64;
        for (person, truth) in truths.iter().enumerate() {
            let is_whole = truth.iter().all(&is_there);
            let skeleton = of_person[person].map(|it: usize| &found.list[it]);
            if is_whole || skeleton.is_some() {
                self.compare(people[person].0, truth, skeleton, found.time);
            }
        }
    }

    fn compare(&mut self, person: usize, truth: &[Point3<f64>; 14], skeleton: Option<&Skeleton>, time: Time) {
        self.n_people += 1;
        self.people[person].since.get_or_insert(time);
        let speed = self.wrist_speed(person, truth, time);
        self.fastest = self.fastest.max(speed);
        let Some(skeleton) = skeleton else {
            self.n_missing += MODEL_JOINTS.len() as u64;
            return;
        };
        self.n_pairs += 1;
        if skeleton.parts.len() == 10 && self.people[person].complete.is_none() {
            self.people[person].complete = Some(time);
        }
        for (number, name) in BODY_JOINTS.iter().enumerate() {
            let is_of_model = MODEL_JOINTS.contains(name);
            let Some(joint) = skeleton.joint(name) else {
                self.n_missing += u64::from(is_of_model);
                continue;
            };
            let off = joint.position - truth[number];
            let error = off.norm();
            self.by_joint[number].add(error);
            if is_of_model {
                self.joints.add(error);
            } else {
                self.ends.add(error);
            }
            let covariance: Matrix3<f64> = joint.covariance.fixed_view::<3, 3>(0, 0).into_owned();
            if let Some(factor) = covariance.cholesky() {
                self.normalised += off.dot(&factor.solve(&off)) / 3.0;
                self.n_normalised += 1;
            }
            if number == 0 {
                self.n_heads += 1;
                let is_right = error <= self.rules.head_right;
                self.n_heads_right += u64::from(is_right);
                self.n_heads_wrong += u64::from(!is_right);
            }
            self.watch(person, number, error, speed, time);
        }
        let cross = |left: &str, right: &str| {
            let place = |name: &str| skeleton.joint(name).map(|it| it.position);
            let number = |name: &str| BODY_JOINTS.iter().position(|it| *it == name).unwrap_or_default();
            let (a, b) = (place(left)?, place(right)?);
            let [ta, tb] = [truth[number(left)], truth[number(right)]];
            Some((a - ta).norm() + (b - tb).norm() - (a - tb).norm() - (b - ta).norm())
        };
        let crossed =
            cross("left-shoulder", "right-shoulder").unwrap_or(0.0) + cross("left-hip", "right-hip").unwrap_or(0.0);
        self.n_swapped += u64::from(crossed > 0.0);
    }

    fn watch(&mut self, person: usize, joint: usize, error: f64, speed: f64, time: Time) {
        let of = &mut self.people[person];
        if error <= self.rules.lost {
            of.off_since.remove(&joint);
            of.counted.remove(&joint);
            return;
        }
        let since = *of.off_since.entry(joint).or_insert(time);
        if (time - since).as_s() >= self.rules.lost_s && !of.counted.contains(&joint) {
            of.counted.insert(joint);
            self.n_lost += 1;
            self.n_lost_fast += u64::from(speed > self.rules.fast);
        }
    }

    /// Of the faster wrist since the message before [m/s].
    fn wrist_speed(&mut self, person: usize, truth: &[Point3<f64>; 14], time: Time) -> f64 {
        let now = [truth[6], truth[7]];
        let before = self.people[person].wrists.replace((time, now));
        let Some((then, places)) = before else { return 0.0 };
        let dt_s = (time - then).as_s();
        if dt_s <= 0.0 || dt_s > 0.2 {
            return 0.0;
        }
        (0..2).map(|it| (now[it] - places[it]).norm() / dt_s).fold(0.0, f64::max)
    }

    /// Writes the figures.
    pub fn finish(&self, report: &mut Report) {
        if self.n_people == 0 {
            report.remark("No person was in the volume while skeletons came: none was scored.");
            return;
        }
        let mm = |it: f64| it * 1e3;
        report.figure("joint_mm.median", mm(self.joints.percentile(50.0)));
        report.figure("joint_mm.p95", mm(self.joints.percentile(95.0)));
        report.figure("end_mm.median", mm(self.ends.percentile(50.0)));
        report.figure("end_mm.p95", mm(self.ends.percentile(95.0)));
        for (name, errors) in BODY_JOINTS.iter().zip(&self.by_joint) {
            report.figure(format!("joint.{}.mm.median", name.replace('-', "_")), mm(errors.percentile(50.0)));
        }
        let share = |n: u64, of: u64| if of == 0 { f64::NAN } else { n as f64 / of as f64 };
        report.figure("head_right", share(self.n_heads_right, self.n_people));
        report.figure("head_wrong", share(self.n_heads_wrong, self.n_people));
        let mut found: Vec<f64> = self
            .people
            .iter()
            .filter_map(|it| Some((it.since?, it.complete)))
            .map(|(since, complete)| complete.map_or(f64::INFINITY, |it| (it - since).as_s()))
            .collect();
        found.sort_by(f64::total_cmp);
        if let Some(median) = found.get((found.len().max(1) - 1) / 2).filter(|it| it.is_finite()) {
            report.figure("parts_found_s", *median);
        } else {
            report.remark("No more than half of the people ever had all ten parts.");
        }
        report.figure("joints_missing", share(self.n_missing, self.n_people * MODEL_JOINTS.len() as u64));
        report.figure("joints_lost", self.n_lost as f64);
        report.figure("joints_lost_fast", self.n_lost_fast as f64);
        report.figure("sides_swapped", share(self.n_swapped, self.n_pairs));
        report.figure("bodies_false", self.n_false as f64);
        report.figure("wrist_speed.max", self.fastest);
        report.figure("joint_normalised", self.normalised / self.n_normalised as f64);
    }
}

/// Mean distance of what every skeleton has.
fn apart(skeleton: &Skeleton, truth: &[Point3<f64>; 14]) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for number in [0, 1, 2, 3, 8, 9] {
        if let Some(joint) = skeleton.joint(BODY_JOINTS[number]) {
            sum += (joint.position - truth[number]).norm();
            n += 1.0;
        }
    }
    if n > 0.0 { sum / n } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use foveate_messages::{CameraSet, LimbDetail, Provenance, SkeletonJoint};
    use nalgebra::{Matrix6, Vector3};

    use super::*;
    use crate::person::Person as Walker;

    fn skeleton(truth: &[Point3<f64>; 14], off: Vector3<f64>, swapped: bool) -> Skeleton {
        let joints = (0..14_u8)
            .map(|joint| {
                let from = if swapped && joint > 1 { joint ^ 1 } else { joint };
                SkeletonJoint {
                    joint,
                    position: truth[usize::from(from)] + off,
                    velocity: Vector3::zeros(),
                    covariance: Matrix6::identity() * 1e-4,
                    provenance: Provenance::Measured,
                }
            })
            .collect();
        let limbs = [LimbDetail::Bent; 4];
        Skeleton { id: 0, joints, parts: vec![], limbs, facing: 1.0, unexplained: 0.0, cameras: CameraSet::default() }
    }

    fn scored(make: impl Fn(&[Point3<f64>; 14], f64) -> Vec<Skeleton>) -> Report {
        let rules = BodyRules { head_right: 0.05, lost: 0.15, lost_s: 0.5, fast: 3.0, start_s: 0.0 };
        let mut scorer = BodyScorer::new(rules);
        let person = Walker::new(0, 1, [2.5, 4.0], 0.9, &Random::new(1));
        for step in 0..60 {
            let time = f64::from(step) / 30.0;
            let joints = person.pose(time).joints();
            let list = make(&true_joints(&joints), time);
            scorer.add(&Skeletons { time: Time::from_s(time), list, ..Skeletons::default() }, &[(0, joints)], |_| true);
        }
        let mut report = Report::default();
        scorer.finish(&mut report);
        report
    }

    #[test]
    fn errors_are_those_that_were_put_in() {
        let report = scored(|truth, _| vec![skeleton(truth, Vector3::x() * 0.02, false)]);
        let figure = |name: &str| report.figures[name];
        assert!((figure("joint_mm.median") - 20.0).abs() < 0.02 && (figure("joint_mm.p95") - 20.0).abs() < 0.02);
        assert!((figure("joint_normalised") - 4.0 / 3.0).abs() < 1e-6);
        assert_eq!([figure("head_right"), figure("sides_swapped"), figure("joints_lost")], [1.0, 0.0, 0.0]);
    }

    #[test]
    fn swapped_sides_lost_joints_and_false_bodies_are_counted() {
        let swapped = scored(|truth, _| vec![skeleton(truth, Vector3::zeros(), true)]);
        assert_eq!(swapped.figures["sides_swapped"], 1.0);
        assert!(swapped.figures["joint_mm.p95"] > 200.0);
        let lost = scored(|truth, time| {
            let mut one = skeleton(truth, Vector3::zeros(), false);
            if time > 1.0 {
                one.joints[5].position.z += 0.2;
            }
            vec![one, skeleton(truth, Vector3::x() * 3.0, false)]
        });
        assert_eq!([lost.figures["joints_lost"], lost.figures["bodies_false"]], [1.0, 60.0]);
        let none = scored(|_, _| Vec::new());
        assert_eq!([none.figures["joints_missing"], none.figures["head_right"]], [1.0, 0.0]);
    }
}
