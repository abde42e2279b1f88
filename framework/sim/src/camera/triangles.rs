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

/// What a pixel shows at each moment: depth and light lie next to each other, since both are read together.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pixel {
    /// [m]; infinite where nothing was drawn.
    pub depth: f32x4,
    /// [steps]
    pub light: f32x4,
}

impl Pixel {
    /// Nothing was drawn.
    pub const EMPTY: Pixel = Pixel { depth: f32x4::new([f32::INFINITY; LANES]), light: f32x4::new([0.0; LANES]) };
}

/// Pixels: from column and row, to column and row, the latter not included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Area {
    pub from: [usize; 2],
    pub to: [usize; 2],
}

impl Area {
    /// The smallest that holds both.
    pub fn with(self, other: Area) -> Area {
        Area {
            from: [0, 1].map(|axis| self.from[axis].min(other.from[axis])),
            to: [0, 1].map(|axis| self.to[axis].max(other.to[axis])),
        }
    }

    /// From row to row of a [`Canvas`] [px]: an odd number of lines of a cache, which is two pixels long, so that rows do not drive each other out.
    fn stride(&self) -> usize {
        ((self.to[0] - self.from[0]).div_ceil(2) | 1) * 2
    }

    /// How many pixels a [`Canvas`] has.
    pub fn n_pixels(&self) -> usize {
        self.stride() * (self.to[1] - self.from[1])
    }

    /// Where a row of the picture lies in a [`Canvas`].
    pub fn row(&self, row: usize) -> std::ops::Range<usize> {
        let start = (row - self.from[1]) * self.stride();
        start..start + self.to[0] - self.from[0]
    }
}

/// What is drawn on.
pub(super) struct Canvas<'s> {
    /// The part of the picture that it is.
    pub area: Area,
    pub pixels: &'s mut [Pixel],
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
        let bound = |a: f32x4, b: f32x4, c: f32x4, axis: usize| {
            let [first, end] = [self.area.from, self.area.to].map(|it| f32x4::splat(it[axis] as f32));
            let from = ceiling(a.fast_min(b).fast_min(c) - overlap).fast_max(first);
            let to = (floored(a.fast_max(b).fast_max(c) + overlap) + one).fast_min(end);
            (from, to)
        };
        let ((left, right), (top, bottom)) = (bound(ax, bx, cx, 0), bound(ay, by, cy, 1));
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
            let [from, to] = [columns.start, columns.end].map(|it| it - self.area.from[0]);
            for pixel in &mut self.pixels[self.area.row(row)][from..to] {
                let has_begun = column.simd_ge(start);
                let is_nearer = has_begun & column.simd_lt(stop) & now[0].simd_lt(pixel.depth);
                if is_nearer.to_bitmask() != 0 {
                    let light = now[1] * texture.at(place) + now[2];
                    *pixel = Pixel {
                        depth: is_nearer.select(now[0], pixel.depth),
                        light: is_nearer.select(light, pixel.light),
                    };
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

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;
    use crate::painted::Material;

    const AREA: Area = Area { from: [3, 2], to: [44, 33] };
    const SIDE: usize = 64;

    /// A triangle of one moment as it is drawn by the book: each pixel whose three weights are not below 0, by a hair.
    fn draw_plainly(
        corners: &[Corner],
        triangle: &Triangle,
        texture: &Texture,
        lane: usize,
        drawn: &mut [(f64, f64)],
        doubtful: &mut [bool],
    ) {
        let [a, b, c] = triangle.corners.map(|it| {
            let corner = &corners[it as usize];
            [corner.x, corner.y, corner.depth, corner.light, corner.shine].map(|it| f64::from(it[lane]))
        });
        let doubled = (c[0] - a[0]) * (b[1] - a[1]) - (b[0] - a[0]) * (c[1] - a[1]);
        for (i, (drawn, doubtful)) in drawn.iter_mut().zip(doubtful).enumerate() {
            let (x, y) = ((AREA.from[0] + i % width()) as f64, (AREA.from[1] + i / width()) as f64);
            let of_b = ((c[0] - a[0]) * (y - a[1]) - (x - a[0]) * (c[1] - a[1])) / doubled;
            let of_c = ((x - a[0]) * (b[1] - a[1]) - (b[0] - a[0]) * (y - a[1])) / doubled;
            let weights = [1.0 - of_b - of_c, of_b, of_c];
            let mixed = |values: [f64; 3]| weights.iter().zip(values).map(|(weight, it)| weight * it).sum::<f64>();
            // So near to an edge [px], or between front and back of a sliver, rounding decides.
            let least = weights.iter().copied().fold(f64::INFINITY, f64::min);
            let is_near = [x, y].into_iter().enumerate().all(|(axis, at)| {
                let of = [a, b, c].map(|it| it[axis]);
                let [low, high] = [f64::min, f64::max].map(|pick| pick(pick(of[0], of[1]), of[2]));
                (low - 1.0..high + 1.0).contains(&at)
            });
            *doubtful |= is_near && (doubled.abs() < 1e-3 || least.abs() * doubled.abs() < 0.2);
            let depth = mixed([a[2], b[2], c[2]]);
            if doubled > 0.0 && least >= 0.0 {
                *doubtful |= (depth - drawn.0).abs() < 2e-3;
                if depth < drawn.0 {
                    let place = [0, 1].map(|axis| {
                        let texels = triangle.texels.map(|it| f64::from(it[axis]));
                        i32x4::splat((mixed(texels) * 65_536.0) as i32)
                    });
                    let albedo = f64::from(texture.at(place).to_array()[0]);
                    *drawn = (depth, mixed([a[3], b[3], c[3]]) * albedo + mixed([a[4], b[4], c[4]]));
                }
            }
        }
    }

    fn width() -> usize {
        AREA.to[0] - AREA.from[0]
    }

    /// Random triangles: small and large ones, ones that reach out of the picture, slivers, ones on whole pixels, points.
    fn drawn(random: &mut Random) -> (Vec<Corner>, Vec<Triangle>) {
        let (mut corners, mut triangles) = (Vec::new(), Vec::new());
        for number in 0..40_u32 {
            let middle = [random.uniform_in(-5.0, 55.0), random.uniform_in(-5.0, 45.0)];
            let reach = [1.5, 4.0, 30.0][number as usize % 3];
            for _ in 0..3 {
                let mut corner = Corner::default();
                let mut place = middle.map(|it| it + reach * random.uniform_in(-1.0, 1.0));
                match number % 10 {
                    3 => place = place.map(f64::round),
                    5 => place[1] = middle[1],
                    7 => place = middle,
                    _ => (),
                }
                let depth = random.uniform_in(1.0, 3.0);
                for lane in 0..LANES {
                    let moved = if number % 10 == 3 { 0.0 } else { 0.3 * lane as f64 };
                    corner.x[lane] = (place[0] + moved) as f32;
                    corner.y[lane] = (place[1] - 0.5 * moved) as f32;
                    corner.depth[lane] = (depth + 0.01 * lane as f64) as f32;
                    corner.light[lane] = random.uniform_in(0.0, 9000.0) as f32;
                    corner.shine[lane] = random.uniform_in(0.0, 900.0) as f32;
                }
                corners.push(corner);
            }
            let texels = [(); 3].map(|()| [(); 2].map(|()| random.uniform_in(1.0, SIDE as f64 - 3.0) as f32));
            triangles.push(Triangle { corners: [0, 1, 2].map(|it| 3 * number + it), texels, material: Material::Skin });
        }
        (corners, triangles)
    }

    fn pixels(corners: &[Corner], triangles: &[Triangle], texture: &Texture) -> Vec<Pixel> {
        let mut pixels = vec![Pixel::EMPTY; AREA.n_pixels()];
        let mut canvas = Canvas { area: AREA, pixels: &mut pixels };
        triangles.iter().for_each(|it| canvas.draw(corners, it, texture));
        (AREA.from[1]..AREA.to[1]).flat_map(|row| pixels[AREA.row(row)].to_vec()).collect()
    }

    #[test]
    fn each_moment_shows_its_own_triangles_and_the_nearest_of_them() {
        let mut random = Random::new(12);
        // Smooth: a place that is a hair aside is nearly as bright.
        let texture = Texture::new(SIDE, (0..SIDE * SIDE).map(|i| (60 + 2 * (i % SIDE) + i / SIDE) as u8).collect());
        let (mut n_compared, mut n_seen) = (0, 0);
        for _ in 0..30 {
            let (corners, triangles) = drawn(&mut random);
            let found = pixels(&corners, &triangles, &texture);
            for lane in 0..LANES {
                let mut expected = vec![(f64::INFINITY, 0.0); found.len()];
                let mut doubtful = vec![false; found.len()];
                for triangle in &triangles {
                    draw_plainly(&corners, triangle, &texture, lane, &mut expected, &mut doubtful);
                }
                for ((pixel, (depth, light)), _) in found.iter().zip(&expected).zip(&doubtful).filter(|it| !it.1) {
                    let [found_depth, found_light] =
                        [pixel.depth, pixel.light].map(|it| f64::from(it.to_array()[lane]));
                    assert_eq!(found_depth.is_finite(), depth.is_finite());
                    n_compared += 1;
                    if depth.is_finite() {
                        n_seen += 1;
                        let off = [found_depth - depth, found_light - light].map(f64::abs);
                        assert!(off[0] < 2e-3 && off[1] < 30.0, "{found_depth} {depth}, {found_light} {light}");
                    }
                }
            }
        }
        assert!(n_compared > 40_000 && n_seen > 10_000, "{n_seen} of {n_compared}");
    }

    #[test]
    fn a_moment_looks_the_same_whatever_the_others_show() {
        let mut random = Random::new(5);
        let texture = Texture::new(SIDE, (0..SIDE * SIDE).map(|_| random.below(256) as u8).collect());
        for _ in 0..20 {
            let (corners, triangles) = drawn(&mut random);
            let together = pixels(&corners, &triangles, &texture);
            for lane in 0..LANES {
                let alone: Vec<Corner> = corners
                    .iter()
                    .map(|it| {
                        let mut corner = Corner::default();
                        (corner.x[0], corner.y[0], corner.depth[0]) = (it.x[lane], it.y[lane], it.depth[lane]);
                        (corner.light[0], corner.shine[0]) = (it.light[lane], it.shine[lane]);
                        corner
                    })
                    .collect();
                for (alone, together) in pixels(&alone, &triangles, &texture).iter().zip(&together) {
                    let of = |pixel: &Pixel, lane: usize| [pixel.depth, pixel.light].map(|it| it.to_array()[lane]);
                    assert_eq!(of(alone, 0), of(together, lane));
                    assert!((1..LANES).all(|it| of(alone, it) == [f32::INFINITY, 0.0]));
                }
            }
        }
    }

    #[test]
    fn rows_of_a_canvas_lie_apart_in_a_cache() {
        for width in 1..70 {
            let area = Area { from: [5, 7], to: [5 + width, 11] };
            assert!(area.row(7) == (0..width) && area.row(10).end <= area.n_pixels());
            assert_eq!((area.row(8).start - area.row(7).start) % 4, 2, "width {width}");
        }
    }
}
