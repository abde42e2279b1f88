//! Phase steps that lack, and two that are exchanged: what the others have of a wave tells them. Three make a wave, and where four and more are there the others follow from these, pixel by pixel, by least squares.

use nalgebra::{DMatrix, Matrix3, Matrix3xX, MatrixXx3, Vector3};

use super::gray::NONE;
use super::phase::{LEAST, MOST, SATURATED};

/// So many steps have to be there for others to be worked out: three make a wave, and the fourth says whether it is one.
pub(super) const LEAST_STEPS: usize = 4;

/// Steps in their order leave less beside the wave than this part of what they have at all, and two that are exchanged leave this part of what is left as they stand [–].
const LEAST_BESIDE: f64 = 0.01;
const EXCHANGED: f64 = 0.5;

/// Pixels that tell of a step of the columns in the place of one of the rows, at most and at least.
const ACROSS: usize = 4000;
const LEAST_ACROSS: usize = 300;

/// The gap that is meant leaves this part of what any other one does, and of what is left with the picture behind, at most [–].
const MUCH_LESS: f64 = 0.5;

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

/// Pairs of steps that leave much less beside the wave when they are exchanged, the best first.
pub(super) fn exchanged(steps: &[&[u8]], stripes: &[u16]) -> Vec<[usize; 2]> {
    let n = steps.len();
    let known: Vec<usize> = (0..stripes.len()).filter(|it| stripes[*it] != NONE).collect();
    let some = known.iter().step_by(known.len().div_ceil(MOST).max(1));
    // What steps have in common over all pixels, each pixel's mean taken off.
    let mut common = vec![0.0; n * n];
    let mut off = vec![0.0; n];
    let mut n_seen = 0;
    for at in some.filter(|at| steps.iter().all(|it| it[**at] < SATURATED)) {
        let mean = steps.iter().map(|it| f64::from(it[*at])).sum::<f64>() / n as f64;
        off.iter_mut().zip(steps).for_each(|(off, step)| *off = f64::from(step[*at]) - mean);
        for (row, a) in off.iter().enumerate() {
            for (column, b) in off.iter().enumerate() {
                common[row * n + column] += a * b;
            }
        }
        n_seen += 1;
    }
    if n < 4 || n_seen < LEAST {
        return Vec::new();
    }
    let energy: f64 = (0..n).map(|it| common[it * n + it]).sum();
    let beside = |place: &dyn Fn(usize) -> usize| {
        let turn = |step: usize| std::f64::consts::TAU * place(step) as f64 / n as f64;
        let on: f64 = (0..n * n).map(|at| common[at] * (turn(at / n) - turn(at % n)).cos()).sum();
        energy - 2.0 / n as f64 * on
    };
    let stated = beside(&|step| step);
    if stated < LEAST_BESIDE * energy {
        return Vec::new();
    }
    let pairs = (0..n).flat_map(|b| (0..b).map(move |a| [a, b]));
    let mut found: Vec<(f64, [usize; 2])> = pairs
        .map(|[a, b]| {
            let place = |step: usize| {
                if step == a {
                    b
                } else if step == b {
                    a
                } else {
                    step
                }
            };
            (beside(&place), [a, b])
        })
        .filter(|it| it.0 < EXCHANGED * stated)
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.into_iter().map(|it| it.1).collect()
}

/// A step of the columns and a step of the rows that stand in each other's places: exchanges that leave much less beside the waves of both axes, and beside the mean that white and black say they have, than the steps as they
/// stand. Three steps are on a wave whatever they are, and the mean alone tells it. Of four, two that are half a period apart make a wave of another phase when they are exchanged both: then there are two exchanges.
pub(super) fn exchanged_across(steps: [&[&[u8]]; 2], [white, black]: [&[u8]; 2], pixels: &[usize]) -> Vec<[usize; 2]> {
    let n = steps[0].len();
    if steps[1].len() != n || n < 3 {
        return Vec::new();
    }
    let is_whole =
        |at: &&usize| white[**at] < SATURATED && steps.iter().copied().flatten().all(|it| it[**at] < SATURATED);
    let some: Vec<usize> =
        pixels.iter().step_by(pixels.len().div_ceil(ACROSS).max(1)).filter(is_whole).copied().collect();
    if some.len() < LEAST_ACROSS {
        return Vec::new();
    }
    let count = n as f64;
    let level = |axis: usize, step: usize, at: usize| f64::from(steps[axis][step][at]);
    let mean = |axis: usize, at: usize| (0..n).map(|it| level(axis, it, at)).sum::<f64>() / count;
    // A wave's mean is the same part of white − black everywhere, whatever the projector makes of a sine.
    let contrast = |at: usize| f64::from(white[at]) - f64::from(black[at]);
    let part = |axis: usize, at: usize| (mean(axis, at) - f64::from(black[at])) / contrast(at).max(1.0);
    let mut parts: Vec<f64> = some.iter().flat_map(|at| [part(0, *at), part(1, *at)]).collect();
    parts.sort_by(f64::total_cmp);
    let part = parts[parts.len() / 2];
    let turns: Vec<[f64; 2]> =
        (0..n).map(|it| (std::f64::consts::TAU * it as f64 / count).sin_cos()).map(|(s, c)| [c, s]).collect();
    let (mut stated, mut energy) = (0.0, 0.0);
    // What is beside the waves of both axes with the steps exchanged, less what is there as they stand.
    let mut less = vec![0.0; n * n];
    for at in some {
        let sides = [0, 1].map(|axis| {
            let mean = mean(axis, at);
            let [mut cosine, mut sine] = [0.0; 2];
            for (step, [c, s]) in turns.iter().enumerate() {
                let off = level(axis, step, at) - mean;
                (cosine, sine) = (cosine + 2.0 / count * off * c, sine + 2.0 / count * off * s);
                energy += off * off;
            }
            let beside = |step: usize| {
                let [c, s] = turns[step];
                level(axis, step, at) - mean - cosine * c - sine * s
            };
            let beside: Vec<f64> = (0..n).map(beside).collect();
            let of_mean = mean - f64::from(black[at]) - part * contrast(at);
            stated += beside.iter().map(|it| it * it).sum::<f64>() + count * of_mean * of_mean;
            (beside, of_mean)
        });
        for (pair, less) in less.iter_mut().enumerate() {
            let pair = [pair / n, pair % n];
            let by = level(1, pair[1], at) - level(0, pair[0], at);
            for ((beside, of_mean), (step, by)) in sides.iter().zip(pair.into_iter().zip([by, -by])) {
                // One step that is another by so much, of n, on which three numbers are fitted.
                *less += 2.0 * by * (beside[step] + of_mean) + by * by * (1.0 - 2.0 / count);
            }
        }
    }
    if stated < LEAST_BESIDE * energy {
        return Vec::new();
    }
    let told = less.into_iter().zip(0..).filter(|it| stated + it.0 < EXCHANGED * stated);
    told.map(|(_, pair)| [pair / n, pair % n]).collect()
}
