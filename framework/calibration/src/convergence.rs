//! Convergence from a poor start: alternating between path and cameras [Davis 2002 §3.2], compared with bundle adjustment.
//!
//! Both minimise the same cost, so both end in the same place; [Davis 2002, Fig. 25] shows the error on observations that the
//! cameras were not fitted to.

use foveate_estimation::Random;
use foveate_geometry::bundle::{BundleError, BundleOptions, Observation, adjust};
use foveate_geometry::{Camera, CameraStatus, Freedom, alternate, path_error};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::solved::{ObservationRole, Solved};

/// Root mean square error on independent observations, at the start and after each turn or step [px].
#[derive(Debug, Clone, PartialEq)]
pub struct Convergence {
    /// How far the start is off, in words.
    pub start: String,
    /// Of bundle adjustment.
    pub together: Vec<f64>,
    /// Of the alternating scheme.
    pub in_turn: Vec<f64>,
}

/// Options of [`convergence`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConvergenceOptions {
    /// Turns of the alternating scheme [–].
    pub turns: usize,
    /// Steps of the bundle adjustment at most [–].
    pub steps: u32,
    /// Cameras are turned by this much, root mean square [deg].
    pub off_deg: f64,
    /// And moved by this part of the room's size, root mean square [–].
    pub off_size: f64,
    /// Moments that are taken at most, evenly [–].
    pub max_moments: usize,
    /// Of the start.
    pub seed: u64,
}

impl Default for ConvergenceOptions {
    fn default() -> Self {
        Self { turns: 100, steps: 30, off_deg: 3.0, off_size: 0.03, max_moments: 600, seed: 1 }
    }
}

/// Both schemes from a start drawn at random around a solved camera network, on its own observations; the error is that on held-out moments.
/// Optics stay as they were found. `None` when nothing was held out, or no point can be intersected.
pub fn convergence(solved: &Solved, options: &ConvergenceOptions) -> Option<Convergence> {
    let members: Vec<usize> =
        (0..solved.cameras.len()).filter(|it| solved.cameras[*it].status == CameraStatus::Calibrated).collect();
    let truth: Vec<Camera> = members.iter().map(|it| solved.cameras[*it].camera.clone()).collect();
    let of_role = |role: ObservationRole| {
        let all = solved.observations.iter().filter(|it| it.role == role);
        let mut places: Vec<usize> = all.clone().filter_map(|it| it.point).collect();
        places.sort_unstable();
        places.dedup();
        let every = places.len().div_ceil(options.max_moments.max(1)).max(1);
        let places: Vec<usize> = places.into_iter().step_by(every).collect();
        let observation = |camera: usize, point: usize, pixel| {
            let (camera, point) = (members.binary_search(&camera).ok()?, places.binary_search(&point).ok()?);
            Some(Observation { camera, point, pixel, sigma_px: 0.5 })
        };
        all.filter_map(|it| observation(it.camera, it.point?, it.pixel)).collect::<Vec<_>>()
    };
    let (seen, independent) = (of_role(ObservationRole::Used), of_role(ObservationRole::HeldOut));
    let n = truth.len().max(1) as f64;
    let centroid = truth.iter().fold(Vector3::zeros(), |sum, it| sum + it.centre().coords / n);
    let size = (truth.iter().map(|it| (it.centre().coords - centroid).norm_squared()).sum::<f64>() / n).sqrt();
    let mut random = Random::new(options.seed).fork("convergence");
    let start = poor_start(&truth, options.off_deg, options.off_size * size, &mut random);
    let (together, in_turn) = side_by_side(&start, &seen, &independent, options.turns, options.steps).ok()?;
    let start = format!("{:.0}° and {:.0} % of the size of the room", options.off_deg, 100.0 * options.off_size);
    (!in_turn.is_empty()).then_some(Convergence { start, together, in_turn })
}

/// The cameras turned by `degrees` and moved by `distance` [m], root mean square.
pub fn poor_start(cameras: &[Camera], degrees: f64, distance: f64, random: &mut Random) -> Vec<Camera> {
    let mut moved = |it: &Camera| {
        let mut draw =
            |size: f64| Vector3::new(random.normal(), random.normal(), random.normal()) * (size / 3_f64.sqrt());
        let turn = UnitQuaternion::from_scaled_axis(draw(degrees.to_radians()));
        let centre = it.centre().coords + draw(distance);
        let rotation = turn * it.camera_from_world.rotation;
        let camera_from_world = Isometry3::from_parts(Translation3::from(-(rotation * centre)), rotation);
        Camera { camera_from_world, ..it.clone() }
    };
    cameras.iter().map(&mut moved).collect()
}

/// Errors on `independent` observations [px], together and in turn, before and after each step of the one and each turn of the other.
///
/// # Errors
/// Those of [`alternate`].
pub fn side_by_side(
    start: &[Camera],
    seen: &[Observation],
    independent: &[Observation],
    turns: usize,
    steps: u32,
) -> Result<(Vec<f64>, Vec<f64>), BundleError> {
    let in_turn = alternate(start, seen, independent, turns)?.independent_px;
    // The adjustment begins on the path that the start gives.
    let first = alternate(start, seen, independent, 0)?;
    let points: Vec<Point3<f64>> = first.points.iter().map(|it| it.unwrap_or_else(Point3::origin)).collect();
    let freedoms = vec![Freedom::POSE; start.len()];
    let mut together = first.independent_px;
    for max_iterations in 1..=steps {
        let options = BundleOptions { max_iterations, ..BundleOptions::default() };
        let found = adjust(start, &freedoms, &points, seen, &options)?;
        together.extend(path_error(&found.cameras, independent));
        if found.iterations < max_iterations {
            break;
        }
    }
    Ok((together, in_turn))
}

/// How many turns or steps it takes until the error stays within 1 % of the last one.
pub fn settled(errors_px: &[f64]) -> usize {
    let last = errors_px.last().copied().unwrap_or(f64::NAN);
    errors_px.iter().rposition(|it| *it > 1.01 * last).map_or(0, |it| it + 1)
}
