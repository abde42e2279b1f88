//! Pan-tilt heads [Davis 2002 chapter 4].
//!
//! | module | what it holds |
//! |---|---|
//! | [`visca`] | the protocol of Sony's heads: bytes to meaning and back |
//! | [`driver`] | what is sent when, what is made of replies: no line, no clock |
//! | [`port`] | serial ports and UDP sockets |
//! | [`head`] | a driver on its port, with a thread that listens |
//! | [`actuator`] | such a head as a node |
//! | [`follow`] | a head that stays on a target: prediction, aim, speed |
//!
//! | node | what it does |
//! |---|---|
//! | `pan_tilt.selector` | keeps a head on a target |
//! | `pan_tilt.head` | drives a head, real or simulated, and reports where it looks |
//! | `pan_tilt.sweep` | drives a head over settings while a light is waved |
//! | `pan_tilt.calibrator` | finds the axes of heads from that |
//! | `pan_tilt.pose` | tells where its camera stood at each picture |
//! | `pan_tilt.allocator` | gives several targets their heads |

pub mod actuator;
pub mod allocator;
pub mod calibrator;
pub mod control;
pub mod driver;
pub mod head;
mod patrol;
pub mod port;
pub mod pose;
pub mod selector;
pub mod sweep;
mod target_anchor;
pub mod visca;

use foveate::prelude::{CameraId, ConfigError, Registry, Setup};
use foveate::scene::heads::CalibratedHead;

/// Makes the nodes of this plugin known.
pub fn register(registry: &mut Registry) {
    registry.add::<selector::Selector>();
    registry.add::<actuator::Actuator>();
    registry.add::<pose::Pose>();
    registry.add::<allocator::AllocatorNode>();
    registry.add::<sweep::SweepNode>();
    registry.add::<calibrator::Calibrator>();
}

/// The camera of a node and the head that carries it.
pub(crate) fn head_of(setup: &Setup) -> Result<(CameraId, CalibratedHead), ConfigError> {
    let Some(camera) = setup.camera else {
        return Err(ConfigError::node(
            "found no camera, expected `each` or `camera` to name cameras of the calibration that stand on heads",
        ));
    };
    let head = setup.head_model().ok_or_else(|| {
        let name = setup.camera_name().unwrap_or_default();
        ConfigError::node(format!(
            "the calibration has no `[head.{name}]`, expected the axes of the head that carries it"
        ))
    })?;
    Ok((camera, head))
}
