//! Which of the rig's cameras are calibrated, where some are left out on the command line.

use std::collections::BTreeSet;

use foveate_scene::selection::select;
use foveate_scene::{Calibration, Draft};

/// Cameras of a calibration that are used.
#[derive(Debug, Clone, PartialEq)]
pub struct Selected {
    /// Their places in the calibration.
    pub places: Vec<usize>,
    /// Names of those that are left out.
    pub left_out: Vec<String>,
}

impl Selected {
    /// Those that `patterns`, parted by commas, mean; all without any.
    ///
    /// # Errors
    /// A sentence for the person: a pattern that matches none, or that leaves none.
    pub fn new(patterns: Option<&str>, calibration: &Calibration) -> Result<Selected, String> {
        let names: Vec<&str> = calibration.cameras.iter().map(|it| it.name.as_str()).collect();
        let Some(patterns) = patterns else {
            return Ok(Selected { places: (0..names.len()).collect(), left_out: Vec::new() });
        };
        let list: Vec<&str> = patterns.split(',').map(str::trim).collect();
        let places = select(&list, &names).map_err(|fault| format!("error: --cameras: {fault}"))?;
        let left_out = (0..names.len()).filter(|it| !places.contains(it)).map(|it| names[it].to_owned()).collect();
        Ok(Selected { places, left_out })
    }

    /// By place in the calibration: the place among those that are used.
    pub fn numbers(&self, n_cameras: usize) -> Vec<Option<usize>> {
        (0..n_cameras).map(|it| self.places.iter().position(|place| *place == it)).collect()
    }

    /// The guesses of the cameras that are used.
    pub fn of(&self, draft: &Draft) -> Draft {
        let cameras = self.places.iter().map(|it| draft.calibration.cameras[*it].clone()).collect();
        let out: BTreeSet<&String> = self.left_out.iter().collect();
        let unknown = draft.unknown.iter().filter(|it| !out.contains(it.0)).map(|it| (it.0.clone(), *it.1)).collect();
        Draft { calibration: Calibration { cameras, ..draft.calibration.clone() }, unknown }
    }
}
