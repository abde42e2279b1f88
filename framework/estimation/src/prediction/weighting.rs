//! Weights prediction methods by recent prediction error.
//!
//! Each method's prediction over the horizon in use is kept until that time has come, and compared with the
//! observation. The weights are the mean errors of the last half second and of the last seven, each to the power
//! −[`SHARPNESS`]: the best method nearly alone where it is much better, all alike where their errors are alike,
//! without a jump when the lead changes; a method that led for long is not dropped after one turn. Level and upright
//! motion are weighted separately ([`Parts`]).

use std::collections::VecDeque;

use nalgebra::{Point3, Vector3};

use super::history::History;
use super::parts::{PARTS, Parts};

/// How many are scored.
pub(super) const METHODS: usize = 8;
/// The first so many of them compete.
const COMPETITORS: usize = 7;
/// Of weights by mean misses [–]. Higher, and the lead of a few misses decides; lower, and the worst are not silenced.
const SHARPNESS: i32 = 3;
/// Weights forget this much faster than the stated uncertainty, and this much slower: who leads changes with what the point does, within half a second, and half a second alone knows little [–].
const QUICKER: [f64; 2] = [4.0, 0.3];
/// What a method is worth beforehand, in the order of the methods: a velocity that fades slowly is that of people at most times. Chosen on four people who dance, jump and walk, and on drawn
/// paths, so that no path is predicted worse than at constant velocity [–].
const WORTH: [f64; COMPETITORS] = [1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 1.0];
/// A negligible error over the square of the horizon, standard deviation [m/s²].
const TRIFLE_M_S2: f64 = 0.003;
/// What each method is taken to miss by, over the square of the horizon, before the first miss is measured [m/s²].
const BEFOREHAND_M_S2: f64 = 1.0;
/// And for how many misses of that size this counts [–].
const BEFOREHAND: f64 = 3.0;

#[derive(Debug, Clone)]
struct Stored {
    time_s: f64,
    horizon_s: f64,
    made_s: f64,
    by: [Point3<f64>; METHODS],
    mixed: Point3<f64>,
}

#[derive(Debug, Clone)]
pub(super) struct PredictorWeighting {
    memory_s: f64,
    eye: Option<Point3<f64>>,
    waiting: VecDeque<Stored>,
    /// Errors of the methods over the horizon squared [m/s²], for the weights, each part by its own; quickly forgotten and slowly.
    recent: [[Discounted<METHODS>; 2]; PARTS],
    /// Squares of the same, per axis, of the methods and last of the mixture [m²/s⁴], for the stated uncertainty.
    lasting: Discounted<{ METHODS + 1 }>,
    last_s: f64,
}

/// Discounted means.
#[derive(Debug, Clone, Copy)]
struct Discounted<const N: usize> {
    sums: [f64; N],
    count: f64,
}

impl<const N: usize> Discounted<N> {
    fn beforehand(mean: f64) -> Discounted<N> {
        Discounted { sums: [BEFOREHAND * mean; N], count: BEFOREHAND }
    }

    fn add(&mut self, kept: f64, missed: impl Iterator<Item = f64>) {
        for (sum, missed) in self.sums.iter_mut().zip(missed) {
            *sum = kept * *sum + missed;
        }
        self.count = kept * self.count + 1.0;
    }

    fn mean(&self, index: usize) -> f64 {
        self.sums[index] / self.count
    }
}

impl PredictorWeighting {
    pub fn new(memory_s: f64, eye: Option<Point3<f64>>) -> PredictorWeighting {
        PredictorWeighting {
            memory_s,
            eye,
            waiting: VecDeque::new(),
            recent: [[Discounted::beforehand(BEFOREHAND_M_S2); 2]; PARTS],
            lasting: Discounted::beforehand(BEFOREHAND_M_S2.powi(2)),
            last_s: 0.0,
        }
    }

    /// Stores each method's prediction at `time_s` of `horizon_s` later.
    pub fn store(&mut self, time_s: f64, horizon_s: f64, by: [Point3<f64>; METHODS]) {
        let mixed = self.weigh(&by);
        self.waiting.push_back(Stored { time_s: time_s + horizon_s, horizon_s, made_s: time_s, by, mixed });
    }

    /// Compares the stored predictions of times up to `now_s` with the observations.
    pub fn score(&mut self, now_s: f64, history: &History) {
        while self.waiting.front().is_some_and(|it| it.time_s <= now_s) {
            let Some(predicted) = self.waiting.pop_front() else { break };
            let Some(happened) = history.at(predicted.time_s) else { continue };
            let passed = (predicted.made_s - self.last_s).max(0.0) / self.memory_s;
            self.last_s = predicted.made_s;
            let scale = predicted.horizon_s.powi(4).max(1e-8);
            let parts = Parts::new(self.eye.as_ref(), &happened);
            let missed = |point: &Point3<f64>| parts.squares(&(point - happened)).map(|it| it / scale);
            for (part, recent) in self.recent.iter_mut().enumerate() {
                for (recent, quicker) in recent.iter_mut().zip(QUICKER) {
                    recent.add((-passed * quicker).exp(), predicted.by.iter().map(|it| missed(it)[part].sqrt()));
                }
            }
            let axes = parts.axes();
            let an_axis = |point: &Point3<f64>| {
                missed(point).iter().zip(axes).map(|(square, axes)| square * axes).sum::<f64>()
                    / axes.iter().sum::<f64>()
            };
            self.lasting.add((-passed).exp(), predicted.by.iter().chain([&predicted.mixed]).map(an_axis));
        }
    }

    /// Of each method for a part, summing to 1: those that do not compete have 0.
    fn weights(&self, part: usize) -> [f64; METHODS] {
        let mut weights = [0.0; METHODS];
        for (index, (weight, worth)) in weights.iter_mut().zip(WORTH).enumerate() {
            let missed = self.recent[part].map(|it| it.mean(index) + TRIFLE_M_S2);
            *weight = worth * (missed[0] * missed[1]).recip().powi(SHARPNESS);
        }
        let sum: f64 = weights.iter().sum();
        weights.map(|it| it / sum)
    }

    /// The weighted mean of the methods' predictions.
    pub fn weigh(&self, by: &[Point3<f64>; METHODS]) -> Point3<f64> {
        let mean = |part: usize| {
            let weighted = by.iter().zip(self.weights(part)).map(|(it, weight)| it.coords * weight);
            weighted.sum::<Vector3<f64>>()
        };
        Point3::from(Parts::new(self.eye.as_ref(), &by[0]).join([mean(0), mean(1)]))
    }

    /// Variance per axis of a method or of the mixture, over a horizon [m²].
    pub fn variance(&self, method: Option<usize>, horizon_s: f64) -> f64 {
        self.lasting.mean(method.unwrap_or(METHODS)) * horizon_s.powi(4)
    }
}
