//! Triangles with a depth for each pixel, drawn at four moments at once.
//!
//! What is worked out for a triangle, a row of it and a pixel is much the same at all moments: each number here is four of them, one a moment. A moment
//! at which nothing is to be drawn has corners that all lie at the origin; so has one that is not there.

use wide::{f32x4, i32x4};

use crate::painted::{Texture, Triangle};

/// Moments that are drawn at once.
pub(super) const LANES: usize = 4;

/// A vertex as it is drawn at each moment.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Corner {
    /// [px]
    pub x: [f32; LANES],
    pub y: [f32; LANES],
    /// [m]
    pub depth: [f32; LANES],
    /// What the surface throws back to all sides, for an albedo of 1 [steps].
    pub light: [f32; LANES],
    /// What it throws back as a mirror does [steps].
    pub shine: [f32; LANES],
}

/// What is drawn on.
pub(super) struct Canvas<'s> {
    /// Columns, rows [px].
    pub size: [usize; 2],
    /// Of each pixel at each moment, [m]; infinite where nothing was drawn.
    pub depths: &'s mut [f32x4],
    /// [steps]
    pub lights: &'s mut [f32x4],
}

/// A triangle reaches this far beyond its edges [px], so that no gaps are left between two of them.
const OVERLAP: f32 = 1e-3;

/// What changes linearly over a triangle: depth, light, shine.
type Values = [f32x4; 3];

impl Canvas<'_> {
    /// Draws a triangle at the moments at which it faces the camera.
    #[inline]
    pub fn draw(&mut self, corners: &[Corner], triangle: &Triangle, texture: &Texture) {
        let [a, b, c] = triangle.corners.map(|it| &corners[it as usize]);
        let place = |corner: &Corner| [f32x4::from(corner.x), f32x4::from(corner.y)];
        let ([ax, ay], [bx, by], [cx, cy]) = (place(a), place(b), place(c));
        let (abx, aby, acx, acy) = (bx - ax, by - ay, cx - ax, cy - ay);
        // Rows run downwards: seen from outside corners run clockwise here.
        let doubled = acx * aby - abx * acy;
        let faces = doubled.simd_gt(f32x4::splat(1e-6));
        if faces.to_bitmask() == 0 {
            return;
        }
        let (zero, one, overlap) = (f32x4::splat(0.0), f32x4::splat(1.0), f32x4::splat(OVERLAP));
        let bound = |a: f32x4, b: f32x4, c: f32x4, size: usize| {
            let from = ceiling(a.fast_min(b).fast_min(c) - overlap).fast_max(zero);
            let to = (floored(a.fast_max(b).fast_max(c) + overlap) + one).fast_min(f32x4::splat(size as f32));
            (from, to)
        };
        let (left, right) = bound(ax, bx, cx, self.size[0]);
        let (top, bottom) = bound(ay, by, cy, self.size[1]);
        let is_drawn = faces & left.simd_lt(right) & top.simd_lt(bottom);
        let Some(rows) = span(is_drawn, top, bottom) else { return };

        let per = one / doubled;
        // Weights of b and c: linear in column and row.
        let (b_dx, b_dy) = (-acy * per, acx * per);
        let (c_dx, c_dy) = (aby * per, -abx * per);
        let values = |corner: &Corner| [corner.depth, corner.light, corner.shine].map(f32x4::from);
        let (at_a, at_b, at_c): (Values, Values, Values) = (values(a), values(b), values(c));
        let (to_b, to_c): (Values, Values) =
            (std::array::from_fn(|i| at_b[i] - at_a[i]), std::array::from_fn(|i| at_c[i] - at_a[i]));
        let across: Values = std::array::from_fn(|i| to_b[i] * b_dx + to_c[i] * c_dx);
        // Places in the texture.
        let texels = &triangle.texels;
        let texel_a = [0, 1].map(|axis| f32x4::splat(texels[0][axis]));
        let texel_b = [0, 1].map(|axis| f32x4::splat(texels[1][axis] - texels[0][axis]));
        let texel_c = [0, 1].map(|axis| f32x4::splat(texels[2][axis] - texels[0][axis]));
        let texel_across = [0, 1].map(|axis| texel_steps(texel_b[axis] * b_dx + texel_c[axis] * c_dx));
        // Where a weight that changes by `slope` in a column is 0: from there on, or up to there, is the triangle.
        let edges = [b_dx, c_dx, -(b_dx + c_dx)].map(|slope| {
            let reciprocal = slope.simd_eq(zero).select(zero, f32x4::splat(-1.0) / slope);
            let from = slope.simd_gt(zero).select(-overlap, f32x4::splat(f32::NEG_INFINITY));
            let to = slope.simd_lt(zero).select(overlap, f32x4::splat(f32::INFINITY));
            (reciprocal, from, to)
        });
        let last = right - left - one;
        let dx = left - ax;
        for row in rows {
            let at = f32x4::splat(row as f32);
            let dy = at - ay;
            let of_b = b_dx * dx + b_dy * dy;
            let of_c = c_dx * dx + c_dy * dy;
            let (mut first, mut end) = (zero, last);
            for (weight, (reciprocal, from, to)) in [of_b, of_c, one - of_b - of_c].into_iter().zip(edges) {
                let crossed = weight * reciprocal;
                first = (crossed + from).fast_max(first);
                end = (crossed + to).fast_min(end);
            }
            let (first, end) = (ceiling(first), floored(end) + one);
            let (start, stop) = (left + first, left + end);
            let is_drawn = is_drawn & at.simd_ge(top) & at.simd_lt(bottom) & first.simd_lt(end);
            let Some(columns) = span(is_drawn, start, stop) else { continue };

            let (of_b, of_c) = (of_b + b_dx * first, of_c + c_dx * first);
            let mut now: Values = std::array::from_fn(|i| at_a[i] + to_b[i] * of_b + to_c[i] * of_c);
            // At the first column that any moment draws, so that each is in its place at its own first column.
            let ahead = (start - f32x4::splat(columns.start as f32)).fast_trunc_int();
            let mut place: [i32x4; 2] = std::array::from_fn(|axis| {
                let first = texel_steps(texel_a[axis] + (texel_b[axis] * of_b + texel_c[axis] * of_c));
                first - texel_across[axis] * ahead
            });
            let start = is_drawn.select(start, f32x4::splat(f32::INFINITY));
            let mut column = f32x4::splat(columns.start as f32);
            let pixels = row * self.size[0] + columns.start..row * self.size[0] + columns.end;
            let depths = &mut self.depths[pixels.clone()];
            for (depth, light) in depths.iter_mut().zip(&mut self.lights[pixels]) {
                let has_begun = column.simd_ge(start);
                let is_nearer = has_begun & column.simd_lt(stop) & now[0].simd_lt(*depth);
                if is_nearer.to_bitmask() != 0 {
                    *depth = is_nearer.select(now[0], *depth);
                    *light = is_nearer.select(now[1] * texture.at(place) + now[2], *light);
                }
                now = std::array::from_fn(|i| now[i] + (across[i] & has_begun));
                place = [place[0] + texel_across[0], place[1] + texel_across[1]];
                column += one;
            }
        }
    }
}

/// Whole numbers from the least of `from` to the greatest of `to`, of those that count; `None` where none does.
#[inline]
fn span(counts: f32x4, from: f32x4, to: f32x4) -> Option<std::ops::Range<usize>> {
    if counts.to_bitmask() == 0 {
        return None;
    }
    let [a, b, c, d] = counts.select(from, f32x4::splat(f32::INFINITY)).to_array();
    let [e, f, g, h] = counts.select(to, f32x4::splat(0.0)).to_array();
    let less = |a: f32, b: f32| if a < b { a } else { b };
    let more = |a: f32, b: f32| if a > b { a } else { b };
    Some(less(less(a, b), less(c, d)) as usize..more(more(e, f), more(g, h)) as usize)
}

/// ⌈x⌉, for numbers that fit in 32 bits.
#[inline]
fn ceiling(x: f32x4) -> f32x4 {
    let whole = f32x4::from_i32x4(x.fast_trunc_int());
    whole + (whole.simd_lt(x) & f32x4::splat(1.0))
}

/// ⌊x⌋, for numbers that fit in 32 bits.
#[inline]
fn floored(x: f32x4) -> f32x4 {
    let whole = f32x4::from_i32x4(x.fast_trunc_int());
    whole - (whole.simd_gt(x) & f32x4::splat(1.0))
}

/// Places in a texture in 65,536ths of a texel.
#[inline]
fn texel_steps(texels: f32x4) -> i32x4 {
    (texels * f32x4::splat(65_536.0)).fast_trunc_int()
}
