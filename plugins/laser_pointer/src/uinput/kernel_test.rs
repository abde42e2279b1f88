//! `uinput` with the kernel's own device: what readers of `/dev/input` get. tests/uinput/run.sh runs it in a virtual machine,
//! with `FOVEATE_UINPUT` set: elsewhere these tests pass without a device, for on a desktop they would click.

#![allow(unsafe_code, reason = "asks the kernel for the range of an axis")]

use std::fs::{File, OpenOptions, read_dir, read_to_string};
use std::io::{ErrorKind, Read};
use std::os::fd::AsRawFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;

use nalgebra::{Point2, Vector2};

use super::*;

/// The file of the input device called `name`, when the kernel has made it.
fn event_file(name: &str) -> Option<PathBuf> {
    let named = |it: &PathBuf| read_to_string(it.join("device/name")).is_ok_and(|it| it.trim() == name);
    let mut all = read_dir("/sys/class/input").unwrap().map(|it| it.unwrap().path());
    let found = all.find(|it| it.file_name().unwrap().to_str().unwrap().starts_with("event") && named(it))?;
    Some(PathBuf::from("/dev/input").join(found.file_name().unwrap()))
}

struct Listener {
    file: File,
}

impl Listener {
    fn of(name: &str) -> Listener {
        for _ in 0..100 {
            if let Some(path) = event_file(name)
                && let Ok(file) = OpenOptions::new().read(true).custom_flags(libc::O_NONBLOCK).open(path)
            {
                return Listener { file };
            }
            sleep(Duration::from_millis(50));
        }
        panic!("no input device `{name}`");
    }

    /// All events that are there.
    fn take(&mut self) -> Vec<Event> {
        const SIZE: usize = size_of::<libc::input_event>();
        let (mut all, mut buffer) = (Vec::new(), [0; 64 * SIZE]);
        loop {
            let n = match self.file.read(&mut buffer) {
                Ok(n) => n,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return all,
                Err(error) => panic!("{error}"),
            };
            for event in buffer[..n].chunks_exact(SIZE) {
                let [a, b, c, d, value @ ..]: [u8; 8] = event[SIZE - 8..].try_into().unwrap();
                let [kind, code] = [[a, b], [c, d]].map(u16::from_ne_bytes);
                all.push(Event { kind, code, value: i32::from_ne_bytes(value) });
            }
        }
    }

    /// Maximum and resolution of an axis.
    fn axis(&self, code: u16) -> (i32, i32) {
        let mut info = libc::input_absinfo { value: 0, minimum: -1, maximum: 0, fuzz: 0, flat: 0, resolution: 0 };
        let request = libc::_IOR::<libc::input_absinfo>(u32::from(b'E'), 0x40 + u32::from(code));
        // SAFETY: the kernel writes one struct of that size.
        let code = unsafe { libc::ioctl(self.file.as_raw_fd(), request, std::ptr::from_mut(&mut info)) };
        assert_eq!((code, info.minimum), (0, 0));
        (info.maximum, info.resolution)
    }
}

/// A wall of 4 m by 2 m, where there is a device to be tried.
fn bench(name: &str, mode: Mode) -> Option<NodeBench<Uinput>> {
    std::env::var_os("FOVEATE_UINPUT")?;
    println!("UINPUT tries {name}");
    let volume_m = Some([[0.0, 0.0, -0.1], [4.0, 2.0, 0.1]]);
    let setup = Setup { volume_m, purpose: Purpose::Run, ..Setup::for_tests() };
    let settings = UinputSettings { name: name.to_owned(), mode, slots: 3, ..Default::default() };
    Some(NodeBench::with_setup(settings, &setup).unwrap())
}

fn pointer(id: u32, x: f64, y: f64, is_pressed: bool) -> Pointer {
    Pointer {
        id: TargetId(id),
        user: None,
        position: Point2::origin(),
        velocity: Vector2::zeros(),
        predicted: Point2::new(x, y),
        sigma: 0.001,
        is_pressed,
        is_resting: false,
        is_seen: true,
    }
}

fn feed(bench: &mut NodeBench<Uinput>, ms: f64, list: Vec<Pointer>) {
    let time = Time::ZERO + Interval::from_ms(ms);
    bench.feed(&POINTERS, time, Pointers { time, shown_at: time, list, ..Pointers::default() }).unwrap();
}

#[test]
fn fingers_come_out_of_the_kernel() {
    let name = "Foveate touch test";
    let Some(mut bench) = bench(name, Mode::Touch) else { return };
    let mut listener = Listener::of(name);
    assert_eq!(listener.axis(ABS_MT_POSITION_X), (40_000, 10));
    assert_eq!(listener.axis(ABS_Y), (20_000, 10));
    assert_eq!((listener.axis(ABS_MT_SLOT).0, listener.axis(ABS_MT_TRACKING_ID).0), (2, 65_535));
    let of = |part: &str| {
        let path = event_file(name).unwrap();
        let path = PathBuf::from("/sys/class/input").join(path.file_name().unwrap()).join("device").join(part);
        read_to_string(path).unwrap().trim().to_owned()
    };
    assert_eq!(of("properties"), "2", "a touch screen, of which libinput asks INPUT_PROP_DIRECT");
    assert_eq!(of("capabilities/abs"), "260800000000003");
    feed(&mut bench, 0.0, vec![pointer(1, 1.0, 0.5, true), pointer(2, 3.0, 1.5, true)]);
    feed(&mut bench, 20.0, vec![pointer(1, 1.1, 0.5, true), pointer(2, 3.0, 1.5, true)]);
    feed(&mut bench, 40.0, vec![pointer(2, 3.0, 1.5, true)]);
    sleep(Duration::from_millis(50));
    let abs = Event::abs;
    // What stays as it is, as slot 0 at the start and `ABS_Y`, the kernel does not say again.
    let expected = [
        abs(ABS_MT_TRACKING_ID, 0),
        abs(ABS_MT_POSITION_X, 10_000),
        abs(ABS_MT_POSITION_Y, 5000),
        abs(ABS_MT_SLOT, 1),
        abs(ABS_MT_TRACKING_ID, 1),
        abs(ABS_MT_POSITION_X, 30_000),
        abs(ABS_MT_POSITION_Y, 15_000),
        Event::key(BTN_TOUCH, true),
        abs(ABS_X, 10_000),
        abs(ABS_Y, 5000),
        Event::REPORT,
        abs(ABS_MT_SLOT, 0),
        abs(ABS_MT_POSITION_X, 11_000),
        abs(ABS_X, 11_000),
        Event::REPORT,
        abs(ABS_MT_TRACKING_ID, -1),
        abs(ABS_X, 30_000),
        abs(ABS_Y, 15_000),
        Event::REPORT,
    ];
    assert_eq!(listener.take(), expected);
    feed(&mut bench, 60.0, Vec::new());
    sleep(Duration::from_millis(50));
    let lifted = [abs(ABS_MT_SLOT, 1), abs(ABS_MT_TRACKING_ID, -1), Event::key(BTN_TOUCH, false), Event::REPORT];
    assert_eq!(listener.take(), lifted);
    let report = bench.finish().unwrap();
    assert_eq!((report.figures["uinput.frames"], report.figures["uinput.failed"]), (4.0, 0.0));
    sleep(Duration::from_millis(100));
    assert_eq!(event_file(name), None, "the device goes with the run");
}

#[test]
fn the_cursor_comes_out_of_the_kernel_and_a_reader_that_sleeps_holds_nothing_up() {
    let name = "Foveate pointer test";
    let Some(mut bench) = bench(name, Mode::Pointer) else { return };
    let mut listener = Listener::of(name);
    feed(&mut bench, 0.0, vec![pointer(1, 2.0, 1.0, false)]);
    feed(&mut bench, 20.0, vec![pointer(1, 2.0, 1.0, true)]);
    sleep(Duration::from_millis(50));
    let expected = [
        Event::abs(ABS_X, 20_000),
        Event::abs(ABS_Y, 10_000),
        Event::REPORT,
        Event::key(BTN_LEFT, true),
        Event::REPORT,
    ];
    assert_eq!(listener.take(), expected);
    // Ten thousand moves that nobody reads.
    let begun = std::time::Instant::now();
    for step in 0..10_000 {
        feed(&mut bench, 40.0 + 10.0 * f64::from(step), vec![pointer(1, 1e-4 * f64::from(step), 1.0, true)]);
    }
    assert!(begun.elapsed() < Duration::from_secs(30), "{:?}", begun.elapsed());
    feed(&mut bench, 200_000.0, Vec::new());
    sleep(Duration::from_millis(50));
    let got = listener.take();
    const SYN_DROPPED: u16 = 3;
    assert!(got.iter().any(|it| (it.kind, it.code) == (EV_SYN, SYN_DROPPED)), "the kernel says what it threw away");
    assert!(got.contains(&Event::key(BTN_LEFT, false)), "and the button is up: {got:?}");
    assert_eq!(bench.finish().unwrap().figures["uinput.failed"], 0.0);
}
