//! What is malformed is refused with its place, and what others write beside a camera is passed over.

use super::*;

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
fn a_long_file_of_another_kind_is_one_fault_that_names_the_forms() {
    let program: String = (0..500).map(|it| format!("def f{it}(x):\n    y = x ** {it}\n    return y, x\n")).collect();
    let nearly: String = (0..500).map(|it| format!("[part {it}]\nvalue = it is {it}\n")).collect();
    let folder = tempfile::tempdir().unwrap();
    let fault = |text: &str| {
        let path = folder.path().join("given.any");
        fs::write(&path, text).unwrap();
        let faults = Calibration::load(&path).unwrap_err().faults;
        assert_eq!(faults.len(), 1);
        faults[0].clone()
    };
    assert_eq!((fault(&program).expected.as_str(), fault(&program).place), (CALIBRATION_FORMS, None));
    assert_eq!((fault(&nearly).expected.as_str(), fault(&nearly).place), ("a TOML file", Some((1, 6))));
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
