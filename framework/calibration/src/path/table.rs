//! A measured path as text: rows of time and place, with or without a header, as RTK receivers and total stations export them.
//!
//! | columns | read as |
//! |---|---|
//! | `time_s`, `time_ms`, `time`, `t`, `timestamp`, … | the path's own clock [s, or as the name says]; also `12:34:56.7` and dates with it |
//! | `x_m`, `y_mm`, `z`, `east`, `north`, `up`, … | place [m, or as the name or [`TableOptions::metres_per_unit`] says] |
//! | `lat`, `lon`, `height` | geodetic place (WGS 84, degrees and metres): made east, north, up about the first row |
//! | no header, four columns | time, x, y, z |
//! | no header, three columns | x, y, z, with [`TableOptions::rate_hz`] |
//!
//! Commas, semicolons, tabs or blanks part the fields. Lines that begin with `#`, `%` or `//` are comments; a comment right before the first row
//! that names its columns is the header, as in the `.pos` files of RTKLIB.

use foveate_diagnostics::fields::Splitter;
use nalgebra::{Matrix3, Point3, Vector3};

/// WGS 84: semi-major axis [m] and flattening.
const WGS84: (f64, f64) = (6_378_137.0, 1.0 / 298.257_223_563);
const TIME: [&str; 13] = [
    "time",
    "t",
    "timestamp",
    "seconds",
    "sec",
    "secs",
    "gpst",
    "utc",
    "tow",
    "gps_time",
    "gpstime",
    "epoch",
    "datetime",
];
const X: [&str; 5] = ["x", "east", "e", "easting", "px"];
const Y: [&str; 5] = ["y", "north", "n", "northing", "py"];
const Z: [&str; 6] = ["z", "up", "u", "pz", "height", "elevation"];
const LATITUDE: [&str; 2] = ["lat", "latitude"];
const LONGITUDE: [&str; 4] = ["lon", "lng", "long", "longitude"];
const HEIGHT: [&str; 8] = ["height", "alt", "altitude", "h", "ele", "elevation", "ellipsoidal_height", "up"];
const LENGTHS: [(&str, f64); 5] = [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0), ("ft", 0.3048), ("km", 1e3)];
const TIMES: [(&str, f64); 5] = [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("min", 60.0)];

/// What the file does not state itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TableOptions {
    /// Rows a second, where the file has no times [Hz].
    pub rate_hz: Option<f64>,
    /// Of x, y, z, where their names state no unit [m].
    pub metres_per_unit: f64,
}

impl Default for TableOptions {
    fn default() -> Self {
        Self { rate_hz: None, metres_per_unit: 1.0 }
    }
}

/// A path as read from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct PathTable {
    /// Times [s] and places [m].
    pub rows: Vec<(f64, Point3<f64>)>,
    /// Remarks: ignored columns, the origin of geodetic coordinates, rows without numbers.
    pub notes: Vec<String>,
}

/// A file that cannot be read as a path.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}found {found}, expected {expected}", line.map_or(String::new(), |it| format!("line {it}: ")))]
pub struct TableError {
    /// Counted from 1; none where it is of the whole file.
    pub line: Option<usize>,
    /// What is there.
    pub found: String,
    /// What should be.
    pub expected: String,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Places {
    /// Columns of x, y, z and the length of their unit [m].
    Cartesian([(usize, f64); 3]),
    /// Latitude, longitude, height.
    Geodetic([usize; 3]),
}

#[derive(Debug, Clone, PartialEq)]
struct Columns {
    /// Column of the time and the length of its unit [s].
    time: Option<(usize, f64)>,
    places: Places,
    /// Columns in all, as the header or the first row has them.
    count: usize,
    passed_over: Vec<String>,
}

/// Reads the text of a file.
///
/// # Errors
/// See [`TableError`].
pub fn parse(text: &str, options: &TableOptions) -> Result<PathTable, TableError> {
    let text = text.trim_start_matches('\u{feff}');
    let mut header: Option<(usize, Vec<String>)> = None;
    let mut rows: Vec<(usize, Vec<String>)> = Vec::new();
    let mut splitters = SEPARATORS.map(Splitter::new);
    for (index, line) in text.lines().enumerate() {
        let trimmed = line.trim();
        let comment = ["#", "%", "//"].iter().find_map(|it| trimmed.strip_prefix(it));
        let fields = fields(comment.unwrap_or(trimmed), &mut splitters);
        match comment {
            Some(_) if rows.is_empty() && columns_of(&fields, options).is_ok() => header = Some((index + 1, fields)),
            Some(_) => {}
            None if trimmed.is_empty() => {}
            None if rows.is_empty() && fields.iter().all(|it| is_word(it)) => header = Some((index + 1, fields)),
            None => rows.push((index + 1, fields)),
        }
    }
    let Some((_, first)) = rows.first() else {
        return Err(TableError {
            line: None,
            found: "no row of numbers".into(),
            expected: "a row for each time: time, x, y, z".into(),
        });
    };
    let columns = match &header {
        Some((line, names)) => columns_of(names, options).map_err(|it| TableError { line: Some(*line), ..it })?,
        None => in_order(first.len(), options).map_err(|it| TableError { line: Some(rows[0].0), ..it })?,
    };
    let mut table = PathTable { rows: Vec::with_capacity(rows.len()), notes: Vec::new() };
    let (mut without_numbers, mut geodetic) = (0, Vec::new());
    for (number, (line, fields)) in rows.iter().enumerate() {
        let fields = joined_date(fields, columns.count);
        if !has_each_column(&fields, columns.count) {
            let found = format!("{} fields", fields.len());
            let expected = match &header {
                Some((line, _)) => format!("{}, as line {line} names columns", columns.count),
                None => format!("{}, as line {} has", columns.count, rows[0].0),
            };
            return Err(TableError { line: Some(*line), found, expected });
        }
        let number_at = |column: usize| -> Result<f64, TableError> {
            let field = fields.get(column).map_or("", String::as_str);
            match field {
                "" | "-" | "nan" | "NaN" | "NAN" | "null" | "None" => Ok(f64::NAN),
                _ => parse_number(field).ok_or_else(|| TableError {
                    line: Some(*line),
                    found: format!("`{field:.40}`"),
                    expected: "a number".into(),
                }),
            }
        };
        let time_s = match (columns.time, options.rate_hz) {
            (Some((column, unit)), _) => {
                let field = fields.get(column).map_or("", String::as_str);
                match clock_time(field) {
                    Some(seconds) => seconds,
                    None => number_at(column)? * unit,
                }
            }
            (None, Some(rate_hz)) => number as f64 / rate_hz,
            (None, None) => unreachable!("columns without a time are refused unless there is a rate"),
        };
        let place = match columns.places {
            Places::Cartesian(of) => {
                let [x, y, z] = [0, 1, 2].map(|axis| number_at(of[axis].0).map(|it| it * of[axis].1));
                Point3::new(x?, y?, z?)
            }
            Places::Geodetic(of) => {
                let [latitude, longitude, height] = of.map(number_at);
                let place = [latitude?, longitude?, height?];
                if place[0].abs() > 90.0 || place[1].abs() > 360.0 {
                    let found = format!("latitude {}, longitude {}", place[0], place[1]);
                    return Err(TableError { line: Some(*line), found, expected: "degrees, to 90 and 360".into() });
                }
                geodetic.push(place);
                Point3::origin()
            }
        };
        table.rows.push((time_s, place));
    }
    if !geodetic.is_empty() {
        let first = geodetic.iter().find(|it| it.iter().all(|it| it.is_finite())).copied().unwrap_or([0.0; 3]);
        for (row, place) in table.rows.iter_mut().zip(&geodetic) {
            row.1 = east_north_up(*place, first);
        }
        let [latitude, longitude, height] = first;
        table.notes.push(format!(
            "the world is east, north, up about latitude {latitude:.9}°, longitude {longitude:.9}°, height {height:.3} m (WGS 84), the first row of the path"
        ));
    }
    without_numbers += table.rows.iter().filter(|it| !(it.0.is_finite() && it.1.coords.norm().is_finite())).count();
    if without_numbers > 0 {
        table.notes.push(format!(
            "{without_numbers} of {} rows of the path have no coordinates and are ignored",
            table.rows.len()
        ));
    }
    if !columns.passed_over.is_empty() {
        table.notes.push(format!("ignored columns of the path: {}", columns.passed_over.join(", ")));
    }
    Ok(table)
}

/// Whether no field is missing (which one, cannot be known) and none is over. Separators behind the last field, as some programs write them, hold nothing.
fn has_each_column(fields: &[String], count: usize) -> bool {
    fields.len() >= count && fields[count..].iter().all(String::is_empty)
}

/// The first of these that stands outside of quotes parts the fields of a line; without any, blanks do. With semicolons a comma is that of a decimal number.
const SEPARATORS: [char; 3] = [';', ',', '\t'];

fn fields(line: &str, splitters: &mut [Splitter; 3]) -> Vec<String> {
    let outside_of_quotes = line.trim().split('"').step_by(2);
    let parts = |by: char| outside_of_quotes.clone().any(|it| it.contains(by));
    match SEPARATORS.into_iter().position(parts) {
        Some(0) => splitters[0].split(line).iter().map(|it| it.replace(',', ".")).collect(),
        Some(place) => splitters[place].split(line).iter().map(str::to_owned).collect(),
        None => line.split_whitespace().map(str::to_owned).collect(),
    }
}

fn is_word(field: &str) -> bool {
    !field.is_empty() && parse_number(field).is_none() && clock_time(field).is_none() || field.is_empty()
}

fn parse_number(field: &str) -> Option<f64> {
    field.parse::<f64>().ok()
}

/// A name without its unit: lower case, the unit after `_` or in brackets.
fn name_and_unit(name: &str) -> (String, Option<String>) {
    let lower = name.trim().to_lowercase().replace([' ', '-'], "_");
    if let Some((bare, unit)) = lower.split_once(['(', '[']) {
        let unit = unit.trim_end_matches([')', ']']).trim_matches('_').to_owned();
        return (bare.trim_matches('_').to_owned(), Some(unit));
    }
    let is_unit = |it: &str| {
        LENGTHS.iter().any(|unit| unit.0 == it)
            || TIMES.iter().any(|unit| unit.0 == it)
            || ["deg", "degrees"].contains(&it)
    };
    match lower.rsplit_once('_') {
        Some((bare, unit)) if is_unit(unit) => (bare.to_owned(), Some(unit.to_owned())),
        _ => (lower, None),
    }
}

fn columns_of(names: &[String], options: &TableOptions) -> Result<Columns, TableError> {
    let parted: Vec<(String, Option<String>)> = names.iter().map(|it| name_and_unit(it)).collect();
    let find = |known: &[&str]| known.iter().find_map(|name| parted.iter().position(|it| it.0 == *name));
    let unit_of = |column: usize, known: &[(&str, f64)], otherwise: f64| -> Result<f64, TableError> {
        let Some(unit) = &parted[column].1 else { return Ok(otherwise) };
        known.iter().find(|it| it.0 == unit).map(|it| it.1).ok_or_else(|| TableError {
            line: None,
            found: format!("the unit `{unit}` of column `{}`", names[column]),
            expected: known.iter().map(|it| it.0).collect::<Vec<_>>().join(", "),
        })
    };
    let all = || names.join(", ");
    let time = match find(&TIME) {
        Some(column) => Some((column, unit_of(column, &TIMES, 1.0)?)),
        None if options.rate_hz.is_some() => None,
        None => {
            let expected = format!("a column of times (one of {}), or --path-rate HZ", TIME[..4].join(", "));
            return Err(TableError { line: None, found: format!("the columns {}", all()), expected });
        }
    };
    let places = match ([find(&LATITUDE), find(&LONGITUDE), find(&HEIGHT)], [find(&X), find(&Y), find(&Z)]) {
        ([Some(latitude), Some(longitude), Some(height)], _) => Places::Geodetic([latitude, longitude, height]),
        (_, [Some(x), Some(y), Some(z)]) => {
            let mut of = [x, y, z].map(|it| (it, 0.0));
            for it in &mut of {
                it.1 = unit_of(it.0, &LENGTHS, options.metres_per_unit)?;
            }
            Places::Cartesian(of)
        }
        _ => {
            let expected = "columns x, y, z (or east, north, up), or lat, lon, height".to_owned();
            return Err(TableError { line: None, found: format!("the columns {}", all()), expected });
        }
    };
    let count = names.iter().rposition(|it| !it.is_empty()).map_or(0, |last| last + 1);
    let mut columns = Columns { time, places, count, passed_over: Vec::new() };
    let used: Vec<usize> = match places {
        Places::Cartesian(of) => of.iter().map(|it| it.0).chain(time.map(|it| it.0)).collect(),
        Places::Geodetic(of) => of.into_iter().chain(time.map(|it| it.0)).collect(),
    };
    let over = names.iter().enumerate().filter(|it| !used.contains(&it.0) && !it.1.is_empty());
    columns.passed_over = over.map(|it| it.1.clone()).collect();
    Ok(columns)
}

/// Without a header.
fn in_order(count: usize, options: &TableOptions) -> Result<Columns, TableError> {
    let unit = options.metres_per_unit;
    let of = |first: usize| Places::Cartesian([(first, unit), (first + 1, unit), (first + 2, unit)]);
    let columns = |time: Option<(usize, f64)>, places| Columns { time, places, count, passed_over: Vec::new() };
    match (count, options.rate_hz) {
        (4, None) => Ok(columns(Some((0, 1.0)), of(1))),
        (3, Some(_)) => Ok(columns(None, of(0))),
        (3, None) => Err(TableError {
            line: None,
            found: "three columns without names".into(),
            expected: "--path-rate HZ beside x, y, z, or a first column with times".into(),
        }),
        (4, Some(_)) => Err(TableError {
            line: None,
            found: "four columns without names, and --path-rate".into(),
            expected: "three (x, y, z), or a header that says which column is which".into(),
        }),
        _ => Err(TableError {
            line: None,
            found: format!("{count} columns without names"),
            expected: "four (time, x, y, z), three with --path-rate, or a header".into(),
        }),
    }
}

/// A date and a time of day that blanks part are one field.
fn joined_date(fields: &[String], count: usize) -> Vec<String> {
    let is_split =
        fields.len() == count + 1 && fields.len() > 1 && clock_time(&format!("{} {}", fields[0], fields[1])).is_some();
    if !is_split {
        return fields.to_vec();
    }
    std::iter::once(format!("{} {}", fields[0], fields[1])).chain(fields[2..].iter().cloned()).collect()
}

/// `12:34:56.7` as seconds of the day; with a date before it (`2026-03-14T…`, `2026/03/14 …`) since 1970. Zones other than Z are not known.
fn clock_time(field: &str) -> Option<f64> {
    let field = field.trim().trim_end_matches('Z');
    let (date, time) = match field.split_once(['T', ' ']) {
        Some((date, time)) => (Some(date), time.trim()),
        None => (None, field),
    };
    let mut parts = time.split(':');
    let (hours, minutes, seconds) = (parts.next()?, parts.next()?, parts.next()?);
    if parts.next().is_some() {
        return None;
    }
    let seconds_of_day = 3600.0 * f64::from(hours.parse::<u32>().ok()?)
        + 60.0 * f64::from(minutes.parse::<u32>().ok()?)
        + seconds.parse::<f64>().ok()?;
    let days = match date {
        None => 0.0,
        Some(date) => {
            let mut parts = date.split(['-', '/']);
            let mut next = || parts.next()?.parse::<i64>().ok();
            days_since_1970(next()?, next()?, next()?)? as f64
        }
    };
    Some(86_400.0 * days + seconds_of_day)
}

/// Of the Gregorian calendar; source: E. G. Richards, *Mapping Time*, 1998, algorithm E, with months counted from March.
fn days_since_1970(year: i64, month: i64, day: i64) -> Option<i64> {
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) || !(1900..=2200).contains(&year) {
        return None;
    }
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let (century, of_century) = (year / 100, year % 100);
    Some(146_097 * century / 4 + 1461 * of_century / 4 + (153 * month + 2) / 5 + day - 719_469)
}

/// East, north, up [m] of a geodetic place about another one [°, °, m], by way of earth-centred coordinates.
fn east_north_up(place: [f64; 3], about: [f64; 3]) -> Point3<f64> {
    let (latitude, longitude) = (about[0].to_radians(), about[1].to_radians());
    let (sin_b, cos_b, sin_l, cos_l) = (latitude.sin(), latitude.cos(), longitude.sin(), longitude.cos());
    let enu_from_ecef = Matrix3::new(
        -sin_l,
        cos_l,
        0.0, //
        -sin_b * cos_l,
        -sin_b * sin_l,
        cos_b, //
        cos_b * cos_l,
        cos_b * sin_l,
        sin_b,
    );
    Point3::from(enu_from_ecef * (earth_centred(place) - earth_centred(about)))
}

fn earth_centred([latitude, longitude, height]: [f64; 3]) -> Vector3<f64> {
    let (axis, flattening) = WGS84;
    let eccentricity2 = flattening * (2.0 - flattening);
    let (latitude, longitude) = (latitude.to_radians(), longitude.to_radians());
    let normal = axis / (1.0 - eccentricity2 * latitude.sin().powi(2)).sqrt();
    Vector3::new(
        (normal + height) * latitude.cos() * longitude.cos(),
        (normal + height) * latitude.cos() * longitude.sin(),
        (normal * (1.0 - eccentricity2) + height) * latitude.sin(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn read(text: &str) -> PathTable {
        parse(text, &TableOptions::default()).unwrap()
    }

    #[track_caller]
    fn fault(text: &str, rate_hz: Option<f64>) -> String {
        parse(text, &TableOptions { rate_hz, metres_per_unit: 1.0 }).unwrap_err().to_string()
    }

    #[test]
    fn columns_go_by_name_or_in_order() {
        let expected = vec![(1.0, Point3::new(2.0, 3.0, 4.0)), (1.5, Point3::new(2.5, 3.5, 4.5))];
        for text in [
            "time,x,y,z\n1,2,3,4\n1.5,2.5,3.5,4.5\n",
            "1 2 3 4\n1.5 2.5 3.5 4.5\n",
            "# made by a total station\nz_mm;y_cm;x_m;t_ms\n4000;300;2;1000\n4500;350;2,5;1500\n",
            "%  GPST  east(m) north(m) up(m) Q\n1 2 3 4 1\n1.5 2.5 3.5 4.5 1\n",
            "\u{feff}Timestamp [s],East,North,Up\r\n1,2,3,4\r\n1.5,2.5,3.5,4.5\r\n",
            "time\tx\ty\tz\n1\t2\t3\t4\n1.5\t2.5\t3.5\t4.5\n",
        ] {
            assert_eq!(read(text).rows, expected, "{text}");
        }
        let quoted = "\"time\",\"x\",y,z,\"note; or, more\"\n1,2,\"3\",4,\"a, b\"\n1.5, \"2.5\",3.5,4.5,\"c; d\"\n";
        assert_eq!(read(quoted).rows, expected);
        assert!(read("time,x,y,z,q\n1,2,3,4,5\n").notes[0].ends_with(": q"));
        let in_mm = parse("1,2,3\n4,5,6\n", &TableOptions { rate_hz: Some(4.0), metres_per_unit: 1e-3 }).unwrap();
        assert_eq!(in_mm.rows[1], (0.25, Point3::new(4e-3, 5e-3, 6e-3)));
    }

    #[test]
    fn rows_without_a_place_stay_gaps() {
        let table = read("time,x,y,z\n1,2,3,4\n2,,,\n3,nan,3,4\n");
        assert_eq!(table.rows.iter().filter(|it| it.1.coords.norm().is_finite()).count(), 1);
        assert!(table.notes[0].contains("2 of 3 rows"), "{:?}", table.notes);
    }

    #[test]
    fn separators_behind_the_last_field_hold_nothing() {
        let expected = vec![(1.0, Point3::new(2.0, 3.0, 4.0)), (1.5, Point3::new(2.5, 3.5, 4.5))];
        for text in ["time,x,y,z\n1,2,3,4,\n1.5,2.5,3.5,4.5,,\n", "time,x,y,z,\n1,2,3,4\n1.5,2.5,3.5,4.5,\n"] {
            assert_eq!(read(text).rows, expected, "{text}");
        }
    }

    #[test]
    fn clocks_and_dates_are_seconds() {
        let table = read("time,x,y,z\n00:01:40.5,0,0,0\n2000-01-01T00:00:01Z,0,0,0\n1970-01-02 00:00:00,0,0,0\n");
        assert_eq!(table.rows.iter().map(|it| it.0).collect::<Vec<_>>(), [100.5, 946_684_801.0, 86_400.0]);
        let of_rtklib = "% program   : RTKLIB\n%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns\n\
                         2026/03/14 10:00:00.000   47.000000000    8.000000000   500.0   1  20\n\
                         2026/03/14 10:00:00.200   47.000010000    8.000000000   501.0   1  20\n";
        let table = read(of_rtklib);
        assert!((table.rows[1].0 - table.rows[0].0 - 0.2).abs() < 1e-6);
        // A second of arc of latitude is 30.88 m at 47°: 1e-5° are 1.1117 m.
        let second = table.rows[1].1;
        assert!((second - Point3::new(0.0, 1.111_7, 1.0)).norm() < 2e-3, "{second}");
        assert!(table.notes[0].contains("latitude 47.000000000°"), "{:?}", table.notes);
    }

    #[test]
    fn geodetic_places_become_east_north_up() {
        // By hand on a sphere of the local radii: at the equator a degree of longitude is 111 319.49 m, of latitude 110 574.3 m.
        let east = east_north_up([0.0, 1e-3, 0.0], [0.0; 3]);
        let north = east_north_up([1e-3, 0.0, 0.0], [0.0; 3]);
        assert!((east - Point3::new(111.319_49, 0.0, 0.0)).norm() < 1.5e-3, "{east}");
        assert!((north - Point3::new(0.0, 110.574_3, 0.0)).norm() < 1.5e-3, "{north}");
        let up = east_north_up([47.3, 8.5, 512.0], [47.3, 8.5, 500.0]);
        assert!((up - Point3::new(0.0, 0.0, 12.0)).norm() < 1e-6, "{up}");
    }

    #[test]
    fn what_is_not_understood_is_named() {
        for (text, rate, words) in [
            ("", None, "no row of numbers"),
            ("time,x,y\n1,2,3\n", None, "line 1: found the columns time, x, y, expected columns x, y, z"),
            ("x,y,z\n1,2,3\n", None, "--path-rate HZ"),
            ("1,2,3\n", None, "line 1: found three columns without names, expected --path-rate"),
            ("1,2,3,4\n", Some(5.0), "four columns without names, and --path-rate"),
            ("1,2,3,4,5\n", None, "5 columns without names"),
            ("time,x,y,z\n1,2,3,4\n2,2,3\n", None, "line 3: found 3 fields, expected 4, as line 1 names columns"),
            ("time,x,y,z\n1,2,3,4\n2,2,3,4,5\n", None, "line 3: found 5 fields, expected 4, as line 1 names columns"),
            ("time,x,y,z,q\n1,2,3,4,5\n\n2,2,3,4\n", None, "line 4: found 4 fields, expected 5"),
            ("# of a station\n1 2 3 4\n2 2 3\n", None, "line 3: found 3 fields, expected 4, as line 2 has"),
            ("1 2 3 4\n2 2 3 4 5\n", None, "line 2: found 5 fields, expected 4, as line 1 has"),
            ("1,2,3\n1,2\n", Some(5.0), "line 2: found 2 fields, expected 3, as line 1 has"),
            ("% GPST x y z\n2026/03/14 10:00:00 1 2 3\n2026/03/14 10:00:01 1 2\n", None, "line 3: found `2026/03/14`"),
            ("time,x,y,z\n1,2,3,4\n2,two,3,4\n", None, "line 3: found `two`, expected a number"),
            ("time_h,x_au,y,z\n1,2,3,4\n", None, "line 1"),
            ("time,lat,lon,h\n1,95,3,4\n", None, "latitude 95"),
        ] {
            let found = fault(text, rate);
            assert!(found.contains(words), "{found}\n  expected {words}");
        }
    }
}
