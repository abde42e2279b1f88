//! Round trips through every form.

mod malformed;
mod opencv5;
mod procam;
mod real;
mod rings;

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
        for _ in 0..200 {
            let depth = spread.within(0.5, 8.0);
            let (x, y) = (spread.within(-0.3, 0.3) * depth, spread.within(-0.5, 0.5) * depth);
            let point = a.camera_from_world.inverse_transform_point(&Point3::new(x, y, depth));
            let (Some(p), Some(q)) = (a.project(&point), b.project(&point)) else { continue };
            assert!((p - q).norm() <= 1e-9 * (1.0 + p.coords.norm()), "{what} {name}: {p} {q}");
            seen += 1;
        }
        assert!(seen > 180, "{what} {name}: {seen} of 200 points seen");
    }
}

#[test]
fn what_a_form_can_hold_comes_back() {
    for format in Format::ALL {
        for seed in 0..5 {
            let count = if format == Format::OpenCvStereo { 2 } else { 3 };
            let before = cameras(format, count, f64::from(seed) / 5.0);
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
    assert!(error.contains("metres"), "{error}");
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
