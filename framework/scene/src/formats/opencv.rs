//! OpenCV's FileStorage (YAML, XML, JSON; versions 3 to 5): a camera a file, or a stereo pair in one.
//!
//! OpenCV fixes no names; these are known, after its samples `calibration`, `stereo_calib` and common usage:
//!
//! | what | one camera | pair |
//! |---|---|---|
//! | K, 3 × 3 | `camera_matrix`, `CameraMatrix`, `cameraMatrix`, `K`, `M` … | the same with 1 and 2 |
//! | lens | `distortion_coefficients`, `DistortionCoeffs`, `distCoeffs`, `D` … | the same with 1 and 2 |
//! | rotation, 3 × 3 or axis times angle | `R`, `Rotation`, `rvec` …: `camera_from_world` | `R`: camera 2 from camera 1 |
//! | translation | `T`, `Translation`, `tvec` … | `T` |
//! | image | `image_width` and `image_height`, or `image_size`, `imageSize` | the same |
//!
//! A camera and a projector are a pair, too: `cam_K`, `cam_kc`, `proj_K`, `proj_kc`, `R`, `T` of Brown University's scanner (Moreno and Taubin) and what is
//! written after it, `cam_int`, `cam_dist`, `proj_int`, `proj_dist`, `rotation`, `translation` of others; any of the names above with `cam_` and `proj_`, or `camera_` and `projector_`, before them.
//! They become `camera` and `projector`. `img_shape` (rows, columns) is the camera's picture. Other sizes are seldom there: [`ImportOptions::image_size`] and [`ImportOptions::projector_size`] say them.
//!
//! Where a pair's `R` and `T` are missing, as in the sample's `intrinsics.yml`, they are read from `extrinsics` beside it.
//! Our own exports add `camera_name` and `length_unit`, which other readers pass over.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use foveate_geometry::{Camera, Distortion};
use nalgebra::{DMatrix, Isometry3, Matrix3, UnitQuaternion, Vector3};

use super::storage::{Entry, Storage, Value, from_json, from_xml, from_yaml};
use super::{ExportContent, ImportOptions, note_ignored_skew, optics};
use crate::calibration::{Calibration, LengthUnit, NamedCamera};
use crate::error::{CalibrationDiagnostic, CalibrationError, sort_by_place};
use crate::text::{quoted, read_text};

const MATRIX: [&str; 9] =
    ["camera_matrix", "CameraMatrix", "cameraMatrix", "Camera_Matrix", "K", "M", "intrinsic", "int", "matrix"];
const LENS: [&str; 11] = [
    "distortion_coefficients",
    "DistortionCoeffs",
    "distCoeffs",
    "dist_coeffs",
    "Distortion_Coefficients",
    "distortionCoefficients",
    "dist_coeff",
    "distortion",
    "D",
    "kc",
    "dist",
];
/// What stands before the names of a camera and a projector.
const CAMERA_AND_PROJECTOR: [&str; 2] = ["cam", "proj"];
/// The same in full: `camera_matrix` alone is that of one camera.
const IN_FULL: [&str; 2] = ["camera", "projector"];
// `roration` is what `kamino410/procam-calibration` writes.
const TURN: [&str; 7] = ["R", "Rotation", "rotation", "rotation_matrix", "rvec", "rotationMatrix", "roration"];
const SHIFT: [&str; 6] = ["T", "Translation", "translation", "translation_vector", "tvec", "translationVector"];
const SIZE: [&str; 4] = ["image_size", "imageSize", "ImageSize", "size"];
/// The camera's picture as NumPy has it: rows, columns.
const SHAPE: &str = "img_shape";
const ENDINGS: [&str; 4] = ["yml", "yaml", "xml", "json"];

/// Files of the folder that may be OpenCV's, in the order of their names.
pub(crate) fn files_of(folder: &Path) -> Result<Vec<PathBuf>, CalibrationDiagnostic> {
    let unreadable =
        |error: std::io::Error| CalibrationDiagnostic::of_file(folder, format!("cannot be read ({error})"), "a folder");
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let fits = path.extension().is_some_and(|it| ENDINGS.iter().any(|ending| it.eq_ignore_ascii_case(ending)));
        // JSON is written by all kinds of programs.
        let is_foreign = path.extension().is_some_and(|it| it.eq_ignore_ascii_case("json"))
            && !fs::read_to_string(&path).is_ok_and(|it| is_json(&it));
        files.extend((fits && path.is_file() && !is_foreign).then_some(path));
    }
    files.sort();
    Ok(files)
}

/// One camera from each of `files`.
pub(crate) fn load_folder(
    folder: &Path,
    files: &[PathBuf],
    options: &ImportOptions,
) -> Result<Calibration, CalibrationError> {
    let (mut cameras, mut faults, mut units) = (Vec::new(), Vec::new(), Vec::new());
    for file in files {
        match open(file).and_then(|storage| load(file, storage, options)) {
            Ok(calibration) => {
                units.push(calibration.length_unit);
                cameras.extend(calibration.cameras);
            }
            Err(error) => faults.extend(error.faults),
        }
    }
    if !faults.is_empty() {
        return Err(CalibrationError { faults });
    }
    let in_metres = units.iter().all(|it| *it == LengthUnit::Metre);
    if !in_metres && units.contains(&LengthUnit::Metre) {
        let found = "files in metres beside files of unknown unit";
        return Err(CalibrationDiagnostic::of_file(folder, found, "one unit for all cameras").into());
    }
    let unit = if in_metres { LengthUnit::Metre } else { LengthUnit::Unknown };
    Calibration::new(cameras, unit, format!("OpenCV files in {}", folder.display())).map_err(|it| it.in_file(folder))
}

/// Whether a text is OpenCV's JSON.
pub(crate) fn is_json(text: &str) -> bool {
    text.trim_start().starts_with('{') && text.contains("\"opencv-")
}

fn open(path: &Path) -> Result<Storage, CalibrationError> {
    let text = read_text(path)?;
    if text.trim_start().starts_with('{') {
        return Ok(from_json(&text, path)?);
    }
    if !text.trim_start().starts_with('<') {
        return Ok(from_yaml(&text, path)?);
    }
    let document = roxmltree::Document::parse(&text)
        .map_err(|error| CalibrationDiagnostic::of_file(path, format!("this is not XML ({error})"), "an XML file"))?;
    Ok(from_xml(&document))
}

/// The camera, or pair of cameras, in `storage`, which was read from `path`.
pub(crate) fn load(path: &Path, storage: Storage, options: &ImportOptions) -> Result<Calibration, CalibrationError> {
    let unit = match storage.get(&["length_unit"]).map(|it| &it.value) {
        Some(Value::Scalar(unit)) if unit == "m" => LengthUnit::Metre,
        _ => LengthUnit::Unknown,
    };
    let mut reader = Reader { path, storage: &storage, options, camera: None, faults: Vec::new() };
    let has = |suffix: &str| reader.entry(&MATRIX, suffix).is_some();
    let (is_pair, is_projector) = (has("1"), has("cam") && has("proj"));
    let cameras = match (is_projector, is_pair) {
        (true, _) => reader.pair(CAMERA_AND_PROJECTOR, ["camera", "projector"]),
        _ if has("cam") || has("proj") => {
            let (found, lacking) = if has("cam") { ("a camera", "proj_K") } else { ("a projector", "cam_K") };
            let found = format!("the lens of {found} alone, of a camera and a projector (no {lacking})");
            reader.report(None, found, "cam_K and proj_K (or cam_int and proj_int), with R and T")
        }
        (_, true) => reader.pair(["1", "2"], ["cam1", "cam2"]),
        _ => reader.single().map(|it| vec![it]),
    };
    let mut faults = reader.faults;
    match cameras {
        Some(cameras) if faults.is_empty() => {
            let origin = format!("OpenCV calibration {}", path.display());
            Calibration::new(cameras, unit, origin).map_err(|it| it.in_file(path))
        }
        _ => {
            sort_by_place(&mut faults);
            Err(CalibrationError { faults })
        }
    }
}

struct Reader<'a> {
    path: &'a Path,
    storage: &'a Storage,
    options: &'a ImportOptions,
    camera: Option<String>,
    faults: Vec<CalibrationDiagnostic>,
}

impl<'a> Reader<'a> {
    fn report<T>(&mut self, entry: Option<&Entry>, found: String, expected: &str) -> Option<T> {
        let fault = CalibrationDiagnostic::of_file(self.path, found, expected);
        self.faults.push(CalibrationDiagnostic {
            place: entry.map(|it| it.place),
            camera: self.camera.clone(),
            ..fault
        });
        None
    }

    fn entry(&self, names: &[&str], suffix: &str) -> Option<&'a Entry> {
        let with = |joint: &str| {
            let names: Vec<String> = names.iter().map(|it| format!("{it}{joint}{suffix}")).collect();
            self.storage.get(&names.iter().map(String::as_str).collect::<Vec<_>>())
        };
        if let Some(which) = CAMERA_AND_PROJECTOR.iter().position(|it| *it == suffix) {
            let after = |prefix: &str, names: &[&str]| {
                let names: Vec<String> = names.iter().map(|it| format!("{prefix}_{it}")).collect();
                self.storage.get(&names.iter().map(String::as_str).collect::<Vec<_>>())
            };
            let is_in_full = || after(IN_FULL[1], &MATRIX).is_some();
            return after(suffix, names).or_else(|| after(IN_FULL[which], names).filter(|_| is_in_full()));
        }
        with("").or_else(|| with("_"))
    }

    fn single(&mut self) -> Option<NamedCamera> {
        let stem = self.path.file_stem().map_or("camera".into(), |it| it.to_string_lossy().into_owned());
        let name = match self.storage.get(&["camera_name"]).map(|it| &it.value) {
            Some(Value::Scalar(name)) if !name.is_empty() => name.clone(),
            _ => stem,
        };
        self.camera = Some(name.clone());
        let camera = self.lens("");
        let (turn, shift) = (self.entry(&TURN, ""), self.entry(&SHIFT, ""));
        let pose = match (turn, shift) {
            (Some(turn), Some(shift)) => self.pose(turn, shift),
            _ if self.options.lenses_at_origin => Some(Isometry3::identity()),
            _ => self.report(
                None,
                "a lens without a pose (no R and T)".into(),
                "both; `foveate convert --lenses` takes the lens alone, its camera at the origin",
            ),
        };
        Some(NamedCamera { name, camera: Camera { camera_from_world: pose?, ..camera? } })
    }

    fn pair(&mut self, suffixes: [&str; 2], names: [&str; 2]) -> Option<Vec<NamedCamera>> {
        let (mut cameras, beside) = (Vec::new(), self.beside());
        for (suffix, name) in suffixes.into_iter().zip(names) {
            self.camera = Some(name.to_owned());
            let camera = self.lens(suffix);
            cameras.extend(camera.map(|camera| NamedCamera { name: name.to_owned(), camera }));
        }
        let of = |names: &[&str]| self.entry(names, "").or_else(|| beside.as_ref()?.get(names));
        let pose = match (of(&TURN), of(&SHIFT)) {
            (Some(turn), Some(shift)) => self.pose(turn, shift),
            _ => self.report(
                None,
                "a pair without R and T, and no file `extrinsics` beside it that has them".into(),
                "R and T, which take camera 1 to camera 2",
            ),
        };
        let pose = pose?;
        cameras.get_mut(1)?.camera.camera_from_world = pose;
        Some(cameras)
    }

    /// The file `extrinsics` beside this one, if it can be read.
    fn beside(&self) -> Option<Storage> {
        let files = ENDINGS.iter().map(|ending| self.path.with_file_name(format!("extrinsics.{ending}")));
        files.filter(|it| it.is_file()).find_map(|it| open(&it).ok())
    }

    /// The camera at the origin.
    fn lens(&mut self, suffix: &str) -> Option<Camera> {
        if let Some(entry) = self.storage.get(&["fisheye_model"])
            && !matches!(&entry.value, Value::Scalar(it) if it == "0")
        {
            return self.report(Some(entry), "fisheye_model is set".into(), "OpenCV's pinhole model (0)");
        }
        if let Some(entry) = self.entry(&["xi"], suffix) {
            return self.report(Some(entry), "xi, of OpenCV's omnidirectional model".into(), "its pinhole model");
        }
        let size = self.size(suffix);
        let expected = "3 x 3 numbers [fx, skew, cx; 0, fy, cy; 0, 0, 1], fx and fy above 0";
        let intrinsics = match self.entry(&MATRIX, suffix) {
            None => self.report(None, format!("no camera_matrix{suffix}"), expected),
            Some(entry) => self.numbers(entry).and_then(|k| {
                let square = (k.shape() == (3, 3)).then(|| Matrix3::from_fn(|row, column| k[(row, column)]));
                match square.as_ref().and_then(optics::intrinsics) {
                    Some(it) => Some(it),
                    None => self.report(Some(entry), format!("{} is {}", entry.key, shown(&k)), expected),
                }
            }),
        };
        let distortion = match self.entry(&LENS, suffix) {
            None => Some(Distortion::default()),
            Some(entry) => {
                let list: Option<Vec<f64>> = self.numbers(entry).map(|it| it.transpose().iter().copied().collect());
                match optics::distortion(&list?) {
                    Ok(lens) => Some(lens),
                    Err(found) => self.report(
                        Some(entry),
                        format!("{} {found}", entry.key),
                        "k1, k2, p1, p2 and perhaps k3; further ones 0",
                    ),
                }
            }
        };
        Some(Camera {
            image_size: size?,
            intrinsics: intrinsics?,
            distortion: distortion?,
            camera_from_world: Isometry3::identity(),
        })
    }

    fn size(&mut self, suffix: &str) -> Option<[u32; 2]> {
        let expected = "columns and rows, whole numbers from 1 to 65535";
        let whole =
            |text: &str| text.parse::<f64>().ok().filter(|it| it.fract() == 0.0 && (1.0..=65535.0).contains(it));
        let is_projector = suffix == CAMERA_AND_PROJECTOR[1];
        let both =
            self.storage.get(&["image_width"]).zip(self.storage.get(&["image_height"])).filter(|_| !is_projector);
        let listed = self.entry(&SIZE, suffix).or_else(|| self.entry(&SIZE, "").filter(|_| !is_projector));
        let shape = self.storage.get(&[SHAPE]).filter(|_| !is_projector && listed.is_none());
        let is_shape = shape.is_some();
        let listed = listed.or(shape);
        let (entry, texts) = match (both, listed.map(|it| (it, &it.value))) {
            (Some((width, height)), _) => match (&width.value, &height.value) {
                (Value::Scalar(width_px), Value::Scalar(height_px)) => (width, vec![width_px, height_px]),
                _ => return self.report(Some(width), "image_width or image_height is no number".into(), expected),
            },
            (None, Some((entry, Value::List(list) | Value::Matrix { numbers: list, .. }))) => {
                let forward = list.iter();
                (entry, if is_shape { forward.rev().collect() } else { forward.collect() })
            }
            (None, Some((entry, _))) => return self.report(Some(entry), "a size that is no list".into(), expected),
            (None, None) => {
                let of_projector = self.options.projector_size;
                let given = match suffix {
                    _ if is_projector => of_projector,
                    // The second of a pair may be a projector.
                    "2" => of_projector.or(self.options.image_size),
                    _ => self.options.image_size,
                };
                return given.or_else(|| {
                    if is_projector {
                        let found = "no size of the projector (proj_size)".into();
                        return self.report(None, found, "one; `foveate convert --projector-size W,H` says it");
                    }
                    self.report(
                        None,
                        "no image size (image_width, image_height or image_size)".into(),
                        "one; `foveate convert --image-size W,H` says it",
                    )
                });
            }
        };
        match texts.as_slice() {
            [width, height] => match (whole(width), whole(height)) {
                (Some(width), Some(height)) => Some([width as u32, height as u32]),
                _ => self.report(Some(entry), format!("an image of {width} x {height} px"), expected),
            },
            _ => self.report(Some(entry), format!("{} numbers for the image size", texts.len()), expected),
        }
    }

    fn pose(&mut self, turn: &Entry, shift: &Entry) -> Option<Isometry3<f64>> {
        let r = self.numbers(turn).and_then(|r| match (r.shape(), r.len()) {
            ((3, 3), _) => match optics::rotation(&Matrix3::from_fn(|row, column| r[(row, column)])) {
                Ok(it) => Some(it),
                Err(found) => self.report(Some(turn), format!("{} {found}", turn.key), "a rotation matrix"),
            },
            (_, 3) => Some(UnitQuaternion::from_scaled_axis(Vector3::new(r[0], r[1], r[2]))),
            _ => self.report(Some(turn), format!("{} is {}", turn.key, shown(&r)), "3 x 3 or 3 x 1 numbers"),
        });
        let t = self.numbers(shift).and_then(|t| match t.len() {
            3 => Some(Vector3::new(t[0], t[1], t[2])),
            _ => self.report(Some(shift), format!("{} is {}", shift.key, shown(&t)), "3 numbers"),
        });
        Some(Isometry3::from_parts(t?.into(), r?))
    }

    /// The matrix or list of `entry`; a list is a column.
    fn numbers(&mut self, entry: &Entry) -> Option<DMatrix<f64>> {
        let (rows, columns, texts) = match &entry.value {
            Value::Matrix { rows, columns, numbers } => (rows.parse().ok(), columns.parse().ok(), numbers.as_slice()),
            Value::List(list) => (Some(list.len()), Some(1), list.as_slice()),
            Value::Scalar(text) => {
                let found = format!("{} is {text:?}", entry.key);
                return self.report(Some(entry), found, "a matrix");
            }
        };
        let (Some(rows), Some(columns)): (Option<usize>, Option<usize>) = (rows, columns) else {
            return self.report(Some(entry), format!("{} without rows and cols", entry.key), "both, whole numbers");
        };
        if rows.checked_mul(columns) != Some(texts.len()) {
            let found = format!("{} of {rows} x {columns} holds {} numbers", entry.key, texts.len());
            return self.report(Some(entry), found, "as many as rows times cols");
        }
        let mut numbers = Vec::new();
        for text in texts {
            match text.parse::<f64>().ok().filter(|it| it.is_finite()) {
                Some(number) => numbers.push(number),
                None => return self.report(Some(entry), format!("{} holds {text}", entry.key), "finite numbers"),
            }
        }
        Some(DMatrix::from_row_slice(rows, columns, &numbers))
    }
}

fn shown(matrix: &DMatrix<f64>) -> String {
    let numbers: Vec<String> = matrix.transpose().iter().take(12).map(|it| format!("{it}")).collect();
    format!("{} x {} [{}]", matrix.nrows(), matrix.ncols(), numbers.join(", "))
}

/// A file for the one camera there is, or a folder with one for each.
pub(crate) fn write(calibration: &Calibration, lost: &mut Vec<String>) -> Result<ExportContent, CalibrationError> {
    note_ignored_skew(calibration, lost);
    let text_of = |it: &NamedCamera| {
        let pose = &it.camera.camera_from_world;
        let mut text = header(calibration);
        if !it.name.chars().any(char::is_control) {
            let _ = writeln!(text, "camera_name: {}", quoted(&it.name)); // writing to a String cannot fail
        }
        text + &size_of(&it.camera)
            + &lens_of(&it.camera, ["camera_matrix", "distortion_coefficients"])
            + &pose_of(pose)
    };
    if let [only] = calibration.cameras.as_slice() {
        return Ok(ExportContent::File(text_of(only)));
    }
    calibration.check_file_names()?;
    Ok(ExportContent::Folder(calibration.cameras.iter().map(|it| (format!("{}.yml", it.name), text_of(it))).collect()))
}

/// Both cameras in the names of OpenCV's `stereo_calib`.
pub(crate) fn write_stereo(calibration: &Calibration, lost: &mut Vec<String>) -> Result<String, CalibrationError> {
    let [one, two] = calibration.cameras.as_slice() else {
        let found = format!("there are {} cameras", calibration.cameras.len());
        return Err(calibration.cannot(None, found, "the 2 of a stereo pair"));
    };
    if one.camera.image_size != two.camera.image_size {
        let found = format!("images of {:?} and {:?} px", one.camera.image_size, two.camera.image_size);
        return Err(calibration.cannot(None, found, "one size for both cameras of a stereo pair"));
    }
    note_ignored_skew(calibration, lost);
    if one.camera.camera_from_world != Isometry3::identity() {
        lost.push(format!("the place of the pair: camera {:?} becomes the world", one.name));
    }
    if [&one.name, &two.name] != ["cam1", "cam2"] {
        lost.push(format!("the names {:?} and {:?}: they become cam1 and cam2", one.name, two.name));
    }
    let two_from_one = two.camera.camera_from_world * one.camera.camera_from_world.inverse();
    Ok(header(calibration)
        + &size_of(&one.camera)
        + &lens_of(&one.camera, ["M1", "D1"])
        + &lens_of(&two.camera, ["M2", "D2"])
        + &pose_of(&two_from_one))
}

fn header(calibration: &Calibration) -> String {
    let unit = match calibration.length_unit {
        LengthUnit::Metre => "m",
        LengthUnit::Unknown => "unknown",
    };
    format!("%YAML:1.0\n---\nlength_unit: \"{unit}\"\n")
}

fn size_of(camera: &Camera) -> String {
    format!("image_width: {}\nimage_height: {}\n", camera.image_size[0], camera.image_size[1])
}

fn lens_of(camera: &Camera, [matrix, lens]: [&str; 2]) -> String {
    let Distortion { k1, k2, p1, p2, k3 } = camera.distortion;
    let k = optics::matrix(&camera.intrinsics);
    matrix_text(matrix, 3, k.transpose().as_slice()) + &matrix_text(lens, 5, &[k1, k2, p1, p2, k3])
}

fn pose_of(pose: &Isometry3<f64>) -> String {
    let r = pose.rotation.to_rotation_matrix();
    matrix_text("R", 3, r.matrix().transpose().as_slice()) + &matrix_text("T", 3, pose.translation.vector.as_slice())
}

fn matrix_text(name: &str, rows: usize, numbers: &[f64]) -> String {
    let columns = numbers.len() / rows;
    let numbers: Vec<String> = numbers.iter().map(|it| format!("{it:?}")).collect();
    format!(
        "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {} ]\n",
        numbers.join(", ")
    )
}
