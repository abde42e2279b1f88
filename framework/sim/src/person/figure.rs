//! A body by the places of its joints, whatever the source of the motion: where its LEDs sit and what may hide them.
//!
//! A LED that is strapped to a limb turns with the limb; the parts between the joints are those of the built-in body, as large as the person is.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::body::{
    BodyPart, FOREARM_RADIUS, HAND, HEAD_JOINT, HEAD_RADIUS, N_PARTS, Pose, SHOULDER_RADIUS, TORSO_RADIUS,
    UPPER_ARM_RADIUS, led_on, reach_of,
};

/// How tall the built-in body is [m].
pub(super) const STATURE_M: f64 = 1.755;

/// A LED on a shoulder sits so far from the joint towards the neck [m]: it stays free of an arm that is raised.
const SHOULDER_LED: f64 = 0.06;

/// Places of the joints in the world [m], the left one first.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Figure {
    /// Times the size of the built-in body [–].
    pub size: f64,
    /// Of the joint below it.
    pub head: Point3<f64>,
    /// Where the head looks, and its upper side; independent, of any length.
    pub head_axes: [Vector3<f64>; 2],
    pub hips: [Point3<f64>; 2],
    pub knees: [Point3<f64>; 2],
    pub ankles: [Point3<f64>; 2],
    pub shoulders: [Point3<f64>; 2],
    pub elbows: [Point3<f64>; 2],
    pub wrists: [Point3<f64>; 2],
    /// The sides of upper arms and of forearms that wear a LED, of any length.
    pub straps: [[Vector3<f64>; 2]; 2],
}

/// To the front, to the left, up: at right angles, of length 1, with `left` as it is and the last as near to `up` as may be.
pub(super) fn axes(left: Vector3<f64>, up: Vector3<f64>) -> [Vector3<f64>; 3] {
    let left = left.try_normalize(1e-9).unwrap_or(Vector3::y());
    let front = left.cross(&up).try_normalize(1e-9).or_else(|| left.cross(&Vector3::z()).try_normalize(1e-9));
    let front = front.unwrap_or(Vector3::x());
    [front, left, front.cross(&left)]
}

fn middle([a, b]: [Point3<f64>; 2]) -> Point3<f64> {
    nalgebra::center(&a, &b)
}

impl Figure {
    /// The body with its LEDs.
    pub fn pose(&self) -> Pose {
        let size = self.size;
        let part = |a: Point3<f64>, b: Point3<f64>, radius: f64, albedo: f64| BodyPart {
            ends: [a, b],
            radius: radius * size,
            albedo,
        };
        let (pelvis, neck) = (middle(self.hips), middle(self.shoulders));
        let spine = neck - pelvis;
        let of_chest = axes(self.shoulders[0] - self.shoulders[1], spine);
        let of_hips = axes(self.hips[0] - self.hips[1], spine);
        let towards = |frame: &[Vector3<f64>; 3], [x, y, z]: [f64; 3]| frame[0] * x + frame[1] * y + frame[2] * z;
        // Between hips and shoulders, and aside.
        let trunk = |share: f64, aside: f64| pelvis + spine * share + of_chest[1] * (aside * size);

        let [looks, up] = self.head_axes;
        let up = up.try_normalize(1e-9).unwrap_or(Vector3::z());
        let left = up.cross(&looks).try_normalize(1e-9).unwrap_or(of_chest[1]);
        let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[left.cross(&up), left, up]));
        let head = self.head + up * (HEAD_JOINT * size);

        let waist_led =
            led_on(pelvis + spine * 0.22, (TORSO_RADIUS + 0.01) * size, towards(&of_hips, [1.0, 0.0, 0.45]));
        let head_led = led_on(head, HEAD_RADIUS * size, axes * Vector3::new(0.2, 0.0, 1.0));
        let mut leds = [head_led, waist_led, head_led, head_led, head_led, head_led, head_led, head_led];
        let mut parts = [part(trunk(0.15, 0.0), trunk(0.8, 0.0), TORSO_RADIUS, 0.45); N_PARTS];
        parts[1] = part(self.shoulders[0], self.shoulders[1], SHOULDER_RADIUS, 0.45);
        parts[2] = part(self.hips[0], self.hips[1], 0.11, 0.2);
        parts[3] = part(head - up * (0.03 * size), head, HEAD_RADIUS, 0.75);
        parts[4] = part(neck, head, 0.055, 0.7);
        for (side, out) in [(0, 1.0), (1, -1.0)] {
            parts[5 + side] = part(trunk(0.28, 0.07 * out), trunk(0.78, 0.09 * out), 0.105, 0.45);
            let [shoulder, elbow, wrist] = [self.shoulders[side], self.elbows[side], self.wrists[side]];
            let fore = (wrist - elbow).try_normalize(1e-9).unwrap_or(-Vector3::z());
            let upper = (elbow - shoulder).try_normalize(1e-9).unwrap_or(-Vector3::z());
            parts[7 + side] = part(shoulder, elbow, UPPER_ARM_RADIUS, 0.45);
            parts[9 + side] = part(elbow, wrist + fore * (HAND * size), FOREARM_RADIUS, 0.65);
            parts[11 + side] = part(self.hips[side], self.knees[side], 0.075, 0.2);
            parts[13 + side] = part(self.knees[side], self.ankles[side], 0.05, 0.2);

            let across = |along: &Vector3<f64>, wish: Vector3<f64>| wish - along * along.dot(&wish);
            let inwards = of_chest[1] * (-out * SHOULDER_LED * size);
            leds[2 + side] =
                led_on(shoulder + inwards, SHOULDER_RADIUS * size, towards(&of_chest, [0.0, 0.2 * out, 1.0]));
            let [on_upper, on_fore] = self.straps[side];
            leds[4 + side] = led_on(elbow, UPPER_ARM_RADIUS * size, across(&upper, on_upper));
            leds[6 + side] = led_on(wrist, FOREARM_RADIUS * size, across(&fore, on_fore));
        }
        let forward = Vector3::new(of_hips[0].x, of_hips[0].y, 0.0).try_normalize(1e-9).unwrap_or(Vector3::x());
        let middle = pelvis.xy();
        let head = Isometry3::from_parts(Translation3::from(head), UnitQuaternion::from_rotation_matrix(&axes));
        Pose { leds, parts, head, forward, middle, reach: reach_of(&parts, middle) }
    }
}
