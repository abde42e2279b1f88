//! Whatever comes over the line: nothing panics, nothing locks up.

use foveate::prelude::{Interval, Time};
use foveate_pan_tilt::driver::{Driver, DriverSettings, Link, Medium};
use foveate_pan_tilt::visca::{Address, Command, Format, Packet, Profile, Reply, Request, Speed};
use foveate_sim::head::{Head, HeadSettings, LineSettings, NetworkHead, SerialHead, Tag};
use proptest::prelude::*;

/// What happens to a driver.
#[derive(Debug, Clone)]
enum Deed {
    Bytes(Vec<u8>),
    Pass(u32),
    Go(i32, i32),
    Lose,
    Open,
}

/// Bytes that look like replies more often than chance would have it.
fn bytes() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![Just(0x90), Just(0xFF), 0x40..0x70u8, 0..0x10u8, any::<u8>()];
    prop::collection::vec(byte, 0..30)
}

fn deeds() -> impl Strategy<Value = Vec<Deed>> {
    let deed = prop_oneof![
        4 => bytes().prop_map(Deed::Bytes),
        4 => (1u32..400).prop_map(Deed::Pass),
        3 => (-880..=880i32, -300..=300i32).prop_map(|(pan, tilt)| Deed::Go(pan, tilt)),
        1 => Just(Deed::Lose),
        1 => Just(Deed::Open),
    ];
    prop::collection::vec(deed, 0..80)
}

proptest! {
    // Each runs for seconds of a head's time.
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_driver_lives_through_everything_and_then_works(deeds in deeds(), ip in any::<bool>()) {
        let medium = if ip { Medium::Ip } else { Medium::Serial };
        let mut driver = Driver::new(DriverSettings::default(), Profile::evi_d30(), medium).unwrap();
        let mut now = Time::ZERO;
        for deed in deeds {
            match deed {
                Deed::Bytes(bytes) => driver.receive(now, &bytes),
                Deed::Pass(milliseconds) => now = now + Interval::from_ms(f64::from(milliseconds)),
                Deed::Go(pan, tilt) => {
                    driver.command(now, Command::Absolute { pan, tilt, speed: Speed { pan: 24, tilt: 20 } }).unwrap();
                }
                Deed::Lose => driver.lost(now, "by chance"),
                Deed::Open => driver.opened(now),
            }
            prop_assert!(driver.poll(now).is_none() || driver.poll(now).is_none(), "one message at a time");
            prop_assert!(driver.in_flight() <= 2);
            while driver.next_event().is_some() {}
        }
        // After all that, a good head.
        let mut serial = SerialHead::new(&HeadSettings::default(), &LineSettings::default(), 1).unwrap();
        let mut network = NetworkHead::new(&HeadSettings::default(), 1).unwrap();
        let start = now;
        driver.opened(now);
        for _ in 0..6000 {
            now = now + Interval::from_ms(1.0);
            let head_now = Time((now - start).0);
            if ip {
                while let Some(datagram) = network.send(head_now) {
                    driver.receive(now, &datagram);
                }
            } else {
                driver.receive(now, &serial.read(head_now));
            }
            while let Some(frame) = driver.poll(now) {
                if ip { network.receive(head_now, &frame.0) } else { serial.write(head_now, &frame.0) }
            }
        }
        prop_assert_eq!(driver.link(), &Link::Ready);
        prop_assert!(driver.is_idle(), "nothing is left over");
    }
}

proptest! {
    #[test]
    fn a_simulated_head_lives_through_everything_and_then_answers(stream in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut head = Head::new(&HeadSettings::default(), 1).unwrap();
        for (index, byte) in stream.iter().enumerate() {
            head.advance(Time(index as i64 * 1_000_000));
            head.receive(Tag::default(), *byte);
        }
        head.advance(Time::from_s(10.0));
        while head.send().is_some() {}
        // The end of whatever was begun, then a broadcast, which every head hears.
        [0xFF, 0x88, 0x30, 0x01, 0xFF].into_iter().for_each(|byte| head.receive(Tag::default(), byte));
        head.advance(Time::from_s(10.2));
        let replies: Vec<_> = std::iter::from_fn(|| head.send()).map(|it| it.bytes).collect();
        prop_assert!(replies.contains(&vec![0x88, 0x30, 0x02, 0xFF]), "{:02X?}", replies);
    }

    #[test]
    fn any_packet_is_read_or_not(bytes in bytes()) {
        if let Some(packet) = Packet::from_bytes(&bytes) {
            let _ = Reply::decode(&packet, 1);
            for format in [Format::EVI, Format::BRC] {
                if let Some(request) = Request::decode(&packet, format) {
                    let written = request.encode(Address::FIRST, format).unwrap();
                    prop_assert_eq!(Request::decode(&written, format), Some(request));
                }
            }
        }
    }
}
