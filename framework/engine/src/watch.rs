//! Watchdog: whether a thread returns from the activations of its nodes. A thread cannot be ended, but it can be abandoned.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use foveate_node::error::NodeError;

/// A node that does not return from an activation in this time once the run should end is abandoned, and its thread with it; before that it
/// is in so many times as much.
const PATIENCE: Duration = Duration::from_secs(10);
const PATIENCE_MEANWHILE: u32 = 6;
/// Time between two looks counts as this much at most: a program that was held stands still with all its nodes.
const LONGEST_STEP: Duration = Duration::from_secs(1);

/// One stage as it is seen from outside.
pub(crate) struct Watch {
    at: Arc<AtomicU64>,
    last: u64,
    looked: Instant,
    held: Duration,
    is_lost: bool,
}

impl Watch {
    /// Of the stage with this [`at`](crate::stage::Stage::at).
    pub(crate) fn new(at: Arc<AtomicU64>) -> Watch {
        Watch { at, last: 0, looked: Instant::now(), held: Duration::ZERO, is_lost: false }
    }

    /// Whether the stage was abandoned.
    pub(crate) fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// The node in whose activation the stage has been for `longest`; reported once.
    pub(crate) fn stuck(&mut self, longest: Duration) -> Option<usize> {
        let at = self.at.load(Ordering::Relaxed);
        let step = std::mem::replace(&mut self.looked, Instant::now()).elapsed().min(LONGEST_STEP);
        if at == 0 || at != self.last {
            (self.last, self.held) = (at, Duration::ZERO);
            return None;
        }
        self.held += step;
        if self.is_lost || self.held < longest {
            return None;
        }
        self.is_lost = true;
        Some((at & u64::from(u32::MAX)) as usize)
    }
}

/// How long a node may stay in one activation; `asked`: what the caller of the run allows once the run is to end.
pub(crate) fn patience(asked: Option<Duration>, is_ending: bool) -> Duration {
    asked.unwrap_or(PATIENCE) * if is_ending { 1 } else { PATIENCE_MEANWHILE }
}

/// The message about a node that was abandoned after `longest`.
pub(crate) fn left_behind(longest: Duration) -> NodeError {
    NodeError::program(format_args!(
        "has not come back from an activation for {:.1} s: the run ends without it and the nodes that share its thread",
        longest.as_secs_f64()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_that_says_that_it_is_at_work_is_not_stuck() {
        let at = Arc::new(AtomicU64::new((7 << 32) | 3));
        let mut watch = Watch::new(Arc::clone(&at));
        let mut look = || watch.stuck(Duration::ZERO);
        assert_eq!(look(), None, "seen for the first time");
        for _ in 0..3 {
            // As `Io::still_working` does.
            at.fetch_add(1 << 32, Ordering::Relaxed);
            assert_eq!(look(), None);
        }
        assert_eq!(look(), Some(3));
        assert_eq!(look(), None, "told once");
    }
}
