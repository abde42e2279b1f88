//! Rauch–Tung–Striebel smoothing: earlier estimates improved by later measurements.

use nalgebra::DVector;

use super::filter::{BodyFilter, Step, difference, moved};
use super::layout::Layout;

/// Smooths each step with the steps after it (H. E. Rauch, F. Tung and C. T. Striebel, AIAA Journal 3(8), 1965). Where
/// a step has no transition, later steps do not affect earlier ones.
pub fn smooth(steps: &[Step]) -> Vec<BodyFilter> {
    let mut smoothed: Vec<BodyFilter> = steps.iter().map(|it| it.filtered.clone()).collect();
    for k in (0..steps.len().saturating_sub(1)).rev() {
        let next = &steps[k + 1];
        let Some(transition) = &next.transition else { continue };
        let filtered = &steps[k].filtered;
        if filtered.layout != next.predicted.layout || smoothed[k + 1].layout != next.predicted.layout {
            continue;
        }
        let layout = filtered.layout;
        let Some(factor) = next.predicted.covariance.clone().cholesky() else { continue };
        // C = P Fᵀ P⁻¹, from P⁻¹ F P.
        let gain = factor.solve(&(transition * &filtered.covariance)).transpose();
        let change = whole_difference(&smoothed[k + 1], &next.predicted, &layout);
        let step = &gain * change;
        let mut better = filtered.clone();
        better.body = moved(&filtered.body, &step.rows(0, layout.n_static()).into_owned(), &layout);
        better.velocity += step.fixed_rows::<3>(layout.velocity());
        for part in layout.parts() {
            if let Some(at) = layout.rate(part) {
                better.rates[part.index()] += step.fixed_rows::<3>(at);
            }
        }
        let shrunk = &gain * (&smoothed[k + 1].covariance - &next.predicted.covariance) * gain.transpose();
        better.covariance = &filtered.covariance + shrunk;
        better.make_symmetric();
        smoothed[k] = better;
    }
    smoothed
}

fn whole_difference(a: &BodyFilter, b: &BodyFilter, layout: &Layout) -> DVector<f64> {
    let mut whole = DVector::zeros(layout.n());
    whole.rows_mut(0, layout.n_static()).copy_from(&difference(&a.body, &b.body, layout));
    whole.fixed_rows_mut::<3>(layout.velocity()).copy_from(&(a.velocity - b.velocity));
    for part in layout.parts() {
        if let Some(at) = layout.rate(part) {
            let i = part.index();
            whole.fixed_rows_mut::<3>(at).copy_from(&(a.rates[i] - b.rates[i]));
        }
    }
    whole
}
