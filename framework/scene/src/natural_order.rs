//! The order in which people expect numbered names.

use std::cmp::Ordering;

/// Compares names with runs of digits taken as numbers: `wide-2` comes before `wide-10`. Names that differ only in
/// leading zeros are ordered as plain text, so that only equal names compare equal.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a, b);
    loop {
        let (Some(x), Some(y)) = (left.chars().next(), right.chars().next()) else {
            return left.len().cmp(&right.len()).then_with(|| a.cmp(b));
        };
        if x.is_ascii_digit() && y.is_ascii_digit() {
            let (number_a, number_b) = (take_number(&mut left), take_number(&mut right));
            match number_a.len().cmp(&number_b.len()).then_with(|| number_a.cmp(number_b)) {
                Ordering::Equal => {}
                different => return different,
            }
        } else if x == y {
            left = &left[x.len_utf8()..];
            right = &right[y.len_utf8()..];
        } else {
            return x.cmp(&y);
        }
    }
}

/// Cuts the leading digits off `text` and gives them without leading zeros.
fn take_number<'a>(text: &mut &'a str) -> &'a str {
    let end = text.find(|it: char| !it.is_ascii_digit()).unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    *text = rest;
    digits.trim_start_matches('0')
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn digits_count_as_numbers() {
        let expected = ["", "a", "a-2-x", "a-10", "a10", "ptz-1", "wide-01", "wide-1", "wide-2", "wide-10", "ä"];
        let mut names = expected;
        names.reverse();
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, expected);
        let huge = "9".repeat(400);
        assert_eq!(natural_order(&huge, &format!("1{huge}")), Ordering::Less);
    }

    proptest! {
        #[test]
        fn it_is_a_total_order(a in "[ab01-]{0,6}", b in "[ab01-]{0,6}", c in "[ab01-]{0,6}") {
            prop_assert_eq!(natural_order(&a, &b), natural_order(&b, &a).reverse());
            prop_assert_eq!(natural_order(&a, &b) == Ordering::Equal, a == b);
            let mut list = [a, b, c];
            list.sort_by(|a, b| natural_order(a, b));
            prop_assert_ne!(natural_order(&list[0], &list[2]), Ordering::Greater);
        }
    }
}
