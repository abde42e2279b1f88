//! A message as bytes: MessagePack, a map of `time`, `source`, `sequence`, `bulk` and `value`, in this order.
//!
//! `value` is what the message's contract shows to any serializer ([`Codec::view`]), `bulk` what lies beside it ([`Message::bulk`](foveate_messages::Message::bulk)).

use std::any::Any;
use std::sync::Arc;

use foveate_messages::{SourceId, Stamp, Time};
use foveate_node::guard::guarded;
use foveate_node::io::{Packet, Payload};
use foveate_node::port::MessageType;
use serde::Serialize;

const KEYS: [&str; 5] = ["time", "source", "sequence", "bulk", "value"];

/// Adds a message to `bytes`.
///
/// # Errors
/// Why its value cannot be written; `bytes` are as before then.
pub fn encode(message: &MessageType, packet: &Packet, bytes: &mut Vec<u8>) -> Result<(), String> {
    let start = bytes.len();
    let written = guarded(|| write(message, packet, bytes)).unwrap_or_else(Err);
    if written.is_err() {
        bytes.truncate(start);
    }
    written
}

fn write(message: &MessageType, packet: &Packet, bytes: &mut Vec<u8>) -> Result<(), String> {
    let codec = message.wire.codec().ok_or("it cannot leave its process")?;
    let any: &dyn Any = &*packet.payload;
    let value = codec.view(any).ok_or_else(|| format!("it is no `{}`", message.name))?;
    let bulk = packet.payload.bulk()?;
    bytes.reserve(bulk.len() + 256);
    let failed = |error: rmp::encode::ValueWriteError| error.to_string();
    rmp::encode::write_map_len(bytes, KEYS.len() as u32).map_err(failed)?;
    let Stamp { time, source, sequence } = packet.stamp;
    for key in KEYS {
        rmp::encode::write_str(bytes, key).map_err(failed)?;
        match key {
            "time" => drop(rmp::encode::write_sint(bytes, time.0).map_err(failed)?),
            "source" => drop(rmp::encode::write_uint(bytes, u64::from(source.0)).map_err(failed)?),
            "sequence" => drop(rmp::encode::write_uint(bytes, sequence).map_err(failed)?),
            "bulk" => rmp::encode::write_bin(bytes, bulk).map_err(failed)?,
            _ => {
                let mut serializer = rmp_serde::Serializer::new(&mut *bytes).with_struct_map();
                value.serialize(&mut serializer).map_err(|error| error.to_string())?;
            }
        }
    }
    Ok(())
}

/// Reads what [`encode`] wrote.
///
/// # Errors
/// What is not as the message's contract says.
pub fn decode(message: &MessageType, bytes: &[u8]) -> Result<Packet, String> {
    guarded(|| read(message, bytes)).unwrap_or_else(Err)
}

fn read(message: &MessageType, bytes: &[u8]) -> Result<Packet, String> {
    let codec = message.wire.codec().ok_or("it cannot leave its process")?;
    let mut rest = bytes;
    let failed = |key: &str| format!("`{key}` cannot be read");
    let n = rmp::decode::read_map_len(&mut rest).map_err(|_| "it is no map of MessagePack".to_owned())?;
    if n as usize != KEYS.len() {
        return Err(format!("it has {n} keys, expected {}", KEYS.len()));
    }
    let mut stamp = Stamp::default();
    let mut bulk = Vec::new();
    for key in KEYS {
        let length = rmp::decode::read_str_len(&mut rest).map_err(|_| failed(key))? as usize;
        let (name, after) = rest.split_at_checked(length).ok_or_else(|| failed(key))?;
        if name != key.as_bytes() {
            return Err(format!("found the key `{}`, expected `{key}`", String::from_utf8_lossy(name)));
        }
        rest = after;
        match key {
            "time" => stamp.time = Time(rmp::decode::read_int(&mut rest).map_err(|_| failed(key))?),
            "source" => stamp.source = SourceId(rmp::decode::read_int(&mut rest).map_err(|_| failed(key))?),
            "sequence" => stamp.sequence = rmp::decode::read_int(&mut rest).map_err(|_| failed(key))?,
            "bulk" => {
                let length = rmp::decode::read_bin_len(&mut rest).map_err(|_| failed(key))? as usize;
                let (bytes, after) = rest.split_at_checked(length).ok_or_else(|| failed(key))?;
                bulk = bytes.to_vec();
                rest = after;
            }
            _ => break,
        }
    }
    let mut from = rmp_serde::Deserializer::from_read_ref(rest);
    let value = codec.read(&mut <dyn erased_serde::Deserializer<'_>>::erase(&mut from), bulk);
    let value = value.map_err(|error| error.to_string())?;
    let payload: Arc<dyn Payload> = (message.share)(value).ok_or_else(|| format!("it is no `{}`", message.name))?;
    Ok(Packet { stamp, payload })
}
