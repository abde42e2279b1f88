//! What is shown: a run that goes on, or a session at some moment of it.

use std::time::Instant;

use foveate_engine::look::Look;
use foveate_messages::{Interval, Time};
use foveate_node::io::Packet;
use foveate_session::glance::Glance;

/// How fast a session can be played, against the pace of the recording.
const SPEEDS: [f64; 2] = [0.05, 20.0];

/// Where messages come from.
pub(crate) enum Source {
    /// The run.
    Run(Look),
    /// A session.
    Session(Box<Playing>),
}

impl Source {
    /// The newest message of an output.
    pub(crate) fn newest(&mut self, output: (usize, usize)) -> Option<Packet> {
        match self {
            Source::Run(look) => look.newest(output.0, output.1),
            Source::Session(playing) => playing.newest(output),
        }
    }
}

/// A session that is played.
pub(crate) struct Playing {
    glance: Glance,
    /// The moment that is shown.
    at: Time,
    /// Since when it is played on from there; `None`: it stands.
    since: Option<Instant>,
    pub speed: f64,
    pub repeats: Option<[Time; 2]>,
}

impl Playing {
    /// From its begin.
    pub(crate) fn new(glance: Glance, now: Instant) -> Playing {
        let at = glance.span()[0];
        Playing { glance, at, since: Some(now), speed: 1.0, repeats: None }
    }

    /// Looks into another session from now on, at the same moment.
    pub(crate) fn replace(&mut self, glance: Glance) {
        self.glance = glance;
    }

    pub(crate) fn glance(&self) -> &Glance {
        &self.glance
    }

    pub(crate) fn span(&self) -> [Time; 2] {
        self.glance.span()
    }

    pub(crate) fn at(&self) -> Time {
        self.at
    }

    pub(crate) fn is_standing(&self) -> bool {
        self.since.is_none()
    }

    /// Goes on to the moment `now` on the wall.
    pub(crate) fn go_on(&mut self, now: Instant) {
        let Some(since) = self.since else { return };
        self.since = Some(now);
        let step = Interval((now.saturating_duration_since(since).as_nanos() as f64 * self.speed) as i64);
        let [first, last] = self.repeats.unwrap_or_else(|| self.span());
        self.at = self.at + step;
        if self.at < last {
            return;
        }
        match self.repeats {
            Some(_) => self.at = first,
            None => (self.at, self.since) = (last, None),
        }
    }

    /// Stands still, or plays on: from the begin where it has come to the end.
    pub(crate) fn play(&mut self, is_played: bool, now: Instant) {
        self.since = is_played.then_some(now);
        if is_played && self.repeats.is_none() && self.at >= self.span()[1] {
            self.at = self.span()[0];
        }
    }

    /// Shows the moment `to`.
    pub(crate) fn seek(&mut self, to: Time) {
        let [first, last] = self.span();
        self.at = to.clamp(first, last);
    }

    /// Shows the next picture, or the one before, and stands.
    pub(crate) fn step(&mut self, is_forward: bool) {
        self.since = None;
        if let Some(at) = self.glance.neighbour(self.at, is_forward) {
            self.at = at;
        }
    }

    /// Repeats a part; `None`: plays on to the end.
    ///
    /// # Errors
    /// A part that is empty.
    pub(crate) fn repeat(&mut self, part: Option<[Time; 2]>) -> Result<(), String> {
        let [first, last] = self.span();
        let part = part.map(|it| it.map(|it| it.clamp(first, last)));
        if let Some([a, b]) = part.filter(|it| it[0] >= it[1]) {
            return Err(format!("found a part from {a} to {b}, expected its end behind its begin"));
        }
        self.repeats = part;
        if let Some([a, b]) = part.filter(|it| !(it[0]..it[1]).contains(&self.at)) {
            self.at = if self.at < a || self.at >= b { a } else { self.at };
        }
        Ok(())
    }

    /// Plays at another speed, within what is possible.
    pub(crate) fn set_speed(&mut self, speed: f64) {
        let [least, most] = SPEEDS;
        self.speed = if speed.is_finite() { speed.clamp(least, most) } else { 1.0 };
    }

    fn newest(&mut self, output: (usize, usize)) -> Option<Packet> {
        self.glance.newest(output, self.at)
    }
}
