//! Recalibration from an older calibration and new observations: which cameras moved, and where all cameras are now.

use foveate_estimation::{Loss, Random};
use foveate_geometry::triangulate::triangulate_rays;
use foveate_geometry::{AlignmentOptions, Camera, CameraStatus, Freedom, Ray, ResectionOptions, align, resect};
use nalgebra::{Isometry3, Point2, Point3, Similarity3, Translation3, UnitQuaternion, Vector3};

use super::cleaning::Cleaning;
use super::culprits::Repair;
use super::moments::Moment;
use super::settle::Room;
use super::{CalibrationTarget, NetworkError, NetworkOptions, SolvedNetwork, culprits, prepared, take_over};
use crate::axes::transformed;
use crate::cause::{CameraFault, Cause};
use crate::recording::Recording;
use crate::solved::{FixedFreedoms, Solved};

/// A camera that moved since the older calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct Moved {
    /// Index of the camera.
    pub camera: usize,
    /// Distance of its centre from where it was [m, or the unit of the older calibration].
    pub distance: f64,
    /// Angle between its old and new orientation [rad].
    pub angle_rad: f64,
    /// How far off its observations are under the older calibration, median [px].
    pub before_px: f64,
}

/// Observations this many times as far off as right ones may be still speak of an older calibration that needs no more than adjusting.
const OLD_LIMIT: f64 = 4.0;
/// A camera stands where it stood when so large a part of its observations agree with the others' [–].
const AGREES: f64 = 0.5;
/// A camera moved when its observations were this many times as far off as right ones are, under the older calibration.
const MOVED_SIGMAS: f64 = 4.0;
/// Right observations are never taken for better than that [px].
const LEAST_MOVED_PX: f64 = 0.25;
/// Moments by which pairs of cameras are compared.
const WITNESSES: usize = 300;
/// Of a light that a camera of the older calibration cannot see [px].
const UNSEEN_PX: f64 = 1e4;
/// Names of so many cameras are exchanged on trial [–].
const FEW: usize = 8;
/// Observations that it takes to speak of a camera.
const LEAST_OBSERVATIONS: usize = 10;

/// Adjusts the older calibration in `recording.cameras` to the recording. Scale, axes and origin stay those of the cameras
/// that did not move; `fixed` says what fixes them.
///
/// # Errors
/// See [`NetworkError`].
pub fn recalibrate(
    recording: &Recording,
    sought: CalibrationTarget<'_>,
    fixed: &FixedFreedoms,
    options: &NetworkOptions,
) -> Result<SolvedNetwork, NetworkError> {
    let (recording, cleaning, moments) = prepared(recording, sought)?;
    for it in &recording.cameras {
        it.camera.check().map_err(|fault| NetworkError::Unusable(format!("{}: {fault}", it.name)))?;
    }
    let given: Vec<Camera> = recording.cameras.iter().map(|it| it.camera.clone()).collect();
    let adjusted = |moments: Vec<Moment>, out: &[usize]| adjusted(&recording, moments, out, &cleaning, options);
    // Of few cameras, two with each other's names leave too few that agree.
    let (moments, told) = match adjusted(moments.clone(), &[]) {
        Err(NetworkError::NotThisRoom { agreeing, .. }) => {
            put_right(&recording, &moments, options, agreeing).unwrap_or((moments, Vec::new()))
        }
        _ => (moments, Vec::new()),
    };
    let (network, mut status) = adjusted(moments.clone(), &[])?;
    let again = |out: &[usize], repair: Option<culprits::Repair>| {
        let moments = repair.map_or_else(|| moments.clone(), |it| it.done_to(&moments));
        adjusted(moments, out).ok().map(|it| it.0)
    };
    let found = culprits::find(&recording, &moments, Some(network), &again);
    let Some(found) = found else { unreachable!("a room that stands stays one") };
    take_over(&mut status, &found);
    let network = found.network;
    let stayed = who_stayed(&network, &given, network.pixel_sigma().unwrap_or(options.sigma_px));
    let is_told = |camera: usize| told.iter().any(|it: &CameraFault| it.camera == camera);
    let mut culprits: Vec<CameraFault> = found.culprits.into_iter().filter(|it| !is_told(it.camera)).collect();
    culprits.extend(told);
    let (solved, sigma_px) = network.into_solved(&recording, &status, Vec::new());
    let mut solved = transformed(&solved, &stayed.given_from_found, fixed.clone());
    let mut moved = Vec::new();
    for (camera, it) in solved.cameras.iter().enumerate().filter(|it| it.1.status == CameraStatus::Calibrated) {
        if !stayed.cameras.contains(&camera) {
            let (old, new) = (&given[camera].camera_from_world, &it.camera.camera_from_world);
            moved.push(Moved {
                camera,
                distance: (given[camera].centre() - it.camera.centre()).norm(),
                angle_rad: old.rotation.angle_to(&new.rotation),
                before_px: stayed.errors_px[camera],
            });
        }
    }
    culprits.extend(explained(&moved, &given, &solved));
    solved.camera_faults = culprits;
    Ok(SolvedNetwork { solved, cleaning, held: vec![Vec::new(); given.len()], moved, sigma_px })
}

/// The room of the older calibration adjusted to `moments`, without the cameras in `out`; and what became of each camera.
fn adjusted<'a>(
    recording: &Recording,
    moments: Vec<Moment>,
    out: &[usize],
    cleaning: &[Cleaning],
    options: &'a NetworkOptions,
) -> Result<(Room<'a>, Vec<CameraStatus>), NetworkError> {
    let given: Vec<Camera> = recording.cameras.iter().map(|it| it.camera.clone()).collect();
    let mut network = Room::new(recording, moments, options);
    network.cameras = given.iter().cloned().map(Some).collect();
    let mut status = vec![CameraStatus::Calibrated; given.len()];
    for (camera, note) in cleaning.iter().enumerate() {
        // One picture shows many points with labels. Of two cameras they tell neither which one was moved nor how far apart they are.
        let moments = network.moments.iter().filter(|it| it.views.iter().any(|it| it.camera == camera)).count();
        let seen = if given.len() > 2 { moments.max(note.with_spots) } else { note.with_spots };
        if seen < LEAST_OBSERVATIONS || out.contains(&camera) {
            network.cameras[camera] = None;
            status[camera] = CameraStatus::TooFewObservations { frames: seen, needed: LEAST_OBSERVATIONS };
        }
    }
    let seeing = network.cameras.iter().flatten().count();
    if let ([a, b], true) = (&recording.cameras[..], seeing < 2) {
        let [a, b] = [&a.name, &b.name];
        return Err(NetworkError::Unusable(format!(
            "with so few pictures of {a} and {b} alone, neither which of the two moved nor their distance can be determined: measure the distance, and calibrate from nothing: \
             `--from-nothing --distance {a}:{b}=LENGTH`, as `0.35m`"
        )));
    }
    if seeing < 2 {
        let reason = |status: &CameraStatus| match status {
            CameraStatus::TooFewObservations { frames, needed } => {
                Some(format!("{frames} observations, expected at least {needed}"))
            }
            _ => None,
        };
        let named = recording.cameras.iter().zip(&status);
        let reasons = named.filter_map(|(camera, it)| Some((camera.name.clone(), reason(it)?))).collect();
        return Err(NetworkError::NothingCalibrated { reasons });
    }
    drop_strangers(&mut network, options);
    let agreeing = network.cameras.iter().flatten().count();
    if agreeing < 2 || 2 * agreeing <= seeing {
        return Err(NetworkError::NotThisRoom { agreeing, cameras: seeing });
    }
    let optics = network.freed.clone();
    network.freed.fill(Freedom::POSE);
    network.adjust(Loss::CAUCHY, false);
    place_anew(&mut network, &given, &mut status, options);
    network.freed = optics;
    network.settle(&[2.0, 1.0, 1.0]);
    Ok((network, status))
}

/// A camera stands where another pose has it when it is turned by less [rad]…
const SAME_TURN: f64 = 0.05;
/// … and off by a smaller part of the room's size [–].
const SAME_CENTRE: f64 = 0.05;

/// What those that do not stand where they stood have in common with where cameras stood: two that changed places are two names exchanged,
/// one that rolled by half is upside down. A camera of which neither is so was moved.
fn explained(moved: &[Moved], given: &[Camera], solved: &Solved) -> Vec<CameraFault> {
    let n = given.len() as f64;
    let middle = given.iter().fold(Vector3::zeros(), |sum, it| sum + it.centre().coords / n);
    let size = (given.iter().map(|it| (it.centre().coords - middle).norm_squared()).sum::<f64>() / n).sqrt();
    let is_same = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
        let centre = |it: &Isometry3<f64>| it.inverse().translation.vector;
        a.rotation.angle_to(&b.rotation) < SAME_TURN && (centre(a) - centre(b)).norm() < SAME_CENTRE * size
    };
    let old = |camera: usize| given[camera].camera_from_world;
    let new = |camera: usize| solved.cameras[camera].camera.camera_from_world;
    let half_turn = Isometry3::from_parts(
        Translation3::identity(),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI),
    );
    let cause = |it: &Moved| {
        let others = moved.iter().map(|it| it.camera).filter(|other| *other != it.camera);
        let with = others
            .into_iter()
            .find(|other| is_same(&new(it.camera), &old(*other)) && is_same(&new(*other), &old(it.camera)));
        match with {
            Some(with) => Cause::Swapped { with, since_s: None },
            None if is_same(&new(it.camera), &(half_turn * old(it.camera))) => Cause::UpsideDown,
            None => Cause::Moved { at_s: None, shift_px: it.before_px, turn: it.angle_rad, distance: it.distance },
        }
    };
    moved.iter().map(|it| CameraFault { camera: it.camera, cause: cause(it), shares: [0.0, 1.0] }).collect()
}

/// Takes the pose from one camera after the other that agrees least with the rest, until all that remain agree.
fn drop_strangers(network: &mut Room<'_>, options: &NetworkOptions) {
    loop {
        network.intersect(OLD_LIMIT * options.inlier_px);
        let mut counts = vec![(0_usize, 0_usize); network.cameras.len()];
        for moment in network.moments.iter().filter(|it| it.views.len() >= 2) {
            let known = moment.views.iter().filter(|it| it.chosen.is_some() && network.cameras[it.camera].is_some());
            if known.clone().count() >= 2 {
                known.for_each(|it| {
                    counts[it.camera].0 += usize::from(it.right);
                    counts[it.camera].1 += 1;
                });
            }
        }
        let share = |it: usize| counts[it].0 as f64 / counts[it].1.max(1) as f64;
        let known = (0..counts.len()).filter(|it| network.cameras[*it].is_some());
        match known.min_by(|a, b| share(*a).total_cmp(&share(*b))) {
            Some(worst) if share(worst) < AGREES => network.cameras[worst] = None,
            _ => return,
        }
    }
}

/// Places cameras without a pose by the points of the others.
fn place_anew(network: &mut Room<'_>, given: &[Camera], status: &mut [CameraStatus], options: &NetworkOptions) {
    let random = Random::new(options.seed).fork("recalibration");
    for camera in 0..given.len() {
        if network.cameras[camera].is_some() || status[camera] != CameraStatus::Calibrated {
            continue;
        }
        let mut pairs: (Vec<Point3<f64>>, Vec<_>) = Default::default();
        for (moment, known) in network.moments.iter().zip(&network.known).filter(|it| !it.1.held_out) {
            let own = moment.views.iter().find(|it| it.camera == camera);
            let pixel = own.and_then(|it| Some(it.spots[it.chosen?]));
            pairs.extend(known.point.zip(pixel));
        }
        let resection = ResectionOptions {
            sigma_px: options.sigma_px,
            inlier_px: 2.0 * options.inlier_px,
            ..ResectionOptions::default()
        };
        let mut draws = random.fork(&camera.to_string());
        let found = resect(&given[camera], &pairs.0, &pairs.1, &resection, |n| draws.below(n));
        let n_right = found.as_ref().map_or(0, |it| it.right.iter().filter(|it| **it).count());
        match found {
            Ok(found) if 3 * n_right >= pairs.0.len() && n_right >= LEAST_OBSERVATIONS => {
                network.cameras[camera] =
                    Some(Camera { camera_from_world: found.camera_from_world, ..given[camera].clone() });
            }
            _ => {
                let common = |other: usize| {
                    let both = network.moments.iter().filter(|it| {
                        let sees = |camera: usize| it.views.iter().any(|it| it.camera == camera);
                        sees(camera) && sees(other)
                    });
                    both.count()
                };
                let others = (0..given.len()).filter(|it| *it != camera && network.cameras[*it].is_some());
                let best = others.map(|it| (common(it), it)).max().unwrap_or_default();
                status[camera] = CameraStatus::Inconsistent { best: best.1, common: best.0, right: n_right };
            }
        }
    }
}

/// What all together have in common that few cameras agree with the older calibration: two with each other's names, or all pictures
/// mirrored. The moments with that put right, where more than before agree then and those put right do.
fn put_right(
    recording: &Recording,
    moments: &[Moment],
    options: &NetworkOptions,
    before: usize,
) -> Option<(Vec<Moment>, Vec<CameraFault>)> {
    let n = recording.cameras.len();
    let size = |camera: usize| recording.cameras[camera].camera.image_size;
    let culprit = |camera: usize, cause: Cause| CameraFault { camera, cause, shares: [0.0, 1.0] };
    let mirror = |camera: usize| Repair::Mirror { camera, width: size(camera)[0] };
    let all_mirrored = (0..n).map(|it| culprit(it, Cause::Mirrored)).collect();
    let mut tried: Vec<(Vec<Repair>, Vec<CameraFault>)> = vec![((0..n).map(mirror).collect(), all_mirrored)];
    for a in (0..n).filter(|_| n <= FEW) {
        for b in (a + 1..n).filter(|b| size(*b) == size(a)) {
            let swapped = |camera: usize, with: usize| culprit(camera, Cause::Swapped { with, since_s: None });
            let exchange = Repair::Exchange { cameras: [a, b], since_s: f64::NEG_INFINITY };
            tried.push((vec![exchange], vec![swapped(a, b), swapped(b, a)]));
        }
    }
    let agreeing = |moments: &[Moment], told: &[CameraFault]| {
        let mut network = Room::new(recording, moments.to_vec(), options);
        network.cameras = recording.cameras.iter().map(|it| Some(it.camera.clone())).collect();
        drop_strangers(&mut network, options);
        let stands = |it: &CameraFault| network.cameras[it.camera].is_some();
        let seen = |camera: usize| moments.iter().any(|it| it.views.iter().any(|it| it.camera == camera));
        let all = told.iter().all(|it| stands(it) || !seen(it.camera));
        if all { network.cameras.iter().flatten().count() } else { 0 }
    };
    let done = |repairs: &[Repair]| repairs.iter().fold(moments.to_vec(), |moments, it| it.done_to(&moments));
    let found = tried.into_iter().map(|(repairs, told)| {
        let moments = done(&repairs);
        (agreeing(&moments, &told), moments, told)
    });
    let best = found.filter(|it| it.0 > before && it.0 > 2).max_by_key(|it| it.0)?;
    Some((best.1, best.2))
}

/// Who stands where the older calibration has it, and what follows for all.
struct Stayed {
    cameras: Vec<usize>,
    given_from_found: Similarity3<f64>,
    /// By camera: how far off its right observations are under the older calibration, median [px].
    errors_px: Vec<f64>,
}

/// The largest set of cameras under whose older poses the light is seen where it was seen. Each pair of cameras proposes where the light was, by its older
/// poses alone, so that no camera that moved, and no error of the new room, pulls at it.
fn who_stayed(network: &Room<'_>, given: &[Camera], sigma_px: f64) -> Stayed {
    let members: Vec<usize> = (0..given.len()).filter(|it| network.cameras[*it].is_some()).collect();
    let found: Vec<Camera> =
        network.cameras.iter().zip(given).map(|(it, given)| it.clone().unwrap_or_else(|| given.clone())).collect();
    let limit = MOVED_SIGMAS * sigma_px.max(LEAST_MOVED_PX);
    let under = |reference: &[usize], every: usize| {
        let (errors_px, pairs) = errors_of_older(network, given, reference, every);
        let cameras: Vec<usize> = members.iter().copied().filter(|it| errors_px[*it] <= limit).collect();
        (cameras, errors_px, pairs)
    };
    let every = network.moments.len().div_ceil(WITNESSES).max(1);
    let sum = |errors: &[f64], cameras: &[usize]| cameras.iter().map(|it| errors[*it]).sum::<f64>();
    // All of them first: where nobody moved, no pair does better.
    let (mut best, errors, _) = under(&members, every);
    let mut best_sum = sum(&errors, &best);
    'pairs: for (index, first) in members.iter().enumerate() {
        for second in &members[index + 1..] {
            if best.len() == members.len() {
                break 'pairs;
            }
            let (cameras, errors, _) = under(&[*first, *second], every);
            let its_sum = sum(&errors, &cameras);
            if cameras.len() > best.len() || (cameras.len() == best.len() && its_sum < best_sum) {
                (best, best_sum) = (cameras, its_sum);
            }
        }
    }
    // Those who agree say it together, and better.
    let reference = if best.len() >= 2 { best } else { members.clone() };
    let (cameras, errors_px, pairs) = under(&reference, 1);
    let cameras = if cameras.len() >= 2 { cameras } else { members };
    let options = AlignmentOptions { scale: true, robust: true };
    let (here, there): (Vec<Point3<f64>>, Vec<Point3<f64>>) = pairs.into_iter().unzip();
    let given_from_found = match align(&here, &there, options) {
        Ok(it) if here.len() >= LEAST_OBSERVATIONS => it.b_from_a,
        _ => onto(&found, given, &reference),
    };
    Stayed { cameras, given_from_found, errors_px }
}

/// Where the light is in the room that was found, and by the older calibration.
type Pair = (Point3<f64>, Point3<f64>);

/// By camera: how far its right observations are from where the `reference` cameras alone have the light under the older calibration, median [px]; and
/// where the light is in the room that was found beside where these have it. A camera that sees none of it with two of them tells nothing.
fn errors_of_older(network: &Room<'_>, given: &[Camera], reference: &[usize], every: usize) -> (Vec<f64>, Vec<Pair>) {
    let (mut errors, mut pairs) = (vec![Vec::new(); given.len()], Vec::new());
    for (moment, known) in network.moments.iter().zip(&network.known).step_by(every) {
        let right: Vec<(usize, Point2<f64>)> = moment
            .views
            .iter()
            .filter(|it| it.right)
            .filter_map(|it| Some((it.camera, it.spots[it.chosen?])))
            .collect();
        let witnesses = right.iter().filter(|it| reference.contains(&it.0));
        let rays: Vec<Ray> = witnesses.filter_map(|(camera, pixel)| given[*camera].ray(pixel)).collect();
        let (Some(light), true) = (triangulate_rays(&rays), rays.len() >= 2) else { continue };
        pairs.extend(known.point.map(|it| (it, light)));
        for (camera, pixel) in right {
            errors[camera].push(given[camera].project(&light).map_or(UNSEEN_PX, |it| (it - pixel).norm()));
        }
    }
    (errors.iter().map(|it| foveate_estimation::statistics::median(it).unwrap_or(0.0)).collect(), pairs)
}

/// The similarity that takes the `reference` cameras from where they are found to where they were; of two cameras the
/// directions count besides the centres.
fn onto(found: &[Camera], given: &[Camera], reference: &[usize]) -> Similarity3<f64> {
    // Three points that move with a camera: its centre, and one before and one above it, as far away as the cameras are from each other.
    let spread = |cameras: &[Camera]| -> f64 {
        let middle = reference.iter().fold(Vector3::zeros(), |sum, it| sum + cameras[*it].centre().coords);
        let middle = middle / reference.len() as f64;
        reference.iter().map(|it| (cameras[*it].centre().coords - middle).norm()).fold(0.0, f64::max)
    };
    let points = |cameras: &[Camera]| -> Vec<Point3<f64>> {
        let reach = spread(cameras);
        let of_camera = |it: &usize| {
            let camera = &cameras[*it];
            let turn = camera.camera_from_world.rotation.inverse();
            let centre = camera.centre();
            [centre, centre + turn * Vector3::z() * reach, centre + turn * Vector3::y() * reach]
        };
        reference.iter().flat_map(of_camera).collect()
    };
    let options = AlignmentOptions { scale: true, robust: false };
    align(&points(found), &points(given), options).map_or_else(|_| Similarity3::identity(), |it| it.b_from_a)
}
