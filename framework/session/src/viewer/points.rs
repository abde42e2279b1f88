//! Points: `foxglove.PointCloud` and `foxglove.PosesInFrame`.

use foveate_messages::{
    CloudPoint, Mark, Marks, PointCloud, Provenance, ScaleCloud, Target, Targets, Time, TrackedPoint, TrackedSurface,
};
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion};

use super::schemas::{packed_element_field, point_cloud, poses_in_frame};
use super::wire::Writer;

/// A point with an identity, in the frame of its message: what a target and a mark have in common.
pub(super) struct Dot {
    /// Its identity or label.
    pub(super) id: u32,
    /// In the frame [m].
    pub(super) position: Point3<f64>,
    /// Of the position, in the frame [m²].
    pub(super) covariance: Matrix3<f64>,
    /// Whether it was measured, predicted or filled.
    pub(super) provenance: Provenance,
}

impl From<&Target> for Dot {
    fn from(target: &Target) -> Self {
        Self {
            id: target.id.0,
            position: target.position,
            covariance: target.covariance.fixed_view::<3, 3>(0, 0).into(),
            provenance: target.provenance,
        }
    }
}

impl From<&TrackedPoint> for Dot {
    fn from(point: &TrackedPoint) -> Self {
        Self { id: point.id, position: point.position, covariance: point.covariance, provenance: point.provenance }
    }
}

impl Dot {
    /// In the world, with the mark's own covariance: that of the whole surface is not in it.
    pub(super) fn of_mark(marks: &Marks, mark: &Mark) -> Self {
        let rotation = marks.world_from_marks.rotation.to_rotation_matrix();
        Self {
            id: mark.label,
            position: marks.in_world(mark),
            covariance: rotation * mark.covariance * rotation.inverse(),
            provenance: mark.provenance,
        }
    }

    fn sigma(&self) -> f64 {
        (self.covariance.trace() / 3.0).max(0.0).sqrt()
    }
}

/// Red, green and blue by provenance: measured green, predicted orange, filled blue.
pub(super) const fn colour(provenance: Provenance) -> [u8; 3] {
    match provenance {
        Provenance::Measured => [51, 204, 77],
        Provenance::Predicted => [255, 153, 26],
        Provenance::Filled => [77, 128, 255],
    }
}

// `NumericType` of the schema.
const UINT8: u64 = 1;
const UINT16: u64 = 3;
const UINT32: u64 = 5;
const FLOAT32: u64 = 7;

/// Name, first byte and type of each value of a dot. Provenance: 0 measured, 1 predicted, 2 filled.
const DOT_FIELDS: [(&str, u32, u64); 10] = [
    ("x", 0, FLOAT32),
    ("y", 4, FLOAT32),
    ("z", 8, FLOAT32),
    ("sigma", 12, FLOAT32),
    ("id", 16, UINT32),
    ("red", 20, UINT8),
    ("green", 21, UINT8),
    ("blue", 22, UINT8),
    ("alpha", 23, UINT8),
    ("provenance", 24, UINT8),
];
/// The last three bytes are zero.
const DOT_STRIDE: usize = 28;

/// The same for [`CloudPoint::to_bytes`].
const CLOUD_FIELDS: [(&str, u32, u64); 19] = [
    ("x", 0, FLOAT32),
    ("y", 4, FLOAT32),
    ("z", 8, FLOAT32),
    ("covariance_xx", 12, FLOAT32),
    ("covariance_xy", 16, FLOAT32),
    ("covariance_xz", 20, FLOAT32),
    ("covariance_yy", 24, FLOAT32),
    ("covariance_yz", 28, FLOAT32),
    ("covariance_zz", 32, FLOAT32),
    ("normal_x", 36, FLOAT32),
    ("normal_y", 40, FLOAT32),
    ("normal_z", 44, FLOAT32),
    ("confidence", 48, FLOAT32),
    ("column", 52, UINT16),
    ("row", 54, UINT16),
    ("red", 56, UINT8),
    ("green", 57, UINT8),
    ("blue", 58, UINT8),
    ("alpha", ALPHA as u32, UINT8),
];
/// The byte of a cloud's point that is zero in our messages and opacity in a viewer's.
const ALPHA: usize = 59;

/// A `foxglove.PointCloud` of targets in the frame of their scale: x, y, z, sigma [m], id, colour and provenance.
pub fn targets_cloud(targets: &Targets, frame: &str, out: &mut Vec<u8>) {
    dots_cloud(targets.time, frame, targets.list.iter().map(Dot::from), out);
}

/// A `foxglove.PointCloud` of marks in the world, as [`targets_cloud`]; sigma is the mark's own.
pub fn marks_cloud(marks: &Marks, world: &str, out: &mut Vec<u8>) {
    dots_cloud(marks.time, world, marks.list.iter().map(|it| Dot::of_mark(marks, it)), out);
}

/// A `foxglove.PointCloud` of a tracked surface in the world, as [`targets_cloud`].
pub fn tracked_cloud(surface: &TrackedSurface, world: &str, out: &mut Vec<u8>) {
    dots_cloud(surface.time, world, surface.list.iter().map(Dot::from), out);
}

/// A `foxglove.PointCloud` of surface points in the world, each with its colour and all else that it has.
pub fn cloud(cloud: &PointCloud, world: &str, out: &mut Vec<u8>) {
    placed_cloud(cloud, &Isometry3::identity(), world, out);
}

/// As [`cloud`]: the points lie in the scale's space, and the message says where that is in the world.
pub fn scale_cloud(cloud: &ScaleCloud, world: &str, out: &mut Vec<u8>) {
    placed_cloud(&cloud.cloud, &cloud.world_from_scale, world, out);
}

/// A `foxglove.PosesInFrame` of targets in the frame of their scale, which do not turn.
pub fn targets_poses(targets: &Targets, frame: &str, out: &mut Vec<u8>) {
    let poses = targets.list.iter().map(|it| Translation3::from(it.position).into());
    poses_in_frame(targets.time, frame, poses, out);
}

/// A `foxglove.PosesInFrame` of marks in the world, turned as their space is.
pub fn marks_poses(marks: &Marks, world: &str, out: &mut Vec<u8>) {
    let rotation: UnitQuaternion<f64> = marks.world_from_marks.rotation;
    let poses = marks.list.iter().map(|it| Isometry3::from_parts(marks.in_world(it).into(), rotation));
    poses_in_frame(marks.time, world, poses, out);
}

fn poses_in_frame(time: Time, frame: &str, poses: impl Iterator<Item = Isometry3<f64>>, out: &mut Vec<u8>) {
    let mut it = Writer::new(out);
    it.time(poses_in_frame::timestamp, time);
    it.string(poses_in_frame::frame_id, frame);
    poses.for_each(|pose| it.pose(poses_in_frame::poses, &pose));
}

fn dots_cloud(time: Time, frame: &str, dots: impl Iterator<Item = Dot>, out: &mut Vec<u8>) {
    let mut it = Writer::new(out);
    write_head(&mut it, time, frame, &Isometry3::identity(), DOT_STRIDE, &DOT_FIELDS);
    it.bytes_of(point_cloud::data, |bytes| {
        for dot in dots {
            let end = bytes.len() + DOT_STRIDE;
            let Point3 { coords: at } = dot.position;
            for value in [at.x, at.y, at.z, dot.sigma()] {
                bytes.extend((value as f32).to_le_bytes());
            }
            bytes.extend(dot.id.to_le_bytes());
            bytes.extend(colour(dot.provenance));
            bytes.push(u8::MAX);
            bytes.push(match dot.provenance {
                Provenance::Measured => 0,
                Provenance::Predicted => 1,
                Provenance::Filled => 2,
            });
            bytes.resize(end, 0);
        }
    });
}

fn placed_cloud(cloud: &PointCloud, frame_from_cloud: &Isometry3<f64>, frame: &str, out: &mut Vec<u8>) {
    let mut it = Writer::new(out);
    it.reserve(cloud.points.len() + frame.len() + 1024);
    write_head(&mut it, cloud.time, frame, frame_from_cloud, CloudPoint::BYTES, &CLOUD_FIELDS);
    let whole = &cloud.points[..cloud.len() * CloudPoint::BYTES];
    it.bytes(point_cloud::data, whole);
    let start = out.len() - whole.len();
    out[start..].iter_mut().skip(ALPHA).step_by(CloudPoint::BYTES).for_each(|it| *it = u8::MAX);
}

/// All of a cloud but its points.
fn write_head(
    out: &mut Writer<'_>,
    time: Time,
    frame: &str,
    frame_from_cloud: &Isometry3<f64>,
    stride: usize,
    fields: &[(&str, u32, u64)],
) {
    out.time(point_cloud::timestamp, time);
    out.string(point_cloud::frame_id, frame);
    out.pose(point_cloud::pose, frame_from_cloud);
    out.fixed32(point_cloud::point_stride, stride as u32);
    for (name, offset, kind) in fields {
        out.message(point_cloud::fields, |it| {
            it.string(packed_element_field::name, name);
            it.fixed32(packed_element_field::offset, *offset);
            it.varint(packed_element_field::r#type, *kind);
        });
    }
}

#[cfg(test)]
pub(super) mod tests {
    use foveate_messages::{CameraSet, TargetId};
    use nalgebra::{Matrix6, Vector3};

    use super::super::Kind;
    use super::super::decoded::Decoded;
    use super::*;

    /// A target 7 that was predicted, a target 300 that was measured, whose variances along x, y, z are 1, 4 and 16 cm².
    pub(in super::super) fn targets() -> Targets {
        let target = |id: u32, x: f64, provenance: Provenance| Target {
            id: TargetId(id),
            position: Point3::new(x, 2.0, -3.0),
            velocity: Vector3::x(),
            covariance: Matrix6::from_diagonal(&[1e-4, 4e-4, 16e-4, 9.0, 9.0, 9.0].into()),
            cameras: CameraSet::default(),
            provenance,
        };
        let list = vec![target(7, 0.25, Provenance::Predicted), target(300, 1.5, Provenance::Measured)];
        Targets { time: Time(1_000_000_002), list }
    }

    /// One mark at (1, 0, 0) of a space that lies a quarter turn about z and (1, 2, 0) from the world, so that the world has it at (1, 3, 0).
    pub(in super::super) fn marks() -> Marks {
        let turn = Vector3::z() * std::f64::consts::FRAC_PI_2;
        let mark = Mark {
            label: 5,
            position: Point3::new(1.0, 0.0, 0.0),
            covariance: Matrix3::from_diagonal(&[1e-4, 4e-4, 16e-4].into()),
            cameras: CameraSet::default(),
            provenance: Provenance::Filled,
        };
        let world_from_marks = Isometry3::new(Vector3::new(1.0, 2.0, 0.0), turn);
        Marks { time: Time(3), world_from_marks, list: vec![mark], ..Marks::default() }
    }

    /// Point by point the values of a field, as a viewer finds them by its name, first byte and type.
    #[track_caller]
    fn values(decoded: &Decoded, name: &str) -> Vec<f64> {
        let place =
            (0..decoded.count("fields")).find(|it| decoded.text(&format!("fields[{it}].name")) == name).unwrap();
        let offset = decoded.number(&format!("fields[{place}].offset")) as usize;
        let kind = decoded.number(&format!("fields[{place}].type")) as u64;
        let points = decoded.bytes("data").chunks_exact(decoded.number("point_stride") as usize);
        let value = |point: &[u8]| match kind {
            UINT8 => f64::from(point[offset]),
            UINT16 => f64::from(u16::from_le_bytes(point[offset..offset + 2].try_into().unwrap())),
            UINT32 => f64::from(u32::from_le_bytes(point[offset..offset + 4].try_into().unwrap())),
            _ => f64::from(f32::from_le_bytes(point[offset..offset + 4].try_into().unwrap())),
        };
        points.map(value).collect()
    }

    #[test]
    fn a_cloud_of_targets_has_a_point_for_each() {
        let mut out = Vec::new();
        targets_cloud(&targets(), "room", &mut out);
        let decoded = Decoded::of(Kind::PointCloud, &out);
        assert_eq!((decoded.text("frame_id"), decoded.number("timestamp.nanos")), ("room", 2.0));
        assert_eq!((decoded.number("pose.orientation.w"), decoded.number("pose.position.x")), (1.0, 0.0));
        let column = |name: &str| values(&decoded, name);
        assert_eq!((column("x"), column("y"), column("z")), (vec![0.25, 1.5], vec![2.0; 2], vec![-3.0; 2]));
        assert_eq!((column("id"), column("provenance")), (vec![7.0, 300.0], vec![1.0, 0.0]));
        assert_eq!((column("red"), column("alpha")), (vec![255.0, 51.0], vec![255.0; 2]));
        assert!((column("sigma")[0] - 7e-4_f64.sqrt()).abs() < 1e-8);
    }

    #[test]
    fn marks_are_moved_into_the_world() {
        let mut out = Vec::new();
        marks_cloud(&marks(), "world", &mut out);
        let decoded = Decoded::of(Kind::PointCloud, &out);
        let column = |name: &str| values(&decoded, name);
        assert_eq!((column("x"), column("y"), column("z")), (vec![1.0], vec![3.0], vec![0.0]));
        assert_eq!((column("id"), column("provenance"), column("blue")), (vec![5.0], vec![2.0], vec![255.0]));

        marks_poses(&marks(), "world", &mut out);
        let decoded = Decoded::of(Kind::PosesInFrame, &out);
        assert_eq!((decoded.count("poses"), decoded.number("poses[0].position.y")), (1, 3.0));
        let half = std::f64::consts::FRAC_1_SQRT_2;
        assert!((decoded.number("poses[0].orientation.z") - half).abs() < 1e-12);
        // The axes turn with it: what was the variance along x is along y.
        let turned = Dot::of_mark(&marks(), &marks().list[0]).covariance;
        assert!((turned - Matrix3::from_diagonal(&[4e-4, 1e-4, 16e-4].into())).norm() < 1e-18);
    }

    #[test]
    fn targets_are_poses_that_do_not_turn() {
        let mut out = Vec::new();
        targets_poses(&targets(), "room", &mut out);
        let decoded = Decoded::of(Kind::PosesInFrame, &out);
        assert_eq!((decoded.text("frame_id"), decoded.count("poses")), ("room", 2));
        assert_eq!((decoded.number("poses[1].position.x"), decoded.number("poses[1].orientation.w")), (1.5, 1.0));
    }

    #[test]
    fn a_tracked_surface_is_a_cloud() {
        let point = TrackedPoint {
            id: 70_000,
            position: Point3::new(0.5, 0.0, 0.0),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            covariance: Matrix3::identity(),
            normal: Vector3::z(),
            cameras: CameraSet::default(),
            provenance: Provenance::Measured,
            n_samples: 1,
        };
        let surface = TrackedSurface { time: Time(1), list: vec![point], ended: Vec::new() };
        let mut out = Vec::new();
        tracked_cloud(&surface, "world", &mut out);
        let decoded = Decoded::of(Kind::PointCloud, &out);
        assert_eq!((values(&decoded, "id"), values(&decoded, "sigma")), (vec![70_000.0], vec![1.0]));
    }

    #[test]
    fn a_cloud_keeps_all_that_its_points_have() {
        let point = |x: f32| CloudPoint {
            position: Point3::new(x, -2.5, 3.25),
            covariance: Matrix3::new(4.0, 1.0, 0.5, 1.0, 5.0, 0.25, 0.5, 0.25, 6.0),
            normal: Vector3::y(),
            confidence: 0.75,
            pixel: [1279, 1023],
            colour: [1, 2, 254],
        };
        let mut ours = PointCloud { time: Time(9), ..PointCloud::default() };
        ours.push(&point(1.0));
        ours.push(&point(2.0));
        ours.points.push(7); // of a point that is not whole
        let mut out = Vec::new();
        cloud(&ours, "world", &mut out);
        let decoded = Decoded::of(Kind::PointCloud, &out);
        let expected: [(&str, [f64; 2]); 19] = [
            ("x", [1.0, 2.0]),
            ("y", [-2.5; 2]),
            ("z", [3.25; 2]),
            ("covariance_xx", [4.0; 2]),
            ("covariance_xy", [1.0; 2]),
            ("covariance_xz", [0.5; 2]),
            ("covariance_yy", [5.0; 2]),
            ("covariance_yz", [0.25; 2]),
            ("covariance_zz", [6.0; 2]),
            ("normal_x", [0.0; 2]),
            ("normal_y", [1.0; 2]),
            ("normal_z", [0.0; 2]),
            ("confidence", [0.75; 2]),
            ("column", [1279.0; 2]),
            ("row", [1023.0; 2]),
            ("red", [1.0; 2]),
            ("green", [2.0; 2]),
            ("blue", [254.0; 2]),
            ("alpha", [255.0; 2]),
        ];
        for (name, expected) in expected {
            assert_eq!(values(&decoded, name), expected, "{name}");
        }

        let world_from_scale = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::z());
        let moved = ScaleCloud { cloud: ours, world_from_scale, covariance: Matrix6::zeros() };
        scale_cloud(&moved, "world", &mut out);
        let decoded = Decoded::of(Kind::PointCloud, &out);
        assert_eq!((decoded.number("pose.position.z"), decoded.text("frame_id")), (3.0, "world"));
        assert!((decoded.number("pose.orientation.z") - 0.5_f64.sin()).abs() < 1e-12);
        assert_eq!(values(&decoded, "x"), [1.0, 2.0]);
    }
}
