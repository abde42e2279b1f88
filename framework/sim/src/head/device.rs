//! The program inside the head: bytes in, at times; replies out, at times.
//!
//! As the manuals of the EVI series say: one message is looked at in each field; a command takes one of two sockets, is
//! acknowledged with its number and completed when it is done; inquiries take none; with both sockets taken the buffer is full. The
//! bits of the pan-tilt status are not simulated: that inquiry is refused.

use std::collections::VecDeque;

use foveate_dataflow::ConfigError;
use foveate_estimation::random::Random;
use foveate_messages::{Interval, Time};

use super::mechanics::{Axis, Goal, TICK, Zoom};
use super::settings::HeadSettings;
use super::track::Track;
use super::words::{self, Order, Question, Word};

/// Bytes of the longest packet.
const LONGEST: usize = 16;
/// Messages that wait for their field; no manual says.
const WAITING: usize = 4;
/// The longest focal length [units].
const ZOOM_END: u16 = 0x03FF;
/// What a version inquiry is answered: Sony, EVI-D30, revision, two sockets.
const VERSION: [u8; 7] = [0x00, 0x20, 0x04, 0x02, 0x01, 0x21, 0x02];

/// Why something is not done, by number.
const TOO_LONG: u8 = 0x01;
const SYNTAX: u8 = 0x02;
const BUFFER_FULL: u8 = 0x03;
const CANCELLED: u8 = 0x04;
const NO_SOCKET: u8 = 0x05;
const NOT_EXECUTABLE: u8 = 0x41;

/// A packet of the head.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sent {
    /// When its first bit goes.
    pub at: Time,
    /// What came with the message that it answers, see [`Head::receive`].
    pub tag: u32,
    /// With header and terminator.
    pub bytes: Vec<u8>,
}

/// A command in its socket.
#[derive(Debug, Clone)]
struct Execution {
    order: Order,
    tag: u32,
    accepted: Time,
    is_running: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Power {
    On,
    Off,
    OnFrom(Time),
}

/// A simulated head.
#[derive(Debug, Clone)]
pub struct Head {
    settings: HeadSettings,
    random: Random,
    now: Time,
    next_field: Time,
    address: u8,
    begun: Vec<u8>,
    inbox: VecDeque<(u32, Vec<u8>)>,
    outbox: VecDeque<Sent>,
    sockets: [Option<Execution>; 2],
    n_refused_full: u64,
    power: Power,
    pan: Axis,
    tilt: Axis,
    zoom: Zoom,
    track: Track,
    /// Lowest and highest position of pan and tilt [units].
    limits: [[i32; 2]; 2],
    last_start: Time,
    focus_auto: bool,
    focus: u16,
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
            random,
            now: Time::ZERO,
            address: 1,
            begun: Vec::new(),
            inbox: VecDeque::new(),
            outbox: VecDeque::new(),
            sockets: [None, None],
            n_refused_full: 0,
            power: Power::On,
            pan: Axis::new(settings.pan.axis(), settings),
            tilt: Axis::new(settings.tilt.axis(), settings),
            track: Track::default(),
            zoom: Zoom::new(f64::from(ZOOM_END), settings.zoom_travel_ms),
            limits: [settings.pan.axis(), settings.tilt.axis()].map(|it| [-it.reach_units, it.reach_units]),
            last_start: Time::ZERO,
            focus_auto: true,
            focus: 0x1000,
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
    pub fn receive(&mut self, tag: u32, byte: u8) {
        match byte {
            0xFF => {
                let packet = std::mem::take(&mut self.begun);
                if packet.len() < 2 {
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
            0x80.. => self.begun = vec![byte],
            // What has no header is nobody's.
            _ if self.begun.is_empty() => {}
            _ if self.begun.len() < LONGEST => self.begun.push(byte),
            _ => {}
        }
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

    /// Power goes and comes back: commands are forgotten, the motors find their middle, the controller is told.
    pub fn power_cycle(&mut self) {
        self.forget();
        self.inbox.clear();
        self.begun.clear();
        self.outbox.clear();
        self.switch_on();
        self.reply(0, 0x38, &[]);
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
        self.zoom.step();
        self.track.push([self.pan.angle_rad(), self.tilt.angle_rad(), self.zoom.position()]);
        self.complete();
    }

    fn look_at(&mut self, tag: u32, packet: &[u8]) {
        let (&header, message) = packet.split_first().unwrap_or((&0, &[]));
        if header != 0x88 && header != 0x80 | self.address {
            return; // for another head, or from one
        }
        match words::read(header, message) {
            None => self.refuse(tag, 0, SYNTAX),
            Some(Word::AddressSet(number)) => {
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

    fn accept(&mut self, tag: u32, order: Order) {
        if !self.is_legal(order) {
            return self.refuse(tag, 0, SYNTAX);
        }
        let Some(free) = self.sockets.iter().position(Option::is_none) else {
            self.n_refused_full += 1;
            return self.refuse(tag, 0, BUFFER_FULL);
        };
        let socket = free as u8 + 1;
        let is_off = self.power != Power::On && !matches!(order, Order::Power(_));
        if is_off || (matches!(order, Order::FocusTo(_) | Order::FocusDrive) && self.focus_auto) {
            return self.refuse(tag, socket, NOT_EXECUTABLE);
        }
        self.reply(tag, 0x40 | socket, &[]);
        self.sockets[free] = Some(Execution { order, tag, accepted: self.now, is_running: false });
    }

    fn is_legal(&self, order: Order) -> bool {
        let (pan, tilt) = (&self.settings.pan, &self.settings.tilt);
        let speeds = |[v, w]: [u8; 2]| (1..=pan.speeds).contains(&v) && (1..=tilt.speeds).contains(&w);
        let within =
            |[x, y]: [i32; 2], times: i32| x.abs() <= times * pan.reach_units && y.abs() <= times * tilt.reach_units;
        match order {
            Order::Absolute(speed, position) => speeds(speed) && within(position, 1),
            Order::Relative(speed, way) => speeds(speed) && within(way, 2),
            Order::Drive(speed, way) => speeds(speed) || way == [0, 0],
            Order::Limit(_, position) => within(position, 1),
            Order::ZoomTo(units) => units <= ZOOM_END,
            _ => true,
        }
    }

    /// Commands whose time has come begin; one that moves takes the place of the one before.
    fn take_up(&mut self) {
        let wait = Interval::from_ms(self.settings.take_up_ms);
        let mut due: Vec<usize> = (0..2)
            .filter(|&it| self.sockets[it].as_ref().is_some_and(|it| !it.is_running && self.now >= it.accepted + wait))
            .collect();
        due.sort_by_key(|&it| self.sockets[it].as_ref().map(|it| it.accepted));
        for index in due {
            let Some(mut execution) = self.sockets[index].take() else { continue };
            let other = 1 - index;
            let rival =
                self.sockets[other].as_ref().is_some_and(|it| it.is_running && is_rival(it.order, execution.order));
            if rival && !self.settings.supersedes {
                self.sockets[index] = Some(execution);
                continue;
            }
            if rival && let Some(done) = self.sockets[other].take() {
                self.reply(done.tag, 0x50 | (other as u8 + 1), &[]);
            }
            self.begin(&execution);
            execution.is_running = true;
            self.sockets[index] = Some(execution);
        }
    }

    fn begin(&mut self, execution: &Execution) {
        let jitter = self.random.uniform() * self.settings.latency_jitter_ms;
        let earliest = execution.accepted + Interval::from_ms(self.settings.latency_ms + jitter);
        let fastest = [self.settings.pan.speeds, self.settings.tilt.speeds];
        let here = [self.pan.motor_units(), self.tilt.motor_units()];
        match execution.order {
            Order::Absolute(speed, position) => self.go(earliest, speed, position.map(Some)),
            Order::Relative(speed, [x, y]) => self.go(earliest, speed, [Some(here[0] + x), Some(here[1] + y)]),
            Order::Drive(speed, way) => {
                let end = |axis: usize| match way[axis] {
                    0 => None,
                    1.. => Some(self.limits[axis][1]),
                    _ => Some(self.limits[axis][0]),
                };
                let ends = [end(0), end(1)];
                self.go(earliest, speed, ends);
            }
            Order::Home | Order::Reset => self.go(earliest, fastest, [Some(0), Some(0)]),
            Order::Limit(up_right, [x, y]) => {
                let end = usize::from(up_right);
                (self.limits[0][end], self.limits[1][end]) = (x, y);
            }
            Order::NoLimit(up_right) => {
                let end = usize::from(up_right);
                let sign = if up_right { 1 } else { -1 };
                self.limits[0][end] = sign * self.settings.pan.reach_units;
                self.limits[1][end] = sign * self.settings.tilt.reach_units;
            }
            Order::ZoomTo(units) => self.zoom.go(f64::from(units)),
            Order::ZoomDrive(0) => self.zoom.stop(),
            Order::ZoomDrive(way) => self.zoom.go(if way > 0 { f64::from(ZOOM_END) } else { 0.0 }),
            Order::FocusAuto(auto) => self.focus_auto = auto,
            Order::FocusTo(units) => self.focus = units,
            Order::FocusDrive => {}
            Order::Power(true) if self.power == Power::Off => self.switch_on(),
            Order::Power(true) => {}
            Order::Power(false) => {
                self.power = Power::Off;
                self.halt();
            }
        }
    }

    /// Sends both motors somewhere; `None`: comes to rest.
    fn go(&mut self, earliest: Time, speed: [u8; 2], position: [Option<i32>; 2]) {
        let start = earliest.max(self.last_start).max(self.now);
        self.last_start = start;
        for (index, axis) in [&mut self.pan, &mut self.tilt].into_iter().enumerate() {
            let [low, high] = self.limits[index];
            let goal = position[index].map_or(Goal::Stop, |units| Goal::At {
                units: f64::from(units.clamp(low.min(high), high.max(low))),
                speed: axis.speed_of(speed[index]),
            });
            axis.order(start, goal);
        }
    }

    /// What is done is said so, and its socket is free.
    fn complete(&mut self) {
        for index in 0..2 {
            let Some(execution) = &self.sockets[index] else { continue };
            let is_done = execution.is_running
                && match execution.order {
                    Order::Absolute(..) | Order::Relative(..) | Order::Home | Order::Reset => {
                        self.pan.is_done() && self.tilt.is_done()
                    }
                    Order::ZoomTo(_) => self.zoom.is_done(),
                    Order::Power(true) => self.power == Power::On,
                    _ => true,
                };
            if is_done {
                let tag = execution.tag;
                self.sockets[index] = None;
                self.reply(tag, 0x50 | (index as u8 + 1), &[]);
            }
        }
    }

    fn cancel(&mut self, tag: u32, socket: u8) {
        let index = usize::from(socket).wrapping_sub(1);
        match self.sockets.get_mut(index).and_then(Option::take) {
            None => self.refuse(tag, socket, NO_SOCKET),
            Some(execution) => {
                if execution.is_running {
                    match execution.order {
                        Order::ZoomTo(_) => self.zoom.stop(),
                        order if is_move(order) => self.halt(),
                        _ => {}
                    }
                }
                // The reply tells of the command, under the number of the cancel that asked for it.
                self.refuse(tag, socket, CANCELLED);
            }
        }
    }

    fn answer(&mut self, tag: u32, question: Question) {
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
            Question::Focus => four(self.focus),
            Question::MaxSpeed => vec![self.settings.pan.speeds, self.settings.tilt.speeds],
            Question::Position => {
                [self.pan.motor_units(), self.tilt.motor_units()].into_iter().flat_map(words::digits).collect()
            }
        };
        self.reply(tag, 0x50, &answer);
    }

    fn switch_on(&mut self) {
        self.power = Power::OnFrom(self.now + Interval::from_ms(self.settings.power_on_ms));
        let fastest = [self.settings.pan.speeds, self.settings.tilt.speeds];
        self.go(self.now, fastest, [Some(0), Some(0)]);
    }

    fn forget(&mut self) {
        self.sockets = [None, None];
        self.zoom.stop();
        // While it gets ready the motors find their middle, whoever talks to it.
        if !matches!(self.power, Power::OnFrom(_)) {
            self.halt();
        }
    }

    /// Motors come to rest where they are.
    fn halt(&mut self) {
        for axis in [&mut self.pan, &mut self.tilt] {
            axis.forget();
            axis.order(self.now, Goal::Stop);
        }
        self.last_start = self.now;
    }

    fn refuse(&mut self, tag: u32, socket: u8, why: u8) {
        self.reply(tag, 0x60 | socket, &[why]);
    }

    fn reply(&mut self, tag: u32, first: u8, rest: &[u8]) {
        let bytes = [&[0x80 | self.address << 4, first], rest, &[0xFF]].concat();
        self.outbox.push_back(Sent { at: self.now, tag, bytes });
    }
}

fn is_move(order: Order) -> bool {
    matches!(order, Order::Absolute(..) | Order::Relative(..) | Order::Drive(..) | Order::Home | Order::Reset)
}

/// Whether two commands want the same motor.
fn is_rival(a: Order, b: Order) -> bool {
    let is_zoom = |it: Order| matches!(it, Order::ZoomTo(_) | Order::ZoomDrive(_));
    (is_move(a) && is_move(b)) || (is_zoom(a) && is_zoom(b))
}
