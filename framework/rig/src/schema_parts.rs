//! What a JSON Schema holds: references followed, alternatives, words, properties, types.

use serde_json::Value as Json;

/// References to references to … that are followed.
const MOST_REFERENCES: usize = 32;

/// Follows local references.
pub(super) fn resolved<'s>(root: &'s Json, mut schema: &'s Json) -> &'s Json {
    for _ in 0..MOST_REFERENCES {
        let Some(reference) = schema.get("$ref").and_then(Json::as_str) else { break };
        let Some(target) = reference.strip_prefix('#').and_then(|it| root.pointer(it)) else { break };
        schema = target;
    }
    schema
}

/// Alternatives other than "nothing".
pub(super) fn alternatives(schema: &Json) -> Option<Vec<&Json>> {
    let list = schema.get("anyOf").or_else(|| schema.get("oneOf"))?.as_array()?;
    let is_null = |it: &&Json| it.get("type").and_then(Json::as_str) == Some("null");
    Some(list.iter().filter(|it| !is_null(it)).collect())
}

/// The words that a schema allows, where it allows nothing but words.
pub(super) fn words<'s>(root: &'s Json, schema: &'s Json) -> Option<Vec<&'s str>> {
    let schema = resolved(root, schema);
    if let Some(word) = schema.get("const") {
        return Some(vec![word.as_str()?]);
    }
    if let Some(list) = schema.get("enum").and_then(Json::as_array) {
        return list.iter().filter(|it| !it.is_null()).map(Json::as_str).collect();
    }
    let lists: Option<Vec<_>> = alternatives(schema)?.into_iter().map(|it| words(root, it)).collect();
    lists.map(|it| it.concat()).filter(|it| !it.is_empty())
}

/// All keys that a table of this schema may have, with their schemas; `open` when it may have any.
pub(super) fn collect_properties<'s>(
    root: &'s Json,
    schema: &'s Json,
    known: &mut Vec<(&'s str, &'s Json)>,
    open: &mut bool,
    depth: usize,
) {
    if depth > MOST_REFERENCES {
        return;
    }
    let schema = resolved(root, schema);
    let properties = schema.get("properties").and_then(Json::as_object);
    known.extend(properties.into_iter().flatten().map(|(name, it)| (name.as_str(), it)));
    let mut has_parts = false;
    for part in ["allOf", "anyOf", "oneOf"].iter().filter_map(|it| schema.get(it)?.as_array()).flatten() {
        has_parts = true;
        collect_properties(root, part, known, open, depth + 1);
    }
    let other = schema.get("additionalProperties").or_else(|| schema.get("unevaluatedProperties"));
    *open |= match other {
        Some(other) => other.is_object() || other.as_bool() == Some(true),
        None => properties.is_none() && !has_parts,
    };
}

/// What the schema's author wrote about it.
pub(super) fn description(schema: &Json) -> Option<&str> {
    schema.get("description").and_then(Json::as_str)
}

/// The JSON types that a schema allows; empty: any.
pub(super) fn kinds(schema: &Json) -> Vec<&str> {
    match schema.get("type") {
        Some(Json::String(kind)) => vec![kind],
        Some(Json::Array(list)) => list.iter().filter_map(Json::as_str).collect(),
        _ => Vec::new(),
    }
}
