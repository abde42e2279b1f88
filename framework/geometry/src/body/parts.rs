//! The ten parts, what hangs on what, and the joints that a body has.

use nalgebra::Vector3;

/// How many parts a body has.
pub const N_PARTS: usize = 10;
/// How many joints are told of a body.
pub const N_JOINTS: usize = 14;

/// Where the shoulders are between the middle of the torso and the neck, d_s of Figure 5 [–]. Shoulders at 0.818, chin at 0.870 and hips at 0.530 of the stature
/// (D. A. Winter, *Biomechanics and Motor Control of Human Movement*, 2009, figure 4.1): (0.818 − 0.700)/0.170.
pub const SHOULDER_UP: f64 = 0.694;
/// Of the hips from the middle, as a share of that of the shoulders, d_H of Figure 5 [–]: hip joints are 0.104 of the stature apart, shoulder joints 0.21 (as above: 0.191 and
/// 0.259 over the skin, of which the joints lie inside).
pub const HIP_OUT: f64 = 0.5;
/// The wrist on the lower arm with its hand, from the elbow [–]: 0.146 of 0.146 + 0.074 (as above; a hand that is half closed).
pub const WRIST_DOWN: f64 = 0.664;
/// The ankle on the calf with the height of the foot, from the knee [–]: 0.246 of 0.285 (as above).
pub const ANKLE_DOWN: f64 = 0.863;

/// One of ten parts. Its axes: z of the torso to the neck, y to the left, x to the front; z of the head away from the neck; z of a limb towards the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Part {
    /// 0 in the paper; an elliptic cylinder, and the neck.
    Torso,
    /// 1; an ellipsoid.
    Head,
    /// 2a; a cylinder, as all that follow.
    LeftUpperArm,
    /// 2b
    RightUpperArm,
    /// 3a
    LeftThigh,
    /// 3b
    RightThigh,
    /// 4a; with the hand.
    LeftLowerArm,
    /// 4b
    RightLowerArm,
    /// 5a; down to the sole.
    LeftCalf,
    /// 5b
    RightCalf,
}

impl Part {
    /// All, parents before children.
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

    /// Its place in [`Part::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// As it stands in files.
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

    /// What it hangs on.
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

    /// The same part of the other side; torso and head are their own.
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

    /// Where it hangs on its parent: J of Figure 5 is this, number by number times the parent's sizes. The torso hangs on nothing.
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

    /// Where its parent hangs on it, in the same way.
    pub fn held_at(self) -> Vector3<f64> {
        match self {
            Part::Torso => Vector3::zeros(),
            Part::Head => -Vector3::z(),
            _ => Vector3::z(),
        }
    }
}

/// One of four limbs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Limb {
    /// –
    LeftArm,
    /// –
    RightArm,
    /// –
    LeftLeg,
    /// –
    RightLeg,
}

impl Limb {
    /// All.
    pub const ALL: [Limb; 4] = [Limb::LeftArm, Limb::RightArm, Limb::LeftLeg, Limb::RightLeg];

    /// Its place in [`Limb::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// As it stands in files.
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

    /// The same of the other side.
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

/// A place of the body that is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Joint {
    /// The middle of the head.
    Head,
    /// Where head and torso meet: below the head.
    Neck,
    /// –
    LeftShoulder,
    /// –
    RightShoulder,
    /// –
    LeftElbow,
    /// –
    RightElbow,
    /// –
    LeftWrist,
    /// –
    RightWrist,
    /// –
    LeftHip,
    /// –
    RightHip,
    /// –
    LeftKnee,
    /// –
    RightKnee,
    /// –
    LeftAnkle,
    /// –
    RightAnkle,
}

impl Joint {
    /// All.
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

    /// As it stands in files.
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

    /// The part that it is told by and its place there, number by number times that part's sizes; of the neck where it is on the chain, see [`super::Body::place_of`]. Where two parts meet the one nearer to the torso tells.
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

    /// The limb that must be in the model for it to be told; `None`: head and trunk do.
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
