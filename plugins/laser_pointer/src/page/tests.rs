//! What `page` promises, tried.

use std::collections::VecDeque;
use std::sync::Mutex;

use foveate::node::page::{Client, PageEvent, PageServer, Pages};
use foveate_testkit::check_node;
use nalgebra::{Point2, Vector2};
use serde_json::{Value, json};

use super::*;

/// What windows and the node have in common in these tests: no sockets.
#[derive(Default)]
struct Wire {
    now: i64,
    events: VecDeque<PageEvent>,
    sent: Vec<(Client, Value)>,
    greeting: Value,
    /// Windows that take nothing.
    full: Vec<Client>,
}

#[derive(Clone, Default)]
struct Fake(Arc<Mutex<Wire>>);

impl PageServer for Fake {
    fn open(&self, instance: &str, page: Page) -> Result<Box<dyn PageLink>, String> {
        assert_eq!(instance, "test.node");
        assert!((page.files)("x").is_none() && page.html.contains("/foveate.js"));
        assert!(!page.html.contains("http"), "nothing comes from elsewhere");
        Ok(Box::new(self.clone()))
    }
}

impl PageLink for Fake {
    fn address(&self) -> String {
        "http://127.0.0.1:1/test.node/".to_owned()
    }
    fn now(&self) -> i64 {
        self.0.lock().unwrap().now
    }
    fn take(&mut self) -> Option<PageEvent> {
        self.0.lock().unwrap().events.pop_front()
    }
    fn send(&mut self, client: Client, text: &str) -> bool {
        let mut wire = self.0.lock().unwrap();
        if wire.full.contains(&client) {
            return false;
        }
        wire.sent.push((client, serde_json::from_str(text).unwrap()));
        true
    }
    fn greet(&mut self, text: &str) {
        self.0.lock().unwrap().greeting = serde_json::from_str(text).unwrap();
    }
}

const A: Client = Client(1);
const B: Client = Client(2);

struct Room {
    bench: NodeBench<DrawingPage>,
    wire: Fake,
    frame: i64,
    /// By pointer: its user.
    users: std::collections::BTreeMap<u32, u32>,
    exchanged: Vec<Exchange>,
}

impl Room {
    fn new(settings: PageSettings) -> Room {
        let wire = Fake::default();
        let volume_m = Some([[1.0, -1.0, -0.1], [5.0, 1.0, 0.1]]);
        let setup = Setup { pages: Pages::served_by(Arc::new(wire.clone())), volume_m, ..Setup::for_tests() };
        Room {
            bench: NodeBench::with_setup(settings, &setup).unwrap(),
            wire,
            frame: 0,
            users: Default::default(),
            exchanged: Vec::new(),
        }
    }

    fn receive(&self, client: Client, what: PageNews) {
        let mut wire = self.wire.0.lock().unwrap();
        let arrival = wire.now;
        wire.events.push_back(PageEvent { client, arrival, what });
    }

    fn text(&self, client: Client, message: &Value) {
        self.receive(client, PageNews::Text(message.to_string()));
    }

    /// The next frame, 20 ms on: pointers at these x, held down; pressed in this frame and released in it.
    fn step(&mut self, held: &[(u32, f64)], pressed: &[(u32, f64)], released: &[(u32, f64)]) {
        self.frame += 1;
        let time = Time::ZERO + Interval::from_ms(20.0 * self.frame as f64);
        self.wire.0.lock().unwrap().now += 20_000_000;
        let users = self.users.clone();
        let event = |what: PointerChange| {
            let users = users.clone();
            move |&(id, x): &(u32, f64)| PointerEvent {
                id: TargetId(id),
                user: users.get(&id).copied(),
                what,
                time,
                latency: Interval::from_ms(4.0),
                position: Point2::new(x, 0.0),
                path: Vec::new(),
            }
        };
        let list = held.iter().map(|&(id, x)| Pointer {
            id: TargetId(id),
            user: self.users.get(&id).copied(),
            position: Point2::new(x, 0.0),
            velocity: Vector2::zeros(),
            predicted: Point2::new(x + 0.1, 0.0),
            sigma: 0.002,
            is_pressed: true,
            is_resting: false,
            is_seen: true,
        });
        let list = list.collect();
        let events = pressed.iter().map(event(PointerChange::Press));
        let events = events.chain(released.iter().map(event(PointerChange::Release))).collect();
        self.bench
            .feed(&POINTERS, time, Pointers { time, shown_at: time, list, exchanged: self.exchanged.clone(), events })
            .unwrap();
    }

    fn sent(&self) -> Vec<(Client, Value)> {
        std::mem::take(&mut self.wire.0.lock().unwrap().sent)
    }

    /// All ink that a window was sent.
    fn ink(messages: &[(Client, Value)], client: Client) -> Vec<Value> {
        let own = messages.iter().filter(|it| it.0 == client);
        own.flat_map(|it| it.1["ink"].as_array().cloned().unwrap_or_default()).collect()
    }
}

#[test]
fn node_keeps_the_law() {
    check_node::<DrawingPage>("");
}

#[test]
fn a_window_gets_the_state_and_only_the_ink_that_it_has_not() {
    let mut room = Room::new(PageSettings::default());
    assert_eq!(room.wire.0.lock().unwrap().greeting, json!({ "wall": { "width": 4.0, "height": 2.0 } }));
    room.receive(A, PageNews::Opened);
    room.step(&[(3, 2.0)], &[(3, 2.0)], &[]);
    room.step(&[(3, 2.0001)], &[], &[]);
    room.step(&[(3, 2.5)], &[], &[]);
    let sent = room.sent();
    assert_eq!(sent.len(), 3);
    let first = &sent[0].1;
    assert_eq!(
        first["pointers"][0],
        json!({ "id": 3, "x": 1.1, "y": 1.0, "pressed": true, "resting": false, "sigma_mm": 2.0 })
    );
    assert_eq!((&first["seq"], &first["time"], &first["sent"]), (&json!(1), &json!(0.02), &json!(20.0)));
    assert_eq!(
        first["events"][0],
        json!({ "id": 3, "what": "press", "time": 0.02, "latency_ms": 4.0, "x": 1.0, "y": 1.0 })
    );
    assert_eq!(first["ink"], json!([[1, 3, 1.0, 1.0]]), "a stroke begins where the press was");
    assert_eq!((&sent[1].1["ink"], &sent[1].1["events"]), (&json!([]), &json!([])), "less than a step is no point");
    assert_eq!(sent[2].1["ink"], json!([[1, 3, 1.5, 1.0]]));
}

#[test]
fn a_window_that_comes_late_gets_all_and_each_press_is_a_stroke_of_its_own() {
    let mut room = Room::new(PageSettings::default());
    room.step(&[(3, 2.0), (4, 3.0)], &[(3, 2.0), (4, 3.0)], &[]);
    room.step(&[(4, 3.0)], &[], &[(3, 2.2)]);
    room.step(&[(3, 2.0), (4, 3.0)], &[(3, 2.0)], &[]);
    room.receive(A, PageNews::Opened);
    room.step(&[], &[], &[]);
    let all = json!([[1, 3, 1.0, 1.0], [2, 4, 2.0, 1.0], [1, 3, 1.2, 1.0], [3, 3, 1.0, 1.0]]);
    assert_eq!(json!(Room::ink(&room.sent(), A)), all);
    room.receive(A, PageNews::Closed("gone".to_owned()));
    room.receive(B, PageNews::Opened);
    room.step(&[], &[], &[]);
    let sent = room.sent();
    assert_eq!((json!(Room::ink(&sent, B)), sent.len()), (all, 1), "and who is gone gets nothing");
}

#[test]
fn windows_that_do_not_see_get_no_more_and_then_all_at_once_while_the_others_go_on() {
    let mut room = Room::new(PageSettings { step_mm: 0.0, ..PageSettings::default() });
    room.receive(A, PageNews::Opened);
    room.receive(B, PageNews::Opened);
    room.step(&[(1, 2.0)], &[(1, 2.0)], &[]);
    room.text(A, &json!({ "seen": [1, 12.5] }));
    for n in 0..50 {
        room.step(&[(1, 2.0 + 0.01 * f64::from(n))], &[], &[]);
    }
    let sent = room.sent();
    let n_of = |client: Client| sent.iter().filter(|it| it.0 == client).count() as u64;
    assert_eq!(n_of(A), 1 + MOST_UNSEEN, "what it has not seen does not pile up");
    assert_eq!(n_of(B), 51, "who never says what it sees gets all: a program that listens");
    room.text(A, &json!({ "seen": [7, 900.0] }));
    room.step(&[(1, 2.5)], &[], &[]);
    let after = room.sent();
    let to_a: Vec<_> = after.iter().filter(|it| it.0 == A).collect();
    assert_eq!((to_a.len(), to_a[0].1["pointers"][0]["x"].clone()), (1, json!(1.6)), "the newest state");
    let whole: Vec<_> = sent.into_iter().chain(after).collect();
    assert_eq!(Room::ink(&whole, A), Room::ink(&whole, B), "and no ink is lost");
    let figures = room.bench.finish().unwrap().figures;
    assert_eq!((figures["page.held_back"], figures["page.windows"]), (44.0, 2.0));
    assert_eq!(figures["page.drawn_ms.p50"], (12.5 + 900.0) / 2.0);
}

#[test]
fn a_window_that_takes_nothing_loses_no_ink() {
    let mut room = Room::new(PageSettings::default());
    room.receive(A, PageNews::Opened);
    room.wire.0.lock().unwrap().full.push(A);
    room.step(&[(1, 2.0)], &[(1, 2.0)], &[]);
    room.step(&[(1, 3.0)], &[], &[]);
    room.wire.0.lock().unwrap().full.clear();
    room.step(&[(1, 4.0)], &[], &[]);
    let sent = room.sent();
    assert_eq!((Room::ink(&sent, A).len(), &sent[0].1["seq"]), (3, &json!(1)));
}

#[test]
fn more_than_the_rate_is_not_sent() {
    let mut room = Room::new(PageSettings { rate_hz: 10.0, ..PageSettings::default() });
    room.receive(A, PageNews::Opened);
    for _ in 0..50 {
        room.step(&[(1, 2.0)], &[], &[]);
    }
    assert_eq!(room.sent().len(), 10, "a second, by the clock on the wall");
}

#[test]
fn a_cleared_page_is_clear_in_every_window_and_what_makes_no_sense_is_counted() {
    let mut room = Room::new(PageSettings::default());
    room.receive(A, PageNews::Opened);
    room.receive(B, PageNews::Opened);
    room.step(&[(1, 2.0)], &[(1, 2.0)], &[]);
    room.text(B, &json!({ "clear": true }));
    room.text(B, &json!({ "seen": [99, 1.0] }));
    room.text(B, &json!({ "delete": "everything" }));
    room.receive(A, PageNews::Text("{".repeat(1000)));
    room.sent();
    room.step(&[(1, 3.0)], &[], &[]);
    for (_, message) in room.sent() {
        assert_eq!((&message["epoch"], &message["ink"]), (&json!(1), &json!([[1, 1, 2.0, 1.0]])));
    }
    let report = room.bench.finish().unwrap();
    assert_eq!(report.figures["page.refused"], 3.0);
    assert!(report.remarks[0].contains("3 messages of windows were invalid"), "{report:?}");
}

#[test]
fn the_page_keeps_the_newest_ink_and_after_the_run_it_is_still_there() {
    let mut room = Room::new(PageSettings { most_points: 100, step_mm: 0.0, ..PageSettings::default() });
    room.receive(A, PageNews::Opened);
    room.step(&[(1, 2.0)], &[(1, 2.0)], &[]);
    for n in 0..150 {
        room.step(&[(1, 2.0 + 0.01 * f64::from(n))], &[], &[]);
    }
    let wire = room.wire.clone();
    room.sent();
    room.bench.finish().unwrap();
    let wire = wire.0.lock().unwrap();
    let greeting = &wire.greeting;
    assert_eq!(greeting["ink"].as_array().map(Vec::len), Some(100));
    assert_eq!(greeting["ink"][99], json!([1, 1, 2.49, 1.0]));
    assert_eq!((&greeting["over"], &wire.sent[0].1["over"]), (&json!("The run is over."), &json!("The run is over.")));
}

#[test]
fn a_run_without_pages_or_windows_has_the_same_figures_each_time() {
    let volume_m = Some([[0.0; 3], [4.0, 2.0, 0.1]]);
    let setup = Setup { volume_m, ..Setup::for_tests() };
    let bench = NodeBench::<DrawingPage>::with_setup(PageSettings::default(), &setup).unwrap();
    let figures = bench.finish().unwrap().figures;
    assert_eq!(figures.keys().collect::<Vec<_>>(), ["page.strokes"]);
}

#[test]
fn windows_learn_whose_pointers_are_and_an_exchange_draws_no_line_across_the_wall() {
    let mut room = Room::new(PageSettings::default());
    room.receive(A, PageNews::Opened);
    room.step(&[(1, 2.0), (2, 4.0)], &[(1, 2.0), (2, 4.0)], &[]);
    assert!(room.sent()[0].1.get("users").is_none(), "not before anybody is known");
    room.users = [(1, 5), (2, 6)].into();
    room.step(&[(1, 2.0), (2, 4.0)], &[], &[]);
    room.step(&[(1, 2.0), (2, 4.0)], &[], &[(2, 4.0)]);
    let sent = room.sent();
    assert_eq!((&sent[0].1["users"], &sent[0].1["pointers"][1]["user"]), (&json!([[1, 5], [2, 6]]), &json!(6)));
    assert_eq!((sent[1].1.get("users"), &sent[1].1["events"][0]["user"]), (None, &json!(6)));
    room.exchanged = vec![Exchange { ids: [TargetId(1), TargetId(2)], since: Time::ZERO }];
    room.step(&[(1, 4.0)], &[], &[]);
    room.exchanged.clear();
    room.step(&[(1, 4.1)], &[], &[]);
    let ink = Room::ink(&room.sent(), A);
    assert_eq!(json!(ink), json!([[3, 1, 3.0, 1.0], [3, 1, 3.1, 1.0]]), "another line of the same pointer");
    room.receive(B, PageNews::Opened);
    room.step(&[(1, 4.1)], &[], &[]);
    let late = room.sent();
    assert!(late.iter().any(|it| it.0 == B && it.1["users"] == json!([[1, 5], [2, 6]])), "{late:?}");
    assert_eq!(room.bench.finish().unwrap().figures["page.strokes"], 2.0);
}
