//! `foveate calibrate`: a rig's detectors run, what they see of a waved light or a board becomes a calibration with a verdict.

mod conclude;
mod of_session;
mod plan;

use std::path::PathBuf;
use std::sync::Arc;

use clap::ValueEnum;
use foveate_calibration::axes::{self, AxesArgs, AxesOptions, Given};
use foveate_calibration::board::{BoardClocksError, BoardOptions, board_on_one_clock};
use foveate_calibration::checks::{CheckOptions, LengthSample, Level, check};
use foveate_calibration::clocks::ClockOptions;
use foveate_calibration::comparison::compare;
use foveate_calibration::network::{self, CalibrationTarget, NetworkOptions, SolvedNetwork};
use foveate_calibration::path::PathOptions;
use foveate_calibration::solved::{FixedFreedoms, ObservationRole, Solved, SolvedCamera};
use foveate_calibration::wand::{self, RefineOptions, Wand, WandObservation, WandSample};
use foveate_capture::labels::mirrored_pairs;
use foveate_geometry::CameraStatus;
use foveate_node::Registry;
use foveate_rig::graph::Graph;
use foveate_scene::{Calibration, Draft, LengthUnit};
use foveate_web::Listen;

use self::conclude::{More, check_writable, conclude};
use self::of_session::{OfSession, of_session};
use self::plan::Plan;
use super::seconds;
use crate::calibrate::boards::{self, BoardArgs};
use crate::calibrate::capture::{self, Captured};
use crate::calibrate::path::{self, PathArgs};
use crate::calibrate::places::{self, Known};
use crate::calibrate::selected::Selected;
use crate::calibrate::shown::Shown;
use crate::calibrate::words;
use crate::outcome::{harmless, lost};
use crate::progress::Waiting;
use crate::{exit, interrupt, results};

/// `foveate calibrate`
#[derive(Debug, clap::Args)]
pub struct CalibrateArgs {
    /// The rig (TOML), or a session (MCAP): its features, or what a detector finds in its pictures
    #[arg(value_name = "RIG|SESSION", value_hint = clap::ValueHint::FilePath)]
    rig: PathBuf,
    /// Use none of the poses in the rig's calibration, only names, picture sizes and the optics that it states
    #[arg(long)]
    from_nothing: bool,
    /// Which optics of the cameras to estimate, whatever the calibration states [default: those that it does not state]
    #[arg(long, value_enum)]
    optics: Option<Optics>,
    /// The node whose features to take, where a rig has several
    #[arg(long, value_name = "NODE")]
    from: Option<String>,
    /// The cameras to calibrate, by patterns parted by commas; those with `!` leave cameras out: 'wide-*,!wide-3' [default: all]
    #[arg(long, value_name = "PATTERNS")]
    cameras: Option<String>,
    /// Folder for the results; files of the same names in it are overwritten [default: results/RIG-N, the first free N]
    #[arg(long, value_name = "DIR", value_hint = clap::ValueHint::DirPath)]
    out: Option<PathBuf>,
    /// Write report.html: the room in 3D, residuals, convergence, coverage
    #[arg(long)]
    report: bool,
    /// In the report, also solve from a poor start, path and cameras in turn as [Davis 2002 §3.2], beside both together: Figure 25
    #[arg(long, requires = "report")]
    alternating: bool,
    /// Report how far the cameras are from their places in another calibration of the same cameras (any form that a rig may name)
    #[arg(long, value_name = "FILE", value_hint = clap::ValueHint::AnyPath)]
    compare: Option<PathBuf>,
    /// Replace the calibration that the rig names, unless the verdict is "redo"; the older one is kept beside it
    #[arg(long)]
    write: bool,
    /// An observation is right when at most this far from where its point is seen [px]
    #[arg(long, value_name = "PX", default_value_t = INLIER_PX, value_parser = pixels)]
    inlier_px: f64,
    /// The cameras share no clock: find each one's offset too, from the path of the light, the wand or the board
    #[arg(long, requires = "from_nothing")]
    unsynchronised: bool,
    /// Clocks are at most this far apart [s]
    #[arg(long, value_name = "SECONDS", requires = "unsynchronised", default_value_t = 0.5, value_parser = seconds)]
    max_offset: f64,
    /// Wave a wand with two lights this far apart
    #[arg(long, value_name = "MM", help_heading = "Scale and axes", allow_negative_numbers = true, value_parser = length_mm)]
    wand_mm: Option<f64>,
    /// A known distance, as wide-1:wide-2=3.2m; a place is a camera, @2 (where the light stood still for the second time) or @12.5..13.1 (where it was then) [s]
    #[arg(long, value_name = "A:B=LENGTH", help_heading = "Scale and axes")]
    distance: Vec<String>,
    /// The first three times that the light stood still, it lay on the floor: at the origin, on the X axis, elsewhere
    #[arg(long, help_heading = "Scale and axes")]
    floor_stops: bool,
    /// Height of the light's centre above the floor at those stops
    #[arg(
        long,
        value_name = "MM",
        requires = "floor_stops",
        help_heading = "Scale and axes",
        allow_negative_numbers = true
    )]
    floor_height_mm: Option<f64>,
    /// A place of known coordinates [m], at least three times, as @1=0,0,0 @2=1,0,0 @3=0,1,0
    #[arg(long, value_name = "PLACE=X,Y,Z", help_heading = "Scale and axes")]
    l_frame: Vec<String>,
    /// The light falls freely within this span of time [s]
    #[arg(long, value_name = "FROM..UNTIL", help_heading = "Scale and axes")]
    falling: Vec<String>,
    /// Two places on a plumb line, the upper one first
    #[arg(long, value_name = "TOP:BOTTOM", help_heading = "Scale and axes")]
    plumb: Option<String>,
    /// The cameras are mounted without roll: the vertical from that, roughly
    #[arg(long, help_heading = "Scale and axes")]
    upright: bool,
    #[command(flatten)]
    board: BoardArgs,
    #[command(flatten)]
    measured: PathArgs,
    /// End the session after so many seconds of its own time
    #[arg(long, value_name = "SECONDS", value_parser = seconds, allow_negative_numbers = true)]
    duration: Option<f64>,
    /// Seed of everything random, in place of the rig's
    #[arg(long)]
    seed: Option<u64>,
    /// Run on the wall clock; a rig with a camera always does
    #[arg(long)]
    live: bool,
    /// In a run on the wall clock, continue until Ctrl-C or the rig's end even when the light has covered the volume
    #[arg(long)]
    keep_going: bool,
    /// Show coverage as it grows on a web page, also on a phone in the room, and then the verdict
    #[arg(long)]
    console: bool,
    /// Where that page is served: a port of this machine, or an address at which other computers find it too, with the token that is printed then
    /// [default: 127.0.0.1, port 8017 or the next one that is free]
    #[arg(long, value_name = "[HOST:]PORT", requires = "console")]
    listen: Option<Listen>,
    /// Go on serving it after the verdict, until Ctrl-C
    #[arg(long, requires = "console")]
    stay: bool,
    /// Show no progress
    #[arg(long, short)]
    quiet: bool,
}

/// An observation is right when at most so far from where its point is seen, unless the command line says otherwise [px].
const INLIER_PX: f64 = 3.0;
/// The length of a wand is taken as right to this, standard deviation [m].
const WAND_SIGMA_M: f64 = 2e-4;

/// What is found of each camera's optics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Optics {
    /// Nothing: they are right
    Known,
    /// The focal length; the rest is right
    Focal,
    /// Focal length and radial distortion
    Lens,
    /// Also principal point, decentering and the shape of the pixels
    All,
}

impl Optics {
    /// As it is written on the command line.
    fn name(self) -> &'static str {
        match self {
            Optics::Known => "known",
            Optics::Focal => "focal",
            Optics::Lens => "lens",
            Optics::All => "all",
        }
    }
}

/// A distance in pixels on the command line.
fn pixels(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|it| *it > 0.0 && *it <= 1000.0);
    number.ok_or_else(|| format!("found {text}, expected a number above 0, to 1000 [px]"))
}

/// The length of a wand on the command line.
fn length_mm(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|it| *it > 0.0 && *it <= 1e5);
    number.ok_or_else(|| format!("found {text}, expected the length of the wand, a number above 0, to 100000 [mm]"))
}

pub(super) fn run(args: &CalibrateArgs, registry: &Registry) -> u8 {
    let shown = args.console.then(|| Arc::new(Shown::new(args.listen.clone(), args.quiet)));
    let code = match calibrate(args, registry, shown.as_ref()) {
        Ok(code) => {
            // Of a path that was measured the terminal has the verdict.
            if let Some(shown) = &shown {
                shown.begin("done");
            }
            code
        }
        Err(sentences) => {
            eprintln!("{}", sentences.trim_end());
            if let Some(shown) = &shown {
                shown.conclude("failed", sentences.trim_end());
            }
            exit::INPUT
        }
    };
    if let Some(shown) = shown.filter(|_| args.stay) {
        shown.stay();
    }
    interrupt::caught().map_or(code, |it| it.code)
}

fn calibrate(args: &CalibrateArgs, registry: &Registry, shown: Option<&Arc<Shown>>) -> Result<u8, String> {
    let givens = axes_args(args).givens().map_err(|fault| format!("error: {fault}"))?;
    let session = of_session(args)?;
    let rig = OfSession::rig(&session, &args.rig);
    let (path, draft) = capture::draft(rig)?;
    if args.write {
        check_writable(&path)?;
    }
    let measured = args.measured.read()?;
    let draft = if measured.is_some() { path::without_offsets(&draft) } else { draft };
    let selected = Selected::new(args.cameras.as_deref(), &draft.calibration)?;
    let used = selected.of(&draft);
    let check_places =
        |lights: Option<u32>, duration_s: Option<f64>| check_places(&givens, &draft, &used, lights, duration_s);
    check_places(None, args.duration)?;
    let plan = if measured.is_some() { Plan::of_path(args, &used) } else { Plan::new(args, &used)? };
    if let Some(note) = plan.doubtful_pixels(&used) {
        eprintln!("{note}");
    }
    let other =
        args.compare.as_deref().map(Calibration::load).transpose().map_err(|error| format!("error: {error}"))?;
    let stem = args.rig.file_stem().map_or_else(|| "rig".to_owned(), |it| it.to_string_lossy().into_owned());
    let folder = results::make_folder(args.out.as_deref(), &stem).map_err(|it| format!("error: {it}"))?;
    let how = capture::CaptureOptions {
        node: args.from.clone().filter(|_| session.is_none()),
        duration_s: args.duration,
        seed: args.seed,
        live: args.live,
        quiet: args.quiet,
        stop_when_enough: !args.keep_going,
        board: args.board,
        coverage: Default::default(),
        numbers: selected.numbers(draft.calibration.cameras.len()),
        shown: shown.cloned(),
    };
    let check_graph = |graph: &Graph| {
        let has_labels = graph.instances.iter().any(|it| LABELLED.contains(&it.node_type.name));
        let lights = if args.wand_mm.is_some() { Some(2) } else { Some(1).filter(|_| !has_labels) };
        check_places(lights, graph.duration.map(|it| it.as_s()))
    };
    let captured = capture::capture(rig, registry, &draft, plan.cameras.clone(), &folder, &how, &check_graph)?;
    captured.ended_early.iter().for_each(|it| eprintln!("{it}"));
    let remarks = captured.outcome.report.remarks.iter().map(|it| format!("note: {it}"));
    remarks.chain(lost(&captured.outcome, "")).for_each(|it| eprintln!("{}", harmless(&it)));
    let board = captured.board.as_ref();
    let observations = folder.join(capture::OBSERVATIONS);
    interrupt::ends(format!("stopped by you before the end; what was seen is in {}", observations.display()));
    if let Some(asked) = &measured {
        let solving = Waiting::new("searching poses and clocks", args.quiet);
        let options = PathOptions {
            inlier_px: args.inlier_px,
            focal_unknown: plan.focal_unknown,
            seed: args.seed.unwrap_or(1),
            ..PathOptions::default()
        };
        let ending = path::Ending {
            rig: &args.rig,
            older: (&path, &draft),
            folder: &folder,
            other: other.as_ref().zip(args.compare.as_deref()),
            write: args.write,
            report: args.report,
        };
        let solved = path::solve(asked, &captured.recording, &options);
        drop(solving);
        return path::conclude(&solved, asked, &options, &ending);
    }
    let solving = Waiting::new("solving the room", args.quiet);
    let fixed = fixed_before(&draft.calibration, &plan);
    let options = NetworkOptions {
        inlier_px: args.inlier_px,
        focal_unknown: plan.focal_unknown,
        seed: args.seed.unwrap_or(1),
        ..NetworkOptions::default()
    };
    let mirrored = mirrored_pairs(&captured.labels);
    let has_labels = words::n_labels(&captured.recording) > 1;
    let sought = match args.wand_mm {
        Some(_) => CalibrationTarget::Wand,
        None if has_labels && !args.unsynchronised => CalibrationTarget::Labels { mirrored: &mirrored },
        None => CalibrationTarget::Light,
    };
    let clock_options = ClockOptions {
        max_offset_s: args.max_offset,
        inlier_px: options.inlier_px,
        sigma_px: options.sigma_px,
        seed: options.seed,
        ..ClockOptions::default()
    };
    let (mut notes, mut open) = (Vec::new(), None);
    let solve = match (plan.from_nothing, &board) {
        (_, Some(board)) => {
            let options = BoardOptions {
                inlier_px: args.inlier_px,
                focal_guessed: plan.focal_unknown,
                poses_guessed: !plan.from_nothing,
                floor_time_s: args.board.board_floor,
                ..BoardOptions::default()
            };
            let refused = |fault: &dyn std::fmt::Display| format!("error: {fault}");
            if args.unsynchronised {
                let shared = board_on_one_clock(&captured.recording, board, &options, &clock_options);
                let shared = shared.map_err(|fault| match fault {
                    BoardClocksError::Clocks(fault) => {
                        boards::of_board(&refused(&words::no_clocks(&fault, &captured.recording)))
                    }
                    other => refused(&other),
                })?;
                let found = boards::solve(&shared.recording, board, None, &options).map_err(|fault| refused(&fault))?;
                let network = shared.of_room(found.network);
                notes = words::clocks(&network, &captured.recording).iter().map(|it| boards::of_board(it)).collect();
                (notes, open) = (notes.into_iter().chain(found.notes).collect(), found.open);
                Ok(network.network)
            } else {
                let found = boards::solve(&captured.recording, board, (!plan.from_nothing).then_some(fixed), &options);
                let found = found.map_err(|fault| refused(&fault) + &clocks_hint(args, &captured))?;
                (notes, open) = (found.notes, found.open);
                Ok(found.network)
            }
        }
        (true, None) if args.unsynchronised => {
            let found = match sought {
                CalibrationTarget::Wand => network::unsynchronised_wand(&captured.recording, &clock_options, &options),
                _ => network::unsynchronised_from_nothing(&captured.recording, &clock_options, &options),
            };
            let found = found.map_err(|fault| {
                let reason = words::not_synchronised(&fault, &captured.recording);
                format!("error: {reason}{}", hint(args, &captured))
            })?;
            notes = words::clocks(&found, &captured.recording);
            Ok(found.network)
        }
        (true, None) => network::from_nothing(&captured.recording, sought, &options),
        (false, None) => network::recalibrate(&captured.recording, sought, &fixed, &options),
    };
    let mut solved = solve.map_err(|fault| format!("error: {fault}{}", hint(args, &captured)))?;
    if let CalibrationTarget::Labels { .. } = sought {
        notes.extend(words::swapped(&captured.recording, &solved.solved, &captured.labels));
    } else if args.wand_mm.is_none() && board.is_none() {
        let left_out = solved.solved.cameras.iter().enumerate().filter(|it| it.1.status != CameraStatus::Calibrated);
        notes.extend(words::several_spots(&captured.recording, left_out.map(|it| it.0)));
    }
    let lengths = match args.wand_mm {
        Some(length_mm) => {
            let measured = measured_by_wand(&mut solved, length_mm);
            Some(measured.map_err(|fault| fault + &clocks_hint(args, &captured))?)
        }
        None => None,
    };
    if !givens.is_empty() {
        let found = axes::fix(&solved.solved, &givens, &AxesOptions::default());
        solved.solved = found.map_err(|fault| format!("error: {fault}"))?.solved;
    }
    let is_measured = board.is_some() || args.wand_mm.is_some();
    let lengths_differ = match is_measured && !plan.from_nothing {
        true => other_lengths(&solved.solved, &draft.calibration)?,
        false => None,
    };
    drop(solving);
    if let Some(shown) = shown {
        shown.begin("checking");
    }
    let checking = Waiting::new("checking it", args.quiet);
    // The marks of a board lie in a plane, and each view is judged by itself whether it holds the optics.
    let check_options = match &board {
        Some(_) => CheckOptions { flatness: [0.0; 2], ..CheckOptions::default() },
        None => CheckOptions::default(),
    };
    let mut checks = check(&solved.solved, lengths.as_deref(), &check_options);
    let has_older_poses = draft.unknown.values().all(|it| !it.pose);
    let beside_older = has_older_poses && plan.from_nothing && board.is_none();
    if let Some(beside) = compare(&solved.solved, &draft.calibration).ok().filter(|_| beside_older) {
        checks.add_beside_older(&beside, &check_options);
    }
    drop(checking);
    if let Some(sentence) = open {
        checks.verdict.level = Level::Redo;
        checks.verdict.sentences.insert(0, sentence);
    }
    if board.is_some() {
        checks.verdict.sentences.iter_mut().for_each(|it| *it = boards::of_board(it));
    }
    if let Some(shown) = shown {
        shown.conclude(&checks.verdict.level.to_string(), &checks.to_string());
    }
    let words: String = notes.iter().map(|it| format!("{it}\n")).collect();
    let older = Some(draft.calibration.clone());
    let is_adjusted = !plan.from_nothing;
    let words = words + &lengths_differ.unwrap_or_default();
    let mut more = More { words, is_board: board.is_some(), older, has_older_poses, is_adjusted, ..More::default() };
    if let (Some(other), Some(path)) = (other, &args.compare) {
        more.add(compare(&solved.solved, &other), path);
    }
    conclude(args, &path, &folder, &captured, &solved, &checks, &more)
}

/// Nodes whose features may have labels: statements about a light may apply to any of them.
const LABELLED: [&str; 4] =
    ["capture.detections", "board.detector", "structured_light.corners", "structured_light.points"];

/// Refuses options for scale and axes that no capture can satisfy.
fn check_places(
    givens: &[Given],
    draft: &Draft,
    used: &Draft,
    lights: Option<u32>,
    duration_s: Option<f64>,
) -> Result<(), String> {
    let names = |it: &Draft| -> Vec<String> { it.calibration.cameras.iter().map(|it| it.name.clone()).collect() };
    let (all, those) = (names(draft), names(used));
    let (all, those): (Vec<&str>, Vec<&str>) =
        (all.iter().map(String::as_str).collect(), those.iter().map(String::as_str).collect());
    places::check(givens, &Known { cameras: &all, used: &those, lights, duration_s })
}

/// Adjusts the room with the length of the wand; how that length comes out at moments that were held out.
fn measured_by_wand(network: &mut SolvedNetwork, length_mm: f64) -> Result<Vec<LengthSample>, String> {
    let refused = |fault: &dyn std::fmt::Display| format!("error: the wand: {fault}");
    let wand = Wand { ends: [0, 1], length_m: length_mm / 1e3, sigma_m: WAND_SIGMA_M };
    let options = RefineOptions { sigma_px: network.sigma_px, ..RefineOptions::default() };
    let refined = wand::refine(&network.solved, &wand, &options).map_err(|fault| refused(&fault))?;
    network.solved = refined.solved;
    // Those that the adjustment knew of have the right length because they were made to.
    let held_out_points: Vec<WandObservation> = network.wand_observations(ObservationRole::HeldOut);
    let measured = wand::intersect(&network.solved.cameras, &held_out_points);
    let samples = wand::lengths(&measured, wand.ends).map_or_else(|_| refined.before.samples, |it| it.samples);
    let error = |it: &WandSample| LengthSample { at: it.middle, relative_error: it.length / wand.length_m - 1.0 };
    Ok(samples.iter().map(error).collect())
}

/// What to do about a room that cannot be solved, judged by what was seen.
fn hint(args: &CalibrateArgs, captured: &Captured) -> String {
    let all = 0..captured.recording.cameras.len();
    let is_light = args.wand_mm.is_none() && words::n_labels(&captured.recording) <= 1;
    let several = words::several_spots(&captured.recording, all).filter(|_| is_light);
    let missing = captured.coverage.state().missing;
    let lines = several.into_iter().chain(missing.iter().take(3).map(ToString::to_string));
    let lines: String = lines.map(|it| format!("\n  {it}")).collect();
    clocks_hint(args, captured) + &lines
}

/// Whether the cameras may share no clock, judged by what was seen.
fn clocks_hint(args: &CalibrateArgs, captured: &Captured) -> String {
    let apart = words::never_together(&captured.recording).filter(|_| !args.unsynchronised);
    apart.map(|it| format!("\n  {it}")).unwrap_or_default()
}

fn axes_args(args: &CalibrateArgs) -> AxesArgs {
    AxesArgs {
        wand_mm: args.wand_mm,
        distances: args.distance.clone(),
        floor_stops: args.floor_stops,
        n_floor_stops: None,
        floor_height_mm: args.floor_height_mm,
        l_frame: args.l_frame.clone(),
        falling: args.falling.clone(),
        plumb: args.plumb.clone(),
        upright: args.upright,
    }
}

/// Lengths of two calibrations that differ by a larger part of them count as different [–].
const SAME_LENGTH: f64 = 0.02;
/// Lengths that differ by a larger factor are no older calibration's roughness: the side of a square is wrong, or an inch was taken for
/// something else [–].
const CONTRADICTION: f64 = 1.5;

/// What to know, or a refusal, where metres by a board or a wand are not those of the older calibration.
fn other_lengths(solved: &Solved, older: &Calibration) -> Result<Option<String>, String> {
    let Some(older_from_new) = compare(solved, older).ok().map(|it| it.scale()) else { return Ok(None) };
    if older.length_unit != LengthUnit::Metre || (older_from_new - 1.0).abs() < SAME_LENGTH {
        return Ok(None);
    }
    let known: Vec<&SolvedCamera> = solved.cameras.iter().filter(|it| it.status == CameraStatus::Calibrated).collect();
    let pairs =
        known.iter().enumerate().flat_map(|(index, first)| known[index + 1..].iter().map(move |it| (*first, *it)));
    let distance = |it: &(&SolvedCamera, &SolvedCamera)| (it.0.camera.centre() - it.1.camera.centre()).norm();
    let Some(pair) = pairs.max_by(|a, b| distance(a).total_cmp(&distance(b))) else { return Ok(None) };
    let [new_m, older_m] = [distance(&pair), distance(&pair) * older_from_new];
    let [first, second] = [&pair.0.name, &pair.1.name];
    let both =
        format!("{first} and {second} are {new_m:.3} m apart now, and {older_m:.3} m apart in the older calibration");
    if (1.0 / CONTRADICTION..CONTRADICTION).contains(&older_from_new) {
        return Ok(Some(format!("lengths differ from the older calibration: {both}\n")));
    }
    Err(format!(
        "error: lengths contradict each other: {both}; check the length of the wand or the side of the squares, or say --from-nothing"
    ))
}

/// What fixes scale and axes of the calibration that is to be adjusted.
fn fixed_before(older: &Calibration, plan: &Plan) -> FixedFreedoms {
    if plan.from_nothing {
        return FixedFreedoms::default();
    }
    // A file of ours says what fixes each freedom; what it does not say is open.
    let is_ours = older.provenance.is_some();
    let provenance = older.provenance.clone().unwrap_or_default();
    let inherited = || foveate_scene::Fixed { by: "the older calibration".to_owned(), sigma: None };
    let is_metric = older.length_unit == LengthUnit::Metre;
    FixedFreedoms {
        scale: provenance.scale.or_else(|| is_metric.then(inherited)),
        gravity: provenance.gravity.or_else(|| (is_metric && !is_ours).then(inherited)),
        origin: provenance.origin.or_else(|| (is_metric && !is_ours).then(inherited)),
    }
}
