//! Runs the commands of a claim and reads its figures.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use foveate_testkit::data::data_dir;
use serde_json::Value;

use super::claims::{Place, Row, Run};
use super::measured::{Measurement, Reading};

/// Most bytes of a command's output that a message shows.
const MOST_SHOWN: usize = 600;

/// Where commands run, and with which programs.
#[derive(Debug)]
pub struct Workshop {
    /// Root of the repository.
    pub root: PathBuf,
    /// The program `foveate`.
    pub program: PathBuf,
    /// Folder for results and for the Python of peers.
    pub scratch: PathBuf,
    /// Short hash of the commit, `+` behind it where files were changed since.
    pub commit: String,
}

/// Why a run gave no figures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Missing {
    /// The machine lacks something that the run needs; the sentence says what.
    Skipped(String),
    /// A command failed or did not give what the claim names.
    Failed(String),
}

impl Workshop {
    /// Finds the commit, and builds the program in the profile of this one unless there is one already.
    ///
    /// # Errors
    /// Why the program cannot be built.
    pub fn new(root: PathBuf, program: Option<PathBuf>) -> Result<Self, String> {
        let git = |args: &[&str]| {
            let output = Command::new("git").args(args).current_dir(&root).output().ok()?;
            output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
        };
        let is_changed = git(&["status", "--porcelain", "--", ".", ":!docs", ":!tests/results", ":!*.md"])
            .is_none_or(|it| !it.is_empty());
        let commit = git(&["rev-parse", "--short=8", "HEAD"]).unwrap_or("unknown".to_owned());
        let here = std::env::current_exe().map_err(|error| format!("this program cannot be found: {error}"))?;
        let folder = here.parent().unwrap_or(&root);
        let program = match program {
            Some(program) => program.canonicalize().map_err(|error| format!("{}: {error}", program.display()))?,
            None => build(&root, folder)?,
        };
        let scratch = folder.join("results-scratch");
        let commit = if is_changed { commit + "+" } else { commit };
        Ok(Self { root, program, scratch, commit })
    }

    /// Runs all commands of `run` and reads its rows.
    ///
    /// # Errors
    /// What the machine lacks, or which command failed and how.
    pub fn measure(&self, run: &Run) -> Result<Measurement, Missing> {
        let data = data_dir().filter(|_| run.data);
        for needed in &run.needs {
            if data.as_ref().is_none_or(|it| !it.join(needed).exists()) {
                return Err(Missing::Skipped(format!("FOVEATE_DATA lacks `{needed}`")));
            }
        }
        let python = self.python(&run.python);
        let out = self.scratch.join(&run.name);
        drop(fs::remove_dir_all(&out));
        fs::create_dir_all(&out).map_err(|error| Missing::Failed(format!("{}: {error}", out.display())))?;
        let began = Instant::now();
        let mut printed = String::new();
        for command in &run.commands {
            printed += &self.command(command, &out, python.as_deref(), data.as_deref(), run.exit)?;
        }
        let seconds = began.elapsed().as_secs_f64();
        drop(fs::write(out.join("printed.txt"), &printed));
        let figures = figures(&out);
        let mut values = BTreeMap::new();
        for row in &run.rows {
            let reading = read(row, &figures, &printed)
                .ok_or_else(|| Missing::Failed(format!("`{}` gave no `{}`", run.commands.join("; "), row.what)))?;
            values.insert(row.what.clone(), reading);
        }
        for picture in &run.pictures {
            let (from, to) = (out.join(&picture.from), self.root.join("docs/pictures").join(&picture.to));
            fs::copy(&from, &to).map_err(|error| Missing::Failed(format!("{}: {error}", from.display())))?;
        }
        Ok(Measurement { commit: self.commit.clone(), seconds, values })
    }

    fn command(
        &self,
        line: &str,
        out: &Path,
        python: Option<&Path>,
        data: Option<&Path>,
        exit: i32,
    ) -> Result<String, Missing> {
        let out_name = out.display().to_string();
        let mut words = line.split_whitespace().map(|it| it.replace("{out}", &out_name));
        let first = words.next().unwrap_or_default();
        let mut command = match first.as_str() {
            "foveate" => Command::new(&self.program),
            "cargo" => cargo(&self.root),
            "python3" => Command::new(python.map_or(OsString::from("python3"), OsString::from)),
            other => Command::new(other),
        };
        let words: Vec<String> = words.collect();
        command.args(&words).current_dir(&self.root).stdin(Stdio::null()).stderr(Stdio::piped());
        let writes_results = matches!(words.first().map(String::as_str), Some("run" | "eval" | "calibrate"));
        if first == "foveate" && writes_results && !words.iter().any(|it| it == "--out") {
            command.arg("--out").arg(out);
        }
        // A folder that is not there: without the variable, rigs look beside the workspace.
        command.env("FOVEATE_DATA", data.unwrap_or(&out.join("no-recordings")));
        if let Some(python) = python {
            command.env("FOVEATE_PEER_PYTHON", python).env("FOVEATE_PYTHON", python);
        }
        let output = command.output().map_err(|error| Missing::Failed(format!("`{line}`: {error}")))?;
        if output.status.code() != Some(exit) {
            let said = String::from_utf8_lossy(&output.stderr);
            let from = said.len().saturating_sub(MOST_SHOWN);
            let from = (from..=said.len()).find(|it| said.is_char_boundary(*it)).unwrap_or(0);
            return Err(Missing::Failed(format!("`{line}` ended with {}: …{}", output.status, &said[from..])));
        }
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }

    /// A Python with `packages`, made once; none where they do not install.
    fn python(&self, packages: &[String]) -> Option<PathBuf> {
        if packages.is_empty() {
            return None;
        }
        let folder = self.scratch.join("python");
        let python = folder.join("bin/python");
        let quiet = |command: &mut Command| {
            command.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|it| it.success())
        };
        let is_there = python.exists() || quiet(Command::new("python3").args(["-m", "venv"]).arg(&folder));
        let install = || quiet(Command::new(&python).args(["-m", "pip", "install", "--quiet"]).args(packages));
        (is_there && install()).then_some(python)
    }
}

/// Builds `foveate` into `folder`.
fn build(root: &Path, folder: &Path) -> Result<PathBuf, String> {
    let mut command = cargo(root);
    command.args(["build", "--quiet", "--locked", "-p", "foveate-cli"]);
    if folder.ends_with("release") {
        command.arg("--release");
    }
    match command.status() {
        Ok(status) if status.success() => Ok(folder.join(format!("foveate{}", std::env::consts::EXE_SUFFIX))),
        Ok(status) => Err(format!("`cargo build -p foveate-cli` ended with {status}")),
        Err(error) => Err(format!("`cargo build -p foveate-cli`: {error}")),
    }
}

/// Cargo, as it was called; without what it sets for programs that it runs.
fn cargo(root: &Path) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
    command.current_dir(root);
    command
}

/// `summary.json` or `eval.json` of a results folder.
fn figures(folder: &Path) -> Value {
    let read = |name: &str| {
        let text = fs::read_to_string(folder.join(name)).ok()?;
        serde_json::from_str(&text).ok()
    };
    read("eval.json").or_else(|| read("summary.json")).unwrap_or(Value::Null)
}

fn read(row: &Row, figures: &Value, printed: &str) -> Option<Reading> {
    let peer = row.peer.as_ref().and_then(|it| find(printed, &it.at).map(|value| value * it.times));
    let (median, worst) = match (&row.figure, &row.line) {
        (Some(name), _) => figure(figures, name, row.bound().is_none_or(|it| it.is_upper))?,
        (None, Some(place)) => (find(printed, place)?, None),
        (None, None) => return None,
    };
    Some(Reading { median: median * row.times, worst: worst.map(|it| it * row.times), peer })
}

/// Median and worst of an evaluation, or the only value of a run. Where a figure does not say which way is better, `low_is_good` does.
fn figure(figures: &Value, name: &str, low_is_good: bool) -> Option<(f64, Option<f64>)> {
    let Some(of_seeds) = figures.get("figures").and_then(Value::as_object) else {
        return figures.get(name)?.as_f64().map(|it| (it, None));
    };
    let spread = of_seeds.get(name)?;
    let end = |key: &str| spread.get(key)?.get("value")?.as_f64();
    let worst = end("worst").or_else(|| end(if low_is_good { "highest" } else { "lowest" }));
    Some((spread.get("median")?.as_f64()?, worst))
}

/// The number at `place` in what a command printed.
fn find(printed: &str, place: &Place) -> Option<f64> {
    let mut lines = printed.lines().skip_while(|it| !it.contains(&place.below));
    let line = lines.find(|it| it.contains(&place.line))?;
    let rest = if place.after.is_empty() { line } else { line.split_once(&place.after)?.1 };
    numbers(rest).nth(place.number.checked_sub(1)?)
}

/// All numbers in a line: digits with a sign, a point and an exponent; commas between thousands are left out.
fn numbers(line: &str) -> impl Iterator<Item = f64> {
    let is_part = |it: char| it.is_ascii_digit() || matches!(it, '.' | ',' | '-' | 'e' | 'E' | '+');
    line.split(move |it: char| !is_part(it)).filter_map(|word| {
        let word = word.trim_matches([',', '.']).replace(',', "");
        word.contains(|it: char| it.is_ascii_digit()).then(|| word.parse().ok()).flatten()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_found_in_what_people_read() {
        let all: Vec<f64> = numbers("640x480: median 1.52 ms, least -3e-5 (20,762 of 76,755), 2.").collect();
        assert_eq!(all, [640.0, 480.0, 1.52, -3e-5, 20_762.0, 76_755.0, 2.0]);
        let place = Place { below: String::new(), line: "median".to_owned(), after: "least".to_owned(), number: 2 };
        let printed = "nothing\na median 1, least 2, 3\npeer\nmedian least 4 5";
        assert_eq!(find(printed, &place), Some(3.0));
        assert_eq!(find(printed, &Place { below: "peer".to_owned(), ..place.clone() }), Some(5.0));
        assert_eq!(find("nothing", &place), None);
    }

    #[test]
    fn figures_come_from_runs_and_evaluations() {
        let run = serde_json::json!({ "error_mm": 1.5 });
        assert_eq!(figure(&run, "error_mm", true), Some((1.5, None)));
        let eval = serde_json::json!({ "figures": {
            "error_mm": { "median": 1.5, "worst": { "value": 2.0, "seed": 3 } },
            "n": { "median": 5.0, "worst": null, "lowest": { "value": 4.0, "seed": 1 }, "highest": { "value": 9.0, "seed": 2 } },
        } });
        assert_eq!(figure(&eval, "error_mm", true), Some((1.5, Some(2.0))));
        assert_eq!(figure(&eval, "n", true), Some((5.0, Some(9.0))));
        assert_eq!(figure(&eval, "n", false), Some((5.0, Some(4.0))));
        assert_eq!(figure(&eval, "other", true), None);
    }
}
