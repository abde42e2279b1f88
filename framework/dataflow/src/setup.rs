//! What a node is given when it is made: its place in the rig, its camera, randomness, folders.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_messages::CameraId;
use foveate_scene::calibration::{Calibration, LengthUnit};

use crate::error::ConfigError;

/// Where the recordings lie when the environment variable `FOVEATE_DATA` is not set.
const DATA_DEFAULT: &str = "../shared/data";

/// Why a node is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// To see whether its settings hold; it will not run. Write nothing, start nothing.
    Check,
    /// To run.
    Run,
}

/// What a node is given when it is made.
#[derive(Debug, Clone)]
pub struct Setup {
    /// Full name: scale, node, camera: `room.leds[wide-3]`.
    pub instance: String,
    /// The scale that the node lies in.
    pub scale: String,
    /// The camera that this instance serves, where the rig says `each` or `camera`.
    pub camera: Option<CameraId>,
    /// All cameras by number; without cameras where the rig names no calibration.
    pub calibration: Arc<Calibration>,
    /// The working volume of the scale [m], opposite corners, where the rig states it.
    pub volume_m: Option<[[f64; 3]; 2]>,
    /// This instance's own stream, from the rig's seed and the instance's name.
    pub random: Random,
    /// The folder of the rig file: relative paths in settings start here.
    pub rig_dir: PathBuf,
    /// The folder for results, where there is one.
    pub out_dir: Option<PathBuf>,
    /// Why the node is made.
    pub purpose: Purpose,
}

impl Setup {
    /// A setup for tests: no cameras, seed 1, the current folder.
    pub fn for_tests() -> Self {
        Self {
            instance: "test.node".to_owned(),
            scale: "test".to_owned(),
            camera: None,
            calibration: no_cameras(),
            volume_m: None,
            random: Random::new(1),
            rig_dir: PathBuf::from("."),
            out_dir: None,
            purpose: Purpose::Run,
        }
    }

    /// The name of this instance's camera.
    pub fn camera_name(&self) -> Option<&str> {
        let index = usize::from(self.camera?.0);
        Some(&self.calibration.cameras.get(index)?.name)
    }

    /// The model of this instance's camera.
    pub fn camera_model(&self) -> Option<&Camera> {
        let index = usize::from(self.camera?.0);
        Some(&self.calibration.cameras.get(index)?.camera)
    }

    /// A path from a setting: `{camera}` becomes the camera's name, `${NAME}` an environment variable, and what is relative
    /// starts at the rig's folder (at the current folder where it comes out of a variable).
    ///
    /// # Errors
    /// `{camera}` in a node without one; a variable that is not set.
    pub fn path(&self, setting: &str, text: &str) -> Result<PathBuf, ConfigError> {
        let text = match (text.contains("{camera}"), self.camera_name()) {
            (false, _) => text.to_owned(),
            (true, Some(name)) => text.replace("{camera}", name),
            (true, None) => {
                return Err(ConfigError::at(
                    setting,
                    "`{camera}` needs a node with `each` or `camera`; this one has neither",
                ));
            }
        };
        expand_path(&text, &self.rig_dir).map_err(|message| ConfigError::at(setting, message))
    }
}

/// The calibration of a rig that names none.
pub fn no_cameras() -> Arc<Calibration> {
    Arc::new(Calibration { cameras: Vec::new(), length_unit: LengthUnit::Metre, origin: String::new() })
}

/// Replaces each `${NAME}` by the environment variable of that name; what is relative and does not begin with a
/// variable starts at `base`.
///
/// # Errors
/// A sentence about a variable that is not set, or a `${` that never closes.
pub fn expand_path(text: &str, base: &Path) -> Result<PathBuf, String> {
    let mut expanded = String::new();
    let mut rest = text;
    while let Some(start) = rest.find("${") {
        expanded.push_str(&rest[..start]);
        let Some(length) = rest[start..].find('}') else {
            return Err(format!("`{text}` opens `${{` and never closes it"));
        };
        let name = &rest[start + 2..start + length];
        match std::env::var(name) {
            Ok(value) => expanded.push_str(&value),
            Err(_) if name == "FOVEATE_DATA" => expanded.push_str(DATA_DEFAULT),
            Err(_) => return Err(format!("the environment variable `{name}` in `{text}` is not set")),
        }
        rest = &rest[start + length + 1..];
    }
    expanded.push_str(rest);
    Ok(if text.starts_with("${") { PathBuf::from(expanded) } else { base.join(expanded) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_paths_start_at_the_rig_and_variables_at_the_current_folder() {
        let base = Path::new("/rigs");
        assert_eq!(expand_path("a/b.toml", base), Ok(PathBuf::from("/rigs/a/b.toml")));
        assert_eq!(expand_path("/abs", base), Ok(PathBuf::from("/abs")));
        let with_variable = expand_path("${FOVEATE_DATA}/x", base);
        assert!(with_variable.is_ok_and(|path| !path.starts_with("/rigs") && path.ends_with("x")));
    }

    #[test]
    fn unset_variable_and_open_brace_are_named() {
        let base = Path::new("/rigs");
        assert!(expand_path("${NO_SUCH_VARIABLE_HERE}/x", base).is_err_and(|it| it.contains("NO_SUCH_VARIABLE_HERE")));
        assert!(expand_path("${HOME/x", base).is_err_and(|it| it.contains("never closes")));
    }

    #[test]
    fn camera_in_a_path_needs_a_camera() {
        let refused = Setup::for_tests().path("path", "{camera}/*.jpg");
        assert!(refused.is_err_and(|it| it.message.contains("neither")));
    }
}
