//! A real path: where a broadcast camera looked during 330 frames of a football match, followed by a simulated head with a latency of 300 ms.

mod mat_file;
mod the_program;

use std::fmt::Write as _;
use std::path::Path;

use foveate::geometry::Camera;
use foveate::scene::calibration::Calibration;
use nalgebra::Point3;
use serde_json::Value;

/// How high the broadcast camera stands [m], by the recording, and its pictures a second, which that does not say.
const HEIGHT_M: f64 = 6.375_646;
const FRAMES_A_SECOND: f64 = 30.0;
/// The light comes in then [s], and the head is scored from then on [s].
const ENTERS_S: f64 = 1.0;
const SCORED_S: f64 = 4.0;

/// Where on the field the camera looked: beside the camera's foot, x to its middle direction [m].
fn places(ptz: &[f64], frames: usize) -> Vec<Point3<f64>> {
    let middle = ptz[..frames].iter().sum::<f64>() / frames as f64;
    let place = |frame: usize| {
        let (pan, tilt) = ((ptz[frame] - middle).to_radians(), ptz[frames + frame].to_radians());
        let distance = HEIGHT_M / (-tilt).tan();
        Point3::new(distance * pan.cos(), -distance * pan.sin(), 0.0)
    };
    (0..frames).map(place).collect()
}

fn section(name: &str, camera: &Camera) -> String {
    let pose = camera.camera_from_world.rotation.into_inner();
    let centre = camera.centre();
    let [width, height] = camera.image_size;
    let [fx, fy] = camera.intrinsics.focal;
    let [u, v] = camera.intrinsics.principal;
    format!(
        "[camera.{name}]\nimage_size_px = [{width}, {height}]\nfocal_px = [{fx:?}, {fy:?}]\nprincipal_point_px = [{u:?}, {v:?}]\n\
         position_m = [{:?}, {:?}, {:?}]\ncamera_from_world_wxyz = [{:?}, {:?}, {:?}, {:?}]\n",
        centre.x, centre.y, centre.z, pose.w, pose.i, pose.j, pose.k
    )
}

fn write_rig(folder: &Path, places: &[Point3<f64>], focal_px: f64) {
    let mut csv = "time_s,x_m,y_m,z_m\n".to_owned();
    for (frame, place) in places.iter().enumerate() {
        let _ = writeln!(csv, "{:.6},{:.4},{:.4},{:.4}", frame as f64 / FRAMES_A_SECOND, place.x, place.y, place.z);
    }
    std::fs::write(folder.join("path.csv"), csv).unwrap();
    let mut text = "[calibration]\nlength_unit = \"m\"\n".to_owned();
    for index in 0..8 {
        let angle = std::f64::consts::TAU * f64::from(index) / 8.0;
        let eye = Point3::new(50.0 + 55.0 * angle.cos(), 55.0 * angle.sin(), 18.0);
        text += &section(
            &format!("wide-{}", index + 1),
            &Camera::look_at(eye, Point3::new(50.0, 0.0, 0.0), [1920, 1080], 1100.0),
        );
    }
    let ahead = Point3::new(50.0, 0.0, HEIGHT_M - 7.0);
    for name in ["ptz-1", "ptz-paper", "ptz-still"] {
        text += &section(name, &Camera::look_at(Point3::new(0.0, 0.0, HEIGHT_M), ahead, [1280, 720], focal_px));
        let _ = writeln!(
            text,
            "[head.{name}]\npan_axis = {{ point_m = [0.01, 0.0, -0.05], direction = [0.0349, 0.9986, 0.0393] }}\n\
             tilt_axis = {{ point_m = [0.0, 0.02, -0.03], direction = [0.9992, -0.0262, 0.0297] }}\n\
             limits_deg = {{ pan = [-100, 100], tilt = [-25, 25] }}\npan_device = {{ deg_per_unit = 0.11363636363636363, at_rest = 0 }}\n\
             tilt_device = {{ deg_per_unit = 0.08333333333333333, at_rest = 0 }}"
        );
    }
    // What cannot be read is not worth a run.
    Calibration::from_toml(&text, Path::new("field.calibration.toml")).unwrap();
    std::fs::write(folder.join("field.calibration.toml"), text).unwrap();
    std::fs::write(folder.join("broadcast.toml"), rig()).unwrap();
}

/// The rig of `graphs/pan_tilt_follow.toml` on a field.
fn rig() -> String {
    let rig = std::fs::read_to_string(the_program::root().join("graphs/pan_tilt_follow.toml")).unwrap();
    let swing = rig.lines().find(|it| it.starts_with("swing =")).unwrap();
    let volume = rig.lines().find(|it| it.starts_with("volume_m =")).unwrap();
    let start = rig.lines().find(|it| it.starts_with("start_s =")).unwrap();
    rig.replace(swing, &format!("light_path = \"path.csv\"\npeople_enter_s = {ENTERS_S:?}"))
        .replace(volume, "volume_m = { min = [0, -60, -2], max = [110, 60, 4] }")
        .replace(start, &format!("start_s = {SCORED_S:?}"))
        .replace(
            "in = { features = \"lights.features\" }",
            "in = { features = \"lights.features\" }\nacceleration_m_s2 = 60\ninitiation_tolerance_mm = 300\nseparation_mm = 300",
        )
        .replace("duration_s = 35", "duration_s = 12")
        .replace("radius_m = 0.25", "radius_m = 2.0")
        .replace("pan_tilt_follow.calibration.toml", "field.calibration.toml")
}

#[test]
fn a_broadcast_camera_s_path_is_followed() {
    let Some(data) = foveate_testkit::data_dir_or_skip("the broadcast camera", "s17_ptz_soccer") else { return };
    let bytes = std::fs::read(data.join("soccer_ground_truth.mat")).unwrap();
    let (frames, columns, ptz) = mat_file::matrix(&bytes, "ptz").unwrap();
    assert_eq!((frames, columns), (330, 3));
    assert!((ptz[0] - 53.364_834).abs() < 1e-5 && (ptz[2 * frames] - 3_733.765_356).abs() < 1e-4);
    let focal = ptz[2 * frames..].iter().sum::<f64>() / frames as f64;
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_rig(folder, &places(&ptz, frames), focal);
    let (code, out, err) = the_program::foveate(folder, &["run", "broadcast.toml", "--out", "results"]);
    assert_eq!(code, 0, "{out}{err}");
    let summary: Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("results/summary.json")).unwrap()).unwrap();
    let figure = |name: &str| summary[name].as_f64().unwrap_or_else(|| panic!("no figure {name}"));
    println!(
        "focal length {focal:.0} px, 1280 x 720, {frames} frames, latency {:.0} ms",
        figure("heads.ptz-1.latency_ms")
    );
    for camera in ["ptz-1", "ptz-paper", "ptz-still"] {
        println!(
            "{camera}: off centre {:.1} px mean, {:.1} px p95, in view {:.4}",
            figure(&format!("off_centre_px.mean[{camera}]")),
            figure(&format!("off_centre_px.p95[{camera}]")),
            figure(&format!("in_view[{camera}]"))
        );
    }
    assert!(figure("in_view") > 0.99 && figure("off_centre_px.mean") < 0.5 * figure("off_centre_px.mean[ptz-still]"));
}
