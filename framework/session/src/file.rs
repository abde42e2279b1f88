//! The file that a recorder writes: chunks that are whole on the disk twice a second, and a summary at the end.

use std::collections::{BTreeMap, HashMap};
use std::fs::{File, OpenOptions, TryLockError};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, McapError, WriteOptions, Writer};

use crate::gathered::Gathered;
use crate::names::PROFILE;
use crate::records::seal;

/// A chunk is closed when it holds so much [bytes].
const CHUNK_BYTES: usize = 4 << 20;

/// How chunks are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Packing {
    /// Not at all: the least work.
    None,
    /// LZ4: little work; dark pictures shrink to a part.
    #[default]
    Lz4,
    /// Zstandard, level 1: about half the speed of LZ4, and smaller.
    Zstd,
}

/// A channel of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Channel(u16);

/// An MCAP file that is being written.
pub struct SessionFile {
    writer: Writer<Gathered>,
    file: File,
    is_at_leisure: Arc<AtomicBool>,
    /// Of messages in the chunk that is open.
    n_bytes: usize,
    schemas: HashMap<String, u16>,
    sequences: HashMap<u16, u32>,
}

impl SessionFile {
    /// Begins the file `path`, which must not be there yet.
    ///
    /// # Errors
    /// A sentence: it is there already, or cannot be written.
    pub fn create(path: &Path, packing: Packing) -> Result<SessionFile, String> {
        let failed = |error: &dyn std::fmt::Display| format!("`{}` cannot be written: {error}", path.display());
        let file = OpenOptions::new().write(true).create_new(true).open(path).map_err(|error| failed(&error))?;
        // Who opens it meanwhile finds that it is being written.
        if let Err(error @ TryLockError::WouldBlock) = file.try_lock() {
            return Err(failed(&error));
        }
        let again = file.try_clone().map_err(|error| failed(&error))?;
        let compression = match packing {
            Packing::None => None,
            Packing::Lz4 => Some(Compression::Lz4),
            Packing::Zstd => Some(Compression::Zstd),
        };
        let options = WriteOptions::new()
            .profile(PROFILE)
            .library(concat!("foveate ", env!("CARGO_PKG_VERSION")))
            .compression(compression)
            // Zstd: the fastest level, on the recorder's thread alone. (LZ4 takes 0 for its fast mode.)
            .compression_level(u32::from(packing == Packing::Zstd))
            .compression_threads(0)
            // A flush closes a chunk, and nothing else does: a killed run leaves no part of one.
            .chunk_size(None)
            .calculate_data_section_crc(false);
        let is_at_leisure = Arc::default();
        let writer = options.create(Gathered::new(again, path, Arc::clone(&is_at_leisure)));
        let writer = writer.map_err(|error| failed(&error))?;
        Ok(SessionFile { writer, file, is_at_leisure, n_bytes: 0, schemas: HashMap::new(), sequences: HashMap::new() })
    }

    /// A channel; `schema` is its name, encoding and bytes, where it has one.
    ///
    /// # Errors
    /// Why it cannot be written.
    pub fn channel(
        &mut self,
        topic: &str,
        encoding: &str,
        schema: Option<(&str, &str, &[u8])>,
        facts: &BTreeMap<String, String>,
    ) -> Result<Channel, String> {
        let schema = match schema {
            None => 0,
            Some((name, encoding, bytes)) => match self.schemas.get(name) {
                Some(known) => *known,
                None => {
                    let new = self.writer.add_schema(name, encoding, bytes).map_err(in_words)?;
                    self.schemas.insert(name.to_owned(), new);
                    new
                }
            },
        };
        self.writer.add_channel(schema, topic, encoding, facts).map(Channel).map_err(in_words)
    }

    /// A message.
    ///
    /// # Errors
    /// Why it cannot be written; nothing can be written after that.
    pub fn message(&mut self, channel: Channel, log_ns: i64, publish_ns: i64, bytes: &[u8]) -> Result<(), String> {
        let sequence = self.sequences.entry(channel.0).or_default();
        let header = MessageHeader {
            channel_id: channel.0,
            sequence: *sequence,
            log_time: log_ns.max(0).unsigned_abs(),
            publish_time: publish_ns.max(0).unsigned_abs(),
        };
        *sequence = sequence.wrapping_add(1);
        self.writer.write_to_known_channel(&header, bytes).map_err(in_words)?;
        self.n_bytes += bytes.len();
        if self.n_bytes > CHUNK_BYTES { self.flush_to_system() } else { Ok(()) }
    }

    /// A file within the file.
    ///
    /// # Errors
    /// Why it cannot be written.
    pub fn attach(&mut self, name: &str, media_type: &str, bytes: &[u8]) -> Result<(), String> {
        let attachment = Attachment {
            log_time: 0,
            create_time: 0,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: bytes.into(),
        };
        self.writer.attach(&attachment).map_err(in_words)
    }

    /// Texts by name, and their checksum.
    ///
    /// # Errors
    /// Why they cannot be written.
    pub fn metadata(&mut self, name: &str, texts: BTreeMap<String, String>) -> Result<(), String> {
        self.writer.write_metadata(&Metadata { name: name.to_owned(), metadata: seal(texts) }).map_err(in_words)
    }

    /// Says whether the writer keeps up with what comes, so that there is time to spare the processor.
    pub fn at_leisure(&self, is_at_leisure: bool) {
        self.is_at_leisure.store(is_at_leisure, Ordering::Relaxed);
    }

    /// Closes the chunk and has the system write all: what came before is safe from a kill, and from a power cut.
    ///
    /// # Errors
    /// Why it cannot be written.
    pub fn flush(&mut self) -> Result<(), String> {
        self.flush_to_system()?;
        self.file.sync_data().map_err(|error| error.to_string())
    }

    /// Closes the chunk and gives all to the system: what came before is safe from a kill.
    ///
    /// # Errors
    /// Why it cannot be written.
    pub fn flush_to_system(&mut self) -> Result<(), String> {
        self.n_bytes = 0;
        self.writer.flush().map_err(in_words)
    }

    /// Writes the summary and closes the file.
    ///
    /// # Errors
    /// Why it cannot be written.
    pub fn finish(mut self) -> Result<(), String> {
        self.writer.finish().map_err(in_words)?;
        self.file.sync_all().map_err(|error| error.to_string())
    }

    /// Length of the file so far [bytes].
    pub fn length(&self) -> u64 {
        self.file.metadata().map_or(0, |it| it.len())
    }
}

fn in_words(error: McapError) -> String {
    match error {
        McapError::Io(error) => error.to_string(),
        other => other.to_string(),
    }
}
