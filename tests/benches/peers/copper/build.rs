//! Writes the task graphs, which copper compiles in: chains of 4 and 32 pass-through tasks.

use std::fmt::Write;
use std::path::Path;

/// Source, `length` pass-through tasks, sink; `kind` is the module with the tasks.
fn graph(kind: &str, message: &str, length: usize, logged: bool) -> String {
    let mut text = format!(
        "(\n  logging: (slab_size_mib: 256, enable_task_logging: {logged}, enable_keyframe_logging: {logged}),\n  tasks: [\n"
    );
    let _ = writeln!(text, "    (id: \"source\", type: \"crate::{kind}::Source\", kind: source),");
    for index in 0..length {
        let _ = writeln!(text, "    (id: \"pass{index}\", type: \"crate::{kind}::Pass\", kind: task),");
    }
    let _ = writeln!(text, "    (id: \"sink\", type: \"crate::{kind}::Sink\", kind: sink),\n  ],\n  cnx: [");
    for index in 0..=length {
        let from = if index == 0 { "source".to_owned() } else { format!("pass{}", index - 1) };
        let to = if index == length { "sink".to_owned() } else { format!("pass{index}") };
        let _ = writeln!(text, "    (src: \"{from}\", dst: \"{to}\", msg: \"{message}\"),");
    }
    text + "  ],\n)\n"
}

fn main() {
    cu29_build::setup();
    println!("cargo::rerun-if-changed=build.rs");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("graphs");
    std::fs::create_dir_all(&folder).expect("the folder for graphs can be made");
    for length in [4, 32] {
        for (name, kind, message, logged) in [
            ("small", "small", "crate::small::Payload", false),
            ("large", "large", "crate::large::Payload", false),
            ("logged", "small", "crate::small::Payload", true),
        ] {
            let text = graph(kind, message, length, logged);
            std::fs::write(folder.join(format!("{name}{length}.ron")), text).expect("a graph can be written");
        }
    }
}
