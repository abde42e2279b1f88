//! For tests: a message taken apart by its schema, as a viewer does. A field that the schema does not have, or of another type, is a panic.

use std::collections::BTreeMap;

use super::Kind;
use super::schemas::{FieldKind, MessageType};
use super::wire::{Reader, Value};

/// Values by path, such as `entities[0].texts[1].text`.
pub(super) struct Decoded {
    leaves: BTreeMap<String, Leaf>,
    counts: BTreeMap<String, usize>,
}

#[derive(Debug)]
enum Leaf {
    Number(f64),
    Text(String),
    Bytes(Vec<u8>),
}

impl Decoded {
    /// Of a message of this kind.
    #[track_caller]
    pub(super) fn of(kind: Kind, bytes: &[u8]) -> Self {
        let mut decoded = Self { leaves: BTreeMap::new(), counts: BTreeMap::new() };
        decoded.add("", kind.message_type(), bytes);
        decoded
    }

    /// A number of any type.
    #[track_caller]
    pub(super) fn number(&self, path: &str) -> f64 {
        match self.leaves.get(path) {
            Some(Leaf::Number(it)) => *it,
            other => panic!("{path} is {other:?}"),
        }
    }

    /// A string.
    #[track_caller]
    pub(super) fn text(&self, path: &str) -> &str {
        match self.leaves.get(path) {
            Some(Leaf::Text(it)) => it,
            other => panic!("{path} is {other:?}"),
        }
    }

    /// Bytes.
    #[track_caller]
    pub(super) fn bytes(&self, path: &str) -> &[u8] {
        match self.leaves.get(path) {
            Some(Leaf::Bytes(it)) => it,
            other => panic!("{path} is {other:?}"),
        }
    }

    /// How many values a repeated field has.
    pub(super) fn count(&self, path: &str) -> usize {
        self.counts.get(path).copied().unwrap_or(0)
    }

    /// The numbers of a repeated field.
    #[track_caller]
    pub(super) fn numbers(&self, path: &str) -> Vec<f64> {
        (0..self.count(path)).map(|it| self.number(&format!("{path}[{it}]"))).collect()
    }

    fn add(&mut self, above: &str, message: &MessageType, bytes: &[u8]) {
        for field in Reader::new(bytes) {
            let (number, value) = field.unwrap();
            let field = message.fields.iter().find(|it| it.number == number);
            let field = field.unwrap_or_else(|| panic!("{} has no field {number}", message.name));
            let path = format!("{above}{}", field.plain_name());
            let packed = match (&value, field.kind) {
                (Value::Bytes(range), FieldKind::Double) => bytes[range.clone()].chunks_exact(8).map(double).collect(),
                (Value::Bytes(range), FieldKind::Fixed32) => bytes[range.clone()].chunks_exact(4).map(fixed).collect(),
                _ => Vec::new(),
            };
            if packed.is_empty() {
                let place = self.next(&path, field.repeated);
                self.add_value(place, field.kind, value, bytes);
            }
            for value in packed {
                let place = self.next(&path, true);
                self.leaves.insert(place, Leaf::Number(value));
            }
        }
    }

    fn next(&mut self, path: &str, repeated: bool) -> String {
        let count = self.counts.entry(path.to_owned()).or_default();
        *count += 1;
        assert!(repeated || *count == 1, "{path} is there twice");
        if repeated { format!("{path}[{}]", *count - 1) } else { path.to_owned() }
    }

    fn add_value(&mut self, path: String, kind: FieldKind, value: Value, bytes: &[u8]) {
        let leaf = match (kind, value) {
            (FieldKind::Double, Value::Fixed64(it)) => Leaf::Number(f64::from_bits(it)),
            (FieldKind::Fixed64, Value::Fixed64(it)) => Leaf::Number(it as f64),
            (FieldKind::Sfixed64, Value::Fixed64(it)) => Leaf::Number(it as i64 as f64),
            (FieldKind::Fixed32, Value::Fixed32(it)) => Leaf::Number(it.into()),
            (FieldKind::Int64 | FieldKind::Int32, Value::Varint(it)) => Leaf::Number(it as i64 as f64),
            (FieldKind::Bool | FieldKind::Enum(_), Value::Varint(it)) => Leaf::Number(it as f64),
            (FieldKind::String, Value::Bytes(it)) => Leaf::Text(String::from_utf8(bytes[it].to_vec()).unwrap()),
            (FieldKind::Bytes, Value::Bytes(it)) => Leaf::Bytes(bytes[it].to_vec()),
            (FieldKind::Message(of), Value::Bytes(it)) => return self.add(&format!("{path}."), of, &bytes[it]),
            (_, value) => panic!("{path} is {value:?}"),
        };
        self.leaves.insert(path, leaf);
    }
}

fn double(bytes: &[u8]) -> f64 {
    f64::from_le_bytes(bytes.try_into().unwrap())
}

fn fixed(bytes: &[u8]) -> f64 {
    u32::from_le_bytes(bytes.try_into().unwrap()).into()
}
