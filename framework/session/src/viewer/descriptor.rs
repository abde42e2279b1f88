//! What an MCAP file says of a kind of message: its name, and its description as the bytes of a `FileDescriptorSet`.
//!
//! Source of the field numbers: `google/protobuf/descriptor.proto`, which is public.

use super::schemas::{self, Field, FieldKind, MessageType};
use super::wire::Writer;

/// The schema of one kind of message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schema {
    /// Full name, such as `foxglove.RawImage`.
    pub name: &'static str,
    /// A `google.protobuf.FileDescriptorSet` with the message and all that it is made of, dependencies first.
    pub descriptor: Vec<u8>,
}

impl Schema {
    /// The encoding of every schema and every message here, as MCAP calls it.
    pub const ENCODING: &'static str = "protobuf";
}

/// A kind of message that viewers read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// `foxglove.RawImage`.
    RawImage,
    /// `foxglove.CompressedImage`.
    CompressedImage,
    /// `foxglove.CameraCalibration`.
    CameraCalibration,
    /// `foxglove.ImageAnnotations`.
    ImageAnnotations,
    /// `foxglove.FrameTransforms`.
    FrameTransforms,
    /// `foxglove.PosesInFrame`.
    PosesInFrame,
    /// `foxglove.PointCloud`.
    PointCloud,
    /// `foxglove.SceneUpdate`.
    SceneUpdate,
    /// `foxglove.Log`.
    Log,
    /// `foveate.Figures`.
    Figures,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Kind; 10] = [
        Kind::RawImage,
        Kind::CompressedImage,
        Kind::CameraCalibration,
        Kind::ImageAnnotations,
        Kind::FrameTransforms,
        Kind::PosesInFrame,
        Kind::PointCloud,
        Kind::SceneUpdate,
        Kind::Log,
        Kind::Figures,
    ];

    /// Full name of the message, such as `foxglove.RawImage`.
    pub const fn name(self) -> &'static str {
        match self {
            Kind::RawImage => "foxglove.RawImage",
            Kind::CompressedImage => "foxglove.CompressedImage",
            Kind::CameraCalibration => "foxglove.CameraCalibration",
            Kind::ImageAnnotations => "foxglove.ImageAnnotations",
            Kind::FrameTransforms => "foxglove.FrameTransforms",
            Kind::PosesInFrame => "foxglove.PosesInFrame",
            Kind::PointCloud => "foxglove.PointCloud",
            Kind::SceneUpdate => "foxglove.SceneUpdate",
            Kind::Log => "foxglove.Log",
            Kind::Figures => "foveate.Figures",
        }
    }

    /// For the schema record of an MCAP file.
    pub fn schema(self) -> Schema {
        Schema { name: self.name(), descriptor: descriptor_of(self.message_type()) }
    }

    pub(super) fn message_type(self) -> &'static MessageType {
        match self {
            Kind::RawImage => &schemas::raw_image::TYPE,
            Kind::CompressedImage => &schemas::compressed_image::TYPE,
            Kind::CameraCalibration => &schemas::camera_calibration::TYPE,
            Kind::ImageAnnotations => &schemas::image_annotations::TYPE,
            Kind::FrameTransforms => &schemas::frame_transforms::TYPE,
            Kind::PosesInFrame => &schemas::poses_in_frame::TYPE,
            Kind::PointCloud => &schemas::point_cloud::TYPE,
            Kind::SceneUpdate => &schemas::scene_update::TYPE,
            Kind::Log => &schemas::log::TYPE,
            Kind::Figures => &schemas::figures::TYPE,
        }
    }
}

impl MessageType {
    /// The messages that its fields are of.
    fn parts(&self) -> impl Iterator<Item = &'static MessageType> + '_ {
        self.fields.iter().filter_map(|it| match it.kind {
            FieldKind::Message(of) => Some(of),
            _ => None,
        })
    }

    fn full_name(&self) -> String {
        format!("{}.{}", self.package, self.name)
    }

    /// The file that describes it upstream: one for each message.
    fn file(&self) -> String {
        let package = self.package.replace('.', "/");
        match package.as_str() {
            "google/protobuf" => format!("{package}/{}.proto", self.name.to_lowercase()),
            _ => format!("{package}/{}.proto", self.name),
        }
    }
}

impl Field {
    /// As it stands in the schema: Rust's words are written with `r#` here.
    pub(super) fn plain_name(&self) -> &'static str {
        self.name.strip_prefix("r#").unwrap_or(self.name)
    }
}

fn descriptor_of(message: &'static MessageType) -> Vec<u8> {
    let mut files = Vec::new();
    add_with_parts(message, &mut files);
    let mut out = Vec::new();
    let mut set = Writer::new(&mut out);
    for file in files {
        set.message(1, |it| write_file(it, file));
    }
    out
}

/// Adds what `message` is made of, then itself, each once.
fn add_with_parts(message: &'static MessageType, files: &mut Vec<&'static MessageType>) {
    if !files.iter().any(|it| std::ptr::eq(*it, message)) {
        message.parts().for_each(|it| add_with_parts(it, files));
        files.push(message);
    }
}

/// A `FileDescriptorProto`: all parts are in other files.
fn write_file(out: &mut Writer<'_>, message: &MessageType) {
    out.string(1, &message.file());
    out.string(2, message.package);
    let mut imports: Vec<String> = message.parts().map(MessageType::file).collect();
    imports.sort();
    imports.dedup();
    imports.iter().for_each(|it| out.string(3, it));
    out.message(4, |it| write_message(it, message));
    out.string(12, "proto3");
}

/// A `DescriptorProto`.
fn write_message(out: &mut Writer<'_>, message: &MessageType) {
    out.string(1, message.name);
    for field in message.fields {
        out.message(2, |it| write_field(it, field, message));
    }
    for (name, values) in message.enums {
        out.message(4, |it| {
            it.string(1, name);
            for (number, value) in (0..).zip(*values) {
                it.message(2, |it| {
                    it.string(1, value);
                    it.varint(2, number);
                });
            }
        });
    }
}

/// A `FieldDescriptorProto`.
fn write_field(out: &mut Writer<'_>, field: &Field, message: &MessageType) {
    out.string(1, field.plain_name());
    out.varint(3, u64::from(field.number));
    out.varint(4, if field.repeated { 3 } else { 1 });
    let (number, name) = match field.kind {
        FieldKind::Double => (1, None),
        FieldKind::Int64 => (3, None),
        FieldKind::Int32 => (5, None),
        FieldKind::Fixed64 => (6, None),
        FieldKind::Fixed32 => (7, None),
        FieldKind::Bool => (8, None),
        FieldKind::String => (9, None),
        FieldKind::Message(of) => (11, Some(of.full_name())),
        FieldKind::Bytes => (12, None),
        FieldKind::Enum(name) => (14, Some(format!("{}.{name}", message.full_name()))),
        FieldKind::Sfixed64 => (16, None),
    };
    out.varint(5, number);
    if let Some(name) = name {
        out.string(6, &format!(".{name}"));
    }
}

#[cfg(test)]
mod tests {
    use super::super::wire::{Reader, Value};
    use super::*;

    /// What the fields of this number hold, as bytes; a number as its lowest one.
    fn contents(bytes: &[u8], number: u32) -> Vec<Vec<u8>> {
        let field = |it: Result<(u32, Value), String>| match it.unwrap() {
            (found, Value::Bytes(range)) if found == number => Some(bytes[range].to_vec()),
            (found, Value::Varint(it)) if found == number => Some(vec![it as u8]),
            _ => None,
        };
        Reader::new(bytes).filter_map(field).collect()
    }

    fn texts(bytes: &[u8], number: u32) -> Vec<String> {
        contents(bytes, number).into_iter().map(|it| String::from_utf8(it).unwrap()).collect()
    }

    #[test]
    fn each_file_comes_once_and_after_its_imports() {
        for kind in Kind::ALL {
            let schema = kind.schema();
            let mut known = Vec::new();
            for file in contents(&schema.descriptor, 1) {
                assert!(texts(&file, 3).iter().all(|it| known.contains(it)), "{known:?}");
                let [name] = &texts(&file, 1)[..] else { panic!("one name") };
                assert!(!known.contains(name), "{name}");
                assert_eq!(texts(&file, 12), ["proto3"]);
                known.push(name.clone());
            }
            assert_eq!(known.last(), Some(&format!("{}.proto", schema.name.replace('.', "/"))));
            assert_eq!(schema.name, kind.message_type().full_name());
        }
        let files = contents(&Kind::FrameTransforms.schema().descriptor, 1);
        let names: Vec<_> = files.iter().flat_map(|it| texts(it, 1)).collect();
        let last = ["Vector3", "Quaternion", "FrameTransform", "FrameTransforms"];
        assert_eq!(names[0], "google/protobuf/timestamp.proto");
        assert_eq!(names[1..], last.map(|it| format!("foxglove/{it}.proto")));
    }

    #[test]
    fn a_field_has_its_name_number_label_and_type() {
        let described = |kind: Kind| {
            let file = contents(&kind.schema().descriptor, 1).pop().unwrap();
            let fields = contents(&contents(&file, 4)[0], 2);
            let field = |it: &Vec<u8>| {
                let [number, label, kind] = [3, 4, 5].map(|number| contents(it, number)[0][0]);
                (texts(it, 1).remove(0), number, label, kind, texts(it, 6).pop().unwrap_or_default())
            };
            fields.iter().map(field).collect::<Vec<_>>()
        };
        let field = |name: &str, number, label, kind, of: &str| (name.to_owned(), number, label, kind, of.to_owned());
        // Types: 9 string, 11 message, 14 enum. Label 3: repeated.
        let log = described(Kind::Log);
        assert_eq!(log[0], field("timestamp", 1, 1, 11, ".google.protobuf.Timestamp"));
        assert_eq!(log[1], field("level", 2, 1, 14, ".foxglove.Log.Level"));
        assert_eq!(log[2], field("message", 3, 1, 9, ""));
        assert_eq!(described(Kind::Figures)[1], field("figures", 2, 3, 11, ".foveate.Figure"));
    }

    /// FNV-1a of all descriptors. The test with the public schemas in tests/viewers.rs has to run before this is changed.
    const VERIFIED: u64 = 0xf29b_83a1_ae10_f9e9;

    #[test]
    fn the_descriptors_are_those_that_were_compared_with_the_public_schemas() {
        let bytes = Kind::ALL.into_iter().flat_map(|it| it.schema().descriptor);
        let hash = bytes
            .fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
        assert_eq!(hash, VERIFIED, "compare them: FOVEATE_PEER_PYTHON=python3 cargo test -p foveate-session");
    }
}
