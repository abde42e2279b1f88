//! What crosses crates, and the program as people use it.
//!
//! Apart are three programs of their own: `allocation` counts for a whole process, `overload_live` counts what is alive in one, and `process` is its
//! own child.

mod arrows;
mod boards;
mod broadcast;
mod bundle_bal;
mod calibrate;
mod calibrate_clocks;
mod calibrate_inputs;
mod console;
mod console_page;
#[cfg(unix)]
mod docs;
mod evaluation;
mod exchange;
mod figures;
mod head_calibration;
mod mat_file;
mod motion_files;
mod nested;
mod overload;
mod plugins;
mod program;
mod python_session;
#[cfg(unix)]
mod running;
mod session_files;
mod sessions;
#[cfg(unix)]
mod sim_head;
mod the_program;
mod tidy;
mod truth;
mod walker;
mod wand;
