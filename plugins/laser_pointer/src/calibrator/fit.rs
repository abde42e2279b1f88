//! One camera's map from points of known place, and the error at points that the fit did not know.

use foveate::geometry::plane_map::LEAST_POINTS;
use foveate::geometry::{PlaneMap, PlaneMapError, PlanePoint};
use foveate::scene::WallCamera;
use nalgebra::{Matrix2, Point2};

use super::WallSize;

/// Every so many dots one is held out; boards are held out in so many turns.
pub(super) const HELD_OUT: usize = 4;

/// A point that a camera saw, and the dot or board that it belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sighting {
    /// The place of the dot or board in the order in which the camera saw them.
    pub(super) group: usize,
    /// Where it is, and where it was seen.
    pub(super) point: PlanePoint,
}

/// How the error where nothing was fitted is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum HoldOut {
    /// Every fourth group, once.
    Fourth,
    /// Every group, in four turns: where there are few.
    InTurn,
}

/// The map of a camera whose picture is `size`; `what` names the points in messages; `brightest` is what the wall reads there; an error at held-out
/// points above `limit_px` is refused [px of the wall].
///
/// # Errors
/// Why there is no map.
pub(super) fn fit(
    wall: &WallSize,
    size: [u32; 2],
    seen: &[Sighting],
    (hold_out, what): (HoldOut, &str),
    brightest: f64,
    limit_px: f64,
) -> Result<WallCamera, String> {
    let why = |error: PlaneMapError| match error {
        PlaneMapError::TooFew { count } => {
            format!(
                "it saw {count} {what}, expected at least {LEAST_POINTS}: does it look at the wall, and is the way free?"
            )
        }
        PlaneMapError::OnALine { count, .. } => {
            format!(
                "it saw {count} {what} on one line, expected {what} all over its picture: most of its view is hidden, or beside the wall"
            )
        }
        PlaneMapError::NoFit(why) => why,
    };
    let points = |keep: &dyn Fn(usize) -> bool| -> Vec<PlanePoint> {
        seen.iter().filter(|it| keep(it.group)).map(|it| it.point).collect()
    };
    let map = PlaneMap::fit(size, &points(&|_| true)).map_err(why)?;
    let turns = match hold_out {
        HoldOut::Fourth => 1..2,
        HoldOut::InTurn => 0..HELD_OUT,
    };
    let (mut squares, mut n) = (0.0, 0_usize);
    for turn in turns {
        let held = points(&|group| group % HELD_OUT == turn);
        if held.is_empty() {
            continue;
        }
        let partly = PlaneMap::fit(size, &points(&|group| group % HELD_OUT != turn))
            .map_err(|error| format!("without the {what} that are held out: {}", why(error)))?;
        squares += held.iter().map(|it| miss(&partly, it)).sum::<f64>();
        n += held.len();
    }
    let held_out_px = (squares / n as f64).sqrt() / wall.pixel_m;
    if held_out_px > limit_px || held_out_px.is_nan() {
        return Err(format!(
            "at {n} {what} that were held out it is off by {held_out_px:.2} px of the wall, expected at most {limit_px}: is the wall flat, and its size right?"
        ));
    }
    Ok(WallCamera { map, held_out_px: held_out_px.max(1e-6), brightest: brightest.max(1.0) })
}

/// Square of the distance between where `map` has a point and where it is [m²].
fn miss(map: &PlaneMap, it: &PlanePoint) -> f64 {
    let placed = map.place(&it.pixel, &Matrix2::zeros());
    placed.map_or(f64::INFINITY, |placed| (placed.point - it.point).norm_squared())
}

/// How a camera looks at the wall, where that is not as people do.
pub(super) fn stance(map: &PlaneMap) -> Option<&'static str> {
    let middle = Point2::from(map.image_size.map(|it| (f64::from(it) - 1.0) / 2.0));
    let (_, pixel_by_point) = map.pixel_with_jacobian(&map.point(&middle)?)?;
    let is_mirrored = pixel_by_point.determinant() < 0.0;
    let is_upside_down = pixel_by_point[(1, 1)] < 0.0;
    match (is_mirrored, is_upside_down) {
        (false, false) => None,
        (false, true) => Some("upside down"),
        (true, false) => Some("mirrored: it stands behind it"),
        (true, true) => Some("mirrored and upside down: it stands behind it"),
    }
}
