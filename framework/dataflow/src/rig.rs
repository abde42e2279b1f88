//! TOML to a checked graph.
