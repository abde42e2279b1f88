//! How fast a run on a logical clock goes on: as the machine can, at the pace of the wall clock, or not at all while people hold it.

use std::time::{Duration, Instant};

use foveate_messages::Time;

use crate::Options;

/// Longest sleep: bounds how late a request to stop or to go on is noticed.
const LONGEST_PAUSE: Duration = Duration::from_millis(50);
/// Sleep between two looks of a run that people hold.
const HELD_PAUSE: Duration = Duration::from_millis(10);

/// The pace of one run.
pub(crate) struct Pace {
    started: Instant,
    /// How long people have held it.
    held: Duration,
}

impl Pace {
    /// Of a run that starts at `started`.
    pub fn new(started: Instant) -> Pace {
        Pace { started, held: Duration::ZERO }
    }

    /// How long to sleep before another look at what is to happen at `time`; `None`: it may happen now.
    pub fn pause(&self, time: Time, options: &Options) -> Option<Duration> {
        if options.must_stop() {
            return None;
        }
        if options.controls.holds(time) {
            return Some(HELD_PAUSE);
        }
        if !options.paced {
            return None;
        }
        let elapsed = self.started.elapsed().saturating_sub(self.held).as_nanos() as i64;
        let ahead = time.0.saturating_sub(elapsed);
        (ahead > 0).then(|| LONGEST_PAUSE.min(Duration::from_nanos(ahead.unsigned_abs())))
    }

    /// Sleeps for `pause`, which does not count while people hold the run before `time`.
    pub fn sleep(&mut self, pause: Duration, time: Time, options: &Options) {
        let (began, is_held) = (Instant::now(), options.controls.holds(time));
        std::thread::sleep(pause);
        if is_held {
            self.held += began.elapsed();
        }
    }
}
