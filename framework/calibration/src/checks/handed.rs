//! Whether the world is mirrored: points behind cameras, and the reversed world.
//!
//! From afar a picture shows a scene and its reversal alike: reflect all points in a plane, p' = D p, and turn each camera accordingly,
//! R' = D R D, t' = t, with D = diag(1, 1, −1) in the axes of the plane and of each camera; only perspective tells them apart (J. Koenderink
//! and A. van Doorn, "Affine structure from motion", 1991). A planar path is its own reflection, so that there each camera may be
//! reversed by itself: the two poses of a square seen from afar (T. Collins and A. Bartoli, "Infinitesimal plane-based pose
//! estimation", 2014). Both twins are adjusted and compared with the room as it is.

use foveate_geometry::bundle::{BundleOptions, Observation, adjust};
use foveate_geometry::{AlignmentOptions, Camera, Freedom, ResectionOptions, align, refine_pose};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::network::Room;
use super::place::Plane;
use super::{CheckOptions, Judgement, Level};
use crate::solved::ObservationRole;

/// Points that are enough to compare two worlds.
const ENOUGH_POINTS: usize = 300;
/// Observations that the reversed world may not see at all, as a share, before it is out of the question.
const UNSEEN: f64 = 0.1;
/// Poses of one camera that are closer than this are one [rad].
const SAME_POSE: f64 = 0.05;

/// Whether the world is mirrored.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Handedness {
    /// Level and sentence.
    pub judgement: Judgement,
    /// Observations in use whose point is behind its camera [–].
    pub behind: usize,
    /// R.m.s. residual of the reversed world over that of the room; `None` when there is no such minimum [–].
    pub reversed_ratio: Option<f64>,
    /// The camera whose own reversal fits best beside its pose, and how much worse that is, as a ratio of r.m.s. residuals; below 1
    /// it fits better than the pose [–].
    pub closest_camera: Option<(usize, f64)>,
}

pub(super) fn handedness(network: &Room<'_>) -> Handedness {
    let observations = &network.solved.observations;
    let is_behind = |index: &&usize| {
        let it = &observations[**index];
        let camera = &network.solved.cameras[it.camera].camera;
        it.point.is_some_and(|point| (camera.camera_from_world * network.solved.points[point].position).z <= 0.0)
    };
    let in_use = || network.of_point.iter().flatten();
    let behind = in_use().filter(is_behind).count();
    let reversed_ratio = reversed_room(network);
    let each = network.calibrated().filter_map(|it| Some((it, reversed_camera(network, it)?)));
    let closest_camera = each.min_by(|a, b| a.1.total_cmp(&b.1));
    let [good, usable] = network.options.reversed_ratio;
    let of = |ratio: Option<f64>| ratio.map_or(Level::Good, |it| CheckOptions::level(-it, [-good, -usable]));
    let room_level = of(reversed_ratio);
    let camera_level = of(closest_camera.map(|it| it.1));
    let judgement = if behind * 2 > in_use().count() {
        Judgement::new(
            Level::Redo,
            "The light is behind the cameras: the solution is mirrored; record again, with more depth.",
        )
    } else if room_level == Level::Redo {
        let ratio = reversed_ratio.unwrap_or(f64::NAN);
        let which = if ratio < 1.0 { "better than" } else { "nearly as well as" };
        let sentence = format!(
            "The mirrored solution fits {which} this one ({ratio:.2} times its residuals): wave with more depth, nearer to the cameras, and calibrate again."
        );
        Judgement::new(Level::Redo, sentence)
    } else if let Some((camera, ratio)) = closest_camera.filter(|_| camera_level == Level::Redo) {
        let name = network.name(camera);
        let sentence = if ratio < 1.0 {
            format!(
                "Camera {name} is flipped about the plane of the path (the flipped pose has {ratio:.2} times its residuals): wave out of that plane and calibrate again."
            )
        } else {
            format!(
                "Camera {name} may be flipped about the plane of the path (the flipped pose has {ratio:.2} times its residuals): wave out of that plane."
            )
        };
        Judgement::new(Level::Redo, sentence)
    } else if room_level.max(camera_level) == Level::Usable {
        let camera =
            closest_camera.map_or(String::new(), |it| format!(", above all in front of camera {}", network.name(it.0)));
        let sentence = format!("The mirrored solution fits only a little worse: wave with more depth{camera}.");
        Judgement::new(Level::Usable, sentence)
    } else {
        Judgement::new(Level::Good, "The mirrored solution fits clearly worse.")
    };
    Handedness { judgement, behind, reversed_ratio, closest_camera }
}

/// R.m.s. residual of the adjusted reversed room over that of the room.
fn reversed_room(network: &Room<'_>) -> Option<f64> {
    let shared: Vec<usize> = (0..network.of_point.len()).filter(|it| network.of_point[*it].len() > 1).collect();
    let chosen: Vec<usize> = shared.iter().copied().step_by(shared.len().div_ceil(ENOUGH_POINTS).max(1)).collect();
    let points: Vec<Point3<f64>> = chosen.iter().map(|it| network.solved.points[*it].position).collect();
    let mut observations = Vec::new();
    for (place, &point) in chosen.iter().enumerate() {
        observations.extend(network.of_point[point].iter().map(|&it| {
            let seen = &network.solved.observations[it];
            Observation { camera: seen.camera, point: place, pixel: seen.pixel, sigma_px: network.sigma_px }
        }));
    }
    let plane = Plane::through(&points)?;
    let (cameras, mut freedoms) = (network.cameras(), vec![Freedom::NONE; network.solved.cameras.len()]);
    network.calibrated().for_each(|it| freedoms[it] = Freedom::POSE);
    let reflected: Vec<Point3<f64>> = points.iter().map(|it| reflection(&plane, it)).collect();
    let turned: Vec<Camera> = cameras.iter().map(|it| reversed(it, &plane)).collect();
    let options = BundleOptions { max_iterations: 60, ..BundleOptions::default() };
    let now = adjust(&cameras, &freedoms, &points, &observations, &options).ok()?;
    let then = adjust(&turned, &freedoms, &reflected, &observations, &options).ok()?;
    if then.left_out.len() as f64 > UNSEEN * observations.len() as f64 {
        return None;
    }
    // The adjustment may have found its way back: then there is no reversed minimum.
    let scene = |cameras: &[Camera], points: &[Point3<f64>]| -> Vec<Point3<f64>> {
        network.calibrated().map(|it| cameras[it].centre()).chain(points.iter().copied()).collect()
    };
    let options = AlignmentOptions { scale: true, robust: false };
    let found = scene(&then.cameras, &then.points);
    let apart = |other: &[Point3<f64>]| align(&found, other, options).map_or(f64::INFINITY, |it| it.rms);
    let came_back = apart(&scene(&now.cameras, &now.points)) < apart(&scene(&turned, &reflected));
    (!came_back).then(|| then.rms_px / now.rms_px.max(0.1 * network.sigma_px))
}

/// R.m.s. residual of the camera's reversal about the plane of its points, which stay, over that of its pose.
fn reversed_camera(network: &Room<'_>, camera: usize) -> Option<f64> {
    let points = network.points_of(camera);
    let used = network.of_camera[camera].iter().map(|it| &network.solved.observations[*it]);
    let pixels: Vec<_> = used.filter(|it| it.role == ObservationRole::Used).map(|it| it.pixel).collect();
    let plane = Plane::through(&points)?;
    let model = &network.solved.cameras[camera].camera;
    let options = ResectionOptions { sigma_px: network.sigma_px, inlier_px: 6.0 * network.sigma_px, trials: 1 };
    let now = refine_pose(model, &points, &pixels, &options).ok()?;
    let options = ResectionOptions { inlier_px: 1e3 * network.sigma_px, ..options };
    let then = refine_pose(&reversed(model, &plane), &points, &pixels, &options).ok()?;
    let turned = then.camera_from_world.rotation.angle_to(&now.camera_from_world.rotation);
    if turned < SAME_POSE {
        return None;
    }
    let given = refine_distance(model, &points, &pixels);
    let best = now.residuals_rms_px.min(given).max(0.1 * network.sigma_px);
    Some(then.residuals_rms_px / best)
}

/// R.m.s. distance of what `camera` should see from what it saw [px].
fn refine_distance(camera: &Camera, points: &[Point3<f64>], pixels: &[nalgebra::Point2<f64>]) -> f64 {
    let squares =
        points.iter().zip(pixels).filter_map(|(point, pixel)| Some((camera.project(point)? - pixel).norm_squared()));
    let (sum, count) = squares.fold((0.0, 0.0), |(sum, count), it| (sum + it, count + 1.0));
    if count > 0.0 { f64::sqrt(sum / count) } else { f64::INFINITY }
}

fn reflection(plane: &Plane, point: &Point3<f64>) -> Point3<f64> {
    point - plane.normal.into_inner() * (2.0 * plane.normal.dot(&(point - plane.centroid)))
}

/// The camera that sees the reflected scene as `camera` sees the scene, but for perspective.
fn reversed(camera: &Camera, plane: &Plane) -> Camera {
    let normal = plane.normal.into_inner();
    let reflection = Matrix3::identity() - normal * normal.transpose() * 2.0;
    let depth = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    let rotation = depth * camera.camera_from_world.rotation.to_rotation_matrix().matrix() * reflection;
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let centroid_in_camera = camera.camera_from_world * plane.centroid;
    let shift = Translation3::from(centroid_in_camera.coords - turn * plane.centroid.coords);
    Camera { camera_from_world: Isometry3::from_parts(shift, turn), ..camera.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn from_afar_the_reversed_room_looks_the_same() {
        let camera =
            Camera::look_at(Point3::new(300.0, -400.0, 250.0), Point3::new(0.0, 0.0, 1.0), [640, 480], 60_000.0);
        let points = [[1.0, 0.2, 0.7], [-0.6, 0.9, 1.6], [0.1, -1.1, 1.1], [-0.9, -0.4, 0.9], [0.4, 0.4, 1.0]];
        let points = points.map(Point3::from);
        let plane = Plane::through(&points).unwrap();
        let twin = reversed(&camera, &plane);
        assert!(twin.check().is_ok());
        for point in points {
            let (here, there) = (camera.project(&point).unwrap(), twin.project(&reflection(&plane, &point)).unwrap());
            // What is left is perspective: 1 m of depth at 560 m.
            assert!(
                (here - there).norm() < 0.005 * (here - nalgebra::Point2::new(319.5, 239.5)).norm() + 0.3,
                "{here} {there}"
            );
        }
        assert!((twin.centre() - camera.centre()).norm() > 100.0);
    }
}
