//! Kalman filter of a point that moves at nearly constant velocity.
//!
//! The state is (position, velocity); acceleration is white noise of spectral density q [m²/s³], the continuous
//! white-noise acceleration model of Y. Bar-Shalom, X. Li, T. Kirubarajan, *Estimation with Applications to Tracking and
//! Navigation*, 2001, §6.2. The covariance is kept as 3×3 blocks A (position), B (position with velocity), C (velocity):
//!
//! | step | formula |
//! |---|---|
//! | predict over t | A + t(B + Bᵀ) + t²C + q t³/3, B + tC + q t²/2, C + q t |
//! | innovation covariance S | H P Hᵀ + R, with H = (J, 0): no measurement here depends on the velocity |
//! | gain K | P Hᵀ S⁻¹ |
//! | update | P₁ − (P₁Hᵀ − K R) Kᵀ with P₁ = P − K H P |
//!
//! The update is Joseph's form (I − KH) P (I − KH)ᵀ + K R Kᵀ written out: its second term is zero but for rounding, and
//! takes the effect of that out to first order. Only the upper triangle is computed, so that P stays symmetric.
//!
//! ```
//! use foveate_estimation::{ConstantVelocity, Random};
//! use nalgebra::{Matrix3, Point3, Vector3};
//!
//! // A light moves at (1, 0, 0.5) m/s; its position is measured 100 times a second, to 5 mm.
//! let mut random = Random::new(1);
//! let truth = |time_s: f64| Point3::new(time_s, 2.0, 1.0 + 0.5 * time_s);
//! let noise = Matrix3::identity() * 0.005_f64.powi(2);
//! let mut filter = ConstantVelocity::new(truth(0.0), noise, 2.0);
//! for step in 1..=100 {
//!     let error = Vector3::from_fn(|_, _| 0.005 * random.normal());
//!     filter.predict(0.01, 0.01);
//!     filter.update_position(&(truth(0.01 * f64::from(step)) + error), &noise);
//! }
//! assert!((filter.position - truth(1.0)).norm() < 0.005);
//! assert!((filter.velocity - Vector3::new(1.0, 0.0, 0.5)).norm() < 0.1);
//! assert!(filter.position_covariance().trace() < 0.5 * noise.trace());
//! ```

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix6, Point3, SMatrix, SVector, Vector2, Vector3};

/// State of a point under nearly constant velocity, with covariance: a Kalman filter in space.
#[derive(Debug, Clone, PartialEq)]
pub struct ConstantVelocity {
    /// Estimated position [m].
    pub position: Point3<f64>,
    /// Estimated velocity [m/s].
    pub velocity: Vector3<f64>,
    /// Covariance of (position, velocity) [m², m²/s, m²/s²]; symmetric, positive definite.
    pub covariance: Matrix6<f64>,
}

/// How far a measurement was from its prediction; for gating and for consistency tests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// νᵀ S⁻¹ ν, the squared Mahalanobis distance: χ² with as many degrees of freedom as the measurement has numbers,
    /// if the model holds. Infinite when S is not positive definite or a number is not finite; the filter is then left as it was.
    pub normalised_squared: f64,
    /// Logarithm of the Gaussian density of the measurement, −(νᵀS⁻¹ν + ln det(2πS))/2; −∞ in the case above.
    pub log_likelihood: f64,
}

impl Innovation {
    pub(crate) const IMPOSSIBLE: Innovation =
        Innovation { normalised_squared: f64::INFINITY, log_likelihood: f64::NEG_INFINITY };

    /// Of a measurement of `n` numbers whose S has this `determinant`.
    #[inline]
    pub(crate) fn of(normalised_squared: f64, determinant: f64, n: usize) -> Innovation {
        let volume = determinant.ln() + n as f64 * (2.0 * std::f64::consts::PI).ln();
        Innovation { normalised_squared, log_likelihood: -0.5 * (normalised_squared + volume) }
    }
}

impl ConstantVelocity {
    /// Initiates a track at `position` with `position_covariance` [m²] and zero mean velocity; each component of the
    /// velocity has the standard deviation `velocity_sigma` [m/s].
    pub fn new(position: Point3<f64>, position_covariance: Matrix3<f64>, velocity_sigma: f64) -> Self {
        let mut covariance = Matrix6::zeros();
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&position_covariance);
        covariance.fixed_view_mut::<3, 3>(3, 3).fill_diagonal(velocity_sigma * velocity_sigma);
        Self { position, velocity: Vector3::zeros(), covariance }
    }

    /// Covariance of the position [m²].
    #[inline]
    pub fn position_covariance(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into_owned()
    }

    /// Position extrapolated by `dt_s` seconds; a negative `dt_s` looks back [m].
    #[inline]
    pub fn position_after(&self, dt_s: f64) -> Point3<f64> {
        self.position + self.velocity * dt_s
    }

    /// Predicts the state `dt_s` seconds ahead under white-noise acceleration of spectral density `acceleration_density` [m²/s³].
    ///
    /// Returns `false`, and keeps the state, for a negative or non-finite `dt_s` or density.
    #[inline]
    pub fn predict(&mut self, dt_s: f64, acceleration_density: f64) -> bool {
        let usable = |value: f64| value >= 0.0 && value.is_finite();
        if !(usable(dt_s) && usable(acceleration_density)) {
            return false;
        }
        self.position += self.velocity * dt_s;
        let (t, q) = (dt_s, acceleration_density);
        let cross: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(0, 3).into_owned();
        let velocity: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(3, 3).into_owned();
        let mut cross_after = cross + velocity * t;
        // t(B + Bᵀ) + t²C is t times (B + tC) + Bᵀ, symmetric but for rounding: take its symmetric part.
        let grown = cross + cross_after;
        let mut position: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        position += (grown + grown.transpose()) * (0.5 * t);
        for axis in 0..3 {
            position[(axis, axis)] += q * t * t * t / 3.0;
            cross_after[(axis, axis)] += q * t * t / 2.0;
            self.covariance[(axis + 3, axis + 3)] += q * t;
        }
        self.covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&position);
        self.covariance.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross_after);
        self.covariance.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross_after.transpose());
        true
    }

    /// Innovation covariance S of a pixel, for gating [px²]: `jacobian` is the derivative of the pixel with respect to
    /// the position [px/m], `measurement_covariance` the covariance of the pixel itself [px²].
    #[inline]
    pub fn innovation_covariance(
        &self,
        jacobian: &Matrix2x3<f64>,
        measurement_covariance: &Matrix2<f64>,
    ) -> Matrix2<f64> {
        jacobian * self.covariance.fixed_view::<3, 3>(0, 0) * jacobian.transpose() + measurement_covariance
    }

    /// Updates with a pixel (extended Kalman filter): `innovation` is measured minus projected [px], the rest as for
    /// [`Self::innovation_covariance`], with `jacobian` at the predicted position.
    #[inline]
    pub fn update_pixel(
        &mut self,
        innovation: Vector2<f64>,
        jacobian: &Matrix2x3<f64>,
        measurement_covariance: &Matrix2<f64>,
    ) -> Innovation {
        self.update(innovation, jacobian, measurement_covariance)
    }

    /// Updates with a measured position [m] and its covariance [m²].
    pub fn update_position(&mut self, measured: &Point3<f64>, measurement_covariance: &Matrix3<f64>) -> Innovation {
        self.update(measured - self.position, &Matrix3::identity(), measurement_covariance)
    }

    /// Takes in any measurement of N numbers that depends on the position only.
    #[inline]
    pub(crate) fn update<const N: usize>(
        &mut self,
        innovation: SVector<f64, N>,
        jacobian: &SMatrix<f64, N, 3>,
        noise: &SMatrix<f64, N, N>,
    ) -> Innovation
    where
        SMatrix<f64, N, N>: SmallInverse,
    {
        let Some((correction, found)) = correct(&mut self.covariance, innovation, jacobian, noise) else {
            return Innovation::IMPOSSIBLE;
        };
        self.position += correction.fixed_rows::<3>(0);
        self.velocity += correction.fixed_rows::<3>(3);
        found
    }
}

/// Takes any measurement of N numbers that depends on the first three numbers of the state only into the covariance of a
/// state of D numbers. Gives what to add to the state; `None`, and the covariance is left as it was, when S is not
/// positive definite or a number is not finite.
#[inline]
pub(crate) fn correct<const D: usize, const N: usize>(
    covariance: &mut SMatrix<f64, D, D>,
    innovation: SVector<f64, N>,
    jacobian: &SMatrix<f64, N, 3>,
    noise: &SMatrix<f64, N, N>,
) -> Option<(SVector<f64, D>, Innovation)>
where
    SMatrix<f64, N, N>: SmallInverse,
{
    let cross: SMatrix<f64, D, N> = covariance.fixed_columns::<3>(0) * jacobian.transpose(); // P Hᵀ
    let expected = jacobian * cross.fixed_rows::<3>(0) + noise; // S
    let (precision, determinant) = expected.inverse_and_determinant()?;
    let normalised_squared = innovation.dot(&(precision * innovation));
    if !normalised_squared.is_finite() {
        return None;
    }
    let gain = cross * precision;
    subtract_upper(covariance, &gain, &cross); // P₁
    let residue = covariance.fixed_columns::<3>(0) * jacobian.transpose() - gain * noise;
    subtract_upper(covariance, &residue, &gain);
    Some((gain * innovation, Innovation::of(normalised_squared, determinant, N)))
}

/// Subtracts a bᵀ, of which only the upper triangle is computed, on both sides of the diagonal.
#[inline]
fn subtract_upper<const D: usize, const N: usize>(
    from: &mut SMatrix<f64, D, D>,
    a: &SMatrix<f64, D, N>,
    b: &SMatrix<f64, D, N>,
) {
    for column in 0..D {
        for row in 0..=column {
            let mut product = 0.0;
            for k in 0..N {
                product += a[(row, k)] * b[(column, k)];
            }
            from[(row, column)] -= product;
            from[(column, row)] = from[(row, column)];
        }
    }
}

/// Inverse and determinant of a small symmetric matrix; `None` unless it is positive definite.
pub(crate) trait SmallInverse: Sized {
    fn inverse_and_determinant(&self) -> Option<(Self, f64)>;
}

impl SmallInverse for Matrix2<f64> {
    #[inline]
    fn inverse_and_determinant(&self) -> Option<(Self, f64)> {
        let [a, b, c] = [self[(0, 0)], self[(0, 1)], self[(1, 1)]];
        let determinant = a * c - b * b;
        (a > 0.0 && determinant > 0.0).then(|| (Matrix2::new(c, -b, -b, a) / determinant, determinant))
    }
}

impl SmallInverse for Matrix3<f64> {
    fn inverse_and_determinant(&self) -> Option<(Self, f64)> {
        let factor = self.cholesky()?;
        Some((factor.inverse(), factor.determinant()))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector, Vector6};
    use proptest::prelude::*;

    use super::*;
    use crate::random::Random;

    fn symmetric_with_floor<const N: usize>(random: &mut Random, floor: f64) -> SMatrix<f64, N, N> {
        let root = SMatrix::<f64, N, N>::from_fn(|_, _| random.normal());
        root * root.transpose() + SMatrix::identity() * floor
    }

    fn some_filter(random: &mut Random) -> ConstantVelocity {
        ConstantVelocity {
            position: Point3::from(Vector3::from_fn(|_, _| random.normal())),
            velocity: Vector3::from_fn(|_, _| random.normal()),
            covariance: symmetric_with_floor(random, 0.1),
        }
    }

    /// The filter of the textbooks: dense, with inverses and products of whole matrices. Gives the squared normalised
    /// innovation and the log-likelihood.
    fn textbook_update(
        state: &mut DVector<f64>,
        covariance: &mut DMatrix<f64>,
        innovation: &DVector<f64>,
        by_state: &DMatrix<f64>,
        noise: &DMatrix<f64>,
    ) -> (f64, f64) {
        let expected = by_state * &*covariance * by_state.transpose() + noise;
        let inverse = expected.clone().try_inverse().unwrap();
        let gain = &*covariance * by_state.transpose() * &inverse;
        *state += &gain * innovation;
        let keep = DMatrix::identity(6, 6) - &gain * by_state;
        *covariance = &keep * &*covariance * keep.transpose() + &gain * noise * gain.transpose();
        let squared = (innovation.transpose() * inverse * innovation)[0];
        let volume = (expected * (2.0 * std::f64::consts::PI)).determinant();
        (squared, -0.5 * (squared + volume.ln()))
    }

    fn dense(filter: &ConstantVelocity) -> (DVector<f64>, DMatrix<f64>) {
        let mut state = DVector::zeros(6);
        state.rows_mut(0, 3).copy_from(&filter.position.coords);
        state.rows_mut(3, 3).copy_from(&filter.velocity);
        (state, DMatrix::from_column_slice(6, 6, filter.covariance.as_slice()))
    }

    #[track_caller]
    fn check_same(filter: &ConstantVelocity, (state, covariance): &(DVector<f64>, DMatrix<f64>)) {
        let (our_state, our_covariance) = dense(filter);
        assert!((our_state - state).norm() < 1e-9 * (1.0 + state.norm()));
        assert!((our_covariance - covariance).norm() < 1e-9 * (1.0 + covariance.norm()));
        assert_eq!(filter.covariance, filter.covariance.transpose());
    }

    proptest! {
        #[test]
        fn steps_are_those_of_the_textbook(seed: u64, dt_s in 0.0..3.0_f64, density in 0.0..5.0_f64) {
            let mut random = Random::new(seed);
            let mut filter = some_filter(&mut random);

            let (mut state, mut covariance) = dense(&filter);
            let (mut step, mut noise) = (DMatrix::<f64>::identity(6, 6), DMatrix::<f64>::zeros(6, 6));
            for axis in 0..3 {
                step[(axis, axis + 3)] = dt_s;
                noise[(axis, axis)] = density * dt_s.powi(3) / 3.0;
                noise[(axis, axis + 3)] = density * dt_s.powi(2) / 2.0;
                noise[(axis + 3, axis)] = density * dt_s.powi(2) / 2.0;
                noise[(axis + 3, axis + 3)] = density * dt_s;
            }
            state = &step * state;
            covariance = &step * covariance * step.transpose() + noise;
            prop_assert!((filter.position_after(dt_s).coords - state.rows(0, 3)).norm() < 1e-9);
            prop_assert!(filter.predict(dt_s, density));
            check_same(&filter, &(state.clone(), covariance.clone()));

            let jacobian = Matrix2x3::from_fn(|_, _| 3.0 * random.normal());
            let noise = symmetric_with_floor::<2>(&mut random, 0.1);
            let innovation = Vector2::new(random.normal(), random.normal());
            let mut by_state = DMatrix::zeros(2, 6);
            by_state.columns_mut(0, 3).copy_from(&jacobian);
            let dense_noise = DMatrix::from_column_slice(2, 2, noise.as_slice());
            let dense_innovation = DVector::from_column_slice(innovation.as_slice());
            let expected = &by_state * &covariance * by_state.transpose() + &dense_noise;
            let ours = filter.innovation_covariance(&jacobian, &noise);
            prop_assert!((expected - DMatrix::from_column_slice(2, 2, ours.as_slice())).norm() < 1e-8);
            let found = filter.update_pixel(innovation, &jacobian, &noise);
            let (squared, log_likelihood) =
                textbook_update(&mut state, &mut covariance, &dense_innovation, &by_state, &dense_noise);
            check_same(&filter, &(state.clone(), covariance.clone()));
            prop_assert!((found.normalised_squared - squared).abs() < 1e-8 * (1.0 + squared));
            prop_assert!((found.log_likelihood - log_likelihood).abs() < 1e-8 * (1.0 + log_likelihood.abs()));

            let noise = symmetric_with_floor::<3>(&mut random, 0.1);
            let measured = Point3::from(Vector3::from_fn(|_, _| random.normal()));
            let dense_innovation = DVector::from_column_slice((measured - filter.position).as_slice());
            let dense_noise = DMatrix::from_column_slice(3, 3, noise.as_slice());
            let found = filter.update_position(&measured, &noise);
            let by_state = DMatrix::identity(3, 6);
            let (squared, log_likelihood) =
                textbook_update(&mut state, &mut covariance, &dense_innovation, &by_state, &dense_noise);
            check_same(&filter, &(state, covariance));
            prop_assert!((found.normalised_squared - squared).abs() < 1e-8 * (1.0 + squared));
            prop_assert!((found.log_likelihood - log_likelihood).abs() < 1e-8 * (1.0 + log_likelihood.abs()));
        }
    }

    /// Jacobian of one of three cameras with 500 px of focal length, 2 m away, along one of the axes.
    fn camera_jacobian(which: usize) -> Matrix2x3<f64> {
        let mut jacobian = Matrix2x3::zeros();
        jacobian[(0, (which + 1) % 3)] = 250.0;
        jacobian[(1, (which + 2) % 3)] = 250.0;
        jacobian
    }

    #[test]
    fn errors_are_as_large_as_the_covariance_says() {
        let (dt_s, density, sigma) = (0.01_f64, 2.0_f64, 0.5);
        let (mut state_error, mut innovations) = (0.0, 0.0);
        let (runs, steps) = (200, 100);
        for run in 0..runs {
            let mut random = Random::new(run);
            let mut position = Vector3::zeros();
            let mut velocity = Vector3::from_fn(|_, _| random.normal());
            let start = position + Vector3::from_fn(|_, _| 0.1 * random.normal());
            let mut filter = ConstantVelocity::new(start.into(), Matrix3::identity() * 0.01, 1.0);
            for step in 0..steps {
                // One step of white-noise acceleration: the noise of position and velocity is correlated.
                for axis in 0..3 {
                    let (a, b) = (random.normal(), random.normal());
                    let root = (density * dt_s).sqrt();
                    position[axis] += velocity[axis] * dt_s + root * dt_s * (a / 2.0 + b / 12f64.sqrt());
                    velocity[axis] += root * a;
                }
                filter.predict(dt_s, density);
                let jacobian = camera_jacobian(step % 3);
                let noise = Vector2::new(random.normal(), random.normal()) * sigma;
                let innovation = jacobian * (position - filter.position.coords) + noise;
                let found = filter.update_pixel(innovation, &jacobian, &(Matrix2::identity() * sigma * sigma));
                innovations += found.normalised_squared;
            }
            let mut error = Vector6::zeros();
            error.fixed_rows_mut::<3>(0).copy_from(&(position - filter.position.coords));
            error.fixed_rows_mut::<3>(3).copy_from(&(velocity - filter.velocity));
            state_error += error.dot(&(filter.covariance.try_inverse().unwrap() * error));
        }
        // χ²: means 6 and 2, variances twice that; four standard errors.
        let (mean_state, mean_innovation) = (state_error / runs as f64, innovations / (runs as usize * steps) as f64);
        assert!((mean_state - 6.0).abs() < 4.0 * (12.0 / runs as f64).sqrt(), "{mean_state}");
        assert!(
            (mean_innovation - 2.0).abs() < 4.0 * (4.0 / (runs as usize * steps) as f64).sqrt(),
            "{mean_innovation}"
        );
    }

    #[test]
    fn the_covariance_stays_positive_definite() {
        // From very large to very small and back: measurements a million times better than the prior, seen from one
        // side for long, without process noise at times, then long predictions.
        let mut random = Random::new(3);
        let mut filter = ConstantVelocity::new(Point3::origin(), Matrix3::identity() * 1e6, 1e3);
        for step in 0..100_000 {
            let long = step % 1000 == 999;
            filter.predict(if long { 10.0 } else { 1e-3 * random.uniform() }, if step % 3 == 0 { 0.0 } else { 5.0 });
            let sigma = if step % 7 == 0 { 1e-3 } else { 1.0 };
            let innovation = Vector2::new(random.normal(), random.normal()) * sigma;
            let jacobian = camera_jacobian(step / 500 % 3);
            let found = filter.update_pixel(innovation, &jacobian, &(Matrix2::identity() * (sigma * sigma)));
            assert!(found.normalised_squared.is_finite(), "step {step}");
            assert!(filter.covariance.cholesky().is_some(), "step {step}: {}", filter.covariance);
        }
        assert_eq!(filter.covariance, filter.covariance.transpose());
    }

    #[test]
    fn a_point_at_rest_is_expected_where_it_is() {
        let mut filter = ConstantVelocity::new(Point3::new(1.0, 2.0, 3.0), Matrix3::identity() * 0.04, 0.5);
        assert!(filter.predict(2.0, 0.0));
        assert_eq!(filter.position, Point3::new(1.0, 2.0, 3.0));
        // 0.04 + 2² · 0.25
        assert!((filter.position_covariance() - Matrix3::identity() * 1.04).norm() < 1e-12);
        assert!((filter.covariance[(0, 3)] - 0.5).abs() < 1e-12);
    }

    #[test]
    fn what_cannot_be_is_refused_and_changes_nothing() {
        let mut filter = some_filter(&mut Random::new(4));
        let before = filter.clone();
        for (dt_s, density) in [(-1e-9, 1.0), (f64::NAN, 1.0), (f64::INFINITY, 1.0), (1.0, -1.0), (1.0, f64::NAN)] {
            assert!(!filter.predict(dt_s, density));
        }
        let jacobian = camera_jacobian(0);
        let fine = Matrix2::identity();
        let broken_jacobian = jacobian.map(|_| f64::NAN);
        for (innovation, jacobian, noise) in [
            (Vector2::new(f64::NAN, 0.0), jacobian, fine),
            (Vector2::zeros(), broken_jacobian, fine),
            (Vector2::zeros(), jacobian, Matrix2::identity() * f64::NAN),
            (Vector2::zeros(), jacobian, Matrix2::identity() * -1e9),
            (Vector2::zeros(), Matrix2x3::zeros(), Matrix2::zeros()),
        ] {
            assert_eq!(filter.update_pixel(innovation, &jacobian, &noise), Innovation::IMPOSSIBLE);
        }
        let nowhere = Point3::new(0.0, f64::NAN, 0.0);
        assert_eq!(filter.update_position(&nowhere, &Matrix3::identity()), Innovation::IMPOSSIBLE);
        assert_eq!(filter, before);
    }
}
