//! The program that runs nodes, as they see it: it reports failures at once, and says how long the run has taken.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Called with the name of a node and what is wrong there.
type Warn = dyn Fn(&str, &str) + Send + Sync;

/// Shared by all nodes of a rig. Nothing that a node computes may depend on it: it says when files are written, not what is in them.
#[derive(Clone, Default)]
pub struct Host {
    warn: Option<Arc<Warn>>,
    seconds: Arc<AtomicU64>,
}

impl Host {
    /// `warn` is given the name of a node and what is wrong there, as soon as it is known.
    pub fn new(warn: impl Fn(&str, &str) + Send + Sync + 'static) -> Self {
        Self { warn: Some(Arc::new(warn)), seconds: Arc::default() }
    }

    /// Says at once that something is wrong at node `instance`, such as a full disk; it goes on.
    pub fn warn(&self, instance: &str, words: &str) {
        if let Some(warn) = &self.warn {
            warn(instance, words);
        }
    }

    /// For who runs nodes: so much time has passed since the start.
    pub fn tick(&self, elapsed: Duration) {
        self.seconds.store(elapsed.as_secs(), Ordering::Relaxed);
    }

    /// Whole seconds that the run has taken. A file that grows is written when this changes, so that a run that is killed loses a second at most.
    pub fn seconds(&self) -> u64 {
        self.seconds.load(Ordering::Relaxed)
    }
}

impl fmt::Debug for Host {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Host").finish_non_exhaustive()
    }
}
