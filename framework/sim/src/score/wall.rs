//! Recovered pointers on a wall against the true ones: errors in pixels of the wall, identities, false strokes, missed presses.

use std::collections::BTreeMap;

use foveate_estimation::identities::Identities;
use foveate_estimation::statistics::percentile;
use foveate_messages::{PointerChange, Pointers, Provenance, Targets, Time, Users};
use foveate_node::Report;
use foveate_plot::{Axis, COLOURS, Chart, Figure, Series, nothing};
use nalgebra::Point2;

use super::warmup::Warmup;
use crate::truth::TrueCamera;
use crate::wall::{Press, Wall, in_wall_space};

/// A press that lasts no longer need not be found: three fields of a camera at 60 Hz [s].
const LEAST_PRESS_S: f64 = 0.05;
/// A spot that was off the wall for longer may be another stroke when it returns [s]: its light never went out, so both its old identity and a new one are right.
const AWAY_S: f64 = 0.05;
/// This near to the edge of a picture a spot is passed on from camera to camera [px].
const BORDER_PX: f64 = 12.0;
/// Pointers closer to each other than this cross: their spots are one in the pictures [m].
const CROSSING_M: f64 = 0.012;
/// A press of this length is a stroke, no click [s].
const LONG_S: f64 = 1.0;
/// Samples that are drawn at most.
const MOST_DRAWN: usize = 40_000;

/// Compares messages of targets with a wall.
pub struct WallScorer {
    gate: f64,
    start_s: f64,
    cameras: Vec<TrueCamera>,
    identities: Identities,
    presses: BTreeMap<u32, Observed>,
    /// By the press's number: when it was last on the wall, and the key of that visit. A pointer that leaves the wall and returns is another stroke.
    visits: BTreeMap<u32, (Time, u32)>,
    next_visit: u32,
    found: BTreeMap<u32, Identity>,
    /// Pairs of users who are crossing.
    crossing: BTreeMap<(u32, u32), bool>,
    crossings: u64,
    errors: [Vec<f64>; 3],
    /// True and recovered places, by user [m].
    drawn: Vec<(u32, [f64; 2], [f64; 2])>,
    warmup: Warmup,
    messages: u64,
    /// What events said; `None` where none came.
    events: Option<Events>,
    /// Users of targets, as last reported; `None` where nothing identifies users.
    users: Option<Users>,
    /// Targets with a user, and those of them with a wrong one.
    with_user: [u64; 2],
}

/// Events against true presses.
#[derive(Debug, Clone, Default)]
struct Events {
    /// By the press's key, how often it was reported, and the last reported time of its end.
    reported: BTreeMap<u32, (u32, Option<Time>)>,
    /// By identity, the press that its event was matched to.
    of: BTreeMap<u32, u32>,
    false_presses: u64,
}

/// Kinds of samples whose errors are kept apart.
const MEASURED: usize = 0;
const PREDICTED: usize = 1;
const AT_BORDERS: usize = 2;

/// A true press so far.
#[derive(Debug, Clone, Copy)]
struct Observed {
    first: Time,
    last: Time,
    found: Option<Time>,
    /// Identities of its first and its last target.
    identities: Option<[u32; 2]>,
    /// Its last assigned user, and whether that is right.
    user: Option<bool>,
    /// When it had a user first.
    decided: Option<Time>,
}

/// A recovered identity so far.
#[derive(Debug, Clone, Copy)]
struct Identity {
    last: Time,
    /// The press that it was matched to last.
    press: Option<u32>,
}

impl WallScorer {
    /// Targets farther than `gate` [m] from a spot are not that spot; what is before `start_s` is not scored.
    pub fn new(gate: f64, start_s: f64, cameras: Vec<TrueCamera>) -> WallScorer {
        WallScorer {
            gate,
            start_s,
            cameras,
            identities: Identities::new(gate),
            presses: BTreeMap::new(),
            visits: BTreeMap::new(),
            next_visit: 0,
            found: BTreeMap::new(),
            crossing: BTreeMap::new(),
            crossings: 0,
            errors: Default::default(),
            drawn: Vec::new(),
            warmup: Warmup::default(),
            messages: 0,
            events: None,
            users: None,
            with_user: [0; 2],
        }
    }

    /// Takes in whose the targets of the next message are.
    pub fn users(&mut self, users: &Users) {
        self.users = Some(users.clone());
    }

    /// Takes in what pointers did; comes after the targets that it was made of.
    pub fn pointers(&mut self, wall: &Wall, pointers: &Pointers) {
        let gate = self.gate;
        let events = self.events.get_or_insert_default();
        for it in pointers.events.iter().filter(|it| it.time.as_s() >= self.start_s) {
            match it.what {
                PointerChange::Press => {
                    let off = |press: &Press| (press.point - it.position).norm();
                    let nearest = wall.presses(it.time).min_by(|a, b| off(a).total_cmp(&off(b)));
                    let key = nearest.filter(|it| off(it) <= gate).and_then(|it| Some(self.visits.get(&it.number)?.1));
                    match key {
                        Some(key) => {
                            events.reported.entry(key).or_default().0 += 1;
                            events.of.insert(it.id.0, key);
                        }
                        None => events.false_presses += 1,
                    }
                }
                PointerChange::Release => {
                    if let Some(key) = events.of.get(&it.id.0) {
                        events.reported.entry(*key).or_default().1 = Some(it.time);
                    }
                }
                _ => {}
            }
        }
    }

    /// Takes in a message.
    pub fn recovered(&mut self, wall: &Wall, targets: &Targets) {
        let time = targets.time;
        if !self.warmup.is_scored(time, self.start_s) {
            return;
        }
        self.messages += 1;
        let mut presses: Vec<Press> = wall.presses(time).collect();
        for press in &mut presses {
            press.number = self.visit(press.number, time, targets);
        }
        self.count_crossings(&presses);
        let truth: Vec<_> = presses.iter().map(|it| (it.number, in_wall_space(&it.point))).collect();
        let found: Vec<_> = targets.list.iter().map(|it| (it.id.0, it.position)).collect();
        let matched = self.identities.match_up(&truth, &found).to_vec();
        for it in &targets.list {
            let identity = self.found.entry(it.id.0).or_insert(Identity { last: time, press: None });
            identity.last = identity.last.max(time);
        }
        let pixel = wall.settings().pixel_mm * 1e-3;
        for (press, column) in presses.iter().zip(matched) {
            let none = Observed { first: time, last: time, found: None, identities: None, user: None, decided: None };
            let observed = self.presses.entry(press.number).or_insert(none);
            (observed.first, observed.last) = (observed.first.min(time), observed.last.max(time));
            let Some(column) = column else { continue };
            let target = &targets.list[column];
            let first = observed.identities.map_or(target.id.0, |it| it[0]);
            observed.identities = Some([first, target.id.0]);
            if let Some(user) = self.users.as_ref().and_then(|it| it.of(target.id)) {
                let is_right = user == press.user + 1;
                observed.user = Some(is_right);
                observed.decided = Some(observed.decided.unwrap_or(time));
                self.with_user[0] += 1;
                self.with_user[1] += u64::from(!is_right);
            }
            observed.found = Some(observed.found.map_or(time, |it| it.min(time)));
            self.found.entry(target.id.0).and_modify(|it| it.press = Some(press.number));
            let error = (target.position - in_wall_space(&press.point)).norm() / pixel;
            if target.provenance != Provenance::Measured {
                self.errors[PREDICTED].push(error);
                continue;
            }
            self.errors[MEASURED].push(error);
            if self.is_at_border(wall, &press.point) {
                self.errors[AT_BORDERS].push(error);
            }
            if self.drawn.len() < MOST_DRAWN {
                let place = [press.point.x, press.point.y];
                self.drawn.push((press.user, place, [target.position.x, target.position.y]));
            }
        }
    }

    /// The key of a press; another one after a return to the wall, unless the identity that it had is still carried on.
    fn visit(&mut self, press: u32, time: Time, targets: &Targets) -> u32 {
        let (last, key) = self.visits.entry(press).or_insert((Time(i64::MIN / 2), u32::MAX));
        if (time.0 - last.0) as f64 * 1e-9 > AWAY_S {
            let had = self.presses.get(key).and_then(|it| it.identities).map(|it| it[1]);
            if !targets.list.iter().any(|it| Some(it.id.0) == had) {
                *key = self.next_visit;
                self.next_visit += 1;
            }
        }
        *last = time.max(*last);
        *key
    }

    fn count_crossings(&mut self, presses: &[Press]) {
        for (number, one) in presses.iter().enumerate() {
            for other in &presses[number + 1..] {
                let cross = (one.point - other.point).norm() < CROSSING_M;
                let before = self.crossing.insert((one.user, other.user), cross).unwrap_or(false);
                self.crossings += u64::from(cross && !before);
            }
        }
    }

    fn is_at_border(&self, wall: &Wall, point: &Point2<f64>) -> bool {
        self.cameras.iter().any(|camera| {
            let Some(pixel) = camera.project(&wall.in_space(point)) else { return false };
            let [width, height] = camera.image_size.map(f64::from);
            let inside = [pixel.x + 0.5, width - 0.5 - pixel.x, pixel.y + 0.5, height - 0.5 - pixel.y];
            inside.into_iter().fold(f64::MAX, f64::min).abs() < BORDER_PX
        })
    }

    /// The figures.
    pub fn finish(&self, report: &mut Report) {
        let groups = [("wall_px", MEASURED), ("predicted_px", PREDICTED), ("border_px", AT_BORDERS)];
        for (name, group) in groups {
            let errors = &self.errors[group];
            for (word, percent) in [("median", 50.0), ("p95", 95.0)] {
                report.figure(format!("{name}.{word}"), percentile(errors, percent).unwrap_or(f64::NAN));
            }
        }
        let long: Vec<&Observed> =
            self.presses.values().filter(|it| (it.last - it.first).as_s() >= LEAST_PRESS_S).collect();
        let waits = |percent: f64| {
            let waits: Vec<f64> = long.iter().filter_map(|it| Some((it.found? - it.first).as_ms())).collect();
            percentile(&waits, percent).unwrap_or(f64::NAN)
        };
        let after: Vec<f64> =
            self.found.values().filter_map(|it| Some((it.last - self.presses.get(&it.press?)?.last).as_ms())).collect();
        report.figure("presses", long.len() as f64);
        report.figure("missed_presses", long.iter().filter(|it| it.found.is_none()).count() as f64);
        report.figure("false_strokes", self.found.values().filter(|it| it.press.is_none()).count() as f64);
        report.figure("id_switches", self.identities.id_switches() as f64);
        report.figure("broken_strokes", self.identities.reinitialisations() as f64);
        report.figure("crossings", self.crossings as f64);
        report.figure("press_ms.median", waits(50.0));
        report.figure("press_ms.p95", waits(95.0));
        report.figure("release_ms.median", percentile(&after, 50.0).unwrap_or(f64::NAN));
        if let Some(events) = &self.events {
            let reported = |key: &u32| events.reported.get(key).map_or(0, |it| it.0);
            let pressed = self.presses.iter().filter(|it| (it.1.last - it.1.first).as_s() >= LEAST_PRESS_S);
            let missed = pressed.filter(|it| reported(it.0) == 0).count();
            let doubled: u32 = events.reported.values().map(|it| it.0.saturating_sub(1)).sum();
            report.figure("press_events_missed", missed as f64);
            report.figure("press_events_doubled", f64::from(doubled));
            report.figure("press_events_false", events.false_presses as f64);
            let off = events
                .reported
                .iter()
                .filter_map(|(key, it)| Some((it.1? - self.presses.get(key)?.last).as_ms().abs()));
            let off: Vec<f64> = off.collect();
            for (word, percent) in [("median", 50.0), ("p95", 95.0)] {
                report.figure(format!("release_event_ms.{word}"), percentile(&off, percent).unwrap_or(f64::NAN));
            }
        }
        if self.users.is_some() {
            self.report_users(&long, report);
        }
        report.figure("scored_messages", self.messages as f64);
        if let Some(remark) = self.warmup.remark(self.start_s) {
            report.remark(remark);
        }
    }

    fn report_users(&self, presses: &[&Observed], report: &mut Report) {
        let found: Vec<&Observed> = presses.iter().filter(|it| it.found.is_some()).copied().collect();
        let share = |of: &[&Observed], is: &dyn Fn(&Observed) -> bool| {
            of.iter().filter(|it| is(it)).count() as f64 / of.len() as f64
        };
        let long: Vec<&Observed> = found.iter().filter(|it| (it.last - it.first).as_s() >= LONG_S).copied().collect();
        report.figure("user_right", share(&found, &|it| it.user == Some(true)));
        report.figure("user_wrong", share(&found, &|it| it.user == Some(false)));
        report.figure("user_undecided", share(&found, &|it| it.user.is_none()));
        report.figure("user_right_long", share(&long, &|it| it.user == Some(true)));
        let [with, wrong] = self.with_user;
        report.figure("user_wrong_samples", wrong as f64 / with as f64);
        let waits: Vec<f64> = found.iter().filter_map(|it| Some((it.decided? - it.first).as_ms())).collect();
        for (word, percent) in [("median", 50.0), ("p95", 95.0)] {
            report.figure(format!("user_ms.{word}"), percentile(&waits, percent).unwrap_or(f64::NAN));
        }
        report.figure("identity_kept", share(&found, &|it| it.identities.is_some_and(|it| it[0] == it[1])));
    }

    /// True and recovered strokes on the wall, as SVG.
    pub fn picture(&self, size: [f64; 2]) -> String {
        let title = "Strokes on the wall";
        if self.drawn.is_empty() {
            return nothing(title, "no stroke was recovered");
        }
        let x = Axis::new("x [m]").over(0.0, size[0]);
        // The wall's y runs down.
        let y = Axis::new("-y [m]").over(-size[1], 0.0);
        let mut chart = Chart::new("", [900.0, 900.0 * size[1] / size[0]], x, y);
        let mut users: Vec<u32> = self.drawn.iter().map(|it| it.0).collect();
        users.sort_unstable();
        users.dedup();
        for user in users {
            let own = self.drawn.iter().filter(|it| it.0 == user);
            let colour = COLOURS[user as usize % COLOURS.len()];
            chart = chart.with(Series::dots(
                format!("user {}", user + 1),
                colour,
                own.map(|it| [it.2[0], -it.2[1]]).collect(),
            ));
        }
        Figure { title: title.to_owned(), n_columns: 1, charts: vec![chart] }.svg()
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use foveate_messages::{CameraSet, Target, TargetId, TargetUser};
    use nalgebra::{Matrix6, Vector3};

    use super::*;
    use crate::truth::Truth;
    use crate::wall::WallSettings;

    /// Figures of a run of ten seconds in which targets are what `change` makes of the truth.
    fn figures(change: impl Fn(&mut Targets)) -> BTreeMap<String, f64> {
        figures_with(change, |_, _| None)
    }

    /// The same with users reported by `users` from a press and of the time [s] since the start.
    fn figures_with(change: impl Fn(&mut Targets), users: impl Fn(Press, f64) -> Option<u32>) -> BTreeMap<String, f64> {
        let wall = Wall::new(WallSettings::default(), Truth::default(), &Random::new(3));
        let mut scorer = WallScorer::new(0.02, 0.0, Vec::new());
        // A pointer that leaves the wall and returns is another one, as trackers have it.
        let mut visits = BTreeMap::<u32, (i32, u32)>::new();
        for step in 0..2000 {
            let time = Time::from_s(f64::from(step) / 200.0);
            let mut identity = |number: u32| {
                let (last, visit) = visits.entry(number).or_insert((step, 0));
                *visit += u32::from(step - *last > 10);
                *last = step;
                TargetId(number + 1000 * *visit)
            };
            let list = wall.presses(time).map(|it| Target {
                id: identity(it.number),
                position: in_wall_space(&it.point),
                velocity: Vector3::zeros(),
                covariance: Matrix6::identity(),
                cameras: CameraSet::default(),
                provenance: Provenance::Measured,
            });
            let list: Vec<Target> = list.collect();
            let reported = wall.presses(time).zip(&list);
            let reported =
                reported.filter_map(|(it, target)| Some(TargetUser { id: target.id, user: users(it, time.as_s())? }));
            let reported: Vec<TargetUser> = reported.collect();
            if !reported.is_empty() {
                scorer.users(&Users { time, list: reported, exchanged: Vec::new() });
            }
            let mut targets = Targets { time, list };
            change(&mut targets);
            scorer.recovered(&wall, &targets);
        }
        let mut report = Report::default();
        scorer.finish(&mut report);
        assert!(scorer.picture(wall.size()).ends_with("</svg>\n"));
        report.figures.into_iter().collect()
    }

    #[test]
    fn truth_itself_has_no_error_and_every_press() {
        let found = figures(|_| ());
        assert_eq!([found["wall_px.p95"], found["missed_presses"], found["id_switches"]], [0.0; 3]);
        assert_eq!([found["false_strokes"], found["broken_strokes"]], [0.0; 2]);
        assert!(found["presses"] >= 12.0 && found["crossings"] >= 4.0, "{found:?}");
    }

    #[test]
    fn what_is_wrong_is_counted() {
        let shifted = figures(|it| it.list.iter_mut().for_each(|it| it.position.x += 0.0016));
        assert!((shifted["wall_px.median"] - 2.0).abs() < 1e-9, "{shifted:?}");
        let nothing = figures(|it| it.list.clear());
        assert_eq!(nothing["missed_presses"], nothing["presses"]);
        let far = figures(|it| {
            if let Some(mut other) = it.list.first().cloned() {
                (other.id, other.position.x) = (TargetId(9999), other.position.x + 0.5);
                it.list.push(other);
            }
        });
        assert_eq!([far["false_strokes"], far["missed_presses"]], [1.0, 0.0]);
        let one = figures(|it| it.list.iter_mut().for_each(|it| it.id = TargetId(it.id.0 % 4)));
        assert!(one["id_switches"] >= 8.0, "an identity that goes on to the next press: {one:?}");
        let kept = figures(|it| it.list.iter_mut().for_each(|it| it.id.0 %= 1000));
        assert_eq!([kept["id_switches"], kept["broken_strokes"]], [0.0; 2], "a light that left the wall and came back");
        let broken = figures(|it| {
            let half = it.time.as_s() >= 5.0;
            it.list.iter_mut().for_each(|it| it.id.0 += if half { 100_000 } else { 0 });
        });
        assert!(broken["broken_strokes"] >= 1.0 && broken["id_switches"] == 0.0, "{broken:?}");
    }

    #[test]
    fn users_are_judged_only_where_they_are_reported() {
        assert!(!figures(|_| ()).contains_key("user_right"));
        let right = figures_with(|_| (), |press, _| Some(press.user + 1));
        assert_eq!([right["user_right"], right["user_wrong"], right["user_undecided"]], [1.0, 0.0, 0.0]);
        assert_eq!([right["user_right_long"], right["identity_kept"], right["user_ms.p95"]], [1.0, 1.0, 0.0]);
        let taken = figures_with(|_| (), |press, _| (press.user < 2).then_some(1));
        assert!(
            (0.1..0.5).contains(&taken["user_wrong"]) && (0.3..0.7).contains(&taken["user_undecided"]),
            "{taken:?}"
        );
        assert!((0.3..0.7).contains(&taken["user_wrong_samples"]), "{taken:?}");
        let late = figures_with(|_| (), |press, time_s| (time_s >= 5.0).then_some(press.user + 1));
        assert!(late["user_ms.p95"] > 300.0 && late["user_wrong"] == 0.0, "{late:?}");
        let other = figures_with(
            |it| it.list.iter_mut().for_each(|target| target.id.0 += if it.time.as_s() < 5.0 { 0 } else { 100_000 }),
            |press, _| Some(press.user + 1),
        );
        assert!((0.5..1.0).contains(&other["identity_kept"]), "{other:?}");
    }

    #[test]
    fn events_are_held_against_true_presses() {
        let wall = Wall::new(WallSettings::default(), Truth::default(), &Random::new(3));
        let figures = |keep: &dyn Fn(u32) -> u32, off: f64| {
            let mut scorer = WallScorer::new(0.02, 0.0, Vec::new());
            let mut before = BTreeMap::<u32, Press>::new();
            for step in 0..2000 {
                let time = Time::from_s(f64::from(step) / 200.0);
                scorer.recovered(&wall, &Targets { time, list: Vec::new() });
                let now: BTreeMap<u32, Press> = wall.presses(time).map(|it| (it.number, it)).collect();
                let event = |it: &Press, what: PointerChange| foveate_messages::PointerEvent {
                    id: TargetId(it.number),
                    user: None,
                    what,
                    time,
                    latency: foveate_messages::Interval(0),
                    position: it.point + nalgebra::Vector2::new(off, 0.0),
                    path: Vec::new(),
                };
                let mut events = Vec::new();
                for it in now.values().filter(|it| !before.contains_key(&it.number)) {
                    (0..keep(it.number)).for_each(|_| events.push(event(it, PointerChange::Press)));
                }
                for it in before.values().filter(|it| !now.contains_key(&it.number)) {
                    events.push(event(it, PointerChange::Release));
                }
                let (list, exchanged) = (Vec::new(), Vec::new());
                scorer.pointers(&wall, &Pointers { time, shown_at: time, list, exchanged, events });
                before = now;
            }
            let mut report = Report::default();
            scorer.finish(&mut report);
            let found: BTreeMap<String, f64> = report.figures.into_iter().collect();
            ["missed", "doubled", "false"].map(|it| found[&format!("press_events_{it}")])
        };
        let [missed, doubled, none] = figures(&|_| 1, 0.0);
        assert_eq!([missed, none], [0.0; 2]);
        // A pointer that leaves the wall for a moment is told twice here, and is one press.
        assert!(doubled < 4.0, "{doubled}");
        let [_, twice, _] = figures(&|_| 2, 0.0);
        assert!(twice > doubled + 10.0, "{twice}");
        let [half, _, _] = figures(&|it| it % 2, 0.0);
        assert!(half > 4.0, "{half}");
        let [_, _, beside] = figures(&|_| 1, 0.3);
        assert!(beside > 10.0, "{beside}");
    }
}
