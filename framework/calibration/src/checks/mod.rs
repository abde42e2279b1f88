//! What re-projection cannot see, and a verdict in words.
//!
//! A calibration can fit its pixels to a third of a pixel and still be of another world: a planar path has a mirrored twin, a camera that
//! was bumped half-way agrees with itself on average, a focal length trades against depth. [`check`] looks for each of these in turn:
//!
//! | part | what it looks at |
//! |---|---|
//! | [`Fit`] | observations held out, and how far off they should be from pixel noise alone |
//! | [`Lengths`] | how a known length comes out all over the room |
//! | [`Handedness`] | points behind cameras, and the reversed world (D. Necker's cube): does it fit nearly as well? |
//! | [`Floor`] | cameras and path under a floor that is fixed |
//! | [`PathShape`] | how flat the path is |
//! | [`Links`] | cameras that hang on a single other one |
//! | [`CameraCheck`] | for each: depth, residuals over its picture, covariance of its pose, where to wave |
//! | [`Candidate`] | a camera that contradicts the rest, with the cause that explains most |
//!
//! Candidates are found one after the other: the worst is taken out, the room is adjusted without it, and the rest is looked at again,
//! so that nobody is accused for what a neighbour did.

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
    /// It works; what can be bettered is said.
    Usable,
    /// What comes out cannot be relied upon.
    Redo,
}

/// A level, and one sentence for a person that says why and what to do.
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

/// What [`check`] found. `Display` gives it as plain text.
#[derive(Debug, Clone, PartialEq)]
pub struct Checks {
    /// The unit of all lengths here: `m`, or `units` while nothing fixes the scale.
    pub unit: &'static str,
    /// Standard deviation of a pixel's coordinate, from the residuals of the whole room [px].
    pub sigma_px: f64,
    /// Observations held out.
    pub fit: Fit,
    /// The known length, where one was given.
    pub lengths: Option<Lengths>,
    /// Whether the world is mirrored.
    pub handedness: Handedness,
    /// What is under the floor.
    pub floor: Floor,
    /// The path of the light.
    pub path: PathShape,
    /// Who sees the light together with whom.
    pub links: Links,
    /// By camera, in the order of the room.
    pub cameras: Vec<CameraCheck>,
    /// Cameras that contradict the rest, the worst first.
    pub candidates: Vec<Candidate>,
    /// All of it in words.
    pub verdict: Verdict,
}

impl Checks {
    /// Adds what an older calibration of the same cameras tells of a room that was found without it: all pictures are mirrored, or two cameras have
    /// each other's names. `beside` is what a comparison with it came to.
    pub fn add_beside_older(&mut self, beside: &Comparison, options: &CheckOptions) {
        let numbers = |name: &String| self.cameras.iter().position(|it| it.name == *name);
        let told = |camera: usize, cause: Cause, sentence: &str| {
            let judgement = Judgement::new(Level::Redo, sentence);
            Candidate { judgement, camera, cause, misfit: f64::INFINITY, explained: 1.0 }
        };
        let mut found = Vec::new();
        if beside.is_mirrored() {
            let sentence = "The room is the mirror image of the older calibration: the pictures of all cameras are mirrored, left to right or top to bottom, or were when that was made; record them as they are.";
            found.extend(beside.names().iter().filter_map(numbers).map(|it| told(it, Cause::Mirrored, sentence)));
        }
        if let Some([first, second]) = beside.exchanged() {
            let sentence = format!(
                "Cameras {first} and {second} stand in each other's places beside the older calibration: exchange their names or cables."
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

/// Looks at `solved`, and at the known length of `lengths` where there is one, for what a low re-projection error hides.
///
/// The same input gives the same answer; nothing is random that is not seeded by [`CheckOptions::seed`].
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
