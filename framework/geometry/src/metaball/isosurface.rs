//! The isosurface of a body as a closed mesh: marching tetrahedra.
//!
//! Marching tetrahedra (A. Doi, A. Koide, "An efficient method of triangulating equi-valued surfaces by using tetrahedral cells", IEICE Transactions E74(1), 1991): each cube of the grid is six tetrahedra
//! about the diagonal from its lowest to its highest corner, cut alike in neighbouring cubes. A tetrahedron has no ambiguous case, so that each edge of the mesh belongs to exactly two triangles, however
//! thin or close to one another limbs are. Marching cubes and surface nets, which need fewer triangles, join sheets that pass through one cube.
//!
//! Only blocks of the grid that the surface may pass are looked at. For a block whose points lie up to ρ from its middle, with cᵢ the distance of ball i's centre from there and lᵢ, Lᵢ its smallest and
//! largest radius, F is at most Σ exp(−2 (max(0, cᵢ − ρ) / Lᵢ)²), and at least exp(−2 ((cᵢ + ρ) / lᵢ)²) of any one ball: bounds, and no estimates of a distance, which thin limbs deceive.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::field::{Body, THRESHOLD, VISIBLE};
use super::skeleton::{Posed, State};
use crate::surface::{SurfaceVertex, TriangleMesh};

/// Grid points along the side of a block.
const SIDE: i32 = 8;
/// Vertices keep this part of an edge away from its ends: to avoid triangles without area [–].
const LEAST_PART: f64 = 0.02;
/// A block that is all outside, or all inside.
const UNLIKE: f32 = 1.0;

/// The six tetrahedra of a cube by their corners, of which the bits are steps along x, y and z. All are positively oriented.
const TETRAHEDRA: [[u8; 4]; 6] = [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];

type Key = [i32; 3];

/// What one grid point's value tells: below 0 inside.
struct Grid<'a> {
    body: &'a Body,
    posed: Posed,
    state: &'a State,
    voxel_m: f64,
    /// Values of blocks that the surface may pass.
    blocks: BTreeMap<Key, Vec<f32>>,
}

fn block_of(at: Key) -> (Key, usize) {
    let within = at.map(|it| it.rem_euclid(SIDE) as usize);
    let side = SIDE as usize;
    (at.map(|it| it.div_euclid(SIDE)), within[0] + side * (within[1] + side * within[2]))
}

impl Grid<'_> {
    fn place(&self, at: Key) -> Point3<f64> {
        Point3::from(Vector3::from(at.map(f64::from)) * self.voxel_m)
    }

    /// √D less what it is on the surface.
    fn exact(&self, at: &Point3<f64>) -> f32 {
        self.body.field(&self.posed, self.state, at).map_or(UNLIKE, |it| (it.root().0 - VISIBLE) as f32)
    }

    fn value(&self, at: Key) -> f32 {
        let (block, within) = block_of(at);
        match self.blocks.get(&block) {
            Some(values) => values[within],
            None => self.exact(&self.place(at)),
        }
    }

    /// Fills the blocks that the surface may pass.
    fn fill(&mut self) {
        let balls: Vec<(Point3<f64>, f64, f64)> = (self.body.balls.iter().enumerate())
            .map(|(number, ball)| {
                let scale = self.state.scales[self.body.skeleton.segments()[ball.segment].scale];
                let centre = self.posed.world_from_segment[ball.segment] * Point3::from(ball.centre * scale);
                (centre, self.state.radii[number].min(), self.state.radii[number].max())
            })
            .collect();
        // Beyond this many radii of each, n balls together stay below the threshold.
        let reach = (-0.5 * (THRESHOLD / balls.len().max(1) as f64).ln()).sqrt();
        let span = f64::from(SIDE) * self.voxel_m;
        let rho = 0.5 * 3_f64.sqrt() * span;
        let mut near: BTreeMap<Key, ()> = BTreeMap::new();
        for (centre, _, largest) in &balls {
            let far = reach * largest;
            let low = (centre.coords.add_scalar(-far) / span).map(|it| it.floor() as i32);
            let high = (centre.coords.add_scalar(far) / span).map(|it| it.floor() as i32);
            for x in low.x..=high.x {
                for y in low.y..=high.y {
                    for z in low.z..=high.z {
                        near.insert([x, y, z], ());
                    }
                }
            }
        }
        for block in near.into_keys() {
            let middle = self.place(block.map(|it| it * SIDE)) + Vector3::repeat(0.5 * span);
            let mut most = 0.0;
            let mut is_inside = false;
            for (centre, smallest, largest) in &balls {
                let away = (centre - middle).norm();
                most += (-2.0 * ((away - rho).max(0.0) / largest).powi(2)).exp();
                is_inside |= (-2.0 * ((away + rho) / smallest).powi(2)).exp() > THRESHOLD;
            }
            if is_inside || most < THRESHOLD {
                continue;
            }
            let first = block.map(|it| it * SIDE);
            let values = (0..SIDE.pow(3))
                .map(|it| {
                    self.exact(&self.place([
                        first[0] + it % SIDE,
                        first[1] + it / SIDE % SIDE,
                        first[2] + it / (SIDE * SIDE),
                    ]))
                })
                .collect();
            self.blocks.insert(block, values);
        }
    }
}

/// A mesh as it grows: by an edge of the grid, its lower end and the step to the upper one, the vertex on it.
#[derive(Default)]
struct Growing {
    mesh: TriangleMesh,
    vertices: BTreeMap<(Key, u8), u32>,
}

fn corner(cube: Key, bits: u8) -> Key {
    [0, 1, 2].map(|axis| cube[axis] + i32::from(bits >> axis & 1))
}

impl Growing {
    /// The vertex on the edge between two corners of a cube, of which one has all bits of the other.
    fn vertex(&mut self, grid: &Grid<'_>, cube: Key, (a, b): (u8, u8)) -> u32 {
        let (low, high) = (a.min(b), a.max(b));
        let key = (corner(cube, low), high ^ low);
        let Growing { mesh, vertices } = self;
        *vertices.entry(key).or_insert_with(|| {
            let ends = [low, high].map(|it| corner(cube, it));
            let [from, to] = ends.map(|it| f64::from(grid.value(it)));
            let [start, end] = ends.map(|it| grid.place(it));
            // False position twice: along a diagonal the value is no straight line.
            let (mut low, mut high) = ((0.0, from), (1.0, to));
            for _ in 0..2 {
                let part = low.0 + (high.0 - low.0) * low.1 / (low.1 - high.1);
                let there = f64::from(grid.exact(&(start + (end - start) * part)));
                if (there < 0.0) == (low.1 < 0.0) { low = (part, there) } else { high = (part, there) }
            }
            let part = low.0 + (high.0 - low.0) * low.1 / (low.1 - high.1);
            let position = start + (end - start) * part.clamp(LEAST_PART, 1.0 - LEAST_PART);
            let gradient =
                grid.body.field(&grid.posed, grid.state, &position).map_or(Vector3::zeros(), |it| it.gradient);
            let normal = gradient.try_normalize(0.0).unwrap_or_else(Vector3::z);
            mesh.vertices.push(SurfaceVertex { position, normal, colour: [200; 3], n_points: 1.0, sigma: 0.0 });
            mesh.vertices.len() as u32 - 1
        })
    }

    fn cube(&mut self, grid: &Grid<'_>, cube: Key) {
        let mut inside = 0_u8;
        for bits in 0..8 {
            inside |= u8::from(grid.value(corner(cube, bits)) < 0.0) << bits;
        }
        if inside == 0 || inside == u8::MAX {
            return;
        }
        let is_in = |bits: u8| inside >> bits & 1 == 1;
        for it in TETRAHEDRA {
            // Even permutations keep the orientation: which corner stands first, and which of the others.
            let count = it.iter().filter(|it| is_in(**it)).count();
            let alone = count == 1;
            match count {
                1 | 3 => {
                    let first = it.iter().position(|it| is_in(*it) == alone).unwrap_or_default();
                    let [a, b, c, d] = match first {
                        0 => it,
                        1 => [it[1], it[0], it[3], it[2]],
                        2 => [it[2], it[3], it[0], it[1]],
                        _ => [it[3], it[2], it[1], it[0]],
                    };
                    let [x, y, z] = [(a, b), (a, c), (a, d)].map(|edge| self.vertex(grid, cube, edge));
                    self.mesh.triangles.push(if alone { [x, y, z] } else { [x, z, y] });
                }
                2 => {
                    let evens = [[0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2], [1, 2, 0, 3], [3, 1, 0, 2], [2, 3, 0, 1]];
                    let order = evens.into_iter().find(|order| is_in(it[order[0]]) && is_in(it[order[1]]));
                    let [a, b, c, d] = order.unwrap_or(evens[0]).map(|place| it[place]);
                    let [w, x, y, z] = [(a, c), (a, d), (b, d), (b, c)].map(|edge| self.vertex(grid, cube, edge));
                    self.mesh.triangles.extend([[w, x, y], [w, y, z]]);
                }
                _ => {}
            }
        }
    }
}

/// The surface of the whole body, sampled every `voxel_m` [m]: a closed mesh, each edge shared by two triangles, counter-clockwise from outside.
pub fn surface(body: &Body, state: &State, voxel_m: f64) -> TriangleMesh {
    let posed = body.skeleton.pose(state);
    let is_sound = |it: f64| it.is_finite() && it > 0.0;
    let places =
        posed.world_from_segment.iter().flat_map(|it| it.translation.vector.iter().copied().collect::<Vec<_>>());
    if !is_sound(voxel_m)
        || !state.radii.iter().flat_map(|it| it.iter()).all(|it| is_sound(*it))
        || !places.into_iter().all(f64::is_finite)
    {
        return TriangleMesh::default();
    }
    let mut grid = Grid { body, posed, state, voxel_m, blocks: BTreeMap::new() };
    grid.fill();
    // A cube belongs to the block of its lowest corner; where that block is all inside or outside, the surface may still pass the cube on the way to the next one.
    let mut growing = Growing::default();
    let blocks: Vec<Key> = grid.blocks.keys().copied().collect();
    let mut seams: BTreeMap<Key, ()> = BTreeMap::new();
    for block in blocks {
        let first = block.map(|it| it * SIDE);
        for number in 0..(SIDE + 1).pow(3) {
            let step = [number % (SIDE + 1), number / (SIDE + 1) % (SIDE + 1), number / ((SIDE + 1) * (SIDE + 1))];
            let cube = [0, 1, 2].map(|axis| first[axis] + step[axis] - 1);
            let (own, _) = block_of(cube);
            if own == block {
                growing.cube(&grid, cube);
            } else if !grid.blocks.contains_key(&own) {
                seams.insert(cube, ());
            }
        }
    }
    for cube in seams.into_keys() {
        growing.cube(&grid, cube);
    }
    growing.mesh
}
