//! A node's settings against the JSON Schema of its type, walked with the places of the text, so that every fault of
//! every setting is found at once. Decoding alone would stop at the first.
//!
//! Knows what derived schemas hold: local `$ref`, `type`, `properties`, `required`, `additionalProperties`, `items`,
//! `prefixItems`, `minItems`, `maxItems`, `minimum`, `maximum` and their exclusive forms, `minLength`, `maxLength`,
//! `enum`, `const`, `anyOf`, `oneOf`, `allOf`. What else a schema may say is left to decoding.

use serde_json::Value as Json;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::expected::{bounds, expectation, unit_of};
use super::grammar;
use super::schema_parts::{alternatives, collect_properties, description, kinds, resolved, words};
use foveate_diagnostics::names::{did_you_mean, likely, one_of, shown};
use foveate_diagnostics::value::{Value, described, number, whole};
use foveate_diagnostics::{Findings, Span};

/// Depth at which a schema that holds itself is no longer followed.
const DEEPEST: usize = 200;

/// Checks the `settings` of a node of type `type_name`; `header` is where the node as a whole stands.
pub(super) fn check(schema: &Json, type_name: &str, settings: &DeTable<'_>, header: Span, findings: &mut Findings) {
    let mut walk = Walk { root: schema, owner: format!("`{type_name}`"), findings };
    walk.table(schema, "", settings, header, 0);
}

struct Walk<'s, 'f> {
    root: &'s Json,
    /// Owner of the settings, for messages.
    owner: String,
    findings: &'f mut Findings,
}

impl<'s> Walk<'s, '_> {
    fn table(&mut self, schema: &'s Json, path: &str, table: &DeTable<'_>, header: Span, depth: usize) {
        if depth > DEEPEST {
            return;
        }
        let mut known = Vec::new();
        let mut open = false;
        collect_properties(self.root, schema, &mut known, &mut open, 0);
        let other = schema.get("additionalProperties").or_else(|| schema.get("unevaluatedProperties"));
        for (key, value) in in_order(table) {
            let name = key.get_ref().as_ref();
            let full = if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
            if let Some(property) = schema.get("properties").and_then(|it| it.get(name)) {
                self.value(property, &full, value, depth + 1);
            } else if known.iter().any(|it| it.0 == name) {
                // Stands in an `allOf` or alternative, which is checked below.
            } else if let Some(other) = other.filter(|it| it.is_object()) {
                self.value(other, &full, value, depth + 1);
            } else if let Some((now, _)) =
                known.iter().find(|it| formerly(it.1).is_some_and(|old| old.as_str() == Some(name)))
            {
                self.findings.error(
                    key.span(),
                    format_args!("the setting `{}` is now called `{now}`", shown(&name)),
                    format_args!("found the old name, expected `{now}`"),
                );
            } else if !open {
                let reserved = likely(name, grammar::node::ALL.map(|it| it.name)).filter(|_| path.is_empty());
                let help = match (likely(name, known.iter().map(|it| it.0)), reserved) {
                    (None, Some(word)) => format!("did you mean `{word}`?"),
                    _ => did_you_mean(name, "its settings", known.iter().map(|it| it.0)),
                };
                let owner = if path.is_empty() { self.owner.clone() } else { format!("`{path}`") };
                self.findings
                    .error(
                        key.span(),
                        format_args!("{owner} has no setting `{}`", shown(&name)),
                        "found a setting that nothing reads",
                    )
                    .help(help);
            }
        }
        for name in schema.get("required").and_then(Json::as_array).into_iter().flatten().filter_map(Json::as_str) {
            if !table.contains_key(name) {
                let property = known.iter().find(|it| it.0 == name).map(|it| it.1);
                let owner = if path.is_empty() { self.owner.clone() } else { format!("`{path}`") };
                let expected = property.map_or_else(String::new, |it| format!(": {}", expectation(self.root, it)));
                let fault = self.findings.error(
                    header.clone(),
                    format_args!("{owner} lacks the setting `{name}`"),
                    format_args!("expected `{name}` here{expected}"),
                );
                fault.maybe_help(property.and_then(description).map(|it| format!("{name}: {}", first_paragraph(it))));
            }
        }
        for part in schema.get("allOf").and_then(Json::as_array).into_iter().flatten() {
            self.part(resolved(self.root, part), path, table, &header, depth + 1);
        }
        if let Some(choices) = alternatives(schema).filter(|it| self.tag_fits(it, path, table, &header)) {
            let choices = fitting(self.root, &choices, table);
            let best = self.best(&choices, |walk, it| walk.part(it, path, table, &header, depth + 1));
            self.findings.append(best);
        }
    }

    /// Whether `table` has one of the tags that tell `choices` apart, where they have tags; reported where not.
    fn tag_fits(&mut self, choices: &[&'s Json], path: &str, table: &DeTable<'_>, header: &Span) -> bool {
        let Some((key, tags)) = tags(self.root, choices) else { return true };
        let full = if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
        match table.get(key) {
            Some(value) => {
                let before = self.findings.count();
                self.word(&tags, None, &full, value);
                self.findings.count() == before
            }
            None => {
                let title = format!("`{full}` is left out");
                self.findings.error(header.clone(), title, format_args!("expected `{key}` here: {}", one_of(&tags)));
                false
            }
        }
    }

    /// One part of a table whose other keys belong to other parts.
    fn part(&mut self, schema: &'s Json, path: &str, table: &DeTable<'_>, header: &Span, depth: usize) {
        let mut mine = Vec::new();
        collect_properties(self.root, schema, &mut mine, &mut false, 0);
        let is_mine = |key: &str| mine.iter().any(|it| it.0 == key);
        let entries = table.iter().filter(|it| is_mine(it.0.get_ref().as_ref()));
        let part: DeTable<'_> = entries.map(|(key, value)| (key.clone(), value.clone())).collect();
        self.table(schema, path, &part, header.clone(), depth);
    }

    fn value(&mut self, schema: &'s Json, path: &str, value: &Value<'_>, depth: usize) {
        let before = self.findings.count();
        self.undocumented_value(schema, path, value, depth);
        // The field's own words say more than its type's.
        let words = description(schema).or_else(|| description(resolved(self.root, schema)));
        let unit = description(schema).and_then(unit_of);
        for fault in self.findings.since(before).iter_mut().filter(|it| it.span == value.span() && it.help.is_none()) {
            fault.maybe_help(words.map(|it| format!("{path}: {}", first_paragraph(it))));
            if let Some(unit) = unit.filter(|it| !fault.label.contains(&format!("[{it}]"))) {
                fault.label.push_str(&format!(" [{unit}]"));
            }
        }
    }

    fn undocumented_value(&mut self, schema: &'s Json, path: &str, value: &Value<'_>, depth: usize) {
        if depth > DEEPEST {
            return;
        }
        let schema = resolved(self.root, schema);
        if let Some(words) = words(self.root, schema) {
            self.word(&words, formerly(schema), path, value);
            return;
        }
        let Some(mut choices) = alternatives(schema) else {
            self.plain(schema, path, value, depth);
            return;
        };
        if let DeValue::Table(table) = value.get_ref() {
            if !self.tag_fits(&choices, path, table, &value.span()) {
                return;
            }
            choices = fitting(self.root, &choices, table);
        } else {
            let is_table = |it: &&Json| resolved(self.root, it).get("properties").is_some();
            if !choices.iter().all(is_table) {
                choices.retain(|it| !is_table(it));
            }
        }
        let best = self.best(&choices, |walk, it| walk.undocumented_value(it, path, value, depth + 1));
        self.findings.append(best);
    }

    /// The faults of the alternative that has the fewest; none if one of them fits.
    fn best(&mut self, choices: &[&'s Json], mut check: impl FnMut(&mut Walk<'s, '_>, &'s Json)) -> Findings {
        let mut best: Option<Findings> = None;
        for choice in choices {
            let mut findings = Findings::default();
            let mut walk = Walk { root: self.root, owner: self.owner.clone(), findings: &mut findings };
            check(&mut walk, resolved(self.root, choice));
            if best.as_ref().is_none_or(|it| findings.count() < it.count()) {
                best = Some(findings);
            }
        }
        best.unwrap_or_default()
    }

    fn word(&mut self, words: &[&str], renamed: Option<&Json>, path: &str, value: &Value<'_>) {
        let found = value.get_ref().as_str();
        if found.is_some_and(|it| words.contains(&it)) {
            return;
        }
        self.findings.not_as_expected(path, value, &one_of(words));
        if let (Some(now), Some(fault)) = (found.and_then(|it| renamed?.get(it)?.as_str()), self.findings.last()) {
            fault.help(format_args!("\"{}\" is now called \"{now}\"", found.unwrap_or_default()));
            return;
        }
        let meant = found.and_then(|it| likely(it, words.iter().copied()));
        if let (Some(meant), Some(fault)) = (meant, self.findings.last()) {
            fault.help(format_args!("did you mean \"{meant}\"?"));
        }
    }

    fn plain(&mut self, schema: &'s Json, path: &str, value: &Value<'_>, depth: usize) {
        let allowed = kinds(schema);
        let fits = |kind: &str| allowed.is_empty() || allowed.contains(&kind);
        let kind_fits = match value.get_ref() {
            DeValue::String(_) => fits("string"),
            DeValue::Integer(it) => (fits("integer") || fits("number")) && whole(it).is_some(),
            DeValue::Float(_) => fits("number"),
            DeValue::Boolean(_) => fits("boolean"),
            DeValue::Datetime(_) => allowed.is_empty() || fits("object") && schema.get("properties").is_none(),
            DeValue::Array(_) => fits("array"),
            DeValue::Table(_) => fits("object"),
        };
        if !kind_fits {
            self.findings.not_as_expected(path, value, &expectation(self.root, schema));
            return;
        }
        match value.get_ref() {
            DeValue::Integer(_) | DeValue::Float(_) => self.range(schema, path, value),
            DeValue::String(text) => {
                let length = text.chars().count() as u64;
                let limit = |key| schema.get(key).and_then(Json::as_u64);
                let too_short = limit("minLength").is_some_and(|it| length < it);
                if too_short || limit("maxLength").is_some_and(|it| length > it) {
                    self.findings.not_as_expected(path, value, &expectation(self.root, schema));
                }
            }
            DeValue::Array(items) => {
                let count = items.len() as u64;
                let limit = |key| schema.get(key).and_then(Json::as_u64);
                let too_few = limit("minItems").is_some_and(|it| count < it);
                if too_few || limit("maxItems").is_some_and(|it| count > it) {
                    let expected = expectation(self.root, schema);
                    self.findings.error(
                        value.span(),
                        format_args!("`{path}` has {count} item{}", if count == 1 { "" } else { "s" }),
                        format_args!("found {count}, expected {expected}"),
                    );
                }
                let first = schema.get("prefixItems").and_then(Json::as_array);
                for (index, item) in items.iter().enumerate() {
                    let of_item = first.and_then(|it| it.get(index)).or_else(|| schema.get("items"));
                    if let Some(of_item) = of_item.filter(|it| it.is_object()) {
                        self.value(of_item, &format!("{path}.{index}"), item, depth + 1);
                    }
                }
            }
            DeValue::Table(table) => self.table(schema, path, table, value.span(), depth + 1),
            DeValue::Boolean(_) | DeValue::Datetime(_) => {}
        }
    }

    fn range(&mut self, schema: &Json, path: &str, value: &Value<'_>) {
        let range = bounds(schema);
        let outside = match (number(value.get_ref()), value.get_ref()) {
            (Some(found), DeValue::Integer(it)) => whole(it).is_none() || !range.holds(found),
            (Some(found), _) => found.is_nan() || !range.holds(found),
            (None, _) => true,
        };
        if outside {
            let found = described(value.get_ref());
            let expected = expectation(self.root, schema);
            self.findings.error(
                value.span(),
                format_args!("`{path}` is out of range"),
                format_args!("found {found}, expected {expected}"),
            );
        }
    }
}

/// What `schema` was called before: of a setting its old name, of a choice a table from its old words to the new ones.
fn formerly(schema: &Json) -> Option<&Json> {
    schema.get("x-formerly")
}

/// The key whose word tells `choices` apart, and the words.
fn tags<'s>(root: &'s Json, choices: &[&'s Json]) -> Option<(&'s str, Vec<&'s str>)> {
    let tag = |choice: &'s Json| {
        let properties = resolved(root, choice).get("properties")?.as_object()?;
        properties.iter().find_map(|(key, it)| Some((key.as_str(), it.get("const")?.as_str()?)))
    };
    let (key, _) = tag(choices.first()?)?;
    let tags: Option<Vec<_>> = choices.iter().map(|it| tag(it).filter(|it| it.0 == key).map(|it| it.1)).collect();
    Some((key, tags?))
}

/// The alternatives whose tag or key the table has, if any; otherwise all.
fn fitting<'s>(root: &'s Json, choices: &[&'s Json], table: &DeTable<'_>) -> Vec<&'s Json> {
    let tagged = |choice: &&&Json| {
        let schema = resolved(root, choice);
        let Some(properties) = schema.get("properties").and_then(Json::as_object) else { return false };
        let required = schema.get("required").and_then(Json::as_array);
        let tags: Vec<_> = properties.iter().filter(|it| it.1.get("const").is_some()).collect();
        if tags.is_empty() {
            return required.is_some_and(|it| it.iter().filter_map(Json::as_str).any(|key| table.contains_key(key)));
        }
        tags.iter().all(|(key, tag)| {
            let found = table.get(key.as_str()).and_then(|it| it.get_ref().as_str());
            found.is_some() && found == tag.get("const").and_then(Json::as_str)
        })
    };
    let fitting: Vec<_> = choices.iter().filter(tagged).copied().collect();
    if fitting.is_empty() { choices.to_vec() } else { fitting }
}

/// The first paragraph of a documentation on one line.
fn first_paragraph(text: &str) -> String {
    let first = text.split("\n\n").next().unwrap_or_default();
    first.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A table's entries in the order of the text.
fn in_order<'a, 't>(table: &'a DeTable<'t>) -> Vec<(&'a Spanned<std::borrow::Cow<'t, str>>, &'a Value<'t>)> {
    let mut entries: Vec<_> = table.iter().collect();
    entries.sort_by_key(|it| it.0.span().start);
    entries
}

/// Where the setting of that name stands, as `mask.radius_px`, `users.1.period_ms` or `users[1].period_ms`; `None` when it or what holds it is left out.
pub(super) fn place_of(settings: &DeTable<'_>, dotted: &str) -> Option<Span> {
    let mut names = dotted.split(['.', '[', ']']).filter(|it| !it.is_empty());
    let mut value = settings.get(names.next()?)?;
    for name in names {
        let inner = match value.get_ref() {
            DeValue::Table(table) => table.get(name),
            DeValue::Array(list) => name.parse().ok().and_then(|index: usize| list.get(index)),
            _ => None,
        };
        value = match inner {
            Some(inner) => inner,
            None => break,
        };
    }
    Some(value.span())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_in_a_list_is_found_and_one_that_is_left_out_is_not() {
        let text =
            "users = [{ user = 1 }, { user = 2, period_ms = 400 }]\nto = [\"a\", \"b\"]\nmask = { radius_px = 2 }";
        let settings = DeTable::parse(text).unwrap().into_inner();
        let found = |name: &str| place_of(&settings, name).map(|it| &text[it]);
        assert_eq!(found("users[1].period_ms"), Some("400"));
        assert_eq!(found("users.1.period_ms"), Some("400"));
        assert_eq!(found("users[1]"), Some("{ user = 2, period_ms = 400 }"));
        assert_eq!(found("to[1]"), Some("\"b\""));
        assert_eq!(found("mask.radius_px"), Some("2"));
        // What holds it stands there.
        assert_eq!(found("users[0].period_ms"), Some("{ user = 1 }"));
        assert_eq!(found("dark_ms"), None);
    }
}
