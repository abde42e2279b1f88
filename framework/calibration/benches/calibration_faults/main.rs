//! Which faults of recordings a calibration notices and names: each fault done to each camera of each recording.
//!
//! `cargo bench -p foveate-calibration --bench calibration_faults` reads recordings below `FOVEATE_DATA`. `-- --verbose` tells each run;
//! `-- --set WORD` and `-- --fault WORD` take those alone whose name holds the word.

#[path = "../../tests/it/faulty/mod.rs"]
mod faulty;
mod recorded;

use std::path::PathBuf;

use faulty::faults::Fault;
use foveate_calibration::checks::{CheckOptions, Checks, Level, check};
use foveate_calibration::network::{self, SolvedNetwork};
use foveate_calibration::recording::Recording;
use foveate_calibration::solved::Solved;
use foveate_geometry::{AlignmentOptions, Camera, CameraStatus, alignment::camera_errors};
use recorded::Recorded;

/// What is done to each camera of each recording.
const FAULTS: [Fault; 32] = [
    Fault::Clean,
    Fault::Mirrored,
    Fault::UpsideDown,
    Fault::Swapped,
    Fault::SwappedHalf,
    Fault::Late(1),
    Fault::Late(5),
    Fault::LatePart(0.5),
    Fault::Dropped(0.3),
    Fault::Knocked(10.0),
    Fault::Knocked(40.0),
    Fault::Shifted(3.0),
    Fault::Shifted(6.0),
    Fault::Shifted(10.0),
    Fault::Shifted(20.0),
    Fault::Random(0.3),
    Fault::Random(0.5),
    Fault::Random(0.7),
    Fault::NaNAndTwice,
    Fault::WrongFocal(1.15),
    Fault::WrongPixelShape(1.15),
    Fault::OriginOff,
    Fault::FewCommon(3),
    Fault::Half { first: true },
    Fault::Half { first: false },
    Fault::Without,
    Fault::Rate(10.0),
    Fault::Rate(12.0),
    Fault::Rate(25.0),
    Fault::Rate(29.97),
    Fault::Rate(30.0),
    Fault::Rate(60.0),
];

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let option = |name: &str| args.iter().position(|it| it == name).and_then(|it| args.get(it + 1)).cloned();
    let is_verbose = args.iter().any(|it| it == "--verbose");
    let root = std::env::var_os("FOVEATE_DATA").map(PathBuf::from);
    let (only_set, only_fault) = (option("--set").unwrap_or_default(), option("--fault").unwrap_or_default());
    println!(
        "{:28} {:22} {:>4} {:>6} {:>9} {:>5} {:>7} {:>5} {:>10} {:>10}",
        "set", "fault", "runs", "named", "innocent", "good", "usable", "redo", "worst, ok", "worst"
    );
    let mut all: Vec<Run> = Vec::new();
    for set in recorded::all(root.as_deref()).into_iter().filter(|it| it.name.contains(&only_set)) {
        let clean = network::from_nothing(&set.set.recording, set.set.sought, &set.set.options)
            .expect("the clean set is solved");
        let n_windows: usize = option("--windows").and_then(|it| it.parse().ok()).unwrap_or(0);
        let mut faults: Vec<Fault> = FAULTS.to_vec();
        let mut random = foveate_estimation::Random::new(9).fork("windows");
        faults.extend(
            (0..n_windows)
                .map(|_| Fault::Window { from: random.below(1000) as usize, n: 40 + random.below(161) as usize }),
        );
        for fault in faults.into_iter().filter(|it| format!("{it:?}").contains(&only_fault)) {
            let n = set.set.recording.cameras.len();
            let is_of_all = fault.culprits(0, n).is_empty();
            let cameras = if is_of_all { 1 } else { n };
            let runs: Vec<Run> = (0..cameras)
                .filter_map(|camera| {
                    fault.done_to(&set.set.recording, camera, camera as u64 + 1).map(|it| (camera, it))
                })
                .map(|(camera, recording)| run(&set, &recording, fault, camera, &clean.solved, is_verbose))
                .collect();
            if !runs.is_empty() {
                row(set.name, fault, &runs);
            }
            all.extend(runs);
        }
    }
    if !all.is_empty() {
        row("all", Fault::Clean, &all);
    }
}

/// What came of one recording.
struct Run {
    named: bool,
    innocent: usize,
    level: Option<Level>,
    /// Largest distance of a calibrated camera from where the clean recording has it [% of the room].
    worst: f64,
}

fn row(set: &str, fault: Fault, runs: &[Run]) {
    let count = |of: &dyn Fn(&&Run) -> bool| runs.iter().filter(of).count();
    let worst = |list: Vec<f64>| list.into_iter().fold(0.0, f64::max);
    let name = if set == "all" { String::new() } else { format!("{fault:?}") };
    println!(
        "{set:28} {:22} {:>4} {:>6} {:>9} {:>5} {:>7} {:>5} {:>8.2} % {:>8.2} %",
        name,
        runs.len(),
        count(&|it| it.named),
        runs.iter().map(|it| it.innocent).sum::<usize>(),
        count(&|it| it.level == Some(Level::Good)),
        count(&|it| it.level == Some(Level::Usable)),
        count(&|it| it.level == Some(Level::Redo) || it.level.is_none()),
        worst(runs.iter().filter(|it| it.level.is_some_and(|it| it < Level::Redo)).map(|it| it.worst).collect()),
        worst(runs.iter().map(|it| it.worst).collect()),
    );
}

fn run(set: &Recorded, recording: &Recording, fault: Fault, camera: usize, clean: &Solved, is_verbose: bool) -> Run {
    let start = std::time::Instant::now();
    let culprits = fault.culprits(camera, set.set.recording.cameras.len());
    let found: Result<SolvedNetwork, _> = network::from_nothing(recording, set.set.sought, &set.set.options);
    let causes = fault.causes(set.optics_known);
    match &found {
        Ok(network) => {
            let checks = check(&network.solved, None, &CheckOptions::default());
            let told = told(&checks);
            let is_culprit = |it: &usize| culprits.contains(it);
            let named = causes.is_empty() || told.iter().any(|it| is_culprit(&it.0) && causes.contains(&it.1));
            let innocent = told.iter().filter(|it| !is_culprit(&it.0)).count();
            // Names that were put right need no renaming.
            let is_renamed = fault == Fault::Swapped && !told.iter().any(|it| it.1 == "rows_swapped");
            let worst = worst_centre(&network.solved, clean, is_renamed, &culprits);
            if is_verbose {
                println!(
                    "  {fault:?} of {camera}: {told:?} {worst:.2} % in {:.1} s\n{checks}",
                    start.elapsed().as_secs_f64()
                );
            }
            Run { named, innocent, level: Some(checks.verdict.level), worst }
        }
        Err(fault) => {
            let words = fault.to_string();
            if is_verbose {
                println!("  refused: {words}");
            }
            let named = causes.is_empty() || culprits.iter().all(|it| words.contains(&recording.cameras[*it].name));
            Run { named, innocent: 0, level: None, worst: 0.0 }
        }
    }
}

/// Cameras and causes that a program is told.
fn told(checks: &Checks) -> Vec<(usize, &'static str)> {
    checks.candidates.iter().map(|it| (it.camera, it.cause.name())).collect()
}

/// Largest distance of a camera from where the clean recording has it, after a similarity [% of the room's size].
fn worst_centre(found: &Solved, clean: &Solved, is_renamed: bool, culprits: &[usize]) -> f64 {
    let other = |it: usize| match culprits {
        [a, b] if is_renamed && it == *a => *b,
        [a, b] if is_renamed && it == *b => *a,
        _ => it,
    };
    let both = (0..found.cameras.len()).filter(|it| {
        found.cameras[*it].status == CameraStatus::Calibrated
            && clean.cameras[other(*it)].status == CameraStatus::Calibrated
    });
    let both: Vec<usize> = both.collect();
    let innocent: Vec<usize> = both.iter().copied().filter(|it| is_renamed || !culprits.contains(it)).collect();
    let of = |solved: &Solved, list: &[usize]| -> Vec<Camera> {
        list.iter().map(|it| solved.cameras[*it].camera.clone()).collect()
    };
    let there: Vec<usize> = both.iter().map(|it| other(*it)).collect();
    let reference: &[usize] = if innocent.len() >= 3 { &innocent } else { &both };
    let reference_there: Vec<usize> = reference.iter().map(|it| other(*it)).collect();
    let (here, truth) = (of(found, reference), of(clean, &reference_there));
    let all_cameras: Vec<Camera> = clean.cameras.iter().map(|it| it.camera.clone()).collect();
    let n = all_cameras.len() as f64;
    let middle = all_cameras.iter().fold(nalgebra::Vector3::zeros(), |sum, it| sum + it.centre().coords / n);
    let size = (all_cameras.iter().map(|it| (it.centre().coords - middle).norm_squared()).sum::<f64>() / n).sqrt();
    let options = AlignmentOptions { scale: true, robust: reference.len() >= 5 };
    let Ok(errors) = camera_errors(&here, &truth, options) else { return f64::NAN };
    let move_over = errors.true_from_found;
    let off = of(found, &both).into_iter().zip(of(clean, &there));
    off.map(|(it, truth)| 100.0 * (move_over * it.centre() - truth.centre()).norm() / size).fold(0.0, f64::max)
}
