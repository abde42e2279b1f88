//! Small parts to copy from; `docs/write-a-plugin.md` walks through them.
//!
//! | node | what it does |
//! |---|---|
//! | `example.speed_limit` | drops targets that are faster than anything in the room can be |

mod speed_limit;

pub use speed_limit::{SpeedLimit, SpeedLimitSettings};

foveate::plugin! {
    "example.speed_limit" => SpeedLimit,
}
