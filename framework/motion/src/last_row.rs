//! Detects a cut last row of a text table: a file that is cut usually ends inside a number, and the rest still reads as a number.

/// How a number is written: its decimals, and the digits of its exponent. `None`: no number.
fn shape(text: &str) -> Option<[usize; 2]> {
    let text = text.trim();
    text.parse::<f64>().ok().filter(|it| it.is_finite())?;
    let (mantissa, exponent) = text.split_once(['e', 'E']).unwrap_or((text, ""));
    let decimals = mantissa.split_once('.').map_or(0, |it| it.1.len());
    Some([decimals, exponent.trim_start_matches(['+', '-']).len()])
}

/// The numbers of one kind as a file writes them.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Shapes {
    first: Option<[usize; 2]>,
    is_another: bool,
}

impl Shapes {
    pub(crate) fn add(&mut self, text: &str) {
        if self.is_another {
            return;
        }
        if let Some(shape) = shape(text) {
            self.is_another = *self.first.get_or_insert(shape) != shape;
        }
    }

    /// Whether a number at the end of a file is whole, as its digits tell: those before it all have as many, behind a point or in an exponent.
    pub(crate) fn tell_whole(&self, text: &str) -> bool {
        !self.is_another && self.first.is_some_and(|it| it != [0, 0]) && shape(text) == self.first
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_tell_whether_a_number_is_whole() {
        let of = |all: &[&str]| {
            let mut shapes = Shapes::default();
            all.iter().for_each(|it| shapes.add(it));
            shapes
        };
        let fixed = of(&["332.74262", "", "-1.00000", "measured"]);
        assert!(fixed.tell_whole("0.25000") && !fixed.tell_whole("332.7426") && !fixed.tell_whole("33"));
        assert!(!fixed.tell_whole("") && !fixed.tell_whole("nan"));
        let powers = of(&["1.5e-05", "2.5e+10"]);
        assert!(powers.tell_whole("1.0e-05") && !powers.tell_whole("1.0e-0") && !powers.tell_whole("1.0"));
        // Whole numbers, numbers of any length, or none: nothing tells.
        assert!(
            !of(&["12", "3"]).tell_whole("1") && !of(&["1.5", "1.25"]).tell_whole("1.5") && !of(&[]).tell_whole("1.5")
        );
    }
}
