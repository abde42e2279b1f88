//! Real pictures: three poses of a chessboard under Gray code, decoded and calibrated node by node.

use std::sync::Arc;

use foveate::prelude::*;
use foveate::scene::Calibration;

use crate::calibrator::{self, Calibrator, CalibratorSettings};
use crate::corners::{self, Corners, CornersSettings};
use crate::decoder::{self, Decoder, DecoderSettings};
use crate::pictures;

const CAMERAS: &str = r#"
[calibration]
length_unit = "m"
[camera.camera]
image_size_px = [1280, 1024]
focal_px = [3000.0, 3000.0]
principal_point_px = [639.5, 511.5]
position_m = [0.0, 0.0, 0.0]
camera_from_world_wxyz = [1.0, 0.0, 0.0, 0.0]
[camera.projector]
image_size_px = [1024, 768]
focal_px = [1800.0, 1800.0]
principal_point_px = [511.5, 383.5]
position_m = [0.0, 0.5, 0.0]
camera_from_world_wxyz = [1.0, 0.0, 0.0, 0.0]
"#;

#[test]
fn a_real_projector_is_calibrated_from_three_poses_of_a_board() {
    let Some(folder) = foveate_testkit::data_dir_or_skip("projector calibration", "s11_procam_graycode") else {
        return;
    };
    let calibration = Calibration::from_toml(CAMERAS, std::path::Path::new("procam.toml")).unwrap();
    let setup = Setup { camera: Some(CameraId(0)), calibration: Arc::new(calibration), ..Setup::for_tests() };
    let mut decode = NodeBench::<Decoder>::with_setup(DecoderSettings::default(), &setup).unwrap();
    let board = CornersSettings { columns: 9, rows: 7, square_mm: 75.0, projector: "projector".into(), reach: 0.5 };
    let mut find = NodeBench::<Corners>::with_setup(board, &setup).unwrap();
    let settings = CalibratorSettings {
        columns: 9,
        rows: 7,
        square_mm: 75.0,
        projector: "projector".into(),
        file: "c.toml".into(),
    };
    let mut solve = NodeBench::<Calibrator>::with_setup(settings, &setup).unwrap();
    for (at, files) in pictures::sets(&folder.join("capture_*"), "*").unwrap().iter().enumerate() {
        let (time, set) = (Time::from_s(at as f64), pictures::read(files).unwrap().set);
        decode.feed(&decoder::PICTURES, time, set).unwrap();
        let white = decode.outputs(&decoder::WHITE).last().unwrap().value.clone();
        let map = decode.outputs(&decoder::MAP).last().unwrap().value.clone();
        find.feed(&corners::WHITE, time, Image::clone(&white)).unwrap();
        find.feed(&corners::MAP, time, ProjectorMap::clone(&map)).unwrap();
        solve.feed(&calibrator::MAP, time, ProjectorMap::clone(&map)).unwrap();
        for features in find.outputs(&corners::FEATURES).iter().rev().take(2) {
            solve.feed(&calibrator::FEATURES, time, Features::clone(&features.value)).unwrap();
        }
    }
    let report = decode.finish().unwrap();
    assert_eq!(report.remarks, Vec::<String>::new());
    assert!(report.figures["decoder.known_share.camera"] > 0.6);
    let report = solve.finish().unwrap();
    let figure = |name: &str| report.figures[name];
    // The board is bent by 2 mm at one corner of one set: what lies off the plane is rejected there.
    assert!(figure("both.used_px.rms") < 0.2, "{}", figure("both.used_px.rms"));
    assert!(figure("both.rms_px") < 0.45, "{}", figure("both.rms_px"));
    assert!(figure("projector.held_out_px.rms") < 0.45, "{}", figure("projector.held_out_px.rms"));
    assert!(figure("flatness_mm.worst") < 0.65, "{}", figure("flatness_mm.worst"));
    // Its black squares send back fewer gray levels than the camera's noise needs.
    assert!(figure("coverage") > 0.5, "{}", figure("coverage"));
}
