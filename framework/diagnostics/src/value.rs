//! TOML values as the loader takes them: of the wanted kind, or a fault that says what stands there instead.

use toml::Spanned;
use toml::de::{DeInteger, DeTable, DeValue};

use crate::names::{did_you_mean, one_of, shown};
use crate::{Findings, Span};

/// A value with its place.
pub type Value<'t> = Spanned<DeValue<'t>>;

/// A value in words: "the text `abc`", "-1", "a list".
pub fn described(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("the text `{}`", shown(text)),
        DeValue::Integer(number) => shown(number),
        DeValue::Float(number) => shown(number),
        DeValue::Boolean(flag) => flag.to_string(),
        DeValue::Datetime(date) => format!("the date {date}"),
        DeValue::Array(_) => "a list".to_owned(),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

/// A whole number, exact.
pub fn whole(number: &DeInteger<'_>) -> Option<i128> {
    i128::from_str_radix(number.as_str(), number.radix()).ok()
}

/// A number, whole or not.
pub fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Integer(it) => whole(it).map(|it| it as f64),
        DeValue::Float(it) => it.as_str().parse().ok(),
        _ => None,
    }
}

impl Findings {
    /// The fault of a value that is not what its key wants.
    pub fn not_as_expected(&mut self, key: &str, value: &Value<'_>, expected: &str) {
        let found = described(value.get_ref());
        self.error(
            value.span(),
            format_args!("`{}` is {found}", shown(&key)),
            format_args!("found {found}, expected {expected}"),
        );
    }

    /// A text.
    pub fn text(&mut self, key: &str, value: Value<'_>, expected: &str) -> Option<Spanned<String>> {
        match value.get_ref() {
            DeValue::String(text) => Some(Spanned::new(value.span(), text.clone().into_owned())),
            _ => {
                self.not_as_expected(key, &value, expected);
                None
            }
        }
    }

    /// A number for which `holds`.
    pub fn number(&mut self, key: &str, value: &Value<'_>, expected: &str, holds: impl Fn(f64) -> bool) -> Option<f64> {
        let found = number(value.get_ref()).filter(|it| holds(*it));
        if found.is_none() {
            self.not_as_expected(key, value, expected);
        }
        found
    }

    /// A whole number from `low` to `high`.
    pub fn whole(&mut self, key: &str, value: &Value<'_>, low: i64, high: i64) -> Option<i64> {
        let found = value.get_ref().as_integer().and_then(whole);
        let found = found.and_then(|it| i64::try_from(it).ok()).filter(|it| (low..=high).contains(it));
        if found.is_none() {
            self.not_as_expected(key, value, &format!("a whole number from {low} to {high}"));
        }
        found
    }

    /// True or false.
    pub fn flag(&mut self, key: &str, value: &Value<'_>) -> Option<bool> {
        let found = value.get_ref().as_bool();
        if found.is_none() {
            self.not_as_expected(key, value, "true or false");
        }
        found
    }

    /// One of a few words.
    pub fn choice<T: Copy>(&mut self, key: &str, value: &Value<'_>, choices: &[(&str, T)]) -> Option<T> {
        let found = value.get_ref().as_str();
        let choice = choices.iter().find(|it| Some(it.0) == found);
        if choice.is_none() {
            let words: Vec<&str> = choices.iter().map(|it| it.0).collect();
            self.not_as_expected(key, value, &one_of(&words));
            if let (Some(found), Some(fault)) = (found, self.last()) {
                fault.maybe_help(
                    crate::names::likely(found, choices.iter().map(|it| it.0))
                        .map(|it| format!("did you mean \"{it}\"?")),
                );
            }
        }
        choice.map(|it| it.1)
    }

    /// A table, ready to be taken apart.
    pub fn table<'t>(
        &mut self,
        key: &Spanned<impl AsRef<str>>,
        value: Value<'t>,
        text: &str,
        expected: &str,
    ) -> Option<Keys<'t>> {
        let span = value.span();
        // A header or a dotted key is a good place to point at, a whole inline table is not.
        let header = if text.get(span.clone()).is_some_and(|it| it.starts_with('{')) { key.span() } else { span };
        match value.get_ref() {
            DeValue::Table(_) => {}
            _ => {
                self.not_as_expected(key.get_ref().as_ref(), &value, expected);
                return None;
            }
        }
        match value.into_inner() {
            DeValue::Table(table) => Some(Keys { table, header, known: Vec::new() }),
            _ => None,
        }
    }
}

/// A table that is read key by key; every key left over at the end is a fault.
pub struct Keys<'t> {
    /// What is left of it.
    pub table: DeTable<'t>,
    /// Where to point when the table as a whole is meant.
    pub header: Span,
    known: Vec<&'static str>,
}

impl<'t> Keys<'t> {
    /// A table with its place.
    pub fn new(table: DeTable<'t>, header: Span) -> Self {
        Self { table, header, known: Vec::new() }
    }

    /// The value of `key`, which from now on is known.
    pub fn take(&mut self, key: &'static str) -> Option<Value<'t>> {
        self.take_entry(key).map(|it| it.1)
    }

    /// The value of `key` and the key itself.
    pub fn take_entry(&mut self, key: &'static str) -> Option<(Spanned<String>, Value<'t>)> {
        self.known.push(key);
        let (key, value) = self.table.remove_entry(key)?;
        Some((Spanned::new(key.span(), key.into_inner().into_owned()), value))
    }

    /// All that is left, in the order of the text.
    pub fn take_rest(&mut self) -> Vec<(Spanned<String>, Value<'t>)> {
        let rest = std::mem::take(&mut self.table);
        let mut rest: Vec<_> = rest
            .into_iter()
            .map(|(key, value)| (Spanned::new(key.span(), key.into_inner().into_owned()), value))
            .collect();
        rest.sort_by_key(|it| it.0.span().start);
        rest
    }

    /// Refuses the key `old`, which is called `now` today.
    pub fn renamed(&mut self, old: &str, now: &'static str, findings: &mut Findings) {
        if let Some((key, _)) = self.table.remove_entry(old) {
            findings.error(
                key.span(),
                format_args!("the key `{old}` is now called `{now}`"),
                format_args!("found the old name, expected `{now}`"),
            );
        }
    }

    /// Whatever is left is a fault; `place` names the table: "`[rig]`".
    pub fn close(mut self, place: &str, findings: &mut Findings) {
        let known = std::mem::take(&mut self.known);
        for (key, _) in self.take_rest() {
            let name = key.get_ref();
            findings
                .error(key.span(), format_args!("unknown key `{}` in {place}", shown(name)), "nothing reads this")
                .help(did_you_mean(name, "keys that may stand here", known.iter().copied()));
        }
    }
}
