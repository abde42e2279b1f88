//! Bytes that are not as they were written: either all is read as it was, or a sentence says what is wrong.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use foveate_rig::graph::Graph;
use foveate_session::attach::{File, unpack};
use foveate_session::{Packing, Session};

use crate::parts::{Content, Random, folder, graph, read, record, write_small};

/// A small session, and what is in it.
struct Small {
    folder: tempfile::TempDir,
    graph: Arc<Graph>,
    bytes: Vec<u8>,
    content: Content,
    n_remarks: usize,
}

impl Small {
    fn new(packing: Packing, n_chunks: usize, is_finished: bool) -> Small {
        let folder = folder();
        let path = folder.path().join("small.mcap");
        let graph = write_small(&path, packing, n_chunks, is_finished);
        let bytes = fs::read(&path).unwrap();
        let (remarks, content, error) = read(&path, &graph);
        assert_eq!(error, None);
        assert!(content.events.len() > 20 && content.files.len() >= 3 && content.end.is_some() == is_finished);
        Small { folder, graph, bytes, content, n_remarks: remarks.len() }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("damaged.mcap")
    }

    /// What is read of these bytes in place of the file's. Its remarks do not count those of the undamaged file.
    fn read(&self, bytes: &[u8]) -> (Vec<String>, Content, Option<String>) {
        let path = self.path();
        fs::write(&path, bytes).unwrap();
        read(&path, &self.graph)
    }

    /// That `bytes` are read as the undamaged file is, or that a sentence says why not; which of them.
    #[track_caller]
    fn check(&self, bytes: &[u8], what: &str) -> Outcome {
        let (remarks, content, error) = self.read(bytes);
        if let Some(sentence) = error {
            assert!(sentence.contains("damaged.mcap"), "{what}: {sentence}");
            assert!(self.content.events.starts_with(&content.events), "{what}: {sentence}");
            return Outcome::Refused(sentence);
        }
        if remarks.len() > self.n_remarks {
            // What is left is in order, and was there before.
            assert!(self.content.events.starts_with(&content.events), "{what}: {remarks:?}");
            if remarks.last().is_some_and(|it| it.contains("its summary was written")) {
                let (again, second, error) = read(&self.path(), &self.graph);
                assert_eq!((again, error), (Vec::new(), None), "{what}");
                assert!(second == content, "{what}");
            }
            return Outcome::Told(remarks);
        }
        let Content { facts, end, files, events } = &self.content;
        assert!(*events == content.events, "{what}: {remarks:?}");
        assert!(*files == content.files && holds(&content.facts, facts), "{what}");
        match (&content.end, end) {
            (Some(found), Some(expected)) => assert!(holds(found, expected), "{what}"),
            (found, expected) => assert_eq!(found, expected, "{what}"),
        }
        Outcome::Same
    }
}

fn holds(found: &BTreeMap<String, String>, expected: &BTreeMap<String, String>) -> bool {
    expected.iter().all(|(key, value)| found.get(key) == Some(value))
}

#[derive(Debug)]
enum Outcome {
    Same,
    Told(Vec<String>),
    Refused(String),
}

/// Flips bits of each `step`th byte of a file; how many flips were reported and how many refused, and the bytes whose flips had no effect.
fn flip_all(small: &Small, step: usize, masks: &[u8]) -> ([usize; 2], Vec<usize>) {
    let (mut counts, mut same) = ([0; 2], Vec::new());
    for at in (0..small.bytes.len()).step_by(step) {
        for mask in masks {
            let mask = mask.rotate_left(at as u32 % 8);
            let mut bytes = small.bytes.clone();
            bytes[at] ^= mask;
            match small.check(&bytes, &format!("byte {at} ^ {mask:#04x} of {}", bytes.len())) {
                Outcome::Same => same.push(at),
                Outcome::Told(_) => counts[0] += 1,
                Outcome::Refused(_) => counts[1] += 1,
            }
        }
    }
    println!("{} bytes: {} flips without effect, {counts:?} reported and refused", small.bytes.len(), same.len());
    (counts, same)
}

#[test]
fn any_flipped_byte_of_a_finished_file_changes_nothing_or_is_told() {
    for (packing, step, masks) in [(Packing::Lz4, 1, &[1][..]), (Packing::None, 3, &[0xff]), (Packing::Zstd, 3, &[1])] {
        let small = Small::new(packing, 3, true);
        let (counts, same) = flip_all(&small, step, masks);
        assert!(counts.iter().all(|it| *it > 400), "{counts:?}");
        // A flip without effect is where nothing stands that we read: the header, the indexes of messages, the checksum of the data that we
        // do not write, and what is compressed: other bytes may unpack to the same, whose checksum is compared.
        let summary = Session::open(&small.folder.path().join("small.mcap")).unwrap().summary;
        let first = summary.metadata.iter().map(|it| it.offset).min().unwrap();
        let data_end = u64::from_le_bytes(small.bytes[small.bytes.len() - 28..][..8].try_into().unwrap()) - 13;
        let is_read = |at: u64| {
            let is_index = summary.chunks.iter().any(|it| {
                let end = it.chunk_start_offset + it.chunk_length;
                (end..end + it.message_index_length).contains(&at)
            });
            let is_compressed = packing != Packing::None
                && summary.chunks.iter().any(|it| {
                    let head = 49 + it.compression.len() as u64;
                    (it.chunk_start_offset + head..it.chunk_start_offset + it.chunk_length).contains(&at)
                });
            at >= first && !is_index && !is_compressed && !(data_end + 9..data_end + 13).contains(&at)
        };
        let read: Vec<usize> = same.into_iter().filter(|it| is_read(*it as u64)).collect();
        // (Without its name the checksum of metadata is one text more.)
        let texts: Vec<String> =
            read.iter().map(|it| String::from_utf8_lossy(&small.bytes[it - 4..it + 5]).into_owned()).collect();
        assert!(texts.iter().all(|it| it.contains('c') && it.contains("rc")), "{packing:?}: {read:?} {texts:?}");
    }
}

#[test]
fn any_flipped_byte_of_an_unfinished_file_changes_nothing_or_is_told() {
    let small = Small::new(Packing::Lz4, 3, false);
    let (counts, same) = flip_all(&small, 2, &[1]);
    assert!(counts.iter().all(|it| *it > 500) && same.len() < 1000, "{counts:?} {}", same.len());
}

#[test]
fn a_damaged_chunk_in_the_middle_is_named_by_its_byte() {
    let small = Small::new(Packing::Lz4, 4, true);
    let session = Session::open(&small.folder.path().join("small.mcap")).unwrap();
    let chunk = session.summary.chunks[2].clone();
    let mut bytes = small.bytes.clone();
    bytes[(chunk.chunk_start_offset + chunk.chunk_length / 2) as usize] ^= 4;
    let (remarks, content, error) = small.read(&bytes);
    assert_eq!(remarks, Vec::<String>::new());
    let sentence = error.unwrap();
    assert!(sentence.contains(&format!("is damaged at byte {}: ", chunk.chunk_start_offset)), "{sentence}");
    // What came before it is played, and nothing of it.
    assert!(small.content.events.starts_with(&content.events) && content.events.len() < small.content.events.len());
}

#[test]
fn a_checksum_of_zero_is_compared_too() {
    let small = Small::new(Packing::None, 2, true);
    let summary = Session::open(&small.folder.path().join("small.mcap")).unwrap().summary;
    let chunk = summary.chunks.last().unwrap();
    let (start, end) = (chunk.chunk_start_offset as usize, (chunk.chunk_start_offset + chunk.chunk_length) as usize);
    let mut bytes = small.bytes.clone();
    bytes[start + 33..start + 37].fill(0);
    bytes[end - 1] ^= 1;
    let Outcome::Refused(sentence) = small.check(&bytes, "chunk") else { panic!("a chunk without a checksum is read") };
    assert!(sentence.contains(&format!("is damaged at byte {start}: found no checksum, expected ")), "{sentence}");
    let file = &summary.attachments[0];
    let end = (file.offset + file.length) as usize;
    let mut bytes = small.bytes.clone();
    bytes[end - 8..end].fill(0);
    let Outcome::Refused(sentence) = small.check(&bytes, "file") else { panic!("a file without a checksum is read") };
    assert!(sentence.contains("found no checksum of the file"), "{sentence}");
}

#[test]
fn files_that_are_no_sessions_are_refused_with_what_they_are() {
    let folder = folder();
    let path = folder.path().join("x.mcap");
    let refused = |path: &Path| Session::open(path).err().unwrap();
    for (bytes, part) in [
        (&b""[..], "is empty"),
        (b"\x89", "is no MCAP file: it begins with [89]"),
        (b"ply\nformat ascii", "is no MCAP file: it begins with"),
        (foveate_session::records::MAGIC, "is an MCAP file, but no session"),
    ] {
        fs::write(&path, bytes).unwrap();
        let sentence = refused(&path);
        assert!(sentence.contains(part) && sentence.contains("x.mcap"), "{sentence}");
        assert!(fs::read(&path).unwrap() == bytes);
    }
    assert!(refused(folder.path()).contains("is no file"));
    assert!(refused(&folder.path().join("none.mcap")).contains("cannot be read"));
    // Another program's file is left as it is, finished or not.
    let mut other = mcap::Writer::new(std::io::Cursor::new(Vec::new())).unwrap();
    let channel = other.add_channel(0, "/x", "json", &BTreeMap::new()).unwrap();
    let header = mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 1, publish_time: 1 };
    other.write_to_known_channel(&header, b"{}").unwrap();
    other.finish().unwrap();
    let whole = other.into_inner().into_inner();
    for length in [whole.len(), whole.len() - 1, whole.len() / 2, 40] {
        fs::write(&path, &whole[..length]).unwrap();
        let sentence = refused(&path);
        assert!(sentence.contains("it has no metadata `foveate.session`"), "{sentence}");
        assert!(fs::read(&path).unwrap() == whole[..length]);
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_is_refused_and_not_waited_for() {
    let folder = folder();
    let path = folder.path().join("pipe.mcap");
    let made = std::process::Command::new("mkfifo").arg(&path).status();
    if !made.is_ok_and(|it| it.success()) {
        return println!("skipped: this machine has no mkfifo");
    }
    assert!(Session::open(&path).err().unwrap().contains("is no file"));
}

#[test]
fn other_versions_are_refused_and_not_written() {
    let folder = folder();
    let path = folder.path().join("x.mcap");
    for version in ["2", "0", "one", "", "4294967296"] {
        let mut file = foveate_session::file::SessionFile::create(&path, Packing::None).unwrap();
        let facts = [("version", version), ("program", "9.9.9")].map(|it| (it.0.to_owned(), it.1.to_owned()));
        file.metadata("foveate.session", facts.into()).unwrap();
        file.flush().unwrap();
        let unfinished = fs::read(&path).unwrap();
        file.finish().unwrap();
        for bytes in [fs::read(&path).unwrap(), unfinished] {
            fs::write(&path, &bytes).unwrap();
            let sentence = Session::open(&path).err().unwrap();
            let part = format!("is a session of version `{version}`, written by foveate 9.9.9; this program");
            assert!(sentence.contains(&part) && sentence.ends_with("reads versions to 1"), "{sentence}");
            assert!(fs::read(&path).unwrap() == bytes);
        }
        fs::remove_file(&path).unwrap();
    }
}

#[test]
fn summaries_that_point_elsewhere_or_in_circles_are_gathered_anew() {
    let small = Small::new(Packing::Lz4, 3, true);
    let n = small.bytes.len();
    let footer = n - 28;
    for start in [1_u64, 8, 100, footer as u64, n as u64, n as u64 + 5, u64::MAX] {
        let mut bytes = small.bytes.clone();
        bytes[footer..footer + 8].copy_from_slice(&start.to_le_bytes());
        let Outcome::Told(remarks) = small.check(&bytes, &start.to_string()) else { panic!("{start}") };
        assert!(remarks[0].contains("its summary is damaged"), "{remarks:?}");
        let (_, content, error) = read(&small.path(), &small.graph);
        assert_eq!(error, None);
        assert!(content.events == small.content.events && content.end == small.content.end);
    }
}

/// The same file with another summary, whose checksum is right.
fn with_summary(small: &Small, change: impl FnOnce(&mut foveate_session::summary::Summary)) -> Vec<u8> {
    let mut summary = Session::open(&small.folder.path().join("small.mcap")).unwrap().summary;
    change(&mut summary);
    let start = u64::from_le_bytes(small.bytes[small.bytes.len() - 28..][..8].try_into().unwrap()) - 13;
    let mut bytes = small.bytes[..start as usize].to_vec();
    summary.write(start, &mut bytes).unwrap();
    bytes
}

#[test]
fn summaries_that_lie_are_told() {
    let small = Small::new(Packing::Lz4, 3, true);
    assert!(matches!(small.check(&with_summary(&small, |_| ()), "as it is"), Outcome::Same));
    let reported = |change: &dyn Fn(&mut foveate_session::summary::Summary), part: &str| match small
        .check(&with_summary(&small, change), part)
    {
        Outcome::Told(it) => assert!(it.iter().any(|it| it.contains(part)), "{part}: {it:?}"),
        Outcome::Refused(it) => assert!(it.contains(part), "{part}: {it}"),
        Outcome::Same => panic!("{part}: nothing was reported"),
    };
    reported(&|it| drop(it.chunks.remove(1)), "the summary lacks a record that is there");
    reported(&|it| drop(it.attachments.remove(0)), "the summary lacks a record that is there");
    reported(&|it| drop(it.metadata.pop()), "the summary lacks a record that is there");
    reported(&|it| it.chunks[2] = it.chunks[1].clone(), "its summary is damaged");
    reported(&|it| it.chunks[2].chunk_start_offset = 1 << 60, "its summary is damaged");
    reported(&|it| it.chunks[2].chunk_length = u64::MAX, "its summary is damaged");
    reported(&|it| it.chunks[1].uncompressed_size += 1, "by the summary (length");
    reported(&|it| it.chunks[1].message_end_time += 1, "by the summary (length");
    reported(&|it| it.counts.values_mut().for_each(|it| *it += 1), "by its summary");
    reported(&|it| it.attachments[0].name = "other".to_owned(), "holds another file than `other`");
    reported(&|it| it.metadata[0].name = "foveate.end".to_owned(), "no metadata `foveate.session`");
}

#[test]
fn what_a_session_unpacks_stays_in_its_folder() {
    let folder = folder();
    let inside = folder.path().join("inside");
    fs::create_dir(&inside).unwrap();
    let file = |name: &str, bytes: &[u8]| File { name: name.to_owned(), bytes: bytes.to_vec(), is_program: true };
    for name in ["files/../../x", "files/../x", "files//x", "files/a/../../x", "files/"] {
        let refused = unpack(&[file(name, b"bad")], &inside);
        let sentence = refused.unwrap_err();
        assert!(sentence.contains("written"), "{name}: {sentence}");
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|it| it.unwrap().file_name()).collect();
        assert_eq!(left, ["inside"]);
    }
    unpack(&[file("files/./a/b", b"good"), file("graph.json", b"")], &inside).unwrap();
    assert_eq!(fs::read(inside.join("a/b")).unwrap(), b"good");
    #[cfg(unix)]
    assert_eq!(
        std::os::unix::fs::PermissionsExt::mode(&fs::metadata(inside.join("a/b")).unwrap().permissions()) & 0o111,
        0o111
    );
    assert!(!inside.join("graph.json").exists());
}

#[test]
fn an_event_that_is_missing_from_a_finished_file_is_told() {
    let folder = folder();
    let (first, path) = (folder.path().join("first.mcap"), folder.path().join("x.mcap"));
    let graph = graph("");
    record(&first, &graph, Packing::Lz4, false);
    let all = read(&first, &graph).1.events;
    for missing in [0, 7, 20] {
        let mut again = crate::parts::Rewriting::begin(&first, &path, Packing::Lz4);
        let mut messages = again.messages.clone();
        let order = messages.iter().enumerate().filter(|it| it.1.0 == "/foveate/order").nth(missing).unwrap().0;
        let number = foveate_session::order::decode(&messages.remove(order).2).unwrap()[0].order as usize;
        again.write(&messages);
        again.finish();
        let (_, content, error) = read(&path, &graph);
        assert!(content.events == all[..number]);
        let sentence = error.unwrap();
        assert!(sentence.contains(&format!("lacks event {number} of its order of delivery")), "{sentence}");
        fs::remove_file(&path).unwrap();
    }
}

#[test]
fn a_message_that_is_missing_is_told() {
    let folder = folder();
    let (first, path) = (folder.path().join("first.mcap"), folder.path().join("x.mcap"));
    let graph = graph("");
    record(&first, &graph, Packing::Lz4, false);
    let mut again = crate::parts::Rewriting::begin(&first, &path, Packing::Lz4);
    let topic = "/room/a/readings";
    let last = again.messages.iter().rposition(|it| it.0 == topic).unwrap();
    let mut messages = again.messages.clone();
    messages.remove(last);
    again.write(&messages);
    again.finish();
    let sentence = read(&path, &graph).2.unwrap();
    assert!(sentence.contains("`readings` of room.a at") && sentence.contains("is not in the recording"), "{sentence}");
    // Without any, there is not even the channel.
    fs::remove_file(&path).unwrap();
    let mut again = crate::parts::Rewriting::begin(&first, &path, Packing::Lz4);
    let messages: Vec<_> = again.messages.iter().filter(|it| it.0 != topic).cloned().collect();
    again.write(&messages);
    again.finish();
    let sentence = read(&path, &graph).2.unwrap();
    assert!(sentence.contains("`readings` of room.a at") && sentence.contains("is not in the recording"), "{sentence}");
}

#[test]
fn many_random_changes_are_survived() {
    let small = Small::new(Packing::Zstd, 3, true);
    let mut random = Random(5);
    for n in 0..500 {
        let bytes = crate::changes::changed(&small.bytes, &mut random);
        small.check(&bytes, &format!("mutation {n}"));
    }
}
