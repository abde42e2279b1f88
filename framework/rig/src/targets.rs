//! Named targets of a scale, `[scale.NAME.target.TARGET]`: which of its targets carries that name.

use std::fmt::Write;

use foveate_scene::{AnchorRule, Pick};
use nalgebra::{Point3, Vector3};
use serde_json::Value as Json;
use toml::Spanned;

use super::grammar::target::{self as grammar, NS_PER_MS, NS_PER_S, PICKS, Word};
use super::grammar::{Key, table};
use super::values::{plain_name, read_point};
use foveate_diagnostics::Findings;
use foveate_diagnostics::value::{Keys, Value};

/// A name and the rule that picks the target that carries it.
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
    rule.offset = grammar::OFFSET_M.point(&mut keys, findings).map_or(rule.offset, Vector3::from);
    rule.keep = grammar::KEEP.flag(&mut keys, findings).unwrap_or(rule.keep);
    let has_within = keys.table.contains_key(grammar::AGAIN_WITHIN_M.name);
    let settle_ms = grammar::SETTLE_MS.number(&mut keys, findings);
    let lost_ms = grammar::LOST_MS.number(&mut keys, findings);
    let within = grammar::AGAIN_WITHIN_M.number(&mut keys, findings);
    let again_s = grammar::AGAIN_S.number(&mut keys, findings);
    let in_ns = |given: &Option<(f64, _)>, unit: f64| Some((given.as_ref()?.0 * unit).round() as i64);
    rule.settle_ns = in_ns(&settle_ms, NS_PER_MS).unwrap_or(rule.settle_ns);
    rule.lost_ns = in_ns(&lost_ms, NS_PER_MS).unwrap_or(rule.lost_ns);
    rule.again_ns = in_ns(&again_s, NS_PER_S).unwrap_or(rule.again_ns);
    if let (Some((_, place)), false) = (&again_s, has_within) {
        findings
            .error(place.clone(), "`again_s` says how long `again_within_m` holds", "found no `again_within_m`")
            .help("add `again_within_m`, or leave `again_s` out");
    }
    rule.again_within = within.map(|it| it.0);
    keys.close("a named target", findings);
    Some(rule)
}

fn read_pick(keys: &mut Keys<'_>, findings: &mut Findings) -> Pick {
    let pick = keys.take(grammar::PICK.name);
    let word = match &pick {
        Some(value) => findings.choice("pick", value, &PICKS),
        None => Some(Word::First),
    };
    let near_m = keys.take(grammar::NEAR_M.name);
    let place = near_m.as_ref().and_then(|it| read_point("near_m", it, findings)).map(Point3::from);
    let id = keys.take(grammar::ID.name);
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
    let line = |text: &mut String, key: Key, value: toml::Value| {
        let _ = writeln!(text, "{} = {value}", key.name); // a text takes all
    };
    line(text, grammar::PICK, word.into());
    match rule.pick {
        Pick::Nearest(place) => line(text, grammar::NEAR_M, point(place.into())),
        Pick::Id(id) => line(text, grammar::ID, i64::from(id).into()),
        Pick::First | Pick::Highest | Pick::Lowest => {}
    }
    line(text, grammar::OFFSET_M, point(rule.offset.into()));
    line(text, grammar::KEEP, rule.keep.into());
    line(text, grammar::SETTLE_MS, (rule.settle_ns as f64 / NS_PER_MS).into());
    line(text, grammar::LOST_MS, (rule.lost_ns as f64 / NS_PER_MS).into());
    if let Some(within) = rule.again_within {
        line(text, grammar::AGAIN_WITHIN_M, within.into());
        line(text, grammar::AGAIN_S, (rule.again_ns as f64 / NS_PER_S).into());
    }
}

/// JSON Schema of a named target.
pub(super) fn schema() -> Json {
    let description = "Which of the scale's targets carries this name, so that a scale can be anchored to it.";
    table(description, &grammar::ALL, &[])
}
