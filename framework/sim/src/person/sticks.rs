//! Skeletons of sticks, for tests.

use foveate_scene::skeleton::{Axis, Channel, Joint};

/// Two limbs, one on either side.
pub struct Limbs {
    /// Names of the three joints, without the side.
    pub names: [&'static str; 3],
    /// Of the left first joint from what it hangs on.
    pub at: [f64; 3],
    /// Down to the second joint and from there to the third.
    pub lengths: [f64; 2],
}

/// Hips, a trunk so far above them, a head so far above that, legs on the hips and arms on the trunk: y up, looking along z, each with rotations about z, y, x.
pub fn skeleton((trunk, up): (&str, f64), head_up: f64, legs: &Limbs, arms: &Limbs) -> Vec<Joint> {
    use Axis::{X, Y, Z};
    let joint = |name: &str, parent: Option<usize>, offset: [f64; 3]| Joint {
        name: name.to_owned(),
        parent,
        offset: offset.into(),
        channels: [Z, Y, X].map(Channel::Rotation).to_vec(),
        end: None,
    };
    let mut joints = vec![joint("Hips", None, [0.0; 3]), joint(trunk, Some(0), [0.0, up, 0.0])];
    joints[0].channels.splice(0..0, [X, Y, Z].map(Channel::Position));
    joints.push(joint("Head", Some(1), [0.0, head_up, 0.0]));
    for (side, out) in [("Left", 1.0), ("Right", -1.0)] {
        for (parent, limbs) in [(0, legs), (1, arms)] {
            let n = joints.len();
            let ([x, y, z], [upper, lower]) = (limbs.at, limbs.lengths);
            joints.push(joint(&format!("{side}{}", limbs.names[0]), Some(parent), [out * x, y, z]));
            joints.push(joint(&format!("{side}{}", limbs.names[1]), Some(n), [0.0, -upper, 0.0]));
            joints.push(joint(&format!("{side}{}", limbs.names[2]), Some(n + 1), [0.0, -lower, 0.0]));
        }
    }
    joints
}
