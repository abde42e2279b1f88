//! The driver of one head: a state machine without a line and without a clock.
//!
//! Bytes that came in go into [`Driver::receive`], bytes to be sent come out of [`Driver::poll`], both with the present time; what happened
//! is fetched with [`Driver::next_event`]. [`Head`](crate::head::Head) does this on a serial port or a UDP socket.
//!
//! - **One message at a time.** The next one goes when the last one was answered or given up.
//! - **Two commands in flight.** A head keeps two; a third is not sent before one of them is done.
//! - **The newest command wins.** Of commands to the same part (motors, zoom, focus, …) that could not be sent yet only the
//!   last one is kept: nothing is ever queued up, and at any rate of commands the head gets what is newest when it has room.
//! - **Inquiries in between**, in turn with commands where both are due.
//! - **What was commanded is reached.** VISCA has no checksum: a command may arrive changed. A head that stands still elsewhere is told
//!   again.
//! - **Nothing is given up.** A head that is silent, talks garbage or is unplugged is reported and greeted again with growing pauses; when it
//!   answers it gets the last command of each part, but none that sets it going without an end.

pub mod events;
mod hear;
pub mod settings;
mod wire;
mod wishes;

use std::collections::VecDeque;

use foveate::prelude::{ConfigError, Interval, Time};

use crate::visca::{Command, Inquiry, OutOfRange, Profile, Request};

pub use events::{CommandId, Counts, Event, Failure, Link, What};
pub use settings::DriverSettings;
use wire::Wire;
pub use wire::{Frame, Medium};
use wishes::{Part, Wish, Wishes};

/// The time-out of a greeting is doubled at most so many times.
const MOST_PATIENCE: u32 = 3;
/// Events that are kept until they are fetched.
const MOST_EVENTS: usize = 4096;

/// See the [module](self).
#[derive(Debug, Clone)]
pub struct Driver {
    settings: DriverSettings,
    profile: Profile,
    wire: Wire,
    link: Link,
    phase: Phase,
    /// Openings and greetings in a row that came to nothing.
    failures: u32,
    /// Messages in a row without an answer.
    misses: u32,
    /// How long answers take, the slow ones remembered longer.
    answer_time: Interval,
    /// The time-out of a greeting is doubled so many times.
    patience: u32,
    /// Bytes came since the last reply that meant something.
    has_noise: bool,
    awaited: Option<Awaited>,
    sockets: [Option<Occupant>; 2],
    /// Not sent yet.
    wishes: Wishes,
    /// The last one given, sent or not.
    goals: Wishes,
    /// After a full buffer no command goes before this.
    hold_until: Time,
    /// Since when a command could not be sent for lack of a socket.
    blocked_since: Option<Time>,
    /// Which socket was cancelled last.
    cancelled: u8,
    /// The command that the head did not understand last, and how often.
    misread: (CommandId, u32),
    next_position: Time,
    next_zoom: Time,
    /// The last message was a command.
    said_command: bool,
    motors: Watch,
    zoom: Watch,
    last_id: CommandId,
    events: VecDeque<Event>,
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
    /// Step by step: what is asked next.
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
    /// Over IP: let counting begin anew.
    Reset,
    AddressSet,
    Clear,
    Cancel {
        socket: u8,
    },
    Command(Wish),
    Inquiry(Inquiry),
}

/// What is in a socket of the head as far as the driver knows.
#[derive(Debug, Clone, Copy)]
struct Occupant {
    /// `None`: its acknowledgement came when nobody waited for it any more.
    wish: Option<Wish>,
    sequence: Option<u32>,
}

/// Whether a part gets where it was told to.
#[derive(Debug, Clone, Copy, Default)]
struct Watch {
    /// Where it was last [units].
    seen: Option<[i32; 2]>,
    /// When its last command was sent.
    sent_at: Time,
    /// How often it was told again.
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
            link: Link::Closed("not opened yet".to_owned()),
            phase: Phase::Closed { retry_at: Time(i64::MIN) },
            failures: 0,
            misses: 0,
            answer_time: Interval(0),
            patience: 0,
            has_noise: false,
            awaited: None,
            sockets: [None, None],
            wishes: Wishes::default(),
            goals: Wishes::default(),
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
            counts: Counts::default(),
        })
    }

    /// The head's model.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// How things are between driver and head.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// What has been counted.
    pub fn counts(&self) -> Counts {
        let (stray, garbage_bytes) = self.wire.counts();
        Counts { stray, garbage_bytes, ..self.counts }
    }

    /// Commands that the head has taken and not done, as far as the driver knows.
    pub fn in_flight(&self) -> usize {
        self.sockets.iter().flatten().count()
    }

    /// Whether a message is on the line whose answer has not come.
    pub fn is_waiting(&self) -> bool {
        self.awaited.is_some()
    }

    /// Whether every command was sent and done, and nothing is awaited.
    pub fn is_idle(&self) -> bool {
        self.phase == Phase::Ready
            && self.in_flight() == 0
            && self.wishes.first().is_none()
            && !matches!(self.awaited, Some(Awaited { asked: Asked::Command(_), .. }))
    }

    /// Tells the head to do something, as soon as the line and the head have room. A command for the same part that was not sent
    /// yet is replaced.
    ///
    /// # Errors
    /// A number that this model has no room for; nothing has changed then.
    pub fn command(&mut self, now: Time, command: Command) -> Result<CommandId, OutOfRange> {
        self.profile.check_command(&command)?;
        let id = CommandId(self.last_id.0 + 1);
        self.last_id = id;
        self.counts.given += 1;
        let wish = Wish { id, command, since: now };
        if let Some(replaced) = self.wishes.put(wish) {
            self.counts.replaced += 1;
            self.report(now, What::Replaced { id: replaced.id });
        }
        self.goals.put(wish);
        if let Some(watch) = self.watch(Part::of(&command)) {
            watch.corrections = 0;
        }
        Ok(id)
    }

    /// The oldest event that was not fetched.
    pub fn next_event(&mut self) -> Option<Event> {
        self.events.pop_front()
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
        if matches!(self.phase, Phase::Closed { .. }) {
            return;
        }
        self.has_noise |= !bytes.is_empty();
        let mut heard = Vec::new();
        self.wire.read(bytes, &mut heard);
        for it in heard {
            self.hear(now, it);
        }
    }

    /// What to send now; call it until it gives nothing, whenever something came in, a command was given, or [`wake`](Self::wake) has come.
    pub fn poll(&mut self, now: Time) -> Option<Frame> {
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

    /// When to poll next if nothing happens until then; `None`: not before something does.
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
                let wish = self.wishes.first().map(|_| {
                    let free = if self.has_room() { self.hold_until } else { Time(i64::MAX) };
                    blocked.map_or(free, |it| it.min(free))
                });
                let position = (self.settings.position_every_ms > 0.0).then_some(self.next_position);
                let zoom = (self.settings.zoom_every_ms > 0.0).then_some(self.next_zoom);
                [wish, position, zoom].into_iter().flatten().min()
            }
        }
    }

    /// The next message to a head that answers.
    fn choose(&mut self, now: Time) -> Option<Asked> {
        let wish = self.wishes.first();
        let has_room = self.has_room();
        if wish.is_some() && !has_room {
            self.blocked_since.get_or_insert(now);
        }
        if let (Some(wish), Some(since)) = (wish, self.blocked_since)
            && now - since >= Interval::from_ms(self.settings.cancel_after_ms)
        {
            // From now on it waits anew: one cancel at a time.
            self.blocked_since = Some(now);
            if let Some(socket) = self.socket_to_cancel(&wish) {
                self.cancelled = socket;
                return Some(Asked::Cancel { socket });
            }
        }
        let command = wish.filter(|_| has_room && now >= self.hold_until);
        let inquiry = self.due_inquiry(now);
        match (command, inquiry) {
            (Some(wish), None) => Some(Asked::Command(wish)),
            (Some(wish), Some(_)) if !self.said_command => Some(Asked::Command(wish)),
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

    /// A socket whose command stands in the way of `wish`.
    fn socket_to_cancel(&self, wish: &Wish) -> Option<u8> {
        let after_last = [self.cancelled % 2 + 1, self.cancelled];
        if self.in_flight() == 0 {
            // The head says that it is full: it has commands that the driver does not know of.
            return Some(after_last[0]);
        }
        let part = Part::of(&wish.command);
        after_last.into_iter().find(|&socket| {
            let occupant = self.sockets[usize::from(socket) - 1];
            occupant.is_some_and(|it| it.wish.is_none_or(|it| Part::of(&it.command) == part))
        })
    }

    fn has_room(&self) -> bool {
        self.sockets.iter().any(Option::is_none)
    }

    /// Writes a message, and waits for its answer from now on.
    fn say(&mut self, now: Time, asked: Asked) -> Option<Frame> {
        let request = match asked {
            Asked::Reset => None,
            Asked::AddressSet => Some(Request::AddressSet),
            Asked::Clear => Some(Request::Clear),
            Asked::Cancel { socket } => Some(Request::Cancel { socket }),
            Asked::Command(wish) => Some(Request::Command(wish.command)),
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
            Asked::Command(wish) => {
                let part = Part::of(&wish.command);
                self.wishes.take(part);
                self.counts.sent += 1;
                if let Some(watch) = self.watch(part) {
                    watch.sent_at = now;
                }
                self.report(now, What::Sent { id: wish.id, command: wish.command });
            }
            Asked::Inquiry(Inquiry::PanTiltPosition) => {
                self.next_position = now + Interval::from_ms(self.settings.position_every_ms);
            }
            Asked::Inquiry(Inquiry::Zoom) => self.next_zoom = now + Interval::from_ms(self.settings.zoom_every_ms),
            _ => {}
        }
        Some(frame)
    }

    /// A message got no answer.
    fn miss(&mut self, now: Time, awaited: &Awaited) {
        self.counts.unanswered += 1;
        self.misses += 1;
        if self.phase != Phase::Ready {
            self.patience = (self.patience + 1).min(MOST_PATIENCE);
            return self.pause(now);
        }
        if let Asked::Command(wish) = awaited.asked {
            self.put_back(now, wish);
        }
        if self.misses >= self.settings.silent_after {
            self.pause(now);
        }
    }

    /// How long an answer may take: more for a head that is slow, and more with each greeting without an answer.
    fn timeout(&self) -> Interval {
        let least = self.settings.reply_timeout_ms;
        Interval::from_ms((2.0 * self.answer_time.as_ms()).clamp(least, 8.0 * least) * f64::from(1 << self.patience))
    }

    /// An answer came in time.
    fn measure(&mut self, taken: Interval) {
        self.patience = 0;
        self.answer_time = taken.max(Interval((7 * self.answer_time.0 + taken.0) / 8));
    }

    /// A head that does not answer is left alone for a while, then greeted.
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

    /// What is on the line and in the sockets is not known any more.
    fn drop_line(&mut self, now: Time) {
        if let Some(Awaited { asked: Asked::Command(wish), .. }) = self.awaited.take() {
            self.put_back(now, wish);
        }
        self.sockets = [None, None];
        self.hold_until = Time(i64::MIN);
        self.blocked_since = None;
    }

    /// The head answers: it gets what was commanded last.
    fn be_ready(&mut self, now: Time) {
        self.phase = Phase::Ready;
        self.failures = 0;
        self.set_link(now, Link::Ready);
        let goals: Vec<Wish> = self.goals.all().collect();
        for goal in goals {
            let part = Part::of(&goal.command);
            if self.wishes.get(part).is_some() {
                continue;
            }
            if wishes::is_drive(&goal.command) {
                self.goals.take(part);
                self.report(now, What::Failed { id: goal.id, why: Failure::Interrupted });
            } else if wishes::is_repeatable(&goal.command) {
                self.wishes.put(Wish { since: now, ..goal });
            }
        }
    }

    /// A command that was sent in vain is sent again, unless there is a newer one.
    fn put_back(&mut self, now: Time, wish: Wish) {
        if self.wishes.get(Part::of(&wish.command)).is_some() {
            return;
        }
        if wishes::is_repeatable(&wish.command) {
            self.wishes.put(wish);
        } else {
            self.report(now, What::Failed { id: wish.id, why: Failure::Unanswered });
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
