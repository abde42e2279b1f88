//! How well targets were recovered: matched to the truth one by one, then summed up.
//!
//! Each recovered sample is compared with the truth at its own time. Matching follows K. Bernardin and R. Stiefelhagen,
//! "Evaluating multiple object tracking performance: the CLEAR MOT metrics", EURASIP JIVP, 2008: a pair of the last time is kept
//! while it stays within the gate; what is left is assigned so that the sum of distances is least. GOSPA ([`SetDistance`]) has an
//! assignment of its own, which remembers nothing.
//!
//! Where the scale has a volume, targets outside it need not be found: true targets there are neither missed nor counted, and
//! recovered ones are not false.

pub mod body;
pub(crate) mod cloud;
mod distances;
pub(crate) mod follow_picture;
mod higher_order;
pub mod marks;
mod pairs;
mod silence;
pub(crate) mod silhouette;
pub(crate) mod surface;
mod together;
mod truth;
pub(crate) mod wall;
pub(crate) mod warmup;

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use foveate_estimation::assignment::{self, Workspace};
use foveate_estimation::gospa::SetDistance;
use foveate_messages::{Target, TargetId, Targets};
use foveate_node::Report;
use nalgebra::{Matrix3, Point3};

use distances::Distances;
use higher_order::HigherOrder;
use pairs::{Groups, Pair, Pairs};
use silence::Silence;
use together::Together;
use truth::{Interpolated, TruthTrack};
use warmup::Warmup;

/// Recovered messages that may wait for the truth of their time; more are dropped, oldest first.
const MAX_WAITING: usize = 20_000;
/// Silences that are named one by one.
const NAMED: usize = 3;

/// Gathers figures from truth and recovered targets, which may come in any order of delivery.
///
/// What it reports: the figures declared for `sim.score`.
pub struct Scorer {
    gate: f64,
    start_s: f64,
    volume: Option<[[f64; 3]; 2]>,
    truth: TruthTrack,
    waiting: VecDeque<Arc<Targets>>,
    silence: Silence,
    distances: Distances,
    /// By true target.
    records: BTreeMap<TargetId, Record>,
    /// Every identity that was matched, and the true target it was matched to last.
    owners: BTreeMap<TargetId, TargetId>,
    id_switches: u64,
    reinitialisations: u64,
    messages: u64,
    warmup: Warmup,
    unscored: u64,
    false_targets: u64,
    duplicates: u64,
    pairs: u64,
    pairs_possible: u64,
    /// Recovered targets that count: those that were not matched to a true target outside the volume.
    found: u64,
    together: Together,
    higher_order: HigherOrder,
    /// Sum over messages, and over silent moments [m].
    gospa: f64,
    /// Sum of squares of errors over their covariances, and how many were judged.
    normalised: (f64, u64),
    /// Memory that is used again from message to message.
    scratch: Scratch,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Record {
    /// Session time of its first truth in the volume [s].
    appeared_s: f64,
    /// Session time of its first match [s].
    born_s: Option<f64>,
    identity: Option<TargetId>,
}

struct Scratch {
    here: Vec<Interpolated>,
    true_points: Vec<Point3<f64>>,
    found_points: Vec<Point3<f64>>,
    by_identity: Vec<(TargetId, usize)>,
    pairs: Pairs,
    free: Vec<Pair>,
    groups: Groups,
    /// By row: its column, and by column: whether it is taken.
    matched: Vec<Option<usize>>,
    taken: Vec<bool>,
    /// By column: whether it was matched to a true target outside the volume.
    outside: Vec<bool>,
    costs: Vec<f64>,
    assigned: Vec<Option<usize>>,
    workspace: Workspace,
    set_distance: SetDistance,
    group_points: [Vec<Point3<f64>>; 2],
}

impl Scorer {
    /// Pairs at most `gate` [m] apart may match; nothing before `start_s` [s] is scored, nor what is outside `volume`
    /// (opposite corners [m]).
    ///
    /// # Panics
    /// When the gate is not above 0.
    pub fn new(gate: f64, start_s: f64, volume: Option<[[f64; 3]; 2]>) -> Self {
        Self {
            gate,
            start_s,
            volume,
            truth: TruthTrack::default(),
            waiting: VecDeque::new(),
            silence: Silence::default(),
            distances: Distances::new(gate),
            records: BTreeMap::new(),
            owners: BTreeMap::new(),
            id_switches: 0,
            reinitialisations: 0,
            messages: 0,
            warmup: Warmup::default(),
            unscored: 0,
            false_targets: 0,
            duplicates: 0,
            pairs: 0,
            pairs_possible: 0,
            found: 0,
            together: Together::default(),
            higher_order: HigherOrder::default(),
            gospa: 0.0,
            normalised: (0.0, 0),
            scratch: Scratch {
                here: Vec::new(),
                true_points: Vec::new(),
                found_points: Vec::new(),
                by_identity: Vec::new(),
                pairs: Pairs::default(),
                free: Vec::new(),
                groups: Groups::default(),
                matched: Vec::new(),
                taken: Vec::new(),
                outside: Vec::new(),
                costs: Vec::new(),
                assigned: Vec::new(),
                workspace: Workspace::default(),
                set_distance: SetDistance::new(gate, 2.0),
                group_points: Default::default(),
            },
        }
    }

    /// The truth at a time after that of the last call; anything else is ignored.
    pub fn truth(&mut self, truth: Arc<Targets>) {
        let time_s = truth.time.as_s();
        if time_s < self.start_s {
            return;
        }
        for target in truth.list.iter().filter(|it| is_in(self.volume, &it.position)) {
            let unknown = Record { appeared_s: time_s, born_s: None, identity: None };
            self.records.entry(target.id).or_insert(unknown);
        }
        let to_be_found = truth.list.iter().filter(|it| is_in(self.volume, &it.position)).map(|it| it.id);
        self.silence.truth(truth.time, to_be_found.collect());
        self.truth.push(truth, self.volume);
        while self.waiting.front().is_some_and(|it| self.truth.reaches(it.time)) {
            if let Some(targets) = self.waiting.pop_front() {
                self.compare(&targets);
            }
        }
    }

    /// What was recovered at one time.
    pub fn recovered(&mut self, targets: Arc<Targets>) {
        if !self.warmup.is_scored(targets.time, self.start_s) {
            return;
        }
        self.silence.message(targets.time);
        if self.waiting.is_empty() && self.truth.reaches(targets.time) {
            return self.compare(&targets);
        }
        self.waiting.push_back(targets);
        if self.waiting.len() > MAX_WAITING {
            self.waiting.pop_front();
            self.unscored += 1;
        }
    }

    fn compare(&mut self, targets: &Targets) {
        self.scratch.here.clear();
        if !self.truth.at(targets.time, &mut self.scratch.here) {
            self.unscored += 1;
            return;
        }
        let found = &mut self.scratch.found_points;
        found.clear();
        found.extend(targets.list.iter().map(|it| it.position));
        self.scratch.true_points.clear();
        self.scratch.true_points.extend(self.scratch.here.iter().map(|it| it.position));
        self.scratch.pairs.find(&self.scratch.true_points, &self.scratch.found_points, self.gate);
        self.keep_pairs(targets);
        self.assign_rest();
        self.count(targets);
        self.gospa += self.gospa_now();
    }

    /// A pair that was matched last time, and still is within the gate, stays matched. An identity belongs to the true target it was
    /// matched to last, and to no other.
    fn keep_pairs(&mut self, targets: &Targets) {
        let Scratch { here, by_identity, pairs, matched, taken, .. } = &mut self.scratch;
        by_identity.clear();
        by_identity.extend(targets.list.iter().enumerate().map(|(column, it)| (it.id, column)));
        by_identity.sort_unstable();
        taken.clear();
        taken.resize(targets.list.len(), false);
        matched.clear();
        for (row, truth) in here.iter().enumerate() {
            let last = self.records.get(&truth.id).and_then(|it| it.identity);
            let own = last.filter(|last| self.owners.get(last) == Some(&truth.id));
            let place = own.and_then(|own| by_identity.binary_search_by_key(&own, |it| it.0).ok());
            let column = place.map(|place| by_identity[place].1);
            let kept = column.filter(|&column| pairs.distance(row, column).is_some() && !taken[column]);
            if let Some(column) = kept {
                taken[column] = true;
            }
            matched.push(kept);
        }
    }

    /// Assigns what is left, group by group, so that the sum of the distances is least.
    fn assign_rest(&mut self) {
        let Scratch { pairs, free, groups, matched, taken, costs, assigned, workspace, .. } = &mut self.scratch;
        let gate = self.gate;
        let (n_rows, n_columns) = (matched.len(), taken.len());
        free.clear();
        free.extend(pairs.list().iter().filter(|it| matched[it.row].is_none() && !taken[it.column]));
        groups.for_each(n_rows, n_columns, free.iter().copied(), |rows, columns| {
            costs.clear();
            for &row in rows {
                costs.extend(columns.iter().map(|&it| pairs.distance(row, it).unwrap_or(f64::INFINITY)));
            }
            assignment::optimal(costs, rows.len(), columns.len(), gate, workspace, assigned);
            for (row, column) in rows.iter().zip(assigned.iter()) {
                if let Some(column) = column {
                    matched[*row] = Some(columns[*column]);
                    taken[columns[*column]] = true;
                }
            }
        });
    }

    /// Enters what [`Self::keep_pairs`] and [`Self::assign_rest`] found.
    fn count(&mut self, targets: &Targets) {
        let time_s = targets.time.as_s();
        let here = std::mem::take(&mut self.scratch.here);
        let mut n_matched = 0;
        self.scratch.outside.clear();
        self.scratch.outside.resize(targets.list.len(), false);
        for (row, truth) in here.iter().enumerate() {
            let inside = is_in(self.volume, &truth.position);
            self.pairs_possible += u64::from(inside);
            if inside {
                self.higher_order.is_true(truth.id);
            }
            let Some(column) = self.scratch.matched[row] else { continue };
            n_matched += 1;
            self.scratch.outside[column] = !inside;
            if inside {
                self.pairs += 1;
                let target = &targets.list[column];
                let distance = (truth.position - target.position).norm();
                self.distances.add(distance);
                if let Some(squared) = normalised_squared(target, &truth.position) {
                    self.normalised = (self.normalised.0 + squared, self.normalised.1 + 1);
                }
                self.higher_order.matched(truth.id, target.id, distance, self.gate);
                self.truth.cover(truth);
            }
            self.identify(truth.id, targets.list[column].id, time_s);
        }
        for pair in self.scratch.pairs.list() {
            let truth = &here[pair.row];
            if is_in(self.volume, &truth.position) {
                self.together.add(truth.id, targets.list[pair.column].id);
            }
        }
        self.scratch.here = here;
        for (target, _) in targets.list.iter().zip(&self.scratch.outside).filter(|it| !*it.1) {
            self.found += 1;
            self.higher_order.is_found(target.id);
        }
        let n_far = self.scratch.pairs.n_far() as u64;
        self.messages += 1;
        self.false_targets += n_far;
        self.duplicates += (targets.list.len() as u64).saturating_sub(n_far + n_matched);
    }

    /// GOSPA of the message at hand [m].
    fn gospa_now(&mut self) -> f64 {
        let Scratch { pairs, groups, true_points, found_points, outside, set_distance, group_points, .. } =
            &mut self.scratch;
        let volume = self.volume;
        let counts = |row: usize| is_in(volume, &true_points[row]);
        let half_squared_gate = self.gate * self.gate / 2.0;
        let n_true = (0..true_points.len()).filter(|row| counts(*row)).count();
        let n_found = outside.iter().filter(|it| !**it).count();
        // Groups are apart by more than the gate, so that their squares add up; who is in none is missed or false.
        let (mut squares, mut in_groups) = (0.0, 0);
        let scored = pairs.list().iter().copied().filter(|it| counts(it.row) && !outside[it.column]);
        groups.for_each(true_points.len(), found_points.len(), scored, |rows, columns| {
            let [ours, theirs] = group_points;
            ours.clear();
            ours.extend(rows.iter().map(|&row| true_points[row]));
            theirs.clear();
            theirs.extend(columns.iter().map(|&column| found_points[column]));
            squares += set_distance.compare(ours, theirs).gospa().powi(2);
            in_groups += rows.len() + columns.len();
        });
        (squares + (n_true + n_found - in_groups) as f64 * half_squared_gate).sqrt()
    }

    /// True target `truth` was matched to `identity`.
    fn identify(&mut self, truth: TargetId, identity: TargetId, time_s: f64) {
        let Some(record) = self.records.get_mut(&truth) else { return };
        record.born_s.get_or_insert(time_s);
        let before = record.identity.replace(identity);
        let owner = self.owners.insert(identity, truth);
        if owner.is_some_and(|owner| owner != truth) {
            self.id_switches += 1;
        } else if owner.is_none() && before.is_some() {
            self.reinitialisations += 1;
        }
    }

    /// Puts the figures into `report`; NaN where there was nothing to measure.
    pub fn finish(&mut self, report: &mut Report) {
        while let Some(targets) = self.waiting.pop_front() {
            self.compare(&targets);
        }
        let silences = self.silence.finish();
        for targets in &silences.moments {
            self.pairs_possible += targets.len() as u64;
            targets.iter().for_each(|it| self.higher_order.is_true(*it));
            self.gospa += (targets.len() as f64 / 2.0).sqrt() * self.gate;
        }
        let moments = self.messages + silences.moments.len() as u64;
        let share = |part: u64, whole: u64| if whole > 0 { part as f64 / whole as f64 } else { f64::NAN };
        let n_true = self.records.len() as u64;
        report.figure("error_mm.median", self.distances.percentile(50.0) * 1e3);
        report.figure("error_mm.p95", self.distances.percentile(95.0) * 1e3);
        report.figure("error_mm.rms", self.distances.rms() * 1e3);
        let (squares, n_judged) = self.normalised;
        report.figure("error_sigmas.rms", (squares / n_judged as f64).sqrt());
        report.figure("gospa_mm.mean", self.gospa / moments as f64 * 1e3);
        let wrong = self.pairs_possible - self.pairs
            + self.false_targets
            + self.duplicates
            + self.id_switches
            + self.reinitialisations;
        report.figure("mota", 1.0 - share(wrong, self.pairs_possible));
        let together = self.together.at_most();
        report.figure("idf1", share(2 * together, self.pairs_possible + self.found));
        report.figure("hota", self.higher_order.hota().unwrap_or(f64::NAN));
        report.figure("targets_true", n_true as f64);
        report.figure("identities", self.owners.len() as f64);
        // Of nothing that was matched nothing can be exchanged.
        let of_matched = |value: f64| if self.owners.is_empty() { f64::NAN } else { value };
        let n_found = self.records.values().filter(|it| it.born_s.is_some()).count() as u64;
        report.figure("identities_per_target", share(self.owners.len() as u64, n_found));
        report.figure("id_switches", of_matched(self.id_switches as f64));
        report.figure("reinitialisations", of_matched(self.reinitialisations as f64));
        report.figure("false_targets", share(self.false_targets, self.messages));
        report.figure("duplicates", share(self.duplicates, self.messages));
        report.figure("missed", 1.0 - share(self.pairs, self.pairs_possible));
        let (covered, samples) = self.truth.finish();
        report.figure("completeness", share(covered, samples));
        let mut initiations: Vec<f64> =
            self.records.values().filter_map(|it| Some((it.born_s? - it.appeared_s).max(0.0) * 1e3)).collect();
        let n_unborn = (n_true as usize - initiations.len()) as f64;
        report.figure("targets_unborn", if n_true > 0 { n_unborn } else { f64::NAN });
        initiations.sort_by(f64::total_cmp);
        let middle = initiations.len() / 2;
        let median = match initiations.len() {
            0 => f64::NAN,
            odd if odd % 2 == 1 => initiations[middle],
            _ => (initiations[middle - 1] + initiations[middle]) / 2.0,
        };
        report.figure("time_to_initiation_ms.median", median);
        report.figure("scored_messages", self.messages as f64);
        report.figure("unscored_messages", self.unscored as f64);
        if let Some(sentence) = self.warmup.remark(self.start_s) {
            report.remark(sentence);
        } else if n_true == 0 && self.messages > 0 {
            report.remark("nothing was scored: no true light was within the volume of the scale in this time");
        }
        if silences.moments.iter().any(|it| !it.is_empty()) {
            let length: f64 = silences.spans.iter().map(|[from, to]| to - from).sum();
            let spans: Vec<String> =
                silences.spans.iter().take(NAMED).map(|[from, to]| format!("{from:.2} to {to:.2} s")).collect();
            let more = match silences.spans.len().saturating_sub(NAMED) {
                0 => String::new(),
                n => format!(" and {n} times more"),
            };
            report.remark(format!(
                "no message of targets came for {length:.2} s, not even one without any: {}{more}; the lights that were there count as missed",
                spans.join(", ")
            ));
        }
    }
}

/// The squared error of a target's position over its covariance, for each of the three axes; `None` where it states none.
fn normalised_squared(target: &Target, truth: &Point3<f64>) -> Option<f64> {
    let covariance: Matrix3<f64> = target.covariance.fixed_view::<3, 3>(0, 0).into();
    let error = target.position - truth;
    Some(error.dot(&covariance.cholesky()?.solve(&error)) / 3.0)
}

/// Whether `point` is in `volume`, corners included.
fn is_in(volume: Option<[[f64; 3]; 2]>, point: &Point3<f64>) -> bool {
    volume.is_none_or(|[min, max]| (0..3).all(|axis| (min[axis]..=max[axis]).contains(&point[axis])))
}

#[cfg(test)]
mod tests;
