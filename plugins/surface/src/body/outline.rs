//! Borders of silhouettes as lines of sight that are tangent to the body [D'Apuzzo 1999 §4.1].
//!
//! A border lies between a pixel that is body and a neighbour that is not, where the confidence passes a half. Borders of the picture are none: the body goes on there.

use foveate::geometry::Camera;
use foveate::geometry::metaball::BodyObservation;
use foveate::prelude::*;
use nalgebra::{Point2, Point3, Unit, Vector3};

/// A line of sight.
#[derive(Debug, Clone, PartialEq)]
struct Sight {
    origin: Point3<f64>,
    direction: Unit<Vector3<f64>>,
    /// What one pixel is at a distance of one [–].
    pixel: f64,
}

/// Borders that one camera saw at one time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Outline {
    pub time: Time,
    pub camera: CameraId,
    sights: Vec<Sight>,
}

/// Silhouettes within this of a message's time are of its moment [s].
const SAME_MOMENT_S: f64 = 2e-3;

impl Outline {
    /// At most `n` of the lines through the borders of a silhouette, spread evenly over its rows.
    pub fn of(silhouette: &Silhouette, time: Time, camera: &Camera, n: usize) -> Outline {
        let mut outline = Outline { time, camera: silhouette.camera, sights: Vec::new() };
        if !silhouette.status.is_usable() {
            return outline;
        }
        let borders = borders(silhouette);
        let stride = borders.len().div_ceil(n.max(1)).max(1);
        let pixel = f64::from(silhouette.window.shrink.max(1)) / camera.intrinsics.focal[0];
        for border in borders.iter().step_by(stride) {
            if let Some(ray) = camera.ray(&silhouette.window.in_camera(border)) {
                outline.sights.push(Sight { origin: ray.origin, direction: ray.direction, pixel });
            }
        }
        outline
    }

    /// How many lines there are.
    pub fn len(&self) -> usize {
        self.sights.len()
    }

    /// Whether it is of the moment `time`.
    pub fn is_of(&self, time: Time) -> bool {
        (self.time - time).as_s().abs() <= SAME_MOMENT_S
    }

    /// As observations of a body about `centroid`: borders are known to `sigma_px`. Lines that pass farther than `reach_m` from all of `points` are of something else; `None`: all are the body's.
    pub fn observed<'a>(
        &'a self,
        centroid: &'a Vector3<f64>,
        sigma_px: f64,
        near: Option<(&'a [&'a TrackedPoint], f64)>,
    ) -> impl Iterator<Item = BodyObservation> + 'a {
        let passes = move |sight: &Sight| {
            near.is_none_or(|(points, reach_m)| {
                points.iter().any(|it| (it.position - sight.origin).cross(&sight.direction).norm() < reach_m)
            })
        };
        self.sights.iter().filter(move |it| passes(it)).map(move |it| BodyObservation::Ray {
            origin: it.origin,
            direction: it.direction,
            sigma_m: sigma_px * it.pixel * (centroid - it.origin.coords).norm(),
        })
    }
}

/// Where the confidence passes a half between neighbours of a row or a column, row by row [px of the silhouette].
fn borders(silhouette: &Silhouette) -> Vec<Point2<f64>> {
    let [width, height] = [silhouette.width, silhouette.height].map(|it| it as usize);
    let mut found = Vec::new();
    if silhouette.confidence.len() < width * height {
        return found;
    }
    let half = f64::from(Silhouette::BODY) - 0.5;
    for y in 0..height {
        for x in 0..width {
            let here = f64::from(silhouette.confidence[y * width + x]);
            for [right, down] in [[1, 0], [0, 1]] {
                if x + right >= width || y + down >= height {
                    continue;
                }
                let there = f64::from(silhouette.confidence[(y + down) * width + x + right]);
                if (here > half) != (there > half) {
                    let part = (half - here) / (there - here);
                    found.push(Point2::new(x as f64 + part * right as f64, y as f64 + part * down as f64));
                }
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_lie_where_the_confidence_passes_a_half_and_not_at_the_pictures_rim() {
        // Body in the two columns on the left; the second row is less sure.
        let confidence = vec![255, 255, 0, 255, 191, 64, 255, 255, 0];
        let silhouette = Silhouette { width: 3, height: 3, confidence, ..Silhouette::default() };
        let found = borders(&silhouette);
        assert_eq!(found.len(), 3);
        assert!(found.iter().all(|it| (it.x - 1.5).abs() < 1e-9), "{found:?}");
        assert_eq!(found.iter().map(|it| it.y).collect::<Vec<_>>(), [0.0, 1.0, 2.0]);
    }
}
