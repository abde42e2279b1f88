//! The tree of spaces over time.
//!
//! Each space hangs below a parent by `parent_from_space`, which is fixed or a bounded history of timed poses. Between two
//! samples the translation is interpolated linearly and the rotation along the shortest arc; beyond the ends the nearest sample
//! holds for a limited time, and a newest one with a velocity is carried on by it. The covariance of a pose is that of δ in T ⊕ δ = T exp(δ), δ = (rotation [rad],
//! translation [m]), so that with the adjoint Ad of the transforms
//!
//! Σ(T₁T₂) = Ad(T₂⁻¹) Σ₁ Ad(T₂⁻¹)ᵀ + Σ₂,  Σ(T⁻¹) = Ad(T) Σ Ad(T)ᵀ
//!
//! to first order, for independent errors (T. Barfoot and P. Furgale, "Associating uncertainty with three-dimensional
//! poses", IEEE T-RO 30(3), 2014, with their left perturbation turned into a right one). Between samples the
//! covariances are interpolated too, which errs on the safe side whether or not the samples' errors are correlated.
//!
//! A space whose target is lost is *suspended*: it answers for the past, keeps what it holds, and resumes with the next pose.

use std::collections::VecDeque;

use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Vector3};

/// A space of one [`SceneGraph`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SpaceId(usize);

/// A rigid transform and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UncertainPose {
    /// `b_from_a`, as the place where it stands says.
    pub transform: Isometry3<f64>,
    /// Of δ in `transform` ∘ exp(δ), (rotation, translation) [rad², rad m, m²].
    pub covariance: Matrix6<f64>,
}

/// Why the scene has no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// A second space of the same name.
    #[error("there is a space {name:?} already")]
    NameTaken {
        /// The name.
        name: String,
    },
    /// An identity that this graph has not given out.
    #[error("space number {index} is not of this scene, which has {count}")]
    Foreign {
        /// Its number.
        index: usize,
        /// How many spaces there are.
        count: usize,
    },
    /// The root has no parent to have a pose in.
    #[error("the root space {name:?} cannot be moved")]
    Root {
        /// Its name.
        name: String,
    },
    /// A pose with a number that is NaN or infinite.
    #[error("a pose of space {space:?} is not finite")]
    NotFinite {
        /// Its name.
        space: String,
    },
    /// A space that never had a pose.
    #[error("space {space:?} has had no pose yet")]
    NoPose {
        /// Its name.
        space: String,
    },
    /// A space whose target is lost, asked for a time after its last pose.
    #[error("space {space:?} is suspended: its last pose is of {last_ns} ns, asked for {time_ns} ns")]
    Suspended {
        /// Its name.
        space: String,
        /// Of the last pose [ns].
        last_ns: i64,
        /// Asked for [ns].
        time_ns: i64,
    },
    /// A time too far before the first or after the last pose that is kept.
    #[error("space {space:?} has poses from {first_ns} ns to {last_ns} ns, too far from {time_ns} ns")]
    OutOfReach {
        /// Its name.
        space: String,
        /// Of the first pose kept [ns].
        first_ns: i64,
        /// Of the last pose [ns].
        last_ns: i64,
        /// Asked for [ns].
        time_ns: i64,
    },
}

#[derive(Debug, Clone)]
struct Space {
    name: String,
    parent: Option<SpaceId>,
    motion: Motion,
    suspended: bool,
}

#[derive(Debug, Clone)]
enum Motion {
    Fixed(Box<UncertainPose>),
    /// Ascending in time, no two at the same; and how the newest goes on.
    Timed(VecDeque<(i64, UncertainPose)>, Option<Box<Drift>>),
}

/// How the newest pose of a space goes on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Drift {
    /// Of the origin, in the parent [m/s].
    velocity: Vector3<f64>,
    /// Of (origin, velocity) in the parent [m², m²/s, m²/s²].
    covariance: Matrix6<f64>,
}

/// Nested spaces below one root.
#[derive(Debug, Clone)]
pub struct SceneGraph {
    spaces: Vec<Space>,
    history: usize,
    reach_ns: i64,
}

impl SceneGraph {
    /// The root of every scene.
    pub const ROOT: SpaceId = SpaceId(0);

    /// A scene with a root space called `root`. Each moving space keeps its last `history` poses (at least 2 are kept), and
    /// the first and last of them hold for `reach_ns` nanoseconds before and after.
    pub fn new(root: &str, history: usize, reach_ns: i64) -> SceneGraph {
        let root = Space {
            name: root.to_owned(),
            parent: None,
            motion: Motion::Fixed(Box::new(UncertainPose::exact(Isometry3::identity()))),
            suspended: false,
        };
        SceneGraph { spaces: vec![root], history: history.max(2), reach_ns: reach_ns.max(0) }
    }

    /// Adds a space below `parent`, without a pose yet.
    pub fn add(&mut self, name: &str, parent: SpaceId) -> Result<SpaceId, SceneError> {
        self.space(parent)?;
        if self.find(name).is_some() {
            return Err(SceneError::NameTaken { name: name.to_owned() });
        }
        let motion = Motion::Timed(VecDeque::new(), None);
        self.spaces.push(Space { name: name.to_owned(), parent: Some(parent), motion, suspended: false });
        Ok(SpaceId(self.spaces.len() - 1))
    }

    /// The space called `name`.
    pub fn find(&self, name: &str) -> Option<SpaceId> {
        self.spaces.iter().position(|it| it.name == name).map(SpaceId)
    }

    /// The name of a space.
    pub fn name(&self, space: SpaceId) -> Result<&str, SceneError> {
        Ok(&self.space(space)?.name)
    }

    /// The parent of a space; `None` for the root.
    pub fn parent(&self, space: SpaceId) -> Result<Option<SpaceId>, SceneError> {
        Ok(self.space(space)?.parent)
    }

    /// Fixes `space` in its parent for all times; its history, if any, is dropped.
    pub fn set_static(&mut self, space: SpaceId, parent_from_space: UncertainPose) -> Result<(), SceneError> {
        let space = self.movable(space, &parent_from_space)?;
        space.motion = Motion::Fixed(Box::new(parent_from_space));
        space.suspended = false;
        Ok(())
    }

    /// Adds where `space` was at `time_ns`; a pose of the same time is replaced, a late one put in its place, the oldest
    /// forgotten when there are too many. Resumes a suspended space when the pose is its newest.
    pub fn push(&mut self, space: SpaceId, time_ns: i64, parent_from_space: UncertainPose) -> Result<(), SceneError> {
        self.put(space, time_ns, parent_from_space, None)
    }

    fn put(
        &mut self,
        space: SpaceId,
        time_ns: i64,
        parent_from_space: UncertainPose,
        drift: Option<Drift>,
    ) -> Result<(), SceneError> {
        let history = self.history;
        let space = self.movable(space, &parent_from_space)?;
        if let Motion::Fixed(_) = space.motion {
            space.motion = Motion::Timed(VecDeque::with_capacity(history + 1), None);
        }
        let Motion::Timed(samples, newest) = &mut space.motion else { unreachable!("made timed above") };
        if samples.back().is_none_or(|it| it.0 <= time_ns) {
            match (newest.as_deref_mut(), drift) {
                (Some(place), Some(drift)) => *place = drift,
                (_, drift) => *newest = drift.map(Box::new),
            }
        }
        let place = samples.partition_point(|(time, _)| *time < time_ns);
        match samples.get_mut(place) {
            Some(sample) if sample.0 == time_ns => sample.1 = parent_from_space,
            _ => samples.insert(place, (time_ns, parent_from_space)),
        }
        space.suspended &= place + 1 < samples.len();
        if samples.len() > history {
            samples.pop_front();
        }
        Ok(())
    }

    /// As [`Self::push`] for a space that is anchored to a target: it moves to `position` [m] in its parent, known
    /// to `covariance` [m²], and keeps its parent's axes.
    pub fn push_anchor(
        &mut self,
        space: SpaceId,
        time_ns: i64,
        position: Point3<f64>,
        covariance: &Matrix3<f64>,
    ) -> Result<(), SceneError> {
        let mut pose = UncertainPose::exact(Isometry3::translation(position.x, position.y, position.z));
        pose.covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(covariance);
        self.push(space, time_ns, pose)
    }

    /// As [`Self::push`] for a space whose origin moves with `velocity` in its parent [m/s]: as long as this pose is the newest one, later
    /// times have it carried on, less and less certainly. `covariance` is that of (origin, velocity) in the parent [m², m²/s, m²/s²]. An
    /// acceleration is not in that.
    pub fn push_moving(
        &mut self,
        space: SpaceId,
        time_ns: i64,
        parent_from_space: UncertainPose,
        velocity: Vector3<f64>,
        covariance: &Matrix6<f64>,
    ) -> Result<(), SceneError> {
        if !velocity.iter().chain(covariance).all(|it| it.is_finite()) {
            return Err(SceneError::NotFinite { space: self.space(space)?.name.clone() });
        }
        let drift = Drift { velocity, covariance: *covariance };
        self.put(space, time_ns, parent_from_space, Some(drift))
    }

    /// Says that the target of `space` is lost: it answers for times up to its last pose only, until the next pose.
    pub fn suspend(&mut self, space: SpaceId) -> Result<(), SceneError> {
        self.space(space)?;
        if space == Self::ROOT {
            return Err(SceneError::Root { name: self.spaces[0].name.clone() });
        }
        self.spaces[space.0].suspended = true;
        Ok(())
    }

    /// Whether `space` or one that it hangs below is suspended.
    pub fn is_suspended(&self, space: SpaceId) -> Result<bool, SceneError> {
        let mut next = Some(space);
        while let Some(id) = next {
            let space = self.space(id)?;
            if space.suspended {
                return Ok(true);
            }
            next = space.parent;
        }
        Ok(false)
    }

    /// The transform from the coordinates of `b` to those of `a` at `time_ns`. Only the spaces between the two and their
    /// nearest common ancestor enter, so that what moves both adds no uncertainty.
    pub fn a_from_b(&self, a: SpaceId, b: SpaceId, time_ns: i64) -> Result<UncertainPose, SceneError> {
        self.space(a)?;
        self.space(b)?;
        let (mut up_a, mut up_b) = (a, b);
        let [mut above_from_a, mut above_from_b] = [UncertainPose::exact(Isometry3::identity()); 2];
        // A child is added after its parent: going up from the one with the larger number ends at the common ancestor.
        while up_a != up_b {
            let (from, chain) =
                if up_a > up_b { (&mut up_a, &mut above_from_a) } else { (&mut up_b, &mut above_from_b) };
            *chain = self.parent_from_space(*from, time_ns)?.then_from(chain);
            *from = self.spaces[from.0].parent.unwrap_or(Self::ROOT);
        }
        Ok(above_from_a.inverse().then_from(&above_from_b))
    }

    fn parent_from_space(&self, id: SpaceId, time_ns: i64) -> Result<UncertainPose, SceneError> {
        let space = self.space(id)?;
        let (samples, drift) = match &space.motion {
            Motion::Fixed(pose) => return Ok(**pose),
            Motion::Timed(samples, drift) => (samples, drift),
        };
        let (Some(&(first_ns, first)), Some(&(last_ns, last))) = (samples.front(), samples.back()) else {
            return Err(SceneError::NoPose { space: space.name.clone() });
        };
        if space.suspended && time_ns > last_ns {
            return Err(SceneError::Suspended { space: space.name.clone(), last_ns, time_ns });
        }
        if time_ns < first_ns.saturating_sub(self.reach_ns) || time_ns > last_ns.saturating_add(self.reach_ns) {
            return Err(SceneError::OutOfReach { space: space.name.clone(), first_ns, last_ns, time_ns });
        }
        let after = samples.partition_point(|(time, _)| *time <= time_ns);
        if after == 0 {
            return Ok(first);
        }
        let (earlier_ns, earlier) = samples[after - 1];
        // In i128: the differences of two i64 times may not fit.
        let since = |time: i64| (i128::from(time) - i128::from(earlier_ns)) as f64;
        let Some(&(later_ns, later)) = samples.get(after) else {
            return Ok(drift.as_ref().map_or(last, |drift| drift.carry(&last, since(time_ns) * 1e-9)));
        };
        Ok(earlier.towards(&later, since(time_ns) / since(later_ns)))
    }

    fn space(&self, id: SpaceId) -> Result<&Space, SceneError> {
        self.spaces.get(id.0).ok_or(SceneError::Foreign { index: id.0, count: self.spaces.len() })
    }

    fn movable(&mut self, id: SpaceId, pose: &UncertainPose) -> Result<&mut Space, SceneError> {
        let name = self.space(id)?.name.clone();
        if id == Self::ROOT {
            return Err(SceneError::Root { name });
        }
        let transform = pose.transform.to_homogeneous();
        if !transform.iter().chain(pose.covariance.iter()).all(|it| it.is_finite()) {
            return Err(SceneError::NotFinite { space: name });
        }
        Ok(&mut self.spaces[id.0])
    }
}

impl Drift {
    /// `pose` so many seconds later.
    fn carry(&self, pose: &UncertainPose, seconds: f64) -> UncertainPose {
        let mut later = *pose;
        later.transform.translation.vector += self.velocity * seconds;
        let both = self.covariance.fixed_view::<3, 3>(0, 3) + self.covariance.fixed_view::<3, 3>(3, 0);
        let growth = both * seconds + self.covariance.fixed_view::<3, 3>(3, 3) * (seconds * seconds);
        let rotation = *pose.transform.rotation.to_rotation_matrix().matrix();
        let mut block = later.covariance.fixed_view_mut::<3, 3>(3, 3);
        block += rotation.transpose() * growth * rotation;
        later
    }
}

impl UncertainPose {
    /// A transform without uncertainty.
    pub fn exact(transform: Isometry3<f64>) -> UncertainPose {
        UncertainPose { transform, covariance: Matrix6::zeros() }
    }

    /// `c_from_a`, where `self` is `c_from_b`.
    pub fn then_from(&self, b_from_a: &UncertainPose) -> UncertainPose {
        let carry = adjoint(&b_from_a.transform.inverse());
        UncertainPose {
            transform: self.transform * b_from_a.transform,
            covariance: carry * self.covariance * carry.transpose() + b_from_a.covariance,
        }
    }

    /// `a_from_b`, where `self` is `b_from_a`.
    pub fn inverse(&self) -> UncertainPose {
        let carry = adjoint(&self.transform);
        UncertainPose { transform: self.transform.inverse(), covariance: carry * self.covariance * carry.transpose() }
    }

    /// A point of `a`, known to `covariance` [m²], in the coordinates of `b`, where `self` is `b_from_a`.
    pub fn transform_point(&self, point_in_a: &Point3<f64>, covariance: &Matrix3<f64>) -> (Point3<f64>, Matrix3<f64>) {
        let rotation = self.transform.rotation.to_rotation_matrix();
        let mut by_pose = nalgebra::Matrix3x6::zeros();
        by_pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&-point_in_a.coords.cross_matrix());
        by_pose.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
        let spread = by_pose * self.covariance * by_pose.transpose() + covariance;
        (self.transform * point_in_a, rotation.matrix() * spread * rotation.matrix().transpose())
    }

    /// `share` of the way to `other`, 0 ≤ share ≤ 1.
    fn towards(&self, other: &UncertainPose, share: f64) -> UncertainPose {
        let (from, to) = (&self.transform, &other.transform);
        let arc = from.rotation.rotation_to(&to.rotation).scaled_axis(); // in the parent, of length up to π
        let rotation = nalgebra::UnitQuaternion::from_scaled_axis(arc * share) * from.rotation;
        let translation = from.translation.vector.lerp(&to.translation.vector, share);
        UncertainPose {
            transform: Isometry3::from_parts(translation.into(), rotation),
            covariance: self.covariance * (1.0 - share) + other.covariance * share,
        }
    }
}

/// Ad(T) with T exp(δ) = exp(Ad(T) δ) T, δ = (rotation, translation).
fn adjoint(transform: &Isometry3<f64>) -> Matrix6<f64> {
    let rotation = transform.rotation.to_rotation_matrix();
    let mut adjoint = Matrix6::zeros();
    adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation.matrix());
    adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation.matrix());
    let lever = transform.translation.vector.cross_matrix() * rotation.matrix();
    adjoint.fixed_view_mut::<3, 3>(3, 0).copy_from(&lever);
    adjoint
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3, Vector6};
    use proptest::prelude::*;

    use super::*;

    const SECOND: i64 = 1_000_000_000;

    fn pose(translation: [f64; 3], turn: [f64; 3]) -> UncertainPose {
        UncertainPose::exact(Isometry3::new(translation.into(), turn.into()))
    }

    /// A room with a head anchored in it and an eye fixed in the head.
    fn room_head_eye() -> (SceneGraph, [SpaceId; 3]) {
        let mut scene = SceneGraph::new("room", 4, SECOND / 10);
        let head = scene.add("head", SceneGraph::ROOT).unwrap();
        let eye = scene.add("eye", head).unwrap();
        scene.set_static(eye, pose([0.0, 0.1, 0.0], [0.0, 0.0, std::f64::consts::FRAC_PI_2])).unwrap();
        (scene, [SceneGraph::ROOT, head, eye])
    }

    fn anchor(scene: &mut SceneGraph, space: SpaceId, time_ns: i64, x: f64) {
        scene.push_anchor(space, time_ns, Point3::new(x, 0.0, 1.5), &(Matrix3::identity() * 1e-4)).unwrap();
    }

    #[test]
    fn a_point_goes_through_moving_and_fixed_spaces() {
        let (mut scene, [room, head, eye]) = room_head_eye();
        anchor(&mut scene, head, 0, 0.0);
        anchor(&mut scene, head, SECOND, 2.0);
        let room_from_eye = scene.a_from_b(room, eye, SECOND / 4).unwrap();
        let (point, covariance) = room_from_eye.transform_point(&Point3::new(1.0, 0.0, 0.0), &Matrix3::zeros());
        assert!((point - Point3::new(0.5, 1.1, 1.5)).norm() < 1e-12, "{point}");
        assert!((covariance - Matrix3::identity() * 1e-4).norm() < 1e-15);
        let back = scene.a_from_b(eye, room, SECOND / 4).unwrap();
        assert!((back.transform * point - Point3::new(1.0, 0.0, 0.0)).norm() < 1e-12);
        assert_eq!(scene.a_from_b(eye, eye, 7).unwrap(), pose([0.0; 3], [0.0; 3]));
    }

    #[test]
    fn what_moves_both_spaces_adds_no_uncertainty() {
        let (mut scene, [_, head, eye]) = room_head_eye();
        let other = scene.add("other eye", head).unwrap();
        scene.set_static(other, pose([0.0, -0.1, 0.0], [0.0; 3])).unwrap();
        // The head has no pose at all, and need not.
        let between = scene.a_from_b(eye, other, 0).unwrap();
        assert_eq!(between.covariance, Matrix6::zeros());
        assert!((between.transform * Point3::origin() - Point3::new(-0.2, 0.0, 0.0)).norm() < 1e-12);
        assert_eq!(scene.a_from_b(SceneGraph::ROOT, eye, 0), Err(SceneError::NoPose { space: "head".into() }));
    }

    #[test]
    fn rotations_are_interpolated_along_the_shorter_arc() {
        let (mut scene, [room, head, _]) = room_head_eye();
        let turn = |angle: f64| pose([0.0; 3], [0.0, 0.0, angle]);
        // Quaternions of 170° and 190°, the latter written with the opposite sign.
        scene.push(head, 0, turn(170f64.to_radians())).unwrap();
        let mut later = turn(190f64.to_radians());
        later.transform.rotation = UnitQuaternion::new_unchecked(-later.transform.rotation.into_inner());
        scene.push(head, 100, later).unwrap();
        let middle = scene.a_from_b(room, head, 25).unwrap().transform.rotation;
        assert!(middle.angle_to(&UnitQuaternion::from_scaled_axis(Vector3::z() * 175f64.to_radians())) < 1e-9);
    }

    #[test]
    fn poses_hold_for_the_reach_and_no_longer() {
        let (mut scene, [room, head, _]) = room_head_eye();
        anchor(&mut scene, head, 0, 1.0);
        anchor(&mut scene, head, SECOND, 2.0);
        let x = |time_ns| scene.a_from_b(room, head, time_ns).map(|it| it.transform.translation.x);
        let reach = SECOND / 10;
        assert_eq!([x(-reach), x(0), x(SECOND), x(SECOND + reach)], [Ok(1.0), Ok(1.0), Ok(2.0), Ok(2.0)]);
        for time_ns in [-reach - 1, SECOND + reach + 1, i64::MIN, i64::MAX] {
            let out = SceneError::OutOfReach { space: "head".into(), first_ns: 0, last_ns: SECOND, time_ns };
            assert_eq!(x(time_ns), Err(out));
        }
    }

    #[test]
    fn newest_pose_is_carried_on_by_its_velocity_and_grows_less_certain() {
        let (mut scene, [room, head, _]) = room_head_eye();
        // A head that is turned by 90° about z; its own x is the room's y.
        let mut turned = pose([1.0, 0.0, 0.0], [0.0, 0.0, std::f64::consts::FRAC_PI_2]);
        turned.covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::from_diagonal(&[1e-6, 4e-4, 0.0].into()));
        let mut covariance = Matrix6::zeros();
        covariance[(0, 0)] = 4e-4;
        covariance[(1, 1)] = 1e-6;
        covariance[(3, 3)] = 0.01;
        (covariance[(0, 3)], covariance[(3, 0)]) = (1e-3, 1e-3);
        let velocity = Vector3::new(2.0, 0.0, 0.0);
        scene.push_moving(head, 0, turned, velocity, &covariance).unwrap();
        let later = scene.a_from_b(room, head, SECOND / 10).unwrap();
        let (origin, spread) = later.transform_point(&Point3::origin(), &Matrix3::zeros());
        assert!((origin - Point3::new(1.2, 0.0, 0.0)).norm() < 1e-12, "{origin}");
        // 4e-4 + 2 · 0.1 · 1e-3 + 0.1² · 0.01 along x of the room; nothing new along y.
        let expected = Matrix3::from_diagonal(&[7e-4, 1e-6, 0.0].into());
        assert!((spread - expected).norm() < 1e-12, "{spread}");
        // A newer pose without a velocity holds, and a late one does not bring a velocity back.
        scene.push(head, 50_000_000, pose([1.1, 0.0, 0.0], [0.0; 3])).unwrap();
        scene.push_moving(head, 10_000_000, turned, velocity, &covariance).unwrap();
        assert_eq!(scene.a_from_b(room, head, SECOND / 10).unwrap().transform.translation.x, 1.1);
        let broken = Vector3::new(f64::NAN, 0.0, 0.0);
        assert!(matches!(scene.push_moving(head, 0, turned, broken, &covariance), Err(SceneError::NotFinite { .. })));
    }

    #[test]
    fn history_is_bounded_and_takes_late_and_repeated_poses() {
        let (mut scene, [room, head, _]) = room_head_eye();
        for (time_ns, x) in [(10, 1.0), (30, 3.0), (20, 5.0), (20, 2.0), (40, 4.0), (50, 5.0)] {
            anchor(&mut scene, head, time_ns, x);
        }
        let Motion::Timed(samples, _) = &scene.spaces[head.0].motion else { panic!() };
        assert_eq!(samples.iter().map(|it| it.0).collect::<Vec<_>>(), [20, 30, 40, 50]);
        assert_eq!(scene.a_from_b(room, head, 25).unwrap().transform.translation.x, 2.5);
    }

    #[test]
    fn times_at_the_ends_of_the_clock_do_not_overflow() {
        let (mut scene, [room, head, _]) = room_head_eye();
        anchor(&mut scene, head, i64::MIN, 0.0);
        anchor(&mut scene, head, i64::MAX, 1.0);
        let middle = scene.a_from_b(room, head, 0).unwrap();
        assert!((middle.transform.translation.x - 0.5).abs() < 1e-9);
    }

    #[test]
    fn a_lost_anchor_is_suspended_and_resumes_with_the_next_pose() {
        let (mut scene, [room, head, eye]) = room_head_eye();
        anchor(&mut scene, head, 0, 1.0);
        anchor(&mut scene, head, 100, 2.0);
        scene.suspend(head).unwrap();
        assert!(scene.is_suspended(eye).unwrap() && !scene.is_suspended(room).unwrap());
        let suspended = SceneError::Suspended { space: "head".into(), last_ns: 100, time_ns: 101 };
        assert_eq!(scene.a_from_b(room, eye, 101), Err(suspended));
        assert!(scene.a_from_b(room, eye, 50).is_ok());
        anchor(&mut scene, head, 60, 1.6); // late: not a sign of life
        assert!(scene.is_suspended(eye).unwrap());
        anchor(&mut scene, head, 200, 3.0);
        assert!(!scene.is_suspended(eye).unwrap());
        assert!((scene.a_from_b(room, head, 150).unwrap().transform.translation.x - 2.5).abs() < 1e-12);
    }

    #[test]
    fn misuse_is_refused_by_name() {
        let (mut scene, [room, head, _]) = room_head_eye();
        assert_eq!(scene.add("eye", room), Err(SceneError::NameTaken { name: "eye".into() }));
        assert_eq!(scene.push(room, 0, pose([0.0; 3], [0.0; 3])), Err(SceneError::Root { name: "room".into() }));
        assert_eq!(scene.suspend(room), Err(SceneError::Root { name: "room".into() }));
        let broken = pose([f64::NAN, 0.0, 0.0], [0.0; 3]);
        assert_eq!(scene.push(head, 0, broken), Err(SceneError::NotFinite { space: "head".into() }));
        let foreign = SceneError::Foreign { index: 9, count: 3 };
        assert_eq!(scene.a_from_b(SpaceId(9), head, 0), Err(foreign.clone()));
        assert_eq!(scene.add("x", SpaceId(9)), Err(foreign));
        assert_eq!((scene.find("eye"), scene.name(head)), (Some(SpaceId(2)), Ok("head")));
    }

    /// exp(δ) up to the second order, which is enough for the small δ of the test.
    fn moved(pose: &Isometry3<f64>, delta: &Vector6<f64>) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(delta.fixed_rows::<3>(0).into_owned());
        pose * Isometry3::from_parts(delta.fixed_rows::<3>(3).into_owned().into(), turn)
    }

    /// The δ that takes `from` to `to`, to first order.
    fn difference(from: &Isometry3<f64>, to: &Isometry3<f64>) -> Vector6<f64> {
        let step = from.inverse() * to;
        let (turn, shift) = (step.rotation.scaled_axis(), step.translation.vector);
        Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
    }

    proptest! {
        /// Moves each input along each direction by a little and compares with what the adjoint says: this checks the
        /// covariances of composition, inversion and transformed points without chance.
        #[test]
        fn covariances_follow_small_displacements(
            numbers in prop::array::uniform12(-2.0..2.0), turn in prop::array::uniform3(-1.0..1.0),
        ) {
            let [a, b, c, d, e, f, g, h, i, x, y, z] = numbers;
            let c_from_b = pose([a, b, c], [d, e, f]);
            let b_from_a = pose([g, h, i], turn);
            let point = Point3::new(x, y, z);
            const SMALL: f64 = 1e-6;
            // Along each axis, and along two mixtures of rotation and translation.
            let axes = (0..6).map(|axis| Vector6::ith(axis, SMALL));
            let mixtures = [Vector6::repeat(SMALL), Vector6::new(1.0, -2.0, 1.0, 2.0, 1.0, -1.0) * SMALL];
            for delta in axes.chain(mixtures) {
                // A covariance of rank one along δ, whose image must be the outer product of δ's image.
                let uncertain = |pose: &UncertainPose| UncertainPose {
                    transform: pose.transform,
                    covariance: delta * delta.transpose() / (SMALL * SMALL),
                };
                let expect = |image: Vector6<f64>, found: Matrix6<f64>| {
                    (image * image.transpose() / (SMALL * SMALL) - found).norm() < 1e-4 * (1.0 + found.norm())
                };
                let straight = c_from_b.transform * b_from_a.transform;
                let first = moved(&c_from_b.transform, &delta) * b_from_a.transform;
                prop_assert!(expect(difference(&straight, &first), uncertain(&c_from_b).then_from(&b_from_a).covariance));
                let second = c_from_b.transform * moved(&b_from_a.transform, &delta);
                prop_assert!(expect(difference(&straight, &second), c_from_b.then_from(&uncertain(&b_from_a)).covariance));
                let inverse = moved(&c_from_b.transform, &delta).inverse();
                prop_assert!(
                    expect(difference(&c_from_b.transform.inverse(), &inverse), uncertain(&c_from_b).inverse().covariance)
                );
                let (there, spread) = uncertain(&c_from_b).transform_point(&point, &Matrix3::zeros());
                let shift = (moved(&c_from_b.transform, &delta) * point - there) / SMALL;
                prop_assert!((shift * shift.transpose() - spread).norm() < 1e-4 * (1.0 + spread.norm()));
            }
        }
    }
}
