//! Execution of commands: accepted into a socket or refused, begun, replaced, completed or cancelled.

use foveate_messages::{Interval, Time};

use super::device::{
    BUFFER_FULL, CANCELLED, Execution, FOCUS_ENDS, Head, NO_SOCKET, NOT_EXECUTABLE, PRESETS, Power, Preset, SYNTAX,
    Tag, ZOOM_END,
};
use super::mechanics::{Goal, ZoomGoal};
use super::words::{Memory, Order};

impl Head {
    pub(super) fn accept(&mut self, tag: Tag, order: Order) {
        if !self.is_legal(order) {
            return self.refuse(tag, 0, SYNTAX);
        }
        let free = self.sockets.iter().position(Option::is_none);
        if !self.is_executable(order) {
            return self.refuse(tag, free.map_or(0, |it| it as u8 + 1), NOT_EXECUTABLE);
        }
        let Some(free) = free else {
            self.n_refused_full += 1;
            return self.refuse(tag, 0, BUFFER_FULL);
        };
        let socket = free as u8 + 1;
        self.reply(tag, 0x40 | socket, &[]);
        self.sockets[free] = Some(Execution { order, tag, accepted: self.now, is_running: false });
    }

    /// Whether it can be done as things are.
    fn is_executable(&self, order: Order) -> bool {
        match (self.power, order) {
            // Getting ready.
            (Power::OnFrom(_), _) => false,
            (Power::Off, order) => matches!(order, Order::Power(_)),
            (Power::On, Order::FocusTo(_) | Order::FocusDrive(_)) => !self.focus_auto,
            (Power::On, Order::Memory(Memory::Recall, number)) => self.memory[usize::from(number)].is_some(),
            (Power::On, _) => true,
        }
    }

    fn is_legal(&self, order: Order) -> bool {
        let (pan, tilt) = (&self.settings.pan, &self.settings.tilt);
        let speeds = |[v, w]: [u8; 2]| (1..=pan.speeds).contains(&v) && (1..=tilt.speeds).contains(&w);
        let within =
            |[x, y]: [i32; 2], times: i32| x.abs() <= times * pan.reach_units && y.abs() <= times * tilt.reach_units;
        match order {
            Order::Absolute(speed, position) => speeds(speed) && within(position, 1),
            Order::Relative(speed, way) => speeds(speed) && within(way, 2),
            // The speed of an axis that stops means nothing: controllers send 0, or what their stick shows.
            Order::Drive([v, w], [x, y]) => {
                (x == 0 || (1..=pan.speeds).contains(&v)) && (y == 0 || (1..=tilt.speeds).contains(&w))
            }
            Order::Limit(_, position) => within(position, 1),
            Order::ZoomTo(units) => units <= ZOOM_END,
            Order::Memory(_, number) => usize::from(number) < PRESETS,
            _ => true,
        }
    }

    /// Commands whose time has come begin; one that moves takes the place of the one before.
    pub(super) fn take_up(&mut self) {
        let wait = Interval::from_ms(self.settings.take_up_ms);
        let mut due: Vec<usize> = (0..2)
            .filter(|&it| {
                self.sockets[it].as_ref().is_some_and(|it| {
                    // What turns no motor takes nothing's place, and is done at once: who asks next is told so.
                    !it.is_running && (!is_motion(it.order) || self.now >= it.accepted + wait)
                })
            })
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
            Order::ZoomTo(units) => self.zoom.order(self.felt(), ZoomGoal::At(f64::from(units))),
            Order::ZoomDrive(0) => self.zoom.order(self.felt(), ZoomGoal::Stop),
            Order::ZoomDrive(way) => {
                self.zoom.order(self.felt(), ZoomGoal::At(if way > 0 { f64::from(ZOOM_END) } else { 0.0 }));
            }
            Order::FocusAuto(auto) => self.focus_auto = auto,
            Order::FocusToggle => self.focus_auto = !self.focus_auto,
            Order::FocusTo(units) => self.focus.order(self.felt(), ZoomGoal::At(f64::from(units))),
            Order::FocusDrive(0) => self.focus.order(self.felt(), ZoomGoal::Stop),
            Order::FocusDrive(way) => {
                self.focus.order(self.felt(), ZoomGoal::At(f64::from(FOCUS_ENDS[usize::from(way > 0)])));
            }
            Order::Memory(what, number) => self.remember(earliest, what, number),
            Order::Picture(change) => self.picture.apply(change),
            Order::Power(true) if self.power == Power::Off => self.switch_on(),
            Order::Power(true) => {}
            Order::Power(false) => {
                self.power = Power::Off;
                self.halt();
            }
        }
    }

    fn remember(&mut self, earliest: Time, what: Memory, number: u8) {
        let index = usize::from(number);
        match what {
            Memory::Reset => self.memory[index] = None,
            Memory::Set => {
                self.memory[index] = Some(Preset {
                    pan_tilt: [self.pan.motor_units(), self.tilt.motor_units()],
                    zoom: self.zoom.units(),
                    focus_auto: self.focus_auto,
                    focus: self.focus.units(),
                    picture: self.picture.clone(),
                });
            }
            Memory::Recall => {
                // It may have been reset since the command was taken: then there is nothing to do.
                let Some(preset) = self.memory[index].clone() else { return };
                self.recalled = number;
                let fastest = [self.settings.pan.speeds, self.settings.tilt.speeds];
                self.go(earliest, fastest, preset.pan_tilt.map(Some));
                self.zoom.order(self.felt(), ZoomGoal::At(f64::from(preset.zoom)));
                self.focus.order(self.felt(), ZoomGoal::At(f64::from(preset.focus)));
                (self.focus_auto, self.picture) = (preset.focus_auto, preset.picture);
            }
        }
    }

    /// Sends both motors somewhere; `None`: comes to rest.
    pub(super) fn go(&mut self, earliest: Time, speed: [u8; 2], position: [Option<i32>; 2]) {
        let start = earliest.max(self.last_start).max(self.felt());
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
    pub(super) fn complete(&mut self) {
        for index in 0..2 {
            let Some(execution) = &self.sockets[index] else { continue };
            let is_done = execution.is_running
                && match execution.order {
                    Order::Absolute(..) | Order::Relative(..) | Order::Home | Order::Reset => {
                        self.pan.is_done() && self.tilt.is_done()
                    }
                    Order::Memory(Memory::Recall, _) => {
                        self.pan.is_done() && self.tilt.is_done() && self.zoom.is_done() && self.focus.is_done()
                    }
                    Order::ZoomTo(_) => self.zoom.is_done(),
                    Order::FocusTo(_) => self.focus.is_done(),
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

    pub(super) fn cancel(&mut self, tag: Tag, socket: u8) {
        let index = usize::from(socket).wrapping_sub(1);
        match self.sockets.get_mut(index).and_then(Option::take) {
            None => self.refuse(tag, socket, NO_SOCKET),
            Some(execution) => {
                if execution.is_running {
                    match execution.order {
                        Order::ZoomTo(_) => self.zoom.order(self.felt(), ZoomGoal::Stop),
                        Order::FocusTo(_) => self.focus.order(self.felt(), ZoomGoal::Stop),
                        Order::Memory(Memory::Recall, _) => {
                            self.halt();
                            self.zoom.order(self.felt(), ZoomGoal::Stop);
                            self.focus.order(self.felt(), ZoomGoal::Stop);
                        }
                        order if is_move(order) => self.halt(),
                        _ => {}
                    }
                }
                // The reply tells of the command, under the number of the cancel that asked for it.
                self.refuse(tag, socket, CANCELLED);
            }
        }
    }
}

fn is_move(order: Order) -> bool {
    matches!(
        order,
        Order::Absolute(..)
            | Order::Relative(..)
            | Order::Drive(..)
            | Order::Home
            | Order::Reset
            | Order::Memory(Memory::Recall, _)
    )
}

fn is_zoom(order: Order) -> bool {
    matches!(order, Order::ZoomTo(_) | Order::ZoomDrive(_))
}

fn is_focus(order: Order) -> bool {
    matches!(order, Order::FocusTo(_) | Order::FocusDrive(_))
}

/// Whether a motor turns.
fn is_motion(order: Order) -> bool {
    is_move(order) || is_zoom(order) || is_focus(order)
}

/// Whether two commands want the same motor.
fn is_rival(a: Order, b: Order) -> bool {
    (is_move(a) && is_move(b)) || (is_zoom(a) && is_zoom(b)) || (is_focus(a) && is_focus(b))
}
