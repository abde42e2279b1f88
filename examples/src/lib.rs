//! Small parts to copy from; `docs/write-a-plugin.md` walks through them.
//!
//! | node | what it does |
//! |---|---|
//! | `example.speed_limit` | drops targets that are faster than anything in the room can be; `--role filter` writes it |
//! | `my_plugin.detector` | what `foveate new plugin` writes: finds bright spots in pictures |
//! | `my_plugin.selector` | with `--role selector`: looks at the highest target |

// The very files that `foveate new plugin` copies, so that they are compiled and tested with everything else.
#[path = "../../framework/plugin/templates/detector.rs"]
pub mod detector;
#[path = "../../framework/plugin/templates/selector.rs"]
pub mod selector;
mod speed_limit;

pub use speed_limit::{SpeedLimit, SpeedLimitSettings};

foveate::plugin! {
    "example.speed_limit" => SpeedLimit,
    "my_plugin.detector" => detector::MyNode,
    "my_plugin.selector" => selector::MyNode,
}
