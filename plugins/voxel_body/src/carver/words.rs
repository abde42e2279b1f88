//! Remarks of a carver: a hull that is too small, silhouettes that do not fit, sets that lack cameras.

use std::collections::BTreeMap;

use foveate::prelude::*;
use nalgebra::{Point3, Vector3};

use crate::hull::{Contradiction, Dropped, Volume};

/// With a smaller mean coverage of the silhouettes there is a remark [–].
const TOO_LITTLE: f64 = 0.85;
/// A camera of whose silhouettes so much less is covered than of the median one's is named [–].
const APART: f64 = 0.04;
/// A body of fewer voxels across is said to be coarse.
const COARSE: f64 = 8.0;
/// Cameras that are farther away than so many diagonals of the volume have other units, most likely.
const FAR: f64 = 100.0;
/// A person is cut off at a picture's edge where this many of its pixels are body, over the square root of all of the body's: the width of a limb [–].
const AT_EDGE: f64 = 0.1;
/// Smallest part of the sets for that remark [–].
const OFTEN: f64 = 0.1;
/// Fewest cameras for the upright direction, of which most agree: the length of the mean of their upward directions [–].
const UPRIGHT_CAMERAS: usize = 3;
const AGREE: f64 = 0.7;
/// Fewest views for a remark that they show a body where most show none [–]: two may see something outside the volume.
const FEW: usize = 3;
/// Cosine of the angle to z from which on they stand upright in another way than bodies do [–]: 45°.
const OTHERWISE: f64 = 0.7;
/// The ends of a volume that a body may reach: its floor is none.
const ENDS: [&str; 5] = ["least x", "greatest x", "least y", "greatest y", "greatest z"];

/// Counts for remarks.
#[derive(Default)]
pub(super) struct Words {
    /// Whether every camera has to see a voxel.
    needs_all: bool,
    contradictions: BTreeMap<CameraId, Vec<Contradiction>>,
    /// Sets that were compared with their mirror images, and those of them that these fit better.
    tried_mirrored: u64,
    mirrored: u64,
    /// Sets in which two cameras had the same silhouette, byte for byte.
    same: BTreeMap<[CameraId; 2], u64>,
    /// Sets in which the camera's picture cuts a person off.
    at_edge: BTreeMap<CameraId, u64>,
    cut_off: [u64; 5],
    /// Sets in which silhouettes go on below the volume.
    below: u64,
    /// Most silhouettes in a set.
    most_views: usize,
    n_sets: u64,
    /// Sets without a voxel, although most silhouettes have a body.
    lost: u64,
    /// Sets without a voxel in which a few views show a body and most do not; by camera, those of them in which it shows nothing.
    few: u64,
    blank: BTreeMap<CameraId, u64>,
    /// The largest piece that was left out [l], and sets of which nothing else was.
    dropped_l: f64,
    all_dropped: u64,
    /// Voxels across the longest side of the largest body.
    across: f64,
}

impl Words {
    /// `needs_all`: every camera has to see a voxel.
    pub(super) fn new(needs_all: bool) -> Self {
        Self { needs_all, ..Self::default() }
    }

    pub(super) fn count(
        &mut self,
        silhouettes: &[&Silhouette],
        contradictions: &[Contradiction],
        is_mirrored: Option<bool>,
    ) {
        self.n_sets += 1;
        self.tried_mirrored += u64::from(is_mirrored.is_some());
        self.mirrored += u64::from(is_mirrored == Some(true));
        self.most_views = self.most_views.max(silhouettes.len());
        for it in contradictions {
            self.contradictions.entry(it.camera).or_default().push(*it);
        }
        let has_body = |it: &Silhouette| it.n_body > 0 && it.status != SilhouetteStatus::Full;
        for (at, a) in silhouettes.iter().enumerate().filter(|it| has_body(it.1)) {
            if self.needs_all && f64::from(n_at_edge(a)) > AT_EDGE * f64::from(a.n_body).sqrt() {
                *self.at_edge.entry(a.camera).or_default() += 1;
            }
            let same = |b: &&&Silhouette| b.n_body == a.n_body && b.width == a.width && b.confidence == a.confidence;
            for b in silhouettes[at + 1..].iter().filter(same) {
                *self.same.entry([a.camera, b.camera]).or_default() += 1;
            }
        }
    }

    /// A carved set, and what was left out of it.
    pub(super) fn see(&mut self, voxels: &Voxels, &Dropped { largest: dropped, goes_below, .. }: &Dropped) {
        self.dropped_l = self.dropped_l.max(1e3 * dropped);
        self.below += u64::from(goes_below);
        let with_body = voxels.views.iter().filter(|it| it.body_px > 0).count();
        self.all_dropped += u64::from(voxels.is_empty() && dropped > 0.0);
        self.lost += u64::from(voxels.is_empty() && dropped == 0.0 && 2 * with_body > voxels.views.len());
        if voxels.is_empty() && dropped == 0.0 && with_body >= FEW && 2 * with_body <= voxels.views.len() {
            self.few += 1;
            for it in voxels.views.iter().filter(|it| it.body_px == 0) {
                *self.blank.entry(it.camera).or_default() += 1;
            }
        }
        let reaches = |at: usize, it: &VoxelComponent| {
            let axis = if at < 4 { at / 2 } else { 2 };
            if at.is_multiple_of(2) && at < 4 {
                it.min[axis] == 0
            } else {
                u32::from(it.max[axis]) + 1 == voxels.cells[axis]
            }
        };
        for (at, count) in self.cut_off.iter_mut().enumerate() {
            *count += u64::from(voxels.components.iter().any(|it| reaches(at, it)));
        }
        if let Some(largest) = voxels.components.first() {
            let longest = (0..3).map(|axis| f64::from(largest.max[axis] - largest.min[axis]) + 1.0).fold(0.0, f64::max);
            self.across = self.across.max(longest);
        }
    }

    /// The remarks; `covered` is the mean part of the silhouettes that voxels cover, where there were any, `least` those of the cameras.
    pub(super) fn say(
        &self,
        setup: &Setup,
        volume: &Volume,
        covered: Option<f64>,
        least: &[(f64, &str)],
        report: &mut Report,
    ) {
        let name =
            |camera: &CameraId| setup.calibration.cameras.get(usize::from(camera.0)).map_or("?", |it| it.name.as_str());
        let n_cameras = setup.calibration.cameras.len();
        if n_cameras > 1 && self.most_views == 1 {
            report.remark(
                "no set has silhouettes of two or more cameras, so nothing was carved: pictures of one moment need one time. Where the numbers in their names count cameras (`{camera}.png`), \
                 `capture.images` needs `numbering = \"order\"`",
            );
        }
        for ([a, b], n) in &self.same {
            let (a, b) = (name(a), name(b));
            report.remark(format!(
                "{a} and {b}: the same silhouette, byte for byte, in {n} of {} sets: is one folder used for two cameras? (An object that looks alike from both has such silhouettes, too.)",
                self.n_sets
            ));
        }
        self.upright(setup).into_iter().for_each(|it| report.remark(it));
        let is_mirrored = 2 * self.mirrored > self.tried_mirrored;
        if is_mirrored {
            report.remark(format!(
                "silhouettes fit each other much better mirrored left to right, in {} of {} sets that were tried: expected unmirrored pictures; a body's left and right are exchanged",
                self.mirrored, self.tried_mirrored
            ));
        }
        let often = self.at_edge.iter().filter(|it| *it.1 as f64 >= OFTEN * self.n_sets as f64);
        let often: Vec<String> = often.map(|(camera, n)| format!("{} in {n}", name(camera))).collect();
        if !often.is_empty() {
            report.remark(format!(
                "a person reaches the edge of the pictures of {} of {} sets: parts outside a picture are carved away (unless `min_views` states how many cameras need to see them)",
                often.join(", "),
                self.n_sets
            ));
        }
        for (camera, list) in self.contradictions.iter().filter(|_| !is_mirrored) {
            report.remark(format!("{}: {}", name(camera), contradiction(list, self.n_sets)));
        }
        let is_cut_below = self.below as f64 >= OFTEN * self.n_sets as f64 && self.below > 0;
        let mut least = least.to_vec();
        least.sort_by(|a, b| a.0.total_cmp(&b.0));
        let median = least.get(least.len() / 2).map_or(0.0, |it| it.0);
        // What a volume cuts off is no camera's fault, nor that all are mirrored.
        let is_told =
            |it: &str| is_cut_below || is_mirrored || self.contradictions.keys().any(|camera| name(camera) == it);
        for (share, camera) in least.iter().filter(|it| it.0 < median - APART && !is_told(it.1)) {
            report.remark(format!(
                "{camera}: the voxels cover {:.0} % of its silhouettes, of the median camera's {:.0} %: it shows other objects, or its pose is slightly wrong",
                100.0 * share,
                100.0 * median
            ));
        }
        if let Some(covered) = covered.filter(|it| *it < TOO_LITTLE) {
            let worst: Vec<String> =
                least.iter().take(3).map(|(share, name)| format!("{name} {:.0} %", 100.0 * share)).collect();
            report.remark(format!(
                "the voxels cover {:.0} % of the silhouettes, expected 95 % or more (least: {}): the hull is too small where silhouettes miss parts of the body, poses are wrong, pictures are of another camera or \
                 time, or the volume ends; or silhouettes show other objects",
                100.0 * covered,
                worst.join(", ")
            ));
        }
        let ends: Vec<String> =
            ENDS.iter().zip(self.cut_off).filter(|it| it.1 > 0).map(|(end, n)| format!("its {end} in {n}")).collect();
        if !ends.is_empty() {
            let head = match self.cut_off[4] {
                0 => "",
                _ => ". A person whose head is cut off is not found: expected a top above all heads",
            };
            report.remark(format!(
                "voxels reach an end of the volume: {} of {} sets: parts beyond are not carved (`volume_m`){head}",
                ends.join(", "),
                self.n_sets
            ));
        }
        if is_cut_below {
            report.remark(format!(
                "silhouettes extend below the volume's floor, z = {:.3} m, in {} of {} sets: it cuts bodies off, and ankles are misplaced to its end; expected `volume_m` with a `min` below the feet",
                volume.min[2], self.below, self.n_sets
            ));
        }
        if self.all_dropped > 0 {
            report.remark(format!(
                "all pieces were left out in {} of {} sets; the largest has {:.3} l, expected `min_component_l` or more",
                self.all_dropped, self.n_sets, self.dropped_l
            ));
        }
        if self.across > 0.0 && self.across < COARSE {
            report.remark(format!(
                "the largest body is {} voxels long: a smaller `voxel_mm` shows its shape",
                self.across
            ));
        }
        if self.few as f64 >= OFTEN * self.n_sets as f64 && self.few > 0 {
            let blank: Vec<String> = self.blank.iter().map(|(camera, n)| format!("{} in {n}", name(camera))).collect();
            report.remark(format!(
                "no voxel remains in {} of {} sets in which {FEW} silhouettes or more show a body and most show none ({}): these have lost it, or it is outside of `volume_m`. \
                 Leave out the cameras that lost it (`each`)",
                self.few,
                self.n_sets,
                blank.join(", ")
            ));
        }
        if self.lost > 0 {
            report.remark(format!(
                "no voxel remains, although most silhouettes show a body, in {} of {} sets: {}",
                self.lost,
                self.n_sets,
                self.why_nothing(setup, volume)
            ));
        } else if self.most_views == 0 || covered.is_none() {
            self.distances(setup, volume).into_iter().for_each(|it| report.remark(it));
        }
    }

    /// Where the cameras stand upright with another axis up than z.
    fn upright(&self, setup: &Setup) -> Option<String> {
        let cameras = &setup.calibration.cameras;
        let up = cameras.iter().map(|it| it.camera.camera_from_world.rotation.inverse() * -Vector3::y());
        let mean = up.sum::<Vector3<f64>>() / cameras.len().max(1) as f64;
        if cameras.len() < UPRIGHT_CAMERAS || mean.norm() < AGREE || mean.normalize().z > OTHERWISE {
            return None;
        }
        let axis = mean.iamax();
        let sign = if mean[axis] < 0.0 { "-" } else { "" };
        let what = if mean.normalize().z < -OTHERWISE {
            "people are searched upside down"
        } else {
            "people are assumed to lie"
        };
        Some(format!(
            "the cameras' pictures are upright with {sign}{} up, but expected with z up: {what}, and shadows are not distinguished by their height; rotate the calibration (`foveate convert CALIBRATION OUT.toml --from-up {sign}{}`)",
            ["x", "y", "z"][axis],
            ["x", "y", "z"][axis]
        ))
    }

    fn why_nothing(&self, setup: &Setup, volume: &Volume) -> String {
        self.distances(setup, volume).unwrap_or_else(|| {
            "is the body in the volume (`volume_m`), and does each camera have its own pictures and pose (world to camera, not camera to world)?".to_owned()
        })
    }

    /// Where cameras stand too far away for a volume that is given in metres.
    fn distances(&self, setup: &Setup, volume: &Volume) -> Option<String> {
        let (min, max) = (Vector3::from(volume.min), Vector3::from(volume.max));
        let (middle, diagonal) = (Point3::from(0.5 * (min + max)), (max - min).norm());
        let distances = setup.calibration.cameras.iter().map(|it| (it.camera.centre() - middle).norm());
        let nearest = distances.fold(f64::INFINITY, f64::min);
        (nearest.is_finite() && nearest > FAR * diagonal).then(|| {
            format!(
                "the nearest camera is {nearest:.0} m away from a volume {diagonal:.3} m across: is the calibration in millimetres? (`length_unit = \"unknown\"` in it, then `foveate convert IN OUT --metres-per-unit 0.001`)"
            )
        })
    }
}

/// Pixels of the body on the picture's edge.
fn n_at_edge(silhouette: &Silhouette) -> u32 {
    let (width, height) = (silhouette.width as usize, silhouette.height as usize);
    if width == 0 || height == 0 {
        return 0;
    }
    let rows = [0, height - 1].into_iter().flat_map(|y| (0..width).map(move |x| (x, y)));
    let columns = [0, width - 1].into_iter().flat_map(|x| (0..height).map(move |y| (x, y)));
    rows.chain(columns).filter(|(x, y)| silhouette.is_body(*x, *y)).count() as u32
}

/// Of one camera.
fn contradiction(list: &[Contradiction], n_sets: u64) -> String {
    let mut text = format!("left out of {} of {n_sets} sets because it contradicts the others", list.len());
    if 2 * (list.len() as u64) < n_sets {
        text += " in these";
        return text;
    }
    let mut fits: Vec<_> = list.iter().filter_map(|it| Some((it.fit?.shift, it.apart))).collect();
    if 2 * fits.len() < list.len() {
        text += " and no shift explains it: pictures of another camera or time, mirrored ones, or a wrong calibration";
        return text;
    }
    fits.sort_by(|a, b| a.1[0].total_cmp(&b.1[0]));
    let ([x, y], [metres, angle]) = fits[fits.len() / 2];
    let side = |at: i32, less: &str, more: &str| format!("{} px {}", at.abs(), if at < 0 { less } else { more });
    text += &format!(
        ": its silhouettes are {} and {} of their prediction by the other views, {:.0} mm at the body or {:.1} degrees: the camera was moved, its pictures are of another time, or its pose or pictures are another camera's",
        side(x, "left", "right"),
        side(y, "above", "below"),
        1e3 * metres,
        angle.to_degrees()
    );
    text
}
