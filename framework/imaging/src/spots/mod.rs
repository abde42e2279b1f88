//! Bright spots: connected lit pixels, each with a centre, its uncertainty and its shape.
//!
//! [Davis 2002 §3.3]: pixels brighter than a threshold of their own form features; a frame is searched whole, or, when
//! time is short, on a sparse grid that moves from frame to frame and in windows where targets are expected. The
//! search itself stands in `finder`, what is taken of a spot in `component`.

pub(crate) mod component;
mod finder;
mod parts;

use nalgebra::{Matrix2, Point2};

pub use finder::SpotFinder;

use crate::ImagingError;

/// One bright spot: the image of an LED, or of a reflection or lamp.
#[derive(Debug, Clone, PartialEq)]
pub struct Spot {
    /// Its place; (0, 0) is the centre of the top-left pixel [px].
    pub centre: Point2<f64>,
    /// Covariance of the centre, by the noise model of [`Measure`] [px²].
    pub covariance: Matrix2<f64>,
    /// Lit pixels that belong to it [px²].
    pub area: u32,
    /// Its brightest pixel [gray level].
    pub peak: u8,
    /// First and last column and row that are lit: [x0, y0, x1, y1], all four part of the spot [px].
    pub bounds: [u32; 4],
    /// Sum of the weights that the centre is the mean of: the light of the spot [gray level × px²].
    /// [`Centroid::Integer`]: the area.
    pub weight: f64,
    /// Whether it touches the picture's edge, where a part of it may be missing; `covariance` allows for that.
    pub touches_border: bool,
    /// Longer over shorter axis of the ellipse with the same second moments, at least 1. A disc has 1.
    pub elongation: f64,
}

impl Spot {
    /// Part of its bounding box that is lit, in (0, 1]. A disc has 0.79, a thin diagonal line close to 0.
    pub fn fill(&self) -> f64 {
        let [x0, y0, x1, y1] = self.bounds.map(u64::from);
        f64::from(self.area) / ((x1 - x0 + 1) * (y1 - y0 + 1)) as f64
    }
}

/// Which connected lit pixels are a spot, and how many of them may be looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct SpotLimits {
    /// Smallest area kept, at least 1 [px²]. Removes hot pixels and noise.
    pub min_area: u32,
    /// Largest area kept [px²]. Removes lamps and windows.
    pub max_area: u32,
    /// Largest [`Spot::elongation`] kept, at least 1. Removes reflections on edges, and lights smeared by motion.
    pub max_elongation: f64,
    /// Smallest [`Spot::fill`] kept, 0..=1. Removes frames, cables and other hollow or branched things.
    pub min_fill: f64,
    /// Whether touching lights, and a light that touches a dimmer patch, are separated: each is then a spot of its own, to which the other limits
    /// apply. Otherwise everything connected is one spot, whose centre lies in between.
    pub part: bool,
    /// At most this many spots are reported; [`Found::truncated`] says that there were more.
    pub max_spots: usize,
    /// At most this many groups of connected lit pixels are looked at, kept or not. Bounds the time that a picture full
    /// of noise takes; [`Found::truncated`] says that there were more.
    pub max_components: usize,
}

impl Default for SpotLimits {
    /// 2 px² to 2,000 px², elongation up to 4, fill from 0.3, nothing parted, 256 spots of 4,096 groups: LEDs of a wide camera.
    fn default() -> Self {
        Self {
            min_area: 2,
            max_area: 2000,
            max_elongation: 4.0,
            min_fill: 0.3,
            part: false,
            max_spots: 256,
            max_components: 4096,
        }
    }
}

impl SpotLimits {
    /// [`ImagingError::Setting`] that names the first setting out of its range.
    pub fn check(&self) -> Result<(), ImagingError> {
        let Self { min_area, max_area, max_elongation, min_fill, .. } = *self;
        ImagingError::unless(min_area >= 1, "min_area", "at least 1 px²", min_area.into())?;
        ImagingError::unless(max_area >= min_area, "max_area", "at least min_area", max_area.into())?;
        ImagingError::unless(max_elongation >= 1.0, "max_elongation", "at least 1", max_elongation)?;
        ImagingError::unless((0.0..=1.0).contains(&min_fill), "min_fill", "0 to 1", min_fill)
    }
}

/// Which point of a spot is its centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Centroid {
    /// Mean position of the spot's light. Measured on Gaussian spots (tests/golden/spot_error.txt): several times
    /// nearer to the truth than the mean of the lit pixels, which jumps when a rim pixel flickers.
    #[default]
    Weighted,
    /// Mean position of the lit pixels, rounded to whole pixels: what [Davis 2002 §3.6] used, and found to be the
    /// largest part of its noise. Kept for comparison.
    Integer,
}

/// How the centre of a spot and its covariance are measured.
///
/// The weight of a pixel is wᵢ = max(0, Iᵢ − (Tᵢ − foot)), its intensity over a foot somewhat below its threshold; the
/// centre is Σ wᵢ xᵢ / Σ wᵢ. The sum runs over the lit pixels *and all their neighbours*: with the lit pixels alone the
/// skirt of the spot is cut off where the threshold happens to fall among the pixels, which costs an error as large
/// as that of the noise (0.034 px instead of 0.019 for σ = 1.6 px), and much more for spots of few pixels.
///
/// Covariance: independent noise of each pixel through that mean,
/// (σ² + 1/12) Σ (xᵢ − c)(xᵢ − c)ᵀ / (Σ wᵢ)², over the pixels with wᵢ > 0 that are not saturated (a saturated pixel
/// reads 255 whatever the noise); plus what noise alone does not explain: pixels at the rim that take part or not, the
/// plateau of a saturated spot, `floor_px`², and the missing part of a spot at the border.
///
/// Checked on 1,000 seeded spots for each of 36 sizes, brightnesses and noises (tests/golden/spot_error.txt): the mean
/// squared error is 0.8 to 3.3 in units of this covariance where 2 is right. It is too sure, by a factor of 1.4 to 2
/// in σ, of wide spots whose peak is only about twice as high as the threshold, and not to be relied on where noise
/// breaks a spot to pieces (a peak less than three times the noise above the threshold).
#[derive(Debug, Clone, PartialEq)]
pub struct Measure {
    /// Which point is the centre.
    pub centroid: Centroid,
    /// How far below the threshold the weights begin [gray level]. Best: the distance from the background to the
    /// threshold, that is the offset of the background. Larger: background enters and pulls the centre towards
    /// whole pixels. Smaller: less of the spot's light counts.
    pub foot: u8,
    /// Standard deviation of the noise of a pixel [gray level].
    pub pixel_sigma: f64,
    /// Error of a centre that stays when there is no noise, one axis, standard deviation [px].
    pub floor_px: f64,
}

impl Default for Measure {
    /// Weighted, a foot of 20 gray levels, noise of 3 gray levels, 0.004 px floor.
    fn default() -> Self {
        Self { centroid: Centroid::Weighted, foot: 20, pixel_sigma: 3.0, floor_px: 0.004 }
    }
}

impl Measure {
    /// [`ImagingError::Setting`] that names the first setting out of its range.
    pub fn check(&self) -> Result<(), ImagingError> {
        let Self { pixel_sigma, floor_px, .. } = *self;
        ImagingError::unless(pixel_sigma >= 0.0, "pixel_sigma", "at least 0 gray levels", pixel_sigma)?;
        ImagingError::unless(floor_px >= 0.0, "floor_px", "at least 0 px", floor_px)
    }
}

/// Part of a picture in which every pixel is searched; what lies outside the picture is ignored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// First column [px].
    pub x: i32,
    /// First row [px].
    pub y: i32,
    /// Columns [px].
    pub width: u32,
    /// Rows [px].
    pub height: u32,
}

impl Window {
    /// `size_px` columns and rows about `centre`; without extent when `centre` is not finite.
    pub fn around(centre: Point2<f64>, size_px: u32) -> Self {
        let finite = centre.x.is_finite() && centre.y.is_finite();
        let first = |c: f64| (c - f64::from(size_px) / 2.0).round() as i32; // saturates
        let size = if finite { size_px } else { 0 };
        Self { x: first(centre.x), y: first(centre.y), width: size, height: size }
    }
}

/// Which rows of a picture are searched besides the windows.
///
/// [Davis 2002 §3.3] samples one pixel of each 5 × 5 block and jitters the grid on each field, so that a small feature
/// that stands still is found eventually. Here every pixel of one row in `every_rows` is compared: it contains the
/// paper's samples, reads the same cache lines, and takes less time than picking every fifth pixel, because
/// 16 neighbours are compared at once. The grid therefore moves in rows only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sampling {
    /// Distance of the searched rows, at least 1 [px]. A spot at least this high is found in every frame.
    pub every_rows: usize,
    /// First searched row, taken modulo `every_rows`.
    pub first_row: usize,
}

impl Sampling {
    /// The rows for frame number `sequence` of a camera: any `grid_px` successive frames search every row once.
    ///
    /// Successive frames are about 0.38 `grid_px` apart, so that a spot that drifts by a row a frame does not run along
    /// with the gap. A `grid_px` of 0 counts as 1.
    pub fn of_frame(sequence: u64, grid_px: usize) -> Self {
        let every_rows = grid_px.max(1);
        let mut step = ((every_rows as f64 * 0.382).round() as usize).max(1);
        while greatest_common_divisor(step, every_rows) != 1 {
            step += 1;
        }
        let first_row = (sequence % every_rows as u64) as usize * step % every_rows;
        Self { every_rows, first_row }
    }
}

fn greatest_common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

/// Statistics of a search over the whole picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Found {
    /// Pixels compared that could have been lit: the whole picture or its sampled rows, less what is masked. Windows
    /// do not count, because targets are expected in them.
    pub examined: u64,
    /// How many of those were lit.
    pub lit: u64,
    /// Groups of connected lit pixels that [`SpotLimits`] refused.
    pub refused: u32,
    /// There were more spots or groups than [`SpotLimits`] allows; windows are served first, then rows from the top.
    pub truncated: bool,
}

impl Found {
    /// Part of the examined pixels that were lit, an estimate for the whole picture when rows were sampled; 0 when
    /// none was examined.
    pub fn lit_fraction(&self) -> f64 {
        if self.examined == 0 { 0.0 } else { self.lit as f64 / self.examined as f64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_is_sampled_once_in_grid_frames() {
        for grid_px in 1..40 {
            for start in [0, 7, u64::MAX - 100] {
                let mut rows: Vec<usize> =
                    (start..start + grid_px as u64).map(|k| Sampling::of_frame(k, grid_px).first_row).collect();
                // The one place where the cycle may break is the wrap of u64, 10 billion years away.
                rows.sort_unstable();
                assert_eq!(rows, (0..grid_px).collect::<Vec<_>>());
            }
        }
        assert_eq!(Sampling::of_frame(9, 0), Sampling { every_rows: 1, first_row: 0 });
    }

    #[test]
    fn a_window_lies_about_its_centre() {
        let window = Window::around(Point2::new(100.2, -3.0), 40);
        assert_eq!(window, Window { x: 80, y: -23, width: 40, height: 40 });
        assert_eq!(Window::around(Point2::new(f64::NAN, 1.0), 40).width, 0);
        assert_eq!(Window::around(Point2::new(1e300, 1.0), 40).x, i32::MAX);
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let limits = SpotLimits { min_area: 5, max_area: 4, ..Default::default() };
        assert_eq!(limits.check().unwrap_err().to_string(), "max_area is 4; expected at least min_area");
        assert!(SpotLimits { min_fill: f64::NAN, ..Default::default() }.check().is_err());
        assert!(SpotLimits { max_elongation: 0.5, ..Default::default() }.check().is_err());
        assert!(SpotLimits { min_area: 0, ..Default::default() }.check().is_err());
        assert!(Measure { pixel_sigma: -1.0, ..Default::default() }.check().is_err());
        assert!(Measure { floor_px: f64::NAN, ..Default::default() }.check().is_err());
        assert_eq!((SpotLimits::default().check(), Measure::default().check()), (Ok(()), Ok(())));
    }
}
