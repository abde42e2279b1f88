//! Prints what a C3D file holds, marker by marker: `cargo run -p foveate-motion --example print_c3d -- walk.c3d`.

use std::process::ExitCode;

use foveate_motion::c3d;

fn main() -> ExitCode {
    let Some(path) = std::env::args().nth(1) else {
        eprintln!("expected the name of a C3D file");
        return ExitCode::from(2);
    };
    let recording = match std::fs::read(&path)
        .map_err(|it| it.to_string())
        .and_then(|it| c3d::read(&it).map_err(|it| it.to_string()))
    {
        Ok(recording) => recording,
        Err(fault) => {
            eprintln!("{path}: {fault}");
            return ExitCode::from(2);
        }
    };
    let (n_frames, rate_hz) = (recording.n_frames(), recording.rate_hz);
    println!("{n_frames} frames at {rate_hz} Hz, {} points in {}", recording.labels.len(), recording.units);
    for (point, label) in recording.labels.iter().enumerate() {
        let samples = (0..n_frames).map(|frame| recording.frame(frame)[point]);
        let present: Vec<_> = samples.filter(|it| it.is_present()).collect();
        let first = present.first().map_or(String::new(), |it| format!(", first at {:?}", it.position));
        println!("{label:>12}: present in {} of {n_frames} frames{first}", present.len());
    }
    ExitCode::SUCCESS
}
