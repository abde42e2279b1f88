//! The records of an MCAP file, one by one and without trust: whatever the bytes say, nothing is read beyond the file or the memory.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use foveate_node::guard::guarded;
use mcap::records::{ChunkHeader, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// Magic bytes at both ends of a file.
pub const MAGIC: &[u8] = mcap::MAGIC;
/// Opcode and length in front of each record [bytes].
pub const HEAD: u64 = 9;
/// Longest record, and longest summary, that is read [bytes].
pub const LONGEST: u64 = 1 << 30;
/// What a byte of LZ4 makes at most: a match whose length grows by 255 with each further byte [bytes].
const LZ4_BYTES: u64 = 255;
/// What a byte of Zstandard makes at most: a block of 128 KiB that repeats one byte takes four [bytes].
const ZSTD_BYTES: u64 = 32 << 10;

/// The key of metadata under which its checksum stands: MCAP has none for it.
const SEAL: &str = "crc32";

/// A place in a file and what is wrong there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Where the record begins that cannot be read [bytes].
    pub at: u64,
    /// Why.
    pub what: String,
}

/// Reads the records of a file in their order.
pub struct Records {
    file: File,
    length: u64,
    at: u64,
    body: Vec<u8>,
}

/// A record at the top of a file.
pub struct Place {
    /// Where it begins [bytes].
    pub at: u64,
    /// Which it is.
    pub opcode: u8,
}

impl Records {
    /// Opens a file.
    ///
    /// # Errors
    /// A sentence: it cannot be read, or is no MCAP file.
    pub fn open(path: &Path) -> Result<Records, String> {
        let shown = path.display();
        let failed = |error: std::io::Error| format!("`{shown}` cannot be read: {error}");
        // Asked before it is opened: opening a pipe waits for its other end.
        if !fs::metadata(path).map_err(failed)?.is_file() {
            return Err(format!("`{shown}` is no file, expected a session (MCAP)"));
        }
        let mut file = File::open(path).map_err(failed)?;
        let facts = file.metadata().map_err(failed)?;
        let mut magic = [0; 8];
        let n = facts.len().min(8) as usize;
        file.read_exact(&mut magic[..n]).map_err(failed)?;
        if n == 0 {
            return Err(format!("`{shown}` is empty, expected a session (MCAP)"));
        }
        if magic != MAGIC {
            return Err(format!(
                "`{shown}` is no MCAP file: it begins with {:02x?}, expected {:02x?}",
                &magic[..n],
                MAGIC
            ));
        }
        Ok(Records { file, length: facts.len(), at: MAGIC.len() as u64, body: Vec::new() })
    }

    /// Length of the file [bytes].
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Where the next record begins [bytes].
    pub fn at(&self) -> u64 {
        self.at
    }

    /// Goes on at this place.
    ///
    /// # Errors
    /// That it cannot be gone to.
    pub fn go_to(&mut self, at: u64) -> Result<(), String> {
        self.at = at;
        self.file.seek(SeekFrom::Start(at)).map(drop).map_err(|error| error.to_string())
    }

    /// Up to `most` bytes from this place on; `None` where they cannot be read.
    pub fn bytes(&mut self, at: u64, most: u64) -> Option<Vec<u8>> {
        let n = most.min(self.length.checked_sub(at)?);
        self.file.seek(SeekFrom::Start(at)).ok()?;
        let mut bytes = vec![0; n as usize];
        self.file.read_exact(&mut bytes).ok()?;
        Some(bytes)
    }

    /// The next record with its body. `None` at the end of the file.
    ///
    /// # Errors
    /// The first place from which the file cannot be read on.
    pub fn read(&mut self) -> Result<Option<(Place, &[u8])>, Damage> {
        let at = self.at;
        let Some((opcode, length)) = self.head()? else { return Ok(None) };
        let damage = |what: String| Damage { at, what };
        if length > LONGEST {
            return Err(damage(format!("found a record of {length} bytes, expected at most {LONGEST}")));
        }
        self.body.resize(length as usize, 0);
        self.file.read_exact(&mut self.body).map_err(|error| damage(error.to_string()))?;
        Ok(Some((Place { at, opcode }, &self.body)))
    }

    /// Passes over the next record and says its opcode. `None` at the end of the file.
    ///
    /// # Errors
    /// As [`Records::read`].
    pub fn pass(&mut self) -> Result<Option<u8>, Damage> {
        let at = self.at;
        let Some((opcode, _)) = self.head()? else { return Ok(None) };
        self.go_to(self.at).map_err(|what| Damage { at, what })?;
        Ok(Some(opcode))
    }

    /// Opcode and length of the next record, whose end is the next place to go on from.
    fn head(&mut self) -> Result<Option<(u8, u64)>, Damage> {
        let at = self.at;
        let damage = |what: String| Damage { at, what };
        if at >= self.length || self.is_end(at) {
            return Ok(None);
        }
        let rest = self.length - at;
        let mut head = [0; HEAD as usize];
        if rest < HEAD {
            return Err(damage(format!("the file ends {rest} bytes into a record")));
        }
        self.file.read_exact(&mut head).map_err(|error| damage(error.to_string()))?;
        let [opcode, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        if opcode == 0 {
            return Err(damage("found no record".to_owned()));
        }
        if length > rest - HEAD {
            return Err(damage(format!("a record of {length} bytes ends {} beyond the file", length - (rest - HEAD))));
        }
        self.at = at + HEAD + length;
        Ok(Some((opcode, length)))
    }

    /// Whether only the closing magic is left.
    fn is_end(&mut self, at: u64) -> bool {
        if self.length - at != MAGIC.len() as u64 {
            return false;
        }
        let mut magic = [0; 8];
        let is_magic = self.file.read_exact(&mut magic).is_ok() && magic == MAGIC;
        let _ = self.file.seek(SeekFrom::Start(at)); // what cannot be read again is said when it is
        is_magic
    }
}

/// Reads the body of a record. It must be as long as what it says: a record whose length is wrong would hide those behind it.
///
/// # Errors
/// What is wrong with it.
pub fn parse(opcode: u8, body: &[u8]) -> Result<Record<'_>, String> {
    // The reader asks for as much memory as a text announces, and trusts lengths in a few more places.
    check_texts(opcode, body)?;
    let record = guarded(|| mcap::parse_record(opcode, body))?.map_err(|error| error.to_string())?;
    let text = |it: &str| 4 + it.len();
    let map = |it: &BTreeMap<String, String>| 4 + it.iter().map(|(key, value)| text(key) + text(value)).sum::<usize>();
    let expected = match &record {
        Record::Header(it) => text(&it.profile) + text(&it.library),
        Record::Footer(_) => 20,
        Record::Schema { header, data } => 6 + text(&header.name) + text(&header.encoding) + data.len(),
        Record::Channel(it) => 4 + text(&it.topic) + text(&it.message_encoding) + map(&it.metadata),
        Record::MessageIndex(it) => 6 + 16 * it.records.len(),
        Record::DataEnd(_) => 4,
        Record::Chunk { header, data } => 36 + text(&header.compression) + data.len(),
        Record::Attachment { header, data, .. } => 28 + text(&header.name) + text(&header.media_type) + data.len(),
        Record::Metadata(it) => text(&it.name) + map(&it.metadata),
        _ => body.len(),
    };
    if body.len() != expected {
        return Err(format!("found a record of {} bytes, expected {expected} by what it says", body.len()));
    }
    // To the reader no checksum is one that fits; where bytes were lost there are zeros.
    if let Record::Attachment { header, crc: 0, .. } = &record {
        let mut crc = Crc::default();
        crc.add(&body[..body.len() - 4]);
        if crc.sum() != 0 {
            return Err(format!("found no checksum of the file `{}`, expected {:08x}", header.name, crc.sum()));
        }
    }
    if let Record::Metadata(it) = &record
        && let Some(found) = it.metadata.get(SEAL)
        && *found != seal_of(&it.metadata)
    {
        let expected = seal_of(&it.metadata);
        return Err(format!("found {found} as checksum of the metadata `{}`, expected {expected}", it.name));
    }
    Ok(record)
}

/// What a record begins with.
#[derive(Clone, Copy)]
enum Part {
    /// So many bytes.
    Bytes(usize),
    /// A length and so many bytes.
    Text,
    /// A length and so many bytes, which are pairs of texts.
    Texts,
}

/// The parts of a record up to its last text.
fn parts(opcode: u8) -> &'static [Part] {
    use Part::{Bytes, Text, Texts};
    match opcode {
        op::HEADER => &[Text, Text],
        op::SCHEMA => &[Bytes(2), Text, Text],
        op::CHANNEL => &[Bytes(4), Text, Text, Texts],
        op::CHUNK => &[Bytes(28), Text],
        // (The map of places is as long as it says, as a text is.)
        op::CHUNK_INDEX => &[Bytes(32), Text, Bytes(8), Text],
        op::ATTACHMENT => &[Bytes(16), Text, Text],
        op::ATTACHMENT_INDEX => &[Bytes(40), Text, Text],
        op::METADATA => &[Text, Texts],
        op::METADATA_INDEX => &[Bytes(16), Text],
        _ => &[],
    }
}

/// That the texts of a record end within it.
fn check_texts(opcode: u8, body: &[u8]) -> Result<(), String> {
    let mut rest = body;
    for part in parts(opcode) {
        rest = match part {
            Part::Bytes(n) => rest.get(*n..),
            Part::Text => text(rest).map(|it| it.1),
            Part::Texts => text(rest).and_then(|(mut pairs, after)| {
                while !pairs.is_empty() {
                    pairs = text(pairs)?.1;
                }
                Some(after)
            }),
        }
        .ok_or_else(|| format!("a text of a record of kind {opcode:#04x} ends beyond its {} bytes", body.len()))?;
    }
    Ok(())
}

/// The text at the beginning of `bytes`, and what follows it.
fn text(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(u32::from_le_bytes(*length) as usize)
}

/// Adds their checksum to texts, which [`parse`] compares.
pub fn seal(mut texts: BTreeMap<String, String>) -> BTreeMap<String, String> {
    texts.insert(SEAL.to_owned(), seal_of(&texts));
    texts
}

/// Texts without what [`seal`] added.
pub fn unsealed(mut texts: BTreeMap<String, String>) -> BTreeMap<String, String> {
    texts.remove(SEAL);
    texts
}

fn seal_of(texts: &BTreeMap<String, String>) -> String {
    let mut crc = Crc::default();
    for (key, value) in texts.iter().filter(|it| it.0 != SEAL) {
        for text in [key, value] {
            crc.add(&(text.len() as u32).to_le_bytes());
            crc.add(text.as_bytes());
        }
    }
    format!("{:08x}", crc.sum())
}

/// Reads the header of the chunk with this body.
///
/// # Errors
/// What is wrong with it, such as a size that its bytes cannot have.
pub fn chunk_header(body: &[u8]) -> Result<ChunkHeader, String> {
    let Record::Chunk { header, .. } = parse(op::CHUNK, body)? else {
        return Err("found another record, expected a chunk".to_owned());
    };
    let (found, packed) = (header.uncompressed_size, header.compressed_size);
    let (least, most) = match header.compression.as_str() {
        "" => (packed, packed),
        "lz4" => (0, packed.saturating_mul(LZ4_BYTES)),
        "zstd" => (0, packed.saturating_mul(ZSTD_BYTES)),
        other => return Err(format!("found the compression `{other}`, expected lz4, zstd or none")),
    };
    if !(least..=most.min(LONGEST)).contains(&found) {
        let what = if least == most { most.to_string() } else { format!("at most {}", most.min(LONGEST)) };
        return Err(format!("{packed} bytes of a chunk announce {found} unpacked, expected {what}"));
    }
    Ok(header)
}

/// Gives the records of the chunk with this body to `take`, once its checksum was found to be right.
///
/// # Errors
/// What is wrong with the chunk, or what `take` says.
pub fn in_chunk(body: &[u8], mut take: impl FnMut(Record<'_>) -> Result<(), String>) -> Result<(), String> {
    let header = chunk_header(body)?;
    if header.uncompressed_crc == 0 {
        // To the reader no checksum is one that fits; where bytes were lost there are zeros.
        let mut crc = Crc::default();
        each_record(body, &header, |opcode, data| {
            crc.add(&[opcode]);
            crc.add(&(data.len() as u64).to_le_bytes());
            crc.add(data);
            Ok(())
        })?;
        if crc.sum() != 0 {
            return Err(format!("found no checksum, expected {:08x}", crc.sum()));
        }
    }
    each_record(body, &header, |opcode, data| take(parse(opcode, data)?))
}

fn each_record(
    body: &[u8],
    header: &ChunkHeader,
    mut take: impl FnMut(u8, &[u8]) -> Result<(), String>,
) -> Result<(), String> {
    // Without a limit a record within the chunk may announce any length, and so much memory is asked for.
    let longest = header.uncompressed_size.max(body.len() as u64) as usize;
    let mut reader = LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_validate_chunk_crcs(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(longest),
    );
    let head = [&[op::CHUNK][..], &(body.len() as u64).to_le_bytes()].concat();
    let mut from = head.chain(body);
    loop {
        let next = &mut reader;
        match guarded(move || next.next_event())? {
            None => return Ok(()),
            Some(Err(error)) => return Err(error.to_string()),
            Some(Ok(LinearReadEvent::Record { opcode, data })) => take(opcode, data)?,
            Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                let room = reader.insert(wanted.min(body.len() + head.len()));
                let n = from.read(room).map_err(|error| error.to_string())?;
                reader.notify_read(n);
            }
        }
    }
}

/// CRC-32 as MCAP has it (ISO 3309, the polynomial of Ethernet), of what several calls are given: begins with [`Crc::default`].
#[derive(Debug, Clone, Copy, Default)]
pub struct Crc(u32);

impl Crc {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut n = 0;
        while n < 256 {
            let (mut value, mut bit) = (n as u32, 0);
            while bit < 8 {
                value = if value & 1 == 1 { value >> 1 ^ 0xedb8_8320 } else { value >> 1 };
                bit += 1;
            }
            table[n] = value;
            n += 1;
        }
        table
    };

    /// Goes on with these bytes.
    pub fn add(&mut self, bytes: &[u8]) {
        let step = |crc: u32, byte: &u8| Self::TABLE[usize::from(crc as u8 ^ byte)] ^ (crc >> 8);
        self.0 = !bytes.iter().fold(!self.0, step);
    }

    /// The checksum of all bytes so far.
    pub fn sum(self) -> u32 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_the_catalogue() {
        let mut crc = Crc::default();
        crc.add(b"1234");
        crc.add(b"56789");
        // The check value of CRC-32/ISO-HDLC.
        assert_eq!(crc.sum(), 0xcbf4_3926);
    }
}
