//! How a picture is bent beside a background that was taken from elsewhere: what is near moves against what is far, and a picture whose rows are taken one after the other leans while its camera turns.
//!
//! Patches that were found say by how much each of them is beside the picture as a whole. A place is beside it as the patches around it are, in proportion to how near they are, and not at all where there are
//! none; a patch that deviates from its neighbours is at a person's outline, and is left out.

use nalgebra::{Point2, Vector2};

/// Pixels between places of which it is kept; between them it is linear.
const STEP: usize = 32;
/// Patches count by a normal distribution of this width about a place: that of two of them, about [px of a picture whose diagonal is 800].
const REACH: f64 = 56.0 / 800.0;
/// That nothing is bent counts as much as so many patches at the place itself.
const STRAIGHT: f64 = 0.5;
/// A patch farther beside the picture is of a person [px] …
const MOST_PX: f64 = 4.0;
/// … and so is one that is further off what its neighbours say.
const AGREE_PX: f64 = 1.5;
/// So many patches have to be left.
const LEAST: usize = 6;

/// A patch, and how far it is beside the picture as a whole [px].
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rest {
    pub at: Point2<f64>,
    pub off: Vector2<f64>,
}

/// By how much places of a picture are beside where the picture as a whole is.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Bent {
    columns: usize,
    rows: usize,
    /// Row by row, every [`STEP`] pixels [px].
    shifts: Vec<Vector2<f64>>,
}

impl Bent {
    /// As patches say, and by how much each is off what the others say, root mean square along one axis [px]. `None` where too few agree.
    pub fn of(rest: &[Rest], size: [usize; 2]) -> Option<(Bent, f64)> {
        let reach = REACH * (size[0] as f64).hypot(size[1] as f64);
        let mut weights: Vec<f64> = rest.iter().map(|it| biweight(it.off.norm() / MOST_PX)).collect();
        for _ in 0..3 {
            let found = |i: usize, it: &Rest| it.off - shift_at(&it.at, rest, &weights, Some(i), reach);
            let off: Vec<Vector2<f64>> = rest.iter().enumerate().map(|(i, it)| found(i, it)).collect();
            weights = rest
                .iter()
                .zip(&off)
                .map(|(it, off)| if it.off.norm() < MOST_PX { biweight(off.norm() / AGREE_PX) } else { 0.0 })
                .collect();
        }
        if weights.iter().filter(|it| **it > 0.0).count() < LEAST {
            return None;
        }
        let off = |i: usize| (rest[i].off - shift_at(&rest[i].at, rest, &weights, Some(i), reach)).norm_squared() / 2.0;
        let sum: f64 = weights.iter().enumerate().filter(|it| *it.1 > 0.0).map(|(i, weight)| weight * off(i)).sum();
        let rms_px = (sum / weights.iter().sum::<f64>()).sqrt();
        let [columns, rows] = size.map(|it| it.div_ceil(STEP) + 1);
        let place = |at: usize| Point2::new((at % columns * STEP) as f64, (at / columns * STEP) as f64);
        let shifts = (0..columns * rows).map(|at| shift_at(&place(at), rest, &weights, None, reach)).collect();
        Some((Bent { columns, rows, shifts }, rms_px))
    }

    /// By how much what is at a place of the picture is beside it [px].
    pub fn at(&self, place: &Point2<f64>) -> Vector2<f64> {
        if self.shifts.is_empty() {
            return Vector2::zeros();
        }
        let on_grid = |it: f64, n: usize| (it / STEP as f64).clamp(0.0, (n - 1) as f64 - 1e-9);
        let (x, y) = (on_grid(place.x, self.columns), on_grid(place.y, self.rows));
        let (column, row) = (x as usize, y as usize);
        let at = row * self.columns + column;
        let across = |at: usize| self.shifts[at].lerp(&self.shifts[at + 1], x - column as f64);
        across(at).lerp(&across(at + self.columns), y - row as f64)
    }
}

/// What the patches but one say of a place.
fn shift_at(place: &Point2<f64>, rest: &[Rest], weights: &[f64], but: Option<usize>, reach: f64) -> Vector2<f64> {
    let (mut sum, mut total) = (Vector2::zeros(), STRAIGHT);
    for (i, (it, weight)) in rest.iter().zip(weights).enumerate() {
        let far = (it.at - place).norm_squared() / (reach * reach);
        if but != Some(i) && far < 16.0 {
            let weight = weight * (-far / 2.0).exp();
            sum += it.off * weight;
            total += weight;
        }
    }
    sum / total
}

/// Tukey's; `share` of the width.
pub(super) fn biweight(share: f64) -> f64 {
    if share < 1.0 { (1.0 - share * share).powi(2) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A patch in each cell of 40 px of a picture of 640 × 480 px.
    fn patches(off: impl Fn(f64, f64) -> [f64; 2]) -> Vec<Rest> {
        let places = (0..12).flat_map(|row| (0..16).map(move |column| (column, row)));
        places
            .map(|(column, row)| {
                let (x, y) = (20.0 + 40.0 * f64::from(column), 20.0 + 40.0 * f64::from(row));
                Rest { at: Point2::new(x, y), off: Vector2::from(off(x, y)) }
            })
            .collect()
    }

    #[test]
    fn a_picture_that_leans_does_so_and_one_patch_of_another_opinion_is_left_out() {
        let lean = |y: f64| (y - 240.0) / 160.0;
        let mut rest = patches(|_, y| [lean(y), 0.0]);
        rest[70].off = Vector2::new(-3.0, 3.0);
        let (bent, rms_px) = Bent::of(&rest, [640, 480]).unwrap();
        for (x, y) in [(100.0, 100.0), (320.0, 240.0), (410.0, 170.0), (639.0, 400.0)] {
            let off = bent.at(&Point2::new(x, y)) - Vector2::new(lean(y), 0.0);
            assert!(off.norm() < 0.2, "{x} {y}: {off}");
        }
        assert!(rms_px < 0.2, "{rms_px}");
    }

    #[test]
    fn far_from_all_patches_nothing_is_bent_and_of_five_nothing_is_known() {
        let rest: Vec<Rest> = patches(|_, _| [1.0, 1.0]).into_iter().filter(|it| it.at.x < 200.0).collect();
        let (bent, _) = Bent::of(&rest, [640, 480]).unwrap();
        assert!(bent.at(&Point2::new(80.0, 200.0)).norm() > 1.2);
        assert_eq!(bent.at(&Point2::new(600.0, 200.0)), Vector2::zeros());
        assert_eq!(Bent::of(&rest[..5], [640, 480]), None);
        assert_eq!(Bent::default().at(&Point2::new(80.0, 200.0)), Vector2::zeros());
    }
}
