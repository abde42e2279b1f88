//! Polygons over a picture that hide part of it [Davis 2002 §3.3 "Masking invalid areas"].

use nalgebra::Point2;

use crate::ImagingError;

/// Sets the pixels of `mask` (`width × height`, row by row) whose centre lies inside `polygon`; leaves the others.
///
/// Inside is meant by the even-odd rule: a corner list that crosses itself has holes. The last corner is joined to
/// the first. A centre exactly on an edge belongs to the polygon when the edge is its left or upper one, so that
/// neighbours sharing an edge share no pixel. Parts outside the picture are ignored; fewer than three corners, no
/// extent, or a corner that is not finite: no pixel is set.
pub fn fill_polygon(
    mask: &mut [bool],
    width: usize,
    height: usize,
    polygon: &[Point2<f64>],
) -> Result<(), ImagingError> {
    let expected = width.saturating_mul(height);
    if mask.len() != expected {
        return Err(ImagingError::WrongLength { what: "mask", expected, found: mask.len() });
    }
    if expected == 0 || polygon.len() < 3 || polygon.iter().any(|it| !it.coords.iter().all(|c| c.is_finite())) {
        return Ok(());
    }
    let top = polygon.iter().map(|it| it.y).fold(f64::INFINITY, f64::min).ceil().max(0.0);
    let bottom = polygon.iter().map(|it| it.y).fold(f64::NEG_INFINITY, f64::max).floor().min(height as f64 - 1.0);
    if top > bottom {
        return Ok(());
    }
    let mut crossings = Vec::new();
    for y in top as usize..=bottom as usize {
        crossings.clear();
        for (i, a) in polygon.iter().enumerate() {
            let b = &polygon[(i + 1) % polygon.len()];
            let centre_y = y as f64;
            // Half-open in y: a corner at the height of the pixel centres counts for one of its two edges only.
            if (a.y <= centre_y) != (b.y <= centre_y) {
                // The same formula whichever way the edge runs, so that a shared edge rounds alike in both polygons.
                let (upper, lower) = if a.y < b.y { (a, b) } else { (b, a) };
                crossings.push(upper.x + (centre_y - upper.y) / (lower.y - upper.y) * (lower.x - upper.x));
            }
        }
        crossings.sort_unstable_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            // Columns x with pair[0] <= x < pair[1]; `as` saturates, which clips at the left edge.
            let (first, end) = (pair[0].ceil() as usize, (pair[1].ceil() as usize).min(width));
            if first < end {
                mask[y * width + first..y * width + end].fill(true);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SIZE: (usize, usize) = (12, 9);

    fn filled(corners: &[(f64, f64)]) -> Vec<bool> {
        let polygon: Vec<_> = corners.iter().map(|&(x, y)| Point2::new(x, y)).collect();
        let mut mask = vec![false; SIZE.0 * SIZE.1];
        fill_polygon(&mut mask, SIZE.0, SIZE.1, &polygon).unwrap();
        mask
    }

    fn count(mask: &[bool]) -> usize {
        mask.iter().filter(|&&it| it).count()
    }

    #[test]
    fn a_rectangle_covers_the_centres_inside_it() {
        let mask = filled(&[(1.5, 2.5), (5.5, 2.5), (5.5, 4.5), (1.5, 4.5)]);
        let expected: Vec<bool> =
            (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (2..=5).contains(&x) && (3..=4).contains(&y))).collect();
        assert_eq!(mask, expected);
    }

    #[test]
    fn neighbours_on_whole_pixels_share_no_pixel_and_leave_no_gap() {
        let left = filled(&[(0.0, 0.0), (4.0, 0.0), (4.0, 5.0), (0.0, 5.0)]);
        let right = filled(&[(4.0, 0.0), (9.0, 0.0), (9.0, 5.0), (4.0, 5.0)]);
        assert!(left.iter().zip(&right).all(|(a, b)| !(a & b)));
        assert_eq!((count(&left), count(&right)), (20, 25));
    }

    #[test]
    fn what_lies_outside_is_cut_off() {
        assert_eq!(count(&filled(&[(-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)])), 12 * 9);
        assert_eq!(count(&filled(&[(-50.0, -50.0), (2.5, -50.0), (2.5, 1.5), (-50.0, 1.5)])), 3 * 2);
        for (dx, dy) in [(40.0, 0.0), (-40.0, 0.0), (0.0, 40.0), (0.0, -40.0)] {
            assert_eq!(count(&filled(&[(dx, dy), (5.0 + dx, dy), (5.0 + dx, 5.0 + dy)])), 0);
        }
    }

    #[test]
    fn degenerate_polygons_set_nothing() {
        for corners in [
            &[][..],
            &[(1.0, 1.0), (5.0, 5.0)],
            &[(1.0, 1.0), (5.0, 5.0), (3.0, 3.0)],
            &[(1.0, 4.0), (5.0, 4.0), (9.0, 4.0)],
            &[(3.0, 3.0), (3.0, 3.0), (3.0, 3.0)],
            &[(0.0, 0.0), (f64::NAN, 5.0), (5.0, 5.0)],
            &[(0.0, 0.0), (f64::INFINITY, 5.0), (5.0, 5.0)],
        ] {
            assert_eq!(count(&filled(corners)), 0, "{corners:?}");
        }
    }

    #[test]
    fn a_hole_stays_a_hole() {
        // Outer square, then inner square, joined along one line: the even-odd rule leaves the inner one open.
        let ring = [(0.5, 0.5), (8.5, 0.5), (8.5, 7.5), (0.5, 7.5), (0.5, 0.5)];
        let hole = [(2.5, 2.5), (5.5, 2.5), (5.5, 5.5), (2.5, 5.5), (2.5, 2.5)];
        let mask = filled(&[&ring[..], &hole[..]].concat());
        assert_eq!(count(&mask), 8 * 7 - 3 * 3);
        assert!(!mask[4 * SIZE.0 + 4] && mask[4 * SIZE.0 + 7]);
    }

    #[test]
    fn a_mask_of_the_wrong_size_is_refused() {
        assert!(fill_polygon(&mut [false; 5], 2, 3, &[]).is_err());
        assert_eq!(fill_polygon(&mut [], 0, 3, &[Point2::origin(); 3]), Ok(()));
    }

    proptest! {
        /// Against the definition: a ray to the left crosses an odd number of edges.
        #[test]
        fn agrees_with_counting_the_crossings_of_a_ray(
            corners in prop::collection::vec((-4.0..16.0, -4.0..13.0), 3..9), whole in any::<bool>(),
        ) {
            let corners: Vec<(f64, f64)> = match whole {
                true => corners.iter().map(|&(x, y): &(f64, f64)| (x.round(), y.round())).collect(),
                false => corners,
            };
            let mask = filled(&corners);
            for y in 0..SIZE.1 {
                for x in 0..SIZE.0 {
                    let (px, py) = (x as f64, y as f64);
                    let n_left = (0..corners.len()).filter(|&i| {
                        let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
                        let (u, l) = if a.1 < b.1 { (a, b) } else { (b, a) };
                        u.1 <= py && py < l.1 && u.0 + (py - u.1) / (l.1 - u.1) * (l.0 - u.0) <= px
                    }).count();
                    prop_assert_eq!(mask[y * SIZE.0 + x], n_left % 2 == 1, "({}, {})", x, y);
                }
            }
        }
    }
}
