//! Matches true targets and recovered identities over time, and counts ID switches and re-initialisations (CLEAR MOT).
//!
//! K. Bernardin and R. Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT metrics", EURASIP
//! JIVP, 2008: a pair of the last time is kept while it stays within the gate; what is left is assigned so that the sum
//! of distances is least.

use std::collections::BTreeMap;

use nalgebra::Point3;

use crate::assignment::{self, Workspace};

/// A target with its number, which stays the same over time, and its position [unit of length].
pub type Identified = (u32, Point3<f64>);

/// Matches recovered targets to true ones frame by frame, and reuses its memory.
#[derive(Debug, Clone)]
pub struct Identities {
    gate: f64,
    /// By true target: every identity it was ever matched to, the last one at the end.
    identities_of: BTreeMap<u32, Vec<u32>>,
    /// By identity: the true target it was matched to last.
    owners: BTreeMap<u32, u32>,
    id_switches: u64,
    reinitialisations: u64,
    costs: Vec<f64>,
    assigned: Vec<Option<usize>>,
    kept: Vec<Option<usize>>,
    workspace: Workspace,
}

impl Identities {
    /// Targets farther apart than `gate` [unit of length] do not match.
    pub fn new(gate: f64) -> Self {
        Self {
            gate,
            identities_of: BTreeMap::new(),
            owners: BTreeMap::new(),
            id_switches: 0,
            reinitialisations: 0,
            costs: Vec::new(),
            assigned: Vec::new(),
            kept: Vec::new(),
            workspace: Workspace::default(),
        }
    }

    /// Matches one frame: for each of `truth` its index in `found`, or `None` for a miss.
    pub fn match_up(&mut self, truth: &[Identified], found: &[Identified]) -> &[Option<usize>] {
        let (rows, columns) = (truth.len(), found.len());
        self.costs.clear();
        for (_, place) in truth {
            self.costs.extend(found.iter().map(|(_, it)| (it - place).norm()));
        }
        self.kept.clear();
        for (row, (who, _)) in truth.iter().enumerate() {
            let last = self.identities_of.get(who).and_then(|it| it.last());
            let column = last.and_then(|last| found.iter().position(|(it, _)| it == last));
            self.kept.push(column.filter(|column| self.costs[row * columns + column] <= self.gate));
        }
        // Two that claim one identity since it changed hands: the one that it followed last keeps it.
        for (row, (who, _)) in truth.iter().enumerate() {
            let Some(column) = self.kept[row] else { continue };
            if self.owners.get(&found[column].0) != Some(who) {
                self.kept[row] = None;
                continue;
            }
            self.costs[row * columns..(row + 1) * columns].fill(f64::INFINITY);
            (0..rows).for_each(|row| self.costs[row * columns + column] = f64::INFINITY);
        }
        assignment::optimal(&self.costs, rows, columns, self.gate, &mut self.workspace, &mut self.assigned);
        for (row, (who, _)) in truth.iter().enumerate() {
            if let Some(column) = self.kept[row].or(self.assigned[row]) {
                self.assigned[row] = Some(column);
                self.note(*who, found[column].0);
            }
        }
        &self.assigned
    }

    fn note(&mut self, truth: u32, identity: u32) {
        let identities_of = self.identities_of.entry(truth).or_default();
        let is_first = identities_of.is_empty();
        if identities_of.last() != Some(&identity) {
            identities_of.retain(|it| *it != identity);
            identities_of.push(identity);
        }
        let owner = self.owners.insert(identity, truth);
        if owner.is_some_and(|it| it != truth) {
            self.id_switches += 1;
        } else if owner.is_none() && !is_first {
            self.reinitialisations += 1;
        }
    }

    /// By true target that was ever matched: every identity that it was matched to.
    pub fn identities_of(&self) -> &BTreeMap<u32, Vec<u32>> {
        &self.identities_of
    }

    /// Number of identities that were ever matched.
    pub fn n_identities(&self) -> usize {
        self.owners.len()
    }

    /// ID switches: how often a true target was matched to an identity that had last been another target's.
    pub fn id_switches(&self) -> u64 {
        self.id_switches
    }

    /// Re-initialisations: how often a true target that had an identity was matched to a new one.
    pub fn reinitialisations(&self) -> u64 {
        self.reinitialisations
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(who: u32, x: f64) -> Identified {
        (who, Point3::new(x, 0.0, 0.0))
    }

    fn run(moments: &[(&[Identified], &[Identified])]) -> Identities {
        let mut identities = Identities::new(0.1);
        for (truth, found) in moments {
            identities.match_up(truth, found);
        }
        identities
    }

    #[test]
    fn id_switches_and_reinitialisations_are_counted_once_each() {
        let truth: &[Identified] = &[at(0, 0.0), at(1, 1.0)];
        let (here, swapped): (&[Identified], &[Identified]) =
            (&[at(5, 0.01), at(6, 1.01)], &[at(6, 0.01), at(5, 1.01)]);
        let same = run(&[(truth, here), (truth, here)]);
        assert_eq!((same.n_identities(), same.id_switches(), same.reinitialisations()), (2, 0, 0));
        let swap = run(&[(truth, here), (truth, swapped), (truth, swapped)]);
        assert_eq!((swap.n_identities(), swap.id_switches(), swap.reinitialisations()), (2, 2, 0));
        let reborn = run(&[(truth, here), (truth, &here[1..]), (truth, &[at(7, 0.0), at(6, 1.0)])]);
        assert_eq!((reborn.n_identities(), reborn.id_switches(), reborn.reinitialisations()), (3, 0, 1));
        assert_eq!(reborn.identities_of()[&0], [5, 7]);
        // Taken up again after a while: neither.
        let again = run(&[(truth, here), (truth, &here[1..]), (truth, here)]);
        assert_eq!((again.n_identities(), again.id_switches(), again.reinitialisations()), (2, 0, 0));
    }

    #[test]
    fn a_pair_is_kept_though_another_comes_nearer() {
        let mut identities = Identities::new(0.1);
        identities.match_up(&[at(0, 0.0)], &[at(5, 0.05)]);
        assert_eq!(identities.match_up(&[at(0, 0.0)], &[at(6, 0.0), at(5, 0.09)]), [Some(1)]);
        assert_eq!(identities.match_up(&[at(0, 0.0)], &[at(6, 0.0), at(5, 0.11)]), [Some(0)]);
        assert_eq!((identities.n_identities(), identities.reinitialisations()), (2, 1));
    }

    #[test]
    fn an_identity_that_changed_hands_belongs_to_its_new_owner() {
        let mut identities = Identities::new(0.1);
        identities.match_up(&[at(0, 0.0), at(1, 0.5)], &[at(5, 0.0)]);
        identities.match_up(&[at(0, 0.0), at(1, 0.5)], &[at(5, 0.5)]);
        assert_eq!(identities.match_up(&[at(0, 0.46), at(1, 0.5)], &[at(5, 0.46)]), [None, Some(0)]);
        assert_eq!(identities.id_switches(), 1);
    }

    #[test]
    fn nobody_and_nowhere_match_nothing() {
        let mut identities = Identities::new(0.1);
        assert_eq!(identities.match_up(&[], &[at(1, 0.0)]), []);
        assert_eq!(identities.match_up(&[at(0, 0.0)], &[]), [None]);
        assert_eq!(identities.match_up(&[at(0, 0.0)], &[at(1, f64::NAN)]), [None]);
        assert_eq!(identities.n_identities(), 0);
    }
}
