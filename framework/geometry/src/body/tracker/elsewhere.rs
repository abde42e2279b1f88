//! Alternative places for a limb: a fit goes to the nearest minimum of its cost, which may not be the global one.

use super::super::field::VoxelField;
use super::super::limbs::limb_templates;
use super::super::parts::Limb;
use super::{BodyTracker, LimbLevel};

/// So many templates of a limb are fitted [–]: twelve find one limb in a thousand more.
const N_TEMPLATES: usize = 4;
/// Ends of limbs that are nearer to each other are one place, which a fit finds from either [m].
const APART: f64 = 0.10;

impl BodyTracker {
    /// Fits the whole body with a limb elsewhere, in the voxels that no other part has, and keeps what explains all of them best.
    pub(super) fn try_elsewhere(&mut self, field: &VoxelField, limb: Limb) {
        if self.level(limb) == LimbLevel::Absent {
            return;
        }
        let mut start = self.clone();
        start.forget_sizes(limb);
        let taken = self.taken_without(field, &[limb]);
        let options = &self.options.acquisition.limbs;
        for template in limb_templates(field, &start.filter.body, limb, &taken, options, (N_TEMPLATES, APART)) {
            let mut trial = start.clone();
            trial.put(&template);
            trial.update(field, &[], self.options.fit.iterations + 2);
            if trial.cost() < self.cost() {
                *self = trial;
            }
        }
    }
}
