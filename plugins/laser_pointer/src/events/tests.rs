//! What `events` promises, tried.

use foveate::messages::SourceId;
use foveate_testkit::{check_node, check_runs};
use nalgebra::{Matrix6, Point2, Point3, Vector3};

use super::*;
use crate::smoothing::JitterFilter;
use PointerChange::{Appear, Dwell, Hover, Move, Press, Release, Stroke, Vanish};

/// Frames of a camera.
const FRAME_MS: f64 = 10.0;
/// From capture to delivery in these tests.
const LATE_MS: f64 = 4.0;

struct Room {
    bench: NodeBench<Events>,
    frame: i64,
}

fn settings() -> EventSettings {
    let smoothing = SmoothingSettings { filter: JitterFilter::None, still_m_s: 0.0, ..SmoothingSettings::default() };
    EventSettings { smoothing, ..EventSettings::default() }
}

fn target(id: u32, x: f64, y: f64) -> Target {
    Target {
        id: TargetId(id),
        position: Point3::new(x, y, 0.0),
        velocity: Vector3::zeros(),
        covariance: Matrix6::identity() * 1e-6,
        cameras: CameraSet::default(),
        provenance: Provenance::Measured,
    }
}

impl Room {
    fn new(settings: EventSettings) -> Room {
        Room { bench: NodeBench::new(settings).unwrap(), frame: 0 }
    }

    fn time(frame: i64) -> Time {
        Time::ZERO + Interval::from_ms(FRAME_MS * frame as f64)
    }

    /// The targets of the next frame.
    fn show(&mut self, list: Vec<Target>) -> Pointers {
        let time = Room::time(self.frame);
        self.frame += 1;
        self.bench.feed_from(&TARGETS, SourceId(1), time, Interval::from_ms(LATE_MS), Targets { time, list }).unwrap();
        let given = self.bench.outputs(&POINTERS);
        assert_eq!((given.len(), given[0].stamp.time), (1, time), "one message for each, under its own stamp");
        (*given[0].value).clone()
    }

    /// One pointer, there at `at(frame)` where that is, for so many frames: what happened, each with its frame.
    fn run(&mut self, n: i64, at: impl Fn(i64) -> Option<[f64; 2]>) -> Vec<(PointerChange, i64)> {
        let mut events = Vec::new();
        for _ in 0..n {
            let frame = self.frame;
            let list = at(frame).map(|[x, y]| target(7, x, y)).into_iter().collect();
            for event in self.show(list).events {
                assert_eq!(event.time + event.latency, Room::time(frame) + Interval::from_ms(LATE_MS), "{event:?}");
                events.push((event.what, (event.time.as_s() * 1e3 / FRAME_MS).round() as i64));
            }
        }
        events
    }
}

#[test]
fn node_keeps_the_law() {
    check_node::<Events>("");
    check_node::<Events>("press = \"dwell\"\nsmoothing.filter = \"kalman\"");
    for filter in [JitterFilter::None, JitterFilter::OneEuro, JitterFilter::Kalman] {
        let settings =
            EventSettings { smoothing: SmoothingSettings { filter, ..Default::default() }, ..Default::default() };
        check_runs::<Events>(&settings, &Setup::for_tests(), |bench, time| {
            let list = vec![target(1, time.as_s(), 0.5)];
            bench.feed(&TARGETS, time, Targets { time, list })
        });
    }
}

#[test]
fn a_stroke_begins_where_the_pointer_appeared_and_ends_where_it_was_seen_last() {
    let mut room = Room::new(settings());
    // 0.2 m/s for 20 frames, then dark.
    let events = room.run(40, |frame| (frame < 20).then_some([0.5 + 0.002 * frame as f64, 0.25]));
    let mut expected = vec![(Appear, 0), (Press, 0)];
    expected.extend((3..20).map(|frame| (Move, frame)));
    expected.extend([(Release, 19), (Stroke, 19), (Vanish, 19)]);
    assert_eq!(events, expected, "the press is sent when it is certain, with the time of the first observation");
    let figures = room.bench.finish().unwrap().figures;
    assert_eq!((figures["pointer.move"], figures["pointer.stroke"], figures["pointer.flashes"]), (17.0, 1.0, 0.0));
    assert!((figures["pointer.move_latency_ms.p99"] - LATE_MS).abs() < 1e-6);
    assert!((figures["pointer.press_latency_ms.p50"] - (LATE_MS + 3.0 * FRAME_MS)).abs() < 1e-6);
}

#[test]
fn the_stroke_has_every_point_and_the_first_of_them_is_where_it_began() {
    let mut room = Room::new(settings());
    let mut path = Vec::new();
    for frame in 0..40 {
        let list = if frame < 20 { vec![target(7, 0.5 + 0.002 * f64::from(frame), 0.25)] } else { Vec::new() };
        path.extend(room.show(list).events.into_iter().filter(|it| it.what == Stroke).flat_map(|it| it.path));
    }
    let found: Vec<(i64, f64)> = path.iter().map(|it| (it.time.0, it.position.x)).collect();
    let expected: Vec<(i64, f64)> = (0..20).map(|it| (Room::time(it).0, 0.5 + 0.002 * it as f64)).collect();
    assert_eq!(found, expected);
}

#[test]
fn flashes_are_no_presses_and_flicker_breaks_no_stroke() {
    let mut room = Room::new(settings());
    let events = room.run(30, |frame| (frame < 2).then_some([0.1, 0.1]));
    assert_eq!(events, [(Appear, 0), (Vanish, 1)], "two frames are a flash");
    // Dark for seven frames of ten: a gap between tiles; then for good.
    let events = room.run(60, |frame| ((30..40).contains(&frame) || (48..55).contains(&frame)).then_some([0.1, 0.1]));
    let strokes: Vec<_> = events.iter().filter(|it| matches!(it.0, Press | Release | Vanish)).collect();
    assert_eq!(strokes, [&(Press, 30), &(Release, 54), &(Vanish, 54)], "{events:?}");
    assert_eq!(room.bench.finish().unwrap().figures["pointer.flashes"], 1.0);
}

#[test]
fn rest_is_a_hover_then_a_dwell_once_and_again_after_a_move() {
    let mut room = Room::new(settings());
    // Rest, 100 mm away in one go, rest again; a tremor of 10 mm all along.
    let at = |frame: i64| Some([0.5 + if frame < 150 { 0.0 } else { 0.1 } + 0.01 * (frame % 2) as f64, 0.5]);
    let events = room.run(300, at);
    let rests: Vec<_> = events.iter().filter(|it| matches!(it.0, Hover | Dwell)).copied().collect();
    assert_eq!(rests, [(Hover, 20), (Dwell, 80), (Hover, 170), (Dwell, 230)]);
    let last = room.show(vec![target(7, 0.6, 0.5)]);
    assert!(last.list[0].is_resting && last.list[0].is_pressed);
}

#[test]
fn pressed_by_a_dwell_it_hovers_before_and_draws_nothing_of_that() {
    let mut room = Room::new(EventSettings { press: PressBy::Dwell, ..settings() });
    let at = |frame: i64| (frame < 200).then(|| [0.5 + 0.01 * (frame - 100).max(0) as f64, 0.5]);
    let events = room.run(100, at);
    assert_eq!(events, [(Appear, 0), (Hover, 20), (Dwell, 80), (Press, 80)]);
    let events = room.run(120, at);
    assert_eq!(events.iter().filter(|it| it.0 == Move).count(), 99);
    assert_eq!(events[events.len() - 3..], [(Release, 199), (Stroke, 199), (Vanish, 199)]);
}

#[test]
fn many_pointers_are_told_apart_and_listed_in_order() {
    let mut room = Room::new(settings());
    for frame in 0..10 {
        let list = (1..=4).map(|id| target(id, f64::from(id), 0.1 * f64::from(frame))).collect();
        let given = room.show(list);
        let ids: Vec<u32> = given.list.iter().map(|it| it.id.0).collect();
        assert_eq!(ids, [1, 2, 3, 4]);
        for it in &given.list {
            assert_eq!((it.position.x, it.position.y), (f64::from(it.id.0), 0.1 * f64::from(frame)));
        }
    }
    let given = room.show(vec![target(3, 3.0, 1.0)]);
    assert_eq!(given.list.iter().map(|it| it.is_seen).collect::<Vec<_>>(), [false, false, true, false]);
}

#[test]
fn what_is_only_predicted_is_not_seen_and_what_comes_late_is_counted() {
    let mut room = Room::new(settings());
    let predicted = Target { provenance: Provenance::Predicted, ..target(7, 0.1, 0.1) };
    assert!(room.show(vec![predicted.clone()]).list.is_empty(), "nobody appears by prediction");
    room.show(vec![target(7, 0.1, 0.1)]);
    let events = room.run(1, |_| Some([0.1, 0.1]));
    assert_eq!(events, []);
    for _ in 0..10 {
        room.show(vec![predicted.clone()]);
    }
    assert!(room.show(vec![predicted]).list.is_empty(), "a prediction does not keep a pointer");
    room.show(vec![target(8, 0.1, 0.1)]);
    room.frame -= 2;
    room.show(vec![target(8, 0.9, 0.1)]);
    assert_eq!(room.show(vec![target(8, 0.1, 0.1)]).list[0].position.x, 0.1);
    // The last of these was of the time of the one before it.
    assert_eq!(room.bench.finish().unwrap().figures["pointer.late"], 2.0);
}

#[test]
fn pointers_are_shown_where_they_will_be() {
    let mut settings = settings();
    settings.display_latency_ms = 46.0;
    let mut room = Room::new(settings);
    let mut given = Pointers::default();
    for frame in 0..10 {
        let moving = Target { velocity: Vector3::new(2.0, -1.0, 0.0), ..target(7, 0.02 * f64::from(frame), 1.0) };
        given = room.show(vec![moving]);
    }
    assert_eq!(given.shown_at, Room::time(9) + Interval::from_ms(LATE_MS + 46.0));
    let expected = Point2::new(0.18 + 2.0 * 0.05, 1.0 - 0.05);
    assert!((given.list[0].predicted - expected).norm() < 1e-12, "{:?}", given.list[0]);
    // Lost, it is carried on, but not for ever.
    let given = room.show(Vec::new());
    assert!((given.list[0].position.x - 0.2).abs() < 1e-12 && !given.list[0].is_seen);
    for _ in 0..7 {
        room.show(Vec::new());
    }
    let given = room.show(Vec::new());
    assert!((given.list[0].predicted.x - 0.38).abs() < 1e-12, "100 ms at most: {:?}", given.list[0]);
}

#[test]
fn a_tracker_that_gives_too_many_is_bounded_and_counted() {
    let mut room = Room::new(settings());
    let given = room.show((0..300).map(|id| target(id, 0.1, 0.1)).collect());
    assert_eq!(given.list.len(), MOST_POINTERS);
    let report = room.bench.finish().unwrap();
    assert_eq!(report.figures["pointer.left_out"], 44.0);
    assert!(report.remarks[0].contains("44 measurements of pointers were left out"), "{:?}", report.remarks);
}

#[test]
fn settings_that_cannot_be_are_refused() {
    let refused = |settings: EventSettings| NodeBench::<Events>::new(settings).map(|_| ()).unwrap_err().to_string();
    let why = refused(EventSettings { dwell_ms: 100.0, ..settings() });
    assert!(why.contains("found 100, expected 200 to 60000"), "{why}");
    let smoothing = SmoothingSettings { min_cutoff_hz: 0.0, ..SmoothingSettings::default() };
    assert!(NodeBench::<Events>::new(EventSettings { smoothing, ..settings() }).is_err());
}

#[test]
fn pointers_and_all_that_they_do_say_whose_they_are() {
    let mut room = Room::new(settings());
    let tell = |room: &mut Room, list: Vec<TargetUser>| {
        let time = Room::time(room.frame);
        room.bench.feed(&USERS, time, Users { time, list, exchanged: Vec::new() }).unwrap();
    };
    let both = |x: f64| vec![target(7, x, 0.1), target(8, x, 0.9)];
    for frame in 0..5 {
        tell(&mut room, Vec::new());
        let given = room.show(both(0.1 * f64::from(frame)));
        assert!(given.list.iter().all(|it| it.user.is_none()) && given.events.iter().all(|it| it.user.is_none()));
    }
    let known = vec![TargetUser { id: TargetId(8), user: 3 }];
    tell(&mut room, known);
    let given = room.show(both(0.6));
    assert_eq!(given.list.iter().map(|it| it.user).collect::<Vec<_>>(), [None, Some(3)]);
    assert_eq!(given.events.iter().map(|it| (it.id.0, it.user)).collect::<Vec<_>>(), [(7, None), (8, Some(3))]);
    // The tracker does not know lost pointers any more: what they did last is the user's all the same.
    let mut events = Vec::new();
    for _ in 0..12 {
        tell(&mut room, Vec::new());
        events.extend(room.show(Vec::new()).events);
    }
    assert_eq!(events.len(), 6);
    assert!(events.iter().all(|it| it.user == (it.id.0 == 8).then_some(3)), "{events:?}");
}

#[test]
fn strokes_of_pointers_that_were_taken_for_each_other_are_put_right() {
    let mut room = Room::new(settings());
    let (mut events, mut jumps) = (Vec::new(), 0.0_f64);
    // Both go to the right, one at y = 0.1, one at 0.9; from frame 10 to 19 each has the other's identity.
    for frame in 0..45 {
        let (is_mixed, x) = ((10..20).contains(&frame), 0.01 * f64::from(frame));
        let (upper, lower) = if is_mixed { (8, 7) } else { (7, 8) };
        if frame == 20 {
            let ids = [TargetId(7), TargetId(8)];
            let exchanged = vec![Exchange { ids, since: Room::time(9) }];
            let time = Room::time(room.frame);
            room.bench.feed(&USERS, time, Users { time, list: Vec::new(), exchanged }).unwrap();
        }
        let list = if frame < 30 { vec![target(upper, x, 0.1), target(lower, x, 0.9)] } else { Vec::new() };
        let given = room.show(list);
        assert_eq!(given.exchanged.len(), usize::from(frame == 20), "reported once");
        if frame > 20 {
            let upper = given.list.iter().find(|it| it.id.0 == 7);
            jumps = upper.map_or(jumps, |it| jumps.max((it.position.y - 0.1).abs()));
        }
        events.extend(given.events.into_iter().filter(|it| it.what == Stroke));
    }
    assert!(jumps < 1e-9, "{jumps}");
    assert_eq!(events.len(), 2);
    for stroke in events {
        let y = if stroke.id.0 == 7 { 0.1 } else { 0.9 };
        assert!(stroke.path.len() == 30 && stroke.path.iter().all(|it| it.position.y == y), "{stroke:?}");
    }
}
