//! Named targets of a scale, `[scale.NAME.target.TARGET]`: which of its targets carries that name.

use std::fmt::Write;

use foveate_scene::{AnchorRule, Pick};
use nalgebra::{Point3, Vector3};
use serde_json::{Value as Json, json};
use toml::Spanned;

use super::read::{plain_name, read_point};
use foveate_diagnostics::Findings;
use foveate_diagnostics::value::{Keys, Value};

const NS_PER_MS: f64 = 1e6;
const NS_PER_S: f64 = 1e9;

/// Longest time that a target has to last, or may be unseen [ms].
const LONGEST_MS: f64 = 3_600_000.0;
/// Longest time of looking near the place of a loss [s].
const LONGEST_S: f64 = 3_600.0;

/// A word of `pick`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Word {
    First,
    Highest,
    Lowest,
    Nearest,
    Id,
}

const PICKS: [(&str, Word); 5] = [
    ("first", Word::First),
    ("highest", Word::Highest),
    ("lowest", Word::Lowest),
    ("nearest", Word::Nearest),
    ("id", Word::Id),
];

/// A name and the rule that says who carries it.
#[derive(Debug, Clone)]
pub(super) struct NamedTarget {
    pub name: Spanned<String>,
    pub rule: AnchorRule,
}

/// Reads all named targets of a scale, in the order of the text.
pub(super) fn read(scale: &mut Keys<'_>, text: &str, findings: &mut Findings) -> Vec<NamedTarget> {
    let Some((key, value)) = scale.take_entry("target") else { return Vec::new() };
    let tables = findings.table(&key, value, text, "tables `[scale.NAME.target.TARGET]`");
    let mut targets = Vec::new();
    for (name, value) in tables.map(|mut it| it.take_rest()).unwrap_or_default() {
        plain_name("target", &name, findings);
        if let Some(rule) = read_rule(&name, value, text, findings) {
            targets.push(NamedTarget { name, rule });
        }
    }
    targets
}

fn read_rule(name: &Spanned<String>, value: Value<'_>, text: &str, findings: &mut Findings) -> Option<AnchorRule> {
    let mut keys = findings.table(name, value, text, "a table `[scale.NAME.target.TARGET]`")?;
    let mut rule = AnchorRule { pick: read_pick(&mut keys, findings), ..AnchorRule::default() };
    if let Some(value) = keys.take("offset_m") {
        rule.offset = read_point("offset_m", &value, findings).map_or(rule.offset, Vector3::from);
    }
    if let Some(value) = keys.take("keep") {
        rule.keep = findings.flag("keep", &value).unwrap_or(rule.keep);
    }
    let mut number = |key: &'static str, expected: String, holds: fn(f64) -> bool| {
        let value = keys.take(key)?;
        Some((findings.number(key, &value, &expected, holds), value.span()))
    };
    let settle_ms = number("settle_ms", format!("0 to {LONGEST_MS} [ms]"), |it| (0.0..=LONGEST_MS).contains(&it));
    let lost_ms = number("lost_ms", format!("1 to {LONGEST_MS} [ms]"), |it| (1.0..=LONGEST_MS).contains(&it));
    let within = number("again_within_m", "more than 0 [m]".to_owned(), |it| it > 0.0 && it.is_finite());
    let again_s = number("again_s", format!("0.001 to {LONGEST_S} [s]"), |it| (0.001..=LONGEST_S).contains(&it));
    let in_ns = |given: &Option<(Option<f64>, _)>, unit: f64| Some((given.as_ref()?.0? * unit).round() as i64);
    rule.settle_ns = in_ns(&settle_ms, NS_PER_MS).unwrap_or(rule.settle_ns);
    rule.lost_ns = in_ns(&lost_ms, NS_PER_MS).unwrap_or(rule.lost_ns);
    rule.again_ns = in_ns(&again_s, NS_PER_S).unwrap_or(rule.again_ns);
    if let (Some((_, place)), None) = (&again_s, &within) {
        findings
            .error(place.clone(), "`again_s` says how long `again_within_m` holds", "found no `again_within_m`")
            .help("add `again_within_m`, or leave `again_s` out");
    }
    rule.again_within = within.and_then(|it| it.0);
    keys.close("a named target", findings);
    Some(rule)
}

fn read_pick(keys: &mut Keys<'_>, findings: &mut Findings) -> Pick {
    let pick = keys.take("pick");
    let word = match &pick {
        Some(value) => findings.choice("pick", value, &PICKS),
        None => Some(Word::First),
    };
    let near_m = keys.take("near_m");
    let place = near_m.as_ref().and_then(|it| read_point("near_m", it, findings)).map(Point3::from);
    let id = keys.take("id");
    let number = id.as_ref().and_then(|it| findings.whole("id", it, 0, u32::MAX.into()));
    let number = number.and_then(|it| u32::try_from(it).ok());
    let Some(word) = word else { return Pick::First };
    for (value, key, of, owner) in [(&near_m, "near_m", Word::Nearest, "nearest"), (&id, "id", Word::Id, "id")] {
        match (value, word == of) {
            (Some(value), false) => {
                let title = format!("`{key}` goes with `pick = \"{owner}\"`");
                findings.error(value.span(), title, format_args!("found `{key}` with another `pick`"));
            }
            (None, true) => {
                let place = pick.as_ref().map_or(keys.header.clone(), Spanned::span);
                let title = format!("`pick = \"{owner}\"` needs `{key}`");
                let label = match of {
                    Word::Nearest => "expected `near_m = [x, y, z]` [m] beside it",
                    _ => "expected `id`, the number of a target, beside it",
                };
                findings.error(place, title, label);
            }
            _ => {}
        }
    }
    match word {
        Word::First => Pick::First,
        Word::Highest => Pick::Highest,
        Word::Lowest => Pick::Lowest,
        Word::Nearest => place.map_or(Pick::First, Pick::Nearest),
        Word::Id => number.map_or(Pick::First, Pick::Id),
    }
}

/// All keys of a named target, for the resolved rig; numbers are written so that they read back exactly.
pub(super) fn write(text: &mut String, rule: &AnchorRule) {
    let word = match rule.pick {
        Pick::First => Word::First,
        Pick::Highest => Word::Highest,
        Pick::Lowest => Word::Lowest,
        Pick::Nearest(_) => Word::Nearest,
        Pick::Id(_) => Word::Id,
    };
    let word = PICKS.iter().find(|it| it.1 == word).map_or("first", |it| it.0);
    let point = |[x, y, z]: [f64; 3]| toml::Value::from(vec![x, y, z]);
    let number = toml::Value::from;
    let _ = writeln!(text, "pick = \"{word}\"");
    match rule.pick {
        Pick::Nearest(place) => drop(writeln!(text, "near_m = {}", point(place.into()))),
        Pick::Id(id) => drop(writeln!(text, "id = {id}")),
        Pick::First | Pick::Highest | Pick::Lowest => {}
    }
    let _ = writeln!(text, "offset_m = {}", point(rule.offset.into()));
    let _ = writeln!(text, "keep = {}", rule.keep);
    let _ = writeln!(text, "settle_ms = {}", number(rule.settle_ns as f64 / NS_PER_MS));
    let _ = writeln!(text, "lost_ms = {}", number(rule.lost_ns as f64 / NS_PER_MS));
    if let Some(within) = rule.again_within {
        let _ = writeln!(text, "again_within_m = {}", number(within));
        let _ = writeln!(text, "again_s = {}", number(rule.again_ns as f64 / NS_PER_S));
    }
}

/// JSON Schema of a named target.
pub(super) fn schema() -> Json {
    let rule = AnchorRule::default();
    let (settle_ms, lost_ms) = (rule.settle_ns as f64 / NS_PER_MS, rule.lost_ns as f64 / NS_PER_MS);
    let again_s = rule.again_ns as f64 / NS_PER_S;
    json!({
        "description": "Which of the scale's targets carries this name, so that a scale can be anchored to it.",
        "type": "object",
        "properties": {
            "pick": {
                "description": "The one of smallest identity, of greatest or smallest z, the nearest to `near_m`, or the one numbered `id`.",
                "enum": PICKS.map(|it| it.0).to_vec(),
                "default": "first"
            },
            "near_m": {
                "description": "With `pick = \"nearest\"`: nearest to this place in the scale's space [m].",
                "type": "array", "items": { "type": "number" }, "minItems": 3, "maxItems": 3
            },
            "id": {
                "description": "With `pick = \"id\"`: the number of the target.",
                "type": "integer", "minimum": 0, "maximum": u32::MAX
            },
            "offset_m": {
                "description": "From the target to what is meant, in the axes of the scale's space [m]: a face lies below a light on the head.",
                "type": "array", "items": { "type": "number" }, "minItems": 3, "maxItems": 3, "default": [0.0, 0.0, 0.0]
            },
            "keep": {
                "description": "Whether the name stays with its target as long as that lives; else it goes over to whichever has become the choice.",
                "type": "boolean", "default": rule.keep
            },
            "settle_ms": {
                "description": "A target gets the name once it has been the choice for so long: no accident of a moment does [ms].",
                "type": "number", "minimum": 0, "maximum": LONGEST_MS, "default": settle_ms
            },
            "lost_ms": {
                "description": "A target that was not measured for longer than this is lost [ms].",
                "type": "number", "minimum": 1, "maximum": LONGEST_MS, "default": lost_ms
            },
            "again_within_m": {
                "description": "After a loss, only targets so near to where it was last are picked, for `again_s`, the nearest first; left out: anywhere, by `pick` [m].",
                "type": "number", "exclusiveMinimum": 0
            },
            "again_s": {
                "description": "How long `again_within_m` holds after a loss [s].",
                "type": "number", "minimum": 0.001, "maximum": LONGEST_S, "default": again_s
            }
        },
        "additionalProperties": false
    })
}
