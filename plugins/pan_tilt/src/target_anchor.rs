//! Selection of the target that a node's scale is anchored to, among those of the scale above.

use foveate::prelude::{Provenance, Setup, Target, Targets};
use foveate::scene::anchor::{Anchor, AnchorRule, AnchorState, TargetObservation};
use nalgebra::Vector3;

/// Applies the anchor rule of a scale; in a scale without one, selects the target that has lived longest.
#[derive(Debug, Clone)]
pub(crate) struct TargetAnchor {
    anchor: Anchor,
    /// From the target to the tracked point, in the axes of the scale above [m].
    pub offset: Vector3<f64>,
}

impl TargetAnchor {
    pub fn new(setup: &Setup) -> TargetAnchor {
        let rule = setup.anchor.unwrap_or_default();
        let anchor = Anchor::new(AnchorRule { offset: Vector3::zeros(), ..rule });
        TargetAnchor { anchor, offset: rule.offset }
    }

    /// The selected target, if it is not lost.
    pub fn target<'t>(&mut self, targets: &'t Targets) -> Option<&'t Target> {
        let observations = targets.list.iter().map(|it| TargetObservation {
            id: it.id.0,
            position: it.position,
            velocity: it.velocity,
            covariance: it.covariance,
            is_measured: it.provenance == Provenance::Measured,
        });
        let AnchorState::Found(found) = self.anchor.update(targets.time.0, observations) else { return None };
        targets.list.iter().find(|it| it.id.0 == found.id)
    }
}
