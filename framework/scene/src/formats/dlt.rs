//! Coefficients of the direct linear transformation (Y. Abdel-Aziz, H. Karara, 1971), as easyWand and DLTdv keep them: 11 rows,
//! a column for each camera, parted by commas or blanks.
//!
//! u = (L₁X + L₂Y + L₃Z + L₄) / (L₉X + L₁₀Y + L₁₁Z + 1),  v = (L₅X + L₆Y + L₇Z + L₈) / (the same).
//!
//! That is a projection matrix without its factor. What is lost in that form: distortion, image size, names, unit, and which way
//! is forward: the sign is chosen so that the world is right-handed.

use std::path::Path;

use foveate_geometry::{Camera, Distortion};
use nalgebra::{Matrix3, Matrix3x4};

use super::{DltOrigin, ImportOptions, optics};
use crate::calibration::{Calibration, LengthUnit, NamedCamera};
use crate::error::{CalibrationDiagnostic, CalibrationError};

const COEFFICIENTS: usize = 11;
/// A world whose origin is nearer than this to a camera's own plane has no such coefficients [unit of the world].
const NEAREST: f64 = 1e-6;

/// Whether the text, which begins with `start`, holds nothing but numbers: its first line decides.
pub(crate) fn is_meant(start: &str) -> bool {
    let line = start.lines().next().unwrap_or_default();
    let mut words = words(line).peekable();
    words.peek().is_some() && words.all(|it| it.parse::<f64>().is_ok())
}

fn words(line: &str) -> impl Iterator<Item = &str> {
    line.split([',', ';', ' ', '\t']).filter(|it| !it.is_empty())
}

/// Reads the table.
pub(crate) fn load(path: &Path, text: &str, options: &ImportOptions) -> Result<Calibration, CalibrationError> {
    let fault = |line: Option<usize>, camera: Option<&str>, found: String, expected: &str| -> CalibrationError {
        let fault = CalibrationDiagnostic::of_file(path, found, expected);
        CalibrationDiagnostic { place: line.map(|it| (it + 1, 1)), camera: camera.map(str::to_owned), ..fault }.into()
    };
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for (number, line) in
        text.trim_start_matches('\u{feff}').lines().enumerate().filter(|(_, it)| !it.trim().is_empty())
    {
        let mut row = Vec::new();
        for word in words(line.trim()) {
            match word.parse::<f64>().ok().filter(|it| it.is_finite()) {
                Some(it) => row.push(it),
                None => {
                    return Err(fault(
                        Some(number),
                        None,
                        format!("{word:?} among the coefficients"),
                        "finite numbers",
                    ));
                }
            }
        }
        if rows.first().is_some_and(|first| first.len() != row.len()) {
            let found = format!("{} numbers after rows of {}", row.len(), rows[0].len());
            return Err(fault(Some(number), None, found, "a column for each camera"));
        }
        rows.push(row);
    }
    let n_cameras = rows.first().map_or(0, Vec::len);
    if rows.len() != COEFFICIENTS {
        let found = format!("{} rows of {n_cameras} numbers", rows.len());
        return Err(fault(None, None, found, "the 11 rows of DLT coefficients, a column for each camera"));
    }
    let Some(image_size) = options.image_size else {
        let expected = "one: `foveate convert --image-size W,H` says it";
        return Err(fault(None, None, "DLT coefficients, which hold no image size".into(), expected));
    };
    let mut cameras = Vec::new();
    for camera in 0..n_cameras {
        let name = format!("cam{}", camera + 1);
        let column: Vec<f64> = rows.iter().map(|row| row[camera]).chain([1.0]).collect();
        let theirs = Matrix3x4::from_row_slice(&column);
        let matrix = ours_from_theirs(options.dlt_origin, image_size) * theirs;
        match Camera::from_projection_matrix(&matrix, image_size) {
            Ok(camera) => cameras.push(NamedCamera { name, camera }),
            Err(error) => return Err(fault(None, Some(&name), error.to_string(), "the coefficients of a camera")),
        }
    }
    let way = match options.dlt_origin {
        DltOrigin::BottomLeft => "(1, 1) at the bottom left",
        DltOrigin::TopLeft => "(1, 1) at the top left",
    };
    let origin = format!("DLT coefficients {}, whose pixels were taken to have {way}", path.display());
    Calibration::new(cameras, LengthUnit::Unknown, origin).map_err(|it| it.in_file(path))
}

/// Takes homogeneous pixels of the file to ours.
fn ours_from_theirs(origin: DltOrigin, [_, rows]: [u32; 2]) -> Matrix3<f64> {
    match origin {
        DltOrigin::TopLeft => Matrix3::new(1.0, 0.0, -1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0),
        // v = rows there is row 0 here.
        DltOrigin::BottomLeft => Matrix3::new(1.0, 0.0, -1.0, 0.0, -1.0, f64::from(rows), 0.0, 0.0, 1.0),
    }
}

/// The table, pixels counted from (1, 1) at the bottom left.
pub(crate) fn write(calibration: &Calibration, lost: &mut Vec<String>) -> Result<String, CalibrationError> {
    let mut columns = Vec::new();
    for (index, NamedCamera { name, camera }) in calibration.cameras.iter().enumerate() {
        let to_ours = ours_from_theirs(DltOrigin::BottomLeft, camera.image_size);
        let Some(to_theirs) = to_ours.try_inverse() else { unreachable!("a flip and a shift can be undone") };
        let depth = camera.camera_from_world.translation.z;
        if depth.abs() < NEAREST {
            let found = "the world's origin lies in the plane through the camera's centre, across its axis";
            return Err(calibration.cannot(Some(name), found, "another origin: there, all coefficients are infinite"));
        }
        columns.push(to_theirs * camera.projection_matrix() / depth);
        if *name != format!("cam{}", index + 1) {
            lost.push(format!("the name {name:?}: column {} of the table", index + 1));
        }
        if camera.distortion != Distortion::default() {
            let bare = Camera { distortion: Distortion::default(), ..camera.clone() };
            lost.push(format!("camera {name:?}: all distortion, up to {:.3} px", optics::apart_px(camera, &bare)));
        }
    }
    lost.push("the image sizes".to_owned());
    if calibration.length_unit == LengthUnit::Metre {
        lost.push("that lengths are in metres".to_owned());
    }
    let mut text = String::new();
    for index in 0..COEFFICIENTS {
        let row: Vec<String> = columns.iter().map(|it| format!("{:?}", it[(index / 4, index % 4)])).collect();
        text += &row.join(",");
        text.push('\n');
    }
    Ok(text)
}
