//! `structured_light.corners`: the corners of a chessboard in camera and projector.
//!
//! The camera sees corners in the white picture. The place of a corner in the projector's picture follows from the decoded camera pixels around
//! it: a robust homography from camera pixels to projector pixels, evaluated at the corner.
//!
//! Source: D. Moreno, G. Taubin, "Simple, accurate, and robust projector-camera calibration", 3DIMPVT 2012.

use std::collections::BTreeMap;

use foveate::imaging::ImageView;
use foveate::imaging::chessboard::{Corner, find_chessboard, largest_grid};
use foveate::prelude::*;
use nalgebra::{Matrix2, Point2, SMatrix, SVector, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::pattern::projector_of;

ports! {
    pub(crate) fn declared_ports;
    WHITE: In<Image> = each("white");
    MAP: In<ProjectorMap> = each("map");
    FEATURES: Out<Features> = "features";
}

figures! {
    "corners.boards.*": count, high, "Sets of pictures in whose white one the camera saw the board";
    "corners.sets_searched.*": count, neither, "Sets of pictures that were searched for the board";
    "corners.mirrored.*": count, low, "Boards of the camera that appear mirrored in the projector; not used";
    "corners.without_projector.*": count, low, "Corners seen by the camera around which too little was decoded to place them in the projector";
}

/// Sets without a board that are named one by one.
const NAMED: usize = 6;

/// Settings of [`Corners`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CornersSettings {
    /// Inner corners in a row, one less than squares [–]
    #[schemars(range(min = 3, max = 100))]
    pub columns: u32,
    /// Rows of inner corners, one less than squares in a column [–]
    #[schemars(range(min = 3, max = 100))]
    pub rows: u32,
    /// Side of a square, as measured on the board: metres of the calibration come from it [mm]
    #[schemars(range(min = 0.1, max = 10000.0))]
    pub square_mm: f64,
    /// The projector's name in the calibration [–]
    #[serde(default = "crate::pattern::default_projector")]
    pub projector: String,
    /// How far around a corner the camera's pixels count, in sides of its squares [–]
    #[serde(default = "default_reach")]
    #[schemars(range(min = 0.1, max = 2.0))]
    pub reach: f64,
}

fn default_reach() -> f64 {
    0.5
}

/// White pictures and maps in, corners out: those of the camera, then those of the projector, as features of two cameras.
pub struct Corners {
    settings: CornersSettings,
    projector: CameraId,
    camera_name: String,
    white: Option<(Time, Vec<Corner>)>,
    searched: u64,
    found: u64,
    without: u64,
    mirrored: u64,
    /// By corners of the largest grid where the board was not found: in how many pictures.
    others: BTreeMap<[usize; 2], u64>,
    /// Sets in whose white picture no board is found.
    bare: Vec<String>,
}

impl Node for Corners {
    const TYPE: &'static str = "structured_light.corners";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Finds chessboard corners in the camera and in the projector";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CornersSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CornersSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("columns", settings.columns, 3..=100)?;
        ConfigError::unless_in("rows", settings.rows, 3..=100)?;
        ConfigError::unless_in("square_mm", settings.square_mm, 0.1..=10_000.0)?;
        ConfigError::unless_in("reach", settings.reach, 0.1..=2.0)?;
        let projector = projector_of(setup, &settings.projector)?;
        Ok(Self {
            camera_name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            projector: CameraId(projector as u16),
            settings,
            white: None,
            searched: 0,
            found: 0,
            without: 0,
            mirrored: 0,
            others: BTreeMap::new(),
            bare: Vec::new(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(white) = io.take(&WHITE) {
            let image = &white.value;
            let view = ImageView::new(&image.pixels, image.width as usize, image.height as usize);
            let view = view.map_err(NodeError::input)?;
            self.searched += 1;
            let (columns, rows) = (self.settings.columns as usize, self.settings.rows as usize);
            let corners = find_chessboard(&view, columns, rows).unwrap_or_default();
            self.found += u64::from(!corners.is_empty());
            if corners.is_empty() && self.found == 0 {
                largest_grid(&view).into_iter().for_each(|it| *self.others.entry(it).or_default() += 1);
            }
            let list = corners.iter().zip(0..).map(|(it, label)| feature(it.centre, it.covariance, label)).collect();
            io.emit(&FEATURES, white.stamp, Features { camera: image.camera, list });
            self.white = Some((white.time(), corners));
        }
        if let Some(map) = io.take(&MAP) {
            let Some((_, corners)) = self.white.take().filter(|it| it.0 == map.time()) else { return Ok(()) };
            if corners.is_empty() && !map.value.name.is_empty() {
                self.bare.push(map.value.name.clone());
            }
            let mut list = self.in_projector(&map.value, &corners);
            if is_mirrored(&corners, &list) {
                self.mirrored += 1;
                list.clear();
            }
            io.emit(&FEATURES, map.stamp, Features { camera: self.projector, list });
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let name = &self.camera_name;
        report.figure(format!("corners.sets_searched.{name}"), self.searched as f64);
        report.figure(format!("corners.boards.{name}"), self.found as f64);
        report.figure(format!("corners.without_projector.{name}"), self.without as f64);
        report.figure(format!("corners.mirrored.{name}"), self.mirrored as f64);
        if self.mirrored > 0 {
            report.remark(format!(
                "the board appears mirrored in the projector relative to {name} in {} of {} sets, which are not used: the pictures of one of them are mirrored, or columns and rows are swapped (`pattern.order`)",
                self.mirrored, self.found
            ));
        }
        let CornersSettings { columns, rows, .. } = self.settings;
        if self.searched > 0 && self.found < self.searched {
            let missing = self.searched - self.found;
            // In textures seeming grids are found, another one in each picture: a board is the same in most.
            let most = self.others.iter().max_by_key(|it| it.1).filter(|it| 2 * *it.1 > self.searched);
            let there = match most.filter(|_| self.found == 0) {
                Some(([a, b], _)) => format!(
                    ": the largest chessboard there has {a} x {b} inner corners; are `columns` and `rows` its inner corners?"
                ),
                None if self.found == 0 => {
                    ": are `columns` and `rows` its inner corners, and is it seen whole, with a bright rim?".to_owned()
                }
                None => ": is it seen whole, with a bright rim, neither saturated nor dark?".to_owned(),
            };
            let mut bare: Vec<String> = self.bare.iter().take(NAMED).map(|it| format!("`{it}`")).collect();
            if self.bare.len() > NAMED {
                bare.push(format!("{} more", self.bare.len() - NAMED));
            }
            let which =
                if self.found == 0 || bare.is_empty() { String::new() } else { format!(" ({})", bare.join(", ")) };
            report.remark(format!(
                "no chessboard of {columns} x {rows} inner corners in {missing} of {} white pictures of {name}{which}{there}",
                self.searched
            ));
        }
        Ok(())
    }
}

fn feature(centre: Point2<f64>, covariance: Matrix2<f64>, label: u32) -> Feature {
    Feature { centre, covariance, area: 0, peak: 0, label: Some(label) }
}

impl Corners {
    fn in_projector(&mut self, map: &ProjectorMap, corners: &[Corner]) -> Vec<Feature> {
        let columns = self.settings.columns as usize;
        let mut list = Vec::new();
        for (at, corner) in corners.iter().enumerate() {
            let beside = if at % columns > 0 { at - 1 } else { at + 1 };
            let above = if at >= columns { at - columns } else { at + columns };
            let step = |other: usize| (corners[other].centre - corner.centre).norm();
            let reach = (self.settings.reach * step(beside).min(step(above))).max(3.0);
            match at_corner(map, corner, reach) {
                Some((centre, covariance)) => list.push(feature(centre, covariance, at as u32)),
                None => self.without += 1,
            }
        }
        list
    }
}

/// Whether corners turn the other way round in the projector: both look at one side of the board.
fn is_mirrored(corners: &[Corner], in_projector: &[Feature]) -> bool {
    let pairs = in_projector.iter().filter_map(|it| Some((corners.get(it.label? as usize)?.centre, it.centre)));
    let (seen, lit): (Vec<Point2<f64>>, Vec<Point2<f64>>) = pairs.unzip();
    let middle = |list: &[Point2<f64>]| list.iter().map(|it| it.coords).sum::<Vector2<f64>>() / list.len() as f64;
    let (of_seen, of_lit) = (middle(&seen), middle(&lit));
    let shape: Matrix2<f64> =
        seen.iter().zip(&lit).map(|(a, b)| (b.coords - of_lit) * (a.coords - of_seen).transpose()).sum();
    shape.determinant() < 0.0
}

/// Pixels that place a corner, at least.
const MIN_PIXELS: usize = 40;
/// Neighbouring pixels share the boundaries that they come from: so many of them tell as much as one [–].
const SHARED: f64 = 16.0;
/// No corner is taken to be known better than this [px].
const BEST_SIGMA: f64 = 0.02;

/// Where in the projector's picture a corner is, with its covariance, from the pixels at most `reach` away.
fn at_corner(map: &ProjectorMap, corner: &Corner, reach: f64) -> Option<(Point2<f64>, Matrix2<f64>)> {
    let centre = corner.centre;
    let range = |at: f64, size: u32| {
        let (low, high) = ((at - reach).ceil().max(0.0), (at + reach).floor().min(f64::from(size) - 1.0));
        low as usize..(high.max(low - 1.0) + 1.0) as usize
    };
    let mut samples: Vec<[f64; 4]> = Vec::new();
    for y in range(centre.y, map.height) {
        for x in range(centre.x, map.width) {
            let [u, v] = map.get(x, y).coordinate.map(f64::from);
            if u.is_finite() && v.is_finite() {
                samples.push([(x as f64 - centre.x) / reach, (y as f64 - centre.y) / reach, u, v]);
            }
        }
    }
    let origin = samples.iter().fold([0.0; 2], |sum, it| [sum[0] + it[2], sum[1] + it[3]]);
    let origin = origin.map(|it| it / samples.len() as f64);
    samples.iter_mut().for_each(|it| (it[2], it[3]) = (it[2] - origin[0], it[3] - origin[1]));
    for round in 0..5 {
        if samples.len() < MIN_PIXELS {
            return None;
        }
        // u (1 + g x + h y) = a + b x + c y, v (1 + g x + h y) = d + e x + f y
        let mut normal = SMatrix::<f64, 8, 8>::zeros();
        let mut side = SVector::<f64, 8>::zeros();
        for [x, y, u, v] in &samples {
            for (row, seen) in
                [([1.0, *x, *y, 0.0, 0.0, 0.0, -u * x, -u * y], u), ([0.0, 0.0, 0.0, 1.0, *x, *y, -v * x, -v * y], v)]
            {
                let row = SVector::<f64, 8>::from(row);
                normal += row * row.transpose();
                side += row * *seen;
            }
        }
        let inverse = normal.try_inverse()?;
        let h = inverse * side;
        let off = |it: &[f64; 4]| {
            let [x, y, u, v] = *it;
            let depth = 1.0 + h[6] * x + h[7] * y;
            ((h[0] + h[1] * x + h[2] * y) / depth - u).hypot((h[3] + h[4] * x + h[5] * y) / depth - v)
        };
        let mut distances: Vec<f64> = samples.iter().map(off).collect();
        distances.sort_by(f64::total_cmp);
        let limit = (3.0 * distances[distances.len() / 2]).max(0.15);
        let before = samples.len();
        if round < 4 {
            samples.retain(|it| off(it) <= limit);
        }
        if samples.len() == before {
            let squares: f64 = samples.iter().map(|it| off(it).powi(2)).sum();
            let variance = squares / (2.0 * before as f64) * SHARED;
            let of_fit = Matrix2::new(inverse[(0, 0)], inverse[(0, 3)], inverse[(3, 0)], inverse[(3, 3)]) * variance;
            // Where the camera has the corner is as uncertain as the camera says.
            let by_camera = Matrix2::new(h[1], h[2], h[4], h[5]) / reach;
            let covariance = of_fit + by_camera * corner.covariance * by_camera.transpose();
            let covariance = covariance + Matrix2::identity() * (BEST_SIGMA * BEST_SIGMA);
            return Some((Point2::new(h[0] + origin[0], h[3] + origin[1]), covariance));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 7 × 4 inner corners, 20 px apart.
    fn white() -> Image {
        let (width, height) = (240, 180);
        let level = |at: usize| {
            let (x, y) = (at % width, at / width);
            let inside = (20..180).contains(&x) && (20..120).contains(&y);
            if inside && (x / 20 + y / 20) % 2 == 0 { 30 } else { 220 }
        };
        let pixels = (0..width * height).map(level).collect();
        Image { width: width as u32, height: height as u32, pixels, ..Image::default() }
    }

    fn bench(columns: u32, rows: u32) -> NodeBench<Corners> {
        let calibration = foveate_testkit::scene::ring_calibration(2);
        let settings = CornersSettings {
            columns,
            rows,
            square_mm: 30.0,
            projector: calibration.cameras[1].name.clone(),
            reach: default_reach(),
        };
        let setup = Setup { calibration: std::sync::Arc::new(calibration), ..Setup::for_tests() };
        NodeBench::<Corners>::with_setup(settings, &setup).unwrap()
    }

    /// What is said of that board by settings for another.
    fn remarks(columns: u32, rows: u32) -> Vec<String> {
        let mut bench = bench(columns, rows);
        bench.feed(&WHITE, Time::ZERO, white()).unwrap();
        bench.finish().unwrap().remarks
    }

    #[test]
    fn a_board_of_another_size_is_told_with_its_own() {
        assert!(remarks(7, 4).is_empty());
        let said = remarks(8, 6).concat();
        assert!(said.contains("no chessboard of 8 x 6 inner corners in 1 of 1 white pictures"), "{said}");
        assert!(said.contains("the largest chessboard there has 7 x 4 inner corners"), "{said}");
    }

    #[test]
    fn sets_without_the_board_are_named() {
        let mut bench = bench(7, 4);
        let bare = Image { pixels: vec![220; 240 * 180], ..white() };
        for (at, (name, image)) in [("with", white()), ("without", bare)].into_iter().enumerate() {
            let time = Time::from_s(at as f64);
            let map = ProjectorMap { name: name.to_owned(), ..ProjectorMap::default() };
            bench.feed(&WHITE, time, image).unwrap();
            bench.feed(&MAP, time, map).unwrap();
        }
        let said = bench.finish().unwrap().remarks.concat();
        assert!(said.contains("in 1 of 2 white pictures") && said.contains("(`without`)"), "{said}");
    }

    /// The places in the projector of the corners of that board, under a projector whose picture is as wide as the camera's, and mirrored or not.
    fn in_projector(is_mirrored: bool) -> (usize, Vec<String>) {
        let mut bench = bench(7, 4);
        let mut map = ProjectorMap { projector_size: [240, 180], width: 240, height: 180, ..ProjectorMap::default() };
        for at in 0..240 * 180 {
            let (x, y) = ((at % 240) as f32, (at / 240) as f32);
            let coordinate = [if is_mirrored { 239.0 - x } else { x }, 0.9 * y + 5.0];
            map.push(ProjectorSample { coordinate, sigma: [0.05; 2] });
        }
        bench.feed(&WHITE, Time::ZERO, white()).unwrap();
        bench.feed(&MAP, Time::ZERO, map).unwrap();
        let n = bench.outputs(&FEATURES).last().unwrap().value.list.len();
        (n, bench.finish().unwrap().remarks)
    }

    #[test]
    fn a_board_that_is_mirrored_in_the_projector_is_told_and_not_used() {
        assert_eq!(in_projector(false), (28, Vec::new()));
        let (n, said) = in_projector(true);
        assert_eq!(n, 0);
        assert!(said.concat().contains("mirrored"), "{said:?}");
    }
}
