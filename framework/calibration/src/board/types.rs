//! What a calibration from boards goes by, and what it says beside the room itself.

use foveate_geometry::Camera;
use foveate_geometry::bundle::{Freedom, Optic, OpticsSigma};
use nalgebra::{Isometry3, Vector3};

use crate::solved::Solved;

/// How to go about it.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardOptions {
    /// Looks of different cameras that are at most this far apart in time are of one frame [s].
    pub frame_tolerance_s: f64,
    /// A mark that is at most this far from where the solution has it is a right one [px].
    pub inlier_px: f64,
    /// Different views that a camera needs before any of its optics are sought [–].
    pub min_views: usize,
    /// Marks that make a view [–].
    pub min_marks: usize,
    /// The board must have been tilted against the picture by this much at least, in some view, to tell focal length from distance [rad].
    pub min_tilt_rad: f64,
    /// A focal length known less well than this, relative, is refused [–].
    pub max_focal_sigma: f64,
    /// A distortion term that leaves the corner of the image uncertain by more than this is refused [px].
    pub max_corner_px: f64,
    /// When the board lay still on the floor, printed face up: its mark 0 is the origin then, and Z is up [s].
    pub floor_time_s: Option<f64>,
    /// Whether focal lengths as given are guesses: a camera whose own cannot be found is not calibrated then, and keeps what was given otherwise.
    pub focal_guessed: bool,
    /// Whether the poses given are roughly right. They then decide between answers that the pictures cannot tell apart, and nothing else.
    pub poses_guessed: bool,
    /// Each so many-th frame is held out to test the solution; 0: none. With fewer than ten frames for it, marks are held out instead.
    pub hold_out_every: usize,
}

impl Default for BoardOptions {
    fn default() -> Self {
        Self {
            frame_tolerance_s: 0.002,
            inlier_px: 3.0,
            min_views: 3,
            min_marks: 6,
            min_tilt_rad: 0.17,
            max_focal_sigma: 0.02,
            max_corner_px: 10.0,
            floor_time_s: None,
            focal_guessed: true,
            poses_guessed: false,
            hold_out_every: 8,
        }
    }
}

/// An optic that was asked for and is left as given.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{what} stays as given: {why}")]
pub struct Refused {
    /// Which.
    pub what: Optic,
    /// Why.
    pub why: Why,
}

/// Why an optic was not sought or not kept.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Why {
    /// Too few pictures of the board.
    #[error("{views} different views of the board, expected at least {needed}")]
    TooFewViews {
        /// How many different ones there are.
        views: usize,
        /// How many are needed.
        needed: usize,
    },
    /// The board was parallel to the picture in all views: its distance and the focal length cannot be told apart.
    #[error("the board was never tilted by more than {:.0} degrees against the picture, expected {:.0}", tilt_rad.to_degrees(), needed_rad.to_degrees())]
    ViewsParallel {
        /// The largest tilt [rad].
        tilt_rad: f64,
        /// The least that will do [rad].
        needed_rad: f64,
    },
    /// The board was in the middle of the picture only.
    #[error("the board was seen within {:.0} % of the way to the corners only", 100.0 * reach)]
    MiddleOnly {
        /// How far out marks were seen, over half the diagonal [–].
        reach: f64,
    },
    /// It would be found, but not well.
    #[error(
        "its standard deviation, or its effect at the corner of the image, would be {sigma:.2e}, expected at most {limit:.2e}"
    )]
    Uncertain {
        /// What it would be.
        sigma: f64,
        /// What is allowed.
        limit: f64,
    },
    /// The views are explained as well without it.
    #[error("the views are explained as well without it")]
    Unneeded,
    /// No optics explain the views.
    #[error("no optics explain the views")]
    Misfit,
}

/// A camera's optics, from its own views of the board.
#[derive(Debug, Clone, PartialEq)]
pub struct OpticsFit {
    /// The camera with these optics; its pose is of no consequence.
    pub camera: Camera,
    /// What was found rather than given.
    pub freed: Freedom,
    /// Whether these optics stay in the adjustment of all cameras, which contradict what this camera's own views tell.
    pub contradicted: bool,
    /// How well, by this camera's views alone, with the noise as it was found.
    pub sigma: OpticsSigma,
    /// What was asked for and is left as given.
    pub refused: Vec<Refused>,
    /// Pictures in which it saw the board.
    pub views: usize,
    /// How far out marks were seen, over half the diagonal of the image [–].
    pub reach: f64,
    /// By how much the board was tilted against the picture at most [rad].
    pub tilt_rad: f64,
    /// Root mean square distance of its marks [px]; NaN when nothing was sought.
    pub rms_px: f64,
}

/// Where the board was in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardPose {
    /// The frame.
    pub frame: usize,
    /// Its time [s].
    pub time_s: f64,
    /// Takes places on the board to places in the world.
    pub world_from_board: Isometry3<f64>,
}

impl BoardPose {
    /// Where the board looks, in the world.
    pub fn normal(&self) -> Vector3<f64> {
        self.world_from_board * Vector3::z()
    }
}

/// How well what was held out is foretold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoldOut {
    /// Median distance [px].
    pub median_px: f64,
    /// Root mean square distance [px].
    pub rms_px: f64,
    /// How many marks.
    pub marks: usize,
    /// Whether whole frames were held out, each mark being foretold from the other cameras; marks of frames in use otherwise.
    pub frames: bool,
}

/// A room that was solved from a board, and what is worth knowing beside it.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardSolution {
    /// Cameras, marks and observations, in metres of the board.
    pub solved: Solved,
    /// Optics by camera, each from its own views.
    pub optics: Vec<OpticsFit>,
    /// Where the board was, in frames in which a calibrated camera saw it.
    pub boards: Vec<BoardPose>,
    /// Root mean square distance of the marks in use [px].
    pub rms_px: f64,
    /// Median distance of the marks in use [px].
    pub median_px: f64,
    /// What was held out, if that is anything.
    pub hold_out: Option<HoldOut>,
    /// Cameras that could as well stand elsewhere: the board looks alike from there (turned, or mirrored from afar), and no frame decides.
    pub ambiguous: Vec<usize>,
    /// Spots without a number, with one that is not on the board, with one that is twice in a picture, or with coordinates that are none.
    pub unusable_spots: usize,
    /// Pictures whose marks do not lie as on this board.
    pub misfit_views: usize,
    /// The board is longer one way than it is said to be, as it seems.
    pub stretch: Option<Stretch>,
}

/// A board whose marks are farther apart one way than they are said to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// By how much its rows are longer than they should be beside its columns; below 0, shorter [–].
    pub by: f64,
    /// Root mean square distances of the marks in use: as the board is said to be, and with rows that are so long, with pixels of the shape that was given [px].
    pub rms_px: [f64; 2],
}

impl std::fmt::Display for Stretch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Stretch { by, rms_px: [said, stretched] } = *self;
        let which = if by > 0.0 { "longer" } else { "shorter" };
        write!(
            f,
            "squares of the board seem {:.1} % {which} along its rows than along its columns, expected as long ({said:.2} px rms as stated, {stretched:.2} px so): lengths of the calibration are off by as much. Measure the print both \
             ways, over many squares; pixels that are not square look like that, too, where the board is always held the same way",
            100.0 * by.abs()
        )
    }
}

/// Why there is no answer at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BoardError {
    /// A board that cannot be.
    #[error("a board of {found}, expected {expected}")]
    BadBoard {
        /// What was given.
        found: String,
        /// What would do.
        expected: &'static str,
    },
    /// A rule that cannot be followed.
    #[error("{rule} is {found}, expected {expected}")]
    BadRule {
        /// Which.
        rule: &'static str,
        /// Its value.
        found: f64,
        /// What would do.
        expected: &'static str,
    },
    /// A camera with a number that is none.
    #[error("camera `{camera}`: {fault}")]
    BadCamera {
        /// Its name.
        camera: String,
        /// What is wrong.
        fault: foveate_geometry::CameraError,
    },
    /// A look of a camera that does not exist.
    #[error("camera frame {camera_frame} is of camera {camera}, expected less than {cameras}")]
    NoSuchCamera {
        /// Which look.
        camera_frame: usize,
        /// Its camera.
        camera: usize,
        /// How many there are.
        cameras: usize,
    },
    /// No picture shows the board.
    #[error(
        "none of {camera_frames} pictures shows {needed} marks of the {board} ({unusable} spots have no number that is on it, or one twice)"
    )]
    NoBoardSeen {
        /// Pictures.
        camera_frames: usize,
        /// Marks that make a view.
        needed: usize,
        /// The board.
        board: String,
        /// Spots that were of no use.
        unusable: usize,
    },
    /// What is seen is another board.
    #[error(
        "in {misfit} of {views} views the marks do not lie as on the {board}: is it of that size, and are its rows and columns right?"
    )]
    OtherBoard {
        /// Views that do not fit.
        misfit: usize,
        /// All.
        views: usize,
        /// The board.
        board: String,
    },
    /// No camera saw the board tilted, so that nothing tells its focal length, and with the guessed ones no pose fits.
    #[error(
        "the {board} was never tilted by more than {:.0} degrees against the picture, and nothing else tells a focal length from a distance: tilt it by 20 to 45 degrees, in each picture to another side, or state \
         `focal_px` in the calibration",
        tilt_rad.to_degrees()
    )]
    NeverTilted {
        /// The board.
        board: String,
        /// The largest tilt [rad].
        tilt_rad: f64,
    },
    /// No camera's pictures fit a pose.
    #[error("no camera's pictures of the {board} fit a pose; are the optics given right?")]
    NoPose {
        /// The board.
        board: String,
    },
    /// No camera saw the board often enough for its optics to be found, and with those given no pose fits.
    #[error(
        "{views} of each camera's pictures show the {board} at most, expected {needed} at least, tilted differently in each: with fewer, focal lengths and lenses cannot be found"
    )]
    TooFewViews {
        /// The board.
        board: String,
        /// Pictures of the camera that has most.
        views: usize,
        /// What optics need.
        needed: usize,
    },
}
