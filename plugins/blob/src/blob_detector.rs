//! Blobs in the pictures of one camera: background, foreground, blobs, one reported point for each blob.

use foveate::imaging::{
    Blob, BlobFinder, BlobLimits, Channel, Foreground, ForegroundConfig, ImageView, ImagingError, Verdict,
    fill_polygon, plane, shrink,
};
use foveate::messages::{Feature, Features, Image, PixelFormat, Window};
use foveate::node::detector::{Outcome, PictureSize};
use nalgebra::{Point2, Vector2};

use crate::settings::{BlobSettings, ReportedPoint};

/// The detector of one camera.
pub struct BlobDetector {
    settings: BlobSettings,
    limits: BlobLimits,
    /// Size of the camera's pictures.
    size: PictureSize,
    background: Option<GrayPicture>,
    of_size: Option<OfSize>,
    finder: BlobFinder,
    blobs: Vec<Blob>,
    expected: Vec<Point2<f64>>,
    plane: Vec<u8>,
    smaller: Vec<u8>,
}

/// Buffers that depend on the size of the pictures.
struct OfSize {
    size: [u32; 2],
    /// Which part of the camera's pictures they cover.
    part: Window,
    foreground: Foreground,
}

/// A picture of one byte a pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct GrayPicture {
    /// Columns, rows [px].
    pub size: [u32; 2],
    /// Row by row.
    pub pixels: Vec<u8>,
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
    /// The part is not one of the camera's picture, or differs from the part that the background was learnt from.
    OtherPart {
        /// The part that the picture shows.
        found: Window,
        /// The part of the background, if there is one.
        learnt: Option<Window>,
    },
    /// The number of pixels does not match the size.
    Broken(ImagingError),
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Refusal::WrongSize { expected: [w, h], found: [a, b] } => {
                write!(f, "the picture is {a} x {b} px, the camera's are {w} x {h} px")
            }
            Refusal::OtherPart { found: Window { left, top, shrink }, learnt } => {
                write!(f, "the picture begins at ({left}, {top}), 1/{shrink} of the size, ")?;
                match learnt {
                    None => f.write_str("which is no part of the camera's"),
                    Some(it) => write!(
                        f,
                        "the background was learnt from ({}, {}), 1/{}: expected the same part in all pictures",
                        it.left, it.top, it.shrink
                    ),
                }
            }
            Refusal::Broken(error) => write!(f, "{error}"),
        }
    }
}

impl BlobDetector {
    /// A detector with `settings` that have been checked; `background` is a picture of the empty scene to begin with.
    ///
    /// # Errors
    /// A setting out of its range.
    pub fn new(
        settings: BlobSettings,
        calibrated_size: Option<[u32; 2]>,
        background: Option<GrayPicture>,
    ) -> Result<Self, ImagingError> {
        let limits = limits(&settings);
        limits.check()?;
        foreground_config(&settings).check()?;
        Ok(Self {
            settings,
            limits,
            size: PictureSize::new(calibrated_size),
            background,
            of_size: None,
            finder: BlobFinder::default(),
            blobs: Vec::new(),
            expected: Vec::with_capacity(64),
            plane: Vec::new(),
            smaller: Vec::new(),
        })
    }

    /// Goes on with other thresholds, limits and masks; what was learnt of the background stays.
    ///
    /// # Errors
    /// A setting out of its range; nothing has changed then.
    pub fn change(&mut self, settings: BlobSettings) -> Result<(), ImagingError> {
        let limits = limits(&settings);
        limits.check()?;
        foreground_config(&settings).check()?;
        if let Some(OfSize { size, part, foreground }) = &mut self.of_size {
            foreground.set_mask(&masked(&settings, *size, *part)?)?;
            foreground.set_thresholds(settings.threshold_sigma, settings.sure_sigma);
        }
        (self.settings, self.limits) = (settings, limits);
        Ok(())
    }

    /// Fills `features` with the blobs of `image`, in scan order. `predicted` are pixels where targets are expected, whose blobs
    /// need no pixel beyond `peak_sigma`; `up` gives the upward direction in the picture at a pixel.
    ///
    /// # Errors
    /// A picture whose size or part is not the camera's, or whose pixels are incomplete; the background stays as it was, and `features` is empty.
    pub fn find(
        &mut self,
        image: &Image,
        predicted: impl Iterator<Item = Point2<f64>>,
        up: impl Fn(&Point2<f64>) -> Vector2<f64>,
        features: &mut Features,
    ) -> Result<Outcome, Refusal> {
        features.list.clear();
        let part = image.window;
        self.fit([image.width, image.height], part)?;
        let Some(of_size) = &mut self.of_size else { unreachable!("the size was fitted") };
        let pixels = match image.format {
            PixelFormat::Gray8 => image.pixels.as_slice(),
            PixelFormat::Rgb8 => {
                plane::extract(Channel::Luma, &image.pixels, &mut self.plane).map_err(Refusal::Broken)?;
                &self.plane
            }
        };
        let view = ImageView::new(pixels, image.width as usize, image.height as usize).map_err(Refusal::Broken)?;
        let factor = self.settings.shrink;
        let view = smaller(&view, factor, &mut self.smaller).map_err(Refusal::Broken)?;
        match of_size.foreground.update(&view).map_err(Refusal::Broken)? {
            Verdict::Learning => return Ok(Outcome::Learning),
            Verdict::Flooded => return Ok(Outcome::Flooded),
            Verdict::Trusted => {}
        }
        // Pixel (x, y) of the smaller picture has its centre at (x + ½) f − ½ in the larger one.
        let scale = f64::from(factor);
        let shift = Vector2::repeat(scale / 2.0 - 0.5);
        self.expected.clear();
        self.expected.extend(predicted.map(|it| Point2::from((part.in_image(&it).coords - shift) / scale)));
        let whole = |it: &Point2<f64>| part.in_camera(&Point2::from(it.coords * scale + shift));
        let cells = factor * part.shrink;
        let (finder, blobs) = (&mut self.finder, &mut self.blobs);
        finder.find(&of_size.foreground, &self.limits, &self.expected, blobs).map_err(Refusal::Broken)?;
        for blob in &self.blobs {
            let centroid = whole(&blob.centroid);
            let direction = match self.settings.point {
                ReportedPoint::Centroid => Vector2::zeros(),
                ReportedPoint::Top => up(&centroid),
                ReportedPoint::Bottom => -up(&centroid),
            };
            let (point, covariance) = finder.point(blob, direction, self.settings.shape_error);
            features.list.push(Feature {
                centre: whole(&point),
                covariance: covariance * f64::from(cells).powi(2),
                area: u32::try_from(blob.area * u64::from(cells * cells)).unwrap_or(u32::MAX),
                peak: 0,
                label: None,
            });
        }
        Ok(Outcome::Searched)
    }

    /// Prepares the buffers for `size` and `part` where they are not there yet.
    fn fit(&mut self, size: [u32; 2], part: Window) -> Result<(), Refusal> {
        let learnt = self.of_size.as_ref().map(|it| it.part);
        if learnt.is_some_and(|it| it != part) {
            return Err(Refusal::OtherPart { found: part, learnt });
        }
        if part == Window::default() {
            return self.fit_size(size);
        }
        if self.size.calibrated().is_some_and(|whole| !part.fits(size, whole)) {
            return Err(Refusal::OtherPart { found: part, learnt: None });
        }
        match &self.of_size {
            Some(it) if it.size != size => Err(Refusal::WrongSize { expected: it.size, found: size }),
            Some(_) => Ok(()),
            None => {
                self.of_size = Some(self.prepare(size, part).map_err(Refusal::Broken)?);
                Ok(())
            }
        }
    }

    /// As [`Self::fit`], for whole pictures.
    fn fit_size(&mut self, size: [u32; 2]) -> Result<(), Refusal> {
        let present = self.of_size.as_ref().map(|it| it.size);
        let wrong = |expected| Refusal::WrongSize { expected, found: size };
        self.size.check(size, present).map_err(wrong)?;
        if present != Some(size) {
            self.of_size = Some(self.prepare(size, Window::default()).map_err(Refusal::Broken)?);
        }
        Ok(())
    }

    /// Background and masks for pictures of `size` that show `part`.
    fn prepare(&self, size: [u32; 2], part: Window) -> Result<OfSize, ImagingError> {
        let factor = self.settings.shrink;
        let [width, height] = size.map(|it| (it / factor) as usize);
        let mut foreground = Foreground::new(foreground_config(&self.settings), width, height)?;
        foreground.set_mask(&masked(&self.settings, size, part)?)?;
        if let Some(picture) = &self.background {
            let [columns, rows] = picture.size;
            let view = ImageView::new(&picture.pixels, columns as usize, rows as usize)?;
            foreground.set_background(&smaller(&view, factor, &mut Vec::new())?)?;
        }
        Ok(OfSize { size, part, foreground })
    }
}

fn smaller<'a>(view: &ImageView<'a>, factor: u32, buffer: &'a mut Vec<u8>) -> Result<ImageView<'a>, ImagingError> {
    if factor == 1 {
        return Ok(*view);
    }
    let (width, height) = shrink(view, factor as usize, buffer)?;
    ImageView::new(buffer, width, height)
}

/// In pixels of the reduced picture.
fn limits(settings: &BlobSettings) -> BlobLimits {
    let cell = u64::from(settings.shrink * settings.shrink);
    BlobLimits {
        min_area: u64::from(settings.min_area_px).div_ceil(cell),
        max_area: u64::from(settings.max_area_px).div_ceil(cell),
        merge_px: settings.merge_px.div_ceil(settings.shrink),
        max_blobs: settings.max_features as usize,
    }
}

/// Which pixels are masked of the reduced form of a picture of `size` that shows `part`.
fn masked(settings: &BlobSettings, size: [u32; 2], part: Window) -> Result<Vec<bool>, ImagingError> {
    let [width, height] = size.map(|it| (it / settings.shrink) as usize);
    let mut masked = vec![false; width * height];
    let scale = f64::from(settings.shrink);
    for polygon in &settings.masks {
        let small = |at: f64| (at + 0.5) / scale - 0.5;
        let corners: Vec<Point2<f64>> =
            polygon.iter().map(|corner| part.in_image(&Point2::from(*corner)).map(small)).collect();
        fill_polygon(&mut masked, width, height, &corners)?;
    }
    Ok(masked)
}

fn foreground_config(settings: &BlobSettings) -> ForegroundConfig {
    ForegroundConfig {
        learn_frames: settings.learn_frames,
        threshold_sigma: settings.threshold_sigma,
        sure_sigma: settings.sure_sigma,
        noise_floor: settings.noise_floor,
        adapt_frames: settings.adapt_frames,
        absorb_frames: settings.absorb_frames,
        shadow_ratio: settings.shadow_ratio,
        relearn_fraction: settings.relearn_fraction,
    }
}

#[cfg(test)]
mod tests {
    use foveate::messages::CameraId;

    use super::*;

    fn settings() -> BlobSettings {
        BlobSettings { learn_frames: 3, min_area_px: 50, shape_error: 0.0, ..BlobSettings::default() }
    }

    /// 100 everywhere, 200 in columns x..x + 20 of rows 30..70.
    fn picture(size: [u32; 2], x: Option<usize>, format: PixelFormat) -> Image {
        let [width, height] = size.map(|it| it as usize);
        let lit = |i: usize| x.is_some_and(|x| (x..x + 20).contains(&(i % width)) && (30..70).contains(&(i / width)));
        let gray = (0..width * height).map(|i| if lit(i) { 200 } else { 100 });
        let pixels = gray.flat_map(|it| std::iter::repeat_n(it, format.channels())).collect();
        Image { camera: CameraId(0), width: size[0], height: size[1], format, pixels, ..Image::default() }
    }

    const SIZE: [u32; 2] = [160, 120];

    fn blob_detector(settings: BlobSettings) -> BlobDetector {
        let mut blob_detector = BlobDetector::new(settings, None, None).unwrap();
        for _ in 0..3 {
            let empty = picture(SIZE, None, PixelFormat::Gray8);
            assert_eq!(find(&mut blob_detector, &empty), Ok((Outcome::Learning, Vec::new())));
        }
        blob_detector
    }

    fn find(blob_detector: &mut BlobDetector, image: &Image) -> Result<(Outcome, Vec<Feature>), Refusal> {
        let mut features = Features::default();
        let up = |_: &Point2<f64>| Vector2::new(0.0, -1.0);
        blob_detector.find(image, std::iter::empty(), up, &mut features).map(|it| (it, features.list))
    }

    #[test]
    fn each_point_lies_where_it_should_also_in_smaller_pictures_and_in_colour() {
        for (point, y, tolerance) in
            [(ReportedPoint::Centroid, 49.5, 0.3), (ReportedPoint::Top, 30.5, 2.0), (ReportedPoint::Bottom, 68.5, 2.0)]
        {
            for (shrink, format) in [(1, PixelFormat::Gray8), (2, PixelFormat::Rgb8), (4, PixelFormat::Gray8)] {
                let mut blob_detector = blob_detector(BlobSettings { point, shrink, ..settings() });
                let (outcome, list) = find(&mut blob_detector, &picture(SIZE, Some(60), format)).unwrap();
                assert_eq!((outcome, list.len()), (Outcome::Searched, 1));
                let off = list[0].centre - Point2::new(69.5, y);
                assert!(off.x.abs() < 0.3 && off.y.abs() < tolerance, "{point:?}, 1/{shrink}: {}", list[0].centre);
                assert!((600..=900).contains(&list[0].area), "1/{shrink}: {} px²", list[0].area);
            }
        }
    }

    #[test]
    fn a_mask_hides_the_same_part_of_pictures_made_smaller() {
        // Columns 60 to 79 are lit, those up to 69 hidden.
        let masks = vec![vec![[-1.0, -1.0], [69.5, -1.0], [69.5, 120.0], [-1.0, 120.0]]];
        for shrink in [1, 2, 5] {
            let mut blob_detector = blob_detector(BlobSettings { shrink, masks: masks.clone(), ..settings() });
            let (_, list) = find(&mut blob_detector, &picture(SIZE, Some(60), PixelFormat::Gray8)).unwrap();
            assert_eq!(list.len(), 1, "1/{shrink}");
            assert!((list[0].centre - Point2::new(74.5, 49.5)).norm() < 0.3, "1/{shrink}: {}", list[0].centre);
        }
    }

    #[test]
    fn a_part_that_stays_gives_pixels_of_the_whole_and_one_that_moves_is_refused() {
        let part = |x: Option<usize>, left: u32| {
            let whole = picture(SIZE, x, PixelFormat::Gray8);
            let rows = (20..100).map(|row| row * 160 + left as usize);
            let pixels = rows.flat_map(|start| whole.pixels[start..start + 100].iter().copied()).collect();
            Image { width: 100, height: 80, pixels, window: Window { left, top: 20, shrink: 1 }, ..whole }
        };
        let masks = vec![vec![[-1.0, -1.0], [69.5, -1.0], [69.5, 120.0], [-1.0, 120.0]]];
        for (masks, x) in [(vec![], 69.5), (masks, 74.5)] {
            let mut blob_detector = BlobDetector::new(BlobSettings { masks, ..settings() }, Some(SIZE), None).unwrap();
            (0..3).for_each(|_| assert_eq!(find(&mut blob_detector, &part(None, 40)), Ok((Outcome::Learning, vec![]))));
            let (_, list) = find(&mut blob_detector, &part(Some(60), 40)).unwrap();
            assert_eq!(list.len(), 1);
            assert!((list[0].centre - Point2::new(x, 49.5)).norm() < 0.3, "{}", list[0].centre);
            let refused = find(&mut blob_detector, &part(Some(60), 41)).unwrap_err();
            assert!(matches!(refused, Refusal::OtherPart { learnt: Some(_), .. }), "{refused}");
        }
        let mut blob_detector = BlobDetector::new(settings(), Some([139, 120]), None).unwrap();
        let refused = find(&mut blob_detector, &part(None, 40)).unwrap_err();
        assert!(matches!(refused, Refusal::OtherPart { learnt: None, .. }), "{refused}");
    }

    #[test]
    fn another_size_is_refused_until_it_stays() {
        let mut blob_detector = blob_detector(settings());
        let other = picture([80, 120], None, PixelFormat::Gray8);
        for _ in 0..9 {
            let refusal = find(&mut blob_detector, &other).unwrap_err();
            assert_eq!(refusal, Refusal::WrongSize { expected: SIZE, found: [80, 120] });
        }
        for _ in 0..3 {
            assert_eq!(find(&mut blob_detector, &other).unwrap().0, Outcome::Learning);
        }
        assert_eq!(find(&mut blob_detector, &picture([80, 120], Some(20), PixelFormat::Gray8)).unwrap().1.len(), 1);
        let mut calibrated = BlobDetector::new(settings(), Some(SIZE), None).unwrap();
        assert!((0..20).all(|_| find(&mut calibrated, &other).is_err()));
        let broken = Image { pixels: vec![0; 5], ..picture(SIZE, None, PixelFormat::Gray8) };
        assert!(matches!(find(&mut calibrated, &broken), Err(Refusal::Broken(_))));
    }

    #[test]
    fn what_differs_from_the_background_picture_is_found_in_the_first_picture() {
        let empty = GrayPicture { size: SIZE, pixels: picture(SIZE, None, PixelFormat::Gray8).pixels };
        let mut blob_detector = BlobDetector::new(settings(), None, Some(empty.clone())).unwrap();
        assert_eq!(find(&mut blob_detector, &picture(SIZE, Some(10), PixelFormat::Gray8)).unwrap().1.len(), 1);
        let mut blob_detector = BlobDetector::new(settings(), None, Some(empty)).unwrap();
        let refusal = find(&mut blob_detector, &picture([80, 60], None, PixelFormat::Gray8)).unwrap_err();
        assert_eq!(refusal.to_string(), "picture is 160x120 px where 80x60 px are expected");
    }

    #[test]
    fn shape_error_widens_by_the_size_of_the_blob() {
        let of = |shape_error| {
            let mut blob_detector = blob_detector(BlobSettings { shape_error, ..settings() });
            find(&mut blob_detector, &picture(SIZE, Some(60), PixelFormat::Gray8)).unwrap().1[0].covariance
        };
        let wider = of(0.5) - of(0.0);
        let expected = [20.0 * 20.0 / 12.0 / 4.0, 40.0 * 40.0 / 12.0 / 4.0];
        assert!((0..2).all(|i| (wider[(i, i)] / expected[i] - 1.0).abs() < 0.05), "{wider}");
    }
}
