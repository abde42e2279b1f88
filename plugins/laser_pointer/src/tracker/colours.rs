//! The user of a pointer from the colour labels of its spots.
//!
//! One frame's label may be wrong, where contents shine or spots touch, or missing. So each track has a Bayes filter over the labels of users' colours and over light of no such colour; each
//! label that a spot of its own has is one observation. A part of the probability returns to the prior with time, since a track may switch to another pointer.

use foveate::prelude::Time;

use super::settings::{TrackerSettings, UserCode};

/// Probability that a spot of a user's colour gets that colour's label, and that it gets another label: an uncertain detector gives none.
const RIGHT: f64 = 0.8;
const WRONG: f64 = 0.02;
/// For light of no user's colour: the probability of getting one of the labels.
const BY_CHANCE: f64 = 0.1;
/// Prior of light of no user's colour.
const OTHERS: f64 = 0.1;
/// Share of the probability that returns to the prior [1/s].
const CHANGE_PER_S: f64 = 0.05;

/// The colours of all users.
#[derive(Debug, Clone)]
pub(super) struct Colours {
    /// Sorted, without repetition.
    labels: Vec<u32>,
    /// User and label.
    users: Vec<(u32, u32)>,
    sure: f64,
}

/// State of one light's colour.
#[derive(Debug, Clone)]
pub(super) struct Belief {
    last: Time,
    /// By label, and last for none of them.
    weights: Vec<f64>,
    /// Label of the last labelled spots, and their number since the track may last have switched to another light.
    run: (Option<u32>, u32),
}

impl Belief {
    /// Consecutive spots with the same label: errors of neighbouring frames are correlated, so a few frames are weak evidence.
    pub fn run(&self) -> u32 {
        self.run.1
    }

    /// The track may have switched to another light.
    pub fn doubt(&mut self) {
        self.run.1 = 0;
    }
}

impl Colours {
    /// `None` where no user has a colour.
    pub fn new(settings: &TrackerSettings) -> Option<Colours> {
        let users = settings.users.iter().filter_map(|UserCode { user, colour, .. }| Some((*user, (*colour)?)));
        let users: Vec<(u32, u32)> = users.collect();
        let mut labels: Vec<u32> = users.iter().map(|it| it.1).collect();
        labels.sort_unstable();
        labels.dedup();
        (!users.is_empty()).then_some(Colours { labels, users, sure: settings.sure })
    }

    fn prior(&self) -> impl Iterator<Item = f64> + '_ {
        let n = self.labels.len();
        (0..=n).map(move |it| if it == n { OTHERS } else { (1.0 - OTHERS) / n as f64 })
    }

    /// A new light from `time` on.
    pub fn belief(&self, time: Time) -> Belief {
        Belief { last: time, weights: self.prior().collect(), run: (None, 0) }
    }

    /// Probability of `label` for light of kind `kind`.
    fn likelihood(&self, kind: usize, label: Option<u32>) -> f64 {
        let n = self.labels.len();
        match label.map(|it| self.labels.binary_search(&it).ok()) {
            // A label that no user has is none of theirs.
            None | Some(None) if kind == n => 1.0 - BY_CHANCE,
            None | Some(None) => 1.0 - RIGHT - WRONG,
            Some(Some(_)) if kind == n => BY_CHANCE / n as f64,
            Some(Some(at)) if at == kind => RIGHT,
            Some(Some(_)) => WRONG / (n as f64 - 1.0).max(1.0),
        }
    }

    /// Updates with a spot at `time`, not before the last one, with `label`.
    pub fn observe(&self, belief: &mut Belief, time: Time, label: Option<u32>) {
        let kept = (-CHANGE_PER_S * (time - belief.last).as_s().max(0.0)).exp();
        belief.last = time;
        if label.is_some() {
            belief.run = (label, if label == belief.run.0 { belief.run.1 + 1 } else { 1 });
        }
        for ((kind, weight), prior) in belief.weights.iter_mut().enumerate().zip(self.prior()) {
            *weight = (*weight * kept + (1.0 - kept) * prior) * self.likelihood(kind, label);
        }
        let sum: f64 = belief.weights.iter().sum();
        belief.weights.iter_mut().for_each(|it| *it /= sum);
    }

    /// Minus twice the log likelihood of a spot with that label for this light, relative to the likeliest label.
    pub fn cost(&self, belief: &Belief, label: Option<u32>) -> f64 {
        let weights = belief.weights.iter().enumerate();
        let p = |label: Option<u32>| weights.clone().map(|(kind, it)| it * self.likelihood(kind, label)).sum::<f64>();
        let most = self.labels.iter().map(|it| p(Some(*it))).fold(p(None), f64::max);
        -2.0 * (p(label) / most).ln()
    }

    /// The users of the light's colour, if it is certain; empty where it has no user's colour.
    pub fn users(&self, belief: &Belief) -> Option<Vec<u32>> {
        let kind = belief.weights.iter().position(|it| *it > self.sure)?;
        let of = |label: u32| self.users.iter().filter(|it| it.1 == label).map(|it| it.0).collect();
        Some(self.labels.get(kind).map_or(Vec::new(), |label| of(*label)))
    }
}

#[cfg(test)]
mod tests {
    use foveate::estimation::random::Random;

    use super::*;

    fn colours(labels: &[u32]) -> Colours {
        let users =
            labels.iter().zip(1..).map(|(label, user)| UserCode { user, period_ms: None, colour: Some(*label) });
        Colours::new(&TrackerSettings { users: users.collect(), ..TrackerSettings::default() }).unwrap()
    }

    /// The users at each frame of 120 Hz of a light whose spots have these labels.
    fn users(colours: &Colours, labels: impl Iterator<Item = Option<u32>>) -> Vec<Option<Vec<u32>>> {
        let mut belief = colours.belief(Time::ZERO);
        let frames = labels.enumerate().map(|(frame, label)| {
            colours.observe(&mut belief, Time::from_s(frame as f64 / 120.0), label);
            colours.users(&belief)
        });
        frames.collect()
    }

    #[test]
    fn a_colour_is_sure_after_some_frames_and_one_wrong_label_does_not_change_it() {
        let colours = colours(&[10, 20, 30]);
        let of = users(&colours, [Some(20), None, Some(20), Some(20), Some(10), Some(20), None].into_iter());
        assert_eq!(of[0], None, "one label is not sure");
        assert!(of[3..].iter().all(|it| *it != Some(vec![1])), "{of:?}");
        assert_eq!((&of[3], &of[6]), (&Some(vec![2]), &Some(vec![2])));
        // A label of another rig's colours is no user's, and neither is light without one.
        assert_eq!(users(&colours, (0..20).map(|_| Some(99))).last(), Some(&Some(vec![])));
        assert_eq!(users(&colours, (0..20).map(|_| None)).last(), Some(&Some(vec![])));
    }

    #[test]
    fn labels_that_are_wrong_now_and_then_hardly_ever_give_a_wrong_user() {
        let colours = colours(&[10, 20, 30, 40]);
        let mut n_wrong = 0;
        for seed in 0..200 {
            let mut random = Random::new(seed);
            let labels = (0..240).map(|_| match random.uniform() {
                it if it < 0.6 => Some(30),
                it if it < 0.65 => Some(10 * (1 + random.below(4))),
                _ => None,
            });
            let of = users(&colours, labels);
            // Many labels that are missing make it none of the users' for a while, and one that is wrong leaves it open for some frames.
            let is_wrong = |it: &Option<Vec<u32>>| it.as_ref().is_some_and(|it| !it.is_empty() && *it != vec![3]);
            n_wrong += of.iter().filter(|it| is_wrong(it)).count();
            let right = of.iter().filter(|it| **it == Some(vec![3])).count();
            assert!(right > 140, "seed {seed}: {right} right of 240");
        }
        // Of 48,000 frames; one in 27 had a wrong label.
        assert!(n_wrong < 50, "{n_wrong} wrong");
    }

    #[test]
    fn a_track_that_goes_over_to_another_light_is_decided_anew_and_users_of_one_colour_stay_two() {
        let colours = colours(&[10, 20, 10]);
        let of = users(&colours, (0..60).map(|it| Some(if it < 30 { 20 } else { 10 })));
        assert_eq!(of[29], Some(vec![2]));
        assert_eq!(of[45], Some(vec![1, 3]), "which of the two it is the colour does not tell");
    }

    #[test]
    fn a_spot_of_another_colour_costs_more_than_one_without_and_that_more_than_its_own() {
        let colours = colours(&[10, 20]);
        let mut belief = colours.belief(Time::ZERO);
        (0..10).for_each(|it| colours.observe(&mut belief, Time::from_s(f64::from(it) / 120.0), Some(10)));
        let [own, none, other] = [Some(10), None, Some(20)].map(|it| colours.cost(&belief, it));
        assert!(own == 0.0 && (1.0..5.0).contains(&none) && other > 6.0, "{own} {none} {other}");
    }
}
