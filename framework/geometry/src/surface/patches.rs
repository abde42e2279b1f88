//! Oriented points in cells, coarse to fine: a growing surface to register clouds to.
//!
//! Each cell keeps the mean of its points and of their normals, weighted by 1/σ² along the normal. Cells of a level
//! are twice as wide as those of the level below, so that a poor start converges on the coarse levels; a query costs a
//! look at 27 cells on any level.

use nalgebra::{Point3, Vector3};

use super::key::{CellTable, cell_of, key};
use super::{Match, Surface, SurfacePoint};

/// Normals of one cell add up to at least this part of their number, or it is an edge and no plane [–].
const MIN_AGREEMENT: f64 = 0.7;
/// Standard deviation of a surface about the plane of a patch, over its cell's width: that of a curve whose radius is ten cells.
const BEND: f64 = 0.03;

/// What fell into a cell.
#[derive(Debug, Clone, Copy, Default)]
struct Patch {
    /// Σ 1/σ² [1/m²].
    weight: f64,
    /// Σ x/σ².
    position: Vector3<f64>,
    /// Σ n/σ².
    normal: Vector3<f64>,
}

#[derive(Debug, Clone)]
struct Level {
    size_m: f64,
    table: CellTable,
    patches: Vec<Patch>,
}

/// A surface of oriented points in cells, on several levels.
#[derive(Debug, Clone)]
pub struct Patches {
    levels: Vec<Level>,
    max_patches: usize,
}

impl Patches {
    /// An empty surface; the finest cells are `cell_m` wide, each of `n_levels` levels twice as coarse as the one
    /// before; at most `max_patches` cells on the finest.
    pub fn new(cell_m: f64, n_levels: usize, max_patches: usize) -> Patches {
        let level = |number: usize| Level {
            size_m: cell_m * f64::from(1_u32 << number.min(20)),
            table: CellTable::default(),
            patches: Vec::new(),
        };
        Patches { levels: (0..n_levels.max(1)).map(level).collect(), max_patches }
    }

    /// Adds a point. Returns `false` for points without a normal, not finite, or too far away, and for points in new
    /// cells when there are `max_patches`.
    pub fn add(&mut self, point: &SurfacePoint) -> bool {
        let variance = point.variance_along(&point.normal);
        if !point.is_sound() || point.normal == Vector3::zeros() || variance <= 0.0 {
            return false;
        }
        let weight = variance.recip();
        for (number, level) in self.levels.iter_mut().enumerate() {
            let Some(key) = key(cell_of(&point.position, level.size_m)) else { return false };
            let place = match level.table.get(&key) {
                Some(&place) => place as usize,
                None if number == 0 && level.patches.len() >= self.max_patches => return false,
                None => {
                    level.patches.push(Patch::default());
                    level.table.insert(key, (level.patches.len() - 1) as u32);
                    level.patches.len() - 1
                }
            };
            let patch = &mut level.patches[place];
            patch.weight += weight;
            patch.position += point.position.coords * weight;
            patch.normal += point.normal * weight;
        }
        true
    }

    /// Multiplies the weight of all points so far by `share`, above 0 to 1.
    pub fn fade(&mut self, share: f64) {
        for patch in self.levels.iter_mut().flat_map(|it| &mut it.patches) {
            patch.weight *= share;
            patch.position *= share;
            patch.normal *= share;
        }
    }

    /// Number of occupied cells on the finest level.
    pub fn len(&self) -> usize {
        self.levels.first().map_or(0, |it| it.patches.len())
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Mean unit normal around a point, on a level.
    pub fn normal_at(&self, level: usize, point: &Point3<f64>) -> Option<Vector3<f64>> {
        let level = self.levels.get(level)?;
        let place = *level.table.get(&key(cell_of(point, level.size_m))?)?;
        level.patches[place as usize].plane().map(|it| it.1)
    }
}

impl Patch {
    /// Mean position and normal. `None`: an edge.
    fn plane(&self) -> Option<(Point3<f64>, Vector3<f64>)> {
        let length = self.normal.norm();
        (length > MIN_AGREEMENT * self.weight)
            .then(|| (Point3::from(self.position / self.weight), self.normal / length))
    }
}

impl Surface for Patches {
    fn n_levels(&self) -> usize {
        self.levels.len()
    }

    fn reach(&self, level: usize) -> f64 {
        self.levels[level].size_m
    }

    fn bend(&self, level: usize) -> f64 {
        // The finest level decides: there the misfit itself says what bends.
        if level == 0 { 0.0 } else { BEND * self.levels[level].size_m }
    }

    fn nearest(&self, level: usize, point: &Point3<f64>) -> Option<Match> {
        let level = &self.levels[level];
        let [x, y, z] = cell_of(point, level.size_m);
        let mut best: Option<(f64, u32)> = None;
        let mut least = level.size_m * level.size_m;
        for (dx, dy, dz) in (-1..=1).flat_map(|dx| (-1..=1).flat_map(move |dy| (-1..=1).map(move |dz| (dx, dy, dz)))) {
            let cell = [x.saturating_add(dx), y.saturating_add(dy), z.saturating_add(dz)];
            let Some(&place) = key(cell).and_then(|it| level.table.get(&it)) else { continue };
            let patch = &level.patches[place as usize];
            let squared = (patch.position / patch.weight - point.coords).norm_squared();
            if squared < least {
                least = squared;
                best = Some((squared, place));
            }
        }
        let (_, place) = best?;
        let patch = &level.patches[place as usize];
        let (position, normal) = patch.plane()?;
        Some(Match { number: place as usize, position, normal, variance: patch.weight.recip() })
    }
}
