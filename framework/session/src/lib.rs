//! Messages as viewers of robotics read them.

pub mod viewer;
