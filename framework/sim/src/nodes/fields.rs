//! What all simulated cameras do around a field: late, lost and failed ones become gaps, and their clocks are reported.

use foveate_geometry::Camera;
use foveate_messages::{CameraId, Message};
use foveate_node::{ConfigError, Due, Io, Out, Report, Setup, Time, figures};

use crate::timing::{Arrival, DeliveryOutcome, Timing};

figures! {
    pub(super) const CLOCK_FIGURES;
    "camera.clock_offset_ms.*": ms, neither, "Truth: how far the camera's clock is ahead of the session, at its last field; none of a clock that is right";
    "camera.clock_offset_start_ms.*": ms, neither, "Truth: the same at the start of the session";
    "camera.clock_drift_ppm.*": ppm, neither, "Truth: by how much the camera's clock runs faster than the session's";
}

/// A camera whose delivery is this late skips the fields that it could not make [s].
const PATIENCE_S: f64 = 0.1;

/// The camera of the calibration that a node simulates.
pub(super) fn own_camera(setup: &Setup) -> Result<(CameraId, &Camera), ConfigError> {
    setup.camera.zip(setup.camera_model()).ok_or_else(|| {
        ConfigError::node("found no camera, expected `each` or `camera` to name cameras of the calibration")
    })
}

/// The fields of one camera, turn by turn.
pub(super) struct Fields {
    pub timing: Timing,
    /// Of the camera.
    name: String,
    /// True capture time of the last requested field.
    last: Time,
    /// Whether the turn at the start of the session was taken.
    is_up: bool,
}

impl Fields {
    pub fn new(timing: Timing, name: Option<&str>) -> Fields {
        Fields { timing, name: name.unwrap_or_default().to_owned(), last: Time::ZERO, is_up: false }
    }

    /// When the next field is due; an activation before the first one, in which the world arrives, is requested at the start.
    pub fn due(&mut self) -> Due {
        Due::At(if self.is_up { self.timing.next_delivery() } else { Time::ZERO })
    }

    /// The field that is to be made in this turn; `None` in the turn at the start, and where it is a gap, which is declared at `port`.
    pub fn next<T: Message>(&mut self, io: &mut Io<'_>, port: &Out<T>) -> Option<Arrival> {
        if !std::mem::replace(&mut self.is_up, true) {
            return None;
        }
        while (io.now() - self.timing.next_delivery()).as_s() > PATIENCE_S {
            io.gap(port, self.timing.next().stamp, "the simulated camera was asked too late for this field");
        }
        let arrival = self.timing.next();
        let reason = match arrival.outcome {
            DeliveryOutcome::Arrives => {
                self.last = self.last.max(arrival.capture);
                return Some(arrival);
            }
            DeliveryOutcome::Lost => "the settings of the simulated camera lose this field",
            DeliveryOutcome::Failed => "the simulated camera has failed",
        };
        io.gap(port, arrival.stamp, reason);
        None
    }

    /// Declares a field missing since its world has not arrived.
    pub fn without_world<T: Message>(io: &mut Io<'_>, port: &Out<T>, stamp: Time) {
        io.gap(port, stamp, "the simulated world has not arrived yet");
    }

    /// The truth about the camera's clock: what a tracker's estimates are to be compared with. Nothing about a clock that is right.
    pub fn report_clock(&self, report: &mut Report) {
        let (clock, name) = (self.timing.clock(), &self.name);
        if !clock.is_right() {
            report.figure(format!("camera.clock_offset_ms.{name}"), clock.ahead(self.last).as_ms());
            report.figure(format!("camera.clock_offset_start_ms.{name}"), clock.offset_s * 1e3);
            report.figure(format!("camera.clock_drift_ppm.{name}"), clock.drift * 1e6);
        }
    }
}
