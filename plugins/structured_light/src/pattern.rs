//! The patterns and their order: settings of nodes, and the file `patterns.toml` that `foveate patterns` writes beside its pictures.

use foveate::imaging::ImagingError;
use foveate::imaging::stripes::code::{Axis, Group, Inverse, StripeCode};
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Name of the file beside pictures that states which patterns they show.
pub const MANIFEST: &str = "patterns.toml";

/// The code that patterns carry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Code {
    /// Gray code down to single projector pixels.
    #[default]
    Gray,
    /// A phase shift on top of a Gray code whose stripes are half a period wide.
    Phase,
    /// A stripe boundary code, for what moves: four pictures, shown again and again.
    Boundary,
}

/// Where the inverse picture of a bit stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum InversePictures {
    /// Right after it.
    #[default]
    After,
    /// Right before it.
    Before,
    /// After all bits of its axis.
    Apart,
    /// After all bits of both axes.
    Last,
    /// There are none: the mean of white and black is the threshold.
    None,
}

/// Patterns and their order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PatternSettings {
    /// Columns and rows of the projector; 0, 0: those of the projector in the calibration [px]
    pub projector_px: [u32; 2],
    /// What the patterns carry: `gray`, `phase` or `boundary` [–]
    pub code: Code,
    /// Order of the groups of pictures, each at most once: `columns` (the bits that encode the column), `rows`, `white`, `black`; a boundary code uses only the first of `columns` and `rows` [–]
    pub order: String,
    /// Where the inverse of a bit stands: `after` it, `before` it, `apart` (after all bits of its axis), `last` (after all bits of both axes), `none` [–]
    pub inverse: InversePictures,
    /// Whether the finest stripes of an axis come first [–]
    pub fine_first: bool,
    /// Whether the middle of the code is the middle of the projector, rather than its beginning the first column (row); of effect where these are no power of two [–]
    pub centred: bool,
    /// Bits of columns and of rows; 0: as many as needed. Fewer leave the finest out [–]
    pub bits: [u32; 2],
    /// Steps of a phase shift [–]
    #[schemars(range(min = 3, max = 32))]
    pub steps: u32,
    /// Period of a phase shift: a power of two, at least 4 [px]
    #[schemars(range(min = 4, max = 1024))]
    pub period_px: u32,
    /// Width of a stripe of a boundary code [px]
    #[schemars(range(min = 2, max = 1024))]
    pub stripe_px: u32,
}

impl Default for PatternSettings {
    /// As OpenCV's `GrayCodePattern` and most programs that use it.
    fn default() -> Self {
        Self {
            projector_px: [0, 0],
            code: Code::Gray,
            order: "columns rows white black".to_owned(),
            inverse: InversePictures::After,
            fine_first: false,
            centred: false,
            bits: [0, 0],
            steps: 4,
            period_px: 16,
            stripe_px: 4,
        }
    }
}

impl PatternSettings {
    /// Reads the text of a `patterns.toml`.
    ///
    /// # Errors
    /// What is wrong with it, with its place.
    pub fn read(text: &str) -> Result<PatternSettings, String> {
        let settings: PatternSettings = toml::from_str(text).map_err(|fault| fault.to_string())?;
        settings.stripe_code(None).map_err(|fault| fault.message)?;
        Ok(settings)
    }

    /// The code, for a projector of `calibrated` columns and rows where the settings do not state them.
    ///
    /// # Errors
    /// Names the setting, what was found and what is expected.
    pub fn stripe_code(&self, calibrated: Option<[u32; 2]>) -> Result<StripeCode, ConfigError> {
        let size = match (self.projector_px, calibrated) {
            ([columns, rows], Some(calibrated)) if ![[0, 0], calibrated].contains(&[columns, rows]) => {
                let [width, height] = calibrated;
                let message = format!(
                    "found {columns} x {rows} px, expected {width} x {height} px as the projector in the calibration"
                );
                return Err(ConfigError::at("projector_px", message));
            }
            ([0, 0], Some(size)) => size,
            ([0, 0], None) => {
                let message =
                    "found no size of the projector, expected its columns and rows, or a projector in the calibration";
                return Err(ConfigError::at("projector_px", message));
            }
            (size, _) => size,
        };
        let order = Group::order(&self.order).map_err(|it| ConfigError::at("order", it))?;
        let inverse = match self.inverse {
            InversePictures::After => Inverse::After,
            InversePictures::Before => Inverse::Before,
            InversePictures::Apart => Inverse::Apart,
            InversePictures::Last => Inverse::Last,
            InversePictures::None => Inverse::None,
        };
        let code = match self.code {
            Code::Gray => {
                let bits = self.bits.map(|it| Some(it).filter(|it| *it > 0));
                StripeCode::gray(size).with_bits(bits, self.centred)
            }
            Code::Phase => {
                if !self.period_px.is_power_of_two() || self.period_px < 4 {
                    let message = format!("found {}, expected a power of two, at least 4", self.period_px);
                    return Err(ConfigError::at("period_px", message));
                }
                if self.centred || self.bits != [0, 0] {
                    let message = "found a phase shift with `centred` or `bits`, expected neither: its Gray code follows from the period";
                    return Err(ConfigError::at("code", message));
                }
                StripeCode::phase(size, self.steps, self.period_px)
            }
            Code::Boundary => {
                let code = StripeCode::boundary(size, self.stripe_px, &order);
                code.check().map_err(|fault| ConfigError::at("stripe_px", fault))?;
                return Ok(code);
            }
        };
        self.check_order(&order)?;
        check_size(size, &order, &code)?;
        let code = StripeCode { order, inverse, fine_first: self.fine_first, ..code };
        code.check().map_err(|fault| {
            let setting = match &fault {
                ImagingError::Setting { name: "projector", .. } => "projector_px",
                ImagingError::Setting { name: "period", .. } => "period_px",
                ImagingError::Setting { name, .. } => name,
                _ => "order",
            };
            ConfigError::at(setting, fault)
        })?;
        Ok(code)
    }

    fn check_order(&self, order: &[Group]) -> Result<(), ConfigError> {
        let found = &self.order;
        let fault = |expected: &str| Err(ConfigError::at("order", format!("found \"{found}\", expected {expected}")));
        if !order.iter().any(|it| matches!(it, Group::Stripes(_))) {
            return fault("`columns`, `rows` or both among its words");
        }
        if order.iter().enumerate().any(|(at, it)| order[..at].contains(it)) {
            return fault("each word at most once");
        }
        let has_both = [Group::White, Group::Black].iter().all(|it| order.contains(it));
        if self.inverse == InversePictures::None && !has_both {
            return fault("`white` and `black` among its words: without inverse pictures they are the threshold");
        }
        Ok(())
    }

    /// What differs from `other`, a setting each, as they are written.
    pub(crate) fn differences(&self, other: &PatternSettings) -> Vec<String> {
        let tables = [self, other].map(|it| toml::Table::try_from(it).unwrap_or_default());
        let one = |(key, value): (&String, &toml::Value)| {
            let is_stated = key != "projector_px" || other.projector_px != [0, 0];
            let theirs = tables[1].get(key).filter(|it| *it != value && is_stated)?;
            Some(format!("{key} = {value} rather than {theirs}"))
        };
        tables[0].iter().filter_map(one).collect()
    }
}

/// Columns (rows) that a code numbers, at least: with fewer, pictures show one stripe or none, and columns cannot be distinguished [px].
const LEAST_SIDE: u32 = 4;

/// Whether the pictures of each axis that is shown have stripes: sides of some pixels, and wider than a stripe of the coarsest bit's.
fn check_size(size: [u32; 2], order: &[Group], code: &StripeCode) -> Result<(), ConfigError> {
    for axis in Axis::BOTH.into_iter().filter(|it| order.contains(&Group::Stripes(*it))) {
        let (found, stripe) = (size[axis.index()], code.stripe[axis.index()]);
        let least = LEAST_SIDE.max(stripe + 1);
        if found < least {
            let [columns, rows] = size;
            let why = match code.steps {
                0 => String::new(),
                _ => format!(" with stripes of {stripe} px, half a period, below the phase shift"),
            };
            let message = format!(
                "found {columns} x {rows} px, expected at least {least} {}{why}: pictures of fewer show no stripes",
                axis.in_words()
            );
            return Err(ConfigError::at("projector_px", message));
        }
    }
    Ok(())
}

/// Default name of the projector in calibrations.
pub(crate) fn default_projector() -> String {
    "projector".to_owned()
}

/// Which camera of the calibration of `setup` the projector called `name` is.
///
/// # Errors
/// The setting `projector`, where there is none of that name.
pub(crate) fn projector_of(setup: &Setup, name: &str) -> Result<usize, ConfigError> {
    let found = setup.calibration.index_of(name);
    if let Some(at) = found.filter(|it| setup.camera.is_some_and(|camera| usize::from(camera.0) == *it)) {
        let others = setup.calibration.cameras.iter().enumerate().filter(|it| it.0 != at);
        let others: Vec<&str> = others.map(|it| it.1.name.as_str()).collect();
        let expected =
            if others.is_empty() { "a projector beside it in the calibration".to_owned() } else { others.join(", ") };
        let message = format!("found `{name}`, the camera itself, expected the projector that it sees: {expected}");
        return Err(ConfigError::at("projector", message));
    }
    found.ok_or_else(|| {
        let names: Vec<&str> = setup.calibration.cameras.iter().map(|it| it.name.as_str()).collect();
        let message = format!("found no camera `{name}` in the calibration, expected one of: {}", names.join(", "));
        ConfigError::at("projector", message)
    })
}

/// The size of the projector called `name` in the calibration of `setup`.
pub(crate) fn calibrated_size(setup: &Setup, name: &str) -> Option<[u32; 2]> {
    setup.calibration.camera(name).map(|it| it.image_size)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(settings: PatternSettings) -> (Option<String>, String) {
        let fault = settings.stripe_code(None).unwrap_err();
        (fault.setting, fault.message)
    }

    #[test]
    fn settings_of_several_programs_make_their_codes() {
        let opencv = PatternSettings::default().stripe_code(Some([1024, 768])).unwrap();
        assert_eq!(opencv, StripeCode::gray([1024, 768]));
        let other = PatternSettings {
            projector_px: [1280, 800],
            order: "white black columns rows".to_owned(),
            centred: true,
            ..PatternSettings::default()
        };
        let code = other.stripe_code(None).unwrap();
        assert_eq!((code.bits, code.offset, code.pictures().len()), ([11, 10], [384, 112], 44));
        let back = PatternSettings::read(&toml::to_string(&other).unwrap()).unwrap();
        assert_eq!(back, other);
    }

    #[test]
    fn what_cannot_be_is_named() {
        let good = PatternSettings { projector_px: [64, 48], ..PatternSettings::default() };
        assert_eq!(refused(PatternSettings::default()).0.as_deref(), Some("projector_px"));
        assert!(refused(PatternSettings { order: "columns grey".into(), ..good.clone() }).1.contains("found `grey`"));
        assert!(refused(PatternSettings { order: "columns columns".into(), ..good.clone() }).1.contains("once"));
        for (size, code, expected) in [
            ([1, 1], Code::Gray, "found 1 x 1 px, expected at least 4 columns: pictures of fewer"),
            ([64, 2], Code::Gray, "found 64 x 2 px, expected at least 4 rows"),
            ([8, 64], Code::Phase, "found 8 x 64 px, expected at least 9 columns with stripes of 8 px, half a period"),
        ] {
            let (setting, message) =
                refused(PatternSettings { projector_px: size, code, ..PatternSettings::default() });
            assert_eq!(setting.as_deref(), Some("projector_px"));
            assert!(message.contains(expected), "{message}");
        }
        let columns = PatternSettings { projector_px: [4, 1], order: "columns".into(), ..PatternSettings::default() };
        assert_eq!(columns.stripe_code(None).map(|it| it.bits[0]), Ok(2));
        let period = PatternSettings { code: Code::Phase, period_px: 12, ..good.clone() };
        assert_eq!(refused(period).0.as_deref(), Some("period_px"));
        let one = |order: &str, inverse| PatternSettings { order: order.into(), inverse, ..good.clone() };
        let fault = refused(one("white black", InversePictures::After)).1;
        assert!(fault.contains("found \"white black\", expected `columns`"), "{fault}");
        assert!(refused(one("columns white", InversePictures::None)).1.contains("expected `white` and `black`"));
        let bits = PatternSettings { bits: [20, 8], ..good.clone() };
        assert_eq!(refused(bits).0.as_deref(), Some("bits"));
        let steps = PatternSettings { code: Code::Phase, steps: 2, ..good.clone() };
        assert_eq!(refused(steps).0.as_deref(), Some("steps"));
        let other = good.stripe_code(Some([64, 50])).unwrap_err();
        assert!(other.message.contains("found 64 x 48 px, expected 64 x 50 px"), "{}", other.message);
        assert_eq!(good.differences(&one("rows columns", InversePictures::After)).len(), 1);
        let thin = PatternSettings { code: Code::Boundary, stripe_px: 1, ..good.clone() };
        assert_eq!(refused(thin).0.as_deref(), Some("stripe_px"));
        assert!(PatternSettings::read("projektor_px = [4, 4]").unwrap_err().contains("projektor_px"));
    }

    #[test]
    fn the_camera_is_not_its_own_projector() {
        let calibration = std::sync::Arc::new(foveate_testkit::scene::ring_calibration(2));
        let setup = Setup { calibration, camera: Some(CameraId(0)), ..Setup::for_tests() };
        let fault = projector_of(&setup, "ring-1").unwrap_err();
        assert!(
            fault.message.contains("found `ring-1`, the camera itself, expected the projector that it sees: ring-2")
        );
        assert_eq!((fault.setting.as_deref(), projector_of(&setup, "ring-2").unwrap()), (Some("projector"), 1));
    }
}
