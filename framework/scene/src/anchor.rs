//! Which target carries the space of a scale: picked by a rule, kept as long as it exists, lost, and found again.
//!
//! An [`Anchor`] takes all targets of one scale, one time after another, and gives the state of the one that it follows, or that it is
//! lost. It knows no messages and no clock:
//!
//! | the target | the anchor |
//! |---|---|
//! | listed, and measured within the last `lost_ns` | follows it, predicted samples included |
//! | not listed any more, or predicted only for longer | lost since it was last measured |
//! | measured again under the same identity | followed again at once |
//! | lost, and the rule has picked another one for `settle_ns` | follows that one from then on |
//!
//! A target that was not measured within `lost_ns` is never picked, so that one that is only extrapolated is not picked again at once.

use nalgebra::{Matrix6, Point3, Vector3};

/// Which of several targets is picked.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Pick {
    /// The oldest one: of the smallest identity.
    #[default]
    First,
    /// The one with the greatest z.
    Highest,
    /// The one with the smallest z.
    Lowest,
    /// The nearest to a place in the space of the targets [m].
    Nearest(Point3<f64>),
    /// The one of this identity and no other.
    Id(u32),
}

/// Rule by which a target is picked, kept and picked again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnchorRule {
    /// Which one is picked.
    pub pick: Pick,
    /// From the target to what is followed, in the axes of the targets' space [m].
    pub offset: Vector3<f64>,
    /// Whether it stays with its target as long as that exists; otherwise it changes to the target that the rule picks now.
    pub keep: bool,
    /// A target is followed once the rule has picked it for this long [ns].
    pub settle_ns: i64,
    /// Not measured for longer than this is lost [ns].
    pub lost_ns: i64,
    /// After a loss, for `again_ns`, only targets within this distance [m] of the last position are picked, the nearest first.
    pub again_within: Option<f64>,
    /// How long that holds [ns].
    pub again_ns: i64,
}

impl Default for AnchorRule {
    /// The first target that has been there for 100 ms, kept until it was not measured for 500 ms.
    fn default() -> Self {
        Self {
            pick: Pick::First,
            offset: Vector3::zeros(),
            keep: true,
            settle_ns: 100_000_000,
            lost_ns: 500_000_000,
            again_within: None,
            again_ns: 3_000_000_000,
        }
    }
}

/// A target at one time, as an [`Anchor`] takes it; what is not finite is not seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetObservation {
    /// Who.
    pub id: u32,
    /// [m].
    pub position: Point3<f64>,
    /// [m/s].
    pub velocity: Vector3<f64>,
    /// Of (position, velocity) [m², m²/s, m²/s²].
    pub covariance: Matrix6<f64>,
    /// Whether observations of this very time entered.
    pub is_measured: bool,
}

/// The state of an [`Anchor`].
#[expect(clippy::large_enum_variant, reason = "each anchor holds one of it, and a box would be one more allocation")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AnchorState {
    /// Its target, with the rule's offset added to the position.
    Found(TargetObservation),
    /// It has none.
    Lost {
        /// When the last one was last measured [ns]; `None`: there never was one.
        since_ns: Option<i64>,
    },
}

/// Follows one target by a rule.
#[derive(Debug, Clone)]
pub struct Anchor {
    rule: AnchorRule,
    state: AnchorState,
    /// The time of the last update.
    now_ns: i64,
    /// What is listed now, each with the time it was last measured, if it ever was.
    present: Vec<(TargetObservation, Option<i64>)>,
    before: Vec<(TargetObservation, Option<i64>)>,
    /// The target that is followed or was last.
    last: Option<Last>,
    /// The choice that is not followed yet, and since when it is the choice.
    choice: Option<(u32, i64)>,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    id: u32,
    /// Of the target itself, without offset.
    position: Point3<f64>,
    measured_ns: i64,
}

impl Anchor {
    /// Without a target.
    pub fn new(rule: AnchorRule) -> Anchor {
        Anchor {
            rule,
            state: AnchorState::Lost { since_ns: None },
            now_ns: i64::MIN,
            present: Vec::new(),
            before: Vec::new(),
            last: None,
            choice: None,
        }
    }

    /// Its rule.
    pub fn rule(&self) -> &AnchorRule {
        &self.rule
    }

    /// As of the last update.
    pub fn state(&self) -> AnchorState {
        self.state
    }

    /// Takes all `targets` at `time_ns`. Those of an earlier time than the last ones change nothing.
    pub fn update(&mut self, time_ns: i64, targets: impl IntoIterator<Item = TargetObservation>) -> AnchorState {
        if time_ns < self.now_ns {
            return self.state;
        }
        self.now_ns = time_ns;
        self.note(targets);
        let followed = match self.state {
            AnchorState::Found(followed) => self.alive(followed.id),
            AnchorState::Lost { .. } => None,
        };
        let next = if followed.is_some() && self.rule.keep { None } else { self.choose(followed.is_some()) };
        let settled = self.settled(next, followed.map(|it| it.0.id));
        self.state = match settled.or(followed) {
            Some((target, measured_ns)) => {
                self.last = Some(Last { id: target.id, position: target.position, measured_ns });
                AnchorState::Found(TargetObservation { position: target.position + self.rule.offset, ..target })
            }
            None => AnchorState::Lost { since_ns: self.last.map(|it| it.measured_ns) },
        };
        self.state
    }

    /// Replaces what is listed, and keeps when each was last measured.
    fn note(&mut self, targets: impl IntoIterator<Item = TargetObservation>) {
        std::mem::swap(&mut self.present, &mut self.before);
        self.present.clear();
        for target in targets {
            let numbers = [target.position.coords, target.velocity];
            if !numbers.iter().flatten().chain(&target.covariance).all(|it| it.is_finite()) {
                continue;
            }
            let earlier = self.before.iter().find(|it| it.0.id == target.id).and_then(|it| it.1);
            self.present.push((target, if target.is_measured { Some(self.now_ns) } else { earlier }));
        }
    }

    /// Those that were measured recently, with the time.
    fn eligible(&self) -> impl Iterator<Item = (TargetObservation, i64)> + '_ {
        let is_fresh = |measured_ns: i64| self.now_ns.saturating_sub(measured_ns) <= self.rule.lost_ns;
        self.present.iter().filter_map(move |it| Some((it.0, it.1.filter(|it| is_fresh(*it))?)))
    }

    fn alive(&self, id: u32) -> Option<(TargetObservation, i64)> {
        self.eligible().find(|it| it.0.id == id)
    }

    /// What the rule picks now.
    fn choose(&self, follows_one: bool) -> Option<(TargetObservation, i64)> {
        if let (Some(lost), false) = (self.last, follows_one) {
            if let Some(back) = self.alive(lost.id) {
                return Some(back);
            }
            if let Some(within) = self.rule.again_within
                && self.now_ns.saturating_sub(lost.measured_ns) <= self.rule.again_ns
                && !matches!(self.rule.pick, Pick::Id(_))
            {
                let distance = |it: &(TargetObservation, i64)| (it.0.position - lost.position).norm();
                return least(self.eligible().filter(|it| distance(it) <= within), distance);
            }
        }
        match self.rule.pick {
            Pick::First => least(self.eligible(), |_| 0.0),
            Pick::Highest => least(self.eligible(), |it| -it.0.position.z),
            Pick::Lowest => least(self.eligible(), |it| it.0.position.z),
            Pick::Nearest(place) => least(self.eligible(), |it| (it.0.position - place).norm()),
            Pick::Id(id) => self.alive(id),
        }
    }

    /// `next` once it has been the choice for long enough, or is the lost one.
    fn settled(
        &mut self,
        next: Option<(TargetObservation, i64)>,
        followed: Option<u32>,
    ) -> Option<(TargetObservation, i64)> {
        let Some((target, measured_ns)) = next.filter(|it| followed != Some(it.0.id)) else {
            self.choice = None;
            return None;
        };
        let since_ns = self.choice.filter(|it| it.0 == target.id).map_or(self.now_ns, |it| it.1);
        let is_back = followed.is_none() && self.last.is_some_and(|it| it.id == target.id);
        if is_back || self.now_ns.saturating_sub(since_ns) >= self.rule.settle_ns {
            self.choice = None;
            return Some((target, measured_ns));
        }
        self.choice = Some((target.id, since_ns));
        None
    }
}

/// The one with the least `cost`; of equals the one with the smallest identity.
fn least(
    targets: impl Iterator<Item = (TargetObservation, i64)>,
    cost: impl Fn(&(TargetObservation, i64)) -> f64,
) -> Option<(TargetObservation, i64)> {
    targets.min_by(|a, b| cost(a).total_cmp(&cost(b)).then(a.0.id.cmp(&b.0.id)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn at(id: u32, x: f64, z: f64) -> TargetObservation {
        let (position, velocity) = (Point3::new(x, 0.0, z), Vector3::new(1.0, 0.0, 0.0));
        TargetObservation { id, position, velocity, covariance: Matrix6::identity() * 1e-4, is_measured: true }
    }

    fn predicted(id: u32, x: f64, z: f64) -> TargetObservation {
        TargetObservation { is_measured: false, ..at(id, x, z) }
    }

    /// What is followed after each of the updates [ms].
    #[track_caller]
    fn followed(rule: AnchorRule, updates: &[(i64, &[TargetObservation])]) -> Vec<Option<u32>> {
        let mut anchor = Anchor::new(rule);
        let follow = |&(time_ms, targets): &(i64, &[TargetObservation])| match anchor
            .update(time_ms * MS, targets.iter().copied())
        {
            AnchorState::Found(it) => Some(it.id),
            AnchorState::Lost { .. } => None,
        };
        updates.iter().map(follow).collect()
    }

    fn at_once(pick: Pick) -> AnchorRule {
        AnchorRule { pick, settle_ns: 0, ..AnchorRule::default() }
    }

    #[test]
    fn each_pick_takes_its_target() {
        let all = [at(7, 0.0, 1.0), at(3, 1.0, 2.0), at(5, 2.0, 0.5)];
        let picks = [
            (Pick::First, Some(3)),
            (Pick::Highest, Some(3)),
            (Pick::Lowest, Some(5)),
            (Pick::Nearest(Point3::new(0.1, 0.0, 1.0)), Some(7)),
            (Pick::Id(5), Some(5)),
            (Pick::Id(4), None),
        ];
        for (pick, expected) in picks {
            assert_eq!(followed(at_once(pick), &[(0, &all)]), [expected], "{pick:?}");
        }
        assert_eq!(followed(at_once(Pick::First), &[(0, &[])]), [None]);
    }

    #[test]
    fn target_is_kept_though_another_becomes_the_choice_unless_the_rule_says_otherwise() {
        let updates: [(i64, &[TargetObservation]); 2] =
            [(0, &[at(1, 0.0, 2.0), at(2, 0.0, 1.0)]), (10, &[at(1, 0.0, 1.0), at(2, 0.0, 2.0)])];
        let rule = at_once(Pick::Highest);
        assert_eq!(followed(rule, &updates), [Some(1), Some(1)]);
        assert_eq!(followed(AnchorRule { keep: false, ..rule }, &updates), [Some(1), Some(2)]);
    }

    #[test]
    fn choice_has_to_last() {
        let low = at(1, 0.0, 1.0);
        let high = at(2, 0.0, 2.0);
        let rule = AnchorRule { pick: Pick::Highest, settle_ns: 20 * MS, ..AnchorRule::default() };
        // The first choice is another one 10 ms later, and starts anew.
        let updates: [(i64, &[TargetObservation]); 4] =
            [(0, &[low]), (10, &[low, high]), (20, &[low, high]), (30, &[low, high])];
        assert_eq!(followed(rule, &updates), [None, None, None, Some(2)]);
        // A challenge that ends before it has lasted leaves things as they were.
        let rule = AnchorRule { keep: false, ..rule };
        let updates: [(i64, &[TargetObservation]); 5] =
            [(0, &[low]), (20, &[low]), (30, &[low, high]), (40, &[low]), (50, &[low, high])];
        assert_eq!(followed(rule, &updates), [None, Some(1), Some(1), Some(1), Some(1)]);
    }

    #[test]
    fn predicted_for_too_long_is_lost_and_does_not_come_back_until_measured() {
        let rule = AnchorRule { lost_ns: 30 * MS, ..at_once(Pick::First) };
        let updates: [(i64, &[TargetObservation]); 6] = [
            (0, &[predicted(1, 0.0, 0.0)]),
            (10, &[at(1, 0.0, 0.0)]),
            (40, &[predicted(1, 0.0, 0.0)]),
            (41, &[predicted(1, 0.0, 0.0)]),
            (50, &[predicted(1, 0.0, 0.0)]),
            (60, &[at(1, 0.0, 0.0)]),
        ];
        assert_eq!(followed(rule, &updates), [None, Some(1), Some(1), None, None, Some(1)]);
    }

    #[test]
    fn same_identity_goes_on_at_once_and_another_has_to_last() {
        let rule = AnchorRule { settle_ns: 20 * MS, lost_ns: 5 * MS, ..AnchorRule::default() };
        let (one, two) = (at(1, 0.0, 0.0), at(2, 0.0, 0.0));
        let updates: [(i64, &[TargetObservation]); 7] =
            [(0, &[one]), (20, &[one]), (30, &[]), (40, &[one, two]), (50, &[two]), (60, &[two]), (70, &[two])];
        assert_eq!(followed(rule, &updates), [None, Some(1), None, Some(1), None, None, Some(2)]);
    }

    #[test]
    fn after_a_loss_only_what_is_near_is_picked_for_a_while() {
        let rule = AnchorRule { again_within: Some(0.5), again_ns: 100 * MS, ..at_once(Pick::First) };
        let (far, near, nearer) = (at(2, 3.0, 0.0), at(9, 0.4, 0.0), at(8, 0.2, 0.0));
        let lost: (i64, &[TargetObservation]) = (0, &[at(1, 0.0, 0.0)]);
        assert_eq!(followed(rule, &[lost, (50, &[far]), (60, &[far, near, nearer])]), [Some(1), None, Some(8)]);
        assert_eq!(followed(rule, &[lost, (100, &[far]), (101, &[far])]), [Some(1), None, Some(2)]);
    }

    #[test]
    fn answer_has_offset_velocity_and_covariance_and_a_loss_says_since_when() {
        let offset = Vector3::new(0.0, 0.1, -0.2);
        let mut anchor = Anchor::new(AnchorRule { offset, ..at_once(Pick::First) });
        assert_eq!(anchor.state(), AnchorState::Lost { since_ns: None });
        let moved = TargetObservation { position: Point3::new(1.0, 0.1, 1.8), ..at(4, 1.0, 2.0) };
        assert_eq!(anchor.update(7, [at(4, 1.0, 2.0)]), AnchorState::Found(moved));
        assert_eq!(anchor.update(9, []), AnchorState::Lost { since_ns: Some(7) });
        assert_eq!(anchor.update(8, [at(4, 1.0, 2.0)]), AnchorState::Lost { since_ns: Some(7) }, "of the past");
        // The place to look for it again is the target's, not that with the offset.
        let mut anchor = Anchor::new(AnchorRule { offset, again_within: Some(0.01), ..at_once(Pick::First) });
        anchor.update(0, [at(4, 1.0, 2.0)]);
        assert!(matches!(anchor.update(1, [at(5, 1.0, 2.0)]), AnchorState::Found(_)));
    }

    #[test]
    fn what_is_not_finite_is_not_seen() {
        let mut broken = at(1, 0.0, 0.0);
        broken.covariance[(0, 3)] = f64::NAN;
        let updates: [(i64, &[TargetObservation]); 2] =
            [(0, &[at(1, f64::INFINITY, 0.0), at(2, 0.0, 0.0)]), (1, &[broken])];
        assert_eq!(followed(at_once(Pick::First), &updates), [Some(2), None]);
        // Nor do the ends of the clock overflow.
        let mut anchor = Anchor::new(at_once(Pick::First));
        anchor.update(i64::MIN, [at(1, 0.0, 0.0)]);
        assert_eq!(anchor.update(i64::MAX, [predicted(1, 0.0, 0.0)]), AnchorState::Lost { since_ns: Some(i64::MIN) });
    }
}
