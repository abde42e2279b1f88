//! Rendered pictures with known spots: the scene that the benches, the golden table and the tests share.

use foveate_estimation::random::Random;
use nalgebra::Point2;

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
    pub fn render(&self, width: usize, height: usize, centres: &[Point2<f64>], random: &mut Random) -> Vec<u8> {
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
        levels.iter().map(|it| (it + self.noise * random.normal()) as u8).collect()
    }
}

/// `n` places at least 25 px from each other and 12 px from the picture's edge.
pub fn places(n: usize, width: usize, height: usize, random: &mut Random) -> Vec<Point2<f64>> {
    let mut places: Vec<Point2<f64>> = Vec::new();
    while places.len() < n {
        let place =
            Point2::new(random.uniform_in(12.0, width as f64 - 12.0), random.uniform_in(12.0, height as f64 - 12.0));
        if places.iter().all(|it| (it - place).norm() > 25.0) {
            places.push(place);
        }
    }
    places
}
