//! An `ffmpeg` child process that makes a film of pictures.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::JoinHandle;

use foveate::prelude::*;

use crate::ffmpeg::{Programs, as_file, cannot_start};

/// What a film is written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FilmForm {
    /// Matroska with FFV1: every level of every pixel.
    Lossless,
    /// MP4 with H.264: small, and shown everywhere.
    Small,
}

impl FilmForm {
    /// The ending of its files.
    pub fn ending(self) -> &'static str {
        match self {
            FilmForm::Lossless => "mkv",
            FilmForm::Small => "mp4",
        }
    }
}

/// A film that is being written; its process is killed where it is not finished.
#[derive(Debug)]
pub struct Encoder {
    child: Child,
    pixels: Option<ChildStdin>,
    words: Option<JoinHandle<String>>,
}

impl Encoder {
    /// Begins the file `path` of pictures like `first`, `rate_hz` a second; a file of that name is overwritten.
    ///
    /// # Errors
    /// `ffmpeg` cannot be started.
    pub fn begin(path: &Path, first: &Image, rate_hz: f64, form: FilmForm) -> Result<Encoder, String> {
        let Programs { ffmpeg, .. } = Programs::default();
        let format = match first.format {
            PixelFormat::Gray8 => "gray",
            PixelFormat::Rgb8 => "rgb24",
        };
        let coder: &[&str] = match form {
            FilmForm::Lossless => &["-c:v", "ffv1", "-level", "3", "-slicecrc", "1"],
            // Pictures of an odd size get a column or row more: H.264 stores colours of two by two pixels.
            FilmForm::Small => {
                &["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-c:v", "libx264", "-crf", "18", "-pix_fmt", "yuv420p"]
            }
        };
        let mut command = Command::new(&ffmpeg);
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command
            .args(["-hide_banner", "-nostats", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", format])
            .args([
                "-s",
                &format!("{}x{}", first.width, first.height),
                "-framerate",
                &format!("{rate_hz}"),
                "-i",
                "pipe:0",
            ])
            .args(coder)
            .arg(as_file(path))
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| cannot_start("ffmpeg", &error))?;
        let pixels = child.stdin.take();
        let words = child.stderr.take().map(|it| {
            std::thread::spawn(move || BufReader::new(it).lines().map_while(Result::ok).collect::<Vec<_>>().join("; "))
        });
        Ok(Encoder { child, pixels, words })
    }

    /// Adds a picture.
    ///
    /// # Errors
    /// What `ffmpeg` says.
    pub fn add(&mut self, image: &Image) -> Result<(), String> {
        let written = self.pixels.as_mut().map_or(Ok(()), |it| it.write_all(&image.pixels));
        written.map_err(|error| format!("ffmpeg says `{}` ({error})", self.last_words()))
    }

    /// Ends the film.
    ///
    /// # Errors
    /// What `ffmpeg` says.
    pub fn finish(mut self) -> Result<(), String> {
        self.pixels = None;
        let is_done = self.child.wait().is_ok_and(|it| it.success());
        if is_done { Ok(()) } else { Err(format!("ffmpeg says `{}`", self.last_words())) }
    }

    fn last_words(&mut self) -> String {
        self.pixels = None;
        let words = self.words.take().and_then(|it| it.join().ok()).unwrap_or_default();
        if words.is_empty() { "nothing".to_owned() } else { words }
    }
}

impl Drop for Encoder {
    fn drop(&mut self) {
        // Each fails only where the process has ended already.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}
