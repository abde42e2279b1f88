//! The clock of a source's times: the session's, or the camera's own from the calibration or a file.

use foveate::prelude::*;
use foveate::scene::clocks::{CameraClock, Clocks};

/// Finds the clock that `setting` names for the instance's camera: `none`, `calibration`, or `file:PATH`. Its frame rate is that of
/// the calibration where the clock itself states none; with `none`, only the frame rate is used.
///
/// # Errors
/// Points at the setting `clock`: another word, a file that cannot be read, a camera that the file lacks.
pub(crate) fn camera_clock(setup: &Setup, setting: &str) -> Result<CameraClock, ConfigError> {
    let name = setup.camera_name().unwrap_or_default();
    let of_calibration = setup.calibration.clocks.0.get(name).copied();
    let frame_rate_hz = of_calibration.and_then(|it| it.frame_rate_hz);
    let clock = match setting.split_once(':') {
        None if setting == "none" => CameraClock::default(),
        // Where no camera of the calibration has a clock, the session's is meant.
        None if setting == "calibration" && setup.calibration.clocks.0.is_empty() => CameraClock::default(),
        None if setting == "calibration" => of_calibration.ok_or_else(|| {
            ConfigError::at("clock", format_args!("found clocks in the calibration, but none of camera `{name}`"))
        })?,
        Some(("file", path)) => {
            let path = setup.path("clock", path)?;
            let clocks = Clocks::load(&path).map_err(|fault| ConfigError::at("clock", fault))?;
            clocks.0.get(name).copied().ok_or_else(|| {
                ConfigError::at("clock", format_args!("`{}` holds no clock of camera `{name}`", path.display()))
            })?
        }
        _ => {
            let message =
                format!("found `{setting}`, expected `calibration`, `none` or `file:` and the path of a file");
            return Err(ConfigError::at("clock", message));
        }
    };
    Ok(CameraClock { frame_rate_hz: clock.frame_rate_hz.or(frame_rate_hz), ..clock })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate::scene::Calibration;

    use super::*;
    use crate::settings::tests::setup_with_camera;

    #[test]
    fn clock_comes_from_where_the_setting_says() {
        let plain = setup_with_camera([640, 480]);
        assert_eq!(camera_clock(&plain, "calibration"), Ok(CameraClock::default()));
        let own = CameraClock { offset_s: 3.0, rate: 1.5, offset_sigma_s: None, frame_rate_hz: Some(25.0) };
        let with = |name: &str| {
            let clocks = Clocks([(name.to_owned(), own)].into());
            Setup { calibration: Arc::new(Calibration { clocks, ..(*plain.calibration).clone() }), ..plain.clone() }
        };
        assert_eq!(camera_clock(&with("ring-1"), "calibration"), Ok(own));
        let bare = CameraClock { frame_rate_hz: Some(25.0), ..CameraClock::default() };
        assert_eq!(camera_clock(&with("ring-1"), "none"), Ok(bare));
        let refused = |setup: &Setup, setting: &str| camera_clock(setup, setting).unwrap_err().message;
        assert!(refused(&with("ring-2"), "calibration").contains("`ring-1`"));
        assert!(refused(&plain, "table").contains("found `table`"));
        assert!(refused(&plain, "file:/no/such.toml").contains("/no/such.toml"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("clocks.toml");
        std::fs::write(&path, "[clock.ring-1]\noffset_s = 7\n").unwrap();
        let setting = format!("file:{}", path.display());
        let found = camera_clock(&with("ring-1"), &setting).unwrap();
        assert_eq!((found.offset_s, found.rate, found.frame_rate_hz), (7.0, 1.0, Some(25.0)));
        std::fs::write(&path, "[clock.ring-2]\noffset_s = 7\n").unwrap();
        assert!(refused(&plain, &setting).contains("no clock of camera `ring-1`"));
    }
}
