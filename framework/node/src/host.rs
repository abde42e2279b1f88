//! What the running program offers to nodes: warnings that people see at once, and the run time so far.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Called with the name of a node and what is wrong there.
type Warn = dyn Fn(&str, &str) + Send + Sync;

/// Shared by all nodes of a rig. It decides when files are written, never what is in them: no result of a node may depend on it.
#[derive(Clone, Default)]
pub struct Host {
    warn: Option<Arc<Warn>>,
    seconds: Arc<AtomicU64>,
}

impl Host {
    /// `warn` is called with the name of a node and what is wrong there.
    pub fn new(warn: impl Fn(&str, &str) + Send + Sync + 'static) -> Self {
        Self { warn: Some(Arc::new(warn)), seconds: Arc::default() }
    }

    /// Prints a warning of node `instance`, such as a full disk, at once. The run continues.
    pub fn warn(&self, instance: &str, words: &str) {
        if let Some(warn) = &self.warn {
            warn(instance, words);
        }
    }

    /// Called by the engine: the time since the start of the run.
    pub fn tick(&self, elapsed: Duration) {
        self.seconds.store(elapsed.as_secs(), Ordering::Relaxed);
    }

    /// Whole seconds since the start of the run. Growing files are flushed when this changes, so that a killed run loses one second at most.
    pub fn seconds(&self) -> u64 {
        self.seconds.load(Ordering::Relaxed)
    }
}

impl fmt::Debug for Host {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Host").finish_non_exhaustive()
    }
}
