//! Files of motion of any form, by their content, into [`Motion`]s and out of them.

mod bvh;
mod c3d;
mod npz;
mod table;
mod trc;
mod units;

use std::fmt;

use crate::motion::{Motion, Up};

pub use units::unit_length;

/// What a file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// C3D.
    C3d,
    /// TRC.
    Trc,
    /// A skeleton that moves.
    Bvh,
    /// Our own table of targets or marks.
    Table,
    /// Arrays for NumPy, as `export.npy` writes them.
    Npz,
}

impl Form {
    /// All of them.
    pub const ALL: [Form; 5] = [Form::C3d, Form::Trc, Form::Bvh, Form::Table, Form::Npz];

    /// The ending of such files, which is also what they are called.
    pub const fn name(self) -> &'static str {
        match self {
            Form::C3d => "c3d",
            Form::Trc => "trc",
            Form::Bvh => "bvh",
            Form::Table => "csv",
            Form::Npz => "npz",
        }
    }

    /// By what a file begins with; `None`: none of these.
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

    /// By the ending of a file's name.
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

/// What a file does not say itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ReadOptions {
    /// How long a unit of the file is, whatever it says itself; `None`: as it says [m].
    pub metres_per_unit: Option<f64>,
    /// Which axis is up, whatever the file says; `None`: as it says, else z in C3D and our own files, y in TRC and BVH.
    pub up: Option<Up>,
}

/// How a file is to be written, where its form leaves a choice.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WriteOptions<'a> {
    /// The unit of lengths in C3D and TRC; `None`: the motion's own, else millimetres.
    pub unit: Option<&'a str>,
    /// Which axis is up in TRC, which does not say it; `None`: y, as its readers take it.
    pub up: Option<Up>,
}

/// What is wrong with a file: the byte or the line, what is there and what should be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MotionError(pub String);

impl fmt::Display for MotionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for MotionError {}

/// What a file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Read {
    /// The points.
    pub motion: Motion,
    /// What the file is.
    pub form: Form,
    /// What in it contradicts itself or is left open, and how it was taken.
    pub remarks: Vec<String>,
}

/// What was made of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Written {
    /// The file.
    pub bytes: Vec<u8>,
    /// What of the motion it cannot tell.
    pub lost: Vec<String>,
    /// What was done to the motion and loses nothing, in words.
    pub notes: Vec<String>,
}

/// Reads a file of any form; its content decides.
///
/// # Errors
/// The byte or the line, what is there and what should be.
pub fn read(bytes: &[u8], options: &ReadOptions) -> Result<Read, MotionError> {
    let Some(form) = Form::of(bytes) else {
        if let Some(why) = nearly_table(bytes) {
            return Err(MotionError(why));
        }
        let found = bytes.iter().take(16).map(|it| format!("{it:02x}")).collect::<Vec<_>>().join(" ");
        return Err(MotionError(format!(
            "found a file of {} bytes that begins with `{found}`, expected C3D, TRC, BVH, an archive of `export.npy`, or a table of targets or marks",
            bytes.len()
        )));
    };
    read_as(bytes, form, options)
}

/// Why a file that looks like a table of targets or marks is none: its separator, or the columns that are missing; `None`: it does not look so.
pub fn nearly_table(bytes: &[u8]) -> Option<String> {
    match Form::of(bytes) {
        None => table::nearly(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)),
        Some(_) => None,
    }
}

/// Reads a file as one of this form. See [`read`].
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
    let n_renamed = motion.name_apart();
    if n_renamed > 0 {
        remarks.push(format!(
            "{n_renamed} points have an empty name or one that another has; they got names of their own"
        ));
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

/// A file of `motion` called `name`. Points are turned where the form has one axis that is up: y in TRC, z in our own forms.
///
/// # Errors
/// What cannot be told in such a file.
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
            "the skeleton: joints of {} bones stand as points, and do not turn",
            skeleton.motion.joints.len()
        ));
    }
    lost
}

/// That a form cannot say when the first frame is.
pub fn start_lost(motion: &Motion) -> String {
    format!("when it begins: the first frame is at {:.6} s, and is at 0 s now", motion.start_s())
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
