//! `capture.detections`: 2D points of one camera out of a CSV file, as `export.features` writes it.
//!
//! The columns stand at [`DetectionsSettings::path`]. A row that cannot be read is a gap at its time with the file and the line,
//! and the other points of that picture are given out all the same.

use std::path::PathBuf;

use foveate::node::setup::expand_path;
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::clock::camera_clock;
use crate::detections_csv::{POINTS_DAT, Table, Wanted};
use crate::labels;
use crate::settings::camera_of;

ports! {
    FEATURES: Out<Features> = "features";
}

/// A file whose first time is later than this has another origin of time than the session, such as 1970 [s].
const LATEST_START_S: f64 = 1e6;

/// Settings of [`Detections`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DetectionsSettings {
    /// Table of points. DeepLabCut's CSV and SLEAP's analysis CSV are known by their headers (their pictures are numbered: the rate is
    /// `frame_rate_hz` of the camera's clock in the calibration). Else a CSV file with a header: `time_s`, `camera`, `x_px`, `y_px`, perhaps `sigma_px`, `area_px`, `peak`, `cxx_px2`, `cxy_px2`, `cyy_px2`, `label`, in any order; `#` begins a
    /// comment; a row with empty `x_px` and `y_px` is a picture in which nothing was found. Each instance takes the
    /// rows of its own camera [–]
    pub path: String,
    /// Coordinate of the centre of the top-left pixel in the file: 0, or 1 as in MATLAB; left out, it is 1 in `points.dat`, whose own
    /// calibrations count so, and 0 otherwise [px]
    #[serde(default)]
    #[schemars(range(min = 0, max = 1))]
    pub pixel_origin: Option<u8>,
    /// Standard deviation of either coordinate where the file gives none [px]
    #[serde(default = "default_sigma_px")]
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub sigma_px: f64,
    /// The file's columns, where it has no header: names of `path`, and `frame` for the number of a picture instead of `time_s` (its rate:
    /// `frame_rate_hz` of the camera's clock in the calibration). Blanks or commas separate the fields; without `camera`, all rows are
    /// of the instance's camera. `points.dat`: the file is MultiCamSelfCal's of that name, with `IdMat.dat` beside it, its cameras in the
    /// order of the calibration. Empty: the file has a header [–]
    #[serde(default)]
    pub columns: String,
    /// Points of DeepLabCut or SLEAP with a lower likelihood are left out; points marked by hand are kept [–]
    #[serde(default = "default_likelihood")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_likelihood: f64,
    /// Whether a point at (0, 0), in the file's coordinates, means that nothing was found [–]
    #[serde(default)]
    pub nothing_at_zero: bool,
    /// Clock of the times: `calibration`, the camera's own clock if the calibration states one, else the session's; `none`, the
    /// session's; `file:PATH`, the camera's own clock as that file of `[clock.NAME]` sections states it [–]
    #[serde(default = "default_clock")]
    pub clock: String,
    /// Added to every time of the file; rows before the start of the session are left out [s]
    #[serde(default)]
    #[schemars(range(min = -9000000000.0, max = 9000000000.0))]
    pub start_s: f64,
    /// Delay between capture and delivery of the points [ms]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub latency_ms: f64,
}

fn default_clock() -> String {
    "calibration".to_owned()
}

fn default_likelihood() -> f64 {
    0.6
}

fn default_sigma_px() -> f64 {
    0.5
}

/// Names of the points in the files of `path` (the setting), over all `cameras`, in the order of their numbers; empty where points
/// have no names. Missing files are skipped.
///
/// # Errors
/// A sentence: a file that is no table of points.
pub fn label_names<'a>(
    path: &str,
    cameras: impl Iterator<Item = &'a str>,
    rig_dir: &std::path::Path,
) -> Result<Vec<String>, String> {
    let paths: std::collections::BTreeSet<PathBuf> = match path.contains("{camera}") {
        true => cameras.filter_map(|it| expand_path(&path.replace("{camera}", it), rig_dir).ok()).collect(),
        false => expand_path(path, rig_dir).into_iter().collect(),
    };
    let mut names = std::collections::BTreeSet::new();
    for path in paths.iter().filter(|it| it.is_file()) {
        names.extend(labels::names_in(path)?);
    }
    Ok(names.into_iter().collect())
}

/// Points out, one message per capture time of the camera.
pub struct Detections {
    table: Table,
    next: usize,
    before_start: usize,
    start: Interval,
    latency: Interval,
    path: PathBuf,
    instance: String,
    camera: String,
    /// Cameras with rows that are missing in the calibration.
    unknown_cameras: Vec<String>,
    /// Names of points, in the order of their numbers.
    names: Vec<String>,
}

impl Node for Detections {
    const TYPE: &'static str = "capture.detections";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Reads 2D points of one camera from a CSV file";
    type Settings = DetectionsSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: DetectionsSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let pixel_origin = settings.pixel_origin.unwrap_or(u8::from(settings.columns == POINTS_DAT));
        ConfigError::unless_in("pixel_origin", pixel_origin, 0..=1)?;
        ConfigError::unless_in("sigma_px", settings.sigma_px, 0.001..=1000.0)?;
        ConfigError::unless_in("start_s", settings.start_s, -9e9..=9e9)?;
        ConfigError::unless_in("latency_ms", settings.latency_ms, 0.0..=60_000.0)?;
        let camera = camera_of(setup, Self::TYPE)?;
        let Some(name) = setup.camera_name() else {
            return Err(ConfigError::node(format_args!("the calibration has no camera number {}", camera.0)));
        };
        let clock = camera_clock(setup, &settings.clock)?;
        ConfigError::unless_in("least_likelihood", settings.least_likelihood, 0.0..=1.0)?;
        let path = setup.path("path", &settings.path)?;
        let cameras = setup.calibration.cameras.iter().map(|it| it.name.as_str());
        let names = match settings.columns.is_empty() {
            true => {
                label_names(&settings.path, cameras, &setup.rig_dir).map_err(|fault| ConfigError::at("path", fault))?
            }
            false => Vec::new(),
        };
        let wanted = Wanted {
            camera,
            name,
            size: setup.camera_model().map(|it| it.image_size),
            origin: f64::from(pixel_origin),
            sigma: settings.sigma_px,
            columns: (!settings.columns.is_empty()).then_some(settings.columns.as_str()),
            frame_rate: clock.frame_rate_hz,
            nothing_at_zero: settings.nothing_at_zero,
            row: "line",
            names: &names,
            least_likelihood: settings.least_likelihood,
        };
        let mut table = Table::read(&path, &wanted).map_err(|fault| ConfigError::at("path", fault))?;
        let is_unknown = |name: &&String| setup.calibration.index_of(name).is_none();
        if table.frames.is_empty() && table.other_cameras.iter().all(|it| is_unknown(&it)) {
            let names: Vec<String> = table.other_cameras.iter().map(|it| format!("`{it}`")).collect();
            // Of no camera in particular, so that it is said once.
            let (path, names) = (path.display(), names.join(", "));
            let fault = format!("`{path}` holds no row of a camera of the calibration; it has rows of {names}");
            return Err(ConfigError::at("path", fault));
        }
        if (clock.offset_s, clock.rate) != (0.0, 1.0) {
            // Rates are above 0, so that the order stays.
            table.frames.iter_mut().for_each(|it| it.time = Time::from_s(clock.session_s(it.time.as_s())));
        }
        let start = Interval::from_s(settings.start_s);
        let before_start = table.frames.iter().filter(|it| it.time + start < Time::ZERO).count();
        if before_start == table.frames.len() && before_start > 0 {
            let fault = format!("all times in `{}` lie before the start of the session; set start_s", path.display());
            return Err(ConfigError::at("path", fault));
        }
        let first = table.frames.get(before_start).map(|it| it.time + start);
        if let Some(first) = first.filter(|it| *it > Time::from_s(LATEST_START_S)) {
            let fault = format!(
                "`{}` begins at {first}; set start_s = {:.6} to begin there",
                path.display(),
                settings.start_s - first.as_s()
            );
            return Err(ConfigError::at("path", fault));
        }
        let latency = Interval::from_ms(settings.latency_ms);
        let unknown_cameras = table.other_cameras.iter().filter(is_unknown).cloned().collect();
        let instance = setup.instance.clone();
        let camera = name.to_owned();
        Ok(Self {
            table,
            next: before_start,
            before_start,
            start,
            latency,
            path,
            instance,
            camera,
            unknown_cameras,
            names,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(frame) = self.table.frames.get_mut(self.next) else { return Ok(()) };
        self.next += 1;
        let time = frame.time + self.start;
        for fault in &frame.faults {
            io.gap(&FEATURES, time, format_args!("{}, {fault}", self.path.display()));
        }
        // Where no row could be read, it is not known whether anything was seen.
        if frame.faults.is_empty() || !frame.features.list.is_empty() {
            io.emit_at(&FEATURES, time, std::mem::take(&mut frame.features));
        }
        Ok(())
    }

    fn due(&mut self) -> Due {
        match self.table.frames.get(self.next) {
            Some(frame) => Due::At(frame.time + self.start + self.latency),
            None => Due::Never,
        }
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let (table, instance, path) = (&self.table, &self.instance, self.path.display());
        let rows = |count: u64| if count == 1 { "1 row".to_owned() } else { format!("{count} rows") };
        let faults =
            table.faults.sentence(&format!("{instance} could not read {} of `{path}`", rows(table.faults.count())));
        report.remarks.extend(faults);
        if table.frames.is_empty() {
            report.remark(format!("{instance} delivered nothing: `{path}` holds no row of camera `{}`", self.camera));
        }
        if table.out_of_order > 0 {
            let late = rows(table.out_of_order);
            report.remark(format!("{instance} sorted `{path}` by time: {late} came after a later one"));
        }
        if !table.unknown_columns.is_empty() {
            report.remark(format!("{instance} ignored columns of `{path}`: {}", table.unknown_columns.join(", ")));
        }
        if !self.names.is_empty() {
            // The same words from every camera: said once.
            let numbered: Vec<String> = self.names.iter().enumerate().map(|it| format!("{} {}", it.0, it.1)).collect();
            report.remark(format!("numbers of the points: {}", numbered.join(", ")));
        }
        if !self.unknown_cameras.is_empty() {
            // The same words from every camera that reads this file: said once.
            let names = self.unknown_cameras.join(", ");
            report.remark(format!("`{path}` holds rows of cameras that are missing in the calibration: {names}"));
        }
        if self.before_start > 0 {
            report.remark(format!(
                "{instance} left out {} pictures of `{path}` before the start of the session",
                self.before_start
            ));
        }
        Ok(())
    }

    fn plan(settings: &DetectionsSettings) -> Plan {
        Plan { latency_s: settings.latency_ms * 1e-3, ..Plan::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::tests::setup_with_camera;

    fn settings(path: &str) -> DetectionsSettings {
        DetectionsSettings {
            path: path.to_owned(),
            pixel_origin: None,
            sigma_px: 0.5,
            least_likelihood: default_likelihood(),
            columns: String::new(),
            nothing_at_zero: false,
            clock: default_clock(),
            start_s: 0.0,
            latency_ms: 5.0,
        }
    }

    fn node_of(text: &str, start_s: f64) -> Result<Detections, ConfigError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.csv");
        std::fs::write(&path, text).unwrap();
        let settings = DetectionsSettings { start_s, ..settings(path.to_str().unwrap()) };
        Detections::new(settings, &setup_with_camera([640, 480]))
    }

    #[test]
    fn rows_of_a_camera_that_nobody_knows_are_named() {
        let own = setup_with_camera([640, 480]).camera_name().unwrap().to_owned();
        let mut node = node_of(&format!("time_s,camera,x_px,y_px\n0.1,{own},5,6\n0.1,narrow-3,5,6\n"), 0.0).unwrap();
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        assert!(report.remarks.iter().any(|it| it.contains("narrow-3")), "{:?}", report.remarks);
    }

    #[test]
    fn camera_without_rows_gives_nothing_and_says_so() {
        let mut node = node_of("time_s,camera,x_px,y_px\n0.1,ring-2,5,6\n", 0.0).unwrap();
        assert_eq!(node.due(), Due::Never);
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        assert!(report.remarks[0].contains("holds no row of camera `ring-1`"), "{:?}", report.remarks);
        let refused = node_of("time_s,camera,x_px,y_px\n0.1,narrow-3,5,6\n", 0.0).map(|_| ()).unwrap_err();
        assert!(refused.message.contains("no row of a camera of the calibration"), "{refused}");
        assert!(refused.message.contains("narrow-3"), "{refused}");
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<Detections>("path = \"points.csv\"");
    }

    #[test]
    fn frames_are_due_at_their_times() {
        let mut node = node_of("time_s,camera,x_px,y_px\n0.1,ring-1,1,2\n0.2,ring-2,1,2\n0.3,ring-1,,\n", 0.0).unwrap();
        assert_eq!(node.due(), Due::At(Time::from_s(0.105)));
        node.next += 1;
        assert_eq!(node.due(), Due::At(Time::from_s(0.305)));
        node.next += 1;
        assert_eq!(node.due(), Due::Never);
    }

    #[test]
    fn times_of_the_camera_s_own_clock_become_those_of_the_session() {
        let folder = tempfile::tempdir().unwrap();
        let (points, clocks) = (folder.path().join("points.csv"), folder.path().join("clocks.toml"));
        std::fs::write(&points, "time_s,camera,x_px,y_px\n30,ring-1,1,2\n35,ring-1,1,2\n").unwrap();
        std::fs::write(&clocks, "[clock.ring-1]\noffset_s = 31\nrate = 2\n").unwrap();
        let clock = format!("file:{}", clocks.display());
        let settings = DetectionsSettings { clock, ..settings(points.to_str().unwrap()) };
        let mut node = Detections::new(settings, &setup_with_camera([640, 480])).unwrap();
        assert_eq!((node.before_start, node.due()), (1, Due::At(Time::from_s(2.005))));
    }

    #[test]
    fn times_can_be_moved_to_the_start_of_the_session() {
        let text = "time_s,camera,x_px,y_px\n1600000000.5,ring-1,1,2\n";
        let refused = node_of(text, 0.0).map(|_| ()).unwrap_err();
        assert!(refused.message.ends_with("set start_s = -1600000000.500000 to begin there"), "{refused}");
        assert_eq!(node_of(text, -1_600_000_000.5).unwrap().due(), Due::At(Time::from_s(0.005)));
        let mut node = node_of("time_s,camera,x_px,y_px\n99,ring-1,1,2\n100.5,ring-1,1,2\n", -100.0).unwrap();
        assert_eq!(node.due(), Due::At(Time::from_s(0.505)));
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        assert!(report.remarks[0].contains("left out 1"), "{:?}", report.remarks);
    }

    #[test]
    fn the_first_pixel_of_points_dat_is_1_unless_said_otherwise() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("points.dat"), "11 21\n6 7\n1 1\n").unwrap();
        std::fs::write(folder.path().join("IdMat.dat"), "1 1\n").unwrap();
        let path = folder.path().join("points.dat");
        let mut setup = setup_with_camera([640, 480]);
        let name = setup.camera_name().unwrap().to_owned();
        let clock = foveate::scene::clocks::CameraClock { frame_rate_hz: Some(10.0), ..Default::default() };
        let mut calibration = (*setup.calibration).clone();
        calibration.clocks.0.insert(name, clock);
        setup.calibration = std::sync::Arc::new(calibration);
        let first = |pixel_origin: Option<u8>, columns: &str| {
            let text = settings(path.to_str().unwrap());
            let settings = DetectionsSettings { pixel_origin, columns: columns.to_owned(), ..text };
            let node = Detections::new(settings, &setup).unwrap();
            node.table.frames[0].features.list[0].centre
        };
        assert_eq!(first(None, POINTS_DAT), nalgebra::Point2::new(10.0, 5.0));
        assert_eq!(first(Some(0), POINTS_DAT), nalgebra::Point2::new(11.0, 6.0));
        assert_eq!(first(Some(1), POINTS_DAT), nalgebra::Point2::new(10.0, 5.0));
        std::fs::write(&path, "0 11 6\n1 21 7\n").unwrap();
        assert_eq!(first(None, "frame x_px y_px"), nalgebra::Point2::new(11.0, 6.0));
    }

    #[test]
    fn a_name_is_one_number_in_the_files_of_all_cameras() {
        let folder = tempfile::tempdir().unwrap();
        let table = |name: &str, part: &str| {
            let text =
                format!("scorer,n,n,n\nbodyparts,{part},{part},{part}\ncoords,x,y,likelihood\n0,5,6,0.9\n3,7,8,0.1\n");
            std::fs::write(folder.path().join(format!("{name}.csv")), text).unwrap();
        };
        let mut setup = setup_with_camera([640, 480]);
        let own = setup.camera_name().unwrap().to_owned();
        let mut calibration = (*setup.calibration).clone();
        let other = calibration.cameras.iter().map(|it| it.name.clone()).find(|it| *it != own).unwrap();
        let clock = foveate::scene::clocks::CameraClock { frame_rate_hz: Some(10.0), ..Default::default() };
        calibration.clocks.0.extend(calibration.cameras.iter().map(|it| (it.name.clone(), clock)));
        setup.calibration = std::sync::Arc::new(calibration);
        table(&own, "tail");
        table(&other, "ear");
        let path = folder.path().join("{camera}.csv");
        let mut node = Detections::new(settings(path.to_str().unwrap()), &setup).unwrap();
        let labels: Vec<Vec<Option<u32>>> =
            node.table.frames.iter().map(|it| it.features.list.iter().map(|it| it.label).collect()).collect();
        assert_eq!(labels, [vec![Some(1)], vec![]], "ear is 0, tail 1; what is not likely is left out");
        assert_eq!(node.table.frames[1].time, Time::from_s(0.3));
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        assert!(report.remarks.iter().any(|it| it.contains("0 ear, 1 tail")), "{:?}", report.remarks);
    }

    #[test]
    fn unusable_files_point_at_the_setting() {
        let refused = node_of("nonsense", 0.0).map(|_| ()).unwrap_err();
        assert_eq!(refused.setting.as_deref(), Some("path"));
        let missing = Detections::new(settings("/no/such/file.csv"), &setup_with_camera([640, 480])).map(|_| ());
        assert!(missing.unwrap_err().message.contains("/no/such/file.csv"));
    }
}
