//! An `ffmpeg` child process that decodes one video into raw pixels on a pipe.

use std::ffi::{OsStr, OsString};
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;

use serde_json::Value;

use crate::ffmpeg_words::{Announced, Listener, fraction};
use crate::settings::Format;

/// The two programs.
#[derive(Debug, Clone)]
pub(crate) struct Programs {
    pub(crate) ffmpeg: OsString,
    pub(crate) ffprobe: OsString,
}

impl Default for Programs {
    fn default() -> Self {
        Self { ffmpeg: "ffmpeg".into(), ffprobe: "ffprobe".into() }
    }
}

/// Option that keeps ffmpeg from duplicating or dropping frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dialect {
    /// Since version 5.1.
    Current,
    /// Before.
    Older,
}

impl Dialect {
    fn frames_as_they_are(self) -> [&'static str; 2] {
        match self {
            Dialect::Current => ["-fps_mode", "passthrough"],
            Dialect::Older => ["-vsync", "0"],
        }
    }
}

/// What a file's header says about its first video stream; headers may be wrong.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Header {
    /// Frames a second on average [Hz].
    pub(crate) rate_hz: Option<f64>,
    /// Frames in the stream.
    pub(crate) n_frames: Option<u64>,
}

/// How a child process ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Ending {
    /// The exit code was 0.
    pub(crate) success: bool,
    /// Its error messages, if any.
    pub(crate) complaints: Option<String>,
    /// Number of error messages.
    pub(crate) n_complaints: u64,
    /// It does not support [`Dialect::Current`].
    pub(crate) spoke_older: bool,
}

/// A running `ffmpeg`; killed and waited for when dropped.
#[derive(Debug)]
pub(crate) struct Decoder {
    child: Child,
    pixels: ChildStdout,
    announced: Receiver<Announced>,
    listener: Option<JoinHandle<Listener>>,
}

impl Programs {
    /// Which of the two programs is not on `path`, and how to install it: for checks, which start nothing.
    pub(crate) fn missing(&self, path: Option<&OsStr>) -> Option<String> {
        let folders: Vec<_> = path.map(|it| std::env::split_paths(it).collect()).unwrap_or_default();
        let is_there = |program: &OsString| {
            let mut file = program.clone();
            file.push(std::env::consts::EXE_SUFFIX);
            folders.iter().any(|it| is_program(&it.join(&file)))
        };
        let absent = [&self.ffmpeg, &self.ffprobe].into_iter().find(|it| !is_there(it))?;
        Some(cannot_start(&absent.to_string_lossy(), &ErrorKind::NotFound.into()))
    }

    /// Reads the header of `path`; all fields are unknown where `ffprobe` cannot read it.
    ///
    /// # Errors
    /// `ffprobe` cannot be started.
    pub(crate) fn header(&self, path: &Path) -> Result<Header, String> {
        let output = Command::new(&self.ffprobe)
            .args(["-v", "quiet", "-print_format", "json", "-select_streams", "v:0"])
            .args(["-show_entries", "stream=avg_frame_rate,nb_frames"])
            .arg(as_file(path))
            .stdin(Stdio::null())
            .output()
            .map_err(|error| cannot_start("ffprobe", &error))?;
        let json: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        let text = |name: &str| json.get("streams")?.get(0)?.get(name)?.as_str();
        Ok(Header {
            rate_hz: text("avg_frame_rate")
                .and_then(fraction)
                .map(|(numerator, denominator)| numerator as f64 / denominator as f64),
            n_frames: text("nb_frames").and_then(|it| it.parse().ok()),
        })
    }

    /// Starts decoding `path`. `filter`: a chain of `ffmpeg`'s filters for the frames, may be empty. `threads`: how many to decode
    /// on, 0: chosen by `ffmpeg`.
    ///
    /// # Errors
    /// `ffmpeg` cannot be started. Errors of the file are reported by [`Decoder::end`].
    pub(crate) fn decode(
        &self,
        path: &Path,
        format: Format,
        filter: &str,
        threads: u32,
        dialect: Dialect,
    ) -> Result<Decoder, String> {
        let pixel_format = match format {
            Format::Gray => "gray",
            Format::Rgb => "rgb24",
        };
        // What is announced is what leaves the chain.
        let chain =
            if filter.is_empty() { "showinfo=checksum=0".into() } else { format!("{filter},showinfo=checksum=0") };
        let mut command = Command::new(&self.ffmpeg);
        // Ctrl-C goes to all processes of a terminal's group: the run ends by it, and ends the child in its own time.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command
            .args(["-nostdin", "-hide_banner", "-nostats", "-loglevel", "level+info"])
            .args(["-fflags", "+discardcorrupt", "-threads", &threads.to_string(), "-i"])
            .arg(as_file(path))
            .args(["-map", "0:v:0", "-an", "-sn", "-dn", "-vf", &chain])
            .args(dialect.frames_as_they_are())
            .args(["-f", "rawvideo", "-pix_fmt", pixel_format, "pipe:1"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| cannot_start("ffmpeg", &error))?;
        let (Some(pixels), Some(words)) = (child.stdout.take(), child.stderr.take()) else {
            unreachable!("both pipes were requested")
        };
        let (sender, announced) = channel();
        let listener = std::thread::spawn(move || {
            let mut listener = Listener::default();
            let mut words = BufReader::new(words);
            let mut line = Vec::new();
            while words.read_until(b'\n', &mut line).is_ok_and(|length| length > 0) {
                if let Some(frame) = listener.hear(&String::from_utf8_lossy(&line)) {
                    // Nobody listens any more when the node is being dropped; the pipe is drained all the same.
                    sender.send(frame).ok();
                }
                line.clear();
            }
            listener
        });
        Ok(Decoder { child, pixels, announced, listener: Some(listener) })
    }
}

impl Decoder {
    /// The next frame's time and size; `None` after the last frame.
    pub(crate) fn next(&mut self) -> Option<Announced> {
        self.announced.recv().ok()
    }

    /// Reads the pixels of the frame that was announced last. `false`: they are incomplete.
    pub(crate) fn read(&mut self, pixels: &mut [u8]) -> bool {
        self.pixels.read_exact(pixels).is_ok()
    }

    /// Waits for the process to end, after the last frame.
    pub(crate) fn end(mut self) -> Ending {
        let success = self.child.wait().is_ok_and(|status| status.success());
        let listener = self.listener.take().and_then(|it| it.join().ok()).unwrap_or_default();
        Ending {
            success,
            complaints: listener.complaints(),
            n_complaints: listener.n_complaints(),
            spoke_older: listener.complained_of("fps_mode"),
        }
    }
}

impl Drop for Decoder {
    fn drop(&mut self) {
        // Each fails only where the process has ended already.
        drop(self.child.kill());
        drop(self.child.wait());
        if let Some(listener) = self.listener.take() {
            drop(listener.join());
        }
    }
}

/// The path under the protocol `file:`, so that no name is taken for an option or an address.
pub(crate) fn as_file(path: &Path) -> OsString {
    let mut text = OsString::from("file:");
    text.push(path);
    text
}

#[cfg(unix)]
fn is_program(file: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt;

    file.metadata().is_ok_and(|it| it.is_file() && it.permissions().mode() & 0o111 != 0)
}

#[cfg(not(unix))]
fn is_program(file: &Path) -> bool {
    file.is_file()
}

pub(crate) fn cannot_start(program: &str, error: &std::io::Error) -> String {
    if error.kind() != ErrorKind::NotFound {
        return format!("`{program}` cannot be started: {error}");
    }
    format!(
        "videos are read and written by `{program}`, which is not on the PATH; install FFmpeg: `apt install ffmpeg`, `dnf install ffmpeg-free`, \
         `brew install ffmpeg` or `winget install ffmpeg`"
    )
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Runs `ffmpeg` on `arguments` to make a test video; `false`, and a line that says so, where it is missing.
    pub(crate) fn make(test: &str, arguments: &str) -> bool {
        let status =
            Command::new("ffmpeg").args(["-nostdin", "-loglevel", "error", "-y"]).args(arguments.split(' ')).status();
        match status {
            Ok(status) => {
                assert!(status.success(), "ffmpeg {arguments}");
                true
            }
            Err(_) => {
                println!("skipped: {test} needs ffmpeg on the PATH");
                false
            }
        }
    }

    #[test]
    fn header_tells_rate_and_count() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a b.mp4");
        let made = folder.path().join("a.mp4");
        if !make(
            "the header of a video",
            &format!("-f lavfi -i testsrc=size=64x48:rate=24:duration=1 {}", made.display()),
        ) {
            return;
        }
        std::fs::rename(made, &path).unwrap();
        let header = Programs::default().header(&path).unwrap();
        assert_eq!(header, Header { rate_hz: Some(24.0), n_frames: Some(24) });
        std::fs::write(&path, "no video").unwrap();
        assert_eq!(Programs::default().header(&path).unwrap(), Header::default());
    }

    #[test]
    fn child_is_gone_when_the_decoder_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.avi");
        let source = "-f lavfi -i testsrc=size=320x240:rate=30:duration=20 -c:v mjpeg";
        if !make("dropping a decoder", &format!("{source} {}", path.display())) {
            return;
        }
        let mut decoder = Programs::default().decode(&path, Format::Gray, "", 1, Dialect::Current).unwrap();
        assert_eq!(decoder.next().unwrap().size, [320, 240]);
        let process = std::path::PathBuf::from(format!("/proc/{}", decoder.child.id()));
        let had_entry = process.exists();
        drop(decoder);
        assert!(!process.exists() || !had_entry, "the child is still there, or a zombie");
    }

    #[test]
    fn older_dialect_works_where_it_is_still_known() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.avi");
        if !make(
            "the older dialect",
            &format!("-f lavfi -i testsrc=size=64x48:rate=24:duration=1 -c:v mjpeg {}", path.display()),
        ) {
            return;
        }
        let mut decoder = Programs::default().decode(&path, Format::Rgb, "", 1, Dialect::Older).unwrap();
        let mut pixels = vec![0; 64 * 48 * 3];
        let mut count = 0;
        while decoder.next().is_some() && decoder.read(&mut pixels) {
            count += 1;
        }
        let ending = decoder.end();
        assert!(count == 24 || ending.complaints.is_some_and(|it| it.contains("vsync")), "{count} frames");
    }

    #[test]
    fn what_is_not_on_the_path_is_named_with_what_to_install() {
        let folder = tempfile::tempdir().unwrap();
        let programs = Programs::default();
        let said = |path: Option<&std::path::Path>| programs.missing(path.map(std::path::Path::as_os_str));
        for path in [None, Some(folder.path())] {
            let said = said(path).unwrap();
            assert!(
                said.contains("`ffmpeg`, which is not on the PATH") && said.contains("apt install ffmpeg"),
                "{said}"
            );
        }
        let make = |name: &str| {
            let file = folder.path().join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
            std::fs::write(&file, "").unwrap();
            file
        };
        let ffmpeg = make("ffmpeg");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            assert!(said(Some(folder.path())).is_some(), "it cannot be executed");
            for file in [ffmpeg, make("ffprobe")] {
                assert!(said(Some(folder.path())).is_some());
                std::fs::set_permissions(file, std::fs::Permissions::from_mode(0o755)).unwrap();
            }
        }
        #[cfg(not(unix))]
        drop((ffmpeg, make("ffprobe")));
        assert_eq!(said(Some(folder.path())), None);
    }
}
