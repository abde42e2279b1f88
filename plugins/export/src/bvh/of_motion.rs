//! A motion file as a skeleton, where its points are on a body.

use std::collections::BTreeMap;

use foveate::motion::Motion;
use foveate::motion::forms::start_lost;
use foveate::motion::motion::Up;
use foveate::prelude::Provenance;
use nalgebra::{Point3, Vector3};

use super::body::{Places, SITES, body};
use super::guess::guess;
use super::names::{is_left, sites};
use super::proportions::{All, FRAMES, Limits, PART_FACTOR, SIDE_FACTOR, STRETCH, objections};

/// A skeleton in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct SkeletonFile {
    /// The BVH file.
    pub text: String,
    /// The points of each joint: its site, and the names of the points.
    pub sites: Vec<(String, Vec<String>)>,
    /// Parts of the motion that the file does not hold.
    pub lost: Vec<String>,
}

/// Options of a skeleton.
#[derive(Debug, Clone, PartialEq)]
pub struct SkeletonOptions {
    /// The points of `head`, `waist`, `left_shoulder` and the others; sites without an entry are found by common names.
    pub joints: BTreeMap<String, Vec<String>>,
    /// Length of the file's unit [m].
    pub unit_m: f64,
    /// Whether it is written even though the points' distances are not those of a body.
    pub any_proportions: bool,
}

/// A BVH file of the body that the points are on.
///
/// # Errors
/// A sentence: what is missing for a body, why the points are no body, and a proposal of points that are one; or irregular times.
pub fn bvh(motion: &Motion, options: &SkeletonOptions) -> Result<SkeletonFile, String> {
    let Some(rate_hz) = motion.rate_hz.or((motion.n_frames() == 1).then_some(1.0)) else {
        return Err("found irregular times, expected one frame rate for a skeleton".to_owned());
    };
    let mut y_up = motion.clone();
    y_up.turn(Up::Y);
    let is_seen = |points: &[usize]| {
        let is_there = |frame: usize, point: &usize| {
            y_up.get(frame, *point).is_some_and(|it| it.provenance != Provenance::Predicted)
        };
        (0..y_up.n_frames()).any(|frame| points.iter().all(|it| is_there(frame, it)))
    };
    let sites = sites(&motion.labels, &options.joints, &is_seen)?;
    let lacking: Vec<&str> = SITES.iter().zip(&sites).filter(|it| it.1.is_empty()).map(|it| *it.0).collect();
    if ["waist", "left_shoulder", "right_shoulder"].iter().any(|it| lacking.contains(it)) {
        let few: Vec<String> = motion.labels.iter().take(12).map(|it| format!("`{it}`")).collect();
        return Err(format!(
            "found no points for {} among {}{}, expected at least waist and both shoulders; --joints names them, as --joints waist=SACR,left_shoulder=LSHO{}",
            lacking.join(", "),
            few.join(", "),
            if motion.labels.len() > few.len() { ", …" } else { "" },
            likely(&y_up, rate_hz).map_or(String::new(), |it| format!("; {}", it.words))
        ));
    }
    // Of several points of a site all must be there: the middle of some is another place.
    let place = |frame: usize, points: &[usize]| -> Option<Point3<f64>> {
        let mut sum = Vector3::zeros();
        for point in points {
            sum += y_up.get(frame, *point).filter(|it| it.provenance != Provenance::Predicted)?.position.coords;
        }
        (!points.is_empty()).then(|| Point3::from(sum / points.len() as f64))
    };
    let frames: Vec<Places> =
        (0..y_up.n_frames()).map(|frame| std::array::from_fn(|site| place(frame, &sites[site]))).collect();
    let names = |points: &Vec<usize>| points.iter().map(|it| motion.labels[*it].clone()).collect::<Vec<String>>();
    let called = |site: usize| format!("{} = {}", SITES[site], names(&sites[site]).join("+"));
    // Where waist and shoulders are never seen together, other points are no better.
    let is_together = |it: &Places| it[1..4].iter().all(Option::is_some);
    let others = || if frames.iter().any(is_together) { likely(&y_up, rate_hz) } else { None };
    let made = body(&frames, rate_hz, 1.0 / options.unit_m).and_then(|body| {
        let against = if options.any_proportions { Vec::new() } else { objections(&frames, &called, &LIMITS) };
        match against.is_empty() {
            true => Ok(body),
            false => Err(format!("these points cannot be a body: {}", against.join("; "))),
        }
    });
    let body = made.map_err(|why| match others() {
        None => format!("{why}; name others with --joints, or write it anyway with --any-proportions"),
        Some(it) if sites.iter().zip(it.points).all(|(site, point)| *site == [point]) => {
            format!("{why}; no other points fit better; --any-proportions writes it anyway")
        }
        Some(it) => format!("{why}; {}", it.words),
    })?;
    let used: Vec<usize> = sites.iter().flatten().copied().collect();
    let mut lost = motion.besides.clone();
    let n_unused = (0..motion.labels.len()).filter(|it| !used.contains(it)).count();
    if n_unused > 0 {
        lost.push(format!("{n_unused} points that belong to no joint"));
    }
    if body.n_held > 0 {
        let list: Vec<_> = body.held.iter().map(|(joint, n)| format!("{joint} in {n}")).collect();
        lost.push(format!(
            "in {} of {} frames unseen joints keep a pose: {}",
            body.n_held,
            frames.len(),
            list.join(", ")
        ));
    }
    if !body.absent.is_empty() {
        lost.push(format!("{}: no points for them, or never seen together", body.absent.join(", ")));
    }
    lost.push("bones have their median lengths, and the rotation of limbs about their own axes is unknown".to_owned());
    let n_filled = motion.n_of(Provenance::Filled);
    if n_filled > 0 {
        lost.push(format!("{n_filled} samples were filled in, which the file does not mark"));
    }
    if motion.start_s() != 0.0 {
        lost.push(start_lost(motion));
    }
    let sites =
        SITES.iter().zip(&sites).filter(|it| !it.1.is_empty()).map(|(site, it)| ((*site).to_owned(), names(it)));
    Ok(SkeletonFile { text: body.motion.to_bvh(), sites: sites.collect(), lost })
}

/// The defaults of `export.bvh`. A file's unit may be wrong, and people crawl: stature and posture are not checked where names identify the points.
const LIMITS: Limits = Limits {
    factor: PART_FACTOR,
    side_factor: SIDE_FACTOR,
    stretch: STRETCH,
    unit_m: Some(1.0),
    checks_standing: false,
};
/// For guesses: a body that mostly stands, of a stature between a child's and the tallest man's.
const STANDING: Limits = Limits { checks_standing: true, ..LIMITS };

/// Points that can be a body.
struct Likely {
    /// In the order of [`SITES`].
    points: [usize; 8],
    words: String,
}

/// The points, y up, that are most like a body; `None` without any.
fn likely(y_up: &Motion, rate_hz: f64) -> Option<Likely> {
    let labels = &y_up.labels;
    let place = |frame: usize, point: usize| {
        y_up.get(frame, point).filter(|it| it.provenance != Provenance::Predicted).map(|it| it.position)
    };
    let step = y_up.n_frames().div_ceil(FRAMES).max(1);
    let frames: Vec<All> = (0..y_up.n_frames())
        .step_by(step)
        .map(|frame| (0..labels.len()).map(|point| place(frame, point)).collect())
        .collect();
    let guess = guess(&frames, STANDING.unit_m, |it| is_left(&labels[it]))?;
    let points = guess.targets;
    let places: Vec<Places> = frames.iter().map(|frame| points.map(|it| frame[it])).collect();
    let called = |site: usize| format!("{}={}", SITES[site], labels[points[site]]);
    if body(&places, rate_hz, 1.0).is_err() || !objections(&places, &called, &STANDING).is_empty() {
        return None;
    }
    let sides = if guess.knows_sides {
        ""
    } else {
        " (left and right may be exchanged: the movements do not distinguish them)"
    };
    let list = (0..SITES.len()).map(called).collect::<Vec<_>>().join(",");
    Some(Likely { points, words: format!("by distances and movements the best match is{sides}: --joints '{list}'") })
}

#[cfg(test)]
mod tests {
    use foveate::motion::motion::Sample;
    use foveate::scene::skeleton::SkeletonMotion;

    use super::*;

    const USUAL: SkeletonOptions = SkeletonOptions { joints: BTreeMap::new(), unit_m: 0.01, any_proportions: false };

    fn labels(all: &[&str]) -> Vec<String> {
        all.iter().map(|it| (*it).to_owned()).collect()
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
        let file = bvh(&motion, &USUAL).unwrap();
        let skeleton = SkeletonMotion::from_bvh(&file.text).unwrap();
        assert_eq!((skeleton.n_frames(), skeleton.frame(0).unwrap()[1]), (2, 100.0));
        assert!(file.lost.iter().any(|it| it.starts_with("1 points")), "{:?}", file.lost);
        assert!(file.lost.iter().any(|it| it.contains("Neck, LeftArm")), "{:?}", file.lost);
        let legs = Motion { labels: labels(&["SACR", "LKNE", "RKNE", "toe"]), ..motion };
        let error = bvh(&legs, &USUAL).unwrap_err();
        assert!(error.contains("no points for head, left_shoulder, right_shoulder"), "{error}");
    }

    /// A body that walks along x and swings its arms; z up.
    fn walker() -> Motion {
        let rest = [
            [0.0, 0.0, 1.75],
            [0.0, 0.0, 1.0],
            [0.0, 0.2, 1.45],
            [0.0, -0.2, 1.45],
            [-0.05, 0.25, 1.15],
            [-0.05, -0.25, 1.15],
            [0.1, 0.27, 0.93],
            [0.1, -0.27, 0.93],
        ];
        let place = |frame: usize, site: usize| {
            let [x, y, z] = rest[site];
            let t = frame as f64 / 50.0;
            let swing = if site < 4 { 0.0 } else { 0.05 * (6.0 * t + 3.0 * (site % 2) as f64).sin() };
            Some(Sample::at(Point3::new(x + 1.3 * t + swing, y, z)))
        };
        Motion {
            labels: labels(&SITES),
            times_s: (0..200).map(|it| f64::from(it) / 50.0 + 3.0).collect(),
            rate_hz: Some(50.0),
            samples: (0..1600).map(|it| place(it / 8, it % 8)).collect(),
            ..Motion::default()
        }
    }

    #[test]
    fn points_that_cannot_be_a_body_are_refused_with_those_that_can() {
        let good = bvh(&walker(), &USUAL).unwrap();
        assert!(good.lost.iter().any(|it| it.contains("the first frame is at 3.000000 s")), "{:?}", good.lost);
        let mut wrong = walker();
        wrong.labels.swap(0, 6);
        wrong.labels.swap(2, 5);
        let error = bvh(&wrong, &USUAL).unwrap_err();
        assert!(error.contains("cannot be a body: ") && error.contains("left_shoulder = left_shoulder"), "{error}");
        let proposed = "--joints 'head=left_wrist,waist=waist,left_shoulder=right_elbow,right_shoulder=right_shoulder,\
                    left_elbow=left_elbow,right_elbow=left_shoulder,left_wrist=head,right_wrist=right_wrist'";
        assert!(error.contains(proposed), "{error}");
        let pairs = proposed["--joints '".len()..proposed.len() - 1].split(',').map(|it| it.split_once('=').unwrap());
        let joints = pairs.map(|it| (it.0.to_owned(), vec![it.1.to_owned()])).collect();
        assert!(bvh(&wrong, &SkeletonOptions { joints, ..USUAL }).is_ok());
        assert!(bvh(&wrong, &SkeletonOptions { any_proportions: true, ..USUAL }).is_ok());
        // Names that say nothing.
        let nameless = Motion { labels: (0..8).map(|it| format!("P{it}")).collect(), ..walker() };
        let error = bvh(&nameless, &USUAL).unwrap_err();
        assert!(error.contains("--joints 'head=P0,waist=P1,left_shoulder=P2"), "{error}");
        // Of any size, for units are wrong in many files, and on its hands.
        let mut small = walker();
        for it in small.samples.iter_mut().flatten() {
            it.position = Point3::new(0.1 * it.position.x, -0.1 * it.position.y, -0.1 * it.position.z);
        }
        assert!(bvh(&small, &USUAL).is_ok());
    }
}
