//! The point on which most of several observations agree, robust to wrong observations.

use nalgebra::{Point2, Point3};

use crate::camera::Camera;
use crate::ray::{Ray, closest_approach};
use crate::triangulate::triangulate_rays;

/// A consensus point and its inliers.
#[derive(Debug, Clone, PartialEq)]
pub struct Agreement {
    /// The point closest to the rays of the inliers [m].
    pub point: Point3<f64>,
    /// By observation: whether it is within the limit.
    pub agreeing: Vec<bool>,
}

/// The point on which more than half of the `bearings`, at least two, agree within `limit_px`; candidates are the
/// points of all bearings and of each pair. `None` when there is none.
pub fn agreeing_point(bearings: &[(&Camera, Point2<f64>)], limit_px: f64) -> Option<Agreement> {
    let rays: Vec<Option<Ray>> = bearings.iter().map(|(camera, pixel)| camera.ray(pixel)).collect();
    let agreeing = |point: &Point3<f64>| -> Vec<bool> {
        let error = |(camera, pixel): &(&Camera, Point2<f64>)| camera.project(point).map(|seen| (seen - pixel).norm());
        bearings
            .iter()
            .zip(&rays)
            .map(|(it, ray)| ray.is_some() && error(it).is_some_and(|it| it <= limit_px))
            .collect()
    };
    let count = |list: &[bool]| list.iter().filter(|it| **it).count();
    let known: Vec<Ray> = rays.iter().flatten().copied().collect();
    let mut best: Option<Agreement> = None;
    let mut offer = |point: Point3<f64>| {
        let agreeing = agreeing(&point);
        let n = count(&agreeing);
        if 2 * n > known.len().max(2) && best.as_ref().is_none_or(|it| n > count(&it.agreeing)) {
            best = Some(Agreement { point, agreeing });
        }
        best.as_ref().map_or(0, |it| count(&it.agreeing))
    };
    let mut most = triangulate_rays(&known).map_or(0, &mut offer);
    'pairs: for (index, first) in known.iter().enumerate() {
        for second in &known[index + 1..] {
            if most == known.len() {
                break 'pairs;
            }
            if let Some(approach) = closest_approach(first, second) {
                most = offer(approach.midpoint);
            }
        }
    }
    let best = best?;
    let chosen: Vec<Ray> = rays.iter().zip(&best.agreeing).filter_map(|(ray, it)| ray.filter(|_| *it)).collect();
    match triangulate_rays(&chosen).map(|point| Agreement { point, agreeing: agreeing(&point) }) {
        Some(refined) if count(&refined.agreeing) >= chosen.len() => Some(refined),
        _ => Some(best),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Vector2, point};

    use super::*;

    fn room() -> [Camera; 5] {
        [(3.0, 0.0), (0.0, 3.0), (-3.0, 0.5), (0.5, -3.0), (2.0, 2.0)]
            .map(|(x, y)| Camera::look_at(point![x, y, 2.0], point![0.0, 0.0, 1.0], [640, 480], 500.0))
    }

    #[test]
    fn two_wrong_of_five_are_told_from_the_right() {
        let (cameras, light) = (room(), point![0.2, -0.3, 1.1]);
        let off =
            [Vector2::zeros(), Vector2::new(25.0, 4.0), Vector2::zeros(), Vector2::new(-3.0, 60.0), Vector2::zeros()];
        let bearings: Vec<_> =
            cameras.iter().zip(off).map(|(it, off)| (it, it.project(&light).unwrap() + off)).collect();
        let found = agreeing_point(&bearings, 1.0).unwrap();
        assert_eq!(found.agreeing, [true, false, true, false, true]);
        assert!((found.point - light).norm() < 1e-9);
    }

    #[test]
    fn half_is_no_majority_and_one_is_no_company() {
        let (cameras, lights) = (room(), [point![0.2, -0.3, 1.1], point![-0.8, 0.6, 0.4]]);
        let bearings: Vec<_> = (0..4).map(|it| (&cameras[it], cameras[it].project(&lights[it % 2]).unwrap())).collect();
        assert_eq!(agreeing_point(&bearings, 1.0), None);
        assert_eq!(agreeing_point(&bearings[..1], 1.0), None);
    }
}
