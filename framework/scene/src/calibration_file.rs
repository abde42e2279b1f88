//! Reads the TOML form of a calibration; every fault with its line and column.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use foveate_geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use toml::Spanned;
use toml::de::DeTable;

use crate::calibration::{Calibration, LengthUnit, MAX_CAMERAS, NamedCamera};
use crate::clocks::{CameraClock, Clocks};
use crate::draft::{Draft, Unknown, guessed_focal, middle};
use crate::error::CalibrationError;
use crate::pose2sim;
use crate::text::read_text;
use crate::toml_reader::{Reader, Value, read};
use crate::uncertainty::Uncertainties;

/// How far a quaternion's length may be from 1 and still be taken for rounding.
const QUATERNION_TOLERANCE: f64 = 1e-3;

const SECTIONS: [&str; 5] = ["calibration", "provenance", "camera", "clock", "head"];
const HEADER_KEYS: [&str; 2] = ["length_unit", "note"];
const CAMERA_KEYS: [&str; 9] = [
    "image_size_px",
    "focal_px",
    "principal_point_px",
    "pixel_aspect",
    "skew_px",
    "distortion",
    "position_m",
    "camera_from_world_wxyz",
    "uncertainty",
];
const CLOCK_KEYS: [&str; 4] = ["offset_s", "rate", "offset_sigma_s", "frame_rate_hz"];
const DISTORTION_KEYS: [&str; 5] = ["k1", "k2", "p1", "p2", "k3"];

impl Calibration {
    /// Reads the text of a TOML file; `path` is for the messages, and is the origin where `note` is missing.
    pub fn from_toml(text: &str, path: &Path) -> Result<Calibration, CalibrationError> {
        parse(text, path)
    }
}

impl Clocks {
    /// Reads the `clock` sections of a TOML file; the other sections of a calibration may stand beside them.
    ///
    /// # Errors
    /// All faults with their places; a file without any clock.
    pub fn load(path: &Path) -> Result<Clocks, CalibrationError> {
        Clocks::from_toml(&read_text(path)?, path)
    }

    /// As [`Clocks::load`], from the text of the file; `path` is for the messages.
    ///
    /// # Errors
    /// As [`Clocks::load`].
    pub fn from_toml(text: &str, path: &Path) -> Result<Clocks, CalibrationError> {
        parse_clocks(text, path)
    }
}

/// Reads `text`, ours or of Pose2Sim and its kin; `path` is for the messages.
pub(crate) fn parse(text: &str, path: &Path) -> Result<Calibration, CalibrationError> {
    let parts = read(text, path, |reader, root, whole| match pose2sim::is_meant(root) {
        true => pose2sim::parts(reader, root),
        false => own_parts(reader, root, whole, None),
    })?;
    parts.checked().map_err(|error| error.in_file(path))
}

/// Whether `text` looks like a document of ours.
pub(crate) fn is_ours(text: &str) -> bool {
    let (document, _) = DeTable::parse_recoverable(text);
    let root = document.get_ref();
    root.contains_key("calibration") && root.contains_key("camera") && !pose2sim::is_meant(root)
}

/// Reads `text` of ours, in which cameras may lack all but their size.
pub(crate) fn parse_draft(text: &str, path: &Path) -> Result<Draft, CalibrationError> {
    let mut unknown = BTreeMap::new();
    let parts = read(text, path, |reader, root, whole| own_parts(reader, root, whole, Some(&mut unknown)))?;
    Ok(Draft { calibration: parts.checked().map_err(|error| error.in_file(path))?, unknown })
}

fn lacks_pose(table: &DeTable<'_>) -> bool {
    !table.contains_key("position_m") && !table.contains_key("camera_from_world_wxyz")
}

/// What the table of a camera does not say.
fn what_lacks(table: &DeTable<'_>) -> Unknown {
    Unknown {
        focal: !table.contains_key("focal_px"),
        principal: !table.contains_key("principal_point_px"),
        distortion: !table.contains_key("distortion"),
        pose: lacks_pose(table),
    }
}

/// By name what is not known of cameras, where that is allowed.
type Drafts<'a> = Option<&'a mut BTreeMap<String, Unknown>>;

/// What a document of ours holds, before it is checked as a whole.
fn own_parts(reader: &mut Reader<'_>, root: &DeTable<'_>, whole: Range<usize>, drafts: Drafts<'_>) -> Calibration {
    reader.refuse_unknown(root, "section", &SECTIONS);
    let (length_unit, note) = reader.header(root);
    let provenance = root.get("provenance").and_then(|value| reader.provenance(value));
    let mut uncertainties = Uncertainties::new();
    let cameras = reader.cameras(root, whole, &mut uncertainties, drafts);
    let clocks = if root.contains_key("clock") { reader.clocks(root) } else { Clocks::default() };
    for name in clocks.0.keys().filter(|name| !cameras.iter().any(|it| it.name == **name)) {
        let span = root.get("clock").map_or(0..0, Spanned::span);
        reader.report(span, format!("a clock of camera {name:?}"), "a clock of one of the cameras".into());
    }
    let heads = reader.heads(root, |name| cameras.iter().any(|it| it.name == name));
    Calibration {
        cameras,
        length_unit: length_unit.unwrap_or(LengthUnit::Unknown),
        clocks,
        heads,
        provenance,
        uncertainties,
        origin: note.unwrap_or_else(|| reader.path.display().to_string()),
    }
}

/// Reads the clocks in `text`; `path` is for the messages.
pub(crate) fn parse_clocks(text: &str, path: &Path) -> Result<Clocks, CalibrationError> {
    read(text, path, |reader, root, _| {
        reader.refuse_unknown(root, "section", &SECTIONS);
        reader.clocks(root)
    })
}

impl Reader<'_> {
    fn header(&mut self, root: &DeTable<'_>) -> (Option<LengthUnit>, Option<String>) {
        let Some(table) = self.required_table(root, "calibration", 0..0) else {
            return (None, None);
        };
        let (table, at) = table;
        self.refuse_unknown(table, "key", &HEADER_KEYS);
        let unit = self.required(table, "length_unit", "\"m\" or \"unknown\"", at).and_then(|value| {
            let known = match value.get_ref().as_str() {
                Some("m") => Some(LengthUnit::Metre),
                Some("unknown") => Some(LengthUnit::Unknown),
                _ => None,
            };
            self.expect(known, value, "length_unit", "\"m\" or \"unknown\"")
        });
        let note = table.get("note").and_then(|value| {
            let note = value.get_ref().as_str().map(str::to_owned);
            self.expect(note, value, "note", "a string")
        });
        (unit, note)
    }

    fn cameras(
        &mut self,
        root: &DeTable<'_>,
        whole: Range<usize>,
        uncertainties: &mut Uncertainties,
        mut drafts: Drafts<'_>,
    ) -> Vec<NamedCamera> {
        let mut cameras = Vec::new();
        let Some((tables, at)) = self.required_table(root, "camera", whole.start..whole.start) else {
            return cameras;
        };
        if tables.is_empty() || tables.len() > MAX_CAMERAS {
            self.report(at, format!("there are {} cameras", tables.len()), "1 to 65535 cameras".into());
            return cameras;
        }
        for (name, value) in tables {
            self.camera = Some(name.get_ref().to_string());
            let camera = match value.get_ref().as_table() {
                Some(table) => {
                    let unknown = if drafts.is_some() { what_lacks(table) } else { Unknown::default() };
                    if let (Some(drafts), true) = (drafts.as_mut(), unknown != Unknown::default()) {
                        drafts.insert(name.get_ref().to_string(), unknown);
                    }
                    self.camera(table, name.span(), unknown)
                }
                None => self.expect(None, value, "camera", "a table such as [camera.wide-1]"),
            };
            let uncertainty = value.get_ref().as_table().and_then(|table| self.uncertainty(table.get("uncertainty")?));
            uncertainties.extend(uncertainty.map(|it| (name.get_ref().to_string(), it)));
            cameras.extend(camera.map(|camera| NamedCamera { name: name.get_ref().to_string(), camera }));
        }
        self.camera = None;
        cameras
    }

    /// Reads all keys before it returns an error, so that all their faults are found.
    fn camera(&mut self, table: &DeTable<'_>, at: Range<usize>, unknown: Unknown) -> Option<Camera> {
        self.refuse_unknown(table, "key", &CAMERA_KEYS);
        let pose_is_missing = !unknown.pose && lacks_pose(table);
        if pose_is_missing {
            let expected = "position_m = 3 numbers; a camera's pose is what `foveate calibrate` finds";
            self.report(at.clone(), "position_m is missing".into(), expected.into());
        }
        let image_size = self.image_size(table, at.clone());
        let focal = match self.pixel_aspect(table, unknown) {
            None => None,
            Some(aspect) if unknown.focal => image_size.map(|it| guessed_focal(it, aspect)),
            Some(_) => self.numbers::<2>(table, "focal_px", at.clone()),
        };
        let principal = match unknown.principal {
            true => image_size.map(middle),
            false => self.numbers::<2>(table, "principal_point_px", at.clone()),
        };
        let skew = table.get("skew_px").map_or(Some(0.0), |value| self.number(value, "skew_px"));
        let distortion = table.get("distortion").map_or(Some(Distortion::default()), |value| self.distortion(value));
        let (position, turn) = match unknown.pose {
            true => (Some([0.0; 3]), Some([1.0, 0.0, 0.0, 0.0])),
            false if pose_is_missing => (None, self.numbers::<4>(table, "camera_from_world_wxyz", at)),
            false => {
                let position = self.numbers::<3>(table, "position_m", at.clone());
                (position, self.numbers::<4>(table, "camera_from_world_wxyz", at))
            }
        };
        let focal = focal.and_then(|focal| match focal.iter().all(|it| *it > 0.0) {
            true => Some(focal),
            false => self.expect(None, table.get("focal_px")?, "focal_px", "two numbers above 0"),
        });
        let turn = turn.and_then(|[w, i, j, k]| {
            let quaternion = Quaternion::new(w, i, j, k);
            let length = quaternion.norm();
            if (length - 1.0).abs() > QUATERNION_TOLERANCE {
                let span = table.get("camera_from_world_wxyz")?.span();
                let found = format!("camera_from_world_wxyz has length {length:.6}");
                self.report(span, found, "a unit quaternion [w, x, y, z] of length 1".into());
                return None;
            }
            Some(UnitQuaternion::from_quaternion(quaternion))
        });
        let (rotation, centre) = (turn?, Vector3::from(position?));
        Some(Camera {
            image_size: image_size?,
            intrinsics: Intrinsics { focal: focal?, principal: principal?, skew: skew? },
            distortion: distortion?,
            camera_from_world: Isometry3::from_parts((rotation * -centre).into(), rotation),
        })
    }

    /// The shape of the pixels of a camera whose focal lengths are unknown [–]; square ones need no word.
    fn pixel_aspect(&mut self, table: &DeTable<'_>, unknown: Unknown) -> Option<f64> {
        let Some(value) = table.get("pixel_aspect") else { return Some(1.0) };
        if !unknown.focal {
            self.report(
                value.span(),
                "pixel_aspect beside focal_px".into(),
                "one of them: focal_px implies pixel_aspect".into(),
            );
            return None;
        }
        let aspect = self.number(value, "pixel_aspect")?;
        self.expect((aspect > 0.0).then_some(aspect), value, "pixel_aspect", "a number above 0, fy/fx")
    }

    fn clocks(&mut self, root: &DeTable<'_>) -> Clocks {
        let mut clocks = Clocks::default();
        let Some((tables, _)) = self.required_table(root, "clock", 0..0) else { return clocks };
        for (name, value) in tables {
            self.camera = Some(name.get_ref().to_string());
            let clock = match value.get_ref().as_table() {
                Some(table) => self.clock(table),
                None => self.expect(None, value, "clock", "a table such as [clock.wide-1]"),
            };
            clocks.0.extend(clock.map(|clock| (name.get_ref().to_string(), clock)));
        }
        self.camera = None;
        clocks
    }

    fn clock(&mut self, table: &DeTable<'_>) -> Option<CameraClock> {
        self.refuse_unknown(table, "key", &CLOCK_KEYS);
        // A clock may be stated for its frame rate alone.
        let offset = match table.get("offset_s") {
            Some(value) => self.number(value, "offset_s"),
            None => Some(0.0),
        };
        let mut positive = |key: &str| {
            let Some(value) = table.get(key) else { return Some(None) };
            let number = self.number(value, key)?;
            self.expect((number > 0.0).then_some(Some(number)), value, key, "a number above 0")
        };
        let (rate, sigma, frames) = (positive("rate"), positive("offset_sigma_s"), positive("frame_rate_hz"));
        Some(CameraClock {
            offset_s: offset?,
            rate: rate?.unwrap_or(1.0),
            offset_sigma_s: sigma?,
            frame_rate_hz: frames?,
        })
    }

    pub(crate) fn distortion(&mut self, value: &Value<'_>) -> Option<Distortion> {
        let Some(table) = value.get_ref().as_table() else {
            return self.expect(None, value, "distortion", "a table such as { k1 = -0.1 }");
        };
        self.refuse_unknown(table, "key of distortion", &DISTORTION_KEYS);
        let [k1, k2, p1, p2, k3] =
            DISTORTION_KEYS.map(|key| table.get(key).map_or(Some(0.0), |value| self.number(value, key)));
        Some(Distortion { k1: k1?, k2: k2?, p1: p1?, p2: p2?, k3: k3? })
    }

    fn image_size(&mut self, table: &DeTable<'_>, at: Range<usize>) -> Option<[u32; 2]> {
        let expected = "[columns, rows], whole numbers from 1 to 65535";
        let value = self.required(table, "image_size_px", expected, at)?;
        let whole = |value: &Value<'_>| {
            let integer = value.get_ref().as_integer()?;
            u32::from_str_radix(integer.as_str(), integer.radix()).ok().filter(|it| (1..=65535).contains(it))
        };
        let size = value.get_ref().as_array().and_then(|list| match list.as_ref() {
            [columns, rows] => Some([whole(columns)?, whole(rows)?]),
            _ => None,
        });
        self.expect(size, value, "image_size_px", expected)
    }
}
