//! Options, results and errors of calibration from boards.

use foveate_geometry::Camera;
use foveate_geometry::bundle::{Freedom, Optic, OpticsSigma};
use nalgebra::{Isometry3, Vector3};

use crate::solved::Solved;

/// Options of [`calibrate`](super::calibrate).
#[derive(Debug, Clone, PartialEq)]
pub struct BoardOptions {
    /// Pictures of different cameras that are at most this far apart in time are of one frame [s].
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
    /// A time at which the board lay on the floor, printed face up: its mark 0 then becomes the origin, and Z is up [s].
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

/// A parameter of the optics that was to be found and stays as given.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{what} stays as given: {why}")]
pub struct Refused {
    /// What the number is.
    pub what: Optic,
    /// The reason.
    pub why: OpticsRefusal,
}

/// Why a parameter of the optics was not estimated or not kept.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum OpticsRefusal {
    /// Too few pictures of the board.
    #[error("{views} different views of the board, expected at least {needed}")]
    TooFewViews {
        /// How many different ones there are.
        views: usize,
        /// Number that is needed.
        needed: usize,
    },
    /// The board was parallel to the picture in all views: its distance and the focal length cannot be separated.
    #[error("the board was never tilted by more than {:.0} degrees against the picture, expected {:.0}", tilt_rad.to_degrees(), needed_rad.to_degrees())]
    ViewsParallel {
        /// The largest tilt [rad].
        tilt_rad: f64,
        /// The least that will do [rad].
        needed_rad: f64,
    },
    /// The board was in the middle of the picture only.
    #[error("the board was seen only within {:.0} % of the way to the corners", 100.0 * reach)]
    MiddleOnly {
        /// How far out marks were seen, over half the diagonal [–].
        reach: f64,
    },
    /// Its standard deviation would be too large.
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
    /// The camera with these optics; its pose has no meaning.
    pub camera: Camera,
    /// What was found rather than given.
    pub freed: Freedom,
    /// Whether these optics, from the camera's own views, are kept although the adjustment of all cameras contradicts them.
    pub contradicted: bool,
    /// Their standard deviations from this camera's views alone, with the estimated noise.
    pub sigma: OpticsSigma,
    /// Parameters that were to be found and stay as given.
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

/// How well held-out observations are predicted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoldOut {
    /// Median distance [px].
    pub median_px: f64,
    /// Root mean square distance [px].
    pub rms_px: f64,
    /// How many marks.
    pub marks: usize,
    /// Whether whole frames were held out, each mark being predicted from the other cameras; otherwise marks of frames in use.
    pub frames: bool,
}

/// A camera network calibrated from a board, with details of the solution.
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
    /// Cameras with two possible poses: the board looks the same from both (turned, or mirrored from afar), and no frame decides.
    pub ambiguous: Vec<usize>,
    /// Unusable spots: without a number, with one that is not on the board or twice in a picture, or with coordinates that are not finite.
    pub unusable_spots: usize,
    /// Pictures whose marks do not fit this board.
    pub misfit_views: usize,
    /// Set where the board seems to be stretched in one direction.
    pub stretch: Option<Stretch>,
}

/// A board that is stretched in one direction, as printers do.
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
            "squares of the board seem {:.1} % {which} along its rows than along its columns, expected the same length ({said:.2} px rms as stated, {stretched:.2} px stretched): lengths of the calibration are off by as much. Measure the print in \
             both directions, over many squares; pixels that are not square look the same where the board is always held the same way",
            100.0 * by.abs()
        )
    }
}

/// Why nothing could be calibrated from the board.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BoardError {
    /// A board of impossible size.
    #[error("a board of {found}, expected {expected}")]
    BadBoard {
        /// What was given.
        found: String,
        /// What would do.
        expected: &'static str,
    },
    /// An option outside its range.
    #[error("{option} is {found}, expected {expected}")]
    BadOption {
        /// Name of the option.
        option: &'static str,
        /// The value that was found.
        found: f64,
        /// What would do.
        expected: &'static str,
    },
    /// A camera with a parameter that is not finite.
    #[error("camera `{camera}`: {fault}")]
    BadCamera {
        /// Name of the camera.
        camera: String,
        /// What is wrong.
        fault: foveate_geometry::CameraError,
    },
    /// A picture of a camera that does not exist.
    #[error("camera frame {camera_frame} is of camera {camera}, expected less than {cameras}")]
    NoSuchCamera {
        /// Which look.
        camera_frame: usize,
        /// Its camera.
        camera: usize,
        /// Number of cameras.
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
    /// The pictures show another board.
    #[error(
        "in {misfit} of {views} views the marks do not lie as on the {board}: is it of that size, and are its rows and columns right?"
    )]
    OtherBoard {
        /// Views that do not fit.
        misfit: usize,
        /// Number of all views.
        views: usize,
        /// The board.
        board: String,
    },
    /// No camera saw the board tilted, so focal lengths are undetermined, and with the guessed ones no pose fits.
    #[error(
        "the {board} was never tilted by more than {:.0} degrees against the picture, so focal length and distance cannot be separated: tilt it by 20 to 45 degrees, to another side in each picture, or state \
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
