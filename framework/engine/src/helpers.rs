//! Threads that share the rounds of lanes with the one that runs the graph.

use foveate_messages::Time;

use crate::lanes::Lanes;
pub(crate) use crate::rounds::{Kind, WORTH_SHARING};
use crate::rounds::{Rounds, Work};

/// The threads, and which bundles of lanes they are at.
pub(crate) type Helpers = Rounds<Lanes>;

impl Work for Lanes {
    fn run(&self, bundle: usize, until: Time) {
        Lanes::run(self, bundle, until);
    }
}
