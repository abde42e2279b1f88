//! What `uinput` promises, tried without a device; tests/uinput/run.sh tries it with the kernel's.

use std::collections::BTreeMap;

use foveate::estimation::Random;
use foveate_testkit::check_node;
use nalgebra::{Point2, Vector2};

use super::*;

/// A wall of 4 m by 2 m whose top left corner is at (1, −1).
fn setup(purpose: Purpose) -> Setup {
    Setup { volume_m: Some([[1.0, -1.0, -0.1], [5.0, 1.0, 0.1]]), purpose, ..Setup::for_tests() }
}

/// What a reader of a touch screen knows.
#[derive(Debug, Default)]
struct Reader {
    slot: usize,
    /// By slot: tracking identity and place.
    fingers: BTreeMap<usize, (i32, [i32; 2])>,
    is_touched: bool,
    at: [i32; 2],
}

impl Reader {
    /// Takes one frame, or none.
    #[track_caller]
    fn take(&mut self, events: &[Event]) {
        let Some((last, events)) = events.split_last() else { return };
        assert_eq!(*last, Event::REPORT);
        let mut left = Vec::new();
        for event in events {
            match (event.kind, event.code, event.value) {
                (EV_ABS, ABS_MT_SLOT, slot) => self.slot = slot as usize,
                (EV_ABS, ABS_MT_TRACKING_ID, -1) => {
                    assert!(self.fingers.remove(&self.slot).is_some(), "slot {} was empty", self.slot);
                    left.push(self.slot);
                }
                (EV_ABS, ABS_MT_TRACKING_ID, id) => {
                    assert!(!left.contains(&self.slot), "slot {} is left and taken in one frame", self.slot);
                    assert!(self.fingers.values().all(|it| it.0 != id), "identity {id} twice");
                    assert!(self.fingers.insert(self.slot, (id, [-1; 2])).is_none(), "slot {} was taken", self.slot);
                }
                (EV_ABS, ABS_MT_POSITION_X, x) => self.fingers.get_mut(&self.slot).unwrap().1[0] = x,
                (EV_ABS, ABS_MT_POSITION_Y, y) => self.fingers.get_mut(&self.slot).unwrap().1[1] = y,
                (EV_KEY, BTN_TOUCH, value) => self.is_touched = value == 1,
                (EV_ABS, ABS_X, x) => self.at[0] = x,
                (EV_ABS, ABS_Y, y) => self.at[1] = y,
                other => panic!("found {other:?} on a touch screen"),
            }
        }
        assert_eq!(self.is_touched, !self.fingers.is_empty());
    }
}

fn contact(id: u32, at: [i32; 2]) -> Contact {
    Contact { id: TargetId(id), at, is_pressed: true }
}

#[test]
fn frames_of_fingers_are_what_the_kernel_documents() {
    let mut touch = Touch::new(2);
    let (slot, tracking) = (|it| Event::abs(ABS_MT_SLOT, it), |it| Event::abs(ABS_MT_TRACKING_ID, it));
    let (x, y) = (|it| Event::abs(ABS_MT_POSITION_X, it), |it| Event::abs(ABS_MT_POSITION_Y, it));
    let (first_x, first_y) = (|it| Event::abs(ABS_X, it), |it| Event::abs(ABS_Y, it));
    let hovering = Contact { is_pressed: false, ..contact(9, [1, 1]) };
    assert_eq!(touch.frame(&[hovering]), []);
    let down = [slot(0), tracking(0), x(5), y(6), Event::key(BTN_TOUCH, true), first_x(5), first_y(6), Event::REPORT];
    assert_eq!(touch.frame(&[hovering, contact(3, [5, 6])]), down);
    assert_eq!(touch.frame(&[contact(3, [5, 6])]), [], "nothing happened");
    let second = [slot(1), tracking(1), x(7), y(8), first_x(5), first_y(6), Event::REPORT];
    assert_eq!(touch.frame(&[contact(3, [5, 6]), contact(4, [7, 8])]), second);
    // The first is lifted: the second stays in its slot and is now the one that old programs see.
    let lifted = [slot(0), tracking(-1), first_x(7), first_y(8), Event::REPORT];
    assert_eq!(touch.frame(&[contact(4, [7, 8])]), lifted);
    // Slot 0 again, with another identity.
    let again = [slot(0), tracking(2), x(9), y(9), first_x(7), first_y(8), Event::REPORT];
    assert_eq!(touch.frame(&[contact(4, [7, 8]), contact(5, [9, 9])]), again);
    let gone = [slot(0), tracking(-1), slot(1), tracking(-1), Event::key(BTN_TOUCH, false), Event::REPORT];
    assert_eq!(touch.frame(&[]), gone);
    assert_eq!((touch.n_presses, touch.n_left_out), (3, 0));
}

#[test]
fn more_fingers_than_slots_are_counted_and_come_when_there_is_room() {
    let (mut touch, mut reader) = (Touch::new(2), Reader::default());
    let all = [contact(1, [1, 1]), contact(2, [2, 2]), contact(3, [3, 3])];
    for _ in 0..5 {
        reader.take(&touch.frame(&all));
        assert_eq!(reader.fingers.len(), 2);
    }
    assert_eq!((touch.n_presses, touch.n_left_out), (2, 1), "counted once");
    assert!(touch.is_urgent(&all[1..]), "the first is lifted");
    reader.take(&touch.frame(&all[1..]));
    assert_eq!(reader.fingers.len(), 1, "a slot that was left in this frame is not taken in it");
    assert!(touch.is_urgent(&all[1..]), "there is room for the third");
    reader.take(&touch.frame(&all[1..]));
    assert_eq!(reader.fingers[&0], (2, [3, 3]));
    assert!(!touch.is_urgent(&all[1..]));
    // Who comes as another goes waits for a frame; that is not being left out.
    reader.take(&touch.frame(&[contact(2, [2, 2]), contact(4, [4, 4])]));
    reader.take(&touch.frame(&[contact(2, [2, 2]), contact(4, [4, 4])]));
    assert_eq!((reader.fingers[&0], touch.n_left_out), ((3, [4, 4]), 1));
}

#[test]
fn a_reader_has_all_fingers_whatever_they_do() {
    let (mut touch, mut reader, mut random) = (Touch::new(5), Reader::default(), Random::new(1));
    let mut held: Vec<Contact> = Vec::new();
    let mut next = 0;
    // More presses than there are tracking identities.
    for _ in 0..150_000 {
        held.retain(|_| random.uniform() > 0.3);
        while held.len() < 5 && random.uniform() < 0.6 {
            held.push(contact(next, [0; 2]));
            next += 1;
        }
        held.iter_mut().for_each(|it| it.at = [0, 1].map(|_| (random.uniform() * 4000.0) as i32));
        reader.take(&touch.frame(&held));
        reader.take(&touch.frame(&held));
        let mut seen: Vec<[i32; 2]> = reader.fingers.values().map(|it| it.1).collect();
        let mut expected: Vec<[i32; 2]> = held.iter().map(|it| it.at).collect();
        seen.sort_unstable();
        expected.sort_unstable();
        assert_eq!(seen, expected);
        assert!(reader.fingers.values().all(|it| (0..=touch::LAST_TRACKING).contains(&it.0)));
    }
    assert!(touch.n_presses > touch::LAST_TRACKING as u64 + 1, "{}", touch.n_presses);
    assert_eq!(touch.n_left_out, 0);
}

#[test]
fn the_oldest_pointer_moves_the_cursor_until_it_is_gone() {
    let mut cursor = Cursor::default();
    let to = |[x, y]: [i32; 2]| [Event::abs(ABS_X, x), Event::abs(ABS_Y, y)];
    let hover = |id, at| Contact { is_pressed: false, ..contact(id, at) };
    let button = |is_down| Event::key(BTN_LEFT, is_down);
    let [x, y] = to([1, 2]);
    assert_eq!(cursor.frame(&[hover(4, [1, 2]), hover(7, [8, 8])]), [x, y, Event::REPORT]);
    // The cursor is there before the button goes down.
    let [x, y] = to([3, 4]);
    let press = [x, y, Event::REPORT, button(true), Event::REPORT];
    assert!(cursor.is_urgent(&[contact(4, [3, 4])]) && !cursor.is_urgent(&[hover(4, [3, 4])]));
    assert_eq!(cursor.frame(&[contact(4, [3, 4]), contact(7, [8, 8])]), press);
    // An older one that comes back does not take the cursor away.
    assert_eq!(cursor.frame(&[contact(2, [5, 5]), contact(4, [3, 4])]), []);
    // The holder is gone: the button comes up at its place, then goes down at the next one's.
    let [x, y] = to([8, 8]);
    let next = [button(false), Event::REPORT, x, y, Event::REPORT, button(true), Event::REPORT];
    assert_eq!(cursor.frame(&[contact(7, [8, 8])]), next);
    assert_eq!(cursor.frame(&[]), [button(false), Event::REPORT]);
    assert_eq!((cursor.frame(&[]), cursor.n_presses), (vec![], 2));
}

#[test]
fn the_desktop_has_no_gaps_and_no_more_units_than_old_drivers_count() {
    let wall = |width: f64| Wall { corner: Point2::origin(), size: Vector2::new(width, 1.0) };
    // Two displays of 1 m with 10 cm between them.
    let desktop = Desktop::new(&wall(2.1), [2, 1], 100.0).unwrap();
    assert_eq!((desktop.last, desktop.per_mm), ([20_000, 10_000], 10));
    let at = |x: f64| desktop.units(&Vector2::new(x / 2.1, 0.5));
    for (x, units) in [(-3.0, 0), (0.0, 0), (0.5, 5000), (1.0, 10_000), (1.05, 10_000), (1.1, 10_000), (1.6, 15_000)] {
        assert_eq!(at(x), [units, 5000], "at {x} m");
    }
    assert_eq!((at(2.1)[0], at(9.0)[0]), (20_000, 20_000), "beyond the edge it is at the edge");
    let large = Desktop::new(&wall(20.0), [1, 1], 0.0).unwrap();
    assert_eq!((large.last, large.per_mm), ([60_000, 3000], 3));
    let why = Desktop::new(&wall(0.5), [6, 1], 100.0).unwrap_err().to_string();
    assert!(why.contains("5 gaps of 100 mm on 500 mm of the wall"), "{why}");
}

fn pointer(id: u32, x: f64) -> Pointer {
    Pointer {
        id: TargetId(id),
        user: None,
        position: Point2::new(0.0, 0.0),
        velocity: Vector2::zeros(),
        predicted: Point2::new(x, 0.0),
        sigma: 0.001,
        is_pressed: true,
        is_resting: false,
        is_seen: true,
    }
}

fn feed(bench: &mut NodeBench<Uinput>, ms: f64, list: Vec<Pointer>) {
    let time = Time::ZERO + Interval::from_ms(ms);
    bench.feed(&POINTERS, time, Pointers { time, shown_at: time, list, ..Pointers::default() }).unwrap();
}

#[test]
fn node_keeps_the_law() {
    check_node::<Uinput>("required = false");
}

#[cfg(target_os = "linux")]
#[test]
fn a_device_that_is_missing_or_none_is_refused_by_name_and_checked_without_it() {
    let with = |device: &str| UinputSettings { device: device.to_owned(), ..Default::default() };
    let refused = |device: &str| {
        let why = NodeBench::<Uinput>::with_setup(with(device), &setup(Purpose::Run)).map(|_| ()).unwrap_err();
        assert_eq!(why.setting.as_deref(), Some("device"));
        why.message
    };
    let why = refused("/nowhere/uinput");
    for part in ["found no `/nowhere/uinput`", "No such file", "modprobe uinput", "required = false"] {
        assert!(why.contains(part), "{why}");
    }
    let why = refused("/dev/null");
    assert!(why.contains("found `/dev/null`, which makes no input device"), "{why}");
    NodeBench::<Uinput>::with_setup(with("/nowhere/uinput"), &setup(Purpose::Check)).unwrap();
    // Where it is not required the run goes on and says so.
    let optional = UinputSettings { required: false, ..with("/nowhere/uinput") };
    let mut bench = NodeBench::<Uinput>::with_setup(optional, &setup(Purpose::Run)).unwrap();
    feed(&mut bench, 0.0, vec![pointer(1, 2.0)]);
    let report = bench.finish().unwrap();
    assert_eq!((report.figures["uinput.presses"], report.figures["uinput.frames"]), (1.0, 0.0));
    assert!(report.remarks.iter().any(|it| it.contains("/nowhere/uinput")), "{:?}", report.remarks);
}

#[test]
fn moves_keep_to_the_rate_and_presses_do_not_wait() {
    let settings = UinputSettings { required: false, rate_hz: 50.0, slots: 1, ..Default::default() };
    let mut bench = NodeBench::<Uinput>::with_setup(settings, &setup(Purpose::Check)).unwrap();
    // 200 states, each elsewhere: one in 20 ms leaves, the others give way. The second pointer has no slot.
    for ms in 0..200 {
        feed(&mut bench, f64::from(ms), vec![pointer(1, 1.0 + 0.01 * f64::from(ms)), pointer(2, 1.0)]);
    }
    // Taps of one state each are not lost.
    for ms in 200..210 {
        feed(&mut bench, f64::from(ms), if ms % 2 == 0 { Vec::new() } else { vec![pointer(ms, 3.0)] });
    }
    let report = bench.finish().unwrap();
    assert_eq!(report.figures["uinput.presses"], 6.0);
    assert_eq!(report.figures["uinput.left_out"], 1.0);
    assert!((175.0..=190.0).contains(&report.figures["uinput.superseded"]), "{:?}", report.figures);
    assert!(report.remarks.iter().any(|it| it.contains("1 presses had no slot")), "{:?}", report.remarks);
}

#[test]
fn what_cannot_be_is_refused() {
    let refused = |settings: UinputSettings| {
        NodeBench::<Uinput>::with_setup(settings, &setup(Purpose::Check)).map(|_| ()).unwrap_err()
    };
    let why = refused(UinputSettings { name: "x".repeat(80), ..Default::default() });
    assert_eq!((why.setting.as_deref(), why.message.contains("80 bytes")), (Some("name"), true));
    assert_eq!(refused(UinputSettings { slots: 65, ..Default::default() }).setting.as_deref(), Some("slots"));
    assert_eq!(refused(UinputSettings { tiles: [0, 1], ..Default::default() }).setting.as_deref(), Some("tiles"));
    let without = NodeBench::<Uinput>::new(UinputSettings { required: false, ..Default::default() });
    let why = without.map(|_| ()).unwrap_err().to_string();
    assert!(why.contains("without a working volume"), "{why}");
}
