//! Reads motion files of any format, recognised by content, into [`Motion`]s, and writes them.

mod bvh;
mod c3d;
mod npz;
mod table;
mod trc;
mod units;

use std::fmt;

use crate::motion::{Motion, Up};

pub use units::unit_length;

/// Format of a motion file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// C3D points.
    C3d,
    /// TRC points.
    Trc,
    /// BVH skeleton.
    Bvh,
    /// Our own CSV table of targets or marks.
    Table,
    /// NumPy archive, as `export.npy` writes it.
    Npz,
}

/// The forms that are read, for who names a file of none of them.
pub const MOTION_FORMS: &str = "a motion file: C3D, TRC, BVH, NPZ of `export.npy`, or a table of targets or marks (CSV with `time_s`, `target` or `mark`, `x_m`, `y_m`, `z_m`)";

impl Form {
    /// All formats.
    pub const ALL: [Form; 5] = [Form::C3d, Form::Trc, Form::Bvh, Form::Table, Form::Npz];

    /// File extension and name of the format.
    pub const fn name(self) -> &'static str {
        match self {
            Form::C3d => "c3d",
            Form::Trc => "trc",
            Form::Bvh => "bvh",
            Form::Table => "csv",
            Form::Npz => "npz",
        }
    }

    /// Format of a file by its first bytes; `None`: none of these.
    pub fn of(bytes: &[u8]) -> Option<Form> {
        if bytes.starts_with(b"PK\x03\x04") {
            return Some(Form::Npz);
        }
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let begins = |word: &str| {
            let start = text.iter().position(|it| !it.is_ascii_whitespace()).unwrap_or(text.len());
            text[start..].get(..word.len()).is_some_and(|it| it.eq_ignore_ascii_case(word.as_bytes()))
        };
        if begins("PathFileType") {
            Some(Form::Trc)
        } else if begins("HIERARCHY") {
            Some(Form::Bvh)
        } else if table::is_table(text) {
            Some(Form::Table)
        } else if is_c3d(bytes) {
            Some(Form::C3d)
        } else {
            None
        }
    }

    /// Format of a file by its extension.
    pub fn of_ending(ending: &str) -> Option<Form> {
        Form::ALL.into_iter().find(|it| it.name().eq_ignore_ascii_case(ending))
    }
}

impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Form::C3d => "C3D",
            Form::Trc => "TRC",
            Form::Bvh => "BVH",
            Form::Table => "CSV",
            Form::Npz => "NPZ",
        })
    }
}

/// The mark of C3D in the second byte, behind a number of a block that is no letter, or that leads to a processor.
fn is_c3d(bytes: &[u8]) -> bool {
    let Some(&[block, 0x50]) = bytes.first_chunk::<2>() else { return false };
    let processor = bytes.get((usize::from(block.max(1)) - 1) * 512 + 3);
    block >= 1 && (block < b' ' || processor.is_some_and(|it| (84..=86).contains(it)))
}

/// What a file may not say itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ReadOptions {
    /// Length of the file's unit, overriding the file; `None`: as the file says [m].
    pub metres_per_unit: Option<f64>,
    /// Axis that is up, overriding the file; `None`: as the file says, else z in C3D and our own files, y in TRC and BVH.
    pub up: Option<Up>,
}

/// Choices of a format when writing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WriteOptions<'a> {
    /// Unit of lengths in C3D and TRC; `None`: the motion's own, else millimetres.
    pub unit: Option<&'a str>,
    /// Axis that is up in TRC, which does not state it; `None`: y, as its readers assume.
    pub up: Option<Up>,
}

/// Why a file cannot be read or written: the byte or line, what was found and what was expected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MotionError(pub String);

impl fmt::Display for MotionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for MotionError {}

/// A file that was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Read {
    /// The motion.
    pub motion: Motion,
    /// Its format.
    pub form: Form,
    /// Contradictions and gaps in the file, and how they were resolved.
    pub remarks: Vec<String>,
}

/// A file that was made from a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Written {
    /// Content of the file.
    pub bytes: Vec<u8>,
    /// Parts of the motion that the format cannot hold.
    pub lost: Vec<String>,
    /// Lossless changes to the motion.
    pub notes: Vec<String>,
}

/// Reads a file; its format is recognised by content.
///
/// # Errors
/// The byte or line, what was found and what was expected.
pub fn read(bytes: &[u8], options: &ReadOptions) -> Result<Read, MotionError> {
    let Some(form) = Form::of(bytes) else {
        if let Some(why) = nearly_table(bytes) {
            return Err(MotionError(why));
        }
        let found = bytes.iter().take(16).map(|it| format!("{it:02x}")).collect::<Vec<_>>().join(" ");
        return Err(MotionError(format!(
            "found a file of {} bytes that begins with `{found}`, expected {MOTION_FORMS}",
            bytes.len()
        )));
    };
    read_as(bytes, form, options)
}

/// Why a file that looks like a table of targets or marks is not valid: its separator, or missing columns; `None`: it does not look like one.
pub fn nearly_table(bytes: &[u8]) -> Option<String> {
    match Form::of(bytes) {
        None => table::nearly(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)),
        Some(_) => None,
    }
}

/// Reads a file of a given format. See [`read`].
///
/// # Errors
/// As [`read`].
pub fn read_as(bytes: &[u8], form: Form, options: &ReadOptions) -> Result<Read, MotionError> {
    let (mut motion, mut remarks) = match form {
        Form::C3d => c3d::read(bytes, options)?,
        Form::Trc => trc::read(&text(bytes), options)?,
        Form::Bvh => bvh::read(&text(bytes), options)?,
        Form::Table => table::read(&text(bytes))?,
        Form::Npz => npz::read(bytes)?,
    };
    let n_renamed = motion.make_names_unique();
    if n_renamed > 0 {
        remarks.push(format!("{n_renamed} points have an empty or repeated name; they were renamed"));
    }
    if let Some(up) = options.up {
        motion.up = up;
    }
    Ok(Read { motion, form, remarks })
}

/// Text; what is not UTF-8 is taken as Latin-1.
fn text(bytes: &[u8]) -> std::borrow::Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.into(),
        Err(_) => bytes.iter().map(|&it| char::from(it)).collect::<String>().into(),
    }
}

/// Encodes `motion`, called `name`, as a file. Points are rotated where the format has a fixed axis that is up: y in TRC, z in our own formats.
///
/// # Errors
/// What the format cannot hold.
pub fn write(motion: &Motion, form: Form, name: &str, options: &WriteOptions<'_>) -> Result<Written, MotionError> {
    match form {
        Form::C3d => c3d::write(motion, options.unit),
        Form::Trc => trc::write(motion, name, options),
        Form::Bvh => bvh::write(motion),
        Form::Table => table::write(motion),
        Form::Npz => npz::write(motion),
    }
}

/// What a file that has positions alone loses of a motion, besides what it says itself.
fn lost(motion: &Motion, keeps: Keeps) -> Vec<String> {
    use foveate_messages::Provenance;
    let mut lost = motion.besides.clone();
    let count = |n: usize, what: &str| (n > 0).then(|| format!("{n} {what}"));
    let is_known = |it: &crate::motion::Sample| it.sigma().is_some_and(|it| it > 0.0);
    let n_known = motion.samples.iter().flatten().filter(|it| is_known(it)).count();
    if !keeps.uncertainty {
        lost.extend(count(n_known, "residuals or covariances"));
    }
    if !keeps.provenance {
        lost.extend(count(motion.n_of(Provenance::Filled), "samples were filled in, and now look measured"));
    }
    if !keeps.predicted {
        lost.extend(count(motion.n_of(Provenance::Predicted), "samples that were only predicted, now missing"));
    }
    if !keeps.cameras && motion.samples.iter().flatten().any(|it| !it.cameras.is_empty()) {
        lost.push("the cameras that saw each sample".to_owned());
    }
    if !keeps.start && motion.start_s() != 0.0 {
        lost.push(start_lost(motion));
    }
    if !keeps.events {
        lost.extend(count(motion.events.len(), "events"));
    }
    if let Some(skeleton) = &motion.skeleton {
        lost.push(format!(
            "the skeleton: joints of {} bones become points without rotations",
            skeleton.motion.joints.len()
        ));
    }
    lost
}

/// A remark that the format cannot state the time of the first frame.
pub fn start_lost(motion: &Motion) -> String {
    format!("the start time: the first frame is at {:.6} s, and becomes 0 s", motion.start_s())
}

/// What a form can tell.
#[derive(Debug, Clone, Copy, Default)]
struct Keeps {
    uncertainty: bool,
    provenance: bool,
    predicted: bool,
    cameras: bool,
    events: bool,
    start: bool,
}

#[cfg(test)]
mod tests;
