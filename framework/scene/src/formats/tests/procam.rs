//! A camera and a projector in one file, as scanners write them.

use super::*;

/// In the names of Brown University's scanner, lengths in millimetres.
const BROWN: &str = "%YAML:1.0\n---\n\
cam_K: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 2400., 0., 640., 0., 2410., 500., 0., 0., 1. ]\n\
cam_kc: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.1, 0.2, 1e-3, -2e-3, 0. ]\n\
proj_K: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 2000., 0., 511., 0., 2005., 760., 0., 0., 1. ]\n\
proj_kc: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ 0.01, 0., 0., 0., 0. ]\n\
R: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1., 0., 0., 0., 0.8, -0.6, 0., 0.6, 0.8 ]\n\
T: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [ 100., -20., 30. ]\n\
cam_error: 0.2\nproj_error: 0.3\nstereo_error: 0.4\n";

fn load(text: &str, options: &ImportOptions) -> Result<Calibration, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("calibration.yml");
    fs::write(&path, text).unwrap();
    Calibration::load_with(&path, options).map_err(|error| error.to_string())
}

fn sizes() -> ImportOptions {
    ImportOptions {
        image_size: Some([1280, 1024]),
        projector_size: Some([1024, 768]),
        metres_per_unit: Some(1e-3),
        ..ImportOptions::default()
    }
}

#[test]
fn a_camera_and_its_projector_are_read_under_their_names() {
    let read = load(BROWN, &sizes()).unwrap();
    let (camera, projector) = (read.camera("camera").unwrap(), read.camera("projector").unwrap());
    assert_eq!((camera.image_size, projector.image_size), ([1280, 1024], [1024, 768]));
    assert_eq!((camera.intrinsics.focal, projector.intrinsics.principal), ([2400.0, 2410.0], [511.0, 760.0]));
    assert_eq!((camera.distortion.p2, projector.distortion.k1), (-2e-3, 0.01));
    assert_eq!(camera.camera_from_world, nalgebra::Isometry3::identity());
    // x' = R x + T: what the projector has of a point that the camera has at (0, 0, 1 m).
    let place = projector.camera_from_world * nalgebra::Point3::new(0.0, 0.0, 1.0);
    assert!((place.coords - Vector3::new(0.1, -0.62, 0.83)).norm() < 1e-9, "{place}");
    let other = [("cam_K", "cam_int"), ("cam_kc", "cam_dist"), ("proj_K", "proj_int"), ("proj_kc", "proj_dist")];
    let text = other.iter().fold(BROWN.to_owned(), |text, (from, to)| text.replace(from, to));
    let text = text.replace("\nR:", "\nrotation:").replace("\nT:", "\ntranslation:");
    assert_eq!(load(&text, &sizes()).unwrap().camera("projector"), Some(projector));
    let in_full = [
        ("cam_K", "camera_matrix"),
        ("cam_kc", "camera_dist"),
        ("proj_K", "projector_matrix"),
        ("proj_kc", "projector_dist"),
    ];
    let text = in_full.iter().fold(BROWN.to_owned(), |text, (from, to)| text.replace(from, to));
    let read = load(&text, &sizes()).unwrap();
    assert_eq!((read.camera("camera"), read.camera("projector")), (Some(camera), Some(projector)));
    // A pair whose second camera is a projector.
    let numbered = [("cam_K", "M1"), ("cam_kc", "D1"), ("proj_K", "M2"), ("proj_kc", "D2")];
    let text = numbered.iter().fold(BROWN.to_owned(), |text, (from, to)| text.replace(from, to));
    let read = load(&text, &sizes()).unwrap();
    assert_eq!(["cam1", "cam2"].map(|it| read.camera(it).unwrap().image_size), [[1280, 1024], [1024, 768]]);
}

#[test]
fn what_is_not_said_of_a_projector_is_asked_for() {
    let fault = load(BROWN, &ImportOptions { projector_size: None, ..sizes() }).unwrap_err();
    assert!(fault.contains("no size of the projector") && fault.contains("--projector-size"), "{fault}");
    let said = format!("{BROWN}proj_size: [ 800, 600 ]\n");
    let read = load(&said, &ImportOptions { projector_size: None, ..sizes() }).unwrap();
    assert_eq!(read.camera("projector").unwrap().image_size, [800, 600]);
    for (name, there) in [("proj_K", "camera"), ("cam_K", "projector")] {
        let fault = load(&BROWN.replace(name, "other_K"), &sizes()).unwrap_err();
        let expected = format!("the lens of a {there} alone, of a camera and a projector (no {name})");
        assert!(fault.contains(&expected), "{fault}");
    }
    let fault = load(&BROWN.replace("\nT:", "\nQ:"), &sizes()).unwrap_err();
    assert!(fault.contains("without R and T"), "{fault}");
}

/// `calibration_result.xml` of `kamino410/procam-calibration`: a size as NumPy has it, and a word that is misspelt.
#[test]
fn the_file_of_a_calibration_by_kamino410_is_read_as_it_is() {
    let matrix = |name: &str, rows: usize, numbers: &str| {
        let columns = numbers.split_whitespace().count() / rows;
        format!(
            "<{name} type_id=\"opencv-matrix\">\n  <rows>{rows}</rows>\n  <cols>{columns}</cols>\n  <dt>d</dt>\n  <data>\n    {numbers}</data></{name}>\n"
        )
    };
    let text = [
        "<?xml version=\"1.0\"?>\n<opencv_storage>\n".to_owned(),
        matrix("img_shape", 2, "1024. 1280."),
        "<rms>4.25e-01</rms>\n".to_owned(),
        matrix("cam_int", 3, "3450. 0. 590. 0. 3440. 520. 0. 0. 1."),
        matrix("cam_dist", 1, "-0.2 -0.8 -7e-4 -1.6e-3 3.1"),
        matrix("proj_int", 3, "1940. 0. 450. 0. 1930. 720. 0. 0. 1."),
        matrix("proj_dist", 1, "-0.09 1.1 -2e-3 -9e-3 -7.8"),
        matrix("roration", 3, "1. 0. 0. 0. 0.8 -0.6 0. 0.6 0.8"),
        matrix("translation", 3, "39. -278. -62."),
        "</opencv_storage>\n".to_owned(),
    ];
    let read = load(&text.concat(), &ImportOptions { image_size: None, ..sizes() }).unwrap();
    let (camera, projector) = (read.camera("camera").unwrap(), read.camera("projector").unwrap());
    assert_eq!((camera.image_size, projector.image_size), ([1280, 1024], [1024, 768]));
    assert_eq!((camera.distortion.k3, projector.distortion.k3), (3.1, -7.8));
    let shift = projector.camera_from_world.translation.vector;
    assert!((shift - Vector3::new(0.039, -0.278, -0.062)).norm() < 1e-12, "{shift}");
}
