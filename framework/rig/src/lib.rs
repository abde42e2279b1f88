//! TOML to a checked graph: every fault of a rig in one run, each with its place, or a [`Graph`] that can run.
//!
//! The steps, each going on as far as it can past what the earlier ones found:
//!
//! | step | file |
//! |---|---|
//! | text → tables with the place of every word | `read`, `node_text`, `value` |
//! | libraries of nodes opened | `libraries` |
//! | scales in order, and which targets carry them | `scales`, `targets` |
//! | each node alone: type, settings against their schema, cameras, made once on trial | `nodes`, `settings`, `schema_parts`, `expected` |
//! | references looked up, messages, spaces and cameras compared, edges | `lookup`, `reference`, `wire`, `anchors` |
//! | cycles, then the schedule | `order`, `finish` |
//! | requirements against the plan | `promise` |
//! | budgets: their ends, then their paths and the plan | `budget`, `paths` |
//! | the rig with every default filled in | `resolved` |
//!
//! [`live`] changes settings while a rig runs.

mod anchors;
mod budget;
mod expected;
mod finish;
mod grammar;
pub mod graph;
mod libraries;
pub mod live;
mod lookup;
mod node_text;
mod nodes;
mod order;
mod paths;
mod promise;
mod read;
mod record;
mod reference;
mod resolved;
mod scales;
mod schema;
mod schema_parts;
mod settings;
mod targets;
mod values;
mod wire;

use std::cell::RefCell;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use foveate_scene::calibration::Calibration;
use foveate_scene::{Draft, Unknown};
use toml::de::DeTable;

pub use expected::unit_of;
pub use foveate_diagnostics::{Diagnostic, Diagnostics, Severity, Span};
pub use schema::schema;

use crate::graph::Graph;
use foveate_diagnostics::{Findings, file, names};
use foveate_node::registry::Registry;
use foveate_node::setup::{Claims, expand_path, no_cameras};
use nodes::{NodeDraft, ScaleView, Surroundings};
use read::RigText;

/// Longest rig [bytes].
pub const MAX_BYTES: u64 = 16 << 20;

/// What the command line says in place of the rig.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Overrides {
    /// In place of `[rig] seed`.
    pub seed: Option<u64>,
    /// In place of `[rig] duration_s` [s].
    pub duration_s: Option<f64>,
    /// In place of what the file that `[rig] calibration` names would give.
    pub calibration: Option<Arc<Calibration>>,
}

/// The one of `known` that was probably meant by `found`, if one is near.
pub fn closest<'n>(found: &str, known: impl IntoIterator<Item = &'n str>) -> Option<&'n str> {
    names::likely(found, known)
}

/// Reads and checks the rig in a file.
///
/// # Errors
/// Everything that is wrong with it, or that it cannot be read, is not UTF-8 or is longer than [`MAX_BYTES`].
pub fn load_file(path: &Path, registry: &Registry, overrides: &Overrides) -> Result<Graph, Diagnostics> {
    let text = read_text(path)?;
    load(&text, path, registry, overrides)
}

/// Checks the rig `text`; `path` is where it came from: it stands in messages, and relative paths start at its folder.
///
/// # Errors
/// Everything that is wrong with it.
pub fn load(text: &str, path: &Path, registry: &Registry, overrides: &Overrides) -> Result<Graph, Diagnostics> {
    let mut findings = Findings::default();
    let graph = check(text, path, registry, overrides, &mut findings);
    let faults = findings.into_diagnostics(text, path);
    match graph {
        Some(graph) if faults.n_errors() == 0 => Ok(Graph { warnings: faults, ..graph }),
        _ => Err(faults),
    }
}

/// The file or folder that `[rig] calibration` names in the rig at `path`, if it names one.
///
/// # Errors
/// When the rig cannot be read, or the path in it cannot be made out.
pub fn calibration_path(path: &Path) -> Result<Option<PathBuf>, Diagnostics> {
    let text = read_text(path)?;
    let mut findings = Findings::default();
    let found = parse(&text, &mut findings).and_then(|document| {
        let rig = read::read(document, &text, &mut findings);
        let file_dir = path.parent().filter(|it| !it.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let rig_dir = folder(&rig, file_dir, &mut findings);
        named_path(&rig, &rig_dir, &mut findings)
    });
    let faults = findings.into_diagnostics(&text, path);
    if faults.n_errors() == 0 { Ok(found) } else { Err(faults) }
}

/// `registry` with the node types of the libraries that the rig at `path` names.
///
/// # Errors
/// When the rig cannot be read, or a library of it cannot be used.
pub fn with_libraries(path: &Path, registry: &Registry) -> Result<Registry, Diagnostics> {
    let text = read_text(path)?;
    let mut findings = Findings::default();
    let mut of_libraries = Findings::default();
    let grown = parse(&text, &mut findings).map(|document| {
        // What is wrong with the rest of the rig does not matter here.
        let rig = read::read(document, &text, &mut Findings::default());
        let file_dir = path.parent().filter(|it| !it.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let rig_dir = folder(&rig, file_dir, &mut of_libraries);
        libraries::open(registry, &rig.libraries, &rig_dir, &mut of_libraries).0.into_owned()
    });
    findings.append(of_libraries);
    match grown {
        Some(grown) if !findings.any_error() => Ok(grown),
        _ => Err(findings.into_diagnostics(&text, path)),
    }
}

fn check(
    text: &str,
    path: &Path,
    registry: &Registry,
    overrides: &Overrides,
    findings: &mut Findings,
) -> Option<Graph> {
    if text.len() as u64 > MAX_BYTES {
        let label = format!("found {} bytes, expected at most {MAX_BYTES}", text.len());
        findings.error(0..0, "this is too long for a rig", label);
        return None;
    }
    let document = parse(text, findings)?;
    let mut rig = read::read(document, text, findings);
    let file_dir = path.parent().filter(|it| !it.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let rig_dir = folder(&rig, file_dir, findings);
    let (registry, has_all_libraries) = libraries::open(registry, &rig.libraries, &rig_dir, findings);
    let given = overrides.calibration.clone();
    let calibration = given.or_else(|| calibration(&rig, &rig_dir, findings));
    // Before any node is tried out, which may ask for a picture's memory.
    let calibration = calibration.filter(|it| pictures_fit(it, &rig, findings));
    let seed = overrides.seed.unwrap_or(rig.seed);
    let duration_s = overrides.duration_s.or(rig.duration_s);
    if let Some(duration_s) = overrides.duration_s.filter(|it| !read::is_duration(*it)) {
        let label = format!("found {duration_s} s on the command line, expected more than 0 and at most 9e9");
        findings.error(rig.header.clone(), "a run cannot last that long", label);
    }
    if i64::try_from(seed).is_err() {
        let label = format!("found {seed} on the command line, expected at most {}", i64::MAX);
        findings.error(rig.header.clone(), "the seed is too large", label);
    }
    let (scales, nodes) = scales::arrange(std::mem::take(&mut rig.scales), findings);
    let surroundings = Surroundings {
        registry: &registry,
        has_all_libraries,
        calibration: calibration.clone(),
        names_calibration: rig.calibration.is_some() || overrides.calibration.is_some(),
        rig_dir: &rig_dir,
        claims: Claims::default(),
        wanted: RefCell::default(),
        seed,
        places: scales::places(&scales),
    };
    let mut drafts: Vec<NodeDraft<'_>> = Vec::new();
    for (index, (scale, nodes)) in scales.iter().zip(nodes).enumerate() {
        let view = ScaleView { index, scale };
        anchors::refuse_own(scale, &nodes, findings);
        if let Some(text) = anchors::implied(&scales, scale, &nodes, &drafts) {
            drafts.push(NodeDraft { is_implied: true, ..surroundings.draft(text, &view, findings) });
        }
        drafts.extend(nodes.into_iter().map(|it| surroundings.draft(it, &view, findings)));
    }
    surroundings.refuse_unknown_names(findings);
    let finish =
        finish::Finish { rig: &rig, text, scales: &scales, nodes: &drafts, calibration, rig_dir, seed, duration_s };
    finish.graph(findings)
}

fn parse<'t>(text: &'t str, findings: &mut Findings) -> Option<DeTable<'t>> {
    let (document, errors) = DeTable::parse_recoverable(text);
    // After anything else the tree is guesswork, and so would be what is said of it.
    let mut clean = true;
    for error in errors {
        let message = error.message();
        let place = error.span().unwrap_or(0..0);
        if message == "duplicate key" {
            let key = text.get(place.clone()).unwrap_or_default();
            let title = format!("`{}` stands here twice", names::shown(&key));
            findings.error(place, title, "found the same key or table again, expected it once");
        } else {
            clean = false;
            findings.error(place, "this is not TOML", names::shown(&message));
        }
    }
    clean.then(|| document.into_inner())
}

fn folder(rig: &RigText<'_>, file_dir: &Path, findings: &mut Findings) -> PathBuf {
    let Some(folder) = &rig.folder else { return file_dir.to_owned() };
    expand_path(folder.get_ref(), file_dir).unwrap_or_else(|message| {
        findings.error(folder.span(), "`folder` cannot be found", message);
        file_dir.to_owned()
    })
}

fn calibration(rig: &RigText<'_>, rig_dir: &Path, findings: &mut Findings) -> Option<Arc<Calibration>> {
    let Some(file) = &rig.calibration else { return Some(no_cameras()) };
    let path = named_path(rig, rig_dir, findings)?;
    match Calibration::load(&path) {
        Ok(calibration) => Some(Arc::new(calibration)),
        Err(error) => {
            if let Some(what) = not_calibrated(&path) {
                findings
                    .error(file.span(), "the cameras are not calibrated yet", what)
                    .maybe_help(Some(CALIBRATE.to_owned()));
                return None;
            }
            let help = (!path.exists()).then(|| BEGIN_CALIBRATION.to_owned());
            for fault in &error.faults {
                findings.error(file.span(), "the calibration cannot be used", fault).maybe_help(help.clone());
            }
            None
        }
    }
}

/// What to do about cameras that are not calibrated.
const CALIBRATE: &str = "`foveate calibrate RIG --from-nothing --write` finds what is missing, from a waved light (`led.detector`), a wand (`--wand-mm 400`) \
     or a chessboard (`board.detector`, or `--chessboard 8x6 --square-mm 30` for corners from a file)";

/// What to do where the file of the calibration does not exist.
const BEGIN_CALIBRATION: &str = "to calibrate, begin with a file of `[calibration]`, `length_unit = \"unknown\"` and, for each camera, `[camera.NAME]` with `image_size_px = [640, 480]`; \
     then `foveate calibrate RIG --from-nothing --write`";

/// What an otherwise valid calibration still lacks and calibrating finds; `None`: it is no such file.
fn not_calibrated(path: &Path) -> Option<String> {
    let draft = Draft::load(path).ok()?;
    let of = |is_unknown: fn(&Unknown) -> bool| draft.unknown.values().filter(|it| is_unknown(it)).count();
    let (poses, optics) = (of(|it| it.pose), of(|it| it.focal || it.principal));
    let n = draft.calibration.cameras.len();
    let lacks = [(poses, "poses"), (optics, "optics")].into_iter().filter(|it| it.0 > 0);
    let lacks: Vec<String> = lacks.map(|(lacking, what)| format!("the {what} of {lacking}")).collect();
    let path = path.display();
    (!lacks.is_empty()).then(|| format!("`{path}` lacks {} of its {n} cameras", lacks.join(" and ")))
}

/// Pixels of a picture, at most: more than the largest sensors have, and little enough to be held in memory [px].
const MOST_PIXELS: u64 = 1 << 28;

/// Whether pictures of each camera can be held in memory; a fault for each camera of which they cannot.
fn pictures_fit(calibration: &Calibration, rig: &RigText<'_>, findings: &mut Findings) -> bool {
    let pixels = |size: [u32; 2]| u64::from(size[0]) * u64::from(size[1]);
    let absurd = calibration.cameras.iter().filter(|it| pixels(it.camera.image_size) > MOST_PIXELS);
    let place = rig.calibration.as_ref().map_or_else(|| rig.header.clone(), |it| it.span());
    let mut fits = true;
    for it in absurd {
        fits = false;
        let [columns, rows] = it.camera.image_size;
        let label = format!(
            "camera {}: found pictures of {columns} x {rows} px, expected at most {MOST_PIXELS} px, as 16384 x 16384",
            it.name
        );
        findings.error(place.clone(), "the pictures of a camera do not fit into memory", label);
    }
    fits
}

fn named_path(rig: &RigText<'_>, rig_dir: &Path, findings: &mut Findings) -> Option<PathBuf> {
    let file = rig.calibration.as_ref()?;
    match expand_path(file.get_ref(), rig_dir) {
        Ok(path) => Some(path),
        Err(message) => {
            findings.error(file.span(), "the calibration cannot be found", message);
            None
        }
    }
}

/// The text of a rig file, read no further than a rig may be long.
fn read_text(path: &Path) -> Result<String, Diagnostics> {
    let refuse = |text: &str, span: Span, title: &str, label: String, help: Option<String>| {
        let mut findings = Findings::default();
        findings.error(span, format_args!("{title} `{}`", names::shown(&path.display())), label).maybe_help(help);
        findings.into_diagnostics(text, path)
    };
    let unreadable = |error: std::io::Error| refuse("", 0..0, "cannot read", error.to_string(), None);
    let too_long = |length: Option<u64>| {
        let found = length.map_or_else(|| format!("more than {MAX_BYTES}"), |it| it.to_string());
        let label = format!("found {found} bytes, expected at most {MAX_BYTES}");
        let help = "is it a recording? a rig names its recordings, and holds none".to_owned();
        refuse("", 0..0, "this is too long for a rig:", label, Some(help))
    };
    let file = file::open(path).map_err(unreadable)?;
    let facts = file.metadata().map_err(unreadable)?;
    if facts.len() > MAX_BYTES {
        return Err(too_long(Some(facts.len())));
    }
    let mut bytes = Vec::new();
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(too_long(None));
    }
    String::from_utf8(bytes).map_err(|error| {
        let place = error.utf8_error().valid_up_to();
        let byte = error.as_bytes().get(place).copied().unwrap_or_default();
        let text = String::from_utf8_lossy(error.as_bytes()).into_owned();
        let label = format!("found the byte {byte:#04x}, expected UTF-8");
        refuse(&text, place..place + 1, "this is not text:", label, None)
    })
}
