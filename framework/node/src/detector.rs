//! What detectors of pictures have in common, however they look: which camera they serve, where targets are expected, gaps and counts.

use std::fmt::Display;

use foveate_geometry::Camera;
use foveate_messages::{CameraId, Features, Image, Targets};
use nalgebra::Point2;

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
    /// So much of it stands out that hardly any of it can be a target: nothing is reported.
    Flooded,
}

/// The ports of a detector.
pub struct DetectorPorts {
    /// Pictures of one camera.
    pub image: &'static In<Image>,
    /// Targets as they are foretold, in the space in which the camera stands.
    pub predicted: &'static In<Targets>,
    /// What was found.
    pub features: &'static Out<Features>,
}

/// The part of a detector's node that does not depend on how it looks for features.
pub struct DetectorShell {
    camera: Option<CameraId>,
    camera_name: String,
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
            model: setup.camera_model().cloned(),
            pool: Pool::default(),
            outcomes: [0; 3],
            refused: 0,
            features: 0,
        }
    }

    /// Takes a picture, has `find` look for features in it, and gives them out. `find` gets the picture, the pixels at which targets are
    /// expected, the camera's model and an empty list. A picture that `find` refuses, and one that is flooded, is a gap;
    /// `flooded` says why.
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
    ) {
        let Some(image) = io.take(ports.image) else { return };
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
