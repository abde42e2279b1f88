//! Runs of whole graphs. (`schedules` is apart: it compiles the protocol of the threads against a model checker.)

mod budgets;
mod engine;
mod figures;
mod replay;
mod scales;
mod soak;
