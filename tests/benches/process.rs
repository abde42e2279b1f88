//! What a node that is a process costs: round trips of an echo in Rust and in Python, of a message without pixels and of pictures of 1280 × 1024.
//!
//! `cargo bench -p foveate-tests --bench process`; the Python of `FOVEATE_PEER_PYTHON` (with numpy), where it is set.

use std::io::{Read, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::time::Instant;

use foveate::prelude::*;
use foveate_embed::plugin::process::{Filter, Pictures, ProcessSettings};
use nalgebra::{Matrix6, Point3, Vector3};
use serde_json::{Value, json};

const TARGETS: In<Targets> = In::each(0, "targets");
const TARGETS_OUT: Out<Targets> = Out::new(0, "targets");
const IMAGE: In<Image> = In::each(0, "image");
const IMAGE_OUT: Out<Image> = Out::new(0, "image");

/// Round trips of each measurement, after a tenth as many that do not count.
const ROUNDS: usize = 2000;

/// The echo in Rust: copies pixels from one half of the memory to the other.
fn child() {
    let receive = || -> Option<Value> {
        let mut length = [0; 4];
        std::io::stdin().read_exact(&mut length).ok()?;
        let mut text = vec![0; u32::from_le_bytes(length) as usize];
        std::io::stdin().read_exact(&mut text).ok()?;
        serde_json::from_slice(&text).ok()
    };
    let answer = |value: Value| {
        let text = value.to_string();
        let length = (text.len() as u32).to_le_bytes();
        let mut out = std::io::stdout();
        assert!(out.write_all(&[&length[..], text.as_bytes()].concat()).and_then(|()| out.flush()).is_ok());
    };
    receive();
    answer(json!({ "ready": true }));
    let (mut pixels, mut open) = (Vec::new(), None);
    while let Some(message) = receive() {
        let mut given = json!({ "port": message["port"], "value": message["value"] });
        if let Some(bulk) = message.get("bulk") {
            let number = |key: &str| bulk[key].as_u64().unwrap_or(0);
            let file = open.get_or_insert_with(|| {
                std::fs::File::options().read(true).write(true).open(bulk["path"].as_str().unwrap_or("")).ok()
            });
            let Some(file) = file else { return };
            pixels.resize(number("length") as usize, 0);
            let copied = file.read_exact_at(&mut pixels, number("offset"));
            assert!(copied.and_then(|()| file.write_all_at(&pixels, number("answer"))).is_ok());
            given["bulk"] = json!([number("answer"), number("length")]);
        }
        answer(json!({ "emit": [given] }));
    }
}

/// The echo in Python.
const PYTHON: &str = "
from foveate_node import run
run({
    'targets': lambda message: [('targets', message.value)],
} if __import__('sys').argv[1] == 'targets' else {
    'image': lambda message: [('image', message.value, message.pixels)],
})
";

fn settings(command: Vec<String>) -> ProcessSettings {
    ProcessSettings { command, deadline_ms: 5000.0, start_ms: 20_000.0 }
}

/// Sorted times of `turn` [s].
fn times(mut turn: impl FnMut()) -> Vec<f64> {
    (0..ROUNDS / 10).for_each(|_| turn());
    let mut times: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let start = Instant::now();
            turn();
            start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times
}

fn measure(name: &str, command: impl Fn(&str) -> Vec<String>) {
    let target = Target {
        id: TargetId(1),
        position: Point3::new(0.1, 0.2, 0.3),
        velocity: Vector3::x(),
        covariance: Matrix6::identity(),
        cameras: CameraSet::default(),
        provenance: Provenance::Measured,
    };
    let targets = std::sync::Arc::new(Targets { time: Time(1), list: vec![target; 8] });
    let new = |what: &str| settings(command(what));
    let Ok(mut filter) = NodeBench::<Filter>::new(new("targets")) else { return println!("{name}: cannot be started") };
    let took = times(|| {
        assert!(filter.feed(&TARGETS, Time(1), targets.clone()).is_ok());
        assert_eq!(filter.outputs(&TARGETS_OUT).len(), 1);
    });
    let [p50, p99] = [took[ROUNDS / 2], took[ROUNDS * 99 / 100]];
    println!("{name:>8}  8 targets, there and back        p50 {:7.1} µs   p99 {:7.1} µs", p50 * 1e6, p99 * 1e6);

    let (width, height) = (1280, 1024);
    let pixels = (0..width * height).map(|it| (it % 253) as u8).collect();
    let image = std::sync::Arc::new(Image { width, height, pixels, ..Image::default() });
    let Ok(mut pictures) = NodeBench::<Pictures>::new(new("image")) else {
        return println!("{name}: cannot be started");
    };
    let took = times(|| {
        assert!(pictures.feed(&IMAGE, Time(1), image.clone()).is_ok());
        assert_eq!(pictures.outputs(&IMAGE_OUT)[0].value.pixels.len(), image.pixels.len());
    });
    let [p50, p99] = [took[ROUNDS / 2], took[ROUNDS * 99 / 100]];
    let rate = |seconds: f64| f64::from(width * height) / seconds / 1e6;
    println!(
        "{name:>8}  1280 x 1024 px, there and back   p50 {:7.1} µs   p99 {:7.1} µs   {:.0} MB/s each way at p50, {:.0} at p99",
        p50 * 1e6,
        p99 * 1e6,
        rate(p50),
        rate(p99)
    );
}

fn main() {
    if std::env::args().nth(1).as_deref() == Some("echo") {
        return child();
    }
    let own = std::env::current_exe().map(|it| it.display().to_string()).unwrap_or_default();
    measure("Rust", |_| vec![own.clone(), "echo".to_owned()]);
    let Ok(python) = std::env::var("FOVEATE_PEER_PYTHON") else {
        return println!("Python: skipped, FOVEATE_PEER_PYTHON is not set");
    };
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/python");
    let code = format!("import sys; sys.path.insert(0, {:?}){PYTHON}", package.display().to_string());
    measure("Python", |what| vec![python.clone(), "-c".to_owned(), code.clone(), what.to_owned()]);
}
