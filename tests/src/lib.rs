//! What crosses crates; the tests themselves lie in `tests/`.
