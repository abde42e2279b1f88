//! A child process: frames on its standard input and output, each within a deadline; the end of what it writes on standard error is kept.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{ChildStderr, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use foveate_node::{ConfigError, NodeError};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::process::{Pid, Signal, kill_process, kill_process_group};
use serde_json::Value;

/// Longest frame that is read [bytes].
pub const LONGEST_FRAME: usize = 64 << 20;
/// How much of its standard error is kept [bytes].
const KEPT: usize = 2000;
/// Environment variable that marks a process node and all processes that it starts.
const MARK: &str = "FOVEATE_PROCESS";
/// Most rounds of searching `/proc` for processes to kill, so that a fork bomb does not hold up the end of a run.
const KILL_ROUNDS: usize = 10;
/// How long a process that closed its output has to end [ms].
const TO_END_MS: f64 = 200.0;

/// The program that `command` starts, so that one that is missing is found before a run.
pub(super) fn find(command: &[String], dir: &Path) -> Result<PathBuf, ConfigError> {
    let Some(program) = command.first().filter(|it| !it.is_empty()) else {
        return Err(ConfigError::at("command", "found nothing, expected a program and its arguments"));
    };
    let path = Path::new(program);
    if path.components().count() > 1 {
        let path = dir.join(path);
        return match path.is_file() {
            // Not where a link leads: the name that a program is started by may matter to it, as to a Python of a virtual environment.
            true => Ok(std::path::absolute(&path).unwrap_or(path)),
            false => {
                Err(ConfigError::at("command", format_args!("found no file `{}`, expected a program", path.display())))
            }
        };
    }
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&folders).map(|it| it.join(path)).find(|it| it.is_file());
    found.ok_or_else(|| ConfigError::at("command", format_args!("found no program `{program}` on the PATH")))
}

/// A process that answers frames.
pub(super) struct Child {
    child: std::process::Child,
    program: String,
    mark: String,
    input: ChildStdin,
    output: ChildStdout,
    errors: Option<ChildStderr>,
    said: VecDeque<u8>,
}

impl Child {
    pub fn start(command: &[String], dir: &Path) -> Result<Self, NodeError> {
        let program = find(command, dir).map_err(|error| NodeError::input(error.message))?;
        let name = command.join(" ");
        let failed =
            |error: &dyn std::fmt::Display| NodeError::input(format_args!("`{name}` cannot be started: {error}"));
        let mut child = Command::new(program);
        child.args(&command[1..]).current_dir(dir).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // Processes that the program starts are killed with it: those of its group, and those that carry its mark.
        static N_STARTED: AtomicU64 = AtomicU64::new(0);
        let mark = format!("{}.{}", std::process::id(), N_STARTED.fetch_add(1, Ordering::Relaxed));
        child.process_group(0).env(MARK, &mark);
        let mut child = child.spawn().map_err(|error| failed(&error))?;
        let (Some(input), Some(output), errors) = (child.stdin.take(), child.stdout.take(), child.stderr.take()) else {
            return Err(failed(&"it has no standard input and output"));
        };
        let it = Self { child, program: name.clone(), mark, input, output, errors, said: VecDeque::new() };
        // A process that does not read must not hold up who writes.
        let flags = fcntl_getfl(&it.input).map_err(|error| failed(&error))?;
        fcntl_setfl(&it.input, flags | OFlags::NONBLOCK).map_err(|error| failed(&error))?;
        Ok(it)
    }

    /// Sends a frame and gives the one that answers it. `text` is a buffer to be used again.
    ///
    /// # Errors
    /// What the process did instead: ended, took too long, or sent what is no frame.
    pub fn ask(&mut self, text: &mut Vec<u8>, frame: &Value, deadline_ms: f64) -> Result<Value, String> {
        let until = Instant::now() + Duration::from_secs_f64(deadline_ms / 1e3);
        let late = |doing: &str| format!("{doing} within {deadline_ms} ms");
        text.clear();
        text.extend([0; 4]);
        serde_json::to_writer(&mut *text, frame).map_err(|error| error.to_string())?;
        let length = u32::try_from(text.len() - 4).map_err(|_| "was sent more than a frame holds".to_owned())?;
        text[..4].copy_from_slice(&length.to_le_bytes());
        if self.has_spoken()? {
            return Err("sent more than one answer, or one without a request".to_owned());
        }
        self.send(text, until, &late("did not read what it was sent"))?;
        let no_answer = late("did not answer");
        let mut length = [0; 4];
        self.receive(&mut length, until, &no_answer)?;
        let length = u32::from_le_bytes(length) as usize;
        if length > LONGEST_FRAME {
            return Err(format!(
                "sent a frame of {length} bytes, expected at most {LONGEST_FRAME} (does it print on standard output?)"
            ));
        }
        text.clear();
        // Grows with what comes, and not with what is announced.
        while text.len() < length {
            let start = text.len();
            text.resize(length.min(start + (1 << 20)), 0);
            self.receive(&mut text[start..], until, &no_answer)?;
        }
        serde_json::from_slice(text).map_err(|error| format!("sent a frame that is no JSON: {error}"))
    }

    /// Whether there is something to be read that answers nothing; who has closed its output, has ended.
    fn has_spoken(&mut self) -> Result<bool, String> {
        let mut ends = [PollFd::new(&self.output, PollFlags::IN)];
        let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
        match poll(&mut ends, Some(&at_once)) {
            Ok(n) if n > 0 && ends[0].revents().contains(PollFlags::IN) => Ok(true),
            Ok(n) if n > 0 => Err(self.ended()),
            _ => Ok(false),
        }
    }

    /// Ends the process and all that it started.
    fn kill(&mut self) {
        if let Some(group) = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw) {
            let _ = kill_process_group(group, Signal::KILL); // nobody is left: it has ended by itself
        }
        let _ = self.child.kill();
        let mark = format!("{MARK}={}", self.mark).into_bytes();
        // A process that is started meanwhile is found in the next round, and so is one that had no environment for the moment in which it
        // became another program. One that may not be killed stays.
        for round in 0..KILL_ROUNDS {
            let left = std::fs::read_dir("/proc").into_iter().flatten().flatten().filter_map(|it| {
                let environment = std::fs::read(it.path().join("environ")).ok()?;
                let is_marked = environment.split(|it| *it == 0).any(|it| it == mark);
                Pid::from_raw(it.file_name().to_str()?.parse().ok()?).filter(|_| is_marked)
            });
            if left.filter(|it| kill_process(*it, Signal::KILL).is_ok()).count() == 0 && round > 0 {
                break;
            }
        }
    }

    fn send(&mut self, mut bytes: &[u8], until: Instant, late: &str) -> Result<(), String> {
        while !bytes.is_empty() {
            match self.input.write(bytes) {
                Ok(n) => bytes = &bytes[n..],
                Err(error) if error.kind() == ErrorKind::WouldBlock => self.wait(true, until, late)?,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Err(self.ended()),
            }
        }
        Ok(())
    }

    fn receive(&mut self, mut space: &mut [u8], until: Instant, late: &str) -> Result<(), String> {
        while !space.is_empty() {
            self.wait(false, until, late)?;
            match self.output.read(space) {
                Ok(0) => return Err(self.ended()),
                Ok(n) => space = &mut space[n..],
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(format!("cannot be read from: {error}")),
            }
        }
        Ok(())
    }

    /// Waits until the process reads (`to_write`) or has written, and takes up what it says meanwhile.
    fn wait(&mut self, to_write: bool, until: Instant, late: &str) -> Result<(), String> {
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let left = Timespec { tv_sec: left.as_secs() as i64, tv_nsec: i64::from(left.subsec_nanos()) };
            let pipe = match to_write {
                true => PollFd::new(&self.input, PollFlags::OUT),
                false => PollFd::new(&self.output, PollFlags::IN),
            };
            let mut ends = vec![pipe];
            ends.extend(self.errors.as_ref().map(|it| PollFd::new(it, PollFlags::IN)));
            match poll(&mut ends, Some(&left)) {
                Ok(0) => return Err(late.to_owned()),
                Ok(_) => {}
                Err(rustix::io::Errno::INTR) => continue,
                Err(error) => return Err(format!("cannot be waited for: {error}")),
            }
            let is_ready = !ends[0].revents().is_empty();
            let has_said = ends.get(1).is_some_and(|it| !it.revents().is_empty());
            if has_said {
                self.listen();
            }
            if is_ready {
                return Ok(());
            }
            if Instant::now() >= until {
                return Err(late.to_owned());
            }
        }
    }

    /// Takes up what stands on standard error, one piece.
    fn listen(&mut self) {
        let mut piece = [0; 4096];
        match self.errors.as_mut().map(|it| it.read(&mut piece)) {
            Some(Ok(n)) if n > 0 => {
                self.said.extend(&piece[..n]);
                let over = self.said.len().saturating_sub(KEPT);
                self.said.drain(..over);
            }
            _ => self.errors = None,
        }
    }

    /// The process is gone: how it ended.
    fn ended(&mut self) -> String {
        let until = Instant::now() + Duration::from_secs_f64(TO_END_MS / 1e3);
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) => return format!("ended ({status})"),
                Ok(None) if Instant::now() < until => std::thread::sleep(Duration::from_millis(1)),
                Ok(None) | Err(_) => return "closed its standard output".to_owned(),
            }
        }
    }

    /// The failure that `what` is, with the last that the process said.
    pub fn failure(&mut self, what: &str) -> NodeError {
        self.kill();
        let until = Instant::now() + Duration::from_secs_f64(TO_END_MS / 1e3);
        while let Some(errors) = &self.errors
            && Instant::now() < until
        {
            let mut ends = [PollFd::from_borrowed_fd(errors.as_fd(), PollFlags::IN)];
            let at_once = Timespec { tv_sec: 0, tv_nsec: 10_000_000 };
            match poll(&mut ends, Some(&at_once)) {
                Ok(n) if n > 0 => self.listen(),
                _ => break,
            }
        }
        let said = String::from_utf8_lossy(self.said.make_contiguous()).trim().to_owned();
        let lines: Vec<&str> = said.lines().rev().filter(|it| !it.trim().is_empty()).take(3).collect();
        let said: String = lines.into_iter().rev().collect::<Vec<_>>().join(" | ");
        let said = if said.is_empty() { said } else { format!("; it said: {said}") };
        NodeError::input(format_args!("the process `{}` {what}{said}", self.program))
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        self.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_process_started_in_another_session_ends_with_it_also_when_it_has_ended_itself() {
        for then in ["", "; cat"] {
            let dir = tempfile::tempdir().unwrap();
            let script = format!("setsid sleep 300 & echo $! > pid{then}");
            let child = Child::start(&["sh".to_owned(), "-c".to_owned(), script], dir.path()).unwrap();
            let until = Instant::now() + Duration::from_secs(60);
            let waited = |is_so: &dyn Fn() -> bool| while !is_so() && Instant::now() < until {};
            let pid = || std::fs::read_to_string(dir.path().join("pid")).unwrap_or_default();
            waited(&|| pid().ends_with('\n'));
            let program = format!("/proc/{}/cmdline", pid().trim());
            waited(&|| std::fs::read(&program).is_ok_and(|it| it.starts_with(b"sleep")));
            let environment = format!("/proc/{}/environ", pid().trim());
            let is_alive = || std::fs::read(&environment).is_ok_and(|it| !it.is_empty());
            assert!(is_alive(), "{then}");
            drop(child);
            waited(&|| !is_alive());
            assert!(!is_alive(), "{then}");
        }
    }
}
