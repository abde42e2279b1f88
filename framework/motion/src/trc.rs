//! TRC, the table of points that OpenSim and many laboratories read: own reader and writer, pure functions over text.
//!
//! Three lines of header, a line of labels, a line of coordinates, an empty line, then a line for each frame: number, time, three coordinates for
//! each point, with tabs between. A point that is missing leaves its three fields empty, as OpenSim expects. Some makers
//! append points without a label, and identity, to the lines of a table, and count them in the header: a reader passes over these.

use std::fmt::{self, Write};

use crate::csv::fixed;

/// What a file holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// Frames a second [Hz].
    pub rate_hz: f64,
    /// The unit of positions, such as `mm`.
    pub units: String,
    /// The points.
    pub labels: Vec<String>,
    /// Time of each frame [s].
    pub times_s: Vec<f64>,
    /// Frame by frame, in each of them point by point; `None` where a point is missing.
    pub positions: Vec<Option<[f64; 3]>>,
}

/// What is wrong with a file, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrcError {
    /// The line, counted from 1.
    pub line: usize,
    /// What is there and what should be.
    pub message: String,
}

impl fmt::Display for TrcError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.message)
    }
}

impl std::error::Error for TrcError {}

/// The file `name` of `recording`, with five decimals; labels lose tabs and line ends.
pub fn write(recording: &Recording, name: &str) -> String {
    let (n_frames, n_points) = (recording.times_s.len(), recording.labels.len());
    let mut text = head(recording, n_frames, name, 0);
    text.reserve(n_frames * (20 + n_points * 30));
    for (frame, time_s) in recording.times_s.iter().enumerate() {
        put_row(&mut text, frame + 1, *time_s, &recording.positions[frame * n_points..(frame + 1) * n_points]);
    }
    text
}

/// All that stands before the rows of a file of `n_frames` frames, whatever `about` has of them. Spaces behind the file's name in the first line make it
/// `room` bytes longer than it must be: the digits by which the number of frames grows can take their place.
pub fn head(about: &Recording, n_frames: usize, name: &str, room: usize) -> String {
    let n_points = about.labels.len();
    let mut text = String::with_capacity(300 + n_points * 60 + room);
    text.push_str(&format!("PathFileType\t4\t(X/Y/Z)\t{name}{}\n", " ".repeat(room)));
    text.push_str(
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n",
    );
    let rate = format!("{:.3}", about.rate_hz);
    let units = &about.units;
    text.push_str(&format!("{rate}\t{rate}\t{n_frames}\t{n_points}\t{units}\t{rate}\t1\t{n_frames}\n"));
    text.push_str("Frame#\tTime");
    for label in &about.labels {
        text.push('\t');
        text.push_str(&label.replace(['\t', '\n', '\r'], " "));
        text.push_str("\t\t");
    }
    text.push_str("\n\t");
    for number in 1..=n_points {
        text.push_str(&format!("\tX{number}\tY{number}\tZ{number}"));
    }
    text.push_str("\n\n");
    text
}

/// Adds the line of a frame, counted from 1.
pub fn put_row(text: &mut String, frame: usize, time_s: f64, positions: &[Option<[f64; 3]>]) {
    write!(text, "{frame}\t").ok();
    fixed(text, time_s, 6);
    for position in positions {
        match position {
            Some(position) => position.iter().for_each(|it| {
                text.push('\t');
                fixed(text, *it, 5);
            }),
            None => text.push_str("\t\t\t"),
        }
    }
    text.push('\n');
}

/// Reads a whole file.
///
/// # Errors
/// The line, what is there and what should be.
pub fn read(text: &str) -> Result<Recording, TrcError> {
    let mut lines = text.lines().enumerate();
    let mut next = |what: &str| {
        let complain = || TrcError { line: text.lines().count() + 1, message: format!("the end, expected {what}") };
        lines.next().map(|(line, text)| (line + 1, text)).ok_or_else(complain)
    };
    let (line, first) = next("`PathFileType`")?;
    if first.split('\t').next().map(str::trim) != Some("PathFileType") {
        return fault(line, format_args!("found `{}`, expected `PathFileType`", shortened(first)));
    }
    let (_, names) = next("the names of the header's values")?;
    let (line, values) = next("the header's values")?;
    let value = |wanted: &str| {
        let place = names.split('\t').position(|it| it.trim() == wanted);
        place.and_then(|it| values.split('\t').nth(it)).map(str::trim)
    };
    let rate_hz = value("DataRate").and_then(|it| it.parse().ok()).filter(|it: &f64| it.is_finite() && *it > 0.0);
    let Some(rate_hz) = rate_hz else {
        return fault(
            line,
            format_args!("found the `DataRate` `{}`, expected frames a second", value("DataRate").unwrap_or("")),
        );
    };
    let units = value("Units").unwrap_or("").to_owned();
    let (line, heading) = next("the labels")?;
    if heading.split('\t').next().map(str::trim) != Some("Frame#") {
        return fault(line, format_args!("found `{}`, expected `Frame#`, `Time` and the labels", shortened(heading)));
    }
    let labels = heading.split('\t').skip(2).step_by(3).map(str::trim);
    let mut labels: Vec<String> = labels.map(str::to_owned).collect();
    while labels.last().is_some_and(String::is_empty) {
        labels.pop();
    }
    next("the names of the coordinates")?;
    let mut recording = Recording { rate_hz, units, labels, times_s: Vec::new(), positions: Vec::new() };
    for (line, text) in lines {
        if !text.trim().is_empty() {
            row(line + 1, text, &mut recording)?;
        }
    }
    Ok(recording)
}

/// Adds the frame of one line.
fn row(line: usize, text: &str, recording: &mut Recording) -> Result<(), TrcError> {
    let mut fields = text.trim_end_matches(['\r', '\n']).split('\t').map(str::trim);
    let number = |field: &str| field.parse::<f64>().ok().filter(|it| it.is_finite());
    let _frame = fields.next();
    let time = fields.next().unwrap_or("");
    let Some(time_s) = number(time) else {
        return fault(line, format_args!("found the time `{}`, expected seconds", shortened(time)));
    };
    recording.times_s.push(time_s);
    for label in &recording.labels {
        let of_point = [(); 3].map(|()| fields.next().unwrap_or(""));
        let position = of_point.map(number);
        match position {
            [Some(x), Some(y), Some(z)] => recording.positions.push(Some([x, y, z])),
            _ if of_point.iter().all(|it| it.is_empty() || it.eq_ignore_ascii_case("nan")) => {
                recording.positions.push(None)
            }
            _ => {
                let found = of_point.map(shortened).join("`, `");
                return fault(
                    line,
                    format_args!("found `{found}` for `{label}`, expected three numbers or three empty fields"),
                );
            }
        }
    }
    // Points without a label.
    match fields.find(|it| !it.is_empty() && number(it).is_none()) {
        Some(more) => fault(line, format_args!("found `{}` behind the last point, expected numbers", shortened(more))),
        None => Ok(()),
    }
}

fn shortened(text: &str) -> String {
    text.trim().chars().take(40).collect()
}

fn fault<T>(line: usize, message: impl fmt::Display) -> Result<T, TrcError> {
    Err(TrcError { line, message: message.to_string() })
}

#[cfg(test)]
mod tests {
    use foveate_testkit::data_dir_or_skip;
    use proptest::prelude::*;

    use super::*;
    use crate::c3d;

    proptest! {
        #[test]
        fn recording_comes_back(
            n_points in 0..5_usize, hundredths in prop::collection::vec(prop::option::of([any::<i32>(); 3]), 0..30),
        ) {
            let n_frames = hundredths.len().checked_div(n_points).unwrap_or(3);
            let place = |it: &Option<[i32; 3]>| it.map(|it| it.map(|it| f64::from(it) / 100.0));
            let wanted = Recording {
                rate_hz: 59.94,
                units: "mm".to_owned(),
                labels: (0..n_points).map(|it| format!("mark {it}")).collect(),
                times_s: (0..n_frames).map(|it| it as f64 / 64.0).collect(),
                positions: hundredths[..n_frames * n_points].iter().map(place).collect(),
            };
            prop_assert_eq!(read(&write(&wanted, "a.trc")).unwrap(), wanted);
        }
    }

    #[test]
    fn text_is_what_opensim_expects() {
        let recording = Recording {
            rate_hz: 60.0,
            units: "mm".to_owned(),
            labels: vec!["head".to_owned(), "left\twrist".to_owned()],
            times_s: vec![0.5],
            positions: vec![Some([1.0, -2.5, 0.000_001]), None],
        };
        let expected = "PathFileType\t4\t(X/Y/Z)\tm.trc\n\
            DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n\
            60.000\t60.000\t1\t2\tmm\t60.000\t1\t1\n\
            Frame#\tTime\thead\t\t\tleft wrist\t\t\n\
            \t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\
            \n\
            1\t0.500000\t1.00000\t-2.50000\t0.00000\t\t\t\n";
        assert_eq!(write(&recording, "m.trc"), expected);
    }

    #[test]
    fn broken_files_are_named_by_line() {
        let good = write(
            &Recording {
                rate_hz: 60.0,
                labels: vec!["a".into()],
                times_s: vec![0.0],
                positions: vec![None],
                ..Default::default()
            },
            "a",
        );
        assert!(read(&good).is_ok());
        let complaint = |text: &str| read(text).unwrap_err().to_string();
        assert!(complaint("").starts_with("line 1: the end"));
        assert!(
            complaint("x\ty").contains("line 1: found `x y`") || complaint("x\ty").contains("expected `PathFileType`")
        );
        assert!(complaint(&good.replace("60.000", "fast")).starts_with("line 3: found the `DataRate` `fast`"));
        assert!(complaint(&good.replace("Frame#", "Frame")).starts_with("line 4"));
        assert!(complaint(&format!("{good}2\t1s\n")).starts_with("line 8: found the time `1s`"));
        assert!(complaint(&format!("{good}2\t1\t1\t2\n")).contains("`1`, `2`, `` for `a`"));
        assert!(complaint(&format!("{good}2\t1\t1\t2\t3\tx\n")).contains("behind the last point"));
    }

    /// One trial, written by its laboratory in both forms: the C3D file as it was measured, the table smoothed and with holes filled.
    #[test]
    fn trc_and_c3d_of_one_trial_agree() {
        let Some(folder) = data_dir_or_skip("trc_and_c3d_of_one_trial_agree", "s10_btk_c3d_trc") else { return };
        let table = read(&std::fs::read_to_string(folder.join("TRCSamples__Gait.trc")).unwrap()).unwrap();
        let file = c3d::read(&std::fs::read(folder.join("C3DSamples__others__Gait.c3d")).unwrap()).unwrap();
        assert_eq!((table.labels.len(), table.times_s.len(), table.rate_hz), (33, 487, 100.0));
        assert_eq!((file.labels.len(), file.n_frames(), file.units), (33, 487, table.units.clone()));
        // The same points in the same order, by longer names.
        assert_eq!((table.labels[1].as_str(), file.labels[1].as_str()), ("R.Offset", "ROFF"));
        let median_with_lag = |lag: usize| {
            let pairs = table.positions.iter().zip(&file.samples[lag * 33..]).filter(|it| it.1.is_present());
            let distance =
                |a: [f64; 3], b: [f32; 3]| (0..3).map(|it| (a[it] - f64::from(b[it])).powi(2)).sum::<f64>().sqrt();
            let mut distances: Vec<f64> = pairs.filter_map(|(a, b)| a.map(|a| distance(a, b.position))).collect();
            distances.sort_by(f64::total_cmp);
            (distances.len(), distances[distances.len() / 2], distances[distances.len() * 95 / 100])
        };
        let (n, median, p95) = median_with_lag(0);
        assert_eq!(n, 5515);
        assert!(median < 0.75 && p95 < 3.7, "{median} {p95} mm");
        assert!(median_with_lag(1).1 > 14.0, "one frame apart");
    }

    #[test]
    fn tables_of_other_makers_are_read() {
        let Some(folder) = data_dir_or_skip("tables_of_other_makers_are_read", "s10_btk_c3d_trc") else { return };
        let facts = |name: &str| {
            let it = read(&std::fs::read_to_string(folder.join(name)).unwrap()).unwrap();
            let missing = it.positions.iter().filter(|it| it.is_none()).count();
            (it.labels.len(), it.times_s.len(), it.rate_hz, missing as f64 / it.positions.len() as f64)
        };
        let knee = facts("TRCSamples__Knee.trc");
        assert_eq!((knee.0, knee.1, knee.2), (71, 200, 200.0));
        assert!((knee.3 - 0.24).abs() < 0.01, "{}", knee.3);
        assert_eq!(facts("TRCSamples__MOTEK__ballet_reduced.trc").0, 41);
    }
}
