//! Coverage of a waved light, to guide the person who waves it: what each camera saw of it, which cameras saw it together, what is still
//! missing, and when it suffices.
//!
//! [`Coverage`] is fed each picture as it comes, at a cost of one comparison for each camera. The rule for stopping
//! ([`Coverage::state`]): it is enough when, by [`CoverageOptions`],
//!
//! - each camera saw the light in `min_frames` frames, in which it moved;
//! - these fill `min_cells` of its image, or `least_cells` where waving on fills no more, and do not lie on a line;
//! - cameras that saw it together in `min_common` frames are partners, and all cameras are linked by partners;
//! - what each camera saw with one of its best partners does not lie in a plane;
//! - no camera sees several moving lights in more than `max_several` of its frames, and the light is not standing still.
//!
//! A light that stands still for `still_looks` pictures is not the waved one: it is ignored until it moves.

mod advice;
mod camera;
mod links;
mod terminal;
mod volume;

use foveate_geometry::{Camera, Ray};
use foveate_scene::WorkingVolume;
use nalgebra::Point2;

pub use self::advice::{Advice, Guidance, Region};
use self::camera::CameraCoverage;
use self::links::Links;
use self::volume::VolumeCoverage;
use crate::recording::{CameraFrame, CameraGuess, Recording};

/// Options of [`Coverage`]: what counts, and how much suffices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoverageOptions {
    /// Columns and rows of the grid over each image, each at least 1 [–].
    pub grid: [usize; 2],
    /// A cell is full with the light in so many frames [–].
    pub full_cell: u32,
    /// Frames in which a camera must have seen the light, moved since the last that counted [–].
    pub min_frames: u32,
    /// Part of its cells that a camera needs full [–].
    pub min_cells: f64,
    /// As `min_cells`, when the last `saturated_frames` filled no more: not every part of an image can be reached [–].
    pub least_cells: f64,
    /// See `least_cells` [–].
    pub saturated_frames: u32,
    /// Least standard deviation of the light's pixels across the line along which they spread most, of the image's width [–].
    pub min_spread: f64,
    /// Frames that two cameras must have seen together to be partners [–].
    pub min_common: u32,
    /// Pictures of two cameras are of one moment when at most this far apart; half the time between frames is right [s].
    pub tolerance_s: f64,
    /// A light counts again when it moved by this much in one of the cameras [px].
    pub step_px: f64,
    /// A light stands when it stays within this [px].
    pub still_px: f64,
    /// Through so many pictures [–].
    pub still_looks: u32,
    /// Lights that are waved at once: 1, or 2 for a wand [–].
    pub lights: usize,
    /// Largest part of a camera's frames with more moving lights than that [–].
    pub max_several: f64,
    /// A path is flat for two cameras when one plane explains this part of what they see together [–].
    pub flat_share: f64,
    /// Within this distance [px].
    pub flat_px: f64,
    /// Columns, rows and layers of the working volume [–].
    pub volume_cells: [usize; 3],
}

impl Default for CoverageOptions {
    fn default() -> Self {
        Self {
            grid: [8, 6],
            full_cell: 3,
            min_frames: 120,
            min_cells: 0.5,
            least_cells: 0.2,
            saturated_frames: 120,
            min_spread: 0.05,
            min_common: 30,
            tolerance_s: 0.017,
            step_px: 3.0,
            still_px: 1.5,
            still_looks: 30,
            lights: 1,
            max_several: 0.3,
            flat_share: 0.6,
            flat_px: 4.0,
            volume_cells: [8, 8, 5],
        }
    }
}

/// What all cameras saw so far.
#[derive(Debug, Clone, PartialEq)]
pub struct Coverage {
    options: CoverageOptions,
    cameras: Vec<CameraCoverage>,
    links: Links,
    volume: Option<VolumeCoverage>,
    newest_s: f64,
}

/// The light as a camera saw it last.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Seen {
    /// Number among the frames of its camera that show the light; 0: it never did.
    number: u32,
    time_s: f64,
    /// Whether it moved since it last counted.
    moved: bool,
    /// Without the lens, in pixels off the axis; `None` where the lens model ends.
    ideal: Option<[f32; 2]>,
    /// In the world, if the pose is known.
    ray: Option<Ray>,
}

impl Coverage {
    /// Nothing seen yet. A grid without cells is taken to have one.
    pub fn new(cameras: &[CameraGuess], options: &CoverageOptions) -> Self {
        let mut options = *options;
        options.grid = options.grid.map(|it| it.max(1));
        Self {
            options,
            cameras: cameras.iter().map(|it| CameraCoverage::new(it, options.grid)).collect(),
            links: Links::new(cameras.len()),
            volume: None,
            newest_s: f64::NEG_INFINITY,
        }
    }

    /// What a whole recording covers.
    pub fn of(recording: &Recording, options: &CoverageOptions) -> Self {
        let mut coverage = Self::new(&recording.cameras, options);
        recording.camera_frames.iter().for_each(|it| coverage.observe(it));
        coverage
    }

    /// From now on also tracks coverage of `volume`, and depths for each camera, by the poses of `cameras`
    /// (in the order of [`Self::new`]; `None`: not known). Earlier coverage of a volume is discarded.
    pub fn place(&mut self, cameras: &[Option<Camera>], volume: WorkingVolume) {
        self.volume = Some(VolumeCoverage::new(cameras, volume, self.options.volume_cells));
        self.cameras.iter_mut().for_each(|it| it.last.ray = None);
    }

    /// Takes one picture in. One of a camera that does not exist, or at a time that is no number, counts for nothing.
    pub fn observe(&mut self, camera_frame: &CameraFrame) {
        let Some(camera) = self.cameras.get_mut(camera_frame.camera).filter(|_| camera_frame.time_s.is_finite()) else {
            return;
        };
        self.newest_s = self.newest_s.max(camera_frame.time_s);
        let ray = |pixel: &Point2<f64>| self.volume.as_ref().and_then(|it| it.ray(camera_frame.camera, pixel));
        if !camera.observe(camera_frame, &self.options, ray) {
            return;
        }
        self.links.meet(camera_frame.camera, &self.cameras, self.options.tolerance_s);
        if let Some(volume) = &mut self.volume {
            volume.observe(camera_frame.camera, &self.cameras, self.options.tolerance_s);
        }
    }

    /// Whether coverage suffices, and what is missing, by the rule of this module. Takes some 0.1 ms for each camera.
    pub fn state(&self) -> Guidance {
        advice::guidance(self)
    }

    /// A picture in characters, at most `width` columns wide if one camera fits into that: the grid of each camera,
    /// the links between cameras, and the most important advice. For more than 64 cameras a table. `color`: with ANSI colours.
    pub fn render(&self, width: usize, color: bool) -> String {
        terminal::render(self, width, color)
    }

    /// How many cameras there are.
    pub fn n_cameras(&self) -> usize {
        self.cameras.len()
    }

    /// Frames in which `camera` saw the light, moved since the last that counts; 0 for one that does not exist.
    pub fn frames(&self, camera: usize) -> u32 {
        self.cameras.get(camera).map_or(0, |it| it.frames)
    }

    /// In how many frames the light was in each cell of the image of `camera`, row by row, counted up to 65535; empty for a
    /// camera that does not exist.
    pub fn cells(&self, camera: usize) -> &[u16] {
        self.cameras.get(camera).map_or(&[], |it| &it.cells)
    }

    /// Part of the cells of `camera` that are full.
    pub fn share(&self, camera: usize) -> f64 {
        self.cameras.get(camera).map_or(0.0, |it| it.share(&self.options))
    }

    /// Whether `camera` saw the light in as many frames and in as much of its image as suffices.
    pub fn is_done(&self, camera: usize) -> bool {
        let options = &self.options;
        self.cameras.get(camera).is_some_and(|it| {
            let share = it.share(options);
            let is_saturated = share >= options.least_cells && it.since_full >= options.saturated_frames;
            it.frames >= options.min_frames && (share >= options.min_cells || is_saturated)
        })
    }

    /// What counts, and how much suffices.
    pub fn options(&self) -> &CoverageOptions {
        &self.options
    }

    /// Name of `camera`; empty for one that does not exist.
    pub fn name(&self, camera: usize) -> &str {
        self.cameras.get(camera).map_or("", |it| &it.name)
    }

    /// Cameras that saw the light together with `camera` in as many frames as suffice.
    pub fn partners(&self, camera: usize) -> usize {
        (0..self.n_cameras()).filter(|it| self.common(camera, *it) >= self.options.min_common).count()
    }

    /// Frames that two cameras saw together.
    pub fn common(&self, a: usize, b: usize) -> u32 {
        self.links.common(a, b)
    }

    /// Part of the cells of the working volume that two cameras can see in which the light has been; `None` before
    /// [`Self::place`], or if there are none.
    pub fn volume_share(&self) -> Option<f64> {
        self.volume.as_ref().and_then(VolumeCoverage::share)
    }

    /// Nearest and farthest depth at which `camera` saw the light; `None` before [`Self::place`] and before it did [m].
    pub fn depth_m(&self, camera: usize) -> Option<[f64; 2]> {
        self.volume.as_ref().and_then(|it| it.depth(camera))
    }
}

#[cfg(test)]
mod tests;
