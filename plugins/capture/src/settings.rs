//! Settings and steps that several sources share: pixel format, frame times, the reason list of a report.

use std::path::{Path, PathBuf};

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Format that pictures are decoded to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// One byte a pixel: luma (0.299 R + 0.587 G + 0.114 B) where the file holds colours.
    #[default]
    Gray,
    /// Red, green, blue.
    Rgb,
}

impl Format {
    /// The same as a format of messages.
    pub fn pixel_format(self) -> PixelFormat {
        match self {
            Format::Gray => PixelFormat::Gray8,
            Format::Rgb => PixelFormat::Rgb8,
        }
    }
}

/// Which lines of an interlaced frame are kept: the two fields were exposed one after the other, so edges of moving objects are combed in the whole frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Field {
    /// All lines: the camera is not interlaced.
    #[default]
    Whole,
    /// The first, third, fifth line …: the upper field.
    Odd,
    /// The second, fourth, sixth line …: the lower field.
    Even,
}

impl Field {
    /// Keeps the lines of this field of a frame.
    pub(crate) fn keep(self, image: &mut Image) {
        let first = match self {
            Field::Whole => return,
            Field::Odd => 0,
            Field::Even => 1,
        };
        let line = image.width as usize * image.format.channels();
        let n_lines = (image.height as usize + 1 - first) / 2;
        for kept in 0..n_lines {
            let from = (2 * kept + first) * line;
            image.pixels.copy_within(from..from + line, kept * line);
        }
        image.pixels.truncate(n_lines * line);
        image.height = n_lines as u32;
    }

    /// The same as a filter of ffmpeg; empty for whole frames.
    pub(crate) fn filter(self) -> &'static str {
        match self {
            Field::Whole => "",
            Field::Odd => "field=type=top",
            Field::Even => "field=type=bottom",
        }
    }
}

/// When frame `index` of a regular sequence was captured; each time is rounded on its own, so that errors do not add up.
pub(crate) fn frame_time(start_s: f64, rate_hz: f64, index: u64) -> Time {
    Time::from_s(start_s) + Interval::from_s(index as f64 / rate_hz)
}

/// The camera that a source serves.
pub(crate) fn camera_of(setup: &Setup, node: &str) -> Result<CameraId, ConfigError> {
    setup.camera.ok_or_else(|| {
        ConfigError::node(format_args!(
            "`{node}` serves one camera: say which with `camera = \"name\"` or `each = \"pattern\"`"
        ))
    })
}

/// The `path` of each camera of the calibration, where the setting names the camera.
pub(crate) fn paths_of_cameras(setup: &Setup, path: &str) -> impl Iterator<Item = PathBuf> {
    let cameras = (0..setup.calibration.cameras.len()).map(|index| CameraId(index as u16));
    cameras.filter_map(move |camera| Setup { camera: Some(camera), ..setup.clone() }.path("path", path).ok())
}

/// A hint for a camera whose files are missing while other cameras have theirs.
pub(crate) fn where_others_have(setup: &Setup, path: &str, has: impl Fn(&Path) -> bool) -> String {
    let Some(own) = setup.camera_name().filter(|_| path.contains("{camera}")) else { return String::new() };
    let n = setup.calibration.cameras.len();
    match paths_of_cameras(setup, path).filter(|it| has(it)).count() {
        0 => String::new(),
        others => format!(
            "; {others} of {n} cameras have theirs: `each = [\"*\", \"!{own}\"]` leaves this one out, here and at the nodes connected to it"
        ),
    }
}

/// Counts what went wrong and keeps the first few reasons, for a remark at the end of a run.
#[derive(Debug, Default)]
pub(crate) struct Reasons {
    count: u64,
    first: Vec<String>,
}

impl Reasons {
    const SHOWN: usize = 3;

    pub(crate) fn add(&mut self, reason: impl Into<String>) {
        self.count += 1;
        if self.first.len() < Self::SHOWN {
            self.first.push(reason.into());
        }
    }

    pub(crate) fn count(&self) -> u64 {
        self.count
    }

    /// `what: first; second; third; and 7 more`; `None` where nothing went wrong.
    pub(crate) fn sentence(&self, what: &str) -> Option<String> {
        let rest = self.count - self.first.len() as u64;
        let more = if rest == 0 { String::new() } else { format!("; and {rest} more") };
        (self.count > 0).then(|| format!("{what}: {}{more}", self.first.join("; ")))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::sync::Arc;

    use super::*;

    /// The setup of an instance for camera `ring-1` of four, whose pictures are of `size` [px].
    pub(crate) fn setup_with_camera(size: [u32; 2]) -> Setup {
        let mut calibration = foveate_testkit::scene::ring_calibration(4);
        calibration.cameras.iter_mut().for_each(|it| it.camera.image_size = size);
        Setup { camera: Some(CameraId(0)), calibration: Arc::new(calibration), ..Setup::for_tests() }
    }

    #[test]
    fn frame_times_do_not_drift() {
        assert_eq!(frame_time(0.0, 30.0, 30 * 3600), Time::from_s(3600.0));
        assert_eq!(frame_time(1.5, 60.0, 1), Time(1_516_666_667));
    }

    #[test]
    fn reasons_beyond_the_first_three_are_counted() {
        let mut reasons = Reasons::default();
        assert_eq!(reasons.sentence("missing"), None);
        for name in ["a", "b", "c", "d", "e"] {
            reasons.add(name);
        }
        assert_eq!(reasons.sentence("missing").unwrap(), "missing: a; b; c; and 2 more");
    }
}
