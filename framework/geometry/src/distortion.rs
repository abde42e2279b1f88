//! Brown–Conrady lens distortion in normalised image coordinates, forward, with its derivative, and back.
//!
//! Source: D. C. Brown, "Decentering distortion of lenses", Photogrammetric Engineering 32(3), 1966, in the
//! parametrisation that OpenCV and MultiCamSelfCal use. With (x, y) ideal, s = x² + y² and f = 1 + k₁s + k₂s² + k₃s³:
//!
//! x' = x f + 2p₁xy + p₂(s + 2x²),  y' = y f + p₁(s + 2y²) + 2p₂xy.
//!
//! The radius r f(r²) of real lenses grows with r; the polynomial in general only does up to some radius, beyond which
//! it turns back and one distorted point has several ideal ones. The *domain* here ends before that. The derivative of
//! the map is symmetric, so the map is the gradient of a potential, and one-to-one on any disc on which that is
//! strictly convex. The radial terms contribute at least the least value of g(s) = d(r f)/dr = 1 + 3k₁s + 5k₂s² +
//! 7k₃s³ on the way out; the decentering terms subtract at most 6r√(p₁² + p₂²). A point is in the domain when the
//! former exceeds the latter. Without decentering that is exactly the disc up to the turning point; with it, the disc
//! is slightly too small.

use nalgebra::{Matrix2, Vector2};

/// Distortion coefficients for normalised coordinates (radius 1 = 45° off the axis), without unit. The default is no distortion.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distortion {
    /// Radial coefficient of r².
    pub k1: f64,
    /// Radial coefficient of r⁴.
    pub k2: f64,
    /// Decentering (tangential) coefficient, vertical.
    pub p1: f64,
    /// Decentering (tangential) coefficient, horizontal.
    pub p2: f64,
    /// Radial coefficient of r⁶.
    pub k3: f64,
}

/// How far [`Distortion::undistort`] may be from the exact answer, relative to 1 + |distorted| (normalised units).
const UNDISTORT_TOLERANCE: f64 = 1e-13;
/// Points at or beyond this squared radius, a millionth of a radian off the plane of the camera's centre, are not in view.
const FARTHEST: f64 = 1e12;

impl Distortion {
    /// Distorts an ideal (undistorted) point; `None` outside the domain (see the module) or when not finite.
    #[inline]
    pub fn distort(&self, ideal: &Vector2<f64>) -> Option<Vector2<f64>> {
        self.distort_with_jacobian(ideal).map(|(distorted, _)| distorted)
    }

    /// As [`Self::distort`], with the derivative of the distorted by the ideal point.
    #[inline]
    pub fn distort_with_jacobian(&self, ideal: &Vector2<f64>) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        let Distortion { k1, k2, p1, p2, k3 } = *self;
        let (x, y) = (ideal.x, ideal.y);
        let s = x * x + y * y;
        let radial = 1.0 + s * (k1 + s * (k2 + s * k3));
        let twice_slope = 2.0 * (k1 + s * (2.0 * k2 + s * (3.0 * k3))); // 2 df/ds
        let distorted = Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
            y * radial + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = twice_slope * x * y + 2.0 * (p1 * x + p2 * y);
        let xx = radial + twice_slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x;
        let yy = radial + twice_slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x;
        self.has_in_domain(s).then_some((distorted, Matrix2::new(xx, cross, cross, yy)))
    }

    /// Inverts [`Self::distort`] by Newton's method, with steps shortened until they stay in the domain and come
    /// closer; `None` when nothing in the domain is distorted to `distorted`.
    pub fn undistort(&self, distorted: &Vector2<f64>) -> Option<Vector2<f64>> {
        if *self == Distortion::default() {
            return distorted.iter().all(|it| it.is_finite()).then_some(*distorted);
        }
        let tolerance = UNDISTORT_TOLERANCE * (1.0 + distorted.norm());
        let mut ideal = *distorted;
        let mut at_ideal = self.distort_with_jacobian(&ideal);
        for _ in 0..60 {
            if at_ideal.is_some() {
                break;
            }
            ideal *= 0.5; // the centre is always in the domain
            at_ideal = self.distort_with_jacobian(&ideal);
        }
        let (mut image, mut slope) = at_ideal?;
        for _ in 0..100 {
            let residual = distorted - image;
            let error = residual.norm();
            if error <= tolerance {
                return Some(ideal);
            }
            let mut step = slope.try_inverse()? * residual;
            let closer = (0..40).find_map(|_| {
                let candidate = ideal + step;
                step *= 0.5;
                let there = self.distort_with_jacobian(&candidate)?;
                ((distorted - there.0).norm() < error).then_some((candidate, there))
            });
            (ideal, (image, slope)) = closer?;
        }
        None
    }

    /// The squared radius at which the domain ends: the least that has no image.
    pub(crate) fn domain(&self) -> f64 {
        let (mut inside, mut outside) = (0.0, FARTHEST);
        // 100 halvings of 10¹² leave less than the rounding of any radius that matters.
        for _ in 0..100 {
            let middle = 0.5 * (inside + outside);
            if self.has_in_domain(middle) { inside = middle } else { outside = middle }
        }
        outside
    }

    /// Whether points at the squared radius `s` are in the domain; not, if a number is not finite.
    #[inline]
    fn has_in_domain(&self, s: f64) -> bool {
        let Distortion { k1, k2, p1, p2, k3 } = *self;
        let radial = 1.0 + s * (3.0 * k1.min(0.0) + s * (5.0 * k2.min(0.0) + s * 7.0 * k3.min(0.0)));
        let decentering = 3.0 * (p1.abs() + p2.abs()) * (1.0 + s); // since 2r <= 1 + r²
        // Both bounds only worsen with s, so that they hold on the way out as well; most points end here.
        s < FARTHEST && (radial > decentering || self.is_convex_up_to(s))
    }

    /// The exact condition: g is least at an end of 0..=s, or where its derivative 3k₁ + 10k₂s + 21k₃s² is zero.
    #[cold]
    fn is_convex_up_to(&self, s: f64) -> bool {
        let Distortion { k1, k2, p1, p2, k3 } = *self;
        let needed = 6.0 * (s * (p1 * p1 + p2 * p2)).sqrt();
        let growth = |at: f64| 1.0 + at * (3.0 * k1 + at * (5.0 * k2 + at * 7.0 * k3));
        let (a, half_b, c) = (21.0 * k3, 5.0 * k2, 3.0 * k1);
        let root = (half_b * half_b - a * c).max(0.0).sqrt();
        let q = -(half_b + root.copysign(half_b)); // q/a and c/q are the two roots, without cancellation
        let inner = [q / a, c / q].into_iter().filter(|at| *at > 0.0 && *at < s);
        inner.chain([0.0, s]).all(|at| growth(at) > needed)
    }
}
