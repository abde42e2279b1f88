//! When a file that grows is written: at least once a second, of session time and of the time that the run takes.

use std::path::Path;

use foveate::node::Host;
use foveate::prelude::*;

/// Session time after which rows are written at the latest.
const FLUSH_PERIOD: Interval = Interval(1_000_000_000);

/// The pace of one file, and the words at once when it cannot be written.
#[derive(Debug)]
pub(crate) struct Pace {
    host: Host,
    instance: String,
    last: Option<Time>,
    seconds: u64,
    is_in_trouble: bool,
}

impl Pace {
    pub(crate) fn new(setup: &Setup) -> Self {
        let (host, instance) = (setup.host.clone(), setup.instance.clone());
        Self { seconds: host.seconds(), host, instance, last: None, is_in_trouble: false }
    }

    /// Whether a second has passed since it was last due.
    pub(crate) fn is_due(&mut self, now: Time) -> bool {
        let start = *self.last.get_or_insert(now);
        let seconds = self.host.seconds();
        let is_due = now - start >= FLUSH_PERIOD || seconds != self.seconds;
        if is_due {
            (self.last, self.seconds) = (Some(now), seconds);
        }
        is_due
    }

    /// Says once, and at once, why `file` cannot be written.
    pub(crate) fn warn(&mut self, file: &Path, why: &str) {
        if !std::mem::replace(&mut self.is_in_trouble, true) {
            let words =
                format!("`{}` cannot be written ({why}); what is to go there is kept and tried again", file.display());
            self.host.warn(&self.instance, &words);
        }
    }
}
