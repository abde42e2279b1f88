//! Phase steps that lack: three of them make a wave, and where four and more are there the others follow from these, pixel by pixel, by least squares.

use nalgebra::{DMatrix, Matrix3, Matrix3xX, MatrixXx3, Vector3};

use super::phase::SATURATED;

/// So many steps have to be there for others to be worked out: three make a wave, and the fourth says whether it is one.
pub(super) const LEAST_STEPS: usize = 4;

/// The steps `there` of `n` as rows 1, cos, sin of the wave that they are samples of.
fn rows(there: &[usize], n: usize) -> MatrixXx3<f64> {
    MatrixXx3::from_fn(there.len(), |row, column| {
        let turn = std::f64::consts::TAU * there[row] as f64 / n as f64;
        [1.0, turn.cos(), turn.sin()][column]
    })
}

/// The wave by the steps that are there: (AᵀA)⁻¹Aᵀ.
fn wave_by(rows: &MatrixXx3<f64>) -> Option<Matrix3xX<f64>> {
    let normal: Matrix3<f64> = rows.transpose() * rows;
    Some(normal.try_inverse()? * rows.transpose())
}

/// Step `lacking` of `n` by those at `there`, whose pixels are `steps`; saturated where one of these is.
pub(super) fn worked_out(steps: &[&[u8]], there: &[usize], lacking: usize, n: usize) -> Option<Vec<u8>> {
    let turn = std::f64::consts::TAU * lacking as f64 / n as f64;
    let weights = wave_by(&rows(there, n))?.transpose() * Vector3::new(1.0, turn.cos(), turn.sin());
    let pixel = |at: usize| {
        let mut sum = 0.0;
        for (step, weight) in steps.iter().zip(&weights) {
            if step[at] >= SATURATED {
                return u8::MAX;
            }
            sum += weight * f64::from(step[at]);
        }
        // What would be saturated is no gray level either.
        sum.round().clamp(0.0, 255.0) as u8
    };
    Some((0..steps.first()?.len()).map(pixel).collect())
}

/// Which of `n` steps lacks, of which all others are `steps` in their order, and `next` is the picture behind them: the gap that leaves least beside the wave, over some `pixels`. `None` where no gap leaves much less
/// than the others, or `next` is on the wave as well. The first and the last one are alike, for a wave may begin anywhere: then the last.
pub(super) fn gap(steps: &[&[u8]], next: Option<&[u8]>, n: usize, pixels: &[usize]) -> Option<usize> {
    if steps.len() < LEAST_STEPS || steps.len() + 1 != n {
        return None;
    }
    let all: Vec<&[u8]> = steps.iter().copied().chain(next).collect();
    let mut common = DMatrix::<f64>::zeros(all.len(), all.len());
    for at in pixels.iter().filter(|at| steps.iter().all(|it| it[**at] < SATURATED)) {
        for a in 0..all.len() {
            for b in 0..all.len() {
                common[(a, b)] += f64::from(all[a][*at]) * f64::from(all[b][*at]);
            }
        }
    }
    let beside = |there: &[usize]| {
        let rows = rows(there, n);
        let common = common.view((0, 0), (there.len(), there.len()));
        Some(common.trace() - (&rows * wave_by(&rows)? * common).trace())
    };
    let left: Vec<f64> =
        (0..n).map(|gap| beside(&(0..n).filter(|it| *it != gap).collect::<Vec<_>>())).collect::<Option<_>>()?;
    // All of them but the first, which is like the last.
    let best = (1..n).min_by(|a, b| left[*a].total_cmp(&left[*b]))?;
    let second = (1..n).filter(|it| *it != best).map(|it| left[it]).fold(f64::INFINITY, f64::min);
    let with_next = match next {
        Some(_) => beside(&(0..n).collect::<Vec<_>>())?,
        None => f64::INFINITY,
    };
    (left[best] < MUCH_LESS * second.min(with_next)).then_some(best)
}

/// The gap that is meant leaves this part of what any other one does, and of what is left with the picture behind, at most [–].
const MUCH_LESS: f64 = 0.5;
