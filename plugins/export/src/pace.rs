//! Decides when a growing file is flushed: at least once a second of session time and of run time.

use std::path::Path;

use foveate::node::Host;
use foveate::prelude::*;

/// Longest session time between two flushes.
const FLUSH_PERIOD: Interval = Interval(1_000_000_000);

/// The pace of one file, and its warning when it cannot be written.
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

    /// Warns once, at the first failure, why `file` cannot be written.
    pub(crate) fn warn(&mut self, file: &Path, why: &str) {
        if !std::mem::replace(&mut self.is_in_trouble, true) {
            let words = format!("`{}` cannot be written ({why}); its rows are kept and written later", file.display());
            self.host.warn(&self.instance, &words);
        }
    }
}
