//! Scale, vertical and origin of a solved camera network, and how well each is fixed.
//!
//! Pixels determine a calibration up to a similarity. [`fix`] fixes as much of it as the [`Given`] sources can: a length fixes the scale, a fall the
//! scale and the vertical, points on the floor the vertical and the origin, points of known place everything. Each source states
//! its standard deviation; sources of the same freedom are weighted by it, and refused when they contradict each other. What no
//! source fixes stays as it was and is `None` in [`crate::solved::FixedFreedoms`]. What an earlier step fixed counts as a source.
//!
//! A light held still for a second is a *stop*; stops are counted from 1 ([`Place::Stop`]), so that a person can lay the light on the
//! origin, on the X axis and elsewhere on the floor in turn, without a table of times.

mod args;
mod error;
mod fall;
mod places;
mod sources;
mod spread;
mod transform;

use nalgebra::{Point3, Similarity3};

pub use self::args::{AxesArgError, AxesArgs};
pub use self::error::AxesError;
pub use self::fall::{Fall, FallError};
pub use self::places::{Stop, stops};
pub(crate) use self::sources::KNOWN_PLACES;
pub use self::transform::transformed;
use crate::solved::Solved;

/// A place in the room, by a camera or by where the light was.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// The centre of a camera, by its name.
    Camera(String),
    /// Where a light was on average within a span of the room's time.
    Light {
        /// Which light.
        label: u32,
        /// From when [s].
        from_s: f64,
        /// Until when [s].
        until_s: f64,
    },
    /// Where a light was held still for the nth time.
    Stop {
        /// Which light.
        label: u32,
        /// Counted from 1.
        number: usize,
    },
}

/// A measurement of the room beside pixels: a source of scale, vertical or origin. Standard deviations are those of the measurement, such as a tape measure's.
#[derive(Debug, Clone, PartialEq)]
pub enum Given {
    /// Two lights of the same frame are this far apart in every frame.
    WandLength {
        /// Their labels.
        ends: [u32; 2],
        /// Length between their centres [m].
        metres: f64,
        /// Of the length [m].
        sigma_m: f64,
    },
    /// Two places are this far apart.
    Distance {
        /// The first one.
        a: Place,
        /// The second one.
        b: Place,
        /// Between them [m].
        metres: f64,
        /// Of the distance [m].
        sigma_m: f64,
    },
    /// Places of known coordinates, such as an L-frame: at least three, not on a line. Fixes everything.
    Points {
        /// Each with where it is in the world [m].
        known: Vec<(Place, Point3<f64>)>,
        /// Of each coordinate [m].
        sigma_m: f64,
    },
    /// Places on a level floor: the plane Z = 0, with the origin at the first, and X towards the second.
    Floor {
        /// At least three, not on a line.
        places: Vec<Place>,
        /// Height of the light's centre above the floor; 0 makes the plane of the lights that of Z = 0 [m].
        height_m: f64,
        /// Of each height, without the scale only its part of the room counts [m].
        sigma_m: f64,
    },
    /// The light falls freely for most of this span: gravity, and by its strength the scale.
    Falling {
        /// Which light.
        label: u32,
        /// From when [s].
        from_s: f64,
        /// Until when [s].
        until_s: f64,
    },
    /// Two places on a plumb line.
    Plumb {
        /// The upper one.
        top: Place,
        /// The lower one.
        bottom: Place,
        /// How far either may be off the line, in parts of their distance [–].
        sigma: f64,
    },
    /// The cameras are mounted without roll: their horizontal axes lie in the horizontal plane. A weak assumption.
    CamerasUpright,
}

/// Options of [`fix`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxesOptions {
    /// A light is at a stop when still for this long [s].
    pub stop_s: f64,
    /// Still is what stays within this part of the size of the path [–].
    pub stop_share: f64,
    /// Two sources contradict each other beyond this many standard deviations of their difference [–].
    pub contradiction_sigmas: f64,
    /// How far from level floors and L-frames are, standard deviation [rad].
    pub level_sigma_rad: f64,
    /// Strength of gravity; on Earth within 0.3 % of this [m/s²].
    pub gravity_mps2: f64,
}

impl Default for AxesOptions {
    fn default() -> Self {
        Self {
            stop_s: 1.0,
            stop_share: 0.005,
            contradiction_sigmas: 4.0,
            level_sigma_rad: 2e-3,
            gravity_mps2: 9.806_65,
        }
    }
}

/// The result of [`fix`]: the room in its new space, and the contribution of each source.
#[derive(Debug, Clone, PartialEq)]
pub struct AxesFixed {
    /// The room in its new space.
    pub solved: Solved,
    /// From the space before to the new one.
    pub world_from_solved: Similarity3<f64>,
    /// What each source gives for its freedom, for comparison.
    pub sources: Vec<SourceFigure>,
    /// Falls that were found, in the order given; in the units of the space before.
    pub falls: Vec<Fall>,
}

/// One source of one freedom.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceFigure {
    /// What it settles.
    pub freedom: FreedomName,
    /// Such as `a wand of 0.4 m`.
    pub by: String,
    /// How far it is from what was settled: relative for the scale, in rad for gravity, in m for the origin.
    pub off: f64,
    /// Its standard deviation, in the same unit.
    pub sigma: f64,
}

/// A freedom that pixels leave undetermined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FreedomName {
    /// The length of a metre.
    Scale,
    /// The direction of Z.
    Gravity,
    /// The place of the origin.
    Origin,
}

impl std::fmt::Display for FreedomName {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.write_str(match self {
            FreedomName::Scale => "scale",
            FreedomName::Gravity => "vertical",
            FreedomName::Origin => "origin",
        })
    }
}

/// Fixes scale, vertical and origin of `solved`, as far as the sources `given` determine them. Cameras, points and covariances are transformed together.
///
/// # Errors
/// See [`AxesError`].
pub fn fix(solved: &Solved, given: &[Given], options: &AxesOptions) -> Result<AxesFixed, AxesError> {
    options.check()?;
    if given.is_empty() {
        return Err(AxesError::NothingGiven);
    }
    let network = places::Room::new(solved, options);
    let mut sources = sources::Sources::of_earlier_steps(solved);
    for it in given {
        sources.add(&network, it)?;
    }
    let settled = sources.settle(options.contradiction_sigmas)?;
    Ok(AxesFixed {
        solved: transformed(solved, &settled.world_from_solved, settled.fixed),
        world_from_solved: settled.world_from_solved,
        sources: settled.figures,
        falls: sources.falls,
    })
}

impl AxesOptions {
    /// Whether each number can be followed.
    ///
    /// # Errors
    /// The first that cannot.
    pub fn check(&self) -> Result<(), AxesError> {
        for (what, found) in [
            ("stop_s", self.stop_s),
            ("stop_share", self.stop_share),
            ("contradiction_sigmas", self.contradiction_sigmas),
            ("level_sigma_rad", self.level_sigma_rad),
            ("gravity_mps2", self.gravity_mps2),
        ] {
            positive(what, found)?;
        }
        Ok(())
    }
}

fn positive(what: &str, found: f64) -> Result<(), AxesError> {
    let fine = found.is_finite() && found > 0.0;
    let expected = "a finite number above 0";
    fine.then_some(()).ok_or_else(|| AxesError::BadNumber { what: what.to_owned(), found, expected })
}

fn not_negative(what: &str, found: f64) -> Result<(), AxesError> {
    let fine = found.is_finite() && found >= 0.0;
    let expected = "a finite number of 0 or more";
    fine.then_some(()).ok_or_else(|| AxesError::BadNumber { what: what.to_owned(), found, expected })
}

#[cfg(test)]
mod tests;
