//! Clocks of cameras that nobody synchronised, from nothing: simulated rooms against the truth, and with `FOVEATE_DATA` set a drone over a
//! field against the clock table of its data set. `cargo bench -p foveate-calibration --bench clocks`, with
//! `-- drones` the latter alone.

#[path = "../tests/it/waved_light/mod.rs"]
mod waved_light;

use std::path::{Path, PathBuf};
use std::time::Instant;

use foveate_calibration::clocks::{ClockOptions, Synchronised, synchronise};
use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use foveate_estimation::{Random, statistics};
use foveate_geometry::bundle::Freedom;
use foveate_scene::{Calibration, Clocks};
use nalgebra::{Isometry3, Point2};
use waved_light::Scene;

const SEEDS: u64 = 20;

fn main() {
    // `-- drones` leaves the simulated rooms out.
    if !std::env::args().any(|it| it == "drones") {
        rooms();
    }
    match drones() {
        Ok(()) => {}
        Err(reason) => println!("drones: skipped: {reason}"),
    }
}

fn rooms() {
    println!(
        "simulated: 6 cameras of 30 to 60 Hz, one of them with uneven stamps, light waved for 30 s; {SEEDS} seeds, errors of offsets"
    );
    println!(
        "offsets      wrong  noise, px  focal    found    rms, ms  max, ms  stated, ms  error/stated, rms  s: median"
    );
    for (reach, wrong, sigma_px, focal) in [
        (0.1, 0.0, 0.5, false),
        (0.1, 0.3, 0.5, false),
        (0.1, 0.0, 0.1, false),
        (0.1, 0.0, 2.0, false),
        (0.1, 0.0, 0.5, true),
        (0.1, 0.3, 0.5, true),
        (20.0, 0.3, 0.5, false),
    ] {
        simulated(reach, wrong, sigma_px, focal);
    }
}

fn simulated(reach_s: f64, wrong: f64, sigma_px: f64, focal: bool) {
    let (mut errors, mut stated, mut ratios, mut seconds) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut all = 0;
    for seed in 0..SEEDS {
        let mut random = Random::new(seed).fork("offsets");
        let offsets: Vec<f64> = (0..6).map(|_| random.uniform_in(-reach_s, reach_s)).collect();
        let length_s = 30.0 + reach_s;
        let scene = Scene { wrong, sigma_px, seed, length_s, ..Scene::new(&offsets) };
        let recording = scene.recording(Freedom { focal, ..Freedom::NONE });
        let options = ClockOptions {
            max_offset_s: (2.2 * reach_s).max(0.5),
            sigma_px,
            inlier_px: (6.0 * sigma_px).max(1.0),
            ..ClockOptions::default()
        };
        let start = Instant::now();
        let found = synchronise(&recording, &options);
        seconds.push(start.elapsed().as_secs_f64());
        let Ok(found) = found else { continue };
        for (camera, clock) in found.clocks.iter().enumerate() {
            all += usize::from(clock.is_some());
            let Some(clock) = clock.filter(|_| camera != found.reference) else { continue };
            let error = clock.offset_s - (offsets[camera] - offsets[found.reference]);
            errors.push(1e3 * error);
            stated.push(1e3 * clock.sigma_s);
            ratios.push(error / clock.sigma_s);
        }
    }
    let rms = |list: &[f64]| (list.iter().map(|it| it * it).sum::<f64>() / list.len().max(1) as f64).sqrt();
    let worst = errors.iter().fold(0.0, |worst: f64, it| worst.max(it.abs()));
    println!(
        "± {:<7}  {:4.0}%  {sigma_px:9.1}  {:<7}  {all:3}/{:<3}  {:7.3}  {worst:7.3}  {:10.3}  {:17.2}  {:9.2}",
        if reach_s < 1.0 { format!("{:.0} ms", reach_s * 1e3) } else { format!("{reach_s:.0} s") },
        100.0 * wrong,
        if focal { "guessed" } else { "known" },
        6 * SEEDS,
        rms(&errors),
        rms(&stated),
        rms(&ratios),
        statistics::median(&seconds).unwrap_or(f64::NAN),
    );
}

/// Dataset3 of the multi-view drone tracking data sets [Albl, Li, Murray et al., ETH Zurich, github.com/CenekAlbl/drone-tracking-datasets].
fn drones() -> Result<(), String> {
    let data = std::env::var_os("FOVEATE_DATA").map(PathBuf::from).ok_or("FOVEATE_DATA is not set")?;
    let folder = data.join("s04_drone_multicam/dataset3/detections");
    let graphs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../graphs/drones.calibration.toml");
    let known = Calibration::load(&graphs).map_err(|fault| fault.to_string())?;
    let clocks = Clocks::load(&graphs.with_file_name("drones_table.clocks.toml")).map_err(|fault| fault.to_string())?;
    let known = Calibration { clocks, ..known };
    let mut recording = Recording::default();
    for (index, named) in known.cameras.iter().enumerate() {
        let path = folder.join(format!("{}.txt", named.name));
        let text = std::fs::read_to_string(&path).map_err(|fault| format!("`{}`: {fault}", path.display()))?;
        let rate_hz = known.clocks.0.get(&named.name).and_then(|it| it.frame_rate_hz);
        let rate_hz = rate_hz.ok_or_else(|| format!("{} has no frame rate", named.name))?;
        for line in text.lines() {
            let numbers: Vec<f64> = line.split_whitespace().filter_map(|it| it.parse().ok()).collect();
            let &[picture, x, y] = numbers.as_slice() else { continue };
            let seen = (x != 0.0 || y != 0.0).then_some(Point2::new(x, y));
            let spot = |pixel| Spot { pixel, sigma_px: 2.0, peak: 1.0, label: None };
            let spots = seen.map(spot).into_iter().collect();
            recording.camera_frames.push(CameraFrame { camera: index, time_s: picture / rate_hz, spots });
        }
        let mut camera = named.camera.clone();
        camera.camera_from_world = Isometry3::identity();
        recording.cameras.push(CameraGuess { name: named.name.clone(), camera, free: Freedom::NONE });
    }
    for (name, free) in [
        ("optics known", Freedom::NONE),
        ("focal lengths and k1 free", Freedom { focal: true, k1: true, ..Freedom::NONE }),
    ] {
        for guess in &mut recording.cameras {
            guess.free = free;
        }
        let options = ClockOptions {
            max_offset_s: 60.0,
            max_drift: 0.002,
            reference: Some(0),
            max_gap_s: 0.3,
            sigma_px: 2.0,
            inlier_px: 12.0,
            max_frames: 3000,
            max_sigma_s: 0.05,
            ..ClockOptions::default()
        };
        let start = Instant::now();
        let found = synchronise(&recording, &options).map_err(|fault| fault.to_string())?;
        let seconds = start.elapsed().as_secs_f64();
        println!(
            "drones, {name}: {seconds:.1} s, {:.2} px rms, {} pairs of which {} agree",
            found.rms_px,
            found.links.len(),
            found.links.iter().filter(|it| it.consistent).count()
        );
        drones_against_table(&recording, &known, &found);
    }
    Ok(())
}

/// Each camera's clock in the middle and at the ends of what all saw, against the table.
fn drones_against_table(recording: &Recording, known: &Calibration, found: &Synchronised) {
    let reference = &known.clocks.0[&recording.cameras[found.reference].name];
    for (camera, (clock, status)) in found.clocks.iter().zip(&found.status).enumerate() {
        let name = &recording.cameras[camera].name;
        let Some(clock) = clock else {
            println!("  {name}: {status}");
            continue;
        };
        let own = || {
            recording.camera_frames.iter().filter(|it| it.camera == camera && !it.spots.is_empty()).map(|it| it.time_s)
        };
        let (first, last) = (own().fold(f64::INFINITY, f64::min), own().fold(f64::NEG_INFINITY, f64::max));
        let table = &known.clocks.0[name];
        // What the room's clock shows when the camera's does, here less by the table.
        let error = |own_s: f64| 1e3 * (clock.room_s(own_s) - reference.camera_s(table.session_s(own_s)));
        println!(
            "  {name}: offset {:8.3} s, drift {:+.6}, in the middle {:+7.1} ms from the table, at the ends {:+7.1} and {:+7.1} ms, stated {:.1} ms; {status}",
            clock.offset_s,
            clock.drift,
            error(0.5 * (first + last)),
            error(first),
            error(last),
            1e3 * clock.sigma_s,
        );
    }
}
