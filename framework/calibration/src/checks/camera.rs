//! Checks of one camera: depth, coverage, covariance, and where to wave.

use foveate_estimation::statistics::{median, percentile};
use foveate_geometry::self_calibration::CameraStatus;
use nalgebra::{Unit, Vector3};

use super::maps::{Pattern, ResidualMap, map};
use super::network::Room;
use super::{CheckOptions, Judgement, Level};
use crate::solved::ObservationRole;

/// The checks of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraCheck {
    /// Level and sentence.
    pub judgement: Judgement,
    /// Name of the camera.
    pub name: String,
    /// Whether its pose was found.
    pub calibrated: bool,
    /// Numbers of its observations: in use, held out, rejected [–].
    pub observations: [usize; 3],
    /// How far away the light was; `None` without a point.
    pub depth: Option<DepthRange>,
    /// Its residuals over its picture; `None` without any.
    pub residuals: Option<ResidualMap>,
    /// Uncertainty of its pose; `None` where there is no covariance.
    pub pose: Option<PoseQuality>,
    /// Where more of the light would help most, if anywhere, such as `upper left of its picture`.
    pub wave: Option<String>,
}

/// Depths of the points that a camera used [m or units].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthRange {
    /// 5 % are nearer.
    pub nearest: f64,
    /// Half of them are nearer.
    pub median: f64,
    /// 95 % are nearer.
    pub farthest: f64,
    /// Farthest over nearest [–].
    pub ratio: f64,
}

/// Uncertainty of the pose of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseQuality {
    /// Standard deviation of the centre along its weakest direction [m or units].
    pub centre_sigma: f64,
    /// That direction, in the world.
    pub weakest: Unit<Vector3<f64>>,
    /// Standard deviation of the orientation about its weakest axis [rad].
    pub turn_sigma: f64,
    /// Of the focal length, relative; 0 where it was given [–].
    pub focal_sigma: f64,
    /// `centre_sigma` over the median depth [–].
    pub relative: f64,
}

/// Cells of a third of the picture: a cell with less than this part of an even share is empty.
const EMPTY: f64 = 0.15;
/// With so many of the nine empty, a camera saw the light hardly anywhere.
pub(super) const ALMOST_ALL: usize = 6;
/// Held-out observations are reported from this median on [px].
const CONTRADICTED_PX: f64 = 1.0;
/// Focal lengths known to this part are good, and usable [–].
const FOCAL_SIGMA: [f64; 2] = [0.01, 0.05];
const PLACES: [&str; 9] =
    ["upper left", "top", "upper right", "left edge", "middle", "right edge", "lower left", "bottom", "lower right"];

pub(super) fn camera(network: &Room<'_>, camera: usize) -> CameraCheck {
    let own = &network.solved.cameras[camera];
    let calibrated = own.status == CameraStatus::Calibrated;
    let roles = [ObservationRole::Used, ObservationRole::HeldOut, ObservationRole::Rejected];
    let of_role = |role: ObservationRole| {
        network.solved.observations.iter().filter(|it| it.camera == camera && it.role == role).count()
    };
    let (depth, residuals) = if calibrated { (depth(network, camera), map(network, camera)) } else { (None, None) };
    let pose = pose(network, camera, depth.as_ref());
    let wave = wave(network, camera, depth.as_ref());
    let mut check = CameraCheck {
        judgement: Judgement::default(),
        name: own.name.clone(),
        calibrated,
        observations: roles.map(of_role),
        depth,
        residuals,
        pose,
        wave,
    };
    check.judgement = judge(network, camera, &check);
    check
}

fn depth(network: &Room<'_>, camera: usize) -> Option<DepthRange> {
    let model = &network.solved.cameras[camera].camera;
    let depths: Vec<f64> = network.points_of(camera).iter().map(|it| (model.camera_from_world * it).z).collect();
    let at = |percent: f64| percentile(&depths, percent);
    let (nearest, farthest) = (at(5.0)?, at(95.0)?);
    Some(DepthRange { nearest, median: at(50.0)?, farthest, ratio: farthest / nearest })
}

fn pose(network: &Room<'_>, camera: usize, depth: Option<&DepthRange>) -> Option<PoseQuality> {
    let own = &network.solved.cameras[camera];
    let covariance = own.covariance.as_ref().filter(|_| own.status == CameraStatus::Calibrated)?;
    let centre = covariance.centre.symmetric_eigen();
    let weakest = centre.eigenvalues.imax();
    let centre_sigma = centre.eigenvalues[weakest].max(0.0).sqrt();
    let turn = covariance.pose.fixed_view::<3, 3>(0, 0).into_owned().symmetric_eigenvalues();
    Some(PoseQuality {
        centre_sigma,
        weakest: Unit::new_normalize(centre.eigenvectors.column(weakest).into_owned()),
        turn_sigma: turn.max().max(0.0).sqrt(),
        focal_sigma: covariance.optics.focal,
        relative: depth.map_or(f64::NAN, |it| centre_sigma / it.median),
    })
}

/// Ninths of the picture, row by row, in which a camera's observations that were not rejected are scarce.
pub(super) fn empty_ninths(network: &Room<'_>, camera: usize) -> Vec<usize> {
    let [width, height] = network.solved.cameras[camera].camera.image_size.map(f64::from);
    let mut counts = [0_usize; 9];
    let own = network.of_camera[camera].iter().map(|it| &network.solved.observations[*it]);
    for pixel in own.filter(|it| it.role != ObservationRole::Rejected).map(|it| it.pixel) {
        let third = |at: f64, of: f64| ((3.0 * (at + 0.5) / of) as usize).min(2);
        counts[3 * third(pixel.y, height) + third(pixel.x, width)] += 1;
    }
    let limit = EMPTY * counts.iter().sum::<usize>() as f64 / 9.0;
    (0..9).filter(|it| counts[*it] as f64 <= limit).collect()
}

/// The empty part of the picture, or else the depth that is missing.
fn wave(network: &Room<'_>, camera: usize, depth: Option<&DepthRange>) -> Option<String> {
    let empty = empty_ninths(network, camera);
    match empty[..] {
        [] => {
            let depth = depth.filter(|it| it.ratio < network.options.depth_ratio)?;
            Some(format!(
                "nearer to it and farther away (so far {:.1} to {:.1} {} away)",
                depth.nearest,
                depth.farthest,
                network.unit()
            ))
        }
        _ if empty.len() >= ALMOST_ALL => Some("over its whole picture".to_owned()),
        _ => {
            let names: Vec<&str> = empty.iter().take(3).map(|it| PLACES[*it]).collect();
            Some(format!("{} of its picture", names.join(" and ")))
        }
    }
}

fn judge(network: &Room<'_>, camera: usize, check: &CameraCheck) -> Judgement {
    let name = &check.name;
    let status = &network.solved.cameras[camera].status;
    if !check.calibrated {
        return Judgement::new(Level::Usable, uncalibrated(network, camera, status));
    }
    let place = check.wave.clone().unwrap_or_else(|| "in front of it, near and far".to_owned());
    let wave = format!("wave {place}");
    let Some(pose) = &check.pose else {
        return Judgement::new(
            Level::Redo,
            format!("The observations do not determine the pose of camera {name}: {wave}."),
        );
    };
    let options = network.options;
    let by_centre = CheckOptions::level(pose.relative, options.centre_sigma);
    let by_turn = CheckOptions::level(1e3 * pose.turn_sigma, options.turn_sigma_mrad);
    let by_focal = CheckOptions::level(pose.focal_sigma, FOCAL_SIGMA);
    let shallow =
        check.depth.is_some_and(|it| it.ratio < options.depth_ratio) && network.solved.cameras[camera].freed.focal;
    let level = by_centre.max(by_turn).max(by_focal).max(if shallow { Level::Usable } else { Level::Good });
    if let Some(judgement) = contradicted(network, camera).filter(|it| it.level >= level) {
        return judgement;
    }
    if level > Level::Good {
        let centre = length(pose.centre_sigma, network.unit());
        let sentence = if level == by_focal && pose.focal_sigma > 0.0 {
            format!("The focal length of camera {name} is known only to {:.1} %: {wave}.", 100.0 * pose.focal_sigma)
        } else if level > Level::Good && by_centre.max(by_turn) == level {
            format!("Camera {name} is known only to {centre} and {:.1} mrad: {wave}.", 1e3 * pose.turn_sigma)
        } else {
            let ratio = check.depth.map_or(f64::NAN, |it| it.ratio);
            format!(
                "Camera {name} saw the light at one depth ({ratio:.2} times from near to far): wave nearer to it and farther away."
            )
        };
        return Judgement::new(level, sentence);
    }
    let unconfirmed =
        network.solved.cameras[camera].clock.is_some_and(|it| it.pairs == 1) && network.calibrated().count() > 2;
    if unconfirmed {
        let sentence = format!(
            "The clock of camera {name} was found from one other camera alone, and no third confirms it: allow clocks that are further apart, or wave where it and two others see."
        );
        return Judgement::new(Level::Usable, sentence);
    }
    match check.residuals.as_ref().and_then(|it| Some((it.pattern?, it.systematic_px))) {
        Some((pattern, px)) => {
            let what = match pattern {
                Pattern::Shifted => "all point one way: its principal point is off, or it moved",
                Pattern::Scaled => "grow from the middle: its focal length is off",
                Pattern::Rolled => "rotate about the middle: it rolled during the recording",
                Pattern::Distorted => "grow fast towards the corners: have its lens distortion found",
                Pattern::Other => "have a pattern: check its lens and mount",
            };
            Judgement::new(Level::Usable, format!("Residuals of camera {name} ({px:.2} px) {what}."))
        }
        None => Judgement::new(Level::Good, format!("Camera {name} is well known.")),
    }
}

/// What is said of a camera whose observations that were held out are much farther off than those in use: its model fits what was chosen for it alone.
fn contradicted(network: &Room<'_>, camera: usize) -> Option<Judgement> {
    let residuals = |role: ObservationRole| -> Vec<f64> {
        let own = network.of_camera[camera].iter().map(|it| &network.solved.observations[*it]);
        own.filter(|it| it.role == role).filter_map(|it| Some(it.residual?.norm())).collect()
    };
    let (used, held) = (median(&residuals(ObservationRole::Used))?, median(&residuals(ObservationRole::HeldOut))?);
    let level = CheckOptions::level(held / used, network.options.hold_out_ratio);
    let name = network.name(camera);
    let n_rejected = residuals(ObservationRole::Rejected).len();
    (level > Level::Good && held > CONTRADICTED_PX).then(|| {
        Judgement::new(
            level,
            format!(
                "Observations of camera {name} are {used:.2} px off where they are used and {held:.2} px where they were held out, and {n_rejected} contradict it: its picture differs from its camera model (a keystone correction, a zoom, another picture size, another kind of lens), or it moved."
            ),
        )
    })
}

/// A length with its unit: millimetres below a metre.
pub(super) fn length(value: f64, unit: &str) -> String {
    match unit {
        "m" if value.abs() < 1.0 => format!("{:.1} mm", 1e3 * value),
        _ => format!("{value:.4} {unit}"),
    }
}

fn uncalibrated(network: &Room<'_>, camera: usize, status: &CameraStatus) -> String {
    let name = network.name(camera);
    let of = |camera: &usize| network.solved.cameras.get(*camera).map_or("?", |it| it.name.as_str());
    match status {
        CameraStatus::Calibrated => unreachable!("only cameras that are not calibrated come here"),
        CameraStatus::TooFewObservations { frames, needed } => {
            format!("Camera {name} saw the light in {frames} frames, {needed} are needed: wave longer in front of it.")
        }
        CameraStatus::LightStill { .. } => {
            format!("In camera {name} the light stays in place or on a line: wave it all over its picture.")
        }
        CameraStatus::NoPartner { best: Some(best), common, needed } => {
            format!("Camera {name} shares {common} frames with {}, {needed} are needed: wave where both see.", of(best))
        }
        CameraStatus::NoPartner { best: None, .. } => {
            format!("Camera {name} never sees the light together with another: wave where it and another see.")
        }
        // One that says so of itself had no other to be compared with, such as before a board.
        CameraStatus::Inconsistent { best, common, .. } if *common < network.options.min_common && *best != camera => {
            let partners: Vec<&str> = network.partners(camera).into_iter().take(4).map(|it| network.name(it)).collect();
            let with = match partners[..] {
                [] => "together with no other camera".to_owned(),
                _ => match partners.len() {
                    1 => format!("together with {} only", partners[0]),
                    _ => format!("together with {}, but hardly with two of them at once", partners.join(", ")),
                },
            };
            format!("Camera {name} saw the light {with}: wave where {name} and two other cameras see it at once.")
        }
        CameraStatus::Inconsistent { best, common, right } => format!(
            "No pose explains what camera {name} saw (with {}, {right} of {common} frames fit): check its lens, its mount and which camera's picture it is.",
            of(best)
        ),
        CameraStatus::ClockOpen { best } => {
            let beside = best.as_ref().map_or(String::new(), |it| format!(" relative to that of {}", of(it)));
            format!(
                "The clock of camera {name} could not be found{beside}: allow clocks that are further apart, and wave where it and others see."
            )
        }
        CameraStatus::NoDepth { best } => {
            format!(
                "Camera {name} is at the same place as {}, or the light was too far away: wave nearer to it.",
                of(best)
            )
        }
        CameraStatus::Separate { group } => {
            let others: Vec<&str> = group.iter().map(of).filter(|it| it != &name).take(4).collect();
            let with = if others.is_empty() { String::new() } else { format!(" (with {})", others.join(", ")) };
            format!("Camera {name}{with} shares too few frames with the others: wave where they both see.")
        }
        CameraStatus::FocalOpen { sigma } => {
            let known = if sigma.is_finite() { format!(" ({:.1} %)", 100.0 * sigma) } else { String::new() };
            format!(
                "The focal length of camera {name} cannot be determined{known}: wave nearer to it and farther away."
            )
        }
    }
}

/// The calibrated camera whose centre is known least, relative to its distance from the light.
pub(super) fn weakest(cameras: &[CameraCheck]) -> Option<usize> {
    let relative = |it: &usize| cameras[*it].pose.map_or(f64::NAN, |it| it.relative);
    let known = (0..cameras.len()).filter(|it| cameras[*it].calibrated && relative(it).is_finite());
    let usual = median(&known.clone().map(|it| relative(&it)).collect::<Vec<_>>())?;
    known.max_by(|a, b| relative(a).total_cmp(&relative(b))).filter(|it| relative(it) >= usual)
}
