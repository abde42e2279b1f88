//! The JSON Schema of a whole rig, so that an editor completes and checks one.
//!
//! Made so that checkers point at the value: no `oneOf` over node types, but `if` and `then` on `type`; a connection's
//! three forms are one schema with keywords for each kind of value.

use std::sync::Arc;

use serde_json::{Map, Value as Json, json};

use super::node_text::{LONGEST_COST_MS, ON_ERROR, WHEN_FULL};
use super::targets;
use crate::graph::{Queue, SINK_CAPACITY};
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
            "plugins": {
                "description": "Node types that are not part of the program.",
                "type": "object",
                "properties": {
                    "libraries": {
                        "description": "Shared libraries that `foveate plugin build` made, by path; their node types can be used in this rig.",
                        "type": "array",
                        "items": { "type": "string" }
                    }
                },
                "additionalProperties": false
            },
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
    json!({
        "description": "What concerns the rig as a whole.",
        "type": "object",
        "properties": {
            "name": {
                "description": "Results are filed under it: lower-case letters, digits, `_` and `-`.",
                "type": "string",
                "pattern": "^[a-z0-9_-]+$"
            },
            "calibration": {
                "description": "The cameras: a file, or a folder with results of MultiCamSelfCal. `${NAME}` is an environment variable.",
                "type": "string"
            },
            "folder": {
                "description": "Where relative paths start; left out: where this file lies.",
                "type": "string"
            },
            "seed": {
                "description": "Of all random numbers: the same seed gives the same results.",
                "type": "integer", "minimum": 0, "maximum": i64::MAX, "default": 1
            },
            "duration_s": {
                "description": "Where simulated and file-fed sources are cut off [s].",
                "type": "number", "exclusiveMinimum": 0, "maximum": 9e9
            },
            "report_speed": {
                "description": "Whether `summary.json` has the `real_time_factor` too, the one line in it that then differs from run to run.",
                "type": "boolean", "default": false
            }
        },
        "required": ["name"],
        "additionalProperties": false
    })
}

fn scale() -> Json {
    let point = json!({ "type": "array", "items": { "type": "number" }, "minItems": 3, "maxItems": 3 });
    json!({
        "description": "A graph of nodes with a space of its own.",
        "type": "object",
        "properties": {
            "parent": { "description": "The scale that this one nests in.", "type": "string" },
            "anchor": {
                "description": "The target that this scale's space moves with: a node of the parent that gives targets, dot, the name of one; `[scale.PARENT.target.NAME]` says which that is.",
                "type": "string",
                "pattern": "^[^.]+\\..+$"
            },
            "volume_m": {
                "description": "Where targets can be, in this scale's space: opposite corners [m].",
                "type": "object",
                "properties": { "min": point, "max": point },
                "required": ["min", "max"],
                "additionalProperties": false
            },
            "radius_m": {
                "description": "How far around its anchor this scale reaches [m].",
                "type": "number", "exclusiveMinimum": 0
            },
            "target": {
                "description": "Names for targets that scales can be anchored to.",
                "type": "object",
                "propertyNames": plain_name(),
                "additionalProperties": targets::schema()
            },
            "node": {
                "description": "The nodes by name.",
                "type": "object",
                "propertyNames": plain_name(),
                "additionalProperties": reference("node")
            }
        },
        "additionalProperties": false
    })
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
    let words = |list: &[&str]| Json::from(list.to_vec());
    let mut keys = Map::new();
    keys.insert("type".to_owned(), json!({ "description": node_type.summary, "const": node_type.name }));
    let each = "One instance for each camera of that name; `*` stands for any characters, `?` for one. A list takes what any of it matches; \
                `!` before a pattern leaves out what it matches.";
    let pattern = json!({ "type": "string" });
    keys.insert(
        "each".to_owned(),
        json!({ "description": each, "type": ["string", "array"], "items": pattern, "minItems": 1 }),
    );
    keys.insert("camera".to_owned(), json!({ "description": "The one camera that it serves.", "type": "string" }));
    let on_error = "What happens when it fails on a message: it stops, the message is dropped, or it is made anew.";
    let choices = words(&ON_ERROR.map(|it| it.0));
    keys.insert("on_error".to_owned(), json!({ "description": on_error, "enum": choices, "default": "stop" }));
    if node_type.role != Role::Source {
        let cost = |description: &str| json!({ "description": description, "type": "number", "minimum": 0, "maximum": LONGEST_COST_MS, "default": 0 });
        keys.insert(
            "cost_ms".to_owned(),
            cost("How long a turn keeps it busy on the logical clock of a run that is not live [ms]."),
        );
        keys.insert(
            "cost_jitter_ms".to_owned(),
            cost("By how much the cost of a turn varies up and down, uniformly [ms]."),
        );
    }
    let inputs = &node_type.ports.inputs;
    let ports: Map<String, Json> =
        inputs.iter().map(|it| (it.name.to_owned(), connection(it, node_type.role))).collect();
    let needed: Vec<&str> = inputs.iter().filter(|it| !it.optional).map(|it| it.name).collect();
    keys.insert(
        "in".to_owned(),
        json!({
            "description": "What each input takes.",
            "type": "object",
            "properties": ports,
            "required": needed,
            "additionalProperties": false
        }),
    );
    let requires: Map<String, Json> = inputs.iter().map(|it| (it.name.to_owned(), reference("require"))).collect();
    keys.insert(
        "require".to_owned(),
        json!({
            "description": "What the edges into each input promise.",
            "type": "object",
            "properties": requires,
            "additionalProperties": false
        }),
    );
    keys
}

/// A text, a list of texts, or a table: each keyword speaks of one kind of value only.
fn connection(port: &InputSpec, role: Role) -> Json {
    let capacity = if role == Role::Sink { SINK_CAPACITY } else { Queue::default().capacity };
    let how = port.policy.in_words();
    let count = if port.many { "any number of sources" } else { "one source" };
    let form = "NODE.OUTPUT, SCALE.NODE.OUTPUT or NODE[CAMERA].OUTPUT";
    let pattern = "^[^.\\[\\]]+(\\.[^.\\[\\]]+)?(\\[.+\\])?\\.[^.\\[\\]]+$";
    let most = if port.many { json!({}) } else { json!({ "maxItems": 1 }) };
    let source = json!({ "type": "string", "pattern": pattern });
    let when_full = WHEN_FULL.map(|it| it.0).to_vec();
    let mut schema = json!({
        "description": format!("Takes `{}` from {count}: {how}. {form}.", port.message.name),
        "type": ["string", "array", "object"],
        "pattern": pattern,
        "items": source,
        "minItems": 1,
        "properties": {
            "from": { "description": form, "type": ["string", "array"], "pattern": pattern, "items": source, "minItems": 1 },
            "capacity": {
                "description": "Messages that may wait.",
                "type": "integer", "minimum": 1, "maximum": 1_000_000, "default": capacity
            },
            "when_full": {
                "description": "What happens to one more: an old one is dropped, the new one is dropped, or its sender waits.",
                "enum": when_full,
                "default": "drop_oldest"
            }
        },
        "required": ["from"],
        "additionalProperties": false
    });
    if let InputPolicy::Synced(own) = port.policy {
        schema["properties"]["tolerance_ms"] = json!({
            "description": "How far apart the capture times of one set may lie [ms].",
            "type": "number", "minimum": 0, "maximum": 60_000, "default": own.as_ms()
        });
    }
    if let Some(own) = port.policy.choice() {
        schema["properties"]["policy"] = json!({
            "description": "Which of the waiting messages it takes when its node is free; the others are dropped and counted.",
            "enum": InputPolicy::CHOICES.map(|it| it.0).to_vec(),
            "default": own,
            "x-taplo": { "docs": { "enumValues": InputPolicy::CHOICES.map(|it| it.1.in_words()).to_vec() } }
        });
    }
    if let (Some(schema), Json::Object(most)) = (schema.as_object_mut(), most) {
        schema.extend(most);
    }
    schema
}

fn require() -> Json {
    let measure = |description: &str| json!({ "description": description, "type": "number", "exclusiveMinimum": 0 });
    json!({
        "description": "Measured, shown, reported.",
        "type": "object",
        "properties": {
            "age_ms": measure("Age at delivery, 99th percentile, at most [ms]."),
            "rate_hz": measure("Messages a second, at least [Hz]."),
            "sigma": measure("Mean standard deviation that the payload states, at most [px or m]."),
            "loss": {
                "description": "Fraction of the messages that were lost, at most.",
                "type": "number", "minimum": 0, "maximum": 1
            },
            "must": {
                "description": "Whether not meeting it fails the run, with exit code 3.",
                "type": "boolean", "default": false
            }
        },
        "additionalProperties": false
    })
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
