//! `examples/python/foveate_session.py` reads what the program writes.

use std::fs;
use std::process::Command;

use serde_json::Value;

use crate::the_program::{foveate, new_room, program, root};

#[test]
fn python_reads_a_session_as_it_was_recorded_whole_and_cut() {
    let skipped = "skipped: sessions in Python need FOVEATE_PEER_PYTHON, a python with mcap, msgpack and numpy";
    let Some(python) = std::env::var_os("FOVEATE_PEER_PYTHON") else { return println!("{skipped}") };
    let imports = Command::new(&python).args(["-c", "import mcap, msgpack, numpy"]).output().unwrap();
    if !imports.status.success() {
        return println!("{skipped}");
    }
    let folder = tempfile::tempdir().unwrap();
    // Every sample of the targets stands in the table, not one each sixtieth of a second.
    let rig = new_room(folder.path());
    assert!(rig.contains("rate_hz = 60\n"));
    fs::write(folder.path().join("room.toml"), rig.replace("rate_hz = 60\n", "")).unwrap();
    let run = ["run", "room.toml", "--duration", "1.3", "--quiet", "--record", "s.mcap", "--out", "run"];
    let (code, said, complaint) = foveate(folder.path(), &run);
    assert_eq!(code, 0, "{said}{complaint}");
    let script = root().join("tests/clients/session_python.py");
    let mut command = Command::new(python);
    let output = command.arg(script).args(["s.mcap", "run", "cut.mcap"]).current_dir(folder.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let info = Command::new(program()).args(["info", "s.mcap"]).current_dir(folder.path()).output().unwrap();
    let info = String::from_utf8(info.stdout).unwrap();
    let counts: Vec<(&str, u64)> = info
        .lines()
        .filter(|it| it.starts_with('/'))
        .map(|it| it.split_whitespace().collect::<Vec<_>>())
        .map(|it| (it[0], it[1].parse().unwrap()))
        .collect();
    assert!(counts.len() > 50, "{info}");
    for (topic, count) in counts {
        assert_eq!(found["topics"][topic], count, "{topic}");
    }
    assert_eq!(found["shape"], serde_json::json!([240, 640]), "{found}");
    let mean = found["mean"].as_f64().unwrap();
    assert!((10.0..200.0).contains(&mean), "{mean}");
}
