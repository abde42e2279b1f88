//! How each camera's clock runs against the session's: where cameras were started by hand, this is what joins their recordings.
//!
//! A section `clock` for each camera, in a calibration file or in a file of its own:
//!
//! ```toml
//! [clock.cam1]
//! offset_s = 33.8          # what the camera's clock shows when the session begins
//! rate = 1.0001            # seconds of the camera's clock in a second of the session; 1 where left out
//! offset_sigma_s = 0.01    # how well the offset is known; may be left out
//! frame_rate_hz = 29.97    # pictures in a second of the camera's clock; needed where pictures are known by number only
//! ```

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::text::key;

/// A camera's clock: camera time = `offset_s` + `rate` · session time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraClock {
    /// What it shows when the session begins [s].
    pub offset_s: f64,
    /// How fast it runs, above 0 [–].
    pub rate: f64,
    /// Standard deviation of the offset, where that is known [s].
    pub offset_sigma_s: Option<f64>,
    /// Pictures in a second of this clock, where that is known [Hz].
    pub frame_rate_hz: Option<f64>,
}

impl Default for CameraClock {
    /// The session's own clock.
    fn default() -> Self {
        Self { offset_s: 0.0, rate: 1.0, offset_sigma_s: None, frame_rate_hz: None }
    }
}

impl CameraClock {
    /// When it is `camera_s` on this clock, on the session's [s].
    pub fn session_s(&self, camera_s: f64) -> f64 {
        (camera_s - self.offset_s) / self.rate
    }

    /// What this clock shows at `session_s` of the session [s].
    pub fn camera_s(&self, session_s: f64) -> f64 {
        self.offset_s + self.rate * session_s
    }
}

/// Clocks by the name of the camera.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Clocks(pub BTreeMap<String, CameraClock>);

impl Clocks {
    /// The sections as they stand in a file, each after an empty line. Reading them gives the same numbers.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        for (name, clock) in &self.0 {
            // Writing to a String cannot fail.
            let _ = write!(text, "\n[clock.{}]\noffset_s = {:?}\nrate = {:?}\n", key(name), clock.offset_s, clock.rate);
            for (name, value) in [("offset_sigma_s", clock.offset_sigma_s), ("frame_rate_hz", clock.frame_rate_hz)] {
                if let Some(value) = value {
                    let _ = writeln!(text, "{name} = {value:?}");
                }
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use proptest::prelude::*;

    use super::*;
    use crate::error::CalibrationError;

    #[track_caller]
    fn parse(text: &str) -> Result<Clocks, CalibrationError> {
        Clocks::from_toml(text, Path::new("clocks.toml"))
    }

    #[test]
    fn camera_time_is_offset_plus_rate_times_session_time() {
        let clocks =
            parse("[clock.a]\noffset_s = 30\nrate = 1.01\n[clock.b]\noffset_s = -2.5\nframe_rate_hz = 25").unwrap();
        let a = clocks.0["a"];
        assert!((a.camera_s(100.0) - 131.0).abs() < 1e-12 && (a.session_s(131.0) - 100.0).abs() < 1e-12);
        assert_eq!(clocks.0["b"], CameraClock { offset_s: -2.5, frame_rate_hz: Some(25.0), ..CameraClock::default() });
    }

    #[test]
    fn every_fault_is_named_with_its_place() {
        let found = |text: &str| parse(text).unwrap_err().to_string();
        assert!(found("").contains("clock is missing"));
        assert!(parse("[clock.a]\nframe_rate_hz = 30").is_ok());
        assert!(
            found("[clock.a]\noffset_s = nan")
                .contains("2:12: camera \"a\": offset_s is nan, expected a finite number")
        );
        assert!(found("[clock.a]\noffset_s = 1\nrate = 0").contains("rate is 0, expected a number above 0"));
        assert!(found("[clock.a]\noffset = 1").contains("did you mean that?"));
        assert!(found("[clocks.a]\noffset_s = 1").contains("unknown section \"clocks\""));
    }

    proptest! {
        #[test]
        fn what_is_saved_is_what_is_loaded(
            name in "(\\PC|['\"\n.]){0,8}", offset_s in -1e9..1e9, rate in 1e-3..1e3,
            offset_sigma_s in prop::option::of(1e-9..1e3), frame_rate_hz in prop::option::of(1e-3..1e6),
        ) {
            let clock = CameraClock { offset_s, rate, offset_sigma_s, frame_rate_hz };
            let clocks = Clocks(BTreeMap::from([(name, clock)]));
            prop_assert_eq!(parse(&clocks.to_toml()).unwrap(), clocks);
        }
    }
}
