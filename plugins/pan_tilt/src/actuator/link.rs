//! The two links to a head: the line of a simulated one on the clock of the run, and a port with a thread.

use std::sync::Arc;
use std::time::{Duration, Instant};

use foveate::node::Line;
use foveate::prelude::{Interval, Time};

use super::{STOP, Way};
use crate::driver::{CommandId, Counts, Driver, Event, Medium};
use crate::head::Head;
use crate::line_traffic::LineTraffic;
use crate::port::Port;
use crate::visca::{Command, OutOfRange};

/// Polling interval of a simulated line: twice a byte or so at 9600 baud.
const LOOK: Interval = Interval(500_000);
/// Polling interval while no message is expected.
pub(super) const IDLE_LOOK: Interval = Interval(2_000_000);
/// Time for a head to receive the stop command.
const STOPPING: Duration = Duration::from_millis(300);

/// A driver at the line of a simulated head.
pub(super) struct Simulated {
    driver: Driver,
    line: Line,
    has_datagrams: bool,
    received: Vec<u8>,
}

impl Simulated {
    pub fn new(mut driver: Driver, line: Line, now: Time) -> Simulated {
        driver.opened(now);
        let has_datagrams = line.device().has_datagrams();
        Simulated { driver, line, has_datagrams, received: Vec::new() }
    }

    /// Reads received bytes, writes due ones.
    fn turn(&mut self, now: Time) {
        let mut device = self.line.device();
        loop {
            self.received.clear();
            device.read(now, &mut self.received);
            if self.received.is_empty() {
                break;
            }
            self.driver.receive(now, &self.received);
            if !self.has_datagrams {
                break;
            }
        }
        while let Some(frame) = self.driver.poll(now) {
            device.write(now, &frame.0);
        }
    }

    /// Next polling time of the line.
    pub fn next_look(&self, now: Time) -> Time {
        let soon = now + LOOK;
        let idle = now + IDLE_LOOK;
        if self.driver.is_waiting() { soon } else { self.driver.wake().map_or(idle, |it| it.clamp(soon, idle)) }
    }
}

/// A driver on its port. It has its own clock, which is related to the session's as soon as that runs.
pub(super) struct Device {
    head: Head,
    medium: Medium,
    began: Instant,
    /// Session time at the start of the own clock.
    offset: Option<Interval>,
    news: Vec<Event>,
}

impl Device {
    pub fn start(driver: Driver, port: Port) -> Device {
        let began = Instant::now();
        let medium = port.medium();
        let clock = Arc::new(move || elapsed(began));
        Device { head: Head::start(driver, port, clock), medium, began, offset: None, news: Vec::new() }
    }

    /// An activation at session time `now`.
    pub fn fix(&mut self, now: Time) {
        self.offset.get_or_insert_with(|| now - elapsed(self.began));
    }

    /// Whether there are events that [`Way::events`] has not returned.
    pub fn has_news(&mut self) -> bool {
        self.news.extend(self.head.events());
        !self.news.is_empty()
    }

    /// Stops the motors, and waits shortly until the head has received it.
    pub fn stop(&self) {
        // No number in it can be out of range.
        let _ = self.head.command(STOP);
        let end = Instant::now() + STOPPING;
        while !self.head.is_idle() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

fn elapsed(began: Instant) -> Time {
    Time(i64::try_from(began.elapsed().as_nanos()).unwrap_or(i64::MAX))
}

impl Way {
    /// Whether it is, or will be, a serial line.
    pub(super) fn is_serial(&self) -> bool {
        match self {
            Way::Nothing => true,
            Way::Simulated(it) => !it.has_datagrams,
            Way::Port(port) => port.medium() == Medium::Serial,
            Way::Device(it) => it.medium == Medium::Serial,
        }
    }

    /// Passes a command to the driver; on a port it is written before this returns if there is room.
    pub(super) fn command(&mut self, now: Time, command: Command) -> Result<CommandId, OutOfRange> {
        match self {
            Way::Simulated(it) => it.driver.command(now, command),
            Way::Device(it) => it.head.command(command),
            Way::Nothing | Way::Port(_) => Ok(CommandId(0)),
        }
    }

    /// Lets the driver of a simulated head read and write; that of a real one does so by itself.
    pub(super) fn turn(&mut self, now: Time) {
        if let Way::Simulated(it) = self {
            it.turn(now);
        }
    }

    /// Events since the last call, on the clock of the session.
    pub(super) fn events(&mut self) -> Vec<Event> {
        match self {
            Way::Simulated(it) => std::iter::from_fn(|| it.driver.next_event()).collect(),
            Way::Device(it) => {
                let Some(offset) = it.offset else { return Vec::new() };
                it.has_news();
                it.news.drain(..).map(|event| event.later_by(offset)).collect()
            }
            Way::Nothing | Way::Port(_) => Vec::new(),
        }
    }

    /// Frames and bytes since the last call, on the clock of the session.
    pub(super) fn traffic(&mut self, now: Time) -> Option<LineTraffic> {
        match self {
            Way::Simulated(it) => it.driver.traffic(now),
            Way::Device(it) => {
                let offset = it.offset?;
                Some(it.head.traffic()?.later_by(offset))
            }
            Way::Nothing | Way::Port(_) => None,
        }
    }

    pub(super) fn counts(&self) -> Counts {
        match self {
            Way::Simulated(it) => it.driver.counts(),
            Way::Device(it) => it.head.counts(),
            Way::Nothing | Way::Port(_) => Counts::default(),
        }
    }
}
