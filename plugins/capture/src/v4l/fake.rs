//! A camera that does as a script says, with a clock that runs only while it is waited for.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use foveate::prelude::ConfigError;

use super::device::{Device, DeviceClock, Filled, FourCc, Layout, Trouble};
use super::settings::V4lSettings;

/// Time between two frames [ns].
pub(crate) const PERIOD: i64 = 20_000_000;
/// From the stamp of a frame to its arrival [ns].
pub(crate) const LATENCY: i64 = 3_000_000;

/// One thing that the camera does.
#[derive(Debug, Clone)]
pub(crate) enum Act {
    /// A frame comes, the next one that the camera counts.
    Frame,
    /// The same with these bytes.
    Bytes(Vec<u8>),
    /// A frame that the driver calls damaged.
    Damaged,
    /// A frame with a stamp of another clock.
    Unstamped,
    /// So many frames are seen and never given.
    Lose(u32),
    /// The next frame has this number.
    Number(u32),
    /// Nothing comes for so many frames' time.
    Nothing(u32),
    /// The driver reports an error.
    Error,
    /// The cable is pulled; this many attempts to open fail before it is there again.
    Unplug(u32),
    /// The next starts of the stream fail, this many.
    NoStart(u32),
}

/// A camera that does as a script says; after its end nothing comes any more.
pub(crate) struct Fake {
    layout: Layout,
    script: VecDeque<Act>,
    now: Arc<AtomicI64>,
    sequence: u32,
    /// Attempts to open and to start that will fail.
    absent: u32,
    failing: u32,
    /// The clock keeps real time while a frame is waited for.
    pub(crate) keeps_time: bool,
    is_open: bool,
    is_streaming: bool,
    /// The calls that were made.
    pub(crate) log: Arc<Mutex<Vec<&'static str>>>,
}

impl Fake {
    /// A camera of 2 × 2 pixels.
    pub(crate) fn new(fourcc: &FourCc, script: &[Act]) -> Self {
        let stride = if fourcc == b"MJPG" { 0 } else { 2 };
        Self {
            layout: Layout { fourcc: *fourcc, size: [2, 2], stride, full_range: true, period: Some(PERIOD) },
            script: script.iter().cloned().collect(),
            now: Arc::new(AtomicI64::new(1_000_000_000_000)),
            sequence: 0,
            absent: 0,
            failing: 0,
            keeps_time: false,
            is_open: false,
            is_streaming: false,
            log: Arc::default(),
        }
    }

    fn pass(&self, time: i64) {
        if self.keeps_time {
            std::thread::sleep(Duration::from_nanos(time.unsigned_abs()));
        }
        self.now.fetch_add(time, Ordering::SeqCst);
    }

    fn note(&self, word: &'static str) {
        self.log.lock().unwrap().push(word);
    }
}

impl Device for Fake {
    fn open(&mut self) -> Result<Layout, ConfigError> {
        self.note("open");
        self.pass(PERIOD);
        if self.absent > 0 {
            self.absent -= 1;
            return Err(ConfigError::at("device", "`/dev/video7` is not there"));
        }
        self.is_open = true;
        Ok(self.layout)
    }

    fn change(&mut self, settings: &V4lSettings) -> Result<(), ConfigError> {
        self.note("change");
        match settings.gain {
            Some(gain) if gain > 100 => {
                Err(ConfigError::at("gain", format_args!("found {gain}, the device takes 0 to 100")))
            }
            _ => Ok(()),
        }
    }

    fn start(&mut self) -> Result<(), Trouble> {
        self.note("start");
        assert!(!self.is_streaming, "started twice");
        if self.failing > 0 {
            self.failing -= 1;
            return Err(Trouble::Interrupted("it does not start".to_owned()));
        }
        self.is_streaming = true;
        self.sequence = 0;
        Ok(())
    }

    fn next(&mut self, wait: Duration, read: &mut dyn FnMut(&Filled, &[u8])) -> Result<bool, Trouble> {
        assert!(self.is_streaming, "a picture was requested while not streaming");
        let act = self.script.pop_front();
        let arrived = matches!(act, Some(Act::Frame | Act::Bytes(_) | Act::Damaged | Act::Unstamped));
        if arrived {
            self.pass(PERIOD);
            let now = self.now.load(Ordering::SeqCst);
            let bytes = if let Some(Act::Bytes(bytes)) = &act { bytes.clone() } else { vec![self.sequence as u8; 4] };
            let stamp = if let Some(Act::Unstamped) = act { 1_700_000_000_000_000_000 } else { now - LATENCY };
            let filled = Filled {
                used: bytes.len(),
                sequence: self.sequence,
                stamp: Some(stamp),
                at_start: true,
                damaged: matches!(act, Some(Act::Damaged)),
            };
            // The mapped buffer is larger than what is in it.
            read(&filled, &[bytes, vec![9; 3]].concat());
            self.sequence = self.sequence.wrapping_add(1);
            return Ok(true);
        }
        match act {
            Some(Act::Lose(count)) => {
                self.sequence = self.sequence.wrapping_add(count);
                self.pass(PERIOD * i64::from(count));
            }
            Some(Act::Number(number)) => self.sequence = number,
            Some(Act::Nothing(frames)) => self.pass(PERIOD * i64::from(frames)),
            Some(Act::Error) => return Err(Trouble::Interrupted("the driver reports: EIO".to_owned())),
            Some(Act::Unplug(attempts)) => {
                self.absent = attempts;
                return Err(Trouble::Gone("the camera is gone: ENODEV".to_owned()));
            }
            Some(Act::NoStart(times)) => {
                self.failing = times;
                return Err(Trouble::Interrupted("the driver reports: EIO".to_owned()));
            }
            _ => {
                // Real time is let pass, so that a thread over this camera does not spin.
                std::thread::sleep(Duration::from_millis(1));
                self.pass(wait.as_nanos() as i64);
            }
        }
        Ok(false)
    }

    fn stop(&mut self) {
        self.is_streaming = false;
    }

    fn close(&mut self) {
        self.note("close");
        self.is_streaming = false;
        self.is_open = false;
    }

    fn clock(&self) -> DeviceClock {
        let now = Arc::clone(&self.now);
        Arc::new(move || now.load(Ordering::SeqCst))
    }
}
