//! The simulated head against the manuals: bytes there, bytes back, and when.

use foveate_messages::{Interval, Time};

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
    assert_eq!(ask(&[1, 0, 0, 9, 0, 0, 0, 2, 0xFF]).0, Vec::<Vec<u8>>::new());
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
