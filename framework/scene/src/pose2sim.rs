//! Reads the TOML calibrations of Pose2Sim (D. Pagnon, M. Domalain, L. Reveret, "Pose2Sim: an end-to-end workflow for 3D markerless
//! sports kinematics", Sensors 21(19), 2021), which it also makes of those of Qualisys, Vicon and others, and those of two
//! programs with nearly the same form: Anipose (P. Karashchuk et al., Cell Reports 36(13), 2021) and Caliscope.
//!
//! One section a camera; `[metadata]` besides, and in Caliscope's the settings of its boards:
//!
//! | key | what it is | here |
//! |---|---|---|
//! | `name`, `cam_id` | the camera's name; left out: the section's | the same |
//! | `size` | columns, rows [px], whole numbers that may be written with a point | the same |
//! | `matrix` | K, row by row [px] | focal lengths, skew, principal point |
//! | `distortions` | k₁, k₂, p₁, p₂ and, optional, k₃ of OpenCV | the same |
//! | `rotation` | of `camera_from_world`: axis times angle [rad], or 3 × 3 in Caliscope's | a quaternion |
//! | `translation` | of `camera_from_world` | the same |
//! | `fisheye` | `true`: another lens model, which is refused | – |
//! | `ignore` | `true`: Caliscope leaves the camera out, and so do we | – |
//!
//! Pixel (0, 0) is the centre of the top-left pixel and cameras look along +Z, Y down, as here: no number is changed.
//! Pose2Sim and Caliscope are in metres, Anipose in whatever unit its board was given in. A file is Caliscope's if
//! its cameras stand in `[cameras.N]` or have a `cam_id`, Pose2Sim's if they have `fisheye`, else Anipose's, unless
//! `[metadata]` holds `length_unit`, which our own exports write there.

use std::ops::Range;

use foveate_geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use toml::de::{DeTable, DeValue};

use crate::calibration::{Calibration, LengthUnit, MAX_CAMERAS, NamedCamera};
use crate::formats::optics;
use crate::toml_reader::{Reader, Value};

const METADATA: &str = "metadata";
/// Caliscope's cameras.
const CAMERAS: &str = "cameras";
/// What Caliscope's older files hold beside the cameras.
const OTHERS: [&str; 4] = [METADATA, "capture_volume", "charuco", "CreationDate"];
const KEYS: [&str; 15] = [
    "name",
    "cam_id",
    "size",
    "matrix",
    "distortions",
    "rotation",
    "translation",
    "fisheye",
    "ignore",
    "rotation_count",
    "error",
    "exposure",
    "grid_count",
    "verified_resolutions",
    "port",
];

/// Whether the file is one of these: a section, or one of `cameras`, has a `matrix`.
pub(crate) fn is_meant(root: &DeTable<'_>) -> bool {
    let has_matrix = |value: &Value<'_>| value.get_ref().as_table().is_some_and(|table| table.contains_key("matrix"));
    let listed = root.get(CAMERAS).and_then(|it| it.get_ref().as_table());
    root.values().chain(listed.into_iter().flat_map(|it| it.values())).any(has_matrix)
}

/// Reads the document `root`.
pub(crate) fn parts(reader: &mut Reader<'_>, root: &DeTable<'_>) -> Calibration {
    let mut cameras = Vec::new();
    let listed = root.get(CAMERAS).and_then(|it| it.get_ref().as_table());
    let sections = listed.unwrap_or(root);
    if sections.len() > MAX_CAMERAS {
        reader.report(0..0, format!("there are {} sections", sections.len()), "1 to 65535 cameras".into());
    }
    let (mut is_caliscope, mut is_pose2sim) = (listed.is_some(), false);
    for (key, value) in sections.iter().take(MAX_CAMERAS).filter(|(key, _)| !OTHERS.contains(&key.get_ref().as_ref())) {
        reader.camera = Some(key.get_ref().to_string());
        let Some(table) = value.get_ref().as_table() else {
            reader.expect(None::<()>, value, key.get_ref(), "a table such as [cam_01]");
            continue;
        };
        is_caliscope |= table.contains_key("cam_id");
        is_pose2sim |= table.contains_key("fisheye");
        if matches!(table.get("ignore").map(|it| it.get_ref()), Some(DeValue::Boolean(true))) {
            continue;
        }
        let read = camera(reader, table, key.span()).map(|camera| NamedCamera {
            name: name(reader, table).unwrap_or_else(|| key.get_ref().to_string()),
            camera,
        });
        cameras.extend(read);
    }
    reader.camera = None;
    let metadata = root.get(METADATA).and_then(|it| it.get_ref().as_table());
    let length_unit = match metadata.and_then(|it| it.get("length_unit")).and_then(|it| it.get_ref().as_str()) {
        Some("m") => LengthUnit::Metre,
        None if is_caliscope || is_pose2sim => LengthUnit::Metre,
        _ => LengthUnit::Unknown,
    };
    let program = match (is_caliscope, is_pose2sim) {
        (true, _) => "Caliscope",
        (false, true) => "Pose2Sim",
        (false, false) => "Anipose",
    };
    Calibration {
        cameras,
        length_unit,
        clocks: Default::default(),
        heads: Default::default(),
        provenance: None,
        uncertainties: Default::default(),
        origin: format!("{program} calibration {}", reader.path.display()),
    }
}

fn name(reader: &mut Reader<'_>, table: &DeTable<'_>) -> Option<String> {
    if let Some(DeValue::Integer(id)) = table.get("cam_id").map(|it| it.get_ref()) {
        return Some(id.as_str().to_owned());
    }
    let value = table.get("name")?;
    let text = value.get_ref().as_str().filter(|it| !it.is_empty()).map(str::to_owned);
    reader.expect(text, value, "name", "a name")
}

/// Reads all keys before it returns an error, so that all their faults are found.
fn camera(reader: &mut Reader<'_>, table: &DeTable<'_>, at: Range<usize>) -> Option<Camera> {
    reader.refuse_unknown(table, "key", &KEYS);
    let size = reader.numbers::<2>(table, "size", at.clone()).and_then(|size| {
        let whole = size.iter().all(|it| it.fract() == 0.0 && (1.0..=65535.0).contains(it));
        let size = whole.then_some(size.map(|it| it as u32));
        reader.expect(size, table.get("size")?, "size", "columns and rows, whole numbers from 1 to 65535")
    });
    let intrinsics = matrix(reader, table, at.clone());
    let lens = distortion(reader, table, at.clone());
    let turn = rotation(reader, table, at.clone());
    let shift = reader.numbers::<3>(table, "translation", at);
    let pinhole = table.get("fisheye").map_or(Some(()), |value| {
        let is_pinhole = matches!(value.get_ref(), DeValue::Boolean(false)).then_some(());
        reader.expect(is_pinhole, value, "fisheye", "false: lenses of OpenCV's fisheye model cannot be read")
    });
    pinhole?;
    Some(Camera {
        image_size: size?,
        intrinsics: intrinsics?,
        distortion: lens?,
        camera_from_world: Isometry3::from_parts(Vector3::from(shift?).into(), turn?),
    })
}

/// Axis times angle, or a 3 × 3 matrix.
fn rotation(reader: &mut Reader<'_>, table: &DeTable<'_>, at: Range<usize>) -> Option<UnitQuaternion<f64>> {
    let is_matrix = |value: &Value<'_>| {
        value.get_ref().as_array().and_then(|list| list.first()).is_some_and(|it| it.get_ref().is_array())
    };
    let Some(value) = table.get("rotation").filter(|it| is_matrix(it)) else {
        let turn = reader.numbers::<3>(table, "rotation", at)?;
        return Some(UnitQuaternion::from_scaled_axis(Vector3::from(turn)));
    };
    let rows = rows_of_3(reader, value, "rotation", "3 numbers, or 3 rows of 3 numbers")?;
    let turn = optics::rotation(&Matrix3::from_fn(|row, column| rows[row][column]));
    turn.map_err(|found| reader.report(value.span(), format!("rotation {found}"), "a rotation matrix".into())).ok()
}

/// A matrix of 3 × 3.
fn rows_of_3(reader: &mut Reader<'_>, value: &Value<'_>, what: &str, expected: &str) -> Option<[[f64; 3]; 3]> {
    let mut rows = [[0.0; 3]; 3];
    let list = value.get_ref().as_array().filter(|list| list.len() == 3);
    let list = reader.expect(list, value, what, expected)?;
    for (row, item) in rows.iter_mut().zip(list.iter()) {
        let numbers = item.get_ref().as_array().filter(|list| list.len() == 3);
        let numbers = reader.expect(numbers, item, &format!("a row of {what}"), "3 numbers")?;
        for (number, item) in row.iter_mut().zip(numbers.iter()) {
            *number = reader.number(item, &format!("an element of {what}"))?;
        }
    }
    Some(rows)
}

fn matrix(reader: &mut Reader<'_>, table: &DeTable<'_>, at: Range<usize>) -> Option<Intrinsics> {
    let expected = "[[fx, skew, cx], [0, fy, cy], [0, 0, 1]], fx and fy above 0";
    let value = reader.required(table, "matrix", expected, at)?;
    let rows = rows_of_3(reader, value, "matrix", expected)?;
    reader.expect(optics::intrinsics(&Matrix3::from_fn(|row, column| rows[row][column])), value, "matrix", expected)
}

fn distortion(reader: &mut Reader<'_>, table: &DeTable<'_>, at: Range<usize>) -> Option<Distortion> {
    let expected = "[k1, k2, p1, p2] or [k1, k2, p1, p2, k3]";
    let value = reader.required(table, "distortions", expected, at)?;
    let list = reader.expect(value.get_ref().as_array(), value, "distortions", expected)?;
    let numbers: Option<Vec<f64>> = list.iter().map(|item| reader.number(item, "an element of distortions")).collect();
    match optics::distortion(&numbers?) {
        Ok(lens) => Some(lens),
        Err(found) => {
            reader.report(value.span(), format!("distortions {found}"), expected.into());
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::{Point2, Point3};

    use super::*;
    use crate::CalibrationError;

    fn cameras() -> Vec<NamedCamera> {
        let places = [("front", [2.0, -3.0, 1.0]), ("side", [-3.0, 0.5, 2.0]), ("behind", [0.1, 4.0, 1.2])];
        let camera = |place: [f64; 3]| {
            let mut camera = Camera::look_at(Point3::from(place), Point3::new(0.1, 0.2, 1.0), [1088, 1920], 1680.0);
            camera.intrinsics.focal[1] = 1675.5;
            camera.intrinsics.skew = 0.25;
            camera.distortion = Distortion { k1: -0.05, k2: 0.14, p1: 1e-3, p2: -2e-3, k3: 0.01 };
            camera
        };
        places.map(|(name, place)| NamedCamera { name: name.into(), camera: camera(place) }).into()
    }

    /// As Pose2Sim writes it; the section's name is not the camera's.
    fn write(cameras: &[NamedCamera]) -> String {
        let mut text = String::new();
        for (k, NamedCamera { name, camera: Camera { image_size, intrinsics, distortion, camera_from_world } }) in
            cameras.iter().enumerate()
        {
            let ([fx, fy], [cx, cy], skew) = (intrinsics.focal, intrinsics.principal, intrinsics.skew);
            let Distortion { k1, k2, p1, p2, k3 } = distortion;
            let (turn, shift) = (camera_from_world.rotation.scaled_axis(), camera_from_world.translation.vector);
            text += &format!(
                "[int_cam_{k}]\nname = \"{name}\"\nsize = [ {}.0, {}.0]\nmatrix = [ [ {fx:?}, {skew:?}, {cx:?}], [ 0.0, \
                 {fy:?}, {cy:?}], [ 0.0, 0.0, 1.0]]\ndistortions = [ {k1:?}, {k2:?}, {p1:?}, {p2:?}, {k3:?}]\nrotation = \
                 {:?}\ntranslation = {:?}\nfisheye = false\n\n",
                image_size[0],
                image_size[1],
                turn.as_slice(),
                shift.as_slice()
            );
        }
        text + "[metadata]\nadjusted = false\nerror = 0.0\n"
    }

    fn read(text: &str) -> Result<Calibration, CalibrationError> {
        Calibration::from_toml(text, Path::new("Calib.toml"))
    }

    #[test]
    fn what_was_written_comes_back_and_survives_our_own_form() {
        let truth = cameras();
        let imported = read(&write(&truth)).unwrap();
        assert_eq!((imported.length_unit, imported.cameras.len()), (LengthUnit::Metre, 3));
        let again = read(&imported.to_toml()).unwrap();
        for NamedCamera { name, camera } in &truth {
            for found in [imported.camera(name).unwrap(), again.camera(name).unwrap()] {
                for point in [[0.0; 3], [0.3, -0.2, 1.4], [-0.2, 0.3, 0.8]].map(Point3::from) {
                    let (found, expected) = (found.project(&point).unwrap(), camera.project(&point).unwrap());
                    assert!((found - expected).norm() < 1e-6, "{name}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn a_turn_about_one_axis_is_that_of_opencv() {
        // By hand: the world's X is the camera's Z after a turn of -90° about Y; K (Y, Z) and the shift do the rest.
        let text = "[a]\nsize = [100, 100]\nmatrix = [[100, 0, 50], [0, 200, 60], [0, 0, 1]]\ndistortions = [0, 0, 0, 0]\n\
                    rotation = [0.0, -1.5707963267948966, 0.0]\ntranslation = [0.5, 0.0, 1.0]\n";
        let calibration = read(text).unwrap();
        // R x = (−z, y, x): the point (3, 1, 0.1) is (−0.1 + 0.5, 1, 3 + 1) in the camera.
        let pixel = calibration.camera("a").unwrap().project(&Point3::new(3.0, 1.0, 0.1)).unwrap();
        assert!((pixel - Point2::new(60.0, 110.0)).norm() < 1e-9, "{pixel}");
    }

    #[test]
    fn faults_name_line_and_camera() {
        let good = write(&cameras()[..1]);
        let fault = |from: &str, to: &str| read(&good.replacen(from, to, 1)).unwrap_err().to_string();
        for (from, to, expected) in [
            ("fisheye = false", "fisheye = true", "fisheye is true, expected false"),
            ("1088.0", "1088.5", "size is [ 1088.5, 1920.0], expected columns and rows, whole numbers"),
            ("1680.0", "-1.0", "expected [[fx, skew, cx]"),
            ("1680.0", "nan", "an element of matrix is nan, expected a finite number"),
            ("distortions", "distortion", "distortions is missing"),
            ("rotation = [", "rotation = [0.0, ", "rotation is"),
            ("name = \"front\"", "name = 3", "name is 3, expected a name"),
        ] {
            let text = fault(from, to);
            assert!(text.contains("Calib.toml:") && text.contains("int_cam_0") && text.contains(expected), "{text}");
        }
        assert!(read("a = 1\n[b]\nmatrix = 1").unwrap_err().to_string().contains("a is 1, expected a table"));
    }

    /// Both files of the data set hold the same calibration: the XML's camera centres [mm] are those of the TOML file [m].
    #[test]
    fn a_real_calibration_puts_the_cameras_where_its_source_says() {
        let Some(folder) = std::env::var_os("FOVEATE_DATA") else {
            return eprintln!("skipped: FOVEATE_DATA is not set");
        };
        let path = Path::new(&folder).join("s06_pose2sim_single/Calib_qualisys.toml");
        if !path.is_file() {
            return eprintln!("skipped: {} is not there", path.display());
        }
        let calibration = Calibration::load(&path).unwrap();
        assert_eq!(calibration.cameras.len(), 4);
        for (name, [x, y, z]) in
            [("cam_01", [1.460232, -1.909159, 1.896506]), ("cam_04", [-3.758720, -1.415665, 1.881794])]
        {
            let centre = calibration.camera(name).unwrap().centre();
            assert!((centre - Point3::new(x, y, z)).norm() < 1e-3, "{name}: {centre}");
        }
    }
}
