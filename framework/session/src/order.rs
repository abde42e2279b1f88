//! The order of delivery as bytes: a batch of events, each a kind and a few numbers.
//!
//! All numbers are LEB128; those with a sign are zigzagged. An event begins with its kind, the difference of its order to that of the event before it in the batch, and the
//! difference of its time. `docs/sessions.md` has the table of kinds.

use foveate_engine::tap::{Activation, Entry, Event, Fate};
use foveate_messages::{SourceId, Stamp, Time};
use foveate_node::error::{Blame, NodeError};
use foveate_node::io::Gap;
use foveate_node::report::Report;
use foveate_rig::live;
use serde_json::{Value, json};

const MESSAGE: u8 = 0;
const FLUSH: u8 = 1;
const DUE: u8 = 2;
const EMITTED: u8 = 3;
const EMITTED_KEPT: u8 = 4;
const GAP: u8 = 5;
const GAP_ENTERED: u8 = 6;
const PUT: u8 = 7;
const PUT_BOUNDED: u8 = 8;
const SUSPENDED: u8 = 9;
const STOPPED: u8 = 10;
const LOST: u8 = 11;
const FAILED: u8 = 12;
const ENDING: u8 = 13;
const FINISHED: u8 = 14;
const ENDED: u8 = 15;
const CHANGED: u8 = 16;

/// What a recorder may find written about a failure: the engine's own words.
const ACTIONS: [&str; 5] = ["stopped", "message skipped", "stopped after five failed restarts", "restarted", "failed"];

/// Writes batches.
#[derive(Default)]
pub struct Encoder {
    order: u64,
    now: i64,
}

impl Encoder {
    /// Adds an event to the batch `bytes`.
    pub fn add(&mut self, entry: &Entry, bytes: &mut Vec<u8>) {
        let head = |bytes: &mut Vec<u8>, kind: u8, it: &Encoder| {
            bytes.push(kind);
            signed(bytes, entry.order.wrapping_sub(it.order) as i64);
            signed(bytes, entry.now.0.wrapping_sub(it.now));
        };
        let mut put = |kind: u8, numbers: &[u64]| {
            head(bytes, kind, self);
            numbers.iter().for_each(|&it| unsigned(bytes, it));
        };
        match &entry.event {
            Event::Activated { instance, how } => {
                let kind = match how {
                    Activation::Message => MESSAGE,
                    Activation::Flush => FLUSH,
                    Activation::Due => DUE,
                };
                put(kind, &[*instance as u64]);
            }
            Event::Emitted { instance, port, stamp, is_kept, .. } => {
                put(if *is_kept { EMITTED_KEPT } else { EMITTED }, &[*instance as u64, *port as u64]);
                signed(bytes, stamp.time.0.wrapping_sub(entry.now.0));
                unsigned(bytes, u64::from(stamp.source.0));
                unsigned(bytes, stamp.sequence);
            }
            Event::Gap { instance, port, gap } => {
                put(GAP, &[*instance as u64, *port as u64]);
                signed(bytes, gap.time.0);
                text(bytes, &gap.reason);
            }
            Event::GapEntered { edge } => put(GAP_ENTERED, &[*edge as u64]),
            Event::Delivered { edge, number, fate } => {
                let kind = match fate {
                    Fate::Put => PUT,
                    Fate::PutBounded => PUT_BOUNDED,
                    Fate::Suspended => SUSPENDED,
                    Fate::Stopped => STOPPED,
                };
                put(kind, &[*edge as u64, *number]);
            }
            Event::Lost { edge, first, count } => put(LOST, &[*edge as u64, *first, *count]),
            Event::Failed { instance, seen, error, action } => {
                put(FAILED, &[*instance as u64, u64::from(error.blame == Blame::Program)]);
                signed(bytes, seen.0);
                text(bytes, &error.message);
                text(bytes, action);
            }
            Event::Changed { instance, values } => {
                put(CHANGED, &[*instance as u64]);
                // What the node took can be written.
                text(bytes, &live::in_toml(values).unwrap_or_default());
            }
            Event::Ending => put(ENDING, &[]),
            Event::Finished { instance, report, error } => {
                let blame = error.as_ref().map_or(0, |it| 1 + u64::from(it.blame == Blame::Program));
                put(FINISHED, &[*instance as u64, blame]);
                text(bytes, error.as_ref().map_or("", |it| it.message.as_str()));
                text(bytes, &report_text(report));
            }
            Event::Ended { interrupted, is_cut_short } => {
                put(ENDED, &[u64::from(*interrupted), u64::from(*is_cut_short)]);
            }
        }
        (self.order, self.now) = (entry.order, entry.now.0);
    }
}

/// Reads a batch.
///
/// # Errors
/// What is no event, and where.
pub fn decode(bytes: &[u8]) -> Result<Vec<Entry>, String> {
    let mut from = Reader { rest: bytes };
    let (mut order, mut now) = (0_u64, 0_i64);
    let mut entries = Vec::new();
    while !from.rest.is_empty() {
        let at = bytes.len() - from.rest.len();
        let entry = from.entry(&mut order, &mut now);
        entries.push(entry.ok_or_else(|| format!("byte {at} of a batch of events begins no event"))?);
    }
    Ok(entries)
}

struct Reader<'b> {
    rest: &'b [u8],
}

impl Reader<'_> {
    fn entry(&mut self, order: &mut u64, now: &mut i64) -> Option<Entry> {
        let kind = self.byte()?;
        *order = order.wrapping_add(self.signed()? as u64);
        *now = now.wrapping_add(self.signed()?);
        let event = match kind {
            MESSAGE => Event::Activated { instance: self.index()?, how: Activation::Message },
            FLUSH => Event::Activated { instance: self.index()?, how: Activation::Flush },
            DUE => Event::Activated { instance: self.index()?, how: Activation::Due },
            EMITTED | EMITTED_KEPT => Event::Emitted {
                instance: self.index()?,
                port: self.index()?,
                stamp: Stamp {
                    time: Time(now.wrapping_add(self.signed()?)),
                    source: SourceId(u32::try_from(self.unsigned()?).ok()?),
                    sequence: self.unsigned()?,
                },
                is_kept: kind == EMITTED_KEPT,
                packet: None,
            },
            GAP => Event::Gap {
                instance: self.index()?,
                port: self.index()?,
                gap: Gap { time: Time(self.signed()?), reason: self.text()? },
            },
            GAP_ENTERED => Event::GapEntered { edge: self.index()? },
            PUT | PUT_BOUNDED | SUSPENDED | STOPPED => Event::Delivered {
                edge: self.index()?,
                number: self.unsigned()?,
                fate: match kind {
                    PUT => Fate::Put,
                    PUT_BOUNDED => Fate::PutBounded,
                    SUSPENDED => Fate::Suspended,
                    _ => Fate::Stopped,
                },
            },
            LOST => Event::Lost { edge: self.index()?, first: self.unsigned()?, count: self.unsigned()? },
            FAILED => {
                let (instance, is_program) = (self.index()?, self.unsigned()? == 1);
                let (seen, message, action) = (Time(self.signed()?), self.text()?, self.text()?);
                let action = ACTIONS.iter().find(|it| **it == action).unwrap_or(&ACTIONS[4]);
                Event::Failed { instance, seen, error: error(is_program, message), action }
            }
            CHANGED => Event::Changed { instance: self.index()?, values: live::from_toml(&self.text()?).ok()? },
            ENDING => Event::Ending,
            FINISHED => {
                let (instance, blame, message) = (self.index()?, self.unsigned()?, self.text()?);
                let report = Box::new(report(&self.text()?)?);
                let error = (blame > 0).then(|| error(blame == 2, message));
                Event::Finished { instance, report, error }
            }
            ENDED => Event::Ended { interrupted: self.unsigned()? == 1, is_cut_short: self.unsigned()? == 1 },
            _ => return None,
        };
        Some(Entry { order: *order, now: Time(*now), event })
    }

    fn byte(&mut self) -> Option<u8> {
        let (&first, rest) = self.rest.split_first()?;
        self.rest = rest;
        Some(first)
    }

    fn unsigned(&mut self) -> Option<u64> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Some(value);
            }
        }
        None
    }

    fn index(&mut self) -> Option<usize> {
        usize::try_from(self.unsigned()?).ok()
    }

    fn signed(&mut self) -> Option<i64> {
        let value = self.unsigned()?;
        Some((value >> 1) as i64 ^ -((value & 1) as i64))
    }

    fn text(&mut self) -> Option<String> {
        let length = self.index()?;
        let (text, rest) = self.rest.split_at_checked(length)?;
        self.rest = rest;
        String::from_utf8(text.to_vec()).ok()
    }
}

fn unsigned(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

fn signed(bytes: &mut Vec<u8>, value: i64) {
    unsigned(bytes, ((value << 1) ^ (value >> 63)) as u64);
}

fn text(bytes: &mut Vec<u8>, text: &str) {
    unsigned(bytes, text.len() as u64);
    bytes.extend_from_slice(text.as_bytes());
}

fn error(is_program: bool, message: String) -> NodeError {
    NodeError { blame: if is_program { Blame::Program } else { Blame::Input }, message }
}

/// What a node reported, without the files: figures by name, as bits so that none is rounded, and sentences.
fn report_text(report: &Report) -> String {
    let figures = report.figures.iter().map(|(name, value)| (name.clone(), Value::from(value.to_bits())));
    json!({ "figures": figures.collect::<serde_json::Map<_, _>>(), "remarks": report.remarks }).to_string()
}

fn report(text: &str) -> Option<Report> {
    let value: Value = serde_json::from_str(text).ok()?;
    let mut report = Report::default();
    for (name, bits) in value.get("figures")?.as_object()? {
        report.figure(name.clone(), f64::from_bits(bits.as_u64()?));
    }
    for it in value.get("remarks")?.as_array()? {
        report.remarks.push(it.as_str()?.to_owned());
    }
    Some(report)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn events() -> Vec<Event> {
        let stamp = Stamp { time: Time(-5), source: SourceId(7), sequence: u64::MAX };
        let mut report = Report::default();
        report.figure("error_mm", 0.1);
        report.figure("nothing", f64::NAN);
        report.remark("a note");
        let failure = NodeError { blame: Blame::Program, message: "broke".to_owned() };
        let mut all = vec![
            Event::Emitted { instance: 300, port: 1, stamp, is_kept: true, packet: None },
            Event::Emitted { instance: 0, port: 0, stamp, is_kept: false, packet: None },
            Event::Gap { instance: 1, port: 0, gap: Gap { time: Time(9), reason: "lost \u{b5}".to_owned() } },
            Event::GapEntered { edge: 129 },
            Event::Lost { edge: 1, first: 5, count: 2 },
            Event::Failed { instance: 3, seen: Time(i64::MIN), error: failure.clone(), action: "restarted" },
            Event::Ending,
            Event::Finished { instance: 2, report: Box::new(report), error: Some(failure) },
            Event::Ended { interrupted: true, is_cut_short: false },
        ];
        for how in [Activation::Message, Activation::Flush, Activation::Due] {
            all.push(Event::Activated { instance: 128, how });
        }
        for fate in [Fate::Put, Fate::PutBounded, Fate::Suspended, Fate::Stopped] {
            all.push(Event::Delivered { edge: 70_000, number: 1 << 40, fate });
        }
        all
    }

    fn batch() -> (Vec<Entry>, Vec<u8>) {
        let (mut encoder, mut bytes) = (Encoder::default(), Vec::new());
        let entries: Vec<Entry> = events()
            .into_iter()
            .enumerate()
            // Lanes are written one after the other, so that the order jumps back.
            .map(|(n, event)| Entry { order: (n as u64 * 7) % 16, now: Time(1000 - 3 * n as i64), event })
            .collect();
        entries.iter().for_each(|it| encoder.add(it, &mut bytes));
        (entries, bytes)
    }

    #[test]
    fn every_event_comes_back() {
        let (entries, bytes) = batch();
        let back = decode(&bytes).unwrap();
        assert_eq!(back.len(), entries.len());
        for (a, b) in entries.iter().zip(&back) {
            assert_eq!((a.order, a.now), (b.order, b.now));
        }
        // Written again they are the same bytes, so that nothing was lost.
        let (mut encoder, mut again) = (Encoder::default(), Vec::new());
        back.iter().for_each(|it| encoder.add(it, &mut again));
        assert_eq!(again, bytes);
        let Event::Finished { report, error, .. } = &back[7].event else { panic!() };
        assert_eq!((report.figures["error_mm"], report.figures["nothing"].is_nan()), (0.1, true));
        assert_eq!(
            (report.remarks.as_slice(), error.as_ref().unwrap().blame),
            (&["a note".to_owned()][..], Blame::Program)
        );
    }

    proptest! {
        #[test]
        fn any_bytes_are_answered(bytes in proptest::collection::vec(any::<u8>(), 0..200), cut in 0_usize..400) {
            let _ = decode(&bytes);
            let whole = batch().1;
            let _ = decode(&whole[..cut.min(whole.len())]);
        }
    }
}
