//! From joint angles to LEDs and the body parts that may hide them.
//!
//! Body frame: x forward, y left, z up, its origin on the floor below the pelvis.

use nalgebra::{Isometry3, Matrix3, Point2, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::N_LEDS;
use super::posture::Posture;
use super::walk::Place;

/// How many body parts a person has.
pub const N_PARTS: usize = 15;

/// A LED sits this far above the skin [m], so that the part that carries it hides it from the other side only.
const LED_HEIGHT: f64 = 0.015;
/// Cosine of the angle from its normal at which a LED's dome goes dark, negative: beyond 90°.
const DARK_COSINE: f64 = -0.35;

/// How far above the knee a LED is worn there [m].
const KNEE_LED: f64 = 0.12;

const PELVIS: f64 = 0.98;
const SHOULDERS: f64 = 1.44;
const HALF_SHOULDERS: f64 = 0.18;
const HEAD: f64 = 1.65;
/// From the joint about which the head nods up to its middle [m].
pub(super) const HEAD_JOINT: f64 = 0.06;
pub(super) const HIPS: f64 = 0.90;
const HALF_HIPS: f64 = 0.09;
const UPPER_ARM: f64 = 0.29;
const FOREARM: f64 = 0.25;
pub(super) const THIGH: f64 = 0.42;
pub(super) const SHANK: f64 = 0.42;
/// A forearm reaches so far beyond the wrist, into the hand [m].
pub(super) const HAND: f64 = 0.1;
/// Of the ankle over the floor [m].
pub(super) const FOOT: f64 = 0.06;

pub(super) const HEAD_RADIUS: f64 = 0.105;
pub(super) const TORSO_RADIUS: f64 = 0.125;
pub(super) const SHOULDER_RADIUS: f64 = 0.06;
pub(super) const UPPER_ARM_RADIUS: f64 = 0.045;
pub(super) const FOREARM_RADIUS: f64 = 0.035;

/// A light on the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Led {
    /// Where it is in the world [m].
    pub position: Point3<f64>,
    /// Where it shines brightest, of length 1.
    pub normal: Vector3<f64>,
}

impl Led {
    /// Brightness towards `eye` relative to that along the normal: falls with the cosine of the angle and reaches 0 some
    /// 20° behind the plane of the LED, for the dome sticks out. [–]
    pub fn emission_towards(&self, eye: &Point3<f64>) -> f64 {
        let to_eye = eye - self.position;
        let cosine = to_eye.dot(&self.normal) / to_eye.norm();
        ((cosine - DARK_COSINE) / (1.0 - DARK_COSINE)).max(0.0)
    }
}

/// A capsule: all points within `radius` of a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPart {
    /// Ends of the segment [m].
    pub ends: [Point3<f64>; 2],
    /// [m]
    pub radius: f64,
    /// How bright it looks [–]: 1 for white cloth.
    pub albedo: f64,
}

impl BodyPart {
    /// Whether the straight line from `a` to `b` passes through it.
    pub fn blocks(&self, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        squared_distance([*a, *b], self.ends) < self.radius * self.radius
    }
}

/// A person at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// In the order of [`LED_NAMES`](super::LED_NAMES).
    pub leds: [Led; N_LEDS],
    /// What may hide them.
    pub parts: [BodyPart; N_PARTS],
    /// Takes points of the head's space (x forward, y left, z up, the origin in the middle of the head) to the world.
    pub head: Isometry3<f64>,
    /// Direction of walking, level, of length 1.
    pub forward: Vector3<f64>,
    /// Middle of the body on the floor [m].
    pub middle: Point2<f64>,
    /// All body parts lie within this distance of the upright line through `middle` [m].
    pub reach: f64,
}

impl Pose {
    /// A LED on the right thigh, a little above the knee, that shines ahead: worn where the knee is looked at.
    pub fn knee_led(&self) -> Led {
        let [hip, knee] = self.parts[12].ends;
        let up = (hip - knee).normalize();
        let ahead = self.forward - up * self.forward.dot(&up);
        led_on(knee + up * KNEE_LED, self.parts[12].radius, ahead)
    }

    /// The same person `by` times as tall, standing where it does.
    pub(super) fn grown(mut self, by: f64) -> Pose {
        let foot = Point3::new(self.middle.x, self.middle.y, 0.0);
        let place = |it: Point3<f64>| foot + (it - foot) * by;
        for led in &mut self.leds {
            led.position = place(led.position);
        }
        for part in &mut self.parts {
            part.ends = part.ends.map(place);
            part.radius *= by;
        }
        self.head.translation.vector = place(self.head.translation.vector.into()).coords;
        self.reach *= by;
        self
    }

    /// Whether a body part lies between `eye` and `point` [m].
    pub fn occluded(&self, eye: &Point3<f64>, point: &Point3<f64>) -> bool {
        // Seen from above, a line that passes through a part passes through the circle around all of them.
        let (from, to) = (eye.xy(), point.xy());
        let along = to - from;
        let share = ((self.middle - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0); // NaN for an upright line
        let beside = (from + along * share - self.middle).norm_squared();
        if beside > self.reach * self.reach {
            return false;
        }
        self.parts.iter().any(|part| part.blocks(eye, point))
    }
}

/// The axes and origin of the body frame in the world.
struct Frame {
    origin: Point3<f64>,
    forward: Vector3<f64>,
    left: Vector3<f64>,
}

impl Frame {
    fn direction(&self, x: f64, y: f64, z: f64) -> Vector3<f64> {
        self.forward * x + self.left * y + Vector3::z() * z
    }

    fn point(&self, x: f64, y: f64, z: f64) -> Point3<f64> {
        self.origin + self.direction(x, y, z)
    }

    /// The same origin, turned counter-clockwise as seen from above.
    fn turned(&self, angle: f64) -> Frame {
        let (sine, cosine) = angle.sin_cos();
        Frame {
            origin: self.origin,
            forward: self.forward * cosine + self.left * sine,
            left: self.left * cosine - self.forward * sine,
        }
    }
}

/// A LED on the skin of a part of `radius` around `axis_point`, on the side of `normal` (any length).
pub(super) fn led_on(axis_point: Point3<f64>, radius: f64, normal: Vector3<f64>) -> Led {
    // Along a limb there is no side to be on; that side is then up.
    let normal = normal.try_normalize(1e-9).unwrap_or(Vector3::z());
    Led { position: axis_point + normal * (radius + LED_HEIGHT), normal }
}

pub(super) fn pose(place: &Place, posture: &Posture) -> Pose {
    let forward = Vector3::new(place.forward.x, place.forward.y, 0.0);
    let left = Vector3::new(-forward.y, forward.x, 0.0);
    let Posture { rise, sway, .. } = *posture;
    let origin = Point3::new(place.position.x, place.position.y, rise) + left * sway;
    let body = Frame { origin, forward, left };
    let chest = body.turned(posture.twist);
    let looking = body.turned(posture.look);

    let part = |a: Point3<f64>, b: Point3<f64>, radius: f64, albedo: f64| BodyPart { ends: [a, b], radius, albedo };
    let pelvis = body.point(0.0, 0.0, PELVIS);
    let neck = chest.point(0.02, 0.0, SHOULDERS + 0.04);
    // The head nods and tilts about the joint below it.
    let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[looking.forward, looking.left, Vector3::z()]));
    let axes = axes * Rotation3::from_euler_angles(posture.tilt, posture.nod, 0.0);
    let below = looking.point(0.04, 0.0, HEAD) - Vector3::z() * HEAD_JOINT;
    let head_centre = below + axes * Vector3::z() * HEAD_JOINT;
    let shoulders = [1.0, -1.0].map(|out| chest.point(0.02, out * HALF_SHOULDERS, SHOULDERS));
    let hips = [1.0, -1.0].map(|out| body.point(0.0, out * HALF_HIPS, HIPS));

    let waist_led = led_on(body.point(0.02, 0.0, PELVIS + 0.04), TORSO_RADIUS + 0.01, body.direction(1.0, 0.0, 0.45));
    let head_led = led_on(head_centre, HEAD_RADIUS, axes * Vector3::new(0.2, 0.0, 1.0));
    let mut leds = [head_led, waist_led, head_led, head_led, head_led, head_led, head_led, head_led];
    let trunk = part(pelvis, chest.point(0.02, 0.0, 1.33), TORSO_RADIUS, 0.45);
    let mut parts = [trunk; N_PARTS];
    parts[1] = part(shoulders[0], shoulders[1], SHOULDER_RADIUS, 0.45);
    parts[2] = part(hips[0], hips[1], 0.11, 0.2);
    parts[3] = part(head_centre - axes * Vector3::z() * 0.03, head_centre, HEAD_RADIUS, 0.75);
    parts[4] = part(neck, head_centre, 0.055, 0.7);
    // The two halves of the rib cage: people are wider than deep.
    parts[5] = part(chest.point(0.02, 0.07, 1.05), chest.point(0.02, 0.09, 1.32), 0.105, 0.45);
    parts[6] = part(chest.point(0.02, -0.07, 1.05), chest.point(0.02, -0.09, 1.32), 0.105, 0.45);
    for (side, out) in [(0, 1.0), (1, -1.0)] {
        let [upper, fore] = posture.arms[side].map(|it| chest.direction(it.x, it.y, it.z));
        let elbow = shoulders[side] + upper * UPPER_ARM;
        let wrist = elbow + fore * FOREARM;
        let [thigh, shank] = posture.legs[side].map(|it| body.direction(it.x, it.y, it.z));
        let knee = hips[side] + thigh * THIGH;
        parts[7 + side] = part(shoulders[side], elbow, UPPER_ARM_RADIUS, 0.45);
        parts[9 + side] = part(elbow, wrist + fore * HAND, FOREARM_RADIUS, 0.65);
        parts[11 + side] = part(hips[side], knee, 0.075, 0.2);
        parts[13 + side] = part(knee, knee + shank * SHANK, 0.05, 0.2);

        // On the outer side of each limb, perpendicular to it, tilted up or back as straps sit.
        let outward = chest.direction(0.0, out, 0.0);
        let across = |along: &Vector3<f64>, wish: Vector3<f64>| wish - along * along.dot(&wish);
        leds[2 + side] = led_on(shoulders[side], SHOULDER_RADIUS, chest.direction(0.0, 0.55 * out, 1.0));
        leds[4 + side] =
            led_on(elbow, UPPER_ARM_RADIUS, across(&upper, outward * 0.9 - chest.forward * 0.35 + Vector3::z() * 0.3));
        leds[6 + side] =
            led_on(wrist, FOREARM_RADIUS, across(&fore, outward + chest.forward * 0.2 + Vector3::z() * 0.4));
    }
    let middle = body.origin.xy();
    let reach = reach_of(&parts, middle);
    let rotation = UnitQuaternion::from_rotation_matrix(&axes);
    let head = Isometry3::from_parts(Translation3::from(head_centre), rotation);
    Pose { leds, parts, head, forward, middle, reach }
}

/// How far the parts reach from the upright line through `middle` [m].
pub(super) fn reach_of(parts: &[BodyPart; N_PARTS], middle: Point2<f64>) -> f64 {
    let farthest = |part: &BodyPart| {
        let [a, b] = part.ends.map(|end| (end.xy() - middle).norm_squared());
        a.max(b).sqrt() + part.radius
    };
    parts.iter().map(farthest).fold(0.0, f64::max)
}

/// The least squared distance between two segments [m²]; the second may be a point.
///
/// Source: C. Ericson, *Real-Time Collision Detection*, 2005, §5.1.9.
fn squared_distance([p1, q1]: [Point3<f64>; 2], [p2, q2]: [Point3<f64>; 2]) -> f64 {
    let (d1, d2, r) = (q1 - p1, q2 - p2, p1 - p2);
    let (a, e, f) = (d1.norm_squared(), d2.norm_squared(), d2.dot(&r));
    let (c, b) = (d1.dot(&r), d1.dot(&d2));
    let share = |of: f64, whole: f64| if whole > 0.0 { (of / whole).clamp(0.0, 1.0) } else { 0.0 };
    // Closest point of the first line to the second, clamped; then back and forth once.
    let denominator = a * e - b * b;
    let s = share(b * f - c * e, denominator);
    let t = share(b * s + f, e);
    let s = share(b * t - c, a);
    (p1 + d1 * s - (p2 + d2 * t)).norm_squared()
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    #[test]
    fn distance_of_segments_is_the_least_over_their_points() {
        let mut random = Random::new(11);
        for _ in 0..300 {
            let mut point = || Point3::from([(); 3].map(|()| random.uniform_in(-1.0, 1.0)));
            let (one, other) = ([point(), point()], [point(), point()]);
            let along = |[a, b]: [Point3<f64>; 2], i: i32| a + (b - a) * f64::from(i) / 100.0;
            let sampled = (0..=100)
                .flat_map(|i| (0..=100).map(move |j| (i, j)))
                .map(|(i, j)| (along(one, i) - along(other, j)).norm())
                .fold(f64::INFINITY, f64::min);
            let found = squared_distance(one, other).sqrt();
            assert!(found <= sampled + 1e-12 && found > sampled - 0.03, "{found} {sampled}");
        }
    }
}
