//! Any file is read as a session, in part or whole, or refused with a reason; nothing is read that was not written.
//!
//! `cargo +nightly fuzz run session -- -max_total_time=60` from the root of the repository. An input that begins as an MCAP file is one; any other is a list
//! of changes of a small session: two bytes of a place and one that is put there.

#![no_main]

use std::fs;
use std::path::PathBuf;
use std::sync::{Arc, LazyLock};

use foveate_rig::graph::Graph;
use foveate_session::{Packing, records};
use libfuzzer_sys::fuzz_target;

#[allow(dead_code, reason = "the tests use more of it")]
#[path = "../../framework/session/tests/robust/parts.rs"]
mod parts;

struct Small {
    /// Where files are written.
    folder: tempfile::TempDir,
    graph: Arc<Graph>,
    /// A finished session and one that is not, with what is read of them.
    files: Vec<(Vec<u8>, parts::Content)>,
}

impl Small {
    fn path(&self) -> PathBuf {
        self.folder.path().join("x.mcap")
    }
}

static SMALL: LazyLock<Small> = LazyLock::new(|| {
    let folder = parts::folder();
    let (mut files, mut graph) = (Vec::new(), None);
    for is_finished in [true, false] {
        let path = folder.path().join(format!("{is_finished}.mcap"));
        graph = Some(parts::write_small(&path, Packing::None, 3, is_finished));
        let bytes = fs::read(&path).expect("it was written");
        files.push((bytes, parts::read(&path, graph.as_ref().expect("it was made")).1));
    }
    Small { folder, graph: graph.expect("it was made"), files }
});

fuzz_target!(|input: &[u8]| {
    let path = SMALL.path();
    if input.starts_with(records::MAGIC) {
        fs::write(&path, input).expect("there is room");
        drop(parts::read(&path, &SMALL.graph));
        return;
    }
    for (bytes, whole) in &SMALL.files {
        let mut bytes = bytes.clone();
        for change in input.chunks_exact(3) {
            let at = usize::from(u16::from_le_bytes([change[0], change[1]])) % bytes.len();
            bytes[at] = change[2];
        }
        fs::write(&path, bytes).expect("there is room");
        parts::survive(&path, &SMALL.graph, whole);
    }
});
