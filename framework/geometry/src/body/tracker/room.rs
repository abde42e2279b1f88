//! Free room around a limb, and voxels beyond a hand: hulls of few views make a sheet of an arm, in which it may lie
//! anywhere; arms laid into a chair's back or an arm-rest end where these continue.

use nalgebra::{Point3, Vector3};

use super::super::field::VoxelField;
use super::super::model::Body;
use super::super::parts::{Joint, Limb, Part};
use super::BodyTracker;

/// Beyond a forearm with its fist, where open hands end [m], it is looked so far, in so many steps, so far from its axis.
const HAND: f64 = 0.06;
const BEYOND: f64 = 0.25;
const STEPS: usize = 10;
const BESIDE: f64 = 0.03;
const THIGHS: [Part; 2] = [Part::LeftThigh, Part::RightThigh];
/// Thighs of who sits are turned from the trunk by 50° and more: cosine [–]. The back of a chair is so far behind the trunk's own, at least [m].
const SEATED: f64 = 0.64;
const BEHIND: f64 = 0.04;
/// Around an axis it is looked so far, in radii of the part, beside a voxel [–].
const REACH: f64 = 2.5;
/// Places along the axis, away from it, and about it.
const PLACES: [usize; 3] = [8, 6, 8];
/// What lies this near to the skin of another part is that part's [m].
const OTHERS: f64 = 0.01;

/// Whether a thigh is turned from the trunk like a sitting person's.
pub(super) fn is_seated(body: &Body, thigh: Part) -> bool {
    (body.turn(thigh) * Vector3::z()).dot(&(body.turn(Part::Torso) * Vector3::z())) < SEATED
}

impl BodyTracker {
    /// Measures the room of all limbs: of both parts of an arm, of the thigh of a leg, whose calf may stand beside the other one.
    pub(super) fn look_around(&mut self, field: &VoxelField) {
        self.room = Limb::ALL.map(|limb| {
            let [upper, lower] = limb.parts().map(|it| self.room_of(field, limb, it));
            if limb.is_leg() { upper } else { upper.max(lower) }
        });
    }

    /// How far voxels that are no other part's go on beyond the hands of both arms [m].
    pub(super) fn beyond_hands(&self, field: &VoxelField) -> [f64; 2] {
        [Limb::LeftArm, Limb::RightArm].map(|limb| {
            let [_, lower] = limb.parts();
            if !self.filter.layout().has(lower) {
                return 0.0;
            }
            let body = &self.filter.body;
            let others = self.skins().without(&limb.parts());
            let (centre, turn, half) = (body.centres()[lower.index()], body.turn(lower), body.size(lower).z);
            // Hulls bulge: a hand that hangs beside a thigh ends there.
            let near = OTHERS + field.size() / 2.0;
            let is_free = |place: Point3<f64>| {
                field.cell(&place).is_some_and(|it| field.holds(it)) && others.distance(&place) > near
            };
            let is_there = |step: usize| {
                let z = -half - HAND - field.size() / 2.0 - BEYOND * (step as f64 + 0.5) / STEPS as f64;
                let around = [[0.0, 0.0], [BESIDE, 0.0], [-BESIDE, 0.0], [0.0, BESIDE], [0.0, -BESIDE]];
                around.into_iter().any(|[x, y]| is_free(centre + turn * Vector3::new(x, y, z)))
            };
            (0..STEPS).filter(|it| is_there(*it)).count() as f64 * BEYOND / STEPS as f64
        })
    }

    /// Whether both thighs are turned from the trunk.
    pub(super) fn sits(&self) -> bool {
        THIGHS.iter().all(|it| self.filter.layout().has(*it) && is_seated(&self.filter.body, *it))
    }

    /// Whether the hand of an arm is behind the back of a sitting person: there the chair's back is.
    pub(super) fn is_behind_back(&self, limb: Limb) -> bool {
        if limb.is_leg() || !limb.parts().iter().all(|it| self.filter.layout().has(*it)) || !self.sits() {
            return false;
        }
        let body = &self.filter.body;
        let up = body.turn(Part::Torso) * Vector3::z();
        let ahead: Vector3<f64> = THIGHS.iter().map(|it| -(body.turn(*it) * Vector3::z())).sum();
        let ahead = ahead - up * ahead.dot(&up);
        let wrist = body.joint(if limb == Limb::LeftArm { Joint::LeftWrist } else { Joint::RightWrist });
        let back = body.size(Part::Torso).x + BEHIND;
        (wrist - body.torso).dot(&ahead) < -back * ahead.norm()
    }

    /// What the voxels around a part of a limb hold that no other limb has, over its volume [–].
    fn room_of(&self, field: &VoxelField, limb: Limb, part: Part) -> f64 {
        if !self.filter.layout().has(part) {
            return 1.0;
        }
        let body = &self.filter.body;
        let others = self.skins().without(&limb.parts());
        let sizes = body.size(part);
        let radius = (sizes.x + sizes.y) / 2.0;
        let reach = REACH * radius + field.size();
        let [along, away, about] = PLACES;
        let (centre, turn) = (body.centres()[part.index()], body.turn(part));
        let mut held = 0.0;
        for ring in 0..away {
            let distance = reach * (ring as f64 + 0.5) / away as f64;
            // The part of the ring's area that each place represents.
            let area = std::f64::consts::TAU * distance * reach / (away * about * along) as f64;
            for (step, spoke) in (0..along).flat_map(|step| (0..about).map(move |spoke| (step, spoke))) {
                let angle = std::f64::consts::TAU * spoke as f64 / about as f64;
                let height = sizes.z * ((2 * step + 1) as f64 / along as f64 - 1.0);
                let place = centre + turn * Vector3::new(distance * angle.cos(), distance * angle.sin(), height);
                let is_held = field.cell(&place).is_some_and(|it| field.holds(it));
                if is_held && others.distance(&place) > OTHERS {
                    held += area;
                }
            }
        }
        held / (std::f64::consts::PI * radius.powi(2))
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::body::JointSource;
    use crate::body::acquire::turn_of;
    use crate::body::drawn::{self, followed};

    const WRISTS: [Joint; 2] = [Joint::LeftWrist, Joint::RightWrist];

    /// Whether the wrist nearer to a place is measured, and the other one.
    fn measured(tracker: &BodyTracker, place: &Point3<f64>) -> [bool; 2] {
        let mut wrists: Vec<_> = tracker.joints().into_iter().filter(|it| WRISTS.contains(&it.joint)).collect();
        assert_eq!(wrists.len(), 2);
        wrists.sort_by(|a, b| (a.position - place).norm().total_cmp(&(b.position - place).norm()));
        [0, 1].map(|it| wrists[it].source == JointSource::Measured)
    }

    #[test]
    fn an_arm_that_goes_on_beyond_its_hand_is_not_measured() {
        let person = drawn::somebody();
        let free = followed(&drawn::field(&person));
        assert!(free.beyond == [0.0; 2] && measured(&free, &Point3::origin()) == [true; 2], "{:?}", free.beyond);
        for (elbow, wrist) in [(Joint::LeftElbow, Joint::LeftWrist), (Joint::RightElbow, Joint::RightWrist)] {
            let [elbow, wrist] = [elbow, wrist].map(|it| free.filter.body.joint(it));
            // As an upright of a chair does.
            let pole = ([wrist, wrist + (wrist - elbow).normalize() * 0.5], 0.03);
            let held = followed(&drawn::field(&[&person[..], &[pole]].concat()));
            assert!(held.beyond.iter().filter(|it| **it > 0.08).count() == 1, "{:?}", held.beyond);
            assert_eq!(measured(&held, &wrist), [false, true]);
        }
    }

    #[test]
    fn hips_in_a_long_coat_are_not_at_its_hem() {
        let mut off = Vec::new();
        for seed in 0..8 {
            let mut random = Random::new(900 + seed);
            let stature = random.uniform_in(1.58, 1.88);
            let stance = drawn::Stance { stature, arms: [1.1, 1.0], ..drawn::Stance::upright(&mut random) };
            let (tubes, joints) = stance.drawn();
            let field = drawn::hull(&[tubes, drawn::coat(&joints)].concat(), &drawn::ring(8, &mut random), 0.025);
            // Now and then nobody is found in so much cloth.
            let Ok(mut tracker) = BodyTracker::acquire(&field, &Default::default()) else { continue };
            (0..15).for_each(|_| tracker.step(&field, 0.04, &[]));
            let height = |of: &dyn Fn(Joint) -> f64| (of(Joint::LeftHip) + of(Joint::RightHip)) / 2.0;
            let at = |joint: Joint| joints.iter().find(|it| it.0 == joint).unwrap().1.z;
            off.push(height(&|it| tracker.filter.body.joint(it).z) - height(&at));
        }
        assert!(off.len() >= 6 && off.iter().all(|it| (-0.10..0.02).contains(it)), "{off:.3?}");
    }

    #[test]
    fn behind_the_back_of_who_sits_is_no_arm_and_of_who_stands_it_may_be() {
        for (sits, seed) in (0..6).map(|it| (it % 2 == 0, it)) {
            let mut random = Random::new(seed);
            let stance = drawn::Stance { sits, arms: [0.9; 2], lean: 0.0, ..drawn::Stance::upright(&mut random) };
            let stance = drawn::Stance { stature: 1.7, ..stance };
            let field = drawn::hull(&stance.drawn().0, &drawn::ring(10, &mut random), 0.025);
            let mut tracker = followed(&field);
            assert!(!tracker.is_behind_back(Limb::LeftArm) && !tracker.is_behind_back(Limb::RightArm));
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), stance.heading);
            let left = turn * Vector3::y();
            for (limb, ahead) in [(Limb::LeftArm, -1.0), (Limb::RightArm, 1.0)] {
                let way = turn * Vector3::new(0.5 * ahead, 0.0, -1.0).normalize();
                for part in limb.parts() {
                    tracker.filter.body.turns[part.index()] = turn_of(&-way, &left);
                }
            }
            let found = [Limb::LeftArm, Limb::RightArm].map(|it| tracker.is_behind_back(it));
            assert_eq!(found, [sits, false], "{seed}");
        }
    }
}
