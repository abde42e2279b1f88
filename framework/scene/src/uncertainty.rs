//! How well a calibration is known, and how it was made. Both are optional in a file:
//!
//! ```toml
//! [provenance]
//! method = "foveate calibrate, one waved light"
//! date = "2026-03-14"                        # as the caller gives it: nothing here reads a clock
//! sources = ["take_3.csv"]                   # the files it was made of
//! residual_median_px = 0.21
//! scale = { fixed_by = "wand of 0.4 m", sigma = 0.0005 }       # relative
//! gravity = { fixed_by = "a falling light", sigma = 0.002 }    # [rad]
//! origin = { fixed_by = "an L-frame", sigma = 0.001 }          # [m]; each may be left out: then it is not fixed
//!
//! [camera.wide-1.uncertainty]
//! focal_sigma_px = [0.8, 0.8]
//! principal_point_sigma_px = [1.2, 1.1]
//! distortion_sigma = { k1 = 0.002, k2 = 0.01, p1 = 1e-4, p2 = 1e-4, k3 = 0.0 }
//! pose_covariance = [                        # 6 x 6, rows: rotation [rad], translation [m]
//!   [4e-8, 0.0, 0.0, 0.0, 0.0, 0.0],
//!   # and five more
//! ]
//! ```
//!
//! The covariance is that of δ in `camera_from_world · exp(δ)`, δ = [rotation, translation] in the world's space, as
//! docs/notation.md fixes it for every pose.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use foveate_geometry::Distortion;
use nalgebra::Matrix6;
use toml::de::DeTable;

use crate::text::quoted;
use crate::toml_reader::{Reader, Value};

const PROVENANCE_KEYS: [&str; 7] = ["method", "date", "sources", "residual_median_px", "scale", "gravity", "origin"];
const FIXED_KEYS: [&str; 2] = ["fixed_by", "sigma"];
const CAMERA_KEYS: [&str; 4] = ["focal_sigma_px", "principal_point_sigma_px", "distortion_sigma", "pose_covariance"];
const DISTORTION_KEYS: [&str; 5] = ["k1", "k2", "p1", "p2", "k3"];

/// Two halves of a covariance may differ by so much of its largest element, and an eigenvalue may be negative by so much.
const COVARIANCE_TOLERANCE: f64 = 1e-9;

/// How well cameras are known, by their names.
pub type Uncertainties = BTreeMap<String, CameraUncertainty>;

/// How well a camera is known. What is `None` was not estimated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraUncertainty {
    /// Standard deviations of the focal lengths [px].
    pub focal_sigma_px: Option<[f64; 2]>,
    /// Standard deviations of the principal point [px].
    pub principal_point_sigma_px: Option<[f64; 2]>,
    /// Standard deviation of each coefficient.
    pub distortion_sigma: Option<Distortion>,
    /// Covariance of δ in `camera_from_world · exp(δ)`, rotation before translation [rad², rad m, m²].
    pub pose_covariance: Option<Matrix6<f64>>,
}

/// How a calibration was made.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Provenance {
    /// Program and method.
    pub method: String,
    /// When, in whatever form the caller gives.
    pub date: Option<String>,
    /// The files it was made of.
    pub sources: Vec<String>,
    /// Median distance between observations and where the calibration puts them [px].
    pub residual_median_px: Option<f64>,
    /// What fixed the scale; `sigma` is relative.
    pub scale: Option<Fixed>,
    /// What fixed the direction of Z; `sigma` in rad.
    pub gravity: Option<Fixed>,
    /// What fixed the place of the origin; `sigma` in m.
    pub origin: Option<Fixed>,
}

/// What fixes a degree of freedom that images alone do not determine, and how well.
#[derive(Debug, Clone, PartialEq)]
pub struct Fixed {
    /// Such as `a wand of 0.4 m`.
    pub by: String,
    /// Standard deviation, in the unit of the freedom; `None` where it is not known.
    pub sigma: Option<f64>,
}

impl CameraUncertainty {
    /// The section as it stands in a file, after the camera's; `key` is the camera's name as a TOML key.
    pub(crate) fn to_toml(self, key: &str) -> String {
        let mut text = format!("\n[camera.{key}.uncertainty]\n");
        let pairs =
            [("focal_sigma_px", self.focal_sigma_px), ("principal_point_sigma_px", self.principal_point_sigma_px)];
        for (name, value) in pairs.into_iter().filter_map(|(name, value)| Some((name, value?))) {
            let _ = writeln!(text, "{name} = {value:?}"); // writing to a String cannot fail
        }
        if let Some(Distortion { k1, k2, p1, p2, k3 }) = self.distortion_sigma {
            let _ = writeln!(
                text,
                "distortion_sigma = {{ k1 = {k1:?}, k2 = {k2:?}, p1 = {p1:?}, p2 = {p2:?}, k3 = {k3:?} }}"
            );
        }
        if let Some(covariance) = self.pose_covariance {
            text += "pose_covariance = [\n";
            for row in covariance.row_iter() {
                let _ = writeln!(text, "  {:?},", row.iter().collect::<Vec<_>>());
            }
            text += "]\n";
        }
        text
    }

    /// The same where every length is `factor` times as large.
    pub(crate) fn scaled(mut self, factor: f64) -> Self {
        if let Some(covariance) = &mut self.pose_covariance {
            covariance.fixed_rows_mut::<3>(3).scale_mut(factor);
            covariance.fixed_columns_mut::<3>(3).scale_mut(factor);
        }
        self
    }
}

impl Provenance {
    /// The section as it stands in a file, after an empty line.
    pub(crate) fn to_toml(&self) -> String {
        let sources: Vec<String> = self.sources.iter().map(|it| quoted(it)).collect();
        let mut text = format!("\n[provenance]\nmethod = {}\n", quoted(&self.method));
        // Writing to a String cannot fail.
        if let Some(date) = &self.date {
            let _ = writeln!(text, "date = {}", quoted(date));
        }
        let _ = writeln!(text, "sources = [{}]", sources.join(", "));
        if let Some(residual) = self.residual_median_px {
            let _ = writeln!(text, "residual_median_px = {residual:?}");
        }
        for (name, fixed) in [("scale", &self.scale), ("gravity", &self.gravity), ("origin", &self.origin)] {
            if let Some(Fixed { by, sigma }) = fixed {
                let sigma = sigma.map_or(String::new(), |it| format!(", sigma = {it:?}"));
                let _ = writeln!(text, "{name} = {{ fixed_by = {}{sigma} }}", quoted(by));
            }
        }
        text
    }
}

impl Reader<'_> {
    /// The section `provenance`; `None` when anything in it is wrong.
    pub(crate) fn provenance(&mut self, value: &Value<'_>) -> Option<Provenance> {
        let Some(table) = value.get_ref().as_table() else {
            return self.expect(None, value, "provenance", "a table such as [provenance]");
        };
        self.refuse_unknown(table, "key", &PROVENANCE_KEYS);
        let method = self.required(table, "method", "a text", value.span()).and_then(|it| self.text_of(it, "method"));
        let date = table.get("date").map(|it| self.text_of(it, "date"));
        let sources = table.get("sources").map_or(Some(Vec::new()), |value| {
            let list = value.get_ref().as_array();
            let list = self.expect(list, value, "sources", "a list of texts")?;
            list.iter().map(|it| self.text_of(it, "a source")).collect()
        });
        let residual = table.get("residual_median_px").map(|it| self.not_negative(it, "residual_median_px"));
        let [scale, gravity, origin] =
            ["scale", "gravity", "origin"].map(|key| table.get(key).map(|value| self.fixed(value, key)));
        Some(Provenance {
            method: method?,
            date: date.map_or(Some(None), |it| it.map(Some))?,
            sources: sources?,
            residual_median_px: residual.map_or(Some(None), |it| it.map(Some))?,
            scale: scale.map_or(Some(None), |it| it.map(Some))?,
            gravity: gravity.map_or(Some(None), |it| it.map(Some))?,
            origin: origin.map_or(Some(None), |it| it.map(Some))?,
        })
    }

    /// The key `uncertainty` of a camera; `None` when anything in it is wrong.
    pub(crate) fn uncertainty(&mut self, value: &Value<'_>) -> Option<CameraUncertainty> {
        let Some(table) = value.get_ref().as_table() else {
            return self.expect(None, value, "uncertainty", "a table such as [camera.wide-1.uncertainty]");
        };
        self.refuse_unknown(table, "key", &CAMERA_KEYS);
        let focal = self.sigmas(table, "focal_sigma_px");
        let principal = self.sigmas(table, "principal_point_sigma_px");
        let distortion = table.get("distortion_sigma").map(|value| self.distortion_sigma(value));
        let covariance = table.get("pose_covariance").map(|value| self.covariance(value));
        Some(CameraUncertainty {
            focal_sigma_px: focal.map_or(Some(None), |it| it.map(Some))?,
            principal_point_sigma_px: principal.map_or(Some(None), |it| it.map(Some))?,
            distortion_sigma: distortion.map_or(Some(None), |it| it.map(Some))?,
            pose_covariance: covariance.map_or(Some(None), |it| it.map(Some))?,
        })
    }

    fn fixed(&mut self, value: &Value<'_>, key: &str) -> Option<Fixed> {
        let Some(table) = value.get_ref().as_table() else {
            return self.expect(None, value, key, "a table such as { fixed_by = \"a wand\", sigma = 0.001 }");
        };
        self.refuse_unknown(table, "key", &FIXED_KEYS);
        let by = self.required(table, "fixed_by", "a text", value.span()).and_then(|it| self.text_of(it, "fixed_by"));
        let sigma = table.get("sigma").map(|it| self.not_negative(it, "sigma"));
        Some(Fixed { by: by?, sigma: sigma.map_or(Some(None), |it| it.map(Some))? })
    }

    /// `None` where the key is not there, `Some(None)` where it is wrong.
    fn sigmas(&mut self, table: &DeTable<'_>, key: &str) -> Option<Option<[f64; 2]>> {
        let value = table.get(key)?;
        let numbers = self.numbers::<2>(table, key, value.span());
        Some(numbers.and_then(|numbers| {
            let fine = numbers.iter().all(|it| *it >= 0.0).then_some(numbers);
            self.expect(fine, value, key, "two numbers of 0 or more")
        }))
    }

    fn distortion_sigma(&mut self, value: &Value<'_>) -> Option<Distortion> {
        let Some(table) = value.get_ref().as_table() else {
            return self.expect(None, value, "distortion_sigma", "a table such as { k1 = 0.01 }");
        };
        self.refuse_unknown(table, "key of distortion_sigma", &DISTORTION_KEYS);
        let [k1, k2, p1, p2, k3] =
            DISTORTION_KEYS.map(|key| table.get(key).map_or(Some(0.0), |value| self.not_negative(value, key)));
        Some(Distortion { k1: k1?, k2: k2?, p1: p1?, p2: p2?, k3: k3? })
    }

    fn covariance(&mut self, value: &Value<'_>) -> Option<Matrix6<f64>> {
        let what = "pose_covariance";
        let expected = "6 rows of 6 numbers, symmetric and without negative eigenvalues";
        let rows = value.get_ref().as_array().filter(|rows| rows.len() == 6);
        let rows = self.expect(rows, value, what, expected)?;
        let mut covariance = Matrix6::zeros();
        for (index, row) in rows.iter().enumerate() {
            let list = row.get_ref().as_array().filter(|list| list.len() == 6);
            for (column, item) in self.expect(list, row, "a row of pose_covariance", "6 numbers")?.iter().enumerate() {
                covariance[(index, column)] = self.number(item, &format!("{what}[{index}][{column}]"))?;
            }
        }
        let slack = COVARIANCE_TOLERANCE * covariance.amax();
        let symmetric = (covariance - covariance.transpose()).amax() <= slack;
        let fine = symmetric && covariance.symmetric_eigenvalues().min() >= -slack;
        self.expect(fine.then_some(covariance), value, what, expected)
    }

    fn not_negative(&mut self, value: &Value<'_>, what: &str) -> Option<f64> {
        let number = self.number(value, what)?;
        self.expect((number >= 0.0).then_some(number), value, what, "a number of 0 or more")
    }

    fn text_of(&mut self, value: &Value<'_>, what: &str) -> Option<String> {
        let text = value.get_ref().as_str().map(str::to_owned);
        self.expect(text, value, what, "a text")
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use foveate_geometry::Camera;
    use nalgebra::Point3;
    use proptest::prelude::*;

    use super::*;
    use crate::{Calibration, CalibrationError, LengthUnit, NamedCamera};

    fn plain() -> Calibration {
        let camera = Camera::look_at(Point3::new(1.0, -2.0, 2.5), Point3::origin(), [640, 480], 520.0);
        let cameras = vec![NamedCamera { name: "wide 1".into(), camera }];
        Calibration::new(cameras, LengthUnit::Metre, "a test".into()).unwrap()
    }

    fn full() -> Calibration {
        let fixed = |by: &str, sigma| Some(Fixed { by: by.into(), sigma });
        let provenance = Provenance {
            method: "by \"hand\"".into(),
            date: Some("2026-03-14".into()),
            sources: vec!["a.csv".into(), "b\\c.csv".into()],
            residual_median_px: Some(0.21),
            scale: fixed("a wand of 0.4 m", Some(5e-4)),
            gravity: fixed("a falling light", None),
            origin: None,
        };
        let root = Matrix6::from_fn(|row, column| 1e-3 * ((row * 5 + column * 3) as f64).sin());
        let covariance = root * root.transpose();
        let uncertainty = CameraUncertainty {
            focal_sigma_px: Some([0.8, 0.9]),
            principal_point_sigma_px: Some([1.2, 0.0]),
            distortion_sigma: Some(Distortion { k1: 0.002, k2: 0.01, p1: 1e-4, p2: 2e-4, k3: 0.0 }),
            pose_covariance: Some((covariance + covariance.transpose()) / 2.0),
        };
        let uncertainties = Uncertainties::from([("wide 1".to_owned(), uncertainty)]);
        Calibration { provenance: Some(provenance), uncertainties, ..plain() }
    }

    fn parse(text: &str) -> Result<Calibration, CalibrationError> {
        Calibration::from_toml(text, Path::new("lab.toml"))
    }

    #[test]
    fn what_is_known_of_a_calibration_comes_back_to_the_last_bit() {
        let (saved, loaded) = (full(), parse(&full().to_toml()).unwrap());
        assert_eq!(loaded.provenance, saved.provenance);
        assert_eq!(loaded.uncertainties, saved.uncertainties);
        assert!(!plain().to_toml().contains("provenance") && !plain().to_toml().contains("uncertainty"));
    }

    #[test]
    fn every_fault_is_named_with_its_place() {
        let good = full().to_toml();
        for (from, to, expected) in [
            ("method = ", "methods = ", "unknown key \"methods\", expected method (did you mean that?)"),
            ("date = \"2026-03-14\"", "date = 2026-03-14", "date is 2026-03-14, expected a text"),
            ("[\"a.csv\"", "[3", "a source is 3, expected a text"),
            ("= 0.21", "= -0.21", "residual_median_px is -0.21, expected a number of 0 or more"),
            ("sigma = 0.0005", "sigma = nan", "sigma is nan, expected a finite number"),
            ("fixed_by = \"a falling light\"", "sigma = 1", "fixed_by is missing"),
            ("[0.8, 0.9]", "[0.8, -0.9]", "focal_sigma_px is [0.8, -0.9], expected two numbers of 0 or more"),
            ("[1.2, 0.0]", "[1.2]", "principal_point_sigma_px is [1.2], expected 2 numbers"),
            ("k1 = 0.002", "k4 = 0.002", "unknown key of distortion_sigma \"k4\""),
            ("pose_covariance = [\n", "pose_covariance = [[1],\n", "pose_covariance is "),
            ("pose_covariance = [\n", "pose_covariances = [\n", "unknown key \"pose_covariances\""),
        ] {
            assert!(good.contains(from), "{from}: {good}");
            let error = parse(&good.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(error.starts_with("lab.toml:") && error.contains(expected), "{expected}: {error}");
        }
    }

    #[test]
    fn a_matrix_that_is_no_covariance_is_refused() {
        let refuses = |change: &dyn Fn(&mut Matrix6<f64>)| {
            let mut calibration = full();
            let uncertainty = calibration.uncertainties.get_mut("wide 1").unwrap();
            change(uncertainty.pose_covariance.as_mut().unwrap());
            let error = parse(&calibration.to_toml()).unwrap_err().to_string();
            assert!(error.contains("pose_covariance"), "{error}");
        };
        refuses(&|it| it[(0, 1)] *= 1.001);
        refuses(&|it| *it = -*it);
        refuses(&|it| it[(2, 2)] = f64::INFINITY);
    }

    proptest! {
        #[test]
        fn lengths_in_a_covariance_follow_the_scale(factor in 1e-3..1e3) {
            let before = full().uncertainties["wide 1"];
            let (before, after) = (before.pose_covariance.unwrap(), before.scaled(factor).pose_covariance.unwrap());
            for (row, column) in (0..36).map(|it| (it / 6, it % 6)) {
                let lengths = i32::from(row > 2) + i32::from(column > 2);
                let expected = before[(row, column)] * factor.powi(lengths);
                prop_assert!((after[(row, column)] - expected).abs() <= 1e-12 * expected.abs());
            }
        }
    }
}
