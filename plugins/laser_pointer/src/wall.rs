//! The rectangle of the wall that outputs use as the range from 0 to 1.

use foveate::prelude::*;
use nalgebra::{Point2, Vector2};

/// The rectangle of a wall, in metres on it: x runs to the right, y down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wall {
    /// Its top left corner [m].
    pub(crate) corner: Point2<f64>,
    /// Its width and height [m].
    pub(crate) size: Vector2<f64>,
}

impl Wall {
    /// The wall of the node's scale: its working volume, seen from the front.
    ///
    /// # Errors
    /// A scale without a working volume, or one without an area.
    pub(crate) fn of(setup: &Setup) -> Result<Wall, ConfigError> {
        let Some([min, max]) = setup.volume_m else {
            let message =
                "found a scale without a working volume, expected `volume_m` of the scale with the wall's extent";
            return Err(ConfigError::node(message));
        };
        let corner = Point2::new(min[0], min[1]);
        let size = Vector2::new(max[0] - min[0], max[1] - min[1]);
        if !(size.x > 0.0 && size.y > 0.0) {
            let message = format!("found a wall of {} m by {} m, expected one with an area", size.x, size.y);
            return Err(ConfigError::node(message));
        }
        Ok(Wall { corner, size })
    }

    /// A point as shares of the wall's width and height; outside of 0 to 1 beyond its edges [–].
    pub(crate) fn part(&self, point: &Point2<f64>) -> Vector2<f64> {
        (point - self.corner).component_div(&self.size)
    }
}
