//! Rendered pictures with known spots: the scene that the benches, the golden table and the tests share.

use nalgebra::Point2;

/// Seeded random numbers, enough for noise: SplitMix64 and Box–Muller.
pub struct Noise(u64);

impl Noise {
    /// The same seed, the same numbers.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform in `low..high`.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Normal, mean 0, standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform(0.0, 1.0)).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform(0.0, 1.0)).cos()
    }
}

/// What spots look like: Gaussian, on an even background, with normal noise, cut to bytes.
#[derive(Clone, Copy)]
pub struct Look {
    /// Brightness above the background at the centre of a spot [gray level]; above 255 it saturates.
    pub amplitude: f64,
    /// Size of a spot, standard deviation [px].
    pub sigma_px: f64,
    /// Standard deviation of the noise of a pixel [gray level].
    pub noise: f64,
    /// Background [gray level].
    pub background: f64,
}

impl Look {
    /// 200 gray levels over a background of 20, 1.6 px, noise 3: five pixels wide at half height.
    pub const LED: Look = Look { amplitude: 200.0, sigma_px: 1.6, noise: 3.0, background: 20.0 };

    /// A picture with a spot at each of `centres`.
    pub fn render(&self, width: usize, height: usize, centres: &[Point2<f64>], noise: &mut Noise) -> Vec<u8> {
        let mut levels = vec![self.background; width * height];
        let reach = 6.0 * self.sigma_px + 1.0;
        let span = |c: f64, n: usize| ((c - reach).max(0.0) as usize)..((c + reach).max(0.0) as usize).min(n);
        for centre in centres {
            for y in span(centre.y, height) {
                for x in span(centre.x, width) {
                    let squared = (x as f64 - centre.x).powi(2) + (y as f64 - centre.y).powi(2);
                    levels[y * width + x] += self.amplitude * (-squared / (2.0 * self.sigma_px.powi(2))).exp();
                }
            }
        }
        levels.iter().map(|it| (it + self.noise * noise.normal()) as u8).collect()
    }
}

/// `n` places at least 25 px from each other and 12 px from the picture's edge.
pub fn places(n: usize, width: usize, height: usize, noise: &mut Noise) -> Vec<Point2<f64>> {
    let mut places: Vec<Point2<f64>> = Vec::new();
    while places.len() < n {
        let place = Point2::new(noise.uniform(12.0, width as f64 - 12.0), noise.uniform(12.0, height as f64 - 12.0));
        if places.iter().all(|it| (it - place).norm() > 25.0) {
            places.push(place);
        }
    }
    places
}
