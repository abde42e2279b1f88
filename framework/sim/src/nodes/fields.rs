//! What all simulated cameras do around a field: late, lost and failed ones become gaps, and their clocks are reported.

use foveate_dataflow::{Io, Out, Report, Time};
use foveate_messages::Message;

use crate::timing::{Arrival, Fate, Timing};

/// A camera whose delivery is this late gives up on the fields that it could not make [s].
const PATIENCE_S: f64 = 0.1;

/// The field that is to be made in this turn; `None` where it is a gap, which is declared at `port`.
pub(super) fn next_field<T: Message>(timing: &mut Timing, io: &mut Io<'_>, port: &Out<T>) -> Option<Arrival> {
    while (io.now() - timing.next_delivery()).as_s() > PATIENCE_S {
        io.gap(port, timing.next().stamp, "the simulated camera was asked too late for this field");
    }
    let arrival = timing.next();
    let reason = match arrival.fate {
        Fate::Arrives => return Some(arrival),
        Fate::Lost => "the settings of the simulated camera lose this field",
        Fate::Failed => "the simulated camera has failed",
    };
    io.gap(port, arrival.stamp, reason);
    None
}

/// The truth about the clock of camera `name`, whose last field was seen at session time `last`: what a tracker's estimates are
/// to be compared with. Nothing about a clock that is right.
pub(super) fn report_clock(timing: &Timing, name: &str, last: Time, report: &mut Report) {
    let clock = timing.clock();
    if !clock.is_right() {
        report.figure(format!("camera.clock_offset_ms.{name}"), clock.ahead(last).as_ms());
        report.figure(format!("camera.clock_offset_start_ms.{name}"), clock.offset_s * 1e3);
        report.figure(format!("camera.clock_drift_ppm.{name}"), clock.drift * 1e6);
    }
}
