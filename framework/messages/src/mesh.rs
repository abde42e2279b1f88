//! Surfaces as triangles.

use nalgebra::{Isometry3, Matrix6, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::schema::{Numbers, Pose};
use crate::wire::portable;
use crate::{Message, Quality, Space, Time, Wire};

/// A corner of triangles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshVertex {
    /// In the space of the producer's scale [m].
    pub position: Point3<f32>,
    /// Out of the surface, of length 1 [–].
    pub normal: Vector3<f32>,
    /// As many points as its mean is worth [–].
    pub weight: f32,
    /// Standard deviation along the normal: noise, and by how much points contradict each other; not what all of them share [m].
    pub sigma: f32,
    /// Red, green, blue [gray level, 0..=255].
    pub colour: [u8; 3],
}

impl MeshVertex {
    /// Bytes of a vertex in [`Mesh::bytes`].
    pub const BYTES: usize = 36;

    /// Little endian: position, normal, weight, sigma as 32-bit floats; colour and a zero.
    pub fn to_bytes(&self) -> [u8; Self::BYTES] {
        let (p, n) = (&self.position, &self.normal);
        let mut bytes = [0; Self::BYTES];
        for (to, from) in bytes.chunks_exact_mut(4).zip([p.x, p.y, p.z, n.x, n.y, n.z, self.weight, self.sigma]) {
            to.copy_from_slice(&from.to_le_bytes());
        }
        bytes[32..35].copy_from_slice(&self.colour);
        bytes
    }

    /// What [`Self::to_bytes`] wrote.
    pub fn from_bytes(bytes: &[u8; Self::BYTES]) -> MeshVertex {
        let f =
            |at: usize| f32::from_le_bytes([bytes[4 * at], bytes[4 * at + 1], bytes[4 * at + 2], bytes[4 * at + 3]]);
        MeshVertex {
            position: Point3::new(f(0), f(1), f(2)),
            normal: Vector3::new(f(3), f(4), f(5)),
            weight: f(6),
            sigma: f(7),
            colour: [bytes[32], bytes[33], bytes[34]],
        }
    }
}

/// A surface joined from many clouds, in the space of its producer's scale.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Mesh {
    /// Of the last cloud in it.
    pub time: Time,
    /// How many clouds are in it.
    pub n_clouds: u32,
    /// Takes its points to the world (the outermost scale) as the thing lay at `time`.
    #[serde(with = "Pose")]
    #[schemars(with = "Pose")]
    pub world_from_mesh: Isometry3<f64>,
    /// Of δ in `world_from_mesh` ∘ exp(δ), (rotation, translation) [rad², rad m, m²].
    #[schemars(with = "Numbers<36>")]
    pub covariance: Matrix6<f64>,
    /// Mean standard deviation of the vertices along their normals [m]; 0 without any.
    pub mean_sigma: f64,
    /// How many vertices there are.
    pub n_vertices: u32,
    /// [`MeshVertex::BYTES`] bytes a vertex, then three 32-bit numbers of vertices a triangle.
    #[serde(skip)]
    pub bytes: Vec<u8>,
}

impl Mesh {
    /// Of vertices and of triangles by vertex, counter-clockwise from outside. The rest is as in a mesh that never moved.
    pub fn new(vertices: impl IntoIterator<Item = MeshVertex>, triangles: &[[u32; 3]]) -> Mesh {
        let (mut bytes, mut n_vertices, mut sum) = (Vec::new(), 0, 0.0);
        for vertex in vertices {
            n_vertices += 1;
            sum += f64::from(vertex.sigma);
            bytes.extend(vertex.to_bytes());
        }
        bytes.extend(triangles.iter().flatten().flat_map(|it| it.to_le_bytes()));
        Mesh {
            time: Time::ZERO,
            n_clouds: 0,
            world_from_mesh: Isometry3::identity(),
            covariance: Matrix6::zeros(),
            mean_sigma: if n_vertices == 0 { 0.0 } else { sum / f64::from(n_vertices) },
            n_vertices,
            bytes,
        }
    }

    fn parts(&self) -> (&[u8], &[u8]) {
        let at = (self.n_vertices as usize * MeshVertex::BYTES).min(self.bytes.len());
        self.bytes.split_at(at)
    }

    /// All vertices in order.
    pub fn vertices(&self) -> impl ExactSizeIterator<Item = MeshVertex> + '_ {
        let (vertices, _) = self.parts().0.as_chunks::<{ MeshVertex::BYTES }>();
        vertices.iter().map(MeshVertex::from_bytes)
    }

    /// All triangles in order. One that names a vertex that there is not is left out.
    pub fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        let (triangles, _) = self.parts().1.as_chunks::<12>();
        let corner = |it: &[u8; 12], at: usize| u32::from_le_bytes([it[at], it[at + 1], it[at + 2], it[at + 3]]);
        let triangle = move |it: &[u8; 12]| [corner(it, 0), corner(it, 4), corner(it, 8)];
        triangles.iter().map(triangle).filter(|it| it.iter().all(|corner| *corner < self.n_vertices))
    }
}

impl Message for Mesh {
    const NAME: &'static str = "mesh";
    const SPACE: Space = Space::POINTS;
    const WIRE: Wire = portable!(Mesh);

    fn quality(&self) -> Quality {
        Quality { count: Some(self.n_vertices), sigma: (self.n_vertices > 0).then_some(self.mean_sigma) }
    }

    fn bulk(&self) -> &[u8] {
        &self.bytes
    }

    fn set_bulk(&mut self, bytes: Vec<u8>) {
        self.bytes = bytes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_and_triangles_come_back_as_they_were_put_in() {
        let vertex = |x: f32| MeshVertex {
            position: Point3::new(x, -2.5, 3.25),
            normal: Vector3::y(),
            weight: 12.5,
            sigma: 0.25,
            colour: [1, 2, 255],
        };
        let list = [0.0, 1.0, 2.0].map(vertex);
        let mesh = Mesh::new(list, &[[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.vertices().collect::<Vec<_>>(), list);
        assert_eq!(mesh.triangles().collect::<Vec<_>>(), [[0, 1, 2]], "there is no vertex 3");
        assert_eq!(mesh.quality(), Quality { count: Some(3), sigma: Some(0.25) });
        let none = Mesh::new([], &[]);
        assert!(none.vertices().len() == 0 && none.triangles().next().is_none() && none.quality().sigma.is_none());
    }
}
