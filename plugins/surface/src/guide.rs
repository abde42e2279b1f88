//! Predicts surface points from a body where no picture shows them: each moves with the part of the body that it is on.

use foveate::prelude::*;
use nalgebra::{Isometry3, Point3, Vector3};

/// Points farther from the surface of all parts lie on none [m].
const REACH_M: f64 = 0.03;

/// A place on a part of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anchor {
    /// Whose, and which part.
    part: (u32, u8),
    /// In the part's space [m].
    pub place: Point3<f64>,
}

/// The last two messages of a body.
#[derive(Debug, Default)]
pub struct Guide {
    /// The last, and the one before it.
    last: Option<Skeletons>,
    before: Option<Skeletons>,
}

fn pose_in(bodies: &Skeletons, (id, part): (u32, u8)) -> Option<Isometry3<f64>> {
    let body = bodies.list.iter().find(|it| it.id == id)?;
    Some(body.parts.iter().find(|it| it.part == part)?.scale_from_part)
}

impl Guide {
    /// Takes a message, unless it is the last one again.
    pub fn take(&mut self, bodies: &Skeletons) {
        if self.last.as_ref().is_none_or(|it| it.time < bodies.time) {
            self.before = self.last.replace(bodies.clone());
        }
    }

    /// The place of a point as it was at `time`; `None` where the last message is of another time, or no part is near.
    pub fn anchor(&self, point: &Point3<f64>, time: Time) -> Option<Anchor> {
        let bodies = self.last.as_ref().filter(|it| it.time == time)?;
        let all = bodies.list.iter().flat_map(|body| body.parts.iter().map(|part| (body.id, part)));
        let off = |(_, part): &(u32, &SkeletonPart)| {
            let at = part.scale_from_part.inverse_transform_point(point);
            let thick = 0.5 * (part.sizes.x + part.sizes.y);
            let beyond = (at.z.abs() - part.sizes.z).max(0.0);
            (at.x.hypot(at.y) - thick).abs().hypot(beyond)
        };
        let (id, part) = all.min_by(|a, b| off(a).total_cmp(&off(b))).filter(|it| off(it) < REACH_M)?;
        Some(Anchor { part: (id, part.part), place: part.scale_from_part.inverse_transform_point(point) })
    }

    /// Transform from the space of an anchor's part to the world at `time`, extrapolated from the last two messages. `None` where the last one has no such part.
    pub fn pose(&self, anchor: &Anchor, time: Time) -> Option<Isometry3<f64>> {
        let last = self.last.as_ref()?;
        let now = pose_in(last, anchor.part)?;
        let earlier = self.before.as_ref().and_then(|it| Some((it.time, pose_in(it, anchor.part)?)));
        let Some((then, was)) = earlier else { return Some(now) };
        let ahead = (time - last.time).as_s() / (last.time - then).as_s();
        let turned = (now.rotation * was.rotation.inverse()).scaled_axis() * ahead;
        let went = (now.translation.vector - was.translation.vector) * ahead;
        let rotation = nalgebra::UnitQuaternion::from_scaled_axis(turned) * now.rotation;
        Some(Isometry3::from_parts((now.translation.vector + went).into(), rotation))
    }

    /// How fast a point goes from one time to another, on average [m/s]; `None` as of [`Guide::pose`].
    pub fn velocity(&self, anchor: &Anchor, [from, to]: [Time; 2]) -> Option<Vector3<f64>> {
        let place = |time: Time| Some(self.pose(anchor, time)? * anchor.place);
        Some((place(to)? - place(from)?) / (to - from).as_s())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;

    /// A forearm that turns about z and goes along x.
    fn bodies(k: f64) -> Skeletons {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * 0.3 * k);
        let part = |part: u8, z: f64| SkeletonPart {
            part,
            scale_from_part: Isometry3::from_parts(Vector3::new(0.1 * k, 0.0, z).into(), turn),
            sizes: Vector3::new(0.04, 0.04, 0.12),
            size_sigmas: Vector3::repeat(0.003),
            provenance: Provenance::Measured,
        };
        let body = Skeleton {
            id: 4,
            joints: Vec::new(),
            parts: vec![part(3, 0.24), part(7, 0.0)],
            limbs: [LimbDetail::Absent; 4],
            facing: 1.0,
            unexplained: 0.0,
            cameras: CameraSet::default(),
        };
        Skeletons { time: Time::from_s(0.1 * k), list: vec![body], unmodelled: Vec::new() }
    }

    #[test]
    fn a_point_goes_on_with_its_part_and_one_off_all_parts_does_not() {
        let mut guide = Guide::default();
        guide.take(&bodies(1.0));
        let place = Point3::new(0.0, 0.04, 0.05);
        let pose = |k: f64| bodies(k).list[0].parts[1].scale_from_part;
        let anchor = guide.anchor(&(pose(1.0) * place), Time::from_s(0.1)).unwrap();
        assert!(anchor.part == (4, 7) && (anchor.place - place).norm() < 1e-12, "{anchor:?}");
        assert_eq!(guide.anchor(&(pose(1.0) * place), Time::from_s(0.2)), None);
        assert_eq!(guide.anchor(&(pose(1.0) * Point3::new(0.0, 0.09, 0.0)), Time::from_s(0.1)), None);
        assert_eq!(guide.anchor(&(pose(1.0) * Point3::new(0.0, 0.04, -0.17)), Time::from_s(0.1)), None);
        // With one message it stays, with two it goes on.
        assert!((guide.pose(&anchor, Time::from_s(0.2)).unwrap() * place - pose(1.0) * place).norm() < 1e-12);
        guide.take(&bodies(2.0));
        guide.take(&bodies(2.0));
        let ahead = guide.pose(&anchor, Time::from_s(0.35)).unwrap();
        assert!((ahead * place - pose(3.5) * place).norm() < 1e-9);
        let velocity = guide.velocity(&anchor, [Time::from_s(0.2), Time::from_s(0.3)]).unwrap();
        assert!((velocity - (pose(3.0) * place - pose(2.0) * place) / 0.1).norm() < 1e-9, "{velocity}");
        guide.take(&Skeletons { time: Time::from_s(0.4), ..Skeletons::default() });
        assert_eq!(guide.pose(&anchor, Time::from_s(0.5)), None);
    }
}
