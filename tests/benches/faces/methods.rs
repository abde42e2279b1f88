//! Ways to fill hidden marks, side by side.

use std::time::Instant;

use foveate::estimation::statistics::percentile;
use foveate::geometry::{
    AcquisitionOptions, Bases, FitOptions, MarkObservation, ShapeFitter, ShapeKind, ShapeModel, acquire,
};
use nalgebra::{Matrix3, Vector3};

use crate::takes::Frame;

/// A way to fill marks.
pub struct Method {
    pub name: &'static str,
    pub model: ShapeModel,
}

/// Noise of the marks where nothing better is known [m].
pub const NOISE: f64 = 2e-4;

fn model(frames: &[Frame], options: AcquisitionOptions) -> ShapeModel {
    let labels: Vec<u32> = (0..frames[0].len() as u32).collect();
    let frames: Vec<_> = frames.iter().map(|it| it.iter().copied().map(Some).collect()).collect();
    acquire(&labels, &frames, &options).expect("complete frames")
}

/// All of them, from the same frames; five components alone where `few`.
pub fn methods(frames: &[Frame], few: bool) -> Vec<Method> {
    let options = AcquisitionOptions { noise: NOISE, ..AcquisitionOptions::default() };
    let five = model(frames, AcquisitionOptions { n_bases: 5, unseen: 0.0, ..options });
    let plain = five.clone().with_bases(Bases::Components { variances: vec![f64::INFINITY; five.n_bases()] });
    let mut methods =
        vec![Method { name: "5 components", model: plain }, Method { name: "5 components, prior", model: five }];
    if few {
        methods.push(Method { name: "80 components, prior", model: model(frames, options) });
        return methods;
    }
    let faces = model(frames, AcquisitionOptions { kind: ShapeKind::Faces, ..options });
    let bounded = |lowest: f64, highest: f64| faces.clone().with_bases(Bases::Faces { lowest, highest });
    methods.splice(
        0..0,
        [
            Method { name: "80 faces, any weights", model: bounded(f64::NEG_INFINITY, f64::INFINITY) },
            Method { name: "80 faces, weights from 0", model: bounded(0.0, f64::INFINITY) },
            Method { name: "80 faces, weights 0 to 1", model: faces },
        ],
    );
    let captured = AcquisitionOptions { unseen: 0.0, ..options };
    methods.push(Method { name: "80 components, prior, captured ways alone", model: model(frames, captured) });
    methods.push(Method { name: "80 components, prior", model: model(frames, options) });
    methods
}

/// What came of filling the hidden marks of one frame.
pub struct Filled {
    /// By hidden mark: the filled place less the true one, in the axes of the model [m].
    pub errors: Vec<Vector3<f64>>,
    /// Sum of the squared errors over what was stated; 3 for each mark where it is honest.
    pub squares: f64,
    pub out_of_distribution: f64,
    pub ms: f64,
}

/// Fits `fitter` to the marks of `frame` that are not `hidden`, and looks at those that are.
pub fn fill(fitter: &mut ShapeFitter, frame: &Frame, hidden: &[usize]) -> Option<Filled> {
    let covariance = Matrix3::from_diagonal_element(NOISE * NOISE);
    let seen = (0..frame.len()).filter(|it| !hidden.contains(it));
    let observations: Vec<MarkObservation> =
        seen.map(|it| MarkObservation::new(it as u32, frame[it], covariance)).collect();
    let start = Instant::now();
    let found = fitter.fit(&observations, &FitOptions::default()).ok()?;
    let ms = start.elapsed().as_secs_f64() * 1e3;
    let mut squares = 0.0;
    let errors = hidden
        .iter()
        .map(|&mark| {
            let filled = &found.marks[mark];
            let error = filled.position - found.measured_from_shape.inverse_transform_point(&frame[mark]);
            // The truth that it is held against is off by its own noise.
            squares += (filled.covariance + covariance).try_inverse().map_or(f64::NAN, |it| error.dot(&(it * error)));
            error
        })
        .collect();
    Some(Filled { errors, squares, out_of_distribution: found.out_of_distribution, ms })
}

/// Of lengths [m], in millimetres.
pub fn percentile_mm(lengths: &[f64], percent: f64) -> f64 {
    percentile(lengths, percent).unwrap_or(f64::NAN) * 1e3
}
