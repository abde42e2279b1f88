//! Pictures of a surface that moves, for tests, by another model than that of what is tested: light is integrated over each camera pixel and over the exposure on a surface with colours of its own that
//! moves along, the projector is out of focus, the camera has noise and eight bits.

use foveate_estimation::random::Random;

use super::design::BoundaryCode;

/// Projector pixels of a stripe.
pub(super) const STRIPE: f64 = 4.0;

/// A rounded thing that moves before a slanted wall.
#[derive(Debug, Clone)]
pub(super) struct Scene {
    pub size: [usize; 2],
    /// Of the rounded thing, sideways [px a picture].
    pub speed: f64,
    /// Projector columns that everything moves a picture because it comes nearer.
    pub nearer: f64,
    /// How far before the wall it stands [projector px].
    pub step: f64,
    pub light: f64,
    /// Colour of patches on the rounded thing, relative to what is around them [–].
    pub patch: f64,
    pub noise: f64,
    pub seed: u64,
}

impl Scene {
    pub fn new(speed: f64, nearer: f64, seed: u64) -> Scene {
        Scene { size: [320, 48], speed, nearer, step: 15.0, light: 160.0, patch: 0.6, noise: 1.0, seed }
    }

    /// Where (x, y) lies on the moving thing, (0, 0) in its middle; beyond 1 is the wall.
    fn on_it(&self, x: f64, y: f64, picture: f64) -> [f64; 2] {
        [(x - 130.0 - self.speed * picture) / 75.0, (y - 24.0) / 75.0]
    }

    /// Projector column of a place in the picture at a time in pictures.
    pub fn column(&self, x: f64, y: f64, picture: f64) -> f64 {
        let [a, b] = self.on_it(x, y, picture);
        let square = a * a + b * b;
        let before = if square < 1.0 { self.step + 14.0 * (1.0 - square) } else { 0.0 };
        20.0 + 0.5 * x + 0.03 * y - before + self.nearer * picture
    }

    /// Whether the step throws a shadow there: the light comes from the right.
    pub fn is_dark(&self, x: f64, y: f64, picture: f64) -> bool {
        let [a, b] = self.on_it(x, y, picture);
        a < 0.0 && a * a + b * b >= 1.0 && (a + 2.0 * self.step / 75.0).powi(2) + b * b < 1.0
    }

    /// Colour of the surface there, which moves with it: soft shades and edges.
    fn albedo(&self, x: f64, y: f64, picture: f64) -> f64 {
        let [a, b] = self.on_it(x, y, picture);
        let patches = if (0.2..0.5).contains(&a) && b.abs() < 0.2 { self.patch } else { 1.0 };
        (0.75 + 0.12 * (a * 17.0).sin() * (b * 13.0).cos()) * patches
    }

    /// What the camera shows of picture number `picture`, the projector showing picture `frame` of the code.
    pub fn picture(&self, picture: usize, frame: usize) -> Vec<u8> {
        let code = BoundaryCode::get();
        let mut random = Random::new(self.seed.wrapping_mul(7919).wrapping_add(picture as u64));
        // Blurred by a Gaussian of half a pixel: the share of its neighbours that are lit, tabulated at quarters of a pixel.
        let columns = 400_usize;
        let lit = |place: f64| -> f64 {
            // A place on a boundary is half of either side.
            let side = |off: f64| ((place + 0.5 + off) / STRIPE).floor().max(0.0) as usize;
            [-1e-6, 1e-6].map(|off| f64::from(u8::from(code.is_lit(side(off), frame)))).iter().sum::<f64>() / 2.0
        };
        let taps: Vec<(f64, f64)> =
            (-6..=6).map(|it| 0.25 * f64::from(it)).map(|it| (it, (-2.0 * it * it).exp())).collect();
        let sum: f64 = taps.iter().map(|it| it.1).sum();
        let table: Vec<f64> = (0..columns * 4)
            .map(|at| taps.iter().map(|(off, weight)| weight / sum * lit(at as f64 / 4.0 + off)).sum())
            .collect();
        let [width, height] = self.size;
        let mut pixels = Vec::with_capacity(width * height);
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let mut light = 0.0;
            for sample in 0..12 {
                let (part, when) = (sample % 4, sample / 4);
                let time = picture as f64 + (f64::from(when) - 1.0) * 0.08;
                let (x, y) =
                    (x as f64 + (f64::from(part) + 0.5) / 4.0 - 0.5, y as f64 + f64::from(part % 2) * 0.5 - 0.25);
                let place = (self.column(x, y, time) * 4.0).clamp(0.0, (table.len() - 2) as f64);
                let (first, share) = (place as usize, place.fract());
                let shown = table[first] + (table[first + 1] - table[first]) * share;
                let direct = if self.is_dark(x, y, time) { 0.0 } else { shown };
                light += self.albedo(x, y, time) * (10.0 + self.light * (0.02 + direct)) / 12.0;
            }
            pixels.push((light + self.noise * random.normal()).round().clamp(0.0, 255.0) as u8);
        }
        pixels
    }
}
