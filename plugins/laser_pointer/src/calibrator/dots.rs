//! Maps of cameras from dots that the wall showed one after another: pure, without time of its own.
//!
//! A dot is known by when it was shown. A camera's spots in the frames of that time, less the display's delay, are its pictures of the dot, where each frame has one spot and
//! all are at one place. Every fourth dot is left out of a first fit and tells the error where nothing was fitted; the map itself is fitted to all.

use std::collections::BTreeMap;

use foveate::estimation::statistics::median;
use foveate::geometry::{PlaneMap, PlaneMapError, PlanePoint};
use foveate::prelude::*;
use foveate::scene::{WallCamera, WallMap};
use nalgebra::{Matrix2, Point2};

/// Frames of one dot may differ by so much and still be of one place [px].
const SCATTER_PX: f64 = 1.0;
/// No place is known better than this: pixels are not the same all over [px].
const LEAST_SIGMA_PX: f64 = 0.02;
/// A dot this near to the edge of a picture may be cut off, its centre wrong [px].
const EDGE_PX: f64 = 8.0;
/// Every so many dots one is held out.
const HELD_OUT: usize = 4;

/// A dot as the wall was told to show it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShownDot {
    /// Its number.
    pub number: u32,
    /// Where on the wall [m].
    pub point: Point2<f64>,
    /// From when to when it was asked for.
    pub from: Time,
    /// The same, its end.
    pub until: Time,
}

/// Spots of one camera in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// When it was taken.
    pub time: Time,
    /// Centre and peak of each spot.
    pub spots: Vec<(Point2<f64>, f64, u8)>,
}

/// The wall as it was measured with a rule.
#[derive(Debug, Clone, PartialEq)]
pub struct WallSize {
    /// Of what it can show [m].
    pub size_m: [f64; 2],
    /// Side of one of its pixels [m].
    pub pixel_m: f64,
    /// Displays along rows and columns.
    pub tiles: [u32; 2],
}

/// What was found of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraResult {
    /// Dots that it saw.
    pub n_dots: usize,
    /// Frames in which a dot's place was in doubt: more spots than one, or spots that moved.
    pub n_doubtful: usize,
    /// Its map, or why there is none.
    pub map: Result<WallCamera, String>,
}

/// What dots gave.
#[derive(Debug, Clone, PartialEq)]
pub struct DotCalibration {
    /// By the camera's number.
    pub cameras: Vec<CameraResult>,
    /// Displays of which no camera saw a dot though some camera's map has them: column, row, how many dots.
    pub dark: Vec<([u32; 2], usize)>,
    /// By the camera's number, dots that lie in its picture and that another camera saw, but not it.
    pub hidden: Vec<usize>,
}

impl DotCalibration {
    /// The maps, by the cameras' names.
    pub fn map(&self, wall: &WallSize, names: &[String]) -> WallMap {
        let good = names.iter().zip(&self.cameras).filter_map(|(name, it)| Some((name.clone(), it.map.clone().ok()?)));
        WallMap { size_m: wall.size_m, pixel_m: wall.pixel_m, cameras: good.collect() }
    }
}

/// Finds the maps of all cameras. `frames` are those of each camera, in the order of their numbers; `settle` is how long after it was asked for a dot is certain to be seen, and the one
/// before it certain to be gone; `limit_px` is the largest error at held-out dots that is accepted [px of the wall].
pub fn calibrate(
    wall: &WallSize,
    sizes: &[[u32; 2]],
    dots: &[ShownDot],
    frames: &[Vec<Frame>],
    settle: Interval,
    limit_px: f64,
) -> DotCalibration {
    let mut seen: Vec<BTreeMap<u32, PlanePoint>> = Vec::new();
    let mut cameras = Vec::new();
    for (size, frames) in sizes.iter().zip(frames) {
        let (points, peaks, n_doubtful) = points(*size, dots, frames, settle);
        let map = camera(wall, *size, &points, &peaks, limit_px);
        cameras.push(CameraResult { n_dots: points.len(), n_doubtful, map });
        seen.push(points);
    }
    let maps: Vec<Option<&PlaneMap>> = cameras.iter().map(|it| it.map.as_ref().ok().map(|it| &it.map)).collect();
    let in_view = |it: &ShownDot, camera: usize| maps[camera].is_some_and(|map| map.sees(&it.point, EDGE_PX + 1.0));
    let mut hidden = vec![0; sizes.len()];
    let mut tiles = BTreeMap::<[u32; 2], (usize, usize)>::new();
    for dot in dots {
        let n_seen = seen.iter().filter(|it| it.contains_key(&dot.number)).count();
        for (camera, count) in hidden.iter_mut().enumerate() {
            *count += usize::from(n_seen > 0 && in_view(dot, camera) && !seen[camera].contains_key(&dot.number));
        }
        let tile = [0, 1].map(|axis| {
            let part = dot.point[axis] / wall.size_m[axis] * f64::from(wall.tiles[axis]);
            part.clamp(0.0, f64::from(wall.tiles[axis]) - 1.0) as u32
        });
        let of = tiles.entry(tile).or_default();
        *of = (of.0 + 1, of.1 + usize::from(n_seen > 0));
    }
    let dark = tiles.into_iter().filter(|it| it.1.1 == 0).map(|(tile, (shown, _))| (tile, shown)).collect();
    DotCalibration { cameras, dark, hidden }
}

/// Where a camera saw each dot, with the dots' peaks, and the number of dots that were in doubt.
fn points(
    size: [u32; 2],
    dots: &[ShownDot],
    frames: &[Frame],
    settle: Interval,
) -> (BTreeMap<u32, PlanePoint>, Vec<f64>, usize) {
    let is_whole = |pixel: &nalgebra::Vector2<f64>| {
        (0..2).all(|axis| (EDGE_PX..f64::from(size[axis]) - 1.0 - EDGE_PX).contains(&pixel[axis]))
    };
    let (mut found, mut peaks, mut doubtful) = (BTreeMap::new(), Vec::new(), 0);
    for dot in dots {
        let first = frames.partition_point(|it| it.time < dot.from + settle);
        let own = frames[first..].iter().take_while(|it| it.time <= dot.until);
        let own: Vec<&Frame> = own.filter(|it| !it.spots.is_empty()).collect();
        if own.is_empty() {
            continue;
        }
        let n = own.len() as f64;
        let mean = own.iter().map(|it| it.spots[0].0.coords).sum::<nalgebra::Vector2<f64>>() / n;
        let scatter = own.iter().map(|it| (it.spots[0].0.coords - mean).norm()).fold(0.0, f64::max);
        if own.iter().any(|it| it.spots.len() > 1) || scatter > SCATTER_PX {
            doubtful += 1;
            continue;
        }
        if !is_whole(&mean) {
            continue;
        }
        let variance = own.iter().map(|it| it.spots[0].1).sum::<f64>() / n;
        let sigma = (variance / n).sqrt().max(LEAST_SIGMA_PX);
        peaks.push(median(&own.iter().map(|it| f64::from(it.spots[0].2)).collect::<Vec<f64>>()).unwrap_or(0.0));
        found.insert(dot.number, PlanePoint { point: dot.point, pixel: Point2::from(mean), sigma });
    }
    (found, peaks, doubtful)
}

fn camera(
    wall: &WallSize,
    size: [u32; 2],
    points: &BTreeMap<u32, PlanePoint>,
    peaks: &[f64],
    limit_px: f64,
) -> Result<WallCamera, String> {
    let all: Vec<PlanePoint> = points.values().copied().collect();
    let why = |error: PlaneMapError| match error {
        PlaneMapError::TooFew { count } => {
            format!(
                "it saw {count} dots, expected at least {}: does it look at the wall, and is the way free?",
                foveate::geometry::plane_map::LEAST_POINTS
            )
        }
        PlaneMapError::OnALine { count, .. } => {
            format!(
                "it saw {count} dots on one line, expected dots all over its picture: most of its view is hidden, or beside the wall"
            )
        }
        PlaneMapError::NoFit(why) => why,
    };
    let map = PlaneMap::fit(size, &all).map_err(why)?;
    let of_kind = |held: bool| all.iter().enumerate().filter(move |it| (it.0 % HELD_OUT == 1) == held).map(|it| *it.1);
    let kept: Vec<PlanePoint> = of_kind(false).collect();
    let partly =
        PlaneMap::fit(size, &kept).map_err(|error| format!("without the dots that are held out: {}", why(error)))?;
    let squares: Vec<f64> = of_kind(true)
        .map(|it| {
            let placed = partly.place(&it.pixel, &Matrix2::zeros());
            placed.map_or(f64::INFINITY, |placed| (placed.point - it.point).norm_squared())
        })
        .collect();
    let held_out_px = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt() / wall.pixel_m;
    if held_out_px > limit_px || held_out_px.is_nan() {
        return Err(format!(
            "at {} dots that were held out it is off by {held_out_px:.2} px of the wall, expected at most {limit_px}: is the wall flat, and its size right?",
            squares.len()
        ));
    }
    let brightest = median(peaks).unwrap_or(0.0).max(1.0);
    Ok(WallCamera { map, held_out_px: held_out_px.max(1e-6), brightest })
}
