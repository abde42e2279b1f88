//! The driver against a simulated EVI-D30 over bytes in memory, on a logical clock.

use std::collections::VecDeque;

use foveate::estimation::random::Random;
use foveate::prelude::{Interval, Time};
use foveate_pan_tilt::driver::{CommandId, Driver, DriverSettings, Event, Failure, Link, Medium, What};
use foveate_pan_tilt::visca::{Answer, Command, PanDrive, Profile, Refusal, Speed, TiltDrive, Version, ZoomDrive};
use foveate_sim::head::{HeadSettings, LineSettings, SerialHead};

/// The clock goes in steps of this.
const STEP: Interval = Interval(1_000_000);

/// A driver and a head at the two ends of a line.
struct Bench {
    driver: Driver,
    head: SerialHead,
    now: Time,
    /// The adapter of the line is in its socket; otherwise the port cannot be opened.
    has_adapter: bool,
    /// Bytes of the head get lost.
    deaf: bool,
    /// Bytes of the head come so much later, at most [ms].
    late_ms: f64,
    late: VecDeque<(Time, Vec<u8>)>,
    random: Random,
    events: Vec<Event>,
    most_in_flight: usize,
}

impl Bench {
    fn with(head: &HeadSettings, line: &LineSettings, driver: DriverSettings) -> Bench {
        Bench {
            driver: Driver::new(driver, Profile::evi_d30(), Medium::Serial).unwrap(),
            head: SerialHead::new(head, line, 7).unwrap(),
            now: Time::ZERO,
            has_adapter: true,
            deaf: false,
            late_ms: 0.0,
            late: VecDeque::new(),
            random: Random::new(3),
            events: Vec::new(),
            most_in_flight: 0,
        }
    }

    /// A head as it is by default, greeted.
    fn ready() -> Bench {
        let mut bench = Bench::with(&HeadSettings::default(), &LineSettings::default(), DriverSettings::default());
        bench.run_ms(500.0);
        assert_eq!(bench.driver.link(), &Link::Ready);
        bench
    }

    fn step(&mut self) {
        self.now = self.now + STEP;
        let bytes = self.head.read(self.now);
        if !self.has_adapter {
            if self.driver.open_at().is_none() {
                self.driver.lost(self.now, "the adapter is gone");
            } else if self.driver.open_at().is_some_and(|it| self.now >= it) {
                self.driver.lost(self.now, "no such device");
            }
        } else if self.driver.open_at().is_some_and(|it| self.now >= it) {
            self.driver.opened(self.now);
        }
        if !bytes.is_empty() && !self.deaf {
            let latest = self.late.back().map_or(self.now, |it| it.0);
            let arrives = latest.max(self.now + Interval::from_ms(self.random.uniform() * self.late_ms));
            self.late.push_back((arrives, bytes));
        }
        while self.late.front().is_some_and(|it| it.0 <= self.now) {
            let (_, bytes) = self.late.pop_front().unwrap();
            self.driver.receive(self.now, &bytes);
        }
        // The promise of `wake`: nothing is due before it.
        let due = self.driver.wake().is_none_or(|it| it <= self.now);
        let mut n_frames = 0;
        while let Some(frame) = self.driver.poll(self.now) {
            self.head.write(self.now, &frame.0);
            n_frames += 1;
        }
        assert!(n_frames <= 1, "one message at a time");
        assert!(due || n_frames == 0, "a message before its time");
        self.most_in_flight = self.most_in_flight.max(self.driver.in_flight());
        self.events.extend(std::iter::from_fn(|| self.driver.next_event()));
    }

    fn run_ms(&mut self, milliseconds: f64) {
        let end = self.now + Interval::from_ms(milliseconds);
        while self.now < end {
            self.step();
        }
    }

    fn command(&mut self, command: Command) -> CommandId {
        self.driver.command(self.now, command).unwrap()
    }

    /// Go there as fast as possible.
    fn go(&mut self, pan: i32, tilt: i32) -> CommandId {
        self.command(Command::Absolute { pan, tilt, speed: Speed { pan: 24, tilt: 20 } })
    }

    fn stands_at(&self) -> [i32; 2] {
        [self.head.head().pan().motor_units(), self.head.head().tilt().motor_units()]
    }

    /// Runs until the head stands there, and fails after 20 s.
    #[track_caller]
    fn reaches(&mut self, pan: i32, tilt: i32) {
        let end = self.now + Interval::from_s(20.0);
        while !(self.stands_at() == [pan, tilt] && self.head.head().is_at_rest() && self.driver.is_idle()) {
            let (found, link) = (self.stands_at(), self.driver.link());
            assert!(self.now < end, "stands at {found:?}, expected {pan}, {tilt}; the link is {link:?}");
            self.step();
        }
    }

    /// When something was first reported.
    #[track_caller]
    fn at(&self, which: impl Fn(&What) -> bool) -> Time {
        self.events.iter().find(|it| which(&it.what)).expect("it was reported").at
    }
}

fn is_sent(id: CommandId) -> impl Fn(&What) -> bool {
    move |what| matches!(what, What::Sent { id: it, .. } if *it == id)
}

#[test]
fn a_head_is_greeted_and_tells_what_it_is() {
    let bench = Bench::ready();
    let version = Version { vendor: 0x0020, model: 0x0402, rom: 0x0121, sockets: 2 };
    bench.at(|what| matches!(what, What::Answered { answer: Answer::Version(it), .. } if *it == version));
    let links: Vec<_> = bench.events.iter().filter(|it| matches!(it.what, What::Link(_))).map(|it| &it.what).collect();
    assert_eq!(links, [&What::Link(Link::Greeting), &What::Link(Link::Ready)]);
}

#[test]
fn a_command_takes_its_time_on_the_line_and_in_the_mechanics() {
    let mut bench = Bench::ready();
    let id = bench.go(176, -60);
    bench.reaches(176, -60);
    let sent = bench.at(is_sent(id));
    let taken = bench.at(|it| matches!(it, What::Acknowledged { id: it, .. } if *it == id)) - sent;
    // 15 bytes there, a field at most, 3 bytes back.
    assert!((18.0..40.0).contains(&taken.as_ms()), "{} ms", taken.as_ms());
    let done = bench.at(|it| matches!(it, What::Completed { id: it } if *it == id)) - sent;
    // 250 to 270 ms of latency; 20° at 80°/s with 400°/s² take 0.45 s.
    assert!((715.0..800.0).contains(&done.as_ms()), "{} ms", done.as_ms());
    let seen = bench.events.iter().filter_map(|it| match it.what {
        What::Answered { answer: Answer::Position { pan, tilt }, asked_at } => Some((pan, tilt, it.at - asked_at)),
        _ => None,
    });
    let seen: Vec<_> = seen.collect();
    assert!(seen.iter().any(|it| (1..176).contains(&it.0)), "it is seen on its way");
    assert!(seen.iter().all(|it| (15.0..40.0).contains(&it.2.as_ms())), "{seen:?}");
}

#[test]
fn commands_at_30_hz_for_a_minute_never_overflow_the_head() {
    for (rate_hz, least_sent) in [(15.0, 850), (30.0, 850), (200.0, 850)] {
        let mut bench = Bench::ready();
        let n = (60.0 * rate_hz) as u32;
        let mut last = [0, 0];
        for index in 0..n {
            let phase = f64::from(index) / rate_hz;
            last = [(300.0 * phase.sin()) as i32, (100.0 * (1.3 * phase).cos()) as i32];
            bench.go(last[0], last[1]);
            bench.run_ms(1000.0 / rate_hz);
        }
        let counts = bench.driver.counts();
        assert_eq!((bench.head.head().n_refused_full(), counts.buffer_full, counts.unanswered), (0, 0, 0), "{rate_hz}");
        assert!(bench.most_in_flight <= 2);
        assert!(counts.sent >= least_sent, "{rate_hz} Hz: {} of {n} were sent", counts.sent);
        bench.reaches(last[0], last[1]);
        let counts = bench.driver.counts();
        assert_eq!(counts.sent + counts.replaced, counts.given + counts.corrected, "every command is sent or replaced");
    }
}

#[test]
fn the_head_follows_with_the_latency_of_its_mechanics() {
    let mut bench = Bench::ready();
    let (mut worst, mut sum, mut n) = (0.0f64, 0.0, 0);
    for index in 0..300 {
        let at = |seconds: f64| 200.0 * (0.8 * seconds).sin();
        let seconds = f64::from(index) / 30.0;
        bench.go(at(seconds).round() as i32, 0);
        bench.run_ms(1000.0 / 30.0);
        if index > 30 {
            // What was commanded 300 ms before.
            let error =
                (bench.head.head().pan().angle_rad().to_degrees() * 8.8 - at(seconds + 1.0 / 30.0 - 0.30)).abs();
            worst = worst.max(error);
            sum += error;
            n += 1;
        }
    }
    let mean_deg = sum / f64::from(n) / 8.8;
    assert!(mean_deg < 1.0 && worst / 8.8 < 3.0, "{mean_deg}° on average, {}° at worst", worst / 8.8);
}

#[test]
fn thousands_of_commands_over_a_bad_line_end_where_the_last_one_says() {
    for seed in 0..4 {
        let mut bench = Bench::with(&HeadSettings::default(), &LineSettings::default(), DriverSettings::default());
        bench.random = Random::new(seed);
        let bad = LineSettings { lost: 0.004, flipped: 0.004, inserted: 0.004, ..LineSettings::default() };
        bench.head.set_line(&bad).unwrap();
        let mut last = [0, 0];
        for index in 0..2000 {
            let mut draw = |reach: f64| (bench.random.uniform_in(-reach, reach)).round() as i32;
            last = [draw(880.0), draw(300.0)];
            bench.go(last[0], last[1]);
            let pause = bench.random.uniform_in(5.0, 90.0);
            bench.run_ms(pause);
            match (index + 97 * seed) % 500 {
                100 => bench.head.set_plugged(false),
                130 => bench.head.set_plugged(true),
                200 => bench.has_adapter = false,
                230 => bench.has_adapter = true,
                300 => bench.late_ms = 300.0,
                360 => bench.late_ms = 0.0,
                400 => bench.head.head_mut().power_cycle(),
                _ => {}
            }
        }
        bench.head.set_plugged(true);
        (bench.has_adapter, bench.late_ms) = (true, 0.0);
        bench.head.set_line(&LineSettings::default()).unwrap();
        bench.reaches(last[0], last[1]);
        let counts = bench.driver.counts();
        assert!(counts.unanswered > 100 && counts.garbage_bytes > 100, "the line was bad: {counts:?}");
        assert!(counts.sent > 500 && counts.lost_events == 0, "and yet: {counts:?}");
        assert!(bench.most_in_flight <= 2);
    }
}

#[test]
fn a_command_that_arrives_changed_is_given_again() {
    let mut bench = Bench::ready();
    // A command that the driver does not know of, as if a digit had been changed on the line.
    bench.go(400, 0);
    bench.reaches(400, 0);
    bench.head.write(bench.now, &[0x81, 0x01, 0x06, 0x02, 0x18, 0x14, 0, 0, 9, 0, 0, 0, 0, 0, 0xFF]);
    bench.run_ms(1000.0);
    assert_ne!(bench.stands_at(), [400, 0]);
    bench.run_ms(1500.0);
    bench.reaches(400, 0);
    assert_eq!(bench.driver.counts().corrected, 1);
}

#[test]
fn a_head_that_keeps_commands_until_they_are_done_gets_the_newest_all_the_same() {
    let slow = HeadSettings { supersedes: false, ..HeadSettings::default() };
    let mut bench = Bench::with(&slow, &LineSettings::default(), DriverSettings::default());
    bench.run_ms(500.0);
    for index in 0..90 {
        bench.go(if index % 2 == 0 { 880 } else { -880 }, 0);
        bench.run_ms(33.0);
    }
    let id = bench.go(50, 20);
    let given = bench.now;
    bench.reaches(50, 20);
    // Not the seconds that the ones before it would take from end to end.
    let waited = bench.at(is_sent(id)) - given;
    assert!(waited.as_ms() < 700.0, "{} ms", waited.as_ms());
    assert_eq!(bench.driver.counts().buffer_full, 0);
}

#[test]
fn a_full_buffer_is_waited_for_and_cleared() {
    let slow = HeadSettings { take_up_ms: 1000.0, ..HeadSettings::default() };
    let mut bench = Bench::with(&slow, &LineSettings::default(), DriverSettings::default());
    bench.run_ms(500.0);
    // Another controller fills both sockets; its replies are not received.
    bench.deaf = true;
    bench.head.write(bench.now, &[0x81, 0x01, 0x06, 0x04, 0xFF, 0x81, 0x01, 0x06, 0x05, 0xFF]);
    bench.run_ms(80.0);
    bench.deaf = false;
    bench.go(-100, 0);
    bench.reaches(-100, 0);
    assert!(bench.driver.counts().buffer_full > 0);
    assert!(bench.now < Time::from_s(4.0), "{}", bench.now);
}

#[test]
fn late_answers_do_not_confuse_the_book() {
    let mut bench = Bench::ready();
    bench.late_ms = 400.0;
    for index in 0..200 {
        bench.go(index, -index);
        bench.run_ms(40.0);
        assert!(bench.driver.in_flight() <= 2);
    }
    bench.late_ms = 0.0;
    bench.reaches(199, -199);
}

#[test]
fn a_head_that_is_always_slow_is_waited_for() {
    let slow = HeadSettings { field_ms: 300.0, ..HeadSettings::default() };
    let mut bench = Bench::with(&slow, &LineSettings::default(), DriverSettings::default());
    bench.run_ms(8000.0);
    assert_eq!(bench.driver.link(), &Link::Ready);
    let before = bench.driver.counts().unanswered;
    bench.go(100, 100);
    bench.reaches(100, 100);
    bench.run_ms(5000.0);
    assert!(bench.driver.counts().unanswered <= before + 1, "its pace is known now");
}

#[test]
fn an_unplugged_head_is_reported_and_then_gets_the_last_command() {
    let mut bench = Bench::ready();
    bench.go(200, 0);
    bench.reaches(200, 0);
    bench.head.set_plugged(false);
    bench.run_ms(3000.0);
    assert_eq!(bench.driver.link(), &Link::Silent);
    bench.go(100, 0);
    bench.go(-300, 50);
    bench.run_ms(3000.0);
    bench.head.set_plugged(true);
    bench.reaches(-300, 50);

    bench.has_adapter = false;
    bench.run_ms(100.0);
    assert_eq!(bench.driver.link(), &Link::Closed("the adapter is gone".to_owned()));
    bench.run_ms(3000.0);
    assert_eq!(bench.driver.link(), &Link::Closed("no such device".to_owned()));
    bench.go(10, 10);
    bench.has_adapter = true;
    bench.reaches(10, 10);
}

#[test]
fn a_head_that_was_switched_off_and_on_goes_back_to_where_it_was_told() {
    let mut bench = Bench::ready();
    bench.go(500, 100);
    bench.reaches(500, 100);
    bench.head.head_mut().power_cycle();
    bench.run_ms(1000.0);
    assert_eq!(bench.stands_at(), [0, 0]);
    // For three seconds it refuses: that is no failure of the command.
    bench.reaches(500, 100);
    assert!(!bench.events.iter().any(|it| matches!(it.what, What::Failed { .. })));
}

#[test]
fn garbage_is_called_garbage() {
    let mut driver = Driver::new(DriverSettings::default(), Profile::evi_d30(), Medium::Serial).unwrap();
    driver.opened(Time::ZERO);
    let mut random = Random::new(1);
    for millisecond in 1..2000 {
        let now = Time(millisecond * STEP.0);
        driver.poll(now);
        driver.receive(now, &[(random.below(256) & 0x7E) as u8]);
    }
    assert_eq!(driver.link(), &Link::Garbled);
    assert!(driver.counts().garbage_bytes > 1000);
}

#[test]
fn an_address_beyond_the_end_of_the_line_is_reported() {
    let third = DriverSettings { address: 3, ..DriverSettings::default() };
    let mut bench = Bench::with(&HeadSettings::default(), &LineSettings::default(), third);
    bench.run_ms(1000.0);
    assert_eq!(bench.driver.link(), &Link::NoSuchHead { heads: 1 });
}

#[test]
fn what_may_not_be_done_twice_is_not() {
    let mut bench = Bench::ready();
    let id = bench.command(Command::Relative { pan: 10, tilt: 0, speed: Speed { pan: 24, tilt: 20 } });
    // The head hears it; what it says gets lost.
    bench.deaf = true;
    bench.run_ms(250.0);
    bench.deaf = false;
    bench.run_ms(3000.0);
    bench.at(|it| *it == What::Failed { id, why: Failure::Unanswered });
    assert_eq!(bench.stands_at(), [10, 0]);
    assert_eq!(bench.driver.counts().sent, 1);
}

#[test]
fn a_drive_is_not_resumed_after_the_line_was_cut() {
    let mut bench = Bench::ready();
    let speed = Speed { pan: 3, tilt: 3 };
    let id = bench.command(Command::Drive { pan: PanDrive::Right, tilt: TiltDrive::Stop, speed });
    bench.run_ms(1000.0);
    assert!(bench.stands_at()[0] > 20, "it moves");
    bench.head.set_plugged(false);
    bench.run_ms(2000.0);
    bench.head.set_plugged(true);
    bench.run_ms(3000.0);
    assert_eq!(bench.driver.link(), &Link::Ready);
    let stood = bench.stands_at();
    bench.run_ms(2000.0);
    assert_eq!(bench.stands_at(), stood);
    bench.at(|it| *it == What::Failed { id, why: Failure::Interrupted });
}

#[test]
fn a_drive_goes_until_it_is_stopped() {
    let mut bench = Bench::ready();
    let speed = Speed { pan: 12, tilt: 10 };
    bench.command(Command::Drive { pan: PanDrive::Left, tilt: TiltDrive::Up, speed });
    bench.run_ms(1285.0);
    bench.command(Command::Drive { pan: PanDrive::Stop, tilt: TiltDrive::Stop, speed });
    bench.run_ms(1000.0);
    let [pan, tilt] = bench.stands_at();
    // 40°/s and 25°/s for about 1.28 s, less the time to get to speed, plus the time to stop.
    assert!((-500..-400).contains(&pan) && tilt == 300, "{pan} {tilt}");
    assert!(bench.head.head().is_at_rest());
}

#[test]
fn zoom_and_motors_go_on_beside_each_other() {
    let settings = DriverSettings { zoom_every_ms: 200.0, ..DriverSettings::default() };
    let mut bench = Bench::with(&HeadSettings::default(), &LineSettings::default(), settings);
    bench.run_ms(500.0);
    bench.command(Command::ZoomDirect(800));
    bench.go(300, 100);
    bench.run_ms(250.0);
    assert_eq!(bench.driver.in_flight(), 2);
    bench.go(-300, 0);
    bench.reaches(-300, 0);
    assert_eq!(bench.head.head().zoom_units(), 800);
    bench.run_ms(500.0);
    bench.at(|it| matches!(it, What::Answered { answer: Answer::Zoom(800), .. }));
    bench.command(Command::Zoom(ZoomDrive::Wide(Some(7))));
    bench.run_ms(4000.0);
    assert_eq!(bench.head.head().zoom_units(), 0);
}

#[test]
fn a_refusal_is_reported_with_its_reason() {
    let mut bench = Bench::ready();
    let id = bench.command(Command::FocusDirect(0x2000));
    bench.run_ms(200.0);
    bench.at(|it| *it == What::Failed { id, why: Failure::Refused(Refusal::NotExecutable) });
    bench.command(Command::FocusAuto(false));
    bench.run_ms(200.0);
    let id = bench.command(Command::FocusDirect(0x2000));
    bench.run_ms(500.0);
    bench.at(|it| *it == What::Completed { id });
    // What the model has no room for never gets to the line.
    let error = bench.driver.command(bench.now, Command::ZoomDirect(0x0400)).unwrap_err();
    assert_eq!(error.to_string(), "zoom is 1024, expected 0 to 1023");
}

#[test]
fn a_place_behind_a_limit_is_given_up_and_said_so() {
    let mut bench = Bench::ready();
    // Set by another controller.
    bench.head.write(bench.now, &[0x81, 0x01, 0x06, 0x07, 0x00, 0x01, 0, 0, 6, 4, 0, 0, 6, 4, 0xFF]);
    bench.run_ms(100.0);
    let id = bench.go(300, 0);
    bench.run_ms(20_000.0);
    bench.at(|it| *it == What::Failed { id, why: Failure::NotReached(100, 0) });
    assert_eq!(bench.driver.counts().corrected, 10);
}

#[test]
fn the_same_seed_gives_the_same_events() {
    let run = || {
        let bad = LineSettings { lost: 0.01, flipped: 0.01, inserted: 0.01, ..LineSettings::default() };
        let mut bench = Bench::with(&HeadSettings::default(), &bad, DriverSettings::default());
        for index in 0..100 {
            bench.go(index * 5, -index);
            bench.run_ms(40.0);
        }
        (bench.events, bench.head.head().pan().angle_rad())
    };
    assert_eq!(run(), run());
}
