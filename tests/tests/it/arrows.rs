//! Who may know whom: the arrows between the rooms, compared with `cargo metadata`, so that a new one is a visible line.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

use serde_json::Value;

/// Room → the rooms that it knows. Development dependencies do not count.
const ARROWS: &[(&str, &[&str])] = &[
    ("laws", &[]),
    ("estimation", &[]),
    // Bundle adjustment and searches by random samples are robust least squares of cameras.
    ("geometry", &["estimation"]),
    ("imaging", &[]),
    ("time", &[]),
    ("diagnostics", &[]),
    ("plot", &[]),
    // Patterns of camera names say what was probably meant; foreign lenses are fitted; names stand in the XML of other programs, escaped as in figures.
    ("scene", &["diagnostics", "estimation", "geometry", "plot"]),
    // Results as a page: it reads files and no graph, so that it can report on what an older program wrote.
    ("report", &["diagnostics", "plot"]),
    // A room beside the nodes: calibrating is no node's work, and the program that does it knows both.
    ("calibration", &["diagnostics", "estimation", "geometry", "plot", "scene"]),
    ("messages", &["time"]),
    // Skeletons are part of the scene; two motions are aligned and assigned. Every table of text is parted into its fields by `diagnostics::fields`.
    ("motion", &["diagnostics", "estimation", "geometry", "messages", "scene"]),
    ("node", &["estimation", "geometry", "messages", "scene"]),
    // Pages of nodes: what a node sees of the server stands in `node`.
    ("web", &["node"]),
    // What crosses between a program and a library is what nodes are made of.
    ("boundary", &["node"]),
    // It shows runs and recordings of them, and knows messages by their contract; cameras come from the calibration; corrections are a table.
    ("console", &["diagnostics", "engine", "messages", "node", "rig", "scene", "session"]),
    // A recording of a run is a rig and what an engine did with it.
    ("session", &["engine", "geometry", "messages", "node", "rig", "scene"]),
    ("plugin", &["boundary", "messages", "node"]),
    ("rig", &["diagnostics", "estimation", "messages", "node", "plot", "scene"]),
    ("engine", &["estimation", "messages", "node", "rig"]),
    // A simulated projector shows the patterns that a real one would.
    ("sim", &["diagnostics", "estimation", "geometry", "imaging", "messages", "node", "plot", "scene"]),
    ("testkit", &["estimation", "geometry", "laws", "messages", "node", "scene"]),
    // Authors of nodes compile against no program: an edit in how rigs are read or run builds no plugin again.
    (
        "foveate",
        &[
            "boundary",
            "diagnostics",
            "estimation",
            "geometry",
            "imaging",
            "messages",
            "motion",
            "node",
            "plot",
            "scene",
            "time",
        ],
    ),
    ("embed", &["engine", "node", "plugin", "rig"]),
    // Three plugins calibrate what they run with: heads, projectors, walls.
    ("capture", &["foveate"]),
    ("led", &["foveate"]),
    ("blob", &["foveate"]),
    ("board", &["foveate"]),
    ("display", &["foveate"]),
    ("export", &["foveate"]),
    ("painted-mark", &["foveate"]),
    ("pan-tilt", &["calibration", "foveate"]),
    ("select", &["foveate"]),
    ("structured-light", &["calibration", "foveate"]),
    ("surface", &["foveate"]),
    ("laser-pointer", &["calibration", "foveate"]),
    ("voxel-body", &["foveate"]),
    (
        "cli",
        &[
            "blob",
            "board",
            "calibration",
            "capture",
            "console",
            "diagnostics",
            "display",
            "engine",
            "estimation",
            "export",
            "geometry",
            "laser-pointer",
            "led",
            "messages",
            "motion",
            "node",
            "painted-mark",
            "pan-tilt",
            "plot",
            "plugin",
            "report",
            "rig",
            "scene",
            "select",
            "session",
            "sim",
            "structured-light",
            "surface",
            "voxel-body",
            "web",
        ],
    ),
    ("tests", &["testkit"]),
    ("examples", &["cli", "embed", "foveate"]),
];

fn room(package: &str) -> Option<&str> {
    if package == "foveate" { Some(package) } else { package.strip_prefix("foveate-") }
}

#[test]
fn rooms_know_only_whom_they_may() {
    let manifest = concat!(env!("CARGO_MANIFEST_DIR"), "/../Cargo.toml");
    let arguments = ["metadata", "--no-deps", "--offline", "--format-version", "1", "--manifest-path", manifest];
    let output = Command::new(env!("CARGO")).args(arguments).output().unwrap();
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let mut found = BTreeMap::new();
    for package in metadata["packages"].as_array().unwrap() {
        let dependencies = package["dependencies"].as_array().unwrap().iter();
        let known: BTreeSet<&str> =
            dependencies.filter(|it| it["kind"].is_null()).filter_map(|it| room(it["name"].as_str()?)).collect();
        found.insert(room(package["name"].as_str().unwrap()).unwrap(), known);
    }
    let expected: BTreeMap<&str, BTreeSet<&str>> =
        ARROWS.iter().map(|&(room, known)| (room, known.iter().copied().collect())).collect();
    assert_eq!(found, expected);
}
