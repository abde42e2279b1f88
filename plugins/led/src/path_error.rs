//! `led.path_error`: recovered targets compared with a path that was measured by other means, read from a file.

use std::path::Path;
use std::sync::Arc;

use foveate::prelude::*;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    TARGETS: In<Targets> = each("targets");
}

figures! {
    "*.{median,p90,max}": m, low, "Distance of a row of the measured path from the nearest target of its time, over rows that have one; `figure` before it" => "target off the measured path";
    "*.coverage": share, high, "Rows with a target within covered_m, of all rows" => "part of the measured path that is covered";
        "*.with_target": share, high, "Rows with any target, of all rows";
        "*.targets_mean": count, neither, "Targets at a row, mean over all rows: among many targets, the nearest is close by chance";
    "*.rows": count, neither, "Rows of the path between from_s and until_s";
}

/// Longer files are no paths [rows].
const MAX_ROWS: usize = 10_000_000;

/// Settings of [`PathError`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PathErrorSettings {
    /// Text file with a row `x y z` for each time, in metres, separated by blanks or commas; rows that begin with `#` and a first row
    /// of words are ignored [–]
    pub path: String,
    /// Rows a second [Hz]
    #[serde(default = "default_rate_hz")]
    #[schemars(range(min = 0.001, max = 100000.0))]
    pub rate_hz: f64,
    /// Session time of the first row [s]
    #[serde(default)]
    #[schemars(range(min = -1e6, max = 1e6))]
    pub start_s: f64,
    /// Rows before this time of the session are left out, such as those that a calibration has seen [s]
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub from_s: f64,
    /// Rows after this time of the session are left out [s]
    #[serde(default = "default_until_s")]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub until_s: f64,
    /// Largest time between a row and the targets that it is compared with, extrapolated by their velocity [ms]
    #[serde(default = "default_within_ms")]
    #[schemars(range(min = 0.001, max = 10000.0))]
    pub within_ms: f64,
    /// A row is covered when a target is at most this far from it [m]
    #[serde(default = "default_covered_m")]
    #[schemars(range(min = 0.000001, max = 1e6))]
    pub covered_m: f64,
    /// Prefix of the figures' names [–]
    #[serde(default = "default_figure")]
    pub figure: String,
}

fn default_rate_hz() -> f64 {
    5.0
}

fn default_until_s() -> f64 {
    1e6
}

fn default_within_ms() -> f64 {
    100.0
}

fn default_covered_m() -> f64 {
    2.0
}

fn default_figure() -> String {
    "path_error_m".to_owned()
}

/// For each row of the file, the distance to the nearest target of its time: `<figure>.median`, `.p90`, `.max`.
///
/// Rows without any target have no error and are not included; `<figure>.coverage` is the part of all rows with a target
/// within `covered_m`, `<figure>.with_target`, the part with any target at all, and `<figure>.targets_mean`, how many targets there
/// were at a row: among many, the nearest is close by chance.
pub struct PathError {
    rows: Vec<Point3<f64>>,
    /// Of the first row.
    start: Interval,
    rate_hz: f64,
    /// The next row to compare, and the one after the last.
    next: usize,
    end: usize,
    within: Interval,
    covered_m: f64,
    figure: String,
    before: Option<Arc<Targets>>,
    errors: Vec<f64>,
    n_targets: u64,
    n_rows: u64,
}

impl Node for PathError {
    const TYPE: &'static str = "led.path_error";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Compares recovered targets with a measured path from a file, in metres";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = PathErrorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: PathErrorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let check = ConfigError::unless_in::<f64>;
        check("rate_hz", settings.rate_hz, 0.001..=1e5)?;
        check("start_s", settings.start_s, -1e6..=1e6)?;
        check("from_s", settings.from_s, 0.0..=1e6)?;
        check("until_s", settings.until_s, 0.0..=1e6)?;
        check("within_ms", settings.within_ms, 0.001..=1e4)?;
        check("covered_m", settings.covered_m, 1e-6..=1e6)?;
        let path = setup.path("path", &settings.path)?;
        let rows = read(&path).map_err(|fault| ConfigError::at("path", fault))?;
        let row_at = |session_s: f64| ((session_s - settings.start_s) * settings.rate_hz).max(0.0);
        let next = row_at(settings.from_s).ceil() as usize;
        let end = (row_at(settings.until_s).floor() as usize).saturating_add(1).min(rows.len());
        if next >= end {
            let message =
                format!("no row of `{}` lies between from_s and until_s; see start_s and rate_hz", path.display());
            return Err(ConfigError::at("path", message));
        }
        Ok(Self {
            rows,
            start: Interval::from_s(settings.start_s),
            rate_hz: settings.rate_hz,
            next,
            end,
            within: Interval::from_ms(settings.within_ms),
            covered_m: settings.covered_m,
            figure: settings.figure,
            before: None,
            errors: Vec::new(),
            n_targets: 0,
            n_rows: (end - next) as u64,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(targets) = io.take(&TARGETS) else { return Ok(()) };
        // Of several messages of one time the last counts, so a row waits until a later time is there.
        self.compare_until(Some(&targets.value));
        self.before = Some(Arc::clone(&targets.value));
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.compare_until(None);
        self.errors.sort_by(f64::total_cmp);
        let quantile = |share: f64| {
            let last = self.errors.len().checked_sub(1);
            last.map_or(f64::NAN, |last| self.errors[(share * last as f64).round() as usize])
        };
        let covered = self.errors.partition_point(|it| *it <= self.covered_m);
        let per_row = |count: f64| count / self.n_rows as f64;
        let figures = [
            ("median", quantile(0.5)),
            ("p90", quantile(0.9)),
            ("max", quantile(1.0)),
            ("coverage", per_row(covered as f64)),
            ("with_target", per_row(self.errors.len() as f64)),
            ("targets_mean", per_row(self.n_targets as f64)),
            ("rows", self.n_rows as f64),
        ];
        for (name, value) in figures {
            report.figure(format!("{}.{name}", self.figure), value);
        }
        Ok(())
    }
}

impl PathError {
    fn time_of(&self, row: usize) -> Time {
        Time::ZERO + self.start + Interval::from_s(row as f64 / self.rate_hz)
    }

    /// Compares all rows before `after`, each with the nearer in time of the messages around it.
    fn compare_until(&mut self, after: Option<&Targets>) {
        while self.next < self.end {
            let time = self.time_of(self.next);
            if after.is_some_and(|it| it.time <= time) {
                return;
            }
            let around = [self.before.as_deref(), after].into_iter().flatten();
            let nearest =
                around.min_by_key(|it| (it.time - time).abs()).filter(|it| (it.time - time).abs() <= self.within);
            if let Some(targets) = nearest {
                let step_s = (time - targets.time).as_s();
                let distance = |it: &Target| (it.position + it.velocity * step_s - self.rows[self.next]).norm();
                self.n_targets += targets.list.len() as u64;
                self.errors.extend(targets.list.iter().map(distance).min_by(f64::total_cmp));
            }
            self.next += 1;
        }
    }
}

/// The rows of a path.
fn read(path: &Path) -> Result<Vec<Point3<f64>>, String> {
    let text = foveate::diagnostics::file::read_text(path)
        .map_err(|error| format!("`{}` cannot be read: {error}", path.display()))?;
    let mut rows = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let fields: Vec<&str> =
            line.split(|it: char| it == ',' || it.is_whitespace()).filter(|it| !it.is_empty()).collect();
        if fields.first().is_none_or(|it| it.starts_with('#')) {
            continue;
        }
        let numbers: Option<Vec<f64>> =
            fields.iter().map(|it| it.parse().ok().filter(|it: &f64| it.is_finite())).collect();
        match numbers.as_deref() {
            Some(&[x, y, z]) => rows.push(Point3::new(x, y, z)),
            None if rows.is_empty() && fields[0].parse::<f64>().is_err() => {}
            _ => {
                let shown: String = line.chars().take(60).collect();
                return Err(format!(
                    "`{}`, line {}: found `{shown}`, expected `x y z` [m]",
                    path.display(),
                    number + 1
                ));
            }
        }
        if rows.len() > MAX_ROWS {
            return Err(format!("`{}` has more than {MAX_ROWS} rows, expected a path", path.display()));
        }
    }
    if rows.is_empty() {
        return Err(format!("`{}` holds no row `x y z`", path.display()));
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;
    use nalgebra::{Matrix6, Vector3};

    use super::*;

    /// Ten rows a second along x at 1 m/s, the first at 0.5 s.
    fn node(settings: &str) -> Result<PathError, ConfigError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("path.txt");
        let rows: String = (0..20).map(|it| format!("{} 0 1\n", f64::from(it) * 0.1)).collect();
        std::fs::write(&path, format!("# by hand\nx y z\n{rows}")).unwrap();
        let text = format!("path = {:?}\nrate_hz = 10.0\nstart_s = 0.5\n{settings}", path.display().to_string());
        PathError::new(toml::from_str(&text).unwrap(), &Setup::for_tests())
    }

    fn target(x: f64) -> Target {
        Target {
            id: TargetId(0),
            position: Point3::new(x, 0.0, 1.0),
            velocity: Vector3::x(),
            covariance: Matrix6::identity(),
            cameras: CameraSet::default(),
            provenance: Provenance::Measured,
        }
    }

    fn figures(mut node: PathError, messages: &[(f64, &[f64])]) -> Report {
        for (time_s, xs) in messages {
            let targets = Targets { time: Time::from_s(*time_s), list: xs.iter().map(|x| target(*x)).collect() };
            node.compare_until(Some(&targets));
            node.before = Some(Arc::new(targets));
        }
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        report
    }

    #[test]
    fn error_is_that_of_the_nearest_target_moved_to_the_time_of_the_row() {
        // Rows at 0.5 s and 0.6 s; the message lies between them, 0.3 m ahead of the path, and a second target is far off.
        let report = figures(node("until_s = 0.65").unwrap(), &[(0.54, &[0.34, 9.0]), (0.57, &[0.37, 9.0])]);
        let figure = |name: &str| report.figures[&format!("path_error_m.{name}")];
        assert!((figure("median") - 0.3).abs() < 1e-9 && (figure("max") - 0.3).abs() < 1e-9, "{report:?}");
        assert_eq!((figure("coverage"), figure("rows"), figure("targets_mean")), (1.0, 2.0, 2.0));
    }

    #[test]
    fn rows_without_a_target_lower_the_coverage() {
        let report =
            figures(node("figure = \"e\"\ncovered_m = 0.2").unwrap(), &[(0.5, &[0.0]), (0.9, &[0.9]), (5.0, &[])]);
        // Five of twenty rows have a message within 100 ms of them, and of these two lie within 0.2 m.
        assert!((report.figures["e.with_target"] - 0.25).abs() < 1e-9, "{report:?}");
        assert!((report.figures["e.coverage"] - 0.1).abs() < 1e-9, "{report:?}");
        let none = figures(node("from_s = 1.0").unwrap(), &[]);
        assert!(none.figures["path_error_m.median"].is_nan() && none.figures["path_error_m.coverage"] == 0.0);
        assert_eq!(none.figures["path_error_m.rows"], 15.0);
    }

    #[test]
    fn files_that_hold_no_path_are_refused_with_the_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("path.csv");
        let refused = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read(&path).unwrap_err()
        };
        assert!(refused("").contains("no row"));
        assert!(refused("1,2,3\n4,5\n").contains("line 2: found `4,5`"));
        assert!(refused("1,2,nan\n").contains("line 1"));
        assert!(node("from_s = 50.0").is_err_and(|it| it.message.contains("no row of")));
    }

    #[test]
    fn node_keeps_its_promises() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("path.txt");
        std::fs::write(&path, "0 0 0\n1 0 0\n").unwrap();
        check_node::<PathError>(&format!("path = {:?}", path.display().to_string()));
    }
}
