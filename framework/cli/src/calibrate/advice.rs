//! What to try next, as a command that can be typed: what was found wrong, in options of this program.

use foveate_calibration::cause::Cause;
use foveate_calibration::checks::{Level, Suspect};

/// What of the command line bears on what can be suggested.
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
}

/// Clocks are looked for this many times as far as a camera was found to be late.
const MARGIN: f64 = 2.0;

/// Commands worth trying on the same recording, each with what it is for; none where all is well or nothing but a new recording helps.
pub fn commands(asked: &Asked, suspects: &[Suspect]) -> Vec<String> {
    let graver = || suspects.iter().filter(|it| it.judgement.level > Level::Good);
    let mut list = Vec::new();
    let latest = graver().filter_map(|it| match it.cause {
        Cause::Clock { offset_s, .. } => Some(offset_s.abs()),
        _ => None,
    });
    let latest_s = latest.fold(0.0, f64::max);
    if latest_s > 0.0 && !asked.unsynchronised {
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
