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

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix6, Point3, SMatrix, SVector, Vector2, Vector3};

/// Position and velocity of a point, and how well they are known.
#[derive(Debug, Clone, PartialEq)]
pub struct ConstantVelocity {
    /// [m]
    pub position: Point3<f64>,
    /// [m/s]
    pub velocity: Vector3<f64>,
    /// Of (position, velocity) [m², m²/s, m²/s²]; symmetric, positive definite.
    pub covariance: Matrix6<f64>,
}

/// How far a measurement was from what the filter expected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// νᵀ S⁻¹ ν, the squared Mahalanobis distance: χ² with as many degrees of freedom as the measurement has numbers,
    /// if the model holds. Infinite when S is not positive definite or a number is not finite; the filter is then left as it was.
    pub normalised_squared: f64,
    /// ln of the Gaussian density of the measurement, −(νᵀS⁻¹ν + ln det(2πS))/2; −∞ in the case above.
    pub log_likelihood: f64,
}

impl Innovation {
    const IMPOSSIBLE: Innovation = Innovation { normalised_squared: f64::INFINITY, log_likelihood: f64::NEG_INFINITY };
}

impl ConstantVelocity {
    /// A point first seen at `position` with `position_covariance` [m²], at rest as far as is known: each component of
    /// its velocity has the standard deviation `velocity_sigma` [m/s].
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

    /// Where the point will be `dt_s` seconds on, or was for a negative `dt_s` [m].
    #[inline]
    pub fn position_after(&self, dt_s: f64) -> Point3<f64> {
        self.position + self.velocity * dt_s
    }

    /// Carries the state `dt_s` seconds forward under white-noise acceleration of spectral density
    /// `acceleration_density` [m²/s³].
    ///
    /// Time does not run backwards: for a negative or non-finite `dt_s` or density the state stays and `false` comes back.
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

    /// Covariance S of the pixel error that is to be expected [px²]: `jacobian` is the derivative of the pixel by the
    /// position [px/m], `measurement_covariance` that of the pixel itself [px²].
    #[inline]
    pub fn innovation_covariance(
        &self,
        jacobian: &Matrix2x3<f64>,
        measurement_covariance: &Matrix2<f64>,
    ) -> Matrix2<f64> {
        jacobian * self.covariance.fixed_view::<3, 3>(0, 0) * jacobian.transpose() + measurement_covariance
    }

    /// Takes in a pixel: `innovation` is measured minus projected [px], the rest as for [`Self::innovation_covariance`],
    /// with `jacobian` at the predicted position (an extended Kalman filter).
    #[inline]
    pub fn update_pixel(
        &mut self,
        innovation: Vector2<f64>,
        jacobian: &Matrix2x3<f64>,
        measurement_covariance: &Matrix2<f64>,
    ) -> Innovation {
        self.update(innovation, jacobian, measurement_covariance)
    }

    /// Takes in a measured position [m] with its covariance [m²].
    pub fn update_position(&mut self, measured: &Point3<f64>, measurement_covariance: &Matrix3<f64>) -> Innovation {
        self.update(measured - self.position, &Matrix3::identity(), measurement_covariance)
    }

    /// Takes in any measurement of N numbers that depends on the position only.
    #[inline]
    fn update<const N: usize>(
        &mut self,
        innovation: SVector<f64, N>,
        jacobian: &SMatrix<f64, N, 3>,
        noise: &SMatrix<f64, N, N>,
    ) -> Innovation
    where
        SMatrix<f64, N, N>: SmallInverse,
    {
        let cross: SMatrix<f64, 6, N> = self.covariance.fixed_columns::<3>(0) * jacobian.transpose(); // P Hᵀ
        let expected = jacobian * cross.fixed_rows::<3>(0) + noise; // S
        let Some((precision, determinant)) = expected.inverse_and_determinant() else {
            return Innovation::IMPOSSIBLE;
        };
        let normalised_squared = innovation.dot(&(precision * innovation));
        if !normalised_squared.is_finite() {
            return Innovation::IMPOSSIBLE;
        }
        let gain = cross * precision;
        let correction = gain * innovation;
        self.position += correction.fixed_rows::<3>(0);
        self.velocity += correction.fixed_rows::<3>(3);
        subtract_upper(&mut self.covariance, &gain, &cross); // P₁
        let residue = self.covariance.fixed_columns::<3>(0) * jacobian.transpose() - gain * noise;
        subtract_upper(&mut self.covariance, &residue, &gain);
        let log_likelihood =
            -0.5 * (normalised_squared + determinant.ln() + N as f64 * (2.0 * std::f64::consts::PI).ln());
        Innovation { normalised_squared, log_likelihood }
    }
}

/// Subtracts a bᵀ, of which only the upper triangle is computed, on both sides of the diagonal.
#[inline]
fn subtract_upper<const N: usize>(from: &mut Matrix6<f64>, a: &SMatrix<f64, 6, N>, b: &SMatrix<f64, 6, N>) {
    for column in 0..6 {
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
trait SmallInverse: Sized {
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
