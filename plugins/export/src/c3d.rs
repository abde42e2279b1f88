//! `export.c3d`: targets and marks as C3D, on one time base, in millimetres of the world.
//!
//! Positions are 32-bit floats or 16-bit integers. The residual is the standard deviation of the position (root of the mean variance over the axes), used as
//! the mean distance of the rays; at least one step for measured points, 0 for points filled in by a shape model, −1 for missing points.
//!
//! The camera mask has seven bits. With up to seven cameras each has its own, in the order of the calibration; with more they share the
//! bits evenly, neighbours by name together. `FOVEATE:CAMERAS` in the file says which. `FOVEATE:START_S` is the session time of the first frame.

use std::collections::BTreeMap;
use std::io::{self, Read, Write};

use foveate::motion::c3d::{Event, Growing, POINT_BYTES, Recording, Sample};
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::csv::camera_names;
use crate::frame_file::{About, Columns, Format, FrameFile};
use crate::gather::{Common, Gather, default_gap_ms, ports};
use crate::time_base;

/// Bits of the mask.
const BITS: usize = 7;
/// Bytes that each label has at least while the file grows, so that those of points that come later find room.
const ROOM_FOR_LABELS: usize = 24;

/// Number format of the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Numbers {
    /// 32-bit floats: exact to a few nanometres.
    #[default]
    Float,
    /// 16-bit integers: half as long, exact to a 65,000th of the extent; for programs that read only integers.
    Integer,
}

/// An event of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EventSettings {
    /// Time, on the session's clock [s]
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub time_s: f64,
    /// Label, at most 120 bytes; programs that read only the header see the first four characters [–]
    pub label: String,
    /// Context, such as `Left`, `Right`, `General` [–]
    #[serde(default = "default_context")]
    pub context: String,
}

fn default_context() -> String {
    "General".to_owned()
}

/// Settings of [`ExportC3d`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExportC3dSettings {
    /// Name of the file in the results folder [–]
    #[serde(default = "default_file")]
    pub file: String,
    /// Frame rate; 0: that of the marks where they are connected, 60 otherwise [Hz]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub rate_hz: f64,
    /// Longest gap between two samples of a point that is interpolated; in a longer one the point is missing [ms]
    #[serde(default = "default_gap_ms")]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub gap_ms: f64,
    /// Names in the file in place of `target-N`, `PARENT-target-N` (PARENT: the parent scale's name) and `mark-N` [–]
    #[serde(default)]
    pub labels: BTreeMap<String, String>,
    /// Number format of the points: `float` or `integer` [–]
    #[serde(default)]
    pub numbers: Numbers,
    /// Step of the residuals, at most 255 steps; with `integer` the step is that of the coordinates instead [mm]
    #[serde(default = "default_residual_step_mm")]
    #[schemars(range(min = 0.000001, max = 1000.0))]
    pub residual_step_mm: f64,
    /// Events of the file, at most 255, each as `{ time_s = 1.5, label = "start", context = "General" }` [–]
    #[serde(default)]
    pub events: Vec<EventSettings>,
}

fn default_file() -> String {
    "motion.c3d".to_owned()
}

fn default_residual_step_mm() -> f64 {
    0.02
}

/// Targets and marks into a C3D file, during the run: at any time the file holds all frames so far. Integers are converted from floats at the end, because their scale is
/// that of the farthest point.
pub struct ExportC3d {
    gather: Option<Gather>,
    file: FrameFile<C3d>,
}

/// Converts frames to those of a C3D file.
struct C3d {
    /// Without points: what all frames have in common.
    growing: Growing,
    events: Vec<EventSettings>,
    cameras: Vec<String>,
    residual_step_mm: f32,
    numbers: Numbers,
    /// The largest coordinate [mm].
    farthest: f32,
    row: Vec<Sample>,
}

impl C3d {
    fn growing(&self, about: &About, labels: &[String], label_bytes: usize) -> Result<Growing, String> {
        let event = |it: &EventSettings| Event {
            label: it.label.clone(),
            context: it.context.clone(),
            time_s: it.time_s - about.start_s,
        };
        let recording = Recording {
            rate_hz: about.rate_hz as f32,
            units: "mm".to_owned(),
            first_frame: 1,
            labels: labels.to_vec(),
            events: self.events.iter().map(event).collect(),
            cameras: bits(&self.cameras),
            start_s: Some(about.start_s),
            ..Recording::default()
        };
        Growing::new(recording, self.residual_step_mm, label_bytes).map_err(|it| it.to_string())
    }

    fn sample(&self, it: &time_base::Sample) -> Sample {
        Sample {
            position: [0, 1, 2].map(|axis| (it.position[axis] * 1e3) as f32),
            // Not 0 even where the covariance is: that would say that it was not measured.
            residual: if it.is_filled { 0.0 } else { (it.sigma() as f32 * 1e3).max(f32::MIN_POSITIVE) },
            cameras: it.cameras.iter().fold(0, |mask, camera| mask | 1 << bit(camera, self.cameras.len())),
        }
    }

    /// Calls `give` with the samples of each row; missing columns are missing samples.
    fn rows(
        &self,
        columns: &Columns,
        from: &mut dyn Read,
        mut give: impl FnMut(&[[u8; POINT_BYTES]]) -> io::Result<()>,
    ) -> io::Result<()> {
        let mut missing = Vec::new();
        self.growing.put(&[Sample::MISSING], &mut missing);
        let mut before = vec![0; columns.n_before * POINT_BYTES];
        let missing = missing.first_chunk().copied().unwrap_or_default();
        let mut row = vec![missing; columns.sources.len()];
        while fill(from, &mut before)? {
            let points = before.as_chunks::<POINT_BYTES>().0;
            for (to, source) in row.iter_mut().zip(&columns.sources) {
                *to = source.map_or(missing, |it| points[it]);
            }
            give(&row)?;
        }
        Ok(())
    }
}

/// Reads one row; `false` at the end.
fn fill(from: &mut dyn Read, row: &mut [u8]) -> io::Result<bool> {
    match from.read_exact(row) {
        Ok(()) => Ok(!row.is_empty()),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}

impl Format for C3d {
    fn room(&self, _about: &About, labels: &[String]) -> usize {
        labels.iter().map(String::len).max().unwrap_or(0).max(ROOM_FOR_LABELS)
    }

    fn head(&self, about: &About, labels: &[String], n_frames: usize, room: usize) -> Result<Vec<u8>, String> {
        self.growing(about, labels, room)?.head(n_frames).map_err(|it| it.to_string())
    }

    fn put(&mut self, _about: &About, _frame: usize, points: &[Option<time_base::Sample>], rows: &mut Vec<u8>) {
        let mut row = std::mem::take(&mut self.row);
        row.clear();
        row.extend(points.iter().map(|it| it.as_ref().map_or(Sample::MISSING, |it| self.sample(it))));
        let there = row.iter().filter(|it| it.is_present()).flat_map(|it| it.position);
        self.farthest = there.map(f32::abs).filter(|it| it.is_finite()).fold(self.farthest, f32::max);
        self.growing.put(&row, rows);
        self.row = row;
    }

    fn convert(&self, columns: &Columns, from: &mut dyn Read, to: &mut dyn Write) -> io::Result<()> {
        self.rows(columns, from, |row| to.write_all(row.as_flattened()))
    }

    fn is_other_at_the_end(&self) -> bool {
        self.numbers == Numbers::Integer
    }

    fn last_head(&self, about: &About, labels: &[String], n_frames: usize) -> Result<Vec<u8>, String> {
        let growing = self.growing(about, labels, 0)?;
        let head = match self.numbers {
            Numbers::Float => growing.head(n_frames),
            Numbers::Integer => growing.integer_head(n_frames, Growing::integer_step(self.farthest)),
        };
        head.map_err(|it| it.to_string())
    }

    fn convert_last(&self, columns: &Columns, from: &mut dyn Read, to: &mut dyn Write) -> io::Result<()> {
        if self.numbers == Numbers::Float {
            return self.convert(columns, from, to);
        }
        let step = Growing::integer_step(self.farthest);
        let (mut samples, mut bytes) = (Vec::new(), Vec::new());
        self.rows(columns, from, |row| {
            samples.clear();
            bytes.clear();
            samples.extend(row.iter().map(|it| self.growing.sample(*it)));
            Growing::put_integers(&samples, step, &mut bytes);
            to.write_all(&bytes)
        })
    }

    fn end(&self, n_bytes: u64, n_frames: usize) -> Vec<u8> {
        vec![0; Growing::padding(n_bytes, n_frames)]
    }
}

/// The bit of a camera among `n_cameras`.
fn bit(camera: CameraId, n_cameras: usize) -> usize {
    let camera = usize::from(camera.0);
    (if n_cameras > BITS { camera * BITS / n_cameras } else { camera }).min(BITS - 1)
}

/// The name of each bit, of the length that a name may have.
fn bits(cameras: &[String]) -> Vec<String> {
    let mut bits = vec![String::new(); cameras.len().min(BITS)];
    for (number, name) in (0..).zip(cameras) {
        let text = &mut bits[bit(CameraId(number), cameras.len())];
        if text.len() + name.len() < 110 {
            text.push_str(if text.is_empty() { "" } else { "+" });
            text.push_str(name);
        } else if !text.ends_with('…') {
            text.push('…');
        }
    }
    bits
}

impl ExportC3d {
    /// As when it comes at the port, at the message's own time.
    #[cfg(test)]
    pub(crate) fn push(&mut self, message: std::sync::Arc<Targets>) {
        let now = message.time;
        if let Some(gather) = &mut self.gather {
            gather.push_targets(message, false);
            self.file.take(gather, now);
        }
    }
}

figures! {
    "c3d.points": count, neither, "Targets and marks in the file";
    "c3d.frames": count, neither, "Frames in the file, including those without any point";
}

impl Node for ExportC3d {
    const TYPE: &'static str = "export.c3d";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes targets and marks as C3D, with residuals, camera masks, gaps and events";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportC3dSettings;

    fn ports() -> Ports {
        ports()
    }

    fn new(settings: ExportC3dSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let ExportC3dSettings { file, rate_hz, gap_ms, labels, .. } = &settings;
        let gather = Gather::new(&Common { file, rate_hz: *rate_hz, gap_ms: *gap_ms, labels }, setup)?;
        ConfigError::unless_in("residual_step_mm", settings.residual_step_mm, 1e-6..=1e3)?;
        if settings.events.len() > 255 {
            return Err(ConfigError::at(
                "events",
                format_args!("found {}, expected at most 255", settings.events.len()),
            ));
        }
        for event in &settings.events {
            ConfigError::unless_in("events", event.time_s, 0.0..=1e6)?;
        }
        let texts = settings.events.iter().flat_map(|it| [&it.label, &it.context]).map(|it| ("events", it));
        if let Some((setting, long)) = texts.chain(labels.values().map(|it| ("labels", it))).find(|it| it.1.len() > 120)
        {
            return Err(ConfigError::at(setting, format_args!("found `{long}`, expected at most 120 bytes")));
        }
        let residual_step_mm = settings.residual_step_mm as f32;
        let growing = Growing::new(Recording::default(), residual_step_mm, 0)
            .map_err(|error| ConfigError::at("residual_step_mm", error))?;
        let format = C3d {
            growing,
            events: settings.events.clone(),
            cameras: camera_names(setup),
            residual_step_mm,
            numbers: settings.numbers,
            farthest: 0.0,
            row: Vec::new(),
        };
        Ok(Self { gather: Some(gather.taken_by_frame()), file: FrameFile::new(setup, file, format) })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(gather) = &mut self.gather {
            gather.take(io);
            self.file.take(gather, io.now());
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Some(mut gather) = self.gather.take() else { return Ok(()) };
        self.file.finish(&mut gather, "c3d", report)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate::motion::c3d::read;
    use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Vector3};

    use super::*;
    use crate::target_rows::tests::target;

    fn node(settings: &str, n_cameras: usize, folder: &std::path::Path) -> Result<ExportC3d, ConfigError> {
        let setup = Setup {
            out_dir: Some(folder.to_owned()),
            calibration: Arc::new(foveate_testkit::scene::ring_calibration(n_cameras)),
            connected: vec!["targets".to_owned(), "marks".to_owned()],
            ..Setup::for_tests()
        };
        ExportC3d::new(toml::from_str(settings).unwrap(), &setup)
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<ExportC3d>(
            "rate_hz = 60.0\nlabels = { target-1 = \"head\" }\nevents = [{ time_s = 1.0, label = \"go\" }]",
        );
    }

    #[test]
    fn targets_and_marks_lie_on_one_time_base_with_all_that_is_known() {
        let folder = tempfile::tempdir().unwrap();
        let mut node =
            node("labels = { mark-4 = \"nose\" }\nevents = [{ time_s = 0.3, label = \"blink\" }]", 3, folder.path())
                .unwrap();
        let gather = node.gather.as_mut().unwrap();
        let mark = |label, x, provenance| Mark {
            label,
            position: Point3::new(x, 0.0, 0.0),
            covariance: Matrix3::identity() * 1e-6,
            cameras: [CameraId(0), CameraId(2)].into_iter().collect(),
            provenance,
        };
        // Marks at 25 Hz from 0.2 s on, one of them filled; a target at 100 Hz with a hole.
        for step in 0..5 {
            let marks = Marks {
                time: Time::from_s(0.2 + 0.04 * f64::from(step)),
                world_from_marks: Isometry3::new(Vector3::z(), Vector3::zeros()),
                covariance: Matrix6::zeros(),
                list: vec![
                    mark(4, 0.5, Provenance::Measured),
                    mark(5, 0.25, if step == 2 { Provenance::Filled } else { Provenance::Measured }),
                ],
                fit: None,
            };
            gather.push_marks(Arc::new(marks));
        }
        for step in 0..=50 {
            let time = 0.01 * f64::from(step);
            let provenance = if (21..27).contains(&step) { Provenance::Predicted } else { Provenance::Measured };
            let list = vec![target(1, [time, 0.0, 0.0], provenance)];
            gather.push_targets(Arc::new(Targets { time: Time::from_s(time), list }), false);
        }
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        assert_eq!(report.files, [std::path::PathBuf::from("motion.c3d")]);
        let found = read(&std::fs::read(folder.path().join("motion.c3d")).unwrap()).unwrap();
        assert_eq!((found.rate_hz, found.units.as_str()), (25.0, "mm"));
        assert_eq!(found.labels, ["target-1", "nose", "mark-5"]);
        assert_eq!(found.cameras, ["ring-1", "ring-2", "ring-3"]);
        assert_eq!((found.n_frames(), found.start_s), (13, Some(0.0)));
        assert!((found.events[0].time_s - 0.3).abs() < 1e-6);
        let frame = |frame: usize| found.frame(frame);
        assert_eq!(frame(5)[1], Sample { position: [500.0, 0.0, 1000.0], residual: 1.0, cameras: 0b101 });
        assert_eq!(frame(7)[2], Sample { position: [250.0, 0.0, 1000.0], residual: 0.0, cameras: 0b101 });
        assert!(!frame(4)[1].is_present() && !frame(10)[1].is_present());
        assert!((frame(5)[0].position[0] - 200.0).abs() < 1e-3 && frame(5)[0].cameras == 0b010);
        assert!(!frame(6)[0].is_present(), "240 ms lies between 200 and 270");
        assert!(frame(7)[0].residual > 0.0, "{:?}", frame(7)[0]);
        assert_eq!(report.figures["c3d.frames"], 13.0);
    }

    #[test]
    fn cameras_share_the_bits_when_there_are_many() {
        let shared: Vec<usize> = (0..18).map(|it| bit(CameraId(it), 18)).collect();
        assert_eq!(shared, [0, 0, 0, 1, 1, 1, 2, 2, 3, 3, 3, 4, 4, 5, 5, 5, 6, 6]);
        let names: Vec<String> = (1..=9).map(|it| format!("c{it}")).collect();
        assert_eq!(bits(&names), ["c1+c2", "c3", "c4", "c5+c6", "c7", "c8", "c9"]);
        assert_eq!(bits(&names[..2]), ["c1", "c2"]);
    }

    #[test]
    fn settings_that_cannot_be_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let refused = |settings: &str| node(settings, 3, folder.path()).map(drop).unwrap_err().setting;
        assert_eq!(refused("file = \"../x\"").as_deref(), Some("file"));
        assert_eq!(refused("gap_ms = -1.0").as_deref(), Some("gap_ms"));
        assert_eq!(refused("rate_hz = nan").as_deref(), Some("rate_hz"));
        assert_eq!(refused("residual_step_mm = 0.0").as_deref(), Some("residual_step_mm"));
        assert_eq!(refused("labels = { mark-1 = \"a\", mark-2 = \"a\" }").as_deref(), Some("labels"));
        assert_eq!(refused(&format!("labels = {{ mark-1 = \"{}\" }}", "x".repeat(121))).as_deref(), Some("labels"));
        assert_eq!(refused("events = [{ time_s = -1.0, label = \"x\" }]").as_deref(), Some("events"));
    }

    #[test]
    fn targets_of_a_moving_scale_need_its_anchors() {
        use foveate::messages::ScaleId;
        use foveate::node::scale::{ScalePlace, ScaleTree};
        let place = |name: &str, parent, is_anchored| ScalePlace { name: name.to_owned(), parent, is_anchored };
        let places = [place("room", None, false), place("face", Some(ScaleId(0)), true)];
        let scales = ScaleTree { own: ScaleId(1), places: places.into() };
        let setup = Setup { scales, connected: vec!["targets".to_owned()], ..Setup::for_tests() };
        let settings: ExportC3dSettings = toml::from_str("").unwrap();
        let error = ExportC3d::new(settings.clone(), &setup).map(drop).unwrap_err();
        assert!(error.message.contains("`anchor.space`"), "{}", error.message);
        let complete = Setup { connected: vec!["targets".to_owned(), "spaces".to_owned()], ..setup };
        assert!(ExportC3d::new(settings, &complete).is_ok());
    }
}
