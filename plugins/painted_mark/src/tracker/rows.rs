//! Rolling shutter: converts positions to the exposure time of the middle row.
//!
//! Row y of H is exposed (y / (H − 1) − 1/2) T after the middle one, T being the readout; a mark with image velocity v, head motion included, was v times that
//! farther back. v is the step from the picture before, over the time between the two, and half of what that changed since the step before: a difference belongs to half a period ago.

use foveate::prelude::Time;
use nalgebra::{Point2, Vector2};

/// Longest step from which a velocity is computed [s].
const LONGEST_S: f64 = 0.15;

/// Converts the positions of rows to the time of the middle row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows {
    readout_s: f64,
    /// Of the whole picture of the camera [px].
    height: f64,
    /// From the picture before to this one [s].
    step_s: f64,
}

impl Rows {
    /// For a picture at `now` of a camera with `height` rows; `None` without rolling shutter, or without a picture before.
    pub fn of(readout_ms: f64, height: u32, before: Option<Time>, now: Time) -> Option<Rows> {
        let step_s = (now - before?).as_s();
        let is_known = readout_ms > 0.0 && height > 1 && (1e-4..LONGEST_S).contains(&step_s);
        is_known.then_some(Rows { readout_s: readout_ms * 1e-3, height: f64::from(height), step_s })
    }

    /// Position at the time of the middle row of a mark seen at `pixel` that moves by `step` per picture, both in pixels of the camera.
    pub fn at_middle(&self, pixel: &Point2<f64>, step: &Vector2<f64>) -> Point2<f64> {
        let late_s = (pixel.y / (self.height - 1.0) - 0.5) * self.readout_s;
        pixel - step * (late_s / self.step_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_below_the_middle_saw_things_later() {
        let rows = Rows::of(8.0, 481, Some(Time::from_s(1.0)), Time::from_s(1.04)).unwrap();
        let step = Vector2::new(20.0, -10.0);
        // The last row is 4 ms late: a tenth of the step.
        assert!((rows.at_middle(&Point2::new(100.0, 480.0), &step) - Point2::new(98.0, 481.0)).norm() < 1e-9);
        assert!((rows.at_middle(&Point2::new(100.0, 0.0), &step) - Point2::new(102.0, -1.0)).norm() < 1e-9);
        assert_eq!(rows.at_middle(&Point2::new(100.0, 240.0), &step), Point2::new(100.0, 240.0));
        assert!(Rows::of(0.0, 481, Some(Time::from_s(1.0)), Time::from_s(1.04)).is_none());
        assert!(Rows::of(8.0, 481, Some(Time::from_s(1.0)), Time::from_s(1.5)).is_none());
        assert!(Rows::of(8.0, 481, None, Time::from_s(1.5)).is_none());
    }
}
