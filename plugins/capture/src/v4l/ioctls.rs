//! The one place that talks to a driver past the crate `v4l`: buffers mapped into memory, controls, the clock.
//!
//! The crate's own stream never recovers from one time-out (it queues a buffer again that the driver still has), and its
//! list of controls panics at kinds that it does not know.

#![allow(unsafe_code, reason = "system calls on raw memory: each block says why it is sound")]

use std::ffi::c_void;
use std::io::{Error, ErrorKind, Result};
use std::sync::Arc;
use std::time::Duration;

use v4l::device::Handle;
use v4l::v4l_sys as sys;
use v4l::v4l2::{self, vidioc};

use super::controls::{Control, Kind};
use super::device::Filled;

const CAPTURE: u32 = sys::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE;
const MMAP: u32 = sys::v4l2_memory_V4L2_MEMORY_MMAP;
/// Pause where a driver announces a picture and delivers none.
const NOTHING_PAUSE: Duration = Duration::from_millis(2);
/// Most items of a menu that are queried.
const ITEMS: i64 = 256;

/// A struct of the kernel's interface: plain C data without references, for which all bytes zero is a value.
///
/// # Safety
/// Only for `#[repr(C)]` structs of numbers, arrays and unions of them, and raw pointers.
unsafe trait Plain: Copy {}
// SAFETY: generated from the kernel's headers, numbers and arrays and unions of them alone.
unsafe impl Plain for sys::v4l2_requestbuffers {}
// SAFETY: as above; the pointers in its union are raw.
unsafe impl Plain for sys::v4l2_buffer {}
// SAFETY: as the first.
unsafe impl Plain for sys::v4l2_query_ext_ctrl {}
// SAFETY: as the first.
unsafe impl Plain for sys::v4l2_querymenu {}
// SAFETY: as the first.
unsafe impl Plain for sys::v4l2_control {}
// SAFETY: a number.
unsafe impl Plain for i32 {}

fn zeroed<T: Plain>() -> T {
    // SAFETY: `Plain` promises that all bytes zero is a value.
    unsafe { std::mem::zeroed() }
}

/// One system call on `value`. `request` must be the one that the kernel defines for `T`: its number holds the size, which is checked.
fn call<T: Plain>(handle: &Handle, request: vidioc::_IOC_TYPE, value: &mut T) -> Result<()> {
    let size = (request >> 16) as usize & 0x3fff;
    assert_eq!(size, size_of::<T>(), "a request is for a struct of its own size");
    // SAFETY: `value` is valid for reads and writes of the `size` bytes that the kernel copies from and to it; buffers that
    // it would reach through pointers inside do not occur in the requests made here.
    unsafe { v4l2::ioctl(handle.fd(), request, std::ptr::from_mut(value).cast::<c_void>()) }
}

/// The clock that drivers stamp their buffers by [ns].
pub(crate) fn monotonic_ns() -> i64 {
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `now` is valid for writes. The clock exists on every Linux: the call cannot fail.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut now) };
    now.tv_sec.saturating_mul(1_000_000_000).saturating_add(now.tv_nsec)
}

/// Memory of the driver.
struct Mapping {
    start: *mut c_void,
    length: usize,
}

// SAFETY: the mapping belongs to the process, not to a thread.
unsafe impl Send for Mapping {}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: `start` and `length` are what mmap gave, this is the only unmapping, and slices of it live no longer than a borrow of it.
        drop(unsafe { v4l2::munmap(self.start, self.length) });
    }
}

/// A running stream: the driver fills these buffers in turn. Ends when dropped.
pub(crate) struct Buffers {
    // Dropped in this order: unmapped before the device is closed.
    mappings: Vec<Mapping>,
    handle: Arc<Handle>,
}

impl Buffers {
    /// Asks for `count` buffers, hands all of them to the driver, and lets it begin.
    ///
    /// # Errors
    /// The step that failed, and the system's error.
    pub(crate) fn start(handle: Arc<Handle>, count: u32) -> std::result::Result<Self, (&'static str, Error)> {
        let granted = request(&handle, count).map_err(|it| ("asking for buffers", it))?;
        let mut buffers = Self { mappings: Vec::new(), handle };
        for index in 0..granted {
            let mut buffer = described(index);
            call(&buffers.handle, vidioc::VIDIOC_QUERYBUF, &mut buffer).map_err(|it| ("asking for a buffer", it))?;
            let length = buffer.length as usize;
            // SAFETY: the kind is MMAP, so the kernel has set this field of the union.
            let offset = unsafe { buffer.m.offset };
            let protection = libc::PROT_READ | libc::PROT_WRITE;
            // SAFETY: a new mapping at an address that the kernel chooses, checked for failure.
            let start = unsafe {
                v4l2::mmap(
                    std::ptr::null_mut(),
                    length,
                    protection,
                    libc::MAP_SHARED,
                    buffers.handle.fd(),
                    offset.into(),
                )
            };
            let start = start.map_err(|it| ("mapping a buffer", it))?;
            buffers.mappings.push(Mapping { start, length });
            call(&buffers.handle, vidioc::VIDIOC_QBUF, &mut described(index))
                .map_err(|it| ("queueing a buffer", it))?;
        }
        switch(&buffers.handle, vidioc::VIDIOC_STREAMON).map_err(|it| ("starting the stream", it))?;
        Ok(buffers)
    }

    /// Waits at most `wait` for a picture, shows it to `read`, and hands its buffer back. `false`: none came.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn next(&mut self, wait: Duration, read: &mut dyn FnMut(&Filled, &[u8])) -> Result<bool> {
        match self.handle.poll(libc::POLLIN, i32::try_from(wait.as_millis()).unwrap_or(i32::MAX)) {
            Ok(0) => return Ok(false),
            Ok(_) => {}
            // A signal: Ctrl-C has a thread of its own.
            Err(error) if error.kind() == ErrorKind::Interrupted => return Ok(false),
            Err(error) => return Err(error),
        }
        let mut buffer = described(0);
        match call(&self.handle, vidioc::VIDIOC_DQBUF, &mut buffer) {
            Ok(()) => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                std::thread::sleep(NOTHING_PAUSE);
                return Ok(false);
            }
            Err(error) => return Err(error),
        }
        let Some(mapping) = self.mappings.get(buffer.index as usize) else {
            return Err(Error::other(format!("the driver gave buffer {} of {}", buffer.index, self.mappings.len())));
        };
        // SAFETY: the mapping is `length` bytes long and lives as long as `self`; the driver has given this buffer to us and does not write
        // to it before it is queued again below, after the last use of the slice.
        let bytes = unsafe { std::slice::from_raw_parts(mapping.start.cast::<u8>(), mapping.length) };
        read(&filled(&buffer), bytes);
        call(&self.handle, vidioc::VIDIOC_QBUF, &mut described(buffer.index))?;
        Ok(true)
    }
}

impl Drop for Buffers {
    fn drop(&mut self) {
        // Each fails where the device is gone; then there is nothing left to end.
        drop(switch(&self.handle, vidioc::VIDIOC_STREAMOFF));
        self.mappings.clear();
        drop(request(&self.handle, 0));
    }
}

/// Asks for `count` buffers; how many there are.
fn request(handle: &Handle, count: u32) -> Result<u32> {
    let mut request = sys::v4l2_requestbuffers { count, type_: CAPTURE, memory: MMAP, ..zeroed() };
    call(handle, vidioc::VIDIOC_REQBUFS, &mut request)?;
    if count > 0 && request.count == 0 {
        return Err(Error::other("the driver gives none"));
    }
    Ok(request.count)
}

fn switch(handle: &Handle, request: vidioc::_IOC_TYPE) -> Result<()> {
    call(handle, request, &mut (CAPTURE as i32))
}

fn described(index: u32) -> sys::v4l2_buffer {
    sys::v4l2_buffer { index, type_: CAPTURE, memory: MMAP, ..zeroed() }
}

fn filled(buffer: &sys::v4l2_buffer) -> Filled {
    let is_monotonic = buffer.flags & sys::V4L2_BUF_FLAG_TIMESTAMP_MASK == sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    let stamp = buffer.timestamp.tv_sec.saturating_mul(1_000_000_000) + buffer.timestamp.tv_usec.saturating_mul(1_000);
    Filled {
        used: buffer.bytesused as usize,
        sequence: buffer.sequence,
        stamp: is_monotonic.then_some(stamp),
        at_start: buffer.flags & sys::V4L2_BUF_FLAG_TSTAMP_SRC_MASK == sys::V4L2_BUF_FLAG_TSTAMP_SRC_SOE,
        damaged: buffer.flags & sys::V4L2_BUF_FLAG_ERROR != 0,
    }
}

/// All controls with their present values.
///
/// # Errors
/// The system's at the first one, where the driver has no list of them.
pub(crate) fn controls(handle: &Handle) -> Result<Vec<Control>> {
    let mut found: Vec<Control> = Vec::new();
    let mut id = 0;
    loop {
        let mut query = sys::v4l2_query_ext_ctrl { id: id | sys::V4L2_CTRL_FLAG_NEXT_CTRL, ..zeroed() };
        match call(handle, vidioc::VIDIOC_QUERY_EXT_CTRL, &mut query) {
            Ok(()) if query.id > id => id = query.id,
            // A driver that does not count up would be asked for ever.
            Ok(()) => return Ok(found),
            Err(error) if error.kind() == ErrorKind::InvalidInput => return Ok(found),
            Err(error) => return Err(error),
        }
        if query.flags & sys::V4L2_CTRL_FLAG_DISABLED == 0
            && query.type_ != sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_CTRL_CLASS
        {
            found.push(control(handle, &query));
        }
    }
}

fn control(handle: &Handle, query: &sys::v4l2_query_ext_ctrl) -> Control {
    let kind = match query.type_ {
        sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_INTEGER | sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_BITMASK if query.elems <= 1 => {
            Kind::Number
        }
        sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_BOOLEAN => Kind::Switch,
        sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_BUTTON => Kind::Button,
        sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_MENU => Kind::Menu(items(handle, query, false)),
        sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_INTEGER_MENU => Kind::Menu(items(handle, query, true)),
        _ => Kind::Other,
    };
    let has_value = kind != Kind::Other && kind != Kind::Button;
    let mut now = sys::v4l2_control { id: query.id, value: 0 };
    let value = (has_value && call(handle, vidioc::VIDIOC_G_CTRL, &mut now).is_ok()).then_some(now.value);
    let name: Vec<u8> = query.name.iter().map(|&it| it as u8).take_while(|&it| it != 0).collect();
    Control {
        id: query.id,
        name: String::from_utf8_lossy(&name).into_owned(),
        kind,
        min: query.minimum,
        max: query.maximum,
        step: query.step,
        default: query.default_value,
        can_be_set: query.flags & sys::V4L2_CTRL_FLAG_READ_ONLY == 0,
        value,
    }
}

/// The items of a menu; numbers without an item are left out.
fn items(handle: &Handle, query: &sys::v4l2_query_ext_ctrl, of_numbers: bool) -> Vec<(u32, String)> {
    let last = query.maximum.min(query.minimum.saturating_add(ITEMS));
    let numbers = (query.minimum..=last).filter_map(|it| u32::try_from(it).ok());
    let item = |index: u32| {
        let mut menu = sys::v4l2_querymenu { id: query.id, index, ..zeroed() };
        call(handle, vidioc::VIDIOC_QUERYMENU, &mut menu).ok()?;
        let text = if of_numbers {
            // SAFETY: both sides of the union are plain bytes, all of which are set.
            unsafe { menu.__bindgen_anon_1.value }.to_string()
        } else {
            // SAFETY: as above.
            let name = unsafe { menu.__bindgen_anon_1.name };
            let length = name.iter().position(|&it| it == 0).unwrap_or(name.len());
            String::from_utf8_lossy(&name[..length]).into_owned()
        };
        Some((index, text))
    };
    numbers.filter_map(item).collect()
}

/// Sets a control.
///
/// # Errors
/// The system's: ERANGE, or EACCES for one that is read-only or not active.
pub(crate) fn set_control(handle: &Handle, id: u32, value: i32) -> Result<()> {
    call(handle, vidioc::VIDIOC_S_CTRL, &mut sys::v4l2_control { id, value })
}
