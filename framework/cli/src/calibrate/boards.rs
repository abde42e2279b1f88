//! Calibration from a board: the arguments, the solution, and remarks about it.

use std::collections::BTreeMap;

use foveate_board::BoardSettings;
use foveate_board::detector::Detector;
use foveate_calibration::axes::transformed;
use foveate_calibration::board::{self, Board, BoardOptions, BoardSolution, Refused};
use foveate_calibration::network::{Cleaning, SolvedNetwork};
use foveate_calibration::recording::Recording;
use foveate_calibration::solved::{FixedFreedoms, ObservationRole, Solved};
use foveate_estimation::statistics::median;
use foveate_geometry::{AlignmentOptions, CameraStatus, align};
use foveate_node::Node;

use super::figures::errors;

/// The median length of a normal error in two coordinates, in standard deviations of either.
const RAYLEIGH_MEDIAN: f64 = 1.177_41;

/// Command-line arguments about the board.
#[derive(Debug, Clone, Copy, PartialEq, Default, clap::Args)]
#[command(next_help_heading = "Board")]
pub struct BoardArgs {
    /// The features are the inner corners of a chessboard with this many in a row and in a column; not needed for a rig with `board.detector`
    #[arg(long, value_name = "8x6", value_parser = two_counts, conflicts_with = "wand_mm")]
    pub chessboard: Option<[u32; 2]>,
    /// The features are the inner corners of a ChArUco board with this many squares, numbered along its rows
    #[arg(long, value_name = "4x5", value_parser = two_counts, conflicts_with_all = ["chessboard", "wand_mm"])]
    pub charuco: Option<[u32; 2]>,
    /// Side of the board's squares
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub square_mm: Option<f64>,
    /// A time at which the board lay on the floor, face up: its corner 0 becomes the origin, and Z points up
    #[arg(long, value_name = "SECONDS", value_parser = time)]
    pub board_floor: Option<f64>,
}

impl BoardArgs {
    /// The arguments as written on the command line.
    pub fn options(&self) -> Vec<String> {
        let counts = |name: &str, it: Option<[u32; 2]>| it.map(|[a, b]| format!("--{name} {a}x{b}"));
        let square = self.square_mm.map(|it| format!("--square-mm {it}"));
        let floor = self.board_floor.map(|it| format!("--board-floor {it}"));
        [counts("chessboard", self.chessboard), counts("charuco", self.charuco), square, floor]
            .into_iter()
            .flatten()
            .collect()
    }
}

/// `8x6`
fn two_counts(text: &str) -> Result<[u32; 2], String> {
    let counts = text.split_once('x').and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    counts.ok_or_else(|| format!("found {text}, expected two numbers, as 8x6"))
}

/// A time of the session [s].
fn time(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|it| (0.0..=1e9).contains(it));
    number.ok_or_else(|| format!("found {text}, expected a time of the session [s]"))
}

/// The requested board, else that of the detector; `None` for a calibration with lights.
///
/// # Errors
/// A sentence for the person.
pub fn board(args: &BoardArgs, detector: Option<&BoardSettings>) -> Result<Option<Board>, String> {
    let square_m = args.square_mm.or(detector.map(|it| it.square_mm)).map(|it| it / 1e3);
    let needed = |square_m: Option<f64>| {
        square_m
            .ok_or_else(|| "error: a board without a size, expected `--square-mm` with the side of a square".to_owned())
    };
    let made = match (args, detector) {
        (BoardArgs { chessboard: Some([columns, rows]), .. }, _) => {
            Board::chessboard(*columns, *rows, needed(square_m)?)
        }
        (BoardArgs { charuco: Some([columns, rows]), .. }, _) => Board::charuco(*columns, *rows, needed(square_m)?),
        (_, Some(it)) => Board::chessboard(it.columns, it.rows, needed(square_m)?),
        (BoardArgs { square_mm: None, board_floor: None, .. }, None) => return Ok(None),
        (_, None) => {
            let flag = if args.square_mm.is_some() { "--square-mm" } else { "--board-floor" };
            return Err(format!(
                "error: `{flag}` and no board, expected `--chessboard` or `--charuco` with it, or a rig with `{}`",
                Detector::TYPE
            ));
        }
    };
    made.map(Some).map_err(|fault| format!("error: {fault}"))
}

/// A camera network calibrated from a board.
pub struct FromBoard {
    /// Cameras, marks and observations.
    pub network: SolvedNetwork,
    /// Remarks, a sentence each.
    pub notes: Vec<String>,
    /// Why it cannot be relied upon, where another solution explains the observations equally well.
    pub open: Option<String>,
}

/// Calibrates the cameras from `board`.
///
/// The world is the board's on the floor, if a time is given at which it lay there; else that of the older calibration, if its poses count; else
/// that of the board in one frame.
///
/// # Errors
/// A sentence for the person.
pub fn solve(
    recording: &Recording,
    board: &Board,
    older: Option<FixedFreedoms>,
    solver_options: &BoardOptions,
) -> Result<FromBoard, String> {
    let BoardSolution { solved, optics, ambiguous, unusable_spots, misfit_views, boards, stretch, .. } =
        board::calibrate(recording, board, solver_options).map_err(|fault| fault.to_string())?;
    let mut notes = vec![format!("{}: seen in {} frames", board.name, boards.len())];
    let normals: Vec<_> = boards.iter().map(board::BoardPose::normal).collect();
    let mut open = None;
    if let Some(most) = board::one_angle(&normals).filter(|_| recording.cameras.iter().any(|it| it.free.focal)) {
        let sentence = format!(
            "The board was seen only at one angle, within {:.0} degrees, which does not determine focal lengths and thus distances. Tilt it by 20 to 45 degrees in different directions.",
            most.to_degrees()
        );
        // Focal lengths that stay as given are not affected.
        let is_found = solved.cameras.iter().any(|it| it.freed.focal);
        if is_found { open = Some(sentence) } else { notes.push(sentence) }
    }
    for (camera, fit) in solved.cameras.iter().zip(&optics) {
        let mut by_reason: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for Refused { what, why } in &fit.refused {
            by_reason.entry(why.to_string()).or_default().push(what.to_string());
        }
        let one = |(why, what): (String, Vec<String>)| {
            format!("optics of {} stay as given ({}): {why}", camera.name, what.join(", "))
        };
        notes.extend(by_reason.into_iter().map(one));
        if fit.contradicted {
            notes.push(format!(
                "optics of {} are those from its own views, which the views of all cameras contradict: are the cameras synchronised?",
                camera.name
            ));
        }
    }
    if !ambiguous.is_empty() {
        let names: Vec<&str> = ambiguous.iter().map(|it| solved.cameras[*it].name.as_str()).collect();
        open = Some(format!(
            "The poses of {} are ambiguous, because the board looks the same rotated by 180 degrees, or mirrored from afar: give \
             rough poses in the calibration, or rotate the board in view of them and another camera.",
            names.join(", ")
        ));
    }
    if unusable_spots > 0 {
        notes.push(format!("{unusable_spots} corners whose number is missing, not on the board, or repeated"));
    }
    notes.extend(stretch.map(|it| it.to_string()));
    if misfit_views > 0 {
        notes.push(format!("{misfit_views} pictures whose corners do not fit the board"));
    }
    if let Some(said) = solver_options.floor_time_s.filter(|_| solved.fixed.gravity.is_none()) {
        let times = || boards.iter().map(|it| it.time_s);
        let (from, until) = (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
        return Err(format!(
            "`--board-floor {said}`: no calibrated camera saw the board then, expected a time when it was seen: within {from:.2} to {until:.2} s"
        ));
    }
    let solved = match older.filter(|_| solved.fixed.origin.is_none()) {
        Some(older) => in_older_world(solved, recording, older),
        None => solved,
    };
    let sigma_px = median(&errors(&solved, ObservationRole::Used, None)).unwrap_or(f64::NAN) / RAYLEIGH_MEDIAN;
    let n = recording.cameras.len();
    let (cleaning, held) = (vec![Cleaning::default(); n], vec![Vec::new(); n]);
    Ok(FromBoard { network: SolvedNetwork { solved, cleaning, held, moved: Vec::new(), sigma_px }, notes, open })
}

/// The network aligned with the older calibration by its cameras; unchanged where they are fewer than three or on a line.
fn in_older_world(solved: Solved, recording: &Recording, older: FixedFreedoms) -> Solved {
    let known = || (0..solved.cameras.len()).filter(|it| solved.cameras[*it].status == CameraStatus::Calibrated);
    let found: Vec<_> = known().map(|it| solved.cameras[it].camera.centre()).collect();
    let given: Vec<_> = known().map(|it| recording.cameras[it].camera.centre()).collect();
    match align(&found, &given, AlignmentOptions { scale: false, robust: false }) {
        Ok(it) => {
            let fixed = FixedFreedoms { scale: solved.fixed.scale.clone(), ..older };
            transformed(&solved, &it.b_from_a, fixed)
        }
        Err(_) => solved,
    }
}

/// Turns a message about a waved light into one about a board.
pub fn of_board(text: &str) -> String {
    const WORDS: [(&str, &str); 15] = [
        (
            ": switch it on, and darken the room",
            ": hold it where they look, whole and evenly lit; are its rows and columns right?",
        ),
        ("the light", "the board"),
        ("The light", "The board"),
        ("a smoothly moving light", "a smoothly moving board"),
        ("a moving light", "a moving board"),
        ("a light at rest", "a board at rest"),
        ("give --floor-stops, --falling, --plumb or --upright", "give --board-floor"),
        ("give --floor-stops or --l-frame", "give --board-floor"),
        (": too little depth, or a flat path", ": tilt the board in different directions"),
        (": wave it ", ": hold it "),
        (": wave longer", ": hold it longer"),
        (": wave ", ": hold the board "),
        (", wave it ", ", hold it "),
        (", wave ", ", hold the board "),
        (" and wave ", " and hold the board "),
    ];
    WORDS.iter().fold(text.to_owned(), |text, (from, to)| text.replace(from, to))
}
