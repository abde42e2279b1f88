//! A camera, or all that it sees, that moved by less than a pixel during a set.
//!
//! A bit and its inverse add up to the scene under full light; so do white and black, and two phase steps half a period apart. Such a sum S of a scene R that lies d pixels elsewhere is a R + c − ∇R · d: colours and
//! shades of the surface tell d by least squares over all pixels, far finer than a pixel. Sums in the order of their pictures scatter about one d as long as nothing moves, and about two where something did. Scenes without
//! colours or edges say nothing.
//!
//! Source: B. Lucas, T. Kanade, "An iterative image registration technique with an application to stereo vision", IJCAI 1981.

use nalgebra::{Matrix4, Vector2, Vector4};

use super::Coordinates;
use super::code::{Axis, Inverse, Shown, StripeCode};
use crate::ImageView;

/// Pixels that tell it, at most and at least.
const SAMPLES: usize = 60_000;
const MIN_SAMPLES: usize = 2000;
/// Sums before and after a move, at least.
const MIN_SUMS: usize = 3;
/// A gray level that may be cut off.
const SATURATED: u8 = 250;
/// Over an edge of a surface the scene has no slope: pixels that differ from their neighbours by more than this part of them say nothing [–].
const EDGE: f64 = 0.3;
/// Turns in which pixels are left out that do not fit, and by how many standard deviations.
const TURNS: usize = 3;
const OUTSIDE: f64 = 3.0;
/// A move is at least so large [px] …
const LEAST: f64 = 0.15;
/// … and so many standard deviations of how sums scatter about the places before and after it.
const SIGMAS: f64 = 7.0;
/// A surface that colours place no better than this says nothing, standard deviation of one sum [px].
const KNOWN: f64 = 0.1;

/// Where a scene moved during a set.
#[derive(Debug, Clone, PartialEq)]
pub struct Drift {
    /// A picture before it, by its place.
    pub last: usize,
    /// A picture after it.
    pub first: usize,
    /// By how much the scene moved along rows and columns of the picture [px].
    pub by: Vector2<f64>,
}

impl Drift {
    /// Makes coordinates as vague as the move makes them: of the place before or the one after, whichever is asked for, they are anywhere from right to off by all of the move.
    pub fn widen(&self, coordinates: &mut Coordinates) {
        let [width, height] = coordinates.size;
        for axis in Axis::BOTH.map(Axis::index) {
            let values = &coordinates.values[axis];
            if values.len() != width * height {
                continue;
            }
            let along = |at: usize, place: usize, n: usize, by: usize| -> Option<f64> {
                let other = |is_there: bool, at: usize| values.get(at).copied().filter(|it| is_there && it.is_finite());
                let (ahead, behind) = (other(place + 1 < n, at + by), other(place > 0, at.wrapping_sub(by)));
                match (ahead, behind) {
                    (Some(a), Some(b)) => Some(f64::from(a - b) / 2.0),
                    (Some(a), None) => Some(f64::from(a - values[at])),
                    (None, Some(b)) => Some(f64::from(values[at] - b)),
                    (None, None) => None,
                }
            };
            let change = |at: usize| {
                let slope = Vector2::new(along(at, at % width, width, 1)?, along(at, at / width, height, width)?);
                Some(slope.dot(&self.by).abs()).filter(|it| it.is_finite())
            };
            let known: Vec<usize> = (0..values.len()).filter(|it| values[*it].is_finite()).collect();
            let changes: Vec<Option<f64>> = known.iter().map(|at| change(*at)).collect();
            let mut sorted: Vec<f64> = changes.iter().flatten().copied().collect();
            sorted.sort_by(f64::total_cmp);
            let usual = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
            for (at, change) in known.into_iter().zip(changes) {
                // Evenly spread over so long a way to either side.
                let sigma = change.unwrap_or(usual) / 3_f64.sqrt();
                let own = &mut coordinates.sigmas[axis][at];
                *own = f64::from(*own).hypot(sigma) as f32;
            }
        }
    }
}

/// A small move, if there was one, in a set whose picture k is `pictures[k]`; a pixel is lit where white − black is at least `min_contrast`.
pub fn drift(code: &StripeCode, pictures: &[ImageView<'_>], min_contrast: u8) -> Option<Drift> {
    let shown = code.pictures();
    let picture = |what: Shown| shown.iter().position(|it| *it == what).filter(|it| *it < pictures.len());
    let (white, black) = (pictures[picture(Shown::White)?].pixels(), pictures[picture(Shown::Black)?].pixels());
    let mut pairs: Vec<[usize; 2]> = Vec::new();
    let mut add = |a: Shown, b: Shown| pairs.extend(picture(a).zip(picture(b)).map(|(a, b)| [a.min(b), a.max(b)]));
    for axis in Axis::BOTH.into_iter().filter(|it| code.has(*it)) {
        for plane in 0..code.bits[axis.index()] {
            let bit = |inverse: bool| Shown::Bit { axis, plane, inverse };
            if code.inverse != Inverse::None {
                add(bit(false), bit(true));
            }
        }
        for step in (0..code.steps / 2).filter(|_| code.steps.is_multiple_of(2)) {
            add(Shown::Phase { axis, step }, Shown::Phase { axis, step: step + code.steps / 2 });
        }
    }
    add(Shown::White, Shown::Black);
    pairs.sort_unstable();
    if pairs.len() < 2 * MIN_SUMS {
        return None;
    }
    let (width, height) = pictures.first()?.size();
    let n = width * height;
    let mut scene = vec![0.0_f32; n];
    for [a, b] in &pairs {
        let both = pictures[*a].pixels().iter().zip(pictures[*b].pixels());
        scene.iter_mut().zip(both).for_each(|(to, (a, b))| *to += f32::from(*a) + f32::from(*b));
    }
    let level = |at: usize| f64::from(scene[at]) / pairs.len() as f64;
    let is_lit = |at: &usize| {
        let (x, y) = (at % width, at / width);
        let is_inside = (1..width - 1).contains(&x) && (1..height - 1).contains(&y);
        is_inside && white[*at] < SATURATED && white[*at] >= black[*at].saturating_add(min_contrast)
    };
    let lit: Vec<usize> = (0..n).filter(is_lit).collect();
    let slope = |at: usize| {
        let slope = Vector2::new(level(at + 1) - level(at - 1), level(at + width) - level(at - width)) / 2.0;
        (slope.norm() <= EDGE * level(at)).then_some((at, Vector4::new(level(at), 1.0, -slope.x, -slope.y)))
    };
    let some = lit.iter().step_by(lit.len().div_ceil(SAMPLES).max(1));
    let samples: Vec<(usize, Vector4<f64>)> = some.filter_map(|it| slope(*it)).collect();
    if samples.len() < MIN_SAMPLES {
        return None;
    }
    let places: Vec<Vector2<f64>> = pairs.iter().map(|pair| place(pictures, *pair, &samples)).collect::<Option<_>>()?;
    let mean = |of: &[Vector2<f64>]| of.iter().sum::<Vector2<f64>>() / of.len() as f64;
    let scatter = |of: &[Vector2<f64>]| of.iter().map(|it| (it - mean(of)).norm_squared()).sum::<f64>();
    // The split that leaves least scatter.
    let splits = MIN_SUMS..=pairs.len() - MIN_SUMS;
    let left = |it: usize| scatter(&places[..it]) + scatter(&places[it..]);
    let split = splits.min_by(|a, b| left(*a).total_cmp(&left(*b)))?;
    let by = mean(&places[split..]) - mean(&places[..split]);
    let [before, after] = [split, pairs.len() - split].map(|it| it as f64);
    let variance = left(split) / (before + after - 2.0);
    let sigma = (variance * (1.0 / before + 1.0 / after)).sqrt();
    let is_told = variance.sqrt() <= KNOWN.max(by.norm() / 4.0) && by.norm() >= LEAST.max(SIGMAS * sigma);
    // Sums of steps reach from the first half of the steps into the second: what moved among these lies between.
    let first = pairs[split][0];
    let last = pairs[..split].iter().map(|it| it[0]).max()?;
    is_told.then_some(Drift { last, first, by })
}

/// Where the scene lies in the sum of two pictures.
fn place(pictures: &[ImageView<'_>], pair: [usize; 2], samples: &[(usize, Vector4<f64>)]) -> Option<Vector2<f64>> {
    let levels = |at: usize| pair.iter().map(|it| f64::from(pictures[*it].pixels()[at])).sum::<f64>();
    let mut most = f64::INFINITY;
    let mut found = Vector4::new(1.0, 0.0, 0.0, 0.0);
    for _ in 0..TURNS {
        let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
        let mut off: Vec<f64> = Vec::with_capacity(samples.len());
        for (at, row) in samples {
            let level = levels(*at);
            let misfit = (level - row.dot(&found)).abs();
            off.push(misfit);
            if misfit <= most {
                normal += row * row.transpose();
                right += row * level;
            }
        }
        found = normal.try_inverse()? * right;
        off.sort_by(f64::total_cmp);
        most = OUTSIDE * 1.4826 * off[off.len() / 2];
    }
    Some(Vector2::new(found.z, found.w))
}

#[cfg(test)]
mod tests {
    use super::super::scene::{Scene, wall};
    use super::*;

    /// What is found of a wall's set that moved by so much from one of its pictures on.
    fn found(code: &StripeCode, from: usize, by: f64, seed: u64) -> Option<Drift> {
        let still = wall(seed).pictures(code);
        // The place of the scene is told by what is seen there.
        let moved = match by {
            0.0 => still.clone(),
            0.25 => Scene {
                projector: |x, y| (wall(1).projector)(x - 0.25, y),
                albedo: |x, y| (wall(1).albedo)(x - 0.25, y),
                shadow: |x, y| (wall(1).shadow)(x - 0.25, y),
                ..wall(seed)
            }
            .pictures(code),
            _ => Scene {
                projector: |x, y| (wall(1).projector)(x - 0.6, y),
                albedo: |x, y| (wall(1).albedo)(x - 0.6, y),
                shadow: |x, y| (wall(1).shadow)(x - 0.6, y),
                ..wall(seed)
            }
            .pictures(code),
        };
        let pictures: Vec<Vec<u8>> = still.into_iter().take(from).chain(moved.into_iter().skip(from)).collect();
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        drift(code, &views, 12)
    }

    #[test]
    fn coordinates_are_as_vague_as_the_move_makes_them() {
        let size = [20, 10];
        // Two projector pixels to a pixel along rows, a half down columns; one pixel is alone.
        let mut columns: Vec<f32> = (0..200).map(|at| 2.0 * (at % 20) as f32 + 0.5 * (at / 20) as f32).collect();
        columns[45] = f32::NAN;
        let mut coordinates = Coordinates {
            size,
            values: [columns, Vec::new()],
            sigmas: [vec![0.1; 200], Vec::new()],
            ..Coordinates::default()
        };
        Drift { last: 3, first: 4, by: Vector2::new(0.3, 0.0) }.widen(&mut coordinates);
        let expected = 0.1_f32.hypot(0.6 / 3_f32.sqrt());
        let is_known = (0..200).filter(|it| *it != 45);
        assert!(is_known.clone().all(|it| (coordinates.sigmas[0][it] - expected).abs() < 1e-4));
        assert_eq!(coordinates.sigmas[0][45], 0.1);
    }

    #[test]
    fn a_camera_that_moved_by_less_than_a_pixel_is_noticed() {
        for (code, from) in [
            (StripeCode::gray([160, 120]), 14),
            (StripeCode::gray([160, 120]), 23),
            (StripeCode::phase([160, 120], 8, 8), 12),
            (StripeCode::phase([160, 120], 8, 8), 16),
            (StripeCode::phase([160, 120], 4, 8), 14),
        ] {
            for seed in 1..=2 {
                assert_eq!(found(&code, from, 0.0, seed), None, "{} pictures", code.pictures().len());
                for by in [0.25, 0.6] {
                    let drift = found(&code, from, by, seed).unwrap_or_else(|| panic!("{from}, {by} px, seed {seed}"));
                    // Sums of steps of before and after lie between.
                    let range = 0.6 * by..1.15 * by + 0.03;
                    assert!(range.contains(&drift.by.norm()), "{from}, {by} px: {drift:?}");
                    assert!(drift.last < from + 4 && drift.first + 4 >= from, "{from}, {by} px: {drift:?}");
                }
            }
        }
    }
}
