//! Figures of wands and waved lights that others recorded: length spread and pixels, of frames that were held out.
//!
//! `cargo bench -p foveate-calibration --bench wand` reads `s15_easywand_3cam` and `s02_strawlab_selfcal` below `FOVEATE_DATA`.

use std::path::{Path, PathBuf};

use foveate_calibration::recording::CameraGuess;
use foveate_calibration::solved::{Solved, SolvedObservation};
use foveate_calibration::wand::{self, RefineOptions, Wand, WandLengths, WandObservation};
use foveate_estimation::statistics::Summary;
use foveate_geometry::bundle::Freedom;
use foveate_geometry::self_calibration::SelfCalibrationOptions;
use foveate_geometry::{Camera, CameraStatus, Distortion, Intrinsics};
use nalgebra::{Isometry3, Point2};

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn main() -> Outcome {
    let Some(root) = std::env::var_os("FOVEATE_DATA").map(PathBuf::from) else {
        println!("FOVEATE_DATA is not set: nothing to measure");
        return Ok(());
    };
    easy_wand(&root.join("s15_easywand_3cam"))?;
    straw_lab(&root.join("s02_strawlab_selfcal/DATA20100906_134124"))
}

fn guess(name: String, image_size: [u32; 2], focal: f64) -> CameraGuess {
    let principal = [0.5 * f64::from(image_size[0]) - 0.5, 0.5 * f64::from(image_size[1]) - 0.5];
    let intrinsics = Intrinsics { focal: [focal; 2], principal, skew: 0.0 };
    let camera =
        Camera { intrinsics, distortion: Distortion::default(), image_size, camera_from_world: Isometry3::identity() };
    CameraGuess { name, camera, free: Freedom { focal: true, ..Freedom::POSE } }
}

/// What may be free beside the pose.
const OPTICS: [(&str, Freedom); 4] = [
    ("focal", Freedom { focal: true, ..Freedom::POSE }),
    ("focal, k1", Freedom { focal: true, k1: true, ..Freedom::POSE }),
    ("focal, k1, k2", Freedom { focal: true, k1: true, k2: true, ..Freedom::POSE }),
    ("focal, principal, k1", Freedom { focal: true, principal: true, k1: true, ..Freedom::POSE }),
];

fn with_freedom(solved: &Solved, freed: Freedom) -> Solved {
    let mut solved = solved.clone();
    solved.cameras.iter_mut().for_each(|it| it.freed = freed);
    solved
}

fn pixels(observations: &[SolvedObservation]) -> Option<Summary> {
    Summary::of(&observations.iter().filter_map(|it| Some(it.residual?.norm())).collect::<Vec<_>>())
}

fn numbers(text: &str, separator: impl Fn(char) -> bool) -> Vec<Vec<f64>> {
    let row = |line: &str| line.split(&separator).filter_map(|it| it.trim().parse().ok()).collect();
    text.lines().map(row).filter(|it: &Vec<f64>| !it.is_empty()).collect()
}

/// Frames fitted, frames held out.
type Halves = (Vec<WandObservation>, Vec<WandObservation>);

fn halves(all: &[WandObservation], odd: bool) -> Halves {
    all.iter().partition(|it| (it.frame % 2 == 0) != odd)
}

fn easy_wand(folder: &Path) -> Outcome {
    let profile = numbers(&std::fs::read_to_string(folder.join("RGBsetup_profile.txt"))?, char::is_whitespace);
    let rows = numbers(&std::fs::read_to_string(folder.join("wandpts.csv"))?, |it| it == ',');
    let cameras: Vec<CameraGuess> =
        profile.iter().map(|it| guess(format!("camera {}", it[0]), [it[2] as u32, it[3] as u32], it[1])).collect();
    let mut all = Vec::new();
    for (frame, row) in rows.iter().enumerate() {
        for (index, pixel) in row.chunks_exact(2).enumerate() {
            let (end, camera, time_s) = ((index / 3) as u32, index % 3, frame as f64);
            all.push(WandObservation { camera, frame, time_s, end, pixel: Point2::new(pixel[0], pixel[1]) });
        }
    }
    println!(
        "s15_easywand_3cam: {} frames, {} cameras; spread of the wand's length, standard deviation over mean",
        rows.len(),
        cameras.len()
    );
    let options = SelfCalibrationOptions { sigma_px: 1.0, inlier_px: 15.0, max_focal_sigma: 0.2, ..Default::default() };
    let unit = Wand { ends: [0, 1], length_m: 1.0, sigma_m: 0.0 };
    println!(
        "{:<22} {:<7} | all: {:>7} {:>7} {:>8} | held out: {:>7} {:>7} {:>8}",
        "free", "wand", "median", "rms px", "spread", "median", "rms px", "spread"
    );
    let start = wand::solve(&cameras, &all, &options)?;
    for it in &start.cameras {
        println!("  {}: {}, focal {:.0} px", it.name, it.status, it.camera.intrinsics.focal[0]);
    }
    for (name, freed) in OPTICS {
        for frame_sigma in [None, Some(3e-3), Some(1e-3)] {
            let refine = RefineOptions { sigma_px: 1.0, frame_sigma: frame_sigma.unwrap_or(1.0), ..Default::default() };
            let refined = |solved: Solved| -> Result<Solved, Box<dyn std::error::Error>> {
                let solved = with_freedom(&solved, freed);
                Ok(match frame_sigma {
                    Some(_) => wand::refine(&solved, &unit, &refine)?.solved,
                    None => wand::readjust(&solved, &[], &refine)?.0,
                })
            };
            let whole = refined(start.clone())?;
            let of_all = wand::lengths(&whole, [0, 1])?;
            let (mut held_out, mut samples) = (Vec::new(), Vec::new());
            for odd in [false, true] {
                let (fit, held) = halves(&all, odd);
                let found = refined(wand::solve(&cameras, &fit, &options)?)?;
                if found.cameras.iter().any(|it| it.status != CameraStatus::Calibrated) {
                    continue;
                }
                let measured = wand::intersect(&found.cameras, &held);
                let WandLengths { samples: own, mean, .. } = wand::lengths(&measured, [0, 1])?;
                held_out.extend(measured.observations);
                samples.extend(own.iter().map(|it| it.length / mean - 1.0));
            }
            let spread = (samples.iter().map(|it| it * it).sum::<f64>() / (samples.len() as f64 - 2.0)).sqrt();
            let (fit, held) = (pixels(&whole.observations), pixels(&held_out));
            let figures = |it: Option<Summary>, all: &[SolvedObservation]| {
                let squares: Vec<f64> = all.iter().filter_map(|it| Some(it.residual?.norm_squared())).collect();
                let rms = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
                format!("{:>7.3} {rms:>7.3}", it.map_or(f64::NAN, |it| it.median))
            };
            println!(
                "{name:<22} {:<7} |      {} {:>6.2} % |           {} {:>6.2} %",
                frame_sigma.map_or("no".into(), |it| format!("{:.1} %", 100.0 * it)),
                figures(fit, &whole.observations),
                100.0 * of_all.spread,
                figures(held, &held_out),
                100.0 * spread
            );
        }
    }
    Ok(())
}

fn straw_lab(folder: &Path) -> Outcome {
    let read = |name: &str| std::fs::read_to_string(folder.join(name));
    let sizes = numbers(&read("Res.dat")?, char::is_whitespace);
    let points: Vec<Vec<f64>> = numbers(&read("points.dat")?, char::is_whitespace);
    let seen = numbers(&read("IdMat.dat")?, char::is_whitespace);
    let names = read("camera_order.txt")?;
    println!(
        "\ns02_strawlab_selfcal: {} cameras, {} frames; pixels held out: every second frame, both ways",
        sizes.len(),
        seen[0].len()
    );
    let mut all = Vec::new();
    for (camera, visible) in seen.iter().enumerate() {
        for (frame, _) in visible.iter().enumerate().filter(|it| *it.1 > 0.5) {
            let pixel = Point2::new(points[3 * camera][frame], points[3 * camera + 1][frame]);
            if pixel.coords.norm().is_finite() {
                all.push(WandObservation { camera, frame, time_s: frame as f64, end: 0, pixel });
            }
        }
    }
    let mut best: Option<(f64, usize, Vec<CameraGuess>)> = None;
    // Nothing is known of the lenses: the focal length by which most observations can be explained is the start.
    for share in [0.6, 0.8, 1.1, 1.5, 2.0] {
        let cameras: Vec<CameraGuess> = sizes
            .iter()
            .zip(names.lines())
            .map(|(size, name)| guess(name.to_owned(), [size[0] as u32, size[1] as u32], share * size[0]))
            .collect();
        let options = SelfCalibrationOptions { inlier_px: 10.0, max_focal_sigma: 0.2, ..Default::default() };
        if let Ok(found) = wand::solve(&cameras, &all, &options) {
            let (rms, used) = (found.steps[0].rms_px, found.steps[0].used);
            println!(
                "  guess {:>5.0} px: {used} of {} observations right, {rms:.3} px rms",
                share * sizes[0][0],
                all.len()
            );
            if best.as_ref().is_none_or(|it| used > it.1 || (used == it.1 && rms < it.0)) {
                best = Some((rms, used, cameras));
            }
        }
    }
    let Some((_, _, cameras)) = best else {
        println!("  no guess of the focal length leads to a room");
        return Ok(());
    };
    println!(
        "{:<22} | fit: {:>7} {:>7} | held out: {:>7} {:>7} {:>7} {:>7} | focal px, k1",
        "free", "median", "p95", "median", "p95", "max", "rms"
    );
    for (name, freed) in OPTICS {
        let (mut fitted, mut held_out, mut lenses) = (Vec::new(), Vec::new(), String::new());
        for odd in [false, true] {
            let (fit, held) = halves(&all, odd);
            let options = SelfCalibrationOptions { inlier_px: 10.0, max_focal_sigma: 0.2, ..Default::default() };
            let start = with_freedom(&wand::solve(&cameras, &fit, &options)?, freed);
            let refine = RefineOptions { sigma_px: 0.5, ..Default::default() };
            let found = wand::readjust(&start, &[], &refine)?.0;
            let measured = wand::intersect(&found.cameras, &held);
            lenses = found
                .cameras
                .iter()
                .map(|it| format!("{:.0} {:+.3}  ", it.camera.intrinsics.focal[0], it.camera.distortion.k1))
                .collect();
            fitted.extend(found.observations);
            held_out.extend(measured.observations);
        }
        let squares: Vec<f64> = held_out.iter().filter_map(|it| Some(it.residual?.norm_squared())).collect();
        let rms = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
        if let Some((fit, held)) = pixels(&fitted).zip(pixels(&held_out)) {
            println!(
                "{name:<22} |      {:>7.3} {:>7.3} |           {:>7.3} {:>7.3} {:>7.2} {rms:>7.3} | {lenses}",
                fit.median, fit.p95, held.median, held.p95, held.max
            );
        }
    }
    Ok(())
}
