//! Reads TOML documents of calibrations: typed values, every fault with its line and column.

use std::ops::Range;
use std::path::Path;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{CalibrationDiagnostic, CalibrationError, sort_by_place};
use crate::text::place_of;

pub(crate) type Value<'i> = Spanned<DeValue<'i>>;

/// What `of` makes of the document `text`, unless anything is wrong with it; it is given the root table and its place.
pub(crate) fn read<T>(
    text: &str,
    path: &Path,
    of: impl FnOnce(&mut Reader<'_>, &DeTable<'_>, Range<usize>) -> T,
) -> Result<T, CalibrationError> {
    let mut reader = Reader { text, path, camera: None, faults: Vec::new() };
    let (document, errors) = DeTable::parse_recoverable(text);
    if let Some(first) = errors.first() {
        // What follows a first fault is mostly guesswork, and of a long file of another kind there are thousands.
        let more = if errors.len() > 1 { format!("; and {} more faults", errors.len() - 1) } else { String::new() };
        let at = first.span().unwrap_or(0..0);
        reader.report(at, format!("this is not TOML ({}{more})", first.message()), "a TOML file".into());
        return Err(reader.into_error());
    }
    let read = of(&mut reader, document.get_ref(), document.span());
    if reader.faults.is_empty() { Ok(read) } else { Err(reader.into_error()) }
}

/// One document being read: all faults are collected in `faults` and reported together.
pub(crate) struct Reader<'a> {
    /// The whole of it.
    pub text: &'a str,
    /// For the messages.
    pub path: &'a Path,
    /// The one being read, for the messages.
    pub camera: Option<String>,
    /// What was wrong so far.
    pub faults: Vec<CalibrationDiagnostic>,
}

impl Reader<'_> {
    /// Adds a fault of what stands at the byte range `at`.
    pub fn report(&mut self, at: Range<usize>, found: String, expected: String) {
        self.faults.push(CalibrationDiagnostic {
            file: self.path.to_owned(),
            place: Some(place_of(self.text, at.start)),
            camera: self.camera.clone(),
            found,
            expected,
        });
    }

    /// All faults, in the order of the file.
    pub fn into_error(mut self) -> CalibrationError {
        sort_by_place(&mut self.faults);
        CalibrationError { faults: self.faults }
    }

    /// The `N` finite numbers that `key` must hold; `at` is where its absence is reported.
    pub fn numbers<const N: usize>(&mut self, table: &DeTable<'_>, key: &str, at: Range<usize>) -> Option<[f64; N]> {
        let list = self.number_list(table, key, N, at)?;
        list.try_into().ok()
    }

    /// As [`Self::numbers`], for a length that is only known here.
    pub fn number_list(&mut self, table: &DeTable<'_>, key: &str, n: usize, at: Range<usize>) -> Option<Vec<f64>> {
        let expected = format!("{n} numbers");
        let value = self.required(table, key, &expected, at)?;
        let Some(list) = value.get_ref().as_array().filter(|list| list.len() == n) else {
            return self.expect(None, value, key, &expected);
        };
        let numbers: Vec<Option<f64>> =
            list.iter().enumerate().map(|(index, item)| self.number(item, &format!("{key}[{index}]"))).collect();
        numbers.into_iter().collect()
    }

    /// A finite number.
    pub fn number(&mut self, value: &Value<'_>, what: &str) -> Option<f64> {
        let number = match value.get_ref() {
            DeValue::Float(float) => float.as_str().parse().ok(),
            DeValue::Integer(integer) => {
                i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|it| it as f64)
            }
            _ => None,
        };
        self.expect(number.filter(|it: &f64| it.is_finite()), value, what, "a finite number")
    }

    /// What `key` must hold.
    pub fn required<'t, 'i>(
        &mut self,
        table: &'t DeTable<'i>,
        key: &str,
        expected: &str,
        at: Range<usize>,
    ) -> Option<&'t Value<'i>> {
        let value = table.get(key);
        if value.is_none() {
            self.report(at, format!("{key} is missing"), format!("{key} = {expected}"));
        }
        value
    }

    /// The table that `key` must hold, and where it stands.
    pub fn required_table<'t, 'i>(
        &mut self,
        table: &'t DeTable<'i>,
        key: &str,
        at: Range<usize>,
    ) -> Option<(&'t DeTable<'i>, Range<usize>)> {
        let value = self.required(table, key, "a table", at)?;
        let inner = value.get_ref().as_table().map(|inner| (inner, value.span()));
        self.expect(inner, value, key, "a table")
    }

    /// Passes `read` on, or reports that `value`, called `what`, is not what was `expected`.
    pub fn expect<T>(&mut self, read: Option<T>, value: &Value<'_>, what: &str, expected: &str) -> Option<T> {
        if read.is_none() {
            let mut source = self.text.get(value.span()).unwrap_or_default().to_owned();
            if source.chars().count() > 60 {
                source = source.chars().take(57).chain("...".chars()).collect();
            }
            self.report(value.span(), format!("{what} is {source}"), expected.to_owned());
        }
        read
    }

    /// Reports every key that is not `known`, with the one it looks like.
    pub fn refuse_unknown(&mut self, table: &DeTable<'_>, kind: &str, known: &[&str]) {
        for key in table.keys().filter(|key| !known.contains(&key.get_ref().as_ref())) {
            let name = key.get_ref();
            let likeness = |it: &&&str| (strsim::jaro_winkler(it, name) * 1e6) as u64;
            let close = known.iter().max_by_key(likeness).filter(|it| likeness(it) > 750_000);
            let expected = match close {
                Some(close) => format!("{close} (did you mean that?)"),
                None => format!("one of {}", known.join(", ")),
            };
            self.report(key.span(), format!("unknown {kind} {name:?}"), expected);
        }
    }
}
