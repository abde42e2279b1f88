//! The figures of one rig over many seeds: middle, worst, failures, as JSON, as a table and as a picture.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use foveate_diagnostics::fields::field;
use foveate_diagnostics::names::likely;
use foveate_estimation::statistics::median;
use foveate_node::figure::Better;
use foveate_plot::{Axis, COLOURS, Chart, Figure, Series, nothing};
use serde_json::{Value, json};

use crate::results::number;

/// A figure that is not the seed's.
const SPEED: &str = "real_time_factor";

/// What became of one seed.
#[derive(Debug, Clone, PartialEq)]
pub struct SeedRun {
    /// The seed.
    pub seed: u64,
    /// Exit code of its run; `None`: a signal ended it.
    pub code: Option<u8>,
    /// What the run said on standard error, on one line; empty where all went well.
    pub said: String,
    /// Whether the run came to its end, with or without failures of nodes.
    pub is_whole: bool,
    /// Its figures by name; a figure without a value is left out.
    pub figures: BTreeMap<String, f64>,
    /// By figure: unit, and which values are better.
    pub about: BTreeMap<String, (String, Better)>,
}

impl SeedRun {
    /// Of the run with this `summary.json`; `None` as text where there is none.
    pub fn read(seed: u64, code: Option<u8>, said: &str, summary: Option<&str>) -> Self {
        let summary: Value = summary.and_then(|it| serde_json::from_str(it).ok()).unwrap_or_default();
        let values = summary.as_object().into_iter().flatten();
        // The speed is that of the machine, which runs several seeds at a time.
        let values = values.filter(|it| it.0 != SPEED);
        let figures = values.filter_map(|(name, value)| Some((name.clone(), value.as_f64()?))).collect();
        let about = summary["figures_about"].as_object().into_iter().flatten().map(|(name, about)| {
            let better = [Better::Low, Better::High].into_iter().find(|it| about["better"] == it.name());
            let unit = about["unit"].as_str().unwrap_or_default().to_owned();
            (name.clone(), (unit, better.unwrap_or(Better::Neither)))
        });
        let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
        let is_whole = summary["session_s"].is_number() && summary["interrupted"] != true;
        Self { seed, code, said, is_whole, about: about.collect(), figures }
    }

    /// Whether nothing failed; a requirement that was not met is no failure.
    pub fn is_sound(&self) -> bool {
        self.is_whole && matches!(self.code, Some(crate::exit::DONE | crate::exit::UNMET))
    }
}

/// One figure over all seeds whose runs came to their end.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    /// Unit, empty where none was declared.
    pub unit: String,
    /// Which values are better.
    pub better: Better,
    /// By seed, in their order.
    pub values: Vec<(u64, f64)>,
    /// Seeds whose runs came to their end without it.
    pub missing: Vec<u64>,
}

impl Spread {
    /// Half of the seeds lie on either side.
    pub fn median(&self) -> f64 {
        let values: Vec<f64> = self.values.iter().map(|it| it.1).collect();
        median(&values).unwrap_or(f64::NAN)
    }

    /// The lowest and the highest value, each with the first seed that has it.
    pub fn ends(&self) -> [(u64, f64); 2] {
        let first = self.values.first().copied().unwrap_or((0, f64::NAN));
        self.values.iter().fold([first; 2], |[low, high], &it| {
            [if it.1 < low.1 { it } else { low }, if it.1 > high.1 { it } else { high }]
        })
    }

    /// The worst seed and its value, where the figure has a better direction.
    pub fn worst(&self) -> Option<(u64, f64)> {
        let [low, high] = self.ends();
        match self.better {
            Better::Low => Some(high),
            Better::High => Some(low),
            Better::Neither => None,
        }
    }

    fn varies(&self) -> bool {
        let [low, high] = self.ends();
        low.1 < high.1
    }
}

/// A promise on a figure: `NAME<=VALUE` or `NAME>=VALUE` for every seed, `median NAME<=VALUE` for the middle of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Bound {
    name: String,
    is_of_median: bool,
    is_upper: bool,
    limit: f64,
}

impl std::str::FromStr for Bound {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected =
            || format!("found `{text}`, expected `FIGURE<=NUMBER`, `FIGURE>=NUMBER`, or `median ` before it");
        let parts = text.split_once("<=").map(|it| (it, true)).or_else(|| text.split_once(">=").map(|it| (it, false)));
        let ((name, limit), is_upper) = parts.ok_or_else(expected)?;
        let limit: f64 = limit.trim().parse().ok().filter(|it: &f64| it.is_finite()).ok_or_else(expected)?;
        let name = name.trim_start();
        let (name, is_of_median) = name.strip_prefix("median ").map_or((name, false), |it| (it, true));
        let name = name.trim();
        if name.is_empty() || name.contains(char::is_whitespace) {
            return Err(expected());
        }
        Ok(Self { name: name.to_owned(), is_of_median, is_upper, limit })
    }
}

impl std::fmt::Display for Bound {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let of = if self.is_of_median { "median " } else { "" };
        write!(f, "{of}{} {} {}", self.name, if self.is_upper { "<=" } else { ">=" }, self.limit)
    }
}

/// All seeds of one rig.
#[derive(Debug, Clone)]
pub struct Evaluation {
    /// Name of the rig.
    pub rig: String,
    /// In the order of the seeds.
    pub runs: Vec<SeedRun>,
    /// Whether a signal came before all seeds had their runs.
    pub interrupted: bool,
    /// How many seeds were requested.
    pub n_asked: usize,
}

impl Evaluation {
    /// By name: each figure that any whole run has.
    pub fn figures(&self) -> BTreeMap<&str, Spread> {
        let mut figures: BTreeMap<&str, Spread> = BTreeMap::new();
        let whole = || self.runs.iter().filter(|it| it.is_whole);
        for run in whole() {
            for (name, value) in &run.figures {
                let spread = figures.entry(name).or_insert_with(|| {
                    let (unit, better) = run.about.get(name).cloned().unwrap_or((String::new(), Better::Neither));
                    Spread { unit, better, values: Vec::new(), missing: Vec::new() }
                });
                spread.values.push((run.seed, *value));
            }
        }
        for (name, spread) in &mut figures {
            spread.missing = whole().filter(|it| !it.figures.contains_key(*name)).map(|it| it.seed).collect();
        }
        figures
    }

    /// Runs that did not come to their end.
    pub fn failed(&self) -> impl Iterator<Item = &SeedRun> {
        self.runs.iter().filter(|it| !it.is_whole)
    }

    /// Runs in which something failed, whether they came to their end or not.
    pub fn unsound(&self) -> impl Iterator<Item = &SeedRun> {
        self.runs.iter().filter(|it| !it.is_sound())
    }

    /// What is wrong with each bound that does not hold; a seed whose run failed, or has no such figure, does not keep a promise.
    pub fn broken(&self, bounds: &[Bound]) -> Vec<String> {
        let figures = self.figures();
        let n_failed = self.failed().count();
        let mut broken = Vec::new();
        for bound in bounds {
            let Some(spread) = figures.get(bound.name.as_str()) else {
                let names: Vec<&str> = figures.keys().copied().collect();
                let hint = likely(&bound.name, names.iter().copied());
                let hint = hint.map_or(String::new(), |it| format!("; did you mean `{it}`?"));
                broken.push(format!("{bound}: no run has this figure{hint}"));
                continue;
            };
            let [low, high] = spread.ends();
            let (seed, value) = match (bound.is_of_median, bound.is_upper) {
                (true, _) => (None, spread.median()),
                (false, true) => (Some(high.0), high.1),
                (false, false) => (Some(low.0), low.1),
            };
            let holds = if bound.is_upper { value <= bound.limit } else { value >= bound.limit };
            let at = seed.map_or(String::new(), |it| format!(" for seed {it}"));
            if !holds {
                broken.push(format!("{bound}: found {value}{at}"));
            } else if !bound.is_of_median && n_failed + spread.missing.len() > 0 {
                broken.push(format!(
                    "{bound}: {} of {} seeds have no value",
                    n_failed + spread.missing.len(),
                    self.runs.len()
                ));
            }
        }
        broken
    }

    /// `eval.json`.
    pub fn json(&self, duration_s: Option<f64>, bounds: &[Bound]) -> String {
        let figures = self.figures().into_iter().map(|(name, spread)| {
            let [low, high] = spread.ends();
            let end = |(seed, value): (u64, f64)| json!({ "value": number(value), "seed": seed });
            let values: Vec<Value> = spread.values.iter().map(|it| number(it.1)).collect();
            let about = json!({
                "unit": spread.unit, "better": spread.better.name(), "median": number(spread.median()),
                "worst": spread.worst().map(end), "lowest": end(low), "highest": end(high),
                "n": spread.values.len(), "missing": spread.missing, "values": values,
            });
            (name.to_owned(), about)
        });
        let told = |it: &SeedRun| json!({ "seed": it.seed, "exit_code": it.code, "said": it.said });
        let failed: Vec<Value> = self.failed().map(told).collect();
        let faulty: Vec<Value> = self.unsound().filter(|it| it.is_whole).map(told).collect();
        let whole: Vec<u64> = self.runs.iter().filter(|it| it.is_whole).map(|it| it.seed).collect();
        let unmet: Vec<u64> =
            self.runs.iter().filter(|it| it.code == Some(crate::exit::UNMET)).map(|it| it.seed).collect();
        let text = json!({
            "rig": self.rig, "duration_s": duration_s, "seeds": whole, "failed": failed,
            "with_failures_of_nodes": faulty, "requirements_unmet": unmet, "interrupted": self.interrupted,
            "bounds": bounds.iter().map(ToString::to_string).collect::<Vec<_>>(), "bounds_broken": self.broken(bounds),
            "figures": figures.collect::<serde_json::Map<_, _>>(),
        });
        format!("{text:#}\n")
    }

    /// `eval.csv`: a row for each figure and seed.
    pub fn csv(&self) -> String {
        let mut text = "figure,unit,better,seed,value\n".to_owned();
        for (name, spread) in self.figures() {
            let name = field(name);
            for (seed, value) in &spread.values {
                let value = if value.is_finite() { value.to_string() } else { String::new() };
                let _ = writeln!(text, "{name},{},{},{seed},{value}", spread.unit, spread.better.name());
            }
        }
        text
    }

    /// The table for people: figures with a better direction, those of single cameras together; with `all`, every figure.
    pub fn table(&self, cameras: &[String], all: bool) -> String {
        let mut rows: BTreeMap<String, Spread> = BTreeMap::new();
        for (name, spread) in self.figures() {
            if spread.better == Better::Neither && !all {
                continue;
            }
            let name = if all { name.to_owned() } else { without_camera(name, cameras) };
            match rows.entry(name) {
                std::collections::btree_map::Entry::Vacant(it) => drop(it.insert(spread)),
                std::collections::btree_map::Entry::Occupied(mut it) => it.get_mut().values.extend(spread.values),
            }
        }
        let mut cells = vec![["figure", "median", "worst", "seed", "best", "unit", "without"].map(str::to_owned)];
        for (name, spread) in rows {
            let [low, high] = spread.ends();
            let (worst, best) = if spread.better == Better::High { (low, high) } else { (high, low) };
            let missing = if spread.missing.is_empty() { String::new() } else { spread.missing.len().to_string() };
            let [median, worst_value, best_value] = [spread.median(), worst.1, best.1].map(short);
            let seed = if worst.1 == best.1 { String::new() } else { worst.0.to_string() };
            cells.push([name, median, worst_value, seed, best_value, spread.unit, missing]);
        }
        let widths: Vec<usize> =
            (0..7).map(|column| cells.iter().map(|it| it[column].chars().count()).max().unwrap_or(0)).collect();
        let mut text = String::new();
        let n_hidden = self.figures().values().filter(|it| it.better == Better::Neither).count();
        for row in cells {
            let mut line = String::new();
            for (column, (cell, width)) in row.iter().zip(&widths).enumerate() {
                let _ = match column {
                    0 | 5 => write!(line, "{cell:<width$}  "),
                    _ => write!(line, "{cell:>width$}  "),
                };
            }
            text += line.trim_end();
            text.push('\n');
        }
        if n_hidden > 0 && !all {
            let _ = writeln!(text, "… and {n_hidden} figures without a better direction (--all, eval.json)");
        }
        text
    }

    /// `eval.svg`: a frame for each figure that differs between seeds and has a better direction; a dot for each seed, a line at the median.
    pub fn picture(&self) -> String {
        let n_whole = self.runs.iter().filter(|it| it.is_whole).count();
        let title = match (self.interrupted, n_whole == self.n_asked) {
            (true, _) => format!("{}: {n_whole} of {} seeds, interrupted", self.rig, self.n_asked),
            (false, false) => format!("{}: {n_whole} of {} seeds, the others failed", self.rig, self.n_asked),
            (false, true) => format!("{}: {n_whole} seeds", self.rig),
        };
        let figures: Vec<(&str, Spread)> =
            self.figures().into_iter().filter(|(_, it)| it.better != Better::Neither && it.varies()).collect();
        if figures.is_empty() {
            return nothing(&title, "no figure with a better direction differs between seeds");
        }
        let charts = figures.iter().map(|(name, spread)| {
            let unit = if spread.unit.is_empty() { "–" } else { &spread.unit };
            let dots = spread.values.iter().enumerate().map(|(i, it)| [it.1, Axis::row(i)]).collect();
            let (middle, top) = (spread.median(), spread.values.len() as f64);
            let rows = spread.values.iter().map(|_| String::new());
            let x = Axis::new(format!("{} is better [{unit}]", spread.better.name()));
            Chart::new(*name, [250.0, 70.0], x, Axis::of_rows(rows))
                .with(Series::line("median", COLOURS[1], vec![[middle, 0.0], [middle, top]]))
                .with(Series::dots("one seed", COLOURS[0], dots))
        });
        Figure { title, n_columns: 3, charts: charts.collect() }.svg()
    }
}

/// A figure's name with `*` in place of a camera's name.
fn without_camera(name: &str, cameras: &[String]) -> String {
    let part = |it: &str| if cameras.iter().any(|camera| camera == it) { "*".to_owned() } else { it.to_owned() };
    name.split('.').map(part).collect::<Vec<_>>().join(".")
}

/// Four digits, and no more than a person reads.
fn short(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e6 {
        return format!("{value}");
    }
    match value.abs() {
        size if !(1e-3..1e6).contains(&size) => format!("{value:.2e}"),
        size if size >= 1000.0 => format!("{value:.0}"),
        size if size >= 100.0 => format!("{value:.1}"),
        size if size >= 10.0 => format!("{value:.2}"),
        _ => format!("{value:.3}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(seed: u64, error: Option<f64>, found: f64) -> SeedRun {
        let error = error.map_or("null".to_owned(), |it| it.to_string());
        let summary = format!(
            "{{ \"session_s\": 2, \"error_mm\": {error}, \"real_time_factor\": 0.7, \"found.wide-1\": {found}, \"n\": 3, \"interrupted\": false, \"figures_about\": {{ \
             \"error_mm\": {{ \"unit\": \"mm\", \"better\": \"low\" }}, \"found.wide-1\": {{ \"unit\": \"share\", \"better\": \"high\" }} }} }}"
        );
        SeedRun::read(seed, Some(0), "", Some(&summary))
    }

    fn evaluation() -> Evaluation {
        let failed = SeedRun::read(4, Some(2), "error: gone\nwide-1 is away", None);
        let runs = vec![run(1, Some(3.0), 0.5), run(2, Some(1.0), 0.9), run(3, None, 0.7), failed];
        Evaluation { rig: "room".to_owned(), runs, interrupted: false, n_asked: 4 }
    }

    fn bound(text: &str) -> Bound {
        text.parse().unwrap()
    }

    #[test]
    fn worst_is_what_the_figure_says_is_worse_and_what_has_no_value_is_named() {
        let evaluation = evaluation();
        let figures = evaluation.figures();
        let error = &figures["error_mm"];
        assert_eq!((error.median(), error.worst(), &error.missing[..]), (2.0, Some((1, 3.0)), &[3][..]));
        let found = &figures["found.wide-1"];
        assert_eq!((found.median(), found.worst()), (0.7, Some((1, 0.5))));
        assert_eq!(figures["n"].worst(), None);
        assert!(!figures.contains_key(SPEED));
        assert_eq!(evaluation.failed().map(|it| it.seed).collect::<Vec<_>>(), [4]);
        let json: Value = serde_json::from_str(&evaluation.json(Some(2.0), &[])).unwrap();
        assert_eq!(json["figures"]["error_mm"]["worst"], json!({ "value": 3, "seed": 1 }));
        assert_eq!(json["failed"][0]["said"], "error: gone wide-1 is away");
        assert_eq!(json["seeds"], json!([1, 2, 3]));
    }

    #[test]
    fn bounds_hold_for_every_seed_or_for_the_middle() {
        let mut evaluation = evaluation();
        let broken = |it: &Evaluation, text: &str| it.broken(&[bound(text)]);
        assert_eq!(broken(&evaluation, "median error_mm<=2"), Vec::<String>::new());
        assert_eq!(broken(&evaluation, "error_mm <= 2.5"), ["error_mm <= 2.5: found 3 for seed 1"]);
        assert_eq!(broken(&evaluation, "found.wide-1>=0.4"), ["found.wide-1 >= 0.4: 1 of 4 seeds have no value"]);
        assert_eq!(broken(&evaluation, "error_mm<=5"), ["error_mm <= 5: 2 of 4 seeds have no value"]);
        assert_eq!(
            broken(&evaluation, "eror_mm<=5"),
            ["eror_mm <= 5: no run has this figure; did you mean `error_mm`?"]
        );
        evaluation.runs.truncate(2);
        assert_eq!(broken(&evaluation, "error_mm<=3"), Vec::<String>::new());
        assert_eq!(broken(&evaluation, "found.wide-1>=0.6"), ["found.wide-1 >= 0.6: found 0.5 for seed 1"]);
        for text in ["error_mm", "error_mm<2", "<=2", "error_mm<=two", "error_mm<=NaN", "median <=1", "medain n<=1"] {
            assert!(text.parse::<Bound>().is_err(), "{text}");
        }
    }

    #[test]
    fn the_table_puts_cameras_together_and_shows_what_is_judged() {
        let evaluation = evaluation();
        let table = evaluation.table(&["wide-1".to_owned()], false);
        assert!(table.contains("found.*") && !table.contains("\nn "), "{table}");
        assert!(evaluation.table(&[], true).contains("\nn "));
        let row: Vec<&str> = table.lines().find(|it| it.starts_with("error_mm")).unwrap().split_whitespace().collect();
        assert_eq!(row, ["error_mm", "2", "3", "1", "1", "mm", "1"]);
    }

    #[test]
    fn pictures_show_what_differs_or_say_that_nothing_does() {
        let mut evaluation = evaluation();
        let drawn = evaluation.picture();
        assert!(drawn.starts_with("<svg") && drawn.contains("error_mm") && !drawn.contains("NaN"));
        assert!(drawn.contains("room: 3 of 4 seeds, the others failed"), "{drawn}");
        evaluation.interrupted = true;
        assert!(evaluation.picture().contains("room: 3 of 4 seeds, interrupted"));
        evaluation.runs.truncate(1);
        assert!(evaluation.picture().contains("differs between seeds"));
        evaluation.runs.clear();
        assert!(evaluation.picture().starts_with("<svg") && evaluation.table(&[], true).lines().count() == 1);
    }
}
