//! The driver of one head: a state machine without a line and without a clock.
//!
//! Bytes that came in go into [`Driver::receive`], bytes to be sent come out of [`Driver::poll`], both with the present time; what happened
//! is fetched with [`Driver::next_event`]. [`Head`](crate::head::Head) does this on a serial port or a UDP socket.
//!
//! - **One message at a time.** The next one is sent when the last one was answered or has timed out.
//! - **Two commands in flight.** A head buffers two; a third is not sent before one of them is done.
//! - **The newest command wins.** Of the waiting commands to the same part (motors, zoom, focus, …) only the
//!   last one is kept: there is no queue, and at any rate of commands the head gets the newest when it has room.
//! - **Inquiries in between**, in turn with commands where both are due.
//! - **Commanded positions are verified.** VISCA has no checksum: a command may arrive corrupted. If the head stops elsewhere the command
//!   is repeated.
//! - **The driver keeps trying.** A head that is silent, garbled or unplugged is reported and greeted again with growing pauses; when it
//!   answers it gets the last command of each part, except open-ended motions.

pub mod events;
mod pending;
mod replies;
pub mod settings;
mod traffic;
mod wire;

use std::collections::VecDeque;

use foveate::prelude::{ConfigError, Interval, Time};

use crate::line_traffic::LineTraffic;
use crate::visca::{Command, Inquiry, OutOfRange, Profile, Request};

pub use events::{CommandId, Counts, Event, Failure, Link, What};
use pending::{Part, PendingCommand, PendingCommands};
pub use settings::DriverSettings;
use traffic::Traffic;
use wire::Wire;
pub use wire::{Frame, Medium};

/// Largest number of doublings of the greeting's time-out.
const MOST_PATIENCE: u32 = 3;
/// Most events that are kept until they are fetched.
const MOST_EVENTS: usize = 4096;

/// See the [module](self).
#[derive(Debug, Clone)]
pub struct Driver {
    settings: DriverSettings,
    profile: Profile,
    wire: Wire,
    link: Link,
    phase: Phase,
    /// Consecutive failed openings and greetings.
    failures: u32,
    /// Consecutive messages without an answer.
    misses: u32,
    /// Estimated answer time, biased to slow ones.
    answer_time: Interval,
    /// Number of doublings of the greeting's time-out.
    patience: u32,
    /// Bytes came since the last valid reply.
    has_noise: bool,
    awaited: Option<Awaited>,
    sockets: [Option<Occupant>; 2],
    /// Not sent yet.
    pending: PendingCommands,
    /// The last commands given, sent or not.
    goals: PendingCommands,
    /// After a full buffer no command is sent before this.
    hold_until: Time,
    /// Since when a command waits for a socket.
    blocked_since: Option<Time>,
    /// The last cancelled socket.
    cancelled: u8,
    /// The last command that the head refused as unknown, and how often.
    misread: (CommandId, u32),
    next_position: Time,
    next_zoom: Time,
    /// The last message was a command.
    said_command: bool,
    motors: Watch,
    zoom: Watch,
    last_id: CommandId,
    events: VecDeque<Event>,
    traffic: Traffic,
    counts: Counts,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// The port is not open.
    Closed {
        retry_at: Time,
    },
    /// The head did not answer.
    Pause {
        until: Time,
    },
    /// Step by step: the next inquiry.
    Greeting(Asked),
    Ready,
}

/// A message on the line.
#[derive(Debug, Clone)]
struct Awaited {
    asked: Asked,
    sequence: Option<u32>,
    frame: Frame,
    sent_at: Time,
    deadline: Time,
    resends: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asked {
    /// Over IP: restart the sequence numbers.
    Reset,
    AddressSet,
    Clear,
    Cancel {
        socket: u8,
    },
    Command(PendingCommand),
    Inquiry(Inquiry),
}

/// Content of a socket of the head as far as the driver knows.
#[derive(Debug, Clone, Copy)]
struct Occupant {
    /// `None`: its acknowledgement came after its time-out.
    pending: Option<PendingCommand>,
    sequence: Option<u32>,
}

/// Verification that a part reaches its commanded position.
#[derive(Debug, Clone, Copy, Default)]
struct Watch {
    /// Last reported position [units].
    seen: Option<[i32; 2]>,
    /// Time of its last command.
    sent_at: Time,
    /// Number of repetitions.
    corrections: u32,
}

impl Driver {
    /// A driver whose port is closed, for a head of this model.
    ///
    /// # Errors
    /// Settings out of their ranges, or a profile that makes no sense.
    pub fn new(settings: DriverSettings, profile: Profile, medium: Medium) -> Result<Driver, ConfigError> {
        settings.check()?;
        profile.check().map_err(|fault| ConfigError::at("profile", fault))?;
        let wire = Wire::new(medium, settings.address(), profile.format());
        Ok(Driver {
            settings,
            profile,
            wire,
            link: Link::Closed("not open yet".to_owned()),
            phase: Phase::Closed { retry_at: Time(i64::MIN) },
            failures: 0,
            misses: 0,
            answer_time: Interval(0),
            patience: 0,
            has_noise: false,
            awaited: None,
            sockets: [None, None],
            pending: PendingCommands::default(),
            goals: PendingCommands::default(),
            hold_until: Time(i64::MIN),
            blocked_since: None,
            cancelled: 2,
            misread: (CommandId(0), 0),
            next_position: Time(i64::MIN),
            next_zoom: Time(i64::MIN),
            said_command: false,
            motors: Watch::default(),
            zoom: Watch::default(),
            last_id: CommandId(0),
            events: VecDeque::new(),
            traffic: Traffic::default(),
            counts: Counts::default(),
        })
    }

    /// The head's model.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// State of the link between driver and head.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// Counts so far.
    pub fn counts(&self) -> Counts {
        let (stray, garbage_bytes) = self.wire.counts();
        Counts { stray, garbage_bytes, ..self.counts }
    }

    /// Commands that the head has accepted and not completed, as far as the driver knows.
    pub fn in_flight(&self) -> usize {
        self.sockets.iter().flatten().count()
    }

    /// Whether a message waits for its answer.
    pub fn is_waiting(&self) -> bool {
        self.awaited.is_some()
    }

    /// Whether every command was sent and completed, and no answer is pending.
    pub fn is_idle(&self) -> bool {
        self.phase == Phase::Ready
            && self.in_flight() == 0
            && self.pending.first().is_none()
            && !matches!(self.awaited, Some(Awaited { asked: Asked::Command(_), .. }))
    }

    /// Gives a command, which is sent as soon as the line and the head have room. A waiting command for the same part
    /// is replaced.
    ///
    /// # Errors
    /// A number out of the model's range; nothing has changed then.
    pub fn command(&mut self, now: Time, command: Command) -> Result<CommandId, OutOfRange> {
        self.profile.check_command(&command)?;
        let id = CommandId(self.last_id.0 + 1);
        self.last_id = id;
        self.counts.given += 1;
        let pending = PendingCommand { id, command, since: now };
        if let Some(replaced) = self.pending.put(pending) {
            self.counts.replaced += 1;
            self.report(now, What::Replaced { id: replaced.id });
        }
        self.goals.put(pending);
        if let Some(watch) = self.watch(Part::of(&command)) {
            watch.corrections = 0;
        }
        Ok(id)
    }

    /// The oldest event that was not fetched.
    pub fn next_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Frames and received bytes since the last call, each with the `now` that it was passed with; `None` if there are none. A packet whose end has not come
    /// waits for it.
    pub fn traffic(&mut self, now: Time) -> Option<LineTraffic> {
        self.traffic.take(now)
    }

    /// When the port should be opened; `None` if it is open.
    pub fn open_at(&self) -> Option<Time> {
        match self.phase {
            Phase::Closed { retry_at } => Some(retry_at),
            _ => None,
        }
    }

    /// The port is open.
    pub fn opened(&mut self, now: Time) {
        self.wire.cut();
        self.set_link(now, Link::Greeting);
        self.greet(now);
    }

    /// The port could not be opened, or is gone, and why.
    pub fn lost(&mut self, now: Time, reason: &str) {
        self.drop_line(now);
        self.failures += 1;
        self.phase = Phase::Closed { retry_at: now + self.settings.back_off(self.failures) };
        self.set_link(now, Link::Closed(reason.to_owned()));
    }

    /// Bytes that came in together: any piece of a serial stream, or one datagram.
    pub fn receive(&mut self, now: Time, bytes: &[u8]) {
        self.traffic.receive(now, bytes, self.wire.medium());
        if matches!(self.phase, Phase::Closed { .. }) {
            return;
        }
        self.has_noise |= !bytes.is_empty();
        let mut received = Vec::new();
        self.wire.read(bytes, &mut received);
        for it in received {
            self.take_message(now, it);
        }
    }

    /// The next frame to send; call it until it returns `None`, whenever bytes came in, a command was given, or [`wake`](Self::wake) has come.
    pub fn poll(&mut self, now: Time) -> Option<Frame> {
        let frame = self.next_frame(now)?;
        self.traffic.send(now, &frame.0);
        Some(frame)
    }

    fn next_frame(&mut self, now: Time) -> Option<Frame> {
        let timeout = self.timeout();
        if let Some(awaited) = &mut self.awaited {
            if now < awaited.deadline {
                return None;
            }
            let may_resend = self.wire.medium() == Medium::Ip && awaited.resends < self.settings.resends;
            if may_resend && !matches!(self.phase, Phase::Closed { .. }) {
                awaited.resends += 1;
                awaited.deadline = now + timeout;
                return Some(awaited.frame.clone());
            }
        }
        if let Some(awaited) = self.awaited.take() {
            self.miss(now, &awaited);
        }
        if matches!(self.phase, Phase::Pause { until } if now >= until) {
            self.greet(now);
        }
        match self.phase {
            Phase::Closed { .. } | Phase::Pause { .. } => None,
            Phase::Greeting(asked) => self.say(now, asked),
            Phase::Ready => {
                let asked = self.choose(now)?;
                self.say(now, asked)
            }
        }
    }

    /// Next time to poll without an event; `None`: only after an event.
    pub fn wake(&self) -> Option<Time> {
        if let Some(awaited) = &self.awaited {
            return Some(awaited.deadline);
        }
        match self.phase {
            Phase::Closed { .. } => None,
            Phase::Pause { until } => Some(until),
            Phase::Greeting(_) => Some(Time(i64::MIN)),
            Phase::Ready => {
                let blocked = self.blocked_since.map(|it| it + Interval::from_ms(self.settings.cancel_after_ms));
                let pending = self.pending.first().map(|_| {
                    let free = if self.has_room() { self.hold_until } else { Time(i64::MAX) };
                    blocked.map_or(free, |it| it.min(free))
                });
                let position = (self.settings.position_every_ms > 0.0).then_some(self.next_position);
                let zoom = (self.settings.zoom_every_ms > 0.0).then_some(self.next_zoom);
                [pending, position, zoom].into_iter().flatten().min()
            }
        }
    }

    /// The next message to a head that answers.
    fn choose(&mut self, now: Time) -> Option<Asked> {
        let pending = self.pending.first();
        let has_room = self.has_room();
        if pending.is_some() && !has_room {
            self.blocked_since.get_or_insert(now);
        }
        if let (Some(pending), Some(since)) = (pending, self.blocked_since)
            && now - since >= Interval::from_ms(self.settings.cancel_after_ms)
        {
            // From now on it waits anew: one cancel at a time.
            self.blocked_since = Some(now);
            if let Some(socket) = self.socket_to_cancel(&pending) {
                self.cancelled = socket;
                return Some(Asked::Cancel { socket });
            }
        }
        let command = pending.filter(|_| has_room && now >= self.hold_until);
        let inquiry = self.due_inquiry(now);
        match (command, inquiry) {
            (Some(pending), None) => Some(Asked::Command(pending)),
            (Some(pending), Some(_)) if !self.said_command => Some(Asked::Command(pending)),
            (_, Some(inquiry)) => Some(Asked::Inquiry(inquiry)),
            (None, None) => None,
        }
    }

    fn due_inquiry(&self, now: Time) -> Option<Inquiry> {
        if self.settings.position_every_ms > 0.0 && now >= self.next_position {
            return Some(Inquiry::PanTiltPosition);
        }
        (self.settings.zoom_every_ms > 0.0 && now >= self.next_zoom).then_some(Inquiry::Zoom)
    }

    /// A socket whose command blocks `pending`.
    fn socket_to_cancel(&self, pending: &PendingCommand) -> Option<u8> {
        let after_last = [self.cancelled % 2 + 1, self.cancelled];
        if self.in_flight() == 0 {
            // The head says that it is full: it has commands that the driver does not know of.
            return Some(after_last[0]);
        }
        let part = Part::of(&pending.command);
        after_last.into_iter().find(|&socket| {
            let occupant = self.sockets[usize::from(socket) - 1];
            occupant.is_some_and(|it| it.pending.is_none_or(|it| Part::of(&it.command) == part))
        })
    }

    fn has_room(&self) -> bool {
        self.sockets.iter().any(Option::is_none)
    }

    /// Writes a message, and expects its answer from now on.
    fn say(&mut self, now: Time, asked: Asked) -> Option<Frame> {
        let request = match asked {
            Asked::Reset => None,
            Asked::AddressSet => Some(Request::AddressSet),
            Asked::Clear => Some(Request::Clear),
            Asked::Cancel { socket } => Some(Request::Cancel { socket }),
            Asked::Command(pending) => Some(Request::Command(pending.command)),
            Asked::Inquiry(inquiry) => Some(Request::Inquiry(inquiry)),
        };
        let written = match request {
            None => Ok((self.wire.write_reset(), Some(0))),
            Some(request) => self.wire.write(&request),
        };
        let (frame, sequence) = written.unwrap_or_else(|_| unreachable!("commands are checked when they are given"));
        let deadline = now + self.timeout();
        self.awaited = Some(Awaited { asked, sequence, frame: frame.clone(), sent_at: now, deadline, resends: 0 });
        self.said_command = matches!(asked, Asked::Command(_));
        match asked {
            Asked::Command(pending) => {
                let part = Part::of(&pending.command);
                self.pending.take(part);
                self.counts.sent += 1;
                if let Some(watch) = self.watch(part) {
                    watch.sent_at = now;
                }
                self.report(now, What::Sent { id: pending.id, command: pending.command });
            }
            Asked::Inquiry(Inquiry::PanTiltPosition) => {
                self.next_position = now + Interval::from_ms(self.settings.position_every_ms);
            }
            Asked::Inquiry(Inquiry::Zoom) => self.next_zoom = now + Interval::from_ms(self.settings.zoom_every_ms),
            _ => {}
        }
        Some(frame)
    }

    /// A message timed out.
    fn miss(&mut self, now: Time, awaited: &Awaited) {
        self.counts.unanswered += 1;
        self.misses += 1;
        if self.phase != Phase::Ready {
            self.patience = (self.patience + 1).min(MOST_PATIENCE);
            return self.pause(now);
        }
        if let Asked::Command(pending) = awaited.asked {
            self.put_back(now, pending);
        }
        if self.misses >= self.settings.silent_after {
            self.pause(now);
        }
    }

    /// Time-out of an answer: longer for a slow head, and doubled with each failed greeting.
    fn timeout(&self) -> Interval {
        let least = self.settings.reply_timeout_ms;
        Interval::from_ms((2.0 * self.answer_time.as_ms()).clamp(least, 8.0 * least) * f64::from(1 << self.patience))
    }

    /// An answer came in time.
    fn measure(&mut self, taken: Interval) {
        self.patience = 0;
        self.answer_time = taken.max(Interval((7 * self.answer_time.0 + taken.0) / 8));
    }

    /// Pauses before a silent head is greeted again.
    fn pause(&mut self, now: Time) {
        let link = if self.has_noise { Link::Garbled } else { Link::Silent };
        self.pause_as(now, link);
    }

    fn pause_as(&mut self, now: Time, link: Link) {
        self.set_link(now, link);
        self.drop_line(now);
        self.failures += 1;
        self.phase = Phase::Pause { until: now + self.settings.back_off(self.failures) };
    }

    fn greet(&mut self, now: Time) {
        self.drop_line(now);
        (self.misses, self.has_noise) = (0, false);
        self.phase = Phase::Greeting(match self.wire.medium() {
            Medium::Serial => Asked::AddressSet,
            Medium::Ip => Asked::Reset,
        });
    }

    /// Forgets the messages on the line and the contents of the sockets.
    fn drop_line(&mut self, now: Time) {
        if let Some(Awaited { asked: Asked::Command(pending), .. }) = self.awaited.take() {
            self.put_back(now, pending);
        }
        self.sockets = [None, None];
        self.hold_until = Time(i64::MIN);
        self.blocked_since = None;
    }

    /// The head answers: sends it the last commands.
    fn be_ready(&mut self, now: Time) {
        self.phase = Phase::Ready;
        self.failures = 0;
        self.set_link(now, Link::Ready);
        let goals: Vec<PendingCommand> = self.goals.all().collect();
        for goal in goals {
            let part = Part::of(&goal.command);
            if self.pending.get(part).is_some() {
                continue;
            }
            if pending::is_drive(&goal.command) {
                self.goals.take(part);
                self.report(now, What::Failed { id: goal.id, why: Failure::Interrupted });
            } else if pending::is_repeatable(&goal.command) {
                self.pending.put(PendingCommand { since: now, ..goal });
            }
        }
    }

    /// Restores a command whose sending failed, unless there is a newer one.
    fn put_back(&mut self, now: Time, pending: PendingCommand) {
        if self.pending.get(Part::of(&pending.command)).is_some() {
            return;
        }
        if pending::is_repeatable(&pending.command) {
            self.pending.put(pending);
        } else {
            self.report(now, What::Failed { id: pending.id, why: Failure::Unanswered });
        }
    }

    fn watch(&mut self, part: Part) -> Option<&mut Watch> {
        match part {
            Part::Motors => Some(&mut self.motors),
            Part::Zoom => Some(&mut self.zoom),
            _ => None,
        }
    }

    fn set_link(&mut self, now: Time, link: Link) {
        if self.link != link {
            self.link = link.clone();
            self.report(now, What::Link(link));
        }
    }

    fn report(&mut self, at: Time, what: What) {
        if self.events.len() == MOST_EVENTS {
            self.events.pop_front();
            self.counts.lost_events += 1;
        }
        self.events.push_back(Event { at, what });
    }
}
