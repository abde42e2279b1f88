//! How often true targets and identities were together: what IDF1 is made of.
//!
//! E. Ristani et al., "Performance measures and a data set for multi-target, multi-camera tracking", ECCV workshops, 2016.

use std::collections::BTreeMap;

use foveate_estimation::assignment::{self, Workspace};
use foveate_messages::TargetId;

/// By true target and identity: in how many messages they were within the gate of each other.
#[derive(Debug, Clone, Default)]
pub(super) struct Together(BTreeMap<(TargetId, TargetId), u64>);

impl Together {
    /// Once more.
    pub fn add(&mut self, truth: TargetId, identity: TargetId) {
        *self.0.entry((truth, identity)).or_insert(0) += 1;
    }

    /// The most messages in which they can be together if each true target has one identity and each identity one true target.
    pub fn at_most(&self) -> u64 {
        let place = |all: &mut BTreeMap<TargetId, usize>, id: TargetId| {
            let next = all.len();
            *all.entry(id).or_insert(next)
        };
        let (mut truths, mut identities) = (BTreeMap::new(), BTreeMap::new());
        let counts: Vec<(usize, usize, f64)> = self
            .0
            .iter()
            .map(|((truth, identity), count)| {
                (place(&mut truths, *truth), place(&mut identities, *identity), *count as f64)
            })
            .collect();
        let (rows, columns) = (truths.len(), identities.len());
        let most = counts.iter().map(|it| it.2).fold(0.0, f64::max);
        let mut costs = vec![f64::INFINITY; rows * columns];
        counts.iter().for_each(|(row, column, count)| costs[row * columns + column] = most - count);
        let mut assigned = Vec::new();
        assignment::optimal(&costs, rows, columns, most, &mut Workspace::default(), &mut assigned);
        let pairs = assigned.iter().enumerate().filter_map(|(row, column)| Some(row * columns + (*column)?));
        pairs.map(|it| most - costs[it]).sum::<f64>() as u64
    }
}
