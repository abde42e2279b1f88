//! Time of fits between bounds at the size of a face [Davis 2002 §5.4]: 69 marks (207 rows), 80 basis faces, weights in 0 to 1, beside SciPy in the same run.
//!
//! `FOVEATE_PYTHON=python cargo bench -p foveate-estimation --bench bounded`, a Python with NumPy and SciPy; without it the peer is left out. Both fit the same
//! faces: 12 ways of moving that go on smoothly, 30 frames a second, 0.4 mm of noise. Times are a frame's, of one thread: the median and the least of 40 rounds of 200 frames.

use std::hint::black_box;
use std::io::Write;
use std::process::{Command, Stdio};
use std::time::Instant;

use foveate_estimation::{BoundedLeastSquares, Random};
use nalgebra::DMatrix;

const MARKS: usize = 69;
const ROWS: usize = 3 * MARKS;
const BASES: usize = 80;
const MODES: usize = 12;
const FRAMES: usize = 200;
const ROUNDS: usize = 40;

/// Basis faces, and frames of a performance [mm].
fn faces() -> (DMatrix<f64>, Vec<Vec<f64>>) {
    let mut random = Random::new(60);
    let mean: Vec<f64> = (0..ROWS).map(|_| 60.0 * random.normal()).collect();
    let modes = DMatrix::from_fn(ROWS, MODES, |_, mode| random.normal() * (6.0 - 0.5 * mode as f64));
    let face = |weights: Vec<f64>, random: &mut Random| -> Vec<f64> {
        let moved = &modes * nalgebra::DVector::from_vec(weights);
        moved.iter().zip(&mean).map(|(it, mean)| it + mean + 0.4 * random.normal()).collect()
    };
    let columns: Vec<f64> = (0..BASES)
        .flat_map(|_| {
            let weights = (0..MODES).map(|_| random.uniform_in(-1.0, 1.0)).collect();
            face(weights, &mut random)
        })
        .collect();
    let frames = (0..FRAMES).map(|frame| {
        let at = |mode: usize| (frame as f64 / 30.0 * (1.0 + 0.4 * mode as f64) + mode as f64).sin() * 0.9;
        face((0..MODES).map(at).collect(), &mut random)
    });
    (DMatrix::from_vec(ROWS, BASES, columns), frames.collect())
}

/// Median and least time of a frame [ms].
fn time(mut work: impl FnMut(usize)) -> (f64, f64) {
    let mut times: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let start = Instant::now();
            (0..FRAMES).for_each(&mut work);
            start.elapsed().as_secs_f64() * 1e3 / FRAMES as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    (times[ROUNDS / 2], times[0])
}

/// Which rows count in `frame` when so many marks are hidden: always the same marks, or others each frame.
fn rows(hidden: usize, frame: usize) -> Vec<bool> {
    (0..ROWS).map(|row| !(0..hidden).any(|it| (it * 6 + frame) % MARKS == row / 3)).collect()
}

fn main() {
    let (matrix, frames) = faces();
    let new = || BoundedLeastSquares::new(matrix.clone(), &[0.0; BASES], &[1.0; BASES]).expect("sound numbers");
    let print =
        |name: &str, (median, least): (f64, f64)| println!("{name}: median {median:.4} ms, least {least:.4} ms");
    for hidden in [0, 11, 35] {
        let mut solver = new();
        let counts = rows(hidden, 0);
        let mut solve = |frame: usize| {
            black_box(solver.solve(&frames[frame], &counts)).expect("sound numbers");
        };
        solve(0);
        print(&format!("{hidden} hidden, always the same, from the last frame's weights"), time(&mut solve));
    }
    let all_rows: Vec<Vec<bool>> = (0..FRAMES).map(|it| rows(11, it)).collect();
    let mut solver = new();
    let changing = time(|frame| {
        black_box(solver.solve(&frames[frame], &all_rows[frame])).expect("sound numbers");
    });
    print("11 hidden, others each frame (22 marks, 66 rows, mended), from the last frame's weights", changing);
    let mut solver = new();
    let all = vec![true; ROWS];
    let cold = time(|frame| {
        solver.forget();
        black_box(solver.solve(&frames[frame], &all)).expect("sound numbers");
    });
    print("0 hidden, from nothing", cold);

    let mut solver = new();
    let found: Vec<_> = frames.iter().map(|it| solver.solve(it, &all).expect("sound numbers")).collect();
    let mean = |of: &dyn Fn(&foveate_estimation::Bounded) -> f64| found.iter().map(of).sum::<f64>() / FRAMES as f64;
    println!(
        "weights between bounds {:.1}, systems solved {:.2} a frame, largest slope {:.1e}",
        mean(&|it| it.n_free as f64),
        mean(&|it| it.n_solved as f64),
        found.iter().map(|it| it.slope).fold(0.0, f64::max),
    );
    peer(&matrix, &frames, &found);
}

/// Runs SciPy on the same numbers, and compares what it finds.
fn peer(matrix: &DMatrix<f64>, frames: &[Vec<f64>], found: &[foveate_estimation::Bounded]) {
    let Some(python) = std::env::var_os("FOVEATE_PYTHON") else {
        return println!("SciPy is left out: FOVEATE_PYTHON names no Python");
    };
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/peer_bounded.py");
    let child = Command::new(&python).arg(script).stdin(Stdio::piped()).spawn();
    let mut child = match child {
        Ok(child) => child,
        Err(error) => return println!("SciPy is left out: {} ({error})", python.display()),
    };
    let mut numbers: Vec<f64> = vec![ROWS as f64, BASES as f64, frames.len() as f64];
    numbers.extend(matrix.as_slice());
    numbers.extend(frames.iter().flatten());
    numbers.extend(found.iter().map(|it| it.cost));
    numbers.extend(found.iter().flat_map(|it| &it.weights));
    let bytes: Vec<u8> = numbers.iter().flat_map(|it| it.to_le_bytes()).collect();
    let written = child.stdin.take().map(|mut pipe| pipe.write_all(&bytes));
    match (written, child.wait()) {
        (Some(Ok(())), Ok(status)) if status.success() => {}
        (written, ended) => println!("SciPy gave no answer: {written:?}, {ended:?}"),
    }
}
