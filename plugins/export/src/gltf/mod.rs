//! glTF in one binary file (GLB): nodes that move, a surface over marks, cameras.
//!
//! Source: *glTF 2.0 Specification*, The Khronos Group, 2021. All moving nodes have one root that rotates our axes (z up) into those of glTF (y up): below it every
//! number is as in the world, in metres. A mesh that is moved by joints is next to it, as the specification requires (section 3.7.3.3). Time 0 is the first frame.

mod node;
mod of_motion;
mod scene;
mod still;
/// A GLB file of a document and of its binary chunk, whose length is a multiple of four; without bytes there is none.
///
/// # Errors
/// The length that it would have, where that is more than the 4 GiB that such a file can have.
pub(crate) fn glb_file(document: &Value, bytes: &[u8]) -> Result<Vec<u8>, usize> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = 12 + 8 + text.len() + if bytes.is_empty() { 0 } else { 8 + bytes.len() };
    let Ok(whole) = u32::try_from(length) else { return Err(length) };
    let mut file = Vec::with_capacity(length);
    file.extend_from_slice(b"glTF");
    file.extend(2_u32.to_le_bytes());
    file.extend(whole.to_le_bytes());
    // Both chunks are shorter than the whole.
    file.extend((text.len() as u32).to_le_bytes());
    file.extend_from_slice(b"JSON");
    file.extend(text);
    if !bytes.is_empty() {
        file.extend((bytes.len() as u32).to_le_bytes());
        file.extend_from_slice(b"BIN\0");
        file.extend_from_slice(bytes);
    }
    Ok(file)
}

#[cfg(test)]
mod tests;
mod triangles;

pub use node::{ExportGltf, ExportGltfSettings};
pub use of_motion::glb;
pub(crate) use still::{cloud_glb, mesh_glb};

use serde_json::{Value, json};

/// A file under construction: the lists of the JSON, and the bytes that they refer to.
#[derive(Debug, Default)]
pub(crate) struct Glb {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    nodes: Vec<Value>,
    pub(crate) meshes: Vec<Value>,
    pub(crate) skins: Vec<Value>,
    cameras: Vec<Value>,
    materials: Vec<Value>,
    channels: Vec<Value>,
    samplers: Vec<Value>,
}

/// (x, y, z) of ours is (x, z, −y) of glTF: a quarter turn about −x.
pub(crate) const Y_UP: [f64; 4] = [-std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2];

/// Purpose of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Use {
    Vertices = 34962,
    Indices = 34963,
    Other = 0,
}

impl Glb {
    fn view(&mut self, bytes: impl Iterator<Item = u8>, of: Use) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(bytes);
        let length = self.bytes.len() - start;
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": start, "byteLength": length });
        if of != Use::Other {
            view["target"] = json!(of as u32);
        }
        self.views.push(view);
        self.views.len() - 1
    }

    /// Floats, `N` per element, with their bounds.
    pub(crate) fn floats<const N: usize>(&mut self, values: &[[f32; N]], of: Use) -> usize {
        let kind = match N {
            1 => "SCALAR",
            3 => "VEC3",
            4 => "VEC4",
            _ => "MAT4",
        };
        let view = self.view(values.iter().flatten().flat_map(|it| it.to_le_bytes()), of);
        let bound = |pick: fn(f32, f32) -> f32, start: f32| {
            let one = |axis: usize| values.iter().map(|it| it[axis]).fold(start, pick);
            (0..N).map(one).collect::<Vec<f32>>()
        };
        let (least, most) = (bound(f32::min, f32::INFINITY), bound(f32::max, f32::NEG_INFINITY));
        self.accessors.push(json!({
            "bufferView": view, "componentType": 5126, "count": values.len(), "type": kind, "min": least, "max": most,
        }));
        self.accessors.len() - 1
    }

    /// Words, `N` per element.
    pub(crate) fn words<const N: usize>(&mut self, values: &[[u16; N]], of: Use) -> usize {
        let view = self.view(values.iter().flatten().flat_map(|it| it.to_le_bytes()), of);
        let kind = if N == 1 { "SCALAR" } else { "VEC4" };
        self.accessors.push(json!({
            "bufferView": view, "componentType": 5123, "count": values.len(), "type": kind,
        }));
        self.accessors.len() - 1
    }

    /// Corners of triangles.
    pub(crate) fn indices(&mut self, triangles: &[[u32; 3]]) -> usize {
        let view = self.view(triangles.iter().flatten().flat_map(|it| it.to_le_bytes()), Use::Indices);
        let count = 3 * triangles.len();
        self.accessors.push(json!({ "bufferView": view, "componentType": 5125, "count": count, "type": "SCALAR" }));
        self.accessors.len() - 1
    }

    pub(crate) fn node(&mut self, node: Value) -> usize {
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    /// Moves `path` of a node through the values at the times of an accessor.
    pub(crate) fn animate(&mut self, node: usize, path: &str, times: usize, values: usize, interpolation: &str) {
        let sampler = json!({ "input": times, "output": values, "interpolation": interpolation });
        self.samplers.push(sampler);
        let target = json!({ "node": node, "path": path });
        self.channels.push(json!({ "sampler": self.samplers.len() - 1, "target": target }));
    }

    /// The whole file; `roots` are the root nodes.
    ///
    /// # Errors
    /// Its number of bytes, where that exceeds 32 bits.
    pub(crate) fn finish(self, roots: &[usize], start_s: f64) -> Result<Vec<u8>, usize> {
        let mut document = json!({
            "asset": { "version": "2.0", "generator": "Foveate" },
            "scene": 0,
            "scenes": [{ "nodes": roots }],
            "nodes": self.nodes,
        });
        // Lists without an entry are not allowed.
        let animations = match self.channels.is_empty() {
            true => Vec::new(),
            false => vec![json!({
                "name": "motion", "channels": self.channels, "samplers": self.samplers, "extras": { "start_s": start_s },
            })],
        };
        let buffers = match self.bytes.is_empty() {
            true => Vec::new(),
            false => vec![json!({ "byteLength": self.bytes.len() })],
        };
        for (name, list) in [
            ("buffers", buffers),
            ("bufferViews", self.views),
            ("accessors", self.accessors),
            ("meshes", self.meshes),
            ("materials", self.materials),
            ("skins", self.skins),
            ("cameras", self.cameras),
            ("animations", animations),
        ] {
            if !list.is_empty() {
                document[name] = Value::Array(list);
            }
        }
        glb_file(&document, &self.bytes)
    }
}
