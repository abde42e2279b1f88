//! What all image detectors share: their camera, where targets are expected, gaps and counts.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::sync::Arc;

use foveate_geometry::Camera;
use foveate_messages::{CameraId, Features, Image, Stamp, Stamped, Targets};
use nalgebra::Point2;

use crate::error::ConfigError;
use crate::io::Io;
use crate::pool::Pool;
use crate::port::{In, Out};
use crate::report::Report;
use crate::setup::Setup;

/// What a detector made of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// It was searched.
    Searched,
    /// The background is still being learnt: nothing is reported.
    Learning,
    /// Too much of it differs from the background to be targets: nothing is reported.
    Flooded,
}

/// Corners (x, y) of a region of a picture [px].
pub type Polygon = Vec<[f64; 2]>;

/// Checks the settings `masks` and `camera_masks`: regions that are not searched, of all cameras and of some by their names.
///
/// # Errors
/// A region of fewer than three corners, or with a corner that is nowhere.
pub fn check_masks(masks: &[Polygon], of_cameras: &BTreeMap<String, Vec<Polygon>>) -> Result<(), ConfigError> {
    let of_all = masks.iter().enumerate().map(|(place, it)| (format!("masks[{place}]"), it));
    let of_some = of_cameras.iter().flat_map(|(camera, list)| {
        list.iter().enumerate().map(move |(place, it)| (format!("camera_masks.{camera}[{place}]"), it))
    });
    for (setting, polygon) in of_all.chain(of_some) {
        if polygon.len() < 3 {
            let n = polygon.len();
            return Err(ConfigError::at(&setting, format_args!("found {n} corners, expected at least 3")));
        }
        if let Some([x, y]) = polygon.iter().find(|[x, y]| !(x.is_finite() && y.is_finite())) {
            let text = format_args!("found the corner ({x}, {y}), expected finite numbers");
            return Err(ConfigError::at(&setting, text));
        }
    }
    Ok(())
}

/// The ports of a detector.
pub struct DetectorPorts {
    /// Pictures of one camera.
    pub image: &'static In<Image>,
    /// Predicted targets, in the space in which the camera stands.
    pub predicted: &'static In<Targets>,
    /// What was found.
    pub features: &'static Out<Features>,
}

/// The part of a detector's node that does not depend on the search for features.
pub struct DetectorShell {
    camera: Option<CameraId>,
    camera_name: String,
    /// Names of all cameras.
    cameras: Vec<String>,
    model: Option<Camera>,
    pool: Pool<Features>,
    /// Pictures by [`Outcome`].
    outcomes: [u64; 3],
    refused: u64,
    features: u64,
}

impl DetectorShell {
    /// For the camera of `setup`.
    pub fn new(setup: &Setup) -> Self {
        Self {
            camera: setup.camera,
            camera_name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            cameras: setup.calibration.cameras.iter().map(|it| it.name.clone()).collect(),
            model: setup.camera_model().cloned(),
            pool: Pool::default(),
            outcomes: [0; 3],
            refused: 0,
            features: 0,
        }
    }

    /// All regions that are not searched in this camera's pictures, by the settings `masks` and `camera_masks`.
    ///
    /// # Errors
    /// As [`check_masks`], and a camera that the calibration does not have.
    pub fn masks(
        &self,
        masks: &[Polygon],
        of_cameras: &BTreeMap<String, Vec<Polygon>>,
    ) -> Result<Vec<Polygon>, ConfigError> {
        check_masks(masks, of_cameras)?;
        if let Some(name) = of_cameras.keys().find(|it| !self.cameras.contains(it)) {
            let text = format_args!("found the camera `{name}`, expected one of {}", self.cameras.join(", "));
            return Err(ConfigError::at("camera_masks", text));
        }
        let own = of_cameras.get(&self.camera_name).into_iter().flatten();
        Ok(masks.iter().chain(own).cloned().collect())
    }

    /// Takes a picture, calls `find` to search it for features, and emits them. `find` gets the picture, the pixels at which targets are
    /// expected, the camera's model and an empty list. A picture that `find` refuses, and one that is flooded, is a gap;
    /// `flooded` says why. Gives the picture's stamp, if there was one.
    pub fn process<E: Display>(
        &mut self,
        io: &mut Io<'_>,
        ports: &DetectorPorts,
        flooded: &str,
        find: impl FnOnce(
            &Image,
            &mut dyn Iterator<Item = Point2<f64>>,
            Option<&Camera>,
            &mut Features,
        ) -> Result<Outcome, E>,
    ) -> Option<Stamp> {
        let image = io.take(ports.image)?;
        self.search(io, ports, &image, flooded, find);
        Some(image.stamp)
    }

    /// As [`Self::process`], for a picture that the caller has already taken from the port.
    pub fn search<E: Display>(
        &mut self,
        io: &mut Io<'_>,
        ports: &DetectorPorts,
        image: &Stamped<Arc<Image>>,
        flooded: &str,
        find: impl FnOnce(
            &Image,
            &mut dyn Iterator<Item = Point2<f64>>,
            Option<&Camera>,
            &mut Features,
        ) -> Result<Outcome, E>,
    ) {
        let mut features = self.pool.take(Features::default);
        features.camera = self.camera.unwrap_or(image.value.camera);
        let expected = io.latest(ports.predicted);
        let model = self.model.as_ref();
        let mut predicted = expected.iter().flat_map(|targets| {
            let later = image.time() - targets.value.time;
            targets.value.list.iter().filter_map(move |target| model?.project(&target.position_after(later)))
        });
        match find(&image.value, &mut predicted, model, &mut features) {
            Ok(outcome) => {
                self.outcomes[outcome as usize] += 1;
                self.features += features.list.len() as u64;
                let features = self.pool.share(features);
                if outcome == Outcome::Flooded {
                    io.gap(ports.features, image.time(), flooded);
                } else {
                    io.emit(ports.features, image.stamp, features);
                }
            }
            Err(refusal) => {
                self.refused += 1;
                io.gap(ports.features, image.time(), refusal);
            }
        }
    }

    /// Reports what became of the pictures, and how many features were found.
    pub fn report(&self, report: &mut Report) {
        let [searched, learning, flooded] = self.outcomes;
        for (what, count) in [
            ("pictures_searched", searched),
            ("pictures_learning", learning),
            ("pictures_flooded", flooded),
            ("pictures_refused", self.refused),
            ("features", self.features),
        ] {
            // What went well is worth a line a camera, what did not happen is not.
            if count > 0 || what == "features" {
                report.figure(format!("detector.{what}.{}", self.camera_name), count as f64);
            }
        }
    }
}

/// Successive pictures of a new size after which that size is accepted, where no calibration states one.
const SIZE_PATIENCE: u32 = 10;

/// The size of a camera's pictures: as calibrated, or that of its first ones, until others come for long enough.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PictureSize {
    calibrated: Option<[u32; 2]>,
    /// A size other than the expected one, and how often it came in a row.
    other: ([u32; 2], u32),
}

impl PictureSize {
    /// Columns, rows as the calibration states them, if it does [px].
    pub fn new(calibrated: Option<[u32; 2]>) -> Self {
        Self { calibrated, other: ([0; 2], 0) }
    }

    /// As the calibration states it [px].
    pub fn calibrated(&self) -> Option<[u32; 2]> {
        self.calibrated
    }

    /// A whole picture of `size` has come where those before it had `present`, if there were any.
    ///
    /// # Errors
    /// The size that was expected, where this one is not accepted.
    pub fn check(&mut self, size: [u32; 2], present: Option<[u32; 2]>) -> Result<(), [u32; 2]> {
        if let Some(expected) = self.calibrated.or(present).filter(|it| *it != size) {
            let times = if self.other.0 == size { self.other.1 + 1 } else { 1 };
            self.other = (size, times);
            if self.calibrated.is_some() || times < SIZE_PATIENCE || size.contains(&0) {
                return Err(expected);
            }
        }
        self.other.1 = 0;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_size_is_believed_after_a_while_unless_the_calibration_knows_better() {
        let (a, b) = ([640, 480], [320, 240]);
        let mut size = PictureSize::new(None);
        assert_eq!(size.check(a, None), Ok(()));
        (1..SIZE_PATIENCE).for_each(|_| assert_eq!(size.check(b, Some(a)), Err(a)));
        assert_eq!(size.check(a, Some(a)), Ok(()), "which begins the count anew");
        (1..SIZE_PATIENCE).for_each(|_| assert_eq!(size.check(b, Some(a)), Err(a)));
        assert_eq!(size.check(b, Some(a)), Ok(()));
        (0..3 * SIZE_PATIENCE).for_each(|_| assert_eq!(size.check([0, 240], Some(b)), Err(b)));
        let mut known = PictureSize::new(Some(a));
        (0..3 * SIZE_PATIENCE).for_each(|_| assert_eq!(known.check(b, None), Err(a)));
    }
}
