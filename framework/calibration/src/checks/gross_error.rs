//! Messages about cameras that contradict the rest.

use super::candidates::Candidate;
use super::network::{Room, is_calibrated};
use super::{Judgement, Level};
use crate::cause::{CameraFault, Cause};

/// Wrong observations that were left out, reported as harmless.
pub(super) fn harmless(network: &Room<'_>, camera: usize, share: f64) -> Judgement {
    let (percent, name) = (100.0 * share, network.name(camera));
    Judgement::new(
        Level::Good,
        format!(
            "{percent:.0} % of the observations of camera {name} were not the light and were left out, without harm; mask lamps and mirrors to avoid them."
        ),
    )
}

/// What is said of a camera that was found to be at fault before the room was solved without it.
pub(super) fn culprit(network: &Room<'_>, culprit: &CameraFault) -> Candidate {
    let CameraFault { camera, cause, shares } = *culprit;
    let mut told = candidate(network, camera, cause, f64::INFINITY, 1.0);
    if let Cause::FalseObservations { share } = cause {
        // Its right observations are enough, and hold it as well as the others are held.
        let is_found = is_calibrated(&network.solved.cameras[camera]);
        if is_found && shares[0] >= RIGHT_ENOUGH {
            told.judgement = harmless(network, camera, share);
        } else if share > network.options.rejected_share[1] {
            told.judgement.level = Level::Redo;
        }
    }
    told
}

/// A camera of whose observations so large a part is right is found by them [–].
const RIGHT_ENOUGH: f64 = 0.5;

/// The level and the sentence of an diagnosis.
pub(super) fn candidate(network: &Room<'_>, camera: usize, cause: Cause, misfit: f64, explained: f64) -> Candidate {
    let name = network.name(camera);
    let grave = if misfit > network.options.misfit { Level::Redo } else { Level::Usable };
    let (level, sentence) = match cause {
        Cause::Moved { at_s: Some(at_s), shift_px, turn, .. } => (
            Level::Redo,
            format!(
                "Camera {name} was moved at {at_s:.1} s ({shift_px:.1} px, {:.1} mrad): fasten it and record again.",
                1e3 * turn
            ),
        ),
        Cause::Moved { at_s: None, shift_px, turn, .. } => (
            Level::Usable,
            format!(
                "Camera {name} was moved since the older calibration ({shift_px:.1} px, {:.1} mrad): its new pose is used.",
                1e3 * turn
            ),
        ),
        Cause::Clock { offset_s, sigma_s } => {
            let which = if offset_s < 0.0 { "late" } else { "early" };
            let by = format!("{:.1} ± {:.1} ms", 1e3 * offset_s.abs(), 1e3 * sigma_s);
            (
                Level::Redo,
                format!(
                    "The clock of camera {name} is {by} {which}: synchronise it, or have each camera's clock found from the path of the light."
                ),
            )
        }
        Cause::Focal { factor } => (
            grave,
            format!(
                "The focal length of camera {name} is off by {:+.1} %: have focal lengths found, or check lens and zoom.",
                100.0 * (factor - 1.0)
            ),
        ),
        Cause::Distortion { k1 } => (
            grave,
            format!("The lens of camera {name} differs from its model (k1 {k1:+.3}): have its lens distortion found."),
        ),
        Cause::PixelShape { factor } => (
            grave,
            format!(
                "The pixel aspect of camera {name} is {:+.1} % off: state pixel_aspect, or check how its picture is scaled.",
                100.0 * (factor - 1.0)
            ),
        ),
        Cause::Swapped { with, since_s } => {
            let (first, second) = (network.name(camera.min(with)), network.name(camera.max(with)));
            let since = since_s.map_or(String::new(), |it| format!(" since {it:.1} s"));
            let solved = since_s.map_or("", |_| " (the calibration was solved with their rows corrected)");
            (
                Level::Redo,
                format!(
                    "Cameras {first} and {second} are swapped{since}: swap their names or cables, and record again{solved}."
                ),
            )
        }
        Cause::Mirrored => {
            (Level::Redo, format!("The picture of camera {name} is mirrored, left to right: record it as it is."))
        }
        Cause::UpsideDown => (
            Level::Redo,
            format!("The picture of camera {name} is upside down: rotate the camera or its picture by 180 degrees."),
        ),
        Cause::FalseObservations { share } => (
            Level::Usable,
            format!(
                "{:.0} % of the observations of camera {name} are not the light: mask lamps and mirrors in its picture.",
                100.0 * share
            ),
        ),
        Cause::FewObservations { count, median } => (
            Level::Usable,
            format!("Camera {name} saw the light {count} times, others {median} times: wave longer in front of it."),
        ),
        Cause::FewCommon { .. } => unreachable!("its sentence is that of its status"),
        Cause::Unknown { size } if !misfit.is_finite() => (
            Level::Redo,
            format!(
                "No pose explains {:.0} % of the observations of camera {name}: check its lens, mount and clock, and that the pictures are its own.",
                100.0 * size
            ),
        ),
        Cause::Unknown { .. } => {
            let level = if misfit > 2.0 * network.options.misfit { Level::Redo } else { Level::Usable };
            let sentence = format!(
                "Camera {name} fits the others {misfit:.1} times worse than usual: check its focus, mount and lens."
            );
            (level, sentence)
        }
    };
    Candidate { judgement: Judgement::new(level, sentence), camera, cause, misfit, explained }
}
