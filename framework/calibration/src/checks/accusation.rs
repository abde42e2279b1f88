//! What is said of a camera that contradicts the rest.

use super::room::Room;
use super::suspects::{Cause, Suspect};
use super::{Judgement, Level};

/// Wrong sightings that were left out, told without blame.
pub(super) fn harmless(room: &Room<'_>, camera: usize, share: f64) -> Judgement {
    let (percent, name) = (100.0 * room.left_out_share(camera).unwrap_or(share), room.name(camera));
    Judgement::new(
        Level::Good,
        format!(
            "{percent:.0} % of what camera {name} saw was not the light and was left out: it did no harm; masking lamps and mirrors avoids it."
        ),
    )
}

/// The level and the sentence of an accusation.
pub(super) fn suspect(room: &Room<'_>, camera: usize, cause: Cause, misfit: f64, explained: f64) -> Suspect {
    let name = room.name(camera);
    let grave = if misfit > room.rules.misfit { Level::Redo } else { Level::Usable };
    let (level, sentence) = match cause {
        Cause::Moved { at_s, shift_px, turn, .. } => (
            Level::Redo,
            format!(
                "Camera {name} was moved at {at_s:.1} s ({shift_px:.1} px, {:.1} mrad): fasten it and record again.",
                1e3 * turn
            ),
        ),
        Cause::Clock { offset_s, sigma_s } => (
            grave,
            format!(
                "The clock of camera {name} is off by {:+.1} ± {:.1} ms: synchronise it, or have clocks found (--from-nothing --unsynchronised).",
                1e3 * offset_s,
                1e3 * sigma_s
            ),
        ),
        Cause::Focal { factor } => (
            grave,
            format!(
                "The focal length of camera {name} is off by {:+.1} %: let it be found (--optics focal), or check lens and zoom.",
                100.0 * (factor - 1.0)
            ),
        ),
        Cause::Distortion { k1 } => (
            grave,
            format!(
                "The lens of camera {name} distorts otherwise than its model (k1 {k1:+.3}): let it be found (--optics lens)."
            ),
        ),
        Cause::Swapped { with } => {
            let (first, second) = (room.name(camera.min(with)), room.name(camera.max(with)));
            (Level::Redo, format!("Cameras {first} and {second} are swapped: exchange their names or cables."))
        }
        Cause::Mirrored => {
            (Level::Redo, format!("The picture of camera {name} is mirrored, left to right: record it as it is."))
        }
        Cause::WrongSightings { share } => (
            Level::Usable,
            format!(
                "{:.0} % of what camera {name} saw is not the light: mask lamps and mirrors in its picture.",
                100.0 * room.left_out_share(camera).filter(|it| *it > 0.5 * share).unwrap_or(share)
            ),
        ),
        Cause::FewSightings { count, median } => (
            Level::Usable,
            format!("Camera {name} saw the light {count} times, others {median} times: wave longer in front of it."),
        ),
        Cause::Unknown => {
            let level = if misfit > 2.0 * room.rules.misfit { Level::Redo } else { Level::Usable };
            let sentence = format!(
                "Camera {name} fits the others {misfit:.1} times worse than usual: check its focus, mount and lens."
            );
            (level, sentence)
        }
    };
    Suspect { judgement: Judgement::new(level, sentence), camera, cause, misfit, explained }
}
