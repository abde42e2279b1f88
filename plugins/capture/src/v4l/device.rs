//! What the stream needs of a camera, so that it can be tested against one that fails on command.

use std::sync::Arc;
use std::time::Duration;

use foveate::prelude::ConfigError;

use super::settings::V4lSettings;

/// Four letters that name a pixel layout, as V4L2 does.
pub(crate) type FourCc = [u8; 4];

/// What the pictures of an opened camera are like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Layout {
    /// Pixel layout.
    pub(crate) fourcc: FourCc,
    /// Columns, rows [px].
    pub(crate) size: [u32; 2],
    /// From the start of one row to the next [bytes]; 0 where the pictures are compressed.
    pub(crate) stride: u32,
    /// Luma and chroma use 0 to 255, not 16 to 235.
    pub(crate) full_range: bool,
    /// Time between two frames, where the driver says [ns].
    pub(crate) period: Option<i64>,
}

/// What a driver says about a buffer that it has filled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Filled {
    /// Bytes that hold something.
    pub(crate) used: usize,
    /// Counts frames since the stream began, those that were lost too; wraps around.
    pub(crate) sequence: u32,
    /// When, on the device clock [ns]; `None`: stamped by another clock, or not at all.
    pub(crate) stamp: Option<i64>,
    /// The stamp is of the start of the exposure, not of the end of the frame.
    pub(crate) at_start: bool,
    /// The driver says that the content is damaged.
    pub(crate) damaged: bool,
}

/// Why a stream cannot go on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Trouble {
    /// The stream has to be started again.
    Interrupted(String),
    /// The camera is not there any more: it has to be opened again.
    Gone(String),
}

/// The clock that a driver stamps its pictures by [ns].
pub(crate) type DeviceClock = Arc<dyn Fn() -> i64 + Send + Sync>;

/// A camera.
pub(crate) trait Device: Send {
    /// Opens it and makes all settings.
    ///
    /// # Errors
    /// It is not there, or does not take a setting: which, and what it offers.
    fn open(&mut self) -> Result<Layout, ConfigError>;

    /// Sets exposure, gain and other controls while it streams; a camera that is not there gets them when it is opened again.
    ///
    /// # Errors
    /// A control that it does not have or take; it keeps the settings that it had.
    fn change(&mut self, settings: &V4lSettings) -> Result<(), ConfigError>;

    /// Lets an opened camera stream.
    ///
    /// # Errors
    /// The stream does not start.
    fn start(&mut self) -> Result<(), Trouble>;

    /// Waits at most `wait` for a picture, shows it to `read`, and gives its buffer back. `false`: none came.
    ///
    /// # Errors
    /// The stream cannot go on; `read` may have seen a picture all the same.
    fn next(&mut self, wait: Duration, read: &mut dyn FnMut(&Filled, &[u8])) -> Result<bool, Trouble>;

    /// Ends the stream.
    fn stop(&mut self);

    /// Ends the stream, and lets go of the camera.
    fn close(&mut self);

    /// The clock of its stamps.
    fn clock(&self) -> DeviceClock;
}
