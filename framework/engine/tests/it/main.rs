//! Runs of whole graphs. (`schedules` is apart: it compiles the protocol of the threads against a model checker.)

mod budgets;
mod engine;
mod figures;
mod scales;
mod soak;
