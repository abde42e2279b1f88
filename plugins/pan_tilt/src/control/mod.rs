//! Control of a head that tracks a target: [Davis 2002 §4.3–4.4].
//!
//! | step | here |
//! |---|---|
//! | predicted target when the command takes effect | [`Predictor`] |
//! | setting with the target in the middle of the image | [`aim`] |
//! | predicted head at that time, and its latency | [`ActuatorEstimator`] |
//! | the command | [`HeadController::command`] |
//!
//! A command given at t takes effect at T = t + latency. The head's angles and rates at T follow from the commands given so far; the desired
//! angles at T and at the following commands from the predictor. Of all possible commands the one is given whose
//! predicted motion is nearest to these: [`track_path`](fn@track_path).

mod settings;
#[cfg(test)]
mod tests;

use foveate::estimation::actuator::{MotorLimits, Order, track_path};
use foveate::estimation::{ActuatorEstimator, Predictor};
use foveate::geometry::pan_tilt::{Aim, PanTiltHead, Setting, Unreachable, aim, aim_at_sphere};
use foveate::prelude::{HeadEvent, HeadOrder, HeadReport, Target, Time};
use nalgebra::{Matrix3, Point3, Vector3};

pub use self::settings::{Control, ControlSettings, LatencyFrom, PredictorKind};

/// Smallest change of the zoom that is commanded, relative to its range [–].
const ZOOM_BAND: f64 = 0.01;

/// Planning horizon in commands: the head accelerates and brakes in about that time.
const AHEAD: usize = 3;

/// A command for the head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lead {
    /// The order for the motors.
    pub order: HeadOrder,
    /// The zoom position, where the selector controls it.
    pub zoom: Option<f64>,
    /// Whether the target is within its limits.
    pub reachable: bool,
}

/// One head and the target that it tracks.
#[derive(Debug, Clone)]
pub struct HeadController {
    settings: ControlSettings,
    head: PanTiltHead,
    radius: f64,
    predictor: Predictor,
    actuator: ActuatorEstimator,
    /// The last desired setting: the next one is near it.
    wanted: Setting,
    /// Direction after smoothing, and its time.
    damped: Option<(Time, [f64; 2])>,
    commanded: Option<(Time, [f64; 2])>,
    commanded_zoom: Option<f64>,
}

impl HeadController {
    /// A head at rest, without reports yet. `radius` of the sub-region in metres.
    pub fn new(settings: ControlSettings, head: PanTiltHead, radius: f64) -> HeadController {
        let rest = head.limits.clamp(&Setting::default());
        HeadController {
            predictor: Predictor::new(settings.predictor_options(head.at_rest.centre())),
            actuator: ActuatorEstimator::new(settings.actuator_options(), 0.0, [rest.pan, rest.tilt]),
            wanted: rest,
            damped: None,
            commanded: None,
            commanded_zoom: None,
            settings,
            head,
            radius,
        }
    }

    /// Switches to another target.
    pub fn change_target(&mut self) {
        self.predictor.clear();
        self.damped = None;
    }

    /// Takes in the target at `time`, with the offset of the tracked point; predicted targets carry no information.
    pub fn see(&mut self, time: Time, target: &Target, offset: &Vector3<f64>) {
        let covariance: Matrix3<f64> = target.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        self.predictor.observe(time.as_s(), target.position + offset, target.velocity, &covariance);
    }

    /// Takes in a report of the head; `next_event` as for [`HeadReport::since`].
    pub fn take_report(&mut self, report: &HeadReport, next_event: &mut u64) {
        for (at, event) in report.since(next_event) {
            take_event(&mut self.actuator, *at, event);
        }
    }

    /// Latency from a command on the line to the first movement, mean and standard deviation [s].
    pub fn latency_s(&self) -> [f64; 2] {
        self.actuator.latency()
    }

    /// Whether the next command may be given.
    pub fn is_due(&self, now: Time) -> bool {
        self.commanded.is_none_or(|(at, _)| (now - at).as_s() >= 0.98 / self.settings.rate_hz)
    }

    /// The command at `now`: `None` if the target is lost, the last command is too recent, or the head is already on the target.
    pub fn command(&mut self, now: Time) -> Option<Lead> {
        let last_s = self.predictor.last_s()?;
        if !self.is_due(now) || now.as_s() - last_s > self.settings.lost_ms * 1e-3 {
            return None;
        }
        let obeys_s = match self.settings.latency {
            LatencyFrom::Fixed => last_s + self.settings.latency_ms * 1e-3,
            LatencyFrom::Measured => now.as_s() + self.actuator.latency()[0],
        };
        match self.settings.control {
            Control::Step => self.step(now, obeys_s),
            Control::Predictive => self.predictive(now, obeys_s),
        }
    }

    /// The paper's control: to the predicted position, with a speed proportional to the distance.
    fn step(&mut self, now: Time, obeys_s: f64) -> Option<Lead> {
        let (wanted, reachable) = self.wanted_at(obeys_s)?;
        self.wanted = wanted.setting;
        let goal = self.damp(now, [wanted.setting.pan, wanted.setting.tilt], f64::INFINITY);
        let from = self.actuator.at(now.as_s())?.angles;
        let band = self.settings.dead_band_deg.to_radians();
        if !self.zooms(&wanted) && self.commanded.is_some_and(|it| is_near(&goal, &it.1, band)) {
            return None;
        }
        let speeds = [0, 1].map(|it| {
            let speed = (goal[it] - from[it]).abs() / (self.settings.settle_ms * 1e-3);
            speed.min(self.settings.max_speed_deg_per_s[it].to_radians())
        });
        Some(self.lead(now, goal, speeds, wanted, reachable))
    }

    /// Model predictive control: the order whose predicted motion is nearest to the target over the horizon.
    fn predictive(&mut self, now: Time, obeys_s: f64) -> Option<Lead> {
        let ControlSettings { still_deg_per_s, dead_band_deg, max_speed_deg_per_s, speeds, .. } = self.settings;
        let period_s = 1.0 / self.settings.rate_hz;
        let mut path = [[0.0; 2]; AHEAD + 1];
        // The nearest last: the predictor learns over the horizon that was asked for last.
        for number in (1..=AHEAD).rev() {
            let (next, _) = self.wanted_at(obeys_s + period_s * number as f64)?;
            path[number] = [next.setting.pan, next.setting.tilt];
        }
        let (wanted, reachable) = self.wanted_at(obeys_s)?;
        path[0] = [wanted.setting.pan, wanted.setting.tilt];
        self.wanted = wanted.setting;
        let head = self.actuator.at(obeys_s)?;
        let rates = [0, 1].map(|it| (path[1][it] - path[0][it]) / period_s);
        let pace = rates[0].hypot(rates[1]);
        let still = still_deg_per_s.to_radians();
        let there = if pace < still { self.damp(now, path[1], pace) } else { self.undamped(now, path[1]) };
        let is_still = pace < still && head.rates.iter().all(|it| it.abs() < still) && !self.zooms(&wanted);
        if is_still && self.commanded.is_some_and(|it| is_near(&there, &it.1, dead_band_deg.to_radians())) {
            return None;
        }
        let acceleration = self.actuator.acceleration();
        let orders = [0, 1].map(|axis| {
            let most_speed = max_speed_deg_per_s[axis].to_radians();
            let limits = MotorLimits { acceleration, max_speed: most_speed, speeds: speeds[axis] };
            track_path([head.angles[axis], head.rates[axis]], &limits, &path.map(|it| it[axis]), period_s)
        });
        // What hardly moves is gone to, smoothed, and not past.
        let goals = if pace < still { there } else { orders.map(|it| it[0]) };
        Some(self.lead(now, goals, orders.map(|it| it[1]), wanted, reachable))
    }

    fn lead(&mut self, now: Time, goal: [f64; 2], speeds: [f64; 2], wanted: Aim, reachable: bool) -> Lead {
        let within = self.head.limits.clamp(&Setting::new(goal[0], goal[1]));
        let angles = [within.pan, within.tilt];
        self.commanded = Some((now, angles));
        // Below the slowest speed is not the same as no motion.
        let speeds = speeds.map(|it| it.max(1e-3));
        let zoom = wanted.setting.zoom.filter(|_| self.settings.fill > 0.0);
        self.commanded_zoom = zoom;
        Lead { order: HeadOrder::Go { angles, speeds }, zoom, reachable }
    }

    /// Whether the desired zoom differs by more than [`ZOOM_BAND`].
    fn zooms(&self, wanted: &Aim) -> bool {
        let (Some(table), Some(zoom)) = (&self.head.zoom, wanted.setting.zoom) else { return false };
        let [first, last] = table.range();
        let before = self.commanded_zoom.unwrap_or(f64::INFINITY);
        self.settings.fill > 0.0 && (zoom - before).abs() > ZOOM_BAND * (last - first).abs()
    }

    /// The desired setting at a time, and whether the head can reach it.
    fn wanted_at(&mut self, time_s: f64) -> Option<(Aim, bool)> {
        let target = self.predictor.predict(time_s)?.position;
        Some(match self.aim_at(&target) {
            Ok(aim) => (aim, true),
            Err(out) => (out.nearest, false),
        })
    }

    fn aim_at(&self, target: &Point3<f64>) -> Result<Aim, Unreachable> {
        if self.settings.fill > 0.0 {
            aim_at_sphere(&self.head, target, self.radius, self.settings.fill, &self.wanted)
        } else {
            aim(&self.head, target, &self.wanted)
        }
    }

    /// Smooths angles; less the faster the target moves.
    fn damp(&mut self, now: Time, angles: [f64; 2], pace: f64) -> [f64; 2] {
        let still = self.settings.still_deg_per_s.to_radians();
        let part = if pace.is_finite() && still > 0.0 { (1.0 - pace / still).max(0.0) } else { 1.0 };
        let time_constant = self.settings.damping_ms * 1e-3 * part;
        let damped = match self.damped {
            Some((at, before)) if time_constant > 0.0 => {
                let taken = 1.0 - (-(now - at).as_s() / time_constant).exp();
                [0, 1].map(|it| before[it] + (angles[it] - before[it]) * taken)
            }
            _ => angles,
        };
        self.damped = Some((now, damped));
        damped
    }

    fn undamped(&mut self, now: Time, angles: [f64; 2]) -> [f64; 2] {
        self.damped = Some((now, angles));
        angles
    }
}

fn is_near(a: &[f64; 2], b: &[f64; 2], within: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < within)
}

/// Updates a model of the motors with an event of the head.
pub(crate) fn take_event(actuator: &mut ActuatorEstimator, at: Time, event: &HeadEvent) {
    match *event {
        HeadEvent::Sent(HeadOrder::Go { angles, speeds }) => {
            actuator.order(at.as_s(), [0, 1].map(|it| Order::Go { goal: angles[it], speed: speeds[it] }));
        }
        HeadEvent::Sent(HeadOrder::Turn { rates }) => actuator.order(at.as_s(), rates.map(Order::Turn)),
        HeadEvent::Position(it) => actuator.answer(it.earliest.as_s(), it.latest.as_s(), it.angles),
        HeadEvent::Link(_) | HeadEvent::Arrived | HeadEvent::Zoom(_) => {}
    }
}
