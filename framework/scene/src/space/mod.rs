//! The tree of spaces over time.
//!
//! Each space hangs below a parent by `parent_from_space`, which is fixed or a bounded history of timed poses. Between two
//! samples the translation is interpolated linearly and the rotation along the shortest arc; beyond the ends the nearest sample
//! holds for a limited time, and a newest one with a velocity is extrapolated by it. The poses are [`UncertainPose`]s; between samples their
//! covariances are interpolated too, which errs on the safe side whether or not the samples' errors are correlated.
//!
//! A space whose target is lost is *suspended*: it answers for the past, keeps what it holds, and resumes with the next pose.

#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use nalgebra::{Isometry3, Matrix6, Vector3};

use crate::uncertain_pose::UncertainPose;

/// A space of one [`SceneGraph`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SpaceId(usize);

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
    /// The target of the space is lost, and the requested time is after its last pose.
    #[error("space {space:?} is suspended: its last pose is of {last_ns} ns, requested {time_ns} ns")]
    Suspended {
        /// Its name.
        space: String,
        /// Of the last pose [ns].
        last_ns: i64,
        /// Requested time [ns].
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
        /// Requested time [ns].
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

    /// As [`Self::push`] for a space whose origin moves with `velocity` in its parent [m/s]: as long as this pose is the newest one, later
    /// times have it extrapolated, less and less certainly. `covariance` is that of (origin, velocity) in the parent [m², m²/s, m²/s²]. An
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
