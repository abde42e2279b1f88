//! The user of a pointer from its blink code: a Bayes filter over codes and their phases.
//!
//! Each user's pointer is dark for a few milliseconds once in a period of its own. Cameras run freely, so each frame is one observation at one moment: the spot was seen, or the
//! camera sees its place and found no spot there. [`Decoder`] holds the probability of each code at each phase, and of lights without a user's code: a light that is never dark, one
//! that is dark in another period, and one that is missed at random. These alternatives keep lights that fit no user's code undecided.
//!
//! Cell j of period P represents light that goes out at j P / n after the decoder's start. At each observation, after a time dt: phases drift randomly ([`WANDER`]), a part of the
//! probability returns to the prior ([`CHANGE_PER_S`]), and each cell is multiplied by the likelihood of the observation. That of a miss rises from [`MISSED`] to 1 − [`SEEN_DARK`] over [`EDGE_S`]
//! at both ends of the dark time: the exposure of a camera must lie within it. Misses at random have the rate that a Beta(1, 4) prior and those so far give.

use std::ops::Range;

use foveate::prelude::*;

use super::settings::TrackerSettings;

/// Prior: a light is never dark, is missed at random, or has a period of no user. The rest is shared by the users' codes.
const STEADY: f64 = 0.25;
const AT_RANDOM: f64 = 0.1;
const OTHERS: f64 = 0.15;
/// Probability that a camera finds no spot of a visible pointer: detectors miss some, hands cross the beam.
const MISSED: f64 = 0.03;
/// Probability that a spot is found where a pointer is dark: another light.
const SEEN_DARK: f64 = 0.03;
/// A camera sees the light for this long after it has gone out and before it comes on: half of an exposure of 2 ms to 4 ms, and the error of its clock [s].
const EDGE_S: f64 = 3e-3;
/// Random drift of phases, standard deviation: a period half way between two of [`CLOCKS`] drifts by 5 ms in a second [s/√s].
const WANDER: f64 = 5e-3;
/// Width of a cell of phase, at most [s].
const CELL_S: f64 = 3e-3;
/// Rate at which probability returns to the prior: a track may switch to another pointer [1/s].
const CHANGE_PER_S: f64 = 0.02;
/// Possible periods of other lights, and the step between them: a period in between drifts by at most 10 ms in a second.
const OTHERS_S: Range<f64> = 0.035..0.3;
const OTHERS_STEP: f64 = 1.02;
/// Actual period of a user relative to the stated one: oscillators without a crystal are off by up to 1 % [–].
const CLOCKS: [f64; 3] = [0.99, 1.0, 1.01];
/// A period nearer to a user's than this is the user's [–].
const SAME_PERIOD: f64 = 0.02;

/// Classification of a light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    /// Not certain yet.
    Undecided,
    /// The light of this user.
    User(u32),
    /// Dark once in this period, which is of no user [s].
    Other(f64),
    /// Never dark, or missed at random.
    NoCode,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Light {
    User(u32),
    Other,
    Steady,
    AtRandom,
}

/// A hypothesis about a light: its cells of phase, and its prior probability.
#[derive(Debug, Clone)]
struct Hypothesis {
    light: Light,
    /// 0 for a hypothesis without a period [s].
    period: f64,
    cells: Range<usize>,
    prior: f64,
}

/// The codes of all users, and the alternatives.
#[derive(Debug, Clone)]
pub(super) struct Codes {
    hypotheses: Vec<Hypothesis>,
    dark: f64,
    sure: f64,
}

/// State of one light's code.
#[derive(Debug, Clone)]
pub(super) struct Decoder {
    start: Time,
    last: Time,
    /// By cell.
    weights: Vec<f64>,
    spare: Vec<f64>,
    frames: f64,
    missed: f64,
}

impl Codes {
    /// `None` where no user has a code.
    pub fn new(settings: &TrackerSettings) -> Option<Codes> {
        let TrackerSettings { users, dark_ms, sure, .. } = settings;
        let blinking = users.iter().filter_map(|it| Some((it.user, it.period_ms?)));
        let users: Vec<(u32, f64)> = blinking.collect();
        if users.is_empty() {
            return None;
        }
        let mut codes = Codes { hypotheses: Vec::new(), dark: dark_ms * 1e-3, sure: *sure };
        codes.add(Light::Steady, 0.0, STEADY);
        codes.add(Light::AtRandom, 0.0, AT_RANDOM);
        let each = (1.0 - STEADY - AT_RANDOM - OTHERS) / users.len() as f64;
        for (user, period_ms) in &users {
            for clock in CLOCKS {
                codes.add(Light::User(*user), period_ms * 1e-3 * clock, each / CLOCKS.len() as f64);
            }
        }
        let is_users = |period: f64| users.iter().any(|it| (period * 1e3 / it.1).ln().abs() < SAME_PERIOD);
        let steps = (OTHERS_S.end / OTHERS_S.start).ln() / OTHERS_STEP.ln();
        let periods = (0..steps as i32).map(|it| OTHERS_S.start * OTHERS_STEP.powi(it));
        let periods: Vec<f64> = periods.filter(|it| !is_users(*it) && *it > codes.dark + EDGE_S).collect();
        for period in &periods {
            codes.add(Light::Other, *period, OTHERS / periods.len() as f64);
        }
        Some(codes)
    }

    fn add(&mut self, light: Light, period: f64, prior: f64) {
        let first = self.hypotheses.last().map_or(0, |it| it.cells.end);
        let n = ((period / CELL_S).ceil() as usize).max(1);
        self.hypotheses.push(Hypothesis { light, period, cells: first..first + n, prior });
    }

    /// A new light from `time` on.
    pub fn decoder(&self, time: Time) -> Decoder {
        let prior = self.hypotheses.iter().flat_map(|it| it.cells.clone().map(|_| it.prior / it.cells.len() as f64));
        let weights: Vec<f64> = prior.collect();
        Decoder { start: time, last: time, spare: weights.clone(), weights, frames: 0.0, missed: 0.0 }
    }

    /// Updates with a frame at `time`, not before the last one, in which the light was seen, or was not seen although the camera sees its place.
    pub fn observe(&self, decoder: &mut Decoder, time: Time, is_seen: bool) {
        let Decoder { start, last, weights, spare, frames, missed } = decoder;
        let (since, dt) = ((time - *start).as_s(), (time - *last).as_s().max(0.0));
        let kept = (-CHANGE_PER_S * dt).exp();
        let mut sum = 0.0;
        for Hypothesis { light, period, cells, prior } in &self.hypotheses {
            let n = cells.len();
            let fresh = (1.0 - kept) * prior / n as f64;
            if *period == 0.0 {
                let p_miss = if *light == Light::Steady { MISSED } else { (1.0 + *missed) / (5.0 + *frames) };
                let likelihood = if is_seen { 1.0 - p_miss } else { p_miss };
                spare[cells.start] = (weights[cells.start] * kept + fresh) * likelihood;
                sum += spare[cells.start];
                continue;
            }
            let width = period / n as f64;
            let goes = (WANDER * WANDER * dt / (width * width)).min(0.5) / 2.0;
            let own = &weights[cells.clone()];
            let mut phase = since.rem_euclid(*period);
            for (cell, to) in spare[cells.clone()].iter_mut().enumerate() {
                let before = own[if cell == 0 { n - 1 } else { cell - 1 }];
                let after = own[if cell + 1 == n { 0 } else { cell + 1 }];
                let wandered = own[cell] * (1.0 - 2.0 * goes) + goes * (before + after);
                let p_miss = self.p_miss(phase);
                let likelihood = if is_seen { 1.0 - p_miss } else { p_miss };
                *to = (wandered * kept + fresh) * likelihood;
                sum += *to;
                phase -= width;
                phase += if phase < 0.0 { *period } else { 0.0 };
            }
        }
        spare.iter_mut().for_each(|it| *it /= sum);
        std::mem::swap(weights, spare);
        *last = time;
        (*frames, *missed) = (*frames + 1.0, *missed + f64::from(u8::from(!is_seen)));
    }

    /// Probability of no spot at this time after the light went out.
    fn p_miss(&self, phase: f64) -> f64 {
        let dark = (phase.min(self.dark - phase) / EDGE_S).clamp(0.0, 1.0);
        MISSED + dark * (1.0 - SEEN_DARK - MISSED)
    }

    /// The classification, if it is certain.
    pub fn verdict(&self, decoder: &Decoder) -> Verdict {
        let weight = |it: &Hypothesis| decoder.weights[it.cells.clone()].iter().sum::<f64>();
        let (mut none, mut others, mut other, mut of_user) = (0.0, 0.0, (0.0, 0.0), (0, 0.0));
        for it in &self.hypotheses {
            let weight = weight(it);
            match it.light {
                // The hypotheses of one user follow each other.
                Light::User(user) => {
                    of_user = (user, weight + if of_user.0 == user { of_user.1 } else { 0.0 });
                    if of_user.1 > self.sure {
                        return Verdict::User(user);
                    }
                }
                Light::Steady | Light::AtRandom => none += weight,
                Light::Other => {
                    others += weight;
                    other = if weight > other.0 { (weight, it.period) } else { other };
                }
            }
        }
        if others > self.sure {
            Verdict::Other(other.1)
        } else if none > self.sure {
            Verdict::NoCode
        } else {
            Verdict::Undecided
        }
    }
}

#[cfg(test)]
mod tests {
    use foveate::estimation::random::Random;

    use super::super::settings::UserCode;
    use super::*;

    const PERIODS_MS: [f64; 4] = [60.0, 71.0, 84.0, 99.0];
    const DARK_MS: f64 = 20.0;

    fn codes() -> Codes {
        let users = PERIODS_MS.iter().zip(1..).map(|(period_ms, user)| UserCode {
            user,
            period_ms: Some(*period_ms),
            colour: None,
        });
        let settings = TrackerSettings { users: users.collect(), dark_ms: DARK_MS, ..TrackerSettings::default() };
        settings.check().unwrap();
        Codes::new(&settings).unwrap()
    }

    /// How a light is seen.
    #[derive(Clone, Copy)]
    struct Scene {
        period_ms: f64,
        dark_ms: f64,
        /// Of each camera.
        hz: &'static [f64],
        /// Share of frames that do not come.
        dropped: f64,
        /// Share of frames in which the spot is missed, or another one is there.
        wrong: f64,
    }

    const USUAL: Scene = Scene { period_ms: 60.0, dark_ms: DARK_MS, hz: &[60.0, 60.0], dropped: 0.0, wrong: 0.01 };

    /// All verdicts over `duration_s` with the times at which they came to be.
    fn verdicts(codes: &Codes, scene: Scene, duration_s: f64, seed: u64) -> Vec<(f64, Verdict)> {
        let mut random = Random::new(seed);
        let start = random.uniform_in(0.0, 10.0);
        let (offset_s, mut frames) = (random.uniform_in(0.0, 1.0), Vec::new());
        for hz in scene.hz {
            let first = random.uniform() / hz;
            frames.extend((0..(duration_s * hz) as u32).map(|it| first + f64::from(it) / hz));
        }
        frames.sort_by(f64::total_cmp);
        let mut decoder = codes.decoder(Time::from_s(start));
        let mut found = vec![(0.0, Verdict::Undecided)];
        for time in frames {
            let phase = (time + offset_s).rem_euclid(scene.period_ms * 1e-3);
            // Of an exposure of 2 ms some is lit.
            let is_lit = phase < 1e-3 || phase > scene.dark_ms * 1e-3 - 1e-3;
            let is_wrong = random.uniform() < scene.wrong;
            if random.uniform() < scene.dropped {
                continue;
            }
            codes.observe(&mut decoder, Time::from_s(start + time), is_lit != is_wrong);
            let verdict = codes.verdict(&decoder);
            if found.last().is_some_and(|it| it.1 != verdict) {
                found.push((time, verdict));
            }
        }
        found
    }

    /// Runs of 10 seeds: when user `user` was decided, in the median, and whether another one ever was.
    #[track_caller]
    fn is_decided(scene: Scene, user: u32, within_s: f64) {
        let codes = codes();
        let mut times = Vec::new();
        for seed in 0..10 {
            let found = verdicts(&codes, scene, 3.0, seed);
            let users: Vec<_> = found.iter().filter(|it| matches!(it.1, Verdict::User(_))).collect();
            assert!(users.iter().all(|it| it.1 == Verdict::User(user)), "seed {seed}: {found:?}");
            times.push(users.first().unwrap_or_else(|| panic!("seed {seed}: {found:?}")).0);
        }
        times.sort_by(f64::total_cmp);
        assert!(times[5] < within_s, "{times:?}");
    }

    #[test]
    fn each_users_code_is_decided_and_no_other() {
        for (period_ms, user) in PERIODS_MS.into_iter().zip(1..) {
            is_decided(Scene { period_ms, ..USUAL }, user, 1.0);
        }
    }

    #[test]
    fn unlike_rates_dropped_frames_noise_and_a_clock_that_is_off_leave_the_user_right() {
        for (period_ms, user) in PERIODS_MS.into_iter().zip(1..) {
            is_decided(Scene { period_ms, hz: &[50.0, 59.94, 30.0], ..USUAL }, user, 1.0);
            is_decided(Scene { period_ms, dropped: 0.2, wrong: 0.05, ..USUAL }, user, 1.5);
            is_decided(Scene { period_ms: period_ms * 1.01, ..USUAL }, user, 1.2);
            is_decided(Scene { period_ms: period_ms * 0.995, ..USUAL }, user, 1.2);
            is_decided(Scene { period_ms, hz: &[90.0], ..USUAL }, user, 1.2);
        }
    }

    #[test]
    fn what_has_no_users_code_is_never_given_to_one() {
        let codes = codes();
        let unknown = [45.0, 53.0, 65.0, 77.0, 92.0, 120.0, 142.0, 198.0];
        for seed in 0..10 {
            let never = |scene: Scene| {
                let found = verdicts(&codes, scene, 3.0, seed);
                assert!(!found.iter().any(|it| matches!(it.1, Verdict::User(_))), "seed {seed}: {found:?}");
                found.last().unwrap().1
            };
            assert_eq!(never(Scene { dark_ms: 0.0, ..USUAL }), Verdict::NoCode);
            never(Scene { dark_ms: 0.0, wrong: 0.2, ..USUAL });
            for period_ms in unknown {
                let found = never(Scene { period_ms, ..USUAL });
                let Verdict::Other(period) = found else { panic!("seed {seed}, {period_ms} ms: {found:?}") };
                assert!((period * 1e3 / period_ms - 1.0).abs() < 0.02, "{period} s for {period_ms} ms");
            }
        }
    }

    #[test]
    fn light_that_changes_hands_is_decided_anew() {
        let codes = codes();
        let mut decoder = codes.decoder(Time::ZERO);
        let mut found = Vec::new();
        for frame in 0..600 {
            let time = f64::from(frame) / 120.0;
            let period = if time < 2.5 { 0.06 } else { 0.084 };
            let phase = time.rem_euclid(period);
            codes.observe(&mut decoder, Time::from_s(time), !(1e-3..0.019).contains(&phase));
            if let Verdict::User(user) = codes.verdict(&decoder) {
                found.push((user, time));
            }
        }
        found.dedup_by_key(|it| it.0);
        assert_eq!(found.iter().map(|it| it.0).collect::<Vec<_>>(), [1, 3]);
        assert!(found[1].1 < 3.8, "{found:?}");
    }
}
