//! What is wrong with a rig: each fault with its place in the text, and how the checks collect them.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Bytes of the rig's text.
pub type Span = Range<usize>;

/// Latest diagnostics that are searched for a repetition.
const RECENT: usize = 100;

/// Whether a rig can run in spite of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// The rig cannot run.
    Error,
    /// The rig runs, but probably not as meant.
    Warning,
}

/// One thing that is wrong at one place of a rig.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostic {
    /// Whether the rig can run in spite of it.
    pub severity: Severity,
    /// Where; lies inside the text, on character boundaries.
    pub span: Span,
    /// What is wrong, in one sentence.
    pub title: String,
    /// What was found there and what was expected.
    pub label: String,
    /// What to do about it.
    pub help: Option<String>,
    /// Other places that belong to it, each with what is there.
    pub others: Vec<(Span, String)>,
    line: usize,
    column: usize,
}

impl Diagnostic {
    /// Line and column of its first character, both counted from 1; columns count characters.
    pub fn line_column(&self) -> (usize, usize) {
        (self.line, self.column)
    }

    /// Adds help: what to do about it.
    pub fn help(&mut self, help: impl fmt::Display) -> &mut Self {
        self.help = Some(help.to_string());
        self
    }

    /// Adds help, where there is any.
    pub fn maybe_help(&mut self, help: Option<String>) -> &mut Self {
        self.help = help.or(self.help.take());
        self
    }

    /// Adds another place that belongs to it.
    pub fn also(&mut self, span: Span, label: impl fmt::Display) -> &mut Self {
        self.others.push((span, label.to_string()));
        self
    }
}

/// Everything that is wrong with a rig, in the order of its text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostics {
    /// By position.
    pub list: Vec<Diagnostic>,
    /// The rig's text.
    pub text: Arc<str>,
    /// The rig's file, for messages.
    pub path: PathBuf,
}

impl Default for Diagnostics {
    fn default() -> Self {
        Self { list: Vec::new(), text: Arc::from(""), path: PathBuf::new() }
    }
}

impl Diagnostics {
    /// Diagnostics that stop the rig from running.
    pub fn n_errors(&self) -> usize {
        self.list.iter().filter(|it| it.severity == Severity::Error).count()
    }

    /// Everything else.
    pub fn n_warnings(&self) -> usize {
        self.list.len() - self.n_errors()
    }
}

impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(false))
    }
}

impl std::error::Error for Diagnostics {}

/// How often a line ends in `text`.
pub fn count_lines(text: &str) -> usize {
    text.bytes().filter(|&it| it == b'\n').count()
}

/// What the checks have found so far.
#[derive(Default)]
pub struct Findings {
    list: Vec<Diagnostic>,
}

impl Findings {
    /// Notes a fault; what it returns takes help and other places.
    pub fn error(&mut self, span: Span, title: impl fmt::Display, label: impl fmt::Display) -> &mut Diagnostic {
        self.push(Severity::Error, span, title.to_string(), label.to_string())
    }

    /// Notes a warning.
    pub fn warning(&mut self, span: Span, title: impl fmt::Display, label: impl fmt::Display) -> &mut Diagnostic {
        self.push(Severity::Warning, span, title.to_string(), label.to_string())
    }

    fn push(&mut self, severity: Severity, span: Span, title: String, label: String) -> &mut Diagnostic {
        self.list.push(Diagnostic { severity, span, title, label, help: None, others: Vec::new(), line: 0, column: 0 });
        let last = self.list.len() - 1;
        &mut self.list[last]
    }

    /// Whether no diagnostic has `label` at `span` yet.
    pub fn is_new(&self, span: &Span, label: &str) -> bool {
        !self.list.iter().rev().take(RECENT).any(|it| it.span == *span && it.label == label)
    }

    /// Whether the rig cannot run.
    pub fn any_error(&self) -> bool {
        self.list.iter().any(|it| it.severity == Severity::Error)
    }

    /// How many there are, warnings included.
    pub fn count(&self) -> usize {
        self.list.len()
    }

    /// The latest one.
    pub fn last(&mut self) -> Option<&mut Diagnostic> {
        self.list.last_mut()
    }

    /// Those after the first `count`.
    pub fn since(&mut self, count: usize) -> &mut [Diagnostic] {
        self.list.get_mut(count..).unwrap_or_default()
    }

    /// Takes over what a trial found.
    pub fn append(&mut self, mut other: Findings) {
        self.list.append(&mut other.list);
    }

    /// In the order of the text, with lines and columns.
    pub fn into_diagnostics(self, text: &str, path: &Path) -> Diagnostics {
        let mut list = self.list;
        for fault in &mut list {
            fault.span = inside(text, &fault.span);
            for (span, _) in &mut fault.others {
                *span = inside(text, span);
            }
        }
        list.sort_by_key(|it| (it.span.start, it.span.end));
        list.dedup();
        let (mut line, mut column, mut at) = (1, 1, 0);
        for fault in &mut list {
            let passed = &text[at..fault.span.start];
            line += count_lines(passed);
            column = match passed.rfind('\n') {
                Some(newline) => 1 + passed[newline + 1..].chars().count(),
                None => column + passed.chars().count(),
            };
            at = fault.span.start;
            (fault.line, fault.column) = (line, column);
        }
        Diagnostics { list, text: Arc::from(text), path: path.to_owned() }
    }
}

/// `span` cut to the text and widened to character boundaries.
fn inside(text: &str, span: &Span) -> Span {
    let mut start = span.start.min(text.len());
    while !text.is_char_boundary(start) {
        start -= 1;
    }
    let mut end = span.end.clamp(start, text.len());
    while !text.is_char_boundary(end) {
        end += 1;
    }
    start..end
}
