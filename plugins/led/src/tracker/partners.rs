//! Cameras with a common view: only these can confirm each other's features.
//!
//! Without this the search for an initiation would grow with the square of the number of cameras.

use foveate::geometry::Camera;
use foveate::messages::CameraId;
use nalgebra::Point2;

/// A camera has at most this many partners, itself among them.
const MOST_PARTNERS: usize = 32;
/// Points on each of the camera's lines of sight, at these parts of the mean distance of all cameras from their middle [–].
const DEPTHS: [f64; 8] = [0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 1.4];
/// Lines of sight a row and a column.
const GRID: usize = 4;

/// Partners of each camera, computed when first needed.
#[derive(Debug)]
pub(super) struct Partners {
    /// Mean distance of the cameras from their middle [m].
    scale: f64,
    /// Ascending; empty until needed.
    of: Vec<Vec<usize>>,
    all: Vec<usize>,
}

impl Partners {
    pub fn new(cameras: &[Camera]) -> Self {
        let n = cameras.len().max(1) as f64;
        let middle = cameras.iter().map(|it| it.centre().coords).sum::<nalgebra::Vector3<f64>>() / n;
        let spread = cameras.iter().map(|it| (it.centre().coords - middle).norm()).sum::<f64>() / n;
        Self { scale: spread.max(1e-3), of: vec![Vec::new(); cameras.len()], all: (0..cameras.len()).collect() }
    }

    /// The partners of `camera`, ascending, itself among them; [`Self::look_up`] must have been called for it.
    pub fn of(&self, camera: CameraId) -> &[usize] {
        if self.all.len() <= MOST_PARTNERS { &self.all } else { &self.of[usize::from(camera.0)] }
    }

    /// Computes the partners of `camera`.
    pub fn look_up(&mut self, camera: CameraId, cameras: &[Camera]) {
        let own = usize::from(camera.0);
        if self.all.len() <= MOST_PARTNERS || !self.of[own].is_empty() {
            return;
        }
        let model = &cameras[own];
        let [width, height] = model.image_size.map(f64::from);
        let mut shared = vec![0_u32; cameras.len()];
        for place in 0..GRID * GRID {
            let (column, row) = ((place % GRID) as f64 + 0.5, (place / GRID) as f64 + 0.5);
            let pixel = Point2::new(width * column / GRID as f64, height * row / GRID as f64);
            let Some(ray) = model.ray(&pixel) else { continue };
            for depth in DEPTHS {
                let point = ray.at(depth * self.scale);
                for (count, other) in shared.iter_mut().zip(cameras) {
                    *count += u32::from(other.sees(&point).is_some());
                }
            }
        }
        shared[own] = u32::MAX;
        let mut partners: Vec<usize> = (0..cameras.len()).filter(|&it| shared[it] > 0).collect();
        partners.sort_by(|&a, &b| shared[b].cmp(&shared[a]).then(a.cmp(&b)));
        partners.truncate(MOST_PARTNERS);
        partners.sort_unstable();
        self.of[own] = partners;
    }
}
