//! What surrounds a run: its folder and who else wants it, signals, a quiet terminal, sizes that nobody has memory for.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::the_program::{foveate, new_room, program, root};

/// Ends the process also when a test fails.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It has ended by itself where the test went well.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A folder with the room rig and its calibration, the rig's text changed.
fn lab(change: impl Fn(String) -> String) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(root().join("graphs/bumped.toml")).unwrap();
    fs::write(folder.path().join("room.toml"), change(text)).unwrap();
    let calibration = "ideal_lab.calibration.toml";
    fs::copy(root().join("graphs").join(calibration), folder.path().join(calibration)).unwrap();
    folder
}

/// Starts a run that lasts until it is ended, and waits until it has written something.
fn start(folder: &Path, arguments: &[&str]) -> Running {
    let started = Command::new(program())
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let running = Running(started.unwrap());
    let begun = Instant::now();
    while !folder.join("out/graph.svg").exists() || !folder.join("out/truth.csv").exists() {
        assert!(begun.elapsed() < Duration::from_secs(60), "it has not begun");
        std::thread::sleep(Duration::from_millis(20));
    }
    running
}

const LONG: [&str; 6] = ["run", "room.toml", "--duration", "1e6", "--out", "out"];

fn signal(running: &Running, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &running.0.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

fn summary(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("out/summary.json")).unwrap()).unwrap()
}

#[test]
fn a_second_run_into_a_folder_is_refused_and_names_the_first_which_may_be_killed() {
    let folder = lab(|it| it);
    let mut first = start(folder.path(), &LONG);
    for arguments in [LONG.to_vec(), vec!["calibrate", "room.toml", "--from-nothing", "--out", "out"]] {
        let (code, said, complaint) = foveate(folder.path(), &arguments);
        assert_eq!((code, said.as_str()), (2, ""), "{complaint}");
        let expected = format!("rig `bumped`, process {}, since ", first.0.id());
        assert!(complaint.contains(&expected) && complaint.contains("results folder `out`"), "{complaint}");
    }
    first.0.kill().unwrap();
    first.0.wait().unwrap();
    assert!(folder.path().join("out/.foveate.lock").exists(), "nobody could take it away");
    let again = ["run", "room.toml", "--duration", "0.5", "--out", "out"];
    let (code, _, complaint) = foveate(folder.path(), &again);
    assert_eq!(code, 0, "{complaint}");
    assert!(!folder.path().join("out/.foveate.lock").exists());
}

/// Under `nohup` a program is to go on when its terminal hangs up: it is started so, and stays so.
fn ignores_hangups(running: &Running) -> bool {
    let status = fs::read_to_string(format!("/proc/{}/status", running.0.id())).unwrap_or_default();
    let ignored = status.lines().find_map(|it| it.strip_prefix("SigIgn:"));
    // SIGHUP is the first.
    ignored.and_then(|it| u64::from_str_radix(it.trim(), 16).ok()).is_some_and(|it| it & 1 == 1)
}

#[test]
fn signals_end_a_run_with_all_results_and_their_own_exit_code() {
    for (name, code, live) in [("INT", 130, false), ("TERM", 143, false), ("HUP", 129, false), ("TERM", 143, true)] {
        let folder = lab(|it| it);
        let mut arguments = LONG.to_vec();
        arguments.extend(live.then_some("--live"));
        let mut running = start(folder.path(), &arguments);
        if name == "HUP" && ignores_hangups(&running) {
            eprintln!("skipped: whoever runs this test ignores SIGHUP (nohup), and so do its children");
            continue;
        }
        signal(&running, name);
        assert_eq!(running.0.wait().unwrap().code(), Some(code), "{name}");
        let summary = summary(folder.path());
        assert_eq!(summary["interrupted"], Value::Bool(true));
        assert_eq!(summary["interrupted_by"], Value::String(format!("SIG{name}")));
        assert!(summary["session_s"].as_f64().is_some(), "all figures are there");
        for file in ["ledger.csv", "events.csv", "timing.json", "truth.csv"] {
            assert!(folder.path().join("out").join(file).exists(), "{name}: {file}");
        }
        let mut said = String::new();
        running.0.stdout.take().unwrap().read_to_string(&mut said).unwrap();
        assert!(said.starts_with("stopped by you after"), "{said}");
    }
    let folder = lab(|it| it);
    assert_eq!(foveate(folder.path(), &["run", "room.toml", "--duration", "0.5", "--out", "out"]).0, 0);
    assert_eq!(summary(folder.path())["interrupted"], Value::Bool(false));
}

#[test]
fn a_closed_standard_error_is_no_reason_to_fail() {
    // A setting that is warned of, and nobody to hear it.
    let folder = lab(|it| {
        format!(
            "{it}\n[scale.room.node.idle]\ntype = \"sim.observer\"\ncamera = \"wide-1\"\nin = {{ world = \"lab.world\" }}\n"
        )
    });
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let status = Command::new(program())
        .args(["run", "room.toml", "--duration", "0.5", "--out", "out"])
        .current_dir(folder.path())
        .stdout(Stdio::null())
        .stderr(writer)
        .status()
        .unwrap();
    assert_eq!(status.code(), Some(0));
}

#[test]
fn what_fails_leaves_no_empty_folder_and_what_is_quiet_says_nothing() {
    let folder = lab(|it| it);
    // Nothing to calibrate with: known only after the folder was made.
    let arguments = ["calibrate", "room.toml", "--from-nothing", "--duration", "0.05", "--quiet", "--from", "nobody"];
    let (code, _, complaint) = foveate(folder.path(), &arguments);
    assert_eq!(code, 2, "{complaint}");
    assert!(!folder.path().join("results").exists(), "{complaint}");
    let mut deeper = arguments.to_vec();
    deeper.extend(["--out", "a/b/c"]);
    assert_eq!(foveate(folder.path(), &deeper).0, 2);
    assert!(!folder.path().join("a").exists());

    let quiet = foveate(folder.path(), &["run", "room.toml", "--duration", "1", "-q", "--out", "out"]);
    assert_eq!(quiet, (0, String::new(), String::new()));
    assert!(folder.path().join("out/summary.json").exists());
}

#[test]
fn accuracy_comes_first_and_by_scale() {
    let folder = lab(|it| it);
    let (code, said, complaint) = foveate(folder.path(), &["run", "room.toml", "--duration", "6", "--out", "out"]);
    assert_eq!(code, 0, "{complaint}");
    let place = |word: &str| said.find(word).unwrap_or_else(|| panic!("no {word} in:\n{said}"));
    assert!(said.starts_with("done: ") && place("\n  targets off") < place("\n  part of"), "{said}");
    let line = said.lines().find(|it| it.starts_with("  targets off")).unwrap();
    assert!(line.contains("median 0.") && line.contains("   p95 ") && line.contains("   rms "), "{line}");
}

#[test]
fn progress_counts_each_camera_once() {
    // Nine cameras, whose features go to two nodes each.
    let folder = lab(|it| it.replace("each = \"wide-*\"", "each = \"wide-?\""));
    let mut running = start(folder.path(), &LONG);
    let lines = BufReader::new(running.0.stderr.take().unwrap()).lines();
    let line = lines.map(Result::unwrap).find(|it| it.contains("real time")).unwrap();
    assert!(line.contains("   9 cameras, 5"), "{line}");
}

#[test]
fn a_short_run_says_that_scoring_had_not_begun() {
    let folder = lab(|it| it.replace("type = \"sim.score\"", "type = \"sim.score\"\nstart_s = 30"));
    let (code, said, complaint) = foveate(folder.path(), &["run", "room.toml", "--duration", "2", "--out", "out"]);
    assert_eq!(code, 0, "{complaint}");
    assert!(said.contains("scoring had not begun: it begins at `start_s` = 30 s"), "{said}");
}

#[test]
fn absurd_sizes_are_refused_before_memory_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    new_room(folder.path());
    let path = folder.path().join("room.calibration.toml");
    let calibration = fs::read_to_string(&path).unwrap();
    let size = calibration.lines().find(|it| it.starts_with("image_size_px")).unwrap().to_owned();
    let cases = [
        ("[65535, 65535]", "found pictures of 65535 x 65535 px", "at most 268435456 px"),
        ("[16384, 16384]", "found 4831838208 px", "expected at most 2147483648"),
    ];
    for (absurd, found, expected) in cases {
        fs::write(&path, calibration.replace(&size, &format!("image_size_px = {absurd}"))).unwrap();
        for command in ["check", "run"] {
            let begun = Instant::now();
            let (code, _, complaint) = foveate(folder.path(), &[command, "room.toml"]);
            assert_eq!(code, 2, "{absurd}: {complaint}");
            assert!(complaint.contains(found) && complaint.contains(expected), "{absurd}: {complaint}");
            assert!(begun.elapsed() < Duration::from_secs(60));
        }
    }
    assert!(!folder.path().join("results").exists());
}

#[test]
fn a_rig_with_videos_is_checked_for_ffmpeg() {
    let folder = lab(|it| it);
    fs::write(folder.path().join("film.mp4"), "anything").unwrap();
    let rig = r#"
        [rig]
        name = "film"
        calibration = "ideal_lab.calibration.toml"

        [scale.room.node.video]
        type = "capture.video"
        camera = "wide-1"
        path = "film.mp4"

        [scale.room.node.leds]
        type = "led.detector"
        camera = "wide-1"
        in = { image = "video.image" }
        offset = 20

        [scale.room.node.file]
        type = "export.features"
        in = { features = "leds.features" }
        "#;
    fs::write(folder.path().join("film.toml"), rig).unwrap();
    let empty = tempfile::tempdir().unwrap();
    let output = Command::new(program())
        .args(["check", "film.toml"])
        .current_dir(folder.path())
        .env("PATH", empty.path())
        .output()
        .unwrap();
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{complaint}");
    assert!(complaint.contains("`video` cannot be made") && complaint.contains("apt install ffmpeg"), "{complaint}");
}
