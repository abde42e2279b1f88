//! Fields of CSV files, the same bytes for the same values.

use std::fmt::Write;

use foveate::prelude::*;

/// Writes `value` with `decimals` places and never as `-0`.
pub(crate) fn fixed(text: &mut String, value: f64, decimals: usize) {
    let start = text.len();
    // Writing to a string does not fail.
    write!(text, "{value:.decimals$}").ok();
    let is_zero = text[start..].bytes().all(|it| matches!(it, b'-' | b'0' | b'.'));
    if is_zero && text[start..].starts_with('-') {
        text.remove(start);
    }
}

/// Writes `value` as `1.500000e-05`: six decimals, at least two digits of exponent.
pub(crate) fn scientific(text: &mut String, value: f64) {
    let plain = format!("{:.6e}", if value == 0.0 { 0.0 } else { value });
    match plain.split_once('e') {
        Some((mantissa, exponent)) => {
            let (sign, digits) = exponent.strip_prefix('-').map_or(('+', exponent), |digits| ('-', digits));
            write!(text, "{mantissa}e{sign}{digits:0>2}").ok();
        }
        None => text.push_str(&plain),
    }
}

/// A text field, in quotes where it must be.
pub(crate) fn field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) || text.starts_with('#') {
        return format!("\"{}\"", text.replace('"', "\"\"").replace(['\n', '\r'], " "));
    }
    text.to_owned()
}

/// The names of all cameras of a setup as they stand in files; `+` joins them, so it becomes `_` within one.
pub(crate) fn camera_names(setup: &Setup) -> Vec<String> {
    setup.calibration.cameras.iter().map(|it| it.name.replace('+', "_")).collect()
}

/// A name as part of a file's name: letters, digits, `-`, `_` and `.` stay.
pub(crate) fn file_part(name: &str) -> String {
    let kept = |it: char| it.is_alphanumeric() || matches!(it, '-' | '_' | '.');
    let part: String = name.chars().map(|it| if kept(it) { it } else { '_' }).collect();
    part.trim_start_matches('.').to_owned()
}

/// Refuses what is not the plain name of a file.
pub(crate) fn check_file_name(setting: &str, name: &str) -> Result<(), ConfigError> {
    if name.is_empty() || file_part(name) != name {
        let rule = "expected a plain file name: letters, digits, `-`, `_` and `.`, without folders";
        return Err(ConfigError::at(setting, format_args!("found `{name}`, {rule}")));
    }
    Ok(())
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
        assert_eq!(form(f64::NAN), both("NaN", "NaN"));
    }

    #[test]
    fn names_stay_inside_their_field_and_their_folder() {
        assert_eq!(field("wide-1"), "wide-1");
        assert_eq!(field("a,\"b\""), "\"a,\"\"b\"\"\"");
        assert_eq!(file_part("../wide 1/é"), "_wide_1_é");
        assert!(check_file_name("file", "targets.csv").is_ok());
        for wrong in ["", "..", "a/b.csv", ".hidden", "/etc/passwd"] {
            assert!(check_file_name("file", wrong).is_err(), "{wrong}");
        }
    }
}
