//! `foveate calibrate` with a measured path, labelled points and parts of a rig's cameras, as a person uses it.

use std::fmt::Write;
use std::fs;

use foveate::geometry::Camera;
use nalgebra::Point3;
use serde_json::Value;

use crate::the_program::foveate;

/// Twenty seconds at 30 Hz.
const FRAMES: usize = 600;
/// What the path's clock shows when the recordings begin [s].
const PATH_FROM_S: f64 = 1000.0;

fn cameras() -> Vec<Camera> {
    let of = |index: usize| {
        let angle = std::f64::consts::TAU * index as f64 / 4.0 + 0.2;
        let centre = Point3::new(2.8 * angle.cos(), 3.1 * angle.sin(), 2.3 + 0.2 * (index as f64).sin());
        Camera::look_at(centre, Point3::new(0.3 * angle.sin(), 0.2, 1.0), [640, 480], 460.0 + 12.0 * index as f64)
    };
    (0..4).map(of).collect()
}

/// A light that is waved through the room; `label` makes other points.
fn waved(label: usize, frame: f64) -> Point3<f64> {
    let phase = 0.02 * frame + 2.0 * label as f64;
    Point3::new(phase.sin() + 0.3 * (2.3 * phase).cos(), 1.2 * (0.83 * phase).sin(), 1.1 + 0.7 * (1.71 * phase).cos())
}

struct Lab {
    folder: tempfile::TempDir,
}

impl Lab {
    fn new(node: &str) -> Lab {
        let lab = Lab { folder: tempfile::tempdir().unwrap() };
        let (mut optics, mut truth) = (
            "[calibration]\nlength_unit = \"unknown\"\n".to_owned(),
            "[calibration]\nlength_unit = \"m\"\n".to_owned(),
        );
        let mut seen = "time_s,camera,x_px,y_px\n".to_owned();
        for (index, camera) in cameras().iter().enumerate() {
            let (focal, centre, turn) =
                (camera.intrinsics.focal[0], camera.centre(), camera.camera_from_world.rotation);
            let lens = format!(
                "[camera.c{index}]\nimage_size_px = [640, 480]\nfocal_px = [{focal}, {focal}]\nprincipal_point_px = [319.5, 239.5]\ndistortion = {{}}\n"
            );
            optics += &format!("{lens}[clock.c{index}]\nframe_rate_hz = 30.0\n");
            let _ = writeln!(
                truth,
                "{lens}position_m = [{}, {}, {}]\ncamera_from_world_wxyz = [{}, {}, {}, {}]",
                centre.x, centre.y, centre.z, turn.w, turn.i, turn.j, turn.k
            );
            for frame in 0..FRAMES {
                let time_s = frame as f64 / 30.0;
                let _ = match camera.sees(&waved(0, frame as f64)) {
                    Some(it) => {
                        writeln!(seen, "{time_s},c{index},{},{}", it.x + 0.2 * (frame as f64 * 7.7).sin(), it.y)
                    }
                    None => writeln!(seen, "{time_s},c{index},,"),
                };
            }
        }
        let rig = format!(
            "[rig]\nname = \"lab\"\ncalibration = \"optics.toml\"\n[scale.room]\n[scale.room.node.seen]\ntype = \"capture.detections\"\n{node}"
        );
        for (name, text) in [("optics.toml", &optics), ("truth.toml", &truth), ("seen.csv", &seen), ("lab.toml", &rig)]
        {
            lab.write(name, text);
        }
        lab
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.folder.path().join(name), text).unwrap();
    }

    fn calibrate(&self, more: &[&str]) -> (i32, String, String) {
        foveate(self.folder.path(), &[&["calibrate", "lab.toml", "--quiet", "--out", "out"], more].concat())
    }

    fn summary(&self) -> Value {
        serde_json::from_slice(&fs::read(self.folder.path().join("out/summary.json")).unwrap()).unwrap()
    }

    /// Refused before anything is captured.
    #[track_caller]
    fn refuses(&self, more: &[&str], words: &[&str]) {
        let (code, said, complaint) = self.calibrate(more);
        assert_eq!(code, 2, "{said}\n{complaint}");
        words.iter().for_each(|it| assert!(complaint.contains(it), "`{it}` is not in:\n{complaint}"));
        assert!(!self.folder.path().join("out/observations.csv").exists(), "something was captured");
    }
}

const SEEN: &str = "each = \"c*\"\npath = \"seen.csv\"\n";

/// The light's path, 20 times a second, as a table.
fn path_of(label: usize) -> String {
    let row = |it: i32| {
        let time_s = f64::from(it) / 20.0 - 5.0;
        let at = waved(label, 30.0 * time_s);
        format!("{},{},{},{}\n", time_s + PATH_FROM_S, at.x, at.y, at.z)
    };
    "time_s,x_m,y_m,z_m\n".to_owned() + &(0..600).map(row).collect::<String>()
}

#[test]
fn a_measured_path_places_the_cameras_in_its_world() {
    let lab = Lab::new(SEEN);
    lab.write("path.csv", &path_of(0));
    let (code, said, complaint) =
        lab.calibrate(&["--path", "path.csv", "--compare", "truth.toml", "--report", "--write"]);
    assert_eq!(code, 0, "{said}\n{complaint}");
    let summary = lab.summary();
    assert_eq!(
        (summary["verdict"].as_str(), summary["cameras_calibrated"].as_f64()),
        (Some("good"), Some(4.0)),
        "{said}"
    );
    assert!(summary["compare.centre_mm.max"].as_f64().unwrap() < 10.0, "{said}");
    assert!((summary["clock_offset_s[c2]"].as_f64().unwrap() - PATH_FROM_S).abs() < 2e-3, "{said}");
    // The session begins with the path, 5 s before the recordings.
    assert!((summary["path.session_from_s"].as_f64().unwrap() - PATH_FROM_S + 5.0).abs() < 1e-6, "{said}");
    let written = fs::read_to_string(lab.folder.path().join("optics.toml")).unwrap();
    assert!(written.contains("position_m") && written.contains("frame_rate_hz = 30.0"), "{written}");
    assert!(lab.folder.path().join("optics.before.toml").exists());
}

#[test]
fn a_path_of_another_thing_calibrates_nothing_and_is_exit_code_3() {
    let lab = Lab::new(SEEN);
    lab.write("path.csv", &path_of(5).replace(",0.", ",0.9").replace(",-0.", ",0.1"));
    let (code, said, complaint) = lab.calibrate(&["--path", "path.csv", "--write"]);
    assert_eq!(code, 3, "{said}\n{complaint}");
    let summary = lab.summary();
    assert_eq!(summary["verdict"].as_str(), Some("redo"));
    assert_eq!(summary["diagnoses"].as_array().unwrap().len(), 4, "{summary:#}");
    assert!(!lab.folder.path().join("out/calibration.toml").exists() && said.contains("stays as it is"), "{said}");
}

#[test]
fn what_cannot_be_is_found_before_anything_is_captured() {
    let lab = Lab::new(SEEN);
    lab.write("line.csv", "1 0 0 0\n2 1 0 0\n3 2 0 0\n4 3 0 0\n5 4 0 0\n6 5 0 0\n7 6 0 0\n8 7 0 0\n9 8 0 0\n");
    lab.write("bare.csv", "0 0 0\n1 0 0\n");
    lab.refuses(&["--path", "line.csv"], &["line.csv", "lies on a line"]);
    lab.refuses(&["--path", "bare.csv"], &["three columns without names", "--path-rate"]);
    let whole = path_of(0);
    let fourth = whole.lines().nth(3).unwrap();
    lab.write("short.csv", &whole.replace(fourth, fourth.rsplit_once(',').unwrap().0));
    lab.write("long.csv", &whole.replace(fourth, &format!("{fourth},0.5")));
    lab.refuses(&["--path", "short.csv"], &["short.csv: line 4: found 3 fields, expected 4, as line 1 names columns"]);
    lab.refuses(&["--path", "long.csv"], &["long.csv: line 4: found 5 fields, expected 4, as line 1 names columns"]);
    lab.refuses(&["--path", "gone.csv"], &["gone.csv", "cannot be read"]);
    lab.refuses(&["--path", "line.csv", "--wand-mm", "400"], &["cannot be used with"]);
    lab.refuses(&["--distance", "c1:cc2=3m"], &["--distance", "there is no camera cc2", "did you mean c2?"]);
    lab.refuses(&["--distance", "c1:c2=3"], &["a number with its unit"]);
    lab.refuses(&["--cameras", "c*,!c3", "--distance", "c1:c3=3m"], &["c3 is left out by --cameras"]);
    lab.refuses(
        &["--plumb", "@1:@90..91", "--duration", "10"],
        &["--plumb", "after the end of the session, which lasts 10 s"],
    );
    lab.refuses(&["--l-frame", "@1=0,0,0", "--l-frame", "@2=1,0,0"], &["--l-frame", "2 places, expected at least 3"]);
    lab.refuses(&["--cameras", "c*,!d3"], &["no camera of the calibration matches `d3`", "did you mean"]);
    lab.write(
        "lab.toml",
        &fs::read_to_string(lab.folder.path().join("lab.toml")).unwrap().replace("\"c*\"", "[\"c*\", \"!c9\"]"),
    );
    lab.refuses(&[], &["no camera of the calibration matches `c9`", "lab.toml:7"]);
}

#[test]
fn cameras_can_be_left_out_by_pattern() {
    let lab = Lab::new(SEEN);
    let (code, said, complaint) = lab.calibrate(&["--cameras", "!c3", "--compare", "truth.toml"]);
    assert_eq!(code, 0, "{said}\n{complaint}");
    assert_eq!(lab.summary()["cameras"].as_f64(), Some(3.0), "{said}");
    let lab = Lab::new("each = [\"c*\", \"!c0\"]\npath = \"seen.csv\"\n");
    let (code, said, complaint) = lab.calibrate(&["--compare", "truth.toml"]);
    assert_eq!((code, lab.summary()["cameras_calibrated"].as_f64()), (0, Some(3.0)), "{said}\n{complaint}");
}

#[test]
fn points_with_names_calibrate_and_swapped_ones_are_told() {
    let lab = Lab::new("each = \"c*\"\npath = \"{camera}.csv\"\nsigma_px = 1\n");
    let names = ["left_ear", "nose", "right_ear", "tail"];
    for (index, camera) in cameras().iter().enumerate() {
        let mut text = "scorer".to_owned() + &",net".repeat(12) + "\nbodyparts";
        names.iter().for_each(|it| text += &format!(",{it},{it},{it}"));
        text += &("\ncoords".to_owned() + &",x,y,likelihood".repeat(4) + "\n");
        for frame in 0..300_usize {
            text += &frame.to_string();
            for label in 0..4_usize {
                let is_swapped = index == 1 && frame % 6 == 0 && label % 2 == 0;
                let shown = if is_swapped { 2 - label } else { label };
                // Ears near each other, the tail elsewhere.
                let mut at = waved(if shown == 3 { 2 } else { 0 }, frame as f64);
                at.y += [-0.12, 0.0, 0.12, 0.0][shown];
                match camera.sees(&at) {
                    Some(it) => {
                        text += &format!(",{},{},0.95", it.x + 0.3 * (frame as f64 * 7.7 + label as f64).sin(), it.y)
                    }
                    None => text += ",5,5,0.01",
                }
            }
            text.push('\n');
        }
        lab.write(&format!("c{index}.csv"), &text);
    }
    let (code, said, complaint) = lab.calibrate(&["--compare", "truth.toml"]);
    assert_eq!(code, 0, "{said}\n{complaint}");
    assert!(complaint.contains("0 left_ear, 1 nose, 2 right_ear, 3 tail"), "{complaint}");
    assert!(said.contains("labels of c1:") && said.contains("left_ear show right_ear"), "{said}");
    assert!(lab.summary()["compare.centre_mm.max"].as_f64().unwrap() < 30.0, "{said}");
}
