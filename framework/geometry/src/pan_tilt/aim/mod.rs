//! Aiming: the pan and tilt at which a target is in the middle of the image.
//!
//! [`sweep`] finds all settings with the target in the middle, [`nearest`] those that come closest. [Davis 2002 §4.3]
//! descends from the present setting instead, to keep to one of several solutions; here the solution nearest to the
//! present setting is taken, which is the same for a target that moves continuously, and also finds targets far away.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Point2, Point3, Vector3};

use self::sweep::Sweep;
use super::head::{Limits, PanTiltHead, Setting};
use crate::camera::Camera;

mod nearest;
mod sweep;
#[cfg(test)]
mod tests;

/// A setting that looks at a target, or comes closest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aim {
    /// Pan and tilt of the head; the zoom is the requested or chosen one.
    pub setting: Setting,
    /// Distance of the target from the middle of the image [px]; infinite where the camera does not see it.
    pub off_centre_px: f64,
    /// Distance from the lens to the target [m].
    pub distance: f64,
    /// Iterations of the search [–].
    pub iterations: u32,
}

/// Why a head cannot look at a target.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Obstacle {
    /// The setting is beyond the limits.
    #[error("the setting is beyond the limits by {:.1}° of pan and {:.1}° of tilt", pan.to_degrees(), tilt.to_degrees())]
    OutOfLimits {
        /// Angle beyond the nearer limit of pan, negative below it; 0 within [rad].
        pan: f64,
        /// Angle beyond the nearer limit of tilt, negative below it; 0 within [rad].
        tilt: f64,
    },
    /// The setting is beyond the limits, and within them the target is always behind the camera.
    #[error("it is behind the camera at every setting within the limits")]
    Behind,
    /// The target is too close to the fixed axis: the line of sight sweeps past it.
    #[error("it is {:.1} mm from the fixed axis, where the line of sight does not reach", 1e3 * distance)]
    NearAxis {
        /// Distance of the target from the fixed axis [m].
        distance: f64,
    },
    /// The two axes are parallel.
    #[error("the two axes are parallel within {:.2}°", angle.to_degrees())]
    ParallelAxes {
        /// Angle between them [rad].
        angle: f64,
    },
    /// The target is closer to the carried axis than the lens.
    #[error("it is {:.1} mm from the carried axis, closer than the lens", 1e3 * distance)]
    TooNear {
        /// Distance of the target from the point of the axis nearest to the lens [m].
        distance: f64,
    },
    /// A number that is NaN or infinite.
    #[error("the target or the present setting is not finite")]
    NotFinite,
    /// The lens model has no line of sight in the middle of the image.
    #[error("the lens model has no line of sight in the middle of the image")]
    NoLineOfSight,
}

/// The target cannot be brought to the middle of the image.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("the target is out of reach: {reason}")]
pub struct Unreachable {
    /// Why not.
    pub reason: Obstacle,
    /// The setting within the limits that comes closest.
    pub nearest: Aim,
    /// Another setting, far from the present one, that does look at the target: the other way round or turned over.
    /// Given while `nearest` still has the target in the image.
    pub other: Option<Setting>,
}

/// Sines of angles between axes, and lengths over distances, below this are 0.
const VANISHING: f64 = 1e-9;
/// An angle beyond a limit by less is within it [rad].
const ROUNDING: f64 = 1e-9;

/// Aims a head: the setting nearest to `from`, within the limits, at which `target_in_world` is in the middle of the
/// image. The zoom is that of `from`.
///
/// Where the nearest solution is beyond the limits, another may be within them: the other way round, or turned over.
/// It is taken unless it needs a swing of a quarter turn or more while the head at its limit still has the target in
/// the image; then the head stays ([`Unreachable::other`]), so that a target that hovers about a limit does not make
/// the head swing to and fro. Where any angle of the fixed axis does, the present one is kept.
///
/// ```
/// use foveate_geometry::Camera;
/// use foveate_geometry::pan_tilt::{Limits, Obstacle, PanTiltHead, Setting, aim};
/// use nalgebra::Point3;
///
/// // A head 2 m above the floor that looks along +Y with both angles at zero.
/// let camera = Camera::look_at(Point3::new(0.0, 0.0, 2.0), Point3::new(0.0, 5.0, 2.0), [640, 480], 700.0);
/// let head = PanTiltHead::aligned(camera, Limits::symmetric(2.9, 0.4));
///
/// let target = Point3::new(3.0, 3.0, 1.0); // ahead to the right, 1 m below the lens
/// let found = aim(&head, &target, &Setting::default())?;
/// assert!((found.setting.pan.to_degrees() - 45.0).abs() < 1e-6);
/// assert!((found.setting.tilt + (1.0 / 18_f64.sqrt()).atan()).abs() < 1e-6);
/// let pixel = head.camera_at(&found.setting).project(&target).unwrap();
/// assert!((pixel - nalgebra::Point2::new(319.5, 239.5)).norm() < 1e-6);
///
/// // Nearly below the head: beyond the limits of tilt; the nearest setting is at the limit.
/// let refused = aim(&head, &Point3::new(0.0, 1.0, 0.0), &Setting::default()).unwrap_err();
/// assert!(matches!(refused.reason, Obstacle::OutOfLimits { .. }));
/// assert!((refused.nearest.setting.tilt + 0.4).abs() < 1e-9);
/// # Ok::<(), foveate_geometry::pan_tilt::Unreachable>(())
/// ```
///
/// # Errors
/// [`Unreachable`], with the setting that comes closest.
pub fn aim(head: &PanTiltHead, target_in_world: &Point3<f64>, from: &Setting) -> Result<Aim, Unreachable> {
    Search::new(head, target_in_world, from).and_then(|it| it.run())
}

/// As [`aim`], and chooses the zoom at which a sphere of `radius` [m] about the target fills the part `fill` of half
/// the image's shorter side. Without a table of zoom positions it is [`aim`].
///
/// # Errors
/// [`Unreachable`], with the setting that comes closest.
pub fn aim_at_sphere(
    head: &PanTiltHead,
    centre_in_world: &Point3<f64>,
    radius: f64,
    fill: f64,
    from: &Setting,
) -> Result<Aim, Unreachable> {
    let Some(table) = &head.zoom else { return aim(head, centre_in_world, from) };
    // The principal point may wander with the zoom, so that the angles follow the zoom; their effect on the distance is nil.
    let distance = match aim(head, centre_in_world, from) {
        Ok(found) => found.distance,
        Err(found) => found.nearest.distance,
    };
    let zoom = table.zoom_of_sphere(radius, distance, head.at_rest.image_size, fill).zoom;
    aim(head, centre_in_world, &Setting { zoom: Some(zoom), ..*from })
}

/// What stays the same while solving for one target.
struct Search<'a> {
    head: &'a PanTiltHead,
    /// The optics in use, at the origin.
    optics: Camera,
    middle: Point2<f64>,
    d: Vector3<f64>,
    x: Point3<f64>,
    from: Setting,
}

/// A setting with the distance at which it sees the target.
#[derive(Debug, Clone, Copy)]
struct Solution {
    setting: Setting,
    distance: f64,
    iterations: u32,
}

impl<'a> Search<'a> {
    fn new(head: &'a PanTiltHead, target: &Point3<f64>, from: &Setting) -> Result<Self, Unreachable> {
        let mut optics = head.optics_at(from.zoom);
        optics.camera_from_world = Isometry3::identity();
        let [width, height] = optics.image_size.map(f64::from);
        let middle = Point2::new(0.5 * (width - 1.0), 0.5 * (height - 1.0));
        let refused = |reason| {
            let setting =
                head.limits.clamp(&Setting { pan: finite(from.pan), tilt: finite(from.tilt), zoom: from.zoom });
            let nearest = Aim { setting, off_centre_px: f64::INFINITY, distance: f64::NAN, iterations: 0 };
            Unreachable { reason, nearest, other: None }
        };
        let x = head.at_rest.camera_from_world * target;
        if !(x.coords.norm().is_finite() && from.pan.is_finite() && from.tilt.is_finite()) {
            return Err(refused(Obstacle::NotFinite));
        }
        let d = optics.normalise(&middle).ok_or_else(|| refused(Obstacle::NoLineOfSight))?.push(1.0).normalize();
        Ok(Search { head, optics, middle, d, x, from: *from })
    }

    fn run(&self) -> Result<Aim, Unreachable> {
        let solutions = match self.solutions() {
            Ok(solutions) => solutions,
            Err(reason) => return Err(self.unreachable(reason, &[], None)),
        };
        let limits = &self.head.limits;
        let Some(nearest) = self.nearest_of(solutions.into_iter().flatten()) else {
            unreachable!("some solution, or a reason")
        };
        if let Some(setting) = within(&nearest.setting, limits) {
            return Ok(self.aimed(Solution { setting, ..nearest }));
        }
        let turned = |it: Solution| Some(Solution { setting: turned_into(&it.setting, limits)?, ..it });
        let allowed = self.nearest_of(solutions.into_iter().flatten().filter_map(turned));
        let at_limit = limits.clamp(&nearest.setting);
        let is_swing = |it: &Solution| self.way_to(&it.setting) > self.way_to(&at_limit) + FRAC_PI_2;
        if let Some(found) = allowed.filter(|it| !(is_swing(it) && self.has_in_image(&at_limit))) {
            return Ok(self.aimed(found));
        }
        let allowed = allowed.map(|it| it.setting);
        let beyond = |angle: f64, [low, high]: [f64; 2]| (angle - high).max(0.0) + (angle - low).min(0.0);
        let reason = Obstacle::OutOfLimits {
            pan: beyond(nearest.setting.pan, limits.pan),
            tilt: beyond(nearest.setting.tilt, limits.tilt),
        };
        // While the head waits at its limit, it is not to wander off towards another solution.
        let starts: Vec<Setting> = solutions.into_iter().flatten().map(|it| it.setting).collect();
        let starts = if allowed.is_some() { &[at_limit][..] } else { &starts };
        Err(self.unreachable(reason, starts, allowed))
    }

    /// The upright and the overturned solution, the latter left out where it is the same, each at the turn nearest to the present setting;
    /// of axes far from the usual ones up to four.
    fn solutions(&self) -> Result<[Option<Solution>; 4], Obstacle> {
        let sweep = Sweep::new(self);
        let angles = match [1.0, -1.0].map(|sign| sweep.follow(sign)) {
            [Some(one), Some(other)] => [Some(one), Some(other), None, None],
            _ => sweep.scan(),
        };
        let found = angles.map(|it| sweep.solution(it?));
        if found.iter().all(|it| it.is_none()) { Err(sweep.obstacle()) } else { Ok(found) }
    }

    /// How far both angles have to go together [rad].
    fn way_to(&self, setting: &Setting) -> f64 {
        (setting.pan - self.from.pan).hypot(setting.tilt - self.from.tilt)
    }

    fn nearest_of(&self, solutions: impl Iterator<Item = Solution>) -> Option<Solution> {
        solutions.min_by(|a, b| self.way_to(&a.setting).total_cmp(&self.way_to(&b.setting)))
    }

    /// States what the camera sees at a solution.
    fn aimed(&self, solution: Solution) -> Aim {
        let Solution { setting, distance, iterations } = solution;
        Aim { setting, off_centre_px: self.off_centre_px(&setting), distance, iterations }
    }

    fn in_camera(&self, setting: &Setting) -> Point3<f64> {
        self.head.camera_from_rest(setting) * self.x
    }

    fn off_centre_px(&self, setting: &Setting) -> f64 {
        let seen = self.optics.project(&self.in_camera(setting));
        seen.map_or(f64::INFINITY, |pixel| (pixel - self.middle).norm())
    }

    fn has_in_image(&self, setting: &Setting) -> bool {
        self.optics.sees(&self.in_camera(setting)).is_some()
    }
}

/// The setting if it is allowed, or beyond a limit by no more than rounding.
fn within(setting: &Setting, limits: &Limits) -> Option<Setting> {
    let clamped = limits.clamp(setting);
    let beyond = (clamped.pan - setting.pan).abs().max((clamped.tilt - setting.tilt).abs());
    (beyond <= ROUNDING).then_some(clamped)
}

/// The same directions by whole turns such that both angles are allowed, if that can be.
fn turned_into(setting: &Setting, limits: &Limits) -> Option<Setting> {
    let turned = |angle: f64, [low, high]: [f64; 2]| {
        let turns = |gap: f64| std::f64::consts::TAU * (gap / std::f64::consts::TAU).ceil();
        let least = if angle < low - ROUNDING { angle + turns(low - ROUNDING - angle) } else { angle };
        if least > high + ROUNDING { least - turns(least - ROUNDING - high) } else { least }
    };
    let setting =
        Setting { pan: turned(setting.pan, limits.pan), tilt: turned(setting.tilt, limits.tilt), zoom: setting.zoom };
    within(&setting, limits)
}

fn finite(angle: f64) -> f64 {
    if angle.is_finite() { angle } else { 0.0 }
}

/// The angle, by whole turns, that is nearest to `present`.
fn nearest_turn(angle: f64, present: f64) -> f64 {
    angle - std::f64::consts::TAU * ((angle - present) / std::f64::consts::TAU).round()
}
