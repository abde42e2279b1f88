//! All findings in a few sentences, the most important first.

use super::camera::{length, weakest};
use super::{Candidate, CheckOptions, Checks, Judgement, Level};
use crate::cause::Cause;

/// The summary of all checks: the level of a calibration, and what to do.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Verdict {
    /// The worst of all levels.
    pub level: Level,
    /// What was found and what to do about it, the most important first.
    pub sentences: Vec<String>,
    /// Number of further findings that need action.
    pub more: usize,
    /// The camera that is known least, relative to its distance from the light.
    pub weakest: Option<usize>,
}

pub(super) fn verdict(checks: &Checks, options: &CheckOptions) -> Verdict {
    // In the order in which they should be mended: what is wrong with a camera explains much of what follows.
    let candidates = checks.candidates.iter().map(|it| &it.judgement);
    let (harmless, harmful): (Vec<&Candidate>, Vec<&Candidate>) =
        checks.candidates.iter().partition(|it| it.judgement.level == Level::Good);
    let accused: Vec<usize> = harmful.iter().map(|it| it.camera).collect();
    let others = checks.cameras.iter().enumerate().filter(|(index, _)| !accused.contains(index));
    let cameras = others.map(|(_, it)| &it.judgement);
    let whole = [&checks.handedness.judgement, &checks.floor.judgement];
    let rest = [&checks.links.judgement, &checks.path.judgement];
    let lengths = checks.lengths.iter().map(|it| &it.judgement);
    let all: Vec<&Judgement> = whole
        .into_iter()
        .chain(candidates)
        .chain(rest)
        .chain(lengths)
        .chain(cameras)
        .chain([&checks.fit.judgement])
        .collect();
    let mut findings: Vec<&Judgement> = all.iter().copied().filter(|it| it.level > Level::Good).collect();
    findings.sort_by_key(|it| std::cmp::Reverse(it.level));
    let uncalibrated = checks.cameras.iter().filter(|it| !it.calibrated).count();
    let level = findings.first().map_or(Level::Good, |it| it.level);
    let level = if 2 * uncalibrated >= checks.cameras.len() { Level::Redo } else { level };
    let mut sentences: Vec<String> = Vec::new();
    let is_unexplained =
        |it: &&Candidate| it.judgement.level == Level::Redo && matches!(it.cause, Cause::Unknown { .. });
    let contradicting = checks.candidates.iter().filter(is_unexplained).count();
    if 2 * contradicting >= checks.cameras.len().max(1) {
        sentences.push(format!(
            "{contradicting} of {} cameras contradict the rest: check these first, then record again with no other light in the room.",
            checks.cameras.len()
        ));
    }
    for finding in &findings {
        // Swapped cameras say the same of each other.
        if !sentences.contains(&finding.sentence) {
            sentences.push(finding.sentence.clone());
        }
    }
    let more = sentences.len().saturating_sub(options.max_sentences);
    sentences.truncate(options.max_sentences);
    let weakest = weakest(&checks.cameras);
    if sentences.is_empty()
        && let Some(camera) = weakest
    {
        let check = &checks.cameras[camera];
        let known = check.pose.map_or(String::new(), |it| format!(" ({})", length(it.centre_sigma, checks.unit)));
        let place = check.wave.clone().unwrap_or_else(|| "more in front of it".to_owned());
        sentences.push(format!(
            "No action is needed; camera {} is the least certain{known}: to improve it, wave {place}.",
            check.name
        ));
    }
    // What did no harm is told where there is room for it.
    let network = options.max_sentences - sentences.len().min(options.max_sentences);
    sentences.extend(harmless.iter().take(network).map(|it| it.judgement.sentence.clone()));
    Verdict { level, sentences, more, weakest }
}
