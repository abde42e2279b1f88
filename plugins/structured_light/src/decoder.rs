//! `structured_light.decoder`: where in the projector each camera pixel is lit from.
//!
//! 1. The set is examined: what is wrong with it is said with the names of its pictures, and an axis that it spoils is left out.
//! 2. Where something changed during the set, nothing is decoded.
//! 3. Stripes are decoded; then coordinates come from the boundaries between them, or from the phase.

mod creep;
mod words;

use std::borrow::Cow;

use foveate::imaging::ImageView;
use foveate::imaging::stripes::code::{Axis, Shown, StripeCode};
use foveate::imaging::stripes::drift::drift;
use foveate::imaging::stripes::ends::leave_out_soft_ends;
use foveate::imaging::stripes::finest::TooFine;
use foveate::imaging::stripes::gray::{DecodeOptions, Decoded, decode_into};
use foveate::imaging::stripes::phase::{PhaseOptions, Steps};
use foveate::imaging::stripes::steady::Steadied;
use foveate::imaging::stripes::{Coordinates, EdgeOptions, Prepared, edges, examine, phase, response};
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::creep::{crept, has_moved};
use self::words::{
    crept_in_words, exchanged_in_words, lacking_finest_in_words, moved_a_little_in_words, out_of_focus_in_words,
    soft_in_words, steps_in_words, too_fine_in_words,
};
use crate::moved::Blocks;
use crate::pattern::{PatternSettings, calibrated_size, projector_of};

ports! {
    pub(crate) fn declared_ports;
    PICTURES: In<PatternPictures> = each("pictures");
    MAP: Out<ProjectorMap> = "map";
    WHITE: Out<Image> = "white";
}

figures! {
    "decoder.sets.*": count, high, "Sets of pictures of the camera of which at least one axis was decoded";
    "decoder.sets_refused.*": count, low, "Sets of pictures of the camera of which nothing could be decoded";
    "decoder.faults.*": count, low, "What was wrong with sets of pictures of the camera, each named in a remark, or at the gap of a set that is refused";
    "decoder.known_share.*": share, high, "Pixels of the camera with a projector coordinate over those that the projector lights, over all sets that were decoded";
}

/// What a set is taken to have changed by in a block of the picture: more than this [gray level], and this part of white and black together. More than the collector allows: cameras of others are
/// not linear, and pack pictures.
const CHANGE: [f32; 2] = [6.0, 0.04];
/// Changed blocks over lit ones that are worth a remark.
const CHANGED_SHARE: f64 = 0.005;

/// Pictures that are named one by one.
const NAMED: usize = 6;
/// Bits beyond those that are too fine all over the picture, without which pixels are tried that cannot be decoded with them.
const COARSER: u32 = 2;
/// Where nothing else is said of a set, fewer known pixels over lit ones than this are worth a remark [–].
const SCARCE: f64 = 0.25;
/// Phase steps that are on no wave are told at more than this part of the pixels [–].
const OFF_WAVE: f64 = 0.2;
/// Where noise decides, fewer known pixels over lit ones than this are worth a remark [–].
const NOISY: f64 = 0.6;
/// Settings of [`Decoder`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DecoderSettings {
    /// The projector's name in the calibration, for its size [–]
    pub projector: String,
    /// The patterns, where no `patterns.toml` lies beside the pictures [–]
    pub pattern: PatternSettings,
    /// Whether `pattern` holds even where a `patterns.toml` lies beside the pictures [–]
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
    first_refusal: Option<String>,
    remarks: Vec<String>,
    known: u64,
    lit: u64,
}

/// What is decoded of a set.
struct Map {
    map: ProjectorMap,
    white: Vec<u8>,
    lit: u64,
    faults: Vec<String>,
}

impl Node for Decoder {
    const TYPE: &'static str = "structured_light.decoder";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Finds where in the projector each pixel of a camera is lit from";
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
            first_refusal: None,
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
                self.first_refusal.get_or_insert_with(|| reason.clone());
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
        if self.sets == 0 && self.refused > 0 {
            let first = self.first_refusal.as_deref().unwrap_or_default();
            let n = self.refused;
            return Err(NodeError::input(format!("none of {n} sets of pictures could be decoded: {first}")));
        }
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
                    "`{}/{}` holds, which says otherwise than `pattern`: {}; `ignore_manifest` takes the settings",
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
            format!("nothing says the size of the projector: expected `pattern.projector_px`, or `{name}` in the calibration")
        })
    }

    fn decode(&mut self, set: &PatternPictures) -> Result<Map, Vec<String>> {
        let one = |fault: String| vec![fault];
        let code = self.code_of(set).map_err(one)?;
        let (width, height) = (set.width as usize, set.height as usize);
        if let Some([columns, rows]) = self.camera_size.filter(|it| *it != [set.width, set.height]) {
            let fault = format!(
                "the pictures are {width} x {height} px, expected {columns} x {rows} px as the camera in the calibration"
            );
            return Err(one(fault));
        }
        let views: Vec<ImageView<'_>> = (0..set.names.len())
            .map(|it| ImageView::new(set.picture(it).unwrap_or_default(), width, height))
            .collect::<Result<_, _>>()
            .map_err(|fault| one(fault.to_string()))?;
        let exponent = response::exponent(&code, &views);
        let straight: Vec<Vec<u8>> = exponent
            .map(|it| views.iter().map(|view| response::straightened(view.pixels(), it)).collect())
            .unwrap_or_default();
        let views = if straight.is_empty() {
            views
        } else {
            let views = straight.iter().map(|it| ImageView::new(it, width, height));
            views.collect::<Result<_, _>>().map_err(|fault| one(fault.to_string()))?
        };
        // What nobody resolves is no part of the set: it would look like pictures that lack.
        let whole = TooFine::of(&code, &views, self.settings.min_contrast);
        let (told, told_code) = (code.pictures(), code.clone());
        let code = code.without_finest(whole.overall());
        let left = code.pictures();
        let is_left = |it: usize| told.len() != views.len() || left.contains(&told[it]);
        let kept: Vec<usize> = (0..views.len()).filter(|it| is_left(*it)).collect();
        let views: Vec<ImageView<'_>> = kept.iter().map(|it| views[*it]).collect();
        let is_unreadable = |it: &usize| set.unreadable.iter().any(|at| *at as usize == *it);
        let unreadable: Vec<usize> = (0..kept.len()).filter(|it| is_unreadable(&kept[*it])).collect();
        let min_contrast = self.settings.min_contrast;
        let found = examine(&code, &views, &unreadable, min_contrast);
        // What crept far looks like a scene that changed.
        let early = if has_moved(&found) { crept(&code, &views, min_contrast) } else { None };
        let (views, found) = match &early {
            Some((_, steadied)) => {
                let steady = views_of(&steadied.pictures, [width, height]).map_err(one)?;
                let found = examine(&code, &steady, &unreadable, min_contrast);
                (steady, found)
            }
            None => (views, found),
        };
        let name = |it: usize| {
            let name = kept.get(it).and_then(|it| set.names.get(*it));
            name.map_or_else(|| format!("picture {it}"), |it| format!("`{it}`"))
        };
        let mut faults: Vec<String> = found.faults.iter().map(|it| it.describe(&code, &name)).collect();
        if let Some(exponent) = exponent {
            faults.push(format!(
                "gray levels are not proportional to light: the camera's response is curved, and was straightened by the exponent {exponent:.2}"
            ));
        }
        let axes = found.usable(&code);
        let for_want = |axis: Axis| {
            let lacking: Vec<String> = found.lacking(&code, axis).iter().map(Shown::to_string).collect();
            match lacking.len() {
                0 => String::new(),
                1..=NAMED => format!(" for want of {}", lacking.join(" and of ")),
                n => format!(" for want of {n} pictures"),
            }
        };
        if axes.is_empty() {
            // Of pictures that could not be told at all nothing lacks in particular.
            let moved = has_moved(&found);
            let left_out =
                Axis::BOTH.into_iter().filter(|it| moved && code.has(*it)).map(|axis| (axis, for_want(axis)));
            let words = left_out.filter(|it| !it.1.is_empty());
            faults.extend(words.map(|(axis, help)| format!("the {} cannot be decoded{help}", axis.in_words())));
            return Err(faults);
        }
        for axis in Axis::BOTH.into_iter().filter(|it| code.has(*it) && !axes.contains(it)) {
            let other = Axis::BOTH[1 - axis.index()].in_words();
            let help = for_want(axis);
            faults.push(format!(
                "the {} are left out{help}, and points come from the {other} alone: where these do not tell depths well, between camera and projector, errors of the calibration are not in their sigma, and \
                 nothing shows them",
                axis.in_words()
            ));
        }
        let all_shown = code.pictures();
        faults.extend(Axis::BOTH.into_iter().filter(|it| axes.contains(it)).filter_map(|axis| {
            lacking_finest_in_words(axis, code.bits[axis.index()], found.finest_left_out(&code)[axis.index()])
        }));
        let Prepared { code, pictures, worked_out } = found.prepared(&code, &views);
        let (steps, bits): (Vec<&Shown>, Vec<&Shown>) =
            worked_out.iter().partition(|it| matches!(it, Shown::Phase { .. }));
        for (list, others) in
            [(bits, "the other picture of its bit, white and black"), (steps, "the other steps of its wave")]
        {
            let list: Vec<String> = list.iter().map(ToString::to_string).collect();
            if !list.is_empty() {
                faults.push(format!("worked out from {others}: {}", list.join(" and ")));
            }
        }
        self.worked_out = worked_out;
        let seen = views_of(&pictures, [width, height]).map_err(one)?;
        let is_early = early.is_some();
        let (drift, steadied) = match &early {
            Some((drift, steadied)) => (Some(drift.clone()), Some(Cow::Borrowed(steadied))),
            None => {
                let drift = drift(&code, &seen, min_contrast);
                let crept = drift.as_ref().filter(|it| it.creeps());
                let steadied = crept.and_then(|it| Steadied::of(&code, &seen, it, min_contrast));
                (drift, steadied.map(Cow::Owned))
            }
        };
        let pictures: Vec<Cow<'_, [u8]>> = match &steadied {
            Some(steadied) if !is_early => steadied.pictures.iter().map(|it| Cow::Borrowed(it.as_slice())).collect(),
            _ => pictures,
        };
        let views = views_of(&pictures, [width, height]).map_err(one)?;
        let changed = Some(Blocks::of(&code, &views, CHANGE)).filter(|it| it.share() > 0.0);
        let noise = self.settings.noise.max(found.noise);
        // Three standard deviations of a difference of two pixels.
        let by_noise = (3.0 * std::f64::consts::SQRT_2 * found.noise + 0.5).min(127.0) as u8;
        let options = DecodeOptions {
            min_contrast: self.settings.min_contrast.max(by_noise),
            min_difference: self.settings.min_difference.max(by_noise),
            min_direct: self.settings.min_direct,
            threads: self.settings.threads,
            ..DecodeOptions::default()
        };
        let in_parts = TooFine::of(&code, &views, self.settings.min_contrast);
        let (mut coordinates, filled) =
            self.coordinates(&code, &views, &axes, &options, &in_parts, noise).map_err(one)?;
        let soft = leave_out_soft_ends(&mut coordinates, &self.decoded.contrast, code.projector);
        faults.extend(Axis::BOTH.into_iter().filter(|it| soft[it.index()] > 0.0).filter_map(|axis| {
            let values = &coordinates.values[axis.index()];
            // What is decoded are the stripes of the last of the codes that were tried.
            let (code, views) = coarser(&code, &views, self.level);
            let of_stripes = edges::stripe_blur(&code, &views, &self.decoded, axis, values).ok().flatten();
            soft_in_words(axis, soft[axis.index()], of_stripes)
        }));
        faults.extend(too_fine_in_words(&told_code, &whole, &in_parts, filled));
        faults.extend(out_of_focus_in_words(coordinates.blur));
        if let Some(drift) = &drift {
            match &steadied {
                Some(steadied) => steadied.widen(&mut coordinates),
                None => drift.widen(&mut coordinates),
            }
            let told = code.pictures();
            let place = |it: usize| all_shown.iter().position(|shown| *shown == told[it]);
            let names = [drift.last, drift.first]
                .map(|it| place(it).and_then(|it| found.picture_at(it)).map_or_else(|| told[it].to_string(), name));
            faults.push(match &steadied {
                Some(steadied) => crept_in_words(&names, steadied),
                None => moved_a_little_in_words(&names, drift.by.norm()),
            });
        }
        let white = match code.place(Shown::White) {
            Some(it) => views[it].pixels().to_vec(),
            None => brightest(&views),
        };
        let mut map = ProjectorMap {
            camera: set.camera,
            name: set.name.clone(),
            projector_size: code.projector,
            width: set.width,
            height: set.height,
            ..ProjectorMap::default()
        };
        map.samples.reserve_exact(16 * white.len());
        let of = |list: &[Vec<f32>; 2], at: usize| {
            Axis::BOTH.map(|it| list[it.index()].get(at).copied().unwrap_or(f32::NAN))
        };
        let mut is_left_out = vec![false; white.len()];
        let is_changed = changed.as_ref().is_some_and(|it| it.share() > CHANGED_SHARE);
        if let Some(changed) = &changed {
            changed.each_row([width, height], |row, from, to| is_left_out[row * width..][from..to].fill(true));
            if is_changed {
                // Where these pictures stand in the set.
                let told = code.pictures();
                let all = all_shown.iter().zip(0..);
                let places: Vec<usize> = changed
                    .pictures()
                    .iter()
                    .filter_map(|it| all.clone().find(|(shown, _)| **shown == told[*it]).map(|it| it.1))
                    .filter_map(|it: usize| found.picture_at(it))
                    .collect();
                let mut names: Vec<String> = places.iter().take(NAMED).map(|it| name(*it)).collect();
                if places.len() > NAMED {
                    names.push(format!("{} more", places.len() - NAMED));
                }
                faults.push(format!(
                    "bits and their inverses are not as bright together as white and black in {:.0} % of what the projector lights, which is left out: something moved during the set, or a lamp or the \
                     camera's exposure changed, most in {}; what moves without such a trace is decoded wrong",
                    100.0 * changed.share(),
                    names.join(", ")
                ));
            }
        }
        for (at, is_left_out) in is_left_out.into_iter().enumerate() {
            if is_left_out {
                map.push(ProjectorSample::NONE);
                continue;
            }
            let (coordinate, sigma) = (of(&coordinates.values, at), of(&coordinates.sigmas, at));
            map.push(ProjectorSample { coordinate, sigma });
        }
        let n_told = faults.len();
        let exchanged = |axis: Axis| Some(exchanged_in_words(axis, self.exchanged[axis.index()]?));
        faults.extend(Axis::BOTH.into_iter().filter_map(exchanged));
        faults.extend(Axis::BOTH.into_iter().filter_map(|axis| steps_in_words(axis, self.steps[axis.index()])));
        let least = self.settings.min_contrast;
        let lit = self.decoded.contrast.iter().filter(|it| **it >= least).count() as u64;
        if self.off_wave > OFF_WAVE {
            faults.push(format!(
                "at {:.0} % of the pixels the phase steps are on no wave, and these are left out: something moved during them, light comes over other surfaces too, or the steps stand in another order",
                100.0 * self.off_wave
            ));
        } else if u32::from(by_noise) > u32::from(self.settings.min_difference)
            && (map.n_known as f64) < NOISY * lit as f64
        {
            faults.push(format!(
                "noise of {:.1} gray levels leaves {:.0} % of the pixels with {least} or more between white and black: only differences above {by_noise} are certain. More light, less gain, or means of several \
                 pictures of each pattern would help",
                found.noise,
                100.0 * map.n_known as f64 / lit.max(1) as f64
            ));
        }
        if faults.len() == n_told && !is_changed && (map.n_known as f64) < SCARCE * lit as f64 {
            faults.push(format!(
                "{:.1} % of the pixels that the projector lights by {least} gray levels or more could be decoded, expected most: stripes are weak against other light or out of focus, or the code is another",
                100.0 * map.n_known as f64 / lit as f64
            ));
        }
        Ok(Map { map, white, lit, faults })
    }

    /// Coordinates of all pixels: by all bits, and where these do not tell, by those that the camera resolves around there; with the part of what is lit that coarser bits alone told, of columns and rows.
    fn coordinates(
        &mut self,
        code: &StripeCode,
        views: &[ImageView<'_>],
        axes: &[Axis],
        options: &DecodeOptions,
        too_fine: &TooFine,
        noise: f64,
    ) -> Result<(Coordinates, [f64; 2]), String> {
        let mut too_fine = too_fine.clone();
        let mut n_filled = [0_usize; 2];
        let most = too_fine.overall().map(|it| it + COARSER);
        let mut all: Option<Coordinates> = None;
        // Levels that all pixels which want them have been tried with.
        let mut tried: Option<TooFine> = None;
        loop {
            for level in too_fine.levels() {
                let width = views.first().map_or(1, |it| it.width());
                let wants = |at: usize, grid: &TooFine| grid.at(at % width, at / width) == level;
                let is_new = |at: usize| wants(at, &too_fine) && !tried.as_ref().is_some_and(|it| wants(at, it));
                let open = all.as_ref().map(|all| {
                    let is_open = |(at, it): (usize, &f32)| it.is_nan() && is_new(at);
                    all.values.each_ref().map(|it| it.iter().enumerate().map(is_open).collect::<Vec<bool>>())
                });
                if open.as_ref().is_some_and(|it| !it.iter().flatten().any(|it| *it)) {
                    continue;
                }
                let (coarse, views) = coarser(code, views, level);
                self.level = level;
                decode_into(&coarse, &views, axes, options, &mut self.decoded).map_err(|fault| fault.to_string())?;
                let (Some(all), Some(open)) = (&mut all, open) else {
                    all = Some(self.of_bits(&coarse, &views, noise, [None, None])?);
                    continue;
                };
                let found = self.of_bits(&coarse, &views, noise, open.each_ref().map(|it| Some(it.as_slice())))?;
                for (axis, open) in open.iter().enumerate() {
                    for at in (0..open.len()).filter(|it| open[*it]) {
                        all.values[axis][at] = found.values[axis][at];
                        all.sigmas[axis][at] = found.sigmas[axis][at];
                        n_filled[axis] += usize::from(found.values[axis][at].is_finite());
                    }
                }
            }
            let Some(all) = all.as_ref().filter(|_| code.steps == 0) else { break };
            let least = options.min_contrast;
            let is_open = |at: usize, axis: usize| {
                let value = all.values[axis].get(at).filter(|_| self.decoded.contrast[at] >= least)?;
                Some(value.is_nan())
            };
            let Some(coarser) = too_fine.coarser_where(all.size, most, is_open) else { break };
            tried = Some(std::mem::replace(&mut too_fine, coarser));
        }
        let n_lit = self.decoded.contrast.iter().filter(|it| **it >= options.min_contrast).count().max(1);
        Ok((all.unwrap_or_default(), n_filled.map(|it| it as f64 / n_lit as f64)))
    }

    fn of_bits(
        &mut self,
        code: &StripeCode,
        views: &[ImageView<'_>],
        noise: f64,
        wanted: [Option<&[bool]>; 2],
    ) -> Result<Coordinates, String> {
        let edges = EdgeOptions { noise, threads: self.settings.threads, ..EdgeOptions::default() };
        (self.off_wave, self.steps, self.exchanged) = Default::default();
        if code.steps == 0 {
            let found = edges::coordinates_where(code, views, &self.decoded, &edges, wanted);
            return found.map_err(|fault| fault.to_string());
        }
        let options = PhaseOptions { noise, ..PhaseOptions::default() };
        let found = phase::coordinates(code, views, &self.decoded, &self.worked_out, &options);
        let found = found.map_err(|fault| fault.to_string())?;
        (self.off_wave, self.steps, self.exchanged) = (found.off_wave, found.steps, found.exchanged);
        Ok(found.coordinates)
    }
}

/// A code without its finest bits of columns and rows, so many, and its pictures.
fn coarser<'a>(code: &StripeCode, views: &[ImageView<'a>], without: [u32; 2]) -> (StripeCode, Vec<ImageView<'a>>) {
    let coarse = code.without_finest(without);
    let (shown, is_kept) = (code.pictures(), coarse.pictures());
    let views = shown.iter().zip(views).filter(|it| is_kept.contains(it.0)).map(|it| *it.1).collect();
    (coarse, views)
}

/// What is said of a set, with its name before it unless it names the set's pictures or files anyway.
fn of_set(set: &PatternPictures, fault: String) -> String {
    let prefix = format!("`{}/", set.name);
    if fault.contains(&prefix) { fault } else { format!("{}: {fault}", set.name) }
}

/// Views of pictures of one size.
fn views_of<T: AsRef<[u8]>>(pictures: &[T], [width, height]: [usize; 2]) -> Result<Vec<ImageView<'_>>, String> {
    pictures.iter().map(|it| ImageView::new(it.as_ref(), width, height).map_err(|fault| fault.to_string())).collect()
}

/// By pixel the brightest of all pictures.
fn brightest(views: &[ImageView<'_>]) -> Vec<u8> {
    let mut all = views.first().map(|it| it.pixels().to_vec()).unwrap_or_default();
    for view in views {
        all.iter_mut().zip(view.pixels()).for_each(|(to, it)| *to = (*to).max(*it));
    }
    all
}

#[cfg(test)]
mod tests;
