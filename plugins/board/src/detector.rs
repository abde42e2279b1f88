//! `board.detector`: finds the inner corners of a chessboard in the pictures of one camera.

use foveate::imaging::chessboard::{find_chessboard, largest_grid};
use foveate::imaging::plane::{self, Channel};
use foveate::imaging::{ImageView, ImagingError};
use foveate::prelude::*;
use nalgebra::Point2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    IMAGE: In<Image> = each("image");
    FEATURES: Out<Features> = "features";
}

figures! {
    "detector.boards.*": count, high, "Pictures of the camera in which the board was found";
    "detector.pictures_searched.*": count, neither, "Pictures of the camera that were searched for the board";
    "detector.pictures_refused.*": count, low, "Pictures of the camera that could not be used: wrong size or pixels";
}

/// Pictures without the board that are searched for a board of another size, which takes as long again.
const MAX_PROBED: u64 = 5;

/// Settings of [`Detector`]. Colour pictures are reduced to their brightness.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoardSettings {
    /// Inner corners in a row, one less than squares [–].
    #[schemars(range(min = 3, max = 100))]
    pub columns: u32,
    /// Rows of inner corners, one less than squares in a column [–].
    #[schemars(range(min = 3, max = 100))]
    pub rows: u32,
    /// Side of a square, as measured on the board: metres of the calibration come from it [mm].
    #[schemars(range(min = 0.1, max = 10000.0))]
    pub square_mm: f64,
}

/// Pictures in, corners out: corner `row · columns + column` has that label; its peak is the brightest pixel of the squares around it. All corners, or none unless the whole board is seen.
///
/// Corner 0 is next to a dark square at the board's end, and the printed face is towards the camera. Where both ends are dark (`columns +
/// rows` even), the two ends look alike: corner 0 is the one nearer to the upper left of the picture, and `foveate calibrate` resolves
/// the order from other cameras.
pub struct Detector {
    settings: BoardSettings,
    camera: Option<CameraId>,
    camera_name: String,
    gray: Vec<u8>,
    pool: Pool<Features>,
    searched: u64,
    found: u64,
    refused: u64,
    /// Another board that was seen: its corners, the longer side first.
    other: Option<[usize; 2]>,
}

impl Node for Detector {
    const TYPE: &'static str = "board.detector";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Finds chessboard corners in the pictures of one camera";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = BoardSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: BoardSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("columns", settings.columns, 3..=100)?;
        ConfigError::unless_in("rows", settings.rows, 3..=100)?;
        ConfigError::unless_in("square_mm", settings.square_mm, 0.1..=10_000.0)?;
        Ok(Self {
            settings,
            camera: setup.camera,
            camera_name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            gray: Vec::new(),
            pool: Pool::default(),
            searched: 0,
            found: 0,
            refused: 0,
            other: None,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(image) = io.take(&IMAGE) else { return Ok(()) };
        let mut features = self.pool.take(Features::default);
        features.camera = self.camera.unwrap_or(image.value.camera);
        match self.find(&image.value, &mut features.list) {
            Ok(()) => {
                let features = self.pool.share(features);
                io.emit(&FEATURES, image.stamp, features);
            }
            Err(refusal) => {
                self.refused += 1;
                io.gap(&FEATURES, image.time(), refusal);
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let name = &self.camera_name;
        report.figure(format!("detector.pictures_searched.{name}"), self.searched as f64);
        report.figure(format!("detector.boards.{name}"), self.found as f64);
        if self.refused > 0 {
            report.figure(format!("detector.pictures_refused.{name}"), self.refused as f64);
        }
        let BoardSettings { columns, rows, .. } = self.settings;
        if self.found == 0
            && let Some([long, short]) = self.other
        {
            report.remark(format!(
                "{name} saw no board of {columns} x {rows} inner corners, but one of {long} x {short}: are `columns` and `rows` right?"
            ));
        }
        Ok(())
    }
}

impl Detector {
    fn find(&mut self, image: &Image, list: &mut Vec<Feature>) -> Result<(), ImagingError> {
        list.clear();
        let pixels = match image.format {
            PixelFormat::Gray8 => image.pixels.as_slice(),
            PixelFormat::Rgb8 => {
                plane::extract(Channel::Luma, &image.pixels, &mut self.gray)?;
                &self.gray
            }
        };
        let view = ImageView::new(pixels, image.width as usize, image.height as usize)?;
        let (columns, rows) = (self.settings.columns as usize, self.settings.rows as usize);
        self.searched += 1;
        let Some(corners) = find_chessboard(&view, columns, rows) else {
            if self.found == 0 && self.searched <= MAX_PROBED {
                self.other = self.other.max(largest_grid(&view));
            }
            return Ok(());
        };
        self.found += 1;
        list.extend(corners.iter().zip(0..).map(|(corner, label)| {
            let next = if label + 1 < corners.len() { label + 1 } else { label - 1 };
            Feature {
                centre: image.window.in_camera(&corner.centre),
                covariance: corner.covariance * f64::from(image.window.shrink).powi(2),
                area: 0,
                peak: brightest_around(&view, &corner.centre, 0.5 * (corners[next].centre - corner.centre).norm()),
                label: Some(label as u32),
            }
        }));
        Ok(())
    }
}

/// The brightest pixel at most `reach` from `centre`, along each axis.
fn brightest_around(view: &ImageView<'_>, centre: &Point2<f64>, reach: f64) -> u8 {
    let along = |axis: usize, size: usize| {
        let bound = |at: f64| at.round().clamp(0.0, size as f64 - 1.0) as usize;
        bound(centre[axis] - reach)..=bound(centre[axis] + reach)
    };
    let columns = along(0, view.width());
    along(1, view.height()).flat_map(|row| view.row(row)[columns.clone()].iter().copied()).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    const BOARD: &str = "columns = 7\nrows = 4\nsquare_mm = 30";

    fn detector(columns: u32, rows: u32) -> Detector {
        Detector::new(BoardSettings { columns, rows, square_mm: 30.0 }, &Setup::for_tests()).unwrap()
    }

    /// 7 × 4 inner corners, 20 px apart, the first at (39.5, 39.5), the square before it dark.
    fn picture(format: PixelFormat) -> Image {
        let (width, height) = (240, 180);
        let level = |at: usize| {
            let (x, y) = (at % width, at / width);
            let inside = (20..180).contains(&x) && (20..120).contains(&y);
            if inside && (x / 20 + y / 20) % 2 == 0 { 30 } else { 220 }
        };
        let gray = (0..width * height).map(level);
        let pixels = match format {
            PixelFormat::Gray8 => gray.collect(),
            PixelFormat::Rgb8 => gray.flat_map(|it| [it; 3]).collect(),
        };
        Image { width: width as u32, height: height as u32, format, pixels, ..Image::default() }
    }

    #[test]
    fn node_keeps_its_promises() {
        check_node::<Detector>(BOARD);
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let setting = |columns, rows, square_mm| {
            Detector::new(BoardSettings { columns, rows, square_mm }, &Setup::for_tests())
                .err()
                .and_then(|it| it.setting)
        };
        assert_eq!(setting(7, 4, 30.0), None);
        assert_eq!(setting(2, 4, 30.0).as_deref(), Some("columns"));
        assert_eq!(setting(7, 101, 30.0).as_deref(), Some("rows"));
        for square_mm in [0.0, -30.0, f64::NAN, f64::INFINITY] {
            assert_eq!(setting(7, 4, square_mm).as_deref(), Some("square_mm"));
        }
    }

    #[test]
    fn corners_carry_their_number_in_gray_and_in_colour() {
        for format in [PixelFormat::Gray8, PixelFormat::Rgb8] {
            let (mut detector, mut list) = (detector(7, 4), vec![]);
            detector.find(&picture(format), &mut list).unwrap();
            assert_eq!(list.len(), 28);
            for (at, feature) in list.iter().enumerate() {
                let truth = Point2::new(39.5 + 20.0 * (at % 7) as f64, 39.5 + 20.0 * (at / 7) as f64);
                assert_eq!((feature.label, feature.peak), (Some(at as u32), 220));
                assert!((feature.centre - truth).norm() < 0.05, "{} for {truth}", feature.centre);
            }
        }
    }

    #[test]
    fn corners_of_a_part_lie_where_they_lie_in_the_whole_picture() {
        let whole = picture(PixelFormat::Gray8);
        let pixels = (5..160).flat_map(|row| whole.pixels[row * 240 + 10..row * 240 + 210].iter().copied()).collect();
        let window = foveate::messages::Window { left: 10, top: 5, shrink: 1 };
        let part = Image { width: 200, height: 155, pixels, window, ..Image::default() };
        let find = |image: &Image| {
            let mut list = vec![];
            detector(7, 4).find(image, &mut list).unwrap();
            list
        };
        let (of_whole, of_part) = (find(&whole), find(&part));
        assert_eq!([of_whole.len(), of_part.len()], [28, 28]);
        assert!(of_whole.iter().zip(&of_part).all(|(a, b)| (a.centre - b.centre).norm() < 1e-6));
        // Said to be half as large as it was taken: twice as far apart, four times the variance.
        let half = Image { window: foveate::messages::Window { left: 0, top: 0, shrink: 2 }, ..whole.clone() };
        for (a, b) in of_whole.iter().zip(find(&half)) {
            assert!((b.centre - a.centre * 2.0 - nalgebra::Vector2::repeat(0.5)).norm() < 1e-9);
            assert!((b.covariance - a.covariance * 4.0).norm() < 1e-12);
        }
    }

    #[test]
    fn another_board_is_told_and_none_is_an_empty_list() {
        let (mut detector, mut list) = (detector(8, 6), vec![]);
        detector.find(&picture(PixelFormat::Gray8), &mut list).unwrap();
        assert!(list.is_empty());
        let mut report = Report::default();
        detector.finish(&mut report).unwrap();
        assert!(
            report.remarks[0].contains("no board of 8 x 6 inner corners, but one of 7 x 4"),
            "{:?}",
            report.remarks
        );
        let blank = Image { pixels: vec![90; 240 * 180], ..picture(PixelFormat::Gray8) };
        detector.find(&blank, &mut list).unwrap();
        assert!(list.is_empty());
    }

    #[test]
    fn a_broken_picture_is_refused() {
        let mut short = picture(PixelFormat::Gray8);
        short.pixels.pop();
        assert!(detector(7, 4).find(&short, &mut Vec::new()).is_err());
    }
}
