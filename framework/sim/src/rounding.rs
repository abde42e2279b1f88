//! Rounding in a few plain instructions: a processor of the first x86-64 kind has none for it, and a call for each pixel takes longer than all around it.

/// ⌊x⌋, for numbers that fit in 64 bits; 0 for NaN.
#[inline]
pub(crate) fn floored(x: f64) -> i64 {
    let whole = x as i64;
    whole.saturating_sub(i64::from(whole as f64 > x))
}

/// The nearest whole number, halves away from 0; saturates, and is 0 for NaN.
#[inline]
pub(crate) fn rounded(x: f64) -> i32 {
    let whole = x as i32;
    // What was cut off is exact.
    let beyond = x - f64::from(whole);
    whole.saturating_add(i32::from(beyond >= 0.5)).saturating_sub(i32::from(beyond <= -0.5))
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    #[test]
    fn numbers_are_rounded_as_the_library_does() {
        let mut random = Random::new(8);
        let drawn = (0..20_000).map(|_| random.normal() * 10.0_f64.powf(random.uniform_in(-3.0, 8.0)));
        let halves = (-70_000..70_000).map(|it| f64::from(it) / 2.0);
        let nearly =
            (-70_000..70_000).flat_map(|it| [f64::next_up, f64::next_down].map(|next| next(f64::from(it) / 2.0)));
        let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, -0.0, 5e-324, 2_147_483_647.5];
        for x in drawn.chain(halves).chain(nearly).chain(odd) {
            assert_eq!(rounded(x), x.round() as i32, "{x}");
            assert_eq!(floored(x), x.floor() as i64, "{x}");
        }
    }
}
