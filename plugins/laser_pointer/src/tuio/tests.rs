//! What `tuio` promises, tried.

use std::net::UdpSocket;
use std::time::Duration;

use foveate_testkit::check_node;
use nalgebra::Point2;
use rosc::{OscMessage, OscPacket, OscType, decoder};

use super::*;

/// A wall of 4 m by 2 m whose top left corner is at (1, −1).
fn setup() -> Setup {
    Setup { volume_m: Some([[1.0, -1.0, -0.1], [5.0, 1.0, 0.1]]), ..Setup::for_tests() }
}

/// What a client knows.
#[derive(Debug, Clone, PartialEq, Default)]
struct Known {
    source: String,
    alive: Vec<i32>,
    /// Session, then x, y, X, Y, m.
    set: Vec<(i32, [f32; 5])>,
    frame: i32,
    /// Of the profile for objects.
    is_of_objects: bool,
    /// Classes of objects.
    classes: Vec<i32>,
}

/// A client, which decodes by the crate's decoder.
struct Client {
    socket: UdpSocket,
}

impl Client {
    fn new() -> Client {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(200))).unwrap();
        Client { socket }
    }

    fn address(&self) -> String {
        self.socket.local_addr().unwrap().to_string()
    }

    /// All datagrams that are there.
    fn take(&self) -> Vec<Known> {
        let mut buffer = [0; 2048];
        let mut all = Vec::new();
        while let Ok(n) = self.socket.recv(&mut buffer) {
            let (rest, packet) = decoder::decode_udp(&buffer[..n]).unwrap();
            assert!(rest.is_empty());
            let OscPacket::Bundle(bundle) = packet else { panic!("found {packet:?}, expected a bundle") };
            let mut known = Known::default();
            for packet in bundle.content {
                let OscPacket::Message(OscMessage { addr, args }) = packet else { panic!("a bundle within") };
                if addr == "/tuio/2Dobj" {
                    known.is_of_objects = true;
                }
                let number = |it: &OscType| it.clone().int().unwrap();
                match args[0].clone().string().unwrap().as_str() {
                    "source" => known.source = args[1].clone().string().unwrap(),
                    "alive" => known.alive = args[1..].iter().map(number).collect(),
                    "set" if known.is_of_objects => known.classes.push(number(&args[2])),
                    "set" => {
                        let mut values = [0.0; 5];
                        values.iter_mut().zip(&args[2..]).for_each(|(to, from)| *to = from.clone().float().unwrap());
                        known.set.push((number(&args[1]), values));
                    }
                    "fseq" => known.frame = number(&args[1]),
                    other => panic!("found `{other}`"),
                }
            }
            all.push(known);
        }
        all
    }
}

fn pointer(id: u32, x: f64, y: f64) -> Pointer {
    Pointer {
        id: TargetId(id),
        user: None,
        position: Point2::new(0.0, 0.0),
        velocity: Vector2::new(0.4, 0.3),
        predicted: Point2::new(x, y),
        sigma: 0.001,
        is_pressed: true,
        is_resting: false,
        is_seen: true,
    }
}

fn feed(bench: &mut NodeBench<Tuio>, ms: f64, list: Vec<Pointer>) {
    let time = Time::ZERO + Interval::from_ms(ms);
    bench
        .feed(&POINTERS, time, Pointers { time, shown_at: time, list, exchanged: Vec::new(), events: Vec::new() })
        .unwrap();
}

fn node(settings: TuioSettings) -> NodeBench<Tuio> {
    NodeBench::with_setup(settings, &setup()).unwrap()
}

#[test]
fn node_keeps_the_law() {
    check_node::<Tuio>("");
    let refused = NodeBench::<Tuio>::new(TuioSettings::default()).map(|_| ()).unwrap_err().to_string();
    assert!(refused.contains("without a working volume"), "{refused}");
}

#[test]
fn a_client_sees_cursors_come_move_and_go() {
    let client = Client::new();
    let mut bench = node(TuioSettings { to: vec![client.address()], source: "wall@lab".into(), ..Default::default() });
    // The middle of the wall; a pointer that is not held down is no cursor.
    let hovering = Pointer { is_pressed: false, ..pointer(5, 2.0, 0.0) };
    feed(&mut bench, 0.0, vec![pointer(3, 3.0, 0.0), hovering.clone()]);
    feed(
        &mut bench,
        20.0,
        vec![Pointer { velocity: Vector2::new(0.8, 0.6), ..pointer(3, 4.0, 0.5) }, hovering.clone()],
    );
    feed(&mut bench, 40.0, vec![pointer(3, 9.0, 0.5), pointer(4, 1.0, -1.0)]);
    feed(&mut bench, 60.0, vec![hovering]);
    feed(&mut bench, 80.0, vec![pointer(3, 3.0, 0.0)]);
    let known = client.take();
    // (0.4, 0.3) m/s are (0.1, 0.15) of the wall a second.
    assert_eq!(known[0].source, "wall@lab");
    assert_eq!((&known[0].alive, &known[0].set), (&vec![1], &vec![(1, [0.5, 0.5, 0.1, 0.15, 0.0])]));
    let (_, [x, y, u, v, m]) = known[1].set[0];
    assert_eq!([x, y, u, v], [0.75, 0.75, 0.2, 0.3]);
    assert!((m - (0.13_f32.sqrt() - 0.0325_f32.sqrt()) / 0.02).abs() < 1e-3, "{m}");
    assert_eq!(known[2].alive, [1, 2]);
    assert_eq!(known[2].set[0].1[..2], [1.0, 0.75], "beyond the edge it is at the edge");
    assert_eq!(known[2].set[1].1[..2], [0.0, 0.0], "the top left corner");
    assert_eq!((known[3].alive.len(), known[3].set.len()), (0, 0));
    assert_eq!(known[4].alive, [3], "each press is a session of its own");
    assert_eq!(known.iter().map(|it| it.frame).collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
    let report = bench.finish().unwrap();
    assert_eq!(client.take().last().map(|it| it.alive.len()), Some(0), "at the end nobody is held down");
    assert_eq!((report.figures["tuio.frames"], report.figures["tuio.cursors"]), (6.0, 3.0));
}

#[test]
fn more_than_the_rate_never_leaves_and_what_leaves_is_the_newest() {
    let client = Client::new();
    let mut bench = node(TuioSettings { to: vec![client.address()], rate_hz: 50.0, ..Default::default() });
    // 1000 states in a second.
    for ms in 0..1000 {
        feed(&mut bench, f64::from(ms), vec![pointer(1, 1.0 + 0.001 * f64::from(ms), 0.0)]);
    }
    let known = client.take();
    assert_eq!(known.len(), 50);
    for (n, it) in known.iter().enumerate() {
        let expected = 0.001 * (20 * n) as f32 / 4.0;
        assert!((it.set[0].1[0] - expected).abs() < 1e-6, "frame {n} is not the newest: {it:?}");
    }
    let figures = bench.finish().unwrap().figures;
    // Of nineteen that waited before each frame, the first eighteen gave way, and the last to the frame's own.
    assert!((930.0..=950.0).contains(&figures["tuio.superseded"]), "{figures:?}");
}

#[test]
fn a_client_that_does_not_read_holds_nothing_up_and_one_that_cannot_be_reached_is_named() {
    let (reading, stalled) = (Client::new(), Client::new());
    let to = vec![stalled.address(), "255.255.255.255:9".to_owned(), reading.address()];
    let mut bench = node(TuioSettings { to, rate_hz: 1000.0, ..Default::default() });
    let begun = std::time::Instant::now();
    let mut n_taken = 0;
    for ms in 0..20_000 {
        feed(&mut bench, f64::from(ms), vec![pointer(1, 1.0 + 1e-4 * f64::from(ms), 0.0)]);
        if ms % 50 == 49 {
            reading.socket.set_nonblocking(true).unwrap();
            n_taken += reading.take().len();
        }
    }
    assert!(begun.elapsed() < Duration::from_secs(20), "nothing waits");
    assert_eq!(n_taken, 20_000, "who reads has all");
    let report = bench.finish().unwrap();
    assert!(report.figures["tuio.failed"] >= 20_000.0, "broadcast is refused by the system");
    assert!(report.remarks.iter().any(|it| it.contains("255.255.255.255:9")), "{:?}", report.remarks);
    assert!(!stalled.take().is_empty());
}

#[test]
fn without_news_the_state_is_said_again_each_second() {
    let client = Client::new();
    let mut bench = node(TuioSettings { to: vec![client.address()], ..Default::default() });
    for frame in 0..250 {
        feed(&mut bench, 10.0 * f64::from(frame), Vec::new());
    }
    assert_eq!(client.take().len(), 3);
}

#[test]
fn what_cannot_be_is_refused() {
    let refused = |settings: TuioSettings| NodeBench::<Tuio>::with_setup(settings, &setup()).map(|_| ()).unwrap_err();
    let why = refused(TuioSettings { to: vec!["127.0.0.1".to_owned()], ..Default::default() });
    assert_eq!(why.setting.as_deref(), Some("to[0]"));
    assert!(why.message.contains("`127.0.0.1`, expected HOST:PORT"), "{why}");
    let why = refused(TuioSettings { source: "a b".to_owned(), ..Default::default() });
    assert!(why.message.contains("`a b`"), "{why}");
    let flat = Setup { volume_m: Some([[0.0; 3], [1.0, 0.0, 1.0]]), ..Setup::for_tests() };
    let why = NodeBench::<Tuio>::with_setup(TuioSettings::default(), &flat).map(|_| ()).unwrap_err();
    assert!(why.message.contains("a wall of 1 m by 0 m"), "{why}");
}

#[test]
fn pointers_with_a_user_are_objects_of_that_class_too_where_that_is_asked_for() {
    for objects in [false, true] {
        let client = Client::new();
        let mut bench = node(TuioSettings { to: vec![client.address()], objects, ..Default::default() });
        let known = Pointer { user: Some(3), ..pointer(4, 2.0, 0.0) };
        feed(&mut bench, 0.0, vec![pointer(2, 3.0, 0.0), known]);
        let all = client.take();
        assert_eq!((all.len(), &all[0].alive), (1 + usize::from(objects), &vec![1, 2]), "all are cursors");
        if objects {
            assert_eq!((&all[1].alive, &all[1].classes), (&vec![2], &vec![3]), "the session of the cursor");
            assert!(all[1].is_of_objects && !all[0].is_of_objects);
        }
    }
}

#[test]
fn a_port_where_no_program_listens_is_told_and_one_where_one_does_is_not() {
    let client = Client::new();
    // A port that was free a moment ago.
    let closed = Client::new().address();
    let settings = TuioSettings { to: vec![client.address(), closed.clone()], ..TuioSettings::default() };
    let mut bench = node(settings);
    for step in 0..20 {
        feed(&mut bench, f64::from(step) * 20.0, vec![pointer(1, 3.0 + 0.01 * f64::from(step), 0.0)]);
    }
    let report = bench.finish().unwrap();
    assert_eq!((client.take().len(), report.figures["tuio.failed"]), (21, 0.0));
    assert_eq!(report.remarks.len(), 1, "{:?}", report.remarks);
    assert!(report.remarks[0].contains(&format!("no program listened at `{closed}`")), "{:?}", report.remarks);
    let none = NodeBench::<Tuio>::with_setup(TuioSettings { to: Vec::new(), ..TuioSettings::default() }, &setup());
    assert!(none.map(|_| ()).unwrap_err().message.contains("found no address"));
}
