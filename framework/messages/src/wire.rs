//! How messages are written and read without knowing their types: by recordings, links, plugins.

use std::any::Any;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::Message;

/// Whether and how a message leaves its process.
#[derive(Debug, Clone, Copy)]
pub enum Wire {
    /// A handle on something in this process: never recorded or sent.
    Local,
    /// Written and read by these functions.
    Portable(&'static Codec),
}

/// Writes and reads one type of message. Bulk data travels beside it: [`Message::bulk`].
#[derive(Debug, Clone, Copy)]
pub struct Codec {
    schema: fn() -> Schema,
    view: fn(&dyn Any) -> Option<&dyn erased_serde::Serialize>,
    read: Read,
}

type Read =
    fn(&mut dyn erased_serde::Deserializer<'_>, Vec<u8>) -> Result<Box<dyn Any + Send + Sync>, erased_serde::Error>;

impl Wire {
    /// Of a type that serde writes and reads.
    pub const fn portable<T: Message + Serialize + DeserializeOwned + JsonSchema>() -> Wire {
        Wire::Portable(const { &Codec::of::<T>() })
    }

    /// Its functions, where it is portable.
    pub fn codec(&self) -> Option<&Codec> {
        match self {
            Wire::Portable(codec) => Some(codec),
            Wire::Local => None,
        }
    }
}

/// As [`Wire::portable`], of one type: its functions are compiled in this crate, and not again in each that names the message.
macro_rules! portable {
    ($message:ty) => {{
        static CODEC: $crate::wire::Codec = $crate::wire::Codec::of::<$message>();
        $crate::wire::Wire::Portable(&CODEC)
    }};
}
pub(crate) use portable;

impl Codec {
    pub(crate) const fn of<T: Message + Serialize + DeserializeOwned + JsonSchema>() -> Self {
        Self { schema: schema::<T>, view: view::<T>, read: read::<T> }
    }

    /// JSON Schema of what [`Codec::view`] shows.
    pub fn schema(&self) -> Schema {
        (self.schema)()
    }

    /// Changes whenever the fields of the message or their types do: a hash (FNV-1a, 64 bits) of the schema without its descriptions.
    pub fn layout(&self) -> u64 {
        let mut schema = self.schema().to_value();
        forget_words(&mut schema);
        let text = schema.to_string();
        text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
    }

    /// What any serializer writes of `message`: all but its bulk data. `None` for a message of another type.
    pub fn view<'m>(&self, message: &'m dyn Any) -> Option<&'m dyn erased_serde::Serialize> {
        (self.view)(message)
    }

    /// Reads a message, and gives it its bulk data.
    ///
    /// # Errors
    /// What is not as the schema says.
    pub fn read(
        &self,
        from: &mut dyn erased_serde::Deserializer<'_>,
        bulk: Vec<u8>,
    ) -> Result<Box<dyn Any + Send + Sync>, erased_serde::Error> {
        (self.read)(from, bulk)
    }
}

fn schema<T: JsonSchema>() -> Schema {
    SchemaGenerator::default().into_root_schema_for::<T>()
}

fn view<T: Message + Serialize>(message: &dyn Any) -> Option<&dyn erased_serde::Serialize> {
    message.downcast_ref::<T>().map(|it| it as &dyn erased_serde::Serialize)
}

fn read<T: Message + DeserializeOwned>(
    from: &mut dyn erased_serde::Deserializer<'_>,
    bulk: Vec<u8>,
) -> Result<Box<dyn Any + Send + Sync>, erased_serde::Error> {
    let mut message: T = erased_serde::deserialize(from)?;
    message.set_bulk(bulk);
    Ok(Box::new(message))
}

/// Takes descriptions out of a schema: words do not change what is written.
fn forget_words(schema: &mut Value) {
    match schema {
        Value::Object(map) => {
            map.retain(|key, it| key != "description" || !it.is_string());
            map.values_mut().for_each(forget_words);
        }
        Value::Array(list) => list.iter_mut().for_each(forget_words),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{
        Isometry3, Matrix2, Matrix3, Matrix4, Matrix6, Point2, Point3, Quaternion, UnitQuaternion, Vector2, Vector3,
    };

    use super::*;
    use crate::*;

    /// Writes a message as JSON and reads it back.
    #[track_caller]
    fn there_and_back<T: Message + PartialEq + std::fmt::Debug>(message: &T) {
        let codec = T::WIRE.codec().copied().unwrap();
        let text = serde_json::to_string(codec.view(message).unwrap()).unwrap();
        let mut from = serde_json::Deserializer::from_str(&text);
        let mut from = <dyn erased_serde::Deserializer<'_>>::erase(&mut from);
        let back = codec.read(&mut from, message.bulk().to_vec()).unwrap();
        assert_eq!(back.downcast_ref::<T>(), Some(message), "{text}");
        fits(codec.schema().as_value(), codec.schema().as_value(), &serde_json::from_str(&text).unwrap(), T::NAME);
    }

    /// Whether a value is what a schema says, as far as types, properties and lengths go.
    #[track_caller]
    fn fits(root: &Value, schema: &Value, value: &Value, path: &str) {
        let schema = match schema.get("$ref").and_then(Value::as_str) {
            Some(reference) => root.pointer(reference.trim_start_matches('#')).unwrap(),
            None => schema,
        };
        if let Some(list) = schema.get("anyOf").or_else(|| schema.get("oneOf")).and_then(Value::as_array) {
            let any = list.iter().any(|it| std::panic::catch_unwind(|| fits(root, it, value, path)).is_ok());
            assert!(any, "{path}: {value} is none of {list:?}");
            return;
        }
        let kinds = match schema.get("type") {
            Some(Value::String(kind)) => vec![kind.as_str()],
            Some(Value::Array(kinds)) => kinds.iter().filter_map(Value::as_str).collect(),
            _ => vec![],
        };
        let kind = match value {
            Value::Null => "null",
            Value::Bool(_) => "boolean",
            Value::Number(it) if it.is_f64() => "number",
            Value::Number(_) => "integer",
            Value::String(_) => "string",
            Value::Array(_) => "array",
            Value::Object(_) => "object",
        };
        let is_one = kinds.is_empty() || kinds.contains(&kind) || (kind == "integer" && kinds.contains(&"number"));
        assert!(is_one, "{path}: {value} is no {kinds:?}");
        if let Value::Array(items) = value {
            let n = schema.get("minItems").and_then(Value::as_u64);
            assert!(n.is_none_or(|it| items.len() as u64 >= it), "{path}: {} items", items.len());
            if let Some(of_item) = schema.get("items") {
                items.iter().for_each(|it| fits(root, of_item, it, path));
            }
        }
        if let Value::Object(map) = value {
            for (key, it) in map {
                let property = schema.get("properties").and_then(|it| it.get(key));
                let property = property.unwrap_or_else(|| panic!("{path}.{key} is not in {schema}"));
                fits(root, property, it, &format!("{path}.{key}"));
            }
        }
    }

    fn target() -> Target {
        Target {
            id: TargetId(7),
            position: Point3::new(1.0, -2.5, 0.1),
            velocity: Vector3::new(0.25, 0.0, 3.0),
            covariance: Matrix6::from_fn(|row, column| (row * 6 + column) as f64),
            cameras: [3, 1].map(CameraId).into_iter().collect(),
            provenance: Provenance::Filled,
        }
    }

    #[test]
    fn every_message_is_written_and_read_back_as_its_schema_says() {
        // Numbers that JSON holds exactly; of length 1 but for the last bit, which reading must not put right.
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(0.5, -0.5, 0.5, 0.5 + f64::EPSILON));
        let pose = Isometry3::from_parts(Vector3::new(1.0, 2.0, 3.0).into(), rotation);
        let skew = Matrix2::new(1.0, 2.0, 3.0, 4.0);
        let feature = Feature { centre: Point2::new(4.5, 7.25), covariance: skew, area: 9, peak: 200, label: Some(3) };
        there_and_back(&Features { camera: CameraId(2), list: vec![feature, Feature { label: None, ..feature }] });
        there_and_back(&Targets { time: Time(5), list: vec![target()] });
        let region = SubRegion {
            time: Time(-1),
            target: TargetId(7),
            centre: Point3::new(0.5, 0.25, 2.0),
            velocity: Vector3::x(),
            covariance: target().covariance,
            radius: 0.2,
            provenance: Provenance::Predicted,
        };
        there_and_back(&region);
        let space = ScaleSpace {
            scale: ScaleId(2),
            time: Time(9),
            target: None,
            parent_from_scale: pose,
            covariance: Matrix6::identity(),
            velocity: Vector3::y(),
            motion_covariance: target().covariance,
        };
        there_and_back(&space);
        there_and_back(&Assignment { list: vec![(CameraId(4), TargetId(1))] });
        there_and_back(&CameraChoice { cameras: target().cameras });
        let go = HeadOrder::Go { angles: [0.5, -0.25], speeds: [1.0, 2.0] };
        there_and_back(&HeadCommand { camera: CameraId(1), order: go, zoom: Some(100.0) });
        there_and_back(&HeadCommand { camera: CameraId(1), order: HeadOrder::Turn { rates: [0.5, 0.0] }, zoom: None });
        let position = HeadPosition { earliest: Time(1), latest: Time(2), angles: [0.0, 1.5] };
        let events = [
            HeadEvent::Link(HeadLink::Ready),
            HeadEvent::Sent(go),
            HeadEvent::Arrived,
            HeadEvent::Position(position),
            HeadEvent::Zoom(3.5),
        ];
        let events = events.into_iter().zip(0..).map(|(it, at)| (Time(at), it)).collect();
        there_and_back(&HeadReport { camera: CameraId(1), link: HeadLink::Away, first: 12, events });
        let head_pose = HeadPose {
            camera: CameraId(1),
            time: Time(3),
            angles: [0.5, 0.25],
            angles_covariance: skew,
            rates: [0.0, 1.0],
            zoom: None,
            camera_from_world: pose,
            covariance: target().covariance,
            age: Interval(4),
        };
        there_and_back(&head_pose);
        let mark = Mark {
            label: 76,
            position: Point3::new(1.0, 2.0, 3.0),
            covariance: Matrix3::from_fn(|row, column| (row + 3 * column) as f64),
            cameras: target().cameras,
            provenance: Provenance::Measured,
        };
        let fit = ShapeFit { rms: 0.001, out_of_distribution: 0.5, weights: vec![0.25, 1.0] };
        there_and_back(&Marks { world_from_marks: pose, list: vec![mark], fit: Some(fit), ..Marks::default() });
        let guided = GuidedMark { label: 1, pixel: Point2::new(1.0, 2.0), covariance: skew, disputed: true };
        there_and_back(&MarkGuide { time: Time(1), cameras: vec![(CameraId(2), vec![guided])] });
        let pixels = (0..12).collect();
        let image = Image { camera: CameraId(1), width: 4, height: 3, pixels, ..Image::default() };
        there_and_back(&image);
        let names = vec!["00.png".to_owned()];
        let pixels = (0..6).collect();
        there_and_back(&PatternPictures { width: 3, height: 2, names, pixels, ..PatternPictures::default() });
        let mut map = ProjectorMap { width: 1, height: 1, projector_size: [1024, 768], ..ProjectorMap::default() };
        map.push(ProjectorSample { coordinate: [1.5, 2.5], sigma: [0.25, 0.5] });
        there_and_back(&map);
        let cloud =
            PointCloud { name: "pose".to_owned(), camera_size: [4, 3], points: vec![7; 60], ..PointCloud::default() };
        there_and_back(&cloud);
        let viewpoint = Some(Viewpoint { camera_from_space: pose });
        let cloud = PointCloud { viewpoint, ..cloud };
        there_and_back(&ScaleCloud { cloud, world_from_scale: pose, covariance: target().covariance });
        let vertex = MeshVertex {
            position: Point3::new(1.0, 2.0, 3.0),
            normal: Vector3::x(),
            weight: 2.0,
            sigma: 0.5,
            colour: [1, 2, 3],
        };
        there_and_back(&Mesh { world_from_mesh: pose, ..Mesh::new([vertex; 3], &[[0, 1, 2]]) });
        let status = SilhouetteStatus::Full;
        let confidence = vec![0, 127, 128, 255];
        there_and_back(&Silhouette { width: 2, height: 2, status, confidence, ..Silhouette::default() });
        let view =
            VoxelView { camera: CameraId(3), status: ViewStatus::Contradicts, body_px: 9, covered: 0.5, outside: 0.25 };
        let component = VoxelComponent {
            n_voxels: 2,
            centroid: Point3::new(1.0, 2.0, 3.0),
            min: [1, 2, 3],
            max: [4, 5, 6],
            is_cut_off: true,
            target: Some(TargetId(7)),
        };
        let (views, components) = (vec![view], vec![component]);
        let contested = vec![Contested { centroid: Point3::new(0.5, 1.0, 1.5), volume: 0.25 }];
        let voxels = vec![7; 2 * Voxel::BYTES];
        there_and_back(&Voxels { world_from_scale: pose, views, components, contested, voxels, ..Voxels::default() });
        let joint = SkeletonJoint {
            joint: 5,
            position: Point3::new(1.0, 2.0, 3.0),
            velocity: Vector3::x(),
            covariance: Matrix6::identity(),
            provenance: Provenance::Filled,
        };
        let part = SkeletonPart {
            part: 2,
            scale_from_part: pose,
            sizes: Vector3::y(),
            size_sigmas: Vector3::z(),
            provenance: Provenance::Predicted,
        };
        let limbs = [LimbDetail::Absent, LimbDetail::Straight, LimbDetail::Bent, LimbDetail::Absent];
        let list = vec![Skeleton {
            id: 7,
            joints: vec![joint],
            parts: vec![part],
            limbs,
            facing: 0.5,
            unexplained: 0.25,
            cameras: CameraSet::default(),
        }];
        let reason = "no head".to_owned();
        let unmodelled =
            vec![Unmodelled { centroid: Point3::origin(), volume: 0.03, target: Some(TargetId(2)), reason }];
        there_and_back(&Skeletons { list, unmodelled, ..Skeletons::default() });
        there_and_back(&PatternShown {
            set: 3,
            index: 1,
            count: 24,
            name: "white".to_owned(),
            ..PatternShown::default()
        });
        let position = Point2::new(0.25, 0.5);
        let pointer = Pointer {
            id: TargetId(7),
            user: Some(3),
            position,
            velocity: Vector2::new(1.0, -1.0),
            predicted: Point2::new(0.5, 0.25),
            sigma: 0.001,
            is_pressed: true,
            is_resting: false,
            is_seen: true,
        };
        let path = vec![StrokePoint { time: Time(1), position }];
        let events = PointerChange::ALL.map(|what| PointerEvent {
            id: TargetId(7),
            user: Some(3),
            what,
            time: Time(1),
            latency: Interval(3),
            position,
            path: path.clone(),
        });
        let eye =
            EyeView { eye: Point3::new(1.0, 2.0, 3.0), clip_from_space: Matrix4::from_fn(|r, c| (r + 4 * c) as f64) };
        let tile = TileView {
            name: "left".to_owned(),
            size_px: [1920, 1080],
            corners: [Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0)],
            eyes: [Some(eye), None],
        };
        there_and_back(&Views { time: Time(1), shown_at: Time(2), tiles: vec![tile] });
        let owners = vec![TargetUser { id: TargetId(7), user: 3 }];
        let exchanged = vec![Exchange { ids: [TargetId(7), TargetId(8)], since: Time(1) }];
        there_and_back(&Users { time: Time(2), list: owners, exchanged: exchanged.clone() });
        there_and_back(&Pointers {
            time: Time(2),
            shown_at: Time(9),
            list: vec![pointer],
            exchanged,
            events: events.to_vec(),
        });
        let text = serde_json::to_string(Image::WIRE.codec().unwrap().view(&image).unwrap()).unwrap();
        assert!(!text.contains("pixels"), "bulk data goes beside the rest: {text}");
    }

    #[test]
    fn a_layout_follows_the_fields_and_not_the_words() {
        #[derive(JsonSchema)]
        #[expect(dead_code, reason = "only its schema is used")]
        struct One {
            /// A number.
            a: f64,
        }
        #[derive(JsonSchema)]
        #[schemars(rename = "One")]
        #[expect(dead_code, reason = "only its schema is used")]
        struct SameInOtherWords {
            /// Some number.
            a: f64,
        }
        #[derive(JsonSchema)]
        #[schemars(rename = "One")]
        #[expect(dead_code, reason = "only its schema is used")]
        struct Other {
            /// A number.
            a: f32,
        }
        let layout = |schema: fn() -> Schema| {
            let codec = Features::WIRE.codec().copied().unwrap();
            Codec { schema, ..codec }.layout()
        };
        assert_eq!(layout(schema::<One>), layout(schema::<SameInOtherWords>));
        assert_ne!(layout(schema::<One>), layout(schema::<Other>));
    }

    #[test]
    fn a_rotation_that_is_none_is_refused() {
        let marks = serde_json::to_string(&Marks::default()).unwrap().replace("[0.0,0.0,0.0,1.0]", "[0.0,0.0,0.0,2.0]");
        let refused = serde_json::from_str::<Marks>(&marks).unwrap_err().to_string();
        assert!(refused.contains("found a rotation of length 2, expected a unit quaternion"), "{refused}");
    }

    #[test]
    fn a_message_of_another_type_is_not_written() {
        let codec = Features::WIRE.codec().copied().unwrap();
        assert!(codec.view(&Targets::default()).is_none());
    }
}
