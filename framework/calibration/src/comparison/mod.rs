//! Comparison of a solved camera network with another calibration of the same cameras.
//!
//! The two worlds are aligned by the cameras that agree, wherever the others are: each pair of cameras proposes a similarity, from
//! their centres and their directions together, the half of the cameras that fits it best improves it (least trimmed squares), and the
//! similarity that leaves this half nearest is used. A camera that was displaced, rotated or mirrored is then far off and the others are not.

use std::collections::BTreeMap;
use std::fmt::Write;

use foveate_estimation::statistics::{Summary, median};
use foveate_geometry::{Camera, CameraStatus};
use foveate_scene::{Calibration, LengthUnit};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Similarity3, UnitQuaternion, Vector3};

use crate::solved::Solved;
use crate::words::{counted, signed};

/// With more cameras, only pairs of neighbours in the list propose [–].
const ALL_PAIRS_UP_TO: usize = 120;
/// Neighbours then [–].
const NEIGHBOURS: usize = 12;
/// Rounds of improvement [–].
const ROUNDS: usize = 4;
/// Cameras whose distances are a smaller part of how far they are from the origin stand in one place [–].
const SAME_PLACE: f64 = 1e-9;
/// Cameras that are so many times further off than the half that fits best are no part of the alignment [–].
const OFF: f64 = 4.0;
/// And by at least so much: as a part of the room's size, and as an angle [–, rad].
const OFF_AT_LEAST: f64 = 0.01;
/// The same where the half is two cameras.
const OFF_OF_FEW: f64 = 0.05;
/// Calibrations are of one room whose cameras are no more apart, as a part of the room's size and rad together, root mean square [–].
const NEAR: f64 = 0.1;
/// A mirror image, or two names exchanged, must leave cameras so many times nearer [–].
const FAR_BETTER: f64 = 4.0;
/// Names of so many cameras are exchanged on trial [–].
const FEW: usize = 12;

/// Differences of each camera between two calibrations, after alignment of the two worlds.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    names: Vec<String>,
    /// Distance of centres: in mm where the other calibration is in metres, or else in % of the room's size.
    centres: Vec<f64>,
    unit: &'static str,
    turns_mrad: Vec<f64>,
    focals_percent: Vec<f64>,
    /// Whether a camera is one of those by which the worlds are laid over each other.
    agrees: Vec<bool>,
    /// Lengths there over lengths here.
    scale: f64,
    /// Whether they are mirror images of each other; differences are then relative to the mirror image.
    is_mirrored: bool,
    /// Two cameras of which each stands where the other one stood.
    exchanged: Option<[String; 2]>,
}

/// Compares the calibrated cameras with those of the same names in `other`.
///
/// # Errors
/// Why the two cannot be aligned, in a sentence.
pub fn compare(solved: &Solved, other: &Calibration) -> Result<Comparison, String> {
    let calibrated = || solved.cameras.iter().filter(|it| it.status == CameraStatus::Calibrated);
    let (mut names, mut here, mut there): (_, Vec<Camera>, Vec<Camera>) = (Vec::new(), Vec::new(), Vec::new());
    for camera in calibrated() {
        if let Some(same) = other.camera(&camera.name) {
            names.push(camera.name.clone());
            here.push(camera.camera.clone());
            there.push(same.clone());
        }
    }
    if names.len() < 2 {
        let list = |names: Vec<&str>| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        let in_both = match &names[..] {
            [] => "no camera is in both by the same name".to_owned(),
            only => format!("only {} is in both", only[0]),
        };
        return Err(format!(
            "{in_both}, expected at least 2; here: {}; there: {}",
            list(calibrated().map(|it| it.name.as_str()).collect()),
            list(other.cameras.iter().map(|it| it.name.as_str()).collect())
        ));
    }
    let is_metric = solved.fixed.scale.is_some() && other.length_unit == LengthUnit::Metre;
    let found = lay_over(&here, &there, is_metric).ok_or_else(|| {
        format!(
            "the {} cameras in both ({}) are at one place, so the scale is undetermined",
            counted(names.len(), "camera"),
            names.join(", ")
        )
    })?;
    let mirrored = [Vector3::new(-1.0, 1.0, 1.0), Vector3::new(1.0, -1.0, 1.0)].into_iter().filter_map(|flip| {
        let here: Vec<Camera> = here.iter().map(|it| mirror_image(it, &flip)).collect();
        lay_over(&here, &there, is_metric)
    });
    let mirrored = mirrored.min_by(|a, b| a.rank.total_cmp(&b.rank));
    let mirrored = mirrored.filter(|it| names.len() > 2 && it.is_far_better_than(&found));
    // In a room that is nearly its own mirror image, exchanged names look like one.
    let exchanged = exchanged(&here, &there, &found, is_metric);
    let mirrored = mirrored.filter(|it| exchanged.as_ref().is_none_or(|(rank, _)| it.rank < *rank));
    let is_mirrored = mirrored.is_some();
    let found = mirrored.unwrap_or(found);
    let exchanged = exchanged.filter(|_| !is_mirrored).map(|(_, pair)| pair.map(|it| names[it].clone()));
    let (factor, unit) = match other.length_unit {
        LengthUnit::Metre => (1e3, "mm"),
        LengthUnit::Unknown => (100.0 / found.size, "%"),
    };
    let focal = |it: &Camera| it.intrinsics.focal[0];
    Ok(Comparison {
        names,
        centres: found.errors.iter().map(|it| factor * it.centre).collect(),
        unit,
        turns_mrad: found.errors.iter().map(|it| 1e3 * it.turn).collect(),
        focals_percent: here
            .iter()
            .zip(&there)
            .map(|(here, there)| 100.0 * (focal(here) / focal(there) - 1.0))
            .collect(),
        agrees: found.agrees,
        scale: found.there_from_here.scaling(),
        is_mirrored,
        exchanged,
    })
}

/// A camera whose pictures are mirrored across their columns or rows, in the mirror image of its world.
fn mirror_image(camera: &Camera, flip: &Vector3<f64>) -> Camera {
    let (flip, across) = (Matrix3::from_diagonal(flip), Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0)));
    let pose = &camera.camera_from_world;
    let turn = flip * pose.rotation.to_rotation_matrix().into_inner() * across;
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn));
    let camera_from_world = Isometry3::from_parts((flip * pose.translation.vector).into(), rotation);
    Camera { camera_from_world, ..camera.clone() }
}

/// The two cameras of few that have each other's names in one of the two calibrations, if that is what is between them; and the rank without that.
fn exchanged(here: &[Camera], there: &[Camera], found: &LaidOver, is_metric: bool) -> Option<(f64, [usize; 2])> {
    let n = here.len();
    if !(3..=FEW).contains(&n) || found.agrees.iter().all(|it| *it) && found.rank < NEAR {
        return None;
    }
    let pairs = (0..n).flat_map(|one| (one + 1..n).map(move |other| [one, other]));
    let tried = pairs.filter_map(|pair| {
        let mut there = there.to_vec();
        there.swap(pair[0], pair[1]);
        let found = lay_over(here, &there, is_metric)?;
        found.agrees.iter().all(|it| *it).then_some((found, pair))
    });
    let best = tried.min_by(|a, b| a.0.rank.total_cmp(&b.0.rank))?;
    best.0.is_far_better_than(found).then_some((best.0.rank, best.1))
}

/// How far a camera is off.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Apart {
    /// Distance of the centres, in the unit there.
    centre: f64,
    /// Angle between the directions [rad].
    turn: f64,
}

struct LaidOver {
    there_from_here: Similarity3<f64>,
    errors: Vec<Apart>,
    agrees: Vec<bool>,
    /// Root mean square distance of the cameras that agree from their middle, there.
    size: f64,
    /// Root mean square of how far all cameras are off, in parts of the room's size and rad together, none more than 1.
    rank: f64,
}

impl LaidOver {
    fn is_far_better_than(&self, other: &LaidOver) -> bool {
        self.rank < NEAR && FAR_BETTER * self.rank < other.rank
    }
}

/// The similarity under which the half of the cameras that fits best is nearest; `None` where all stand in one place.
fn lay_over(here: &[Camera], there: &[Camera], is_metric: bool) -> Option<LaidOver> {
    let n = here.len();
    let half = (n / 2 + 1).max(2);
    let span = if n <= ALL_PAIRS_UP_TO { n } else { NEIGHBOURS };
    let size = median_distance(there);
    let cost = |errors: &[Apart]| {
        let mut squares: Vec<f64> = errors.iter().map(|it| (it.centre / size).powi(2) + it.turn.powi(2)).collect();
        squares.sort_by(f64::total_cmp);
        squares
    };
    let mut best: Option<([f64; 2], Similarity3<f64>)> = None;
    let pairs = (0..n).flat_map(|one| (one + 1..n.min(one + 1 + span)).map(move |other| vec![one, other]));
    // Of cameras that are all right, all together tell most.
    for proposers in std::iter::once((0..n).collect::<Vec<_>>()).chain(pairs) {
        let Some(mut proposed) = similarity(here, there, &proposers) else { continue };
        for _ in 0..ROUNDS {
            let errors = errors(here, there, &proposed);
            let mut order: Vec<usize> = (0..n).collect();
            let square = |it: usize| (errors[it].centre / size).powi(2) + errors[it].turn.powi(2);
            order.sort_by(|a, b| square(*a).total_cmp(&square(*b)));
            match similarity(here, there, &order[..half]) {
                Some(better) => proposed = better,
                None => break,
            }
        }
        let squares = cost(&errors(here, there, &proposed));
        // Where two calibrations in metres leave two answers, that of equal metres is right.
        let stretched = if is_metric { proposed.scaling().ln().powi(2) } else { 0.0 };
        let rank = [squares[..half].iter().sum::<f64>() + stretched, squares.iter().map(|it| it.min(1.0)).sum::<f64>()];
        let is_better = best.as_ref().is_none_or(|(known, _)| {
            let same = (rank[0] - known[0]).abs() <= 1e-3 * known[0].max(1e-12);
            if same { rank[1] < known[1] } else { rank[0] < known[0] }
        });
        if is_better {
            best = Some((rank, proposed));
        }
    }
    let (_, mut there_from_here) = best?;
    let mut agrees = vec![true; n];
    for _ in 0..ROUNDS {
        let errors = errors(here, there, &there_from_here);
        let squares = cost(&errors);
        let typical = (squares[..half].iter().sum::<f64>() / half as f64).sqrt();
        // Two cameras agree with each other whatever they are; they anchor nothing to a hundredth.
        let at_least = if half == 2 { OFF_OF_FEW } else { OFF_AT_LEAST };
        let limit = (OFF * typical).max(at_least);
        agrees = errors.iter().map(|it| (it.centre / size).hypot(it.turn) <= limit).collect();
        let good: Vec<usize> = (0..n).filter(|it| agrees[*it]).collect();
        match similarity(here, there, &good) {
            Some(better) if good.len() >= 2 => there_from_here = better,
            _ => break,
        }
    }
    let errors = errors(here, there, &there_from_here);
    let good: Vec<Vector3<f64>> = (0..n).filter(|it| agrees[*it]).map(|it| there[it].centre().coords).collect();
    let squares = errors.iter().map(|it| ((it.centre / size).powi(2) + it.turn.powi(2)).min(1.0));
    let rank = (squares.sum::<f64>() / n as f64).sqrt();
    let middle = good.iter().sum::<Vector3<f64>>() / good.len().max(1) as f64;
    let size = (good.iter().map(|it| (it - middle).norm_squared()).sum::<f64>() / good.len().max(1) as f64).sqrt();
    Some(LaidOver { there_from_here, errors, agrees, size: if size > 0.0 { size } else { 1.0 }, rank })
}

/// The median distance of two centres.
fn median_distance(cameras: &[Camera]) -> f64 {
    let centres: Vec<Point3<f64>> = cameras.iter().map(Camera::centre).collect();
    let every = centres.len().div_ceil(ALL_PAIRS_UP_TO);
    let apart = |one: usize| {
        centres.iter().skip(one + 1).step_by(every).copied().map({
            let own = centres[one];
            move |it| (it - own).norm()
        })
    };
    let distances: Vec<f64> = (0..centres.len()).step_by(every).flat_map(apart).collect();
    median(&distances).filter(|it| *it > 0.0).unwrap_or(1.0)
}

fn errors(here: &[Camera], there: &[Camera], there_from_here: &Similarity3<f64>) -> Vec<Apart> {
    let of = |(here, there): (&Camera, &Camera)| {
        let turned = here.camera_from_world.rotation * there_from_here.isometry.rotation.inverse();
        Apart {
            centre: (there_from_here * here.centre() - there.centre()).norm(),
            turn: turned.angle_to(&there.camera_from_world.rotation),
        }
    };
    here.iter().zip(there).map(of).collect()
}

/// The similarity that takes the cameras of `of` from here to there: the rotation from their directions and from those between their centres,
/// then scale and shift from the centres. `None` where these stand in one place.
fn similarity(here: &[Camera], there: &[Camera], of: &[usize]) -> Option<Similarity3<f64>> {
    let n = of.len() as f64;
    let middle = |cameras: &[Camera]| of.iter().map(|it| cameras[*it].centre().coords).sum::<Vector3<f64>>() / n;
    let (middle_here, middle_there) = (middle(here), middle(there));
    let (mut between, mut square_here, mut square_there) = (Matrix3::zeros(), 0.0, 0.0);
    let mut turns = Matrix3::zeros();
    for it in of {
        let (a, b) = (here[*it].centre().coords - middle_here, there[*it].centre().coords - middle_there);
        between += b * a.transpose();
        square_here += a.norm_squared();
        square_there += b.norm_squared();
        let turn = there[*it].camera_from_world.rotation.inverse() * here[*it].camera_from_world.rotation;
        turns += turn.to_rotation_matrix().into_inner();
    }
    let norm = (square_here * square_there).sqrt();
    let are_apart = |square: f64, middle: &Vector3<f64>| square.sqrt() > SAME_PLACE * (middle.norm() + square.sqrt());
    if !(are_apart(square_here, &middle_here) && are_apart(square_there, &middle_there)) {
        return None;
    }
    // A direction between centres tells two of three angles, that of a camera all: weighed alike they add up to one scale.
    let svd = (turns / n + between / norm).svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = Vector3::new(1.0, 1.0, (u.determinant() * v_t.determinant()).signum());
    let rotation = u * Matrix3::from_diagonal(&sign) * v_t;
    let scale = (between.component_mul(&rotation)).sum() / square_here;
    if !(scale.is_finite() && scale > 0.0) {
        return None;
    }
    let shift = middle_there - rotation * middle_here * scale;
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Some(Similarity3::from_isometry(Isometry3::from_parts(shift.into(), rotation), scale))
}

impl Comparison {
    /// Lengths there over lengths here [–].
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// The cameras that are in both.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Whether the two are mirror images of each other.
    pub fn is_mirrored(&self) -> bool {
        self.is_mirrored
    }

    /// Two cameras that are swapped, by name.
    pub fn exchanged(&self) -> Option<&[String; 2]> {
        self.exchanged.as_ref()
    }

    /// The figures by dotted name: medians and maxima over all cameras, and each camera's own.
    pub fn figures(&self) -> BTreeMap<String, f64> {
        let mut figures = BTreeMap::new();
        let centre = if self.unit == "mm" { "compare.centre_mm" } else { "compare.centre_percent" };
        figures.insert("compare.cameras".to_owned(), self.names.len() as f64);
        figures.insert("compare.cameras_agreeing".to_owned(), self.agrees.iter().filter(|it| **it).count() as f64);
        figures.insert("compare.scale".to_owned(), self.scale);
        figures.insert("compare.mirrored".to_owned(), if self.is_mirrored { 1.0 } else { 0.0 });
        for (name, values) in [
            (centre, &self.centres),
            ("compare.turn_mrad", &self.turns_mrad),
            ("compare.focal_percent", &self.focals_percent),
        ] {
            let sizes: Vec<f64> = values.iter().map(|it| it.abs()).collect();
            let summary = Summary::of(&sizes);
            figures.insert(format!("{name}.median"), summary.map_or(f64::NAN, |it| it.median));
            figures.insert(format!("{name}.max"), sizes.iter().fold(0.0, |most, it| it.max(most)));
            figures.extend(self.names.iter().zip(values).map(|(camera, it)| (format!("{name}[{camera}]"), *it)));
        }
        figures
    }

    /// The differences as a table; `path` is that of the other calibration.
    pub fn describe(&self, path: &str) -> String {
        let width = self.names.iter().map(|it| it.chars().count()).max().unwrap_or(0).max(6);
        let mut text =
            format!("compared with {path}, after alignment (lengths there are {:.5} of those here):\n", self.scale);
        let _ = writeln!(text, "  {:width$}  {:>11}  {:>11}  {:>9}", "camera", "centre", "turn", "focal");
        for (index, name) in self.names.iter().enumerate() {
            let (centre, turn) = (self.centres[index], self.turns_mrad[index]);
            let focal = signed(self.focals_percent[index], 2);
            let mark = if self.agrees[index] { "" } else { "  stands elsewhere" };
            let _ =
                writeln!(text, "  {name:width$}  {centre:8.2} {:2}  {turn:6.2} mrad  {focal:>7} %{mark}", self.unit);
        }
        if self.is_mirrored {
            text += "  (they are mirror images of each other: the pictures of all cameras were mirrored for one of them; aligned with the mirror image)\n";
        }
        if let Some([first, second]) = &self.exchanged {
            let _ = writeln!(text, "  ({first} and {second} are swapped: their names are exchanged)");
        }
        let n_off = self.agrees.iter().filter(|it| !**it).count();
        if n_off > 0 && self.exchanged.is_none() {
            let agreeing = counted(self.names.len() - n_off, "camera");
            let _ = writeln!(text, "  (aligned by the {agreeing} that agree; cameras marked elsewhere do not count)");
        }
        if self.names.len() == 2 {
            text += "  (with two cameras, which of them is off cannot be determined)\n";
        }
        if self.unit == "%" {
            text += "  (% of the room's size: the root mean square distance of the cameras from their middle)\n";
        }
        text
    }
}

#[cfg(test)]
mod tests;
