//! `export.trc`: targets and marks as TRC, on one time base, in millimetres.

use std::collections::BTreeMap;

use foveate::motion::trc::{Recording, write};
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::gather::{Common, Gather, Table, default_gap_ms, ports};
use crate::whole_file::WholeFile;

/// Which way is up in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Up {
    /// y, as OpenSim has it: (x, y, z) of the world stand as (x, z, −y).
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
    /// Frames a second; 0: that of the marks where they are connected, 60 otherwise [Hz]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub rate_hz: f64,
    /// Between two samples of a point that are farther apart it is missing [ms]
    #[serde(default = "default_gap_ms")]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub gap_ms: f64,
    /// Names in the file in place of `target-N`, `PARENT-target-N` (PARENT: the parent scale's name) and `mark-N` [–]
    #[serde(default)]
    pub labels: BTreeMap<String, String>,
    /// Which axis is up in the file: `y`, as OpenSim has it, or `z` [–]
    #[serde(default)]
    pub up: Up,
    /// Whether points that a model of shape filled in are written; TRC cannot tell them from measured ones [–]
    #[serde(default = "default_filled")]
    pub filled: bool,
}

fn default_file() -> String {
    "motion.trc".to_owned()
}

fn default_filled() -> bool {
    true
}

/// Targets and marks into a TRC file, at the end of the run.
pub struct ExportTrc {
    gather: Option<Gather>,
    file: WholeFile,
    settings: ExportTrcSettings,
}

impl ExportTrc {
    fn recording(&self, table: &Table) -> Recording {
        let position = |it: &crate::time_base::Sample| {
            let [x, y, z] = [0, 1, 2].map(|axis| it.position[axis] * 1e3);
            let is_wanted = self.settings.filled || !it.is_filled;
            is_wanted.then_some(match self.settings.up {
                Up::Y => [x, z, -y],
                Up::Z => [x, y, z],
            })
        };
        Recording {
            rate_hz: table.rate_hz,
            units: "mm".to_owned(),
            labels: table.points.iter().map(|it| it.label.clone()).collect(),
            times_s: (0..table.n_frames).map(|it| table.time_s(it)).collect(),
            positions: Table::dense(&table.points, table.n_frames, None, position),
        }
    }
}

impl Node for ExportTrc {
    const TYPE: &'static str = "export.trc";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes targets and marks as TRC for OpenSim: millimetres, missing points left empty";
    type Settings = ExportTrcSettings;

    fn ports() -> Ports {
        ports()
    }

    fn new(settings: ExportTrcSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let ExportTrcSettings { file, rate_hz, gap_ms, labels, .. } = &settings;
        let gather = Gather::new(&Common { file, rate_hz: *rate_hz, gap_ms: *gap_ms, labels }, setup)?;
        Ok(Self { gather: Some(gather), file: WholeFile::new(setup, &settings.file), settings })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(gather) = &mut self.gather {
            gather.take(io);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Some(gather) = self.gather.take() else { return Ok(()) };
        let table = gather.finish(&self.settings.file, report);
        report.figure("trc.points", table.points.len() as f64);
        report.figure("trc.frames", table.n_frames as f64);
        if !self.file.is_wanted() {
            return Ok(());
        }
        self.file.write(write(&self.recording(&table), &self.settings.file).as_bytes(), report)
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
        for (step, how) in [(0, How::Measured), (2, How::Filled), (3, How::Measured)] {
            let list = vec![target(3, [1.0, 2.0, 3.0], how)];
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
