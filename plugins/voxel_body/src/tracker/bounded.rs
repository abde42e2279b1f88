//! Voxels that are no more than a tracker can work through: pieces that are too large for bodies are left out, voxels that are too many are merged.

use std::collections::BTreeMap;

use foveate::geometry::body::Cubes;
use foveate::prelude::*;

/// Voxels of a message, at most, that are looked at as they are: six people of 80 l in voxels of 10 mm.
pub(super) const MOST_VOXELS: usize = 500_000;

/// Places of voxels for [`Cubes`]; keeps its memory.
#[derive(Default)]
pub(super) struct Bounded {
    indices: Vec<[u16; 3]>,
    components: Vec<u16>,
    /// Voxels along the edge of a cube.
    merged: u16,
}

/// Whether a piece holds more than `most` [m³].
pub(super) fn is_huge(component: &VoxelComponent, size: f64, most: f64) -> bool {
    f64::from(component.n_voxels) * size.powi(3) > most
}

impl Bounded {
    /// Takes in the voxels but those of pieces above `most` [m³].
    pub(super) fn take(&mut self, voxels: &Voxels, most: f64) {
        let Self { indices, components, merged } = self;
        indices.clear();
        components.clear();
        let is_left_out: Vec<bool> = voxels.components.iter().map(|it| is_huge(it, voxels.size, most)).collect();
        for voxel in voxels.iter() {
            if !is_left_out.get(usize::from(voxel.component)).copied().unwrap_or(false) {
                indices.push(voxel.index);
                components.push(voxel.component);
            }
        }
        *merged = 1;
        while indices.len() / usize::from(*merged).pow(3) > MOST_VOXELS {
            *merged += 1;
        }
        if *merged == 1 {
            return;
        }
        // A cube is there where half of its voxels are; ascending by z, y, x as voxels are.
        let mut cubes: BTreeMap<([u16; 3], u16), u32> = BTreeMap::new();
        for (index, component) in indices.iter().zip(&*components) {
            let [x, y, z] = index.map(|it| it / *merged);
            *cubes.entry(([z, y, x], *component)).or_default() += 1;
        }
        let half = u32::from(*merged).pow(3).div_ceil(2);
        indices.clear();
        components.clear();
        for (([z, y, x], component), _) in cubes.into_iter().filter(|it| it.1 >= half) {
            indices.push([x, y, z]);
            components.push(component);
        }
    }

    /// How many voxels lie along the edge of a cube.
    pub(super) fn merged(&self) -> u16 {
        self.merged
    }

    /// What was taken in last, of `voxels`.
    pub(super) fn cubes(&self, voxels: &Voxels) -> Cubes<'_> {
        Cubes {
            size: voxels.size * f64::from(self.merged.max(1)),
            origin: voxels.origin,
            cells: voxels.cells.map(|it| it.div_ceil(u32::from(self.merged.max(1)))),
            indices: &self.indices,
            components: &self.components,
        }
    }
}
