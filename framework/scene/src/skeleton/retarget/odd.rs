//! Probable mistakes in a map of joints.

use nalgebra::Vector3;

use super::{RetargetError, RigJoint, UpAxes, followed, rig_of, stand, unit};
use crate::skeleton::{Axis, SkeletonMotion};

/// A bone lies above or below the root at rest by more than this, of the height of its skeleton [–].
const APART: f64 = 0.1;

/// A side, as names of joints say it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

/// The side that a name says: `LeftArm`, `arm_l`, `mixamorig:RightLeg`, `r.knee`, `lShin`, `RThigh`; `None` where it says none, or both.
fn side_of(name: &str) -> Option<Side> {
    let name = name.rsplit(':').next().unwrap_or(name);
    let lower = name.to_lowercase();
    let letter = |letter: char| {
        let parts = lower.split(|it: char| !it.is_alphanumeric());
        let is_apart = parts.filter(|it| it.chars().eq([letter])).count() > 0;
        // `lShin`, `RThigh`: a letter before a capital.
        let mut start = name.chars();
        is_apart
            || start.next().is_some_and(|it| it.to_lowercase().eq([letter]))
                && start.next().is_some_and(char::is_uppercase)
                && start.next().is_some_and(char::is_lowercase)
    };
    let [left, right] = [("left", 'l'), ("right", 'r')].map(|(word, short)| lower.contains(word) || letter(short));
    match (left, right) {
        (true, false) => Some(Side::Left),
        (false, true) => Some(Side::Right),
        _ => None,
    }
}

/// How high the middle of each joint's bones lies above the root at rest, of the height of all [–]: hips lie as high as the root, thighs do not.
fn heights(joints: &[RigJoint], up: &Vector3<f64>) -> Vec<f64> {
    let stands = stand(joints, None);
    let own: Vec<f64> = stands.iter().map(|it| it.translation.vector.dot(up)).collect();
    let ends = |joint: usize| -> Vec<f64> {
        let hang = (0..joints.len()).filter(|it| joints[*it].parent == Some(joint)).map(|it| own[it]);
        let end = joints[joint].end.map(|it| (stands[joint] * nalgebra::Point3::from(it)).coords.dot(up));
        hang.chain(end).collect()
    };
    let ends: Vec<Vec<f64>> = (0..joints.len()).map(ends).collect();
    let [low, high] =
        [f64::min, f64::max].map(|it| ends.iter().flatten().chain(&own).copied().reduce(it).unwrap_or(0.0));
    let root = own.first().copied().unwrap_or(0.0);
    let middle = |(own, ends): (&f64, &Vec<f64>)| match ends.len() {
        0 => *own,
        n => 0.5 * (own + ends.iter().sum::<f64>() / n as f64),
    };
    own.iter().zip(&ends).map(|it| (middle(it) - root) / (high - low).max(f64::MIN_POSITIVE)).collect()
}

fn is_below(joints: &[RigJoint], joint: usize, above: usize) -> bool {
    std::iter::successors(joints[joint].parent, |it| joints[*it].parent).any(|it| it == above)
}

/// Pairs of a map that are probably mistakes: of different sides, of an arm and a leg, or in the other order along a limb. One sentence each.
///
/// # Errors
/// As [`followed`].
pub fn suspicious_pairs(
    motion: &SkeletonMotion,
    rig: &[RigJoint],
    map: &[(String, String)],
    up: Axis,
    ups: &UpAxes,
) -> Result<Vec<String>, RetargetError> {
    let source = rig_of(motion);
    let names: Vec<&str> = source.iter().map(|it| it.name.as_str()).collect();
    let follows = followed(rig, &names, map)?;
    let (of_rig, of_motion) = (heights(rig, &unit(up)), heights(&source, &ups.rest));
    let pairs: Vec<(usize, usize)> = follows.iter().enumerate().filter_map(|(at, it)| Some((at, (*it)?))).collect();
    let mut odd = Vec::new();
    for &(joint, leader) in &pairs {
        let (name, other) = (&rig[joint].name, names[leader]);
        let place = |height: f64| if height > 0.0 { "above" } else { "below" };
        match (side_of(name), side_of(other)) {
            (Some(side), Some(led)) if side != led => odd.push(format!("`{name}` follows {other}: left and right")),
            _ if of_rig[joint].min(of_motion[leader]) < -APART && of_rig[joint].max(of_motion[leader]) > APART => odd
                .push(format!(
                    "`{name}`, {} the root at rest, follows {other}, {} it",
                    place(of_rig[joint]),
                    place(of_motion[leader])
                )),
            _ => {
                let turned = pairs.iter().find(|it| is_below(rig, joint, it.0) && is_below(&source, it.1, leader));
                odd.extend(turned.map(|(above, below)| {
                    format!(
                        "`{name}` hangs below `{}`, and {other}, which it follows, above {}",
                        rig[*above].name, names[*below]
                    )
                }));
            }
        }
    }
    Ok(odd)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_a_side_by_words_and_letters_and_none_where_they_say_none() {
        let left = ["LeftArm", "arm_l", "mixamorig:LeftLeg", "l.knee", "lShin", "LThigh", "thigh.L", "upper_arm_l_01"];
        let right = ["RightArm", "fore_r", "rShldr", "r_hip", "hand-R"];
        let none = ["Hips", "Spine", "root", "Leg", "lower_back", "Head", "RL", "l_r_mid", "RHS", "right_left"];
        assert!(left.iter().all(|it| side_of(it) == Some(Side::Left)), "{:?}", left.map(side_of));
        assert!(right.iter().all(|it| side_of(it) == Some(Side::Right)), "{:?}", right.map(side_of));
        assert!(none.iter().all(|it| side_of(it).is_none()), "{:?}", none.map(side_of));
    }
}
