//! The `foveate` program as a person uses it: commands, exit codes, bad input of every kind.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use serde_json::Value;

use crate::the_program::{foveate, new_room, program, root};

/// A folder with the simulated lab's rig in it, changed by `edit`.
fn lab(edit: impl FnOnce(String) -> String) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let rig = new_room(folder.path());
    fs::write(folder.path().join("room.toml"), edit(rig)).unwrap();
    folder
}

/// `foveate check` on the changed lab refuses and says all of `words`.
#[track_caller]
fn refuses(edit: impl FnOnce(String) -> String, words: &[&str]) {
    let folder = lab(edit);
    let (code, _, complaint) = foveate(folder.path(), &["check", "room.toml"]);
    assert_eq!(code, 2, "{complaint}");
    for word in words {
        assert!(complaint.contains(word), "`{word}` is not in:\n{complaint}");
    }
    let (code, ..) = foveate(folder.path(), &["run", "room.toml", "--quiet", "--out", "out"]);
    assert_eq!(code, 2, "a rig that is refused does not run");
    assert!(!folder.path().join("out").exists(), "and leaves no results");
}

#[test]
fn renamed_settings_and_their_renamed_words_are_refused_with_the_new_name() {
    let integrator = "type = \"led.integrator\"\n";
    let old = format!("{integrator}birth_cameras = 3\nprobation_ms = 100\nlate = \"refilter\"\n");
    refuses(
        |it| it.replace(integrator, &old),
        &[
            "the setting `birth_cameras` is now called `initiation_cameras`",
            "the setting `probation_ms` is now called `tentative_ms`",
            "\"refilter\" is now called \"out_of_sequence\"",
        ],
    );
}

#[test]
fn lab_as_it_comes_has_no_fault_and_runs_to_the_same_bytes_twice() {
    let folder = lab(|it| it);
    assert_eq!(foveate(folder.path(), &["check", "room.toml"]).0, 0);
    for out in ["a", "b"] {
        let (code, said, complaint) =
            foveate(folder.path(), &["run", "room.toml", "--duration", "1.5", "--quiet", "--out", out]);
        assert_eq!(code, 0, "{said}{complaint}");
    }
    for file in
        ["summary.json", "targets.csv", "truth.csv", "ledger.csv", "events.csv", "rig.resolved.toml", "path_top.svg"]
    {
        let read =
            |out: &str| fs::read(folder.path().join(out).join(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
        let (a, b) = (read("a"), read("b"));
        assert!(!a.is_empty(), "{file} is empty");
        assert_eq!(a, b, "{file} differs between two runs of one seed");
    }
    let (code, ..) =
        foveate(folder.path(), &["run", "room.toml", "--duration", "1.5", "--seed", "2", "--quiet", "--out", "c"]);
    assert_eq!(code, 0);
    let read = |out: &str| fs::read(folder.path().join(out).join("targets.csv")).unwrap();
    assert_ne!(read("a"), read("c"), "another seed is another run");
}

#[test]
fn results_are_numbered_and_the_resolved_rig_runs_again_to_the_same_table() {
    let folder = lab(|it| it);
    for _ in 0..2 {
        assert_eq!(foveate(folder.path(), &["run", "room.toml", "--duration", "1.2", "--quiet"]).0, 0);
    }
    let first = folder.path().join("results/room-1");
    assert!(folder.path().join("results/room-2/summary.json").exists());
    fs::copy(first.join("rig.resolved.toml"), folder.path().join("again.toml")).unwrap();
    let (code, _, complaint) = foveate(folder.path(), &["run", "again.toml", "--quiet", "--out", "again"]);
    assert_eq!(code, 0, "{complaint}");
    let read = |path: PathBuf| fs::read_to_string(path.join("targets.csv")).unwrap();
    assert_eq!(read(first), read(folder.path().join("again")));
}

#[test]
fn faults_are_named_where_they_are() {
    refuses(
        |it| it.replace("led.detector", "led.detectr"),
        &["led.detectr", "did you mean", "led.detector", "room.toml:"],
    );
    refuses(|it| it.replace("offset = 20", "offset = -1"), &["offset", "-1", "0", "gray level"]);
    refuses(|it| it.replace("grid_px", "gird_px"), &["gird_px", "grid_px"]);
    refuses(|it| it.replace("each = \"wide-*\"", "each = \"tele-*\""), &["tele-*", "wide-1"]);
    refuses(|it| it.replace("image = \"video.image\", ", ""), &["image", "leds"]);
    refuses(|it| it.replace("\"leds.features\"", "\"video.image\""), &["image", "features"]);
    refuses(|it| it.replace("rate_hz = 30", "rate_hz = 300"), &["300", "60"]);
    refuses(|_| "this is = = not TOML".to_owned(), &["room.toml:1"]);
    refuses(|_| String::new(), &["rig"]);
}

#[test]
fn two_nodes_may_not_write_one_file() {
    let again = "\n[scale.room.node.again]\ntype = \"export.targets\"\nin = { targets = \"targets.targets\" }\n";
    refuses(|it| it + again, &["targets.csv", "room.table", "scale.room.node.again"]);
    refuses(|it| it.replace("rate_hz = 60", "file = \"summary.json\""), &["summary.json", "foveate"]);
}

#[test]
fn real_recording_is_recovered_as_well_as_by_the_peer() {
    let Some(folder) = foveate_testkit::data_dir_or_skip("program", "s01_arctic_laser_4cam") else { return };
    let out = tempfile::tempdir().unwrap();
    let rig = root().join("graphs/laser_room.toml");
    let mut command = Command::new(program());
    command.env("FOVEATE_DATA", folder.parent().unwrap()).args(["run", "--quiet", "--out"]).arg(out.path()).arg(rig);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let summary: Value = serde_json::from_slice(&fs::read(out.path().join("summary.json")).unwrap()).unwrap();
    let figure = |name: &str| summary[name].as_f64().unwrap_or_else(|| panic!("{name} is not in {summary:#}"));
    // What MultiCamSelfCal reached on the same pictures, with frames of three cameras or more.
    assert!(figure("frames_recovered") >= 446.0, "{summary:#}");
    assert!(figure("reprojection_px.median") <= 0.36, "{summary:#}");
    assert!(figure("reprojection_px.p90") <= 1.5, "{summary:#}");
}

#[test]
fn real_flight_is_recovered_with_clocks_and_lost_without() {
    let Some(folder) = foveate_testkit::data_dir_or_skip("program", "s04_drone_multicam") else { return };
    let out = tempfile::tempdir().unwrap();
    let mut command = Command::new(program());
    command.env("FOVEATE_DATA", folder.parent().unwrap()).args(["run", "--quiet", "--out"]).arg(out.path());
    let output = command.arg(root().join("graphs/drones.toml")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let summary: Value = serde_json::from_slice(&fs::read(out.path().join("summary.json")).unwrap()).unwrap();
    let figure = |name: &str| summary[name].as_f64().unwrap_or_else(|| panic!("{name} is not in {summary:#}"));
    for branch in ["", "[field.estimated_error]"] {
        // On the part of the flight that the calibration has not seen.
        assert!(figure(&format!("rtk_error_m.median{branch}")) < 0.3, "{summary:#}");
        assert!(figure(&format!("rtk_error_m.coverage{branch}")) > 0.95, "{summary:#}");
    }
    assert!(figure("rtk_error_m.coverage[field.unsynchronised_error]") < 0.05, "{summary:#}");
}

#[test]
fn all_faults_come_in_one_run() {
    refuses(
        |it| it.replace("offset = 20", "offset = -1").replace("grid_px", "gird_px").replace("sim.score", "sim.scor"),
        &["offset", "gird_px", "sim.scor"],
    );
}

#[test]
fn calibration_that_lacks_a_camera_or_holds_nan_is_refused() {
    refuses(|it| it.replace("each = \"wide-*\"", "camera = \"wide-99\""), &["wide-99"]);
    let folder = lab(|it| it);
    let path = folder.path().join("room.calibration.toml");
    let text = fs::read_to_string(&path).unwrap();
    let line = text.lines().find(|it| it.starts_with("position_m")).unwrap().to_owned();
    fs::write(&path, text.replacen(&line, "position_m = [nan, 0.0, 2.5]", 1)).unwrap();
    let (code, _, complaint) = foveate(folder.path(), &["check", "room.toml"]);
    assert_eq!(code, 2);
    assert!(complaint.to_lowercase().contains("nan") && complaint.contains("position_m"), "{complaint}");
    fs::remove_file(&path).unwrap();
    let (code, _, complaint) = foveate(folder.path(), &["check", "room.toml"]);
    assert_eq!(code, 2);
    assert!(complaint.contains("room.calibration.toml"), "{complaint}");
}

#[test]
fn hundred_megabytes_a_folder_and_nothing_at_all_are_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let huge = fs::File::create(folder.path().join("huge.toml")).unwrap();
    huge.set_len(100 << 20).unwrap();
    for (rig, word) in [("huge.toml", "too long"), (".", "folder"), ("missing.toml", "missing.toml")] {
        let (code, _, complaint) = foveate(folder.path(), &["check", rig]);
        assert_eq!(code, 2, "{rig}: {complaint}");
        assert!(complaint.to_lowercase().contains(&word.to_lowercase()), "{rig}: {complaint}");
    }
    fs::write(folder.path().join("bytes.toml"), [0xff, 0xfe, 0x00, 0x80]).unwrap();
    let (code, _, complaint) = foveate(folder.path(), &["check", "bytes.toml"]);
    assert_eq!(code, 2);
    assert!(complaint.contains("UTF-8"), "{complaint}");
}

#[test]
fn results_that_cannot_be_written_are_an_error_and_the_figures_still_reach_the_person() {
    let folder = lab(|it| it);
    fs::write(folder.path().join("occupied"), "a file").unwrap();
    let (code, _, complaint) =
        foveate(folder.path(), &["run", "room.toml", "--duration", "0.2", "--quiet", "--out", "occupied/out"]);
    assert_eq!(code, 2);
    assert!(complaint.contains("occupied/out"), "{complaint}");
}

#[test]
fn requirement_marked_must_decides_the_exit_code() {
    let folder = lab(|it| it.replace("rate_hz = 30", "sigma = 1e-6, must = true"));
    let (code, said, complaint) =
        foveate(folder.path(), &["run", "room.toml", "--duration", "1.2", "--quiet", "--out", "out"]);
    assert_eq!((code, said.as_str()), (3, ""));
    assert!(complaint.contains("error: requirement not met (must)"), "{complaint}");
    assert!(folder.path().join("out/summary.json").exists());
}

#[test]
fn every_node_type_describes_itself() {
    let folder = tempfile::tempdir().unwrap();
    let (code, list, _) = foveate(folder.path(), &["nodes"]);
    assert_eq!(code, 0);
    for node_type in foveate_cli::registry().iter() {
        assert!(list.contains(node_type.name));
        let (code, text, _) = foveate(folder.path(), &["nodes", node_type.name]);
        assert_eq!(code, 0);
        assert!(text.contains(node_type.summary), "{text}");
    }
    let (code, _, complaint) = foveate(folder.path(), &["nodes", "led.detektor"]);
    assert_eq!(code, 2);
    assert!(complaint.contains("did you mean `led.detector`"), "{complaint}");
}

#[test]
fn new_rig_is_sound_and_overwrites_nothing() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(foveate(folder.path(), &["new", "rig", "my_lab"]).0, 0);
    let (code, _, complaint) = foveate(folder.path(), &["check", "my_lab.toml"]);
    assert_eq!(code, 0, "{complaint}");
    let (code, _, complaint) = foveate(folder.path(), &["new", "rig", "my_lab"]);
    assert_eq!(code, 2);
    assert!(complaint.contains("my_lab"), "{complaint}");
    assert_eq!(foveate(folder.path(), &["new", "rig", "../My Lab"]).0, 2);
}

#[test]
fn new_hall_of_any_size_is_sound() {
    let folder = tempfile::tempdir().unwrap();
    for (name, cameras, hall) in [("small", "18", "8,8,2.5"), ("large", "200", "30.5,20,6")] {
        let arguments = ["new", "rig", name, "--cameras", cameras, "--hall", hall];
        assert_eq!(foveate(folder.path(), &arguments).0, 0);
        let (code, _, complaint) = foveate(folder.path(), &["check", &format!("{name}.toml")]);
        assert_eq!(code, 0, "{complaint}");
    }
    let rig = std::fs::read_to_string(folder.path().join("large.toml")).unwrap();
    assert!(rig.contains("a hall of 30.5 x 20 x 6 m, under 200 cameras") && rig.contains("[25.5, 15.0]"), "{rig}");
    for hall in ["8,8", "8,x,3", "7,9,3", "9,9,3,1"] {
        let (code, _, complaint) = foveate(folder.path(), &["new", "rig", "it", "--cameras", "9", "--hall", hall]);
        assert!(code == 2 && complaint.contains("X,Y,Z"), "{hall}: {code} {complaint}");
    }
}

#[test]
fn pictures_schema_and_completions_are_what_they_claim() {
    let folder = lab(|it| it);
    assert_eq!(foveate(folder.path(), &["graph", "room.toml"]).0, 0);
    assert!(fs::read_to_string(folder.path().join("room.svg")).unwrap().starts_with("<svg"));
    let (code, mermaid, _) = foveate(folder.path(), &["graph", "room.toml", "--format", "mermaid", "-o", "-"]);
    assert_eq!(code, 0);
    assert!(mermaid.starts_with("flowchart") || mermaid.starts_with("graph"), "{mermaid}");
    let (code, schema, _) = foveate(folder.path(), &["schema"]);
    assert_eq!(code, 0);
    let schema: Value = serde_json::from_str(&schema).unwrap();
    assert!(schema["$schema"].as_str().unwrap().contains("2020-12"));
    for shell in ["bash", "zsh", "fish"] {
        let (code, script, _) = foveate(folder.path(), &["completions", shell]);
        assert_eq!(code, 0);
        assert!(script.contains("foveate"));
    }
}

#[test]
fn calibrations_are_converted_and_what_is_lost_is_said() {
    let folder = lab(|it| it);
    let at = folder.path();
    let (code, said, complaint) = foveate(at, &["convert", "room.calibration.toml", "Calib.toml", "--to", "pose2sim"]);
    assert_eq!(code, 0, "{complaint}");
    assert!(said.contains("Calib.toml: ") && said.contains("lengths in metres, pose2sim"), "{said}");
    let (code, said, complaint) = foveate(at, &["convert", "Calib.toml", "again.toml"]);
    assert_eq!((code, said.contains("nothing is lost")), (0, true), "{said}{complaint}");
    // A rig takes either: the same cameras, the same run.
    let rig = fs::read_to_string(at.join("room.toml")).unwrap();
    fs::write(at.join("foreign.toml"), rig.replace("room.calibration.toml", "Calib.toml")).unwrap();
    assert_eq!(foveate(at, &["check", "foreign.toml"]).0, 0);

    let (code, _, complaint) = foveate(at, &["convert", "Calib.toml", "again.toml"]);
    assert_eq!((code, complaint.contains("`again.toml` is there already")), (2, true), "{complaint}");
    let (code, _, complaint) = foveate(at, &["convert", "room.calibration.toml", "dlt.csv", "--strict"]);
    assert_eq!((code, complaint.contains("the image sizes")), (2, true), "{complaint}");
    assert!(!at.join("dlt.csv").exists());
    assert_eq!(foveate(at, &["convert", "room.calibration.toml", "dlt.csv"]).0, 0);
    let (code, _, complaint) = foveate(at, &["convert", "dlt.csv", "back.toml"]);
    assert_eq!((code, complaint.contains("hold no image size")), (2, true), "{complaint}");
    assert_eq!(foveate(at, &["convert", "dlt.csv", "back.toml", "--image-size", "640,480"]).0, 0);
    let (code, _, complaint) = foveate(at, &["convert", "dlt.csv", "back.toml", "--image-size", "640"]);
    assert_eq!((code, complaint.contains("expected W,H")), (2, true), "{complaint}");
    // A world in which what is up points along -y, and back again.
    let (code, _, complaint) = foveate(at, &["convert", "room.calibration.toml", "down.toml", "--from-up", "-y"]);
    assert_eq!(code, 0, "{complaint}");
    assert_eq!(foveate(at, &["convert", "down.toml", "up.toml", "--from-up", "y"]).0, 0);
    let position = |name: &str| -> Vec<f64> {
        let text = fs::read_to_string(at.join(name)).unwrap();
        let line = text.lines().find(|it| it.starts_with("position_m")).unwrap();
        line.split(['[', ',', ']']).filter_map(|it| it.trim().parse().ok()).collect()
    };
    let [was, down, up] = ["room.calibration.toml", "down.toml", "up.toml"].map(position);
    let is_same = |a: &[f64], b: &[f64]| a.len() == 3 && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
    assert!(is_same(&up, &was) && is_same(&down, &[was[0], was[2], -was[1]]), "{was:?} {down:?} {up:?}");
    let (code, _, complaint) =
        foveate(at, &["convert", "room.calibration.toml", "other.toml", "--image-size", "641,480"]);
    assert_eq!((code, complaint.contains("`--image-size 641,480` contradicts")), (2, true), "{complaint}");
    let (code, _, complaint) = foveate(at, &["convert", "room.toml", "x.bin"]);
    assert_eq!((code, complaint.contains("room.toml:")), (2, true), "{complaint}");
    let (code, _, complaint) = foveate(at, &["convert", "room.calibration.toml", "x.bin"]);
    assert_eq!((code, complaint.contains("--to with one of")), (2, true), "{complaint}");
}
