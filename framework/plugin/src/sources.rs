//! A hash of the text of all that crosses between a program and a library. Compiled into the build script too.

use std::fs;
use std::path::{Path, PathBuf};

/// The rooms whose types cross between a program and a library.
pub const CROSSING: [&str; 9] =
    ["time", "messages", "estimation", "geometry", "diagnostics", "scene", "node", "boundary", "plugin"];
/// Of each room.
pub const PARTS: [&str; 2] = ["src", "Cargo.toml"];

/// FNV-1a over names and contents of all files of the rooms in `framework`.
pub fn hash(framework: &Path) -> String {
    let mut files = Vec::new();
    for room in CROSSING {
        PARTS.iter().for_each(|part| gather(&framework.join(room).join(part), &mut files));
    }
    files.sort();
    let hash = files.iter().fold(0xcbf2_9ce4_8422_2325, |hash, path| {
        let text = fs::read(path).unwrap_or_default();
        let name = path.strip_prefix(framework).unwrap_or(path).to_string_lossy();
        let bytes = name.bytes().chain([0]).chain(text);
        bytes.fold(hash, |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
    });
    format!("{hash:016x}")
}

fn gather(path: &Path, found: &mut Vec<PathBuf>) {
    if path.is_file() {
        return found.push(path.to_owned());
    }
    for entry in fs::read_dir(path).into_iter().flatten().flatten() {
        gather(&entry.path(), found);
    }
}
