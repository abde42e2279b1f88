//! What crosses crates: claims about accuracy and speed, measured by the program `results`; the tests themselves lie in `tests/`.

pub mod results;
