//! Maps of cameras from what the wall showed at known places, one after another: dots, or a chessboard.
//!
//! A dot is identified by the time at which it was shown. A camera's spots in the frames of that time, less the display's delay, are its pictures of the dot, where each frame has one spot and
//! all are at one place. With a board the same holds of each of its corners. Every fourth dot is held out of a first fit, which gives the error at points that were not fitted; places of a
//! board are held out in four rounds; the map itself is fitted to all.

use std::collections::{BTreeMap, BTreeSet};

use foveate::estimation::statistics::median;
use foveate::geometry::{PlaneMap, PlanePoint};
use foveate::prelude::*;
use foveate::scene::{WallCamera, WallMap};
use nalgebra::{Point2, Vector2};

use super::boards::{BoardSize, SeenBoard, untangled};
use super::fit::{HoldOut, Sighting, Surface, fit, stance};

/// Largest spread of the frames of one dot at rest [px].
const SCATTER_PX: f64 = 1.0;
/// Smallest standard deviation of a place: pixels are not uniform [px].
const LEAST_SIGMA_PX: f64 = 0.02;
/// A dot this near to the edge of a picture may be cut off, its centre wrong [px].
const EDGE_PX: f64 = 8.0;
/// A dot or a board that the wall was requested to show.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// Its place on the wall: one point for a dot, all corners of a board, row by row from its upper left one [m].
    pub points: Vec<Point2<f64>>,
    /// Start of the request.
    pub from: Time,
    /// End of the request.
    pub until: Time,
}

/// A spot, or a corner of a board, in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Its centre [px].
    pub pixel: Point2<f64>,
    /// Variance along each axis [px²].
    pub variance: f64,
    /// Its brightest pixel [gray level].
    pub peak: u8,
    /// The corner's number.
    pub label: Option<u32>,
}

/// Spots of one camera in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// When it was taken.
    pub time: Time,
    /// All that was found.
    pub spots: Vec<Spot>,
}

/// The wall as measured with a ruler.
#[derive(Debug, Clone, PartialEq)]
pub struct WallSize {
    /// Size of the displayed area [m].
    pub size_m: [f64; 2],
    /// Side of one of its pixels [m].
    pub pixel_m: f64,
    /// Displays along rows and columns.
    pub tiles: [u32; 2],
}

/// Results for one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraResult {
    /// Dots or boards that it saw.
    pub n_seen: usize,
    /// Dots or boards with an ambiguous place: several spots, or spots that moved.
    pub n_doubtful: usize,
    /// Those of them that became clear later in their time: the one before was seen for longer than requested.
    pub n_late: usize,
    /// Boards that it saw with another number of corners: the last such number.
    pub other_corners: Option<usize>,
    /// Boards that were elsewhere than stated.
    pub n_elsewhere: usize,
    /// Its unusual view of the wall: mirrored or upside down.
    pub stance: Option<&'static str>,
    /// Its map, or why there is none.
    pub map: Result<WallCamera, String>,
}

/// Results of a calibration from dots or boards.
#[derive(Debug, Clone, PartialEq)]
pub struct ShownCalibration {
    /// By the camera's number.
    pub cameras: Vec<CameraResult>,
    /// Displays on which no camera saw anything: column, row, number of dots or boards.
    pub dark: Vec<([u32; 2], usize)>,
    /// By the camera's number, dots or boards in its picture that only another camera saw.
    pub hidden: Vec<usize>,
}

impl ShownCalibration {
    /// The maps, by the cameras' names.
    pub fn map(&self, wall: &WallSize, names: &[String]) -> WallMap {
        let good = names.iter().zip(&self.cameras).filter_map(|(name, it)| Some((name.clone(), it.map.clone().ok()?)));
        WallMap { size_m: wall.size_m, pixel_m: wall.pixel_m, cameras: good.collect() }
    }
}

/// Options of a calibration from shown objects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShownOptions {
    /// Inner corners of the board; `None` for dots.
    pub board: Option<BoardSize>,
    /// Delay after a request until the object is certainly seen, and the one before it certainly gone.
    pub settle: Interval,
    /// Shape of the wall.
    pub surface: Surface,
    /// Largest error at held-out points that is accepted [px of the wall].
    pub limit_px: f64,
}

/// Finds the maps of all cameras. `frames` are those of each camera, in the order of their numbers, by time.
pub fn calibrate(
    wall: &WallSize,
    sizes: &[[u32; 2]],
    shown: &[Shown],
    frames: &[Vec<Frame>],
    options: &ShownOptions,
) -> ShownCalibration {
    let mut seen: Vec<BTreeSet<usize>> = Vec::new();
    let mut cameras = Vec::new();
    for (size, frames) in sizes.iter().zip(frames) {
        let found = observed(*size, shown, frames, options);
        cameras.push(camera(wall, *size, (shown, frames), &found, options));
        seen.push(found.boards.keys().copied().collect());
    }
    let maps: Vec<Option<&PlaneMap>> = cameras.iter().map(|it| it.map.as_ref().ok().map(|it| &it.map)).collect();
    let in_view = |it: &Shown, camera: usize| {
        maps[camera].is_some_and(|map| it.points.iter().all(|point| map.sees(point, EDGE_PX + 1.0)))
    };
    let mut hidden = vec![0; sizes.len()];
    let mut tiles = BTreeMap::<[u32; 2], (usize, usize)>::new();
    for (number, it) in shown.iter().enumerate() {
        let n_seen = seen.iter().filter(|it| it.contains(&number)).count();
        for (camera, count) in hidden.iter_mut().enumerate() {
            *count += usize::from(n_seen > 0 && in_view(it, camera) && !seen[camera].contains(&number));
        }
        let middle = it.points.iter().fold(Vector2::zeros(), |sum, it| sum + it.coords) / it.points.len() as f64;
        let tile = [0, 1].map(|axis| {
            let part = middle[axis] / wall.size_m[axis] * f64::from(wall.tiles[axis]);
            part.clamp(0.0, f64::from(wall.tiles[axis]) - 1.0) as u32
        });
        let of = tiles.entry(tile).or_default();
        *of = (of.0 + 1, of.1 + usize::from(n_seen > 0));
    }
    let dark = tiles.into_iter().filter(|it| it.1.1 == 0).map(|(tile, (shown, _))| (tile, shown)).collect();
    ShownCalibration { cameras, dark, hidden }
}

/// Observations of one camera.
#[derive(Debug, Default)]
struct Observed {
    /// By the number of the dot or board, the pixels of its points and their standard deviations [px].
    boards: BTreeMap<usize, Vec<(Point2<f64>, f64)>>,
    peaks: Vec<f64>,
    n_doubtful: usize,
    n_late: usize,
    /// Dots or boards without a picture in their time.
    n_untimed: usize,
    other_corners: Option<usize>,
}

/// Mean place of each dot or board over the frames of its time.
fn observed(size: [u32; 2], shown: &[Shown], frames: &[Frame], options: &ShownOptions) -> Observed {
    let is_whole = |pixel: &Vector2<f64>| {
        (0..2).all(|axis| (EDGE_PX..f64::from(size[axis]) - 1.0 - EDGE_PX).contains(&pixel[axis]))
    };
    let mut found = Observed::default();
    for (number, it) in shown.iter().enumerate() {
        let first = frames.partition_point(|frame| frame.time < it.from + options.settle);
        let timed = frames[first..].iter().take_while(|frame| frame.time <= it.until);
        // Pictures were taken while it was told, and none of them counts.
        let is_requested = |frame: &Frame| (it.from..=it.until).contains(&frame.time);
        let mut before = frames[..first].iter().rev().take_while(|frame| frame.time >= it.from);
        found.n_untimed += usize::from(timed.clone().next().is_none() && before.any(is_requested));
        let own: Vec<&[Spot]> = timed.map(|frame| frame.spots.as_slice()).filter(|spots| !spots.is_empty()).collect();
        let n_points = it.points.len();
        if options.board.is_some()
            && let Some(other) = own.iter().find(|spots| spots.len() != n_points)
        {
            found.other_corners = Some(other.len());
        }
        if own.is_empty() {
            continue;
        }
        let later = &own[own.len().div_ceil(2)..];
        if own.iter().any(|spots| spots.len() != n_points) {
            found.n_doubtful += 1;
            found.n_late += usize::from(is_still(later, n_points));
            continue;
        }
        let n = own.len() as f64;
        let mut pixels = Vec::with_capacity(n_points);
        let (mut scatter, mut all_whole) = (0.0_f64, true);
        for at in 0..n_points {
            let spots = own.iter().map(|spots| &spots[at]);
            let mean = spots.clone().map(|it| it.pixel.coords).sum::<Vector2<f64>>() / n;
            scatter = spots.clone().map(|it| (it.pixel.coords - mean).norm()).fold(scatter, f64::max);
            all_whole &= is_whole(&mean);
            let variance = spots.map(|it| it.variance).sum::<f64>() / n;
            pixels.push((Point2::from(mean), (variance / n).sqrt().max(LEAST_SIGMA_PX)));
        }
        if scatter > SCATTER_PX {
            found.n_doubtful += 1;
            found.n_late += usize::from(is_still(later, n_points));
        } else if all_whole {
            let peaks: Vec<f64> = own.iter().flat_map(|spots| spots.iter().map(|it| f64::from(it.peak))).collect();
            found.peaks.push(median(&peaks).unwrap_or(0.0));
            found.boards.insert(number, pixels);
        }
    }
    found
}

/// Whether all of `frames`, of which there are some, have `n_points` spots that keep their places.
fn is_still(frames: &[&[Spot]], n_points: usize) -> bool {
    let Some(first) = frames.first().filter(|_| frames.iter().all(|spots| spots.len() == n_points)) else {
        return false;
    };
    let off = |spots: &&&[Spot]| spots.iter().zip(*first).any(|(a, b)| (a.pixel - b.pixel).norm() > SCATTER_PX);
    !frames.iter().any(|spots| off(&spots))
}

/// The map of one camera from its observations.
fn camera(
    wall: &WallSize,
    size: [u32; 2],
    (shown, frames): (&[Shown], &[Frame]),
    found: &Observed,
    options: &ShownOptions,
) -> CameraResult {
    let brightest = median(&found.peaks).unwrap_or(0.0);
    let mut n_elsewhere = 0;
    let map = match options.board {
        None => {
            let seen = found.boards.iter().enumerate().map(|(group, (number, pixels))| {
                let (pixel, sigma) = pixels[0];
                Sighting { group, point: PlanePoint { point: shown[*number].points[0], pixel, sigma } }
            });
            let size = (size, options.surface);
            fit(wall, size, &seen.collect::<Vec<_>>(), (HoldOut::Fourth, "dots"), brightest, options.limit_px)
        }
        Some(board) => {
            let boards = found
                .boards
                .iter()
                .map(|(number, pixels)| SeenBoard { places: shown[*number].points.clone(), pixels: pixels.clone() });
            untangled(size, &boards.collect::<Vec<_>>(), board).and_then(|boards| {
                n_elsewhere = boards.iter().filter(|it| it.is_none()).count();
                let seen = boards
                    .into_iter()
                    .flatten()
                    .enumerate()
                    .flat_map(|(group, points)| points.into_iter().map(move |point| Sighting { group, point }));
                let seen: Vec<Sighting> = seen.collect();
                let size = (size, options.surface);
                fit(wall, size, &seen, (HoldOut::InTurn, "corners of boards"), brightest, options.limit_px)
            })
        }
    };
    // Who looks at no picture cannot see anything: the room has no part in it.
    let map = map.map_err(|why| match frames.is_empty() {
        true => "it delivered no pictures: is it connected?".to_owned(),
        false if 2 * found.n_untimed > shown.len() => {
            let lasts = shown.iter().map(|it| (it.until - it.from).as_ms()).collect::<Vec<_>>();
            format!(
                "it took no picture in the time of {} of {} {}: each is requested for {:.0} ms, and the first {:.0} ms of these are left out (`settle_ms`)",
                found.n_untimed,
                shown.len(),
                if options.board.is_some() { "places of a board" } else { "dots" },
                median(&lasts).unwrap_or(0.0),
                options.settle.as_ms()
            )
        }
        false => why,
    });
    CameraResult {
        n_seen: found.boards.len(),
        n_doubtful: found.n_doubtful,
        n_late: found.n_late,
        other_corners: found.other_corners,
        n_elsewhere,
        stance: map.as_ref().ok().and_then(|it| stance(&it.map)),
        map,
    }
}
