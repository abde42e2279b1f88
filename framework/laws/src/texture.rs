//! A gray surface that is known at every place, not at pixels only: what rendered tests and benches match on.
//!
//! Disks of all sizes with edges as sharp as a good lens and a pixel make them (σ 0.8 px), and fine grain on them: corners and edges as in a photograph.
//! Both pictures of a pair evaluate the same function at their own places, so that no interpolation stands between them and the truth.

/// A surface of its own for each number.
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

    /// A picture of it: pixel (x, y) shows the place `of(x, y)`. Rounded to whole levels, with noise of so many levels.
    pub fn picture(&self, size: usize, noise: f64, seed: u64, of: impl Fn(f64, f64) -> [f64; 2]) -> Vec<u8> {
        let mut chance = Chance::of([seed, 77, 5, 3]);
        let mut pixels = Vec::with_capacity(size * size);
        for y in 0..size {
            for x in 0..size {
                let [u, v] = of(x as f64, y as f64);
                pixels.push((self.at(u, v) + noise * chance.normal()).round().clamp(0.0, 255.0) as u8);
            }
        }
        pixels
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
