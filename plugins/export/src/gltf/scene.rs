//! The nodes of a scene, from the gathered samples.

use foveate::prelude::*;
use foveate::scene::Calibration;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use serde_json::{Value, json};

use super::triangles::triangles;
use super::{Glb, Use, Y_UP};
use crate::gather::{Column, Poses, Table};

/// Look of a scene.
pub(super) struct Look<'a> {
    /// Radius of the balls of points [m].
    pub radius: f64,
    /// Cameras that are drawn; `None`: none.
    pub cameras: Option<&'a Calibration>,
}

/// A GLB file of everything in `table`.
///
/// # Errors
/// As [`Glb::finish`].
pub(super) fn scene(table: &Table, look: &Look) -> Result<Vec<u8>, usize> {
    let mut glb = Glb::default();
    let mut children = Vec::new();
    let surface = surface(&mut glb, table);
    let is_drawn = |it: &Column| it.mark.is_none() || surface.is_none();
    let points: Vec<&Column> = table.points.iter().filter(|it| is_drawn(it)).collect();
    if !points.is_empty() {
        let ball = ball(&mut glb, look.radius as f32);
        children.extend(points.iter().map(|it| point(&mut glb, it, table, ball)));
    }
    children.extend(surface.map(|it| it.marks));
    if let Some(calibration) = look.cameras {
        for (number, camera) in (0..).zip(&calibration.cameras) {
            let poses = table.cameras.iter().find(|it| it.0 == CameraId(number)).map(|it| &it.1);
            children.push(camera_node(&mut glb, camera, poses, table));
        }
    }
    let mut root = json!({ "name": "world", "rotation": Y_UP });
    if !children.is_empty() {
        root["children"] = json!(children);
    }
    let root = glb.node(root);
    // No transform of a parent reaches a mesh with a skin, so it has none: its joints hang below the world.
    let roots: Vec<usize> = [root].into_iter().chain(surface.map(|it| it.face)).collect();
    glb.finish(&roots, table.time_s(0))
}

fn vector(it: &Vector3<f64>) -> [f32; 3] {
    [it.x as f32, it.y as f32, it.z as f32]
}

fn quaternion(it: &UnitQuaternion<f64>) -> [f32; 4] {
    [it.i, it.j, it.k, it.w].map(|it| it as f32)
}

/// The times of frames, as an accessor.
fn times(glb: &mut Glb, frames: impl Iterator<Item = usize>, table: &Table) -> usize {
    let times: Vec<[f32; 1]> = frames.map(|it| [(it as f64 / table.rate_hz) as f32]).collect();
    glb.floats(&times, Use::Other)
}

/// Moves a node along the positions of a column; it is scaled to a point while they are missing.
fn travel(glb: &mut Glb, node: usize, column: &Column, table: &Table) {
    let places: Vec<[f32; 3]> = column.samples.iter().map(|it| vector(&it.1.position.coords)).collect();
    let input = times(glb, column.samples.iter().map(|it| it.0), table);
    let output = glb.floats(&places, Use::Other);
    glb.animate(node, "translation", input, output, "LINEAR");
}

/// Shows a node while its column has samples.
fn appear(glb: &mut Glb, node: usize, column: &Column, table: &Table) {
    let mut changes: Vec<(usize, f32)> = Vec::new();
    let mut next = 0;
    for (frame, _) in &column.samples {
        if *frame > next || changes.is_empty() {
            if *frame > next {
                changes.push((next, 0.0));
            }
            changes.push((*frame, 1.0));
        }
        next = frame + 1;
    }
    if next < table.n_frames {
        changes.push((next, 0.0));
    }
    if changes.len() > 1 {
        let input = times(glb, changes.iter().map(|it| it.0), table);
        let scales: Vec<[f32; 3]> = changes.iter().map(|it| [it.1; 3]).collect();
        let output = glb.floats(&scales, Use::Other);
        glb.animate(node, "scale", input, output, "STEP");
    }
}

fn point(glb: &mut Glb, column: &Column, table: &Table, ball: usize) -> usize {
    let first = column.samples.first().map_or([0.0; 3], |it| vector(&it.1.position.coords));
    let node = glb.node(json!({ "name": column.label, "mesh": ball, "translation": first }));
    travel(glb, node, column, table);
    appear(glb, node, column, table);
    node
}

/// A ball: an octahedron, each face once divided.
fn ball(glb: &mut Glb, radius: f32) -> usize {
    let axes =
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    let mut corners: Vec<Vector3<f32>> = axes.into_iter().map(Vector3::from).collect();
    let faces: [[u16; 3]; 8] = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]];
    let mut indices = Vec::new();
    for [a, b, c] in faces {
        let mut between = |a: u16, b: u16| {
            corners.push((corners[usize::from(a)] + corners[usize::from(b)]).normalize());
            (corners.len() - 1) as u16
        };
        let (ab, bc, ca) = (between(a, b), between(b, c), between(c, a));
        indices.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    let places: Vec<[f32; 3]> = corners.iter().map(|it| (it * radius).into()).collect();
    let normals: Vec<[f32; 3]> = corners.iter().map(|&it| it.into()).collect();
    let position = glb.floats(&places, Use::Vertices);
    let normal = glb.floats(&normals, Use::Vertices);
    let indices: Vec<[u16; 1]> = indices.into_iter().flatten().map(|it| [it]).collect();
    let indices = glb.words(&indices, Use::Indices);
    let primitive = json!({ "attributes": { "POSITION": position, "NORMAL": normal }, "indices": indices });
    glb.meshes.push(json!({ "name": "point", "primitives": [primitive] }));
    glb.meshes.len() - 1
}

/// The two nodes of the marks.
#[derive(Debug, Clone, Copy)]
struct Surface {
    /// Moves with their space; has one joint per mark below it.
    marks: usize,
    /// The mesh, with its skin.
    face: usize,
}

/// The marks as a surface with one joint per mark, below a node that moves with their space. `None`: too few marks for a triangle.
fn surface(glb: &mut Glb, table: &Table) -> Option<Surface> {
    let marks = &table.own_marks;
    let mean = |it: &Column| {
        let sum: Vector3<f64> = it.samples.iter().map(|it| it.1.position.coords).sum();
        Point3::from(sum / it.samples.len() as f64)
    };
    let places: Vec<Point3<f64>> = marks.iter().map(mean).collect();
    // Out of a head: its space has x forward. Of marks without a model, about whose middle their space is, that says nothing, and either side will do.
    let corners = triangles(&places, &Vector3::x());
    if corners.is_empty() || places.len() > usize::from(u16::MAX) {
        return None;
    }
    let joints: Vec<usize> = marks
        .iter()
        .zip(&places)
        .map(|(column, place)| {
            let node = glb.node(json!({ "name": column.label, "translation": vector(&place.coords) }));
            travel(glb, node, column, table);
            node
        })
        .collect();
    let body = glb.node(json!({ "name": "marks", "children": joints }));
    move_along(glb, body, &table.marks_from, &UnitQuaternion::identity(), table);

    let vertices: Vec<[f32; 3]> = places.iter().map(|it| vector(&it.coords)).collect();
    let of_vertex: Vec<[u16; 4]> = (0..places.len() as u16).map(|it| [it, 0, 0, 0]).collect();
    let weights = vec![[1.0, 0.0, 0.0, 0.0]; places.len()];
    let position = glb.floats(&vertices, Use::Vertices);
    let joints_of = glb.words(&of_vertex, Use::Vertices);
    let weights = glb.floats(&weights, Use::Vertices);
    let indices: Vec<[u16; 1]> = corners.into_iter().flatten().map(|it| [it]).collect();
    let indices = glb.words(&indices, Use::Indices);
    let attributes = json!({ "POSITION": position, "JOINTS_0": joints_of, "WEIGHTS_0": weights });
    glb.meshes.push(json!({ "name": "face", "primitives": [{ "attributes": attributes, "indices": indices }] }));
    // Takes a vertex at rest to its joint: back to the origin. By columns.
    let back = |it: &[f32; 3]| {
        let mut matrix = [0.0; 16];
        [0, 5, 10, 15].iter().for_each(|&place| matrix[place] = 1.0);
        (0..3).for_each(|axis| matrix[12 + axis] = -it[axis]);
        matrix
    };
    let inverse = glb.floats(&vertices.iter().map(back).collect::<Vec<_>>(), Use::Other);
    glb.skins.push(json!({ "joints": joints, "inverseBindMatrices": inverse, "skeleton": body }));
    let mesh = glb.node(json!({ "name": "face", "mesh": glb.meshes.len() - 1, "skin": glb.skins.len() - 1 }));
    Some(Surface { marks: body, face: mesh })
}

/// Moves a node along poses, each rotated by `then` in its own space.
fn move_along(glb: &mut Glb, node: usize, poses: &Poses, then: &UnitQuaternion<f64>, table: &Table) {
    if poses.is_empty() {
        return;
    }
    let input = times(glb, poses.iter().map(|it| it.0), table);
    let places: Vec<[f32; 3]> = poses.iter().map(|it| vector(&it.1.translation.vector)).collect();
    let mut before = UnitQuaternion::identity();
    let turns: Vec<[f32; 4]> = poses
        .iter()
        .map(|(_, pose)| {
            // q and −q are the same turn; the nearer of the two is the shorter way from the last one.
            let turn = pose.rotation * then;
            let turn = if turn.coords.dot(&before.coords) < 0.0 {
                UnitQuaternion::new_unchecked(-turn.into_inner())
            } else {
                turn
            };
            before = turn;
            quaternion(&turn)
        })
        .collect();
    let places = glb.floats(&places, Use::Other);
    glb.animate(node, "translation", input, places, "LINEAR");
    let turns = glb.floats(&turns, Use::Other);
    glb.animate(node, "rotation", input, turns, "LINEAR");
}

/// A camera, static or moving. glTF's look along −z with y up, ours along z with y down.
fn camera_node(glb: &mut Glb, named: &foveate::scene::NamedCamera, poses: Option<&Poses>, table: &Table) -> usize {
    let camera = &named.camera;
    let [half_x, half_y] =
        [0, 1].map(|axis| f64::from(camera.image_size[axis]) / (2.0 * camera.intrinsics.focal[axis]));
    let perspective = json!({ "aspectRatio": half_x / half_y, "yfov": 2.0 * half_y.atan(), "znear": 0.02 });
    glb.cameras.push(json!({ "name": named.name, "type": "perspective", "perspective": perspective }));
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let at = |it: &Isometry3<f64>| -> Value {
        let place = vector(&it.translation.vector);
        json!({
            "name": named.name, "camera": glb.cameras.len() - 1,
            "translation": place, "rotation": quaternion(&(it.rotation * half_turn)),
        })
    };
    let first = poses.and_then(|it| it.first()).map(|it| it.1);
    let node = at(&first.unwrap_or_else(|| camera.camera_from_world.inverse()));
    let node = glb.node(node);
    if let Some(poses) = poses {
        move_along(glb, node, poses, &half_turn, table);
    }
    node
}
