//! Levenberg–Marquardt for shared parameters and many groups of G parameters each, where no residual depends on two groups: block arrow equations.
//!
//! With U, V and W the blocks of shared parameters, of groups and between them,
//!
//! | U  W | hₛ |     | gₛ |
//! | Wᵀ V | hᵥ | = − | gᵥ |
//!
//! V consists of small blocks, so that the groups are eliminated one by one (Schur complement): (U − W V⁻¹ Wᵀ) hₛ = −(gₛ − W V⁻¹ gᵥ), then
//! hᵥ = −V⁻¹ (gᵥ + Wᵀ hₛ). Source: B. Triggs et al., "Bundle adjustment: a modern synthesis", 2000, §6.1. All
//! diagonals are damped first. A group whose
//! block is singular does not move and adds no information.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::driver::{DriverOptions, Outcome, System, minimise, predicted_reduction, raise};
use super::information::{Unobservable, invert_information, solve_positive};
use super::{Loss, SolveError};

/// A least-squares problem over shared parameters and groups of G.
pub trait GroupedProblem<const G: usize> {
    /// The unknowns, on any manifold.
    type Parameters: Clone;

    /// Number of entries of a step of the shared parameters; may be 0.
    fn dimension(&self) -> usize;

    /// Number of groups; may be 0.
    fn n_groups(&self) -> usize;

    /// The parameters after a step of the shared ones and of each group.
    fn moved(&self, from: &Self::Parameters, shared: &DVector<f64>, groups: &[SVector<f64, G>]) -> Self::Parameters;

    /// Adds all residuals at `at`, with their derivatives with respect to the step, to `equations`. `None` where they are not defined: a step to there is rejected.
    fn linearise(&self, at: &Self::Parameters, equations: &mut GroupedEquations<G>) -> Option<()>;
}

/// Normal equations of one group.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupEquations<const G: usize> {
    /// The group's block of V.
    pub information: SMatrix<f64, G, G>,
    /// The group's part of the gradient.
    pub gradient: SVector<f64, G>,
    /// Shared parameters that it knows, and their rows of W.
    between: Vec<(usize, SVector<f64, G>)>,
}

/// Gauss–Newton normal equations, summed over the residuals.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupedEquations<const G: usize> {
    loss: Loss,
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    groups: Vec<GroupEquations<G>>,
    cost: f64,
}

impl<const G: usize> GroupedEquations<G> {
    /// Empty equations, without residuals.
    pub fn new(loss: Loss, dimension: usize, n_groups: usize) -> Self {
        let empty = GroupEquations { information: SMatrix::zeros(), gradient: SVector::zeros(), between: Vec::new() };
        GroupedEquations {
            loss,
            information: DMatrix::zeros(dimension, dimension),
            gradient: DVector::zeros(dimension),
            groups: vec![empty; n_groups],
            cost: 0.0,
        }
    }

    /// Removes all residuals.
    pub fn clear(&mut self) {
        self.information.fill(0.0);
        self.gradient.fill(0.0);
        for it in &mut self.groups {
            (it.information, it.gradient) = (SMatrix::zeros(), SVector::zeros());
            it.between.clear();
        }
        self.cost = 0.0;
    }

    /// The robust loss in use.
    pub fn loss(&self) -> Loss {
        self.loss
    }

    /// The equations of each group.
    pub fn groups(&self) -> &[GroupEquations<G>] {
        &self.groups
    }

    /// Adds ½ `cost` without a derivative, for example of a point that its camera cannot see.
    pub fn add_cost(&mut self, cost: f64) {
        self.cost += 0.5 * cost;
    }

    /// Adds a residual of R numbers, weighted by the loss as one, that depends on the shared parameters `rows` (`None`: held) and on one group.
    pub fn add<const R: usize, const C: usize>(
        &mut self,
        rows: &[Option<usize>; C],
        group: usize,
        residual: &SVector<f64, R>,
        (by_shared, by_group): (&SMatrix<f64, R, C>, &SMatrix<f64, R, G>),
    ) {
        let mut sum = BlockSum::zeros();
        sum.add(&self.loss, residual, (by_shared, by_group), 1.0);
        self.add_sum(rows, group, &sum);
    }

    /// Adds a sum of residuals that all depend on the same shared parameters and group.
    pub fn add_sum<const C: usize>(&mut self, rows: &[Option<usize>; C], group: usize, sum: &BlockSum<C, G>) {
        self.cost += sum.cost;
        let own = &mut self.groups[group];
        own.information += sum.of_group;
        own.gradient += sum.gradient_of_group;
        for (i, row) in rows.iter().enumerate() {
            let Some(row) = *row else { continue };
            self.gradient[row] += sum.gradient_of_shared[i];
            for (j, column) in rows.iter().enumerate() {
                if let Some(column) = *column {
                    self.information[(row, column)] += sum.of_shared[(i, j)];
                }
            }
            let between: SVector<f64, G> = sum.between.row(i).transpose();
            match own.between.iter_mut().find(|it| it.0 == row) {
                Some(known) => known.1 += between,
                None => own.between.push((row, between)),
            }
        }
    }

    /// Adds a scalar residual that depends on one shared parameter, without loss: prior knowledge.
    pub fn add_known(&mut self, row: usize, residual: f64, slope: f64) {
        self.cost += 0.5 * residual * residual;
        self.gradient[row] += slope * residual;
        self.information[(row, row)] += slope * slope;
    }

    /// Information and gradient of the shared parameters when groups follow, with diagonals raised; and the inverse of each group's block.
    fn reduced(&self, raised: Option<&DVector<f64>>, damping: f64) -> Reduced<G> {
        let mut information = self.information.clone();
        let mut gradient = self.gradient.clone();
        if let Some(raised) = raised {
            (0..raised.len()).for_each(|it| information[(it, it)] += raised[it]);
        }
        let mut back: Vec<SVector<f64, G>> = Vec::new();
        let inverse_of = |group: &GroupEquations<G>| {
            let mut damped = group.information;
            (0..G).for_each(|it| damped[(it, it)] *= 1.0 + damping);
            damped.cholesky().map_or_else(SMatrix::zeros, |it| it.inverse())
        };
        let inverses: Vec<SMatrix<f64, G, G>> = self.groups.iter().map(inverse_of).collect();
        for (group, inverse) in self.groups.iter().zip(&inverses) {
            back.clear();
            back.extend(group.between.iter().map(|it| inverse * it.1));
            for ((row, _), back) in group.between.iter().zip(&back) {
                gradient[*row] -= back.dot(&group.gradient);
                // The lower triangle.
                for (other, between) in group.between.iter().filter(|it| it.0 >= *row) {
                    information[(*other, *row)] -= back.dot(between);
                }
            }
        }
        information.fill_upper_triangle_with_lower_triangle();
        Reduced { information, gradient, inverses }
    }

    /// Information and gradient of the shared parameters with all groups eliminated.
    pub fn eliminated(&self) -> (DMatrix<f64>, DVector<f64>) {
        let Reduced { information, gradient, .. } = self.reduced(None, 0.0);
        (information, gradient)
    }
}

/// A sum over residuals that all depend on the same C shared parameters and the same group.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockSum<const C: usize, const G: usize> {
    of_shared: SMatrix<f64, C, C>,
    gradient_of_shared: SVector<f64, C>,
    of_group: SMatrix<f64, G, G>,
    gradient_of_group: SVector<f64, G>,
    between: SMatrix<f64, C, G>,
    cost: f64,
}

impl<const C: usize, const G: usize> BlockSum<C, G> {
    /// An empty sum.
    pub fn zeros() -> Self {
        BlockSum {
            of_shared: SMatrix::zeros(),
            gradient_of_shared: SVector::zeros(),
            of_group: SMatrix::zeros(),
            gradient_of_group: SVector::zeros(),
            between: SMatrix::zeros(),
            cost: 0.0,
        }
    }

    /// Adds a residual, weighted by the loss as one, with its derivatives; each of its numbers has the information `per_variance`.
    #[inline]
    pub fn add<const R: usize>(
        &mut self,
        loss: &Loss,
        residual: &SVector<f64, R>,
        (by_shared, by_group): (&SMatrix<f64, R, C>, &SMatrix<f64, R, G>),
        per_variance: f64,
    ) {
        let (cost, weight) = loss.at(residual.norm_squared() * per_variance);
        let weight = weight * per_variance;
        self.cost += 0.5 * cost;
        let weighted = by_shared * weight;
        self.of_shared += by_shared.tr_mul(&weighted);
        self.gradient_of_shared += weighted.tr_mul(residual);
        self.of_group += by_group.tr_mul(&(by_group * weight));
        self.gradient_of_group += by_group.tr_mul(residual) * weight;
        self.between += weighted.tr_mul(by_group);
    }
}

struct Reduced<const G: usize> {
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    inverses: Vec<SMatrix<f64, G, G>>,
}

/// The solution of [`solve_grouped`].
#[derive(Debug, Clone, PartialEq)]
pub struct GroupedSolution<P, const G: usize> {
    /// The parameters of least cost.
    pub parameters: P,
    /// The normal equations at the solution.
    pub equations: GroupedEquations<G>,
    /// How the search ended.
    pub outcome: Outcome,
}

impl<P, const G: usize> GroupedSolution<P, G> {
    /// Covariance of the shared parameters with the groups unknown, if the standard deviations of the residuals are
    /// right; and the inverse information of each group by itself.
    ///
    /// # Errors
    /// The shared parameters that are unobservable.
    pub fn covariance(&self) -> Result<(DMatrix<f64>, Vec<SMatrix<f64, G, G>>), Unobservable> {
        let Reduced { information, inverses, .. } = self.equations.reduced(None, 0.0);
        let of = information.nrows();
        let covariance = invert_information(&information).map_err(|parameters| Unobservable { parameters, of })?;
        Ok((covariance, inverses))
    }
}

/// A problem on its way.
struct Grouped<'a, P: GroupedProblem<G>, const G: usize> {
    problem: &'a P,
    parameters: P::Parameters,
    candidate: Option<P::Parameters>,
    here: GroupedEquations<G>,
    there: GroupedEquations<G>,
    step: DVector<f64>,
    of_groups: Vec<SVector<f64, G>>,
}

impl<P: GroupedProblem<G>, const G: usize> System for Grouped<'_, P, G> {
    fn begin(&mut self) -> Option<f64> {
        self.problem.linearise(&self.parameters, &mut self.here)?;
        Some(self.here.cost)
    }

    fn solve(&mut self, damping: f64) -> Option<f64> {
        let here = &self.here;
        let diagonal = here.information.diagonal();
        let largest = diagonal.iter().copied().fold(0.0, f64::max);
        let raised = diagonal.map(|it| raise(it, largest, damping));
        let Reduced { information, gradient, inverses } = here.reduced(Some(&raised), damping);
        self.step = solve_positive(information, &-gradient)?;
        let mut predicted = predicted_reduction(self.step.as_slice(), here.gradient.as_slice(), raised.as_slice());
        for ((step, group), inverse) in self.of_groups.iter_mut().zip(&here.groups).zip(&inverses) {
            let along = group.between.iter().fold(group.gradient, |sum, (row, it)| sum + it * self.step[*row]);
            *step = -(inverse * along);
            let raised = group.information.diagonal() * damping;
            predicted += predicted_reduction(step.as_slice(), group.gradient.as_slice(), raised.as_slice());
        }
        Some(predicted)
    }

    fn attempt(&mut self) -> Option<f64> {
        let candidate = self.candidate.insert(self.problem.moved(&self.parameters, &self.step, &self.of_groups));
        self.there.clear();
        self.problem.linearise(candidate, &mut self.there)?;
        Some(self.there.cost)
    }

    fn accept(&mut self) {
        if let Some(candidate) = self.candidate.take() {
            self.parameters = candidate;
            std::mem::swap(&mut self.here, &mut self.there);
        }
    }
}

/// Minimises `problem` from `start`.
///
/// # Errors
/// [`SolveError::BadStart`] and [`SolveError::BadOption`].
pub fn solve_grouped<P: GroupedProblem<G>, const G: usize>(
    problem: &P,
    start: P::Parameters,
    loss: Loss,
    options: &DriverOptions,
) -> Result<GroupedSolution<P::Parameters, G>, SolveError> {
    if let Some(found) = loss.bad_scale() {
        return Err(SolveError::BadOption { option: "scale of the loss", found });
    }
    let (dimension, n_groups) = (problem.dimension(), problem.n_groups());
    let [here, there] = [(); 2].map(|()| GroupedEquations::new(loss, dimension, n_groups));
    let (step, of_groups) = (DVector::zeros(dimension), vec![SVector::zeros(); n_groups]);
    let mut system = Grouped { problem, parameters: start, candidate: None, here, there, step, of_groups };
    let outcome = minimise(&mut system, options, &mut |_| ())?;
    Ok(GroupedSolution { parameters: system.parameters, equations: system.here, outcome })
}

#[cfg(test)]
mod tests;
