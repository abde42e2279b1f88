//! Robust losses: functions of a residual under which outliers pull less than inliers.
//!
//! s is the squared length of a residual in units of its standard deviation, the cost of the residual is ½ ρ(s), and its weight in
//! the normal equations ρ'(s). Source: B. Triggs et al., "Bundle adjustment: a modern synthesis", 2000, §3.3; the
//! tuning constants are those of P. Holland and R. Welsch, "Robust regression using iteratively reweighted least-squares", 1977.

/// A loss ρ with ρ(0) = 0 and ρ'(0) = 1; scales are in standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// ρ = s: ordinary least squares.
    Squared,
    /// ρ = s up to `scale`², beyond it 2 scale √s − scale²: grows linearly with the distance.
    Huber {
        /// Where the square ends [σ].
        scale: f64,
    },
    /// ρ = scale² ln(1 + s/scale²): the pull of a far outlier vanishes.
    Cauchy {
        /// Where the weight has fallen to one half [σ].
        scale: f64,
    },
}

impl Loss {
    /// Huber's loss at 95 % efficiency for Gaussian residuals.
    pub const HUBER: Loss = Loss::Huber { scale: 1.345 };
    /// Cauchy's loss at 95 % efficiency for Gaussian residuals.
    pub const CAUCHY: Loss = Loss::Cauchy { scale: 2.385 };

    /// ρ(s) and ρ'(s) at the squared residual s.
    #[inline]
    pub fn at(&self, squared: f64) -> (f64, f64) {
        match *self {
            Loss::Squared => (squared, 1.0),
            Loss::Huber { scale } if squared <= scale * scale => (squared, 1.0),
            Loss::Huber { scale } => {
                let distance = squared.sqrt();
                (2.0 * scale * distance - scale * scale, scale / distance)
            }
            Loss::Cauchy { scale } => {
                let relative = squared / (scale * scale);
                (scale * scale * relative.ln_1p(), 1.0 / (1.0 + relative))
            }
        }
    }

    /// The scale, if it is not a finite number above 0.
    pub fn bad_scale(&self) -> Option<f64> {
        match *self {
            Loss::Squared => None,
            Loss::Huber { scale } | Loss::Cauchy { scale } => Some(scale).filter(|it| !(it.is_finite() && *it > 0.0)),
        }
    }
}

#[cfg(test)]
mod tests {
    use foveate_laws::check_jacobian;
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_weight_is_the_slope_of_the_loss(squared in 1e-3..1e4_f64, scale in 0.1..10.0_f64) {
            for loss in [Loss::Squared, Loss::Huber { scale }, Loss::Cauchy { scale }] {
                let (value, weight) = loss.at(squared);
                check_jacobian(|it| vec![loss.at(it[0]).0], &DMatrix::from_element(1, 1, weight), &[squared], 1e-5);
                prop_assert!(value <= squared * (1.0 + 1e-12));
            }
        }
    }

    #[test]
    fn losses_start_at_zero_with_slope_one() {
        for loss in [Loss::Squared, Loss::HUBER, Loss::CAUCHY] {
            assert_eq!(loss.at(0.0), (0.0, 1.0));
        }
        assert_eq!(Loss::Huber { scale: -1.0 }.bad_scale(), Some(-1.0));
        assert_eq!(Loss::CAUCHY.bad_scale(), None);
    }
}
