//! One sample at one time is one place in every file of a run: tables, C3D, TRC, NPZ and GLB.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use foveate::estimation::random::Random;
use foveate::motion::{c3d, trc};
use foveate::prelude::*;
use foveate_embed::engine::{self, Options};
use foveate_embed::rig::{self, Overrides};
use foveate_testkit::scene::ring_calibration;
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Quaternion, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

const RATE_HZ: f64 = 60.0;
const DURATION_S: f64 = 4.0;
const N_TARGETS: u32 = 4;
const N_MARKS: u32 = 20;
/// A hundredth of a millimetre.
const AGREES_MM: f64 = 0.01;

ports! {
    TARGETS: Out<Targets> = "targets";
    MARKS: Out<Marks> = "marks";
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct TrackerSettings {
    duration_s: f64,
}

/// Says where targets and marks are as trackers do: at any time, several times at one time, a little out of order, now measured and now predicted only,
/// with a jump of some millimetres at each measurement.
struct Tracker {
    random: Random,
    step: i64,
    duration_s: f64,
}

impl Tracker {
    fn time(&self) -> Time {
        // Every fourth message lies on a frame of the files.
        let regular = Time::from_s(self.step as f64 / (4.0 * RATE_HZ));
        if self.step % 4 == 0 { regular } else { regular + Interval::from_ms(1.3 * (self.step % 3) as f64) }
    }

    fn targets(&mut self, time: Time) -> Targets {
        let seconds = time.as_s();
        let mut target = |id: u32| {
            let phase = f64::from(id) + 3.0 * seconds;
            let jump = 0.003;
            let is_measured = self.random.uniform() < 0.4;
            let off = Vector3::from_fn(|_, _| jump * self.random.normal());
            Target {
                id: TargetId(id),
                position: Point3::new(phase.cos(), phase.sin(), 1.0 + 0.2 * phase.sin()) + off,
                velocity: Vector3::new(-3.0 * phase.sin(), 3.0 * phase.cos(), 0.0),
                covariance: Matrix6::identity() * 1e-6,
                cameras: if is_measured { [CameraId(1)].into_iter().collect() } else { CameraSet::default() },
                provenance: if is_measured { Provenance::Measured } else { Provenance::Predicted },
            }
        };
        let mut list: Vec<Target> = (0..N_TARGETS).map(&mut target).collect();
        // One comes late and goes for a while.
        list.retain(|it| it.id.0 != 2 || (1.0..2.0).contains(&seconds) || seconds > 3.0);
        Targets { time, list }
    }

    fn marks(&mut self, time: Time) -> Marks {
        let seconds = time.as_s();
        let mark = |label: u32| {
            let [y, z] = [f64::from(label % 5) * 0.02, f64::from(label / 5) * 0.02 + 0.001 * f64::from(label)];
            let bent = 0.1 - y * y + 0.01 * (seconds * 9.0).sin();
            let provenance = if label == 7 { Provenance::Filled } else { Provenance::Measured };
            Mark {
                label,
                position: Point3::new(bent, y, z),
                covariance: Matrix3::identity() * 1e-8,
                cameras: CameraSet::default(),
                provenance,
            }
        };
        Marks {
            time,
            world_from_marks: Isometry3::new(Vector3::new(seconds, 0.5, 1.6), Vector3::new(0.3, 0.2, 6.0 * seconds)),
            list: (0..N_MARKS).map(mark).collect(),
            ..Marks::default()
        }
    }
}

impl Node for Tracker {
    const TYPE: &'static str = "test.tracker";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Knows targets and marks.";
    type Settings = TrackerSettings;
    fn ports() -> Ports {
        declared_ports()
    }
    fn new(settings: TrackerSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { random: Random::new(13), step: 0, duration_s: settings.duration_s })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let now = self.time();
        self.step += 1;
        // Some come twice, the second time knowing more; some are of a time that is over.
        for _ in 0..1 + usize::from(self.step % 5 == 0) {
            let targets = self.targets(now);
            io.emit_at(&TARGETS, now, targets);
        }
        if self.step % 7 == 0 && self.step > 20 {
            let before = now - Interval::from_ms(37.0);
            let late = self.targets(before);
            io.emit_at(&TARGETS, before, late);
        }
        if self.step % 6 == 1 {
            let marks = self.marks(now);
            io.emit_at(&MARKS, now, marks);
        }
        Ok(())
    }
    fn due(&mut self) -> Due {
        if self.time().as_s() > self.duration_s { Due::Never } else { Due::At(self.time()) }
    }
}

/// By label and number of the frame: where [mm].
type Places = BTreeMap<(String, i64), [f64; 3]>;

fn frame_of(time_s: f64) -> Option<i64> {
    let frame = (time_s * RATE_HZ).round();
    ((time_s - frame / RATE_HZ).abs() < 1.5e-6).then_some(frame as i64)
}

/// Of a table of ours: the name before its number, and the column of x.
fn of_table(path: &Path, name: &str, x: usize) -> Places {
    let text = fs::read_to_string(path).unwrap();
    let mut places = Places::new();
    for line in text.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |at: usize| fields[at].parse::<f64>().unwrap();
        if let Some(frame) = frame_of(number(0)) {
            let is_new =
                places.insert((format!("{name}-{}", fields[1]), frame), [x, x + 1, x + 2].map(|it| 1e3 * number(it)));
            assert_eq!(is_new, None, "{} says it twice: {line}", path.display());
        }
    }
    places
}

fn of_c3d(path: &Path) -> Places {
    let file = c3d::read(&fs::read(path).unwrap()).unwrap();
    let start = (file.start_s.unwrap() * RATE_HZ).round() as i64;
    let mut places = Places::new();
    for (index, sample) in file.samples.iter().enumerate().filter(|it| it.1.is_present()) {
        let (frame, point) = (index / file.labels.len(), index % file.labels.len());
        places.insert((file.labels[point].clone(), start + frame as i64), sample.position.map(f64::from));
    }
    places
}

fn of_trc(path: &Path) -> Places {
    let text = fs::read_to_string(path).unwrap();
    // As many rows as the file says that it has: where the program was killed in the middle of a write another one may be cut off.
    let declared: usize = text.lines().nth(2).unwrap().split('\t').nth(2).unwrap().parse().unwrap();
    let lines: Vec<&str> = text.lines().take(6 + declared).collect();
    let file = trc::read(&lines.join("\n")).unwrap();
    assert_eq!(file.times_s.len(), declared);
    let mut places = Places::new();
    for (index, position) in file.positions.iter().enumerate() {
        let (frame, point) = (index / file.labels.len(), index % file.labels.len());
        if let Some([x, y, z]) = *position {
            places.insert((file.labels[point].clone(), frame_of(file.times_s[frame]).unwrap()), [x, -z, y]);
        }
    }
    places
}

/// An array of an archive that is not compressed.
fn array<'a>(archive: &'a [u8], name: &str) -> &'a [u8] {
    let mut at = 0;
    let word = |at: usize| u32::from_le_bytes(archive[at..at + 4].try_into().unwrap()) as usize;
    while archive[at..].starts_with(b"PK\x03\x04") {
        let (size, length) = (word(at + 18), usize::from(u16::from_le_bytes([archive[at + 26], archive[at + 27]])));
        let content = &archive[at + 30 + length..][..size];
        if archive[at + 30..][..length] == *format!("{name}.npy").as_bytes() {
            return &content[10 + usize::from(u16::from_le_bytes([content[8], content[9]]))..];
        }
        at += 30 + length + size;
    }
    panic!("no array {name}");
}

fn floats(bytes: &[u8]) -> Vec<f64> {
    bytes.chunks_exact(8).map(|it| f64::from_le_bytes(it.try_into().unwrap())).collect()
}

/// Of the archive: in the world, and marks by their own space and its place.
fn of_npz(path: &Path, labels: &[String]) -> [Places; 2] {
    let file = fs::read(path).unwrap();
    let frames: Vec<i64> = floats(array(&file, "times_s")).into_iter().map(|it| frame_of(it).unwrap()).collect();
    let mut both = [Places::new(), Places::new()];
    for (index, it) in floats(array(&file, "positions_m")).chunks_exact(3).enumerate().filter(|it| !it.1[0].is_nan()) {
        let key = (labels[index % labels.len()].clone(), frames[index / labels.len()]);
        both[0].insert(key, [it[0], it[1], it[2]].map(|it| 1e3 * it));
    }
    let poses = floats(array(&file, "world_from_marks"));
    let marks: Vec<&String> = labels.iter().filter(|it| it.starts_with("mark")).collect();
    for (index, own) in floats(array(&file, "marks_own_m")).chunks_exact(3).enumerate().filter(|it| !it.1[0].is_nan()) {
        let frame = index / marks.len();
        let row = |it: usize| &poses[frame * 16 + it * 4..][..4];
        let place =
            [0, 1, 2].map(|it| 1e3 * (row(it)[0] * own[0] + row(it)[1] * own[1] + row(it)[2] * own[2] + row(it)[3]));
        both[1].insert((marks[index % marks.len()].clone(), frames[frame]), place);
    }
    both
}

fn of_glb(path: &Path) -> Places {
    let file = fs::read(path).unwrap();
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
    let document: Value = serde_json::from_slice(&file[20..20 + word(12)]).unwrap();
    let bytes = &file[28 + word(12)..];
    let number = |it: &Value| it.as_u64().unwrap() as usize;
    let values = |accessor: &Value| -> Vec<f64> {
        let it = &document["accessors"][number(accessor)];
        let view = &document["bufferViews"][number(&it["bufferView"])];
        let bytes = &bytes[number(&view["byteOffset"])..][..number(&view["byteLength"])];
        bytes.chunks_exact(4).map(|it| f64::from(f32::from_le_bytes(it.try_into().unwrap()))).collect()
    };
    let animation = &document["animations"][0];
    let start_s = animation["extras"]["start_s"].as_f64().unwrap();
    // By node and path: values by frame.
    let mut courses: BTreeMap<(String, String), BTreeMap<i64, Vec<f64>>> = BTreeMap::new();
    for channel in animation["channels"].as_array().unwrap() {
        let name = document["nodes"][number(&channel["target"]["node"])]["name"].as_str().unwrap().to_owned();
        let sampler = &animation["samplers"][number(&channel["sampler"])];
        let (times, output) = (values(&sampler["input"]), values(&sampler["output"]));
        let width = output.len() / times.len();
        let frames = times.iter().map(|it| ((start_s + it) * RATE_HZ).round() as i64);
        let course = frames.zip(output.chunks(width).map(<[f64]>::to_vec)).collect();
        courses.insert((name, channel["target"]["path"].as_str().unwrap().to_owned()), course);
    }
    let of = |name: &str, path: &str| &courses[&(name.to_owned(), path.to_owned())];
    let point = |it: &[f64]| Point3::new(it[0], it[1], it[2]);
    let mut places = Places::new();
    for ((name, path), course) in &courses {
        if path != "translation" || !(name.starts_with("target-") || name.starts_with("mark-")) {
            continue;
        }
        for (frame, place) in course {
            let mut place = point(place);
            if name.starts_with("mark-") {
                let [at, turn] = ["translation", "rotation"].map(|it| &of("marks", it)[frame]);
                let turn = UnitQuaternion::from_quaternion(Quaternion::new(turn[3], turn[0], turn[1], turn[2]));
                place = turn * place + point(at).coords;
            }
            places.insert((name.clone(), *frame), [place.x, place.y, place.z].map(|it| 1e3 * it));
        }
    }
    places
}

#[track_caller]
fn check_agreement(a: (&str, &Places), b: (&str, &Places), at_least: usize) {
    let shared: Vec<_> = a.1.iter().filter_map(|(key, it)| Some((key, it, b.1.get(key)?))).collect();
    assert!(shared.len() >= at_least, "{} and {} share {} samples, expected {at_least}", a.0, b.0, shared.len());
    for (key, one, other) in shared {
        let apart = (0..3).map(|it| (one[it] - other[it]).powi(2)).sum::<f64>().sqrt();
        assert!(apart < AGREES_MM, "{key:?}: {apart} mm between {} and {}: {one:?}, {other:?}", a.0, b.0);
    }
}

/// Runs the source into the exports, each with its settings, in `folder`.
fn run_into(folder: &Path, duration_s: f64, exports: &[(&str, &str, &str)]) {
    fs::write(folder.join("ring.toml"), ring_calibration(3).to_toml()).unwrap();
    let mut registry = Registry::default();
    foveate_export::register(&mut registry);
    registry.add::<Tracker>();
    let mut text = format!(
        "[rig]\nname = \"formats\"\ncalibration = \"ring.toml\"\nduration_s = {duration_s}\n[scale.room]\n[scale.room.node.track]\n\
         type = \"test.tracker\"\nduration_s = {duration_s:?}\n"
    );
    for (name, kind, settings) in exports {
        text.push_str(&format!("[scale.room.node.{name}]\ntype = \"export.{kind}\"\n{settings}\n"));
    }
    let graph = rig::load(&text, &folder.join("formats.toml"), &registry, &Overrides::default())
        .unwrap_or_else(|faults| panic!("{}", faults.render(false)));
    let options = Options { out_dir: Some(folder.to_owned()), ..Options::default() };
    engine::deterministic(Arc::new(graph), &options, &mut |_| {}).unwrap();
}

const BOTH: &str = "in = { targets = \"track.targets\", marks = \"track.marks\" }\nrate_hz = 60.0";

#[test]
fn one_sample_is_one_place_in_all_files_of_a_run() {
    let folder = tempfile::tempdir().unwrap();
    let exports = [
        ("raw", "targets", "in = { targets = \"track.targets\" }\nfile = \"raw.csv\""),
        ("ticks", "targets", "in = { targets = \"track.targets\" }\nfile = \"ticks.csv\"\nrate_hz = 60.0"),
        ("marks", "marks", "in = { marks = \"track.marks\" }"),
        ("c3d", "c3d", BOTH),
        ("trc", "trc", BOTH),
        ("npz", "npy", BOTH),
        ("glb", "gltf", BOTH),
    ];
    run_into(folder.path(), DURATION_S, &exports);

    let file = |name: &str| folder.path().join(name);
    let c3d = of_c3d(&file("motion.c3d"));
    let labels = c3d::read(&fs::read(file("motion.c3d")).unwrap()).unwrap().labels;
    let [npz, npz_own] = of_npz(&file("motion.npz"), &labels);
    let (trc, glb) = (of_trc(&file("motion.trc")), of_glb(&file("motion.glb")));
    let (raw, ticks) = (of_table(&file("raw.csv"), "target", 2), of_table(&file("ticks.csv"), "target", 2));
    let marks = of_table(&file("marks.csv"), "mark", 13);

    let n = c3d.len();
    assert!(n > 5000, "{n}");
    for (name, other) in [("TRC", &trc), ("NPZ", &npz), ("GLB", &glb)] {
        assert!(other.keys().eq(c3d.keys()), "{name} has the samples of C3D");
        check_agreement(("C3D", &c3d), (name, other), n);
    }
    let n_targets = c3d.keys().filter(|it| it.0.starts_with("target")).count();
    check_agreement(("NPZ", &npz), ("NPZ by its marks' own space", &npz_own), n - n_targets);
    // Every fourth message lies on a frame; a table has what was predicted at the ends of holes, too.
    check_agreement(("C3D", &c3d), ("the table of messages", &raw), n_targets * 95 / 100);
    check_agreement(("C3D", &c3d), ("the table on a clock", &ticks), n_targets);
    check_agreement(("the table of messages", &raw), ("the table on a clock", &ticks), n_targets);
    check_agreement(("C3D", &c3d), ("the table of marks", &marks), n_targets / 10);
}

/// The folder for [`endless_run`], which is started as a program of its own.
const FOLDER: &str = "FOVEATE_TEST_ENDLESS_RUN";

/// Part of the test below, and nothing by itself.
#[test]
fn endless_run() {
    if let Some(folder) = std::env::var_os(FOLDER) {
        run_into(Path::new(&folder), 90_000.0, &[("c3d", "c3d", BOTH), ("trc", "trc", BOTH)]);
    }
}

#[test]
fn run_that_is_killed_leaves_what_it_had() {
    let folder = tempfile::tempdir().unwrap();
    for at_least in [100_000, 500_000] {
        let mut child = std::process::Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "endless_run"])
            .env(FOLDER, folder.path())
            .stdout(std::process::Stdio::null())
            .spawn()
            .unwrap();
        let path = |name: &str| folder.path().join(name);
        let is_long = |name: &str| fs::metadata(path(name)).is_ok_and(|it| it.len() > at_least);
        let start = std::time::Instant::now();
        while !(is_long("motion.c3d") && is_long("motion.trc")) {
            assert!(start.elapsed().as_secs() < 120 && child.try_wait().unwrap().is_none(), "no files grow");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        // SIGKILL: nothing is finished.
        child.kill().unwrap();
        child.wait().unwrap();
        let (c3d, trc) = (of_c3d(&path("motion.c3d")), of_trc(&path("motion.trc")));
        let n = c3d.len().min(trc.len());
        assert!(n as u64 > at_least / 40, "{n} samples");
        check_agreement(("C3D", &c3d), ("TRC", &trc), n * 9 / 10);
        ["motion.c3d", "motion.trc"].iter().for_each(|it| fs::remove_file(path(it)).unwrap());
    }
}
