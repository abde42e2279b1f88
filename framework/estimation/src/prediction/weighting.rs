//! Which way of carrying on has foretold best of late.
//!
//! Each way's prediction over the horizon in use is kept until that time has come, and compared with what happened. Ways are weighted by
//! their mean squared misses to the power −[`SHARPNESS`]: the best one nearly alone where it is much better, all alike where they are alike, without
//! a jump when the lead changes.

use std::collections::VecDeque;

use nalgebra::{Point3, Vector3};

use super::history::History;

const WAYS: usize = 5;
/// Of weights by mean squared misses [–].
const SHARPNESS: i32 = 3;
/// A miss over the square of the horizon that nobody minds, standard deviation [m/s²].
const TRIFLE_M_S2: f64 = 0.003;
/// What each way is taken to miss by, over the square of the horizon, before the first miss is measured [m/s²].
const BEFOREHAND_M_S2: f64 = 1.0;
/// And for how many misses of that size this counts [–].
const BEFOREHAND: f64 = 3.0;

#[derive(Debug, Clone)]
struct Foretold {
    time_s: f64,
    horizon_s: f64,
    made_s: f64,
    by: [Point3<f64>; WAYS],
    mixed: Point3<f64>,
}

#[derive(Debug, Clone)]
pub(super) struct PredictorWeighting {
    memory_s: f64,
    waiting: VecDeque<Foretold>,
    /// Discounted sums of squared misses, an axis each, over the horizon squared squared [m²/s⁴]; the last of them is of the mixture.
    squares: [f64; WAYS + 1],
    count: f64,
    last_s: f64,
}

impl PredictorWeighting {
    pub fn new(memory_s: f64) -> PredictorWeighting {
        let square = BEFOREHAND * BEFOREHAND_M_S2.powi(2);
        PredictorWeighting {
            memory_s,
            waiting: VecDeque::new(),
            squares: [square; WAYS + 1],
            count: BEFOREHAND,
            last_s: 0.0,
        }
    }

    /// Keeps what each way says at `time_s` of `horizon_s` later.
    pub fn foretell(&mut self, time_s: f64, horizon_s: f64, by: [Point3<f64>; WAYS]) {
        let mixed = self.weigh(&by);
        self.waiting.push_back(Foretold { time_s: time_s + horizon_s, horizon_s, made_s: time_s, by, mixed });
    }

    /// Compares what was foretold of times up to `now_s` with what was.
    pub fn score(&mut self, now_s: f64, history: &History) {
        while self.waiting.front().is_some_and(|it| it.time_s <= now_s) {
            let Some(foretold) = self.waiting.pop_front() else { break };
            let Some(happened) = history.at(foretold.time_s) else { continue };
            let kept = (-(foretold.made_s - self.last_s).max(0.0) / self.memory_s).exp();
            self.last_s = foretold.made_s;
            let scale = foretold.horizon_s.powi(4).max(1e-8);
            let all = foretold.by.iter().chain([&foretold.mixed]);
            for (square, point) in self.squares.iter_mut().zip(all) {
                *square = kept * *square + (point - happened).norm_squared() / 3.0 / scale;
            }
            self.count = kept * self.count + 1.0;
        }
    }

    /// Of each way, summing to 1.
    fn weights(&self) -> [f64; WAYS] {
        let mut weights = [0.0; WAYS];
        for (weight, square) in weights.iter_mut().zip(&self.squares) {
            let mean = square / self.count + TRIFLE_M_S2.powi(2);
            *weight = mean.recip().powi(SHARPNESS);
        }
        let sum: f64 = weights.iter().sum();
        weights.map(|it| it / sum)
    }

    /// The weighted mean of what the ways say.
    pub fn weigh(&self, by: &[Point3<f64>; WAYS]) -> Point3<f64> {
        let weights = self.weights();
        let sum: Vector3<f64> = by.iter().zip(weights).map(|(it, weight)| it.coords * weight).sum();
        Point3::from(sum)
    }

    /// Of one axis, of a way or of the mixture, over a horizon [m²].
    pub fn variance(&self, way: Option<usize>, horizon_s: f64) -> f64 {
        self.squares[way.unwrap_or(WAYS)] / self.count * horizon_s.powi(4)
    }
}
