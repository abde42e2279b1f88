//! Captures observations with a rig: its sources and detectors run, everything after them is left out.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};

use foveate_board::BoardSettings;
use foveate_calibration::board::Board;
use foveate_calibration::coverage::{Coverage, CoverageOptions};
use foveate_calibration::recording::{CameraGuess, Recording};
use foveate_capture::detections::{Detections, DetectionsSettings, label_names};
use foveate_engine::{self as engine, Options, Outcome, Progress};
use foveate_node::{Node, Registry, Role};
use foveate_rig::graph::{Graph, Instance};
use foveate_rig::{self as rig, Overrides};
use foveate_scene::{Draft, WorkingVolume};
use foveate_structured_light::corners::CornersSettings;

use super::boards::{self, BoardArgs};
use super::guide::Guide;
use super::recorder::{self, Gathered, Shared};
use super::shown::Shown;
use crate::interrupt;
use crate::output::wants_color;

/// The node that is added to the rig.
const RECORDER: &str = "calibrate_recorder";
/// The node that is added besides, so that what was seen can be calibrated with again.
const TABLE: &str = "calibrate_observations";
/// What it writes.
pub const OBSERVATIONS: &str = "observations.csv";

/// How to run the rig.
#[derive(Clone, Default)]
pub struct CaptureOptions {
    /// The node whose features to take; needed when a rig has several.
    pub node: Option<String>,
    /// Replaces the rig's duration [s].
    pub duration_s: Option<f64>,
    /// Replaces the rig's seed.
    pub seed: Option<u64>,
    /// On the wall clock.
    pub live: bool,
    /// Show nothing.
    pub quiet: bool,
    /// End a live run when it is enough.
    pub stop_when_enough: bool,
    /// Arguments about a board.
    pub board: BoardArgs,
    /// When coverage suffices.
    pub coverage: CoverageOptions,
    /// By place in the rig's calibration: the number of the camera, where it is used; empty: all are.
    pub numbers: Vec<Option<usize>>,
    /// The console, for people who want one.
    pub shown: Option<Arc<Shown>>,
}

/// What was seen.
pub struct Captured {
    /// All pictures; its cameras as guessed.
    pub recording: Recording,
    /// Where the light has been.
    pub coverage: Coverage,
    /// How the run went.
    pub outcome: Outcome,
    /// Why it ended early, and when.
    pub ended_early: Option<String>,
    /// The board, for a calibration with one.
    pub board: Option<Board>,
    /// Names of points, in the order of the numbers that are their labels; none where they have no names.
    pub labels: Vec<String>,
}

/// The calibration to begin with, of which not all need be known.
///
/// # Errors
/// Sentences for the person.
pub fn draft(rig: &Path) -> Result<(PathBuf, Draft), String> {
    let path = rig::calibration_path(rig).map_err(|faults| faults.render(wants_color()))?;
    let minimal = "a file with `[calibration]`, `length_unit = \"unknown\"`, and for each camera `[camera.NAME]` with \
                   `image_size_px = [columns, rows]`";
    let path = path.ok_or_else(|| {
        format!(
            "error: {} names no calibration, expected `calibration = \"FILE\"` under `[rig]`: {minimal}",
            rig.display()
        )
    })?;
    if !path.exists() {
        return Err(format!("error: {} does not exist, expected at least {minimal}", path.display()));
    }
    let draft = Draft::load(&path).map_err(|error| format!("error: {error}"))?;
    Ok((path, draft))
}

/// Runs what leads to the features of `rig`, and gathers them.
///
/// `check` is asked before anything runs.
///
/// # Errors
/// Sentences for the person, with all faults of the rig.
pub fn capture(
    rig_path: &Path,
    registry: &Registry,
    draft: &Draft,
    cameras: Vec<CameraGuess>,
    folder: &Path,
    options: &CaptureOptions,
    check: &dyn Fn(&Graph) -> Result<(), String>,
) -> Result<Captured, String> {
    let coverage = Coverage::new(&cameras, &options.coverage);
    let numbers = match options.numbers.is_empty() {
        true => (0..draft.calibration.cameras.len()).map(Some).collect(),
        false => options.numbers.clone(),
    };
    let used = |index: &usize| numbers.get(*index).copied().flatten().is_some();
    let shared: Shared =
        Arc::new(Mutex::new(Gathered { camera_frames: Vec::new(), coverage, numbers: numbers.clone() }));
    let mut registry = registry.clone();
    recorder::register(&mut registry, &shared);
    let Detectors { mut graph, board, labels } = detectors(rig_path, draft, &registry, options)?;
    check(&graph)?;
    let board = boards::board(&options.board, board.as_ref())?;
    if let Some(shown) = &options.shown {
        graph.pages = shown.pages();
    }
    let graph = Arc::new(graph);
    if let Some([min, max]) = graph.scales.first().and_then(|it| it.volume_m)
        && let Some(volume) = WorkingVolume::new(min.into(), max.into())
        && draft.unknown.values().all(|it| !it.pose)
    {
        let all = draft.calibration.cameras.iter().enumerate();
        let known: Vec<_> = all.filter(|it| used(&it.0)).map(|it| Some(it.1.camera.clone())).collect();
        lock(&shared).coverage.place(&known, volume);
    }
    let simulated = graph.instances.iter().find(|it| it.node_type.name.starts_with("sim."));
    if let (Some(node), Some((camera, _))) = (simulated, draft.unknown.iter().find(|it| it.1.pose || it.1.focal)) {
        return Err(format!(
            "error: {} ({}) shows what the cameras of the calibration see, and {camera} has no pose or focal length there; expected a calibration that states all, \
             of which --from-nothing then uses no pose",
            node.path, node.node_type.name
        ));
    }
    let (outcome, ended_early) = run(&graph, &shared, folder, options, board.is_some())?;
    let mut gathered = lock(&shared);
    let camera_frames = std::mem::take(&mut gathered.camera_frames);
    let coverage = gathered.coverage.clone();
    Ok(Captured { recording: Recording { cameras, camera_frames }, coverage, outcome, ended_early, board, labels })
}

fn lock(shared: &Shared) -> std::sync::MutexGuard<'_, Gathered> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What gives features.
struct Detectors {
    /// That part of the rig, with the recorder at its end.
    graph: Graph,
    /// The detector's settings, where it finds boards.
    board: Option<BoardSettings>,
    /// Names of points, where they have some.
    labels: Vec<String>,
}

fn detectors(path: &Path, draft: &Draft, registry: &Registry, options: &CaptureOptions) -> Result<Detectors, String> {
    let overrides = Overrides {
        seed: options.seed,
        duration_s: options.duration_s,
        calibration: Some(Arc::new(draft.calibration.clone())),
    };
    let faults = |faults: rig::Diagnostics| faults.render(wants_color());
    let text = foveate_diagnostics::file::read_text(path)
        .map_err(|error| format!("error: cannot read {}: {error}", path.display()))?;
    let whole = rig::load(&text, path, registry, &overrides).map_err(faults)?;
    let (scale, node, port) = choose(&whole, options.node.as_deref())?;
    let addition = format!(
        "\n\n[scale.{scale}.node.{RECORDER}]\ntype = \"calibrate.recorder\"\nin = {{ features = \"{node}.{port}\" }}\n\
         \n[scale.{scale}.node.{TABLE}]\ntype = \"export.features\"\nin = {{ features = \"{node}.{port}\" }}\nfile = \"{OBSERVATIONS}\"\n"
    );
    let graph = rig::load(&format!("{text}{addition}"), path, registry, &overrides).map_err(faults)?;
    let settings = graph.instances.iter().find(|it| it.node == node).map(|it| it.settings.as_any());
    let board = settings.and_then(|it| it.downcast_ref().cloned());
    let board = board.or_else(|| {
        let corners: &CornersSettings = settings?.downcast_ref()?;
        Some(BoardSettings { columns: corners.columns, rows: corners.rows, square_mm: corners.square_mm })
    });
    let is_table = |it: &&Instance| it.node_type.name == Detections::TYPE && it.node == node;
    let settings = graph.instances.iter().find(is_table).map(|it| it.settings.as_any());
    let settings: Option<&DetectionsSettings> = settings.and_then(|it| it.downcast_ref());
    let labels = settings.filter(|it| it.columns.is_empty()).map(|it| {
        let cameras = draft.calibration.cameras.iter().map(|it| it.name.as_str());
        label_names(&it.path, cameras, path.parent().unwrap_or(Path::new("")))
    });
    let labels = labels.transpose().map_err(|fault| format!("error: {fault}"))?.unwrap_or_default();
    Ok(Detectors { graph: graph.upstream_of(|it| it.node == RECORDER || it.node == TABLE), board, labels })
}

/// Scale, node and output port of the features to take.
fn choose(graph: &Graph, wanted: Option<&str>) -> Result<(String, String, &'static str), String> {
    let port =
        |it: &Instance| it.node_type.ports.outputs.iter().find(|it| it.message.name == "features").map(|it| it.name);
    // By node: one entry, whatever the number of its cameras.
    let mut offers: BTreeMap<(usize, &str), (&'static str, Role)> = BTreeMap::new();
    for instance in &graph.instances {
        if let Some(port) = port(instance) {
            offers.insert((instance.scale, &instance.node), (port, instance.node_type.role));
        }
    }
    if offers.is_empty() {
        return Err("error: no node of this rig gives features, expected a detector such as `led.detector`, or `capture.detections`".into());
    }
    let is_wanted = |node: &str| wanted.is_none_or(|it| it == node || it.rsplit('.').next() == Some(node));
    let has_detector = offers.values().any(|it| it.1 == Role::Detector);
    let fitting: Vec<_> = offers
        .iter()
        .filter(|((_, node), (_, role))| {
            is_wanted(node) && (wanted.is_some() || !has_detector || *role == Role::Detector)
        })
        .collect();
    let named = |((scale, node), _): &(&(usize, &str), &(&str, Role))| format!("{}.{node}", graph.scales[*scale].name);
    match fitting[..] {
        [(&(scale, node), &(port, _))] => Ok((graph.scales[scale].name.clone(), node.to_owned(), port)),
        [] => {
            let names: Vec<String> = offers.iter().map(|it| named(&it)).collect();
            Err(format!(
                "error: `--from {}` is not a node that gives features, expected one of: {}",
                wanted.unwrap_or_default(),
                names.join(", ")
            ))
        }
        _ => {
            let names: Vec<String> = fitting.iter().map(named).collect();
            Err(format!(
                "error: several nodes give features: {}; expected `--from NODE` with one of them",
                names.join(", ")
            ))
        }
    }
}

/// How the run went, and who ended it early, and when.
fn run(
    graph: &Arc<Graph>,
    shared: &Shared,
    folder: &Path,
    options: &CaptureOptions,
    is_board: bool,
) -> Result<(Outcome, Option<String>), String> {
    let engine_options = Options { out_dir: Some(folder.to_owned()), ..Options::default() };
    interrupt::stops(&engine_options.stop).map_err(|it| format!("error: {it}"))?;
    let has_device = graph.instances.iter().any(|it| it.is_live());
    let is_live = options.live || has_device;
    let engine_options = match &options.shown {
        Some(shown) => shown.open(graph, is_live, engine_options).map_err(|it| format!("error: {it}"))?,
        None => engine_options,
    };
    let mut guide = Guide::new(graph, is_live, is_board);
    let stop = Arc::clone(&engine_options.stop);
    let mut enough = false;
    let mut observe = |progress: &Progress| {
        if !options.quiet {
            guide.show(progress, shared);
        }
        if let Some(shown) = &options.shown {
            shown.advance(progress, || lock(shared).coverage.clone(), is_board);
        }
        if is_live && options.stop_when_enough && guide.is_enough(shared) {
            enough = true;
            stop.store(true, Ordering::Relaxed);
        }
    };
    let engine = if is_live { engine::live } else { engine::deterministic };
    let outcome = engine(Arc::clone(graph), &engine_options, &mut observe).map_err(|error| format!("error: {error}"));
    guide.end();
    if let Some(shown) = &options.shown {
        shown.begin("solving");
    }
    let outcome = outcome?;
    let whole = graph.duration.map_or(String::new(), |it| format!(" of {} s", it.as_s()));
    let who = if enough { "enough was seen after" } else { "stopped by you after" };
    let ended_early = outcome.interrupted.then(|| format!("{who} {:.1} s{whole}", outcome.ended.as_s()));
    Ok((outcome, ended_early))
}
