//! The pose of a head from its lights, and which target is which light.
//!
//! Lights have no names. They are distinguished by their mutual distances: an assignment of targets to lights is valid when all distances agree, and of several valid assignments the one
//! that fits best is taken; the transform that fits must not mirror. Once known, a light is known by its target's identity.
//!
//! Three lights in view fix the head's pose; with two, the rotation about the line through them is kept; with one, the whole rotation. A head with only two lights is
//! initially assumed upright and facing the display: of the two possible assignments, the nearer to that is used.

use std::collections::BTreeMap;

use foveate::geometry::{AlignmentOptions, align};
use foveate::prelude::*;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};

/// Most targets that are searched for the lights: those of one person, and a few more.
const MOST_TARGETS: usize = 64;

/// A head with lights.
pub(crate) struct Head {
    /// In the head's space [m].
    lights: Vec<Point3<f64>>,
    /// Tolerance of distances [m].
    tolerance: f64,
    /// By target: which light it is.
    known: BTreeMap<TargetId, usize>,
    space_from_head: Option<Isometry3<f64>>,
    /// Initial orientation of a viewer.
    start: UnitQuaternion<f64>,
}

impl Head {
    /// Of lights in the head's space, two at least; `start` is the orientation of a viewer who faces the display.
    pub(crate) fn new(lights: Vec<Point3<f64>>, tolerance: f64, start: UnitQuaternion<f64>) -> Head {
        Head { lights, tolerance, known: BTreeMap::new(), space_from_head: None, start }
    }

    /// Forgets who is who.
    pub(crate) fn forget(&mut self) {
        (self.known, self.space_from_head) = (BTreeMap::new(), None);
    }

    /// Whether this target is one of the lights.
    pub(crate) fn knows(&self, id: TargetId) -> bool {
        self.known.contains_key(&id)
    }

    /// The head's pose from these targets; `None` where it is unobservable.
    pub(crate) fn find(&mut self, targets: &[Target]) -> Option<Isometry3<f64>> {
        self.known.retain(|id, _| targets.iter().any(|it| it.id == *id));
        if !self.is_consistent(targets) {
            self.known.clear();
        }
        if self.known.len() < self.lights.len() {
            self.search(targets);
        }
        let pose = self.pose(targets)?;
        self.space_from_head = Some(pose);
        Some(pose)
    }

    /// Whether known lights are as far from each other as they should be.
    fn is_consistent(&self, targets: &[Target]) -> bool {
        let known: Vec<(usize, Point3<f64>)> = self.seen(targets).collect();
        known.iter().enumerate().all(|(place, a)| known[..place].iter().all(|b| self.fits(a, b)))
    }

    fn fits(&self, a: &(usize, Point3<f64>), b: &(usize, Point3<f64>)) -> bool {
        let expected = (self.lights[a.0] - self.lights[b.0]).norm();
        ((a.1 - b.1).norm() - expected).abs() <= self.tolerance
    }

    /// Known lights that are among the targets: which, and where.
    pub(crate) fn seen<'t>(&'t self, targets: &'t [Target]) -> impl Iterator<Item = (usize, Point3<f64>)> + 't {
        targets.iter().filter_map(|it| Some((*self.known.get(&it.id)?, it.position)))
    }

    /// Finds the assignment of the most lights, and of these the one that fits best. Two lights alone are a distance, which chance has too: three are needed, or all
    /// that there are.
    fn search(&mut self, targets: &[Target]) {
        let targets = &targets[..targets.len().min(MOST_TARGETS)];
        let mut best: Option<(Vec<Option<usize>>, f64)> = None;
        let mut chosen = vec![None; self.lights.len()];
        for (id, light) in &self.known {
            chosen[*light] = targets.iter().position(|it| it.id == *id);
        }
        self.extend(targets, 0, &mut chosen, &mut best);
        let Some((chosen, _)) = best else { return };
        if count(&chosen) >= self.lights.len().min(3) {
            self.known =
                chosen.iter().enumerate().filter_map(|(light, it)| Some((targets[(*it)?].id, light))).collect();
        }
    }

    /// Goes on with light number `light`: each target that fits those chosen before, or none.
    fn extend(
        &self,
        targets: &[Target],
        light: usize,
        chosen: &mut Vec<Option<usize>>,
        best: &mut Option<(Vec<Option<usize>>, f64)>,
    ) {
        if light == self.lights.len() {
            let Some(error) = self.error(targets, chosen) else { return };
            let rank = |chosen: &[Option<usize>], error: f64| (count(chosen), -error);
            if best.as_ref().is_none_or(|it| rank(chosen, error) > rank(&it.0, it.1)) {
                *best = Some((chosen.clone(), error));
            }
            return;
        }
        if chosen[light].is_some() {
            return self.extend(targets, light + 1, chosen, best);
        }
        let n_needed = best.as_ref().map_or(1, |it| count(&it.0));
        for (index, target) in targets.iter().enumerate() {
            let this = (light, target.position);
            let others = chosen.iter().enumerate().filter_map(|(other, it)| Some((other, (*it)?)));
            let mut others = others.filter(|it| it.0 != light);
            if others.all(|(other, it)| it != index && self.fits(&this, &(other, targets[it].position))) {
                chosen[light] = Some(index);
                self.extend(targets, light + 1, chosen, best);
                chosen[light] = None;
            }
        }
        // Without this light there must still be as many as the best has.
        let still = count(&chosen[..light]) + chosen.len() - light - 1;
        if still >= n_needed {
            self.extend(targets, light + 1, chosen, best);
        }
    }

    /// How badly the chosen targets fit: what is left [m], or of two by how much the head would turn from looking at the display [rad]. `None` for a mirrored set.
    fn error(&self, targets: &[Target], chosen: &[Option<usize>]) -> Option<f64> {
        let pairs =
            chosen.iter().enumerate().filter_map(|(light, it)| Some((self.lights[light], targets[(*it)?].position)));
        let (lights, positions): (Vec<_>, Vec<_>) = pairs.unzip();
        if let ([a, b], [p, q]) = (&lights[..], &positions[..]) {
            return Some((self.turn() * (b - a)).angle(&(q - p)));
        }
        if lights.len() < 3 {
            return None;
        }
        let found = align(&lights, &positions, AlignmentOptions::default()).ok()?;
        found.distances.iter().all(|it| *it <= self.tolerance).then_some(found.rms)
    }

    /// How the head was turned last.
    fn turn(&self) -> UnitQuaternion<f64> {
        self.space_from_head.map_or(self.start, |it| it.rotation)
    }

    fn pose(&self, targets: &[Target]) -> Option<Isometry3<f64>> {
        let (which, positions): (Vec<usize>, Vec<Point3<f64>>) = self.seen(targets).unzip();
        let lights: Vec<Point3<f64>> = which.iter().map(|it| self.lights[*it]).collect();
        if lights.len() >= 3
            && let Ok(found) = align(&lights, &positions, AlignmentOptions::default())
        {
            return Some(found.b_from_a.isometry);
        }
        let turn = self.turn();
        let turn = match (&lights[..], &positions[..]) {
            ([a, b, ..], [p, q, ..]) => {
                let least = UnitQuaternion::rotation_between(&(turn * (b - a)), &(q - p));
                least.unwrap_or_else(UnitQuaternion::identity) * turn
            }
            ([_], [_]) if self.space_from_head.is_some() => turn,
            _ => return None,
        };
        let n = lights.len() as f64;
        let sum = lights.iter().zip(&positions).map(|(light, it)| it.coords - turn * light.coords);
        Some(Isometry3::from_parts(Translation3::from(sum.sum::<nalgebra::Vector3<f64>>() / n), turn))
    }
}

fn count(chosen: &[Option<usize>]) -> usize {
    chosen.iter().flatten().count()
}

#[cfg(test)]
mod tests {
    use foveate::estimation::Random;
    use nalgebra::{Matrix6, Vector3};

    use super::*;

    const LIGHTS: [[f64; 3]; 4] = [[0.024, 0.0, 0.118], [0.135, 0.02, 0.05], [0.0, 0.14, 0.03], [-0.03, -0.135, 0.06]];

    fn lights() -> Vec<Point3<f64>> {
        LIGHTS.map(Point3::from).into()
    }

    fn target(id: u32, position: Point3<f64>) -> Target {
        Target {
            id: TargetId(id),
            position,
            velocity: Vector3::zeros(),
            covariance: Matrix6::identity() * 1e-6,
            cameras: CameraSet::default(),
            provenance: Provenance::Measured,
        }
    }

    /// The lights of a head somewhere, to a millimetre, in any order under any identity, among seven other lights.
    fn scene(random: &mut Random) -> (Isometry3<f64>, Vec<Target>, [u32; 4]) {
        let vector = |random: &mut Random, size: f64| Vector3::from_fn(|_, _| random.uniform_in(-size, size));
        let pose = Isometry3::new(vector(random, 2.0), vector(random, 3.0));
        let mut places: Vec<(usize, Point3<f64>)> =
            lights().iter().map(|it| pose * it + vector(random, 1e-3)).enumerate().collect();
        places.extend((0..7).map(|_| (9, pose * (Point3::origin() + vector(random, 0.8)))));
        let mut order: Vec<usize> = (0..places.len()).collect();
        for place in (1..order.len()).rev() {
            order.swap(place, random.below(place as u32 + 1) as usize);
        }
        let mut ids = [0; 4];
        let mut targets = Vec::new();
        for (number, place) in order.into_iter().enumerate() {
            let id = 10 + number as u32;
            if places[place].0 < 4 {
                ids[places[place].0] = id;
            }
            targets.push(target(id, places[place].1));
        }
        (pose, targets, ids)
    }

    #[track_caller]
    fn check(found: Option<Isometry3<f64>>, pose: &Isometry3<f64>, mm: f64, deg: f64) {
        let found = found.unwrap();
        assert!((found.translation.vector - pose.translation.vector).norm() < mm * 1e-3, "{found} {pose}");
        assert!(found.rotation.angle_to(&pose.rotation).to_degrees() < deg, "{found} {pose}");
    }

    #[test]
    fn a_head_is_found_among_other_lights_wherever_it_looks() {
        let mut random = Random::new(7);
        for _ in 0..200 {
            let (pose, targets, _) = scene(&mut random);
            check(Head::new(lights(), 0.012, UnitQuaternion::identity()).find(&targets), &pose, 3.0, 1.5);
        }
    }

    #[test]
    fn lights_that_are_hidden_cost_what_they_tell_and_no_more() {
        let mut random = Random::new(8);
        for _ in 0..100 {
            let (pose, targets, ids) = scene(&mut random);
            let without = |hidden: &[usize]| -> Vec<Target> {
                targets.iter().filter(|it| !hidden.iter().any(|light| ids[*light] == it.id.0)).cloned().collect()
            };
            let mut head = Head::new(lights(), 0.012, UnitQuaternion::identity());
            head.find(&targets);
            check(head.find(&without(&[2])), &pose, 4.0, 2.5);
            check(head.find(&without(&[0, 2])), &pose, 8.0, 4.0);
            check(head.find(&without(&[0, 1, 2])), &pose, 12.0, 4.0);
            assert_eq!(head.find(&without(&[0, 1, 2, 3])), None);
        }
    }

    /// Three lights have no handedness, four have: beside its image in a window or on a shining floor the head itself fits with one light more.
    #[test]
    fn the_image_of_a_head_in_a_mirror_is_not_taken_for_it_and_neither_is_a_crowd_of_other_lights() {
        let mut random = Random::new(9);
        for _ in 0..50 {
            let (pose, targets, _) = scene(&mut random);
            // In the plane x = 3 m, looked at first.
            let mirrored = targets.iter().map(|it| Target {
                id: TargetId(it.id.0 + 100),
                position: Point3::new(6.0 - it.position.x, it.position.y, it.position.z),
                ..it.clone()
            });
            let both: Vec<Target> = mirrored.chain(targets.iter().cloned()).collect();
            check(Head::new(lights(), 0.012, UnitQuaternion::identity()).find(&both), &pose, 3.0, 1.5);
        }
        let apart: Vec<Target> = (0..20).map(|it| target(it, Point3::new(f64::from(it), 0.0, 0.0))).collect();
        assert_eq!(Head::new(lights(), 0.012, UnitQuaternion::identity()).find(&apart), None);
    }

    #[test]
    fn an_identity_that_is_taken_over_by_another_light_is_found_out() {
        let mut random = Random::new(10);
        let (pose, mut targets, ids) = scene(&mut random);
        let mut head = Head::new(lights(), 0.012, UnitQuaternion::identity());
        head.find(&targets);
        let [a, b] = [ids[0], ids[3]].map(|id| targets.iter().position(|it| it.id.0 == id).unwrap());
        let swapped = (targets[a].position, targets[b].position);
        (targets[a].position, targets[b].position) = (swapped.1, swapped.0);
        check(head.find(&targets), &pose, 3.0, 1.5);
    }

    #[test]
    fn two_lights_and_then_one_follow_as_far_as_they_can() {
        let pair = vec![Point3::new(0.0, 0.07, 0.0), Point3::new(0.0, -0.07, 0.0)];
        // Upright, about a radian to the side of where the display is; the other way round is farther.
        for heading in [-1.0, 0.3, 1.2] {
            let mut head = Head::new(pair.clone(), 0.01, UnitQuaternion::identity());
            let place = Isometry3::new(Vector3::new(1.0, 2.0, 1.7), Vector3::z() * heading);
            let mut targets: Vec<Target> = pair.iter().zip(0..).map(|(it, id)| target(id, place * it)).collect();
            targets.reverse();
            check(head.find(&targets), &place, 1.0, 0.1);
            check(head.find(&targets[..1]), &place, 1.0, 0.1);
        }
    }
}
