//! Several hypotheses where the association of one frame is ambiguous.
//!
//! Targets that compete for features, with a second assignment nearly as likely as the first, form a *group*. A group has
//! hypotheses: each holds a filter for every member and a weight, and grows by every assignment of the next frame that is likely
//! enough. Unlikely ones are dropped, equal ones are merged, and a group with a single hypothesis, or
//! at the end of its time, is dissolved. The likeliest hypothesis is sent. This is multiple-hypothesis tracking (D. Reid, "An
//! algorithm for tracking multiple targets", IEEE Trans. Automatic Control 24, 1979), confined to the targets that need it.

use foveate::estimation::motion::Filter;
use foveate::messages::{CameraId, Feature, Interval, TargetId, Time};
use smallvec::SmallVec;

use super::association::{Association, Gate, Pair, View};
use super::track::Track;

/// Most hypotheses of a group.
const MOST_HYPOTHESES: usize = 8;
/// Most targets of a group; where more compete, the likeliest association is used at once.
const MOST_MEMBERS: usize = 6;
/// A hypothesis less likely than the best by more than this factor is dropped; in −2 ln of it: 2 ln 100.
const SLACK: f64 = 9.2;
/// Hypotheses whose filters all differ by less than this, in squared standard deviations, are equal.
const SAME: f64 = 0.25;
/// After this time the likeliest hypothesis of a group is used.
const LONGEST: Interval = Interval(1_500_000_000);

/// All groups.
#[derive(Debug, Default)]
pub(super) struct Hypotheses {
    groups: Vec<Group>,
    /// By target: its group and its place there.
    group_of: Vec<Option<(usize, usize)>>,
    /// By target: its first view, which is of the likeliest hypothesis.
    first_view: Vec<usize>,
    spare: Vec<Hypothesis>,
    joint: Vec<Joint>,
    children: Vec<Child>,
    /// Groups begun.
    pub begun: u64,
}

#[derive(Debug, Default)]
struct Group {
    /// Ascending.
    members: SmallVec<[TargetId; MOST_MEMBERS]>,
    /// The likeliest first.
    hypotheses: SmallVec<[Hypothesis; MOST_HYPOTHESES]>,
    since: Time,
}

#[derive(Debug, Default)]
struct Hypothesis {
    /// −2 ln of its likelihood, the best one's is 0.
    cost: f64,
    /// By member.
    filters: Vec<Filter>,
    /// By member: whether the newest frame showed it.
    seen: SmallVec<[bool; MOST_MEMBERS]>,
}

/// A hypothesis about all targets of a cluster, before the frame.
#[derive(Debug, Clone)]
struct Joint {
    cost: f64,
    /// By target of the cluster: the view it is seen through.
    views: SmallVec<[usize; MOST_MEMBERS]>,
}

/// A child of a joint hypothesis by one assignment.
#[derive(Debug, Clone)]
struct Child {
    cost: f64,
    parent: usize,
    /// By target of the cluster: its candidate.
    choice: SmallVec<[Option<usize>; MOST_MEMBERS]>,
}

/// Data for updating the targets of a frame.
pub(super) struct Frame<'a> {
    pub camera: CameraId,
    pub time: Time,
    pub features: &'a [Feature],
    pub gate: Gate,
}

impl Hypotheses {
    /// Predicts all filters by `dt_s`, each with the noise of its target.
    pub fn predict(&mut self, tracks: &[Track], dt_s: f64) {
        for group in &mut self.groups {
            for (place, id) in group.members.iter().enumerate() {
                let track = tracks.binary_search_by_key(id, |it| it.id).ok().map(|it| &tracks[it]);
                let noise_scale = track.map_or(1.0, |it| it.noise_scale());
                for hypothesis in &mut group.hypotheses {
                    hypothesis.filters[place].predict_scaled(dt_s, noise_scale);
                }
            }
        }
    }

    /// Looks up which of `tracks`, ascending by identity, are in a group; terminated ones leave theirs.
    pub fn look_up(&mut self, tracks: &[Track]) {
        self.group_of.clear();
        self.group_of.resize(tracks.len(), None);
        let place_of = |id: &TargetId| tracks.binary_search_by_key(id, |it| it.id).ok();
        for group in &mut self.groups {
            while let Some(gone) = group.members.iter().position(|it| place_of(it).is_none()) {
                group.members.remove(gone);
                group.hypotheses.iter_mut().for_each(|it| {
                    it.filters.remove(gone);
                });
            }
        }
        let spare = &mut self.spare;
        self.groups.retain_mut(|group| {
            let lives = !group.members.is_empty();
            if !lives {
                spare.extend(group.hypotheses.drain(..));
            }
            lives
        });
        for (number, group) in self.groups.iter().enumerate() {
            for (place, id) in group.members.iter().enumerate() {
                if let Some(track) = place_of(id) {
                    self.group_of[track] = Some((number, place));
                }
            }
        }
        self.first_view.clear();
        let mut view = 0;
        for group in &self.group_of {
            self.first_view.push(view);
            view += group.map_or(1, |(number, _)| self.groups[number].hypotheses.len());
        }
    }

    /// Takes target `id` out of its group: it was found elsewhere.
    pub fn forget(&mut self, id: TargetId) {
        for group in &mut self.groups {
            if let Some(place) = group.members.iter().position(|it| *it == id) {
                group.members.remove(place);
                group.hypotheses.iter_mut().for_each(|it| {
                    it.filters.remove(place);
                });
            }
        }
    }

    /// The filters through which each of `tracks` may be seen.
    pub fn views<'a>(&'a self, tracks: &'a [Track]) -> impl Iterator<Item = View<'a>> {
        tracks.iter().enumerate().flat_map(|(number, track)| {
            let group = self.group_of[number].map(|(group, place)| (&self.groups[group], place));
            let alone = group.is_none().then_some(&track.filter);
            let of_group =
                group.into_iter().flat_map(|(group, place)| group.hypotheses.iter().map(move |it| &it.filters[place]));
            let most_clutter = track.most_clutter();
            alone.into_iter().chain(of_group).map(move |filter| View {
                track: number,
                filter,
                most_clutter,
                shares: None,
            })
        })
    }

    /// Settles the clusters of `association`, whose candidates were found among [`Self::views`]: a clear association becomes chosen pairs, an
    /// ambiguous one a group, whose members are updated here.
    pub fn settle(&mut self, association: &mut Association, tracks: &mut [Track], frame: &Frame<'_>) {
        let groups = &self.groups;
        let place_of = |id: &TargetId| tracks.binary_search_by_key(id, |it| it.id).ok();
        let ties = groups.iter().flat_map(|group| {
            let first = place_of(&group.members[0]);
            group.members.iter().filter_map(move |id| Some((first?, place_of(id)?)))
        });
        let ties: SmallVec<[(usize, usize); 16]> = ties.collect();
        let n_clusters = association.cluster(ties.into_iter());
        for number in 0..n_clusters {
            self.settle_cluster(number, association, tracks, frame);
        }
        let spare = &mut self.spare;
        self.groups.retain_mut(|group| {
            let lasts = group.hypotheses.len() > 1;
            if !lasts {
                spare.extend(group.hypotheses.drain(..));
            }
            lasts
        });
    }

    fn settle_cluster(
        &mut self,
        number: usize,
        association: &mut Association,
        tracks: &mut [Track],
        frame: &Frame<'_>,
    ) {
        let cluster = association.in_cluster(number);
        let members: SmallVec<[usize; 16]> = cluster.tracks.iter().copied().collect();
        let mut groups: SmallVec<[usize; 4]> = members.iter().filter_map(|&it| Some(self.group_of[it]?.0)).collect();
        groups.sort_unstable();
        groups.dedup();
        if members.len() > MOST_MEMBERS {
            // Too many answers to keep: the likeliest is taken, from the likeliest hypothesis of each group.
            for group in groups {
                self.keep_best(group);
            }
            let first_view = &self.first_view;
            association.choose_best_of(number, |pair| pair.view == first_view[pair.track]);
            return;
        }
        if cluster.candidates.is_empty() {
            for group in groups {
                if frame.time - self.groups[group].since > LONGEST {
                    self.keep_best(group);
                }
            }
            return;
        }
        self.join(&members, &groups);
        let candidates = association.candidates();
        self.children.clear();
        for parent in 0..self.joint.len() {
            let joint = &self.joint[parent];
            let rows: SmallVec<[SmallVec<[usize; 4]>; MOST_MEMBERS]> = (joint.views.iter())
                .map(|view| cluster.candidates.iter().copied().filter(|&it| candidates[it].view == *view).collect())
                .collect();
            assign(candidates, &rows, cluster.miss_cost, joint.cost, parent, &mut self.children);
        }
        // A complete order, so that a run can be repeated.
        self.children
            .sort_by(|a, b| a.cost.total_cmp(&b.cost).then_with(|| (a.parent, &a.choice).cmp(&(b.parent, &b.choice))));
        let Some(best) = self.children.first().map(|it| it.cost) else { return };
        self.children.retain(|it| it.cost <= best + SLACK);
        if groups.is_empty() && self.children.len() == 1 {
            let chosen = self.children[0].choice.clone();
            chosen.into_iter().flatten().for_each(|candidate| association.choose_candidate(candidate));
            return;
        }
        self.grow(&members, &groups, association, tracks, frame);
    }

    /// All joint hypotheses about `members`: the likeliest combinations of those of their groups.
    fn join(&mut self, members: &[usize], groups: &[usize]) {
        self.joint.clear();
        self.joint.push(Joint { cost: 0.0, views: members.iter().map(|&it| self.first_view[it]).collect() });
        for &group in groups {
            let before = std::mem::take(&mut self.joint);
            for joint in &before {
                for (place, hypothesis) in self.groups[group].hypotheses.iter().enumerate() {
                    let mut more = joint.clone();
                    more.cost += hypothesis.cost;
                    for (view, &member) in more.views.iter_mut().zip(members) {
                        if self.group_of[member].is_some_and(|it| it.0 == group) {
                            *view = self.first_view[member] + place;
                        }
                    }
                    self.joint.push(more);
                }
            }
            self.joint.sort_by(|a, b| a.cost.total_cmp(&b.cost).then_with(|| a.views.cmp(&b.views)));
            self.joint.truncate(MOST_HYPOTHESES);
        }
    }

    /// Makes one group of `members` out of `groups` and the children found, and updates all its filters.
    fn grow(
        &mut self,
        members: &[usize],
        groups: &[usize],
        association: &mut Association,
        tracks: &mut [Track],
        frame: &Frame<'_>,
    ) {
        let candidates = association.candidates();
        let mut hypotheses: SmallVec<[Hypothesis; MOST_HYPOTHESES]> = SmallVec::new();
        for child in &self.children {
            if hypotheses.len() == MOST_HYPOTHESES {
                break;
            }
            let mut hypothesis = self.spare.pop().unwrap_or_default();
            hypothesis.cost = child.cost;
            hypothesis.filters.clear();
            hypothesis.seen.clear();
            let views = &self.joint[child.parent].views;
            for ((&member, &view), &choice) in members.iter().zip(views).zip(&child.choice) {
                let mut filter = match self.group_of[member] {
                    Some((group, place)) => {
                        self.groups[group].hypotheses[view - self.first_view[member]].filters[place].clone()
                    }
                    None => tracks[member].filter.clone(),
                };
                if let Some(Pair { feature, innovation, jacobian, .. }) = choice.map(|it| &candidates[it]) {
                    let noise = frame.gate.noise(&frame.features[*feature].covariance, jacobian, &filter);
                    filter.update_pixel(*innovation, jacobian, &noise);
                }
                hypothesis.filters.push(filter);
                hypothesis.seen.push(choice.is_some());
            }
            let twin = hypotheses.iter_mut().find(|it| says_the_same(it, &hypothesis));
            match twin {
                Some(twin) => {
                    twin.cost -= 2.0 * (-(hypothesis.cost - twin.cost) / 2.0).exp().ln_1p();
                    self.spare.push(hypothesis);
                }
                None => hypotheses.push(hypothesis),
            }
        }
        // Whatever some hypothesis uses is not free for an initiation.
        for feature in self
            .children
            .iter()
            .flat_map(|it| &it.choice)
            .flatten()
            .map(|&it| candidates[it].feature)
            .collect::<SmallVec<[usize; 16]>>()
        {
            association.note_feature(feature);
        }
        hypotheses.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let best = hypotheses[0].cost;
        hypotheses.iter_mut().for_each(|it| it.cost -= best);

        let since = groups.iter().map(|&it| self.groups[it].since).min().unwrap_or(frame.time);
        if groups.is_empty() {
            self.begun += 1;
        }
        for &group in groups {
            self.spare.extend(self.groups[group].hypotheses.drain(..)); // a group without hypotheses is removed at the end of the frame
        }
        for (place, &member) in members.iter().enumerate() {
            let track = &mut tracks[member];
            track.filter.clone_from(&hypotheses[0].filters[place]);
            track.history.clear();
            if hypotheses[0].seen[place] {
                track.note(frame.camera, frame.time);
                association.note_target(member);
            }
        }
        let over = frame.time - since > LONGEST;
        if over {
            let rest = hypotheses.drain(1..);
            self.spare.extend(rest);
        }
        self.groups.push(Group { members: members.iter().map(|&it| tracks[it].id).collect(), hypotheses, since });
    }

    fn keep_best(&mut self, group: usize) {
        let rest = self.groups[group].hypotheses.drain(1..);
        self.spare.extend(rest);
    }
}

/// Whether all filters of two hypotheses about the same targets agree.
fn says_the_same(a: &Hypothesis, b: &Hypothesis) -> bool {
    a.filters.iter().zip(&b.filters).all(|(a, b)| {
        let apart = (a.position() - b.position()).norm_squared() / a.position_covariance().trace();
        let (of_a, of_b) = (a.covariance(), b.covariance());
        let variance = (3..6).map(|axis| of_a[(axis, axis)].max(of_b[(axis, axis)])).sum::<f64>();
        apart < SAME && (a.velocity() - b.velocity()).norm_squared() / variance < SAME
    })
}

/// Adds to `found` the likeliest assignments of candidates to targets, one row of candidates a target, within the slack.
fn assign(
    candidates: &[Pair],
    rows: &[SmallVec<[usize; 4]>],
    miss_cost: f64,
    cost: f64,
    parent: usize,
    found: &mut Vec<Child>,
) {
    // What the rows from each one on cost at least.
    let mut at_least: SmallVec<[f64; MOST_MEMBERS]> = SmallVec::from_elem(0.0, rows.len() + 1);
    for (place, row) in rows.iter().enumerate().rev() {
        let best = row.iter().map(|&it| candidates[it].cost).fold(miss_cost, f64::min);
        at_least[place] = at_least[place + 1] + best;
    }
    let mut search = Search { candidates, rows, miss_cost, at_least: &at_least, parent, found };
    search.descend(0, cost, &mut SmallVec::new());
}

struct Search<'a> {
    candidates: &'a [Pair],
    rows: &'a [SmallVec<[usize; 4]>],
    miss_cost: f64,
    at_least: &'a [f64],
    parent: usize,
    found: &'a mut Vec<Child>,
}

impl Search<'_> {
    fn descend(&mut self, row: usize, cost: f64, choice: &mut SmallVec<[Option<usize>; MOST_MEMBERS]>) {
        let best = self.found.iter().map(|it| it.cost).fold(f64::INFINITY, f64::min);
        if cost + self.at_least[row] > best + SLACK {
            return;
        }
        let Some(options) = self.rows.get(row) else {
            self.found.push(Child { cost, parent: self.parent, choice: choice.clone() });
            return;
        };
        for &candidate in options {
            let feature = self.candidates[candidate].feature;
            let is_free = choice.iter().flatten().all(|&it| self.candidates[it].feature != feature);
            if is_free {
                choice.push(Some(candidate));
                self.descend(row + 1, cost + self.candidates[candidate].cost, choice);
                choice.pop();
            }
        }
        choice.push(None);
        self.descend(row + 1, cost + self.miss_cost, choice);
        choice.pop();
    }
}
