//! Lights in the pictures of one camera: threshold, search, centroid [Davis 2002 §3.3].
//!
//! One picture at a time: its plane, a search of the whole picture or of a sparse grid and of windows where lights are
//! expected, and an update of the background. Windows lie where a light was in the last picture, where
//! it would be at constant speed in the image, and at the integrator's predicted targets.

#[cfg(test)]
mod tests;

use foveate::imaging::{
    Background, BackgroundConfig, Centroid, Channel, Hue, ImageView, ImagingError, Measure, RgbView, Sampling, Spot,
    SpotFinder, SpotLimits, Statistic, ThresholdMap, Verdict, Window, fill_polygon, hue_between, plane,
};
use foveate::messages::{self, Feature, Features, Image, PixelFormat};
use foveate::node::detector::{Outcome, PictureSize};
use nalgebra::{Point2, Vector2};

use crate::detector::{CentroidKind, ColourPlane, DetectorSettings, LightColour, Search, WhileLearning};

/// Windows of one picture, at most.
const WINDOWS_MAX: usize = 512;
/// A hue is nearer to its colour than to another one by so many of its standard deviations.
const CLEARER: f64 = 2.0;

/// The detector of one camera.
pub struct LedDetector {
    settings: DetectorSettings,
    /// Size of the camera's pictures.
    size: PictureSize,
    /// Where the jittered grid starts.
    phase: u64,
    finder: SpotFinder,
    limits: SpotLimits,
    of_size: Option<OfSize>,
    n_pictures: u64,
    plane: Vec<u8>,
    spots: Vec<Spot>,
    windows: Vec<Window>,
    /// Lights of the last picture and those of this one.
    before: Vec<Moving>,
    now: Vec<Moving>,
}

/// Buffers that depend on the size of the pictures.
struct OfSize {
    size: [u32; 2],
    /// The part of the camera's pictures that they cover.
    part: messages::Window,
    /// `None`: no background, only `floor`.
    background: Option<Background>,
    /// The lowest threshold everywhere, with the masks.
    floor: ThresholdMap,
}

/// A light and how far it moved since the picture before, in pixels of the camera.
#[derive(Debug, Clone, Copy)]
struct Moving {
    centre: Point2<f64>,
    step: Vector2<f64>,
}

/// Why a picture could not be searched.
#[derive(Debug, Clone, PartialEq)]
pub enum Refusal {
    /// The picture's size differs from the camera's.
    WrongSize {
        /// Columns, rows [px].
        expected: [u32; 2],
        /// Columns, rows [px].
        found: [u32; 2],
    },
    /// A part that is not one of the camera's picture.
    Outside {
        /// Columns, rows of the camera's [px].
        whole: [u32; 2],
        /// Columns, rows of the part [px].
        size: [u32; 2],
        /// Where it is.
        part: messages::Window,
    },
    /// The part differs from the one that the background was learnt from.
    Moved {
        /// The background's.
        learnt: messages::Window,
        /// The picture's.
        found: messages::Window,
    },
    /// The settings need colour, and the picture is gray.
    NoColour,
    /// The number of pixels does not match the size.
    Broken(ImagingError),
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Refusal::WrongSize { expected: [w, h], found: [a, b] } => {
                write!(f, "the picture is {a} x {b} px, the camera's are {w} x {h} px")
            }
            Refusal::Outside { whole: [w, h], size: [a, b], part: messages::Window { left, top, shrink } } => {
                write!(f, "{a} x {b} px at ({left}, {top}), 1/{shrink} of the size, are no part of the camera's {w} x {h} px")
            }
            Refusal::Moved { learnt: a, found: b } => write!(
                f,
                "the picture begins at ({}, {}), 1/{} of the size, but the background was learnt from ({}, {}), 1/{}: for moving parts of pictures \
                 set `learn_frames = 0`",
                b.left, b.top, b.shrink, a.left, a.top, a.shrink
            ),
            Refusal::NoColour => f.write_str(
                "the picture is gray, but `channel` or `colours` name a colour: let the source deliver colour (`format = \"rgb\"`), or set \
                 `channel = \"luma\"` without `colours`",
            ),
            Refusal::Broken(error) => write!(f, "{error}"),
        }
    }
}

impl LedDetector {
    /// A detector with `settings` that have been checked. `phase` is a random number for the jittered grid, different for
    /// each camera.
    ///
    /// # Errors
    /// A setting out of its range.
    pub fn new(
        settings: DetectorSettings,
        calibrated_size: Option<[u32; 2]>,
        phase: u64,
    ) -> Result<Self, ImagingError> {
        let limits = limits(&settings);
        limits.check()?;
        background_config(&settings).map_or(Ok(()), |config| config.check())?;
        let finder = SpotFinder::new(measure(&settings))?;
        Ok(Self {
            settings,
            size: PictureSize::new(calibrated_size),
            phase: phase % 1024,
            finder,
            limits,
            of_size: None,
            n_pictures: 0,
            plane: Vec::new(),
            spots: Vec::new(),
            windows: Vec::with_capacity(64),
            before: Vec::new(),
            now: Vec::new(),
        })
    }

    /// Goes on with other levels, limits and masks; what was learnt of the background stays.
    ///
    /// # Errors
    /// A setting out of its range; nothing has changed then.
    pub fn change(&mut self, settings: DetectorSettings) -> Result<(), ImagingError> {
        let limits = limits(&settings);
        limits.check()?;
        let finder = SpotFinder::new(measure(&settings))?;
        if let Some(of_size) = &mut self.of_size {
            let (masked, floor) = masks(&settings, of_size.size, of_size.part)?;
            of_size.floor = floor;
            if let Some(background) = &mut of_size.background {
                background.set_levels(settings.offset, settings.min_threshold);
                background.set_mask(masked)?;
            }
        }
        (self.settings, self.limits, self.finder) = (settings, limits, finder);
        Ok(())
    }

    /// Fills `features` with the lights of `image`; `predicted` are pixels where targets are expected, whose windows are
    /// searched in a sampled search. All in pixels of the camera; of parts of its pictures the settings' sizes are in pixels of the part.
    ///
    /// # Errors
    /// A picture that is broken, has another size, or is a moving part while a background is learnt; the background stays as it was, and `features` is empty.
    pub fn find(
        &mut self,
        image: &Image,
        predicted: impl Iterator<Item = Point2<f64>>,
        features: &mut Features,
    ) -> Result<Outcome, Refusal> {
        features.list.clear();
        let part = image.window;
        self.fit([image.width, image.height], part)?;
        let Some(of_size) = &mut self.of_size else { unreachable!("the size was fitted") };
        let (width, height) = (image.width as usize, image.height as usize);
        let pixels = match image.format {
            PixelFormat::Gray8 => match self.settings.channel {
                _ if !self.settings.colours.is_empty() => return Err(Refusal::NoColour),
                ColourPlane::Luma | ColourPlane::Max => image.pixels.as_slice(),
                ColourPlane::Red | ColourPlane::Green | ColourPlane::Blue => return Err(Refusal::NoColour),
            },
            PixelFormat::Rgb8 => {
                plane::extract(channel(self.settings.channel), &image.pixels, &mut self.plane)
                    .map_err(Refusal::Broken)?;
                &self.plane
            }
        };
        let view = ImageView::new(pixels, width, height).map_err(Refusal::Broken)?;
        let learnt = of_size.background.as_ref().and_then(Background::thresholds);
        let blind = of_size.background.is_some() && learnt.is_none();
        let found = if blind && self.settings.while_learning == WhileLearning::Wait {
            self.spots.clear();
            None
        } else {
            let thresholds = learnt.unwrap_or(&of_size.floor);
            let (limits, spots) = (&self.limits, &mut self.spots);
            Some(match self.settings.search {
                Search::Full => self.finder.find_full(&view, thresholds, limits, spots),
                Search::Sampled => {
                    let size = self.settings.window_px.div_ceil(part.shrink.max(1));
                    let around = |centre: Point2<f64>| Window::around(part.in_image(&centre), size);
                    self.windows.clear();
                    self.windows.extend(self.before.iter().map(|it| around(it.centre)));
                    let gone_on = self.before.iter().filter(|it| it.step != Vector2::zeros());
                    self.windows.extend(gone_on.map(|it| around(it.centre + it.step)));
                    self.windows.extend(predicted.map(around));
                    self.windows.truncate(WINDOWS_MAX);
                    let sampling = Sampling::of_frame(self.phase + self.n_pictures, self.settings.grid_px as usize);
                    self.finder.find_sampled(&view, thresholds, sampling, &self.windows, limits, spots)
                }
            })
            .transpose()
            .map_err(Refusal::Broken)?
        };
        self.spots.retain(|spot| spot.peak >= self.settings.min_peak);
        self.n_pictures += 1;
        let verdict = match &mut of_size.background {
            // What was searched with the lowest threshold says nothing about a table that is not there yet.
            Some(background) => background.update(&view, found.filter(|_| !blind).as_ref()).map_err(Refusal::Broken)?,
            None => Verdict::Trusted,
        };
        match verdict {
            Verdict::Flooded => {
                self.before.clear();
                return Ok(Outcome::Flooded);
            }
            Verdict::Learning if found.is_none() => return Ok(Outcome::Learning),
            Verdict::Learning | Verdict::Trusted => {}
        }
        self.follow(part);
        let stretch = f64::from(part.shrink);
        let colour = (!self.settings.colours.is_empty()).then(|| RgbView::new(&image.pixels, width, height));
        let colour = colour.transpose().map_err(Refusal::Broken)?;
        features.list.extend(self.spots.iter().map(|spot| Feature {
            centre: part.in_camera(&spot.centre),
            covariance: spot.covariance * (stretch * stretch),
            area: spot.area.saturating_mul(part.shrink * part.shrink),
            peak: spot.peak,
            label: colour.as_ref().and_then(|it| self.settings.label(&it.hue(spot.bounds, self.settings.pixel_noise)?)),
        }));
        Ok(Outcome::Searched)
    }

    /// Prepares the buffers for `size` and `part` where they are not there yet.
    fn fit(&mut self, size: [u32; 2], part: messages::Window) -> Result<(), Refusal> {
        if let Some(other) = self.of_size.as_ref().filter(|it| it.part != part) {
            if other.background.is_some() {
                return Err(Refusal::Moved { learnt: other.part, found: part });
            }
            if other.size != size || !self.settings.masks.is_empty() || part == messages::Window::default() {
                self.of_size = None;
            }
        }
        if part == messages::Window::default() {
            return self.fit_size(size);
        }
        if let Some(whole) = self.size.calibrated().filter(|it| !part.fits(size, *it)) {
            return Err(Refusal::Outside { whole, size, part });
        }
        match &mut self.of_size {
            Some(it) if it.size == size => it.part = part,
            Some(it) if it.background.is_some() => return Err(Refusal::WrongSize { expected: it.size, found: size }),
            _ => self.of_size = Some(self.prepare(size, part).map_err(Refusal::Broken)?),
        }
        Ok(())
    }

    /// As [`Self::fit`], for whole pictures.
    fn fit_size(&mut self, size: [u32; 2]) -> Result<(), Refusal> {
        let present = self.of_size.as_ref().map(|it| it.size);
        let wrong = |expected| Refusal::WrongSize { expected, found: size };
        self.size.check(size, present).map_err(wrong)?;
        if present != Some(size) {
            self.of_size = Some(self.prepare(size, messages::Window::default()).map_err(Refusal::Broken)?);
            self.before.clear();
        }
        Ok(())
    }

    /// Background, masks and lowest thresholds for pictures of `size` that show `part`.
    fn prepare(&self, size: [u32; 2], part: messages::Window) -> Result<OfSize, ImagingError> {
        let [width, height] = size.map(|it| it as usize);
        let (masked, floor) = masks(&self.settings, size, part)?;
        let background = match background_config(&self.settings) {
            None => None,
            Some(config) => {
                let mut background = Background::new(config, width, height)?;
                background.set_mask(masked)?;
                Some(background)
            }
        };
        Ok(OfSize { size, part, background, floor })
    }

    /// Finds the motion of each light of this picture, which shows `part`, since the last one.
    fn follow(&mut self, part: messages::Window) {
        let reach = f64::from(self.settings.window_px) * f64::from(part.shrink);
        self.now.clear();
        for spot in &self.spots {
            let centre = part.in_camera(&spot.centre);
            let expected = |it: &&Moving| (it.centre + it.step - centre).norm_squared();
            let nearest = self.before.iter().min_by(|a, b| expected(a).total_cmp(&expected(b)));
            let step = nearest.map(|it| centre - it.centre).filter(|step| step.norm() <= reach);
            self.now.push(Moving { centre, step: step.unwrap_or_default() });
        }
        std::mem::swap(&mut self.before, &mut self.now);
    }
}

impl DetectorSettings {
    /// The label of a hue: of the nearest colour, where no other one is nearly as near.
    fn label(&self, hue: &Hue) -> Option<u32> {
        let off = |it: &LightColour| hue_between(hue.deg, it.hue_deg).abs();
        let nearest = self.colours.iter().min_by(|a, b| off(a).total_cmp(&off(b)))?;
        let second = self.colours.iter().filter(|it| *it != nearest).map(off).fold(f64::INFINITY, f64::min);
        let is_clear = off(nearest) <= self.hue_tolerance_deg && off(nearest) + CLEARER * hue.sigma_deg < second;
        (hue.saturation >= self.min_saturation && is_clear).then_some(nearest.label)
    }
}

fn limits(settings: &DetectorSettings) -> SpotLimits {
    SpotLimits {
        min_area: settings.min_area_px,
        max_area: settings.max_area_px,
        max_elongation: settings.max_elongation,
        min_fill: settings.min_fill,
        part: settings.part && settings.centroid == CentroidKind::Weighted,
        max_spots: settings.max_features as usize,
        ..SpotLimits::default()
    }
}

fn measure(settings: &DetectorSettings) -> Measure {
    Measure {
        centroid: match settings.centroid {
            CentroidKind::Weighted => Centroid::Weighted,
            CentroidKind::Integer => Centroid::Integer,
        },
        foot: settings.offset,
        pixel_sigma: settings.pixel_noise,
        ..Measure::default()
    }
}

/// Which pixels of a picture of `size` that shows `part` are masked, and the lowest threshold of each.
fn masks(
    settings: &DetectorSettings,
    size: [u32; 2],
    part: messages::Window,
) -> Result<(Vec<bool>, ThresholdMap), ImagingError> {
    let [width, height] = size.map(|it| it as usize);
    let mut masked = vec![false; width * height];
    for polygon in &settings.masks {
        let corners: Vec<Point2<f64>> = polygon.iter().map(|corner| part.in_image(&Point2::from(*corner))).collect();
        fill_polygon(&mut masked, width, height, &corners)?;
    }
    let lowest = settings.min_threshold;
    let thresholds = masked.iter().map(|&masked| if masked { 255 } else { lowest }).collect();
    Ok((masked, ThresholdMap::new(thresholds, width, height)?))
}

/// `None`: no background.
fn background_config(settings: &DetectorSettings) -> Option<BackgroundConfig> {
    (settings.learn_frames > 0).then_some(BackgroundConfig {
        learn_frames: settings.learn_frames,
        offset: settings.offset,
        min_threshold: settings.min_threshold,
        relearn_fraction: settings.relearn_fraction,
        statistic: match settings.left_out_frames {
            0 => Statistic::Maximum,
            n => Statistic::WithoutHighest(n),
        },
        sink: settings.sink,
    })
}

fn channel(plane: ColourPlane) -> Channel {
    match plane {
        ColourPlane::Luma => Channel::Luma,
        ColourPlane::Red => Channel::Red,
        ColourPlane::Green => Channel::Green,
        ColourPlane::Blue => Channel::Blue,
        ColourPlane::Max => Channel::Max,
    }
}
