//! The largest part of a picture of which all is known, nearly.

use std::ops::Range;

/// Columns and rows of it: sides of a picture are taken away, always the line of which least is `covered`, until all lines along the sides are. Empty where nothing is.
pub(crate) fn known_part(covered: &[bool], [width, height]: [usize; 2]) -> [Range<usize>; 2] {
    let (mut columns, mut rows) = (0..width, 0..height);
    while !columns.is_empty() && !rows.is_empty() {
        let lacks_row =
            |y: usize| columns.clone().filter(|x| !covered[y * width + x]).count() as f64 / columns.len() as f64;
        let lacks_column =
            |x: usize| rows.clone().filter(|y| !covered[y * width + x]).count() as f64 / rows.len() as f64;
        let lacks = [
            lacks_column(columns.start),
            lacks_column(columns.end - 1),
            lacks_row(rows.start),
            lacks_row(rows.end - 1),
        ];
        let (side, most) =
            lacks.into_iter().enumerate().fold((0, 0.0), |most, it| if it.1 > most.1 { it } else { most });
        if most == 0.0 {
            break;
        }
        match side {
            0 => columns.start += 1,
            1 => columns.end -= 1,
            2 => rows.start += 1,
            _ => rows.end -= 1,
        }
    }
    if columns.is_empty() || rows.is_empty() { [0..0, 0..0] } else { [columns, rows] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(is_covered: impl Fn(usize, usize) -> bool) -> [Range<usize>; 2] {
        let covered: Vec<bool> = (0..40 * 30).map(|at| is_covered(at % 40, at / 40)).collect();
        known_part(&covered, [40, 30])
    }

    #[test]
    fn a_strip_a_slanted_rim_and_a_hole_leave_what_they_should() {
        assert_eq!(part(|_, _| true), [0..40, 0..30]);
        assert_eq!(part(|x, _| x >= 7), [7..40, 0..30]);
        assert_eq!(part(|x, y| x < 33 && y >= 4), [0..33, 4..30]);
        // A rim that leans by two columns.
        assert_eq!(part(|x, y| x >= 3 + y / 15), [4..40, 0..30]);
        assert_eq!(part(|x, y| (x, y) != (20, 15)), [0..40, 0..30]);
        assert_eq!(part(|_, _| false), [0..0, 0..0]);
    }
}
