//! A GLB file with a skin as a rig: its joints are read, and it is written back with another animation.

use foveate::scene::skeleton::retarget::{RigJoint, RigPose};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde_json::{Value, json};

use crate::gltf::glb_file;

/// A GLB file and the joints of its first skin.
pub(super) struct Rigged {
    document: Value,
    bytes: Vec<u8>,
    /// Parents before children.
    pub joints: Vec<RigJoint>,
    /// By joint: its number among the nodes of the file.
    nodes: Vec<u64>,
}

fn number(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|it| usize::try_from(it).ok())
}

fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let list: Vec<f64> = value.as_array()?.iter().filter_map(Value::as_f64).collect();
    list.try_into().ok()
}

impl Rigged {
    /// # Errors
    /// A sentence: what was found, and what was expected.
    pub fn read(file: Vec<u8>) -> Result<Rigged, String> {
        let word = |at: usize| {
            let four: Option<[u8; 4]> = file.get(at..at + 4).and_then(|it| it.try_into().ok());
            four.map(u32::from_le_bytes).and_then(|it| usize::try_from(it).ok())
        };
        if !file.starts_with(b"glTF") || file.get(16..20) != Some(b"JSON") {
            return Err("found no GLB header of version 2, expected one".to_owned());
        }
        let cut = || "the file ends within its first chunk".to_owned();
        let length = word(12).ok_or_else(cut)?;
        let text = file.get(20..20 + length).ok_or_else(cut)?;
        let document: Value = serde_json::from_slice(text).map_err(|it| format!("its JSON cannot be read: {it}"))?;
        let bytes = match word(20 + length) {
            Some(binary) => {
                file.get(28 + length..28 + length + binary).ok_or("the file ends within its second chunk")?
            }
            None => &[],
        };
        let bytes = bytes.to_vec();
        let skin = document["skins"][0]["joints"].as_array().ok_or("found no skin, expected one")?;
        let of_skin: Vec<usize> = skin.iter().filter_map(number).collect();
        let nodes = document["nodes"].as_array().ok_or("found no nodes")?;
        let mut parents = vec![None; nodes.len()];
        for (parent, node) in nodes.iter().enumerate() {
            for child in node["children"].as_array().into_iter().flatten().filter_map(number) {
                *parents
                    .get_mut(child)
                    .ok_or_else(|| format!("node {parent} has a child {child} that does not exist"))? = Some(parent);
            }
        }
        // The first joint of the skin whose parent is none of it, and all that hangs on it.
        let root = of_skin
            .iter()
            .copied()
            .find(|it| parents.get(*it).is_some_and(|it: &Option<usize>| it.is_none_or(|it| !of_skin.contains(&it))));
        let root = root.ok_or("found no root joint in its skin, expected one")?;
        let (mut joints, mut chosen): (Vec<RigJoint>, Vec<usize>) = (Vec::new(), Vec::new());
        let mut waiting = vec![root];
        while let Some(node) = waiting.pop() {
            if chosen.contains(&node) {
                return Err(format!("node {node} is its own ancestor"));
            }
            let it = &nodes[node];
            let name = it["name"].as_str().map_or_else(|| format!("node {node}"), str::to_owned);
            if it.get("matrix").is_some() {
                return Err(format!("joint `{name}` has a matrix, expected translation and rotation"));
            }
            let scale = numbers::<3>(&it["scale"]).unwrap_or([1.0; 3]);
            if scale.iter().any(|it| (it - 1.0).abs() > 1e-3) {
                return Err(format!("joint `{name}` is scaled by {scale:?}, expected 1"));
            }
            let rest = match numbers::<4>(&it["rotation"]) {
                Some([x, y, z, w]) => UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)),
                None => UnitQuaternion::identity(),
            };
            let offset = Vector3::from(numbers::<3>(&it["translation"]).unwrap_or([0.0; 3]));
            let parent = parents[node].and_then(|it| chosen.iter().position(|known| *known == it));
            joints.push(RigJoint { name, parent, offset, rest, end: None });
            chosen.push(node);
            waiting.extend(it["children"].as_array().into_iter().flatten().rev().filter_map(number));
        }
        let mut above = parents[root];
        let mut n_above = 0;
        while let Some(node) = above {
            let it = &nodes[node];
            let turned = numbers::<4>(&it["rotation"]).is_some_and(|it| it[3].abs() < 0.9999);
            let scaled = numbers::<3>(&it["scale"]).is_some_and(|it| it.iter().any(|it| (it - 1.0).abs() > 1e-3));
            n_above += 1;
            if turned || scaled || it.get("matrix").is_some() || n_above > nodes.len() {
                return Err(format!(
                    "node {node}, above the skin's joints, is rotated or scaled, expected y up and metres"
                ));
            }
            above = parents[node];
        }
        let nodes = chosen.into_iter().map(|it| it as u64).collect();
        Ok(Rigged { document, bytes, joints, nodes })
    }

    /// The file with these poses as its one animation.
    ///
    /// # Errors
    /// A sentence: more bytes than a GLB file can have.
    pub fn moved(&self, poses: &[RigPose], frame_s: f64) -> Result<Vec<u8>, String> {
        let (mut document, mut bytes) = (self.document.clone(), self.bytes.clone());
        let mut put = |document: &mut Value, values: Vec<f32>, kind: &str, width: usize| {
            bytes.resize(bytes.len().next_multiple_of(4), 0);
            let offset = bytes.len();
            bytes.extend(values.iter().flat_map(|it| it.to_le_bytes()));
            let views = list(document, "bufferViews");
            views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": 4 * values.len() }));
            let view = views.len() - 1;
            let mut accessor =
                json!({ "bufferView": view, "componentType": 5126, "count": values.len() / width, "type": kind });
            if width == 1 {
                // Times must state their range.
                accessor["min"] = json!([values.first()]);
                accessor["max"] = json!([values.last()]);
            }
            let accessors = list(document, "accessors");
            accessors.push(accessor);
            accessors.len() - 1
        };
        let times = (0..poses.len()).map(|it| (it as f64 * frame_s) as f32).collect();
        let times = put(&mut document, times, "SCALAR", 1);
        let (mut samplers, mut channels) = (Vec::new(), Vec::new());
        let mut animate = |node: u64, path: &str, values: usize| {
            channels.push(json!({ "sampler": samplers.len(), "target": { "node": node, "path": path } }));
            samplers.push(json!({ "input": times, "output": values, "interpolation": "LINEAR" }));
        };
        for (joint, node) in self.nodes.iter().enumerate() {
            let mut before = UnitQuaternion::identity();
            let mut values = Vec::with_capacity(4 * poses.len());
            for pose in poses {
                let turn = pose.turns[joint];
                // q and −q are the same turn; the nearer of the two is the shorter way from the last one.
                let sign = if turn.coords.dot(&before.coords) < 0.0 { -1.0 } else { 1.0 };
                before = UnitQuaternion::new_unchecked(turn.into_inner() * sign);
                values.extend([before.i, before.j, before.k, before.w].map(|it| it as f32));
            }
            let values = put(&mut document, values, "VEC4", 4);
            animate(*node, "rotation", values);
        }
        let roots = poses.iter().flat_map(|it| [it.root.x, it.root.y, it.root.z].map(|it| it as f32)).collect();
        let values = put(&mut document, roots, "VEC3", 3);
        animate(self.nodes[0], "translation", values);
        document["animations"] = json!([{ "name": "motion", "samplers": samplers, "channels": channels }]);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        if list(&mut document, "buffers").is_empty() {
            list(&mut document, "buffers").push(json!({}));
        }
        document["buffers"][0]["byteLength"] = json!(bytes.len());
        glb_file(&document, &bytes)
            .map_err(|length| format!("{length} bytes, expected at most 4 GiB, the limit of a GLB file"))
    }
}

/// A list of the document, made where it is missing.
fn list<'a>(document: &'a mut Value, name: &str) -> &'a mut Vec<Value> {
    if !document[name].is_array() {
        document[name] = json!([]);
    }
    match &mut document[name] {
        Value::Array(list) => list,
        _ => unreachable!("it was made a list"),
    }
}
