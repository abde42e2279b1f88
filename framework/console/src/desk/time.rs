//! Time as pages want it: pause, steps, recordings, notes.

use std::io::Write;
use std::time::Instant;

use foveate_messages::Interval;

use super::Desk;
use crate::commands::TimeCommand;
use crate::source::Source;

impl Desk {
    /// Begins a recording, or ends it.
    pub(super) fn record(&mut self, is_on: bool) -> Result<String, String> {
        let now = self.now();
        let record = self.record.as_mut().ok_or("nothing can be recorded here")?;
        match (is_on, self.recording.is_some()) {
            (true, true) => return Err("it is recorded already".to_owned()),
            (false, false) => return Err("nothing is being recorded".to_owned()),
            _ => {}
        }
        if is_on {
            let path = record(Some(now))?;
            let words = format!("recording to {path}");
            self.recording = Some(path);
            return Ok(words);
        }
        self.recording = None;
        record(None)
    }

    /// Does what a page wants of time.
    pub(super) fn turn(&mut self, command: TimeCommand) -> Result<String, String> {
        if !self.can_wait {
            return Err("a live run cannot wait".to_owned());
        }
        let now = Instant::now();
        let Source::Session(playing) = &mut self.source else {
            let until = match command {
                TimeCommand::Pause => Some(self.now()),
                TimeCommand::Go => None,
                TimeCommand::Step { is_forward: true } => {
                    let from = self.controls.held().unwrap_or_else(|| self.now());
                    Some(from + self.step - Interval(1))
                }
                _ => return Err("a run only goes forwards; record it, and look at the session".to_owned()),
            };
            self.controls.go_until(until);
            return Ok(String::new());
        };
        match command {
            TimeCommand::Pause => playing.play(false, now),
            TimeCommand::Go => playing.play(true, now),
            TimeCommand::Step { is_forward } => playing.step(is_forward),
            TimeCommand::Seek(to) => playing.seek(to),
            TimeCommand::Repeat(part) => playing.repeat(part)?,
            TimeCommand::Speed(factor) => playing.set_speed(factor),
        }
        Ok(String::new())
    }

    pub(super) fn note(&self, at_s: f64, note: &str) -> Result<String, String> {
        let folder = self.out_dir.as_ref().ok_or("there is no folder for notes")?;
        let path = folder.join("notes.csv");
        let is_new = !path.exists();
        let line = format!("{at_s:.3},\"{}\"\n", note.replace('"', "\"\"").replace(['\r', '\n'], " "));
        let written = std::fs::OpenOptions::new().create(true).append(true).open(&path).and_then(|mut file| {
            let heading = if is_new { "time_s,note\n" } else { "" };
            file.write_all(format!("{heading}{line}").as_bytes())
        });
        written.map_err(|error| format!("`{}` cannot be written: {error}", path.display()))?;
        Ok(format!("noted in {}", path.display()))
    }
}
