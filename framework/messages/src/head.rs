//! Commands to pan-tilt heads, and their reports.
//!
//! Angles are those of the calibrated axes [rad], 0 where the camera is *at rest*; the node that drives the head turns them into the
//! device's numbers and back.

use nalgebra::{Isometry3, Matrix2, Matrix6};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::schema::{Numbers, Pose};
use crate::wire::portable;
use crate::{CameraId, Interval, Message, Quality, Space, Time, Wire};

/// What a head should do.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum HeadOrder {
    /// Go to these angles.
    Go {
        /// Pan and tilt [rad].
        angles: [f64; 2],
        /// At most at these speeds, above 0 [rad/s].
        speeds: [f64; 2],
    },
    /// Turn at these rates until the next command [rad/s].
    Turn {
        /// Of pan and tilt, with sign.
        rates: [f64; 2],
    },
}

/// A command for the head of one camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HeadCommand {
    /// The camera that the head carries.
    pub camera: CameraId,
    /// Where to look.
    pub order: HeadOrder,
    /// Position of the zoom drive, in the units of the calibration's table; `None` leaves it.
    pub zoom: Option<f64>,
}

impl Message for HeadCommand {
    const NAME: &'static str = "head_command";
    const SPACE: Space = Space::HEAD_ANGLES;
    const WIRE: Wire = portable!(HeadCommand);
}

/// The state of the link to a head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub enum HeadLink {
    /// Not reached (yet, or any more): the driver keeps trying.
    #[default]
    Away,
    /// It answers.
    Ready,
}

/// Where a head said that it was.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HeadPosition {
    /// It looked at its motors after this moment …
    pub earliest: Time,
    /// … and before this one.
    pub latest: Time,
    /// Pan and tilt [rad].
    pub angles: [f64; 2],
}

/// Something that happened between a head and what drives it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum HeadEvent {
    /// The link changed.
    Link(HeadLink),
    /// The first bit of a command went to the line.
    Sent(HeadOrder),
    /// The head has done the last command.
    Arrived,
    /// The head said where it was.
    Position(HeadPosition),
    /// The head said where its zoom was, in the units of the calibration's table.
    Zoom(f64),
}

/// What happened between a head and what drives it in the last second.
///
/// Reports overlap, so that a consumer that samples them loses nothing: [`HeadReport::since`] leaves out what it got before.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct HeadReport {
    /// The camera that the head carries.
    pub camera: CameraId,
    /// The state of the link now.
    pub link: HeadLink,
    /// Number of the first of `events`: all events of a head are numbered from 0.
    pub first: u64,
    /// The events, each with the time at which the driver learnt of it, oldest first.
    pub events: Vec<(Time, HeadEvent)>,
}

impl HeadReport {
    /// The events from number `next` on; `next` becomes the number after the last of them.
    pub fn since<'s>(&'s self, next: &mut u64) -> impl Iterator<Item = &'s (Time, HeadEvent)> + use<'s> {
        let known = next.saturating_sub(self.first).min(self.events.len() as u64) as usize;
        *next = (*next).max(self.first + self.events.len() as u64);
        self.events[known..].iter()
    }
}

impl Message for HeadReport {
    const NAME: &'static str = "head_report";
    const SPACE: Space = Space::HEAD_ANGLES;
    const WIRE: Wire = portable!(HeadReport);

    fn quality(&self) -> Quality {
        Quality { count: Some(self.events.len() as u32), sigma: None }
    }
}

/// The estimated pose of a camera on a head at one moment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HeadPose {
    /// The camera.
    pub camera: CameraId,
    /// The moment, such as the capture time of a picture.
    pub time: Time,
    /// Pan and tilt [rad].
    pub angles: [f64; 2],
    /// Of the angles [rad²].
    #[schemars(with = "Numbers<4>")]
    pub angles_covariance: Matrix2<f64>,
    /// How fast they change [rad/s].
    pub rates: [f64; 2],
    /// Position of the zoom drive; `None` where it is not known or there is none.
    pub zoom: Option<f64>,
    /// The camera's pose by the calibrated axes.
    #[serde(with = "Pose")]
    #[schemars(with = "Pose")]
    pub camera_from_world: Isometry3<f64>,
    /// Of δ in `camera_from_world` ∘ exp(δ), (rotation, translation), from angles and calibration [rad², rad m, m²].
    #[schemars(with = "Numbers<36>")]
    pub covariance: Matrix6<f64>,
    /// Between the last answer of the head and `time`; what lies between is extrapolated from the commands.
    pub age: Interval,
}

impl Message for HeadPose {
    const NAME: &'static str = "head_pose";
    const SPACE: Space = Space::HEAD_ANGLES;
    const WIRE: Wire = portable!(HeadPose);

    fn quality(&self) -> Quality {
        let variance = self.angles_covariance.trace() / 2.0;
        Quality { count: Some(1), sigma: Some(variance.max(0.0).sqrt()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_that_overlap_are_heard_once() {
        let report = |first: u64, count: i64| HeadReport {
            first,
            events: (0..count).map(|it| (Time(first as i64 + it), HeadEvent::Arrived)).collect(),
            ..HeadReport::default()
        };
        let mut next = 0;
        let mut heard = |report: &HeadReport| report.since(&mut next).map(|it| it.0.0).collect::<Vec<i64>>();
        assert_eq!(heard(&report(0, 3)), [0, 1, 2]);
        assert_eq!(heard(&report(1, 4)), [3, 4]);
        assert!(heard(&report(1, 4)).is_empty());
        assert!(heard(&report(2, 1)).is_empty(), "an old report");
        assert_eq!(heard(&report(8, 2)), [8, 9], "what was between was never told");
    }
}
