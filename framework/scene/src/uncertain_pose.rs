//! Rigid transforms with their uncertainty.
//!
//! The covariance of a pose is that of δ in T ⊕ δ = T exp(δ), δ = (rotation [rad], translation [m]), so that with the adjoint Ad of the
//! transforms
//!
//! Σ(T₁T₂) = Ad(T₂⁻¹) Σ₁ Ad(T₂⁻¹)ᵀ + Σ₂,  Σ(T⁻¹) = Ad(T) Σ Ad(T)ᵀ
//!
//! to first order, for independent errors (T. Barfoot and P. Furgale, "Associating uncertainty with three-dimensional
//! poses", IEEE T-RO 30(3), 2014, with their left perturbation turned into a right one).

use nalgebra::{Isometry3, Matrix3, Matrix6, Point3};

/// A rigid transform and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UncertainPose {
    /// `b_from_a`, as the place where it stands says.
    pub transform: Isometry3<f64>,
    /// Of δ in `transform` ∘ exp(δ), (rotation, translation) [rad², rad m, m²].
    pub covariance: Matrix6<f64>,
}

impl UncertainPose {
    /// A transform without uncertainty.
    pub fn exact(transform: Isometry3<f64>) -> UncertainPose {
        UncertainPose { transform, covariance: Matrix6::zeros() }
    }

    /// `c_from_a`, where `self` is `c_from_b`.
    pub fn then_from(&self, b_from_a: &UncertainPose) -> UncertainPose {
        let carry = adjoint(&b_from_a.transform.inverse());
        UncertainPose {
            transform: self.transform * b_from_a.transform,
            covariance: carry * self.covariance * carry.transpose() + b_from_a.covariance,
        }
    }

    /// `a_from_b`, where `self` is `b_from_a`.
    pub fn inverse(&self) -> UncertainPose {
        let carry = adjoint(&self.transform);
        UncertainPose { transform: self.transform.inverse(), covariance: carry * self.covariance * carry.transpose() }
    }

    /// A point of `a`, known to `covariance` [m²], in the coordinates of `b`, where `self` is `b_from_a`.
    pub fn transform_point(&self, point_in_a: &Point3<f64>, covariance: &Matrix3<f64>) -> (Point3<f64>, Matrix3<f64>) {
        let rotation = self.transform.rotation.to_rotation_matrix();
        let mut by_pose = nalgebra::Matrix3x6::zeros();
        by_pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&-point_in_a.coords.cross_matrix());
        by_pose.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
        let spread = by_pose * self.covariance * by_pose.transpose() + covariance;
        (self.transform * point_in_a, rotation.matrix() * spread * rotation.matrix().transpose())
    }

    /// `share` of the way to `other`, 0 ≤ share ≤ 1.
    pub(crate) fn towards(&self, other: &UncertainPose, share: f64) -> UncertainPose {
        let (from, to) = (&self.transform, &other.transform);
        let arc = from.rotation.rotation_to(&to.rotation).scaled_axis(); // in the parent, of length up to π
        let rotation = nalgebra::UnitQuaternion::from_scaled_axis(arc * share) * from.rotation;
        let translation = from.translation.vector.lerp(&to.translation.vector, share);
        UncertainPose {
            transform: Isometry3::from_parts(translation.into(), rotation),
            covariance: self.covariance * (1.0 - share) + other.covariance * share,
        }
    }
}

/// Ad(T) with T exp(δ) = exp(Ad(T) δ) T, δ = (rotation, translation).
fn adjoint(transform: &Isometry3<f64>) -> Matrix6<f64> {
    let rotation = transform.rotation.to_rotation_matrix();
    let mut adjoint = Matrix6::zeros();
    adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation.matrix());
    adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation.matrix());
    let lever = transform.translation.vector.cross_matrix() * rotation.matrix();
    adjoint.fixed_view_mut::<3, 3>(3, 0).copy_from(&lever);
    adjoint
}
