//! Bodies as shapes with a skin: each part's own form, moved by a joint of its own.

use foveate::geometry::body::Part;
use foveate::prelude::*;
use nalgebra::{Matrix4, UnitQuaternion, Vector3};
use serde_json::json;

use super::{Course, median_sizes, part_of};
use crate::gltf::{Glb, Use, Y_UP};

const RINGS: usize = 9;
const SECTORS: usize = 14;

/// A file of all bodies; time 0 is `start`.
///
/// # Errors
/// The file's length, where it exceeds the limit of the format.
pub(super) fn glb(courses: &[Course], start: Time) -> Result<Vec<u8>, usize> {
    let mut glb = Glb::default();
    let mut roots = Vec::new();
    let mut children = Vec::new();
    for course in courses {
        let mut joints = Vec::new();
        let (mut places, mut normals, mut joint_of, mut triangles) = (vec![], vec![], vec![], vec![]);
        for part in Part::ALL {
            let Some(sizes) = median_sizes(course, part.index()) else { continue };
            let number = joints.len() as u16;
            let first = places.len() as u32;
            for (place, normal) in shape(part, &sizes) {
                places.push(floats(&place));
                normals.push(floats(&normal));
                joint_of.push([number, 0, 0, 0]);
            }
            triangles.extend(faces().map(|it| it.map(|corner| corner + first)));
            joints.push(joint(&mut glb, course, part, start));
        }
        if joints.is_empty() {
            continue;
        }
        let weights = vec![[1.0_f32, 0.0, 0.0, 0.0]; places.len()];
        // Each part's shape lies in its joint's own axes: nothing has to be taken back.
        let identity: [f32; 16] = Matrix4::<f32>::identity().as_slice().try_into().unwrap_or([0.0; 16]);
        let identities = vec![identity; joints.len()];
        let attributes = json!({
            "POSITION": glb.floats(&places, Use::Vertices),
            "NORMAL": glb.floats(&normals, Use::Vertices),
            "JOINTS_0": glb.words(&joint_of, Use::Vertices),
            "WEIGHTS_0": glb.floats(&weights, Use::Vertices),
        });
        let indices = glb.indices(&triangles);
        let name = format!("body-{}", course.id);
        glb.meshes.push(json!({ "name": name, "primitives": [{ "attributes": attributes, "indices": indices }] }));
        let inverse = glb.floats(&identities, Use::Other);
        let skeleton = glb.node(json!({ "name": format!("{name}-parts"), "children": joints }));
        glb.skins.push(json!({ "joints": joints, "inverseBindMatrices": inverse, "skeleton": skeleton }));
        let mesh = glb.node(json!({ "name": name, "mesh": glb.meshes.len() - 1, "skin": glb.skins.len() - 1 }));
        children.push(skeleton);
        roots.push(mesh);
    }
    let mut world = json!({ "name": "world", "rotation": Y_UP });
    if !children.is_empty() {
        world["children"] = json!(children);
    }
    roots.push(glb.node(world));
    glb.finish(&roots, start.as_s())
}

/// A node that moves with a part, scaled to a point while the part is missing.
fn joint(glb: &mut Glb, course: &Course, part: Part, start: Time) -> usize {
    let there: Vec<_> =
        course.frames.iter().filter_map(|(time, it)| Some((*time, part_of(it, part.index())?))).collect();
    let node = glb.node(json!({ "name": format!("body-{}-{}", course.id, part.name()) }));
    let seconds = |time: Time| [(time - start).as_s() as f32];
    let times: Vec<[f32; 1]> = there.iter().map(|it| seconds(it.0)).collect();
    let places: Vec<[f32; 3]> = there.iter().map(|it| floats(&it.1.scale_from_part.translation.vector)).collect();
    let mut before = UnitQuaternion::identity();
    let turns: Vec<[f32; 4]> = there
        .iter()
        .map(|(_, it)| {
            let turn = it.scale_from_part.rotation;
            // q and −q are the same turn; the nearer of the two is the shorter way from the last one.
            let sign = if turn.coords.dot(&before.coords) < 0.0 { -1.0 } else { 1.0 };
            before = UnitQuaternion::new_unchecked(turn.into_inner() * sign);
            let q = before.coords.map(|it| it as f32);
            [q.x, q.y, q.z, q.w]
        })
        .collect();
    let input = glb.floats(&times, Use::Other);
    let output = glb.floats(&places, Use::Other);
    glb.animate(node, "translation", input, output, "LINEAR");
    let output = glb.floats(&turns, Use::Other);
    glb.animate(node, "rotation", input, output, "LINEAR");
    // Whether it is there, frame by frame, where that changes.
    let mut changes: Vec<([f32; 1], [f32; 3])> = Vec::new();
    for (time, skeleton) in &course.frames {
        let size = if part_of(skeleton, part.index()).is_some() { 1.0 } else { 0.0 };
        if changes.last().is_none_or(|it| it.1[0] != size) {
            changes.push((seconds(*time), [size; 3]));
        }
    }
    let times: Vec<[f32; 1]> = changes.iter().map(|it| it.0).collect();
    let scales: Vec<[f32; 3]> = changes.iter().map(|it| it.1).collect();
    let input = glb.floats(&times, Use::Other);
    let output = glb.floats(&scales, Use::Other);
    glb.animate(node, "scale", input, output, "STEP");
    node
}

fn floats(it: &Vector3<f64>) -> [f32; 3] {
    [it.x as f32, it.y as f32, it.z as f32]
}

/// Vertices and normals of a ball stretched into the shape of a part: an ellipsoid, or a cylinder with round ends.
fn shape(part: Part, sizes: &Vector3<f64>) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let mut vertices = Vec::new();
    for ring in 0..RINGS {
        let (sine, cosine) = (std::f64::consts::PI * ring as f64 / (RINGS - 1) as f64).sin_cos();
        for sector in 0..SECTORS {
            let (y, x) = (std::f64::consts::TAU * sector as f64 / SECTORS as f64).sin_cos();
            let ball = Vector3::new(x * sine, y * sine, cosine);
            let round = if part == Part::Head { sizes.z } else { sizes.x.min(sizes.z) };
            let along = if cosine.abs() < 1e-9 { 0.0 } else { cosine.signum() * (sizes.z - round) };
            let place = Vector3::new(ball.x * sizes.x, ball.y * sizes.y, ball.z * round + along);
            let normal = Vector3::new(ball.x / sizes.x, ball.y / sizes.y, ball.z / round).normalize();
            vertices.push((place, normal));
        }
    }
    vertices
}

fn faces() -> impl Iterator<Item = [u32; 3]> {
    (0..RINGS as u32 - 1).flat_map(|ring| {
        (0..SECTORS as u32).flat_map(move |sector| {
            let n = SECTORS as u32;
            let at = |ring: u32, sector: u32| ring * n + sector % n;
            let [a, b] = [at(ring, sector), at(ring, sector + 1)];
            let [c, d] = [at(ring + 1, sector), at(ring + 1, sector + 1)];
            [[a, c, b], [b, c, d]]
        })
    })
}
