//! Silhouettes in the pictures of one camera: background, light, body, pieces, holes.

use foveate::imaging::{
    Blob, BlobFinder, Closing, Foreground, HoleFiller, ImageView, ImagingError, Segmenter, Verdict, fill_polygon,
};
use foveate::messages::{Feature, Features, Image, PixelFormat, Silhouette, SilhouetteStatus, Window};
use foveate::node::detector::{Outcome, PictureSize};
use nalgebra::{Point2, Vector2};

use crate::panorama::Behind;
use crate::rim::trim;
use crate::settings::SilhouetteSettings;

/// The finder of one camera's silhouettes.
pub struct SilhouetteFinder {
    settings: SilhouetteSettings,
    size: PictureSize,
    /// A picture of the empty scene: red, green, blue.
    background: Option<Image>,
    learnt: Option<Learnt>,
    finder: BlobFinder,
    filler: HoleFiller,
    closing: Closing,
    /// The mask, with its gaps closed.
    closed: Vec<u8>,
    blobs: Vec<Blob>,
}

/// What depends on the kind and the size of the pictures.
struct Learnt {
    size: [u32; 2],
    part: Window,
    splitter: Splitter,
    /// By the settings.
    masked: Vec<bool>,
}

enum Splitter {
    Colour(Box<Segmenter>),
    Gray(Box<Foreground>),
}

/// Why a picture has no silhouette.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// Another size than the pictures before it, or than the calibration says.
    #[error("the picture is {} x {} px, expected {} x {} px", found[0], found[1], expected[0], expected[1])]
    WrongSize {
        /// Columns, rows [px].
        expected: [u32; 2],
        /// Columns, rows [px].
        found: [u32; 2],
    },
    /// A part of the camera's pictures other than the one that the background is of.
    #[error("the picture begins at ({}, {}), 1/{} of the size, expected ({}, {}), 1/{}: expected the part of the background", found.left, found.top, found.shrink, expected.left, expected.top, expected.shrink)]
    OtherPart {
        /// Of the background.
        expected: Window,
        /// Of the picture.
        found: Window,
    },
    /// Gray where the background is in colour, or colour where it is gray.
    #[error("the picture is {found}, the background {expected}")]
    OtherKind {
        /// Of the background.
        expected: &'static str,
        /// Of the picture.
        found: &'static str,
    },
    /// The pixels are not what the size promises.
    #[error("{0}")]
    Broken(String),
}

impl From<ImagingError> for Refusal {
    fn from(error: ImagingError) -> Self {
        Refusal::Broken(error.to_string())
    }
}

impl SilhouetteFinder {
    /// A finder with `settings` that have been checked; `background` is a picture of the empty scene.
    pub fn new(settings: SilhouetteSettings, calibrated_size: Option<[u32; 2]>, background: Option<Image>) -> Self {
        Self {
            settings,
            size: PictureSize::new(calibrated_size),
            background,
            learnt: None,
            finder: BlobFinder::default(),
            filler: HoleFiller::default(),
            closing: Closing::default(),
            closed: Vec::new(),
            blobs: Vec::new(),
        }
    }

    /// Learns from a picture of the empty scene.
    ///
    /// # Errors
    /// A picture that is none, or of another size.
    pub fn teach(&mut self, image: &Image) -> Result<(), Refusal> {
        let learnt = self.fit(image)?;
        match &mut learnt.splitter {
            Splitter::Colour(segmenter) if !segmenter.has_learnt() => segmenter.teach(&image.pixels)?,
            Splitter::Gray(foreground) if !foreground.has_learnt() => {
                foreground.update(&view(image)?)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// What came for [`Self::teach`] has to do.
    pub fn end_teaching(&mut self) {
        match self.learnt.as_mut().map(|it| &mut it.splitter) {
            Some(Splitter::Colour(segmenter)) if !segmenter.has_learnt() => _ = segmenter.end_teaching(),
            Some(Splitter::Gray(foreground)) if !foreground.has_learnt() => _ = foreground.end_learning(),
            _ => {}
        }
    }

    /// What is behind the next picture, that of a camera which has turned; masked where that is not known. `noise` is the standard deviation of a pixel [gray level].
    ///
    /// # Errors
    /// As [`Self::find`].
    pub(crate) fn set_behind(&mut self, image: &Image, behind: &Behind<'_>, noise: f32) -> Result<(), Refusal> {
        let (noise_floor, jitter_px) = (self.settings.noise_floor.max(noise), behind.jitter_px as f32);
        let jitter_px = jitter_px.max(self.settings.jitter_px).min(10.0);
        let learnt = self.fit(image)?;
        let masked: Vec<bool> = behind.covered.iter().zip(&learnt.masked).map(|(known, it)| !known || *it).collect();
        match &mut learnt.splitter {
            Splitter::Colour(segmenter) => {
                segmenter.set_tolerance(noise_floor, jitter_px)?;
                segmenter.set_mask(&masked)?;
                segmenter.set_background(behind.pixels)?;
            }
            Splitter::Gray(foreground) => {
                foreground.set_mask(&masked)?;
                foreground.set_background(&ImageView::new(
                    behind.pixels,
                    image.width as usize,
                    image.height as usize,
                )?)?;
                foreground.allow_jitter(jitter_px);
            }
        }
        Ok(())
    }

    /// Learns from a picture of the empty scene how well such pictures fit what [`Self::set_behind`] says of them.
    ///
    /// # Errors
    /// As [`Self::find`].
    pub(crate) fn rehearse(&mut self, image: &Image) -> Result<(), Refusal> {
        match &mut self.fit(image)?.splitter {
            Splitter::Colour(segmenter) => segmenter.rehearse(&image.pixels)?,
            Splitter::Gray(_) => {}
        }
        Ok(())
    }

    /// Fills `silhouette`, and `features` with its blobs in scan order. `predicted` are pixels where targets are expected: a blob there is not absorbed.
    ///
    /// # Errors
    /// A picture that is none, or of another size, part or kind; what was learnt stays.
    pub fn find(
        &mut self,
        image: &Image,
        predicted: &mut dyn Iterator<Item = Point2<f64>>,
        silhouette: &mut Silhouette,
        features: &mut Features,
    ) -> Result<Outcome, Refusal> {
        features.list.clear();
        self.fit(image)?;
        let Self { settings, learnt: Some(learnt), finder, filler, closing, closed, blobs, .. } = self else {
            unreachable!("the picture was fitted")
        };
        let part = image.window;
        let expected: Vec<Point2<f64>> = predicted.map(|it| part.in_image(&it)).collect();
        let verdict = match &mut learnt.splitter {
            Splitter::Colour(segmenter) => segmenter.update(&image.pixels)?,
            Splitter::Gray(foreground) => foreground.update(&view(image)?)?,
        };
        (silhouette.camera, silhouette.window) = (image.camera, part);
        [silhouette.width, silhouette.height] = learnt.size;
        silhouette.n_body = 0;
        silhouette.confidence.clear();
        match &learnt.splitter {
            Splitter::Colour(segmenter) => silhouette.confidence.extend_from_slice(segmenter.confidence()),
            Splitter::Gray(foreground) => {
                // As near to f = 1 and f = 2 of colour as a gray picture says.
                silhouette.confidence.extend(foreground.mask().iter().map(|it| [0, 160, 230][usize::from(*it).min(2)]));
            }
        }
        closed.clear();
        closed.extend_from_slice(learnt.splitter.mask());
        closing.close(closed, learnt.size[0] as usize, settings.close_px as usize);
        let mask = &closed[..];
        let size = (learnt.size[0] as usize, learnt.size[1] as usize);
        let fault = match verdict {
            Verdict::Learning => Some(SilhouetteStatus::Learning),
            Verdict::Flooded => Some(SilhouetteStatus::Full),
            Verdict::Trusted => learnt
                .splitter
                .edges_off()
                .and_then(|it| (it > settings.moved_fraction).then_some(SilhouetteStatus::Moved)),
        };
        if let Some(status) = fault {
            silhouette.status = status;
            silhouette.n_body = mask.iter().filter(|it| **it != 0).count() as u32;
            return Ok(if status == SilhouetteStatus::Learning { Outcome::Learning } else { Outcome::Flooded });
        }
        finder.find_in(mask, size, &settings.limits(), &expected, blobs)?;
        keep(finder, filler, blobs, mask, size.0, settings.max_hole_px.into(), silhouette);
        trim(&image.pixels, image.format.channels(), size.0, settings.rim_px, &mut silhouette.confidence);
        silhouette.n_body = silhouette.confidence.iter().filter(|it| **it >= Silhouette::BODY).count() as u32;
        silhouette.status = if silhouette.n_body == 0 { SilhouetteStatus::Empty } else { SilhouetteStatus::Seen };
        let scale = f64::from(part.shrink);
        for blob in blobs.iter() {
            let (point, covariance) = finder.point(blob, Vector2::zeros(), settings.shape_error);
            features.list.push(Feature {
                centre: part.in_camera(&point),
                covariance: covariance * (scale * scale),
                area: u32::try_from(blob.area * u64::from(part.shrink * part.shrink)).unwrap_or(u32::MAX),
                peak: 0,
                label: None,
            });
        }
        let margin = settings.merge_px;
        let held = blobs.iter().map(|it| it.bounds).filter(|[x0, y0, x1, y1]| {
            let within = |at: f64, low: u32, high: u32| (f64::from(low)..=f64::from(high)).contains(&at);
            expected.iter().any(|it| within(it.x, *x0, *x1) && within(it.y, *y0, *y1))
        });
        let held = held
            .map(|[x0, y0, x1, y1]| [x0.saturating_sub(margin), y0.saturating_sub(margin), x1 + margin, y1 + margin]);
        if let Splitter::Colour(segmenter) = &mut learnt.splitter {
            segmenter.hold(held);
        }
        Ok(Outcome::Searched)
    }

    /// Light of the last picture over the learnt one, red, green, blue; `None` before there is any.
    pub fn gains(&self) -> Option<[f32; 3]> {
        match &self.learnt.as_ref()?.splitter {
            Splitter::Colour(segmenter) => Some(segmenter.gains()),
            Splitter::Gray(foreground) => Some([foreground.gain(); 3]),
        }
    }

    /// Sees to it that what depends on the kind of picture is there.
    fn fit(&mut self, image: &Image) -> Result<&mut Learnt, Refusal> {
        let (size, part) = ([image.width, image.height], image.window);
        let n = size[0] as usize * size[1] as usize * image.format.channels();
        if image.pixels.len() != n {
            return Err(Refusal::Broken(format!("the picture has {} bytes, expected {n}", image.pixels.len())));
        }
        if let Some(learnt) = &self.learnt {
            if learnt.part != part {
                return Err(Refusal::OtherPart { expected: learnt.part, found: part });
            }
            let kind = |is_gray| if is_gray { "gray" } else { "in colour" };
            let is_gray = matches!(learnt.splitter, Splitter::Gray(_));
            if is_gray != (image.format == PixelFormat::Gray8) {
                return Err(Refusal::OtherKind { expected: kind(is_gray), found: kind(!is_gray) });
            }
        }
        let present = self.learnt.as_ref().map(|it| it.size);
        if part == Window::default() {
            self.size.check(size, present).map_err(|expected| Refusal::WrongSize { expected, found: size })?;
        } else if let Some(expected) = present.filter(|it| *it != size) {
            return Err(Refusal::WrongSize { expected, found: size });
        }
        if present != Some(size) {
            self.learnt = Some(self.prepare(image)?);
        }
        let Some(learnt) = &mut self.learnt else { unreachable!("it was prepared") };
        Ok(learnt)
    }

    fn prepare(&self, image: &Image) -> Result<Learnt, Refusal> {
        let (size, part) = ([image.width, image.height], image.window);
        let [width, height] = size.map(|it| it as usize);
        let mut masked = vec![false; width * height];
        for polygon in &self.settings.masks {
            let corners: Vec<Point2<f64>> = polygon.iter().map(|it| part.in_image(&Point2::from(*it))).collect();
            fill_polygon(&mut masked, width, height, &corners)?;
        }
        let background = self.background.as_ref().map(|it| cut(it, size, part)).transpose()?;
        let splitter = match image.format {
            PixelFormat::Rgb8 => {
                let mut segmenter = Segmenter::new(self.settings.segmenter(), width, height)?;
                segmenter.set_mask(&masked)?;
                background.iter().try_for_each(|it| segmenter.set_background(it))?;
                Splitter::Colour(Box::new(segmenter))
            }
            PixelFormat::Gray8 => {
                let mut foreground = Foreground::new(self.settings.foreground(), width, height)?;
                foreground.set_mask(&masked)?;
                if let Some(rgb) = &background {
                    let mut gray = Vec::new();
                    foveate::imaging::plane::extract(foveate::imaging::Channel::Luma, rgb, &mut gray)?;
                    foreground.set_background(&ImageView::new(&gray, width, height)?)?;
                }
                Splitter::Gray(Box::new(foreground))
            }
        };
        Ok(Learnt { size, part, splitter, masked })
    }
}

impl Splitter {
    fn mask(&self) -> &[u8] {
        match self {
            Splitter::Colour(segmenter) => segmenter.mask(),
            Splitter::Gray(foreground) => foreground.mask(),
        }
    }

    /// Part of the background's edges that moved, where known.
    fn edges_off(&self) -> Option<f64> {
        match self {
            Splitter::Colour(segmenter) => Some(segmenter.edges_off()),
            Splitter::Gray(_) => None,
        }
    }
}

fn view(image: &Image) -> Result<ImageView<'_>, Refusal> {
    Ok(ImageView::new(&image.pixels, image.width as usize, image.height as usize)?)
}

/// The part of a colour picture of the whole that pictures of `size` with the window `part` show.
fn cut(whole: &Image, [width, height]: [u32; 2], part: Window) -> Result<Vec<u8>, Refusal> {
    if !part.fits([width, height], [whole.width, whole.height]) || part.shrink != 1 {
        let expected = [part.left + width * part.shrink, part.top + height * part.shrink];
        return Err(Refusal::WrongSize { expected, found: [whole.width, whole.height] });
    }
    let row = |y: u32| {
        let start = 3 * ((part.top + y) as usize * whole.width as usize + part.left as usize);
        &whole.pixels[start..start + 3 * width as usize]
    };
    Ok((0..height).flat_map(|y| row(y).iter().copied()).collect())
}

/// Leaves of the silhouette what is in a blob, and fills its holes.
fn keep(
    finder: &BlobFinder,
    filler: &mut HoleFiller,
    blobs: &[Blob],
    mask: &[u8],
    width: usize,
    max_hole: u64,
    silhouette: &mut Silhouette,
) {
    const LEAST: u8 = Silhouette::BODY;
    let confidence = &mut silhouette.confidence;
    let mut kept = vec![false; confidence.len()];
    for blob in blobs {
        for (y, columns) in finder.pixels(blob) {
            kept[y * width + columns.start..y * width + columns.end].fill(true);
        }
    }
    for (it, kept) in confidence.iter_mut().zip(&kept) {
        *it = if *kept { (*it).max(LEAST) } else { (*it).min(LEAST - 1) };
    }
    if max_hole > 0 {
        for blob in blobs {
            filler.find(mask, width, blob, max_hole, |y, first, last| {
                confidence[y * width + first..=y * width + last].fill(LEAST);
            });
        }
    }
}
