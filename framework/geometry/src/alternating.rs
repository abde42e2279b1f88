//! Calibration from a virtual object by alternation, as first published: path and cameras in turn, each with the other held.
//!
//! [Davis 2002 §3.2] and X. Chen and J. Davis, "Wide area camera calibration using virtual calibration objects", CVPR
//! 2000: poor cameras give a poor path, the path better cameras, and so on. Each half step lowers the same cost that
//! [`crate::bundle`] minimises over both together, so both end in the same minimum; but moves that path and cameras
//! can only make together take many small rounds. This module is for comparison (Figure 25); use
//! [`crate::self_calibration`] to calibrate.
//!
//! A round intersects each point from the cameras and refines it on its pixels, then refines each camera's pose on all
//! its points under Cauchy's loss, whose scale is the median error of that camera's own pixels: with a fixed scale a
//! poor path would make every pixel an outlier. The optics are known. The gauge (place, rotation and size of the
//! whole) is free; pixel errors do not depend on it.

use foveate_estimation::statistics::median;
use nalgebra::{Point2, Point3};

use crate::bundle::{BundleError, BundleOptions, Observation, check};
use crate::camera::Camera;
use crate::ray::Ray;
use crate::resection::{ResectionOptions, refine_pose};
use crate::triangulate::{PixelNoise, refine, triangulate_rays};

/// Median length of an error in the plane over the standard deviation of a coordinate: √(2 ln 2).
const MEDIAN_PER_SIGMA: f64 = 1.177_410_022_515_474_7;

/// The result of [`alternate`].
#[derive(Debug, Clone, PartialEq)]
pub struct Alternated {
    /// The cameras, in the order given.
    pub cameras: Vec<Camera>,
    /// The path, in the order of the points; `None` where fewer than two cameras see the point.
    pub points: Vec<Option<Point3<f64>>>,
    /// [`path_error`] of the given cameras, then after each round [px].
    pub rms_px: Vec<f64>,
    /// The same on observations that the cameras were not fitted to, as in Figure 25; empty when there are none [px].
    pub independent_px: Vec<f64>,
}

/// Runs `turns` rounds from `cameras` on `observations`, and evaluates each on `independent` observations too, whose points are their own.
///
/// # Errors
/// As [`crate::bundle::adjust`]: bad cameras or observations; [`BundleError::NothingShared`] when no point can be intersected.
pub fn alternate(
    cameras: &[Camera],
    observations: &[Observation],
    independent: &[Observation],
    turns: usize,
) -> Result<Alternated, BundleError> {
    for list in [observations, independent] {
        check(cameras, cameras.len(), &vec![Point3::origin(); n_points(list)], list, &BundleOptions::default())?;
    }
    let mut cameras = cameras.to_vec();
    let nothing = BundleError::NothingShared { observations: observations.len() };
    let mut points = path(&cameras, observations);
    let mut rms_px = vec![error_of(&cameras, &points, observations).ok_or(nothing)?];
    let mut independent_px: Vec<f64> = path_error(&cameras, independent).into_iter().collect();
    for _ in 0..turns {
        for (index, camera) in cameras.iter_mut().enumerate() {
            turn(index, camera, &points, observations);
        }
        points = path(&cameras, observations);
        rms_px.extend(error_of(&cameras, &points, observations));
        independent_px.extend(path_error(&cameras, independent));
    }
    Ok(Alternated { cameras, points, rms_px, independent_px })
}

/// Root mean square residual when each point is put where the given `cameras` see it best [px]; `None` when no point
/// can be intersected. Points seen by one camera do not count.
pub fn path_error(cameras: &[Camera], observations: &[Observation]) -> Option<f64> {
    error_of(cameras, &path(cameras, observations), observations)
}

fn n_points(observations: &[Observation]) -> usize {
    observations.iter().map(|it| it.point + 1).max().unwrap_or(0)
}

/// Each point from its pixels, the cameras known.
fn path(cameras: &[Camera], observations: &[Observation]) -> Vec<Option<Point3<f64>>> {
    let mut seen: Vec<Vec<&Observation>> = vec![Vec::new(); n_points(observations)];
    observations.iter().for_each(|it| seen[it.point].push(it));
    let place = |seen: &Vec<&Observation>| {
        let rays: Vec<Ray> = seen.iter().filter_map(|it| cameras[it.camera].ray(&it.pixel)).collect();
        let start = triangulate_rays(&rays)?;
        let of: Vec<&Camera> = seen.iter().map(|it| &cameras[it.camera]).collect();
        let pixels: Vec<Point2<f64>> = seen.iter().map(|it| it.pixel).collect();
        // Lines of sight that are far from meeting may give a place behind a camera, which is kept as it is.
        Some(refine(&of, &pixels, PixelNoise::Sigma(seen[0].sigma_px), start).map_or(start, |it| it.position))
    };
    seen.iter().map(place).collect()
}

/// Refines a camera's pose on the path; left as it is when that gives no better one.
fn turn(index: usize, camera: &mut Camera, points: &[Option<Point3<f64>>], observations: &[Observation]) {
    let own = observations.iter().filter(|it| it.camera == index);
    let (places, pixels): (Vec<_>, Vec<_>) = own.filter_map(|it| Some((points[it.point]?, it.pixel))).unzip();
    let error = |(place, pixel): (&Point3<f64>, &Point2<f64>)| Some((camera.project(place)? - pixel).norm());
    let errors: Vec<f64> = places.iter().zip(&pixels).filter_map(error).collect();
    let Some(middle) = median(&errors).filter(|it| *it > 0.0) else { return };
    let sigma_px = middle / MEDIAN_PER_SIGMA;
    let options = ResectionOptions { sigma_px, inlier_px: 6.0 * sigma_px, ..ResectionOptions::default() };
    if let Ok(found) = refine_pose(camera, &places, &pixels, &options) {
        camera.camera_from_world = found.camera_from_world;
    }
}

fn error_of(cameras: &[Camera], points: &[Option<Point3<f64>>], observations: &[Observation]) -> Option<f64> {
    let square = |it: &Observation| {
        Some((cameras[it.camera].project(&points.get(it.point).copied()??)? - it.pixel).norm_squared())
    };
    let squares: Vec<f64> = observations.iter().filter_map(square).collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use foveate_estimation::Random;
    use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

    use super::*;
    use crate::bundle::{Freedom, adjust};
    use crate::test_room;

    /// Cameras that are known to some degrees and decimetres.
    fn guessed(truth: &[Camera], seed: u64) -> Vec<Camera> {
        let mut random = Random::new(seed);
        let mut draw = |size: f64| Vector3::new(random.normal(), random.normal(), random.normal()) * size;
        let moved = |it: &Camera| {
            let off =
                Isometry3::from_parts(Translation3::from(draw(0.1)), UnitQuaternion::from_scaled_axis(draw(0.05)));
            Camera { camera_from_world: off * it.camera_from_world, ..it.clone() }
        };
        truth.iter().map(moved).collect()
    }

    #[test]
    fn turns_lead_to_where_bundle_adjustment_ends() {
        let truth = test_room::cameras(6, 3);
        let path = test_room::path(150);
        let seen = test_room::observations(&truth, &path, 6, 0.5, &mut Random::new(4));
        let independent = test_room::observations(&truth, &path, 6, 0.5, &mut Random::new(5));
        let start = guessed(&truth, 6);
        let found = alternate(&start, &seen, &independent, 60).unwrap();
        assert_eq!((found.rms_px.len(), found.independent_px.len()), (61, 61));
        assert!(found.rms_px.windows(2).all(|it| it[1] < it[0] * 1.01), "{:?}", found.rms_px);
        let points: Vec<Point3<f64>> = found.points.iter().map(|it| it.unwrap()).collect();
        let best = adjust(&found.cameras, &[Freedom::POSE; 6], &points, &seen, &BundleOptions::default()).unwrap();
        let last = *found.rms_px.last().unwrap();
        assert!(found.rms_px[0] > 20.0 && last < 1.05 * best.rms_px, "{} {last} {}", found.rms_px[0], best.rms_px);
        let independent_px = *found.independent_px.last().unwrap();
        assert!((independent_px / last - 1.0).abs() < 0.15, "{independent_px} {last}");
    }

    #[test]
    fn wrong_pixels_do_not_pull_the_cameras() {
        let truth = test_room::cameras(6, 3);
        let path = test_room::path(150);
        let right = test_room::observations(&truth, &path, 6, 0.5, &mut Random::new(4));
        let mut seen = right.clone();
        seen.iter_mut().step_by(19).for_each(|it| it.pixel = Point2::new(it.pixel.y, it.pixel.x));
        let found = alternate(&guessed(&truth, 6), &seen, &right, 60).unwrap();
        assert!(*found.independent_px.last().unwrap() < 3.0, "{:?}", found.independent_px.last());
    }

    #[test]
    fn what_cannot_be_intersected_is_refused() {
        let truth = test_room::cameras(2, 3);
        let alone = [Observation { camera: 0, point: 0, pixel: Point2::new(3.0, 4.0), sigma_px: 0.5 }];
        assert_eq!(alternate(&truth, &alone, &[], 3).unwrap_err(), BundleError::NothingShared { observations: 1 });
        let unknown_camera = [Observation { camera: 2, ..alone[0] }];
        assert!(matches!(
            alternate(&truth, &unknown_camera, &[], 3),
            Err(BundleError::BadObservation { camera: 2, .. })
        ));
        assert!(matches!(alternate(&truth, &alone, &unknown_camera, 3), Err(BundleError::BadObservation { .. })));
    }
}
