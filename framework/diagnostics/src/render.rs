//! Diagnostics as a page for people: the lines each is about, underlined, what was found and expected, what to do.

use annotate_snippets::{AnnotationKind, Level, Origin, Renderer, Snippet, normalize_untrusted_str};

use crate::diagnostic::{Diagnostic, Diagnostics, Severity, Span, count_lines};

/// Diagnostics that are shown in full; of more it says only how many there are.
const MOST_SHOWN: usize = 100;
/// Lines longer than this are not shown [bytes].
const LONGEST_LINE: usize = 1000;
/// Lines of one excerpt; of a longer span the rest is not shown.
const MOST_LINES: usize = 6;

/// A place of a fault, and what to write there.
struct Mark<'f> {
    kind: AnnotationKind,
    span: &'f Span,
    label: &'f str,
}

impl Diagnostics {
    /// For a terminal: each fault with the lines that it is about, underlined, then what was expected and what to do.
    /// The first hundred in full, of more their number.
    pub fn render(&self, color: bool) -> String {
        let renderer = if color { Renderer::styled() } else { Renderer::plain() };
        let path = self.path.display().to_string();
        let mut page = String::new();
        for fault in self.list.iter().take(MOST_SHOWN) {
            page.push_str(&self.render_one(fault, &path, &renderer));
            page.push_str("\n\n");
        }
        if self.list.len() > MOST_SHOWN {
            page.push_str(&format!("… and {} more\n", self.list.len() - MOST_SHOWN));
        }
        page
    }

    fn render_one(&self, fault: &Diagnostic, path: &str, renderer: &Renderer) -> String {
        let level = match fault.severity {
            Severity::Error => Level::ERROR,
            Severity::Warning => Level::WARNING,
        };
        let mut group = level.primary_title(&fault.title).elements([] as [Origin<'_>; 0]);
        let mut notes = Vec::new();
        for (excerpt, marks) in self.excerpts(fault) {
            if excerpt.text.is_empty() || excerpt.too_long {
                let mut origin = Origin::path(path.to_owned());
                if excerpt.too_long {
                    let before = &self.text[excerpt.start..marks[0].span.start];
                    origin = origin.line(excerpt.line).char_column(1 + before.chars().count());
                }
                group = group.element(origin);
                notes.extend(marks.iter().map(|it| it.label));
                continue;
            }
            let mut snippet = Snippet::source(excerpt.text).line_start(excerpt.line).path(path.to_owned());
            for Mark { kind, span, label } in marks {
                let start = span.start - excerpt.start;
                let end = (span.end - excerpt.start).min(excerpt.text.len());
                snippet = snippet.annotation(kind.span(start..end.max(start)).label(label));
            }
            group = group.element(snippet);
        }
        for note in notes {
            group = group.element(Level::NOTE.message(normalize_untrusted_str(note)));
        }
        if let Some(help) = &fault.help {
            group = group.element(Level::HELP.message(normalize_untrusted_str(help)));
        }
        renderer.render(&[group])
    }

    /// The lines to show, and what to mark in them; places within a few lines of each other share an excerpt.
    fn excerpts<'f>(&'f self, fault: &'f Diagnostic) -> Vec<(Excerpt<'f>, Vec<Mark<'f>>)> {
        let first = Mark { kind: AnnotationKind::Primary, span: &fault.span, label: &fault.label };
        let others = fault.others.iter().map(|(span, label)| Mark { kind: AnnotationKind::Context, span, label });
        let mut excerpts: Vec<(Excerpt<'_>, Vec<Mark<'_>>)> = Vec::new();
        for mark in std::iter::once(first).chain(others) {
            let excerpt = Excerpt::around(&self.text, mark.span);
            let joined =
                excerpts.iter().enumerate().find_map(|(index, it)| Some((index, it.0.joined(&excerpt, &self.text)?)));
            match joined {
                Some((index, joined)) => {
                    excerpts[index].0 = joined;
                    excerpts[index].1.push(mark);
                }
                None => excerpts.push((excerpt, vec![mark])),
            }
        }
        excerpts
    }
}

/// A few whole lines.
struct Excerpt<'t> {
    text: &'t str,
    start: usize,
    /// Number of its first line, from 1.
    line: usize,
    too_long: bool,
}

impl<'t> Excerpt<'t> {
    fn around(text: &'t str, span: &Span) -> Self {
        let start = text[..span.start].rfind('\n').map_or(0, |it| it + 1);
        Self::of(text, start, 1 + count_lines(&text[..start]), span.end)
    }

    /// From the line that begins at `start` to the one that holds `last`.
    fn of(text: &'t str, start: usize, line: usize, last: usize) -> Self {
        let mut end = start;
        let mut too_long = false;
        for row in text[start..].split_inclusive('\n').take(MOST_LINES) {
            end += row.len();
            too_long |= row.len() > LONGEST_LINE;
            if end >= last {
                break;
            }
        }
        Self { text: &text[start..end], start, line, too_long }
    }

    /// One excerpt for both, where they lie close together.
    fn joined(&self, other: &Self, text: &'t str) -> Option<Self> {
        let (upper, lower) = if self.start <= other.start { (self, other) } else { (other, self) };
        if lower.line >= upper.line + MOST_LINES || upper.too_long || lower.too_long {
            return None;
        }
        let last = (upper.start + upper.text.len()).max(lower.start + lower.text.len());
        let joined = Self::of(text, upper.start, upper.line, last);
        (!joined.too_long && joined.start + joined.text.len() >= last).then_some(joined)
    }
}
