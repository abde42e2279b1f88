//! Escaped texts and formatted numbers for figures and pages.

use std::fmt::Write;

/// `text` escaped for XML and HTML, between tags and in attributes. Characters that XML cannot hold become spaces.
pub fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\'' => escaped += "&#39;",
            '\u{fffe}' | '\u{ffff}' => escaped.push(' '),
            control if control.is_control() => escaped.push(' '),
            other => escaped.push(other),
        }
    }
    escaped
}

/// Approximate width of a text [px]; a little more than common fonts need.
pub fn text_width(text: &str, size: f64) -> f64 {
    // Scripts from the CJK radicals on fill a square.
    let widths = text.chars().map(|letter| if letter >= '\u{2e80}' { 1.0 } else { 0.58 });
    size * widths.sum::<f64>()
}

/// `text`, cut with an ellipsis where it is wider than `width` [px].
pub fn fitted(text: &str, size: f64, width: f64) -> String {
    if text_width(text, size) <= width {
        return text.to_owned();
    }
    let mut kept = String::new();
    for letter in text.chars() {
        kept.push(letter);
        if text_width(&kept, size) + text_width("…", size) > width {
            kept.pop();
            break;
        }
    }
    kept.truncate(kept.trim_end().len());
    kept + "…"
}

/// The label of an axis, cut before its unit where it is wider than `width` [px].
pub(crate) fn fitted_label(label: &str, size: f64, width: f64) -> String {
    let (words, unit) = label.rfind('[').map_or((label, ""), |at| label.split_at(at));
    if unit.is_empty() || text_width(label, size) <= width {
        return fitted(label, size, width);
    }
    format!("{} {unit}", fitted(words.trim_end(), size, width - text_width(unit, size) - 0.58 * size))
}

/// A number with `digits` decimals, a minus as wide as a digit and no `-0`; a dash where it is not finite.
pub fn fixed(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let text = format!("{value:.digits$}");
    let is_zero = text.bytes().all(|it| matches!(it, b'-' | b'0' | b'.'));
    if is_zero { text.replace('-', "") } else { text.replace('-', "\u{2212}") }
}

/// A number with three significant digits.
pub fn rounded(value: f64) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let size = value.abs();
    if size != 0.0 && !(1e-4..1e6).contains(&size) {
        return format!("{value:.2e}").replace('-', "\u{2212}");
    }
    let before = if size < 1e-12 { 0 } else { size.log10().floor() as i32 };
    fixed(value, (2 - before).clamp(0, 7) as usize)
}

/// A whole number with thin spaces between thousands.
pub fn count(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) && digits.len() > 4 {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

/// A power of ten: `10⁻⁶`.
pub fn power_of_ten(exponent: i32) -> String {
    const RAISED: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let digits = exponent.to_string();
    let raised = digits.chars().map(|it| it.to_digit(10).map_or('⁻', |digit| RAISED[digit as usize]));
    format!("10{}", raised.collect::<String>())
}

/// Number of tenths in `value`, which is a coordinate or a length [px]: always finite, never beyond what viewers can take.
pub(crate) fn tenths(value: f64) -> i64 {
    if value.is_nan() { 0 } else { (value.clamp(-1e5, 1e5) * 10.0).round() as i64 }
}

/// Appends a number of tenths, as coordinates are written.
pub(crate) fn push_tenths(text: &mut String, tenths: i64) {
    let sign = if tenths < 0 { "-" } else { "" };
    let (whole, rest) = (tenths.abs() / 10, tenths.abs() % 10);
    // Writing to a String cannot fail.
    let _ = if rest == 0 { write!(text, "{sign}{whole}") } else { write!(text, "{sign}{whole}.{rest}") };
}

/// A coordinate or a length [px], with one digit after the point, or none where that is 0.
pub(crate) fn coordinate(value: f64) -> String {
    let mut text = String::new();
    push_tenths(&mut text, tenths(value));
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escaped_text_holds_nothing_that_breaks_a_tag_or_an_attribute() {
        assert_eq!(escaped("a<b> & \"c\" 'd'\u{1}\u{ffff}e"), "a&lt;b&gt; &amp; &quot;c&quot; &#39;d&#39;  e");
    }

    #[test]
    fn numbers_have_a_proper_minus_and_are_dashes_where_they_are_none() {
        assert_eq!([fixed(-0.5, 1), fixed(-0.01, 1), fixed(2.0, 0)], ["\u{2212}0.5", "0.0", "2"]);
        assert_eq!([fixed(f64::NAN, 2), rounded(f64::INFINITY)], ["–", "–"]);
        assert_eq!([rounded(1234.5), rounded(0.012345), rounded(-2e-7)], ["1234", "0.0123", "\u{2212}2.00e\u{2212}7"]);
        assert_eq!(
            [count(4000), count(20_000), count(1_234_567)],
            ["4000", "20\u{202f}000", "1\u{202f}234\u{202f}567"]
        );
        assert_eq!([power_of_ten(6), power_of_ten(-12)], ["10⁶", "10⁻¹²"]);
    }

    #[test]
    fn coordinates_are_finite_whatever_they_were() {
        let written = [0.04, -0.04, -1.25, 12.0, f64::NAN, f64::INFINITY, -1e300].map(coordinate);
        assert_eq!(written, ["0", "0", "-1.3", "12", "0", "100000", "-100000"]);
    }

    #[test]
    fn long_texts_are_cut_and_labels_keep_their_unit() {
        let text = "a name that is far too long for the place that it has";
        let cut = fitted(text, 12.0, 120.0);
        assert!(cut.ends_with('…') && text_width(&cut, 12.0) <= 120.0 && cut.len() > 12, "{cut}");
        assert_eq!(fitted("short", 12.0, 120.0), "short");
        assert!(text_width(&fitted("相机相机相机相机相机相机", 12.0, 60.0), 12.0) <= 60.0);
        let label = fitted_label("distance of the left hand from the wall [mm]", 12.0, 150.0);
        assert!(label.ends_with("… [mm]") && text_width(&label, 12.0) <= 150.0, "{label}");
        assert_eq!(fitted("x", 12.0, -5.0), "…");
    }
}
