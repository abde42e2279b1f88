//! Calibrations of other programs: recognised by what is in them, read, and written.
//!
//! | format | here | pixel origin | camera looks along | world → camera | lengths | lens |
//! |---|---|---|---|---|---|---|
//! | [`Format::Foveate`] | a file | centre of the top-left pixel is (0, 0) | +Z, Y down | centre and unit quaternion `camera_from_world` | m, or unknown | k₁ k₂ p₁ p₂ k₃ |
//! | [`Format::Pose2Sim`] | a file | the same | +Z, Y down | axis times angle and translation of `camera_from_world` | m | k₁ k₂ p₁ p₂ (k₃) |
//! | [`Format::Anipose`] | a file | the same | +Z, Y down | as Pose2Sim | not said | k₁ k₂ p₁ p₂ k₃ |
//! | [`Format::Caliscope`] | a file | the same | +Z, Y down | rotation matrix or axis times angle, translation | m | k₁ k₂ p₁ p₂ k₃ |
//! | [`Format::OpenCv`] | a file a camera, or a folder of them | the same | +Z, Y down | `R` (3 × 3 or axis times angle) and `T` | not said | k₁ k₂ p₁ p₂ k₃; further ones must be 0 |
//! | [`Format::OpenCvStereo`] | a file | the same | +Z, Y down | camera 1 is the world; `R`, `T` take it to camera 2 | not said | the same |
//! | the same, of a camera and a projector (`cam_K`, `proj_K` …) | a file | the same | +Z, Y down | the camera is the world; `R`, `T` take it to the projector | not said | the same |
//! | [`Format::MultiCamSelfCal`] | a folder | (1, 1) | +Z, Y down | P = K \[R t\] | not said | k₁ k₂ p₁ p₂ |
//! | [`Format::Qualisys`] | a file | (0, 0), in 1/64 px | −Z, Y up | rows r₁ r₂ r₃ are the camera's axes; centre | mm | k₁ k₂ k₃ p₁ p₂ |
//! | Middlebury's `NAME_par.txt`, read alone | a file | (0, 0) | +Z, Y down | K \[R t\] | not said | none |
//! | COLMAP's text model, read alone | a folder | (0.5, 0.5) | +Z, Y down | quaternion and translation | not said | k₁ k₂ p₁ p₂ (k₃) |
//! | [`Format::Dlt`] | a file | (1, 1) at the bottom left (easyWand, DLTdv) or the top left ([`DltOrigin`]) | – | 11 coefficients | not said | none |
//!
//! All worlds are taken to be right-handed; MultiCamSelfCal's, which may be left-handed, is turned.

mod dlt;
mod multi_cam_self_cal;
mod opencv;
pub(crate) mod optics;
mod qualisys;
mod rings;
mod storage;
mod toml_writers;

use std::collections::BTreeMap;
use std::fmt;
use std::io::{self, ErrorKind};
use std::path::Path;

use foveate_geometry::{Camera, Intrinsics};

use crate::calibration::{Calibration, LengthUnit};
use crate::draft::Draft;
use crate::error::{CalibrationDiagnostic, CalibrationError};
use crate::text::read_text;
use crate::{calibration_file, multi_cam_self_cal as multi_cam_self_cal_reader};

/// The forms that [`Calibration::load`] knows; part of its error when none fits.
pub const CALIBRATION_FORMS: &str = "a calibration: TOML of ours ([calibration]), of Pose2Sim, Anipose or Caliscope (matrix = [[…), OpenCV \
                          (%YAML, <opencv_storage> or JSON with opencv-matrix), Qualisys (<calibration>), DLT coefficients (11 rows of numbers, a \
                          column for each camera), a table of Middlebury (NAME_par.txt), or a folder of MultiCamSelfCal (Pmatrices.dat), of COLMAP (cameras.txt, images.txt) or of OpenCV files";

/// A form of calibration that can be read and written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Our own.
    Foveate,
    /// `Calib.toml` of Pose2Sim, which is also what becomes of Qualisys' there.
    Pose2Sim,
    /// `calibration.toml` of Anipose.
    Anipose,
    /// `camera_array.toml` of Caliscope.
    Caliscope,
    /// OpenCV's FileStorage, YAML or XML, a file for each camera.
    OpenCv,
    /// OpenCV's FileStorage with the two cameras of a stereo pair.
    OpenCvStereo,
    /// The result of MultiCamSelfCal.
    MultiCamSelfCal,
    /// Qualisys Track Manager's XML.
    Qualisys,
    /// The 11 coefficients of a direct linear transformation, as easyWand and DLTdv use them.
    Dlt,
}

/// Where DLT coefficients have their pixel (1, 1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DltOrigin {
    /// The centre of the bottom-left pixel, v counted upwards: easyWand, and DLTdv up to version 7.
    #[default]
    BottomLeft,
    /// The centre of the top-left pixel, v counted downwards: MATLAB's own way.
    TopLeft,
}

/// What a file does not state itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImportOptions {
    /// Columns, rows [px], for formats that hold no image size.
    pub image_size: Option<[u32; 2]>,
    /// Columns, rows of a projector beside a camera [px].
    pub projector_size: Option<[u32; 2]>,
    /// How long a unit of the file is [m]; only for files that do not say themselves.
    pub metres_per_unit: Option<f64>,
    /// For DLT coefficients.
    pub dlt_origin: DltOrigin,
    /// Takes files that hold lenses without poses: their cameras stand at the world's origin and look along +Z.
    pub lenses_at_origin: bool,
}

/// A calibration in another form.
#[derive(Debug, Clone, PartialEq)]
pub struct Export {
    /// What to write.
    pub content: ExportContent,
    /// What the form cannot hold of this calibration but for the note on its origin, for people; empty when nothing.
    pub lost: Vec<String>,
}

/// What an [`Export`] writes.
#[derive(Debug, Clone, PartialEq)]
pub enum ExportContent {
    /// One file, with this text.
    File(String),
    /// A folder of files: names and texts.
    Folder(Vec<(String, String)>),
}

impl Format {
    /// All of them.
    pub const ALL: [Format; 9] = [
        Format::Foveate,
        Format::Pose2Sim,
        Format::Anipose,
        Format::Caliscope,
        Format::OpenCv,
        Format::OpenCvStereo,
        Format::MultiCamSelfCal,
        Format::Qualisys,
        Format::Dlt,
    ];

    /// In small letters, as on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Format::Foveate => "foveate",
            Format::Pose2Sim => "pose2sim",
            Format::Anipose => "anipose",
            Format::Caliscope => "caliscope",
            Format::OpenCv => "opencv",
            Format::OpenCvStereo => "opencv-stereo",
            Format::MultiCamSelfCal => "multicamselfcal",
            Format::Qualisys => "qualisys",
            Format::Dlt => "dlt",
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Draft {
    /// Reads a calibration as [`Calibration::load`] does; in a file of ours a camera needs no more than its `image_size_px`,
    /// and `pixel_aspect` where its pixels are not square.
    ///
    /// # Errors
    /// Every fault found, with its place.
    pub fn load(path: &Path) -> Result<Draft, CalibrationError> {
        if Draft::is_ours(path) {
            return calibration_file::parse_draft(&read_text(path)?, path);
        }
        Ok(Draft { calibration: Calibration::load(path)?, unknown: BTreeMap::new() })
    }

    /// Whether the file at `path` is of our own form.
    pub fn is_ours(path: &Path) -> bool {
        path.is_file()
            && path.extension().is_some_and(|it| it == "toml")
            && read_text(path).is_ok_and(|text| calibration_file::is_ours(&text))
    }
}

impl Calibration {
    /// Reads a file or folder of any known form, recognised by its content: see [`crate::formats`].
    ///
    /// # Errors
    /// Every fault found, with its place; when no form fits, the forms that are known.
    pub fn load(path: &Path) -> Result<Calibration, CalibrationError> {
        Calibration::load_with(path, &ImportOptions::default())
    }

    /// As [`Calibration::load`], with options for what the file does not state.
    ///
    /// # Errors
    /// Every fault found, with its place; when no format fits, the formats that are known.
    pub fn load_with(path: &Path, options: &ImportOptions) -> Result<Calibration, CalibrationError> {
        if let Some(factor) = options.metres_per_unit.filter(|it| !(it.is_finite() && *it > 0.0)) {
            let fault = CalibrationDiagnostic::of_file(path, format!("a unit of {factor} m"), "a length above 0");
            return Err(fault.into());
        }
        let calibration = read(path, options)?;
        match options.metres_per_unit {
            None => Ok(calibration),
            Some(_) if calibration.length_unit == LengthUnit::Metre => {
                let found = "lengths in metres, and another unit requested";
                Err(CalibrationDiagnostic::of_file(path, found, "a file that does not say its unit").into())
            }
            Some(factor) => Ok(calibration.in_metres(factor)),
        }
    }

    /// This calibration in the form `format`, and what that cannot hold.
    ///
    /// # Errors
    /// What cannot be said in that form at all, camera by camera.
    pub fn export(&self, format: Format) -> Result<Export, CalibrationError> {
        let mut lost = match format {
            Format::Foveate => Vec::new(),
            _ => self.only_ours(),
        };
        let content = match format {
            Format::Foveate => ExportContent::File(self.to_toml()),
            Format::Pose2Sim => ExportContent::File(toml_writers::pose2sim(self, &mut lost)),
            Format::Anipose => ExportContent::File(toml_writers::anipose(self, &mut lost)),
            Format::Caliscope => ExportContent::File(toml_writers::caliscope(self, &mut lost)?),
            Format::OpenCv => opencv::write(self, &mut lost)?,
            Format::OpenCvStereo => ExportContent::File(opencv::write_stereo(self, &mut lost)?),
            Format::MultiCamSelfCal => ExportContent::Folder(multi_cam_self_cal::write(self, &mut lost)?),
            Format::Qualisys => ExportContent::File(qualisys::write(self)?),
            Format::Dlt => ExportContent::File(dlt::write(self, &mut lost)?),
        };
        Ok(Export { content, lost })
    }

    /// The same with every length times `factor`, in metres.
    fn in_metres(mut self, factor: f64) -> Calibration {
        for camera in &mut self.cameras {
            camera.camera.camera_from_world.translation.vector *= factor;
        }
        self.uncertainties.values_mut().for_each(|it| *it = it.scaled(factor));
        self.heads.0.values_mut().for_each(|it| *it = it.clone().scaled(factor));
        if let Some(sigma) = self.provenance.as_mut().and_then(|it| it.origin.as_mut()).and_then(|it| it.sigma.as_mut())
        {
            *sigma *= factor;
        }
        self.length_unit = LengthUnit::Metre;
        self.origin += &format!("; a unit of its lengths taken for {factor} m");
        self
    }

    /// What no other form can hold, apart from the note on its origin.
    fn only_ours(&self) -> Vec<String> {
        let mut lost = Vec::new();
        if self.provenance.is_some() {
            lost.push("the provenance".to_owned());
        }
        if !self.uncertainties.is_empty() {
            lost.push(format!("the uncertainty of {} cameras", self.uncertainties.len()));
        }
        if !self.clocks.0.is_empty() {
            lost.push(format!("the clocks of {} cameras", self.clocks.0.len()));
        }
        if !self.heads.0.is_empty() {
            lost.push(format!("the heads of {} cameras", self.heads.0.len()));
        }
        lost
    }

    /// A fault of this calibration in view of a form that cannot say it.
    fn cannot(&self, camera: Option<&str>, found: impl Into<String>, expected: impl Into<String>) -> CalibrationError {
        let fault = CalibrationDiagnostic::of_file(Path::new(""), found, expected);
        CalibrationDiagnostic { camera: camera.map(str::to_owned), ..fault }.into()
    }

    /// Refuses names that no file can have.
    fn check_file_names(&self) -> Result<(), CalibrationError> {
        let bad = |name: &str| {
            name.is_empty()
                || name.starts_with('.')
                || name.chars().any(|it| "/\\:\"*?<>|".contains(it) || it.is_control())
        };
        match self.cameras.iter().find(|it| bad(&it.name)) {
            Some(it) => {
                Err(self.cannot(Some(&it.name), "a name that no file can have", "letters, digits, `-` and `_`"))
            }
            None => Ok(()),
        }
    }
}

impl Export {
    /// Writes the file or folder `out`. What is there already is left alone, unless `force`.
    ///
    /// # Errors
    /// What the file system says; [`ErrorKind::AlreadyExists`] for a file, or a folder that is not empty, without `force`.
    pub fn write(&self, out: &Path, force: bool) -> io::Result<()> {
        let taken = || io::Error::from(ErrorKind::AlreadyExists);
        match &self.content {
            ExportContent::File(_) if out.exists() && !force => Err(taken()),
            ExportContent::File(text) => std::fs::write(out, text),
            ExportContent::Folder(files) => {
                std::fs::create_dir_all(out)?;
                if !force && std::fs::read_dir(out)?.next().is_some() {
                    return Err(taken());
                }
                files.iter().try_for_each(|(name, text)| std::fs::write(out.join(name), text))
            }
        }
    }
}

/// Reads whatever `path` is.
fn read(path: &Path, options: &ImportOptions) -> Result<Calibration, CalibrationError> {
    if path.is_dir() {
        if path.join(multi_cam_self_cal_reader::MATRICES).is_file() {
            return multi_cam_self_cal_reader::load(path);
        }
        if rings::is_model(path) {
            return rings::load_model(path);
        }
        if rings::is_binary_model(path) {
            let expected = "text: `colmap model_converter --input_path IN --output_path OUT --output_type TXT`";
            return Err(CalibrationDiagnostic::of_file(path, "a binary model of COLMAP", expected).into());
        }
        return match opencv::files_of(path)? {
            files if files.is_empty() => {
                let found = "a folder without Pmatrices.dat, and without .yml, .yaml, .xml or .json files of OpenCV";
                Err(CalibrationDiagnostic::of_file(path, found, CALIBRATION_FORMS).into())
            }
            files => opencv::load_folder(path, &files, options),
        };
    }
    let text = read_text(path)?;
    let start = text.trim_start_matches('\u{feff}').trim_start();
    if start.starts_with("%YAML") || text.contains("!!opencv-matrix") || text.contains("!!opencv-nd-matrix") {
        return opencv::load(path, storage::from_yaml(&text, path)?, options);
    }
    if opencv::is_json(start) {
        return opencv::load(path, storage::from_json(start, path)?, options);
    }
    if start.starts_with('<') {
        let document = roxmltree::Document::parse(&text).map_err(|error| {
            let place = (error.pos().row as usize, error.pos().col as usize);
            let fault = CalibrationDiagnostic::of_file(path, format!("this is not XML ({error})"), "an XML file");
            CalibrationDiagnostic { place: Some(place), ..fault }
        })?;
        let root = document.root_element().tag_name().name().to_owned();
        return match root.as_str() {
            "opencv_storage" => opencv::load(path, storage::from_xml(&document), options),
            // The real-time protocol wraps it in an element named after its version.
            "calibration" => qualisys::load(path, &document),
            _ if root.starts_with("QTM_Parameters") => qualisys::load(path, &document),
            _ => {
                Err(CalibrationDiagnostic::of_file(path, format!("XML with the root <{root}>"), CALIBRATION_FORMS)
                    .into())
            }
        };
    }
    if rings::is_table(start) {
        return rings::load_table(path, &text, options);
    }
    if dlt::is_meant(start) {
        return dlt::load(path, &text, options);
    }
    // One line does not determine an array that spans several lines.
    let is_within = |line: &&str| line.starts_with(|it: char| "]+-\"'".contains(it) || it.is_ascii_digit());
    let lines = || start.lines().map(str::trim_start).filter(|it| !it.is_empty() && !is_within(it));
    let n_of_toml = lines().filter(|line| line.starts_with(['[', '#']) || line.contains('=')).count();
    let is_toml = n_of_toml > 0 && 2 * n_of_toml >= lines().count();
    if !is_toml {
        let shown: String = start.lines().next().unwrap_or_default().chars().take(40).collect();
        let found =
            if start.is_empty() { "an empty file".to_owned() } else { format!("a file that begins with {shown:?}") };
        return Err(CalibrationDiagnostic::of_file(path, found, CALIBRATION_FORMS).into());
    }
    calibration_file::parse(&text, path)
}

/// The skew of each camera, where OpenCV's functions ignore it although K holds it.
fn note_ignored_skew(calibration: &Calibration, lost: &mut Vec<String>) {
    for it in calibration.cameras.iter().filter(|it| it.camera.intrinsics.skew != 0.0) {
        let without = Camera { intrinsics: Intrinsics { skew: 0.0, ..it.camera.intrinsics }, ..it.camera.clone() };
        let (skew, apart) = (it.camera.intrinsics.skew, optics::apart_px(&it.camera, &without));
        lost.push(format!(
            "camera {:?}: the skew of {skew} px stands in the matrix, but OpenCV's functions ignore it there: up to {apart:.3} px",
            it.name
        ));
    }
}

#[cfg(test)]
mod tests;
