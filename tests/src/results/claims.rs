//! The claims, as `tests/results/*.toml` states them: one file a table, in the order of the files' names.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use serde::Deserialize;

/// One table of the page: the claims about one capability.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// Heading.
    pub title: String,
    /// What was measured on, in one or two sentences.
    #[serde(default)]
    pub about: String,
    /// The commands, each with its figures.
    #[serde(rename = "run")]
    pub runs: Vec<Run>,
}

/// One command, or several one after the other, and the figures that it gives.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// Name on the command line of `results`, unique among all files.
    pub name: String,
    /// What is run, from the root of the repository. `foveate` is the program of the same profile; `{out}` is a folder for results; the last
    /// command's `summary.json` or `eval.json` and the standard output of all are read.
    pub commands: Vec<String>,
    /// Whether it takes seconds, so that each change is checked against it.
    #[serde(default)]
    pub quick: bool,
    /// Whether its figures are times. They are never checked: machines differ and are busy.
    #[serde(default)]
    pub speed: bool,
    /// Folders or files below `FOVEATE_DATA` without which it cannot run.
    #[serde(default)]
    pub needs: Vec<String>,
    /// Whether it may see `FOVEATE_DATA` [yes, unless stated]: rigs that take a recorded face where there is one must give the same everywhere.
    #[serde(default = "yes")]
    pub data: bool,
    /// Packages of Python that the peer beside it needs.
    #[serde(default)]
    pub python: Vec<String>,
    /// Exit code that is expected [0, unless stated].
    #[serde(default)]
    pub exit: i32,
    /// Its figures.
    #[serde(rename = "row")]
    pub rows: Vec<Row>,
    /// Pictures that it makes and the page shows.
    #[serde(default, rename = "picture")]
    pub pictures: Vec<Picture>,
}

/// One figure.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// What is measured, in words; unique in its run.
    pub what: String,
    /// Unit, empty for a count or a share.
    #[serde(default)]
    pub unit: String,
    /// Factor from what the command gives to `unit`.
    #[serde(default = "one")]
    pub times: f64,
    /// Name in `summary.json` or `eval.json`.
    pub figure: Option<String>,
    /// Or: a number in what the command prints.
    pub line: Option<Place>,
    /// The same figure of a peer, from the same run.
    pub peer: Option<Peer>,
    /// What counts as good, for the median.
    pub good: Option<Bound>,
    /// What counts as good, for the worst seed.
    pub good_worst: Option<Bound>,
    /// What no change may leave, for the worst seed (or the only one); `good_worst` or `good` where it is not given.
    pub holds: Option<Bound>,
    /// The figure of the paper or of a peer that is not run here, with its source.
    #[serde(default)]
    pub beside: String,
}

/// The `number`-th number after `after`, in the first line that holds `line` and is not before one that holds `below`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Text of an earlier line, such as the heading of a peer's output.
    #[serde(default)]
    pub below: String,
    /// Text that the line holds.
    pub line: String,
    /// Text in that line after which numbers are counted; the start of the line unless given.
    #[serde(default)]
    pub after: String,
    /// Counted from 1.
    #[serde(default = "first")]
    pub number: usize,
}

/// A peer's figure.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Peer {
    /// Who it is, with its version.
    pub name: String,
    /// Its number in what the command prints.
    pub at: Place,
    /// Factor to the row's unit.
    #[serde(default = "one")]
    pub times: f64,
}

/// A picture of the results folder that is kept for the page.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Picture {
    /// File in the results folder.
    pub from: String,
    /// File in `docs/pictures`.
    pub to: String,
    /// What it shows.
    pub shows: String,
}

/// `<= 2.5` or `>= 0.99`, in the row's unit.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(try_from = "String")]
pub struct Bound {
    /// Whether values above `limit` break it.
    pub is_upper: bool,
    /// In the row's unit.
    pub limit: f64,
}

impl Bound {
    /// Whether `value` keeps it; NaN keeps none.
    pub fn admits(self, value: f64) -> bool {
        if self.is_upper { value <= self.limit } else { value >= self.limit }
    }
}

impl TryFrom<String> for Bound {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let expected = || format!("found `{text}`, expected `<= NUMBER` or `>= NUMBER`");
        let (is_upper, rest) = match (text.strip_prefix("<="), text.strip_prefix(">=")) {
            (Some(rest), _) => (true, rest),
            (_, Some(rest)) => (false, rest),
            _ => return Err(expected()),
        };
        let limit = rest.trim().parse().map_err(|_| expected())?;
        Ok(Self { is_upper, limit })
    }
}

impl Row {
    /// The bound that [`Row::holds`] states, or that stands in for it.
    pub fn bound(&self) -> Option<Bound> {
        self.holds.or(self.good_worst).or(self.good)
    }
}

fn one() -> f64 {
    1.0
}

fn yes() -> bool {
    true
}

fn first() -> usize {
    1
}

/// Reads all claims below `folder`.
///
/// # Errors
/// The file, what was found and what was expected: text that is no table of claims, names that two runs or two rows share, rows without a source.
pub fn read(folder: &Path) -> Result<Vec<Table>, String> {
    let entries = fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut paths: Vec<_> = entries.flatten().map(|it| it.path()).collect();
    paths.retain(|it| it.extension().is_some_and(|it| it == "toml"));
    paths.sort();
    let mut tables = Vec::new();
    let mut names = BTreeSet::new();
    for path in paths {
        let text = fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let table: Table = toml::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))?;
        check(&table, &mut names).map_err(|found| format!("{}: {found}", path.display()))?;
        tables.push(table);
    }
    Ok(tables)
}

fn check(table: &Table, names: &mut BTreeSet<String>) -> Result<(), String> {
    for run in &table.runs {
        if !names.insert(run.name.clone()) {
            return Err(format!("found a second run `{}`, expected names that differ", run.name));
        }
        if run.commands.is_empty() {
            return Err(format!("`{}`: found no command, expected one or more", run.name));
        }
        let mut whats = BTreeSet::new();
        for row in &run.rows {
            if row.figure.is_some() == row.line.is_some() {
                return Err(format!("`{}`, `{}`: expected either `figure` or `line`", run.name, row.what));
            }
            if !whats.insert(&row.what) {
                return Err(format!("`{}`: found a second row `{}`, expected names that differ", run.name, row.what));
            }
            if row.bound().is_none() && row.beside.is_empty() && row.peer.is_none() {
                return Err(format!(
                    "`{}`, `{}`: a claim needs a bound (`good`, `holds`), or something `beside` it",
                    run.name, row.what
                ));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(row: &str) -> Result<(), String> {
        let text = format!("title = 'T'\n[[run]]\nname = 'a'\ncommands = ['foveate run x.toml']\n{row}");
        check(&toml::from_str(&text).unwrap(), &mut BTreeSet::new())
    }

    #[test]
    fn bounds_read_both_ways() {
        let upper = Bound::try_from("<= 2.5".to_owned()).unwrap();
        assert!(upper.admits(2.5) && !upper.admits(2.6) && !upper.admits(f64::NAN));
        let lower = Bound::try_from(">=0.99".to_owned()).unwrap();
        assert!(lower.admits(0.99) && !lower.admits(0.98));
        assert!(Bound::try_from("2.5".to_owned()).is_err() && Bound::try_from("<= x".to_owned()).is_err());
    }

    #[test]
    fn rows_without_source_or_bound_and_doubled_names_are_refused() {
        assert_eq!(table("[[run.row]]\nwhat = 'w'\nfigure = 'f'\ngood = '<= 1'"), Ok(()));
        assert!(table("[[run.row]]\nwhat = 'w'\nfigure = 'f'").is_err());
        assert!(table("[[run.row]]\nwhat = 'w'\ngood = '<= 1'").is_err());
        let row = "[[run.row]]\nwhat = 'w'\nfigure = 'f'\ngood = '<= 1'\n";
        assert!(table(&row.repeat(2)).is_err());
    }

    #[test]
    fn strictest_bound_that_is_stated_holds_a_row() {
        let bound = |it: &str| Bound::try_from(it.to_owned()).unwrap();
        let mut row: Row = toml::from_str("what = 'w'\nfigure = 'f'\ngood = '<= 1'").unwrap();
        assert_eq!(row.bound(), Some(bound("<= 1")));
        row.good_worst = Some(bound("<= 2"));
        assert_eq!(row.bound(), Some(bound("<= 2")));
        row.holds = Some(bound("<= 3"));
        assert_eq!(row.bound(), Some(bound("<= 3")));
    }
}
