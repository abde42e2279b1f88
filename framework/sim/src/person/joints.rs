//! Finds the joints that a body needs in a recorded skeleton, under the names in common use.
//!
//! Names are compared without what stands before a `:`, without case and marks between letters. A side stands in front (`LeftKnee`, `lShldr`, `Bip01 L Calf`) or
//! behind (`calf_l`). Where a skeleton has both a collar bone and an upper arm the names tell which is which: with `LeftArm`, `LeftShoulder` is the collar.

use foveate_scene::skeleton::SkeletonMotion;

/// The joints that are needed.
pub(super) const N_JOINTS: usize = 13;
/// Place of the head among them; before it hips, knees, ankles, shoulders, elbows and wrists, the left one first each time.
pub(super) const HEAD: usize = 12;

/// What the joints of one side go by, the surest name first.
const OF_A_SIDE: [&[&str]; 6] = [
    &["UpLeg", "UpperLeg", "Thigh", "Hip"],
    &["Leg", "LowerLeg", "Shin", "Calf", "Knee"],
    &["Foot", "Ankle"],
    &["Arm", "UpperArm", "Shldr", "Shoulder"],
    &["ForeArm", "LowerArm", "Elbow"],
    &["Hand", "Wrist"],
];

/// Letters and digits only, small; of `skeleton:LeftArm` the last part.
fn plain(name: &str) -> String {
    let own = name.rsplit(':').next().unwrap_or(name);
    let own: String = own.chars().filter(char::is_ascii_alphanumeric).map(|it| it.to_ascii_lowercase()).collect();
    ["bip01", "bip001"].iter().find_map(|it| own.strip_prefix(it)).unwrap_or(&own).to_owned()
}

/// Their numbers among the joints of `motion`.
///
/// # Errors
/// A sentence that names the one that is missing.
pub(super) fn find_joints(motion: &SkeletonMotion) -> Result<[usize; N_JOINTS], String> {
    let names: Vec<String> = motion.joints.iter().map(|it| plain(&it.name)).collect();
    let find = |wanted: &str| names.iter().position(|it| *it == wanted.to_ascii_lowercase());
    let missing = |wanted: &[String]| {
        let all: Vec<&str> = motion.joints.iter().map(|it| it.name.as_str()).take(12).collect();
        format!("found the joints {}, …, expected one named `{}`", all.join(", "), wanted.join("` or `"))
    };
    let mut found = [0; N_JOINTS];
    for (kind, wanted) in OF_A_SIDE.iter().enumerate() {
        for (side, [long, short]) in [["Left", "L"], ["Right", "R"]].into_iter().enumerate() {
            let spelt = |it: &str| [format!("{long}{it}"), format!("{short}{it}"), format!("{it}{short}")];
            // Any name with the whole word first: of `LeftWrist` and `lhand` the former is the joint, the latter hangs on it.
            let by_spelling = |place: usize| wanted.iter().find_map(|it| find(&spelt(it)[place]));
            found[2 * kind + side] = (0..3)
                .find_map(by_spelling)
                .ok_or_else(|| missing(&wanted.iter().map(|it| format!("{long}{it}")).collect::<Vec<_>>()))?;
        }
    }
    found[HEAD] = find("Head").ok_or_else(|| missing(&["Head".to_owned()]))?;
    Ok(found)
}

#[cfg(test)]
mod tests {
    use foveate_scene::skeleton::Joint;
    use nalgebra::Vector3;

    use super::*;

    fn skeleton(names: &[&str]) -> SkeletonMotion {
        let joint = |name: &&str| Joint {
            name: (*name).to_owned(),
            parent: None,
            offset: Vector3::zeros(),
            channels: Vec::new(),
            end: None,
        };
        SkeletonMotion { joints: names.iter().map(joint).collect(), frame_s: 0.01, values: Vec::new() }
    }

    #[test]
    fn joints_are_found_under_the_names_of_many_programs() {
        let found = |text: &str| find_joints(&skeleton(&text.split(' ').collect::<Vec<_>>()));
        // In the order in which they are asked for, with what is easily mistaken for one of them behind.
        let right = (0..N_JOINTS).collect::<Vec<_>>();
        for text in [
            "LeftHip RightHip LeftKnee RightKnee LeftAnkle RightAnkle LeftShoulder RightShoulder LeftElbow RightElbow LeftWrist RightWrist Head LHipJoint lhand rhand",
            "m:LeftUpLeg m:RightUpLeg m:LeftLeg m:RightLeg m:LeftFoot m:RightFoot m:LeftArm m:RightArm m:LeftForeArm m:RightForeArm m:LeftHand m:RightHand m:Head m:LeftShoulder",
            "thigh_l thigh_r calf_l calf_r foot_l foot_r upperarm_l upperarm_r lowerarm_l lowerarm_r hand_l hand_r head clavicle_l",
            "lThigh rThigh lShin rShin lFoot rFoot lShldr rShldr lForeArm rForeArm lHand rHand head lCollar",
        ] {
            assert_eq!(found(text).unwrap().to_vec(), right, "{text}");
        }
        let of_max = "Thigh|Calf|Foot|UpperArm|Forearm|Hand"
            .split('|')
            .flat_map(|it| ["L", "R"].map(|side| format!("Bip01 {side} {it}")))
            .chain(["Bip01 Head".to_owned()])
            .collect::<Vec<_>>();
        assert_eq!(find_joints(&skeleton(&of_max.iter().map(String::as_str).collect::<Vec<_>>())).unwrap()[12], 12);
        let missing = found("LeftHip RightHip LeftKnee LeftAnkle").unwrap_err();
        assert!(missing.contains("expected one named `RightLeg` or") && missing.contains("`RightKnee`"), "{missing}");
    }
}
