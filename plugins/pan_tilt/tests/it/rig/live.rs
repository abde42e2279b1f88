//! Live: the same node on a pseudo terminal and on UDP, in real time. Nothing here depends on how long things take.

use std::net::UdpSocket;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

use foveate::prelude::*;
use foveate_embed::engine::{self, Options, Outcome};
use foveate_pan_tilt::line_traffic::Direction;
use foveate_sim::head::serve::serve_udp;
use foveate_sim::head::{HeadSettings, NetworkHead};

use super::parts::{Heard, load, rig_text};

/// A machine under load may take its time; without a fault it is over much sooner [s].
const PATIENCE_S: f64 = 60.0;

/// Runs live until `is_enough`, and fails if that never comes.
#[track_caller]
fn run_live(port: &str, orders: &str, mut is_enough: impl FnMut(&Heard) -> bool) -> (Outcome, Arc<Mutex<Heard>>) {
    let listener = r#"
        [scale.room.node.listener]
        type = "test.listener"
        camera = "wide-3"
        in = { reports = "head.report", traffic = "head.line_traffic" }
    "#;
    let head = format!("in = {{ commands = \"orders.commands\" }}\nport = \"{port}\"\nretry_max_ms = 300");
    let (graph, heard) = load(&rig_text(PATIENCE_S, orders, &head, listener)).unwrap();
    assert!(graph.instances.iter().any(|it| it.is_live()));
    let options = Options::default();
    let stop = Arc::clone(&options.stop);
    let outcome = engine::live(Arc::new(graph), &options, &mut |_| {
        if is_enough(&heard.lock().unwrap()) {
            stop.store(true, Ordering::Relaxed);
        }
    })
    .unwrap();
    let last: Vec<_> = heard.lock().unwrap().events.iter().rev().take(5).copied().collect();
    assert!(outcome.interrupted, "it never came; the last events are {last:?}");
    assert!(outcome.faults.is_empty(), "{:?}", outcome.faults);
    (outcome, heard)
}

fn stands_at(event: &HeadEvent, pan_deg: f64) -> bool {
    matches!(event, HeadEvent::Position(it) if (it.angles[0].to_degrees() - pan_deg).abs() < 0.1)
}

/// Ends what runs beside a test, also when the test fails.
struct Ends<'a>(&'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[test]
fn a_head_on_udp_is_driven() {
    let stop = AtomicBool::new(false);
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let port = format!("udp://{}", socket.local_addr().unwrap());
    thread::scope(|scope| {
        let _ends = Ends(&stop);
        scope.spawn(|| {
            let mut head = NetworkHead::new(&HeadSettings::default(), 1).unwrap();
            serve_udp(&mut head, &socket, &stop).unwrap();
        });
        let (outcome, heard) = run_live(&port, "go = [[0.3, 12, 0, 80]]", |heard| {
            heard.events.iter().any(|it| stands_at(&it.1, 12.0))
                && heard.events.iter().any(|it| it.1 == HeadEvent::Arrived)
        });
        let heard = heard.lock().unwrap();
        assert_eq!(heard.events[0].1, HeadEvent::Link(HeadLink::Ready));
        // Times are the session's: nothing was sent before it was commanded, and answers lie in order.
        let sent = heard.events.iter().find(|it| matches!(it.1, HeadEvent::Sent(_))).unwrap().0;
        assert!(sent >= Time::from_s(0.3) && sent <= outcome.ended, "{sent}");
        assert!(heard.events.windows(2).all(|it| it[0].0 <= it[1].0));
        let ages = heard.reports.iter().flat_map(|(at, report)| report.events.last().map(|it| *at - it.0));
        assert!(ages.clone().all(|it| it >= Interval(0)), "{:?}", ages.min());
        assert_eq!(outcome.report.figures["heads.wide-3.sent"], 1.0);
        // The command as bytes: 12° are 106 units to the right.
        let pieces: Vec<_> = heard.traffic.iter().flat_map(|it| &it.1.pieces).collect();
        let command = [0x81, 1, 6, 2, 24, 20, 0, 0, 6, 0xA, 0, 0, 0, 0, 0xFF];
        let command = pieces.iter().find(|it| it.direction == Direction::Sent && it.bytes.ends_with(&command)).unwrap();
        assert_eq!(command.time, sent);
        let acknowledged = pieces.iter().find(|it| it.bytes.ends_with(&[0x90, 0x41, 0xFF])).unwrap();
        assert!(acknowledged.direction == Direction::Received && acknowledged.time >= sent, "{acknowledged:?}");
    });
}

#[cfg(all(unix, feature = "hardware"))]
mod serial {
    use std::os::unix::fs::symlink;
    use std::path::Path;

    use foveate_sim::head::serve::Terminal;
    use foveate_sim::head::{LineSettings, SerialHead};

    use super::*;

    fn new_head() -> SerialHead {
        SerialHead::new(&HeadSettings::default(), &LineSettings::default(), 1).unwrap()
    }

    /// Puts a terminal under a lasting name, as the system does with adapters that are plugged in.
    fn plug(name: &Path) -> Terminal {
        let terminal = Terminal::new().unwrap();
        // The old one is gone, or there was none.
        let _ = std::fs::remove_file(name);
        symlink(terminal.path(), name).unwrap();
        terminal
    }

    #[test]
    fn a_serial_port_that_is_pulled_out_and_put_back_goes_on_where_it_was_told() {
        let folder = tempfile::tempdir().unwrap();
        let name = folder.path().join("head");
        let (stop_first, stop) = (AtomicBool::new(false), AtomicBool::new(false));
        thread::scope(|scope| {
            let _ends = (Ends(&stop_first), Ends(&stop));
            let first = plug(&name);
            scope.spawn(|| {
                let mut terminal = first;
                terminal.serve(&mut new_head(), &stop_first).unwrap();
                // With the terminal dropped its other end hangs up.
            });
            let mut phase = 0;
            let (outcome, _) = run_live(&name.display().to_string(), "go = [[0.3, 10, 0, 80]]", |heard| {
                let links = heard.events.iter().filter(|it| matches!(it.1, HeadEvent::Link(_))).count();
                match phase {
                    0 if heard.events.iter().any(|it| stands_at(&it.1, 10.0)) => {
                        std::fs::remove_file(&name).unwrap();
                        stop_first.store(true, Ordering::Relaxed);
                        phase = 1;
                    }
                    1 if links == 2 => {
                        let second = plug(&name);
                        scope.spawn(|| {
                            let mut terminal = second;
                            terminal.serve(&mut new_head(), &stop).unwrap();
                        });
                        phase = 2;
                    }
                    // Another head, which looked straight ahead, is where the first one was.
                    2 => {
                        let back =
                            heard.events.iter().rposition(|it| it.1 == HeadEvent::Link(HeadLink::Ready)).unwrap();
                        return links == 3 && heard.events[back..].iter().any(|it| stands_at(&it.1, 10.0));
                    }
                    _ => {}
                }
                false
            });
            assert!(outcome.gaps.iter().any(|it| it.reason.contains("wide-3")), "{:?}", outcome.gaps);
            assert_eq!(outcome.report.figures["heads.wide-3.lost"], 1.0);
        });
    }

    #[test]
    fn a_head_that_turns_is_stopped_when_the_run_ends() {
        let folder = tempfile::tempdir().unwrap();
        let name = folder.path().join("head");
        let stop = AtomicBool::new(false);
        let mut head = new_head();
        thread::scope(|scope| {
            let _ends = Ends(&stop);
            let plugged = plug(&name);
            scope.spawn(|| {
                let mut terminal = plugged;
                terminal.serve(&mut head, &stop).unwrap();
            });
            let turns = |it: &(Time, HeadEvent)| matches!(it.1, HeadEvent::Position(it) if it.angles[0] > 0.02);
            run_live(&name.display().to_string(), "turn = [[0.3, 5, 0]]", |heard| heard.events.iter().any(turns));
            // Its own latency, and time to brake.
            thread::sleep(std::time::Duration::from_millis(800));
        });
        assert!(head.head().is_at_rest(), "{}", head.head().pan().motor_units());
    }

    #[test]
    fn a_port_that_is_not_there_is_said_and_the_rig_goes_on() {
        let mut n_looks = 0;
        let (outcome, heard) = run_live("/dev/there-is-no-such-port", "go = [[0.1, 12, 0, 80]]", |_| {
            n_looks += 1;
            n_looks > 8
        });
        assert!(heard.lock().unwrap().events.is_empty());
        assert!(outcome.gaps.iter().any(|it| it.reason.contains("there-is-no-such-port")), "{:?}", outcome.gaps);
        assert!(outcome.report.remarks.iter().any(|it| it.contains("there-is-no-such-port")));
        assert!(outcome.report.figures["heads.wide-3.away_s"] > 0.1);
    }
}
