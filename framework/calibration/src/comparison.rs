//! A solved room beside another calibration of the same cameras.

use std::collections::BTreeMap;
use std::fmt::Write;

use foveate_estimation::statistics::Summary;
use foveate_geometry::alignment::{AlignmentRules, camera_errors};
use foveate_geometry::{Camera, CameraStatus};
use foveate_scene::{Calibration, LengthUnit};
use nalgebra::Vector3;

use crate::solved::Solved;
use crate::words::signed;

/// So many cameras are laid over each other by those that agree.
const ROBUST_FROM: usize = 5;

/// How far each camera is from where the other calibration has it, once the two worlds are laid over each other.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    names: Vec<String>,
    /// Distance of centres: in mm where the other calibration is in metres, or else in % of the room's size.
    centres: Vec<f64>,
    unit: &'static str,
    turns_mrad: Vec<f64>,
    focals_percent: Vec<f64>,
    /// Lengths there over lengths here.
    scale: f64,
}

/// Compares the calibrated cameras with those of the same names in `other`.
///
/// # Errors
/// What keeps the two from being laid over each other, in a sentence.
pub fn compare(solved: &Solved, other: &Calibration) -> Result<Comparison, String> {
    let calibrated = solved.cameras.iter().filter(|it| it.status == CameraStatus::Calibrated);
    let (mut names, mut here, mut there): (_, Vec<Camera>, Vec<Camera>) = (Vec::new(), Vec::new(), Vec::new());
    for camera in calibrated {
        if let Some(same) = other.camera(&camera.name) {
            names.push(camera.name.clone());
            here.push(camera.camera.clone());
            there.push(same.clone());
        }
    }
    if names.len() < 3 {
        return Err(format!("{} cameras stand in both, expected at least 3: {}", names.len(), names.join(", ")));
    }
    // One that was displaced is not to make the others look off; fewer cannot outvote it.
    let rules = AlignmentRules { scale: true, robust: names.len() >= ROBUST_FROM };
    let errors = camera_errors(&here, &there, rules).map_err(|fault| fault.to_string())?;
    let n = there.len() as f64;
    let centroid = there.iter().fold(Vector3::zeros(), |sum, it| sum + it.centre().coords / n);
    let size = (there.iter().map(|it| (it.centre().coords - centroid).norm_squared()).sum::<f64>() / n).sqrt();
    let (factor, unit) = match other.length_unit {
        LengthUnit::Metre => (1e3, "mm"),
        LengthUnit::Unknown => (100.0 / size, "%"),
    };
    let focal = |it: &Camera| it.intrinsics.focal[0];
    Ok(Comparison {
        names,
        centres: errors.centres.iter().map(|it| factor * it).collect(),
        unit,
        turns_mrad: errors.rotations.iter().map(|it| 1e3 * it).collect(),
        focals_percent: here
            .iter()
            .zip(&there)
            .map(|(here, there)| 100.0 * (focal(here) / focal(there) - 1.0))
            .collect(),
        scale: errors.true_from_found.scaling(),
    })
}

impl Comparison {
    /// Lengths there over lengths here [–].
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// By dotted name, medians and maxima of sizes and each camera's own.
    pub fn figures(&self) -> BTreeMap<String, f64> {
        let mut figures = BTreeMap::new();
        let centre = if self.unit == "mm" { "compare.centre_mm" } else { "compare.centre_percent" };
        figures.insert("compare.cameras".to_owned(), self.names.len() as f64);
        figures.insert("compare.scale".to_owned(), self.scale);
        for (name, values) in [
            (centre, &self.centres),
            ("compare.turn_mrad", &self.turns_mrad),
            ("compare.focal_percent", &self.focals_percent),
        ] {
            let sizes: Vec<f64> = values.iter().map(|it| it.abs()).collect();
            let summary = Summary::of(&sizes);
            figures.insert(format!("{name}.median"), summary.map_or(f64::NAN, |it| it.median));
            figures.insert(format!("{name}.max"), sizes.iter().fold(0.0, |most, it| it.max(most)));
            figures.extend(self.names.iter().zip(values).map(|(camera, it)| (format!("{name}[{camera}]"), *it)));
        }
        figures
    }

    /// A table; `path` is that of the other calibration.
    pub fn describe(&self, path: &str) -> String {
        let width = self.names.iter().map(|it| it.chars().count()).max().unwrap_or(0).max(6);
        let mut text = format!("beside {path}, laid over it (lengths there are {:.5} of those here):\n", self.scale);
        let _ = writeln!(text, "  {:width$}  {:>11}  {:>11}  {:>9}", "camera", "centre", "turn", "focal");
        for (index, name) in self.names.iter().enumerate() {
            let (centre, turn) = (self.centres[index], self.turns_mrad[index]);
            let focal = signed(self.focals_percent[index], 2);
            let _ = writeln!(text, "  {name:width$}  {centre:8.2} {:2}  {turn:6.2} mrad  {focal:>7} %", self.unit);
        }
        if self.unit == "%" {
            text += "  (% of the room's size: the root mean square distance of the cameras from their middle)\n";
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use foveate_geometry::bundle::Freedom;
    use foveate_scene::NamedCamera;
    use nalgebra::{Point3, Translation3};

    use super::*;
    use crate::solved::SolvedCamera;

    #[test]
    fn of_six_cameras_the_displaced_one_alone_is_off() {
        let camera = |index: usize| {
            let angle = index as f64;
            let centre = Point3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 2.0 + 0.2 * angle);
            Camera::look_at(centre, Point3::new(0.0, 0.0, 1.0), [640, 480], 500.0)
        };
        let solved_camera = |index: usize| SolvedCamera {
            name: format!("wide-{index}"),
            camera: camera(index),
            status: CameraStatus::Calibrated,
            freed: Freedom::POSE,
            prior: None,
            covariance: None,
            clock: None,
        };
        let mut solved = Solved { cameras: (0..6).map(solved_camera).collect(), ..Solved::default() };
        let named = solved.cameras.iter().map(|it| NamedCamera { name: it.name.clone(), camera: it.camera.clone() });
        let other = Calibration::new(named.collect(), LengthUnit::Metre, String::new()).unwrap();
        solved.cameras[2].camera.camera_from_world *= Translation3::new(0.3, 0.0, 0.0);
        let found = compare(&solved, &other).unwrap();
        let off = |it: usize| found.centres[it];
        assert!((0..6).all(|it| (it == 2) == (off(it) > 1.0)), "{:?}", found.centres);
        assert!(found.describe("t.toml").contains("+0.00 %"), "{}", found.describe("t.toml"));
    }
}
