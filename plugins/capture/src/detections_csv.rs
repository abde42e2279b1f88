//! The table of 2D detections: a header, then one line a point.
//!
//! | column | meaning | unit |
//! |---|---|---|
//! | `time_s` | capture time | s |
//! | `camera` | name in the calibration | – |
//! | `x_px`, `y_px` | the point in raw pixels; both empty: a picture in which nothing was found | px |
//! | `sigma_px` | standard deviation of either coordinate; may be left out | px |
//! | `cxx_px2`, `cxy_px2`, `cyy_px2` | the whole covariance, instead of `sigma_px`; may be left out | px² |
//! | `area_px` | pixels that belong to the point; may be left out | px² |
//! | `peak` | its brightest pixel, 0 to 255; may be left out | gray level |
//! | `label` | which mark it is, a whole number or a name; empty or left out: not known | – |
//!
//! Columns in any order, others are ignored; lines that begin with `#` are comments; a field that holds commas stands in quotes.
//!
//! A file without such a header can be read where the rig names its columns: then blanks or commas separate the fields, lines
//! before the first that begins with a number are skipped, `frame` (the number of the picture) may replace `time_s`, and
//! without a column `camera` all rows are of the instance's camera.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use foveate::diagnostics::fields::{Fields, Splitter};
use foveate::prelude::*;
use nalgebra::{Matrix2, Point2};

use crate::settings::Reasons;
use crate::{labels, points_dat};

/// Longer lines are no lines of a table [bytes].
const LINE_LIMIT: u64 = 4096;
/// Value of `columns` for a file of MultiCamSelfCal.
pub(crate) const POINTS_DAT: &str = "points.dat";
/// Later times are mistakes, such as milliseconds since 1970; seconds since 1970 lie below it [s].
const TIME_LIMIT_S: f64 = 9e9;

/// A point with a larger variance is refused [px²].
const VARIANCE_LIMIT: f64 = 1e8;
const COVARIANCE: [&str; 3] = ["cxx_px2", "cxy_px2", "cyy_px2"];

/// Which rows to keep, and how to read them.
#[derive(Debug, Clone)]
pub(crate) struct Wanted<'a> {
    pub(crate) camera: CameraId,
    pub(crate) name: &'a str,
    /// Columns, rows of its pictures [px]; points more than a pixel outside are refused.
    pub(crate) size: Option<[u32; 2]>,
    /// Coordinate of the centre of the top-left pixel in the file [px].
    pub(crate) origin: f64,
    /// Standard deviation where the file gives none [px].
    pub(crate) sigma: f64,
    /// Names of the columns, where the file has no header.
    pub(crate) columns: Option<&'a str>,
    /// Frame rate, for a column `frame` [Hz].
    pub(crate) frame_rate: Option<f64>,
    /// Whether a point at (0, 0) means that nothing was found.
    pub(crate) nothing_at_zero: bool,
    /// What messages call a row.
    pub(crate) row: &'static str,
    /// Names of points; a point's number is the index of its name.
    pub(crate) names: &'a [String],
    /// Points with a lower likelihood are left out [–].
    pub(crate) least_likelihood: f64,
}

/// The rows of one picture.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Frame {
    pub(crate) time: Time,
    pub(crate) features: Features,
    /// Rows of this picture that could not be read, as `line 7: …`.
    pub(crate) faults: Vec<String>,
}

/// What a file holds of one camera.
#[derive(Debug, Default)]
pub(crate) struct Table {
    /// Ascending by time, one per time.
    pub(crate) frames: Vec<Frame>,
    /// Unreadable rows, those of [`Frame::faults`] included.
    pub(crate) faults: Reasons,
    /// Rows of this camera that came after a later one.
    pub(crate) out_of_order: u64,
    /// Columns that were ignored.
    pub(crate) unknown_columns: Vec<String>,
    /// Some of the other cameras that have rows, at most 64.
    pub(crate) other_cameras: BTreeSet<String>,
}

/// Indices of the columns.
#[derive(Debug, Clone, Copy)]
struct Columns {
    time: usize,
    /// Units of `time` per second: 1, or the frame rate.
    per_second: f64,
    /// `None`: all rows are of the camera.
    camera: Option<usize>,
    x: usize,
    y: usize,
    sigma: Option<usize>,
    /// cxx, cxy, cyy.
    covariance: Option<[usize; 3]>,
    area: Option<usize>,
    peak: Option<usize>,
    label: Option<usize>,
}

impl Columns {
    /// Columns of a file with a header.
    fn of(header: &str) -> Result<(Self, Vec<String>), String> {
        let mut splitter = Splitter::new(',');
        let names: Vec<&str> = splitter.split(header).iter().collect();
        Self::named(&names, header, None)
    }

    /// Columns that the rig names.
    fn stated(columns: &str, frame_rate: Option<f64>) -> Result<(Self, Vec<String>), String> {
        let names: Vec<&str> = fields_of(columns).collect();
        if names.contains(&"frame") {
            let Some(rate) = frame_rate else {
                return Err("found `frame` instead of a time, expected frame_rate_hz in the `clock` of this camera in the calibration".to_owned());
            };
            let names: Vec<&str> = names.iter().map(|&it| if it == "frame" { "time_s" } else { it }).collect();
            return Self::named(&names, columns, Some(rate));
        }
        Self::named(&names, columns, Some(1.0))
    }

    /// `per_second` is `None` for a file with a header, which then needs a camera.
    fn named(names: &[&str], header: &str, per_second: Option<f64>) -> Result<(Self, Vec<String>), String> {
        let place = |name: &str| names.iter().position(|it| *it == name);
        let required = |name: &str| {
            place(name).ok_or_else(|| {
                let found = header.chars().take(80).collect::<String>();
                format!("the header lacks `{name}`: found `{found}`, expected `time_s,camera,x_px,y_px` and perhaps `sigma_px,area_px,peak`")
            })
        };
        let columns = Self {
            time: required("time_s")?,
            per_second: per_second.unwrap_or(1.0),
            camera: if per_second.is_some() { place("camera") } else { Some(required("camera")?) },
            x: required("x_px")?,
            y: required("y_px")?,
            sigma: place("sigma_px"),
            covariance: match COVARIANCE.map(place) {
                [Some(xx), Some(xy), Some(yy)] => Some([xx, xy, yy]),
                [None, None, None] => None,
                _ => {
                    return Err(format!(
                        "the header names only some of {}",
                        COVARIANCE.map(|it| format!("`{it}`")).join(", ")
                    ));
                }
            },
            area: place("area_px"),
            peak: place("peak"),
            label: place("label"),
        };
        let known =
            ["time_s", "camera", "x_px", "y_px", "sigma_px", "area_px", "peak", "label"].into_iter().chain(COVARIANCE);
        let known: Vec<&str> = known.collect();
        if let Some(twice) = known.iter().find(|name| names.iter().filter(|it| it == name).count() > 1) {
            return Err(format!("the header names `{twice}` twice"));
        }
        let unknown = names.iter().filter(|it| !known.contains(it)).map(|it| (*it).to_owned()).collect();
        Ok((columns, unknown))
    }
}

impl Table {
    /// Reads `path`, keeping the rows of one camera.
    ///
    /// # Errors
    /// A sentence when the file cannot be used: no such file, no header, no readable row. A file that has rows of other
    /// cameras only is a table without frames.
    pub(crate) fn read(path: &Path, wanted: &Wanted<'_>) -> Result<Self, String> {
        if wanted.columns == Some(POINTS_DAT) {
            let rows = points_dat::rows_of(path, wanted.camera.0.into())?;
            let wanted =
                Wanted { columns: Some("frame x_px y_px"), nothing_at_zero: true, row: "column", ..wanted.clone() };
            return Self::parse(rows.as_bytes(), &wanted).map_err(|fault| format!("`{}`: {fault}", path.display()));
        }
        if wanted.columns.is_none()
            && !wanted.names.is_empty()
            && let Some(rows) = labels::rows_of(path, wanted.names, wanted.least_likelihood)?
        {
            let columns = Some("frame x_px y_px label");
            let wanted = Wanted { columns, nothing_at_zero: true, row: "point", ..wanted.clone() };
            return Self::parse(rows.as_bytes(), &wanted).map_err(|fault| format!("`{}`: {fault}", path.display()));
        }
        let file = File::open(path).map_err(|error| format!("`{}` cannot be opened: {error}", path.display()))?;
        Self::parse(BufReader::new(file), wanted).map_err(|fault| format!("`{}`: {fault}", path.display()))
    }

    fn parse(mut reader: impl BufRead, wanted: &Wanted<'_>) -> Result<Self, String> {
        let mut table = Table::default();
        let mut columns: Option<Columns> = None;
        let stated = wanted.columns.is_some();
        if let Some(names) = wanted.columns {
            let (found, unknown) = Columns::stated(names, wanted.frame_rate)?;
            columns = Some(found);
            table.unknown_columns = unknown;
        }
        let mut before_rows = stated;
        let mut cameras: BTreeSet<String> = BTreeSet::new();
        let mut rows: Vec<Row> = Vec::new();
        let mut has_own_rows = false;
        let mut bytes = Vec::new();
        let (mut splitter, mut parted) = (Splitter::new(','), Fields::default());
        for number in 1_u64.. {
            bytes.clear();
            let length = Read::take(&mut reader, LINE_LIMIT)
                .read_until(b'\n', &mut bytes)
                .map_err(|error| format!("line {number} cannot be read: {error}"))?;
            if length == 0 {
                break;
            }
            if length as u64 == LINE_LIMIT {
                return Err(format!("line {number} is longer than {LINE_LIMIT} bytes, so this is no such table"));
            }
            let Ok(line) = std::str::from_utf8(&bytes) else {
                if columns.is_none() {
                    return Err(format!("line {number} is not UTF-8 text, so this is no such table"));
                }
                table.faults.add(format!("line {number}: not UTF-8 text"));
                continue;
            };
            let line = line.trim_start_matches('\u{feff}').trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let Some(columns) = columns else {
                let (found, unknown) = Columns::of(line)?;
                columns = Some(found);
                table.unknown_columns = unknown;
                continue;
            };
            let fields = if stated {
                parted.set(fields_of(line));
                &parted
            } else {
                splitter.split(line)
            };
            before_rows = before_rows && fields.text(0).parse::<f64>().is_err();
            if before_rows {
                continue;
            }
            if let Some(place) = columns.camera {
                let camera = fields.text(place);
                if camera != wanted.name {
                    if cameras.len() < 64 {
                        cameras.insert(camera.to_owned());
                    }
                    if fields.len() <= place {
                        let (n, place) = (fields.len(), place + 1);
                        table.faults.add(format!("line {number}: {n} fields, and `camera` is field {place}"));
                    }
                    continue;
                }
            }
            has_own_rows = true;
            match Row::of(fields, columns, wanted) {
                Ok(row) => rows.push(row.at(number)),
                Err(Unreadable { time, fault }) => {
                    let fault = format!("{} {number}: {fault}", wanted.row);
                    table.faults.add(fault.as_str());
                    if let Some(time) = time {
                        rows.push(Row { time, point: Err(fault), line: number });
                    }
                }
            }
        }
        if columns.is_none() {
            return Err("is empty: expected a header `time_s,camera,x_px,y_px`".to_owned());
        }
        table.collect(rows, wanted.camera);
        let has_content = table.frames.iter().any(|it| it.faults.is_empty() || !it.features.list.is_empty());
        match table.faults.sentence("no row can be used") {
            _ if has_content || (!has_own_rows && cameras.iter().any(|it| !it.is_empty())) => {
                table.other_cameras = cameras;
                Ok(table)
            }
            Some(sentence) => Err(sentence),
            None => Err("holds a header and no rows".to_owned()),
        }
    }

    /// Rows of one time become one frame, in the order of the file.
    fn collect(&mut self, mut rows: Vec<Row>, camera: CameraId) {
        let mut latest = Time(i64::MIN);
        for row in &rows {
            self.out_of_order += u64::from(row.time < latest);
            latest = latest.max(row.time);
        }
        rows.sort_by_key(|row| (row.time, row.line));
        for row in rows {
            if self.frames.last().is_none_or(|it| it.time != row.time) {
                let features = Features { camera, list: Vec::new() };
                self.frames.push(Frame { time: row.time, features, faults: Vec::new() });
            }
            let Some(frame) = self.frames.last_mut() else { unreachable!("one was pushed above") };
            match row.point {
                Ok(Some(feature)) => frame.features.list.push(feature),
                Ok(None) => {}
                Err(fault) => frame.faults.push(fault),
            }
        }
    }
}

/// One line.
struct Row {
    time: Time,
    /// `None`: nothing was found at this time.
    point: Result<Option<Feature>, String>,
    line: u64,
}

/// What is wrong with a row, and its time where that is known.
struct Unreadable {
    time: Option<Time>,
    fault: String,
}

impl Row {
    fn at(self, line: u64) -> Self {
        Self { line, ..self }
    }

    fn of(fields: &Fields, columns: Columns, wanted: &Wanted<'_>) -> Result<Self, Unreadable> {
        let seconds = number(fields, columns.time, "time_s").map_err(|fault| Unreadable { time: None, fault })?;
        let Some(seconds) = seconds.map(|it| it / columns.per_second).filter(|it| it.abs() <= TIME_LIMIT_S) else {
            return Err(Unreadable {
                time: None,
                fault: format!("time_s is {}, expected seconds", fields.text(columns.time)),
            });
        };
        let time = Time::from_s(seconds);
        let point = Self::point(fields, columns, wanted).map_err(|fault| Unreadable { time: Some(time), fault })?;
        Ok(Self { time, point: Ok(point), line: 0 })
    }

    fn point(fields: &Fields, columns: Columns, wanted: &Wanted<'_>) -> Result<Option<Feature>, String> {
        let (x, y) = match (number(fields, columns.x, "x_px")?, number(fields, columns.y, "y_px")?) {
            (Some(0.0), Some(0.0)) if wanted.nothing_at_zero => return Ok(None),
            (Some(x), Some(y)) => (x - wanted.origin, y - wanted.origin),
            (None, None) => return Ok(None),
            (Some(_), None) => return Err("y_px is empty and x_px is not".to_owned()),
            (None, Some(_)) => return Err("x_px is empty and y_px is not".to_owned()),
        };
        if let Some([width, height]) = wanted.size {
            let inside = |value: f64, size: u32| (-1.5..f64::from(size) + 0.5).contains(&value);
            if !inside(x, width) || !inside(y, height) {
                return Err(format!("({x}, {y}) px lies outside the picture of {width} x {height} px"));
            }
        }
        let optional = |column: Option<usize>, name: &str| column.map_or(Ok(None), |it| number(fields, it, name));
        let covariance = covariance(fields, columns, wanted.sigma)?;
        let area = optional(columns.area, "area_px")?.unwrap_or(0.0);
        if !(0.0..=f64::from(u32::MAX)).contains(&area) {
            return Err(format!("area_px is {area}, expected 0 or more"));
        }
        let peak = optional(columns.peak, "peak")?.unwrap_or(0.0);
        if !(0.0..=255.0).contains(&peak) {
            return Err(format!("peak is {peak}, expected 0 to 255"));
        }
        let text = columns.label.map_or("", |it| fields.text(it));
        let named = wanted.names.binary_search_by(|it| it.as_str().cmp(text)).ok();
        let label = match named {
            Some(place) => Some(place as f64),
            None => optional(columns.label, "label")?,
        };
        if let Some(label) = label.filter(|it| it.fract() != 0.0 || !(0.0..=f64::from(u32::MAX)).contains(it)) {
            return Err(format!("label is {label}, expected a whole number of 0 or more"));
        }
        Ok(Some(Feature {
            centre: Point2::new(x, y),
            covariance,
            area: area.round() as u32,
            peak: peak.round() as u8,
            label: label.map(|it| it as u32),
        }))
    }
}

/// From the columns of the covariance, else from `sigma_px`, else from `sigma` [px].
fn covariance(fields: &Fields, columns: Columns, sigma: f64) -> Result<Matrix2<f64>, String> {
    if let Some(places) = columns.covariance {
        let [xx, xy, yy] = [0, 1, 2].map(|it| number(fields, places[it], COVARIANCE[it]));
        if let (Some(xx), Some(xy), Some(yy)) = (xx?, xy?, yy?) {
            if xx > 0.0 && yy > 0.0 && xx * yy > xy * xy && xx.max(yy) <= VARIANCE_LIMIT {
                return Ok(Matrix2::new(xx, xy, xy, yy));
            }
            return Err(format!("({xx}, {xy}, {yy}) px² is no covariance of a point"));
        }
    }
    let sigma = columns.sigma.map_or(Ok(None), |it| number(fields, it, "sigma_px"))?.unwrap_or(sigma);
    if sigma > 0.0 && sigma * sigma <= VARIANCE_LIMIT {
        return Ok(Matrix2::identity() * (sigma * sigma));
    }
    Err(format!("sigma_px is {sigma}, expected more than 0"))
}

/// A finite number; `None` where the field is empty or the row is short.
fn number(fields: &Fields, column: usize, name: &str) -> Result<Option<f64>, String> {
    let text = fields.text(column);
    if text.is_empty() {
        return Ok(None);
    }
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(Some(value)),
        _ => Err(format!("{name} is `{}`, expected a number", text.chars().take(40).collect::<String>())),
    }
}

/// The fields of a line without a header's rules.
fn fields_of(line: &str) -> impl Iterator<Item = &str> {
    line.split(|it: char| it == ',' || it.is_whitespace()).filter(|it| !it.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wanted() -> Wanted<'static> {
        Wanted {
            camera: CameraId(2),
            name: "b",
            size: Some([640, 480]),
            origin: 0.0,
            sigma: 0.5,
            columns: None,
            frame_rate: None,
            nothing_at_zero: false,
            row: "line",
            names: &[],
            least_likelihood: 0.0,
        }
    }

    #[track_caller]
    fn parse(text: &str) -> Result<Table, String> {
        Table::parse(text.as_bytes(), &wanted())
    }

    #[test]
    fn rows_of_one_camera_and_time_are_one_frame() {
        let table = parse("x_px,y_px,camera,time_s\n1,2,b,0.5\n9,9,a,0.5\n3,4,b,0.5\n,,b,0.6\n5,6,b,0.7\n").unwrap();
        let counts: Vec<usize> = table.frames.iter().map(|it| it.features.list.len()).collect();
        assert_eq!(counts, [2, 0, 1]);
        assert_eq!(table.frames[0].time, Time::from_s(0.5));
        assert_eq!(table.frames[0].features.list[1].centre, Point2::new(3.0, 4.0));
        assert_eq!(table.frames[0].features.camera, CameraId(2));
        assert_eq!((table.faults.count(), table.out_of_order), (0, 0));
    }

    #[test]
    fn quality_columns_are_read_and_have_defaults() {
        let table = parse(
            "\u{feff}time_s,camera,x_px,y_px,sigma_px,area_px,peak\r\n# tea\r\n0,\"b\",1,2,0.1,12,200\r\n1,b,1,2\r\n",
        )
        .unwrap();
        let list: Vec<&Feature> = table.frames.iter().map(|it| &it.features.list[0]).collect();
        assert!((list[0].covariance - Matrix2::identity() * 0.01).norm() < 1e-12);
        assert_eq!((list[0].area, list[0].peak), (12, 200));
        assert_eq!((list[1].covariance, list[1].area, list[1].peak), (Matrix2::identity() * 0.25, 0, 0));
    }

    #[test]
    fn whole_covariance_wins_over_sigma() {
        let header = "time_s,camera,x_px,y_px,sigma_px,cxx_px2,cxy_px2,cyy_px2";
        let table =
            parse(&format!("{header}\n0,b,1,2,9,0.04,0.01,0.09\n1,b,1,2,9,,,\n2,b,1,2,9,0.04,0.07,0.09\n")).unwrap();
        assert_eq!(table.frames[0].features.list[0].covariance, Matrix2::new(0.04, 0.01, 0.01, 0.09));
        assert_eq!(table.frames[1].features.list[0].covariance, Matrix2::identity() * 81.0);
        assert!(table.frames[2].faults[0].contains("no covariance"), "{:?}", table.frames[2].faults);
        assert!(parse("time_s,camera,x_px,y_px,cxx_px2\n0,b,1,2,3\n").map(|_| ()).unwrap_err().contains("only some"));
    }

    #[test]
    fn labels_are_whole_numbers_or_left_out() {
        let table =
            parse("time_s,camera,x_px,y_px,label\n0,b,1,2,17\n0,b,1,2,\n0,b,1,2,0\n0,b,1,2,1.5\n0,b,1,2,-1\n").unwrap();
        let labels: Vec<Option<u32>> = table.frames[0].features.list.iter().map(|it| it.label).collect();
        assert_eq!(labels, [Some(17), None, Some(0)]);
        assert!(table.frames[0].faults[0].starts_with("line 5: label is 1.5"), "{:?}", table.frames[0].faults);
        assert_eq!(table.frames[0].faults.len(), 2);
    }

    #[test]
    fn pixels_that_count_from_one_are_moved() {
        let table =
            Table::parse(&b"time_s,camera,x_px,y_px\n0,b,1,1\n"[..], &Wanted { origin: 1.0, ..wanted() }).unwrap();
        assert_eq!(table.frames[0].features.list[0].centre, Point2::new(0.0, 0.0));
    }

    #[test]
    fn bad_rows_are_named_by_line_and_the_others_are_kept() {
        let text = "time_s,camera,x_px,y_px,peak\n0,b,1,2,\n0,b,abc,2,\n1,b,NaN,2,\nx,b,1,2,\n2,b,700,2,\n3,b,1,,\n4,b,1,2,300\n5\n6,b,1,2,\n";
        let table = parse(text).unwrap();
        assert_eq!(table.faults.count(), 7);
        let faults: Vec<&String> = table.frames.iter().flat_map(|it| &it.faults).collect();
        for (found, expected) in faults.iter().zip([
            "line 3: x_px is `abc`",
            "line 4: x_px is `NaN`",
            "line 6: (700",
            "line 7: y_px",
            "line 8: peak",
        ]) {
            assert!(found.starts_with(expected), "{found} for {expected}");
        }
        assert_eq!(faults.len(), 5);
        assert_eq!(table.frames.iter().map(|it| it.features.list.len()).sum::<usize>(), 2);
    }

    #[test]
    fn numbered_pictures_without_a_header_are_read_where_the_rig_names_the_columns() {
        let text = "  frame no.   x   y\n1.0  0.0 0.0\n 2.000  5.5 6.5\n5 abc 7\n";
        let stated =
            Wanted { columns: Some("frame x_px y_px"), frame_rate: Some(25.0), nothing_at_zero: true, ..wanted() };
        let table = Table::parse(text.as_bytes(), &stated).unwrap();
        let times: Vec<f64> = table.frames.iter().map(|it| it.time.as_s()).collect();
        assert_eq!(times, [0.04, 0.08, 0.2]);
        assert!(table.frames[0].features.list.is_empty());
        assert_eq!(table.frames[1].features.list[0].centre, Point2::new(5.5, 6.5));
        assert!(table.frames[2].faults[0].starts_with("line 4: x_px is `abc`"), "{:?}", table.frames[2].faults);
        let seen = Table::parse(text.as_bytes(), &Wanted { nothing_at_zero: false, ..stated.clone() }).unwrap();
        assert_eq!(seen.frames[0].features.list.len(), 1);
        let refused = |wanted: &Wanted<'_>| Table::parse(text.as_bytes(), wanted).map(|_| ()).unwrap_err();
        assert!(refused(&Wanted { frame_rate: None, ..stated.clone() }).contains("frame_rate_hz"));
        assert!(refused(&Wanted { columns: Some("frame x y"), ..stated }).contains("lacks `x_px`"));
    }

    #[test]
    fn fields_in_quotes_hold_commas() {
        let text = "\u{feff}\"time_s\",\"note, long\",camera,x_px, \"y_px\"\r\n0,\"at 12:00, sunny\",b,1,2\r\n1,\"at 12,b,1,2\r\n2,,b,3,4\r\n";
        let table = parse(text).unwrap();
        let centres: Vec<Point2<f64>> =
            table.frames.iter().flat_map(|it| it.features.list.iter().map(|it| it.centre)).collect();
        assert_eq!(centres, [Point2::new(1.0, 2.0), Point2::new(3.0, 4.0)]);
        assert_eq!(table.unknown_columns, ["note, long"]);
        // A quote that is not closed makes a short row, and no more than that.
        let only = parse(&text.replace("0,\"at 12:00, sunny\",b,1,2\r\n", "")).unwrap();
        assert_eq!((only.faults.count(), only.frames.len()), (1, 1));
        let sentence = only.faults.sentence("faults").unwrap();
        assert!(sentence.contains("line 2: 2 fields, and `camera` is field 3"), "{sentence}");
        let named = Wanted { name: "b, left", ..wanted() };
        let own = Table::parse(&b"time_s,camera,x_px,y_px\n0,\"b, left\",1,2\n"[..], &named).unwrap();
        assert_eq!(own.frames.len(), 1);
    }

    #[test]
    fn rows_out_of_order_are_sorted_and_counted() {
        let table = parse("time_s,camera,x_px,y_px\n2,b,1,2\n1,b,3,4\n2,b,5,6\n").unwrap();
        assert_eq!(table.out_of_order, 1);
        let times: Vec<f64> = table.frames.iter().map(|it| it.time.as_s()).collect();
        assert_eq!(times, [1.0, 2.0]);
        assert_eq!(table.frames[1].features.list.len(), 2);
    }

    #[test]
    fn camera_without_rows_beside_others_is_a_table_without_frames() {
        let table = parse("time_s,camera,x_px,y_px\n0,a,1,2\n0,c,1,2\n0\n").unwrap();
        assert!(table.frames.is_empty());
        assert!(table.other_cameras.contains("a") && table.other_cameras.contains("c"));
    }

    #[test]
    fn unusable_files_are_refused_with_the_reason() {
        let refused = |text: &str| parse(text).map(|_| ()).unwrap_err();
        assert!(refused("").contains("empty"));
        assert!(refused("1,2,3,4\n").contains("lacks `time_s`"));
        assert!(refused("time_s;camera;x_px;y_px\n").contains("lacks `time_s`"));
        assert!(refused("time_s,camera,x_px,y_px,time_s\n").contains("twice"));
        assert!(refused("time_s,camera,x_px,y_px\n").contains("no rows"));
        assert!(refused("time_s,camera,x_px,y_px\n0,b,e,2\n").contains("line 2: x_px is `e`"));
        assert!(refused(&"x".repeat(9000)).contains("longer"));
        assert!(Table::parse(&[0xff, 0xd8, 0xff][..], &wanted()).map(|_| ()).unwrap_err().contains("UTF-8"));
    }
}
