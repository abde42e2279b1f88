//! Cameras of a real flight from its RTK path, clocks unknown: against what the data set's authors measured by other means. Skipped without
//! `FOVEATE_DATA`.

use std::path::{Path, PathBuf};

use foveate_calibration::path::table::{TableOptions, parse};
use foveate_calibration::path::{MeasuredPath, PathNetwork, PathOptions, Refusal, calibrate};
use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use foveate_geometry::{AlignmentOptions, Freedom, align};
use foveate_scene::Draft;
use nalgebra::Point2;
use nalgebra::Point3;

/// From the first 40 % of the flight, in the path's time [s].
const SPAN_S: [f64; 2] = [54.2, 292.5];

fn folder() -> Option<PathBuf> {
    let given = std::env::var_os("FOVEATE_DATA").map(PathBuf::from);
    let data = given.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"));
    let folder = data.join("s04_drone_multicam/dataset3");
    if !folder.is_dir() {
        println!("skipped: no {}; set FOVEATE_DATA to the folder of recordings", folder.display());
        return None;
    }
    Some(folder)
}

fn numbers(path: &Path) -> Vec<[f64; 3]> {
    let text = std::fs::read_to_string(path).unwrap();
    let row = |line: &str| -> Option<[f64; 3]> {
        let row: Option<Vec<f64>> = line.split_whitespace().map(|it| it.parse().ok()).collect();
        row?.try_into().ok()
    };
    text.lines().filter_map(row).collect()
}

fn recording(folder: &Path, change: impl Fn(usize, Point2<f64>) -> Point2<f64>) -> Recording {
    let graphs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../graphs/drones.calibration.toml");
    let draft = Draft::load(&graphs).unwrap();
    let mut recording = Recording::default();
    for (index, it) in draft.calibration.cameras.iter().enumerate() {
        let rate_hz = draft.calibration.clocks.0[&it.name].frame_rate_hz.unwrap();
        // One picture in four is enough for a test.
        let pictures = numbers(&folder.join(format!("detections/{}.txt", it.name))).into_iter().step_by(4);
        for [picture, x, y] in pictures {
            let pixel = change(index, Point2::new(x, y));
            let spot = Spot { pixel, sigma_px: 2.0, peak: 0.0, label: None };
            let spots = if x == 0.0 && y == 0.0 { Vec::new() } else { vec![spot] };
            recording.camera_frames.push(CameraFrame { camera: index, time_s: picture / rate_hz, spots });
        }
        let camera = it.camera.clone();
        recording.cameras.push(CameraGuess { name: it.name.clone(), camera, free: Freedom::POSE });
    }
    recording
}

fn path(folder: &Path) -> MeasuredPath {
    let text = std::fs::read_to_string(folder.join("trajectory/rtk.txt")).unwrap();
    let table = parse(&text, &TableOptions { rate_hz: Some(5.0), metres_per_unit: 1.0 }).unwrap();
    MeasuredPath::new(&table.rows).unwrap().between(SPAN_S[0], SPAN_S[1]).unwrap()
}

fn told(network: &PathNetwork) {
    for (camera, outcome) in network.solved.cameras.iter().zip(&network.cameras) {
        match outcome {
            Ok(it) => println!(
                "{}: {:.1} % of {} within {:.1} px, {:.2} px, held out {:.2} px, {:+.3} s ± {:.1} ms, {:+.0} ppm, wander {:.0} ms, ± {:.3} m, ± {:.2} mrad, next {:?}",
                camera.name,
                100.0 * it.share(),
                it.of,
                it.limit_px,
                it.used_px[0],
                it.held_out_px[0],
                it.offset_s,
                1e3 * it.offset_sigma_s,
                1e6 * it.drift,
                1e3 * it.wander.map_or(0.0, |it| it[0]),
                it.centre_sigma_m,
                1e3 * it.turn_sigma,
                it.rival
            ),
            Err(refusal) => println!("{}: {refusal}", camera.name),
        }
    }
}

#[test]
fn a_flight_places_the_cameras_where_they_were_surveyed() {
    let Some(folder) = folder() else { return };
    let network = calibrate(&recording(&folder, |_, it| it), &path(&folder), &PathOptions::default());
    told(&network);
    // By matching each camera alone, elsewhere, without drift: so to a third of a second.
    for (outcome, expected) in network.cameras.iter().zip([61.85, 27.85, 43.45, 51.80, 29.80, 59.10]) {
        let found = outcome.as_ref().unwrap();
        let middle = 0.5 * (SPAN_S[0] + SPAN_S[1]) - found.offset_s;
        let offset = found.offset_s + found.drift * middle;
        assert!((offset - expected).abs() < 0.35, "{offset} {expected}");
        assert!(found.share() > 0.6, "{}", found.share());
    }
    let surveyed = numbers(&folder.join("camera-locations/campos.txt"));
    let surveyed: Vec<Point3<f64>> = [0, 4, 2, 1, 3, 5].map(|it: usize| Point3::from(surveyed[it])).to_vec();
    let centres: Vec<Point3<f64>> = network.solved.cameras.iter().map(|it| it.camera.centre()).collect();
    let fit = align(&centres, &surveyed, AlignmentOptions { scale: false, robust: false }).unwrap();
    println!("places: {:.3?} m, rms {:.3} m", fit.distances, fit.rms);
    assert!(fit.rms < 0.8, "{:?}", fit.distances);
}

#[test]
fn a_camera_that_shows_something_else_or_is_mirrored_is_refused_with_the_reason() {
    let Some(folder) = folder() else { return };
    let mut wrong = recording(&folder, |camera, it| if camera == 4 { Point2::new(1919.0 - it.x, it.y) } else { it });
    // Three in four pictures of one camera show another thing: where the drone was seen five minutes before.
    let own: Vec<usize> = (0..wrong.camera_frames.len()).filter(|it| wrong.camera_frames[*it].camera == 3).collect();
    let before: Vec<Vec<Spot>> = own.iter().map(|it| wrong.camera_frames[*it].spots.clone()).collect();
    for (place, index) in own.iter().enumerate() {
        if place % 100 > 20 {
            wrong.camera_frames[*index].spots.clone_from(&before[(place * 7 + 1250) % own.len()]);
        }
    }
    let cameras = wrong.cameras.split_off(3);
    wrong.camera_frames.retain(|it| it.camera == 3 || it.camera == 4);
    wrong.camera_frames.iter_mut().for_each(|it| it.camera -= 3);
    wrong.cameras = cameras[..2].to_vec();
    let network = calibrate(&wrong, &path(&folder), &PathOptions::default());
    told(&network);
    assert!(network.cameras[0].is_err(), "{:?}", network.cameras[0]);
    assert!(matches!(network.cameras[1], Err(Refusal::Mirrored { .. })), "{:?}", network.cameras[1]);
}
