//! Four numbers at a time, and the weights of a cubic B-spline in them.

use std::ops::{Add, Mul};

/// Four numbers, added and multiplied one by one: vector instructions on every machine that has them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Four(pub [f32; 4]);

impl Four {
    #[inline(always)]
    pub(super) fn all(value: f32) -> Self {
        Self([value; 4])
    }

    /// The four of `from` that begin at `at`.
    #[inline(always)]
    pub(super) fn at(from: &[f32], at: usize) -> Self {
        let four = &from[at..at + 4];
        Self([four[0], four[1], four[2], four[3]])
    }

    #[inline(always)]
    pub(super) fn sum(self) -> f32 {
        let [a, b, c, d] = self.0;
        (a + c) + (b + d)
    }
}

impl Add for Four {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let (a, b) = (self.0, other.0);
        Self([a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]])
    }
}

impl Mul for Four {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let (a, b) = (self.0, other.0);
        Self([a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]])
    }
}

/// β³ at the four coefficients around a place, `f` (0 to 1) after the second: (1−f)³, 4−6f²+3f³, 1+3f+3f²−3f³ and f³, over 6.
#[inline(always)]
pub(super) fn weights(f: f32) -> Four {
    const C0: Four = Four([1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0, 0.0]);
    const C1: Four = Four([-0.5, 0.0, 0.5, 0.0]);
    const C2: Four = Four([0.5, -1.0, 0.5, 0.0]);
    const C3: Four = Four([-1.0 / 6.0, 0.5, -0.5, 1.0 / 6.0]);
    let f = Four::all(f);
    ((C3 * f + C2) * f + C1) * f + C0
}

/// Derivatives of [`weights`].
#[inline(always)]
pub(super) fn slopes(f: f32) -> Four {
    const C0: Four = Four([-0.5, 0.0, 0.5, 0.0]);
    const C1: Four = Four([1.0, -2.0, 1.0, 0.0]);
    const C2: Four = Four([-0.5, 1.5, -1.5, 0.5]);
    let f = Four::all(f);
    (C2 * f + C1) * f + C0
}

/// Σ aᵢ bᵢ, in an order that does not depend on anything but the length.
#[inline]
pub(super) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let ((a4, a_rest), (b4, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut sums = [0.0f32; 8];
    for (a, b) in a4.iter().zip(b4) {
        for lane in 0..8 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    rest + ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7]))
}

/// Σ aᵢ.
#[inline]
pub(super) fn sum(a: &[f32]) -> f32 {
    let (a8, rest) = a.as_chunks::<8>();
    let mut sums = [0.0f32; 8];
    for a in a8 {
        for lane in 0..8 {
            sums[lane] += a[lane];
        }
    }
    rest.iter().sum::<f32>() + ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7]))
}
