//! Messages on another clock: every time in them moves by the same amount.
//!
//! Which numbers are times, the schemas say: `$defs/Time` in the JSON Schema of a message of ours, `google.protobuf.Timestamp` in what viewers read.

use foveate_messages::Interval;
use rmp::Marker;
use rmp::encode::ValueWriteError;
use serde_json::Value;

/// Messages lie at most so deep in each other.
const DEEPEST: usize = 64;
/// What a reference to a time is.
const TIME: &str = "#/$defs/Time";

/// A message as [`body`](crate::body) writes it, all times in it later by `by`; `schema` is its JSON Schema.
///
/// # Errors
/// What is no MessagePack.
pub fn message(schema: &Value, bytes: &[u8], by: Interval) -> Result<Vec<u8>, String> {
    let mut shift = Shift { root: schema, rest: bytes, out: Vec::with_capacity(bytes.len() + 8), by };
    let length = shift.length()?;
    for _ in 0..length {
        let key = shift.text()?;
        match key.as_deref() {
            Some("time") => shift.value(&[], true, 0)?,
            Some("value") => shift.value(&[schema], false, 0)?,
            _ => shift.value(&[], false, 0)?,
        }
    }
    Ok(shift.out)
}

struct Shift<'b> {
    root: &'b Value,
    rest: &'b [u8],
    out: Vec<u8>,
    by: Interval,
}

fn broken<E>(_: E) -> String {
    "it is no whole MessagePack".to_owned()
}

impl<'b> Shift<'b> {
    /// Copies `count` bytes.
    fn copy(&mut self, count: usize) -> Result<&'b [u8], String> {
        let (copied, rest) = self.rest.split_at_checked(count).ok_or_else(|| broken(()))?;
        self.out.extend_from_slice(copied);
        self.rest = rest;
        Ok(copied)
    }

    /// Copies what `read` reads.
    fn copied<T, E>(&mut self, read: impl FnOnce(&mut &'b [u8]) -> Result<T, E>) -> Result<T, String> {
        let mut rest = self.rest;
        let read = read(&mut rest).map_err(broken)?;
        self.copy(self.rest.len() - rest.len())?;
        Ok(read)
    }

    fn length(&mut self) -> Result<u32, String> {
        self.copied(rmp::decode::read_map_len)
    }

    /// Copies a text, if it is one; a key of another kind is copied too.
    fn text(&mut self) -> Result<Option<String>, String> {
        let mut rest = self.rest;
        match rmp::decode::read_str_len(&mut rest) {
            Ok(length) => {
                self.copy(self.rest.len() - rest.len())?;
                Ok(Some(String::from_utf8_lossy(self.copy(length as usize)?).into_owned()))
            }
            Err(_) => self.value(&[], false, 0).map(|()| None),
        }
    }

    /// Copies a value that has one of these schemas, and moves the times in it.
    fn value(&mut self, schemas: &[&'b Value], is_time: bool, depth: usize) -> Result<(), String> {
        if depth > DEEPEST {
            return Err(format!("its values lie more than {DEEPEST} deep in each other"));
        }
        let (mut meant, mut is_time) = (Vec::new(), is_time);
        schemas.iter().for_each(|it| self.resolve(it, &mut meant, &mut is_time, 0));
        let marker = Marker::from_u8(*self.rest.first().ok_or_else(|| broken(()))?);
        match marker {
            Marker::FixPos(_)
            | Marker::FixNeg(_)
            | Marker::U8
            | Marker::U16
            | Marker::U32
            | Marker::U64
            | Marker::I8
            | Marker::I16
            | Marker::I32
            | Marker::I64
                if is_time =>
            {
                let time: i64 = rmp::decode::read_int(&mut self.rest).map_err(broken)?;
                let moved = time.saturating_add(self.by.0);
                let written: Result<Marker, ValueWriteError> = rmp::encode::write_sint(&mut self.out, moved);
                written.map(drop).map_err(|error| error.to_string())
            }
            Marker::FixArray(_) | Marker::Array16 | Marker::Array32 => {
                let length = self.copied(rmp::decode::read_array_len)?;
                for place in 0..length as usize {
                    let inner: Vec<&Value> = meant
                        .iter()
                        .filter_map(|it| it.get("prefixItems").and_then(|it| it.get(place)).or_else(|| it.get("items")))
                        .collect();
                    self.value(&inner, false, depth + 1)?;
                }
                Ok(())
            }
            Marker::FixMap(_) | Marker::Map16 | Marker::Map32 => {
                for _ in 0..self.length()? {
                    let key = self.text()?.unwrap_or_default();
                    let named = |it: &&'b Value| it.get("properties").and_then(|it| it.get(&key));
                    let inner: Vec<&Value> =
                        meant.iter().filter_map(|it| named(it).or_else(|| it.get("additionalProperties"))).collect();
                    self.value(&inner, false, depth + 1)?;
                }
                Ok(())
            }
            other => self.plain(other),
        }
    }

    /// Copies a value that holds no others.
    fn plain(&mut self, marker: Marker) -> Result<(), String> {
        let head = |count: usize| -> Result<usize, String> {
            let bytes = self.rest.get(1..=count).ok_or_else(|| broken(()))?;
            Ok(bytes.iter().fold(0, |sum, it| (sum << 8) | usize::from(*it)))
        };
        let length = match marker {
            Marker::FixPos(_) | Marker::FixNeg(_) | Marker::Null | Marker::True | Marker::False => 1,
            Marker::U8 | Marker::I8 => 2,
            Marker::U16 | Marker::I16 => 3,
            Marker::U32 | Marker::I32 | Marker::F32 => 5,
            Marker::U64 | Marker::I64 | Marker::F64 => 9,
            Marker::FixStr(length) => 1 + usize::from(length),
            Marker::Str8 | Marker::Bin8 => 2 + head(1)?,
            Marker::Str16 | Marker::Bin16 => 3 + head(2)?,
            Marker::Str32 | Marker::Bin32 => 5 + head(4)?,
            _ => return Err(format!("found {marker:?}, which no message of ours has")),
        };
        self.copy(length).map(drop)
    }

    /// What a schema means: references followed, alternatives side by side.
    fn resolve(&self, schema: &'b Value, meant: &mut Vec<&'b Value>, is_time: &mut bool, depth: usize) {
        if depth > DEEPEST {
            return;
        }
        if let Some(reference) = schema.get("$ref").and_then(Value::as_str) {
            *is_time |= reference == TIME;
            let target = reference.strip_prefix('#').and_then(|it| self.root.pointer(it));
            target.into_iter().for_each(|it| self.resolve(it, meant, is_time, depth + 1));
        }
        for key in ["anyOf", "oneOf", "allOf"] {
            let all = schema.get(key).and_then(Value::as_array).into_iter().flatten();
            all.for_each(|it| self.resolve(it, meant, is_time, depth + 1));
        }
        meant.push(schema);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_messages::{CameraId, HeadEvent, HeadLink, HeadPosition, HeadReport, SourceId, Stamp, Targets, Time};
    use foveate_node::io::Packet;
    use foveate_node::port::MessageType;

    use super::*;
    use crate::body;

    const BY: Interval = Interval(-3_000_000_000);

    fn shifted<M: foveate_messages::Message + Clone>(message: &M) -> (M, Time) {
        let kind = MessageType::of::<M>();
        let stamp = Stamp { time: Time(5_000_000_123), source: SourceId(7), sequence: 300 };
        let mut bytes = Vec::new();
        body::encode(&kind, &Packet { stamp, payload: Arc::new(message.clone()) }, &mut bytes).unwrap();
        let schema = serde_json::to_value(kind.wire.codec().unwrap().schema()).unwrap();
        let packet = body::decode(&kind, &super::message(&schema, &bytes, BY).unwrap()).unwrap();
        assert_eq!((packet.stamp.source, packet.stamp.sequence), (stamp.source, stamp.sequence));
        (packet.as_typed::<M>().unwrap().clone(), packet.stamp.time)
    }

    #[test]
    fn times_move_wherever_they_lie_and_nothing_else_does() {
        let position = |at: i64| HeadPosition { earliest: Time(at), latest: Time(at + 7), angles: [0.25, f64::NAN] };
        let report = |at: i64| HeadReport {
            camera: CameraId(3),
            link: HeadLink::Ready,
            first: 5_000_000_000,
            events: vec![(Time(at), HeadEvent::Arrived), (Time(at + 1), HeadEvent::Position(position(at)))],
        };
        let (found, stamp) = shifted(&report(9_000_000_000));
        assert_eq!(stamp, Time(2_000_000_123));
        assert_eq!(format!("{found:?}"), format!("{:?}", report(6_000_000_000)));
    }

    #[test]
    fn what_breaks_off_is_an_error() {
        let kind = MessageType::of::<Targets>();
        let mut bytes = Vec::new();
        let packet = Packet { stamp: Stamp::default(), payload: Arc::new(Targets::default()) };
        body::encode(&kind, &packet, &mut bytes).unwrap();
        let schema = serde_json::to_value(kind.wire.codec().unwrap().schema()).unwrap();
        for length in 0..bytes.len() {
            assert!(message(&schema, &bytes[..length], BY).is_err(), "{length}");
        }
        let deep = [&[0x81, 0xa5][..], b"value", &[0x91; 100_000]].concat();
        assert!(message(&schema, &deep, BY).is_err());
    }
}
