//! Boards that others recorded: one chessboard on the floor of a studio, found in its pictures, and a ChArUco board whose corners were found.

use std::fs;
use std::path::{Path, PathBuf};

use foveate::scene::Calibration;
use foveate_testkit::data_dir_or_skip;
use serde_json::Value;

use crate::the_program::{foveate, root};

/// The rig of that name with the folder of recordings in place of its variable, in a folder of its own, changed by `edit`.
fn rig(name: &str, data: &Path, edit: impl FnOnce(String) -> String) -> (tempfile::TempDir, PathBuf) {
    let graphs = root().join("graphs");
    let folder = tempfile::tempdir().unwrap();
    for entry in fs::read_dir(&graphs).unwrap().map(Result::unwrap) {
        if entry.file_name().to_string_lossy().starts_with(name) {
            let text = fs::read_to_string(entry.path()).unwrap();
            let text = text.replace("${FOVEATE_DATA}", &data.parent().unwrap().display().to_string());
            fs::write(folder.path().join(entry.file_name()), text).unwrap();
        }
    }
    let path = folder.path().join(format!("{name}.toml"));
    let edited = edit(fs::read_to_string(&path).unwrap());
    fs::write(&path, edited).unwrap();
    (folder, path)
}

/// `foveate calibrate` on the rig: exit code, figures, calibration and complaints.
fn calibrate(rig: &Path, arguments: &[&str]) -> (i32, Value, Option<Calibration>, String) {
    let out = rig.with_file_name("out");
    let (rig, folder) = (rig.display().to_string(), out.display().to_string());
    let fixed = ["calibrate", &rig, "--quiet", "--out", &folder];
    let arguments: Vec<&str> = fixed.into_iter().chain(arguments.iter().copied()).collect();
    let (code, _, complaint) = foveate(Path::new("."), &arguments);
    let figures =
        fs::read_to_string(out.join("summary.json")).map_or(Value::Null, |it| serde_json::from_str(&it).unwrap());
    (code, figures, Calibration::load(&out.join("calibration.toml")).ok(), complaint)
}

fn figure(figures: &Value, name: &str) -> f64 {
    figures[name].as_f64().unwrap_or_else(|| panic!("{name} is not in {figures}"))
}

/// Distances of all pairs of cameras [m].
fn distances(calibration: &Calibration) -> Vec<f64> {
    let centres: Vec<_> = calibration.cameras.iter().map(|it| it.camera.centre()).collect();
    let pairs = (0..centres.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    pairs.map(|(a, b)| (centres[a] - centres[b]).norm()).collect()
}

#[test]
fn a_chessboard_on_the_floor_places_four_cameras_in_metres_with_z_up() {
    let Some(data) = data_dir_or_skip("the chessboard", "s05_voxel_4cam_seated") else { return };
    let (_folder, path) = rig("voxel_boards", &data, |it| it);
    let (code, figures, calibration, complaint) = calibrate(&path, &["--board-floor", "0"]);
    assert_eq!((code, figure(&figures, "cameras_calibrated")), (0, 4.0), "{complaint}");
    let calibration = calibration.unwrap();
    for (camera, name) in calibration.cameras.iter().zip(["cam1", "cam2", "cam3", "cam4"]) {
        // Found with corners of another finder: 0.13 to 0.39 px.
        assert!(figure(&figures, &format!("reprojection_px.median[{name}]")) < 0.25, "{name}");
        // All of them stand on tripods of one height.
        let height = camera.camera.centre().z;
        assert!((1.30..1.48).contains(&height), "{name}: {height} m");
        assert_eq!(
            camera.camera.intrinsics,
            Calibration::load(&path.with_extension("calibration.toml")).unwrap().camera(name).unwrap().intrinsics
        );
    }
    // One view of the board tells nothing of optics, however many pictures there are of it: they stay as stated.
    let (code, figures, kept, complaint) = calibrate(&path, &["--optics", "all", "--duration", "0.05"]);
    assert_eq!((code, figure(&figures, "cameras_calibrated")), (0, 4.0), "{complaint}");
    for (camera, stated) in kept.unwrap().cameras.iter().zip(&calibration.cameras) {
        assert_eq!(camera.camera.intrinsics, stated.camera.intrinsics);
    }
    // Turned by half the board looks the same: without rough poses the verdict is "redo".
    let (code, figures, _, _) = calibrate(&path, &["--from-nothing", "--duration", "0.05"]);
    assert_eq!((code, figures["verdict"].as_str()), (3, Some("redo")));
    // Poses that were refined with the corners of another finder: rotation vector and translation, world to camera [mm].
    let refined = fs::read_to_string(data.join("extrinsics_refined.csv")).unwrap();
    let centres: Vec<_> = refined
        .lines()
        .filter(|it| !it.starts_with('#'))
        .map(|line| {
            let n: Vec<f64> = line.split(',').map(|it| it.trim().parse().unwrap()).collect();
            let turn = nalgebra::Rotation3::from_scaled_axis(nalgebra::Vector3::new(n[1], n[2], n[3]));
            -(turn.inverse() * nalgebra::Vector3::new(n[4], n[5], n[6])) / 1e3
        })
        .collect();
    for a in 0..4 {
        for b in 0..a {
            let here = (calibration.cameras[a].camera.centre() - calibration.cameras[b].camera.centre()).norm();
            let there = (centres[a] - centres[b]).norm();
            assert!((here - there).abs() < 0.02, "cameras {a} and {b}: {here} m, {there} m");
        }
    }
}

#[test]
fn a_chessboard_of_another_size_is_refused() {
    let Some(data) = data_dir_or_skip("the chessboard", "s05_voxel_4cam_seated") else { return };
    let (_folder, path) = rig("voxel_boards", &data, |it| {
        it.replace("rows = 6", "rows = 5").replace("duration_s = 0.3", "duration_s = 0.03")
    });
    let (code, figures, calibration, complaint) = calibrate(&path, &[]);
    assert_eq!((code, figures, calibration), (2, Value::Null, None));
    for word in ["8 x 5 corners", "cam2 saw no board of 8 x 5 inner corners, but one of 8 x 6"] {
        assert!(complaint.contains(word), "`{word}` is not in:\n{complaint}");
    }
}

#[test]
fn corners_of_a_charuco_board_that_were_found_place_four_webcams_as_the_other_program_has_them() {
    let Some(data) = data_dir_or_skip("the ChArUco board", "s16_caliscope_4cam_charuco") else { return };
    let (_folder, path) = rig("caliscope", &data, |it| it);
    let board = ["--from-nothing", "--charuco", "4x5", "--square-mm", "54"];
    let (code, figures, calibration, complaint) = calibrate(&path, &board);
    assert_eq!((code, figure(&figures, "cameras_calibrated")), (0, 4.0), "{complaint}");
    assert!(figure(&figures, "reprojection_px.median") < 0.8);
    let other = Calibration::load(&data.join("camera_array.toml")).unwrap();
    for (here, there) in distances(&calibration.unwrap()).into_iter().zip(distances(&other)) {
        assert!((here - there).abs() < 0.04, "{here} m, {there} m");
    }
    // A board without a size is told, and no board at all.
    for (arguments, word) in [
        (&["--charuco", "4x5"][..], "--square-mm"),
        (&["--charuco", "4x5", "--square-mm", "0"], "squares larger than 0 m"),
        (&["--charuco", "4by5", "--square-mm", "54"], "4by5"),
        (&["--charuco", "3x9", "--square-mm", "54"], "of that size"),
    ] {
        let (code, _, _, complaint) = calibrate(&path, arguments);
        assert!(code == 2 && complaint.contains(word), "`{word}` is not in:\n{complaint}");
    }
}
