//! Kalman filter of a point that moves at nearly constant acceleration.
//!
//! The state is (position, velocity, acceleration); jerk is white noise of spectral density q [m²/s⁵], the continuous
//! Wiener-process acceleration model of Y. Bar-Shalom, X. Li, T. Kirubarajan, *Estimation with Applications to Tracking and
//! Navigation*, 2001, §6.2.3. The update is the one of [`ConstantVelocity`](crate::ConstantVelocity).

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix6, Point3, SMatrix, SVector, Vector2, Vector3, Vector6};

use crate::kalman::{Innovation, SmallInverse, correct};

/// State of a point under nearly constant acceleration, with covariance: a Kalman filter in space.
#[derive(Debug, Clone, PartialEq)]
pub struct ConstantAcceleration {
    /// Estimated position [m].
    pub position: Point3<f64>,
    /// Estimated velocity [m/s].
    pub velocity: Vector3<f64>,
    /// Estimated acceleration [m/s²].
    pub acceleration: Vector3<f64>,
    /// Covariance of (position, velocity, acceleration) [m², m²/s, …, m²/s⁴]; symmetric, positive definite.
    pub covariance: SMatrix<f64, 9, 9>,
}

impl ConstantAcceleration {
    /// Initiates a track at `position` with `position_covariance` [m²] and `velocity` [m/s]; each axis of the velocity
    /// has the standard deviation `velocity_sigma` [m/s], and the acceleration is zero with `acceleration_sigma`
    /// [m/s²].
    pub fn new(
        position: Point3<f64>,
        position_covariance: Matrix3<f64>,
        velocity: Vector3<f64>,
        velocity_sigma: f64,
        acceleration_sigma: f64,
    ) -> Self {
        let mut covariance = SMatrix::<f64, 9, 9>::zeros();
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&position_covariance);
        covariance.fixed_view_mut::<3, 3>(3, 3).fill_diagonal(velocity_sigma * velocity_sigma);
        covariance.fixed_view_mut::<3, 3>(6, 6).fill_diagonal(acceleration_sigma * acceleration_sigma);
        Self { position, velocity, acceleration: Vector3::zeros(), covariance }
    }

    /// Position extrapolated by `dt_s` seconds; a negative `dt_s` looks back [m].
    #[inline]
    pub fn position_after(&self, dt_s: f64) -> Point3<f64> {
        self.position + self.velocity * dt_s + self.acceleration * (0.5 * dt_s * dt_s)
    }

    /// Predicts the state `dt_s` seconds ahead under white-noise jerk of spectral density `jerk_density` [m²/s⁵].
    ///
    /// Returns `false`, and keeps the state, for a negative or non-finite `dt_s` or density, or where the covariance overflows.
    pub fn predict(&mut self, dt_s: f64, jerk_density: f64) -> bool {
        let usable = |value: f64| value >= 0.0 && value.is_finite();
        if !(usable(dt_s) && usable(jerk_density)) {
            return false;
        }
        let (t, q) = (dt_s, jerk_density);
        let half = 0.5 * t * t;
        let noise = Matrix3::new(
            q * t.powi(5) / 20.0,
            q * t.powi(4) / 8.0,
            q * t.powi(3) / 6.0,
            0.0,
            q * t.powi(3) / 3.0,
            q * half,
            0.0,
            0.0,
            q * t,
        ); // (6.2.3-10); of the lower triangle nothing is used
        let mut covariance = self.covariance;
        // No axis acts on another, so each 3×3 block of an axis (or of two) over the orders goes its own way: F G Fᵀ.
        for b in 0..3 {
            for a in 0..=b {
                let mut block = Matrix3::from_fn(|i, j| covariance[(3 * i + a, 3 * j + b)]);
                for j in 0..3 {
                    block[(0, j)] += t * block[(1, j)] + half * block[(2, j)];
                    block[(1, j)] += t * block[(2, j)];
                }
                for i in 0..3 {
                    block[(i, 0)] += t * block[(i, 1)] + half * block[(i, 2)];
                    block[(i, 1)] += t * block[(i, 2)];
                }
                for j in 0..3 {
                    for i in 0..3 {
                        if a == b && i > j {
                            continue;
                        }
                        let grown = block[(i, j)] + if a == b { noise[(i, j)] } else { 0.0 };
                        covariance[(3 * i + a, 3 * j + b)] = grown;
                        covariance[(3 * j + b, 3 * i + a)] = grown;
                    }
                }
            }
        }
        let position = self.position_after(t);
        if !(covariance.sum().is_finite() && position.coords.sum().is_finite()) {
            return false;
        }
        self.position = position;
        self.velocity += self.acceleration * t;
        self.covariance = covariance;
        true
    }

    /// Updates with a pixel, as [`ConstantVelocity::update_pixel`](crate::ConstantVelocity::update_pixel).
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
        self.acceleration += correction.fixed_rows::<3>(6);
        found
    }

    /// Position and velocity.
    pub(crate) fn moving(&self) -> (Vector6<f64>, Matrix6<f64>) {
        let state = stacked(&self.position, &self.velocity);
        (state, self.covariance.fixed_view::<6, 6>(0, 0).into_owned())
    }
}

/// Position and velocity in one vector.
pub(crate) fn stacked(position: &Point3<f64>, velocity: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(position.x, position.y, position.z, velocity.x, velocity.y, velocity.z)
}
