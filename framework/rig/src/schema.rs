//! The JSON Schema of a whole rig, so that an editor completes and checks one.
//!
//! Made so that checkers point at the value: no `oneOf` over node types, but `if` and `then` on `type`; a connection's
//! three forms are one schema with keywords for each kind of value.

use std::sync::Arc;

use serde_json::{Map, Value as Json, json};

use super::grammar::{self, table};
use super::targets;
use crate::graph::SINK_CAPACITY;
use foveate_node::Origin;
use foveate_node::node::{Node, Role};
use foveate_node::port::{InputPolicy, InputSpec};
use foveate_node::registry::{NodeType, Registry};
use foveate_node::scale::ScaleAnchor;

/// JSON Schema (2020-12) of rigs made of the node types in `registry`.
pub fn schema(registry: &Registry) -> Json {
    let mut definitions = Map::new();
    definitions.insert("scale".to_owned(), scale());
    definitions.insert("node".to_owned(), node(registry));
    definitions.insert("require".to_owned(), require());
    for node_type in written(registry) {
        add_node_type(node_type, &mut definitions);
    }
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Foveate rig",
        "description": "Scales, each a graph of nodes that recovers motion in a space of its own.",
        "type": "object",
        "properties": {
            "rig": head(),
            "plugins": plugins(),
            "record": record(),
            "budget": budgets(),
            "scale": {
                "description": "The scales by name. One without a parent has the world as its space.",
                "type": "object",
                "propertyNames": plain_name(),
                "additionalProperties": reference("scale"),
                "minProperties": 1
            }
        },
        "required": ["rig", "scale"],
        "additionalProperties": false,
        "$defs": definitions
    })
}

/// The types of nodes that a rig writes: all but the one that the loader makes.
pub(super) fn written(registry: &Registry) -> impl Iterator<Item = &Arc<NodeType>> {
    registry.iter().filter(|it| it.name != ScaleAnchor::TYPE)
}

fn reference(definition: &str) -> Json {
    json!({ "$ref": format!("#/$defs/{definition}") })
}

fn plain_name() -> Json {
    json!({ "pattern": "^[a-z0-9_-]+$" })
}

fn head() -> Json {
    table("What concerns the rig as a whole.", &grammar::rig::ALL, &[&grammar::rig::NAME])
}

fn plugins() -> Json {
    use grammar::plugins::{ALL, LIBRARIES};
    let mut schema = table("Node types that are not part of the program.", &ALL, &[]);
    let paths = json!({ "type": "array", "items": { "type": "string" } });
    extend(&mut schema["properties"][LIBRARIES.name], paths);
    schema
}

fn record() -> Json {
    use grammar::record::{ALL, CAMERAS};
    let mut schema = table("The run is recorded into a session.", &ALL, &[]);
    let forms = grammar::record::PICTURES.schema()["enum"].clone();
    let of_cameras = json!({ "type": "object", "additionalProperties": { "enum": forms } });
    extend(&mut schema["properties"][CAMERAS.name], of_cameras);
    schema
}

fn budgets() -> Json {
    use grammar::budget::{AGE_MS, ALL, FROM, TO};
    let of = "How old information may be at the end of a path through the nodes; measured, shown, reported.";
    json!({ "type": "array", "items": table(of, &ALL, &[&FROM, &TO, &AGE_MS]) })
}

fn scale() -> Json {
    use grammar::scale::{ALL, NODE, TARGET, VOLUME_M};
    let mut schema = table("A graph of nodes with a space of its own.", &ALL, &[]);
    let point = json!({ "type": "array", "items": { "type": "number" }, "minItems": 3, "maxItems": 3 });
    let named = |of: Json| json!({ "type": "object", "propertyNames": plain_name(), "additionalProperties": of });
    let volume = json!({
        "type": "object",
        "properties": { "min": point, "max": point },
        "required": ["min", "max"],
        "additionalProperties": false
    });
    let parts = [(VOLUME_M, volume), (TARGET, named(targets::schema())), (NODE, named(reference("node")))];
    for (key, part) in parts {
        extend(&mut schema["properties"][key.name], part);
    }
    schema
}

/// Adds the keywords of `more` to `schema`.
fn extend(schema: &mut Json, more: Json) {
    if let (Some(schema), Json::Object(more)) = (schema.as_object_mut(), more) {
        schema.extend(more);
    }
}

fn node(registry: &Registry) -> Json {
    let names: Vec<&str> = written(registry).map(|it| it.name).collect();
    let summaries: Vec<String> = written(registry).map(|it| format!("{}: {}", it.role.name(), summary(it))).collect();
    let branches: Vec<Json> = written(registry)
        .map(|it| {
            json!({
                "if": { "properties": { "type": { "const": it.name } }, "required": ["type"] },
                "then": reference(&definition(it.name))
            })
        })
        .collect();
    json!({
        "description": "A node: reserved keys, and the settings of its type.",
        "type": "object",
        "properties": {
            "type": {
                "description": "The node type; `foveate nodes` lists them.",
                "type": "string",
                "enum": names,
                "x-taplo": { "docs": { "enumValues": summaries } }
            }
        },
        "required": ["type"],
        "allOf": branches
    })
}

fn definition(node_type: &str) -> String {
    format!("node:{node_type}")
}

/// The keys that every node has, for a node with these ports.
fn reserved(node_type: &NodeType) -> Map<String, Json> {
    let is_source = node_type.role == Role::Source;
    let costs = [grammar::node::COST_MS.name, grammar::node::COST_JITTER_MS.name];
    let mut keys: Map<String, Json> = grammar::node::ALL
        .iter()
        .filter(|it| !(is_source && costs.contains(&it.name)))
        .map(|it| (it.name.to_owned(), it.schema()))
        .collect();
    keys[grammar::node::TYPE.name] = json!({ "description": node_type.summary, "const": node_type.name });
    let patterns = json!({ "type": ["string", "array"], "items": { "type": "string" }, "minItems": 1 });
    extend(&mut keys[grammar::node::EACH.name], patterns);
    let inputs = &node_type.ports.inputs;
    let ports: Map<String, Json> =
        inputs.iter().map(|it| (it.name.to_owned(), connection(it, node_type.role))).collect();
    let needed: Vec<&str> = inputs.iter().filter(|it| !it.optional).map(|it| it.name).collect();
    extend(
        &mut keys[grammar::node::IN.name],
        json!({ "type": "object", "properties": ports, "required": needed, "additionalProperties": false }),
    );
    let requires: Map<String, Json> = inputs.iter().map(|it| (it.name.to_owned(), reference("require"))).collect();
    extend(
        &mut keys[grammar::node::REQUIRE.name],
        json!({ "type": "object", "properties": requires, "additionalProperties": false }),
    );
    keys
}

/// A text, a list of texts, or a table: each keyword speaks of one kind of value only.
fn connection(port: &InputSpec, role: Role) -> Json {
    use grammar::connection::{CAPACITY, DELAY_MS, FROM, POLICY, TOLERANCE_MS, WHEN_FULL_KEY};
    let policy = port.policy.in_words();
    let count = if port.many { "any number of sources" } else { "one source" };
    let pattern = "^[^.\\[\\]]+(\\.[^.\\[\\]]+)?(\\[.+\\])?\\.[^.\\[\\]]+$";
    let source = json!({ "type": "string", "pattern": pattern });
    let mut keys = vec![&FROM, &CAPACITY, &WHEN_FULL_KEY];
    let joins = if let InputPolicy::Synced(own) = port.policy { Some(own) } else { None };
    keys.extend(joins.map(|_| &TOLERANCE_MS));
    keys.extend(port.policy.choice().map(|_| &POLICY));
    keys.extend((port.policy == InputPolicy::Latest).then_some(&DELAY_MS));
    let description = format!("Takes `{}` from {count}: {policy}. {}.", port.message.name, FROM.doc);
    let mut schema = table(&description, &keys, &[&FROM]);
    let forms = json!({ "type": ["string", "array"], "pattern": pattern, "items": source, "minItems": 1 });
    let properties = &mut schema["properties"];
    extend(&mut properties[FROM.name], forms.clone());
    if role == Role::Sink {
        properties[CAPACITY.name]["default"] = json!(SINK_CAPACITY);
    }
    if let Some(own) = joins {
        properties[TOLERANCE_MS.name]["default"] = json!(own.as_ms());
    }
    if let Some(own) = port.policy.choice() {
        let words = InputPolicy::CHOICES.map(|it| it.1.in_words()).to_vec();
        extend(&mut properties[POLICY.name], json!({ "default": own, "x-taplo": { "docs": { "enumValues": words } } }));
    }
    extend(&mut schema, forms);
    schema["type"] = json!(["string", "array", "object"]);
    if !port.many {
        schema["maxItems"] = json!(1);
    }
    schema
}

fn require() -> Json {
    table("Measured, shown, reported.", &grammar::requirement::ALL, &[])
}

/// What a node type does, and the library that it comes from.
fn summary(node_type: &NodeType) -> String {
    match &node_type.origin {
        Origin::Library(path) => format!("{} (from {})", node_type.summary, path.display()),
        Origin::Linked(_) => node_type.summary.to_owned(),
    }
}

/// The settings of a node type beside the reserved keys; its own definitions move to the rig's.
fn add_node_type(node_type: &NodeType, definitions: &mut Map<String, Json>) {
    let mut schema = node_type.schema.as_value().clone();
    rename_references(&mut schema, node_type.name);
    let Json::Object(mut schema) = schema else { return };
    if let Some(Json::Object(inner)) = schema.remove("$defs") {
        definitions.extend(inner.into_iter().map(|(name, it)| (format!("{}:{name}", definition(node_type.name)), it)));
    }
    schema.remove("$schema");
    schema.remove("title");
    let settings = schema.remove("properties");
    let mut properties = reserved(node_type);
    if let Some(Json::Object(settings)) = settings {
        properties.extend(settings);
    }
    let mut needed = vec![json!("type")];
    if node_type.ports.inputs.iter().any(|it| !it.optional) {
        needed.push(json!("in"));
    }
    if let Some(Json::Array(settings)) = schema.remove("required") {
        needed.extend(settings);
    }
    // Alternatives hold properties that `additionalProperties` would not see.
    let has_parts = ["allOf", "anyOf", "oneOf"].iter().any(|it| schema.contains_key(*it));
    schema.remove("additionalProperties");
    schema.insert("description".to_owned(), json!(summary(node_type)));
    schema.insert("properties".to_owned(), Json::Object(properties));
    schema.insert("required".to_owned(), Json::Array(needed));
    schema.insert(if has_parts { "unevaluatedProperties" } else { "additionalProperties" }.to_owned(), json!(false));
    definitions.insert(definition(node_type.name), Json::Object(schema));
}

/// `#/$defs/Window` of a node type to its place in the rig's schema.
fn rename_references(schema: &mut Json, node_type: &str) {
    match schema {
        Json::Object(map) => {
            for (key, value) in map {
                match (key.as_str(), value) {
                    ("$ref", Json::String(reference)) => {
                        if let Some(name) = reference.strip_prefix("#/$defs/") {
                            *reference = format!("#/$defs/{}:{name}", definition(node_type));
                        }
                    }
                    // What a default or a constant holds is no schema.
                    ("default" | "const" | "enum", _) => {}
                    (_, value) => rename_references(value, node_type),
                }
            }
        }
        Json::Array(list) => list.iter_mut().for_each(|it| rename_references(it, node_type)),
        _ => {}
    }
}
