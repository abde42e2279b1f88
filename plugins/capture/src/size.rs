//! The size of pictures before there is a calibration that states it.

use std::path::Path;

use foveate::prelude::*;

use crate::decode::Decoder;
use crate::ffmpeg::{Dialect, Programs};
use crate::listing::{Listing, Numbering};
use crate::settings::Format;

/// Columns, rows of the first picture of a folder that can be read [px].
///
/// # Errors
/// A sentence that follows the path: there is no such picture, and what is wrong with the first.
pub fn of_pictures(folder: &Path) -> Result<[u32; 2], String> {
    let listing = Listing::of(folder, Numbering::Order, None).map_err(|what| format!("cannot be used: {what}"))?;
    let (mut decoder, mut image) = (Decoder::default(), Image::default());
    let mut first = None;
    for frame in &listing.frames {
        match decoder.read(&frame.path, Format::Gray, None, &mut image) {
            Ok(()) => return Ok([image.width, image.height]),
            Err(what) => drop(first.get_or_insert(format!("{} {what}", frame.path.display()))),
        }
    }
    Err(format!("holds no picture that can be read; {}", first.unwrap_or_default()))
}

/// Columns, rows of the first frame of a video, as it is shown [px].
///
/// # Errors
/// A sentence that follows the path: `ffmpeg` is not there, or gives no frame.
pub fn of_video(path: &Path) -> Result<[u32; 2], String> {
    let programs = Programs::default();
    let mut complaints = None;
    for dialect in [Dialect::Current, Dialect::Older] {
        let mut decoder = programs.decode(path, Format::Gray, "", 1, dialect)?;
        if let Some(frame) = decoder.next() {
            return Ok(frame.size);
        }
        complaints = decoder.end().complaints;
    }
    Err(format!("is no video that ffmpeg can decode; it says `{}`", complaints.unwrap_or_else(|| "nothing".to_owned())))
}
