//! Active-set search for the weights at bounds: minimises ½ wᵀ G w − gᵀ w, G the normal matrix and g the right side.

use nalgebra::DMatrix;

use super::{BoundedError, add_scaled, check_bounds, dot};

/// A column whose part that other columns do not explain is less than this part of its square is taken to follow from them.
const DEPENDENT: f64 = 1e-11;
/// A slope counts as downhill above this part of the numbers that it was summed up from.
const NOISE: f64 = 1e-12;
/// Rounds before the search gives up; some tens are many.
const ROUNDS: usize = 1000;

/// Whether a weight is free or at a bound.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Between the bounds, or not yet examined.
    Free,
    /// At the lower bound.
    Lower,
    /// At the upper bound.
    Upper,
}

/// The weights and their sides: the state of a search, and the start of the next one.
///
/// Each round releases all weights that lower the cost by leaving their bound. The free weights then go to their
/// optimum, or as far as the bounds allow: all at once where that lowers the cost, else up to the first bound. Weights
/// that meet a bound stay there, until an optimum within the bounds is reached. The search ends, since each round
/// either lowers the cost or releases fewer weights.
#[derive(Debug, Clone, PartialEq)]
pub struct ActiveSet {
    weights: Vec<f64>,
    sides: Vec<Side>,
    /// G w − g.
    slopes: Vec<f64>,
    step: Vec<f64>,
    /// As `step` before bounds cut it.
    whole: Vec<f64>,
    /// G · step.
    along: Vec<f64>,
    factor: Factor,
    product: Vec<f64>,
}

impl ActiveSet {
    /// All weights at the value nearest to zero that their bounds allow; as many as the shorter list of bounds has.
    pub fn new(lower: &[f64], upper: &[f64]) -> Self {
        let n = lower.len().min(upper.len());
        let place = |(&low, &high): (&f64, &f64)| {
            if low > 0.0 {
                low
            } else if high < 0.0 {
                high
            } else {
                0.0
            }
        };
        let weights: Vec<f64> = lower.iter().zip(upper).map(place).collect();
        let side = |(index, weight): (usize, &f64)| match *weight {
            it if it == lower[index] => Side::Lower,
            it if it == upper[index] => Side::Upper,
            _ => Side::Free,
        };
        Self {
            sides: weights.iter().enumerate().map(side).collect(),
            weights,
            slopes: vec![0.0; n],
            step: vec![0.0; n],
            whole: vec![0.0; n],
            along: vec![0.0; n],
            factor: Factor::default(),
            product: vec![0.0; n],
        }
    }

    /// The present weights.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// The side of each weight.
    pub fn sides(&self) -> &[Side] {
        &self.sides
    }

    /// Whether this weight lies between its bounds; `false` for an index out of range.
    pub fn is_free(&self, index: usize) -> bool {
        self.sides.get(index) == Some(&Side::Free)
    }

    /// Number of weights between their bounds.
    pub fn n_free(&self) -> usize {
        self.sides.iter().filter(|it| **it == Side::Free).count()
    }

    /// Number of free weights that the last system did not determine.
    pub fn n_undetermined(&self) -> usize {
        self.n_free().saturating_sub(self.factor.kept.len())
    }

    /// Puts the weights back to those of an earlier answer of the same sides.
    pub(super) fn set_weights(&mut self, weights: &[f64]) {
        self.weights.copy_from_slice(weights);
    }

    /// G w.
    pub(super) fn product(&mut self, gram: &DMatrix<f64>) -> &[f64] {
        self.product.fill(0.0);
        multiply(gram, &self.weights, &mut self.product);
        &self.product
    }

    /// Minimises ½ wᵀ G w − gᵀ w within the bounds; G = `gram` (symmetric, positive semidefinite), g = `right`.
    /// Returns how many systems of equations were solved.
    ///
    /// # Errors
    /// [`BoundedError::Lengths`], [`BoundedError::NotFinite`], [`BoundedError::Crossed`]; [`BoundedError::Lost`] where
    /// G is not positive semidefinite.
    pub fn minimise(
        &mut self,
        gram: &DMatrix<f64>,
        right: &[f64],
        lower: &[f64],
        upper: &[f64],
    ) -> Result<usize, BoundedError> {
        let n = self.weights.len();
        check_bounds(n, lower, upper)?;
        for (what, found) in [("rows of the normal matrix", gram.nrows()), ("columns of it", gram.ncols())] {
            if found != n {
                return Err(BoundedError::Lengths { what, found, expected: n });
            }
        }
        if right.len() != n {
            return Err(BoundedError::Lengths { what: "right side", found: right.len(), expected: n });
        }
        if let Some(index) = right.iter().position(|it| !it.is_finite()) {
            return Err(BoundedError::NotFinite { what: "right side", index });
        }
        // Bounds may have changed since the last search.
        for index in 0..n {
            let weight = if self.weights[index].is_finite() { self.weights[index] } else { 0.0 };
            self.weights[index] = weight.clamp(lower[index], upper[index]);
            self.sides[index] = match self.sides[index] {
                Side::Lower if self.weights[index] > lower[index] => Side::Free,
                Side::Upper if self.weights[index] < upper[index] => Side::Free,
                side => side,
            };
        }
        let mut one_by_one = false;
        let mut held = vec![false; n];
        let mut n_solved = 0;
        for round in 0..ROUNDS {
            self.slopes.iter_mut().zip(right).for_each(|(slope, right)| *slope = -right);
            multiply(gram, &self.weights, &mut self.slopes);
            if self.slopes.iter().any(|it| !it.is_finite()) {
                return Err(BoundedError::Lost { rounds: round });
            }
            let released = self.release(gram, right, lower, upper, one_by_one, &held);
            if round > 0 && released.is_none() {
                return Ok(n_solved);
            }
            let fallen = self.descend(gram, lower, upper, &mut n_solved);
            // Rounding alone can let a weight go whose way then leads nowhere: such a one is held.
            if fallen <= 0.0 && round > 0 {
                match released {
                    Some(index) if one_by_one => held[index] = true,
                    _ => one_by_one = true,
                }
            }
        }
        Err(BoundedError::Lost { rounds: ROUNDS })
    }

    /// Frees the weights that go downhill from their bound, or only the one that does most; gives that one.
    fn release(
        &mut self,
        gram: &DMatrix<f64>,
        right: &[f64],
        lower: &[f64],
        upper: &[f64],
        one_by_one: bool,
        held: &[bool],
    ) -> Option<usize> {
        let size: f64 = self.weights.iter().enumerate().map(|(index, it)| it * it * gram[(index, index)]).sum();
        let mut steepest: Option<(f64, usize)> = None;
        for index in 0..self.weights.len() {
            let downhill = match self.sides[index] {
                Side::Lower => -self.slopes[index],
                Side::Upper => self.slopes[index],
                Side::Free => continue,
            };
            let length = gram[(index, index)].max(0.0).sqrt();
            let noise = NOISE * (length * size.sqrt() + right[index].abs());
            if downhill <= noise || held[index] || lower[index] >= upper[index] || length == 0.0 {
                continue;
            }
            if !one_by_one {
                self.sides[index] = Side::Free;
            }
            let steepness = downhill / length;
            if steepest.is_none_or(|(most, _)| steepness > most) {
                steepest = Some((steepness, index));
            }
        }
        let (_, index) = steepest?;
        self.sides[index] = Side::Free;
        Some(index)
    }

    /// Takes the free weights to their optimum, or to bounds on the way there; gives how much the cost has fallen.
    fn descend(&mut self, gram: &DMatrix<f64>, lower: &[f64], upper: &[f64], n_solved: &mut usize) -> f64 {
        let mut fallen = 0.0;
        loop {
            let free = self.sides.iter().enumerate().filter(|it| *it.1 == Side::Free).map(|it| it.0);
            self.factor.make(gram, free);
            *n_solved += 1;
            self.factor.solve(&self.slopes, &mut self.step);
            let limit = self.first_bound(lower, upper);
            let Some((first, reach)) = limit else {
                let gain = self.look_along(gram);
                self.walk();
                return fallen + gain;
            };
            self.whole.copy_from_slice(&self.step);
            for &index in &self.factor.kept {
                let there = (self.weights[index] + self.step[index]).clamp(lower[index], upper[index]);
                self.step[index] = there - self.weights[index];
            }
            let mut gain = self.look_along(gram);
            if gain <= 0.0 {
                self.step.iter_mut().zip(&self.whole).for_each(|(step, whole)| *step = reach * whole);
                gain = self.look_along(gram);
            }
            fallen += gain;
            self.walk();
            // A weight that the whole step takes over a bound, and that is at it now, stays there.
            for &index in &self.factor.kept {
                let (weight, whole) = (self.weights[index], self.whole[index]);
                if whole < 0.0 && (weight <= lower[index] || index == first) {
                    (self.weights[index], self.sides[index]) = (lower[index], Side::Lower);
                } else if whole > 0.0 && (weight >= upper[index] || index == first) {
                    (self.weights[index], self.sides[index]) = (upper[index], Side::Upper);
                }
            }
        }
    }

    /// Which weight meets its bound first on the way along the step, and what part of the step it takes to get there.
    fn first_bound(&self, lower: &[f64], upper: &[f64]) -> Option<(usize, f64)> {
        let mut first: Option<(usize, f64)> = None;
        for &index in &self.factor.kept {
            let (weight, step) = (self.weights[index], self.step[index]);
            let room = match weight + step {
                there if there < lower[index] => lower[index] - weight,
                there if there > upper[index] => upper[index] - weight,
                _ => continue,
            };
            let part = (room / step).max(0.0);
            if first.is_none_or(|(_, least)| part < least) {
                first = Some((index, part));
            }
        }
        first
    }

    /// How much the cost falls by the step.
    fn look_along(&mut self, gram: &DMatrix<f64>) -> f64 {
        self.along.fill(0.0);
        multiply(gram, &self.step, &mut self.along);
        -dot(&self.step, &self.slopes) - 0.5 * dot(&self.step, &self.along)
    }

    /// Goes the step that was last looked along.
    fn walk(&mut self) {
        add_scaled(&mut self.weights, 1.0, &self.step);
        add_scaled(&mut self.slopes, 1.0, &self.along);
    }
}

/// `sum` += `gram` · `values`; columns of zeros cost nothing.
fn multiply(gram: &DMatrix<f64>, values: &[f64], sum: &mut [f64]) {
    let n = gram.nrows();
    for (column, value) in gram.as_slice().chunks_exact(n.max(1)).zip(values) {
        if *value != 0.0 {
            add_scaled(sum, *value, column);
        }
    }
}

/// L of L Lᵀ = G among the free weights, row by row, without those that follow from the ones before them.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Factor {
    /// The weights that the rows belong to.
    pub(crate) kept: Vec<usize>,
    /// Row i has i + 1 numbers, the last one inverted.
    rows: Vec<f64>,
    scratch: Vec<f64>,
}

impl Factor {
    pub(crate) fn make(&mut self, gram: &DMatrix<f64>, free: impl Iterator<Item = usize>) {
        self.kept.clear();
        self.rows.clear();
        for index in free {
            let column = gram.column(index);
            let column = column.as_slice();
            let start = self.rows.len();
            let mut place = 0;
            for (row, &other) in self.kept.iter().enumerate() {
                let (earlier, now) = self.rows.split_at(start);
                let above = &earlier[place..=place + row];
                let element = (column[other] - dot(&above[..row], now)) * above[row];
                place += row + 1;
                self.rows.push(element);
            }
            let now = &self.rows[start..];
            let left = column[index] - dot(now, now);
            if left > DEPENDENT * column[index] {
                self.rows.push(1.0 / left.sqrt());
                self.kept.push(index);
            } else {
                self.rows.truncate(start);
            }
        }
    }

    /// `step` = −G⁻¹ `slopes` among those kept, 0 elsewhere.
    pub(crate) fn solve(&mut self, slopes: &[f64], step: &mut [f64]) {
        let y = &mut self.scratch;
        y.clear();
        let mut place = 0;
        for (row, &index) in self.kept.iter().enumerate() {
            let line = &self.rows[place..=place + row];
            y.push((-slopes[index] - dot(&line[..row], y)) * line[row]);
            place += row + 1;
        }
        step.fill(0.0);
        for row in (0..self.kept.len()).rev() {
            place -= row + 1;
            let line = &self.rows[place..=place + row];
            let solved = y[row] * line[row];
            add_scaled(&mut y[..row], -solved, &line[..row]);
            step[self.kept[row]] = solved;
        }
    }
}
