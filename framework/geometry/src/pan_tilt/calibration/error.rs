//! Errors of head calibration.

use super::UNIT_RATIO;
use crate::camera::CameraError;

/// Why a head cannot be calibrated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HeadCalibrationError {
    /// Optics that cannot be used.
    #[error("the optics: {0}")]
    BadOptics(CameraError),
    /// An option out of range.
    #[error("{option} is {found}, expected {expected}")]
    BadOption {
        /// Which option.
        option: &'static str,
        /// Value that was found.
        found: f64,
        /// What was expected.
        expected: &'static str,
    },
    /// An observation that cannot be used.
    #[error("observation {observation}: {field} is {found}, expected {expected}")]
    BadObservation {
        /// Index of the observation.
        observation: usize,
        /// Which of its fields.
        field: &'static str,
        /// Value that was found.
        found: f64,
        /// What was expected.
        expected: &'static str,
    },
    /// Too few observations for the unknowns.
    #[error("{count} {kind} observations, expected at least {expected}")]
    TooFew {
        /// Number of observations.
        count: usize,
        /// `usable` ones, or inliers.
        kind: &'static str,
        /// Number that is needed.
        expected: usize,
    },
    /// The head was moved too little.
    #[error("{axis} was moved over {:.2}°, expected {:.1}° or more", range.to_degrees(), expected.to_degrees())]
    RangeTooSmall {
        /// Which axis.
        axis: &'static str,
        /// Range of the settings [rad]; 0 also when the unit could not be found.
        range: f64,
        /// Range that the options require [rad].
        expected: f64,
    },
    /// The targets lie on a line, about which the camera can turn.
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
        /// Number of different settings.
        settings: usize,
        /// Settings whose targets gave a pose.
        posed: usize,
    },
    /// Most targets are not visible from the given start.
    #[error("at the start the camera sees {seen} of {count} targets, expected most of them")]
    BadStart {
        /// Targets in front of the camera.
        seen: usize,
        /// Number of targets.
        count: usize,
    },
    /// The search diverged to another unit of angle.
    #[error(
        "the unit of {axis} went from {start:.3e} rad to {found:.3e} rad, expected it to stay within a factor of {UNIT_RATIO}"
    )]
    UnitLost {
        /// Which axis.
        axis: &'static str,
        /// Unit at the start [rad].
        start: f64,
        /// Unit at the end [rad].
        found: f64,
    },
    /// Unobservable parameters.
    #[error("unobservable from the observations: {}", parameters.join(", "))]
    Open {
        /// The parameters, each undetermined given those before it.
        parameters: Vec<&'static str>,
    },
    /// Parameters that the observations determine too poorly.
    #[error(
        "{what} is known to {sigma:.2} {unit}, expected {expected:.2} {unit} or better; the targets were {:.2} to {:.2} m from the camera, pan moved over \
         {:.0}° and tilt over {:.0}°: nearer targets, at more different distances, and more range hold it better",
        distances[0], distances[1], ranges[0].to_degrees(), ranges[1].to_degrees()
    )]
    Loose {
        /// Which parameter.
        what: &'static str,
        /// Its standard deviation.
        sigma: f64,
        /// Standard deviation that the options require.
        expected: f64,
        /// Unit of both.
        unit: &'static str,
        /// Distance of the nearest and the farthest target [m].
        distances: [f64; 2],
        /// Ranges of the settings of pan and tilt [rad].
        ranges: [f64; 2],
    },
    /// The axes found are parallel.
    #[error("the axes found are parallel within {:.1}°: settings of pan and tilt may be mixed up", angle.to_degrees())]
    ParallelAxes {
        /// Angle between them [rad].
        angle: f64,
    },
}
