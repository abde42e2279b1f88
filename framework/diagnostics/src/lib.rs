//! What is wrong with a text that a person wrote: each diagnostic with its place, rendered for a terminal, with what was probably meant.
//!
//! | module | what it holds |
//! |---|---|
//! | [`Diagnostic`], [`Diagnostics`], [`Findings`] | one thing that is wrong; all of them in the order of the text; the collector |
//! | [`fields`] | lines of tables parted into fields, and text quoted for them |
//! | [`file`] | files that people name, opened |
//! | [`names`] | names in messages: "did you mean", lists, patterns |
//! | [`value`] | values of TOML documents that keep their places |

mod diagnostic;
pub mod fields;
pub mod file;
pub mod names;
mod render;
pub mod value;

pub use diagnostic::{Diagnostic, Diagnostics, Findings, Severity, Span};
