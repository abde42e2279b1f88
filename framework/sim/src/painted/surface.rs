//! A surface that deforms: triangles, and shapes that are added to its rest shape with weights.
//!
//! All of it lies in the space of the part of the body that carries it (x forward, y left, z up) [m]. A share of each vertex may
//! follow the trunk in place of that part, as the foot of a neck does.

use nalgebra::{Isometry3, Point3, Vector3};

/// Edges of this length make surroundings of two centimetres [m].
const EDGE_M: f64 = 4e-3;

/// What a triangle is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Material {
    Skin,
    /// What is seen of an eye between the lids.
    Eye,
    /// The inside of a mouth.
    Mouth,
}

/// One triangle: counter-clockwise as seen from outside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Triangle {
    pub corners: [u32; 3],
    /// Where the corners lie in the texture [texel].
    pub texels: [[f32; 2]; 3],
    pub material: Material,
}

/// One way to deform: by how much it moves vertices at weight 1 [m].
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Mode {
    pub name: String,
    pub moves: Vec<(u32, Vector3<f64>)>,
}

/// A point of the surface: a triangle and the weights of its corners.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Spot {
    pub triangle: u32,
    pub weights: [f64; 3],
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Surface {
    pub rest: Vec<Point3<f64>>,
    pub triangles: Vec<Triangle>,
    pub modes: Vec<Mode>,
    /// Of each vertex, the share that follows the trunk, 0 to 1.
    pub follow: Vec<f64>,
    /// How much of the light from all around reaches each vertex, 0 to 1.
    pub openness: Vec<f32>,
}

impl Surface {
    /// The vertices deformed by `weights` (one for each mode), carried into the world.
    pub fn deform(
        &self,
        weights: &[f64],
        world_from_part: &Isometry3<f64>,
        world_from_trunk: &Isometry3<f64>,
    ) -> Vec<Point3<f64>> {
        let mut vertices = self.shaped(weights);
        let turn = world_from_part.rotation.to_rotation_matrix();
        for (vertex, &follow) in vertices.iter_mut().zip(&self.follow) {
            let with_part = turn * *vertex + world_from_part.translation.vector;
            *vertex =
                if follow == 0.0 { with_part } else { with_part + (world_from_trunk * *vertex - with_part) * follow };
        }
        vertices
    }

    /// The vertices deformed by `weights`, in the space of the part.
    pub fn shaped(&self, weights: &[f64]) -> Vec<Point3<f64>> {
        let mut vertices = self.rest.clone();
        for (mode, &weight) in self.modes.iter().zip(weights) {
            if weight != 0.0 {
                for (vertex, by) in &mode.moves {
                    vertices[*vertex as usize] += by * weight;
                }
            }
        }
        vertices
    }

    /// Outward normals of `vertices`, of length 1: the mean over the triangles around each, by their areas.
    pub fn normals(&self, vertices: &[Point3<f64>]) -> Vec<Vector3<f32>> {
        let mut sums = vec![Vector3::<f32>::zeros(); vertices.len()];
        for triangle in &self.triangles {
            let [a, b, c] = triangle.corners.map(|it| it as usize);
            let (u, v) = ((vertices[b] - vertices[a]).cast::<f32>(), (vertices[c] - vertices[a]).cast::<f32>());
            let normal = u.cross(&v);
            (sums[a], sums[b], sums[c]) = (sums[a] + normal, sums[b] + normal, sums[c] + normal);
        }
        sums.iter().map(|sum| sum / sum.norm().max(1e-20)).collect()
    }

    /// Fills in how open the rest shape is around each vertex, from how far its surroundings stand out before it, some
    /// two centimetres wide; where edges are long they count for less.
    pub fn open(&mut self) {
        let normals = self.normals(&self.rest);
        let n = self.rest.len();
        let mean_around = |values: &[Vector3<f64>]| {
            let (mut sums, mut counts) = (values.to_vec(), vec![1.0; n]);
            for triangle in &self.triangles {
                for i in 0..3 {
                    let (a, b) = (triangle.corners[i] as usize, triangle.corners[(i + 1) % 3] as usize);
                    let length = (self.rest[a] - self.rest[b]).norm();
                    let weight = (EDGE_M / length).powi(2).min(1.0);
                    sums[a] += values[b] * weight;
                    counts[a] += weight;
                }
            }
            sums.iter().zip(counts).map(|(sum, count)| sum / count).collect::<Vec<_>>()
        };
        let mut around: Vec<Vector3<f64>> = self.rest.iter().map(|it| it.coords).collect();
        (0..8).for_each(|_| around = mean_around(&around));
        let out = |i: usize| (around[i] - self.rest[i].coords).dot(&normals[i].cast());
        self.openness = (0..n).map(|i| (1.0 - (out(i) * 1e3 + 0.4).max(0.0) * 0.13).max(0.35) as f32).collect();
    }

    /// Where a spot is on the surface with these vertices.
    pub fn place(&self, spot: &Spot, vertices: &[Point3<f64>]) -> Point3<f64> {
        let corners = self.triangles[spot.triangle as usize].corners;
        let sum = |sum: Vector3<f64>, (corner, weight): (u32, f64)| sum + vertices[corner as usize].coords * weight;
        corners.into_iter().zip(spot.weights).fold(Vector3::zeros(), sum).into()
    }

    /// The outward normal at a spot, of length 1, between those of the corners.
    pub fn normal_at(&self, spot: &Spot, normals: &[Vector3<f32>]) -> Vector3<f64> {
        let corners = self.triangles[spot.triangle as usize].corners;
        let sum = |sum: Vector3<f64>, (corner, weight): (u32, f64)| sum + normals[corner as usize].cast() * weight;
        corners.into_iter().zip(spot.weights).fold(Vector3::zeros(), sum).normalize()
    }

    /// The spot of the rest shape that is seen first by who looks from far ahead along −x at (`y`, `z`); skin only.
    pub fn spot_from_ahead(&self, y: f64, z: f64) -> Option<Spot> {
        let mut nearest: Option<(f64, Spot)> = None;
        for (number, triangle) in self.triangles.iter().enumerate() {
            if triangle.material != Material::Skin {
                continue;
            }
            let [a, b, c] = triangle.corners.map(|it| self.rest[it as usize]);
            let doubled = (b.y - a.y) * (c.z - a.z) - (c.y - a.y) * (b.z - a.z);
            if doubled <= 0.0 {
                continue;
            }
            let second = ((y - a.y) * (c.z - a.z) - (c.y - a.y) * (z - a.z)) / doubled;
            let third = ((b.y - a.y) * (z - a.z) - (y - a.y) * (b.z - a.z)) / doubled;
            let weights = [1.0 - second - third, second, third];
            let x = a.x * weights[0] + b.x * second + c.x * third;
            if weights.iter().all(|it| *it >= -1e-9) && nearest.is_none_or(|it| x > it.0) {
                nearest = Some((x, Spot { triangle: number as u32, weights }));
            }
        }
        nearest.map(|it| it.1)
    }

    /// Puts triangles that lie next to each other next to each other in the list, so that runs of them have small bounds.
    pub fn sort_triangles(&mut self) {
        let corner = |axis: usize| self.rest.iter().map(|it| it[axis]).fold(f64::INFINITY, f64::min);
        let least = [0, 1, 2].map(corner);
        let key = |triangle: &Triangle| {
            let [a, b, c] = triangle.corners.map(|it| self.rest[it as usize]);
            let middle = (a.coords + b.coords + c.coords) / 3.0;
            let cells = [0, 1, 2].map(|axis| ((middle[axis] - least[axis]) * 500.0) as u32); // 2 mm
            (0..10).rev().fold(0_u32, |key, bit| cells.iter().fold(key, |key, cell| key << 1 | (cell >> bit & 1)))
        };
        let mut keyed: Vec<(u32, Triangle)> = self.triangles.iter().map(|it| (key(it), *it)).collect();
        keyed.sort_by_key(|it| it.0);
        self.triangles = keyed.into_iter().map(|it| it.1).collect();
    }
}
