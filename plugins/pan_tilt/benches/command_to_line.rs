//! How long it takes from a command to bytes on the line: in memory, on a pseudo terminal and on UDP.
//!
//! `cargo bench -p foveate-pan-tilt --bench command_to_line` prints, of 5,000 commands each, the median, the 99th percentile and the longest
//! time. *Written* is until the call that gives the command has returned, the bytes being with the system; *read* is until another thread, which
//! plays the head, holds them in its hands: that is two changes of thread more than a serial adapter needs.

use std::hint::black_box;
use std::io::{self, Read, Write};
use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use foveate::prelude::{Interval, Time};
use foveate_pan_tilt::driver::{Driver, DriverSettings, Link, Medium};
use foveate_pan_tilt::head::Head;
use foveate_pan_tilt::port::Port;
use foveate_pan_tilt::visca::{Command, Profile, Speed};

const COMMANDS: usize = 5000;
/// Between two commands: threads have gone to sleep by then, as they have at 30 Hz.
const PAUSE: Duration = Duration::from_millis(2);

fn main() {
    println!("command to line             p50       p99   longest");
    in_memory();
    #[cfg(all(unix, feature = "hardware"))]
    on_terminal();
    on_udp();
}

fn row(name: &str, mut times: Vec<Duration>) {
    times.sort_unstable();
    let micros = |place: usize| times[place.min(times.len() - 1)].as_secs_f64() * 1e6;
    let (p50, p99, longest) = (micros(times.len() / 2), micros(times.len() * 99 / 100), micros(times.len()));
    println!("{name:<20} {p50:>8.2}  {p99:>8.2}  {longest:>8.2} µs");
}

fn command(index: usize) -> Command {
    Command::Absolute { pan: (index % 800) as i32, tilt: -((index % 250) as i32), speed: Speed { pan: 24, tilt: 20 } }
}

/// A driver that asks nothing by itself.
fn driver(medium: Medium) -> Driver {
    let settings = DriverSettings { position_every_ms: 0.0, ..DriverSettings::default() };
    let driver = Driver::new(settings, Profile::evi_d30(), medium);
    driver.unwrap_or_else(|fault| panic!("{fault}"))
}

/// What a head answers that does everything at once.
fn answer(packet: &[u8]) -> &'static [u8] {
    match packet {
        [0x88, 0x30, ..] => &[0x88, 0x30, 0x02, 0xFF],
        [_, 0x01, 0x00, 0x01, 0xFF] => &[0x90, 0x50, 0xFF],
        [_, 0x09, ..] => &[0x90, 0x50, 0x00, 0x20, 0x04, 0x02, 0x01, 0x21, 0x02, 0xFF],
        _ => &[0x90, 0x41, 0xFF, 0x90, 0x51, 0xFF],
    }
}

fn in_memory() {
    let mut driver = driver(Medium::Serial);
    let mut now = Time::ZERO;
    driver.opened(now);
    for _ in 0..3 {
        now = now + Interval::from_ms(1.0);
        let frame = driver.poll(now).unwrap_or_else(|| panic!("the greeting has three messages"));
        driver.receive(now, answer(&frame.0));
    }
    let mut times = Vec::with_capacity(COMMANDS);
    for index in 0..COMMANDS {
        now = now + Interval::from_ms(33.0);
        let start = Instant::now();
        let given = driver.command(now, command(index));
        let frame = black_box(driver.poll(now));
        times.push(start.elapsed());
        let (Ok(_), Some(frame)) = (given, frame) else { panic!("an idle head takes every command") };
        driver.receive(now, answer(&frame.0));
        while driver.next_event().is_some() {}
    }
    row("in memory", times);
}

/// Gives commands one by one; `arrivals` are the moments at which the other side has read them.
fn measure(name: &str, port: Port, arrivals: &std::sync::mpsc::Receiver<Instant>) {
    let began = Instant::now();
    let clock = Arc::new(move || Time(began.elapsed().as_nanos() as i64));
    let head = Head::start(driver(port.medium()), port, clock);
    while head.link() != Link::Ready {
        thread::sleep(PAUSE);
    }
    while arrivals.try_recv().is_ok() {}
    let (mut written, mut read) = (Vec::with_capacity(COMMANDS), Vec::with_capacity(COMMANDS));
    for index in 0..COMMANDS {
        thread::sleep(PAUSE);
        while !head.is_idle() {
            thread::yield_now();
        }
        let start = Instant::now();
        if let Err(error) = head.command(command(index)) {
            panic!("{error}");
        }
        written.push(start.elapsed());
        let arrived = arrivals.recv().unwrap_or_else(|_| panic!("the other side is gone"));
        read.push(arrived.saturating_duration_since(start));
        head.events();
    }
    row(&format!("{name}, written"), written);
    row(&format!("{name}, read"), read);
}

/// Plays a head on a stream: answers packets, tells when each was read, until the line is gone.
#[cfg(all(unix, feature = "hardware"))]
fn play(mut line: impl Read + Write, arrivals: &Sender<Instant>) -> io::Result<()> {
    let (mut packet, mut buffer) = (Vec::new(), [0; 64]);
    loop {
        let length = line.read(&mut buffer)?;
        let now = Instant::now();
        for &byte in &buffer[..length] {
            packet.push(byte);
            if byte == 0xFF {
                line.write_all(answer(&packet))?;
                if arrivals.send(now).is_err() {
                    return Ok(());
                }
                packet.clear();
            }
        }
    }
}

#[cfg(all(unix, feature = "hardware"))]
fn on_terminal() {
    use nix::pty::openpty;
    use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};

    let opened = openpty(None, None).and_then(|pair| {
        let mut mode = tcgetattr(&pair.slave)?;
        cfmakeraw(&mut mode);
        tcsetattr(&pair.slave, SetArg::TCSANOW, &mode)?;
        let path = nix::unistd::ttyname(&pair.slave)?;
        Ok((pair, path))
    });
    let (pair, path) = match opened {
        Ok(it) => it,
        Err(error) => return println!("no pseudo terminal: {error}"),
    };
    let (sender, arrivals) = channel();
    // Ends with the process: the read waits for ever.
    thread::spawn(move || play(std::fs::File::from(pair.master), &sender));
    measure("terminal", Port::Serial { path, baud: 9600 }, &arrivals);
}

fn on_udp() {
    let (sender, arrivals) = channel();
    let bound = UdpSocket::bind("127.0.0.1:0").and_then(|socket| Ok((socket.local_addr()?, socket)));
    let (address, socket) = match bound {
        Ok(it) => it,
        Err(error) => return println!("no UDP: {error}"),
    };
    thread::spawn(move || play_datagrams(&socket, &sender));
    measure("UDP", Port::Udp { host: address.ip().to_string(), number: address.port() }, &arrivals);
}

/// As `play`, in datagrams with their header of eight bytes, each packet in one of its own.
fn play_datagrams(socket: &UdpSocket, arrivals: &Sender<Instant>) -> io::Result<()> {
    let mut buffer = [0; 64];
    loop {
        let (length, from) = socket.recv_from(&mut buffer)?;
        let now = Instant::now();
        let (header, payload) = buffer[..length].split_at(length.min(8));
        let reply = |kind: [u8; 2], packet: &[u8]| {
            let datagram = [&kind[..], &[0, packet.len() as u8], &header[4..], packet].concat();
            socket.send_to(&datagram, from)
        };
        if header[0] == 0x02 {
            reply([0x02, 0x01], payload)?;
        } else {
            for packet in answer(payload).split_inclusive(|it| *it == 0xFF) {
                reply([0x01, 0x11], packet)?;
            }
        }
        if arrivals.send(now).is_err() {
            return Ok(());
        }
    }
}
