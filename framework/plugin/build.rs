//! What the build of this crate has to know of itself: compiler, target features, profile, sources, and where it happens.

use std::env::{var, vars};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

#[path = "src/sources.rs"]
mod sources;

fn main() {
    let framework = Path::new("..");
    for room in sources::CROSSING {
        for part in sources::PARTS {
            println!("cargo::rerun-if-changed={}", framework.join(room).join(part).display());
        }
    }
    tell("SOURCES", &sources::hash(framework));

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
    // What changes a profile from outside changes the identity of every crate.
    println!("cargo::rerun-if-env-changed=CARGO_INCREMENTAL");
    let changes = vars().filter(|it| it.0 == "CARGO_INCREMENTAL" || it.0.starts_with("CARGO_PROFILE_"));
    let changes: Vec<String> = changes.map(|(key, value)| format!("{key}={value}")).collect();
    tell("CHANGES", &changes.join("\x1f"));
    // The real place, and not that of a link to it.
    let here = fs::canonicalize(of("CARGO_MANIFEST_DIR")).unwrap_or_default();
    tell("CHECKOUT", &here.ancestors().nth(2).unwrap_or(Path::new("")).to_string_lossy());
}

fn tell(name: &str, value: &str) {
    println!("cargo::rustc-env=FOVEATE_BUILD_{name}={}", value.replace('\n', " "));
}
