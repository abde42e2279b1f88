//! Agreement of a hull with a silhouette.
//!
//! The hull is drawn into the picture, each surface voxel as a square of its apparent size, wherever its centre lies.

use super::mask::BODY;
use super::{BitGrid, SilhouetteView, VoxelGrid};

/// Pixel counts of one view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Cover {
    /// Body pixels of the silhouette [px].
    pub body: u32,
    /// Body pixels that the hull covers [px].
    pub covered: u32,
    /// Pixels that the hull covers [px].
    pub drawn: u32,
}

impl Cover {
    /// The part of the silhouette that the hull covers; 1 where there is no body [–].
    pub fn completeness(&self) -> f64 {
        if self.body == 0 { 1.0 } else { f64::from(self.covered) / f64::from(self.body) }
    }

    /// The part of the drawn hull that is background in the silhouette; 0 where there is no hull [–].
    pub fn outside(&self) -> f64 {
        if self.drawn == 0 { 0.0 } else { 1.0 - f64::from(self.covered) / f64::from(self.drawn) }
    }
}

/// Draws the voxels of `surface` into `drawn`, a byte per pixel of the view, and compares them with the silhouette.
pub fn cover(grid: &VoxelGrid, surface: &BitGrid, view: &SilhouetteView, drawn: &mut Vec<u8>) -> Cover {
    drawn.clear();
    drawn.resize(view.confidence.len(), 0);
    let shrink = f64::from(view.shrink.max(1));
    let place = |at: f64, start: u32| (at + 0.5 - f64::from(start)) / shrink - 0.5;
    let focal = view.camera.intrinsics.focal.map(|it| it / shrink);
    for index in surface.iter() {
        let centre = grid.centre(index);
        let Some(pixel) = view.camera.project(&centre) else { continue };
        let depth = (view.camera.camera_from_world * centre).z;
        // The pixels whose centres lie in the square, and the one in which the voxel's centre lies: no voxel is lost between pixels.
        let range = |at: f64, focal: f64, n: u32| {
            let half = 0.5 * focal * grid.size / depth;
            let nearest = at.round();
            let [first, last] = [(at - half).ceil().min(nearest), (at + half).floor().max(nearest)];
            first.max(0.0) as usize..((last + 1.0).max(0.0) as usize).min(n as usize)
        };
        let columns = range(place(pixel.x, view.left), focal[0], view.width);
        for row in range(place(pixel.y, view.top), focal[1], view.height) {
            if columns.start < columns.end {
                let start = row * view.width as usize;
                drawn[start + columns.start..start + columns.end].fill(1);
            }
        }
    }
    let mut cover = Cover::default();
    for (drawn, confidence) in drawn.iter().zip(view.confidence) {
        let is_body = *confidence >= BODY;
        cover.body += u32::from(is_body);
        cover.drawn += u32::from(*drawn);
        cover.covered += u32::from(is_body) & u32::from(*drawn);
    }
    cover
}
