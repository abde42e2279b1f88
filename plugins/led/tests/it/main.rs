//! Targets tracked from simulated pictures and observations, compared with the truth. (`allocation` is apart: it counts for the whole process.)

mod identities;
mod laser_room;
mod late_frames;
mod moving_births;
mod simulated_lab;
mod tracking;
