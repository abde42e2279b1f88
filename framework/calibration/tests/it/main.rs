//! Calibrations from simulated and from real observations, compared with the truth.

mod checks;
mod clocks;
mod faults;
mod faulty;
mod no_shared_clock;
mod no_shared_clock_real;
mod path_real;
mod report;
mod simulated_room;
mod waved_light;
