//! One hour of 100 marks at 240 Hz into C3D and TRC: how much memory the whole process takes, how large the files become, and how long it takes.
//!
//! `cargo bench -p foveate-export --bench long_session [-- SECONDS]`; files go to the folder for temporary files, 4 GB for the hour. Linux tells the memory.

use std::fs;
use std::io::Read;
use std::sync::Arc;
use std::time::Instant;

use foveate::prelude::*;
use foveate_embed::engine::{self, Options};
use foveate_embed::rig::{self, Overrides};
use foveate_testkit::scene::ring_calibration;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const RATE_HZ: f64 = 240.0;
const N_MARKS: u32 = 100;
/// What the process may take [MB].
const GOAL_MB: f64 = 200.0;

ports! {
    MARKS: Out<Marks> = "marks";
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct HeadSettings {
    late_s: f64,
}

/// Marks on a head that turns; every tenth is hidden for a second now and then, and ten come late.
struct Head {
    step: u64,
    late_s: f64,
}

impl Node for Head {
    const TYPE: &'static str = "bench.head";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Knows marks.";
    type Settings = HeadSettings;
    fn ports() -> Ports {
        declared_ports()
    }
    fn new(settings: HeadSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { step: 0, late_s: settings.late_s })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let seconds = self.step as f64 / RATE_HZ;
        let is_there = |label: u32| {
            let is_hidden = label % 10 == 3 && (seconds as u64 + u64::from(label)).is_multiple_of(20);
            !is_hidden && (label < N_MARKS - 10 || seconds > self.late_s)
        };
        let mark = |label: u32| Mark {
            label,
            position: Point3::new(
                0.1,
                f64::from(label % 10) * 0.01,
                f64::from(label / 10) * 0.01 + 0.002 * (seconds * 3.0).sin(),
            ),
            covariance: Matrix3::identity() * 1e-8,
            cameras: [CameraId(0), CameraId(1)].into_iter().collect(),
            provenance: Provenance::Measured,
        };
        let marks = Marks {
            time: io.now(),
            world_from_marks: Isometry3::new(
                Vector3::new(seconds.sin(), 0.0, 1.6),
                Vector3::z() * (0.7 * seconds).sin(),
            ),
            list: (0..N_MARKS).filter(|it| is_there(*it)).map(mark).collect(),
            ..Marks::default()
        };
        self.step += 1;
        io.emit_at(&MARKS, io.now(), marks);
        Ok(())
    }
    fn due(&mut self) -> Due {
        Due::At(Time::from_s(self.step as f64 / RATE_HZ))
    }
}

/// What Linux says of this process [MB].
fn status_mb(name: &str) -> Option<f64> {
    let text = fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find(|it| it.starts_with(name))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? * 1024.0 / 1e6)
}

fn main() {
    let seconds = std::env::args().skip(1).find_map(|it| it.parse::<f64>().ok()).unwrap_or(3600.0);
    let folder = tempfile::tempdir().expect("a folder for temporary files");
    fs::write(folder.path().join("ring.toml"), ring_calibration(3).to_toml()).expect("room for a calibration");
    let mut registry = Registry::default();
    foveate_export::register(&mut registry);
    registry.add::<Head>();
    println!("{seconds} s of {N_MARKS} marks at {RATE_HZ} Hz, ten of them from {} s on\n", seconds / 4.0);
    println!("| files | largest memory of the process so far | bytes | wall time |\n|---|---|---|---|");
    for kind in ["c3d", "trc"] {
        let text = format!(
            "[rig]\nname = \"long\"\ncalibration = \"ring.toml\"\nduration_s = {seconds}\n[scale.room]\n[scale.room.node.head]\n\
             type = \"bench.head\"\nlate_s = {:?}\n[scale.room.node.{kind}]\ntype = \"export.{kind}\"\nin = {{ marks = \"head.marks\" }}\n",
            seconds / 4.0
        );
        let graph = rig::load(&text, &folder.path().join("long.toml"), &registry, &Overrides::default())
            .unwrap_or_else(|faults| panic!("{}", faults.render(false)));
        let options = Options { out_dir: Some(folder.path().to_owned()), ..Options::default() };
        let start = Instant::now();
        let outcome = engine::deterministic(Arc::new(graph), &options, &mut |_| {}).expect("a run");
        let wall_s = start.elapsed().as_secs_f64();
        let figure = |name: &str| outcome.report.figures[&format!("{kind}.{name}")];
        let path = folder.path().join(format!("motion.{kind}"));
        let bytes = fs::metadata(&path).map_or(0, |it| it.len());
        let mut head = vec![0; 64];
        fs::File::open(&path).and_then(|mut it| it.read_exact(&mut head)).expect("a file");
        let expected = (seconds * RATE_HZ).floor();
        assert!((figure("frames") - expected).abs() <= 1.0, "{} frames, expected {expected}", figure("frames"));
        let peak = status_mb("VmHWM").map_or("–".to_owned(), |it| format!("{it:.0} MB (goal: {GOAL_MB})"));
        println!("| {kind} | {peak} | {:.0} MB | {wall_s:.0} s |", bytes as f64 / 1e6);
        fs::remove_file(&path).ok();
    }
}
