//! `structured_light.decoder`: which projector position lights each camera pixel.
//!
//! 1. The set is examined: faults are reported with the names of the pictures, and an axis that cannot be decoded is left out.
//! 2. Where something changed during the set, nothing is decoded.
//! 3. Stripes are decoded; then coordinates come from the boundaries between them, or from the phase.
//!
//! | file | what it does |
//! |---|---|
//! | `set` | all three steps for one set |
//! | `creep` | a set whose camera drifted so far that it looks like one of another scene |
//! | `levels` | coordinates by all bits, or by those that the camera resolves |
//! | `words` | messages about a set |

mod creep;
mod levels;
mod set;
mod words;

use foveate::imaging::stripes::EdgeOptions;
use foveate::imaging::stripes::code::{Shown, StripeCode};
use foveate::imaging::stripes::gray::{DecodeOptions, Decoded};
use foveate::imaging::stripes::phase::Steps;
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::set::Map;
use crate::pattern::{PatternSettings, calibrated_size, projector_of};

ports! {
    pub(crate) fn declared_ports;
    PICTURES: In<PatternPictures> = each("pictures");
    MAP: Out<ProjectorMap> = "map";
    WHITE: Out<Image> = "white";
}

figures! {
    "decoder.sets.*": count, high, "Sets of pictures of the camera with at least one decoded axis";
    "decoder.sets_refused.*": count, low, "Sets of pictures of the camera that could not be decoded";
    "decoder.faults.*": count, low, "Faults of sets of pictures of the camera, each named in a remark, or at the gap of a refused set";
    "decoder.known_share.*": share, high, "Pixels of the camera with a projector coordinate over those that the projector lights, over all sets that were decoded";
}

/// Settings of [`Decoder`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DecoderSettings {
    /// The projector's name in the calibration, for its size [–]
    pub projector: String,
    /// The patterns, where there is no `patterns.toml` beside the pictures [–]
    pub pattern: PatternSettings,
    /// Whether `pattern` is used even where there is a `patterns.toml` beside the pictures [–]
    pub ignore_manifest: bool,
    /// White − black, at least: less is shadow, or not reached by the projector [gray level]
    #[schemars(range(min = 1, max = 254))]
    pub min_contrast: u8,
    /// Difference of a picture and its inverse, at least: three standard deviations of a camera with noise of one gray level, and rounding [gray level]
    #[schemars(range(min = 1, max = 127))]
    pub min_difference: u8,
    /// Direct light over all light that the projector brings to a pixel, at least; below a half other surfaces may have turned a bit [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_direct: f64,
    /// Noise of the camera, standard deviation, at least: more, where the pictures themselves show more [gray level]
    #[schemars(range(min = 0.05, max = 50.0))]
    pub noise: f64,
    /// Worker threads for one set [–]
    #[schemars(range(min = 1, max = 64))]
    pub threads: usize,
}

impl Default for DecoderSettings {
    fn default() -> Self {
        let (decode, edges) = (DecodeOptions::default(), EdgeOptions::default());
        Self {
            projector: "projector".to_owned(),
            pattern: PatternSettings::default(),
            ignore_manifest: false,
            min_contrast: decode.min_contrast,
            min_difference: decode.min_difference,
            min_direct: decode.min_direct,
            noise: edges.noise,
            threads: 2,
        }
    }
}

/// Sets of pictures in, projector coordinates of camera pixels out, with the white picture of the set before them.
pub struct Decoder {
    settings: DecoderSettings,
    camera_name: String,
    camera_size: Option<[u32; 2]>,
    projector_size: Option<[u32; 2]>,
    /// From the settings; none where only a manifest says it.
    code: Option<StripeCode>,
    decoded: Decoded,
    /// The finest bits of columns and rows, so many, without which it was decoded.
    level: [u32; 2],
    /// Part of the pixels whose phase steps are on no wave [–].
    off_wave: f64,
    exchanged: [Option<[u32; 2]>; 2],
    /// Pictures of the set that is decoded which follow from others.
    worked_out: Vec<Shown>,
    /// By axis how phase steps stand.
    steps: [Steps; 2],
    sets: u64,
    refused: u64,
    faults: Vec<String>,
    /// Of sets that are refused: how many faults, and those of the first.
    n_refused_faults: usize,
    remarks: Vec<String>,
    known: u64,
    lit: u64,
}

impl Node for Decoder {
    const TYPE: &'static str = "structured_light.decoder";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Decodes pattern sets: which projector position lights each camera pixel";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = DecoderSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: DecoderSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("min_contrast", settings.min_contrast, 1..=254)?;
        ConfigError::unless_in("min_difference", settings.min_difference, 1..=127)?;
        ConfigError::unless_in("min_direct", settings.min_direct, 0.0..=1.0)?;
        ConfigError::unless_in("noise", settings.noise, 0.05..=50.0)?;
        ConfigError::unless_in("threads", settings.threads, 1..=64)?;
        let projector_size = calibrated_size(setup, &settings.projector);
        let is_named = settings.projector != crate::pattern::default_projector();
        if is_named && !setup.calibration.cameras.is_empty() {
            projector_of(setup, &settings.projector)?;
        }
        let says_size = settings.pattern.projector_px != [0, 0];
        let code = match settings.pattern.stripe_code(projector_size) {
            Ok(code) => Some(code),
            Err(fault) if fault.setting.as_deref() == Some("projector_px") && !says_size => None,
            Err(fault) => {
                let setting = fault.setting.as_deref().map(|it| format!("pattern.{it}"));
                return Err(ConfigError { setting, ..fault });
            }
        };
        Ok(Self {
            camera_name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            camera_size: setup.camera_model().map(|it| it.image_size),
            settings,
            projector_size,
            code,
            decoded: Decoded::default(),
            level: [0; 2],
            off_wave: 0.0,
            exchanged: [None; 2],
            worked_out: Vec::new(),
            steps: Default::default(),
            sets: 0,
            refused: 0,
            faults: Vec::new(),
            n_refused_faults: 0,
            remarks: Vec::new(),
            known: 0,
            lit: 0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(set) = io.take(&PICTURES) else { return Ok(()) };
        match self.decode(&set.value) {
            Ok(Map { map, white, lit, faults }) => {
                self.sets += 1;
                self.known += u64::from(map.n_known);
                self.lit += lit;
                self.faults.extend(faults.into_iter().map(|it| of_set(&set.value, it)));
                let (width, height, camera) = (map.width, map.height, map.camera);
                let white = Image { camera, width, height, pixels: white, ..Image::default() };
                io.emit(&WHITE, set.stamp, white);
                io.emit(&MAP, set.stamp, map);
            }
            Err(faults) => {
                self.refused += 1;
                self.n_refused_faults += faults.len();
                let faults: Vec<String> = faults.into_iter().map(|it| of_set(&set.value, it)).collect();
                let reason = faults.join("; ");
                // A gap tells it: it is no remark too.
                io.gap(&MAP, set.time(), reason);
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let name = &self.camera_name;
        report.figure(format!("decoder.sets.{name}"), self.sets as f64);
        report.figure(format!("decoder.sets_refused.{name}"), self.refused as f64);
        report.figure(format!("decoder.faults.{name}"), (self.faults.len() + self.n_refused_faults) as f64);
        report.figure(format!("decoder.known_share.{name}"), self.known as f64 / self.lit as f64);
        self.faults.iter().chain(&self.remarks).for_each(|it| report.remark(it.clone()));
        Ok(())
    }
}

impl Decoder {
    fn code_of(&mut self, set: &PatternPictures) -> Result<StripeCode, String> {
        if !set.manifest.is_empty() && !self.settings.ignore_manifest {
            let manifest = PatternSettings::read(&set.manifest);
            if let Ok(manifest) = &manifest
                && self.settings.pattern != PatternSettings::default()
            {
                let differences = manifest.differences(&self.settings.pattern);
                let remark = format!(
                    "`{}/{}` is used, which differs from `pattern`: {}; set `ignore_manifest` to use the settings instead",
                    set.name,
                    crate::pattern::MANIFEST,
                    differences.join(", ")
                );
                if !differences.is_empty() && self.remarks.is_empty() {
                    self.remarks.push(remark);
                }
            }
            let code = manifest.and_then(|it| it.stripe_code(None).map_err(|fault| fault.message));
            let code = code.map_err(|fault| format!("`{}/{}`: {fault}", set.name, crate::pattern::MANIFEST))?;
            if code.frames > 0 {
                return Err(format!(
                    "`{}`: found a boundary code, expected a static one: `structured_light.boundaries` reads it",
                    set.name
                ));
            }
            if let Some(size) = self.projector_size.filter(|it| *it != code.projector) {
                let [found, expected] = [code.projector, size].map(|[columns, rows]| format!("{columns} x {rows} px"));
                let name = &self.settings.projector;
                return Err(format!(
                    "the patterns are for a projector of {found}, expected {expected} as `{name}` in the calibration"
                ));
            }
            return Ok(code);
        }
        self.code.clone().ok_or_else(|| {
            let name = &self.settings.projector;
            format!(
                "the size of the projector is unknown: expected `pattern.projector_px`, or `{name}` in the calibration"
            )
        })
    }
}

/// What is said of a set, with its name before it unless it names the set's pictures or files anyway.
fn of_set(set: &PatternPictures, fault: String) -> String {
    let prefix = format!("`{}/", set.name);
    if fault.contains(&prefix) { fault } else { format!("{}: {fault}", set.name) }
}

#[cfg(test)]
mod tests;
