//! Connected components of voxels (26-connected).

use nalgebra::Vector3;

use super::bits::BitGrid;

/// A connected component.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Number of its voxels.
    pub n_voxels: u32,
    /// Mean of their indices.
    pub centroid: Vector3<f64>,
    /// Smallest index along x, y, z.
    pub min: [u32; 3],
    /// Largest index along x, y, z.
    pub max: [u32; 3],
}

/// The connected components of a grid, the largest first (ties in the order of the grid), and the component of each voxel.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parts {
    /// The components.
    pub list: Vec<Part>,
    runs: Vec<Run>,
    /// By row: its first run.
    starts: Vec<u32>,
    n_rows: u32,
}

/// Set cells next to each other along x.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Run {
    first: u32,
    last: u32,
    /// First its root, then its part.
    label: u32,
}

impl Parts {
    /// Labels the components of `grid`.
    pub fn of(grid: &BitGrid) -> Parts {
        let [_, n_rows, n_layers] = grid.cells();
        let mut parts = Parts { n_rows, ..Parts::default() };
        for z in 0..n_layers {
            for y in 0..n_rows {
                parts.starts.push(parts.runs.len() as u32);
                parts.add_row(grid.row(y, z));
                parts.join(y, z);
            }
        }
        parts.starts.push(parts.runs.len() as u32);
        parts.count();
        parts
    }

    fn add_row(&mut self, row: &[u64]) {
        let row_start = self.runs.len();
        for (&word, at) in row.iter().zip(0..) {
            let mut rest = word;
            while rest != 0 {
                let first = rest.trailing_zeros();
                let length = (rest >> first).trailing_ones();
                let last = first + length - 1;
                rest &= if last == 63 { 0 } else { u64::MAX << (last + 1) };
                let (first, last) = (64 * at + first, 64 * at + last);
                match self.runs[row_start..].last_mut() {
                    Some(before) if before.last + 1 == first => before.last = last,
                    _ => self.runs.push(Run { first, last, label: self.runs.len() as u32 }),
                }
            }
        }
    }

    /// Joins the runs of the last row to those of the four rows before it that touch it.
    fn join(&mut self, y: u32, z: u32) {
        let row = (z * self.n_rows + y) as usize;
        let start = self.starts[row] as usize;
        if start == self.runs.len() {
            return;
        }
        let before = [
            (y.checked_sub(1), Some(z)),
            (y.checked_sub(1), z.checked_sub(1)),
            (Some(y), z.checked_sub(1)),
            (Some(y + 1), z.checked_sub(1)),
        ];
        for (y, z) in before {
            let (Some(y), Some(z)) = (y, z) else { continue };
            if y >= self.n_rows {
                continue;
            }
            let other = (z * self.n_rows + y) as usize;
            let (mut a, mut b) = (start, self.starts[other] as usize);
            let end = self.starts[other + 1] as usize;
            while a < self.runs.len() && b < end {
                let (mine, theirs) = (self.runs[a], self.runs[b]);
                if mine.first <= theirs.last + 1 && theirs.first <= mine.last + 1 {
                    self.unite(a as u32, b as u32);
                }
                if mine.last < theirs.last { a += 1 } else { b += 1 }
            }
        }
    }

    fn root(&mut self, mut at: u32) -> u32 {
        while self.runs[at as usize].label != at {
            let up = self.runs[self.runs[at as usize].label as usize].label;
            self.runs[at as usize].label = up;
            at = up;
        }
        at
    }

    fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        // The root of a part is its first run, so that roots come before what hangs on them.
        self.runs[a.max(b) as usize].label = a.min(b);
    }

    fn count(&mut self) {
        let mut sums: Vec<(u32, Part)> = Vec::new();
        let mut part_of = vec![u32::MAX; self.runs.len()];
        for row in 0..self.starts.len() - 1 {
            let (y, z) = (row as u32 % self.n_rows.max(1), row as u32 / self.n_rows.max(1));
            for at in self.starts[row]..self.starts[row + 1] {
                let root = self.root(at) as usize;
                if part_of[root] == u32::MAX {
                    part_of[root] = sums.len() as u32;
                    let part = Part { n_voxels: 0, centroid: Vector3::zeros(), min: [u32::MAX; 3], max: [0; 3] };
                    sums.push((root as u32, part));
                }
                let Run { first, last, .. } = self.runs[at as usize];
                let part = &mut sums[part_of[root] as usize].1;
                let n = last - first + 1;
                part.n_voxels += n;
                let middle = Vector3::new(f64::from(first + last) / 2.0, y.into(), z.into());
                part.centroid += middle * f64::from(n);
                for (axis, (low, high)) in [(first, last), (y, y), (z, z)].into_iter().enumerate() {
                    part.min[axis] = part.min[axis].min(low);
                    part.max[axis] = part.max[axis].max(high);
                }
            }
        }
        sums.iter_mut().for_each(|(_, part)| part.centroid /= f64::from(part.n_voxels));
        sums.sort_by_key(|(root, part)| (std::cmp::Reverse(part.n_voxels), *root));
        for ((root, _), place) in sums.iter().zip(0..) {
            part_of[*root as usize] = place;
        }
        for at in 0..self.runs.len() as u32 {
            // A root is met before what hangs on it: it would be lost if its label were its part already.
            let root = self.root(at);
            part_of[at as usize] = part_of[root as usize];
        }
        for (run, part) in self.runs.iter_mut().zip(part_of) {
            run.label = part;
        }
        self.list = sums.into_iter().map(|(_, part)| part).collect();
    }

    /// Index in [`Self::list`] of the component of a voxel; `None` where it is not set.
    pub fn part(&self, [x, y, z]: [u32; 3]) -> Option<u32> {
        let row = (z as usize * self.n_rows as usize) + y as usize;
        let (start, end) = (*self.starts.get(row)? as usize, *self.starts.get(row + 1)? as usize);
        let runs = &self.runs[start..end];
        let at = runs.partition_point(|it| it.last < x);
        runs.get(at).filter(|it| it.first <= x && y < self.n_rows).map(|it| it.label)
    }
}
