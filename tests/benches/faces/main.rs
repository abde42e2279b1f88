//! Hidden marks filled by a model of the face [Davis 2002 §5.5]: errors in tables, Figures 66 and 67 as plots.
//!
//! `cargo bench -p foveate-tests --bench faces -- [PART ...] [--out DIR]`; without a part both. Plots are written where `--out` says so. Real faces come from
//! `s09_face_markers_41` in the folder that `FOVEATE_DATA` names, and are left out without it.
//!
//! | part | what it measures |
//! |---|---|
//! | `filled` | Figures 65 and 66: some marks hidden for 100 frames, a model from 200 others |
//! | `fewer` | Figure 67: more and more marks hidden over 431 frames, five components from 321 others |

#[path = "../large_scale/chart.rs"]
mod chart;
mod fewer;
mod filled;
mod methods;
mod takes;

use std::path::PathBuf;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut out: Option<PathBuf> = None;
    let mut parts: Vec<String> = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--bench" => {} // cargo's own
            "--out" => match arguments.next() {
                Some(folder) => out = Some(folder.into()),
                None => {
                    eprintln!("--out needs a folder");
                    return ExitCode::FAILURE;
                }
            },
            "filled" | "fewer" => parts.push(argument),
            _ => {
                eprintln!("{argument} is none of filled, fewer, --out");
                return ExitCode::FAILURE;
            }
        }
    }
    let wanted = |part: &str| parts.is_empty() || parts.iter().any(|it| it == part);
    if wanted("filled") {
        filled::filled(out.as_deref());
    }
    if wanted("fewer") {
        fewer::fewer(out.as_deref());
    }
    ExitCode::SUCCESS
}
