//! Claims and their figures: `tests/results/*.toml` states them, `measured.json` there keeps what was measured, `docs/results.md` shows both.

pub mod claims;
pub mod measured;
pub mod page;
pub mod runner;
