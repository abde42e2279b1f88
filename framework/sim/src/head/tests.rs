//! The simulated head against the manuals: bytes there, bytes back, and when.

use std::fs::OpenOptions;
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use foveate_messages::{Interval, Time};

use super::serve::Terminal;
use super::{HeadSettings, LineSettings, NetworkHead, SerialHead};

/// A head that looks at messages as soon as they come, so that times are exact.
fn prompt() -> HeadSettings {
    HeadSettings { field_ms: 1.0, latency_jitter_ms: 0.0, ..HeadSettings::default() }
}

fn serial(settings: &HeadSettings) -> SerialHead {
    SerialHead::new(settings, &LineSettings::default(), 1).unwrap()
}

/// What comes back within a time after `bytes`, with the millisecond in which each packet ends.
fn said(head: &mut SerialHead, from_ms: i64, bytes: &[u8], for_ms: i64) -> Vec<(i64, Vec<u8>)> {
    let mut found = Vec::new();
    let mut begun = Vec::new();
    head.write(Time(from_ms * 1_000_000), bytes);
    for millisecond in from_ms..from_ms + for_ms {
        for byte in head.read(Time(millisecond * 1_000_000)) {
            begun.push(byte);
            if byte == 0xFF {
                found.push((millisecond - from_ms, std::mem::take(&mut begun)));
            }
        }
    }
    found
}

fn words(said: &[(i64, Vec<u8>)]) -> Vec<&[u8]> {
    said.iter().map(|it| &it.1[..]).collect()
}

const HOME: [u8; 5] = [0x81, 0x01, 0x06, 0x04, 0xFF];
const WHERE: [u8; 5] = [0x81, 0x09, 0x06, 0x12, 0xFF];

/// Go to a pan position of three digits at full speed.
fn go(pan: [u8; 3]) -> [u8; 15] {
    [0x81, 0x01, 0x06, 0x02, 0x18, 0x14, 0, pan[0], pan[1], pan[2], 0, 0, 0, 0, 0xFF]
}

#[test]
fn bytes_take_their_time_on_the_line() {
    // 5 bytes there are 5.2 ms, 11 back 11.5 ms, and up to 2 ms until the head looks.
    let mut head = serial(&prompt());
    let answer = said(&mut head, 0, &WHERE, 40);
    assert_eq!(words(&answer), [&[0x90, 0x50, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF]]);
    assert!((16..=20).contains(&answer[0].0), "{} ms", answer[0].0);
}

#[test]
fn a_move_is_acknowledged_at_once_begun_late_and_completed_when_it_is_there() {
    let mut head = serial(&prompt());
    let answer = said(&mut head, 0, &go([3, 7, 0]), 3000);
    assert_eq!(words(&answer), [&[0x90, 0x41, 0xFF], &[0x90, 0x51, 0xFF]]);
    assert!((18..=22).contains(&answer[0].0), "acknowledged after {} ms", answer[0].0);
    // 100° at 80°/s with 400°/s² are 1.45 s.
    assert!((1700..1780).contains(&answer[1].0), "completed after {} ms", answer[1].0);
    assert_eq!(head.head().pan().motor_units(), 880);

    let mut head = serial(&prompt());
    said(&mut head, 0, &go([3, 7, 0]), 266);
    assert_eq!(head.head().pan().motor_units(), 0, "nothing moves for 250 ms");
}

#[test]
fn the_third_command_finds_the_buffer_full_and_inquiries_do_not() {
    let mut head = serial(&HeadSettings { take_up_ms: 500.0, ..prompt() });
    let all = [&go([1, 0, 0])[..], &go([2, 0, 0]), &HOME, &WHERE].concat();
    let answer = said(&mut head, 0, &all, 70);
    let expected: [&[u8]; 4] = [
        &[0x90, 0x41, 0xFF],
        &[0x90, 0x42, 0xFF],
        &[0x90, 0x60, 0x03, 0xFF],
        &[0x90, 0x50, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF],
    ];
    assert_eq!(words(&answer), expected);
    assert_eq!(head.head().n_refused_full(), 1);
}

#[test]
fn at_30_hz_a_new_move_takes_the_place_of_the_one_before() {
    let mut head = serial(&HeadSettings::default());
    let mut heard = Vec::new();
    for millisecond in 0..60 * 34 {
        let now = Time(millisecond * 1_000_000);
        if millisecond % 34 == 0 {
            let index = (millisecond / 34) as u8;
            head.write(now, &go([0, index / 16, index % 16]));
        }
        heard.extend(head.read(now));
    }
    let is = |code: u8| heard.windows(2).filter(|it| it[0] == 0x90 && it[1] & 0xF0 == code).count();
    assert_eq!(is(0x60), 0, "none is refused");
    assert!(is(0x40) >= 59 && is(0x50) >= 57, "{} taken, {} done or replaced", is(0x40), is(0x50));
    // Without a pause between them the head cannot keep up.
    let mut head = serial(&HeadSettings { take_up_ms: 100.0, ..HeadSettings::default() });
    let all: Vec<u8> = (0..20).flat_map(|it| go([0, 1, it % 16])).collect();
    assert!(words(&said(&mut head, 0, &all, 500)).contains(&&[0x90, 0x60, 0x03, 0xFF][..]));
}

#[test]
fn a_cancelled_move_stops_and_an_empty_socket_is_said_to_be_empty() {
    let mut head = serial(&prompt());
    said(&mut head, 0, &go([3, 7, 0]), 700);
    let answer = said(&mut head, 700, &[0x81, 0x21, 0xFF, 0x81, 0x22, 0xFF], 1500);
    assert_eq!(words(&answer), [&[0x90, 0x61, 0x04, 0xFF], &[0x90, 0x62, 0x05, 0xFF]]);
    assert!((100..800).contains(&head.head().pan().motor_units()), "{}", head.head().pan().motor_units());
}

#[test]
fn what_is_not_understood_is_refused() {
    let mut head = serial(&prompt());
    let mut answer =
        |bytes: &[u8], from_ms| said(&mut head, from_ms, bytes, 100).into_iter().map(|it| it.1).collect::<Vec<_>>();
    assert_eq!(answer(&[0x81, 0x01, 0x06, 0x77, 0xFF], 0), [[0x90, 0x60, 0x02, 0xFF]]);
    // Too fast, too far.
    assert_eq!(
        answer(&[0x81, 0x01, 0x06, 0x02, 0x19, 0x14, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF], 100),
        [[0x90, 0x60, 0x02, 0xFF]]
    );
    assert_eq!(answer(&go([3, 7, 1]), 200), [[0x90, 0x60, 0x02, 0xFF]]);
    // Focus by hand while it focuses by itself.
    assert_eq!(answer(&[0x81, 0x01, 0x04, 0x08, 0x02, 0xFF], 300), [[0x90, 0x61, 0x41, 0xFF]]);
    // Too long.
    assert_eq!(answer(&[[0x81].as_slice(), &[1; 20], &[0xFF]].concat(), 400), [[0x90, 0x60, 0x01, 0xFF]]);
    // For another head.
    assert_eq!(answer(&[0x82, 0x01, 0x06, 0x04, 0xFF], 500), Vec::<Vec<u8>>::new());
}

#[test]
fn the_head_takes_the_address_that_it_is_given() {
    let mut head = serial(&prompt());
    assert_eq!(words(&said(&mut head, 0, &[0x88, 0x30, 0x03, 0xFF], 50)), [&[0x88, 0x30, 0x04, 0xFF]]);
    assert_eq!(words(&said(&mut head, 50, &[0x83, 0x01, 0x00, 0x01, 0xFF], 50)), [&[0xB0, 0x50, 0xFF]]);
}

#[test]
fn in_standby_only_power_is_taken() {
    let mut head = serial(&prompt());
    said(&mut head, 0, &[0x81, 0x01, 0x04, 0x00, 0x03, 0xFF], 100);
    assert_eq!(words(&said(&mut head, 100, &HOME, 50)), [&[0x90, 0x61, 0x41, 0xFF]]);
    assert_eq!(words(&said(&mut head, 150, &[0x81, 0x09, 0x04, 0x00, 0xFF], 50)), [&[0x90, 0x50, 0x03, 0xFF]]);
    let answer = said(&mut head, 200, &[0x81, 0x01, 0x04, 0x00, 0x02, 0xFF], 3500);
    assert_eq!(words(&answer), [&[0x90, 0x41, 0xFF], &[0x90, 0x51, 0xFF]]);
}

#[test]
fn noise_changes_bytes_as_often_as_it_is_told() {
    let line = LineSettings { lost: 0.1, flipped: 0.1, inserted: 0.1, baud: 1e6 };
    let mut head = SerialHead::new(&prompt(), &line, 1).unwrap();
    let n_asked = 3000;
    let mut n_answered = 0;
    for index in 0..n_asked {
        let answer = said(&mut head, 10 * index, &WHERE, 10);
        n_answered += answer.iter().filter(|it| it.1 == [0x90, 0x50, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF]).count();
    }
    // All of 16 bytes unhurt: 0.9³ each, but for bytes inserted after the last ones: 0.0078; and the question before has ended.
    let share = n_answered as f64 / n_asked as f64;
    assert!((0.002..0.03).contains(&share), "{share}");
    let mut quiet = SerialHead::new(&prompt(), &LineSettings { baud: 1e6, ..LineSettings::default() }, 1).unwrap();
    assert!((0..100).all(|index| said(&mut quiet, 10 * index, &WHERE, 10).len() == 1));
}

#[test]
fn a_terminal_takes_no_more_than_the_line_passes_on() {
    let mut terminal = Terminal::new().unwrap();
    let flags = nix::fcntl::OFlag::O_NONBLOCK.bits();
    let mut flood = OpenOptions::new().write(true).custom_flags(flags).open(terminal.path()).unwrap();
    let (mut head, stop) = (serial(&prompt()), AtomicBool::new(false));
    std::thread::scope(|scope| {
        scope.spawn(|| terminal.serve(&mut head, &stop).unwrap());
        let begun = Instant::now();
        while begun.elapsed().as_millis() < 300 {
            let _ = flood.write(&[0x81, 0xFF].repeat(128));
        }
        stop.store(true, Ordering::Relaxed);
    });
    // 256 are read at once, and each two of them are answered with four.
    assert!(head.n_bytes() <= 256 + 512, "{}", head.n_bytes());
    assert!(head.n_bytes() > 0);
}

#[test]
fn a_datagram_that_comes_twice_is_done_once() {
    let mut head = NetworkHead::new(&prompt(), 1).unwrap();
    let step = [0x81, 0x01, 0x06, 0x03, 0x18, 0x14, 0, 0, 1, 0, 0, 0, 0, 0, 0xFF];
    let datagram = |kind: [u8; 2], sequence: u8, payload: &[u8]| {
        [&kind[..], &[0, payload.len() as u8, 0, 0, 0, sequence], payload].concat()
    };
    let mut at = Time::ZERO;
    let mut ask = |bytes: &[u8]| {
        head.receive(at, bytes);
        at = at + Interval::from_ms(1000.0);
        let replies: Vec<_> = std::iter::from_fn(|| head.send(at)).collect();
        (replies, head.head().pan().motor_units())
    };
    assert_eq!(ask(&datagram([2, 0], 9, &[1])).0, [datagram([2, 1], 9, &[1])]);
    let (replies, units) = ask(&datagram([1, 0], 0, &step));
    assert_eq!(units, 16);
    assert_eq!(replies, [datagram([1, 0x11], 0, &[0x90, 0x41, 0xFF]), datagram([1, 0x11], 0, &[0x90, 0x51, 0xFF])]);
    let (replies, units) = ask(&datagram([1, 0], 0, &step));
    assert_eq!((replies, units), (vec![datagram([2, 0], 0, &[0x0F, 0x01])], 16));
    let (replies, _) = ask(&datagram([3, 0], 1, &step));
    assert_eq!(replies, [datagram([2, 0], 1, &[0x0F, 0x02])]);
    assert_eq!(ask(&[1, 0, 0, 9, 0, 0, 0, 2, 0xFF]).0, [datagram([2, 0], 2, &[0x0F, 0x02])]);
}

/// The head's answers to one packet within `for_ms`, at once.
fn answers(head: &mut SerialHead, now_ms: &mut i64, bytes: &[u8], for_ms: i64) -> Vec<Vec<u8>> {
    let answers = said(head, *now_ms, bytes, for_ms).into_iter().map(|it| it.1).collect();
    *now_ms += for_ms;
    answers
}

const DONE: [&[u8]; 2] = [&[0x90, 0x41, 0xFF], &[0x90, 0x51, 0xFF]];

#[test]
fn the_speed_of_an_axis_that_stops_means_nothing() {
    let mut head = serial(&prompt());
    let mut now = 0;
    let stop = [0x81, 0x01, 0x06, 0x01, 0x00, 0x00, 0x03, 0x03, 0xFF];
    for speed in [0x00, 0x15, 0x18, 0x7F] {
        let right = [0x81, 0x01, 0x06, 0x01, 0x10, speed, 0x02, 0x03, 0xFF];
        let up = [0x81, 0x01, 0x06, 0x01, speed, 0x10, 0x03, 0x01, 0xFF];
        for (drive, axis) in [(right, 0), (up, 1)] {
            let before = [head.head().pan().motor_units(), head.head().tilt().motor_units()];
            assert_eq!(answers(&mut head, &mut now, &drive, 700), DONE, "{drive:02X?}");
            let after = [head.head().pan().motor_units(), head.head().tilt().motor_units()];
            assert!(after[axis] > before[axis] && after[1 - axis] == before[1 - axis], "{drive:02X?}: {after:?}");
            answers(&mut head, &mut now, &stop, 700);
        }
        answers(&mut head, &mut now, &HOME, 3000);
    }
    // The axis that moves needs a speed that there is.
    for speeds in [[0x00, 0x10], [0x19, 0x10]] {
        let drive = [0x81, 0x01, 0x06, 0x01, speeds[0], speeds[1], 0x01, 0x03, 0xFF];
        assert_eq!(answers(&mut head, &mut now, &drive, 100), [[0x90, 0x60, 0x02, 0xFF]]);
    }
}

#[test]
fn a_recalled_place_is_where_it_was_set_and_an_empty_one_cannot_be() {
    let mut head = serial(&prompt());
    let mut now = 0;
    let memory = |what: u8, number: u8| [0x81, 0x01, 0x04, 0x3F, what, number, 0xFF];
    assert_eq!(answers(&mut head, &mut now, &memory(2, 3), 100), [[0x90, 0x61, 0x41, 0xFF]], "nothing is set");
    let zoom = |a: u8, b: u8| [0x81, 0x01, 0x04, 0x47, 0, a, b, 0, 0xFF];
    answers(&mut head, &mut now, &go([1, 2, 3]), 2000);
    answers(&mut head, &mut now, &zoom(2, 5), 3000);
    assert_eq!(answers(&mut head, &mut now, &memory(1, 3), 100), DONE);
    answers(&mut head, &mut now, &[0x81, 0x01, 0x06, 0x04, 0xFF], 3000);
    answers(&mut head, &mut now, &zoom(0, 0), 3000);
    assert_eq!([head.head().pan().motor_units(), i32::from(head.head().zoom_units())], [0, 0]);
    // Acknowledged at once, done when it is there: 0.62 s for 33°, 1.45 s for the zoom.
    let heard = said(&mut head, now, &memory(2, 3), 4000);
    now += 4000;
    assert_eq!(words(&heard), DONE);
    assert!(heard[0].0 < 30 && heard[1].0 > 1200, "{heard:?}");
    assert_eq!([head.head().pan().motor_units(), i32::from(head.head().zoom_units())], [0x123, 0x250]);
    assert_eq!(answers(&mut head, &mut now, &[0x81, 0x09, 0x04, 0x3F, 0xFF], 50), [[0x90, 0x50, 0x03, 0xFF]]);
    // A recall can be cancelled, and then stops on its way.
    answers(&mut head, &mut now, &HOME, 3000);
    answers(&mut head, &mut now, &memory(2, 3), 400);
    assert_eq!(answers(&mut head, &mut now, &[0x81, 0x21, 0xFF], 1000), [[0x90, 0x61, 0x04, 0xFF]]);
    assert!((1..0x123).contains(&head.head().pan().motor_units()));
    // Six places, and no seventh.
    assert_eq!(answers(&mut head, &mut now, &memory(1, 5), 100), DONE);
    assert_eq!(answers(&mut head, &mut now, &memory(1, 6), 100), [[0x90, 0x60, 0x02, 0xFF]]);
    assert_eq!(answers(&mut head, &mut now, &memory(0, 3), 100), DONE);
    assert_eq!(answers(&mut head, &mut now, &memory(2, 3), 100), [[0x90, 0x61, 0x41, 0xFF]], "it was reset");
}

#[test]
fn what_is_said_of_the_picture_is_remembered() {
    let mut head = serial(&prompt());
    let mut now = 0;
    let mut ask = |bytes: &[u8]| answers(&mut head, &mut now, bytes, 80);
    assert_eq!(ask(&[0x81, 0x01, 0x04, 0x35, 0x02, 0xFF]), DONE);
    assert_eq!(ask(&[0x81, 0x09, 0x04, 0x35, 0xFF]), [[0x90, 0x50, 0x02, 0xFF]]);
    assert_eq!(ask(&[0x81, 0x01, 0x04, 0x4B, 0, 0, 0x01, 0x01, 0xFF]), DONE);
    assert_eq!(ask(&[0x81, 0x01, 0x04, 0x0B, 0x03, 0xFF]), DONE);
    assert_eq!(ask(&[0x81, 0x09, 0x04, 0x4B, 0xFF]), [[0x90, 0x50, 0, 0, 0x01, 0x00, 0xFF]]);
    // By hand, the focus can be driven and stops where it is.
    assert_eq!(ask(&[0x81, 0x01, 0x04, 0x38, 0x10, 0xFF]), DONE);
    assert_eq!(ask(&[0x81, 0x01, 0x04, 0x08, 0x33, 0xFF]), DONE);
    assert_eq!(ask(&[0x81, 0x01, 0x04, 0x08, 0x00, 0xFF]), DONE);
    let focus = ask(&[0x81, 0x09, 0x04, 0x48, 0xFF]);
    assert!(focus[0][2] >= 1 && focus[0][2..6] != [1, 0, 0, 0], "{focus:02X?}");
}

#[test]
fn what_is_sent_while_it_gets_ready_is_not_executable() {
    let mut head = serial(&prompt());
    let mut now = 0;
    answers(&mut head, &mut now, &[0x81, 0x01, 0x04, 0x00, 0x03, 0xFF], 100);
    // As a client that says everything four times: one is done, the others must not fill the buffer.
    let on = [0x81, 0x01, 0x04, 0x00, 0x02, 0xFF];
    answers(&mut head, &mut now, &on, 50);
    for _ in 0..3 {
        assert_eq!(answers(&mut head, &mut now, &on, 20)[0], [0x90, 0x62, 0x41, 0xFF]);
    }
}

#[test]
fn malformed_packets_are_answered_as_the_manuals_say() {
    let mut head = serial(&prompt());
    let mut now = 0;
    let mut ask = |bytes: &[u8]| answers(&mut head, &mut now, bytes, 60);
    assert_eq!(ask(&[0x81, 0xFF]), [[0x90, 0x60, 0x02, 0xFF]], "nothing but a header");
    assert_eq!(ask(&[0xFF, 0xFF, 0xFF]), Vec::<Vec<u8>>::new(), "ends of nothing");
    let long = [&[0x81][..], &[0x01; 14], &[0xFF]].concat();
    assert_eq!(ask(&long), [[0x90, 0x60, 0x02, 0xFF]], "as long as a packet may be");
    let long = [&[0x81][..], &[0x01; 15], &[0xFF]].concat();
    assert_eq!(ask(&long), [[0x90, 0x60, 0x01, 0xFF]], "one byte more");
    // A packet that never ended is forgotten when the next one begins.
    assert_eq!(ask(&[0x81, 0x01, 0x06, 0x81, 0x09, 0x04, 0x00, 0xFF]), [[0x90, 0x50, 0x02, 0xFF]]);
    assert_eq!(ask(&[0x81, 0x2F, 0xFF]), [[0x90, 0x6F, 0x05, 0xFF]], "no such socket");
}

/// The answers of a head on the network to one datagram.
fn network_answers(head: &mut NetworkHead, now: &mut Time, datagram: &[u8]) -> Vec<Vec<u8>> {
    head.receive(*now, datagram);
    *now = *now + Interval::from_ms(60.0);
    std::iter::from_fn(|| head.send(*now)).collect()
}

fn datagram(kind: u16, length: usize, sequence: u32, payload: &[u8]) -> Vec<u8> {
    [&kind.to_be_bytes()[..], &(length as u16).to_be_bytes(), &sequence.to_be_bytes(), payload].concat()
}

#[test]
fn malformed_datagrams_are_answered_as_the_manuals_say() {
    let mut head = NetworkHead::new(&prompt(), 1).unwrap();
    let mut now = Time::ZERO;
    let power: &[u8] = &[0x81, 0x09, 0x04, 0x00, 0xFF];
    let error = |sequence, which| vec![datagram(0x0200, 2, sequence, &[0x0F, which])];
    let refusal = |sequence, why| vec![datagram(0x0111, 4, sequence, &[0x90, 0x60, why, 0xFF])];
    let none = Vec::<Vec<u8>>::new();
    let long = [&[0x81][..], &[0x01; 40], &[0xFF]].concat();
    type Case = (&'static str, Vec<u8>, Vec<Vec<u8>>);
    let cases: [Case; 17] = [
        ("good", datagram(0x0110, 5, 7, power), vec![datagram(0x0111, 4, 7, &[0x90, 0x50, 0x02, 0xFF])]),
        ("the same number", datagram(0x0110, 5, 7, power), error(7, 1)),
        ("a smaller number", datagram(0x0110, 5, 3, power), error(3, 1)),
        ("an unknown kind", datagram(0x0300, 5, 8, power), error(8, 2)),
        ("a reply", datagram(0x0111, 5, 8, power), error(8, 2)),
        ("a length too large", datagram(0x0110, 9, 8, power), error(8, 2)),
        ("a length too small", datagram(0x0110, 4, 8, power), error(8, 2)),
        ("nothing in it", datagram(0x0110, 0, 8, &[]), error(8, 2)),
        ("no control", datagram(0x0200, 1, 8, &[0x07]), error(8, 2)),
        ("an error", datagram(0x0200, 2, 8, &[0x0F, 0x01]), none.clone()),
        ("too long", datagram(0x0100, long.len(), 9, &long), refusal(9, 1)),
        ("no end", datagram(0x0100, 4, 10, &power[..4]), refusal(10, 2)),
        ("an end alone", datagram(0x0100, 1, 11, &[0xFF]), refusal(11, 2)),
        ("no header", datagram(0x0100, 3, 12, &[0x01, 0x04, 0xFF]), refusal(12, 2)),
        ("another head's", datagram(0x0100, 5, 13, &[0x82, 0x09, 0x04, 0x00, 0xFF]), none.clone()),
        ("less than a header", vec![0x01, 0x10, 0x00], none),
        ("good again", datagram(0x0110, 5, 14, power), vec![datagram(0x0111, 4, 14, &[0x90, 0x50, 0x02, 0xFF])]),
    ];
    for (what, sent, expected) in cases {
        assert_eq!(network_answers(&mut head, &mut now, &sent), expected, "{what}");
    }
    // Data may be any byte but the end: a flip of the picture, whose code is no header.
    let flip = datagram(0x0110, 5, 15, &[0x81, 0x09, 0x04, 0xA4, 0xFF]);
    assert_eq!(network_answers(&mut head, &mut now, &flip), [datagram(0x0111, 4, 15, &[0x90, 0x50, 0x00, 0xFF])]);
    let gain = datagram(0x0100, 8, 16, &[0x81, 0x01, 0x04, 0x43, 0x00, 0x00, 0x85, 0xFF]);
    assert_eq!(network_answers(&mut head, &mut now, &gain), refusal(16, 2));
    // The address on a network is 1, whatever is said.
    let address = datagram(0x0100, 4, 17, &[0x88, 0x30, 0x05, 0xFF]);
    assert_eq!(network_answers(&mut head, &mut now, &address).len(), 1);
    let still = datagram(0x0110, 5, 18, power);
    assert_eq!(network_answers(&mut head, &mut now, &still).len(), 1);
}

#[test]
fn each_controller_has_its_own_numbers_and_its_own_answers() {
    let mut head = NetworkHead::new(&prompt(), 1).unwrap();
    let [one, other, far] = ["10.0.0.1:5000", "10.0.0.1:52381", "10.0.0.9:5000"].map(|it| it.parse().unwrap());
    let mut now = Time::ZERO;
    let mut ask = |from, kind, sequence, payload: &[u8], ms: f64| {
        head.receive_from(now, from, &datagram(kind, payload.len(), sequence, payload));
        now = now + Interval::from_ms(ms);
        std::iter::from_fn(|| head.send_to(now)).map(|it| (it.0.unwrap(), it.1[8..].to_vec())).collect::<Vec<_>>()
    };
    let power: &[u8] = &[0x81, 0x09, 0x04, 0x00, 0xFF];
    // A move of one, and an inquiry of another while it goes: each hears what is its own.
    let heard = ask(one, 0x0100, 50, &[0x81, 0x01, 0x06, 0x02, 0x18, 0x14, 0, 3, 7, 0, 0, 0, 0, 0, 0xFF], 60.0);
    assert_eq!(heard, [(one, vec![0x90, 0x41, 0xFF])]);
    assert_eq!(ask(other, 0x0110, 2, power, 60.0), [(other, vec![0x90, 0x50, 0x02, 0xFF])], "a number of its own");
    assert_eq!(
        ask(far, 0x0110, 2, power, 3000.0),
        [(far, vec![0x90, 0x50, 0x02, 0xFF]), (one, vec![0x90, 0x51, 0xFF])]
    );
    // A host that begins anew does so with all its ports, and with nobody else's.
    assert_eq!(ask(one, 0x0200, 0, &[0x01], 10.0), [(one, vec![0x01])]);
    assert_eq!(ask(other, 0x0110, 1, power, 60.0), [(other, vec![0x90, 0x50, 0x02, 0xFF])]);
    assert_eq!(ask(far, 0x0110, 1, power, 60.0), [(far, vec![0x0F, 0x01])]);
}

#[test]
fn no_bytes_of_any_kind_end_a_head_or_keep_it_from_answering() {
    use foveate_estimation::random::Random;

    let power: &[u8] = &[0x81, 0x09, 0x04, 0x00, 0xFF];
    for seed in 0..20 {
        let mut random = Random::new(seed).fork("fuzz");
        // Half of the bytes are of those that mean something.
        let meant = [0x81, 0x88, 0xFF, 0x01, 0x09, 0x04, 0x06, 0x3F, 0x02, 0x03, 0x21, 0x30, 0x00, 0x38, 0x47];
        let bytes = |random: &mut Random| {
            let n = random.below(40);
            (0..n)
                .map(|_| match random.below(2) {
                    0 => random.below(256) as u8,
                    _ => meant[random.below(meant.len() as u32) as usize],
                })
                .collect::<Vec<u8>>()
        };
        let mut wire =
            SerialHead::new(&prompt(), &LineSettings { baud: 1e6, ..LineSettings::default() }, seed).unwrap();
        let mut network = NetworkHead::new(&prompt(), seed).unwrap();
        let mut now = Time::ZERO;
        for number in 0..400 {
            let noise = bytes(&mut random);
            wire.write(now, &noise);
            let sent = match random.below(3) {
                0 => noise.clone(),
                1 => datagram(0x0100 + 0x10 * random.below(3) as u16, noise.len(), number, &noise),
                _ => datagram(0x0100, random.below(20) as usize, number, &noise),
            };
            network.receive(now, &sent);
            now = now + Interval::from_ms(10.0);
            assert!(wire.read(now).len() < 200 && std::iter::from_fn(|| network.send(now)).count() < 20);
        }
        // Clean slate: address, commands, numbers, power. Then both answer as ever.
        for bytes in [
            &[0xFF][..],
            &[0x88, 0x30, 0x01, 0xFF],
            &[0x88, 0x01, 0x00, 0x01, 0xFF],
            &[0x81, 0x01, 0x04, 0x00, 0x02, 0xFF],
        ] {
            wire.write(now, bytes);
            now = now + Interval::from_s(4.0);
            wire.read(now);
        }
        wire.write(now, power);
        network_answers(&mut network, &mut now, &datagram(0x0200, 1, 0, &[0x01]));
        let answer = network_answers(&mut network, &mut now, &datagram(0x0110, 5, 1, power));
        assert!(answer.last().is_some_and(|it| it[8..10] == [0x90, 0x50]), "seed {seed}: {answer:02X?}");
        assert_eq!(wire.read(now), [0x90, 0x50, 0x02, 0xFF], "seed {seed}");
    }
}

#[test]
fn settings_out_of_range_are_named() {
    let mut settings = HeadSettings::default();
    settings.tilt.speeds = 0;
    let error = super::Head::new(&settings, 1).unwrap_err();
    assert_eq!(error.setting.as_deref(), Some("tilt.speeds"));
    let line = LineSettings { lost: f64::NAN, ..LineSettings::default() };
    assert_eq!(SerialHead::new(&HeadSettings::default(), &line, 1).unwrap_err().setting.as_deref(), Some("lost"));
}
