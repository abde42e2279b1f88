//! Where in the room the light has been, once the cameras' poses are known.

use foveate_geometry::{Camera, Ray, closest_approach};
use foveate_scene::WorkingVolume;
use nalgebra::{Point2, Point3, Vector3};

use super::camera::CameraCoverage;

/// Lines of sight that pass each other by more than this part of the distance are not of one light.
const MAX_GAP: f64 = 0.05;
/// Sine of the angle between lines of sight below which they tell no depth.
const MIN_SINE: f64 = 0.05;

#[derive(Debug, Clone, PartialEq)]
pub(super) struct VolumeCoverage {
    cameras: Vec<Option<Camera>>,
    volume: WorkingVolume,
    cells: [usize; 3],
    /// x fastest, z slowest.
    visited: Vec<bool>,
    /// Whether two cameras see the middle of the cell.
    reachable: Vec<bool>,
    /// By camera: nearest and farthest.
    depths: Vec<Option<[f64; 2]>>,
}

impl VolumeCoverage {
    pub(super) fn new(cameras: &[Option<Camera>], volume: WorkingVolume, cells: [usize; 3]) -> Self {
        let cells = cells.map(|it| it.max(1));
        let n: usize = cells.iter().product();
        let mut new = Self {
            cameras: cameras.to_vec(),
            volume,
            cells,
            visited: vec![false; n],
            reachable: Vec::new(),
            depths: vec![None; cameras.len()],
        };
        let seen_by = |place: &Point3<f64>| cameras.iter().flatten().filter(|it| it.sees(place).is_some()).count();
        new.reachable = (0..n).map(|it| seen_by(&new.middle(it)) >= 2).collect();
        new
    }

    pub(super) fn ray(&self, camera: usize, pixel: &Point2<f64>) -> Option<Ray> {
        self.cameras.get(camera)?.as_ref()?.ray(pixel)
    }

    /// Enters where the light is that `camera` just saw, by the other camera that sees it most nearly from the side.
    pub(super) fn observe(&mut self, camera: usize, cameras: &[CameraCoverage], tolerance_s: f64) {
        let seen = &cameras[camera].last;
        let Some(ray) = seen.ray else { return };
        let mut best: Option<(f64, usize, Ray)> = None;
        for (other, theirs) in cameras.iter().map(|it| &it.last).enumerate() {
            let Some(their_ray) = theirs.ray else { continue };
            if other == camera || (theirs.time_s - seen.time_s).abs() > tolerance_s {
                continue;
            }
            let sine = ray.direction.cross(&their_ray.direction).norm();
            if sine > best.map_or(MIN_SINE, |it| it.0) {
                best = Some((sine, other, their_ray));
            }
        }
        let Some((_, other, their_ray)) = best else { return };
        let Some(approach) = closest_approach(&ray, &their_ray) else { return };
        let depths = [(camera, approach.depth_a), (other, approach.depth_b)];
        let nearest = approach.depth_a.min(approach.depth_b);
        if !(nearest > 0.0 && approach.gap <= MAX_GAP * nearest) {
            return;
        }
        for (camera, depth) in depths {
            if let Some(known) = self.depths.get_mut(camera) {
                let [near, far] = known.unwrap_or([depth; 2]);
                *known = Some([near.min(depth), far.max(depth)]);
            }
        }
        if self.volume.contains(&approach.midpoint) {
            let size = self.volume.max - self.volume.min;
            let part = (approach.midpoint - self.volume.min).component_div(&size);
            let [x, y, z] = [0, 1, 2].map(|it| ((part[it] * self.cells[it] as f64) as usize).min(self.cells[it] - 1));
            self.visited[(z * self.cells[1] + y) * self.cells[0] + x] = true;
        }
    }

    fn middle(&self, cell: usize) -> Point3<f64> {
        let [columns, rows, layers] = self.cells;
        let index = Vector3::new(cell % columns, cell / columns % rows, cell / (columns * rows));
        let part =
            index.map(|it| it as f64 + 0.5).component_div(&Vector3::new(columns as f64, rows as f64, layers as f64));
        self.volume.min + part.component_mul(&(self.volume.max - self.volume.min))
    }

    pub(super) fn share(&self) -> Option<f64> {
        let reachable = self.reachable.iter().filter(|it| **it).count();
        let visited = self.reachable.iter().zip(&self.visited).filter(|(reachable, visited)| **reachable && **visited);
        (reachable > 0).then(|| visited.count() as f64 / reachable as f64)
    }

    pub(super) fn depth(&self, camera: usize) -> Option<[f64; 2]> {
        *self.depths.get(camera)?
    }

    /// The place farthest from where the light has been; `None` when it has been everywhere that can be reached.
    pub(super) fn emptiest(&self) -> Option<Point3<f64>> {
        let cells = |which: &dyn Fn(usize) -> bool| -> Vec<Point3<f64>> {
            (0..self.visited.len()).filter(|it| which(*it)).map(|it| self.middle(it)).collect()
        };
        let visited = cells(&|it| self.visited[it]);
        let away =
            |place: &Point3<f64>| visited.iter().map(|it| (it - place).norm_squared()).fold(f64::INFINITY, f64::min);
        let empty = cells(&|it| self.reachable[it] && !self.visited[it]);
        let mut farthest: Option<(f64, Point3<f64>)> = None;
        for place in empty {
            let away = away(&place);
            if farthest.is_none_or(|it| away > it.0) {
                farthest = Some((away, place));
            }
        }
        farthest.map(|it| it.1)
    }
}
