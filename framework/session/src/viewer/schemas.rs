//! The messages by their fields' names, numbers and types: those of the public `foxglove.*` schemas, and `foveate.Figures`.
//!
//! Each message is a module: `raw_image::width` is the number of that field, `raw_image::TYPE` describes all fields. A message is described in full, also where we
//! fill only a part: a viewer then finds empty lists instead of none.

#![allow(non_upper_case_globals, reason = "a constant is called as its field")]
#![allow(dead_code, reason = "fields that we leave empty are described too")]

/// A message: its package, name, fields and the enums within it.
pub(super) struct MessageType {
    pub(super) package: &'static str,
    pub(super) name: &'static str,
    pub(super) fields: &'static [Field],
    pub(super) enums: &'static [(&'static str, &'static [&'static str])],
}

/// A field of a message.
pub(super) struct Field {
    pub(super) name: &'static str,
    pub(super) number: u32,
    pub(super) repeated: bool,
    pub(super) kind: FieldKind,
}

/// What a field holds.
#[derive(Clone, Copy)]
pub(super) enum FieldKind {
    Double,
    Int64,
    Int32,
    Fixed64,
    Fixed32,
    Bool,
    String,
    Bytes,
    Sfixed64,
    Message(&'static MessageType),
    /// Of this message, by its name.
    Enum(&'static str),
}

use FieldKind::{Bool, Bytes, Double, Enum, Fixed32, Fixed64, Int32, Int64, Message, Sfixed64, String};

const fn one(kind: FieldKind) -> (bool, FieldKind) {
    (false, kind)
}

const fn many(kind: FieldKind) -> (bool, FieldKind) {
    (true, kind)
}

macro_rules! message {
    (
        $module:ident = $package:literal . $name:literal { $($number:literal $field:ident: $kind:expr,)* }
        $(enum $enum:literal [$($value:literal),*])?
    ) => {
        #[doc = concat!("`", $package, ".", $name, "`.")]
        pub(super) mod $module {
            use super::*;
            $(pub(in super::super) const $field: u32 = $number;)*
            pub(in super::super) static TYPE: MessageType = MessageType {
                package: $package,
                name: $name,
                fields: &[$({
                    let (repeated, kind) = $kind;
                    Field { name: stringify!($field), number: $number, repeated, kind }
                }),*],
                enums: &[$(($enum, &[$($value),*]))?],
            };
        }
    };
}

// Their files are called `timestamp.proto` and `duration.proto`.
message! { timestamp = "google.protobuf"."Timestamp" { 1 seconds: one(Int64), 2 nanos: one(Int32), } }
message! { duration = "google.protobuf"."Duration" { 1 seconds: one(Int64), 2 nanos: one(Int32), } }

const TIME: (bool, FieldKind) = one(Message(&timestamp::TYPE));
const POSE: (bool, FieldKind) = one(Message(&pose::TYPE));
const SIZE: (bool, FieldKind) = one(Message(&vector3::TYPE));
const COLOR: (bool, FieldKind) = one(Message(&color::TYPE));
const METADATA: (bool, FieldKind) = many(Message(&key_value_pair::TYPE));

message! { vector3 = "foxglove"."Vector3" { 1 x: one(Double), 2 y: one(Double), 3 z: one(Double), } }
message! { point2 = "foxglove"."Point2" { 1 x: one(Double), 2 y: one(Double), } }
message! { point3 = "foxglove"."Point3" { 1 x: one(Double), 2 y: one(Double), 3 z: one(Double), } }
message! { quaternion = "foxglove"."Quaternion" {
    1 x: one(Double), 2 y: one(Double), 3 z: one(Double), 4 w: one(Double),
} }
message! { color = "foxglove"."Color" { 1 r: one(Double), 2 g: one(Double), 3 b: one(Double), 4 a: one(Double), } }
message! { pose = "foxglove"."Pose" { 1 position: SIZE, 2 orientation: one(Message(&quaternion::TYPE)), } }
message! { key_value_pair = "foxglove"."KeyValuePair" { 1 key: one(String), 2 value: one(String), } }

message! { frame_transform = "foxglove"."FrameTransform" {
    1 timestamp: TIME,
    2 parent_frame_id: one(String),
    3 child_frame_id: one(String),
    4 translation: SIZE,
    5 rotation: one(Message(&quaternion::TYPE)),
} }
message! { frame_transforms = "foxglove"."FrameTransforms" { 1 transforms: many(Message(&frame_transform::TYPE)), } }
message! { poses_in_frame = "foxglove"."PosesInFrame" {
    1 timestamp: TIME, 2 frame_id: one(String), 3 poses: many(Message(&pose::TYPE)),
} }

// From 1000 on: our own, by which a recorded picture comes back as it was. Viewers skip them.
message! { raw_image = "foxglove"."RawImage" {
    1 timestamp: TIME,
    7 frame_id: one(String),
    2 width: one(Fixed32),
    3 height: one(Fixed32),
    4 encoding: one(String),
    5 step: one(Fixed32),
    6 data: one(Bytes),
    1000 foveate_picture: one(Message(&picture::TYPE)),
} }
message! { compressed_image = "foxglove"."CompressedImage" {
    1 timestamp: TIME,
    4 frame_id: one(String),
    2 data: one(Bytes),
    3 format: one(String),
    1000 foveate_picture: one(Message(&picture::TYPE)),
} }
message! { picture = "foveate"."Picture" {
    1 time: one(Sfixed64),
    2 source: one(Fixed32),
    3 sequence: one(Fixed64),
    4 camera: one(Fixed32),
    5 width: one(Fixed32),
    6 height: one(Fixed32),
    7 channels: one(Fixed32),
    8 left: one(Fixed32),
    9 top: one(Fixed32),
    10 shrink: one(Fixed32),
} }
message! { camera_calibration = "foxglove"."CameraCalibration" {
    1 timestamp: TIME,
    9 frame_id: one(String),
    2 width: one(Fixed32),
    3 height: one(Fixed32),
    4 distortion_model: one(String),
    5 D: many(Double),
    6 K: many(Double),
    7 R: many(Double),
    8 P: many(Double),
} }

message! { point_cloud = "foxglove"."PointCloud" {
    1 timestamp: TIME,
    2 frame_id: one(String),
    3 pose: POSE,
    4 point_stride: one(Fixed32),
    5 fields: many(Message(&packed_element_field::TYPE)),
    6 data: one(Bytes),
} }
message! { packed_element_field = "foxglove"."PackedElementField" {
    1 name: one(String), 2 offset: one(Fixed32), 3 r#type: one(Enum("NumericType")),
} enum "NumericType" ["UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"] }

message! { scene_update = "foxglove"."SceneUpdate" {
    1 deletions: many(Message(&scene_entity_deletion::TYPE)), 2 entities: many(Message(&scene_entity::TYPE)),
} }
message! { scene_entity_deletion = "foxglove"."SceneEntityDeletion" {
    1 timestamp: TIME, 2 r#type: one(Enum("Type")), 3 id: one(String),
} enum "Type" ["MATCHING_ID", "ALL"] }
message! { scene_entity = "foxglove"."SceneEntity" {
    1 timestamp: TIME,
    2 frame_id: one(String),
    3 id: one(String),
    4 lifetime: one(Message(&duration::TYPE)),
    5 frame_locked: one(Bool),
    6 metadata: METADATA,
    7 arrows: many(Message(&arrow_primitive::TYPE)),
    8 cubes: many(Message(&cube_primitive::TYPE)),
    9 spheres: many(Message(&sphere_primitive::TYPE)),
    10 cylinders: many(Message(&cylinder_primitive::TYPE)),
    11 lines: many(Message(&line_primitive::TYPE)),
    12 triangles: many(Message(&triangle_list_primitive::TYPE)),
    13 texts: many(Message(&text_primitive::TYPE)),
    14 models: many(Message(&model_primitive::TYPE)),
} }
message! { arrow_primitive = "foxglove"."ArrowPrimitive" {
    1 pose: POSE,
    2 shaft_length: one(Double),
    3 shaft_diameter: one(Double),
    4 head_length: one(Double),
    5 head_diameter: one(Double),
    6 color: COLOR,
} }
message! { cube_primitive = "foxglove"."CubePrimitive" { 1 pose: POSE, 2 size: SIZE, 3 color: COLOR, } }
message! { sphere_primitive = "foxglove"."SpherePrimitive" { 1 pose: POSE, 2 size: SIZE, 3 color: COLOR, } }
message! { cylinder_primitive = "foxglove"."CylinderPrimitive" {
    1 pose: POSE, 2 size: SIZE, 3 bottom_scale: one(Double), 4 top_scale: one(Double), 5 color: COLOR,
} }
message! { line_primitive = "foxglove"."LinePrimitive" {
    1 r#type: one(Enum("Type")),
    2 pose: POSE,
    3 thickness: one(Double),
    4 scale_invariant: one(Bool),
    5 points: many(Message(&point3::TYPE)),
    6 color: COLOR,
    7 colors: many(Message(&color::TYPE)),
    8 indices: many(Fixed32),
} enum "Type" ["LINE_STRIP", "LINE_LOOP", "LINE_LIST"] }
message! { triangle_list_primitive = "foxglove"."TriangleListPrimitive" {
    1 pose: POSE,
    2 points: many(Message(&point3::TYPE)),
    3 color: COLOR,
    4 colors: many(Message(&color::TYPE)),
    5 indices: many(Fixed32),
} }
message! { text_primitive = "foxglove"."TextPrimitive" {
    1 pose: POSE,
    2 billboard: one(Bool),
    3 font_size: one(Double),
    4 scale_invariant: one(Bool),
    5 color: COLOR,
    6 text: one(String),
} }
message! { model_primitive = "foxglove"."ModelPrimitive" {
    1 pose: POSE,
    2 scale: SIZE,
    3 color: COLOR,
    4 override_color: one(Bool),
    5 url: one(String),
    6 media_type: one(String),
    7 data: one(Bytes),
} }

message! { image_annotations = "foxglove"."ImageAnnotations" {
    5 timestamp: TIME,
    1 circles: many(Message(&circle_annotation::TYPE)),
    2 points: many(Message(&points_annotation::TYPE)),
    3 texts: many(Message(&text_annotation::TYPE)),
    4 metadata: METADATA,
} }
message! { circle_annotation = "foxglove"."CircleAnnotation" {
    1 timestamp: TIME,
    2 position: one(Message(&point2::TYPE)),
    3 diameter: one(Double),
    4 thickness: one(Double),
    5 fill_color: COLOR,
    6 outline_color: COLOR,
    7 metadata: METADATA,
} }
message! { points_annotation = "foxglove"."PointsAnnotation" {
    1 timestamp: TIME,
    2 r#type: one(Enum("Type")),
    3 points: many(Message(&point2::TYPE)),
    4 outline_color: COLOR,
    5 outline_colors: many(Message(&color::TYPE)),
    6 fill_color: COLOR,
    7 thickness: one(Double),
    8 metadata: METADATA,
} enum "Type" ["UNKNOWN", "POINTS", "LINE_LOOP", "LINE_STRIP", "LINE_LIST"] }
message! { text_annotation = "foxglove"."TextAnnotation" {
    1 timestamp: TIME,
    2 position: one(Message(&point2::TYPE)),
    3 text: one(String),
    4 font_size: one(Double),
    5 text_color: COLOR,
    6 background_color: COLOR,
    7 metadata: METADATA,
} }

message! { log = "foxglove"."Log" {
    1 timestamp: TIME,
    2 level: one(Enum("Level")),
    3 message: one(String),
    4 name: one(String),
    5 file: one(String),
    6 line: one(Fixed32),
} enum "Level" ["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"] }
message! { figures = "foveate"."Figures" { 1 timestamp: TIME, 2 figures: many(Message(&figure::TYPE)), } }
message! { figure = "foveate"."Figure" { 1 name: one(String), 2 value: one(Double), } }
