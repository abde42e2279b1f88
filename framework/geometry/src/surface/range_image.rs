//! A surface as the pixels of the camera that observed it: a point is matched to the point at its pixel, without a search.
//!
//! Source: G. Blais and M. D. Levine, "Registering multiview range data to create 3D computer objects", TPAMI 17(8), 1995 (projective registration).

use nalgebra::{Isometry3, Point3, Vector3};

use super::{Match, Surface, SurfacePoint};
use crate::camera::Camera;

/// Points by the pixel of a camera.
#[derive(Debug, Clone)]
pub struct RangeImage {
    camera: Camera,
    /// By pixel; the one in front where several fall on a pixel.
    points: Vec<Option<SurfacePoint>>,
    reaches_m: Vec<f64>,
}

impl RangeImage {
    /// The image of points in the world as `camera` sees them at its pose. `reaches_m`: the largest distance of a match, finest level first.
    pub fn new(camera: Camera, points: impl IntoIterator<Item = SurfacePoint>, reaches_m: Vec<f64>) -> RangeImage {
        let [columns, rows] = camera.image_size.map(|it| it as usize);
        let mut image = RangeImage { camera, points: vec![None; columns * rows], reaches_m };
        for point in points.into_iter().filter(SurfacePoint::is_sound) {
            let Some(place) = image.place(&point.position) else { continue };
            // In front means by more than noise: of two points of one surface the nearer would be too near on average.
            let depth = |it: &SurfacePoint| (image.camera.camera_from_world * it.position).z;
            let noise = 5.0 * point.covariance.trace().sqrt();
            let is_in_front = image.points[place].is_none_or(|it| depth(&point) + noise < depth(&it));
            if point.normal != Vector3::zeros() && is_in_front {
                image.points[place] = Some(point);
            }
        }
        image
    }

    /// Pose of the camera.
    pub fn camera_from_world(&self) -> &Isometry3<f64> {
        &self.camera.camera_from_world
    }

    fn place(&self, point: &Point3<f64>) -> Option<usize> {
        let pixel = self.camera.project(point)?;
        let [columns, rows] = self.camera.image_size.map(f64::from);
        let (x, y) = ((pixel.x + 0.5).floor(), (pixel.y + 0.5).floor());
        ((0.0..columns).contains(&x) && (0.0..rows).contains(&y)).then_some((y * columns + x) as usize)
    }
}

impl Surface for RangeImage {
    fn n_levels(&self) -> usize {
        self.reaches_m.len()
    }

    fn reach(&self, level: usize) -> f64 {
        self.reaches_m[level]
    }

    fn bend(&self, level: usize) -> f64 {
        0.03 * (self.reaches_m[level] - self.reaches_m[0])
    }

    fn nearest(&self, level: usize, point: &Point3<f64>) -> Option<Match> {
        let number = self.place(point)?;
        let there = self.points[number].as_ref()?;
        let is_near = (there.position - point).norm() <= self.reaches_m[level];
        let variance = there.variance_along(&there.normal);
        is_near.then_some(Match { number, position: there.position, normal: there.normal, variance })
    }
}
