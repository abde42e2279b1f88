//! A camera that is knocked, and stays turned.

use foveate_geometry::Camera;
use foveate_node::{ConfigError, Setup, Time};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::truth::TrueCamera;

/// Which camera is knocked, when, and by how much it is turned after that, about its own axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BumpSettings {
    /// Its name in the calibration, which goes on saying that it stands where it stood [–].
    pub camera: String,
    /// When, on the session clock [s].
    #[schemars(range(min = 0.0, max = 1e9))]
    pub at_s: f64,
    /// About its downward axis: to the right [mrad].
    #[serde(default)]
    #[schemars(range(min = -1000.0, max = 1000.0))]
    pub yaw_mrad: f64,
    /// About its rightward axis: upward [mrad].
    #[serde(default)]
    #[schemars(range(min = -1000.0, max = 1000.0))]
    pub pitch_mrad: f64,
    /// About its line of sight: clockwise [mrad].
    #[serde(default)]
    #[schemars(range(min = -1000.0, max = 1000.0))]
    pub roll_mrad: f64,
}

impl BumpSettings {
    /// Refuses what is out of range, and a camera that does not exist.
    pub(crate) fn check(&self, setup: &Setup) -> Result<(), ConfigError> {
        ConfigError::unless_in("bump.at_s", self.at_s, 0.0..=1e9)?;
        ConfigError::unless_in("bump.yaw_mrad", self.yaw_mrad, -1000.0..=1000.0)?;
        ConfigError::unless_in("bump.pitch_mrad", self.pitch_mrad, -1000.0..=1000.0)?;
        ConfigError::unless_in("bump.roll_mrad", self.roll_mrad, -1000.0..=1000.0)?;
        let known = setup.calibration.index_of(&self.camera).is_some();
        known.then_some(()).ok_or_else(|| {
            let message = format!("found `{}`, expected a camera of the calibration", self.camera);
            ConfigError::at("bump.camera", message)
        })
    }

    /// `camera` as it stands after the bump.
    pub fn turned(&self, camera: &Camera) -> Camera {
        // A camera that turns one way sees the world turn the other way.
        let turn = -Vector3::new(self.pitch_mrad, self.yaw_mrad, self.roll_mrad) * 1e-3;
        let after_from_before = UnitQuaternion::from_scaled_axis(turn);
        let camera_from_world =
            Isometry3::from_parts(Translation3::identity(), after_from_before) * camera.camera_from_world;
        Camera { camera_from_world, ..camera.clone() }
    }
}

/// A bump that is still to come.
#[derive(Debug, Clone)]
pub(crate) struct Pending {
    pub at: Time,
    bump: BumpSettings,
}

impl Pending {
    /// `None` when it is another camera that is knocked, or none.
    pub(crate) fn of(bump: Option<&BumpSettings>, setup: &Setup) -> Result<Option<Self>, ConfigError> {
        let Some(bump) = bump else { return Ok(None) };
        bump.check(setup)?;
        let is_it = setup.camera_name() == Some(bump.camera.as_str());
        Ok(is_it.then(|| Self { at: Time::from_s(bump.at_s), bump: bump.clone() }))
    }

    /// The camera after it.
    pub(crate) fn knocked(&self, camera: &TrueCamera) -> TrueCamera {
        camera.standing(self.bump.turned(camera).camera_from_world)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn a_camera_knocked_to_the_right_sees_the_world_go_left() {
        let camera = Camera::look_at(Point3::new(0.0, -4.0, 1.0), Point3::new(0.0, 0.0, 1.0), [640, 480], 500.0);
        let bump = |yaw_mrad, pitch_mrad| BumpSettings {
            camera: String::new(),
            at_s: 0.0,
            yaw_mrad,
            pitch_mrad,
            roll_mrad: 0.0,
        };
        let point = Point3::new(0.0, 0.0, 1.0);
        let before = camera.project(&point).unwrap();
        let right = bump(10.0, 0.0).turned(&camera);
        assert!((right.project(&point).unwrap() - before - nalgebra::Vector2::new(-5.0, 0.0)).norm() < 0.01);
        assert!((right.centre() - camera.centre()).norm() < 1e-12);
        let up = bump(0.0, 10.0).turned(&camera).project(&point).unwrap();
        assert!((up - before - nalgebra::Vector2::new(0.0, 5.0)).norm() < 0.01);
    }
}
