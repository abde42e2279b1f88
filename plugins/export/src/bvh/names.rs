//! Maps points of a file to the sites of a body by their names.

use std::collections::BTreeMap;

use super::body::SITES;

/// Names of markers in use, without a subject's name, capitals and signs, `?` being `l` or `r` and `*` `left` or `right`: for each site the
/// alternatives, the middle of whose markers it is. From the Plug-in Gait and Helen Hayes marker sets, OpenSim's examples, BVH skeletons, and ours.
const KNOWN: [(&str, &[&[&str]]); 5] = [
    (
        "head",
        &[
            // Of a skeleton's last bone: the top of the head, where the joint is at its base.
            &["headend"],
            &["headtopend"],
            &["head"],
            &["lfhd", "rfhd", "lbhd", "rbhd"],
            &["lfhd", "rfhd"],
            &["headtop"],
            &["tophead"],
            &["headend"],
            &["vertex"],
            &["leftear", "rightear"],
        ],
    ),
    (
        "waist",
        &[
            &["waist"],
            &["hips"],
            &["hip"],
            &["pelvis"],
            &["lasi", "rasi", "lpsi", "rpsi"],
            &["lasi", "rasi", "sacr"],
            &["lasis", "rasis", "vsacral"],
            &["lasis", "rasis"],
            &["lasi", "rasi"],
            &["lfwt", "rfwt", "lbwt", "rbwt"],
            &["lfwt", "rfwt"],
            &["sacr"],
            &["midhip"],
            &["lefthip", "righthip"],
            &["root"],
        ],
    ),
    (
        "shoulder",
        &[&["*shoulder"], &["?shoulder"], &["?sho"], &["?acr"], &["?acromium"], &["?acromion"], &["shoulder?"]],
    ),
    (
        "elbow",
        &[
            &["*elbow"],
            &["?elbow"],
            &["?elb"],
            &["?elblat", "?elbmed"],
            &["?elbowlat"],
            &["?elbowlateral"],
            &["elbow?"],
        ],
    ),
    (
        "wrist",
        &[
            &["*wrist"],
            &["?wrist"],
            &["?wra", "?wrb"],
            &["?wri"],
            &["?radius", "?ulna"],
            &["?wristlat", "?wristmed"],
            &["*hand"],
            &["?hand"],
            &["hand?"],
            &["*forearmend"],
            &["wrist?"],
        ],
    ),
];

/// Skeletons name a joint after the bone that begins there: upper arm and forearm. Their shoulder is where the collar bone begins.
const BONES: [[&str; 2]; 9] = [
    ["*arm", "*forearm"],
    ["*upperarm", "*forearm"],
    ["*upperarm", "*lowerarm"],
    ["?upperarm", "?forearm"],
    ["?upperarm", "?lowerarm"],
    ["?arm", "?forearm"],
    ["?shldr", "?forearm"],
    ["upperarm?", "forearm?"],
    ["upperarm?", "lowerarm?"],
];

/// Where elbows have points of their own, arm and forearm are markers between joints.
const ELBOWS: [&str; 3] = ["*elbow", "?elbow", "?elb"];

/// Prefixes that some programs put before each name.
const PREFIXES: [&str; 4] = ["mixamorig", "bip001", "bip01", "character1"];

/// A name without prefixes, capitals and signs.
fn core(name: &str) -> String {
    let last = name.rsplit(':').next().unwrap_or(name);
    let core: String = last.chars().filter(|it| it.is_alphanumeric()).flat_map(char::to_lowercase).collect();
    let bare = PREFIXES.iter().find_map(|it| core.strip_prefix(it)).filter(|it| !it.is_empty());
    bare.map_or(core.clone(), str::to_owned)
}

/// Whether a point is of the left (or right) side, by its name.
pub(super) fn is_left(label: &str) -> Option<bool> {
    let core = core(label);
    match core.chars().next() {
        Some('l') => Some(true),
        Some('r') => Some(false),
        _ => None,
    }
}

/// The points of each of [`SITES`]; empty for a site without points.
///
/// `named` gives them by site, as `head` or `left_wrist`; the other sites are found by names in use: the first alternative that `is_seen`, all its points in
/// one frame at least.
///
/// # Errors
/// A sentence: a site or a point that does not exist.
pub(super) fn sites(
    labels: &[String],
    named: &BTreeMap<String, Vec<String>>,
    is_seen: &dyn Fn(&[usize]) -> bool,
) -> Result<[Vec<usize>; 8], String> {
    if let Some(wrong) = named.keys().find(|it| !SITES.contains(&it.as_str())) {
        return Err(format!("found the joint `{wrong}`, expected one of {}", SITES.join(", ")));
    }
    let cores: Vec<String> = labels.iter().map(|it| core(it)).collect();
    let mut found: [Vec<usize>; 8] = Default::default();
    for (site, points) in SITES.iter().zip(&mut found) {
        if let Some(names) = named.get(*site) {
            for name in names {
                let place =
                    labels.iter().position(|it| it == name).or_else(|| cores.iter().position(|it| *it == core(name)));
                points.push(
                    place.ok_or_else(|| format!("found no point `{name}` for `{site}`, expected one of the file's"))?,
                );
            }
            continue;
        }
        let (side, of_body) = site.split_once('_').unwrap_or(("", *site));
        let alternatives = KNOWN.iter().find(|it| it.0 == of_body).map_or(&[][..], |it| it.1);
        let place = |name: &&str| {
            let letter = side.get(..1).unwrap_or("");
            let wanted = name.replace('*', side).replace('?', letter);
            cores.iter().position(|it| *it == wanted)
        };
        let whole: Vec<Vec<usize>> =
            alternatives.iter().filter_map(|it| it.iter().map(place).collect::<Option<Vec<usize>>>()).collect();
        let seen = whole.iter().find(|it| is_seen(it));
        *points = seen.or(whole.first()).cloned().unwrap_or_default();
        let bone = ["shoulder", "elbow"].iter().position(|it| *it == of_body);
        let is_marked = ELBOWS.iter().any(|it| place(it).is_some());
        if let Some(bone) = bone.filter(|_| !is_marked)
            && let Some(of_arm) = BONES.iter().find_map(|it| Some([place(&it[0])?, place(&it[1])?]))
        {
            *points = vec![of_arm[bone]];
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(all: &[&str]) -> Vec<String> {
        all.iter().map(|it| (*it).to_owned()).collect()
    }

    #[test]
    fn marker_sets_in_use_are_known() {
        let none = BTreeMap::new();
        let plug_in_gait = [
            "LFHD", "RFHD", "LBHD", "RBHD", "C7", "LSHO", "RSHO", "LELB", "RELB", "LWRA", "LWRB", "RWRA", "RWRB",
            "LASI", "RASI", "LPSI", "RPSI",
        ];
        let found =
            sites(&labels(&plug_in_gait.map(|it| format!("Bob:{it}")).each_ref().map(String::as_str)), &none, &|_| {
                true
            })
            .unwrap();
        assert_eq!(
            found,
            [vec![0, 1, 2, 3], vec![13, 14, 15, 16], vec![5], vec![6], vec![7], vec![8], vec![9, 10], vec![11, 12]]
        );
        let ours = labels(&[
            "head",
            "waist",
            "left_shoulder",
            "right_shoulder",
            "left_elbow",
            "right_elbow",
            "left_wrist",
            "right_wrist",
        ]);
        assert_eq!(sites(&ours, &none, &|_| true).unwrap(), std::array::from_fn(|it| vec![it]));
        let of_opensim =
            labels(&["Top.Head", "R.ASIS", "L.ASIS", "V.Sacral", "R.Shoulder", "L.Shoulder", "L.Elbow", "R.Wrist"]);
        let found = sites(&of_opensim, &none, &|_| true).unwrap();
        assert_eq!((&found[0], &found[1], &found[2], &found[7]), (&vec![0], &vec![2, 1, 3], &vec![5], &vec![7]));
        let named = BTreeMap::from([("waist".to_owned(), labels(&["V.Sacral"]))]);
        assert_eq!(sites(&of_opensim, &named, &|_| true).unwrap()[1], [3]);
        let wrong = BTreeMap::from([("tail".to_owned(), labels(&["a"]))]);
        assert!(sites(&of_opensim, &wrong, &|_| true).unwrap_err().contains("`tail`"));
    }

    /// The joints of skeletons in use: a bone's name is that of the joint where it begins.
    #[test]
    fn skeletons_have_their_shoulders_where_the_arm_begins() {
        let none = BTreeMap::new();
        let check = |names: [&str; 9], prefix: &str| {
            let all: Vec<String> = names.iter().map(|it| format!("{prefix}{it}")).collect();
            let found = sites(&all, &none, &|_| true).unwrap();
            assert_eq!(found, [vec![8], vec![0], vec![2], vec![5], vec![3], vec![6], vec![4], vec![7]], "{all:?}");
        };
        let mixamo = [
            "Hips",
            "LeftShoulder",
            "LeftArm",
            "LeftForeArm",
            "LeftHand",
            "RightArm",
            "RightForeArm",
            "RightHand",
            "Head",
        ];
        check(mixamo, "");
        check(mixamo, "mixamorig:");
        check(mixamo, "mixamorig_");
        check(mixamo, "Bob:");
        let rokoko = mixamo.map(|it| match it {
            "LeftArm" => "LeftUpperArm",
            "RightArm" => "RightUpperArm",
            "Hips" => "Hip",
            it => it,
        });
        check(rokoko, "");
        check(
            ["Pelvis", "L Clavicle", "L UpperArm", "L Forearm", "L Hand", "R UpperArm", "R Forearm", "R Hand", "Head"],
            "Bip01 ",
        );
        check(["hip", "lCollar", "lShldr", "lForeArm", "lHand", "rShldr", "rForeArm", "rHand", "head"], "");
        check(
            ["hips", "shoulder.L", "upper_arm.L", "forearm.L", "hand.L", "upper_arm.R", "forearm.R", "hand.R", "head"],
            "",
        );
        // Shoulders and elbows by name, and markers on the segments between them.
        let marked = labels(&["waist", "LeftShoulder", "LeftArm", "LeftElbow", "LeftForeArm", "LeftWrist"]);
        let found = sites(&marked, &none, &|_| true).unwrap();
        assert_eq!((&found[2], &found[4], &found[6]), (&vec![1], &vec![3], &vec![5]));
        // Markers that were never there do not count.
        let hips = labels(&["LASI", "RASI", "LPSI", "RPSI"]);
        assert_eq!(sites(&hips, &none, &|it| !it.contains(&3)).unwrap()[1], [0, 1]);
        // The joint of the head is at its base, the end of its bone on top.
        assert_eq!(sites(&labels(&["Hips", "Head", "Head-end"]), &none, &|_| true).unwrap()[0], [2]);
        assert_eq!([is_left("Bob:LASI"), is_left("right_wrist"), is_left("SACR")], [Some(true), Some(false), None]);
    }
}
