//! The pictures that a projector shows.

use super::boundary::BoundaryCode;
use super::code::{Axis, Shown, StripeCode, gray_of};

/// Renders one picture of `code` for the projector, a byte a pixel, row by row; `gamma` is that of the projector: sine waves are written so that they are
/// sine waves in light [–].
pub fn picture(code: &StripeCode, shown: Shown, gamma: f64) -> Vec<u8> {
    let [columns, rows] = code.projector.map(|it| it as usize);
    let profile = |axis: Axis| -> Vec<u8> {
        let n = [columns, rows][axis.index()];
        (0..n as u32).map(|at| level(code, shown, at, gamma)).collect()
    };
    match shown {
        Shown::White => vec![255; columns * rows],
        Shown::Black => vec![0; columns * rows],
        Shown::Bit { axis: Axis::Columns, .. }
        | Shown::Phase { axis: Axis::Columns, .. }
        | Shown::Boundary { axis: Axis::Columns, .. } => profile(Axis::Columns).repeat(rows),
        Shown::Bit { axis: Axis::Rows, .. }
        | Shown::Phase { axis: Axis::Rows, .. }
        | Shown::Boundary { axis: Axis::Rows, .. } => {
            profile(Axis::Rows).into_iter().flat_map(|it| std::iter::repeat_n(it, columns)).collect()
        }
    }
}

/// What projector column (row) `at` shows [gray level].
fn level(code: &StripeCode, shown: Shown, at: u32, gamma: f64) -> u8 {
    match shown {
        Shown::White => 255,
        Shown::Black => 0,
        Shown::Bit { axis, plane, inverse } => {
            let index = axis.index();
            let stripe = (at + code.offset[index]) / code.stripe[index];
            let bit = gray_of(stripe) >> (code.bits[index] - 1 - plane) & 1 == 1;
            if bit != inverse { 255 } else { 0 }
        }
        Shown::Boundary { axis, frame } => {
            let stripe = (at + code.offset[axis.index()]) / code.stripe[axis.index()];
            255 * u8::from(BoundaryCode::get().is_lit(stripe as usize, frame as usize))
        }
        Shown::Phase { axis, step } => {
            let place = f64::from(at + code.offset[axis.index()]) + 0.5;
            let turn = place / f64::from(code.period) - f64::from(step) / f64::from(code.steps);
            let light = 0.5 + 0.5 * (std::f64::consts::TAU * turn).cos();
            (255.0 * light.powf(1.0 / gamma)).round() as u8
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_stripes_differ_in_one_bit() {
        let code = StripeCode::gray([13, 6]).with_bits([None, None], true);
        let bits: Vec<Vec<u8>> = (0..code.bits[0])
            .map(|plane| picture(&code, Shown::Bit { axis: Axis::Columns, plane, inverse: false }, 1.0))
            .collect();
        for column in 1..13 {
            assert_eq!(bits.iter().filter(|it| it[column] != it[column - 1]).count(), 1, "column {column}");
        }
        let last_row = 5 * 13;
        assert!(bits.iter().all(|it| it.len() == 78 && it[..13] == it[last_row..]));
    }

    #[test]
    fn a_picture_and_its_inverse_are_white_together() {
        let code = StripeCode::gray([9, 7]);
        for plane in 0..code.bits[1] {
            let bit = |inverse| picture(&code, Shown::Bit { axis: Axis::Rows, plane, inverse }, 1.0);
            assert!(bit(false).iter().zip(bit(true)).all(|(a, b)| a ^ b == 255));
        }
    }

    #[test]
    fn stripes_of_a_boundary_code_repeat_with_it() {
        let code = StripeCode::boundary([800, 2], 4, &[]);
        assert!(code.check().is_ok() && code.pictures().len() == 4);
        for shown in code.pictures() {
            let picture = picture(&code, shown, 1.0);
            assert!((0..800 - 344).all(|it| picture[it] == picture[it + 344] && picture[it] == picture[it / 4 * 4]));
            assert!(picture[..344].contains(&0) && picture[..344].contains(&255));
        }
    }

    #[test]
    fn steps_of_a_sine_add_up_to_even_light() {
        let code = StripeCode::phase([64, 8], 4, 16);
        let steps: Vec<Vec<u8>> =
            (0..4).map(|step| picture(&code, Shown::Phase { axis: Axis::Columns, step }, 1.0)).collect();
        for column in 0..64 {
            let sum: u32 = steps.iter().map(|it| u32::from(it[column])).sum();
            assert!(sum.abs_diff(510) <= 2, "column {column}: {sum}");
        }
    }
}
