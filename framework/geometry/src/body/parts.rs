//! The ten parts, their tree, and the joints that are reported.

use nalgebra::Vector3;

/// Number of parts of a body.
pub const N_PARTS: usize = 10;
/// Number of reported joints.
pub const N_JOINTS: usize = 14;

/// Position of the shoulders between the middle of the torso and the neck, d_s of Figure 5 [–]. Shoulders at 0.818,
/// chin at 0.870 and hips at 0.530 of the stature
/// (D. A. Winter, *Biomechanics and Motor Control of Human Movement*, 2009, figure 4.1): (0.818 − 0.700)/0.170.
pub const SHOULDER_UP: f64 = 0.694;
/// Distance of the hips from the middle relative to that of the shoulders, d_H of Figure 5 [–]: hip joints are 0.104
/// of the stature apart, shoulder joints 0.21 (as above: 0.191 and
/// 0.259 over the skin; the joints lie inside).
pub const HIP_OUT: f64 = 0.5;
/// Position of the wrist on the lower arm with its hand, from the elbow [–]: 0.146 of 0.146 + 0.074 (as above; a half closed hand).
pub const WRIST_DOWN: f64 = 0.664;
/// Position of the ankle on the calf with the height of the foot, from the knee [–]: 0.246 of 0.285 (as above).
pub const ANKLE_DOWN: f64 = 0.863;

/// One of ten parts. Its axes: z of the torso to the neck, y to the left, x to the front; z of the head away from the neck; z of a limb towards the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Part {
    /// Torso with the neck, an elliptic cylinder; 0 in the paper.
    Torso,
    /// Head, an ellipsoid; 1 in the paper.
    Head,
    /// Left upper arm, a cylinder as all limbs; 2a in the paper.
    LeftUpperArm,
    /// Right upper arm, 2b in the paper.
    RightUpperArm,
    /// Left thigh, 3a in the paper.
    LeftThigh,
    /// Right thigh, 3b in the paper.
    RightThigh,
    /// Left lower arm with the hand, 4a in the paper.
    LeftLowerArm,
    /// Right lower arm with the hand, 4b in the paper.
    RightLowerArm,
    /// Left calf down to the sole, 5a in the paper.
    LeftCalf,
    /// Right calf down to the sole, 5b in the paper.
    RightCalf,
}

impl Part {
    /// All parts, parents before children.
    pub const ALL: [Part; N_PARTS] = [
        Part::Torso,
        Part::Head,
        Part::LeftUpperArm,
        Part::RightUpperArm,
        Part::LeftThigh,
        Part::RightThigh,
        Part::LeftLowerArm,
        Part::RightLowerArm,
        Part::LeftCalf,
        Part::RightCalf,
    ];

    /// Index in [`Part::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Part::Torso => "torso",
            Part::Head => "head",
            Part::LeftUpperArm => "left-upper-arm",
            Part::RightUpperArm => "right-upper-arm",
            Part::LeftThigh => "left-thigh",
            Part::RightThigh => "right-thigh",
            Part::LeftLowerArm => "left-lower-arm",
            Part::RightLowerArm => "right-lower-arm",
            Part::LeftCalf => "left-calf",
            Part::RightCalf => "right-calf",
        }
    }

    /// The parent part; `None` for the torso.
    pub const fn parent(self) -> Option<Part> {
        match self {
            Part::Torso => None,
            Part::Head | Part::LeftUpperArm | Part::RightUpperArm | Part::LeftThigh | Part::RightThigh => {
                Some(Part::Torso)
            }
            Part::LeftLowerArm => Some(Part::LeftUpperArm),
            Part::RightLowerArm => Some(Part::RightUpperArm),
            Part::LeftCalf => Some(Part::LeftThigh),
            Part::RightCalf => Some(Part::RightThigh),
        }
    }

    /// The same part on the other side; torso and head map to themselves.
    pub const fn mirrored(self) -> Part {
        match self {
            Part::Torso => Part::Torso,
            Part::Head => Part::Head,
            Part::LeftUpperArm => Part::RightUpperArm,
            Part::RightUpperArm => Part::LeftUpperArm,
            Part::LeftThigh => Part::RightThigh,
            Part::RightThigh => Part::LeftThigh,
            Part::LeftLowerArm => Part::RightLowerArm,
            Part::RightLowerArm => Part::LeftLowerArm,
            Part::LeftCalf => Part::RightCalf,
            Part::RightCalf => Part::LeftCalf,
        }
    }

    /// Whether it belongs to an arm or a leg.
    pub const fn is_limb(self) -> bool {
        !matches!(self, Part::Torso | Part::Head)
    }

    /// Position of its joint on the parent: J of Figure 5 is this, component by component times the parent's sizes. Zero for the torso.
    pub fn hangs_at(self) -> Vector3<f64> {
        match self {
            Part::Torso => Vector3::zeros(),
            Part::Head => Vector3::z(),
            Part::LeftUpperArm => Vector3::new(0.0, 1.0, SHOULDER_UP),
            Part::RightUpperArm => Vector3::new(0.0, -1.0, SHOULDER_UP),
            Part::LeftThigh => Vector3::new(0.0, HIP_OUT, -1.0),
            Part::RightThigh => Vector3::new(0.0, -HIP_OUT, -1.0),
            Part::LeftLowerArm | Part::RightLowerArm | Part::LeftCalf | Part::RightCalf => -Vector3::z(),
        }
    }

    /// Position of the same joint on the part itself, likewise.
    pub fn held_at(self) -> Vector3<f64> {
        match self {
            Part::Torso => Vector3::zeros(),
            Part::Head => -Vector3::z(),
            _ => Vector3::z(),
        }
    }
}

/// A limb of two parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Limb {
    /// Left arm.
    LeftArm,
    /// Right arm.
    RightArm,
    /// Left leg.
    LeftLeg,
    /// Right leg.
    RightLeg,
}

impl Limb {
    /// All limbs.
    pub const ALL: [Limb; 4] = [Limb::LeftArm, Limb::RightArm, Limb::LeftLeg, Limb::RightLeg];

    /// Index in [`Limb::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Limb::LeftArm => "left arm",
            Limb::RightArm => "right arm",
            Limb::LeftLeg => "left leg",
            Limb::RightLeg => "right leg",
        }
    }

    /// Its upper and its lower part.
    pub const fn parts(self) -> [Part; 2] {
        match self {
            Limb::LeftArm => [Part::LeftUpperArm, Part::LeftLowerArm],
            Limb::RightArm => [Part::RightUpperArm, Part::RightLowerArm],
            Limb::LeftLeg => [Part::LeftThigh, Part::LeftCalf],
            Limb::RightLeg => [Part::RightThigh, Part::RightCalf],
        }
    }

    /// The same limb on the other side.
    pub const fn mirrored(self) -> Limb {
        match self {
            Limb::LeftArm => Limb::RightArm,
            Limb::RightArm => Limb::LeftArm,
            Limb::LeftLeg => Limb::RightLeg,
            Limb::RightLeg => Limb::LeftLeg,
        }
    }

    /// Whether it is a leg.
    pub const fn is_leg(self) -> bool {
        matches!(self, Limb::LeftLeg | Limb::RightLeg)
    }
}

/// A reported joint of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Joint {
    /// Centre of the head.
    Head,
    /// Between head and torso, below the head.
    Neck,
    /// Left shoulder.
    LeftShoulder,
    /// Right shoulder.
    RightShoulder,
    /// Left elbow.
    LeftElbow,
    /// Right elbow.
    RightElbow,
    /// Left wrist.
    LeftWrist,
    /// Right wrist.
    RightWrist,
    /// Left hip.
    LeftHip,
    /// Right hip.
    RightHip,
    /// Left knee.
    LeftKnee,
    /// Right knee.
    RightKnee,
    /// Left ankle.
    LeftAnkle,
    /// Right ankle.
    RightAnkle,
}

impl Joint {
    /// All joints.
    pub const ALL: [Joint; N_JOINTS] = [
        Joint::Head,
        Joint::Neck,
        Joint::LeftShoulder,
        Joint::RightShoulder,
        Joint::LeftElbow,
        Joint::RightElbow,
        Joint::LeftWrist,
        Joint::RightWrist,
        Joint::LeftHip,
        Joint::RightHip,
        Joint::LeftKnee,
        Joint::RightKnee,
        Joint::LeftAnkle,
        Joint::RightAnkle,
    ];

    /// Name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Joint::Head => "head",
            Joint::Neck => "neck",
            Joint::LeftShoulder => "left-shoulder",
            Joint::RightShoulder => "right-shoulder",
            Joint::LeftElbow => "left-elbow",
            Joint::RightElbow => "right-elbow",
            Joint::LeftWrist => "left-wrist",
            Joint::RightWrist => "right-wrist",
            Joint::LeftHip => "left-hip",
            Joint::RightHip => "right-hip",
            Joint::LeftKnee => "left-knee",
            Joint::RightKnee => "right-knee",
            Joint::LeftAnkle => "left-ankle",
            Joint::RightAnkle => "right-ankle",
        }
    }

    /// The part that carries the joint, and the joint's position there, component by component times that part's
    /// sizes; for the neck its position on the chain, see [`super::Body::place_of`]. Where two parts meet, it is the
    /// one nearer to the torso.
    pub fn place(self) -> (Part, Vector3<f64>) {
        let on = |part: Part| (Part::parent(part).unwrap_or(part), part.hangs_at());
        let down = |part: Part, share: f64| (part, Vector3::new(0.0, 0.0, 1.0 - 2.0 * share));
        match self {
            Joint::Head => (Part::Head, Vector3::zeros()),
            Joint::Neck => on(Part::Head),
            Joint::LeftShoulder => on(Part::LeftUpperArm),
            Joint::RightShoulder => on(Part::RightUpperArm),
            Joint::LeftElbow => on(Part::LeftLowerArm),
            Joint::RightElbow => on(Part::RightLowerArm),
            Joint::LeftWrist => down(Part::LeftLowerArm, WRIST_DOWN),
            Joint::RightWrist => down(Part::RightLowerArm, WRIST_DOWN),
            Joint::LeftHip => on(Part::LeftThigh),
            Joint::RightHip => on(Part::RightThigh),
            Joint::LeftKnee => on(Part::LeftCalf),
            Joint::RightKnee => on(Part::RightCalf),
            Joint::LeftAnkle => down(Part::LeftCalf, ANKLE_DOWN),
            Joint::RightAnkle => down(Part::RightCalf, ANKLE_DOWN),
        }
    }

    /// The limb that must be in the model for the joint to be reported; `None`: head and trunk suffice.
    pub const fn limb(self) -> Option<Limb> {
        match self {
            Joint::LeftElbow | Joint::LeftWrist => Some(Limb::LeftArm),
            Joint::RightElbow | Joint::RightWrist => Some(Limb::RightArm),
            Joint::LeftKnee | Joint::LeftAnkle => Some(Limb::LeftLeg),
            Joint::RightKnee | Joint::RightAnkle => Some(Limb::RightLeg),
            _ => None,
        }
    }
}
