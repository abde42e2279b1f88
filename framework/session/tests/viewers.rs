//! A file with every kind of message is read by the readers of others.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use foveate_messages::{
    CameraId, CameraSet, CloudPoint, Feature, Features, HeadPose, Image, Interval, Mark, Marks, Mesh, MeshVertex,
    PixelFormat, PointCloud, Provenance, ScaleCloud, ScaleId, ScaleSpace, Skeleton, SkeletonJoint, Skeletons, SourceId,
    Stamp, Target, TargetId, Targets, Time, Window,
};
use foveate_session::viewer::{self, CameraModel, Kind, LogLevel, PictureHeader, Schema, Transform};
use nalgebra::{Isometry3, Matrix2, Matrix3, Matrix6, Point2, Point3, Vector3};

const TIME: Time = Time(1_500_000_000);

/// A quarter turn about z, then (1, 2, 3).
fn pose() -> Isometry3<f64> {
    Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::z() * std::f64::consts::FRAC_PI_2)
}

fn image(format: PixelFormat) -> Image {
    let pixels = (0..32 * 24 * format.channels()).map(|it| it as u8).collect();
    Image { camera: CameraId(1), width: 32, height: 24, format, pixels, window: Window::default() }
}

fn targets() -> Targets {
    let target = |id: u32, provenance: Provenance| Target {
        id: TargetId(id),
        position: Point3::new(f64::from(id), 0.5, 1.5),
        velocity: Vector3::zeros(),
        covariance: Matrix6::from_diagonal(&[1e-4, 4e-4, 16e-4, 0.0, 0.0, 0.0].into()),
        cameras: CameraSet::default(),
        provenance,
    };
    let list = [Provenance::Measured, Provenance::Predicted, Provenance::Filled];
    Targets { time: TIME, list: (1..).zip(list).map(|(id, it)| target(id, it)).collect() }
}

fn marks() -> Marks {
    let mark = Mark {
        label: 5,
        position: Point3::new(1.0, 0.0, 0.0),
        covariance: Matrix3::identity() * 1e-4,
        cameras: CameraSet::default(),
        provenance: Provenance::Measured,
    };
    Marks { time: TIME, world_from_marks: pose(), list: vec![mark], ..Marks::default() }
}

fn cloud() -> PointCloud {
    let mut cloud = PointCloud { time: TIME, ..PointCloud::default() };
    for x in 0..3_u8 {
        cloud.push(&CloudPoint {
            position: Point3::new(x.into(), -2.5, 3.25),
            covariance: Matrix3::identity(),
            normal: Vector3::y(),
            confidence: 0.75,
            pixel: [7, 9],
            colour: [10 * x, 200, 30],
        });
    }
    cloud
}

fn mesh() -> Mesh {
    let vertex = |[x, y]: [f32; 2]| MeshVertex {
        position: Point3::new(x, y, 1.0),
        normal: Vector3::z(),
        weight: 1.0,
        sigma: 0.001,
        colour: [51, 102, 255],
    };
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(vertex);
    Mesh { time: TIME, world_from_mesh: pose(), ..Mesh::new(corners, &[[0, 1, 2], [2, 1, 3]]) }
}

fn skeletons() -> Skeletons {
    let joint = |joint: u8| SkeletonJoint {
        joint,
        position: Point3::new(0.1 * f64::from(joint), 0.0, 1.0),
        velocity: Vector3::zeros(),
        covariance: Matrix6::identity() * 1e-4,
        provenance: Provenance::Measured,
    };
    let body = Skeleton {
        id: 3,
        joints: [0, 1, 2, 4, 6].map(joint).to_vec(),
        parts: Vec::new(),
        limbs: [foveate_messages::LimbDetail::Bent; 4],
        facing: 1.0,
        unexplained: 0.0,
        cameras: CameraSet::default(),
    };
    Skeletons { time: TIME, list: vec![body], unmodelled: Vec::new() }
}

fn features() -> Features {
    let feature = |label: Option<u32>| Feature {
        centre: Point2::new(10.0, 7.5),
        covariance: Matrix2::identity(),
        area: 12,
        peak: 255,
        label,
    };
    Features { camera: CameraId(1), list: vec![feature(Some(42)), feature(None)] }
}

/// Topic, kind and bytes of a message by every encoder.
fn messages() -> Vec<(&'static str, Kind, Vec<u8>)> {
    let stamp = Stamp { time: TIME, source: SourceId(4), sequence: 9 };
    let model = CameraModel {
        size: [32, 24],
        focal: [40.0, 41.0],
        principal: [15.5, 11.5],
        skew: 0.0,
        distortion: [0.1, 0.0, 0.0, 0.0, 0.0],
    };
    let head = HeadPose {
        camera: CameraId(1),
        time: TIME,
        angles: [0.0; 2],
        angles_covariance: Matrix2::zeros(),
        rates: [0.0; 2],
        zoom: None,
        camera_from_world: pose(),
        covariance: Matrix6::zeros(),
        age: Interval(0),
    };
    let scale = ScaleSpace {
        scale: ScaleId(1),
        time: TIME,
        target: None,
        parent_from_scale: pose(),
        covariance: Matrix6::zeros(),
        velocity: Vector3::zeros(),
        motion_covariance: Matrix6::zeros(),
    };
    let moved = ScaleCloud { cloud: cloud(), world_from_scale: pose(), covariance: Matrix6::zeros() };
    let rig = Transform { parent: "world", child: "rig", parent_from_child: pose() };
    let jpeg = PictureHeader::from(&image(PixelFormat::Gray8));
    let mut all = Vec::new();
    let mut add = |topic, kind, write: &dyn Fn(&mut Vec<u8>)| {
        let mut out = Vec::new();
        write(&mut out);
        all.push((topic, kind, out));
    };
    add("/gray/image", Kind::RawImage, &|out| viewer::raw_image(&stamp, &image(PixelFormat::Gray8), "left", out));
    add("/rgb/image", Kind::RawImage, &|out| viewer::raw_image(&stamp, &image(PixelFormat::Rgb8), "left", out));
    add("/jpeg/image", Kind::CompressedImage, &|out| viewer::compressed_image(&stamp, &jpeg, b"\xff\xd8", "left", out));
    add("/gray/lens", Kind::CameraCalibration, &|out| viewer::camera_calibration(TIME, &model, "left", out));
    add("/gray/features", Kind::ImageAnnotations, &|out| {
        viewer::features(TIME, &features(), &Window::default(), out);
    });
    add("/transforms", Kind::FrameTransforms, &|out| viewer::transforms(TIME, [rig], out));
    add("/head", Kind::FrameTransforms, &|out| viewer::head_pose(&head, "world", "left", out));
    add("/scale", Kind::FrameTransforms, &|out| viewer::scale_space(&scale, "world", "scale", out));
    add("/targets/cloud", Kind::PointCloud, &|out| viewer::targets_cloud(&targets(), "world", out));
    add("/targets/poses", Kind::PosesInFrame, &|out| viewer::targets_poses(&targets(), "world", out));
    add("/targets/scene", Kind::SceneUpdate, &|out| viewer::targets_scene(&targets(), "world", "targets", out));
    add("/marks/cloud", Kind::PointCloud, &|out| viewer::marks_cloud(&marks(), "world", out));
    add("/marks/poses", Kind::PosesInFrame, &|out| viewer::marks_poses(&marks(), "world", out));
    add("/marks/scene", Kind::SceneUpdate, &|out| viewer::marks_scene(&marks(), "world", "marks", out));
    add("/cloud", Kind::PointCloud, &|out| viewer::cloud(&cloud(), "world", out));
    add("/scale_cloud", Kind::PointCloud, &|out| viewer::scale_cloud(&moved, "world", out));
    add("/mesh", Kind::SceneUpdate, &|out| viewer::mesh(&mesh(), "world", "mesh", out));
    add("/bodies", Kind::SceneUpdate, &|out| viewer::skeletons(&skeletons(), "world", "bodies", out));
    add("/log", Kind::Log, &|out| viewer::log_line(TIME, LogLevel::Warning, "tracker", "2 frames lost", out));
    add("/figures", Kind::Figures, &|out| viewer::figures(TIME, [("age_ms", 12.5)], out));
    all
}

fn write(path: &Path) {
    let mut file = mcap::Writer::new(std::fs::File::create(path).unwrap()).unwrap();
    for (topic, kind, bytes) in messages() {
        let Schema { name, descriptor } = kind.schema();
        let schema = file.add_schema(name, Schema::ENCODING, &descriptor).unwrap();
        let channel_id = file.add_channel(schema, topic, Schema::ENCODING, &BTreeMap::new()).unwrap();
        let time = TIME.0 as u64;
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
        file.write_to_known_channel(&header, &bytes).unwrap();
    }
    file.finish().unwrap();
}

#[test]
fn a_file_comes_back_with_a_schema_and_the_picture_of_each() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("all.mcap");
    write(&path);
    let bytes = std::fs::read(&path).unwrap();
    let read: Vec<_> = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).collect();
    let expected = messages();
    assert_eq!(read.len(), expected.len());
    for (found, (topic, kind, bytes)) in read.iter().zip(&expected) {
        let schema = found.channel.schema.as_ref().unwrap();
        assert_eq!((found.channel.topic.as_str(), schema.name.as_str()), (*topic, kind.name()));
        assert_eq!(found.data.as_ref(), bytes.as_slice());
    }
    assert!(Kind::ALL.iter().all(|kind| expected.iter().any(|it| it.1 == *kind)));
    let picture = viewer::read_raw_image(&read[1].data).unwrap();
    assert_eq!(picture.header.with_pixels(read[1].data[picture.content].to_vec()), image(PixelFormat::Rgb8));
}

#[test]
fn the_public_schemas_say_the_same_of_every_message() {
    let Some(python) = std::env::var_os("FOVEATE_PEER_PYTHON") else {
        return println!(
            "skipped: the public schemas need FOVEATE_PEER_PYTHON, a python with mcap, protobuf and foxglove-schemas-protobuf"
        );
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("all.mcap");
    write(&path);
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/clients/session_viewer.py");
    let output = Command::new(python).arg(script).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8(output.stdout).unwrap();
    assert_eq!(said.lines().count(), messages().len(), "{said}");
    for (topic, part) in [
        ("/gray/image", r#""timestamp": "1970-01-01T00:00:01.500Z""#),
        ("/rgb/image", r#""width": 32, "height": 24, "encoding": "rgb8", "step": 96"#),
        ("/rgb/image", r#""foveate_picture": {"time": "1500000000", "source": 4, "sequence": "9", "camera": 1"#),
        ("/jpeg/image", r#""data": "/9g=", "format": "jpeg""#),
        ("/gray/lens", r#""K": [40.0, 0.0, 15.5, 0.0, 41.0, 11.5, 0.0, 0.0, 1.0]"#),
        ("/gray/features", r#""position": {"x": 10.5, "y": 8.0}"#),
        ("/scale", r#""child_frame_id": "scale", "translation": {"x": 1.0, "y": 2.0, "z": 3.0}"#),
        ("/targets/cloud", r#"{"name": "id", "offset": 16, "type": "UINT32"}"#),
        ("/targets/poses", r#"{"position": {"x": 3.0, "y": 0.5, "z": 1.5}"#),
        ("/targets/scene", r#""text": "3""#),
        ("/mesh", r#""indices": [0, 1, 2, 2, 1, 3]"#),
        ("/bodies", r#""type": "LINE_LIST""#),
        ("/log", r#""level": "WARNING", "message": "2 frames lost", "name": "tracker""#),
        ("/figures", r#""figures": [{"name": "age_ms", "value": 12.5}]"#),
    ] {
        let line = said.lines().find(|it| it.split(' ').next() == Some(topic)).unwrap();
        assert!(line.contains(part), "{part} is not in {line}");
    }
}
