//! `export.trc`: targets and marks as TRC, on one time base, in millimetres.

use std::collections::BTreeMap;
use std::io::{self, BufRead, BufReader, Read, Write};

use foveate::motion::motion;
use foveate::motion::trc::{Recording, head, put_row};
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::frame_file::{About, Columns, Format, FrameFile};
use crate::gather::{Common, Gather, default_gap_ms, ports};
use crate::time_base::Sample;

/// Which way is up in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Up {
    /// y, as in OpenSim: (x, y, z) of the world are written as (x, z, −y).
    #[default]
    Y,
    /// z, as in the world.
    Z,
}

/// Settings of [`ExportTrc`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExportTrcSettings {
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
    /// Which axis is up in the file: `y`, as in OpenSim, or `z` [–]
    #[serde(default)]
    pub up: Up,
    /// Whether points filled in by a shape model are written; TRC cannot mark them [–]
    #[serde(default = "default_filled")]
    pub filled: bool,
}

fn default_file() -> String {
    "motion.trc".to_owned()
}

fn default_filled() -> bool {
    true
}

/// Targets and marks into a TRC file, during the run: at any time the file holds all frames so far.
pub struct ExportTrc {
    gather: Option<Gather>,
    file: FrameFile<Trc>,
}

/// How frames become rows.
struct Trc {
    file: String,
    up: Up,
    filled: bool,
    row: Vec<Option<[f64; 3]>>,
    text: String,
}

impl Format for Trc {
    /// The length of the head.
    fn room(&self, about: &About, labels: &[String]) -> usize {
        // Twice the digits that the number of frames may still get, and a long name for each spare column.
        let spare = labels.iter().filter(|it| it.starts_with("unused-")).count();
        self.whole_head(about, labels, 0, 0).len() + 2 * 8 + 24 * spare
    }

    fn head(&self, about: &About, labels: &[String], n_frames: usize, room: usize) -> Result<Vec<u8>, String> {
        let length = self.whole_head(about, labels, n_frames, 0).len();
        Ok(self.whole_head(about, labels, n_frames, room.saturating_sub(length)).into_bytes())
    }

    fn put(&mut self, about: &About, frame: usize, points: &[Option<Sample>], rows: &mut Vec<u8>) {
        let place = |it: &Sample| {
            let is_wanted = self.filled || !it.is_filled;
            let up = match self.up {
                Up::Y => motion::Up::Y,
                Up::Z => motion::Up::Z,
            };
            is_wanted.then(|| up.of_z_up([0, 1, 2].map(|axis| it.position[axis] * 1e3)))
        };
        self.row.clear();
        self.row.extend(points.iter().map(|it| it.as_ref().and_then(place)));
        self.text.clear();
        put_row(&mut self.text, frame + 1, about.start_s + frame as f64 / about.rate_hz, &self.row);
        rows.extend_from_slice(self.text.as_bytes());
    }

    fn convert(&self, columns: &Columns, from: &mut dyn Read, to: &mut dyn Write) -> io::Result<()> {
        let mut from = BufReader::new(from);
        let mut line = String::new();
        let mut row = String::new();
        while from.read_line(&mut line)? > 0 {
            row.clear();
            let fields: Vec<&str> = line.trim_end_matches('\n').split('\t').collect();
            let (start, points) = fields.split_at(fields.len().min(2));
            row.push_str(&start.join("\t"));
            for source in &columns.sources {
                let of_point = source.and_then(|it| points.get(3 * it..3 * it + 3)).unwrap_or(&["", "", ""]);
                of_point.iter().for_each(|it| {
                    row.push('\t');
                    row.push_str(it);
                });
            }
            row.push('\n');
            to.write_all(row.as_bytes())?;
            line.clear();
        }
        Ok(())
    }

    fn end(&self, _n_bytes: u64, _n_frames: usize) -> Vec<u8> {
        Vec::new()
    }
}

impl Trc {
    fn whole_head(&self, about: &About, labels: &[String], n_frames: usize, room: usize) -> String {
        let recording = Recording {
            rate_hz: about.rate_hz,
            units: "mm".to_owned(),
            labels: labels.to_vec(),
            ..Recording::default()
        };
        head(&recording, n_frames, &self.file, room)
    }
}

impl ExportTrc {
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
    "trc.points": count, neither, "Targets and marks in the file";
    "trc.frames": count, neither, "Frames in the file, including those without any point";
}

impl Node for ExportTrc {
    const TYPE: &'static str = "export.trc";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes targets and marks as TRC for OpenSim, in millimetres";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportTrcSettings;

    fn ports() -> Ports {
        ports()
    }

    fn new(settings: ExportTrcSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let ExportTrcSettings { file, rate_hz, gap_ms, labels, .. } = &settings;
        let gather = Gather::new(&Common { file, rate_hz: *rate_hz, gap_ms: *gap_ms, labels }, setup)?;
        let format =
            Trc { file: file.clone(), up: settings.up, filled: settings.filled, row: Vec::new(), text: String::new() };
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
        self.file.finish(&mut gather, "trc", report)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate::motion::trc::read;

    use super::*;
    use crate::target_rows::tests::target;

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<ExportTrc>("up = \"z\"");
    }

    #[test]
    fn points_are_in_millimetres_with_y_up_and_holes_empty() {
        let folder = tempfile::tempdir().unwrap();
        let setup = Setup { out_dir: Some(folder.path().to_owned()), ..Setup::for_tests() };
        let settings = "rate_hz = 10.0\nlabels = { target-3 = \"waist\" }\nfilled = false";
        let mut node = ExportTrc::new(toml::from_str(settings).unwrap(), &setup).unwrap();
        for (step, provenance) in [(0, Provenance::Measured), (2, Provenance::Filled), (3, Provenance::Measured)] {
            let list = vec![target(3, [1.0, 2.0, 3.0], provenance)];
            let message = Targets { time: Time::from_s(0.1 * f64::from(step)), list };
            node.gather.as_mut().unwrap().push_targets(Arc::new(message), false);
        }
        node.finish(&mut Report::default()).unwrap();
        let found = read(&std::fs::read_to_string(folder.path().join("motion.trc")).unwrap()).unwrap();
        assert_eq!((found.labels, found.units, found.rate_hz), (vec!["waist".to_owned()], "mm".to_owned(), 10.0));
        let there = Some([1000.0, 3000.0, -2000.0]);
        assert_eq!(found.positions, [there, None, None, there]);
        assert_eq!(found.times_s, [0.0, 0.1, 0.2, 0.3]);
    }
}
