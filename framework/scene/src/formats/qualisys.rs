//! Qualisys Track Manager's calibration in XML (`.qca.txt`, and the answer of its real-time protocol).
//!
//! | there | unit | here |
//! |---|---|---|
//! | `fov_video` left, top, right, bottom | px, both ends counted | image size; left and top move the principal point |
//! | `focalLengthU`, `…V`, `centerPointU`, `…V`, `skew` | 1/64 px | px |
//! | `radialDistortion1…3`, `tangentalDistortion1`, `…2` | – | k₁ k₂ k₃, p₁ p₂ |
//! | `r11 … r33` | – | rows: the camera's right, up and backward in the world; here Y is down and Z forward |
//! | `x`, `y`, `z` | mm | the camera's centre [m] |
//!
//! Pose2Sim's own conversion divides the distortion by 64 as well, which the coefficients, being those of normalised coordinates,
//! do not confirm: files that it made of a Qualisys calibration hold a lens 64 times too weak. The makers do not say where in a
//! pixel (0, 0) is; as Pose2Sim does, it is taken for the centre.

use std::fmt::Write as _;
use std::path::Path;

use foveate_geometry::{Camera, Distortion, Intrinsics};
use foveate_plot::text::escaped;
use nalgebra::{Isometry3, Matrix3, Vector3};
use roxmltree::{Document, Node};

use super::optics;
use crate::calibration::{Calibration, LengthUnit, NamedCamera};
use crate::error::{CalibrationDiagnostic, CalibrationError};

/// Parts of a pixel in which intrinsics are counted.
const SUBPIXELS: f64 = 64.0;
const MM_PER_M: f64 = 1e3;

/// Reads the XML.
pub(crate) fn load(path: &Path, document: &Document<'_>) -> Result<Calibration, CalibrationError> {
    let mut reader = Reader { path, document, camera: None, faults: Vec::new() };
    let mut cameras = Vec::new();
    for node in document.descendants().filter(|it| it.has_tag_name("camera")) {
        let name = node.attribute("serial").unwrap_or_default();
        reader.camera = Some(name.to_owned());
        if name.is_empty() {
            reader.report(node, "a camera without serial".into(), "one for each camera");
        }
        cameras.extend(reader.camera(node).map(|camera| NamedCamera { name: name.to_owned(), camera }));
    }
    if !reader.faults.is_empty() {
        return Err(CalibrationError { faults: reader.faults });
    }
    let origin = format!("Qualisys calibration {}", path.display());
    Calibration::new(cameras, LengthUnit::Metre, origin).map_err(|it| it.in_file(path))
}

struct Reader<'a, 'x> {
    path: &'a Path,
    document: &'a Document<'x>,
    camera: Option<String>,
    faults: Vec<CalibrationDiagnostic>,
}

impl Reader<'_, '_> {
    fn report(&mut self, node: Node<'_, '_>, found: String, expected: &str) {
        let at = self.document.text_pos_at(node.range().start);
        let fault = CalibrationDiagnostic::of_file(self.path, found, expected);
        let place = Some((at.row as usize, at.col as usize));
        self.faults.push(CalibrationDiagnostic { place, camera: self.camera.clone(), ..fault });
    }

    /// Reads everything before it returns an error, so that all faults are found.
    fn camera(&mut self, node: Node<'_, '_>) -> Option<Camera> {
        let view = self.numbers(node, "fov_video", ["left", "top", "right", "bottom"]);
        let inner =
            self.numbers(node, "intrinsic", ["focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew"]);
        let lens = self.numbers(
            node,
            "intrinsic",
            [
                "radialDistortion1",
                "radialDistortion2",
                "radialDistortion3",
                "tangentalDistortion1",
                "tangentalDistortion2",
            ],
        );
        let place = self.numbers(node, "transform", ["x", "y", "z"]);
        let axes = self.numbers(node, "transform", ["r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33"]);
        let [left, top, right, bottom] = view?;
        let size = [right - left + 1.0, bottom - top + 1.0];
        if !size.iter().all(|it| it.fract() == 0.0 && (1.0..=65535.0).contains(it)) {
            let found = format!("a field of view of {} x {} px", size[0], size[1]);
            self.report(node, found, "whole numbers from 1 to 65535");
            return None;
        }
        let [fu, fv, u, v, skew] = inner?.map(|it| it / SUBPIXELS);
        if fu <= 0.0 || fv <= 0.0 {
            self.report(node, format!("focal lengths of {fu} and {fv} px"), "two numbers above 0");
            return None;
        }
        let [k1, k2, k3, p1, p2] = lens?;
        // Y and Z point the other way there.
        let turned = Matrix3::from_row_slice(&axes?);
        let turn = match optics::rotation(&(Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0)) * turned)) {
            Ok(turn) => turn,
            Err(found) => {
                self.report(node, format!("the transform {found}"), "a rotation matrix");
                return None;
            }
        };
        let centre = Vector3::from(place?) / MM_PER_M;
        Some(Camera {
            image_size: size.map(|it| it as u32),
            intrinsics: Intrinsics { focal: [fu, fv], principal: [u - left, v - top], skew },
            distortion: Distortion { k1, k2, p1, p2, k3 },
            camera_from_world: Isometry3::from_parts((turn * -centre).into(), turn),
        })
    }

    /// Attributes of the element `tag` of a camera.
    fn numbers<const N: usize>(&mut self, camera: Node<'_, '_>, tag: &str, keys: [&str; N]) -> Option<[f64; N]> {
        let Some(node) = camera.children().find(|it| it.has_tag_name(tag)) else {
            self.report(camera, format!("a camera without <{tag}>"), "one in each camera");
            return None;
        };
        let mut numbers = [0.0; N];
        let mut complete = true;
        for (number, key) in numbers.iter_mut().zip(keys) {
            let text = node.attribute(key);
            match text.and_then(|it| it.trim().parse::<f64>().ok()).filter(|it| it.is_finite()) {
                Some(found) => *number = found,
                None => {
                    let found = text.map_or(format!("{tag} without {key}"), |it| format!("{key} is {it:?}"));
                    self.report(node, found, "a finite number");
                    complete = false;
                }
            }
        }
        complete.then_some(numbers)
    }
}

/// The XML that [`load`] reads; what other programs ask of it besides is filled in as far as it can be.
pub(crate) fn write(calibration: &Calibration) -> Result<String, CalibrationError> {
    if calibration.length_unit == LengthUnit::Unknown {
        let found = "lengths of unknown unit";
        return Err(calibration.cannot(None, found, "metres, to be written as millimetres (--metres-per-unit)"));
    }
    let mut text =
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<calibration type=\"regular\" source=\"foveate\">\n  <cameras>\n"
            .to_owned();
    for NamedCamera { name, camera } in &calibration.cameras {
        if name.is_empty() || name.chars().any(char::is_control) {
            return Err(calibration.cannot(Some(name), "a name that XML cannot hold", "printable characters"));
        }
        let Camera { image_size, intrinsics, distortion: lens, camera_from_world } = camera;
        let ([fu, fv], [u, v]) =
            (intrinsics.focal.map(|it| it * SUBPIXELS), intrinsics.principal.map(|it| it * SUBPIXELS));
        let ([right, bottom], skew) = (image_size.map(|it| it - 1), intrinsics.skew * SUBPIXELS);
        let (centre, r) = (camera.centre() * MM_PER_M, camera_from_world.rotation.to_rotation_matrix());
        // Writing to a String cannot fail.
        let _ = writeln!(text, "    <camera active=\"1\" serial=\"{}\" viewrotation=\"0\">", escaped(name));
        for tag in ["fov_marker", "fov_marker_max", "fov_video", "fov_video_max"] {
            let _ = writeln!(text, "      <{tag} left=\"0\" top=\"0\" right=\"{right}\" bottom=\"{bottom}\"/>");
        }
        let _ = write!(text, "      <transform x=\"{:?}\" y=\"{:?}\" z=\"{:?}\"", centre.x, centre.y, centre.z);
        for (row, sign) in [(0, 1.0), (1, -1.0), (2, -1.0)] {
            for column in 0..3 {
                let _ = write!(text, " r{}{}=\"{:?}\"", row + 1, column + 1, sign * r.matrix()[(row, column)]);
            }
        }
        let [max_u, max_v] = image_size.map(|it| f64::from(it) * SUBPIXELS - 1.0);
        let Distortion { k1, k2, p1, p2, k3 } = lens;
        let _ = writeln!(
            text,
            "/>\n      <intrinsic sensorMinU=\"0\" sensorMaxU=\"{max_u}\" sensorMinV=\"0\" sensorMaxV=\"{max_v}\" \
             focalLengthU=\"{fu:?}\" focalLengthV=\"{fv:?}\" centerPointU=\"{u:?}\" centerPointV=\"{v:?}\" \
             skew=\"{skew:?}\" radialDistortion1=\"{k1:?}\" radialDistortion2=\"{k2:?}\" radialDistortion3=\"{k3:?}\" \
             tangentalDistortion1=\"{p1:?}\" tangentalDistortion2=\"{p2:?}\"/>\n    </camera>"
        );
    }
    Ok(text + "  </cameras>\n</calibration>\n")
}
