//! Surfaces and bare points as static glTF.

use foveate::prelude::*;
use serde_json::{Value, json};

use super::{Glb, Use, Y_UP};

/// Exponent between gray levels of a screen and linear light, which glTF uses for colours.
const GAMMA: f32 = 2.2;

fn light(colour: [u8; 3]) -> [f32; 3] {
    colour.map(|it| (f32::from(it) / 255.0).powf(GAMMA))
}

/// A surface: positions, normals, colours, and `_SIGMA` [m] and `_WEIGHT` of each vertex for programs that support them.
///
/// # Errors
/// As [`Glb::finish`].
pub(crate) fn mesh_glb(mesh: &Mesh, name: &str) -> Result<Vec<u8>, usize> {
    let vertices: Vec<MeshVertex> = mesh.vertices().collect();
    let triangles: Vec<[u32; 3]> = mesh.triangles().collect();
    let mut glb = Glb::default();
    if vertices.is_empty() || triangles.is_empty() {
        return finish(glb, None, name);
    }
    let place = |it: &MeshVertex| [it.position.x, it.position.y, it.position.z];
    let position = glb.floats(&vertices.iter().map(place).collect::<Vec<_>>(), Use::Vertices);
    let normal = glb.floats(&vertices.iter().map(|it| it.normal.into()).collect::<Vec<_>>(), Use::Vertices);
    let colour = glb.floats(&vertices.iter().map(|it| light(it.colour)).collect::<Vec<_>>(), Use::Vertices);
    let sigma = glb.floats(&vertices.iter().map(|it| [it.sigma]).collect::<Vec<_>>(), Use::Vertices);
    let weight = glb.floats(&vertices.iter().map(|it| [it.weight]).collect::<Vec<_>>(), Use::Vertices);
    let indices = glb.indices(&triangles);
    glb.materials.push(json!({
        "name": "surface", "doubleSided": true, "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 },
    }));
    let attributes =
        json!({ "POSITION": position, "NORMAL": normal, "COLOR_0": colour, "_SIGMA": sigma, "_WEIGHT": weight });
    let primitive = json!({ "attributes": attributes, "indices": indices, "material": 0 });
    finish(glb, Some(primitive), name)
}

/// Bare points: positions, colours, `_SIGMA` [m] and `_CONFIDENCE`; normals where all points have one.
///
/// # Errors
/// As [`Glb::finish`].
pub(crate) fn cloud_glb(cloud: &PointCloud, name: &str) -> Result<Vec<u8>, usize> {
    let points: Vec<CloudPoint> = cloud.iter().filter(|it| it.position.coords.norm_squared().is_finite()).collect();
    let mut glb = Glb::default();
    if points.is_empty() {
        return finish(glb, None, name);
    }
    let place = |it: &CloudPoint| [it.position.x, it.position.y, it.position.z];
    let position = glb.floats(&points.iter().map(place).collect::<Vec<_>>(), Use::Vertices);
    let colour = glb.floats(&points.iter().map(|it| light(it.colour)).collect::<Vec<_>>(), Use::Vertices);
    let sigma = glb.floats(&points.iter().map(|it| [it.sigma()]).collect::<Vec<_>>(), Use::Vertices);
    let confidence = glb.floats(&points.iter().map(|it| [it.confidence]).collect::<Vec<_>>(), Use::Vertices);
    let mut attributes = json!({ "POSITION": position, "COLOR_0": colour, "_SIGMA": sigma, "_CONFIDENCE": confidence });
    if points.iter().all(|it| (it.normal.norm() - 1.0).abs() < 1e-4) {
        let normal = glb.floats(&points.iter().map(|it| it.normal.into()).collect::<Vec<_>>(), Use::Vertices);
        attributes["NORMAL"] = json!(normal);
    }
    // 0: points.
    finish(glb, Some(json!({ "attributes": attributes, "mode": 0 })), name)
}

/// One mesh below the node that rotates our axes into those of glTF.
fn finish(mut glb: Glb, primitive: Option<Value>, name: &str) -> Result<Vec<u8>, usize> {
    let mut root = json!({ "name": name, "rotation": Y_UP });
    if let Some(primitive) = primitive {
        glb.meshes.push(json!({ "name": name, "primitives": [primitive] }));
        root["mesh"] = json!(0);
    }
    let root = glb.node(root);
    glb.finish(&[root], 0.0)
}
