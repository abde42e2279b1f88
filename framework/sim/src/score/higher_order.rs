//! HOTA of points: how well targets are found and, of those that are found, how well their identities last, the geometric mean of the two.
//!
//! J. Luiten et al., "HOTA: A higher order metric for evaluating multi-object tracking", International Journal of Computer Vision 129, 2021. For points the
//! similarity of a pair is 1 − d / gate. Pairs are those of the scorer at every level; the paper matches separately for each.

use std::collections::BTreeMap;

use foveate_messages::TargetId;

/// Levels of similarity that a pair has to reach: 0.05, 0.10, … 0.95.
const LEVELS: usize = 19;

/// What was seen of true targets and identities.
#[derive(Debug, Clone, Default)]
pub(super) struct HigherOrder {
    /// By true target and identity: matches that reach each level.
    matches: BTreeMap<(TargetId, TargetId), [u64; LEVELS]>,
    /// In how many messages each true target was.
    truths: BTreeMap<TargetId, u64>,
    /// And each identity.
    identities: BTreeMap<TargetId, u64>,
}

impl HigherOrder {
    /// A true target is in a message.
    pub fn is_true(&mut self, truth: TargetId) {
        *self.truths.entry(truth).or_insert(0) += 1;
    }

    /// An identity is in a message.
    pub fn is_found(&mut self, identity: TargetId) {
        *self.identities.entry(identity).or_insert(0) += 1;
    }

    /// Enters a matched pair, `distance` apart, where `gate` is the largest distance allowed [m].
    pub fn matched(&mut self, truth: TargetId, identity: TargetId, distance: f64, gate: f64) {
        let reached = ((1.0 - distance / gate) * (LEVELS + 1) as f64 + 1e-9).floor().max(0.0) as usize;
        let counts = self.matches.entry((truth, identity)).or_insert([0; LEVELS]);
        counts.iter_mut().take(reached).for_each(|it| *it += 1);
    }

    /// Mean over the levels; `None` where nothing was true and nothing found.
    pub fn hota(&self) -> Option<f64> {
        let n_true: u64 = self.truths.values().sum();
        let n_found: u64 = self.identities.values().sum();
        if n_true + n_found == 0 {
            return None;
        }
        let at = |level: usize| {
            let mut hits = 0;
            let mut lasting = 0.0;
            for ((truth, identity), counts) in &self.matches {
                let together = counts[level];
                let either = self.truths.get(truth).unwrap_or(&0) + self.identities.get(identity).unwrap_or(&0);
                hits += together;
                if together > 0 {
                    lasting += together as f64 * together as f64 / (either - together) as f64;
                }
            }
            // Detection and association accuracy: hits over all there is, and the mean over the hits of `lasting`.
            let detection = hits as f64 / (n_true + n_found - hits) as f64;
            let association = if hits > 0 { lasting / hits as f64 } else { 0.0 };
            (detection * association).sqrt()
        };
        Some((0..LEVELS).map(at).sum::<f64>() / LEVELS as f64)
    }
}
