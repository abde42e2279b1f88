//! MultiCamSelfCal's files of a waved light: `points.dat`, three rows a camera (x, y, 1) and a column a frame, and beside it `IdMat.dat`, a row a
//! camera with 1 where the light was found.

use std::path::Path;

/// Files of more numbers are refused [–].
const MOST_NUMBERS: usize = 50_000_000;

/// The rows of the `camera`-th camera as lines of frame, x and y, 0 and 0 where it found nothing.
///
/// # Errors
/// A sentence that names the file, what was found and what was expected.
pub(crate) fn rows_of(path: &Path, camera: usize) -> Result<String, String> {
    let found_path = path.with_file_name("IdMat.dat");
    let (points, found) = (matrix(path)?, matrix(&found_path)?);
    let frames = points.first().map_or(0, Vec::len);
    if points.len() % 3 != 0 || frames == 0 {
        let (rows, path) = (points.len(), path.display());
        return Err(format!("`{path}` holds {rows} rows of {frames} numbers, expected three rows for each camera"));
    }
    if found.len() != points.len() / 3 || found.iter().any(|it| it.len() != frames) {
        return Err(format!(
            "`{}` holds {} rows of {} numbers, expected {} of {frames} beside `{}`",
            found_path.display(),
            found.len(),
            found.first().map_or(0, Vec::len),
            points.len() / 3,
            path.display()
        ));
    }
    if camera >= found.len() {
        return Err(format!(
            "`{}` has {} cameras, and this is camera {} of the calibration; expected as many cameras, in the same order",
            path.display(),
            found.len(),
            camera + 1
        ));
    }
    let mut text = String::new();
    for (frame, is_found) in found[camera].iter().enumerate() {
        let [x, y] = [0, 1].map(|row| points[3 * camera + row][frame]);
        let [x, y] = if *is_found == 0.0 || x.is_nan() || y.is_nan() { [0.0; 2] } else { [x, y] };
        text += &format!("{frame} {x} {y}\n");
    }
    Ok(text)
}

/// Numbers by row and column.
fn matrix(path: &Path) -> Result<Vec<Vec<f64>>, String> {
    let place = path.display();
    let text = std::fs::read_to_string(path).map_err(|error| format!("`{place}` cannot be read: {error}"))?;
    let mut rows: Vec<Vec<f64>> = Vec::new();
    let mut count = 0;
    for (index, line) in text.lines().enumerate().filter(|it| !it.1.trim().is_empty()) {
        let numbers = line.split_whitespace().map(|it| {
            let number = it.parse::<f64>();
            number.map_err(|_| format!("`{place}`: line {}: found `{it:.40}`, expected a number", index + 1))
        });
        let row = numbers.collect::<Result<Vec<f64>, String>>()?;
        count += row.len();
        if let Some(first) = rows.first().filter(|it| it.len() != row.len()) {
            let (line, found, expected) = (index + 1, row.len(), first.len());
            return Err(format!("`{place}`: line {line} has {found} numbers, expected {expected} as in the first"));
        }
        if count > MOST_NUMBERS {
            return Err(format!("`{place}` holds more than {MOST_NUMBERS} numbers, expected fewer"));
        }
        rows.push(row);
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(points: &str, found: &str, camera: usize) -> Result<String, String> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("points.dat"), points).unwrap();
        std::fs::write(folder.path().join("IdMat.dat"), found).unwrap();
        rows_of(&folder.path().join("points.dat"), camera)
    }

    const POINTS: &str = " 1e1 20 NaN\n 5 6 7\n 1 1 1\n 100 200 300\n 50 60 70\n 1 1 1\n";

    #[test]
    fn each_camera_has_its_own_rows() {
        assert_eq!(rows(POINTS, "1 1 1\n1 0 1\n", 0).unwrap(), "0 10 5\n1 20 6\n2 0 0\n");
        assert_eq!(rows(POINTS, "1 1 1\n1 0 1\n", 1).unwrap(), "0 100 50\n1 0 0\n2 300 70\n");
    }

    #[test]
    fn files_of_another_shape_are_named() {
        for (points, found, camera, words) in [
            ("1 2\n3 4\n", "1 1\n", 0, "2 rows of 2 numbers"),
            (POINTS, "1 1 1\n", 0, "IdMat.dat` holds 1 rows of 3 numbers, expected 2 of 3"),
            (POINTS, "1 1 1\n1 1 1\n", 2, "has 2 cameras, and this is camera 3"),
            ("1 2\n3\n", "1 1\n", 0, "line 2 has 1 numbers, expected 2"),
            ("1 2\n3 four\n", "1 1\n", 0, "line 2: found `four`"),
            ("", "", 0, "0 rows of 0 numbers"),
        ] {
            let fault = rows(points, found, camera).unwrap_err();
            assert!(fault.contains(words), "{fault}");
        }
        let fault = rows_of(Path::new("/nowhere/points.dat"), 0).unwrap_err();
        assert!(fault.contains("/nowhere/points.dat"), "{fault}");
    }
}
