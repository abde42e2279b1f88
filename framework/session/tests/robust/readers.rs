//! Programs of others read a finished session and a mended one as we do.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use foveate_session::{Packing, Session};

use crate::parts::{Read, folder, messages, write_small};

/// A finished session and three that were cut off and mended, with what we read in them.
fn sessions(folder: &Path) -> Vec<(PathBuf, Vec<Read>)> {
    let mut all = Vec::new();
    for packing in [Packing::None, Packing::Lz4, Packing::Zstd] {
        let path = folder.join(format!("{packing:?}.mcap"));
        write_small(&path, packing, 4, true);
        let bytes = fs::read(&path).unwrap();
        let chunks = Session::open(&path).unwrap().summary.chunks;
        // Within the last chunk; within the indexes behind one; within the summary.
        let end = |n: usize| (chunks[n].chunk_start_offset + chunks[n].chunk_length) as usize;
        for (n, length) in [end(3) - 20, end(2) + 40, bytes.len() - 30].into_iter().enumerate() {
            let cut = folder.join(format!("{packing:?}-{n}.mcap"));
            fs::write(&cut, &bytes[..length]).unwrap();
            let remarks = Session::open(&cut).unwrap().remarks;
            assert!(remarks.last().is_some_and(|it| it.contains("its summary was written")), "{remarks:?}");
            all.push(cut);
        }
        all.push(path);
    }
    let read = |path: PathBuf| {
        let mut session = Session::open(&path).unwrap();
        assert_eq!(session.remarks, Vec::<String>::new());
        let mut read = messages(&mut session).unwrap();
        // Readers go by time.
        read.sort_by_key(|it| it.1);
        (path, read)
    };
    all.into_iter().map(read).collect()
}

/// A line for each message: topic, time, length and a sum of its bytes.
fn lines(messages: &[Read]) -> String {
    let mut text = String::new();
    for (topic, time, bytes) in messages {
        let sum = bytes.iter().fold(0_u64, |sum, it| (sum * 31 + u64::from(*it)) % 1_000_000_007);
        writeln!(text, "{topic} {time} {} {sum}", bytes.len()).unwrap();
    }
    text
}

/// Lines in an order of their own: messages of one time may come in any.
fn sorted(text: &str) -> Vec<&str> {
    let mut lines: Vec<_> = text.lines().collect();
    lines.sort_unstable();
    lines
}

#[test]
fn the_reader_of_the_mcap_crate_reads_the_same() {
    let folder = folder();
    for (path, read) in sessions(folder.path()) {
        let bytes = fs::read(&path).unwrap();
        let options = mcap::read::Options::ValidateChunkCrcs;
        let stream = mcap::MessageStream::new_with_options(&bytes, options.into()).unwrap().map(Result::unwrap);
        let found: Vec<Read> = stream.map(|it| (it.channel.topic.clone(), it.log_time, it.data.into_owned())).collect();
        assert_eq!(sorted(&lines(&found)), sorted(&lines(&read)), "{}", path.display());
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let statistics = summary.stats.as_ref().unwrap();
        assert_eq!(statistics.message_count, read.len() as u64);
        assert_eq!(statistics.chunk_count as usize, summary.chunk_indexes.len());
        let of_chunks = summary.chunk_indexes.iter().flat_map(|it| summary.stream_chunk(&bytes, it).unwrap());
        assert_eq!(of_chunks.map(Result::unwrap).count(), read.len());
        for it in &summary.attachment_indexes {
            mcap::read::attachment(&bytes, it).unwrap();
        }
        for it in &summary.metadata_indexes {
            mcap::read::metadata(&bytes, it).unwrap();
        }
        // By the indexes of messages too, which chunks cut off behind lack.
        for chunk in summary.chunk_indexes.iter().filter(|it| it.message_index_length > 0) {
            let indexes = summary.read_message_indexes(&bytes, chunk).unwrap();
            for (channel, entries) in indexes {
                for entry in entries {
                    let message = summary.seek_message(&bytes, chunk, &entry).unwrap();
                    assert_eq!((&message.channel.topic, message.log_time), (&channel.topic, entry.log_time));
                }
            }
        }
    }
}

#[test]
fn the_python_reader_reads_the_same() {
    let Some(python) = std::env::var_os("FOVEATE_PEER_PYTHON") else {
        return println!("skipped: the reader of others needs FOVEATE_PEER_PYTHON, a python with mcap");
    };
    let folder = folder();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/clients/session_messages.py");
    for (path, read) in sessions(folder.path()) {
        let output = Command::new(&python).arg(script).arg(&path).output().unwrap();
        assert!(output.status.success(), "{}: {}", path.display(), String::from_utf8_lossy(&output.stderr));
        let said = String::from_utf8(output.stdout).unwrap();
        assert_eq!(sorted(&said), sorted(&lines(&read)), "{}", path.display());
    }
}
