//! Shiny surfaces in which LEDs are seen again: the floor, and the glass of the display.

use nalgebra::{Point3, Vector3};

use super::furniture::DISPLAY;
use crate::lab::ROOM_M;

/// A flat mirror, at right angles to one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mirror {
    /// The axis that it is at right angles to: 0, 1, 2 for x, y, z.
    axis: usize,
    /// Where it is along that axis [m].
    at: f64,
    /// Opposite corners along all axes [m]; those of `axis` are not looked at.
    bounds: [[f64; 3]; 2],
}

impl Mirror {
    /// The floor of the room.
    pub const FLOOR: Mirror = Mirror { axis: 2, at: 0.0, bounds: ROOM_M };
    /// The glass before the display.
    pub const DISPLAY: Mirror = Mirror {
        axis: 1,
        at: ROOM_M[1][1],
        bounds: [[DISPLAY[0][0], 0.0, DISPLAY[0][1]], [DISPLAY[1][0], 0.0, DISPLAY[1][1]]],
    };

    /// Where `point` seems to be behind the mirror [m].
    pub fn image(&self, point: &Point3<f64>) -> Point3<f64> {
        let mut image = *point;
        image[self.axis] = 2.0 * self.at - point[self.axis];
        image
    }

    /// Where on the mirror `eye` sees `point`, and the cosine of the angle at which; `None` beside the mirror.
    pub fn reflect(&self, eye: &Point3<f64>, point: &Point3<f64>) -> Option<(Point3<f64>, f64)> {
        let along: Vector3<f64> = self.image(point) - eye;
        let share = (self.at - eye[self.axis]) / along[self.axis];
        let place = eye + along * share;
        let [low, high] = self.bounds;
        let inside = (0..3).filter(|it| *it != self.axis).all(|it| (low[it]..=high[it]).contains(&place[it]));
        (inside && share > 0.0 && share < 1.0).then(|| (place, along[self.axis].abs() / along.norm()))
    }

    /// Share of the light that a surface with `reflectance` seen straight on throws back at an angle of that cosine.
    ///
    /// Source: C. Schlick, "An inexpensive BRDF model for physically-based rendering", Computer Graphics Forum 13(3), 1994.
    pub fn share(reflectance: f64, cosine: f64) -> f64 {
        if reflectance <= 0.0 { 0.0 } else { reflectance + (1.0 - reflectance) * (1.0 - cosine).powi(5) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_of_incidence_and_reflection_are_equal() {
        let (eye, point) = (Point3::new(-2.0, 1.0, 2.7), Point3::new(1.0, -0.5, 1.2));
        for (mirror, normal) in [(Mirror::FLOOR, Vector3::z()), (Mirror::DISPLAY, Vector3::y())] {
            let (place, cosine) = mirror.reflect(&eye, &point).unwrap();
            let [to_eye, to_point] = [eye, point].map(|it| (it - place).normalize());
            assert!((to_eye.dot(&normal).abs() - cosine).abs() < 1e-12);
            assert!((to_eye.dot(&normal) - to_point.dot(&normal)).abs() < 1e-12);
            let halfway = (to_eye + to_point).normalize();
            assert!((halfway.dot(&normal).abs() - 1.0).abs() < 1e-12, "{mirror:?}: {halfway}");
            assert!((mirror.image(&mirror.image(&point)) - point).norm() < 1e-12);
        }
    }

    #[test]
    fn beside_the_mirror_nothing_is_seen() {
        let eye = Point3::new(0.0, 3.0, 2.8);
        // The line to the image of a high point meets the wall above the display.
        assert_eq!(Mirror::DISPLAY.reflect(&eye, &Point3::new(0.0, 3.5, 2.7)), None);
        assert!(Mirror::DISPLAY.reflect(&eye, &Point3::new(0.0, 1.0, 0.5)).is_some());
    }

    #[test]
    fn grazing_light_is_thrown_back_whole() {
        assert_eq!((Mirror::share(0.05, 1.0), Mirror::share(0.05, 0.0), Mirror::share(0.0, 0.0)), (0.05, 1.0, 0.0));
    }
}
