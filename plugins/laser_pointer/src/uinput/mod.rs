//! `laser_pointer.uinput`: pointers as an input device of Linux, for every program that supports a touch screen or a mouse.
//!
//! | `mode` | the device | what a pointer does |
//! |---|---|---|
//! | `touch` | a touch screen, multitouch protocol B of the kernel | each that is pressed is a finger |
//! | `pointer` | a mouse with absolute positions | the oldest moves the cursor, pressed or not; a press holds the left button |
//!
//! Positions are `predicted`, at display time. The device covers the displayed area without the gaps between displays.
//!
//! At most `rate_hz` frames per second of session time are sent; presses and releases are sent at once. A slow program delays nothing:
//! the kernel drops what it does not read, and informs it.

mod cursor;
mod desktop;
mod device;
mod touch;

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::cursor::Cursor;
use self::desktop::Desktop;
use self::device::Device;
use self::touch::Touch;
use crate::wall::Wall;

ports! {
    POINTERS: In<Pointers> = each("pointers");
}

figures! {
        "uinput.frames": count, neither, "Frames of events that the device accepted";
    "uinput.presses": count, neither, "Fingers put down, or presses of the button";
        "uinput.superseded": count, neither, "States replaced by a newer one before they were sent, to keep to `rate_hz`";
        "uinput.left_out": count, low, "Presses without a slot, as `slots` pointers were held down already";
        "uinput.failed": count, low, "Frames of events that the device did not accept";
}

/// Kind of the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// A touch screen: each pointer that is pressed is a finger.
    #[default]
    Touch,
    /// A mouse with absolute positions: the oldest pointer moves the system's cursor.
    Pointer,
}

/// Settings of [`Uinput`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct UinputSettings {
    /// Kind of the device: `touch` or `pointer` [–]
    pub mode: Mode,
    /// Most fingers at once; X.org's driver supports 15 [–]
    #[schemars(range(min = 1, max = 64))]
    pub slots: usize,
    /// Most frames per second of session time; presses and releases are sent at once [Hz]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// Displays along rows and columns, to remove the gaps between them [–]
    pub tiles: [u32; 2],
    /// Distance from the last pixel of a display to the first of the next, which the desktop does not have [mm]
    #[schemars(range(min = 0.0, max = 200.0))]
    pub gap_mm: f64,
    /// Name of the device in programs, 1 to 79 bytes [–]
    pub name: String,
    /// The kernel's file for virtual input devices; a relative path starts at the rig's folder [–]
    pub device: String,
    /// Whether the run is refused without the device; if not, it continues, and the end report says so [–]
    pub required: bool,
}

impl Default for UinputSettings {
    fn default() -> Self {
        Self {
            mode: Mode::default(),
            slots: 10,
            rate_hz: 125.0,
            tiles: [1, 1],
            gap_mm: 0.0,
            name: "Foveate wall".to_owned(),
            device: "/dev/uinput".to_owned(),
            required: true,
        }
    }
}

/// A pointer in units of the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Contact {
    id: TargetId,
    /// Position from the top left corner [units].
    at: [i32; 2],
    is_pressed: bool,
}

/// An event of a device, in the numbers of the kernel's `input-event-codes.h`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Event {
    kind: u16,
    code: u16,
    value: i32,
}

const EV_SYN: u16 = 0;
const EV_KEY: u16 = 1;
const EV_ABS: u16 = 3;
const BTN_LEFT: u16 = 0x110;
const BTN_TOUCH: u16 = 0x14a;
const ABS_X: u16 = 0;
const ABS_Y: u16 = 1;
const ABS_MT_SLOT: u16 = 0x2f;
const ABS_MT_POSITION_X: u16 = 0x35;
const ABS_MT_POSITION_Y: u16 = 0x36;
const ABS_MT_TRACKING_ID: u16 = 0x39;

impl Event {
    /// Ends a frame.
    const REPORT: Event = Event { kind: EV_SYN, code: 0, value: 0 };

    fn key(code: u16, is_down: bool) -> Event {
        Event { kind: EV_KEY, code, value: i32::from(is_down) }
    }

    fn abs(code: u16, value: i32) -> Event {
        Event { kind: EV_ABS, code, value }
    }
}

/// The simulated device.
#[derive(Debug)]
enum Stream {
    Touch(Touch),
    Cursor(Cursor),
}

impl Stream {
    /// Whether `contacts` would change a press or a release.
    fn is_urgent(&self, contacts: &[Contact]) -> bool {
        match self {
            Stream::Touch(it) => it.is_urgent(contacts),
            Stream::Cursor(it) => it.is_urgent(contacts),
        }
    }

    /// The events that bring the device to `contacts`; empty without a change.
    fn frame(&mut self, contacts: &[Contact]) -> Vec<Event> {
        match self {
            Stream::Touch(it) => it.frame(contacts),
            Stream::Cursor(it) => it.frame(contacts),
        }
    }

    fn n_presses(&self) -> u64 {
        match self {
            Stream::Touch(it) => it.n_presses,
            Stream::Cursor(it) => it.n_presses,
        }
    }
}

/// Pointers in, events of an input device out.
pub struct Uinput {
    wall: Wall,
    desktop: Desktop,
    period: Interval,
    slots: usize,
    stream: Stream,
    /// None while the node is only checked, and where the device is missing and not required.
    device: Option<Device>,
    missing: Option<String>,
    sent: Option<Time>,
    /// The contacts sent last, and whether newer ones wait.
    said: Vec<Contact>,
    waits: bool,
    n_frames: u64,
    n_superseded: u64,
    n_failed: u64,
    fault: Option<String>,
}

impl Node for Uinput {
    const TYPE: &'static str = "laser_pointer.uinput";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Turns pointers into a touch screen or mouse of this desktop (uinput, Linux only)";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = UinputSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(mut settings: UinputSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("slots", settings.slots, 1..=64)?;
        ConfigError::unless_in("rate_hz", settings.rate_hz, 1.0..=1000.0)?;
        if !(1..=79).contains(&settings.name.len()) || settings.name.contains('\0') {
            let message = format!("found {} bytes, expected a name of 1 to 79 without a zero", settings.name.len());
            return Err(ConfigError::at("name", message));
        }
        settings.device = setup.path("device", &settings.device)?.display().to_string();
        let wall = Wall::of(setup)?;
        let desktop = Desktop::new(&wall, settings.tiles, settings.gap_mm)?;
        let (mut device, mut missing) = (None, None);
        if setup.purpose == Purpose::Run {
            match Device::make(&settings, &desktop) {
                Ok(made) => device = Some(made),
                Err(why) if settings.required => {
                    let message = format!("{why}; with `required = false` the rig runs without it");
                    return Err(ConfigError::at("device", message));
                }
                Err(why) => missing = Some(why),
            }
        }
        let stream = match settings.mode {
            Mode::Touch => Stream::Touch(Touch::new(settings.slots)),
            Mode::Pointer => Stream::Cursor(Cursor::default()),
        };
        Ok(Self {
            wall,
            desktop,
            period: Interval::from_s(1.0 / settings.rate_hz),
            slots: settings.slots,
            stream,
            device,
            missing,
            sent: None,
            said: Vec::new(),
            waits: false,
            n_frames: 0,
            n_superseded: 0,
            n_failed: 0,
            fault: None,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(Stamped { value: pointers, .. }) = io.take(&POINTERS) else { return Ok(()) };
        let contact = |it: &Pointer| Contact {
            id: it.id,
            at: self.desktop.units(&self.wall.part(&it.predicted)),
            is_pressed: it.is_pressed,
        };
        let contacts: Vec<Contact> = pointers.list.iter().map(contact).collect();
        if contacts == self.said && !self.stream.is_urgent(&contacts) {
            self.waits = false;
            return Ok(());
        }
        let is_due = self.sent.is_none_or(|it| io.now() - it >= self.period) || self.stream.is_urgent(&contacts);
        self.n_superseded += u64::from(self.waits);
        self.waits = !is_due;
        if is_due {
            self.send(&contacts);
            (self.said, self.sent) = (contacts, Some(io.now()));
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        // No finger stays down, no button held.
        self.send(&[]);
        let n_left_out = if let Stream::Touch(touch) = &self.stream { touch.n_left_out } else { 0 };
        report.figure("uinput.frames", self.n_frames as f64);
        report.figure("uinput.presses", self.stream.n_presses() as f64);
        report.figure("uinput.superseded", self.n_superseded as f64);
        report.figure("uinput.left_out", n_left_out as f64);
        report.figure("uinput.failed", self.n_failed as f64);
        if let Some(why) = &self.missing {
            report.remark(format!("the pointers were not available as an input device: {why}"));
        }
        if let Some(why) = &self.fault {
            report.remark(format!("{} frames were not accepted by the input device: {why}", self.n_failed));
        }
        if n_left_out > 0 {
            report.remark(format!(
                "{n_left_out} presses had no slot on the input device: {} were held down already; raise `slots`",
                self.slots
            ));
        }
        Ok(())
    }
}

impl Uinput {
    /// Brings the device to `contacts`.
    fn send(&mut self, contacts: &[Contact]) {
        let events = self.stream.frame(contacts);
        if let (Some(device), false) = (&mut self.device, events.is_empty()) {
            match device.write(&events) {
                Ok(()) => self.n_frames += 1,
                Err(error) => {
                    self.n_failed += 1;
                    self.fault.get_or_insert(error.to_string());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;

#[cfg(all(test, target_os = "linux"))]
mod kernel_test;
