//! Lengths that lie: nothing is read beyond the file, and no memory is asked for that the file does not warrant.
#![allow(unsafe_code, reason = "a global allocator cannot be written without it; this one only counts and forwards")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fs;

use foveate_session::{Packing, Session};

use crate::parts::{folder, read, write_small};

thread_local! {
    /// Largest block that this thread asked for [bytes].
    static LARGEST: Cell<usize> = const { Cell::new(0) };
}

struct Watching;

#[global_allocator]
static ALLOCATOR: Watching = Watching;

fn watch(bytes: usize) {
    let _ = LARGEST.try_with(|it| it.set(it.get().max(bytes)));
}

// SAFETY: every call is passed on to the system's allocator unchanged; watching touches no memory of the caller.
unsafe impl GlobalAlloc for Watching {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        watch(layout.size());
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        watch(layout.size());
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        watch(size);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

/// Every place of a file gets lengths that lie; the largest block that was asked for meanwhile [bytes].
fn largest_block(packing: Packing, is_finished: bool) -> (usize, usize) {
    let folder = folder();
    let path = folder.path().join("small.mcap");
    let graph = write_small(&path, packing, 2, is_finished);
    let bytes = fs::read(&path).unwrap();
    let damaged = folder.path().join("damaged.mcap");
    LARGEST.set(0);
    for at in (8..bytes.len() - 8).step_by(11) {
        // 1 GiB and 2⁶³ as lengths of records and sizes of chunks, 4 GiB as that of texts and maps.
        for (value, n) in [(1_u64 << 30, 8), (1 << 63, 8), (u64::from(u32::MAX), 4)] {
            let mut bytes = bytes.clone();
            bytes[at..at + n].copy_from_slice(&value.to_le_bytes()[..n]);
            fs::write(&damaged, bytes).unwrap();
            drop(read(&damaged, &graph));
        }
    }
    (LARGEST.get(), bytes.len())
}

#[test]
fn no_length_that_lies_asks_for_memory_beyond_what_the_bytes_can_hold() {
    for (packing, is_finished, per_byte) in
        [(Packing::None, true, 1), (Packing::Lz4, true, 255), (Packing::Lz4, false, 255), (Packing::Zstd, true, 32768)]
    {
        let (largest, length) = largest_block(packing, is_finished);
        println!("{packing:?}, {length} bytes: the largest block was of {largest}");
        // What is searched behind damage and read ahead of a decoder has sizes of its own.
        assert!(largest <= (1 << 20).max(per_byte * length), "{packing:?}: {largest}");
    }
}

/// A session of one chunk whose header says another size unpacked than there is.
#[test]
fn a_chunk_of_another_size_than_announced_is_told() {
    let folder = folder();
    for packing in [Packing::None, Packing::Lz4, Packing::Zstd] {
        let path = folder.path().join("x.mcap");
        let _ = fs::remove_file(&path); // of the packing before
        let graph = write_small(&path, packing, 1, true);
        let whole = fs::read(&path).unwrap();
        let session = Session::open(&path).unwrap();
        let chunk = session.summary.chunks.iter().max_by_key(|it| it.uncompressed_size).unwrap();
        let start = chunk.chunk_start_offset as usize;
        for size in [0, 1, chunk.uncompressed_size - 1, chunk.uncompressed_size + 1, 1 << 30, u64::MAX] {
            let mut bytes = whole.clone();
            bytes[start + 25..start + 33].copy_from_slice(&size.to_le_bytes());
            fs::write(&path, &bytes).unwrap();
            let (_, _, error) = read(&path, &graph);
            let sentence = error.unwrap();
            assert!(sentence.contains(&format!("is damaged at byte {start}: ")), "{packing:?} {size}: {sentence}");
            // Without a summary to compare with.
            fs::write(&path, &bytes[..whole.len() - 9]).unwrap();
            let (remarks, _, _) = read(&path, &graph);
            assert!(
                remarks.iter().any(|it| it.starts_with(&format!("byte {start}: a chunk is damaged"))),
                "{remarks:?}"
            );
        }
    }
}

/// Without a checksum nothing stops a record within a chunk from announcing any length.
#[test]
fn a_record_within_a_chunk_asks_for_no_more_than_the_chunk_holds() {
    let folder = folder();
    let path = folder.path().join("small.mcap");
    let graph = write_small(&path, Packing::Lz4, 1, true);
    let bytes = fs::read(&path).unwrap();
    let chunks = Session::open(&path).unwrap().summary.chunks;
    let chunk = chunks.iter().max_by_key(|it| it.uncompressed_size).unwrap();
    let (start, end) = (chunk.chunk_start_offset as usize, (chunk.chunk_start_offset + chunk.chunk_length) as usize);
    LARGEST.set(0);
    for at in start + 52..end {
        for mask in [1, 0x10, 0xff] {
            let mut bytes = bytes.clone();
            bytes[start + 33..start + 37].fill(0);
            bytes[at] ^= mask;
            fs::write(&path, bytes).unwrap();
            assert!(read(&path, &graph).2.is_some());
        }
    }
    assert!(LARGEST.get() <= 1 << 20, "{}", LARGEST.get());
}
