//! Estimates latency and pose of a two-axis device (a pan-tilt head) from the commands sent and the angles reported.
//!
//! The pose of a head in motion is not known directly, only where it was commanded to go [Davis 2002 §5.2]. Here many
//! simulated heads, each with another latency and acceleration, execute the commands that were sent; candidates that
//! agree with the reported angles weigh most. Their weighted mean gives the latency, with a standard deviation, and
//! the head's angles at any time: between two reports, and after the last one as far as the commands reach.
//!
//! The variances include how far the mean misses reports beyond their rounding: for a head at rest as an angle, for a
//! moving head as a time by which the mean is late. So a fast move does not raise the stated error at rest.
//!
//! Each report pulls all candidates a little towards itself, so that errors no command explains (a hand, a lost command, a limit) decay.

mod motor;
#[cfg(test)]
mod tests;
mod track_path;

use std::collections::VecDeque;

use self::motor::Motor;
pub use self::motor::Order;
pub use self::track_path::{MotorLimits, track_path};

/// Step of the simulation [s].
const STEP_S: f64 = 0.004;
/// Between two latencies that are tried [s].
const LATENCY_STEP_S: f64 = 0.02;
/// How many accelerations are tried, each twice the last.
const ACCELERATIONS: usize = 5;
/// Part of an answer's surprise that a candidate takes up [–].
const GAIN: f64 = 0.3;
/// A surprise counts no more than this many variances: one garbled answer does not decide.
const MOST_SURPRISE: f64 = 9.0;
/// How much of what the mean missed answers by one more answer replaces [–].
const MISFIT_GAIN: f64 = 0.1;
/// Answers so close share their errors: as many count as one [–].
const ALIKE: f64 = 3.0;
/// Candidates lighter than this are not carried into the future [–].
const LIGHT: f64 = 0.02;
/// How far back it can be asked [s].
const KEPT_S: f64 = 2.0;
/// Without an answer, what is further back than this is not changed by one any more [s].
const SILENCE_S: f64 = 0.5;

/// What is known of a head before it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActuatorOptions {
    /// Latency from a command on the line to the first movement: mean and standard deviation [s].
    pub latency_s: [f64; 2],
    /// The largest latency to try [s].
    pub most_latency_s: f64,
    /// Acceleration; the middle one of those tried [rad/s²].
    pub acceleration: f64,
    /// Rounding of reported pan and tilt: one step [rad].
    pub quantum: [f64; 2],
    /// Shake of the camera on the motors, for example after a change of speed, standard deviation [rad].
    pub shake: f64,
    /// Time constant with which older reports lose weight [s].
    pub memory_s: f64,
}

impl Default for ActuatorOptions {
    /// The EVI-D30: 270 ± 80 ms, 400 °/s², 0.1136° and 0.0833°, a shake of 0.1°, a memory of 10 s.
    fn default() -> Self {
        let [acceleration, pan, tilt, shake] = [400.0, 1.0 / 8.8, 1.0 / 12.0, 0.1].map(f64::to_radians);
        Self { latency_s: [0.27, 0.08], most_latency_s: 0.8, acceleration, quantum: [pan, tilt], shake, memory_s: 10.0 }
    }
}

/// Angles and rates of both axes at one time, with variances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActuatorState {
    /// Pan and tilt [rad].
    pub angles: [f64; 2],
    /// Rates of pan and tilt [rad/s].
    pub rates: [f64; 2],
    /// Variances of the two angles [rad²].
    pub variances: [f64; 2],
}

/// Estimates latency, angles and rates of a two-axis device; see the [module](self).
#[derive(Debug, Clone)]
pub struct ActuatorEstimator {
    options: ActuatorOptions,
    candidates: Vec<Candidate>,
    /// Sent so far and not yet obeyed by all, with the time of sending.
    orders: VecDeque<(f64, [Order; 2])>,
    /// How many orders were taken off the front.
    n_forgotten: u64,
    /// The time to which the candidates have been carried [s].
    now_s: f64,
    past: VecDeque<(f64, ActuatorState)>,
    misfit: [Misfit; 2],
    last_answer_s: Option<f64>,
    /// Of an answer or an observation.
    last_measured_s: Option<f64>,
}

/// What the mean missed answers by, beyond their rounding, discounted.
#[derive(Debug, Clone, Copy, Default)]
struct Misfit {
    /// Mean square while the motor stood [rad²].
    standing: f64,
    /// Sums of squares while it moved, and of its rates then [rad², rad²/s²].
    moving: f64,
    rates: f64,
}

impl Misfit {
    /// One more answer was missed by `beyond` [rad²] at a mean square rate of `rate` [rad²/s²]. Motors that move less than `quantum` [rad] in the time between two latencies that are tried stand.
    fn take(&mut self, beyond: f64, rate: f64, quantum: f64) {
        if rate * LATENCY_STEP_S.powi(2) <= quantum.powi(2) {
            self.standing += MISFIT_GAIN * (beyond - self.standing);
        } else {
            self.moving += beyond - MISFIT_GAIN * self.moving;
            self.rates += rate - MISFIT_GAIN * self.rates;
        }
    }

    /// At a mean square rate [rad²].
    fn variance(&self, rate: f64) -> f64 {
        let late = if self.rates > 0.0 { self.moving / self.rates } else { 0.0 };
        self.standing + late * rate
    }
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    latency_s: f64,
    acceleration: f64,
    motors: [Motor; 2],
    /// How many orders it has obeyed, counted from the first of all.
    n_obeyed: u64,
    /// Discounted sum of surprises, and what speaks against it beforehand.
    against: f64,
    beforehand: f64,
    weight: f64,
}

impl ActuatorEstimator {
    /// An estimator for a device whose motors rest at `angles` [rad] at `time_s`.
    pub fn new(options: ActuatorOptions, time_s: f64, angles: [f64; 2]) -> ActuatorEstimator {
        let mut candidates = Vec::new();
        let n_latencies = (options.most_latency_s / LATENCY_STEP_S).floor().max(0.0) as usize;
        for latency in 0..=n_latencies {
            let latency_s = latency as f64 * LATENCY_STEP_S;
            let beforehand = ((latency_s - options.latency_s[0]) / options.latency_s[1].max(1e-3)).powi(2);
            for power in 0..ACCELERATIONS {
                let octaves = power as f64 - (ACCELERATIONS / 2) as f64;
                candidates.push(Candidate {
                    latency_s,
                    acceleration: options.acceleration * octaves.exp2(),
                    motors: angles.map(Motor::at_rest),
                    n_obeyed: 0,
                    against: 0.0,
                    beforehand: beforehand + 0.25 * octaves * octaves,
                    weight: 0.0,
                });
            }
        }
        let mut actuator = ActuatorEstimator {
            options,
            candidates,
            orders: VecDeque::new(),
            n_forgotten: 0,
            now_s: time_s,
            past: VecDeque::new(),
            misfit: [Misfit::default(); 2],
            last_answer_s: None,
            last_measured_s: None,
        };
        actuator.weigh();
        actuator
    }

    /// Takes in a command that was sent at `time_s`, after all earlier ones.
    pub fn order(&mut self, time_s: f64, orders: [Order; 2]) {
        self.orders.push_back((time_s, orders));
    }

    /// Takes in a report: the device was at `angles` [rad] at some time between `earliest_s` and `latest_s`. A report
    /// from before the start of the stored history changes nothing.
    pub fn answer(&mut self, earliest_s: f64, latest_s: f64, angles: [f64; 2]) {
        let (middle, width) = (0.5 * (earliest_s + latest_s), (latest_s - earliest_s).max(0.0));
        // The head says where its motors are: what shakes on them does not show.
        let rounding = self.options.quantum.map(|it| it.powi(2) / 12.0);
        if self.take_in(middle, width, angles, rounding.map(|it| 2.0 * it)) {
            self.last_answer_s = Some(middle);
        }
    }

    /// Takes in the angles of what the device carries as measured otherwise, for example from a known target in its
    /// picture: `angles` [rad] at `time_s` with `variances` [rad²]. Before the first report, or for a time before the
    /// stored history, it changes nothing.
    pub fn observation(&mut self, time_s: f64, angles: [f64; 2], variances: [f64; 2]) {
        if self.last_answer_s.is_some() && variances.iter().all(|it| it.is_finite()) {
            self.take_in(time_s, 0.0, angles, variances.map(|it| it + self.options.shake.powi(2)));
        }
    }

    /// Whether it was taken in.
    fn take_in(&mut self, time_s: f64, width_s: f64, angles: [f64; 2], variances: [f64; 2]) -> bool {
        if !(time_s.is_finite() && width_s.is_finite() && angles.iter().all(|it| it.is_finite())) || time_s < self.now_s
        {
            return false;
        }
        self.carry_to(time_s);
        let passed = self.last_measured_s.map_or(f64::INFINITY, |it| time_s - it);
        let kept = (-passed / self.options.memory_s).exp();
        if self.last_measured_s.is_none() {
            // Wherever it stood before: this is where it is.
            self.candidates.iter_mut().for_each(|it| it.motors = angles.map(Motor::at_rest));
        }
        let mean = self.mean(&self.candidates);
        let rates = [0, 1].map(|axis| mean_square_rate(&self.candidates, axis));
        for axis in [0, 1] {
            for candidate in &mut self.candidates {
                let motor = &mut candidate.motors[axis];
                let missed = angles[axis] - motor.angle;
                let variance = variances[axis] + (motor.rate * width_s).powi(2) / 12.0;
                let surprise = (missed * missed / variance).min(MOST_SURPRISE);
                candidate.against =
                    if axis == 0 { candidate.against * kept } else { candidate.against } + surprise / ALIKE;
                motor.angle += GAIN * missed;
            }
            let missed = (angles[axis] - mean.angles[axis]).powi(2);
            let beyond = (missed - variances[axis] - (mean.rates[axis] * width_s).powi(2) / 12.0).max(0.0);
            self.misfit[axis].take(beyond, rates[axis], self.options.quantum[axis]);
        }
        self.last_measured_s = Some(time_s);
        self.weigh();
        true
    }

    /// Angles and rates at `time_s`, by all reports of the past two seconds and all commands after the last report.
    /// `None`: before the stored history.
    pub fn at(&mut self, time_s: f64) -> Option<ActuatorState> {
        self.carry_to(time_s - SILENCE_S);
        if time_s >= self.now_s {
            return Some(self.ahead(time_s));
        }
        let place = self.past.partition_point(|it| it.0 <= time_s);
        let before = self.past.get(place.checked_sub(1)?)?;
        let Some(after) = self.past.get(place) else { return Some(before.1) };
        let part = (time_s - before.0) / (after.0 - before.0);
        let between = |a: [f64; 2], b: [f64; 2]| [0, 1].map(|it| a[it] + (b[it] - a[it]) * part);
        Some(ActuatorState {
            angles: between(before.1.angles, after.1.angles),
            rates: between(before.1.rates, after.1.rates),
            variances: between(before.1.variances, after.1.variances),
        })
    }

    /// Latency from a command on the line to the first movement: mean and standard deviation [s].
    pub fn latency(&self) -> [f64; 2] {
        let mean: f64 = self.candidates.iter().map(|it| it.weight * it.latency_s).sum();
        let square: f64 = self.candidates.iter().map(|it| it.weight * (it.latency_s - mean).powi(2)).sum();
        // Latencies between two candidates are not distinguished.
        [mean, (square + LATENCY_STEP_S.powi(2) / 12.0).sqrt()]
    }

    /// Time of the last report or observation taken in [s].
    pub fn last_answer_s(&self) -> Option<f64> {
        self.last_answer_s
    }

    /// Estimated acceleration, weighted mean over the candidates [rad/s²].
    pub fn acceleration(&self) -> f64 {
        self.candidates.iter().map(|it| it.weight * it.acceleration).sum()
    }

    fn carry_to(&mut self, time_s: f64) {
        while self.now_s + STEP_S <= time_s {
            let (orders, forgotten, now) = (&self.orders, self.n_forgotten, self.now_s);
            self.candidates.iter_mut().for_each(|it| it.step(orders, forgotten, now));
            self.now_s += STEP_S;
            let mean = self.mean(&self.candidates);
            self.past.push_back((self.now_s, mean));
            if self.past.front().is_some_and(|it| it.0 < self.now_s - KEPT_S) {
                self.past.pop_front();
            }
        }
        let obeyed = self.candidates.iter().map(|it| it.n_obeyed).min().unwrap_or(0);
        while self.n_forgotten < obeyed {
            self.orders.pop_front();
            self.n_forgotten += 1;
        }
    }

    /// Carries the weightier candidates on, without a trace.
    fn ahead(&self, time_s: f64) -> ActuatorState {
        let mut weighty: Vec<Candidate> = self.candidates.iter().filter(|it| it.weight >= LIGHT).copied().collect();
        let mut now = self.now_s;
        while now + STEP_S <= time_s {
            weighty.iter_mut().for_each(|it| it.step(&self.orders, self.n_forgotten, now));
            now += STEP_S;
        }
        let mut state = self.mean(&weighty);
        let rest = time_s - now;
        state.angles = [0, 1].map(|it| state.angles[it] + state.rates[it] * rest);
        state
    }

    fn mean(&self, candidates: &[Candidate]) -> ActuatorState {
        let sum: f64 = candidates.iter().map(|it| it.weight).sum();
        let over = |of: &dyn Fn(&Candidate) -> f64| candidates.iter().map(|it| it.weight * of(it)).sum::<f64>() / sum;
        let angles = [0, 1].map(|axis| over(&|it| it.motors[axis].angle));
        let rates = [0, 1].map(|axis| over(&|it| it.motors[axis].rate));
        let shake = self.options.shake.powi(2);
        let variances = [0, 1].map(|axis| {
            let spread = over(&|it| (it.motors[axis].angle - angles[axis]).powi(2));
            let missed = self.misfit[axis].variance(mean_square_rate(candidates, axis));
            spread + missed + shake + self.options.quantum[axis].powi(2) / 12.0
        });
        ActuatorState { angles, rates, variances }
    }

    fn weigh(&mut self) {
        let cost = |it: &Candidate| it.against + it.beforehand;
        let least = self.candidates.iter().map(cost).fold(f64::INFINITY, f64::min);
        self.candidates.iter_mut().for_each(|it| it.weight = (-0.5 * (cost(it) - least)).exp());
        let sum: f64 = self.candidates.iter().map(|it| it.weight).sum();
        self.candidates.iter_mut().for_each(|it| it.weight /= sum);
    }
}

/// Weighted mean square of how fast a motor may be [rad²/s²].
fn mean_square_rate(candidates: &[Candidate], axis: usize) -> f64 {
    let sum: f64 = candidates.iter().map(|it| it.weight).sum();
    candidates.iter().map(|it| it.weight * it.motors[axis].rate.powi(2)).sum::<f64>() / sum
}

impl Candidate {
    /// From `now_s` one step on.
    fn step(&mut self, orders: &VecDeque<(f64, [Order; 2])>, n_forgotten: u64, now_s: f64) {
        while let Some((sent_s, order)) = orders.get((self.n_obeyed - n_forgotten) as usize) {
            if sent_s + self.latency_s > now_s {
                break;
            }
            for (motor, order) in self.motors.iter_mut().zip(order) {
                motor.order = *order;
            }
            self.n_obeyed += 1;
        }
        for motor in &mut self.motors {
            motor.advance(STEP_S, self.acceleration);
        }
    }
}
