//! A skeleton of segments with single-angle joints, and its forward kinematics.
//!
//! A segment's space has its origin in the joint to its parent, and its bone along +z. A joint with several angles is
//! several degrees of freedom of one segment, applied one after the other (§3.2). The paper turns each about the local
//! z axis after a permutation of the axes; a turn about the permuted axis is the same matrix.
//!
//! | here | paper | meaning | unit |
//! |---|---|---|---|
//! | `parent_from_rest`, `joint_in_parent` | D_ini = [R, s T] (3) | static part; the translation is scaled with the parent's length | –, m |
//! | turn about `Dof::axis` | D_rotz (3) | part of the motion | rad |
//! | [`Skeleton::pose`] | Π D(S) (2) | the chain from the root | – |

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::Pose;

/// A degree of freedom: one angle of a joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Dof {
    /// Name in results: `elbow_flexion`.
    pub name: String,
    /// Axis of the rotation, in the segment's own space before it.
    pub axis: Unit<Vector3<f64>>,
    /// Lower limit for a healthy adult [rad].
    pub lowest: f64,
    /// Upper limit for a healthy adult [rad].
    pub highest: f64,
}

/// One rigid part between two joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// Name in results: `forearm_left`.
    pub name: String,
    /// Index of the parent segment, lower than its own; `None`: the root.
    pub parent: Option<usize>,
    /// Position of its joint in the parent's space, where the parent has the template's length [m].
    pub joint_in_parent: Vector3<f64>,
    /// Orientation of its space in the parent's where all angles are 0.
    pub parent_from_rest: UnitQuaternion<f64>,
    /// Its angles, applied in this order, outermost first.
    pub dofs: Vec<Dof>,
    /// Length from its joint to its end, of the template [m].
    pub length: f64,
    /// Index of its length in [`State::scales`]: segments of left and right may share one.
    pub scale: usize,
    /// Whether the real body goes on beyond its joint and the model does not: observations there are ignored.
    pub cut: bool,
}

/// A tree of segments.
#[derive(Debug, Clone, PartialEq)]
pub struct Skeleton {
    segments: Vec<Segment>,
    /// By segment: the number of its first angle in [`State::angles`].
    first_angle: Vec<usize>,
    n_angles: usize,
    n_scales: usize,
}

/// Why segments do not make a skeleton.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SkeletonError {
    /// No segment.
    #[error("a skeleton without segments, expected a root at least")]
    Empty,
    /// The first segment has a parent, or another one has none before it.
    #[error("segment {name} has the parent {found:?}, expected {expected}")]
    Parent {
        /// Name of the segment.
        name: String,
        /// Index of its parent.
        found: Option<usize>,
        /// What was expected.
        expected: String,
    },
    /// Two segments or angles with one name.
    #[error("two segments or angles have the name {name}, expected different names")]
    Name {
        /// The name.
        name: String,
    },
    /// A number out of range.
    #[error("{what} of {name} is {found}, expected {expected}")]
    Number {
        /// Which number.
        what: &'static str,
        /// Name of the segment or angle.
        name: String,
        /// Value that was found.
        found: f64,
        /// What was expected.
        expected: &'static str,
    },
}

/// Posture and shape of a body.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Pose of the root.
    pub world_from_root: Pose,
    /// Joint angles by degree of freedom, segment by segment [rad].
    pub angles: Vec<f64>,
    /// Lengths of segments relative to the template, above 0 [–].
    pub scales: Vec<f64>,
    /// Effective radii of the balls, along their own axes, above 0 [m].
    pub radii: Vec<Vector3<f64>>,
}

/// A skeleton in a posture: poses of all segments.
#[derive(Debug, Clone, PartialEq)]
pub struct Posed {
    /// Pose of the root.
    pub world_from_root: Pose,
    /// Pose of each segment.
    pub world_from_segment: Vec<Pose>,
    /// By degree of freedom: its axis and a point on it, in the world [m].
    pub axes: Vec<(Vector3<f64>, Point3<f64>)>,
    /// By segment except the root: vector from the parent's joint to its own, in the world, with the actual lengths [m].
    pub bones: Vec<Vector3<f64>>,
}

impl Skeleton {
    /// A skeleton of segments, parents before children.
    ///
    /// # Errors
    /// See [`SkeletonError`].
    pub fn new(segments: Vec<Segment>) -> Result<Skeleton, SkeletonError> {
        if segments.is_empty() {
            return Err(SkeletonError::Empty);
        }
        let (mut first_angle, mut n_angles) = (Vec::new(), 0);
        let mut names: Vec<&str> = Vec::new();
        for (number, segment) in segments.iter().enumerate() {
            let fits =
                if number == 0 { segment.parent.is_none() } else { segment.parent.is_some_and(|it| it < number) };
            if !fits {
                let expected =
                    if number == 0 { "nothing".to_owned() } else { format!("one of the {number} before it") };
                return Err(SkeletonError::Parent { name: segment.name.clone(), found: segment.parent, expected });
            }
            if !(segment.length.is_finite() && segment.length > 0.0) {
                let (name, found) = (segment.name.clone(), segment.length);
                return Err(SkeletonError::Number { what: "the length", name, found, expected: "a number above 0" });
            }
            for dof in &segment.dofs {
                if !(dof.lowest.is_finite() && dof.highest.is_finite() && dof.lowest < dof.highest) {
                    let (name, found) = (dof.name.clone(), dof.lowest);
                    return Err(SkeletonError::Number {
                        what: "the least angle",
                        name,
                        found,
                        expected: "less than the largest",
                    });
                }
            }
            for name in std::iter::once(&segment.name).chain(segment.dofs.iter().map(|it| &it.name)) {
                if names.contains(&name.as_str()) {
                    return Err(SkeletonError::Name { name: name.clone() });
                }
                names.push(name);
            }
            first_angle.push(n_angles);
            n_angles += segment.dofs.len();
        }
        let n_scales = segments.iter().map(|it| it.scale + 1).max().unwrap_or(0);
        Ok(Skeleton { segments, first_angle, n_angles, n_scales })
    }

    /// The segments, parents before children.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// Index of the segment of this name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.segments.iter().position(|it| it.name == name)
    }

    /// All degrees of freedom, in the order of [`State::angles`].
    pub fn dofs(&self) -> impl Iterator<Item = &Dof> {
        self.segments.iter().flat_map(|it| &it.dofs)
    }

    /// Indices in [`State::angles`] of a segment's angles.
    pub fn angles_of(&self, segment: usize) -> std::ops::Range<usize> {
        let first = self.first_angle[segment];
        first..first + self.segments[segment].dofs.len()
    }

    /// Number of angles.
    pub fn n_angles(&self) -> usize {
        self.n_angles
    }

    /// Number of scales.
    pub fn n_scales(&self) -> usize {
        self.n_scales
    }

    /// A segment and its ancestors, up to the root.
    pub fn chain(&self, segment: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(segment), |it| self.segments[*it].parent)
    }

    /// Forward kinematics: the pose of each segment (2).
    ///
    /// # Panics
    /// When `state` does not match the skeleton.
    pub fn pose(&self, state: &State) -> Posed {
        assert!(
            state.angles.len() == self.n_angles && state.scales.len() == self.n_scales,
            "the state does not match the skeleton"
        );
        let mut posed = Posed {
            world_from_root: state.world_from_root,
            world_from_segment: Vec::with_capacity(self.segments.len()),
            axes: Vec::with_capacity(self.n_angles),
            bones: Vec::with_capacity(self.segments.len()),
        };
        for (number, segment) in self.segments.iter().enumerate() {
            let (mut world_from_here, bone) = match segment.parent {
                None => (state.world_from_root * segment.parent_from_rest, Vector3::zeros()),
                Some(parent) => {
                    let world_from_parent = posed.world_from_segment[parent];
                    let joint = segment.joint_in_parent * state.scales[self.segments[parent].scale];
                    let parent_from_here = Isometry3::from_parts(Translation3::from(joint), segment.parent_from_rest); // D_ini (3)
                    (world_from_parent * parent_from_here, world_from_parent.rotation * joint)
                }
            };
            let origin = Point3::from(world_from_here.translation.vector);
            for (dof, angle) in segment.dofs.iter().zip(&state.angles[self.angles_of(number)]) {
                posed.axes.push((world_from_here.rotation * dof.axis.into_inner(), origin));
                world_from_here.rotation *= UnitQuaternion::from_axis_angle(&dof.axis, *angle); // D_rotz (3)
            }
            posed.world_from_segment.push(world_from_here);
            posed.bones.push(bone);
        }
        posed
    }

    /// Position of a segment's joint [m].
    pub fn joint(&self, posed: &Posed, segment: usize) -> Point3<f64> {
        Point3::from(posed.world_from_segment[segment].translation.vector)
    }

    /// Position of the end of a segment's bone [m].
    pub fn end(&self, posed: &Posed, state: &State, segment: usize) -> Point3<f64> {
        let Segment { length, scale, .. } = self.segments[segment];
        posed.world_from_segment[segment] * Point3::new(0.0, 0.0, length * state.scales[scale])
    }

    /// What each parameter does to the place, in the space of `segment`, of a point that rests in the world at `point`: calls `column` with the number of the parameter in a step ([`Columns`]) and the
    /// derivative [m per unit of the step].
    pub(super) fn derivatives(
        &self,
        posed: &Posed,
        columns: &Columns,
        segment: usize,
        point: &Point3<f64>,
        mut column: impl FnMut(usize, Vector3<f64>),
    ) {
        let here_from_world = posed.world_from_segment[segment].rotation.inverse();
        let turned = |axis: &Vector3<f64>, at: &Point3<f64>| -(here_from_world * axis.cross(&(point - at)));
        // T ⊕ δ = T exp(δ): δ is in the root's space.
        let Isometry3 { rotation, translation } = posed.world_from_root;
        for axis in 0..3 {
            let direction = rotation * Vector3::ith(axis, 1.0);
            column(axis, turned(&direction, &Point3::from(translation.vector)));
            column(3 + axis, -(here_from_world * direction));
        }
        let mut child = None;
        for number in self.chain(segment) {
            for angle in self.angles_of(number) {
                let (axis, at) = &posed.axes[angle];
                column(columns.angle(angle), turned(axis, at));
            }
            // A segment's length carries the joint of what hangs on it: by its logarithm it moves as far as the bone is long.
            if let Some(child) = child.replace(number) {
                column(columns.scale(self.segments[number].scale), -(here_from_world * posed.bones[child]));
            }
        }
    }
}

/// Order of the parameters in a step: rotation and shift of the root, angles, logarithms of scales, logarithms of radii ball by ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Columns {
    n_angles: usize,
    n_scales: usize,
    n_balls: usize,
}

impl Columns {
    /// The order for a state.
    pub fn of(state: &State) -> Columns {
        Columns { n_angles: state.angles.len(), n_scales: state.scales.len(), n_balls: state.radii.len() }
    }

    /// Index of an angle.
    pub fn angle(&self, angle: usize) -> usize {
        6 + angle
    }

    /// Index of the logarithm of a scale.
    pub fn scale(&self, scale: usize) -> usize {
        6 + self.n_angles + scale
    }

    /// Index of the logarithm of a radius.
    pub fn radius(&self, ball: usize, axis: usize) -> usize {
        6 + self.n_angles + self.n_scales + 3 * ball + axis
    }

    /// Number of parameters.
    pub fn len(&self) -> usize {
        self.radius(self.n_balls, 0)
    }

    /// Always `false`: the root has parameters.
    pub fn is_empty(&self) -> bool {
        false
    }
}

impl State {
    /// The state after a step, in the order of [`Columns`].
    pub fn moved(&self, step: &[f64]) -> State {
        let columns = Columns::of(self);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
        let shift = Translation3::new(step[3], step[4], step[5]);
        let angles = (0..self.angles.len()).map(|it| self.angles[it] + step[columns.angle(it)]).collect();
        let scales = (0..self.scales.len()).map(|it| self.scales[it] * step[columns.scale(it)].exp()).collect();
        let radius = |ball: usize, axis: usize| self.radii[ball][axis] * step[columns.radius(ball, axis)].exp();
        let radii = (0..self.radii.len()).map(|ball| Vector3::from_fn(|axis, _| radius(ball, axis))).collect();
        State { world_from_root: self.world_from_root * Isometry3::from_parts(shift, turn), angles, scales, radii }
    }
}
