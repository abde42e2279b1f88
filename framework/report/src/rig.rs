//! The title, and the section on what the rig is: scales, nodes, the graph.

use std::collections::{BTreeMap, BTreeSet};

use toml::Value;

use crate::folder::{Entry, Folder, Rows};
use crate::page::{Html, Page, Table};
use crate::pictures::Budget;
use crate::words;

/// The name of the rig, or that none is known.
pub(crate) fn title(folder: &Folder) -> String {
    let name = folder.of_rig("name").and_then(Value::as_str);
    name.map_or_else(|| "Results of an unnamed rig".to_owned(), |it| format!("Results of {it}"))
}

/// What a person wants to know first, name and value.
pub(crate) fn facts(folder: &Folder) -> Vec<(String, String)> {
    let mut facts = Vec::new();
    let mut fact = |name: &str, value: String| facts.push((name.to_owned(), value));
    if let Some(session_s) = folder.figure("session_s") {
        fact("session", words::duration(session_s));
    }
    if is_interrupted(folder) {
        fact("ended", "stopped before its end".to_owned());
    }
    if let Some(seed) = folder.of_rig("seed").and_then(Value::as_integer) {
        fact("seed", seed.to_string());
    }
    let cameras = folder.cameras();
    if !cameras.is_empty() {
        fact("cameras", cameras.len().to_string());
    }
    for (figure, name) in [("faults", "faults"), ("requirements_unmet", "requirements not met"), ("gaps", "gaps")] {
        if let Some(count) = folder.figure(figure) {
            fact(name, words::number(count));
        }
    }
    facts
}

/// Whether the run was stopped before its end.
pub(crate) fn is_interrupted(folder: &Folder) -> bool {
    let says = |it: &serde_json::Map<String, serde_json::Value>| {
        it.get("interrupted").and_then(|it| it.as_bool()) == Some(true)
    };
    folder.summary.as_ref().is_ok_and(says) || folder.timing.as_ref().is_ok_and(says)
}

/// The scales of a rig.
fn scales(rig: &toml::Table) -> Vec<(&str, &toml::Table)> {
    tables(rig.get("scale"))
}

/// The nodes of a scale.
fn nodes(scale: &toml::Table) -> Vec<(&str, &toml::Table)> {
    tables(scale.get("node"))
}

fn tables(value: Option<&Value>) -> Vec<(&str, &toml::Table)> {
    let table = value.and_then(Value::as_table);
    table.into_iter().flatten().filter_map(|(name, it)| Some((name.as_str(), it.as_table()?))).collect()
}

/// The types of all nodes.
pub(crate) fn node_types(rig: &toml::Table) -> Vec<&str> {
    scales(rig).into_iter().flat_map(|it| nodes(it.1)).map(|it| node_type(it.1)).collect()
}

/// Sorts scales or nodes as they stand in the text; those whose header is not found come last.
fn in_order<'a>(
    mut tables: Vec<(&'a str, &'a toml::Table)>,
    text: &str,
    prefix: &str,
) -> Vec<(&'a str, &'a toml::Table)> {
    tables.sort_by_cached_key(|it| text.find(&format!("\n[{prefix}{}]", it.0)).unwrap_or(usize::MAX));
    tables
}

fn node_type(node: &toml::Table) -> &str {
    node.get("type").and_then(Value::as_str).unwrap_or("–")
}

/// Writes the section.
pub(crate) fn write(page: &mut Page, folder: &Folder, budget: &mut Budget) {
    page.section("rig", "What the rig is");
    match &folder.rig {
        Err(sentence) => page.missing(sentence),
        Ok(rig) => {
            page.paragraph(&in_words(folder, rig));
            page.table(&table(rig, &folder.rig_text, &instances(folder)));
        }
    }
    let path = folder.path.join("graph.svg");
    let bytes = std::fs::metadata(&path).map(|it| it.len());
    match bytes {
        Err(_) => page.missing("`graph.svg` is missing."),
        Ok(bytes) => match budget.picture(&Entry { name: "graph.svg".to_owned(), path, bytes }) {
            Ok(picture) => {
                page.html(&picture.figure_that_grows("graph-size", "The graph: nodes, and the edges between them"))
            }
            Err(sentence) => page.missing(&sentence),
        },
    }
}

/// Name, scales, calibration, and whether it is simulated.
fn in_words(folder: &Folder, rig: &toml::Table) -> String {
    let name = folder.of_rig("name").and_then(Value::as_str).unwrap_or("without a name");
    let n_nodes = node_types(rig).len();
    let mut words = vec![format!(
        "The rig `{name}` has {} and {}.",
        words::so_many(scales(rig).len(), "scale"),
        words::so_many(n_nodes, "node")
    )];
    if let Some(seed) = folder.of_rig("seed").and_then(Value::as_integer) {
        words.push(format!("Everything random in it comes from the seed {seed}."));
    }
    if let Some(calibration) = folder.of_rig("calibration").and_then(Value::as_str) {
        words.push(format!("Its calibration is `{calibration}`."));
    }
    let mut types = node_types(rig);
    types.retain(|it| it.starts_with("sim."));
    types.sort_unstable();
    types.dedup();
    if !types.is_empty() {
        words.push(format!("What it observed was simulated, at least in part ({}).", types.join(", ")));
    }
    words.join(" ")
}

/// One row a node, in groups by scale.
fn table(rig: &toml::Table, text: &str, instances: &BTreeSet<String>) -> Table {
    let mut table = Table::new(
        "Scales and their nodes",
        &[("node", false), ("type", false), ("for each camera", false), ("takes from", false), ("requires", false)],
    );
    for (scale, content) in in_order(scales(rig), text, "scale.") {
        let parent = content.get("parent").and_then(Value::as_str).map_or(String::new(), |it| format!(", inside {it}"));
        let anchor = content.get("anchor").and_then(Value::as_str).map_or(String::new(), |it| format!(", around {it}"));
        table.group(&format!("scale {scale}{parent}{anchor}"));
        for (name, node) in in_order(nodes(content), text, &format!("scale.{scale}.node.")) {
            let each = cameras_of(node, &format!("{scale}.{name}"), instances);
            let sources = sources(node).join(", ");
            table.row(&[
                Html::name(name),
                Html::code(node_type(node)),
                each,
                Html::name(&sources),
                Html::text(&promises(node)),
            ]);
        }
    }
    table
}

/// The cameras of a node as the rig says it, and how many instances it had: by the edges of the ledger, where there are some.
fn cameras_of(node: &toml::Table, path: &str, instances: &BTreeSet<String>) -> Html {
    let patterns = match node.get("each") {
        Some(Value::String(pattern)) => pattern.clone(),
        Some(Value::Array(list)) => list.iter().filter_map(Value::as_str).collect::<Vec<_>>().join(", "),
        _ => return Html::default(),
    };
    match instances.iter().filter(|it| it.strip_prefix(path).is_some_and(|rest| rest.starts_with('['))).count() {
        0 => Html::code(&patterns),
        n => Html::code(&patterns).then(&Html::text(&format!(" ({n})"))),
    }
}

/// The instances of nodes that edges join: `room.leds[wide-1]`.
fn instances(folder: &Folder) -> BTreeSet<String> {
    let edges = folder.ledger.iter().flat_map(Rows::iter).map(|row| row.text("edge").to_owned());
    let ends = |edge: String| edge.split(" -> ").map(str::to_owned).collect::<Vec<_>>();
    edges.flat_map(ends).filter_map(|it| it.split_once(']').map(|it| format!("{}]", it.0))).collect()
}

/// Nodes whose outputs a node takes.
fn sources(node: &toml::Table) -> Vec<String> {
    let inputs = node.get("in").and_then(Value::as_table);
    let mut names: Vec<String> = inputs
        .into_iter()
        .flatten()
        .filter_map(|(_, it)| it.get("from").and_then(Value::as_str).or_else(|| it.as_str()))
        // `room.leds.features` is of the node `room.leds`.
        .map(|it| it.rsplit_once('.').map_or(it, |it| it.0).to_owned())
        .collect();
    names.sort();
    names.dedup();
    names
}

/// Promises on inputs: `age_ms 20, rate_hz 30`.
fn promises(node: &toml::Table) -> String {
    let ports = node.get("require").and_then(Value::as_table);
    let mut all: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for (port, promise) in ports.into_iter().flatten() {
        for (name, limit) in promise.as_table().into_iter().flatten() {
            let limit = match limit {
                Value::Boolean(true) => String::new(),
                Value::Boolean(false) => continue,
                Value::Float(it) => format!(" {}", words::number(*it)),
                other => format!(" {other}"),
            };
            all.entry(port).or_default().push(format!("{name}{limit}"));
        }
    }
    all.iter().map(|(port, limits)| format!("{port}: {}", limits.join(", "))).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_listed_with_what_they_take_and_require() {
        let rig: toml::Table = "[scale.room.node.targets]\ntype = \"led.integrator\"\neach = \"wide-*\"\n\
             in.features = { from = \"room.leds.features\" }\nin.more = { from = \"room.leds.more\" }\n\
             require.features = { age_ms = 20.0, must = false, rate_hz = 30.0 }"
            .parse()
            .unwrap();
        let scales = scales(&rig);
        let nodes = nodes(scales[0].1);
        assert_eq!((scales[0].0, nodes[0].0, node_type(nodes[0].1)), ("room", "targets", "led.integrator"));
        assert_eq!(sources(nodes[0].1), ["room.leds"]);
        assert_eq!(promises(nodes[0].1), "features: age_ms 20, rate_hz 30");
    }

    #[test]
    fn nodes_stand_in_the_order_of_the_rig() {
        let text = "[rig]\n[scale.a]\n[scale.a.node.z]\n[scale.a.node.b]\n[scale.a.node.'q q']\n";
        let rig: toml::Table = text.parse().unwrap();
        let names: Vec<&str> =
            in_order(nodes(scales(&rig)[0].1), text, "scale.a.node.").iter().map(|it| it.0).collect();
        assert_eq!(names, ["z", "b", "q q"]);
    }

    #[test]
    fn cameras_of_a_node_are_those_of_its_instances() {
        let node = |text: &str| text.parse::<toml::Table>().unwrap();
        let instances = ["room.leds[c1]", "room.leds[c2]", "room.leds_2[c1]"].map(str::to_owned).into_iter().collect();
        let of = |each: &str, path: &str| cameras_of(&node(each), path, &instances).as_str().to_owned();
        assert_eq!(of("each = \"c*\"", "room.leds"), "<code>c*</code> (2)");
        assert_eq!(of("each = [\"c*\", \"!c3\"]", "room.more"), "<code>c*, !c3</code>");
        assert_eq!(of("type = \"x\"", "room.leds"), "");
    }
}
