//! Records a run: a thread of its own takes what happened from the [`Tap`] and writes it.

use std::any::Any;
use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use foveate_engine::tap::{Entry, Event, Fate, LeftOut, Tap, Wanted};
use foveate_messages::{Image, Time};
use foveate_node::Host;
use foveate_node::guard::guarded;
use foveate_node::io::Packet;
use foveate_rig::graph::{Graph, Instance, PictureForm, Record, SessionPacking};
use foveate_scene::selection::matches;
use serde_json::json;

use crate::attach::{self, Attached};
use crate::file::{Channel, Packing, SessionFile};
use crate::hidden::{Cover, Hidden};
use crate::names::{self, GraphNames, topic};
use crate::picture::Pictures;
use crate::shown::Shown;
use crate::viewer::{LogLevel, Schema};
use crate::wanted::wanted;
use crate::{body, order};

/// What was recorded is safe on the disk after so long.
const FLUSH_PERIOD: Duration = Duration::from_millis(250);
/// Pause before the tap is looked at again when it gave nothing.
const PAUSE: Duration = Duration::from_millis(5);
/// What has passed along each edge is written once in so long [ns].
const LEDGERS_NS: i64 = 1_000_000_000;
/// What is recorded, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// The file, which must not be there yet.
    pub path: PathBuf,
    /// Parts of pictures that are black, by patterns of cameras' names: left, top, width, height [px].
    pub hide_px: Vec<(String, Vec<[u32; 4]>)>,
    /// Scales that are black in pictures of other scales, and whose own pictures are not recorded.
    pub hide_scales: Vec<String>,
    /// How it is compressed.
    pub packing: Packing,
    /// How pictures are recorded.
    pub pictures: Pictures,
    /// How those of single cameras are, by patterns of their names; the first that matches decides.
    pub of_cameras: Vec<(String, Pictures)>,
    /// Bytes that may wait for the disk.
    pub memory: usize,
    /// The run waits for the disk. Only for runs on a logical clock.
    pub waits: bool,
    /// Also what no edge carries, and pictures that only sinks take.
    pub with_unused: bool,
    /// How the run is made: `live`, `paced`, `simulated` or `imported`.
    pub mode: &'static str,
    /// When it began, by the clock on the wall [ns since 1970]; 0 for a run on a logical clock, which is the same at any time.
    pub began_unix_ns: u128,
    /// Where the recording begins in a run that has begun before. It then has no order of delivery, as a part of a session.
    pub from: Option<Time>,
}

/// A recording that is being made.
pub struct Recorder {
    tap: Tap,
    thread: JoinHandle<Recorded>,
    is_abandoned: Arc<AtomicBool>,
    path: PathBuf,
}

impl Recording {
    /// As a rig says, of a simulated run that may go ahead.
    pub fn of(rig: &Record, path: PathBuf) -> Recording {
        let form = |it: PictureForm| match it {
            PictureForm::Lossless => Pictures::Lossless,
            PictureForm::Jpeg => Pictures::Jpeg(rig.jpeg_quality),
            PictureForm::None => Pictures::None,
        };
        Recording {
            path,
            packing: match rig.compression {
                SessionPacking::None => Packing::None,
                SessionPacking::Lz4 => Packing::Lz4,
                SessionPacking::Zstd => Packing::Zstd,
            },
            pictures: form(rig.pictures),
            of_cameras: rig.cameras.iter().map(|(name, it)| (name.clone(), form(*it))).collect(),
            hide_px: rig.hide_px.clone(),
            hide_scales: rig.hide_scales.clone(),
            memory: rig.memory_mb as usize * 1_000_000,
            waits: false,
            with_unused: false,
            mode: "simulated",
            began_unix_ns: 0,
            from: None,
        }
    }

    /// How the pictures of a camera are recorded.
    fn form(&self, camera: Option<&str>) -> Pictures {
        let of_camera = |name| self.of_cameras.iter().find(|it| matches(&it.0, name)).map(|it| it.1);
        camera.and_then(of_camera).unwrap_or(self.pictures)
    }
}

/// What a recorder leaves behind.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Recorded {
    /// Size of the file [bytes].
    pub bytes: u64,
    /// What was not recorded though it was wanted.
    pub left_out: LeftOut,
    /// Why the recording ended before the run did.
    pub failure: Option<String>,
    /// Sentences about files of the rig that are not in the session, and messages that could not be written.
    pub remarks: Vec<String>,
}

impl Recorder {
    /// Begins a recording of a run of `graph`.
    ///
    /// # Errors
    /// A sentence: the file cannot be begun.
    pub fn begin(graph: &Arc<Graph>, recording: &Recording, host: Host) -> Result<Recorder, String> {
        let tap = Recorder::tap_for(graph, recording)?;
        Recorder::begin_on(tap, graph, recording, host)
    }

    /// A tap for recordings like `recording`.
    ///
    /// # Errors
    /// A sentence: cameras or scales that are to be hidden and are not there.
    pub fn tap_for(graph: &Arc<Graph>, recording: &Recording) -> Result<Tap, String> {
        let (_, _, wanted) = plan(graph, recording)?;
        Ok(Tap::new(graph, recording.memory, recording.waits, |instance, port| wanted[instance][port]))
    }

    /// Begins a recording on a tap that [`Recorder::tap_for`] gave.
    ///
    /// # Errors
    /// A sentence: the file cannot be begun.
    pub fn begin_on(tap: Tap, graph: &Arc<Graph>, recording: &Recording, host: Host) -> Result<Recorder, String> {
        let (hidden, pictures, wanted) = plan(graph, recording)?;
        let attached = attach::gather(graph)?;
        let mut writing = Writing {
            file: SessionFile::create(&recording.path, recording.packing)?,
            graph: Arc::clone(graph),
            channels: graph.instances.iter().map(|it| vec![None; it.node_type.ports.outputs.len()]).collect(),
            left_out: BTreeMap::new(),
            wanted,
            pictures,
            hidden,
            shown: Shown::new(Arc::clone(graph)),
            order: None,
            status: None,
            last_status: String::new(),
            body: Vec::new(),
            // The rig has the other half of the cores.
            n_threads: (std::thread::available_parallelism().map_or(1, usize::from) / 2).max(2),
            remarks: attached.missing.clone(),
            is_ended: false,
            now: 0,
            passed: vec![[0; 4]; graph.edges.len()],
            ledgers_at: LEDGERS_NS,
            zero_unix_ns: i128::MAX,
            clock: if recording.began_unix_ns > 0 { Clock::Measured } else { Clock::None },
        };
        let failed = |what: String| format!("`{}` cannot be written: {what}", recording.path.display());
        writing.begin(recording, &attached).map_err(failed)?;
        let is_abandoned = Arc::new(AtomicBool::new(false));
        let thread = {
            let (tap, is_abandoned, path) = (tap.clone(), Arc::clone(&is_abandoned), recording.path.clone());
            std::thread::spawn(move || record(writing, &tap, &is_abandoned, &path, &host))
        };
        Ok(Recorder { tap, thread, is_abandoned, path: recording.path.clone() })
    }

    /// For [`Options::tap`](foveate_engine::Options).
    pub fn tap(&self) -> Tap {
        self.tap.clone()
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// After the run: writes what still waits, and the summary.
    pub fn finish(self) -> Recorded {
        self.is_abandoned.store(true, Ordering::Relaxed);
        self.thread
            .join()
            .unwrap_or_else(|_| Recorded { failure: Some("its thread died".to_owned()), ..Recorded::default() })
    }
}

/// What is hidden, how the pictures of each instance are recorded, and which messages are wanted, by instance and port.
type Plan = (Hidden, Vec<Pictures>, Vec<Vec<Wanted>>);

/// What a recording holds.
fn plan(graph: &Arc<Graph>, recording: &Recording) -> Result<Plan, String> {
    let camera = |it: &Instance| graph.calibration.cameras.get(usize::from(it.camera?.0)).map(|it| it.name.as_str());
    let hidden = Hidden::new(graph, &recording.hide_px, &recording.hide_scales)?;
    let form = |(index, it)| if hidden.is_whole(index) { Pictures::None } else { recording.form(camera(it)) };
    let pictures: Vec<Pictures> = graph.instances.iter().enumerate().map(form).collect();
    let mut wanted = wanted(graph, &pictures, recording.with_unused);
    hidden.needs(|instance, port| wanted[instance][port] = Wanted::Yes);
    Ok((hidden, pictures, wanted))
}

/// Adds a message to `body`.
fn encode(
    graph: &Graph,
    pictures: Pictures,
    (instance, port): (usize, usize),
    packet: &Packet,
    body: &mut Vec<u8>,
) -> Result<(), String> {
    let payload: &dyn Any = &*packet.payload;
    let Some(image) = payload.downcast_ref::<Image>() else {
        return body::encode(&graph.instances[instance].node_type.ports.outputs[port].message, packet, body);
    };
    let frame = graph.calibration.cameras.get(usize::from(image.camera.0));
    pictures.encode(&packet.stamp, image, frame.map_or("camera", |it| it.name.as_str()), body)
}

fn record(mut writing: Writing, tap: &Tap, is_abandoned: &AtomicBool, path: &Path, host: &Host) -> Recorded {
    let mut entries = VecDeque::new();
    let (mut flushed, mut rested) = (Instant::now(), Instant::now());
    let mut failure = None;
    while !writing.is_ended || !entries.is_empty() {
        // Looked at before the tap is, so that what was recorded last is seen.
        let is_last = is_abandoned.load(Ordering::Relaxed);
        if entries.is_empty() {
            tap.drain(&mut entries);
            writing.hide(&mut entries);
        }
        let was_empty = entries.is_empty();
        if was_empty {
            rested = Instant::now();
        }
        writing.file.at_leisure(rested.elapsed() < FLUSH_PERIOD);
        let written = guarded(|| {
            writing.take(&mut entries)?;
            if flushed.elapsed() >= FLUSH_PERIOD {
                writing.flush()?;
                flushed = Instant::now();
            }
            Ok(())
        });
        if let Err(what) = written.unwrap_or_else(Err) {
            tap.close();
            host.warn("recording", &format!("`{}` ends here, the run goes on: {what}", path.display()));
            failure = Some(what);
            break;
        }
        if was_empty {
            if is_last {
                break;
            }
            std::thread::sleep(PAUSE);
        }
    }
    let mut remarks = std::mem::take(&mut writing.remarks);
    if tap.is_order_lost() {
        remarks.push("the disk was too slow for the order of delivery: a replay ends where it is lost".to_owned());
    }
    let mut bytes = writing.file.length();
    if failure.is_none() {
        failure = writing.finish(tap).err();
        bytes = std::fs::metadata(path).map_or(bytes, |it| it.len());
    }
    Recorded { bytes, left_out: tap.left_out(), failure, remarks }
}

/// What the thread holds.
struct Writing {
    file: SessionFile,
    graph: Arc<Graph>,
    /// By instance, by port: begun with the first message.
    channels: Vec<Vec<Option<Channel>>>,
    /// By topic: messages that were wanted and are not there.
    left_out: BTreeMap<String, u64>,
    wanted: Vec<Vec<Wanted>>,
    /// By instance.
    pictures: Vec<Pictures>,
    hidden: Hidden,
    shown: Shown,
    order: Option<Channel>,
    status: Option<Channel>,
    last_status: String,
    body: Vec<u8>,
    /// That encode at the same time.
    n_threads: usize,
    remarks: Vec<String>,
    is_ended: bool,
    /// Time of the last event [ns].
    now: i64,
    /// By edge: messages that came in time, lost, at a stopped node, at a suspended scale.
    passed: Vec<[u64; 4]>,
    /// When these are written next [ns].
    ledgers_at: i64,
    /// When time 0 was, by the clock on the wall [ns since 1970]: what an event took to come here only makes it later.
    zero_unix_ns: i128,
    clock: Clock,
}

/// The clock on the wall, beside that of the session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Clock {
    /// A run on a logical clock has nothing to do with it.
    None,
    /// It is compared with each event.
    Measured,
    /// What was found is in the file.
    Written,
}

impl Writing {
    fn begin(&mut self, recording: &Recording, attached: &Attached) -> Result<(), String> {
        let graph = Arc::clone(&self.graph);
        let names = serde_json::to_vec(&GraphNames::of(&graph)).map_err(|error| error.to_string())?;
        let text = |it: &dyn std::fmt::Display| it.to_string();
        let facts = [
            ("version", text(&names::VERSION)),
            ("program", text(&env!("CARGO_PKG_VERSION"))),
            ("rig", graph.name.clone()),
            ("seed", text(&graph.seed)),
            ("mode", recording.mode.to_owned()),
            ("began_unix_ns", text(&recording.began_unix_ns)),
            ("platform", format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS)),
            ("left_away", json!(self.left_away()).to_string()),
        ];
        let mut facts: BTreeMap<String, String> = facts.map(|(key, value)| (key.to_owned(), value)).into();
        let cut = recording.from.map(|it| ("cut".to_owned(), format!("from {} s to the end", it.as_s())));
        facts.extend(cut);
        self.file.metadata(names::SESSION, facts)?;
        self.file.attach(names::RIG, "application/toml", graph.resolved.as_bytes())?;
        self.file.attach(names::REPLAY_RIG, "application/toml", attached.rig.as_bytes())?;
        self.file.attach(names::GRAPH, "application/json", &names)?;
        for (name, bytes) in &attached.files {
            let is_program = attached.programs.contains(name);
            let media_type = if is_program { names::PROGRAM } else { "application/octet-stream" };
            self.file.attach(name, media_type, bytes)?;
        }
        let none = BTreeMap::new();
        if recording.from.is_none() {
            self.order = Some(self.file.channel(names::ORDER, names::ORDER_ENCODING, None, &none)?);
        }
        self.status = Some(self.file.channel(names::STATUS, "json", None, &none)?);
        self.file.flush()
    }

    /// Writes what has happened, up to as many pictures as are encoded at a time.
    fn take(&mut self, entries: &mut VecDeque<Entry>) -> Result<(), String> {
        let mut encoder = order::Encoder::default();
        let mut batch = Vec::new();
        let mut last = None;
        if self.clock == Clock::Measured
            && let Some(newest) = entries.iter().map(|it| it.now.0).max()
            && let Ok(since_1970) = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)
        {
            self.zero_unix_ns = self.zero_unix_ns.min(since_1970.as_nanos() as i128 - i128::from(newest));
        }
        let (n_entries, mut encoded) = self.encode_ahead(entries);
        for mut entry in entries.drain(..n_entries) {
            if let Event::Emitted { instance, port, is_kept, packet, .. } = &mut entry.event {
                let (instance, port) = (*instance, *port);
                if let Some(packet) = packet.take() {
                    let is_ahead = self.is_slow(instance, &packet);
                    let encoded = if is_ahead { encoded.pop_front() } else { None };
                    *is_kept = self.message(instance, port, &packet, encoded, entry.now.0)?;
                } else if self.wanted[instance][port] != Wanted::No {
                    self.count_left_out(instance, port);
                }
            }
            self.show(&entry)?;
            self.count(&entry)?;
            self.is_ended |= matches!(entry.event, Event::Ended { .. });
            encoder.add(&entry, &mut batch);
            last = Some(entry.now.0);
        }
        match (last, self.order) {
            (Some(now), Some(order)) => {
                self.now = self.now.max(now);
                self.file.message(order, self.now, self.now, &batch)
            }
            _ => Ok(()),
        }
    }

    /// Counts what passes along edges, and writes it once a second.
    fn count(&mut self, entry: &Entry) -> Result<(), String> {
        match entry.event {
            Event::Delivered { edge, fate, .. } => match fate {
                Fate::Put | Fate::PutBounded => self.passed[edge][0] += 1,
                Fate::Stopped => self.passed[edge][2] += 1,
                Fate::Suspended => self.passed[edge][3] += 1,
            },
            Event::Lost { edge, count, .. } => self.passed[edge][1] += count,
            _ => {}
        }
        if entry.now.0 < self.ledgers_at {
            return Ok(());
        }
        self.ledgers_at = (entry.now.0 / LEDGERS_NS + 1) * LEDGERS_NS;
        let mut figures = Vec::new();
        for (edge, passed) in self.graph.edges.iter().zip(&self.passed) {
            let counts = ["came", "lost", "stopped", "suspended"].iter().zip(passed);
            // What never happens is not drawn.
            let counts = counts.filter(|it| *it.0 == "came" || *it.1 > 0);
            figures.extend(counts.map(|(what, count)| (format!("{}: {what}", edge.name), *count as f64)));
        }
        self.shown.figures(&mut self.file, entry.now.0, &figures)
    }

    /// Takes out of pictures what is not to be written.
    fn hide(&mut self, entries: &mut VecDeque<Entry>) {
        let is_any = self.hidden.is_any();
        for entry in entries.iter_mut().filter(|_| is_any) {
            let Event::Emitted { instance, is_kept, packet, .. } = &mut entry.event else { continue };
            let Some(given) = packet else { continue };
            self.hidden.see(given);
            let Some(image) = given.as_typed::<Image>() else { continue };
            match self.hidden.cover(*instance, given.stamp.time, image) {
                Cover::Nothing => {}
                Cover::Parts(image) => given.payload = Arc::new(image),
                Cover::Unknown => (*is_kept, *packet) = (false, None),
            }
        }
    }

    /// Whether a message is encoded beside others.
    fn is_slow(&self, instance: usize, packet: &Packet) -> bool {
        let payload: &dyn Any = &*packet.payload;
        matches!(self.pictures[instance], Pictures::Jpeg(_)) && payload.is::<Image>()
    }

    /// Encodes the first slow messages of `entries`, and says how many entries that covers.
    fn encode_ahead(&self, entries: &VecDeque<Entry>) -> (usize, VecDeque<Result<Vec<u8>, String>>) {
        // So many that the threads end at nearly the same time.
        let most = 8 * self.n_threads;
        let slow = entries.iter().enumerate().filter_map(|(place, it)| match &it.event {
            Event::Emitted { instance, port, packet: Some(packet), .. } if self.is_slow(*instance, packet) => {
                Some((place, *instance, *port, packet))
            }
            _ => None,
        });
        let slow: Vec<_> = slow.take(most).collect();
        let n_entries = if slow.len() < most { entries.len() } else { slow[most - 1].0 + 1 };
        let (graph, pictures) = (&*self.graph, &self.pictures);
        let mut encoded = VecDeque::from(vec![Ok(Vec::new()); slow.len()]);
        let queue = Mutex::new(slow.iter().zip(&mut encoded));
        let work = || {
            let next = || queue.lock().unwrap_or_else(PoisonError::into_inner).next();
            while let Some((&(_, instance, port, packet), encoded)) = next() {
                let mut body = Vec::new();
                *encoded = encode(graph, pictures[instance], (instance, port), packet, &mut body).map(|()| body);
            }
        };
        std::thread::scope(|scope| {
            (1..self.n_threads.min(slow.len())).for_each(|_| drop(scope.spawn(work)));
            work();
        });
        (n_entries, encoded)
    }

    /// Topics that are not recorded.
    fn left_away(&self) -> Vec<String> {
        let graph = &self.graph;
        let ports = |it: &Instance| it.node_type.ports.outputs.clone();
        let all = graph.instances.iter().enumerate().flat_map(|(index, it)| {
            let outputs = ports(it).into_iter().enumerate();
            outputs.map(move |(port, output)| (index, port, topic(&it.path, output.name)))
        });
        all.filter(|(index, port, _)| self.wanted[*index][*port] == Wanted::No).map(|it| it.2).collect()
    }

    /// What viewers show of an event.
    fn show(&mut self, entry: &Entry) -> Result<(), String> {
        let path = |instance: &usize| self.graph.instances[*instance].path.as_str();
        let now = entry.now.0;
        match &entry.event {
            Event::Gap { instance, gap, .. } => {
                self.shown.log(&mut self.file, now, LogLevel::Warning, path(instance), &gap.reason)
            }
            Event::Failed { instance, error, action, .. } => {
                let line = format!("{} ({action})", error.message);
                self.shown.log(&mut self.file, now, LogLevel::Error, path(instance), &line)
            }
            Event::Finished { instance, report, .. } if !report.figures.is_empty() => {
                let figures = report.figures.iter().map(|(name, it)| (format!("{}: {name}", path(instance)), *it));
                self.shown.figures(&mut self.file, now, &figures.collect::<Vec<_>>())
            }
            _ => Ok(()),
        }
    }

    fn count_left_out(&mut self, instance: usize, port: usize) {
        let it = &self.graph.instances[instance];
        *self.left_out.entry(topic(&it.path, it.node_type.ports.outputs[port].name)).or_default() += 1;
    }

    /// Writes a message, which may be `encoded` already; `false` where it could not be turned into bytes.
    fn message(
        &mut self,
        instance: usize,
        port: usize,
        packet: &Packet,
        encoded: Option<Result<Vec<u8>, String>>,
        now: i64,
    ) -> Result<bool, String> {
        let graph = Arc::clone(&self.graph);
        let node = &graph.instances[instance];
        let output = &node.node_type.ports.outputs[port];
        let pictures = self.pictures[instance];
        let encoded = match encoded {
            Some(encoded) => encoded.map(|it| self.body = it),
            None => {
                self.body.clear();
                encode(&graph, pictures, (instance, port), packet, &mut self.body)
            }
        };
        if let Err(what) = encoded {
            let sentence = format!("messages at `{}` of {} cannot be recorded: {what}", output.name, node.path);
            if !self.remarks.contains(&sentence) {
                self.remarks.push(sentence);
            }
            self.count_left_out(instance, port);
            return Ok(false);
        }
        let channel = match self.channels[instance][port] {
            Some(channel) => channel,
            None => {
                let message = &output.message;
                let codec = message.wire.codec().ok_or("a message that cannot leave its process")?;
                let json = serde_json::to_vec(&codec.schema()).map_err(|error| error.to_string())?;
                let described = pictures.kind().schema();
                let payload: &dyn Any = &*packet.payload;
                let is_picture = payload.is::<Image>();
                let (encoding, schema) = match is_picture {
                    true => (Schema::ENCODING, (described.name, Schema::ENCODING, described.descriptor.as_slice())),
                    false => (names::MESSAGE_ENCODING, (message.name, "jsonschema", json.as_slice())),
                };
                let facts = [
                    ("instance", node.path.clone()),
                    ("port", output.name.to_owned()),
                    ("message", message.name.to_owned()),
                    ("version", message.version.to_string()),
                    ("layout", format!("{:016x}", codec.layout())),
                    ("space", message.space.in_words()),
                    (
                        "is_lossy",
                        (is_picture && (self.is_slow(instance, packet) || self.hidden.hides(instance))).to_string(),
                    ),
                ];
                let facts = facts.map(|(key, value)| (key.to_owned(), value)).into();
                let topic = topic(&node.path, output.name);
                let channel = self.file.channel(&topic, encoding, Some(schema), &facts)?;
                self.channels[instance][port] = Some(channel);
                channel
            }
        };
        self.file.message(channel, now, packet.stamp.time.0, &self.body)?;
        self.shown.message(&mut self.file, (instance, port), packet, now)?;
        Ok(true)
    }

    fn flush(&mut self) -> Result<(), String> {
        if self.clock == Clock::Measured && self.zero_unix_ns < i128::MAX {
            let zero = [("zero_unix_ns".to_owned(), self.zero_unix_ns.to_string())];
            self.file.metadata(names::CLOCK, zero.into())?;
            self.clock = Clock::Written;
        }
        if !self.left_out.is_empty() {
            let status = json!({ "left_out": self.left_out }).to_string();
            if let Some(channel) = self.status.filter(|_| status != self.last_status) {
                self.file.message(channel, self.now, self.now, status.as_bytes())?;
                self.last_status = status;
            }
        }
        self.file.flush()
    }

    fn finish(mut self, tap: &Tap) -> Result<(), String> {
        self.flush()?;
        let left_out = tap.left_out();
        let mut facts: BTreeMap<String, String> =
            self.remarks.iter().enumerate().map(|(n, it)| (format!("remark_{n}"), it.clone())).collect();
        facts.insert("left_out_pictures".to_owned(), left_out.pictures.to_string());
        facts.insert("left_out_messages".to_owned(), left_out.messages.to_string());
        facts.insert("is_order_lost".to_owned(), tap.is_order_lost().to_string());
        self.file.metadata(names::END, facts)?;
        self.file.finish()
    }
}
