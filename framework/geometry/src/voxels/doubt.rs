//! Uncertain voxels: places that no view calls background for sure.
//!
//! To one camera, clothes as dark as the floor behind them look like a shadow on the floor. All views together
//! distinguish them: a shadow lies on something, so that what could be body in every view at once is as flat there as
//! the rims of shadows are blurred, while a body is upright. So voxels that would be kept if uncertain pixels were
//! body are kept if most views are sure of them, or where they are connected upwards for as long as a body is and a
//! shadow is not.

use super::{BODY, BitGrid, CarveError, CarveOptions, Carver, SilhouetteView, VoxelGrid, opinions};

/// When an uncertain voxel is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DoubtOptions {
    /// A pixel may be body from this confidence on; with [`BODY`] or more no pixel is uncertain.
    pub from: u8,
    /// Columns of uncertain voxels shorter than this are taken as shadow, unless most views are sure of them [m].
    pub height: f64,
}

/// Carves with uncertain pixels, and reuses its memory.
#[derive(Debug, Clone, Default)]
pub struct Doubt {
    carver: Carver,
    /// By view: body where it may be.
    wide: Vec<Vec<u8>>,
}

impl Doubt {
    /// Takes in the silhouettes; returns whether any pixel is uncertain.
    pub fn look(&mut self, views: &[SilhouetteView], options: &DoubtOptions) -> bool {
        self.wide.resize_with(views.len(), Vec::new);
        let mut any = false;
        for (view, wide) in views.iter().zip(&mut self.wide) {
            wide.clear();
            wide.extend(view.confidence.iter().map(|it| u8::from(*it >= options.from) * u8::MAX));
            any |= view.confidence.iter().any(|it| (options.from..BODY).contains(it));
        }
        any
    }

    /// As [`Carver::bounds`], with uncertain pixels as body.
    ///
    /// # Errors
    /// As [`Carver::carve`].
    pub fn bounds(
        &mut self,
        grid: &VoxelGrid,
        views: &[SilhouetteView],
        options: &CarveOptions,
    ) -> Result<Option<[[u32; 3]; 2]>, CarveError> {
        let Self { carver, wide } = self;
        carver.bounds(grid, &in_doubt(views, wide), options)
    }

    /// Adds to `hull`, which was carved from the views of `grid`, the uncertain voxels that are not shadow.
    ///
    /// # Errors
    /// As [`Carver::carve`].
    pub fn add(
        &mut self,
        hull: &mut BitGrid,
        grid: &VoxelGrid,
        views: &[SilhouetteView],
        carve: &CarveOptions,
        options: &DoubtOptions,
    ) -> Result<(), CarveError> {
        let Self { carver, wide } = self;
        let possible = carver.carve(grid, &in_doubt(views, wide), carve)?;
        let upright = possible.upright((options.height / grid.size).ceil() as u32);
        for index in possible.iter() {
            if !hull.get(index) && (upright.get(index) || most_are_sure(grid, index, views)) {
                hull.set(index);
            }
        }
        Ok(())
    }
}

/// The views, body where it may be.
fn in_doubt<'a>(views: &[SilhouetteView<'a>], wide: &'a [Vec<u8>]) -> Vec<SilhouetteView<'a>> {
    views.iter().zip(wide).map(|(view, wide)| SilhouetteView { confidence: wide, ..*view }).collect()
}

/// Whether half of the views in whose picture a voxel lies call it body.
fn most_are_sure(grid: &VoxelGrid, index: [u32; 3], views: &[SilhouetteView]) -> bool {
    let (seen, dissent) = opinions(&grid.centre(index), views);
    2 * dissent <= seen
}
