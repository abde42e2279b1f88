//! What a face does over time: first it shows all that it can do, one expression after the other, then it acts.
//!
//! Channels have the names that face capture gives to its shapes. All is a pure function of time and of a seed.

use std::f64::consts::{PI, TAU};

use foveate_estimation::random::Random;

use super::head::smooth;
use super::ict::Curves;

/// Channels that act against each other share a signal: what its upper half drives, what its lower half does.
const PAIRS: [[&[&str]; 2]; 7] = [
    [&["mouthSmile_L", "mouthSmile_R", "cheekSquint_L", "cheekSquint_R"], &["mouthPucker"]],
    [&["browInnerUp", "browOuterUp_L", "browOuterUp_R"], &["browDown_L", "browDown_R"]],
    [&["mouthFrown_L", "mouthFrown_R"], &["mouthLowerDown_L", "mouthLowerDown_R"]],
    [&["mouthFunnel"], &["noseSneer_L", "noseSneer_R"]],
    [&["jawLeft"], &["jawRight"]],
    [&["mouthSmile_L"], &["mouthSmile_R"]],
    [&["cheekPuff"], &["eyeSquint"]],
];
/// How far each pair goes while acting.
const REACH: [f64; 7] = [0.85, 0.9, 0.7, 0.65, 0.45, 0.5, 0.6];
/// How fast each pair changes [rad/s].
const RATES: [f64; 7] = [1.3, 1.7, 2.1, 2.6, 1.9, 1.1, 0.9];

/// Faces that are shown one after the other.
const EXPRESSIONS: [&[(&str, f64)]; 24] = [
    &[("jawOpen", 1.0)],
    &[("mouthSmile_L", 1.0), ("mouthSmile_R", 1.0)],
    &[("mouthPucker", 1.0)],
    &[("browInnerUp", 1.0), ("browOuterUp_L", 1.0), ("browOuterUp_R", 1.0)],
    &[("browDown_L", 1.0), ("browDown_R", 1.0), ("eyeSquint", 1.0)],
    &[("mouthFrown_L", 1.0), ("mouthFrown_R", 1.0)],
    &[("noseSneer_L", 1.0), ("noseSneer_R", 1.0)],
    &[("mouthFunnel", 1.0)],
    &[("jawLeft", 1.0)],
    &[("jawRight", 1.0)],
    &[("cheekPuff", 1.0)],
    &[("mouthLowerDown_L", 1.0), ("mouthLowerDown_R", 1.0)],
    &[("mouthSmile_L", 1.0), ("browOuterUp_L", 0.8)],
    &[("mouthSmile_R", 1.0), ("browOuterUp_R", 0.8)],
    &[("jawOpen", 0.9), ("mouthSmile_L", 0.9), ("mouthSmile_R", 0.9), ("cheekSquint_L", 1.0), ("cheekSquint_R", 1.0)],
    &[("jawOpen", 0.6), ("mouthPucker", 0.9)],
    &[("jawOpen", 0.9), ("browInnerUp", 1.0), ("browOuterUp_L", 1.0), ("browOuterUp_R", 1.0)],
    &[("browDown_L", 1.0), ("noseSneer_L", 1.0), ("mouthFrown_L", 0.6)],
    &[("browDown_R", 1.0), ("noseSneer_R", 1.0), ("mouthFrown_R", 0.6)],
    &[("jawOpen", 0.5), ("mouthFunnel", 1.0)],
    &[("jawOpen", 0.5), ("jawLeft", 0.8)],
    &[("jawOpen", 0.5), ("jawRight", 0.8)],
    &[("mouthFrown_L", 0.8), ("mouthFrown_R", 0.8), ("browInnerUp", 1.0)],
    &[("browInnerUp", 1.0), ("mouthSmile_L", 0.7), ("mouthSmile_R", 0.7)],
];
/// Of the time in which a face is shown at all: how much goes to one after the other; in the rest it acts already.
const SHOWN: f64 = 0.55;
/// How much of its own a face does beside what was recorded.
const OWN: f64 = 0.5;
/// A blink [s].
const BLINK_S: f64 = 0.22;

/// What a face does.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Drive {
    /// From when on faces are shown, and for how long [s].
    start_s: f64,
    shown_s: f64,
    phases: [[f64; 2]; 8],
    speech: [f64; 4],
    blink: f64,
    /// Recorded curves of a person, if there are any.
    curves: Option<Curves>,
}

impl Drive {
    /// Shows its range from `start_s` on for `shown_s`, and acts from then on, by `curves` where there are any.
    pub fn new(start_s: f64, shown_s: f64, curves: Option<Curves>, random: &mut Random) -> Self {
        let mut phase = || random.uniform_in(0.0, TAU);
        Self {
            start_s,
            shown_s,
            phases: [(); 8].map(|()| [phase(), phase()]),
            speech: [(); 4].map(|()| phase()),
            blink: phase(),
            curves,
        }
    }

    /// Fills `weights` (0 to 1) for the channels of these names at `time_s`. A name without its side, as `browInnerUp_L` of
    /// `browInnerUp`, follows the channel of both.
    pub fn weights(&self, names: &[String], time_s: f64, weights: &mut Vec<f64>) {
        let since = time_s - self.start_s;
        let shown = self.shown_s * SHOWN;
        // How much it acts: all of it before and after, nothing while it shows its range.
        let edge = (0.1 * self.shown_s).clamp(0.05, 0.6);
        let acting = if self.shown_s > 0.0 {
            (1.0 - smooth((since + edge) / edge)).max(smooth((since - shown) / edge))
        } else {
            1.0
        };
        weights.clear();
        weights.extend(names.iter().map(|name| {
            let recorded = self.curves.as_ref().map(|it| it.at(name, time_s));
            let share = if recorded.is_some() { OWN } else { 1.0 };
            let acted = acting * (share * self.acted(name, time_s) + recorded.unwrap_or(0.0));
            let blink = if name.starts_with("eyeBlink") { self.blinks(time_s) } else { 0.0 };
            (acted + self.shows(name, since, shown) + blink).clamp(0.0, 1.0)
        }));
    }

    /// What the channel does of the expressions shown one after the other over `shown` seconds.
    fn shows(&self, name: &str, since: f64, shown: f64) -> f64 {
        if !(0.0..shown).contains(&since) {
            return 0.0;
        }
        let place = since / shown * EXPRESSIONS.len() as f64;
        let now = place as usize;
        // Each rises and falls over one and a half of its turns.
        let share = |number: usize| {
            let aside = (place - number as f64 - 0.5) / 0.75;
            if aside.abs() < 1.0 { 0.5 + 0.5 * (PI * aside).cos() } else { 0.0 }
        };
        let near = now.saturating_sub(1)..=(now + 1).min(EXPRESSIONS.len() - 1);
        near.map(|number| {
            let weight = EXPRESSIONS[number].iter().find(|it| is_channel(name, it.0)).map_or(0.0, |it| it.1);
            weight * share(number)
        })
        .sum()
    }

    /// What the channel does while the face acts.
    fn acted(&self, name: &str, time_s: f64) -> f64 {
        let mut sum = 0.0;
        for (pair, [up, down]) in PAIRS.iter().enumerate() {
            let signs = [up, down].map(|names| names.iter().any(|it| is_channel(name, it)));
            if signs == [false, false] {
                continue;
            }
            let [a, b] = self.phases[pair];
            let rate = RATES[pair];
            let signal = 0.62 * (rate * time_s + a).sin() + 0.62 * (rate * 0.447 * time_s + b).sin();
            let upper = if signs[0] { signal.max(0.0) } else { 0.0 };
            let lower = if signs[1] { (-signal).max(0.0) } else { 0.0 };
            sum += REACH[pair] * (upper * upper + lower * lower).min(1.0);
        }
        if name == "jawOpen" {
            // Speech: syllables in phrases.
            let [a, b, c, d] = self.speech;
            let phrase = (0.5 + 0.7 * (0.61 * time_s + a).sin() + 0.35 * (1.43 * time_s + b).sin()).clamp(0.0, 1.0);
            let syllables = 0.5 + 0.3 * (11.0 * time_s + c).sin() + 0.2 * (17.3 * time_s + d).sin();
            sum += 0.62 * smooth(phrase) * syllables;
        }
        sum
    }

    /// Lids: shut for a moment every few seconds.
    fn blinks(&self, time_s: f64) -> f64 {
        let place = time_s + self.blink + 0.9 * (0.37 * time_s + self.blink).sin();
        let aside = (place.rem_euclid(3.7) - 1.0) / (0.5 * BLINK_S);
        if aside.abs() < 1.0 { 0.5 + 0.5 * (PI * aside).cos() } else { 0.0 }
    }
}

/// Whether a shape belongs to a channel: of the same name, or of one of its sides.
fn is_channel(shape: &str, channel: &str) -> bool {
    shape == channel || shape.strip_prefix(channel).is_some_and(|rest| rest == "_L" || rest == "_R")
}
