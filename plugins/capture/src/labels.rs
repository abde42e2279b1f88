//! Points with names, as pose estimators export them: DeepLabCut's and SLEAP's tables, and text in our own column `label`.
//!
//! | file | recognised by | a point is |
//! |---|---|---|
//! | DeepLabCut CSV | a first line that begins with `scorer` | x, y, likelihood of a body part; with individuals, `INDIVIDUAL/PART` |
//! | SLEAP analysis CSV | a header with `frame_idx` | `NODE.x`, `NODE.y`, `NODE.score`; with several tracks, `TRACK/NODE` |
//! | our own | text in `label` | that name |
//!
//! Names become numbers by their order in the alphabet, over the files of all cameras of the rig, so that a name is one number everywhere.

use std::collections::BTreeSet;
use std::path::Path;

use foveate::diagnostics::fields::{Fields, Splitter};

/// Larger files are refused [bytes].
const LARGEST: u64 = 2 << 30;
const HDF5: &[u8] = b"\x89HDF";

/// Kind of a file, by its first lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    DeepLabCut,
    Sleap,
    /// Ours, or any other table.
    Plain,
}

/// The text of a file of points and what kind it is.
///
/// # Errors
/// A sentence: a file that cannot be read, or an HDF5 file with how to export CSV instead.
pub(crate) fn read(path: &Path) -> Result<(Kind, String), String> {
    let cannot = |error: std::io::Error| format!("`{}` cannot be opened: {error}", path.display());
    let length = std::fs::metadata(path).map_err(cannot)?.len();
    if length > LARGEST {
        return Err(format!("`{}` has {length} bytes, expected a table of at most {LARGEST}", path.display()));
    }
    let bytes = std::fs::read(path).map_err(cannot)?;
    if bytes.starts_with(HDF5) {
        return Err(format!(
            "`{}` is an HDF5 file, expected CSV: in SLEAP, File > Export Analysis CSV; in DeepLabCut, `analyze_videos(…, save_as_csv=True)` or \
             `analyze_videos_converth5_to_csv`",
            path.display()
        ));
    }
    let text = String::from_utf8_lossy(&bytes).into_owned();
    let kind = kind_of(&text);
    Ok((kind, text))
}

fn kind_of(text: &str) -> Kind {
    let first = text.trim_start_matches('\u{feff}').lines().next().unwrap_or_default();
    let mut splitter = Splitter::new(',');
    let names = splitter.split(first);
    if names.text(0) == "scorer" {
        Kind::DeepLabCut
    } else if names.iter().any(|it| it == "frame_idx") {
        Kind::Sleap
    } else {
        Kind::Plain
    }
}

/// Names of the points in a file, if it has any.
///
/// # Errors
/// As [`read`], and for a table of a known kind that lacks what it should have.
pub(crate) fn names_in(path: &Path) -> Result<BTreeSet<String>, String> {
    let (kind, text) = read(path)?;
    let of = |table: Result<Wide, String>| table.map(|it| it.points.into_iter().map(|it| it.name).collect());
    match kind {
        Kind::DeepLabCut => of(deeplabcut(&text)).map_err(|it| format!("`{}`: {it}", path.display())),
        Kind::Sleap => {
            let table = sleap(&text).map_err(|it| format!("`{}`: {it}", path.display()))?;
            let tracks = table.tracks();
            Ok(table.points.iter().flat_map(|point| tracks.iter().map(|it| joined(it, &point.name))).collect())
        }
        Kind::Plain => Ok(plain_names(&text)),
    }
}

/// Names in the column `label`.
fn plain_names(text: &str) -> BTreeSet<String> {
    let mut lines =
        text.trim_start_matches('\u{feff}').lines().filter(|it| !it.trim().is_empty() && !it.starts_with('#'));
    let mut splitter = Splitter::new(',');
    let header = splitter.split(lines.next().unwrap_or_default());
    let Some(place) = header.iter().position(|it| it == "label") else { return BTreeSet::new() };
    let mut names = BTreeSet::new();
    for line in lines {
        let name = splitter.split(line).text(place);
        if !name.is_empty() && name.parse::<f64>().is_err() && !names.contains(name) {
            names.insert(name.to_owned());
        }
    }
    names
}

/// The rows of a table of a known kind as lines of frame, x, y and number of the name; those less likely than `least` left out. Frames
/// without any point are lines with 0 and 0. `None` for other tables.
///
/// # Errors
/// A sentence with the line, what was found and what was expected.
pub(crate) fn rows_of(path: &Path, names: &[String], least: f64) -> Result<Option<String>, String> {
    let (kind, text) = read(path)?;
    let table = match kind {
        Kind::Plain => return Ok(None),
        Kind::DeepLabCut => deeplabcut(&text),
        Kind::Sleap => sleap(&text),
    };
    let in_file = |it: String| format!("`{}`: {it}", path.display());
    let table = table.map_err(in_file)?;
    let tracks = table.tracks();
    let mut lines = String::new();
    for row in &table.rows {
        let mut any = false;
        for (point, value) in table.points.iter().zip(&row.values) {
            let Some([x, y, likelihood]) = value else { continue };
            let name = if kind == Kind::Sleap {
                joined(if tracks.len() > 1 { &row.track } else { "" }, &point.name)
            } else {
                point.name.clone()
            };
            let Ok(number) = names.binary_search(&name) else { continue };
            if *likelihood >= least {
                lines += &format!("{} {x} {y} {number}\n", row.frame);
                any = true;
            }
        }
        if !any {
            lines += &format!("{} 0 0 0\n", row.frame);
        }
    }
    if lines.is_empty() { Err(in_file("holds a header and no rows".to_owned())) } else { Ok(Some(lines)) }
}

fn joined(track: &str, name: &str) -> String {
    if track.is_empty() { name.to_owned() } else { format!("{track}/{name}") }
}

/// A table with the points of a picture side by side.
struct Wide {
    points: Vec<Point>,
    rows: Vec<WideRow>,
}

struct Point {
    name: String,
    x: usize,
    y: usize,
    likelihood: Option<usize>,
}

struct WideRow {
    frame: u64,
    track: String,
    /// By point: x, y [px] and likelihood; `None` where nothing was found.
    values: Vec<Option<[f64; 3]>>,
}

impl Wide {
    /// Names of the tracks; one without a name where there is but one.
    fn tracks(&self) -> Vec<String> {
        let tracks: BTreeSet<&String> = self.rows.iter().map(|it| &it.track).collect();
        if tracks.len() > 1 { tracks.into_iter().cloned().collect() } else { vec![String::new()] }
    }

    fn read(
        points: Vec<Point>,
        lines: &[(usize, Fields)],
        frame_of: impl Fn(&Fields) -> Option<u64>,
        track: Option<usize>,
    ) -> Result<Wide, String> {
        let mut rows = Vec::with_capacity(lines.len());
        for (line, fields) in lines {
            let frame = frame_of(fields).ok_or_else(|| {
                format!("line {line}: found `{:.40}`, expected the number of a picture", fields.text(0))
            })?;
            let number = |column: usize| -> Result<f64, String> {
                match fields.text(column) {
                    "" | "nan" | "NaN" => Ok(f64::NAN),
                    text => text.parse().map_err(|_| format!("line {line}: found `{text:.40}`, expected a number")),
                }
            };
            let value = |it: &Point| -> Result<Option<[f64; 3]>, String> {
                let found = [number(it.x)?, number(it.y)?, it.likelihood.map_or(Ok(1.0), number)?];
                // A point without a score was marked by hand.
                let likelihood = if found[2].is_nan() { 1.0 } else { found[2] };
                Ok((found[0].is_finite() && found[1].is_finite()).then_some([found[0], found[1], likelihood]))
            };
            let values = points.iter().map(value).collect::<Result<_, _>>()?;
            let track = track.map_or("", |it| fields.text(it)).to_owned();
            rows.push(WideRow { frame, track, values });
        }
        Ok(Wide { points, rows })
    }
}

fn lines_of(text: &str) -> Vec<(usize, Fields)> {
    let mut splitter = Splitter::new(',');
    let lines = text.trim_start_matches('\u{feff}').lines().enumerate().filter(|it| !it.1.trim().is_empty());
    lines.map(|(index, it)| (index + 1, splitter.split(it).clone())).collect()
}

/// Rows of scorer, perhaps individuals, bodyparts and coords; then one row a picture, whose name or number comes first.
fn deeplabcut(text: &str) -> Result<Wide, String> {
    let lines = lines_of(text);
    let header = |name: &str| lines.iter().take(4).map(|it| &it.1).find(|it| it.text(0) == name);
    let lacks = |name: &str| {
        format!(
            "this is a DeepLabCut table (first line `scorer`) without the line `{name}`, expected it among the first four"
        )
    };
    let parts = header("bodyparts").ok_or_else(|| lacks("bodyparts"))?;
    let coords = header("coords").ok_or_else(|| lacks("coords"))?;
    let individuals = header("individuals");
    let mut points: Vec<Point> = Vec::new();
    for (column, coordinate) in coords.iter().enumerate() {
        let individual = individuals.map_or("", |it| it.text(column));
        let part = parts.text(column);
        if part.is_empty() {
            continue;
        }
        let name = joined(individual, part);
        let find = |points: &mut Vec<Point>| points.iter().position(|it| it.name == name);
        match coordinate {
            "x" => points.push(Point { name, x: column, y: column + 1, likelihood: None }),
            "y" => {
                if let Some(at) = find(&mut points) {
                    points[at].y = column;
                }
            }
            "likelihood" => {
                if let Some(at) = find(&mut points) {
                    points[at].likelihood = Some(column);
                }
            }
            _ => {}
        }
    }
    if points.is_empty() {
        return Err("no column `x` in the line `coords`, expected x, y, likelihood for each body part".to_owned());
    }
    let n_header = if individuals.is_some() { 4 } else { 3 };
    // Marks by hand go by the name of a picture, perhaps in folders.
    let n_index = points.iter().map(|it| it.x).min().unwrap_or(1);
    let frame_of = |fields: &Fields| {
        let place = n_index.saturating_sub(1);
        number_in(fields.text(if place < fields.len() { place } else { 0 }))
    };
    Wide::read(points, lines.get(n_header..).unwrap_or_default(), frame_of, None)
}

/// A header of `track`, `frame_idx`, `instance.score` and `NODE.x`, `NODE.y`, `NODE.score`; then one row an instance.
fn sleap(text: &str) -> Result<Wide, String> {
    let lines = lines_of(text);
    let Some(((_, header), rows)) = lines.split_first() else { return Err("is empty".to_owned()) };
    let place = |name: &str| header.iter().position(|it| it == name);
    let points: Vec<Point> = header
        .iter()
        .enumerate()
        .filter_map(|(x, name)| {
            let node = name.strip_suffix(".x")?;
            let y = place(&format!("{node}.y"))?;
            Some(Point { name: node.to_owned(), x, y, likelihood: place(&format!("{node}.score")) })
        })
        .collect();
    if points.is_empty() {
        return Err("this is a SLEAP table (column `frame_idx`) without columns NODE.x and NODE.y".to_owned());
    }
    let frame = place("frame_idx").unwrap_or_default();
    let frame_of = |fields: &Fields| fields.text(frame).parse::<f64>().ok().filter(|it| *it >= 0.0).map(|it| it as u64);
    Wide::read(points, rows, frame_of, place("track"))
}

/// The last run of digits before the extension.
fn number_in(name: &str) -> Option<u64> {
    if let Ok(number) = name.parse::<f64>() {
        return (number >= 0.0).then_some(number as u64);
    }
    let stem = name.rsplit_once('.').map_or(name, |it| it.0);
    let end = stem.rfind(|it: char| it.is_ascii_digit())? + 1;
    let start = stem[..end]
        .rfind(|it: char| !it.is_ascii_digit())
        .map_or(0, |it| it + stem[it..].chars().next().map_or(1, char::len_utf8));
    stem[start..end].parse().ok()
}

/// Pairs of names that differ in their side alone: `left_knee` and `right_knee`, `LKnee` and `RKnee`, `knee_l` and `knee_r`, by number.
pub fn mirrored_pairs(names: &[String]) -> Vec<[u32; 2]> {
    let mut pairs = Vec::new();
    for (index, name) in names.iter().enumerate() {
        for other in other_sides(name) {
            if let Some(place) = names.iter().position(|it| *it == other) {
                pairs.push([index as u32, place as u32]);
            }
        }
    }
    pairs
}

/// The possible names of the right side's counterpart of a name of the left side.
fn other_sides(name: &str) -> Vec<String> {
    let mut others: Vec<String> = [("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT")]
        .iter()
        .filter(|it| name.contains(it.0))
        .map(|it| name.replacen(it.0, it.1, 1))
        .collect();
    for (left, right) in [("l", "r"), ("L", "R")] {
        for parting in ["_", ".", "-", " "] {
            if let Some(rest) = name.strip_prefix(&format!("{left}{parting}")) {
                others.push(format!("{right}{parting}{rest}"));
            }
            if let Some(rest) = name.strip_suffix(&format!("{parting}{left}")) {
                others.push(format!("{rest}{parting}{right}"));
            }
        }
    }
    if let Some(rest) = name.strip_prefix('L')
        && rest.starts_with(|it: char| it.is_uppercase())
    {
        others.push(format!("R{rest}"));
    }
    others
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEEPLABCUT: &str = "scorer,net,net,net,net,net,net\nbodyparts,tail,tail,tail,left ear,left ear,left ear\n\
                              coords,x,y,likelihood,x,y,likelihood\n0,10.5,20,0.99,30,40,0.2\n1,11,21,0.9,,,\n2,,,,,,\n";
    const SLEAP: &str = "track,frame_idx,instance.score,nose.x,nose.y,nose.score,left_ear.x,left_ear.y,left_ear.score\n\
                         ,3,0.9,10,20,0.8,30,40,\n,4,0.9,11,21,0.1,,,\n";

    fn rows(text: &str, names: &[&str]) -> Result<Option<String>, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.csv");
        std::fs::write(&path, text).unwrap();
        let found: Vec<String> = names_in(&path)?.into_iter().collect();
        assert_eq!(found, names);
        rows_of(&path, &found, 0.6)
    }

    #[test]
    fn deeplabcut_gives_what_is_likely() {
        assert_eq!(rows(DEEPLABCUT, &["left ear", "tail"]).unwrap().unwrap(), "0 10.5 20 1\n1 11 21 1\n2 0 0 0\n");
        let several = DEEPLABCUT.replacen("bodyparts", "individuals,a,a,a,b,b,b\nbodyparts", 1);
        assert_eq!(rows(&several, &["a/tail", "b/left ear"]).unwrap().unwrap(), "0 10.5 20 0\n1 11 21 0\n2 0 0 0\n");
        let by_hand = "scorer,,,me,me\nbodyparts,,,tail,tail\ncoords,,,x,y\nlabeled-data,film,img012.png,5,6\n";
        assert_eq!(rows(by_hand, &["tail"]).unwrap().unwrap(), "12 5 6 0\n");
    }

    #[test]
    fn sleap_gives_what_is_likely_or_was_marked_by_hand() {
        assert_eq!(rows(SLEAP, &["left_ear", "nose"]).unwrap().unwrap(), "3 10 20 1\n3 30 40 0\n4 0 0 0\n");
        let tracks = "track,frame_idx,nose.x,nose.y\na,1,5,6\nb,1,7,8\n";
        assert_eq!(rows(tracks, &["a/nose", "b/nose"]).unwrap().unwrap(), "1 5 6 0\n1 7 8 1\n");
    }

    #[test]
    fn text_in_our_own_column_has_names() {
        assert_eq!(
            rows("time_s,camera,x_px,y_px,label\n0,a,1,2,knee\n0,a,1,2,hip\n0,a,1,2,\n", &["hip", "knee"]).unwrap(),
            None
        );
        assert_eq!(rows("time_s,camera,x_px,y_px,label\n0,a,1,2,3\n", &[]).unwrap(), None);
        assert_eq!(rows("0 1 2\n", &[]).unwrap(), None);
    }

    #[test]
    fn names_in_quotes_hold_commas() {
        let table = DEEPLABCUT.replace("left ear", "\"ear, left\"").replace('\n', "\r\n");
        assert_eq!(rows(&table, &["ear, left", "tail"]).unwrap().unwrap(), "0 10.5 20 1\n1 11 21 1\n2 0 0 0\n");
        let table = SLEAP.replace("left_ear.x,left_ear.y,left_ear.score", "\"a, b.x\",\"a, b.y\",\"a, b.score\"");
        assert_eq!(rows(&table, &["a, b", "nose"]).unwrap().unwrap(), "3 10 20 1\n3 30 40 0\n4 0 0 0\n");
        let ours = "\u{feff}time_s,camera,\"x, y\",label\r\n0,a,1,\"knee, left\"\r\n";
        assert_eq!(rows(ours, &["knee, left"]).unwrap(), None);
    }

    #[test]
    fn what_is_missing_is_named() {
        assert!(
            rows("scorer,a,a\nbodyparts,t,t\ncoords,x,y\n0,1,2\n1,\"2\n", &["t"])
                .unwrap()
                .unwrap()
                .ends_with("1 0 0 0\n"),
            "a short row"
        );
        assert!(
            rows("scorer,a,a\nbodyparts,t,t\ncoords,x,y\n0,1,2\n1,\"2,3\n", &["t"])
                .unwrap_err()
                .contains("line 5: found `2,3`")
        );
        assert!(rows("scorer,a\nx,b\n", &[]).unwrap_err().contains("`bodyparts`"));
        assert!(rows("scorer,a\nbodyparts,t\ncoords,q\n", &[]).unwrap_err().contains("no column `x`"));
        assert!(rows("frame_idx,a\n1,2\n", &[]).unwrap_err().contains("NODE.x"));
        assert!(rows(&DEEPLABCUT.replace("10.5", "ten"), &[]).unwrap_err().contains("line 4: found `ten`"));
        assert!(rows(&DEEPLABCUT.replace("\n1,", "\nfirst,"), &[]).unwrap_err().contains("line 5: found `first`"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.h5");
        std::fs::write(&path, b"\x89HDF\r\n\x1a\n").unwrap();
        assert!(names_in(&path).unwrap_err().contains("Export Analysis CSV"));
    }

    #[test]
    fn sides_are_paired_by_their_names() {
        let names = |list: &[&str]| list.iter().map(|it| (*it).to_owned()).collect::<Vec<_>>();
        assert_eq!(mirrored_pairs(&names(&["left_knee", "nose", "right_knee"])), [[0, 2]]);
        assert_eq!(mirrored_pairs(&names(&["LKnee", "Lamp", "RKnee", "amp"])), [[0, 2]]);
        assert_eq!(mirrored_pairs(&names(&["ear_l", "ear_r", "l.eye", "r.eye"])), [[0, 1], [2, 3]]);
        assert_eq!(mirrored_pairs(&names(&["lip", "rip"])), Vec::<[u32; 2]>::new());
    }
}
