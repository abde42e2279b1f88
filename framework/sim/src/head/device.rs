//! The program inside the head: bytes in, at times; replies out, at times.
//!
//! As the manuals of the EVI series say: one message is looked at in each field; a command takes one of two sockets, is
//! acknowledged with its number and completed when it is done; inquiries take none; with both sockets taken the buffer is full. The
//! bits of the pan-tilt status and the EVI-D30's own tracking of targets are not simulated: such messages are refused as syntax errors. What
//! becomes of commands stands in `commands`.

use std::collections::VecDeque;
use std::net::SocketAddr;

use foveate_estimation::random::Random;
use foveate_messages::{Interval, Time};
use foveate_node::ConfigError;

use super::mechanics::{Axis, Goal, TICK, Zoom, ZoomGoal};
use super::picture::Picture;
use super::settings::HeadSettings;
use super::track::Track;
use super::words::{self, Order, Question, Word};

/// Bytes of the longest packet.
const LONGEST: usize = 16;
/// Messages that wait for their field; no manual says.
const WAITING: usize = 4;
/// The longest focal length [units].
pub(super) const ZOOM_END: u16 = 0x03FF;
/// Focus on what is far and on what is near [units].
pub(super) const FOCUS_ENDS: [u16; 2] = [0x1000, 0x9FFF];
/// The way between the two; no manual says for the EVI-D30 [ms].
const FOCUS_TRAVEL_MS: f64 = 2000.0;
/// Places of the memory.
pub(super) const PRESETS: usize = 6;
/// What a version inquiry is answered: Sony, EVI-D30, revision, two sockets.
const VERSION: [u8; 7] = [0x00, 0x20, 0x04, 0x02, 0x01, 0x21, 0x02];

/// Why something is not done, by number.
pub(super) const TOO_LONG: u8 = 0x01;
pub(super) const SYNTAX: u8 = 0x02;
pub(super) const BUFFER_FULL: u8 = 0x03;
pub(super) const CANCELLED: u8 = 0x04;
pub(super) const NO_SOCKET: u8 = 0x05;
pub(super) const NOT_EXECUTABLE: u8 = 0x41;

/// Where a message came from; its answers carry it, unread by the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tag {
    /// The controller on the network, where there may be several.
    pub controller: Option<SocketAddr>,
    /// The message's number.
    pub sequence: u32,
}

/// A packet of the head.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sent {
    /// When its first bit goes.
    pub at: Time,
    /// What came with the message that it answers, see [`Head::receive`].
    pub tag: Tag,
    /// With header and terminator.
    pub bytes: Vec<u8>,
}

/// A command in its socket.
#[derive(Debug, Clone)]
pub(super) struct Execution {
    pub(super) order: Order,
    pub(super) tag: Tag,
    pub(super) accepted: Time,
    pub(super) is_running: bool,
}

/// A place of the memory: everything that is set again when it is recalled.
#[derive(Debug, Clone)]
pub(super) struct Preset {
    pub(super) pan_tilt: [i32; 2],
    pub(super) zoom: u16,
    pub(super) focus_auto: bool,
    pub(super) focus: u16,
    pub(super) picture: Picture,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Power {
    On,
    Off,
    OnFrom(Time),
}

/// A simulated head.
#[derive(Debug, Clone)]
pub struct Head {
    pub(super) settings: HeadSettings,
    pub(super) random: Random,
    pub(super) now: Time,
    next_field: Time,
    address: u8,
    /// It stays 1, as on a network.
    is_address_fixed: bool,
    begun: Vec<u8>,
    inbox: VecDeque<(Tag, Vec<u8>)>,
    outbox: VecDeque<Sent>,
    pub(super) sockets: [Option<Execution>; 2],
    pub(super) n_refused_full: u64,
    pub(super) power: Power,
    pub(super) pan: Axis,
    pub(super) tilt: Axis,
    pub(super) zoom: Zoom,
    track: Track,
    /// Lowest and highest position of pan and tilt [units].
    pub(super) limits: [[i32; 2]; 2],
    pub(super) last_start: Time,
    pub(super) focus_auto: bool,
    pub(super) focus: Zoom,
    pub(super) picture: Picture,
    pub(super) memory: [Option<Preset>; PRESETS],
    pub(super) recalled: u8,
}

impl Head {
    /// A head that was switched on a while ago, looks straight ahead and has address 1.
    ///
    /// # Errors
    /// Settings out of their ranges.
    pub fn new(settings: &HeadSettings, seed: u64) -> Result<Head, ConfigError> {
        settings.check()?;
        let mut random = Random::new(seed).fork("head");
        let phase = random.uniform();
        Ok(Head {
            next_field: Time::from_s(phase * settings.field_ms * 1e-3),
            now: Time::ZERO,
            address: 1,
            is_address_fixed: false,
            begun: Vec::new(),
            inbox: VecDeque::new(),
            outbox: VecDeque::new(),
            sockets: [None, None],
            n_refused_full: 0,
            power: Power::On,
            pan: Axis::new(settings.pan.axis(), settings, &random.fork("pan")),
            tilt: Axis::new(settings.tilt.axis(), settings, &random.fork("tilt")),
            track: Track::default(),
            zoom: Zoom::new([0.0, f64::from(ZOOM_END)], settings.zoom_travel_ms),
            limits: [settings.pan.axis(), settings.tilt.axis()].map(|it| [-it.reach_units, it.reach_units]),
            last_start: Time::ZERO,
            focus_auto: true,
            focus: Zoom::new(FOCUS_ENDS.map(f64::from), FOCUS_TRAVEL_MS),
            picture: Picture::default(),
            memory: Default::default(),
            recalled: 0,
            random,
            settings: settings.clone(),
        })
    }

    /// The axis from side to side, as it is now.
    pub fn pan(&self) -> &Axis {
        &self.pan
    }

    /// The axis up and down, as it is now.
    pub fn tilt(&self) -> &Axis {
        &self.tilt
    }

    /// The zoom, as it is now; 0 is the shortest focal length [units].
    pub fn zoom_units(&self) -> u16 {
        self.zoom.units()
    }

    /// Where the camera looked and how it was zoomed at `time`, which is not after the time up to which the head has lived: pan, tilt [rad],
    /// zoom [units]. What is longer ago than [`REMEMBERED_S`](super::REMEMBERED_S) is as it was then.
    pub fn looked(&self, time: Time) -> [f64; 3] {
        self.track.at(time)
    }

    /// Whether nothing moves and nothing is about to.
    pub fn is_at_rest(&self) -> bool {
        self.pan.is_done() && self.tilt.is_done() && self.zoom.is_done() && self.sockets.iter().all(Option::is_none)
    }

    /// Commands so far that found the buffer full.
    pub fn n_refused_full(&self) -> u64 {
        self.n_refused_full
    }

    /// Takes a byte whose last bit has come by now; what answers its packet carries `tag`.
    pub fn receive(&mut self, tag: Tag, byte: u8) {
        match byte {
            0xFF => {
                let packet = std::mem::take(&mut self.begun);
                self.take_in(tag, packet);
            }
            // A controller begins: what came before has lost its end. Other bytes of this kind are data of some messages.
            0x81..=0x88 => self.begun = vec![byte],
            // What has no header is nobody's.
            0x00..=0x7F if self.begun.is_empty() => {}
            _ if self.begun.len() < LONGEST => self.begun.push(byte),
            _ => {}
        }
    }

    /// Takes a message that came as a whole, as on a network: whatever stands between its header and its end is data. What has no end is refused.
    pub(super) fn receive_whole(&mut self, tag: Tag, message: &[u8]) {
        let mut packets = message.split(|it| *it == 0xFF);
        let rest = packets.next_back().unwrap_or_default();
        packets.for_each(|it| self.take_in(tag, it.to_vec()));
        if !rest.is_empty() {
            self.refuse(tag, 0, if rest.len() >= LONGEST { TOO_LONG } else { SYNTAX });
        }
    }

    /// A packet without its end; an end by itself ends nothing, and a header by itself is a message that says nothing.
    fn take_in(&mut self, tag: Tag, packet: Vec<u8>) {
        if packet.is_empty() {
            return;
        }
        if packet.len() >= LONGEST {
            self.refuse(tag, 0, TOO_LONG);
        } else if self.inbox.len() == WAITING {
            self.n_refused_full += 1;
            self.refuse(tag, 0, BUFFER_FULL);
        } else {
            self.inbox.push_back((tag, packet));
        }
    }

    /// The head keeps address 1, whatever address it is given.
    pub(super) fn fix_address(&mut self) {
        self.is_address_fixed = true;
    }

    /// A message that is none is refused.
    pub(super) fn refuse_syntax(&mut self, tag: Tag) {
        self.refuse(tag, 0, SYNTAX);
    }

    /// Lives until `to`.
    pub fn advance(&mut self, to: Time) {
        while self.now + TICK <= to {
            self.now = self.now + TICK;
            self.tick();
        }
    }

    /// Takes the next packet that the head has sent by now.
    pub fn send(&mut self) -> Option<Sent> {
        self.outbox.pop_front()
    }

    /// Power goes and comes back: commands are forgotten, the motors find their middle, the controller is notified.
    pub fn power_cycle(&mut self) {
        self.forget();
        self.inbox.clear();
        self.begun.clear();
        self.outbox.clear();
        self.switch_on();
        self.reply(Tag::default(), 0x38, &[]);
    }

    fn tick(&mut self) {
        if let Power::OnFrom(from) = self.power
            && self.now >= from
        {
            self.power = Power::On;
        }
        self.take_up();
        if self.now >= self.next_field {
            self.next_field = self.next_field + Interval::from_ms(self.settings.field_ms);
            if let Some((tag, packet)) = self.inbox.pop_front() {
                self.look_at(tag, &packet);
            }
        }
        self.pan.step(self.now);
        self.tilt.step(self.now);
        self.zoom.step(self.now);
        self.focus.step(self.now);
        self.track.push([self.pan.angle_rad(), self.tilt.angle_rad(), self.zoom.position()]);
        self.complete();
    }

    fn look_at(&mut self, tag: Tag, packet: &[u8]) {
        let (&header, message) = packet.split_first().unwrap_or((&0, &[]));
        if header != 0x88 && header != 0x80 | self.address {
            return; // for another head, or from one
        }
        match words::read(header, message) {
            None => self.refuse(tag, 0, SYNTAX),
            Some(Word::AddressSet(number)) => {
                let number = if self.is_address_fixed { 1 } else { number };
                self.address = number;
                self.outbox.push_back(Sent { at: self.now, tag, bytes: vec![0x88, 0x30, number + 1, 0xFF] });
            }
            Some(Word::Clear { broadcast }) => {
                self.forget();
                if broadcast {
                    self.outbox.push_back(Sent { at: self.now, tag, bytes: vec![0x88, 0x01, 0x00, 0x01, 0xFF] });
                } else {
                    self.reply(tag, 0x50, &[]);
                }
            }
            Some(Word::Cancel(socket)) => self.cancel(tag, socket),
            Some(Word::Question(question)) => self.answer(tag, question),
            Some(Word::Order(order)) => self.accept(tag, order),
        }
    }

    fn answer(&mut self, tag: Tag, question: Question) {
        if self.power == Power::Off && !matches!(question, Question::Power | Question::Version) {
            return self.refuse(tag, 0, NOT_EXECUTABLE);
        }
        let on_off = |it: bool| if it { 2 } else { 3 };
        let four = |it: u16| words::digits(i32::from(it)).to_vec();
        let answer = match question {
            Question::Power => vec![on_off(self.power != Power::Off)],
            Question::Version => VERSION.to_vec(),
            Question::Zoom => four(self.zoom.units()),
            Question::FocusMode => vec![on_off(self.focus_auto)],
            Question::Focus => four(self.focus.units()),
            Question::Memory => vec![self.recalled],
            Question::Picture(index) => self.picture.answer(index),
            Question::MaxSpeed => vec![self.settings.pan.speeds, self.settings.tilt.speeds],
            Question::Position => {
                [self.pan.motor_units(), self.tilt.motor_units()].into_iter().flat_map(words::digits).collect()
            }
        };
        self.reply(tag, 0x50, &answer);
    }

    pub(super) fn switch_on(&mut self) {
        self.power = Power::OnFrom(self.now + Interval::from_ms(self.settings.power_on_ms));
        let fastest = [self.settings.pan.speeds, self.settings.tilt.speeds];
        self.go(self.now, fastest, [Some(0), Some(0)]);
    }

    fn forget(&mut self) {
        self.sockets = [None, None];
        self.zoom.order(self.felt(), ZoomGoal::Stop);
        // While it gets ready the motors find their middle, whoever talks to it.
        if !matches!(self.power, Power::OnFrom(_)) {
            self.halt();
        }
    }

    /// Motors come to rest where they are.
    pub(super) fn halt(&mut self) {
        let felt = self.felt();
        for axis in [&mut self.pan, &mut self.tilt] {
            axis.forget(felt);
            axis.order(felt, Goal::Stop);
        }
        self.last_start = felt;
    }

    /// From when motors and zoom feel what is decided now.
    pub(super) fn felt(&self) -> Time {
        self.now + Interval::from_ms(self.settings.reaction_ms)
    }

    pub(super) fn refuse(&mut self, tag: Tag, socket: u8, why: u8) {
        self.reply(tag, 0x60 | socket, &[why]);
    }

    pub(super) fn reply(&mut self, tag: Tag, first: u8, rest: &[u8]) {
        let bytes = [&[0x80 | self.address << 4, first], rest, &[0xFF]].concat();
        self.outbox.push_back(Sent { at: self.now, tag, bytes });
    }
}
