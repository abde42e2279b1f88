//! Whether silhouettes would fit each other much better as their mirror images: files that were turned over left to right, all alike, make a body whose left is right, and no single view is to blame.

use foveate::messages::Window;
use foveate::prelude::*;

use super::contradiction::used;
use super::{Hull, View};

/// So much of what no voxels cover is covered once all are mirrored, at least [–].
const BETTER: f64 = 0.5;

impl Hull {
    /// Whether more of the silhouettes that carve is covered when they are mirrored left to right, where as they are `covered` is [–].
    pub(super) fn fits_mirrored(
        &mut self,
        views: &[View],
        statuses: &[ViewStatus],
        covered: f64,
    ) -> Result<bool, String> {
        let mirrored: Vec<Silhouette> = views.iter().map(mirrored).collect();
        let views: Vec<View> = views
            .iter()
            .zip(&mirrored)
            .map(|(view, silhouette)| View { camera: view.camera.clone(), silhouette, picture: None, ..*view })
            .collect();
        let coarse = self.coarse();
        let found = self.hull_of(&views, statuses, coarse)?;
        Ok(1.0 - self.covered(&views, &used(statuses), found.as_ref()) < (1.0 - BETTER) * (1.0 - covered))
    }
}

/// A silhouette turned over left to right, about the middle of the camera's picture.
fn mirrored(view: &View) -> Silhouette {
    let Silhouette { width, window, ref confidence, .. } = *view.silhouette;
    let right = view.camera.image_size[0].saturating_sub(window.left + width * window.shrink);
    let rows = confidence.chunks(width.max(1) as usize);
    Silhouette {
        window: Window { left: right, ..window },
        confidence: rows.flat_map(|row| row.iter().rev().copied()).collect(),
        ..view.silhouette.clone()
    }
}
