//! `foveate convert` and `foveate compare` on motion files, and a rig that reads one, as a person uses them.

use std::fs;
use std::path::{Path, PathBuf};

use crate::the_program::foveate;
use foveate_testkit::data_dir_or_skip;
use serde_json::Value;

/// A table of eight points of a body that walks, at 100 Hz for two seconds: one is missing for 70 ms, then for 300 ms.
fn walk(folder: &Path) {
    let names =
        ["head", "waist", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"];
    let rest =
        [[0.0, 1.7], [0.0, 1.0], [0.2, 1.45], [-0.2, 1.45], [0.3, 1.2], [-0.3, 1.2], [0.35, 0.95], [-0.35, 0.95]];
    let mut text = "time_s,target,x_m,y_m,z_m,provenance,name\n".to_owned();
    for frame in 0..200 {
        let t = f64::from(frame) / 100.0;
        for (number, (name, [y, z])) in names.iter().zip(rest).enumerate() {
            let is_hidden = number == 6 && ((50..57).contains(&frame) || (100..130).contains(&frame));
            let swing = if number >= 4 { 0.1 * (6.0 * t + number as f64).sin() } else { 0.0 };
            if !is_hidden {
                text += &format!(
                    "{t:.6},{number},{:.6},{y:.6},{:.6},measured,{name}\n",
                    1.2 * t + swing,
                    z + 0.02 * (12.0 * t).sin()
                );
            }
        }
    }
    fs::write(folder.join("walk.csv"), text).unwrap();
}

#[track_caller]
fn done(folder: &Path, arguments: &[&str]) -> String {
    let (code, said, complaint) = foveate(folder, arguments);
    assert_eq!(code, 0, "{arguments:?}: {said}{complaint}");
    said
}

#[track_caller]
fn refused(folder: &Path, arguments: &[&str], words: &str) {
    let (code, said, complaint) = foveate(folder, arguments);
    assert_eq!((code, complaint.contains(words)), (2, true), "{arguments:?}: {said}{complaint}");
    assert!(complaint.starts_with("error: "), "{complaint}");
}

/// What `compare` says in its file of figures.
#[track_caller]
fn compared(folder: &Path, arguments: &[&str]) -> Value {
    let arguments = [&["compare"], arguments, &["--json", "-"]].concat();
    serde_json::from_str(&done(folder, &arguments)).unwrap()
}

#[test]
fn motion_goes_from_form_to_form_and_back() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    walk(at);
    let said = done(at, &["convert", "walk.csv", "walk.c3d"]);
    assert!(
        said.contains("walk.csv: CSV, 8 points, 200 frames at 100 Hz") && said.contains("nothing is lost"),
        "{said}"
    );
    done(at, &["convert", "walk.c3d", "walk.trc"]);
    // y is up in the table, as its readers take it.
    done(at, &["convert", "walk.trc", "walk.npz"]);
    done(at, &["convert", "walk.trc", "straight.csv"]);
    let figures = compared(at, &["walk.csv", "straight.csv"]);
    assert!(figures["all"]["max_mm"].as_f64().unwrap() < 0.01, "{}", figures["all"]);
    let said = done(at, &["convert", "walk.c3d", "z.trc", "--up", "z"]);
    assert!(said.contains("--from-up z"), "{said}");
    done(at, &["convert", "z.trc", "walk.npz", "--from-up", "z", "--force"]);
    done(at, &["convert", "walk.npz", "again.csv"]);
    done(at, &["convert", "walk.c3d", "walk.glb"]);
    let figures = compared(at, &["walk.csv", "again.csv"]);
    assert_eq!((figures["pairing"].as_str(), figures["frames_compared"].as_u64()), (Some("names"), Some(200)));
    assert_eq!(figures["all"]["samples"], 8 * 200 - 37);
    assert_eq!((figures["all"]["only_in_a"].as_u64(), figures["all"]["only_in_b"].as_u64()), (Some(0), Some(0)));
    assert!(figures["all"]["max_mm"].as_f64().unwrap() < 0.002, "{}", figures["all"]);
    let glb = fs::read(at.join("walk.glb")).unwrap();
    assert!(glb.starts_with(b"glTF") && glb.windows(10).any(|it| it == b"left_wrist"));

    let said = done(at, &["convert", "walk.c3d", "walk.bvh"]);
    assert!(said.contains("joints: head = head, waist = waist") && said.contains("LeftForeArm in 37"), "{said}");
    let said = done(at, &["compare", "walk.bvh", "walk.bvh", "--summary"]);
    assert!(said.contains("A: walk.bvh: BVH, 10 points") && said.contains("all"), "{said}");
    // A skeleton into points: its joints are where the points were.
    done(at, &["convert", "walk.bvh", "joints.csv", "--up", "z"]);
    let figures = compared(at, &["walk.csv", "joints.csv", "--match", "nearest", "--align"]);
    assert!(figures["all"]["median_mm"].as_f64().unwrap() < 15.0, "{}", figures["all"]);
}

#[test]
fn names_that_lie_at_other_points_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    walk(at);
    let mut text = fs::read_to_string(at.join("walk.csv")).unwrap();
    for [a, b] in [["head", "waist"], ["left", "right"]] {
        text = text.replace(a, "?").replace(b, a).replace('?', b);
    }
    fs::write(at.join("exchanged.csv"), text).unwrap();
    let is_noted = |it: &Value| it["notes"].to_string().contains("`--match nearest`");
    assert!(!is_noted(&compared(at, &["walk.csv", "walk.csv"])));
    let exchanged = compared(at, &["walk.csv", "exchanged.csv"]);
    assert!(is_noted(&exchanged) && exchanged["all"]["median_mm"].as_f64().unwrap() > 300.0, "{exchanged:#}");
}

#[test]
fn gaps_are_filled_and_paths_smoothed() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    walk(at);
    let said = done(at, &["convert", "walk.csv", "filled.csv", "--fill", "0.1", "--smooth", "10"]);
    assert!(said.contains("filled 1 gaps with 7 samples; 1 are longer than 0.1 s"), "{said}");
    assert!(said.contains("smoothed 1570 samples at 10 Hz\n"), "{said}");
    let text = fs::read_to_string(at.join("filled.csv")).unwrap();
    assert_eq!(text.lines().filter(|it| it.contains(",filled,")).count(), 7);
    let figures = compared(at, &["walk.csv", "filled.csv"]);
    assert_eq!(figures["all"]["only_in_b"], 7);
    assert!(figures["all"]["p95_mm"].as_f64().unwrap() < 3.0, "{}", figures["all"]);
    // C3D keeps the flag.
    done(at, &["convert", "filled.csv", "filled.c3d"]);
    done(at, &["convert", "filled.c3d", "again.csv"]);
    let again = fs::read_to_string(at.join("again.csv")).unwrap();
    assert_eq!(again.lines().filter(|it| it.contains(",filled,")).count(), 7);
    let said = done(at, &["convert", "walk.csv", "slow.c3d", "--rate", "60"]);
    assert!(said.contains("resampled from 100 Hz to 60.000 Hz, 120 frames"), "{said}");
    let figures = compared(at, &["walk.csv", "slow.c3d"]);
    assert!(figures["all"]["max_mm"].as_f64().unwrap() < 0.1, "{}", figures["all"]);
}

#[test]
fn what_cannot_be_converted_is_refused_and_nothing_is_written_over() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    walk(at);
    done(at, &["convert", "walk.csv", "walk.c3d"]);
    refused(at, &["convert", "walk.csv", "walk.c3d"], "`walk.c3d` is there already");
    done(at, &["convert", "walk.csv", "walk.c3d", "--force"]);
    refused(at, &["convert", "walk.csv", "walk.xyz"], "expected .c3d, .trc, .bvh, .csv, .npz, .glb, or --to");
    refused(at, &["convert", "walk.csv", "x.toml"], "whose ending names no form of motion");
    refused(at, &["convert", "walk.csv", "x", "--to", "opencv"], "opencv is a form of calibrations");
    refused(at, &["convert", "walk.csv", "x.trc", "--lenses"], "--lenses is for calibrations");
    refused(at, &["convert", "walk.csv", "x.trc", "--fill", "-1"], "");
    refused(at, &["convert", "walk.csv", "x.trc", "--smooth", "50"], "less than 50");
    refused(at, &["convert", "walk.csv", "x.bvh", "--joints", "tail=head"], "`tail`");
    refused(at, &["convert", "nothing.c3d", "x.trc"], "`nothing.c3d` cannot be read");
    fs::write(at.join("cut.c3d"), &fs::read(at.join("walk.c3d")).unwrap()[..3000]).unwrap();
    refused(at, &["convert", "cut.c3d", "x.trc"], "at byte ");
    fs::write(at.join("empty.trc"), "").unwrap();
    refused(at, &["convert", "empty.trc", "x.c3d"], "`empty.trc` is no TRC file");
    let walk = fs::read_to_string(at.join("walk.csv")).unwrap();
    fs::write(at.join("semicolons.csv"), walk.replace(',', ";")).unwrap();
    for command in [&["convert", "semicolons.csv", "x.trc"], &["compare", "walk.csv", "semicolons.csv"]] {
        refused(
            at,
            command,
            "`semicolons.csv` is no table of targets or marks that can be read: line 1: found columns with semicolons",
        );
    }
    fs::write(at.join("renamed.csv"), walk.replace("target", "number")).unwrap();
    refused(at, &["convert", "renamed.csv", "x.trc"], "no column `target` or `mark`, and `number` instead");
    fs::write(at.join("header.csv"), walk.lines().next().unwrap().to_owned() + "\n").unwrap();
    refused(at, &["convert", "header.csv", "x.trc"], "found no samples: 0 points in 0 frames");
    let exchanged = walk.replace("head", "h").replace("left_wrist", "head").replace(",h\n", ",left_wrist\n");
    fs::write(at.join("exchanged.csv"), exchanged).unwrap();
    refused(at, &["convert", "exchanged.csv", "x.bvh"], "--joints 'head=left_wrist,waist=waist");
    done(at, &["convert", "exchanged.csv", "as_it_is.bvh", "--any-proportions"]);
    let legs = fs::read_to_string(at.join("walk.csv")).unwrap().replace("shoulder", "knee");
    fs::write(at.join("legs.csv"), legs).unwrap();
    refused(at, &["convert", "legs.csv", "x.bvh"], "no points for left_shoulder, right_shoulder among `head`");
    refused(at, &["convert", "walk.c3d", "x.trc", "--strict", "--rate", "nan"], "");
    fs::write(at.join("room.toml"), "[camera.a]\n").unwrap();
    refused(at, &["convert", "room.toml", "x.toml", "--smooth", "6"], "--smooth is for motion files");
    refused(at, &["compare", "walk.csv", "room.toml"], "`room.toml` is no motion file");
    // All forms that the command reads, on one line.
    fs::write(at.join("notes.txt"), "a walk of 4 s\n".repeat(1000)).unwrap();
    for (command, other) in
        [(["convert", "notes.txt", "x.trc"], "Qualisys"), (["compare", "walk.csv", "notes.txt"], "PLY")]
    {
        refused(at, &command, "C3D, TRC, BVH, NPZ");
        let (_, _, complaint) = foveate(at, &command);
        assert!(complaint.contains(other) && complaint.lines().count() == 1, "{complaint}");
    }
    refused(at, &["compare", "walk.csv", "legs.csv", "--match", "names", "--shift", "0"], "");
    assert!(!at.join("x.trc").exists() && !at.join("x.bvh").exists());
}

#[test]
fn a_dash_is_standard_output() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    walk(at);
    done(at, &["convert", "walk.csv", "walk.trc"]);
    let (code, table, said) = foveate(at, &["convert", "walk.trc", "-", "--to", "csv"]);
    assert_eq!((code, table.lines().count()), (0, 1 + 1600 - 37), "{said}");
    assert!(table.starts_with("time_s,target,") && said.contains("nothing is lost"), "{said}");
    assert!(!at.join("-").exists());
    refused(at, &["convert", "walk.trc", "-"], "or --to");
}

#[test]
fn a_start_that_a_form_cannot_tell_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    walk(at);
    let later: String = fs::read_to_string(at.join("walk.csv"))
        .unwrap()
        .lines()
        .map(|it| match it.split_once('.') {
            Some((seconds, rest)) => format!("{}.{rest}\n", seconds.parse::<u32>().unwrap() + 3),
            None => format!("{it}\n"),
        })
        .collect();
    fs::write(at.join("later.csv"), later).unwrap();
    for name in ["later.bvh", "later.glb"] {
        let said = done(at, &["convert", "later.csv", name]);
        assert!(said.contains("the first frame is at 3.000000 s"), "{said}");
    }
    let said = done(at, &["convert", "walk.csv", "walk.glb"]);
    assert!(!said.contains("when it begins"), "{said}");
    done(at, &["convert", "walk.csv", "walk.bvh"]);
    fs::write(
        at.join("half.csv"),
        fs::read_to_string(at.join("later.csv")).unwrap().replace("\n3.", "\n0.").replace("\n4.", "\n1."),
    )
    .unwrap();
    let said = done(at, &["compare", "half.csv", "walk.bvh", "--match", "nearest"]);
    assert!(!said.contains("share no clock"), "{said}");
    let halves: String = fs::read_to_string(at.join("walk.csv"))
        .unwrap()
        .lines()
        .filter(|it| !it.starts_with("0.0"))
        .map(|it| format!("{it}\n"))
        .collect();
    fs::write(at.join("tenth.csv"), halves).unwrap();
    let said = done(at, &["compare", "tenth.csv", "walk.bvh", "--match", "nearest"]);
    assert!(said.contains("A begins at 0.100 s, B at 0.000 s, but B does not say when it begins"), "{said}");
}

#[test]
fn files_are_held_against_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    walk(at);
    let text = fs::read_to_string(at.join("walk.csv")).unwrap();
    // 5 mm along y, 0.2 s later, under other names.
    let moved: String = text
        .lines()
        .enumerate()
        .map(|(line, row)| {
            let mut fields: Vec<String> = row.split(',').map(str::to_owned).collect();
            if line > 0 {
                fields[0] = format!("{:.6}", fields[0].parse::<f64>().unwrap() + 0.2);
                fields[3] = format!("{:.6}", fields[3].parse::<f64>().unwrap() + 0.005);
                fields[6] = format!("other {}", fields[1]);
            }
            fields.join(",") + "\n"
        })
        .collect();
    fs::write(at.join("moved.csv"), moved).unwrap();
    let figures = compared(at, &["walk.csv", "moved.csv", "--shift", "0.5", "--match", "nearest"]);
    assert!((figures["shift_s"].as_f64().unwrap() + 0.2).abs() < 1e-3, "{}", figures["shift_s"]);
    assert!((figures["all"]["median_mm"].as_f64().unwrap() - 5.0).abs() < 0.2, "{}", figures["all"]);
    assert_eq!(
        (figures["points"][0]["a"].as_str(), figures["points"][0]["b"].as_str()),
        (Some("head"), Some("other 0"))
    );
    let (code, _, complaint) = foveate(at, &["compare", "walk.csv", "moved.csv", "--shift", "0.5", "--within", "1"]);
    assert_eq!((code, complaint.contains("expected 1 mm")), (3, true), "{complaint}");
    let said =
        done(at, &["compare", "walk.csv", "moved.csv", "--shift", "0.5", "--within", "6", "--json", "figures.json"]);
    assert!(said.contains("8 points paired by place") && said.contains("head = other 0"), "{said}");
    let figures: Value = serde_json::from_slice(&fs::read(at.join("figures.json")).unwrap()).unwrap();
    assert_eq!(figures["b"]["form"], "CSV");
    refused(at, &["compare", "walk.csv", "moved.csv", "--match", "names"], "no name in both");
}

/// One trial of a laboratory in both its forms, through the program: 0.7 mm apart, which is the smoothing of the table.
#[test]
fn a_trial_of_a_laboratory_agrees_with_itself() {
    let Some(data) = data_dir_or_skip("a_trial_of_a_laboratory_agrees_with_itself", "s10_btk_c3d_trc") else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let path = |name: &str| -> String {
        PathBuf::from(&data).join(name).canonicalize().unwrap().to_string_lossy().into_owned()
    };
    let (c3d, trc) = (path("C3DSamples__others__Gait.c3d"), path("TRCSamples__Gait.trc"));
    let figures = compared(at, &[&c3d, &trc, "--match", "nearest"]);
    let median = figures["all"]["median_mm"].as_f64().unwrap();
    assert!((0.3..1.0).contains(&median), "{median} mm");
    for form in ["trc", "csv", "npz", "c3d"] {
        let name = format!("gait.{form}");
        done(at, &["convert", &c3d, &name]);
        let figures = compared(at, &[&c3d, &name]);
        assert_eq!(figures["all"]["only_in_a"], 0);
        assert!(figures["all"]["max_mm"].as_f64().unwrap() < 0.001, "{form}: {}", figures["all"]);
    }
    // A rig that reads it.
    let rig = fs::read_to_string(crate::the_program::root().join("graphs/motion_file.toml")).unwrap();
    fs::write(at.join("rig.toml"), rig.replace("${FOVEATE_DATA}/s10_btk_c3d_trc/C3DSamples__others__Gait.c3d", &c3d))
        .unwrap();
    done(at, &["run", "rig.toml", "--out", "results", "--quiet"]);
    let summary: Value = serde_json::from_slice(&fs::read(at.join("results/summary.json")).unwrap()).unwrap();
    assert_eq!(summary["motion.frames"].as_f64(), Some(487.0), "{summary:#}");
    let figures = compared(at, &[&c3d, "results/motion.c3d", "--match", "nearest"]);
    assert!(figures["all"]["median_mm"].as_f64().unwrap() < 1.0, "{}", figures["all"]);
}
