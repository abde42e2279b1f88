//! The cheap promises of the house: opening words, units, no leftovers.

use std::fs;
use std::path::{Path, PathBuf};

use foveate_node::setting_docs::setting_docs;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// All files below the workspace's own folders whose name ends in `extension`.
fn files(extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> =
        ["framework", "plugins", "tests", "examples", "docs", "graphs", "fuzz"].map(|it| root().join(it)).to_vec();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                if path.file_name().is_none_or(|it| it != "target" && it != "corpus" && it != "artifacts") {
                    folders.push(path);
                }
            } else if path.extension().is_some_and(|it| it == extension) {
                found.push(path);
            }
        }
    }
    assert!(!found.is_empty(), "no .{extension} file at all");
    found
}

#[test]
fn every_source_file_opens_with_what_it_is() {
    for path in files("rs") {
        let text = fs::read_to_string(&path).unwrap();
        // An inner attribute may have to stand first.
        let opening = text.lines().find(|line| !line.starts_with("#!"));
        assert!(opening.is_some_and(|line| line.starts_with("//! ")), "{} does not open with `//! `", path.display());
    }
}

#[test]
fn every_setting_says_its_unit() {
    for node_type in foveate_cli::registry().iter() {
        for setting in setting_docs(node_type) {
            let description = setting.description.trim_end().trim_end_matches('.');
            assert!(
                description.ends_with(']') && description.contains('['),
                "{}: the documentation of `{}` does not end in its unit in brackets: {description}",
                node_type.name,
                setting.name
            );
        }
    }
}

#[test]
fn no_leftovers() {
    // Spelt in halves so that this file does not find itself.
    let leftovers =
        [["TO", "DO"], ["FIX", "ME"], ["dbg", "!("], ["todo", "!("], ["unimplemented", "!("], ["#[ig", "nore"]];
    for path in files("rs") {
        let text = fs::read_to_string(&path).unwrap();
        for halves in leftovers {
            assert!(!text.contains(&halves.concat()), "{} holds `{}`", path.display(), halves.concat());
        }
    }
}
