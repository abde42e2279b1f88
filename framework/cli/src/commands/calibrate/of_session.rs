//! A rig that sees what a session saw, to calibrate its cameras with.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use foveate_messages::{Features, Image, Message};
use foveate_scene::natural_order;
use foveate_session::source::{camera_of, fact};
use foveate_session::{Session, replay as recorded};
use toml::{Table, Value};

use super::super::replay::{self, Unpacked};
use super::CalibrateArgs;

/// The rig, in a folder that goes away with this.
pub(super) struct OfSession {
    pub rig: PathBuf,
    _folder: Unpacked,
}

/// The rig for the session that the command line names; `None` where it names a rig.
///
/// # Errors
/// Sentences for the person.
pub(super) fn of_session(args: &CalibrateArgs) -> Result<Option<OfSession>, String> {
    let is_session = args.rig.extension().is_some_and(|it| it.eq_ignore_ascii_case("mcap"));
    if !is_session {
        return Ok(None);
    }
    let refused = |what: String| format!("error: {what}");
    if args.write {
        return Err(refused("a session keeps its calibration, so that --write has nothing to replace".to_owned()));
    }
    let mut session = replay::open(&args.rig, args.quiet).map_err(refused)?;
    let folder = Unpacked::new().map_err(refused)?;
    let (_, text) = recorded::unpack(&mut session, &folder.0).map_err(refused)?;
    let rig = folder.0.join("calibrate.toml");
    let text = rig_text(args, &session, &text).map_err(refused)?;
    std::fs::write(&rig, text).map_err(|error| refused(format!("`{}` cannot be written: {error}", rig.display())))?;
    Ok(Some(OfSession { rig, _folder: folder }))
}

fn rig_text(args: &CalibrateArgs, session: &Session, recorded: &str) -> Result<String, String> {
    let recorded: Table = recorded.parse().map_err(|error| format!("the rig of the session is no TOML: {error}"))?;
    let calibration = recorded.get("rig").and_then(|it| it.get("calibration"));
    let calibration = calibration
        .ok_or_else(|| format!("`{}` has no calibration, not even names and picture sizes", session.path.display()))?;
    let volume =
        recorded.get("scale").and_then(Value::as_table).and_then(|it| it.values().find_map(|it| it.get("volume_m")));
    let images = cameras(session, Image::NAME, "");
    let features = cameras(session, Features::NAME, args.from.as_deref().unwrap_or_default());
    let (cameras, detector) = match args.board.chessboard {
        Some([columns, rows]) => {
            let square = args
                .board
                .square_mm
                .ok_or("a board without a size, expected `--square-mm` with the side of a square")?;
            (images, format!("type = \"board.detector\"\ncolumns = {columns}\nrows = {rows}\nsquare_mm = {square:?}\n"))
        }
        // What was found then is found already.
        None if !features.is_empty() => (features, String::new()),
        None if args.from.is_some() => {
            let from = args.from.as_deref().unwrap_or_default();
            return Err(format!(
                "`--from {from}` gave no features of cameras in this session; `foveate info` lists what is there"
            ));
        }
        None => (images, "type = \"led.detector\"\n".to_owned()),
    };
    if cameras.is_empty() {
        return Err(format!("`{}` holds neither pictures nor features of cameras", session.path.display()));
    }
    let each = Value::Array(cameras.iter().map(|it| Value::from(it.0.as_str())).collect());
    let path = Value::from(
        std::path::absolute(&session.path).unwrap_or_else(|_| session.path.clone()).to_string_lossy().into_owned(),
    );
    let name = Value::from(
        session.path.file_stem().map_or_else(|| "session".to_owned(), |it| it.to_string_lossy().into_owned()),
    );
    let mut text = format!("[rig]\nname = {name}\ncalibration = {calibration}\n\n[scale.room]\n");
    let _ = volume.map(|it| writeln!(text, "volume_m = {it}"));
    let _ = write!(text, "\n[scale.room.node.session]\ntype = \"capture.session\"\neach = {each}\npath = {path}\n");
    match detector.is_empty() {
        true => {
            let topic = cameras.first().map(|(camera, topic)| topic.replace(&format!("/{camera}/"), "/{camera}/"));
            let _ = topic.map(|it| writeln!(text, "features = {}", Value::from(it)));
        }
        false => {
            let _ = write!(
                text,
                "\n[scale.room.node.seen]\n{detector}each = {each}\nin = {{ image = \"session.image\" }}\n"
            );
        }
    }
    Ok(text)
}

/// Cameras with messages of that kind that the node `from` gave (empty: the first such node), and their topics.
fn cameras(session: &Session, kind: &str, from: &str) -> Vec<(String, String)> {
    let node = |instance: &str| instance.split('[').next().unwrap_or_default().to_owned();
    let channels = session.summary.channels.values().filter(|it| fact(it, "message") == kind);
    let named: Vec<_> =
        channels.filter_map(|it| Some((node(fact(it, "instance")), camera_of(it)?, &it.topic))).collect();
    let is_from = |it: &str| from.is_empty() || it == from || it.rsplit('.').next() == Some(from);
    let Some(first) = named.iter().map(|it| &it.0).filter(|it| is_from(it)).min() else { return Vec::new() };
    let mut found: Vec<_> =
        named.iter().filter(|it| it.0 == *first).map(|it| (it.1.to_owned(), it.2.clone())).collect();
    found.sort_by(|a, b| natural_order(&a.0, &b.0));
    found
}

impl OfSession {
    /// The rig, or the one that the command line names.
    pub(super) fn rig<'r>(this: &'r Option<OfSession>, named: &'r Path) -> &'r Path {
        this.as_ref().map_or(named, |it| &it.rig)
    }
}
