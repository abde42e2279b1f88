//! Why there is no calibration.

use super::UNIT_RATIO;
use crate::camera::CameraError;

/// Why there is no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HeadCalibrationError {
    /// Optics that are none.
    #[error("the optics: {0}")]
    BadOptics(CameraError),
    /// A rule that cannot be followed.
    #[error("{rule} is {found}, expected {expected}")]
    BadRule {
        /// Which.
        rule: &'static str,
        /// Its value.
        found: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// An observation that cannot be used.
    #[error("observation {observation}: {field} is {found}, expected {expected}")]
    BadObservation {
        /// Which, from 0.
        observation: usize,
        /// Which part of it.
        field: &'static str,
        /// Its value.
        found: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// Fewer than the unknowns need.
    #[error("{count} {kind} observations, expected at least {expected}")]
    TooFew {
        /// How many.
        count: usize,
        /// Of all, or of the right ones.
        kind: &'static str,
        /// How many are needed.
        expected: usize,
    },
    /// The head hardly moved.
    #[error("{axis} was moved over {:.2}° only, expected {:.1}° or more", range.to_degrees(), expected.to_degrees())]
    RangeTooSmall {
        /// Which.
        axis: &'static str,
        /// From smallest to largest [rad]; 0 also when its unit could not be found.
        range: f64,
        /// What the rules ask for [rad].
        expected: f64,
    },
    /// Targets that leave the camera free to turn about them.
    #[error("the targets lie on a line: their spread across it is {:.1} mm, {:.1} % of that along it", 1e3 * across, 1e2 * across / along)]
    OnALine {
        /// Standard deviation along the line [m].
        along: f64,
        /// Standard deviation across it [m].
        across: f64,
    },
    /// No start was found.
    #[error(
        "no start found: of {settings} settings, {posed} with 6 targets or more gave a pose (3 are needed, at different pan and tilt), and without them \
         the units of both angles must be known at least nearly"
    )]
    NoStart {
        /// Different settings.
        settings: usize,
        /// Those whose targets gave a pose.
        posed: usize,
    },
    /// The start given does not see the targets, or not within reach of the search.
    #[error("at the start the camera sees {seen} of {count} targets, expected most of them")]
    BadStart {
        /// Targets in front of the camera.
        seen: usize,
        /// All.
        count: usize,
    },
    /// The search ran away to another unit.
    #[error(
        "from {start:.3e} rad the unit of {axis} went to {found:.3e} rad, expected it to stay within a factor of {UNIT_RATIO}"
    )]
    UnitLost {
        /// Of which axis.
        axis: &'static str,
        /// Where it started [rad].
        start: f64,
        /// Where it ended [rad].
        found: f64,
    },
    /// Parameters that the observations do not hold at all.
    #[error("the observations leave open: {}", parameters.join(", "))]
    Open {
        /// Which: each cannot be told from those before it.
        parameters: Vec<&'static str>,
    },
    /// Parameters that the observations hold too loosely.
    #[error(
        "{what} is known to {sigma:.2} {unit} only, expected {expected:.2} {unit} or better; the targets were {:.2} to {:.2} m from the camera, pan moved over \
         {:.0}° and tilt over {:.0}°: nearer targets, at more different distances, and more range hold it better",
        distances[0], distances[1], ranges[0].to_degrees(), ranges[1].to_degrees()
    )]
    Loose {
        /// What.
        what: &'static str,
        /// Its standard deviation.
        sigma: f64,
        /// What the rules ask for.
        expected: f64,
        /// Of both.
        unit: &'static str,
        /// Of the nearest and the farthest target [m].
        distances: [f64; 2],
        /// Of pan and tilt, between the smallest and the largest setting [rad].
        ranges: [f64; 2],
    },
    /// Two axes that do the same.
    #[error("the axes found are parallel within {:.1}°: settings of pan and tilt may be mixed up", angle.to_degrees())]
    ParallelAxes {
        /// The angle between them [rad].
        angle: f64,
    },
}
