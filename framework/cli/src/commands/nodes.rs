//! `foveate nodes`: the parts that rigs are made of.

use std::fmt::Write;
use std::sync::Arc;

use foveate_diagnostics::names::likely;
use foveate_node::figure::{Better, FigureSpec};
use foveate_node::port::InputSpec;
use foveate_node::registry::NodeType;
use foveate_node::setting_docs::{SettingDoc, setting_docs};
use foveate_node::{Origin, Registry};

use crate::exit;
use crate::output::say;

pub(super) fn run(node_type: Option<&str>, registry: &Registry) -> u8 {
    let Some(name) = node_type else {
        say(&list(registry));
        return exit::DONE;
    };
    match registry.get(name) {
        Some(it) => {
            say(&describe(it));
            exit::DONE
        }
        None if !of_plugin(name, registry).is_empty() => {
            say(&of_plugin(name, registry));
            exit::DONE
        }
        None => {
            let hint = likely(name, registry.iter().map(|it| it.name))
                .map_or(String::new(), |it| format!(" (did you mean `{it}`?)"));
            eprintln!("error: no node type is named `{name}`{hint}; `foveate nodes` lists them all");
            exit::INPUT
        }
    }
}

/// The node types of one plugin, `led` or `led.*`; empty where there is none of that name.
fn of_plugin(name: &str, registry: &Registry) -> String {
    let of = |it: &&Arc<NodeType>| it.name.split('.').next() == Some(name.trim_end_matches(".*"));
    let line = |it: &Arc<NodeType>| format!("{:32}  {}\n", it.name, it.summary.trim_end_matches('.'));
    registry.iter().filter(of).map(line).collect()
}

/// All node types with one line each, grouped by plugin.
pub fn list(registry: &Registry) -> String {
    let width = registry.iter().map(|it| it.name.len()).max().unwrap_or(0);
    let mut text = String::new();
    let mut plugin = "";
    for it in registry.iter() {
        let of = it.name.split('.').next().unwrap_or_default();
        if of != plugin {
            let gap = if plugin.is_empty() { "" } else { "\n" };
            let _ = writeln!(text, "{gap}{of}");
            plugin = of;
        }
        let _ = writeln!(text, "  {:width$}  {}", it.name, it.summary.trim_end_matches('.'));
    }
    for library in registry.libraries() {
        let mine = registry.iter().filter(|it| it.origin == Origin::Library(library.to_owned()));
        let names: Vec<&str> = mine.map(|it| it.name).collect();
        let _ = writeln!(text, "\n{} from the library {}", names.join(", "), library.display());
    }
    text += "\n`foveate nodes TYPE` shows the ports, settings and figures of one.\n";
    text
}

/// One node type for people.
fn describe(node_type: &NodeType) -> String {
    let mut text = format!("{} — {}\n{}\n", node_type.name, node_type.role.name(), node_type.summary);
    let _ = match &node_type.origin {
        Origin::Library(path) => writeln!(text, "From the library {}", path.display()),
        linked @ Origin::Linked(_) => writeln!(text, "Built in, from {linked}"),
    };
    if !node_type.ports.inputs.is_empty() {
        text += "\nInputs\n";
        for it in &node_type.ports.inputs {
            let space = it.message.space.in_words();
            let _ = writeln!(text, "  {:12} {:10} {}; {space}", it.name, it.message.name, taking(it));
        }
    }
    if !node_type.ports.outputs.is_empty() {
        text += "\nOutputs\n";
        for it in &node_type.ports.outputs {
            let local = if it.message.wire.codec().is_none() { "; stays in this process" } else { "" };
            let _ = writeln!(text, "  {:12} {:10} {}{local}", it.name, it.message.name, it.message.space.in_words());
        }
    }
    let settings = setting_docs(node_type);
    text += if settings.is_empty() { "\nNo settings.\n" } else { "\nSettings\n" };
    for it in &settings {
        text += &setting(it);
    }
    if !node_type.figures.is_empty() {
        text += "\nFigures\n";
        node_type.figures.iter().for_each(|it| text += &figure(it));
    }
    text
}

fn taking(port: &InputSpec) -> String {
    let how = port.policy.in_words();
    let many = if port.many { ", many sources" } else { "" };
    let optional = if port.optional { ", optional" } else { "" };
    format!("{how}{many}{optional}")
}

fn setting(it: &SettingDoc) -> String {
    let value = match &it.default {
        Some(default) => format!("default {default}"),
        None => "required".to_owned(),
    };
    let live = it.is_live.then(|| "live".to_owned());
    let facts = [Some(it.kind.clone()), it.range.clone(), Some(value), live]
        .into_iter()
        .flatten()
        .collect::<Vec<_>>()
        .join(", ");
    let mut text = format!("  {}  ({facts})\n", it.name);
    // "[–]" says that there is no unit; in the list that goes without saying.
    let description = it.description.trim_end().trim_end_matches('.').trim_end_matches("[–]");
    for line in wrap(description, 96) {
        let _ = writeln!(text, "      {line}");
    }
    text
}

fn figure(it: &FigureSpec) -> String {
    let better = match it.better {
        Better::Low => ", low is better",
        Better::High => ", high is better",
        Better::Neither => "",
    };
    let mut text = format!("  {}  ({}{better})\n", it.name, it.unit);
    for line in wrap(it.line, 96) {
        let _ = writeln!(text, "      {line}");
    }
    text
}

/// `text` in lines of at most `width` characters, broken between words.
pub(super) fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let full = lines
            .last()
            .is_some_and(|line| !line.is_empty() && line.chars().count() + 1 + word.chars().count() > width);
        if full {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_types_of_a_plugin_are_found_by_its_name() {
        let registry = crate::registry();
        let said = of_plugin("led", &registry);
        assert!(said.lines().count() > 3 && said.lines().all(|it| it.starts_with("led.")), "{said}");
        assert_eq!(of_plugin("led.*", &registry), said);
        assert_eq!(of_plugin("le", &registry), "");
    }

    #[test]
    fn figures_of_a_type_are_listed_with_unit_direction_and_line() {
        let registry = crate::registry();
        let said = describe(registry.get("led.path_error").unwrap());
        assert!(
            said.contains("\nFigures\n  *.{median,p90,max}  (m, low is better)\n      Distance of a row"),
            "{said}"
        );
        assert!(said.contains("  *.coverage  (share, high is better)\n"), "{said}");
        assert!(said.contains("  *.rows  (count)\n"), "{said}");
        let silent = describe(registry.get("export.overlay").unwrap());
        assert!(!silent.contains("Figures"), "{silent}");
    }
}
