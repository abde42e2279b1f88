//! `foveate plugin`: shared libraries of nodes for this very program.

use std::path::Path;

use foveate_plugin::build::{self, Program};
use foveate_plugin::scaffold::{self, NewRole};

use foveate_node::Registry;

use super::{PluginRole, complain};
use crate::exit;
use crate::output::say;

/// The program that a library must fit.
fn program() -> Program {
    let features = if cfg!(feature = "hardware") { vec!["foveate-cli/hardware"] } else { Vec::new() };
    Program::this("foveate-cli", features)
}

/// `foveate new plugin`
pub(super) fn new(name: &str, role: PluginRole, registry: &Registry) -> u8 {
    let prefix = format!("{name}.");
    if let Some(taken) = registry.iter().find(|it| it.name.starts_with(&prefix)) {
        return complain(&format!(
            "found the name `{name}`, which the node type `{}` has, expected another one",
            taken.name
        ));
    }
    let role = match role {
        PluginRole::Detector => NewRole::Detector,
        PluginRole::Filter => NewRole::Filter,
        PluginRole::Selector => NewRole::Selector,
    };
    match scaffold::plugin(&program(), Path::new("."), name, role) {
        Ok(files) => {
            say(&format!(
                "{}\n\nNext:\n  foveate plugin build {name}\n  foveate run {name}/{name}.toml\n  cargo test --manifest-path {name}/Cargo.toml   (the first time it compiles the framework: minutes)\n\n\
                 docs/write-a-plugin.md goes through it line by line.\n",
                files.join("\n")
            ));
            exit::DONE
        }
        Err(sentence) => complain(&sentence),
    }
}

/// `foveate plugin build`
pub(super) fn build(folder: &Path, out: Option<&Path>) -> u8 {
    match build::library(&program(), folder, out.unwrap_or(folder), &mut |line| eprintln!("{line}")) {
        Ok(built) => {
            let nodes = built.node_types.join(", ");
            say(&format!("{}: {nodes}\n", built.library.display()));
            exit::DONE
        }
        Err(sentence) => complain(&sentence),
    }
}
