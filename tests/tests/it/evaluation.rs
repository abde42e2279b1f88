//! `foveate eval` as people use it: many seeds, promises, seeds that fail.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::the_program::foveate;

/// A hall of lights without pictures, which runs in no time.
fn hall() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(foveate(folder.path(), &["new", "rig", "hall", "--cameras", "6"]).0, 0);
    folder
}

fn read(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

#[test]
fn seeds_differ_and_the_same_seeds_give_the_same() {
    let folder = hall();
    let eval = |out: &str, jobs: &str| {
        let arguments =
            ["eval", "hall.toml", "--seeds", "3", "--first-seed", "7", "--duration", "2", "--jobs", jobs, "--out", out];
        let (code, said, complaint) = foveate(folder.path(), &arguments);
        assert_eq!(code, 0, "{said}{complaint}");
        said
    };
    let said = eval("one", "1");
    eval("two", "3");
    for name in ["eval.json", "eval.csv", "eval.svg"] {
        assert_eq!(read(folder.path(), &format!("one/{name}")), read(folder.path(), &format!("two/{name}")), "{name}");
    }
    let json: Value = serde_json::from_str(&read(folder.path(), "one/eval.json")).unwrap();
    assert_eq!((&json["seeds"], &json["failed"]), (&serde_json::json!([7, 8, 9]), &serde_json::json!([])));
    let error = &json["figures"]["error_mm.rms"];
    let values: Vec<f64> = error["values"].as_array().unwrap().iter().map(|it| it.as_f64().unwrap()).collect();
    let worst = values.iter().copied().fold(0.0, f64::max);
    assert!(values[0] != values[1] && error["worst"]["value"].as_f64() == Some(worst), "{error}");
    assert!(said.contains("error_mm.rms") && said.contains("3 of 3 seeds"), "{said}");
    // Of each seed what a person asks for next stays, and no more.
    let mut kept: Vec<String> = fs::read_dir(folder.path().join("one/seed-8"))
        .unwrap()
        .map(|it| it.unwrap().file_name().into_string().unwrap())
        .collect();
    kept.sort();
    assert_eq!(kept, ["events.csv", "ledger.csv", "run.json", "summary.json", "timing.json"]);
    // A single run with that seed gives the same figure.
    let run = ["run", "hall.toml", "--seed", "8", "--duration", "2", "--quiet", "--out", "alone"];
    assert_eq!(foveate(folder.path(), &run).0, 0);
    let alone: Value = serde_json::from_str(&read(folder.path(), "alone/summary.json")).unwrap();
    assert_eq!(alone["error_mm.rms"].as_f64(), Some(values[1]));
}

#[test]
fn promises_that_do_not_hold_and_seeds_that_fail_are_told() {
    let folder = hall();
    let eval = |rig: &str, more: &[&str]| {
        let _ = fs::remove_dir_all(folder.path().join("eval")); // none before the first time
        let arguments = [&["eval", rig, "--seeds", "2", "--duration", "4", "--out", "eval", "--quiet"], more].concat();
        let (code, _, complaint) = foveate(folder.path(), &arguments);
        (code, complaint)
    };
    let (code, complaint) = eval("hall.toml", &["--bound", "error_mm.rms<=1000"]);
    assert_eq!(code, 0, "{complaint}");
    let (code, complaint) = eval("hall.toml", &["--bound", "error_mm.rms>=1000", "--bound", "median eror_mm.rms<=9"]);
    assert_eq!(code, 3, "{complaint}");
    assert!(complaint.contains("error_mm.rms >= 1000: found") && complaint.contains("did you mean"), "{complaint}");
    let (code, complaint) = eval("hall.toml", &["--bound", "error_mm.rms=3"]);
    assert!(code == 2 && complaint.contains("expected `FIGURE<=NUMBER`"), "{complaint}");

    let broken = read(folder.path(), "hall.toml").replace("noise_px = 0.1", "noise_px = -0.1");
    fs::write(folder.path().join("broken.toml"), broken).unwrap();
    let (code, complaint) = eval("broken.toml", &[]);
    assert!(code == 2 && complaint.contains("noise_px") && !complaint.contains("seed"), "told once: {complaint}");

    let process = "\n[scale.room.node.gone]\ntype = \"process.filter\"\ncommand = [\"false\"]\nin = { targets = \"targets.targets\" }\n";
    fs::write(folder.path().join("gone.toml"), read(folder.path(), "hall.toml") + process).unwrap();
    let (code, complaint) = eval("gone.toml", &[]);
    assert_eq!(code, 2, "{complaint}");
    assert!(complaint.contains("seed 1001 failed") && complaint.contains("room.gone"), "{complaint}");
    let json: Value = serde_json::from_str(&read(folder.path(), "eval/eval.json")).unwrap();
    assert_eq!((json["failed"].as_array().unwrap().len(), json["seeds"].as_array().unwrap().len()), (2, 0));
    let again = ["eval", "hall.toml", "--seeds", "1", "--out", "eval"];
    let (code, _, complaint) = foveate(folder.path(), &again);
    assert!(code == 2 && complaint.contains("holds an evaluation already"), "{complaint}");
}

#[test]
fn an_evaluation_goes_on_with_the_seeds_that_it_has() {
    let folder = hall();
    let eval = |seeds: &str, more: &[&str]| {
        let arguments =
            [&["eval", "hall.toml", "--seeds", seeds, "--duration", "2", "--out", "eval", "--quiet"], more].concat();
        let (code, _, complaint) = foveate(folder.path(), &arguments);
        (code, complaint)
    };
    assert_eq!(eval("2", &[]), (0, String::new()));
    // What is there is taken, not run again: a figure that no run has shows it.
    let summary = folder.path().join("eval/seed-1001/summary.json");
    let text = fs::read_to_string(&summary).unwrap();
    fs::write(&summary, text.replacen('{', "{ \"taken\": 7.5,", 1)).unwrap();
    assert_eq!(eval("3", &["--resume"]), (0, String::new()));
    let json: Value = serde_json::from_str(&read(folder.path(), "eval/eval.json")).unwrap();
    assert_eq!(json["seeds"].as_array().unwrap().len(), 3, "{json}");
    assert_eq!(json["figures"]["taken"]["median"], 7.5, "{json}");
    // Of another rig nothing is taken, nor of another duration, nor where nothing was begun.
    let (code, complaint) = eval("3", &["--resume", "--duration", "1"]);
    assert!(code == 2, "given twice: {complaint}");
    let rig = read(folder.path(), "hall.toml");
    fs::write(folder.path().join("hall.toml"), rig.clone() + "\n# another\n").unwrap();
    let (code, complaint) = eval("3", &["--resume"]);
    assert!(code == 2 && complaint.contains("begun with another text of the rig"), "{complaint}");
    fs::write(folder.path().join("hall.toml"), rig).unwrap();
    let longer = ["eval", "hall.toml", "--seeds", "3", "--duration", "3", "--out", "eval", "--quiet", "--resume"];
    let (code, _, complaint) = foveate(folder.path(), &longer);
    assert!(code == 2 && complaint.contains("`duration_s` 2.0, found 3.0"), "{complaint}");
    let elsewhere = ["eval", "hall.toml", "--out", "nowhere", "--resume"];
    let (code, _, complaint) = foveate(folder.path(), &elsewhere);
    assert!(code == 2 && complaint.contains("expected an evaluation that was begun there"), "{complaint}");
}

#[test]
fn what_all_runs_noted_is_told_once() {
    let folder = hall();
    let hall = read(folder.path(), "hall.toml");
    let with_body = hall.replacen("type = \"sim.lab\"", "type = \"sim.lab\"\nbody = { file = \"no_such.bvh\" }", 1);
    assert_ne!(hall, with_body);
    fs::write(folder.path().join("body.toml"), with_body).unwrap();
    let arguments = ["eval", "body.toml", "--seeds", "2", "--duration", "1", "--out", "noted"];
    let (code, said, complaint) = foveate(folder.path(), &arguments);
    assert_eq!(code, 0, "{said}{complaint}");
    assert_eq!(complaint.matches("note: the people's bodies have the built-in walk").count(), 1, "{complaint}");
}

/// A rig that waves a light in the hall.
const WAVE: &str = r#"
[rig]
name = "wave"
calibration = "hall.calibration.toml"
duration_s = 30

[scale.room]
volume_m = { min = [-4.5, -3.0, -0.1], max = [4.5, 3.0, 2.2] }

[scale.room.node.lab]
type = "sim.lab"
people = 0
waved_light = true
truth = { plan = "lab.plan.toml" }

[scale.room.node.lights]
type = "sim.observer"
each = "wide-*"
in = { world = "lab.world" }
noise_px = 0.1

[scale.room.node.targets]
type = "led.integrator"
in = { features = "lights.features" }
"#;

#[test]
fn each_seed_can_be_a_laboratory_of_its_own_that_is_calibrated_first() {
    let folder = hall();
    let path = folder.path();
    fs::copy(path.join("hall.calibration.toml"), path.join("lab.plan.toml")).unwrap();
    let plain = read(path, "hall.toml");
    let rig = plain.replace("people = 4\n", "people = 4\ntruth = { plan = \"lab.plan.toml\" }\n");
    assert_ne!(rig, plain);
    fs::write(path.join("hall.toml"), &rig).unwrap();
    fs::write(path.join("plain.toml"), &plain).unwrap();
    fs::write(path.join("wave.toml"), WAVE).unwrap();
    let eval = |rig: &str, out: &str, commands: &[&str]| {
        let mut arguments = vec!["eval", rig, "--seeds", "2", "--first-seed", "31", "--duration", "8", "--out", out];
        commands.iter().for_each(|it| arguments.extend(["--calibrate", it]));
        foveate(path, &arguments)
    };
    let figure = |out: &str, name: &str| -> Vec<f64> {
        let json: Value = serde_json::from_str(&read(path, &format!("{out}/eval.json"))).unwrap();
        let values = json["figures"][name]["values"].as_array();
        values.into_iter().flatten().map(|it| it.as_f64().unwrap()).collect()
    };
    let wave = "calibrate wave.toml --from-nothing --optics all --floor-stops --distance '@1:@2=1m' --write";
    let (code, _, complaint) = eval("hall.toml", "calibrated", &[wave]);
    assert_eq!(code, 0, "{complaint}");
    // The same seeds with what is known beforehand for a calibration, in one laboratory that is not as planned.
    assert_eq!(eval("hall.toml", "planned", &[]).0, 0);
    let [calibrated, planned] = ["calibrated", "planned"].map(|it| figure(it, "completeness"));
    println!("completeness {calibrated:?}, by the plan {planned:?}; {:?} mm", figure("calibrated", "error_mm.rms"));
    assert!(calibrated.len() == 2 && calibrated.iter().all(|it| *it > 0.85));
    assert!(planned.iter().all(|it| *it < 0.7));
    assert!(figure("calibrated", "calibrated_s").iter().all(|it| *it > 0.1));
    // What was found is kept; what was tried leaves nothing behind but results.
    assert_eq!(eval("hall.toml", "again", &[wave]).0, 0);
    assert_eq!(read(path, "calibrated/eval.json"), read(path, "again/eval.json"));
    assert!(!path.join("calibrated/world-31").exists());
    assert_eq!(read(path, "hall.toml"), rig);

    let refused = |rig: &str, out: &str, command: &str, expected: &str| {
        let (code, _, complaint) = eval(rig, out, &[command]);
        assert!(code == 2 && complaint.contains(expected), "{complaint}");
    };
    refused("hall.toml", "a", "rm -r .", "expected a command `calibrate RIG …` or `run RIG …`");
    refused("hall.toml", "b", "run 'wave.toml", "opens a quote and never closes it");
    refused("hall.toml", "c", "calibrate absent.toml", "`calibrate absent.toml` failed (exit code 2)");
    refused("plain.toml", "d", wave, "expects to draw another laboratory");
}
