//! From the capture of a light by a wide camera to the command for a head: the loop of `graphs/pan_tilt_follow.toml`, live, with a simulated head on a
//! pseudo terminal in another thread that is driven as a real one is.

use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use foveate_sim::head::serve::Terminal;
use foveate_sim::head::{HeadSettings, LineSettings, SerialHead};

const SECONDS: u32 = 20;

fn main() {
    let graphs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs");
    let folder = tempfile::tempdir().expect("a folder for the rig");
    for file in ["pan_tilt_follow.calibration.toml", "pan_tilt_follow.plan.toml"] {
        std::fs::copy(graphs.join(file), folder.path().join(file)).expect("calibration and plan are copied");
    }
    let rig = std::fs::read_to_string(graphs.join("pan_tilt_follow.toml")).expect("the rig can be read");
    let kept = rig.split("[scale.close.node.aim_paper]").next().unwrap_or_default();
    let kept = kept.replace("duration_s = 35", &format!("duration_s = {SECONDS}"));

    let mut terminal = Terminal::new().expect("a pseudo terminal");
    let port = terminal.path().display().to_string();
    let head =
        "[scale.close.node.head]\ntype = \"pan_tilt.head\"\ncamera = \"ptz-1\"\nin = { commands = \"aim.commands\" }";
    std::fs::write(folder.path().join("loop.toml"), format!("{kept}\n{head}\nport = \"{port}\"\n"))
        .expect("the rig is written");
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    let device = std::thread::spawn(move || {
        let mut head =
            SerialHead::new(&HeadSettings::default(), &LineSettings::default(), 1).expect("the settings are sound");
        terminal.serve(&mut head, &asked).expect("the terminal is served");
    });
    println!("{SECONDS} s live, 18 cameras at 60 Hz, one head at {port}");
    let arguments =
        ["run", "--quiet", "--release", "-p", "foveate-cli", "--", "run", "loop.toml", "--quiet", "--out", "results"];
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("../Cargo.toml");
    let mut command = Command::new(env!("CARGO"));
    command.args(&arguments[..1]).arg("--manifest-path").arg(manifest).args(&arguments[1..]).current_dir(folder.path());
    let status = command.status().expect("cargo runs");
    stop.store(true, Ordering::Relaxed);
    device.join().expect("the head ends");
    assert!(status.success(), "the rig ended with {status}");
    let ledger = std::fs::read_to_string(folder.path().join("results/ledger.csv")).expect("there is a ledger");
    for name in ["-> close.aim[ptz-1].target", "-> close.head[ptz-1].commands"] {
        let line = ledger.lines().find(|it| it.contains(name)).expect("the edge is in the ledger");
        let fields: Vec<&str> = line.split(',').collect();
        println!("{}: {} Hz, age p50 {} ms, p99 {} ms", fields[0], fields[2], fields[3], fields[4]);
    }
}
