//! The whole of it on the simulated wall, with ideal detectors: mapped by dots, then tracked, against the truth.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use foveate::prelude::Registry;
use foveate_embed::engine::{self, Options};
use foveate_embed::rig::{self, Overrides};
use foveate_testkit::data::workspace_root;

/// A rig around the node `what`, before a wall with `settings`.
fn rig_text(settings: &str, duration_s: f64, what: &str) -> String {
    format!(
        r#"
        [rig]
        name = "wall"
        calibration = "laser_wall.calibration.toml"
        duration_s = {duration_s}
        [scale.wall.node.wall]
        type = "sim.wall"
        truth = {{ plan = "laser_wall.calibration.toml", position_mm = 10, direction_deg = 0.4, seed = 5 }}
        {settings}
        [scale.wall.node.spots]
        type = "sim.wall_observer"
        each = "wall-*"
        in = {{ wall = "wall.wall" }}
        latency_ms = 4
        {what}
        "#
    )
}

const DOTS: &str = r#"
    [scale.wall.node.map]
    type = "laser_pointer.calibrator"
    in = { features = "spots.features", shown = "wall.shown" }
    size_m = [4.132, 1.292]
    pixel_mm = 0.8
    tiles = [4, 2]
"#;

const TOUCHED: &str = "[[0.0, 0.0], [4.132, 0.0], [4.132, 1.292], [0.0, 1.292], [2.066, 0.0], [2.066, 1.292]]";

fn waved() -> String {
    format!(
        r#"
        [scale.wall.node.map]
        type = "laser_pointer.wave_calibrator"
        in = {{ features = "spots.features" }}
        size_m = [4.132, 1.292]
        pixel_mm = 0.8
        touch_m = {TOUCHED}
        brightest = 190
        "#
    )
}

const TRACK: &str = r#"
    [scale.wall.node.pointers]
    type = "laser_pointer.tracker"
    in = { features = "spots.features" }
    map = "wall.map.toml"
    [scale.wall.node.score]
    type = "sim.wall_score"
    in = { wall = "wall.wall", targets = "pointers.targets" }
"#;

fn run(folder: &Path, text: &str, seed: u64) -> (BTreeMap<String, f64>, Vec<String>) {
    let mut registry = Registry::default();
    foveate_laser_pointer::register(&mut registry);
    foveate_sim::register(&mut registry);
    let overrides = Overrides { seed: Some(seed), ..Overrides::default() };
    let graph = rig::load(text, &folder.join("wall.toml"), &registry, &overrides)
        .unwrap_or_else(|faults| panic!("{}", faults.render(false)));
    let options = Options { out_dir: Some(folder.to_owned()), ..Options::default() };
    let outcome = engine::deterministic(Arc::new(graph), &options, &mut |_| {}).unwrap();
    assert!(outcome.faults.is_empty(), "{:?}", outcome.faults);
    (outcome.report.figures.into_iter().collect(), outcome.report.remarks)
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let name = "laser_wall.calibration.toml";
    fs::copy(workspace_root().join("graphs").join(name), folder.path().join(name)).unwrap();
    folder
}

#[test]
fn wall_is_mapped_by_its_dots_and_four_people_are_tracked_across_its_cameras() {
    let folder = folder();
    let dots = rig_text("dots = { grid = [6, 4], each_ms = 120 }", 24.0, DOTS);
    let (found, remarks) = run(folder.path(), &dots, 1);
    assert_eq!(
        [found["wall_calibration.cameras"], found["wall_calibration.cameras_failed"]],
        [6.0, 0.0],
        "{remarks:?}"
    );
    assert!(found["wall_calibration.held_out_median_px"] < 0.3, "{found:?}");
    let (found, _) = run(folder.path(), &rig_text("", 12.0, TRACK), 2);
    assert!(found["wall_px.median"] < 0.3 && found["wall_px.p95"] < 1.0, "{found:?}");
    assert!(found["crossings"] >= 1.0 && found["presses"] >= 10.0, "{found:?}");
    for name in ["id_switches", "false_strokes", "missed_presses", "broken_strokes"] {
        assert_eq!(found[name], 0.0, "{name}: {found:?}");
    }
}

#[test]
fn display_that_is_off_is_named() {
    let folder = folder();
    let dots = rig_text("dots = { grid = [6, 4], each_ms = 120 }\ndark_tile = [3, 1]", 24.0, DOTS);
    let (found, remarks) = run(folder.path(), &dots, 1);
    assert_eq!(found["wall_calibration.dark_displays"], 1.0, "{remarks:?}");
    assert!(remarks.iter().any(|it| it.contains("display 4 of row 2")), "{remarks:?}");
}

#[test]
fn wall_is_mapped_from_nothing_by_a_waved_pointer_well_enough_to_track_people() {
    let folder = folder();
    let wave = rig_text(&format!("wave = {{ touch_m = {TOUCHED} }}"), 90.0, &waved());
    let (found, remarks) = run(folder.path(), &wave, 1);
    assert_eq!(
        [found["wave_calibration.cameras"], found["wave_calibration.cameras_failed"]],
        [6.0, 0.0],
        "{remarks:?}"
    );
    assert!(found["wave_calibration.held_out_median_px"] < 1.0, "{found:?}");
    let (tracked, _) = run(folder.path(), &rig_text("", 12.0, TRACK), 2);
    // The touches are a millimetre off, and all that lies between them with them.
    assert!(tracked["wall_px.median"] < 3.0, "{tracked:?} {found:?}");
    assert_eq!(tracked["missed_presses"], 0.0, "{tracked:?}");
}

#[test]
fn people_whose_pointers_blink_are_told_apart_and_one_with_an_unknown_code_is_given_to_none() {
    let folder = folder();
    let dots = rig_text("dots = { grid = [6, 4], each_ms = 120 }", 24.0, DOTS);
    run(folder.path(), &dots, 1);
    let track = TRACK
        .replace("map = \"wall.map.toml\"", "map = \"wall.map.toml\"\nlost_ms = 75\nusers = USERS")
        .replace("targets = \"pointers.targets\"", "targets = \"pointers.targets\", users = \"pointers.users\"");
    let codes = [(1, 60), (2, 71), (3, 84), (4, 99)];
    let users: Vec<String> = codes.iter().map(|it| format!("{{ user = {}, period_ms = {} }}", it.0, it.1)).collect();
    let track = track.replace("USERS", &format!("[{}]", users.join(", ")));
    let (found, _) = run(folder.path(), &rig_text("blink_ms = [60, 71, 84, 99]", 15.0, &track), 2);
    // One click of 34 ends as another user's pointer passes.
    assert!(found["user_wrong"] < 0.05 && found["user_right_long"] > 0.95, "{found:?}");
    assert!(found["user_wrong_samples"] < 0.01, "{found:?}");
    assert!(found["user_ms.median"] < 700.0 && found["pointers.codes_unknown"] == 0.0, "{found:?}");
    let (found, remarks) = run(folder.path(), &rig_text("blink_ms = [60, 71, 84, 130]", 15.0, &track), 2);
    assert!(found["user_wrong"] < 0.05 && found["pointers.codes_unknown"] >= 3.0, "{found:?}");
    assert!(remarks.iter().any(|it| it.contains("about every 130 ms")), "{remarks:?}");
}
