//! What may be body: places of which no view is sure that they are background.
//!
//! To one camera, clothes as dark as the floor behind them are the floor's shadow. All views together know better: a shadow lies on something, so that what could be body in every view at once is
//! as flat there as the rims of shadows are blurred, while a body stands. So voxels that the carver would keep if pixels in doubt were body are kept if most views are sure of them, or where
//! they hang together from below to above for as long as a body does and no shadow.

use super::{BODY, BitGrid, CarveError, CarveOptions, Carver, SilhouetteView, VoxelGrid, opinions};

/// When a voxel in doubt is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DoubtOptions {
    /// A pixel may be body from this confidence on; [`BODY`] or more: none is in doubt.
    pub from: u8,
    /// Voxels in doubt that hang together along z for less than this are a shadow's, unless most views are sure of them [m].
    pub height: f64,
}

/// Carves with pixels in doubt; keeps its memory from one time to the next.
#[derive(Debug, Clone, Default)]
pub struct Doubt {
    carver: Carver,
    /// By view: body where it may be.
    wide: Vec<Vec<u8>>,
}

impl Doubt {
    /// Takes in the silhouettes; whether any pixel is in doubt.
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

    /// As [`Carver::bounds`], of what may be body.
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

    /// Adds to `hull`, which the views left over of `grid`, what they leave over with pixels in doubt and is no shadow.
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
