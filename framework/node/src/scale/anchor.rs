//! `scale.anchor`: follows the target that carries a scale, and says where the scale's space is.

use foveate_messages::{Provenance, ScaleId, ScaleSpace, Targets};
use foveate_scene::{Anchor, AnchorState, TargetObservation};
use nalgebra::{Isometry3, Matrix6, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::{ConfigError, NodeError};
use crate::io::Io;
use crate::node::{Node, Role};
use crate::port::Ports;
use crate::ports;
use crate::setup::Setup;

ports! {
    TARGETS: In<Targets> = each("targets").of_parent();
    SPACE: Out<ScaleSpace> = "space";
}

/// `scale.anchor` has no settings: the rule stands in the parent's table `[scale.PARENT.target.NAME]`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScaleAnchorSettings {}

/// For each message of the parent's targets: the space of its scale, with the parent's axes and its origin at the target, or
/// that the target is lost. Under the stamp of the targets.
pub struct ScaleAnchor {
    anchor: Anchor,
    space: ScaleSpace,
}

impl Node for ScaleAnchor {
    const TYPE: &'static str = "scale.anchor";
    const ROLE: Role = Role::Selector;
    const SUMMARY: &'static str = "Follows the target that carries a scale's space; added to each scale with `anchor`";
    type Settings = ScaleAnchorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(_settings: ScaleAnchorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let rule = setup.anchor.ok_or_else(|| {
            ConfigError::node(format_args!("the scale `{}` has no `anchor`, expected one with its parent", setup.scale))
        })?;
        Ok(Self { anchor: Anchor::new(rule), space: nowhere(setup.scales.own) })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(targets) = io.take(&TARGETS) {
            let time = targets.value.time;
            let state = self.anchor.update(
                time.0,
                targets.value.list.iter().map(|it| TargetObservation {
                    id: it.id.0,
                    position: it.position,
                    velocity: it.velocity,
                    covariance: it.covariance,
                    is_measured: it.provenance == Provenance::Measured,
                }),
            );
            match state {
                // A message of the past has changed nothing: what is newer stands.
                _ if time < self.space.time => {}
                AnchorState::Found(it) => {
                    self.space.time = time;
                    self.space.target = Some(foveate_messages::TargetId(it.id));
                    self.space.parent_from_scale = Isometry3::from_parts(it.position.into(), Default::default());
                    let position = it.covariance.fixed_view::<3, 3>(0, 0);
                    self.space.covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&position);
                    self.space.velocity = it.velocity;
                    self.space.motion_covariance = it.covariance;
                }
                AnchorState::Lost { .. } => {
                    self.space.time = time;
                    self.space.target = None;
                }
            }
            io.emit(&SPACE, targets.stamp, self.space);
        }
        Ok(())
    }
}

/// Before any target was found.
fn nowhere(scale: ScaleId) -> ScaleSpace {
    ScaleSpace {
        scale,
        time: foveate_messages::Time(i64::MIN),
        target: None,
        parent_from_scale: Isometry3::identity(),
        covariance: Matrix6::zeros(),
        velocity: Vector3::zeros(),
        motion_covariance: Matrix6::zeros(),
    }
}
