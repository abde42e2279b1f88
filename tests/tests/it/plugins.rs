//! Plugins as their authors and users meet them: made, built, opened, refused, and bad ones.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use serde_json::Value;

use crate::the_program::{foveate, new_room, program, root};

/// Runs the program in `folder`, which has to be content.
#[track_caller]
fn content(folder: &Path, arguments: &[&str]) -> String {
    let (code, said, complaint) = foveate(folder, arguments);
    assert_eq!(code, 0, "foveate {arguments:?}:\n{said}{complaint}");
    said + &complaint
}

/// Where plugins of all tests of this file are made and built, one after the other: they share cargo's folder.
fn workshop() -> &'static Path {
    static MADE: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = MADE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        for (name, role) in [("star_finder", "detector"), ("slow_only", "filter"), ("high_up", "selector")] {
            content(folder.path(), &["new", "plugin", name, "--role", role]);
            let built = content(folder.path(), &["plugin", "build", name]);
            assert!(built.contains(&format!("lib{name}.so: {name}.{role}")), "{built}");
        }
        bad_plugin(folder.path());
        folder
    });
    folder.path()
}

/// The crate `bad` out of a new one, with the nodes of `tests/plugins/bad.rs`.
fn bad_plugin(folder: &Path) {
    content(folder, &["new", "plugin", "bad", "--role", "filter"]);
    fs::copy(root().join("tests/plugins/bad.rs"), folder.join("bad/src/bad.rs")).unwrap();
    fs::remove_file(folder.join("bad/src/filter.rs")).unwrap();
    let lib = "//! Bad nodes.\nmod bad;\npub use bad::Bad;\nfoveate::plugin! { \"bad.node\" => Bad }\n";
    fs::write(folder.join("bad/src/lib.rs"), lib).unwrap();
    content(folder, &["plugin", "build", "bad"]);
}

fn read(path: PathBuf) -> String {
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn a_new_plugin_is_built_and_runs_and_says_where_it_comes_from() {
    let folder = workshop();
    for name in ["star_finder", "slow_only", "high_up"] {
        let rig = format!("{name}/{name}.toml");
        let checked = content(folder, &["check", &rig]);
        assert!(checked.contains("no fault") && !checked.contains("warning"), "{checked}");
    }
    content(folder, &["run", "star_finder/star_finder.toml", "--duration", "1.5", "--quiet", "--out", "stars"]);
    let summary: Value = serde_json::from_str(&read(folder.join("stars/summary.json"))).unwrap();
    let figure = |name: &str| summary["figures"][name]["value"].as_f64().or(summary[name].as_f64()).unwrap_or(f64::NAN);
    assert!(figure("star_finder.found.wide-1") > 100.0, "{summary:#}");
    assert!(figure("error_mm.median") < 10.0, "{summary:#}");

    let library = folder.join("star_finder/libstar_finder.so").canonicalize().unwrap();
    let library = library.display().to_string();
    let shown = content(folder, &["nodes", "star_finder.detector", "--rig", "star_finder/star_finder.toml"]);
    assert!(shown.contains(&format!("From the library {library}")) && shown.contains("threshold"), "{shown}");
    let all = content(folder, &["nodes", "--rig", "star_finder/star_finder.toml"]);
    assert!(all.contains(&format!("star_finder.detector from the library {library}")), "{all}");
    let schema = content(folder, &["schema", "--rig", "star_finder/star_finder.toml"]);
    assert!(schema.contains("star_finder.detector") && schema.contains(&library));
    assert!(!content(folder, &["schema"]).contains("star_finder"));
    // The resolved rig names the library, with all settings, and runs again to the same bytes.
    let resolved = read(folder.join("stars/rig.resolved.toml"));
    assert!(
        resolved.contains(&format!("libraries = [\"{library}\"]")) && resolved.contains("threshold = 120"),
        "{resolved}"
    );
    content(folder, &["run", "stars/rig.resolved.toml", "--quiet", "--out", "again"]);
    assert_eq!(read(folder.join("stars/targets.csv")), read(folder.join("again/targets.csv")));
}

#[test]
fn libraries_on_the_search_path_are_found_and_bad_ones_are_named() {
    let folder = workshop();
    let path = tempfile::tempdir().unwrap();
    fs::copy(folder.join("slow_only/libslow_only.so"), path.path().join("libslow_only.so")).unwrap();
    fs::write(path.path().join("libempty.so"), "no library").unwrap();
    let output =
        Command::new(program()).args(["nodes", "slow_only.filter"]).env("FOVEATE_PLUGINS", path.path()).output();
    let output = output.unwrap();
    let (said, complaint) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success() && said.contains("libslow_only.so"), "{said}{complaint}");
    assert!(complaint.contains("libempty.so") && complaint.contains("no library that can be opened"), "{complaint}");
}

/// The lab's rig with the libraries and the node of a bad plugin; gives what `check` or `run` say.
fn with_node(library: &Path, node: &str, command: &[&str]) -> (i32, String) {
    let folder = tempfile::tempdir().unwrap();
    let lab = new_room(folder.path())
        .replace("in = { targets = \"targets.targets\" }\nrate_hz", "in = { targets = \"odd.targets\" }\nrate_hz");
    let head = format!("[plugins]\nlibraries = [\"{}\"]\n\n[scale.room]\n", library.display());
    let lab = lab.replacen("[scale.room]\n", &head, 1);
    let node =
        format!("\n[scale.room.node.odd]\ntype = \"bad.node\"\nin = {{ targets = \"targets.targets\" }}\n{node}\n");
    fs::write(folder.path().join("room.toml"), lab + &node).unwrap();
    let (code, said, complaint) = foveate(folder.path(), command);
    let events = fs::read_to_string(folder.path().join("out/events.csv")).unwrap_or_default();
    let rows = fs::read_to_string(folder.path().join("out/truth.csv")).unwrap_or_default().lines().count();
    (code, format!("{said}{complaint}\n{events}\ntruth: {rows} rows"))
}

const RUN: [&str; 7] = ["run", "room.toml", "--duration", "0.5", "--quiet", "--out", "out"];
const CHECK: [&str; 2] = ["check", "room.toml"];

#[test]
fn a_bad_node_of_a_library_is_named_with_its_panic_and_the_rest_goes_on() {
    let library = workshop().join("bad/libbad.so");
    let check = |node: &str, words: &[&str]| {
        let (code, said) = with_node(&library, node, &CHECK);
        assert_eq!(code, 2, "{said}");
        words.iter().for_each(|it| assert!(said.contains(it), "`{it}` is not in:\n{said}"));
    };
    check(
        "even = 3",
        &["`odd` cannot work with this `even`", "found 3, expected an even number", "room.toml:", "even = 3"],
    );
    check("evne = 2", &["has no setting `evne`", "did you mean `even`?"]);
    check("what = \"nuthing\"", &["nothing"]);
    check("what = \"check\"", &["panicked at", "bad.rs", "bad at its making"]);
    check("what = \"plan\"", &["panicked at", "bad at its plan"]);
    check("what = \"drop\"", &["panicked at", "bad at its drop"]);
    for (what, words) in [("process", "bad at its work"), ("finish", "bad at its end")] {
        for on_error in ["stop", "skip", "restart"] {
            let (code, said) = with_node(&library, &format!("what = \"{what}\"\non_error = \"{on_error}\""), &RUN);
            assert_eq!(code, 70, "{said}");
            assert!(said.contains("room.odd") && said.contains(words) && said.contains("bad.rs:"), "{said}");
            assert!(said.contains("libbad.so"), "the library is named: {said}");
            assert!(!said.contains("truth: 0 rows"), "what else there is was saved: {said}");
        }
    }
    let (code, said) = with_node(&library, "what = \"new\"", &RUN);
    assert!(code == 2 && said.contains("bad at its making") && said.contains("libbad.so"), "{code} {said}");
    let (code, said) = with_node(&library, "what = \"crash\"", &RUN);
    assert!(code == -1 && said.contains("room.odd (`bad.node` of ") && said.contains("libbad.so)"), "{code} {said}");
    let (code, said) = with_node(&library, "", &RUN);
    assert_eq!(code, 0, "one that does no harm: {said}");
}

#[test]
fn a_node_that_gives_out_without_an_end_is_stopped() {
    let library = workshop().join("bad/libbad.so");
    let (code, said) = with_node(&library, "what = \"flood\"", &RUN);
    assert!(code == 70 && said.contains("messages in one activation") && said.contains("libbad.so"), "{said}");
}

/// A library out of `tests/plugins/fake.rs`, or of another text.
fn fake(folder: &Path, name: &str, flags: &[&str], text: Option<&str>) -> PathBuf {
    let source = match text {
        Some(text) => {
            let path = folder.join(format!("{name}.rs"));
            fs::write(&path, text).unwrap();
            path
        }
        None => root().join("tests/plugins/fake.rs"),
    };
    let library = folder.join(format!("lib{name}.so"));
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let mut command = Command::new(rustc);
    command.args(["--edition", "2024", "--crate-type", "cdylib", "-o"]).arg(&library).arg(&source).args(flags);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    library
}

#[test]
fn a_library_that_does_not_fit_is_refused_with_all_that_differs() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |library: PathBuf, words: &[&str]| {
        let name = library.file_name().unwrap().to_string_lossy().into_owned();
        let (code, said) = with_node(&library, "", &CHECK);
        assert_eq!(code, 2, "{said}");
        let always = [name.as_str(), "cannot be used", "room.toml:"];
        words.iter().chain(&always).for_each(|it| assert!(said.contains(it), "`{it}` is not in:\n{said}"));
        assert!(
            !said.contains("unknown node type"),
            "the node of a library that was refused is not looked for: {said}"
        );
    };
    let build = |name: &str, flags: &[&str]| fake(folder.path(), name, flags, None);
    let differs = [
        "fake 3.2.1",
        "foveate: the program has 0.1.0, the library 99.0.0",
        "compiler: the program has 1.",
        "m68k",
        "opt-level 9",
        "avx1024",
        "foveate plugin build",
    ];
    refused(build("other_compiler", &[]), &differs);
    refused(build("other_magic", &["--cfg", "other_magic"]), &["no plugin for foveate"]);
    refused(build("no_layout", &["--cfg", "no_layout"]), &["layout 0"]);
    refused(build("null", &["--cfg", "null"]), &["its descriptor is missing"]);
    let empty = fake(folder.path(), "nothing", &[], Some("//! Nothing."));
    refused(empty, &["found no symbol `foveate_plugin_descriptor`"]);
    let needy = "unsafe extern \"C\" { fn no_such_function_anywhere(); }\n#[unsafe(no_mangle)] pub extern \"C\" fn a() { unsafe { no_such_function_anywhere() } }";
    refused(fake(folder.path(), "needy", &[], Some(needy)), &["can be opened", "undefined"]);
    let text = folder.path().join("libtext.so");
    fs::write(&text, "this is a text").unwrap();
    refused(text, &["no library that can be opened"]);
    refused(folder.path().join("libgone.so"), &["No such file"]);
    refused(folder.path().to_owned(), &["cannot be used"]);
}

#[test]
fn two_libraries_with_one_node_type_are_refused_by_name() {
    let folder = workshop();
    let twin = folder.join("libtwin.so");
    fs::copy(folder.join("bad/libbad.so"), &twin).unwrap();
    let both = PathBuf::from(format!("{}\", \"{}", folder.join("bad/libbad.so").display(), twin.display()));
    let (code, said) = with_node(&both, "", &CHECK);
    assert_eq!(code, 2, "{said}");
    assert!(
        said.contains("the node type `bad.node`, which") && said.contains("libbad.so") && said.contains("libtwin.so"),
        "{said}"
    );
}

#[test]
fn what_is_no_plugin_is_not_built() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |arguments: &[&str], words: &str| {
        let (code, said, complaint) = foveate(folder.path(), arguments);
        assert!(code == 2 && complaint.contains(words), "{said}{complaint}");
    };
    refused(&["plugin", "build", "nowhere"], "the folder `nowhere` cannot be read");
    refused(&["plugin", "build", "."], "expected the folder of a crate");
    fs::write(folder.path().join("Cargo.toml"), "[workspace]\n").unwrap();
    refused(&["plugin", "build", "."], "has no `[package]`");
    fs::write(folder.path().join("Cargo.toml"), "[package\n").unwrap();
    refused(&["plugin", "build", "."], "is not TOML");
    refused(&["new", "plugin", "Star"], "expected small letters");
    let folder = workshop();
    // Another feature of a crate that the program has: the two would not fit.
    content(folder, &["new", "plugin", "greedy", "--role", "filter"]);
    let manifest = read(folder.join("greedy/Cargo.toml")).replace(
        "serde = { version = ",
        "serde_json = { version = \"1\", features = [\"arbitrary_precision\"] }\nserde = { version = ",
    );
    fs::write(folder.join("greedy/Cargo.toml"), manifest).unwrap();
    let (code, _, complaint) = foveate(folder, &["plugin", "build", "greedy"]);
    assert!(
        code == 2 && complaint.contains("serde_json: the program has v1.") && complaint.contains("arbitrary_precision"),
        "{complaint}"
    );
}
