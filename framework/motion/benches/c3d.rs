//! Time to write and read 60 s of 100 marks as C3D, beside ezc3d in the same run.
//!
//! `FOVEATE_PEER_PYTHON=python3 cargo bench -p foveate-motion --bench c3d`; without the variable, or without ezc3d there, only our side.

use std::hint::black_box;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use foveate_estimation::random::Random;
use foveate_motion::c3d::{ByteOrder, Coding, Recording, Sample, read, write};

const N_MARKS: usize = 100;
const DURATION_S: usize = 60;
const ROUNDS: usize = 31;

/// Marks that wander, as in the peer's script.
fn recording(rate_hz: usize) -> Recording {
    let mut random = Random::new(70);
    let mut places = vec![[0.0_f32; 3]; N_MARKS];
    let mut samples = Vec::new();
    for _ in 0..DURATION_S * rate_hz {
        for place in &mut places {
            place.iter_mut().for_each(|it| *it += random.normal() as f32);
            samples.push(Sample { position: *place, residual: 0.1, cameras: 0b101 });
        }
    }
    Recording {
        rate_hz: rate_hz as f32,
        units: "mm".to_owned(),
        first_frame: 1,
        labels: (0..N_MARKS).map(|it| format!("M{it:03}")).collect(),
        samples,
        ..Recording::default()
    }
}

fn time(what: &str, mut work: impl FnMut()) {
    work();
    let mut times: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("{what}: median {:.2} ms, least {:.2} ms", times[ROUNDS / 2], times[0]);
}

fn main() {
    let folder = std::env::temp_dir();
    let path = folder.join(format!("foveate-bench-{}.c3d", std::process::id()));
    for rate_hz in [60, 240] {
        let recording = recording(rate_hz);
        let coding = Coding::Float { residual_step: 0.02 };
        let encode = || write(&recording, coding, ByteOrder::Intel).expect("a recording that fits");
        let name = format!("{DURATION_S} s x {N_MARKS} marks at {rate_hz} Hz");
        time(&format!("foveate, {name}, bytes in memory"), || drop(black_box(encode())));
        time(&format!("foveate, {name}, written to a file"), || {
            std::fs::write(&path, encode()).expect("a folder for temporary files");
        });
        time(&format!("foveate, {name}, read from a file"), || {
            let bytes = std::fs::read(&path).expect("written above");
            black_box(read(&bytes).expect("what was written"));
        });
    }
    std::fs::remove_file(&path).ok();
    let Some(python) = std::env::var_os("FOVEATE_PEER_PYTHON") else {
        return println!("ezc3d: not asked, FOVEATE_PEER_PYTHON names no python");
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peer_c3d.py");
    match Command::new(python).arg(script).status() {
        Ok(status) if status.success() => {}
        other => println!("ezc3d: {other:?}"),
    }
}
