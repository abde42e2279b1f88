//! `foveate calibrate` as a person uses it: rooms of known truth, and bad input of every kind.

use std::fmt::Write;
use std::fs;

use foveate::geometry::Camera;
use foveate_testkit::data_dir_or_skip;
use nalgebra::Point3;
use serde_json::Value;

use crate::the_program::{foveate, root};

const FRAMES: usize = 240;

/// Five cameras of 640 × 480 px around a room of some three metres.
fn cameras() -> Vec<Camera> {
    let of = |index: usize| {
        let angle = std::f64::consts::TAU * index as f64 / 5.0 + 0.2;
        let centre = Point3::new(2.8 * angle.cos(), 3.1 * angle.sin(), 2.3 + 0.2 * (index as f64).sin());
        let target = Point3::new(0.3 * angle.sin(), 0.2, 1.0);
        Camera::look_at(centre, target, [640, 480], 460.0 + 12.0 * index as f64)
    };
    (0..5).map(of).collect()
}

/// A light that is waved through the room.
fn waved(frame: usize) -> Point3<f64> {
    let phase = 0.02 * frame as f64;
    Point3::new((5.0 * phase).sin(), 1.2 * (3.3 * phase).sin(), 1.1 + 0.7 * (7.1 * phase).cos())
}

/// Where `camera` sees the waved light in `frame`, with 0.1 px of something like noise.
fn seen(cameras: &[Camera], frame: usize, camera: usize) -> Option<[f64; 2]> {
    let pixel = cameras[camera].sees(&waved(frame))?;
    let wobble = |it: f64| 0.14 * (it * 12.9898 + frame as f64 * 78.233 + camera as f64 * 37.719).sin();
    Some([pixel.x + wobble(1.0), pixel.y + wobble(2.0)])
}

/// A rig that reads detections, its calibration and the detections, in a folder of its own.
struct Lab {
    folder: tempfile::TempDir,
}

impl Lab {
    /// Cameras of which only sizes and focal lengths are stated; `seen` says where a camera sees the light in a frame.
    fn new(cameras: &[Camera], seen: impl Fn(usize, usize) -> Option<[f64; 2]>) -> Lab {
        let lab = Lab { folder: tempfile::tempdir().unwrap() };
        let mut calibration = "[calibration]\nlength_unit = \"unknown\"\n".to_owned();
        let mut table = "time_s,camera,x_px,y_px\n".to_owned();
        for (index, camera) in cameras.iter().enumerate() {
            let focal = camera.intrinsics.focal[0];
            let _ =
                writeln!(calibration, "[camera.c{index}]\nimage_size_px = [640, 480]\nfocal_px = [{focal}, {focal}]");
            let _ = writeln!(calibration, "principal_point_px = [319.5, 239.5]\ndistortion = {{}}");
        }
        for frame in 0..FRAMES {
            for camera in 0..cameras.len() {
                let time_s = frame as f64 / 30.0;
                let _ = match seen(frame, camera) {
                    Some([x, y]) => writeln!(table, "{time_s},c{camera},{x},{y}"),
                    None => writeln!(table, "{time_s},c{camera},,"),
                };
            }
        }
        lab.write("lab.calibration.toml", &calibration);
        lab.write("seen.csv", &table);
        lab.write(
            "lab.toml",
            "[rig]\nname = \"lab\"\ncalibration = \"lab.calibration.toml\"\n\
             [scale.room]\nvolume_m = { min = [-3, -3, 0], max = [3, 3, 3] }\n\
             [scale.room.node.seen]\ntype = \"capture.detections\"\neach = \"c*\"\npath = \"seen.csv\"\n",
        );
        lab
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.folder.path().join(name), text).unwrap();
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.folder.path().join(name)).unwrap()
    }

    /// Exit code, what was said, what was complained of.
    fn calibrate(&self, more: &[&str]) -> (i32, String, String) {
        let first = ["calibrate", "lab.toml", "--from-nothing", "--quiet", "--out", "out"];
        foveate(self.folder.path(), &[&first, more].concat())
    }

    #[track_caller]
    fn figure(&self, name: &str) -> f64 {
        let summary: Value = serde_json::from_str(&self.read("out/summary.json")).unwrap();
        summary[name].as_f64().unwrap_or_else(|| panic!("{name} is not in {summary:#}"))
    }

    /// Calibration is refused with exit code 2, all of `words`, and no calibration left behind.
    #[track_caller]
    fn refuses(&self, more: &[&str], words: &[&str]) {
        let (code, said, complaint) = self.calibrate(more);
        assert_eq!(code, 2, "{said}\n{complaint}");
        for word in words {
            assert!(complaint.contains(word), "`{word}` is not in:\n{complaint}");
        }
        assert!(!self.folder.path().join("out/calibration.toml").exists());
    }
}

/// The truth as a calibration file, to be compared with.
fn truth(lab: &Lab, cameras: &[Camera]) {
    let mut text = "[calibration]\nlength_unit = \"m\"\n".to_owned();
    for (index, camera) in cameras.iter().enumerate() {
        let ([fx, fy], centre) = (camera.intrinsics.focal, camera.centre());
        let turn = camera.camera_from_world.rotation;
        let _ = writeln!(
            text,
            "[camera.c{index}]\nimage_size_px = [640, 480]\nfocal_px = [{fx}, {fy}]\nprincipal_point_px = [319.5, 239.5]\n\
             position_m = [{}, {}, {}]\ncamera_from_world_wxyz = [{}, {}, {}, {}]",
            centre.x, centre.y, centre.z, turn.w, turn.i, turn.j, turn.k
        );
    }
    lab.write("truth.toml", &text);
}

#[test]
fn room_is_found_from_nothing_and_compared_with_the_truth() {
    let cameras = cameras();
    let lab = Lab::new(&cameras, |frame, camera| seen(&cameras, frame, camera));
    truth(&lab, &cameras);
    let distance = (cameras[0].centre() - cameras[2].centre()).norm();
    let distance = format!("c0:c2={distance}m");
    let (code, said, complaint) = lab.calibrate(&["--distance", &distance, "--compare", "truth.toml", "--report"]);
    assert_eq!(code, 0, "{said}\n{complaint}");
    assert_eq!(lab.figure("cameras_calibrated"), 5.0);
    assert!(lab.figure("holdout_px.median") < 0.3);
    assert!(lab.figure("compare.centre_mm.max") < 5.0, "{said}");
    assert!((lab.figure("compare.scale") - 1.0).abs() < 2e-3, "{said}");
    assert!(lab.read("out/report.html").contains("</html>") && lab.read("out/verdict.txt").contains("good"));
    // What was found can be used and calibrated from again, now as an older calibration.
    lab.write("lab.calibration.toml", &lab.read("out/calibration.toml"));
    let (code, said, complaint) = foveate(lab.folder.path(), &["calibrate", "lab.toml", "--quiet", "--out", "again"]);
    assert_eq!(code, 0, "{said}\n{complaint}");
    let summary: Value = serde_json::from_str(&lab.read("again/summary.json")).unwrap();
    assert_eq!(summary["cameras_moved"].as_f64(), Some(0.0), "{said}");
}

#[test]
fn lenses_that_nobody_knows_are_found() {
    let mut cameras = cameras();
    cameras.iter_mut().for_each(|it| it.distortion.k1 = -0.1);
    let lab = Lab::new(&cameras, |frame, camera| seen(&cameras, frame, camera));
    truth(&lab, &cameras);
    let sizes: String = (0..5).map(|it| format!("[camera.c{it}]\nimage_size_px = [640, 480]\n")).collect();
    lab.write("lab.calibration.toml", &format!("[calibration]\nlength_unit = \"unknown\"\n{sizes}"));
    let (code, said, complaint) = lab.calibrate(&["--compare", "truth.toml"]);
    assert_eq!(code, 0, "{said}\n{complaint}");
    assert_eq!(lab.figure("cameras_calibrated"), 5.0, "{said}");
    assert!(lab.figure("compare.focal_percent.max") < 2.0, "{said}");
    assert!(lab.figure("compare.centre_mm.max") < 40.0, "{said}");
}

#[test]
fn one_camera_is_too_few() {
    let all = cameras();
    let lab = Lab::new(&all[..1], |frame, camera| seen(&all, frame, camera));
    lab.refuses(&[], &["c0", "at least two"]);
    let lab = Lab::new(&all, |frame, camera| seen(&all, frame, camera).filter(|_| camera == 3));
    lab.refuses(&[], &["c3", "at least two"]);
    let lab = Lab::new(&all, |_, _| None);
    lab.refuses(&[], &["no camera saw anything"]);
}

#[test]
fn cameras_that_never_see_the_light_together_are_named_and_the_others_calibrated() {
    let all = cameras();
    let two = Lab::new(&all[..2], |frame, camera| seen(&all, frame, camera).filter(|_| frame % 2 == camera));
    two.refuses(&[], &["c0", "c1", "frames"]);
    // c4 sees what nobody else does.
    let alone = Lab::new(&all, |frame, camera| seen(&all, frame, camera).filter(|_| (camera == 4) == (frame < 60)));
    let (code, said, complaint) = alone.calibrate(&[]);
    assert_eq!(code, 0, "{said}\n{complaint}");
    assert_eq!(alone.figure("cameras_calibrated"), 4.0, "{said}");
    assert!(said.contains("c4") && said.contains("not calibrated"), "{said}");
}

#[test]
fn light_that_never_moves_is_no_waved_light() {
    let all = cameras();
    let still = Lab::new(&all, |_, camera| seen(&all, 40, camera));
    still.refuses(&[], &["c0", "stays in place", "walk with it"]);
}

#[test]
fn light_on_a_line_fixes_nothing() {
    let all = cameras();
    let place = |frame: usize| Point3::new(0.5 * (0.05 * frame as f64).sin(), 0.1, 1.0);
    let line = Lab::new(&all, |frame, camera| all[camera].sees(&place(frame)).map(|it| [it.x, it.y]));
    line.refuses(&[], &["c0"]);
}

#[test]
fn focal_lengths_that_a_flat_path_cannot_tell_are_refused() {
    let all = cameras();
    let place = |frame: usize| Point3::new(waved(frame).x, waved(frame).y, 1.0);
    let flat = Lab::new(&all, |frame, camera| {
        let wobble = 0.1 * (frame as f64 * 78.233 + camera as f64 * 37.719).sin();
        all[camera].sees(&place(frame)).map(|it| [it.x + wobble, it.y - wobble])
    });
    let (code, said, complaint) = flat.calibrate(&[]);
    assert_eq!(code, 0, "known optics do with a plane: {said}\n{complaint}");
    assert!(lab_is(&flat, 5.0) && said.contains("flat"), "{said}");
    // Five cameras around a plane tell focal lengths as well; two do not.
    let (code, said, complaint) = flat.calibrate(&["--optics", "focal"]);
    assert!(code == 0 && lab_is(&flat, 5.0) && !said.contains("redo"), "{said}\n{complaint}");
    let two = Lab::new(&all[..2], |frame, camera| all[camera].sees(&place(frame)).map(|it| [it.x, it.y]));
    two.refuses(&["--optics", "focal"], &["c0", "focal"]);
}

fn lab_is(lab: &Lab, calibrated: f64) -> bool {
    lab.figure("cameras_calibrated") == calibrated
}

#[test]
fn frames_given_twice_and_numbers_that_are_none_do_no_harm() {
    let all = cameras();
    let lab = Lab::new(&all, |frame, camera| seen(&all, frame, camera));
    let table = lab.read("seen.csv");
    let mut lines: Vec<String> = table.lines().map(str::to_owned).collect();
    lines.insert(300, lines[299].clone());
    let parts: Vec<&str> = lines[500].split(',').collect();
    lines[500] = format!("{},{},NaN,inf", parts[0], parts[1]);
    lab.write("seen.csv", &(lines.join("\n") + "\n"));
    let (code, said, complaint) = lab.calibrate(&[]);
    assert_eq!(code, 0, "{said}\n{complaint}");
    assert!(lab_is(&lab, 5.0), "{said}");
    assert!(lab.figure("frames_used") > 200.0);
    assert!(complaint.contains("seen.csv") && complaint.contains("501"), "the line is told: {said}\n{complaint}");
}

#[test]
fn cameras_whose_cables_are_swapped_swap_places() {
    let all: Vec<Camera> = {
        let mut all = cameras();
        all.iter_mut().for_each(|it| it.intrinsics.focal = [480.0; 2]);
        all
    };
    let swap = |camera: usize| [1, 0, 2, 3, 4][camera];
    let lab = Lab::new(&all, |frame, camera| seen(&all, frame, swap(camera)));
    truth(&lab, &all);
    let (code, said, complaint) = lab.calibrate(&["--compare", "truth.toml"]);
    assert_eq!(code, 0, "{said}\n{complaint}");
    assert!(lab.figure("compare.centre_mm.max") > 500.0, "a comparison shows it: {said}");
    // As an older calibration, the right one finds them both out.
    lab.write("lab.calibration.toml", &lab.read("truth.toml"));
    let (code, said, complaint) = foveate(lab.folder.path(), &["calibrate", "lab.toml", "--quiet", "--out", "out"]);
    assert!(code == 3 && said.contains("Cameras c0 and c1 are swapped"), "{said}\n{complaint}");
    assert!(said.contains("moved: c0") && said.contains("moved: c1") && !said.contains("moved: c2"), "{said}");
}

#[test]
fn what_is_asked_for_in_vain_is_told_before_anything_runs() {
    let all = cameras();
    let lab = Lab::new(&all, |frame, camera| seen(&all, frame, camera));
    lab.refuses(&["--wand-mm", "0"], &["wand", "found 0", "above 0"]);
    lab.refuses(&["--wand-mm=-400"], &["wand", "-400"]);
    lab.refuses(&["--wand-mm", "400"], &["by the wand", "c0 and c1"]);
    lab.refuses(&["--distance", "c0:c9=3m"], &["c9"]);
    lab.refuses(&["--distance", "c0:c1=0m"], &["0"]);
    lab.refuses(&["--inlier-px", "nan"], &["nan"]);
    lab.refuses(&["--compare", "nowhere.toml"], &["nowhere.toml"]);
    lab.refuses(&["--compare", "seen.csv"], &["seen.csv"]);
}

#[test]
fn files_of_the_wrong_kind_are_named() {
    let all = cameras();
    let lab = Lab::new(&all, |frame, camera| seen(&all, frame, camera));
    let (code, _, complaint) =
        foveate(lab.folder.path(), &["calibrate", "seen.csv", "--from-nothing", "--quiet", "--out", "out"]);
    assert!(code == 2 && complaint.contains("seen.csv"), "{complaint}");
    let (code, _, complaint) =
        foveate(lab.folder.path(), &["calibrate", "lab.calibration.toml", "--from-nothing", "--quiet", "--out", "out"]);
    assert!(code == 2 && complaint.contains("lab.calibration.toml") && complaint.contains("rig"), "{complaint}");
    lab.write("lab.calibration.toml", "[lab]\nfoo = 1\n");
    lab.refuses(&[], &["lab.calibration.toml"]);
    lab.write("lab.calibration.toml", "\u{0}\u{1}PNG");
    lab.refuses(&[], &["lab.calibration.toml"]);
}

#[test]
fn simulated_cameras_need_poses_to_see_from() {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(root().join("graphs/wave.toml"), folder.path().join("wave.toml")).unwrap();
    let bare: String = (1..=18).map(|it| format!("[camera.wide-{it}]\nimage_size_px = [640, 240]\n")).collect();
    let text = format!("[calibration]\nlength_unit = \"unknown\"\n{bare}");
    fs::write(folder.path().join("face_body.calibration.toml"), text).unwrap();
    fs::copy(root().join("graphs/lab.plan.toml"), folder.path().join("lab.plan.toml")).unwrap();
    let (code, _, complaint) = foveate(folder.path(), &["calibrate", "wave.toml", "--from-nothing", "--quiet"]);
    assert!(code == 2 && complaint.contains("sim.") && complaint.contains("wide-1 has no pose"), "{complaint}");
    assert!(complaint.contains("pixel_aspect"), "such pictures may be fields: {complaint}");
}

#[test]
fn camera_that_moved_since_is_named_and_the_others_stay() {
    let all = cameras();
    let mut now = all.clone();
    let nudge =
        nalgebra::Isometry3::new(nalgebra::Vector3::new(0.03, 0.0, 0.01), nalgebra::Vector3::new(0.0, 0.02, 0.01));
    now[3].camera_from_world = nudge * now[3].camera_from_world;
    let lab = Lab::new(&all, |frame, camera| seen(&now, frame, camera));
    truth(&lab, &all);
    let clocks: String = (0..5).map(|it| format!("\n[clock.c{it}]\noffset_s = 0.0\nframe_rate_hz = 30.0\n")).collect();
    let axis = |direction: &str| format!("{{ point_m = [0.0, 0.0, -0.05], direction = {direction} }}");
    let head =
        format!("\n[head.c2]\npan_axis = {}\ntilt_axis = {}\n", axis("[0.0, 1.0, 0.0]"), axis("[1.0, 0.0, 0.0]"));
    lab.write("truth.toml", &(lab.read("truth.toml") + &clocks + &head));
    lab.write("lab.calibration.toml", &lab.read("truth.toml"));
    let (code, said, complaint) = foveate(
        lab.folder.path(),
        &["calibrate", "lab.toml", "--quiet", "--out", "out", "--compare", "truth.toml", "--write"],
    );
    assert_eq!(code, 0, "{said}\n{complaint}");
    assert!(said.contains("moved: c3") && lab.figure("cameras_moved") == 1.0, "{said}");
    // The calibration is replaced, with the older one kept beside it.
    assert_ne!(lab.read("lab.calibration.toml"), lab.read("truth.toml"));
    assert!(lab.read("lab.calibration.toml").contains("frame_rate_hz = 30"), "clocks stay as they were");
    assert!(lab.read("lab.calibration.toml").contains(head.trim()), "heads stay as they were");
    assert_eq!(lab.read("lab.calibration.before.toml"), lab.read("truth.toml"));
}

#[test]
fn cameras_that_only_shifted_are_named_and_nobody_else() {
    let all = cameras();
    for moved in [vec![2], vec![0, 3]] {
        let mut now = all.clone();
        for camera in &moved {
            now[*camera].camera_from_world.translation.vector += nalgebra::Vector3::new(0.06, -0.03, 0.0);
        }
        let lab = Lab::new(&all, |frame, camera| seen(&now, frame, camera));
        truth(&lab, &all);
        lab.write("lab.calibration.toml", &lab.read("truth.toml"));
        let (code, said, complaint) = foveate(lab.folder.path(), &["calibrate", "lab.toml", "--quiet", "--out", "out"]);
        assert_eq!(code, 0, "{said}\n{complaint}");
        for camera in 0..5 {
            assert_eq!(said.contains(&format!("moved: c{camera}")), moved.contains(&camera), "c{camera}: {said}");
        }
    }
}

#[test]
fn writing_loses_no_camera_and_no_older_calibration() {
    let all = cameras();
    // c4 sees next to nothing.
    let lab = Lab::new(&all, |frame, camera| seen(&all, frame, camera).filter(|_| camera != 4 || frame < 5));
    truth(&lab, &all);
    lab.write("lab.calibration.toml", &lab.read("truth.toml"));
    let write = |more: &[&str]| {
        let first = ["calibrate", "lab.toml", "--quiet", "--out", "out", "--write"];
        let (code, said, complaint) = foveate(lab.folder.path(), &[&first, more].concat());
        assert_eq!(code, 0, "{said}\n{complaint}");
        said
    };
    let said = write(&[]);
    assert!(said.contains("kept as the older calibration has them: c4"), "{said}");
    assert!(lab.read("lab.calibration.toml").contains("[camera.c4]"));
    write(&[]);
    assert_eq!(lab.read("lab.calibration.before.toml"), lab.read("truth.toml"));
    assert!(lab.folder.path().join("lab.calibration.before-2.toml").exists());
    let before = lab.read("lab.calibration.toml");
    let said = write(&["--from-nothing"]);
    assert!(said.contains("c4 would be lost") && lab.read("lab.calibration.toml") == before, "{said}");
}

#[test]
fn pictures_without_the_light_may_be_left_out_of_a_file() {
    let all = cameras();
    let lab = Lab::new(&all, |frame, camera| seen(&all, frame, camera).filter(|_| (frame * 7 + camera) % 5 < 3));
    let table: String =
        lab.read("seen.csv").lines().filter(|it| !it.ends_with(",,")).map(|it| format!("{it}\n")).collect();
    lab.write("seen.csv", &table);
    let (code, said, complaint) = lab.calibrate(&[]);
    assert_eq!(code, 0, "{said}\n{complaint}");
    assert!(lab_is(&lab, 5.0) && lab.figure("frames_used") > 230.0, "{said}");
}

#[test]
fn real_pictures_are_calibrated_at_least_as_well_as_by_the_peer() {
    let Some(folder) = data_dir_or_skip("calibrate", "s01_arctic_laser_4cam") else { return };
    let out = tempfile::tempdir().unwrap();
    let rig = root().join("graphs/laser_room.toml");
    let mut command = std::process::Command::new(crate::the_program::program());
    command.env("FOVEATE_DATA", folder.parent().unwrap()).arg("calibrate").arg(rig);
    let output = command.args(["--from-nothing", "--quiet", "--out"]).arg(out.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let summary: Value = serde_json::from_slice(&fs::read(out.path().join("summary.json")).unwrap()).unwrap();
    let figure = |name: &str| summary[name].as_f64().unwrap_or_else(|| panic!("{name} is not in {summary:#}"));
    assert_eq!(figure("cameras_calibrated"), 4.0);
    // MultiCamSelfCal on the same pictures: 0.36 px in the median, 446 frames.
    assert!(figure("reprojection_px.median") <= 0.36 && figure("frames_used") >= 446.0, "{summary:#}");
}

#[test]
fn rows_written_twice_do_no_harm_and_two_lights_are_told() {
    let all = cameras();
    let lab = Lab::new(&all, |frame, camera| seen(&all, frame, camera));
    let table = lab.read("seen.csv");
    let (header, rows) = table.split_once('\n').unwrap();
    let twice: String = rows.lines().map(|it| format!("{it}\n{it}\n")).collect();
    lab.write("seen.csv", &format!("{header}\n{twice}"));
    let (code, said, complaint) = lab.calibrate(&[]);
    assert_eq!(code, 0, "{said}\n{complaint}");
    assert!(lab_is(&lab, 5.0) && said.contains("spots written twice"), "{said}");
    fs::remove_file(lab.folder.path().join("out/calibration.toml")).unwrap();
    // The second light, 20 px beside the first.
    let beside = |row: &str| {
        let fields: Vec<&str> = row.split(',').collect();
        let x = fields[2].parse::<f64>().map_or(String::new(), |it| (it - 20.0).max(0.0).to_string());
        format!("{row}\n{},{},{x},{}\n", fields[0], fields[1], fields[3])
    };
    let two: String = rows.lines().map(beside).collect();
    lab.write("seen.csv", &format!("{header}\n{two}"));
    lab.refuses(&[], &["most pictures of c0 and of 4 more cameras hold 2 spots: a wand (--wand-mm)?"]);
}

#[test]
fn camera_without_rows_is_named_and_the_others_calibrated() {
    let all = cameras();
    let lab = Lab::new(&all, |frame, camera| seen(&all, frame, camera));
    let table = lab.read("seen.csv");
    let kept: String = table.lines().filter(|it| !it.contains(",c3,")).map(|it| format!("{it}\n")).collect();
    lab.write("seen.csv", &kept);
    let (code, said, complaint) = lab.calibrate(&[]);
    assert_eq!(code, 0, "{said}\n{complaint}");
    assert!(lab_is(&lab, 4.0) && said.contains("left out: c3"), "{said}");
    assert!(complaint.contains("note: ") && complaint.contains("no row of camera `c3`"), "{complaint}");
    fs::remove_file(lab.folder.path().join("out/calibration.toml")).unwrap();
    let renamed = (0..5).fold(table, |table, it| table.replace(&format!(",c{it},"), &format!(",d{it},")));
    lab.write("seen.csv", &renamed);
    lab.refuses(&[], &["no row of a camera of the calibration; it has rows of `d0`"]);
}

#[test]
fn flags_of_a_board_without_a_board_are_refused() {
    let all = cameras();
    let lab = Lab::new(&all, |frame, camera| seen(&all, frame, camera));
    lab.refuses(&["--square-mm", "30"], &["`--square-mm` and no board", "--chessboard", "board.detector"]);
    lab.refuses(&["--board-floor", "1"], &["`--board-floor` and no board"]);
    assert!(!lab.folder.path().join("out/observations.csv").exists(), "told before anything runs");
}

#[cfg(target_os = "linux")]
#[test]
fn full_disk_under_standard_output_is_told_once() {
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output =
        std::process::Command::new(crate::the_program::program()).arg("nodes").stdout(full()).output().unwrap();
    let complaint = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{complaint}");
    assert_eq!(complaint.matches("standard output cannot be written").count(), 1, "{complaint}");
}

#[test]
fn board_that_nobody_saw_on_the_floor_is_told_with_the_span_in_which_it_was_seen() {
    let all = cameras();
    let lab = Lab::new(&all, |_, _| None);
    let mut table = "time_s,camera,x_px,y_px,label\n".to_owned();
    for frame in 0..40 {
        let time = f64::from(frame) / 10.0;
        let turn = nalgebra::Vector3::new(0.5 * time.sin(), 0.5 * (1.7 * time).cos(), time);
        let place = nalgebra::Vector3::new(0.4 * (1.3 * time).sin(), 0.4 * time.cos(), 1.0);
        let pose = nalgebra::Isometry3::new(place, turn);
        for (label, camera) in (0..30).flat_map(|label| (0..5).map(move |camera| (label, camera))) {
            let mark = Point3::new(0.12 * f64::from(label % 6), -0.12 * f64::from(label / 6), 0.0);
            if let Some(pixel) = all[camera].sees(&(pose * mark)) {
                let _ = writeln!(table, "{time},c{camera},{},{},{label}", pixel.x, pixel.y);
            }
        }
    }
    lab.write("seen.csv", &table);
    let board = ["--chessboard", "6x5", "--square-mm", "120", "--board-floor"];
    lab.refuses(&[&board[..], &["99"]].concat(), &["--board-floor 99", "within 0.00 to 3.90 s"]);
    let (code, said, complaint) = lab.calibrate(&[&board[..], &["2"]].concat());
    // The board did not lie on a floor at all, which the verdict finds out.
    assert!(code == 3 && said.contains("origin: by the board on the floor at 2 s"), "{said}\n{complaint}");
}
