//! Pan-tilt heads of cameras: their axes, limits and units, by the name of the camera that they carry.
//!
//! A section `head` for each head in a calibration file. The camera of that name is the camera *at rest*, with both angles 0; all of the head
//! stands in its space (x right, y down, z forward, origin at the centre of projection) [Davis 2002 §4.2]:
//!
//! ```toml
//! [head.ptz-1]
//! pan_axis = { point_m = [0.012, 0.0, -0.055], direction = [0.087, 0.994, 0.061] }    # any point of the axis; right-handed about the direction
//! tilt_axis = { point_m = [0.0, 0.018, -0.04], direction = [0.998, -0.052, 0.035] }
//! stacking = "tilt_on_pan"                              # the pan axis stands still and carries the other; or "pan_on_tilt"; may be left out
//! limits_deg = { pan = [-100, 100], tilt = [-25, 25] }  # without: any pan, tilt from straight down to straight up
//! pan_device = { deg_per_unit = 0.11364, at_rest = 0 }   # angle = (what the device counts - at_rest) * deg_per_unit; without: degrees
//! tilt_device = { deg_per_unit = 0.08333, at_rest = 0 }
//!
//! [[head.ptz-1.zoom]]                                   # for a lens that zooms: its optics at two positions of the drive or more, rising
//! position = 0                                          # in the device's units
//! focal_px = [700.0, 700.0]
//! principal_point_px = [319.5, 239.5]
//! skew_px = 0.0                                         # optional, and
//! distortion = { k1 = -0.2 }                            # each of its parts
//!
//! [head.ptz-1.uncertainty]                              # optional
//! covariance = [[1e-8, 0.0], [0.0, 1e-8]]               # 16 rows of 16, in the order and steps of `geometry::pan_tilt::HeadCovariance`
//! ```

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::ops::Range;

use foveate_geometry::pan_tilt::{
    Axis, AxisUnits, HeadCovariance, Limits, PanTiltHead, Stacking, ZoomError, ZoomStop, ZoomTable,
};
use foveate_geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Point3, SMatrix, Unit, Vector3};
use toml::de::DeTable;

use crate::text::key;
use crate::toml_reader::{Reader, Value};

const HEAD_KEYS: [&str; 8] =
    ["pan_axis", "tilt_axis", "stacking", "limits_deg", "pan_device", "tilt_device", "zoom", "uncertainty"];
const AXIS_KEYS: [&str; 2] = ["point_m", "direction"];
const LIMIT_KEYS: [&str; 2] = ["pan", "tilt"];
const DEVICE_KEYS: [&str; 2] = ["deg_per_unit", "at_rest"];
const STOP_KEYS: [&str; 5] = ["position", "focal_px", "principal_point_px", "skew_px", "distortion"];
const UNCERTAINTY_KEYS: [&str; 1] = ["covariance"];
/// Numbers of a head's covariance: rows and columns.
const UNKNOWNS: usize = 16;
/// Rows of that covariance which are lengths: of the pose and of either axis.
const LENGTHS: [usize; 7] = [3, 4, 5, 8, 9, 12, 13];
/// Two halves of a covariance may differ by so much of its largest element, and an eigenvalue may be negative by so much.
const COVARIANCE_TOLERANCE: f64 = 1e-9;
/// Axes closer to each other than this turn the camera the same way: 5° [rad].
const LEAST_BETWEEN_AXES: f64 = 0.0873;
/// A direction whose length is 1 but for this is left to its last bit.
const ROUNDING: f64 = 1e-12;

/// What a calibration says of a head; the camera at rest is that of the head's name.
#[derive(Debug, Clone, PartialEq)]
pub struct Head {
    /// The pan axis, in the space of the camera at rest [m].
    pub pan: Axis,
    /// The tilt axis, in the space of the camera at rest [m].
    pub tilt: Axis,
    /// Which axis carries the other.
    pub stacking: Stacking,
    /// Angles that the head can take [rad].
    pub limits: Limits,
    /// What the device's numbers of pan and tilt mean.
    pub units: [AxisUnits; 2],
    /// Optics by zoom position.
    pub zoom: Option<ZoomTable>,
    /// How well head and camera at rest are known together, where that is.
    pub covariance: Option<HeadCovariance>,
}

/// Heads by the name of the camera that they carry.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Heads(pub BTreeMap<String, Head>);

/// A head with the camera that it carries.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedHead {
    /// Camera, axes, limits and zoom.
    pub model: PanTiltHead,
    /// What the device's numbers of pan and tilt mean.
    pub units: [AxisUnits; 2],
    /// How well that is known, where it was estimated.
    pub covariance: Option<HeadCovariance>,
}

impl Head {
    /// With the camera at rest.
    pub fn carrying(&self, at_rest: &Camera) -> CalibratedHead {
        let Head { pan, tilt, stacking, limits, units, zoom, covariance } = self.clone();
        let model = PanTiltHead { at_rest: at_rest.clone(), pan, tilt, stacking, limits, zoom };
        CalibratedHead { model, units, covariance }
    }

    /// The same where every length is `factor` times as large.
    pub(crate) fn scaled(mut self, factor: f64) -> Head {
        for axis in [&mut self.pan, &mut self.tilt] {
            axis.point.coords *= factor;
        }
        if let Some(HeadCovariance { whole }) = &mut self.covariance {
            for it in LENGTHS {
                whole.row_mut(it).scale_mut(factor);
                whole.column_mut(it).scale_mut(factor);
            }
        }
        self
    }

    /// The sections as they stand in a file, after an empty line; `key` is the camera's name as a TOML key.
    fn to_toml(&self, key: &str) -> String {
        let mut text = format!("\n[head.{key}]\n");
        // Writing to a String cannot fail.
        for (name, axis) in [("pan_axis", &self.pan), ("tilt_axis", &self.tilt)] {
            let [point, direction] = [axis.point.coords, axis.direction.into_inner()].map(<[f64; 3]>::from);
            let _ = writeln!(text, "{name} = {{ point_m = {point:?}, direction = {direction:?} }}");
        }
        let stacking = match self.stacking {
            Stacking::TiltOnPan => "tilt_on_pan",
            Stacking::PanOnTilt => "pan_on_tilt",
        };
        let _ = writeln!(text, "stacking = \"{stacking}\"");
        let limits = [("pan", self.limits.pan), ("tilt", self.limits.tilt)];
        let finite = limits.into_iter().filter(|(_, limits)| limits.iter().all(|it| it.is_finite()));
        let stated: Vec<String> = finite.map(|(name, it)| format!("{name} = {:?}", it.map(f64::to_degrees))).collect();
        if !stated.is_empty() {
            let _ = writeln!(text, "limits_deg = {{ {} }}", stated.join(", "));
        }
        for (name, units) in ["pan_device", "tilt_device"].iter().zip(self.units) {
            let deg_per_unit = units.rad_per_unit.to_degrees();
            let _ = writeln!(text, "{name} = {{ deg_per_unit = {deg_per_unit:?}, at_rest = {:?} }}", units.at_rest);
        }
        for ZoomStop { zoom, intrinsics, distortion: lens } in self.zoom.iter().flat_map(|it| it.stops()) {
            let Intrinsics { focal, principal, skew } = intrinsics;
            let Distortion { k1, k2, p1, p2, k3 } = lens;
            let _ = writeln!(text, "\n[[head.{key}.zoom]]\nposition = {zoom:?}\nfocal_px = {focal:?}");
            let _ = writeln!(text, "principal_point_px = {principal:?}\nskew_px = {skew:?}");
            let _ =
                writeln!(text, "distortion = {{ k1 = {k1:?}, k2 = {k2:?}, p1 = {p1:?}, p2 = {p2:?}, k3 = {k3:?} }}");
        }
        if let Some(HeadCovariance { whole }) = &self.covariance {
            let _ = write!(text, "\n[head.{key}.uncertainty]\ncovariance = [\n");
            for row in whole.row_iter() {
                let _ = writeln!(text, "  {:?},", row.iter().collect::<Vec<_>>());
            }
            text += "]\n";
        }
        text
    }
}

impl Heads {
    /// The sections as they stand in a file.
    pub(crate) fn to_toml(&self) -> String {
        self.0.iter().map(|(name, head)| head.to_toml(&key(name))).collect()
    }
}

impl Reader<'_> {
    /// The sections `head`; heads of cameras that `is_camera` does not know are refused.
    pub(crate) fn heads(&mut self, root: &DeTable<'_>, is_camera: impl Fn(&str) -> bool) -> Heads {
        let mut heads = Heads::default();
        if !root.contains_key("head") {
            return heads;
        }
        let Some((tables, _)) = self.required_table(root, "head", 0..0) else { return heads };
        for (name, value) in tables {
            let camera = name.get_ref().to_string();
            if !is_camera(&camera) {
                self.report(name.span(), format!("a head of camera {camera:?}"), "a head of one of the cameras".into());
            }
            self.camera = Some(camera.clone());
            let head = match value.get_ref().as_table() {
                Some(table) => self.head(table, name.span()),
                None => self.expect(None, value, "head", "a table such as [head.ptz-1]"),
            };
            heads.0.extend(head.map(|it| (camera, it)));
        }
        self.camera = None;
        heads
    }

    /// Reads all keys before it returns an error, so that all their faults are found.
    fn head(&mut self, table: &DeTable<'_>, at: Range<usize>) -> Option<Head> {
        self.refuse_unknown(table, "key", &HEAD_KEYS);
        let axes = ["pan_axis", "tilt_axis"].map(|key| {
            let expected = "{ point_m = 3 numbers, direction = 3 numbers }";
            self.required(table, key, expected, at.clone()).and_then(|value| self.axis(value, key))
        });
        let stacking = table.get("stacking").map_or(Some(Stacking::default()), |value| {
            let known = match value.get_ref().as_str() {
                Some("tilt_on_pan") => Some(Stacking::TiltOnPan),
                Some("pan_on_tilt") => Some(Stacking::PanOnTilt),
                _ => None,
            };
            self.expect(known, value, "stacking", "\"tilt_on_pan\" or \"pan_on_tilt\"")
        });
        let limits = table.get("limits_deg").map_or(Some(Limits::WIDE), |value| self.limits(value));
        let units = ["pan_device", "tilt_device"]
            .map(|key| table.get(key).map_or(Some(AxisUnits::DEGREES), |value| self.device(value, key)));
        let zoom = table.get("zoom").map(|value| self.zoom_table(value));
        let covariance = table.get("uncertainty").map(|value| self.head_uncertainty(value));
        let ([pan, tilt], [pan_units, tilt_units]) = (axes, units);
        if let (Some(pan), Some(tilt), Some(value)) = (&pan, &tilt, table.get("tilt_axis")) {
            let crossed = (pan.angle_to(tilt) >= LEAST_BETWEEN_AXES).then_some(());
            self.expect(crossed, value, "tilt_axis", "an axis that is not parallel to the pan axis")?;
        }
        Some(Head {
            pan: pan?,
            tilt: tilt?,
            stacking: stacking?,
            limits: limits?,
            units: [pan_units?, tilt_units?],
            zoom: zoom.map_or(Some(None), |it| it.map(Some))?,
            covariance: covariance.map_or(Some(None), |it| it.map(Some))?,
        })
    }

    fn axis(&mut self, value: &Value<'_>, key: &str) -> Option<Axis> {
        let Some(table) = value.get_ref().as_table() else {
            let expected = "a table such as { point_m = [0, 0, 0], direction = [0, 1, 0] }";
            return self.expect(None, value, key, expected);
        };
        self.refuse_unknown(table, &format!("key of {key}"), &AXIS_KEYS);
        let point = self.numbers::<3>(table, "point_m", value.span());
        let direction = self.numbers::<3>(table, "direction", value.span()).and_then(|numbers| {
            let vector = Vector3::from(numbers);
            let direction = match (vector.norm() - 1.0).abs() < ROUNDING {
                true => Some(Unit::new_unchecked(vector)),
                false => Unit::try_new(vector, 0.0).filter(|it| it.iter().all(|x| x.is_finite())),
            };
            self.expect(direction, table.get("direction")?, "direction", "three numbers that are not all 0")
        });
        Some(Axis { point: Point3::from(point?), direction: direction? })
    }

    fn limits(&mut self, value: &Value<'_>) -> Option<Limits> {
        let Some(table) = value.get_ref().as_table() else {
            let expected = "a table such as { pan = [-100, 100], tilt = [-25, 25] }";
            return self.expect(None, value, "limits_deg", expected);
        };
        self.refuse_unknown(table, "key of limits_deg", &LIMIT_KEYS);
        let wide = [Limits::WIDE.pan, Limits::WIDE.tilt];
        let [pan, tilt] = [0, 1].map(|axis| {
            let key = LIMIT_KEYS[axis];
            let Some(value) = table.get(key) else { return Some(wide[axis]) };
            let limits = self.numbers::<2>(table, key, value.span())?;
            let rises = (limits[0] <= limits[1]).then_some(limits.map(f64::to_radians));
            self.expect(rises, value, key, "[least, largest] in degrees, the smaller one first")
        });
        Some(Limits { pan: pan?, tilt: tilt? })
    }

    fn device(&mut self, value: &Value<'_>, key: &str) -> Option<AxisUnits> {
        let Some(table) = value.get_ref().as_table() else {
            return self.expect(None, value, key, "a table such as { deg_per_unit = 0.11364, at_rest = 0 }");
        };
        self.refuse_unknown(table, &format!("key of {key}"), &DEVICE_KEYS);
        let expected = "the angle of one of the device's units";
        let unit = self.required(table, "deg_per_unit", expected, value.span()).and_then(|value| {
            let number = self.number(value, "deg_per_unit")?;
            self.expect((number != 0.0).then_some(number.to_radians()), value, "deg_per_unit", "a number other than 0")
        });
        let at_rest = table.get("at_rest").map_or(Some(0.0), |value| self.number(value, "at_rest"));
        Some(AxisUnits { rad_per_unit: unit?, at_rest: at_rest? })
    }

    fn zoom_table(&mut self, value: &Value<'_>) -> Option<ZoomTable> {
        let Some(list) = value.get_ref().as_array() else {
            return self.expect(None, value, "zoom", "a list of tables such as [[head.ptz-1.zoom]]");
        };
        let stops: Vec<Option<ZoomStop>> = list.iter().map(|it| self.zoom_stop(it)).collect();
        let stops = stops.into_iter().collect::<Option<Vec<ZoomStop>>>()?;
        match ZoomTable::new(stops) {
            Ok(table) => Some(table),
            Err(fault) => {
                let at = match fault {
                    ZoomError::TooFew { .. } => None,
                    ZoomError::NotRising { stop, .. }
                    | ZoomError::FocalTurnsBack { stop, .. }
                    | ZoomError::BadOptics { stop, .. } => list.get(stop).map(|it| it.span()),
                };
                let expected = "two stops or more by rising position, with focal lengths that only rise or only fall";
                self.report(at.unwrap_or_else(|| value.span()), fault.to_string(), expected.into());
                None
            }
        }
    }

    fn zoom_stop(&mut self, value: &Value<'_>) -> Option<ZoomStop> {
        let Some(table) = value.get_ref().as_table() else {
            return self.expect(None, value, "a zoom stop", "a table such as [[head.ptz-1.zoom]]");
        };
        self.refuse_unknown(table, "key of a zoom stop", &STOP_KEYS);
        let position = self.required(table, "position", "a number in the device's units", value.span());
        let position = position.and_then(|it| self.number(it, "position"));
        let focal = self.numbers::<2>(table, "focal_px", value.span());
        let principal = self.numbers::<2>(table, "principal_point_px", value.span());
        let skew = table.get("skew_px").map_or(Some(0.0), |value| self.number(value, "skew_px"));
        let lens = table.get("distortion").map_or(Some(Distortion::default()), |value| self.distortion(value));
        let intrinsics = Intrinsics { focal: focal?, principal: principal?, skew: skew? };
        Some(ZoomStop { zoom: position?, intrinsics, distortion: lens? })
    }

    fn head_uncertainty(&mut self, value: &Value<'_>) -> Option<HeadCovariance> {
        let Some(table) = value.get_ref().as_table() else {
            return self.expect(None, value, "uncertainty", "a table such as [head.ptz-1.uncertainty]");
        };
        self.refuse_unknown(table, "key of uncertainty", &UNCERTAINTY_KEYS);
        let expected = "16 rows of 16 numbers, symmetric and without negative eigenvalues";
        let value = self.required(table, "covariance", expected, value.span())?;
        let rows = value.get_ref().as_array().filter(|rows| rows.len() == UNKNOWNS);
        let rows = self.expect(rows, value, "covariance", expected)?;
        let mut whole = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        for (index, row) in rows.iter().enumerate() {
            let list = row.get_ref().as_array().filter(|list| list.len() == UNKNOWNS);
            for (column, item) in self.expect(list, row, "a row of covariance", "16 numbers")?.iter().enumerate() {
                whole[(index, column)] = self.number(item, &format!("covariance[{index}][{column}]"))?;
            }
        }
        let slack = COVARIANCE_TOLERANCE * whole.amax();
        let symmetric = (whole - whole.transpose()).amax() <= slack;
        let fine = symmetric && whole.symmetric_eigenvalues().min() >= -slack;
        self.expect(fine.then_some(HeadCovariance { whole }), value, "covariance", expected)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use foveate_geometry::pan_tilt::Setting;
    use proptest::prelude::*;

    use super::*;
    use crate::{Calibration, CalibrationError, LengthUnit, NamedCamera};

    fn plain() -> Calibration {
        let camera = Camera::look_at(Point3::new(-3.0, 0.5, 2.4), Point3::new(0.0, 0.2, 1.4), [640, 480], 700.0);
        let named = |name: &str| NamedCamera { name: name.into(), camera: camera.clone() };
        Calibration::new(vec![named("ptz-1"), named("wide-1")], LengthUnit::Metre, "a test".into()).unwrap()
    }

    /// The head of the module's words, with all that may be said.
    fn full() -> Calibration {
        let axis = |point: [f64; 3], direction: [f64; 3]| Axis {
            point: point.into(),
            direction: Unit::new_normalize(direction.into()),
        };
        let stop = |zoom: f64, focal: f64| ZoomStop {
            zoom,
            intrinsics: Intrinsics { focal: [focal, focal + 0.5], principal: [319.0, 240.0], skew: 0.1 },
            distortion: Distortion { k1: -0.2, k2: 0.01 * zoom, ..Default::default() },
        };
        let root = SMatrix::<f64, 16, 16>::from_fn(|row, column| 1e-3 * ((row * 5 + column * 3) as f64).sin());
        let covariance = root * root.transpose();
        let head = Head {
            pan: axis([0.012, 0.0, -0.055], [0.087, 0.994, 0.061]),
            tilt: axis([0.0, 0.018, -0.04], [0.998, -0.052, 0.035]),
            stacking: Stacking::PanOnTilt,
            limits: Limits::symmetric(100f64.to_radians(), 25f64.to_radians()),
            units: [
                AxisUnits { rad_per_unit: 0.004, at_rest: 12.0 },
                AxisUnits { rad_per_unit: -0.003, at_rest: -3.5 },
            ],
            zoom: Some(ZoomTable::new(vec![stop(0.0, 700.0), stop(1.0, 8400.0)]).unwrap()),
            covariance: Some(HeadCovariance { whole: (covariance + covariance.transpose()) / 2.0 }),
        };
        let heads = Heads([("ptz-1".to_owned(), head)].into());
        Calibration { heads, ..plain() }
    }

    fn parse(text: &str) -> Result<Calibration, CalibrationError> {
        Calibration::from_toml(text, Path::new("lab.toml"))
    }

    #[test]
    fn a_head_comes_back_from_its_file() {
        let (saved, loaded) = (full(), parse(&full().to_toml()).unwrap());
        let (before, after) = (&saved.heads.0["ptz-1"], &loaded.heads.0["ptz-1"]);
        assert_eq!((&before.pan, &before.tilt, before.stacking), (&after.pan, &after.tilt, after.stacking));
        assert_eq!((&before.zoom, &before.covariance), (&after.zoom, &after.covariance));
        for axis in 0..2 {
            let (before, after) = (before.units[axis], after.units[axis]);
            assert!((before.rad_per_unit / after.rad_per_unit - 1.0).abs() < 1e-14 && before.at_rest == after.at_rest);
        }
        assert!((before.limits.pan[1] - after.limits.pan[1]).abs() < 1e-14 && after.limits.tilt[0] < -0.4);
        // And from there to the last bit.
        assert_eq!(parse(&loaded.to_toml()).unwrap().heads, loaded.heads);
        assert!(!plain().to_toml().contains("head"));
    }

    #[test]
    fn what_is_left_out_has_its_default() {
        let axis = |it: &str| format!("{{ point_m = [0, 0, 0], direction = {it} }}");
        let text = format!(
            "{}\n[head.ptz-1]\npan_axis = {}\ntilt_axis = {}\n",
            plain().to_toml(),
            axis("[0, 2, 0]"),
            axis("[3, 0, 0]")
        );
        let calibration = parse(&text).unwrap();
        let head = calibration.head("ptz-1").unwrap();
        assert_eq!(head.model, PanTiltHead::aligned(calibration.camera("ptz-1").unwrap().clone(), Limits::WIDE));
        assert_eq!((head.units, head.covariance), ([AxisUnits::DEGREES; 2], None));
        assert_eq!(parse(&calibration.to_toml()).unwrap().heads, calibration.heads);
        assert_eq!([calibration.head("wide-1"), calibration.head("none")], [None, None]);
    }

    #[test]
    fn a_head_carries_the_camera_of_its_name() {
        let calibration = full();
        let head = calibration.head("ptz-1").unwrap();
        head.model.check().unwrap();
        assert_eq!(&head.model.camera_at(&Setting::default()), calibration.camera("ptz-1").unwrap());
        assert!((head.units[1].angle(-4.5) - 0.003).abs() < 1e-15);
    }

    #[test]
    fn every_fault_is_named_with_its_place() {
        let good = full().to_toml();
        parse(&good).unwrap();
        for (from, to, expected) in [
            ("[head.ptz-1]", "[head.ptz-2]", "a head of camera \"ptz-2\", expected a head of one of the cameras"),
            ("pan_axis = ", "pan_axes = ", "unknown key \"pan_axes\", expected pan_axis (did you mean that?)"),
            ("point_m = [0.012,", "point_m = [", "point_m is [ 0.0, -0.055], expected 3 numbers"),
            ("\"pan_on_tilt\"", "\"both\"", "stacking is \"both\", expected \"tilt_on_pan\" or \"pan_on_tilt\""),
            ("pan = [-100.0", "pan = [200", "expected [least, largest] in degrees, the smaller one first"),
            ("at_rest = 12.0", "at_rest = nan", "at_rest is nan, expected a finite number"),
            ("position = 1.0", "position = 0", "zoom stop 1 is at 0, expected more than 0"),
            ("principal_point_px = [319.0", "principal_point_px = [\"a\"", "principal_point_px[0] is \"a\""),
        ] {
            let text = match from.starts_with("principal") {
                // The heads stand at the end.
                true => good.rsplit_once(from).map(|(before, after)| format!("{before}{to}{after}")).unwrap(),
                false => good.replacen(from, to, 1),
            };
            assert_ne!(text, good, "{from}");
            let found = parse(&text).unwrap_err().to_string();
            assert!(found.contains(expected) && found.starts_with("lab.toml:"), "{expected} is not in\n{found}");
        }
        let text = plain().to_toml() + "\n[head.ptz-1]\npan_axis = { point_m = [0, 0, 0], direction = [0, 0, 0] }\n";
        let found = parse(&text).unwrap_err().to_string();
        assert!(found.contains("camera \"ptz-1\": direction is [0, 0, 0], expected three numbers that are not all 0"));
        assert!(found.contains("tilt_axis is missing"), "{found}");
        let text = text.replace("[0, 0, 0] }", "[0, 0, 1] }")
            + "tilt_device = { deg_per_unit = 0 }\nzoom = 3\nuncertainty = { covariance = [1] }\n";
        let found = parse(&text).unwrap_err().to_string();
        for expected in
            ["deg_per_unit is 0, expected a number other than 0", "zoom is 3", "covariance is [1], expected 16 rows"]
        {
            assert!(found.contains(expected), "{expected} is not in\n{found}");
        }
    }

    #[test]
    fn a_head_in_another_unit_has_its_lengths_changed() {
        let head = full().heads.0["ptz-1"].clone();
        let scaled = head.clone().scaled(0.001);
        assert!((scaled.pan.point - Point3::new(12e-6, 0.0, -55e-6)).norm() < 1e-15);
        assert_eq!(scaled.pan.direction, head.pan.direction);
        let [before, after] = [&head, &scaled].map(|it| it.covariance.clone().unwrap());
        let place = after.pan().place / before.pan().place;
        assert!((place - 0.001).abs() < 1e-9 && (after.pan().direction / before.pan().direction - 1.0).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(text in "(\\[head(\\.ptz-1)?\\]|pan_axis|zoom|=|\\PC|\n|\\[|\\]|\\{|nan|1e9|\"){0,30}") {
            let _ = parse(&format!("{}{text}", plain().to_toml()));
        }
    }
}
