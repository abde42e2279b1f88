//! A program of one's own with all commands of `foveate` for the nodes that are linked into it.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Once;

/// The program as cargo builds it alone, once for all tests: were it made together with a workspace whose tests ask other features of its packages,
/// libraries that `foveate plugin build` makes would be for another program. (The workspace's `Cargo.toml` names such features for all, so that nothing is built twice.)
fn built_alone() {
    static BUILT: Once = Once::new();
    BUILT.call_once(|| {
        let arguments = ["build", "--quiet", "--offline", "-p", "foveate-examples", "--bin", "own_program"];
        let output =
            Command::new(env!("CARGO")).args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    });
}

/// Exit code and what was said.
fn own_program(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    built_alone();
    let output = Command::new(env!("CARGO_BIN_EXE_own_program")).args(arguments).current_dir(folder).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout) + &text(output.stderr))
}

/// The simulated lab with the node of this crate before its table and its score.
fn rig(folder: &Path, setting: &str) {
    let graphs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs");
    let lab = fs::read_to_string(graphs.join("room.toml")).unwrap();
    let lab =
        lab.replace("in = { targets = \"targets.targets\", truth", "in = { targets = \"credible.targets\", truth");
    let node = "\n[scale.room.node.credible]\ntype = \"example.speed_limit\"\nin = { targets = \"targets.targets\" }\n";
    fs::write(folder.join("room.toml"), format!("{lab}{node}{setting}\n")).unwrap();
    for file in ["face_body.calibration.toml", "lab.plan.toml"] {
        fs::copy(graphs.join(file), folder.join(file)).unwrap();
    }
}

#[test]
fn every_command_knows_the_node_that_is_linked_in() {
    let folder = tempfile::tempdir().unwrap();
    let (code, said) = own_program(folder.path(), &["nodes", "example.speed_limit"]);
    assert!(
        code == Some(0) && said.contains("Built in, from foveate-examples") && said.contains("max_speed"),
        "{said}"
    );
    let (_, schema) = own_program(folder.path(), &["schema"]);
    assert!(schema.contains("example.speed_limit") && schema.contains("led.detector"));

    rig(folder.path(), "max_speed = 8");
    let (code, said) = own_program(folder.path(), &["check", "room.toml"]);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) =
        own_program(folder.path(), &["run", "room.toml", "--duration", "0.5", "--quiet", "--out", "out"]);
    assert_eq!(code, Some(0), "{said}");
    let summary = fs::read_to_string(folder.path().join("out/summary.json")).unwrap();
    assert!(summary.contains("speed_limit.dropped"), "{summary}");

    rig(folder.path(), "max_speed = -8");
    let (code, said) = own_program(folder.path(), &["check", "room.toml"]);
    assert!(code == Some(2) && said.contains("`max_speed` is out of range") && said.contains("[m/s]"), "{said}");
}

/// The rig of a new plugin with its detector in another form.
fn spots(folder: &Path, name: &str, node: &str) -> Vec<Vec<f64>> {
    let rig = fs::read_to_string(folder.join("star_finder/star_finder.toml")).unwrap();
    let rig = rig.replace("type = \"star_finder.detector\"", node);
    let rig = if node.contains("process") { rig.replace("threshold = 120\n", "") } else { rig };
    fs::write(folder.join(format!("star_finder/{name}.toml")), rig).unwrap();
    let (code, said) = own_program(
        folder,
        &["run", &format!("star_finder/{name}.toml"), "--duration", "1.5", "--quiet", "--out", name],
    );
    assert_eq!(code, Some(0), "{said}");
    let table = fs::read_to_string(folder.join(name).join("targets.csv")).unwrap();
    let numbers = table.lines().skip(1).map(|line| line.split(',').filter_map(|it| it.parse().ok()).collect());
    let numbers: Vec<Vec<f64>> = numbers.collect();
    assert!(numbers.len() > 50, "{table}");
    numbers
}

#[test]
fn one_node_gives_the_same_linked_in_and_as_a_library_and_in_python() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [&["new", "plugin", "star_finder"][..], &["plugin", "build", "star_finder"]] {
        let (code, said) = own_program(folder.path(), arguments);
        assert_eq!(code, Some(0), "{said}");
    }
    let library = spots(folder.path(), "library", "type = \"star_finder.detector\"");
    let linked = spots(folder.path(), "linked", "type = \"my_plugin.detector\"");
    assert_eq!(linked, library);
    let text = |name: &str| fs::read(folder.path().join(name).join("targets.csv")).unwrap();
    assert_eq!(text("linked"), text("library"), "the same bytes");
    let Ok(python) = std::env::var("FOVEATE_PEER_PYTHON") else {
        return println!("skipped: FOVEATE_PEER_PYTHON names no Python with numpy");
    };
    let scripts = Path::new(env!("CARGO_MANIFEST_DIR")).join("python");
    let process =
        format!("type = \"process.detector\"\ncommand = [{python:?}, {:?}, \"120\"]", scripts.join("spots.py"));
    let process = spots(folder.path(), "process", &process);
    assert_eq!(process.len(), library.len());
    for (a, b) in process.iter().flatten().zip(library.iter().flatten()) {
        assert!((a - b).abs() <= 1e-9 * (1.0 + b.abs()), "{a} {b}");
    }
}
