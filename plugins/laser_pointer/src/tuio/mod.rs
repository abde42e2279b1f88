//! `laser_pointer.tuio`: pointers as TUIO 1.1 cursors (`/tuio/2Dcur`) over OSC and UDP, for other programs.
//!
//! A cursor is a pointer that is held down, like a finger on a touch table; each press is another session. Its predicted position at display time
//! (`predicted`) is sent. Cursors have no users; where these are known, `objects` also sends their pointers as objects, whose class is the user.
//!
//! At most `rate_hz` frames a second are sent, regardless of the number of cameras: unsent states are replaced by newer ones, and counted. A client that
//! reads more slowly has old datagrams in its own socket, which no sender can see: use a lower rate. Every datagram holds the whole state, so that
//! the next one repairs a loss; without changes the state is repeated each second. The rate is in session time, as no node reads a clock: a run that is
//! faster than real time sends correspondingly faster.

mod bundle;

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};

use foveate::prelude::*;
use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::bundle::{Cursor, Profile, datagrams};
use crate::wall::Wall;

ports! {
    POINTERS: In<Pointers> = each("pointers");
}

figures! {
    "tuio.frames": count, neither, "Frames sent";
        "tuio.cursors": count, neither, "Cursors sent: presses, each with a session of its own";
        "tuio.superseded": count, neither, "States replaced by a newer one before they were sent, to keep to `rate_hz`";
        "tuio.failed": count, low, "Datagrams that the system did not send, over all clients";
    "tuio.left_out": count, low, "Pointers left out of a frame: more than 64 were held down";
}

/// Most cursors at once; a wall full of people has a tenth.
const MOST_CURSORS: usize = 64;
/// Without changes the state is repeated after this time, for clients that start late or lost a datagram.
const SAID_AGAIN: Interval = Interval(1_000_000_000);

/// Settings of [`Tuio`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TuioSettings {
    /// Addresses of the clients, HOST:PORT; TUIO's own port is 3333 [–]
    pub to: Vec<String>,
    /// Most frames per second of session time [Hz]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// Name of the source in messages, as `name@host` [–]
    pub source: String,
    /// Whether pointers with a known user are also sent as objects (`/tuio/2Dobj`), with the session of their cursor and the user as class [–]
    pub objects: bool,
}

impl Default for TuioSettings {
    fn default() -> Self {
        Self {
            to: vec!["127.0.0.1:3333".to_owned()],
            rate_hz: 60.0,
            source: "foveate@localhost".to_owned(),
            objects: false,
        }
    }
}

/// Pointers in, datagrams out.
pub struct Tuio {
    source: String,
    objects: bool,
    period: Interval,
    wall: Wall,
    clients: Vec<Client>,
    /// By pointer: its session, and its last sent speed.
    sessions: BTreeMap<TargetId, Session>,
    next_session: i32,
    frame: i32,
    sent: Option<Time>,
    /// The cursors sent last, and those to be sent.
    said: Vec<Cursor>,
    waits: bool,
    n_frames: u64,
    n_superseded: u64,
    n_left_out: u64,
}

struct Client {
    name: String,
    socket: UdpSocket,
    n_failed: u64,
    fault: Option<String>,
    /// Whether the last datagrams reached no program.
    has_no_listener: bool,
}

#[derive(Debug, Clone, Copy)]
struct Session {
    number: i32,
    /// Speed and its time, for the acceleration.
    speed: f64,
    time: Time,
    acceleration: f64,
}

impl Node for Tuio {
    const TYPE: &'static str = "laser_pointer.tuio";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Sends pointers on a wall to TUIO 1.1 clients over OSC and UDP";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = TuioSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: TuioSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("rate_hz", settings.rate_hz, 1.0..=1000.0)?;
        let source = &settings.source;
        if !(1..=64).contains(&source.len()) || !source.bytes().all(|it| it.is_ascii_graphic()) {
            let message = format!("found `{source}`, expected 1 to 64 letters, digits and signs, as `wall@localhost`");
            return Err(ConfigError::at("source", message));
        }
        let wall = Wall::of(setup)?;
        if settings.to.is_empty() {
            return Err(ConfigError::at("to", "found no address, expected HOST:PORT of one client or more"));
        }
        let mut clients = Vec::new();
        for (place, name) in settings.to.iter().enumerate() {
            let setting = format!("to[{place}]");
            let fault = |why: String| {
                ConfigError::at(&setting, format!("found `{name}`, expected HOST:PORT of a client: {why}"))
            };
            name.rsplit_once(':').and_then(|it| it.1.parse::<u16>().ok()).ok_or_else(|| fault("no port".to_owned()))?;
            if setup.purpose == Purpose::Run {
                let address = address_of(name).map_err(fault)?;
                let (socket, unreached) = socket_to(&address).map_err(|error| fault(error.to_string()))?;
                clients.push(Client {
                    name: name.clone(),
                    socket,
                    n_failed: 0,
                    fault: unreached,
                    has_no_listener: false,
                });
            }
        }
        Ok(Self {
            source: settings.source,
            objects: settings.objects,
            period: Interval::from_s(1.0 / settings.rate_hz),
            wall,
            clients,
            sessions: BTreeMap::new(),
            next_session: 0,
            frame: 0,
            sent: None,
            said: Vec::new(),
            waits: false,
            n_frames: 0,
            n_superseded: 0,
            n_left_out: 0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(Stamped { value: pointers, .. }) = io.take(&POINTERS) else { return Ok(()) };
        let cursors = self.cursors(&pointers);
        let is_due = self.sent.is_none_or(|it| io.now() - it >= self.period);
        let is_news = cursors != self.said || self.sent.is_none_or(|it| io.now() - it >= SAID_AGAIN);
        if !is_news {
            self.waits = false;
            return Ok(());
        }
        self.n_superseded += u64::from(self.waits);
        self.waits = !is_due;
        if is_due {
            self.send(io.now(), cursors);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        // Nobody is left behind held down.
        if !self.said.is_empty() {
            self.send(self.sent.unwrap_or(Time::ZERO), Vec::new());
        }
        report.figure("tuio.frames", self.n_frames as f64);
        report.figure("tuio.cursors", f64::from(self.next_session));
        report.figure("tuio.superseded", self.n_superseded as f64);
        report.figure("tuio.failed", self.clients.iter().map(|it| it.n_failed).sum::<u64>() as f64);
        report.figure("tuio.left_out", self.n_left_out as f64);
        for client in &self.clients {
            if let Some(why) = client.fault.as_ref().filter(|_| client.n_failed > 0) {
                let (n, name) = (client.n_failed, &client.name);
                report.remark(format!("{n} datagrams to the TUIO client `{name}` were not sent: {why}"));
            }
            if client.has_no_listener {
                report.remark(format!(
                    "no program listened at `{}` at the end of the run: is the TUIO client up, and is that its port?",
                    client.name
                ));
            }
        }
        Ok(())
    }
}

impl Tuio {
    /// The pointers that are held down, each with its session.
    fn cursors(&mut self, pointers: &Pointers) -> Vec<Cursor> {
        let held: Vec<&Pointer> = pointers.list.iter().filter(|it| it.is_pressed).collect();
        self.n_left_out += held.len().saturating_sub(MOST_CURSORS) as u64;
        self.sessions.retain(|id, _| held.iter().any(|it| it.id == *id));
        held.into_iter().take(MOST_CURSORS).map(|it| self.cursor(pointers.time, it)).collect()
    }

    fn cursor(&mut self, time: Time, pointer: &Pointer) -> Cursor {
        let velocity: Vector2<f64> = pointer.velocity.component_div(&self.wall.size);
        let speed = velocity.norm();
        let next = &mut self.next_session;
        let session = self.sessions.entry(pointer.id).or_insert_with(|| {
            *next = next.wrapping_add(1);
            Session { number: *next, speed, time, acceleration: 0.0 }
        });
        let dt = (time - session.time).as_s();
        if dt > 0.0 {
            *session = Session { speed, time, acceleration: (speed - session.speed) / dt, ..*session };
        }
        let place = self.wall.part(&pointer.predicted);
        Cursor {
            session: session.number,
            user: pointer.user,
            // Beyond the wall's edge there is nothing to point at.
            place: [place.x, place.y].map(|it| it.clamp(0.0, 1.0) as f32),
            velocity: [velocity.x as f32, velocity.y as f32],
            acceleration: session.acceleration as f32,
        }
    }

    fn send(&mut self, now: Time, cursors: Vec<Cursor>) {
        self.frame = self.frame.wrapping_add(1).max(1);
        let mut all = datagrams(Profile::Cursors, &self.source, self.frame, &cursors);
        if self.objects {
            let known: Vec<Cursor> = cursors.iter().filter(|it| it.user.is_some()).copied().collect();
            all.extend(datagrams(Profile::Objects, &self.source, self.frame, &known));
        }
        for datagram in all {
            for client in &mut self.clients {
                client.send(&datagram);
            }
        }
        self.n_frames += 1;
        (self.said, self.sent) = (cursors, Some(now));
    }
}

impl Client {
    fn send(&mut self, datagram: &[u8]) {
        let mut sent = self.socket.send(datagram);
        // What is said is of a datagram before: its port is closed. This one has not left yet.
        self.has_no_listener = sent.as_ref().is_err_and(|it| it.kind() == ErrorKind::ConnectionRefused);
        if self.has_no_listener {
            sent = self.socket.send(datagram);
        }
        let why = match sent {
            Ok(n) if n == datagram.len() => return,
            Ok(n) => format!("{n} of {} bytes were taken", datagram.len()),
            Err(error) if error.kind() == ErrorKind::WouldBlock => "the system's queue was full".to_owned(),
            Err(error) => error.to_string(),
        };
        self.n_failed += 1;
        self.fault.get_or_insert(why);
    }
}

fn address_of(name: &str) -> Result<SocketAddr, String> {
    let found = name.to_socket_addrs().map_err(|error| error.to_string())?;
    let found: Vec<SocketAddr> = found.collect();
    let first = found.iter().find(|it| it.is_ipv4()).or(found.first()).copied();
    first.ok_or_else(|| "the name has no address".to_owned())
}

/// A socket for `address`, and the reason where it is unreachable: the other clients are still served.
fn socket_to(address: &SocketAddr) -> std::io::Result<(UdpSocket, Option<String>)> {
    let socket = UdpSocket::bind(if address.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" })?;
    socket.set_nonblocking(true)?;
    // Connected, it is told when nobody listens there.
    let unreached = socket.connect(address).err().map(|error| error.to_string());
    Ok((socket, unreached))
}

#[cfg(test)]
mod tests;
