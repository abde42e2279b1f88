//! Adjusts a solved camera network with the length of the wand as an observation: [D'Apuzzo 1999 §2.2], the reference bar method.

use std::collections::BTreeMap;

use foveate_estimation::Loss;
use foveate_geometry::bundle::{
    BundleError, BundleOptions, Freedom, Known, KnownLength, Observation, OpticsPrior, UnobservableParameters,
    adjust_knowing,
};
use foveate_geometry::{Camera, CameraStatus};
use foveate_scene::uncertainty::Fixed;
use nalgebra::{Isometry3, Point2, Point3, Similarity3};

use super::lengths::{TooFewFrames, WandLengths, frames, lengths};
use super::solve::intersected;
use crate::axes::transformed;
use crate::solved::{FixedFreedoms, ObservationRole, Solved, Step};
use crate::stretches::stretches;

/// A stick with a light at either end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wand {
    /// Labels of the ends.
    pub ends: [u32; 2],
    /// Between the centres of the lights [m].
    pub length_m: f64,
    /// Standard deviation of that length, which scales the whole room [m].
    pub sigma_m: f64,
}

/// Options of [`refine`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineOptions {
    /// Of either coordinate of a right pixel, standard deviation [px].
    pub sigma_px: f64,
    /// By how much the length differs from frame to frame, standard deviation: the stick bends, and lights are seen from aside.
    /// Relative to the length [–].
    pub frame_sigma: f64,
    /// Of pixels and lengths, in their standard deviations.
    pub loss: Loss,
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self { sigma_px: 0.5, frame_sigma: 1e-3, loss: Loss::HUBER }
    }
}

/// The result of [`refine`].
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// In metres.
    pub solved: Solved,
    /// Lengths by pixels alone, scaled to the wand's.
    pub before: WandLengths,
    /// Lengths after the adjustment with them; they agree since they were made to.
    pub after: WandLengths,
    /// Parameters that even the wand does not determine; there is then no covariance.
    pub open: Option<UnobservableParameters>,
}

/// Why the network could not be adjusted with the wand.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RefineError {
    /// A number outside its range.
    #[error("{what} is {found}, expected {expected}")]
    BadNumber {
        /// What the number is.
        what: &'static str,
        /// The value that was found.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// The wand was seen in too few frames.
    #[error("{0}; wave it where at least two cameras see it whole")]
    NoWand(TooFewFrames),
    /// The room cannot be adjusted.
    #[error("the camera network cannot be adjusted: {0}")]
    Bundle(BundleError),
}

/// Scales `solved` by the wand, and adjusts cameras (poses, and the optics in `freed` of each) and points to pixels
/// and lengths together. Call it before the axes are fixed: gravity and origin are kept, but the scene may rotate slightly.
///
/// # Errors
/// See [`RefineError`].
pub fn refine(solved: &Solved, wand: &Wand, options: &RefineOptions) -> Result<Refined, RefineError> {
    let Wand { ends, length_m, sigma_m } = *wand;
    let positive = |what, found: f64| {
        let expected = "a finite number above 0";
        let fine = found.is_finite() && found > 0.0;
        fine.then_some(()).ok_or(RefineError::BadNumber { what, found, expected })
    };
    positive("the length of the wand [m]", length_m)?;
    positive("frame_sigma", options.frame_sigma)?;
    if !(sigma_m.is_finite() && sigma_m >= 0.0) {
        let (what, expected) = ("the sigma of the wand's length [m]", "a finite number of 0 or more");
        return Err(RefineError::BadNumber { what, found: sigma_m, expected });
    }
    let factor = length_m / lengths(solved, ends).map_err(RefineError::NoWand)?.mean;
    positive("the length of the wand over the one that was solved for", factor)?;
    let to_metres = Similarity3::from_isometry(Isometry3::identity(), factor);
    let scaled = transformed(solved, &to_metres, solved.fixed.clone());
    let before = lengths(&scaled, ends).map_err(RefineError::NoWand)?;
    let sigma = options.frame_sigma * length_m;
    let known: Vec<KnownLength> =
        frames(&scaled, ends).into_iter().map(|(_, points)| KnownLength { points, length: length_m, sigma }).collect();
    let (mut refined, open) = readjust(&scaled, &known, options).map_err(RefineError::Bundle)?;
    let after = lengths(&refined, ends).map_err(RefineError::NoWand)?;
    let relative = before.sigma.hypot(sigma_m / length_m);
    let by = format!("a wand of {length_m} m");
    refined.fixed = FixedFreedoms { scale: Some(Fixed { by, sigma: Some(relative) }), ..refined.fixed };
    Ok(Refined { solved: refined, before, after, open })
}

/// Adjusts the calibrated cameras of a room to the observations in use, with what is known of lengths between its points.
///
/// # Errors
/// See [`BundleError`].
pub fn readjust(
    solved: &Solved,
    known: &[KnownLength],
    options: &RefineOptions,
) -> Result<(Solved, Option<UnobservableParameters>), BundleError> {
    let calibrated = |it: usize| solved.cameras.get(it).is_some_and(|it| it.status == CameraStatus::Calibrated);
    let members: Vec<usize> = (0..solved.cameras.len()).filter(|it| calibrated(*it)).collect();
    let slot_of = |camera: usize| members.binary_search(&camera).ok();
    let cameras: Vec<Camera> = members.iter().map(|it| solved.cameras[*it].camera.clone()).collect();
    let freedoms: Vec<Freedom> = members.iter().map(|it| solved.cameras[*it].freed).collect();
    let points: Vec<Point3<f64>> = solved.points.iter().map(|it| it.position).collect();
    let used = solved.observations.iter().filter(|it| it.role == ObservationRole::Used);
    let observations: Vec<Observation> = used
        .filter_map(|it| {
            let camera = slot_of(it.camera)?;
            Some(Observation { camera, point: it.point?, pixel: it.pixel, sigma_px: options.sigma_px })
        })
        .collect();
    let bundle = BundleOptions { loss: options.loss, covariance: true, ..BundleOptions::default() };
    let optics: Vec<OpticsPrior> = members.iter().map(|it| solved.cameras[*it].known_optics()).collect();
    let stretches = stretches(&solved.points.iter().map(|it| it.frame).collect::<Vec<_>>());
    let all_known = Known { lengths: known, optics: &optics, stretches: &stretches };
    let found = adjust_knowing(&cameras, &freedoms, &points, &observations, &all_known, &bundle)?;
    let mut adjusted = solved.clone();
    for (slot, index) in members.iter().enumerate() {
        adjusted.cameras[*index].camera.clone_from(&found.cameras[slot]);
        adjusted.cameras[*index].covariance = None;
    }
    let open = match found.covariance {
        Some(Ok(each)) => {
            members.iter().zip(each).for_each(|(index, it)| adjusted.cameras[*index].covariance = Some(it));
            None
        }
        Some(Err(UnobservableParameters { parameters })) => {
            let parameters = parameters.into_iter().map(|(slot, name)| (members[slot], name)).collect();
            Some(UnobservableParameters { parameters })
        }
        None => None,
    };
    for (point, position) in adjusted.points.iter_mut().zip(&found.points) {
        point.position = *position;
    }
    // Points of moments that were held out are no part of the adjustment: they lie where the new cameras see them.
    let mut held_out_points: BTreeMap<usize, Vec<(&Camera, Point2<f64>)>> = BTreeMap::new();
    for it in solved.observations.iter().filter(|it| it.role == ObservationRole::HeldOut) {
        if let (Some(slot), Some(point)) = (slot_of(it.camera), it.point) {
            held_out_points.entry(point).or_default().push((&found.cameras[slot], it.pixel));
        }
    }
    for (point, seen) in held_out_points {
        if let Some(position) = intersected(&seen) {
            adjusted.points[point].position = position;
        }
    }
    for observation in &mut adjusted.observations {
        let seen = slot_of(observation.camera)
            .zip(observation.point)
            .and_then(|(slot, point)| found.cameras[slot].project(&adjusted.points[point].position));
        observation.residual = seen.map(|it| it - observation.pixel);
    }
    let stage = if known.is_empty() { "adjusted" } else { "adjusted with the wand" };
    adjusted.steps.push(Step { stage, rms_px: found.rms_px, used: observations.len() });
    Ok((adjusted, open))
}
