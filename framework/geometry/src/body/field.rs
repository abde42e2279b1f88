//! Voxels as a field: occupancy, depth inside, and the faces between inside and outside.
//!
//! A voxel is occupied where its *centre* is inside. So a skin that passes between an occupied and an empty neighbour
//! lies anywhere between their centres, and on average at the middle of their common face: faces measure without the
//! bias of half a voxel that surface voxels have.
//! Depths come from exact Euclidean distance transforms (P. F. Felzenszwalb and D. P. Huttenlocher, "Distance transforms of sampled functions", Theory of Computing 8, 2012).

use nalgebra::{Point3, Vector3};

/// Cells around the occupied ones, so that gradients outside exist.
const MARGIN: usize = 3;

/// A grid without ends.
pub const ENDLESS: [u32; 3] = [u32::MAX; 3];

/// A piece of the voxels' skin: the common face of an occupied cell and an empty one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face {
    /// Centre of the face [m].
    pub position: Point3<f64>,
    /// Unit normal, outwards; from the depths around it, so that it is not limited to six directions.
    pub normal: Vector3<f64>,
    /// Index of the occupied cell.
    pub cell: u32,
}

/// Voxels with their depths and faces, in a box around them.
#[derive(Debug, Clone)]
pub struct VoxelField {
    size: f64,
    /// Centre of cell (0, 0, 0) [m].
    first: Point3<f64>,
    cells: [usize; 3],
    occupied: Vec<bool>,
    /// The occupied cells, ascending.
    list: Vec<u32>,
    /// At the centres: above 0 inside [m].
    depth: Vec<f32>,
    faces: Vec<Face>,
    /// Of each axis, whether the grid ends at the first and at the last of the occupied cells.
    ends: [[bool; 2]; 3],
}

impl VoxelField {
    /// The field of the cubes at `indices` of a grid of edge `size` [m] whose corner of least x, y, z is `origin` [m]. `None` without voxels.
    ///
    /// The grid has `cells` along x, y, z. Voxels at its end may continue beyond: there are no faces there, and depths
    /// are as if they did. Below its lowest cells is the floor.
    pub fn new(size: f64, origin: &Point3<f64>, indices: &[[u16; 3]], cells: [u32; 3]) -> Option<Self> {
        let (mut low, mut high) = (*indices.first()?, *indices.first()?);
        for index in indices {
            for axis in 0..3 {
                low[axis] = low[axis].min(index[axis]);
                high[axis] = high[axis].max(index[axis]);
            }
        }
        let ends = std::array::from_fn(|axis| {
            [axis < 2 && low[axis] == 0 && cells[axis] < u32::MAX, u32::from(high[axis]) + 1 == cells[axis]]
        });
        let cells = std::array::from_fn(|axis| usize::from(high[axis] - low[axis]) + 1 + 2 * MARGIN);
        let first = origin + Vector3::from(low.map(|it| f64::from(it) + 0.5 - MARGIN as f64)) * size;
        let mut occupied = vec![false; cells[0] * cells[1] * cells[2]];
        for index in indices {
            let [x, y, z]: [usize; 3] = std::array::from_fn(|axis| usize::from(index[axis] - low[axis]) + MARGIN);
            occupied[x + cells[0] * (y + cells[1] * z)] = true;
        }
        let list = (0..occupied.len()).filter(|&it| occupied[it]).map(|it| it as u32).collect();
        let mut field = Self { size, first, cells, occupied, list, depth: Vec::new(), faces: Vec::new(), ends };
        field.go_on_beyond();
        field.measure_depths();
        field.find_faces();
        Some(field)
    }

    /// Beyond an end of the grid goes on what reaches it.
    fn go_on_beyond(&mut self) {
        let [nx, ny, nz] = self.cells;
        for axis in 0..3 {
            for side in (0..2).filter(|it| self.ends[axis][*it]) {
                let last = if side == 0 { MARGIN } else { self.cells[axis] - 1 - MARGIN };
                for cell in 0..nx * ny * nz {
                    let mut at = [cell % nx, cell / nx % ny, cell / (nx * ny)];
                    let is_beyond = if side == 0 { at[axis] < last } else { at[axis] > last };
                    if is_beyond {
                        at[axis] = last;
                        self.occupied[cell] = self.occupied[at[0] + nx * (at[1] + ny * at[2])];
                    }
                }
            }
        }
    }

    /// Whether voxels reach an end of the grid.
    pub fn is_cut_off(&self) -> bool {
        self.ends.as_flattened().contains(&true)
    }

    /// The thickest place of the voxels at the grid's upper end, and its depth [m]; `None` if no voxel reaches it.
    pub fn thickest_at_top(&self) -> Option<(Point3<f64>, f64)> {
        let at_top = |it: &&u32| **it as usize / (self.cells[0] * self.cells[1]) + 1 + MARGIN == self.cells[2];
        let top = self.list.iter().filter(|_| self.ends[2][1]).filter(at_top);
        let thickest = top.max_by(|a, b| self.depth_of(**a).total_cmp(&self.depth_of(**b)))?;
        Some((self.centre(*thickest), self.depth_of(*thickest)))
    }

    /// Whether a place lies beyond an end of the grid that voxels reach, where occupancy is unknown.
    pub fn is_beyond(&self, place: &Point3<f64>) -> bool {
        let at = (place - self.first) / self.size;
        (0..3).any(|axis| {
            let [low, high] = self.ends[axis];
            let last = (self.cells[axis] - MARGIN) as f64 - 0.5;
            (low && at[axis] < MARGIN as f64 - 0.5) || (high && at[axis] > last)
        })
    }

    /// Edge of a voxel [m].
    pub fn size(&self) -> f64 {
        self.size
    }

    /// Number of voxels.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Always `false`: a field has voxels.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// The occupied cells, ascending.
    pub fn voxels(&self) -> &[u32] {
        &self.list
    }

    /// Number of cells, occupied or not.
    pub fn n_cells(&self) -> usize {
        self.occupied.len()
    }

    /// Faces between inside and outside, in the order of their cells.
    pub fn faces(&self) -> &[Face] {
        &self.faces
    }

    /// Centre of a cell [m].
    pub fn centre(&self, cell: u32) -> Point3<f64> {
        let [nx, ny, _] = self.cells;
        let cell = cell as usize;
        let index = [cell % nx, cell / nx % ny, cell / (nx * ny)];
        self.first + Vector3::from(index.map(|it| it as f64)) * self.size
    }

    /// The cell around a place; `None` outside the box.
    pub fn cell(&self, place: &Point3<f64>) -> Option<u32> {
        let at = (place - self.first) / self.size;
        let mut cell = 0;
        for axis in [2, 1, 0] {
            let index = at[axis].round();
            if !(index >= 0.0 && index < self.cells[axis] as f64) {
                return None;
            }
            cell = cell * self.cells[axis] + index as usize;
        }
        Some(cell as u32)
    }

    /// Whether a place lies in an occupied cell.
    pub fn is_occupied(&self, place: &Point3<f64>) -> bool {
        self.cell(place).is_some_and(|it| self.occupied[it as usize])
    }

    /// Whether a cell is occupied.
    pub fn holds(&self, cell: u32) -> bool {
        self.occupied[cell as usize]
    }

    /// Depth of a cell's centre: above 0 inside [m].
    pub fn depth_of(&self, cell: u32) -> f64 {
        f64::from(self.depth[cell as usize])
    }

    /// Depth of any place, above 0 inside, and its gradient, interpolated between centres; outside the box the depth
    /// at the nearest place in it minus the distance to there.
    pub fn depth(&self, place: &Point3<f64>) -> (f64, Vector3<f64>) {
        let at = (place - self.first) / self.size;
        let inside = Vector3::from_fn(|axis, _| at[axis].clamp(0.0, self.cells[axis] as f64 - 1.001));
        let base: [usize; 3] = std::array::from_fn(|axis| inside[axis] as usize);
        let share = inside - Vector3::from(base.map(|it| it as f64));
        let [nx, ny, _] = self.cells;
        let at_corner = |dx: usize, dy: usize, dz: usize| {
            f64::from(self.depth[base[0] + dx + nx * (base[1] + dy + ny * (base[2] + dz))])
        };
        let mut depth = 0.0;
        let mut gradient = Vector3::zeros();
        for corner in 0..8_usize {
            let on = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weight: [f64; 3] =
                std::array::from_fn(|axis| if on[axis] == 1 { share[axis] } else { 1.0 - share[axis] });
            let value = at_corner(on[0], on[1], on[2]);
            depth += weight[0] * weight[1] * weight[2] * value;
            for axis in 0..3 {
                let others = weight[(axis + 1) % 3] * weight[(axis + 2) % 3];
                gradient[axis] += if on[axis] == 1 { others * value } else { -others * value };
            }
        }
        let beyond = (at - inside) * self.size;
        let far = beyond.norm();
        if far > 2e-3 * self.size {
            return (depth - far, -beyond / far);
        }
        (depth, gradient / self.size)
    }

    /// The neighbours of a cell: over faces first, then over edges, then over corners, with their distances in cells.
    pub fn neighbours(&self, cell: u32) -> impl Iterator<Item = (u32, f32)> {
        let [nx, ny, _] = self.cells.map(|it| it as i64);
        STEPS.iter().map(move |&([x, y, z], length)| {
            ((i64::from(cell) + i64::from(x) + nx * (i64::from(y) + ny * i64::from(z))) as u32, length)
        })
    }

    /// Squared distances [cells²] to the nearest cell that is (not) occupied.
    fn squared_distances(&self, to_occupied: bool) -> Vec<f32> {
        let mut squares: Vec<f32> =
            self.occupied.iter().map(|&it| if it == to_occupied { 0.0 } else { f32::INFINITY }).collect();
        let [nx, ny, nz] = self.cells;
        let longest = nx.max(ny).max(nz);
        let mut work = Transform::new(longest);
        let lines = [(nx, 1, ny * nz), (ny, nx, nx * nz), (nz, nx * ny, nx * ny)];
        for (axis, (length, stride, count)) in lines.into_iter().enumerate() {
            for line in 0..count {
                let start = match axis {
                    0 => line * nx,
                    1 => line % nx + line / nx * nx * ny,
                    _ => line,
                };
                work.line(&mut squares, start, stride, length);
            }
        }
        squares
    }

    fn measure_depths(&mut self) {
        let outwards = self.squared_distances(false);
        let inwards = self.squared_distances(true);
        let size = self.size as f32;
        // From centre to centre; the skin lies half a cell before that.
        let deep = |(out, to): (f32, f32)| {
            if out > 0.0 { (out.sqrt() - 0.5) * size } else { (0.5 - to.sqrt()) * size }
        };
        self.depth = outwards.into_iter().zip(inwards).map(deep).collect();
    }

    fn slope(&self, cell: u32) -> Vector3<f64> {
        let [nx, ny, _] = self.cells;
        let at = cell as usize;
        // Over one cell and over two: depths of cubes go in steps.
        let over = |stride: usize| f64::from(self.depth[at + stride] - self.depth[at - stride]);
        let difference = |stride: usize| over(stride) + over(2 * stride);
        Vector3::new(difference(1), difference(nx), difference(nx * ny))
    }

    fn find_faces(&mut self) {
        let [nx, ny, _] = self.cells;
        let strides = [1, nx, nx * ny].map(|it| it as i64);
        let mut faces = Vec::new();
        for &cell in &self.list {
            let centre = self.centre(cell);
            for axis in 0..3 {
                for sign in [-1_i64, 1] {
                    let other = (i64::from(cell) + sign * strides[axis]) as u32;
                    if self.occupied[other as usize] {
                        continue;
                    }
                    let mut straight = Vector3::zeros();
                    straight[axis] = sign as f64;
                    let slope = -(self.slope(cell) + self.slope(other));
                    let normal = slope.try_normalize(1e-6).filter(|it| it.dot(&straight) > 0.0).unwrap_or(straight);
                    faces.push(Face { position: centre + straight * (self.size / 2.0), normal, cell });
                }
            }
        }
        self.faces = faces;
    }
}

const STEPS: [([i8; 3], f32); 26] = steps();

const fn steps() -> [([i8; 3], f32); 26] {
    let mut steps = [([0; 3], 0.0); 26];
    let mut n = 0;
    let mut wanted = 1;
    while wanted <= 3 {
        let mut code = 0;
        while code < 27 {
            let step = [(code % 3) as i8 - 1, (code / 3 % 3) as i8 - 1, (code / 9) as i8 - 1];
            let squared = step[0] * step[0] + step[1] * step[1] + step[2] * step[2];
            if squared == wanted {
                let length = [1.0, std::f32::consts::SQRT_2, 1.732_050_8][wanted as usize - 1];
                steps[n] = (step, length);
                n += 1;
            }
            code += 1;
        }
        wanted += 1;
    }
    steps
}

/// One line of the distance transform: the lower envelope of parabolas.
struct Transform {
    values: Vec<f32>,
    apexes: Vec<usize>,
    from: Vec<f32>,
}

impl Transform {
    fn new(longest: usize) -> Self {
        Self { values: vec![0.0; longest], apexes: vec![0; longest], from: vec![0.0; longest + 1] }
    }

    fn line(&mut self, squares: &mut [f32], start: usize, stride: usize, length: usize) {
        for i in 0..length {
            self.values[i] = squares[start + i * stride];
        }
        let f = &self.values;
        let Some(first) = (0..length).find(|&it| f[it].is_finite()) else { return };
        let mut last = 0;
        self.apexes[0] = first;
        self.from[0] = f32::NEG_INFINITY;
        for q in first + 1..length {
            if !f[q].is_finite() {
                continue;
            }
            loop {
                let p = self.apexes[last];
                let meet = ((f[q] + (q * q) as f32) - (f[p] + (p * p) as f32)) / (2 * (q - p)) as f32;
                if meet <= self.from[last] {
                    last -= 1; // never below 0: everything is right of −∞
                } else {
                    last += 1;
                    self.apexes[last] = q;
                    self.from[last] = meet;
                    break;
                }
            }
        }
        let mut k = 0;
        for i in 0..length {
            while k < last && self.from[k + 1] < i as f32 {
                k += 1;
            }
            let p = self.apexes[k];
            let off = i as f32 - p as f32;
            squares[start + i * stride] = off * off + f[p];
        }
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    fn ball(size: f64, radius: f64) -> (VoxelField, Point3<f64>) {
        let middle = Point3::new(0.513, 0.487, 0.502);
        let n = (1.0 / size) as u16;
        let centre = |index: [u16; 3]| Point3::from(Vector3::from(index.map(|it| (f64::from(it) + 0.5) * size)));
        let all = (0..n).flat_map(|z| (0..n).flat_map(move |y| (0..n).map(move |x| [x, y, z])));
        let inside: Vec<[u16; 3]> = all.filter(|it| (centre(*it) - middle).norm() < radius).collect();
        (VoxelField::new(size, &Point3::origin(), &inside, ENDLESS).unwrap(), middle)
    }

    #[test]
    fn faces_of_a_ball_lie_on_it_without_bias() {
        for size in [0.02, 0.05] {
            let (field, middle) = ball(size, 0.3);
            let off: Vec<f64> = field.faces().iter().map(|it| (it.position - middle).norm() - 0.3).collect();
            let mean = off.iter().sum::<f64>() / off.len() as f64;
            assert!(mean.abs() < 0.04 * size, "faces of {size} m lie {mean} m outside");
            assert!(off.iter().all(|it| it.abs() < 0.9 * size));
            let turned = field.faces().iter().map(|it| it.normal.dot(&(it.position - middle).normalize()));
            assert!(turned.fold(1.0, f64::min) > 0.7);
        }
    }

    #[test]
    fn depths_are_distances_from_the_skin() {
        let (field, middle) = ball(0.02, 0.3);
        let mut random = Random::new(1);
        let mut along = 0.0;
        for _ in 0..500 {
            let way = Vector3::from_fn(|_, _| random.normal()).normalize();
            let at = random.uniform_in(0.05, 0.33);
            let (depth, gradient) = field.depth(&(middle + way * at));
            assert!((depth - (0.3 - at)).abs() < 0.015, "{depth} at {at}");
            assert!(gradient.dot(&way) < -0.2, "{gradient} along {way} at {at}");
            along += gradient.dot(&way) / 500.0;
        }
        assert!((along + 1.0).abs() < 0.12, "{along}");
        let (far, back) = field.depth(&(middle + Vector3::x() * 2.0));
        assert!((far + 1.7).abs() < 0.05 && back.x < -0.99, "{far} {back}");
    }

    #[test]
    fn distances_are_the_smallest_of_all() {
        let mut random = Random::new(2);
        let some: Vec<[u16; 3]> = (0..60).map(|_| [(); 3].map(|()| random.below(12) as u16)).collect();
        let field = VoxelField::new(1.0, &Point3::origin(), &some, ENDLESS).unwrap();
        let nearest = |from: u32, occupied: bool| {
            let others = (0..field.n_cells() as u32).filter(|&it| field.holds(it) == occupied);
            others.map(|it| (field.centre(it) - field.centre(from)).norm()).fold(f64::INFINITY, f64::min)
        };
        for cell in (0..field.n_cells() as u32).step_by(7) {
            let held = field.holds(cell);
            let expected = if held { nearest(cell, false) - 0.5 } else { 0.5 - nearest(cell, true) };
            assert!((field.depth_of(cell) - expected).abs() < 1e-4);
        }
    }

    #[test]
    fn what_reaches_the_end_of_the_grid_goes_on_there() {
        // A bar of 4 × 4 × 10 cells; the grid ends at its top and at its left, and nowhere else.
        let bar: Vec<[u16; 3]> = (0..160).map(|it| [it % 4, it / 4 % 4 + 1, it / 16]).collect();
        let field = VoxelField::new(0.1, &Point3::origin(), &bar, [9, 9, 10]).unwrap();
        assert_eq!(field.len(), 160);
        let looks = |axis: usize, sign: f64| {
            field.faces().iter().filter(|it| it.normal[axis] * sign > 0.9 || it.position[axis] * sign > 0.99).count()
        };
        assert_eq!(looks(2, 1.0), 0);
        assert!(field.faces().iter().all(|it| it.position.x > 0.01), "faces at the left end");
        assert!(field.faces().iter().any(|it| it.position.z < 0.01), "people stand on a floor");
        let p = |x: f64, z: f64| Point3::new(x, 0.3, z);
        assert!((field.depth(&p(0.05, 0.95)).0 - field.depth(&p(0.05, 0.5)).0).abs() < 1e-6);
        assert_eq!(
            [p(-0.05, 0.5), p(0.2, 1.05), p(0.2, -0.05), p(0.45, 0.5), p(0.2, 0.5)].map(|it| field.is_beyond(&it)),
            [true, true, false, false, false]
        );
    }

    #[test]
    fn no_voxels_are_no_field() {
        assert!(VoxelField::new(0.05, &Point3::origin(), &[], ENDLESS).is_none());
    }
}
