//! Frames gathered for a model, and a rigid model until there is one.

use std::collections::BTreeMap;

use foveate::estimation::statistics::median;
use foveate::geometry::shape_model::{Bases, Usual};
use foveate::geometry::{AcquisitionError, ShapeModel, acquire};
use foveate::prelude::*;
use nalgebra::{DMatrix, Matrix3, Point3};

use super::settings::ShapeSettings;

/// Assumed movement of each mark of an unknown surface [m].
const UNKNOWN_MOVEMENT: f64 = 5e-3;
/// A mark is included when this share of the frames has it.
const OFTEN: f64 = 0.5;

/// Frames of marks in the world.
#[derive(Debug, Default)]
pub(super) struct Capture {
    frames: Vec<BTreeMap<u32, Point3<f64>>>,
    /// Of each frame: the median of its marks' standard deviations [m].
    sigmas: Vec<f64>,
}

impl Capture {
    /// Adds what was measured of one frame.
    pub(super) fn add(&mut self, marks: &Marks) {
        let measured = || marks.list.iter().filter(|it| it.provenance == Provenance::Measured);
        let sigmas: Vec<f64> = measured().map(Mark::sigma).collect();
        if let Some(sigma) = median(&sigmas) {
            self.frames.push(measured().map(|it| (it.label, marks.in_world(it))).collect());
            self.sigmas.push(sigma);
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// The model, and the number of frames that it was made from.
    pub(super) fn model(&self, settings: &ShapeSettings) -> Result<(ShapeModel, usize), AcquisitionError> {
        let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
        self.frames.iter().flat_map(|it| it.keys()).for_each(|it| *counts.entry(*it).or_default() += 1);
        let often = (OFTEN * self.frames.len() as f64).ceil() as usize;
        let labels: Vec<u32> = counts.into_iter().filter(|it| it.1 >= often.max(1)).map(|it| it.0).collect();
        let complete = (settings.complete * labels.len() as f64).ceil() as usize;
        let usable: Vec<Vec<Option<Point3<f64>>>> = self
            .frames
            .iter()
            .map(|frame| labels.iter().map(|it| frame.get(it).copied()).collect::<Vec<_>>())
            .filter(|frame| frame.iter().flatten().count() >= complete)
            .collect();
        let n_used = usable.len().min(settings.frames as usize);
        let used: Vec<_> = (0..n_used).map(|it| usable[it * usable.len() / n_used].clone()).collect();
        let model = acquire(&labels, &used, &settings.options(median(&self.sigmas).unwrap_or(0.0)))?;
        Ok((model, n_used))
    }
}

/// The surface at its first observation, assumed to be rigid; later marks are added to it.
#[derive(Debug, Default)]
pub(super) struct Rigid {
    places: BTreeMap<u32, Point3<f64>>,
}

impl Rigid {
    /// Takes in the marks of one frame, given the pose that the ones known so far have; without one, and without any mark yet, the space begins in
    /// the middle of these.
    pub(super) fn learn(&mut self, marks: &Marks, marks_from_shape: Option<&nalgebra::Isometry3<f64>>) -> bool {
        let start = nalgebra::Isometry3::identity();
        let pose = match marks_from_shape {
            Some(pose) => pose,
            None if self.places.is_empty() => &start,
            None => return false,
        };
        let before = self.places.len();
        for mark in marks.list.iter().filter(|it| it.provenance == Provenance::Measured) {
            self.places.entry(mark.label).or_insert_with(|| pose.inverse_transform_point(&mark.position));
        }
        self.places.len() > before
    }

    /// A model without bases.
    pub(super) fn model(&self) -> ShapeModel {
        let n = self.places.len();
        let variance = UNKNOWN_MOVEMENT * UNKNOWN_MOVEMENT;
        ShapeModel {
            labels: self.places.keys().copied().collect(),
            mean: self.places.values().copied().collect(),
            spreads: vec![UNKNOWN_MOVEMENT; n],
            shapes: DMatrix::zeros(3 * n, 0),
            bases: Bases::Components { variances: Vec::new() },
            unexplained: vec![variance; n],
            hidden: vec![Matrix3::from_diagonal_element(variance); n],
            usual: Usual { misfit: 1.0, strain: 1.0 },
        }
    }
}
