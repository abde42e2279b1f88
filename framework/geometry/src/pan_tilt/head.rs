//! A camera on a pan-tilt head: kinematics [Davis 2002 (2)].

use nalgebra::{Isometry3, Matrix2, Matrix2x3, Point2, Point3, Unit, Vector3};

use super::axis::Axis;
use super::zoom::ZoomTable;
use crate::camera::{Camera, CameraError};

/// Which axis carries the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Stacking {
    /// The pan axis is fixed in the world and carries the tilt axis, as in nearly all heads.
    #[default]
    TiltOnPan,
    /// The tilt axis is fixed and carries the pan axis: equation (2) as it is written.
    PanOnTilt,
}

/// Pan, tilt and zoom of a head.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Setting {
    /// Angle about the pan axis [rad].
    pub pan: f64,
    /// Angle about the tilt axis [rad].
    pub tilt: f64,
    /// Position of the zoom drive in the units of the table; without it, or without a table, the optics are those at rest.
    pub zoom: Option<f64>,
}

impl Setting {
    /// A setting without a zoom position; angles in rad.
    pub fn new(pan: f64, tilt: f64) -> Setting {
        Setting { pan, tilt, zoom: None }
    }
}

/// Lower and upper limits of the angles [rad].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Limits of pan.
    pub pan: [f64; 2],
    /// Limits of tilt.
    pub tilt: [f64; 2],
}

impl Limits {
    /// Any pan, tilt from straight down to straight up.
    pub const WIDE: Limits = Limits {
        pan: [f64::NEG_INFINITY, f64::INFINITY],
        tilt: [-std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_2],
    };

    /// Limits of ± these angles [rad].
    pub fn symmetric(pan: f64, tilt: f64) -> Limits {
        Limits { pan: [-pan, pan], tilt: [-tilt, tilt] }
    }

    /// Whether both angles are within the limits.
    pub fn contain(&self, setting: &Setting) -> bool {
        (self.pan[0]..=self.pan[1]).contains(&setting.pan) && (self.tilt[0]..=self.tilt[1]).contains(&setting.tilt)
    }

    /// The nearest setting within the limits.
    pub fn clamp(&self, setting: &Setting) -> Setting {
        let [pan, tilt] =
            [(setting.pan, self.pan), (setting.tilt, self.tilt)].map(|(it, [low, high])| it.max(low).min(high));
        Setting { pan, tilt, zoom: setting.zoom }
    }
}

/// Unit and zero of an angle as the device counts it: angle = (units − `at_rest`) · `rad_per_unit`. The zero is a
/// convention: the camera at rest is the camera at `at_rest`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisUnits {
    /// Angle of one unit [rad]; negative where the device counts against the direction of the axis.
    pub rad_per_unit: f64,
    /// The device's number at angle zero.
    pub at_rest: f64,
}

impl AxisUnits {
    /// Settings are in radians.
    pub const RADIANS: AxisUnits = AxisUnits { rad_per_unit: 1.0, at_rest: 0.0 };
    /// Settings are in degrees.
    pub const DEGREES: AxisUnits = AxisUnits { rad_per_unit: std::f64::consts::PI / 180.0, at_rest: 0.0 };

    /// The angle at a device's number [rad].
    #[inline]
    pub fn angle(&self, units: f64) -> f64 {
        (units - self.at_rest) * self.rad_per_unit
    }

    /// The device's number at an angle, not rounded to what the device can take.
    #[inline]
    pub fn units(&self, angle: f64) -> f64 {
        angle / self.rad_per_unit + self.at_rest
    }
}

/// A camera, rigid on a head with two axes.
#[derive(Debug, Clone, PartialEq)]
pub struct PanTiltHead {
    /// The camera with both angles zero.
    pub at_rest: Camera,
    /// The pan axis with both angles zero, in the space of the camera at rest.
    pub pan: Axis,
    /// The tilt axis with both angles zero, in the space of the camera at rest.
    pub tilt: Axis,
    /// Which axis carries the other.
    pub stacking: Stacking,
    /// Angles that the head can take.
    pub limits: Limits,
    /// Optics by zoom position, for a lens that zooms.
    pub zoom: Option<ZoomTable>,
}

/// Pixel of a point, with derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadProjection {
    /// Projected pixel [px].
    pub pixel: Point2<f64>,
    /// Derivative with respect to pan and tilt [px/rad].
    pub by_angles: Matrix2<f64>,
    /// Derivative with respect to the point in the world [px/m].
    pub by_point: Matrix2x3<f64>,
}

/// Why a [`PanTiltHead`] cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HeadError {
    /// The camera at rest cannot be used.
    #[error("the camera at rest: {0}")]
    BadCamera(CameraError),
    /// An axis with a number that is not finite, or without direction.
    #[error("the {axis} axis has point {point:?} and direction {direction:?}, expected finite numbers and length 1")]
    BadAxis {
        /// Which axis.
        axis: &'static str,
        /// Point that was found [m].
        point: [f64; 3],
        /// Direction that was found.
        direction: [f64; 3],
    },
    /// Limits in the wrong order.
    #[error("the limits of {axis} are {} to {} rad, expected the smaller one first", found[0], found[1])]
    BadLimits {
        /// Which axis.
        axis: &'static str,
        /// Lower and upper limit [rad].
        found: [f64; 2],
    },
}

impl PanTiltHead {
    /// The simple model (1): pan about the camera's y (down), tilt about its x (right), both through the centre of projection.
    pub fn aligned(at_rest: Camera, limits: Limits) -> PanTiltHead {
        let through = |direction: Unit<Vector3<f64>>| Axis { point: Point3::origin(), direction };
        let (pan, tilt) = (through(Vector3::y_axis()), through(Vector3::x_axis()));
        PanTiltHead { at_rest, pan, tilt, stacking: Stacking::TiltOnPan, limits, zoom: None }
    }

    /// The camera at `setting`, also beyond the limits.
    pub fn camera_at(&self, setting: &Setting) -> Camera {
        Camera {
            camera_from_world: self.camera_from_rest(setting) * self.at_rest.camera_from_world,
            ..self.optics_at(setting.zoom)
        }
    }

    /// Maps points in the space of the camera at rest to points in the camera at `setting`.
    #[inline]
    pub fn camera_from_rest(&self, setting: &Setting) -> Isometry3<f64> {
        let (pan, tilt) = (self.pan.turn(-setting.pan), self.tilt.turn(-setting.tilt));
        match self.stacking {
            Stacking::TiltOnPan => tilt * pan,
            Stacking::PanOnTilt => pan * tilt,
        }
    }

    /// Projects `point_in_world` at `setting`, with derivatives. `None` as for [`Camera::project`].
    pub fn project_with_jacobian(&self, point_in_world: &Point3<f64>, setting: &Setting) -> Option<HeadProjection> {
        let at_rest = self.at_rest.camera_from_world * point_in_world;
        let [(outer, by_outer), (inner, by_inner)] = self.by_carrier([setting.pan, setting.tilt]);
        let (turn_outer, turn_inner) = (outer.turn(-by_outer), inner.turn(-by_inner));
        let on_outer = turn_outer * at_rest;
        let in_camera = turn_inner * on_outer;
        let mut optics = self.optics_at(setting.zoom);
        optics.camera_from_world = Isometry3::identity();
        let (pixel, by_camera) = optics.project_with_jacobian(&in_camera)?;
        let velocity_outer = -(turn_inner.rotation * outer.direction.cross(&(on_outer - outer.point)));
        let velocity_inner = -inner.direction.cross(&(in_camera - inner.point));
        let [by_pan, by_tilt] =
            self.by_carrier([by_camera * velocity_outer, by_camera * velocity_inner]).map(|it| it.1);
        let rotation = turn_inner.rotation * turn_outer.rotation * self.at_rest.camera_from_world.rotation;
        Some(HeadProjection {
            pixel,
            by_angles: Matrix2::from_columns(&[by_pan, by_tilt]),
            by_point: by_camera * rotation.to_rotation_matrix().matrix(),
        })
    }

    /// Checks that the head can be used; the first fault, in the order of the fields.
    pub fn check(&self) -> Result<(), HeadError> {
        self.at_rest.check().map_err(HeadError::BadCamera)?;
        for (name, axis) in [("pan", &self.pan), ("tilt", &self.tilt)] {
            let sound = axis.point.iter().all(|it| it.is_finite()) && (axis.direction.norm() - 1.0).abs() < 1e-6;
            if !sound {
                let [point, direction] = [axis.point.coords, axis.direction.into_inner()].map(<[f64; 3]>::from);
                return Err(HeadError::BadAxis { axis: name, point, direction });
            }
        }
        for (axis, found) in [("pan", self.limits.pan), ("tilt", self.limits.tilt)] {
            if found[0].is_nan() || found[1].is_nan() || found[0] > found[1] {
                return Err(HeadError::BadLimits { axis, found });
            }
        }
        Ok(())
    }

    /// The optics at a zoom position, with the pose at rest.
    pub(super) fn optics_at(&self, zoom: Option<f64>) -> Camera {
        let mut camera = self.at_rest.clone();
        if let (Some(table), Some(zoom)) = (&self.zoom, zoom) {
            (camera.intrinsics, camera.distortion) = table.optics_at(zoom);
        }
        camera
    }

    /// The axis that stands still and the one it carries, each with its part of a pair that is in the order pan, tilt; the same again turns
    /// a pair in the order of the axes back into pan, tilt.
    #[inline]
    pub(super) fn by_carrier<T: Copy>(&self, [pan, tilt]: [T; 2]) -> [(&Axis, T); 2] {
        match self.stacking {
            Stacking::TiltOnPan => [(&self.pan, pan), (&self.tilt, tilt)],
            Stacking::PanOnTilt => [(&self.tilt, tilt), (&self.pan, pan)],
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use foveate_laws::check_jacobian;
    use nalgebra::{DMatrix, Vector4};
    use proptest::prelude::*;

    use super::*;
    use crate::camera::Distortion;

    /// A head on the wall at 2.4 m, aimed into the room, its axes a few centimetres and degrees from where they should be.
    pub(in crate::pan_tilt) fn crooked(turn: [f64; 4], shift: [f64; 4], stacking: Stacking) -> PanTiltHead {
        let mut camera = Camera::look_at(Point3::new(-3.0, 0.5, 2.4), Point3::new(0.0, 0.2, 1.4), [640, 480], 700.0);
        camera.distortion = Distortion { k1: -0.12, k2: 0.03, p1: 0.001, p2: -0.002, k3: 0.0 };
        let mut head = PanTiltHead::aligned(camera, Limits::symmetric(1.75, 0.5));
        head.pan = head.pan.moved(&Vector4::new(turn[0], turn[1], shift[0], shift[1]));
        head.tilt = head.tilt.moved(&Vector4::new(turn[2], turn[3], shift[2], shift[3]));
        head.stacking = stacking;
        head
    }

    pub(in crate::pan_tilt) fn stackings() -> impl Strategy<Value = Stacking> {
        prop_oneof![Just(Stacking::TiltOnPan), Just(Stacking::PanOnTilt)]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        #[test]
        fn the_projection_is_the_camera_s_and_its_derivatives_those_of_differences(
            turn in prop::array::uniform4(-0.3..0.3), shift in prop::array::uniform4(-0.1..0.1), stacking in stackings(),
            pan in -1.7..1.7, tilt in -0.6..0.6, x in -0.3..0.3, y in -0.2..0.2, z in 0.5..6.0,
        ) {
            let head = crooked(turn, shift, stacking);
            let setting = Setting::new(pan, tilt);
            let camera = head.camera_at(&setting);
            let point = camera.camera_from_world.inverse_transform_point(&Point3::new(x * z, y * z, z));
            let found = head.project_with_jacobian(&point, &setting).unwrap();
            prop_assert!((found.pixel - camera.project(&point).unwrap()).norm() < 1e-8);
            let by_point = camera.project_with_jacobian(&point).unwrap().1;
            prop_assert!((found.by_point - by_point).norm() < 1e-7 * by_point.norm());
            let project = |it: &[f64]| {
                let camera = head.camera_at(&Setting::new(it[0], it[1]));
                camera.project(&point).unwrap().coords.as_slice().to_vec()
            };
            let by_angles = DMatrix::from_fn(2, 2, |row, column| found.by_angles[(row, column)]);
            check_jacobian(project, &by_angles, &[pan, tilt], 1e-4);
        }

        #[test]
        fn a_device_s_numbers_go_there_and_back(rad_per_unit in 1e-4..0.1_f64, at_rest in -500.0..500.0, units in -900.0..900.0) {
            let axis = AxisUnits { rad_per_unit: -rad_per_unit, at_rest };
            prop_assert!((axis.units(axis.angle(units)) - units).abs() < 1e-9);
        }
    }

    #[test]
    fn an_aligned_head_turns_right_and_up_about_its_lens() {
        let camera = Camera::look_at(Point3::new(0.0, 0.0, 2.0), Point3::new(0.0, 5.0, 2.0), [640, 480], 700.0);
        let head = PanTiltHead::aligned(camera.clone(), Limits::WIDE);
        for (pan, tilt) in [(0.4, 0.0), (0.0, 0.3), (-1.2, -0.4)] {
            let turned = head.camera_at(&Setting::new(pan, tilt));
            assert!((turned.centre() - camera.centre()).norm() < 1e-12);
            // Looking along +Y of the world, right is +X and up +Z.
            let ahead = Vector3::new(pan.sin() * tilt.cos(), pan.cos() * tilt.cos(), tilt.sin());
            let seen = turned.project(&(camera.centre() + ahead * 3.0)).unwrap();
            assert!((seen - Point2::new(319.5, 239.5)).norm() < 1e-9, "{pan} {tilt} {seen}");
        }
    }

    #[test]
    fn the_order_of_the_axes_shows_only_when_both_angles_do() {
        let [usual, other] = [Stacking::TiltOnPan, Stacking::PanOnTilt].map(|it| crooked([0.05; 4], [0.03; 4], it));
        let apart = |pan: f64, tilt: f64| {
            let [a, b] = [&usual, &other].map(|it| it.camera_from_rest(&Setting::new(pan, tilt)));
            (a.inverse() * b).rotation.angle()
        };
        assert!(apart(1.0, 0.0) < 1e-12 && apart(0.0, 0.5) < 1e-12 && apart(1.0, 0.5) > 0.3);
    }

    #[test]
    fn a_head_without_pan_or_straight_up_is_a_camera_like_others() {
        let head = crooked([0.0; 4], [0.0; 4], Stacking::TiltOnPan);
        for tilt in [-std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_2] {
            let camera = head.camera_at(&Setting::new(0.3, tilt));
            camera.check().unwrap();
            let ahead = camera.camera_from_world.inverse_transform_point(&Point3::new(0.1, 0.1, 2.0));
            assert!(head.project_with_jacobian(&ahead, &Setting::new(0.3, tilt)).is_some());
            let behind = camera.camera_from_world.inverse_transform_point(&Point3::new(0.1, 0.1, -2.0));
            assert_eq!(head.project_with_jacobian(&behind, &Setting::new(0.3, tilt)), None);
        }
    }

    #[test]
    fn zoom_takes_effect_where_there_is_a_table() {
        use crate::pan_tilt::zoom::{ZoomStop, ZoomTable};
        let mut head = crooked([0.02; 4], [0.02; 4], Stacking::TiltOnPan);
        let zoomed = Setting { zoom: Some(0.5), ..Setting::new(0.2, 0.1) };
        assert_eq!(head.camera_at(&zoomed), head.camera_at(&Setting::new(0.2, 0.1)));
        let stop = |zoom: f64, focal: f64| {
            let mut intrinsics = head.at_rest.intrinsics;
            intrinsics.focal = [focal; 2];
            ZoomStop { zoom, intrinsics, distortion: Distortion::default() }
        };
        head.zoom = Some(ZoomTable::new(vec![stop(0.0, 700.0), stop(1.0, 2800.0)]).unwrap());
        let camera = head.camera_at(&zoomed);
        assert!((camera.intrinsics.focal[0] - 1400.0).abs() < 1e-9 && camera.distortion == Distortion::default());
        assert_eq!(camera.camera_from_world, head.camera_at(&Setting::new(0.2, 0.1)).camera_from_world);
        let point = camera.camera_from_world.inverse_transform_point(&Point3::new(0.1, 0.1, 2.0));
        let pixel = head.project_with_jacobian(&point, &zoomed).unwrap().pixel;
        assert!((pixel - camera.project(&point).unwrap()).norm() < 1e-9);
    }

    #[test]
    fn what_makes_a_head_unusable_is_named() {
        let fault_of = |change: &dyn Fn(&mut PanTiltHead)| {
            let mut head = crooked([0.0; 4], [0.0; 4], Stacking::TiltOnPan);
            head.check().unwrap();
            change(&mut head);
            head.check().unwrap_err().to_string()
        };
        assert_eq!(
            fault_of(&|it| it.at_rest.image_size = [0, 1]),
            "the camera at rest: image_size is 0 x 1 px, expected at least 1 x 1 px"
        );
        assert_eq!(
            fault_of(&|it| it.limits.tilt = [0.5, -0.5]),
            "the limits of tilt are 0.5 to -0.5 rad, expected the smaller one first"
        );
        assert!(fault_of(&|it| it.tilt.point.x = f64::NAN).starts_with("the tilt axis has point [NaN"));
        assert!(fault_of(&|it| it.pan.direction = Unit::new_unchecked(Vector3::zeros())).starts_with("the pan axis"));
    }
}
