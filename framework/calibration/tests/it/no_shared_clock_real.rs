//! A real board before four webcams whose stamps are up to 20 ms apart: clocks that explain what one clock cannot. Skipped without
//! `FOVEATE_DATA`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use foveate_calibration::board::{Board, BoardOptions, board_on_one_clock, calibrate};
use foveate_calibration::clocks::ClockOptions;
use foveate_calibration::network::{OneClock, SolvedNetwork};
use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use foveate_calibration::solved::{ObservationRole, Solved};
use foveate_estimation::statistics::median;
use foveate_geometry::{CameraStatus, Freedom};
use foveate_scene::Calibration;
use nalgebra::Point2;

/// Pictures of these webcams, which are known by number [1/s].
const RATE_HZ: f64 = 6.0;

fn folder() -> Option<PathBuf> {
    let given = std::env::var_os("FOVEATE_DATA").map(PathBuf::from);
    let data = given.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"));
    let folder = data.join("s16_caliscope_4cam_charuco");
    if !folder.is_dir() {
        println!("skipped: no {}; set FOVEATE_DATA to the folder of recordings", folder.display());
        return None;
    }
    Some(folder)
}

/// The corners, the clock of each camera late by `late_s`.
fn recording(folder: &Path, late_s: [f64; 4]) -> Recording {
    let text = std::fs::read_to_string(folder.join("calibration/extrinsic/CHARUCO/xy_CHARUCO.csv")).unwrap();
    let mut pictures: BTreeMap<(usize, usize), Vec<Spot>> = BTreeMap::new();
    for row in text.lines().skip(1).map(|it| it.split(',').collect::<Vec<_>>()) {
        let number = |at: usize| row[at].parse::<usize>().unwrap();
        let pixel = Point2::new(row[4].parse().unwrap(), row[5].parse().unwrap());
        let spot = Spot { pixel, sigma_px: 0.3, peak: 1.0, label: Some(number(3) as u32) };
        pictures.entry((number(0), number(1))).or_default().push(spot);
    }
    let camera_frame = |((picture, camera), spots): ((usize, usize), Vec<Spot>)| CameraFrame {
        camera,
        time_s: picture as f64 / RATE_HZ + late_s[camera],
        spots,
    };
    let mut camera_frames: Vec<CameraFrame> = pictures.into_iter().map(camera_frame).collect();
    camera_frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then(a.camera.cmp(&b.camera)));
    let given = Calibration::load(&folder.join("camera_array.toml")).unwrap();
    let guess = |name: &str| CameraGuess {
        name: name.to_owned(),
        camera: given.camera(name).unwrap().clone(),
        free: Freedom::POSE,
    };
    Recording { cameras: ["0", "1", "2", "3"].map(guess).to_vec(), camera_frames }
}

fn residual_px(solved: &Solved, camera: usize) -> f64 {
    let own = solved.observations.iter().filter(|it| it.camera == camera && it.role == ObservationRole::Used);
    median(&own.filter_map(|it| Some(it.residual?.norm())).collect::<Vec<_>>()).unwrap()
}

/// Camera 0's clock less that of camera 2 [s].
fn apart_s(shared: &OneClock) -> f64 {
    let clock = |camera: usize| shared.clocks[camera].unwrap().offset_s;
    clock(2) - clock(0)
}

#[test]
fn webcams_that_saw_a_board_are_put_on_one_clock() {
    let Some(folder) = folder() else { return };
    let (board, options) = (Board::charuco(4, 5, 0.054).unwrap(), BoardOptions::default());
    let shared = |late_s| {
        let clock_options = ClockOptions { inlier_px: options.inlier_px, ..ClockOptions::default() };
        board_on_one_clock(&recording(&folder, late_s), &board, &options, &clock_options).unwrap()
    };
    let as_stamped = shared([0.0; 4]);
    let believed = calibrate(&recording(&folder, [0.0; 4]), &board, &options).unwrap().solved;
    let solved = calibrate(&as_stamped.recording, &board, &options).unwrap().solved;
    for camera in [0, 2] {
        let [now, before] = [residual_px(&solved, camera), residual_px(&believed, camera)];
        println!("camera {camera}: {now:.2} px, with the stamps believed {before:.2} px");
        assert!(now < 0.75 * before, "{now} {before}");
    }
    // Later stamps move the clock by as much, and nothing else.
    let late = shared([0.0, 0.1, 0.35, -0.2]);
    let moved = apart_s(&late) - apart_s(&as_stamped);
    println!("{:.4} s apart, then {:.4} s", apart_s(&as_stamped), apart_s(&late));
    assert!((moved - -0.35).abs() < 5e-3, "{moved}");
    // Two saw too little of it at six pictures a second: without a clock nothing is stated of them, and it is said why.
    let network = SolvedNetwork { solved, cleaning: Vec::new(), held: Vec::new(), moved: Vec::new(), sigma_px: 0.3 };
    let network = as_stamped.of_room(network);
    for (camera, status) in network.network.solved.cameras.iter().zip(&network.clocks) {
        assert_eq!(camera.clock.is_some(), camera.status == CameraStatus::Calibrated, "{status}");
        assert!(!status.to_string().contains("not found: calibrated"), "{status}");
    }
}
