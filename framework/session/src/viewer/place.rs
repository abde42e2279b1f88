//! Where things are: `foxglove.FrameTransforms`, and the lens of a camera: `foxglove.CameraCalibration`.

use foveate_messages::{HeadPose, ScaleSpace, Time, Window};
use nalgebra::{Isometry3, Matrix3, Point2, Point3, UnitQuaternion, Vector3};

use super::schemas::{
    camera_calibration, frame_transform, frame_transforms, point2, point3, pose, quaternion, vector3,
};
use super::wire::Writer;

/// Where a frame is in another one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transform<'n> {
    /// The frame around it.
    pub parent: &'n str,
    /// The frame that is placed.
    pub child: &'n str,
    /// Takes points of the child to the parent [m].
    pub parent_from_child: Isometry3<f64>,
}

/// A `foxglove.FrameTransforms`, all at `time`.
pub fn transforms<'n>(time: Time, list: impl IntoIterator<Item = Transform<'n>>, out: &mut Vec<u8>) {
    let mut it = Writer::new(out);
    for Transform { parent, child, parent_from_child } in list {
        it.message(frame_transforms::transforms, |it| {
            it.time(frame_transform::timestamp, time);
            it.string(frame_transform::parent_frame_id, parent);
            it.string(frame_transform::child_frame_id, child);
            it.vector(frame_transform::translation, &parent_from_child.translation.vector);
            it.rotation(frame_transform::rotation, &parent_from_child.rotation);
        });
    }
}

/// A `foxglove.FrameTransforms` that places a camera on a head in the world.
pub fn head_pose(pose: &HeadPose, world: &str, camera: &str, out: &mut Vec<u8>) {
    let world_from_camera = pose.camera_from_world.inverse();
    transforms(pose.time, [Transform { parent: world, child: camera, parent_from_child: world_from_camera }], out);
}

/// A `foxglove.FrameTransforms` that places a scale in its parent. Of a scale without a target it is the last place that was known.
pub fn scale_space(space: &ScaleSpace, parent: &str, scale: &str, out: &mut Vec<u8>) {
    transforms(space.time, [Transform { parent, child: scale, parent_from_child: space.parent_from_scale }], out);
}

/// The lens of a camera: the model of Brown and Conrady, see docs/notation.md.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraModel {
    /// Columns and rows [px].
    pub size: [u32; 2],
    /// Horizontal and vertical focal length [px].
    pub focal: [f64; 2],
    /// Principal point; (0, 0) is the centre of the top-left pixel [px].
    pub principal: [f64; 2],
    /// Skew between columns and rows [px].
    pub skew: f64,
    /// k1, k2, p1, p2, k3 [–].
    pub distortion: [f64; 5],
}

impl CameraModel {
    /// The model of the pictures of `size` (columns, rows) that show `window` of this camera's.
    pub fn of_window(&self, window: &Window, size: [u32; 2]) -> CameraModel {
        let principal = window.in_image(&Point2::from(self.principal));
        let shrink = f64::from(window.shrink);
        CameraModel {
            size,
            focal: self.focal.map(|it| it / shrink),
            principal: [principal.x, principal.y],
            skew: self.skew / shrink,
            distortion: self.distortion,
        }
    }
}

/// A `foxglove.CameraCalibration` (`plumb_bob`) of the camera whose frame this is. Its matrices count pixels from the centre of the top-left one, as OpenCV's do.
pub fn camera_calibration(time: Time, camera: &CameraModel, frame: &str, out: &mut Vec<u8>) {
    let CameraModel { size, focal, principal, skew, distortion } = *camera;
    let k = [[focal[0], skew, principal[0]], [0.0, focal[1], principal[1]], [0.0, 0.0, 1.0]];
    let mut it = Writer::new(out);
    it.time(camera_calibration::timestamp, time);
    it.string(camera_calibration::frame_id, frame);
    it.fixed32(camera_calibration::width, size[0]);
    it.fixed32(camera_calibration::height, size[1]);
    it.string(camera_calibration::distortion_model, "plumb_bob");
    it.doubles(camera_calibration::D, distortion);
    it.doubles(camera_calibration::K, k.into_iter().flatten());
    it.doubles(camera_calibration::R, Matrix3::identity().iter().copied());
    // The picture without distortion has the same matrix, and no second camera beside it.
    it.doubles(camera_calibration::P, k.into_iter().flat_map(|row| row.into_iter().chain([0.0])));
}

impl Writer<'_> {
    /// A `foxglove.Vector3`.
    pub(super) fn vector(&mut self, field: u32, value: &Vector3<f64>) {
        self.message(field, |it| {
            it.double(vector3::x, value.x);
            it.double(vector3::y, value.y);
            it.double(vector3::z, value.z);
        });
    }

    /// A `foxglove.Point3`.
    pub(super) fn point(&mut self, field: u32, value: &Point3<f64>) {
        self.message(field, |it| {
            it.double(point3::x, value.x);
            it.double(point3::y, value.y);
            it.double(point3::z, value.z);
        });
    }

    /// A `foxglove.Point2`.
    pub(super) fn point2(&mut self, field: u32, value: &Point2<f64>) {
        self.message(field, |it| {
            it.double(point2::x, value.x);
            it.double(point2::y, value.y);
        });
    }

    fn rotation(&mut self, field: u32, value: &UnitQuaternion<f64>) {
        self.message(field, |it| {
            it.double(quaternion::x, value.i);
            it.double(quaternion::y, value.j);
            it.double(quaternion::z, value.k);
            it.double(quaternion::w, value.w);
        });
    }

    /// A `foxglove.Pose`: takes points of the thing to the frame.
    pub(super) fn pose(&mut self, field: u32, frame_from_thing: &Isometry3<f64>) {
        self.message(field, |it| {
            it.vector(pose::position, &frame_from_thing.translation.vector);
            it.rotation(pose::orientation, &frame_from_thing.rotation);
        });
    }
}

#[cfg(test)]
mod tests {
    use foveate_messages::{CameraId, Interval, ScaleId};
    use nalgebra::{Matrix2, Matrix6, Quaternion};

    use super::super::Kind;
    use super::super::decoded::Decoded;
    use super::*;

    /// A quarter turn about z, then (1, 2, 0): the example of the schema, where (1, 0, 0) of the child is (1, 3, 0) of the parent.
    fn parent_from_child() -> Isometry3<f64> {
        Isometry3::new(Vector3::new(1.0, 2.0, 0.0), Vector3::z() * std::f64::consts::FRAC_PI_2)
    }

    /// Where a viewer puts a point of the child: rotates it, then moves it.
    #[track_caller]
    fn in_parent(decoded: &Decoded, point_in_child: Point3<f64>) -> Point3<f64> {
        let [x, y, z, w] = ["x", "y", "z", "w"].map(|it| decoded.number(&format!("transforms[0].rotation.{it}")));
        let translation = ["x", "y", "z"].map(|it| decoded.number(&format!("transforms[0].translation.{it}")));
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        rotation * point_in_child + Vector3::from(translation)
    }

    #[test]
    fn a_transform_places_the_child_in_the_parent() {
        let mut out = Vec::new();
        let there = Transform { parent: "world", child: "rig", parent_from_child: parent_from_child() };
        transforms(Time(5), [there, Transform { child: "other", ..there }], &mut out);
        let decoded = Decoded::of(Kind::FrameTransforms, &out);
        assert_eq!(decoded.count("transforms"), 2);
        assert_eq!(decoded.text("transforms[0].parent_frame_id"), "world");
        assert_eq!(decoded.text("transforms[0].child_frame_id"), "rig");
        assert_eq!(decoded.text("transforms[1].child_frame_id"), "other");
        assert_eq!(decoded.number("transforms[1].timestamp.nanos"), 5.0);
        let point = in_parent(&decoded, Point3::new(1.0, 0.0, 0.0));
        assert!((point - Point3::new(1.0, 3.0, 0.0)).norm() < 1e-12, "{point}");
    }

    #[test]
    fn a_camera_on_a_head_stands_where_its_own_origin_is_in_the_world() {
        let pose = HeadPose {
            camera: CameraId(1),
            time: Time(7_000_000_001),
            angles: [0.1, 0.2],
            angles_covariance: Matrix2::zeros(),
            rates: [0.0; 2],
            zoom: None,
            camera_from_world: parent_from_child(),
            covariance: Matrix6::zeros(),
            age: Interval(0),
        };
        let mut out = Vec::new();
        head_pose(&pose, "world", "head", &mut out);
        let decoded = Decoded::of(Kind::FrameTransforms, &out);
        assert_eq!(decoded.text("transforms[0].parent_frame_id"), "world");
        assert_eq!(decoded.text("transforms[0].child_frame_id"), "head");
        assert_eq!(decoded.number("transforms[0].timestamp.seconds"), 7.0);
        // The lens itself, and what lies a metre before it.
        for point_in_camera in [Point3::origin(), Point3::new(0.0, 0.0, 1.0), Point3::new(0.3, -0.2, 2.0)] {
            let point_in_world = in_parent(&decoded, point_in_camera);
            assert!((pose.camera_from_world * point_in_world - point_in_camera).norm() < 1e-12);
        }
        assert!((in_parent(&decoded, Point3::origin()) - Point3::new(-2.0, 1.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn a_scale_is_placed_in_its_parent() {
        let space = ScaleSpace {
            scale: ScaleId(1),
            time: Time(3),
            target: None,
            parent_from_scale: parent_from_child(),
            covariance: Matrix6::zeros(),
            velocity: Vector3::zeros(),
            motion_covariance: Matrix6::zeros(),
        };
        let mut out = Vec::new();
        scale_space(&space, "room", "face", &mut out);
        let decoded = Decoded::of(Kind::FrameTransforms, &out);
        assert_eq!(decoded.text("transforms[0].parent_frame_id"), "room");
        assert_eq!(decoded.text("transforms[0].child_frame_id"), "face");
        assert!((in_parent(&decoded, Point3::new(0.0, 1.0, 0.0)) - Point3::new(0.0, 2.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn a_calibration_projects_as_the_camera_does_in_the_whole_and_in_a_window() {
        let camera = CameraModel {
            size: [1280, 1024],
            focal: [900.0, 910.0],
            principal: [641.5, 509.5],
            skew: 0.5,
            distortion: [0.1, 0.2, 0.3, 0.4, 0.5],
        };
        let mut out = Vec::new();
        camera_calibration(Time(0), &camera, "left", &mut out);
        let decoded = Decoded::of(Kind::CameraCalibration, &out);
        assert_eq!((decoded.text("frame_id"), decoded.text("distortion_model")), ("left", "plumb_bob"));
        assert_eq!((decoded.number("width"), decoded.number("height")), (1280.0, 1024.0));
        assert_eq!(decoded.numbers("D"), [0.1, 0.2, 0.3, 0.4, 0.5]);
        assert_eq!(decoded.numbers("K"), [900.0, 0.5, 641.5, 0.0, 910.0, 509.5, 0.0, 0.0, 1.0]);
        assert_eq!(decoded.numbers("R"), [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        assert_eq!(decoded.numbers("P"), [900.0, 0.5, 641.5, 0.0, 0.0, 910.0, 509.5, 0.0, 0.0, 0.0, 1.0, 0.0]);

        let project = |it: &CameraModel, [x, y]: [f64; 2]| {
            Point2::new(it.focal[0] * x + it.skew * y + it.principal[0], it.focal[1] * y + it.principal[1])
        };
        let window = Window { left: 100, top: 40, shrink: 2 };
        let part = camera.of_window(&window, [320, 240]);
        let expected = window.in_image(&project(&camera, [0.1, -0.2]));
        assert!((project(&part, [0.1, -0.2]) - expected).norm() < 1e-12);
        assert_eq!((part.size, part.distortion), ([320, 240], camera.distortion));
    }
}
