//! The cameras of a rig, by name: loading, checking, saving.
//!
//! A file of ours is TOML:
//!
//! ```toml
//! [calibration]
//! length_unit = "m"            # or "unknown", when the scale of the scene was never measured
//! note = "author, method, date"  # optional
//!
//! [camera.wide-1]
//! image_size_px = [640, 240]
//! focal_px = [520.0, 260.0]
//! principal_point_px = [319.5, 119.5]
//! skew_px = 0.0                                      # optional
//! distortion = { k1 = -0.2, k2 = 0.03, p1 = 0.0, p2 = 0.0, k3 = 0.0 }  # optional, and each of its parts
//! position_m = [1.0, -2.0, 2.5]                      # the camera's centre in the world
//! camera_from_world_wxyz = [0.7071068, 0.7071068, 0.0, 0.0]  # unit quaternion; this one looks along +Y
//! ```
//!
//! Optional besides: `[provenance]` and `[camera.wide-1.uncertainty]`, see [`crate::uncertainty`].
//!
//! A section `[clock.wide-1]` may describe the camera's clock: see [`crate::clocks`]; a section `[head.ptz-1]`, the pan-tilt head that carries the
//! camera: see [`crate::heads`].
//!
//! Calibrations of other programs are read too: see [`crate::formats`].

use std::fmt::Write as _;
use std::path::Path;

use foveate_geometry::Camera;
use foveate_geometry::pan_tilt::HeadCovariance;
use nalgebra::{Isometry3, Matrix6, UnitQuaternion, Vector3};

use crate::clocks::Clocks;
use crate::error::{CalibrationDiagnostic, CalibrationError};
use crate::heads::{CalibratedHead, Heads};
use crate::natural_order::natural_order;
use crate::text::{key, quoted};
use crate::uncertainty::{Provenance, Uncertainties};

/// Cameras are numbered with 16 bits.
pub(crate) const MAX_CAMERAS: usize = u16::MAX as usize;

/// What a length in a calibration means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthUnit {
    /// Metres.
    Metre,
    /// Some unit that was never tied to a known length, as self-calibration leaves it.
    Unknown,
}

/// A camera and its name in rigs.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedCamera {
    /// Such as `wide-1`.
    pub name: String,
    /// Optics and place.
    pub camera: Camera,
}

/// All cameras of a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Sorted by name with digits taken as numbers, all different, each camera checked. A camera's place here is its number.
    pub cameras: Vec<NamedCamera>,
    /// What the lengths are in.
    pub length_unit: LengthUnit,
    /// How the cameras' clocks run, where they are not the session's.
    pub clocks: Clocks,
    /// The pan-tilt heads that carry cameras, by the camera's name.
    pub heads: Heads,
    /// How it was made, where that is known.
    pub provenance: Option<Provenance>,
    /// Uncertainty of each camera, by its name; cameras without one are left out.
    pub uncertainties: Uncertainties,
    /// Where it came from and what was changed during import, for people.
    pub origin: String,
}

impl Calibration {
    /// Sorts and checks `cameras`: names that occur twice, cameras that cannot be used, too many or none of them.
    pub fn new(
        cameras: Vec<NamedCamera>,
        length_unit: LengthUnit,
        origin: String,
    ) -> Result<Calibration, CalibrationError> {
        let (clocks, heads, uncertainties) = (Clocks::default(), Heads::default(), Uncertainties::new());
        Calibration { cameras, length_unit, clocks, heads, provenance: None, uncertainties, origin }.checked()
    }

    /// Sorted and checked, as [`Calibration::new`] promises.
    pub(crate) fn checked(mut self) -> Result<Calibration, CalibrationError> {
        let cameras = &mut self.cameras;
        cameras.sort_by(|a, b| natural_order(&a.name, &b.name));
        let mut faults = Vec::new();
        let mut report = |camera: Option<&str>, found: String, expected: &str| {
            let fault = CalibrationDiagnostic::of_file(Path::new(""), found, expected);
            faults.push(CalibrationDiagnostic { camera: camera.map(str::to_owned), ..fault });
        };
        if cameras.is_empty() || cameras.len() > MAX_CAMERAS {
            report(None, format!("there are {} cameras", cameras.len()), "1 to 65535");
        }
        for pair in cameras.windows(2).filter(|pair| pair[0].name == pair[1].name) {
            report(Some(&pair[0].name), "the name occurs twice".into(), "a name for each camera");
        }
        for NamedCamera { name, camera } in cameras.iter() {
            if let Err(fault) = camera.check() {
                report(Some(name), fault.to_string(), "a camera that can be used");
            }
        }
        match faults.is_empty() {
            true => Ok(self),
            false => Err(CalibrationError { faults }),
        }
    }

    /// The place of the camera called `name`, which is its number.
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.cameras.binary_search_by(|it| natural_order(&it.name, name)).ok()
    }

    /// The camera called `name`.
    pub fn camera(&self, name: &str) -> Option<&Camera> {
        self.index_of(name).map(|index| &self.cameras[index].camera)
    }

    /// The head that carries the camera called `name`, with that camera.
    pub fn head(&self, name: &str) -> Option<CalibratedHead> {
        Some(self.heads.0.get(name)?.carrying(self.camera(name)?))
    }

    /// The same rig in a world that is turned so that `up`, a direction of length 1 in the world as it is, becomes Z. Pixels stay as they are; lengths, clocks and axes of heads, which stand in
    /// their cameras' space, too.
    pub fn with_up(&self, up: &Vector3<f64>) -> Calibration {
        // What points straight down is turned about X.
        let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let turn = UnitQuaternion::rotation_between(up, &Vector3::z()).unwrap_or(half_turn);
        let mut turned = self.clone();
        for it in &mut turned.cameras {
            it.camera.camera_from_world *= Isometry3::from_parts(Default::default(), turn.inverse());
        }
        // What moves a pose stands in the world's space.
        let mut of_motion = Matrix6::zeros();
        for block in [0, 3] {
            of_motion.fixed_view_mut::<3, 3>(block, block).copy_from(turn.to_rotation_matrix().matrix());
        }
        for covariance in turned.uncertainties.values_mut().filter_map(|it| it.pose_covariance.as_mut()) {
            *covariance = of_motion * *covariance * of_motion.transpose();
        }
        for HeadCovariance { whole } in turned.heads.0.values_mut().filter_map(|it| it.covariance.as_mut()) {
            let rows = of_motion * whole.fixed_rows::<6>(0);
            whole.fixed_rows_mut::<6>(0).copy_from(&rows);
            let columns = whole.fixed_columns::<6>(0) * of_motion.transpose();
            whole.fixed_columns_mut::<6>(0).copy_from(&columns);
        }
        turned
    }

    /// As a TOML file, `origin` as its note. Reading it back gives the same numbers, but for rounding in the last
    /// digits of the pose.
    pub fn to_toml(&self) -> String {
        let unit = match self.length_unit {
            LengthUnit::Metre => "m",
            LengthUnit::Unknown => "unknown",
        };
        let mut text = format!("[calibration]\nlength_unit = \"{unit}\"\nnote = {}\n", quoted(&self.origin));
        text.extend(self.provenance.as_ref().map(Provenance::to_toml));
        for NamedCamera { name, camera } in &self.cameras {
            let key = key(name);
            let Camera { image_size, intrinsics, distortion: lens, camera_from_world } = camera;
            let centre = camera.centre();
            let turn = camera_from_world.rotation;
            let lines = [
                format!("[camera.{key}]"),
                format!("image_size_px = {image_size:?}"),
                format!("focal_px = {:?}", intrinsics.focal),
                format!("principal_point_px = {:?}", intrinsics.principal),
                format!("skew_px = {:?}", intrinsics.skew),
                format!(
                    "distortion = {{ k1 = {:?}, k2 = {:?}, p1 = {:?}, p2 = {:?}, k3 = {:?} }}",
                    lens.k1, lens.k2, lens.p1, lens.p2, lens.k3
                ),
                format!("position_m = {:?}", [centre.x, centre.y, centre.z]),
                format!("camera_from_world_wxyz = {:?}", [turn.w, turn.i, turn.j, turn.k]),
            ];
            let _ = write!(text, "\n{}\n", lines.join("\n")); // writing to a String cannot fail
            if let Some(uncertainty) = self.uncertainties.get(name) {
                text += &uncertainty.to_toml(&key);
            }
        }
        text + &self.clocks.to_toml() + &self.heads.to_toml()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Point3};
    use proptest::prelude::*;

    use super::*;

    const GOOD: &str = r#"
[calibration]
length_unit = "m"
note = "by hand"

[camera.wide-10]
image_size_px = [640, 240]
focal_px = [520.0, 260]
principal_point_px = [319.5, 119.5]
position_m = [1.0, -2.0, 2.5]
camera_from_world_wxyz = [0.7071068, 0.7071068, 0, 0]

[camera.wide-2]
image_size_px = [64_0, 0x1e0]
focal_px = [5e2, 5e2]
principal_point_px = [319.5, 239.5]
skew_px = 0.1
distortion = { k1 = -0.2, p2 = 1e-3 }
position_m = [0, 0, 0]
camera_from_world_wxyz = [1.0002, 0, 0, 0]
"#;

    fn parse(text: &str) -> Result<Calibration, CalibrationError> {
        Calibration::from_toml(text, Path::new("lab.toml"))
    }

    /// All faults of `text`, one a line.
    #[track_caller]
    fn faults(text: &str) -> String {
        parse(text).unwrap_err().to_string()
    }

    #[test]
    fn cameras_come_sorted_by_number_and_with_defaults() {
        let calibration = parse(GOOD).unwrap();
        let names: Vec<&str> = calibration.cameras.iter().map(|it| it.name.as_str()).collect();
        assert_eq!(names, ["wide-2", "wide-10"]);
        assert_eq!([calibration.index_of("wide-10"), calibration.index_of("wide-1")], [Some(1), None]);
        assert_eq!((calibration.length_unit, calibration.origin.as_str()), (LengthUnit::Metre, "by hand"));
        let wide_2 = calibration.camera("wide-2").unwrap();
        assert_eq!(wide_2.image_size, [640, 480]);
        assert_eq!((wide_2.distortion.k1, wide_2.distortion.k2, wide_2.distortion.p2), (-0.2, 0.0, 1e-3));
        assert_eq!(wide_2.camera_from_world.rotation, UnitQuaternion::identity());
        let wide_10 = calibration.camera("wide-10").unwrap();
        assert!((wide_10.centre() - Point3::new(1.0, -2.0, 2.5)).norm() < 1e-12);
        // This quaternion turns the world's +Y into the camera's forward.
        let ahead = wide_10.project(&Point3::new(1.0, 3.0, 2.5)).unwrap();
        assert!((ahead - Point2::new(319.5, 119.5)).norm() < 1e-9, "{ahead}");
        assert_eq!(wide_10.intrinsics.skew, 0.0);
    }

    #[test]
    fn a_world_whose_y_points_up_or_down_is_turned_with_all_that_is_known_of_it() {
        let pose_covariance = Some(Matrix6::from_diagonal(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0].into()));
        let mut calibration = parse(GOOD).unwrap();
        calibration
            .uncertainties
            .insert("wide-2".into(), crate::CameraUncertainty { pose_covariance, ..Default::default() });
        let place = Point3::new(1.2, 3.0, 2.9);
        for (up, turned_place, variances) in [
            (Vector3::y(), Point3::new(1.2, -2.9, 3.0), [1.0, 3.0, 2.0, 4.0, 6.0, 5.0]),
            (-Vector3::y(), Point3::new(1.2, 2.9, -3.0), [1.0, 3.0, 2.0, 4.0, 6.0, 5.0]),
            (-Vector3::z(), Point3::new(1.2, -3.0, -2.9), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            (Vector3::x(), Point3::new(-2.9, 3.0, 1.2), [3.0, 2.0, 1.0, 6.0, 5.0, 4.0]),
            (Vector3::z(), place, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
        ] {
            let turned = calibration.with_up(&up);
            for (before, after) in calibration.cameras.iter().zip(&turned.cameras) {
                let [before, after] =
                    [(before, place), (after, turned_place)].map(|(it, place)| it.camera.project(&place));
                let off = (before.unwrap() - after.unwrap()).norm();
                assert!(off < 1e-9, "{up}: {off} px");
            }
            let found = turned.uncertainties["wide-2"].pose_covariance.unwrap().diagonal();
            assert!((found - nalgebra::Vector6::from(variances)).norm() < 1e-9, "{up}: {found}");
        }
    }

    #[test]
    fn every_fault_is_named_with_its_place_in_one_go() {
        let text = GOOD
            .replace("length_unit = \"m\"", "length_unit = \"mm\"\nnotes = 3")
            .replace("[640, 240]", "[640, 0]")
            .replace("[520.0, 260]", "[0.0, 260]")
            .replace("[319.5, 119.5]", "[nan, inf]")
            .replace("[0.7071068, 0.7071068, 0, 0]", "[0.5, -0.5, 0.5, -0.6]")
            .replace("skew_px = 0.1", "skew = 0.1")
            .replace("k1 = -0.2", "k1 = \"a\", k7 = 1.0")
            .replace("[0, 0, 0]", "[0, 0]")
            .replace("[1.0002, 0, 0, 0]", "1.0\n[cameras]");
        let expected = r#"lab.toml:3:15: length_unit is "mm", expected "m" or "unknown"
lab.toml:4:1: unknown key "notes", expected note (did you mean that?)
lab.toml:8:17: camera "wide-10": image_size_px is [640, 0], expected [columns, rows], whole numbers from 1 to 65535
lab.toml:9:12: camera "wide-10": focal_px is [0.0, 260], expected two numbers above 0
lab.toml:10:23: camera "wide-10": principal_point_px[0] is nan, expected a finite number
lab.toml:10:28: camera "wide-10": principal_point_px[1] is inf, expected a finite number
lab.toml:12:26: camera "wide-10": camera_from_world_wxyz has length 1.053565, expected a unit quaternion [w, x, y, z] of length 1
lab.toml:18:1: camera "wide-2": unknown key "skew", expected skew_px (did you mean that?)
lab.toml:19:21: camera "wide-2": k1 is "a", expected a finite number
lab.toml:19:26: camera "wide-2": unknown key of distortion "k7", expected one of k1, k2, p1, p2, k3
lab.toml:20:14: camera "wide-2": position_m is [0, 0], expected 3 numbers
lab.toml:21:26: camera "wide-2": camera_from_world_wxyz is 1.0, expected 4 numbers
lab.toml:22:2: unknown section "cameras", expected camera (did you mean that?)"#;
        assert_eq!(faults(&text), expected);
    }

    #[test]
    fn what_is_missing_is_named() {
        let found = faults("[calibration]\n[camera.a]\nfocal_px = [1, 1]");
        for key in ["length_unit", "image_size_px", "principal_point_px", "position_m", "camera_from_world_wxyz"] {
            assert!(found.contains(&format!("{key} is missing, expected {key} = ")), "{key}: {found}");
        }
        assert!(found.contains("lab.toml:2:9: camera \"a\": image_size_px is missing"), "{found}");
        let found = faults("");
        assert!(found.contains("calibration is missing") && found.contains("camera is missing"), "{found}");
        assert!(faults("[calibration]\nlength_unit = \"m\"\n[camera]").contains("there are 0 cameras"));
    }

    #[test]
    fn a_clock_of_no_camera_is_refused() {
        let found = faults(&format!("{GOOD}\n[clock.wide-3]\noffset_s = 1\n"));
        assert!(found.contains("a clock of camera \"wide-3\", expected a clock of one of the cameras"), "{found}");
    }

    #[test]
    fn a_name_that_occurs_twice_is_refused() {
        let found = faults(&format!("{GOOD}[camera.wide-2]\n"));
        assert!(found.starts_with("lab.toml:21:9: this is not TOML (duplicate key"), "{found}");
        let calibration = parse(GOOD).unwrap();
        let mut cameras = calibration.cameras;
        cameras.push(cameras[0].clone());
        let error = Calibration::new(cameras, LengthUnit::Metre, String::new()).unwrap_err();
        assert_eq!(error.to_string(), "camera \"wide-2\": the name occurs twice, expected a name for each camera");
    }

    #[test]
    fn more_cameras_than_numbers_for_them_are_refused() {
        let camera = parse(GOOD).unwrap().cameras.remove(0).camera;
        let many = (0..65_536).map(|index| NamedCamera { name: format!("c{index}"), camera: camera.clone() });
        let error = Calibration::new(many.collect(), LengthUnit::Metre, String::new()).unwrap_err();
        assert_eq!(error.to_string(), "there are 65536 cameras, expected 1 to 65535");
        let text: String = (0..65_536).map(|index| format!("[camera.c{index}]\n")).collect();
        let found = faults(&format!("[calibration]\nlength_unit = \"m\"\n{text}"));
        assert!(found.contains("there are 65536 cameras, expected 1 to 65535 cameras"), "{:.300}", found);
    }

    #[test]
    fn files_that_are_no_calibration_are_refused_quickly() {
        let folder = tempfile::tempdir().unwrap();
        let refusal_of = |name: &str, content: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, content).unwrap();
            Calibration::load(&path).unwrap_err().to_string()
        };
        assert!(refusal_of("big.toml", &vec![b'#'; 17 << 20]).contains("has more than 16 MiB"));
        let binary = refusal_of("image.toml", b"# ok\na = \xff\xd8");
        assert!(binary.contains("image.toml:2:5: a byte that is not UTF-8"), "{binary}");
        let json = refusal_of("a.json", b"{ \"camera\": 1 }");
        assert!(json.contains("a.json: a file that begins with") && json.contains("TOML of ours"), "{json}");
        assert!(refusal_of("empty.toml", b"").contains("an empty file, expected a calibration"));
        assert!(refusal_of("rig.toml", b"[rig]\nname = \"a\"").contains("calibration is missing"));
        let deep = refusal_of("deep.toml", format!("a = {}", "[".repeat(100_000)).as_bytes());
        assert!(deep.contains("this is not TOML"), "{:.200}", deep);
        let missing = Calibration::load(&folder.path().join("none.toml")).unwrap_err().to_string();
        assert!(missing.contains("none.toml: cannot be read ("), "{missing}");
        let no_result = Calibration::load(folder.path()).unwrap_err().to_string();
        assert!(no_result.contains("a folder without Pmatrices.dat"), "{no_result}");
    }

    proptest! {
        #[test]
        fn what_is_saved_is_what_is_loaded(
            name in "(\\PC|['\"\n.]){0,8}", note in "(?s:.){0,12}", numbers in prop::array::uniform12(-1e3..1e3),
            focal in prop::array::uniform2(1e-3..1e5), turn in prop::array::uniform3(-3.0..3.0), metre: bool,
        ) {
            let [u, v, skew, k1, k2, p1, p2, k3, x, y, z, _] = numbers;
            let camera = Camera {
                image_size: [640, 480],
                intrinsics: foveate_geometry::Intrinsics { focal, principal: [u, v], skew },
                distortion: foveate_geometry::Distortion { k1, k2, p1, p2, k3 },
                camera_from_world: nalgebra::Isometry3::new(Vector3::new(x, y, z), turn.into()),
            };
            let unit = if metre { LengthUnit::Metre } else { LengthUnit::Unknown };
            let clock = crate::CameraClock { offset_s: x, rate: focal[0], ..Default::default() };
            let clocks = Clocks([(name.clone(), clock)].into());
            let saved = Calibration::new(vec![NamedCamera { name, camera }], unit, note).unwrap();
            let saved = Calibration { clocks, ..saved };
            let loaded = parse(&saved.to_toml()).unwrap();
            prop_assert_eq!(&loaded.origin, &saved.origin);
            prop_assert_eq!(loaded.length_unit, saved.length_unit);
            prop_assert_eq!(&loaded.clocks, &saved.clocks);
            let (before, after) = (&saved.cameras[0], &loaded.cameras[0]);
            prop_assert_eq!(&before.name, &after.name);
            prop_assert_eq!(before.camera.intrinsics, after.camera.intrinsics);
            prop_assert_eq!(before.camera.distortion, after.camera.distortion);
            prop_assert!((before.camera.centre() - after.camera.centre()).norm() < 1e-10);
            let (before, after) = (before.camera.camera_from_world.rotation, after.camera.camera_from_world.rotation);
            prop_assert!(before.angle_to(&after) < 1e-7);
        }

        #[test]
        fn no_text_makes_it_panic(text in "(\\[camera(\\.a)?\\]|calibration|=|\\PC|\n|\\[|\\]|nan|1e9|focal_px|\"){0,30}") {
            let _ = parse(&text);
        }
    }
}
