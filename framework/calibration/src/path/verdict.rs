//! Verdict on cameras that were calibrated from a path, in words and for programs.

use super::{PathCamera, PathNetwork, PathOptions, Refusal};
use crate::checks::Level;

/// A camera is good when its centre is known to this part of its distance, and its direction to so much [–, rad].
const GOOD_POSE: [f64; 2] = [0.01, 5e-3];
/// Held out observations may be so many times as far off as those used, and so much more [–, px].
const GOOD_HELD_OUT: (f64, f64) = (1.5, 0.5);
/// A clock that is off by so many of its standard deviations in a part of the recording, and by so much, is not steady [–, s].
const UNSTEADY: (f64, f64) = (4.0, 0.02);

/// One finding, for programs.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Name of the camera; `None` where it is of all.
    pub camera: Option<String>,
    /// A fixed name of the cause.
    pub cause: &'static str,
    /// How much of it, in [`Self::unit`]; NaN where it has no size.
    pub size: f64,
    /// The unit of that: `px`, `s`, `m`, `deg`, `1` for shares and what has none, or `count`.
    pub unit: &'static str,
    /// `redo` where nothing is written of the camera.
    pub level: Level,
}

/// The level of a calibration from a path, and the reasons.
#[derive(Debug, Clone, PartialEq)]
pub struct PathVerdict {
    /// The level of the calibrated cameras.
    pub level: Level,
    /// By camera, in order: its own level.
    pub levels: Vec<Level>,
    /// Why, the worst first, and what to do.
    pub sentences: Vec<String>,
    /// The same for programs.
    pub findings: Vec<Finding>,
}

impl PathNetwork {
    /// Whether to work with it: `redo` where no camera was found, `usable` where one was refused.
    pub fn verdict(&self, options: &PathOptions) -> PathVerdict {
        let mut verdict =
            PathVerdict { level: Level::Good, levels: Vec::new(), sentences: Vec::new(), findings: Vec::new() };
        if self.other_hand {
            let sentence = "The path fits when two of its axes are swapped: its axes are left-handed (north, east, up?), or all pictures are \
                            mirrored; give it as x, y, z with z = x × y, such as east, north, up.";
            verdict.sentences.push(sentence.to_owned());
            verdict.findings.push(Finding {
                camera: None,
                cause: "path_left_handed",
                size: f64::NAN,
                unit: "1",
                level: Level::Usable,
            });
        }
        for (index, outcome) in self.cameras.iter().enumerate() {
            let name = &self.solved.cameras[index].name;
            let level = match outcome {
                Ok(camera) => verdict.of_camera(name, camera, options),
                Err(refusal) => {
                    verdict.sentences.push(format!("Camera {name} is not calibrated: {refusal}."));
                    let (size, unit) = size(refusal);
                    verdict.find(name, refusal.cause(), size, unit, Level::Redo);
                    Level::Redo
                }
            };
            verdict.levels.push(level);
        }
        let n_found = verdict.levels.iter().filter(|it| **it != Level::Redo).count();
        verdict.level = match verdict.levels.iter().max() {
            _ if n_found == 0 => Level::Redo,
            Some(Level::Good) => Level::Good,
            _ => Level::Usable,
        };
        if verdict.sentences.is_empty() {
            verdict
                .sentences
                .push("All cameras agree with the path, and no other solution explains their observations.".to_owned());
        }
        verdict
    }
}

fn size(refusal: &Refusal) -> (f64, &'static str) {
    match refusal {
        Refusal::TooFew { seen, .. } | Refusal::NoOverlap { seen, .. } => (*seen as f64, "count"),
        Refusal::Still { spread_px } => (*spread_px, "px"),
        Refusal::Disagrees { right, of, .. } => (1.0 - *right as f64 / (*of).max(1) as f64, "1"),
        Refusal::Mirrored { mirrored, .. } => (*mirrored, "1"),
        Refusal::ClockAmbiguous { offset_s, other_s, .. } => ((offset_s - other_s).abs(), "s"),
        Refusal::TwoPoses { angle_deg, .. } => (*angle_deg, "deg"),
        Refusal::Weak { centre_m, .. } => (*centre_m, "m"),
        Refusal::Open { across_m, .. } => (*across_m, "m"),
        Refusal::OpticOpen { sigma, .. } => (*sigma, "1"),
        Refusal::HeldOut { held_out_px, .. } => (*held_out_px, "px"),
    }
}

impl PathVerdict {
    fn find(&mut self, camera: &str, cause: &'static str, size: f64, unit: &'static str, level: Level) {
        self.findings.push(Finding { camera: Some(camera.to_owned()), cause, size, unit, level });
    }

    fn of_camera(&mut self, name: &str, camera: &PathCamera, options: &PathOptions) -> Level {
        let before = self.sentences.len();
        if camera.share() < options.good_share {
            let wrong = 100.0 * (1.0 - camera.share());
            self.sentences.push(format!(
                "Of camera {name}, {wrong:.0} % of the observations are more than {:.1} px from the path: check that they show the same point.",
                camera.limit_px
            ));
            self.find(name, "false_observations", 1.0 - camera.share(), "1", Level::Usable);
        }
        let ([used_px, _], [held_out_px, _]) = (camera.used_px, camera.held_out_px);
        let usual_px = options.inlier_px;
        if used_px > usual_px {
            self.sentences.push(format!(
                "Camera {name} is {used_px:.1} px off in the median, with {:.0} % of its observations accepted: its clock, lens or \
                 shutter differs from its model.",
                100.0 * camera.share()
            ));
            self.find(name, "fits_badly", used_px, "px", Level::Usable);
        }
        if held_out_px > GOOD_HELD_OUT.0 * used_px + GOOD_HELD_OUT.1 {
            self.sentences.push(format!(
                "Camera {name} is {held_out_px:.1} px off where observations were held out, {used_px:.1} px where they were used: record for longer."
            ));
            self.find(name, "held_out_disagrees", held_out_px, "px", Level::Usable);
        }
        if let Some([shift_s, sigma_s]) = camera.wander
            && shift_s.abs() > UNSTEADY.1
            && shift_s.abs() > UNSTEADY.0 * sigma_s
        {
            self.sentences.push(format!(
                "The clock of camera {name} is unsteady: in a part of the recording it is {:.0} ms off its mean rate, as with a variable frame rate; \
                 record at a constant one, or use the times of each picture from the file.",
                1e3 * shift_s.abs()
            ));
            self.find(name, "clock_unsteady", shift_s.abs(), "s", Level::Usable);
        }
        if camera.centre_sigma_m > GOOD_POSE[0] * camera.depth_m || camera.turn_sigma > GOOD_POSE[1] {
            self.sentences.push(format!(
                "Camera {name} is known only to {:.2} m and {:.1} mrad, with the path {:.0} m away: move the point all over its picture, near and far.",
                camera.centre_sigma_m,
                1e3 * camera.turn_sigma,
                camera.depth_m
            ));
            self.find(name, "pose_weak", camera.centre_sigma_m, "m", Level::Usable);
        }
        if self.sentences.len() > before { Level::Usable } else { Level::Good }
    }
}
