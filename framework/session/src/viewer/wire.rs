//! The wire format of Protocol Buffers: fields one after the other, each with its number and a wire type.
//!
//! Source: <https://protobuf.dev/programming-guides/encoding/>. Groups (wire types 3 and 4) are not read: nothing here writes them.

use std::ops::Range;

use foveate_messages::Time;

use super::schemas::timestamp;

const VARINT: u8 = 0;
const FIXED64: u8 = 1;
const BYTES: u8 = 2;
const FIXED32: u8 = 5;
const NANOSECONDS: i64 = 1_000_000_000;

/// Appends the fields of one message to a buffer. Fields are named by the constants of [`super::schemas`].
pub(super) struct Writer<'b>(&'b mut Vec<u8>);

impl<'b> Writer<'b> {
    /// Of a message of its own: replaces what is in `out` and keeps its memory.
    pub(super) fn new(out: &'b mut Vec<u8>) -> Self {
        out.clear();
        Self(out)
    }

    /// Makes room for `bytes` more.
    pub(super) fn reserve(&mut self, bytes: usize) {
        self.0.reserve(bytes);
    }

    fn number(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    fn tag(&mut self, field: u32, wire_type: u8) {
        self.number(u64::from(field) << 3 | u64::from(wire_type));
    }

    /// A bool, an enum value, or an integer without a fixed size; a negative one as its two's complement of 64 bits.
    pub(super) fn varint(&mut self, field: u32, value: u64) {
        self.tag(field, VARINT);
        self.number(value);
    }

    /// Four bytes.
    pub(super) fn fixed32(&mut self, field: u32, value: u32) {
        self.tag(field, FIXED32);
        self.0.extend(value.to_le_bytes());
    }

    /// Eight bytes.
    pub(super) fn fixed64(&mut self, field: u32, value: u64) {
        self.tag(field, FIXED64);
        self.0.extend(value.to_le_bytes());
    }

    /// A number of double precision.
    pub(super) fn double(&mut self, field: u32, value: f64) {
        self.fixed64(field, value.to_bits());
    }

    /// Bytes, in one copy.
    pub(super) fn bytes(&mut self, field: u32, value: &[u8]) {
        self.tag(field, BYTES);
        self.number(value.len() as u64);
        self.0.extend_from_slice(value);
    }

    /// Text.
    pub(super) fn string(&mut self, field: u32, value: &str) {
        self.bytes(field, value.as_bytes());
    }

    /// A message within this one, or anything else that follows its own length.
    pub(super) fn message(&mut self, field: u32, fill: impl FnOnce(&mut Writer<'_>)) {
        self.tag(field, BYTES);
        let start = self.0.len() + 1;
        self.0.push(0);
        fill(&mut Writer(self.0));
        let end = self.0.len();
        let length = end - start;
        // A length takes a byte for each 7 bits; beyond the one that was left for it, the content moves.
        let extra = (length as u64).max(1).ilog2() as usize / 7;
        self.0.resize(end + extra, 0);
        self.0.copy_within(start..end, start + extra);
        for place in 0..=extra {
            let more = if place < extra { 0x80 } else { 0 };
            self.0[start - 1 + place] = (length >> (7 * place)) as u8 & 0x7f | more;
        }
    }

    /// Numbers without a tag for each.
    pub(super) fn doubles(&mut self, field: u32, values: impl IntoIterator<Item = f64>) {
        self.message(field, |it| values.into_iter().for_each(|value| it.0.extend(value.to_le_bytes())));
    }

    /// Numbers without a tag for each.
    pub(super) fn fixed32s(&mut self, field: u32, values: impl IntoIterator<Item = u32>) {
        self.message(field, |it| values.into_iter().for_each(|value| it.0.extend(value.to_le_bytes())));
    }

    /// Bytes that `fill` appends.
    pub(super) fn bytes_of(&mut self, field: u32, fill: impl FnOnce(&mut Vec<u8>)) {
        self.message(field, |it| fill(it.0));
    }

    /// A `google.protobuf.Timestamp`: whole seconds towards the past, and the nanoseconds since then.
    pub(super) fn time(&mut self, field: u32, time: Time) {
        self.message(field, |it| {
            it.varint(timestamp::seconds, time.0.div_euclid(NANOSECONDS) as u64);
            it.varint(timestamp::nanos, time.0.rem_euclid(NANOSECONDS) as u64);
        });
    }
}

/// A field's value as it lies in a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Value {
    /// An integer of up to 64 bits.
    Varint(u64),
    /// Eight bytes.
    Fixed64(u64),
    /// Four bytes.
    Fixed32(u32),
    /// Where text, bytes, a message or packed numbers lie.
    Bytes(Range<usize>),
}

/// The fields of a message in the order in which they lie there, each with its number. Ends after the first error.
pub(super) struct Reader<'b> {
    bytes: &'b [u8],
    at: usize,
}

impl<'b> Reader<'b> {
    /// Of all of `bytes`.
    pub(super) fn new(bytes: &'b [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    fn take(&mut self, length: usize) -> Option<Range<usize>> {
        let end = self.at.checked_add(length).filter(|end| *end <= self.bytes.len())?;
        Some(std::mem::replace(&mut self.at, end)..end)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let range = self.take(N)?;
        self.bytes[range].try_into().ok()
    }

    fn number(&mut self) -> Option<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let [byte] = self.array()?;
            let part = u64::from(byte & 0x7f);
            if part << shift >> shift != part {
                return None;
            }
            value |= part << shift;
            if byte < 0x80 {
                return Some(value);
            }
        }
        None
    }

    fn field(&mut self) -> Option<(u32, Value)> {
        let tag = self.number()?;
        let field = u32::try_from(tag >> 3).ok().filter(|it| *it > 0)?;
        let value = match (tag & 7) as u8 {
            VARINT => Value::Varint(self.number()?),
            FIXED64 => Value::Fixed64(u64::from_le_bytes(self.array()?)),
            FIXED32 => Value::Fixed32(u32::from_le_bytes(self.array()?)),
            BYTES => {
                let length = usize::try_from(self.number()?).ok()?;
                Value::Bytes(self.take(length)?)
            }
            _ => return None,
        };
        Some((field, value))
    }
}

impl Iterator for Reader<'_> {
    type Item = Result<(u32, Value), String>;

    fn next(&mut self) -> Option<Self::Item> {
        let start = self.at;
        if start >= self.bytes.len() {
            return None;
        }
        Some(self.field().ok_or_else(|| {
            self.at = self.bytes.len();
            format!("no whole field at byte {start} of {}", self.bytes.len())
        }))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn written(fill: impl FnOnce(&mut Writer<'_>)) -> Vec<u8> {
        let mut out = vec![9; 3];
        fill(&mut Writer::new(&mut out));
        out
    }

    #[test]
    fn fields_lie_as_the_examples_of_the_format_say() {
        assert_eq!(written(|it| it.varint(1, 150)), [0x08, 0x96, 0x01]);
        assert_eq!(written(|it| it.string(2, "testing")), *b"\x12\x07testing");
        assert_eq!(written(|it| it.message(3, |it| it.varint(1, 150))), [0x1a, 0x03, 0x08, 0x96, 0x01]);
        assert_eq!(written(|it| it.fixed32(5, 0x0102)), [0x2d, 2, 1, 0, 0]);
        assert_eq!(written(|it| it.double(2, 1.0)), [0x11, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f]);
        assert_eq!(written(|it| it.fixed32s(4, [1, 2])), [0x22, 8, 1, 0, 0, 0, 2, 0, 0, 0]);
        // 1000 << 3 | 1 = 8001 = 62 · 128 + 65.
        assert_eq!(written(|it| it.fixed64(1000, 7)), [0xc1, 62, 7, 0, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn a_time_before_the_start_has_nanoseconds_that_count_forward() {
        let bytes = written(|it| it.time(1, Time(-1)));
        let fields: Vec<_> = Reader::new(&bytes[2..]).map(Result::unwrap).collect();
        assert_eq!(fields, [(1, Value::Varint(-1_i64 as u64)), (2, Value::Varint(999_999_999))]);
    }

    #[test]
    fn what_is_no_field_is_refused_once() {
        let endless = [0xff; 11];
        let too_long = [0x0a, 5, 1, 2];
        let huge = [0x0a, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01];
        let group = [0x0b];
        let unnumbered = [0x00, 0x00];
        for bytes in [&endless[..], &too_long, &huge, &group, &unnumbered] {
            let mut reader = Reader::new(bytes);
            assert!(reader.next().unwrap().unwrap_err().contains("byte 0"), "{bytes:?}");
            assert!(reader.next().is_none());
        }
    }

    proptest! {
        #[test]
        fn messages_of_any_length_and_numbers_of_any_size_come_back(
            length in 0_usize..40_000, number in any::<u64>(), field in 1_u32..0x1fff_ffff,
        ) {
            let content = vec![7; length];
            let bytes = written(|it| {
                it.message(field, |it| it.message(3, |it| it.bytes(1, &content)));
                it.varint(field, number);
            });
            let fields: Vec<_> = Reader::new(&bytes).map(Result::unwrap).collect();
            prop_assert_eq!(&fields[1], &(field, Value::Varint(number)));
            let mut range = 0..bytes.len();
            for expected in [field, 3, 1] {
                let inner = Reader::new(&bytes[range.clone()]).next().unwrap().unwrap();
                let (found, Value::Bytes(within)) = inner else { panic!("{inner:?}") };
                prop_assert_eq!(found, expected);
                range = range.start + within.start..range.start + within.end;
            }
            prop_assert_eq!(&bytes[range], &content[..]);
        }
    }
}
