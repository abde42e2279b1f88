//! The files of a data set.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use foveate::geometry::{Distortion, Intrinsics};
use nalgebra::{Point2, Point3};
use serde_json::Value;

/// Not written in the data set; found by fitting it to the cameras, whose rates are known [Hz].
pub const RTK_HZ: f64 = 5.0;

/// One data set.
pub struct DataSet {
    /// By name, `cam0` and on.
    pub cameras: BTreeMap<String, Source>,
    /// Of the drone's receiver.
    pub path: Path3,
    /// Which picture of a camera belongs to which of another.
    pub clock_table: Option<ClockTable>,
    /// Camera places in a frame of their own, in an order of their own [m].
    pub surveyed: Option<Vec<Point3<f64>>>,
}

/// What is known of one camera.
pub struct Source {
    /// Calibrations of this model, more than one where it was done twice.
    pub lenses: Vec<Lens>,
    /// Number of the picture, and where the drone is in it [px].
    pub seen: Vec<(f64, Point2<f64>)>,
}

/// One calibration of a camera's optics.
pub struct Lens {
    /// Columns, rows [px].
    pub image_size: [u32; 2],
    /// Focal lengths and principal point.
    pub intrinsics: Intrinsics,
    /// The lens.
    pub distortion: Distortion,
    /// As the maker states it [Hz].
    pub frame_rate_hz: f64,
}

/// Positions at [`RTK_HZ`].
pub struct Path3 {
    /// East, north, up [m].
    pub rows: Vec<Point3<f64>>,
}

impl Path3 {
    /// Between the rows beside `time_s`.
    pub fn at(&self, time_s: f64) -> Option<Point3<f64>> {
        let place = time_s * RTK_HZ;
        let index = place.floor();
        if index < 0.0 {
            return None;
        }
        let (before, after) = (self.rows.get(index as usize)?, self.rows.get(index as usize + 1)?);
        Some(before + (after - before) * (place - index))
    }
}

impl DataSet {
    /// Reads `cameras.txt`, `detections`, `trajectory/rtk.txt`, the table in `README.md` and `camera-locations` of `folder`, and the optics in
    /// `../calibration`.
    pub fn read(folder: &Path) -> Result<Self, String> {
        let mut cameras = BTreeMap::new();
        let list = folder.join("cameras.txt");
        for line in text(&list)?.lines().filter(|line| !line.trim().is_empty()) {
            let expected = || format!("`{}`: found `{line}`, expected `cam0 - model`", list.display());
            let (name, model) = line.split_once('-').ok_or_else(expected)?;
            let (name, model) = (name.trim(), model.trim());
            let lenses = lenses(&folder.join("../calibration"), model)?;
            let seen = numbers(&folder.join(format!("detections/{name}.txt")), 3)?;
            let seen = seen.into_iter().filter(|it| it[1] != 0.0 || it[2] != 0.0);
            let seen = seen.map(|it| (it[0], Point2::new(it[1], it[2]))).collect();
            cameras.insert(name.to_owned(), Source { lenses, seen });
        }
        let points = |path: &Path| -> Result<Vec<Point3<f64>>, String> {
            Ok(numbers(path, 3)?.into_iter().map(|it| Point3::new(it[0], it[1], it[2])).collect())
        };
        let surveyed = folder.join("camera-locations/campos.txt");
        Ok(Self {
            clock_table: ClockTable::read(&folder.join("README.md"), cameras.len()),
            cameras,
            path: Path3 { rows: points(&folder.join("trajectory/rtk.txt"))? },
            surveyed: if surveyed.is_file() { Some(points(&surveyed)?) } else { None },
        })
    }
}

fn text(path: &Path) -> Result<String, String> {
    fs::read_to_string(path).map_err(|error| format!("`{}` cannot be read: {error}", path.display()))
}

/// Rows of `n` numbers; others, such as a header, are passed over.
fn numbers(path: &Path, n: usize) -> Result<Vec<Vec<f64>>, String> {
    let rows: Vec<Vec<f64>> = text(path)?
        .lines()
        .filter_map(|line| line.split_whitespace().map(|it| it.parse().ok()).collect::<Option<Vec<f64>>>())
        .filter(|row| row.len() == n && row.iter().all(|it| it.is_finite()))
        .collect();
    if rows.is_empty() { Err(format!("`{}` holds no row of {n} numbers", path.display())) } else { Ok(rows) }
}

/// All calibrations in the folder of `model`.
fn lenses(folder: &Path, model: &str) -> Result<Vec<Lens>, String> {
    let folder = folder.join(model);
    let listed = fs::read_dir(&folder).map_err(|error| format!("`{}` cannot be read: {error}", folder.display()))?;
    let mut paths: Vec<PathBuf> =
        listed.flatten().map(|it| it.path()).filter(|it| it.extension().is_some_and(|it| it == "json")).collect();
    paths.sort();
    paths.iter().map(|path| lens(path)).collect()
}

fn lens(path: &Path) -> Result<Lens, String> {
    let document: Value =
        serde_json::from_str(&text(path)?).map_err(|error| format!("`{}`: {error}", path.display()))?;
    let number = |value: &Value, what: &str| {
        value.as_f64().ok_or_else(|| format!("`{}`: {what} is {value}, expected a number", path.display()))
    };
    let matrix = &document["K-matrix"];
    let [fx, skew, cx] = [0, 1, 2].map(|it| number(&matrix[0][it], "K-matrix"));
    let [fy, cy] = [1, 2].map(|it| number(&matrix[1][it], "K-matrix"));
    let [k1, k2, p1, p2] = [0, 1, 2, 3].map(|it| number(&document["distCoeff"][it], "distCoeff"));
    let [width, height] = [0, 1].map(|it| number(&document["resolution"][it], "resolution"));
    Ok(Lens {
        image_size: [width? as u32, height? as u32],
        intrinsics: Intrinsics { focal: [fx?, fy?], principal: [cx?, cy?], skew: skew? },
        distortion: Distortion {
            k1: k1?,
            k2: k2?,
            p1: p1?,
            p2: p2?,
            k3: document["distCoeff"][4].as_f64().unwrap_or(0.0),
        },
        frame_rate_hz: number(&document["fps"], "fps")?,
    })
}

/// Picture i of camera `row` is picture `alpha` i + `beta` of camera `column`.
pub struct ClockTable {
    /// By row, by column.
    alpha: Vec<Vec<f64>>,
    beta: Vec<Vec<f64>>,
}

impl ClockTable {
    /// The two tables of the read-me, if they are there.
    fn read(path: &Path, n_cameras: usize) -> Option<Self> {
        let text = fs::read_to_string(path).ok()?;
        let rows = text.lines().filter_map(|line| {
            let cells: Vec<f64> = line.strip_prefix('|')?.split('|').map_while(|it| it.trim().parse().ok()).collect();
            (cells.len() == n_cameras + 1).then(|| cells[1..].to_vec())
        });
        let rows: Vec<Vec<f64>> = rows.collect();
        (rows.len() == 2 * n_cameras)
            .then(|| Self { alpha: rows[..n_cameras].to_vec(), beta: rows[n_cameras..].to_vec() })
    }

    /// alpha and beta of each camera against the first one, by least squares over all entries: each is rounded to four and two digits, and
    /// four digits of alpha alone would leave 30 ms at the end of the recording.
    pub fn solved(&self) -> Vec<(f64, f64)> {
        let n = self.alpha.len();
        // alpha[i][k] = a[k] / a[i], known to ± 0.00005: log a by weighted averages over the rows, swept until they stand.
        let mut log_alpha = vec![0.0; n];
        for _ in 0..200 {
            for k in 1..n {
                let (mut sum, mut weights) = (0.0, 0.0);
                for i in (0..n).filter(|i| *i != k) {
                    for (value, sign) in [(self.alpha[i][k], 1.0), (self.alpha[k][i], -1.0)] {
                        let weight = value * value;
                        sum += weight * (log_alpha[i] + sign * value.ln());
                        weights += weight;
                    }
                }
                log_alpha[k] = sum / weights;
            }
        }
        let alpha: Vec<f64> = log_alpha.iter().map(|it| it.exp()).collect();
        // beta[i][k] = b[k] − alpha[k]/alpha[i] b[i]
        let mut beta = vec![0.0; n];
        for _ in 0..200 {
            for k in 1..n {
                let (mut sum, mut weights) = (0.0, 0.0);
                for i in (0..n).filter(|i| *i != k) {
                    let ratio = alpha[k] / alpha[i];
                    sum += self.beta[i][k] + ratio * beta[i];
                    // beta[k][i] = b[i] − b[k] / ratio, and its rounding weighs by ratio.
                    sum += ratio.powi(-2) * ratio * (beta[i] - self.beta[k][i]);
                    weights += 1.0 + ratio.powi(-2);
                }
                beta[k] = sum / weights;
            }
        }
        alpha.into_iter().zip(beta).collect()
    }
}
