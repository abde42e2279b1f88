//! The records of an MCAP file, one by one and without trust: whatever the bytes say, nothing is read beyond the file or the memory.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use foveate_node::guard::guarded;
use mcap::records::{ChunkHeader, Record};

/// Magic bytes at both ends of a file.
pub const MAGIC: &[u8] = mcap::MAGIC;
/// Opcode and length in front of each record [bytes].
pub const HEAD: u64 = 9;
/// Longest record that is read [bytes].
const LONGEST: u64 = 1 << 30;

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
        let mut file = File::open(path).map_err(failed)?;
        let facts = file.metadata().map_err(failed)?;
        if !facts.is_file() {
            return Err(format!("`{shown}` is no file, expected a session (MCAP)"));
        }
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

    /// The next record whose opcode `wanted` accepts, with its body; the others are passed over. `None` at the end of the file.
    ///
    /// # Errors
    /// The first place from which the file cannot be read on.
    pub fn next(&mut self, wanted: impl Fn(u8) -> bool) -> Result<Option<(Place, &[u8])>, Damage> {
        loop {
            let at = self.at;
            let damage = |what: String| Damage { at, what };
            if at == self.length || self.is_end(at) {
                return Ok(None);
            }
            let mut head = [0; HEAD as usize];
            if self.length - at < HEAD {
                return Err(damage(format!("the file ends {} bytes into a record", self.length - at)));
            }
            self.file.read_exact(&mut head).map_err(|error| damage(error.to_string()))?;
            let [opcode, length @ ..] = head;
            let length = u64::from_le_bytes(length);
            if opcode == 0 || length > self.length - at - HEAD {
                return Err(damage(match opcode {
                    0 => "found no record".to_owned(),
                    _ => format!("a record of {length} bytes ends beyond the file"),
                }));
            }
            self.at = at + HEAD + length;
            if !wanted(opcode) {
                self.file.seek(SeekFrom::Start(self.at)).map_err(|error| damage(error.to_string()))?;
                continue;
            }
            if length > LONGEST {
                return Err(damage(format!("found a record of {length} bytes, expected at most {LONGEST}")));
            }
            self.body.resize(length as usize, 0);
            self.file.read_exact(&mut self.body).map_err(|error| damage(error.to_string()))?;
            return Ok(Some((Place { at, opcode }, &self.body)));
        }
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

/// Reads the body of a record.
///
/// # Errors
/// What is wrong with it.
pub fn parse(opcode: u8, body: &[u8]) -> Result<Record<'_>, String> {
    // The reader trusts lengths in a few places.
    guarded(|| mcap::parse_record(opcode, body)).and_then(|it| it.map_err(|error| error.to_string()))
}

/// The records of a chunk; its checksum is compared at the end.
///
/// # Errors
/// What is wrong with it.
pub fn in_chunk(
    header: ChunkHeader,
    data: &[u8],
    mut take: impl FnMut(Record<'_>) -> Result<(), String>,
) -> Result<(), String> {
    if header.uncompressed_size > LONGEST {
        return Err(format!("found a chunk of {} bytes, expected at most {LONGEST}", header.uncompressed_size));
    }
    let mut reader = mcap::read::ChunkReader::new(header, data).map_err(|error| error.to_string())?;
    while let Some(record) = guarded(|| reader.next())? {
        take(record.map_err(|error| error.to_string())?)?;
    }
    Ok(())
}
