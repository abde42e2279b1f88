//! A gray surface with a known value everywhere, not only at pixels: input of rendered tests and benches.
//!
//! Disks of all sizes with edges as sharp as a good lens and a pixel make them (σ 0.8 px), and fine grain on them:
//! corners and edges as in a photograph. Both pictures of a pair evaluate the same function at their own places, so
//! that no interpolation affects the truth. [`Knitted`] is wool, as a camera sees it at half a millimetre a pixel.

/// A texture; each number gives another one.
#[derive(Debug, Clone, Copy)]
pub struct Texture(pub u64);

/// Sizes of the cells with a disk each, and how large disks and their steps are beside them [px, –, gray level].
const LAYERS: [(f64, f64, f64); 3] = [(23.0, 0.55, 90.0), (11.0, 0.5, 60.0), (5.0, 0.45, 30.0)];
const EDGE_PX: f64 = 0.8;
/// A logistic curve of this slope is a normal distribution function to 1 %.
const LOGISTIC: f64 = 1.702;

impl Texture {
    /// Gray level at a place of the surface, 0 to 255, not rounded.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        let mut level = 0.0;
        for (layer, (cell, size, step)) in LAYERS.iter().enumerate() {
            let (column, row) = ((x / cell).floor() as i64, (y / cell).floor() as i64);
            for j in row - 1..=row + 1 {
                for i in column - 1..=column + 1 {
                    let mut chance = Chance::of([self.0, layer as u64, i as u64, j as u64]);
                    let (cx, cy) = ((i as f64 + chance.uniform()) * cell, (j as f64 + chance.uniform()) * cell);
                    let radius = cell * size * (0.3 + 0.7 * chance.uniform());
                    let height = step * (2.0 * chance.uniform() - 1.0);
                    // An ellipse, so that no two corners are alike.
                    let (flat, turn) = (0.6 + 0.4 * chance.uniform(), 3.2 * chance.uniform());
                    let (sin, cos) = turn.sin_cos();
                    let (u, v) = (cos * (x - cx) + sin * (y - cy), (cos * (y - cy) - sin * (x - cx)) / flat);
                    level += height / (1.0 + (LOGISTIC * (u.hypot(v) - radius) / EDGE_PX).exp());
                }
            }
        }
        // Within what a pixel can hold, without a kink.
        127.5 + 127.5 * (level / 127.5).tanh()
    }

    /// A picture of the texture: pixel (x, y) shows the place `of(x, y)`; rounded to whole levels, with noise of that
    /// standard deviation [gray level].
    pub fn picture(&self, size: usize, noise: f64, seed: u64, of: impl Fn(f64, f64) -> [f64; 2]) -> Vec<u8> {
        picture(size, noise, seed, |x, y| {
            let [u, v] = of(x, y);
            self.at(u, v)
        })
    }
}

/// A picture whose pixel (x, y) has the level `at(x, y)`, rounded to whole levels, with noise of that standard deviation [gray level].
pub fn picture(size: usize, noise: f64, seed: u64, at: impl Fn(f64, f64) -> f64) -> Vec<u8> {
    let mut chance = Chance::of([seed, 77, 5, 3]);
    let mut pixels = Vec::with_capacity(size * size);
    for y in 0..size {
        for x in 0..size {
            let level = at(x as f64, y as f64);
            pixels.push((level + noise * chance.normal()).round().clamp(0.0, 255.0) as u8);
        }
    }
    pixels
}

/// Knitted wool: rows of V-shaped stitches that repeat, with figures in two tones and flecks of the yarn that do not. Each number gives another one.
#[derive(Debug, Clone, Copy)]
pub struct Knitted(pub u64);

/// Width and height of a stitch [px].
const STITCH_PX: [f64; 2] = [8.4, 6.4];
/// Sizes of figures and flecks [px], and how much they change the level [gray level].
const BLOTS: [(f64, f64); 4] = [(32.0, 30.0), (12.0, 20.0), (4.4, 14.0), (2.2, 8.0)];
/// A pixel is the mean of so many places along either side.
const PER_PIXEL: usize = 3;

impl Knitted {
    /// Gray level at a place, 0 to 255, not rounded.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        let column = x / STITCH_PX[0];
        let slanted = y / STITCH_PX[1] + 1.2 * (column.rem_euclid(1.0) - 0.5).abs();
        let turn = std::f64::consts::TAU;
        let stitch = 18.0 * (turn * slanted).cos() * (0.75 + 0.25 * (turn * column).cos());
        let blots =
            BLOTS.iter().enumerate().map(|(layer, (size, by))| by * self.blot(layer as u64, x / size, y / size));
        127.5 + 127.5 * ((stitch + blots.sum::<f64>()) / 127.5).tanh()
    }

    /// The level that a pixel sees whose sides lie along `right` and `down` around a place.
    pub fn seen(&self, [x, y]: [f64; 2], right: [f64; 2], down: [f64; 2]) -> f64 {
        let part = |it: usize| (it as f64 + 0.5) / PER_PIXEL as f64 - 0.5;
        let of = |i: usize| {
            let (a, b) = (part(i % PER_PIXEL), part(i / PER_PIXEL));
            self.at(x + a * right[0] + b * down[0], y + a * right[1] + b * down[1])
        };
        (0..PER_PIXEL * PER_PIXEL).map(of).sum::<f64>() / (PER_PIXEL * PER_PIXEL) as f64
    }

    /// Random values at whole numbers, smooth between them: of mean 0 and standard deviation about 1.
    fn blot(&self, layer: u64, x: f64, y: f64) -> f64 {
        let (column, row) = (x.floor(), y.floor());
        let smooth = |it: f64| it * it * it * (it * (it * 6.0 - 15.0) + 10.0);
        let (a, b) = (smooth(x - column), smooth(y - row));
        let of = |i: i64, j: i64| {
            let mut chance = Chance::of([self.0, 100 + layer, (column as i64 + i) as u64, (row as i64 + j) as u64]);
            1.7 * (2.0 * chance.uniform() - 1.0)
        };
        (of(0, 0) * (1.0 - a) + of(1, 0) * a) * (1.0 - b) + (of(0, 1) * (1.0 - a) + of(1, 1) * a) * b
    }
}

/// Numbers at random, the same for the same start (splitmix64).
#[derive(Debug, Clone, Copy)]
pub struct Chance(u64);

impl Chance {
    /// Started by a few numbers.
    pub fn of(start: [u64; 4]) -> Self {
        let mut chance = Self(0x2545_f491_4f6c_dd1d);
        for it in start {
            chance.0 ^= it.wrapping_mul(0x9e37_79b9_7f4a_7c15);
            chance.uniform();
        }
        chance
    }

    /// 0 to less than 1.
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Of mean 0 and standard deviation 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let (a, b) = (1.0 - self.uniform(), self.uniform());
        (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }
}
