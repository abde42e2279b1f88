//! The structure of the file, and that another reader finds in it what was put in.

use std::process::Command;
use std::sync::Arc;

use foveate::prelude::*;
use nalgebra::{Isometry3, Matrix2, Matrix3, Matrix6, Point3, Vector3};
use serde_json::Value;

use super::*;
use crate::target_rows::tests::target;

/// A target with a hole, 20 marks on a bowl that bends and turns, a camera of three that pans.
fn file() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let setup = Setup {
        out_dir: Some(folder.path().to_owned()),
        calibration: Arc::new(foveate_testkit::scene::ring_calibration(3)),
        ..Setup::for_tests()
    };
    let settings = "rate_hz = 50.0\nlabels = { target-1 = \"waist\", mark-3 = \"nose\" }";
    let mut node = ExportGltf::new(toml::from_str(settings).unwrap(), &setup).unwrap();
    let gather = node.gather.as_mut().unwrap();
    for step in 0..=50 {
        let seconds = 1.0 + 0.02 * f64::from(step);
        let time = Time::from_s(seconds);
        let provenance = if (20..30).contains(&step) { Provenance::Predicted } else { Provenance::Measured };
        gather.push_targets(Arc::new(Targets { time, list: vec![target(1, [seconds, 2.0, 3.0], provenance)] }), false);
        let mark = |label: u32| {
            let [y, z] = [f64::from(label % 5) * 0.02, f64::from(label / 5) * 0.02 + 0.001 * f64::from(label)];
            Mark {
                label,
                position: Point3::new(0.1 - y * y + 0.001 * f64::from(step), y, z),
                covariance: Matrix3::identity() * 1e-8,
                cameras: CameraSet::default(),
                provenance: Provenance::Measured,
            }
        };
        gather.push_marks(Arc::new(Marks {
            time,
            world_from_marks: Isometry3::new(Vector3::new(0.0, 0.0, 1.6), Vector3::z() * seconds),
            list: (0..20).map(mark).collect(),
            ..Marks::default()
        }));
        gather.push_pose(&HeadPose {
            camera: CameraId(1),
            time,
            angles: [0.0; 2],
            angles_covariance: Matrix2::zeros(),
            rates: [0.0; 2],
            zoom: None,
            camera_from_world: Isometry3::new(Vector3::z() * 2.0, Vector3::y() * seconds),
            covariance: Matrix6::zeros(),
            age: Interval(0),
        });
    }
    node.finish(&mut Report::default()).unwrap();
    std::fs::read(folder.path().join("motion.glb")).unwrap()
}

/// A tetrahedron, and its corners as bare points.
fn still_files() -> [Vec<u8>; 2] {
    let corners = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.3]].map(Point3::from);
    let vertex = |it: &Point3<f32>| MeshVertex {
        position: *it,
        normal: (it - Point3::new(0.02, 0.03, 0.04)).normalize(),
        weight: 4.0,
        sigma: 1e-4,
        colour: [0, 128, 255],
    };
    let mesh = Mesh::new(corners.iter().map(vertex), &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]);
    let mut cloud = PointCloud::default();
    for corner in corners {
        cloud.push(&CloudPoint {
            position: corner,
            covariance: Matrix3::identity() * 1e-8,
            normal: Vector3::y(),
            confidence: 0.5,
            pixel: [0, 0],
            colour: [0, 128, 255],
        });
    }
    [mesh_glb(&mesh, "surface").unwrap(), cloud_glb(&cloud, "points").unwrap()]
}

#[test]
fn a_surface_and_bare_points_are_there_with_y_up() {
    let [mesh, cloud] = still_files();
    let (document, bytes) = parts(&mesh);
    let primitive = &document["meshes"][0]["primitives"][0];
    let places = floats(&document, bytes, number(&primitive["attributes"]["POSITION"]));
    assert_eq!((places.len(), &places[9..]), (12, &[0.0, 0.0, 0.3][..]));
    let colours = floats(&document, bytes, number(&primitive["attributes"]["COLOR_0"]));
    assert!(colours[0] == 0.0 && (colours[1] - 0.2195).abs() < 1e-3 && colours[2] == 1.0, "{colours:?}");
    let indices = &document["accessors"][number(&primitive["indices"])];
    assert_eq!((number(&indices["count"]), number(&indices["componentType"])), (12, 5125));
    // Our z goes to y.
    let [x, y, z, w] = [0, 1, 2, 3].map(|it| document["nodes"][0]["rotation"][it].as_f64().unwrap());
    let turn = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
    assert!((turn * Vector3::z() - Vector3::y()).norm() < 1e-9);
    let (document, bytes) = parts(&cloud);
    let primitive = &document["meshes"][0]["primitives"][0];
    assert_eq!(number(&primitive["mode"]), 0);
    assert_eq!(floats(&document, bytes, number(&primitive["attributes"]["_CONFIDENCE"])), [0.5; 4]);
    let empty = parts_without_bytes(&mesh_glb(&Mesh::new([], &[]), "none").unwrap());
    assert_eq!((&empty["nodes"][0]["name"], &empty["meshes"]), (&Value::from("none"), &Value::Null));
}

/// The JSON of a file that holds no more.
fn parts_without_bytes(file: &[u8]) -> Value {
    serde_json::from_slice(&file[20..]).unwrap()
}

fn number(it: &Value) -> usize {
    it.as_u64().unwrap() as usize
}

/// The JSON and the bytes.
fn parts(file: &[u8]) -> (Value, &[u8]) {
    let word = |at: usize| u32::from_le_bytes([file[at], file[at + 1], file[at + 2], file[at + 3]]) as usize;
    assert_eq!((&file[..4], word(4), word(8), &file[16..20]), (&b"glTF"[..], 2, file.len(), &b"JSON"[..]));
    let text = &file[20..20 + word(12)];
    let chunk = 20 + word(12);
    assert_eq!((&file[chunk + 4..chunk + 8], chunk + 8 + word(chunk), chunk % 4), (&b"BIN\0"[..], file.len(), 0));
    (serde_json::from_slice(text).unwrap(), &file[chunk + 8..])
}

/// The values of an accessor, checked against its bounds and its place.
fn floats(document: &Value, bytes: &[u8], accessor: usize) -> Vec<f32> {
    let it = &document["accessors"][accessor];
    let view = &document["bufferViews"][number(&it["bufferView"])];
    let width = match it["type"].as_str().unwrap() {
        "SCALAR" => 1,
        "VEC3" => 3,
        "VEC4" => 4,
        _ => 16,
    };
    let size = if it["componentType"] == 5126 { 4 } else { 2 };
    let (offset, length) = (number(&view["byteOffset"]), number(&view["byteLength"]));
    assert!(
        offset.is_multiple_of(4) && offset + length <= bytes.len() && length == number(&it["count"]) * width * size
    );
    if size == 2 {
        return bytes[offset..offset + length]
            .chunks(2)
            .map(|it| f32::from(u16::from_le_bytes([it[0], it[1]])))
            .collect();
    }
    let values: Vec<f32> =
        bytes[offset..offset + length].chunks(4).map(|it| f32::from_le_bytes([it[0], it[1], it[2], it[3]])).collect();
    for axis in 0..width {
        let of_axis = || values.iter().skip(axis).step_by(width).copied();
        assert_eq!(it["min"][axis].as_f64().unwrap() as f32, of_axis().fold(f32::INFINITY, f32::min));
        assert_eq!(it["max"][axis].as_f64().unwrap() as f32, of_axis().fold(f32::NEG_INFINITY, f32::max));
    }
    values
}

#[test]
fn node_keeps_its_promises() {
    foveate_testkit::check_node::<ExportGltf>("radius_mm = 5.0");
}

#[test]
fn everything_points_at_what_is_there() {
    let file = file();
    let (document, bytes) = parts(&file);
    assert_eq!(number(&document["buffers"][0]["byteLength"]), bytes.len());
    let list = |name: &str| document[name].as_array().unwrap().clone();
    (0..list("accessors").len()).for_each(|it| drop(floats(&document, bytes, it)));
    let nodes = list("nodes");
    let mut parents = vec![0; nodes.len()];
    for child in nodes.iter().filter_map(|it| it["children"].as_array()).flatten() {
        parents[number(child)] += 1;
    }
    let roots: Vec<usize> = document["scenes"][0]["nodes"].as_array().unwrap().iter().map(number).collect();
    assert!((0..nodes.len()).all(|it| parents[it] == usize::from(!roots.contains(&it))), "{parents:?}");
    let skinned = (0..nodes.len()).filter(|it| !nodes[*it]["skin"].is_null()).collect::<Vec<_>>();
    assert!(skinned.len() == 1 && roots.contains(&skinned[0]), "a mesh with a skin is a root: {roots:?}");
    let animation = &document["animations"][0];
    let mut targets = Vec::new();
    for channel in animation["channels"].as_array().unwrap() {
        let sampler = &animation["samplers"][number(&channel["sampler"])];
        let times = floats(&document, bytes, number(&sampler["input"]));
        assert!(times[0] >= 0.0 && times.windows(2).all(|it| it[0] < it[1]), "{times:?}");
        let output = &document["accessors"][number(&sampler["output"])];
        assert_eq!(number(&output["count"]), times.len());
        targets.push((number(&channel["target"]["node"]), channel["target"]["path"].clone()));
    }
    assert!((0..targets.len()).all(|it| !targets[..it].contains(&targets[it])), "one channel a path of a node");
    let mesh = list("meshes").into_iter().find(|it| it["name"] == "face").unwrap();
    let primitive = &mesh["primitives"][0];
    let corners = floats(&document, bytes, number(&primitive["indices"]));
    assert!(corners.len() >= 3 * 20 && corners.iter().all(|it| *it < 20.0));
    assert_eq!(document["skins"][0]["joints"].as_array().unwrap().len(), 20);
}

#[test]
fn target_that_is_missing_shrinks_and_comes_back() {
    let file = file();
    let (document, bytes) = parts(&file);
    let waist = document["nodes"].as_array().unwrap().iter().position(|it| it["name"] == "waist").unwrap();
    let animation = &document["animations"][0];
    let keys = |path: &str| {
        let channels = animation["channels"].as_array().unwrap();
        let channel = channels.iter().find(|it| it["target"]["node"] == waist && it["target"]["path"] == path).unwrap();
        let sampler = &animation["samplers"][number(&channel["sampler"])];
        ["input", "output"].map(|it| floats(&document, bytes, number(&sampler[it])))
    };
    let [times, scales] = keys("scale");
    assert_eq!(scales, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    assert!((times[1] - 0.4).abs() < 1e-6 && (times[2] - 0.6).abs() < 1e-6, "{times:?}");
    let [times, places] = keys("translation");
    assert_eq!((times.len(), &places[..3]), (41, &[1.0, 2.0, 3.0][..]));
    assert!((animation["extras"]["start_s"].as_f64().unwrap() - 1.0).abs() < 1e-9);
}

const CHECK: &str = r#"
import sys, numpy, trimesh
scene = trimesh.load(sys.argv[1])
at = {name: scene.graph[name][0] for name in scene.graph.nodes}
assert numpy.allclose(at["waist"][:3, 3], [1, 3, -2], atol=1e-6), at["waist"]
face = scene.geometry["face"]
assert face.vertices.shape == (20, 3) and len(face.faces) >= 20, face
# The second camera of the ring at rest of the first frame: it looks along -z of its node.
view = at["ring-2"]
turned = numpy.array([-numpy.sin(1.0), 0, numpy.cos(1.0)])
expected = numpy.array([turned[0], turned[2], -turned[1]])
assert numpy.allclose(-view[:3, 2], expected, atol=1e-6), (-view[:3, 2], expected)
import pygltflib
file = pygltflib.GLTF2().load(sys.argv[1])
assert [it.name for it in file.cameras] == ["ring-1", "ring-2", "ring-3"], file.cameras
assert len(file.animations[0].channels) == 2 + 20 + 2 + 2, len(file.animations[0].channels)
"#;

const CHECK_STILL: &str = r#"
import sys, numpy, trimesh
surface = trimesh.load(sys.argv[1]).to_mesh()
assert surface.is_watertight and numpy.isclose(surface.volume, 0.1 * 0.2 * 0.3 / 6), surface.volume
assert numpy.allclose(surface.bounds, [[0, 0, -0.2], [0.1, 0.3, 0]], atol=1e-6), surface.bounds
points = trimesh.load(sys.argv[2])
cloud = list(points.geometry.values())[0]
assert cloud.vertices.shape == (4, 3), cloud
"#;

#[test]
fn other_readers_find_what_was_put_in() {
    let Some(python) = std::env::var_os("FOVEATE_PEER_PYTHON") else {
        println!(
            "skipped: other_readers_find_what_was_put_in needs FOVEATE_PEER_PYTHON, a python with trimesh and pygltflib"
        );
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.glb");
    std::fs::write(&path, file()).unwrap();
    let output = Command::new(&python).arg("-c").arg(CHECK).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let paths = [("surface.glb", 0), ("points.glb", 1)].map(|(name, which)| {
        let path = folder.path().join(name);
        std::fs::write(&path, &still_files()[which]).unwrap();
        path
    });
    let output = Command::new(python).arg("-c").arg(CHECK_STILL).args(&paths).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn official_validator_finds_no_fault() {
    let Some(packages) = std::env::var_os("FOVEATE_GLTF_VALIDATOR") else {
        println!(
            "skipped: official_validator_finds_no_fault needs FOVEATE_GLTF_VALIDATOR, a folder with the npm package gltf-validator"
        );
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let [surface, points] = still_files();
    let paths = [("motion.glb", file()), ("surface.glb", surface), ("points.glb", points)].map(|(name, bytes)| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    });
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/gltf/validate.mjs");
    let output = Command::new("node").arg(script).args(&paths).env("NODE_PATH", packages).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}\n{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(said.matches("0 errors, 0 warnings").count(), 3, "{said}");
}

#[test]
fn run_without_anything_is_still_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    let setup = Setup { out_dir: Some(folder.path().to_owned()), ..Setup::for_tests() };
    ExportGltf::new(toml::from_str("").unwrap(), &setup).unwrap().finish(&mut Report::default()).unwrap();
    let file = std::fs::read(folder.path().join("motion.glb")).unwrap();
    let document: Value = serde_json::from_slice(&file[20..]).unwrap();
    assert_eq!((&document["nodes"][0]["name"], &document["meshes"]), (&Value::from("world"), &Value::Null));
}
