//! Numbers in words, for messages.

/// `1 place`, `2 places`.
pub fn counted(n: usize, one: &str) -> String {
    if n == 1 { format!("1 {one}") } else { format!("{n} {one}s") }
}

/// A number with its sign and this many digits after the point; zero is `+0.00`, never `-0.00`.
pub fn signed(value: f64, digits: usize) -> String {
    let text = format!("{value:+.digits$}");
    let is_zero = text.bytes().all(|it| matches!(it, b'-' | b'+' | b'0' | b'.'));
    if is_zero { text.replace('-', "+") } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_singular_and_zero_has_one_sign() {
        assert_eq!(
            [counted(0, "point"), counted(1, "point"), counted(2, "point")],
            ["0 points", "1 point", "2 points"]
        );
        assert_eq!([signed(-0.004, 2), signed(-0.005_1, 2), signed(3.0, 1)], ["+0.00", "-0.01", "+3.0"]);
    }
}
