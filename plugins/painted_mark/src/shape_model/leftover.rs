//! Residuals of seen marks predict the residuals of hidden marks nearby.
//!
//! Skin that swings or folds does so in patches of centimetres, which a linear model of captured shapes does not contain. The residuals at seen marks are modelled as a
//! random field of two parts, one correlated over [`REACH_M`] and one independent for each mark, whose variances are estimated from the same marks:
//!
//! cov(rᵢ, rⱼ) = s² wᵢⱼ + n² δᵢⱼ with wᵢⱼ = exp(−dᵢⱼ² / 2ℓ²); s² by least squares over all pairs, s² = Σ wᵢⱼ rᵢ·rⱼ / 3 Σ wᵢⱼ², n² the rest of the variance.
//!
//! The expectation at a hidden mark h given all rⱼ is Σⱼ s² wₕⱼ aⱼ with (s² W + n² I) a = r, and the variance of the common part on each axis there s² − s⁴ wₕᵀ (s² W + n² I)⁻¹ wₕ (simple kriging: G. Matheron, "Principles of geostatistics", Economic Geology 58, 1963).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Point3, Vector3};

/// ℓ: half of the correlation length of residuals on a face or a knee [m].
const REACH_M: f64 = 0.025;
/// Fewest marks for a prediction.
const LEAST: usize = 8;
/// Smallest independent part of the variance: keeps the system solvable.
const OWN: f64 = 0.05;

/// The correlated part of the residuals.
pub(super) struct Leftover {
    /// Model positions of the seen marks, with s² aⱼ.
    seen: Vec<(Point3<f64>, Vector3<f64>)>,
    /// s² [m²].
    variance: f64,
    /// Of s² W + n² I.
    matrix: Cholesky<f64, Dyn>,
}

impl Leftover {
    /// From the model positions of the seen marks and their residuals [m]. `None` where neighbours are uncorrelated.
    pub fn of(seen: &[(Point3<f64>, Vector3<f64>)]) -> Option<Leftover> {
        let n = seen.len();
        if n < LEAST {
            return None;
        }
        let (mut common, mut weights) = (0.0, 0.0);
        for (i, one) in seen.iter().enumerate() {
            for other in &seen[..i] {
                let weight = alike(&one.0, &other.0);
                common += weight * one.1.dot(&other.1) / 3.0;
                weights += weight * weight;
            }
        }
        let variance = common / weights;
        let all = seen.iter().map(|it| it.1.norm_squared()).sum::<f64>() / (3 * n) as f64;
        if variance.is_nan() || variance <= 0.0 {
            return None;
        }
        // Not more than there is.
        let variance = variance.min(all);
        let own = (all - variance).max(OWN * variance);
        let matrix =
            DMatrix::from_fn(n, n, |i, j| variance * alike(&seen[i].0, &seen[j].0) + if i == j { own } else { 0.0 });
        let left = DMatrix::from_fn(n, 3, |i, axis| seen[i].1[axis]);
        let matrix = matrix.cholesky()?;
        let answer = matrix.solve(&left) * variance;
        let answers = (0..n).map(|i| Vector3::new(answer[(i, 0)], answer[(i, 1)], answer[(i, 2)]));
        Some(Leftover { seen: seen.iter().map(|it| it.0).zip(answers).collect(), variance, matrix })
    }

    /// Expected residual of a mark with the model position `place` [m].
    pub fn at(&self, place: &Point3<f64>) -> Vector3<f64> {
        self.seen.iter().map(|(seen, answer)| answer * alike(seen, place)).sum()
    }

    /// Variance of that expectation on each axis [m²].
    pub fn variance_at(&self, place: &Point3<f64>) -> f64 {
        let common = DVector::from_iterator(self.seen.len(), self.seen.iter().map(|it| alike(&it.0, place)));
        let known = self.variance * common.dot(&self.matrix.solve(&common));
        self.variance * (1.0 - known).max(0.0)
    }
}

fn alike(one: &Point3<f64>, other: &Point3<f64>) -> f64 {
    (-(one - other).norm_squared() / (2.0 * REACH_M * REACH_M)).exp()
}

#[cfg(test)]
mod tests {
    use foveate::estimation::Random;

    use super::*;

    fn places() -> Vec<Point3<f64>> {
        (0..49).map(|it| Point3::new(f64::from(it % 7) * 0.014, f64::from(it / 7) * 0.014, 0.0)).collect()
    }

    /// How far a hidden mark is off, root mean square, without what neighbours say and with it, over fields of which `left` gives one value.
    fn off(left: impl Fn(&Point3<f64>, &mut Random) -> Vector3<f64>) -> [f64; 2] {
        let mut random = Random::new(4);
        let mut sums = [0.0; 2];
        for hidden in 0..49 {
            let seen: Vec<_> = places().into_iter().map(|it| (it, left(&it, &mut random))).collect();
            let (place, truth) = seen[hidden];
            let others: Vec<_> = seen.iter().filter(|it| it.0 != place).copied().collect();
            let found = Leftover::of(&others).map_or(Vector3::zeros(), |it| it.at(&place));
            sums = [sums[0] + truth.norm_squared(), sums[1] + (truth - found).norm_squared()];
        }
        sums.map(|it| (it / 49.0).sqrt())
    }

    #[test]
    fn what_neighbours_have_in_common_is_known_of_a_hidden_mark() {
        let patch = |p: &Point3<f64>, random: &mut Random| {
            let swing = (-(p - Point3::new(0.05, 0.03, 0.0)).norm_squared() / (2.0 * 0.03_f64.powi(2))).exp();
            Vector3::new(0.2, -0.5, 1.0) * (1.5e-3 * swing) + Vector3::from_fn(|_, _| 5e-5 * random.normal())
        };
        let [without, with] = off(patch);
        assert!(with < 0.25 * without, "{without} m, {with} m");
    }

    #[test]
    fn what_neighbours_leave_open_is_as_large_as_stated_and_grows_with_the_distance_to_them() {
        // Swings of drawn places, directions and sizes; a corner is hidden.
        let mut random = Random::new(8);
        let (mut squares, mut stated) = ([0.0; 2], [0.0; 2]);
        for _ in 0..400 {
            let mut of = |most: f64| random.uniform_in(-most, most);
            let swings: Vec<(Point3<f64>, Vector3<f64>)> = (0..6)
                .map(|_| (Point3::new(0.042 + of(0.08), 0.042 + of(0.08), 0.0), Vector3::from_fn(|_, _| of(1e-3))))
                .collect();
            // What is alike over ℓ is made of patches of ℓ / √2.
            let at = |p: &Point3<f64>| -> Vector3<f64> {
                swings.iter().map(|it| it.1 * (-(p - it.0).norm_squared() / (REACH_M * REACH_M)).exp()).sum()
            };
            let (hidden, seen): (Vec<_>, Vec<_>) = places().into_iter().partition(|it| it.x + it.y < 0.05);
            let seen: Vec<_> =
                seen.iter().map(|it| (*it, at(it) + Vector3::from_fn(|_, _| 3e-5 * random.normal()))).collect();
            let Some(left) = Leftover::of(&seen) else { continue };
            for it in hidden {
                let is_far = usize::from(it.x + it.y < 0.02);
                squares[is_far] += (at(&it) - left.at(&it)).norm_squared() / 3.0;
                stated[is_far] += left.variance_at(&it);
            }
        }
        let sizes = [0, 1].map(|it| squares[it] / stated[it]);
        assert!(sizes.iter().all(|it| (0.4..2.5).contains(it)), "{sizes:?}");
        assert!(stated[1] / 3.0 > 2.0 * stated[0] / 7.0, "{stated:?}");
    }

    #[test]
    fn noise_of_each_mark_is_not_handed_on() {
        let [without, with] = off(|_, random| Vector3::from_fn(|_, _| 1e-4 * random.normal()));
        assert!(with < 1.15 * without, "{without} m, {with} m");
        assert!(Leftover::of(&[]).is_none());
        let still: Vec<_> = places().into_iter().map(|it| (it, Vector3::zeros())).collect();
        assert!(Leftover::of(&still).is_none_or(|it| it.at(&Point3::origin()).norm() == 0.0));
    }
}
