//! Small parts to copy from; `docs/add-a-node.md` walks through them.
//!
//! | node | what it does |
//! |---|---|
//! | `example.speed_limit` | drops targets that are faster than anything in the room can be |

mod speed_limit;

use foveate::prelude::Registry;
pub use speed_limit::{SpeedLimit, SpeedLimitSettings};

/// Makes the nodes of this crate known.
pub fn register(registry: &mut Registry) {
    registry.add::<SpeedLimit>();
}
