//! What `convert` and `compare` have in common: motion files found, read, described and written.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use clap::ValueEnum;
use foveate_diagnostics::file;
use foveate_motion::Motion;
use foveate_motion::forms::{self, Form, ReadOptions};
use foveate_motion::motion::Up;

use crate::outcome::harmless;

/// Which axis is up, on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum UpArg {
    /// y
    Y,
    /// z
    Z,
}

impl From<UpArg> for Up {
    fn from(up: UpArg) -> Up {
        match up {
            UpArg::Y => Up::Y,
            UpArg::Z => Up::Z,
        }
    }
}

/// A length of time on the command line, such as that of a gap.
pub(super) fn seconds_of_gap(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|it| *it > 0.0 && *it <= 1e6);
    number.ok_or_else(|| format!("found {text}, expected a length of time above 0, to 1e6 [s]"))
}

/// What motion file this is: by its content, else, where that is of no known kind, by its ending. `None`: none.
pub(super) fn kind_of(path: &Path) -> std::io::Result<Option<Form>> {
    if path.is_dir() {
        return Ok(None);
    }
    let mut start = Vec::new();
    file::open(path)?.take(1 << 16).read_to_end(&mut start)?;
    let ending = path.extension().and_then(|it| it.to_str()).unwrap_or_default();
    let by_ending = Form::of_ending(ending).filter(|it| *it != Form::Table);
    Ok(Form::of(&start).or(by_ending))
}

/// Why a file that looks like one of our tables is none; `None`: it does not look so.
pub(super) fn nearly_table(path: &Path) -> Option<String> {
    let mut start = Vec::new();
    file::open(path).ok()?.take(1 << 16).read_to_end(&mut start).ok()?;
    let why = forms::nearly_table(&start)?;
    Some(harmless(&format!("`{}` is no table of targets or marks that can be read: {why}", path.display())))
}

/// Reads a file.
pub(super) fn load(path: &Path, form: Form, options: &ReadOptions) -> Result<forms::Read, String> {
    let bytes = std::fs::read(path).map_err(|it| format!("`{}` cannot be read: {it}", path.display()))?;
    let mut read = forms::read_as(&bytes, form, options).map_err(|it| {
        format!("`{}` is no {form} file that can be read: {}", path.display(), harmless(&it.to_string()))
    })?;
    read.remarks.iter_mut().for_each(|it| *it = harmless(it));
    Ok(read)
}

/// One line on a file.
pub(super) fn describe(path: &Path, form: &str, motion: &Motion) -> String {
    let (n_points, n_frames) = (motion.labels.len(), motion.n_frames());
    let rate = match motion.rate_hz {
        Some(rate) => format!("at {} Hz", (rate * 1000.0).round() / 1000.0),
        None => "at irregular times".to_owned(),
    };
    let unit = motion.unit.as_ref().map_or("m", |it| it.0.as_str());
    let all = n_points * n_frames;
    let missing = all - motion.n_present();
    let share =
        if missing == 0 { String::new() } else { format!(", {:.1} % missing", 100.0 * missing as f64 / all as f64) };
    let points = if n_points == 1 { "1 point".to_owned() } else { format!("{n_points} points") };
    harmless(&format!(
        "{}: {form}, {points}, {n_frames} frames {rate} from {:.3} s, {unit}, {} up{share}",
        path.display(),
        motion.start_s(),
        motion.up.name()
    ))
}

/// Writes a file under another name first, so that it is whole or not there.
pub(super) fn write_whole(path: &Path, bytes: &[u8], is_forced: bool) -> Result<(), String> {
    let shown = path.display();
    if !is_forced && path.exists() {
        return Err(format!("`{shown}` is there already and is left as it is; choose another name, or --force"));
    }
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    let written =
        File::create(&part).and_then(|mut it| it.write_all(bytes)).and_then(|()| std::fs::rename(&part, path));
    written.map_err(|it| {
        std::fs::remove_file(&part).ok();
        format!("`{shown}` cannot be written: {it}")
    })
}
