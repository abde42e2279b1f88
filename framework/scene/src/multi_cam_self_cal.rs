//! Reads the results of MultiCamSelfCal (T. Svoboda, D. Martinec, T. Pajdla, "A convenient multicamera self-calibration for
//! virtual environments", Presence 14(4), 2005).
//!
//! | file | what is in it |
//! |---|---|
//! | `Pmatrices.dat` | 3n × 4: for each camera P, undistorted pixel ~ P (X, Y, Z, 1) |
//! | `NAME.rad` | K11 … K33 and kc1 … kc4 = k₁, k₂, p₁, p₂ of the lens; the k-th in order of names is the k-th camera |
//! | `Res.dat` | n × 2: columns and rows of the images |
//! | `camK.points4cal.dat` | optional; rows X Y Z 1 u v 1: points and the raw, distorted pixels that saw them |
//!
//! Its model: pixel = K_rad distort(K_rad⁻¹ P X). What differs from ours:
//!
//! - Pixels there count from 1. Principal points are moved by −1 px on the way in.
//! - P has a calibration matrix of its own, off K_rad by several percent and tens of pixels, so that the model is
//!   not a pinhole behind one Brown–Conrady lens. `shared_lens` finds the camera of ours that comes closest; how close
//!   is stated in the origin. On a real result (4 cameras, 640 × 480, a test measures it) that is 0.06 px in the worst
//!   corner and 0.01 px or less where half of the points were; the result itself reprojects with a median of 0.3 px.
//! - Depths are positive by P as written, but the frame may be left-handed: then det of P's left half is negative. Such
//!   a world is turned right-handed by negating its Z, which the origin says too.

use std::fs;
use std::path::Path;

use foveate_geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Matrix3x4, Vector4};

use crate::calibration::{Calibration, LengthUnit, NamedCamera};
use crate::error::{CalibrationDiagnostic, CalibrationError};
use crate::natural_order::natural_order;
use crate::shared_lens;
use crate::text::read_text;

/// The file that makes a folder one of MultiCamSelfCal.
pub(crate) const MATRICES: &str = "Pmatrices.dat";

/// Reads the folder.
pub(crate) fn load(folder: &Path) -> Result<Calibration, CalibrationError> {
    let matrices_file = folder.join(MATRICES);
    if !matrices_file.is_file() {
        let found = format!("a folder without {MATRICES}");
        return Err(CalibrationDiagnostic::of_file(folder, found, "a TOML file, or a folder of MultiCamSelfCal").into());
    }
    let mut faults = Vec::new();
    let matrices = keep(table::<4>(&matrices_file), &mut faults).unwrap_or_default();
    let sizes_file = folder.join("Res.dat");
    let sizes = keep(table::<2>(&sizes_file), &mut faults).unwrap_or_default();
    let names = keep(lens_names(folder).map_err(|fault| vec![fault]), &mut faults).unwrap_or_default();
    if faults.is_empty() {
        let count = names.len();
        for (file, rows, per_camera) in [(&matrices_file, matrices.len(), 3), (&sizes_file, sizes.len(), 1)] {
            if rows != per_camera * count {
                let expected = format!("{} rows for the {count} .rad files", per_camera * count);
                faults.push(CalibrationDiagnostic::of_file(file, format!("has {rows} rows"), expected));
            }
        }
    }
    if !faults.is_empty() {
        return Err(CalibrationError { faults });
    }
    let mut models = Vec::new();
    for (index, name) in names.iter().enumerate() {
        let named = |fault: CalibrationDiagnostic| CalibrationDiagnostic { camera: Some(name.clone()), ..fault };
        let rows = &matrices[3 * index..3 * index + 3];
        let lens = lens(&folder.join(format!("{name}.rad")), sizes[index])
            .map_err(|list| list.into_iter().map(named).collect::<Vec<_>>());
        let lens = keep(lens, &mut faults);
        let matrix = Matrix3x4::from_fn(|row, column| rows[row][column]);
        let points_file = folder.join(format!("cam{}.points4cal.dat", index + 1));
        let points = if points_file.is_file() { keep(table::<7>(&points_file), &mut faults) } else { Some(Vec::new()) };
        if let (Some(lens), Some(points)) = (lens, points) {
            models.push((name, lens, in_front(&matrix, &points)));
        }
    }
    let mirrored = |matrix: &Matrix3x4<f64>| matrix.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
    let left_handed = models.first().is_some_and(|(_, _, first)| mirrored(first));
    let mut cameras = Vec::new();
    let mut worst = 0.0;
    for (name, lens, mut matrix) in models {
        let mut report = |found: String, expected: &str| {
            let fault = CalibrationDiagnostic::of_file(&matrices_file, found, expected);
            faults.push(CalibrationDiagnostic { camera: Some(name.clone()), ..fault });
        };
        if mirrored(&matrix) != left_handed {
            report("a projection of the other handedness than the first camera's".into(), "the same for all cameras");
            continue;
        }
        if left_handed {
            matrix.column_mut(2).neg_mut();
        }
        let pinhole = match Camera::from_projection_matrix(&matrix, lens.image_size) {
            Ok(pinhole) => pinhole,
            Err(fault) => {
                report(fault.to_string(), "the projection of a camera");
                continue;
            }
        };
        let Some((mut camera, error)) = shared_lens::fit(&lens, &pinhole) else {
            report("no camera reproduces the lens and the projection together".into(), "a lens that fits them");
            continue;
        };
        worst = f64::max(worst, error);
        camera.intrinsics.principal = camera.intrinsics.principal.map(|it| it - 1.0);
        cameras.push(NamedCamera { name: name.clone(), camera });
    }
    if !faults.is_empty() {
        return Err(CalibrationError { faults });
    }
    let mirror = if left_handed { "; its left-handed world made right-handed by negating Z" } else { "" };
    let origin = format!(
        "MultiCamSelfCal result in {}; principal points moved by -1 px, since its pixels count from 1{mirror}; \
         its lens model is reproduced to {worst:.3} px",
        folder.display()
    );
    Calibration::new(cameras, LengthUnit::Unknown, origin)
}

fn keep<T>(result: Result<T, Vec<CalibrationDiagnostic>>, faults: &mut Vec<CalibrationDiagnostic>) -> Option<T> {
    result.map_err(|list| faults.extend(list)).ok()
}

/// Names of the `.rad` files, without the ending, in natural order.
fn lens_names(folder: &Path) -> Result<Vec<String>, CalibrationDiagnostic> {
    let unreadable =
        |error: std::io::Error| CalibrationDiagnostic::of_file(folder, format!("cannot be read ({error})"), "a folder");
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let file = entry.map_err(unreadable)?.file_name();
        names.extend(file.to_str().and_then(|it| it.strip_suffix(".rad")).map(str::to_owned));
    }
    names.sort_by(|a, b| natural_order(a, b));
    match names.is_empty() {
        true => Err(CalibrationDiagnostic::of_file(folder, "a folder without .rad files", "one for each camera")),
        false => Ok(names),
    }
}

/// The lens alone, as a camera at the origin; pixels count from 1.
fn lens(path: &Path, size: [f64; 2]) -> Result<Camera, Vec<CalibrationDiagnostic>> {
    let text = read_text(path).map_err(|fault| vec![fault])?;
    let mut faults = Vec::new();
    let mut report = |found: String, expected: &str| faults.push(CalibrationDiagnostic::of_file(path, found, expected));
    let mut value_of = |key: &str| {
        let line = text.lines().find_map(|line| line.split_once('=').filter(|(name, _)| name.trim() == key));
        let value = line.and_then(|(_, value)| value.trim().parse::<f64>().ok()).filter(|it| it.is_finite());
        if value.is_none() {
            report(line.map_or(format!("{key} is missing"), |it| format!("{key} is{}", it.1)), "a finite number");
        }
        value.unwrap_or(0.0)
    };
    let [k11, k12, k13, k21, k22, k23, k31, k32, k33] =
        ["K11", "K12", "K13", "K21", "K22", "K23", "K31", "K32", "K33"].map(&mut value_of);
    let [k1, k2, p1, p2] = ["kc1", "kc2", "kc3", "kc4"].map(&mut value_of);
    if faults.is_empty() && ([k21, k31, k32] != [0.0; 3] || k33 != 1.0 || k11 <= 0.0 || k22 <= 0.0) {
        let found = format!("K21, K31, K32, K33 are {k21}, {k31}, {k32}, {k33}; K11, K22 are {k11}, {k22}");
        faults.push(CalibrationDiagnostic::of_file(path, found, "0, 0, 0, 1, and K11, K22 above 0"));
    }
    if !size.iter().all(|it| it.fract() == 0.0 && (1.0..=65535.0).contains(it)) {
        let found = format!("the image in Res.dat has {} x {} px", size[0], size[1]);
        faults.push(CalibrationDiagnostic::of_file(path, found, "whole numbers from 1 to 65535"));
    }
    let lens = Camera {
        image_size: size.map(|it| it as u32),
        intrinsics: Intrinsics { focal: [k11, k22], principal: [k13, k23], skew: k12 },
        distortion: Distortion { k1, k2, p1, p2, k3: 0.0 },
        camera_from_world: Default::default(),
    };
    if faults.is_empty() { Ok(lens) } else { Err(faults) }
}

/// `matrix` with the sign that puts most of `points` in front; as it is when there are none.
fn in_front(matrix: &Matrix3x4<f64>, points: &[[f64; 7]]) -> Matrix3x4<f64> {
    let behind = points.iter().filter(|row| (matrix.row(2) * Vector4::from_column_slice(&row[..4])).x < 0.0).count();
    if 2 * behind > points.len() { -matrix } else { *matrix }
}

/// Rows of `N` numbers parted by blanks, as MATLAB saves them in text form.
fn table<const N: usize>(path: &Path) -> Result<Vec<[f64; N]>, Vec<CalibrationDiagnostic>> {
    let text = read_text(path).map_err(|fault| vec![fault])?;
    let (mut rows, mut faults) = (Vec::new(), Vec::new());
    for (index, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let numbers: Option<Vec<f64>> = line.split_whitespace().map(|it| it.parse().ok()).collect();
        let row = numbers.filter(|list| list.iter().all(|it| it.is_finite())).and_then(|it| it.try_into().ok());
        match row {
            Some(row) => rows.push(row),
            None => {
                let shown: String = line.trim().chars().take(60).collect();
                let fault =
                    CalibrationDiagnostic::of_file(path, format!("a row {shown:?}"), format!("{N} finite numbers"));
                faults.push(CalibrationDiagnostic { place: Some((index + 1, 1)), ..fault });
            }
        }
    }
    if faults.is_empty() { Ok(rows) } else { Err(faults) }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use nalgebra::{Matrix4, Point2, Point3, Vector2};

    use super::*;

    /// What MultiCamSelfCal says the raw pixel of a point is, counted from 1; in its own world.
    fn their_pixel(lens: &Camera, matrix: &Matrix3x4<f64>, point: &Point3<f64>) -> Point2<f64> {
        let undistorted = Point2::from_homogeneous(matrix * point.to_homogeneous()).unwrap();
        let ideal = Camera { distortion: Distortion::default(), ..lens.clone() }.normalise(&undistorted).unwrap();
        lens.project(&Point3::from(ideal.push(1.0))).unwrap()
    }

    fn write(folder: &Path, name: &str, content: &str) {
        fs::write(folder.join(name), content).unwrap();
    }

    /// Two cameras whose P uses the very K of their lens, so that there is an exact answer. The world's `flip` axis is
    /// negated, and the names are such that plain sorting would swap them.
    fn write_result(folder: &Path, flip: [f64; 3]) -> Vec<Camera> {
        let mut matrices = String::new();
        let mut cameras = Vec::new();
        for (name, x, k1) in [("cam2", 1.0, -0.2), ("cam10", -1.0, 0.1)] {
            let mut camera = Camera::look_at(Point3::new(x, -3.0, 1.0), Point3::origin(), [640, 480], 600.0);
            camera.distortion = Distortion { k1, k2: 0.02, p1: 1e-3, p2: -2e-3, k3: 0.0 };
            camera.intrinsics.principal = [321.0, 238.0];
            cameras.push(camera.clone());
            camera.intrinsics.principal = [322.0, 239.0]; // pixels count from 1 there
            let matrix =
                camera.projection_matrix() * Matrix4::from_diagonal(&Vector4::new(flip[0], flip[1], flip[2], 1.0));
            for row in matrix.row_iter() {
                matrices += &format!("  {:e} {:e} {:e} {:e}\n", row[0], row[1], row[2], row[3]);
            }
            let lens = "K11 = 600\nK12 = 0\nK13 = 322\nK21 = 0\nK22 = 600\nK23 = 239\nK31 = 0\nK32 = 0\nK33 = 1\n\n";
            let lens = format!("{lens}kc1 = {k1}\nkc2 = 0.02\nkc3 = 0.001\nkc4 = -0.002\n");
            write(folder, &format!("{name}.rad"), &lens);
        }
        write(folder, MATRICES, &matrices);
        write(folder, "Res.dat", "   6.4e+02   4.8e+02\n   6.4e+02   4.8e+02\n");
        cameras
    }

    #[track_caller]
    fn check_same(imported: &Calibration, truth: &[Camera]) {
        assert_eq!(imported.length_unit, LengthUnit::Unknown);
        assert_eq!(imported.cameras.iter().map(|it| it.name.as_str()).collect::<Vec<_>>(), ["cam2", "cam10"]);
        for (NamedCamera { camera, .. }, truth) in imported.cameras.iter().zip(truth) {
            for point in [[0.0; 3], [0.5, 0.3, -0.4], [-0.6, 1.0, 0.5]].map(Point3::from) {
                let (found, expected) = (camera.project(&point).unwrap(), truth.project(&point).unwrap());
                assert!((found - expected).norm() < 1e-6, "{found} {expected}");
            }
        }
    }

    #[test]
    fn a_consistent_result_is_taken_over_exactly() {
        let folder = tempfile::tempdir().unwrap();
        let truth = write_result(folder.path(), [1.0; 3]);
        let imported = Calibration::load(folder.path()).unwrap();
        check_same(&imported, &truth);
        assert!(!imported.origin.contains("left-handed"), "{}", imported.origin);
    }

    #[test]
    fn a_left_handed_world_is_turned_right_handed() {
        let folder = tempfile::tempdir().unwrap();
        let truth = write_result(folder.path(), [1.0, 1.0, -1.0]);
        let imported = Calibration::load(folder.path()).unwrap();
        check_same(&imported, &truth);
        assert!(imported.origin.contains("left-handed"), "{}", imported.origin);
    }

    #[test]
    fn faults_name_file_and_camera() {
        let folder = tempfile::tempdir().unwrap();
        let faults = || Calibration::load(folder.path()).unwrap_err().to_string();
        write_result(folder.path(), [1.0; 3]);
        write(folder.path(), "Res.dat", "640 480\n");
        assert!(faults().ends_with("Res.dat: has 1 rows, expected 2 rows for the 2 .rad files"), "{}", faults());
        write(folder.path(), "Res.dat", "640 480\n640 x\n");
        assert!(faults().ends_with("Res.dat:2:1: a row \"640 x\", expected 2 finite numbers"), "{}", faults());
        write(folder.path(), "Res.dat", "640 480\n640 0\n");
        assert!(faults().contains("cam10.rad: camera \"cam10\": the image in Res.dat has 640 x 0 px"), "{}", faults());
        write_result(folder.path(), [1.0; 3]);
        write(folder.path(), "cam2.rad", "K11 = NaN\n");
        assert!(faults().contains("cam2.rad: camera \"cam2\": K11 is NaN, expected a finite number"), "{}", faults());
        assert!(faults().contains("cam2.rad: camera \"cam2\": kc4 is missing"), "{}", faults());
        write_result(folder.path(), [1.0; 3]);
        write(folder.path(), MATRICES, &"0 0 0 0\n".repeat(6));
        assert!(
            faults().contains("Pmatrices.dat: camera \"cam2\": the left 3x3 half of the projection matrix is singular")
        );
        fs::remove_file(folder.path().join("Res.dat")).unwrap();
        assert!(faults().contains("Res.dat: cannot be read ("), "{}", faults());
    }

    #[test]
    fn points_decide_the_sign_of_a_matrix() {
        let camera = Camera::look_at(Point3::new(0.0, -3.0, 1.0), Point3::origin(), [640, 480], 600.0);
        let matrix = camera.projection_matrix();
        let points = [[0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 1.0], [-0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 1.0]];
        assert_eq!(in_front(&-matrix, &points), matrix);
        assert_eq!(in_front(&matrix, &points), matrix);
        assert_eq!(in_front(&-matrix, &[]), -matrix);
    }

    /// A real result: 4 cameras, 640 × 480, 310 to 381 points each.
    #[test]
    fn a_real_result_reprojects_as_well_as_with_its_own_model() {
        let given = std::env::var_os("FOVEATE_DATA").map(PathBuf::from);
        let data = given.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"));
        let folder = data.join("s01_arctic_laser_4cam/reference_multicamselfcal");
        if !folder.is_dir() {
            println!("skipped: no {}; set FOVEATE_DATA to the folder of recordings", folder.display());
            return;
        }
        let imported = Calibration::load(&folder).unwrap();
        println!("{}", imported.origin);
        assert!(imported.origin.contains("negating Z"));
        let worst = imported.origin.rsplit(' ').nth(1).and_then(|it| it.parse::<f64>().ok());
        assert!(worst.unwrap() < 0.06, "{worst:?}");
        let rows = table::<4>(&folder.join(MATRICES)).unwrap();
        for (index, NamedCamera { name, camera }) in imported.cameras.iter().enumerate() {
            camera.check().unwrap();
            let lens = lens(&folder.join(format!("{name}.rad")), [640.0, 480.0]).unwrap();
            let matrix = Matrix3x4::from_fn(|row, column| rows[3 * index + row][column]);
            let (mut errors, mut their_errors, mut apart) = (Vec::new(), Vec::new(), Vec::new());
            for row in table::<7>(&folder.join(format!("cam{}.points4cal.dat", index + 1))).unwrap() {
                let theirs = their_pixel(&lens, &matrix, &Point3::new(row[0], row[1], row[2]));
                let ours = camera.sees(&Point3::new(row[0], row[1], -row[2])).unwrap() + Vector2::new(1.0, 1.0);
                let seen = Point2::new(row[4], row[5]);
                errors.push((ours - seen).norm());
                their_errors.push((theirs - seen).norm());
                apart.push((ours - theirs).norm());
            }
            let [ours, theirs, apart] = [errors, their_errors, apart].map(|mut list| {
                list.sort_by(f64::total_cmp);
                [list[list.len() / 2], list[list.len() * 9 / 10], list[list.len() - 1]]
            });
            println!("{name}: median, p90, max [px]: ours {ours:.3?}, theirs {theirs:.3?}, apart {apart:.4?}");
            // With a whole pixel of shift left out, the medians would be above 1.
            assert!(ours[0] < 0.42 && ours[1] < 0.9, "{ours:?}");
            assert!(ours[0] < theirs[0] + 0.01 && apart[0] < 0.01 && apart[2] < 0.03, "{ours:?} {theirs:?} {apart:?}");
        }
    }
}
