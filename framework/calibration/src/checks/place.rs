//! Where things are: under the floor, or all in one plane.

use foveate_estimation::statistics::percentile;
use nalgebra::{Matrix3, Point3, Unit, Vector3};

use super::room::Room;
use super::{CheckRules, Judgement, Level};

/// What lies under the floor, which is Z = 0 where both vertical and origin are fixed.
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

pub(super) fn floor(room: &Room<'_>) -> Floor {
    let fixed = &room.solved.fixed;
    if fixed.gravity.is_none() || fixed.origin.is_none() {
        let sentence = "Vertical or origin are not fixed: whether anything is under the floor cannot be told.";
        return Floor { judgement: Judgement::new(Level::Good, sentence), ..Floor::default() };
    }
    let height = |camera: usize| room.solved.cameras[camera].camera.centre().z;
    let limit = -room.rules.floor_tolerance_m;
    let cameras_below: Vec<usize> = room.calibrated().filter(|it| height(*it) < limit).collect();
    let lowest_camera_m = room.calibrated().map(height).min_by(f64::total_cmp);
    let heights: Vec<f64> = room.solved.points.iter().map(|it| it.position.z).collect();
    let lowest_path_m = percentile(&heights, 1.0);
    let path_is_below = lowest_path_m.is_some_and(|it| it < limit);
    let most_is_below =
        percentile(&heights, 50.0).is_some_and(|it| it < limit) || 2 * cameras_below.len() > room.calibrated().count();
    let judgement = if most_is_below {
        let sentence =
            "Most of the room is under the floor: the world is upside down or mirrored; fix the vertical again.";
        Judgement::new(Level::Redo, sentence)
    } else if let Some(camera) = cameras_below.first() {
        let sentence = format!(
            "Camera {} is {:.2} m under the floor: its pose is mirrored, or the origin is not on the floor; calibrate it again.",
            room.name(*camera),
            -height(*camera)
        );
        Judgement::new(Level::Redo, sentence)
    } else if path_is_below {
        let depth = -lowest_path_m.unwrap_or(0.0);
        let sentence = format!(
            "The path goes {depth:.2} m under the floor: fix vertical and origin again with marks on the floor."
        );
        Judgement::new(Level::Usable, sentence)
    } else {
        Judgement::new(Level::Good, "Nothing is under the floor.")
    };
    Floor { judgement, fixed: true, cameras_below, lowest_camera_m, lowest_path_m }
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

pub(super) fn path(room: &Room<'_>) -> PathShape {
    let positions = room.positions();
    let Some(plane) = Plane::through(&positions) else {
        let sentence = "Fewer than three places of the light are known: wave it through the whole volume.";
        return PathShape { judgement: Judgement::new(Level::Redo, sentence), ..PathShape::default() };
    };
    let flatness = plane.spread[2] / plane.spread[0];
    let [good, usable] = room.rules.flatness;
    // Several cameras around a plane tell their focal lengths after all.
    let open = room.calibrated().map(|it| &room.solved.cameras[it]).any(|it| {
        let sigma = it.covariance.as_ref().map_or(f64::INFINITY, |it| it.optics.focal);
        it.freed.focal && sigma > HELD_FOCAL
    });
    let level = match CheckRules::level(-flatness, [-good, -usable]) {
        Level::Redo if !open => Level::Usable, // known optics need no third dimension; the mirrored twin is looked for elsewhere
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
