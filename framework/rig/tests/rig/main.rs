//! The rig loader: what it accepts, what it finds, and what holds of every rig.

mod accepted;
mod budgets;
mod faults;
mod laws;
mod parts;
mod pictures;
mod schema;
mod sizes;
mod targets;
