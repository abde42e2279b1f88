//! Segments joined by joints of one angle each, and where they stand.
//!
//! A segment's space has its origin in the joint that joins it to its parent, and its bone along +z. An articulation of several angles is several degrees of freedom of one
//! segment, applied one after the other (§3.2). The paper turns each about the local z axis after a permutation of the axes; a turn about the permuted axis is the same matrix.
//!
//! | here | paper | meaning | unit |
//! |---|---|---|---|
//! | `parent_from_rest`, `joint_in_parent` | D_ini = [R, s T] (3) | static part; the translation is scaled with the parent's length | –, m |
//! | turn about `Dof::axis` | D_rotz (3) | part of the motion | rad |
//! | [`Skeleton::pose`] | Π D(S) (2) | the chain from the root | – |

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::Pose;

/// One angle of a joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Dof {
    /// Name in results: `elbow_flexion`.
    pub name: String,
    /// What it turns about, in the segment's own space before this turn.
    pub axis: Unit<Vector3<f64>>,
    /// Least angle of a healthy adult [rad].
    pub lowest: f64,
    /// Largest angle of a healthy adult [rad].
    pub highest: f64,
}

/// One rigid part between two joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// Name in results: `forearm_left`.
    pub name: String,
    /// The segment that it hangs on, by number, which is lower than its own; `None`: the root.
    pub parent: Option<usize>,
    /// Its joint in the parent's space, where the parent has the template's length [m].
    pub joint_in_parent: Vector3<f64>,
    /// The turn of its space in the parent's where all angles are 0.
    pub parent_from_rest: UnitQuaternion<f64>,
    /// Its angles, applied in this order, outermost first.
    pub dofs: Vec<Dof>,
    /// Distance from its joint to its end, of the template [m].
    pub length: f64,
    /// Which of [`State::scales`] stretches it: segments of left and right may share one.
    pub scale: usize,
    /// The body goes on before its joint, and the model does not: what lies there is no surface of it.
    pub cut: bool,
}

/// Segments that hang together.
#[derive(Debug, Clone, PartialEq)]
pub struct Skeleton {
    segments: Vec<Segment>,
    /// By segment: the number of its first angle in [`State::angles`].
    first_angle: Vec<usize>,
    n_angles: usize,
    n_scales: usize,
}

/// What is wrong with a skeleton.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SkeletonError {
    /// No segment at all.
    #[error("a skeleton without segments, expected a root at least")]
    Empty,
    /// The first one has a parent, or another one has none before it.
    #[error("segment {name} hangs on {found:?}, expected {expected}")]
    Parent {
        /// Of the segment.
        name: String,
        /// Its parent.
        found: Option<usize>,
        /// What may stand there.
        expected: String,
    },
    /// Two segments or angles of one name.
    #[error("two segments or angles have the name {name}, expected one")]
    Name {
        /// Of both.
        name: String,
    },
    /// A number that cannot be.
    #[error("{what} of {name} is {found}, expected {expected}")]
    Number {
        /// Which number.
        what: &'static str,
        /// Of the segment or angle.
        name: String,
        /// Its value.
        found: f64,
        /// What may stand there.
        expected: &'static str,
    },
}

/// How a body stands, and its size.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Where the root's space is.
    pub world_from_root: Pose,
    /// By degree of freedom, segment by segment [rad].
    pub angles: Vec<f64>,
    /// Lengths of segments over those of the template, above 0 [–].
    pub scales: Vec<f64>,
    /// Effective radii of the balls, along their own axes, above 0 [m].
    pub radii: Vec<Vector3<f64>>,
}

/// A skeleton in a posture.
#[derive(Debug, Clone, PartialEq)]
pub struct Posed {
    /// Where the root's space is.
    pub world_from_root: Pose,
    /// By segment.
    pub world_from_segment: Vec<Pose>,
    /// By degree of freedom: the axis that its angle turns about, and a point on it [m].
    pub axes: Vec<(Vector3<f64>, Point3<f64>)>,
    /// By segment but the root: what its joint is off the parent's, in the world, with lengths as they are [m].
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

    /// The number of a segment.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.segments.iter().position(|it| it.name == name)
    }

    /// All degrees of freedom, in the order of [`State::angles`].
    pub fn dofs(&self) -> impl Iterator<Item = &Dof> {
        self.segments.iter().flat_map(|it| &it.dofs)
    }

    /// Which of [`State::angles`] are those of a segment.
    pub fn angles_of(&self, segment: usize) -> std::ops::Range<usize> {
        let first = self.first_angle[segment];
        first..first + self.segments[segment].dofs.len()
    }

    /// How many angles there are.
    pub fn n_angles(&self) -> usize {
        self.n_angles
    }

    /// How many lengths there are.
    pub fn n_scales(&self) -> usize {
        self.n_scales
    }

    /// A segment and all that it hangs on, up to the root.
    pub fn chain(&self, segment: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(segment), |it| self.segments[*it].parent)
    }

    /// Where each segment stands (2).
    ///
    /// # Panics
    /// When `state` is one of another skeleton.
    pub fn pose(&self, state: &State) -> Posed {
        assert!(
            state.angles.len() == self.n_angles && state.scales.len() == self.n_scales,
            "the state of another skeleton"
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

    /// Where the joint of a segment is [m].
    pub fn joint(&self, posed: &Posed, segment: usize) -> Point3<f64> {
        Point3::from(posed.world_from_segment[segment].translation.vector)
    }

    /// Where the bone of a segment ends [m].
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

/// The numbers of the parameters in a step: turn and shift of the root, angles, logarithms of scales, logarithms of radii ball by ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Columns {
    n_angles: usize,
    n_scales: usize,
    n_balls: usize,
}

impl Columns {
    /// Of a state.
    pub fn of(state: &State) -> Columns {
        Columns { n_angles: state.angles.len(), n_scales: state.scales.len(), n_balls: state.radii.len() }
    }

    /// Of an angle.
    pub fn angle(&self, angle: usize) -> usize {
        6 + angle
    }

    /// Of the logarithm of a scale.
    pub fn scale(&self, scale: usize) -> usize {
        6 + self.n_angles + scale
    }

    /// Of the logarithm of a radius.
    pub fn radius(&self, ball: usize, axis: usize) -> usize {
        6 + self.n_angles + self.n_scales + 3 * ball + axis
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.radius(self.n_balls, 0)
    }

    /// Never: the root moves.
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
