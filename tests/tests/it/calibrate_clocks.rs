//! `foveate calibrate --unsynchronised` with a wand and with a board, as a person uses it: cameras of known truth with clocks of their own.

use std::fmt::Write;
use std::fs;

use foveate::geometry::Camera;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use serde_json::Value;

use crate::the_program::foveate;

/// Pictures a second of each camera, and how late its clock is [s].
const RATES_HZ: [f64; 4] = [30.0, 25.0, 50.0, 30.0];
const LATE_S: [f64; 4] = [0.0, -0.127, 0.037, 0.307];

fn cameras() -> Vec<Camera> {
    let of = |index: usize| {
        let angle = -0.9 + 0.6 * index as f64;
        let centre = Point3::new(2.4 * angle.sin(), -2.4 * angle.cos(), 1.2 + 0.4 * (index % 2) as f64);
        Camera::look_at(centre, Point3::new(0.0, 0.0, 1.0), [1280, 720], 800.0)
    };
    (0..4).map(of).collect()
}

fn wave(time_s: f64, rate: f64, phase: f64) -> f64 {
    (rate * time_s + phase).sin()
}

fn middle(time_s: f64) -> Vector3<f64> {
    let it = |rate: f64, phase: f64| wave(time_s, rate, phase);
    Vector3::new(0.5 * it(1.3, 0.2), 0.4 * it(0.97, 1.0), 1.0 + 0.35 * it(1.71, 0.5))
}

fn turn(time_s: f64) -> UnitQuaternion<f64> {
    let it = |rate: f64, phase: f64| wave(time_s, rate, phase);
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    UnitQuaternion::from_scaled_axis(Vector3::new(it(0.9, 0.0), it(0.7, 2.0), it(1.2, 1.0)) * 0.45) * upright
}

/// The ends of a wand of 40 cm, which no detector tells apart.
fn wand(time_s: f64) -> Vec<Point3<f64>> {
    [-0.2, 0.2]
        .map(|it| Point3::from(middle(time_s) + turn(time_s) * Vector3::new(it, 0.3 * it, 0.0) / 1.09_f64.sqrt()))
        .to_vec()
}

/// The corners of a ChArUco board of 5 x 4 squares of 90 mm.
fn board(time_s: f64) -> Vec<Point3<f64>> {
    let place = |id: u32| Vector3::new(f64::from(id % 4) * 0.09 - 0.135, 0.09 - f64::from(id / 4) * 0.09, 0.0);
    (0..12).map(|id| Point3::from(middle(time_s) + turn(time_s) * place(id))).collect()
}

/// A folder with a rig, and the truth.
fn lab(points: impl Fn(f64) -> Vec<Point3<f64>>, with_labels: bool, clocks_differ: bool) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut given = "[calibration]\nlength_unit = \"unknown\"\n".to_owned();
    let mut truth = "[calibration]\nlength_unit = \"m\"\n".to_owned();
    let mut rows: Vec<(f64, String)> = Vec::new();
    for (index, camera) in cameras().iter().enumerate() {
        let (centre, to) = (camera.centre(), camera.camera_from_world.rotation);
        let optics = "image_size_px = [1280, 720]\nfocal_px = [800, 800]\nprincipal_point_px = [639.5, 359.5]\n";
        let _ = writeln!(given, "[camera.c{index}]\n{optics}distortion = {{}}");
        let _ = writeln!(
            truth,
            "[camera.c{index}]\n{optics}position_m = [{}, {}, {}]\ncamera_from_world_wxyz = [{}, {}, {}, {}]",
            centre.x, centre.y, centre.z, to.w, to.i, to.j, to.k
        );
        let (rate_hz, late_s) = if clocks_differ { (RATES_HZ[index], LATE_S[index]) } else { (30.0, 0.0) };
        for picture in 0..(16.0 * rate_hz) as usize {
            let time_s = picture as f64 / rate_hz;
            for (label, point) in points(time_s).iter().enumerate() {
                let noise = |it: f64| {
                    0.2 * (it * 12.9898 + picture as f64 * 78.233 + (index + 7 * label) as f64 * 37.719).sin()
                };
                let Some(pixel) = camera.sees(point) else { continue };
                let (label, stamp_s) =
                    (if with_labels { label.to_string() } else { String::new() }, time_s + late_s + 1.0);
                let row = format!("{stamp_s:.6},c{index},{label},{},{}", pixel.x + noise(1.0), pixel.y + noise(2.0));
                rows.push((stamp_s, row));
            }
        }
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let table: String = rows.iter().map(|it| format!("{}\n", it.1)).collect();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("lab.calibration.toml", &given);
    write("truth.toml", &truth);
    write("seen.csv", &format!("time_s,camera,label,x_px,y_px\n{table}"));
    write(
        "lab.toml",
        "[rig]\nname = \"lab\"\ncalibration = \"lab.calibration.toml\"\n[scale.room]\n\
         [scale.room.node.seen]\ntype = \"capture.detections\"\neach = \"c*\"\npath = \"seen.csv\"\n",
    );
    folder
}

#[track_caller]
fn is_found(folder: &tempfile::TempDir, shown: &[&str]) {
    let first = ["calibrate", "lab.toml", "--from-nothing", "--quiet", "--out", "out", "--compare", "truth.toml"];
    // Believed, the stamps make no good room; the program says what to do.
    let (_, said, complaint) = foveate(folder.path(), &[&first, shown].concat());
    assert!(said.contains("--unsynchronised") || complaint.contains("--unsynchronised"), "{said}\n{complaint}");
    let (code, said, complaint) = foveate(folder.path(), &[&first, shown, &["--unsynchronised"]].concat());
    assert_eq!(code, 0, "{said}\n{complaint}");
    let read = |name: &str| fs::read_to_string(folder.path().join("out").join(name)).unwrap();
    let summary: Value = serde_json::from_str(&read("summary.json")).unwrap();
    let figure = |name: &str| summary[name].as_f64().unwrap_or_else(|| panic!("{name} is not in {summary:#}"));
    assert_eq!(figure("cameras_calibrated"), 4.0, "{said}");
    assert!(figure("compare.centre_mm.max") < 15.0 && (figure("compare.scale") - 1.0).abs() < 5e-3, "{said}");
    let table: toml::Table = read("calibration.toml").parse().unwrap();
    let offset = |camera: usize| {
        let clock = table.get("clock").and_then(|it| it.get(format!("c{camera}")));
        clock.and_then(|it| it.get("offset_s")?.as_float()).unwrap_or_else(|| panic!("no clock of c{camera}: {said}"))
    };
    for (camera, late_s) in LATE_S.iter().enumerate() {
        let (found, expected) = (offset(camera) - offset(0), late_s - LATE_S[0]);
        assert!((found - expected).abs() < 3e-3, "c{camera}: {found}, expected {expected}: {said}");
    }
}

#[test]
fn a_wand_before_cameras_with_clocks_of_their_own() {
    is_found(&lab(wand, false, true), &["--wand-mm", "400"]);
}

#[test]
fn a_board_before_cameras_with_clocks_of_their_own() {
    is_found(&lab(board, true, true), &["--charuco", "5x4", "--square-mm", "90"]);
}
