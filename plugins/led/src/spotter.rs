//! Lights in the pictures of one camera: threshold, search, centroid [Davis 2002 §3.3].
//!
//! One picture at a time: its plane, a search of the whole picture or of a sparse grid and of windows where lights are
//! expected, and what the picture teaches about the background. Windows lie where a light was in the last picture, where
//! it would be had it gone on at its speed in the image, and where the integrator's targets should be.

use foveate::imaging::{
    Background, BackgroundConfig, Centroid, Channel, ImageView, ImagingError, Measure, Sampling, Spot, SpotFinder,
    SpotLimits, Statistic, ThresholdMap, Verdict, Window, fill_polygon, plane,
};
use foveate::messages::{Feature, Features, Image, PixelFormat};
use nalgebra::{Point2, Vector2};

use crate::detector::{CentroidKind, ColourPlane, DetectorSettings, Search, WhileLearning};

/// Successive pictures of a new size after which that size is believed, where no calibration states one.
const SIZE_PATIENCE: u32 = 10;

/// Windows of one picture, at most.
const WINDOWS_MAX: usize = 512;

/// The detector of one camera.
pub struct Spotter {
    settings: DetectorSettings,
    /// As the calibration states it [px].
    calibrated_size: Option<[u32; 2]>,
    /// Where the jittered grid starts.
    phase: u64,
    finder: SpotFinder,
    limits: SpotLimits,
    of_size: Option<OfSize>,
    /// A size that came instead of the expected one, and how often in a row.
    other_size: ([u32; 2], u32),
    n_pictures: u64,
    plane: Vec<u8>,
    spots: Vec<Spot>,
    windows: Vec<Window>,
    /// Lights of the last picture and those of this one.
    before: Vec<Moving>,
    now: Vec<Moving>,
}

/// What depends on the size of the pictures.
struct OfSize {
    size: [u32; 2],
    /// `None`: nothing is learnt, `floor` is all there is.
    background: Option<Background>,
    /// The lowest threshold everywhere, with the masks.
    floor: ThresholdMap,
}

/// A light and how far it moved since the picture before.
#[derive(Debug, Clone, Copy)]
struct Moving {
    centre: Point2<f64>,
    step: Vector2<f64>,
}

/// What a picture was worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Searched.
    Searched,
    /// The background is still being learnt.
    Learning,
    /// So much is lit that most of it is no light: the room has changed, and is being learnt again.
    Flooded,
}

/// Why a picture could not be searched.
#[derive(Debug, Clone, PartialEq)]
pub enum Refusal {
    /// Another size than the camera's.
    WrongSize {
        /// Columns, rows [px].
        expected: [u32; 2],
        /// Columns, rows [px].
        found: [u32; 2],
    },
    /// The pixels are not what the size promises.
    Broken(ImagingError),
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Refusal::WrongSize { expected: [w, h], found: [a, b] } => {
                write!(f, "the picture is {a} x {b} px, the camera's are {w} x {h} px")
            }
            Refusal::Broken(error) => write!(f, "{error}"),
        }
    }
}

impl Spotter {
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
        let limits = SpotLimits {
            min_area: settings.min_area_px,
            max_area: settings.max_area_px,
            max_elongation: settings.max_elongation,
            min_fill: settings.min_fill,
            max_spots: settings.max_features as usize,
            ..SpotLimits::default()
        };
        limits.check()?;
        background_config(&settings).map_or(Ok(()), |config| config.check())?;
        let finder = SpotFinder::new(Measure {
            centroid: match settings.centroid {
                CentroidKind::Weighted => Centroid::Weighted,
                CentroidKind::Integer => Centroid::Integer,
            },
            foot: settings.offset,
            pixel_sigma: settings.pixel_noise,
            ..Measure::default()
        })?;
        Ok(Self {
            settings,
            calibrated_size,
            phase: phase % 1024,
            finder,
            limits,
            of_size: None,
            other_size: ([0, 0], 0),
            n_pictures: 0,
            plane: Vec::new(),
            spots: Vec::new(),
            windows: Vec::with_capacity(64),
            before: Vec::new(),
            now: Vec::new(),
        })
    }

    /// Fills `features` with the lights of `image`; `predicted` are pixels where targets are expected, whose windows are
    /// searched in a sampled search.
    ///
    /// # Errors
    /// A picture that is none or has another size; what was learnt stays, and `features` is empty.
    pub fn find(
        &mut self,
        image: &Image,
        predicted: impl Iterator<Item = Point2<f64>>,
        features: &mut Features,
    ) -> Result<Outcome, Refusal> {
        features.list.clear();
        self.fit_size([image.width, image.height])?;
        let Some(of_size) = &mut self.of_size else { unreachable!("the size was fitted") };
        let (width, height) = (image.width as usize, image.height as usize);
        let pixels = match image.format {
            PixelFormat::Gray8 => image.pixels.as_slice(),
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
                    let size = self.settings.window_px;
                    let around = |centre| Window::around(centre, size);
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
        self.follow();
        features.list.extend(self.spots.iter().map(|spot| Feature {
            centre: spot.centre,
            covariance: spot.covariance,
            area: spot.area,
            peak: spot.peak,
        }));
        Ok(Outcome::Searched)
    }

    /// Sees to it that what depends on the size is there for `size`.
    fn fit_size(&mut self, size: [u32; 2]) -> Result<(), Refusal> {
        let expected = self.calibrated_size.or(self.of_size.as_ref().map(|it| it.size));
        if let Some(expected) = expected.filter(|it| *it != size) {
            let times = if self.other_size.0 == size { self.other_size.1 + 1 } else { 1 };
            self.other_size = (size, times);
            if self.calibrated_size.is_some() || times < SIZE_PATIENCE || size.contains(&0) {
                return Err(Refusal::WrongSize { expected, found: size });
            }
            self.of_size = None;
        }
        self.other_size.1 = 0;
        if self.of_size.is_none() {
            self.of_size = Some(self.prepare(size).map_err(Refusal::Broken)?);
            self.before.clear();
        }
        Ok(())
    }

    /// Background, masks and lowest thresholds for pictures of `size`.
    fn prepare(&self, size: [u32; 2]) -> Result<OfSize, ImagingError> {
        let [width, height] = size.map(|it| it as usize);
        let mut masked = vec![false; width * height];
        for polygon in &self.settings.masks {
            let corners: Vec<Point2<f64>> = polygon.iter().map(|corner| Point2::from(*corner)).collect();
            fill_polygon(&mut masked, width, height, &corners)?;
        }
        let lowest = self.settings.min_threshold;
        let thresholds = masked.iter().map(|&masked| if masked { 255 } else { lowest }).collect();
        let floor = ThresholdMap::new(thresholds, width, height)?;
        let background = match background_config(&self.settings) {
            None => None,
            Some(config) => {
                let mut background = Background::new(config, width, height)?;
                background.set_mask(masked)?;
                Some(background)
            }
        };
        Ok(OfSize { size, background, floor })
    }

    /// Finds out how far each light of this picture has moved since the last one.
    fn follow(&mut self) {
        let reach = f64::from(self.settings.window_px);
        self.now.clear();
        for spot in &self.spots {
            let expected = |it: &&Moving| (it.centre + it.step - spot.centre).norm_squared();
            let nearest = self.before.iter().min_by(|a, b| expected(a).total_cmp(&expected(b)));
            let step = nearest.map(|it| spot.centre - it.centre).filter(|step| step.norm() <= reach);
            self.now.push(Moving { centre: spot.centre, step: step.unwrap_or_default() });
        }
        std::mem::swap(&mut self.before, &mut self.now);
    }
}

/// `None`: nothing is to be learnt.
fn background_config(settings: &DetectorSettings) -> Option<BackgroundConfig> {
    (settings.learn_frames > 0).then(|| BackgroundConfig {
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
