//! Describes in words what a JSON Schema expects: "a whole number from 0 to 255".

use foveate_diagnostics::names::one_of;
use serde_json::Value as Json;

use super::schema_parts::{alternatives, description, kinds, resolved, words};

/// Nested lists that are described.
const DEEPEST: usize = 4;

/// The unit of a setting: what stands in the last brackets of its documentation, up to a comma.
pub fn unit_of(description: &str) -> Option<&str> {
    let mut rest = description;
    while let Some(start) = rest.rfind('[') {
        let inside = &rest[start + 1..];
        // `[0, 1]` and [`Type`] are no units.
        if let Some(end) = inside.find(']').filter(|_| !inside.starts_with('`')) {
            let unit = inside[..end].split(',').next().unwrap_or_default().trim();
            if !unit.is_empty() && unit.parse::<f64>().is_err() {
                return Some(unit);
            }
        }
        rest = &rest[..start];
    }
    None
}

/// The range of a number.
#[derive(Debug, Default, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    low: Option<(f64, bool)>,
    high: Option<(f64, bool)>,
    whole: bool,
}

impl Bounds {
    /// Whether `value` lies inside.
    pub fn holds(&self, value: f64) -> bool {
        let above = self.low.is_none_or(|(low, open)| if open { value > low } else { value >= low });
        let below = self.high.is_none_or(|(high, open)| if open { value < high } else { value <= high });
        above && below && (!self.whole || value.fract() == 0.0)
    }
}

/// The range that a schema states, or its integer type has.
pub(super) fn bounds(schema: &Json) -> Bounds {
    let limit = |closed: &str, open: &str| {
        let closed = schema.get(closed).and_then(Json::as_f64).map(|it| (it, false));
        closed.or_else(|| schema.get(open).and_then(Json::as_f64).map(|it| (it, true)))
    };
    let format = schema.get("format").and_then(Json::as_str).unwrap_or_default();
    let (least, most) = match format {
        "uint8" => (Some(0.0), Some(f64::from(u8::MAX))),
        "uint16" => (Some(0.0), Some(f64::from(u16::MAX))),
        "uint32" => (Some(0.0), Some(f64::from(u32::MAX))),
        "uint64" | "uint" => (Some(0.0), Some(i64::MAX as f64)),
        "int8" => (Some(f64::from(i8::MIN)), Some(f64::from(i8::MAX))),
        "int16" => (Some(f64::from(i16::MIN)), Some(f64::from(i16::MAX))),
        "int32" => (Some(f64::from(i32::MIN)), Some(f64::from(i32::MAX))),
        "int64" | "int" => (Some(i64::MIN as f64), Some(i64::MAX as f64)),
        _ => (None, None),
    };
    Bounds {
        low: limit("minimum", "exclusiveMinimum").or_else(|| least.map(|it| (it, false))),
        high: limit("maximum", "exclusiveMaximum").or_else(|| most.map(|it| (it, false))),
        whole: kinds(schema).contains(&"integer") && !kinds(schema).contains(&"number"),
    }
}

/// What `schema` wants, with its unit where its documentation states one.
pub(super) fn expectation(root: &Json, schema: &Json) -> String {
    let wanted = wanted(root, schema, 0);
    match description(schema).and_then(unit_of) {
        Some(unit) => format!("{wanted} [{unit}]"),
        None => wanted,
    }
}

fn wanted(root: &Json, schema: &Json, depth: usize) -> String {
    let schema = resolved(root, schema);
    if let Some(words) = words(root, schema) {
        return one_of(&words);
    }
    if let Some(choices) = alternatives(schema).filter(|it| !it.is_empty()) {
        let mut choices: Vec<String> = choices.iter().map(|it| wanted(root, it, depth + 1)).collect();
        choices.dedup();
        return choices.join(" or ");
    }
    let one = |kind: &str| match kind {
        "integer" => of_number("a whole number", schema),
        "number" => of_number("a number", schema),
        "string" => of_text(schema),
        "boolean" => "true or false".to_owned(),
        "array" => of_list(root, schema, depth),
        "object" => "a table".to_owned(),
        _ => "a value".to_owned(),
    };
    let kinds: Vec<&str> = kinds(schema).into_iter().filter(|it| *it != "null").collect();
    if kinds.is_empty() { "a value".to_owned() } else { kinds.into_iter().map(one).collect::<Vec<_>>().join(" or ") }
}

fn of_number(kind: &str, schema: &Json) -> String {
    // The end of an integer type is no news, save for the small ones.
    let near = |limit: Option<(f64, bool)>| limit.filter(|it| it.0.abs() < 2_147_483_647.0);
    let Bounds { low, high, .. } = bounds(schema);
    match (near(low), near(high)) {
        (None, None) => kind.to_owned(),
        (Some((low, false)), None) => format!("{kind}, at least {low}"),
        (Some((low, true)), None) => format!("{kind} above {low}"),
        (None, Some((high, false))) => format!("{kind}, at most {high}"),
        (None, Some((high, true))) => format!("{kind} below {high}"),
        (Some((low, false)), Some((high, false))) => format!("{kind} from {low} to {high}"),
        (Some((low, low_open)), Some((high, high_open))) => {
            let low_word = if low_open { "above" } else { "at least" };
            let high_word = if high_open { "below" } else { "at most" };
            format!("{kind} {low_word} {low} and {high_word} {high}")
        }
    }
}

fn of_text(schema: &Json) -> String {
    let limit = |key| schema.get(key).and_then(Json::as_u64);
    match (limit("minLength"), limit("maxLength")) {
        (Some(1), None) => "a text that is not empty".to_owned(),
        (Some(least), Some(most)) if least == most => format!("a text of {least} character{}", plural(least)),
        (Some(least), None) => format!("a text of at least {least} characters"),
        (None, Some(most)) => format!("a text of at most {most} characters"),
        (Some(least), Some(most)) => format!("a text of {least} to {most} characters"),
        (None, None) => "a text".to_owned(),
    }
}

fn of_list(root: &Json, schema: &Json, depth: usize) -> String {
    let limit = |key| schema.get(key).and_then(Json::as_u64);
    let items = schema.get("items").filter(|it| it.is_object() && depth < DEEPEST);
    let of = items.map_or_else(String::new, |it| format!(", each {}", wanted(root, it, depth + 1)));
    match (limit("minItems"), limit("maxItems")) {
        (Some(least), Some(most)) if least == most => format!("a list of {least} item{}{of}", plural(least)),
        (Some(least), Some(most)) => format!("a list of {least} to {most} items{of}"),
        (Some(least), None) => format!("a list of at least {least} item{}{of}", plural(least)),
        (None, Some(most)) => format!("a list of at most {most} item{}{of}", plural(most)),
        (None, None) => format!("a list{of}"),
    }
}

fn plural(count: u64) -> &'static str {
    if count == 1 { "" } else { "s" }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn unit_is_the_last_bracket_that_is_one() {
        assert_eq!(unit_of("Brighter than this [gray level, 0..=255]."), Some("gray level"));
        assert_eq!(unit_of("A fraction in [0, 1] of the [`Image`] [px]. Removes lamps."), Some("px"));
        assert_eq!(unit_of("See [`Image`]."), None);
        assert_eq!(unit_of("In [0, 1]."), None);
    }

    #[test]
    fn parts_are_refused_only_where_nothing_but_whole_numbers_will_do() {
        for (kind, holds_half) in [
            (json!("integer"), false),
            (json!(["integer", "null"]), false),
            (json!("number"), true),
            (json!(["integer", "number"]), true),
            (Json::Null, true),
        ] {
            let range = bounds(&json!({"type": kind, "minimum": 1}));
            assert_eq!((range.holds(1.5), range.holds(2.0), range.holds(0.0)), (holds_half, true, false), "{kind}");
        }
    }

    #[test]
    fn ranges_read_like_sentences() {
        let said = |schema: Json| expectation(&Json::Null, &schema);
        assert_eq!(said(json!({"type": "integer", "format": "uint8"})), "a whole number from 0 to 255");
        assert_eq!(said(json!({"type": "integer", "format": "uint64"})), "a whole number, at least 0");
        assert_eq!(
            said(json!({"type": ["number", "null"], "exclusiveMinimum": 0, "description": "x [s]."})),
            "a number above 0 [s]"
        );
        assert_eq!(said(json!({"enum": ["a", "b"]})), "\"a\" or \"b\"");
        let text = |least: Json, most: Json| said(json!({"type": "string", "minLength": least, "maxLength": most}));
        assert_eq!(text(json!(1), Json::Null), "a text that is not empty");
        assert_eq!(text(json!(3), json!(3)), "a text of 3 characters");
        assert_eq!(text(json!(2), Json::Null), "a text of at least 2 characters");
        assert_eq!(text(Json::Null, json!(9)), "a text of at most 9 characters");
        assert_eq!(text(json!(1), json!(9)), "a text of 1 to 9 characters");
        assert_eq!(text(Json::Null, Json::Null), "a text");
        let pair = json!({"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2});
        assert_eq!(said(pair), "a list of 2 items, each a number");
    }
}
