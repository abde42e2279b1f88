//! Checks of a calibration that a low re-projection error does not replace, and a verdict in words.
//!
//! A calibration can fit its pixels to a third of a pixel and still be wrong: a planar path has a mirrored twin, a camera that
//! was bumped half-way agrees with itself on average, a focal length trades against depth. [`check`] tests each of these in turn:
//!
//! | part | what it looks at |
//! |---|---|
//! | [`Fit`] | residuals of held-out observations, compared with pixel noise |
//! | [`Lengths`] | errors of a known length over the room |
//! | [`Handedness`] | points behind cameras, and whether the reversed solution (D. Necker's cube) fits nearly as well |
//! | [`Floor`] | cameras and path below the floor |
//! | [`PathShape`] | how flat the path is |
//! | [`Links`] | cameras that are linked to only one other |
//! | [`CameraCheck`] | for each camera: depth, residuals over its picture, covariance of its pose, where to wave |
//! | [`Candidate`] | a camera that contradicts the rest, with the cause that explains most |
//!
//! Candidates are found one after the other: the worst is taken out, the network is adjusted without it, and the rest is checked again,
//! so that no camera is diagnosed for the fault of another.

mod camera;
mod candidates;
mod fit;
mod graph;
mod gross_error;
mod handed;
mod maps;
pub(crate) mod models;
mod network;
mod options;
mod place;
mod text;
mod verdict;

pub use self::camera::{CameraCheck, DepthRange, PoseQuality};
pub use self::candidates::Candidate;
pub use self::fit::{Fit, LengthSample, Lengths};
pub use self::graph::Links;
pub use self::handed::Handedness;
pub use self::maps::{MapCell, Pattern, ResidualMap};
pub use self::options::CheckOptions;
pub use self::place::{Floor, PathShape};
pub use self::verdict::Verdict;
pub use crate::cause::Cause;
use crate::comparison::Comparison;
use crate::solved::Solved;

/// How good something is; the worse, the greater.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Level {
    /// Nothing to be done.
    #[default]
    Good,
    /// Usable; the sentence says what could be better.
    Usable,
    /// The calibration cannot be relied upon.
    Redo,
}

/// The level of one check, and one sentence that says why and what to do.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Judgement {
    /// How good it is.
    pub level: Level,
    /// What was found and what to do about it.
    pub sentence: String,
}

impl Judgement {
    fn new(level: Level, sentence: impl Into<String>) -> Self {
        Self { level, sentence: sentence.into() }
    }
}

/// All results of [`check`]. `Display` gives them as plain text.
#[derive(Debug, Clone, PartialEq)]
pub struct Checks {
    /// The unit of all lengths here: `m`, or `units` while nothing fixes the scale.
    pub unit: &'static str,
    /// Standard deviation of a pixel's coordinate, from the residuals of the whole room [px].
    pub sigma_px: f64,
    /// Residuals of used and held-out observations.
    pub fit: Fit,
    /// The known length, where one was given.
    pub lengths: Option<Lengths>,
    /// Whether the world is mirrored.
    pub handedness: Handedness,
    /// Cameras and path below the floor.
    pub floor: Floor,
    /// The path of the light.
    pub path: PathShape,
    /// The view graph: which cameras see the light together.
    pub links: Links,
    /// By camera, in the order of the room.
    pub cameras: Vec<CameraCheck>,
    /// Cameras that contradict the rest, the worst first.
    pub candidates: Vec<Candidate>,
    /// The summary in words.
    pub verdict: Verdict,
}

impl Checks {
    /// Adds findings from comparison with an older calibration of the same cameras: all pictures are mirrored, or two cameras have
    /// swapped names. `beside` is the result of the comparison.
    pub fn add_beside_older(&mut self, beside: &Comparison, options: &CheckOptions) {
        let numbers = |name: &String| self.cameras.iter().position(|it| it.name == *name);
        let told = |camera: usize, cause: Cause, sentence: &str| {
            let judgement = Judgement::new(Level::Redo, sentence);
            Candidate { judgement, camera, cause, misfit: f64::INFINITY, explained: 1.0 }
        };
        let mut found = Vec::new();
        if beside.is_mirrored() {
            let sentence = "The calibration is the mirror image of the older one: the pictures of all cameras are mirrored, left to right or top to bottom, or were for the older one; record them unmirrored.";
            found.extend(beside.names().iter().filter_map(numbers).map(|it| told(it, Cause::Mirrored, sentence)));
        }
        if let Some([first, second]) = beside.exchanged() {
            let sentence = format!(
                "Cameras {first} and {second} are swapped relative to the older calibration: swap their names or cables."
            );
            let both = numbers(first).zip(numbers(second));
            let swapped = |(camera, with)| told(camera, Cause::Swapped { with, since_s: None }, &sentence);
            found.extend(both.into_iter().flat_map(|(a, b)| [(a, b), (b, a)]).map(swapped));
        }
        found.retain(|it| self.candidates.iter().all(|known| known.camera != it.camera || known.cause != it.cause));
        if !found.is_empty() {
            self.candidates.extend(found);
            self.verdict = verdict::verdict(self, options);
        }
    }
}

/// Checks the calibration `solved`, with samples of a known length where there are any, for errors that a low re-projection error hides.
///
/// Deterministic: random draws are seeded by [`CheckOptions::seed`].
pub fn check(solved: &Solved, lengths: Option<&[LengthSample]>, options: &CheckOptions) -> Checks {
    let network = network::Room::new(solved, options);
    let fit = fit::fit(&network);
    let lengths = lengths.and_then(|it| fit::lengths(it, options));
    let handedness = handed::handedness(&network);
    let floor = place::floor(&network);
    let path = place::path(&network);
    let links = graph::links(&network);
    let is_mirrored = handedness.judgement.level == Level::Redo;
    let candidates = candidates::candidates(&network, is_mirrored);
    let cameras = (0..solved.cameras.len()).map(|it| camera::camera(&network, it)).collect();
    let mut checks = Checks {
        unit: network.unit(),
        sigma_px: network.sigma_px,
        fit,
        lengths,
        handedness,
        floor,
        path,
        links,
        cameras,
        candidates,
        verdict: Verdict::default(),
    };
    checks.verdict = verdict::verdict(&checks, options);
    checks
}
