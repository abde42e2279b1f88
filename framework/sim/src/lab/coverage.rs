//! How many cameras see each point of a volume.

use foveate_geometry::Camera;
use nalgebra::Point3;

/// How many cameras see the points of a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Coverage {
    /// Cameras at the point that the fewest see.
    pub fewest: usize,
    /// That point [m].
    pub worst: Point3<f64>,
    /// Cameras at the point that the most see.
    pub most: usize,
    /// Mean over the points.
    pub mean: f64,
    /// How many points were looked at.
    pub n_points: usize,
}

/// Looks at a grid over `volume_m` (opposite corners, included), at most `spacing_m` apart; nothing occludes.
pub fn coverage(cameras: &[Camera], volume_m: [[f64; 3]; 2], spacing_m: f64) -> Coverage {
    let mut found = Coverage { fewest: usize::MAX, worst: Point3::origin(), most: 0, mean: 0.0, n_points: 0 };
    let mut sum = 0;
    for point in grid(volume_m, spacing_m) {
        let seen = cameras.iter().filter(|camera| camera.sees(&point).is_some()).count();
        if seen < found.fewest {
            (found.fewest, found.worst) = (seen, point);
        }
        found.most = found.most.max(seen);
        found.n_points += 1;
        sum += seen;
    }
    found.mean = sum as f64 / found.n_points as f64;
    found
}

/// Points on a grid over a box, its corners included.
fn grid(volume_m: [[f64; 3]; 2], spacing_m: f64) -> impl Iterator<Item = Point3<f64>> {
    let [min, max] = volume_m;
    let steps = [0, 1, 2].map(|axis| ((max[axis] - min[axis]) / spacing_m).ceil().max(1.0) as usize);
    let at = move |axis: usize, i: usize| min[axis] + (max[axis] - min[axis]) * i as f64 / steps[axis] as f64;
    (0..=steps[0]).flat_map(move |i| {
        (0..=steps[1]).flat_map(move |j| (0..=steps[2]).map(move |k| Point3::new(at(0, i), at(1, j), at(2, k))))
    })
}
