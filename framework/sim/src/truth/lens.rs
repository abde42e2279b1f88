//! What a real lens does beyond the five coefficients that calibrations fit: higher radial terms, a thin prism, a sensor that is tilted.
//!
//! The terms are those of the OpenCV manual's full camera model (calib3d, "Detailed description": s₁…s₄ and τₓ, τᵧ; radial of r⁸ after them), applied to the
//! distorted normalised coordinates. Sizes are small, so that the inverse is found by iterating.

use nalgebra::{Matrix3, Point2, Rotation3, Vector2, Vector3};

use foveate_geometry::Intrinsics;

/// Iterations of the inverse; each takes away all but a hundredth of what is left, for the lenses that are drawn.
const ITERATIONS: usize = 12;
/// A map of distorted normalised coordinates onto the sensor's own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Radial, of r⁸.
    pub k4: f64,
    /// Thin prism: of r² along x and y, of r⁴ along x and y.
    pub prism: [f64; 4],
    /// Tilt of the sensor about its x and y axes [rad].
    pub tilt: [f64; 2],
    /// Beyond this radius radial term and prism stay as they are there: they say what happens on the sensor, and what lies beside it must not be bent onto it
    /// [normalised].
    pub widest: f64,
}

impl Lens {
    /// Where what a plain lens images at `pixel` really falls.
    pub(crate) fn bend(&self, intrinsics: &Intrinsics, pixel: Point2<f64>) -> Point2<f64> {
        to_pixel(intrinsics, self.bend_normalised(&from_pixel(intrinsics, pixel)))
    }

    /// Which pixel of a plain lens falls on `pixel`.
    pub(crate) fn unbend(&self, intrinsics: &Intrinsics, pixel: Point2<f64>) -> Point2<f64> {
        let wanted = from_pixel(intrinsics, pixel);
        let mut found = wanted;
        for _ in 0..ITERATIONS {
            found += wanted - self.bend_normalised(&found);
        }
        to_pixel(intrinsics, found)
    }

    pub(crate) fn bend_normalised(&self, place: &Vector2<f64>) -> Vector2<f64> {
        let square = place.norm_squared().min(self.widest * self.widest);
        let [x2, y2, x4, y4] = self.prism;
        let bent = place * (1.0 + self.k4 * square.powi(4))
            + Vector2::new(square * (x2 + square * x4), square * (y2 + square * y4));
        let rotation = Rotation3::from_axis_angle(&Vector3::y_axis(), self.tilt[1])
            * Rotation3::from_axis_angle(&Vector3::x_axis(), self.tilt[0]);
        let r = rotation.matrix();
        let onto = Matrix3::new(r[(2, 2)], 0.0, -r[(0, 2)], 0.0, r[(2, 2)], -r[(1, 2)], 0.0, 0.0, 1.0);
        let on_sensor = onto * r * Vector3::new(bent.x, bent.y, 1.0);
        Vector2::new(on_sensor.x, on_sensor.y) / on_sensor.z
    }
}

fn from_pixel(intrinsics: &Intrinsics, pixel: Point2<f64>) -> Vector2<f64> {
    let Intrinsics { focal, principal, skew } = *intrinsics;
    let y = (pixel.y - principal[1]) / focal[1];
    Vector2::new((pixel.x - principal[0] - skew * y) / focal[0], y)
}

fn to_pixel(intrinsics: &Intrinsics, place: Vector2<f64>) -> Point2<f64> {
    let Intrinsics { focal, principal, skew } = *intrinsics;
    Point2::new(focal[0] * place.x + skew * place.y + principal[0], focal[1] * place.y + principal[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: Lens = Lens { k4: 4e-3, prism: [6e-4, -4e-4, 2e-4, 3e-4], tilt: [4e-3, -6e-3], widest: 1.2 };

    fn intrinsics() -> Intrinsics {
        Intrinsics { focal: [425.0, 212.5], principal: [322.6, 117.7], skew: 0.4 }
    }

    #[test]
    fn bending_and_unbending_are_inverse_all_over_a_picture() {
        for column in (-20..=660).step_by(40) {
            for row in (-10..=250).step_by(20) {
                let pixel = Point2::new(f64::from(column), f64::from(row));
                let back = LENS.unbend(&intrinsics(), LENS.bend(&intrinsics(), pixel));
                assert!((back - pixel).norm() < 1e-9, "{pixel} {back}");
            }
        }
    }

    #[test]
    fn what_lies_beside_the_picture_of_a_narrow_lens_stays_there() {
        // A tenth of a pixel at the side of a picture that is seven degrees wide.
        let (focal, side): (f64, f64) = (3400.0, 320.0 / 3400.0);
        let narrow = Intrinsics { focal: [focal; 2], principal: [319.5, 239.5], skew: 0.0 };
        for sign in [-1.0, 1.0] {
            let k4 = sign * 0.1 / focal / side.powi(9);
            let lens = Lens { k4, prism: [0.0; 4], tilt: [0.0; 2], widest: 1.3 * side };
            assert!(((lens.bend(&narrow, Point2::new(639.5, 239.5)).x - 639.5) - sign * 0.1).abs() < 1e-9);
            for column in [800.0, 2000.0, 10_000.0] {
                let bent = lens.bend(&narrow, Point2::new(column, 239.5)).x;
                assert!((bent - column).abs() < 0.02 * column, "{column} {bent}");
            }
        }
    }

    #[test]
    fn a_lens_without_errors_changes_nothing_and_others_pixels() {
        let none = Lens { k4: 0.0, prism: [0.0; 4], tilt: [0.0; 2], widest: 1.0 };
        let corner = Point2::new(3.0, 2.0);
        assert!((none.bend(&intrinsics(), corner) - corner).norm() < 1e-12);
        let off = (LENS.bend(&intrinsics(), corner) - corner).norm();
        assert!((0.3..6.0).contains(&off), "{off} px");
        let middle = Point2::new(322.6, 117.7);
        assert!((LENS.bend(&intrinsics(), middle) - middle).norm() < 1e-9, "the principal point stays");
    }
}
