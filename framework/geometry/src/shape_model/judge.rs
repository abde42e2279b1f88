//! What a model does not know: found by trials on frames that it was not made from.

use foveate_estimation::Random;
use foveate_estimation::statistics::percentile;
use nalgebra::{DMatrix, Matrix3, Point3};

use super::acquire::{AcquisitionError, model_of};
use super::fit::{FitOptions, MarkObservation, ShapeFitter};
use super::{AcquisitionOptions, ShapeModel, Usual};

/// Stretches of frames that are left out in turn.
const STRETCHES: usize = 8;
/// Frames tried in all.
const TRIALS: usize = 160;
/// Marks hidden in a trial: as many of them as the paper hid, 11 of 69.
const HIDDEN: f64 = 0.16;
/// Trials that a guess from all marks is worth beside those of one mark.
const GUESS: f64 = 3.0;
/// Percentile of what is usual.
const USUAL: f64 = 99.0;

/// Sets what `model`, made of the frames in `table`, does not know of hidden marks, and what is usual. Too few frames to part: it stays as it is.
pub(super) fn judge(
    model: &mut ShapeModel,
    table: &DMatrix<f64>,
    aligned: &[Vec<Option<Point3<f64>>>],
    options: &AcquisitionOptions,
) -> Result<(), AcquisitionError> {
    let (n, n_frames) = (model.labels.len(), table.ncols());
    if n_frames < 2 * STRETCHES || n < 6 {
        return Ok(());
    }
    // What a mark was seen to be off by has the noise of seeing in it, which is no fault of the model.
    let noise = Matrix3::from_diagonal_element(options.noise * options.noise);
    let mut random = Random::new(options.seed).fork("hidden marks");
    let (mut squares, mut counts) = (vec![Matrix3::<f64>::zeros(); n], vec![0_usize; n]);
    let (mut misfits, mut strains) = (Vec::new(), Vec::new());
    for stretch in 0..STRETCHES {
        let [from, to] = [stretch, stretch + 1].map(|it| it * n_frames / STRETCHES);
        let others: Vec<usize> = (0..n_frames).filter(|it| !(from..to).contains(it)).collect();
        let mut part = model_of(&model.labels, &table.select_columns(&others), &model.spreads, options)?;
        // As long as nothing is known to be usual, no covariance is made larger for being unusual.
        part.usual = Usual { misfit: f64::INFINITY, strain: f64::INFINITY };
        let floor = part.unexplained.clone();
        let mut fitter = ShapeFitter::new(part);
        let n_trials = (TRIALS / STRETCHES).min(to - from);
        for trial in 0..n_trials {
            let frame = &aligned[from + trial * (to - from) / n_trials];
            let mut order: Vec<usize> = (0..n).filter(|it| frame[*it].is_some()).collect();
            for place in (1..order.len()).rev() {
                order.swap(place, random.below(place as u32 + 1) as usize);
            }
            let (hidden, seen) = order.split_at((HIDDEN * order.len() as f64).ceil() as usize);
            let observation = |&mark: &usize| Some(MarkObservation::new(model.labels[mark], frame[mark]?, noise));
            let observations: Vec<MarkObservation> = seen.iter().filter_map(observation).collect();
            let options = FitOptions { gate_sigmas: f64::INFINITY, ..FitOptions::default() };
            let Ok(fitted) = fitter.fit(&observations, &options) else { continue };
            misfits.push(fitted.misfit);
            strains.push(fitted.strain);
            for &mark in hidden {
                let Some(truth) = frame[mark] else { continue };
                let off = fitted.measured_from_shape.inverse_transform_point(&truth) - fitted.marks[mark].position;
                // What was open is in the covariance already, with what was left unexplained beside it.
                let open = fitted.covariance_of_open(mark, floor[mark]);
                squares[mark] += off * off.transpose() - open;
                counts[mark] += 1;
            }
        }
    }
    let least = options.least_unexplained();
    let total: f64 = squares.iter().zip(&counts).map(|(it, count)| (it - noise * *count as f64).trace() / 3.0).sum();
    let movement: f64 = model.spreads.iter().zip(&counts).map(|(it, count)| it * it * *count as f64).sum();
    let share = if movement > 0.0 { (total / movement).max(0.0) } else { 0.0 };
    for (mark, hidden) in model.hidden.iter_mut().enumerate() {
        let guess = Matrix3::from_diagonal_element(share * model.spreads[mark].powi(2));
        let count = counts[mark] as f64;
        let mean = (squares[mark] - noise * count + guess * GUESS) / (count + GUESS);
        *hidden = at_least(&mean, least);
    }
    let usual = |values: &[f64]| percentile(values, USUAL).unwrap_or(1.0).max(f64::MIN_POSITIVE);
    model.usual = Usual { misfit: usual(&misfits), strain: usual(&strains) };
    Ok(())
}

/// `covariance` with no variance below `least` in any direction.
fn at_least(covariance: &Matrix3<f64>, least: f64) -> Matrix3<f64> {
    let eigen = covariance.symmetric_eigen();
    let values = eigen.eigenvalues.map(|it| it.max(least));
    let raised = eigen.eigenvectors * Matrix3::from_diagonal(&values) * eigen.eigenvectors.transpose();
    (raised + raised.transpose()) / 2.0
}
