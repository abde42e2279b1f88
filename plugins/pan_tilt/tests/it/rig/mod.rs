//! Heads in rigs: from a command to bytes to mechanics to a report, on the clock of the run and live.

mod faults;
mod live;
mod loops;
mod parts;
mod traffic;
