//! The end of a file: the summary that says where everything is, read, or gathered again and written.

use std::collections::BTreeMap;
use std::io::Write;

use mcap::records::{
    AttachmentIndex, Channel, ChunkIndex, Footer, Metadata, MetadataIndex, Record, SchemaHeader, Statistics, op,
};

use crate::records::{Crc, HEAD, LONGEST, MAGIC, Records, parse, unsealed};

mod gather;

pub use gather::Gathered;

/// Footer and closing magic [bytes].
const TAIL: u64 = HEAD + FOOTER + 8;
/// Length of a footer [bytes].
const FOOTER: u64 = 20;
/// Length of the record that ends the data [bytes].
const DATA_END: u64 = HEAD + 4;
/// What is read at a time for a checksum [bytes].
const BLOCK: u64 = 64 << 10;

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

impl Summary {
    /// Reads the summary of a finished file.
    ///
    /// # Errors
    /// Why there is none that can be used: the file does not end with one, or what it says is not so.
    pub fn read(records: &mut Records) -> Result<Summary, NoSummary> {
        let length = records.length();
        let end = length.checked_sub(TAIL).filter(|it| *it >= MAGIC.len() as u64).ok_or(NoSummary::Unfinished)?;
        let closing = records.bytes(end, TAIL).ok_or(NoSummary::Unfinished)?;
        let (footer, magic) = closing.split_at((HEAD + FOOTER) as usize);
        let (head, body) = footer.split_at(HEAD as usize);
        let is_footer = head[0] == op::FOOTER && head[1..] == FOOTER.to_le_bytes();
        // One of the two may be damaged; a file that was cut off has neither.
        if !is_footer && magic != MAGIC {
            return Err(NoSummary::Unfinished);
        }
        if !is_footer || magic != MAGIC {
            return Err(NoSummary::damaged(end, "the end of the file cannot be read"));
        }
        let Ok(Record::Footer(footer)) = parse(op::FOOTER, body) else { return Err(NoSummary::Unfinished) };
        if footer.summary_start == 0 {
            return Err(NoSummary::Unfinished);
        }
        check_section(records, &footer, end)?;
        let (summary, statistics) = Summary::of_section(records, footer.summary_start, end)?;
        if let Some(it) = statistics {
            summary.check_counts(&it).map_err(|what| NoSummary::damaged(end, &what))?;
        }
        summary.check_places(records, footer.summary_start - DATA_END)?;
        Ok(summary)
    }

    /// The records from `start` to `end`.
    fn of_section(records: &mut Records, start: u64, end: u64) -> Result<(Summary, Option<Statistics>), NoSummary> {
        let length = end.saturating_sub(start);
        let bytes = if length > LONGEST { None } else { records.bytes(start, length) };
        let bytes = bytes.ok_or_else(|| NoSummary::damaged(start, "the summary cannot be read"))?;
        let (mut summary, mut statistics) = (Summary::default(), None);
        let mut rest = bytes.as_slice();
        while let Some((head, behind)) = rest.split_first_chunk::<{ HEAD as usize }>() {
            let at = end - rest.len() as u64;
            let [opcode, length @ ..] = *head;
            let body = usize::try_from(u64::from_le_bytes(length)).ok().and_then(|it| behind.split_at_checked(it));
            let (body, next) = body.ok_or_else(|| NoSummary::damaged(at, "the summary breaks off"))?;
            rest = next;
            match parse(opcode, body).map_err(|what| NoSummary::damaged(at, &what))? {
                Record::Schema { header, data } => drop(summary.schemas.insert(header.id, (header, data.into_owned()))),
                Record::Channel(it) => drop(summary.channels.insert(it.id, it)),
                Record::ChunkIndex(it) => summary.chunks.push(it),
                Record::AttachmentIndex(it) => summary.attachments.push(it),
                Record::MetadataIndex(it) => summary.metadata.push(it),
                Record::Statistics(it) => {
                    summary.counts.clone_from(&it.channel_message_counts);
                    statistics = Some(it);
                }
                _ => {}
            }
        }
        match rest.is_empty() {
            true => Ok((summary, statistics)),
            false => Err(NoSummary::damaged(end, "the summary breaks off")),
        }
    }

    /// Compares the statistics with what the summary lists.
    fn check_counts(&self, statistics: &Statistics) -> Result<(), String> {
        let n_messages = self.counts.values().fold(0_u64, |sum, it| sum.saturating_add(*it));
        for (what, announced, found) in [
            ("messages", statistics.message_count, n_messages),
            ("schemas", statistics.schema_count.into(), self.schemas.len() as u64),
            ("channels", statistics.channel_count.into(), self.channels.len() as u64),
            ("chunks", statistics.chunk_count.into(), self.chunks.len() as u64),
            ("attachments", statistics.attachment_count.into(), self.attachments.len() as u64),
            ("metadata", statistics.metadata_count.into(), self.metadata.len() as u64),
        ] {
            if announced != found {
                return Err(format!("the summary lists {found} {what}, expected {announced} by its statistics"));
            }
        }
        Ok(())
    }

    /// What the summary lists fills the data up to `data_end` without a gap that holds more of the same.
    fn check_places(&self, records: &mut Records, data_end: u64) -> Result<(), NoSummary> {
        let of_chunk =
            |it: &ChunkIndex| (it.chunk_start_offset, it.chunk_length.saturating_add(it.message_index_length));
        let mut places: Vec<(u64, u64)> = self.chunks.iter().map(of_chunk).collect();
        places.extend(self.attachments.iter().map(|it| (it.offset, it.length)));
        places.extend(self.metadata.iter().map(|it| (it.offset, it.length)));
        places.sort_unstable();
        places.push((data_end, 0));
        let mut at = MAGIC.len() as u64;
        for (start, length) in places {
            if start < at || start > data_end {
                return Err(NoSummary::damaged(start, "the summary names a place twice, or one outside of the data"));
            }
            if at < start {
                records.go_to(at).map_err(|what| NoSummary::damaged(at, &what))?;
            }
            while at < start && records.at() < start {
                let here = records.at();
                let unlisted = [op::HEADER, op::SCHEMA, op::CHANNEL, op::MESSAGE_INDEX];
                match records.pass() {
                    Ok(Some(opcode)) if unlisted.contains(&opcode) => {}
                    Ok(_) => return Err(NoSummary::damaged(here, "the summary lacks a record that is there")),
                    Err(damage) => return Err(NoSummary::damaged(damage.at, &damage.what)),
                }
            }
            if at < start && records.at() > start {
                return Err(NoSummary::damaged(start, "the summary names a place within a record"));
            }
            at = start.saturating_add(length);
        }
        Ok(())
    }
}

/// Why a file has no summary that can be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NoSummary {
    /// The file does not end with one: its recording was cut off.
    Unfinished,
    /// It has one that is not as it was written: a sentence with the place.
    Damaged(String),
}

impl NoSummary {
    fn damaged(at: u64, what: &str) -> NoSummary {
        NoSummary::Damaged(format!("byte {at}: {what}"))
    }
}

/// The summary must follow the end of the data and have the checksum that the footer announces.
fn check_section(records: &mut Records, footer: &Footer, end: u64) -> Result<(), NoSummary> {
    let start = footer.summary_start;
    let before = start.checked_sub(DATA_END).filter(|_| start <= end).and_then(|it| records.bytes(it, HEAD));
    let is_data_end = |it: &[u8]| it[0] == op::DATA_END && it[1..] == (DATA_END - HEAD).to_le_bytes();
    if !before.is_some_and(|it| it.len() as u64 == HEAD && is_data_end(&it)) {
        let what = format!("the summary is announced at byte {start}, which does not follow the end of the data");
        return Err(NoSummary::damaged(end, &what));
    }
    // It reaches to the checksum itself, over the rest of the footer.
    let (mut at, to) = (start, end + HEAD + FOOTER - 4);
    let mut crc = Crc::default();
    while at < to {
        let bytes = records.bytes(at, BLOCK.min(to - at));
        let bytes = bytes.ok_or_else(|| NoSummary::damaged(at, "the summary cannot be read"))?;
        crc.add(&bytes);
        at += bytes.len() as u64;
    }
    if crc.sum() == footer.summary_crc {
        return Ok(());
    }
    let what = format!("found {:08x} as checksum of the summary, expected {:08x}", crc.sum(), footer.summary_crc);
    Err(NoSummary::damaged(start, &what))
}

impl Summary {
    /// Writes everything that follows the last record of the data: the end of the data, the summary, the footer and the closing magic. `start` is where it begins [bytes].
    ///
    /// # Errors
    /// What the writer says.
    pub fn write(&self, start: u64, to: &mut impl Write) -> std::io::Result<()> {
        let mut bytes = Vec::new();
        record(&mut bytes, op::DATA_END, |it| it.extend(0_u32.to_le_bytes()));
        let summary_start = start + bytes.len() as u64;
        let mut groups: Vec<(u8, u64, u64)> = Vec::new();
        let mut group = |bytes: &mut Vec<u8>, opcode: u8, write: &dyn Fn(&mut Vec<u8>)| {
            let begin = bytes.len();
            write(bytes);
            if bytes.len() > begin {
                groups.push((opcode, start + begin as u64, (bytes.len() - begin) as u64));
            }
        };
        group(&mut bytes, op::SCHEMA, &|bytes| {
            for (header, data) in self.schemas.values() {
                record(bytes, op::SCHEMA, |it| {
                    it.extend(header.id.to_le_bytes());
                    text(it, &header.name);
                    text(it, &header.encoding);
                    it.extend((data.len() as u32).to_le_bytes());
                    it.extend(data);
                });
            }
        });
        group(&mut bytes, op::CHANNEL, &|bytes| {
            for channel in self.channels.values() {
                record(bytes, op::CHANNEL, |it| {
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
        group(&mut bytes, op::STATISTICS, &|bytes| {
            record(bytes, op::STATISTICS, |it| {
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
        group(&mut bytes, op::CHUNK_INDEX, &|bytes| {
            for chunk in &self.chunks {
                record(bytes, op::CHUNK_INDEX, |it| {
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
        group(&mut bytes, op::ATTACHMENT_INDEX, &|bytes| {
            for attachment in &self.attachments {
                record(bytes, op::ATTACHMENT_INDEX, |it| {
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
        group(&mut bytes, op::METADATA_INDEX, &|bytes| {
            for metadata in &self.metadata {
                record(bytes, op::METADATA_INDEX, |it| {
                    it.extend(metadata.offset.to_le_bytes());
                    it.extend(metadata.length.to_le_bytes());
                    text(it, &metadata.name);
                });
            }
        });
        let offsets_start = start + bytes.len() as u64;
        for (opcode, begin, length) in groups {
            record(&mut bytes, op::SUMMARY_OFFSET, |it| {
                it.push(opcode);
                it.extend(begin.to_le_bytes());
                it.extend(length.to_le_bytes());
            });
        }
        record(&mut bytes, op::FOOTER, |it| {
            it.extend(summary_start.to_le_bytes());
            it.extend(offsets_start.to_le_bytes());
            it.extend(0_u32.to_le_bytes());
        });
        let checksum = bytes.len() - 4;
        let mut crc = Crc::default();
        crc.add(&bytes[DATA_END as usize..checksum]);
        bytes[checksum..].copy_from_slice(&crc.sum().to_le_bytes());
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
        match one(records, index.offset, op::METADATA, index.length)? {
            Record::Metadata(Metadata { name: found, metadata }) if found == name => Ok(Some(unsealed(metadata))),
            _ => Err(format!("byte {} holds other metadata than `{name}`, which the summary says", index.offset)),
        }
    }

    /// The record of this kind that begins there.
    ///
    /// # Errors
    /// That it cannot be read.
    pub fn record(&self, records: &mut Records, at: u64, opcode: u8) -> Result<Record<'static>, String> {
        records.go_to(at)?;
        match records.read().map_err(|damage| damage.what)? {
            Some((place, body)) if place.opcode == opcode => parse(opcode, body).map(Record::into_owned),
            _ => Err("found another record than the summary says".to_owned()),
        }
    }

    /// The bytes of an attachment.
    ///
    /// # Errors
    /// That they cannot be read.
    pub fn attachment(&self, records: &mut Records, index: &AttachmentIndex) -> Result<Vec<u8>, String> {
        match one(records, index.offset, op::ATTACHMENT, index.length)? {
            Record::Attachment { header, data, .. } if header.name == index.name => Ok(data.into_owned()),
            _ => Err(format!("byte {} holds another file than `{}`, which the summary says", index.offset, index.name)),
        }
    }
}

/// The record at this place, of this kind and length with its head.
fn one(records: &mut Records, at: u64, opcode: u8, length: u64) -> Result<Record<'static>, String> {
    if at >= records.length() {
        return Err(format!("the summary names byte {at} of a file of {}", records.length()));
    }
    let damaged = |what: String| format!("byte {at}: {what}");
    records.go_to(at)?;
    match records.read().map_err(|damage| damaged(damage.what))? {
        Some((place, body)) if place.opcode == opcode && body.len() as u64 + HEAD == length => {
            parse(opcode, body).map(Record::into_owned).map_err(damaged)
        }
        _ => Err(damaged("found another record than the summary says".to_owned())),
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
