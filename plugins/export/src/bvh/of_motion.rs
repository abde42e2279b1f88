//! A motion out of a file as a skeleton, where its points sit on a body.

use std::collections::BTreeMap;

use foveate::motion::Motion;
use foveate::motion::motion::Up;
use foveate::prelude::How;
use nalgebra::{Point3, Vector3};

use super::body::{Places, SITES, body};

/// Names of markers in use, without a subject's name, capitals and signs, `?` being `l` or `r` and `*` `left` or `right`: for each site the
/// alternatives, the middle of whose markers it is. From the Plug-in Gait and Helen Hayes marker sets, OpenSim's examples, BVH skeletons, and ours.
const KNOWN: [(&str, &[&[&str]]); 5] = [
    (
        "head",
        &[
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
            &["pelvis"],
            &["lasi", "rasi", "lpsi", "rpsi"],
            &["lasi", "rasi", "sacr"],
            &["lasis", "rasis", "vsacral"],
            &["lasis", "rasis"],
            &["lasi", "rasi"],
            &["sacr"],
            &["midhip"],
            &["lefthip", "righthip"],
            &["root"],
        ],
    ),
    (
        "shoulder",
        &[
            &["*shoulder"],
            &["?shoulder"],
            &["?sho"],
            &["?acr"],
            &["?acromium"],
            &["?acromion"],
            &["*arm"],
            &["shoulder?"],
        ],
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
            &["*forearm"],
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
            &["*forearmend"],
            &["wrist?"],
        ],
    ),
];

/// A name without what differs from maker to maker.
fn core(name: &str) -> String {
    let last = name.rsplit(':').next().unwrap_or(name);
    last.chars().filter(|it| it.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// The points of each of [`SITES`]; none where it has none.
///
/// `told` names them by site, as `head` or `left_wrist`; the other sites are found by names in use.
///
/// # Errors
/// A sentence: a site or a point that does not exist.
fn sites(labels: &[String], told: &BTreeMap<String, Vec<String>>) -> Result<[Vec<usize>; 8], String> {
    if let Some(wrong) = told.keys().find(|it| !SITES.contains(&it.as_str())) {
        return Err(format!("found the joint `{wrong}`, expected one of {}", SITES.join(", ")));
    }
    let cores: Vec<String> = labels.iter().map(|it| core(it)).collect();
    let mut found: [Vec<usize>; 8] = Default::default();
    for (site, points) in SITES.iter().zip(&mut found) {
        if let Some(names) = told.get(*site) {
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
        let whole = alternatives.iter().find_map(|it| it.iter().map(place).collect::<Option<Vec<usize>>>());
        *points = whole.unwrap_or_default();
    }
    Ok(found)
}

/// A skeleton in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct SkeletonFile {
    /// The BVH file.
    pub text: String,
    /// The points that joints sit on: the joint's site, and the points' names.
    pub sites: Vec<(String, Vec<String>)>,
    /// What of the motion it does not tell.
    pub lost: Vec<String>,
}

/// A BVH file of the body that the points sit on, a unit of it being `unit_m` metres. `joints` may name the points of `head`, `waist`, `left_shoulder` and the others.
///
/// # Errors
/// A sentence: what is missing for a body, or times that are not regular.
pub fn bvh(motion: &Motion, joints: &BTreeMap<String, Vec<String>>, unit_m: f64) -> Result<SkeletonFile, String> {
    let Some(rate_hz) = motion.rate_hz.or((motion.n_frames() == 1).then_some(1.0)) else {
        return Err("the times are not regular, and a skeleton moves at one rate".to_owned());
    };
    let sites = sites(&motion.labels, joints)?;
    let lacking: Vec<&str> = SITES.iter().zip(&sites).filter(|it| it.1.is_empty()).map(|it| *it.0).collect();
    if ["waist", "left_shoulder", "right_shoulder"].iter().any(|it| lacking.contains(it)) {
        let few: Vec<String> = motion.labels.iter().take(12).map(|it| format!("`{it}`")).collect();
        return Err(format!(
            "found no points for {} among {}{}, expected at least waist and both shoulders; --joints names them, as --joints waist=SACR,left_shoulder=LSHO",
            lacking.join(", "),
            few.join(", "),
            if motion.labels.len() > few.len() { ", …" } else { "" }
        ));
    }
    let mut y_up = motion.clone();
    y_up.turn(Up::Y);
    // Of several points of a site all must be there: the middle of some is another place.
    let place = |frame: usize, points: &[usize]| -> Option<Point3<f64>> {
        let mut sum = Vector3::zeros();
        for point in points {
            sum += y_up.get(frame, *point).filter(|it| it.how != How::Predicted)?.position.coords;
        }
        (!points.is_empty()).then(|| Point3::from(sum / points.len() as f64))
    };
    let frames: Vec<Places> =
        (0..y_up.n_frames()).map(|frame| std::array::from_fn(|site| place(frame, &sites[site]))).collect();
    let body = body(&frames, rate_hz, 1.0 / unit_m)?;
    let used: Vec<usize> = sites.iter().flatten().copied().collect();
    let mut lost = motion.besides.clone();
    let n_unused = (0..motion.labels.len()).filter(|it| !used.contains(it)).count();
    if n_unused > 0 {
        lost.push(format!("{n_unused} points that no joint sits on"));
    }
    if body.n_held > 0 {
        let list: Vec<_> = body.held.iter().map(|(joint, n)| format!("{joint} in {n}")).collect();
        lost.push(format!(
            "in {} of {} frames joints hold a pose since they are not seen: {}",
            body.n_held,
            frames.len(),
            list.join(", ")
        ));
    }
    if !body.absent.is_empty() {
        lost.push(format!("{}: no points for them, or never seen together", body.absent.join(", ")));
    }
    lost.push("bones have their median lengths, and how limbs turn about themselves is not known".to_owned());
    let n_filled = motion.n_of(How::Filled);
    if n_filled > 0 {
        lost.push(format!("{n_filled} samples were filled in, and now look measured"));
    }
    let names = |points: &Vec<usize>| points.iter().map(|it| motion.labels[*it].clone()).collect::<Vec<String>>();
    let sites =
        SITES.iter().zip(&sites).filter(|it| !it.1.is_empty()).map(|(site, it)| ((*site).to_owned(), names(it)));
    Ok(SkeletonFile { text: body.motion.to_bvh(), sites: sites.collect(), lost })
}

#[cfg(test)]
mod tests {
    use foveate::motion::motion::Sample;
    use foveate::scene::skeleton::SkeletonMotion;

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
            sites(&labels(&plug_in_gait.map(|it| format!("Bob:{it}")).each_ref().map(String::as_str)), &none).unwrap();
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
        assert_eq!(sites(&ours, &none).unwrap(), std::array::from_fn(|it| vec![it]));
        let of_opensim =
            labels(&["Top.Head", "R.ASIS", "L.ASIS", "V.Sacral", "R.Shoulder", "L.Shoulder", "L.Elbow", "R.Wrist"]);
        let found = sites(&of_opensim, &none).unwrap();
        assert_eq!((&found[0], &found[1], &found[2], &found[7]), (&vec![0], &vec![2, 1, 3], &vec![5], &vec![7]));
        let told = BTreeMap::from([("waist".to_owned(), labels(&["V.Sacral"]))]);
        assert_eq!(sites(&of_opensim, &told).unwrap()[1], [3]);
        let wrong = BTreeMap::from([("tail".to_owned(), labels(&["a"]))]);
        assert!(sites(&of_opensim, &wrong).unwrap_err().contains("`tail`"));
    }

    #[test]
    fn a_body_is_written_and_what_is_none_is_refused_by_what_it_lacks() {
        let place = |x: f64, z: f64| Some(Sample::at(Point3::new(0.1, x, z)));
        let motion = Motion {
            labels: labels(&["SACR", "LSHO", "RSHO", "toe"]),
            times_s: vec![0.0, 0.02],
            rate_hz: Some(50.0),
            samples: [0, 1]
                .into_iter()
                .flat_map(|_| [place(0.0, 1.0), place(0.2, 1.4), place(-0.2, 1.4), place(0.0, 0.0)])
                .collect(),
            ..Motion::default()
        };
        let file = bvh(&motion, &BTreeMap::new(), 0.01).unwrap();
        let skeleton = SkeletonMotion::from_bvh(&file.text).unwrap();
        assert_eq!((skeleton.n_frames(), skeleton.frame(0).unwrap()[1]), (2, 100.0));
        assert!(file.lost.iter().any(|it| it.contains("1 points that no joint")), "{:?}", file.lost);
        assert!(file.lost.iter().any(|it| it.contains("Neck, LeftArm")), "{:?}", file.lost);
        let legs = Motion { labels: labels(&["SACR", "LKNE", "RKNE", "toe"]), ..motion };
        let error = bvh(&legs, &BTreeMap::new(), 0.01).unwrap_err();
        assert!(error.contains("no points for head, left_shoulder, right_shoulder"), "{error}");
    }
}
