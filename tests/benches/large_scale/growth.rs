//! What a frame costs, in time and memory, from 4 cameras to 1,000.

use std::time::Instant;

use foveate::messages::Targets;
use foveate::plot::{Axis, COLOURS, Chart, Series};
use foveate_led::tracker::{IntegratorSettings, Tracker};
use foveate_testkit::allocation::held_bytes;
use foveate_testkit::lab::{Lab, ROOM_M, Wanderers};

use crate::Options;
use crate::chart::save;
use crate::scenes::MIDDLE_M;

const N_CAMERAS: [usize; 9] = [4, 8, 16, 32, 64, 128, 256, 512, 1000];
const RATE_HZ: f64 = 30.0;
const DURATION_S: f64 = 2.0;

/// Measures and draws.
pub fn growth(options: &Options) {
    println!("## Growth from 4 to 1,000 cameras at 30 Hz, features given directly, in one thread\n");
    println!("| cameras | lights | a frame µs | a round of all cameras ms | times real time at 60 Hz | tracker kB |");
    println!("|---|---|---|---|---|---|");
    let (mut times, mut bytes) = (Vec::new(), Vec::new());
    for (n_lights, colour) in [(8, COLOURS[0]), (32, COLOURS[1])] {
        let (mut rounds, mut memory) = (Vec::new(), Vec::new());
        for n_cameras in N_CAMERAS {
            let lab = Lab { rate: RATE_HZ, noise: 0.5, ..Lab::new(n_cameras) };
            let lights = Wanderers::new(n_lights, DURATION_S, MIDDLE_M, 1.2, 1);
            let frames = lab.frames(DURATION_S, &lights);
            // The least of three: what else the machine does only adds.
            let (mut frame_s, mut held) = (f64::INFINITY, 0.0);
            for _ in 0..3 {
                let before = held_bytes();
                let mut tracker = Tracker::new(IntegratorSettings::default(), lab.cameras.clone(), Some(ROOM_M));
                let mut targets = Targets::default();
                let (warm_up, measured) = frames.split_at(frames.len() / 2);
                let mut carry = |part: &[_]| {
                    let start = Instant::now();
                    for (time, features) in part {
                        tracker.observe(*time, features);
                        tracker.write(&mut targets);
                    }
                    start.elapsed().as_secs_f64()
                };
                carry(warm_up);
                frame_s = f64::min(frame_s, carry(measured) / measured.len() as f64);
                held = (held_bytes() - before) as f64 / 1e3;
            }
            let round_s = frame_s * n_cameras as f64;
            println!(
                "| {n_cameras} | {n_lights} | {:.2} | {:.3} | {:.0} | {held:.0} |",
                1e6 * frame_s,
                1e3 * round_s,
                1.0 / (60.0 * round_s)
            );
            rounds.push([n_cameras as f64, 1e3 * round_s]);
            memory.push([n_cameras as f64, held]);
        }
        let (time_slope, memory_slope) = (slope(&rounds), slope(&memory));
        println!("| slope, log-log | {n_lights} | | {time_slope:.2} | | {memory_slope:.2} |");
        times.push(Series::line(format!("{n_lights} lights"), colour, rounds));
        bytes.push(Series::line("", colour, memory));
    }
    println!();
    let chart = |title: &str, y: &str, series| {
        let (x, y) = (Axis::new("cameras [–]").log(), Axis::new(y).log());
        Chart { series, ..Chart::new(title, [340.0, 280.0], x, y) }
    };
    let charts = vec![chart("time", "a round of all cameras [ms]", times), chart("memory", "tracker [kB]", bytes)];
    save(options.out.as_deref(), "growth", "Growth with the number of cameras", 2, charts);
}

/// Of the line through the logarithms, by least squares: 1 is linear growth.
fn slope(points: &[[f64; 2]]) -> f64 {
    let logs: Vec<[f64; 2]> = points.iter().map(|it| it.map(f64::ln)).collect();
    let mean = |axis: usize| logs.iter().map(|it| it[axis]).sum::<f64>() / logs.len() as f64;
    let [x, y] = [mean(0), mean(1)];
    let sum = |of: &dyn Fn(&[f64; 2]) -> f64| logs.iter().map(of).sum::<f64>();
    sum(&|it| (it[0] - x) * (it[1] - y)) / sum(&|it| (it[0] - x).powi(2))
}
