//! Compares the wall's settings with the dots or boards that it was requested to show.

use super::shown::{Shown, WallSize};

/// Coordinates this near to each other are one row or column [m].
const SAME_M: f64 = 1e-3;
/// The wall extends beyond the outermost dot by at most this many of the largest steps between dots.
const MARGIN_STEPS: f64 = 1.5;
/// Largest relative difference of steps between dots of one display.
const UNEVEN: f64 = 0.25;

/// Checks that everything was shown within the wall that `wall` describes.
///
/// # Errors
/// The place that is farthest outside.
pub(super) fn beyond(wall: &WallSize, shown: &[Shown], things: &str) -> Result<(), String> {
    let [width, height] = wall.size_m;
    let over = |it: &nalgebra::Point2<f64>| (-it.x).max(-it.y).max(it.x - width).max(it.y - height);
    let points = shown.iter().flat_map(|it| &it.points);
    match points.max_by(|a, b| over(a).total_cmp(&over(b))) {
        Some(it) if over(it) > SAME_M => Err(format!(
            "the wall was requested to show {things} as far as ({:.3}, {:.3}) m from its upper left corner, but ends at ({width}, {height}) m by `size_m`: one of them is wrong",
            it.x, it.y
        )),
        _ => Ok(()),
    }
}

/// Contradictions between `size_m` or `tiles` and `shown`, which is everything that a whole run has shown.
pub(super) fn doubts(wall: &WallSize, shown: &[Shown], things: &str) -> Vec<String> {
    let mut doubts = Vec::new();
    let lines = [0, 1].map(|axis| lines(shown, axis));
    for (axis, (edge, side)) in [("right", "wide"), ("lower", "high")].into_iter().enumerate() {
        let (own, size) = (&lines[axis], wall.size_m[axis]);
        let step = own.windows(2).map(|it| it[1] - it[0]).fold(0.0, f64::max);
        let Some(margin) = own.last().map(|it| size - it).filter(|it| *it > MARGIN_STEPS * step && step > 0.0) else {
            continue;
        };
        doubts.push(format!(
            "the {edge} edge by `size_m` is {:.0} cm from the last of the {things}, which are at most {:.0} cm apart: is the wall {size} m {side}? Beyond the {things} maps are extrapolated",
            margin * 100.0,
            step * 100.0
        ));
    }
    // A grid has a dot wherever a row and a column meet; other patterns say nothing of displays.
    let is_grid = shown.iter().all(|it| it.points.len() == 1) && lines[0].len() * lines[1].len() == shown.len();
    for (axis, along) in ["columns", "rows"].into_iter().enumerate().filter(|_| is_grid) {
        let n = wall.tiles[axis];
        let side = wall.size_m[axis] / f64::from(n);
        let of_tile = |tile: u32| -> Vec<f64> {
            let own =
                lines[axis].iter().filter(|it| (*it / side).floor().clamp(0.0, f64::from(n) - 1.0) == f64::from(tile));
            own.copied().collect()
        };
        let tiles: Vec<Vec<f64>> = (0..n).map(of_tile).collect();
        let counts = || tiles.iter().map(Vec::len);
        let steps = tiles.iter().flat_map(|it| it.windows(2).map(|it| it[1] - it[0]));
        let (least, most) = steps.fold((f64::MAX, 0.0_f64), |(a, b), it| (a.min(it), b.max(it)));
        let found = if counts().min() != counts().max() {
            format!(
                "by them some displays show {} {along} of dots and others {}",
                counts().min().unwrap_or(0),
                counts().max().unwrap_or(0)
            )
        } else if most > 0.0 && least < (1.0 - UNEVEN) * most {
            format!(
                "by them dots of one display are {:.0} mm apart in some places and {:.0} mm in others, as if a bezel were between them",
                least * 1e3,
                most * 1e3
            )
        } else {
            continue;
        };
        doubts.push(format!(
            "are {n} displays in {along} right (`tiles`)? {found}: displays that are dark may be named wrongly"
        ));
    }
    doubts
}

/// The columns (axis 0) or rows of the points [m].
fn lines(shown: &[Shown], axis: usize) -> Vec<f64> {
    let mut all: Vec<f64> = shown.iter().flat_map(|it| it.points.iter().map(|it| it[axis])).collect();
    all.sort_by(f64::total_cmp);
    all.dedup_by(|b, a| *b - *a < SAME_M);
    all
}

#[cfg(test)]
mod tests {
    use foveate::prelude::*;
    use nalgebra::Point2;

    use super::*;

    /// Four by two displays of 1 m by 0.6 m, 12 mm between them, five by three dots on each.
    fn dots() -> Vec<Shown> {
        let at = |number: u32, of_tile: u32, side: f64| {
            let within = f64::from(number % of_tile) / f64::from(of_tile - 1);
            f64::from(number / of_tile) * (side + 0.012) + 0.02 + within * (side - 0.04)
        };
        let places = (0..6).flat_map(|row| (0..20).map(move |column| Point2::new(at(column, 5, 1.0), at(row, 3, 0.6))));
        places.map(|it| Shown { points: vec![it], from: Time::ZERO, until: Time::ZERO }).collect()
    }

    fn wall(size_m: [f64; 2], tiles: [u32; 2]) -> WallSize {
        WallSize { size_m, pixel_m: 1e-3, tiles }
    }

    #[test]
    fn settings_that_go_with_the_dots_are_not_doubted() {
        let wall = wall([4.036, 1.212], [4, 2]);
        assert_eq!(beyond(&wall, &dots(), "dots"), Ok(()));
        assert_eq!(doubts(&wall, &dots(), "dots"), Vec::<String>::new());
    }

    #[test]
    fn a_wall_too_small_is_refused_and_one_too_large_or_other_displays_are_doubted() {
        let why = beyond(&wall([3.9, 1.212], [4, 2]), &dots(), "dots").unwrap_err();
        assert!(why.contains("as far as (4.016") && why.contains("(3.9, 1.212)"), "{why}");
        let said = |size_m, tiles| doubts(&wall(size_m, tiles), &dots(), "dots").join("; ");
        let wide = said([4.9, 1.212], [4, 2]);
        assert!(wide.contains("right edge by `size_m` is 88 cm") && wide.contains("at most 24 cm"), "{wide}");
        assert!(said([4.036, 1.212], [3, 2]).contains("3 displays in columns"), "{}", said([4.036, 1.212], [3, 2]));
        // Half as many: equal counts, but bezels within.
        let half = said([4.036, 1.212], [2, 2]);
        assert!(half.contains("2 displays in columns") && half.contains("as if a bezel"), "{half}");
        assert!(said([4.036, 1.212], [4, 1]).contains("1 displays in rows"), "{}", said([4.036, 1.212], [4, 1]));
        let scattered: Vec<Shown> = dots().into_iter().step_by(7).collect();
        assert_eq!(doubts(&wall([4.036, 1.212], [3, 2]), &scattered, "dots"), Vec::<String>::new(), "no grid");
    }
}
