//! Silhouettes against whom each pixel truly sees.

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
    /// Of a silhouette that covers all of the camera's picture; `None` where its size is another one.
    pub fn of(silhouette: &Silhouette, view: &PeopleView, studio: &Studio) -> Option<Overlap> {
        let [width, height] = [silhouette.width, silhouette.height].map(|it| it as usize);
        let is_whole = silhouette.window == foveate_messages::Window::default();
        if !is_whole || width * height != view.seen.len() || view.seen.len() != silhouette.confidence.len() {
            return None;
        }
        let is_true = |column: usize, row: usize| view.seen[row * width + column] != 0;
        let mut overlap = Overlap::default();
        for (column, row) in (0..height).flat_map(|row| (0..width).map(move |it| (it, row))) {
            let (found, truly) = (silhouette.is_body(column, row), is_true(column, row));
            overlap.n_true += usize::from(truly);
            overlap.n_found += usize::from(found);
            overlap.n_both += usize::from(found && truly);
            if found && !truly && view.is_shaded(studio, column, row) {
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
