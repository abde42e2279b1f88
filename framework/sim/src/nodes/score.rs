//! Compares recovered targets with the truth: figures, and the truth as a file.

use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;
use std::path::PathBuf;

use foveate_messages::Targets;
use foveate_node::{
    ConfigError, Figures, Host, Io, Node, NodeError, Ports, Purpose, Report, Role, Setup, figures, ports,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::score::Scorer;

ports! {
    TRUTH: In<Targets> = each("truth");
    TARGETS: In<Targets> = each("targets");
}

figures! {
    "(*.)error_mm.{median,p95,rms}": mm, low, "Distance of a target from its true light at the same time, over all pairs within gate_mm and the volume" => "targets off the truth";
    "(*.)error_sigmas.rms": sigmas, neither, "Errors of targets over their stated standard deviations, for each axis: 1 is ideal, above 1 the tracker is overconfident";
    "(*.)gospa_mm.mean": mm, low, "GOSPA (p = 2, α = 2, cut-off gate_mm): errors, misses and false targets in one number, mean over messages, 0 where no target is there and none is found, and over the times at which none came";
    "(*.)mota": ratio, high, "MOTA (CLEAR MOT): 1 less missed lights, false and double targets and changes of identity, over true lights; may fall below 0";
    "(*.)idf1": share, high, "IDF1: targets whose identity is that of their light, each light and each identity having one partner for the whole run; harmonic mean of precision and recall";
    "(*.)hota": share, high, "HOTA: geometric mean of how many lights are found and of how long the identities of those that are found last; mean over 19 distances within gate_mm";
    "(*.)completeness": share, high, "Samples of the truth after which, before the next one, their light was matched; in the volume" => "part of the truth that is covered";
    "(*.)missed": share, low, "True lights in the volume without a target, over all scored messages and where none came though they should have";
    "(*.)false_targets": count, low, "Targets farther than gate_mm from any true light, mean over scored messages";
    "(*.)duplicates": count, low, "Unmatched targets with a true light within gate_mm, mean over scored messages";
    "(*.)id_switches": count, low, "Times that a light was matched to an identity that another light had last";
    "(*.)reinitialisations": count, low, "Times that a light was matched to a new identity after it had had another one";
    "(*.)identities_per_target": ratio, low, "Identities over true lights that were ever found; 1 is ideal" => "identities a light (1 is right)";
    "(*.)time_to_initiation_ms.median": ms, low, "From the first truth of a light in the volume to its first target; lights never found are left out";
    "(*.)targets_unborn": count, low, "True lights that were never matched, though in the volume at some time";
    "(*.)targets_true": count, neither, "True lights that were in the volume at some time since start_s";
    "(*.)identities": count, neither, "Identities of targets that were ever matched to a light";
    "(*.)scored_messages": count, neither, "Messages of targets that were compared with the truth; none before start_s";
    "(*.)unscored_messages": count, low, "Messages since start_s outside the time span of the truth, or that waited for it too long";
}

/// Name of the file with the truth in the folder for results.
const TRUTH_FILE: &str = "truth.csv";

/// Settings of [`Score`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ScoreSettings {
    /// Gate: a recovered target farther from a true one than this is not matched to it [mm].
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub gate_mm: f64,
    /// Session time at which scoring begins [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub start_s: f64,
    /// Prefix of the figures' names, as in `whole.error_mm.median`, to distinguish several scores of one rig; empty: none [–].
    pub label: String,
    /// Whether the truth is saved as `truth.csv` in the folder for results [–].
    pub write_truth: bool,
}

impl Default for ScoreSettings {
    fn default() -> Self {
        Self { gate_mm: 100.0, start_s: 0.0, label: String::new(), write_truth: true }
    }
}

/// The scoring sink; what it measures is listed at [`Scorer`].
pub struct Score {
    label: String,
    scorer: Scorer,
    truth_file: TruthFile,
}

impl Node for Score {
    const TYPE: &'static str = "sim.score";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Compares recovered targets with the truth of the simulated lab";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ScoreSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ScoreSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("gate_mm", settings.gate_mm, 1.0..=1000.0)?;
        ConfigError::unless_in("start_s", settings.start_s, 0.0..=1e6)?;
        if !settings.label.chars().all(|it| it.is_ascii_alphanumeric() || it == '_' || it == '-') {
            let message = format!("found `{}`, expected letters, digits, `_` and `-`", settings.label);
            return Err(ConfigError::at("label", message));
        }
        if settings.write_truth {
            setup.claim_file(Some("write_truth"), TRUTH_FILE)?;
        }
        let folder = setup.out_dir.as_ref().filter(|_| settings.write_truth && setup.purpose == Purpose::Run);
        Ok(Self {
            label: settings.label.clone(),
            scorer: Scorer::new(settings.gate_mm * 1e-3, settings.start_s, setup.volume_m),
            truth_file: TruthFile {
                path: folder.map(|it| it.join(TRUTH_FILE)),
                state: State::NotYet,
                host: setup.host.clone(),
                instance: setup.instance.clone(),
            },
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(truth) = io.take(&TRUTH) {
            self.truth_file.write(&truth.value);
            self.scorer.truth(truth.value);
        }
        if let Some(targets) = io.take(&TARGETS) {
            self.scorer.recovered(targets.value);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let mut own = Report::default();
        self.scorer.finish(&mut own);
        for (name, value) in own.figures {
            let name = if self.label.is_empty() { name } else { format!("{}.{name}", self.label) };
            report.figure(name, value);
        }
        let name = if self.label.is_empty() { "targets" } else { &self.label };
        own.remarks.into_iter().for_each(|it| report.remark(format!("{name}: {it}")));
        self.truth_file.finish(report)
    }
}

/// `truth.csv`, in whole rows at any time. An error ends the writing, not the scoring; it is reported at once and at the end.
struct TruthFile {
    path: Option<PathBuf>,
    state: State,
    host: Host,
    instance: String,
}

enum State {
    NotYet,
    Open(File),
    Failed(std::io::Error),
}

impl TruthFile {
    fn write(&mut self, truth: &Targets) {
        let Some(path) = &self.path else { return };
        if let State::NotYet = self.state {
            let opened = File::create(path).and_then(|mut file| {
                file.write_all(b"time_s,target,x_m,y_m,z_m\n")?;
                Ok(file)
            });
            self.state = opened.map_or_else(State::Failed, State::Open);
        } else if let State::Failed(_) = self.state {
            return;
        }
        if let State::Open(file) = &mut self.state
            && let Err(error) = file.write_all(rows(truth).as_bytes())
        {
            self.state = State::Failed(error);
        }
        if let State::Failed(error) = &self.state {
            self.host.warn(&self.instance, &format!("`{}` cannot be written ({error})", path.display()));
        }
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Some(path) = &self.path else { return Ok(()) };
        let flushed = match &mut self.state {
            State::NotYet => return Ok(()),
            State::Open(_) => Ok(()),
            State::Failed(error) => Err(std::io::Error::new(error.kind(), error.to_string())),
        };
        match flushed {
            Ok(()) => {
                report.file(TRUTH_FILE);
                Ok(())
            }
            Err(error) => Err(NodeError::input(format_args!(
                "{}: the truth could not be saved ({error}), expected a folder that can be written; the figures are complete",
                path.display()
            ))),
        }
    }
}

fn rows(truth: &Targets) -> String {
    let time = truth.time.as_s();
    let mut text = String::new();
    for target in &truth.list {
        let p = target.position;
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{time:.6},{},{:.6},{:.6},{:.6}", target.id.0, p.x, p.y, p.z);
    }
    text
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_the_law() {
        check_node::<Score>("");
        check_node::<Score>("label = \"whole\"\nwrite_truth = false");
    }

    #[test]
    fn a_label_stands_before_every_figure_and_is_a_word() {
        let settings = ScoreSettings { label: "whole".to_owned(), ..ScoreSettings::default() };
        let mut score = Score::new(settings, &Setup::for_tests()).unwrap();
        score.scorer.truth(Arc::new(Targets::default()));
        let mut report = Report::default();
        score.finish(&mut report).unwrap();
        assert!(!report.figures.is_empty() && report.figures.keys().all(|it| it.starts_with("whole.")), "{report:?}");
        let settings = ScoreSettings { label: "a.b".to_owned(), ..ScoreSettings::default() };
        assert!(Score::new(settings, &Setup::for_tests()).is_err_and(|it| it.setting.as_deref() == Some("label")));
    }
}
