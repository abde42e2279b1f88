//! Missing phase steps, and two that are swapped, inferred from the wave of the others. Three make a wave, and where four and more are there the others follow from these, pixel by pixel, by least squares.

use nalgebra::{Matrix2, Matrix3, Matrix3xX, MatrixXx3, Vector3};

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

/// Pixels that tell the form of waves.
const FORM_PIXELS: usize = 4000;
/// Turns in which the form of waves and the waves themselves are found from each other, and of one wave with a form that is known: each leaves about a fifth of what is wrong.
const FORM_ROUNDS: usize = 8;
const WAVE_ROUNDS: usize = 5;

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

/// Steps of which some lack, as samples of waves that need be no sines: the wave of a pixel is mean + height · (cos φ + Σ weight · cos(order · φ)), with weights that all pixels share.
struct Steps {
    /// By step that is there: its turn [rad].
    turns: Vec<f64>,
    /// From levels to mean, cosine and sine by least squares.
    wave_by: Matrix3xX<f64>,
    /// Of harmonics 2 and on, over the first [–].
    weights: Vec<f64>,
}

impl Steps {
    fn new(there: &[usize], n: usize) -> Option<Steps> {
        let turns = there.iter().map(|it| std::f64::consts::TAU * *it as f64 / n as f64).collect();
        Some(Steps { turns, wave_by: wave_by(&rows(there, n))?, weights: Vec::new() })
    }

    /// With the harmonics that the levels of pixels, one row each, have in common: as many as their steps tell.
    fn with_form(mut self, levels: &[Vec<f64>]) -> Steps {
        // Of steps that are there all, those up to half of their number are told; each that lacks takes a little of it.
        let n_orders = (self.turns.len() / 2).saturating_sub(1);
        self.weights = vec![0.0; n_orders];
        for _ in 0..FORM_ROUNDS {
            let (mut products, mut squares) = (vec![0.0; n_orders], vec![0.0; n_orders]);
            for row in levels {
                let wave = self.wave(row);
                let (phase, height) = (wave.z.atan2(wave.y), wave.y.hypot(wave.z));
                for (level, turn) in row.iter().zip(&self.turns) {
                    let off = level - self.level(&wave, *turn);
                    for (at, (product, square)) in products.iter_mut().zip(&mut squares).enumerate() {
                        let form = height * ((at + 2) as f64 * (phase - turn)).cos();
                        (*product, *square) = (*product + form * off, *square + form * form);
                    }
                }
            }
            let more = products.iter().zip(&squares).map(|it| it.0 / it.1.max(1e-9));
            self.weights.iter_mut().zip(more).for_each(|(weight, more)| *weight += more);
        }
        self
    }

    /// Mean, cosine and sine of the wave of a pixel.
    fn wave(&self, levels: &[f64]) -> Vector3<f64> {
        let mut wave = self.wave_of(levels.iter().copied());
        if self.weights.iter().any(|it| *it != 0.0) {
            for _ in 0..WAVE_ROUNDS {
                let (phase, height) = (wave.z.atan2(wave.y), wave.y.hypot(wave.z));
                let sines =
                    levels.iter().zip(&self.turns).map(|(level, turn)| level - height * self.form(phase - turn));
                wave = self.wave_of(sines);
            }
        }
        wave
    }

    fn wave_of(&self, levels: impl Iterator<Item = f64>) -> Vector3<f64> {
        self.wave_by.column_iter().zip(levels).fold(Vector3::zeros(), |sum, (column, level)| sum + column * level)
    }

    /// What harmonics add to a cosine at a phase, over its height.
    fn form(&self, phase: f64) -> f64 {
        self.weights.iter().zip(2..).map(|(weight, order)| weight * (f64::from(order) * phase).cos()).sum()
    }

    /// The level of a wave at a turn.
    fn level(&self, wave: &Vector3<f64>, turn: f64) -> f64 {
        let height = wave.y.hypot(wave.z);
        wave.x + wave.y * turn.cos() + wave.z * turn.sin() + height * self.form(wave.z.atan2(wave.y) - turn)
    }

    /// What pixels have beside their waves, squared and summed up.
    fn beside(&self, levels: &[Vec<f64>]) -> f64 {
        let one = |row: &Vec<f64>| {
            let wave = self.wave(row);
            row.iter().zip(&self.turns).map(|(level, turn)| (level - self.level(&wave, *turn)).powi(2)).sum::<f64>()
        };
        levels.iter().map(one).sum()
    }
}

/// Levels of some pixels in pictures, those left out in which one of the first `n_whole` is saturated.
fn levels_of(pictures: &[&[u8]], n_whole: usize, pixels: impl Iterator<Item = usize>) -> Vec<Vec<f64>> {
    let is_whole = |at: &usize| pictures[..n_whole].iter().all(|it| it[*at] < SATURATED);
    pixels.filter(is_whole).map(|at| pictures.iter().map(|it| f64::from(it[at])).collect()).collect()
}

/// Step `lacking` of `n` by those at `there`, whose pixels are `steps`; saturated where one of these is.
pub(super) fn worked_out(steps: &[&[u8]], there: &[usize], lacking: usize, n: usize) -> Option<Vec<u8>> {
    let turn = std::f64::consts::TAU * lacking as f64 / n as f64;
    let n_pixels = steps.first()?.len();
    let some = levels_of(steps, steps.len(), (0..n_pixels).step_by(n_pixels.div_ceil(FORM_PIXELS).max(1)));
    let waves = Steps::new(there, n)?.with_form(&some);
    let mut levels = vec![0.0; steps.len()];
    let pixel = |at: usize| {
        for (level, step) in levels.iter_mut().zip(steps) {
            if step[at] >= SATURATED {
                return u8::MAX;
            }
            *level = f64::from(step[at]);
        }
        // What would be saturated is no gray level either.
        waves.level(&waves.wave(&levels), turn).round().clamp(0.0, 255.0) as u8
    };
    Some((0..n_pixels).map(pixel).collect())
}

/// Covariance of cosine and sine of the wave of `n` steps of which those are `there`, for levels of variance 1: 2 / n of each where all are.
pub(super) fn covariance(there: &[usize], n: usize) -> Option<Matrix2<f64>> {
    let rows = rows(there, n);
    let all: Matrix3<f64> = rows.transpose() * &rows;
    Some(all.try_inverse()?.fixed_view::<2, 2>(1, 1).into_owned())
}

/// Which of `n` steps lacks, of which all others are `steps` in their order, and `next` is the picture behind them: the gap that leaves least beside the wave, over some `pixels`. `None` where no gap leaves much less
/// than the others, or `next` is on the wave as well. The first and the last one are alike, for a wave may begin anywhere: then the last.
pub(super) fn gap(steps: &[&[u8]], next: Option<&[u8]>, n: usize, pixels: &[usize]) -> Option<usize> {
    if steps.len() < LEAST_STEPS || steps.len() + 1 != n {
        return None;
    }
    let all: Vec<&[u8]> = steps.iter().copied().chain(next).collect();
    let some = pixels.iter().copied().step_by(pixels.len().div_ceil(FORM_PIXELS).max(1));
    let levels = levels_of(&all, steps.len(), some);
    // Waves are no sines where nobody measured the projector.
    let beside = |there: &[usize]| {
        let rows: Vec<Vec<f64>> = levels.iter().map(|it| it[..there.len()].to_vec()).collect();
        Some(Steps::new(there, n)?.with_form(&rows).beside(&rows))
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
