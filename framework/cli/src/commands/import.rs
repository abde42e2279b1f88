//! `foveate import`: pictures and videos as a session.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use foveate_capture::size;
use foveate_engine::{self as engine, Options, Outcome, Progress};
use foveate_node::Registry;
use foveate_rig::graph::{Graph, Record};
use foveate_rig::{self as rig, Overrides};
use foveate_scene::Draft;
use foveate_session::{Pictures, Recorder, Recording};
use toml::Value;

use super::replay::Unpacked;
use super::run::{Faults, describe_recording, host};
use super::{complain, session_file};
use crate::outcome::failures;
use crate::output::wants_color;
use crate::progress::Line;
use crate::{exit, interrupt};

/// `foveate import`
#[derive(Debug, clap::Args)]
pub struct ImportArgs {
    /// Videos, folders of pictures, or folders that hold several of either: one for each camera, which gets the name of its file or folder
    #[arg(required = true, value_hint = clap::ValueHint::AnyPath)]
    sources: Vec<PathBuf>,
    /// The session, which must not be there yet
    #[arg(long, short, value_name = "FILE.mcap", value_parser = session_file, value_hint = clap::ValueHint::FilePath)]
    output: PathBuf,
    /// Pictures a second: needed for folders of pictures; of videos it replaces the file's own times
    #[arg(long, value_name = "HZ", value_parser = rate)]
    rate: Option<f64>,
    /// Keep colours [default: gray]
    #[arg(long)]
    rgb: bool,
    /// Write pictures as JPEG of this quality [default: lossless]
    #[arg(long, value_name = "QUALITY", value_parser = clap::value_parser!(u8).range(1..=100))]
    jpeg: Option<u8>,
    /// The calibration of these cameras, if there is one already
    #[arg(long, value_name = "FILE", value_hint = clap::ValueHint::AnyPath)]
    calibration: Option<PathBuf>,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

/// Endings of files that count as videos where a folder is named.
const VIDEOS: [&str; 16] = [
    "mp4", "mov", "m4v", "mkv", "avi", "webm", "mts", "m2ts", "mpg", "mpeg", "wmv", "mxf", "y4m", "h264", "hevc", "ogv",
];
/// Endings of files that are pictures.
const PICTURES: [&str; 3] = ["jpg", "jpeg", "png"];
/// Name of the calibration, beside the rig.
const CALIBRATION: &str = "cameras.toml";

/// Pictures, rows or frames a second on the command line.
pub(super) fn rate(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|it| (0.001..=100_000.0).contains(it));
    number.ok_or_else(|| format!("found {text}, expected a rate from 0.001 to 100000 [Hz]"))
}

/// The pictures of one camera.
struct Found {
    camera: String,
    path: PathBuf,
    is_video: bool,
}

pub(super) fn run(args: &ImportArgs, registry: &Registry) -> u8 {
    match import(args, registry) {
        Ok(code) => code,
        Err(sentence) => complain(&sentence),
    }
}

fn import(args: &ImportArgs, registry: &Registry) -> Result<u8, String> {
    let mut found = Vec::new();
    for source in &args.sources {
        find(source, &mut found)?;
    }
    for (place, it) in found.iter().enumerate() {
        if let Some(other) = found[..place].iter().find(|other| other.camera == it.camera) {
            let (a, b) = (other.path.display(), it.path.display());
            return Err(format!("`{a}` and `{b}` are both of a camera `{}`, expected a name for each", it.camera));
        }
    }
    if args.rate.is_none()
        && let Some(it) = found.iter().find(|it| !it.is_video)
    {
        return Err(format!(
            "the pictures in `{}` hold no times, expected --rate with their rate [Hz]",
            it.path.display()
        ));
    }
    let folder = Unpacked::new()?;
    let draft = draft(args, &found, &folder.0)?;
    let overrides = Overrides { calibration: Some(Arc::new(draft.calibration)), ..Overrides::default() };
    let text = rig_text(args, &found);
    let graph = rig::load(&text, &folder.0.join("import.toml"), registry, &overrides);
    let mut graph = match graph {
        Ok(graph) => graph,
        Err(faults) => {
            eprint!("{}", faults.render(wants_color()));
            return Ok(exit::INPUT);
        }
    };
    if !args.quiet {
        graph.host = host(true, Faults::default());
    }
    let graph = Arc::new(graph);
    let mut recording = Recording::of(&Record::default(), args.output.clone());
    recording.pictures = args.jpeg.map_or(Pictures::Lossless, Pictures::Jpeg);
    (recording.waits, recording.with_unused, recording.mode) = (true, true, "imported");
    let recorder = Recorder::begin(&graph, &recording, graph.host.clone())?;
    let outcome = play(args, &graph, &recorder)?;
    let (recorded, failure) = describe_recording(recorder, args.quiet, ("info", "says what is in it"));
    failures(&outcome).iter().for_each(|it| eprintln!("{it}"));
    let remarks = outcome.report.remarks.iter().filter(|_| !args.quiet);
    remarks.for_each(|it| eprintln!("note: {it}"));
    for it in outcome.gaps.iter().filter(|_| !args.quiet) {
        eprintln!("note: {} lacks {} pictures, the first at {}: {}", it.instance, it.count, it.time, it.reason);
    }
    if !args.quiet && !args.rgb {
        eprintln!("note: pictures are gray; --rgb keeps colours");
    }
    eprint!("{recorded}");
    Ok(if outcome.faults.is_empty() && failure.is_none() { exit::DONE } else { exit::INPUT })
}

fn play(args: &ImportArgs, graph: &Arc<Graph>, recorder: &Recorder) -> Result<Outcome, String> {
    let options = Options { tap: Some(recorder.tap()), ..Options::default() };
    interrupt::stops(&options.stop)?;
    let mut line = Line::new(graph);
    let mut observe = |progress: &Progress| {
        if !args.quiet {
            line.show(progress);
        }
    };
    let outcome = engine::deterministic(Arc::clone(graph), &options, &mut observe);
    line.end();
    outcome.map_err(|error| error.to_string())
}

/// Cameras below `path`: a video, a folder of pictures, or a folder of these.
fn find(path: &Path, found: &mut Vec<Found>) -> Result<(), String> {
    let shown = path.display();
    let refused = |error: std::io::Error| format!("`{shown}` cannot be read: {error}");
    // Absolute, since the rig lies elsewhere; by its own name, so that `.` has one.
    let whole = path.canonicalize().map_err(refused)?;
    if whole.is_file() {
        if has_ending(&whole, &PICTURES) {
            return Err(format!(
                "`{shown}` is one picture, expected a video or the folder of the pictures of a camera"
            ));
        }
        found.push(camera(&whole, true)?);
        return Ok(());
    }
    let pictures =
        |folder: &Path| -> std::io::Result<bool> { Ok(list(folder)?.iter().any(|it| has_ending(it, &PICTURES))) };
    if pictures(&whole).map_err(refused)? {
        found.push(camera(&whole, false)?);
        return Ok(());
    }
    let before = found.len();
    for inner in list(&whole).map_err(refused)? {
        if inner.is_dir() && pictures(&inner).map_err(refused)? {
            found.push(camera(&inner, false)?);
        } else if inner.is_file() && has_ending(&inner, &VIDEOS) {
            found.push(camera(&inner, true)?);
        }
    }
    match found.len() == before {
        true => Err(format!(
            "`{shown}` holds neither pictures ({}) nor videos nor folders of pictures",
            PICTURES.join(", ")
        )),
        false => Ok(()),
    }
}

/// What a folder holds, hidden files aside, by name.
fn list(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut inner: Vec<PathBuf> =
        std::fs::read_dir(folder)?.map(|it| it.map(|it| it.path())).collect::<Result<_, _>>()?;
    inner.retain(|it| !it.file_name().is_some_and(|it| it.to_string_lossy().starts_with('.')));
    inner.sort();
    Ok(inner)
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|it| endings.iter().any(|ending| it.eq_ignore_ascii_case(ending)))
}

fn camera(path: &Path, is_video: bool) -> Result<Found, String> {
    let name = if is_video { path.file_stem() } else { path.file_name() };
    let name = name.and_then(|it| it.to_str()).filter(|it| !it.contains(['*', '?', '!', '{', '[', ']']));
    let camera =
        name.ok_or_else(|| format!("`{}` gives no name of a camera: letters, digits, `-`, `_`", path.display()))?;
    Ok(Found { camera: camera.to_owned(), path: path.to_owned(), is_video })
}

/// The calibration of these cameras; written into `folder` where there is only a name and a size of each.
fn draft(args: &ImportArgs, found: &[Found], folder: &Path) -> Result<Draft, String> {
    let path = match &args.calibration {
        Some(path) => path.clone(),
        None => {
            let mut text = "[calibration]\nlength_unit = \"unknown\"\n".to_owned();
            for it in found {
                let size = if it.is_video { size::of_video(&it.path) } else { size::of_pictures(&it.path) };
                let [width, height] = size.map_err(|what| format!("`{}` {what}", it.path.display()))?;
                let name = Value::from(it.camera.as_str());
                let _ = write!(text, "\n[camera.{name}]\nimage_size_px = [{width}, {height}]\n");
            }
            let path = folder.join(CALIBRATION);
            std::fs::write(&path, text).map_err(|error| format!("`{}` cannot be written: {error}", path.display()))?;
            path
        }
    };
    let draft = Draft::load(&path).map_err(|error| error.to_string())?;
    match found.iter().find(|it| draft.calibration.index_of(&it.camera).is_none()) {
        None => Ok(draft),
        Some(it) => {
            let known: Vec<&str> = draft.calibration.cameras.iter().map(|it| it.name.as_str()).collect();
            Err(format!(
                "`{}` has no camera `{}` ({}), it has {}",
                path.display(),
                it.camera,
                it.path.display(),
                known.join(", ")
            ))
        }
    }
}

/// A rig with a node for the cameras of each folder and ending.
fn rig_text(args: &ImportArgs, found: &[Found]) -> String {
    let calibration = match &args.calibration {
        Some(path) => std::path::absolute(path).unwrap_or_else(|_| path.clone()).to_string_lossy().into_owned(),
        None => CALIBRATION.to_owned(),
    };
    let mut text = format!("[rig]\nname = \"import\"\ncalibration = {}\n\n[scale.room]\n", Value::from(calibration));
    let mut groups: Vec<(bool, String, Vec<Value>)> = Vec::new();
    for it in found {
        let pattern = match it.path.extension().filter(|_| it.is_video) {
            Some(ending) => format!("{{camera}}.{}", ending.to_string_lossy()),
            None => "{camera}".to_owned(),
        };
        let path = it.path.with_file_name(pattern).to_string_lossy().into_owned();
        let camera = Value::from(it.camera.as_str());
        match groups.iter_mut().find(|group| (group.0, &group.1) == (it.is_video, &path)) {
            Some(group) => group.2.push(camera),
            None => groups.push((it.is_video, path, vec![camera])),
        }
    }
    for (place, (is_video, path, cameras)) in groups.into_iter().enumerate() {
        let number = if place == 0 { String::new() } else { format!("_{}", place + 1) };
        let kind = if is_video { "video" } else { "images" };
        let format = if args.rgb { "rgb" } else { "gray" };
        let rate = args.rate.map_or_else(String::new, |it| format!("rate_hz = {it:?}\n"));
        let (path, cameras) = (Value::from(path), Value::Array(cameras));
        let _ = write!(
            text,
            "\n[scale.room.node.{kind}{number}]\ntype = \"capture.{kind}\"\neach = {cameras}\npath = {path}\nformat = \"{format}\"\n{rate}"
        );
    }
    text
}
