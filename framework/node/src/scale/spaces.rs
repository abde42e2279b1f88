//! The spaces of a rig's scales over time, kept from what their anchors say.

use foveate_messages::{Interval, ScaleId, ScaleSpace, Target, Time};
use foveate_scene::{SceneError, SceneGraph, SpaceId, UncertainPose};
use nalgebra::{Isometry3, Matrix3};

use super::ScaleTree;

/// How many poses of each space are kept: more than two seconds at 100 Hz.
const HISTORY: usize = 256;
/// How long the newest pose is extrapolated, and the oldest holds [ns].
const REACH_NS: i64 = 200_000_000;
/// Velocities of spaces are differences over this time [ns].
const STEP_NS: i64 = 1_000_000;

/// Where the scales around one scale are, through time: all those with the same world. A scale that is not anchored has its parent's
/// space; an anchored scale has none until [`Self::learn`] got its first message.
///
/// A node keeps one of these from an input `In::latest(…).many().optional()` of [`ScaleSpace`] to which the rig connects the anchors of its
/// scale and of those around it, and learns of all messages there before it asks.
#[derive(Debug, Clone)]
pub struct Spaces {
    scene: SceneGraph,
    /// By scale; `None`: of another world.
    spaces: Vec<Option<SpaceId>>,
    own: ScaleId,
    root: ScaleId,
    is_moving: bool,
}

impl Spaces {
    /// The spaces around the scale that looks, which is [`Self::own`].
    pub fn new(tree: &ScaleTree) -> Spaces {
        let root = tree.root_of(tree.own);
        let root_name = tree.place(root).map_or("", |it| it.name.as_str());
        let mut scene = SceneGraph::new(root_name, HISTORY, REACH_NS);
        let mut spaces: Vec<Option<SpaceId>> = Vec::with_capacity(tree.places.len());
        for (scale, place) in (0_u32..).map(ScaleId).zip(tree.places.iter()) {
            let parent = place.parent.and_then(|it| *spaces.get(it.0 as usize)?);
            let space = match parent {
                _ if scale == root => Some(SceneGraph::ROOT),
                Some(parent) => scene.add(&place.name, parent).ok(),
                None => None,
            };
            if let (Some(space), false, false) = (space, place.is_anchored, scale == root) {
                // Cannot be refused: it is in this scene, no root, and finite.
                let _ = scene.set_static(space, UncertainPose::exact(Isometry3::identity()));
            }
            spaces.push(space);
        }
        let is_moving = tree.around(tree.own).any(|it| tree.place(it).is_some_and(|it| it.is_anchored));
        Spaces { scene, spaces, own: tree.own, root, is_moving }
    }

    /// The scale that looks.
    pub fn own(&self) -> ScaleId {
        self.own
    }

    /// The scale whose space is the world of all these.
    pub fn root(&self) -> ScaleId {
        self.root
    }

    /// Whether the scale that looks has another space than the world, one that moves.
    pub fn is_moving(&self) -> bool {
        self.is_moving
    }

    /// Adds a message of an anchor; a repeated message, one of another world or one that is not finite changes nothing.
    pub fn learn(&mut self, said: &ScaleSpace) {
        let Some(space) = self.space(said.scale).filter(|it| *it != SceneGraph::ROOT) else { return };
        let pose = UncertainPose { transform: said.parent_from_scale, covariance: said.covariance };
        let _ = match said.target {
            Some(_) => self.scene.push_moving(space, said.time.0, pose, said.velocity, &said.motion_covariance),
            None => self.scene.suspend(space),
        };
    }

    /// From the space of scale `b` to that of scale `a` at `time`.
    ///
    /// # Errors
    /// Which space between the two is suspended then, is unknown, or is known only at times too far away.
    pub fn a_from_b(&self, a: ScaleId, b: ScaleId, time: Time) -> Result<UncertainPose, SceneError> {
        let foreign = |scale: ScaleId| SceneError::Foreign { index: scale.0 as usize, count: self.spaces.len() };
        let a = self.space(a).ok_or_else(|| foreign(a))?;
        let b = self.space(b).ok_or_else(|| foreign(b))?;
        self.scene.a_from_b(a, b, time.0)
    }

    /// From the space of the scale that looks to the world.
    ///
    /// # Errors
    /// As [`Self::a_from_b`].
    pub fn world_from_own(&self, time: Time) -> Result<UncertainPose, SceneError> {
        self.a_from_b(self.root, self.own, time)
    }

    /// The target, which is in the space of scale `b` and of `time`, in that of scale `a`: position, velocity and their covariance. The velocity of the spaces
    /// against each other is taken off; its own uncertainty is not in the covariance of the velocity.
    ///
    /// # Errors
    /// As [`Self::a_from_b`].
    pub fn target_in(&self, a: ScaleId, b: ScaleId, time: Time, target: &Target) -> Result<Target, SceneError> {
        let here = self.a_from_b(a, b, time)?;
        let before = self.a_from_b(a, b, time - Interval(STEP_NS)).unwrap_or(here);
        let block = |row, column| target.covariance.fixed_view::<3, 3>(row, column).into_owned();
        let (position, covariance) = here.transform_point(&target.position, &block(0, 0));
        let rotation: Matrix3<f64> = here.transform.rotation.to_rotation_matrix().into_inner();
        let drift = (position - before.transform * target.position) / Interval(STEP_NS).as_s();
        let mut moved = Target { position, velocity: rotation * target.velocity + drift, ..target.clone() };
        moved.covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&covariance);
        for (row, column) in [(0, 3), (3, 0), (3, 3)] {
            let turned = rotation * block(row, column) * rotation.transpose();
            moved.covariance.fixed_view_mut::<3, 3>(row, column).copy_from(&turned);
        }
        Ok(moved)
    }

    /// Whether the scale that looks, or one that it nests in, is without its target.
    pub fn is_suspended(&self) -> bool {
        self.space(self.own).is_none_or(|it| self.scene.is_suspended(it).unwrap_or(true))
    }

    fn space(&self, scale: ScaleId) -> Option<SpaceId> {
        *self.spaces.get(scale.0 as usize)?
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_messages::TargetId;
    use nalgebra::{Matrix6, Point3, Vector3};

    use super::super::ScalePlace;
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    /// hall > person > (plain) > hand, and a world of its own, seen by the hand.
    fn tree() -> ScaleTree {
        let place = |name: &str, parent: Option<u32>, is_anchored| ScalePlace {
            name: name.to_owned(),
            parent: parent.map(ScaleId),
            is_anchored,
        };
        let places = [
            place("hall", None, false),
            place("other", None, false),
            place("person", Some(0), true),
            place("plain", Some(2), false),
            place("hand", Some(3), true),
        ];
        ScaleTree { own: ScaleId(4), places: Arc::new(places) }
    }

    fn said(scale: u32, time: i64, x: f64, target: Option<u32>) -> ScaleSpace {
        ScaleSpace {
            scale: ScaleId(scale),
            time: Time(time),
            target: target.map(TargetId),
            parent_from_scale: Isometry3::translation(x, 0.0, 0.0),
            covariance: Matrix6::identity() * 1e-4,
            velocity: Vector3::new(1.0, 0.0, 0.0),
            motion_covariance: Matrix6::identity() * 1e-4,
        }
    }

    #[test]
    fn point_goes_from_the_innermost_scale_to_the_world_and_back() {
        let mut spaces = Spaces::new(&tree());
        assert_eq!((spaces.own(), spaces.root()), (ScaleId(4), ScaleId(0)));
        assert!(matches!(spaces.world_from_own(Time(0)), Err(SceneError::NoPose { .. })));
        for it in [said(2, 0, 5.0, Some(1)), said(4, 0, 0.5, Some(9)), said(4, 0, 0.5, Some(9))] {
            spaces.learn(&it);
        }
        let world_from_hand = spaces.world_from_own(Time(SECOND / 10)).unwrap();
        // 5 and 0.5, each extrapolated for 0.1 s at 1 m/s.
        let point = world_from_hand.transform * Point3::new(0.01, 0.0, 0.0);
        assert!((point.x - 5.71).abs() < 1e-12, "{point}");
        let back = spaces.a_from_b(ScaleId(4), ScaleId(0), Time(SECOND / 10)).unwrap();
        assert!((back.transform * point - Point3::new(0.01, 0.0, 0.0)).norm() < 1e-12);
        assert!(matches!(spaces.a_from_b(ScaleId(4), ScaleId(1), Time(0)), Err(SceneError::Foreign { .. })));
        assert!(matches!(spaces.a_from_b(ScaleId(77), ScaleId(0), Time(0)), Err(SceneError::Foreign { .. })));
    }

    #[test]
    fn target_takes_off_the_velocity_of_the_space_that_it_goes_to() {
        let mut spaces = Spaces::new(&tree());
        [said(2, 0, 5.0, Some(1)), said(4, 0, 0.5, Some(9))].iter().for_each(|it| spaces.learn(it));
        let target = Target {
            id: TargetId(3),
            position: Point3::new(5.7, 1.0, 0.0),
            velocity: Vector3::new(2.0, 0.5, 0.0),
            covariance: Matrix6::identity() * 1e-4,
            cameras: Default::default(),
            provenance: foveate_messages::Provenance::Measured,
        };
        let time = Time(SECOND / 10);
        // The hand is at 5.7 m then, and its space moves at 2 m/s in the hall.
        let in_hand = spaces.target_in(ScaleId(4), ScaleId(0), time, &target).unwrap();
        assert!((in_hand.position - Point3::new(0.0, 1.0, 0.0)).norm() < 1e-9, "{}", in_hand.position);
        assert!((in_hand.velocity - Vector3::new(0.0, 0.5, 0.0)).norm() < 1e-6, "{}", in_hand.velocity);
        assert!(in_hand.covariance[(0, 0)] > 2e-4 && in_hand.covariance[(4, 4)] == 1e-4);
        let back = spaces.target_in(ScaleId(0), ScaleId(4), time, &in_hand).unwrap();
        assert!((back.position - target.position).norm() < 1e-9 && (back.velocity - target.velocity).norm() < 1e-6);
    }

    #[test]
    fn lost_middle_scale_suspends_the_inner_one() {
        let mut spaces = Spaces::new(&tree());
        [said(2, 0, 5.0, Some(1)), said(4, 0, 0.5, Some(9))].iter().for_each(|it| spaces.learn(it));
        assert!(!spaces.is_suspended());
        spaces.learn(&said(2, 10, 5.0, None));
        assert!(spaces.is_suspended());
        assert!(matches!(spaces.world_from_own(Time(10)), Err(SceneError::Suspended { .. })));
        assert!(spaces.world_from_own(Time(0)).is_ok(), "it answers for the past");
        spaces.learn(&said(2, 20, 7.0, Some(2)));
        assert!(!spaces.is_suspended() && spaces.world_from_own(Time(20)).is_ok());
    }

    #[test]
    fn what_is_said_of_no_scale_of_this_world_is_passed_over() {
        let mut spaces = Spaces::new(&tree());
        [said(0, 0, 1.0, Some(1)), said(1, 0, 1.0, Some(1)), said(99, 0, 1.0, None)]
            .iter()
            .for_each(|it| spaces.learn(it));
        assert!(matches!(spaces.world_from_own(Time(0)), Err(SceneError::NoPose { .. })));
        let one = Spaces::new(&ScaleTree::of_one("room"));
        assert_eq!(one.world_from_own(Time(5)).unwrap(), UncertainPose::exact(Isometry3::identity()));
        assert!(!one.is_suspended() && !one.is_moving());
        let plain = Spaces::new(&ScaleTree { own: ScaleId(3), ..tree() });
        assert!(plain.is_moving(), "with the person around it");
    }
}
