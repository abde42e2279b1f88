//! The pictures of one camera, with recovery from its failures.
//!
//! | what happens | what is done | what the rig sees |
//! |---|---|---|
//! | the driver's frame number jumps | nothing | a gap for each frame left out |
//! | a buffer is marked as damaged, is short or cannot be decoded | nothing | a gap with the reason |
//! | no picture for `timeout_ms`, or an error of the driver (EIO) | the stream is started again, ¹ | a gap with the reason, ² |
//! | the camera disappears (ENODEV) | it is opened again, ever more slowly, at least every two seconds | a gap with the reason, ² |
//!
//! ¹ At the third time without a picture in between, the camera is opened again.
//! ² At the next picture, one more for each frame that is missing in that time.
//!
//! No clock but the device's, no thread, no sleep: [`Stream::step`] says how long to pause.

use std::sync::Arc;
use std::time::Duration;

use foveate::prelude::*;

use super::clock::plausible;
use super::device::{Device, DeviceClock, Filled, Layout, Trouble};
use super::pixels;
use super::settings::V4lSettings;
use crate::decode::Decoder;
use crate::settings::Format;

/// Longest wait for a picture at a stretch: bounds how late the end of a run is noticed.
const WAIT: Duration = Duration::from_millis(50);
/// First and longest pause before a camera is tried again.
const FIRST_PAUSE: Duration = Duration::from_millis(50);
const LONGEST_PAUSE: Duration = Duration::from_secs(2);
/// Starts without a picture after which the camera is opened again.
const STARTS_BEFORE_OPENING: u32 = 3;
/// Frames left out in one place that are each counted as a gap; a longer pause counts as so many.
const GAPS_AT_ONCE: u64 = 1000;

/// One event of a camera.
#[derive(Debug)]
pub(crate) struct Turn {
    /// Capture and arrival on the device clock [ns].
    pub(crate) stamp: i64,
    pub(crate) arrival: i64,
    pub(crate) what: What,
    /// Frames that should have come before it.
    pub(crate) lost: Vec<Lost>,
}

#[derive(Debug)]
pub(crate) enum What {
    Picture(Arc<Image>),
    Gap(String),
}

/// Frames that did not come.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Lost {
    pub(crate) count: u64,
    pub(crate) reason: String,
}

/// Result of a step.
#[derive(Debug)]
pub(crate) enum Step {
    Turn(Turn),
    /// Nothing yet.
    Nothing,
    /// Not before so long.
    Pause(Duration),
}

/// Counts of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Counts {
    /// Times that the stream was started again.
    pub(crate) restarts: u64,
    /// Times that the camera was opened again.
    pub(crate) reopenings: u64,
    /// Frames that the driver numbered and did not give.
    pub(crate) lost_by_driver: u64,
    /// Pictures that were damaged, short or could not be decoded.
    pub(crate) unusable: u64,
    /// Pictures whose stamp is not of the device clock; they have the time of their arrival.
    pub(crate) unstamped: u64,
    /// The stamps are of the start of the exposure.
    pub(crate) at_start: bool,
}

/// A camera's pictures one after the other.
pub(crate) struct Stream {
    device: Box<dyn Device>,
    clock: DeviceClock,
    reading: Reading,
    timeout: i64,
    state: State,
    /// Frame number and stamp of the last picture of this start, and of the last one at all.
    last_sequence: Option<u32>,
    last_stamp: Option<i64>,
    /// Since when nothing has come.
    quiet_since: i64,
    outage: Option<Outage>,
    pub(crate) counts: Counts,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum State {
    Closed,
    Open(Layout),
    Streaming(Layout),
}

/// What it takes to read a picture.
struct Reading {
    camera: CameraId,
    format: Format,
    decoder: Decoder,
    pool: Pool<Image>,
}

struct Outage {
    reason: String,
    /// Gaps that were reported already.
    told: u64,
    /// Attempts to start since.
    starts: u32,
    pause: Duration,
}

impl Stream {
    /// A stream over an opened device whose pictures are as `layout` says. `timeout`: how long without a picture is too long.
    pub(crate) fn new(
        device: Box<dyn Device>,
        layout: Layout,
        camera: CameraId,
        format: Format,
        timeout: Duration,
    ) -> Self {
        Self {
            clock: device.clock(),
            device,
            reading: Reading { camera, format, decoder: Decoder::default(), pool: Pool::default() },
            timeout: i64::try_from(timeout.as_nanos()).unwrap_or(i64::MAX),
            state: State::Open(layout),
            last_sequence: None,
            last_stamp: None,
            quiet_since: 0,
            outage: None,
            counts: Counts::default(),
        }
    }

    /// The clock of all stamps.
    pub(crate) fn clock(&self) -> DeviceClock {
        Arc::clone(&self.clock)
    }

    /// Advances: waits shortly for a picture, or does what is needed before there can be one.
    pub(crate) fn step(&mut self) -> Step {
        match self.state {
            State::Closed => match self.device.open() {
                Ok(layout) => {
                    self.counts.reopenings += 1;
                    self.state = State::Open(layout);
                    Step::Nothing
                }
                Err(refusal) => self.trouble(Trouble::Gone(format!("it cannot be opened again: {}", refusal.message))),
            },
            State::Open(layout) => {
                if let Some(outage) = &mut self.outage {
                    self.counts.restarts += 1;
                    outage.starts += 1;
                }
                match self.device.start() {
                    Ok(()) => {
                        self.state = State::Streaming(layout);
                        self.last_sequence = None;
                        self.quiet_since = (self.clock)();
                        Step::Nothing
                    }
                    Err(trouble) => self.trouble(trouble),
                }
            }
            State::Streaming(layout) => self.wait(&layout),
        }
    }

    /// Sets the camera's controls: see [`Device::change`].
    ///
    /// # Errors
    /// As there.
    pub(crate) fn change(&mut self, settings: &V4lSettings) -> Result<(), ConfigError> {
        self.device.change(settings)
    }

    /// Lets go of the camera.
    pub(crate) fn close(&mut self) {
        self.device.close();
        self.state = State::Closed;
    }

    fn wait(&mut self, layout: &Layout) -> Step {
        let mut seen = None;
        let reading = &mut self.reading;
        let clock = &self.clock;
        let came = self.device.next(WAIT, &mut |filled, bytes| {
            let arrival = clock();
            seen = Some((*filled, arrival, reading.read(layout, filled, bytes)));
        });
        if let Some((filled, arrival, read)) = seen {
            // A stream that broke just after this picture shows at the next step.
            return Step::Turn(self.turn(layout, &filled, arrival, read));
        }
        match came {
            Err(trouble) => self.trouble(trouble),
            Ok(_) if (self.clock)().saturating_sub(self.quiet_since) > self.timeout => {
                let reason = format!("no picture for {} ms", self.timeout / 1_000_000);
                self.trouble(Trouble::Interrupted(reason))
            }
            Ok(_) => Step::Nothing,
        }
    }

    fn turn(&mut self, layout: &Layout, filled: &Filled, arrival: i64, read: Result<Arc<Image>, String>) -> Turn {
        let stamp = plausible(filled.stamp, arrival);
        self.counts.unstamped += u64::from(stamp.is_none());
        self.counts.at_start = filled.at_start;
        let stamp = stamp.unwrap_or(arrival);
        let mut lost = Vec::new();
        if let Some(last) = self.last_sequence {
            // A number that stands still or runs backwards is one that the driver does not keep.
            let jump = filled.sequence.wrapping_sub(last);
            let n_lost = if jump < u32::MAX / 2 { u64::from(jump.saturating_sub(1)) } else { 0 };
            if n_lost > 0 {
                self.counts.lost_by_driver += n_lost;
                lost.push(Lost { count: n_lost.min(GAPS_AT_ONCE), reason: "the driver lost this frame".to_owned() });
            }
        }
        self.last_sequence = Some(filled.sequence);
        self.quiet_since = arrival;
        let what = match read {
            Ok(image) => {
                if let Some(outage) = self.outage.take() {
                    let count = missed(self.last_stamp, stamp, layout.period).saturating_sub(outage.told);
                    if count > 0 {
                        lost.push(Lost { count, reason: outage.reason });
                    }
                }
                What::Picture(image)
            }
            Err(fault) => {
                self.counts.unusable += 1;
                if let Some(outage) = &mut self.outage {
                    outage.told += 1;
                }
                What::Gap(format!("a picture {fault}"))
            }
        };
        self.last_stamp = Some(stamp);
        Turn { stamp, arrival, what, lost }
    }

    /// The stream cannot go on: a gap where that is news, and what to do next.
    fn trouble(&mut self, trouble: Trouble) -> Step {
        let now = (self.clock)();
        let starts = self.outage.as_ref().map_or(0, |it| it.starts);
        let (reason, reopen) = match trouble {
            Trouble::Interrupted(reason) => (reason, starts >= STARTS_BEFORE_OPENING),
            Trouble::Gone(reason) => (reason, true),
        };
        self.device.stop();
        self.state = match self.state {
            State::Streaming(layout) | State::Open(layout) if !reopen => State::Open(layout),
            _ => {
                self.device.close();
                State::Closed
            }
        };
        let Some(outage) = &mut self.outage else {
            self.outage = Some(Outage { reason: reason.clone(), told: 1, starts: 0, pause: FIRST_PAUSE });
            return Step::Turn(Turn { stamp: now, arrival: now, what: What::Gap(reason), lost: Vec::new() });
        };
        if reopen {
            outage.starts = 0;
        }
        let pause = outage.pause;
        outage.pause = (2 * pause).min(LONGEST_PAUSE);
        Step::Pause(pause)
    }
}

/// Frames that would have come between two stamps, both of which have one.
fn missed(last: Option<i64>, stamp: i64, period: Option<i64>) -> u64 {
    let (Some(last), Some(period)) = (last, period.filter(|&it| it > 0)) else { return 0 };
    let steps = (Interval(stamp.saturating_sub(last)).as_s() / Interval(period).as_s()).round();
    (steps as u64).saturating_sub(1).min(GAPS_AT_ONCE)
}

impl Reading {
    fn read(&mut self, layout: &Layout, filled: &Filled, bytes: &[u8]) -> Result<Arc<Image>, String> {
        if filled.damaged {
            return Err("is marked as damaged by the driver".to_owned());
        }
        let mut image = self.pool.take(Image::default);
        let bytes = &bytes[..filled.used.min(bytes.len())];
        let result = pixels::read(layout, bytes, self.format, &mut self.decoder, &mut image);
        image.camera = self.camera;
        let image = self.pool.share(image);
        result.map(|()| image)
    }
}

#[cfg(test)]
mod tests;
