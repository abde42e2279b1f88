//! Figures of a solved camera network: `summary.json`.

use std::collections::BTreeMap;

use foveate_calibration::cause::Cause;
use foveate_calibration::checks::{Candidate, Checks};
use foveate_calibration::network::SolvedNetwork;
use foveate_calibration::solved::{ObservationRole, Solved};
use foveate_estimation::statistics::Summary;
use foveate_geometry::CameraStatus;
use serde_json::{Value, json};

use crate::results::number;

/// Figures by dotted name, as those of a run.
pub fn figures(network: &SolvedNetwork) -> BTreeMap<String, f64> {
    let solved = &network.solved;
    let mut figures = BTreeMap::new();
    let mut put = |name: &str, value: f64| {
        figures.insert(name.to_owned(), value);
    };
    let calibrated = solved.cameras.iter().filter(|it| it.status == CameraStatus::Calibrated).count();
    put("cameras", solved.cameras.len() as f64);
    put("cameras_calibrated", calibrated as f64);
    put("cameras_moved", network.moved.len() as f64);
    put("frames", moments(solved, 1) as f64);
    put("frames_used", moments(solved, 2) as f64);
    put("frames_used.of_three", moments(solved, 3) as f64);
    put("pixel_sigma_px", network.sigma_px);
    for (name, role) in [("reprojection_px", ObservationRole::Used), ("holdout_px", ObservationRole::HeldOut)] {
        let errors = errors(solved, role, None);
        let summary = Summary::of(&errors);
        put(&format!("{name}.observations"), errors.len() as f64);
        put(&format!("{name}.median"), summary.map_or(f64::NAN, |it| it.median));
        put(&format!("{name}.p90"), summary.map_or(f64::NAN, |it| it.p90));
    }
    put("observations_rejected", errors(solved, ObservationRole::Rejected, None).len() as f64);
    for (index, camera) in solved.cameras.iter().enumerate() {
        let summary = Summary::of(&errors(solved, ObservationRole::Used, Some(index)));
        if let Some(clock) = camera.clock {
            put(&format!("clock_offset_ms[{}]", camera.name), 1e3 * clock.offset_s);
            put(&format!("clock_sigma_ms[{}]", camera.name), 1e3 * clock.sigma_s);
        }
        put(&format!("reprojection_px.median[{}]", camera.name), summary.map_or(f64::NAN, |it| it.median));
    }
    figures
}

/// Faults of cameras for programs: a list of objects, the worst first.
pub fn diagnoses(checks: &Checks) -> Value {
    let object = |it: &Candidate| {
        let with = match it.cause {
            Cause::Swapped { with, .. } => Some(checks.cameras[with].name.clone()),
            _ => None,
        };
        let mut object = json!({
            "camera": checks.cameras[it.camera].name,
            "cause": it.cause.name(),
            "size": it.cause.size().map_or(Value::Null, number),
            "unit": it.cause.unit(),
            "since_s": it.cause.since_s().map_or(Value::Null, number),
            "level": it.judgement.level.to_string(),
        });
        if let (Some(with), Value::Object(object)) = (with, &mut object) {
            object.insert("with".to_owned(), Value::String(with));
        }
        object
    };
    Value::Array(checks.candidates.iter().map(object).collect())
}

/// Lengths of the residuals of observations in one role, of one camera or of all [px].
pub fn errors(solved: &Solved, role: ObservationRole, camera: Option<usize>) -> Vec<f64> {
    let of = solved.observations.iter().filter(|it| it.role == role && camera.is_none_or(|camera| it.camera == camera));
    of.filter_map(|it| Some(it.residual?.norm())).collect()
}

/// Moments of which so many right observations at least are known, those held out among them; one: at which anything was seen.
fn moments(solved: &Solved, least: usize) -> usize {
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    for it in &solved.observations {
        let counts_here = matches!(it.role, ObservationRole::Used | ObservationRole::HeldOut) || least <= 1;
        *counts.entry(it.frame).or_default() += usize::from(counts_here);
    }
    counts.values().filter(|it| **it >= least).count()
}
