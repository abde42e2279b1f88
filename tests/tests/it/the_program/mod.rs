//! The `foveate` program, for tests that use it as a person does.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// The repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap()
}

/// The program, built once by cargo for all tests.
pub fn program() -> PathBuf {
    static BUILT: std::sync::OnceLock<PathBuf> = std::sync::OnceLock::new();
    BUILT
        .get_or_init(|| {
            let arguments =
                ["build", "--quiet", "--offline", "-p", "foveate-cli", "--message-format", "json-render-diagnostics"];
            let output = Command::new(env!("CARGO")).args(arguments).current_dir(root()).output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            let text = String::from_utf8(output.stdout).unwrap();
            let messages = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
            let mut executables = messages.filter_map(|it| Some(PathBuf::from(it["executable"].as_str()?)));
            executables.next().unwrap()
        })
        .clone()
}

/// The rig of the simulated lab, `room.toml`, and its calibration in `folder`, as `foveate new rig` writes them: a lab that is as its calibration says. Gives the rig's text.
pub fn new_room(folder: &Path) -> String {
    let (code, _, complaint) = foveate(folder, &["new", "rig", "room"]);
    assert_eq!(code, 0, "{complaint}");
    std::fs::read_to_string(folder.join("room.toml")).unwrap()
}

/// Runs the program in `folder`; gives exit code, standard output, standard error.
pub fn foveate(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let Output { status, stdout, stderr } =
        Command::new(program()).args(arguments).current_dir(folder).output().unwrap();
    let text = |bytes| String::from_utf8_lossy(bytes).into_owned();
    (status.code().unwrap_or(-1), text(&stdout), text(&stderr))
}
