//! Any text is answered by a graph or by faults whose places lie inside it; a resolved rig is its own resolution.
//!
//! `cargo +nightly fuzz run rig fuzz/corpus/rig framework/rig/tests/rig -- -max_total_time=60` from the root of the
//! repository: what is found goes to the first folder, the second is read to start from.

#![no_main]

use std::path::Path;
use std::sync::LazyLock;

use foveate_node::Registry;
use foveate_rig::{self as rig, Overrides};
use libfuzzer_sys::fuzz_target;

#[allow(dead_code, reason = "the tests use more of it")]
#[path = "../../framework/rig/tests/rig/parts.rs"]
mod parts;

/// Where the calibration lies.
const RIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../framework/rig/tests/rig/lab.toml");

/// Without the part that panics on purpose: here every panic counts.
static REGISTRY: LazyLock<Registry> = LazyLock::new(parts::registry_of_calm_parts);

fuzz_target!(|text: &str| {
    match rig::load(text, Path::new(RIG), &REGISTRY, &Overrides::default()) {
        Ok(graph) => match rig::load(&graph.resolved, Path::new(RIG), &REGISTRY, &Overrides::default()) {
            Ok(again) => assert_eq!(again.resolved, graph.resolved),
            Err(faults) => panic!("{faults}\n{}", graph.resolved),
        },
        Err(faults) => {
            for fault in &faults.list {
                assert!(text.get(fault.span.clone()).is_some(), "{fault:?}");
            }
            assert!(!faults.render(true).is_empty());
        }
    }
});
