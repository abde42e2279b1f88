//! Where a person's joints truly are: what recovered skeletons are compared with, and what a body in clothes is built around.

use nalgebra::{Isometry3, Point3, Vector3};

use super::body::{HEAD_RADIUS, Pose};

/// How many joints there are.
pub const N_JOINT_CENTRES: usize = 16;

/// What [`Joints::centres`] are, in their order: `head` is the middle of the head, `neck` lies between the shoulders, `pelvis` between the hips.
pub const JOINT_NAMES: [&str; N_JOINT_CENTRES] = [
    "head",
    "neck",
    "pelvis",
    "left shoulder",
    "right shoulder",
    "left elbow",
    "right elbow",
    "left wrist",
    "right wrist",
    "left hip",
    "right hip",
    "left knee",
    "right knee",
    "left ankle",
    "right ankle",
    "head joint",
];

/// The joints of a person at one time, the left one first [m].
#[derive(Debug, Clone, PartialEq)]
pub struct Joints {
    /// Takes points of the head's space (x forward, y left, z up, the origin in the middle of the head) to the world.
    pub head: Isometry3<f64>,
    /// About which the head nods.
    pub head_joint: Point3<f64>,
    /// Of the upper arms at the trunk.
    pub shoulders: [Point3<f64>; 2],
    /// Between upper arms and forearms.
    pub elbows: [Point3<f64>; 2],
    /// Between forearms and hands.
    pub wrists: [Point3<f64>; 2],
    /// Of the thighs at the pelvis.
    pub hips: [Point3<f64>; 2],
    /// Between thighs and shanks.
    pub knees: [Point3<f64>; 2],
    /// Between shanks and feet.
    pub ankles: [Point3<f64>; 2],
    /// Direction of walking, level, of length 1.
    pub forward: Vector3<f64>,
    /// Times the size of the built-in body [–].
    pub size: f64,
}

impl Joints {
    /// Centres of the joints in the order of [`JOINT_NAMES`] [m].
    pub fn centres(&self) -> [Point3<f64>; N_JOINT_CENTRES] {
        let middle = |[a, b]: [Point3<f64>; 2]| nalgebra::center(&a, &b);
        let [shoulders, elbows, wrists] = [self.shoulders, self.elbows, self.wrists];
        let [hips, knees, ankles] = [self.hips, self.knees, self.ankles];
        [
            self.head.translation.vector.into(),
            middle(shoulders),
            middle(hips),
            shoulders[0],
            shoulders[1],
            elbows[0],
            elbows[1],
            wrists[0],
            wrists[1],
            hips[0],
            hips[1],
            knees[0],
            knees[1],
            ankles[0],
            ankles[1],
            self.head_joint,
        ]
    }
}

impl Pose {
    /// The joints that this body was built around.
    pub fn joints(&self) -> Joints {
        let size = self.parts[3].radius / HEAD_RADIUS;
        let pair = |first: usize, end: usize| [0, 1].map(|side| self.parts[first + side].ends[end]);
        // Forearms reach beyond the wrists into the hands.
        let elbows = pair(9, 0);
        let wrists = [0, 1].map(|side| {
            let [elbow, end] = self.parts[9 + side].ends;
            let fore = (end - elbow).try_normalize(1e-9).unwrap_or(-Vector3::z());
            end - fore * (super::body::HAND * size)
        });
        let up = self.head.rotation * Vector3::z();
        Joints {
            head: self.head,
            head_joint: Point3::from(self.head.translation.vector) - up * (super::body::HEAD_JOINT * size),
            shoulders: pair(7, 0),
            elbows,
            wrists,
            hips: pair(11, 0),
            knees: pair(11, 1),
            ankles: pair(13, 1),
            forward: self.forward,
            size,
        }
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::super::Person;

    #[test]
    fn bones_of_the_built_in_body_keep_their_lengths_and_leds_lie_by_their_joints() {
        let person = Person::new(0, 1, [2.5, 4.0], 0.9, &Random::new(5));
        for step in 0..40 {
            let pose = person.pose(f64::from(step) * 0.31);
            let it = pose.joints();
            assert!((it.size - 1.0).abs() < 1e-12);
            for side in 0..2 {
                assert!(((it.elbows[side] - it.shoulders[side]).norm() - 0.29).abs() < 1e-9);
                assert!(((it.wrists[side] - it.elbows[side]).norm() - 0.25).abs() < 1e-9);
                assert!(((it.knees[side] - it.hips[side]).norm() - 0.42).abs() < 1e-9);
                assert!(((it.ankles[side] - it.knees[side]).norm() - 0.42).abs() < 1e-9);
                assert!((pose.leds[4 + side].position - it.elbows[side]).norm() < 0.07);
                assert!((pose.leds[6 + side].position - it.wrists[side]).norm() < 0.06);
            }
        }
    }
}
