//! Which cameras are meant: patterns of names, of which those that begin with `!` leave cameras out.

use std::fmt;

pub use foveate_diagnostics::names::matches;
use foveate_diagnostics::names::{available, did_you_mean, likely, shown};

/// Why patterns select nothing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SelectionError {
    /// Which of the patterns, by its place; `None` where each of them matches and all of them together leave nothing.
    pub pattern: Option<usize>,
    /// What is wrong.
    pub found: String,
    /// What was probably meant, or what there is.
    pub help: String,
}

impl fmt::Display for SelectionError {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(to, "{}; {}", self.found, self.help)
    }
}

/// The places of those of `names` that `patterns` select, in order: all that one of them matches, with `*` for any characters and `?` for one,
/// less those that a pattern with `!` before it matches. Where all patterns have a `!`, all other names are meant.
///
/// # Errors
/// A pattern that matches no name, with or without `!`; patterns that leave nothing.
pub fn select(patterns: &[&str], names: &[&str]) -> Result<Vec<usize>, SelectionError> {
    let mut is_in = vec![patterns.iter().all(|it| it.starts_with('!')); names.len()];
    let ordered = [false, true]
        .into_iter()
        .flat_map(|out| patterns.iter().enumerate().filter(move |it| it.1.starts_with('!') == out));
    for (index, pattern) in ordered {
        let (bare, value) = pattern.strip_prefix('!').map_or((*pattern, true), |it| (it, false));
        let bare = bare.trim();
        let mut any = false;
        for (_, is_in) in names.iter().zip(&mut is_in).filter(|it| matches(bare, it.0)) {
            (any, *is_in) = (true, value);
        }
        if !any {
            let found = format!("no camera of the calibration matches `{}`", shown(&bare));
            let help = match likely(bare, names.iter().copied()).filter(|_| !bare.contains(['*', '?'])) {
                Some(_) => did_you_mean(bare, "its cameras", names.iter().copied()),
                None => available("its cameras", names.iter().copied()),
            };
            return Err(SelectionError { pattern: Some(index), found, help });
        }
    }
    let selected: Vec<usize> = (0..names.len()).filter(|it| is_in[*it]).collect();
    if selected.is_empty() {
        let all: Vec<String> = patterns.iter().map(|it| format!("`{}`", shown(it))).collect();
        let found = format!("{} leave no camera", all.join(", "));
        return Err(SelectionError { pattern: None, found, help: available("the cameras", names.iter().copied()) });
    }
    Ok(selected)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 5] = ["wide-1", "wide-2", "wide-10", "ptz-1", "cam3"];

    #[test]
    fn patterns_take_and_leave_out_whatever_their_order() {
        for (patterns, expected) in [
            (&["wide-*"][..], &[0, 1, 2][..]),
            (&["!cam3"], &[0, 1, 2, 3]),
            (&["!cam3", "!wide-1*"], &[1, 3]),
            (&["wide-*", "!wide-2"], &[0, 2]),
            (&["!wide-2", "wide-*"], &[0, 2]),
            (&["wide-?", "ptz-1"], &[0, 1, 3]),
            (&["*"], &[0, 1, 2, 3, 4]),
            (&["! cam3", "*"], &[0, 1, 2, 3]),
        ] {
            assert_eq!(select(patterns, &NAMES).unwrap(), expected, "{patterns:?}");
        }
    }

    #[test]
    fn what_matches_nothing_is_named_with_what_was_meant() {
        let fault = |patterns: &[&str]| select(patterns, &NAMES).unwrap_err();
        assert_eq!(
            fault(&["wide-*", "!wide-3"]).to_string(),
            "no camera of the calibration matches `wide-3`; did you mean `wide-1`?"
        );
        assert_eq!(fault(&["wide-*", "!wide-3"]).pattern, Some(1));
        let none = fault(&["narrow-*"]);
        assert!(none.help.contains("`wide-1`, `wide-2`, `wide-10`, `ptz-1` and `cam3`"), "{none}");
        let nothing = fault(&["cam3", "!cam*"]);
        assert_eq!((nothing.pattern, nothing.found.as_str()), (None, "`cam3`, `!cam*` leave no camera"));
        assert!(select(&["*"], &[]).is_err());
    }
}
