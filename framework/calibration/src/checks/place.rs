//! Checks of places: below the floor, or all in one plane.

use foveate_estimation::statistics::percentile;
use nalgebra::{Matrix3, Point3, Unit, Vector3};

use super::network::Room;
use super::{CheckOptions, Judgement, Level};
use crate::axes::KNOWN_PLACES;

/// Cameras whose pictures' upward direction has on average less of Z than this stand on their heads [–].
const ON_THEIR_HEADS: f64 = -0.3;

/// What lies below the floor, the plane Z = 0 where both vertical and origin are fixed. Where these come from points of known place, Z = 0 need not be
/// the floor, and only cameras that are upside down relative to it are reported.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Floor {
    /// Level and sentence.
    pub judgement: Judgement,
    /// Whether there is a floor.
    pub fixed: bool,
    /// Cameras under it.
    pub cameras_below: Vec<usize>,
    /// Height of the lowest camera [m].
    pub lowest_camera_m: Option<f64>,
    /// Height that 1 % of the path's points lie under [m].
    pub lowest_path_m: Option<f64>,
}

pub(super) fn floor(network: &Room<'_>) -> Floor {
    let fixed = &network.solved.fixed;
    if fixed.gravity.is_none() || fixed.origin.is_none() {
        let sentence = "Vertical or origin are not fixed: whether anything is below the floor is unknown.";
        return Floor { judgement: Judgement::new(Level::Good, sentence), ..Floor::default() };
    }
    let height = |camera: usize| network.solved.cameras[camera].camera.centre().z;
    let limit = -network.options.floor_tolerance_m;
    let cameras_below: Vec<usize> = network.calibrated().filter(|it| height(*it) < limit).collect();
    let lowest_camera_m = network.calibrated().map(height).min_by(f64::total_cmp);
    let heights: Vec<f64> = network.solved.points.iter().map(|it| it.position.z).collect();
    let lowest_path_m = percentile(&heights, 1.0);
    let path_is_below = lowest_path_m.is_some_and(|it| it < limit);
    let most_is_below = percentile(&heights, 50.0).is_some_and(|it| it < limit)
        || 2 * cameras_below.len() > network.calibrated().count();
    let is_frame = fixed.origin.as_ref().is_some_and(|it| it.by.contains(KNOWN_PLACES));
    let judgement = if is_frame && !(most_is_below && are_on_their_heads(network)) {
        let sentence = "Z = 0 is set by the points of known place, whether or not that is the floor.";
        return Floor {
            judgement: Judgement::new(Level::Good, sentence),
            lowest_camera_m,
            lowest_path_m,
            ..Floor::default()
        };
    } else if most_is_below {
        let sentence =
            "Most of the room is below the floor: the solution is upside down or mirrored; fix the vertical again.";
        Judgement::new(Level::Redo, sentence)
    } else if let Some(camera) = cameras_below.first() {
        let sentence = format!(
            "Camera {} is {:.2} m below the floor: its pose is mirrored, or the origin is not on the floor; calibrate it again.",
            network.name(*camera),
            -height(*camera)
        );
        Judgement::new(Level::Redo, sentence)
    } else if path_is_below {
        let depth = -lowest_path_m.unwrap_or(0.0);
        let sentence = format!(
            "The path goes {depth:.2} m below the floor: fix vertical and origin again with marks on the floor."
        );
        Judgement::new(Level::Usable, sentence)
    } else {
        Judgement::new(Level::Good, "Nothing is below the floor.")
    };
    Floor { judgement, fixed: true, cameras_below, lowest_camera_m, lowest_path_m }
}

/// Whether the cameras see the world's Z point down in their pictures.
fn are_on_their_heads(network: &Room<'_>) -> bool {
    let up = |camera: usize| -(network.solved.cameras[camera].camera.camera_from_world.rotation * Vector3::z()).y;
    let (sum, n) = network.calibrated().map(up).fold((0.0, 0.0), |(sum, n), it| (sum + it, n + 1.0));
    n > 0.0 && sum / n < ON_THEIR_HEADS
}

/// How the path of the light fills space.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PathShape {
    /// Level and sentence.
    pub judgement: Judgement,
    /// Points [–].
    pub points: usize,
    /// Standard deviations along the principal axes, the longest first [m or units].
    pub spread: [f64; 3],
    /// The last over the first; near 0 for a path in a plane [–].
    pub flatness: f64,
}

/// Focal lengths whose standard deviation is a smaller part of them are known well enough [–].
const HELD_FOCAL: f64 = 0.01;

pub(super) fn path(network: &Room<'_>) -> PathShape {
    let positions = network.positions();
    let Some(plane) = Plane::through(&positions) else {
        let sentence = "Fewer than three places of the light are known: wave it through the whole volume.";
        return PathShape { judgement: Judgement::new(Level::Redo, sentence), ..PathShape::default() };
    };
    let flatness = plane.spread[2] / plane.spread[0];
    let [good, usable] = network.options.flatness;
    // Several cameras around a plane tell their focal lengths after all.
    let open = network.calibrated().map(|it| &network.solved.cameras[it]).any(|it| {
        let sigma = it.covariance.as_ref().map_or(f64::INFINITY, |it| it.optics.focal);
        it.freed.focal && sigma > HELD_FOCAL
    });
    let level = match CheckOptions::level(-flatness, [-good, -usable]) {
        Level::Redo if !open => Level::Usable, // known optics need no third dimension; the mirrored twin is checked elsewhere
        level => level,
    };
    let percent = 100.0 * flatness;
    let sentence = match level {
        Level::Good if good <= 0.0 => format!("How thick the path is does not matter ({percent:.0} % of its length)."),
        Level::Good => format!("The path fills space: {percent:.0} % as thick as it is long."),
        Level::Usable => {
            format!("The path is nearly flat ({percent:.1} % as thick as long): wave up and down as well.")
        }
        Level::Redo => format!(
            "The path lies in a plane ({percent:.1} % as thick as long), which leaves focal lengths open: wave up and down as well."
        ),
    };
    PathShape { judgement: Judgement::new(level, sentence), points: positions.len(), spread: plane.spread, flatness }
}

/// The plane that lies best in a set of points.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    pub centroid: Point3<f64>,
    pub normal: Unit<Vector3<f64>>,
    /// Standard deviations along the principal axes, the longest first.
    pub spread: [f64; 3],
}

impl Plane {
    /// `None` for fewer than three points, or points that are all in one place.
    pub(super) fn through(points: &[Point3<f64>]) -> Option<Plane> {
        let n = points.len() as f64;
        let centroid = Point3::from(points.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords) / n);
        let mut scatter = Matrix3::zeros();
        for point in points {
            scatter += (point - centroid) * (point - centroid).transpose() / n;
        }
        if points.len() < 3 || !(scatter.trace() > 0.0 && scatter.trace().is_finite()) {
            return None;
        }
        let eigen = scatter.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let normal = Unit::new_normalize(eigen.eigenvectors.column(order[2]).into_owned());
        Some(Plane { centroid, normal, spread: order.map(|it| eigen.eigenvalues[it].max(0.0).sqrt()) })
    }
}

#[cfg(test)]
mod tests {
    use foveate_geometry::{Camera, CameraStatus, Freedom};
    use foveate_scene::uncertainty::Fixed;

    use super::*;
    use crate::solved::{FixedFreedoms, Solved, SolvedCamera, SolvedPoint};

    /// Four cameras 2 m over a light at 1 m, in a world whose Z = 0 is `floor_m` above the floor; on its head if asked for.
    fn judged(by: &str, floor_m: f64, upside_down: bool) -> Level {
        let sign = if upside_down { -1.0 } else { 1.0 };
        let camera = |index: usize| {
            let angle = 1.5 * index as f64;
            let centre = Point3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 2.0);
            let mut camera = Camera::look_at(centre, Point3::new(0.0, 0.0, 1.0), [640, 480], 500.0);
            if upside_down {
                camera.camera_from_world *=
                    nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
            }
            camera.camera_from_world *= nalgebra::Translation3::new(0.0, 0.0, floor_m);
            let name = format!("wide-{index}");
            let status = CameraStatus::Calibrated;
            SolvedCamera { name, camera, status, freed: Freedom::POSE, prior: None, covariance: None, clock: None }
        };
        let point = |frame: usize| {
            let position = Point3::new(0.0, 0.1 * frame as f64, sign * (1.0 + 0.1 * (frame % 5) as f64) - floor_m);
            SolvedPoint { frame, time_s: frame as f64, label: 0, position }
        };
        let fixed = Some(Fixed { by: by.to_owned(), sigma: None });
        let solved = Solved {
            cameras: (0..4).map(camera).collect(),
            points: (0..20).map(point).collect(),
            fixed: FixedFreedoms { scale: fixed.clone(), gravity: fixed.clone(), origin: fixed },
            ..Solved::default()
        };
        floor(&Room::new(&solved, &CheckOptions::default())).judgement.level
    }

    #[test]
    fn a_frame_whose_floor_is_not_at_zero_is_not_upside_down() {
        let frame = format!("3 {KNOWN_PLACES}");
        for floor_m in [0.0, 1.2, 3.0, 430.0, -100.0] {
            assert_eq!(judged(&frame, floor_m, false), Level::Good, "{floor_m}");
        }
        // A sign that was mistaken still is.
        assert_eq!(judged(&frame, 0.0, true), Level::Redo);
        assert_eq!(judged("3 places on the floor", 0.0, false), Level::Good);
        assert_eq!(judged("3 places on the floor", 3.0, false), Level::Redo);
        assert_eq!(judged("3 places on the floor", 0.0, true), Level::Redo);
    }
}
