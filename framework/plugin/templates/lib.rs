//! Nodes for foveate rigs.
//!
//! | node | what it does |
//! |---|---|
//! | `my_plugin.my_role` | MY_SUMMARY |

mod my_role;

pub use my_role::{MyNode, MyNodeSettings};

foveate::plugin! {
    "my_plugin.my_role" => MyNode,
}
