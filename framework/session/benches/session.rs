//! How fast sessions are written, and what recording costs a live rig of 18 wide and 4 narrow cameras.
//!
//! `write`: pictures of a dark room (a quarter of the levels noise of three bits) into a session, beside the same bytes into a plain file.
//! `live`: the rig alone, then beside a thread that writes as many bytes into a plain file, then recorded; processor time of the whole process, and the age of
//! pictures at their consumer. `live NAME` measures one of them alone.

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use foveate_engine::{self as engine, Options};
use foveate_messages::{CameraId, Image, Interval, Stamp, Time};
use foveate_node::setup::Setup;
use foveate_node::{ConfigError, Due, Host, Io, Node, NodeError, Pool, Ports, Registry, Role};
use foveate_rig::graph::Graph;
use foveate_rig::{self as rig, Overrides};
use foveate_session::file::SessionFile;
use foveate_session::{Packing, Pictures, Recorder, Recording, Session};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const SIZE: [u32; 2] = [640, 480];
const N_PICTURES: usize = 2500;
const RATE_HZ: f64 = 18.0;

fn main() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let wanted = std::env::args().nth(1).filter(|it| !it.starts_with('-'));
    if wanted.as_deref() != Some("live") {
        write(folder);
    }
    if wanted.as_deref() != Some("write") {
        live(folder, std::env::args().nth(2).filter(|it| !it.starts_with('-')).as_deref());
    }
}

/// A picture of a dark room: noise of up to three bits on a gradient.
fn picture(seed: u32) -> Image {
    let mut state = seed.wrapping_mul(2_654_435_761).max(1);
    let pixels = (0..SIZE[0] * SIZE[1]).map(|it| {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        let noise = if state & 0x300 == 0 { (state & 7) as u8 } else { 0 };
        (it / SIZE[0] / 32) as u8 + noise
    });
    Image { width: SIZE[0], height: SIZE[1], pixels: pixels.collect(), ..Image::default() }
}

fn write(folder: &Path) {
    let pictures: Vec<Image> = (0..20).map(picture).collect();
    let bytes = (N_PICTURES * pictures[0].pixels.len()) as f64;
    let path = folder.join("bench.mcap");
    let rate = |began: Instant| bytes / 1e6 / began.elapsed().as_secs_f64();
    for (name, packing) in [("raw", Packing::None), ("lz4", Packing::Lz4), ("zstd 1", Packing::Zstd)] {
        let mut rates: Vec<f64> = (0..5)
            .map(|_| {
                let _ = fs::remove_file(&path);
                let mut file = SessionFile::create(&path, packing).unwrap();
                let schema = Pictures::Lossless.kind().schema();
                let schema = (schema.name, "protobuf", schema.descriptor.as_slice());
                let channel = file.channel("/room/video/wide-1/image", "protobuf", Some(schema), &Default::default());
                let channel = channel.unwrap();
                let mut body = Vec::new();
                let began = Instant::now();
                for n in 0..N_PICTURES {
                    let stamp = Stamp { time: Time(n as i64 * 1_000_000), ..Stamp::default() };
                    Pictures::Lossless.encode(&stamp, &pictures[n % 20], "wide-1", &mut body).unwrap();
                    file.message(channel, stamp.time.0, stamp.time.0, &body).unwrap();
                }
                file.flush_to_system().unwrap();
                rate(began)
            })
            .collect();
        rates.sort_by(f64::total_cmp);
        let part = fs::metadata(&path).unwrap().len() as f64 / bytes;
        println!("session {name}: {:.0} MB/s median, {:.0} at worst, {:.2} of the size", rates[2], rates[0], part);
    }
    let mut rates: Vec<f64> = (0..5)
        .map(|_| {
            let _ = fs::remove_file(&path);
            let mut file = std::io::BufWriter::with_capacity(1 << 20, fs::File::create(&path).unwrap());
            let began = Instant::now();
            (0..N_PICTURES).for_each(|n| file.write_all(&pictures[n % 20].pixels).unwrap());
            file.flush().unwrap();
            rate(began)
        })
        .collect();
    rates.sort_by(f64::total_cmp);
    println!("plain file: {:.0} MB/s median, {:.0} at worst", rates[2], rates[0]);
    let _ = fs::remove_file(&path);
    let Some(python) = std::env::var_os("FOVEATE_PEER_PYTHON") else {
        return println!("PyPI mcap: FOVEATE_PEER_PYTHON names no python");
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peer_mcap.py");
    match std::process::Command::new(python).arg(script).arg(folder).status() {
        Ok(status) if status.success() => {}
        other => println!("PyPI mcap: {other:?}"),
    }
}

/// Settings of [`Lamp`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct LampSettings {
    /// Pictures a second [Hz]
    rate_hz: f64,
}

/// A camera that costs next to nothing: the same picture again and again.
struct Lamp {
    period: Interval,
    next: u64,
    camera: CameraId,
    picture: Image,
    pool: Pool<Image>,
}

foveate_node::ports! {
    fn lamp_ports;
    IMAGE: Out<Image> = "image";
}

impl Node for Lamp {
    const TYPE: &'static str = "bench.lamp";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "The same picture again and again";
    const LIVE: bool = true;
    type Settings = LampSettings;

    fn ports() -> Ports {
        lamp_ports()
    }
    fn new(settings: LampSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let camera = setup.camera.unwrap_or_default();
        Ok(Lamp {
            period: Interval::from_s(1.0 / settings.rate_hz),
            next: 0,
            camera,
            picture: picture(u32::from(camera.0) + 1),
            pool: Pool::default(),
        })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let mut image = self.pool.take(Image::default);
        image.clone_from(&self.picture);
        image.camera = self.camera;
        let image = self.pool.share(image);
        io.emit_at(&IMAGE, io.now(), image);
        self.next += 1;
        Ok(())
    }
    fn due(&mut self) -> Due {
        Due::At(Time(self.period.0 * self.next as i64))
    }
}

/// Settings of [`Look`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct LookSettings {}

foveate_node::ports! {
    fn look_ports;
    SEEN: In<Image> = each("image");
}

/// Takes pictures.
struct Look;

impl Node for Look {
    const TYPE: &'static str = "bench.look";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Takes pictures";
    type Settings = LookSettings;

    fn ports() -> Ports {
        look_ports()
    }
    fn new(_: LookSettings, _: &Setup) -> Result<Self, ConfigError> {
        Ok(Look)
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let _ = io.take(&SEEN);
        Ok(())
    }
}

fn graph(folder: &Path, seconds: f64) -> Arc<Graph> {
    let mut registry = Registry::new();
    registry.add::<Lamp>();
    registry.add::<Look>();
    let cameras: String = (1..=18).map(|n| format!("wide-{n}")).chain((1..=4).map(|n| format!("ptz-{n}"))).fold(
        "[calibration]\nlength_unit = \"m\"\n".to_owned(),
        |text, name| {
            text + &format!(
                "[camera.{name}]\nimage_size_px = [640, 480]\nfocal_px = [600.0, 600.0]\nprincipal_point_px = [319.5, 239.5]\n\
                 camera_from_world_wxyz = [1.0, 0.0, 0.0, 0.0]\nposition_m = [0.0, 0.0, 0.0]\n"
            )
        },
    );
    fs::write(folder.join("bench.calibration.toml"), cameras).unwrap();
    let node = |name: &str, kind: &str, rest: &str| {
        format!("[scale.room.node.{name}]\ntype = \"bench.{kind}\"\neach = \"*\"\n{rest}\n")
    };
    let text = format!(
        "[rig]\nname = \"bench\"\ncalibration = \"bench.calibration.toml\"\nduration_s = {seconds}\n[scale.room]\n"
    ) + &node("video", "lamp", &format!("rate_hz = {RATE_HZ:?}"))
        + &node("look", "look", "in = { image = \"video.image\" }");
    match rig::load(&text, &folder.join("bench.toml"), &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(faults) => panic!("{}", faults.render(false)),
    }
}

/// Processor time of this process so far [s].
fn processor_s() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let ticks = |it: usize| fields.get(it).and_then(|it| it.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(11) + ticks(12)) / 100.0
}

/// Writes the bytes of the rig's pictures into a plain file, and has the disk take them twice a second.
fn plain(path: &Path, seconds: f64) {
    let pictures: Vec<Image> = (1..=22).map(picture).collect();
    let mut file = fs::File::create(path).unwrap();
    let began = Instant::now();
    for n in 0..(RATE_HZ * seconds) as u32 {
        let due = Duration::from_secs_f64(f64::from(n) / RATE_HZ);
        std::thread::sleep(due.saturating_sub(began.elapsed()));
        pictures.iter().for_each(|it| file.write_all(&it.pixels).unwrap());
        if n % (RATE_HZ / 2.0) as u32 == 0 {
            file.sync_data().unwrap();
        }
    }
}

fn live(folder: &Path, only: Option<&str>) {
    let seconds = 10.0;
    let mut alone = 0.0;
    let choices = [
        ("alone", None),
        ("plain file", None),
        ("raw", Some((Packing::None, Pictures::Lossless))),
        ("lz4", Some((Packing::Lz4, Pictures::Lossless))),
        ("zstd 1", Some((Packing::Zstd, Pictures::Lossless))),
        ("jpeg 90", Some((Packing::None, Pictures::Jpeg(90)))),
    ];
    for (name, choice) in choices.into_iter().filter(|it| only.is_none_or(|only| it.0 == only)) {
        let graph = graph(folder, seconds);
        let path = folder.join("live.mcap");
        let _ = fs::remove_file(&path);
        let recorder = choice.map(|(packing, pictures)| {
            let recording = Recording {
                path: path.clone(),
                packing,
                pictures,
                of_cameras: Vec::new(),
                hide_px: Vec::new(),
                hide_scales: Vec::new(),
                memory: 256 << 20,
                waits: false,
                with_unused: false,
                mode: "live",
                began_unix_ns: 0,
                from: None,
            };
            Recorder::begin(&graph, &recording, Host::default()).unwrap()
        });
        let before = processor_s();
        let beside = (name == "plain file").then(|| {
            let path = path.clone();
            std::thread::spawn(move || plain(&path, seconds))
        });
        let options = Options { tap: recorder.as_ref().map(Recorder::tap), ..Options::default() };
        let outcome = engine::live(graph, &options, &mut |_| {}).unwrap();
        let recorded = recorder.map(Recorder::finish).unwrap_or_default();
        if let Some(it) = beside {
            it.join().unwrap();
        }
        let spent = (processor_s() - before) / seconds;
        if name == "alone" {
            alone = spent;
        }
        let n: u64 = outcome.ledgers.iter().map(|it| it.delivered).sum();
        let p99 = outcome.ledgers.iter().filter_map(|it| it.age_s(0.99)).fold(0.0, f64::max) * 1e3;
        let rate = n as f64 * f64::from(SIZE[0] * SIZE[1]) / 1e6 / seconds;
        println!(
            "live {name}: {rate:.0} MB/s of pictures, {:.1} % of a core on top, age p99 {p99:.3} ms, {} of {n} pictures left out",
            100.0 * (spent - alone),
            recorded.left_out.pictures,
        );
        if choice.is_some() {
            assert_eq!(recorded.failure, None);
            Session::open(&path).unwrap();
        }
        let _ = fs::remove_file(&path);
    }
}
