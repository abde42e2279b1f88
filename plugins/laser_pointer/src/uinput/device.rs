//! The one place that talks to the kernel's `uinput` (Documentation/input/uinput.rst): seven requests.

use super::desktop::Desktop;
use super::{Event, UinputSettings};

#[cfg(target_os = "linux")]
pub(super) use self::linux::Device;

/// The device on other systems, where it does not exist.
#[cfg(not(target_os = "linux"))]
#[derive(Debug)]
pub(super) enum Device {}

#[cfg(not(target_os = "linux"))]
impl Device {
    /// # Errors
    /// Always.
    pub(super) fn make(_: &UinputSettings, _: &Desktop) -> Result<Device, String> {
        Err("found another system than Linux, expected Linux: virtual input devices are made by its kernel".to_owned())
    }

    pub(super) fn write(&mut self, _: &[Event]) -> std::io::Result<()> {
        match *self {}
    }
}

#[cfg(target_os = "linux")]
mod linux {
    #![allow(unsafe_code, reason = "system calls: each block says why it is sound")]

    use std::fs::{File, OpenOptions};
    use std::io::{Error, ErrorKind, Result as IoResult, Write};
    use std::os::fd::AsRawFd;
    use std::os::unix::fs::OpenOptionsExt;

    use super::super::touch::LAST_TRACKING;
    use super::super::{
        ABS_MT_POSITION_X, ABS_MT_POSITION_Y, ABS_MT_SLOT, ABS_MT_TRACKING_ID, ABS_X, ABS_Y, BTN_LEFT, BTN_TOUCH,
        EV_ABS, EV_KEY, Mode,
    };
    use super::*;

    /// The letter of uinput's requests.
    const LETTER: u32 = b'U' as u32;

    /// A virtual device of the kernel, removed when this is dropped.
    #[derive(Debug)]
    pub(in super::super) struct Device {
        file: File,
        bytes: Vec<u8>,
    }

    impl Device {
        /// Makes the device.
        ///
        /// # Errors
        /// What was found, what was expected, and what to do.
        pub(in super::super) fn make(settings: &UinputSettings, desktop: &Desktop) -> Result<Device, String> {
            let path = &settings.device;
            let file = OpenOptions::new().write(true).custom_flags(libc::O_NONBLOCK).open(path);
            let file = file.map_err(|error| match error.kind() {
                ErrorKind::PermissionDenied => format!(
                    "found `{path}`, which this user may not write, expected write permission: as root put KERNEL==\"uinput\", GROUP=\"input\", MODE=\"0660\", \
                     OPTIONS+=\"static_node=uinput\" into /etc/udev/rules.d/60-uinput.rules, add the user to the group `input`, and log in again"
                ),
                _ => format!(
                    "found no `{path}` that can be opened ({error}), expected the kernel's file for virtual input devices: `modprobe uinput` as root makes it; in a container, pass it on"
                ),
            })?;
            set_up(&file, settings, desktop).map_err(|error| {
                format!("found `{path}`, which makes no input device ({error}), expected the kernel's /dev/uinput, of Linux 4.5 or newer")
            })?;
            Ok(Device { file, bytes: Vec::new() })
        }

        /// Sends `events`. Never waits: the kernel drops what readers do not read in time, and informs them.
        ///
        /// # Errors
        /// The kernel does not take them.
        pub(in super::super) fn write(&mut self, events: &[Event]) -> IoResult<()> {
            self.bytes.clear();
            for event in events {
                // A time, which the kernel replaces by its own, then type, code, value.
                self.bytes.resize(self.bytes.len() + size_of::<libc::input_event>() - 8, 0);
                self.bytes.extend(event.kind.to_ne_bytes());
                self.bytes.extend(event.code.to_ne_bytes());
                self.bytes.extend(event.value.to_ne_bytes());
            }
            self.file.write_all(&self.bytes)
        }
    }

    fn set_up(file: &File, settings: &UinputSettings, desktop: &Desktop) -> IoResult<()> {
        let [right, bottom] = desktop.last;
        let mut axes = vec![(ABS_X, right, desktop.per_mm), (ABS_Y, bottom, desktop.per_mm)];
        let button = match settings.mode {
            Mode::Touch => BTN_TOUCH,
            Mode::Pointer => BTN_LEFT,
        };
        set(file, 100, EV_KEY)?;
        set(file, 101, button)?;
        set(file, 100, EV_ABS)?;
        if settings.mode == Mode::Touch {
            set(file, 110, libc::INPUT_PROP_DIRECT)?;
            axes.extend([
                (ABS_MT_SLOT, settings.slots as i32 - 1, 0),
                (ABS_MT_TRACKING_ID, LAST_TRACKING, 0),
                (ABS_MT_POSITION_X, right, desktop.per_mm),
                (ABS_MT_POSITION_Y, bottom, desktop.per_mm),
            ]);
        }
        for (code, maximum, resolution) in axes {
            set(file, 103, code)?;
            let absinfo = libc::input_absinfo { value: 0, minimum: 0, maximum, fuzz: 0, flat: 0, resolution };
            let setup = libc::uinput_abs_setup { code, absinfo };
            give(file, 4, &setup)?;
        }
        let mut name = [0; libc::UINPUT_MAX_NAME_SIZE];
        name.iter_mut().zip(settings.name.bytes()).for_each(|(to, from)| *to = from as libc::c_char);
        // Numbers of no maker: the bus says that it is virtual.
        let id = libc::input_id { bustype: BUS_VIRTUAL, vendor: 0, product: 0, version: 1 };
        let setup = libc::uinput_setup { id, name, ff_effects_max: 0 };
        give(file, 3, &setup)?;
        // SAFETY: `UI_DEV_CREATE` has no argument.
        done(unsafe { libc::ioctl(file.as_raw_fd(), libc::_IO(LETTER, 1)) })
    }

    const BUS_VIRTUAL: u16 = 6;

    /// `UI_SET_EVBIT` (100), `UI_SET_KEYBIT` (101), `UI_SET_ABSBIT` (103), `UI_SET_PROPBIT` (110).
    fn set(file: &File, request: u32, bit: u16) -> IoResult<()> {
        // SAFETY: the argument is a number.
        done(unsafe {
            libc::ioctl(file.as_raw_fd(), libc::_IOW::<libc::c_int>(LETTER, request), libc::c_ulong::from(bit))
        })
    }

    /// `UI_DEV_SETUP` (3), `UI_ABS_SETUP` (4).
    fn give<T>(file: &File, request: u32, value: &T) -> IoResult<()> {
        // SAFETY: the kernel only reads as many bytes of `value` as the request says, which is its size. A file that is no uinput refuses requests of its letter.
        done(unsafe { libc::ioctl(file.as_raw_fd(), libc::_IOW::<T>(LETTER, request), std::ptr::from_ref(value)) })
    }

    fn done(code: libc::c_int) -> IoResult<()> {
        if code < 0 { Err(Error::last_os_error()) } else { Ok(()) }
    }
}
