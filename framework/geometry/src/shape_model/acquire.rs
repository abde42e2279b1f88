//! Learns a shape model from frames of labelled points.

use foveate_estimation::principal::PrincipalError;
use nalgebra::{DMatrix, Matrix3, Point3, Vector3};

use super::bases::bases_of;
use super::fit::{FitOptions, MarkObservation, ShapeFitter};
use super::judge::judge;
use super::procrustes::{Aligned, align_frames};
use super::{Bases, ShapeKind, ShapeModel, Usual};

/// Options of [`acquire`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AcquisitionOptions {
    /// Kind of bases.
    pub kind: ShapeKind,
    /// Most bases.
    pub n_bases: usize,
    /// Noise of a captured mark, standard deviation of each axis [m].
    pub noise: f64,
    /// For components: expected movement of a mark beyond what was captured, relative to its captured movement [–].
    pub unseen: f64,
    /// Correlation length of that additional movement [m].
    pub reach: f64,
    /// Seed for the choice of marks hidden in the trials.
    pub seed: u64,
}

impl Default for AcquisitionOptions {
    /// As for a face of 40 to 80 marks.
    fn default() -> Self {
        Self { kind: ShapeKind::Components, n_bases: 80, noise: 2e-4, unseen: 0.1, reach: 0.02, seed: 1 }
    }
}

impl AcquisitionOptions {
    /// A model is not taken to be better than a part of the noise of the marks that it was made from [m²].
    pub(super) fn least_unexplained(&self) -> f64 {
        (LEAST_OF_NOISE * self.noise).powi(2)
    }
}

/// Why no model can be learnt.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AcquisitionError {
    /// Too few marks or frames.
    #[error("{marks} marks in {frames} frames make no model; expected 3 marks and 1 frame at least")]
    TooFew {
        /// Number of marks.
        marks: usize,
        /// Number of frames.
        frames: usize,
    },
    /// A frame with another number of marks.
    #[error("frame {frame} has {found} marks, expected {expected}, one for each label")]
    Lengths {
        /// Index of the frame.
        frame: usize,
        /// Number of marks in it.
        found: usize,
        /// Number that was expected.
        expected: usize,
    },
    /// A position that is not finite.
    #[error("frame {frame}, mark {label} is not finite")]
    NotFinite {
        /// Index of the frame.
        frame: usize,
        /// Label of the mark.
        label: u32,
    },
    /// Labels that are not ascending.
    #[error("label {label} is repeated or out of order, expected ascending labels")]
    Labels {
        /// The label.
        label: u32,
    },
    /// Marks on a line, or a mark that no usable frame has.
    #[error(
        "the marks do not determine a pose: no frame has three of them off one line, or a mark is in no such frame"
    )]
    Degenerate,
    /// An option out of range.
    #[error("{what} of {found}; expected {expected}")]
    Options {
        /// Which option.
        what: &'static str,
        /// Value that was found.
        found: f64,
        /// What was expected.
        expected: &'static str,
    },
}

const LEAST_OF_NOISE: f64 = 0.25;
/// Rounds in which marks missing from frames are filled and the bases made again.
const FILLING_ROUNDS: usize = 3;

/// Learns a model from `frames`, each with an entry for every label. Frames may have any pose, and may lack marks.
///
/// # Errors
/// See [`AcquisitionError`].
pub fn acquire(
    labels: &[u32],
    frames: &[Vec<Option<Point3<f64>>>],
    options: &AcquisitionOptions,
) -> Result<ShapeModel, AcquisitionError> {
    check(labels, frames, options)?;
    let Aligned { frames: aligned, mean, spreads } =
        align_frames(frames, options.noise).ok_or(AcquisitionError::Degenerate)?;
    let complete = |frame: &[Option<Point3<f64>>], filled: &[Point3<f64>]| -> Vec<f64> {
        frame.iter().zip(filled).flat_map(|(seen, filled)| seen.unwrap_or(*filled).coords.data.0[0]).collect()
    };
    let n = labels.len();
    let mut table = DMatrix::zeros(3 * n, aligned.len());
    for (column, frame) in aligned.iter().enumerate() {
        table.column_mut(column).copy_from_slice(&complete(frame, &mean));
    }
    let noise = Matrix3::from_diagonal_element(options.noise * options.noise);
    let lacking: Vec<usize> = (0..aligned.len()).filter(|it| aligned[*it].contains(&None)).collect();
    for _ in 0..if lacking.is_empty() { 0 } else { FILLING_ROUNDS } {
        let filling = AcquisitionOptions { kind: ShapeKind::Components, ..*options };
        let mut fitter = ShapeFitter::new(model_of(labels, &table, &spreads, &filling)?);
        for &column in &lacking {
            let frame = &aligned[column];
            let observations: Vec<MarkObservation> =
                (0..n).filter_map(|mark| Some(MarkObservation::new(labels[mark], frame[mark]?, noise))).collect();
            if let Ok(fitted) =
                fitter.fit(&observations, &FitOptions { gate_sigmas: f64::INFINITY, ..FitOptions::default() })
            {
                let places: Vec<Point3<f64>> =
                    fitted.marks.iter().map(|it| fitted.measured_from_shape * it.position).collect();
                table.column_mut(column).copy_from_slice(&complete(frame, &places));
            }
        }
    }
    let mut model = model_of(labels, &table, &spreads, options)?;
    judge(&mut model, &table, &aligned, options)?;
    Ok(model)
}

/// A model of complete, aligned frames (one a column) that has not been tried yet.
pub(super) fn model_of(
    labels: &[u32],
    table: &DMatrix<f64>,
    spreads: &[f64],
    options: &AcquisitionOptions,
) -> Result<ShapeModel, AcquisitionError> {
    let based = bases_of(table, spreads, options).map_err(|fault| match fault {
        PrincipalError::NotFinite { sample, number } => {
            AcquisitionError::NotFinite { frame: sample, label: labels[number / 3] }
        }
        PrincipalError::Empty { .. } | PrincipalError::Shape { .. } => {
            AcquisitionError::TooFew { marks: labels.len(), frames: table.ncols() }
        }
    })?;
    let mean = table.column_mean();
    Ok(ShapeModel {
        labels: labels.to_vec(),
        mean: (0..labels.len()).map(|it| Point3::from(mean.fixed_rows::<3>(3 * it).into_owned())).collect(),
        spreads: spreads.to_vec(),
        hidden: based.unexplained.iter().map(|it| Matrix3::from_diagonal_element(*it)).collect(),
        shapes: based.shapes,
        bases: based.bases,
        unexplained: based.unexplained,
        usual: Usual { misfit: 1.0, strain: 1.0 },
    })
}

fn check(
    labels: &[u32],
    frames: &[Vec<Option<Point3<f64>>>],
    options: &AcquisitionOptions,
) -> Result<(), AcquisitionError> {
    let n = labels.len();
    if n < 3 || frames.is_empty() {
        return Err(AcquisitionError::TooFew { marks: n, frames: frames.len() });
    }
    if let Some(pair) = labels.windows(2).find(|it| it[0] >= it[1]) {
        return Err(AcquisitionError::Labels { label: pair[1] });
    }
    for (frame, marks) in frames.iter().enumerate() {
        if marks.len() != n {
            return Err(AcquisitionError::Lengths { frame, found: marks.len(), expected: n });
        }
        let broken = |it: &Option<Point3<f64>>| it.is_some_and(|it| it.coords.iter().any(|it| !it.is_finite()));
        if let Some(mark) = marks.iter().position(broken) {
            return Err(AcquisitionError::NotFinite { frame, label: labels[mark] });
        }
    }
    for (what, found, sound, expected) in [
        ("noise", options.noise, options.noise > 0.0 && options.noise.is_finite(), "above 0 [m]"),
        ("movement not captured", options.unseen, (0.0..=10.0).contains(&options.unseen), "0 to 10 [–]"),
        ("reach", options.reach, options.reach > 0.0 && options.reach.is_finite(), "above 0 [m]"),
        ("number of bases", options.n_bases as f64, options.n_bases > 0, "1 or more"),
    ] {
        if !sound {
            return Err(AcquisitionError::Options { what, found, expected });
        }
    }
    Ok(())
}

/// Where three numbers of a mark stand.
pub(super) fn place_in(column: &[f64], mark: usize) -> Point3<f64> {
    Point3::from(Vector3::new(column[3 * mark], column[3 * mark + 1], column[3 * mark + 2]))
}

impl ShapeModel {
    /// The same model with other bases: for comparisons.
    pub fn with_bases(self, bases: Bases) -> ShapeModel {
        ShapeModel { bases, ..self }
    }
}
