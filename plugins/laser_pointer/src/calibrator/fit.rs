//! One camera's map from points of known place, and its error at held-out points.

use foveate::geometry::{PlaneMap, PlaneMapError, PlanePoint};
use foveate::scene::WallCamera;
use nalgebra::{Matrix2, Point2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::WallSize;

/// One of this many dots is held out; boards are held out in this many rounds.
pub(super) const HELD_OUT: usize = 4;

/// Shape of a wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Surface {
    /// A plane.
    #[default]
    Flat,
    /// Curved: along an arc, or wavy.
    Curved,
}

/// A point that a camera saw, and the dot or board that it belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sighting {
    /// Index of the dot or board in the order in which the camera saw them.
    pub(super) group: usize,
    /// Its place, and where it was seen.
    pub(super) point: PlanePoint,
}

/// How held-out points are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum HoldOut {
    /// Every fourth group, once.
    Fourth,
    /// Every group, in four rounds: for few groups.
    InTurn,
}

/// The map of a camera with pictures of `size`, of a wall of shape `surface`; `what` names the points in messages; `brightest` is the wall's gray level; an error at
/// held-out points above `limit_px` is refused [px of the wall].
///
/// # Errors
/// Why there is no map.
pub(super) fn fit(
    wall: &WallSize,
    (size, surface): ([u32; 2], Surface),
    seen: &[Sighting],
    (hold_out, what): (HoldOut, &str),
    brightest: f64,
    limit_px: f64,
) -> Result<WallCamera, String> {
    let fitted = Fitted { wall, size, surface, seen, hold_out, what };
    let map = fitted.map(&|_| true)?;
    let (held_out_px, n) = fitted.held_out_px()?;
    if n == 0 {
        return Err(format!("too few of the {what} that it saw to hold some out, expected them all over its picture"));
    }
    if held_out_px > limit_px || held_out_px.is_nan() {
        let error =
            format!("at {n} held-out {what} it is off by {held_out_px:.2} px of the wall, expected at most {limit_px}");
        // Whether it bends is tried, not guessed.
        let curved = Fitted { surface: Surface::Curved, ..fitted }.held_out_px().ok().map(|it| it.0);
        return Err(match (surface, curved) {
            (Surface::Flat, Some(px)) if px <= limit_px => {
                format!("{error}: the wall is curved; with `surface = \"curved\"` it is off by {px:.2} px")
            }
            (Surface::Flat, _) => format!("{error}: is the wall flat, and its size right?"),
            (Surface::Curved, _) => {
                format!("{error}: is its size right, is it curved without kinks, and are there {what} all over it?")
            }
        });
    }
    Ok(WallCamera { map, held_out_px: held_out_px.max(1e-6), brightest: brightest.max(1.0) })
}

/// Points and options of a fit.
#[derive(Clone, Copy)]
struct Fitted<'a> {
    wall: &'a WallSize,
    size: [u32; 2],
    surface: Surface,
    seen: &'a [Sighting],
    hold_out: HoldOut,
    what: &'a str,
}

impl Fitted<'_> {
    /// The map from the points of the groups that `keep` accepts.
    fn map(&self, keep: &dyn Fn(usize) -> bool) -> Result<PlaneMap, String> {
        let points = self.points(keep);
        let map = match self.surface {
            Surface::Flat => PlaneMap::fit(self.size, &points),
            Surface::Curved => PlaneMap::fit_bent(self.size, &points, self.wall.size_m),
        };
        let what = self.what;
        map.map_err(|error| match error {
            PlaneMapError::TooFew { count, least } => {
                format!(
                    "it saw {count} {what}, expected at least {least}: does it see the wall, without obstacles?"
                )
            }
            PlaneMapError::OnALine { count, .. } => {
                format!(
                    "it saw {count} {what} on one line, expected {what} all over its picture: most of its view is blocked, or outside of the wall"
                )
            }
            PlaneMapError::NoFit(why) => why,
        })
    }

    fn points(&self, keep: &dyn Fn(usize) -> bool) -> Vec<PlanePoint> {
        self.seen.iter().filter(|it| keep(it.group)).map(|it| it.point).collect()
    }

    /// The error at held-out points, root mean square [px of the wall], and how many there were. For a curved wall, at points between others.
    fn held_out_px(&self) -> Result<(f64, usize), String> {
        let turns = match self.hold_out {
            HoldOut::Fourth => 1..2,
            HoldOut::InTurn => 0..HELD_OUT,
        };
        let (mut squares, mut n) = (0.0, 0_usize);
        for turn in turns {
            let mut held = self.points(&|group| group % HELD_OUT == turn);
            if self.surface == Surface::Curved {
                // How a wall bends beyond the outermost dots no dot tells: the map's covariance says so there.
                let kept = self.points(&|group| group % HELD_OUT != turn);
                held.retain(|it| is_among(&it.point, &kept));
            }
            if held.is_empty() {
                continue;
            }
            let partly = self
                .map(&|group| group % HELD_OUT != turn)
                .map_err(|why| format!("without the {} that are held out: {why}", self.what))?;
            squares += held.iter().map(|it| miss(&partly, it)).sum::<f64>();
            n += held.len();
        }
        Ok(((squares / n as f64).sqrt() / self.wall.pixel_m, n))
    }
}

/// Whether a point lies between others: they surround it without a gap of half a turn.
fn is_among(point: &Point2<f64>, others: &[PlanePoint]) -> bool {
    let mut angles: Vec<f64> = others.iter().map(|it| it.point - point).map(|it| it.y.atan2(it.x)).collect();
    angles.sort_by(f64::total_cmp);
    let Some((first, last)) = angles.first().zip(angles.last()) else { return false };
    let around = first + std::f64::consts::TAU - last;
    angles.windows(2).map(|it| it[1] - it[0]).fold(around, f64::max) < std::f64::consts::PI
}

/// Squared distance between a point and its place by `map` [m²].
fn miss(map: &PlaneMap, it: &PlanePoint) -> f64 {
    let placed = map.place(&it.pixel, &Matrix2::zeros());
    placed.map_or(f64::INFINITY, |placed| (placed.point - it.point).norm_squared())
}

/// A camera's unusual view of the wall: mirrored or upside down.
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
