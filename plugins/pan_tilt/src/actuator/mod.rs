//! `pan_tilt.head`: drives one head, and reports its state.
//!
//! The driver is the same on hardware and in simulation. On hardware (`port` of [`ActuatorSettings`]) it has a thread that listens, and commands are
//! written by the thread that brings them; a rig with such a node is live. In simulation it talks over the [`Line`] at the input `line` on
//! the clock of the run.
//!
//! All bytes on the line, both ways, come out as [`LineTraffic`]: a session records them whether or not an edge carries them.

mod link;
mod settings;
mod units;

use std::collections::VecDeque;
use std::sync::Arc;

use foveate::node::Line;
use foveate::prelude::*;

use crate::driver::{CommandId, Driver, Event, Link, Medium, What};
use crate::line_traffic::LineTraffic;
use crate::port::Port;
use crate::visca::{Answer, Command, PanDrive, TiltDrive};
use link::{Device, Simulated};
pub use settings::{ActuatorSettings, Model};
use units::Scale;

ports! {
    COMMANDS: In<HeadCommand> = each("commands").optional();
    LINE: In<Line> = latest("line").optional();
    REPORT: Out<HeadReport> = "report";
    LINE_TRAFFIC: Out<LineTraffic> = "line_traffic";
}

figures! {
        "heads.*.sent": count, neither, "Command packets sent to that head, repeated ones included";
        "heads.*.replaced": count, neither, "Commands replaced by a newer one before they were sent";
    "heads.*.unanswered": count, low, "Messages without an answer in time";
        "heads.*.buffer_full": count, low, "Messages refused by the head because its buffer was full";
        "heads.*.corrected": count, low, "Commands repeated because the head stopped elsewhere";
        "heads.*.failed": count, low, "Commands not carried out by the head or its line";
        "heads.*.stray_packets": count, low, "Replies and datagrams that match no message";
    "heads.*.garbage_bytes": bytes, low, "Bytes that belonged to no packet";
    "heads.*.lost": count, low, "Times that the head stopped answering";
    "heads.*.away_s": s, low, "Session time in which the head did not answer";
}

/// Time covered by each report, so that a sampling reader misses nothing.
const REPORTED: Interval = Interval(1_000_000_000);
/// Interval of zoom inquiries where the settings do not give one [ms].
const ZOOM_EVERY_MS: f64 = 200.0;
/// Bytes of a position inquiry and its answer.
const QUESTION_BYTES: f64 = 5.0;
const ANSWER_BYTES: f64 = 11.0;
/// Bits of a byte on a serial line, with those that begin and end it.
const BITS: f64 = 10.0;

/// The actuator of one head. Angles in and out are those of the calibrated axes, or by the data sheet where the calibration has
/// no head of this name.
pub struct Actuator {
    settings: ActuatorSettings,
    camera: CameraId,
    name: String,
    scale: Scale,
    way: Way,
    /// A command that waits for the line.
    early: Option<HeadCommand>,
    /// The last command of motors and zoom that went to the driver.
    last: [Option<Command>; 2],
    last_motion: CommandId,
    /// State of the link, and its start.
    link: Link,
    since: Time,
    events: VecDeque<(Time, HeadEvent)>,
    first: u64,
    /// Events before this number have been reported.
    reported: u64,
    next_report: Time,
    now: Time,
    is_up: bool,
    away: Interval,
    n_lost: u64,
    n_failed: u64,
}

enum Way {
    /// The line of a simulated head has not come yet.
    Nothing,
    Simulated(Box<Simulated>),
    /// A port that is not opened yet.
    Port(Port),
    Device(Device),
}

impl Node for Actuator {
    const TYPE: &'static str = "pan_tilt.head";
    const ROLE: Role = Role::Actuator;
    const SUMMARY: &'static str = "Drives a pan-tilt head that speaks VISCA, and reports its angles";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ActuatorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(mut settings: ActuatorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("baud", settings.baud, 300..=1_000_000)?;
        ConfigError::unless_in("report_every_ms", settings.report_every_ms, 0.0..=500.0)?;
        settings.driver.check()?;
        let profile = settings.profile();
        profile.check().map_err(|fault| ConfigError::at("profile", fault))?;
        let Some(camera) = setup.camera else {
            return Err(ConfigError::node(
                "found no camera, expected `each` or `camera` to name the cameras of the calibration that are on heads",
            ));
        };
        let port = settings.port(setup)?;
        if let (Some(port), Some(stated)) = (&port, &settings.port) {
            let message = |owner: &str| {
                format!(
                    "found `{stated}`, which `{owner}` drives already, expected a port for each head, such as one with `{{camera}}` in its name"
                )
            };
            setup.claim("port", &format!("{port:?}"), message)?;
        }
        match (&port, setup.is_connected(&LINE)) {
            (None, false) => {
                let message = "found neither `port` nor the input `line`, expected one of them: \
                               the head's port, or the line of a `sim.head`";
                return Err(ConfigError::node(message));
            }
            (Some(_), true) => {
                let message =
                    "found both `port` and the input `line`, expected one of them: a head is real or simulated";
                return Err(ConfigError::at("port", message));
            }
            _ => {}
        }
        if settings.driver.zoom_every_ms == 0.0 && setup.head_model().is_some_and(|it| it.model.zoom.is_some()) {
            // Whoever wants to know the camera has to know its zoom.
            settings.driver.zoom_every_ms = ZOOM_EVERY_MS;
        }
        Ok(Self {
            camera,
            name: setup.camera_name().unwrap_or_default().to_owned(),
            scale: Scale::new(&profile, setup.head_model().as_ref()),
            way: port.map_or(Way::Nothing, Way::Port),
            early: None,
            last: [None, None],
            last_motion: CommandId(0),
            link: Link::Greeting,
            since: Time::ZERO,
            events: VecDeque::new(),
            first: 0,
            reported: 0,
            next_report: Time::ZERO,
            now: Time::ZERO,
            is_up: false,
            away: Interval(0),
            n_lost: 0,
            n_failed: 0,
            settings,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        (self.now, self.is_up) = (io.now(), true);
        let command = io.take(&COMMANDS).map(|it| *it.value);
        self.get_ready(io)?;
        if let Some(command) = command {
            self.obey(command)?;
        }
        self.way.turn(self.now);
        self.take_events(io);
        self.report(io);
        if let Some(traffic) = self.way.traffic(self.now) {
            io.emit_at(&LINE_TRAFFIC, self.now, traffic);
        }
        Ok(())
    }

    fn due(&mut self) -> Due {
        match &mut self.way {
            _ if !self.is_up => Due::At(Time::ZERO),
            Way::Nothing | Way::Port(_) => Due::At(self.now + link::IDLE_LOOK),
            Way::Simulated(it) => Due::At(it.next_look(self.now)),
            Way::Device(device) => {
                if device.has_news() {
                    Due::At(self.now)
                } else if self.reported < self.first + self.events.len() as u64 {
                    Due::At(self.next_report)
                } else {
                    Due::Waiting
                }
            }
        }
    }

    fn is_live(settings: &ActuatorSettings) -> bool {
        settings.port.is_some()
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        if matches!(self.last[0], Some(Command::Drive { .. }))
            && let Way::Device(device) = &self.way
        {
            // Nobody watches where it goes from now on.
            device.stop();
        }
        let name = &self.name;
        if self.link != Link::Ready {
            self.away.0 += (self.now - self.since).0;
            report.remark(format!("the head of {name} did not answer at the end: {}", in_words(&self.link)));
        }
        let counts = self.way.counts();
        let figures = [
            ("sent", counts.sent as f64),
            ("replaced", counts.replaced as f64),
            ("unanswered", counts.unanswered as f64),
            ("buffer_full", counts.buffer_full as f64),
            ("corrected", counts.corrected as f64),
            ("failed", self.n_failed as f64),
            ("stray_packets", counts.stray as f64),
            ("garbage_bytes", counts.garbage_bytes as f64),
            ("lost", self.n_lost as f64),
            ("away_s", self.away.as_s()),
        ];
        figures.into_iter().for_each(|(figure, value)| report.figure(format!("heads.{name}.{figure}"), value));
        Ok(())
    }
}

impl Actuator {
    /// Takes the line of a simulated head, or opens the port of a real one.
    fn get_ready(&mut self, io: &Io<'_>) -> Result<(), NodeError> {
        if let Way::Device(device) = &mut self.way {
            device.fix(self.now);
        }
        let made = match &self.way {
            Way::Nothing => match io.latest(&LINE) {
                Some(line) => {
                    let line = line.value.clone();
                    let medium = if line.device().has_datagrams() { Medium::Ip } else { Medium::Serial };
                    Way::Simulated(Box::new(Simulated::new(self.driver(medium)?, line, self.now)))
                }
                None => return Ok(()),
            },
            Way::Port(port) => Way::Device(Device::start(self.driver(port.medium())?, port.clone())),
            Way::Simulated(_) | Way::Device(_) => return Ok(()),
        };
        self.way = made;
        match self.early.take() {
            Some(command) => self.obey(command),
            None => Ok(()),
        }
    }

    fn driver(&self, medium: Medium) -> Result<Driver, NodeError> {
        // Settings and profile have been checked.
        Driver::new(self.settings.driver.clone(), self.settings.profile(), medium).map_err(NodeError::program)
    }

    /// Passes a command to the driver, unless the head has it already.
    fn obey(&mut self, command: HeadCommand) -> Result<(), NodeError> {
        if command.camera != self.camera {
            let (found, own) = (command.camera.0, self.camera.0);
            return Err(NodeError::input(format!("found a command for camera {found}, expected one for camera {own}")));
        }
        if matches!(self.way, Way::Nothing | Way::Port(_)) {
            self.early = Some(command);
            return Ok(());
        }
        let wrong = || NodeError::input(format!("found {command:?}, expected finite numbers"));
        let motion = self.scale.command(&command.order).ok_or_else(wrong)?;
        let zoom = command.zoom.map(|it| self.scale.zoom(it).ok_or_else(wrong)).transpose()?;
        for (part, command) in [(0, Some(motion)), (1, zoom)] {
            let Some(command) = command.filter(|it| self.last[part] != Some(*it)) else { continue };
            let id = self.way.command(self.now, command).map_err(NodeError::program)?;
            self.last[part] = Some(command);
            if part == 0 {
                self.last_motion = id;
            }
        }
        Ok(())
    }

    /// Takes over the driver's events.
    fn take_events(&mut self, io: &mut Io<'_>) {
        for Event { at, what } in self.way.events() {
            let event = match what {
                What::Link(link) => self.change_link(at, link, io),
                What::Sent { command, .. } => self.scale.order(&command).map(HeadEvent::Sent),
                // Not of a drive, which counts as done as soon as it has begun.
                What::Completed { id }
                    if id == self.last_motion && matches!(self.last[0], Some(Command::Absolute { .. })) =>
                {
                    // A repeated order needs the report that it is there.
                    self.last[0] = None;
                    Some(HeadEvent::Arrived)
                }
                What::Failed { id, why } => {
                    self.n_failed += 1;
                    // A repeated order is accepted.
                    self.last = [None, None];
                    if id == self.last_motion {
                        io.gap(
                            &REPORT,
                            at,
                            format_args!("the head of {} does not execute a command: {why}", self.name),
                        );
                    }
                    None
                }
                What::Answered { answer: Answer::Position { pan, tilt }, asked_at } => {
                    let [question, answer] = self.line_times();
                    Some(HeadEvent::Position(HeadPosition {
                        earliest: asked_at + question,
                        latest: (asked_at + question).max(at - answer),
                        angles: self.scale.angles(pan, tilt),
                    }))
                }
                What::Answered { answer: Answer::Zoom(units), .. } => Some(HeadEvent::Zoom(f64::from(units))),
                What::Answered { .. } | What::Acknowledged { .. } | What::Completed { .. } | What::Replaced { .. } => {
                    None
                }
            };
            self.events.extend(event.map(|it| (at, it)));
        }
        while self.events.front().is_some_and(|it| self.now - it.0 > REPORTED) && self.first < self.reported {
            self.events.pop_front();
            self.first += 1;
        }
    }

    /// Transmission time of a position inquiry and of its answer. Negligible over IP.
    fn line_times(&self) -> [Interval; 2] {
        let byte_s = if self.way.is_serial() { BITS / f64::from(self.settings.baud) } else { 0.0 };
        [QUESTION_BYTES, ANSWER_BYTES].map(|it| Interval::from_s(it * byte_s))
    }

    /// Reports a change of whether the head answers; the reason is sent as a gap.
    fn change_link(&mut self, at: Time, link: Link, io: &mut Io<'_>) -> Option<HeadEvent> {
        let (was, is) = (self.link == Link::Ready, link == Link::Ready);
        if !was {
            self.away.0 += (at - self.since).0;
        }
        let is_said = std::mem::replace(&mut self.link, link) == self.link;
        self.since = at;
        if !is && !is_said && self.link != Link::Greeting {
            self.n_lost += u64::from(was);
            io.gap(&REPORT, at, format_args!("the head of {} is away: {}", self.name, in_words(&self.link)));
        }
        (was != is).then_some(HeadEvent::Link(if is { HeadLink::Ready } else { HeadLink::Away }))
    }

    fn report(&mut self, io: &mut Io<'_>) {
        let n_events = self.first + self.events.len() as u64;
        if self.reported == n_events || self.now < self.next_report {
            return;
        }
        self.reported = n_events;
        self.next_report = self.now + Interval::from_ms(self.settings.report_every_ms);
        let link = if self.link == Link::Ready { HeadLink::Ready } else { HeadLink::Away };
        let events = self.events.iter().copied().collect();
        io.emit_at(&REPORT, self.now, Arc::new(HeadReport { camera: self.camera, link, first: self.first, events }));
    }
}

fn in_words(link: &Link) -> String {
    match link {
        Link::Closed(reason) => reason.clone(),
        Link::Greeting => "no answer yet".to_owned(),
        Link::Ready => "it answers".to_owned(),
        Link::Silent => "no answer".to_owned(),
        Link::Garbled => "the answers are garbled: is this the right baud rate and device?".to_owned(),
        Link::NoSuchHead { heads } => format!("its line has {heads} heads, fewer than its `address`"),
    }
}

/// Command that stops the motors.
const STOP: Command =
    Command::Drive { pan: PanDrive::Stop, tilt: TiltDrive::Stop, speed: crate::visca::Speed { pan: 1, tilt: 1 } };
