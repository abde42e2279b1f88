//! The web console: a page that shows a run while it goes on, and lets people put things right.
//!
//! | module | what it holds |
//! |---|---|
//! | [`console`] | the console as a program sees it: opened on a graph, which learns of progress and faults, ended |
//! | `desk` | the thread that answers windows and sends them what they look at |
//! | [`hello`] | what a page learns first: cameras, scales, nodes with their settings, outputs, edges |
//! | [`view`] | messages as the page gets them: values, pictures, points, meshes |
//! | `window` | one window: what it looks at, and what it was sent |
//! | `commands` | what a page asks for |
//! | `source` | what is shown: a run, or a session at some moment |
//! | `state` | what changes while a run goes on: time, edges, faults |
//! | [`settings`] | values of settings: what changed, and how it is written into the rig |
//! | [`marks`] | marks corrected by hand, and where a tracker may have gone wrong |
//! | `page` | the files of the page |
//!
//! The page is plain ES modules and WebGL2, in `page/`, one view a file. It learns all it shows through the contract of messages (name, schema, space), so that messages of a
//! plugin are shown too. `docs/console.md` has what goes over the socket.
//!
//! Nothing here is in the way of a run: viewers see the newest message of each output that they look at, and a window that reads slowly gets fewer of them.

mod commands;
pub mod console;
mod desk;
pub mod hello;
pub mod marks;
mod page;
pub mod settings;
mod source;
mod state;
pub mod view;
mod window;

pub use console::{Again, Console, Mode, Opening, Record};
