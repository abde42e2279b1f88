//! Our own tables: `targets.csv` and `marks.csv`, as `export.targets` and `export.marks` write them.
//!
//! A row for each point and time, columns in any order, found by name. `time_s` and `target` or `mark` are needed, and
//! `x_m`, `y_m`, `z_m` or the same in the world
//! (`world_x_m`, …), which take precedence. `name` (a point's name, quoted where needed) is optional: it is written where names are not `target-N`.

use std::collections::BTreeMap;
use std::fmt::Write;

use foveate_diagnostics::fields::{Fields, Splitter, field};
use foveate_messages::{CameraId, Provenance};
use nalgebra::Point3;

use super::{Keeps, MotionError, Written, lost};
use crate::csv::{fixed, scientific};
use crate::last_row::Shapes;
use crate::motion::{Motion, Sample, Up, rate_of};

/// The columns of a covariance's upper triangle.
const COVARIANCE: [&str; 6] = ["cxx_m2", "cxy_m2", "cxz_m2", "cyy_m2", "cyz_m2", "czz_m2"];
const AXES: [&str; 3] = ["x_m", "y_m", "z_m"];
/// The column `provenance` of tables written before version 0.2.
const OLD_PROVENANCE: &str = "how";
const PROVENANCES: [&str; 3] = ["measured", "predicted", "filled"];
/// Times of the session are below this [s].
const MOST_TIME_S: f64 = 9e9;
/// Frames of times that are all different hold one point each: so many places of absent points a table may have beside its rows, and else 16 a row.
const MOST_ABSENT: usize = 1 << 20;

/// Whether a text begins with the header of such a table.
pub(super) fn is_table(text: &[u8]) -> bool {
    let line = text.split(|it| matches!(it, b'\n' | b'\r')).find(|it| !it.is_empty() && it[0] != b'#').unwrap_or(&[]);
    let Ok(line) = std::str::from_utf8(&line[..line.len().min(4096)]) else { return false };
    let mut splitter = Splitter::new(',');
    let names = splitter.split(line);
    let has = |name: &str| names.iter().any(|it| it == name);
    has("time_s") && (has("target") || has("mark"))
}

/// What keeps a text from being such a table though its header shows most of the columns: what separates them, or which are missing.
pub(super) fn nearly(text: &[u8]) -> Option<String> {
    let mut lines = text.split(|it| matches!(it, b'\n' | b'\r')).zip(1_usize..);
    let (line, number) = lines.find(|it| !it.0.trim_ascii().is_empty() && it.0[0] != b'#')?;
    let line = std::str::from_utf8(line.get(..4096).unwrap_or(line)).ok()?;
    let columns = |separator: char| -> Vec<String> {
        let mut splitter = Splitter::new(separator);
        let names = splitter.split(line).iter().map(str::to_owned);
        if separator == ' ' { names.filter(|it| !it.is_empty()).collect() } else { names.collect() }
    };
    let known = |name: &str| {
        let name = name.to_ascii_lowercase();
        let name = name.strip_prefix("world_").unwrap_or(&name);
        ["time_s", "target", "mark", "provenance", OLD_PROVENANCE, "cameras"].contains(&name)
            || AXES.contains(&name)
            || COVARIANCE.contains(&name)
    };
    let n_known = |it: &Vec<String>| it.iter().filter(|it| known(it)).count();
    // The first of those with most columns that are known.
    let mut best = (columns(','), "");
    for (separator, called) in [(';', "semicolons"), ('\t', "tabs"), ('|', "`|`"), (' ', "blanks")] {
        let other = columns(separator);
        if n_known(&other) > n_known(&best.0) {
            best = (other, called);
        }
    }
    let (names, separator) = best;
    if n_known(&names) < LEAST_KNOWN {
        return None;
    }
    if !separator.is_empty() {
        return Some(format!("line {number}: found columns with {separator} between them, expected commas"));
    }
    let has = |name: &str| names.iter().any(|it| it == name);
    let mut missing: Vec<&str> = Vec::new();
    if !has("time_s") {
        missing.push("`time_s`");
    }
    if !has("target") && !has("mark") {
        missing.push("`target` or `mark`");
    }
    let strange = names.iter().filter(|it| !known(it) && *it != "name");
    let mut strange: Vec<String> = strange.map(|it| format!("`{it}`")).collect();
    if strange.len() > STRANGE_SHOWN {
        let more = strange.split_off(STRANGE_SHOWN).len();
        strange.push(format!("{more} more"));
    }
    let in_place = if strange.is_empty() { String::new() } else { format!(", and {} instead", strange.join(", ")) };
    let columns = if missing.len() == 1 { "column" } else { "columns" };
    Some(format!(
        "line {number}: found no {columns} {}{in_place}; expected `time_s`, `target` or `mark`, `x_m`, `y_m`, `z_m`",
        missing.join(" and no ")
    ))
}

/// Columns of other names that are shown.
const STRANGE_SHOWN: usize = 5;
/// Columns that other tables have by chance are fewer.
const LEAST_KNOWN: usize = 3;

/// Where each column stands.
struct Columns {
    time: usize,
    point: usize,
    /// `target` or `mark`.
    kind: &'static str,
    name: Option<usize>,
    axes: [usize; 3],
    covariance: Option<[usize; 6]>,
    cameras: Option<usize>,
    provenance: Option<usize>,
}

impl Columns {
    fn of(names: &Fields) -> Result<Self, String> {
        let place = |wanted: &str| names.iter().position(|it| it == wanted);
        let needed = |wanted: &str| place(wanted).ok_or_else(|| format!("no column `{wanted}`"));
        let kind = if place("target").is_some() { "target" } else { "mark" };
        let in_world = place("world_x_m").is_some();
        let prefix = if in_world { "world_" } else { "" };
        let axes = AXES.map(|it| needed(&format!("{prefix}{it}")));
        let covariance = COVARIANCE.map(|it| place(&format!("{prefix}{it}")));
        let [x, y, z] = axes;
        let all: Option<Vec<usize>> = covariance.into_iter().collect();
        Ok(Self {
            time: needed("time_s")?,
            point: needed(kind)?,
            kind,
            name: place("name"),
            axes: [x?, y?, z?],
            covariance: all.and_then(|it| it.try_into().ok()),
            cameras: place("cameras"),
            provenance: place("provenance").or_else(|| place(OLD_PROVENANCE)),
        })
    }
}

/// What the rows add up to.
#[derive(Default)]
struct Table {
    /// By number.
    names: BTreeMap<u64, String>,
    cameras: Vec<String>,
    /// Time in nanoseconds, number, and sample, in the order of the file.
    rows: Vec<(i64, u64, Sample)>,
    n_without_place: usize,
}

impl Table {
    fn add(&mut self, columns: &Columns, fields: &Fields) -> Result<(), String> {
        let text = |place: usize| fields.text(place);
        let number = |place: usize, what: &str| match text(place).parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(format!(
                "found `{}` for {what}, expected a number",
                text(place).chars().take(40).collect::<String>()
            )),
        };
        let time_s = number(columns.time, "`time_s`")?;
        if time_s.abs() > MOST_TIME_S {
            return Err(format!("found the time {time_s}, expected at most {MOST_TIME_S:e} s"));
        }
        let Ok(point) = text(columns.point).parse::<u64>() else {
            let found: String = text(columns.point).chars().take(40).collect();
            return Err(format!("found `{found}` for `{}`, expected its number", columns.kind));
        };
        // In a space whose place in the world is not known.
        if columns.axes.iter().all(|it| text(*it).is_empty()) {
            self.n_without_place += 1;
            return Ok(());
        }
        let mut place = [0.0; 3];
        for (axis, to) in place.iter_mut().enumerate() {
            *to = number(columns.axes[axis], AXES[axis])?;
        }
        let mut sample = Sample::at(Point3::from(place));
        if let Some(places) = columns.covariance.filter(|it| it.iter().any(|it| !text(*it).is_empty())) {
            for (to, place) in sample.covariance.iter_mut().zip(places) {
                *to = number(place, "a covariance")? as f32;
            }
        }
        sample.provenance = match columns.provenance.map_or("measured", text) {
            "measured" | "" => Provenance::Measured,
            "predicted" => Provenance::Predicted,
            "filled" => Provenance::Filled,
            other => return Err(format!("found `{other}` for `provenance`, expected measured, predicted or filled")),
        };
        if let Some(cameras) = columns.cameras {
            sample.cameras = text(cameras).split('+').filter(|it| !it.is_empty()).map(|it| self.camera(it)).collect();
        }
        let name = || match columns.name.map_or("", text) {
            "" => format!("{}-{point}", columns.kind),
            name => name.to_owned(),
        };
        self.names.entry(point).or_insert_with(name);
        self.rows.push(((time_s * 1e9).round() as i64, point, sample));
        Ok(())
    }

    fn camera(&mut self, name: &str) -> CameraId {
        let place = self.cameras.iter().position(|it| it == name).unwrap_or_else(|| {
            self.cameras.push(name.to_owned());
            self.cameras.len() - 1
        });
        CameraId(place.min(usize::from(u16::MAX)) as u16)
    }
}

/// What rows tell of whether the last one is whole.
#[derive(Default)]
struct Before {
    /// Of the last field.
    shapes: Shapes,
    /// Rows may have fewer fields than the header.
    is_short: bool,
}

impl Before {
    fn add(&mut self, row: &Fields, n_columns: usize) {
        self.is_short |= row.len() < n_columns;
        self.shapes.add(row.text(row.len() - 1));
    }

    /// By the digits of a number, a word that is known, or the name that the point had before.
    fn tell_whole(&self, row: &Fields, columns: &Columns, names: &BTreeMap<u64, String>) -> bool {
        let place = row.len() - 1;
        let last = row.text(place);
        let named = || names.get(&row.text(columns.point).parse().ok()?);
        match Some(place) {
            it if it == columns.provenance => PROVENANCES.contains(&last),
            it if it == columns.name => named().is_some_and(|it| it == last),
            _ => self.shapes.tell_whole(last),
        }
    }
}

/// Reads a whole table. A last row that may be cut is left out: one without a line end whose last field is not as those before it tell, or one of fewer fields than the others.
pub(super) fn read(text: &str) -> Result<(Motion, Vec<String>), MotionError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let ends = if text.contains('\n') { '\n' } else { '\r' };
    let has_end = text.ends_with(['\n', '\r']);
    let lines = text.split_terminator(ends).enumerate().map(|(line, text)| (line + 1, text.trim()));
    let mut lines = lines.filter(|it| !it.1.is_empty() && !it.1.starts_with('#'));
    let at = |line: usize, what: String| MotionError(format!("line {line}: {what}"));
    let Some((line, header)) = lines.next() else { return Err(at(1, "found the end, expected a header".to_owned())) };
    let expected = "expected `time_s`, `target` or `mark`, `x_m`, `y_m`, `z_m`";
    let mut splitter = Splitter::new(',');
    let names = splitter.split(header);
    let columns = Columns::of(names).map_err(|it| at(line, format!("found {it}, {expected}")))?;
    let n_columns = names.len();
    let mut table = Table::default();
    let mut remarks = Vec::new();
    let mut before = Before::default();
    let mut lines = lines.peekable();
    while let Some((line, text)) = lines.next() {
        let row = splitter.split(text);
        if lines.peek().is_none() {
            let is_short = row.len() < n_columns && !before.is_short;
            if is_short || !(has_end || before.tell_whole(row, &columns, &table.names)) {
                let found = if is_short { "fewer fields than the others have" } else { "no end of line" };
                remarks.push(format!("line {line}: found {found}; the row may be cut, and is left out"));
                break;
            }
        }
        table.add(&columns, row).map_err(|it| at(line, it))?;
        before.add(row, n_columns);
    }
    if table.n_without_place > 0 {
        remarks.push(format!("{} rows have no position in the world, and are skipped", table.n_without_place));
    }
    let places: BTreeMap<u64, usize> = table.names.keys().copied().zip(0..).collect();
    let mut times: Vec<i64> = table.rows.iter().map(|it| it.0).collect();
    times.sort_unstable();
    times.dedup();
    let n_points = places.len();
    let n_samples = times.len().saturating_mul(n_points);
    if n_samples > MOST_ABSENT.max(table.rows.len().saturating_mul(16)) {
        return Err(MotionError(format!(
            "found {n_points} points at {} times in {} rows, expected points that are seen together",
            times.len(),
            table.rows.len()
        )));
    }
    let mut samples = vec![None; n_samples];
    let mut n_replaced = 0;
    for (time, point, sample) in table.rows {
        let frame = times.binary_search(&time).unwrap_or(0);
        let to: &mut Option<Sample> = &mut samples[frame * n_points + places[&point]];
        n_replaced += usize::from(to.replace(sample).is_some());
    }
    if n_replaced > 0 {
        remarks.push(format!("{n_replaced} rows are of a point and time that had one before; the last one counts"));
    }
    let times_s: Vec<f64> = times.into_iter().map(|it| it as f64 * 1e-9).collect();
    let motion = Motion {
        labels: table.names.into_values().collect(),
        rate_hz: rate_of(&times_s),
        times_s,
        samples,
        up: Up::Z,
        cameras: table.cameras,
        ..Motion::default()
    };
    Ok((motion, remarks))
}

/// The numbers of points that are all called `KIND-N`, each another.
fn numbers(labels: &[String], kind: &str) -> Option<Vec<u64>> {
    let number =
        |it: &String| it.strip_prefix(kind)?.strip_prefix('-')?.parse().ok().filter(|n| *it == format!("{kind}-{n}"));
    let numbers: Vec<u64> = labels.iter().map(number).collect::<Option<_>>()?;
    Some(numbers).filter(|it| !it.is_empty())
}

pub(super) fn write(motion: &Motion) -> Result<Written, MotionError> {
    let mut turned = motion.clone();
    let notes = turned.turn(Up::Z).then(|| "turned: z is up in our tables".to_owned()).into_iter().collect();
    let marks = numbers(&motion.labels, "mark");
    let targets = numbers(&motion.labels, "target");
    let kind = if marks.is_some() { "mark" } else { "target" };
    let has_names = marks.is_none() && targets.is_none();
    let numbers = marks.or(targets).unwrap_or_else(|| (0..motion.labels.len() as u64).collect());
    let mut text = format!("time_s,{kind},x_m,y_m,z_m,{},cameras,provenance", COVARIANCE.join(","));
    if kind == "mark" {
        // The marks' own space is the world here.
        write!(text, ",world_x_m,world_y_m,world_z_m,{}", COVARIANCE.map(|it| format!("world_{it}")).join(",")).ok();
    }
    text.push_str(if has_names { ",name\n" } else { "\n" });
    let name =
        |camera: CameraId| turned.cameras.get(usize::from(camera.0)).map_or("", String::as_str).replace('+', "_");
    let mut point = String::new();
    for (frame, time_s) in turned.times_s.iter().enumerate() {
        for (place, number) in numbers.iter().enumerate() {
            let Some(sample) = turned.get(frame, place) else { continue };
            point.clear();
            for coordinate in sample.position.iter() {
                point.push(',');
                fixed(&mut point, *coordinate, 6);
            }
            for value in sample.covariance {
                point.push(',');
                if value.is_finite() {
                    scientific(&mut point, f64::from(value));
                }
            }
            fixed(&mut text, *time_s, 6);
            let cameras: Vec<String> = sample.cameras.iter().map(name).collect();
            write!(text, ",{number}{point},{},{}", field(&cameras.join("+")), sample.provenance.name()).ok();
            if kind == "mark" {
                text.push_str(&point);
            }
            if has_names {
                write!(text, ",{}", field(&turned.labels[place])).ok();
            }
            text.push('\n');
        }
    }
    let keeps =
        Keeps { uncertainty: true, provenance: true, predicted: true, cameras: true, events: false, start: true };
    let mut lost = lost(motion, keeps);
    let n_never = (0..motion.labels.len()).filter(|it| motion.column(*it).all(|it| it.is_none())).count();
    if n_never > 0 {
        lost.push(format!("the names of {n_never} points that are never there"));
    }
    Ok(Written { bytes: text.into_bytes(), lost, notes })
}
