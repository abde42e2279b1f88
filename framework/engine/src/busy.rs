//! What an activation of a node costs on the logical clock, where an activation takes no time by itself.

use std::mem::swap;

use foveate_estimation::random::Random;
use foveate_messages::{Interval, Time};

use foveate_node::io::Outbox;
use foveate_rig::graph::Cost;

/// A node whose activations cost time.
pub(crate) struct Work {
    cost: Cost,
    random: Random,
    is_busy: bool,
    /// What the last activation gave out: it leaves when the node is done. Empty while the node is free.
    held: Outbox,
}

impl Work {
    /// `None` where activations cost nothing.
    pub(crate) fn new(cost: Cost, random: Random) -> Option<Work> {
        (cost.time > Interval(0)).then(|| Work { cost, random, is_busy: false, held: Outbox::default() })
    }

    pub(crate) fn is_busy(&self) -> bool {
        self.is_busy
    }

    /// An activation began at `now`: takes what it gave out of `outbox`, and says when it is done.
    pub(crate) fn begin(&mut self, now: Time, outbox: &mut Outbox) -> Time {
        let Cost { time, jitter } = self.cost;
        let more = if jitter == Interval(0) {
            0.0
        } else {
            self.random.uniform_in(-(jitter.0 as f64), jitter.0 as f64).round()
        };
        swap(&mut self.held, outbox);
        self.is_busy = true;
        now + Interval((time.0 + more as i64).max(0))
    }

    /// The activation is done: gives what it held back.
    pub(crate) fn end(&mut self, outbox: &mut Outbox) {
        self.is_busy = false;
        swap(&mut self.held, outbox);
    }
}
