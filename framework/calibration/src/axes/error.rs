//! Errors of fixing scale and axes, each with its remedy.

use foveate_geometry::CameraStatus;

use super::{FallError, FreedomName};

/// Why scale, vertical or origin could not be fixed; the message says what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AxesError {
    /// No source of scale or axes was given.
    #[error(
        "nothing is given that fixes scale or axes; give a wand length, a distance, points on the floor, an L-frame or a fall"
    )]
    NothingGiven,
    /// A number outside its range.
    #[error("{what} is {found}, expected {expected}")]
    BadNumber {
        /// What the number is.
        what: String,
        /// The value that was found.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// No camera has that name.
    #[error("there is no camera {name:?}; the cameras are {}", known.join(", "))]
    NoSuchCamera {
        /// The name that was given.
        name: String,
        /// Those that there are.
        known: Vec<String>,
    },
    /// The camera has no pose.
    #[error("camera {name:?} has no pose: {status}; name another one")]
    CameraNotSolved {
        /// Name of the camera.
        name: String,
        /// Why it was not calibrated.
        status: CameraStatus,
    },
    /// The light was found too rarely in the span.
    #[error(
        "light {label} was found {found} times from {from_s} s to {until_s} s, expected at least {needed}; it was found from {} s to {} s",
        recorded_s[0], recorded_s[1]
    )]
    NoLight {
        /// Which light.
        label: u32,
        /// Start of the span [s].
        from_s: f64,
        /// Its end [s].
        until_s: f64,
        /// Places in it.
        found: usize,
        /// Places needed.
        needed: usize,
        /// First and last time of the light; NaN without any [s].
        recorded_s: [f64; 2],
    },
    /// Fewer stops than requested.
    #[error(
        "stop {number} of light {label} is requested, but the light stood still {found} times; hold it still for {stop_s} s at each place"
    )]
    NoStop {
        /// Which light.
        label: u32,
        /// Which stop.
        number: usize,
        /// Number that was found.
        found: usize,
        /// How long one lasts at least [s].
        stop_s: f64,
    },
    /// No frame shows both ends.
    #[error(
        "both ends of the wand (lights {} and {}) were found in {frames} frames, expected at least {needed}; \
         wave it where two cameras see it whole", ends[0], ends[1]
    )]
    NoWand {
        /// Labels of the ends.
        ends: [u32; 2],
        /// Frames with both.
        frames: usize,
        /// Number that is needed.
        needed: usize,
    },
    /// Not enough places.
    #[error("{given}: {found} places, expected at least {needed}")]
    TooFewPlaces {
        /// The source.
        given: String,
        /// Number that was found.
        found: usize,
        /// Number that is needed.
        needed: usize,
    },
    /// Places too close together for their uncertainty.
    #[error(
        "{given}: the places are {distance:.3e} apart and known to {sigma:.1e} (units of the solution); choose places farther apart"
    )]
    SamePlace {
        /// The source.
        given: String,
        /// Their distance, in units of the solution.
        distance: f64,
        /// Its standard deviation, likewise.
        sigma: f64,
    },
    /// Places on a line.
    #[error(
        "{given}: the places lie on a line (they spread {ratio:.1e} times as far across it as along it); add one beside the line"
    )]
    Collinear {
        /// The source.
        given: String,
        /// Across over along.
        ratio: f64,
    },
    /// Points that fit only the mirror image of the room.
    #[error("{given}: the points are mirrored ({why}); swap two of them, or check the signs of the coordinates")]
    Mirrored {
        /// The source.
        given: String,
        /// What shows it.
        why: String,
    },
    /// Points whose distances differ from the stated coordinates.
    #[error(
        "{given}: the points are off by {rms_m:.4} m, expected about {expected_m:.4} m; the worst is number {worst} with {worst_m:.4} m: \
         check its coordinates, and that the places are in the order given"
    )]
    Misfit {
        /// The source.
        given: String,
        /// Root mean square distance [m].
        rms_m: f64,
        /// What their standard deviations make likely [m].
        expected_m: f64,
        /// The worst one, counted from 1.
        worst: usize,
        /// Its distance [m].
        worst_m: f64,
    },
    /// The floor has as much of the path on one side as on the other.
    #[error(
        "{given}: {above:.0} % of the light's path lies on one side of the plane and the rest on the other; which side is up? \
         choose places on the floor"
    )]
    NoSideIsUp {
        /// The source.
        given: String,
        /// Share of the path above [%].
        above: f64,
    },
    /// The span contains no free fall.
    #[error("a fall from {from_s} s to {until_s} s: {fault}")]
    NoFall {
        /// Start of the span [s].
        from_s: f64,
        /// Its end [s].
        until_s: f64,
        /// The fault.
        fault: FallError,
    },
    /// The cameras' orientation does not determine the vertical.
    #[error("the cameras do not determine the vertical: {why}; give a fall, a plumb line or points on the floor")]
    VerticalUnobservable {
        /// The reason.
        why: String,
    },
    /// Two sources that contradict each other.
    #[error(
        "the {freedom} from {a} and from {b} differ by {}, expected at most {}{}; one of them is wrong: measure again, or leave one out",
        in_words(*freedom, *difference), in_words(*freedom, *allowed),
        lengths_m.map_or(String::new(), |[known, other]| format!(" (from the former, the {known:.3} m are {other:.3} m)"))
    )]
    Contradiction {
        /// The freedom concerned.
        freedom: FreedomName,
        /// One source.
        a: String,
        /// The second one.
        b: String,
        /// By how much: relative, rad, or units of the solution.
        difference: f64,
        /// How much their standard deviations allow.
        allowed: f64,
        /// The length that `b` is, if it is one, and what `a` makes of it [m].
        lengths_m: Option<[f64; 2]>,
    },
}

/// A difference as a person measures it; the scale's is relative or logarithmic, which is the same for small ones.
fn in_words(freedom: FreedomName, value: f64) -> String {
    match freedom {
        FreedomName::Scale => format!("{:.2} %", 100.0 * value.exp_m1()),
        FreedomName::Gravity => format!("{:.2}°", value.to_degrees()),
        FreedomName::Origin => format!("{value:.3} m"),
    }
}
