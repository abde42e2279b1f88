//! Where the axes of a head really are: what a calibration has to find.

use foveate_geometry::Camera;
use foveate_geometry::pan_tilt::{Axis, Limits, PanTiltHead};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use super::settings::AxesSettings;

/// The two axes of a head, in the space of its camera at pan 0, tilt 0 (x to the right, y down, z forward).
///
/// The camera sits on the tilt axis, which sits on the pan axis [Davis 2002 §4.2, eq. (2)].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    /// Direction of the pan axis, of length 1: turning about it by the right hand looks to the right.
    pub pan_direction: Vector3<f64>,
    /// A point of the pan axis [m].
    pub pan_point: Point3<f64>,
    /// Direction of the tilt axis, of length 1: turning about it by the right hand looks up.
    pub tilt_direction: Vector3<f64>,
    /// A point of the tilt axis [m].
    pub tilt_point: Point3<f64>,
}

impl Axes {
    /// The axes that the settings describe.
    pub fn new(settings: &AxesSettings) -> Axes {
        let [about_x, about_z] = settings.pan_leans_deg.map(f64::to_radians);
        let pan_lean = UnitQuaternion::from_scaled_axis(Vector3::new(about_x, 0.0, about_z));
        let [about_y, about_z] = settings.tilt_leans_deg.map(f64::to_radians);
        let tilt_lean = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, about_y, about_z));
        let metres = |point: [f64; 3]| Point3::from(point.map(|it| it * 1e-3));
        Axes {
            pan_direction: pan_lean * Vector3::y(),
            pan_point: metres(settings.pan_point_mm),
            tilt_direction: tilt_lean * Vector3::x(),
            tilt_point: metres(settings.tilt_point_mm),
        }
    }

    /// A head with these axes that carries `at_rest`, without limits.
    pub fn carrying(&self, at_rest: &Camera) -> PanTiltHead {
        let axis = |point, direction| Axis { point, direction: Unit::new_normalize(direction) };
        PanTiltHead {
            pan: axis(self.pan_point, self.pan_direction),
            tilt: axis(self.tilt_point, self.tilt_direction),
            ..PanTiltHead::aligned(at_rest.clone(), Limits::WIDE)
        }
    }

    /// Takes points in the camera, turned by these angles [rad], to the space of the camera at pan 0, tilt 0.
    pub fn rest_from_camera(&self, pan_rad: f64, tilt_rad: f64) -> Isometry3<f64> {
        about(self.pan_point, self.pan_direction, pan_rad) * about(self.tilt_point, self.tilt_direction, tilt_rad)
    }
}

fn about(point: Point3<f64>, direction: Vector3<f64>, angle_rad: f64) -> Isometry3<f64> {
    let there = Translation3::from(point);
    there * UnitQuaternion::from_scaled_axis(direction * angle_rad) * there.inverse()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn right_is_right_and_up_is_up() {
        let ideal = AxesSettings {
            pan_leans_deg: [0.0; 2],
            pan_point_mm: [0.0; 3],
            tilt_leans_deg: [0.0; 2],
            tilt_point_mm: [0.0; 3],
        };
        let looks = |pan: f64, tilt: f64| Axes::new(&ideal).rest_from_camera(pan, tilt) * Vector3::z();
        assert!(looks(0.3, 0.0).x > 0.29 && looks(0.0, 0.3).y < -0.29);
        // Tilt rides on pan: the horizon stays level.
        let across = Axes::new(&ideal).rest_from_camera(0.7, 0.4) * Vector3::x();
        assert!(across.y.abs() < 1e-12, "{across}");
    }

    #[test]
    fn the_model_that_is_calibrated_says_the_same() {
        let camera = Camera::look_at(Point3::new(0.0, -4.0, 2.0), Point3::new(0.3, 0.0, 1.0), [640, 480], 700.0);
        let axes = Axes::new(&AxesSettings::default());
        let head = axes.carrying(&camera);
        for (pan, tilt) in [(0.0, 0.0), (0.8, 0.0), (0.0, -0.3), (-1.4, 0.4)] {
            let setting = foveate_geometry::pan_tilt::Setting::new(pan, tilt);
            let rest_from_rest = axes.rest_from_camera(pan, tilt) * head.camera_from_rest(&setting);
            assert!((rest_from_rest.to_homogeneous() - nalgebra::Matrix4::identity()).norm() < 1e-12);
        }
    }

    #[test]
    fn points_of_an_axis_stay_where_they_are() {
        let axes = Axes::new(&AxesSettings::default());
        let on_tilt = axes.tilt_point + axes.tilt_direction * 0.2;
        assert!((axes.rest_from_camera(0.0, 0.6) * on_tilt - on_tilt).norm() < 1e-12);
        let on_pan = axes.pan_point - axes.pan_direction * 0.1;
        assert!((axes.rest_from_camera(-0.9, 0.0) * on_pan - on_pan).norm() < 1e-12);
        let moved = axes.rest_from_camera(1.0, 0.0) * Point3::origin();
        assert!(moved.coords.norm() > 0.02, "the camera swings about an axis that is not its own centre");
    }
}
