//! Writes what MultiCamSelfCal writes: `Pmatrices.dat`, and for each camera `NAME.rad` and `NAME.cal`, and `Res.dat`.
//!
//! `NAME.cal`, which readers of blue-c use, holds the centre C and the inverse of P's left half: the ray of the undistorted
//! pixel (u, v) is C + λ P⁻¹ (u, v, 1). Pixels count from 1.

use std::fmt::Write as _;

use foveate_geometry::{Camera, Distortion};

use super::optics;
use crate::calibration::{Calibration, LengthUnit, NamedCamera};
use crate::error::CalibrationError;
use crate::multi_cam_self_cal::MATRICES;

/// Names and texts of the files.
pub(crate) fn write(
    calibration: &Calibration,
    lost: &mut Vec<String>,
) -> Result<Vec<(String, String)>, CalibrationError> {
    calibration.check_file_names()?;
    let (mut files, mut matrices, mut sizes) = (Vec::new(), String::new(), String::new());
    for NamedCamera { name, camera } in &calibration.cameras {
        let Distortion { k1, k2, p1, p2, k3 } = camera.distortion;
        if k3 != 0.0 {
            let bare = Camera { distortion: Distortion { k3: 0.0, ..camera.distortion }, ..camera.clone() };
            lost.push(format!("camera {name:?}: k3 of {k3}, up to {:.3} px", optics::apart_px(camera, &bare)));
        }
        let mut counted_from_1 = camera.clone();
        counted_from_1.intrinsics.principal = camera.intrinsics.principal.map(|it| it + 1.0);
        let (k, p) = (optics::matrix(&counted_from_1.intrinsics), counted_from_1.projection_matrix());
        let Some(ray_from_pixel) = p.fixed_view::<3, 3>(0, 0).try_inverse() else {
            return Err(calibration.cannot(Some(name), "a projection without inverse", "focal lengths above 0"));
        };
        let (mut lens, mut rays) = (String::new(), String::new());
        // Writing to a String cannot fail.
        for (index, number) in camera.centre().iter().enumerate() {
            let _ = writeln!(rays, "C{} = {number:?}", index + 1);
        }
        rays.push('\n');
        for (row, column) in (0..9).map(|it| (it / 3, it % 3)) {
            let _ = writeln!(lens, "K{}{} = {:?}", row + 1, column + 1, k[(row, column)]);
            let _ = writeln!(rays, "P{}{} = {:?}", row + 1, column + 1, ray_from_pixel[(row, column)]);
        }
        lens.push('\n');
        for (index, number) in [k1, k2, p1, p2].iter().enumerate() {
            let _ = writeln!(lens, "kc{} = {number:?}", index + 1);
        }
        for row in p.row_iter() {
            let _ = writeln!(matrices, "{:e} {:e} {:e} {:e}", row[0], row[1], row[2], row[3]);
        }
        let _ = writeln!(sizes, "{} {}", camera.image_size[0], camera.image_size[1]);
        files.extend([(format!("{name}.rad"), lens), (format!("{name}.cal"), rays)]);
    }
    if calibration.length_unit == LengthUnit::Metre {
        lost.push("that lengths are in metres".to_owned());
    }
    files.extend([(MATRICES.to_owned(), matrices), ("Res.dat".to_owned(), sizes)]);
    Ok(files)
}
