//! Messages as the page gets them: a head of 32 bytes, a JSON header, and bytes.
//!
//! The head, little endian: topic and kind as 32-bit numbers, capture time [s] and sequence number as 64-bit floats, source and length of the header as 32-bit numbers.

use std::any::Any;

use foveate_messages::{
    Image, Mesh, PixelFormat, PointCloud, ScaleCloud, Silhouette, Stamp, TrackedSurface, Voxels, Window,
};
use foveate_node::io::Packet;
use foveate_node::port::MessageType;
use nalgebra::Point3;
use serde_json::json;

use crate::hello::pose;

/// What a window wants of a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// The message as serde writes it, without its bulk data.
    Value,
    /// A picture, at most so many columns wide; 0: as it is.
    Picture {
        /// Columns [px].
        width: u32,
    },
    /// Points with colours.
    Points,
    /// Triangles with colours.
    Mesh,
}

impl Kind {
    /// Its number on the socket.
    pub fn number(self) -> u32 {
        match self {
            Kind::Value => 1,
            Kind::Picture { .. } => 2,
            Kind::Points => 3,
            Kind::Mesh => 4,
        }
    }
}

/// A message of `topic` as the page gets it; `None`: a message of this type has no such form.
pub fn view(topic: u32, message: &MessageType, packet: &Packet, kind: Kind) -> Option<Vec<u8>> {
    let start = |header: &str, room: usize| start(topic, kind, packet.stamp, header, room);
    match kind {
        Kind::Value => {
            let payload: &dyn Any = &*packet.payload;
            let text = serde_json::to_string(message.wire.codec()?.view(payload)?).ok()?;
            Some(start(&text, 0))
        }
        Kind::Picture { width } => picture(packet, width, &start),
        Kind::Points => points(packet, &start),
        Kind::Mesh => mesh(packet.as_typed()?, &start),
    }
}

/// The head and the header of a message, with room for so many bytes behind them.
fn start(topic: u32, kind: Kind, stamp: Stamp, header: &str, room: usize) -> Vec<u8> {
    let padded = header.len().next_multiple_of(4);
    let mut bytes = Vec::with_capacity(32 + padded + room);
    bytes.extend(topic.to_le_bytes());
    bytes.extend(kind.number().to_le_bytes());
    bytes.extend(stamp.time.as_s().to_le_bytes());
    bytes.extend((stamp.sequence as f64).to_le_bytes());
    bytes.extend(stamp.source.0.to_le_bytes());
    bytes.extend((padded as u32).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.resize(32 + padded, b' ');
    bytes
}

/// A picture is reduced by this at most: the sum of so many pixels is a 16-bit number.
const MOST_FACTOR: u32 = 256;

type Start<'a> = dyn Fn(&str, usize) -> Vec<u8> + 'a;

/// A picture or a silhouette, reduced by a whole factor until it is no wider than `most`.
fn picture(packet: &Packet, most: u32, start: &Start<'_>) -> Option<Vec<u8>> {
    let (pixels, [width, height], channels, window, kind) = if let Some(it) = packet.as_typed::<Image>() {
        (&it.pixels, [it.width, it.height], it.format.channels(), it.window, "image")
    } else {
        let it = packet.as_typed::<Silhouette>()?;
        (&it.confidence, [it.width, it.height], PixelFormat::Gray8.channels(), it.window, "silhouette")
    };
    if pixels.len() != width as usize * height as usize * channels || pixels.is_empty() {
        return None;
    }
    let factor = if most == 0 { 1 } else { width.div_ceil(most).clamp(1, height.min(MOST_FACTOR)) };
    let (columns, rows) = (width / factor, height / factor);
    let Window { left, top, shrink } = window;
    let header = json!({
        "width": columns, "height": rows, "channels": channels, "factor": factor, "kind": kind,
        "window": { "left": left, "top": top, "shrink": shrink },
    });
    let mut bytes = start(&header.to_string(), columns as usize * rows as usize * channels);
    match factor {
        1 => bytes.extend(pixels),
        _ => reduce(pixels, width as usize, channels, factor as usize, [columns as usize, rows as usize], &mut bytes),
    }
    Some(bytes)
}

/// Each pixel is the mean between the mean and the brightest of its cell: a light of two pixels is seen in a small picture, and a wall keeps its gray.
fn reduce(pixels: &[u8], width: usize, channels: usize, factor: usize, [columns, rows]: [usize; 2], out: &mut Vec<u8>) {
    let n = (factor * factor) as u32;
    // Down the columns first, which goes many at a time.
    let (mut sums, mut most) = (vec![0_u16; width * channels], vec![0_u8; width * channels]);
    for cells in pixels.chunks_exact(width * channels * factor).take(rows) {
        sums.fill(0);
        most.fill(0);
        for line in cells.chunks_exact(width * channels) {
            for ((sum, most), &pixel) in sums.iter_mut().zip(&mut most).zip(line) {
                *sum += u16::from(pixel);
                *most = (*most).max(pixel);
            }
        }
        for cell in 0..columns {
            let start = cell * factor * channels;
            for channel in start..start + channels {
                let places = || (channel..channel + factor * channels).step_by(channels);
                let sum: u32 = places().map(|it| u32::from(sums[it])).sum();
                let brightest = places().map(|it| most[it]).max().unwrap_or(0);
                out.push(((sum / n + u32::from(brightest)) / 2) as u8);
            }
        }
    }
}

/// A place and its colour.
type Dot = (Point3<f32>, [u8; 3]);

/// Points of clouds, surfaces and voxels.
fn points(packet: &Packet, start: &Start<'_>) -> Option<Vec<u8>> {
    let of_cloud = |it: &PointCloud| -> Vec<Dot> { it.iter().map(|it| (it.position, it.colour)).collect() };
    let (space, size_m, dots): (&str, Option<f64>, Vec<Dot>) = if let Some(it) = packet.as_typed::<PointCloud>() {
        ("world", None, of_cloud(it))
    } else if let Some(it) = packet.as_typed::<ScaleCloud>() {
        ("scale", None, of_cloud(&it.cloud))
    } else if let Some(it) = packet.as_typed::<Voxels>() {
        let visible = it.iter().filter(|it| it.is_surface);
        ("scale", Some(it.size), visible.map(|voxel| (it.centre(voxel.index).cast(), voxel.colour)).collect())
    } else {
        let it = packet.as_typed::<TrackedSurface>()?;
        // By identity, so that a point keeps its colour.
        ("scale", None, it.list.iter().map(|it| (it.position.cast(), colour_of(it.id))).collect())
    };
    let header = json!({ "n": dots.len(), "space": space, "size_m": size_m });
    let mut bytes = start(&header.to_string(), 16 * dots.len());
    write_dots(&mut bytes, &dots);
    Some(bytes)
}

/// Distinct colours for neighbouring numbers.
fn colour_of(id: u32) -> [u8; 3] {
    let turn = id.wrapping_mul(0x9e37_79b9).to_le_bytes();
    [turn[1], turn[2], turn[3]].map(|it| 64 + it / 4 * 3)
}

/// Places as three floats each, then colours as four bytes each.
fn write_dots(bytes: &mut Vec<u8>, dots: &[Dot]) {
    for (place, _) in dots {
        bytes.extend([place.x, place.y, place.z].iter().flat_map(|it| it.to_le_bytes()));
    }
    for (_, [r, g, b]) in dots {
        bytes.extend([r, g, b, &255]);
    }
}

fn mesh(mesh: &Mesh, start: &Start<'_>) -> Option<Vec<u8>> {
    let dots: Vec<Dot> = mesh.vertices().map(|it| (it.position, it.colour)).collect();
    let triangles: Vec<[u32; 3]> = mesh.triangles().collect();
    let header = json!({ "vertices": dots.len(), "triangles": triangles.len(), "pose": pose(&mesh.world_from_mesh) });
    let mut bytes = start(&header.to_string(), 16 * dots.len() + 12 * triangles.len());
    write_dots(&mut bytes, &dots);
    bytes.extend(triangles.iter().flatten().flat_map(|it| it.to_le_bytes()));
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_messages::{CameraId, CloudPoint, Features, Message, SourceId, Time};
    use serde_json::Value;

    use super::*;

    fn packet<T: Message>(message: T) -> Packet {
        let stamp = Stamp { time: Time(1_500_000_000), source: SourceId(7), sequence: 42 };
        Packet { stamp, payload: Arc::new(message) }
    }

    /// Header and payload, after the head was compared.
    fn read(bytes: &[u8], topic: u32, kind: u32) -> (Value, Vec<u8>) {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let float = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
        assert_eq!((word(0), word(4), float(8), float(16), word(24)), (topic, kind, 1.5, 42.0, 7));
        let end = 32 + word(28) as usize;
        assert_eq!(end % 4, 0);
        (serde_json::from_slice(&bytes[32..end]).unwrap(), bytes[end..].to_vec())
    }

    #[test]
    fn a_value_is_the_message_as_serde_writes_it() {
        let features = Features { camera: CameraId(3), list: Vec::new() };
        let bytes = view(9, &MessageType::of::<Features>(), &packet(features), Kind::Value).unwrap();
        assert_eq!(read(&bytes, 9, 1), (json!({ "camera": 3, "list": [] }), Vec::new()));
    }

    #[test]
    fn a_picture_is_reduced_until_it_is_as_narrow_as_wanted_and_small_lights_stay() {
        let mut pixels = vec![10; 64 * 32];
        pixels[5 * 64 + 9] = 250;
        let image = Image { width: 64, height: 32, pixels: pixels.clone(), ..Image::default() };
        let of = |width| view(1, &MessageType::of::<Image>(), &packet(image.clone()), Kind::Picture { width }).unwrap();
        let (header, whole) = read(&of(0), 1, 2);
        assert_eq!((header["width"].as_u64(), header["factor"].as_u64(), whole), (Some(64), Some(1), pixels));
        let (header, small) = read(&of(16), 1, 2);
        assert_eq!(
            (header["width"].as_u64(), header["height"].as_u64(), header["factor"].as_u64()),
            (Some(16), Some(8), Some(4))
        );
        assert_eq!(small.len(), 16 * 8);
        assert_eq!(small[0], 10, "a wall keeps its gray");
        assert_eq!(small[16 + 2], 137, "(25 + 250) / 2: the light's cell");
        let broken = Image { width: 9, ..image.clone() };
        assert!(view(1, &MessageType::of::<Image>(), &packet(broken), Kind::Picture { width: 0 }).is_none());
    }

    #[test]
    fn a_colour_picture_is_reduced_colour_by_colour() {
        let pixels = [[0, 40, 90], [20, 40, 10]].repeat(4).concat();
        let image = Image { width: 4, height: 2, format: PixelFormat::Rgb8, pixels, ..Image::default() };
        let bytes = view(1, &MessageType::of::<Image>(), &packet(image), Kind::Picture { width: 2 }).unwrap();
        assert_eq!(read(&bytes, 1, 2).1, [15, 40, 70, 15, 40, 70]);
    }

    #[test]
    fn points_are_floats_and_colours() {
        let mut cloud = PointCloud::default();
        let point = CloudPoint {
            position: Point3::new(1.0, -2.0, 3.5),
            covariance: nalgebra::Matrix3::zeros(),
            normal: nalgebra::Vector3::zeros(),
            confidence: 1.0,
            pixel: [0, 0],
            colour: [1, 2, 3],
        };
        cloud.push(&point);
        let bytes = view(0, &MessageType::of::<PointCloud>(), &packet(cloud), Kind::Points).unwrap();
        let (header, payload) = read(&bytes, 0, 3);
        assert_eq!(header, json!({ "n": 1, "space": "world", "size_m": null }));
        let floats: Vec<f32> = payload[..12].chunks(4).map(|it| f32::from_le_bytes(it.try_into().unwrap())).collect();
        assert_eq!((floats, &payload[12..]), (vec![1.0, -2.0, 3.5], &[1, 2, 3, 255][..]));
        assert!(view(0, &MessageType::of::<Features>(), &packet(Features::default()), Kind::Points).is_none());
    }
}
