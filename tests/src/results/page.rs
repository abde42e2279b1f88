//! `docs/results.md`, from the claims and what was measured.

use std::fmt::Write;

use super::claims::{Row, Run, Table};
use super::measured::{Measured, Measurement, Reading};

/// Most lines of the page.
pub const MOST_LINES: usize = 300;
/// Most bytes of the page.
pub const MOST_BYTES: usize = 40 * 1024;

const HEAD: &str = "\
# Results

Each figure comes from the command in bold above it. `cargo run --release -p foveate-tests --bin results` runs the commands (all, or those whose names are given, in
brackets here; `--quick`: those that take seconds) and writes this page; `results --check --quick` fails where a figure leaves its bound. The claims are in
`tests/results/*.toml`. Rows with **✗** fall short of their goal. Two values are the median and the worst seed; a goal is the median's, a second one the worst seed's. Beside a command stand the commit that was measured (`+`: and changes) and how long it took. Accuracy is the same on each machine; times are of two virtual cores
at 2.8 GHz, so compare them with the peer's from the same run only. `foveate` is `target/release/foveate` after `cargo build --release`; commands that read recordings need `FOVEATE_DATA`, and those of the built-in face ran without it.
";

/// The page.
pub fn page(tables: &[Table], measured: &Measured) -> String {
    let mut text = HEAD.to_owned();
    for table in tables {
        let _ = write!(text, "\n## {}\n\n", table.title);
        if !table.about.is_empty() {
            let _ = write!(text, "{}\n\n", table.about.trim());
        }
        text += "| | measured | goal | beside it |\n|---|---|---|---|\n";
        for run in &table.runs {
            text += &command(run, measured.get(&run.name));
            for row in &run.rows {
                text += &line(row, measured.get(&run.name).and_then(|it| it.values.get(&row.what)));
            }
        }
        for picture in table.runs.iter().flat_map(|it| &it.pictures) {
            let _ = write!(text, "\n![{}](pictures/{})\n", picture.shows, picture.to);
        }
    }
    text
}

fn command(run: &Run, measurement: Option<&Measurement>) -> String {
    let shown = |it: &String| it.replace("{out}/", "").replace(" --out {out}", "");
    let commands: Vec<String> = run.commands.iter().map(|it| format!("`{}`", shown(it))).collect();
    let when = measurement.map_or("not measured".to_owned(), |it| format!("{}, {}", it.commit, duration(it.seconds)));
    format!("| **{}** ({}) | | | {when} |\n", commands.join(", then "), run.name)
}

fn duration(seconds: f64) -> String {
    if seconds < 100.0 { format!("{seconds:.0} s") } else { format!("{:.0} min", seconds / 60.0) }
}

fn line(row: &Row, reading: Option<&Reading>) -> String {
    let unit = if row.unit.is_empty() { String::new() } else { format!(" {}", row.unit) };
    let value = reading.map_or("–".to_owned(), |it| {
        let worst = it.worst.map_or(String::new(), |it| format!(" / {}", number(it)));
        let mark = if falls_short(row, it) { "**✗** " } else { "" };
        format!("{mark}{}{worst}{unit}", number(it.median))
    });
    let goal = [row.good, row.good_worst].iter().flatten().map(|it| it.text()).collect::<Vec<_>>().join(" / ");
    let mut beside = Vec::new();
    if let Some(peer) = &row.peer {
        beside.push(match reading.and_then(|it| it.peer.map(|of_peer| (it.median, of_peer))) {
            Some((ours, of_peer)) => format!("{}: {}{unit} ({} ×)", peer.name, number(of_peer), number(of_peer / ours)),
            None => format!("{}: not installed here", peer.name),
        });
    }
    if !row.beside.is_empty() {
        beside.push(row.beside.clone());
    }
    format!("| {} | {value} | {goal} | {} |\n", row.what, beside.join("; "))
}

/// Whether a figure misses what counts as good.
pub fn falls_short(row: &Row, reading: &Reading) -> bool {
    row.good.is_some_and(|it| !it.admits(reading.median))
        || row.good_worst.is_some_and(|it| !it.admits(reading.worst.unwrap_or(reading.median)))
}

impl super::claims::Bound {
    /// `≤ 2.5`.
    pub fn text(self) -> String {
        format!("{} {}", if self.is_upper { "≤" } else { "≥" }, number(self.limit))
    }
}

/// Three digits that count, thousands in full.
pub fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    let text = format!("{value:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    match value.abs() {
        it if it >= 10_000.0 => thousands(text),
        _ => text.to_owned(),
    }
}

fn thousands(digits: &str) -> String {
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && digit != '-' && (digits.len() - i).is_multiple_of(3) && !text.ends_with('-') {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// What is wrong with the length of `text`, if anything.
pub fn too_long(text: &str) -> Option<String> {
    let (lines, bytes) = (text.lines().count(), text.len());
    (lines > MOST_LINES || bytes > MOST_BYTES).then(|| {
        format!("the page has {lines} lines and {bytes} bytes, expected at most {MOST_LINES} and {MOST_BYTES}")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_three_digits() {
        let shown = [0.0, 0.012_345, 1.0, 2.506, 13.07, 123.4, 1234.5, 12_345.6, -1_234_567.0].map(number);
        assert_eq!(shown, ["0", "0.0123", "1", "2.51", "13.1", "123", "1234", "12,346", "-1,234,567"]);
    }

    #[test]
    fn a_row_shows_median_worst_goal_and_ratio_to_the_peer() {
        let row: Row = toml::from_str(
            "what = 'w'\nunit = 'ms'\nfigure = 'f'\ngood = '<= 2'\ngood_worst = '<= 3'\nbeside = '4 ms, a paper'\npeer = { name = 'P 1', at = { line = 'p' } }",
        )
        .unwrap();
        let reading = Reading { median: 1.5, worst: Some(3.5), peer: Some(6.0) };
        assert!(falls_short(&row, &reading));
        assert_eq!(
            line(&row, Some(&reading)),
            "| w | **✗** 1.5 / 3.5 ms | ≤ 2 / ≤ 3 | P 1: 6 ms (4 ×); 4 ms, a paper |\n"
        );
        let reading = Reading { worst: Some(2.9), peer: None, ..reading };
        assert!(!falls_short(&row, &reading));
        assert_eq!(
            line(&row, Some(&reading)),
            "| w | 1.5 / 2.9 ms | ≤ 2 / ≤ 3 | P 1: not installed here; 4 ms, a paper |\n"
        );
        assert_eq!(line(&row, None), "| w | – | ≤ 2 / ≤ 3 | P 1: not installed here; 4 ms, a paper |\n");
    }

    #[test]
    fn long_pages_are_refused() {
        assert!(too_long(&"x\n".repeat(MOST_LINES)).is_none());
        assert!(too_long(&"x\n".repeat(MOST_LINES + 1)).is_some());
        assert!(too_long(&"x".repeat(MOST_BYTES + 1)).is_some());
    }
}
