//! Nodes for tests of engines: plain numbers, faults on demand, and a collector that tests can look into.
//!
//! | type | role | what it does |
//! |---|---|---|
//! | `testkit.counter` | source | 0, 1, 2, … at a rate, delivered after a latency |
//! | `testkit.relay` | filter | passes numbers on; its `latest` input may close a cycle |
//! | `testkit.slow` | filter | passes numbers on after keeping the thread busy |
//! | `testkit.fail` | filter | passes numbers on, but gives an error at one of them |
//! | `testkit.panic` | filter | passes numbers on, but panics at one of them |
//! | `testkit.newest` | integrator | passes on the newest number of a source picked at random |
//! | `testkit.join` | integrator | sums up numbers of the same capture time |
//! | `testkit.blob_source` | source | blobs of any size, pooled |
//! | `testkit.pass` | filter | passes blobs on |
//! | `testkit.collect` | sink | keeps what it gets, for [`collected`] |

mod blob;
mod collect;
mod counter;
mod faults;
mod merge;
mod relay;

pub use blob::{Blob, BlobSource, BlobSourceSettings, Pass, PassSettings};
pub use collect::{Collect, CollectSettings, Collected, collected};
pub use counter::{Counter, CounterSettings};
pub use faults::{Fail, FaultSettings, Panic, Slow, SlowSettings};
use foveate_messages::{Message, Quality, Space, Wire};
use foveate_node::Registry;
pub use merge::{Join, MergeSettings, Newest};
pub use relay::{Relay, RelaySettings};

/// A number, of no space.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Number(pub i64);

impl Message for Number {
    const NAME: &'static str = "number";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::Local;

    fn quality(&self) -> Quality {
        Quality { count: Some(1), sigma: None }
    }
}

/// Registers the nodes of this module.
pub fn register(registry: &mut Registry) {
    registry.add::<Counter>();
    registry.add::<Relay>();
    registry.add::<Slow>();
    registry.add::<Fail>();
    registry.add::<Panic>();
    registry.add::<Newest>();
    registry.add::<Join>();
    registry.add::<BlobSource>();
    registry.add::<Pass>();
    registry.add::<Collect>();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check_node;

    #[test]
    fn nodes_keep_the_law() {
        check_node::<Counter>("count = 3");
        check_node::<Relay>("");
        check_node::<Slow>("busy_ms = 2.5");
        check_node::<Fail>("at = 2");
        check_node::<Panic>("");
        check_node::<Newest>("");
        check_node::<Join>("");
        check_node::<BlobSource>("size = 3");
        check_node::<Pass>("");
        check_node::<Collect>("into = 'a test'");
    }

    #[test]
    fn all_can_be_registered_together() {
        let mut registry = Registry::new();
        register(&mut registry);
        assert_eq!(registry.iter().count() - Registry::new().iter().count(), 10);
    }
}
