//! Coverage of one camera.

use foveate_geometry::{Camera, Ray};
use nalgebra::{Matrix2, Point2, Vector2};

use super::{CoverageOptions, Seen};
use crate::recording::{CameraFrame, CameraGuess, Spot};

/// Places that are watched for lights that stand; a room has fewer lamps than that in one picture.
const PLACES: usize = 8;
/// A standing light is in this part of the pictures since it was found.
const STANDS: f64 = 0.7;
/// Shares of the last pictures, not of all, so that a fault that was mended is forgotten: each picture has this weight.
const NEWEST: f64 = 0.02;

#[derive(Debug, Clone, PartialEq)]
pub(super) struct CameraCoverage {
    pub name: String,
    camera: Camera,
    /// Frames with the light in a new place.
    pub frames: u32,
    /// Row by row.
    pub cells: Vec<u16>,
    full: usize,
    /// Frames since a cell became full.
    pub since_full: u32,
    mean: Vector2<f64>,
    scatter: Matrix2<f64>,
    counted_at: Option<Point2<f64>>,
    /// As last seen.
    pub last: Seen,
    places: [Place; PLACES],
    camera_frames: u32,
    /// Share of the last pictures with a light in which it stands.
    pub still: f64,
    /// Share of the last pictures with a light in which there were too many.
    pub several: f64,
    /// When there was last any light.
    pub lit_s: f64,
}

/// A place at which a light may be standing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Place {
    pixel: Point2<f64>,
    hits: u32,
    first: u32,
    last: u32,
}

impl CameraCoverage {
    pub(super) fn new(guess: &CameraGuess, grid: [usize; 2]) -> Self {
        Self {
            name: guess.name.clone(),
            camera: guess.camera.clone(),
            frames: 0,
            cells: vec![0; grid[0] * grid[1]],
            full: 0,
            since_full: 0,
            mean: Vector2::zeros(),
            scatter: Matrix2::zeros(),
            counted_at: None,
            last: Seen { number: 0, time_s: f64::NEG_INFINITY, moved: false, ideal: None, ray: None },
            places: [Place::default(); PLACES],
            camera_frames: 0,
            still: 0.0,
            several: 0.0,
            lit_s: f64::NEG_INFINITY,
        }
    }

    /// Takes a picture in; whether it shows the light that is waved.
    pub(super) fn observe(
        &mut self,
        camera_frame: &CameraFrame,
        options: &CoverageOptions,
        ray: impl Fn(&Point2<f64>) -> Option<Ray>,
    ) -> bool {
        self.camera_frames += 1;
        let usable = || camera_frame.spots.iter().filter(|it| self.camera.has_pixel(&it.pixel));
        if usable().next().is_none() {
            return false;
        }
        let labelled = usable().any(|it| it.label.is_some());
        let mut places = self.places;
        let (mut light, mut moving): (Option<&Spot>, usize) = (None, 0);
        for spot in usable() {
            if watch(&mut places, spot.pixel, self.camera_frames, options) && !labelled {
                continue;
            }
            moving += 1;
            let better = |it: &Spot| match (it.label, spot.label) {
                (Some(held), Some(offered)) => offered < held,
                _ => spot.peak > it.peak,
            };
            if light.is_none_or(better) {
                light = Some(spot);
            }
        }
        self.places = places;
        self.lit_s = camera_frame.time_s;
        let fade = |share: &mut f64, now: bool| *share += NEWEST * (f64::from(u8::from(now)) - *share);
        fade(&mut self.still, light.is_none());
        fade(&mut self.several, moving > options.lights && !labelled);
        let Some(light) = light.map(|it| it.pixel) else { return false };
        let moved = self.counted_at.is_none_or(|it| (it - light).norm() >= options.step_px);
        if moved {
            self.counted_at = Some(light);
            self.count(&light, options);
            if labelled {
                camera_frame.spots.iter().filter(|it| it.pixel != light).for_each(|it| self.fill(&it.pixel, options));
            }
        }
        let focal = self.camera.intrinsics.focal;
        let ideal = self.camera.normalise(&light).map(|it| [it.x * focal[0], it.y * focal[1]].map(|it| it as f32));
        self.last = Seen { number: self.last.number + 1, time_s: camera_frame.time_s, moved, ideal, ray: ray(&light) };
        true
    }

    fn count(&mut self, pixel: &Point2<f64>, options: &CoverageOptions) {
        self.frames += 1;
        self.since_full += 1;
        let before = pixel.coords - self.mean;
        self.mean += before / f64::from(self.frames);
        self.scatter += before * (pixel.coords - self.mean).transpose();
        self.fill(pixel, options);
    }

    fn fill(&mut self, pixel: &Point2<f64>, options: &CoverageOptions) {
        if !self.camera.has_pixel(pixel) {
            return;
        }
        let size = self.camera.image_size.map(f64::from);
        let [column, row] = [0, 1].map(|it| {
            let part = (pixel[it] + 0.5) / size[it];
            ((part * options.grid[it] as f64) as usize).min(options.grid[it] - 1)
        });
        let cell = &mut self.cells[row * options.grid[0] + column];
        *cell = cell.saturating_add(1);
        if u32::from(*cell) == options.full_cell.max(1) {
            self.full += 1;
            self.since_full = 0;
        }
    }

    /// Part of the cells that are full.
    pub(super) fn share(&self, options: &CoverageOptions) -> f64 {
        self.full as f64 / (options.grid[0] * options.grid[1]) as f64
    }

    /// Standard deviation across the line along which the pixels spread most, of the image's width.
    pub(super) fn spread(&self) -> f64 {
        let scatter = 0.5 * (self.scatter + self.scatter.transpose()) / f64::from(self.frames.max(1));
        scatter.symmetric_eigenvalues().min().max(0.0).sqrt() / f64::from(self.camera.image_size[0].max(1))
    }

    /// Mean place of the light, as parts of the image's width and height.
    pub(super) fn middle(&self) -> [f64; 2] {
        [0, 1].map(|it| (self.mean[it] + 0.5) / f64::from(self.camera.image_size[it].max(1)))
    }

    /// Where a light is standing now.
    pub(super) fn standing(&self, options: &CoverageOptions) -> impl Iterator<Item = Point2<f64>> {
        let now = self.camera_frames;
        let options = *options;
        self.places
            .iter()
            .filter(move |it| stands(it, now, &options) && now - it.last <= options.still_looks)
            .map(|it| it.pixel)
    }
}

/// Enters a spot among the places that are watched; whether a light is standing there.
fn watch(places: &mut [Place; PLACES], pixel: Point2<f64>, now: u32, options: &CoverageOptions) -> bool {
    let near = |it: &&mut Place| it.hits > 0 && (it.pixel - pixel).norm() <= options.still_px;
    if let Some(place) = places.iter_mut().find(near) {
        if place.last != now {
            place.hits += 1;
            place.last = now;
        }
        return stands(place, now, options);
    }
    // What was seen longest ago makes room: a standing light is in every picture.
    if let Some(oldest) = places.iter_mut().min_by_key(|it| it.last) {
        *oldest = Place { pixel, hits: 1, first: now, last: now };
    }
    false
}

fn stands(place: &Place, now: u32, options: &CoverageOptions) -> bool {
    place.hits >= options.still_looks.max(2) && f64::from(place.hits) >= STANDS * f64::from(now - place.first + 1)
}
