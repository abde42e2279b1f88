//! Off-axis projection: the frustum from an eye through a screen, for each eye and each tile.
//!
//! Source: R. Kooima, "Generalized perspective projection", Louisiana State University, 2008.
//!
//! | here              | paper          | meaning                                              | unit |
//! |-------------------|----------------|------------------------------------------------------|------|
//! | `lower_left`      | pa             | corner of the screen                                 | m    |
//! | `lower_right`     | pb             | corner                                               | m    |
//! | `upper_left`      | pc             | corner                                               | m    |
//! | `eye`             | pe             | the eye                                              | m    |
//! | `right`, `up`, `normal` | vr, vu, vn | axes of the screen; the normal points to the viewer | –    |
//! | `distance`        | d              | −vn · va: distance of the eye from the screen's plane | m    |
//! | `near`, `far`     | n, f           | clipping planes: distances from the eye along the normal | m   |
//! | `clip_from_world` | P Mᵀ T         | to the clip space of OpenGL and WebGL: −w ≤ x, y, z ≤ w | – |
//!
//! The paper takes the corners as they are; corners that people have touched are not an exact rectangle. Here the
//! upper edge is made perpendicular to the lower one, and corners too far from a rectangle are refused.

use nalgebra::{Matrix4, Point2, Point3, Vector3, Vector4};

/// A corner may be so far from a right angle: 1 % of the height of a screen to the side.
const MOST_SKEW: f64 = 0.01;
/// An eye nearer to the screen's plane than this part of the screen's width sees nothing that could be drawn.
const LEAST_DISTANCE: f64 = 1e-3;

/// A flat screen in the world: a tile of a wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Screen {
    lower_left: Point3<f64>,
    right: Vector3<f64>,
    up: Vector3<f64>,
    size: [f64; 2],
}

/// Why there is no screen, or no frustum for an eye.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ScreenError {
    /// Corners that are not finite, or too close to each other.
    #[error("found edges of {width} m and {height} m, expected a screen that is wider and higher than 1 mm")]
    NoArea {
        /// Length of the lower edge [m].
        width: f64,
        /// Length of the left edge [m].
        height: f64,
    },
    /// The corners are too far from a rectangle.
    #[error("found {angle_deg:.1}° between the lower and the left edge, expected a right angle")]
    Skewed {
        /// Angle between the edges [°].
        angle_deg: f64,
    },
    /// The eye lies in the screen's plane, or behind it.
    #[error("found the eye at {distance:.3} m from the screen's plane, expected it in front of the screen (above 0)")]
    EyeNotBefore {
        /// Distance of the eye from the plane, negative behind it [m].
        distance: f64,
    },
    /// Clipping planes that are not in order.
    #[error("found clipping planes at {near} m and {far} m, expected 0 < near < far")]
    Clipping {
        /// Distance of the near plane [m].
        near: f64,
        /// Distance of the far plane [m].
        far: f64,
    },
}

/// The projection that one eye needs on a screen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffAxis {
    /// Maps a point of the world to clip space.
    pub clip_from_world: Matrix4<f64>,
    /// Distance of the eye from the screen's plane [m].
    pub distance: f64,
}

impl Screen {
    /// A screen from three of its corners, as a viewer in front of it sees them [m].
    ///
    /// # Errors
    /// No area, or no rectangle.
    pub fn from_corners(
        lower_left: Point3<f64>,
        lower_right: Point3<f64>,
        upper_left: Point3<f64>,
    ) -> Result<Screen, ScreenError> {
        let (along, upwards) = (lower_right - lower_left, upper_left - lower_left);
        let [width, height] = [along.norm(), upwards.norm()];
        if !(width > 1e-3 && height > 1e-3 && width.is_finite() && height.is_finite()) {
            return Err(ScreenError::NoArea { width, height });
        }
        let right = along / width;
        let across = upwards - right * right.dot(&upwards);
        if (right.dot(&upwards) / height).abs() > MOST_SKEW {
            return Err(ScreenError::Skewed { angle_deg: right.angle(&upwards).to_degrees() });
        }
        Ok(Screen { lower_left, right, up: across.normalize(), size: [width, across.norm()] })
    }

    /// Width and height [m].
    pub fn size(&self) -> [f64; 2] {
        self.size
    }

    /// Unit normal towards the viewer: vr × vu.
    pub fn normal(&self) -> Vector3<f64> {
        self.right.cross(&self.up)
    }

    /// A point of the screen, given from its lower left corner [m].
    pub fn point(&self, [x, y]: [f64; 2]) -> Point3<f64> {
        self.lower_left + self.right * x + self.up * y
    }

    /// Where the line from `eye` to `point` crosses the screen's plane, from its lower left corner [m]; `None` where
    /// it does not cross it ahead of the eye.
    pub fn through(&self, eye: &Point3<f64>, point: &Point3<f64>) -> Option<Point2<f64>> {
        let normal = self.normal();
        let distance = normal.dot(&(eye - self.lower_left));
        let towards = -normal.dot(&(point - eye));
        let along = distance / towards;
        let at = eye + (point - eye) * along - self.lower_left;
        let is_seen = distance > 0.0 && towards > 0.0 && along.is_finite();
        is_seen.then(|| Point2::new(self.right.dot(&at), self.up.dot(&at)))
    }

    /// The frustum from `eye` through the screen, between clipping planes [m].
    ///
    /// # Errors
    /// An eye that is not in front of the screen, or clipping planes that are not in order.
    pub fn off_axis(&self, eye: &Point3<f64>, [near, far]: [f64; 2]) -> Result<OffAxis, ScreenError> {
        if !(near > 0.0 && far > near && far.is_finite()) {
            return Err(ScreenError::Clipping { near, far });
        }
        let normal = self.normal();
        let to_corner = self.lower_left - eye; // va
        let distance = -normal.dot(&to_corner); // d
        let is_before = distance > LEAST_DISTANCE * self.size[0] && eye.iter().all(|it| it.is_finite());
        if !is_before {
            return Err(ScreenError::EyeNotBefore { distance });
        }
        let scale = near / distance;
        let [left, bottom] = [self.right.dot(&to_corner) * scale, self.up.dot(&to_corner) * scale]; // l, b
        let [width, height] = self.size.map(|it| it * scale); // r − l, t − b
        let depth = far - near;
        #[rustfmt::skip]
        let projection = Matrix4::new(
            2.0 * near / width, 0.0, (2.0 * left + width) / width, 0.0,
            0.0, 2.0 * near / height, (2.0 * bottom + height) / height, 0.0,
            0.0, 0.0, -(far + near) / depth, -2.0 * far * near / depth,
            0.0, 0.0, -1.0, 0.0,
        ); // P
        let row = |axis: &Vector3<f64>| Vector4::new(axis.x, axis.y, axis.z, -axis.dot(&eye.coords)).transpose();
        let eye_from_world = Matrix4::from_rows(&[
            row(&self.right),
            row(&self.up),
            row(&normal),
            Vector4::new(0.0, 0.0, 0.0, 1.0).transpose(),
        ]); // Mᵀ T
        Ok(OffAxis { clip_from_world: projection * eye_from_world, distance })
    }
}

impl OffAxis {
    /// Normalised device coordinates of a point of the world: −1 to 1 across the screen, upwards, and from the near to
    /// the far plane; `None` behind the eye.
    pub fn drawn(&self, point: &Point3<f64>) -> Option<Point3<f64>> {
        let clip = self.clip_from_world * point.to_homogeneous();
        (clip.w > 0.0).then(|| Point3::from(clip.xyz() / clip.w))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Translation3, UnitQuaternion};
    use proptest::prelude::*;

    use super::*;

    const CLIP: [f64; 2] = [0.1, 50.0];

    /// A screen of 2 m by 1 m in the plane z = 0, and that anywhere.
    fn screen(world_from_screen: &Isometry3<f64>) -> Screen {
        let at = |x: f64, y: f64| world_from_screen * Point3::new(x, y, 0.0);
        Screen::from_corners(at(-1.0, -0.5), at(1.0, -0.5), at(-1.0, 0.5)).unwrap()
    }

    prop_compose! {
        fn anywhere()(turn in prop::array::uniform3(-3.0..3.0), place in prop::array::uniform3(-5.0..5.0)) -> Isometry3<f64> {
            Isometry3::from_parts(Translation3::from(place), UnitQuaternion::new(turn.into()))
        }
    }

    proptest! {
        #[test]
        fn corners_of_the_screen_are_the_corners_of_clip_space(
            place in anywhere(), x in -4.0..4.0, y in -4.0..4.0, z in 0.05..6.0,
        ) {
            let screen = screen(&place);
            let eye = place * Point3::new(x, y, z);
            let view = screen.off_axis(&eye, CLIP).unwrap();
            prop_assert!((view.distance - z).abs() < 1e-9);
            for (corner, expected) in [([0.0, 0.0], [-1.0, -1.0]), ([2.0, 0.0], [1.0, -1.0]), ([0.0, 1.0], [-1.0, 1.0]), ([2.0, 1.0], [1.0, 1.0])] {
                let drawn = view.drawn(&screen.point(corner)).unwrap();
                prop_assert!((drawn.x - expected[0]).abs() < 1e-9 && (drawn.y - expected[1]).abs() < 1e-9, "{drawn}");
            }
        }

        #[test]
        fn what_is_drawn_covers_what_the_eye_sees_through_the_screen(
            place in anywhere(), eye in prop::array::uniform3(-2.0..2.0), point in prop::array::uniform3(-3.0..3.0),
        ) {
            // Two metres before the screen and more; behind it, and before it.
            let screen = screen(&place);
            let [eye, point] = [place * Point3::new(eye[0], eye[1], eye[2] + 4.0), place * Point3::new(point[0], point[1], point[2] - 1.5)];
            let drawn = screen.off_axis(&eye, CLIP).unwrap().drawn(&point).unwrap();
            let on_screen = [(drawn.x + 1.0) * 1.0, (drawn.y + 1.0) * 0.5];
            // By hand: the point of the screen must lie on the line from the eye to the point.
            let there = screen.point(on_screen);
            let (to_there, to_point) = ((there - eye).normalize(), (point - eye).normalize());
            prop_assert!(to_there.cross(&to_point).norm() < 1e-9 && to_there.dot(&to_point) > 0.0);
            let through = screen.through(&eye, &point).unwrap();
            prop_assert!((through.x - on_screen[0]).abs() < 1e-9 && (through.y - on_screen[1]).abs() < 1e-9);
        }
    }

    #[test]
    fn near_and_far_are_the_ends_of_the_depth() {
        let screen = screen(&Isometry3::identity());
        let view = screen.off_axis(&Point3::new(0.3, -0.2, 2.0), CLIP).unwrap();
        for (z, expected) in [(2.0 - 0.1, -1.0), (2.0 - 50.0, 1.0)] {
            assert!((view.drawn(&Point3::new(0.5, 0.5, z)).unwrap().z - expected).abs() < 1e-9);
        }
        assert_eq!(view.drawn(&Point3::new(0.0, 0.0, 2.1)), None, "behind the eye");
    }

    #[test]
    fn an_eye_in_the_middle_has_the_frustum_that_everybody_knows() {
        let screen = screen(&Isometry3::identity());
        let view = screen.off_axis(&Point3::new(0.0, 0.0, 2.0), CLIP).unwrap();
        // Symmetric: half a width of 1 m at 2 m, so that x is scaled by 2 and y by 4.
        assert!(
            (view.clip_from_world[(0, 0)] - 2.0).abs() < 1e-12 && (view.clip_from_world[(1, 1)] - 4.0).abs() < 1e-12
        );
        assert!(view.clip_from_world[(0, 2)].abs() < 1e-12);
    }

    #[test]
    fn eyes_in_the_plane_and_behind_it_are_named() {
        let screen = screen(&Isometry3::identity());
        let refused = |eye: Point3<f64>| screen.off_axis(&eye, CLIP).unwrap_err();
        assert_eq!(refused(Point3::new(5.0, 0.0, 0.0)), ScreenError::EyeNotBefore { distance: 0.0 });
        assert_eq!(refused(Point3::new(0.0, 0.0, -1.0)), ScreenError::EyeNotBefore { distance: -1.0 });
        assert!(matches!(refused(Point3::new(0.0, f64::NAN, 1.0)), ScreenError::EyeNotBefore { .. }));
        assert!(refused(Point3::new(0.0, 0.0, 0.001)).to_string().contains("0.001 m from the screen's plane"));
        assert_eq!(screen.through(&Point3::new(0.0, 0.0, -1.0), &Point3::new(0.0, 0.0, 1.0)), None);
        assert_eq!(screen.through(&Point3::new(0.0, 0.0, 1.0), &Point3::new(0.5, 0.0, 1.0)), None, "along the screen");
        for near_far in [[0.0, 1.0], [1.0, 1.0], [0.1, f64::INFINITY], [f64::NAN, 1.0]] {
            let found = screen.off_axis(&Point3::new(0.0, 0.0, 1.0), near_far);
            assert!(matches!(found, Err(ScreenError::Clipping { .. })));
        }
    }

    #[test]
    fn corners_that_make_no_screen_are_named() {
        let [a, b] = [Point3::origin(), Point3::new(2.0, 0.0, 0.0)];
        assert_eq!(Screen::from_corners(a, a, b), Err(ScreenError::NoArea { width: 0.0, height: 2.0 }));
        let in_line = Screen::from_corners(a, b, Point3::new(1.0, 0.0, 0.0)).unwrap_err();
        assert!(in_line.to_string().contains("found 0.0° between"), "{in_line}");
        assert!(matches!(Screen::from_corners(a, b, Point3::new(0.1, 1.0, 0.0)), Err(ScreenError::Skewed { .. })));
        // Touched to 5 mm: a rectangle all the same.
        let touched = Screen::from_corners(a, b, Point3::new(0.005, 1.0, 0.003)).unwrap();
        assert!((touched.size()[1] - 1.0).abs() < 1e-4 && touched.point([0.0, 1.0]).x.abs() < 1e-4);
        assert!(Screen::from_corners(a, b, Point3::new(0.0, f64::NAN, 0.0)).is_err());
    }
}
