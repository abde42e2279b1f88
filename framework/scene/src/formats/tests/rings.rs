//! Cameras of single pictures: Middlebury's tables and COLMAP's text models.

use nalgebra::{Point2, Point3};

use super::*;

const TABLE: &str = "2\n\
ring0001.png 1500 0 320 0 1510 240 0 0 1 1 0 0 0 0 -1 0 1 0 0.1 -0.2 0.5\n\
ring0002.png 3000 0 640 0 3020 480 0 0 2 0 1 0 0 0 -1 -1 0 0 0 0 0.6\n";

fn in_folder(files: &[(&str, &[u8])], read: &str, options: &ImportOptions) -> Result<Calibration, String> {
    let folder = tempfile::tempdir().unwrap();
    files.iter().for_each(|(name, bytes)| fs::write(folder.path().join(name), bytes).unwrap());
    Calibration::load_with(&folder.path().join(read), options).map_err(|error| error.to_string())
}

fn png(columns: u32, rows: u32) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    bytes.extend(columns.to_be_bytes().into_iter().chain(rows.to_be_bytes()));
    bytes
}

#[track_caller]
fn check_pixel(calibration: &Calibration, name: &str, point: [f64; 3], expected: [f64; 2]) {
    let pixel = calibration.camera(name).unwrap().project(&Point3::from(point)).unwrap();
    assert!((pixel - Point2::from(expected)).norm() < 1e-9, "{pixel}, expected {expected:?}");
}

#[test]
fn a_table_of_middlebury_is_read_with_the_size_of_the_picture_beside_it() {
    let picture = png(640, 480);
    let files: [(&str, &[u8]); 3] =
        [("a_par.txt", TABLE.as_bytes()), ("ring0001.png", &picture), ("ring0002.png", &picture)];
    let read = in_folder(&files, "a_par.txt", &ImportOptions::default()).unwrap();
    assert_eq!(read.camera("ring0002").unwrap().image_size, [640, 480]);
    assert_eq!(read.length_unit, LengthUnit::Unknown);
    // K (R X + t) by hand: R X + t = (0.4, -0.7, 0.7).
    check_pixel(&read, "ring0001", [0.3, 0.2, 0.5], [320.0 + 1500.0 * 0.4 / 0.7, 240.0 - 1510.0]);
    // A K that is not divided by its last element; R X + t = (0.2, -0.5, 0.3).
    check_pixel(&read, "ring0002", [0.3, 0.2, 0.5], [320.0 + 1500.0 * 0.2 / 0.3, 240.0 - 1510.0 * 0.5 / 0.3]);
    let refused = in_folder(&files[..1], "a_par.txt", &ImportOptions::default()).unwrap_err();
    assert!(refused.contains("--image-size"), "{refused}");
    let told = ImportOptions { image_size: Some([800, 600]), ..ImportOptions::default() };
    assert_eq!(in_folder(&files[..1], "a_par.txt", &told).unwrap().cameras.len(), 2);
}

#[test]
fn faults_of_a_table_are_named_with_their_lines() {
    let told = ImportOptions { image_size: Some([640, 480]), ..ImportOptions::default() };
    for (text, expected) in [
        (TABLE.replace("2\n", "3\n"), "a_par.txt:1:1: 2 pictures, expected 3"),
        (TABLE.replace("0 0 2 0 1 0 0 0 -1", "0 0 2 0 1 0 0 x -1"), "a_par.txt:3:1"),
        (TABLE.replace("0 0 1 1 0 0 0 0 -1 0 1 0", "0 0 1 2 0 0 0 0 -1 0 1 0"), "a rotation matrix"),
    ] {
        let refused = in_folder(&[("a_par.txt", text.as_bytes())], "a_par.txt", &told).unwrap_err();
        assert!(refused.contains(expected), "{refused}");
    }
}

const LENSES: &str =
    "# Camera list\n1 SIMPLE_RADIAL 640 480 500 320 240 -0.1\n7 OPENCV 640 480 500 510 321 241 0.1 0.02 0.001 -0.002\n";
const POSES: &str = "# Image list\n1 1 0 0 0 0 0 2 1 ring/a.png\n\n2 0.7071067811865476 0 0.7071067811865476 0 0.5 0 2 7 ring/b.png\n1.0 2.0 -1 3.0 4.0 5\n";

#[test]
fn a_text_model_of_colmap_is_read_half_a_pixel_apart() {
    let files: [(&str, &[u8]); 2] = [("cameras.txt", LENSES.as_bytes()), ("images.txt", POSES.as_bytes())];
    let read = in_folder(&files, "", &ImportOptions::default()).unwrap();
    // On the axis: COLMAP's pixel (320, 240) is ours less a half.
    check_pixel(&read, "a", [0.0, 0.0, 0.0], [319.5, 239.5]);
    // (0.2, 0, 1): r² = 0.04, factor 1 - 0.1 · 0.04.
    check_pixel(&read, "a", [0.4, 0.0, 0.0], [319.5 + 500.0 * 0.2 * 0.996, 239.5]);
    // A quarter turn about y takes z to x: (0.5, 0, 2) of the origin.
    let camera = read.camera("b").unwrap();
    let place = camera.camera_from_world * Point3::new(0.0, 0.0, 1.0);
    assert!((place - Point3::new(1.5, 0.0, 2.0)).norm() < 1e-9, "{place}");
    assert_eq!((camera.distortion.k1, camera.distortion.p2), (0.1, -0.002));
    // The same name in two folders: the folder's name stays.
    let twice = POSES.replace("ring/a.png", "left/0.png").replace("ring/b.png", "right/0.png");
    let files: [(&str, &[u8]); 2] = [("cameras.txt", LENSES.as_bytes()), ("images.txt", twice.as_bytes())];
    let read = in_folder(&files, "", &ImportOptions::default()).unwrap();
    assert!(read.camera("left_0").is_some() && read.camera("right_0").is_some());
}

#[test]
fn lenses_and_models_that_cannot_be_said_are_refused() {
    let fisheye = LENSES.replace("SIMPLE_RADIAL", "SIMPLE_RADIAL_FISHEYE");
    let files: [(&str, &[u8]); 2] = [("cameras.txt", fisheye.as_bytes()), ("images.txt", POSES.as_bytes())];
    let refused = in_folder(&files, "", &ImportOptions::default()).unwrap_err();
    assert!(refused.contains("SIMPLE_RADIAL_FISHEYE with 4 parameters"), "{refused}");
    let refused = in_folder(&[("cameras.bin", b"x"), ("images.bin", b"x")], "", &ImportOptions::default()).unwrap_err();
    assert!(refused.contains("model_converter"), "{refused}");
}
