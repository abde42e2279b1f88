//! The large scale [Davis 2002 chapter 3] held against known truth: tables and plots.
//!
//! `cargo bench -p foveate-tests --bench large_scale -- [PART ...|all] [--seeds N] [--out DIR]`; without a part ten of the scenes.
//! Plots are written where `--out` says so.
//!
//! | part | what it measures |
//! |---|---|
//! | `scenes` | 8 wandering lights with clutter and occlusions, 6 unsynchronised cameras: each variant of the tracker |
//! | `crowd` | the same for 32 lights and 64 cameras |
//! | `crossings` | pairs of lights that cross, or meet and turn back, at 30 to 100 mm |
//! | `convergence` | Figure 25: calibration by turns and by bundle adjustment, error on independent observations |
//! | `stage` | §3.7: a LED on a linear stage in rendered pictures, Figures 36 to 41 |
//! | `strengths` | Figures 42 to 44: the motion model at three strengths, on a line and on a circle |
//! | `starvation` | Figure 35: three cameras, one of whose clocks is 4 ms ahead |
//! | `overload` | the same three and an integrator that is too slow: updates under each way to empty the queues |
//! | `clocks` | offsets of 5, 20 and 50 ms: what they cost, how well they are recovered |
//! | `speed` | observations a second; `tests/benches/peer_tracking.py` sets a peer beside it |
//! | `growth` | time and memory from 4 to 1,000 cameras |
//! | `hour` | one hour at full rate: memory, identities |

mod chart;
mod clocks;
mod convergence;
mod growth;
mod hour;
mod lines;
mod overload;
mod scenes;
mod speed;
mod stage;
mod starvation;
mod strengths;
mod variants;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use foveate_testkit::allocation::Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// What was asked for.
pub struct Options {
    /// Seeds of a part, where not its own number.
    pub seeds: Option<u64>,
    /// Where plots go.
    pub out: Option<PathBuf>,
}

type Part = fn(&Options);

const PARTS: &[(&str, Part)] = &[
    // First: what other parts leave behind in memory would be counted.
    ("hour", hour::hour),
    ("scenes", scenes::scenes),
    ("crowd", scenes::crowd),
    ("crossings", scenes::crossings),
    ("convergence", convergence::convergence),
    ("stage", stage::stage),
    ("strengths", strengths::strengths),
    ("starvation", starvation::starvation),
    ("overload", overload::overload),
    ("clocks", clocks::clocks),
    ("speed", speed::speed),
    ("growth", growth::growth),
];

fn main() -> ExitCode {
    let mut options = Options { seeds: None, out: None };
    let mut parts: Vec<(&str, Part)> = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} needs a value"));
        let known = match argument.as_str() {
            "--bench" => Ok(()), // cargo's own
            "--out" => value().map(|it| options.out = Some(it.into())),
            "--seeds" => value().and_then(|it| {
                let n = it.parse().map_err(|_| format!("--seeds is {it}, expected a whole number"))?;
                options.seeds = Some(n);
                Ok(())
            }),
            "all" => {
                parts.extend(PARTS);
                Ok(())
            }
            name => match PARTS.iter().find(|it| it.0 == name) {
                Some(part) => {
                    parts.push(*part);
                    Ok(())
                }
                None => Err(format!(
                    "{name} is none of {:?}, all, --seeds, --out",
                    PARTS.iter().map(|it| it.0).collect::<Vec<_>>()
                )),
            },
        };
        if let Err(error) = known {
            eprintln!("{error}");
            return ExitCode::FAILURE;
        }
    }
    if parts.is_empty() {
        options.seeds.get_or_insert(10);
        parts.push(("scenes", scenes::scenes));
    }
    for (name, part) in parts {
        let start = Instant::now();
        part(&options);
        println!("({name}: {:.1} s)\n", start.elapsed().as_secs_f64());
    }
    ExitCode::SUCCESS
}
