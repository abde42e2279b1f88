//! The end of a file: the summary that says where everything is, read, or gathered anew and written.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;

use mcap::records::{AttachmentIndex, Channel, ChunkIndex, Metadata, MetadataIndex, Record, SchemaHeader};

use crate::records::{HEAD, MAGIC, Records, in_chunk, parse};

const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const CHUNK: u8 = 0x06;
const CHUNK_INDEX: u8 = 0x08;
const ATTACHMENT: u8 = 0x09;
const ATTACHMENT_INDEX: u8 = 0x0a;
const STATISTICS: u8 = 0x0b;
const METADATA: u8 = 0x0c;
const METADATA_INDEX: u8 = 0x0d;
const FOOTER: u8 = 0x02;
const DATA_END: u8 = 0x0f;
/// Footer and closing magic [bytes].
const TAIL: u64 = HEAD + 20 + 8;
/// A candidate for a chunk behind damage is no longer than this [bytes].
const LONGEST_CHUNK: u64 = 256 << 20;

/// What a file holds, and where.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Summary {
    /// Schemas by number: header and bytes.
    pub schemas: BTreeMap<u16, (SchemaHeader, Vec<u8>)>,
    /// Channels by number.
    pub channels: BTreeMap<u16, Channel>,
    /// Chunks in the order of the file.
    pub chunks: Vec<ChunkIndex>,
    /// Files within the file.
    pub attachments: Vec<AttachmentIndex>,
    /// Texts, by place.
    pub metadata: Vec<MetadataIndex>,
    /// Messages by channel.
    pub counts: BTreeMap<u16, u64>,
}

/// A file without a summary, as far as it could be read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Gathered {
    /// What it holds.
    pub summary: Summary,
    /// Where the last whole record ends [bytes].
    pub end: u64,
    /// What could not be read, and where [bytes].
    pub damage: Vec<(u64, String)>,
    /// Something whole follows what could not be read: nothing may be cut off.
    pub is_torn: bool,
    /// Channels of the last chunk.
    in_last: BTreeSet<u16>,
}

impl Summary {
    /// Reads the summary of a finished file; `None` where there is none that can be used.
    pub fn read(records: &mut Records) -> Option<Summary> {
        let length = records.length();
        if length < MAGIC.len() as u64 + TAIL {
            return None;
        }
        records.go_to(length - TAIL).ok()?;
        let start = match records.next(|it| it == FOOTER).ok()? {
            Some((place, body)) if place.at == length - TAIL => match parse(FOOTER, body).ok()? {
                Record::Footer(it) => it.summary_start,
                _ => return None,
            },
            _ => return None,
        };
        if start == 0 || start >= length - TAIL {
            return None;
        }
        records.go_to(start).ok()?;
        let mut summary = Summary::default();
        while let Some((place, body)) = records.next(|_| true).ok()? {
            if place.opcode == FOOTER {
                return Some(summary);
            }
            match parse(place.opcode, body).ok()? {
                Record::Schema { header, data } => drop(summary.schemas.insert(header.id, (header, data.into_owned()))),
                Record::Channel(it) => drop(summary.channels.insert(it.id, it)),
                Record::ChunkIndex(it) => summary.chunks.push(it),
                Record::AttachmentIndex(it) => summary.attachments.push(it),
                Record::MetadataIndex(it) => summary.metadata.push(it),
                Record::Statistics(it) => summary.counts = it.channel_message_counts,
                _ => {}
            }
        }
        None
    }

    /// Reads a whole file for what its summary would say; chunks whose checksum is wrong are left out.
    ///
    /// # Errors
    /// That the file cannot be gone through at all.
    pub fn gather(records: &mut Records) -> Result<Gathered, String> {
        let mut found = Gathered { end: MAGIC.len() as u64, ..Gathered::default() };
        records.go_to(found.end)?;
        loop {
            let at = records.at();
            let step =
                records.next(|_| true).map(|it| it.map(|(place, body)| found.enter(place.at, place.opcode, body)));
            match step {
                Ok(Some(true)) => {
                    found.is_torn |= !found.damage.is_empty();
                    found.end = records.at();
                }
                Ok(Some(false)) => {}
                Ok(None) => break,
                Err(damage) => {
                    found.damage.push((damage.at, damage.what));
                    match next_chunk(records, damage.at.max(at) + 1) {
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
        let length = body.len() as u64 + HEAD;
        let record = match parse(opcode, body) {
            Ok(record) => record,
            Err(what) => {
                self.damage.push((at, what));
                return false;
            }
        };
        if matches!(record, Record::Chunk { .. }) {
            self.settle_indexes();
        }
        let summary = &mut self.summary;
        match record {
            Record::Chunk { header, data } => {
                let index = ChunkIndex {
                    message_start_time: header.message_start_time,
                    message_end_time: header.message_end_time,
                    chunk_start_offset: at,
                    chunk_length: length,
                    message_index_offsets: BTreeMap::new(),
                    message_index_length: 0,
                    compression: header.compression.clone(),
                    compressed_size: header.compressed_size,
                    uncompressed_size: header.uncompressed_size,
                };
                let mut schemas = Vec::new();
                let mut channels = Vec::new();
                let mut counts: BTreeMap<u16, u64> = BTreeMap::new();
                let whole = in_chunk(header, &data, |record| {
                    match record {
                        Record::Schema { header, data } => schemas.push((header.id, (header, data.into_owned()))),
                        Record::Channel(it) => channels.push((it.id, it)),
                        Record::Message { header, .. } => *counts.entry(header.channel_id).or_default() += 1,
                        _ => {}
                    }
                    Ok(())
                });
                if let Err(what) = whole {
                    self.damage.push((at, format!("a chunk is damaged: {what}")));
                    return false;
                }
                summary.schemas.extend(schemas);
                summary.channels.extend(channels);
                self.in_last = counts.keys().copied().collect();
                for (channel, count) in counts {
                    *summary.counts.entry(channel).or_default() += count;
                }
                summary.chunks.push(index);
            }
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
                if let Some(chunk) = summary.chunks.last_mut() {
                    chunk.message_index_offsets.insert(it.channel_id, at);
                    chunk.message_index_length += length;
                }
            }
            Record::DataEnd(_) | Record::Footer(_) => return false,
            _ => {}
        }
        true
    }

    /// A chunk with indexes of some of its channels has none: who looks for a channel by them would miss it.
    fn settle_indexes(&mut self) {
        if let Some(chunk) = self.summary.chunks.last_mut()
            && !chunk.message_index_offsets.keys().eq(self.in_last.iter())
        {
            chunk.message_index_offsets.clear();
            chunk.message_index_length = 0;
        }
    }
}

/// Where the first whole chunk begins at or after `from`.
fn next_chunk(records: &mut Records, from: u64) -> Option<u64> {
    let length = records.length();
    let mut at = from;
    while at + HEAD < length {
        let block = records.bytes(at, 1 << 20)?;
        let candidates = block.windows(HEAD as usize).enumerate().filter(|(offset, it)| {
            let announced = it[1..].iter().rev().fold(0_u64, |sum, byte| (sum << 8) | u64::from(*byte));
            it[0] == CHUNK
                && (40..=LONGEST_CHUNK).contains(&announced)
                && announced <= length - at - *offset as u64 - HEAD
        });
        for offset in candidates.map(|it| it.0).collect::<Vec<_>>() {
            let place = at + offset as u64;
            records.go_to(place).ok()?;
            let is_whole = records.next(|_| true).ok().flatten().is_some_and(|(_, body)| match parse(CHUNK, body) {
                Ok(Record::Chunk { header, data }) => in_chunk(header, &data, |_| Ok(())).is_ok(),
                _ => false,
            });
            if is_whole {
                return Some(place);
            }
        }
        at += (block.len() as u64).saturating_sub(HEAD - 1).max(1);
    }
    None
}

impl Summary {
    /// Writes everything that follows the last record of the data: the end of the data, the summary, the footer and the closing magic. `start` is where it begins [bytes].
    ///
    /// # Errors
    /// What the writer says.
    pub fn write(&self, start: u64, to: &mut impl Write) -> std::io::Result<()> {
        let mut bytes = Vec::new();
        record(&mut bytes, DATA_END, |it| it.extend(0_u32.to_le_bytes()));
        let summary_start = start + bytes.len() as u64;
        let mut groups: Vec<(u8, u64, u64)> = Vec::new();
        let mut group = |bytes: &mut Vec<u8>, opcode: u8, write: &dyn Fn(&mut Vec<u8>)| {
            let begin = bytes.len();
            write(bytes);
            if bytes.len() > begin {
                groups.push((opcode, start + begin as u64, (bytes.len() - begin) as u64));
            }
        };
        group(&mut bytes, SCHEMA, &|bytes| {
            for (header, data) in self.schemas.values() {
                record(bytes, SCHEMA, |it| {
                    it.extend(header.id.to_le_bytes());
                    text(it, &header.name);
                    text(it, &header.encoding);
                    it.extend((data.len() as u32).to_le_bytes());
                    it.extend(data);
                });
            }
        });
        group(&mut bytes, CHANNEL, &|bytes| {
            for channel in self.channels.values() {
                record(bytes, CHANNEL, |it| {
                    it.extend(channel.id.to_le_bytes());
                    it.extend(channel.schema_id.to_le_bytes());
                    text(it, &channel.topic);
                    text(it, &channel.message_encoding);
                    map(it, channel.metadata.iter(), |it, (key, value)| {
                        text(it, key);
                        text(it, value);
                    });
                });
            }
        });
        group(&mut bytes, STATISTICS, &|bytes| {
            record(bytes, STATISTICS, |it| {
                it.extend(self.counts.values().sum::<u64>().to_le_bytes());
                it.extend((self.schemas.len() as u16).to_le_bytes());
                for count in [self.channels.len(), self.attachments.len(), self.metadata.len(), self.chunks.len()] {
                    it.extend((count as u32).to_le_bytes());
                }
                let [first, last] = self.times();
                it.extend(first.to_le_bytes());
                it.extend(last.to_le_bytes());
                map(it, self.counts.iter(), |it, (channel, count)| {
                    it.extend(channel.to_le_bytes());
                    it.extend(count.to_le_bytes());
                });
            });
        });
        group(&mut bytes, CHUNK_INDEX, &|bytes| {
            for chunk in &self.chunks {
                record(bytes, CHUNK_INDEX, |it| {
                    let numbers = [
                        chunk.message_start_time,
                        chunk.message_end_time,
                        chunk.chunk_start_offset,
                        chunk.chunk_length,
                    ];
                    numbers.iter().for_each(|number| it.extend(number.to_le_bytes()));
                    map(it, chunk.message_index_offsets.iter(), |it, (channel, offset)| {
                        it.extend(channel.to_le_bytes());
                        it.extend(offset.to_le_bytes());
                    });
                    it.extend(chunk.message_index_length.to_le_bytes());
                    text(it, &chunk.compression);
                    it.extend(chunk.compressed_size.to_le_bytes());
                    it.extend(chunk.uncompressed_size.to_le_bytes());
                });
            }
        });
        group(&mut bytes, ATTACHMENT_INDEX, &|bytes| {
            for attachment in &self.attachments {
                record(bytes, ATTACHMENT_INDEX, |it| {
                    let numbers = [
                        attachment.offset,
                        attachment.length,
                        attachment.log_time,
                        attachment.create_time,
                        attachment.data_size,
                    ];
                    numbers.iter().for_each(|number| it.extend(number.to_le_bytes()));
                    text(it, &attachment.name);
                    text(it, &attachment.media_type);
                });
            }
        });
        group(&mut bytes, METADATA_INDEX, &|bytes| {
            for metadata in &self.metadata {
                record(bytes, METADATA_INDEX, |it| {
                    it.extend(metadata.offset.to_le_bytes());
                    it.extend(metadata.length.to_le_bytes());
                    text(it, &metadata.name);
                });
            }
        });
        let offsets_start = start + bytes.len() as u64;
        for (opcode, begin, length) in groups {
            record(&mut bytes, 0x0e, |it| {
                it.push(opcode);
                it.extend(begin.to_le_bytes());
                it.extend(length.to_le_bytes());
            });
        }
        record(&mut bytes, FOOTER, |it| {
            it.extend(summary_start.to_le_bytes());
            it.extend(offsets_start.to_le_bytes());
            it.extend(0_u32.to_le_bytes());
        });
        bytes.extend(MAGIC);
        to.write_all(&bytes)
    }

    /// Time of the first and last message [ns].
    pub fn times(&self) -> [u64; 2] {
        let filled = || self.chunks.iter().filter(|it| it.message_end_time > 0 || it.message_start_time > 0);
        [
            filled().map(|it| it.message_start_time).min().unwrap_or(0),
            filled().map(|it| it.message_end_time).max().unwrap_or(0),
        ]
    }

    /// The texts of that name, the last ones where there are several.
    ///
    /// # Errors
    /// That they cannot be read.
    pub fn texts(&self, records: &mut Records, name: &str) -> Result<Option<BTreeMap<String, String>>, String> {
        let Some(index) = self.metadata.iter().rev().find(|it| it.name == name) else { return Ok(None) };
        match one(records, index.offset, METADATA)? {
            Record::Metadata(Metadata { metadata, .. }) => Ok(Some(metadata)),
            _ => Ok(None),
        }
    }

    /// The bytes of an attachment.
    ///
    /// # Errors
    /// That they cannot be read.
    pub fn attachment(&self, records: &mut Records, index: &AttachmentIndex) -> Result<Vec<u8>, String> {
        match one(records, index.offset, ATTACHMENT)? {
            Record::Attachment { data, .. } => Ok(data.into_owned()),
            _ => Err(format!("`{}` is not where the summary says", index.name)),
        }
    }
}

/// The record at this place.
fn one(records: &mut Records, at: u64, opcode: u8) -> Result<Record<'static>, String> {
    if at >= records.length() {
        return Err(format!("the summary names byte {at} of a file of {}", records.length()));
    }
    records.go_to(at)?;
    match records.next(|_| true).map_err(|damage| damage.what)? {
        Some((place, body)) if place.opcode == opcode => parse(opcode, body).map(Record::into_owned),
        _ => Err(format!("byte {at} holds another record than the summary says")),
    }
}

fn record(bytes: &mut Vec<u8>, opcode: u8, write: impl FnOnce(&mut Vec<u8>)) {
    bytes.push(opcode);
    let start = bytes.len();
    bytes.extend([0; 8]);
    write(bytes);
    let length = (bytes.len() - start - 8) as u64;
    bytes[start..start + 8].copy_from_slice(&length.to_le_bytes());
}

fn text(bytes: &mut Vec<u8>, text: &str) {
    bytes.extend((text.len() as u32).to_le_bytes());
    bytes.extend(text.as_bytes());
}

/// A map or list: its length in bytes, then its items.
fn map<T>(bytes: &mut Vec<u8>, items: impl Iterator<Item = T>, write: impl Fn(&mut Vec<u8>, T)) {
    let start = bytes.len();
    bytes.extend([0; 4]);
    items.for_each(|it| write(bytes, it));
    let length = (bytes.len() - start - 4) as u32;
    bytes[start..start + 4].copy_from_slice(&length.to_le_bytes());
}
