//! Hands that hold pointers: where each points at a time, and whether the button is down. Pure functions of time.
//!
//! A path leads from place to place with least jerk. On top a hand at rest is never still: slow drift whose power falls as 1/f, and physiological tremor of 8 Hz to
//! 12 Hz (R. Elble and W. Koller, *Tremor*, 1990), each a sum of sinusoids with phases of their own. Nine tenths of the variance are drift.

use std::f64::consts::TAU;

use foveate_estimation::random::Random;
use nalgebra::{Point2, Vector2};

use super::WallSettings;
use crate::chance::stream;

const PLACES: u64 = 10;
const BOWS: u64 = 11;
const BUTTONS: u64 = 12;
/// Places lie up to this much beyond the wall, relative to its size: pointers leave it and return.
const BEYOND: f64 = 0.05;
/// Drift: frequencies between these, evenly on a logarithmic scale, of one power each: a spectrum that falls as 1/f [Hz].
const DRIFT_HZ: [f64; 2] = [0.15, 6.0];
const DRIFT_WAVES: usize = 12;
/// Tremor [Hz].
const TREMOR_HZ: [f64; 2] = [8.0, 12.0];
const TREMOR_WAVES: usize = 6;
const TREMOR_SHARE: f64 = 0.1;
/// How far two who change places miss each other, standard deviation [m].
const MISS_M: f64 = 0.004;
/// How far other paths bend, relative to their length, standard deviation [–].
const BEND: f64 = 0.12;
/// The button is up at the start of each time of `press_s` for so long [s].
const UP_S: [f64; 2] = [0.15, 0.6];
/// Part of those times that have a click after that: down, and up again, for so long [s].
const CLICKS: f64 = 0.25;
const CLICK_S: f64 = 0.12;
const AFTER_CLICK_S: f64 = 0.15;

#[derive(Debug)]
pub(super) struct Hand {
    seed: u64,
    number: u32,
    drift: [Vec<Wave>; 2],
}

#[derive(Debug)]
struct Wave {
    amplitude: f64,
    per_s: f64,
    phase: f64,
}

impl Hand {
    pub fn new(number: u32, settings: &WallSettings, random: &Random) -> Hand {
        let mut own = random.fork(&format!("hand {number}"));
        let sigma = settings.tremor_px * settings.pixel_mm * 1e-3 / 2.0;
        let mut waves = |n: usize, share: f64, [low, high]: [f64; 2]| -> Vec<Wave> {
            // A sinusoid of amplitude a has the variance a²/2.
            let amplitude = sigma * (2.0 * share / n as f64).sqrt();
            (0..n)
                .map(|it| {
                    let part = (it as f64 + own.uniform()) / n as f64;
                    Wave { amplitude, per_s: TAU * low * (high / low).powf(part), phase: TAU * own.uniform() }
                })
                .collect()
        };
        let drift = [0, 1].map(|_| {
            let mut all = waves(DRIFT_WAVES, 1.0 - TREMOR_SHARE, DRIFT_HZ);
            all.extend(waves(TREMOR_WAVES, TREMOR_SHARE, TREMOR_HZ));
            all
        });
        // Places are shared: who changes places with another must know where that is.
        Hand { seed: random.fork("places").next_u64(), number, drift }
    }

    /// Where the hand points at `time_s`, on the wall or beside it [m].
    pub fn points_at(&self, time_s: f64, settings: &WallSettings, size: [f64; 2]) -> Point2<f64> {
        let part = (time_s / settings.part_s).floor();
        let s = time_s / settings.part_s - part;
        let part = part as i64;
        let place = |hand: u32, number: i64| {
            let mut random = stream(self.seed ^ u64::from(hand), PLACES, number);
            let mut along = |size: f64| size * random.uniform_in(-BEYOND, 1.0 + BEYOND);
            Vector2::new(along(size[0]), along(size[1]))
        };
        let partner = |number: i64| {
            let other = self.number ^ (1 + number.rem_euclid(3) as u32);
            if other < settings.users { other } else { self.number }
        };
        let meets = settings.cross && part.rem_euclid(2) == 1;
        let (from, to) = match settings.cross {
            false => (place(self.number, part - 1), place(self.number, part)),
            true => {
                let number = part.div_euclid(2);
                let own = place(self.number, number);
                match meets {
                    true => (own, place(partner(number), number)),
                    false => (place(partner(number - 1), number - 1), own),
                }
            }
        };
        let way = to - from;
        let bow = stream(self.seed ^ u64::from(self.number), BOWS, part).normal();
        let bow = if meets { bow * MISS_M / way.norm().max(0.01) } else { bow * BEND };
        let along = s * s * s * (10.0 + s * (6.0 * s - 15.0));
        let across = Vector2::new(-way.y, way.x) * bow * (std::f64::consts::PI * along).sin();
        Point2::from(from + way * along + across) + self.shakes(time_s)
    }

    /// What drift and tremor add [m].
    pub fn shakes(&self, time_s: f64) -> Vector2<f64> {
        let sum = |waves: &[Wave]| waves.iter().map(|it| it.amplitude * (it.per_s * time_s + it.phase).sin()).sum();
        Vector2::new(sum(&self.drift[0]), sum(&self.drift[1]))
    }

    /// The number of the press under way at `time_s`, which no other press of any hand has; `None` while the button is up.
    pub fn presses(&self, time_s: f64, settings: &WallSettings) -> Option<u32> {
        // Each hand at its own moments.
        let time_s = time_s + settings.press_s * f64::from(self.number) / f64::from(settings.users.max(1));
        let slot = (time_s / settings.press_s).floor();
        let into = time_s - slot * settings.press_s;
        let mut random = stream(self.seed ^ u64::from(self.number), BUTTONS, slot as i64);
        let mut down = random.uniform_in(UP_S[0], UP_S[1]);
        let mut press = 0;
        if random.uniform() < CLICKS {
            if (down..down + CLICK_S).contains(&into) {
                return Some((slot as u32 * 2) * settings.users + self.number);
            }
            down += CLICK_S + AFTER_CLICK_S;
            press = 1;
        }
        (into >= down).then(|| (slot as u32 * 2 + press) * settings.users + self.number)
    }
}
