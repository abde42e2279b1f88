//! Files changed at random, for a moment or for hours, and events and messages changed behind checksums that are right.

use std::fs;
use std::sync::Arc;
use std::time::{Duration, Instant};

use foveate_engine::{self as engine, Options, Source};
use foveate_node::guard::guarded;
use foveate_session::{Packing, Player, Session, order, replay};
use proptest::prelude::*;

use crate::changes::changed;
use crate::parts::{Random, Rewriting, folder, graph, read, record, survive, write_small};

/// Runs changes of the seeds `from` on for so long; how many.
fn run_for(time: Duration, from: u64) -> u64 {
    let folder = folder();
    let path = folder.path().join("changed.mcap");
    let wholes =
        [(Packing::Lz4, true), (Packing::Lz4, false), (Packing::None, true), (Packing::Zstd, true)].map(|it| {
            let path = folder.path().join(format!("{it:?}.mcap"));
            let graph = write_small(&path, it.0, 3, it.1);
            let bytes = fs::read(&path).unwrap();
            (bytes, read(&path, &graph).1, graph)
        });
    let began = Instant::now();
    let mut seed = from;
    while began.elapsed() < time {
        let (bytes, whole, graph) = &wholes[seed as usize % wholes.len()];
        fs::write(&path, changed(bytes, &mut Random(seed | 1 << 40))).unwrap();
        if let Err(what) = guarded(|| survive(&path, graph, whole)) {
            panic!("seed {seed}: {what}");
        }
        seed += 1;
        if seed.is_multiple_of(50_000) {
            println!("seed {seed}");
        }
    }
    seed - from
}

/// For longer, where a person wants it: `FOVEATE_SESSION_MINUTES=10 cargo test -p foveate-session --test robust random -- --nocapture`.
#[test]
fn random_changes_are_survived() {
    let number = |name: &str| std::env::var(name).ok().and_then(|it| it.parse().ok());
    let time = number("FOVEATE_SESSION_MINUTES").map_or(Duration::from_secs(3), |it| Duration::from_secs(60 * it));
    let seed = number("FOVEATE_SESSION_SEED").unwrap_or(1_000_000_000);
    let n_files = run_for(time, seed);
    println!("{n_files} changed files from seed {seed} on");
    assert!(n_files > 10);
}

/// A session whose order of delivery or messages are other bytes, with checksums that are right: opened, played and replayed.
fn replay_changed(seed: u64) {
    let folder = folder();
    let (first, path) = (folder.path().join("first.mcap"), folder.path().join("x.mcap"));
    let graph = graph("");
    record(&first, &graph, Packing::None, false);
    let mut again = Rewriting::begin(&first, &path, Packing::None);
    let mut messages = again.messages.clone();
    let mut random = Random(seed | 1 << 40);
    for _ in 0..1 + random.below(3) {
        let n = random.below(messages.len());
        messages[n].2 = changed(&messages[n].2, &mut random);
    }
    again.write(&messages);
    again.finish();
    let session = Session::open(&path).unwrap();
    assert_eq!(session.remarks, Vec::<String>::new());
    let (sources, _) = replay::sources(&graph, &session);
    assert!(sources.contains(&Source::Node) && sources.contains(&Source::Recording));
    let mut player = Player::new(session, Arc::clone(&graph), &sources).unwrap();
    engine::replay(graph, &sources, &mut player, &Options::default(), &mut |_| {}).unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, ..ProptestConfig::default() })]

    #[test]
    fn any_events_and_messages_are_answered(seed in any::<u64>()) {
        replay_changed(seed);
    }

    #[test]
    fn any_bytes_behind_the_magic_are_answered(bytes in proptest::collection::vec(any::<u8>(), 0..300), cut in 0_usize..9) {
        let folder = folder();
        let path = folder.path().join("x.mcap");
        let mut file = foveate_session::records::MAGIC[..cut.min(8)].to_vec();
        file.extend(&bytes);
        fs::write(&path, &file).unwrap();
        prop_assert!(Session::open(&path).err().unwrap().contains("x.mcap"));
        prop_assert!(fs::read(&path).unwrap() == file);
        let _ = order::decode(&bytes);
    }
}
