//! The page in a browser without a window, and the node on its own.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use foveate::node::page::{Client, PageNews, PageServer, Pages};
use foveate_testkit::check_node;
use serde_json::{Value, json};

use super::*;

/// The server's clock is this much ahead of the session's [ns].
const HOST_AHEAD: i64 = 7_000_000_000;

/// What a page and the node's side of it have in common in these tests: no sockets.
#[derive(Default)]
struct Wire {
    now: i64,
    events: VecDeque<PageEvent>,
    sent: Vec<(Client, Value)>,
    greeting: String,
    file: Option<Vec<u8>>,
}

#[derive(Clone, Default)]
struct Fake(Arc<Mutex<Wire>>);

impl PageServer for Fake {
    fn open(&self, instance: &str, page: Page) -> Result<Box<dyn PageLink>, String> {
        assert_eq!(instance, "test.node");
        let mut wire = self.0.lock().unwrap();
        wire.file = (page.files)("1").map(|it| it.bytes);
        assert!((page.files)("99").is_none() && (page.files)("x").is_none());
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
        self.0.lock().unwrap().sent.push((client, serde_json::from_str(text).unwrap()));
        true
    }
    fn greet(&mut self, text: &str) {
        self.0.lock().unwrap().greeting = text.to_owned();
    }
}

/// A node and a page whose browser does what each test says.
struct Room {
    bench: NodeBench<Projector>,
    wire: Fake,
}

const A: Client = Client(1);
const B: Client = Client(2);
/// White, black, two bits of four columns each with its inverse.
const N: usize = 6;

fn settings(advance: Advance) -> ProjectorSettings {
    let pattern = PatternSettings { projector_px: [4, 2], order: "white black columns".into(), ..Default::default() };
    ProjectorSettings { pattern, advance, rate_hz: 10.0, latency_ms: 50.0, exposure_ms: 8.0, ..Default::default() }
}

impl Room {
    fn new(settings: ProjectorSettings) -> Room {
        let wire = Fake::default();
        let mut setup = Setup { pages: Pages::served_by(Arc::new(wire.clone())), ..Setup::for_tests() };
        if settings.advance == Advance::Image {
            setup.connected = vec!["image".to_owned()];
        }
        Room { bench: NodeBench::with_setup(settings, &setup).unwrap(), wire }
    }

    /// Something happens in window `client` at `ms` of session time, and the node works on it.
    fn event(&mut self, ms: f64, client: Client, what: PageNews) {
        let now = Time::from_s(ms * 1e-3);
        let host = now.0 + HOST_AHEAD;
        {
            let mut wire = self.wire.0.lock().unwrap();
            wire.now = host;
            wire.events.push_back(PageEvent { client, arrival: host, what });
        }
        self.bench.activate(now).unwrap();
    }

    fn text(&mut self, ms: f64, client: Client, message: Value) {
        self.event(ms, client, PageNews::Text(message.to_string()));
    }

    fn open(&mut self, ms: f64, client: Client) {
        self.event(ms, client, PageNews::Opened);
        self.text(ms, client, json!({ "ready": true }));
    }

    /// The page has drawn a picture at `ms`, and reports it a frame later; its clock is known to 1 ms.
    fn shown(&mut self, ms: f64, client: Client, set: u64, index: usize, slip_ms: f64) {
        let at = ms + HOST_AHEAD as f64 * 1e-6;
        let when =
            json!({ "set": set, "index": index, "at": at, "sigma_ms": 1.0, "slip_ms": slip_ms, "refresh_ms": 16.0 });
        self.text(ms + 16.0 + slip_ms, client, json!({ "shown": when }));
    }

    fn black(&mut self, ms: f64, client: Client) {
        let at = ms + HOST_AHEAD as f64 * 1e-6;
        self.text(ms + 16.0, client, json!({ "black": { "at": at, "sigma_ms": 1.0, "slip_ms": 0, "refresh_ms": 16 } }));
    }

    /// The camera gave a picture in the middle of whose exposure it was `ms`.
    fn image(&mut self, ms: f64) {
        let time = Time::from_s(ms * 1e-3);
        self.bench.feed(&IMAGE, time, Image::default()).unwrap();
        self.wire.0.lock().unwrap().now = time.0 + HOST_AHEAD;
        self.bench.activate(time).unwrap();
    }

    fn told(&mut self) -> Vec<PatternShown> {
        self.bench.outputs(&SHOWN).into_iter().map(|it| (*it.value).clone()).collect()
    }

    fn gaps(&mut self) -> Vec<String> {
        self.bench.gaps(&SHOWN).into_iter().map(|it| it.reason).collect()
    }

    fn sent(&mut self) -> Vec<(Client, Value)> {
        std::mem::take(&mut self.wire.0.lock().unwrap().sent)
    }
}

fn ms(time: Time) -> f64 {
    (time.0 as f64 * 1e-3).round() * 1e-3
}

#[test]
fn node_keeps_the_law() {
    check_node::<Projector>("");
    check_node::<Projector>("advance = \"image\"\nsets = 2\npattern.code = \"phase\"");
}

#[test]
fn the_page_is_told_what_there_is_and_gets_the_pictures_that_foveate_patterns_writes() {
    let room = Room::new(settings(Advance::Rate));
    let wire = room.wire.0.lock().unwrap();
    assert_eq!(wire.greeting, r#"{"projector":{"size":[4,2],"count":6}}"#);
    assert_eq!(wire.file.as_deref(), Some(&[0; 8][..]), "black is the second");
}

#[test]
fn at_a_rate_each_picture_is_told_with_the_time_in_which_it_was_certainly_there() {
    let mut room = Room::new(ProjectorSettings { sets: 1, ..settings(Advance::Rate) });
    room.open(500.0, A);
    let play = json!({ "play": { "set": 0, "sets": 1, "hold_ms": 100.0, "pause_ms": 0.0 } });
    assert_eq!(room.sent(), [(A, play)]);
    for index in 0..N {
        room.shown(1000.0 + 100.0 * index as f64, A, 0, index, 0.0);
    }
    room.black(1600.0, A);
    let told = room.told();
    let names: Vec<&str> = told.iter().map(|it| it.name.as_str()).collect();
    assert_eq!(names[..3], ["white", "black", "bit 0 of the columns"]);
    for (index, it) in told.iter().enumerate() {
        assert_eq!((it.set, it.index as usize, it.count as usize), (0, index, N));
        // Six frames, and a millisecond of the clock at both ends.
        assert_eq!((ms(it.from), ms(Time(it.lasts.0))), (1001.0 + 100.0 * index as f64, 94.0));
    }
    let code = PatternSettings::read(&told[0].manifest).unwrap().stripe_code(None).unwrap();
    assert_eq!((code.projector, code.pictures().len()), ([4, 2], N));
    assert!(room.gaps().is_empty());
    assert_eq!(room.bench.run_source(Time::from_s(9.0)), Ok(0), "it never asks for more");
    let figures = room.bench.finish().unwrap().figures;
    assert_eq!((figures["projector.sets.projector"], figures["projector.clock_ms.max.projector"]), (1.0, 1.0));
}

#[test]
fn sets_follow_one_another_with_and_without_a_pause() {
    let mut room = Room::new(settings(Advance::Rate));
    room.open(500.0, A);
    let mut at = 1000.0;
    for set in 0..3 {
        for index in 0..N {
            room.shown(at, A, set, index, 0.0);
            at += 100.0;
        }
        if set == 1 {
            room.black(at, A);
            at += 300.0;
        }
    }
    let told: Vec<(u64, u32)> = room.told().iter().map(|it| (it.set, it.index)).collect();
    let expected: Vec<(u64, u32)> = (0..3).flat_map(|set| (0..N as u32).map(move |index| (set, index))).collect();
    assert_eq!((told, room.gaps()), (expected, vec![]));
}

#[test]
fn with_a_camera_the_next_picture_waits_for_an_exposure_that_lies_in_the_light_of_this_one() {
    let mut room = Room::new(ProjectorSettings { sets: 1, ..settings(Advance::Image) });
    room.open(500.0, A);
    assert_eq!(room.sent(), [(A, json!({ "show": { "set": 0, "index": 0 } }))]);
    room.image(990.0);
    room.shown(1000.0, A, 0, 0, 0.0);
    // Lit from 1000 + 1 (clock) + 50 (latency); exposures reach 4 ms around their middle.
    room.image(1054.9);
    assert!(room.told().is_empty() && room.sent().is_empty(), "the exposure began before the light");
    room.image(1055.0);
    let told = room.told();
    assert_eq!((told.len(), ms(told[0].from), ms(told[0].from + told[0].lasts)), (1, 1001.0, 1009.001));
    assert_eq!(room.sent(), [(A, json!({ "show": { "set": 0, "index": 1 } }))]);
    room.image(1080.0);
    assert!(room.told().is_empty() && room.sent().is_empty(), "once is enough");
    for index in 1..N {
        let at = 1000.0 + 100.0 * index as f64;
        room.shown(at, A, 0, index, 0.0);
        room.image(at + 70.0);
    }
    assert_eq!(room.told().len(), N - 1);
    assert_eq!(room.sent().last(), Some(&(A, json!({ "rest": true }))));
    room.black(1700.0, A);
    assert_eq!(room.bench.run_source(Time::from_s(9.0)), Ok(0));
    assert_eq!(room.bench.finish().unwrap().figures["projector.sets.projector"], 1.0);
}

#[test]
fn what_is_told_fits_the_collector_with_the_picture_that_was_waited_for() {
    use crate::collector::{Collector, CollectorSettings};
    let pictures: Out<PatternPictures> = Out::new(0, "pictures");
    let collector = CollectorSettings { latency_ms: 50.0, exposure_ms: 8.0, ..Default::default() };
    let mut collector = NodeBench::<Collector>::new(collector).unwrap();
    let mut room = Room::new(ProjectorSettings { sets: 1, ..settings(Advance::Image) });
    room.open(500.0, A);
    for index in 0..N {
        let at = 1000.0 + 100.0 * index as f64;
        room.shown(at, A, 0, index, 0.0);
        // One whose exposure began in the light of the one before, the right one, and one that shows the next picture already or not.
        for (late, level) in [(53.0, 1), (66.0, 200 + index as u8), (95.0, 2)] {
            let image = Image { width: 1, height: 1, pixels: vec![level], ..Image::default() };
            let time = Time::from_s((at + late) * 1e-3);
            collector.feed(&In::each(0, "image"), time, image).unwrap();
            room.image(at + late);
            for shown in room.told() {
                collector.feed(&In::each(1, "shown"), time, shown).unwrap();
            }
        }
    }
    collector
        .feed(
            &In::each(0, "image"),
            Time::from_s(2.0),
            Image { width: 1, height: 1, pixels: vec![0], ..Image::default() },
        )
        .unwrap();
    let sets = collector.outputs(&pictures);
    assert_eq!(sets.len(), 1, "{:?}", collector.gaps(&pictures));
    assert_eq!(sets[0].value.pixels, [200, 201, 202, 203, 204, 205]);
}

#[test]
fn a_page_that_is_closed_in_the_middle_is_named_and_the_set_begun_anew() {
    let mut room = Room::new(settings(Advance::Rate));
    room.open(500.0, A);
    (0..3).for_each(|index| room.shown(1000.0 + 100.0 * index as f64, A, 0, index, 0.0));
    room.event(1350.0, A, PageNews::Closed("it was closed".into()));
    let gaps = room.gaps();
    assert_eq!(
        gaps,
        ["set 0: the page was closed (it was closed) at picture 3 of 6; the next set begins when a page is ready"]
    );
    room.sent();
    room.open(3000.0, B);
    assert_eq!(room.sent()[0].1["play"]["set"], 1);
    room.told();
    (0..N).for_each(|index| room.shown(4000.0 + 100.0 * index as f64, B, 1, index, 0.0));
    assert_eq!(room.told().iter().filter(|it| it.set == 1).count(), N);
    let report = room.bench.finish().unwrap();
    assert_eq!(report.figures["projector.sets_broken.projector"], 1.0);
    assert!(report.remarks.iter().any(|it| it.contains("at picture 3 of 6")), "{:?}", report.remarks);
}

#[test]
fn one_window_shows_and_the_other_takes_over_when_it_cannot_any_more() {
    let mut room = Room::new(settings(Advance::Rate));
    room.open(500.0, A);
    room.open(600.0, B);
    let sent = room.sent();
    assert!(sent[1].0 == B && sent[1].1["wait"].is_string(), "{sent:?}");
    room.shown(700.0, B, 0, 0, 0.0);
    assert!(room.told().is_empty(), "it was not asked");
    room.shown(1000.0, A, 0, 0, 0.0);
    room.text(1100.0, A, json!({ "unfit": "the window has 3 x 2 px, the projector 4 x 2" }));
    assert!(room.gaps()[0].contains("3 x 2 px"));
    let sent = room.sent();
    assert!(sent[0].0 == B && sent[0].1["play"]["set"] == 1, "{sent:?}");
    // What the first one had still on its way counts for nothing.
    room.told();
    room.shown(1100.0, A, 0, 1, 0.0);
    assert!(room.told().is_empty() && room.gaps().is_empty());
}

#[test]
fn frames_that_come_late_shorten_what_is_certain_and_are_told() {
    let mut room = Room::new(settings(Advance::Rate));
    room.open(500.0, A);
    room.shown(1000.0, A, 0, 0, 40.0);
    let told = room.told();
    assert_eq!((ms(told[0].from), ms(Time(told[0].lasts.0))), (1041.0, 54.0));
    room.shown(1100.0, A, 0, 1, 120.0);
    assert!(room.told().is_empty());
    assert!(room.gaps()[0].contains("`black`"), "{:?}", room.gaps());
    let report = room.bench.finish().unwrap();
    assert_eq!(report.figures["projector.frames_dropped.projector"], 2.0);
    assert!(report.remarks[0].contains("may have been shown 40 ms late"), "{:?}", report.remarks);
}

#[test]
fn a_page_that_lies_or_raves_is_told_and_does_no_harm() {
    let mut room = Room::new(settings(Advance::Rate));
    room.open(500.0, A);
    room.shown(1000.0, A, 0, 0, 0.0);
    room.text(1010.0, A, json!({ "shown": { "set": 0, "index": 1, "at": "soon" } }));
    room.event(1020.0, A, PageNews::Text("\u{0}".into()));
    room.shown(1100.0, A, 0, 4, 0.0);
    assert!(room.gaps()[0].contains("the page showed picture 4 of set 0, expected picture 1 of set 0"));
    room.shown(1200.0, A, u64::MAX, usize::MAX, 0.0);
    room.text(1300.0, Client(77), json!({ "ready": true }));
    assert_eq!(room.told().len(), 1);
    let remarks = room.bench.finish().unwrap().remarks;
    assert!(remarks.iter().any(|it| it.contains("invalid message")), "{remarks:?}");
}

#[test]
fn a_key_shows_the_next_picture() {
    let mut room = Room::new(ProjectorSettings { pause_s: 1.0, ..settings(Advance::Key) });
    room.open(500.0, A);
    for index in 0..N {
        assert_eq!(room.sent().pop().unwrap().1["show"]["index"], index);
        room.shown(1000.0 * (index + 1) as f64, A, 0, index, 0.0);
        room.text(1000.0 * (index + 1) as f64 + 500.0, A, json!({ "key": true }));
    }
    assert_eq!(room.sent().pop().unwrap().1, json!({ "rest": true }));
    room.black(7000.0, A);
    let told = room.told();
    assert_eq!((told.len(), ms(told[5].from), ms(told[5].from + told[5].lasts)), (N, 6001.0, 6999.0));
    room.bench.run_source(Time::from_s(9.0)).unwrap();
    assert_eq!(room.sent().pop().unwrap().1, json!({ "show": { "set": 1, "index": 0 } }));
}

#[test]
fn nobody_who_opens_the_page_is_a_remark_and_so_is_a_camera_that_gives_nothing() {
    let room = Room::new(settings(Advance::Rate));
    let remarks = room.bench.finish().unwrap().remarks;
    assert!(remarks[0].contains("no pattern was shown at http://127.0.0.1:1/test.node/: no browser"), "{remarks:?}");
    let mut room = Room::new(settings(Advance::Image));
    room.open(500.0, A);
    room.shown(1000.0, A, 0, 0, 0.0);
    let remarks = room.bench.finish().unwrap().remarks;
    assert!(remarks[0].contains("picture at `image`: none"), "{remarks:?}");
}

#[test]
fn settings_that_cannot_be_are_refused() {
    let refused = |settings: ProjectorSettings| {
        let setup = Setup { purpose: Purpose::Check, ..Setup::for_tests() };
        Projector::new(settings, &setup).err().and_then(|it| it.setting)
    };
    assert_eq!(refused(settings(Advance::Rate)), None);
    assert_eq!(refused(ProjectorSettings::default()).as_deref(), Some("pattern.projector_px"));
    assert_eq!(refused(settings(Advance::Image)).as_deref(), Some("advance"));
    let wrong = ProjectorSettings { rate_hz: f64::NAN, ..settings(Advance::Rate) };
    assert_eq!(refused(wrong).as_deref(), Some("rate_hz"));
    // Without a server there is nothing to wait for.
    let mut bench = NodeBench::<Projector>::new(settings(Advance::Rate)).unwrap();
    assert_eq!(bench.run_source(Time::from_s(9.0)), Ok(0));
    let report = bench.finish().unwrap();
    assert!(report.remarks[0].contains("serves no pages") && report.figures.len() == 5);
}
