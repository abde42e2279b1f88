//! Bias of patches on a curved surface: each is matched as if it were flat, which gives the surface's mean over the patch.
//!
//! Where matches go over a patch of n pixels as m(u, v), the affine fit has m + (m_uu + m_vv)/2 · (n² − 1)/12 at its middle, for (n² − 1)/12 is the mean of u² and of v² over its pixels, and slopes have no part in it.
//! The curvature is estimated from the points around; the known part is subtracted, and the rest is added to the covariance.

use std::collections::HashMap;

use nalgebra::{Matrix2, Matrix3, Point3, SMatrix, SVector, Vector2};

use crate::measure::{MeasureOptions, Sample, Seen, meet};
use crate::views::View;

/// Points around are taken within so many widths of the patch, a little more than it covers itself, or of the grid's squares, which makes 37 of them: whichever is more [–].
const AROUND: f64 = 0.8;
const AROUND_GRID: f64 = 3.3;
/// Fewest points around: a parabola in two directions has six parameters.
const LEAST: usize = 12;
/// Matches of the points around that are off by more than this part of their distance from the middle, and so many pixels, lie on another surface [–].
const OFF: f64 = 0.5;
const OFF_PX: f64 = 0.5;
/// Matches that are off a parabola by so many standard deviations, and by as much as it bends, lie on an edge [–]; no match is better than this many pixels.
const UNLIKE: f64 = 3.0;
const LEAST_SIGMA_PX: f64 = 0.02;
/// Patches that overlap err together, so that more points do not tell more: of the variance of a match, this much is what is taken off uncertain by at least [–].
const LEAST_SCATTER: f64 = 0.2;
/// Points around that lie on one side: how far their middle is off, over how far they reach, that makes them doubtful [–]. Of half a disc it is 0.42.
const ONE_SIDED: f64 = 0.6;

/// Position of a point without the bias, and its covariance [m, m²].
pub type Straight = (Point3<f64>, Matrix3<f64>);

/// Positions of the samples without the bias. Samples with too few others around stay as measured.
pub fn straightened(views: &[View], samples: &[&Sample], options: &MeasureOptions, spacing_px: usize) -> Vec<Straight> {
    let width = (2 * options.reach + 1) as f64;
    let around = (AROUND * width).max(AROUND_GRID * spacing_px as f64);
    let cell = |at: [f64; 2]| at.map(|it| (it / around).floor() as i32);
    let mut cells: HashMap<[i32; 2], Vec<usize>> = HashMap::new();
    for (index, it) in samples.iter().enumerate() {
        cells.entry(cell(it.pixel)).or_default().push(index);
    }
    let mut near = Vec::new();
    let straight = |sample: &&Sample| {
        near.clear();
        let [x, y] = cell(sample.pixel);
        for place in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| [x + dx, y + dy])) {
            let listed = cells.get(&place).into_iter().flatten().map(|it| samples[*it]);
            near.extend(listed.filter(|it| it.reference == sample.reference && apart(sample, it).norm() < around));
        }
        let seen: Vec<Seen> = sample.seen.iter().map(|it| unbent(sample, it, &near, width, around)).collect();
        let found = meet(views, sample.reference, sample.pixel, &seen, options.camera_sigma_px);
        found.map_or((sample.position, sample.covariance), |it| (it.0, it.1))
    };
    samples.iter().map(straight).collect()
}

/// In the reference [px].
fn apart(from: &Sample, to: &Sample) -> Vector2<f64> {
    Vector2::new(to.pixel[0] - from.pixel[0], to.pixel[1] - from.pixel[1])
}

/// A match without what the bending of matches around it makes of it.
fn unbent(sample: &Sample, seen: &Seen, near: &[&Sample], width: f64, around: f64) -> Seen {
    // Matches less what this one's slopes say: c + gᵀp + ½ pᵀ H p, in widths of the patch.
    let (mut normal, mut side) = (SMatrix::<f64, 6, 6>::zeros(), SMatrix::<f64, 6, 2>::zeros());
    let (mut squares, mut n) = (0.0, 0);
    for other in near {
        let offset = apart(sample, other);
        let Some(there) = other.seen.iter().find(|it| it.view == seen.view) else { continue };
        let expected = seen.warp.apply([offset.x, offset.y]);
        let rest = Vector2::new(there.warp.at[0] - expected[0], there.warp.at[1] - expected[1]);
        if rest.norm() > OFF * offset.norm() + OFF_PX {
            continue;
        }
        let at = offset / width;
        let row = SVector::from([1.0, at.x, at.y, at.x * at.x / 2.0, at.x * at.y, at.y * at.y / 2.0]);
        normal += row * row.transpose();
        side += row * rest.transpose();
        squares += rest.norm_squared();
        n += 1;
    }
    let Some(inverse) = normal.try_inverse().filter(|_| n >= LEAST) else { return *seen };
    let found = inverse * side;
    // What is left of the squares, over both directions.
    let left = (squares - (side.transpose() * found).trace()).max(0.0) / (2 * (n - 6)) as f64;
    let share = (width * width - 1.0) / (12.0 * width * width);
    let bend = (found.row(3) + found.row(5)).transpose() * (share / 2.0);
    let variance = seen.covariance.trace() / 2.0 + LEAST_SIGMA_PX * LEAST_SIGMA_PX;
    let lean = Vector2::new(normal[(0, 1)], normal[(0, 2)]).norm() * width / (around * n as f64);
    let known = (share / 2.0).powi(2) * (inverse[(3, 3)] + 2.0 * inverse[(3, 5)] + inverse[(5, 5)]);
    let scatter = known.max(LEAST_SCATTER) * variance;
    // As far as it is known better than the match itself, the surface around is like a parabola, and there are points on all sides.
    let doubt = (scatter / variance).powi(2)
        + (left / (UNLIKE * UNLIKE * variance + bend.norm_squared() / 2.0)).powi(2)
        + (lean / ONE_SIDED).powi(4);
    let taken = 1.0 / (1.0 + doubt);
    let rest = bend * (1.0 - taken);
    let mut straight = *seen;
    straight.warp.at = [seen.warp.at[0] - taken * bend.x, seen.warp.at[1] - taken * bend.y];
    straight.covariance += Matrix2::identity() * (taken * taken * scatter) + rest * rest.transpose();
    straight
}
