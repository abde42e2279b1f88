//! What to try next after a calibration, as commands to type.

use foveate_calibration::cause::Cause;
use foveate_calibration::checks::{Candidate, Level};

/// Options of the command line on which suggestions depend.
#[derive(Debug, Clone, Default)]
pub struct Asked {
    /// The rig as it was named.
    pub rig: String,
    /// `--from-nothing`.
    pub from_nothing: bool,
    /// `--unsynchronised`.
    pub unsynchronised: bool,
    /// `--max-offset` [s].
    pub max_offset_s: f64,
    /// The value of `--optics`, where one was given.
    pub optics: Option<&'static str>,
    /// Options that go into any further command as they are, such as `--inlier-px 8`.
    pub kept: Vec<String>,
    /// Whether one light was waved.
    pub is_light: bool,
    /// Whether the room is no good and hardly two pictures were taken together.
    pub never_together: bool,
}

/// Clocks are searched this many times as far as a camera was found to be late.
const MARGIN: f64 = 2.0;

/// Commands worth trying on the same recording, each with its purpose; none where all is well or only a new recording helps.
pub fn commands(asked: &Asked, candidates: &[Candidate]) -> Vec<String> {
    let graver = || candidates.iter().filter(|it| it.judgement.level > Level::Good);
    let mut list = Vec::new();
    let latest = graver().filter_map(|it| match it.cause {
        Cause::Clock { offset_s, .. } => Some(offset_s.abs()),
        _ => None,
    });
    let latest_s = latest.fold(0.0, f64::max);
    // Cameras that lose frames drift away from the others, which no steady lateness explains.
    let drifts = graver().any(|it| matches!(it.cause, Cause::Unknown { .. }));
    let is_apart = latest_s > 0.0 || drifts && asked.is_light || asked.never_together;
    if is_apart && !asked.unsynchronised {
        let max_offset_s = (MARGIN * latest_s).max(0.5);
        let options = format!("--from-nothing --unsynchronised --max-offset {max_offset_s:.2}");
        list.push(asked.with(&options, asked.optics, "to find each camera's clock as well"));
    }
    let is_lens = |it: &Cause| matches!(it, Cause::Focal { .. } | Cause::Distortion { .. });
    if graver().any(|it| is_lens(&it.cause)) && !matches!(asked.optics, Some("lens" | "all")) {
        let from_nothing = if asked.from_nothing { "--from-nothing" } else { "" };
        list.push(asked.with(from_nothing, Some("lens"), "to find focal lengths and distortion as well"));
    }
    if graver().any(|it| matches!(it.cause, Cause::PixelShape { .. })) && asked.optics != Some("all") {
        let from_nothing = if asked.from_nothing { "--from-nothing" } else { "" };
        list.push(asked.with(from_nothing, Some("all"), "to find the shape of pixels as well"));
    }
    list
}

impl Asked {
    fn with(&self, options: &str, optics: Option<&str>, why: &str) -> String {
        let mut command = format!("foveate calibrate {}", self.rig);
        let optics = optics.map(|it| format!("--optics {it}")).unwrap_or_default();
        for part in
            [options, &optics].into_iter().chain(self.kept.iter().map(String::as_str)).filter(|it| !it.is_empty())
        {
            command.push(' ');
            command += part;
        }
        format!("try: {command}   ({why})")
    }
}

#[cfg(test)]
mod tests {
    use foveate_calibration::checks::{Candidate, Judgement};

    use super::*;

    /// What is suggested where a camera is at fault by `cause`.
    fn suggested(asked: &Asked, cause: Cause) -> Vec<String> {
        let judgement = Judgement { level: Level::Redo, sentence: String::new() };
        commands(asked, &[Candidate { judgement, camera: 0, cause, misfit: 2.0, explained: 1.0 }])
    }

    #[test]
    fn each_suggestion_can_be_typed() {
        use clap::Parser;
        let causes = [
            Cause::Clock { offset_s: -0.7, sigma_s: 0.01 },
            Cause::Focal { factor: 1.1 },
            Cause::Distortion { k1: 0.1 },
            Cause::PixelShape { factor: 0.9 },
            Cause::Mirrored,
            Cause::Unknown { size: 0.9 },
        ];
        let mut n = 0;
        for from_nothing in [false, true] {
            for kept in [vec![], vec!["--inlier-px 8".to_owned()], vec!["--from leds".to_owned()]] {
                for (is_light, shown) in [(true, ""), (false, "--wand-mm 400"), (false, "--chessboard 8x6")] {
                    let mut kept = kept.clone();
                    kept.extend((!is_light).then(|| shown.to_owned()));
                    let asked = Asked { rig: "lab.toml".to_owned(), from_nothing, kept, is_light, ..Asked::default() };
                    for line in causes.iter().flat_map(|it| suggested(&asked, *it)) {
                        let command = line.trim_start_matches("try: ").split("   (").next().unwrap_or_default();
                        let typed = crate::commands::Cli::try_parse_from(command.split(' '));
                        assert!(typed.is_ok(), "{command}: {}", typed.unwrap_err());
                        n += 1;
                    }
                }
            }
        }
        assert!(n > 40, "{n}");
        let late = suggested(&Asked::default(), causes[0]);
        assert!(late[0].contains("--unsynchronised --max-offset 1.40"), "{late:?}");
        assert!(suggested(&Asked { unsynchronised: true, ..Asked::default() }, causes[0]).is_empty());
        assert!(suggested(&Asked::default(), Cause::Mirrored).is_empty());
        let apart = Asked { never_together: true, ..Asked::default() };
        assert!(commands(&apart, &[])[0].contains("--unsynchronised --max-offset 0.50"));
        assert!(commands(&Asked { unsynchronised: true, ..apart }, &[]).is_empty());
    }
}
