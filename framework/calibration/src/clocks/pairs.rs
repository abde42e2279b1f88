//! Clock offset of two cameras from two tracks of one light: poses unknown, and of the lenses only distortion known.
//!
//! At the right offset, pairs of pixels fulfil bᵀ F a = 0 with one matrix F. Every offset in the window is tried with the linear
//! solution (eight-point algorithm): what remains is the least singular value. The lowest valleys are then descended into with a robust
//! fit, reweighted from Sampson's distance in each round, and judged by how many pairs fit within the noise. Source: R. Hartley and A.
//! Zisserman, *Multiple View Geometry*, 2nd ed. 2004, §11.2 and §11.4.3.
//!
//! A light that stays tells nothing about time, so moments are taken at steps of the path, not of the clock.

use foveate_geometry::Camera;
use nalgebra::{Matrix3, Point2, SMatrix, SVector, Vector3};

use super::frames::Clock;
use super::track::Track;

/// What to try.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PairOptions {
    pub max_offset_s: f64,
    pub max_drift: f64,
    pub max_gap_s: f64,
    pub inlier_px: f64,
    pub sigma_px: f64,
    pub min_moments: usize,
    pub min_distinction: f64,
}

/// The clock of camera b against that of camera a.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PairClock {
    /// What a's clock shows as a function of b's: a = offset + rate · b.
    pub a_from_b: Clock,
    /// Middle of what both saw, by b's clock [s].
    pub middle_s: f64,
    /// Offsets closer together than this cannot be separated before all cameras are adjusted together [s].
    pub tolerance_s: f64,
    /// Moments that fit, each counted by how well.
    pub support: f64,
    /// Of how many.
    pub moments: usize,
}

/// Why two tracks do not determine the offset of their clocks.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PairError {
    /// One of the two sees too little of a path.
    #[error("{moments} moments of a moving light, expected at least {needed}")]
    TooFew {
        /// At steps of the path.
        moments: usize,
        /// Number that is needed.
        needed: usize,
    },
    /// At no offset do both see the light often enough.
    #[error("at no offset within the window do both see the light at more than {best} moments, expected {needed}")]
    NoOverlap {
        /// The most.
        best: usize,
        /// What is needed.
        needed: usize,
    },
    /// At no offset do the pixels fit one light.
    #[error("at the best offset {right} of {moments} moments fit")]
    Inconsistent {
        /// That fit.
        right: usize,
        /// That both see.
        moments: usize,
    },
    /// Neighbouring offsets fit as well: a light that hardly moves, or moves evenly on a circle or a line.
    #[error("offsets {tolerance_s:.3} s apart fit equally well")]
    Flat {
        /// How far apart [s].
        tolerance_s: f64,
    },
    /// Two offsets fit: a motion that repeats itself.
    #[error("two offsets fit: {first_s:.3} s and {second_s:.3} s; does the light repeat its path?")]
    Ambiguous {
        /// The better one [s].
        first_s: f64,
        /// The second one [s].
        second_s: f64,
    },
}

/// A light that moves less than this part of the spread of its pixels is where it was.
const STEP_OF_PATH: f64 = 0.04;
const MAX_MOMENTS: usize = 300;
/// Moments move this many inlier distances in the time within which offsets count as one.
const TOLERANCE: f64 = 8.0;
/// Valleys that are descended into at most, and how much higher than the lowest they may begin.
const CANDIDATES: usize = 8;
const HIGHEST: f64 = 3.0;
/// Part of the moments that must fit at the best offset.
const MIN_SHARE: f64 = 0.4;
/// Offsets are refined to this part of the time in which the light moves by the inlier distance.
const FINEST: f64 = 0.05;

/// One camera's track in pixels of a camera without distortion.
pub(super) struct Straight {
    pub track: Track,
    /// Takes pixels to about 0 ± 1.
    scale: Matrix3<f64>,
    /// Root of the mean squared distance of the pixels from their centre [px].
    pub spread_px: f64,
    /// At steps of the path.
    moments: Vec<(f64, Point2<f64>)>,
    /// Median speed between moments [px/s].
    pub speed: f64,
}

impl Straight {
    pub(super) fn new(smooth: &Track, camera: &Camera) -> Straight {
        let focal = 0.5 * (camera.intrinsics.focal[0] + camera.intrinsics.focal[1]);
        let track = smooth.mapped(|it| Some(Point2::from(camera.normalise(it)? * focal)));
        let n = track.samples.len().max(1) as f64;
        let centre = track.samples.iter().fold(nalgebra::Vector2::zeros(), |sum, it| sum + it.pixel.coords / n);
        let squares: f64 = track.samples.iter().map(|it| (it.pixel.coords - centre).norm_squared() / n).sum();
        let spread_px = squares.sqrt();
        let per = 1.0 / spread_px.max(1e-9);
        let scale = Matrix3::new(per, 0.0, -per * centre.x, 0.0, per, -per * centre.y, 0.0, 0.0, 1.0);
        let mut moments: Vec<(f64, Point2<f64>)> = Vec::new();
        let mut speeds = Vec::new();
        for sample in &track.samples {
            let moved = moments.last().map(|it| (it.0, (it.1 - sample.pixel).norm()));
            if moved.is_none_or(|(_, far)| far >= STEP_OF_PATH * spread_px) {
                speeds.extend(moved.map(|(time, far)| far / (sample.time_s - time)));
                moments.push((sample.time_s, sample.pixel));
            }
        }
        speeds.sort_by(f64::total_cmp);
        let speed = speeds.get(speeds.len() / 2).copied().unwrap_or(0.0);
        if moments.len() > MAX_MOMENTS {
            moments = (0..MAX_MOMENTS).map(|it| moments[it * moments.len() / MAX_MOMENTS]).collect();
        }
        Straight { track, scale, spread_px, moments, speed }
    }

    pub(super) fn n_moments(&self) -> usize {
        self.moments.len()
    }
}

/// Compares two cameras at all offsets in the window.
pub(super) fn compare(a: &Straight, b: &Straight, options: &PairOptions) -> Result<PairClock, PairError> {
    // The one with more moments is looked up at those of the other.
    let swapped = b.n_moments() > a.n_moments();
    let (few, many) = if swapped { (a, b) } else { (b, a) };
    let moments = few.n_moments();
    if moments < options.min_moments {
        return Err(PairError::TooFew { moments, needed: options.min_moments });
    }
    let found = Pair::new(few, many, options).search()?;
    if !swapped {
        return Ok(found);
    }
    let Clock { offset_s, rate } = found.a_from_b;
    let a_from_b = Clock { offset_s: -offset_s / rate, rate: 1.0 / rate };
    Ok(PairClock { a_from_b, middle_s: found.a_from_b.room_s(found.middle_s), ..found })
}

/// Two tracks under comparison: time in `many` = time in `few` + offset + drift · (time in `few` − middle).
struct Pair<'a> {
    few: &'a Straight,
    many: &'a Straight,
    options: &'a PairOptions,
    /// In which the light moves by the inlier distance [s].
    fine_s: f64,
    middle_s: f64,
    half_span_s: f64,
}

/// Pairs of scaled pixels.
type Pairs = Vec<(Vector3<f64>, Vector3<f64>)>;

#[derive(Debug, Clone, Copy)]
struct Trial {
    offset_s: f64,
    drift: f64,
    cost: f64,
}

impl<'a> Pair<'a> {
    fn new(few: &'a Straight, many: &'a Straight, options: &'a PairOptions) -> Pair<'a> {
        let [start, end] = few.track.span_s().unwrap_or([0.0; 2]);
        let fine_s = options.inlier_px / few.speed.max(many.speed).max(1e-9);
        Pair { few, many, options, fine_s, middle_s: 0.5 * (start + end), half_span_s: 0.5 * (end - start).max(1e-3) }
    }

    fn search(&self) -> Result<PairClock, PairError> {
        let (starts, step_s) = self.valleys()?;
        let mut best: Vec<(f64, usize, Trial)> = Vec::new();
        for offset_s in starts {
            let trial = self.descend(Trial { offset_s, drift: 0.0, cost: f64::INFINITY }, step_s);
            if trial.offset_s.abs() <= self.options.max_offset_s + step_s {
                let (support, moments) = self.support(trial.offset_s, trial.drift);
                best.push((support, moments, trial));
            }
        }
        best.sort_by(|x, y| y.0.total_cmp(&x.0));
        let needed = self.options.min_moments;
        let Some(&(support, moments, first)) = best.first() else {
            return Err(PairError::NoOverlap { best: 0, needed });
        };
        if support < MIN_SHARE * moments as f64 || support < 0.5 * needed as f64 {
            return Err(PairError::Inconsistent { right: support as usize, moments });
        }
        let tolerance_s = TOLERANCE * self.fine_s;
        // Offsets that the first one shades off into are judged by what lies one tolerance away.
        let beside = [-1.0, 1.0].map(|side| self.support(first.offset_s + side * tolerance_s, first.drift));
        let rival =
            |(other, of): (f64, usize)| other * moments as f64 / (of.max(1) as f64) * self.options.min_distinction;
        if beside.into_iter().any(|it| it.1 >= needed && rival(it) > support) {
            return Err(PairError::Flat { tolerance_s });
        }
        let elsewhere = best.iter().find(|it| (it.2.offset_s - first.offset_s).abs() > tolerance_s);
        if let Some(&(other, _, second)) = elsewhere
            && other * self.options.min_distinction > support
        {
            return Err(PairError::Ambiguous { first_s: first.offset_s, second_s: second.offset_s });
        }
        let rate = 1.0 + first.drift;
        let a_from_b = Clock { offset_s: first.offset_s - first.drift * self.middle_s, rate };
        Ok(PairClock { a_from_b, middle_s: self.middle_s, tolerance_s, support, moments })
    }

    /// The offsets at which one linear solution explains most, the best first, and the step between offsets tried.
    fn valleys(&self) -> Result<(Vec<f64>, f64), PairError> {
        let part = |it: &Straight| 0.1 * it.spread_px / it.speed.max(1e-9);
        let window = self.options.max_offset_s;
        let step_s = part(self.few).min(part(self.many)).clamp(1e-3, (0.25 * window).max(1e-3));
        let grid_s = 0.5 * step_s;
        let [start, end] = self.many.track.span_s().unwrap_or([0.0; 2]);
        let n_grid = ((end - start) / grid_s) as usize + 1;
        let on_grid: Vec<Option<Vector3<f64>>> = (0..n_grid)
            .map(|it| {
                let found = self.many.track.at(start + it as f64 * grid_s, self.options.max_gap_s)?;
                Some(self.many.scale * found.pixel.to_homogeneous())
            })
            .collect();
        let in_few: Vec<(f64, Vector3<f64>)> =
            self.few.moments.iter().map(|it| (it.0, self.few.scale * it.1.to_homogeneous())).collect();
        let n_steps = (window / step_s).ceil() as i64;
        let mut remaining: Vec<(f64, f64)> = Vec::new();
        let mut most = 0;
        for step in -n_steps..=n_steps {
            let offset_s = step as f64 * step_s;
            let at = |time: f64| {
                let place = (time + offset_s - start) / grid_s + 0.5;
                (place >= 0.0).then(|| on_grid.get(place as usize).copied().flatten()).flatten()
            };
            let pairs: Pairs = in_few.iter().filter_map(|(time, own)| Some((*own, at(*time)?))).collect();
            most = most.max(pairs.len());
            let left = if pairs.len() < self.options.min_moments {
                f64::INFINITY
            } else {
                let (_, least) = eight_points(&pairs, |_| 1.0);
                // Eight of the pairs fit anything.
                (least / (pairs.len() as f64 - 8.0).max(1.0)).sqrt()
            };
            remaining.push((offset_s, left));
        }
        if most < self.options.min_moments {
            return Err(PairError::NoOverlap { best: most, needed: self.options.min_moments });
        }
        let left = |it: usize| remaining.get(it).map_or(f64::INFINITY, |it| it.1);
        let mut valleys: Vec<(f64, f64)> = (0..remaining.len())
            .filter(|&it| {
                let own = left(it);
                own.is_finite() && own <= left(it + 1) && it.checked_sub(1).is_none_or(|before| own < left(before))
            })
            .map(|it| remaining[it])
            .collect();
        valleys.sort_by(|x, y| x.1.total_cmp(&y.1));
        let highest = HIGHEST * valleys.first().map_or(0.0, |it| it.1);
        valleys.retain(|it| it.1 <= highest);
        Ok((valleys.into_iter().take(CANDIDATES).map(|it| it.0).collect(), step_s))
    }

    fn pairs(&self, offset_s: f64, drift: f64) -> Pairs {
        let of = |&(time, own): &(f64, Point2<f64>)| {
            let there = time + offset_s + drift * (time - self.middle_s);
            let other = self.many.track.at(there, self.options.max_gap_s)?;
            Some((self.few.scale * own.to_homogeneous(), self.many.scale * other.pixel.to_homogeneous()))
        };
        self.few.moments.iter().filter_map(of).collect()
    }

    /// Downhill from `start` with steps that are halved where neither side is lower.
    fn descend(&self, start: Trial, step_s: f64) -> Trial {
        let finest = FINEST * self.fine_s;
        let mut step_s = 0.5 * step_s;
        let mut here = start;
        while step_s > finest {
            // As far off as steps are long, pairs may miss by what the light moves meanwhile.
            let scale_px = self.options.inlier_px * (step_s / self.fine_s).clamp(0.5, 30.0);
            here.cost = self.cost(here.offset_s, here.drift, scale_px);
            for _ in 0..6 {
                let mut moves = vec![(step_s, 0.0), (-step_s, 0.0)];
                let turn = step_s / self.half_span_s;
                if self.options.max_drift > 0.0 && turn < self.options.max_drift {
                    moves.extend([(0.0, turn), (0.0, -turn)]);
                }
                let trials = moves.into_iter().map(|(shift, turn)| {
                    let (offset_s, drift) = (here.offset_s + shift, here.drift + turn);
                    let allowed = drift.abs() <= self.options.max_drift;
                    let cost = if allowed { self.cost(offset_s, drift, scale_px) } else { f64::INFINITY };
                    Trial { offset_s, drift, cost }
                });
                let lowest = trials.min_by(|x, y| x.cost.total_cmp(&y.cost));
                match lowest.filter(|it| it.cost < here.cost) {
                    Some(lower) => here = lower,
                    None => break,
                }
            }
            step_s *= 0.5;
        }
        here
    }

    /// Mean of Cauchy's loss of the distances.
    fn cost(&self, offset_s: f64, drift: f64, scale_px: f64) -> f64 {
        let squared = self.distances(&self.pairs(offset_s, drift), scale_px);
        if squared.len() < self.options.min_moments {
            return f64::INFINITY;
        }
        squared.iter().map(|it| (1.0 + it / (scale_px * scale_px)).ln()).sum::<f64>() / squared.len() as f64
    }

    /// Σ max(0, 1 − (distance / inlier distance)²), and the number of moments.
    fn support(&self, offset_s: f64, drift: f64) -> (f64, usize) {
        let limit = self.options.inlier_px;
        let squared = self.distances(&self.pairs(offset_s, drift), limit);
        let support = squared.iter().map(|it| (1.0 - it / (limit * limit)).max(0.0)).sum();
        (support, squared.len())
    }

    /// Squared distances [px²] after a robust fit.
    fn distances(&self, pairs: &Pairs, scale_px: f64) -> Vec<f64> {
        if pairs.len() < 9 {
            return Vec::new();
        }
        // Distances in pixels of the camera in which the light spreads less.
        let px = self.few.spread_px.min(self.many.spread_px);
        let mut matrix = eight_points(pairs, |_| 1.0).0;
        let mut squared: Vec<f64> = Vec::new();
        for round in 0..5 {
            let by_slope: Vec<(f64, f64)> = pairs.iter().map(|it| sampson(&matrix, it)).collect();
            squared = by_slope.iter().map(|it| it.0 * px * px).collect();
            if round == 4 {
                break;
            }
            let mut sorted = squared.clone();
            let middle = sorted.len() / 2;
            let median = *sorted.select_nth_unstable_by(middle, f64::total_cmp).1;
            let scale = (scale_px * scale_px).max(if round < 2 { 2.0 * median } else { 0.0 });
            let scale = scale.max(self.options.sigma_px.powi(2));
            let weights: Vec<f64> = squared
                .iter()
                .zip(&by_slope)
                .map(|(it, slope)| 1.0 / ((1.0 + it / scale) * slope.1.max(1e-6)))
                .collect();
            matrix = eight_points(pairs, |it| weights[it]).0;
        }
        squared
    }
}

/// The matrix of unit length for which Σ w (bᵀ F a)² is least, and that sum.
fn eight_points(pairs: &Pairs, weight: impl Fn(usize) -> f64) -> (Matrix3<f64>, f64) {
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (index, (a, b)) in pairs.iter().enumerate() {
        let mut row = SVector::<f64, 9>::zeros();
        for (at, own) in [b.x, b.y, b.z].into_iter().enumerate() {
            row.fixed_rows_mut::<3>(3 * at).copy_from(&(a * own));
        }
        normal.ger(weight(index), &row, &row, 1.0);
    }
    // Inverse iteration: the least eigenvector of a matrix this small, without the others.
    let ridge = 1e-13 * normal.trace();
    let mut shifted = normal;
    (0..9).for_each(|it| shifted[(it, it)] += ridge);
    let Some(factor) = shifted.cholesky() else { return (Matrix3::zeros(), f64::INFINITY) };
    let mut vector = SVector::<f64, 9>::from_fn(|row, _| 1.0 + 0.1 * row as f64);
    for _ in 0..8 {
        vector = factor.solve(&vector);
        vector /= vector.norm();
    }
    (Matrix3::from_row_slice(vector.as_slice()), (normal * vector).dot(&vector))
}

/// Squared distance of a pair from the nearest that fulfils the constraint, and the squared slope by which it was had.
fn sampson(matrix: &Matrix3<f64>, (a, b): &(Vector3<f64>, Vector3<f64>)) -> (f64, f64) {
    let (in_b, in_a) = (matrix * a, matrix.tr_mul(b));
    let slope = in_b.xy().norm_squared() + in_a.xy().norm_squared();
    (b.dot(&in_b).powi(2) / slope.max(1e-300), slope)
}
