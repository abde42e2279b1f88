//! Colour of a surface in a picture that is looked up as sharply as a camera resolves it: a pyramid of pictures, each half as large as the one before, between which is interpolated.
//!
//! Source: L. Williams, "Pyramidal parametrics", SIGGRAPH 1983. Along columns the picture is a ring, as around a limb.

use std::sync::{Mutex, PoisonError};

/// Levels of the pyramid; sides are multiples of what the last one needs.
const LEVELS: usize = 6;
/// Rows that are painted in one go.
const BAND: usize = 16;

/// Red, green, blue: shares of light that are thrown back [–].
pub(crate) type Colour = [f32; 3];

/// A picture and its smaller ones.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Pyramid {
    levels: Vec<Level>,
}

#[derive(Debug, Clone, PartialEq)]
struct Level {
    size: [usize; 2],
    /// Shares of 255; the fourth is unused: four bytes are fetched as one.
    texels: Vec<[u8; 4]>,
}

/// The least size of a picture that has at least `columns` and `rows` [texel].
pub(crate) fn size_for(columns: f64, rows: f64) -> [usize; 2] {
    let step = 1 << (LEVELS - 1);
    [columns, rows].map(|it| ((it.max(1.0) as usize).div_ceil(step) * step).max(step))
}

impl Pyramid {
    /// A picture of a size by [`size_for`]; `colour` tells it at the middle of each texel, given in shares of both sides. Bands of rows are distributed over all
    /// cores; each row is the same whichever core paints it.
    pub fn paint([width, height]: [usize; 2], colour: impl Fn(f64, f64) -> Colour + Sync) -> Self {
        let mut texels = vec![[0_u8; 4]; width * height];
        let bands = Mutex::new(texels.chunks_mut(width * BAND).enumerate());
        let next = || bands.lock().unwrap_or_else(PoisonError::into_inner).next();
        let work = || {
            while let Some((band, rows)) = next() {
                for (row, texels) in rows.chunks_exact_mut(width).enumerate() {
                    let v = (band * BAND + row) as f64 + 0.5;
                    for (column, texel) in texels.iter_mut().enumerate() {
                        let [r, g, b] = colour((column as f64 + 0.5) / width as f64, v / height as f64)
                            .map(|it| (it.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
                        *texel = [r, g, b, 0];
                    }
                }
            }
        };
        let n_threads = std::thread::available_parallelism().map_or(1, usize::from);
        std::thread::scope(|scope| {
            (1..n_threads).for_each(|_| {
                scope.spawn(work);
            });
            work();
        });
        let mut levels = vec![Level { size: [width, height], texels }];
        for _ in 1..LEVELS {
            let halved = levels[levels.len() - 1].halved();
            levels.push(halved);
        }
        Self { levels }
    }

    /// The colour at a place, given in shares of both sides; columns go around. `resolved` is the length that is [texel of the first level].
    #[inline]
    pub fn at(&self, [u, v]: [f32; 2], resolved: f32) -> Colour {
        let level = octaves(resolved).clamp(0.0, (LEVELS - 1) as f32);
        let (first, between) = (level as usize, level.fract());
        let [mut r, mut g, mut b, _] = self.levels[first].at(u, v);
        if between >= 1e-3 {
            let coarse = self.levels[(first + 1).min(LEVELS - 1)].at(u, v);
            r += (coarse[0] - r) * between;
            g += (coarse[1] - g) * between;
            b += (coarse[2] - b) * between;
        }
        [r, g, b]
    }

    /// Columns and rows of the first level [texel].
    pub fn size(&self) -> [usize; 2] {
        self.levels[0].size
    }
}

impl Level {
    fn halved(&self) -> Level {
        let [width, height] = self.size.map(|it| it / 2);
        let texel = |column: usize, row: usize, channel: usize| {
            let at =
                |dx: usize, dy: usize| u16::from(self.texels[(2 * row + dy) * 2 * width + 2 * column + dx][channel]);
            ((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1) + 2) / 4) as u8
        };
        let places = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let texels = places.map(|(column, row)| [0, 1, 2, 3].map(|it| texel(column, row, it))).collect();
        Level { size: [width, height], texels }
    }

    /// Between the four texels around.
    #[inline]
    fn at(&self, u: f32, v: f32) -> [f32; 4] {
        let [width, height] = self.size;
        let (x, y) = (u * width as f32 - 0.5, (v * height as f32 - 0.5).clamp(0.0, (height - 1) as f32));
        let left = if x < 0.0 { x as i32 - 1 } else { x as i32 };
        let (right, down) = (x - left as f32, y.fract());
        let wrapped = |it: i32| {
            let it = it as isize;
            (if it < 0 {
                it + width as isize
            } else if it >= width as isize {
                it - width as isize
            } else {
                it
            }) as usize
        };
        let (column, next, row) = (wrapped(left).min(width - 1), wrapped(left + 1).min(width - 1), y as usize);
        let below = (row + 1).min(height - 1);
        let [a, b, c, d] = [row * width + column, row * width + next, below * width + column, below * width + next]
            .map(|it| self.texels[it]);
        let weights = [(1.0 - right) * (1.0 - down), right * (1.0 - down), (1.0 - right) * down, right * down];
        let [wa, wb, wc, wd] = weights.map(|it| it * (1.0 / 255.0));
        std::array::from_fn(|it| {
            f32::from(a[it]) * wa + f32::from(b[it]) * wb + f32::from(c[it]) * wc + f32::from(d[it]) * wd
        })
    }
}

/// About the logarithm of a number to the base of 2, exact at whole powers and linear between them.
#[inline]
fn octaves(x: f32) -> f32 {
    let bits = x.to_bits();
    let whole = (bits >> 23) as i32 - 127;
    whole as f32 + f32::from_bits(bits & 0x007F_FFFF | 0x3F80_0000) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wave_is_looked_up_where_it_is_and_fades_where_it_is_not_resolved() {
        let size = size_for(250.0, 60.0);
        assert_eq!(size, [256, 64]);
        let wave = |u: f64| (0.5 + 0.4 * (u * 8.0 * std::f64::consts::TAU).sin()) as f32;
        let pyramid = Pyramid::paint(size, |u, v| [wave(u), v as f32, 0.25]);
        for step in 0..200 {
            let u = f64::from(step) * 0.00497 + 0.001;
            let [r, g, b] = pyramid.at([u as f32, 0.4], 1.0);
            assert!((r - wave(u)).abs() < 0.01, "{r} {} at {u}", wave(u));
            assert!((g - 0.4).abs() < 0.01 && (b - 0.25).abs() < 0.01);
        }
        // A period of 32 texels is gone where 32 texels are one.
        let [low, high] = [0.0, 1.0].map(|from| {
            let all = (0..64).map(|it| pyramid.at([it as f32 / 64.0, 0.5], 32.0)[0]);
            all.fold(from, if from > 0.5 { f32::min } else { f32::max })
        });
        assert!((low - high).abs() < 0.02, "{low} {high}");
    }

    #[test]
    fn octaves_are_those_of_the_logarithm() {
        for step in 1..400 {
            let x = step as f32 * 0.13;
            assert!((octaves(x) - x.log2()).abs() < 0.087, "{x}");
        }
        assert_eq!([0.25, 1.0, 32.0].map(octaves), [-2.0, 0.0, 5.0]);
    }

    #[test]
    fn left_and_right_end_meet() {
        let pyramid = Pyramid::paint([64, 32], |u, _| [(u * std::f64::consts::TAU).cos() as f32 * 0.5 + 0.5, 0.0, 0.0]);
        let [before, after] = [0.9995, 0.0005].map(|it| pyramid.at([it, 0.5], 1.0)[0]);
        assert!((before - after).abs() < 2e-3 && before > 0.99, "{before} {after}");
    }
}
