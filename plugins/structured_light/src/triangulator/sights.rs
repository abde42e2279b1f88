//! The lines of sight of a camera's pixels, and what is seen along them.

use foveate::geometry::{Camera, Ray};
use nalgebra::{Point2, Point3, Unit, UnitQuaternion, Vector2};

use crate::pair::OnRay;

/// What is kept of a point until its neighbours are known; NaN where there is none.
#[derive(Clone, Copy)]
pub(super) struct Seen {
    /// Along the ray [m].
    pub depth: f32,
    /// Of that [m].
    pub sigma: f32,
    /// Over the depth along the camera's axis [1/m].
    pub inverse_z: f32,
}

impl Seen {
    pub const NONE: Seen = Seen { depth: f32::NAN, sigma: f32::NAN, inverse_z: f32::NAN };
}

/// Pixels of a camera without lens and principal point, row by row, NaN where there is no line of sight; empty before
/// the first use, and for cameras with many pixels.
#[derive(Default)]
pub(super) struct Ideals(Vec<Vector2<f64>>);

/// Of cameras with more pixels each line of sight is worked out where it is used.
const MOST_IDEALS: usize = 3_000_000;

impl Ideals {
    pub fn of(self, camera: &Camera) -> Self {
        let [width, height] = camera.image_size.map(|it| it as usize);
        if width * height > MOST_IDEALS || !self.0.is_empty() {
            return self;
        }
        let one = |at: usize| camera.normalise(&Point2::new((at % width) as f64, (at / width) as f64));
        Self((0..width * height).map(|it| one(it).unwrap_or(Vector2::repeat(f64::NAN))).collect())
    }
}

/// Lines of sight of a camera as it stands.
pub(super) struct Sights<'a> {
    pub camera: &'a Camera,
    ideals: &'a Ideals,
    width: usize,
    centre: Point3<f64>,
    pub world_from_camera: UnitQuaternion<f64>,
}

impl<'a> Sights<'a> {
    pub fn new(camera: &'a Camera, ideals: &'a Ideals) -> Self {
        let world_from_camera = camera.camera_from_world.rotation.inverse();
        Self { camera, ideals, width: camera.image_size[0] as usize, centre: camera.centre(), world_from_camera }
    }

    #[inline]
    pub fn ideal(&self, x: usize, y: usize) -> Option<Vector2<f64>> {
        match self.ideals.0.get(y * self.width + x) {
            Some(ideal) => (!ideal.x.is_nan()).then_some(*ideal),
            None => self.camera.normalise(&Point2::new(x as f64, y as f64)),
        }
    }

    #[inline]
    pub fn ray(&self, x: usize, y: usize) -> Option<Ray> {
        let direction = Unit::new_normalize(self.world_from_camera * self.ideal(x, y)?.push(1.0));
        Some(Ray { origin: self.centre, direction })
    }

    pub fn seen(&self, point: &OnRay) -> Seen {
        let z = (self.camera.camera_from_world * point.point()).z;
        Seen { depth: point.depth as f32, sigma: point.sigma as f32, inverse_z: z.recip() as f32 }
    }
}
