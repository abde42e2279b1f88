//! A recorder is killed, or the power fails: what was written in whole chunks is there, and the file is mended in place.

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use foveate_session::{Packing, Session, order};

use crate::parts::{Random, Read, Rewriting, folder, graph, messages, read, record, write_small};

/// What a recording may lose at most [s]: a flush each quarter of a second, and as much for a slow disk.
const LOSS_S: f64 = 0.5;

/// Messages and remarks of a file, which is mended when it is opened.
#[track_caller]
fn open(path: &Path) -> (Vec<Read>, Vec<String>) {
    let mut session = Session::open(path).unwrap_or_else(|sentence| panic!("{sentence}"));
    let read = messages(&mut session).unwrap();
    let counts: u64 = session.summary.counts.values().sum();
    assert_eq!(counts, read.len() as u64);
    (read, session.remarks)
}

/// Opens a file that was cut off: it is mended, and the second time it is as finished ones are.
#[track_caller]
fn open_twice(path: &Path) -> Vec<Read> {
    let (first, remarks) = open(path);
    assert!(remarks[0].contains("did not end in good order"), "{remarks:?}");
    assert!(remarks.last().unwrap().contains("its summary was written"), "{remarks:?}");
    let (second, remarks) = open(path);
    assert_eq!(remarks, Vec::<String>::new());
    assert!(first == second);
    first
}

/// Which messages of `whole` lie in chunks that end at or before `length`.
fn whole_chunks(session: &mut Session, length: u64) -> usize {
    let mut n = 0;
    for chunk in 0..session.summary.chunks.len() {
        let it = &session.summary.chunks[chunk];
        if it.chunk_start_offset + it.chunk_length <= length {
            let count = |_, _, _: &[u8]| {
                n += 1;
                Ok(())
            };
            session.messages(chunk, count).unwrap();
        }
    }
    n
}

/// Where the first chunk with messages begins: before that there may be no session yet.
fn begins(session: &Session) -> u64 {
    session.summary.chunks[0].chunk_start_offset
}

/// What a power cut may leave behind the last whole record.
#[derive(Debug, Clone, Copy)]
enum Tail {
    None,
    Zeros,
    Noise,
}

#[test]
fn every_cut_keeps_the_messages_of_all_whole_chunks() {
    let folder = folder();
    for (packing, seed) in [(Packing::None, 1), (Packing::Lz4, 2), (Packing::Zstd, 3)] {
        let path = folder.path().join(format!("{seed}.mcap"));
        write_small(&path, packing, 9, true);
        let bytes = fs::read(&path).unwrap();
        let mut original = Session::open(&path).unwrap();
        assert_eq!((original.summary.chunks.len() > 6, original.remarks.len()), (true, 0));
        let all = messages(&mut original).unwrap();
        let first = begins(&original) as usize;
        let mut random = Random(seed);
        for n in 0..120 {
            let length = first + random.below(bytes.len() - first);
            let tail = [Tail::None, Tail::Zeros, Tail::Noise][n % 3];
            let mut cut = bytes[..length].to_vec();
            let n_tail = random.below(20_000);
            cut.extend((0..n_tail).filter_map(|_| match tail {
                Tail::None => None,
                Tail::Zeros => Some(0),
                Tail::Noise => Some(random.below(256) as u8),
            }));
            let copy = folder.path().join("cut.mcap");
            fs::write(&copy, &cut).unwrap();
            let found = open_twice(&copy);
            // A tail of zeros may be what stood there.
            let same = cut.iter().zip(&bytes).take_while(|(a, b)| a == b).count();
            // The last bytes of a frame of LZ4 are its own checksum, which says nothing beyond that of the chunk.
            let frame_end = if packing == Packing::Lz4 { 8 } else { 0 };
            let expected = [same, same + frame_end].map(|it| whole_chunks(&mut original, it as u64));
            let is_as_expected = expected.contains(&found.len()) && all.starts_with(&found);
            assert!(is_as_expected, "seed {seed}, cut {n} at {length}, {tail:?}: {} {expected:?}", found.len());
        }
    }
}

#[test]
fn a_file_cut_at_any_length_is_mended_or_refused_with_a_reason() {
    let folder = folder();
    let path = folder.path().join("whole.mcap");
    let graph = write_small(&path, Packing::Lz4, 3, true);
    let bytes = fs::read(&path).unwrap();
    let mut original = Session::open(&path).unwrap();
    let all = messages(&mut original).unwrap();
    let events = read(&path, &graph).1.events;
    let copy = folder.path().join("cut.mcap");
    let mut n_refused = 0;
    for length in 0..bytes.len() {
        fs::write(&copy, &bytes[..length]).unwrap();
        match Session::open(&copy) {
            Err(sentence) => {
                assert!(sentence.contains("cut.mcap") && length < begins(&original) as usize, "{length}: {sentence}");
                // What cannot be read is not touched.
                assert!(fs::read(&copy).unwrap() == bytes[..length]);
                n_refused += 1;
            }
            Ok(mut session) => {
                assert!(!session.remarks.is_empty(), "{length}");
                let found = messages(&mut session).unwrap();
                assert!(found == all[..whole_chunks(&mut original, length as u64)], "{length}");
                let (remarks, content, error) = read(&copy, &graph);
                assert_eq!(remarks, Vec::<String>::new(), "{length}");
                match error {
                    None => assert!(length >= begins(&original) as usize),
                    Some(sentence) => assert!(sentence.contains("holds no order of delivery"), "{length}: {sentence}"),
                }
                assert!(events.starts_with(&content.events), "{length}");
            }
        }
    }
    assert!(n_refused > 100, "{n_refused}");
}

#[test]
fn a_killed_recorder_loses_at_most_half_a_second() {
    let folder = folder();
    let path = folder.path().join("growing.mcap");
    let graph = graph("count = 500\nsize = 3000\nrate_hz = 200");
    let began = Instant::now();
    let copies = {
        let (folder, path) = (folder.path().to_owned(), path.clone());
        std::thread::spawn(move || {
            let mut random = Random(11);
            let mut copies = Vec::new();
            let mut moments: Vec<u64> = (0..20).map(|_| 200 + random.below(2200) as u64).collect();
            moments.sort_unstable();
            for (n, moment) in moments.into_iter().enumerate() {
                std::thread::sleep(Duration::from_millis(moment).saturating_sub(began.elapsed()));
                let copy = folder.join(format!("{n}.mcap"));
                let at = began.elapsed();
                while fs::copy(&path, &copy).is_err() {
                    std::thread::sleep(Duration::from_millis(5));
                }
                copies.push((copy, at));
            }
            copies
        })
    };
    record(&path, &graph, Packing::Lz4, true);
    let (all, remarks) = open(&path);
    assert_eq!(remarks, Vec::<String>::new());
    let events = |messages: &[Read]| -> Vec<f64> {
        let orders = messages.iter().filter(|it| it.0 == foveate_session::names::ORDER);
        orders.flat_map(|it| order::decode(&it.2).unwrap()).map(|it| it.now.0 as f64 * 1e-9).collect()
    };
    for (copy, at) in copies.join().unwrap() {
        let found = open_twice(&copy);
        assert!(all.starts_with(&found), "{at:?}");
        let last = events(&found).into_iter().fold(0.0, f64::max);
        // The run began after `began`, and a machine that tests share may be late.
        assert!(at.as_secs_f64() - last < LOSS_S + 2.0, "{at:?}, and the last event is of {last} s");
        assert!(last < at.as_secs_f64());
        let (_, content, error) = read(&copy, &graph);
        assert_eq!(error, None);
        // All but what happened at the last moment can be played.
        let expected = events(&all).iter().filter(|it| **it < last - 0.3).count();
        assert!(content.events.len() >= expected, "{} events to {last} s, expected {expected}", content.events.len());
    }
}

#[test]
fn a_file_that_grows_is_read_and_left_alone() {
    let folder = folder();
    let (first, path) = (folder.path().join("first.mcap"), folder.path().join("growing.mcap"));
    let graph = graph("");
    record(&first, &graph, Packing::Lz4, false);
    let mut growing = Rewriting::begin(&first, &path, Packing::Lz4);
    let all = growing.messages.clone();
    let half = all.len() / 2;
    growing.write(&all[..half]);
    growing.file.flush().unwrap();
    let before = fs::read(&path).unwrap();
    let (found, remarks) = open(&path);
    assert!(found == all[..half]);
    assert_eq!(remarks, ["it is still being recorded: this is what it holds so far"]);
    assert!(fs::read(&path).unwrap() == before);
    // Another recorder is refused, and does no harm.
    let refused = foveate_session::Recorder::begin(
        &Arc::clone(&graph),
        &crate::parts::recording(&path, Packing::Lz4),
        foveate_node::Host::default(),
    );
    let sentence = refused.err().unwrap();
    assert!(sentence.contains("growing.mcap") && sentence.contains("exists"), "{sentence}");
    growing.write(&all[half..]);
    growing.finish();
    let (found, remarks) = open(&path);
    assert!(found == all);
    assert_eq!(remarks, Vec::<String>::new());
}

#[test]
fn an_unfinished_file_marked_read_only_is_read_and_not_written() {
    let folder = folder();
    let path = folder.path().join("unfinished.mcap");
    write_small(&path, Packing::Lz4, 3, false);
    let before = fs::read(&path).unwrap();
    let mut permissions = fs::metadata(&path).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(&path, permissions).unwrap();
    for _ in 0..2 {
        let (found, remarks) = open(&path);
        assert!(found.len() > 10);
        assert!(remarks[0].contains("did not end in good order"), "{remarks:?}");
        assert!(remarks[1].contains("could not be written"), "{remarks:?}");
        assert!(fs::read(&path).unwrap() == before);
    }
}
