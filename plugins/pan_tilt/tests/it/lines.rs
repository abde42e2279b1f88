//! The driver on real lines, in real time: a pseudo terminal and UDP on this host. Nothing here depends on how long things take.

use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use foveate::estimation::random::Random;
use foveate::prelude::Time;
use foveate_pan_tilt::driver::{Driver, DriverSettings, Link, What};
use foveate_pan_tilt::head::{Clock, Head};
use foveate_pan_tilt::port::Port;
use foveate_pan_tilt::visca::{Answer, Command, Profile, Speed};
use foveate_sim::head::serve;
use foveate_sim::head::{HeadSettings, NetworkHead};

/// A machine under load may take its time; without a fault it is over much sooner.
const PATIENCE: Duration = Duration::from_secs(60);

/// Ends what runs beside a test, also when the test fails.
struct Ends<'a>(&'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

fn clock() -> Clock {
    let start = Instant::now();
    Arc::new(move || Time(start.elapsed().as_nanos() as i64))
}

fn start(port: Port) -> Head {
    let driver = Driver::new(DriverSettings::default(), Profile::evi_d30(), port.medium()).unwrap();
    Head::start(driver, port, clock())
}

#[track_caller]
fn wait_for(what: &str, mut is_so: impl FnMut() -> bool) {
    let end = Instant::now() + PATIENCE;
    while !is_so() {
        assert!(Instant::now() < end, "{what} did not happen");
        thread::sleep(Duration::from_millis(5));
    }
}

/// Waits until the head says that it looks there.
#[track_caller]
fn reaches(head: &Head, pan: i32, tilt: i32) {
    let there = Answer::Position { pan, tilt };
    wait_for("the last command", || {
        head.events().iter().any(|it| matches!(it.what, What::Answered { answer, .. } if answer == there))
    });
}

fn go(head: &Head, pan: i32, tilt: i32) {
    head.command(Command::Absolute { pan, tilt, speed: Speed { pan: 24, tilt: 20 } }).unwrap();
}

#[cfg(all(unix, feature = "hardware"))]
#[test]
fn a_pseudo_terminal_is_a_line_like_any_other() {
    use foveate_sim::head::serve::Terminal;
    use foveate_sim::head::{LineSettings, SerialHead};

    let stop = AtomicBool::new(false);
    let mut terminal = Terminal::new().unwrap();
    let port = Port::Serial { path: terminal.path().to_owned(), baud: 9600 };
    thread::scope(|scope| {
        let _ends = Ends(&stop);
        scope.spawn(|| {
            let mut head = SerialHead::new(&HeadSettings::default(), &LineSettings::default(), 1).unwrap();
            terminal.serve(&mut head, &stop).unwrap();
        });
        let head = start(port);
        wait_for("the greeting", || head.link() == Link::Ready);
        for step in 1..=5 {
            go(&head, 20 * step, -step);
        }
        reaches(&head, 100, -5);
        wait_for("the last completion", || head.is_idle());
    });
}

#[test]
fn a_port_that_is_not_there_is_reported_and_tried_again() {
    let head = start(Port::Serial { path: "/dev/there-is-no-such-port".into(), baud: 9600 });
    wait_for("the report", || matches!(head.link(), Link::Closed(why) if why.contains("there-is-no-such-port")));
    let reports = |head: &Head| head.events().iter().filter(|it| matches!(it.what, What::Link(_))).count();
    assert!(reports(&head) >= 1);
    go(&head, 10, 0);
    assert!(!head.is_idle());
}

/// A head on UDP behind a network that loses, and lets datagrams overtake each other, until `stop`.
fn lossy_head(front: &UdpSocket, stop: &AtomicBool) {
    let inner = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = inner.local_addr().unwrap();
    let back = UdpSocket::bind("127.0.0.1:0").unwrap();
    for socket in [front, &back] {
        socket.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
    }
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut head = NetworkHead::new(&HeadSettings::default(), 1).unwrap();
            serve::serve_udp(&mut head, &inner, stop).unwrap();
        });
        let mut random = Random::new(5);
        let mut controller = None;
        let mut held: Vec<(bool, Vec<u8>)> = Vec::new();
        let mut buffer = [0; 64];
        while !stop.load(Ordering::Relaxed) {
            if let Ok((length, from)) = front.recv_from(&mut buffer) {
                controller = Some(from);
                held.push((true, buffer[..length].to_vec()));
            }
            if let Ok((length, _)) = back.recv_from(&mut buffer) {
                held.push((false, buffer[..length].to_vec()));
            }
            // One of those that are held goes on, or one is lost, or all wait.
            if held.is_empty() || random.uniform() < 0.3 {
                continue;
            }
            let (is_request, datagram) = held.swap_remove(random.below(held.len() as u32) as usize);
            if random.uniform() < 0.15 {
                continue;
            }
            if is_request {
                back.send_to(&datagram, address).unwrap();
            } else if let Some(controller) = controller {
                front.send_to(&datagram, controller).unwrap();
            }
        }
    });
}

#[test]
fn udp_with_loss_and_overtaking_gets_there() {
    let stop = AtomicBool::new(false);
    let front = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = front.local_addr().unwrap();
    let port = Port::Udp { host: address.ip().to_string(), number: address.port() };
    thread::scope(|scope| {
        let _ends = Ends(&stop);
        scope.spawn(|| lossy_head(&front, &stop));
        let head = start(port);
        wait_for("the greeting", || head.link() == Link::Ready);
        for step in 1..=20 {
            go(&head, -5 * step, step);
            thread::sleep(Duration::from_millis(10));
        }
        reaches(&head, -100, 20);
    });
}
