//! The skeleton of a person and of an arm, with three balls a limb (§3.3).
//!
//! Lengths are parts of the standing height: R. Drillis and R. Contini, "Body segment parameters", New York University, 1966, as given by D. A. Winter, *Biomechanics and Motor Control of Human
//! Movement*. Ranges of joints: American Academy of Orthopaedic Surgeons, *Joint Motion*, 1965, rounded up to 5°. Thicknesses are rough: they are a start for the fit.
//!
//! The root's space: x forward, y to the person's left, z up. Arms and legs hang down in the rest posture; their segments' spaces have x forward, y to the right, z down the limb.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};

use super::field::{Ball, Body, VISIBLE};
use super::fit::{Priors, RadiiPrior, RootPrior};
use super::skeleton::{Dof, Posed, Segment, Skeleton, State};

/// Parts of the standing height. An arm by itself begins at the acromion, where Drillis and Contini measure from,
const WHOLE_UPPER_ARM: f64 = 0.186;
/// one of a person in the centre of the shoulder's joint, which lies below: the mean of that and of the 0.162 of P. de Leva, "Adjustments to Zatsiorsky–Seluyanov's segment inertia parameters",
/// J. Biomechanics 29(9), 1996, which is between joint centres.
const UPPER_ARM: f64 = 0.174;
const FOREARM: f64 = 0.146;
const HAND: f64 = 0.108;
const THIGH: f64 = 0.245;
const SHANK: f64 = 0.246;
const FOOT: f64 = 0.152;
const HALF_SHOULDERS: f64 = 0.104;
const HALF_HIPS: f64 = 0.05;
const HIP_HEIGHT: f64 = 0.530;
const SHOULDER_HEIGHT: f64 = 0.800;
const CHIN_HEIGHT: f64 = 0.870;

/// Half the length of a ball along a bone, over its share of the bone: so that three of a kind make a limb whose thickness changes by less than a hundredth along it. Balls that overlap more can
/// stand in for each other, and a fit makes some large and some vanish.
const REACH: f64 = 0.64;

/// A side of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The person's left.
    Left,
    /// The person's right.
    Right,
}

impl Side {
    fn name(self) -> &'static str {
        match self {
            Side::Left => "left",
            Side::Right => "right",
        }
    }

    /// +1 to the left.
    fn sign(self) -> f64 {
        match self {
            Side::Left => 1.0,
            Side::Right => -1.0,
        }
    }
}

/// Segments on the way to a skeleton, with the balls on them.
#[derive(Default)]
struct Build {
    segments: Vec<Segment>,
    balls: Vec<Ball>,
    radii: Vec<Vector3<f64>>,
}

fn dof(name: String, axis: Vector3<f64>, lowest_deg: f64, highest_deg: f64) -> Dof {
    Dof { name, axis: Unit::new_normalize(axis), lowest: lowest_deg.to_radians(), highest: highest_deg.to_radians() }
}

impl Build {
    fn find(&self, name: &str) -> Option<usize> {
        self.segments.iter().position(|it| it.name == name)
    }

    fn segment(
        &mut self,
        name: &str,
        joint: Option<(&str, Vector3<f64>)>,
        rest: UnitQuaternion<f64>,
        length: f64,
        scale: usize,
        dofs: Vec<Dof>,
    ) {
        let parent = joint.and_then(|(name, _)| self.find(name));
        let joint_in_parent = joint.map_or_else(Vector3::zeros, |it| it.1);
        let name = name.to_owned();
        self.segments.push(Segment {
            name,
            parent,
            joint_in_parent,
            parent_from_rest: rest,
            dofs,
            length,
            scale,
            cut: false,
        });
    }

    /// Three balls along the bone of the last segment, of visible half axes `across` (x, y) at its start, middle and end [m].
    fn limb(&mut self, across: [[f64; 2]; 3]) {
        let segment = self.segments.len() - 1;
        let length = self.segments[segment].length;
        for (number, [x, y]) in across.into_iter().enumerate() {
            let part = (number as f64 + 0.5) / 3.0;
            self.ball(segment, Vector3::new(0.0, 0.0, part * length), Vector3::new(x, y, REACH * length / 3.0));
        }
    }

    /// A ball of visible half axes [m].
    fn ball(&mut self, segment: usize, centre: Vector3<f64>, visible: Vector3<f64>) {
        self.balls.push(Ball { segment, centre, segment_from_ball: UnitQuaternion::identity() });
        self.radii.push(visible / VISIBLE);
    }

    fn arm(&mut self, side: Side, parent: Option<(&str, Vector3<f64>)>, height: f64, scales: [usize; 3]) {
        let (it, sign) = (side.name(), side.sign());
        let rest = if parent.is_some() { down() } else { UnitQuaternion::identity() };
        let upper_arm = height * if parent.is_some() { UPPER_ARM } else { WHOLE_UPPER_ARM };
        let name = |what: &str| format!("{what}_{it}");
        // An arm by itself turns with its root, in every direction alike: three angles one after the other have a posture in which one of them is lost.
        let shoulder = vec![
            dof(name("shoulder_flexion"), Vector3::y(), -60.0, 180.0),
            dof(name("shoulder_abduction"), Vector3::x() * sign, -75.0, 180.0),
            dof(name("shoulder_rotation"), Vector3::z() * sign, -90.0, 90.0),
        ];
        self.segment(
            &name("upper_arm"),
            parent,
            rest,
            upper_arm,
            scales[0],
            if parent.is_some() { shoulder } else { Vec::new() },
        );
        let upper = self.segments.len() - 1;
        self.segments[upper].cut = parent.is_none();
        let h = height;
        self.limb([[0.032 * h, 0.032 * h], [0.028 * h, 0.028 * h], [0.025 * h, 0.025 * h]]);
        let elbow = Vector3::new(0.0, 0.0, upper_arm);
        self.segment(
            &name("forearm"),
            Some((&name("upper_arm"), elbow)),
            UnitQuaternion::identity(),
            FOREARM * height,
            scales[1],
            vec![
                dof(name("elbow_flexion"), Vector3::y(), 0.0, 150.0),
                dof(name("forearm_rotation"), Vector3::z() * sign, -90.0, 90.0),
            ],
        );
        self.limb([[0.026 * h, 0.026 * h], [0.023 * h, 0.023 * h], [0.017 * h, 0.020 * h]]);
        let wrist = Vector3::new(0.0, 0.0, FOREARM * height);
        self.segment(
            &name("hand"),
            Some((&name("forearm"), wrist)),
            UnitQuaternion::identity(),
            HAND * height,
            scales[2],
            vec![
                dof(name("wrist_flexion"), Vector3::y(), -80.0, 80.0),
                dof(name("wrist_abduction"), Vector3::x() * sign, -30.0, 30.0),
            ],
        );
        let hand = self.segments.len() - 1;
        self.ball(hand, Vector3::new(0.0, 0.0, 0.4 * HAND * height), Vector3::new(0.012 * h, 0.022 * h, 0.05 * h));
    }

    fn leg(&mut self, side: Side, height: f64, scales: [usize; 3]) {
        let (it, sign) = (side.name(), side.sign());
        let name = |what: &str| format!("{what}_{it}");
        let hip = Vector3::new(0.0, sign * HALF_HIPS * height, 0.0);
        let h = height;
        self.segment(
            &name("thigh"),
            Some(("pelvis", hip)),
            down(),
            THIGH * height,
            scales[0],
            vec![
                dof(name("hip_flexion"), Vector3::y(), -30.0, 125.0),
                dof(name("hip_abduction"), Vector3::x() * sign, -30.0, 50.0),
                dof(name("hip_rotation"), Vector3::z() * sign, -45.0, 45.0),
            ],
        );
        self.limb([[0.052 * h, 0.048 * h], [0.046 * h, 0.043 * h], [0.036 * h, 0.034 * h]]);
        let knee = Vector3::new(0.0, 0.0, THIGH * height);
        self.segment(
            &name("shank"),
            Some((&name("thigh"), knee)),
            UnitQuaternion::identity(),
            SHANK * height,
            scales[1],
            vec![dof(name("knee_flexion"), -Vector3::y(), 0.0, 140.0)],
        );
        self.limb([[0.034 * h, 0.032 * h], [0.032 * h, 0.030 * h], [0.022 * h, 0.022 * h]]);
        let ankle = Vector3::new(0.0, 0.0, SHANK * height);
        // The foot points forward: its z is the shank's x.
        let forward = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2);
        self.segment(
            &name("foot"),
            Some((&name("shank"), ankle)),
            forward,
            FOOT * height,
            scales[2],
            vec![
                dof(name("ankle_flexion"), Vector3::y(), -50.0, 25.0),
                dof(name("ankle_inversion"), Vector3::z() * sign, -20.0, 35.0),
            ],
        );
        let foot = self.segments.len() - 1;
        self.ball(foot, Vector3::new(-0.015 * h, 0.0, 0.35 * FOOT * h), Vector3::new(0.022 * h, 0.026 * h, 0.07 * h));
    }

    fn finish(self, world_from_root: crate::Pose) -> (Body, State) {
        let skeleton =
            Skeleton::new(self.segments).unwrap_or_else(|error| unreachable!("the built-in skeleton: {error}"));
        let (angles, scales) = (vec![0.0; skeleton.n_angles()], vec![1.0; skeleton.n_scales()]);
        let state = State { world_from_root, angles, scales, radii: self.radii };
        let body = Body::new(skeleton, self.balls);
        let wanted: Vec<_> = (0..body.balls.len())
            .filter(|it| body.balls[*it].centre.xy().norm() == 0.0)
            .map(|it| (it, (state.radii[it] * VISIBLE).xy().into()))
            .collect();
        let state = body.as_thick(state, &wanted);
        (body, state)
    }
}

/// From hanging to upright: z down, x forward, y to the right.
fn down() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI)
}

/// A single arm of a person of `height` [m], hanging straight down from the world's origin. Its root is at the
/// shoulder and turns with the upper arm: x forward, y right, z down the arm.
pub fn arm(side: Side, height: f64) -> (Body, State) {
    let mut build = Build::default();
    build.arm(side, None, height, [0, 1, 2]);
    build.finish(Isometry3::rotation(Vector3::x() * PI))
}

/// A person of `height` [m], standing with arms and legs straight down, soles near z = 0, facing the world's x.
pub fn person(height: f64) -> (Body, State) {
    let mut build = Build::default();
    let h = height;
    let identity = UnitQuaternion::identity();
    // One scale each for pelvis, trunk, head, and for each kind of limb, left and right together.
    let [pelvis, trunk, head, arms, legs] = [0, 0, 1, 2, 5];
    let waist = 0.08 * h;
    build.segment("pelvis", None, identity, waist, pelvis, Vec::new());
    build.ball(0, Vector3::new(0.0, 0.045 * h, 0.01 * h), Vector3::new(0.065 * h, 0.06 * h, 0.075 * h));
    build.ball(0, Vector3::new(0.0, -0.045 * h, 0.01 * h), Vector3::new(0.065 * h, 0.06 * h, 0.075 * h));
    let spine = SHOULDER_HEIGHT * h - HIP_HEIGHT * h - waist;
    build.segment(
        "trunk",
        Some(("pelvis", Vector3::new(0.0, 0.0, waist))),
        identity,
        spine,
        trunk,
        vec![
            dof("trunk_flexion".to_owned(), Vector3::y(), -30.0, 80.0),
            dof("trunk_bending".to_owned(), Vector3::x(), -35.0, 35.0),
            dof("trunk_rotation".to_owned(), Vector3::z(), -45.0, 45.0),
        ],
    );
    build.ball(1, Vector3::new(0.0, 0.0, 0.05 * spine), Vector3::new(0.06 * h, 0.085 * h, 0.3 * spine));
    build.ball(1, Vector3::new(0.0, 0.045 * h, 0.6 * spine), Vector3::new(0.062 * h, 0.06 * h, 0.42 * spine));
    build.ball(1, Vector3::new(0.0, -0.045 * h, 0.6 * spine), Vector3::new(0.062 * h, 0.06 * h, 0.42 * spine));
    let neck = (CHIN_HEIGHT - SHOULDER_HEIGHT) * h;
    build.segment(
        "head",
        Some(("trunk", Vector3::new(0.0, 0.0, spine))),
        identity,
        h - SHOULDER_HEIGHT * h,
        head,
        vec![
            dof("neck_flexion".to_owned(), Vector3::y(), -60.0, 50.0),
            dof("neck_bending".to_owned(), Vector3::x(), -45.0, 45.0),
            dof("neck_rotation".to_owned(), Vector3::z(), -80.0, 80.0),
        ],
    );
    build.ball(2, Vector3::new(-0.005 * h, 0.0, 0.5 * neck), Vector3::new(0.032 * h, 0.032 * h, 0.05 * h));
    build.ball(2, Vector3::new(0.008 * h, 0.0, neck + 0.065 * h), Vector3::new(0.055 * h, 0.044 * h, 0.066 * h));
    for side in [Side::Left, Side::Right] {
        let shoulder = Vector3::new(0.0, side.sign() * HALF_SHOULDERS * h, spine);
        build.arm(side, Some(("trunk", shoulder)), h, [arms, arms + 1, arms + 2]);
    }
    for side in [Side::Left, Side::Right] {
        build.leg(side, h, [legs, legs + 1, legs + 2]);
    }
    build.finish(Isometry3::translation(0.0, 0.0, HIP_HEIGHT * h))
}

/// Anthropometric priors about a rough `start`: its posture to a radian and 0.1 m.
///
/// Lengths of limbs vary by some 6 % about parts of a height that is itself known roughly, girths by 10 to 15 % (C. Gordon et al., *2012 Anthropometric Survey of U.S. Army Personnel*, 2014:
/// coefficients of variation of acromion–radiale length 6 %, of forearm and biceps circumference 9 to 12 %), to which clothing adds.
pub fn anthropometric(start: &State) -> Priors {
    let root = RootPrior { world_from_root: start.world_from_root, turn_sigma: 1.0, shift_sigma: 0.1 };
    Priors {
        root: Some(root),
        angles: start.angles.iter().map(|it| (*it, 1.0)).collect(),
        scales: start.scales.iter().map(|it| (*it, 0.06)).collect(),
        stature: 0.0,
        radii: Some(RadiiPrior {
            means: start.radii.clone(),
            thickness: 0.12,
            girth: 0.0,
            evenness: 0.06,
            roundness: 0.04,
            reach: 0.06,
        }),
    }
}

impl Body {
    /// The same body with `n` balls along the bone of one segment in place of its own, each as thick as the surface is
    /// there: a finer shape once the rough one is known (the refinement planned in the paper's §5).
    ///
    /// # Panics
    /// When the segment does not exist or `n` is 0.
    pub fn refined(&self, state: &State, segment: usize, n: usize) -> (Body, State) {
        assert!(
            n > 0 && segment < self.skeleton.segments().len(),
            "expected a segment of the body and a ball at least"
        );
        let length = self.skeleton.segments()[segment].length;
        let scale = state.scales[self.skeleton.segments()[segment].scale];
        let (mut balls, mut radii) = (Vec::new(), Vec::new());
        for (number, ball) in self.balls.iter().enumerate().filter(|(_, it)| it.segment != segment) {
            balls.push(ball.clone());
            radii.push(state.radii[number]);
        }
        let mut wanted = Vec::new();
        for number in 0..n {
            let along = (number as f64 + 0.5) / n as f64 * length;
            let centre = Vector3::new(0.0, 0.0, along);
            let across: [f64; 2] =
                [Vector3::x(), Vector3::y()].map(|axis| self.thickness_at(state, segment, along * scale, axis));
            wanted.push((balls.len(), across));
            balls.push(Ball { segment, centre, segment_from_ball: UnitQuaternion::identity() });
            let reach = REACH * length * scale / n as f64;
            radii.push(Vector3::new(across[0], across[1], reach) / VISIBLE);
        }
        let body = Body::new(self.skeleton.clone(), balls);
        let refined = body.as_thick(State { radii, ..state.clone() }, &wanted);
        (body, refined)
    }

    /// The state with the radii of some balls such that the surface is half so thick at their centres, along x and y of their segments: balls that overlap swell.
    fn as_thick(&self, mut state: State, wanted: &[(usize, [f64; 2])]) -> State {
        for _ in 0..12 {
            let before = state.clone();
            for &(ball, across) in wanted {
                let Ball { segment, centre, .. } = self.balls[ball];
                let along = centre.z * state.scales[self.skeleton.segments()[segment].scale];
                for (axis, direction) in [Vector3::x(), Vector3::y()].into_iter().enumerate() {
                    let now = self.thickness_at(&before, segment, along, direction);
                    state.radii[ball][axis] *= (across[axis] / now.max(1e-6)).clamp(0.5, 2.0);
                }
            }
        }
        state
    }

    /// Half the thickness of a limb across its bone, `along` the bone and along `axis` of the segment's space [m],
    /// without the trunk's share where a limb joins it.
    pub fn thickness_at(&self, state: &State, segment: usize, along: f64, axis: Vector3<f64>) -> f64 {
        let posed = self.skeleton.pose(state);
        let is_on_bone =
            |of: usize| self.balls.iter().filter(|it| it.segment == of).all(|it| it.centre.xy().norm() == 0.0);
        let is_limb = |ball: &usize| self.balls[*ball].segment == segment || is_on_bone(self.balls[*ball].segment);
        let balls: Vec<usize> = self.near(segment).iter().copied().filter(is_limb).collect();
        let half =
            |axis: Vector3<f64>| self.leaves(&posed, state, segment, &balls, Vector3::new(0.0, 0.0, along), axis);
        0.5 * (half(axis) + half(-axis))
    }

    /// How far from `start` along `direction`, both in a segment's space, the surface of some balls is [m].
    pub(super) fn leaves(
        &self,
        posed: &Posed,
        state: &State,
        segment: usize,
        balls: &[usize],
        start: Vector3<f64>,
        direction: Vector3<f64>,
    ) -> f64 {
        let inside = |out: f64| {
            let point = posed.world_from_segment[segment] * Point3::from(start + direction * out);
            self.blend(posed, state, balls, &point).is_some_and(|it| it.d < VISIBLE * VISIBLE)
        };
        let widest = state.radii.iter().map(|it| it.max()).fold(0.0, f64::max);
        let (mut low, mut high) = (0.0, 2.0 * widest);
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if inside(middle) { low = middle } else { high = middle }
        }
        high
    }
}
