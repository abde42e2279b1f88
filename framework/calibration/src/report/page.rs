//! The frame of the page: escaping, sections, numbers in words.

use std::fmt::Write as _;

use foveate_plot::colours::Theme;
use foveate_plot::text::{escaped, rounded};

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("room.js");

/// Colours of figures, which `style.css` gives for day, night and print.
pub(super) const THEME: Theme =
    Theme { ink: "var(--ink)", muted: "var(--muted)", grid: "var(--line)", edge: "var(--edge)", paper: "var(--card)" };
/// Of what was used, and of what was held out.
pub(super) const SERIES: [&str; 2] = ["var(--s0)", "var(--s1)"];
/// Of nothing, and of ever more.
pub(super) const LEVELS: [&str; 6] = ["var(--h0)", "var(--h1)", "var(--h2)", "var(--h3)", "var(--h4)", "var(--h5)"];
/// Elements that hold figures.
pub(super) const PLOT: &str = "plot";

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

/// A standard deviation of a length, in mm where the unit is the metre.
pub(super) fn small_length(value: f64, unit: &str) -> String {
    if unit == "m" { format!("{} mm", rounded(1e3 * value)) } else { format!("{} {}", rounded(value), escaped(unit)) }
}
