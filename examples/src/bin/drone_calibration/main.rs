//! Makes the calibration of `graphs/drones.toml`: `cargo run --release -p foveate-examples --bin drone_calibration -- DATASET OUT.toml`.
//!
//! `DATASET` is a folder such as `dataset3` of the multi-view drone tracking data sets [Albl, Li, Murray et al., ETH Zurich,
//! github.com/CenekAlbl/drone-tracking-datasets], with their folder `calibration` beside it. Each camera's pose comes from the
//! pixels of the drone and the RTK positions of the **first part of the flight only** ([`PART`]): the rest is left for measuring how well
//! a rig does. In that part each camera's clock is fitted together with its pose, so the poses know nothing of the data set's
//! own clock table; that table is what goes into the file as `[clock.NAME]`, where the data set has one.

mod fit;
mod read;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::ExitCode;

use foveate::geometry::Camera;
use foveate::scene::{Calibration, CameraClock, Clocks, LengthUnit, NamedCamera};
use nalgebra::{Isometry3, Point3};

use fit::{Fitted, best_rigid_fit, fit_camera};
use read::{DataSet, Lens};

/// Part of the flight that the calibration sees.
const PART: f64 = 0.4;
/// Higher than this above its start the drone flies [m].
const FLYING_M: f64 = 2.0;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, out] = arguments.as_slice() else {
        eprintln!("usage: drone_calibration DATASET OUT.toml");
        return ExitCode::from(2);
    };
    match make(Path::new(folder), Path::new(out)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(fault) => {
            eprintln!("{fault}");
            ExitCode::from(2)
        }
    }
}

fn make(folder: &Path, out: &Path) -> Result<(), String> {
    let set = DataSet::read(folder)?;
    let flying: Vec<usize> =
        (0..set.path.rows.len()).filter(|it| set.path.rows[*it].z > FLYING_M + set.path.rows[0].z.min(0.0)).collect();
    let (Some(&first), Some(&last)) = (flying.first(), flying.last()) else {
        return Err(format!("`{}`: the drone never flies", folder.display()));
    };
    let [start_s, end_s] = [first, last].map(|it| it as f64 / read::RTK_HZ);
    let until_s = start_s + PART * (end_s - start_s);
    println!("flight from {start_s:.1} to {end_s:.1} s of RTK; poses from what lies before {until_s:.1} s");

    let mut fitted: Vec<(Fitted, Camera, f64)> = Vec::new();
    for (name, source) in &set.cameras {
        // Where a model was calibrated twice, the lens that fits better.
        let tried = source.lenses.iter().map(|lens| {
            let camera = camera_of(lens, Isometry3::identity());
            fit_camera(&camera, lens.frame_rate_hz, &source.seen, &set.path, [start_s, until_s])
                .map(|it| (it, camera, lens.frame_rate_hz))
        });
        let found: Result<Vec<_>, String> = tried.collect();
        let best = found
            .map_err(|fault| format!("{name}: {fault}"))?
            .into_iter()
            .min_by(|x, y| x.0.loss.total_cmp(&y.0.loss))
            .ok_or_else(|| format!("{name}: no calibration of its lens"))?;
        let (Fitted { n_right, n_pairs, rms_px, offset_s, rate, centre_sigma_m, .. }, _, _) = &best;
        println!(
            "{name}: {n_right} of {n_pairs} pixels agree ({:.0} %), rms {rms_px:.2} px; RTK = {offset_s:.3} s + {rate:.6} camera; centre ± {centre_sigma_m:.3} m",
            100.0 * *n_right as f64 / *n_pairs as f64
        );
        fitted.push(best);
    }

    let clocks = clocks(&set, &fitted);
    // Session time is the first camera's. Where the path's first row lies on it, by each camera and its clock.
    let middle_s = 0.5 * (start_s + until_s);
    let mut starts: Vec<f64> = Vec::new();
    for ((name, _), (fit, ..)) in set.cameras.iter().zip(&fitted) {
        let camera_s = (middle_s - fit.offset_s) / fit.rate;
        let start = clocks.0[name].session_s(camera_s) - middle_s;
        println!("{name}: by it the RTK path begins at {start:.3} s of the session");
        starts.push(start);
    }
    starts.sort_by(f64::total_cmp);
    let start = 0.5 * (starts[(starts.len() - 1) / 2] + starts[starts.len() / 2]);
    println!("start_s = {start:.3} (the median), from_s = {:.1} for what was left out", until_s + start);

    let centres: Vec<Point3<f64>> =
        fitted.iter().map(|(fit, ..)| fit.camera_from_world.inverse() * Point3::origin()).collect();
    if let Some(surveyed) = &set.surveyed {
        let (rms, rows) = best_rigid_fit(&centres, surveyed)?;
        println!("surveyed camera places: {rms:.2} m rms after a rigid fit, cameras in rows {rows:?}");
    }

    let named = set.cameras.keys().zip(&fitted).map(|(name, (fit, camera, _))| NamedCamera {
        name: name.clone(),
        camera: Camera { camera_from_world: fit.camera_from_world, ..camera.clone() },
    });
    let note = format!(
        "poses by resection on the first {:.0} % of the flight; world: the RTK receiver's east, north, up",
        PART * 100.0
    );
    let calibration = Calibration::new(named.collect(), LengthUnit::Metre, note).map_err(|fault| fault.to_string())?;
    let text = format!("{HEADER}{}", Calibration { clocks, ..calibration }.to_toml());
    std::fs::write(out, text).map_err(|error| format!("`{}` cannot be written: {error}", out.display()))
}

const HEADER: &str = "\
# Made by `cargo run --release -p foveate-examples --bin drone_calibration`. The poses are computed here; intrinsics and the clock
# table are those of the multi-view drone tracking data sets of ETH Zurich (C. Albl, J. Li, J. Murray, D. Ismaili, C.-C. Liao et al.,
# github.com/CenekAlbl/drone-tracking-datasets, arXiv:2003.04784), whose data are under CC BY-NC-SA 4.0 and not part of this repository.
";

fn camera_of(lens: &Lens, camera_from_world: Isometry3<f64>) -> Camera {
    Camera { image_size: lens.image_size, intrinsics: lens.intrinsics, distortion: lens.distortion, camera_from_world }
}

/// The data set's own table where it has one, else what was fitted to RTK; against the first camera.
fn clocks(set: &DataSet, fitted: &[(Fitted, Camera, f64)]) -> Clocks {
    let rates: Vec<f64> = fitted.iter().map(|it| it.2).collect();
    let of_table = set.clock_table.as_ref().map(|table| table.solved());
    let mut clocks = BTreeMap::new();
    for (index, name) in set.cameras.keys().enumerate() {
        let (offset_s, rate) = match &of_table {
            // Picture i of the first camera is picture alpha i + beta of this one.
            Some(solved) => {
                let (alpha, beta) = solved[index];
                (beta / rates[index], alpha * rates[0] / rates[index])
            }
            None => {
                let (first, own) = (&fitted[0].0, &fitted[index].0);
                ((first.offset_s - own.offset_s) / own.rate, first.rate / own.rate)
            }
        };
        let clock = CameraClock { offset_s, rate, offset_sigma_s: None, frame_rate_hz: Some(rates[index]) };
        println!("{name}: clock = {offset_s:.4} s + {rate:.7} session");
        clocks.insert(name.clone(), clock);
    }
    Clocks(clocks)
}
