//! Lights in the pictures of one camera: threshold, search, centroid [Davis 2002 §3.3].
//!
//! One picture at a time: its plane, a search of the whole picture or of a sparse grid and of windows where lights are
//! expected, and what the picture teaches about the background. Windows lie where a light was in the last picture, where
//! it would be had it gone on at its speed in the image, and where the integrator's targets should be.

use foveate::imaging::{
    Background, BackgroundConfig, Centroid, Channel, ImageView, ImagingError, Measure, Sampling, Spot, SpotFinder,
    SpotLimits, Statistic, ThresholdMap, Verdict, Window, fill_polygon, plane,
};
use foveate::messages::{self, Feature, Features, Image, PixelFormat};
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
    /// Which part of the camera's pictures they show.
    part: messages::Window,
    /// `None`: nothing is learnt, `floor` is all there is.
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
    /// A part that is not one of the camera's picture.
    Outside {
        /// Columns, rows of the camera's [px].
        whole: [u32; 2],
        /// Columns, rows of the part [px].
        size: [u32; 2],
        /// Where it is.
        part: messages::Window,
    },
    /// Another part than the one that the background was learnt for.
    Moved {
        /// The background's.
        learnt: messages::Window,
        /// The picture's.
        found: messages::Window,
    },
    /// The settings ask for a colour and the picture has none.
    NoColour,
    /// The pixels are not what the size promises.
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
                "the picture begins at ({}, {}), 1/{} of the size, the background was learnt from ({}, {}), 1/{}: where parts of pictures \
                 move, nothing can be learnt, set `learn_frames = 0`",
                b.left, b.top, b.shrink, a.left, a.top, a.shrink
            ),
            Refusal::NoColour => f.write_str(
                "the picture is gray and `channel` names a colour: let the source give colour (`format = \"rgb\"`), or set \
                 `channel = \"luma\"`",
            ),
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
    /// searched in a sampled search. All in pixels of the camera; of parts of its pictures the settings' sizes are in pixels of the part.
    ///
    /// # Errors
    /// A picture that is none, has another size, or is a part that moves while a background is learnt; what was learnt stays, and `features` is empty.
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
        features.list.extend(self.spots.iter().map(|spot| Feature {
            centre: part.in_camera(&spot.centre),
            covariance: spot.covariance * (stretch * stretch),
            area: spot.area.saturating_mul(part.shrink * part.shrink),
            peak: spot.peak,
            label: None,
        }));
        Ok(Outcome::Searched)
    }

    /// Sees to it that what depends on the size is there for `size` and `part`.
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
        if let Some(whole) = self.calibrated_size.filter(|it| !part.fits(size, *it)) {
            return Err(Refusal::Outside { whole, size, part });
        }
        match &mut self.of_size {
            Some(it) if it.size == size => it.part = part,
            Some(it) if it.background.is_some() => return Err(Refusal::WrongSize { expected: it.size, found: size }),
            _ => self.of_size = Some(self.prepare(size, part).map_err(Refusal::Broken)?),
        }
        Ok(())
    }

    /// The same of whole pictures.
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
            self.of_size = Some(self.prepare(size, messages::Window::default()).map_err(Refusal::Broken)?);
            self.before.clear();
        }
        Ok(())
    }

    /// Background, masks and lowest thresholds for pictures of `size` that show `part`.
    fn prepare(&self, size: [u32; 2], part: messages::Window) -> Result<OfSize, ImagingError> {
        let [width, height] = size.map(|it| it as usize);
        let mut masked = vec![false; width * height];
        for polygon in &self.settings.masks {
            let corners: Vec<Point2<f64>> =
                polygon.iter().map(|corner| part.in_image(&Point2::from(*corner))).collect();
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
        Ok(OfSize { size, part, background, floor })
    }

    /// Finds out how far each light of this picture, which shows `part`, has moved since the last one.
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

/// `None`: nothing is to be learnt.
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

#[cfg(test)]
mod tests {
    use foveate_testkit::render_spot;
    use foveate_testkit::scene::add_spot;

    use super::*;

    const SIZE: [u32; 2] = [160, 120];

    /// Everything searched, nothing learnt, unless a test says otherwise.
    fn plain() -> DetectorSettings {
        DetectorSettings { learn_frames: 0, left_out_frames: 0, search: Search::Full, ..DetectorSettings::default() }
    }

    fn dark() -> Image {
        render_spot(SIZE, [0.0, 0.0], 1.0, 0.0)
    }

    fn with_spots(centres: &[[f64; 2]]) -> Image {
        let mut image = dark();
        centres.iter().for_each(|centre| add_spot(&mut image, *centre, 1.5, 220.0));
        image
    }

    fn spotter(settings: DetectorSettings) -> Spotter {
        Spotter::new(settings, None, 0).unwrap()
    }

    #[track_caller]
    fn find(spotter: &mut Spotter, image: &Image) -> Vec<Point2<f64>> {
        find_near(spotter, image, &[])
    }

    #[track_caller]
    fn find_near(spotter: &mut Spotter, image: &Image, predicted: &[Point2<f64>]) -> Vec<Point2<f64>> {
        let mut features = Features::default();
        spotter.find(image, predicted.iter().copied(), &mut features).unwrap();
        features.list.iter().map(|it| it.centre).collect()
    }

    #[test]
    fn spots_are_found_within_a_twentieth_of_a_pixel_in_scan_order() {
        let centres = [[100.3, 20.7], [30.2, 60.4], [140.8, 99.1]];
        let found = find(&mut spotter(plain()), &with_spots(&centres));
        assert_eq!(found.len(), 3);
        for (found, truth) in found.iter().zip(centres) {
            assert!((found - Point2::from(truth)).norm() < 0.05, "{found} for {truth:?}");
        }
    }

    #[test]
    fn the_papers_centroid_is_a_whole_pixel() {
        let settings = DetectorSettings { centroid: CentroidKind::Integer, ..plain() };
        assert_eq!(find(&mut spotter(settings), &with_spots(&[[30.3, 60.8]])), [Point2::new(30.0, 61.0)]);
    }

    #[test]
    fn colour_pictures_are_searched_in_the_plane_that_the_rig_names() {
        let gray = with_spots(&[[50.0, 40.0]]);
        let red = gray.pixels.iter().flat_map(|&it| [it, 0, 0]).collect();
        let image = Image { format: PixelFormat::Rgb8, pixels: red, ..gray };
        for (channel, n) in
            [(ColourPlane::Red, 1), (ColourPlane::Max, 1), (ColourPlane::Green, 0), (ColourPlane::Blue, 0)]
        {
            let found = find(&mut spotter(DetectorSettings { channel, ..plain() }), &image);
            assert_eq!(found.len(), n, "{channel:?}");
        }
    }

    #[test]
    fn colour_is_not_looked_for_in_gray_pictures() {
        let mut spotter = spotter(DetectorSettings { channel: ColourPlane::Green, ..plain() });
        let mut features = Features::default();
        let refused = spotter.find(&with_spots(&[[50.0, 40.0]]), std::iter::empty(), &mut features);
        assert_eq!(refused, Err(Refusal::NoColour));
        assert!(Refusal::NoColour.to_string().contains("rgb"));
    }

    #[test]
    fn what_is_masked_is_not_found() {
        let masks = vec![vec![[40.0, 30.0], [60.0, 30.0], [60.0, 50.0], [40.0, 50.0]]];
        for learn_frames in [0, 1] {
            let mut spotter = spotter(DetectorSettings { masks: masks.clone(), learn_frames, ..plain() });
            find(&mut spotter, &dark());
            let found = find(&mut spotter, &with_spots(&[[50.0, 40.0], [100.0, 80.0]]));
            assert_eq!(found.len(), 1);
            assert!(found[0].x > 90.0);
        }
    }

    #[test]
    fn a_lamp_is_learnt_and_a_light_beside_it_is_found() {
        let mut spotter = spotter(DetectorSettings { learn_frames: 3, ..plain() });
        let lamp = with_spots(&[[50.0, 40.0]]);
        let mut features = Features::default();
        for _ in 0..3 {
            assert_eq!(spotter.find(&lamp, std::iter::empty(), &mut features), Ok(Outcome::Learning));
            assert!(features.list.is_empty());
        }
        assert_eq!(find(&mut spotter, &lamp), []);
        assert_eq!(find(&mut spotter, &with_spots(&[[50.0, 40.0], [90.0, 40.0]])).len(), 1);
    }

    #[test]
    fn while_learning_the_lowest_threshold_may_serve() {
        let settings = DetectorSettings { learn_frames: 3, while_learning: WhileLearning::Search, ..plain() };
        let mut spotter = spotter(settings);
        let lamp = with_spots(&[[50.0, 40.0]]);
        assert_eq!([(); 4].map(|()| find(&mut spotter, &lamp).len()), [1, 1, 1, 0]);
    }

    #[test]
    fn a_light_that_moves_on_while_learning_leaves_no_trace_if_its_frames_are_left_out() {
        for (left_out_frames, found) in [(0, 0), (2, 1)] {
            let mut spotter = spotter(DetectorSettings { learn_frames: 8, left_out_frames, ..plain() });
            (0..8).for_each(|k| _ = find(&mut spotter, &with_spots(&[[20.0 + 15.0 * f64::from(k), 40.0]])));
            let again = find(&mut spotter, &with_spots(&[[50.0, 40.0]]));
            assert_eq!(again.len(), found, "{left_out_frames} frames left out");
        }
    }

    #[test]
    fn a_room_that_gets_bright_is_not_believed_and_then_learnt() {
        let mut spotter = spotter(DetectorSettings { learn_frames: 4, ..plain() });
        (0..4).for_each(|_| _ = find(&mut spotter, &dark()));
        let mut bright = with_spots(&[[50.0, 40.0]]);
        bright.pixels.iter_mut().for_each(|it| *it = it.saturating_add(100));
        let mut features = Features::default();
        for _ in 0..4 {
            assert_eq!(spotter.find(&bright, std::iter::empty(), &mut features), Ok(Outcome::Flooded));
            assert!(features.list.is_empty());
        }
        bright = with_spots(&[[90.0, 40.0]]);
        bright.pixels.iter_mut().for_each(|it| *it = it.saturating_add(100));
        assert_eq!(find(&mut spotter, &bright).len(), 1);
    }

    #[test]
    fn a_sampled_search_finds_small_lights_in_some_frame_and_keeps_them_in_every() {
        let settings = DetectorSettings { search: Search::Sampled, grid_px: 20, min_area_px: 1, ..plain() };
        let mut spotter = spotter(settings);
        let image = with_spots(&[[80.0, 67.0]]);
        let counts: Vec<usize> = (0..40).map(|_| find(&mut spotter, &image).len()).collect();
        let first = counts.iter().position(|&it| it == 1).unwrap();
        assert!(first < 20, "{counts:?}");
        assert!(counts[first..].iter().all(|&it| it == 1), "the window at the last position loses it: {counts:?}");
    }

    #[test]
    fn windows_follow_the_speed_in_the_image_and_the_predictions() {
        // 30 px a frame with windows of 40 px: where it was does not reach where it is.
        let settings = DetectorSettings { search: Search::Sampled, grid_px: 1000, window_px: 40, ..plain() };
        let at = |k: f64| with_spots(&[[15.0 + 30.0 * k, 61.0]]);
        let mut blind = spotter(settings.clone());
        assert_eq!([0.0, 1.0].map(|k| find(&mut blind, &at(k)).len()), [0, 0]);
        let mut led = spotter(settings);
        let near = |k: f64| [Point2::new(20.0 + 30.0 * k, 58.0)];
        assert_eq!([0.0, 1.0].map(|k| find_near(&mut led, &at(k), &near(k)).len()), [1, 1]);
        assert_eq!([2.0, 3.0].map(|k| find(&mut led, &at(k)).len()), [1, 1], "its speed is known by now");
    }

    #[test]
    fn wrong_sizes_and_broken_pictures_are_refused_and_the_next_one_is_searched() {
        let mut features = Features::default();
        let mut spotter = Spotter::new(plain(), Some(SIZE), 0).unwrap();
        let other = render_spot([80, 60], [20.0, 20.0], 1.5, 220.0);
        let refused = spotter.find(&other, std::iter::empty(), &mut features).unwrap_err();
        assert_eq!(refused.to_string(), "the picture is 80 x 60 px, the camera's are 160 x 120 px");
        let mut broken = with_spots(&[[50.0, 40.0]]);
        broken.pixels.pop();
        assert!(matches!(spotter.find(&broken, std::iter::empty(), &mut features), Err(Refusal::Broken(_))));
        broken.format = PixelFormat::Rgb8;
        assert!(spotter.find(&broken, std::iter::empty(), &mut features).is_err());
        let none = Image { width: 0, height: 0, pixels: Vec::new(), ..dark() };
        assert!(spotter.find(&none, std::iter::empty(), &mut features).is_err());
        assert_eq!(find(&mut spotter, &with_spots(&[[50.0, 40.0]])).len(), 1);
    }

    /// The part of `image` from (`left`, `top`) on, of this size.
    fn part_of(image: &Image, [left, top]: [u32; 2], [width, height]: [u32; 2]) -> Image {
        let rows = (top..top + height).map(|row| (row * image.width + left) as usize);
        let pixels = rows.flat_map(|start| image.pixels[start..start + width as usize].iter().copied()).collect();
        Image { width, height, pixels, window: messages::Window { left, top, shrink: 1 }, ..Image::default() }
    }

    #[test]
    fn lights_in_a_part_that_moves_lie_where_they_lie_in_the_whole_picture() {
        let image = with_spots(&[[50.3, 40.6], [70.1, 61.4], [140.0, 20.0]]);
        let masks = vec![vec![[60.0, 55.0], [80.0, 55.0], [80.0, 70.0], [60.0, 70.0]]];
        for (masks, search, n) in [(vec![], Search::Full, 2), (vec![], Search::Sampled, 2), (masks, Search::Full, 1)] {
            let settings = DetectorSettings { masks, search, grid_px: 1, ..plain() };
            let whole = find(&mut spotter(settings.clone()), &image);
            let mut moving = Spotter::new(settings, Some(SIZE), 0).unwrap();
            for corner in [[30, 20], [31, 25], [40, 30], [40, 30]] {
                let found = find(&mut moving, &part_of(&image, corner, [64, 48]));
                assert_eq!(found.len(), n, "{search:?} at {corner:?}");
                for centre in found {
                    let nearest = whole.iter().map(|it| (it - centre).norm()).fold(f64::INFINITY, f64::min);
                    assert!(nearest < 1e-9, "{centre} at {corner:?}: off by {nearest}");
                }
            }
        }
    }

    #[test]
    fn lights_in_a_picture_made_smaller_lie_where_they_lie_in_the_whole_one() {
        let truth = Point2::new(50.3, 40.6);
        let large = render_spot(SIZE, [truth.x, truth.y], 4.0, 220.0);
        let mean = |x: usize, y: usize| {
            let sum: u32 = (0..16).map(|it| u32::from(large.pixels[(4 * y + it / 4) * 160 + 4 * x + it % 4])).sum();
            (sum / 16) as u8
        };
        let pixels = (0..30).flat_map(|y| (0..40).map(move |x| (x, y))).map(|(x, y)| mean(x, y)).collect();
        let window = messages::Window { left: 0, top: 0, shrink: 4 };
        let small = Image { width: 40, height: 30, pixels, window, ..Image::default() };
        let features = |image: &Image| {
            let mut features = Features::default();
            // It stays where it is, so that a background may be learnt.
            let mut spotter = Spotter::new(plain(), Some(SIZE), 0).unwrap();
            spotter.find(image, std::iter::empty(), &mut features).unwrap();
            assert_eq!(features.list.len(), 1);
            features.list[0]
        };
        let (fine, coarse) = (features(&large), features(&small));
        assert!((coarse.centre - truth).norm() < 0.2, "{}", coarse.centre);
        assert!(coarse.covariance.trace() > 3.0 * fine.covariance.trace(), "{} {}", coarse.covariance, fine.covariance);
        assert!((f64::from(coarse.area) / f64::from(fine.area) - 1.0).abs() < 0.3, "{} {}", coarse.area, fine.area);
    }

    #[test]
    fn a_background_is_learnt_for_one_part_and_no_part_reaches_beyond_the_picture() {
        let image = with_spots(&[[50.0, 40.0]]);
        let mut features = Features::default();
        let mut learning = Spotter::new(DetectorSettings { learn_frames: 2, ..plain() }, Some(SIZE), 0).unwrap();
        let empty = part_of(&dark(), [30, 20], [64, 48]);
        (0..2).for_each(|_| assert!(find(&mut learning, &empty).is_empty()));
        assert_eq!(find(&mut learning, &part_of(&image, [30, 20], [64, 48])).len(), 1);
        for other in [part_of(&image, [31, 20], [64, 48]), image.clone()] {
            let refused = learning.find(&other, std::iter::empty(), &mut features).unwrap_err();
            assert!(refused.to_string().contains("set `learn_frames = 0`"), "{refused}");
        }
        assert_eq!(find(&mut learning, &part_of(&image, [30, 20], [64, 48])).len(), 1, "what was learnt stays");
        let mut plain = Spotter::new(plain(), Some(SIZE), 0).unwrap();
        let beyond = Image { window: messages::Window { left: 97, top: 0, shrink: 1 }, ..empty };
        let refused = plain.find(&beyond, std::iter::empty(), &mut features).unwrap_err();
        assert!(refused.to_string().contains("are no part of the camera's 160 x 120 px"), "{refused}");
        assert_eq!(find(&mut plain, &image).len(), 1);
    }

    #[test]
    fn without_a_calibration_a_lasting_change_of_size_is_believed() {
        let mut spotter = spotter(plain());
        let mut features = Features::default();
        let first = render_spot([80, 60], [20.0, 20.0], 1.5, 220.0);
        assert_eq!(find(&mut spotter, &first).len(), 1);
        let results: Vec<bool> = (0..12)
            .map(|_| spotter.find(&with_spots(&[[50.0, 40.0]]), std::iter::empty(), &mut features).is_ok())
            .collect();
        assert_eq!(results.iter().filter(|&&it| it).count(), 3, "{results:?}");
        assert!(spotter.find(&first, std::iter::empty(), &mut features).is_err());
    }

    #[test]
    fn predictions_that_are_no_numbers_or_far_outside_do_no_harm() {
        let settings = DetectorSettings { search: Search::Sampled, grid_px: 1, ..plain() };
        let places = [Point2::new(f64::NAN, 1.0), Point2::new(1e300, -1e300), Point2::new(-500.0, 40.0)];
        assert_eq!(find_near(&mut spotter(settings), &with_spots(&[[50.0, 40.0]]), &places).len(), 1);
    }
}
