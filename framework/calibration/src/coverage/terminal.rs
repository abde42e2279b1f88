//! Coverage in characters: a small picture for each camera, or a line for each when there are many.

use std::fmt::Write as _;

use super::advice::groups;
use super::{Advice, Coverage, Guidance};

/// More cameras than this get a table.
const PICTURED: usize = 64;
/// Up to so many cameras get the large picture.
const LARGE: usize = 6;
/// Sentences that are shown.
const SENTENCES: usize = 5;

const SHADES: [char; 5] = [' ', '░', '▒', '▓', '█'];
/// From a dark blue over green to a bright yellow, in the 256 colours of a terminal; the first is for an empty cell.
const HEAT: [u8; 6] = [236, 24, 31, 36, 113, 227];

pub(super) fn render(coverage: &Coverage, width: usize, color: bool) -> String {
    let painter = Painter { coverage, color };
    let mut text = String::new();
    if coverage.cameras.len() > PICTURED {
        painter.table(&mut text, width);
    } else {
        painter.pictures(&mut text, width);
    }
    let guidance = coverage.state();
    painter.links(&mut text, width);
    painter.advice(&mut text, &guidance, width);
    text
}

struct Painter<'a> {
    coverage: &'a Coverage,
    color: bool,
}

impl Painter<'_> {
    fn painted(&self, text: &str, code: &str) -> String {
        if self.color { format!("\x1b[{code}m{text}\x1b[0m") } else { text.to_owned() }
    }

    fn pictures(&self, text: &mut String, width: usize) {
        let n = self.coverage.cameras.len();
        let [columns, rows] = self.coverage.options.grid;
        let large = n <= LARGE;
        // Two characters are about as wide as one is high.
        let inner = (if large { 2 * columns } else { columns }).max(12);
        let lines = if large { rows } else { rows.div_ceil(2) };
        let across = ((width + 2) / (inner + 4)).max(1);
        for start in (0..n).step_by(across) {
            let group = start..(start + across).min(n);
            let mut row = |cell: &dyn Fn(usize) -> String| {
                let cells: Vec<String> = group.clone().map(cell).collect();
                let _ = writeln!(text, "{}", cells.join("  ").trim_end()); // writing to a String cannot fail
            };
            row(&|camera| self.title(camera, inner + 2));
            row(&|_| self.painted(&format!("┌{}┐", "─".repeat(inner)), "2"));
            for line in 0..lines {
                row(&|camera| {
                    let wall = self.painted("│", "2");
                    format!("{wall}{}{wall}", self.line(camera, line, large, inner))
                });
            }
            row(&|_| self.painted(&format!("└{}┘", "─".repeat(inner)), "2"));
        }
    }

    /// Name to the left, frames and a mark when that will do to the right.
    fn title(&self, camera: usize, width: usize) -> String {
        let done = self.coverage.is_done(camera);
        let count = format!("{}{}", self.coverage.cameras[camera].frames, if done { " ✓" } else { "" });
        let name = fitted(&self.coverage.cameras[camera].name, width.saturating_sub(count.chars().count() + 1));
        let count = self.painted(&count, if done { "32" } else { "33" });
        format!("{} {count}", self.painted(&name, "1"))
    }

    /// A line of the picture: one row of cells, or two.
    fn line(&self, camera: usize, line: usize, large: bool, inner: usize) -> String {
        let [columns, rows] = self.coverage.options.grid;
        let cells = &self.coverage.cameras[camera].cells;
        let enough = u32::from(u16::MAX).min(2 * self.coverage.options.full_cell.max(1));
        let part = |column: usize, row: usize| {
            let count = if row < rows { u32::from(cells[row * columns + column]) } else { 0 };
            f64::from(count.min(enough)) / f64::from(enough)
        };
        let level = |part: f64, levels: usize| (part * (levels - 1) as f64).ceil() as usize;
        let mut text = String::new();
        let across = if large { 2 * columns } else { columns };
        let left = (inner - across.min(inner)) / 2;
        text += &" ".repeat(left);
        for column in 0..columns {
            if self.color {
                let [upper, lower] = if large {
                    [HEAT[level(part(column, line), HEAT.len())]; 2]
                } else {
                    [2 * line, 2 * line + 1].map(|row| HEAT[level(part(column, row), HEAT.len())])
                };
                let blocks = if large { "▀▀" } else { "▀" };
                let _ = write!(text, "\x1b[38;5;{upper};48;5;{lower}m{blocks}\x1b[0m");
            } else if large {
                let shade = SHADES[level(part(column, line), SHADES.len())];
                text.extend([shade; 2]);
            } else {
                let of_both = 0.5 * (part(column, 2 * line) + part(column, 2 * line + 1));
                text.push(SHADES[level(of_both, SHADES.len())]);
            }
        }
        text += &" ".repeat(inner.saturating_sub(left + across));
        text
    }

    fn table(&self, text: &mut String, width: usize) {
        let n = self.coverage.cameras.len();
        let names = self.coverage.cameras.iter().map(|it| it.name.chars().count()).max().unwrap_or(0).clamp(6, 16);
        let column = names + 22;
        let across = ((width + 3) / (column + 3)).max(1);
        let down = n.div_ceil(across);
        let heading = format!("{:<names$} frames  image pairs  ", "camera");
        let _ = writeln!(text, "{}", self.painted(&vec![heading; across.min(n)].join("   "), "2"));
        for line in 0..down {
            let cells: Vec<String> = (0..across)
                .map(|it| it * down + line)
                .filter(|it| *it < n)
                .map(|camera| {
                    let held = &self.coverage.cameras[camera];
                    let share = 100.0 * held.share(&self.coverage.options);
                    let mark = if self.coverage.is_done(camera) {
                        self.painted("✓", "32")
                    } else {
                        self.painted("·", "33")
                    };
                    let (name, partners) = (fitted(&held.name, names), self.coverage.partners(camera));
                    format!("{name} {:>6}  {share:>3.0} % {partners:>5} {mark}", held.frames)
                })
                .collect();
            let _ = writeln!(text, "{}", cells.join("   ").trim_end());
        }
    }

    fn links(&self, text: &mut String, width: usize) {
        let Coverage { cameras, links, options, .. } = self.coverage;
        let n = cameras.len();
        let partners = |a: usize, b: usize| links.common(a, b) >= options.min_common;
        let n_pairs = (0..n).map(|b| (0..b).filter(|a| partners(*a, b)).count()).sum::<usize>();
        let groups = groups(n, partners, None);
        let mut line = format!("{n_pairs} pairs linked");
        if let Some(weakest) = (0..n).min_by_key(|it| self.coverage.partners(*it)).filter(|_| n > 1) {
            let count = self.coverage.partners(weakest);
            let noun = if count == 1 { "partner" } else { "partners" };
            let _ = write!(line, ", the least {} with {count} {noun}", cameras[weakest].name);
        }
        if groups.len() > 1 {
            let _ = write!(line, "; {} groups that are not linked", groups.len());
        }
        if let Some(share) = self.coverage.volume_share() {
            let _ = write!(line, "; {:.0} % of the volume", 100.0 * share);
        }
        let _ = writeln!(text, "{}", wrapped(&line, width, ""));
    }

    fn advice(&self, text: &mut String, guidance: &Guidance, width: usize) {
        if guidance.enough {
            let line = "Enough: stop when you like.";
            let _ = writeln!(text, "{}", self.painted(line, "1;32"));
        }
        let shown = if guidance.missing.len() > SENTENCES { SENTENCES - 1 } else { SENTENCES };
        for advice in guidance.missing.iter().take(shown) {
            let (bullet, code) = if advice.needed() { ("▸ ", "33") } else { ("· ", "2") };
            let _ = writeln!(
                text,
                "{}{}",
                self.painted(bullet, code),
                wrapped(&advice.to_string(), width.saturating_sub(2), "  ")
            );
        }
        if guidance.missing.len() > shown {
            let rest = &guidance.missing[shown..];
            let needed = rest.iter().filter(|it: &&Advice| it.needed()).count();
            let line = format!("· and {} more, {needed} of them required", rest.len());
            let _ = writeln!(text, "{}", self.painted(&wrapped(&line, width, "  "), "2"));
        }
    }
}

/// Cut or filled to `width` characters; what does not print is left out.
fn fitted(text: &str, width: usize) -> String {
    let printed: Vec<char> = text.chars().filter(|it| !it.is_control()).collect();
    let mut fitted: String = printed.iter().take(width).collect();
    if printed.len() > width && width > 0 {
        fitted.pop();
        fitted.push('…');
    }
    fitted + &" ".repeat(width.saturating_sub(printed.len()))
}

/// Broken between words into lines of `width` characters, all but the first after `indent`.
fn wrapped(text: &str, width: usize, indent: &str) -> String {
    let (mut lines, mut length) = (String::new(), 0);
    for word in text.split(' ') {
        let word: String = word.chars().filter(|it| !it.is_control()).collect();
        let letters = word.chars().count();
        if length > 0 && length + 1 + letters > width {
            lines.push('\n');
            lines += indent;
            length = 0;
        } else if length > 0 {
            lines.push(' ');
            length += 1;
        }
        lines += &word;
        length += letters;
    }
    lines
}
