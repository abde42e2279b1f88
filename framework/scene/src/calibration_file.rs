//! Reads the TOML form of a calibration; every fault with its line and column.

use std::ops::Range;
use std::path::Path;

use foveate_geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::calibration::{
    Calibration, CalibrationError, CalibrationFault, LengthUnit, NamedCamera, place_of, sort_by_place,
};
use crate::clocks::{CameraClock, Clocks};
use crate::pose2sim;

type Value<'i> = Spanned<DeValue<'i>>;

/// How far a quaternion's length may be from 1 and still be taken for rounding.
const QUATERNION_TOLERANCE: f64 = 1e-3;
pub(crate) const MAX_CAMERAS: usize = u16::MAX as usize;

const SECTIONS: [&str; 3] = ["calibration", "camera", "clock"];
const HEADER_KEYS: [&str; 2] = ["length_unit", "note"];
const CAMERA_KEYS: [&str; 7] = [
    "image_size_px",
    "focal_px",
    "principal_point_px",
    "skew_px",
    "distortion",
    "position_m",
    "camera_from_world_wxyz",
];
const CLOCK_KEYS: [&str; 4] = ["offset_s", "rate", "offset_sigma_s", "frame_rate_hz"];
const DISTORTION_KEYS: [&str; 5] = ["k1", "k2", "p1", "p2", "k3"];

/// Reads `text`; `path` is for the messages.
pub(crate) fn parse(text: &str, path: &Path) -> Result<Calibration, CalibrationError> {
    let (header, cameras, clocks) = read(text, path, |reader, root, whole| {
        if pose2sim::is_meant(root) {
            let note = format!("Pose2Sim calibration {}", path.display());
            return ((Some(LengthUnit::Metre), Some(note)), pose2sim::cameras(reader, root), Clocks::default());
        }
        reader.refuse_unknown(root, "section", &SECTIONS);
        let header = reader.header(root);
        let cameras = reader.cameras(root, whole);
        let clocks = if root.contains_key("clock") { reader.clocks(root) } else { Clocks::default() };
        for name in clocks.0.keys().filter(|name| !cameras.iter().any(|it| it.name == **name)) {
            let span = root.get("clock").map_or(0..0, Spanned::span);
            reader.report(span, format!("a clock of camera {name:?}"), "a clock of one of the cameras".into());
        }
        (header, cameras, clocks)
    })?;
    let (length_unit, note) = header;
    let origin = note.unwrap_or_else(|| path.display().to_string());
    let calibration = Calibration::new(cameras, length_unit.unwrap_or(LengthUnit::Unknown), origin);
    calibration.map(|it| Calibration { clocks, ..it }).map_err(|mut error| {
        error.faults.iter_mut().for_each(|fault| fault.file = path.to_owned());
        error
    })
}

/// Reads the clocks in `text`; `path` is for the messages.
pub(crate) fn parse_clocks(text: &str, path: &Path) -> Result<Clocks, CalibrationError> {
    read(text, path, |reader, root, _| {
        reader.refuse_unknown(root, "section", &SECTIONS);
        reader.clocks(root)
    })
}

/// What `of` makes of the document, unless anything is wrong with it.
fn read<T>(
    text: &str,
    path: &Path,
    of: impl FnOnce(&mut Reader<'_>, &DeTable<'_>, Range<usize>) -> T,
) -> Result<T, CalibrationError> {
    let mut reader = Reader { text, path, camera: None, faults: Vec::new() };
    let (document, errors) = DeTable::parse_recoverable(text);
    if !errors.is_empty() {
        for error in errors {
            let at = error.span().unwrap_or(0..0);
            reader.report(at, format!("this is not TOML ({})", error.message()), "a TOML file".into());
        }
        return Err(reader.into_error());
    }
    let root = document.get_ref();
    let read = of(&mut reader, root, document.span());
    if reader.faults.is_empty() { Ok(read) } else { Err(reader.into_error()) }
}

pub(crate) struct Reader<'a> {
    text: &'a str,
    path: &'a Path,
    /// The one being read, for the messages.
    pub camera: Option<String>,
    faults: Vec<CalibrationFault>,
}

impl Reader<'_> {
    pub fn report(&mut self, at: Range<usize>, found: String, expected: String) {
        self.faults.push(CalibrationFault {
            file: self.path.to_owned(),
            place: Some(place_of(self.text, at.start)),
            camera: self.camera.clone(),
            found,
            expected,
        });
    }

    fn into_error(mut self) -> CalibrationError {
        sort_by_place(&mut self.faults);
        CalibrationError { faults: self.faults }
    }

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

    fn cameras(&mut self, root: &DeTable<'_>, whole: Range<usize>) -> Vec<NamedCamera> {
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
                Some(table) => self.camera(table, name.span()),
                None => self.expect(None, value, "camera", "a table such as [camera.wide-1]"),
            };
            cameras.extend(camera.map(|camera| NamedCamera { name: name.get_ref().to_string(), camera }));
        }
        self.camera = None;
        cameras
    }

    /// Reads all keys before it gives up, so that all their faults are found.
    fn camera(&mut self, table: &DeTable<'_>, at: Range<usize>) -> Option<Camera> {
        self.refuse_unknown(table, "key", &CAMERA_KEYS);
        let image_size = self.image_size(table, at.clone());
        let focal = self.numbers::<2>(table, "focal_px", at.clone());
        let principal = self.numbers::<2>(table, "principal_point_px", at.clone());
        let skew = table.get("skew_px").map_or(Some(0.0), |value| self.number(value, "skew_px"));
        let distortion = table.get("distortion").map_or(Some(Distortion::default()), |value| self.distortion(value));
        let position = self.numbers::<3>(table, "position_m", at.clone());
        let turn = self.numbers::<4>(table, "camera_from_world_wxyz", at);
        let focal = focal.and_then(|focal| {
            let positive = focal.iter().all(|it| *it > 0.0).then_some(focal);
            self.expect(positive, table.get("focal_px")?, "focal_px", "two numbers above 0")
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

    fn clocks(&mut self, root: &DeTable<'_>) -> Clocks {
        let mut clocks = Clocks::default();
        let Some((tables, _)) = self.required_table(root, "clock", 0..0) else { return clocks };
        for (name, value) in tables {
            self.camera = Some(name.get_ref().to_string());
            let clock = match value.get_ref().as_table() {
                Some(table) => self.clock(table, name.span()),
                None => self.expect(None, value, "clock", "a table such as [clock.wide-1]"),
            };
            clocks.0.extend(clock.map(|clock| (name.get_ref().to_string(), clock)));
        }
        self.camera = None;
        clocks
    }

    fn clock(&mut self, table: &DeTable<'_>, at: Range<usize>) -> Option<CameraClock> {
        self.refuse_unknown(table, "key", &CLOCK_KEYS);
        let offset = self.required(table, "offset_s", "a number of seconds", at);
        let offset = offset.and_then(|value| self.number(value, "offset_s"));
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

    fn distortion(&mut self, value: &Value<'_>) -> Option<Distortion> {
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

    pub fn numbers<const N: usize>(&mut self, table: &DeTable<'_>, key: &str, at: Range<usize>) -> Option<[f64; N]> {
        let expected = format!("{N} numbers");
        let value = self.required(table, key, &expected, at)?;
        let Some(list) = value.get_ref().as_array().filter(|list| list.len() == N) else {
            return self.expect(None, value, key, &expected);
        };
        let mut numbers = [0.0; N];
        let mut complete = true;
        for (index, item) in list.iter().enumerate() {
            match self.number(item, &format!("{key}[{index}]")) {
                Some(number) => numbers[index] = number,
                None => complete = false,
            }
        }
        complete.then_some(numbers)
    }

    pub fn number(&mut self, value: &Value<'_>, what: &str) -> Option<f64> {
        let number = match value.get_ref() {
            DeValue::Float(float) => float.as_str().parse().ok(),
            DeValue::Integer(integer) => {
                i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|it| it as f64)
            }
            _ => None,
        };
        self.expect(number.filter(|it: &f64| it.is_finite()), value, what, "a finite number")
    }

    pub fn required<'t, 'i>(
        &mut self,
        table: &'t DeTable<'i>,
        key: &str,
        expected: &str,
        at: Range<usize>,
    ) -> Option<&'t Value<'i>> {
        let value = table.get(key);
        if value.is_none() {
            self.report(at, format!("{key} is missing"), format!("{key} = {expected}"));
        }
        value
    }

    fn required_table<'t, 'i>(
        &mut self,
        table: &'t DeTable<'i>,
        key: &str,
        at: Range<usize>,
    ) -> Option<(&'t DeTable<'i>, Range<usize>)> {
        let value = self.required(table, key, "a table", at)?;
        let inner = value.get_ref().as_table().map(|inner| (inner, value.span()));
        self.expect(inner, value, key, "a table")
    }

    /// Passes `read` on, or reports that `value`, called `what`, is not what was `expected`.
    pub fn expect<T>(&mut self, read: Option<T>, value: &Value<'_>, what: &str, expected: &str) -> Option<T> {
        if read.is_none() {
            let mut source = self.text.get(value.span()).unwrap_or_default().to_owned();
            if source.chars().count() > 60 {
                source = source.chars().take(57).chain("...".chars()).collect();
            }
            self.report(value.span(), format!("{what} is {source}"), expected.to_owned());
        }
        read
    }

    pub fn refuse_unknown(&mut self, table: &DeTable<'_>, kind: &str, known: &[&str]) {
        for key in table.keys().filter(|key| !known.contains(&key.get_ref().as_ref())) {
            let name = key.get_ref();
            let likeness = |it: &&&str| (strsim::jaro_winkler(it, name) * 1e6) as u64;
            let close = known.iter().max_by_key(likeness).filter(|it| likeness(it) > 750_000);
            let expected = match close {
                Some(close) => format!("{close} (did you mean that?)"),
                None => format!("one of {}", known.join(", ")),
            };
            self.report(key.span(), format!("unknown {kind} {name:?}"), expected);
        }
    }
}
