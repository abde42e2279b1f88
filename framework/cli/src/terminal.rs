//! Several lines on a terminal that are drawn over again.

/// Columns and rows of a terminal that does not say.
const SIZE: [usize; 2] = [100, 24];
/// In place of what does not fit, in one row.
const MORE: &str = "… more in a larger terminal";

/// Lines that stand on a terminal.
#[derive(Debug, Default)]
pub struct Drawing {
    lines: usize,
}

impl Drawing {
    /// What draws `text` over the last one, on a terminal of so many columns and rows.
    pub fn over(&mut self, text: &str, size: [usize; 2]) -> String {
        // A terminal that was made smaller since has lost the rest.
        let drawn = self.lines.min(size[1].saturating_sub(1));
        let up = if drawn > 0 { format!("\x1b[{drawn}A\x1b[J") } else { String::new() };
        let (text, lines) = fitting(text, size);
        self.lines = lines;
        up + &text
    }
}

/// As much of the end of `text`, where the advice stands, as can be drawn over again, and its rows: what has left a terminal at its top
/// stays there.
fn fitting(text: &str, [columns, rows]: [usize; 2]) -> (String, usize) {
    let rows_of = |line: &str| visible(line).div_ceil(columns.max(1)).max(1);
    // The cursor comes to stand on a row of its own.
    let network = rows.saturating_sub(1).max(1);
    let all: usize = text.lines().map(rows_of).sum();
    if all <= network {
        return (text.to_owned(), all);
    }
    let mut used = 1;
    let fits = |line: &&str| {
        used += rows_of(line);
        used <= network
    };
    let mut kept: Vec<&str> = text.lines().rev().take_while(fits).collect();
    kept.push(if visible(MORE) <= columns { MORE } else { "…" });
    kept.reverse();
    let n_rows = kept.iter().map(|it| rows_of(it)).sum();
    (kept.iter().map(|it| format!("{it}\n")).collect(), n_rows)
}

/// Characters of `line` without its colours.
fn visible(line: &str) -> usize {
    let mut parts = line.split('\x1b');
    let first = parts.next().map_or(0, |it| it.chars().count());
    first + parts.map(|it| it.split_once('m').map_or(0, |it| it.1.chars().count())).sum::<usize>()
}

/// Columns and rows of the terminal on standard error.
pub fn size() -> [usize; 2] {
    let said = |name: &str| std::env::var(name).ok().and_then(|it| it.parse().ok()).unwrap_or(0);
    let (found, said) = (asked_size(), [said("COLUMNS"), said("LINES")]);
    [0, 1].map(|it| [found[it], said[it], SIZE[it]].into_iter().find(|n| *n > 0).unwrap_or(1))
}

/// As the terminal says, zeros where it does not.
#[cfg(unix)]
fn asked_size() -> [usize; 2] {
    let size = rustix::termios::tcgetwinsize(std::io::stderr());
    size.map_or([0; 2], |it| [it.ws_col, it.ws_row].map(usize::from))
}

/// Zeros: it cannot be asked here.
#[cfg(not(unix))]
fn asked_size() -> [usize; 2] {
    [0; 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_more_is_drawn_than_fits() {
        let text = "one\ntwo\n\x1b[31mthree\x1b[0m, \x1b[1mfour\x1b[0m\nfive\n";
        assert_eq!(visible("\x1b[31mthree\x1b[0m, \x1b[1mfour\x1b[0m"), 11);
        assert_eq!(fitting(text, [80, 5]), (text.to_owned(), 4));
        assert_eq!(fitting(text, [11, 5]).1, 4);
        let (drawn, rows) = fitting(text, [80, 4]);
        assert_eq!((drawn.lines().count(), rows), (3, 3));
        assert!(drawn.ends_with("four\x1b[0m\nfive\n") && !drawn.contains("two"), "{drawn}");
        // Lines that are wider than the terminal take several of its rows.
        let (drawn, rows) = fitting(text, [10, 5]);
        assert!(drawn.ends_with("\nfive\n") && rows <= 4, "{drawn}");
        assert_eq!(fitting("", [80, 24]), (String::new(), 0));
    }
}
