//! Pan-tilt heads [Davis 2002 chapter 4].
//!
//! | module | what it holds |
//! |---|---|
//! | [`visca`] | the protocol of Sony's heads: bytes to meaning and back |
//! | [`driver`] | the state machine of sending and of replies: no line, no clock |
//! | [`port`] | serial ports and UDP sockets |
//! | [`head`] | a driver on its port, with a receiving thread |
//! | [`line_traffic`] | the bytes on a line, as a message |
//! | [`actuator`] | such a head as a node |
//! | [`follow`] | a head that stays on a target: prediction, aim, speed |
//!
//! | node | what it does |
//! |---|---|
//! | `pan_tilt.selector` | keeps a head on a target |
//! | `pan_tilt.head` | drives a head, real or simulated, and reports its pan and tilt |
//! | `pan_tilt.sweep` | drives a head through settings while a light is waved |
//! | `pan_tilt.calibrator` | calibrates the axes of heads from that |
//! | `pan_tilt.pose` | computes the pose of its camera at each picture |
//! | `pan_tilt.allocator` | allocates heads to several targets |

pub mod actuator;
pub mod allocator;
pub mod calibrator;
pub mod control;
pub mod driver;
pub mod head;
pub mod line_traffic;
mod patrol;
pub mod port;
pub mod pose;
pub mod selector;
pub mod sweep;
mod target_anchor;
pub mod visca;

use foveate::prelude::{CameraId, ConfigError, Registry, Setup};
use foveate::scene::heads::CalibratedHead;

/// Registers the nodes of this plugin.
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
            "found no camera, expected `each` or `camera` to name cameras of the calibration that are on heads",
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
