//! The settings of a node type for people: read from its JSON Schema, which comes from the source itself.

use serde_json::Value;

use crate::registry::NodeType;

/// One setting, as `foveate nodes TYPE` shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct SettingDoc {
    /// Its name; dotted where it is nested.
    pub name: String,
    /// `number`, `integer`, `text`, `one of "a", "b"`, `list of numbers`, …
    pub kind: String,
    /// `0 to 255`; `None` where any value of the kind will do.
    pub range: Option<String>,
    /// As TOML would write it; `None`: required.
    pub default: Option<String>,
    /// What it is for, with its unit in brackets at the end.
    pub description: String,
    /// Whether it may change while the rig runs.
    pub is_live: bool,
}

/// All settings of `node_type`, in the order of its source where the schema keeps it.
pub fn setting_docs(node_type: &NodeType) -> Vec<SettingDoc> {
    let root = node_type.schema.as_value();
    let mut docs = Vec::new();
    collect(root, root, "", &mut docs);
    docs
}

fn collect(root: &Value, object: &Value, prefix: &str, docs: &mut Vec<SettingDoc>) {
    let Some(properties) = object.get("properties").and_then(Value::as_object) else { return };
    for (name, property) in properties {
        let schema = resolve(root, property);
        let name = format!("{prefix}{name}");
        if schema.get("properties").is_some() {
            collect(root, schema, &format!("{name}."), docs);
            continue;
        }
        let described = [property, schema].iter().find_map(|it| it.get("description")?.as_str());
        docs.push(SettingDoc {
            name,
            kind: kind(root, schema),
            range: range(schema),
            default: property.get("default").or_else(|| schema.get("default")).map(in_toml),
            description: described.unwrap_or_default().to_owned(),
            is_live: property.get("live").is_some_and(|it| it == true),
        });
    }
}

/// Follows `$ref`, and looks through "or null".
fn resolve<'s>(root: &'s Value, mut schema: &'s Value) -> &'s Value {
    for _ in 0..16 {
        let next = match (schema.get("$ref").and_then(Value::as_str), schema.get("anyOf").and_then(Value::as_array)) {
            (Some(reference), _) => reference.strip_prefix('#').and_then(|pointer| root.pointer(pointer)),
            (None, Some(choices)) => choices.iter().find(|it| it.get("type").and_then(Value::as_str) != Some("null")),
            (None, None) => None,
        };
        match next {
            Some(next) => schema = next,
            None => break,
        }
    }
    schema
}

fn kind(root: &Value, schema: &Value) -> String {
    let constants: Vec<String> = match (schema.get("enum"), schema.get("oneOf")) {
        (Some(Value::Array(values)), _) => values.iter().map(in_toml).collect(),
        (None, Some(Value::Array(values))) => values.iter().filter_map(|it| it.get("const")).map(in_toml).collect(),
        _ => Vec::new(),
    };
    if !constants.is_empty() {
        return format!("one of {}", constants.join(", "));
    }
    let name = match schema.get("type") {
        Some(Value::String(name)) => name.as_str(),
        Some(Value::Array(names)) => names.iter().filter_map(Value::as_str).find(|&it| it != "null").unwrap_or("value"),
        _ => "value",
    };
    match name {
        "string" => "text".to_owned(),
        "boolean" => "true or false".to_owned(),
        "array" => match schema.get("items") {
            Some(items) => format!("list of {}", kind(root, resolve(root, items))),
            None => "list".to_owned(),
        },
        other => other.to_owned(),
    }
}

fn range(schema: &Value) -> Option<String> {
    let bound = |name: &str| schema.get(name).filter(|it| it.is_number()).map(in_toml);
    match (bound("minimum"), bound("maximum"), bound("exclusiveMinimum"), bound("exclusiveMaximum")) {
        (Some(low), Some(high), _, _) => Some(format!("{low} to {high}")),
        (Some(low), None, _, Some(high)) => Some(format!("{low} to below {high}")),
        (Some(low), None, _, None) => Some(format!("at least {low}")),
        (None, Some(high), Some(low), _) => Some(format!("above {low}, to {high}")),
        (None, _, Some(low), Some(high)) => Some(format!("above {low}, below {high}")),
        (None, None, Some(low), None) => Some(format!("above {low}")),
        (None, Some(high), None, _) => Some(format!("at most {high}")),
        (None, None, None, Some(high)) => Some(format!("below {high}")),
        (None, None, None, None) => None,
    }
}

/// A JSON value as a rig would write it; `none` for null, which TOML writes by leaving the key out.
fn in_toml(value: &Value) -> String {
    match value {
        Value::Null => "none".to_owned(),
        Value::Number(it) => match it.as_f64() {
            Some(number) if it.is_f64() && number.fract() == 0.0 && number.abs() < 1e15 => format!("{number:.0}"),
            _ => it.to_string(),
        },
        Value::Array(items) => format!("[{}]", items.iter().map(in_toml).collect::<Vec<_>>().join(", ")),
        Value::Object(map) => {
            let entries: Vec<String> = map.iter().map(|(key, it)| format!("{key} = {}", in_toml(it))).collect();
            format!("{{ {} }}", entries.join(", "))
        }
        other => other.to_string(),
    }
}
