//! The checks as plain text, for terminals and reports.

use std::fmt::{Display, Formatter, Result};

use super::camera::length;
use super::{Checks, Level, Verdict};

impl Display for Level {
    fn fmt(&self, to: &mut Formatter<'_>) -> Result {
        to.pad(match self {
            Level::Good => "good",
            Level::Usable => "usable",
            Level::Redo => "redo",
        })
    }
}

impl Display for Verdict {
    fn fmt(&self, to: &mut Formatter<'_>) -> Result {
        writeln!(to, "verdict: {}", self.level)?;
        for (index, sentence) in self.sentences.iter().enumerate() {
            writeln!(to, "  {}. {sentence}", index + 1)?;
        }
        if self.more > 0 {
            writeln!(to, "  and {} more below", self.more)?;
        }
        Ok(())
    }
}

impl Display for Checks {
    fn fmt(&self, to: &mut Formatter<'_>) -> Result {
        write!(to, "{}", self.verdict)?;
        writeln!(to)?;
        let lengths = self.lengths.as_ref().map(|it| ("length", &it.judgement));
        let parts = [
            ("fit", &self.fit.judgement),
            ("handedness", &self.handedness.judgement),
            ("floor", &self.floor.judgement),
            ("path", &self.path.judgement),
            ("links", &self.links.judgement),
        ];
        for (name, judgement) in parts.into_iter().chain(lengths) {
            writeln!(to, "{name:<11} {:<7} {}", judgement.level, judgement.sentence)?;
        }
        for (index, candidate) in self.candidates.iter().enumerate() {
            // Two that were exchanged say the same of each other.
            if self.candidates[..index].iter().any(|it| it.judgement.sentence == candidate.judgement.sentence) {
                continue;
            }
            let name = if candidate.judgement.level == Level::Good { "note" } else { "candidate" };
            writeln!(to, "{name:<11} {:<7} {}", candidate.judgement.level, candidate.judgement.sentence)?;
        }
        writeln!(to)?;
        let wide = self.cameras.iter().map(|it| it.name.chars().count()).max().unwrap_or(0).max(6);
        writeln!(
            to,
            "{:<wide$}  level   used   held out  rejected   px used / out  depth far/near  centre ±      turn ±     pattern",
            "camera"
        )?;
        for (camera, medians) in self.cameras.iter().zip(&self.fit.by_camera) {
            let px = |it: Option<f64>| it.map_or_else(|| "–".to_owned(), |it| format!("{it:.2}"));
            let ratio = camera.depth.map_or_else(|| "–".to_owned(), |it| format!("{:.2}", it.ratio));
            let centre = camera.pose.map_or_else(|| "–".to_owned(), |it| length(it.centre_sigma, self.unit));
            let turn = camera.pose.map_or_else(|| "–".to_owned(), |it| format!("{:.2} mrad", 1e3 * it.turn_sigma));
            let pattern = camera.residuals.as_ref().map(|it| match it.pattern {
                Some(pattern) => format!("{pattern:?}, {:.2} px", it.systematic_px).to_lowercase(),
                None => "none".to_owned(),
            });
            let [used, back, rejected] = camera.observations;
            let medians = format!("{} / {}", px(medians[0]), px(medians[1]));
            writeln!(
                to,
                "{:<wide$}  {:<6} {used:>5}  {back:>9}  {rejected:>8}  {medians:>14}  {ratio:>14}  {centre:<12}  {turn:<9}  {}",
                camera.name,
                if camera.calibrated { camera.judgement.level.to_string() } else { "out".to_owned() },
                pattern.unwrap_or_else(|| "–".to_owned()),
            )?;
        }
        Ok(())
    }
}
