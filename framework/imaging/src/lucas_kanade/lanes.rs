//! Four numbers at a time: the compiler turns these into vector instructions on every machine that has them.

use std::ops::{Add, AddAssign, Mul, Sub};

/// Four numbers, added and multiplied one by one.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Lanes(pub [f32; 4]);

/// Numbers in [`Lanes`].
pub(super) const N: usize = 4;

impl Lanes {
    #[inline(always)]
    pub(super) fn all(value: f32) -> Self {
        Self([value; N])
    }

    /// The four from `at` on.
    #[inline(always)]
    pub(super) fn load<const S: usize>(row: &[f32; S], at: usize) -> Self {
        Self([row[at], row[at + 1], row[at + 2], row[at + 3]])
    }

    #[inline(always)]
    pub(super) fn store<const S: usize>(self, row: &mut [f32; S], at: usize) {
        row[at..at + N].copy_from_slice(&self.0);
    }

    pub(super) fn sum(self) -> f64 {
        self.0.iter().map(|it| f64::from(*it)).sum()
    }
}

impl Add for Lanes {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let (a, b) = (self.0, other.0);
        Self([a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]])
    }
}

impl Sub for Lanes {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let (a, b) = (self.0, other.0);
        Self([a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]])
    }
}

impl Mul for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let (a, b) = (self.0, other.0);
        Self([a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]])
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}
