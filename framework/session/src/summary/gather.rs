//! A file without a usable summary, gone through record by record for what its summary would say.

use std::collections::{BTreeMap, BTreeSet};

use mcap::records::{AttachmentIndex, ChunkIndex, MetadataIndex, Record, op};

use super::Summary;
use crate::records::{HEAD, MAGIC, Records, chunk_header, in_chunk, parse};

/// A candidate for a record behind damage is no longer than this [bytes].
const LONGEST_CANDIDATE: u64 = 256 << 20;
/// What is searched at a time behind damage [bytes].
const BLOCK: u64 = 1 << 20;

/// A file without a summary, as far as it could be read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Gathered {
    /// What it holds.
    pub summary: Summary,
    /// Where the last whole record of the data ends [bytes].
    pub end: u64,
    /// What could not be read, and where [bytes].
    pub damage: Vec<(u64, String)>,
    /// Something whole follows what could not be read: nothing may be cut off.
    pub is_torn: bool,
    /// Channels of the last chunk; `None` behind a chunk that is damaged.
    in_last: Option<BTreeSet<u16>>,
    /// The end of the data was found, and nothing but a summary since.
    is_past_data: bool,
}

impl Summary {
    /// Reads a whole file for what its summary would say; chunks whose checksum is wrong are left out.
    ///
    /// # Errors
    /// That the file cannot be gone through at all.
    pub fn gather(records: &mut Records) -> Result<Gathered, String> {
        let mut found = Gathered { end: MAGIC.len() as u64, ..Gathered::default() };
        records.go_to(found.end)?;
        loop {
            let at = records.at();
            let step = records.read().map(|it| it.map(|(place, body)| found.enter(place.at, place.opcode, body)));
            match step {
                Ok(Some(true)) => {
                    found.is_torn |= !found.damage.is_empty();
                    found.end = records.at();
                }
                Ok(Some(false)) => {}
                Ok(None) => break,
                Err(damage) => {
                    found.damage.push((damage.at, damage.what));
                    match next_whole(records, damage.at.max(at) + 1) {
                        Some(place) => records.go_to(place)?,
                        None => break,
                    }
                }
            }
        }
        found.settle_indexes();
        Ok(found)
    }
}

impl Gathered {
    /// Enters one record; whether it is whole and belongs to the data.
    fn enter(&mut self, at: u64, opcode: u8, body: &[u8]) -> bool {
        let entered = match opcode {
            op::HEADER if at == MAGIC.len() as u64 => parse(opcode, body).map(|_| true),
            op::CHUNK => self.enter_chunk(at, body),
            op::SCHEMA | op::CHANNEL | op::STATISTICS | op::SUMMARY_OFFSET | op::FOOTER if self.is_past_data => {
                Ok(false)
            }
            op::CHUNK_INDEX | op::ATTACHMENT_INDEX | op::METADATA_INDEX if self.is_past_data => Ok(false),
            op::SCHEMA | op::CHANNEL | op::MESSAGE_INDEX | op::ATTACHMENT | op::METADATA => {
                parse(opcode, body).map(|record| self.enter_record(at, body.len() as u64 + HEAD, record))
            }
            op::DATA_END => parse(opcode, body).map(|_| {
                self.is_past_data = true;
                false
            }),
            other => Err(format!("found a record of kind {other:#04x}, which has no place here")),
        };
        match entered {
            Ok(true) if std::mem::take(&mut self.is_past_data) => {
                self.damage.push((at, "found a record of the data behind its end".to_owned()));
                true
            }
            Ok(is_data) => is_data,
            Err(what) => {
                self.damage.push((at, what));
                false
            }
        }
    }

    fn enter_chunk(&mut self, at: u64, body: &[u8]) -> Result<bool, String> {
        self.settle_indexes();
        self.in_last = None;
        let damaged = |what: String| format!("a chunk is damaged: {what}");
        let header = chunk_header(body).map_err(damaged)?;
        let index = ChunkIndex {
            message_start_time: header.message_start_time,
            message_end_time: header.message_end_time,
            chunk_start_offset: at,
            chunk_length: body.len() as u64 + HEAD,
            message_index_offsets: BTreeMap::new(),
            message_index_length: 0,
            compression: header.compression,
            compressed_size: header.compressed_size,
            uncompressed_size: header.uncompressed_size,
        };
        let (mut schemas, mut channels) = (Vec::new(), Vec::new());
        let mut counts: BTreeMap<u16, u64> = BTreeMap::new();
        in_chunk(body, |record| {
            match record {
                Record::Schema { header, data } => schemas.push((header.id, (header, data.into_owned()))),
                Record::Channel(it) => channels.push((it.id, it)),
                Record::Message { header, .. } => *counts.entry(header.channel_id).or_default() += 1,
                _ => {}
            }
            Ok(())
        })
        .map_err(damaged)?;
        self.summary.schemas.extend(schemas);
        self.summary.channels.extend(channels);
        self.in_last = Some(counts.keys().copied().collect());
        for (channel, count) in counts {
            *self.summary.counts.entry(channel).or_default() += count;
        }
        self.summary.chunks.push(index);
        Ok(true)
    }

    /// Enters a record beside the chunks; whether it belongs to the data.
    fn enter_record(&mut self, at: u64, length: u64, record: Record<'_>) -> bool {
        let summary = &mut self.summary;
        match record {
            Record::Schema { header, data } => drop(summary.schemas.insert(header.id, (header, data.into_owned()))),
            Record::Channel(it) => drop(summary.channels.insert(it.id, it)),
            Record::Attachment { header, data, .. } => summary.attachments.push(AttachmentIndex {
                offset: at,
                length,
                log_time: header.log_time,
                create_time: header.create_time,
                data_size: data.len() as u64,
                name: header.name,
                media_type: header.media_type,
            }),
            Record::Metadata(it) => {
                summary.metadata.push(MetadataIndex { offset: at, length, name: it.name });
            }
            Record::MessageIndex(it) => {
                if let (Some(chunk), Some(_)) = (summary.chunks.last_mut(), &self.in_last) {
                    chunk.message_index_offsets.insert(it.channel_id, at);
                    chunk.message_index_length += length;
                }
            }
            _ => return false,
        }
        true
    }

    /// A chunk with indexes of some of its channels has none: who looks for a channel by them would miss it.
    fn settle_indexes(&mut self) {
        if let (Some(chunk), Some(in_last)) = (self.summary.chunks.last_mut(), &self.in_last)
            && !chunk.message_index_offsets.keys().eq(in_last.iter())
        {
            chunk.message_index_offsets.clear();
            chunk.message_index_length = 0;
        }
    }
}

/// Where the first whole record of the data begins at or after `from` that shows by itself whether it is whole.
fn next_whole(records: &mut Records, from: u64) -> Option<u64> {
    let length = records.length();
    let mut at = from;
    while at + HEAD < length {
        let block = records.bytes(at, BLOCK)?;
        let candidates = block.windows(HEAD as usize).enumerate().filter(|(offset, it)| {
            let announced = it[1..].iter().rev().fold(0_u64, |sum, byte| (sum << 8) | u64::from(*byte));
            [op::CHUNK, op::ATTACHMENT, op::METADATA].contains(&it[0])
                && (8..=LONGEST_CANDIDATE).contains(&announced)
                && announced <= length - at - *offset as u64 - HEAD
        });
        for offset in candidates.map(|it| it.0).collect::<Vec<_>>() {
            let place = at + offset as u64;
            records.go_to(place).ok()?;
            let whole = records.read().ok().flatten().is_some_and(|(found, body)| is_whole(found.opcode, body));
            if whole {
                return Some(place);
            }
        }
        at += (block.len() as u64).saturating_sub(HEAD - 1).max(1);
    }
    None
}

/// Whether bytes that may be a record by chance are one: they have a checksum, or a name of ours.
fn is_whole(opcode: u8, body: &[u8]) -> bool {
    if opcode == op::CHUNK {
        return chunk_header(body).is_ok_and(|it| it.uncompressed_size > 0) && in_chunk(body, |_| Ok(())).is_ok();
    }
    match parse(opcode, body) {
        Ok(Record::Attachment { .. }) => true,
        Ok(Record::Metadata(it)) => it.name.starts_with("foveate."),
        _ => false,
    }
}
