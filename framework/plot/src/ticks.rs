//! Ticks: positions and texts of the numbers at an axis, in round steps.

use crate::axes::{Range, Span};
use crate::text::{fixed, power_of_ten};

/// The longest number that is written out [characters].
const LONGEST: usize = 7;

/// The smallest of 1, 2, 5, 10, … that is at least `least`; 1 where `least` is not positive and finite.
pub fn round_step(least: f64) -> f64 {
    steps_around(least, least).into_iter().find(|it| *it >= least * (1.0 - 1e-9)).unwrap_or(1.0)
}

/// The largest of 1, 2, 5, 10, … that is at most `most`; 1 where `most` is not positive and finite.
pub fn round_step_below(most: f64) -> f64 {
    steps_around(most, most).into_iter().rev().find(|it| *it <= most * (1.0 + 1e-9)).unwrap_or(1.0)
}

/// 1, 2 and 5 times the powers of ten from that of `low` to beyond that of `high`; nothing where they are not positive.
fn steps_around(low: f64, high: f64) -> Vec<f64> {
    if !(low > 1e-300 && high < 1e300 && low <= high) {
        return Vec::new();
    }
    let powers = low.log10().floor() as i32..=high.log10().floor() as i32 + 1;
    // A power of ten from its text is exact; from `powi` it is not.
    let power = |exponent: i32| format!("1e{exponent}").parse::<f64>().unwrap_or(1.0);
    powers.flat_map(|exponent| [1.0, 2.0, 5.0].map(|it| it * power(exponent))).collect()
}

/// Ticks of an axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Ticks {
    /// Tick values, ascending.
    pub values: Vec<f64>,
    /// Text of each tick.
    pub texts: Vec<String>,
    /// Suffix for the axis label: a power of ten or an offset; mostly empty.
    pub suffix: String,
}

impl Ticks {
    /// At most about `n` ticks along `span`; `step`: at its multiples, unless these are too many.
    pub fn of(span: &Span, n: f64, step: Option<f64>) -> Self {
        let Range { min, max } = span.range;
        if span.log {
            return Self::logarithmic(min, max, n.max(2.0) as usize);
        }
        let step = step.filter(|it| *it > 0.0).unwrap_or_else(|| round_step((max - min) / n.max(1.0)));
        let (first, last) = ((min / step - 1e-6).ceil(), (max / step + 1e-6).floor());
        let count = last - first + 1.0;
        if !(0.0..=1000.0).contains(&count) {
            return Self::default();
        }
        let values: Vec<f64> = (0..count as i64).map(|index| (first + index as f64) * step).collect();
        let (texts, suffix) = written(&values, step);
        Self { values, texts, suffix }
    }

    /// At powers of ten, and at 1, 2 and 5 times them where there are few.
    fn logarithmic(min: f64, max: f64, n: usize) -> Self {
        let decades = max.log10() - min.log10();
        let every = (decades / n as f64).ceil().max(1.0) as i64;
        let is_inside = |it: &f64| (min * 0.999..=max * 1.001).contains(it);
        let values: Vec<f64> = steps_around(min, max)
            .into_iter()
            .enumerate()
            .filter(|(index, _)| decades < 2.3 || index % 3 == 0)
            .map(|it| it.1)
            .filter(is_inside)
            .filter(|it| decades < 2.3 || (it.log10().round() as i64).rem_euclid(every) == 0)
            .collect();
        let texts = values.iter().map(|it| power_text(*it)).collect();
        Self { values, texts, suffix: String::new() }
    }

    /// Length of the longest text [characters].
    pub fn longest(&self) -> usize {
        self.texts.iter().map(|it| it.chars().count()).max().unwrap_or(0)
    }
}

/// 1, 2 or 5 times a power of ten.
fn power_text(value: f64) -> String {
    let exponent = (value.log10() + 1e-9).floor() as i32;
    if (-4..5).contains(&exponent) {
        return fixed(value, (-exponent).max(0) as usize);
    }
    match (value / 10_f64.powi(exponent)).round() as i32 {
        1 => power_of_ten(exponent),
        factor => format!("{factor}·{}", power_of_ten(exponent)),
    }
}

/// Multiples of `step`: written out where that is short, or else as parts of a power of ten, less an offset where even that is long.
fn written(values: &[f64], step: f64) -> (Vec<String>, String) {
    let decimals = |step: f64| (-step.log10() - 1e-9).ceil().clamp(0.0, 17.0) as usize;
    let write = |offset: f64, exponent: i32| -> Vec<String> {
        let unit = 10_f64.powi(exponent);
        values.iter().map(|it| fixed((it - offset) / unit, decimals(step / unit))).collect()
    };
    let is_short = |texts: &[String]| texts.iter().all(|it| it.chars().count() <= LONGEST);
    let size = |offset: f64| values.iter().map(|it| (it - offset).abs()).fold(step, f64::max);
    let exponent = |offset: f64| (3.0 * (size(offset).log10() / 3.0 + 1e-9).floor()).clamp(-300.0, 300.0) as i32;
    let plain = size(0.0) < 1e6 && step > 1e-6;
    if plain && is_short(&write(0.0, 0)) {
        return (write(0.0, 0), String::new());
    }
    let of_zero = exponent(0.0);
    if is_short(&write(0.0, of_zero)) {
        return (write(0.0, of_zero), format!(" · {}", power_of_ten(of_zero)));
    }
    let offset = values.first().copied().unwrap_or(0.0);
    let small = (1e-3..1e6).contains(&size(offset)) && is_short(&write(offset, 0));
    let unit = if small { 0 } else { exponent(offset) };
    let power = if unit == 0 { String::new() } else { format!(" · {}", power_of_ten(unit)) };
    (write(offset, unit), format!("{power} from {offset}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ticks(min: f64, max: f64, n: f64) -> Ticks {
        Ticks::of(&Span::linear(Range { min, max }), n, None)
    }

    #[test]
    fn steps_are_one_two_five() {
        let steps = [0.9, 1.0, 1.1, 2.5, 6.0, 0.0, f64::NAN, f64::INFINITY].map(round_step);
        assert_eq!(steps, [1.0, 1.0, 2.0, 5.0, 10.0, 1.0, 1.0, 1.0]);
        let below = [0.9, 1.0, 1.1, 2.5, 6.0, 0.0, -3.0].map(round_step_below);
        assert_eq!(below, [0.5, 1.0, 1.0, 2.0, 5.0, 1.0, 1.0]);
    }

    #[test]
    fn ticks_are_round_and_lie_within() {
        let wide = ticks(-1.75, 1.75, 4.0);
        assert_eq!(
            (wide.values, wide.texts),
            (vec![-1.0, 0.0, 1.0], ["\u{2212}1", "0", "1"].map(String::from).to_vec())
        );
        assert_eq!(ticks(0.0, 0.1, 5.0).texts, ["0.00", "0.02", "0.04", "0.06", "0.08", "0.10"]);
        assert_eq!(ticks(0.0, 60.0, 6.0).values, [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]);
        assert_eq!(ticks(5.0, 5.0, 4.0).suffix, "");
    }

    #[test]
    fn numbers_stay_short_and_different_whatever_the_range() {
        for (min, max) in [
            (0.0, 1e9),
            (-3e-9, 5e-9),
            (1e9, 1e9 + 1.0),
            (1.7e9, 1.7e9 + 3600.0),
            (1e15, 1e15 + 8.0),
            (-1e300, 1e300),
            (0.0, 1e-280),
            (123_456.0, 123_456.01),
            (-0.5, 12_345.0),
        ] {
            let it = ticks(min, max, 5.0);
            assert!((2..=12).contains(&it.values.len()), "{min} to {max}: {it:?}");
            assert!(it.longest() <= 9, "{min} to {max}: {it:?}");
            assert!(it.texts.windows(2).all(|pair| pair[0] != pair[1]), "{min} to {max}: {it:?}");
        }
        assert_eq!(ticks(0.0, 3e9, 4.0).suffix, " · 10⁹");
        assert_eq!(ticks(1e9, 1e9 + 1.0, 4.0).suffix, " from 1000000000");
    }

    #[test]
    fn logarithmic_axes_have_two_numbers_at_least_and_no_more_than_fit() {
        let of = |min: f64, max: f64, n: f64| Ticks::of(&Span::logarithmic(Range { min, max }), n, None).texts;
        assert_eq!(of(1.0, 20.0, 8.0), ["1", "2", "5", "10", "20"]);
        assert_eq!(of(0.01, 1000.0, 8.0), ["0.01", "0.1", "1", "10", "100", "1000"]);
        assert_eq!(of(3.0, 3.0, 8.0), ["1", "2", "5", "10"]);
        let many = of(1e-200, 1e200, 6.0);
        assert!((3..=8).contains(&many.len()) && many.iter().all(|it| it.starts_with("10") || it == "1"), "{many:?}");
    }
}
