//! A plane that bends: a smooth field of shifts over a rectangle, as a penalised spline.
//!
//! Source: P. Eilers and B. Marx, "Flexible smoothing with B-splines and penalties", Statistical Science 11(2), 1996: cubic B-splines on even knots, differences of neighbouring
//! coefficients as the penalty. Its weight is estimated by restricted maximum likelihood (S. Wood, JRSS B 73(1), 2011,
//! with the noise's variance profiled out), so that the dots
//! themselves determine how rough the wall is. A penalised spline is the posterior mean of a random field: its
//! covariance grows where dots are few, and without limit beyond them.
//! Third derivatives are penalised, not second ones: an arc shifts by the square of the distance, and should cost
//! nothing, also where it continues beyond the outermost dots.
//!
//! | here | source | meaning | unit |
//! |---|---|---|---|
//! | `splines` | B | their values at the samples | – |
//! | `coefficients` | α | of the splines, one row each | m |
//! | `roughness` | Dᵀ D | ∫ u_xxx² + 3 u_xxy² + 3 u_xyy² + u_yyy², by differences | 1/m⁴ |
//! | `strength` | λ | its weight | m² |

use nalgebra::{Cholesky, DMatrix, Dyn, Matrix2, MatrixXx2, Point2, Vector2};

/// Cells along the longer side: a third of a metre on a wall of four, a quarter of the shortest swell of `sim.wall`. How smooth the field is, the penalty decides.
const CELLS: f64 = 12.0;
/// Fewest along the shorter one.
const LEAST_CELLS: usize = 3;
/// Rounds of weights, each by how well samples fitted before.
const ROUNDS: usize = 4;
/// A sample beyond this counts less [standard deviations].
const LOSS_SIGMAS: f64 = 3.0;
/// Median of the distance from the middle of a round normal distribution, in its standard deviations: √(2 ln 2).
const MEDIAN_DISTANCE: f64 = 1.177_41;
/// Weights of the penalty that are tried, decimal exponents relative to that at which data and penalty have the same trace.
const LEAST_STRENGTH: f64 = -7.0;
const MOST_STRENGTH: f64 = 7.0;
const STRENGTH_STEP: f64 = 0.5;
/// Noise is not taken for less than this part of what samples were said to have, along either axis: the rest is seen at a slant, and the field is not to bend for it.
const LEAST_VARIANCE: f64 = 0.25;
/// Shifts that no penalty holds: constant, linear, square.
const FREE: usize = 6;
/// Steps to where a shifted point came from; each has the square of the error of the one before it.
const STEPS: usize = 20;
/// That is near enough [m].
const NEAR: f64 = 1e-10;

/// A smooth field of shifts over a rectangle of a plane, whose corner is the origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// Width and height of the rectangle [m].
    pub size_m: [f64; 2],
    /// Cells along each axis.
    pub cells: [usize; 2],
    /// Coefficients of the splines, three more along each axis than cells, row by row [m].
    pub shifts_m: Vec<Vector2<f64>>,
    /// Standard deviation of the shift at the corners of the cells, row by row, along each axis [m].
    pub sigmas_m: Vec<Vector2<f64>>,
}

/// A place and how far it is shifted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shifted {
    pub(super) point: Point2<f64>,
    pub(super) shift: Vector2<f64>,
    /// Standard deviation of the shift, along each axis [m].
    pub(super) sigma: f64,
}

/// The splines that are not 0 at a place: number, value, derivative by the place [1/m].
type Splines = [(usize, f64, Vector2<f64>); 16];

impl Mesh {
    /// The number of cells for a rectangle, along each axis.
    pub fn cells_of(size_m: [f64; 2]) -> [usize; 2] {
        let longer = size_m[0].max(size_m[1]);
        size_m.map(|it| ((it / longer * CELLS).round() as usize).max(LEAST_CELLS))
    }

    /// Number of splines of a mesh with so many cells.
    pub fn n_splines(cells: [usize; 2]) -> usize {
        (cells[0] + 3) * (cells[1] + 3)
    }

    /// Number of corners of a mesh with so many cells.
    pub fn n_corners(cells: [usize; 2]) -> usize {
        (cells[0] + 1) * (cells[1] + 1)
    }

    /// The smoothest field that explains the samples as well as they are known; `None` where they fix none.
    pub(super) fn fit(size_m: [f64; 2], samples: &[Shifted]) -> Option<Mesh> {
        let cells = Mesh::cells_of(size_m);
        let n = Mesh::n_splines(cells);
        let mut mesh = Mesh { size_m, cells, shifts_m: vec![Vector2::zeros(); n], sigmas_m: Vec::new() };
        let splines: Vec<Splines> = samples.iter().map(|it| mesh.splines(&it.point)).collect();
        let roughness = roughness(size_m, cells);
        let mut weights = vec![1.0; samples.len()];
        let mut found = None;
        for _ in 0..ROUNDS {
            let posterior = Posterior::of(samples, &splines, &weights, &roughness)?;
            for (to, row) in mesh.shifts_m.iter_mut().zip(posterior.coefficients.row_iter()) {
                *to = row.transpose();
            }
            found = Some(posterior);
            let off = |it: &Shifted| (mesh.shift(&it.point).0 - it.shift).norm() / it.sigma;
            let offs: Vec<f64> = samples.iter().map(off).collect();
            // Never less than samples were said to be off: where a field goes through nearly all of them, the rest would weigh ever less, and be lost.
            let scale = (foveate_estimation::statistics::median(&offs)? / MEDIAN_DISTANCE).max(1.0);
            weights.iter_mut().zip(&offs).for_each(|(to, off)| *to = (LOSS_SIGMAS * scale / off).powi(2).min(1.0));
        }
        let Posterior { inverse, variance, .. } = found?;
        let corners = (0..=cells[1]).flat_map(|row| (0..=cells[0]).map(move |column| [column, row]));
        let corners = corners.map(|it| Point2::from([0, 1].map(|a| it[a] as f64 * size_m[a] / cells[a] as f64)));
        mesh.sigmas_m = corners
            .map(|corner| {
                let own = mesh.splines(&corner);
                let part: f64 = own
                    .iter()
                    .map(|(a, x, _)| x * own.iter().map(|(b, y, _)| y * inverse[(*a, *b)]).sum::<f64>())
                    .sum();
                variance.map(|it| (it * part.max(0.0)).sqrt())
            })
            .collect();
        Some(mesh)
    }

    /// The shift of a point [m], and its derivative by the point. Beyond the rectangle it is extrapolated linearly.
    pub fn shift(&self, point: &Point2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (mut shift, mut by_point) = (Vector2::zeros(), Matrix2::zeros());
        for (at, value, slope) in self.splines(point) {
            shift += self.shifts_m[at] * value;
            by_point += self.shifts_m[at] * slope.transpose();
        }
        (shift, by_point)
    }

    /// Covariance of the shift of a point [m²]; beyond the rectangle that of its edge.
    pub fn covariance(&self, point: &Point2<f64>) -> Matrix2<f64> {
        let (cell, part) = self.cell(point);
        let mut variance = Vector2::zeros();
        for (column, row) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let along = |it: usize, f: f64| if it == 1 { f.clamp(0.0, 1.0) } else { 1.0 - f.clamp(0.0, 1.0) };
            let weight = along(column, part[0]) * along(row, part[1]);
            let corner = (cell[1] + row) * (self.cells[0] + 1) + cell[0] + column;
            variance += self.sigmas_m[corner].map(|it| it * it) * weight;
        }
        Matrix2::from_diagonal(&variance)
    }

    /// The point whose shifted position is `shifted`; `None` where there is none, or several.
    pub fn unshifted(&self, shifted: &Point2<f64>) -> Option<Point2<f64>> {
        let mut point = shifted - self.shift(shifted).0;
        for _ in 0..STEPS {
            let (shift, by_point) = self.shift(&point);
            let slope = Matrix2::identity() + by_point;
            if slope.determinant() <= 0.0 {
                return None;
            }
            let off = point + shift - shifted;
            if off.norm() < NEAR {
                return Some(point);
            }
            point -= slope.try_inverse()? * off;
        }
        None
    }

    /// The cell of a point, or the nearest one, and where in it, as parts; below 0 and above 1 beyond the rectangle.
    fn cell(&self, point: &Point2<f64>) -> ([usize; 2], [f64; 2]) {
        let at = [0, 1].map(|axis| point[axis] / self.size_m[axis] * self.cells[axis] as f64);
        let cell = [0, 1].map(|axis| (at[axis].max(0.0) as usize).min(self.cells[axis] - 1));
        (cell, [0, 1].map(|axis| at[axis] - cell[axis] as f64))
    }

    fn splines(&self, point: &Point2<f64>) -> Splines {
        let (cell, part) = self.cell(point);
        let [along_x, along_y] = part.map(cubic);
        let per_m = [0, 1].map(|axis| self.cells[axis] as f64 / self.size_m[axis]);
        std::array::from_fn(|it| {
            let ((x, dx), (y, dy)) = (along_x[it % 4], along_y[it / 4]);
            let at = (cell[1] + it / 4) * (self.cells[0] + 3) + cell[0] + it % 4;
            (at, x * y, Vector2::new(dx * y * per_m[0], x * dy * per_m[1]))
        })
    }
}

/// The four cubic splines that are not 0 at the part `f` of a cell, with their derivatives by it; beyond the cell they go on in straight lines.
fn cubic(f: f64) -> [(f64, f64); 4] {
    let beyond = f - f.clamp(0.0, 1.0);
    let f = f - beyond;
    let g = 1.0 - f;
    let within = [
        (g * g * g / 6.0, -g * g / 2.0),
        ((3.0 * f * f * f - 6.0 * f * f + 4.0) / 6.0, (3.0 * f * f - 4.0 * f) / 2.0),
        ((3.0 * g * g * g - 6.0 * g * g + 4.0) / 6.0, -(3.0 * g * g - 4.0 * g) / 2.0),
        (f * f * f / 6.0, f * f / 2.0),
    ];
    within.map(|(value, slope)| (value + slope * beyond, slope))
}

/// What bends are charged.
fn roughness(size_m: [f64; 2], cells: [usize; 2]) -> DMatrix<f64> {
    let [columns, rows] = cells.map(|it| it + 3);
    let side = [0, 1].map(|axis| size_m[axis] / cells[axis] as f64);
    let area = side[0] * side[1];
    let mut all = DMatrix::zeros(columns * rows, columns * rows);
    // Differences of an order, and how often a derivative of that order along x is among the eight of third order.
    const DIFFERENCES: [(&[f64], f64); 4] =
        [(&[1.0], 1.0), (&[-1.0, 1.0], 3.0), (&[1.0, -2.0, 1.0], 3.0), (&[-1.0, 3.0, -3.0, 1.0], 1.0)];
    for order in 0..4 {
        let ((along_x, often), (along_y, _)) = (DIFFERENCES[order], DIFFERENCES[3 - order]);
        let weight = often * area / (side[0].powi(order as i32) * side[1].powi(3 - order as i32)).powi(2);
        for row in 0..=rows - along_y.len() {
            for column in 0..=columns - along_x.len() {
                let terms = along_y.iter().zip(row..).flat_map(|(y, row)| {
                    along_x.iter().zip(column..).map(move |(x, column)| (row * columns + column, x * y))
                });
                let terms: Vec<(usize, f64)> = terms.collect();
                for (a, x) in &terms {
                    for (b, y) in &terms {
                        all[(*a, *b)] += weight * x * y;
                    }
                }
            }
        }
    }
    all
}

/// Coefficients with their covariance, `inverse` times the variance of each axis.
struct Posterior {
    coefficients: MatrixXx2<f64>,
    inverse: DMatrix<f64>,
    variance: Vector2<f64>,
}

/// What one weight of the penalty gives.
struct Candidate {
    unlikely: f64,
    factor: Cholesky<f64, Dyn>,
    coefficients: MatrixXx2<f64>,
    variance: Vector2<f64>,
}

impl Posterior {
    /// Under the likeliest weight of the penalty.
    fn of(samples: &[Shifted], splines: &[Splines], weights: &[f64], roughness: &DMatrix<f64>) -> Option<Posterior> {
        let n = roughness.nrows();
        let (mut normal, mut right) = (DMatrix::<f64>::zeros(n, n), MatrixXx2::<f64>::zeros(n));
        for ((it, own), weight) in samples.iter().zip(splines).zip(weights) {
            let weight = weight / (it.sigma * it.sigma);
            for (a, x, _) in own {
                for (b, y, _) in own {
                    normal[(*a, *b)] += weight * x * y;
                }
                for axis in 0..2 {
                    right[(*a, axis)] += weight * x * it.shift[axis];
                }
            }
        }
        let freedom = (samples.len().checked_sub(FREE).filter(|it| *it > 0)?) as f64;
        let equal = normal.trace() / roughness.trace();
        let steps = ((MOST_STRENGTH - LEAST_STRENGTH) / STRENGTH_STEP) as i32;
        let mut best: Option<Candidate> = None;
        for step in 0..=steps {
            let strength = equal * 10_f64.powf(LEAST_STRENGTH + STRENGTH_STEP * f64::from(step));
            let Some(factor) = (&normal + roughness * strength).cholesky() else { continue };
            let coefficients = factor.solve(&right);
            let mut squares = Vector2::zeros();
            for ((it, own), weight) in samples.iter().zip(splines).zip(weights) {
                let value = |axis: usize| own.iter().map(|(a, x, _)| x * coefficients[(*a, axis)]).sum::<f64>();
                let off = it.shift - Vector2::new(value(0), value(1));
                squares += off.component_mul(&off) * (weight / (it.sigma * it.sigma));
            }
            let charged = roughness * &coefficients;
            for axis in 0..2 {
                squares[axis] += strength * coefficients.column(axis).dot(&charged.column(axis));
            }
            let determinant: f64 = 2.0 * factor.l_dirty().diagonal().iter().map(|it| it.ln()).sum::<f64>();
            let variance = squares / freedom;
            // Twice the negative logarithm, over both axes, without constants.
            let noise = variance.map(|it| it.max(LEAST_VARIANCE));
            let unlikely = freedom * noise.zip_map(&variance, |noise, it| noise.ln() + it / noise).sum()
                + 2.0 * (determinant - (n - FREE) as f64 * strength.ln());
            if unlikely.is_finite() && best.as_ref().is_none_or(|it| unlikely < it.unlikely) {
                best = Some(Candidate { unlikely, factor, coefficients, variance });
            }
        }
        let Candidate { factor, coefficients, variance, .. } = best?;
        // No better than the samples were said to be.
        let mean = variance.mean();
        let variance = variance * (mean.max(1.0) / mean);
        Some(Posterior { coefficients, inverse: factor.inverse(), variance })
    }
}
