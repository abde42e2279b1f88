//! The driver against a simulated head over a bad network in memory, on a logical clock: VISCA over IP.

use foveate::estimation::random::Random;
use foveate::prelude::{Interval, Time};
use foveate_pan_tilt::driver::{Driver, DriverSettings, Event, Link, Medium, What};
use foveate_pan_tilt::visca::{Answer, Command, Profile, Speed};
use foveate_sim::head::{HeadSettings, NetworkHead};

/// A network that loses and delays.
struct Network {
    lost: f64,
    delay_ms: f64,
    random: Random,
    /// When they arrive, in no order.
    on_the_way: Vec<(Time, Vec<u8>)>,
}

impl Network {
    fn new(lost: f64, delay_ms: f64, seed: u64) -> Network {
        Network { lost, delay_ms, random: Random::new(seed), on_the_way: Vec::new() }
    }

    fn send(&mut self, now: Time, datagram: Vec<u8>) {
        if self.random.uniform() >= self.lost {
            let delay = Interval::from_ms(self.random.uniform() * self.delay_ms);
            self.on_the_way.push((now + delay, datagram));
        }
    }

    fn arrived(&mut self, now: Time) -> Vec<Vec<u8>> {
        let mut due: Vec<_> = self.on_the_way.extract_if(.., |it| it.0 <= now).collect();
        due.sort_by_key(|it| it.0);
        due.into_iter().map(|it| it.1).collect()
    }
}

struct Bench {
    driver: Driver,
    head: NetworkHead,
    there: Network,
    back: Network,
    now: Time,
    events: Vec<Event>,
}

impl Bench {
    fn new(lost: f64, delay_ms: f64, seed: u64) -> Bench {
        let mut driver = Driver::new(DriverSettings::default(), Profile::evi_d30(), Medium::Ip).unwrap();
        driver.opened(Time::ZERO);
        Bench {
            driver,
            head: NetworkHead::new(&HeadSettings::default(), seed).unwrap(),
            there: Network::new(lost, delay_ms, seed),
            back: Network::new(lost, delay_ms, seed + 1000),
            now: Time::ZERO,
            events: Vec::new(),
        }
    }

    fn run_ms(&mut self, milliseconds: u32) {
        for _ in 0..milliseconds {
            self.now = self.now + Interval::from_ms(1.0);
            for datagram in self.there.arrived(self.now) {
                self.head.receive(self.now, &datagram);
            }
            while let Some(datagram) = self.head.send(self.now) {
                self.back.send(self.now, datagram);
            }
            for datagram in self.back.arrived(self.now) {
                self.driver.receive(self.now, &datagram);
            }
            while let Some(frame) = self.driver.poll(self.now) {
                self.there.send(self.now, frame.0);
            }
            assert!(self.driver.in_flight() <= 2);
            self.events.extend(std::iter::from_fn(|| self.driver.next_event()));
        }
    }

    fn go(&mut self, pan: i32, tilt: i32) {
        self.driver.command(self.now, Command::Absolute { pan, tilt, speed: Speed { pan: 24, tilt: 20 } }).unwrap();
    }

    #[track_caller]
    fn reaches(&mut self, pan: i32, tilt: i32) {
        for _ in 0..400 {
            self.run_ms(50);
            let stands = [self.head.head().pan().motor_units(), self.head.head().tilt().motor_units()];
            if stands == [pan, tilt] && self.head.head().is_at_rest() {
                return;
            }
        }
        panic!("not at {pan}, {tilt} after 20 s; the link is {:?}", self.driver.link());
    }
}

#[test]
fn a_good_network_carries_every_command() {
    let mut bench = Bench::new(0.0, 3.0, 1);
    bench.run_ms(500);
    assert_eq!(bench.driver.link(), &Link::Ready);
    for index in 0..300 {
        bench.go(index, 0);
        bench.run_ms(33);
    }
    bench.reaches(299, 0);
    let counts = bench.driver.counts();
    assert_eq!((counts.unanswered, counts.stray, counts.buffer_full, counts.corrected), (0, 0, 0, 0));
    assert!(counts.sent > 250, "{}", counts.sent);
}

#[test]
fn loss_and_overtaking_change_nothing_in_the_end() {
    for seed in 0..6 {
        let mut bench = Bench::new(0.15, 60.0, seed);
        for index in 0..500 {
            bench.go((index * 37) % 800 - 400, (index * 11) % 500 - 250);
            bench.run_ms(33);
        }
        let last = [(499 * 37) % 800 - 400, (499 * 11) % 500 - 250];
        bench.reaches(last[0], last[1]);
        let counts = bench.driver.counts();
        // There and back takes 70 ms, and 0.28 / 0.72 times on average a time-out of 200 ms comes before it: some 110 exchanges in
        // 16.5 s, every second one a question.
        assert!(counts.sent > 35, "seed {seed}: {counts:?}");
    }
}

#[test]
fn a_head_that_begins_to_count_anew_is_noticed() {
    let mut bench = Bench::new(0.0, 1.0, 1);
    bench.run_ms(500);
    bench.go(100, 0);
    bench.reaches(100, 0);
    // Another controller was there, and its numbers are ahead.
    let inquiry = [0x01, 0x10, 0x00, 0x05, 0x10, 0x00, 0x00, 0x00, 0x81, 0x09, 0x04, 0x00, 0xFF];
    bench.head.receive(bench.now, &inquiry);
    bench.go(-100, 0);
    bench.reaches(-100, 0);
    bench.run_ms(500);
    assert_eq!(bench.driver.link(), &Link::Ready);
    let is_seen =
        |it: &Event| matches!(it.what, What::Answered { answer: Answer::Position { pan: -100, tilt: 0 }, .. });
    assert!(bench.events.iter().any(is_seen));
}
