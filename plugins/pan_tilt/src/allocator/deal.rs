//! Allocation of heads to targets over time: the optimum of each moment, adopted smoothly.
//!
//! In each activation the heads are allocated again ([`allocation`](foveate::estimation::allocation)), with a lower cost for a head's present target than
//! for another. The result becomes the *goal* when it has been better than the last goal for a while. Then heads change over one after
//! another: a head leaves a target only while two others, or as many as the goal has, look at it and have arrived. Where that is impossible, as when two
//! targets with two heads each exchange one, one head moves first.

use std::collections::BTreeMap;

use foveate::estimation::allocation::{Problem, solve};
use foveate::geometry::pan_tilt::{PanTiltHead, Setting, aim};
use foveate::prelude::*;
use nalgebra::{Point3, Vector3};

use super::settings::AllocatorSettings;

/// Allocates heads to targets.
pub struct Allocator {
    settings: AllocatorSettings,
    heads: Vec<Head>,
    known: BTreeMap<TargetId, Known>,
    /// By head: its target in the goal.
    goal: Vec<Option<TargetId>>,
    /// Since when another allocation has been better.
    better_since: Option<Time>,
    last: Option<Time>,
    tally: Tally,
}

/// Counts so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// Assignments sent.
    pub assignments: u64,
    /// Heads that were assigned another target than their last one.
    pub switches: u64,
    /// Heads that moved although their target was left with fewer than two.
    pub forced: u64,
    /// Requested targets, over all assignments.
    pub targets: u64,
    /// Targets with two or more heads that had arrived.
    pub seen_by_two: u64,
}

struct Head {
    camera: CameraId,
    model: PanTiltHead,
    /// Its pan and tilt, as far as known.
    setting: Setting,
    /// It has reported its pan and tilt.
    has_reported: bool,
    away: bool,
    target: Option<TargetId>,
    /// Its target, or the last one it had.
    last_target: Option<TargetId>,
    /// Arrival time at `target`.
    arrives: Time,
}

#[derive(Clone, Copy)]
struct Known {
    position: Point3<f64>,
    velocity: Vector3<f64>,
    seen: Time,
}

/// A candidate head for a target.
#[derive(Clone, Copy)]
struct Reach {
    setting: Setting,
    seconds: f64,
}

impl Allocator {
    /// For these heads, initially at rest.
    pub fn new(settings: AllocatorSettings, heads: impl IntoIterator<Item = (CameraId, PanTiltHead)>) -> Allocator {
        let head = |(camera, model): (CameraId, PanTiltHead)| Head {
            camera,
            setting: model.limits.clamp(&Setting::default()),
            model,
            has_reported: false,
            away: false,
            target: None,
            last_target: None,
            arrives: Time::ZERO,
        };
        let heads: Vec<Head> = heads.into_iter().map(head).collect();
        Allocator {
            goal: vec![None; heads.len()],
            settings,
            heads,
            known: BTreeMap::new(),
            better_since: None,
            last: None,
            tally: Tally::default(),
        }
    }

    /// Counts so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// Takes in a head's report.
    pub fn take_report(&mut self, report: &HeadReport) {
        let Some(head) = self.heads.iter_mut().find(|it| it.camera == report.camera) else { return };
        head.away = report.link == HeadLink::Away;
        let positions = report.events.iter().rev();
        let last =
            positions.map(|it| it.1).find_map(|it| if let HeadEvent::Position(at) = it { Some(at) } else { None });
        if let Some([pan, tilt]) = last.map(|it| it.angles).filter(|it| it.iter().all(|it| it.is_finite())) {
            head.setting = Setting { pan, tilt, ..head.setting };
            head.has_reported = true;
        }
    }

    /// Takes all targets of one time; an assignment when the last one is old enough.
    pub fn update(&mut self, targets: &Targets) -> Option<Assignment> {
        let now = targets.time;
        if self.last.is_some_and(|last| now - last < Interval::from_s(1.0 / self.settings.rate_hz)) {
            self.learn(targets);
            return None;
        }
        self.last = Some(now);
        self.learn(targets);
        let most = match self.settings.most_targets {
            0 => usize::MAX,
            n => n as usize,
        };
        let wanted: Vec<(TargetId, Point3<f64>)> =
            self.known.iter().take(most).map(|(id, it)| (*id, it.at(now))).collect();
        let reach = self.reach(now, &wanted);
        self.choose(now, &wanted, &reach);
        self.change_over(now, &wanted, &reach);
        self.count(now, &wanted);
        let mut list: Vec<(CameraId, TargetId)> =
            self.heads.iter().filter_map(|head| Some((head.camera, head.target?))).collect();
        list.sort_unstable();
        Some(Assignment { list })
    }

    fn learn(&mut self, targets: &Targets) {
        let only = &self.settings.only;
        for target in targets.list.iter().filter(|it| only.is_empty() || only.contains(&it.id.0)) {
            let Target { position, velocity, .. } = *target;
            if position.iter().chain(&velocity).all(|it| it.is_finite()) {
                self.known.insert(target.id, Known { position, velocity, seen: targets.time });
            }
        }
        let keep = Interval::from_ms(self.settings.keep_ms);
        self.known.retain(|_, it| targets.time - it.seen <= keep);
    }

    /// By head, by target: its view of the target; `None`: out of reach.
    fn reach(&mut self, now: Time, wanted: &[(TargetId, Point3<f64>)]) -> Vec<Vec<Option<Reach>>> {
        let speeds = [self.settings.pan_deg_s, self.settings.tilt_deg_s].map(f64::to_radians);
        let mut reach = Vec::with_capacity(self.heads.len());
        for head in &mut self.heads {
            let one = |head: &Head, place: &Point3<f64>| {
                let setting = aim(&head.model, place, &head.setting).ok().filter(|_| !head.away)?.setting;
                let turns = [setting.pan - head.setting.pan, setting.tilt - head.setting.tilt];
                let seconds = (turns[0].abs() / speeds[0]).max(turns[1].abs() / speeds[1]);
                Some(Reach { setting, seconds })
            };
            // A head that tells nothing is taken to look at its target once it has had the time.
            let own = head.target.and_then(|id| wanted.iter().find(|it| it.0 == id));
            if let Some(there) =
                own.filter(|_| !head.has_reported && head.arrives <= now).and_then(|it| one(head, &it.1))
            {
                head.setting = there.setting;
            }
            reach.push(wanted.iter().map(|it| one(head, &it.1)).collect());
        }
        reach
    }

    /// Sets the goal.
    fn choose(&mut self, now: Time, wanted: &[(TargetId, Point3<f64>)], reach: &[Vec<Option<Reach>>]) {
        let n = wanted.len();
        let place_of = |id: Option<TargetId>| id.and_then(|id| wanted.iter().position(|it| it.0 == id));
        let (mut costs, mut towards) = (Vec::new(), Vec::new());
        for (head, reach) in self.heads.iter().zip(reach) {
            let present = place_of(head.target);
            for (target, (_, place)) in wanted.iter().enumerate() {
                let Some(Reach { setting, seconds }) = reach[target] else {
                    costs.push(f64::INFINITY);
                    towards.push(Vector3::zeros());
                    continue;
                };
                let leaves = present.is_some_and(|it| it != target);
                costs.push(
                    self.settings.slew_cost_per_s * seconds + if leaves { self.settings.switch_cost } else { 0.0 },
                );
                towards.push(head.model.camera_at(&setting).centre() - place);
            }
        }
        let most = self.settings.heads_per_target as usize;
        let problem = Problem::new(self.settings.worth(), most, &vec![1.0; n], &costs, &towards);
        let mut goal: Vec<Option<usize>> = self.goal.iter().map(|id| place_of(*id)).collect();
        let mut broken = false;
        for (head, target) in goal.iter_mut().enumerate() {
            if target.is_some_and(|it| reach[head][it].is_none()) {
                *target = None;
                broken = true;
            }
        }
        // Without targets the problem knows of no heads.
        let mut found = solve(&problem, if n == 0 { &[] } else { &goal });
        found.target_of.resize(self.heads.len(), None);
        let is_better = n > 0 && found.total > problem.total(&goal) + 1e-9;
        let since = *self.better_since.get_or_insert(now);
        if !is_better {
            self.better_since = None;
        } else if broken || now - since >= Interval::from_ms(self.settings.settle_ms) {
            goal = found.target_of;
            self.better_since = None;
        }
        self.goal = goal.iter().map(|it| it.map(|it| wanted[it].0)).collect();
    }

    /// Moves heads towards the goal, as far as no target is left alone by it.
    fn change_over(&mut self, now: Time, wanted: &[(TargetId, Point3<f64>)], reach: &[Vec<Option<Reach>>]) {
        let place_of = |id: TargetId| wanted.iter().position(|it| it.0 == id);
        for head in 0..self.heads.len() {
            let lost =
                self.heads[head].target.is_some_and(|id| place_of(id).is_none_or(|it| reach[head][it].is_none()));
            if lost {
                self.heads[head].target = None;
            }
            if self.heads[head].target.is_none() && self.goal[head].is_some() {
                self.send(now, head, wanted, reach);
            }
        }
        let mut waiting = None;
        let mut one_went = false;
        for head in 0..self.heads.len() {
            let Some(present) = self.heads[head].target.filter(|it| self.goal[head] != Some(*it)) else { continue };
            let needed = self.goal.iter().filter(|it| **it == Some(present)).count().min(2);
            let others = self
                .heads
                .iter()
                .enumerate()
                .filter(|(place, it)| *place != head && it.target == Some(present) && it.arrives <= now);
            if others.count() >= needed {
                self.send(now, head, wanted, reach);
                one_went = true;
            } else if waiting.is_none() {
                waiting = Some(head);
            }
        }
        let all_there = self.heads.iter().all(|it| it.target.is_none() || it.arrives <= now);
        if let Some(head) = waiting.filter(|_| all_there && !one_went) {
            self.tally.forced += 1;
            self.send(now, head, wanted, reach);
        }
    }

    /// Moves a head to its goal.
    fn send(&mut self, now: Time, head: usize, wanted: &[(TargetId, Point3<f64>)], reach: &[Vec<Option<Reach>>]) {
        let goal = self.goal[head];
        let place = goal.and_then(|id| wanted.iter().position(|it| it.0 == id));
        let seconds = place.and_then(|it| reach[head][it]).map_or(0.0, |it| it.seconds);
        let it = &mut self.heads[head];
        self.tally.switches += u64::from(goal.is_some() && it.last_target.is_some_and(|last| goal != Some(last)));
        it.target = goal;
        it.last_target = goal.or(it.last_target);
        it.arrives = now + Interval::from_ms(self.settings.latency_ms + 1e3 * seconds);
    }

    fn count(&mut self, now: Time, wanted: &[(TargetId, Point3<f64>)]) {
        self.tally.assignments += 1;
        for (id, _) in wanted {
            let looking = self.heads.iter().filter(|it| it.target == Some(*id) && it.arrives <= now).count();
            self.tally.targets += 1;
            self.tally.seen_by_two += u64::from(looking >= 2);
        }
    }
}

impl Known {
    fn at(&self, now: Time) -> Point3<f64> {
        self.position + self.velocity * (now - self.seen).as_s()
    }
}

#[cfg(test)]
mod tests {
    use foveate::geometry::pan_tilt::Limits;
    use foveate_testkit::scene::camera_ring;

    use super::*;

    /// Lets heads with the targets `before` change over to `goal`, ten turns a second: the least number of heads that had arrived at
    /// targets 0 and 1, and how many went ahead without relief.
    #[track_caller]
    fn change_over(before: &[Option<u32>], goal: &[Option<u32>]) -> ([usize; 2], u64) {
        let models = camera_ring(before.len()).into_iter().zip(0..);
        let heads = models.map(|(it, n)| (CameraId(n), PanTiltHead::aligned(it, Limits::WIDE)));
        let mut allocator = Allocator::new(AllocatorSettings::default(), heads);
        allocator.goal = goal.iter().map(|it| it.map(TargetId)).collect();
        allocator.heads.iter_mut().zip(before).for_each(|(head, target)| head.target = target.map(TargetId));
        let wanted = [0, 1].map(|id| (TargetId(id), Point3::new(f64::from(id) - 0.5, 0.0, 1.0)));
        let mut least = [usize::MAX; 2];
        for turn in 1..50 {
            let now = Time::from_s(0.1 * f64::from(turn));
            let reach = allocator.reach(now, &wanted);
            allocator.change_over(now, &wanted, &reach);
            for (least, (id, _)) in least.iter_mut().zip(&wanted) {
                let there = allocator.heads.iter().filter(|it| it.target == Some(*id) && it.arrives <= now);
                *least = there.count().min(*least);
            }
        }
        let after: Vec<Option<TargetId>> = allocator.heads.iter().map(|it| it.target).collect();
        assert_eq!(after, allocator.goal);
        (least, allocator.tally.forced)
    }

    #[test]
    fn a_head_leaves_its_target_when_another_has_come_for_it() {
        let (a, b) = (Some(0), Some(1));
        // A free head comes for the one that leaves.
        assert_eq!(change_over(&[a, a, b, b, None], &[a, b, b, b, a]), ([2, 2], 0));
        // Each relieves the next one.
        assert_eq!(change_over(&[a, a, b, b, None], &[a, b, b, None, a]), ([2, 2], 0));
    }

    #[test]
    fn two_that_exchange_heads_lose_one_at_a_time() {
        let (a, b) = (Some(0), Some(1));
        assert_eq!(change_over(&[a, a, b, b], &[a, b, a, b]), ([1, 2], 1));
    }
}
