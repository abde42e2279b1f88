//! The surface of a distance field as triangles: surface nets.
//!
//! Source: S. F. F. Gibson, "Constrained elastic surface nets", MICCAI 1998: one vertex in each cell of eight voxels that the surface passes, at the mean of where it crosses the cell's edges, and two
//! triangles around each edge that it crosses. Compared with marching cubes that is half as many vertices, no slivers,
//! and no table of cases; each vertex is then moved onto the surface along the
//! field's gradient, so that nothing is smoothed. Cells with an unknown voxel have no vertex: the surface ends where
//! it was not observed, and where points contradict each other.

use nalgebra::{Point3, Vector3};

use super::field::{DistanceField, SIDE, Voxel};

/// Options of [`DistanceField::mesh`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshOptions {
    /// Least number of points for a voxel to be used [–].
    pub min_points: f64,
    /// Least number of triangles of a connected piece [–].
    pub min_triangles: usize,
}

/// A vertex of a triangle mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceVertex {
    /// Position [m].
    pub position: Point3<f64>,
    /// Unit normal, outwards [–].
    pub normal: Vector3<f64>,
    /// Mean colour of its points [gray level].
    pub colour: [u8; 3],
    /// Equivalent number of points behind its mean [–].
    pub n_points: f64,
    /// Standard deviation along the normal, from the noise of the mean and from contradictions between points beyond
    /// their noise; without errors common to all points [m].
    pub sigma: f64,
}

/// A triangle mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TriangleMesh {
    /// Vertices.
    pub vertices: Vec<SurfaceVertex>,
    /// Vertex indices of each triangle, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
}

const NONE: u32 = u32::MAX;
/// Variance of a vertex over that of one point, for a point per voxel: for each of the two axes across the normal ½, which is the mean over t from 0 to 1 of
/// ∫ ((1 − t) h(x) + t h(x − 1))² dx, with h the kernel 1 − |x| of the field and t the place between two voxels.
const SPREAD: f64 = 0.25;

/// Where points contradict each other by more than this, beyond their noise, the surface ends [voxels].
const CONTRADICTED: f64 = 0.4;
/// A surface that changes ends where no point came while what there was faded to this part [–].
const LEAST_FRESH: f32 = 0.3;

/// The voxels of a cell, x first.
const CORNERS: [[i32; 3]; 8] = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]];
/// The edges of a cell, by corner.
const EDGES: [[usize; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

impl DistanceField {
    /// Extracts the present surface.
    pub fn mesh(&self, options: &MeshOptions) -> TriangleMesh {
        let min_points = (options.min_points as f32).max(f32::MIN_POSITIVE);
        let mut mesh = TriangleMesh::default();
        let mut vertex_of = vec![NONE; self.places.len() * SIDE.pow(3)];
        let side = SIDE as i32;
        let cells = |block: [i32; 3]| {
            (0..SIDE.pow(3) as i32).map(move |it| {
                let within = [it % side, it / side % side, it / (side * side)];
                [0, 1, 2].map(|axis| block[axis] * side + within[axis])
            })
        };
        for (number, block) in self.places.iter().enumerate() {
            for (within, cell) in cells(*block).enumerate() {
                // Most voxels are unknown or far away.
                let Some(first) = self.voxel(cell, min_points).filter(|it| it.distance.abs() < 2.0) else { continue };
                if let Some(vertex) = self.vertex(cell, first, min_points) {
                    vertex_of[number * SIDE.pow(3) + within] = mesh.vertices.len() as u32;
                    mesh.vertices.push(vertex);
                }
            }
        }
        let vertex = |cell: [i32; 3]| {
            let (block, within) = self.find(cell)?;
            Some(vertex_of[block * SIDE.pow(3) + within]).filter(|it| *it != NONE)
        };
        for block in &self.places {
            for cell in cells(*block) {
                let Some(here) = self.voxel(cell, min_points).filter(|it| it.distance.abs() < 2.0) else { continue };
                for axis in 0..3 {
                    let beside = |axis: usize, by: i32| {
                        let mut moved = cell;
                        moved[axis] += by;
                        moved
                    };
                    let Some(there) = self.voxel(beside(axis, 1), min_points) else { continue };
                    if (here.distance < 0.0) == (there.distance < 0.0) {
                        continue;
                    }
                    // The four cells around this edge, counter-clockwise about the axis.
                    let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
                    let mut opposite = beside(u, -1);
                    opposite[v] -= 1;
                    let around = [vertex(cell), vertex(beside(u, -1)), vertex(opposite), vertex(beside(v, -1))];
                    let [Some(a), Some(b), Some(c), Some(d)] = around else { continue };
                    let [a, b, c, d] = if here.distance < 0.0 { [a, b, c, d] } else { [d, c, b, a] };
                    mesh.triangles.extend(mesh.shorter_halves([a, b, c, d]));
                }
            }
        }
        mesh.keep_pieces(options.min_triangles);
        mesh
    }

    /// Of the cell between a voxel, which is `first`, and its seven neighbours.
    fn vertex(&self, cell: [i32; 3], first: &Voxel, min_points: f32) -> Option<SurfaceVertex> {
        let mut corners = [*first; 8];
        for (corner, step) in corners.iter_mut().zip(CORNERS).skip(1) {
            *corner = *self.voxel([0, 1, 2].map(|it| cell[it] + step[it]), min_points)?;
        }
        if self.options().changes && corners.iter().any(|it| it.fresh < LEAST_FRESH) {
            return None;
        }
        let (mut sum, mut n) = (Vector3::zeros(), 0.0);
        for [a, b] in EDGES {
            let (from, to) = (corners[a].distance, corners[b].distance);
            if (from < 0.0) != (to < 0.0) {
                let part = f64::from(from / (from - to));
                let [start, end] = [a, b].map(|it| Vector3::from(CORNERS[it].map(f64::from)));
                sum += start + (end - start) * part;
                n += 1.0;
            }
        }
        if n == 0.0 {
            return None;
        }
        let mut within: Vector3<f64> = sum / n;
        let (distance, gradient) = trilinear(&corners, &within);
        let squared = gradient.norm_squared();
        if squared < 0.01 {
            return None;
        }
        within -= gradient * (distance / squared);
        within.apply(|it| *it = it.clamp(0.0, 1.0));
        let weights = weights(&within);
        let mean = |of: &dyn Fn(&Voxel) -> f32| -> f64 {
            corners.iter().zip(weights).map(|(it, weight)| f64::from(of(it)) * weight).sum()
        };
        let voxel_m = self.options().voxel_m;
        let of_noise = mean(&|it| it.n_points / it.weight) / (voxel_m * voxel_m);
        let contradiction = contradiction(mean(&|it| it.scatter / it.weight), of_noise, mean(&|it| it.n_points));
        if contradiction > CONTRADICTED {
            return None;
        }
        let noise = SPREAD / mean(&|it| it.weight);
        let origin = Vector3::from(cell.map(f64::from));
        Some(SurfaceVertex {
            position: Point3::from((origin + within) * voxel_m),
            normal: gradient.normalize(),
            colour: [0, 1, 2].map(|channel| mean(&|it| it.colour[channel]).round().clamp(0.0, 255.0) as u8),
            n_points: mean(&|it| it.n_points) / SPREAD,
            sigma: (noise + (contradiction * voxel_m).powi(2)).sqrt(),
        })
    }
}

/// By how much points are farther from their mean than their own noise explains, standard deviation: of the `variance` about the mean, less that of noise and twice the chance of it over so many
/// points, the variance of a variance being 2/n of its square.
fn contradiction(variance: f64, of_noise: f64, n_points: f64) -> f64 {
    (variance - of_noise * (1.0 + 2.0 * (2.0 / n_points).sqrt())).max(0.0).sqrt()
}

/// Weights of the corners of a cell at a place in it.
fn weights(within: &Vector3<f64>) -> [f64; 8] {
    CORNERS.map(|step| (0..3).map(|it| if step[it] == 1 { within[it] } else { 1.0 - within[it] }).product())
}

/// Distance and its gradient at a place in a cell [voxels, –].
fn trilinear(corners: &[Voxel; 8], within: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let at = |within: &Vector3<f64>| -> f64 {
        corners.iter().zip(weights(within)).map(|(it, weight)| f64::from(it.distance) * weight).sum()
    };
    let slope = |axis: usize| {
        let [mut low, mut high] = [*within; 2];
        (low[axis], high[axis]) = (0.0, 1.0);
        at(&high) - at(&low)
    };
    (at(within), Vector3::new(slope(0), slope(1), slope(2)))
}

impl TriangleMesh {
    /// Two triangles of a quadrangle, cut along its shorter diagonal.
    fn shorter_halves(&self, [a, b, c, d]: [u32; 4]) -> [[u32; 3]; 2] {
        let length =
            |a: u32, b: u32| (self.vertices[a as usize].position - self.vertices[b as usize].position).norm_squared();
        if length(a, c) <= length(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
    }

    /// Leaves out pieces of fewer triangles, and vertices without one.
    fn keep_pieces(&mut self, min_triangles: usize) {
        let mut root: Vec<u32> = (0..self.vertices.len() as u32).collect();
        fn find(root: &mut [u32], mut it: u32) -> u32 {
            while root[it as usize] != it {
                root[it as usize] = root[root[it as usize] as usize];
                it = root[it as usize];
            }
            it
        }
        for &[a, b, c] in &self.triangles {
            let first = find(&mut root, a);
            for other in [b, c] {
                let other = find(&mut root, other);
                root[other as usize] = first;
            }
        }
        let mut n_triangles = vec![0_usize; self.vertices.len()];
        for &[a, _, _] in &self.triangles {
            n_triangles[find(&mut root, a) as usize] += 1;
        }
        self.triangles.retain(|it| n_triangles[find(&mut root, it[0]) as usize] >= min_triangles.max(1));
        let mut number = vec![NONE; self.vertices.len()];
        let mut kept = Vec::new();
        for triangle in &mut self.triangles {
            for corner in triangle {
                let new = &mut number[*corner as usize];
                if *new == NONE {
                    *new = kept.len() as u32;
                    kept.push(self.vertices[*corner as usize]);
                }
                *corner = *new;
            }
        }
        self.vertices = kept;
    }

    /// Area of the mesh [m²].
    pub fn area(&self) -> f64 {
        let area = |it: &[u32; 3]| {
            let [a, b, c] = it.map(|corner| self.vertices[corner as usize].position);
            (b - a).cross(&(c - a)).norm() / 2.0
        };
        self.triangles.iter().map(area).sum()
    }
}
