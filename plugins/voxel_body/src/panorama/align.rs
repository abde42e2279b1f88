//! Alignment of a picture with its prediction, by the visible background.
//!
//! Patches of the expected background that have texture are searched in the picture (pyramidal Lucas–Kanade). A person in front of them hides or displaces some: the shift that most of
//! them agree on begins, and those near it say how the picture is shifted, turned and enlarged. What is left of them then, where neighbours agree on it, is how it is [bent](super::bent).

use foveate::imaging::{Channel, FlowSettings, ImageView, ImagingError, LucasKanade, Pyramid, Template, plane};
use nalgebra::{Matrix4, Point2, Similarity2, Translation2, UnitComplex, Vector2, Vector4};

use super::bent::{Bent, Rest, biweight};

/// So many patches a picture, about, each from a cell of its own …
const PATCHES: usize = 160;
/// … whose edge is no shorter than this [px].
const LEAST_CELL: usize = 16;
/// Columns and rows of a patch [px].
const WINDOW: usize = 15;
/// Pixels between places that are tried in a cell.
const TRIED: usize = 4;
/// A patch is found where it correlates so well, and is fixed to this, one standard deviation [–, px].
const CORRELATION: f64 = 0.8;
const FIXED_PX: f64 = 0.4;
/// Patches agree that are no further apart than this [px].
const AGREE_PX: f64 = 1.5;
/// So many have to, at least.
const LEAST: usize = 6;
/// Turns and enlargements beyond this are not expected of a pose that is nearly right, standard deviation [rad, –] …
const TURN: f64 = 0.005;
/// … and patches are found to this [px].
const FOUND_PX: f64 = 0.3;

/// How a picture lies on what was expected.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Alignment {
    /// From where something was expected to where it is, about [px].
    pub moved: Similarity2<f64>,
    /// How far it is beside that.
    pub bent: Bent,
    /// What the patches are off after that, root mean square along one axis [px].
    pub rms_px: f64,
}

/// Aligns pictures of one size; keeps its memory.
pub(super) struct Aligner {
    finder: LucasKanade,
    template: Template,
    known: Pyramid,
    seen: Pyramid,
    gray: Vec<u8>,
}

impl Aligner {
    /// # Errors
    /// None with the constants above.
    pub fn new() -> Result<Self, ImagingError> {
        let settings = FlowSettings { window_px: WINDOW, ..FlowSettings::default() };
        let finder = LucasKanade::new(settings)?;
        let (known, seen) = (Pyramid::default(), Pyramid::default());
        Ok(Self { finder, template: Template::default(), known, seen, gray: Vec::new() })
    }

    /// Of `seen` on `known`, which is right where `covered`; both of `size` with 1 or 3 channels. `None` where too few patches agree within `reach_px` of where they were expected.
    ///
    /// # Errors
    /// Pixels that are not what the size promises.
    pub fn align(
        &mut self,
        known: &[u8],
        covered: &[bool],
        seen: &[u8],
        size: [usize; 2],
        reach_px: f64,
    ) -> Result<Option<Alignment>, ImagingError> {
        for (pixels, pyramid) in [(known, &mut self.known), (seen, &mut self.seen)] {
            let gray = if pixels.len() == size[0] * size[1] {
                pixels
            } else {
                plane::extract(Channel::Luma, pixels, &mut self.gray)?;
                &self.gray
            };
            pyramid.build(&ImageView::new(gray, size[0], size[1])?, self.finder.settings().levels);
        }
        let found = self.find(covered, size, reach_px);
        let Some(moved) = agreed(&found, size) else { return Ok(None) };
        let rest: Vec<Rest> = found.iter().map(|[from, to]| Rest { at: *to, off: to - moved * from }).collect();
        Ok(Bent::of(&rest, size).map(|(bent, rms_px)| Alignment { moved, bent, rms_px }))
    }

    /// Patches: where they were expected, and where they are.
    fn find(&mut self, covered: &[bool], [width, height]: [usize; 2], reach_px: f64) -> Vec<[Point2<f64>; 2]> {
        let mut found = Vec::new();
        let cell = (width * height / PATCHES).isqrt().max(LEAST_CELL);
        for top in (WINDOW..height.saturating_sub(WINDOW)).step_by(cell) {
            for left in (WINDOW..width.saturating_sub(WINDOW)).step_by(cell) {
                let places = (top..(top + cell).min(height - WINDOW))
                    .step_by(TRIED)
                    .flat_map(|y| (left..(left + cell).min(width - WINDOW)).step_by(TRIED).map(move |x| (x, y)));
                let known = self.known.level(0);
                let is_known = |x: usize, y: usize| {
                    let reach = WINDOW;
                    [(x - reach, y - reach), (x + reach, y - reach), (x - reach, y + reach), (x + reach, y + reach)]
                        .iter()
                        .all(|it| covered[it.1 * width + it.0])
                };
                let best = places
                    .filter(|it| is_known(it.0, it.1))
                    .map(|(x, y)| (texture(&known, x, y), x, y))
                    .max_by(|a, b| a.0.total_cmp(&b.0));
                let Some((_, x, y)) = best else { continue };
                let expected = Point2::new(x as f64, y as f64);
                if self.finder.learn(&self.known, expected, &mut self.template).is_err() {
                    continue;
                }
                let Ok(flow) = self.finder.find(&self.template, &self.seen, expected) else { continue };
                let is_fixed = flow.covariance.trace() < 2.0 * FIXED_PX * FIXED_PX;
                if is_fixed && flow.correlation > CORRELATION && (flow.pixel - expected).norm() <= reach_px {
                    found.push([expected, flow.pixel]);
                }
            }
        }
        found
    }
}

/// The smaller eigenvalue of Σ ∇I ∇Iᵀ over one pixel in two around a place.
fn texture(view: &ImageView<'_>, x: usize, y: usize) -> f32 {
    let (mut xx, mut xy, mut yy) = (0.0f32, 0.0, 0.0);
    for row in (y - 4..=y + 4).step_by(2) {
        let [above, at, below] = [row - 1, row, row + 1].map(|it| view.row(it));
        for column in (x - 4..=x + 4).step_by(2) {
            let across = f32::from(at[column + 1]) - f32::from(at[column - 1]);
            let down = f32::from(below[column]) - f32::from(above[column]);
            xx += across * across;
            xy += across * down;
            yy += down * down;
        }
    }
    0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt())
}

/// The similarity on which most agree.
fn agreed(found: &[[Point2<f64>; 2]], size: [usize; 2]) -> Option<Similarity2<f64>> {
    let shift = |it: &[Point2<f64>; 2]| it[1] - it[0];
    let n_near = |of: &[Point2<f64>; 2]| found.iter().filter(|it| (shift(it) - shift(of)).norm() < AGREE_PX).count();
    let first = found.iter().map(|it| (n_near(it), shift(it))).max_by_key(|it| it.0)?;
    if first.0 < LEAST {
        return None;
    }
    let centre = Vector2::new(size[0] as f64, size[1] as f64) / 2.0;
    // x' = x + t + (s x - r y, r x + s y), about the centre.
    let mut state = Vector4::new(first.1.x, first.1.y, 0.0, 0.0);
    let mut n_used = 0;
    for _ in 0..6 {
        let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
        let prior = (FOUND_PX / TURN).powi(2);
        (normal[(2, 2)], normal[(3, 3)]) = (prior, prior);
        n_used = 0;
        for [from, to] in found {
            let at = from.coords - centre;
            let rows = [Vector4::new(1.0, 0.0, at.x, -at.y), Vector4::new(0.0, 1.0, at.y, at.x)];
            let target = to - from;
            let off = target - Vector2::new(rows[0].dot(&state), rows[1].dot(&state));
            let weight = biweight(off.norm() / AGREE_PX);
            if weight == 0.0 {
                continue;
            }
            n_used += 1;
            for (row, target) in rows.iter().zip(target.iter()) {
                normal += weight * row * row.transpose();
                right += weight * *target * row;
            }
        }
        state = normal.cholesky()?.solve(&right);
    }
    if n_used < LEAST {
        return None;
    }
    let linear = nalgebra::Complex::new(1.0 + state[2], state[3]);
    let turn = UnitComplex::from_angle(linear.im.atan2(linear.re));
    let scale = linear.re.hypot(linear.im);
    let about = |it: Vector2<f64>| Similarity2::from_parts(Translation2::from(it), UnitComplex::identity(), 1.0);
    let turned = Similarity2::from_parts(Translation2::new(state[0], state[1]), turn, scale);
    Some(about(centre) * turned * about(-centre))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [320, 240];

    /// A wall, and a person in stripes in front of it.
    fn picture(moved: &Similarity2<f64>, body: Option<f64>) -> Vec<u8> {
        let back = moved.inverse();
        (0..SIZE[0] * SIZE[1])
            .map(|at| {
                let seen = Point2::new((at % SIZE[0]) as f64, (at / SIZE[0]) as f64);
                if let Some(x) = body
                    && (seen.x - x).abs() < 60.0
                    && seen.y > 30.0
                {
                    return (128.0 + 60.0 * (0.4 * (seen.x - x)).sin() * (0.3 * seen.y).cos()) as u8;
                }
                let at = back * seen;
                let wave = |a: f64, b: f64| (a * at.x + b * at.y).sin();
                (120.0 + 25.0 * (wave(0.21, 0.05) + wave(-0.08, 0.19) + wave(0.37, 0.31))) as u8
            })
            .collect()
    }

    #[test]
    fn a_shift_a_turn_and_an_enlargement_are_found_with_a_person_before_a_third_of_the_wall() {
        let mut aligner = Aligner::new().unwrap();
        let known = picture(&Similarity2::identity(), None);
        for (shift, turn, scale) in [([0.0, 0.0], 0.0, 1.0), ([3.4, -2.2], 0.004, 1.003), ([-7.5, 5.1], -0.006, 0.996)]
        {
            let moved = Similarity2::new(Vector2::from(shift), turn, scale);
            let seen = picture(&moved, Some(150.0));
            let found = aligner.align(&known, &[true; 320 * 240], &seen, SIZE, 20.0).unwrap().unwrap();
            for corner in [[40.0, 30.0], [280.0, 30.0], [280.0, 210.0], [40.0, 210.0]] {
                let corner = Point2::from(corner);
                let off = (found.moved * corner - moved * corner).norm();
                assert!(off < 0.3, "{shift:?}: {off} px off at {corner}");
            }
            assert!(found.rms_px < 0.3, "{}", found.rms_px);
        }
    }

    #[test]
    fn what_is_near_moves_against_what_is_far_and_is_found_where_it_is() {
        let mut aligner = Aligner::new().unwrap();
        let known = picture(&Similarity2::identity(), None);
        // Something near on the left, and one that gets there slowly.
        let shift = |x: f64| 2.0 + 2.4 * (1.0 - ((x - 60.0) / 120.0).clamp(0.0, 1.0));
        let moved = |x: f64| Similarity2::new(Vector2::new(shift(x), -1.0), 0.0, 1.0);
        let mut seen = picture(&moved(0.0), Some(250.0));
        for column in 0..SIZE[0] {
            let of_column = picture(&moved(column as f64), Some(250.0));
            (0..SIZE[1]).for_each(|row| seen[row * SIZE[0] + column] = of_column[row * SIZE[0] + column]);
        }
        let found = aligner.align(&known, &[true; 320 * 240], &seen, SIZE, 20.0).unwrap().unwrap();
        for (x, y) in [(30.0, 60.0), (60.0, 200.0), (120.0, 120.0), (170.0, 40.0)] {
            let to = Point2::new(x, y);
            let from = found.moved.inverse() * (to - found.bent.at(&to));
            let expected = to - Vector2::new(shift(x), -1.0);
            assert!((from - expected).norm() < 0.4, "{x} {y}: {from} for {expected}");
            let straight = found.moved.inverse() * to;
            assert!(x == 120.0 || (straight - expected).norm() > 0.4, "{x} {y}: {straight} for {expected}");
        }
        assert!(found.rms_px < 0.3, "{}", found.rms_px);
    }

    #[test]
    fn nothing_is_said_of_a_wall_without_texture_another_wall_or_one_that_is_not_known() {
        let mut aligner = Aligner::new().unwrap();
        let known = picture(&Similarity2::identity(), None);
        let all = [true; 320 * 240];
        let other: Vec<u8> = (0..320 * 240u32).map(|at| (at.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        assert_eq!(aligner.align(&[90; 320 * 240], &all, &known, SIZE, 20.0), Ok(None));
        assert_eq!(aligner.align(&known, &all, &other, SIZE, 20.0), Ok(None));
        assert_eq!(aligner.align(&known, &[false; 320 * 240], &known, SIZE, 20.0), Ok(None));
    }
}
