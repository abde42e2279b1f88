//! A laboratory of its own for each seed: its truth drawn by that seed, its calibration found by commands of this program, as a person finds it.

use std::ffi::OsStr;
use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Instant, UNIX_EPOCH};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::exit;
use crate::results::write_whole;

/// Where calibrations that were found are kept, so that the same laboratory is calibrated once.
const KEPT: &str = "results/worlds";
/// Larger files beside a rig are no part of it [bytes].
const LARGEST: u64 = 4 << 20;
/// A calibration that simulations write for people to compare with.
const TRUTH: &str = "truth.calibration.toml";
const ENDING: &str = ".calibration.toml";
/// Words of a command that failed that are passed on.
const MOST_SAID: usize = 300;

/// How calibrations are found.
pub(super) struct Recipe {
    program: PathBuf,
    /// Of the rig that is evaluated.
    folder: PathBuf,
    rig: PathBuf,
    /// The file that the rig reads, by its name in that folder.
    calibration: PathBuf,
    commands: Vec<Vec<String>>,
}

/// A laboratory whose calibration has been found.
pub(super) struct World {
    /// The rig in it.
    pub rig: PathBuf,
    /// How long that took, when it was done [s].
    pub calibrated_s: f64,
}

impl Recipe {
    /// `commands` are those of this program, `calibrate …` and `run …`, on rigs that lie beside `rig`.
    ///
    /// # Errors
    ///
    /// A sentence: a command that is none of these, a rig whose calibration lies elsewhere.
    pub fn new(program: &Path, rig: &Path, commands: &[String]) -> Result<Recipe, String> {
        let split = |command: &String| {
            let words =
                words(command).ok_or_else(|| format!("--calibrate `{command}` opens a quote and never closes it"))?;
            match words.first().map(String::as_str) {
                Some("calibrate" | "run") => Ok(words),
                _ => Err(format!("--calibrate `{command}`: expected a command `calibrate RIG …` or `run RIG …`")),
            }
        };
        let commands = commands.iter().map(split).collect::<Result<_, _>>()?;
        let text = fs::read_to_string(rig).map_err(|it| format!("`{}` cannot be read: {it}", rig.display()))?;
        let calibration =
            string_at(&text, &["rig", "calibration"]).filter(|it| Path::new(it).file_name() == Some(OsStr::new(it)));
        let Some(calibration) = calibration else {
            return Err(format!(
                "`{}` has no calibration that lies beside it, expected one for --calibrate to replace",
                rig.display()
            ));
        };
        let folder = rig.parent().filter(|it| !it.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = rig.file_name().map(PathBuf::from).unwrap_or_default();
        Ok(Recipe {
            program: program.to_owned(),
            folder: folder.to_owned(),
            rig: name,
            calibration: calibration.into(),
            commands,
        })
    }

    /// Makes the laboratory of `seed` in `folder`, and calibrates it, unless that has been done before.
    ///
    /// # Errors
    ///
    /// A sentence: files that cannot be copied, a rig without a truth to draw, a command that failed.
    pub fn world(&self, seed: u64, folder: &Path) -> Result<World, String> {
        let _ = fs::remove_dir_all(folder);
        let mut hasher = DefaultHasher::new();
        let plan = self.copy(seed, folder, &mut hasher).map_err(|it| format!("the laboratory of seed {seed}: {it}"))?;
        let rig = folder.join(&self.rig);
        let calibration = folder.join(&self.calibration);
        if let Ok(about) = fs::metadata(&self.program) {
            let made = about.modified().ok().and_then(|it| it.duration_since(UNIX_EPOCH).ok());
            (about.len(), made).hash(&mut hasher);
        }
        self.commands.hash(&mut hasher);
        let kept = Path::new(KEPT).join(format!("{:016x}{ENDING}", hasher.finish()));
        let took = kept.with_extension("seconds");
        let known = || Some((fs::read(&kept).ok()?, fs::read_to_string(&took).ok()?.trim().parse().ok()?));
        if let Some((bytes, calibrated_s)) = known() {
            write_whole(&calibration, &bytes)?;
            return Ok(World { rig, calibrated_s });
        }
        // What is known beforehand is the plan.
        fs::copy(folder.join(plan), &calibration)
            .map_err(|it| format!("the plan of the laboratory cannot be copied: {it}"))?;
        let began = Instant::now();
        for (index, command) in self.commands.iter().enumerate() {
            let results = folder.join(format!("calibrating-{}", index + 1));
            self.obey(command, folder, &results)?;
            if let Some(found) = calibration_in(&results) {
                fs::copy(&found, &calibration).map_err(|it| format!("`{}` cannot be copied: {it}", found.display()))?;
            }
        }
        let calibrated_s = (began.elapsed().as_secs_f64() * 10.0).round() / 10.0;
        let bytes = fs::read(&calibration).map_err(|it| format!("`{}` cannot be read: {it}", calibration.display()))?;
        // Where it cannot be kept it is found again the next time.
        if fs::create_dir_all(KEPT).is_ok() && write_whole(&kept, &bytes).is_ok() {
            let _ = write_whole(&took, format!("{calibrated_s}\n").as_bytes());
        }
        Ok(World { rig, calibrated_s })
    }

    /// Copies what lies beside the rig, with the truth drawn by `seed` wherever there is one; the plan of that of the rig itself.
    fn copy(&self, seed: u64, folder: &Path, hasher: &mut DefaultHasher) -> Result<String, String> {
        let said = |error: std::io::Error| error.to_string();
        fs::create_dir_all(folder).map_err(said)?;
        let mut files: Vec<PathBuf> =
            fs::read_dir(&self.folder).map_err(said)?.filter_map(|it| Some(it.ok()?.path())).collect();
        files.sort();
        let mut plan = None;
        for file in files {
            let Some(name) =
                file.file_name().filter(|_| fs::metadata(&file).is_ok_and(|it| it.is_file() && it.len() <= LARGEST))
            else {
                continue;
            };
            let mut bytes = fs::read(&file).map_err(said)?;
            if let Some((text, drawn_around)) = std::str::from_utf8(&bytes).ok().and_then(|it| with_seed(it, seed)) {
                bytes = text.into_bytes();
                if name == self.rig.as_os_str() {
                    plan = Some(drawn_around);
                }
            }
            if name != self.calibration.as_os_str() {
                (name, &bytes).hash(hasher);
            }
            write_whole(&folder.join(name), &bytes)?;
        }
        plan.ok_or_else(|| {
            format!(
                "`{}` has no `sim.lab` with `truth = {{ plan = \"…\" }}` in it, which --calibrate expects to draw another laboratory",
                self.rig.display()
            )
        })
    }

    fn obey(&self, command: &[String], folder: &Path, results: &Path) -> Result<(), String> {
        let results = results.file_name().unwrap_or_default();
        let mut child = Command::new(&self.program);
        child.args(command).arg("--quiet").arg("--out").arg(results).current_dir(folder).stdin(Stdio::null());
        // A path from here is none from there.
        let data = foveate_node::setup::expand_path("${FOVEATE_DATA}", Path::new("")).ok();
        if let Some(data) = data.and_then(|it| fs::canonicalize(it).ok()) {
            child.env("FOVEATE_DATA", data);
        }
        let output = child.output().map_err(|it| format!("it cannot be started: {it}"))?;
        if output.status.code() == Some(i32::from(exit::DONE)) {
            return Ok(());
        }
        let said = String::from_utf8_lossy(&output.stderr);
        let said: String = said.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(MOST_SAID).collect();
        let how = output.status.code().map_or("a signal ended it".to_owned(), |it| format!("exit code {it}"));
        Err(format!("`{}` failed ({how}): {said}", command.join(" ")))
    }
}

/// The calibration that a command left among its results.
fn calibration_in(results: &Path) -> Option<PathBuf> {
    let mut found: Vec<PathBuf> = fs::read_dir(results).ok()?.filter_map(|it| Some(it.ok()?.path())).collect();
    found.retain(|it| it.file_name().and_then(OsStr::to_str).is_some_and(|it| it.ends_with(ENDING) && it != TRUTH));
    found.sort();
    found.into_iter().next()
}

/// A command line taken apart: blanks part words, but for those between quotes. `None`: a quote that never closes.
fn words(text: &str) -> Option<Vec<String>> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    for letter in text.chars() {
        match quote {
            Some(it) if it == letter => quote = None,
            None if letter == '\'' || letter == '"' => {
                quote = Some(letter);
                word.get_or_insert_default();
            }
            None if letter.is_whitespace() => words.extend(word.take()),
            _ => word.get_or_insert_default().push(letter),
        }
    }
    words.extend(word);
    quote.is_none().then_some(words)
}

fn string_at(text: &str, path: &[&str]) -> Option<String> {
    let document = DeTable::parse(text).ok()?.into_inner();
    let (last, tables) = path.split_last()?;
    let table = tables.iter().try_fold(&document, |table, key| table.get(*key)?.get_ref().as_table())?;
    Some(table.get(*last)?.get_ref().as_str()?.to_owned())
}

/// A rig with `seed` at the truth of each of its laboratories, and the plan that the first is drawn around; `None` where there is none.
fn with_seed(text: &str, seed: u64) -> Option<(String, String)> {
    let document = DeTable::parse(text).ok()?.into_inner();
    let scales = document.get("scale")?.get_ref().as_table()?;
    let nodes = scales.values().filter_map(|it| it.get_ref().as_table()?.get("node")?.get_ref().as_table());
    let nodes = nodes.flat_map(|it| it.values()).filter_map(|it| it.get_ref().as_table());
    let labs = nodes.filter(|it| it.get("type").and_then(|it| it.get_ref().as_str()) == Some("sim.lab"));
    let mut truths: Vec<&Spanned<DeValue<'_>>> = labs.filter_map(|it| it.get("truth")).collect();
    truths.sort_by_key(|it| it.span().start);
    let plan = truths.first()?.get_ref().as_table()?.get("plan")?.get_ref().as_str()?.to_owned();
    let mut changed = text.to_owned();
    // From the last on: what stands before keeps its place.
    for truth in truths.into_iter().rev() {
        let span = truth.span();
        match truth.get_ref().as_table()?.get("seed") {
            Some(old) => changed.replace_range(old.span(), &seed.to_string()),
            None if text[span.clone()].starts_with('{') => {
                changed.insert_str(span.start + 1, &format!(" seed = {seed},"))
            }
            None => {
                let line = text[span.start..].find('\n').map_or(text.len(), |it| span.start + it);
                changed.insert_str(line, &format!("\nseed = {seed}"));
            }
        }
    }
    Some((changed, plan))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_line_is_taken_apart_as_shells_do() {
        let command = "calibrate wave.toml  --cameras 'wide-*' --from \"a b\" ''";
        let expected = ["calibrate", "wave.toml", "--cameras", "wide-*", "--from", "a b", ""].map(str::to_owned);
        assert_eq!(words(command), Some(expected.to_vec()));
        assert_eq!((words("run 'a"), words(" ")), (None, Some(Vec::new())));
    }

    #[test]
    fn the_seed_of_a_laboratory_is_set_however_it_is_written() {
        let rig = |truth: &str| {
            format!(
                "[scale.room.node.lab]\ntype = \"sim.lab\"\n{truth}\n[scale.room.node.other]\ntype = \"x\"\nseed = 9\n"
            )
        };
        let seed_in = |truth: &str| {
            let (text, plan) = with_seed(&rig(truth), 77)?;
            assert!(text.ends_with("seed = 9\n") && plan == "a.toml", "{text}");
            let document: toml::Table = text.parse().unwrap();
            document["scale"]["room"]["node"]["lab"]["truth"]["seed"].as_integer()
        };
        assert_eq!(seed_in("truth = { plan = \"a.toml\" }"), Some(77));
        assert_eq!(seed_in("truth = { seed = 3, plan = \"a.toml\" }"), Some(77));
        assert_eq!(seed_in("[scale.room.node.lab.truth]\nplan = \"a.toml\""), Some(77));
        assert_eq!(seed_in("[scale.room.node.lab.truth]\nplan = \"a.toml\"\nseed = 1"), Some(77));
        assert_eq!(seed_in("rate_hz = 3"), None);
        assert_eq!(with_seed("[broken", 1), None);
    }
}
