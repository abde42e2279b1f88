//! What the build of this crate has to know of itself: compiler, target features, profile, sources, and where it happens.

use std::env::var;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The rooms whose types cross between a program and a library.
const CROSSING: [&str; 8] = ["time", "messages", "estimation", "geometry", "diagnostics", "scene", "node", "plugin"];

fn main() {
    let mut sources = Vec::new();
    for room in CROSSING {
        for part in ["src", "Cargo.toml"] {
            let path = Path::new("..").join(room).join(part);
            println!("cargo::rerun-if-changed={}", path.display());
            gather(&path, &mut sources);
        }
    }
    sources.sort();
    let hash = sources.iter().fold(0xcbf2_9ce4_8422_2325, |hash, path| {
        let text = fs::read(path).unwrap_or_default();
        let named = path.to_string_lossy();
        named
            .bytes()
            .chain([0])
            .chain(text)
            .fold(hash, |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
    });
    tell("SOURCES", &format!("{hash:016x}"));

    let rustc = var("RUSTC").ok().and_then(|it| Command::new(it).arg("-vV").output().ok());
    let rustc = rustc.map(|it| String::from_utf8_lossy(&it.stdout).into_owned()).unwrap_or_default();
    let line = |key: &str| rustc.lines().find_map(|it| it.strip_prefix(key)).unwrap_or("unknown").trim().to_owned();
    tell("RUSTC", &format!("{} ({}, {})", line("release:"), line("commit-hash:"), line("host:")));
    let of = |name: &str| var(name).unwrap_or_default();
    tell("TARGET_FEATURES", &of("CARGO_CFG_TARGET_FEATURE"));
    let checks = var("CARGO_CFG_DEBUG_ASSERTIONS").is_ok();
    let panics = of("CARGO_CFG_PANIC");
    tell("PROFILE", &format!("opt-level {}, debug assertions {checks}, panic {panics}", of("OPT_LEVEL")));

    // TARGET_DIR[/TRIPLE]/PROFILE/build/PACKAGE/out
    let out = PathBuf::from(of("OUT_DIR"));
    let above = |n: usize| out.ancestors().nth(n).map(Path::to_owned).unwrap_or_default();
    let name = |path: PathBuf| path.file_name().map(|it| it.to_string_lossy().into_owned()).unwrap_or_default();
    let triple = name(above(4)) == of("TARGET");
    tell("PROFILE_NAME", &name(above(3)));
    tell("TARGET_DIR", &above(if triple { 5 } else { 4 }).to_string_lossy());
    tell("TRIPLE", &if triple { of("TARGET") } else { String::new() });
    tell("RUSTFLAGS", &of("CARGO_ENCODED_RUSTFLAGS"));
    // The real place, and not that of a link to it.
    let here = fs::canonicalize(of("CARGO_MANIFEST_DIR")).unwrap_or_default();
    tell("CHECKOUT", &here.ancestors().nth(2).unwrap_or(Path::new("")).to_string_lossy());
}

fn tell(name: &str, value: &str) {
    println!("cargo::rustc-env=FOVEATE_BUILD_{name}={}", value.replace('\n', " "));
}

fn gather(path: &Path, found: &mut Vec<PathBuf>) {
    if path.is_file() {
        return found.push(path.to_owned());
    }
    for entry in fs::read_dir(path).into_iter().flatten().flatten() {
        gather(&entry.path(), found);
    }
}
