//! Memory that a node shares with its process: the first half for what goes there, the second for what comes back.

use std::fs::File;
use std::os::fd::AsRawFd;

use memmap2::MmapMut;
use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, ftruncate, memfd_create};
use serde_json::{Value, json};

/// A file without a name, sealed against another size: a process that cut it short would end this program.
pub(super) struct Shared {
    file: File,
    memory: MmapMut,
    capacity: usize,
}

impl Shared {
    /// For messages of up to `capacity` bytes each way.
    pub fn new(capacity: usize) -> Result<Self, String> {
        let failed = |what: &str, error: &dyn std::fmt::Display| {
            format!("shared memory of 2 × {capacity} bytes: {what}: {error}")
        };
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = memfd_create("foveate", flags).map_err(|error| failed("cannot be made", &error))?;
        ftruncate(&file, 2 * capacity as u64).map_err(|error| failed("cannot be had", &error))?;
        let seals = SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL;
        fcntl_add_seals(&file, seals).map_err(|error| failed("cannot be sealed", &error))?;
        let file = File::from(file);
        #[expect(unsafe_code, reason = "maps memory that another process writes")]
        // SAFETY: the file is sealed, so that it cannot become shorter than the map; bytes are only copied out, after the process has answered, and any
        // bytes are fine.
        let memory = unsafe { MmapMut::map_mut(&file) }.map_err(|error| failed("cannot be mapped", &error))?;
        Ok(Self { file, memory, capacity })
    }

    /// How long a message may be [bytes].
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Puts `bytes` there, of which there are at most [`Shared::capacity`], and says where they are.
    pub fn put(&mut self, bytes: &[u8]) -> Value {
        self.memory[..bytes.len()].copy_from_slice(bytes);
        let path = format!("/proc/{}/fd/{}", std::process::id(), self.file.as_raw_fd());
        json!({
            "path": path,
            "size": 2 * self.capacity,
            "offset": 0,
            "length": bytes.len(),
            "answer": self.capacity,
        })
    }

    /// A copy of `length` bytes at `offset`; `None` where these are not all in it.
    pub fn take(&self, offset: u64, length: u64) -> Option<Vec<u8>> {
        let start = usize::try_from(offset).ok()?;
        let end = start.checked_add(usize::try_from(length).ok()?)?;
        self.memory.get(start..end).map(<[u8]>::to_vec)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_outside_is_not_taken() {
        let mut shared = Shared::new(4).unwrap();
        shared.put(b"abcd");
        assert_eq!(shared.take(1, 2).as_deref(), Some(&b"bc"[..]));
        assert_eq!(shared.take(4, 4).as_deref(), Some(&[0; 4][..]));
        for (offset, length) in [(5, 4), (0, 9), (u64::MAX, 1), (1, u64::MAX), (9, 0)] {
            assert_eq!(shared.take(offset, length), None, "{offset} {length}");
        }
        assert!(ftruncate(&shared.file, 0).is_err(), "the size is sealed");
    }
}
