//! Cameras of single pictures, a pose each: a table of Middlebury's multi-view benchmark, a text model of COLMAP. Read only.
//!
//! | form | what | pixel (0, 0) | world → camera | lens |
//! |---|---|---|---|---|
//! | `NAME_par.txt` (S. Seitz et al., "A comparison and evaluation of multi-view stereo reconstruction algorithms", CVPR 2006) | number of pictures; a line each: `picture.png k11 … k33 r11 … r33 t1 t2 t3` | centre of the top-left pixel | x = K (R X + t) | none |
//! | `cameras.txt` and `images.txt` in a folder (COLMAP's text format) | `CAMERA_ID MODEL WIDTH HEIGHT PARAMS…`; `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, each followed by a line of points | (0.5, 0.5) is that centre | quaternion and translation | `SIMPLE_PINHOLE`, `PINHOLE`, `SIMPLE_RADIAL`, `RADIAL`, `OPENCV`; `FULL_OPENCV` with k₄ … k₆ = 0 |
//!
//! Each picture becomes a camera with the name of its file, without folder and ending. Middlebury's table holds no image size: it is read from the PNG beside it, or said ([`ImportOptions::image_size`]). Neither form says its unit.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use foveate_geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Isometry3, Matrix3, Quaternion, Translation3, UnitQuaternion, Vector3};

use super::{ImportOptions, optics};
use crate::calibration::{Calibration, LengthUnit, NamedCamera};
use crate::error::{CalibrationDiagnostic, CalibrationError};
use crate::text::read_text;

/// Files of a COLMAP model.
const CAMERAS: &str = "cameras.txt";
const IMAGES: &str = "images.txt";
/// Numbers behind a picture's name: K, R, t.
const NUMBERS: usize = 21;

/// Whether the text, which begins with `start`, is a table of Middlebury: a whole number alone, then a line of a name and 21 numbers.
pub(super) fn is_table(start: &str) -> bool {
    let mut lines = start.lines().map(str::trim).filter(|it| !it.is_empty());
    let counts = lines.next().is_some_and(|it| it.parse::<u32>().is_ok());
    let words: Vec<&str> = lines.next().map(|it| it.split_whitespace().collect()).unwrap_or_default();
    counts && words.len() == 1 + NUMBERS && words[0].parse::<f64>().is_err()
}

/// Reads such a table.
pub(super) fn load_table(path: &Path, text: &str, options: &ImportOptions) -> Result<Calibration, CalibrationError> {
    let mut lines = numbered(text);
    let (_, first) = lines.next().unwrap_or_default();
    let (mut cameras, mut faults) = (Vec::new(), Vec::new());
    for (line, text) in lines {
        let words: Vec<&str> = text.split_whitespace().collect();
        let name = words[0];
        let fault = |found: String, expected: &str| fault(path, line, Some(name), found, expected);
        let numbers: Vec<f64> = words[1..].iter().filter_map(|it| it.parse().ok()).collect();
        if numbers.len() != NUMBERS || words.len() != 1 + NUMBERS || numbers.iter().any(|it| !it.is_finite()) {
            let found = format!("{} words, {} of them numbers", words.len(), numbers.len());
            faults.push(fault(found, "the picture's name and 21 numbers: K and R row by row, t"));
            continue;
        }
        let k = Matrix3::from_row_slice(&numbers[..9]);
        let Some(intrinsics) = optics::intrinsics(&(k / k[(2, 2)])) else {
            faults
                .push(fault(format!("K {:?}", &numbers[..9]), "[fx, skew, cx; 0, fy, cy; 0, 0, 1], fx and fy above 0"));
            continue;
        };
        let rotation = match optics::rotation(&Matrix3::from_row_slice(&numbers[9..18])) {
            Ok(it) => it,
            Err(found) => {
                faults.push(fault(format!("R {found}"), "a rotation matrix"));
                continue;
            }
        };
        let Some(image_size) = options.image_size.or_else(|| size_of_png(&path.with_file_name(name))) else {
            let expected = "a PNG of that name beside the table, or `foveate convert --image-size W,H`";
            faults.push(fault("no image size".into(), expected));
            break;
        };
        let translation = Translation3::from(Vector3::from_column_slice(&numbers[18..]));
        let camera_from_world = Isometry3::from_parts(translation, rotation);
        let camera = Camera { image_size, intrinsics, distortion: Distortion::default(), camera_from_world };
        cameras.push(NamedCamera { name: stem(name), camera });
    }
    if faults.is_empty() && first.parse() != Ok(cameras.len()) {
        faults.push(fault(
            path,
            0,
            None,
            format!("{} pictures", cameras.len()),
            &format!("{first}, as the first line says"),
        ));
    }
    if !faults.is_empty() {
        return Err(CalibrationError { faults });
    }
    let origin = format!("table of pictures {}", path.display());
    Calibration::new(cameras, LengthUnit::Unknown, origin).map_err(|it| it.in_file(path))
}

/// Whether a folder holds a text model of COLMAP.
pub(super) fn is_model(folder: &Path) -> bool {
    [CAMERAS, IMAGES].iter().all(|it| folder.join(it).is_file())
}

/// Whether a folder holds a binary one alone.
pub(super) fn is_binary_model(folder: &Path) -> bool {
    !is_model(folder) && ["cameras.bin", "images.bin"].iter().all(|it| folder.join(it).is_file())
}

/// Reads such a model.
pub(super) fn load_model(folder: &Path) -> Result<Calibration, CalibrationError> {
    let paths = [CAMERAS, IMAGES].map(|it| folder.join(it));
    let [cameras, images] = [read_text(&paths[0])?, read_text(&paths[1])?];
    let lenses = lenses(&paths[0], &cameras)?;
    let (mut found, mut faults): (Vec<(String, Camera)>, Vec<_>) = (Vec::new(), Vec::new());
    // Every second line is one of points, which may be empty.
    let lines = images.lines().enumerate().filter(|it| !it.1.trim_start().starts_with('#'));
    for (line, text) in lines.skip_while(|it| it.1.trim().is_empty()).step_by(2).filter(|it| !it.1.trim().is_empty()) {
        let words: Vec<&str> = text.split_whitespace().collect();
        let numbers: Vec<f64> = words.iter().take(9).filter_map(|it| it.parse().ok()).collect();
        if words.len() < 10 || numbers.len() < 9 {
            let expected = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, and a line of points behind each";
            faults.push(fault(
                &paths[1],
                line,
                None,
                format!("{:?}", text.chars().take(60).collect::<String>()),
                expected,
            ));
            break;
        }
        let name = words[9..].join(" ");
        let turn = UnitQuaternion::try_new(Quaternion::new(numbers[1], numbers[2], numbers[3], numbers[4]), 1e-6);
        let (Some(lens), Some(turn)) = (lenses.get(words[8]), turn) else {
            let found = format!("camera {} with the quaternion {:?}", words[8], &numbers[1..5]);
            faults.push(fault(
                &paths[1],
                line,
                Some(&name),
                found,
                "one of cameras.txt, and a quaternion that is not 0",
            ));
            continue;
        };
        let translation = Translation3::new(numbers[5], numbers[6], numbers[7]);
        let camera_from_world = Isometry3::from_parts(translation, turn);
        found.push((name, Camera { camera_from_world, ..lens.clone() }));
    }
    if !faults.is_empty() {
        return Err(CalibrationError { faults });
    }
    // A folder a camera, with the same names in all of them: the folder's name is needed.
    let is_alone = |name: &str| found.iter().filter(|it| stem(&it.0) == stem(name)).count() == 1;
    let whole = |name: &str| name.rsplit_once('.').map_or(name, |it| it.0).replace(['/', '\\'], "_");
    let cameras = found.iter().map(|(name, camera)| NamedCamera {
        name: if is_alone(name) { stem(name) } else { whole(name) },
        camera: camera.clone(),
    });
    let origin = format!("COLMAP model {}", folder.display());
    Calibration::new(cameras.collect(), LengthUnit::Unknown, origin).map_err(|it| it.in_file(folder))
}

/// By number, at the origin.
fn lenses(path: &Path, text: &str) -> Result<BTreeMap<String, Camera>, CalibrationError> {
    let mut lenses = BTreeMap::new();
    for (line, text) in numbered(text) {
        let words: Vec<&str> = text.split_whitespace().collect();
        let expected = "CAMERA_ID MODEL WIDTH HEIGHT PARAMS…";
        let numbers: Option<Vec<f64>> = words.get(2..).map(|it| it.iter().filter_map(|it| it.parse().ok()).collect());
        let Some([width, height, p @ ..]) = numbers.as_deref().filter(|it| it.len() + 2 == words.len()) else {
            return Err(fault(path, line, None, format!("{text:?}"), expected).into());
        };
        let lens = |focal: [f64; 2], at: usize, distortion: Distortion| Camera {
            image_size: [*width as u32, *height as u32],
            // (0.5, 0.5) is the centre of the top-left pixel there.
            intrinsics: Intrinsics { focal, principal: [p[at] - 0.5, p[at + 1] - 0.5], skew: 0.0 },
            distortion,
            camera_from_world: Isometry3::identity(),
        };
        let none = Distortion::default();
        let camera = match (words[1], p.len()) {
            ("SIMPLE_PINHOLE", 3) => lens([p[0]; 2], 1, none),
            ("PINHOLE", 4) => lens([p[0], p[1]], 2, none),
            ("SIMPLE_RADIAL", 4) => lens([p[0]; 2], 1, Distortion { k1: p[3], ..none }),
            ("RADIAL", 5) => lens([p[0]; 2], 1, Distortion { k1: p[3], k2: p[4], ..none }),
            ("OPENCV", 8) => lens([p[0], p[1]], 2, Distortion { k1: p[4], k2: p[5], p1: p[6], p2: p[7], ..none }),
            ("FULL_OPENCV", 12) if p[9..] == [0.0; 3] => {
                lens([p[0], p[1]], 2, Distortion { k1: p[4], k2: p[5], p1: p[6], p2: p[7], k3: p[8] })
            }
            (model, n) => {
                let expected = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, or FULL_OPENCV without k4 to k6 (`colmap image_undistorter` makes pictures without distortion)";
                return Err(fault(path, line, None, format!("the model {model} with {n} parameters"), expected).into());
            }
        };
        lenses.insert(words[0].to_owned(), camera);
    }
    Ok(lenses)
}

/// Lines that say something, with their numbers from 0.
fn numbered(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.trim_start_matches('\u{feff}').lines().map(str::trim).enumerate();
    lines.filter(|(_, it)| !it.is_empty() && !it.starts_with('#'))
}

fn fault(path: &Path, line: usize, camera: Option<&str>, found: String, expected: &str) -> CalibrationDiagnostic {
    let fault = CalibrationDiagnostic::of_file(path, found, expected);
    CalibrationDiagnostic { place: Some((line + 1, 1)), camera: camera.map(str::to_owned), ..fault }
}

/// A picture's name without folder and ending.
fn stem(name: &str) -> String {
    let file = PathBuf::from(name.replace('\\', "/"));
    file.file_stem().map_or_else(|| name.to_owned(), |it| it.to_string_lossy().into_owned())
}

/// Columns and rows, by a PNG's header.
fn size_of_png(path: &Path) -> Option<[u32; 2]> {
    let mut header = [0; 24];
    std::fs::File::open(path).ok()?.read_exact(&mut header).ok()?;
    let number = |at: usize| u32::from_be_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    (header.starts_with(b"\x89PNG\r\n\x1a\n")).then(|| [number(16), number(20)])
}
