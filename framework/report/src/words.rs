//! Numbers, sizes and counts for people.

use foveate_plot::text::{count as grouped, fixed};

/// A number with four significant digits, whole ones whole; a dash where it is not finite.
pub(crate) fn number(value: f64) -> String {
    let size = value.abs();
    if !value.is_finite() || value == 0.0 {
        fixed(value, 0)
    } else if value.fract() == 0.0 && size < 1e9 {
        let sign = if value < 0.0 { "\u{2212}" } else { "" };
        format!("{sign}{}", grouped(size as usize))
    } else if !(1e-4..1e9).contains(&size) {
        format!("{value:.2e}").replace('-', "\u{2212}")
    } else {
        let decimals = (3.0 - size.log10().floor()).clamp(0.0, 7.0) as usize;
        let text = fixed(value, decimals);
        // 0.9980 is 0.998.
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    }
}

/// A size of a file: `4.2 MB`.
pub(crate) fn size(bytes: u64) -> String {
    let bytes = bytes as f64;
    let (value, unit) = match bytes {
        ..1e3 => return so_many(bytes as usize, "byte"),
        ..1e6 => (bytes / 1e3, "kB"),
        ..1e9 => (bytes / 1e6, "MB"),
        _ => (bytes / 1e9, "GB"),
    };
    format!("{} {unit}", fixed(value, usize::from(value < 9.95)))
}

/// So many things: `1 row`, `2 rows`.
pub(crate) fn so_many(n: usize, thing: &str) -> String {
    format!("{} {thing}{}", grouped(n), if n == 1 { "" } else { "s" })
}

/// A length of time in seconds as minutes and seconds where it is long.
pub(crate) fn duration(seconds: f64) -> String {
    if seconds >= 120.0 {
        let whole = seconds.round();
        format!("{} min {} s", number((whole / 60.0).floor()), number(whole % 60.0))
    } else {
        format!("{} s", number(seconds))
    }
}

/// A key that sorts `wide-2` before `wide-10`: its numbers are filled with zeros to one length.
pub(crate) fn natural(name: &str) -> String {
    let mut key = String::new();
    let mut digits = String::new();
    for c in name.chars().map(Some).chain([None]) {
        match c {
            Some(digit) if digit.is_ascii_digit() => digits.push(digit),
            other => {
                if !digits.is_empty() {
                    key += &format!("{digits:0>20}");
                    digits.clear();
                }
                key.extend(other);
            }
        }
    }
    key
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits_and_whole_ones_all() {
        let cases = [
            (0.915, "0.915"),
            (0.99851, "0.9985"),
            (105.4259, "105.4"),
            (51621.3, "51621"),
            (0.000_101_23, "0.0001012"),
            (8.0, "8"),
            (-123_456.0, "\u{2212}123\u{202f}456"),
            (2e-6, "2.00e\u{2212}6"),
            (-0.0, "0"),
            (f64::NAN, "–"),
        ];
        for (value, expected) in cases {
            assert_eq!(number(value), expected);
        }
    }

    #[test]
    fn numbered_names_stand_in_the_order_of_their_numbers() {
        let mut names = ["wide-10_03", "b", "wide-2_11", "wide-2_5", "a7", "wide-"];
        names.sort_by_key(|it| natural(it));
        assert_eq!(names, ["a7", "b", "wide-", "wide-2_5", "wide-2_11", "wide-10_03"]);
    }

    #[test]
    fn sizes_and_counts_have_their_units() {
        assert_eq!(
            [size(1), size(12), size(4200), size(41_000_000), size(2_500_000_000)],
            ["1 byte", "12 bytes", "4.2 kB", "41 MB", "2.5 GB"]
        );
        assert_eq!([so_many(1, "row"), so_many(0, "row")], ["1 row", "0 rows"]);
        assert_eq!([duration(19.99), duration(605.2)], ["19.99 s", "10 min 5 s"]);
    }
}
