//! `capture.motion`: targets and marks out of a motion file: C3D, TRC, BVH, our own tables, archives of `export.npy`.
//!
//! What is in the file decides its form. Points called `mark-N` are marks, and those that `marks` names, numbered in the order of the file; all others are targets,
//! numbered N where they are called `target-N`, else in the order of the file. All are in the world with z up, in metres. A target's velocity is the difference of its neighbours over their
//! time; the provenance of a sample (`measured`, `predicted`, `filled`) is kept, and samples that `fill_ms` adds are `filled`.

use std::collections::BTreeSet;

use foveate::motion::Motion;
use foveate::motion::fill::fill;
use foveate::motion::forms::{self, ReadOptions};
use foveate::motion::motion::{Sample, Up};
use foveate::motion::smooth::smooth;
use foveate::prelude::*;
use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    TARGETS: Out<Targets> = "targets";
    MARKS: Out<Marks> = "marks";
}

figures! {
    "motion.frames": count, neither, "Frames in the file";
        "motion.frames_given": count, neither, "Frames delivered; those before the start of the session are left out";
    "motion.targets": count, neither, "Points of the file that are targets";
    "motion.marks": count, neither, "Points of the file that are marks";
        "motion.gaps_filled": count, neither, "Gaps of single points that fill_ms filled";
        "motion.gaps_too_long": count, low, "Gaps longer than fill_ms, left open";
}

/// Which axis of the file is up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FileUp {
    /// As a C3D file states; y in TRC and BVH, z in all others.
    #[default]
    AsTold,
    /// y.
    Y,
    /// z.
    Z,
}

/// Settings of [`CaptureMotion`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaptureMotionSettings {
    /// The file: C3D, TRC, BVH, `targets.csv`, `marks.csv`, `motion.npz` [–]
    pub path: String,
    /// Points that are marks, besides those called `mark-N`; `*` matches any letters, as in `F*` [–]
    #[serde(default)]
    pub marks: Vec<String>,
    /// Length of the file's unit; 0: as the file states, centimetres in BVH [m]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub metres_per_unit: f64,
    /// Which axis of the file is up: `as_told`, `y` or `z` [–]
    #[serde(default)]
    pub up: FileUp,
    /// Gaps up to this long are filled; 0: none [ms]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub fill_ms: f64,
    /// Cut-off of a low-pass filter without phase lag; 0: no filter [Hz]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub smooth_hz: f64,
    /// Standard deviation of a position where the file gives none [mm]
    #[serde(default = "default_sigma_mm")]
    #[schemars(range(min = 0.000001, max = 10000.0))]
    pub sigma_mm: f64,
    /// Added to every time of the file; frames before the start of the session are left out [s]
    #[serde(default)]
    #[schemars(range(min = -9000000000.0, max = 9000000000.0))]
    pub start_s: f64,
    /// Delay between capture and delivery of frames [ms]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub latency_ms: f64,
}

fn default_sigma_mm() -> f64 {
    1.0
}

/// What a point of the file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Target(u32),
    Mark(u32),
}

/// Whether a name matches a pattern with `*`.
fn is_of(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((start, rest)) => name.strip_prefix(start).is_some_and(|name| {
            let mut places = name.char_indices().map(|it| it.0).chain([name.len()]);
            places.any(|it| is_of(rest, &name[it..]))
        }),
    }
}

/// Each point's kind and number.
fn kinds(labels: &[String], marks: &[String]) -> Vec<Kind> {
    let number = |label: &str, kind: &str| -> Option<u32> {
        label.strip_prefix(kind)?.strip_prefix('-')?.parse().ok().filter(|it| label == format!("{kind}-{it}"))
    };
    let is_mark = |it: &String| marks.iter().any(|pattern| is_of(pattern, it));
    let taken = |kind: &str| labels.iter().filter_map(|it| number(it, kind)).collect::<BTreeSet<u32>>();
    let mut free_targets = (0..u32::MAX).filter({
        let taken = taken("target");
        move |it| !taken.contains(it)
    });
    let mut free_marks = (0..u32::MAX).filter({
        let taken = taken("mark");
        move |it| !taken.contains(it)
    });
    let kind = |label: &String| match (number(label, "mark"), number(label, "target")) {
        (Some(mark), _) => Kind::Mark(mark),
        (_, _) if is_mark(label) => Kind::Mark(free_marks.next().unwrap_or(u32::MAX)),
        (_, Some(target)) => Kind::Target(target),
        _ => Kind::Target(free_targets.next().unwrap_or(u32::MAX)),
    };
    labels.iter().map(kind).collect()
}

/// Targets and marks out, frame by frame.
pub struct CaptureMotion {
    motion: Motion,
    /// Ascending by kind and number: the point's place in the file.
    order: Vec<(Kind, usize)>,
    next: usize,
    n_before: usize,
    latency: Interval,
    start: Interval,
    sigma: f64,
    /// Cameras of the file, where the calibration has them.
    cameras: Vec<Option<CameraId>>,
    remarks: Vec<String>,
    figures: [(&'static str, f64); 5],
}

impl CaptureMotion {
    fn covariance(&self, sample: &Sample) -> Matrix3<f64> {
        let known = sample.covariance().filter(|it| it.trace() > 0.0);
        known.unwrap_or_else(|| Matrix3::identity() * (self.sigma * self.sigma))
    }

    fn cameras(&self, sample: &Sample) -> CameraSet {
        sample.cameras.iter().filter_map(|it| *self.cameras.get(usize::from(it.0))?).collect()
    }

    /// Difference of the frames before and after, where the point is there, else of one of them and this one; and its variance. [m/s]
    fn velocity(&self, frame: usize, point: usize) -> (Vector3<f64>, f64) {
        let near = |frame: Option<usize>| Some((frame?, self.motion.get(frame?, point)?));
        let here = near(Some(frame));
        let from = near(frame.checked_sub(1)).or(here);
        let to = near(Some(frame + 1).filter(|it| *it < self.motion.n_frames())).or(here);
        let Some(((before, a), (behind, b))) = from.zip(to).filter(|it| it.0.0 < it.1.0) else {
            return (Vector3::zeros(), 1.0);
        };
        let dt = self.motion.times_s[behind] - self.motion.times_s[before];
        let variances = self.covariance(a).trace() / 3.0 + self.covariance(b).trace() / 3.0;
        ((b.position - a.position) / dt, variances / (dt * dt))
    }

    fn targets(&self, frame: usize, time: Time) -> Targets {
        let target = |(kind, point): &(Kind, usize)| {
            let (Kind::Target(id), sample) = (kind, self.motion.get(frame, *point)?) else { return None };
            let (velocity, variance) = self.velocity(frame, *point);
            let mut covariance = Matrix6::identity() * variance;
            covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.covariance(sample));
            let cameras = self.cameras(sample);
            Some(Target {
                id: TargetId(*id),
                position: sample.position,
                velocity,
                covariance,
                cameras,
                provenance: sample.provenance,
            })
        };
        Targets { time, list: self.order.iter().filter_map(target).collect() }
    }

    fn marks(&self, frame: usize, time: Time) -> Marks {
        let mark = |(kind, point): &(Kind, usize)| {
            let (Kind::Mark(label), sample) = (kind, self.motion.get(frame, *point)?) else { return None };
            let (covariance, cameras) = (self.covariance(sample), self.cameras(sample));
            Some(Mark { label: *label, position: sample.position, covariance, cameras, provenance: sample.provenance })
        };
        let list = self.order.iter().filter_map(mark).collect();
        Marks { time, world_from_marks: Isometry3::identity(), list, ..Marks::default() }
    }

    fn time(&self, frame: usize) -> Option<Time> {
        Some(Time::from_s(*self.motion.times_s.get(frame)?) + self.start)
    }

    fn has(&self, is_kind: fn(&Kind) -> bool) -> bool {
        self.order.iter().any(|it| is_kind(&it.0))
    }
}

impl Node for CaptureMotion {
    const TYPE: &'static str = "capture.motion";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Reads targets and marks from a motion file: C3D, TRC, BVH, CSV tables or NPZ";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CaptureMotionSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CaptureMotionSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("metres_per_unit", settings.metres_per_unit, 0.0..=1000.0)?;
        ConfigError::unless_in("fill_ms", settings.fill_ms, 0.0..=60_000.0)?;
        ConfigError::unless_in("smooth_hz", settings.smooth_hz, 0.0..=100_000.0)?;
        ConfigError::unless_in("sigma_mm", settings.sigma_mm, 1e-6..=10_000.0)?;
        ConfigError::unless_in("start_s", settings.start_s, -9e9..=9e9)?;
        ConfigError::unless_in("latency_ms", settings.latency_ms, 0.0..=60_000.0)?;
        let path = setup.path("path", &settings.path)?;
        let name = path.display();
        let bytes = std::fs::read(&path)
            .map_err(|it| ConfigError::at("path", format_args!("`{name}` cannot be read: {it}")))?;
        let options = ReadOptions {
            metres_per_unit: Some(settings.metres_per_unit).filter(|it| *it > 0.0),
            up: match settings.up {
                FileUp::AsTold => None,
                FileUp::Y => Some(Up::Y),
                FileUp::Z => Some(Up::Z),
            },
        };
        let read =
            forms::read(&bytes, &options).map_err(|it| ConfigError::at("path", format_args!("`{name}`: {it}")))?;
        let mut motion = read.motion;
        let mut remarks: Vec<String> = read.remarks.iter().map(|it| format!("`{name}`: {it}")).collect();
        if motion.n_present() == 0 {
            let (n_points, n_frames) = (motion.labels.len(), motion.n_frames());
            let fault =
                format!("found no samples in `{name}` ({n_points} points, {n_frames} frames), expected one at least");
            return Err(ConfigError::at("path", fault));
        }
        let is_none = |pattern: &&String| !motion.labels.iter().any(|it| is_of(pattern, it));
        if let Some(pattern) = settings.marks.iter().find(is_none) {
            let few: Vec<String> = motion.labels.iter().take(12).map(|it| format!("`{it}`")).collect();
            let more = if motion.labels.len() > few.len() { ", …" } else { "" };
            let fault = format!("found no point `{pattern}` in `{name}`, which has {}{more}", few.join(", "));
            return Err(ConfigError::at("marks", fault));
        }
        motion.turn(Up::Z);
        let filled = match settings.fill_ms > 0.0 {
            true => fill(&mut motion, settings.fill_ms * 1e-3),
            false => Default::default(),
        };
        if settings.smooth_hz > 0.0 {
            let smoothed = smooth(&mut motion, settings.smooth_hz).map_err(|it| ConfigError::at("smooth_hz", it))?;
            if smoothed.n_too_short > 0 {
                remarks
                    .push(format!("`{name}`: {} samples are in runs too short to be smoothed", smoothed.n_too_short));
            }
        }
        let start = Interval::from_s(settings.start_s);
        let n_before = motion.times_s.iter().filter(|it| Time::from_s(**it) + start < Time::ZERO).count();
        if n_before == motion.n_frames() {
            let fault = format!("all frames of `{name}` lie before the start of the session");
            return Err(ConfigError::at("start_s", fault));
        }
        let mut order: Vec<(Kind, usize)> = kinds(&motion.labels, &settings.marks).into_iter().zip(0..).collect();
        order.sort_by_key(|it| match it.0 {
            Kind::Target(number) => (0, number),
            Kind::Mark(number) => (1, number),
        });
        let renamed = |(kind, point): &(Kind, usize)| {
            let name = match kind {
                Kind::Target(number) => format!("target-{number}"),
                Kind::Mark(number) => format!("mark-{number}"),
            };
            (name != motion.labels[*point]).then(|| format!("{name} = {}", motion.labels[*point]))
        };
        let list: Vec<String> = order.iter().filter_map(renamed).collect();
        if !list.is_empty() {
            remarks.push(format!("`{name}`: {}", list.join(", ")));
        }
        let cameras =
            motion.cameras.iter().map(|it| setup.calibration.index_of(it).map(|it| CameraId(it as u16))).collect();
        let n_of = |is_kind: fn(&Kind) -> bool| order.iter().filter(|it| is_kind(&it.0)).count() as f64;
        let figures = [
            ("motion.frames", motion.n_frames() as f64),
            ("motion.targets", n_of(|it| matches!(it, Kind::Target(_)))),
            ("motion.marks", n_of(|it| matches!(it, Kind::Mark(_)))),
            ("motion.gaps_filled", filled.n_gaps as f64),
            ("motion.gaps_too_long", filled.n_too_long as f64),
        ];
        if n_before > 0 {
            remarks.push(format!("`{name}`: {n_before} frames before the start of the session are left out"));
        }
        Ok(Self {
            motion,
            order,
            next: n_before,
            n_before,
            latency: Interval::from_ms(settings.latency_ms),
            start,
            sigma: settings.sigma_mm * 1e-3,
            cameras,
            remarks,
            figures,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(time) = self.time(self.next) else { return Ok(()) };
        if self.has(|it| matches!(it, Kind::Target(_))) {
            io.emit_at(&TARGETS, time, self.targets(self.next, time));
        }
        if self.has(|it| matches!(it, Kind::Mark(_))) {
            io.emit_at(&MARKS, time, self.marks(self.next, time));
        }
        self.next += 1;
        Ok(())
    }

    fn due(&mut self) -> Due {
        self.time(self.next).map_or(Due::Never, |it| Due::At(it + self.latency))
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        for (name, value) in self.figures {
            report.figure(name, value);
        }
        report.figure("motion.frames_given", (self.next - self.n_before) as f64);
        report.remarks.append(&mut self.remarks);
        Ok(())
    }

    fn plan(settings: &CaptureMotionSettings) -> Plan {
        Plan { latency_s: settings.latency_ms * 1e-3, ..Plan::default() }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    const TABLE: &str = "time_s,target,x_m,y_m,z_m,provenance,name\n0,0,0,0,1,measured,waist\n0,1,0,1,1,filled,mark-4\n0,2,5,5,5,measured,F nose\n\
                         0.1,0,0.2,0,1,measured,waist\n0.2,0,0.4,0,1,predicted,waist\n0.4,0,0.8,0,1,measured,waist\n";

    fn node_of(text: &[u8], settings: &str) -> Result<CaptureMotion, ConfigError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("motion");
        std::fs::write(&path, text).unwrap();
        let settings = format!("path = \"{}\"\n{settings}", path.display());
        CaptureMotion::new(toml::from_str(&settings).unwrap(), &Setup::for_tests())
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<CaptureMotion>("path = \"walk.c3d\"\nmarks = [\"F*\"]");
    }

    #[test]
    fn points_become_targets_and_marks_with_how_they_came_to_be() {
        let node = node_of(TABLE.as_bytes(), "marks = [\"F*\"]\nsigma_mm = 2.0\nstart_s = 1.0").unwrap();
        let time = node.time(0).unwrap();
        assert_eq!(time, Time::from_s(1.0));
        let targets = node.targets(0, time);
        assert_eq!((targets.list.len(), targets.list[0].id), (1, TargetId(0)));
        assert!((targets.list[0].velocity - Vector3::new(2.0, 0.0, 0.0)).norm() < 1e-9);
        assert!((targets.list[0].position_sigma() - 0.002).abs() < 1e-9);
        let marks = node.marks(0, time);
        let list: Vec<_> = marks.list.iter().map(|it| (it.label, it.provenance, it.position)).collect();
        let (nose, four) = (Point3::new(5.0, 5.0, 5.0), Point3::new(0.0, 1.0, 1.0));
        assert_eq!(list, [(0, Provenance::Measured, nose), (4, Provenance::Filled, four)]);
        assert_eq!(node.targets(2, time).list[0].provenance, Provenance::Predicted);
        assert!(node.marks(1, time).list.is_empty());
        assert!(node.remarks.iter().any(|it| it.contains("target-0 = waist, mark-0 = F nose")), "{:?}", node.remarks);
    }

    #[test]
    fn frames_are_due_at_their_times_and_those_before_the_start_are_left_out() {
        let mut node = node_of(TABLE.as_bytes(), "start_s = -0.15\nlatency_ms = 5.0").unwrap();
        assert_eq!((node.next, node.due()), (2, Due::At(Time::from_s(0.055))));
        node.next = 4;
        assert_eq!(node.due(), Due::Never);
        let refused = |text: &[u8], settings: &str| node_of(text, settings).map(drop).unwrap_err();
        assert_eq!(refused(TABLE.as_bytes(), "start_s = -5.0").setting.as_deref(), Some("start_s"));
        assert!(refused(b"\x02P not C3D", "").message.contains("at byte 0"));
        let fault = refused(TABLE.as_bytes(), "marks = [\"F*\", \"zzz*\"]");
        assert_eq!(fault.setting.as_deref(), Some("marks"));
        assert!(
            fault.message.contains("no point `zzz*`") && fault.message.contains("`waist`, `mark-4`, `F nose`"),
            "{}",
            fault.message
        );
        assert!(refused(b"time_s,target,x_m,y_m,z_m\n", "").message.contains("no samples"));
        assert!(refused(b"time_s;target;x_m;y_m;z_m\n", "").message.contains("semicolons"));
        assert!(refused(b"<html>", "").message.contains("C3D, TRC, BVH"));
        assert_eq!(refused(TABLE.as_bytes(), "smooth_hz = 2.0").setting.as_deref(), Some("smooth_hz"));
    }

    #[test]
    fn gaps_are_filled_and_y_up_is_turned() {
        let rows: String = (0..20)
            .filter(|it| *it != 9)
            .map(|it| format!("{it}\t{:.2}\t{}\t1000\t{}\n", f64::from(it) / 100.0, it * 10, it))
            .collect();
        let text = format!(
            "PathFileType\t4\t(X/Y/Z)\ta\nDataRate\tNumMarkers\tUnits\n100\t1\tmm\nFrame#\tTime\twaist\t\t\n\t\tX1\tY1\tZ1\n{}",
            rows.replace("\n10\t", "\n9\t0.09\n10\t")
        );
        let node = node_of(text.as_bytes(), "fill_ms = 25.0").unwrap();
        let filled = node.targets(9, Time::ZERO).list.remove(0);
        assert_eq!(filled.provenance, Provenance::Filled);
        assert!((filled.position - Point3::new(0.09, -0.009, 1.0)).norm() < 1e-9, "{}", filled.position);
        assert!((filled.velocity - Vector3::new(1.0, -0.1, 0.0)).norm() < 1e-9);
        assert!(node_of(text.as_bytes(), "").unwrap().targets(9, Time::ZERO).list.is_empty());
        let as_z = node_of(text.as_bytes(), "up = \"z\"").unwrap().targets(1, Time::ZERO).list.remove(0);
        assert!((as_z.position - Point3::new(0.01, 1.0, 0.001)).norm() < 1e-9);
    }

    #[test]
    fn patterns_with_stars_are_matched() {
        assert!(
            is_of("F*", "Fnose")
                && is_of("*", "")
                && is_of("a*c*e", "abcde")
                && !is_of("a*c", "abcd")
                && !is_of("a", "ab")
        );
    }
}
