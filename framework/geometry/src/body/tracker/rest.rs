//! Unexplained voxels, and limbs that could explain them: a leg folded into the other one supports itself and leaves its shin unexplained.
//!
//! A template that grows from the joint ([`find_limb`](super::super::limbs::find_limb)) goes where voxels are deepest.
//! For two legs side by side that is the middle between them: the first leg takes voxels of the other, which finds
//! none below its hip. So here the search is reversed: from the unexplained voxels to limbs that reach them in any
//! bend; the one that explains all voxels best, after a fit of the whole body, is taken.

use nalgebra::{Point3, Rotation3, Unit, Vector3};

use super::super::acquire::turn_of;
use super::super::field::VoxelField;
use super::super::filter::{BodyFilter, Normal};
use super::super::fit::{Fit, Labelled};
use super::super::limbs::can_point;
use super::super::parts::{Joint, Limb, Part};
use super::levels::BETTER;
use super::{BodyTracker, LOOK_EVERY, LimbLevel};

/// A face farther from all skins is unexplained, beside half a voxel [m].
const FAR: f64 = 0.04;
/// A limb that bends by more is folded up [rad].
const FOLDED: f64 = 1.75;
/// Faces nearer to one that was looked at are not looked at [m]: half a forearm.
const APART: f64 = 0.14;
/// So many places are looked at.
const N_PLACES: usize = 5;
/// Number of bends tried to reach a place.
const N_SWIVELS: usize = 6;
/// Number of all bends that are fitted.
const N_FITTED: usize = 4;
/// An arm that lies in a thing costs so much [–]: own arms of seated people of another renderer do so in hardly a frame, those that were laid into the chair's back or an arm-rest in nearly all.
const IN_THING: f64 = 10.0;

/// A way that limbs could lie.
struct Way {
    limbs: Vec<(Limb, [Vector3<f64>; 2])>,
}

impl BodyTracker {
    /// Lets limbs reach for unexplained voxels, as long as that explains the voxels better and at most so often.
    pub(super) fn reach_for_rest(&mut self, field: &VoxelField, labelled: &[Labelled], rounds: usize) {
        let mut left = rounds;
        while left > 0 && self.reach_once(field, labelled) {
            left -= 1;
        }
    }

    fn reach_once(&mut self, field: &VoxelField, labelled: &[Labelled]) -> bool {
        let places = self.places_of_rest(field);
        let mut ways: Vec<Way> = places.iter().flat_map(|place| self.ways_to(field, place)).collect();
        if !places.is_empty() {
            ways.extend(self.legs_side_by_side(field));
            ways.extend(self.legs_alike());
        }
        ways.extend(Limb::ALL.into_iter().flat_map(|it| self.unfolded(it)));
        self.take_best(&ways, field, labelled)
    }

    /// Takes the way of limbs that explains the voxels best, if it does so better than now.
    fn take_best(&mut self, ways: &[Way], field: &VoxelField, labelled: &[Labelled]) -> bool {
        // What the voxels say of each before any fit.
        let mut trials: Vec<(f64, BodyTracker)> = ways
            .iter()
            .map(|way| {
                let trial = self.with_way(way);
                (trial.cost_now(field), trial)
            })
            .collect();
        trials.sort_by(|a, b| a.0.total_cmp(&b.0));
        let before = self.cost();
        let mut best: Option<(f64, BodyTracker)> = None;
        for (_, mut trial) in trials.into_iter().take(N_FITTED) {
            trial.share = 1.0;
            trial.update(field, labelled, self.options.fit.iterations + 2);
            trial.share = self.share;
            let cost = trial.cost();
            if cost + BETTER < before && best.as_ref().is_none_or(|it| cost < it.0) {
                best = Some((cost, trial));
            }
        }
        let Some((_, found)) = best else { return false };
        *self = found;
        true
    }

    /// How badly the voxels and what is known of people fit the body, comparable among bodies in the same voxels [–].
    pub(super) fn cost(&self) -> f64 {
        self.support.cost + self.unusual_limbs() + self.in_things(Limb::ALL)
    }

    /// Penalty on a sitting person's arms that lie in an object [–].
    pub(super) fn in_things(&self, limbs: impl IntoIterator<Item = Limb>) -> f64 {
        if !self.sits() {
            return 0.0;
        }
        limbs.into_iter().filter(|it| self.is_in_thing(*it)).count() as f64 * IN_THING
    }

    pub(super) fn unusual_limbs(&self) -> f64 {
        Limb::ALL.into_iter().filter(|it| self.level(*it) != LimbLevel::Absent).map(|it| self.unusual(it)).sum()
    }

    /// Middles of unexplained faces, the farthest from all skins first.
    fn places_of_rest(&self, field: &VoxelField) -> Vec<Point3<f64>> {
        let skins = self.skins();
        let faces = field.faces();
        let step = faces.len().div_ceil(800).max(1);
        let far = FAR + field.size() / 2.0;
        let mut rest: Vec<(f64, Point3<f64>)> = faces
            .iter()
            .step_by(step)
            .map(|it| (skins.distance(&it.position), it.position - it.normal * (2.0 * field.size())))
            .filter(|it| it.0 > far)
            .collect();
        rest.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut places: Vec<Point3<f64>> = Vec::new();
        for (_, place) in rest {
            if places.len() < N_PLACES && places.iter().all(|it| (it - place).norm() > APART) {
                places.push(place);
            }
        }
        places
    }

    /// Of each limb that could get there: straight through the place, or bent with its end there.
    fn ways_to(&self, field: &VoxelField, place: &Point3<f64>) -> Vec<Way> {
        let body = &self.filter.body;
        let mut found = Vec::new();
        for limb in Limb::ALL {
            let [upper, lower] = limb.parts();
            let joint = body.place(Part::Torso, &upper.hangs_at());
            let [first, second] = [upper, lower].map(|it| 2.0 * body.size(it).z);
            let away = place - joint;
            let distance = away.norm();
            if distance < 0.3 * (first + second) || distance > first + second + 0.1 {
                continue;
            }
            let straight = away / distance;
            let mut ways = vec![[straight; 2]];
            if distance < 0.97 * (first + second) {
                // The law of cosines; the elbow on a circle about the line from the joint to the place.
                let cosine = (first.powi(2) + distance.powi(2) - second.powi(2)) / (2.0 * first * distance);
                let angle = cosine.clamp(-1.0, 1.0).acos();
                let aside = straight.cross(&if straight.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() });
                for swivel in 0..N_SWIVELS {
                    let turn = std::f64::consts::TAU * swivel as f64 / N_SWIVELS as f64;
                    let axis = Rotation3::from_axis_angle(&Unit::new_normalize(straight), turn) * aside;
                    let way = Rotation3::from_axis_angle(&Unit::new_normalize(axis), angle) * straight;
                    if let Some(rest) = (place - (joint + way * first)).try_normalize(1e-6) {
                        ways.push([way, rest]);
                    }
                }
            }
            // The upper part may lie well, and the lower one be folded against it.
            let has = self.level(limb) != LimbLevel::Absent;
            let [upper_now, _] = ways_of(&self.filter, limb);
            let rest = (place - (joint + upper_now * first)).try_normalize(0.3 * second);
            ways.extend(rest.filter(|_| has).map(|it| [upper_now, it]));
            // An elbow in the air is none.
            let is_inside = |way: &[Vector3<f64>; 2]| {
                let elbow = joint + way[0] * first;
                let places = [joint + way[0] * (0.7 * first), elbow, elbow + way[1] * (0.5 * second)];
                places.iter().all(|it| field.depth(it).0 > -0.02)
            };
            let is_possible = |way: &[Vector3<f64>; 2]| can_point(body, limb, &way[0]) && is_inside(way);
            found.extend(ways.into_iter().filter(is_possible).map(|it| Way { limbs: vec![(limb, it)] }));
        }
        found
    }

    /// Both legs straight down to what lies below the hips.
    fn legs_side_by_side(&self, field: &VoxelField) -> Option<Way> {
        let body = &self.filter.body;
        let hips = [Joint::LeftHip, Joint::RightHip].map(|it| body.joint(it));
        let middle = nalgebra::center(&hips[0], &hips[1]);
        let length: f64 = Limb::LeftLeg.parts().map(|it| 2.0 * body.size(it).z).iter().sum();
        let down = -(body.turn(Part::Torso) * Vector3::z());
        let below = field.voxels().iter().map(|&it| field.centre(it) - middle).filter(|it| {
            let along = it.dot(&down);
            along > 0.3 * length && along < 1.1 * length && (it - down * along).norm() < 0.5 * length
        });
        let (sum, n) = below.fold((Vector3::zeros(), 0), |(sum, n), it| (sum + it, n + 1));
        let way = (sum / f64::from(n.max(1))).try_normalize(1e-6)?;
        Some(Way { limbs: vec![(Limb::LeftLeg, [way; 2]), (Limb::RightLeg, [way; 2])] })
    }

    /// Each leg as the other one lies.
    fn legs_alike(&self) -> Vec<Way> {
        let has = |it: &Limb| self.level(*it) != LimbLevel::Absent;
        let legs = [Limb::LeftLeg, Limb::RightLeg].into_iter();
        legs.filter(|it| has(&it.mirrored()))
            .map(|it| Way { limbs: vec![(it, ways_of(&self.filter, it.mirrored()))] })
            .collect()
    }

    /// Straightens limbs that are folded up where that explains the voxels better; those that were not folded as `predicted` at once, others now and then.
    pub(super) fn unfold(&mut self, field: &VoxelField, labelled: &[Labelled], predicted: &BodyFilter) {
        if self.frame.is_multiple_of(LOOK_EVERY) {
            self.unfold_legs(field, labelled);
        }
        for limb in Limb::ALL {
            let is_new = folded(predicted, limb).is_none();
            if !is_new && !self.frame.is_multiple_of(LOOK_EVERY) {
                continue;
            }
            let ways = self.unfolded(limb);
            if !ways.is_empty() {
                self.take_best(&ways, field, labelled);
            }
        }
    }

    /// If both legs are folded up, both straight on at once: thighs that have grown long and thick explain short legs that stand side by side, and one of them alone would not fit better.
    pub(super) fn unfold_legs(&mut self, field: &VoxelField, labelled: &[Labelled]) {
        let legs = [Limb::LeftLeg, Limb::RightLeg];
        if let [Some([left, _]), Some([right, _])] = legs.map(|it| folded(&self.filter, it)) {
            let straight = Way { limbs: vec![(legs[0], [left; 2]), (legs[1], [right; 2])] };
            self.take_best(&[straight], field, labelled);
        }
    }

    /// If a limb is folded up, other ways of its lower part, straight on and as the other limb lies: what is folded lies in what its upper part explains already.
    fn unfolded(&self, limb: Limb) -> Vec<Way> {
        let Some([upper, _]) = folded(&self.filter, limb) else { return Vec::new() };
        let mut ways = vec![[upper; 2]];
        if self.level(limb.mirrored()) != LimbLevel::Absent {
            ways.push([upper, ways_of(&self.filter, limb.mirrored())[1]]);
        }
        ways.into_iter().map(|it| Way { limbs: vec![(limb, it)] }).collect()
    }

    fn with_way(&self, way: &Way) -> Self {
        let mut trial = self.clone();
        let left = self.filter.body.turn(Part::Torso) * Vector3::y();
        for (limb, ways) in &way.limbs {
            let mut body = trial.filter.body.clone();
            trial.forget_sizes(*limb);
            for (part, way) in limb.parts().into_iter().zip(ways) {
                body.turns[part.index()] = turn_of(&-way, &left);
            }
            let is_straight = ways[0].angle(&ways[1]) < self.options.acquisition.limbs.straight;
            trial.set_level(*limb, LimbLevel::Absent, &body);
            trial.set_level(*limb, if is_straight { LimbLevel::Straight } else { LimbLevel::Bent }, &body);
        }
        trial
    }

    fn cost_now(&self, field: &VoxelField) -> f64 {
        let mut fit = Fit::new(field, &self.options.fit, None);
        let layout = *self.filter.layout();
        fit.measure(&self.filter.body, &mut Normal::new(layout), &layout);
        let in_things = Self { beyond: self.beyond_hands(field), ..self.clone() }.in_things(Limb::ALL);
        fit.support.cost + self.unusual_limbs() + in_things
    }
}

/// Where a limb's parts point to, away from the trunk.
fn ways_of(filter: &BodyFilter, limb: Limb) -> [Vector3<f64>; 2] {
    limb.parts().map(|part| -(filter.body.turn(part) * Vector3::z()))
}

/// The same of a limb that is folded up.
fn folded(filter: &BodyFilter, limb: Limb) -> Option<[Vector3<f64>; 2]> {
    let has = limb.parts().iter().all(|it| filter.layout().has(*it));
    let ways = ways_of(filter, limb);
    (has && ways[0].angle(&ways[1]) > FOLDED).then_some(ways)
}
