//! TRC, the table of points that OpenSim and many laboratories read: reader and writer, pure functions over text.
//!
//! Three lines of header, a line of labels, a line of coordinates, an empty line, then a line for each frame: number, time, three coordinates for
//! each point, with tabs between. A point that is missing leaves its three fields empty, as OpenSim expects. Some makers
//! append points without a label, and identity, to the lines of a table, and count them in the header: a reader passes over these.

use std::fmt::{self, Write};

use crate::csv::fixed;
use crate::last_row::Shapes;

/// The content of a TRC file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// Frame rate [Hz].
    pub rate_hz: f64,
    /// The unit of positions, such as `mm`.
    pub units: String,
    /// Names of the points.
    pub labels: Vec<String>,
    /// Time of each frame [s].
    pub times_s: Vec<f64>,
    /// Positions frame by frame, point by point within; `None` where a point is missing.
    pub positions: Vec<Option<[f64; 3]>>,
}

/// Why a file cannot be read, with the place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrcError {
    /// Line number, from 1.
    pub line: usize,
    /// What was found and what was expected.
    pub message: String,
}

impl fmt::Display for TrcError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.message)
    }
}

impl std::error::Error for TrcError {}

/// Encodes `recording` as a file called `name`, with five decimals; tabs and line ends in labels are removed.
pub fn write(recording: &Recording, name: &str) -> String {
    let (n_frames, n_points) = (recording.times_s.len(), recording.labels.len());
    let mut text = head(recording, n_frames, name, 0);
    text.reserve(n_frames * (20 + n_points * 30));
    for (frame, time_s) in recording.times_s.iter().enumerate() {
        put_row(&mut text, frame + 1, *time_s, &recording.positions[frame * n_points..(frame + 1) * n_points]);
    }
    text
}

/// The header of a file of `n_frames` frames, with the labels and units of `about`. Spaces behind the file's name in
/// the first line make it `room` bytes longer than needed, for more digits of the number of frames later.
pub fn head(about: &Recording, n_frames: usize, name: &str, room: usize) -> String {
    let n_points = about.labels.len();
    let mut text = String::with_capacity(300 + n_points * 60 + room);
    text.push_str(&format!("PathFileType\t4\t(X/Y/Z)\t{name}{}\n", " ".repeat(room)));
    text.push_str(
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n",
    );
    let rate = rate_text(about.rate_hz);
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

/// With three decimals, and all that it takes where they say another rate.
fn rate_text(rate_hz: f64) -> String {
    let short = format!("{rate_hz:.3}");
    let is_it = short.parse::<f64>().is_ok_and(|it| (it - rate_hz).abs() <= 1e-12 * rate_hz.abs());
    if is_it { short } else { rate_hz.to_string() }
}

/// Appends the row of a frame, counted from 1.
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

/// Reads a whole file. [`read_with_remarks`] also says how contradictions in it were resolved.
///
/// # Errors
/// As [`read_with_remarks`].
pub fn read(text: &str) -> Result<Recording, TrcError> {
    read_with_remarks(text).map(|it| it.0)
}

/// Frames of so many fields that are not in the text are believed: rows may leave out the tabs of points that are missing at their end, and no
/// file of a few lines may ask for more memory than this and 4 times its own length. [points]
const MOST_LEFT_OUT: usize = 1 << 20;

/// Reads a whole file, with remarks on contradictions in it and how they were resolved.
///
/// All kinds of line ends, a byte-order mark and empty lines are accepted. The points are those of the line of labels,
/// whatever the header counts; where there is none, the width of the rows gives their number, and they are called
/// `unlabelled-N`. A last row that may be cut is left out: one without a line end whose last number may lack digits,
/// or one with fewer fields than the others in a file that counts more frames.
///
/// # Errors
/// The line, what was found and what was expected.
pub fn read_with_remarks(text: &str) -> Result<(Recording, Vec<String>), TrcError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let ends = if text.contains('\n') { '\n' } else { '\r' };
    let mut lines = text.split_terminator(ends).enumerate().map(|(line, text)| (line + 1, text.trim_end_matches('\r')));
    let n_lines = text.lines().count();
    let mut next = |what: &str| {
        let complain = || TrcError { line: n_lines + 1, message: format!("the end, expected {what}") };
        lines.by_ref().find(|it| !it.1.trim().is_empty()).ok_or_else(complain)
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
    let count = |wanted: &str| value(wanted).and_then(|it| it.parse::<usize>().ok());
    let (n_markers, n_rows) = (count("NumMarkers"), count("NumFrames"));
    let units = value("Units").unwrap_or("").to_owned();
    let (line, heading) = next("the labels")?;
    if heading.split('\t').next().map(str::trim) != Some("Frame#") {
        return fault(line, format_args!("found `{}`, expected `Frame#`, `Time` and the labels", shortened(heading)));
    }
    let mut rows = Rows {
        recording: Recording { rate_hz, units, labels: labels(heading), ..Recording::default() },
        n_left_out: 0,
        most: MOST_LEFT_OUT.saturating_add(text.len().saturating_mul(4)),
    };
    let mut remarks = Vec::new();
    let mut unnamed = 0;
    let has_end = text.ends_with(['\n', '\r']);
    let mut shapes = Shapes::default();
    let mut least_fields = usize::MAX;
    let mut lines = lines.filter(|it| !it.1.trim().is_empty()).peekable();
    while let Some((line, text)) = lines.next() {
        // The names of the coordinates; a file may lack them.
        if rows.recording.times_s.is_empty() && text.split('\t').take(2).all(|it| it.trim().is_empty()) {
            continue;
        }
        if rows.recording.labels.is_empty() && rows.recording.times_s.is_empty() {
            unnamed = (text.trim_end().split('\t').count().saturating_sub(2)).div_ceil(3);
            rows.recording.labels = (1..=unnamed).map(|it| format!("unlabelled-{it}")).collect();
        }
        let n_before = rows.recording.times_s.len();
        let n_fields = text.split('\t').count();
        let added = rows.add(line, text);
        let last = text.rsplit('\t').next().unwrap_or("").trim();
        let coordinates = text.split('\t').skip(2);
        if lines.peek().is_none() {
            coordinates.take(n_fields.saturating_sub(3)).for_each(|it| shapes.add(it));
            let is_short = n_fields < least_fields.min(2 + 3 * rows.recording.labels.len());
            let is_more_said = n_rows.is_some_and(|it| it > n_before + 1);
            let is_whole = added.is_ok() && !is_short && (last.is_empty() || shapes.tell_whole(last));
            if if has_end { is_short && is_more_said } else { is_more_said || !is_whole } {
                let found = if has_end { "fewer fields than the others have" } else { "no end of line" };
                remarks.push(format!("line {line}: found {found}; the row may be cut, and is left out"));
                rows.remove_behind(n_before);
                break;
            }
        } else {
            coordinates.for_each(|it| shapes.add(it));
            least_fields = least_fields.min(n_fields);
        }
        added?;
    }
    let recording = rows.recording;
    let n_points = recording.labels.len();
    if unnamed > 0 {
        remarks.push(format!("the points have no names; the first row has {unnamed}, called `unlabelled-N`"));
    }
    // More in the header than labels: points that their maker appends without identity, which are passed over.
    if let Some(n_markers) = n_markers.filter(|it| *it != n_points) {
        remarks.push(format!("the header counts {n_markers} markers, the table names {n_points}; taken: {n_points}"));
    }
    if let Some(n_rows) = n_rows.filter(|it| *it != recording.times_s.len()) {
        let found = recording.times_s.len();
        remarks.push(format!("the header counts {n_rows} frames, the table has {found}; taken: {found}"));
    }
    Ok((recording, remarks))
}

/// The labels of their line: at every third field, or one a field where they stand side by side.
fn labels(heading: &str) -> Vec<String> {
    let fields: Vec<&str> = heading.split('\t').skip(2).map(str::trim).collect();
    let is_spread = fields.iter().enumerate().all(|(place, it)| it.is_empty() || place % 3 == 0);
    let mut labels: Vec<String> = match is_spread {
        true => fields.iter().step_by(3).map(|it| (*it).to_owned()).collect(),
        false => fields.iter().filter(|it| !it.is_empty()).map(|it| (*it).to_owned()).collect(),
    };
    while labels.last().is_some_and(String::is_empty) {
        labels.pop();
    }
    labels
}

/// The table as it is read.
struct Rows {
    recording: Recording,
    /// Points for which rows had no fields, and how many there may be.
    n_left_out: usize,
    most: usize,
}

impl Rows {
    /// Keeps so many frames.
    fn remove_behind(&mut self, n_frames: usize) {
        self.recording.times_s.truncate(n_frames);
        self.recording.positions.truncate(n_frames * self.recording.labels.len());
    }

    /// Adds the frame of one line.
    fn add(&mut self, line: usize, text: &str) -> Result<(), TrcError> {
        let recording = &mut self.recording;
        let n_fields = text.split('\t').count().saturating_sub(2);
        self.n_left_out += recording.labels.len().saturating_sub(n_fields.div_ceil(3));
        if self.n_left_out > self.most {
            let n_points = recording.labels.len();
            return fault(line, format_args!("found {n_fields} fields, expected three for each of {n_points} points"));
        }
        let mut fields = text.split('\t').map(str::trim);
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
        match fields.find(|it| !it.is_empty() && !it.eq_ignore_ascii_case("nan") && number(it).is_none()) {
            Some(more) => {
                fault(line, format_args!("found `{}` behind the last point, expected numbers", shortened(more)))
            }
            None => Ok(()),
        }
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

    /// A table of two points and two frames.
    const PLAIN: &str = "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n100\t100\t2\t2\tmm\n\
        Frame#\tTime\ta\t\t\tb\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n1\t0.00\t1\t2\t3\t4\t5\t6\n2\t0.01\t7\t8\t9\t\t\t\n";

    fn positions() -> Vec<Option<[f64; 3]>> {
        vec![Some([1.0, 2.0, 3.0]), Some([4.0, 5.0, 6.0]), Some([7.0, 8.0, 9.0]), None]
    }

    #[track_caller]
    fn check_alike(text: &str, labels: [&str; 2], words: &str) {
        let (found, remarks) = read_with_remarks(text).unwrap();
        assert_eq!((found.positions, found.times_s), (positions(), vec![0.0, 0.01]));
        assert_eq!(found.labels, labels);
        assert_eq!(remarks.is_empty(), words.is_empty(), "{remarks:?}");
        assert!(remarks.iter().all(|it| it.contains(words)) || remarks[0].contains(words), "{remarks:?}");
    }

    #[test]
    fn tables_are_read_whatever_their_lines_and_counts() {
        check_alike(PLAIN, ["a", "b"], "");
        check_alike(&PLAIN.replace('\n', "\r\n"), ["a", "b"], "");
        check_alike(&PLAIN.replace('\n', "\r"), ["a", "b"], "");
        check_alike(&format!("\u{feff}\n\n{}", PLAIN.replace('\n', "\n\n")), ["a", "b"], "");
        // Without what ends lines and tables.
        check_alike(PLAIN.trim_end_matches('\n'), ["a", "b"], "");
        check_alike(&PLAIN.replace("9\t\t\t\n", "9\n"), ["a", "b"], "");
        check_alike(&PLAIN.replace("b\t\t\n", "b\n"), ["a", "b"], "");
        check_alike(&PLAIN.replace("a\t\t\tb\t\t", "a\tb"), ["a", "b"], "");
        // No marker declared, and rows that are full.
        let declared = |n: usize| PLAIN.replace("\t2\tmm", &format!("\t{n}\tmm"));
        check_alike(&declared(0), ["a", "b"], "the header counts 0 markers, the table names 2");
        let unnamed = declared(0).replace("\ta\t\t\tb\t\t", "").replace("\tX1\tY1\tZ1\tX2\tY2\tZ2", "");
        check_alike(&unnamed, ["unlabelled-1", "unlabelled-2"], "the points have no names");
        check_alike(&declared(9), ["a", "b"], "9 markers");
        check_alike(&PLAIN.replace("100\t2\t2", "100\t500\t2"), ["a", "b"], "500 frames, the table has 2");
    }

    /// However a file is cut, no number of it is taken that is not in the whole one.
    #[test]
    fn a_last_row_that_may_be_cut_is_left_out() {
        for n_missing in [0, 2] {
            let sample = |it: usize| [3.25, -0.5, 12.75].map(|x: f64| x * it as f64 + 0.123_45);
            let whole = Recording {
                rate_hz: 100.0,
                units: "mm".to_owned(),
                labels: vec!["a".to_owned(), "b".to_owned()],
                times_s: (0..4).map(|it| f64::from(it) / 100.0).collect(),
                positions: (0..8).map(|it| (it < 8 - n_missing).then(|| sample(it))).collect(),
            };
            let text = write(&whole, "a");
            let wanted = read(&text).unwrap();
            let first_row = text.find("\n1\t").unwrap() + 1;
            for length in first_row..text.len() {
                let (found, remarks) = read_with_remarks(&text[..length]).unwrap();
                let n = found.times_s.len();
                assert_eq!(found.times_s, wanted.times_s[..n], "{length}");
                assert_eq!(found.positions, wanted.positions[..n * 2], "{length}");
                let n_ended = text[first_row..length].matches('\n').count();
                assert!(n == n_ended || (n == 4 && length + 1 == text.len()), "{length}: {n} of {n_ended}");
                assert!(
                    n == 4 || remarks.iter().any(|it| it.contains(&format!("taken: {n}"))),
                    "{length}: {remarks:?}"
                );
            }
        }
        // An editor ended the line: fewer fields than the others, and the header counts more.
        let short = PLAIN.replace("100\t2\t2", "100\t9\t2").replace("7\t8\t9\t\t\t\n", "7\t8\n");
        let (found, remarks) = read_with_remarks(&short).unwrap();
        assert_eq!((found.times_s.len(), remarks[0].contains("line 8: found fewer fields")), (1, true), "{remarks:?}");
        // Whole tables of programs that end no last line: their digits say so; whole numbers do not.
        let plain = PLAIN.replace("7\t8\t9\t\t\t\n", "7\t8\t9\t1\t2\t34");
        assert_eq!(read(&plain).unwrap().times_s.len(), 1);
        let fixed = plain.replace("1\t2\t3\t4\t5\t6\n", "1.0\t2.0\t3.0\t4.0\t5.0\t6.0\n");
        let fixed = fixed.replace("7\t8\t9\t1\t2\t34", "7.0\t8.0\t9.0\t1.0\t2.0\t34.5");
        assert_eq!(read_with_remarks(&fixed).map(|it| (it.0.times_s.len(), it.1)), Ok((2, Vec::new())));
    }

    #[test]
    fn rates_are_told_with_all_their_digits() {
        for rate_hz in [60.0, 59.94, 65.0543, 1000.0 / 7.0, 1e-3, 4e4] {
            let recording = Recording { rate_hz, ..Recording::default() };
            assert_eq!(read(&write(&recording, "a")).unwrap().rate_hz, rate_hz);
        }
    }

    #[test]
    fn short_rows_of_many_points_ask_for_no_memory() {
        let labels = "a\t\t\t".repeat(60_000);
        let rows = "1\t0\n".repeat(60_000);
        let error = read(&PLAIN.replace("a\t\t\tb\t\t", &labels).replace("1\t0.00\t1", &format!("{rows}1\t0.00\t1")))
            .unwrap_err();
        assert!(error.to_string().contains("expected three for each of 60000 points"), "{error}");
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
