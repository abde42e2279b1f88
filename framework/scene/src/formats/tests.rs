//! Round trips through every form, malformed input of every kind, and real files.

use std::fs;
use std::path::{Path, PathBuf};

use foveate_geometry::pan_tilt::{Axis, AxisUnits, Limits};
use foveate_geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector3};

use super::*;
use crate::{CameraUncertainty, Head, NamedCamera, Provenance};

/// Evenly spread numbers in 0..1 that repeat exactly.
struct Spread(f64);

impl Spread {
    fn next(&mut self) -> f64 {
        self.0 = (self.0 + 0.618_033_988_749_895).fract();
        self.0
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

/// Cameras about the origin; what `format` cannot hold is left out of them.
fn cameras(format: Format, count: usize, seed: f64) -> Calibration {
    let mut spread = Spread(seed);
    let mut all = Vec::new();
    for index in 0..count {
        let angle = 6.3 * (index as f64 + spread.next()) / count as f64;
        let place = Point3::new(4.0 * angle.cos(), 4.0 * angle.sin(), spread.within(0.5, 3.0));
        let target = Point3::new(spread.within(-0.3, 0.3), spread.within(-0.3, 0.3), 1.0);
        let mut camera = Camera::look_at(place, target, [1088, 1920], spread.within(900.0, 1800.0));
        let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), spread.within(-3.1, 3.1));
        camera.camera_from_world = Isometry3::from_parts(Default::default(), roll) * camera.camera_from_world;
        camera.intrinsics.focal[1] *= spread.within(0.97, 1.03);
        camera.intrinsics.principal = [spread.within(500.0, 580.0), spread.within(900.0, 1000.0)];
        camera.intrinsics.skew = spread.within(-0.5, 0.5);
        let k3 = if format == Format::MultiCamSelfCal { 0.0 } else { spread.within(-0.02, 0.02) };
        camera.distortion = match format {
            Format::Dlt => Distortion::default(),
            _ => Distortion {
                k1: spread.within(-0.1, 0.1),
                k2: spread.within(-0.05, 0.05),
                p1: spread.within(-2e-3, 2e-3),
                p2: spread.within(-2e-3, 2e-3),
                k3,
            },
        };
        if format == Format::OpenCvStereo && index == 0 {
            camera.camera_from_world = Isometry3::identity();
        }
        let name = match format {
            Format::Caliscope => format!("{}", 10 * index),
            _ => format!("cam{}", index + 1),
        };
        all.push(NamedCamera { name, camera });
    }
    if format == Format::OpenCvStereo {
        all[1].camera.camera_from_world = Isometry3::new(Vector3::new(-0.8, 0.1, 0.2), Vector3::new(0.02, 0.3, -0.1));
    }
    let unit = match format {
        Format::MultiCamSelfCal | Format::Dlt => LengthUnit::Unknown,
        _ => LengthUnit::Metre,
    };
    Calibration::new(all, unit, "a test".into()).unwrap()
}

fn options() -> ImportOptions {
    ImportOptions { image_size: Some([1088, 1920]), ..Default::default() }
}

/// Writes and reads again.
#[track_caller]
fn there_and_back(calibration: &Calibration, format: Format) -> Calibration {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    calibration.export(format).unwrap().write(&out, false).unwrap();
    Calibration::load_with(&out, &options()).unwrap()
}

/// 1,000 points before each camera have the same pixels; all numbers agree to 1e-9 of their size.
#[track_caller]
fn check_same(before: &Calibration, after: &Calibration, what: impl fmt::Display) {
    let names = |it: &Calibration| it.cameras.iter().map(|it| it.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(before), names(after), "{what}");
    let mut spread = Spread(0.3);
    for (NamedCamera { name, camera: a }, NamedCamera { camera: b, .. }) in before.cameras.iter().zip(&after.cameras) {
        assert_eq!(a.image_size, b.image_size, "{what} {name}");
        let close = |x: f64, y: f64, size: f64| (x - y).abs() <= 1e-9 * size;
        for (x, y) in a
            .intrinsics
            .focal
            .iter()
            .chain(&a.intrinsics.principal)
            .zip(b.intrinsics.focal.iter().chain(&b.intrinsics.principal))
        {
            assert!(close(*x, *y, x.abs()), "{what} {name}: {x} {y}");
        }
        assert!(close(a.intrinsics.skew, b.intrinsics.skew, a.intrinsics.focal[0]), "{what} {name}: skew");
        assert!((a.centre() - b.centre()).norm() <= 1e-9 * (1.0 + a.centre().coords.norm()), "{what} {name}: centre");
        let turn = a.camera_from_world.rotation.inverse() * b.camera_from_world.rotation;
        assert!(turn.imag().norm() < 1e-9, "{what} {name}: turned by {}", turn.angle());
        let mut seen = 0;
        for _ in 0..1000 {
            let depth = spread.within(0.5, 8.0);
            let (x, y) = (spread.within(-0.3, 0.3) * depth, spread.within(-0.5, 0.5) * depth);
            let point = a.camera_from_world.inverse_transform_point(&Point3::new(x, y, depth));
            let (Some(p), Some(q)) = (a.project(&point), b.project(&point)) else { continue };
            assert!((p - q).norm() <= 1e-9 * (1.0 + p.coords.norm()), "{what} {name}: {p} {q}");
            seen += 1;
        }
        assert!(seen > 900, "{what} {name}: {seen} of 1000 points seen");
    }
}

#[test]
fn what_a_form_can_hold_comes_back() {
    for format in Format::ALL {
        for seed in 0..20 {
            let count = if format == Format::OpenCvStereo { 2 } else { 3 };
            let before = cameras(format, count, f64::from(seed) / 20.0);
            let after = there_and_back(&before, format);
            check_same(&before, &after, format_args!("{format}, seed {seed}"));
            assert_eq!(after.length_unit, before.length_unit, "{format}");
            // And through our own form once more.
            check_same(&before, &there_and_back(&after, Format::Foveate), format_args!("{format}, then ours"));
        }
    }
}

#[test]
fn one_camera_is_one_file_of_opencv() {
    let before = cameras(Format::OpenCv, 1, 0.1);
    assert!(matches!(before.export(Format::OpenCv).unwrap().content, ExportContent::File(_)));
    check_same(&before, &there_and_back(&before, Format::OpenCv), "one camera");
}

#[test]
fn names_that_need_quoting_come_back() {
    for format in [Format::Pose2Sim, Format::Anipose, Format::Qualisys, Format::Foveate] {
        let mut before = cameras(format, 1, 0.2);
        before.cameras[0].name = "a \"b\" <c> & d\\e'f: ü".into();
        check_same(&before, &there_and_back(&before, format), format);
    }
    let mut one = cameras(Format::OpenCv, 1, 0.2);
    one.cameras[0].name = "a \"b\" <c> & d\\e'f: ü".into();
    check_same(&one, &there_and_back(&one, Format::OpenCv), "OpenCV");
}

#[test]
fn an_unknown_unit_stays_unknown_or_is_refused() {
    for format in Format::ALL.into_iter().filter(|it| *it != Format::OpenCvStereo) {
        let before = Calibration { length_unit: LengthUnit::Unknown, ..cameras(format, 2, 0.4) };
        match format {
            Format::Caliscope | Format::Qualisys => {
                let error = before.export(format).unwrap_err().to_string();
                assert!(error.contains("lengths of unknown unit"), "{error}");
            }
            _ => assert_eq!(there_and_back(&before, format).length_unit, LengthUnit::Unknown, "{format}"),
        }
    }
}

#[test]
fn a_unit_that_is_named_makes_metres() {
    let before = Calibration { length_unit: LengthUnit::Unknown, ..cameras(Format::OpenCv, 2, 0.4) };
    let folder = tempfile::tempdir().unwrap();
    before.export(Format::OpenCv).unwrap().write(folder.path(), false).unwrap();
    let options = ImportOptions { metres_per_unit: Some(1e-3), ..options() };
    let after = Calibration::load_with(folder.path(), &options).unwrap();
    assert_eq!(after.length_unit, LengthUnit::Metre);
    for (a, b) in before.cameras.iter().zip(&after.cameras) {
        assert!((a.camera.centre().coords * 1e-3 - b.camera.centre().coords).norm() < 1e-12);
    }
    let again = folder.path().join("again.toml");
    after.export(Format::Foveate).unwrap().write(&again, false).unwrap();
    let error = Calibration::load_with(&again, &options).unwrap_err().to_string();
    assert!(error.contains("lengths in metres, and another unit asked for"), "{error}");
    let options = ImportOptions { metres_per_unit: Some(f64::NAN), ..options };
    assert!(Calibration::load_with(folder.path(), &options).unwrap_err().to_string().contains("a unit of NaN m"));
}

#[test]
fn what_is_lost_is_said_with_its_size_in_pixels() {
    let mut full = cameras(Format::Foveate, 2, 0.7);
    full.provenance = Some(Provenance::default());
    full.uncertainties.insert("cam1".into(), CameraUncertainty::default());
    full.clocks.0.insert("cam2".into(), Default::default());
    let axis = Axis::through_origin(Vector3::y()).unwrap();
    let head = Head {
        pan: axis,
        tilt: axis,
        stacking: Default::default(),
        limits: Limits::WIDE,
        units: [AxisUnits::DEGREES; 2],
        zoom: None,
        covariance: None,
    };
    full.heads.0.insert("cam2".into(), head);
    let lost = |calibration: &Calibration, format| calibration.export(format).unwrap().lost.join("\n");
    assert_eq!(lost(&full, Format::Foveate), "");
    for format in Format::ALL.into_iter().filter(|it| *it != Format::Foveate) {
        let lost = lost(&full, format);
        for word in
            ["the provenance", "the uncertainty of 1 cameras", "the clocks of 1 cameras", "the heads of 1 cameras"]
        {
            assert!(lost.contains(word), "{format}: {word} is not in\n{lost}");
        }
    }
    // Each format's own losses, the size being what a projection without the term says.
    for format in [Format::Pose2Sim, Format::Anipose, Format::Caliscope, Format::OpenCv, Format::OpenCvStereo] {
        assert!(lost(&full, format).contains("the skew of"), "{format}");
    }
    assert!(lost(&full, Format::MultiCamSelfCal).contains("camera \"cam1\": k3 of "));
    assert!(lost(&full, Format::Dlt).contains("camera \"cam1\": all distortion, up to "));
    assert!(lost(&full, Format::OpenCvStereo).contains("the place of the pair"));
    assert!(lost(&full, Format::Caliscope).contains("the name \"cam1\": camera 0 there"));
    let mut plain = full.clone();
    plain.cameras.iter_mut().for_each(|it| it.camera.distortion = Distortion::default());
    plain.cameras[0].camera.distortion.k1 = 0.1;
    let camera = &plain.cameras[0].camera;
    let corner = [[0.0, 0.0], [1087.0, 0.0], [0.0, 1919.0], [1087.0, 1919.0]].map(|corner| {
        let ideal = camera.normalise(&Point2::from(corner)).unwrap();
        let Intrinsics { focal, skew, .. } = camera.intrinsics;
        let moved = ideal * 0.1 * ideal.norm_squared();
        Vector3::new(focal[0] * moved.x + skew * moved.y, focal[1] * moved.y, 0.0).norm()
    });
    let expected = format!("all distortion, up to {:.3} px", corner.iter().fold(0.0, |a: f64, b| a.max(*b)));
    assert!(lost(&plain, Format::Dlt).contains(&expected), "{expected}: {}", lost(&plain, Format::Dlt));
}

#[test]
fn what_a_form_cannot_say_is_refused() {
    let refusal = |calibration: &Calibration, format| calibration.export(format).unwrap_err().to_string();
    assert!(refusal(&cameras(Format::Foveate, 3, 0.1), Format::OpenCvStereo).contains("there are 3 cameras"));
    let mut odd = cameras(Format::Foveate, 2, 0.1);
    odd.cameras[0].name = "a/b".into();
    for format in [Format::OpenCv, Format::MultiCamSelfCal] {
        assert!(refusal(&odd, format).contains("camera \"a/b\": a name that no file can have"), "{format}");
    }
    odd.cameras[0].name = "a\u{1}b".into();
    assert!(refusal(&odd, Format::Qualisys).contains("a name that XML cannot hold"));
    odd.cameras[1].camera.camera_from_world.translation.z = 0.0;
    assert!(refusal(&odd, Format::Dlt).contains("camera \"cam2\": the world's origin lies in the plane"));
    odd.cameras[1].camera.image_size = [640, 480];
    assert!(refusal(&odd, Format::OpenCvStereo).contains("one size for both cameras"));
}

#[test]
fn nothing_is_overwritten_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = cameras(Format::Foveate, 2, 0.1);
    let file = folder.path().join("a.toml");
    let own = calibration.export(Format::Foveate).unwrap();
    own.write(&file, false).unwrap();
    assert_eq!(own.write(&file, false).unwrap_err().kind(), ErrorKind::AlreadyExists);
    own.write(&file, true).unwrap();
    let result = calibration.export(Format::MultiCamSelfCal).unwrap();
    assert_eq!(result.write(folder.path(), false).unwrap_err().kind(), ErrorKind::AlreadyExists);
    assert!(!folder.path().join("Res.dat").exists());
}

/// The text of the one file that `format` makes of one camera (two, for a pair).
fn text_of(format: Format) -> String {
    let count = if format == Format::OpenCvStereo { 2 } else { 1 };
    match cameras(format, count, 0.3).export(format).unwrap().content {
        ExportContent::File(text) => text,
        ExportContent::Folder(_) => unreachable!("one file"),
    }
}

/// The error for a file of this content.
#[track_caller]
fn refusal(text: &str, options: &ImportOptions) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("given.any");
    fs::write(&path, text).unwrap();
    let error = Calibration::load_with(&path, options).unwrap_err().to_string();
    assert!(error.contains("given.any"), "{error}");
    error
}

/// Replaces what stands from `from` to the end of its line.
fn with_line(text: &str, from: &str, to: &str) -> String {
    let at = text.find(from).unwrap_or_else(|| panic!("{from} is not in\n{text}"));
    let end = text[at..].find('\n').map_or(text.len(), |it| at + it);
    format!("{}{to}{}", &text[..at], &text[end..])
}

#[test]
fn malformed_opencv_files_are_refused_with_their_place() {
    let good = text_of(Format::OpenCv);
    let after = |from: &str, text: &str, to: &str| {
        let at = good.find(from).unwrap();
        format!("{}{}", &good[..at], with_line(&good[at..], text, to))
    };
    let r = "R: !!opencv-matrix";
    for (text, expected) in [
        (
            after("camera_matrix", "data:", "data: [ 1, 2, 3 ]"),
            "any:7:1: camera \"cam1\": camera_matrix of 3 x 3 holds 3 numbers",
        ),
        (
            after("camera_matrix", "data:", "data: [ 1, 0, 2, 0, .Nan, 2, 0, 0, 1 ]"),
            "camera_matrix holds .Nan, expected finite",
        ),
        (
            after("camera_matrix", "data:", "data: [ 0, 0, 2, 0, 1, 2, 0, 0, 1 ]"),
            "camera_matrix is 3 x 3 [0, 0, 2, 0, 1",
        ),
        (after("camera_matrix", "rows:", "rows: many"), "camera_matrix without rows and cols"),
        (
            after("camera_matrix", "rows:", "rows: 18446744073709551615"),
            "holds 9 numbers, expected as many as rows times cols",
        ),
        (after("distortion_coefficients", "data:", "data: [ 1, 2, 3, 4, 5, 6"), "without its closing bracket"),
        (good.replace("image_height", "height"), "no image size"),
        (with_line(&good, "image_width", "image_width: 0"), "an image of 0 x 1920 px"),
        (with_line(&good, "image_width", "image_width: 1.5"), "an image of 1.5 x 1920 px"),
        (after(r, "data:", "data: [ 1, 0, 0, 0, 1, 0, 0, 0, 2 ]"), "R is no rotation: RᵀR is off 1 by 3.0e0"),
        (after(r, "data:", "data: [ 1, 0, 0, 0, 1, 0, 0, 0, -1 ]"), "R is a reflection"),
        (after("T: ", "rows: 3", "rows: 1"), "T of 1 x 1 holds 3 numbers"),
        (good.replace("T: !!", "Q: !!"), "a lens without a pose (no R and T)"),
        (good.replace("camera_matrix:", "P:"), "no camera_matrix, expected 3 x 3 numbers"),
        (good.clone() + "fisheye_model: 1\n", "fisheye_model is set"),
        (good.clone() + "nonsense\n", "a line \"nonsense\", expected `key: value`"),
    ] {
        let error = refusal(&text, &ImportOptions::default());
        assert!(error.contains(expected), "{expected}:\n{error}\n{text}");
    }
    let many = |count: usize| {
        let zeros = vec!["0.1"; count].join(", ");
        let at = good.find("distortion_coefficients").unwrap();
        let lens = with_line(&good[at..], "rows: 5", &format!("rows: {count}"));
        format!("{}{}", &good[..at], with_line(&lens, "data:", &format!("data: [ {zeros} ]")))
    };
    assert!(refusal(&many(8), &options()).contains("is a model of 8 coefficients, of which number 6 is not 0"));
    assert!(refusal(&many(3), &options()).contains("distortion_coefficients has 3 coefficients"));
    // Every prefix of the file gives an error or a calibration, never a panic.
    for end in (0..good.len()).step_by(7) {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("cut.yml"), &good[..end]).unwrap();
        drop(Calibration::load_with(&folder.path().join("cut.yml"), &options()));
    }
}

/// As OpenCV 5 writes it, which calls its YAML 1.2: wrapped numbers, other matrices, comments, nested lists and maps.
#[test]
fn what_opencv_writes_beside_the_camera_is_passed_over() {
    let text = r#"%YAML 1.2
---
calibration_time: "Sat Nov 21 15:00:00 2026"
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500.125, 0., 320.5, 0.,
       501.5, 240.25, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.10000000000000001, 0.01, 0.001, -0.002,
       0.003 ]
image_points: !!opencv-matrix
   rows: 1
   cols: 2
   dt: "2f"
   data: [ 0.245392323, 0.622864902, 0.791483223, .Nan ]
# a comment: [ odd
views:
   - "a.png"
   - { x:1, y:[ 2, 3 ] }
m:
   x: 1
rvec: [ 0., 0., 1.5707963267948966 ]
tvec: [ 1., 2., 3. ]
"#;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("left.yml");
    fs::write(&path, text).unwrap();
    let calibration = Calibration::load(&path).unwrap();
    let camera = calibration.camera("left").unwrap();
    assert_eq!((camera.intrinsics.focal, camera.intrinsics.principal), ([500.125, 501.5], [320.5, 240.25]));
    assert_eq!(camera.distortion, Distortion { k1: -0.1, k2: 0.01, p1: 0.001, p2: -0.002, k3: 0.003 });
    // A quarter turn about Z takes the world's X to the camera's Y.
    let in_camera = camera.camera_from_world * Point3::new(1.0, 0.0, 0.0);
    assert!((in_camera - Point3::new(1.0, 3.0, 3.0)).norm() < 1e-12, "{in_camera}");
}

#[test]
fn a_pair_finds_its_extrinsics_beside_it() {
    let text = text_of(Format::OpenCvStereo);
    let at = text.find("R: !!").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("intrinsics.yml");
    fs::write(&path, &text[..at]).unwrap();
    let error = Calibration::load(&path).unwrap_err().to_string();
    assert!(error.contains("a pair without R and T"), "{error}");
    fs::write(folder.path().join("extrinsics.yml"), format!("%YAML:1.0\n---\n{}", &text[at..])).unwrap();
    check_same(&cameras(Format::OpenCvStereo, 2, 0.3), &Calibration::load(&path).unwrap(), "two files");
    assert!(refusal(&text.replace("M2:", "M3:"), &options()).contains("camera \"cam2\": no camera_matrix2"));
}

#[test]
fn a_pair_anywhere_keeps_how_its_cameras_stand_to_each_other() {
    let before = cameras(Format::Foveate, 2, 0.3);
    let after = there_and_back(&before, Format::OpenCvStereo);
    let between = |it: &Calibration| {
        let [one, two] = [0, 1].map(|index| it.cameras[index].camera.camera_from_world);
        two * one.inverse()
    };
    assert_eq!(after.cameras[0].camera.camera_from_world, Isometry3::identity());
    assert!((between(&before).to_homogeneous() - between(&after).to_homogeneous()).amax() < 1e-9);
}

#[test]
fn a_lens_alone_stands_at_the_origin_when_asked() {
    let good = text_of(Format::OpenCv);
    let text = &good[..good.find("R: !!").unwrap()];
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.yml"), text).unwrap();
    let asked = ImportOptions { lenses_at_origin: true, ..Default::default() };
    let lens = Calibration::load_with(&folder.path().join("a.yml"), &asked).unwrap();
    assert_eq!(lens.cameras[0].camera.camera_from_world, Isometry3::identity());
}

#[test]
fn malformed_qualisys_files_are_refused_with_their_place() {
    let good = text_of(Format::Qualisys);
    let attribute = |name: &str, to: &str| {
        let at = good.find(&format!(" {name}=\"")).unwrap() + name.len() + 3;
        let end = at + good[at..].find('"').unwrap();
        format!("{}{to}{}", &good[..at], &good[end..])
    };
    for (text, expected) in [
        (good[..good.len() - 20].to_owned(), "this is not XML ("),
        (attribute("focalLengthU", "nan"), "focalLengthU is \"nan\", expected a finite number"),
        (attribute("focalLengthU", "0"), "focal lengths of 0 and "),
        (attribute("serial", ""), "a camera without serial"),
        (attribute("r11", "3"), "the transform is no rotation"),
        (good.replace(" y=\"", " why=\""), "transform without y"),
        (good.replace("<intrinsic ", "<extrinsic "), "a camera without <intrinsic>"),
        (good.replace("right=\"1087\"", "right=\"-1\""), "a field of view of 0 x 1920 px"),
        (good.replace("<camera ", "<camcorder ").replace("</camera>", "</camcorder>"), "there are 0 cameras"),
        ("<rooms/>".into(), "XML with the root <rooms>, expected a calibration: TOML of ours"),
    ] {
        let error = refusal(&text, &ImportOptions::default());
        assert!(error.contains(expected), "{expected}:\n{error}\n{text}");
    }
    let flipped = ["r31", "r32", "r33"].iter().fold(good.clone(), |text, key| {
        text.replace(&format!("{key}=\"-"), &format!("{key}=\"+"))
            .replace(&format!("{key}=\""), &format!("{key}=\"-"))
            .replace("\"-+", "\"")
    });
    assert!(refusal(&flipped, &options()).contains("the transform is a reflection"), "{flipped}");
}

#[test]
fn malformed_tables_of_coefficients_are_refused_with_their_place() {
    let good = text_of(Format::Dlt);
    for (text, expected) in [
        (with_line(&good, good.lines().nth(2).unwrap(), "nan"), "any:3:1: \"nan\" among the coefficients"),
        (with_line(&good, good.lines().nth(2).unwrap(), "1,x"), "any:3:1: \"x\" among the coefficients"),
        (with_line(&good, good.lines().nth(2).unwrap(), "1 2"), "any:3:1: 2 numbers after rows of 1"),
        (good.lines().take(9).collect::<Vec<_>>().join("\n"), "9 rows of 1 numbers, expected the 11 rows"),
        ("0\n".repeat(11), "camera \"cam1\": the left 3x3 half of the projection matrix is singular"),
    ] {
        let error = refusal(&text, &options());
        assert!(error.contains(expected), "{expected}:\n{error}");
    }
    let error = refusal(&good, &ImportOptions::default());
    assert!(error.contains("DLT coefficients, which hold no image size"), "{error}");
}

#[test]
fn pixels_of_coefficients_count_from_the_corner_that_is_named() {
    // By hand: u = 100 X / Z + 50 + 1 and v = 200 Y / Z + 60 + 1, from the top left; the world's origin 2 in front.
    let text = "50\n0\n25.5\n51\n0\n100\n30.5\n61\n0\n0\n0.5\n";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dlt.csv");
    fs::write(&path, text).unwrap();
    let pixel = |dlt_origin| {
        let options = ImportOptions { image_size: Some([100, 120]), dlt_origin, ..Default::default() };
        let calibration = Calibration::load_with(&path, &options).unwrap();
        calibration.cameras[0].camera.project(&Point3::new(0.2, 0.1, 0.0))
    };
    assert!((pixel(DltOrigin::TopLeft).unwrap() - Point2::new(60.0, 70.0)).norm() < 1e-9);
    // Counted from below, row 71 of 120 is row 49 from above; the mirror image puts what is before the camera behind it.
    assert_eq!(pixel(DltOrigin::BottomLeft), None);
    fs::write(&path, "50\n0\n25.5\n51\n0\n-100\n30.5\n61\n0\n0\n0.5\n").unwrap();
    assert!((pixel(DltOrigin::BottomLeft).unwrap() - Point2::new(60.0, 120.0 - 51.0)).norm() < 1e-9);
}

#[test]
fn malformed_caliscope_and_pose2sim_files_are_refused_with_their_place() {
    let good = text_of(Format::Caliscope);
    for (text, expected) in [
        (with_line(&good, "rotation = ", "rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 3]]"), "rotation is no rotation"),
        (with_line(&good, "rotation = ", "rotation = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]"), "rotation is a reflection"),
        (with_line(&good, "rotation = ", "rotation = [[1, 0], [0, 1]]"), "expected 3 numbers, or 3 rows of 3 numbers"),
        (with_line(&good, "distortions = ", "distortions = [0, 0, 0]"), "distortions has 3 coefficients"),
        (with_line(&good, "distortions = ", "distortions = [0, 0, 0, 0, 0, 1, 0, 0]"), "is a model of 8 coefficients"),
        (with_line(&good, "translation = ", ""), "translation is missing"),
        (with_line(&good, "ignore = ", "ignore = true"), "there are 0 cameras"),
        (good[..good.len() / 2].to_owned(), "given.any:"),
    ] {
        let error = refusal(&text, &ImportOptions::default());
        assert!(error.contains(expected), "{expected}:\n{error}\n{text}");
    }
}

#[test]
fn what_is_no_calibration_is_told_what_was_looked_for() {
    for text in ["", "P6\n640 480\n255\n", "{ \"camera\": 1 }", "camera 1: left of the door"] {
        let error = refusal(text, &options());
        assert!(error.contains("TOML of ours") && error.contains("<opencv_storage>"), "{error}");
    }
    let folder = tempfile::tempdir().unwrap();
    let error = Calibration::load(folder.path()).unwrap_err().to_string();
    assert!(error.contains("a folder without Pmatrices.dat, and without .yml"), "{error}");
}

/// The file `name` of the recordings, unless this machine has none.
fn real(name: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("FOVEATE_DATA") else {
        println!("skipped: FOVEATE_DATA is not set");
        return None;
    };
    let path = Path::new(&folder).join(name);
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
    }
    path.exists().then_some(path)
}

/// The data set holds the calibration of Qualisys and what Pose2Sim made of it: the same but for the lens, 64 times weaker there.
#[test]
fn a_real_qualisys_file_is_its_pose2sim_twin_with_the_lens_as_it_was() {
    let (Some(xml), Some(toml)) =
        (real("s06_pose2sim_single/Calib.qca.txt"), real("s06_pose2sim_single/Calib_qualisys.toml"))
    else {
        return;
    };
    let (theirs, twin) = (Calibration::load(&xml).unwrap(), Calibration::load(&toml).unwrap());
    assert_eq!((theirs.cameras.len(), theirs.length_unit), (4, LengthUnit::Metre));
    for (a, b) in theirs.cameras.iter().zip(&twin.cameras) {
        let (a, b) = (&a.camera, &b.camera);
        assert_eq!(a.image_size, b.image_size);
        for index in 0..2 {
            assert!((a.intrinsics.focal[index] - b.intrinsics.focal[index]).abs() < 1e-6);
            // Pose2Sim turned and moved its image's centre by rounding only.
            assert!((a.intrinsics.principal[index] - b.intrinsics.principal[index]).abs() < 0.01);
        }
        assert!((a.centre() - b.centre()).norm() < 1e-5, "{} {}", a.centre(), b.centre());
        assert!(a.camera_from_world.rotation.angle_to(&b.camera_from_world.rotation) < 1e-5);
        assert!((a.distortion.k1 / 64.0 - b.distortion.k1).abs() < 1e-7);
        assert!((a.distortion.p2 / 64.0 - b.distortion.p2).abs() < 1e-7);
    }
    check_same(&theirs, &there_and_back(&theirs, Format::Qualisys), "the real file again");
    check_same(&twin, &there_and_back(&twin, Format::Pose2Sim), "its twin again");
}

#[test]
fn both_generations_of_a_real_caliscope_file_say_the_same() {
    let (Some(new), Some(old)) =
        (real("s16_caliscope_4cam_charuco/camera_array.toml"), real("s16_caliscope_4cam_charuco/config.toml"))
    else {
        return;
    };
    let (new, old) = (Calibration::load(&new).unwrap(), Calibration::load(&old).unwrap());
    let names: Vec<&str> = new.cameras.iter().map(|it| it.name.as_str()).collect();
    assert_eq!((names, new.length_unit), (vec!["0", "1", "2", "3"], LengthUnit::Metre));
    assert_eq!(new.cameras, old.cameras);
    check_same(&new, &there_and_back(&new, Format::Caliscope), "caliscope");
}

/// The hand-clicked pose there is some 5 px off; the refined one, kept beside it, is what it should be near.
#[test]
fn a_real_opencv_xml_puts_the_board_s_camera_near_its_refined_place() {
    let Some(path) = real("s05_voxel_4cam_seated/data/cam1/config.xml") else { return };
    let options = ImportOptions { image_size: Some([644, 486]), metres_per_unit: Some(1e-3), ..Default::default() };
    let calibration = Calibration::load_with(&path, &options).unwrap();
    let camera = &calibration.cameras[0].camera;
    assert!((camera.intrinsics.focal[0] - 490.756439).abs() < 1e-9);
    assert!((camera.distortion.k3 + 0.0712014362).abs() < 1e-12);
    let refined = Isometry3::new(
        Vector3::new(0.213109813, 0.748549327, 4.58776568),
        Vector3::new(-1.34755187, 0.544553621, 0.622654746),
    );
    let refined = Camera { camera_from_world: refined, ..camera.clone() };
    assert!((camera.centre() - refined.centre()).norm() < 1.6, "{} {}", camera.centre(), refined.centre());
    let turn = camera.camera_from_world.rotation.angle_to(&refined.camera_from_world.rotation);
    assert!(turn < 0.1, "{turn}");
    let alone = path.with_file_name("intrinsics.xml");
    let error = Calibration::load_with(&alone, &options).unwrap_err().to_string();
    assert!(error.contains("a lens without a pose"), "{error}");
    let error = Calibration::load(&path).unwrap_err().to_string();
    assert!(error.contains("no image size"), "{error}");
    let board = path.with_file_name("../checkerboard.xml");
    let error = Calibration::load_with(&board, &options).unwrap_err().to_string();
    assert!(error.contains("no camera_matrix"), "{error}");
}

/// Exported again, a real result gives the files' own numbers: the rays of `.cal` and the projections.
#[test]
fn a_real_result_of_multicamselfcal_survives_its_own_form() {
    let Some(folder) = real("s01_arctic_laser_4cam/reference_multicamselfcal") else { return };
    let imported = Calibration::load(&folder).unwrap();
    check_same(&without_k3(&imported), &there_and_back(&without_k3(&imported), Format::MultiCamSelfCal), "arctic");
    // The centres in .cal, but for Z, which its left-handed world turns.
    for NamedCamera { name, camera } in &imported.cameras {
        let text = fs::read_to_string(folder.join(format!("{name}.cal"))).unwrap();
        let value = |key: &str| -> f64 {
            text.lines().find_map(|line| line.strip_prefix(key)?.split_once('=')?.1.trim().parse().ok()).unwrap()
        };
        let theirs = Point3::new(value("C1 "), value("C2 "), -value("C3 "));
        assert!((camera.centre() - theirs).norm() < 1e-4, "{name}: {} {theirs}", camera.centre());
    }
}

fn without_k3(calibration: &Calibration) -> Calibration {
    let mut changed = calibration.clone();
    changed.cameras.iter_mut().for_each(|it| it.camera.distortion.k3 = 0.0);
    changed
}

/// `.cal` holds C and the inverse of P's left half: checked on a result of the original program, to its six digits.
#[test]
fn rays_in_cal_files_are_the_inverse_of_the_projection() {
    let Some(folder) = real("s01_arctic_laser_4cam/reference_multicamselfcal") else { return };
    let numbers: Vec<f64> = fs::read_to_string(folder.join("Pmatrices.dat"))
        .unwrap()
        .split_whitespace()
        .take(12)
        .map(|it| it.parse().unwrap())
        .collect();
    let left = nalgebra::Matrix3::from_fn(|row, column| numbers[4 * row + column]);
    let inverse = left.try_inverse().unwrap();
    let text = fs::read_to_string(folder.join("arctic1.cal")).unwrap();
    for (row, column) in (0..9).map(|it| (it / 3, it % 3)) {
        let key = format!("P{}{} =", row + 1, column + 1);
        let value: f64 = text.lines().find_map(|line| line.strip_prefix(&key)?.trim().parse().ok()).unwrap();
        assert!((value - inverse[(row, column)]).abs() < 2e-6, "{key} {value} {}", inverse[(row, column)]);
    }
}

#[test]
fn the_rays_that_are_written_are_the_inverse_of_the_projection_that_is_written() {
    let ExportContent::Folder(files) =
        cameras(Format::MultiCamSelfCal, 1, 0.6).export(Format::MultiCamSelfCal).unwrap().content
    else {
        unreachable!("a folder");
    };
    let text = |name: &str| files.iter().find(|it| it.0 == name).unwrap().1.as_str();
    let p: Vec<f64> = text("Pmatrices.dat").split_whitespace().map(|it| it.parse().unwrap()).collect();
    let (left, last) = (nalgebra::Matrix3::from_fn(|row, column| p[4 * row + column]), Vector3::new(p[3], p[7], p[11]));
    let cal: Vec<f64> =
        text("cam1.cal").lines().filter_map(|line| line.split_once('=')?.1.trim().parse().ok()).collect();
    let (centre, rays) = (Vector3::new(cal[0], cal[1], cal[2]), nalgebra::Matrix3::from_row_slice(&cal[3..]));
    assert!((left * rays - nalgebra::Matrix3::identity()).amax() < 1e-9);
    assert!((left * centre + last).norm() < 1e-6 * last.norm());
}
