//! `foveate new plugin`: a crate of one node to start from, outside our workspace, with tests and a rig that uses it.

use std::fs;
use std::path::Path;

use toml::{Table, Value};

use crate::build::Program;

/// What the node of a new plugin is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NewRole {
    /// Pictures in, points in them out.
    Detector,
    /// Targets in, better ones out.
    Filter,
    /// Targets in, where to look out.
    Selector,
}

/// What differs between the roles.
struct Template {
    role: &'static str,
    code: &'static str,
    summary: &'static str,
    /// The nodes of the rig after the cameras.
    nodes: &'static str,
}

const LIB: &str = include_str!("../templates/lib.rs");
const MANIFEST: &str = include_str!("../templates/Cargo.toml.txt");
const RIG: &str = include_str!("../templates/rig.toml");
const CALIBRATION: &str = include_str!("../../../graphs/ideal_lab.calibration.toml");
const IGNORED: &str = "/target\n/results\n*.so\n*.dylib\n";

/// From pictures to targets by what is built in.
const BUILT_IN: &str = r#"[scale.room.node.leds]
type = "led.detector"
each = "wide-*"
in = { image = "video.image", predicted = "targets.predicted" }

[scale.room.node.targets]
type = "led.integrator"
in = { features = "leds.features" }

"#;

const SCORE: &str = r#"
[scale.room.node.score]
type = "sim.score"
in = { targets = "OUTPUT", truth = "lab.truth" }

[scale.room.node.table]
type = "export.targets"
in = { targets = "OUTPUT" }
"#;

impl NewRole {
    fn template(self) -> Template {
        match self {
            NewRole::Detector => Template {
                role: "detector",
                code: include_str!("../templates/detector.rs"),
                summary: "finds bright spots in pictures",
                nodes: r#"[scale.room.node.spots]
type = "my_plugin.detector"
each = "wide-*"
in = { image = "video.image" }
threshold = 120

[scale.room.node.targets]
type = "led.integrator"
in = { features = "spots.features" }
"#,
            },
            NewRole::Filter => Template {
                role: "filter",
                code: include_str!("../../../examples/src/speed_limit.rs"),
                summary: "drops targets that are too fast",
                nodes: r#"[scale.room.node.credible]
type = "my_plugin.filter"
in = { targets = "targets.targets" }
max_speed = 8
"#,
            },
            NewRole::Selector => Template {
                role: "selector",
                code: include_str!("../templates/selector.rs"),
                summary: "looks at the highest target",
                nodes: r#"[scale.room.node.highest]
type = "my_plugin.selector"
in = { targets = "targets.targets" }
radius = 0.25
"#,
            },
        }
    }

    /// The rig's nodes after the cameras.
    fn nodes(self) -> String {
        let own = self.template().nodes;
        match self {
            NewRole::Detector => format!("{own}{}", SCORE.replace("OUTPUT", "targets.targets")),
            NewRole::Filter => format!("{BUILT_IN}{own}{}", SCORE.replace("OUTPUT", "credible.targets")),
            NewRole::Selector => {
                let table = SCORE.split_once("\n\n").map_or("", |it| it.1);
                format!("{BUILT_IN}{own}\n{}", table.replace("OUTPUT", "highest.chosen"))
            }
        }
    }
}

/// Writes the crate `name` into a new folder of that name in `parent`; gives the files.
///
/// # Errors
/// A name that cannot be one of a crate, a folder that is there already, a checkout that is gone, or what cannot be written.
pub fn plugin(program: &Program, parent: &Path, name: &str, role: NewRole) -> Result<Vec<String>, String> {
    check_name(name)?;
    let workspace = program.manifest()?;
    let folder = parent.join(name);
    if folder.exists() {
        return Err(format!("`{}` is there already and is left as it is; choose another name", folder.display()));
    }
    let template = role.template();
    let library = format!("{}{name}{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let named = |text: &str| {
        let text = text.replace("example.speed_limit", "my_plugin.filter").replace("speed_limit.", "my_plugin.");
        text.replace("SpeedLimit", "MyNode")
            .replace("MY_SUMMARY", template.summary)
            .replace("my_role", template.role)
            .replace("my_plugin", name)
            .replace("MyNode", &camel_case(name))
            .replace("LIBRARY", &library)
    };
    let checkout = program.checkout.to_string_lossy();
    let manifest = named(MANIFEST)
        .replace("CHECKOUT", &checkout.replace('\\', "/"))
        .replace("NALGEBRA", &version_of(&workspace, "nalgebra"))
        .replace("SCHEMARS", &version_of(&workspace, "schemars"))
        .replace("SERDE", &version_of(&workspace, "serde"));
    // The versions that the program has, so that nothing has to be fetched.
    let lock = program.checkout.join("Cargo.lock");
    let lock = fs::read_to_string(&lock).map_err(|error| format!("`{}` cannot be read: {error}", lock.display()))?;
    let files = [
        ("Cargo.toml".to_owned(), manifest),
        ("Cargo.lock".to_owned(), lock),
        (".gitignore".to_owned(), IGNORED.to_owned()),
        ("src/lib.rs".to_owned(), named(LIB)),
        (format!("src/{}.rs", template.role), named(template.code)),
        (format!("{name}.toml"), named(&format!("{RIG}{}", role.nodes()))),
        (format!("{name}.calibration.toml"), CALIBRATION.to_owned()),
    ];
    let mut written = Vec::new();
    for (file, text) in files {
        let path = folder.join(&file);
        let failed = |error: std::io::Error| format!("`{}` cannot be written: {error}", path.display());
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(failed)?;
        }
        fs::write(&path, text).map_err(failed)?;
        written.push(format!("{name}/{file}"));
    }
    Ok(written)
}

/// What a workspace asks for.
fn version_of(workspace: &Table, package: &str) -> String {
    let dependency = workspace.get("workspace").and_then(|it| it.get("dependencies")).and_then(|it| it.get(package));
    let version = dependency.and_then(|it| it.as_str().or_else(|| it.get("version").and_then(Value::as_str)));
    version.unwrap_or("*").to_owned()
}

/// Words that no crate can be named, and names that its own dependencies have.
const TAKEN: [&str; 16] = [
    "foveate",
    "nalgebra",
    "schemars",
    "serde",
    "std",
    "core",
    "alloc",
    "test",
    "proc_macro",
    "crate",
    "self",
    "super",
    "mod",
    "fn",
    "type",
    "plugin",
];

fn check_name(name: &str) -> Result<(), String> {
    let is_fine = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    if !name.starts_with(|c: char| c.is_ascii_lowercase()) || !name.chars().all(is_fine) || name.ends_with('_') {
        return Err(format!("found the name `{name}`, expected small letters, digits and `_`, a letter first"));
    }
    if TAKEN.contains(&name) || name.starts_with("foveate") {
        return Err(format!("found the name `{name}`, which is taken, expected another one"));
    }
    Ok(())
}

/// `StarFinder` of `star_finder`.
fn camel_case(name: &str) -> String {
    let words = name.split('_').filter(|it| !it.is_empty());
    words.map(|it| it[..1].to_uppercase() + &it[1..]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_cannot_be_a_crate_s_are_refused() {
        for name in [
            "",
            "Star",
            "9star",
            "star-finder",
            "star finder",
            "../star",
            "star_",
            "serde",
            "fn",
            "foveate_led",
            "störn",
        ] {
            assert!(check_name(name).is_err(), "{name}");
        }
        assert_eq!(check_name("star_finder2"), Ok(()));
        assert_eq!(camel_case("star_finder"), "StarFinder");
    }

    #[test]
    fn no_placeholder_is_left() {
        let folder = tempfile::tempdir().unwrap();
        for (role, name) in [(NewRole::Detector, "a1"), (NewRole::Filter, "b_c"), (NewRole::Selector, "d")] {
            let files = plugin(&Program::this("foveate-cli", vec![]), folder.path(), name, role).unwrap();
            assert_eq!(files.len(), 7);
            for file in files.iter().filter(|it| !it.ends_with("Cargo.lock")) {
                let text = fs::read_to_string(folder.path().join(file)).unwrap();
                let left = [
                    "my_plugin",
                    "MyNode",
                    "speed_limit",
                    "SpeedLimit",
                    "my_role",
                    "MY_SUMMARY",
                    "CHECKOUT",
                    "NALGEBRA",
                    "OUTPUT",
                    "LIBRARY",
                ];
                left.iter().for_each(|it| assert!(!text.contains(it), "{file} holds {it}"));
                if file.ends_with(".toml") {
                    text.parse::<Table>().unwrap();
                }
            }
        }
        let again = plugin(&Program::this("foveate-cli", vec![]), folder.path(), "d", NewRole::Filter);
        assert!(again.unwrap_err().contains("is there already"));
        let gone = Program { checkout: "/no/such/checkout".into(), ..Program::this("foveate-cli", vec![]) };
        let refused = plugin(&gone, folder.path(), "e", NewRole::Filter).unwrap_err();
        assert!(refused.contains("/no/such/checkout") && refused.contains("is gone"), "{refused}");
        assert!(!folder.path().join("e").exists(), "nothing is left of it");
    }
}
