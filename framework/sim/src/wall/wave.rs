//! A pointer that is held still at places of the wall, one after another, and then waved all over it.

use std::f64::consts::TAU;

use foveate_estimation::random::Random;
use nalgebra::{Point2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// From one place to the next [s].
const MOVE_S: f64 = 1.2;
/// Periods of the sweeps along x and y, not multiples of one another: in time they cover the wall [s].
const PERIODS_S: [f64; 2] = [7.3, 3.1];
/// Slower swings of the centre of these sweeps [s], and their share.
const SLOW_S: [f64; 2] = [23.0, 17.0];
const SLOW_SHARE: f64 = 0.12;

/// A waved pointer for calibrating.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct WaveSettings {
    /// Places at which it touches the wall before it is waved. Left out: its four corners, clockwise from the upper left [m].
    pub touch_m: Vec<[f64; 2]>,
    /// How long at each [s].
    #[schemars(range(min = 0.1, max = 60.0))]
    pub hold_s: f64,
    /// How far from the place it is held, standard deviation along each axis, drawn for each place [mm].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub miss_mm: f64,
}

impl Default for WaveSettings {
    fn default() -> Self {
        Self { touch_m: Vec::new(), hold_s: 1.5, miss_mm: 0.5 }
    }
}

/// Where it is at a time: a pure function.
#[derive(Debug)]
pub(super) struct Wave {
    held: Vec<Point2<f64>>,
    hold_s: f64,
    phases: [f64; 4],
    size: [f64; 2],
}

impl Wave {
    /// The beam is some millimetres wide and stays whole on the wall: held at its edge, it is `edge` inside [m].
    pub fn new(settings: &WaveSettings, size: [f64; 2], edge: f64, random: &Random) -> Wave {
        let mut random = random.fork("wave");
        let mut corners = settings.touch_m.clone();
        if corners.is_empty() {
            corners = vec![[0.0, 0.0], [size[0], 0.0], size, [0.0, size[1]]];
        }
        let held = corners.into_iter().map(|[x, y]| {
            let miss = Vector2::new(random.normal(), random.normal()) * (settings.miss_mm * 1e-3);
            let at = Point2::new(x, y) + miss;
            Point2::new(at.x.clamp(edge, size[0] - edge), at.y.clamp(edge, size[1] - edge))
        });
        let held = held.collect();
        Wave { held, hold_s: settings.hold_s, phases: [0; 4].map(|_| TAU * random.uniform()), size }
    }

    /// Where it points at `time_s` [m], and whether it is held there.
    pub fn at(&self, time_s: f64) -> (Point2<f64>, bool) {
        let slot_s = self.hold_s + MOVE_S;
        let slot = (time_s / slot_s).floor().max(0.0) as usize;
        let waved_s = self.held.len() as f64 * slot_s;
        let Some(from) = self.held.get(slot) else { return (self.waved(time_s), false) };
        let into = time_s - slot as f64 * slot_s;
        if into <= self.hold_s {
            return (*from, true);
        }
        let to = self.held.get(slot + 1).copied().unwrap_or_else(|| self.waved(waved_s));
        let s = (into - self.hold_s) / MOVE_S;
        (from + (to - from) * (s * s * s * (10.0 + s * (6.0 * s - 15.0))), false)
    }

    fn waved(&self, time_s: f64) -> Point2<f64> {
        let along = |axis: usize| {
            let swing = (TAU * time_s / PERIODS_S[axis] + self.phases[axis]).sin();
            let slow = (TAU * time_s / SLOW_S[axis] + self.phases[2 + axis]).sin();
            self.size[axis] * (0.5 + 0.49 * ((1.0 - SLOW_SHARE) * swing + SLOW_SHARE * slow))
        };
        Point2::new(along(0), along(1))
    }
}
