//! A dark board that is held before the cameras for a while, upright and across Y: what lies behind it is hidden, in each camera where its own lines of sight meet the board.

use foveate_geometry::Camera;
use foveate_messages::Time;
use foveate_node::ConfigError;
use nalgebra::Point2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoardSettings {
    /// Its middle [m]
    pub at_m: [f64; 3],
    /// Half its extent along X and along Z [m]
    pub half_m: [f64; 2],
    /// From when to when it is there [s]
    pub between_s: [f64; 2],
}

impl BoardSettings {
    /// Refuses numbers out of their ranges.
    pub fn check(&self) -> Result<(), ConfigError> {
        for place in self.at_m {
            ConfigError::unless_in("board.at_m", place, -1e3..=1e3)?;
        }
        for half in self.half_m {
            ConfigError::unless_in("board.half_m", half, 1e-3..=1e3)?;
        }
        ConfigError::unless_in("board.between_s", self.between_s[0], 0.0..=1e6)?;
        ConfigError::unless_in("board.between_s", self.between_s[1], self.between_s[0]..=1e6)
    }

    /// Makes the pixels of `canvas` that see the board at `time` as dark as `level`.
    pub fn hide(&self, camera: &Camera, time: Time, level: i16, canvas: &mut [i16]) {
        if !(self.between_s[0]..self.between_s[1]).contains(&time.as_s()) {
            return;
        }
        let width = camera.image_size[0] as usize;
        for (index, pixel) in canvas.iter_mut().enumerate() {
            let place = Point2::new((index % width) as f64, (index / width) as f64);
            let Some(ray) = camera.ray(&place) else { continue };
            let depth = (self.at_m[1] - ray.origin.y) / ray.direction.y;
            let met = ray.at(depth);
            let is_inside =
                [(0, 0), (2, 1)].iter().all(|(axis, half)| (met[*axis] - self.at_m[*axis]).abs() <= self.half_m[*half]);
            if depth > 0.0 && is_inside {
                *pixel = level;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use foveate_geometry::{Camera, Distortion, Intrinsics};
    use nalgebra::{Isometry3, UnitQuaternion, Vector3};

    use super::*;

    #[test]
    fn a_board_hides_what_lies_behind_it_while_it_is_there() {
        // Two metres before the board, which is 0.41 m wide and 0.21 m high: 100 px a metre there.
        let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
        let camera = Camera {
            image_size: [80, 60],
            intrinsics: Intrinsics { focal: [200.0, 200.0], principal: [40.0, 30.0], skew: 0.0 },
            distortion: Distortion::default(),
            camera_from_world: Isometry3::from_parts(Vector3::zeros().into(), turn),
        };
        let board = BoardSettings { at_m: [0.05, 2.0, 0.1], half_m: [0.203, 0.103], between_s: [1.0, 2.0] };
        let hidden = |at_s: f64| {
            let mut canvas = vec![100; 80 * 60];
            board.hide(&camera, Time::from_s(at_s), 7, &mut canvas);
            (0..canvas.len()).filter(|it| canvas[*it] == 7).map(|it| (it % 80, it / 80)).collect::<Vec<_>>()
        };
        assert!(hidden(0.9).is_empty() && hidden(2.0).is_empty());
        let found = hidden(1.0);
        let (columns, rows): (Vec<usize>, Vec<usize>) = found.iter().copied().unzip();
        let ends = |list: &[usize]| (*list.iter().min().unwrap(), *list.iter().max().unwrap());
        // z is up and rows go down.
        assert_eq!((ends(&columns), ends(&rows), found.len()), ((25, 65), (10, 30), 41 * 21));
    }
}
