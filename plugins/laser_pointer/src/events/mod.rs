//! `laser_pointer.events`: turns targets on a wall into events: appear, press, move, hover, dwell, release, stroke, vanish.
//!
//! | event | when | time of the event |
//! |---|---|---|
//! | appear | the tracker has measured a new target | that moment |
//! | press | it has been there for `on_ms`, in `min_seen` measurements (`press = "light"`), or has dwelt (`press = "dwell"`) | the appearance, or the dwell |
//! | move | while it is pressed, `move_mm` from the last move event | that moment |
//! | hover | it has kept within `rest_radius_mm` for `hover_ms` | the end of that time |
//! | dwell | the same for `dwell_ms`, once a rest | the end of that time |
//! | release, stroke, vanish | it was not measured for `off_ms` | the last measurement |
//!
//! Each event states its latency: from its moment until it was sent. `predicted` is the pointer's place when people see what is shown for it:
//! `display_latency_ms` after it was sent.
//!
//! Time advances with the targets' own, also where their list is empty: a release needs a message after the pointer was lost. Targets that come late, from a camera
//! behind the others, are left out and counted.
//!
//! Where `users` is connected, pointers and events have a user. When two identities turn out to be exchanged, each stroke continues where its pointer is, and gets the
//! points that were drawn in its place under the other one.

mod one;

use std::collections::BTreeMap;

use foveate::estimation::statistics::percentile;
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::one::{Change, One};
use crate::smoothing::SmoothingSettings;

ports! {
    TARGETS: In<Targets> = each("targets");
    USERS: In<Users> = each("users").optional();
    POINTERS: Out<Pointers> = "pointers";
}

figures! {
    "pointer.{appear,press,move,hover,dwell,release,stroke,vanish}": count, neither, "Events of that kind";
    "pointer.flashes": count, low, "Pointers that appeared and vanished without having been pressed";
    "pointer.late": count, low, "Measurements left out: not after the last one of their pointer";
        "pointer.left_out": count, low, "Measurements left out because of too many pointers at once";
        "pointer.move_latency_ms.{p50,p99}": ms, low, "From capture to event, over all moves";
    "pointer.press_latency_ms.{p50,p99}": ms, low, "From a pointer's first observation to its press event, over all presses";
}

/// Most pointers at once; a wall full of people has a tenth. Bounds the output of a faulty tracker.
const MOST_POINTERS: usize = 256;
/// Latencies kept for the figures; more are thinned to every second one, repeatedly.
const MOST_LATENCIES: usize = 1 << 16;

/// What presses a pointer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum PressBy {
    /// Its light, for as long as it is on.
    #[default]
    Light,
    /// A dwell, until the light goes out.
    Dwell,
}

/// Settings of [`Events`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct EventSettings {
    /// How a pointer is pressed: by its `light`, or by a `dwell` [–]
    pub press: PressBy,
    /// Time for which it must be visible before it is pressed, which ignores flashes. Delays the press, whose time and stroke begin with the appearance nevertheless [ms]
    #[schemars(range(min = 0.0, max = 5000.0))]
    pub on_ms: f64,
    /// Measurements that this needs as well, the first included [–]
    #[schemars(range(min = 1, max = 1000))]
    pub min_seen: u32,
    /// Time without a measurement after which it is released: bridges flicker, and gaps between tiles [ms]
    #[schemars(range(min = 1.0, max = 10000.0))]
    pub off_ms: f64,
    /// Shortest move that makes an event [mm]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub move_mm: f64,
    /// A pointer rests while it stays within this radius: more than a hand trembles [mm]
    #[schemars(range(min = 0.1, max = 10000.0))]
    pub rest_radius_mm: f64,
    /// Rest before a hover [ms]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub hover_ms: f64,
    /// Rest before a dwell [ms]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub dwell_ms: f64,
    /// Delay from an event until people see what is shown for it, as measured at this display [ms]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub display_latency_ms: f64,
    /// Jitter filter, and prediction of pointers [–]
    pub smoothing: SmoothingSettings,
}

impl Default for EventSettings {
    fn default() -> Self {
        Self {
            press: PressBy::default(),
            on_ms: 25.0,
            min_seen: 3,
            off_ms: 100.0,
            move_mm: 1.0,
            rest_radius_mm: 25.0,
            hover_ms: 200.0,
            dwell_ms: 800.0,
            display_latency_ms: 30.0,
            smoothing: SmoothingSettings::default(),
        }
    }
}

impl EventSettings {
    fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("on_ms", self.on_ms, 0.0..=5000.0)?;
        ConfigError::unless_in("min_seen", self.min_seen, 1..=1000)?;
        ConfigError::unless_in("off_ms", self.off_ms, 1.0..=10_000.0)?;
        ConfigError::unless_in("move_mm", self.move_mm, 0.0..=1000.0)?;
        ConfigError::unless_in("rest_radius_mm", self.rest_radius_mm, 0.1..=10_000.0)?;
        ConfigError::unless_in("hover_ms", self.hover_ms, 0.0..=60_000.0)?;
        ConfigError::unless_in("dwell_ms", self.dwell_ms, self.hover_ms..=60_000.0)?;
        ConfigError::unless_in("display_latency_ms", self.display_latency_ms, 0.0..=1000.0)?;
        self.smoothing.check("smoothing")
    }
}

/// Targets in, pointers and events out.
pub struct Events {
    settings: EventSettings,
    pointers: BTreeMap<TargetId, One>,
    /// Users of the next message's targets.
    users: Users,
    /// The newest time so far.
    time: Time,
    counts: BTreeMap<PointerChange, u64>,
    n_flashes: u64,
    n_late: u64,
    n_left_out: u64,
    move_latencies: Latencies,
    press_latencies: Latencies,
}

impl Node for Events {
    const TYPE: &'static str = "laser_pointer.events";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str =
        "Turns pointers into events with latency: press, move, hover, dwell, release, strokes";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = EventSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: EventSettings, _: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        Ok(Self {
            settings,
            pointers: BTreeMap::new(),
            users: Users::default(),
            time: Time(i64::MIN),
            counts: BTreeMap::new(),
            n_flashes: 0,
            n_late: 0,
            n_left_out: 0,
            move_latencies: Latencies::default(),
            press_latencies: Latencies::default(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(users) = io.take(&USERS) {
            let waits = std::mem::take(&mut self.users.exchanged);
            self.users = (*users.value).clone();
            self.users.exchanged.splice(0..0, waits);
        }
        let Some(Stamped { stamp, value: targets }) = io.take(&TARGETS) else { return Ok(()) };
        self.time = self.time.max(targets.time);
        let exchanged = std::mem::take(&mut self.users.exchanged);
        exchanged.iter().for_each(|it| self.exchange(it));
        let mut found = Vec::new();
        for target in targets.list.iter().filter(|it| it.provenance == Provenance::Measured) {
            self.see(target, targets.time, &mut found);
        }
        for it in &self.users.list {
            if let Some(one) = self.pointers.get_mut(&it.id) {
                one.user = Some(it.user);
            }
        }
        let off = Interval::from_ms(self.settings.off_ms);
        let lost: Vec<TargetId> =
            self.pointers.iter().filter(|it| self.time - it.1.last_seen >= off).map(|it| *it.0).collect();
        lost.into_iter().for_each(|id| self.end(id, &mut found));
        let events = found.into_iter().map(|(id, user, it)| self.event(io.now(), id, user, it)).collect();
        let shown_at = io.now() + Interval::from_ms(self.settings.display_latency_ms);
        let list = self.pointers.values().map(|it| it.at(self.time, shown_at)).collect();
        io.emit(&POINTERS, stamp, Pointers { time: self.time, shown_at, list, exchanged, events });
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        for what in PointerChange::ALL {
            let n = self.counts.get(&what).copied().unwrap_or(0);
            report.figure(format!("pointer.{}", what.name()), n as f64);
        }
        report.figure("pointer.flashes", self.n_flashes as f64);
        report.figure("pointer.late", self.n_late as f64);
        report.figure("pointer.left_out", self.n_left_out as f64);
        for (name, latencies) in [("move", &self.move_latencies), ("press", &self.press_latencies)] {
            for (percentile, value) in latencies.percentiles() {
                report.figure(format!("pointer.{name}_latency_ms.{percentile}"), value);
            }
        }
        if self.n_left_out > 0 {
            let n = self.n_left_out;
            report.remark(format!(
                "{n} measurements of pointers were left out: expected at most {MOST_POINTERS} pointers at once"
            ));
        }
        Ok(())
    }
}

impl Events {
    /// Exchanges two pointers whose identities were confused.
    fn exchange(&mut self, Exchange { ids: [first, second], since }: &Exchange) {
        let Some(mut one) = self.pointers.remove(first) else { return };
        if let Some(other) = self.pointers.get_mut(second) {
            one.exchange(other, *since);
        }
        self.pointers.insert(*first, one);
    }

    /// A target was measured.
    fn see(&mut self, target: &Target, time: Time, found: &mut Vec<(TargetId, Option<u32>, Change)>) {
        let mut changes = Vec::new();
        if let Some(one) = self.pointers.get_mut(&target.id) {
            self.n_late += u64::from(!one.see(&self.settings, target, time, &mut changes));
        } else if self.pointers.len() < MOST_POINTERS {
            self.pointers.insert(target.id, One::new(&self.settings, target, time, &mut changes));
        } else {
            self.n_left_out += 1;
        }
        found.extend(changes.into_iter().map(|it| (target.id, None, it)));
    }

    /// A pointer was lost.
    fn end(&mut self, id: TargetId, found: &mut Vec<(TargetId, Option<u32>, Change)>) {
        let Some(one) = self.pointers.remove(&id) else { return };
        self.n_flashes += u64::from(!one.is_pressed());
        let (user, mut changes) = (one.user, Vec::new());
        one.end(&mut changes);
        found.extend(changes.into_iter().map(|it| (id, user, it)));
    }

    /// The event of a change at `now`; `user` is the user of a pointer that is gone.
    fn event(&mut self, now: Time, id: TargetId, user: Option<u32>, change: Change) -> PointerEvent {
        let Change { what, time, position, path } = change;
        let user = self.pointers.get(&id).map_or(user, |it| it.user);
        let latency = now - time;
        *self.counts.entry(what).or_default() += 1;
        match what {
            PointerChange::Move => self.move_latencies.push(latency),
            PointerChange::Press => self.press_latencies.push(latency),
            _ => {}
        }
        PointerEvent { id, user, what, time, latency, position, path }
    }
}

/// Latencies of many events, evenly thinned where there are too many.
#[derive(Default)]
struct Latencies {
    kept_ms: Vec<f64>,
    stride: u64,
    n: u64,
}

impl Latencies {
    fn push(&mut self, latency: Interval) {
        self.stride = self.stride.max(1);
        if self.n.is_multiple_of(self.stride) {
            self.kept_ms.push(latency.as_ms());
            if self.kept_ms.len() >= MOST_LATENCIES {
                let mut n = 0_u32;
                self.kept_ms.retain(|_| {
                    n += 1;
                    n % 2 == 1
                });
                self.stride *= 2;
            }
        }
        self.n += 1;
    }

    /// NaN where there was none.
    fn percentiles(&self) -> [(&'static str, f64); 2] {
        [("p50", 50.0), ("p99", 99.0)].map(|(name, it)| (name, percentile(&self.kept_ms, it).unwrap_or(f64::NAN)))
    }
}

#[cfg(test)]
mod tests;
