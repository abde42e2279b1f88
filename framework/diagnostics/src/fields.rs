//! Fields of tables of text: lines parted by the `csv` crate, and text quoted for one.
//!
//! A quoted field ends with its line at the latest. A quote that is not closed, as files have that were cut or typed by hand, then costs its own row and not
//! those behind it, and each row has the number of its line.

use std::borrow::Cow;
use std::fmt;
use std::io::{Cursor, SeekFrom};

use csv::{Position, Reader, ReaderBuilder, StringRecord, Terminator, WriterBuilder};

/// Parts lines into fields; keeps its memory from line to line.
#[derive(Debug)]
pub struct Splitter {
    separator: char,
    reader: Reader<Cursor<Vec<u8>>>,
    fields: Fields,
}

/// The fields of a line.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Fields(StringRecord);

impl Splitter {
    /// Of tables with this ASCII character between their fields.
    #[must_use]
    pub fn new(separator: char) -> Self {
        debug_assert!(separator.is_ascii(), "{separator:?} between fields");
        let mut builder = ReaderBuilder::new();
        // A carriage return inside a line is a blank.
        builder.has_headers(false).flexible(true).delimiter(separator as u8).terminator(Terminator::Any(b'\n'));
        Self { separator, reader: builder.from_reader(Cursor::default()), fields: Fields::default() }
    }

    /// The fields of one line, at least one; quotes are taken off.
    pub fn split(&mut self, line: &str) -> &Fields {
        let line = without_blanks_before_quotes(line, self.separator);
        let text = self.reader.get_mut().get_mut();
        text.clear();
        text.extend_from_slice(line.as_bytes());
        let fields = &mut self.fields.0;
        // What is read is in memory and UTF-8, and rows may be of any length: nothing is left that can fail.
        let is_read = self.reader.seek_raw(SeekFrom::Start(0), Position::new()).is_ok()
            && self.reader.read_record(fields).unwrap_or(false);
        if !is_read {
            fields.clear();
            fields.push_field("");
        }
        &self.fields
    }
}

impl Fields {
    /// The field in this place without blanks around it; empty where the line is shorter.
    #[must_use]
    pub fn text(&self, place: usize) -> &str {
        self.0.get(place).unwrap_or_default().trim()
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All, without blanks around them.
    pub fn iter(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(str::trim)
    }

    /// Replaces them by others, in the same memory.
    pub fn set<'a>(&mut self, fields: impl IntoIterator<Item = &'a str>) {
        self.0.clear();
        fields.into_iter().for_each(|it| self.0.push_field(it));
    }
}

/// `a, "b, c"`: some write blanks before a quote, which CSV then takes for part of the field.
fn without_blanks_before_quotes(line: &str, separator: char) -> Cow<'_, str> {
    if !line.contains('"') {
        return Cow::Borrowed(line);
    }
    let mut is_in_quotes = false;
    let mut parts: Vec<&str> = line.split(separator).collect();
    for part in &mut parts {
        let begins = !is_in_quotes && part.trim_start().starts_with('"');
        if begins || is_in_quotes {
            is_in_quotes ^= part.matches('"').count() % 2 == 1;
        }
        if begins {
            *part = part.trim_start();
        }
    }
    Cow::Owned(parts.join(separator.encode_utf8(&mut [0; 4])))
}

/// A text as a field of a line with commas, in quotes where it must be; ends of lines become blanks. `#` in front is quoted, so that no line becomes a comment.
#[must_use]
pub fn field(text: &str) -> Cow<'_, str> {
    if text.contains([',', '"', '\n', '\r']) || text.starts_with('#') {
        Cow::Owned(quoted(text))
    } else {
        Cow::Borrowed(text)
    }
}

/// A text as a field in quotes; ends of lines become blanks.
#[must_use]
pub fn quoted(text: &str) -> String {
    let mut writer = WriterBuilder::new().quote_style(csv::QuoteStyle::Always).from_writer(Vec::new());
    // Writing to memory does not fail, and what goes in as UTF-8 comes out as such.
    writer.write_record([text.replace(['\n', '\r'], " ")]).ok();
    let mut line = String::from_utf8(writer.into_inner().unwrap_or_default()).unwrap_or_default();
    line.pop(); // the end of the line
    line
}

/// A number as a field with so many decimals; what is not finite is an empty field.
#[must_use]
pub fn number(value: f64, decimals: usize) -> impl fmt::Display {
    Number { value, decimals }
}

struct Number {
    value: f64,
    decimals: usize,
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.value.is_finite() { write!(f, "{:.*}", self.decimals, self.value) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_that_is_not_finite_is_an_empty_field() {
        let fields = [1.0 / 3.0, -0.5, f64::NAN, f64::INFINITY].map(|it| number(it, 2).to_string());
        assert_eq!(fields, ["0.33", "-0.50", "", ""]);
    }

    fn split(line: &str) -> Vec<String> {
        Splitter::new(',').split(line).iter().map(str::to_owned).collect()
    }

    #[test]
    fn fields_are_parted_and_their_quotes_taken_off() {
        assert_eq!(split("1, two ,\"a, \"\"b\"\"\",\r"), ["1", "two", "a, \"b\"", ""]);
        assert_eq!(split("1, \"a, b\" , \"c\""), ["1", "a, b", "c"], "blanks before quotes");
        assert_eq!(split("a 5\" lens,2"), ["a 5\" lens", "2"]);
        assert_eq!(split("\"x, \"\"y\",z, \"a, b\""), ["x, \"y", "z", "a, b"]);
        assert_eq!(split(""), [""]);
        assert_eq!(split("\r"), [""]);
        assert_eq!(split("a\rb,c"), ["a\rb", "c"]);
        assert_eq!(Splitter::new(';').split("1,5;\"a;b\"").iter().collect::<Vec<_>>(), ["1,5", "a;b"]);
    }

    #[test]
    fn a_quote_that_is_not_closed_costs_its_own_line() {
        let mut splitter = Splitter::new(',');
        assert_eq!(splitter.split("1,\"a,2").iter().collect::<Vec<_>>(), ["1", "a,2"]);
        assert_eq!(splitter.split("3,b,4").iter().collect::<Vec<_>>(), ["3", "b", "4"]);
        let long = "x".repeat(5000);
        assert_eq!(splitter.split(&format!("{long},{long}")).text(1), long, "longer than what is read at once");
        assert_eq!((splitter.split("5").len(), splitter.split("5").text(1)), (1, ""));
    }

    #[test]
    fn what_is_written_is_read_again() {
        assert_eq!((field("wide-1"), field("a,\"b\"")), ("wide-1".into(), "\"a,\"\"b\"\"\"".into()));
        assert_eq!((field("#1").as_ref(), field("a\nb").as_ref(), quoted("").as_str()), ("\"#1\"", "\"a b\"", "\"\""));
        for text in ["", "a", "a,b", "\"", "a \"b\", c", "#", "x, \"y", "é, ü", "', '"] {
            assert_eq!(split(&format!("1,{},{}", field(text), quoted(text))), ["1", text, text]);
        }
    }
}
