//! Numbers as CSV fields, the same bytes for the same values; what is not finite is an empty field.

use std::fmt::Write;

use foveate_diagnostics::fields::number;

/// Writes `value` with `decimals` places and never as `-0`.
pub fn fixed(text: &mut String, value: f64, decimals: usize) {
    let start = text.len();
    // Writing to a string does not fail.
    write!(text, "{}", number(value, decimals)).ok();
    let is_zero = text[start..].bytes().all(|it| matches!(it, b'-' | b'0' | b'.'));
    if is_zero && text[start..].starts_with('-') {
        text.remove(start);
    }
}

/// Writes `value` as `1.500000e-05`: six decimals, at least two digits of exponent.
pub fn scientific(text: &mut String, value: f64) {
    if !value.is_finite() {
        return;
    }
    let plain = format!("{:.6e}", if value == 0.0 { 0.0 } else { value });
    match plain.split_once('e') {
        Some((mantissa, exponent)) => {
            let (sign, digits) = exponent.strip_prefix('-').map_or(('+', exponent), |digits| ('-', digits));
            write!(text, "{mantissa}e{sign}{digits:0>2}").ok();
        }
        None => text.push_str(&plain),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_one_form() {
        let form = |value: f64| {
            let (mut plain, mut power) = (String::new(), String::new());
            fixed(&mut plain, value, 3);
            scientific(&mut power, value);
            (plain, power)
        };
        let both = |plain: &str, power: &str| (plain.to_owned(), power.to_owned());
        assert_eq!(form(-0.0001), both("0.000", "-1.000000e-04"));
        assert_eq!(form(-0.0), both("0.000", "0.000000e+00"));
        assert_eq!(form(12_345.678_9), both("12345.679", "1.234568e+04"));
        assert_eq!(form(-1e-120), both("0.000", "-1.000000e-120"));
        assert_eq!([f64::NAN, -f64::INFINITY].map(form), [both("", ""), both("", "")]);
    }
}
