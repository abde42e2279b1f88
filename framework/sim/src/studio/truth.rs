//! The truth about surfaces of the studio: where each point of skin or cloth is at any time.

use std::sync::Arc;

use foveate_messages::Time;
use nalgebra::{Point3, Vector3};

use super::Posed;
use crate::nearest::Nearest;
use crate::world::World;

/// Triangles, by the numbers of their corners.
pub type Corners = Vec<[u32; 3]>;

/// A point of skin or cloth: it stays the same over time, wherever it goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Its owner: the number of the person, and after all of them the arm.
    pub thing: usize,
    /// Number of the triangle, and the weights of its corners.
    pub triangle: usize,
    /// They add up to 1.
    pub weights: [f64; 3],
}

/// All surfaces of the studio that move, at one time.
pub struct TrueSurfaces {
    world: World,
    things: Vec<(usize, Arc<Posed>)>,
}

/// Finds points of [`TrueSurfaces`].
pub struct SurfaceFinder<'s> {
    of: Vec<(usize, Nearest<'s>)>,
}

impl World {
    /// The surfaces of people and arm that are there at `time`; none without a `studio` or an `arm`.
    pub fn surfaces(&self, time: Time) -> TrueSurfaces {
        let things = self.studio().map_or(Vec::new(), |studio| {
            self.present(time).into_iter().map(|it| (it, self.posed(studio, it, time))).collect()
        });
        TrueSurfaces { world: self.clone(), things }
    }
}

impl TrueSurfaces {
    /// To find points within `reach_m` of a surface.
    pub fn finder(&self, reach_m: f64) -> SurfaceFinder<'_> {
        let studio = self.world.studio();
        let of = studio.map_or(Vec::new(), |studio| {
            self.things
                .iter()
                .map(|(thing, posed)| (*thing, Nearest::new(&studio.thing(*thing).triangles, &posed.vertices, reach_m)))
                .collect()
        });
        SurfaceFinder { of }
    }

    /// Where a point is at this time [m]; `None` where its thing is not there.
    pub fn place(&self, point: &SurfacePoint) -> Option<Point3<f64>> {
        let (posed, corners) = self.corners(point)?;
        let sum = corners
            .into_iter()
            .zip(point.weights)
            .fold(Vector3::zeros(), |sum, (corner, weight)| sum + posed.vertices[corner as usize].coords * weight);
        Some(Point3::from(sum))
    }

    /// Which way the surface faces there, of length 1.
    pub fn normal(&self, point: &SurfacePoint) -> Option<Vector3<f64>> {
        let (posed, corners) = self.corners(point)?;
        let sum = corners.into_iter().zip(point.weights).fold(Vector3::zeros(), |sum, (corner, weight)| {
            sum + posed.normals[corner as usize].cast::<f64>() * weight
        });
        sum.try_normalize(1e-12)
    }

    fn corners(&self, point: &SurfacePoint) -> Option<(&Posed, [u32; 3])> {
        let (_, posed) = self.things.iter().find(|it| it.0 == point.thing)?;
        let triangle = self.world.studio()?.thing(point.thing).triangles.get(point.triangle)?;
        Some((posed, triangle.corners))
    }

    /// Vertices of a thing [m] and its triangles, by their corners; `None` where it is not there.
    pub fn mesh(&self, thing: usize) -> Option<(&[Point3<f64>], Corners)> {
        let (_, posed) = self.things.iter().find(|it| it.0 == thing)?;
        let triangles = &self.world.studio()?.thing(thing).triangles;
        Some((&posed.vertices, triangles.iter().map(|it| it.corners).collect()))
    }

    /// Numbers of the things that are there.
    pub fn things(&self) -> impl Iterator<Item = usize> + '_ {
        self.things.iter().map(|it| it.0)
    }
}

impl SurfaceFinder<'_> {
    /// The point that is nearest, and how far it is away, positive outside [m].
    pub fn nearest(&self, point: &Point3<f64>) -> Option<(SurfacePoint, f64)> {
        let found = self.of.iter().filter_map(|(thing, nearest)| Some((*thing, nearest.find(point)?)));
        let (thing, found) = found.min_by(|a, b| a.1.distance.abs().total_cmp(&b.1.distance.abs()))?;
        Some((SurfacePoint { thing, triangle: found.triangle, weights: found.weights }, found.distance))
    }
}
