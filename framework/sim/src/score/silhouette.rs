//! Silhouettes against what each pixel truly sees.

use foveate_messages::Silhouette;

use crate::camera::PeopleView;
use crate::studio::Studio;

/// A true pixel whose neighbours so far to all sides are true, too, lies inside a body: a wrong one there is a hole [px].
const INSIDE_PX: usize = 3;

/// How one silhouette compares, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Overlap {
    pub n_true: usize,
    pub n_found: usize,
    pub n_both: usize,
    /// Found, not true, where people hold up light.
    pub n_shadow: usize,
    /// True ones inside, and those of them that were not found.
    pub n_inside: usize,
    pub n_holes: usize,
}

impl Overlap {
    /// Of a silhouette of the camera's picture of `whole` (columns, rows), or of a part of it; `None` where it does not lie on that, or is smaller than it was seen.
    pub fn of(silhouette: &Silhouette, whole: [u32; 2], view: &PeopleView, studio: &Studio) -> Option<Overlap> {
        let [width, height] = [silhouette.width, silhouette.height].map(|it| it as usize);
        let window = silhouette.window;
        let lies_on = window.shrink == 1 && window.fits([silhouette.width, silhouette.height], whole);
        if !lies_on
            || width * height != silhouette.confidence.len()
            || view.seen.len() as u64 != u64::from(whole[0]) * u64::from(whole[1])
        {
            return None;
        }
        let (left, top, across) = (window.left as usize, window.top as usize, whole[0] as usize);
        let is_true = |column: usize, row: usize| view.seen[(top + row) * across + left + column] != 0;
        let mut overlap = Overlap::default();
        for (column, row) in (0..height).flat_map(|row| (0..width).map(move |it| (it, row))) {
            let (found, truly) = (silhouette.is_body(column, row), is_true(column, row));
            overlap.n_true += usize::from(truly);
            overlap.n_found += usize::from(found);
            overlap.n_both += usize::from(found && truly);
            if found && !truly && view.is_shaded(studio, left + column, top + row) {
                overlap.n_shadow += 1;
            }
            let far = INSIDE_PX;
            if truly && column >= far && row >= far && column + far < width && row + far < height {
                let around = [(column - far, row), (column + far, row), (column, row - far), (column, row + far)];
                if around.iter().all(|it| is_true(it.0, it.1)) {
                    overlap.n_inside += 1;
                    overlap.n_holes += usize::from(!found);
                }
            }
        }
        Some(overlap)
    }

    /// Pixels of both over pixels of either; 1 where there are none.
    pub fn intersection_over_union(&self) -> f64 {
        let either = self.n_true + self.n_found - self.n_both;
        if either == 0 { 1.0 } else { self.n_both as f64 / either as f64 }
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;
    use crate::studio::StudioSettings;

    #[test]
    fn a_box_that_is_shifted_overlaps_by_what_geometry_says_and_a_hole_is_one() {
        let studio = Studio::new(&StudioSettings::default(), 0, None, &Random::new(1));
        let boxed = |left: usize| -> Vec<bool> {
            (0..40 * 30).map(|it| (left..left + 20).contains(&(it % 40)) && (5..25).contains(&(it / 40))).collect()
        };
        let mut view = PeopleView::default();
        view.seen.extend(boxed(8).into_iter().map(u8::from));
        let silhouette = |found: &[bool]| Silhouette {
            width: 40,
            height: 30,
            confidence: found.iter().map(|it| if *it { 255 } else { 0 }).collect(),
            ..Silhouette::default()
        };
        let same = Overlap::of(&silhouette(&boxed(8)), [40, 30], &view, &studio).unwrap();
        assert_eq!((same.n_true, same.n_both, same.n_holes, same.intersection_over_union()), (400, 400, 0, 1.0));
        // Of 20 columns 15 are common, and 25 are in either.
        let shifted = Overlap::of(&silhouette(&boxed(13)), [40, 30], &view, &studio).unwrap();
        assert!((shifted.intersection_over_union() - 0.6).abs() < 1e-12);
        let mut holed = boxed(8);
        holed[15 * 40 + 18] = false;
        let holed = Overlap::of(&silhouette(&holed), [40, 30], &view, &studio).unwrap();
        assert_eq!((holed.n_inside, holed.n_holes), (196, 1));
        let small = Silhouette { width: 20, ..silhouette(&boxed(8)) };
        assert_eq!(Overlap::of(&small, [40, 30], &view, &studio), None);
        // A part of the picture: columns 10 to 29, rows 5 to 24, of which the box covers 18 columns.
        let part = Silhouette {
            width: 20,
            height: 20,
            window: foveate_messages::Window { left: 10, top: 5, shrink: 1 },
            confidence: (0..400).map(|it| if it % 20 < 18 { 255 } else { 0 }).collect(),
            ..Silhouette::default()
        };
        let of_part = Overlap::of(&part, [40, 30], &view, &studio).unwrap();
        assert_eq!((of_part.n_true, of_part.n_both, of_part.n_found), (360, 360, 360));
        assert_eq!(Overlap::of(&part, [40, 24], &view, &studio), None);
    }
}
