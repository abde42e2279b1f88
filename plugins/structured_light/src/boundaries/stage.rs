//! Balls of many colours that move before a dark room or a wall in the light of a boundary code, for tests: every pixel is traced through both lenses, the projector is out of focus, and what it does not reach is dark.

use foveate::estimation::random::Random;
use foveate::imaging::stripes::code::{Axis, Group, StripeCode};
use foveate::imaging::stripes::pattern::picture;
use nalgebra::{Point2, Point3, Unit};

use super::*;

/// Samples along each side of a pixel.
const SAMPLES: usize = 2;
/// Of the projector on white, and of the camera [gray levels].
const LIGHT: f64 = 190.0;
const NOISE: f64 = 1.2;
/// A projector's picture is tabulated so often for each of its pixels.
const FINE: usize = 4;

/// Where the balls are in picture `k`, from where they were in picture 0 [m].
pub(super) type Way = fn(f64) -> [f64; 3];

pub(super) struct Stage {
    pub camera: Camera,
    pub projector: Camera,
    pub stripe: u32,
    /// Middles and radii [m].
    balls: Vec<([f64; 3], f64)>,
    /// How far away a wall is [m].
    wall: Option<f64>,
    way: Way,
    seed: u64,
    rays: Vec<(Point3<f64>, Unit<Vector3<f64>>)>,
}

impl Stage {
    /// A head with a nose and an ear before the camera of a rig, which has a quarter of its pixels here.
    pub fn new(stripe: u32, way: Way, wall: Option<f64>, seed: u64) -> Stage {
        let (mut camera, projector) = crate::pair::tests::rig();
        camera.image_size = [320, 240];
        camera.intrinsics.focal = [560.0, 560.0];
        camera.intrinsics.principal = [160.0, 119.0];
        let mut random = Random::new(seed);
        let mut off = |by: f64| by * random.normal().clamp(-2.0, 2.0);
        let head = [off(0.03), off(0.02), 1.45 + off(0.02)];
        let balls = vec![
            (head, 0.19 + off(0.01)),
            ([head[0] + off(0.03), head[1] + off(0.03), head[2] - 0.17], 0.045),
            ([head[0] + 0.15, head[1] + off(0.05), head[2] - 0.02 + off(0.02)], 0.07),
        ];
        let mut stage = Stage { camera, projector, stripe, balls, wall, way, seed, rays: Vec::new() };
        stage.rays = stage.rays();
        stage
    }

    fn code(&self) -> StripeCode {
        StripeCode::boundary([1024, 768], self.stripe, &[Group::Stripes(Axis::Columns)])
    }

    fn rays(&self) -> Vec<(Point3<f64>, Unit<Vector3<f64>>)> {
        let [width, height] = self.camera.image_size.map(|it| it as usize);
        let place = |at: usize| at as f64 / SAMPLES as f64 - 0.5 + 0.5 / SAMPLES as f64;
        let of = |at: usize| {
            let pixel = Point2::new(place(at % (SAMPLES * width)), place(at / (SAMPLES * width)));
            let ray = self.camera.ray(&pixel).unwrap();
            (ray.origin, ray.direction)
        };
        (0..SAMPLES * SAMPLES * width * height).map(of).collect()
    }

    /// Where a line of sight meets something first: how far away, its normal, and the middle of the ball.
    fn meets(
        &self,
        from: &Point3<f64>,
        along: &Vector3<f64>,
        picture: f64,
    ) -> Option<(f64, Vector3<f64>, Point3<f64>)> {
        let gone = Vector3::from((self.way)(picture));
        let ball = |(middle, radius): &([f64; 3], f64)| {
            let middle = Point3::from(*middle) + gone;
            let to = middle - from;
            let (near, square) = (to.dot(along), to.norm_squared());
            let half = near * near - square + radius * radius;
            let far = near - half.max(0.0).sqrt();
            (half > 0.0 && far > 1e-6).then(|| (far, (from + along * far - middle) / *radius, middle))
        };
        let wall = self.wall.and_then(|z| {
            let far = (z - from.z) / along.z;
            (far > 1e-6).then_some((far, -Vector3::z(), Point3::origin()))
        });
        self.balls.iter().filter_map(ball).chain(wall).min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Distance along the ray of pixel (x, y) to what is lit there in a picture [m].
    pub fn depth(&self, x: usize, y: usize, picture: f64) -> Option<f64> {
        let ray = self.camera.ray(&Point2::new(x as f64, y as f64))?;
        self.meets(&ray.origin, &ray.direction, picture).map(|it| it.0)
    }

    /// What the camera sees in picture `number`, which is taken `at` pictures after the start while the projector shows picture `frame` of the code.
    pub fn seen(&self, at: f64, number: usize, frame: usize) -> Image {
        let code = self.code();
        let pattern = picture(&code, code.pictures()[frame], 1.0);
        let shown: Vec<f64> = pattern[..1024].iter().map(|it| f64::from(*it) / 255.0).collect();
        // Out of focus by six tenths of a pixel.
        let taps: Vec<(f64, f64)> =
            (-8..=8).map(|it| f64::from(it) / 4.0).map(|it| (it, (-it * it / 0.72).exp())).collect();
        let sum: f64 = taps.iter().map(|it| it.1).sum();
        let level = |place: f64| shown.get((place + 0.5).floor().max(0.0) as usize).copied().unwrap_or(0.0);
        let table: Vec<f64> = (0..1024 * FINE)
            .map(|at| taps.iter().map(|(off, weight)| weight / sum * level(at as f64 / FINE as f64 + off)).sum())
            .collect();
        let centre = self.projector.centre();
        let [width, height] = self.camera.image_size.map(|it| it as usize);
        let mut random = Random::new(self.seed.wrapping_mul(7919).wrapping_add(number as u64));
        let mut sums = vec![0.0_f64; width * height];
        for (sample, (from, along)) in self.rays.iter().enumerate() {
            let (column, row) = (sample % (SAMPLES * width), sample / (SAMPLES * width));
            // An exposure of a quarter of a picture's time.
            let when = at + 0.125 * ((column + row) % 2) as f64 - 0.0625;
            let Some((far, normal, middle)) = self.meets(from, along, when) else { continue };
            let point = from + along.into_inner() * far;
            let to = centre - point;
            let facing = normal.dot(&to.normalize());
            let is_dark = facing <= 0.0
                || self.meets(&(point + normal * 1e-4), &to.normalize(), when).is_some_and(|it| it.0 < to.norm());
            let own = point - middle;
            let colour = 0.72 + 0.2 * (own.x * 70.0 + 3.0 * (own.y * 23.0).sin()).sin() * (own.y * 55.0).cos();
            let lit = self.projector.project(&point).map_or(0.0, |it| {
                let place = it.x * FINE as f64;
                let inside = place >= 0.0 && place < (table.len() - 1) as f64 && (0.0..768.0).contains(&it.y);
                let first = place.max(0.0) as usize;
                if inside { table[first] + (table[first + 1] - table[first]) * place.fract() } else { 0.0 }
            });
            let direct = if is_dark { 0.0 } else { facing.powf(0.8) * (0.02 + lit) };
            sums[row / SAMPLES * width + column / SAMPLES] += colour * (0.03 + direct) / (SAMPLES * SAMPLES) as f64;
        }
        let pixels =
            sums.into_iter().map(|it| (6.0 + LIGHT * it + NOISE * random.normal()).round().clamp(0.0, 255.0) as u8);
        Image { width: width as u32, height: height as u32, pixels: pixels.collect(), ..Image::default() }
    }
}
