//! Writes the TOML of Pose2Sim, Anipose and Caliscope; [`crate::pose2sim`] reads it.

use std::fmt::Write as _;

use foveate_geometry::{Camera, Distortion};

use super::note_ignored_skew;
use crate::calibration::{Calibration, LengthUnit, NamedCamera};
use crate::error::CalibrationError;
use crate::text::quoted;

/// `Calib.toml`, `length_unit` added to its metadata.
pub(crate) fn pose2sim(calibration: &Calibration, lost: &mut Vec<String>) -> String {
    if calibration.length_unit == LengthUnit::Unknown {
        lost.push("that the unit of lengths is unknown: Pose2Sim takes them for metres".to_owned());
    }
    sections(calibration, lost, "fisheye = false\n")
}

/// `calibration.toml`, `length_unit` added to its metadata.
pub(crate) fn anipose(calibration: &Calibration, lost: &mut Vec<String>) -> String {
    sections(calibration, lost, "")
}

fn sections(calibration: &Calibration, lost: &mut Vec<String>, at_end: &str) -> String {
    note_ignored_skew(calibration, lost);
    let mut text = String::new();
    for (index, NamedCamera { name, camera }) in calibration.cameras.iter().enumerate() {
        let turn = camera.camera_from_world.rotation.scaled_axis();
        // Writing to a String cannot fail.
        let _ = writeln!(text, "[cam_{index}]\nname = {}", quoted(name));
        let _ = writeln!(text, "{}rotation = {:?}\n{at_end}", optics(camera), turn.as_slice());
    }
    let unit = match calibration.length_unit {
        LengthUnit::Metre => "m",
        LengthUnit::Unknown => "unknown",
    };
    text + &format!("[metadata]\nadjusted = false\nerror = 0.0\nlength_unit = \"{unit}\"\n")
}

/// `camera_array.toml`.
pub(crate) fn caliscope(calibration: &Calibration, lost: &mut Vec<String>) -> Result<String, CalibrationError> {
    if calibration.length_unit == LengthUnit::Unknown {
        let expected = "metres, which Caliscope takes them for (--metres-per-unit)";
        return Err(calibration.cannot(None, "lengths of unknown unit", expected));
    }
    note_ignored_skew(calibration, lost);
    let is_number = |it: &NamedCamera| it.name.parse::<u32>().is_ok_and(|number| number.to_string() == it.name);
    let numbered = calibration.cameras.iter().all(is_number);
    let mut text = String::new();
    for (index, NamedCamera { name, camera }) in calibration.cameras.iter().enumerate() {
        let id = if numbered { name.clone() } else { index.to_string() };
        if !numbered {
            lost.push(format!("the name {name:?}: camera {id} there, which knows numbers only"));
        }
        let r = camera.camera_from_world.rotation.to_rotation_matrix();
        let rows: Vec<String> =
            r.matrix().row_iter().map(|it| format!("{:?}", it.iter().collect::<Vec<_>>())).collect();
        // Writing to a String cannot fail.
        let _ = writeln!(text, "[cameras.{id}]\ncam_id = {id}\nrotation_count = 0\nignore = false");
        let _ = writeln!(text, "{}rotation = [{}]\n", optics(camera), rows.join(", "));
    }
    Ok(text)
}

/// What all three have in common.
fn optics(camera: &Camera) -> String {
    let Camera { image_size, intrinsics, distortion, camera_from_world } = camera;
    let ([fx, fy], [cx, cy], skew) = (intrinsics.focal, intrinsics.principal, intrinsics.skew);
    let Distortion { k1, k2, p1, p2, k3 } = distortion;
    format!(
        "size = {image_size:?}\nmatrix = [[{fx:?}, {skew:?}, {cx:?}], [0.0, {fy:?}, {cy:?}], [0.0, 0.0, 1.0]]\n\
         distortions = [{k1:?}, {k2:?}, {p1:?}, {p2:?}, {k3:?}]\ntranslation = {:?}\n",
        camera_from_world.translation.vector.as_slice()
    )
}
