//! The frame of the page: escaping, sections, numbers in words.

use std::fmt::Write as _;

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("room.js");

/// The page as it grows.
pub(super) struct Page {
    text: String,
    contents: Vec<(&'static str, &'static str)>,
    title: String,
}

impl Page {
    pub(super) fn new(title: &str) -> Self {
        Self { text: String::new(), contents: Vec::new(), title: escaped(title) }
    }

    /// Begins a section; `about` says how to read it.
    pub(super) fn section(&mut self, id: &'static str, title: &'static str, about: &str) {
        self.contents.push((id, title));
        if self.contents.len() > 1 {
            self.text += "</section>\n";
        }
        let _ = writeln!(self.text, "<section id=\"{id}\"><h2>{title}</h2>"); // writing to a String cannot fail
        if !about.is_empty() {
            let _ = writeln!(self.text, "<p class=\"about\">{}</p>", escaped(about));
        }
    }

    /// Puts in what is HTML already.
    pub(super) fn raw(&mut self, html: &str) {
        self.text += html;
        self.text.push('\n');
    }

    /// Puts in a paragraph of plain text.
    pub(super) fn note(&mut self, text: &str) {
        let _ = writeln!(self.text, "<p class=\"note\">{}</p>", escaped(text));
    }

    pub(super) fn finish(self) -> String {
        let Page { text, contents, title } = self;
        let links: String =
            contents.iter().map(|(id, title)| format!("<a href=\"#{id}\">{title}</a>")).collect::<Vec<_>>().join("");
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
             <header><h1>{title}</h1><nav>{links}</nav></header>\n<main>\n{text}</section>\n</main>\n\
             <script>\n{SCRIPT}</script>\n</body>\n</html>\n"
        )
    }
}

/// `text` as it may stand between tags and in attributes; control characters become spaces.
pub(crate) fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\'' => escaped += "&#39;",
            control if control.is_control() => escaped.push(' '),
            other => escaped.push(other),
        }
    }
    escaped
}

/// `text` as a string of JSON that may stand in a `script` element.
pub(super) fn json_string(text: &str) -> String {
    let mut json = String::from("\"");
    for letter in text.chars() {
        match letter {
            '"' | '\\' | '<' | '>' | '&' | '\u{2028}' | '\u{2029}' => {
                let _ = write!(json, "\\u{:04x}", u32::from(letter));
            }
            control if control.is_control() => json.push(' '),
            other => json.push(other),
        }
    }
    json.push('"');
    json
}

/// With so many digits after the point; a dash for what is no finite number.
pub(super) fn fixed(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let text = format!("{value:.digits$}");
    // No "-0.0"; a minus of the width of the digits.
    let zero = text.bytes().all(|it| matches!(it, b'-' | b'0' | b'.'));
    if zero { text.replace('-', "") } else { text.replace('-', "−") }
}

/// With three significant digits.
pub(super) fn rounded(value: f64) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let size = value.abs();
    if size != 0.0 && !(1e-4..1e6).contains(&size) {
        return format!("{value:.2e}").replace('-', "−");
    }
    let before = if size < 1e-12 { 0 } else { size.log10().floor() as i32 };
    fixed(value, (2 - before).clamp(0, 7) as usize)
}

/// A whole number with thin spaces between thousands.
pub(super) fn count(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) && digits.len() > 4 {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

/// A standard deviation of a length, in mm where the unit is the metre.
pub(super) fn small_length(value: f64, unit: &str) -> String {
    if unit == "m" { format!("{} mm", rounded(1e3 * value)) } else { format!("{} {}", rounded(value), escaped(unit)) }
}
