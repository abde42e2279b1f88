//! A picture at several resolutions, each half of the one before.
//!
//! Each level is the one before, smoothed by the binomial (1 4 6 4 1)/16 in both directions and thinned out by two:
//! P. J. Burt, E. H. Adelson, "The Laplacian pyramid as a compact image code", IEEE Trans. Communications 31(4), 1983.
//! Beyond its border a picture repeats its outermost pixels. Pixel (x, y) of level l lies at (2ˡ x, 2ˡ y) of the
//! picture.

use crate::ImageView;

/// The levels of one picture; its memory is used again by each [`Pyramid::build`].
#[derive(Debug, Clone, Default)]
pub struct Pyramid {
    levels: Vec<Level>,
    /// How many of `levels` are of the present picture.
    n_levels: usize,
    /// One row, smoothed over five rows: sixteen times its level; two pixels more at either end.
    row: Vec<u16>,
}

#[derive(Debug, Clone, Default)]
struct Level {
    pixels: Vec<u8>,
    width: usize,
    height: usize,
}

impl Pyramid {
    /// Takes `picture` as level 0 and makes up to `n_levels` levels in all, as long as they have pixels; at least level 0.
    pub fn build(&mut self, picture: &ImageView<'_>, n_levels: usize) {
        if self.levels.is_empty() {
            self.levels.push(Level::default());
        }
        let base = &mut self.levels[0];
        base.pixels.clear();
        base.pixels.extend_from_slice(picture.pixels());
        (base.width, base.height) = picture.size();
        self.n_levels = 1;
        while self.n_levels < n_levels {
            let last = &self.levels[self.n_levels - 1];
            if last.width < 2 || last.height < 2 {
                break;
            }
            if self.levels.len() == self.n_levels {
                self.levels.push(Level::default());
            }
            let (fine, coarse) = self.levels.split_at_mut(self.n_levels);
            halve(&fine[self.n_levels - 1], &mut coarse[0], &mut self.row);
            self.n_levels += 1;
        }
    }

    /// How many levels there are: 0 before the first picture.
    pub fn n_levels(&self) -> usize {
        self.n_levels
    }

    /// One level, 0 the picture itself; panics where there is none.
    pub fn level(&self, level: usize) -> ImageView<'_> {
        let Level { pixels, width, height } = &self.levels[..self.n_levels][level];
        ImageView::new(pixels, *width, *height).unwrap_or_else(|_| unreachable!("levels are as large as they say"))
    }

    /// (width, height) of the picture [px]; (0, 0) before the first.
    pub fn size(&self) -> (usize, usize) {
        if self.n_levels == 0 { (0, 0) } else { (self.levels[0].width, self.levels[0].height) }
    }
}

fn halve(fine: &Level, coarse: &mut Level, row: &mut Vec<u16>) {
    let (width, height) = (fine.width, fine.height);
    (coarse.width, coarse.height) = (width.div_ceil(2), height.div_ceil(2));
    coarse.pixels.resize(coarse.width * coarse.height, 0);
    // An even number of pixels, two before the first and three or two after the last.
    row.resize(2 * coarse.width + 4, 0);
    let line = |y: isize| {
        let y = y.clamp(0, height as isize - 1) as usize;
        &fine.pixels[y * width..(y + 1) * width]
    };
    for (y, out) in coarse.pixels.chunks_exact_mut(coarse.width).enumerate() {
        let y = 2 * y as isize;
        smooth_down([line(y - 2), line(y - 1), line(y), line(y + 1), line(y + 2)], &mut row[2..width + 2]);
        let (first, last) = (row[2], row[width + 1]);
        row[..2].fill(first);
        row[width + 2..].fill(last);
        let (pairs, _) = row.as_chunks::<2>();
        thin_out(pairs, out);
    }
}

/// `out` = r₀ + 4 r₁ + 6 r₂ + 4 r₃ + r₄, at most 16 · 255.
fn smooth_down(rows: [&[u8]; 5], out: &mut [u16]) {
    let n = out.len();
    let [a, b, c, d, e] = rows.map(|it| &it[..n]);
    for i in 0..n {
        let [a, b, c, d, e] = [a[i], b[i], c[i], d[i], e[i]].map(u16::from);
        out[i] = a + e + 4 * (b + d) + 6 * c;
    }
}

/// The same along a row, at every second pixel; 256 · 255 and the half for rounding still fit.
fn thin_out(pairs: &[[u16; 2]], out: &mut [u8]) {
    let n = out.len();
    let (before, at, after) = (&pairs[..n], &pairs[1..n + 1], &pairs[2..n + 2]);
    for i in 0..n {
        let [[a, b], [c, d], [e, _]] = [before[i], at[i], after[i]];
        out[i] = ((a + e + 4 * (b + d) + 6 * c + 128) >> 8) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pyramid(pixels: &[u8], width: usize, height: usize, n_levels: usize) -> Pyramid {
        let mut pyramid = Pyramid::default();
        pyramid.build(&ImageView::new(pixels, width, height).unwrap(), n_levels);
        pyramid
    }

    /// The definition, pixel by pixel.
    fn plain(fine: &ImageView<'_>, x: usize, y: usize) -> u8 {
        let weights = [1.0, 4.0, 6.0, 4.0, 1.0];
        let mut sum = 0.0;
        for (j, wy) in weights.iter().enumerate() {
            for (i, wx) in weights.iter().enumerate() {
                let u = (2 * x + i).saturating_sub(2).min(fine.width() - 1);
                let v = (2 * y + j).saturating_sub(2).min(fine.height() - 1);
                sum += wx * wy / 256.0 * f64::from(fine.row(v)[u]);
            }
        }
        (sum + 0.5).floor() as u8
    }

    #[test]
    fn levels_are_what_the_definition_says() {
        for (width, height) in [(64, 48), (61, 47), (2, 2), (3, 9), (33, 2)] {
            let pixels: Vec<u8> = (0..width * height).map(|i| ((i * i * 7 + i * 31) % 256) as u8).collect();
            let pyramid = pyramid(&pixels, width, height, 4);
            assert!(pyramid.n_levels() >= 2);
            for level in 1..pyramid.n_levels() {
                let (fine, coarse) = (pyramid.level(level - 1), pyramid.level(level));
                assert_eq!(coarse.size(), (fine.width().div_ceil(2), fine.height().div_ceil(2)));
                for y in 0..coarse.height() {
                    for x in 0..coarse.width() {
                        assert_eq!(
                            coarse.row(y)[x],
                            plain(&fine, x, y),
                            "({x}, {y}) of level {level} of {width}x{height}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn white_stays_white_and_the_memory_serves_pictures_of_other_sizes() {
        let mut pyramid = pyramid(&[255; 70 * 40], 70, 40, 9);
        assert_eq!(pyramid.n_levels(), 7); // 70, 35, 18, 9, 5, 3, 2 wide; 1 high
        assert!((0..7).all(|it| pyramid.level(it).pixels().iter().all(|&it| it == 255)));
        pyramid.build(&ImageView::new(&[9; 12], 4, 3).unwrap(), 2);
        assert_eq!((pyramid.n_levels(), pyramid.level(1).size(), pyramid.size()), (2, (2, 2), (4, 3)));
        assert_eq!(pyramid.level(1).pixels(), [9; 4]);
    }

    #[test]
    fn an_empty_picture_has_one_empty_level() {
        assert_eq!(Pyramid::default().n_levels(), 0);
        let pyramid = pyramid(&[], 0, 7, 4);
        assert_eq!((pyramid.n_levels(), pyramid.size()), (1, (0, 7)));
    }
}
