//! What viewers read, on another clock.

use foveate_messages::{Interval, Time};

use super::Kind;
use super::schemas::{FieldKind, MessageType, picture, timestamp};
use super::wire::{Reader, Value, Writer};

const NANOSECONDS: i64 = 1_000_000_000;

/// A message of the schema of that name in place of what is in `out`, all times in it later by `by`.
///
/// # Errors
/// That it is no such message, or of a schema that is not ours.
pub fn shifted(schema: &str, bytes: &[u8], by: Interval, out: &mut Vec<u8>) -> Result<(), String> {
    let kind = Kind::ALL.iter().find(|it| it.name() == schema);
    let kind = kind.ok_or_else(|| format!("`{schema}` is no schema of ours"))?;
    let mut writer = Writer::new(out);
    writer.reserve(bytes.len() + 16);
    write(kind.message_type(), bytes, by, &mut writer)
}

fn write(message: &'static MessageType, bytes: &[u8], by: Interval, writer: &mut Writer<'_>) -> Result<(), String> {
    let is_picture = std::ptr::eq(message, &picture::TYPE);
    for field in Reader::new(bytes) {
        let (number, value) = field?;
        let of = message.fields.iter().find(|it| it.number == number).map(|it| it.kind);
        match (value, of) {
            (Value::Bytes(range), Some(FieldKind::Message(of))) if std::ptr::eq(of, &timestamp::TYPE) => {
                writer.time(number, read_time(&bytes[range])? + by);
            }
            (Value::Bytes(range), Some(FieldKind::Message(of))) => {
                let mut result = Ok(());
                writer.message(number, |it| result = write(of, &bytes[range], by, it));
                result?;
            }
            (Value::Fixed64(time), _) if is_picture && number == picture::time => {
                writer.fixed64(number, (Time(time as i64) + by).0 as u64);
            }
            (Value::Bytes(range), _) => writer.bytes(number, &bytes[range]),
            (Value::Varint(it), _) => writer.varint(number, it),
            (Value::Fixed64(it), _) => writer.fixed64(number, it),
            (Value::Fixed32(it), _) => writer.fixed32(number, it),
        }
    }
    Ok(())
}

fn read_time(bytes: &[u8]) -> Result<Time, String> {
    let (mut seconds, mut nanos) = (0_i64, 0_i64);
    for field in Reader::new(bytes) {
        match field? {
            (timestamp::seconds, Value::Varint(it)) => seconds = it as i64,
            (timestamp::nanos, Value::Varint(it)) => nanos = it as i64,
            _ => {}
        }
    }
    Ok(Time(seconds.saturating_mul(NANOSECONDS).saturating_add(nanos)))
}

#[cfg(test)]
mod tests {
    use foveate_messages::{Image, SourceId, Stamp, Targets};

    use super::super::decoded::Decoded;
    use super::super::{raw_image, read_raw_image, targets_cloud, targets_scene};
    use super::*;

    const BY: Interval = Interval(1_500_000_000);

    #[test]
    fn a_picture_comes_back_later_and_the_same() {
        let image = Image { width: 3, height: 2, pixels: vec![1, 2, 3, 4, 5, 200], ..Image::default() };
        let stamp = Stamp { time: Time(-700_000_000), source: SourceId(4), sequence: 9 };
        let (mut bytes, mut out) = (Vec::new(), vec![1]);
        raw_image(&stamp, &image, "a", &mut bytes);
        shifted(Kind::RawImage.name(), &bytes, BY, &mut out).unwrap();
        let read = read_raw_image(&out).unwrap();
        assert_eq!(read.stamp, Stamp { time: Time(800_000_000), ..stamp });
        assert_eq!(&out[read.content.clone()], &image.pixels);
        let decoded = Decoded::of(Kind::RawImage, &out);
        assert_eq!((decoded.number("timestamp.seconds"), decoded.number("timestamp.nanos")), (0.0, 800_000_000.0));
        assert!(shifted(Kind::RawImage.name(), &bytes[..bytes.len() - 1], BY, &mut out).is_err());
    }

    #[test]
    fn clouds_and_scenes_move_in_time_alone() {
        let targets = |time: i64| Targets { time: Time(time), ..Targets::default() };
        let (mut bytes, mut expected, mut out) = (Vec::new(), Vec::new(), Vec::new());
        targets_cloud(&targets(2_000_000_000), "room", &mut bytes);
        targets_cloud(&targets(3_500_000_000), "room", &mut expected);
        shifted(Kind::PointCloud.name(), &bytes, BY, &mut out).unwrap();
        assert_eq!(out, expected);
        targets_scene(&targets(2_000_000_000), "room", "a", &mut bytes);
        targets_scene(&targets(3_500_000_000), "room", "a", &mut expected);
        shifted(Kind::SceneUpdate.name(), &bytes, BY, &mut out).unwrap();
        assert_eq!(out, expected);
    }
}
